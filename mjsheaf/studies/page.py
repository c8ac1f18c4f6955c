"""The page of a study: what was asked, what came out; one file that opens from disk without a network."""

import base64
import json
import re
import shlex
from collections import Counter
from html import escape
from typing import TYPE_CHECKING, Any

from mjsheaf._version import __version__
from mjsheaf.io.yaml import parse_yaml
from mjsheaf.results.metrics import MEASURES
from mjsheaf.studies.job import STATUSES, overrides_of
from mjsheaf.studies.plan import Plan
from mjsheaf.studies.points import Point

if TYPE_CHECKING:
    import pyarrow as pa

_BACKENDS = {"ideal": "on ideal kinematics", "physics": "on MuJoCo bodies"}
_MOST_ROWS = 2000
_MOST_VALUES = 24
_NUMBER = ' class="n"'
_WORD = re.compile(r"[\w./][\w./-]*")

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; padding: 0 1rem; color: #1a1a1a; }
h1 { font-size: 1.5rem; margin-bottom: 0; } h2 { font-size: 1.1rem; margin-top: 2rem; }
img { max-width: 100%; } code { background: #f3f3f3; padding: .1em .3em; border-radius: 3px; }
.scroll { overflow-x: auto; max-height: 40rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; }
th { position: sticky; top: 0; background: #fff; border-bottom: 2px solid #999; }
th { text-align: left; vertical-align: bottom; padding: .2em .8em .2em 0; } th.n { text-align: right; }
td { border-bottom: 1px solid #e5e5e5; padding: .15em .8em .15em 0; white-space: nowrap; }
td.n { text-align: right; } td.message { white-space: normal; min-width: 20rem; }
tr.bad td { color: #a33; } .note { color: #666; font-size: 13px; }
dl { display: grid; grid-template-columns: max-content auto; gap: .2em 1.5em; margin: 0; }
dt { font-weight: 600; } dd { margin: 0; }
"""


def page_of(plan: Plan, table: "pa.Table", plots: dict[str, bytes]) -> bytes:
    """The page as HTML; equal studies give equal bytes.

    Args:
        plan: the study.
        table: of all runs.
        plots: PNG by file name, which become part of the page.
    """
    study = plan.study
    counts = Counter(table.column("status").to_pylist())
    told = ", ".join(f"{counts[status]} {status}" for status in STATUSES if counts[status])
    parts = [
        f"<h1>{escape(plan.name)}</h1>",
        f"<p>{escape(study.summary)}</p>" if study.summary else "",
        f"<p><strong>{table.num_rows} runs</strong>: {told}.</p>",
        *(_figure(name, png) for name, png in plots.items()),
        "<h2>What was asked</h2>",
        _asked(plan),
        "<h2>Runs</h2>",
        _note(plan, table),
        _rows(table),
    ]
    body = "\n".join(filter(None, parts))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{escape(plan.name)}: mjsheaf study</title>\n<style>{_STYLE}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    ).encode()


def _figure(name: str, png: bytes) -> str:
    data = base64.b64encode(png).decode()
    return f'<p><img alt="{escape(name)}" src="data:image/png;base64,{data}"></p>'


def _asked(plan: Plan) -> str:
    study = plan.study
    entries = {"scenario": f"{plan.scenario['name']}, {_BACKENDS[study.backend]}"}
    if study.set:
        entries["set"] = "; ".join(f"{path} = {_value(value)}" for path, value in study.set.items())
    if study.points:
        entries["listed points"] = f"{len(study.points)}, of {', '.join(study.paths)}"
    for path, values in study.paired.items():
        entries[path] = f"{_values(values)}, paired"
    for path, values in study.grid.items():
        entries[path] = _values(values)
    for path, how in (study.draws.values if study.draws else {}).items():
        spec = how.model_dump(mode="json", exclude={"kind"})
        told = ", ".join(f"{key} {_value(value)}" for key, value in spec.items())
        entries[path] = f"{study.draws.count} draws, {how.kind}: {told}; seed {study.draws.seed}"  # type: ignore[union-attr]
    if study.seeds:
        entries["seeds"] = f"{study.seeds.start} to {study.seeds.stop - 1}"
    entries["mjsheaf"] = __version__
    return (
        "<dl>" + "".join(f"<dt>{escape(key)}</dt><dd>{escape(value)}</dd>" for key, value in entries.items()) + "</dl>"
    )


def _note(plan: Plan, table: "pa.Table") -> str:
    from mjsheaf.checking.finished import LEVEL

    rows = table.num_rows
    shown = f" The first {_MOST_ROWS} of {rows} are shown." if rows > _MOST_ROWS else ""
    statuses = table.column("status").to_pylist()
    example = statuses.index("finished") if "finished" in statuses else 0
    return (
        '<p class="note">Errors are the team\'s at the last sample, in m; those called late_ are the RMS over the last '
        f"half. {LEVEL} bound_ratio is the largest "
        f"measured |e| over the bound of Theorem 1, where that applies.{shown} "
        'All are in <a href="table.csv">table.csv</a> and <a href="table.parquet">table.parquet</a>, and with the '
        f"errors of each group in <code>runs/</code>. Look at one, here run {example}, with "
        f"<code>{escape(command_of(plan, plan.points[example]))}</code>.</p>"
    )


def command_of(plan: Plan, point: Point) -> str:
    """The command that does one run of a study by itself, for a shell in the study's directory."""
    # The scenario of a study with vehicles' own files is not kept there, as it could not name them.
    parts = ["mjsheaf", "run", "SCENARIO" if plan.files else "scenario.yaml", "--backend", plan.study.backend]
    for path, value in overrides_of(plan.job(point)).items():
        parts += ["--set", f"{path}={_as_yaml(value)}"]
    return shlex.join(parts)


def _as_yaml(value: Any) -> str:
    """A value as `--set` reads it."""
    plain = isinstance(value, str) and _WORD.fullmatch(value) and parse_yaml(value, "value") == value
    return str(value) if plain else json.dumps(value, ensure_ascii=False)


def _rows(table: "pa.Table") -> str:
    # A column without a value only widens the page.
    names = [name for name in table.column_names if any(map(_is_shown, table.column(name).to_pylist()))]
    numbers = {name for name in names if table.schema.field(name).type in ("int64", "double")}
    heads = (
        f"<th{_NUMBER * (name in numbers)}>{escape(name.replace('_', ' ') if name in MEASURES else name)}</th>"
        for name in names
    )
    lines = []
    for row in table.slice(0, _MOST_ROWS).to_pylist():
        cells = "".join(_cell(name, row[name]) for name in names)
        kind = "" if row["status"] == "finished" else ' class="bad"'
        lines.append(f"<tr{kind}>{cells}</tr>")
    body = "\n".join(lines)
    return (
        f'<div class="scroll"><table><thead><tr>{"".join(heads)}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>'
    )


def _is_shown(value: Any) -> bool:
    return value is not None and value != ""


def _cell(name: str, value: Any) -> str:
    if value is None:
        return "<td></td>"
    if isinstance(value, bool):
        return f"<td>{'yes' if value else 'no'}</td>"
    if isinstance(value, int | float):
        return f"<td{_NUMBER}>{value:.6g}</td>" if isinstance(value, float) else f"<td{_NUMBER}>{value}</td>"
    kind = ' class="message"' if name == "message" else ""
    return f"<td{kind}>{escape(str(value))}</td>"


def _values(values: list[Any]) -> str:
    shown = [_value(value) for value in values[:_MOST_VALUES]]
    more = f", ... ({len(values)} values)" if len(values) > _MOST_VALUES else ""
    return ", ".join(shown) + more


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else value if isinstance(value, str) else json.dumps(value)
