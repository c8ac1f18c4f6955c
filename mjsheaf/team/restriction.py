"""Restriction maps by name: what the two ends of an edge can compare.

| name        | F_tail          | F_head          | edge stalk              | in the paper                         |
|-------------|-----------------|-----------------|-------------------------|--------------------------------------|
| identity    | I               | I               | R^n, equal dimensions   | constant sheaf                       |
| shared      | [I_m 0]         | [I_m 0]         | R^m, m the smaller n    | Example 4, USV-UAV projection        |
| local_frame | R_tail [I_m 0]  | R_tail [I_m 0]  | R^m in the tail's frame | Examples 5 and 6, R_i and R_i P      |
"""

import numpy as np
from numpy.typing import NDArray

from mjsheaf.errors import InputError

Array = NDArray[np.float64]

NAMES = ("identity", "shared", "local_frame")


def rotation_to_local(roll: float, pitch: float, yaw: float, dimension: int) -> Array:
    """R_i, which takes global coordinates to the frame of a vehicle with the given attitude.

    Args:
        roll, pitch, yaw: attitude of the local frame in rad: yaw about z, then pitch about y, then roll about x.
        dimension: 2 (yaw alone) or 3.

    Returns:
        A rotation of shape (dimension, dimension).
    """
    cy, sy = np.cos(yaw), np.sin(yaw)
    if dimension == 2:
        return np.array([[cy, sy], [-sy, cy]])
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return (about_z @ about_y @ about_x).T


def restriction_maps(
    name: str, n_tail: int, n_head: int, attitude: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Array, Array]:
    """Restriction maps (F_tail, F_head) of a named kind.

    Args:
        name: one of NAMES.
        n_tail, n_head: dimensions of the two vertex stalks.
        attitude: roll, pitch and yaw of the tail in rad; used by `local_frame`.

    Raises:
        InputError: unknown name, or `identity` between unequal dimensions.
    """
    m = min(n_tail, n_head)
    tail, head = np.eye(m, n_tail), np.eye(m, n_head)
    if name == "shared":
        return tail, head
    if name == "identity":
        if n_tail != n_head:
            raise InputError(f"map 'identity' needs equal dimensions, but they are {n_tail} and {n_head}; use 'shared'")
        return tail, head
    if name == "local_frame":
        R = rotation_to_local(*attitude, dimension=m)
        return R @ tail, R @ head
    raise InputError(f"unknown restriction map {name!r}; expected {', '.join(NAMES)}")
