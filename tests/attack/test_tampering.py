"""Damaged or edited files of a run or a study are refused in one line or computed again; data are never wrong.

Oracles: the contract on errors; the bytes of the intact study.
"""

import json
import os
import random
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.commands import IDEAL, SMALL, all_contents, answer_of, is_refusal, only_errors
from tests.conftest import draw_nothing

Damage = Callable[[bytes, random.Random], bytes]


def truncated(data: bytes, choose: random.Random) -> bytes:
    return data[: choose.randrange(len(data))]


def flipped(data: bytes, choose: random.Random) -> bytes:
    place = choose.randrange(len(data))
    return data[:place] + bytes([data[place] ^ 1 << choose.randrange(8)]) + data[place + 1 :]


def extended(data: bytes, choose: random.Random) -> bytes:
    return data + choose.randbytes(choose.randrange(1, 100))


DAMAGES: list[Damage] = [truncated, flipped, extended]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("tampering") / "run"
    with pytest.MonkeyPatch.context() as without:
        draw_nothing(without)
        assert answer_of("run", "midpoint", *IDEAL, *SMALL, "--out", directory).code == 0
    return directory


@pytest.fixture
def films(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Read all data of the drawing without drawing it."""
    drawn: list[Any] = []

    def read(films: list[Any], path: Path, *_: Any) -> int:
        drawn.extend(film.run.at(film.run.time) for film, _ in films)
        path.write_bytes(b"")
        return 1

    monkeypatch.setattr("mjsheaf.video.draw.draw_video", read)
    monkeypatch.setattr("mjsheaf.video.gl.available_backend", lambda: ("egl", ""))
    return drawn


@pytest.mark.parametrize("name", ["result.nc", "summary.json", pytest.param("scenario.yaml", marks=pytest.mark.slow)])
def test_damaged_file_of_a_run(name: str, run: Path, films: list[Any], tmp_path: Path) -> None:
    choose = random.Random(name)
    for k in range(30):
        directory = tmp_path / str(k)
        shutil.copytree(run, directory)
        file = directory / name
        file.write_bytes(DAMAGES[k % len(DAMAGES)](file.read_bytes(), choose))
        answer = answer_of("video", directory)
        if name == "result.nc":
            assert is_refusal(answer, "result.nc has changed since the run"), k
        else:  # a text may be another and still make sense
            assert answer.code == 0 or (answer.code == 2 and only_errors(answer.err)), (k, answer)


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("name", ["result.nc", "summary.json", "scenario.yaml"])
def test_something_else_in_the_place_of_a_file(name: str, run: Path, films: list[Any], tmp_path: Path) -> None:
    def link(path: Path) -> None:
        path.symlink_to(path)

    def fill(text: bytes, path: Path) -> None:
        path.write_bytes(text)

    makers: list[Callable[[Path], Any]] = [Path.mkdir, os.mkfifo, link, lambda path: path.symlink_to("/dev/zero")]
    makers += [lambda path: None, Path.touch]
    makers += [partial(fill, text) for text in (b"[" * 100_000, b"{}", b"\xff\xfe", b"null")]
    for k, make in enumerate(makers):
        directory = tmp_path / str(k)
        shutil.copytree(run, directory)
        (directory / name).unlink()
        make(directory / name)
        answer = answer_of("video", directory)
        refused = answer.code == 2 and only_errors(answer.err)
        assert refused or (name, k) == ("summary.json", 7), (k, answer)


STUDY = ["sweep", "midpoint", "--backend", "ideal", "--set", "time.end=0.2", "--grid", "controller.gain=1,2,3,4"]
STUDY += ["--trajectories", "--threads", "--workers", "1", "--out"]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("tampering") / "study"
    assert answer_of(*STUDY, directory).code == 0
    return directory


@pytest.mark.long
def test_damaged_study_ends_as_the_one_that_nobody_touched(study: Path, tmp_path: Path) -> None:
    choose, before = random.Random(5), all_contents(study)
    names = [name for name in before if name not in (".lock", "timings.csv", "study.json", "scenario.yaml")]
    for k in range(2):
        directory = tmp_path / str(k)
        shutil.copytree(study, directory)
        for name in names:
            data = (directory / name).read_bytes()
            (directory / name).write_bytes(choose.choice(DAMAGES)(data, choose))
        assert answer_of(*STUDY, directory).code == 0
        after = all_contents(directory)
        assert {n: after[n] for n in names} == {n: before[n] for n in names}


@pytest.mark.long
def test_edited_record_is_run_again(study: Path, tmp_path: Path) -> None:
    directory = tmp_path / "study"
    shutil.copytree(study, directory)
    path = directory / "runs" / "000002.json"
    record = json.loads(path.read_text())
    record["final"]["tracking_error"] = 0.0
    path.write_text(json.dumps(record))
    (directory / "trajectories" / "000003.nc").unlink()
    assert answer_of(*STUDY, directory).code == 0
    times = (directory / "timings.csv").read_text().splitlines()[1:]
    assert sorted(int(line.split(",")[0]) for line in times) == [0, 1, 2, 2, 3, 3]
    assert (directory / "table.csv").read_bytes() == (study / "table.csv").read_bytes()


@pytest.mark.slow(each=True)
@pytest.mark.parametrize("text", [b"", b"{", b"[]", b"null", b"{}", b"\xff", b"[" * 100_000])
def test_damaged_study_file(text: bytes, study: Path, tmp_path: Path) -> None:
    directory = tmp_path / "study"
    shutil.copytree(study, directory)
    (directory / "study.json").write_bytes(text)
    before = all_contents(directory)
    assert is_refusal(answer_of(*STUDY, directory), "is not a study of mjsheaf")
    assert all_contents(directory) == before
