"""`check` judged by runs on bodies: missions that it calls OK work, and those that work it calls OK.

The slow studies print a table of their missions; see it with `-s`.
"""

from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import pytest

import mjsheaf
from mjsheaf.errors import NotUniqueError, UnstableError
from tests.builders import make_scenario
from tests.missions import failure_of_run, random_mission, unforeseen_error

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


def test_a_mission_is_drawn_from_its_seed():
    assert random_mission(3) == random_mission(3)
    assert random_mission(3) != random_mission(4)
    for seed in range(40):
        assert make_scenario(random_mission(seed)).phases


@pytest.mark.parametrize("seed", [])
def test_no_mission_that_worked_when_tried_fails(seed):
    judged = judge(seed, trial=True)
    assert not judged.contradicted, judged
