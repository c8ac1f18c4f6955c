"""Runs of a study as worlds of a batch, side by side on a card."""

import pickle
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from typing import Any, Literal

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.checking.finished import bound_ahead
from mjsheaf.control.terms import traffic_of
from mjsheaf.dynamics.disturbance import bounds
from mjsheaf.errors import InputError, MjsheafError
from mjsheaf.results.metrics import MEASURES
from mjsheaf.runs.simulate import moved_by, require_simulable
from mjsheaf.simulation.batch import Batch, Outcome
from mjsheaf.studies.engine import Engine, Work
from mjsheaf.studies.job import TRAFFIC, Job, JobResult, failed_record, new_record, run_job
from mjsheaf.system import Phase, System

_MOST_WORLDS = 8192  # of a batch


class BatchEngine(Engine):
    """Runs jobs together; a record is what the run's scores say.

    Of a run only what its batch scores is known: the team's tracking error and disagreement at the end and over the
    last half, and the ratio to Theorem 1's bound. How it ended is not judged, which takes the whole run.

    Args:
        run: runs all worlds of a batch to their end.
        order: how batches are laid out for that.
    """

    def __init__(self, run: Callable[[Batch], None], order: Literal["C", "F"]) -> None:
        self._run, self._order = run, order

    def run(self, jobs: Iterable[Job], work: Work = run_job) -> Iterator[JobResult]:
        """Do jobs and yield the result of each; `work` is not called."""
        waiting = iter(jobs)
        while several := list(islice(waiting, _MOST_WORLDS)):
            alike = dict[bytes, list[Job]]()
            for job in several:
                alike.setdefault(pickle.dumps((job.scenario, _of_team(job))), []).append(job)
            for group in alike.values():
                yield from self._together(group)

    def _together(self, jobs: list[Job]) -> Iterator[JobResult]:
        """The results of jobs that look like one team; of those that are none, one by one."""
        begun, known = time.perf_counter(), list[tuple[Job, System, int]]()
        for job in jobs:
            try:
                scenario = job.load()
                phases = moved_by(scenario.phases, "physics", "fused", 1)
                require_simulable(phases, "physics")
                known.append((job, _without_events(phases), scenario.seed))
            except MjsheafError as error:
                yield JobResult(failed_record(job, error))
        if not known:
            return
        systems = [system for _, system, _ in known]
        try:
            worlds = systems if len(systems) > 1 else 2 * systems  # one alone has another layout, and other code
            batch = Batch(worlds, _bounds_of(worlds), order=self._order)
        except InputError as error:
            if len(known) == 1:
                yield JobResult(failed_record(known[0][0], error))
            else:
                for job, _, _ in known:
                    yield from self._together([job])
            return
        self._run(batch)
        seconds = (time.perf_counter() - begun) / len(known)
        for (job, system, seed), outcome in zip(known, batch.outcomes(), strict=False):
            yield JobResult(_record_of(job, system, seed, outcome), seconds)


@contextmanager
def card_engine() -> Iterator[Engine]:
    """The card of this machine."""
    from mjsheaf.simulation.card import run_on_card

    yield BatchEngine(run_on_card, "F")


def _of_team(job: Job) -> list[tuple[str, Any]]:
    """What a job changes of its scenario that worlds of a batch share."""
    return [(path, value) for path, value in job.changes.items() if path not in ("seed", "controller.gain")]


def _without_events(phases: Sequence[Phase]) -> System:
    """The only system of a run.

    Raises:
        InputError: it has events.
    """
    if len(phases) > 1:
        raise InputError(f"events: {phases[1].name}; expected none on device gpu, where runs keep their edges")
    return phases[0].system


def _bounds_of(systems: list[System]) -> list[Array]:
    """Theorem 1's bound for each run, computed once for runs that differ in the agents' disturbances alone."""
    found, alike = list[Array](), dict[bytes, Array]()
    for system in systems:
        usual = _rounded_up(system)
        key = pickle.dumps((usual.initial, usual.gain, usual.harmonics))
        if key not in alike:
            bound = bound_ahead(usual)
            alike[key] = np.full(system.grid.steps + 1, np.inf) if bound is None else bound
        found.append(alike[key])
    return found


def _rounded_up(system: System) -> System:
    """The system with disturbances of the agents of which only the size is kept, rounded up: the theorem asks no more.

    Seeds draw directions and shares whose sum is the bound asked for but for rounding, which would make each bound
    another; and what a record says must not depend on the runs beside it.
    """
    N, harmonics = len(system.team.agents), np.zeros_like(system.harmonics)
    harmonics[N:] = system.harmonics[N:]
    if harmonics.shape[1]:
        size = bounds(system.harmonics[:N])
        harmonics[:N, 0, 0] = np.round(size, 9) + 1e-9 * (size > 0.0)
    return replace(system, harmonics=harmonics)


def _record_of(job: Job, system: System, seed: int, outcome: Outcome) -> dict[str, Any]:
    """See `job.new_record`."""
    unknown = dict.fromkeys(MEASURES)
    grid, traffic = system.grid, traffic_of(system.law.terms, system.team)
    final: dict[str, Any] = {"time": float(grid.samples[outcome.samples - 1]), **unknown, "groups": {}}
    final |= {"tracking_error": outcome.tracking_error, "mean_disagreement": outcome.mean_disagreement}
    found: dict[str, Any] = {"final": final, "settled": None}
    if not outcome.message:
        late = {"tracking_error": outcome.late_tracking_error, "mean_disagreement": outcome.late_mean_disagreement}
        found["late"] = {**unknown, **late}
        found |= {"bound_ratio": outcome.ratio, "late_bound_ratio": outcome.settled_ratio}
    found[TRAFFIC] = traffic.numbers / (grid.period * len(system.team.agents))
    return new_record(job.point, seed, "unstable" if outcome.message else "finished", outcome.message, **found)
