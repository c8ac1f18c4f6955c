"""A study from plan to results: missing runs are simulated, then all runs go into a table, plots and a page."""

import base64
import json
import re
import shlex
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
import pyarrow as pa

from mjsheaf._version import __version__
from mjsheaf.files import parse_yaml
from mjsheaf.results.metrics import MEASURES
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.show.style import AS_USUAL, FigureOptions
from mjsheaf.studies.directory import StudyDirectory, open_directory, page_of_run
from mjsheaf.studies.plan import Plan
from mjsheaf.studies.workers import STATUSES, ForeignWorkerError, Point, Runner, SchedulerError

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

_MOST_ROWS = 2000  # maximum number of rows on the page
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
    workers: Callable[[], AbstractContextManager[Runner]],
    *,
    retry_failed: bool = False,
    figures: FigureOptions = AS_USUAL,
    progress: Progress | bool | None = True,
) -> Study:
    """Simulate the missing runs of a study, and write its table, plots and page.

    Args:
        plan: Plan from `load_plan`.
        directory: Directory of the study, new or from an earlier command.
        workers: Function that starts a Runner; it is called only if runs are missing.
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
    from mjsheaf.progress import shown

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
    workers: Callable[[], AbstractContextManager[Runner]],
    report: Progress,
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
    rows = [_flat(record) for record in records]
    parameters = {path: [row["parameters"].get(path) for row in rows] for path in plan.study.paths if path != "seed"}
    return pd.DataFrame(
        {
            "run": _array([row["run"] for row in rows], "int64"),
            **{path: _parameter(values) for path, values in parameters.items()},
            **{name: _array([row.get(name) for row in rows], kind) for name, kind in _COLUMNS.items()},
        }
    )


def _flat(record: dict[str, Any]) -> dict[str, Any]:
    """Return a record with its errors among its fields, those over the second half under `late_`."""
    late = {f"late_{measure}": error for measure, error in (record["late"] or {}).items()}
    return {**record, **(record["final"] or {}), **late}


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
    words = {name: table[name].map({True: "true", False: "false"}) for name in table.select_dtypes("bool[pyarrow]")}
    return table.assign(**words).to_csv(index=False, lineterminator="\n").encode()


def page_of(plan: Plan, table: pd.DataFrame, plots: dict[str, bytes]) -> bytes:
    """Return the page as one HTML file that opens without a network; it embeds the plots (PNG by file name)."""
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    environment.filters.update(shown=_shown)
    statuses = table["status"].tolist()
    example = statuses.index("finished") if "finished" in statuses else 0
    page = environment.from_string(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
    finished = table[table["status"] == "finished"]
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
        columns=[name for name in table if _is_shown(table, name)],
        numbers={name for name in table if pd.api.types.is_numeric_dtype(table[name].dtype)},
        measures=MEASURES,
        rows=[_cells(row) for row in table.head(_MOST_ROWS).to_dict("records")],
        pages=_pages_of(plan),
    ).encode()


def _pages_of(plan: Plan) -> dict[int, str]:
    """Return the pages of the runs by number; none without trajectories."""
    return {point.number: page_of_run(point.number) for point in plan.points} if plan.study.trajectories else {}


def _cells(row: dict[Any, Any]) -> dict[Any, str]:
    """Return the values of a row that are known, as text."""
    return {name: _cell(value) for name, value in row.items() if pd.notna(value)}


def _is_shown(table: pd.DataFrame, name: str) -> bool:
    """Return True if a column of the page is informative; others would only widen it."""
    known = table[name].replace("", None).notna()
    return bool(known.any()) and (name != "law" or table[name].nunique() > 1)


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
    found: list[Best] = []
    for begin in range(0, len(table), seeds):
        rows = table.iloc[begin : begin + seeds]
        errors = rows[column].astype("float64")
        if (rows["status"] != "finished").any() or errors.isna().any():
            continue
        settled = [None if pd.isna(value) else bool(value) for value in rows["settled"]]
        converged = None if None in settled else all(settled)
        run = int(rows["run"].iloc[int(errors.to_numpy().argmin())])
        found.append(Best(run, plan.points[run].parameters, column, float(errors.median()), len(rows), converged))
    return min(found, key=lambda point: point.error, default=None)


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
