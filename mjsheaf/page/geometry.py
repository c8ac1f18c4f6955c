"""Shapes of vehicles as MuJoCo's compiled model has them, one list of solids for each kind of vehicle."""

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.mujoco_import import mujoco
from mjsheaf.vehicles.arena import compose
from mjsheaf.vehicles.loading import SEEN_GROUPS
from mjsheaf.vehicles.vehicle import Vehicle

_SHAPES = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}
_MOST_TRIANGLES = 20_000  # of one mesh; of a larger one every n-th is drawn


def kinds_of(vehicles: Sequence[Vehicle]) -> tuple[list[dict[str, Any]], list[int]]:
    """The shape of each kind of vehicle, and the number of each vehicle's kind.

    A kind has its `name`, its `radius` about the body's origin, m, how far `ahead` of that the controlled point is, m,
    and `solids`: `shape`, MuJoCo's `size` in m, `position` and `quaternion` in the body frame, `colour` RGB in 0..1,
    `opacity`, and whether it is `livery`, painted in the colour of the vehicle's group.
    """
    kinds = list({id(vehicle): vehicle for vehicle in vehicles}.values())
    number = {id(vehicle): k for k, vehicle in enumerate(kinds)}
    arena = compose(kinds, [f"kind{k}" for k in range(len(kinds))])
    model, data = arena.model, mujoco.MjData(arena.model)
    mujoco.mj_kinematics(model, data)
    root = np.full(model.nbody, -1)
    root[arena.body] = np.arange(len(kinds))
    owner = root[model.body_rootid[model.geom_bodyid]]
    found = []
    for k, vehicle in enumerate(kinds):
        own = np.flatnonzero((owner == k) & (model.geom_group < SEEN_GROUPS))
        place, turn = data.xpos[arena.body[k]], data.xmat[arena.body[k]].reshape(3, 3)
        solids = [solid for g in own if (solid := _solid(model, data, int(g), place, turn)) is not None]
        found.append(
            {
                "name": vehicle.name,
                "radius": vehicle.radius,
                "ahead": float(vehicle.steering.hand),
                "solids": solids,
            }
        )
    return found, [number[id(vehicle)] for vehicle in vehicles]


def _solid(model: mujoco.MjModel, data: mujoco.MjData, g: int, place: Array, turn: Array) -> dict[str, Any] | None:
    """One geom, in the frame of its vehicle's body; None where it cannot be seen."""
    kind = mujoco.mjtGeom(int(model.geom_type[g]))
    material = int(model.geom_matid[g])
    rgba = model.geom_rgba[g] if material < 0 else model.mat_rgba[material]
    if rgba[3] <= 0.0 or (kind not in _SHAPES and kind != mujoco.mjtGeom.mjGEOM_MESH):
        return None
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, (turn.T @ data.geom_xmat[g].reshape(3, 3)).ravel())
    solid = {
        "shape": _SHAPES.get(kind, "mesh"),
        "size": _rounded(model.geom_size[g]),
        "position": _rounded(turn.T @ (data.geom_xpos[g] - place)),
        "quaternion": _rounded(quaternion),
        "colour": _rounded(rgba[:3]),
        "opacity": float(round(float(rgba[3]), 3)),
        "livery": material >= 0 and model.mat(material).name.endswith("/livery"),
    }
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        solid |= _mesh(model, int(model.geom_dataid[g]))
    return solid


def _mesh(model: mujoco.MjModel, mesh: int) -> dict[str, Any]:
    """Vertices, float32, and triangles, uint32, of a mesh in base64."""
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = np.asarray(model.mesh_vert[first : first + count], "<f4")
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    faces = np.asarray(model.mesh_face[first : first + count], "<u4")[:: -(-count // _MOST_TRIANGLES)]
    used, corners = np.unique(faces, return_inverse=True)
    parts = (("vertices", vertices[used]), ("faces", corners.astype("<u4")))
    return {name: base64.b64encode(np.ascontiguousarray(x).tobytes()).decode() for name, x in parts}


def _rounded(values: Array) -> list[float]:
    return [float(f"{x:.5g}") for x in np.asarray(values, np.float64).ravel()]
