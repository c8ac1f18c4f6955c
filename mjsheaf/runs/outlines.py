"""Outlines of obstacles in the views of a figure."""

from typing import Any

import numpy as np
from matplotlib.patches import Polygon

from mjsheaf.arrays import Array
from mjsheaf.law.obstacles import BOX, CAPSULE, HALF_SPACE, SPHERE, ObstacleArrays, centres

COLOUR = "#C78C61"
_CORNERS = 72  # of an outline
_FAR = 1e4  # size at which a half-space is drawn, m
_BESIDE = 1.0  # of the room of the tracks, beyond which obstacles do not enlarge a view
_LEVEL = 1e-6  # component of a normal along the line of sight, below which a half-space is seen from its edge


def outline(obstacles: ObstacleArrays, n: int, centre: Array, projection: Array) -> Array | None:
    """Return the outline of obstacle n as a polygon; None for a half-space that is not seen from its edge.

    The outline of a convex body consists of its farthest points in every direction of the picture.

    Args:
        obstacles: The obstacles.
        n: Number of one.
        centre: Where it is, shape (3,), m.
        projection: Two orthonormal rows, the axes of the picture, shape (2, 3).

    Returns:
        Corners, shape (P, 2), m.
    """
    kind, axes, size = int(obstacles.kind[n]), obstacles.axes[n], obstacles.size[n]
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False) + np.pi / _CORNERS
    ways = np.column_stack([np.cos(angle), np.sin(angle)]) @ projection  # in space, shape (P, 3)
    along = np.where(ways @ axes.T >= 0.0, 1.0, -1.0)
    if kind == HALF_SPACE:
        normal = projection @ axes[0]
        if np.linalg.norm(normal) < 1.0 - _LEVEL:
            return None
        side = np.array([-normal[1], normal[0]])
        return np.asarray(projection @ centre + _FAR * np.array([side, side - normal, -side - normal, -side]))
    offset = {
        SPHERE: size[0] * ways,
        CAPSULE: along[:, :1] * size[0] * axes[0] + size[1] * ways,
        BOX: (along * size) @ axes,
    }[kind]
    return np.asarray((centre + offset) @ projection.T)


def include_obstacles(low: Array, high: Array, obstacles: ObstacleArrays | None, times: Array) -> tuple[Array, Array]:
    """Enlarge a box, low and high (3, 1) in m, by the obstacles at the first and last of some times, s.

    A half-space is not part of it, nor what is farther away than the box is wide.
    """
    if obstacles is None:
        return low, high
    least = low - _BESIDE * (high - low).max()
    most = high + _BESIDE * (high - low).max()
    for time in (times[0], times[-1]):
        for n, centre in enumerate(centres(obstacles, float(time))):
            if obstacles.kind[n] == HALF_SPACE:
                continue
            seen = [outline(obstacles, n, centre, np.eye(3)[[axis, (axis + 1) % 3]]) for axis in range(3)]
            along = np.array([corners[:, 0] for corners in seen if corners is not None])
            low = np.minimum(low, np.clip(along.min(axis=1)[:, None], least, most))
            high = np.maximum(high, np.clip(along.max(axis=1)[:, None], least, most))
    return low, high


def draw_obstacles(axis: Any, obstacles: ObstacleArrays | None, times: Array, projection: Array) -> None:
    """Draw obstacles where they are at the last of some times, s, and the outlines of those that moved at the first."""
    if obstacles is None:
        return
    first, last = (centres(obstacles, float(time)) for time in (times[0], times[-1]))
    style: dict[str, Any] = {"edgecolor": COLOUR, "linewidth": 0.8, "zorder": 1}
    for n in range(len(obstacles.kind)):
        shape = outline(obstacles, n, last[n], projection)
        if shape is None:
            continue
        axis.add_artist(Polygon(shape, facecolor=f"{COLOUR}80", **style))
        began = outline(obstacles, n, first[n], projection)
        if began is not None and (first[n] != last[n]).any():
            axis.add_artist(Polygon(began, fill=False, linestyle=(0, (3, 2)), **style))
