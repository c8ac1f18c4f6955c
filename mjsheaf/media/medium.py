"""The medium about the vehicles, for compiled code: parameters, state, and what it does at a time.

`MediumArrays` holds the parameters, which nothing changes during a phase of a run; `MediumState` holds all that
depends on time. A loop calls `advance` once for each time and range of vehicles, and then `medium_velocity` and
`surface_about` at as many points as it likes. A medium that moves adds its parameters to the one and its state to
the other, computes the state in `advance`, and reads it in the other two; no loop changes. Vehicles are advanced in
ranges by several threads at once, so that the state of each vehicle is its own.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray, IntArray, Own
from mjsheaf.jit import inline_jit
from mjsheaf.media.disturbance import HarmonicArrays, disturbance_velocity, evaluate_sines, pack
from mjsheaf.media.flow import FlowField, flow_velocity


class MediumArrays(NamedTuple):
    """Parameters of the medium about V vehicles.

    Attributes:
        agents: Number of agents, which are the first of the vehicles.
        planar: True for vehicles that live in the plane, shape (V,).
        kernels: Tables of all flow fields, one below the other.
        rows: First row of `kernels` that each vehicle meets, and the row after the last, shape (V, 2).
        harmonics: Harmonics of the disturbances.
        level: Height of the undisturbed surface, m.
    """

    agents: int
    planar: BoolArray
    kernels: Array
    rows: IntArray
    harmonics: Own[HarmonicArrays]
    level: float


class MediumState(NamedTuple):
    """State of the medium at the time of the last call of `advance`.

    Attributes:
        sines: Sines of the disturbances' harmonics, shape (V K,).
    """

    sines: Array


def pack_medium(
    agents: int, planar: BoolArray, flows: Sequence[FlowField], field: IntArray, harmonics: Array, level: float
) -> MediumArrays:
    """Pack flow fields, of which vehicle v meets number field[v], and harmonics (V, K, 5) for compiled code."""
    ends = np.cumsum([0, *(len(flow.table) for flow in flows)])
    rows = np.column_stack([ends[field], ends[field + 1]]).astype(np.int64)
    return MediumArrays(agents, planar, np.vstack([flow.table for flow in flows]), rows, pack(harmonics), level)


def new_state(medium: MediumArrays) -> MediumState:
    """Return a state for `advance` to write to."""
    return MediumState(np.zeros(len(medium.harmonics.rate)))


@inline_jit
def advance(medium, t, first, last, state):
    """Bring the state of the medium about the vehicles from first up to last to time t, s."""
    evaluate_sines(medium.harmonics, t, first, last, state.sines)


@inline_jit
def flow_about(medium, v, x, y, z):
    """Return the steady velocity that vehicle v meets at a point, as three numbers, m/s."""
    wx, wy, wz = flow_velocity(medium.kernels[medium.rows[v, 0] : medium.rows[v, 1]], x, y, z)
    return wx, wy, 0.0 if medium.planar[v] else wz


@inline_jit
def moving_velocity(medium, state, v):
    """Return the part of the velocity about vehicle v that changes with time, as three numbers, m/s.

    `System.largest_disturbance` bounds it. The certificates rest on that bound, and on `flow_about` for the rest.
    """
    return disturbance_velocity(medium.harmonics, state.sines, v)


@inline_jit
def medium_velocity(medium, state, v, x, y, z):
    """Return the velocity of the medium that vehicle v meets at a point, as three numbers, m/s."""
    wx, wy, wz = flow_about(medium, v, x, y, z)
    dx, dy, dz = moving_velocity(medium, state, v)
    return wx + dx, wy + dy, wz + dz


@inline_jit
def surface_about(medium, state, x, y):
    """Return the height of the surface above a point, m, and its slopes along x and y; at rest, it is level."""
    return medium.level, 0.0, 0.0
