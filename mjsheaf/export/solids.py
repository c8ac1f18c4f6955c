"""Shapes of vehicles as solids that every viewer has: spheres, boxes, cylinders and triangles."""

import base64
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.mujoco_import import mujoco
from mjsheaf.page.geometry import kinds_of
from mjsheaf.vehicles.vehicle import Vehicle


class Solid(NamedTuple):
    """A solid in the frame of its vehicle.

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


def solids_of(vehicles: Sequence[Vehicle], colours: Array, *, at_hand: bool) -> tuple[list[list[Solid]], Array]:
    """Return the solids of each vehicle, and each one's radius, shape (V,), m.

    Args:
        vehicles: Vehicles of a run.
        colours: Colour of each vehicle's livery, RGB, shape (V, 3).
        at_hand: True if the frame's origin is the controlled point, False if it is the body's.
    """
    kinds, number = kinds_of(vehicles)
    found = []
    for k, colour in zip(number, colours, strict=True):
        shift = np.array([-kinds[k]["ahead"] if at_hand else 0.0, 0.0, 0.0])
        found.append([part for solid in kinds[k]["solids"] for part in _parts(solid, colour, shift)])
    return found, np.array([kinds[k]["radius"] for k in number])


def _parts(solid: dict[str, Any], livery: Array, shift: Array) -> Iterator[Solid]:
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
        yield Solid("triangles", pose, np.ones(3), colour, vertices[faces.ravel()].astype(np.float64))
    elif shape in ("cylinder", "capsule"):
        yield Solid("cylinder", pose, 2.0 * size[[0, 0, 1]], colour, _NO_POINTS)
        if shape == "capsule":
            axis = np.zeros(3)
            mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, size[1]]), np.array(solid["quaternion"]))
            for end in (place - axis, place + axis):
                yield Solid("sphere", np.append(end, turn), 2.0 * size[[0, 0, 0]], colour, _NO_POINTS)
    else:
        extent = 2.0 * (size[[0, 0, 0]] if shape == "sphere" else size)
        yield Solid("box" if shape == "box" else "sphere", pose, extent, colour, _NO_POINTS)
