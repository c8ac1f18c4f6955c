"""Endings of runs: curves with a known answer, and simulated teams with a known loop.

Oracle: closed forms; `check`'s loop, which was held against simulation.
"""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.checking.loop.body_loop import ending_of_run
from mjsheaf.results.ending import ending_of_motion, is_level, judge, settling_time
from mjsheaf.scenario import Scenario
from mjsheaf.studies.plan import load_plan
from mjsheaf.studies.workers import run_job
from tests.builders import QUADROTOR_PAIR, build_scenario, make_scenario

TIME = np.linspace(0.0, 20.0, 2001)
UNIT = np.linspace(0.0, 1.0, 1001)
Curve = Callable[[Any], Any]


@pytest.mark.parametrize(
    ("verdict", "curve"),
    [
        ("settled", lambda t: np.exp(-9 * t)),
        ("settled", lambda t: 3 + np.exp(-6 * t)),
        ("settled", lambda t: 3 + np.exp(-20 * t) + 0.1 * np.sin(60 * t)),
        ("settled", lambda t: 2 + 0 * t),
        ("settled", lambda t: 1 + 0.5 * np.sin(31 * t)),
        ("settled", lambda t: 0 * t),
        ("not settled", lambda t: np.exp(-3 * t)),
        ("not settled", lambda t: 100 - 0.01 * t),
        ("not settled", np.sqrt),
        ("not settled", lambda t: 1 / (1 + t)),
        ("not settled", lambda t: 13 * (1 - np.exp(-2 * t)) + 0.1 * np.sin(40 * t)),  # small next to the rise
        ("diverging", lambda t: 1 + t),
        ("diverging", lambda t: np.exp(3 * t)),
        ("diverging", lambda t: np.exp(-9 * t) + t**3),
    ],
)
def test_a_curve_keeps_its_level_changes_or_gets_worse(verdict: str, curve: Curve) -> None:
    assert judge(curve(UNIT)) == verdict


def test_little_is_said_of_little() -> None:
    assert judge(UNIT[:7]) is None
    assert judge(np.where(UNIT > 0.5, np.nan, 1.0)) is None
    assert settling_time(UNIT, np.where(UNIT > 0.5, np.nan, 1.0)) is None


def circle(radius: Any) -> tuple[np.ndarray, np.ndarray]:
    """Error and offsets of an agent on a circle of a radius: its error alone shows nothing of it."""
    offsets = np.stack([radius * np.cos(40 * UNIT), radius * np.sin(40 * UNIT), 0 * UNIT], axis=1)[:, None]
    return np.linalg.norm(offsets, axis=2).mean(axis=1), offsets


def test_a_limit_cycle_where_nothing_drives() -> None:
    error, offsets = circle(1.0 + 0 * UNIT)
    assert judge(error) == "settled"
    assert judge(error, offsets) == "not settled"
    assert judge(*circle(np.exp(2 * UNIT))) == "diverging"
    smaller_but_growing = np.exp(0.5 * UNIT) / 100 + (UNIT < 0.1)
    assert judge(*circle(smaller_but_growing)) == "diverging"
    assert judge(*circle(np.exp(-12 * UNIT))) == "settled"
    assert judge(*circle(np.exp(-2 * UNIT))) == "not settled"
    assert judge(*circle(np.exp(-50 * UNIT) + 1e-12)) == "settled"  # rounding


def test_what_decays_slowly_has_not_settled() -> None:
    """A drift, which is no limit cycle, and a swing that loses 3 % in a quarter."""
    for along in (np.exp(-0.01 * UNIT), np.exp(-0.12 * UNIT) * np.sin(240 * UNIT)):
        offsets = np.stack([along, 0 * UNIT, 0 * UNIT], axis=1)[:, None]
        assert judge(np.linalg.norm(offsets, axis=2).mean(axis=1), offsets) == "not settled"


def test_a_transient_settles_when_two_percent_are_left() -> None:
    """Alone or over an oscillation; one that never was worse has settled at once."""
    swing = 0.1 * np.sin(3.0 * TIME)
    assert settling_time(TIME, 5.0 * np.exp(-TIME)) == pytest.approx(np.log(50.0), abs=0.02)
    assert settling_time(TIME, 1.0 + 3.0 * swing) == 0.0
    assert 2.0 < (settling_time(TIME, 0.2 + swing + 10.0 * np.exp(-TIME)) or 0.0) < 5.0


@pytest.mark.parametrize("curve", [np.exp(0.2 * TIME), np.exp(-0.2 * TIME), TIME**3])
def test_what_grows_or_still_falls_never_settles(curve: np.ndarray) -> None:
    assert not is_level(curve)
    assert settling_time(TIME, curve) is None


def ring(gain: float, **fields: Any) -> Scenario:
    """Two quadrotors that begin to circle at a gain between 1.5 and 2, 1/s."""
    law = {"gain": gain, "control_period": 0.02}
    return make_scenario({**QUADROTOR_PAIR, "controller": law, "physics": {"timestep": 0.005}, **fields})


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "expected"), [(1.5, "settled"), (2.0, "not settled"), (3.0, "not settled")])
def test_the_ring_ends_as_check_says(gain: float, expected: str) -> None:
    scenario = ring(gain)
    run = mjsheaf.simulate(scenario, "physics")
    assert ending_of_motion(scenario.system, run) == expected
    stable = mjsheaf.check(scenario, trial=False)["margins"]["bodies"]["stable"]
    assert stable is (expected == "settled")
    assert ending_of_motion(scenario.system, mjsheaf.simulate(scenario, "ideal")) == "settled"


def test_a_driven_ring_ends_as_check_says() -> None:
    """With an oscillating target only the loop distinguishes a forced oscillation from the team's own."""
    motion = {"kind": "lissajous", "amplitude": [1, 0, 0], "rate": [1.5, 0, 0], "phase": [0, 0, 0], "pull": 0.0}
    for gain, expected in ((1.2, "settled"), (3.0, "not settled")):
        scenario = ring(gain, targets=[{**QUADROTOR_PAIR["targets"][0], "motion": motion}])
        assert ending_of_run(scenario.system, mjsheaf.simulate(scenario, "physics")) == expected


def test_what_the_noise_of_odometry_moves_has_settled() -> None:
    law = {"gain": 1.0, "control_period": 0.02, "odometry": {"noise": 0.01}, "drift": {"filter": 0.5}}
    scenario = ring(1.0, controller=law)
    assert ending_of_motion(scenario.system, mjsheaf.simulate(scenario, "ideal")) == "settled"


@pytest.mark.parametrize(
    ("links", "bound", "expected"),
    [
        ({"delay": 0.5, "noise": 0.01}, 0.0, "not settled"),
        ({"delay": 0.5, "noise": 0.01, "loss": 0.2}, 0.1, "not settled"),
        ({"noise": 0.1}, 0.0, "settled"),
        ({"noise": 0.01}, 0.5, "settled"),
    ],
)
def test_noise_and_disturbances_hide_no_limit_cycle(links: dict[str, float], bound: float, expected: str) -> None:
    """Too high a gain for the delay, and commands at the velocity limit; without the delay they explain the motion."""
    scenario = build_scenario(
        {"A1": [-5, 1], "A2": [6, -3]},
        {"T": {"position": [0, 0], "motion": {"kind": "fixed"}}},
        [["A1", "T"], ["A2", "T"]],
        communication=[["A1", "A2"]],
        controller={"control_period": 0.05, "gain": 4.0, "velocity_limit": 1.0},
        links={"all": links},
        disturbance={"agents": {"bound": bound}},
        time={"end": 40.0},
    )
    run = mjsheaf.simulate(scenario, "ideal")
    assert ending_of_motion(scenario.system, run) == ending_of_run(scenario.system, run) == expected


def test_a_sweep_says_the_same(tmp_path: Any) -> None:
    path = tmp_path / "ring.yaml"
    path.write_text(json.dumps({**QUADROTOR_PAIR, "physics": {"timestep": 0.005}}))
    plan = load_plan(str(path), grid={"controller.gain": [1.5, 3.0]}, backend="physics")
    records = [run_job(plan.job(point)).record for point in plan.points]
    assert [record["settled"] for record in records] == [True, False]
    assert [record["ending"] for record in records] == ["settled", "not settled"]
    assert records[1]["late"]["tracking_error"] == pytest.approx(1.23, rel=0.1)


def test_a_trend_is_seen_beside_an_oscillation() -> None:
    t = np.linspace(0.0, 60.0, 6001)
    for period in (1.7, 5.3, 7.4, 11.0):
        swing = np.sin(2.0 * np.pi * t / period)
        assert judge(1.0 + 0.5 * swing) == "settled", period
        if period > 7.5:  # a quarter may hold no whole period: a trend cannot be distinguished from it
            continue
        assert judge(1.0 + 0.01 * t + 0.5 * swing) == "diverging", period
        assert judge(np.exp(0.02 * t) * (1.0 + 0.3 * swing)) == "diverging", period
