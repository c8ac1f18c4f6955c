"""Signals at random moments of every command leave complete files and nothing else.

Files left by SIGKILL are hidden, distinct from those of a running command, and removed by the next command there.
Oracles: the contract on directories and exit codes; every file of a directory read to its end.
"""

import collections
import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path

import imageio_ffmpeg
import pytest
import xarray as xr
from PIL import Image

from mjsheaf import files as whole
from mjsheaf.files import whole_directory, whole_file, write_whole
from mjsheaf.results.store import FILES, open_run
from tests.builders import REPOSITORY
from tests.commands import CAN_DRAW, IDEAL, SMALL, answer_of, leftovers, one_line, python, start

CODES = {"SIGKILL": -9, "SIGTERM": 143, "SIGHUP": 129, "SIGINT": 130, "SIGINT twice": 130}


def abandoned(path: Path, directory: bool = True) -> Path:
    """Files that a killed command leaves."""
    part = path.with_name(f".{path.name}.abcd_123.part")
    if directory:
        part.mkdir()
        (part / "result.nc").write_text("half")
    else:
        part.write_text("half")
    return part


@pytest.mark.slow(first=True)
@pytest.mark.usefixtures("without_plots")
def test_the_next_command_removes_what_a_killed_one_left(tmp_path: Path) -> None:
    out = tmp_path / "out"
    stale = abandoned(out)
    other = [abandoned(tmp_path / "outer"), abandoned(tmp_path / "out.b"), tmp_path / ".out.mine.part"]
    other[-1].mkdir()
    assert answer_of("run", "midpoint", *IDEAL, "--out", out).code == 0
    assert not stale.exists()
    assert all(path.exists() for path in other)
    for name in ("video.mp4", "summary.json"):  # of a killed `video`: they are ours, and the run can be replaced
        abandoned(out / name, directory=False)
    assert answer_of("run", "midpoint", *IDEAL, "--out", out).code == 0
    assert {path.name for path in out.iterdir()} <= set(FILES)


def test_what_another_command_is_writing_is_left_alone(tmp_path: Path) -> None:
    with whole_directory(tmp_path / "a") as one, whole_file(tmp_path / "b") as two:
        with whole_directory(tmp_path / "a") as other, whole_file(tmp_path / "b"):
            assert one.is_dir()
            assert two.is_file()
            (other / "x").touch()
        (one / "y").touch()
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["a", "b", "y"]


@pytest.mark.parametrize("exchange", [True, False])
def test_a_directory_is_replaced_in_one_step_or_put_back(
    exchange: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "a"
    if not exchange:
        monkeypatch.setattr(whole, "_exchange", lambda one, other: False)
    for word in ("first", "second"):
        with whole_directory(place) as fresh:
            (fresh / word).touch()
        assert [p.name for p in tmp_path.rglob("*")] == ["a", word]
    place.rename(tmp_path / ".a.abcd_123.old")  # killed between two renames
    write_whole(place.with_name("other"), b"")
    assert not place.exists()
    whole.remove_stale(place)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["a", "other", "second"]


OBEYING = """
import os, signal, sys, time
from mjsheaf.cli import tools, main
def work(what):
    try:
        os.kill(os.getpid(), {first})
        time.sleep(60)
    finally:
        for _ in range(20):
            os.kill(os.getpid(), {second})
        print("cleaned")
tools.schema_of = work
main(["schema"])
"""


@pytest.mark.parametrize(
    ("first", "second", "code", "word"),
    [
        ("SIGINT", "SIGINT", 130, "interrupted"),
        ("SIGTERM", "SIGINT", 143, "terminated"),
        ("SIGHUP", "SIGTERM", 129, "hung up"),
    ],
)
def test_signals_while_one_is_obeyed_change_nothing(first: str, second: str, code: int, word: str) -> None:
    numbers = {"first": int(signal.Signals[first]), "second": int(signal.Signals[second])}
    done = python(OBEYING.format(**numbers))
    assert (done.returncode, done.stdout) == (code, "cleaned\n")
    assert one_line(done.stderr, word)


class Attack:
    """A directory with a run, a scenario of our own, and commands that are to be killed in it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.run = folder, folder / "run"
        self.scenario = folder / "mine.yaml"
        shutil.copy(REPOSITORY / "scenarios" / "midpoint.yaml", self.scenario)
        small = ["midpoint", "--set", "time.end=1", *SMALL]
        assert answer_of("run", *small, "--out", self.run).code == 0
        self.commands: dict[str, list[str | Path]] = {
            "run": ["run", *small, "--out", folder / "out"],
            "run again": ["run", *small, "--out", self.run],
            "compare": ["compare", *small, "--out", folder / "out"],
            "check": ["check", "midpoint", "--no-trial", "--plot", folder / "check.png"],
            "expect": ["expect", self.scenario, "--update", "--margin", "0.07"],
            "sweep": ["sweep", "midpoint", "--backend", "ideal", "--set", "time.end=1", "--workers", "1", "--out",
                      folder / "study", "--grid", "controller.gain=1,2,3"],
        }  # fmt: skip
        if CAN_DRAW:
            self.commands["video"] = ["video", self.run, "--out", folder / "video.mp4", "--fps", "20"]
            self.commands["video in place"] = ["video", self.run, "--fps", "20"]

    def start(self, kind: str) -> "subprocess.Popen[str]":
        return start(*self.commands[kind], cwd=self.folder, start_new_session=True)

    def check(self) -> None:
        """Read all that is there to its end."""
        assert "sensing" in self.scenario.read_text()
        for path in self.folder.rglob("[!.]*"):
            if path.suffix == ".json":
                json.loads(path.read_bytes())
            elif path.suffix == ".png":
                Image.open(path).load()
            elif path.suffix == ".mp4":
                assert imageio_ffmpeg.count_frames_and_secs(str(path))[0] > 0
        for directory in filter(Path.exists, (self.run, self.folder / "out")):
            names = {path.name for path in directory.iterdir() if not path.name.startswith(".")}
            if "compare.json" in names:
                assert {"scenario.yaml", "report.txt", "errors.png", "budget.png", "convergence.png"} <= names
            else:
                with open_run(directory) as (dataset, summary):
                    assert isinstance(dataset.load(), xr.Dataset)
                assert names == set(FILES) - (set() if summary["video"] else {"video.mp4"})


@pytest.mark.long
@pytest.mark.skipif("MJSHEAF_ATTACKS" not in os.environ, reason="no two runs of it are alike: MJSHEAF_ATTACKS=40")
def test_random_signals_at_random_moments(tmp_path: Path) -> None:
    """Signals at random moments; failures found this way are tests above, at fixed moments."""
    attack, choose = Attack(tmp_path), random.Random(int(os.environ.get("MJSHEAF_ATTACK_SEED", "1")))
    lasting: dict[str, float] = {}
    for kind in attack.commands:
        begun = time.monotonic()
        assert attack.start(kind).wait() in (0, 1, 3), kind
        lasting[kind] = time.monotonic() - begun
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        shutil.rmtree(tmp_path / "study", ignore_errors=True)
    tried: collections.Counter[tuple[str, str]] = collections.Counter()
    for _ in range(int(os.environ["MJSHEAF_ATTACKS"])):
        kind, how = choose.choice(list(attack.commands)), choose.choice(list(CODES))
        process = attack.start(kind)
        time.sleep(choose.random() * lasting[kind])
        send = os.killpg if choose.random() < 0.5 else os.kill
        with contextlib.suppress(ProcessLookupError):
            for _ in range(2 if how.endswith("twice") else 1):
                send(process.pid, signal.Signals[how.split()[0]])
                time.sleep(choose.choice([0.0, 0.001, 0.03]))
        _, error = process.communicate(timeout=120)
        tried[kind, how] += 1
        said = (kind, how, process.returncode, error[-1000:])
        early = -int(signal.Signals[how.split()[0]])  # before Python listens, the system ends it
        assert process.returncode in (CODES[how], early, 0), said
        if process.returncode == CODES[how] and how != "SIGKILL":
            assert error.count("\n") == 1, said
        if how == "SIGKILL":  # the next command, or this, removes what it leaves
            for name in ("out", "run", "mine.yaml", "check.png", "video.mp4", *(f"run/{name}" for name in FILES)):
                whole.remove_stale(tmp_path / name)
        assert leftovers(tmp_path) + leftovers(attack.run) == [], said
        attack.check()
        if choose.random() < 0.5:
            shutil.rmtree(tmp_path / "out", ignore_errors=True)
            shutil.rmtree(tmp_path / "study", ignore_errors=True)
    print(dict(tried))
