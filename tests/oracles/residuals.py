"""Residuals of edges: |F_i x_i - F_j x_j - b|, or what a length or a direction lacks. From the definition."""

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.team import Edge, Team


def residual_of(edge: Edge, tail: Array, head: Array) -> float:
    """Return the residual of an edge with its ends at places, (3,) each, m."""
    z = edge.F_head @ head[: edge.F_head.shape[1]] - edge.F_tail @ tail[: edge.F_tail.shape[1]] + edge.b
    if edge.measures in ("range", "bearing"):
        length = np.linalg.norm(z)
        assert edge.offset is not None
        z = length - edge.offset if edge.measures == "range" else z - length * edge.offset
    return float(np.linalg.norm(z))


def residuals_of(team: Team, places: Array) -> dict[str, float]:
    """Return the residuals of edges with two ends by name, such as A1-A2, of a team at places, shape (V, 3), m."""
    return {
        f"{edge.tail}-{edge.head}": residual_of(edge, places[team.index[edge.tail]], places[team.index[edge.head]])
        for edge in (*team.communication, *team.sensing)
    }
