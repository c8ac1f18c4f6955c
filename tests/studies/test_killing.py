"""A study killed at any moment resumes and ends as if it had not been killed.

Oracle: the same study, undisturbed, byte for byte; and the files of runs that had ended, untouched.
"""

import json
import os
import random
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from mjsheaf.studies.plan import load_plan
from mjsheaf.studies.study import run_study
from tests.builders import IN_THREADS
from tests.commands import contents, start, wait_until

RUNS, KILLS = 48, 10
FIXED: dict[str, Any] = {
    "time.end": 6,
    "links.all.noise": 0.2,
    "events": [{"time": 2, "lose": "A9"}, {"time": 4, "join": "A9"}],
}
GRID: dict[str, list[Any]] = {"links.all.loss": [0, 0.2, 0.5], "links.all.delay": [0, 0.01], "events.0.time": [1, 2]}
ASKED = ["paper", "--backend", "ideal", "--seeds", "0:4"]
ASKED += [word for path, value in FIXED.items() for word in ("--set", f"{path}={json.dumps(value)}")]
ASKED += [word for path, values in GRID.items() for word in ("--grid", f"{path}={','.join(map(str, values))}")]
ASKED += ["--workers", "2"]
"""A study over links and events: random numbers are counted by sample, in any process; events are parameters, too."""


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of the study, undisturbed."""
    directory = tmp_path_factory.mktemp("undisturbed")
    plan = load_plan("paper", grid=GRID, seeds=(0, 4), overrides=FIXED, backend="ideal")
    run_study(plan, directory, IN_THREADS)
    return contents(directory)


def ended(directory: Path) -> dict[str, tuple[int, int]]:
    """Identity and time of the files of runs that have ended."""
    return {p.name: (p.stat().st_ino, p.stat().st_mtime_ns) for p in directory.glob("runs/0*.json")}


def workers_of(process: "subprocess.Popen[str]") -> list[psutil.Process]:
    try:
        children = psutil.Process(process.pid).children(recursive=True)
        return [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    except psutil.Error:
        return []


@pytest.mark.long
def test_killed_ten_times(expected: dict[str, bytes], tmp_path: Path) -> None:
    """Command or worker, by SIGKILL, while it starts, runs or writes its table."""
    out, choose = tmp_path / "out", random.Random(6)
    before: dict[str, tuple[int, int]] = {}
    running = start("sweep", *ASKED, "--out", out)
    kills, early_ends, killed_workers = 0, 0, 0
    while kills < KILLS:
        known = len(ended(out))
        early = choose.random() < 0.3
        if not early:
            wait_until(lambda: len(ended(out)) >= min(known + 1, RUNS) or running.poll() is not None)  # noqa: B023
        time.sleep(choose.random() * (3.0 if early else 0.3))
        if running.poll() is not None:  # it ended before its time came: the last kills are of its end
            assert running.returncode == 0, running.communicate()[1]
            early_ends += 1
            assert early_ends == 1, "the study is too short for this number of kills"
            print(f"  ended with {len(ended(out))} of {RUNS}; begun again from half of them")
            for path in sorted(out.glob("runs/0*.json"))[::2]:
                path.unlink()
                before.pop(path.name, None)
            running = start("sweep", *ASKED, "--out", out)
            continue
        workers = workers_of(running)
        if workers and choose.random() < 0.5:
            what, victim = "worker", choose.choice(workers).pid
        else:
            what, victim = "command", running.pid
        try:
            os.kill(victim, signal.SIGKILL)
        except ProcessLookupError:
            continue
        kills += 1
        killed_workers += what == "worker"
        if what == "command":
            running.communicate()
        now = ended(out)
        print(f"kill {kills:2}: {what:7} with {len(now):2} of {RUNS} ended")
        assert {name: now.get(name) for name in before} == before, "what had ended was run again"
        before = now
        if what == "command":
            running = start("sweep", *ASKED, "--out", out)
    _, errors = running.communicate(timeout=200)
    if running.returncode != 0:
        raise AssertionError(errors)
    now = ended(out)
    assert {name: now.get(name) for name in before} == before
    # Runs of killed workers are lost, no others; repeated, they are what they would have been.
    lost = {p.name for p in out.glob("runs/0*.json") if json.loads(p.read_text())["status"] == "lost"}
    assert len(lost) <= killed_workers
    again = start("sweep", *ASKED, "--out", out, "--retry-failed")
    _, errors = again.communicate(timeout=200)
    assert again.returncode == 0, errors
    assert {name for name, file in ended(out).items() if file != now[name]} == lost
    assert contents(out) == expected


@pytest.mark.long
def test_ctrl_c_keeps_what_has_ended(expected: dict[str, bytes], tmp_path: Path) -> None:
    """As a terminal does it: the signal goes to the command and to its workers."""
    out = tmp_path / "out"
    running = start("sweep", *ASKED, "--out", out, start_new_session=True)
    wait_until(lambda: len(ended(out)) >= 3, running=running)
    workers = workers_of(running)
    os.killpg(running.pid, signal.SIGINT)
    _, errors = running.communicate(timeout=60)
    assert running.returncode == 130
    kept = ended(out)
    (line,) = [line for line in errors.splitlines() if not line.startswith("note")]
    assert line.startswith("mjsheaf: interrupted; ")
    assert f"of {RUNS} runs have ended and are kept in" in line
    assert 3 <= int(line.split()[2]) <= len(kept) < RUNS
    _, alive = psutil.wait_procs(workers, timeout=20)
    assert not alive
    again = start("sweep", *ASKED[:-2], "--threads", "--out", out)
    assert again.wait(timeout=120) == 0, again.communicate()[1]
    assert contents(out) == expected
    now = ended(out)
    assert {name: now[name] for name in kept} == kept
