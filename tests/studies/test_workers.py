"""Clusters: the same bits whatever does the runs, workers that die, schedulers by address that come and go."""

import gc
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import psutil
import pytest

from mjsheaf.studies.plan import ForeignWorkerError, Job
from mjsheaf.studies.study import run_study
from mjsheaf.studies.workers import JobResult, SchedulerError, Workers, local_workers, new_record, workers_at
from mjsheaf.threads import ONE_THREAD
from tests.builders import IN_THREADS, LAWS, small_plan
from tests.commands import contents, start, wait_until

ASKED = ["midpoint", "--backend", "ideal", "--set", "time.end=0.5", "--grid", "controller.gain=1.0,3.0"]
ASKED += ["--grid", "spread.position=1.0", "--seeds", "0:5"]
"""10 runs that differ."""


@pytest.mark.long
def test_the_same_bits_whatever_does_the_runs(tmp_path: Path) -> None:
    """One worker and two, processes and threads, in another order too, under a law with a state; but the timings."""
    (tmp_path / "law.py").write_text(LAWS)
    ways: dict[str, Callable[[], AbstractContextManager[Workers]]] = {
        "one thread": IN_THREADS,
        "three threads": partial(local_workers, 3, processes=False),
        "one process": partial(local_workers, 1),
        "two processes": partial(local_workers, 2),
    }
    for controller in (None, f"{tmp_path / 'law.py'}:Stateful"):
        plan = small_plan(seeds=(0, 4), overrides={"spread.position": 1.0}, trajectories=True, controller=controller)
        found = {}
        for name, workers in ways.items():
            out = tmp_path / f"{name}, {controller is None}"
            assert run_study(plan, out, workers).begun == 8
            found[name] = contents(out)
        first = found.pop("one thread")
        assert sum(name.endswith(".nc") for name in first) == 8
        assert len({first[name] for name in first if name.startswith("runs")}) == 8
        for name, other in found.items():
            assert other == first, name


# -- workers ---------------------------------------------------------------------------------------------------------


def dies_of_the_second(job: Job) -> JobResult:
    """Kill this process as the system kills one that takes all memory."""
    if job.point.number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return JobResult(new_record(job.point, 0, "finished"), 0.0)


def records_of(workers: Workers, way: Callable[[Job], JobResult]) -> list[dict[str, Any]]:
    """Return the records of four runs, done in a way, in their order."""
    plan = small_plan()
    return sorted((d.record for d in workers.run(map(plan.job, plan.points), way)), key=itemgetter("run"))


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 3])
def test_a_worker_that_dies_of_a_run_takes_no_other_with_it(workers: int) -> None:
    with local_workers(workers) as cluster:
        found = records_of(cluster, dies_of_the_second)
    assert [record["status"] for record in found] == ["finished", "lost", "finished", "finished"]
    assert found[1]["message"].startswith("its worker died, perhaps for lack of memory; fewer --workers")


def test_an_error_around_a_run_is_recorded() -> None:

    def raises_a_stranger(job: Job) -> JobResult:
        if job.point.number == 1:
            raise LookupError("no such thing\nat all")
        return JobResult(new_record(job.point, 0, "finished"), 0.0)

    with IN_THREADS() as workers:
        found = records_of(workers, raises_a_stranger)
    assert [record["status"] for record in found] == ["finished", "failed", "finished", "finished"]
    assert found[1]["message"] == "LookupError: no such thing at all"


@pytest.mark.parametrize("name", ["mjsheaf", "mujoco", "numpy", "numba"])
def test_a_worker_of_another_version_ends_the_study(name: str) -> None:
    jobs = [small_plan().job(point) for point in small_plan().points]
    jobs = [replace(job, versions={**job.versions, name: "99.0"}) for job in jobs]
    with IN_THREADS() as workers, pytest.raises(ForeignWorkerError, match=rf"a worker has {name} .*; expected 99\.0"):
        list(workers.run(jobs))


@pytest.mark.long
def test_workers_listen_to_nobody() -> None:
    plan = small_plan()
    with local_workers(1) as workers:
        assert next(workers.run(map(plan.job, plan.points))).record["status"] == "finished"
        family = [psutil.Process(), *psutil.Process().children(recursive=True)]
        found = [connection.status for process in family for connection in process.net_connections("inet")]
    assert len(family) > 1
    assert psutil.CONN_LISTEN not in found


def tells_of_itself(job: Job) -> JobResult:
    blocked = signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    alone = {os.environ[name] for name in ONE_THREAD} == {"1"}
    kept, large = os.environ["MALLOC_TRIM_THRESHOLD_"] == "1000", int(os.environ["MALLOC_MMAP_THRESHOLD_"]) > 2**20
    return JobResult(new_record(job.point, 0, "finished", f"{os.getpid()} {blocked and alone and kept and large}"))


@pytest.mark.long
def test_workers_have_one_thread_and_end_with_what_began_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """And with a command that is killed: see `test_killed_ten_times`. Ctrl-C is for the command alone.

    Thresholds of the user's for memory are kept.
    """
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "1000")
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("MALLOC_MMAP_THRESHOLD_", raising=False)
    plan, before = small_plan(), dict(os.environ)
    with local_workers(2) as workers:
        told = [d.record["message"].split() for d in workers.run(map(plan.job, plan.points), tells_of_itself)]
    assert {well for _, well in told} == {"True"}
    assert not any(psutil.pid_exists(int(pid)) for pid, _ in told)
    assert dict(os.environ) == before


# -- a scheduler that exists -----------------------------------------------------------------------------------------


@contextmanager
def cluster(folder: Path, workers: int = 1) -> Iterator[tuple[str, list["subprocess.Popen[bytes]"]]]:
    """A scheduler and workers in processes of their own, as a person starts them by hand: address and processes."""
    file = folder / "scheduler.json"
    scheduler = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-show"]
    worker = ["distributed.cli.dask_worker", "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    lines = [[*scheduler, "--dashboard-address", "127.0.0.1:0"], *(worker for _ in range(workers))]
    processes = [
        subprocess.Popen([sys.executable, "-m", *line, "--scheduler-file", str(file)], **quiet)  # type: ignore[call-overload]
        for line in lines
    ]
    try:
        wait_until(lambda: file.exists() and file.read_text())
        yield json.loads(file.read_text())["address"], processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.long
@pytest.mark.filterwarnings("error")  # for incomplete objects that warn when they are collected
def test_nobody_at_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjsheaf.studies.workers._CONNECT_S", 1)
    for address in ("tcp://127.0.0.1:9", "nonsense://x", "nonsense", "127.0.0.1", "tcp://nowhere.invalid:8786", ""):
        with pytest.raises(SchedulerError, match=f"--scheduler {address}: no scheduler answers"), workers_at(address):
            pass
        gc.collect()


@pytest.mark.long
def test_a_scheduler_by_address_is_used_and_waited_on_until_it_has_workers(tmp_path: Path) -> None:
    with cluster(tmp_path, workers=0) as (address, processes):
        running = start("sweep", *ASKED, "--scheduler", address, "--out", tmp_path / "out")
        assert running.stderr is not None
        assert running.stderr.readline() == f"note: no worker yet at {address}; waiting\n"
        line = ["distributed.cli.dask_worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard"]
        quiet = subprocess.DEVNULL
        processes.append(subprocess.Popen([sys.executable, "-m", *line], stdout=quiet, stderr=quiet, cwd=tmp_path))
        told, errors = running.communicate(timeout=90)
    assert running.returncode == 0, errors
    assert "10 runs: 10 finished" in told
    run_study(small_plan(seeds=(0, 5), overrides={"spread.position": 1.0}), tmp_path / "here", IN_THREADS)
    there, here = (
        [json.loads(data)["final"] for data in contents(tmp_path / name / "runs").values()] for name in ("out", "here")
    )
    assert there == here != []


@pytest.mark.long
def test_a_scheduler_that_dies_ends_the_command_in_order(tmp_path: Path) -> None:
    slow = ["midpoint", "--backend", "ideal", "--set", "time.end=20", "--grid", "controller.gain=1.0,3.0"]
    slow += ["--seeds", "0:30", "--out", str(tmp_path / "out")]
    with cluster(tmp_path) as (address, processes):
        running = start("sweep", *slow, "--scheduler", address)
        wait_until(lambda: list((tmp_path / "out").glob("runs/*.json")), running=running)
        processes[0].kill()
        _, errors = running.communicate(timeout=90)
    assert running.returncode == 2, errors
    assert "lost the connection to the scheduler; runs that have ended are kept" in errors
    assert "Traceback" not in errors
    kept = contents(tmp_path / "out")
    assert any(name.startswith("runs") for name in kept)
