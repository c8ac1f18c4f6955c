"""The medium of a scenario, to be looked at: velocities and surface at any times and places, as a run meets them."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arguments import require_scenario
from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, expected
from mjsheaf.jit import jit
from mjsheaf.media.medium import MediumArrays, advance, hold, medium_velocity, new_state, surface_about, undisturbed
from mjsheaf.media.moving import WITHOUT_MEAN, unknown_flow

if TYPE_CHECKING:
    from mjsheaf.scenario import Scenario
    from mjsheaf.system import System


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


def mean_flow(system: "System", vehicle: int, time: float, points: Array) -> Array:
    """Return the medium without gusts and waves.

    Args:
        system: The system.
        vehicle: Number of a vehicle that meets it.
        time: Time, s.
        points: Points, shape (K, 3), m.

    Returns:
        Velocities, shape (K, 3), m/s; NaN outside a file, and on land.
    """
    medium, out = undisturbed(system.medium, WITHOUT_MEAN), np.zeros(points.shape)
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
