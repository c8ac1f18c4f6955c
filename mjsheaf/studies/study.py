"""A study from plan to results: missing runs are simulated, then all runs go into a table, plots and a page.

The directory of a study is used by one command at a time:

- study.json: Contents of the study. The same command resumes it, and a different one is refused.
- scenario.yaml: Scenario as read, to repeat single runs; missing if it has vehicle files of its own.
- runs/000017.json: Record of a run, written whole when it ends.
- trajectories/000017.nc, .html: result.nc and page of a run, if they are kept. They are written before its record,
  which contains the checksum of result.nc.
- timings.csv: Wall times of runs, the only file that differs between equal studies.
- table.csv, table.parquet, plots, index.html: Results, written when all runs have ended.
"""

import base64
import fcntl
import hashlib
import json
import os
import re
import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
import pyarrow as pa

from mjsheaf._version import __version__
from mjsheaf.errors import InputError, PlaceError, shortened
from mjsheaf.files import digest, dump_yaml, figure_files, is_part_of, naming, parse_yaml, remove_empty, write_whole
from mjsheaf.progress import Report, no_progress, shown
from mjsheaf.results.metrics import MEASURES
from mjsheaf.results.store import enclosing_run, read_mapping, record_in
from mjsheaf.show.style import AS_USUAL, FigureOptions
from mjsheaf.studies.plan import ForeignWorkerError, Plan, Point
from mjsheaf.studies.workers import STATUSES, JobResult, SchedulerError, Workers

_LOCK, _STUDY, _SCENARIO, _TIMINGS = ".lock", "study.json", "scenario.yaml", "timings.csv"
_RUNS, _TRAJECTORIES = "runs", "trajectories"
_NUMBERED = re.compile(r"[0-9]+\.(json|nc|html)")
_SHOWN_DIFFERENCES = 3
_SEALS = ("result_sha256", "record_sha256")

_FIGURES = figure_files(("error", "messages", "bound", "over_time", "success"))
RESULT_FILES = {"table.csv", "table.parquet", "index.html", *_FIGURES}
"""Names of the files that are written when all runs have ended."""


class BusyError(InputError):
    """Another command uses the study's directory."""


@dataclass(frozen=True)
class StudyDirectory:
    """Directory of a study, locked by this process; created by `open_directory`.

    Attributes:
        path: Path of the directory.
        plan: Plan of the study.
        made: Directories that this command created, the deepest first.
    """

    path: Path
    plan: Plan
    made: list[Path]

    def ended(self) -> dict[int, dict[str, Any]]:
        """Return the records of runs that have ended, by number, ignoring files that do not match their point."""
        records = {point.number: self._record(point) for point in self.plan.points}
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
        if self.path in self.made and not _has_runs(self.path):
            for name in (_STUDY, _SCENARIO, _TIMINGS, _LOCK):
                with suppress(OSError):
                    (self.path / name).unlink()
            remove_empty([self.path / _RUNS, self.path / _TRAJECTORIES, *self.made])

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
        remove_empty(missing)
        raise
    with lock:
        with naming(path, "choose another --out", PlaceError, "locked"):  # for example on a file system without locks
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise BusyError(
                    f"{path}: another command uses this study; wait for it, or choose another --out"
                ) from None
        _check_place(path)  # again, because only the lock excludes other writers
        directory = StudyDirectory(path, plan, missing)
        with directory.writing():
            _begin(path, plan)
        yield directory


def _check_place(path: Path) -> None:
    """Refuse a path that holds anything but a study, or lies inside the directory of a run or of a study.

    Raises:
        PlaceError: The message names the obstacle.
    """
    obstacle = _obstacle_inside(path)
    around = enclosing_run(Path(os.path.realpath(path)), _STUDY)
    if around is not None:
        kind = "study" if record_in(around, [_STUDY]) else "run"
        obstacle = f"lies inside {around}, the directory of a {kind}"
    if obstacle:
        raise PlaceError(f"{path}: {obstacle}; choose another --out")


def _obstacle_inside(path: Path) -> str:
    """Describe what is at a path instead of a study; empty if nothing is in the way."""
    if not path.is_dir():
        return "exists and is not a directory" if path.exists() or path.is_symlink() else ""
    if (path / _STUDY).exists():
        return f"its {_STUDY} is not a study of mjsheaf" if record_in(path, [_STUDY]) is None else ""
    # study.json is written first. Without it, no file can come from a study.
    strange = sorted(p.name for p in path.iterdir() if p.name != _LOCK and not is_part_of(p.name, [_STUDY]))
    return f"holds {strange[0]!r} and no study" if strange else ""


def _begin(path: Path, plan: Plan) -> None:
    """Start the study, or require that the directory holds the same one; it may differ if no run has ended.

    Raises:
        PlaceError: The directory holds another study.
    """
    asked = json.loads(canonical(plan.record()))
    before = record_in(path, [_STUDY])
    found = [] if before is None else _differences(before, asked)
    if found and _has_runs(path):
        more = len(found) - _SHOWN_DIFFERENCES
        shown = "; ".join(found[:_SHOWN_DIFFERENCES]) + (f" (and {more} more)" if more > 0 else "")
        raise PlaceError(f"{path}: holds another study: {shown}; choose another --out")
    for folder in (path, path / _RUNS, path / _TRAJECTORIES):
        for part in folder.glob(".*.part"):  # incomplete files of a command that was killed, but none of the user's
            name = part.name[1:].rsplit(".", 2)[0]
            ours = name in {_STUDY, _SCENARIO, *RESULT_FILES} or _NUMBERED.fullmatch(name)
            if ours and is_part_of(part.name, [name]):
                part.unlink(missing_ok=True)
    if found:
        (path / _SCENARIO).unlink(missing_ok=True)
        for stale in (path / _TRAJECTORIES).glob("[0-9]*.*"):
            stale.unlink()
    if found or before is None:
        write_whole(path / _STUDY, canonical(asked))
    # A scenario file in this directory could not refer to a vehicle's own files.
    if not plan.files and not (path / _SCENARIO).exists():
        write_whole(path / _SCENARIO, dump_yaml(plan.scenario).encode())
    # After study.json, because a directory with runs but without it would be refused.
    (path / _RUNS).mkdir(exist_ok=True)
    if plan.study.trajectories:
        (path / _TRAJECTORIES).mkdir(exist_ok=True)
    if not (path / _TIMINGS).exists():
        (path / _TIMINGS).write_text("run,seconds\n")


def _has_runs(path: Path) -> bool:
    return any((path / _RUNS).glob("[0-9]*.json"))


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


_COLUMNS = {
    "seed": "int64",
    "status": "string",
    **dict.fromkeys(MEASURES, "double"),
    **{f"late_{measure}": "double" for measure in MEASURES},
    "ending": "string",
    "settled": "bool",
    "bound_ratio": "double",
    "late_bound_ratio": "double",
    "numbers_per_agent_second": "double",
    "law": "string",
    "message": "string",
}
"""Types of the table's columns after `run` and the parameters, by name."""

_WORD = re.compile(r"[\w./][\w./-]*")


@dataclass(frozen=True)
class Study:
    """Results of a study.

    Attributes:
        directory: Directory of the study.
        records: Records of all runs, in order; see `workers.new_record`.
        begun: Number of runs of this command; the others had ended before.
        files: Names of the result files in the directory.
    """

    directory: Path
    records: list[dict[str, Any]]
    begun: int
    files: list[str]


def run_study(
    plan: Plan,
    directory: Path,
    workers: Callable[[], AbstractContextManager[Workers]],
    *,
    retry_failed: bool = False,
    figures: FigureOptions = AS_USUAL,
    progress: Report | bool | None = True,
) -> Study:
    """Simulate the missing runs of a study, and write its table, plots and page.

    Args:
        plan: Plan from `load_plan`.
        directory: Directory of the study, new or from an earlier command.
        workers: Function that starts them; it is called only if runs are missing.
        retry_failed: True to repeat runs that did not finish.
        figures: Formats and style of the plots.
        progress: True shows a bar on a terminal or in a notebook, and False shows nothing. A function is called with
            the name of the activity, the steps done and the number of steps.

    Raises:
        PlaceError: The directory holds something else or cannot be written. Runs that have ended are kept.
        BusyError: Another command uses the directory.
        SchedulerError: The cluster cannot be reached, or the connection is lost. Runs that have ended are kept. If
            there are none, a directory that was created for the study is removed.
    """
    with shown(progress, "running") as bar, open_directory(directory, plan) as place:
        report = bar or (progress if callable(progress) else no_progress)
        records = place.ended()
        kept = {n for n, r in records.items() if not retry_failed or r["status"] == "finished"}
        missing = [point for point in plan.points if point.number not in kept]
        if missing:
            records |= _simulate(plan, missing, place, workers, report)
        ordered = [records[point.number] for point in plan.points]
        files = results_of(plan, ordered, figures)
        place.publish(files)
        return Study(directory, ordered, len(missing), list(files))


def _simulate(
    plan: Plan,
    missing: list[Point],
    place: StudyDirectory,
    workers: Callable[[], AbstractContextManager[Workers]],
    report: Report,
) -> dict[int, dict[str, Any]]:
    """Simulate the missing runs of a study and save each one in its place; return their records by number."""
    records = {}
    count = len(plan.points)
    try:
        with workers() as runner:
            report("running", count - len(missing), count)
            with closing(runner.run(plan.job(point) for point in missing)) as results:
                for done, result in enumerate(results, count - len(missing) + 1):
                    place.save(result)
                    records[result.record["run"]] = result.record
                    report("running", done, count)
    except (SchedulerError, ForeignWorkerError):
        place.leave()
        raise
    return records


def results_of(plan: Plan, records: list[dict[str, Any]], figures: FigureOptions = AS_USUAL) -> dict[str, bytes]:
    """Return the result files of a study whose runs have all ended, by name; equal for equal records."""
    from mjsheaf.studies.figures import plot_study

    table = make_table(plan, records)
    drawn = figures if "png" in figures.formats else replace(figures, formats=("png", *figures.formats))
    plots = plot_study(plan.study, plan.title, records, drawn)
    page = page_of(plan, table, {name: data for name, data in plots.items() if name.endswith(".png")})
    plots = {name: data for name, data in plots.items() if Path(name).suffix[1:] in figures.formats}
    return {"table.csv": csv_of(table), "table.parquet": table.to_parquet(index=False), **plots, "index.html": page}


def make_table(plan: Plan, records: Iterable[dict[str, Any]]) -> pd.DataFrame:
    """Make the table: run, a column for each swept field named by its path, then _COLUMNS.

    Errors are the team's at the last sample and, under `late_`, their RMS over the second half, m. A cell is empty if a
    measure is undefined, if the run ended before it, or if a listed point does not set the parameter. A parameter's
    column holds numbers if all its values are numbers, text if all are text, and JSON otherwise.
    """
    rows = []
    for record in records:
        late = {f"late_{measure}": error for measure, error in (record["late"] or {}).items()}
        rows.append({**record, **(record["final"] or {}), **late})
    parameters = {path: [row["parameters"].get(path) for row in rows] for path in plan.study.paths if path != "seed"}
    return pd.DataFrame(
        {
            "run": _array([row["run"] for row in rows], "int64"),
            **{path: _parameter(values) for path, values in parameters.items()},
            **{name: _array([row.get(name) for row in rows], kind) for name, kind in _COLUMNS.items()},
        }
    )


def _array(values: list[Any], kind: str) -> pd.api.extensions.ExtensionArray:
    """Make a column of an Arrow type, which distinguishes missing values (None) from NaN."""
    return pd.array(values, dtype=pd.ArrowDtype(pa.type_for_alias(kind)))


def _parameter(values: list[Any]) -> pd.api.extensions.ExtensionArray:
    kinds = {type(value) for value in values if value is not None}
    for among, kind in (({int}, "int64"), ({int, float}, "double"), ({bool}, "bool"), ({str}, "string")):
        if kinds <= among:
            return _array(values, kind)
    text = [None if value is None else json.dumps(value, ensure_ascii=False) for value in values]
    return _array(text, "string")


def csv_of(table: pd.DataFrame) -> bytes:
    """Return the table as CSV in UTF-8, with a header and numbers with all their digits."""
    flags = [name for name in table if table[name].dtype == pd.ArrowDtype(pa.bool_())]
    words = {name: table[name].map({True: "true", False: "false"}) for name in flags}
    return table.assign(**words).to_csv(index=False, lineterminator="\n").encode()


def page_of(plan: Plan, table: pd.DataFrame, plots: dict[str, bytes]) -> bytes:
    """Return the page as one HTML file that opens without a network; it embeds the plots (PNG by file name).

    Its table has the first 2000 runs.
    """
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    environment.filters.update(shown=_shown)
    statuses = table["status"].tolist()
    example = statuses.index("finished") if "finished" in statuses else 0
    page = environment.from_string(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
    finished = table[table["status"] == "finished"]
    known = table.replace("", None).notna()
    best = best_point(plan, table)
    return page.render(
        plan=plan,
        best=best,
        best_command=None if best is None else command_of(plan, plan.points[best.run]),
        not_converged=not_converged(int(finished["settled"].eq(False).sum()), len(finished)),
        study=plan.study,
        version=__version__,
        runs=len(table),
        statuses=STATUSES,
        counts=Counter(statuses),
        plots={name: base64.b64encode(png).decode() for name, png in plots.items()},
        example=example,
        command=command_of(plan, plan.points[example]),
        columns=[name for name in table if known[name].any() and (name != "law" or table[name].nunique() > 1)],
        numbers={name for name in table if pd.api.types.is_numeric_dtype(table[name].dtype)},
        measures=MEASURES,
        rows=[
            {name: _cell(value) for name, value in row.items() if pd.notna(value)}
            for row in table.head(2000).to_dict("records")
        ],
        pages={point.number: page_of_run(point.number) for point in plan.points} if plan.study.trajectories else {},
    ).encode()


def not_converged(count: int, finished: int) -> str:
    """Report how many of the finished runs had not converged at the end; empty if all had."""
    told = f"{count} of {finished} runs had not converged at the end; a later time.end shows where they settle"
    return told if count else ""


@dataclass(frozen=True)
class Best:
    """The point of a study with the smallest error.

    Attributes:
        run: Number of its run with the smallest error.
        parameters: Field path to value.
        measure: Name of the compared column of the table.
        error: Median of that error over the point's seeds, m.
        seeds: Number of the point's runs that finished.
        converged: True if all of them had converged at the end; None if unknown.
    """

    run: int
    parameters: dict[str, Any]
    measure: str
    error: float
    seeds: int
    converged: bool | None


def best_point(plan: Plan, table: pd.DataFrame) -> Best | None:
    """Find the point with the smallest error, the median over its seeds; None without points to choose from.

    The error is the one that plots show: the study's measure, at the end or over the second half. A point counts only
    if all of its runs finished.
    """
    measure = plan.study.measure or "tracking_error"
    column = f"late_{measure}" if plan.study.late else measure
    seeds = plan.study.seed_count
    if len(table) <= seeds:
        return None
    errors = table[column].astype("float64").where(table["status"] == "finished")
    medians = pd.Series(np.median(errors.to_numpy().reshape(-1, seeds), axis=1))  # NaN if one of them is
    if medians.isna().all():
        return None
    rows = table.iloc[seeds * medians.idxmin() :][:seeds]
    settled = None if rows["settled"].isna().any() else bool(rows["settled"].all())
    run = int(rows["run"].loc[errors[rows.index].idxmin()])
    return Best(run, plan.points[run].parameters, column, float(medians.min()), seeds, settled)


def command_of(plan: Plan, point: Point) -> str:
    """Return the shell command that repeats one run of a study, in the study's directory."""
    # If vehicles have their own files, the directory has no scenario file, because it could not refer to them.
    parts = [
        *("mjsheaf", "run", "SCENARIO" if plan.files else "scenario.yaml", "--backend", plan.study.backend),
        *(("--engine", plan.study.engine) if plan.study.engine != "mujoco" else ()),
        *(("--controller", plan.law.label) if plan.law else ()),
    ]
    changes = plan.job(point).changes.items()
    return shlex.join(parts + [part for path, value in changes for part in ("--set", f"{path}={_as_yaml(value)}")])


def _as_yaml(value: Any) -> str:
    """Format a value for `--set`."""
    plain = isinstance(value, str) and _WORD.fullmatch(value) and parse_yaml(value, "value") == value
    return str(value) if plain else json.dumps(value, ensure_ascii=False)


def _cell(value: Any) -> str:
    """Format a value of the table."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _shown(value: Any) -> str:
    """Format a value of the study file."""
    return f"{value:g}" if isinstance(value, float) else value if isinstance(value, str) else json.dumps(value)
