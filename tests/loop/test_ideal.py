"""The ideal backend against the published run and against independent integration.

Oracles: the checkpoints of the published run (tests/data/paper_facts.json); scipy's solve_ivp on the closed loop in
plain numpy; the matrix exponential where the loop is linear.
"""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from mjsheaf import simulate
from mjsheaf.arrays import Array
from mjsheaf.loop.engine import Trajectory
from mjsheaf.loop.system import System
from mjsheaf.results.dataset import make_datasets
from mjsheaf.scenario import Scenario
from tests.builders import FACTS, FLOW, Simulated, build_scenario, mixed_scenario, pursuit
from tests.oracles.law import medium, velocity_commands
from tests.running import run_ideal

DISTURBED = {"agents": {"bound": 0.5}, "targets": {"bound": 0.3}}
MOTION = {"kind": "lissajous", "amplitude": [2, 1, 1], "rate": [1, 2, 1], "phase": [1.5, 0, 0]}
TARGETS = [
    {"id": "diver", "position": [1, 1, -2], "motion": MOTION},
    {"id": "ship", "position": [-3, 2], "motion": {"kind": "waypoints", "points": [[0, 5], [5, 5]], "speed": 4.0}},
]


def run(system: System) -> Trajectory:
    trajectory = run_ideal(system)
    assert trajectory.status == "finished"
    assert trajectory.message == ""
    np.testing.assert_array_equal(trajectory.time, system.grid.samples)
    return trajectory


def test_published_checkpoints(simulated: Simulated) -> None:
    published = simulated("paper", "ideal")
    assert published.sizes["time"] == 4999
    np.testing.assert_allclose(published.time[[0, -1]], [0.01, 49.99], rtol=1e-14)
    seen = {
        "mean_disagreement": published.disagreement.mean("agent"),
        "A10_xy": published.agent_position.sel(agent="A10", axis=["x", "y"]),
        "T1_xyz": published.target_position.sel(target="T1"),
    }
    for name, values in seen.items():
        for t, expected in FACTS["checkpoints_gain_10"][name].items():
            found = values.sel(time=float(t), method="nearest")
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8, err_msg=name)


@pytest.mark.parametrize("period", [0.05, 0.0], ids=["held", "continuous"])
def test_a_linear_loop_is_a_power_or_an_exponential_of_its_matrix(period: float) -> None:
    """Q' = w - k1 (H q - B p - c); held over h, e falls by the factors 1 - k1 h lambda, as H is symmetric."""
    flow = {"agents": {"dimension": 3, "drift": [0.3, -0.2, 0.1]}}
    control = {"gain": 3.0, "control_period": period, "record_period": 0.01}
    system = mixed_scenario(controller=control, flow=flow, target_formation=None).system
    assert system.grid.continuous == (period == 0.0)
    team, problem = system.team, system.team.dirichlet
    H, n_q = 3.0 * problem.H.toarray(), problem.H.shape[0]
    q, p = np.split(team.pack(system.initial), [n_q])
    w = team.pack(np.tile([0.3, -0.2, 0.1], (5, 1)))[:n_q]
    rest = problem.extend(p) + np.linalg.solve(H, w)
    trajectory = run(system)
    for k, (t, x) in enumerate(zip(trajectory.time, trajectory.positions, strict=True)):
        factor = np.linalg.matrix_power(np.eye(n_q) - period * H, k) if period else expm(-H * t)
        found = team.pack(x)
        np.testing.assert_allclose(found[:n_q], rest + factor @ (q - rest), rtol=0, atol=1e-11 if period else 1e-9)
        np.testing.assert_array_equal(found[n_q:], p)


@pytest.mark.parametrize("period", [0.0, 0.1], ids=["continuous", "held"])
def test_everything_together_against_scipy(period: float) -> None:
    """Flow, disturbances, Lissajous and waypoint targets and their own consensus, mixed dimensions."""
    control = {"gain": 3.0, "control_period": period, "record_period": 0.1}
    system = mixed_scenario(controller=control, disturbance=DISTURBED, targets=TARGETS, ideal={"rtol": 1e-11}).system
    trajectory = run(system)
    x, V = np.array(system.initial), 5

    def slope(t: float, flat: Array, held: Array | None) -> Array:
        y = flat.reshape(V, 3)
        command = velocity_commands(system, t, y) if held is None else held
        return (command + [medium(system, v, t, y[v]) for v in range(V)]).ravel()

    for k, t in enumerate(trajectory.time):
        np.testing.assert_allclose(trajectory.positions[k], x, rtol=0, atol=1e-8)
        held = None if period == 0.0 else velocity_commands(system, t, x)
        solution = solve_ivp(slope, (t, t + 0.1), x.ravel(), "DOP853", args=(held,), rtol=1e-11, atol=1e-12)
        x = solution.y[:, -1].reshape(V, 3)


def test_the_tolerance_is_honoured() -> None:
    """The error falls with rtol, decade for decade, and stays within a hundred times of it."""
    fields: dict[str, Any] = {
        "controller": {"gain": 1.0, "control_period": 0.0, "record_period": 0.5},
        "physics": {"timestep": 0.5},
        "flow": {"agents": {**FLOW, "core": 0.3}, "targets": FLOW},
        "time": {"end": 5.0},
        "targets": TARGETS,
    }
    rtols = np.array([1e-13, 1e-4, 1e-6, 1e-8, 1e-10])
    systems = [mixed_scenario(ideal={"rtol": rtol, "atol": 1e-3 * rtol}, **fields).system for rtol in rtols.tolist()]
    exact, *others = (run(system).positions[-1] for system in systems)
    errors = [np.abs(other - exact).max() for other in others]
    assert (errors < 100.0 * rtols[1:]).all()
    assert errors[0] > 30.0 * errors[1] > 900.0 * errors[2] > 27000.0 * errors[3]


FOUR_IN_THE_PLANE: dict[str, Any] = {
    "layout": [[1, 0.5, -0.3, 2], [0, 1, 0.7, -1]],
    "heading": 20,
    "heading_gradient": [40, -25],
    "heading_rate": 90,
}
FIVE_IN_SPACE: dict[str, Any] = {
    "layout": [[1, 0, 0, 0.5, -1], [0, 2, 0, 0.3, 0.1], [0, 0, 0.5, 1, 1]],
    "heading": -70,
    "heading_gradient": [10, 20, 30],
    "heading_rate": -45,
}


@pytest.mark.parametrize("period", [0.0, 0.01], ids=["continuous", "held"])
def test_any_full_rank_effectiveness_gives_the_trajectory_of_the_identity(period: float) -> None:
    """g g^+ = I: with more inputs than states and a g that turns with position and time nothing else changes."""
    control = {"gain": 3.0, "control_period": period}
    plain = mixed_scenario(controller=control, disturbance=DISTURBED)
    agents = [a.model_dump(exclude_none=True) for a in plain.agents]
    for agent, g in zip(agents, (FOUR_IN_THE_PLANE, FIVE_IN_SPACE, FIVE_IN_SPACE), strict=True):
        agent["effectiveness"] = g
    turned = mixed_scenario(controller=control, disturbance=DISTURBED, agents=agents)
    one, other = run(plain.system), run(turned.system)
    assert np.any(one.positions != other.positions)  # it did take another way to the same numbers
    np.testing.assert_allclose(other.positions, one.positions, rtol=0, atol=1e-8)


def test_inputs_of_an_effectiveness_produce_the_commanded_velocity() -> None:
    """The recorded u has s channels, and g(q, t) u = -k1 eta at every sample."""
    agents = [a.model_dump(exclude_none=True) for a in mixed_scenario().agents]
    agents[0]["effectiveness"], agents[2]["effectiveness"] = FOUR_IN_THE_PLANE, FIVE_IN_SPACE
    system = mixed_scenario(agents=agents).system
    trajectory = run(system)
    x, t = trajectory.positions, trajectory.time
    commands = np.array([velocity_commands(system, *state)[:3] for state in zip(t, x, strict=True)])
    u = next(make_datasets([trajectory], "ideal", 0))["command"].values
    np.testing.assert_allclose(trajectory.log.command[:, :3], commands, rtol=1e-12, atol=1e-12)
    assert u.shape == (len(t), 3, 5)
    np.testing.assert_array_equal(np.isnan(u[0]), [[0, 0, 0, 0, 1], [0, 0, 0, 1, 1], [0, 0, 0, 0, 0]])
    np.testing.assert_allclose(u[:, 1, :3], commands[:, 1], rtol=1e-14)
    psi = np.deg2rad(20 + x[:, 0, :2] @ [40, -25] + 90 * t)
    turn = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]]).transpose(2, 0, 1)
    g_u = np.einsum("tij,jk,tk->ti", turn, np.array(FOUR_IN_THE_PLANE["layout"]), u[:, 0, :4])
    np.testing.assert_allclose(g_u, commands[:, 0, :2], atol=1e-11)


@pytest.mark.parametrize("period", [0.0, 0.01], ids=["continuous", "held"])
def test_a_shorter_run_is_the_beginning_of_a_longer_one(period: float) -> None:
    control = {"gain": 3.0, "control_period": period}
    whole, part = (run(mixed_scenario(controller=control, time={"end": end}).system).positions for end in (1.0, 0.4))
    np.testing.assert_array_equal(whole[: len(part)], part)


def test_progress_counts_up_to_the_end() -> None:
    seen: list[tuple[int, int]] = []
    run_ideal(mixed_scenario(time={"end": 12.0}).system, lambda done, of: seen.append((done, of)))
    assert seen == [(500, 1200), (1000, 1200), (1200, 1200)]


@pytest.mark.parametrize("period", [0.0, 0.01], ids=["continuous", "held"])
def test_a_run_that_takes_too_many_steps_ends_soon_and_says_why(period: float) -> None:
    """A vortex turns an agent many thousand times a second: no period fails alone, and the run would never end."""
    scenario = build_scenario(
        {"calm": [1e6, 0], "dizzy": [0, -1]},
        {"T": [5, 0]},
        [["calm", "T"], ["dizzy", "T"]],
        time={"end": 100.0},
        controller={"gain": 0.1, "control_period": period, **({} if period else {"record_period": 0.01})},
        flow={"agents": {"dimension": 2, "core": 0.1, "vortices": [{"centre": [0, 0], "gamma": 1e5}]}},
    )
    result = simulate(scenario, backend="ideal")
    assert result.attrs["status"] == "unstable"
    field = "control_period" if period else "record_period"
    vehicle = "dizzy" if period else "calm"  # integrated as one, the vehicle that is farthest away is named
    message = result.attrs["message"]
    assert message.startswith(f"unstable: {vehicle} takes more than 2000 steps of the integrator")
    assert f"for each controller.{field} of 0.01 s at t = " in message
    assert "or a flow or motion too strong to integrate" in message
    assert 0.0 < float(result.time[-1]) < 1.0


def test_targets_that_diverge_are_named_as_the_cause() -> None:
    scenario = mixed_scenario(target_formation={"gain": 150.0}, time={"end": 5.0})
    trajectory = run_ideal(scenario.system)
    assert trajectory.status == "unstable"
    assert "target_formation.gain" in trajectory.message


TINY = [0.0, 5e-324, 1e-310, 1e-300, 1e-100, 1e-30, 1e-16, -1e-16, 1e-12, 1e-8, 1e-4]


def next_to_the_origin(x: float, period: float, flow: dict[str, Any] | None = None) -> Scenario:
    """An agent at x on the way to a target 1 m ahead."""
    control = {"gain": 1.0, "control_period": period}
    return pursuit([x, 0], [1, 0], time={"end": 1.0}, controller=control, flow={"agents": flow} if flow else {})


@pytest.mark.parametrize("period", [0.0, 0.01], ids=["continuous", "held"])
@pytest.mark.parametrize("x", TINY)
def test_a_run_starts_from_any_position(x: float, period: float) -> None:
    """|x| / |x'| says nothing about the time scale there. Oracle: the closed form."""
    trajectory = run(next_to_the_origin(x, period).system)
    t, k = trajectory.time, np.arange(len(trajectory.time))
    expected = 1.0 - (1.0 - x) * (np.exp(-t) if period == 0.0 else 0.99**k)
    np.testing.assert_allclose(trajectory.positions[:, 0, 0], expected, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(trajectory.positions[:, 0, 1:], 0.0)


@pytest.mark.parametrize("period", [0.0, 0.01], ids=["continuous", "held"])
@pytest.mark.parametrize("alpha", [-1.0, 1.0], ids=["sink", "source"])
def test_a_run_starts_next_to_a_sink(alpha: float, period: float) -> None:
    """The start matters as little as it should: the flow's slope is at most 1 / core^2 = 11 1/s."""
    flow = {"dimension": 2, "core": 0.3, "sources": [{"centre": [0, 0], "alpha": alpha}]}
    ends = [run(next_to_the_origin(x, period, flow).system).positions[-1, 0] for x in TINY[:-2]]
    np.testing.assert_allclose(ends, np.tile(ends[0], (len(ends), 1)), rtol=0, atol=1e-6)


def test_periods_of_any_length_begin() -> None:
    """From rest at the origin the first trial step is 1e-6 s, whatever the period."""
    for period in (1e-6, 1e8):
        control = {"gain": 0.1 / period, "control_period": period}
        scenario = pursuit([0, 0], [1, 0], time={"end": 2.0 * period}, controller=control)
        np.testing.assert_allclose(run(scenario.system).positions[:, 0, 0], [0.0, 0.1, 0.19], atol=1e-12)
