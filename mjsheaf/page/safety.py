"""Obstacles of a run, and what the filter keeps agents from, for its page."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from mjsheaf.arrays import Array
from mjsheaf.law.obstacles import BOX, CAPSULE, HALF_SPACE, SPHERE, ObstacleArrays, centres, points_kept_from
from mjsheaf.mujoco_import import mujoco
from mjsheaf.system import System

if TYPE_CHECKING:
    from mjsheaf.page.replay import Packer, Scene

RECORDED = ("safety_correction", "safety_cause")
"""Variables that the page shows of a run with a section `safety`."""

_COLOUR = (0.78, 0.55, 0.38)  # RGB, as in the video
_OPACITY = {HALF_SPACE: 0.3}  # of all others 1
_SHAPES = {SPHERE: "sphere", CAPSULE: "capsule", BOX: "box", HALF_SPACE: "box"}
_FACE = 0.002  # half the thickness at which the face of a half-space is drawn, in sizes of the scene
_REACH = 2.0  # half the width of that face, in sizes of the scene


def add_safety(
    packer: "Packer", system: System, own: xr.Dataset, positions: Array, scene: "Scene", origin: Array
) -> dict[str, Any]:
    """Pack where obstacles are, and what the filter keeps each agent from, at the samples of a page.

    Args:
        packer: Gets the arrays `obstacle` with centres; `cause` with the number, from 1, of the vehicle or obstacle
            that an agent is kept from, or 0; `correction` in m/s; and `kept_from` with the nearest point of that, NaN
            without one.
        system: System of the run.
        own: Samples of the run that the page keeps.
        positions: Positions of the vehicles at these from the origin, shape (K, V, 3), m.
        scene: Where the run takes place.
        origin: Origin of the page's places, shape (3,), m.

    Returns:
        Description of each obstacle.
    """
    if system.safety is None or "safety_cause" not in own:
        return {"obstacles": []}
    obstacles = system.control.law.safety.obstacles
    time = own["time"].values
    places = np.array([centres(obstacles, t) for t in time]).reshape(len(time), -1, 3) - origin
    plane = obstacles.kind == HALF_SPACE
    normals = obstacles.axes[plane, 0]
    depth = ((scene.centre - places[:, plane]) * normals).sum(axis=2) + _FACE * scene.size
    places[:, plane] = scene.centre - depth[..., None] * normals
    packer.add_fixed("obstacle", scene.confined(places), scene.step)
    correction, cause = (own[name].values for name in RECORDED)
    cause = np.where(correction > 0.0, cause, 0).astype(np.int64)
    kept_from = points_kept_from(obstacles, cause, time, positions + origin) - origin
    packer.add_fixed("cause", cause.astype(np.float64), 1.0)
    packer.add_float("correction", correction)
    packer.add_fixed("kept_from", scene.confined(kept_from), scene.step)
    ids = system.safety.obstacle_ids
    return {"obstacles": [_described(obstacles, n, id, scene.size) for n, id in enumerate(ids)]}


def _described(obstacles: ObstacleArrays, n: int, id: str, size: float) -> dict[str, Any]:
    """Describe obstacle n as a solid with the sizes of a MuJoCo geom, in m."""
    kind, (x, y, z) = int(obstacles.kind[n]), obstacles.axes[n]
    columns, extent = (x, y, z), obstacles.size[n]
    if kind == CAPSULE:  # MuJoCo's capsules lie along their z axis, and have the radius first
        columns, extent = (y, z, x), np.array([extent[1], extent[0], 0.0])
    elif kind == HALF_SPACE:
        extent = size * np.array([_FACE, _REACH, _REACH])
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.column_stack(columns).ravel())
    return {
        "id": id,
        "shape": _SHAPES[kind],
        "size": extent.tolist(),
        "position": [0.0, 0.0, 0.0],
        "quaternion": quaternion.tolist(),
        "colour": _COLOUR,
        "opacity": _OPACITY.get(kind, 1.0),
        "livery": False,
    }
