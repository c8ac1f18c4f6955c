"""Gridded flow: currents and winds of forecast and reanalysis files, bilinear in space and linear in time.

`mjsheaf.media.flow_files` reads the files.

A bilinear function has its largest values at nodes. Its Jacobian is affine along each side of a cell, so that its norm,
a convex function, is largest at corners; both are linear in time between two times of the file. The bounds are
therefore exact for the interpolated flow.
"""

import math
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, IntArray, Take
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.errors import InputError, in_field
from mjsheaf.files import digest_of
from mjsheaf.media.flow import FlowField
from mjsheaf.media.varying import COMPILED, Bounds, Compiled, Exposure
from mjsheaf.section import NonNegative, Number

Medium = Literal["water", "air"]

_ROUNDING = 1e-9
_MEDIA: dict[str, Medium] = {"wind": "air", "current": "water"}
"""Medium of a flow field by its name; those by role have none."""


class Grid(NamedTuple):
    """Velocities on a grid.

    Attributes:
        x, y: Places of the nodes along the axes of the grid, shapes (X,) and (Y,), rising, m.
        time: Times, shape (T,), rising, s; one for a steady flow.
        velocity: Velocities along the axes of the plane, shape (T, Y, X, 3), m/s; NaN on land.
        turn: Matrix from a place in the plane to one along the axes of the grid, shape (2, 2).
    """

    x: Array
    y: Array
    time: Array
    velocity: Array
    turn: Array

    @property
    def box(self) -> str:
        """The box in words."""
        along = "" if np.array_equal(self.turn, np.eye(2)) else ", along the axes of its grid"
        return f"x from {self.x[0]:.6g} to {self.x[-1]:.6g} m and y from {self.y[0]:.6g} to {self.y[-1]:.6g} m{along}"


class Request(NamedTuple):
    """Parameters of reading a file; see the fields of `mjsheaf.media.gridded.GriddedFlow`.

    Attributes:
        sha256: Digest of the content that is meant; None for the present one.
        medium: Medium of the section; None where vehicles of both meet it.
    """

    path: str
    sha256: str | None
    origin: tuple[float, float]
    start: str | None = None
    depth: float = 0.0
    variables: tuple[str, ...] = ()
    select: tuple[tuple[str, float | str], ...] = ()
    medium: Medium | None = None


class Reading(NamedTuple):
    """A grid, the medium that its variables are of, and notes on choices that a user may not expect."""

    grid: Grid
    medium: Medium | None
    notes: tuple[str, ...]


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
    variables: Annotated[list[str], Field(min_length=2, max_length=3)] | None = Field(
        None, description="names of the variables along x, y and, in space, z, where a file has several flows"
    )
    select: dict[str, Number | str] = Field(
        {}, description="values of further axes by their names, such as {level: 1000}, in the file's units [-]"
    )
    sha256: str | None = Field(
        None, description="SHA-256 of the file, which a run records: another content is refused; none: any"
    )

    @property
    def is_steady(self) -> bool:
        """False: the grid moves."""
        return False

    @model_validator(mode="before")
    @classmethod
    def _with_digest(cls, fields: Any) -> Any:
        """Add the digest of the file, so that the flow stays the one that it was when the scenario was made."""
        if isinstance(fields, dict) and isinstance(fields.get("path"), str) and fields.get("sha256") is None:
            with in_field("path"):
                return {**fields, "sha256": digest_of(fields["path"])}
        return fields

    def recorded(self, name: str, met: Exposure) -> tuple[list[Any], Array]:
        """Return the grid, and the velocity of the medium where and when each vehicle begins, shape (V, 3), m/s.

        Raises:
            InputError: The file does not cover the run's time, or where a vehicle begins.
        """
        grid = self.read(_MEDIA.get(name)).grid
        slack = _ROUNDING * (1.0 + abs(met.end))
        if len(grid.time) > 1 and not grid.time[0] - slack <= met.start <= met.end <= grid.time[-1] + slack:
            raise InputError(
                f"path: the file covers {grid.time[0]:.6g} to {grid.time[-1]:.6g} s of the scenario's time; expected "
                f"{met.start:.6g} to {met.end:.6g} s: choose another start, time.end or file"
            )
        arrays = GridArrays(met.met.astype(np.int64), grid, not np.array_equal(grid.turn, np.eye(2)))
        state, found = arrays.new_state(), np.zeros(met.positions.shape)
        for v, place in enumerate(met.positions.tolist()):
            found[v] = grid_velocity(arrays, state, met.start, v, *place)
            if why := describe_unknown(arrays, state, v):
                raise InputError(f"path: {met.ids[v]} begins where no flow is known: {why}")
        return [arrays], met.wind + found

    def read(self, medium: Medium | None) -> Reading:
        """Return the file's data in the scenario's coordinates and time.

        Args:
            medium: Medium of the section; None where vehicles of both meet the flow.

        Raises:
            InputError: The file cannot be read, has changed, or has no such data; the message begins with the field.
        """
        from mjsheaf.media.flow_files import read_flow  # which loads libraries that take long

        latitude, longitude = self.origin
        select = tuple(self.select.items())
        variables = tuple(self.variables or ())
        return read_flow(
            Request(self.path, self.sha256, (latitude, longitude), self.start, self.depth, variables, select, medium)
        )


# -- compiled ------------------------------------------------------------------------------------------------------


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
def grid_velocity(flow, state, t, v, x, y, z):
    """Return the velocity of the flow at a point, as three numbers, m/s; NaN outside the grid and on land."""
    grid = flow.grid
    if flow.met[v] == 0:
        return 0.0, 0.0, 0.0
    if np.isnan(x + y):  # what becomes of a vehicle that has met NaN
        return np.nan, np.nan, np.nan
    a, b = x, y
    if flow.turned:
        a = grid.turn[0, 0] * x + grid.turn[0, 1] * y
        b = grid.turn[1, 0] * x + grid.turn[1, 1] * y
    i, j = _cell(grid.x, a), _cell(grid.y, b)
    if i < 0 or j < 0:
        state[v, 0], state[v, 1] = x, y
        return np.nan, np.nan, np.nan
    f = (a - grid.x[i]) / (grid.x[i + 1] - grid.x[i])
    g = (b - grid.y[j]) / (grid.y[j + 1] - grid.y[j])
    last = grid.time.shape[0] - 1
    t = min(max(t, grid.time[0]), grid.time[last])
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
        state[v, 0], state[v, 1] = x, y
    return east, north, up


class GridArrays(NamedTuple):
    """A gridded flow for compiled code.

    Attributes:
        met: 1 for vehicles that meet it, else 0, shape (V,).
        grid: Its velocities.
        turned: True if the axes of the grid are not those of the plane.
    """

    met: IntArray
    grid: Grid
    turned: bool

    def new_state(self, take: Take = np.zeros) -> Array:
        """Return where each vehicle last met a flow that is not known, shape (V, 2), m; NaN before."""
        state = take((len(self.met), 2))
        state[:] = np.nan
        return state

    def bound(self) -> Bounds:
        """Return the largest values of a gridded flow and of its derivatives, which are at nodes and corners."""
        x, y, time, w, turn = self.grid
        along_x = np.diff(w, axis=2) / np.diff(x)[:, None]
        along_y = np.diff(w, axis=1) / np.diff(y)[:, None, None]
        slope = 0.0
        for rows in (slice(None, -1), slice(1, None)):
            for columns in (slice(None, -1), slice(1, None)):
                J = np.stack([along_x[:, rows], along_y[:, :, columns]], axis=-1)
                if self.turned:
                    J = J @ turn
                a, b, c = (np.einsum("...i,...i", J[..., m], J[..., n]) for m, n in ((0, 0), (0, 1), (1, 1)))
                squares = 0.5 * (a + c) + np.hypot(0.5 * (a - c), b)  # of the norm: largest eigenvalues of J^T J
                slope = max(slope, math.sqrt(np.fmax.reduce(squares, axis=None, initial=0.0)))  # but for NaN
        change, rate = 0.0, 0.0
        if len(time) > 1:
            steps = np.diff(time)
            change = float(np.nanmax(np.linalg.norm(np.diff(w, axis=0), axis=-1) / steps[:, None, None]))
            rate = math.pi / float(steps.min())
        met = (self.met > 0).astype(np.float64)
        fastest = float(np.nanmax(np.linalg.norm(w, axis=-1)))
        return Bounds(met * fastest, met * change, met * slope, rate)


COMPILED[GridArrays] = Compiled(grid_velocity)


def describe_unknown(flow: GridArrays, state: Array, v: int) -> str:
    """Return why the flow about vehicle v is not known, or an empty string."""
    x, y = state[v].tolist()
    if math.isnan(x + y):
        return ""
    at = f"({x:.6g}, {y:.6g}) m"
    grid = flow.grid
    a, b = grid.turn @ (x, y)
    if grid.x[0] <= a <= grid.x[-1] and grid.y[0] <= b <= grid.y[-1]:
        return f"it ran aground at {at}: the file of the flow has land there, or no data"
    return f"it left the file of the flow at {at}, which covers {grid.box}"
