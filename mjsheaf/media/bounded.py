"""Bounds of what moves in a medium."""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray


class Bounds(NamedTuple):
    """Bounds of the velocity that each of V vehicles can meet of a part of the medium, wherever it is.

    Attributes:
        speed: Largest speed, shape (V,), m/s; infinite where the part is Gaussian.
        change: Largest rate of change at a fixed place, shape (V,), m/s^2.
        slope: Largest norm of the Jacobian, shape (V,), 1/s.
        rate: Highest frequency, rad/s.
    """

    speed: Array
    change: Array
    slope: Array
    rate: float


def unbounded(met: BoolArray) -> Bounds:
    """Return infinite bounds for vehicles that meet a part, shape (V,), and zeros for others."""
    infinite = np.where(met, np.inf, 0.0)
    return Bounds(infinite, infinite, infinite, 0.0)
