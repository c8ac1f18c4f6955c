"""The directory of a study: resumed, refused, held by one command at a time, intact when it cannot be written."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mjsheaf.errors import PlaceError
from mjsheaf.studies.plan import Plan, versions
from mjsheaf.studies.study import BusyError, open_directory, run_study
from mjsheaf.studies.workers import SchedulerError
from tests.builders import IN_THREADS, small_plan
from tests.commands import all_contents, answer_of, contents
from tests.oracles.full_disk import small_disk


def never() -> Any:
    raise AssertionError("a cluster was started though nothing is left to run")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("studies") / "deep" / "finished"
    run_study(small_plan(), directory, IN_THREADS)
    return directory


@pytest.fixture
def study(finished: Path, tmp_path: Path) -> Path:
    return shutil.copytree(finished, tmp_path / "study")


def test_what_is_missing_or_torn_is_run(study: Path) -> None:
    before = contents(study)
    (study / "runs" / "000001.json").unlink()
    (study / "runs" / "000002.json").write_text('{"run": 2, "par')
    (study / "runs" / ".000003.json.abcd_123.part").write_text("half")
    (study / "table.csv").unlink()
    kept = (study / "runs" / "000000.json").stat()
    assert run_study(small_plan(), study, IN_THREADS).begun == 2
    assert contents(study) == before
    after = (study / "runs" / "000000.json").stat()
    assert (after.st_ino, after.st_mtime_ns) == (kept.st_ino, kept.st_mtime_ns)


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (lambda: small_plan(gains=(1.0, 4.0)), r"asked.grid.controller.gain.1 was 3.0, is now 4.0"),
        (lambda: small_plan(seeds=(0, 3)), r"runs was 4, is now 6"),
        (lambda: small_plan(overrides={"time.end": 0.6}), r"asked.set.time.end was 0.5, is now 0.6"),
        (lambda: small_plan(trajectories=True), r"asked.trajectories was False, is now True"),
        (
            lambda: replace(small_plan(), files={"/a/raft.xml": "1f"}),
            r"_files./a/raft.xml was absent, is now '1f'",
        ),
        (lambda: replace(small_plan(), scenario={"name": "x"}), r"scenario.name was 'midpoint', is now 'x'"),
    ],
)
def test_another_study_is_refused_with_the_difference(study: Path, plan: Callable[[], Plan], said: str) -> None:
    before = contents(study)
    with pytest.raises(PlaceError, match=said):
        run_study(plan(), study, never)
    assert contents(study) == before


@pytest.mark.slow
@pytest.mark.parametrize("last", [".lock", "study.json", "scenario.yaml", "runs"])
def test_killed_while_it_begins(finished: Path, tmp_path: Path, last: str) -> None:
    """A study resumes from any state that a killed command may leave, also one of another study."""
    for plan in (small_plan(), small_plan(gains=(1.0, 4.0))):
        out = tmp_path / str(len(list(tmp_path.iterdir())))
        (out / "runs").mkdir(parents=True)
        made = [".lock", "study.json", "scenario.yaml", "runs"]
        for name in made[: made.index(last) + 1]:
            if name != "runs":
                shutil.copy(finished / name, out / name)
        if last != "runs":
            (out / "runs").rmdir()
        (out / ".study.json.abcd_123.part").write_text("half")
        assert run_study(plan, out, IN_THREADS).begun == 4
        assert (contents(out) == contents(finished)) == (plan.study.grid == small_plan().study.grid)


def test_a_person_s_files_beside_a_study_stay(study: Path) -> None:
    for name in (".notes.part", "runs/.notes.part"):
        (study / name).write_text("mine")
    assert run_study(small_plan(), study, never).begun == 0
    assert (study / ".notes.part").exists()
    assert (study / "runs" / ".notes.part").exists()


def test_begun_anew_nothing_of_before_stays(finished: Path, tmp_path: Path) -> None:
    """A trajectory is written before its run's file: a kill between the two leaves it alone."""
    with open_directory(tmp_path / "out", small_plan(gains=(5.0,), trajectories=True)):
        (tmp_path / "out" / "trajectories" / "000001.nc").write_text("stale")
    run_study(small_plan(), tmp_path / "out", IN_THREADS)
    assert contents(tmp_path / "out") == contents(finished)


def test_without_a_scheduler_another_may_be_asked_for(tmp_path: Path) -> None:
    """Nothing has ended, so nothing is lost."""

    def nobody() -> Any:
        raise SchedulerError("nobody answers")

    (tmp_path / "out").mkdir()
    with pytest.raises(SchedulerError):
        run_study(small_plan(), tmp_path / "out", nobody)
    assert (tmp_path / "out" / "study.json").exists()
    with pytest.raises(SchedulerError):
        run_study(small_plan(), tmp_path / "deep" / "new", nobody)
    assert not (tmp_path / "deep").exists()
    assert run_study(small_plan(gains=(5.0,)), tmp_path / "out", IN_THREADS).begun == 2
    assert json.loads((tmp_path / "out" / "study.json").read_text())["runs"] == 2


def test_another_version_is_refused(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, field in (("mjsheaf", "mjsheaf_version"), ("mujoco", "versions.mujoco")):
        monkeypatch.setattr("mjsheaf.studies.plan.versions", lambda name=name: {**versions(), name: "99.0"})
        with pytest.raises(PlaceError, match=rf"{field} was '.*', is now '99.0'"):
            run_study(small_plan(), study, never)


STRANGE = ("notes.txt", "result.nc", ".hidden", "scenario.yaml", ".mine.part")


@pytest.mark.parametrize(
    ("files", "place", "said"),
    [
        *(({f"x/{name}": "mine"}, "x", f"holds '{name}' and no study") for name in STRANGE),
        ({"x": "mine"}, "x", "not a directory"),
        ({"x": "mine"}, "x/below", "cannot be written"),
        ({"x/study.json": "[]", "x/.mine.part": "mine"}, "x", "study"),
        ({"x/summary.json": '{"mjsheaf_version": "1"}'}, "x/study", "run"),
    ],
)
def test_a_place_of_something_else_is_refused(files: dict[str, str], place: str, said: str, tmp_path: Path) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    with pytest.raises(PlaceError, match=said):
        run_study(small_plan(), tmp_path / place, never)
    assert all_contents(tmp_path) == {name: text.encode() for name, text in files.items()}


def test_a_study_inside_a_study_is_refused(study: Path) -> None:
    before = contents(study)
    with pytest.raises(PlaceError, match=r"lies inside .*/study, the directory of a study"):
        run_study(small_plan(), study / "runs" / "mine", never)
    assert contents(study) == before


def test_a_second_command_is_refused(study: Path) -> None:
    before = contents(study)
    with open_directory(study, small_plan()):
        with pytest.raises(BusyError, match="study"), open_directory(study, small_plan()):
            pass
        arguments = ["--set", "time.end=0.5", "--grid", "controller.gain=1.0,3.0", "--seeds", "0:2"]
        answer = answer_of("sweep", "midpoint", *arguments, "--backend", "ideal", "--out", study)
        assert answer.code == 2
        assert "another command uses this study" in answer.err
    assert contents(study) == before
    assert run_study(small_plan(), study, never).begun == 0  # it is shown again without a cluster
    assert contents(study) == before


# -- a file system that takes nothing; full ones are in attack/test_full_disk.py -------------------------------------


@pytest.mark.slow
def test_a_disk_that_is_read_only(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "8m") as disk:
        run_study(small_plan(), disk.path / "study", IN_THREADS)
        before = contents(disk.path)
        disk.remount("ro")
        for place in (disk.path / "study", disk.path / "other" / "deeper"):
            with pytest.raises(PlaceError, match="Read-only file system"):
                run_study(small_plan(), place, never)
        assert contents(disk.path) == before


@pytest.mark.long
def test_a_small_disk_fills_and_is_emptied(tmp_path: Path) -> None:
    forty = small_plan(gains=tuple(1.0 + k for k in range(10)), seeds=(0, 4))
    with small_disk(tmp_path / "disk", "48k") as disk:
        with pytest.raises(PlaceError, match="No space left on device"):
            run_study(forty, disk.path / "study", IN_THREADS)
        kept = contents(disk.path / "study")
        assert any(name.startswith("runs") for name in kept)
        disk.remount("size=8m")
        assert 0 < run_study(forty, disk.path / "study", IN_THREADS).begun < 40
        assert kept.items() <= contents(disk.path / "study").items()
