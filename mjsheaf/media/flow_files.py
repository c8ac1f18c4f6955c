"""Flow out of netCDF files by the CF conventions: variables, axes, units, times and missing data.

xarray decodes a file, cf-xarray finds its axes, pint converts units, cftime reads calendars, and pyproj projections.
Names of variables and axes count only where a file has no attributes. What has no clear meaning is refused, in one
line that names file, variable and choice. Places are those of `mjsheaf.recordings.cf`.
"""

import math
import re
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import cftime  # type: ignore[import-untyped]
import numpy as np
import xarray as xr
from scipy.ndimage import distance_transform_edt

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, expected, in_field, listed, shortened
from mjsheaf.files import digest_of
from mjsheaf.media.gridded import Grid, Medium, Reading, Request
from mjsheaf.recordings.cf import Plane, converts, coordinates_of, decoded, factor, open_netcdf, plane_of, text_of

FASTEST: dict[Medium | None, float] = {"water": 20.0, "air": 150.0, None: 150.0}
"""Speeds that no medium has, m/s. The fastest tidal currents run at 11 m/s (Saltstraumen), the fastest gust measured
at the ground was 113 m/s (Barrow Island, 1996) and a tornado's 135 m/s (Bridge Creek, 1999)."""

_COMPONENTS = {"eastward": 0, "x": 0, "northward": 1, "y": 1, "upward": 2}
_FLOWS = re.compile(
    r"(?P<water>(surface_|geostrophic_|surface_geostrophic_|barotropic_)?(\*_sea_water|sea_water_\*)_velocity)"
    r"|(?P<air>\*_(wind|air_velocity))"
)
_NAMES: tuple[tuple[str, str, Medium | None], ...] = (
    ("uo", "vo", "water"),
    ("water_u", "water_v", "water"),
    ("ugos", "vgos", "water"),
    ("u10", "v10", "air"),
    ("u100", "v100", "air"),
    ("u", "v", None),
)
"""Names of velocities in files without standard names: CMEMS, HYCOM, altimetry, ERA5."""
_LENGTHS = {"depth": "down", "height": "up", "altitude": "up", "height_above_mean_sea_level": "up"}
"""Standard names of distances from the surface, with their direction."""
_HEIGHTS = re.compile(r"(depth[tuvw]?|height|altitude)|(z|lev|levels?|plev|pressure.*|isobaric.*|sigma)", re.IGNORECASE)
"""Names of vertical axes in files without attributes; those of the first group are in metres."""
_DATE = re.compile(
    r"since\s+[-+]?\d+([-/])\d{1,2}\1\d{1,2}([T\s]\s*\d{1,2}(:\d{1,2}(:\d{1,2}(\.\d*)?)?)?)?"
    r"\s*(Z|UTC|GMT|[-+]\d{1,2}:?(\d{2})?)?\s*$",
    re.IGNORECASE,
)


@lru_cache(8)
def read_flow(asked: Request) -> Reading:
    """Read the velocities of a file. With a digest, the cache returns what the file held.

    Raises:
        InputError: The file cannot be read, has changed, or has no flow that is understood.
    """
    notes: list[str] = []
    with in_field(f"path: {asked.path}"), open_netcdf(asked.path, asked.sha256) as data:
        pair = _choose(data, asked)
        known = {name for name, _ in asked.select}
        parts = []
        for name in pair.names:
            part, used = _selected(_with_coordinates(data, name), asked.select)
            known -= used
            with in_field(name):
                parts.append(_read_part(data, part, asked, pair.medium or asked.medium, notes))
        if known:
            axes = sorted({str(dim) for name in pair.names for dim in data[name].dims})
            raise InputError(f"select: {pair.names[0]} has no axis {min(known)!r}; {expected(min(known), axes)}")
        return Reading(_merge(parts, pair, notes), pair.medium, tuple(dict.fromkeys(notes)))


# -- variables -----------------------------------------------------------------------------------------------------


class _Pair(NamedTuple):
    """Components of one flow.

    Attributes:
        names: Names of the variables, two or three.
        medium: Their medium; None if the file does not say it.
        along: Directions that they have: of the earth, of the grid's axes; None if the file does not say it.
    """

    names: tuple[str, ...]
    medium: Medium | None
    along: Literal["earth", "grid"] | None


def _meaning(variable: Any) -> tuple[str, int, Medium, Literal["earth", "grid"]] | None:
    """Return family, component, medium and direction of a velocity by its standard name; None for all else."""
    words = re.sub(r"_at_[uv]_location$", "", text_of(variable, "standard_name")).split("_")
    places = [k for k, word in enumerate(words) if word in _COMPONENTS]
    if len(places) != 1:
        return None
    word = words[places[0]]
    words[places[0]] = "*"
    found = _FLOWS.fullmatch("_".join(words))
    if found is None:
        return None
    medium: Medium = "water" if found["water"] else "air"
    return found[0], _COMPONENTS[word], medium, "grid" if word in "xy" else "earth"


def _statistic(variable: Any) -> str:
    """Return the statistic of a variable that is no flow, such as a variance; empty for values and means."""
    methods = re.sub(r"\(.*?\)", "", text_of(variable, "cell_methods")).lower()
    within = re.search(r"\b(?:within|over) (?:days|years)", methods)
    others = [method for method in re.findall(r":\s*([a-z_]+)\b(?!:)", methods) if method not in ("point", "mean")]
    return within[0] if within else others[0] if others else ""


def _pairs(data: xr.Dataset) -> list[_Pair]:
    """Return the horizontal flows of a file: those of standard names, or if there are none, by name."""
    families: dict[tuple[str, Medium, Literal["earth", "grid"]], tuple[list[str], list[str]]] = {}
    for name, variable in data.data_vars.items():
        found = _meaning(variable)
        if found and found[1] < 2 and not _statistic(variable):
            family, component, medium, along = found
            families.setdefault((family, medium, along), ([], []))[component].append(str(name))
    pairs = []
    for (_, medium, along), (us, vs) in families.items():
        both = [(u, v) for u in us for v in vs if len(us) == len(vs) == 1 or _are_named_alike(u, v)]
        pairs += [_Pair(names, medium, along) for names in both or [(u, v) for u in us for v in vs]]
    return pairs or _pairs_by_name(data)


def _pairs_by_name(data: xr.Dataset) -> list[_Pair]:
    plain = {
        str(n).lower(): str(n) for n, v in data.data_vars.items() if not (text_of(v, "standard_name") or _statistic(v))
    }
    pairs = []
    for u, v, medium in _NAMES:
        if u in plain and v in plain:
            about = f"{text_of(data[plain[u]], 'long_name')} {text_of(data[plain[v]], 'long_name')}".lower()
            said: Medium | None = (
                "air" if "wind" in about else "water" if re.search("current|water|sea", about) else None
            )
            pairs.append(_Pair((plain[u], plain[v]), medium or said, None))
    return pairs


def _are_named_alike(u: str, v: str) -> bool:
    """Return True if two names differ in one word or letter, as u10 and v10 do."""
    changes = (
        ("eastward", "northward"),
        ("east", "north"),
        ("zonal", "meridional"),
        ("u", "v"),
        ("x", "y"),
        ("U", "V"),
        ("X", "Y"),
    )
    return any(u[: at.start()] + b + u[at.end() :] == v for a, b in changes for at in re.finditer(a, u))


def _choose(data: xr.Dataset, asked: Request) -> _Pair:
    """Return the variables of the flow that fits a request.

    Raises:
        InputError: There is none, or several; the message names them.
    """
    if asked.variables:
        return _named(data, asked)
    pairs = _pairs(data)
    fits = [pair for pair in pairs if asked.medium is None or pair.medium in (None, asked.medium)]
    shown = [f"[{', '.join(pair.names)}]" for pair in fits or pairs]
    speeds = {str(n): v for n, v in data.data_vars.items() if converts(v.attrs.get("units"), "m s-1")}
    left = [f"{name} ({_statistic(v)})" for name, v in speeds.items() if _statistic(v)]
    bare = {str(n): v for n, v in data.data_vars.items() if "units" not in v.attrs and v.ndim > 1}
    speeds = {name: v for name, v in (speeds | bare).items() if not _meaning(v) and not _statistic(v)}
    others = f"; expected two of {listed(speeds)} in `variables`" if len(speeds) > 1 else ""
    if pairs and not fits:
        there = "wind" if pairs[0].medium == "air" else "current"
        raise InputError(
            f"has a {there}, {listed(shown)}, which fits flow.{pairs[0].medium}, but no flow of {asked.medium}{others}"
        )
    if len(fits) > 1:
        raise InputError(f"has several flows: {listed(shown)}; expected one of them in `variables`")
    if not fits:
        raise InputError(
            "has no velocities with the standard names eastward_sea_water_velocity and northward_sea_water_velocity, "
            "eastward_wind and northward_wind, or alike"
            + (f"; statistics are no flow: {listed(left)}" if left else others)
        )
    (pair,) = fits
    medium = pair.medium or asked.medium
    up = [str(name) for name, v in data.data_vars.items() if (m := _meaning(v)) and m[1] == 2 and m[2] == medium]
    up += [n for n in ("wo", "w") if n in speeds and not text_of(data[n], "standard_name")]
    up = [name for name in up if not _statistic(data[name])]
    return pair._replace(names=(*pair.names, *up[:1]))


def _named(data: xr.Dataset, asked: Request) -> _Pair:
    """Return the variables that a user names.

    Raises:
        InputError: One does not exist, or is no flow of the medium.
    """
    known = [str(name) for name, variable in data.data_vars.items() if converts(variable.attrs.get("units"), "m s-1")]
    meanings = []
    for k, name in enumerate(asked.variables):
        if name not in data.data_vars:
            raise InputError(f"variables: there is no {name!r}; {expected(name, known)}")
        if statistic := _statistic(data[name]):
            raise InputError(f"variables: {name} is no flow but a statistic: {statistic}")
        meaning = _meaning(data[name])
        if meaning is not None and meaning[1] != k:
            raise InputError(f"variables: {name} is {data[name].standard_name}; expected u, v and, in space, w")
        if meaning is not None and asked.medium not in (None, meaning[2]):
            raise InputError(f"variables: {name} is {data[name].standard_name}; expected it in flow.{meaning[2]}")
        meanings.append(meaning)
    u, v = meanings[:2]
    if u is not None and v is not None and (u[0], u[3]) != (v[0], v[3]):
        raise InputError(f"variables: {asked.variables[0]} and {asked.variables[1]} are of different flows")
    meaning = u or v
    return _Pair(asked.variables, meaning and meaning[2], meaning and meaning[3])


# -- axes ----------------------------------------------------------------------------------------------------------


class _Part(NamedTuple):
    """A component: times, places along the axes of its grid, values (T, Y, X) in m/s, and the grid's projection."""

    name: str
    time: Array
    x: Array
    y: Array
    values: Array
    plane: Plane


def _with_coordinates(data: xr.Dataset, name: str) -> xr.DataArray:
    """Return a variable, undecoded, with its decoded coordinates, also those that nothing but their units name."""
    variable = data[name]
    places = ("degree_north", "degrees_north", "degree_east", "degrees_east")
    named = text_of(variable, "coordinates").split() + text_of(data, "coordinates").split()
    near = [
        other
        for other, its in data.variables.items()
        if set(its.dims) <= set(variable.dims)
        and (
            other in named
            or other in variable.dims
            or text_of(its, "units") in places
            or text_of(its, "standard_name") == "time"
        )
        and other != name
    ]
    decoded = xr.decode_cf(data[near], decode_times=False, decode_timedelta=False).set_coords(near)
    return variable.drop_vars(list(variable.coords)).assign_coords(decoded.coords)


def _selected(part: xr.DataArray, select: tuple[tuple[str, float | str], ...]) -> tuple[xr.DataArray, set[str]]:
    """Return a variable at chosen places along some of its axes, and the names of those that it has.

    Raises:
        InputError: An axis does not have the value, to rounding.
    """
    used = set()
    for name, value in select:
        if name not in part.dims and name not in part.coords:
            continue
        used.add(name)
        axis = part[name] if name in part.coords else None
        values = np.arange(part.sizes[name]) if axis is None else np.atleast_1d(_readable(axis))
        if values.ndim > 1:
            raise InputError(f"select: {name} has {values.ndim} dimensions; expected an axis")
        if isinstance(value, str) or values.dtype.kind not in "fiu":
            equal = np.array([str(v).replace(" ", "T").startswith(str(value).replace(" ", "T")) for v in values])
        else:
            equal = np.isclose(values.astype(np.float64), value, rtol=1e-6, atol=0.0)
        if equal.sum() != 1:
            raise InputError(f"select: {name} has no {value!r}; expected one of {_shown(values)}")
        dims = (name,) if axis is None else axis.dims
        gone = [vertical for vertical, other in _vertical_axes(part).items() if other.dims == dims]
        part = part.isel(dict.fromkeys(dims, int(np.argmax(equal)))).drop_vars(gone)
    return part, used


def _readable(axis: xr.DataArray) -> Any:
    """Return the values of an axis, times as dates."""
    return _dates(axis) if "since" in text_of(axis, "units") else axis.values


def _shown(values: Any) -> str:
    return listed([f"{v:.6g}" if values.dtype.kind in "fiu" else str(v)[:19] for v in values])


def _refuse_axis(part: xr.DataArray, name: str) -> None:
    values = np.arange(part.sizes[name]) if name not in part.coords else np.atleast_1d(_readable(part[name]))
    units = f" in {text_of(part[name], 'units')}" if name in part.coords and text_of(part[name], "units") else ""
    example = values.ravel()[0]
    raise InputError(
        f"has an axis {name}{units}, which is no time, place or distance from the surface; expected one of its "
        f"values in `select`: {_shown(values.ravel())}, for example select: {{{name}: {_shown(np.array([example]))}}}"
    )


def _vertical_axes(part: xr.DataArray) -> dict[str, xr.DataArray]:
    """Return the axes of depth, height, pressure, density and layers, by their names."""
    vertical = coordinates_of(part, "vertical", "Z")
    others = coordinates_of(part, "X", "Y", "T", "time", "latitude", "longitude")

    def is_vertical(axis: xr.DataArray) -> bool:
        if axis.name in vertical:
            return True
        if axis.name in others or axis.dtype.kind not in "fiu":
            return False
        return (
            converts(axis.attrs.get("units"), "Pa")
            or converts(axis.attrs.get("units"), "m")
            or _HEIGHTS.fullmatch(str(axis.name)) is not None
        )

    return {str(c): part[c] for c in part.coords if is_vertical(part[c])}


def _at_depth(part: xr.DataArray, depth: float, medium: Medium | None, notes: list[str]) -> xr.DataArray:
    """Return the values of a component at a distance from the surface.

    Raises:
        InputError: Its vertical axis is not understood, or does not reach there.
    """
    axes = {name: axis for name, axis in _vertical_axes(part).items() if axis.ndim < 2}
    along_dims = {name: axis for name, axis in axes.items() if axis.ndim}
    deciding = along_dims or axes
    levels = {name: found for name, axis in deciding.items() if (found := _distances(axis, medium)) is not None}
    for name, axis in deciding.items():
        if not any(axis.dims == axes[other].dims for other in levels):
            _refuse_axis(part, name)
    if not levels:
        if depth > 0.0:
            raise InputError(f"depth: the file has no axis of depth or height; expected none, not {depth:g} m")
        return decoded(part)
    name = max(levels, key=lambda name: (axes[name].ndim, name in part.dims))
    along = levels[name]
    if depth > along.max():
        raise InputError(f"depth: {depth:g} m is beyond the file's; expected up to {along.max():g} m")
    if depth <= along.min():
        if along.min() - depth > 1.0:
            notes.append(f"the flow is that of {name} {along.min():g} m, the nearest to the surface in its file")
        part = decoded(part.isel(dict.fromkeys(axes[name].dims, int(np.argmin(along)))))
    else:  # between two levels
        dim = axes[name].dims[0]
        part = decoded(part).assign_coords({dim: along}).sortby(dim)
        if (np.diff(part[dim].values) <= 0.0).any():
            raise InputError(f"{name} has a value twice")
        part = part.interp({dim: depth})
    return part.drop_vars([other for other in axes if other in part.coords])


def _distances(axis: xr.DataArray, medium: Medium | None) -> Array | None:
    """Return the distances of the levels of an axis from the surface, m; None if they are something else.

    Raises:
        InputError: They are missing, or not where the medium is.
    """
    standard = text_of(axis, "standard_name")
    named = _HEIGHTS.fullmatch(str(axis.name))
    if standard and standard not in _LENGTHS:
        return None
    if "units" in axis.attrs:
        if not converts(axis.attrs.get("units"), "m"):
            return None
        values = factor(axis.attrs["units"], "m") * np.atleast_1d(axis.values).astype(np.float64)
    elif standard or (named and named[1]):
        values = np.atleast_1d(axis.values).astype(np.float64)
    else:
        return None
    positive = text_of(axis, "positive").lower()
    direction = positive if positive in ("up", "down") else _LENGTHS.get(standard, "")
    side = {"water": "down", "air": "up", None: direction}[medium]
    if not np.isfinite(values).all():
        raise InputError(f"{axis.name} has missing values")
    signed = -values if direction and direction != side else values
    if values.min() < 0.0 < values.max() or (signed.min() < 0.0 and (positive or direction not in ("", side))):
        raise InputError(
            f"{axis.name} goes from {values.min():g} to {values.max():g} m {direction or 'up or down'}; expected one "
            f"side of the surface, that of the {medium or 'medium'}"
        )
    return np.abs(values)


# -- values --------------------------------------------------------------------------------------------------------


def _read_part(data: xr.Dataset, part: xr.DataArray, asked: Request, medium: Medium | None, notes: list[str]) -> _Part:
    """Read a component at its depth.

    Raises:
        InputError: It is not understood, or has values that no flow has.
    """
    if not converts(part.attrs.get("units"), "m s-1"):
        unit = shortened(text_of(part, "units"), 50)
        why = f"the unit is {unit!r}; expected m s-1 or what converts to it" if unit else "has no units"
        fix = f"ncatted -a units,{part.name},o,c,'m s-1' {asked.path}"
        raise InputError(f"{why}; if its values are in m/s, write so into the file, for example by {fix}")
    to_speed = factor(part.attrs["units"], "m s-1")
    if 0 in part.shape:
        raise InputError("has no values")
    x, y, plane = plane_of(data, part, asked.origin)
    axis = _time_axis(part)
    moving = () if axis is None else axis.dims
    part = _at_depth(part, asked.depth, medium, notes)
    dims = (*moving, *y.dims, *x.dims)
    for dim in part.dims:
        if dim not in dims and part.sizes[dim] > 1:
            _refuse_axis(part, next((str(c) for c in part.coords if part[c].dims == (dim,)), str(dim)))
    part = part.isel({dim: 0 for dim in part.dims if dim not in dims}).transpose(*dims)
    dates = None if axis is None else _dates(_means_at_their_middle(data, part, axis, notes))
    values = part.values.astype(np.float64).reshape(-1, len(plane.y), len(plane.x))
    if to_speed != 1.0:
        values = to_speed * values
    if not np.isfinite(values).any():
        raise InputError("has no values")
    fastest = float(np.nanmax(np.abs(values)))
    if fastest > FASTEST[medium]:  # most such values stand for missing data
        k, j, i = np.unravel_index(int(np.nanargmax(np.abs(values))), values.shape)
        when = "" if dates is None else f" at {str(dates[k])[:19]}"
        raise InputError(
            f"is {values[k, j, i]:.4g} m/s{when}, {y.name} {y.values[j]:.6g}, {x.name} {x.values[i]:.6g}; expected at "
            f"most {FASTEST[medium]:g} m/s: what stands for missing data needs _FillValue, missing_value or valid_range"
        )
    if len(values) == 1:
        notes.append(
            f"the flow is steady: its file has no times{'' if dates is None else f' but {str(dates[0])[:19]}'}"
        )
    columns, rows = np.argsort(plane.x), np.argsort(plane.y)
    for of, along in ((x, plane.x[columns]), (y, plane.y[rows])):
        if len(along) < 2 or np.diff(along).min() <= 0.0:
            raise InputError(
                f"{of.name} has {len(along)} values, or one of them twice; expected two or more, each once"
            )
    values = values[:, rows][:, :, columns]
    return _Part(str(part.name), _seconds(dates, asked.start), plane.x[columns], plane.y[rows], values, plane)


# -- time ----------------------------------------------------------------------------------------------------------


def _time_axis(part: xr.DataArray) -> xr.DataArray | None:
    """Return the times of a variable, one for each or one for all; None if it has none.

    Times of a forecast are its reference time and the periods after it.

    Raises:
        InputError: Its times are no dates, of a climatology, or have two dimensions.
    """
    names = [*coordinates_of(part, "time", "T"), *(n for n in ("time", "t", "valid_time") if n in part.coords)]
    names += [str(c) for c in part.coords if "since" in text_of(part[c], "units")]
    axes = [part[n] for n in dict.fromkeys(names) if text_of(part[n], "standard_name") in ("", "time")]
    axes.sort(key=lambda axis: (-axis.ndim, axis.dims != (axis.name,)))
    if not axes:
        steps = [part[c] for c in part.coords if text_of(part[c], "standard_name") == "forecast_period"]
        zeros = [part[c] for c in part.coords if text_of(part[c], "standard_name") == "forecast_reference_time"]
        if not (steps and zeros and steps[0].ndim == 1 and zeros[0].ndim == 0):
            return None
        seconds = factor(steps[0].attrs.get("units"), "s") * steps[0].astype(np.float64)
        return seconds.assign_attrs(
            units=f"seconds since {_dates(zeros[0])[0]}", calendar=text_of(zeros[0], "calendar")
        )
    axis = axes[0]
    if axis.ndim > 1:
        raise InputError(
            f"{axis.name} has the axes {', '.join(map(str, axis.dims))}; expected a value of one of them in `select`"
        )
    if "climatology" in axis.attrs:
        raise InputError(f"{axis.name} is of a climatology, whose times are no dates; expected a flow over time")
    return axis


def _means_at_their_middle(data: xr.Dataset, part: xr.DataArray, axis: xr.DataArray, notes: list[str]) -> xr.DataArray:
    """Return the times of a variable, those of means over time in the middle of their bounds."""
    bounds = data.variables.get(text_of(axis, "bounds"))
    names = "|".join(re.escape(str(name)) for name in {axis.name, *axis.dims})
    if bounds is None or not re.search(rf"\b({names}): (\w+: )*mean", text_of(part, "cell_methods")):
        return axis
    if (own := text_of(bounds, "units")) not in ("", text_of(axis, "units")):
        raise InputError(
            f"{axis.bounds} is in {own!r}, and {axis.name} in {axis.units!r}; expected one unit, as CF has it"
        )
    middles = bounds.values.astype(np.float64).mean(axis=-1)
    if middles.shape != axis.shape or np.allclose(middles, axis.values.astype(np.float64), rtol=1e-12, atol=1e-9):
        return axis
    notes.append(
        f"values are means over the intervals {axis.bounds}, and are taken in their middle, not at {axis.name}"
    )
    return axis.copy(data=middles)


def _dates(axis: xr.DataArray) -> Any:
    """Return the dates of an axis, shape (T,), of numpy or of cftime.

    Raises:
        InputError: They are no dates.
    """
    units, calendar = text_of(axis, "units"), text_of(axis, "calendar") or "standard"
    unit, since, _ = units.partition("since")
    if not (since and converts(unit.lower(), "s")):
        raise InputError(
            f"{axis.name} has the unit {units!r}; expected seconds, minutes, hours or days since a date, such as "
            "'hours since 2026-05-01'"
        )
    if not _DATE.search(units):  # libraries take 01-05-2026 for January, and forget the zone in 2026-05-01 CET
        raise InputError(f"{axis.name} has no dates: unit {units!r}; expected such as 2026-05-01T06:00 or with +02:00")
    numbers = np.atleast_1d(axis.values)
    if numbers.dtype.kind not in "fiu" or not np.isfinite(numbers).all():
        raise InputError(f"{axis.name} has missing values; expected a time everywhere")
    attrs = {"units": units, "calendar": calendar}
    try:
        dates = xr.decode_cf(xr.Dataset(coords={"time": ("time", numbers, attrs)}))["time"].values
    except (ValueError, OverflowError):
        raise InputError(f"{axis.name} has no dates: unit {units!r}, calendar {calendar!r}") from None
    if dates.dtype.kind == "M" and np.isnat(dates).any():
        raise InputError(f"{axis.name} has missing values; expected a time everywhere")
    return dates


def _seconds(dates: Any, start: str | None) -> Array:
    """Return times, s after `start`, or after the first.

    Raises:
        InputError: `start` is no time, or times do not rise.
    """
    if dates is None and start is not None:
        raise InputError("start: the file has no times; expected none")
    if dates is None:
        return np.zeros(1)
    zero, text = dates[0], (start or "").removesuffix("Z")
    try:
        if text and not re.match(r"\d{4}(-|$)", text):
            raise ValueError("expected for example 2026-05-01T06:00")
        if text and dates.dtype.kind == "M" and not 1678 <= int(text[:4]) <= 2261:
            raise ValueError("centuries away from its times")
        if dates.dtype.kind == "M":
            zero = np.datetime64(text, "ns") if text else zero
            times = (dates - zero) / np.timedelta64(1, "ns") * 1e-9
        else:
            zero = cftime.num2date(0, f"seconds since {text}", zero.calendar) if text else zero
            times = np.array([(date - zero).total_seconds() for date in dates])
    except (ValueError, TypeError) as error:
        raise InputError(f"start: {start!r} is no date for this file: {error}") from None
    if (np.diff(times) <= 0.0).any():
        raise InputError("its times do not rise")
    return np.asarray(times, dtype=np.float64)


# -- grids ---------------------------------------------------------------------------------------------------------


def _merge(parts: list[_Part], pair: _Pair, notes: list[str], *, least_turn: float = 1e-3) -> Grid:
    """Return the grid of some components; for a C-grid, that of the cell centres.

    The axes of a grid that is turned by less than `least_turn`, rad, are taken as east and north.

    Raises:
        InputError: They have different times, or no places in common.
    """
    u, v = parts[:2]
    if any(len(p.time) != len(u.time) or np.abs(p.time - u.time).max() > 1e-3 for p in parts):
        raise InputError(
            f"{u.name} and {' or '.join(p.name for p in parts[1:])} have different times; expected the same"
        )
    x, y = u.x, u.y
    if not all(_are_equal(p.x, x) and _are_equal(p.y, y) for p in parts):
        x, y = (
            along[(along >= max(first)) & (along <= min(last))]
            for along, first, last in (
                (v.x, [p.x[0] for p in parts], [p.x[-1] for p in parts]),
                (u.y, [p.y[0] for p in parts], [p.y[-1] for p in parts]),
            )
        )
        if min(len(x), len(y)) < 2:
            raise InputError(f"{u.name} and {v.name} lie on different grids; expected one, or a C-grid")
        notes.append(f"{u.name} and {v.name} have places of their own (C-grid), and are interpolated to common ones")
    velocity = np.zeros((len(u.time), len(y), len(x), 3))
    for k, part in enumerate(parts):
        velocity[..., k] = _at_nodes(_at_nodes(part.values, part.x, x, 2), part.y, y, 1)
    plane = u.plane
    if plane.projected:
        local = plane.axes(*np.meshgrid(x, y))
        if pair.along is None and np.abs(local - np.eye(2)).max() > least_turn:
            raise InputError(
                f"{u.name} and {v.name} have no standard names, so that they may be along the axes of the grid "
                "or east and north; expected such names"
            )
        turned = np.linalg.inv(plane.turn) @ (np.linalg.inv(local) if pair.along == "earth" else np.eye(2))
        velocity[..., :2] = np.einsum(
            "...ij,t...j->t...i" if turned.ndim == 2 else "yxij,tyxj->tyxi", turned, velocity[..., :2]
        )
    return Grid(x, y, u.time, velocity, plane.turn)


def _are_equal(a: Array, b: Array) -> bool:
    """Return True for the same places but for rounding."""
    return len(a) == len(b) and bool(np.abs(a - b).max() < 1e-3 * np.diff(a).min())


def _at_nodes(values: Array, at: Array, to: Array, axis: int) -> Array:
    """Return values at places along an axis, those in between by linear interpolation; NaN next to land."""
    if _are_equal(at, to):
        return values
    if np.isin(to, at).all():
        return np.take(values, np.searchsorted(at, to), axis)
    dims = ("time", "y", "x")
    return xr.DataArray(values, {dims[axis]: at}, dims).interp({dims[axis]: to}).values


class Proposal(NamedTuple):
    """Section of a scenario for the flow of a file.

    Attributes:
        medium: 'water' or 'air'.
        origin: Latitude and longitude of the node that is farthest from land and from the edge of the grid, deg.
        start: First time of the file; None for a steady flow.
        duration: Time from the first to the last, s; infinite for a steady flow.
        clear: Distance from the origin within which the flow is known at all times, m.
        grid: The data about that origin.
    """

    medium: Medium
    origin: tuple[float, float]
    start: str | None
    duration: float
    clear: float
    grid: Grid


def propose(path: str) -> Proposal:
    """Choose the origin and start of a scenario in the flow of a file, at its smallest depth or height.

    Raises:
        InputError: The file cannot be read, has no such data, or is nowhere known at all times.
    """
    sha256 = digest_of(path)
    with in_field(f"path: {path}"), open_netcdf(path, sha256) as data:
        part = _with_coordinates(data, _choose(data, Request(path, sha256, (0.0, 0.0))).names[0])
        with in_field(str(part.name)):
            _, _, plane = plane_of(data, part, None)
        axis = _time_axis(part)
        start = None if axis is None or axis.ndim == 0 else str(_dates(axis)[0])[:19].replace(" ", "T")
    grid = read_flow(Request(path, sha256, plane.origin)).grid
    known = np.isfinite(grid.velocity).all(axis=(0, 3))
    away = distance_transform_edt(np.pad(known, 1), _spacing(grid))[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(away)), away.shape)
    if not known.any():
        raise InputError(f"path: the flow of {path} is nowhere known at all times")
    latitude, longitude = plane.geographic(grid.x[column], grid.y[row])
    origin = round(float(latitude), 6), round(float(longitude), 6)
    grid, medium, _ = read_flow(Request(path, sha256, origin))
    duration = float(grid.time[-1] - grid.time[0]) if len(grid.time) > 1 else math.inf
    clear = float(away[row, column] - max(_spacing(grid)))
    return Proposal(medium or "water", origin, start, duration, clear, grid)


def _spacing(grid: Grid) -> tuple[float, float]:
    """Return the smallest spacing of a grid along y and x, m."""
    return float(np.diff(grid.y).min()), float(np.diff(grid.x).min())
