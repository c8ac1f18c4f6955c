"""Parallel runs: processes or threads of this machine, or an existing dask cluster."""

import asyncio
import logging
import multiprocessing as mp
import os
import signal
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from threading import Thread
from typing import Any, Protocol

import psutil

from mjsheaf.arguments import require_whole
from mjsheaf.errors import InputError
from mjsheaf.studies.job import ForeignWorkerError, Job, JobResult, failed_record, new_record, run_job
from mjsheaf.threads import ONE_THREAD, usable_processors

_TRIES_ALONE = 2
"""Number of times that a run is repeated alone after a worker died during it."""

_LEAST_AHEAD = 64
"""Minimum number of runs submitted to a cluster at a time; more would only fill the scheduler's memory."""

_TOO_MUCH_MEMORY = 75
"""Exit code of a worker that exceeded its memory limit."""

_CONNECT_S = 10

Work = Callable[[Job], JobResult]


class Runner(Protocol):
    """Interface for running jobs."""

    def run(self, jobs: Iterable[Job]) -> Generator[JobResult]:
        """Run jobs and yield each result when it is available."""


class SchedulerError(InputError):
    """There is no scheduler at the given address, or the connection to it is lost."""


class Workers:
    """Parallel runner of jobs, created by `local_workers` or `workers_at`.

    Args:
        submit: Function that submits a job. The future raises BrokenExecutor if a worker died.
        ahead: Number of jobs submitted at a time.
        cause: Function that describes why the last worker died.
    """

    def __init__(self, submit: Callable[[Work, Job], Future[JobResult]], ahead: int, cause: Callable[[], str]) -> None:
        self._submit, self._ahead, self._cause = submit, ahead, cause

    def run(self, jobs: Iterable[Job], work: Work = run_job) -> Generator[JobResult]:
        """Run jobs and yield each result when it is available.

        If a worker dies, all jobs that were submitted are repeated one at a time. A job whose workers die again gets a
        record with status 'lost'.

        Raises:
            SchedulerError: The connection to the cluster is lost.
            ForeignWorkerError: A worker has another version of mjsheaf or of a library.
        """
        suspects = []
        for job, result in self._stream(jobs, work, self._ahead):
            if result is None:
                suspects.append(job)
            else:
                yield result
        for job in suspects:
            tries = (result for _ in range(_TRIES_ALONE) for _, result in self._stream([job], work, 1))
            result = next(filter(None, tries), None)
            if result is None:
                message = f"every worker that started it died, {self._cause()}"
                result = JobResult(new_record(job.point, job.seed, "lost", message))
            yield result

    def _stream(self, jobs: Iterable[Job], work: Work, ahead: int) -> Iterator[tuple[Job, JobResult | None]]:
        """Run jobs with at most `ahead` submitted at a time; a result is None if a worker died while the job ran."""
        waiting = iter(jobs)
        asked: dict[Future[JobResult], Job] = {}
        while True:
            for job in islice(waiting, ahead - len(asked)):
                asked[self._submit(work, job)] = job
            if not asked:
                return
            for future in wait(asked, return_when=FIRST_COMPLETED).done:
                job = asked.pop(future)
                try:
                    yield job, future.result()
                except BrokenExecutor:
                    yield job, None
                except (ForeignWorkerError, SchedulerError):
                    raise
                except Exception as error:  # raised outside the run, for example because its result cannot be pickled
                    yield job, JobResult(failed_record(job, error))


class _Processes:
    """A pool of processes with one BLAS thread each, replaced after one of them died."""

    def __init__(self, count: int, memory: int) -> None:
        spawn = mp.get_context("spawn")
        self._make = partial(ProcessPoolExecutor, count, spawn, initializer=_watch, initargs=(memory,))
        self._pool = self._make()
        self._workers: set[BaseProcess] = set()

    def submit(self, work: Work, job: Job) -> Future[JobResult]:
        """Submit a job to the pool."""
        before = set(mp.active_children())
        with _spawning():
            try:
                return self._pool.submit(work, job)
            except BrokenExecutor:
                self._pool.shutdown()
                self._pool, self._workers = self._make(), set()
                return self._pool.submit(work, job)
            finally:
                self._workers |= set(mp.active_children()) - before

    def kill(self) -> None:
        """Kill the workers."""
        for process in self._workers:
            process.kill()
        self._pool.shutdown(cancel_futures=True)

    def cause(self) -> str:
        """Describe why a worker died and broke the pool."""
        self._pool.shutdown()
        codes = {process.exitcode for process in self._workers}
        if _TOO_MUCH_MEMORY in codes:
            return "because it exceeded its memory limit; fewer --workers leave more memory to each"
        if -signal.SIGKILL in codes:
            return "killed by signal 9, probably out of memory; fewer --workers leave more memory to each"
        codes -= {0, None, -signal.SIGTERM}  # the pool ends the other workers with SIGTERM
        return f"with exit code {codes.pop()}" if codes else "for an unknown reason"


@contextmanager
def _spawning() -> Iterator[None]:
    """Give processes that start in the block one BLAS thread, and block SIGINT in them.

    A terminal sends Ctrl-C to the command and to all its workers, but only the command can stop them cleanly.
    """
    resource_tracker.ensure_running()  # before SIGINT is blocked, as starting the tracker unblocks it
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    threads = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in threads.items():
            del os.environ[name]
            os.environ.update({} if value is None else {name: value})
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _watch(memory: int) -> None:
    """Exit this worker when the command ends, for whatever reason, or when it exceeds `memory`, bytes."""

    def watch() -> None:
        parent, me = mp.parent_process(), psutil.Process()
        while parent is not None and parent.is_alive():
            if me.memory_info().rss > memory:
                os._exit(_TOO_MUCH_MEMORY)
            parent.join(0.1)  # s between checks of the memory
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def local_workers(count: int | None = None, *, processes: bool = True, memory: int | None = None) -> Iterator[Workers]:
    """Start workers on this machine.

    Args:
        count: Number of workers; None starts one for each processor that this process may use.
        processes: True for a process per worker. False for threads of this process: they start at once, but a crash
            ends all of them.
        memory: Memory limit of all processes together, bytes; None allows most of the machine's.
    """
    if count is not None:
        require_whole("workers", count, 1)
    count = count or usable_processors()
    if not processes:
        threads = ThreadPoolExecutor(count)
        try:
            yield Workers(threads.submit, count, str)
        finally:
            threads.shutdown(wait=False, cancel_futures=True)
        return
    pool = _Processes(count, int(memory or 0.95 * psutil.virtual_memory().total) // count)
    try:
        yield Workers(pool.submit, count, pool.cause)
    finally:
        pool.kill()


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
        yield Workers(submit, max(_LEAST_AHEAD, 4 * workers), lambda: "probably out of memory")


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
