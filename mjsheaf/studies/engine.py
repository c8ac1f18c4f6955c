"""Doing runs on a dask cluster: a local one that ends with the command, or one that exists."""

import asyncio
import logging
import os
import re
import signal
from asyncio import CancelledError
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING, Any

from mjsheaf.errors import InputError
from mjsheaf.studies.job import Done, ForeignWorkerError, Job, new_record, run_job, seed_of
from mjsheaf.threads import ONE_THREAD

if TYPE_CHECKING:
    from distributed import Client

_DEATHS = 1
"""Workers of the local cluster that may die under a run and it is just begun again; then it is a suspect."""

_LEAST_WAITING = 64
"""Runs that are handed out at a time, at least; more only fill the scheduler's memory."""

_CONNECT_S = 10


class SchedulerError(InputError):
    """There is no scheduler at the address that was given, or it went away."""


class Engine:
    """Runs jobs on a cluster; made by `local_engine` or `engine_at`.

    Attributes:
        workers: threads of the cluster when it was reached.
    """

    def __init__(self, client: "Client", deaths: "_Deaths | None" = None) -> None:
        self._client, self._deaths = client, deaths
        self.workers = sum(client.nthreads().values())

    def run(self, jobs: Iterable[Job], function: Callable[[Job], Done] = run_job) -> Iterator[Done]:
        """Do jobs side by side and yield what each gives, as it ends.

        A worker that dies is replaced and its run begun again; a run that does so again and again, at last alone,
        is answered with a record of status 'lost'.

        Raises:
            SchedulerError: the cluster went away.
            ForeignWorkerError: a worker has another version of mjsheaf or of a library.
        """
        suspects = []
        for job, done in self._stream(jobs, function, max(_LEAST_WAITING, 4 * self.workers)):
            if done is None:
                suspects.append(job)
            else:
                yield done
        # A worker that dies takes those that wait on it into suspicion. Alone, a run dies of nobody else.
        for job, done in self._stream(suspects, function, 1):
            yield done or self._lost(job)

    def _stream(
        self, jobs: Iterable[Job], function: Callable[[Job], Done], ahead: int
    ) -> Iterator[tuple[Job, Done | None]]:
        """Do jobs, so many of them handed out at a time; None stands for the answer of one whose workers died."""
        from distributed import as_completed

        waiting = iter(jobs)
        asked: dict[Any, Job] = {}

        def submit() -> Any | None:
            job = next(waiting, None)
            if job is None:
                return None
            # Two studies on one scheduler must not answer for each other: keys are made up, not derived.
            future = self._client.submit(function, job, pure=False)
            asked[future.key] = job
            return future

        first = [future for _ in range(ahead) if (future := submit()) is not None]
        completed = as_completed(first, loop=self._client.loop)
        try:
            for future in completed:
                job = asked.pop(future.key)
                done = self._answer(future, job)
                following = submit()
                if following is not None:
                    completed.add(following)
                future.release()
                yield job, done
        finally:
            self._client.cancel(list(completed.futures))

    def _answer(self, future: Any, job: Job) -> Done | None:
        """What a run gave. A worker that dies before it has handed that over loses it: then this waits for it anew."""
        from distributed import KilledWorker

        try:
            answer: Done = future.result()
        except ForeignWorkerError:
            raise
        except KilledWorker:
            return None
        except (Exception, CancelledError) as error:
            if future.status != "error":  # it is not the run's own
                raise SchedulerError("the scheduler went away; runs that have ended are kept") from None
            # Raised around a run, not by it: its answer could not travel, or a worker lacks what the run needs.
            return Done(new_record(job.point, seed_of(job), "failed", f"{type(error).__name__}: {error}"), seconds=0.0)
        return answer

    def _lost(self, job: Job) -> Done:
        cause = self._deaths.cause if self._deaths else "most likely for want of memory"
        message = f"every worker that began it died, {cause}"
        return Done(new_record(job.point, seed_of(job), "lost", message), seconds=0.0)


class _Deaths(logging.Handler):
    """Listens to what a local cluster's nannies say of workers that died."""

    def __init__(self) -> None:
        super().__init__()
        self.cause = "most likely for want of memory"

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        killed = re.search(r"killed by signal (\d+)", text)
        if "memory budget" in text:
            self.cause = "as it took more than its share of memory; fewer --workers leave more to each"
        elif killed and killed[1] == "9":
            self.cause = "killed by signal 9, most likely for want of memory; fewer --workers leave more to each"
        elif killed and killed[1] != "15":  # which follows upon the first
            self.cause = f"killed by signal {killed[1]}"


@contextmanager
def local_engine(workers: int | None = None, *, processes: bool = True) -> Iterator[Engine]:
    """A cluster of this machine, with one BLAS thread a worker, that only this machine can reach.

    Args:
        workers: how many; None takes one for each processor that this process may use.
        processes: each worker a process; else all are threads of this one, which begin at once and share its fate.
    """
    import dask
    from distributed import Client, LocalCluster

    count = workers or len(os.sched_getaffinity(0))
    quiet = {
        "distributed.scheduler.allowed-failures": _DEATHS,
        "distributed.scheduler.worker-saturation": 1.0,  # what waits on a worker would be blamed for its death
        # A worker that holds on to memory after a run would be paused, for ever; one that takes too much is ended.
        **{f"distributed.worker.memory.{measure}": False for measure in ("target", "spill", "pause")},
        "distributed.admin.system-monitor.interval": "10s",
        "distributed.comm.timeouts.connect": "60s",  # of a busy machine
        **{f"distributed.nanny.pre-spawn-environ.{name}": 1 for name in ONE_THREAD},
    }
    deaths = _Deaths()
    with _listening(deaths), dask.config.set(quiet):
        with _interrupts_for_this_thread():
            cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=processes,
                host="127.0.0.1" if processes else None,
                protocol="tcp" if processes else "inproc",
                # A status page cannot be left out, only put where nobody else reaches it.
                scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
                worker_dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
        with cluster, Client(cluster) as client:
            yield Engine(client, deaths)


@contextmanager
def engine_at(address: str, note: Callable[[str], None] | None = None) -> Iterator[Engine]:
    """A cluster that exists, by its scheduler's address, such as tcp://10.0.0.1:8786. Its workers need this mjsheaf.

    Args:
        address: of the scheduler.
        note: told where it has no worker yet; runs wait for the first.

    Raises:
        SchedulerError: nobody answers there.
    """
    from distributed import Client

    with _quiet():
        try:
            asyncio.run(_meet(address))  # first, as a client that nobody answers leaves a traceback behind
            client = Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            reason = " ".join(str(error).split())
            raise SchedulerError(
                f"--scheduler {address}: no scheduler answers: {reason}; expected an address as tcp://HOST:8786"
            ) from None
        with client:
            engine = Engine(client)
            if note and not engine.workers:
                note(f"no worker yet at {address}; waiting")
            yield engine


async def _meet(address: str) -> None:
    """See that a scheduler answers.

    Raises:
        OSError, ValueError, TypeError: none does.
    """
    from distributed import rpc

    async with rpc(address, timeout=_CONNECT_S) as there:
        who = await asyncio.wait_for(there.identity(), _CONNECT_S)
    if who["type"] != "Scheduler":
        raise ValueError(f"it is a {who['type']}")


@contextmanager
def _quiet() -> Iterator[None]:
    """What dask would print is told in one line by the exception that follows."""
    handlers = logging.getLogger("distributed").handlers
    before = [handler.level for handler in handlers]
    for handler in handlers:
        handler.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for handler, level in zip(handlers, before, strict=True):
            handler.setLevel(level)


@contextmanager
def _interrupts_for_this_thread() -> Iterator[None]:
    """Threads that begin in the block, and processes that these begin at any time, do not get SIGINT.

    A terminal's Ctrl-C goes to the command and to all its workers; the command alone knows how to stop in order.
    """
    resource_tracker.ensure_running()  # which, where another thread has to do it, lets the signal through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _listening(handler: logging.Handler) -> Iterator[None]:
    loggers = [logging.getLogger(f"distributed.{name}") for name in ("nanny", "nanny.memory", "worker.memory")]
    before = [(logger.level, logger.propagate) for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
        logger.propagate = False
    try:
        yield
    finally:
        for logger, (level, propagate) in zip(loggers, before, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)
            logger.propagate = propagate
