"""Scales at which each kind of vehicle is drawn unless the viewer says otherwise. Video and page share them.

A drone of half a metre is a speck next to a boat of six. Each kind is enlarged until it fills a stated fraction of the
size of the run. It stays smaller than the usual gap between neighbours, so that vehicles do not cover each other.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from mjsheaf.arrays import Array

MIN_FRACTION = 1 / 18
"""Smallest size of a vehicle as it is drawn, as a fraction of the size of the run."""
MAX_GAP_FRACTION = 0.8
"""Largest size of an enlarged vehicle as it is drawn, as a fraction of the gap between neighbours."""
MOMENTS = 9
"""Number of samples of a run from which its size is found."""

_STEPS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


def automatic_scales(kinds: Sequence[str], radii: Array, positions: Array) -> Array:
    """Choose a scale for each kind of vehicle, one that is easily said.

    Args:
        kinds: Kind of each of V vehicles.
        radii: Radius of each vehicle about its origin, shape (V,), m.
        positions: Positions of all vehicles at K times, shape (K, V, 3), m; NaN where a vehicle is absent.

    Returns:
        Scale of each vehicle, at least 1, shape (V,).
    """
    size, gap = run_size(positions), _typical_gap(positions)
    room = MAX_GAP_FRACTION * gap
    wanted = MIN_FRACTION * size
    found = np.ones(len(kinds))
    for kind in dict.fromkeys(kinds):
        own = np.array([each == kind for each in kinds])
        length = 2.0 * float(radii[own].max())
        scale = round_up(wanted / length) if wanted <= room else round_down(room / length)
        found[own] = max(scale, 1.0)
    return found


def run_size(positions: Array) -> float:
    """Compute the diameter in m of what holds nine tenths of all positions of a run.

    Args:
        positions: Shape (K, V, 3), m; vehicles without a finite position do not count.
    """
    known = positions[np.isfinite(positions).all(axis=2)]
    if not len(known):
        return 0.0
    away = np.linalg.norm(known - np.median(known, axis=0), axis=1)
    return 2.0 * float(np.quantile(away, 0.9))


def _typical_gap(positions: Array) -> float:
    """Compute the usual distance in m from a vehicle to its nearest neighbour; infinite for a vehicle alone."""
    gaps = []
    for places in positions:
        known = places[np.isfinite(places).all(axis=1)]
        if len(known) > 1:
            nearest, _ = cKDTree(known).query(known, k=2)
            gaps.append(float(np.median(nearest[:, 1])))
    return float(np.median(gaps)) if gaps else np.inf


def round_up(value: float) -> float:
    """Return the smallest of 1, 1.5, 2, 2.5, 3, 4, 5, 6 and 8 times a power of ten that is no less than a value."""
    if not (np.isfinite(value) and value > 0.0):
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(f"{step * power:.6g}" for step in _STEPS if step * power >= value * (1.0 - 1e-9)))


def round_down(value: float) -> float:
    """Return the largest of 1, 1.5, 2, 2.5, 3, 4, 5, 6 and 8 times a power of ten that is no more than a value."""
    if not (np.isfinite(value) and value > 0.0):
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(max((step for step in _STEPS if step * power <= value * (1.0 + 1e-9)), default=1.0) * power)


def list_scales(kinds: Sequence[str], ids: Sequence[str], scales: Array) -> list[tuple[float, list[str]]]:
    """Group vehicles that are not drawn in their true size by scale, the largest first.

    Vehicles are named by kind, by id where a kind has several scales, and by "every vehicle" where all have one.
    """
    if len(set(scales.tolist())) == 1:
        kinds = ["every vehicle"] * len(kinds)
    groups: dict[float, list[str]] = defaultdict(list)
    for kind in dict.fromkeys(kinds):
        own = [v for v, each in enumerate(kinds) if each == kind]
        alike = len(set(scales[own].tolist())) == 1
        for v in own[:1] if alike else own:
            groups[float(scales[v])].append(kind if alike else ids[v])
    return [(scale, groups[scale]) for scale in sorted(groups, reverse=True) if scale != 1.0]
