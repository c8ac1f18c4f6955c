"""One run of a study, from its point to a record of plain values, and the workers that do many of them.

Workers are processes or threads of this machine, or those of an existing dask cluster.
"""

import asyncio
import logging
import multiprocessing as mp
import os
import signal
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, pairwise
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from queue import SimpleQueue
from textwrap import shorten
from threading import Thread
from typing import Any

import numpy as np
import xarray as xr

from mjsheaf.arguments import require_whole
from mjsheaf.arrays import Array
from mjsheaf.checking.loop.body_loop import ending_of_run
from mjsheaf.checking.theorem.of_run import bound_ahead, bound_of_run, bounds_of_phases
from mjsheaf.compile.remember import remember_last
from mjsheaf.errors import InputError, NotUniqueError
from mjsheaf.loop.session import prepare_run
from mjsheaf.loop.system import System
from mjsheaf.media import varying
from mjsheaf.results.metrics import communication, error_series_of, late_errors, summarize
from mjsheaf.results.store import dataset_bytes, thin
from mjsheaf.runs.simulate import simulate, stream
from mjsheaf.scenario import Scenario
from mjsheaf.section import PER_AGENT_RMS, finite
from mjsheaf.studies.plan import ForeignWorkerError, Job, Point, versions
from mjsheaf.threads import ONE_THREAD, usable_processors

STATUSES = ("finished", "unstable", "refused", "invalid", "failed", "lost")
"""Statuses of a run: completed; blown up; refused, because its harmonic extension is not unique; invalid, because its
point is not a valid scenario; failed with an unexpected error; lost with its worker process."""

_LIGHT = (
    *("disagreement", "tracking_error", "formation_error", "centering_error"),
    *("group_formation_error", "group_centering_error"),
)
"""Variables of a record of errors alone."""
TRAFFIC = "numbers_per_agent_second"
"""Field of a record: numbers that an agent sends per second."""


@dataclass(frozen=True)
class JobResult:
    """Result of a worker for one run.

    Attributes:
        record: Record of the run, a function of the job alone; see `new_record`.
        seconds: Wall time, s.
        dataset: Bytes of result.nc; None if trajectories are not kept or the run did not start.
        page: Bytes of the run's page (see `mjsheaf.page`), or None.
    """

    record: dict[str, Any]
    seconds: float = 0.0
    dataset: bytes | None = None
    page: bytes | None = None


def new_record(point: Point, seed: int | None, status: str, message: str = "", **found: Any) -> dict[str, Any]:
    """Make the record of a run.

    Its fields are run, parameters, seed, status and message; `final` as in summary.json; `late`, the same measures as
    RMS over the second half; `ending`; `settled`, True if that is 'settled'; `bound_ratio` and `late_bound_ratio`, see
    `RunBound`; `numbers_per_agent_second` and `law` as in summary.json. If trajectories are kept, `series` has the
    errors over time: time, s, and each measure, m, at selected samples.
    """
    return {
        "run": point.number,
        "parameters": point.parameters,
        "seed": seed,
        "status": status,
        "message": shorten(message, 600, placeholder=" ..."),
        **dict.fromkeys(("final", "late", "settled", "ending", "bound_ratio", "late_bound_ratio", "series", TRAFFIC)),
        "law": None,
        **found,
    }


def run_job(job: Job) -> JobResult:
    """Simulate a point. An error in it becomes the status and message of its record.

    Raises:
        ForeignWorkerError: This worker has another version of mjsheaf or of a library, or a file has changed.
    """
    for name, here in versions().items():
        if job.versions[name] != here:
            raise ForeignWorkerError(f"a worker has {name} {here}; expected {job.versions[name]}")
    job.require_unchanged()
    begun = time.perf_counter()
    dataset = page = None
    try:
        record, dataset, page = _run(job)
    except Exception as error:  # one bad point must not end the study: the table reports it
        record = failed_record(job, error)
    job.require_unchanged()
    return JobResult(record, time.perf_counter() - begun, dataset, page)


def failed_record(job: Job, error: Exception) -> dict[str, Any]:
    """Return the record of a run that raised an error."""
    told = str(error)
    if isinstance(error, NotUniqueError | InputError):
        status = "refused" if isinstance(error, NotUniqueError) else "invalid"
        if job.plan.law is not None and job.plan.law.label in told:  # an error of the law, not of the point
            status = "failed"
        return new_record(job.point, job.seed, status, told)
    what = "not enough memory" if isinstance(error, MemoryError) else type(error).__name__
    return new_record(job.point, job.seed, "failed", f"{what}: {told}")


def _run(job: Job) -> tuple[dict[str, Any], bytes | None, bytes | None]:
    study = job.plan.study
    scenario = job.load()
    controller = job.plan.law.load(scenario.seed) if job.plan.law else None
    if study.batch:
        phases = prepare_run(scenario, study.backend, study.engine, 1)
        samples = scenario.system.grid.steps + 1
        dataset = next(stream(phases, study.backend, scenario.seed, None, samples, controller, _LIGHT))
    else:
        dataset = simulate(
            scenario, study.backend, engine=study.engine, threads=1, controller=controller, progress=False
        )
    system = scenario.system
    found: dict[str, Any] = {"final": summarize(system.team, dataset), "settled": False, "law": dataset.attrs["law"]}
    if dataset.attrs["status"] == "finished":
        found["late"] = {**late_errors(system.team, dataset), "norm": PER_AGENT_RMS}
        if study.batch:
            found["settled"], ratios = None, _ratios(job, scenario, dataset)
        else:
            ending = ending_of_run(scenario.phases, dataset)
            bound = bound_of_run(scenario.phases, dataset)
            found["ending"], found["settled"] = ending, None if ending is None else ending == "settled"
            ratios = bound.ratio, bound.settled_ratio
        found["bound_ratio"], found["late_bound_ratio"] = map(finite, ratios)
    if study.trajectories:
        few = thin(dataset.sizes["time"], 500)  # samples at most
        found["series"] = error_series_of(system.team, dataset.isel(time=few))
    found[TRAFFIC] = communication(dataset, dataset.sizes["time"], system.grid.period)[TRAFFIC]
    record = new_record(job.point, scenario.seed, dataset.attrs["status"], dataset.attrs["message"], **found)
    if not study.trajectories:
        return record, None, None
    from mjsheaf.page.page import page_of

    bounds = bounds_of_phases(scenario.phases, dataset)
    again = "mjsheaf sweep", "; the study's index.html has the command"
    return record, _bytes_of(dataset), page_of(scenario, scenario.phases, dataset, found, bounds, again=again)


def _ratios(job: Job, scenario: Scenario, dataset: xr.Dataset) -> tuple[float | None, float | None]:
    """Compute the largest |e| over Theorem 1's bound, after the start and over the second half.

    None where there is no bound, for a law in Python, and for runs with events, which have one in each phase.

    The bound is computed once for runs that differ in the agents' disturbances alone: the theorem needs their sizes,
    here rounded up. The components that seeds draw add up to the requested size except for rounding.
    """
    system = scenario.system
    if job.plan.law is not None or len(scenario.phases) > 1:
        return None, None
    N, harmonics = len(system.team.agents), np.zeros_like(system.harmonics)
    harmonics[N:] = system.harmonics[N:]
    if harmonics.shape[1]:
        size = varying.bounds(system.harmonics)[:N]
        harmonics[:N, 0, 0] = np.round(size, 9) + 1e-9 * (size > 0.0)
    bound = _bound_of(job, replace(system, harmonics=harmonics))
    if bound is None or not np.isfinite(bound).any():
        return None, None
    ratio = np.sqrt(np.nansum(dataset["tracking_error"].values ** 2, axis=1)) / bound
    return float(ratio[1:].max()), float(ratio[max(len(ratio) // 2, 1) :].max())


@remember_last(
    lambda job, system: (
        (job.plan.scenario, job.plan.files, [(path, value) for path, value in job.changes.items() if path != "seed"]),
        (system.initial, system.harmonics, system.moving),
        [(edge.tail, edge.head) for edge in (*system.team.communication, *system.team.sensing)],  # a swarm's seed draws
    )
)
def _bound_of(job: Job, system: System) -> Array | None:
    """Theorem 1's bound on |e| at the samples of a job on bodies, shape (T,), m; None without one."""
    return bound_ahead(system)


def _bytes_of(dataset: xr.Dataset) -> bytes:
    """Return the bytes of result.nc once two consecutive writes agree on them.

    HDF5 once laid out a file differently for the same data. Thousands of later writes have not shown the cause. The
    bytes of a study must not depend on such an accident.
    """
    for before, written in pairwise(dataset_bytes(dataset) for _ in range(5)):
        if written == before:
            break
    return written


_CONNECT_S = 10

Work = Callable[[Job], JobResult]


class SchedulerError(InputError):
    """There is no scheduler at the given address, or the connection to it is lost."""


@dataclass(frozen=True)
class Workers:
    """Parallel runner of jobs, created by `local_workers` or `workers_at`.

    Attributes:
        submit: Function that submits a job. The future raises BrokenExecutor if the worker that ran it died.
        ahead: Number of jobs submitted at a time.
    """

    submit: Callable[[Work, Job], Future[JobResult]]
    ahead: int

    def run(self, jobs: Iterable[Job], work: Work = run_job) -> Generator[JobResult]:
        """Run jobs and yield each result when it is available.

        A job whose worker dies gets a record with status 'lost'.

        Raises:
            SchedulerError: The connection to the cluster is lost.
            ForeignWorkerError: A worker has another version of mjsheaf or of a library.
        """
        waiting = iter(jobs)
        asked: dict[Future[JobResult], Job] = {}
        ended: list[tuple[Future[JobResult], Job]] = []
        while True:
            for job in islice(waiting, self.ahead - len(asked)):  # before results are used, so that no worker waits
                asked[self.submit(work, job)] = job
            for future, job in ended:
                try:
                    result = future.result()
                except BrokenExecutor:
                    message = "its worker died, perhaps for lack of memory; fewer --workers leave more to each"
                    result = JobResult(new_record(job.point, job.seed, "lost", message))
                except (ForeignWorkerError, SchedulerError):
                    raise
                except Exception as error:  # raised outside the run, for example because its result cannot be pickled
                    result = JobResult(failed_record(job, error))
                yield result
            if not asked:
                return
            ended = [(future, asked.pop(future)) for future in wait(asked, return_when=FIRST_COMPLETED).done]


class _Processes:
    """Processes with one BLAS thread each, in pools of one, so that one that dies takes no other's run with it."""

    def __init__(self, count: int) -> None:
        self._spawn = mp.get_context("spawn")
        self._ends, self._end = self._spawn.Pipe(duplex=False)
        self._pools = [self._make() for _ in range(count)]
        self._free: SimpleQueue[int] = SimpleQueue()
        for k in range(count):
            self._free.put(k)

    def _make(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, self._spawn, initializer=_end_with, initargs=(self._ends,))

    def submit(self, work: Work, job: Job) -> Future[JobResult]:
        """Submit a job to a process that has none, when there is one."""
        k = self._free.get()
        with _spawning():
            try:
                future = self._pools[k].submit(work, job)
            except BrokenExecutor:  # its process died during an earlier job
                self._pools[k] = self._make()
                future = self._pools[k].submit(work, job)
        future.add_done_callback(lambda _: self._free.put(k))
        return future

    def shutdown(self, **options: bool) -> None:
        """End the processes at once; options are those of an executor."""
        self._end.close()
        for pool in self._pools:
            pool.shutdown(**options)


# glibc would hand a run's 30 MB back and get them anew, zeroed page by page, for the next: a seventh of a light run.
_ROOM = {
    "MALLOC_MMAP_THRESHOLD_": str(2**25),  # bytes, the largest that glibc takes
    "MALLOC_TRIM_THRESHOLD_": str(2**30),
}


@contextmanager
def _spawning() -> Iterator[None]:
    """Give processes that start in the block one BLAS thread and room for the next run, and block SIGINT in them.

    A terminal sends Ctrl-C to the command and to all its workers, but only the command can stop them cleanly.
    """
    resource_tracker.ensure_running()  # before SIGINT is blocked, as starting the tracker unblocks it
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    given = {**_ROOM, **os.environ, **dict.fromkeys(ONE_THREAD, "1")}  # the user's own thresholds stay
    before = {name: os.environ.get(name) for name in (*_ROOM, *ONE_THREAD)}
    os.environ.update({name: given[name] for name in before})
    try:
        yield
    finally:
        for name, value in before.items():
            del os.environ[name]
            os.environ.update({} if value is None else {name: value})
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _end_with(ends: Connection) -> None:
    """End this process when the other end of a connection is closed, or the process that has it ends."""

    def watch() -> None:
        ends.poll(None)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def local_workers(count: int | None = None, *, processes: bool = True) -> Iterator[Workers]:
    """Start workers on this machine.

    Args:
        count: Number of workers; None starts one for each processor that this process may use.
        processes: True for a process per worker. False for threads of this process: they start at once, but a crash
            ends all of them.
    """
    if count is not None:
        require_whole("workers", count, 1)
    count = count or usable_processors()
    pool = _Processes(count) if processes else ThreadPoolExecutor(count)
    try:
        yield Workers(pool.submit, count)
    finally:
        pool.shutdown(wait=processes, cancel_futures=True)


@contextmanager
def workers_at(address: str, note: Callable[[str], None] | None = None) -> Iterator[Workers]:
    """Connect to an existing dask cluster. Its workers need the same version of mjsheaf.

    This process prints nothing of dask's log from then on.

    Args:
        address: Address of the scheduler, such as tcp://10.0.0.1:8786.
        note: Function called with a sentence if the cluster has no worker yet; runs wait for the first.

    Raises:
        SchedulerError: There is no scheduler at the address.
        InputError: dask is not installed.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler needs dask, which is not installed: pip install 'mjsheaf[cluster]'") from None

    for handler in logging.getLogger("distributed").handlers:
        handler.setLevel(logging.CRITICAL + 1)  # the exception below says the same in one line
    try:
        asyncio.run(_meet(address))  # first, because a client without a scheduler prints a traceback
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise SchedulerError(
            f"--scheduler {address}: no scheduler answers: {' '.join(str(error).split())}; expected an address such "
            "as tcp://HOST:8786"
        ) from None

    def submit(work: Work, job: Job) -> Future[JobResult]:
        future: Future[JobResult] = Future()
        # pure=False gives jobs random keys: two studies on one scheduler must not share results.
        client.submit(work, job, pure=False).add_done_callback(partial(_answer, future))
        return future

    with client:
        workers = sum(client.nthreads().values())
        if note and not workers:
            note(f"no worker yet at {address}; waiting")
        # A minimum, as workers may join; more would only fill the scheduler's memory.
        yield Workers(submit, max(64, 4 * workers))


def _answer(future: Future[JobResult], done: Any) -> None:
    """Complete a future from dask's, with the exceptions that `Workers` expects of an executor."""
    from distributed import KilledWorker

    try:
        future.set_result(done.result())
    except KilledWorker:
        future.set_exception(BrokenExecutor())
    except BaseException as error:
        gone = SchedulerError("lost the connection to the scheduler; runs that have ended are kept")
        future.set_exception(error if done.status == "error" else gone)


async def _meet(address: str) -> None:
    """Require that a scheduler answers.

    Raises:
        OSError, ValueError, TypeError: There is none.
    """
    from distributed import rpc

    async with rpc(address, timeout=_CONNECT_S) as there:
        who = await asyncio.wait_for(there.identity(), _CONNECT_S)
    if who["type"] != "Scheduler":
        raise ValueError(f"it is a {who['type']}")
