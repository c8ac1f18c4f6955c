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
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Thread
from typing import Any, Protocol

from mjsheaf.arguments import require_whole
from mjsheaf.errors import InputError
from mjsheaf.studies.job import ForeignWorkerError, Job, JobResult, failed_record, new_record, run_job
from mjsheaf.threads import ONE_THREAD, usable_processors

_LEAST_AHEAD = 64
"""Minimum number of runs submitted to a cluster at a time; more would only fill the scheduler's memory."""

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
        submit: Function that submits a job. The future raises BrokenExecutor if the worker that ran it died.
        ahead: Number of jobs submitted at a time.
    """

    def __init__(self, submit: Callable[[Work, Job], Future[JobResult]], ahead: int) -> None:
        self._submit = submit
        self._ahead = ahead

    def run(self, jobs: Iterable[Job], work: Work = run_job) -> Generator[JobResult]:
        """Run jobs and yield each result when it is available.

        A job whose worker dies gets a record with status 'lost'.

        Raises:
            SchedulerError: The connection to the cluster is lost.
            ForeignWorkerError: A worker has another version of mjsheaf or of a library.
        """
        waiting = iter(jobs)
        asked: dict[Future[JobResult], Job] = {}
        while True:
            for job in islice(waiting, self._ahead - len(asked)):
                asked[self._submit(work, job)] = job
            if not asked:
                return
            for future in wait(asked, return_when=FIRST_COMPLETED).done:
                job = asked.pop(future)
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

    def kill(self) -> None:
        """End the processes at once."""
        self._end.close()
        for pool in self._pools:
            pool.shutdown(cancel_futures=True)


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
    if not processes:
        threads = ThreadPoolExecutor(count)
        try:
            yield Workers(threads.submit, count)
        finally:
            threads.shutdown(wait=False, cancel_futures=True)
        return
    pool = _Processes(count)
    try:
        yield Workers(pool.submit, count)
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
        yield Workers(submit, max(_LEAST_AHEAD, 4 * workers))


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
