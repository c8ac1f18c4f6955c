"""Formations: named shapes, and where each member belongs relative to the formation's centre."""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.io.section import Id, Number, Point, Positive, Tagged


class Formation(Tagged):
    """Base of a group of members with a place for each; a shape says where, in `corners`."""

    name: Id = Field(description="unique name, which results and plots show")
    members: Annotated[list[Id], Field(min_length=1)] = Field(description="ids, in the order of the shape's places")
    about: Id | None = Field(
        None, description="id of the target that the group's centre should follow; free unless given"
    )
    height: Number = Field(0.0, description="added to z of spatial members [m]")

    def corners(self) -> Array:
        """Places about the origin, one for each member, shape (count, 2) or (count, 3), m."""
        raise NotImplementedError

    def places(self, dimensions: Sequence[int]) -> list[Array]:
        """o_i of each member in m, in the member's own dimension.

        Raises:
            InputError: the shape has another number of places than the formation has members.
        """
        corners = self.corners()
        if len(corners) != len(dimensions):
            raise InputError(f"the shape has {len(corners)} places but the formation has {len(dimensions)} members")
        spatial = np.zeros((len(corners), 3))
        spatial[:, : corners.shape[1]] = corners
        spatial[:, 2] += self.height
        return [o[:n].copy() for o, n in zip(spatial, dimensions, strict=True)]


class Polygon(Formation):
    """A regular polygon."""

    shape: Literal["polygon", "square"] = Field("polygon", description="polygon, or square for one with four members")
    side: Positive | None = Field(None, description="distance of neighbouring corners; give this or radius [m]")
    radius: Positive | None = Field(None, description="distance of corners from the centre; give this or side [m]")
    angle: Number = Field(90.0, description="bearing of the first member from the x axis [degrees]")
    clockwise: bool = Field(False, description="whether members follow one another clockwise")

    @model_validator(mode="after")
    def _check(self) -> "Polygon":
        if (self.side is None) == (self.radius is None):
            raise ValueError("give either side or radius")
        fits = len(self.members) == 4 if self.shape == "square" else len(self.members) >= 2
        if not fits:
            raise ValueError(f"a {self.shape} does not have {len(self.members)} members")
        return self

    def corners(self) -> Array:
        """Corners of the polygon, shape (count, 2), m."""
        count = len(self.members)
        radius = _circumradius(self.side, count) if self.side is not None else self.radius or 0.0
        return _ring(count, radius, self.angle, self.clockwise)


class Line(Formation):
    """Equally spaced points on a horizontal line."""

    shape: Literal["line"] = Field("line", description="always line")
    spacing: Positive = Field(description="distance of neighbouring members [m]")
    angle: Number = Field(0.0, description="bearing of the line from the x axis [degrees]")

    def corners(self) -> Array:
        """Points on the line, shape (count, 2), m."""
        count = len(self.members)
        along = self.spacing * (np.arange(count) - (count - 1) / 2.0)
        return np.outer(along, [np.cos(np.deg2rad(self.angle)), np.sin(np.deg2rad(self.angle))])


class Tetrahedron(Formation):
    """A regular tetrahedron, apex last."""

    shape: Literal["tetrahedron"] = Field(
        "tetrahedron", description="always tetrahedron; its four members are the base, then the apex"
    )
    side: Positive = Field(description="length of every edge [m]")

    def corners(self) -> Array:
        """Corners about the centroid, the apex up and last, shape (4, 3), m."""
        base = _ring(3, _circumradius(self.side, 3), 210.0)
        low, high = -self.side * np.sqrt(6.0) / 12.0, self.side * np.sqrt(6.0) / 4.0
        return np.vstack([np.column_stack([base, np.full(3, low)]), [[0.0, 0.0, high]]])


class Explicit(Formation):
    """Displacements as given, one for each member."""

    shape: Literal["explicit"] = Field("explicit", description="always explicit")
    displacements: Annotated[list[Point], Field(min_length=1)] = Field(
        description="of each member from the group's centre, x, y or x, y, z as the member's position [m]"
    )

    def places(self, dimensions: Sequence[int]) -> list[Array]:
        """The displacements, which must have the members' dimensions."""
        if len(self.displacements) != len(dimensions):
            raise InputError(f"{len(self.displacements)} displacements for {len(dimensions)} members")
        for k, (o, n) in enumerate(zip(self.displacements, dimensions, strict=True)):
            if len(o) != n:
                raise InputError(f"displacement {k} has {len(o)} entries, but the member has dimension {n}")
        return [np.array(o, dtype=np.float64) for o in self.displacements]


Group = Annotated[Polygon | Line | Tetrahedron | Explicit, Field(discriminator="shape")]


def _circumradius(side: float, count: int) -> float:
    return float(side / (2.0 * np.sin(np.pi / count)))


def _ring(count: int, radius: float, angle: float, clockwise: bool = False) -> Array:
    """Corners of a regular polygon about the origin, the first at a bearing in degrees, shape (count, 2)."""
    turn = np.deg2rad(angle) + (-1 if clockwise else 1) * 2.0 * np.pi * np.arange(count) / count
    return np.asarray(radius * np.column_stack([np.cos(turn), np.sin(turn)]))
