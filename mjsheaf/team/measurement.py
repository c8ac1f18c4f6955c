"""The range-bearing measurement of an edge, and what is rebuilt from it."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def relative_state(F_tail: Array, F_head: Array, x_tail: ArrayLike, x_head: ArrayLike) -> Array:
    """y = F_head x_head - F_tail x_tail, the transported relative state in the edge stalk, shape (m,), m."""
    return F_head @ np.asarray(x_head) - F_tail @ np.asarray(x_tail)


def range_bearing(y: Array) -> tuple[float, Array]:
    """Range |y| in m and unit bearing y / |y|; at range 0 the bearing is zero, so that range * bearing is y."""
    r = float(np.linalg.norm(y))
    return r, y / r if r > 0.0 else np.zeros_like(y)
