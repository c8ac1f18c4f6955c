"""Obstacles as geoms of MuJoCo, which vehicles touch where contacts are on.

An obstacle at rest belongs to the world. One that moves is a mocap body: the loop puts it where its motion has it
before every step, and contacts push vehicles only. To MuJoCo a mocap body has no velocity, so that it exerts no drag
by friction. The geoms are in the group of collision shapes, which pictures leave out: they draw obstacles
themselves.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from mjsheaf.control.obstacles import BOX, CAPSULE, HALF_SPACE, SPHERE, ObstacleArrays, centres
from mjsheaf.dynamics.motion import position_at
from mjsheaf.engine import mujoco
from mjsheaf.jit import inline_jit

PREFIX = "obstacle/"
"""Beginning of the names of these bodies and geoms; the id of the obstacle follows."""

_GROUP = 3  # of collision shapes
_SHAPES = mujoco.mjtGeom
_TYPES = {SPHERE: _SHAPES.mjGEOM_SPHERE, CAPSULE: _SHAPES.mjGEOM_CAPSULE, BOX: _SHAPES.mjGEOM_BOX,
          HALF_SPACE: _SHAPES.mjGEOM_PLANE}  # fmt: skip


def add_obstacles(root: mujoco.MjSpec, obstacles: ObstacleArrays, ids: Sequence[str], time: float) -> None:
    """Add obstacles of these ids to an arena, where they are at a time in s."""
    for n, (id, centre) in enumerate(zip(ids, centres(obstacles, time), strict=True)):
        kind, (x, y, z), size = int(obstacles.kind[n]), obstacles.axes[n], obstacles.size[n]
        columns = (y, z, x) if kind in (CAPSULE, HALF_SPACE) else (x, y, z)  # theirs is the z axis
        extent = {
            SPHERE: [size[0], 0.0, 0.0],
            CAPSULE: [size[1], size[0], 0.0],
            BOX: size,
            HALF_SPACE: [0.0, 0.0, 1.0],
        }[kind]
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.column_stack(columns).ravel())
        body = root.worldbody.add_body(
            name=f"{PREFIX}{id}", pos=centre, quat=quaternion, mocap=bool(obstacles.speed[n] > 0.0)
        )
        body.add_geom(name=f"{PREFIX}{id}", type=_TYPES[kind], size=extent, group=_GROUP, rgba=[0.78, 0.55, 0.38, 1.0])


def movers_of(obstacles: ObstacleArrays | None) -> tuple[Any, ...]:
    """Return numbers and motion of the obstacles that are mocap bodies, in order; () without any."""
    if obstacles is None or not (obstacles.speed > 0.0).any():
        return ()
    return np.flatnonzero(obstacles.speed > 0.0), obstacles.motion


@inline_jit
def place_obstacles(movers, t, places):
    """Write where obstacles are at time t, s, into mocap_pos (M, 3), m; nothing if `movers` is ()."""
    if len(movers) == 0:
        return
    for m in range(places.shape[0]):
        x, y, z = position_at(movers[1], movers[0][m], t)
        places[m, 0] = x
        places[m, 1] = y
        places[m, 2] = z
