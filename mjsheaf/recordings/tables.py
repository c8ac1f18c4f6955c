"""Positions in tables of text and in netCDF, and how columns of positions become rows t, x, y[, z].

Tables are CSV with commas, semicolons, tabs or blanks, read by the titles of its columns.

A title may end in a unit, in brackets or after an underscore: "t [s]", "time (ms)", "x_km", "#timestamp [ns]". Without
titles, three or four columns are t, x, y[, z], and eight whose last four are a unit quaternion are those of a TUM
trajectory: timestamp tx ty tz qx qy qz qw.

Of netCDF, a run's result.nc is read, and trajectories by the CF conventions. CF has four forms of trajectories: a
single one over time, several in an array, and several one after another, by their counts (contiguous ragged array) or
by an index of each sample (indexed ragged array).
"""

import csv
import re
from pathlib import Path

import cf_xarray  # noqa: F401  # adds the accessor `cf`
import numpy as np
import pandas as pd
import xarray as xr

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, in_field, listed, shortened
from mjsheaf.recordings import Axes, Rows, Selection
from mjsheaf.recordings.cf import decoded, factor, open_netcdf, to_plane


def arrange(seconds: Array, columns: dict[str, Array], selection: Selection, axes: Axes = "enu") -> Rows:
    """Return the rows of columns of positions.

    Args:
        seconds: Times, shape (T,), s.
        columns: x and y in m, east and north in m, or latitude and longitude in degrees, each of shape (T,), and z or
            up in m where there is a third coordinate. x, y and z are along `axes`, the others along their names.
        selection: Fields of the motion; their axes override `axes`.
        axes: Axes of x, y and z.

    Raises:
        InputError: Degrees have no origin, or a value is not a number.
    """
    in_plane = {"x", "y"} <= set(columns)
    geodetic = {"latitude", "longitude"} <= set(columns) and (not in_plane or selection.origin is not None)
    if geodetic:
        columns = _in_plane(columns, selection.origin)
    elif selection.origin is not None:
        raise InputError("origin: positions are in metres, not in degrees; leave it out")
    if selection.axes is not None and (geodetic or not in_plane):
        raise InputError("axes: the file names the directions of its coordinates; leave it out")
    up = columns.get("up", columns.get("z"))
    if {"east", "north"} <= set(columns):
        east, north = columns["east"], columns["north"]
    else:
        down = (selection.axes or axes) == "ned"
        east, north = (columns["y"], columns["x"]) if down else (columns["x"], columns["y"])
        if "z" in columns:
            up = 0.0 - columns["z"] if down else columns["z"]
    rows = np.column_stack([seconds, east, north, *([] if up is None else [up])])
    if not np.isfinite(rows).all():
        k = int((~np.isfinite(rows)).any(axis=1).argmax())
        raise InputError(f"position {k} is not a number")
    return list(rows.tolist())


def _in_plane(columns: dict[str, Array], origin: list[float] | None) -> dict[str, Array]:
    """Return columns with east and north, m, in place of latitude and longitude."""
    if origin is None:
        raise InputError(
            "origin: missing; positions are in degrees; expected the latitude and longitude of the scenario's origin, "
            "as in {kind: recorded, path: ..., origin: [59.9, 10.7]}"
        )
    latitude, longitude = columns["latitude"], columns["longitude"]
    for name, values, limit in (("latitude", latitude, 90.0), ("longitude", longitude, 360.0)):
        if (np.abs(values) > limit).any():
            raise InputError(f"{name} is {float(values[np.abs(values) > limit][0]):g}; expected degrees")
    if ((latitude == 0.0) & (longitude == 0.0)).any():
        raise InputError("a position is at 0, 0 degrees, as receivers write without a fix; expected it left out")
    east, north = to_plane(latitude, longitude, (origin[0], origin[1]))
    nearest = float(np.hypot(east, north).min(initial=np.inf))
    if _FARTHEST < nearest < np.inf:
        raise InputError(
            f"origin: the nearest position is {nearest / 1e3:.0f} km away from {origin[0]:g}, {origin[1]:g}; "
            f"expected latitude, then longitude, of a place within {_FARTHEST / 1e3:g} km"
        )
    height = columns.get("up", columns.get("z"))
    return {"east": east, "north": north} | ({} if height is None else {"up": height})


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
_FARTHEST = 1e6
"""Distance from the origin, m, beyond which no position of a track is taken to be in the origin's plane."""
_LATEST_RUN = 1e8
"""Time in s from which on the times of a table are those of a clock, not of a run: three years."""
_CLOCK = (1e9, 2.2e9)
"""Times of the UNIX clock that are recognised by their size, s: the years 2001 to 2039."""


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
    for a, b in (("x", "east"), ("z", "up"), ("z", "down"), ("up", "down")):
        if {a, b} <= set(found) and ("latitude" not in found or a == "up"):
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
        if not scale or (numbers[-1] - first) * scale > 3e7:  # no recording lasts a year
            raise InputError(f"times begin at {cells[0]}; expected their unit in the title, as in 'timestamp [us]'")
    base = first if first * scale >= _LATEST_RUN else 0
    counted = np.array([number - base for number in numbers], np.float64)
    return counted * scale if scale >= 1.0 else counted / round(1.0 / scale)


def _dates(cells: list[str]) -> Array:
    """Return how long after the first each date is, s."""
    try:
        dates = pd.to_datetime(cells, format="ISO8601", utc=True)
    except (ValueError, OverflowError):
        raise InputError(
            f"times begin at {shortened(cells[0])!r}; expected seconds, or dates as 2026-05-01T06:00:00"
        ) from None
    return np.asarray((dates - dates[0]).total_seconds(), np.float64)


_HEIGHTS = ("height", "altitude", "height_above_mean_sea_level", "height_above_reference_ellipsoid", "depth")
_NAMED = ("height", "altitude", "depth")  # that count by their name where the file has no attributes
_AXES: dict[str, tuple[tuple[str, ...], str]] = {
    "x": (("projection_x_coordinate",), "m"),
    "y": (("projection_y_coordinate",), "m"),
    "z": (_HEIGHTS, "m"),
    "latitude": (("latitude",), "degree"),
    "longitude": (("longitude",), "degree"),
}
"""Standard names and unit of each coordinate."""


def read_netcdf(path: Path, selection: Selection) -> Rows:
    """Read a run's result.nc, or a trajectory with CF's names."""
    selection.refuse("frame", "time")
    with open_netcdf(str(path)) as raw:
        dataset = xr.decode_cf(raw, decode_times=False, decode_timedelta=False)
        if "agent_position" in dataset:
            selection.refuse("axes", "origin")
            known = {str(x): (kind, k) for kind in ("agent", "target") for k, x in enumerate(dataset[kind].values)}
            if selection.topic not in known:
                expected = ", ".join(known)
                raise InputError(f"topic: {selection.topic!r} is no agent or target of this run; expected {expected}")
            kind, k = known[selection.topic]
            places = dataset[f"{kind}_position"].values[:, k]
            places = places[:, ~np.isnan(places).all(axis=0)]  # without z of a planar one
            return arrange(_seconds_along(raw["time"]), dict(zip("xyz", places.T, strict=False)), selection)
        found = {axis: raw[variable.name] for axis, variable in _find(dataset).items()}
        track = _of_trajectory(dataset, found, selection)
        seconds = _seconds_along(track["time"])
        columns = {name: _values(variable, name) for name, variable in track.items() if name != "time"}
    if "z" in columns and np.isnan(columns["z"]).all():
        del columns["z"]
    there = np.isfinite(seconds) & np.all([np.isfinite(values) for values in columns.values()], axis=0)
    if there.any():  # files have no values before a trajectory begins and after it ends
        inner = slice(int(there.argmax()), len(there) - int(there[::-1].argmax()))
        seconds, columns = seconds[inner], {name: values[inner] for name, values in columns.items()}
    if "since" in str(track["time"].attrs.get("units")):
        seconds = seconds - seconds[:1]
    return arrange(seconds, columns, selection)


def _find(dataset: xr.Dataset) -> dict[str, xr.DataArray]:
    """Return time and the coordinates of positions, found by CF standard name or unit, otherwise by name."""
    listing = dataset.set_coords(list(dataset.data_vars)).cf
    found = {}
    for axis, (standard, _) in _AXES.items():
        names = {name for word in standard for name in listing.standard_names.get(word, ())}
        names |= set(listing.coordinates.get(axis, ()))
        names = names or {
            name for name in dataset.variables if str(name).lower() in (axis, *(_NAMED if axis == "z" else ()))
        }
        names = {name for name in names if dataset[name].dims not in ((), (name,))}
        if len(names) > 1:
            raise InputError(f"{listed(sorted(map(str, names)))} are all {axis} by their standard names; expected one")
        if names:
            found[axis] = dataset[names.pop()]
    if not ({"x", "y"} <= set(found) or {"latitude", "longitude"} <= set(found)):
        raise InputError(
            "expected variables x, y, and in space z, over time, by these names or as projection_x_coordinate, "
            "projection_y_coordinate, height, altitude or depth; or latitude and longitude"
        )
    times = ["time"] if "time" in dataset else listing.standard_names.get("time", listing.coordinates.get("time", []))
    dims = next(found[axis].dims for axis in ("x", "latitude") if axis in found)
    if len(times) != 1 or not dataset[times[0]].dims or not set(dataset[times[0]].dims) <= set(dims):
        raise InputError(f"expected a coordinate time over {listed(list(map(str, dims)))}, as the positions")
    return {**found, "time": dataset[times[0]]}


def _of_trajectory(
    dataset: xr.Dataset, found: dict[str, xr.DataArray], selection: Selection
) -> dict[str, xr.DataArray]:
    """Return the variables over the samples of one trajectory."""
    dims = next(found[axis].dims for axis in ("x", "latitude") if axis in found)
    variables = [dataset[name] for name in dataset.variables]
    counts = next((v for v in variables if v.attrs.get("sample_dimension") in dims), None)
    index = next((v for v in variables if "instance_dimension" in v.attrs and v.dims == dims), None)
    ids = [dataset[name] for name in dataset.cf.cf_roles.get("trajectory_id", ())]
    apart = [v for v in ids if v.ndim == 1 and v.dims[0] not in dims]
    if counts is None and index is None and apart:  # CF requires an attribute; some files have counts alone
        length = found["time"].size
        counts = next(
            (v for v in variables if v.dims == apart[0].dims and v.dtype.kind in "iu" and v.sum() == length), None
        )
        if counts is None:
            raise InputError(
                f"{apart[0].name} names several trajectories; expected their counts or an index, as CF has it"
            )
    instance = None
    if counts is not None:
        instance = counts.dims[0]
    elif index is not None:
        instance = index.attrs["instance_dimension"]
    elif len(dims) > 1:
        of_ids = [dim for variable in ids for dim in variable.dims if dim in dims]
        instance = next((dim for dim in (*of_ids, *dims) if of_ids or dim not in found["time"].dims), dims[0])
    if instance is None:
        selection.refuse("topic")
        return found
    names = next((v for v in ids if instance in v.dims), dataset[instance])
    labels = [name.decode().strip() if isinstance(name, bytes) else str(name) for name in names.values.tolist()]
    k = labels.index(selection.choose(labels))
    samples: dict[object, object] = {instance: k}
    if counts is not None:
        ends = np.cumsum(counts.values.astype(np.int64))
        samples = {dims[0]: slice(int(ends[k - 1]) if k else 0, int(ends[k]))}
    elif index is not None:
        samples = {dims[0]: np.flatnonzero(index.values == k)}
    track = {axis: v.isel({dim: at for dim, at in samples.items() if dim in v.dims}) for axis, v in found.items()}
    for axis, variable in track.items():
        if variable.dims != track["time"].dims or variable.ndim != 1:
            raise InputError(
                f"{axis} is over {listed(list(map(str, variable.dims)))}; expected one trajectory over time"
            )
    return track


def _values(variable: xr.DataArray, axis: str) -> Array:
    """Return the values of a coordinate in m, upwards, or in degrees; NaN where they are missing."""
    unit = _AXES[axis][1]
    with in_field(f"{axis} ({variable.name})"):
        values = np.asarray(decoded(variable).values, np.float64)
        values = factor(variable.attrs.get("units", unit), unit) * values
    kind = variable.attrs.get("standard_name", str(variable.name).lower())
    sense = str(variable.attrs.get("positive", "down" if kind == "depth" else "up"))
    return 0.0 - values if axis == "z" and sense.lower() == "down" else values


def _seconds_along(time: xr.DataArray) -> Array:
    """Return times in s; differences from the first where they have a date, so that no digit is lost."""
    if time.ndim != 1:
        raise InputError("expected a coordinate time")
    word, _, rest = str(time.attrs.get("units", "s")).strip().partition(" ")
    with in_field("time"):
        scale = factor(word.lower(), "s")
        values = decoded(time).values
    if rest.lstrip().startswith("since") and len(values):
        values = values - values[np.isfinite(values).argmax()]
    return scale * np.asarray(values, np.float64)
