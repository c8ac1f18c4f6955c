"""The page of `mjsheaf check --full`: the answer, then every number of the record under its name in `--json`.

Each part of the record is a table. Its rows have the names, values and descriptions of the record's fields, so a new
field appears by itself. Fields that are null or empty are left out, as are sentences about null. A list of records is a
table with a row for each of them.
"""

from collections.abc import Iterator
from textwrap import wrap
from typing import Any

from pydantic import BaseModel
from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from mjsheaf.checking.record import CheckRecord
from mjsheaf.checking.screen import in_yaml, screen

Row = tuple[str, str, str]
"""Name, value, description."""

WIDTH = 120
"""Smallest width of the page."""

_FIRST = ("assumptions", "trial", "steady", "theorem", "region", "law", "links", "margins", "proposals")
_IN_HEADINGS = (
    "scenario",
    "ok",
    "problems",
    "notes",
    "drifts",
    "topology_fix",
    "topology_edges",
    "start",
    "events",
    "phases",
)
_SAID_ELSEWHERE = ("norm", "unit", "holds", "applies")  # by descriptions, `value`, `verdict`, `reason` and the screen
_RMS = "_per_agent"  # ends the names of fields that have an error as RMS over agents, not as norm of the whole team
_MOST_ROWS = 4  # of a list in a part of the record
_MOST_NAMES = 12  # in a row
_WIDEST_VALUE = 26  # characters; what is longer takes the place of its description


def report(record: CheckRecord) -> Group:
    """Return the record as a page for a terminal; of later phases, it has what differs from the phase before."""
    page = [Text("\n".join(screen(record, whole=True))), *_part(record, "", None)]
    for before, phase in zip(record.phases, record.phases[1:], strict=False):
        page += [
            Text(f"\nFrom {phase.start:g} s on: {', '.join(phase.events)}", style="bold"),
            *_part(phase, "", before),
        ]
    return Group(*page)


def _part(record: BaseModel, path: str, before: BaseModel | None) -> Iterator[Any]:
    """Yield the fields of a record and of the records in it as lines, then the lists of records in it as tables.

    Args:
        record: The record.
        path: Its name; empty for the whole record, whose records are parts of their own.
        before: Record of the same kind, from which differences alone are shown; None shows all.
    """
    rows: list[Row] = []
    parts: list[Any] = []
    left = [("  " if path else "", path, record, *field) for field in _fields(record, before)]
    while left:
        indent, above, owner, name, value, old = left.pop(0)
        inside = f"{above}.{name}".removeprefix(".")
        if not path and name in _IN_HEADINGS:
            continue
        if _is_list(value):
            parts += _list(value, inside, old, most=_MOST_ROWS) if path else [Text(), *_list(value, inside, old)]
        elif isinstance(value, BaseModel) and not path:
            parts += _part(value, name, old)
        elif isinstance(value, BaseModel):
            inner = [(f"{indent}  ", inside, value, *field) for field in _fields(value, old)]
            rows += [(indent + name, "", _meaning(value))] if inner else []
            left = inner + left
        else:
            rows.append(_row(indent, name, value, old, owner))
    if rows and path:
        yield from (Text(), _title(path, record))
    yield from _lines(rows)
    yield from parts


def _fields(record: BaseModel, before: BaseModel | None) -> list[tuple[str, Any, Any]]:
    """Return name, value and value before of the fields that are shown, the important first."""
    names = list(type(record).model_fields)
    shown = []
    for name in names:
        value, old = _plain(getattr(record, name)), _plain(getattr(before, name, None))
        gone = value is None and not _is_empty(old) and not isinstance(old, BaseModel)
        hidden = name in _SAID_ELSEWHERE or name.removesuffix(_RMS) in set(names) - {name}
        hidden |= _is_empty(value) and not gone
        if not hidden and (before is None or _text(value) != _text(old)):
            shown.append((name, value, old))
    order = {name: k for k, name in enumerate(_FIRST)}
    return sorted(shown, key=lambda field: order.get(field[0], len(order)))


def _plain(value: Any) -> Any:
    """Return a list of records with two fields as a mapping, other values as they are."""
    pairs = _is_list(value) and len(type(value[0]).model_fields) == 2
    return dict(tuple(inner for _, inner in one) for one in value) if pairs else value


def _is_empty(value: Any) -> bool:
    return value is None or (isinstance(value, str | list | tuple | dict) and not value)


def _is_list(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], BaseModel)


def _lines(rows: list[Row]) -> Iterator[Text]:
    """Yield rows as lines; a long value takes the place of its description, which is cut to the rest of its line."""
    names = max((len(name) for name, _, _ in rows), default=0)
    values = max((len(value) for _, value, _ in rows if len(value) <= _WIDEST_VALUE), default=0)
    for name, value, remark in rows:
        start = f"{name:<{names}}  "
        if len(value) > _WIDEST_VALUE:
            yield Text("\n".join(wrap(value, WIDTH, initial_indent=start, subsequent_indent=" " * len(start))))
        else:
            yield Text.assemble(f"{start}{value:<{values}}  ", (remark, "dim"), no_wrap=True, overflow="ellipsis")


def _row(indent: str, name: str, value: Any, old: Any, owner: BaseModel) -> Row:
    """Return a field with its description, or with its value before."""
    text = _text(value)
    meaning = _describe(type(owner), name)
    rms = getattr(owner, name + _RMS, None)
    if rms is not None:
        text += f" (RMS {_text(rms)})"
    if len(text) > _WIDEST_VALUE and not isinstance(value, str):
        text = f"{meaning}: {text}"
    return indent + name, text, meaning if _is_empty(old) else f"before: {_text(old)}"


def _describe(model: type[BaseModel], name: str) -> str:
    """Return the first clause of a field's description that is not about null."""
    clauses = (model.model_fields[name].description or "").split("; ")
    return next((clause for clause in clauses if not clause.startswith("null")), "")


def _meaning(record: BaseModel) -> str:
    """Return the first sentence of the description of a record."""
    return " ".join((type(record).__doc__ or "").split("\n\n")[0].split()).removesuffix(".")


def _title(path: str, record: BaseModel) -> Text:
    return Text.assemble((path, "bold"), "  ", (_meaning(record), "dim"), no_wrap=True, overflow="ellipsis")


def _list(records: list[BaseModel], path: str, before: list[BaseModel] | None, most: int = 100) -> Iterator[Any]:
    """Yield a table with a row for each of some alike records, and what its columns mean."""
    known = {_text(one) for one in before or ()}
    records = [one for one in records if _text(one) not in known]
    if not records:
        return
    shown = [{name: _text(value) for name, value, _ in _fields(one, None)} for one in records]
    for one, fields in zip(records, shown, strict=True):
        if "value" in fields:
            fields["value"] += f" {getattr(one, 'unit', '')}"
    names = [name for name in type(records[0]).model_fields if any(name in fields for fields in shown)]
    table = Table(*names, box=None, header_style="italic")
    for fields in shown[:most]:
        table.add_row(*(Text(fields.get(name, "")) for name in names))
    yield _title(path, records[0])
    yield table
    remarks = [f"and {len(records) - most} more"] if len(records) > most else []
    if not before:
        meanings = {name: _describe(type(records[0]), name) for name in names}
        remarks += [f"{name}: {meaning}" for name, meaning in meanings.items() if meaning]
    if remarks:
        yield Padding(Text("; ".join(remarks), "dim"), (0, 0, 0, 1))


def _text(value: Any) -> str:
    """Return a value in words."""
    if isinstance(value, BaseModel):
        value = value.model_dump(exclude_none=True)
    if isinstance(value, dict):
        said = dict.fromkeys(map(_text, value.values()))
        if len(said) == 1 and len(value) > 1:
            return f"{next(iter(said))} for {'both' if len(value) == 2 else f'all {len(value)}'}"
        value = [f"{key}: {in_yaml(inner)}" for key, inner in value.items()]
    if isinstance(value, list | tuple):
        more = f", and {len(value) - _MOST_NAMES} more" if len(value) > _MOST_NAMES else ""
        return ", ".join(map(_text, value[:_MOST_NAMES])) + more
    return in_yaml(value)
