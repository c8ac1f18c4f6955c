"""Frameworks whose ranks and rates the literature on rigidity has, of points and of the pairs that measure each other.

A rank is that of the rigidity matrix; `needed` is that of an infinitesimally rigid framework: n d less the dimension of
the motions that no edge measures, which of ranges are translations and rotations, of bearings translations and scaling.
"""

import itertools
from typing import Any

import numpy as np

HALF = 3**0.5 / 2
TRIANGLE = [[0, 0], [1, 0], [0.5, HALF]]
SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
TETRAHEDRON = [[0, 0, 0], [1, 0, 0], [0.5, HALF, 0], [0.5, HALF / 3, (2 / 3) ** 0.5]]
CUBE = [list(x) for x in itertools.product((0, 1), repeat=3)]
RING = [(0, 1), (1, 2), (2, 3), (3, 0)]
SIDES = [(i, j) for i, j in itertools.combinations(range(8), 2) if np.abs(np.subtract(CUBE[i], CUBE[j])).sum() == 1]


def complete(n: int) -> list[tuple[int, int]]:
    """Return all pairs of n points."""
    return list(itertools.combinations(range(n), 2))


FRAMEWORKS: list[tuple[Any, list[tuple[int, int]], str, int, int, float | None]] = [
    (TRIANGLE, complete(3), "range", 3, 3, 1.5),
    (TRIANGLE, complete(3), "bearing", 3, 3, 1.5),
    (SQUARE, [*RING, (0, 2)], "range", 5, 5, 0.585786),
    (SQUARE, [*RING, (0, 2)], "bearing", 5, 5, 0.482362),
    (SQUARE, complete(4), "range", 5, 5, 2.0),
    (SQUARE, complete(4), "bearing", 5, 5, 1.414214),
    (TETRAHEDRON, complete(4), "range", 6, 6, 1.0),
    (TETRAHEDRON, complete(4), "bearing", 8, 8, 2.0),
    (SQUARE, RING, "range", 4, 5, None),
    (SQUARE, RING, "bearing", 4, 5, None),
    (CUBE, [*SIDES, (0, 7)], "range", 13, 18, None),
    (CUBE, [*SIDES, (0, 7)], "bearing", 20, 20, 0.206490),
]
"""Points, pairs, what they measure, rank, rank needed, and the smallest positive eigenvalue of a rigid one, 1/s."""
