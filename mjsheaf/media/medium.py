"""The medium about the vehicles, for compiled code: parameters, state, and what it does at a time.

`MediumArrays` holds the parameters, which nothing changes during a phase of a run; `MediumState` holds all that
depends on time. A loop calls `hold` at each sample, `advance` once for each time and range of vehicles, and then
`medium_velocity` and `surface_about` at as many points as it likes. A medium that moves is a part of both, of a kind in
`mjsheaf.media.moving`; no loop changes. Vehicles are advanced in ranges by several threads at once, so that the state
of each vehicle is its own. It is a function of time alone: at any time, a run can continue with a new state.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray, IntArray, Take
from mjsheaf.errors import in_field
from mjsheaf.jit import inline_jit, jit
from mjsheaf.media.disturbance import HarmonicArrays, disturbance_velocity, evaluate_sines, pack
from mjsheaf.media.flow import FlowField, flow_velocity
from mjsheaf.media.flow_files import Medium
from mjsheaf.media.gridded import GriddedFlow, flow_at_start, pack_grid
from mjsheaf.media.gusts import Exposure, pack_frozen, pack_gusts
from mjsheaf.media.moving import Parts, add_surfaces, add_velocities, hold_parts, new_states
from mjsheaf.media.varying import pack_varying
from mjsheaf.media.waves import pack_waves

_MEDIA: dict[str, Medium] = {"wind": "air", "current": "water"}
"""Medium of a flow field by its name; those by role have none."""


class MediumArrays(NamedTuple):
    """Parameters of the medium about V vehicles.

    Attributes:
        agents: Number of agents, which are the first of the vehicles.
        planar: True for vehicles that live in the plane, shape (V,).
        kernels: Tables of all flow fields, one below the other.
        rows: First row of `kernels` that each vehicle meets, and the row after the last, shape (V, 2).
        harmonics: Harmonics of the disturbances.
        level: Height of the undisturbed surface, m.
        parts: Parameters of what moves; see `mjsheaf.media.moving`.
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
        numbers = met.met.astype(np.int64)
        if flow.varies:
            parts.append(pack_varying(flow.tide, flow.ramp, flow.moving_vortices, numbers))
        if isinstance(flow, GriddedFlow):
            with in_field(name):
                parts.append(pack_grid(flow, _MEDIA.get(name), numbers, exposed))
                met = met._replace(wind=met.wind + flow_at_start(parts[-1], exposed))
        if flow.gusts is not None and met.met.any():
            with in_field(f"{name}: gusts"):
                parts.append(pack_frozen(flow.gusts, met, name) if flow.gusts.frozen else pack_gusts(flow.gusts, met))
        if flow.waves is not None:
            reached = np.where(planar, numbers, 2 * exposed.met)
            parts.append(pack_waves(flow.waves.components_of(exposed.seed), reached, exposed.level))
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
    return MediumState(take(len(medium.harmonics.rate)), take(len(medium.planar)), new_states(medium.parts, take))


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


@jit
def _record_moving(medium, state, times, positions, out):
    V = positions.shape[1]
    for k in range(times.shape[0]):
        hold(medium, times[k], 0, V, state)
        advance(medium, times[k], 0, V, state)
        for v in range(V):
            x = positions[k, v]
            out[k, v, 0], out[k, v, 1], out[k, v, 2] = moving_velocity(medium, state, v, x[0], x[1], x[2])


def moving_along(medium: MediumArrays, times: Array, positions: Array) -> Array:
    """Return the part of the velocity that changes with time, along paths (T, V, 3), m, at times (T,), s: (T, V, 3)."""
    out = np.zeros_like(positions)
    _record_moving(medium, new_state(medium), times, np.ascontiguousarray(positions), out)
    return out


@inline_jit
def surface_about(medium, state, v, x, y):
    """Return height, m, slopes along x and y, and rate, m/s, of the surface above a point where vehicle v is."""
    return add_surfaces(medium.parts, state.parts, (medium.level, 0.0, 0.0, 0.0), state.time[v], v, x, y)
