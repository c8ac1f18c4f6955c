"""The medium around the vehicles, for compiled code: parameters, state, velocity and surface.

`MediumArrays` holds the parameters, which are constant during a phase of a run; `MediumState` holds everything that
depends on time. A loop calls `hold` at each sample, `advance` once for each time and range of vehicles, and then
`medium_velocity` and `surface_about` at any number of points. A moving part of the medium extends both structures, and
loops need no change. Several threads advance ranges of vehicles at once, so each vehicle has a separate state. The
state is a function of time alone, so a run can continue at any time with a new one.

The moving parts are a tuple, each a named tuple: see `mjsheaf.media.varying.Moving` and `mjsheaf.compile.jit`.

`medium` returns the medium of a scenario as an object that gives velocities and surface at any times and places, as in
a run.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arguments import require_scenario
from mjsheaf.arrays import Array, BoolArray, IntArray, Take
from mjsheaf.compile.jit import for_each, has_any, inline_jit, jit
from mjsheaf.errors import InputError, expected, in_field
from mjsheaf.media.flow import FlowField, flow_velocity
from mjsheaf.media.gridded import GridArrays, describe_unknown
from mjsheaf.media.gusts import FrozenArrays, GustArrays
from mjsheaf.media.varying import (
    COMPILED,
    Bounds,
    Compiled,
    Exposure,
    HarmonicArrays,
    disturbance_velocity,
    evaluate_sines,
    pack,
)
from mjsheaf.media.waves import WaveArrays
from mjsheaf.vectors import add

if TYPE_CHECKING:
    from mjsheaf.loop.system import System
    from mjsheaf.scenario import Scenario


Parts = tuple[Any, ...]
"""Parameters or states of the parts of a medium."""


WITHOUT_MEAN = (GustArrays, FrozenArrays, WaveArrays)
"""Kinds whose velocity at a fixed place has no mean."""


def bounds_of(parts: Parts, vehicles: int) -> Bounds:
    """Return the bounds of all parts together."""
    bounds = [part.bound() for part in parts]
    speed, change, slope = (
        sum((getattr(one, name) for one in bounds), np.zeros(vehicles)) for name in ("speed", "change", "slope")
    )
    return Bounds(speed, change, slope, max((one.rate for one in bounds), default=0.0))


def unknown_flow(parts: Parts, states: Parts, v: int) -> str:
    """Return why vehicle v met a flow that is not known, or an empty string."""
    for part, state in zip(parts, states, strict=True):
        if isinstance(part, GridArrays) and (why := describe_unknown(part, state, v)):
            return why
        if isinstance(part, WindArrays) and (why := unknown_flow(part.air.parts, state, v)):
            return why
    return ""


def of_kind(parts: Parts, kind: type) -> list[Any]:
    """Return the parts of a kind."""
    return [part for part in parts if isinstance(part, kind)]


hold_parts = for_each(lambda kind: COMPILED[kind].hold)
"""Called with (parts, states, (), t, first, last)."""


@inline_jit
def _add_surface(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


add_velocities = for_each(lambda kind: COMPILED[kind].velocity, add)
"""Called with (parts, states, velocity, t, v, x, y, z): returns the velocity and those of all parts, m/s."""

add_surfaces = for_each(lambda kind: COMPILED[kind].surface, _add_surface)
"""Called with (parts, states, surface, t, v, x, y): returns the surface (elevation, slopes, rate) and those of all."""

_have_surface = has_any(lambda kind: COMPILED[kind].surface)


@inline_jit
def upright_in(parts, surface, R):
    """Return the components of a surface's normal along x and y of a body with the attitude R (9,)."""
    if _have_surface(parts):
        return R[6] - surface[1] * R[0] - surface[2] * R[3], R[7] - surface[1] * R[1] - surface[2] * R[4]
    return R[6], R[7]


class MediumArrays(NamedTuple):
    """Parameters of the medium about V vehicles.

    Attributes:
        agents: Number of agents, which are the first of the vehicles.
        planar: True for vehicles that live in the plane, shape (V,).
        kernels: Tables of all flow fields, one below the other.
        rows: First row of `kernels` that each vehicle meets, and the row after the last, shape (V, 2).
        harmonics: Harmonics of the disturbances.
        level: Height of the undisturbed surface, m.
        parts: Parameters of what moves; see `mjsheaf.media.medium`.
    """

    agents: int
    planar: BoolArray
    kernels: Array
    rows: IntArray
    harmonics: HarmonicArrays
    level: float
    parts: Parts = ()


class MediumState(NamedTuple):
    """State of the medium at the time of the last call of `advance`.

    Attributes:
        sines: Sines of the disturbances' harmonics, shape (D K,).
        time: That time by vehicle, shape (V,), s.
        parts: States of what moves.
    """

    sines: Array
    time: Array
    parts: Parts = ()


def pack_medium(
    agents: int, planar: BoolArray, flows: Sequence[FlowField], field: IntArray, level: float
) -> MediumArrays:
    """Pack flow fields for compiled code, without disturbances and parts; vehicle v meets the flow field field[v]."""
    ends = np.cumsum([0, *(len(flow.table) for flow in flows)])
    rows = ends[field[:, None] + [0, 1]].astype(np.int64)
    calm = pack(np.zeros((len(field), 0, 5)))
    return MediumArrays(agents, planar, np.vstack([flow.table for flow in flows]), rows, calm, level)


def pack_parts(
    flows: Sequence[FlowField], names: Sequence[str], field: IntArray, planar: BoolArray, exposed: Exposure
) -> Parts:
    """Pack what moves for compiled code.

    Args:
        flows: Flow fields.
        names: Their names, which name their random streams.
        field: Number of the flow field that each vehicle meets, shape (V,).
        planar: True for vehicles that live in the plane, shape (V,).
        exposed: All vehicles.

    Raises:
        InputError: A frozen field of gusts would be too long, or a file does not cover the run; the message begins with
            the field.
    """
    parts: list[Any] = []
    for k, (flow, name) in enumerate(zip(flows, names, strict=True)):
        met = exposed._replace(met=exposed.met & (field == k))
        with in_field(name):
            parts += flow.parts(name, met, np.where(planar, met.met.astype(np.int64), 2 * exposed.met))
    return tuple(parts)


def undisturbed(medium: MediumArrays, without: tuple[type, ...] = ()) -> MediumArrays:
    """Return a medium without disturbances.

    Args:
        medium: The medium.
        without: Kinds of parts that no vehicle meets any more.

    Returns:
        A medium of the same types, so that nothing is compiled again.
    """
    calm = medium.harmonics._replace(amplitude=np.zeros_like(medium.harmonics.amplitude))
    parts = [part._replace(met=part.met * (type(part) not in without)) for part in medium.parts]
    return medium._replace(harmonics=calm, parts=tuple(parts))


def new_state(medium: MediumArrays, take: Take = np.zeros) -> MediumState:
    """Return a state for `advance` to write to."""
    return MediumState(
        take(len(medium.harmonics.rate)),
        take(len(medium.planar)),
        tuple(part.new_state(take) if hasattr(part, "new_state") else () for part in medium.parts),
    )


class WindArrays(NamedTuple):
    """The air above hulls: a part of the medium of bodies that pushes them, and does not carry them.

    Attributes:
        met: 1 for each hull on which wind acts, else 0, shape (V,).
        air: The air about all vehicles.
    """

    met: IntArray
    air: MediumArrays

    def new_state(self, take: Take = np.zeros) -> Parts:
        """Return the states of what moves in the air."""
        return new_state(self.air, take).parts


@inline_jit
def _hold_wind(wind, state, t, first, last):
    hold_parts(wind.air.parts, state, (), t, first, last)


@inline_jit
def _wind_velocity(wind, state, t, v, x, y, z):
    steady = flow_about(wind.air, v, x, y, z)
    return add_velocities(wind.air.parts, state, steady, t, v, x, y, z)


COMPILED[WindArrays] = Compiled(None, _hold_wind, wind=_wind_velocity)

add_winds = for_each(lambda kind: COMPILED[kind].wind, add)
"""Called with (parts, states, velocity, t, v, x, y, z): returns the velocity and that of the air above a hull, m/s."""

has_wind = has_any(lambda kind: COMPILED[kind].wind)


@inline_jit
def hold(medium, t, first, last, state):
    """Bring what is held between samples to the sample at time t, s, for the vehicles from first up to last."""
    hold_parts(medium.parts, state.parts, (), t, first, last)


@inline_jit
def advance(medium, t, first, last, state):
    """Bring the state of the medium about the vehicles from first up to last to time t, s."""
    evaluate_sines(medium.harmonics, t, first, last, state.sines)
    if len(medium.parts) > 0:
        for v in range(first, last):
            state.time[v] = t


@inline_jit
def flow_about(medium, v, x, y, z):
    """Return the steady velocity that vehicle v meets at a point, as three numbers, m/s."""
    wx, wy, wz = flow_velocity(medium.kernels[medium.rows[v, 0] : medium.rows[v, 1]], x, y, z)
    return wx, wy, 0.0 if medium.planar[v] else wz


@inline_jit
def moving_velocity(medium, state, v, x, y, z):
    """Return the part of the velocity about vehicle v at a point that changes with time, as three numbers, m/s.

    `System.largest_disturbance` bounds it. The certificates rest on that bound, and on `flow_about` for the rest.
    """
    w = disturbance_velocity(medium.harmonics, state.sines, v)
    wx, wy, wz = add_velocities(medium.parts, state.parts, w, state.time[v], v, x, y, z)
    return wx, wy, 0.0 if medium.planar[v] else wz


@inline_jit
def medium_velocity(medium, state, v, x, y, z):
    """Return the velocity of the medium that vehicle v meets at a point, as three numbers, m/s."""
    wx, wy, wz = flow_about(medium, v, x, y, z)
    dx, dy, dz = moving_velocity(medium, state, v, x, y, z)
    return wx + dx, wy + dy, wz + dz


@inline_jit
def surface_about(medium, state, v, x, y):
    """Return height, m, slopes along x and y, and rate, m/s, of the surface above a point where vehicle v is."""
    return add_surfaces(medium.parts, state.parts, (medium.level, 0.0, 0.0, 0.0), state.time[v], v, x, y)


@jit
def _velocities(medium, state, v, times, positions, out):
    for k in range(times.shape[0]):
        x = positions[k]
        hold(medium, times[k], v, v + 1, state)
        advance(medium, times[k], v, v + 1, state)
        out[k, 0], out[k, 1], out[k, 2] = medium_velocity(medium, state, v, x[0], x[1], x[2])


@jit
def _elevations(medium, state, times, positions, out):
    for k in range(times.shape[0]):
        advance(medium, times[k], 0, 1, state)
        out[k] = surface_about(medium, state, 0, positions[k, 0], positions[k, 1])[0] - medium.level


def moving_along(medium: MediumArrays, times: Array, positions: Array) -> Array:
    """Return the part of the velocity that changes with time, along paths (T, V, 3), m, at times (T,), s: (T, V, 3)."""
    rows = np.tile(np.array([0, 1]), (len(medium.rows), 1))
    moving = medium._replace(kernels=np.zeros_like(medium.kernels[:1]), rows=rows)
    out = np.zeros_like(positions)
    for v in range(positions.shape[1]):
        along = np.ascontiguousarray(positions[:, v])
        own = np.zeros_like(along)
        _velocities(moving, new_state(moving), v, times, along, own)
        out[:, v] = own
    return out


def mean_flow(medium: MediumArrays, vehicle: int, time: float, points: Array) -> Array:
    """Return a medium without gusts and waves.

    Args:
        medium: The medium.
        vehicle: Number of a vehicle that meets it.
        time: Time, s.
        points: Points, shape (K, 3), m.

    Returns:
        Velocities, shape (K, 3), m/s; NaN outside a file, and on land.
    """
    medium, out = undisturbed(medium, WITHOUT_MEAN), np.zeros(points.shape)
    times = np.full(len(points), time)
    _velocities(medium, new_state(medium), vehicle, times, np.ascontiguousarray(points, dtype=np.float64), out)
    return out


class MediumOfRun:
    """The medium that the vehicles of a scenario meet: steady flow, gusts and waves, without `disturbance`."""

    def __init__(self, scenario: "Scenario") -> None:
        """Prepare the medium of all phases."""
        self._phases = scenario.phases
        self._index = self._phases[0].system.team.index

    def velocity(self, vehicle_id: str, times: ArrayLike, positions: ArrayLike) -> Array:
        """Return the velocity of the medium that a vehicle would meet.

        Args:
            vehicle_id: Id of an agent or a target.
            times: Times, which rise and may pass the end of the run, shape (T,), s. Gusts are those of the last sample.
            positions: Positions, shape (T, 3), or (3,) for all times, m.

        Returns:
            Velocities, shape (T, 3), m/s; a planar vehicle's z is 0.

        Raises:
            InputError: There is no such vehicle, or times or positions are not as described.
        """
        if vehicle_id not in self._index:
            raise InputError(f"unknown vehicle {vehicle_id!r}; {expected(vehicle_id, self._index)}")
        v = self._index[vehicle_id]
        t, x = _samples(times, positions)
        out = np.zeros_like(x)
        for part, medium in self._media(t):
            state = new_state(medium)
            _velocities(medium, state, v, t[part], x[part], out[part])
            if why := unknown_flow(medium.parts, state.parts, v):
                raise InputError(f"{vehicle_id}: {why}")
        return out

    def surface(self, times: ArrayLike, positions: ArrayLike) -> Array:
        """Return the elevation of the water above its undisturbed surface.

        Args:
            times: Times, which rise and may pass the end of the run, shape (T,), s.
            positions: Positions, shape (T, 3), or (3,) for all times, m; their z is not used.

        Returns:
            Elevations, shape (T,), m.

        Raises:
            InputError: Times or positions are not as described.
        """
        t, x = _samples(times, positions)
        out = np.zeros(len(t))
        for part, medium in self._media(t):
            _elevations(medium, new_state(medium), t[part], x[part], out[part])
        return out

    def _media(self, times: Array) -> Iterator[tuple[slice, MediumArrays]]:
        """Yield the medium of each phase, and which of the times are in it."""
        starts = np.searchsorted(times, [phase.time - 1e-9 for phase in self._phases])
        starts[0] = 0
        for phase, (first, last) in zip(self._phases, pairwise([*starts, len(times)]), strict=True):
            if first < last:
                yield slice(first, last), undisturbed(_lasting(phase.system, float(times[last - 1])).medium)


def _lasting(system: "System", end: float) -> "System":
    """Return the system of a run that lasts until a time at least, s."""
    grid = system.grid
    steps = int(np.ceil((end - grid.start) / grid.period))
    return system if steps <= grid.steps or not system.moving else replace(system, grid=replace(grid, steps=steps))


def _samples(times: ArrayLike, positions: ArrayLike) -> tuple[Array, Array]:
    """Return times (T,) and positions (T, 3).

    Raises:
        InputError: They are not of these shapes or not finite, or the times do not rise.
    """
    t: Any = np.asarray(times, dtype=np.float64)
    x: Any = np.asarray(positions, dtype=np.float64)
    if t.ndim != 1 or not np.isfinite(t).all() or (np.diff(t) < 0.0).any():
        raise InputError(f"times have shape {t.shape}; expected (T,), finite and rising, s")
    if x.shape not in ((3,), (len(t), 3)) or not np.isfinite(x).all():
        raise InputError(f"positions have shape {x.shape}; expected {(len(t), 3)} or (3,), finite, m")
    return t, np.ascontiguousarray(np.broadcast_to(x, (len(t), 3)))


def medium(scenario: "Scenario") -> MediumOfRun:
    """Return the medium of a scenario, as its runs meet it.

    Args:
        scenario: The scenario, as `mjsheaf.load_scenario` returns it.

    Raises:
        InputError: It is no Scenario.
    """
    require_scenario(scenario)
    return MediumOfRun(scenario)
