"""Runs side by side: in processes or threads of this machine, or on a dask cluster that exists."""

import asyncio
import logging
import multiprocessing as mp
import os
import signal
from collections.abc import Callable, Iterable, Iterator
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
"""Times that a run is begun again, with none beside it, after a worker died while it was under way."""

_LEAST_AHEAD = 64
"""Runs that a cluster is given at a time, at least; more only fill the scheduler's memory."""

_TOO_MUCH_MEMORY = 75
"""Exit code of a worker that took more than its share of memory."""

_CONNECT_S = 10

Work = Callable[[Job], JobResult]


class Runner(Protocol):
    """Runs jobs."""

    def run(self, jobs: Iterable[Job]) -> Iterator[JobResult]:
        """Do jobs and yield the result of each as it ends."""


class SchedulerError(InputError):
    """There is no scheduler at the address that was given, or it went away."""


class Workers:
    """Runs jobs side by side; made by `local_workers` or `workers_at`.

    Args:
        submit: hands a job out. Its result raises BrokenExecutor where a worker died.
        ahead: jobs that are handed out at a time.
        cause: what is known of the last death of a worker.
    """

    def __init__(self, submit: Callable[[Work, Job], Future[JobResult]], ahead: int, cause: Callable[[], str]) -> None:
        self._submit, self._ahead, self._cause = submit, ahead, cause

    def run(self, jobs: Iterable[Job], work: Work = run_job) -> Iterator[JobResult]:
        """Do jobs and yield the result of each as it ends.

        Where a worker dies, the jobs that were handed out are begun again, now one at a time. One whose workers die
        then too gets a record of status 'lost'.

        Raises:
            SchedulerError: the cluster went away.
            ForeignWorkerError: a worker has another version of mjsheaf or of a library.
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
                message = f"every worker that began it died, {self._cause()}"
                result = JobResult(new_record(job.point, job.seed, "lost", message))
            yield result

    def _stream(self, jobs: Iterable[Job], work: Work, ahead: int) -> Iterator[tuple[Job, JobResult | None]]:
        """Do jobs, so many of them handed out at a time; None is the result of one whose worker may have died of it."""
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
                except Exception as error:  # raised around the run, as where its result could not travel
                    yield job, JobResult(failed_record(job, error))


class _Processes:
    """A pool of processes, one BLAS thread each, which is made anew after one of them died."""

    def __init__(self, count: int, memory: int) -> None:
        spawn = mp.get_context("spawn")
        self._make = partial(ProcessPoolExecutor, count, spawn, initializer=_watch, initargs=(memory,))
        self._pool = self._make()
        self._workers: set[BaseProcess] = set()

    def submit(self, work: Work, job: Job) -> Future[JobResult]:
        """Hand a job to the pool."""
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
        """End the workers, whatever they do."""
        for process in self._workers:
            process.kill()
        self._pool.shutdown(cancel_futures=True)

    def cause(self) -> str:
        """What a worker of the pool, which ended with it, died of."""
        self._pool.shutdown()
        codes = {process.exitcode for process in self._workers}
        if _TOO_MUCH_MEMORY in codes:
            return "as it took more than its share of memory; fewer --workers leave more to each"
        if -signal.SIGKILL in codes:
            return "killed by signal 9, most likely for want of memory; fewer --workers leave more to each"
        codes -= {0, None, -signal.SIGTERM}  # by which the pool ends the others
        return f"with exit code {codes.pop()}" if codes else "without a word"


@contextmanager
def _spawning() -> Iterator[None]:
    """Processes that begin in the block have one BLAS thread and never get SIGINT.

    A terminal's Ctrl-C goes to the command and to all its workers; the command alone knows how to stop in order.
    """
    resource_tracker.ensure_running()  # which lets the signal through again where it has to start
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
    """Let this worker die with the command, however that ends, or where it takes more memory than this, in bytes."""

    def watch() -> None:
        parent, me = mp.parent_process(), psutil.Process()
        while parent is not None and parent.is_alive():
            if me.memory_info().rss > memory:
                os._exit(_TOO_MUCH_MEMORY)
            parent.join(0.1)  # s between looks at the memory
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def local_workers(count: int | None = None, *, processes: bool = True, memory: int | None = None) -> Iterator[Workers]:
    """Workers of this machine.

    Args:
        count: how many; None takes one for each processor that this process may use.
        processes: each worker a process; else all are threads of this one, which begin at once and share its fate.
        memory: that all processes together may take, in bytes; None takes most of the machine's.
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
    """A cluster that exists, by its scheduler's address, such as tcp://10.0.0.1:8786. Its workers need this mjsheaf.

    From then on this process prints nothing of dask's log.

    Args:
        address: of the scheduler.
        note: told where it has no worker yet; runs wait for the first.

    Raises:
        SchedulerError: nobody answers there.
        InputError: dask is not installed.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler needs dask, which is not installed: pip install 'mjsheaf[cluster]'") from None

    for handler in logging.getLogger("distributed").handlers:
        handler.setLevel(logging.CRITICAL + 1)  # the one line of an exception says what dask's log would
    try:
        asyncio.run(_meet(address))  # first, as a client that nobody answers leaves a traceback behind
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise SchedulerError(
            f"--scheduler {address}: no scheduler answers: {' '.join(str(error).split())}; expected an address as "
            "tcp://HOST:8786"
        ) from None

    def submit(work: Work, job: Job) -> Future[JobResult]:
        future: Future[JobResult] = Future()
        # Two studies on one scheduler must not answer for each other: keys are made up, not derived.
        client.submit(work, job, pure=False).add_done_callback(partial(_answer, future))
        return future

    with client:
        workers = sum(client.nthreads().values())
        if note and not workers:
            note(f"no worker yet at {address}; waiting")
        yield Workers(submit, max(_LEAST_AHEAD, 4 * workers), lambda: "most likely for want of memory")


def _answer(future: Future[JobResult], done: Any) -> None:
    """Settle a future as `Workers` expects it of an executor, by the future of dask that is done."""
    from distributed import KilledWorker

    try:
        future.set_result(done.result())
    except KilledWorker:
        future.set_exception(BrokenExecutor())
    except BaseException as error:
        gone = SchedulerError("the scheduler went away; runs that have ended are kept")
        future.set_exception(error if done.status == "error" else gone)


async def _meet(address: str) -> None:
    """Require that a scheduler answers.

    Raises:
        OSError, ValueError, TypeError: none does.
    """
    from distributed import rpc

    async with rpc(address, timeout=_CONNECT_S) as there:
        who = await asyncio.wait_for(there.identity(), _CONNECT_S)
    if who["type"] != "Scheduler":
        raise ValueError(f"it is a {who['type']}")
