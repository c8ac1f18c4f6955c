"""The law of the paper, eq. controller-1, edge by edge from its definition."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mjsheaf.team import Edge

Array = NDArray[np.float64]


def disagreement(edges: Iterable[Edge], index: dict[str, int], positions: Array) -> Array:
    """Return eta of members by number, shape (V, 3), at positions (V, 3), padded, m.

    The tail of an edge has -F^T K (y + b), its head F^T K (y + b), with y = F_head x_head - F_tail x_tail. An anchor
    has no member at its head.
    """
    eta = np.zeros_like(positions)
    for e in edges:
        ends = [(index[i], F, sign) for i, F, sign in ((e.tail, e.F_tail, -1), (e.head, e.F_head, 1)) if i in index]
        y = sum(sign * F @ positions[v, : F.shape[1]] for v, F, sign in ends)
        for v, F, sign in ends:
            eta[v, : F.shape[1]] += sign * F.T @ e.weight @ (y + e.b)
    return eta
