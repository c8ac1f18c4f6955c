"""Media that move, for compiled code: a tuple of parts, each a named tuple of the type of its kind.

The types alone tell numba which functions to call, so that a medium without parts compiles and runs as if there were
none. A kind is a row of `KINDS`: compiled functions of its parameters and its state. A function that is None has
nothing to do. Overloads write the calls out, one after the other.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import IntArray
from mjsheaf.jit import overload
from mjsheaf.media.bounded import Bounds
from mjsheaf.media.gridded import GridArrays, advance_grid, bound_grid, describe_unknown, grid_velocity, new_grid_state
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
from mjsheaf.media.varying import (
    VaryingArrays,
    advance_varying,
    bound_varying,
    new_varying_state,
    varying_velocity,
)
from mjsheaf.media.waves import WaveArrays, advance_waves, bound_waves, new_wave_state, wave_surface, wave_velocity

Parts = tuple[Any, ...]
"""Parameters or states of the parts of a medium."""


class Kind(NamedTuple):
    """Functions of a kind of moving medium.

    Attributes:
        new_state: Called with (parameters); returns a state.
        by_vehicle: Names of the parameters with a row for each vehicle.
        bound: Called with (parameters); returns the `Bounds` of what each vehicle can meet.
        hold: Called with (parameters, t, first, last, state) at every sample.
        advance: Called likewise at every time.
        velocity: Called with (parameters, state, v, x, y, z); returns three numbers, m/s.
        surface: Called with (parameters, state, v, x, y); returns elevation, slopes along x and y, and rate.
    """

    new_state: Callable[[Any], Any]
    by_vehicle: tuple[str, ...]
    bound: Callable[[Any], Bounds]
    hold: Any = None
    advance: Any = None
    velocity: Any = None
    surface: Any = None


KINDS: dict[type, Kind] = {
    VaryingArrays: Kind(new_varying_state, ("met",), bound_varying, advance=advance_varying, velocity=varying_velocity),
    GridArrays: Kind(new_grid_state, ("met",), bound_grid, advance=advance_grid, velocity=grid_velocity),
    GustArrays: Kind(new_gust_state, ("streams", "filters"), bound_gusts, hold=hold_gusts, velocity=gust_velocity),
    FrozenArrays: Kind(new_frozen_state, ("met",), bound_frozen, hold=hold_frozen, velocity=frozen_velocity),
    WaveArrays: Kind(
        new_wave_state,
        ("met",),
        bound_waves,
        advance=advance_waves,
        velocity=wave_velocity,
        surface=wave_surface,
    ),
}


GAUSSIAN = (GustArrays, FrozenArrays)
"""Kinds without a bound."""

WITHOUT_MEAN = (*GAUSSIAN, WaveArrays)
"""Kinds whose velocity at a fixed place has no mean."""


def new_states(parts: Parts) -> Parts:
    """Return states of all parts."""
    return tuple(KINDS[type(part)].new_state(part) for part in parts)


def rows_of(parts: Parts, rows: IntArray) -> Parts:
    """Return the parts as vehicles of these numbers meet them."""
    return tuple(
        part._replace(**{name: getattr(part, name)[rows] for name in KINDS[type(part)].by_vehicle}) for part in parts
    )


def bounds_of(parts: Parts, vehicles: int) -> Bounds:
    """Return the bounds of all parts together."""
    total = Bounds(np.zeros(vehicles), np.zeros(vehicles), np.zeros(vehicles), 0.0)
    for part in parts:
        more = KINDS[type(part)].bound(part)
        rate = max(total.rate, more.rate)
        total = Bounds(total.speed + more.speed, total.change + more.change, total.slope + more.slope, rate)
    return total


def pieces_of(parts: Parts) -> tuple[Parts, Parts]:
    """Split parts into pieces that add up to them.

    Returns:
        Pieces that are one continuous flow of time and place for all who meet them, and all others: gusts, files with
        land, and waves as vehicles in space meet them, below the surface alone.
    """
    shared: list[Any] = []
    others: list[Any] = []
    for part in parts:
        if isinstance(part, VaryingArrays):
            no_ramp = part.ramp * [0.0, 0.0, 0.0, 1.0, 1.0]
            shared.append(part._replace(vortices=part.vortices[:0]))
            shared += [part._replace(tide=0.0 * part.tide, ramp=no_ramp, vortices=row[None]) for row in part.vortices]
        elif isinstance(part, WaveArrays):
            shared.append(part._replace(met=np.where(part.met == 1, 1, 0)))
            others.append(part._replace(met=np.where(part.met == 1, 0, part.met)))
        elif isinstance(part, GridArrays) and np.isfinite(part.velocity).all():
            shared.append(part)
        else:
            others.append(part)
    return tuple(shared), tuple(others)


def unknown_flow(parts: Parts, states: Parts, v: int) -> str:
    """Return why vehicle v met a flow that is not known, or an empty string."""
    for part, state in zip(parts, states, strict=True):
        if isinstance(part, GridArrays) and (why := describe_unknown(part, state, v)):
            return why
    return ""


def of_kind(parts: Parts, kind: type) -> list[Any]:
    """Return the parts of a kind."""
    return [part for part in parts if isinstance(part, kind)]


def silence(parts: Parts, kinds: tuple[type, ...]) -> Parts:
    """Return parts that no vehicle meets where they are of some kinds.

    Args:
        parts: Parameters of the parts.
        kinds: Kinds to silence.

    Returns:
        Parts of the same types, so that nothing is compiled again.
    """
    rows = [KINDS[type(part)].by_vehicle[0] if isinstance(part, kinds) else "" for part in parts]
    return tuple(
        part._replace(**{name: np.zeros_like(getattr(part, name))}) if name else part
        for part, name in zip(parts, rows, strict=True)
    )


def hold_parts(parts, states, t, first, last):
    """Bring all that is held between samples to the sample at time t, s, for the vehicles from first up to last."""
    for part, state in zip(parts, states, strict=True):
        if KINDS[type(part)].hold is not None:
            KINDS[type(part)].hold(part, t, first, last, state)


def advance_parts(parts, states, t, first, last):
    """Bring all that is not held to time t, s, for the vehicles from first up to last."""
    for part, state in zip(parts, states, strict=True):
        if KINDS[type(part)].advance is not None:
            KINDS[type(part)].advance(part, t, first, last, state)


def add_velocities(parts, states, v, x, y, z, w):
    """Add the velocities that vehicle v meets at a point to three numbers w, m/s."""
    for part, state in zip(parts, states, strict=True):
        if KINDS[type(part)].velocity is not None:
            more = KINDS[type(part)].velocity(part, state, v, x, y, z)
            w = w[0] + more[0], w[1] + more[1], w[2] + more[2]
    return w


def add_surfaces(parts, states, v, x, y, level):
    """Return height, m, slopes along x and y, and rate, m/s, of the surface where vehicle v is; level by default."""
    height, slope_x, slope_y, rise = level, 0.0, 0.0, 0.0
    for part, state in zip(parts, states, strict=True):
        if KINDS[type(part)].surface is not None:
            more = KINDS[type(part)].surface(part, state, v, x, y)
            height += more[0]
            slope_x += more[1]
            slope_y += more[2]
            rise += more[3]
    return height, slope_x, slope_y, rise


def upright_in(parts, surface, R):
    """Return the components of a surface's normal along x and y of a body with the attitude R (9,)."""
    if any(KINDS[type(part)].surface is not None for part in parts):
        return R[6] - surface[1] * R[0] - surface[2] * R[3], R[7] - surface[1] * R[1] - surface[2] * R[4]
    return R[6], R[7]


def _functions(parts: Any, field: str) -> list[tuple[int, Any]]:
    """Return number and function of the parts whose kind has a function of this name."""
    found = (getattr(KINDS[kind.instance_class], field) for kind in parts)
    return [(k, function) for k, function in enumerate(found) if function is not None]


def _written(head: str, line: str, end: str, functions: list[tuple[int, Any]]) -> Any:
    """Return a function of a head, of a line for each of the functions, and of an end."""
    names = {f"part_{k}": function for k, function in functions}
    lines = [head, *(f"    {line.format(k=k)}" for k, _ in functions), f"    {end}"]
    exec("\n".join(lines), names)
    return names["written"]


@overload(hold_parts)
def _hold_parts(parts, states, t, first, last):
    """Write the calls out."""
    head = "def written(parts, states, t, first, last):"
    return _written(head, "part_{k}(parts[{k}], t, first, last, states[{k}])", "return", _functions(parts, "hold"))


@overload(advance_parts)
def _advance_parts(parts, states, t, first, last):
    """Write the calls out."""
    head = "def written(parts, states, t, first, last):"
    return _written(head, "part_{k}(parts[{k}], t, first, last, states[{k}])", "return", _functions(parts, "advance"))


@overload(add_velocities)
def _add_velocities(parts, states, v, x, y, z, w):
    """Write the calls out."""
    line = "more = part_{k}(parts[{k}], states[{k}], v, x, y, z); w = w[0] + more[0], w[1] + more[1], w[2] + more[2]"
    head = "def written(parts, states, v, x, y, z, w):"
    return _written(head, line, "return w", _functions(parts, "velocity"))


@overload(add_surfaces)
def _add_surfaces(parts, states, v, x, y, level):
    """Write the calls out."""
    line = (
        "more = part_{k}(parts[{k}], states[{k}], v, x, y); "
        "all = all[0] + more[0], all[1] + more[1], all[2] + more[2], all[3] + more[3]"
    )
    functions = _functions(parts, "surface")
    head = "def written(parts, states, v, x, y, level):\n    all = level, 0.0, 0.0, 0.0"
    return _written(head, line, "return all", functions)


@overload(upright_in)
def _upright_in(parts, surface, R):
    """Write out what is needed."""
    if not _functions(parts, "surface"):
        return lambda parts, surface, R: (R[6], R[7])

    def tilted(parts, surface, R):
        return R[6] - surface[1] * R[0] - surface[2] * R[3], R[7] - surface[1] * R[1] - surface[2] * R[4]

    return tilted
