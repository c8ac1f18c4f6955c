"""Agents that are too slow: for lost measurements, for commands that noise makes, and for gusts."""

from functools import partial

import numpy as np
import pytest
from scipy.optimize import brentq

import mjsheaf
from mjsheaf.checking.loop.margins import _fraction_heard, _mean_speed
from tests.builders import build_scenario


def scenario(limit, loss, *, vehicle="hull", hold=0.0):
    """An agent that senses a target at rest over a link with losses, in a current of 1 m/s."""
    return build_scenario(
        {"A": {"position": [0, 0], "vehicle": vehicle}},
        {"T": {"position": [0, 0], "motion": {"kind": "static", "pull": 5.0}}},
        [["A", "T"]],
        flow={"water": {"dimension": 2, "drift": [1.0, 0.0]}},
        time={"end": 120},
        controller={"gain": 1.0, "control_period": 0.05, **({} if limit is None else {"velocity_limit": limit})},
        links={"all": {"loss": loss, "hold": hold}},
    )


@pytest.mark.parametrize(("limit", "loss"), [(1.6, 0.5), (3.0, 0.75)])
def test_an_agent_falls_behind_as_foreseen_on_ideal_kinematics(limit, loss):
    given = scenario(limit, loss)
    record = mjsheaf.check(given, trial=False, progress=False)
    (demand,) = record["margins"]["speed"]
    assert demand["heard"] == pytest.approx(1.0 - loss)
    run = mjsheaf.simulate(given, backend="ideal", progress=False)
    error = run["tracking_error"].values[:, 0]
    rate = (error[-1] - error[len(error) // 4]) / 90.0
    assert rate == pytest.approx(1.0 - limit * (1.0 - loss), abs=0.05)
    least = error[3 * len(error) // 4]  # over the last quarter; losses let it stray by 2 or 3 m RMS
    assert demand["deficit"] == pytest.approx((1.0 - limit * (1.0 - loss)) * 90.0, rel=0.03)
    assert least == pytest.approx(demand["deficit"], abs=7.0)
    assert [problem["kind"] for problem in record["problems"]] == ["limited"]
    assert "links that lose less" in record["problems"][0]["fix"]


@pytest.mark.parametrize("fields", [{"limit": 2.4}, {"limit": None}, {"limit": 1.6, "hold": 1.0}])
def test_one_that_is_told_often_enough_keeps_up(fields):
    given = scenario(**{"loss": 0.5} | fields)
    record = mjsheaf.check(given, trial=False, progress=False)
    assert record["ok"]
    error = mjsheaf.simulate(given, backend="ideal", progress=False)["tracking_error"].values[:, 0]
    assert error[-1] < 1.3 * error[len(error) // 2] + 0.2


def test_a_vehicle_falls_behind_on_bodies():
    given = scenario(None, 0.97, vehicle="otter")
    record = mjsheaf.check(given, trial=False, progress=False)
    assert "slow" in [problem["kind"] for problem in record["problems"]]
    (demand,) = record["margins"]["speed"]
    run = mjsheaf.simulate(given, engine="fused", progress=False)
    assert run["tracking_error"].values[-1, 0] > demand["deficit"] > 0.0


@pytest.mark.parametrize("drag", [(1.0, 0.0), (0.3, 0.7), (0.0, 1.0)])
@pytest.mark.parametrize("heard", [0.05, 0.3, 0.9])
def test_no_thrust_makes_a_larger_mean_speed(drag, heard):
    """The best that thrust at a fraction of the time can do, in long and short pulses, is below the bound."""
    D, Q = drag
    top = brentq(lambda v: D * v + Q * v * v - 1.0, 0.0, 100.0)
    bound = _mean_speed(np.inf, top, heard)
    for period in (0.02, 0.5, 20.0):
        h, v = period / 200, 0.0
        cycles = max(4, int(60.0 / period))
        means = np.zeros(cycles)
        for cycle in range(cycles):
            for k in range(200):
                v += h * (float(k < 200 * heard) - D * v - Q * v * v)
                means[cycle] += v / 200
        assert means[-1] <= 1.01 * bound


def test_edges_are_lost_independently():
    agents = {"A": [0, 0], "B": [5, 0], "C": [0, 5]}
    build = partial(build_scenario, agents, {"T": [1, 1]}, [["A", "T"]], communication=[["A", "B"], ["B", "C"]])
    lossy = build(links={"sensing": {"loss": 0.5}, "communication": {"loss": 0.2}})
    np.testing.assert_allclose(_fraction_heard(lossy.whole), [1 - 0.5 * 0.2, 1 - 0.2 * 0.2, 0.8])
    once = build(links={"sensing": {"loss": 0.5}})
    np.testing.assert_allclose(_fraction_heard(once.whole), 1.0)
    bursts = {"to_bad": 0.1, "to_good": 0.3, "loss_bad": 0.8}
    np.testing.assert_allclose(_fraction_heard(build(links={"all": {"loss": bursts}}).whole), 1.0)


def in_noise(gain):
    """A quadrotor at a target at rest that it sees with noise."""
    return build_scenario(
        {"D": {"position": [0, 0, 10], "vehicle": "quadrotor"}},
        {"T": {"position": [0, 0, 10], "vehicle": "aerial", "motion": {"kind": "static"}}},
        [["D", "T"]],
        time={"end": 30},
        controller={"gain": gain, "control_period": 0.1},
        links={"all": {"noise": 1.2}},
    )


def test_commands_that_noise_makes_are_a_problem_beyond_the_vehicles_speed():
    calm, shaken = in_noise(1.0), in_noise(7.0)
    assert mjsheaf.check(calm, trial=False, progress=False)["ok"]
    problems = mjsheaf.check(shaken, trial=False, progress=False)["problems"]
    (problem,) = [problem for problem in problems if problem["kind"] == "noise"]
    run = mjsheaf.simulate(shaken, backend="ideal", progress=False)
    size = np.sqrt((np.linalg.norm(run["velocity_command"].values[:, 0], axis=1) ** 2).mean())
    assert f"commands of {size:.2g}"[:14] in problem["why"]
    assert size > 9.4


@pytest.mark.parametrize(("drift", "wind"), [(0.0, 8.0), (0.0, 30.0), (3.0, 6.0), (5.0, 6.0), (8.5, 6.0)])
def test_gusts_carry_off_where_they_are_too_fast_a_tenth_of_the_time(drift, wind):
    """Oracle: how often the gusts of a long run are faster than the quadrotor."""
    scenario = build_scenario(
        {"D": {"position": [0, 0, 20], "vehicle": "quadrotor"}},
        {"T": {"position": [0, 0, 20], "vehicle": "aerial", "motion": {"kind": "static", "pull": 1.0}}},
        [["D", "T"]],
        time={"end": 20_000},
        controller={"control_period": 0.5},
        flow={"air": {"dimension": 3, "drift": [drift, 0, 0], "gusts": {"kind": "dryden", "wind_speed": wind}}},
    )
    times = np.arange(0.0, 20_000.0, 0.5)
    speed = np.linalg.norm(mjsheaf.medium(scenario).velocity("D", times, np.array([0.0, 0.0, 20.0]))[:, :2], axis=1)
    faster = float((speed > scenario.whole.vehicles[0].capability.least_speed).mean())
    assert abs(faster - 0.1) > 0.03  # no case is near the border
    record = mjsheaf.check(scenario, trial=False, progress=False)
    assert ("D" in record["disturbance"]["carried_off"]) is (faster > 0.1)
