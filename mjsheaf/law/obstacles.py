"""Obstacles: convex bodies, at rest or in motion, and how far a point is from them, for compiled code.

| kind       | set                                                       | size                             |
|------------|-----------------------------------------------------------|----------------------------------|
| sphere     | within `radius` of the centre                             | radius                           |
| capsule    | within `radius` of a segment along its x axis             | half the length, radius          |
| box        | |coordinates along its axes| <= half its sides            | half of each side                |
| half_space | behind the plane through the centre, normal its x axis    |                                  |
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator, model_validator

from mjsheaf.arrays import Array, IntArray
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.errors import in_field
from mjsheaf.law.paths import PARTS, Adrift, Motion, MotionArrays, pack_motions, position_at, reference_bounds
from mjsheaf.section import Id, Number, Point, Positive, Tagged

SPHERE, CAPSULE, BOX, HALF_SPACE = 0, 1, 2, 3
"""Kinds of obstacles."""
KINDS = ("sphere", "capsule", "box", "half_space")


class ObstacleArrays(NamedTuple):
    """K obstacles.

    Attributes:
        kind: Kind of each, shape (K,).
        axes: Unit vectors of its axes, one row each, shape (K, 3, 3).
        size: See above, shape (K, 3), m.
        speed: Bound on the speed at which it moves, shape (K,), m/s.
        motion: Where its centre is.
    """

    kind: IntArray
    axes: Array
    size: Array
    speed: Array
    motion: MotionArrays


class Obstacle(Tagged, ABC):
    """Base of all obstacles; subclasses must implement `shape`."""

    id: Id | None = Field(None, description="name that results and pictures show; kind and number unless given")
    motion: Motion | None = Field(None, description="motion of the centre, without turning; at rest unless given")

    @field_validator("motion")
    @classmethod
    def _not_carried(cls, motion: Motion | None) -> Motion | None:
        if isinstance(motion, Adrift):
            raise ValueError("no flow carries an obstacle; expected a motion other than adrift, or none")
        return motion

    @abstractmethod
    def shape(self) -> "Shape":
        """Return its place, axis and size."""


class Shape(NamedTuple):
    """Place and size of an obstacle.

    Attributes:
        place: Initial position of the centre, 2 or 3 coordinates, m.
        size: Sizes as the module has them, m.
        axis: Direction of the x axis, a unit vector, shape (3,).
    """

    place: Sequence[float]
    size: Sequence[float] = ()
    axis: Array = np.array([1.0, 0.0, 0.0])


class Sphere(Obstacle):
    """A ball."""

    kind: Literal["sphere"] = Field("sphere", description="always sphere")
    centre: Point = Field(description="its centre; of two numbers the third is scene.height [m]")
    radius: Positive = Field(description="its radius [m]")

    def shape(self) -> Shape:
        """Return the centre and the radius."""
        return Shape(self.centre, [self.radius])


class Capsule(Obstacle):
    """All points within a radius of a segment."""

    kind: Literal["capsule"] = Field("capsule", description="always capsule")
    ends: Annotated[list[Point], Field(min_length=2, max_length=2)] = Field(
        description="the two ends of the segment; of two numbers the third is scene.height [m]"
    )
    radius: Positive = Field(description="its radius [m]")

    @model_validator(mode="after")
    def _is_long(self) -> "Capsule":
        if len(self.ends[0]) != len(self.ends[1]) or self.ends[0] == self.ends[1]:
            raise ValueError("ends: expected two different points of the same dimension")
        return self

    def shape(self) -> Shape:
        """Return the centre of the segment, half its length, the radius, and the direction of the segment."""
        span = np.array([*np.subtract(self.ends[1], self.ends[0]), 0.0][:3])
        length = np.linalg.norm(span, axis=0)
        middle = [0.5 * (a + b) for a, b in zip(*self.ends, strict=True)]
        return Shape(middle, [0.5 * float(length), self.radius], span / length)


class Box(Obstacle):
    """A box that stands upright."""

    kind: Literal["box"] = Field("box", description="always box")
    centre: Point = Field(description="its centre; of two numbers the third is scene.height [m]")
    sides: Annotated[list[Positive], Field(min_length=3, max_length=3)] = Field(
        description="lengths of its sides along its x, y and z axes [m]"
    )
    heading: Number = Field(0.0, description="rotation about z [degrees]")

    def shape(self) -> Shape:
        """Return the centre, half of each side, and the direction of the first side."""
        angle = np.deg2rad(self.heading)
        return Shape(self.centre, [0.5 * side for side in self.sides], np.array([np.cos(angle), np.sin(angle), 0.0]))


class HalfSpace(Obstacle):
    """All that lies behind a plane, such as a wall or the ground."""

    kind: Literal["half_space"] = Field("half_space", description="always half_space")
    point: Point = Field(description="a point of the plane; of two numbers the third is scene.height [m]")
    normal: Point = Field(description="direction out of the obstacle, of any length [-]")

    @model_validator(mode="after")
    def _has_direction(self) -> "HalfSpace":
        if not any(self.normal):
            raise ValueError("normal: is zero; expected a direction")
        return self

    def shape(self) -> Shape:
        """Return a point of the plane, and the normal."""
        normal = np.array([*self.normal, 0.0][:3])
        return Shape(self.point, axis=normal / np.linalg.norm(normal, axis=0))


AnyObstacle = Annotated[Sphere | Capsule | Box | HalfSpace, Field(discriminator="kind")]


def pack_obstacles(some: Sequence[AnyObstacle], height: float, start: float, end: float) -> ObstacleArrays:
    """Return obstacles for compiled code; those in the plane are at a height in m.

    Raises:
        InputError: A motion does not fit; the message begins with the field.
    """
    K = len(some)
    places, size, axes = np.zeros((K, 3)), np.zeros((K, 3)), np.zeros((K, 3, 3))
    shapes = [one.shape() for one in some]
    for k, (place, sizes, x) in enumerate(shapes):
        places[k] = [*place, height][:3]
        size[k, : len(sizes)] = sizes
        aside = np.array([0.0, 0.0, 1.0]) if abs(x[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        y = np.cross(aside, x)
        y /= np.linalg.norm(y, axis=0)
        axes[k] = x, y, np.cross(x, y)
    dimensions = [len(shape.place) for shape in shapes]
    with in_field("safety.obstacles"):
        motion = pack_motions([one.motion for one in some], places, start, dimensions, end)
    kinds = np.array([KINDS.index(one.kind) for one in some], dtype=np.int64)
    return ObstacleArrays(kinds, axes, size, reference_bounds(motion, parts=PARTS)[0], motion)


@inline_jit
def _from_box(size, ax, ay, az):
    """Return signed distance and outward normal, in the box's axes, of a point (ax, ay, az) from a box about 0."""
    dx, dy, dz = abs(ax) - size[0], abs(ay) - size[1], abs(az) - size[2]
    if dx <= 0.0 and dy <= 0.0 and dz <= 0.0:  # inside: the nearest face
        if dx >= dy and dx >= dz:
            return dx, np.copysign(1.0, ax), 0.0, 0.0
        if dy >= dz:
            return dy, 0.0, np.copysign(1.0, ay), 0.0
        return dz, 0.0, 0.0, np.copysign(1.0, az)
    px = np.copysign(max(dx, 0.0), ax)
    py = np.copysign(max(dy, 0.0), ay)
    pz = np.copysign(max(dz, 0.0), az)
    away = np.sqrt(px * px + py * py + pz * pz)
    return away, px / away, py / away, pz / away


@inline_jit
def _from_core(radius, x, y, z):
    """Return signed distance and normal of a point (x, y, z) from a ball about 0; at 0 the normal is the x axis."""
    away = np.sqrt(x * x + y * y + z * z)
    if away == 0.0:
        return -radius, 1.0, 0.0, 0.0
    return away - radius, x / away, y / away, z / away


@jit
def distance_from(obstacles, k, t, x, y, z):
    """Return how far a point is from obstacle k at time t, s, and the outward normal there.

    Returns:
        The signed distance to the surface in m, negative inside, and three numbers: the gradient of the distance, a
        unit vector. The obstacle lies behind the plane through its nearest point across the gradient, as it is convex.
    """
    kind, size, axes = obstacles.kind[k], obstacles.size[k], obstacles.axes[k]
    cx, cy, cz = position_at(obstacles.motion, k, t)
    rx, ry, rz = x - cx, y - cy, z - cz
    if kind == SPHERE:
        return _from_core(size[0], rx, ry, rz)
    ax = axes[0, 0] * rx + axes[0, 1] * ry + axes[0, 2] * rz
    if kind == HALF_SPACE:
        return ax, axes[0, 0], axes[0, 1], axes[0, 2]
    if kind == CAPSULE:
        along = min(max(ax, -size[0]), size[0])
        return _from_core(size[1], rx - along * axes[0, 0], ry - along * axes[0, 1], rz - along * axes[0, 2])
    ay = axes[1, 0] * rx + axes[1, 1] * ry + axes[1, 2] * rz
    az = axes[2, 0] * rx + axes[2, 1] * ry + axes[2, 2] * rz
    away, nx, ny, nz = _from_box(size, ax, ay, az)
    return (
        away,
        nx * axes[0, 0] + ny * axes[1, 0] + nz * axes[2, 0],
        nx * axes[0, 1] + ny * axes[1, 1] + nz * axes[2, 1],
        nx * axes[0, 2] + ny * axes[1, 2] + nz * axes[2, 2],
    )


@jit
def _probe(obstacles, which, times, points, out):
    """Write signed distance and outward normal of point k from obstacle which[k] at times[k] into out (P, 4)."""
    for p in range(points.shape[0]):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        out[p, 0], out[p, 1], out[p, 2], out[p, 3] = distance_from(obstacles, which[p], times[p], x, y, z)


def distances(obstacles: ObstacleArrays, times: Array, points: Array) -> Array:
    """Compute signed distances to the surfaces of K obstacles.

    Args:
        obstacles: The obstacles.
        times: Shape (T,), s.
        points: Shape (T, P, 3), m.

    Returns:
        Shape (T, P, K), m; negative inside.
    """
    shape = *points.shape[:2], len(obstacles.kind)
    k, i, which = (of.ravel() for of in np.indices(shape))
    found = np.empty((len(which), 4))
    _probe(obstacles, which, np.asarray(times, dtype=np.float64)[k], np.asarray(points, dtype=np.float64)[k, i], found)
    return found[:, 0].reshape(shape)


def centres(obstacles: ObstacleArrays, time: float) -> Array:
    """Return the centre of every obstacle (the point of a half-space) at a time in s, shape (K, 3), m."""
    found = [position_at(obstacles.motion, k, float(time)) for k in range(len(obstacles.kind))]
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def nearest_points(obstacles: ObstacleArrays, which: IntArray, times: Array, points: Array) -> Array:
    """Compute the point on the surface of an obstacle that is nearest to each of P points.

    Args:
        obstacles: The obstacles.
        which: Number of the obstacle for each point, shape (P,).
        times: Shape (P,), s.
        points: Shape (P, 3), m.

    Returns:
        Shape (P, 3), m.
    """
    found = np.empty((len(points), 4))
    _probe(obstacles, which, np.ascontiguousarray(times), np.ascontiguousarray(points), found)
    return np.asarray(points - found[:, :1] * found[:, 1:])


def points_kept_from(obstacles: ObstacleArrays, cause: IntArray, times: Array, positions: Array) -> Array:
    """Compute the point that the safety filter keeps each agent away from.

    Args:
        obstacles: The obstacles.
        cause: Number of a vehicle, from 1, or of an obstacle after the vehicles; 0 for none, shape (T, N).
        times: Shape (T,), s.
        positions: Positions of V vehicles, shape (T, V, 3), m.

    Returns:
        Shape (T, N, 3), m; NaN for none.
    """
    V = positions.shape[1]
    found = np.full((*cause.shape, 3), np.nan)
    k, i = np.nonzero((cause > 0) & (cause <= V))
    found[k, i] = positions[k, cause[k, i] - 1]
    k, i = np.nonzero(cause > V)
    found[k, i] = nearest_points(obstacles, cause[k, i] - V - 1, times[k], positions[k, i])
    return found
