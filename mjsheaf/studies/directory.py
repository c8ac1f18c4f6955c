"""The directory of a study, used by one command at a time.

- study.json: Contents of the study. The same command resumes it, and a different one is refused.
- scenario.yaml: Scenario as read, to repeat single runs; missing if it has vehicle files of its own.
- runs/000017.json: Record of a run, written whole when it ends.
- trajectories/000017.nc, .html: result.nc and page of a run, if they are kept. They are written before its record,
  which contains the checksum of result.nc.
- timings.csv: Wall times of runs, the only file that differs between equal studies.
- table.csv, table.parquet, plots, index.html: Results, written when all runs have ended.
"""

import fcntl
import hashlib
import json
import os
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from mjsheaf.errors import InputError, PlaceError, shortened
from mjsheaf.files import dump_yaml, figure_files, is_part_of, naming, write_whole
from mjsheaf.results.store import digest, enclosing_run, read_mapping
from mjsheaf.studies.plan import Plan
from mjsheaf.studies.workers import STATUSES, JobResult, Point

_LOCK, _STUDY, _SCENARIO, _TIMINGS = ".lock", "study.json", "scenario.yaml", "timings.csv"
_RUNS, _TRAJECTORIES = "runs", "trajectories"
_NUMBERED = re.compile(r"[0-9]+\.(json|nc|html)")
_SHOWN_DIFFERENCES = 3
_SEALS = ("result_sha256", "record_sha256")

_FIGURES = figure_files(("error", "success", "messages", "over_time"))
RESULT_FILES = {"table.csv", "table.parquet", "index.html", *_FIGURES}
"""Names of the files that are written when all runs have ended."""


class BusyError(InputError):
    """Another command uses the study's directory."""


class StudyDirectory:
    """Directory of a study, locked by this process; created by `open_directory`."""

    def __init__(self, path: Path, plan: Plan, made: list[Path]) -> None:
        self.path = path
        self._plan, self._made = plan, made

    def ended(self) -> dict[int, dict[str, Any]]:
        """Return the records of runs that have ended, by number, ignoring files that do not match their point."""
        records = {point.number: self._record(point) for point in self._plan.points}
        return {number: record for number, record in records.items() if record is not None}

    def save(self, result: JobResult) -> None:
        """Save a run, completely or not at all.

        Raises:
            PlaceError: A file cannot be written.
        """
        number = result.record["run"]
        with self.writing():
            if result.dataset is not None:
                write_whole(self._file(_TRAJECTORIES, number), result.dataset, tidy=False)
            if result.page is not None:
                write_whole(self.path / page_of_run(number), result.page, tidy=False)
            write_whole(self._file(_RUNS, number), canonical(sealed(result)), tidy=False)
            with (self.path / _TIMINGS).open("a") as file:
                file.write(f"{number},{result.seconds:.6f}\n")

    def publish(self, files: dict[str, bytes]) -> None:
        """Write the result files, each completely or not at all, and remove those of an earlier command.

        Raises:
            PlaceError: A file cannot be written.
        """
        with self.writing():
            for name in RESULT_FILES - set(files):
                (self.path / name).unlink(missing_ok=True)
            for name, content in files.items():
                write_whole(self.path / name, content)

    def leave(self) -> None:
        """Remove the directory if this command created it and no run has ended."""
        if self.path in self._made and not _has_runs(self.path):
            for name in (_STUDY, _SCENARIO, _TIMINGS, _LOCK):
                with suppress(OSError):
                    (self.path / name).unlink(missing_ok=True)
            _remove_empty([self.path / _RUNS, self.path / _TRAJECTORIES, *self._made])

    def writing(self) -> AbstractContextManager[None]:
        """Turn an error of the file system into one that names the directory."""
        return naming(self.path, "runs that have ended are kept; the same command resumes", PlaceError)

    def _file(self, folder: str, number: int) -> Path:
        return self.path / folder / f"{number:06d}.{'json' if folder == _RUNS else 'nc'}"

    def _record(self, point: Point) -> dict[str, Any] | None:
        """Return the record of a run; None if there is none, or if it or its result.nc was changed."""
        record = read_mapping(self._file(_RUNS, point.number))
        if record is None or record.get("status") not in STATUSES:
            return None
        if (record.get("run"), record.get("parameters")) != (point.number, point.parameters):
            return None
        found = {key: record.pop(key, None) for key in _SEALS}
        kept = digest(self._file(_TRAJECTORIES, point.number)) or None if found["result_sha256"] else None
        shown = kept is None or (self.path / page_of_run(point.number)).is_file()
        return record if shown and found == {"result_sha256": kept, "record_sha256": _digest(record)} else None


def page_of_run(number: int) -> str:
    """Return the path of a run's page, relative to the directory of its study."""
    return f"{_TRAJECTORIES}/{number:06d}.html"


def sealed(result: JobResult) -> dict[str, Any]:
    """Add checksums of a record and of its result.nc, so that damaged or edited files are detected."""
    kept = None if result.dataset is None else hashlib.sha256(result.dataset).hexdigest()
    return {**result.record, "result_sha256": kept, "record_sha256": _digest(result.record)}


def canonical(value: Any) -> bytes:
    """Return JSON bytes that are equal for equal values."""
    return (json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _digest(record: dict[str, Any]) -> str:
    return hashlib.sha256(canonical(record)).hexdigest()


@contextmanager
def open_directory(path: Path, plan: Plan) -> Iterator[StudyDirectory]:
    """Lock a study's directory, which is new or holds the same study, for the duration of the block.

    The kernel releases the lock when the process ends, for whatever reason.

    Raises:
        PlaceError: The directory holds something else or another study, or cannot be written.
        BusyError: Another command uses it.
    """
    _check_place(path)
    missing = [place for place in (path, *path.absolute().parents) if not place.exists()]
    try:
        with naming(path, "choose another --out", PlaceError):
            path.mkdir(parents=True, exist_ok=True)
            lock = (path / _LOCK).open("a")
    except PlaceError:
        _remove_empty(missing)
        raise
    with lock:
        _take(lock, path)
        _check_place(path)  # again, because only the lock excludes other writers
        directory = StudyDirectory(path, plan, missing)
        with directory.writing():
            _begin(path, plan)
        yield directory


def _take(lock: IO[str], path: Path) -> None:
    with naming(path, "choose another --out", PlaceError, "locked"):  # for example on a file system without locks
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BusyError(f"{path}: another command uses this study; wait for it, or choose another --out") from None


def _check_place(path: Path) -> None:
    """Refuse a path that holds anything but a study, or lies inside the directory of a run or of a study.

    Raises:
        PlaceError: The message names the obstacle.
    """
    obstacle = _obstacle_around(path) or _obstacle_inside(path)
    if obstacle:
        raise PlaceError(f"{path}: {obstacle}; choose another --out")


def _obstacle_around(path: Path) -> str:
    """Describe the directory of a run or study that a path lies inside of; empty if there is none."""
    run = enclosing_run(path)
    if run is not None:
        return f"lies inside {run}, the directory of a run"
    study = next((place for place in Path(os.path.realpath(path)).parents if _study_in(place) is not None), None)
    return "" if study is None else f"lies inside {study}, the directory of a study"


def _obstacle_inside(path: Path) -> str:
    """Describe what is at a path instead of a study; empty if nothing is in the way."""
    if not path.is_dir():
        return "exists and is not a directory" if path.exists() or path.is_symlink() else ""
    if (path / _STUDY).exists():
        return f"its {_STUDY} is not a study of mjsheaf" if _study_in(path) is None else ""
    # study.json is written first. Without it, no file can come from a study.
    strange = sorted(p.name for p in path.iterdir() if p.name != _LOCK and not is_part_of(p.name, [_STUDY]))
    return f"holds {strange[0]!r} and no study" if strange else ""


def _begin(path: Path, plan: Plan) -> None:
    """Start the study, or require that the directory holds the same one; it may differ if no run has ended.

    Raises:
        PlaceError: The directory holds another study.
    """
    asked = json.loads(canonical(plan.record()))
    before = _study_in(path)
    found = [] if before is None else _differences(before, asked)
    if found and _has_runs(path):
        raise PlaceError(f"{path}: holds another study: {_shown(found)}; choose another --out")
    _remove_parts(path)
    if found:
        (path / _SCENARIO).unlink(missing_ok=True)
        for stale in (path / _TRAJECTORIES).glob("[0-9]*.*"):
            stale.unlink()
    if found or before is None:
        write_whole(path / _STUDY, canonical(asked))
    # A scenario file in this directory could not refer to a vehicle's own files.
    if not plan.files and not (path / _SCENARIO).exists():
        write_whole(path / _SCENARIO, dump_yaml(plan.scenario).encode())
    _make_folders(path, plan)  # after study.json, because a directory with runs but without it would be refused


def _shown(differences: list[str]) -> str:
    more = len(differences) - _SHOWN_DIFFERENCES
    return "; ".join(differences[:_SHOWN_DIFFERENCES]) + (f" (and {more} more)" if more > 0 else "")


def _make_folders(path: Path, plan: Plan) -> None:
    """Make the folders of a study and the file of its timings."""
    (path / _RUNS).mkdir(exist_ok=True)
    if plan.study.trajectories:
        (path / _TRAJECTORIES).mkdir(exist_ok=True)
    if not (path / _TIMINGS).exists():
        (path / _TIMINGS).write_text("run,seconds\n")


def _has_runs(path: Path) -> bool:
    return any((path / _RUNS).glob("[0-9]*.json"))


def _study_in(path: Path) -> dict[str, Any] | None:
    """Return the contents of the directory's study.json; None unless mjsheaf wrote one."""
    study = read_mapping(path / _STUDY)
    return study if study is not None and "mjsheaf_version" in study else None


def _remove_parts(path: Path) -> None:
    """Remove incomplete files of a command that was killed; other files may be the user's."""
    for folder in (path, path / _RUNS, path / _TRAJECTORIES):
        for part in folder.glob(".*.part"):
            name = part.name[1:].rsplit(".", 2)[0]
            ours = name in {_STUDY, _SCENARIO, *RESULT_FILES} or _NUMBERED.fullmatch(name)
            if ours and is_part_of(part.name, [name]):
                part.unlink(missing_ok=True)


def _remove_empty(places: list[Path]) -> None:
    for place in places:
        with suppress(OSError):
            os.rmdir(place)


def _leaves(value: Any, path: str = "") -> dict[str, str]:
    """Return the text of all plain values, empty lists and empty mappings in a value, by field path."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    found: dict[str, str] = {}
    for key, item in items:
        found |= _leaves(item, f"{path}.{key}" if path else str(key))
    return found or {path: repr(value)}


def _differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Describe each field with a different value as 'field was A, is now B', in the order of `now`."""
    was, new = _leaves(before), _leaves(now)
    return [
        f"{path} was {shortened(was.get(path, 'absent'))}, is now {shortened(new.get(path, 'absent'))}"
        for path in {**new, **was}
        if was.get(path) != new.get(path)
    ]
