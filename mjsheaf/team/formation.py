"""Formations: named shapes, as one displacement for each member relative to the formation's centre."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjsheaf.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Formation:
    """A group of vehicles and where each belongs relative to the group's centre.

    Attributes:
        name: name of the group.
        members: their ids.
        displacements: o_i of each member in m, in the member's own dimension.
        about: id of the target that the centre should follow, or None for a free formation.
    """

    name: str
    members: tuple[str, ...]
    displacements: tuple[Array, ...]
    about: str | None = None


def polygon(
    count: int,
    *,
    side: float | None = None,
    radius: float | None = None,
    angle: float = 90.0,
    clockwise: bool = False,
) -> Array:
    """Corners of a regular polygon about the origin, shape (count, 2), in m.

    Args:
        count: number of corners, at least 2.
        side, radius: exactly one of them, in m.
        angle: bearing of the first corner from the x axis, degrees.
        clockwise: whether the next corners follow clockwise.
    """
    if count < 2:
        raise InputError(f"a polygon needs at least 2 members, not {count}")
    if (side is None) == (radius is None):
        raise InputError("a polygon needs either 'side' or 'radius'")
    if radius is None:
        assert side is not None
        radius = side / (2.0 * np.sin(np.pi / count))
    turn = np.deg2rad(angle) + (-1 if clockwise else 1) * 2.0 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(turn), np.sin(turn)])


def tetrahedron(side: float) -> Array:
    """Corners of a regular tetrahedron about its centroid, apex up and last, shape (4, 3), in m."""
    base = polygon(3, side=side, angle=210.0)
    return np.vstack(
        [
            np.column_stack([base, np.full(3, -side * np.sqrt(6.0) / 12.0)]),
            [[0.0, 0.0, side * np.sqrt(6.0) / 4.0]],
        ]
    )


def line(count: int, *, spacing: float, angle: float = 0.0) -> Array:
    """Equally spaced points on a horizontal line about the origin, shape (count, 2), in m; angle in degrees."""
    along = spacing * (np.arange(count) - (count - 1) / 2.0)
    return np.outer(along, [np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])


def displacements(shape: Array, dimensions: Sequence[int], height: float = 0.0) -> tuple[Array, ...]:
    """Give each member its displacement in its own dimension.

    Args:
        shape: corners, shape (count, 2) or (count, 3).
        dimensions: stalk dimension of each member.
        height: added to the z of spatial members, in m.

    Raises:
        InputError: the number of corners is not the number of members.
    """
    if len(shape) != len(dimensions):
        raise InputError(f"the shape has {len(shape)} places but the formation has {len(dimensions)} members")
    spatial = np.zeros((len(shape), 3))
    spatial[:, : shape.shape[1]] = shape
    spatial[:, 2] += height
    return tuple(o[:n].copy() for o, n in zip(spatial, dimensions, strict=True))


def explicit(values: Sequence[ArrayLike], dimensions: Sequence[int]) -> tuple[Array, ...]:
    """Displacements as given, checked against each member's dimension."""
    if len(values) != len(dimensions):
        raise InputError(f"{len(values)} displacements for {len(dimensions)} members")
    result = []
    for k, (value, n) in enumerate(zip(values, dimensions, strict=True)):
        o = np.asarray(value, dtype=np.float64)
        if o.shape != (n,):
            raise InputError(f"displacement {k} has {o.size} entries, but the member has dimension {n}")
        result.append(o)
    return tuple(result)
