"""A flow field kernel by kernel: the formulas of the published run, the paper's Section VI, at points in n dimensions.

They are analytic, so that their derivatives come from complex points, to rounding (Squire and Trapp, SIAM Review 40,
1998).
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjsheaf.media.flow import FlowField

Array = NDArray[np.float64]


def flow_velocity(field: FlowField, points: Any) -> Any:
    """Return w at real or complex points of shape (..., d), shape (..., d), m/s; what they lack is zero."""
    points = np.asarray(points)
    n, d, core2 = field.dimension, points.shape[-1], (field.core or 0.0) ** 2
    x, w = (np.zeros((*points.shape[:-1], 3), points.dtype) for _ in range(2))
    x[..., : min(n, d)] = points[..., :n]

    def apart(centre: Any) -> Any:
        return x - np.append(centre, np.zeros(3 - n))

    def squared(r: Any) -> Any:
        return (r * r).sum(axis=-1, keepdims=True)

    w[..., :n] += field.drift or 0.0
    for source in field.sources:
        r = apart(source.centre)
        w += source.alpha * r / (squared(r) + core2) ** (n / 2)
    for vortex in field.vortices:
        r = apart(vortex.centre)
        w += vortex.gamma * np.cross(vortex.axis or [0.0, 0.0, 1.0], r) / (squared(r) + core2)
    for channel in field.channels:
        r, along = apart(channel.centre), np.append(channel.direction, np.zeros(3 - n))
        along /= np.linalg.norm(along)
        t = (r @ along)[..., None]
        across = squared(r - t * along) / channel.width**2
        w += channel.beta * np.exp(-0.5 * (across + t**2 / channel.length**2)) * along
    return w[..., :d]


def flow_jacobian(field: FlowField, points: ArrayLike) -> Array:
    """Return dw/dx at points of shape (..., d), shape (..., d, d), 1/s."""
    steps = 1e-30j * np.eye(np.shape(points)[-1])
    return np.stack([flow_velocity(field, np.asarray(points) + step).imag * 1e30 for step in steps], axis=-1)
