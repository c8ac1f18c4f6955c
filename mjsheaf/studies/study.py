"""A study from plan to results: what is missing is run, then everything is shown in a table, plots and a page."""

import base64
import json
import re
import shlex
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
import pyarrow as pa

from mjsheaf._version import __version__
from mjsheaf.io.figures import AS_USUAL, FigureOptions
from mjsheaf.io.yaml import parse_yaml
from mjsheaf.results.metrics import MEASURES
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.studies.directory import open_directory, page_of_run
from mjsheaf.studies.job import STATUSES, ForeignWorkerError
from mjsheaf.studies.plan import Plan
from mjsheaf.studies.schema import Point
from mjsheaf.studies.workers import Runner, SchedulerError

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
"""After `run` and the parameters: name to type."""

_MOST_ROWS = 2000  # of the page
_WORD = re.compile(r"[\w./][\w./-]*")


@dataclass(frozen=True)
class Study:
    """What a study left.

    Attributes:
        directory: where.
        records: of all runs, in order; see `job.new_record`.
        begun: how many were run by this command; the others had ended before.
        files: what is to be looked at, in the directory.
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
    """Run what of a study has not ended, and write its table, plots and page.

    Args:
        plan: from `load_plan`.
        directory: of this study; new, or with an earlier part of it.
        workers: begins a Runner; called only where something is left to run.
        retry_failed: run again what did not finish.
        figures: how the plots are written.
        progress: True shows a bar on a terminal or in a notebook, False nothing; a function is called with (what is
            being done, done, in all).

    Raises:
        PlaceError: the directory holds something else or cannot be written. Runs that have ended are kept.
        BusyError: another command works on the directory.
        SchedulerError: the cluster cannot be reached, or went away. Runs that have ended are kept; without any, so is
            only a directory that was there before.
    """
    from mjsheaf.progress import shown

    with shown(progress, "running") as bar, open_directory(directory, plan) as place:
        report = bar or (progress if callable(progress) else no_progress)
        records = place.ended()
        kept = {n for n, r in records.items() if not retry_failed or r["status"] == "finished"}
        missing = [point for point in plan.points if point.number not in kept]
        if missing:
            try:
                with workers() as runner:
                    report("running", len(kept), len(plan.points))
                    results = runner.run(plan.job(point) for point in missing)
                    for done, result in enumerate(results, len(kept) + 1):
                        place.save(result)
                        records[result.record["run"]] = result.record
                        report("running", done, len(plan.points))
            except (SchedulerError, ForeignWorkerError):
                place.leave()
                raise
        ordered = [records[point.number] for point in plan.points]
        files = results_of(plan, ordered, figures)
        place.publish(files)
        return Study(directory, ordered, len(missing), list(files))


def results_of(plan: Plan, records: list[dict[str, Any]], figures: FigureOptions = AS_USUAL) -> dict[str, bytes]:
    """The files that show a study whose runs have all ended: name to content, equal for equal records."""
    from mjsheaf.studies.figures import plot_study

    table = make_table(plan, records)
    drawn = figures if "png" in figures.formats else replace(figures, formats=("png", *figures.formats))
    plots = plot_study(plan.study, plan.title, records, drawn)
    page = page_of(plan, table, {name: data for name, data in plots.items() if name.endswith(".png")})
    plots = {name: data for name, data in plots.items() if Path(name).suffix[1:] in figures.formats}
    return {"table.csv": csv_of(table), "table.parquet": table.to_parquet(index=False), **plots, "index.html": page}


def make_table(plan: Plan, records: Iterable[dict[str, Any]]) -> pd.DataFrame:
    """The table: run, a column for each swept field named by its path, then _COLUMNS.

    Errors are the team's at the last sample and, under `late_`, their RMS over the last half, m; nothing stands where a
    measure has no meaning or a run did not get that far, and for a parameter that a listed point leaves as it is. A
    parameter's column is of numbers where all its values are, of text where all are text, else of JSON.
    """
    rows = [
        {**record, **(record["final"] or {}), **{f"late_{m}": x for m, x in (record["late"] or {}).items()}}
        for record in records
    ]
    columns = {"run": _array([row["run"] for row in rows], "int64")}
    for path in plan.study.paths:
        if path != "seed":
            columns[path] = _parameter([row["parameters"].get(path) for row in rows])
    for name, kind in _COLUMNS.items():
        columns[name] = _array([row.get(name) for row in rows], kind)
    return pd.DataFrame(columns)


def _array(values: list[Any], kind: str) -> pd.api.extensions.ExtensionArray:
    """Values, or None, as a column of an Arrow type: one that tells what is missing from what is no number."""
    return pd.array(values, dtype=pd.ArrowDtype(pa.type_for_alias(kind)))


def _parameter(values: list[Any]) -> pd.api.extensions.ExtensionArray:
    kinds = {type(value) for value in values if value is not None}
    for among, kind in (({int}, "int64"), ({int, float}, "double"), ({bool}, "bool"), ({str}, "string")):
        if kinds <= among:
            return _array(values, kind)
    text = [None if value is None else json.dumps(value, ensure_ascii=False) for value in values]
    return _array(text, "string")


def csv_of(table: pd.DataFrame) -> bytes:
    """The table as CSV: UTF-8, a header, numbers with all their digits."""
    words = {name: table[name].map({True: "true", False: "false"}) for name in table.select_dtypes("bool[pyarrow]")}
    return table.assign(**words).to_csv(index=False, lineterminator="\n").encode()


def page_of(plan: Plan, table: pd.DataFrame, plots: dict[str, bytes]) -> bytes:
    """The page as HTML, one file that opens from disk without a network; plots (PNG by file name) are part of it."""
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    environment.filters.update(shown=_shown)
    statuses = table["status"].tolist()
    example = statuses.index("finished") if "finished" in statuses else 0
    rows = [
        {name: _cell(value) for name, value in row.items() if pd.notna(value)}
        for row in table.head(_MOST_ROWS).to_dict("records")
    ]
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
        rows=rows,
        pages={point.number: page_of_run(point.number) for point in plan.points} if plan.study.trajectories else {},
    ).encode()


def _is_shown(table: pd.DataFrame, name: str) -> bool:
    """Return True if a column of the page says anything; others only widen it."""
    known = table[name].replace("", None).notna()
    return bool(known.any()) and (name != "law" or table[name].nunique() > 1)


def not_converged(count: int, finished: int) -> str:
    """Say how many of the runs that finished had not converged at their end; empty if all had."""
    if not count:
        return ""
    return f"{count} of {finished} runs had not converged at the end; a later time.end shows where they settle"


@dataclass(frozen=True)
class Best:
    """The point of a study with the smallest error.

    Attributes:
        run: Number of its run with the smallest error.
        parameters: Field path to value.
        measure: Column of the table that is compared.
        error: Median of that error over the point's seeds, m.
        seeds: Number of the point's runs that finished.
        converged: True if all of them had converged at the end; None if that is not known.
    """

    run: int
    parameters: dict[str, Any]
    measure: str
    error: float
    seeds: int
    converged: bool | None


def best_point(plan: Plan, table: pd.DataFrame) -> Best | None:
    """Find the point with the smallest error, the median over its seeds; None without points to choose from.

    The error is the one that plots show: the study's measure, at the end or over the last half. A point counts only if
    all of its runs finished.
    """
    measure = plan.study.measure or "tracking_error"
    column = f"late_{measure}" if plan.study.late else measure
    seeds = plan.study.seeds.stop - plan.study.seeds.start if plan.study.seeds else 1
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
        parameters = plan.points[run].parameters
        found.append(Best(run, parameters, column, float(errors.median()), len(rows), converged))
    return min(found, key=lambda point: point.error, default=None)


def command_of(plan: Plan, point: Point) -> str:
    """The command that does one run of a study by itself, for a shell in the study's directory."""
    # The scenario of a study with vehicles' own files is not kept there, as it could not name them.
    parts = ["mjsheaf", "run", "SCENARIO" if plan.files else "scenario.yaml", "--backend", plan.study.backend]
    parts += ["--engine", plan.study.engine] if plan.study.engine != "mujoco" else []
    parts += ["--controller", plan.law.label] if plan.law else []
    changes = plan.job(point).changes.items()
    return shlex.join(parts + [part for path, value in changes for part in ("--set", f"{path}={_as_yaml(value)}")])


def _as_yaml(value: Any) -> str:
    """A value as `--set` reads it."""
    plain = isinstance(value, str) and _WORD.fullmatch(value) and parse_yaml(value, "value") == value
    return str(value) if plain else json.dumps(value, ensure_ascii=False)


def _cell(value: Any) -> str:
    """A value of the table."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _shown(value: Any) -> str:
    """A value of what was asked."""
    return f"{value:g}" if isinstance(value, float) else value if isinstance(value, str) else json.dumps(value)
