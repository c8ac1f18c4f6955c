"""Shapes of vehicles and obstacles as solids, for all viewers.

Those of vehicles are what MuJoCo's compiled model has, one list for each kind of vehicle.
"""

import base64
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.law.obstacles import BOX, CAPSULE, HALF_SPACE, SPHERE, ObstacleArrays, centres
from mjsheaf.mujoco_import import mujoco
from mjsheaf.vehicles.arena import compose
from mjsheaf.vehicles.loading import SEEN_GROUPS
from mjsheaf.vehicles.vehicle import Vehicle, kinds_of

_SHAPES = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}
_OBSTACLES = {SPHERE: "sphere", CAPSULE: "capsule", BOX: "box", HALF_SPACE: "box"}
_FAR = 1e4  # size at which a half-space is drawn in an outline, m


def shapes_of(vehicles: Sequence[Vehicle]) -> tuple[list[dict[str, Any]], list[int]]:
    """The shape of each kind of vehicle, and the number of each vehicle's kind.

    A kind has its `name`, its `radius` about the body's origin, m, how far `ahead` of that the controlled point is, m,
    and `solids`: `shape`, MuJoCo's `size` in m, `position` and `quaternion` in the body frame, `colour` RGB in 0..1,
    `opacity`, and whether it is `livery`, painted in the colour of the vehicle's group.
    """
    kinds, number = kinds_of(vehicles)
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
    return found, number.tolist()


def _solid(model: mujoco.MjModel, data: mujoco.MjData, g: int, place: Array, turn: Array) -> dict[str, Any] | None:
    """One geom, in the frame of its vehicle's body; None where it cannot be seen."""
    kind = mujoco.mjtGeom(int(model.geom_type[g]))
    material = int(model.geom_matid[g])
    rgba = model.geom_rgba[g] if material < 0 else model.mat_rgba[material]
    if rgba[3] <= 0.0 or (kind not in _SHAPES and kind != mujoco.mjtGeom.mjGEOM_MESH):
        return None
    quaternion = quaternion_of(turn.T @ data.geom_xmat[g].reshape(3, 3))
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
        mesh = int(model.geom_dataid[g])
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        vertices = np.asarray(model.mesh_vert[first : first + count], "<f4")
        first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        # Of more than 20,000 triangles every n-th is drawn.
        faces = np.asarray(model.mesh_face[first : first + count], "<u4")[:: -(-count // 20_000)]
        used, corners = np.unique(faces, return_inverse=True)
        for name, values in {"vertices": vertices[used], "faces": corners.astype("<u4")}.items():  # in base64
            solid[name] = base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
    return solid


def quaternion_of(axes: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation matrix, shape (4,)."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    return quaternion


def _rounded(values: Array) -> list[float]:
    return [float(f"{x:.5g}") for x in np.asarray(values, np.float64).ravel()]


# -- solids that every viewer has --------------------------------------------------------------------------------------


class Part(NamedTuple):
    """A solid that every viewer has, in the frame of its vehicle.

    Attributes:
        shape: 'sphere', 'box', 'cylinder' or 'triangles'.
        pose: Position and quaternion x, y, z, w, shape (7,), m.
        size: Extent along the solid's axes, shape (3,), m; 1 for triangles.
        colour: RGBA, shape (4,), 0..1.
        points: Three corners of each triangle in turn, shape (3 n, 3), m; empty for other shapes.
    """

    shape: str
    pose: Array
    size: Array
    colour: Array
    points: Array


_NO_POINTS = np.zeros((0, 3))


def parts_of(vehicles: Sequence[Vehicle], colours: Array, *, at_hand: bool) -> tuple[list[list[Part]], Array]:
    """Return the solids of each vehicle, and each one's radius, shape (V,), m.

    Args:
        vehicles: Vehicles of a run.
        colours: Colour of each vehicle's livery, RGB, shape (V, 3).
        at_hand: True if the frame's origin is the controlled point, False if it is the body's.
    """
    kinds, number = shapes_of(vehicles)
    found = []
    for k, colour in zip(number, colours, strict=True):
        shift = np.array([-kinds[k]["ahead"] if at_hand else 0.0, 0.0, 0.0])
        found.append([part for solid in kinds[k]["solids"] for part in _parts(solid, colour, shift)])
    return found, np.array([kinds[k]["radius"] for k in number])


def _parts(solid: dict[str, Any], livery: Array, shift: Array) -> Iterator[Part]:
    """Return the solids that make up one of MuJoCo's."""
    size = np.array(solid["size"])
    turn = np.array(solid["quaternion"])[[1, 2, 3, 0]]
    place = np.array(solid["position"]) + shift
    colour = np.append(livery if solid["livery"] else solid["colour"], solid["opacity"])
    pose = np.append(place, turn)
    shape = solid["shape"]
    if shape == "mesh":
        vertices = np.frombuffer(base64.b64decode(solid["vertices"]), "<f4").reshape(-1, 3)
        faces = np.frombuffer(base64.b64decode(solid["faces"]), "<u4").astype(np.int64)
        yield Part("triangles", pose, np.ones(3), colour, vertices[faces.ravel()].astype(np.float64))
    elif shape in ("cylinder", "capsule"):
        yield Part("cylinder", pose, 2.0 * size[[0, 0, 1]], colour, _NO_POINTS)
        if shape == "capsule":
            axis = np.zeros(3)
            mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, size[1]]), np.array(solid["quaternion"]))
            for end in (place - axis, place + axis):
                yield Part("sphere", np.append(end, turn), 2.0 * size[[0, 0, 0]], colour, _NO_POINTS)
    else:
        extent = 2.0 * (size[[0, 0, 0]] if shape == "sphere" else size)
        yield Part("box" if shape == "box" else "sphere", pose, extent, colour, _NO_POINTS)


# -- obstacles ---------------------------------------------------------------------------------------------------------


def obstacle_solids(obstacles: ObstacleArrays, face: float, reach: float) -> list[tuple[str, Array, Array]]:
    """Return the shape of every obstacle, its size as of a MuJoCo geom, (3,), m, and its axes as columns, (3, 3).

    Args:
        obstacles: The obstacles.
        face: Half the thickness at which the face of a half-space is drawn, m.
        reach: Half the width of that face, m.
    """
    found = []
    for kind, (x, y, z), size in zip(obstacles.kind.tolist(), obstacles.axes, obstacles.size, strict=True):
        columns, extent = (x, y, z), size
        if kind == CAPSULE:  # MuJoCo's capsules lie along their z axis, and have the radius first
            columns, extent = (y, z, x), np.array([size[1], size[0], 0.0])
        elif kind == HALF_SPACE:
            extent = np.array([face, reach, reach])
        found.append((_OBSTACLES[kind], extent, np.column_stack(columns)))
    return found


def obstacle_places(obstacles: ObstacleArrays, time: float, middle: Array, face: float) -> Array:
    """Return where the centre of every solid of `obstacle_solids` is at a time in s, shape (K, 3), m.

    The face of a half-space is centred below the point `middle`, shape (3,), m.
    """
    places = centres(obstacles, time)
    plane = obstacles.kind == HALF_SPACE
    normal = obstacles.axes[plane, 0]
    depth = ((middle - places[plane]) * normal).sum(axis=1) + face
    places[plane] = middle - depth[:, None] * normal
    return places


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
    angle = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False) + np.pi / 72
    ways = np.column_stack([np.cos(angle), np.sin(angle)]) @ projection  # in space, shape (P, 3)
    if obstacles.kind[n] == HALF_SPACE:
        normal = projection @ obstacles.axes[n, 0]
        if np.linalg.norm(normal) < 1.0 - 1e-6:
            return None
        side = np.array([-normal[1], normal[0]])
        return np.asarray(projection @ centre + _FAR * np.array([side, side - normal, -side - normal, -side]))
    return np.asarray((centre + farthest(obstacles, n, ways)) @ projection.T)


def farthest(obstacles: ObstacleArrays, n: int, ways: Array) -> Array:
    """Return the farthest points of a body in directions (P, 3) from its centre, shape (P, 3), m."""
    axes, size = obstacles.axes[n], obstacles.size[n]
    along = np.where(ways @ axes.T >= 0.0, 1.0, -1.0)
    return {
        SPHERE: size[0] * ways,
        CAPSULE: along[:, :1] * size[0] * axes[0] + size[1] * ways,
        BOX: (along * size) @ axes,
    }[int(obstacles.kind[n])]
