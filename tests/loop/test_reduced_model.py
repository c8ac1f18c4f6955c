"""From real vehicles to the paper's first-order model as their autopilots are made faster, and targets that are given.

Oracles: the ideal backend; a slope of 1 in tau; bits.
"""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mjsheaf.scenario import Scenario
from tests.builders import FLOW, make_scenario, mixed_scenario
from tests.running import run_ideal, run_physics

Array = NDArray[np.float64]


def chase(name: str, tau: float, timestep: float) -> Scenario:
    """One vehicle after a target on an ellipse, in a drift and a vortex, with thrusters without limits and lag."""
    z = [] if name == "wamv" else [5.0]
    motion = {
        "kind": "lissajous",
        "amplitude": [6.0, 4.0, 1.0][: 2 + len(z)],
        "rate": [0.4, 0.4, 0.3][: 2 + len(z)],
        "phase": [0, 90, 0][: 2 + len(z)],
    }
    flow: dict[str, Any] = {"dimension": 2 + len(z), "core": 2.0, "drift": [0.4, -0.3, 0.1][: 2 + len(z)]}
    flow["vortices"] = [{"centre": [1, 2, *z], "gamma": 1.5, **({"axis": [0, 0, 1]} if z else {})}]
    return make_scenario(
        {
            "time": {"end": 12.0},
            "controller": {"gain": 1.0, "control_period": 0.0, "record_period": 0.1},
            "agents": [{"id": "A", "position": [-2, 1, *z], "vehicle": name, "heading": 30}],
            "targets": [{"id": "T", "position": [0, 0, *z], "motion": motion}],
            "sensing": [["A", "T"]],
            "flow": {"agents": flow},
            "vehicles": {"tau": tau},
            "physics": {"timestep": timestep, "effects": {"limits": False, "lag": False}},
        }
    )


@pytest.mark.parametrize("name", ["hexarotor", "wamv"])
def test_a_fully_actuated_vehicle_comes_to_the_ideal_run_as_tau_goes_to_zero(name: str) -> None:
    """Sup of the distance once the start is over: slope 1 +- .1 from .1 to .01 s, its own drag law and all."""
    taus, apart = [0.1, 0.03, 0.01], []
    for tau in taus:
        system = chase(name, tau, 0.1 / np.ceil(0.1 / (tau / 8.0))).system
        ideal = run_ideal(system)
        # Targets are bodies too: what is compared is an agent after the very same target.
        bodies = run_physics(system, targets=ideal.positions[:, 1:])
        late = bodies.time > 4.0
        apart.append(float(np.linalg.norm(bodies.positions[late, 0] - ideal.positions[late, 0], axis=1).max()))
    slopes = np.diff(np.log(apart)) / np.diff(np.log(taus))
    np.testing.assert_allclose(slopes, 1.0, atol=0.1)


@pytest.mark.parametrize("period", [0.01, 0.0])
def test_given_targets_make_the_same_ideal_run(period: float) -> None:
    """The run's own targets, given back: all as it was, bit for bit; others, and only their followers' runs differ."""
    system = mixed_scenario(controller={"gain": 3.0, "control_period": period, "record_period": 0.01}).system
    N = len(system.team.agents)
    run = run_ideal(system)
    again = run_ideal(system, targets=run.positions[:, N:])
    np.testing.assert_array_equal(again.positions, run.positions)
    other = run.positions[:, N:] + np.linspace(0, 1, len(run.time))[:, None, None]
    shifted = run_ideal(system, targets=other)
    np.testing.assert_array_equal(shifted.positions[1:, N:], other[1:])
    assert (np.abs(shifted.positions[-1, :N] - run.positions[-1, :N]).max(axis=1) > 0.01).all()


def test_given_targets_make_the_same_run_on_bodies() -> None:
    """With targets of every kind, one of them at its hand point."""
    system = mixed_scenario(
        targets=[
            {"id": "diver", "position": [1, 1, -2], "heading": 10},
            {"id": "ship", "position": [-3, 2], "heading": 45, "vehicle": "otter"},
        ],
        flow={"agents": FLOW},
    ).system
    N = len(system.team.agents)
    run = run_physics(system)
    again = run_physics(system, targets=run.positions[:, N:])
    np.testing.assert_array_equal(again.positions, run.positions)
    np.testing.assert_array_equal(again.log.thruster_command, run.log.thruster_command)
    np.testing.assert_array_equal(again.log.quaternions, run.log.quaternions)
    other = run_ideal(system).positions[:, N:]
    shifted = run_physics(system, targets=other)
    np.testing.assert_allclose(shifted.positions[:, N:], other, atol=1e-12)
    assert np.abs(shifted.positions[-1, :N] - run.positions[-1, :N]).max() > 0.0


def test_a_run_ends_with_the_last_given_target() -> None:
    system = mixed_scenario().system
    N = len(system.team.agents)
    whole = run_ideal(system)
    for runner in (run_ideal, run_physics):
        short = runner(system, targets=whole.positions[:31, N:])
        assert len(short.time) == len(short.positions) == 31
        assert short.status == "finished"
        assert short.time[-1] == whole.time[30]
        long = runner(system, targets=np.concatenate([whole.positions[:, N:]] * 2))
        assert len(long.time) == len(whole.time)
