"""Colours of arrows: the speed of a medium, on a scale of its own for each medium. Pure numpy.

Video and page share the colours' meaning and the largest speed of each scale.
"""

from collections.abc import Callable

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.video.film import Medium
from mjsheaf.video.sizes import round_up

STOPS: Array = np.array(
    [
        [[1.00, 0.97, 0.85, 0.30], [1.00, 0.80, 0.25, 0.60], [0.93, 0.32, 0.02, 0.85]],
        [[0.07, 0.15, 0.42, 0.40], [0.38, 0.14, 0.62, 0.70], [1.00, 0.25, 0.85, 0.85]],
    ]
)
"""RGBA in 0..1 of the first and the second medium at rest, at half of the scale, and at its end, shape (2, 3, 4)."""
_FASTEST = 0.98  # quantile of the speeds that the scale covers: a singular vortex has no largest one
_SIDE = 40  # places along each side of the region in which speeds are looked at
_MARGIN = 0.15  # of the region's size, around it


def colour(medium: int, fraction: Array) -> Array:
    """Compute the colours of speeds.

    Args:
        medium: Number of the medium, 0 or 1.
        fraction: Speeds as fractions of the scale's end, shape (n,).

    Returns:
        RGBA in 0..1, shape (n, 4).
    """
    stops = STOPS[medium % len(STOPS)]
    at = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(fraction, at, stops[:, channel]) for channel in range(4)], axis=-1)


def largest_speed(velocity: Callable[[Array], Array], places: Array) -> float:
    """Choose the end of a medium's scale of speeds, in m/s: a round number that the flow about a run hardly exceeds.

    Args:
        velocity: Velocities, shape (n, 3), m/s, at points, shape (n, 3), m.
        places: Where vehicles meet the medium, shape (n, 3), m.

    Returns:
        The end of the scale; 0 where the medium is at rest.
    """
    known = places[np.isfinite(places).all(axis=1)]
    if not len(known):
        return 0.0
    low, high = known.min(axis=0), known.max(axis=0)
    room = _MARGIN * float((high - low)[:2].max()) + 1.0
    x, y = (np.linspace(low[k] - room, high[k] + room, _SIDE) for k in range(2))
    level = float(np.median(known[:, 2]))
    grid = np.stack([*np.meshgrid(x, y), np.full((_SIDE, _SIDE), level)], axis=-1).reshape(-1, 3)
    with np.errstate(all="ignore"):
        speeds = np.linalg.norm(velocity(grid), axis=1)
    speeds = speeds[np.isfinite(speeds)]
    fastest = float(np.quantile(speeds, _FASTEST)) if len(speeds) else 0.0
    return round_up(fastest) if fastest > 1e-9 else 0.0


def velocities(medium: Medium, places: Array, time: float = -np.inf) -> Array:
    """Compute the velocities of a medium at a time in s, by default that of the start.

    Args:
        medium: The medium.
        places: Points, shape (K, 3), m.
        time: Time, s.

    Returns:
        Velocities, shape (K, 3), m/s; not finite at a singular point.
    """
    velocity = medium.velocity
    for start, changed in medium.changes:
        if start <= time + 1e-9:
            velocity = changed
    with np.errstate(all="ignore"):
        return velocity(places) * [1.0, 1.0, not medium.level]
