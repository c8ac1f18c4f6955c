"""`check` judged by runs on bodies: missions that it calls OK work, and those that work it calls OK.

The slow studies print a table of their missions; see it with `-s`.
"""

from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
import pytest

import mjsheaf
from mjsheaf.errors import NotUniqueError, UnstableError
from tests.builders import make_scenario
from tests.missions import CAUSES, SPEEDS, failure_of_run, random_mission, unforeseen_error

MISSIONS = 300
MAX_CONTRADICTED = 0.05
"""Fraction of the missions OK by analysis alone whose runs may fail."""
MAX_FALSE_ALARMS = 0.1
"""Fraction of the missions whose runs are fine that `check` may call NOT OK."""


class Judged(NamedTuple):
    """A mission as `check` and its run judge it.

    Attributes:
        seed: Seed of the mission.
        summary: What it is about.
        ok: Verdict of `check`.
        reason: Reasons why that is not OK, or empty.
        failure: Failure of the run, or None.
        unforeseen: How far the error of the run is from the prediction, or None.
    """

    seed: int
    summary: str
    ok: bool
    reason: str
    failure: str | None
    unforeseen: str | None

    @property
    def contradicted(self) -> bool:
        """True if the run fails although the mission was OK."""
        return self.ok and self.failure is not None

    def __str__(self) -> str:
        verdict = "OK" if self.ok else f"NOT OK ({self.reason})"
        outcome = self.failure or self.unforeseen or "fine"
        return f"{self.seed:4d}  {self.summary:32s} {verdict}: {outcome}"


def judge(seed: int, trial: bool) -> Judged:
    """Check a mission, with or without a trial, and run it."""
    mission = random_mission(seed)
    scenario = make_scenario(mission)
    record = mjsheaf.check(scenario, trial=trial)
    unforeseen = None
    try:
        run = mjsheaf.simulate(scenario, engine="mujoco", progress=False)
    except (NotUniqueError, UnstableError) as error:
        failure = failure_of_run(mission, error)
    else:
        failure = failure_of_run(mission, run)
        unforeseen = unforeseen_error(mission, record, run)
    return Judged(seed, mission["summary"], record["ok"], _reason(record), failure, unforeseen)


def _reason(record: dict[str, Any]) -> str:
    """Give the reasons of a verdict that is not OK in a few words."""
    failed = [f"assumption {each['number']}" for each in record["assumptions"] if each["verdict"] != "holds"]
    trial = record.get("trial") or {"problems": []}
    return "; ".join([*failed, *trial["problems"]]) or "loops"


def study(seeds: Iterable[int], trial: bool) -> list[Judged]:
    """Judge missions on two processes, and print the table."""
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        judged = list(pool.map(judge, seeds, [trial] * len(list(seeds))))
    print("\n" + "\n".join(map(str, judged)))
    print(Counter(("OK" if each.ok else "NOT OK", "fails" if each.failure else "fine") for each in judged))
    return judged


def test_missions_are_those_of_their_seeds_and_diverse():
    missions = [random_mission(seed) for seed in range(60)]
    assert missions == [random_mission(seed) for seed in range(60)]
    for mission in missions:
        assert make_scenario(mission).phases
    assert {agent["vehicle"] for mission in missions for agent in mission["agents"]} == set(SPEEDS)
    assert {len(mission["agents"]) for mission in missions} == set(range(1, 7))
    assert {target["motion"]["kind"] for mission in missions for target in mission["targets"]} == {
        "static",
        "lissajous",
        "waypoints",
        "recorded",
    }
    asked = [cause for mission in missions for cause in CAUSES if cause in mission["summary"]]
    assert set(asked) == set(CAUSES)
    assert 0.3 < np.mean([mission["summary"].endswith("within") for mission in missions]) < 0.7
    for name in ("safety", "links", "events", "disturbance"):
        assert 0 < sum(name in mission for mission in missions) < 60


@pytest.mark.parametrize(("limit", "failure"), [(2.0, None), (0.5, "velocity limit")])
def test_the_oracle_sees_a_boat_that_falls_behind(limit, failure):
    mission = {
        "name": "chase",
        "time": {"end": 60.0},
        "controller": {"gain": 1.0, "control_period": 0.05, "velocity_limit": limit},
        "agents": [{"id": "B", "position": [0, -5], "vehicle": "wamv"}],
        "targets": [{"id": "T", "position": [0, 0], "motion": {"kind": "waypoints", "points": [[90, 0]], "speed": 1}}],
        "sensing": [["B", "T"]],
        "physics": {"timestep": 0.005},
    }
    found = failure_of_run(mission, mjsheaf.simulate(make_scenario(mission), progress=False))
    assert found is None if failure is None else failure in found and "diverges" in found


@pytest.mark.parametrize(("seed", "ok"), [(70, False), (205, False), (27, False), (187, False), (6, True), (164, True)])
def test_the_trial_tells_missions_that_fail_from_those_that_work(seed, ok):
    """A current too fast for the drone, no room for safety, a loop over links that swings, gusts; and two that work."""
    judged = judge(seed, trial=True)
    assert judged.ok is ok, judged
    assert not judged.contradicted, judged


@pytest.mark.slow
def test_no_mission_that_worked_when_tried_fails():
    judged = study(range(MISSIONS), trial=True)
    assert [str(each) for each in judged if each.contradicted] == []
    _require_few_false_alarms(judged)


@pytest.mark.slow
def test_few_missions_that_are_ok_by_analysis_alone_fail():
    judged = study(range(MISSIONS), trial=False)
    contradicted = [str(each) for each in judged if each.contradicted]
    assert len(contradicted) <= MAX_CONTRADICTED * sum(each.ok for each in judged), contradicted
    _require_few_false_alarms(judged)


def _require_few_false_alarms(judged):
    """Require that `check` calls most missions OK whose runs are fine."""
    fine = [each for each in judged if each.failure is None]
    alarms = [str(each) for each in fine if not each.ok]
    assert len(alarms) <= MAX_FALSE_ALARMS * len(fine), alarms
