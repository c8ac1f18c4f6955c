"""Gridded flow: currents and winds of forecast and reanalysis files, bilinear in space and linear in time.

Files are netCDF by the CF conventions. A variable is found by its standard name, or by the names that HYCOM and others
use. Longitude and latitude become x and y in the plane about an origin, an affine map: see `mjsheaf.io.geography`.

A bilinear function has its largest values at nodes. Its Jacobian is affine along each side of a cell, so that its norm,
a convex function, is largest at corners; both are linear in time between two times of the file. The bounds are
therefore exact for the interpolated flow.
"""

import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.ndimage import distance_transform_edt

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import InputError
from mjsheaf.io.geography import to_plane
from mjsheaf.io.section import NonNegative
from mjsheaf.jit import inline_jit, jit
from mjsheaf.media.bounded import Bounds
from mjsheaf.media.flow import FlowField
from mjsheaf.media.gusts import Exposure

if TYPE_CHECKING:
    import xarray as xr

_WATER = ("", "surface_", "surface_geostrophic_", "barotropic_")
_STANDARD = (
    (*(f"{of}eastward_sea_water_velocity" for of in _WATER), "sea_water_x_velocity", "eastward_wind", "x_wind"),
    (*(f"{of}northward_sea_water_velocity" for of in _WATER), "sea_water_y_velocity", "northward_wind", "y_wind"),
    ("upward_sea_water_velocity", "upward_air_velocity"),
)
_NAMES = (("uo", "water_u", "u10", "ugos", "u"), ("vo", "water_v", "v10", "vgos", "v"), ("wo", "w"))
_AXES = {
    "x": ({"longitude", "projection_x_coordinate"}, {"lon", "longitude", "x", "nav_lon"}),
    "y": ({"latitude", "projection_y_coordinate"}, {"lat", "latitude", "y", "nav_lat"}),
    "time": ({"time"}, {"time", "t", "valid_time"}),
    "depth": ({"depth", "height", "altitude"}, {"depth", "lev", "level", "height", "z"}),
}
_SPEEDS = {"m s-1", "m/s", "m s^-1", "m.s-1", "m s**-1", "meter/sec", "meters/second", "meter second-1", "ms-1"}
_ROUNDING = 1e-9


class GriddedFlow(FlowField):
    """A flow out of a netCDF file, and what is added to it."""

    kind: Literal["gridded"] = Field(description="data on a grid")
    dimension: Literal[2, 3] = Field(2, description="2: in the plane; 3 where the file has an upward velocity [-]")
    path: str = Field(description="netCDF file, from this file's directory")
    origin: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(
        description="latitude and longitude of the scenario's origin [deg]"
    )
    start: str | None = Field(
        None, description="time in the file at the scenario's time 0, as 2026-05-01T06:00; its first unless given"
    )
    depth: NonNegative = Field(0.0, description="depth of the water, or height in the air, of the flow [m]")

    @property
    def is_steady(self) -> bool:
        """False: the grid moves."""
        return False

    @property
    def grid(self) -> "Grid":
        """The file's data in the scenario's coordinates and time.

        Raises:
            InputError: The file cannot be read, or has no such data.
        """
        return read_grid(self.path, self.origin[0], self.origin[1], self.start, self.depth)


class Grid(NamedTuple):
    """Velocities on a grid.

    Attributes:
        x, y: Places of the nodes, shapes (X,) and (Y,), rising, m.
        time: Times, shape (T,), rising, s; one for a steady flow.
        velocity: Velocities, shape (T, Y, X, 3), m/s; NaN on land.
    """

    x: Array
    y: Array
    time: Array
    velocity: Array

    @property
    def box(self) -> str:
        """The box in words."""
        return f"x from {self.x[0]:.6g} to {self.x[-1]:.6g} m and y from {self.y[0]:.6g} to {self.y[-1]:.6g} m"


# -- files ---------------------------------------------------------------------------------------------------------


@lru_cache(8)
def read_grid(path: str, latitude: float, longitude: float, start: str | None, depth: float) -> Grid:
    """Read the velocities of a file; see `GriddedFlow`.

    Raises:
        InputError: The file cannot be read, or has no such data; the message begins with the field.
    """
    with open_flow(path) as data:
        parts = [find_velocity(data, k) for k in range(3)]
        if parts[0] is None or parts[1] is None:
            raise InputError(
                f"path: {path} has no velocities; expected two variables with the standard names "
                f"{_STANDARD[0][0]} and {_STANDARD[1][0]}, eastward_wind and northward_wind, or alike"
            )
        axes = {name: _axis(parts[0], name) for name in _AXES}
        time = _seconds(axes["time"], start, path)
        found = [_values(part, axes, depth) for part in parts if part is not None]
        x, y = to_plane(axes["y"].values, axes["x"].values, (latitude, longitude))
    velocity = np.zeros((*found[0].shape, 3))
    for k, part in enumerate(found):
        velocity[..., k] = part
    columns, rows = np.argsort(x), np.argsort(y)
    grid = Grid(x[columns], y[rows], time, np.ascontiguousarray(velocity[:, rows][:, :, columns]))
    if min(len(x), len(y)) < 2 or min(np.diff(grid.x).min(), np.diff(grid.y).min()) <= 0.0:
        raise InputError(f"path: {path} has {len(x)} longitudes and {len(y)} latitudes; expected two or more of each")
    return grid


def open_flow(path: str) -> "xr.Dataset":
    """Open a netCDF file.

    Raises:
        InputError: It cannot be read.
    """
    if not Path(path).is_file():
        raise InputError(f"path: there is no file {path}")
    import xarray as xr  # slow to import

    try:
        return xr.open_dataset(path)
    except Exception as error:  # of any of the libraries that read files
        raise InputError(f"path: {path} is no netCDF file that can be read: {error}") from None


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

    medium: Literal["water", "air"]
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
    with open_flow(path) as data:
        part = find_velocity(data, 0)
        if part is None:
            raise InputError(f"path: {path} has no velocities; expected variables as eastward_sea_water_velocity")
        x, y, time = (_axis(part, name) for name in ("x", "y", "time"))
        longitudes, latitudes = (np.sort(axis.values.astype(np.float64)) for axis in (x, y))
        start = None if time is None else str(np.datetime_as_string(time.values[0].astype("datetime64[s]")))
        is_wind = "wind" in part.attrs.get("standard_name", "") or str(part.name).lower().startswith("u10")
    grid = read_grid(path, float(np.mean(latitudes)), float(np.mean(longitudes)), None, 0.0)
    known = np.isfinite(grid.velocity).all(axis=(0, 3))
    away = distance_transform_edt(np.pad(known, 1), _spacing(grid))[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(away)), away.shape)
    if not known.any():
        raise InputError(f"path: the flow of {path} is nowhere known at all times")
    origin = round(float(latitudes[row]), 6), round(float(longitudes[column]), 6)
    grid = read_grid(path, *origin, None, 0.0)
    duration = float(grid.time[-1] - grid.time[0]) if len(grid.time) > 1 else math.inf
    medium: Literal["water", "air"] = "air" if is_wind else "water"
    return Proposal(medium, origin, start, duration, float(away[row, column] - max(_spacing(grid))), grid)


def _spacing(grid: Grid) -> tuple[float, float]:
    """Return the smallest spacing of a grid along y and x, m."""
    return float(np.diff(grid.y).min()), float(np.diff(grid.x).min())


def find_velocity(data: "xr.Dataset", component: int) -> "xr.DataArray | None":
    """Return the eastward (0), northward (1) or upward (2) velocity of a file, or None.

    Raises:
        InputError: Its unit is not m/s.
    """
    variables = [data[name] for name in data.data_vars]
    by_standard = [v for v in variables if v.attrs.get("standard_name") in _STANDARD[component]]
    by_name = [v for v in variables if str(v.name).lower() in _NAMES[component]]
    for found in (*by_standard, *by_name):
        unit = str(found.attrs.get("units", "m s-1"))
        if unit.lower() not in _SPEEDS:
            raise InputError(f"path: the unit of {found.name} is {unit!r}; expected m s-1")
        return found
    return None


def _axis(part: "xr.DataArray", name: str) -> Any:
    """Return the coordinate of a variable along an axis; None where it has none.

    Raises:
        InputError: The grid is curvilinear, or has no longitude or latitude.
    """
    standard, names = _AXES[name]
    for coordinate in part.coords.values():
        if coordinate.attrs.get("standard_name") in standard or str(coordinate.name).lower() in names:
            if coordinate.ndim > 1:
                raise InputError(
                    f"path: the grid is curvilinear ({coordinate.name} has {coordinate.ndim} dimensions); expected one "
                    "along longitude and latitude: interpolate it first, for example with cdo remapbil"
                )
            if coordinate.ndim == 1:
                return coordinate
    if name in ("x", "y"):
        raise InputError(f"path: {part.name} has no {'longitude' if name == 'x' else 'latitude'}")
    return None


def _seconds(axis: Any, start: str | None, path: str) -> Array:
    """Return the times of a file, s after `start`.

    Raises:
        InputError: `start` is no time, the file's times do not rise, or it has none and `start` is given.
    """
    if axis is None:
        if start is not None:
            raise InputError(f"start: {path} has no times; expected none")
        return np.zeros(1)
    try:
        zero = axis.values[0] if start is None else np.datetime64(start.removesuffix("Z"), "ns")
        times = (axis.values - zero) / np.timedelta64(1, "ns") * 1e-9
    except (ValueError, TypeError) as error:
        raise InputError(f"start: {start!r} or the file's times are no dates: {error}") from None
    if (np.diff(times) <= 0.0).any():
        raise InputError(f"path: the times of {path} do not rise")
    return np.asarray(times, dtype=np.float64)


def _values(part: "xr.DataArray", axes: dict[str, Any], depth: float) -> Array:
    """Return a component at a depth, shape (T, Y, X).

    Raises:
        InputError: The depth is not within the file's, or is given and the file has none.
    """
    if axes["depth"] is None and depth > 0.0:
        raise InputError(f"depth: the file has no axis of depth or height; expected none, not {depth:g} m")
    if axes["depth"] is not None:
        name = axes["depth"].dims[0]
        levels = np.abs(axes["depth"].values.astype(np.float64))
        if depth <= levels.min():
            part = part.isel({name: int(np.argmin(levels))})
        elif depth > levels.max():
            raise InputError(f"depth: {depth:g} m is beyond the file's; expected up to {levels.max():g} m")
        else:
            part = part.assign_coords({name: levels}).sortby(name).interp({name: depth})
    order = [axes["y"].dims[0], axes["x"].dims[0]]
    if axes["time"] is not None:
        order.insert(0, axes["time"].dims[0])
    others = [dim for dim in part.dims if dim not in order]
    part = part.isel(dict.fromkeys(others, 0)).transpose(*order)
    values = part.values.astype(np.float64)
    return values if axes["time"] is not None else values[None]


# -- compiled ------------------------------------------------------------------------------------------------------


class GridArrays(NamedTuple):
    """A gridded flow for compiled code: see `Grid`, and the vehicles that meet it.

    Attributes:
        met: 1 for vehicles that meet it, else 0, shape (V,).
    """

    met: IntArray
    x: Array
    y: Array
    time: Array
    velocity: Array


class GridState(NamedTuple):
    """State of a gridded flow.

    Attributes:
        time: Time by vehicle, shape (V,), s.
        place: Where each vehicle was when it last met a flow that is not known, shape (V, 2), m; NaN before.
    """

    time: Array
    place: Array


def new_grid_state(grid: GridArrays) -> GridState:
    """Return a state for `advance_grid` to write to."""
    return GridState(np.zeros(len(grid.met)), np.full((len(grid.met), 2), np.nan))


@jit
def advance_grid(grid, t, first, last, state):
    """Bring the flow about the vehicles from first up to last to time t, s."""
    for v in range(first, last):
        state.time[v] = t


@inline_jit
def _cell(axis, x):
    """Return the number of the interval of an axis that x lies in; -1 where it lies in none."""
    last = axis.shape[0] - 1
    if not axis[0] <= x <= axis[last]:
        return -1
    k = min(int((x - axis[0]) / (axis[last] - axis[0]) * last), last - 1)
    while x < axis[k]:
        k -= 1
    while x > axis[k + 1]:
        k += 1
    return k


@inline_jit
def _blend(level, i, j, f, g, n):
    """Return component n of a level (Y, X, 3) in a cell, at fractions f and g of its sides."""
    south = (1.0 - f) * level[j, i, n] + f * level[j, i + 1, n]
    north = (1.0 - f) * level[j + 1, i, n] + f * level[j + 1, i + 1, n]
    return (1.0 - g) * south + g * north


@jit
def grid_velocity(grid, state, v, x, y, z):
    """Return the velocity of the flow at a point, as three numbers, m/s; NaN outside the grid and on land."""
    if grid.met[v] == 0:
        return 0.0, 0.0, 0.0
    if np.isnan(x + y):  # what becomes of a vehicle that has met NaN
        return np.nan, np.nan, np.nan
    i, j = _cell(grid.x, x), _cell(grid.y, y)
    if i < 0 or j < 0:
        state.place[v, 0], state.place[v, 1] = x, y
        return np.nan, np.nan, np.nan
    f = (x - grid.x[i]) / (grid.x[i + 1] - grid.x[i])
    g = (y - grid.y[j]) / (grid.y[j + 1] - grid.y[j])
    last = grid.time.shape[0] - 1
    t = min(max(state.time[v], grid.time[0]), grid.time[last])
    k = 0 if last == 0 else _cell(grid.time, t)
    level = grid.velocity[k]
    east, north, up = _blend(level, i, j, f, g, 0), _blend(level, i, j, f, g, 1), _blend(level, i, j, f, g, 2)
    if last > 0:
        h = (t - grid.time[k]) / (grid.time[k + 1] - grid.time[k])
        level = grid.velocity[k + 1]
        east = (1.0 - h) * east + h * _blend(level, i, j, f, g, 0)
        north = (1.0 - h) * north + h * _blend(level, i, j, f, g, 1)
        up = (1.0 - h) * up + h * _blend(level, i, j, f, g, 2)
    if np.isnan(east + north + up):
        state.place[v, 0], state.place[v, 1] = x, y
    return east, north, up


def pack_grid(flow: GriddedFlow, met: IntArray, exposed: Exposure) -> GridArrays:
    """Pack a gridded flow for compiled code.

    Raises:
        InputError: The file does not cover the run's time, or where a vehicle begins.
    """
    grid = flow.grid
    first, last = exposed.start, exposed.end
    if len(grid.time) > 1:
        slack = _ROUNDING * (1.0 + abs(last))
        if first < grid.time[0] - slack or last > grid.time[-1] + slack:
            raise InputError(
                f"path: the file covers {grid.time[0]:.6g} to {grid.time[-1]:.6g} s of the scenario's time; expected "
                f"{first:.6g} to {last:.6g} s: choose another start, time.end or file"
            )
    return GridArrays(met, *grid)


def flow_at_start(grid: GridArrays, exposed: Exposure) -> Array:
    """Return the velocity that each vehicle meets where and when it begins, shape (V, 3), m/s.

    Raises:
        InputError: It is not known.
    """
    state, found = new_grid_state(grid), np.zeros((len(grid.met), 3))
    state.time[:] = exposed.start
    for v, place in enumerate(exposed.positions.tolist()):
        found[v] = grid_velocity(grid, state, v, *place)
        if why := describe_unknown(grid, state, v):
            raise InputError(f"path: {exposed.ids[v]} begins where no flow is known: {why}")
    return found


def bound_grid(grid: GridArrays) -> Bounds:
    """Return the largest values of a gridded flow and of its derivatives, which are at nodes and corners."""
    w = grid.velocity
    along_x = np.diff(w, axis=2) / np.diff(grid.x)[:, None]
    along_y = np.diff(w, axis=1) / np.diff(grid.y)[:, None, None]
    slope = 0.0
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            J = np.stack([along_x[:, rows], along_y[:, :, columns]], axis=-1)
            known = J[np.isfinite(J).all(axis=(-2, -1))]
            slope = max(slope, float(np.linalg.norm(known, ord=2, axis=(1, 2)).max(initial=0.0)))
    change, rate = 0.0, 0.0
    if len(grid.time) > 1:
        steps = np.diff(grid.time)
        change = float(np.nanmax(np.linalg.norm(np.diff(w, axis=0), axis=-1) / steps[:, None, None]))
        rate = math.pi / float(steps.min())
    met = (grid.met > 0).astype(np.float64)
    fastest = float(np.nanmax(np.linalg.norm(w, axis=-1)))
    return Bounds(met * fastest, met * change, met * slope, rate)


def describe_unknown(grid: GridArrays, state: GridState, v: int) -> str:
    """Return why the flow about vehicle v is not known, or an empty string."""
    x, y = state.place[v].tolist()
    if math.isnan(x + y):
        return ""
    at = f"({x:.6g}, {y:.6g}) m"
    if grid.x[0] <= x <= grid.x[-1] and grid.y[0] <= y <= grid.y[-1]:
        return f"it ran aground at {at}: the file of the flow has land there"
    box = Grid(grid.x, grid.y, grid.time, grid.velocity).box
    return f"it left the file of the flow at {at}, which covers {box}"
