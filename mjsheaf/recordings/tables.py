"""Positions in tables of text: CSV with commas, semicolons, tabs or blanks, read by the titles of its columns.

A title may end in a unit, in brackets or after an underscore: "t [s]", "time (ms)", "x_km", "#timestamp [ns]". Without
titles, three or four columns are t, x, y[, z], and eight whose last four are a unit quaternion are those of a TUM
trajectory: timestamp tx ty tz qx qy qz qw.
"""

import csv
import re
from pathlib import Path

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, in_field, listed, shortened
from mjsheaf.io.units import factor
from mjsheaf.recordings.selection import Rows, Selection, arrange

_COLUMNS = {
    "t": "t time times timestamp timestamps stamp datetime date_time basedatetime date_time_utc time_utc utc_time",
    "x": "x tx px pos_x x_pos x_position",
    "y": "y ty py pos_y y_pos y_position",
    "z": "z tz pz pos_z z_pos z_position",
    "east": "east easting",
    "north": "north northing",
    "up": "up alt altitude height elevation ele",
    "down": "down depth",
    "latitude": "lat latitude lat_deg latitude_deg",
    "longitude": "lon lng long longitude lon_deg longitude_deg",
    "vehicle": "mmsi trajectory trajectory_id drifter drifter_id track_id vehicle agent target device instrument "
    "platform platform_code",
    "stamp": "header_stamp",
    "px4": "xy_valid",
}
_TITLES = {title: column for column, titles in _COLUMNS.items() for title in titles.split()}
_POSITION = re.compile(r"(?!.*(?:err|cov|std|sigma|var))(?:.*_)?(?:p|pos|position|translation|point)_(?:.*_)?([xyz])")
_BRACKETS = re.compile(r"(.*?)\s*[\[(]\s*(.*?)\s*[\])]")
_SUFFIX = re.compile(r"(.+?)_?(s|sec|ms|us|ns|msec|usec|nsec|km|m|cm|mm|ft)")
_UNITS = {"t": "s", "latitude": "degree", "longitude": "degree"}  # of the others: m
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
_EXPECTED = (
    "expected a table of numbers with columns t, x, y, and in space z; or east, north, up; or lat, lon, alt; with "
    "units as in 't [s]', 'x [km]'"
)
_LATEST_RUN = 1e8
"""Time in s from which on the times of a table are those of a clock, not of a run: three years."""
_CLOCK = (1e9, 2.2e9)
"""Times of the UNIX clock that are recognised by their size, s: the years 2001 to 2039."""
_LONGEST = 3e7
"""Maximum duration of a table whose clock is recognised by its size, s."""


def read_table(path: Path, selection: Selection) -> Rows:
    """Read a table of numbers, with or without titles."""
    selection.refuse("frame", "time")
    lines, titles = _split(path)
    if not lines:
        return []
    found = _find_columns(titles) if titles else {}
    if len(titles) != len(lines[0][1]) or not _is_complete(found):
        titles = [] if all(map(_is_number, lines[0][1])) else lines.pop(0)[1]
        found = _find_columns(titles) if titles else _unnamed(lines[0][1])
    found["t"] = found.pop("stamp", found.get("t", (-1, "")))  # stamps count before times of reception, as in logs
    if found["t"][0] < 0 or not _is_complete(found):
        raise InputError(_EXPECTED)
    if not lines:
        return []
    if "px4" in found and selection.axes is None and "x" in found:
        raise InputError("axes: missing; columns with xy_valid are PX4's local position; expected ned, or enu if not")
    _require_one_meaning(found, titles, lines)
    lines = _of_vehicle(lines, found.pop("vehicle", None), selection)
    found.pop("px4", None)
    places = [place for name, (place, _) in found.items() if name != "t"]
    lines = [(k, row) for k, row in lines if any(place < len(row) and row[place] for place in places)]
    texts = {name: _cells(lines, place, name) for name, (place, _) in found.items()}
    columns = {name: _scale(name, found[name][1]) * np.array(texts[name], np.float64) for name in found if name != "t"}
    if "down" in columns:
        columns["up"] = 0.0 - columns.pop("down")
    return arrange(_seconds(texts["t"], found["t"][1]), columns, selection)


_PAIRS = (("x", "y"), ("east", "north"), ("latitude", "longitude"))
_Lines = list[tuple[int, list[str]]]
_Columns = dict[str, tuple[int, str]]
"""Column's place and unit, by what it is; the unit is empty unless given."""


def _split(path: Path) -> tuple[_Lines, list[str]]:
    """Return the numbered lines of a table as cells, and the titles in the last comment before them."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        numbered = [(k, line.strip("\r\n")) for k, line in enumerate(file, 1) if line.strip(" \t\r\n,;")]
    texts = [(k, line) for k, line in numbered if not line.lstrip().startswith(("#", "%"))]
    comments = [line.lstrip(" #%") for k, line in numbered if texts and k < texts[0][0]]
    delimiter = next((mark for mark in (";", "\t", ",") if texts and mark in texts[0][1]), None)

    def cells(line: str) -> list[str]:
        row = line.split() if delimiter is None else next(csv.reader([line], delimiter=delimiter))
        while row and not row[-1].strip():
            row.pop()
        return [cell.strip() for cell in row]

    return [(k, cells(line)) for k, line in texts], cells(comments[-1]) if comments else []


def _require_one_meaning(found: _Columns, titles: list[str], lines: _Lines) -> None:
    """Refuse tables that have two places or heights in a row, hemispheres in columns of their own, or longer rows.

    Raises:
        InputError: The message names the columns or the line.
    """
    for a, b in (("x", "east"), ("z", "up"), ("z", "down")):
        if {a, b} <= set(found) and "latitude" not in found:
            raise InputError(f"columns {a} and {b} are both there; expected one of them, so remove or rename the other")
    for number, row in lines:
        if titles and len(row) > len(titles):
            raise InputError(
                f"line {number}: has {len(row)} cells under {len(titles)} titles; expected points in numbers, as in "
                "1.5, and nothing between thousands"
            )
    for cells in zip(*(row for _, row in lines), strict=False) if "latitude" in found else ():
        if set(cells) in ({"S"}, {"W"}, {"N", "S"}, {"E", "W"}):
            raise InputError(
                f"a column has hemispheres, {listed(sorted(set(cells)))}; expected negative degrees instead"
            )


def _is_complete(found: _Columns) -> bool:
    """Return True if columns are those of a path."""
    return "t" in found and any(set(pair) <= set(found) for pair in _PAIRS)


def _find_columns(titles: list[str]) -> _Columns:
    """Return the columns whose titles are understood."""
    found: _Columns = {}
    for place, title in enumerate(titles):
        column, unit = _understand(title)
        if column and column in found:
            both = f"{titles[found[column][0]]!r} and {title!r}"
            raise InputError(f"columns {both} are both {column}; expected one, so rename the other")
        if column:
            found[column] = (place, unit)
    return found


def _understand(title: str) -> tuple[str, str]:
    """Return what a column is, and its unit; nothing if its title says neither."""
    brackets = _BRACKETS.fullmatch(title.strip(" #%\"'"))
    name, unit = brackets.groups() if brackets else (title, "")
    words = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_").removeprefix("field_")  # of rostopic echo -p
    suffix = _SUFFIX.fullmatch(words)
    for candidate, ending in ((words, unit), (suffix[1], suffix[2]) if suffix and not unit else ("", "")):
        position = _POSITION.fullmatch(candidate)
        column = position[1] if position else _TITLES.get(candidate, "")
        apart = candidate == words or words[len(candidate)] == "_"
        if column and (apart or (column == "t" and ending != "s")):  # nm is no north in m, timestamps no s
            return column, ending[:2] if ending.endswith("sec") and len(ending) == 4 else ending
    return "", ""


def _unnamed(first: list[str]) -> _Columns:
    """Return the columns of a table without titles, from their number."""
    numbers = [float(cell) for cell in first]
    if len(first) == 8 and abs(float(np.linalg.norm(numbers[4:])) - 1.0) < 0.01:
        return {name: (place, "") for place, name in enumerate("txyz")}
    if len(first) not in (3, 4):
        raise InputError(f"has {len(first)} columns without titles; {_EXPECTED}; without titles, three or four columns")
    return {name: (place, "") for place, name in enumerate("txyz"[: len(first)])}


def _of_vehicle(lines: _Lines, column: tuple[int, str] | None, selection: Selection) -> _Lines:
    """Return the lines of the vehicle that the motion selects, in a table that has several."""
    if column is None:
        selection.refuse("topic")
        return lines
    names = [row[column[0]] if column[0] < len(row) else "" for _, row in lines]
    chosen = selection.choose(sorted(set(names)))
    return [line for line, name in zip(lines, names, strict=True) if name == chosen]


def _cells(lines: _Lines, place: int, name: str) -> list[str]:
    """Return a column's cells, which are numbers, or dates in the column of time."""
    dated = name == "t" and bool(lines) and place < len(lines[0][1]) and not _is_number(lines[0][1][place])
    for number, row in lines:
        if place < len(row) and _DECIMAL_COMMA.fullmatch(row[place]):
            raise InputError(f"line {number}: {row[place]!r} has a decimal comma; expected points, as in 1.5")
        if place >= len(row) or not (dated or _is_number(row[place])):
            raise InputError(f"line {number}: expected a number in each column, not {shortened(','.join(row))!r}")
    return [row[place] for _, row in lines]


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _scale(name: str, unit: str) -> float:
    """Return the factor of a column into metres or degrees."""
    with in_field(f"column {name}"):
        return factor(unit, _UNITS.get(name, "m")) if unit else 1.0


def _seconds(cells: list[str], unit: str) -> Array:
    """Return times in s: those of the run, or of a clock, which count from the first."""
    if not cells or not _is_number(cells[0]):
        return _dates(cells)
    whole = all(re.fullmatch(r"[-+]?\d+", cell) for cell in cells)  # nanoseconds of a clock exceed a float's digits
    numbers = [int(cell) if whole else float(cell) for cell in cells]
    first = numbers[0]
    scale = _scale("t", unit)
    if not unit and first >= _LATEST_RUN:
        scale = next((k for k in (1.0, 1e-3, 1e-6, 1e-9) if _CLOCK[0] <= first * k < _CLOCK[1]), 0.0)
        if not scale or (numbers[-1] - first) * scale > _LONGEST:
            raise InputError(f"times begin at {cells[0]}; expected their unit in the title, as in 'timestamp [us]'")
    base = first if first * scale >= _LATEST_RUN else 0
    counted = np.array([number - base for number in numbers], np.float64)
    return counted * scale if scale >= 1.0 else counted / round(1.0 / scale)


def _dates(cells: list[str]) -> Array:
    """Return how long after the first each date is, s."""
    import pandas as pd

    try:
        dates = pd.to_datetime(cells, format="ISO8601", utc=True)
    except (ValueError, OverflowError):
        raise InputError(
            f"times begin at {shortened(cells[0])!r}; expected seconds, or dates as 2026-05-01T06:00:00"
        ) from None
    return np.asarray((dates - dates[0]).total_seconds(), np.float64)
