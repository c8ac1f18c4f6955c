"""From bodies to the paper's first-order model: the physics converges to the ideal run as m / D goes to zero.

Oracles: the ideal backend on the same scenario (itself checked against the published run), and the value measured on
bodies before mjsheaf was written (tests/data/paper_facts.json).
"""

from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import load_scenario
from mjsheaf.scenario import Scenario
from tests.builders import FACTS, Simulated, list_members, mixed_scenario, pursuit
from tests.running import run_ideal, run_physics


def distance(one: xr.Dataset, other: xr.Dataset) -> float:
    """Sup over t >= 5 s and over the agents of the distance between two runs, m."""
    apart = np.linalg.norm((one.agent_position - other.agent_position).sel(axis=["x", "y"]), axis=2)
    return float(apart[one.time.values >= 5.0].max())


@pytest.mark.slow
def test_distance_to_the_ideal_run_is_of_first_order_in_m_over_d(simulated: Simulated) -> None:
    """Slope 1 +- 0.05 from 0.03 s to 0.001 s. The first seconds hold a jump that no body can follow."""
    taus = [0.03, 0.01, 0.003, 0.001]
    ideal = simulated("paper", "ideal", {"time.end": 12.0})
    apart = []
    for tau in taus:
        steps = int(np.ceil(0.01 / (tau / 10.0) - 1e-9))  # of at most tau / 10, a whole number in a control period
        overrides = {"time.end": 12.0, "vehicles.tau": tau, "physics.timestep": 0.01 / steps}
        apart.append(distance(simulated("paper", "physics", overrides), ideal))
    slopes = np.diff(np.log(apart)) / np.diff(np.log(taus))
    np.testing.assert_allclose(slopes, 1.0, atol=0.05)
    np.testing.assert_allclose(apart, 31.8 * np.array(taus), rtol=0.05)  # 0.032 m at 0.001 s, as measured before


@pytest.fixture(scope="module")
def on_bodies(simulated: Simulated) -> xr.Dataset:
    assert load_scenario("paper").vehicles.tau == FACTS["bodies_gain_10"]["tau"]
    return simulated("paper", "physics")


@pytest.mark.slow
def test_published_run_on_bodies_ends_where_it_was_measured_to(on_bodies: xr.Dataset) -> None:
    measured = FACTS["bodies_gain_10"]["mean_disagreement_at_49.99"]
    assert float(on_bodies.time[-1]) == pytest.approx(49.99)
    assert float(on_bodies.disagreement[-1].mean()) == pytest.approx(measured, abs=2e-4)


@pytest.mark.slow
def test_boats_stay_on_the_water_and_hold_their_headings(on_bodies: xr.Dataset) -> None:
    """Whatever the law asks of them in the plane, they float level, with the heading they began with."""
    assert np.abs(on_bodies.agent_height).max() < 1e-3
    turned = np.abs((on_bodies.agent_orientation * on_bodies.agent_orientation[0]).sum("quaternion"))
    assert float(turned.min()) > 1.0 - 1e-6
    assert np.unique(on_bodies.agent_orientation[0, :, 3].values.round(6)).size > 10  # and those are not alike
    assert not on_bodies.agent_saturation.any()


def ellipse(name: str, tau: float, timestep: float) -> Scenario:
    """One vehicle after a target on an ellipse, in a drift and a vortex, with thrusters without limits and lag."""
    z = [] if name == "wamv" else [5.0]
    n = 2 + len(z)
    swing = {"amplitude": [6.0, 4.0, 1.0][:n], "rate": [0.4, 0.4, 0.3][:n], "phase": [0, 90, 0][:n]}
    flow: dict[str, Any] = {"dimension": n, "core": 2.0, "drift": [0.4, -0.3, 0.1][:n]}
    flow["vortices"] = [{"centre": [1, 2, *z], "gamma": 1.5, **({"axis": [0, 0, 1]} if z else {})}]
    return pursuit(
        [-2, 1, *z],
        [0, 0, *z],
        {"vehicle": name, "heading": 30},
        time={"end": 12.0},
        controller={"gain": 1.0, "control_period": 0.0, "record_period": 0.1},
        target_motion={"kind": "lissajous", **swing},
        flow={"agents": flow},
        vehicles={"tau": tau},
        physics={"timestep": timestep, "effects": {"limits": False, "lag": False}},
    )


@pytest.mark.parametrize("name", ["hexarotor", "wamv"])
def test_a_fully_actuated_vehicle_comes_to_the_ideal_run_as_tau_goes_to_zero(name: str) -> None:
    """Sup of the distance once the start is over: slope 1 +- .1 from .1 to .01 s, its own drag law and all."""
    taus, apart = [0.1, 0.03, 0.01], []
    for tau in taus:
        system = ellipse(name, tau, 0.1 / np.ceil(0.1 / (tau / 8.0))).system
        ideal = run_ideal(system)
        # Targets are bodies too: what is compared is an agent after the very same target.
        bodies = run_physics(system, targets=ideal.positions[:, 1:])
        late = bodies.time > 4.0
        apart.append(float(np.linalg.norm(bodies.positions[late, 0] - ideal.positions[late, 0], axis=1).max()))
    slopes = np.diff(np.log(apart)) / np.diff(np.log(taus))
    np.testing.assert_allclose(slopes, 1.0, atol=0.1)


@pytest.mark.parametrize(("runner", "period"), [(run_ideal, 0.01), (run_ideal, 0.0), (run_physics, 0.01)])
def test_given_targets_make_the_same_run(runner: Any, period: float) -> None:
    """The run's own targets, given back: all as it was, bit for bit; others, and only their followers' runs differ.

    One of them is at its hand point. The run ends with the last given target.
    """
    system = mixed_scenario(
        targets=list_members({"diver": [1, 1, -2], "ship": {"position": [-3, 2], "vehicle": "otter"}}, heading=30),
        controller={"gain": 3.0, "control_period": period, "record_period": 0.01},
    ).system
    N = len(system.team.agents)
    run = runner(system)
    again = runner(system, targets=run.positions[:, N:])
    for name in ("positions", "thruster_command", "quaternions"):
        np.testing.assert_array_equal(getattr(again.log, name), getattr(run.log, name))
    other = run.positions[:, N:] + np.linspace(0, 1, len(run.time))[:, None, None] * [[1, 1, 1], [1, 1, 0]]
    shifted = runner(system, targets=other)
    np.testing.assert_allclose(shifted.positions[1:, N:], other[1:], rtol=0, atol=0 if runner is run_ideal else 1e-12)
    assert (np.abs(shifted.positions[-1, :N] - run.positions[-1, :N]).max(axis=1) > 0.01).all()

    short = runner(system, targets=run.positions[:31, N:])
    assert (len(short.time), len(short.positions), short.status) == (31, 31, "finished")
    assert len(runner(system, targets=np.concatenate([other] * 2)).time) == len(run.time)
