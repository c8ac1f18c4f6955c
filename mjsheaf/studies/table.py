"""The table of a study: a row a run, in the order of the points."""

import csv
import io
import json
from collections.abc import Iterable
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mjsheaf.results.metrics import MEASURES
from mjsheaf.studies.plan import Plan

LATE_COLUMNS = tuple(f"late_{measure}" for measure in MEASURES)
RESULT_COLUMNS = ("seed", "status", *MEASURES, *LATE_COLUMNS, "ending", "settled", "bound_ratio", "message")
"""After `run` and the parameters."""

_TYPES = {
    "run": pa.int64(),
    "seed": pa.int64(),
    "status": pa.string(),
    **{measure: pa.float64() for measure in MEASURES},
    "settled": pa.bool_(),
    "bound_ratio": pa.float64(),
    "message": pa.string(),
    "ending": pa.string(),
    **{column: pa.float64() for column in LATE_COLUMNS},
}


def make_table(plan: Plan, records: Iterable[dict[str, Any]]) -> pa.Table:
    """The table: run, a column for each swept field named by its path, then RESULT_COLUMNS.

    Errors are the team's at the last sample and, under `late_`, their RMS over the last half, m; nothing stands where a
    measure has no meaning or a run did not get that far, and for a parameter that a listed point leaves as it is. A
    parameter's column is of numbers where all its values are, of text where all are text, else of JSON.

    Args:
        plan: the study.
        records: of all runs, in order.
    """
    rows = list(records)
    columns: dict[str, pa.Array] = {"run": _typed("run", [row["run"] for row in rows])}
    for path in plan.study.paths:
        if path != "seed":
            columns[path] = _parameter([row["parameters"].get(path) for row in rows])
    for name in RESULT_COLUMNS:
        columns[name] = _typed(name, [_result(row, name) for row in rows])
    return pa.table(columns)


def _result(row: dict[str, Any], name: str) -> Any:
    if name in MEASURES:
        return (row["final"] or {}).get(name)
    if name in LATE_COLUMNS:
        return (row["late"] or {}).get(name.removeprefix("late_"))
    return row[name]


def csv_of(table: pa.Table) -> bytes:
    """The table as CSV: UTF-8, a header, numbers with all their digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.column_names)
    for row in zip(*(column.to_pylist() for column in table.columns), strict=True):
        writer.writerow([_cell(value) for value in row])
    return text.getvalue().encode()


def parquet_of(table: pa.Table) -> bytes:
    """The table as Parquet; equal tables give equal bytes."""
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink)
    return bytes(sink.getvalue())


def _typed(name: str, values: list[Any]) -> pa.Array:
    return pa.array(values, type=_TYPES[name])


def _parameter(values: list[Any]) -> pa.Array:
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int}:
        return pa.array(values, type=pa.int64())
    if kinds <= {int, float}:
        return pa.array([None if value is None else float(value) for value in values], type=pa.float64())
    for kind, of in ((bool, pa.bool_()), (str, pa.string())):
        if kinds == {kind}:
            return pa.array(values, type=of)
    return pa.array([None if value is None else json.dumps(value, ensure_ascii=False) for value in values], pa.string())


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)
