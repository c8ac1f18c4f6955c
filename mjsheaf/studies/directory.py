"""The directory of a study: what was asked, what is done, and one command at a time.

- study.json: what was asked. With it the same command resumes, and another one is refused.
- scenario.yaml: the scenario as read, to look at any run by itself; not where it has vehicles of its own.
- runs/000017.json: one file a run, written whole as it ends.
- trajectories/000017.nc: its result.nc, where wanted; written before the run's file, which says that it is there.
- timings.csv: how long runs took; the only file that differs between equal studies.
- table.csv, table.parquet, plots, index.html: written when all runs have ended.
"""

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from mjsheaf.errors import InputError
from mjsheaf.io.yaml import dump_yaml
from mjsheaf.results.store import PlaceError, digest, enclosing_run
from mjsheaf.studies.differences import differences
from mjsheaf.studies.job import STATUSES, Done
from mjsheaf.studies.plan import Plan
from mjsheaf.studies.points import Point

_LOCK, _STUDY, _SCENARIO, _RUNS, _TRAJECTORIES = ".lock", "study.json", "scenario.yaml", "runs", "trajectories"
_TIMINGS = "timings.csv"
_NUMBER = "[0-9]*"
_SHOWN_DIFFERENCES = 3
_SEALS = ("result_sha256", "record_sha256")

RESULT_FILES = {"table.csv", "table.parquet", "error.png", "success.png", "index.html"}
"""What is made of the runs once all have ended."""


class BusyError(InputError):
    """Another command works on the study's directory."""


class StudyDirectory:
    """A study's directory, held by this process; made by `open_directory`.

    Attributes:
        path: where.
    """

    def __init__(self, path: Path, plan: Plan, made: list[Path]) -> None:
        self.path = path
        self._plan, self._made = plan, made

    def ended(self) -> dict[int, dict[str, Any]]:
        """Records of the runs that have ended, by number. A file that is no record of its point is not counted."""
        found = {}
        for point in self._plan.points:
            record = self._record(point)
            if record is not None:
                found[point.number] = record
        return found

    def save(self, done: Done) -> None:
        """Keep a run: whole, or not at all.

        Raises:
            PlaceError: it cannot be written.
        """
        name = _name(done.record["run"])
        with self.writing():
            if done.dataset is not None:
                write_whole(self.path / _TRAJECTORIES / f"{name}.nc", done.dataset)
            write_whole(self.path / _RUNS / f"{name}.json", canonical(sealed(done)))
            with (self.path / _TIMINGS).open("a") as file:
                file.write(f"{done.record['run']},{done.seconds:.6f}\n")

    def write(self, name: str, content: bytes) -> None:
        """Write a file of results whole.

        Raises:
            PlaceError: it cannot be written.
        """
        with self.writing():
            write_whole(self.path / name, content)

    def remove(self, names: set[str]) -> None:
        """Take away files of results that an earlier end of this study left."""
        with self.writing():
            for name in names:
                (self.path / name).unlink(missing_ok=True)

    def leave(self) -> None:
        """Take the directory away again, if it was made for this study and no run has ended."""
        if self.path not in self._made or any((self.path / _RUNS).glob(f"{_NUMBER}.json")):
            return
        for name in (_STUDY, _SCENARIO, _TIMINGS, _LOCK):
            with suppress(OSError):
                (self.path / name).unlink(missing_ok=True)
        _remove_empty([self.path / _RUNS, self.path / _TRAJECTORIES, *self._made])

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Turn an error of the file system into one that names the directory."""
        with _told(self.path, "runs that have ended are kept, the same command goes on"):
            yield

    def _record(self, point: Point) -> dict[str, Any] | None:
        """The record of a run; None where there is none, or it or its result.nc is not as it was written."""
        name = _name(point.number)
        try:
            record = json.loads((self.path / _RUNS / f"{name}.json").read_bytes())
        except (OSError, ValueError, RecursionError):
            return None
        known = isinstance(record, dict) and record.get("status") in STATUSES and record.get("run") == point.number
        if not known or record.get("parameters") != point.parameters:
            return None
        found = {key: record.pop(key, None) for key in _SEALS}
        kept = digest(self.path / _TRAJECTORIES / f"{name}.nc") or None if found["result_sha256"] else None
        return record if found == {"result_sha256": kept, "record_sha256": _digest(record)} else None


def sealed(done: Done) -> dict[str, Any]:
    """A record with checksums of itself and of its result.nc: one that was damaged or edited is not taken for a run."""
    kept = None if done.dataset is None else hashlib.sha256(done.dataset).hexdigest()
    return {**done.record, "result_sha256": kept, "record_sha256": _digest(done.record)}


def _digest(record: dict[str, Any]) -> str:
    return hashlib.sha256(canonical(record)).hexdigest()


@contextmanager
def open_directory(path: Path, plan: Plan) -> Iterator[StudyDirectory]:
    """Take a study's directory, new or with the same study in it, for as long as the block lasts.

    The kernel gives the lock back when the process ends, however it ends.

    Raises:
        PlaceError: the directory holds something else, another study, or cannot be written.
        BusyError: another command works on it.
    """
    _check_place(path)
    missing = [place for place in (path, *path.absolute().parents) if not place.exists()]
    try:
        with _told(path, "choose another --out"):
            path.mkdir(parents=True, exist_ok=True)
            lock = (path / _LOCK).open("a")
    except PlaceError:
        _remove_empty(missing)
        raise
    with lock:
        _take(lock, path)
        _check_place(path)  # again: only now does nobody else write
        directory = StudyDirectory(path, plan, missing)
        with directory.writing():
            _begin(path, plan)
        yield directory


@contextmanager
def _told(path: Path, hint: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise PlaceError(f"{path}: cannot be written: {error.strerror or error}; {hint}") from None


def _take(lock: IO[str], path: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise BusyError(f"{path}: another command works on this study; wait for it, or choose another --out") from None
    except OSError as error:  # a file system without locks
        raise PlaceError(f"{path}: cannot be locked: {error.strerror or error}; choose another --out") from None


def _check_place(path: Path) -> None:
    run = enclosing_run(path)
    if run is not None:
        raise PlaceError(f"{path}: lies inside {run}, the directory of a run; choose another --out")
    real = Path(os.path.realpath(path))
    study = next((parent for parent in real.parents if _study_in(parent) is not None), None)
    if study is not None:
        raise PlaceError(f"{path}: lies inside {study}, the directory of a study; choose another --out")
    if not path.exists() and not path.is_symlink():
        return
    if not path.is_dir():
        raise PlaceError(f"{path}: exists and is not a directory; choose another --out")
    if (path / _STUDY).exists():
        _read(path)
        return
    # Without study.json, which is written first, nothing else can be ours.
    strange = sorted(p.name for p in path.iterdir() if p.name not in (_LOCK, _part(p.with_name(_STUDY)).name))
    if strange:
        raise PlaceError(f"{path}: holds {strange[0]!r} and no study; expected a new directory or that of this study")


def _begin(path: Path, plan: Plan) -> None:
    """Begin the study, or see that it is the one that was begun.

    Raises:
        PlaceError: it is another one.
    """
    asked = json.loads(canonical(plan.record()))
    begun = (path / _STUDY).exists() and _same(path, asked)
    _remove_parts(path)
    if not begun:
        if (path / _STUDY).exists():  # of another, of which no run had ended
            (path / _SCENARIO).unlink(missing_ok=True)
            for stale in (path / _TRAJECTORIES).glob(f"{_NUMBER}.nc"):
                stale.unlink()
        write_whole(path / _STUDY, canonical(asked))
    # A scenario file could not name a vehicle's own files from here.
    if not plan.files and not (path / _SCENARIO).exists():
        write_whole(path / _SCENARIO, dump_yaml(plan.scenario).encode())
    # Only now: a directory with runs and no study is not taken for ours.
    (path / _RUNS).mkdir(exist_ok=True)
    if plan.study.trajectories:
        (path / _TRAJECTORIES).mkdir(exist_ok=True)
    if not (path / _TIMINGS).exists():
        (path / _TIMINGS).write_text("run,seconds\n")


def _same(path: Path, asked: dict[str, Any]) -> bool:
    """Whether the study that was begun here is the one that is asked for; one of which no run has ended may differ.

    Raises:
        PlaceError: it is another one.
    """
    found = differences(_read(path), asked)
    if found and any((path / _RUNS).glob(f"{_NUMBER}.json")):
        more = f" (and {len(found) - _SHOWN_DIFFERENCES} more)" if len(found) > _SHOWN_DIFFERENCES else ""
        raise PlaceError(
            f"{path}: holds another study: {'; '.join(found[:_SHOWN_DIFFERENCES])}{more}; choose another --out"
        )
    return not found


def _read(path: Path) -> dict[str, Any]:
    """What the directory's study.json holds.

    Raises:
        PlaceError: mjsheaf did not write it.
    """
    study = _study_in(path)
    if study is None:
        raise PlaceError(f"{path / _STUDY}: is no study of mjsheaf; choose another --out")
    return study


def _study_in(path: Path) -> dict[str, Any] | None:
    """What the directory's study.json holds; None where there is none that mjsheaf wrote."""
    try:
        study = json.loads((path / _STUDY).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return study if isinstance(study, dict) and "mjsheaf_version" in study else None


def _remove_parts(path: Path) -> None:
    """Take away what a command that was killed had half written; other files may be a person's."""
    parts = [_part(path / name) for name in (_STUDY, _SCENARIO, *RESULT_FILES)]
    parts += [part for folder in (_RUNS, _TRAJECTORIES) for part in (path / folder).glob(f".{_NUMBER}.part")]
    for part in parts:
        part.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file by rename: whoever reads it sees all of it, or what was there before."""
    part = _part(path)
    try:
        part.write_bytes(content)
        part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


def canonical(value: Any) -> bytes:
    """JSON, equal for equal values."""
    return (json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _part(path: Path) -> Path:
    """Where a file is written before it gets its name."""
    return path.with_name(f".{path.name}.part")


def _name(number: int) -> str:
    return f"{number:06d}"


def _remove_empty(places: list[Path]) -> None:
    for place in places:
        with suppress(OSError):
            os.rmdir(place)
