"""Runs of a study as worlds of a batch, in parallel on threads or on a GPU."""

import pickle
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import replace
from itertools import islice, takewhile
from threading import Event
from typing import Any, Literal, NamedTuple

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.checking.finished import bound_ahead
from mjsheaf.control.terms import traffic_of
from mjsheaf.io.norms import PER_AGENT_RMS
from mjsheaf.io.section import finite
from mjsheaf.media import disturbance
from mjsheaf.results.dataset import law_of
from mjsheaf.results.metrics import MEASURES
from mjsheaf.runs.many import fused_session
from mjsheaf.simulation.batch import Batch, Outcome, require_world
from mjsheaf.simulation.fused import Fused
from mjsheaf.simulation.rows import groups_of_one_team
from mjsheaf.studies.job import TRAFFIC, Job, JobResult, failed_record, new_record
from mjsheaf.system import System
from mjsheaf.threads import usable_processors

_MOST_ON_CARD, _MOST_ON_THREADS = 8192, 64  # worlds of a batch, which is prepared whole


class Batches:
    """Runner that puts the jobs of one team into batches.

    Records contain only what a batch computes: the team's tracking error and disagreement at the end and over the last
    half, and the ratio to Theorem 1's bound. Their ending is unknown, because that requires all samples of the run.

    Args:
        run: Function that runs a batch and yields the number of each world when it ends.
        order: Memory layout of the batches for `run`.
        most: Maximum number of worlds in a batch.
    """

    def __init__(
        self, run: Callable[[Batch], Generator[int]], order: Literal["C", "F"], most: int = _MOST_ON_THREADS
    ) -> None:
        self._run, self._order, self._most = run, order, most

    def run(self, jobs: Iterable[Job]) -> Generator[JobResult]:
        """Run jobs and yield the result of each.

        While batches run, a thread prepares the next ones: it needs Python, and compiled code does not.

        Raises:
            ForeignWorkerError: A file has changed since the study began.
        """
        waiting, stop = iter(jobs), Event()
        with ThreadPoolExecutor(1) as ahead:
            coming = [ahead.submit(self._prepare, [], stop)]
            try:
                while coming:
                    prepared = coming.pop().result()
                    if several := list(islice(waiting, self._most)):
                        coming.append(ahead.submit(self._prepare, several, stop))
                    yield from prepared.refused
                    for batch, known in prepared.batches:
                        yield from self._simulate(batch, known)
            finally:
                stop.set()

    def _prepare(self, jobs: list[Job], stop: Event) -> "_Prepared":
        """Return the batches of jobs; only those that differ in seed and gain alone may share one."""
        alike = dict[bytes, list[Job]]()
        for job in jobs:
            alike.setdefault(pickle.dumps((job.scenario, _of_team(job))), []).append(job)
        prepared = _Prepared([], [])
        for group in alike.values():
            known = list[tuple[Job, Fused]]()
            group[0].require_unchanged()
            for job in group:
                if stop.is_set():
                    return prepared
                try:
                    _, run = fused_session(job.load())
                    require_world(run)
                    known.append((job, run))
                except Exception as error:  # as in `run_job`, one bad point must not end the study
                    prepared.refused.append(JobResult(failed_record(job, error)))
            group[0].require_unchanged()
            for numbers in groups_of_one_team([run for _, run in known]):
                self._lay_out([known[k] for k in numbers], prepared, stop)
        return prepared

    def _lay_out(self, known: list[tuple[Job, Fused]], prepared: "_Prepared", stop: Event) -> None:
        """Add the batch of runs of one team, unless the study stops."""
        runs = [run for _, run in known]
        try:
            bounds = _bounds_of(runs, stop)
            if stop.is_set():
                return
            batch = Batch(runs, bounds, order=self._order)
        except Exception as error:
            prepared.refused.extend(JobResult(failed_record(job, error)) for job, _ in known)
        else:
            prepared.batches.append((batch, known))

    def _simulate(self, batch: Batch, known: list[tuple[Job, Fused]]) -> Iterator[JobResult]:
        """Run a batch and yield the results of its jobs as they end."""
        left, begun = dict(enumerate(known)), time.perf_counter()
        try:
            with closing(self._run(batch)) as ended:
                for w in ended:
                    job, run = left[w]
                    record = _record_of(job, run.system, batch.outcome(w))
                    del left[w]
                    yield JobResult(record, time.perf_counter() - begun)
                    begun = time.perf_counter()
        except Exception as error:
            yield from (JobResult(failed_record(job, error)) for job, _ in left.values())


class _Prepared(NamedTuple):
    """Results of the jobs that cannot run, and batches of the others."""

    refused: list[JobResult]
    batches: list[tuple[Batch, list[tuple[Job, Fused]]]]


@contextmanager
def on_card() -> Iterator[Batches]:
    """Run batches on this machine's GPU."""
    from mjsheaf.simulation.card import run_on_card

    yield Batches(run_on_card, "F", _MOST_ON_CARD)


@contextmanager
def on_threads(count: int | None = None) -> Iterator[Batches]:
    """Run batches on threads of this process; None starts one for each processor that it may use."""
    threads = count or usable_processors()
    yield Batches(lambda batch: batch.each(threads), "C")


def _of_team(job: Job) -> list[tuple[str, Any]]:
    """Return the overrides of a job that all worlds of a batch must share."""
    return [(path, value) for path, value in job.changes.items() if path not in ("seed", "controller.gain")]


def _bounds_of(runs: list[Fused], stop: Event) -> list[Array]:
    """Compute Theorem 1's bound for each run, once for all runs that differ only in the agents' disturbances.

    Once the study stops, no more bounds are computed.
    """
    found, alike = list[Array](), dict[bytes, Array]()
    for run in takewhile(lambda _: not stop.is_set(), runs):
        usual = _rounded_up(run.system)
        key = pickle.dumps((usual.initial, usual.gain, usual.law.limit, usual.harmonics, usual.moving))
        if key not in alike:
            bound = bound_ahead(usual)
            alike[key] = np.full(run.system.grid.steps + 1, np.inf) if bound is None else bound
        found.append(alike[key])
    return found


def _rounded_up(system: System) -> System:
    """Return the system with the agents' disturbances replaced by their sizes, rounded up; the theorem needs no more.

    What moves in the medium apart from them (tides, waves, gusts) stays as it is, and `bound_ahead` adds it.
    The components that seeds draw add up to the requested bound except for rounding, which would make every bound
    different. The rounding also keeps a record independent of the other runs in its batch.
    """
    N, harmonics = len(system.team.agents), np.zeros_like(system.harmonics)
    harmonics[N:] = system.harmonics[N:]
    if harmonics.shape[1]:
        size = disturbance.bounds(system.harmonics)[:N]
        harmonics[:N, 0, 0] = np.round(size, 9) + 1e-9 * (size > 0.0)
    return replace(system, harmonics=harmonics)


def _record_of(job: Job, system: System, outcome: Outcome) -> dict[str, Any]:
    """Make the record of a run from its scores; see `job.new_record`."""
    unknown = dict.fromkeys(MEASURES)
    grid, traffic = system.grid, traffic_of(system.law.terms, system.team)
    final: dict[str, Any] = {
        "time": float(grid.samples[outcome.samples - 1]),
        **unknown,
        "norm": PER_AGENT_RMS,
        "groups": {},
    }
    final |= {"tracking_error": outcome.tracking_error, "mean_disagreement": outcome.mean_disagreement}
    found: dict[str, Any] = {"final": final, "settled": False if outcome.message else None, "law": law_of(system)}
    if not outcome.message:
        late = {"tracking_error": outcome.late_tracking_error, "mean_disagreement": outcome.late_mean_disagreement}
        found["late"] = {**unknown, **late, "norm": PER_AGENT_RMS}
        for name, ratio in (("bound_ratio", outcome.ratio), ("late_bound_ratio", outcome.settled_ratio)):
            found[name] = finite(ratio)
    found[TRAFFIC] = traffic.numbers / (grid.period * len(system.team.agents))
    return new_record(job.point, system.seed, "unstable" if outcome.message else "finished", outcome.message, **found)
