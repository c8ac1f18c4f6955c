"""Media that move, for compiled code: a tuple of parts, each a named tuple of the type of its kind.

A kind is a row of `KINDS`: compiled functions of its parameters and its state; see `mjsheaf.parts`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Take
from mjsheaf.jit import inline_jit
from mjsheaf.media.disturbance import Bounds
from mjsheaf.media.gridded import GridArrays, bound_grid, describe_unknown, grid_velocity, new_grid_state
from mjsheaf.media.gusts import (
    FrozenArrays,
    GustArrays,
    bound_frozen,
    bound_gusts,
    frozen_velocity,
    gust_velocity,
    hold_frozen,
    hold_gusts,
    new_frozen_state,
    new_gust_state,
)
from mjsheaf.media.varying import VaryingArrays, bound_varying, varying_velocity
from mjsheaf.media.waves import WaveArrays, bound_waves, new_wave_state, wave_surface, wave_velocity
from mjsheaf.parts import for_each, has_any
from mjsheaf.vehicles.vectors import add

Parts = tuple[Any, ...]
"""Parameters or states of the parts of a medium."""


class Kind(NamedTuple):
    """Functions of a kind of moving medium, whose parameters have a field `met` by vehicle: 0 for those outside it.

    Attributes:
        bound: Called with (parameters); returns the `Bounds` of what each vehicle can meet.
        new_state: Called with (parameters, function that returns zeros of a shape); returns a state.
        hold: Called with (parameters, state, t, first, last) at every sample.
        velocity: Called with (parameters, state, t, v, x, y, z); returns three numbers, m/s.
        surface: Called with (parameters, state, t, v, x, y); returns elevation, slopes along x and y, and rate.
    """

    bound: Callable[[Any], Bounds]
    velocity: Any
    new_state: Callable[[Any, Take], Any] = lambda part, take: ()
    hold: Any = None
    surface: Any = None


KINDS: dict[type, Kind] = {
    VaryingArrays: Kind(bound_varying, varying_velocity),
    GridArrays: Kind(bound_grid, grid_velocity, new_grid_state),
    GustArrays: Kind(bound_gusts, gust_velocity, new_gust_state, hold_gusts),
    FrozenArrays: Kind(bound_frozen, frozen_velocity, new_frozen_state, hold_frozen),
    WaveArrays: Kind(bound_waves, wave_velocity, new_wave_state, surface=wave_surface),
}


WITHOUT_MEAN = (GustArrays, FrozenArrays, WaveArrays)
"""Kinds whose velocity at a fixed place has no mean."""


def new_states(parts: Parts, take: Take) -> Parts:
    """Return states of all parts."""
    return tuple(KINDS[type(part)].new_state(part, take) for part in parts)


def bounds_of(parts: Parts, vehicles: int) -> Bounds:
    """Return the bounds of all parts together."""
    total = Bounds(np.zeros(vehicles), np.zeros(vehicles), np.zeros(vehicles), 0.0)
    for part in parts:
        more = KINDS[type(part)].bound(part)
        rate = max(total.rate, more.rate)
        total = Bounds(total.speed + more.speed, total.change + more.change, total.slope + more.slope, rate)
    return total


def unknown_flow(parts: Parts, states: Parts, v: int) -> str:
    """Return why vehicle v met a flow that is not known, or an empty string."""
    for part, state in zip(parts, states, strict=True):
        if isinstance(part, GridArrays) and (why := describe_unknown(part, state, v)):
            return why
    return ""


def of_kind(parts: Parts, kind: type) -> list[Any]:
    """Return the parts of a kind."""
    return [part for part in parts if isinstance(part, kind)]


hold_parts = for_each(lambda kind: KINDS[kind].hold)
"""Called with (parts, states, (), t, first, last): see `Kind.hold`."""


@inline_jit
def _add_surface(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


add_velocities = for_each(lambda kind: KINDS[kind].velocity, add)
"""Called with (parts, states, velocity, t, v, x, y, z): returns the velocity and those of all parts, m/s."""

add_surfaces = for_each(lambda kind: KINDS[kind].surface, _add_surface)
"""Called with (parts, states, surface, t, v, x, y): returns the surface (elevation, slopes, rate) and those of all."""

_have_surface = has_any(lambda kind: KINDS[kind].surface)


@inline_jit
def upright_in(parts, surface, R):
    """Return the components of a surface's normal along x and y of a body with the attitude R (9,)."""
    if _have_surface(parts):
        return R[6] - surface[1] * R[0] - surface[2] * R[3], R[7] - surface[1] * R[1] - surface[2] * R[4]
    return R[6], R[7]
