"""A disk that is full: one line, exit code 2, nothing half written, nothing left; what was there before stays.

A limit on the size of files stands for it where a real one, a small tmpfs, cannot be mounted.
Oracles: the contract; the same command on a disk with room.
"""

import errno
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from mjsheaf.results.store import dataset_bytes, write_dataset
from tests.attack.test_tampering import STUDY
from tests.commands import (
    CAN_DRAW,
    IDEAL,
    SMALL,
    all_contents,
    answer_of,
    command_line,
    contents,
    files_of_at_most,
    is_refusal,
    leftovers,
)
from tests.oracles.full_disk import small_disk

FILMED = ("midpoint", "--set", "time.end=0.2", *SMALL)


def piece(samples: int, begin: int = 0) -> xr.Dataset:
    values = np.random.default_rng(begin).normal(size=(samples, 50))
    return xr.Dataset(
        {"x": (("time", "agent"), values)},
        {"time": ("time", begin + np.arange(samples, dtype=float))},
        {"status": "finished", "message": ""},
    )


@pytest.mark.parametrize("size", [0, 1, 96, 1000, 4096, 20_000, 100_000, 500_000])
def test_result_is_refused_by_an_error_and_not_by_a_crash(size: int, tmp_path: Path) -> None:
    pieces = [piece(400, 400 * k) for k in range(4)]  # 160 kB each
    with files_of_at_most(size), pytest.raises(OSError, match="File too large") as raised:
        write_dataset(pieces, tmp_path / "a.nc")
    assert raised.value.errno == errno.EFBIG
    assert raised.value.filename == str(tmp_path / "a.nc")
    write_dataset(pieces, tmp_path / "a.nc")
    with xr.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as found:
        xr.testing.assert_identical(found.load(), xr.concat(pieces, "time", combine_attrs="override"))


def test_bytes_in_memory_are_those_on_disk(tmp_path: Path) -> None:
    write_dataset([piece(100)], tmp_path / "a.nc")
    assert dataset_bytes(piece(100)) == (tmp_path / "a.nc").read_bytes()


@pytest.mark.parametrize("kilobytes", [2, *(pytest.param(k, marks=pytest.mark.slow) for k in (0, 20, 60))])
def test_run_leaves_nothing(kilobytes: int, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if kilobytes == 2:  # result.nc is larger, and it is written before plots
        request.getfixturevalue("without_plots")
    run = ("run", "midpoint", *IDEAL, "--out", tmp_path / "a" / "out")
    assert answer_of(*run).code == 0  # compiles, which writes files too
    shutil.rmtree(tmp_path / "a")
    with files_of_at_most(1000 * kilobytes):
        assert is_refusal(answer_of(*run), "out: cannot be written: File too large")
    assert list(tmp_path.iterdir()) == []
    assert answer_of(*run).code == 0
    before = all_contents(tmp_path)
    with files_of_at_most(1000 * kilobytes):
        assert is_refusal(answer_of(*run), "File too large")
    assert all_contents(tmp_path) == before


@pytest.mark.long
@pytest.mark.skipif(not CAN_DRAW, reason="no offscreen OpenGL")
def test_video_keeps_the_one_that_was_there(tmp_path: Path) -> None:
    assert answer_of("run", "midpoint", *IDEAL, *SMALL, "--video", "--out", tmp_path / "run").code == 0
    before = all_contents(tmp_path)
    for out in ((), ("--out", tmp_path / "new.mp4")):
        with files_of_at_most(3000):
            assert is_refusal(answer_of("video", tmp_path / "run", *out), "cannot be written: File too large")
        assert all_contents(tmp_path) == before


@pytest.mark.long
def test_a_study_goes_on(tmp_path: Path) -> None:
    assert answer_of(*STUDY, tmp_path / "whole").code == 0
    for k, size in enumerate((0, 20_000, 60_000)):
        out = tmp_path / str(k)
        with files_of_at_most(size):
            answer = answer_of(*STUDY, out)
        assert is_refusal(answer, "cannot be written: File too large"), answer
        assert answer_of(*STUDY, out).code == 0
        assert contents(out) == contents(tmp_path / "whole")


@pytest.mark.long
def test_the_interpreter_survives(tmp_path: Path) -> None:
    """The crash came when it ended: only a process of its own shows it."""
    command = command_line("run", "paper", "--backend", "ideal", "--no-video", "--out", "small")
    with files_of_at_most(500_000):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "mjsheaf: small: cannot be written: File too large\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("command", "place", "sizes"),
    [
        (("run", *FILMED, "--out"), "out", (8, 40, 80, 120, 160, 200)),
        (("compare", *FILMED, "--out"), "out", (8, 80, 160)),
        (("check", "midpoint", "--no-trial", "--plot"), "a.png", (8, 40)),
    ],
)
def test_a_disk_that_is_really_full(command: tuple[str, ...], place: str, sizes: tuple[int], tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "8k") as disk:
        for size in sizes:
            disk.remount(f"size={size}k")
            answer = answer_of(*command, disk.path / place)
            assert is_refusal(answer, "cannot be written: No space left on device"), (size, answer)
            assert list(disk.path.iterdir()) == []
        disk.remount("size=4000k")
        assert answer_of(*command, disk.path / place).code in (0, 3)
        assert leftovers(disk.path) == []


@pytest.mark.long
def test_plot_of_a_check_leaves_nothing(tmp_path: Path) -> None:
    assert answer_of("check", "midpoint", "--no-trial").code == 0  # compiles, which writes files too
    with files_of_at_most(10_000):
        assert is_refusal(
            answer_of("check", "midpoint", "--no-trial", "--plot", tmp_path / "a.png"),
            "a.png: cannot be written: File too",
        )
    assert list(tmp_path.iterdir()) == []
