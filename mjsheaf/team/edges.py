"""Edges and formations: what two members compare or one measures by itself, and which value that should have.

Restriction maps by name:

| name        | F_tail          | F_head          | edge stalk              | in the paper                         |
|-------------|-----------------|-----------------|-------------------------|--------------------------------------|
| identity    | I               | I               | R^n, equal dimensions   | constant sheaf                       |
| shared      | [I_m 0]         | [I_m 0]         | R^m, m the smaller n    | Example 4, USV-UAV projection        |
| local_frame | R_tail [I_m 0]  | R_tail [I_m 0]  | R^m in the tail's frame | Examples 5 and 6, R_i and R_i P      |
| space       | [I_n; 0]        | [I_n; 0]        | R^3, planar members at the surface's height | -                |

An edge compares relative positions, ranges or bearings: see `mjsheaf.sheaf.nonlinear` for the formulas. Formations are
edges by name: a shape says where each member belongs relative to the formation's centre.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, expected, in_field
from mjsheaf.section import Id, Matrix, Number, Point, Positive, Section, Tagged
from mjsheaf.sheaf.nonlinear import Measure, NonlinearEdge, desired_value
from mjsheaf.team.links import Link, RangeBearing

NAMES = ("identity", "shared", "local_frame", "space")

GROUND = "(ground)"
"""Vertex with a stalk of dimension 0 that anchors end on; no id can be written like this."""


@dataclass(frozen=True)
class Member:
    """An agent or a target.

    Attributes:
        id: its id.
        dimension: Dimension of its state space, 2 (planar) or 3 (spatial).
        attitude: roll, pitch and yaw of its local frame, rad.
        height: z of a planar member in space, m.
    """

    id: str
    dimension: int
    attitude: tuple[float, float, float] = (0.0, 0.0, 0.0)
    height: float = 0.0


class Slope(NamedTuple):
    """Derivative of what pulls at the ends of a range or bearing edge by its relative position z.

    Attributes:
        F_tail, F_head: Restriction maps of z = F_head x_head - F_tail x_tail + lift, shapes (m, n_tail), (m, n_head).
        matrix: Derivative of the pull by z, shape (m, m); of a bearing it need not be symmetric.
        z: Relative position, shape (m,), m.
    """

    F_tail: Array
    F_head: Array
    matrix: Array
    z: Array


@dataclass(frozen=True)
class Edge(NonlinearEdge):
    """An edge of the team's graph with its restriction maps; lengths in m.

    On a sensing edge the tail is the agent, and the head of an anchor is GROUND. An offset of None comes from
    formations.

    Attributes:
        link: what it has of a link's fields by itself; None where nothing.
        slope: Derivative of the pull of a range or bearing edge that this edge linearises and that does not fit; None
            where F^T K F is it.
        apart: F_tail o_tail - F_head o_head of the places in formations that the offset of a range or bearing edge is
            from, shape (m,), m; None if the edge has its own.
    """

    link: Link | None = None
    slope: Slope | None = None
    apart: Array | None = None

    def __str__(self) -> str:
        return f"the anchor of {self.tail}" if self.head == GROUND else f"[{self.tail}, {self.head}]"

    @property
    def between(self) -> tuple[str, str]:
        """The ids of tail and head."""
        return self.tail, self.head

    @property
    def linear(self) -> bool:
        """True if positions are compared and both ends measure."""
        return self.measures == "position" and not self.directed

    @property
    def aim(self) -> Array:
        """Vector from head to tail that the desired value follows from, shape (m,), m.

        It is the desired value of positions; ranges take its length, and bearings its direction, turned round.
        """
        if self.measures == "position":
            return self.b
        if self.apart is not None:
            return self.apart
        return self.desired[0] * np.eye(len(self.F_tail))[0] if self.measures == "range" else -self.desired

    @property
    def equation(self) -> tuple[Any, ...]:
        """F_tail x_tail - F_head x_head = b, weighted by K, as a key that is the same in either direction."""
        ends, sign = [(self.tail, self.F_tail), (self.head, self.F_head)], 1.0
        if self.head < self.tail and not self.directed:
            ends, sign = ends[::-1], 1.0 if self.measures == "range" else -1.0
        b = None if self.offset is None else (sign * self.offset + 0.0).tobytes()  # + 0.0: no negative zeros
        what = (self.measures, self.directed)
        return (*((name, F.shape, (F + 0.0).tobytes()) for name, F in ends), (self.weight + 0.0).tobytes(), b, what)


def anchor(agent: str, F: Array, value: Array, weight: Array) -> Edge:
    """An edge that ties what an agent measures by itself to a fixed value (m,) in m: F q_i should be `value`.

    F has shape (m, n), for an altimeter [[0, 0, 1]]; the weight is the inner product K, shape (m, m).
    """
    return Edge(agent, GROUND, F, np.zeros((len(F), 0)), weight, value)


class ExplicitMaps(Section):
    """Restriction maps as matrices."""

    tail: Matrix = Field(
        description="F_tail, one row for each compared number, one column for each coordinate of the tail [-]"
    )
    head: Matrix = Field(
        description="F_head, one row for each compared number, one column for each coordinate of the head [-]"
    )


_Ends = Annotated[list[Id], Field(min_length=2, max_length=2)]
_Weight = Positive | Matrix | None


class LinearEdge(Link):
    """An edge; a bare pair [tail, head] is short for {between: [tail, head]}.

    Its own link fields precede those of `links`.
    """

    between: _Ends = Field(description="ids of tail and head")
    map: Literal["shared", "identity", "local_frame", "space"] | ExplicitMaps = Field(
        "shared",
        description="shared: coordinates that both have; identity: all; local_frame: in the tail's frame; space: in "
        "space, planar vehicles at scene.height; or matrices",
    )
    measures: Measure = Field(
        "position",
        description="what is compared: position, the relative position; range, its length; bearing, its direction",
    )
    directed: bool = Field(False, description="only the tail measures and moves; the head does not know")
    weight: _Weight = Field(
        None, description="inner product K of the edge stalk, a matrix or a number times I; 1 unless given [-]"
    )
    offset: list[Number] | None = Field(
        None,
        description="desired F_tail x_tail - F_head x_head; of a range the distance, [r]; of a bearing the unit vector "
        "from tail to head, in the edge's frame; from the formations unless given [m]",
    )
    parallel: bool = Field(
        False, description="a second sensor: it may repeat another edge, and counts in addition to it"
    )

    def build(self, tail: Member, head: Member) -> Edge:
        """The edge between two members, in the tail's local frame where the map says so.

        Raises:
            InputError: a map, weight or offset has the wrong shape; or of a range or a bearing, the weight is a matrix,
                the sensor is for positions, or a bearing has one coordinate.
        """
        if isinstance(self.map, ExplicitMaps):
            F = _matrix(self.map.tail, "map.tail", tail.dimension)
            maps = F, _matrix(self.map.head, "map.head", head.dimension, len(F))
        else:
            maps = restriction_maps(self.map, tail.dimension, head.dimension, tail.attitude)
        m = len(maps[0])
        if self.measures != "position":
            if isinstance(self.sensor, RangeBearing):
                raise InputError(
                    f"sensor: range_bearing measures positions; expected none on an edge of a {self.measures}"
                )
            if isinstance(self.weight, list):
                raise InputError(
                    f"weight: is a matrix; expected a positive number on an edge that measures {self.measures}"
                )
            if self.measures == "bearing" and m not in (2, 3):
                raise InputError(
                    f"measures: a bearing needs maps of two or three rows, and they have {m}; expected range"
                )
        if self.offset is None:
            offset = None
        elif self.measures == "position":
            offset = _vector(self.offset, "offset", m)
        else:
            with in_field("offset"):
                offset = desired_value(self.measures, self.offset, m)
        link = Link(**self.own) if self.own else None
        weight = _inner_product(self.weight, m)
        heights = [member.height if member.dimension == 2 else 0.0 for member in (tail, head)]
        lift = np.array([0.0, 0.0, heights[1] - heights[0]]) if self.map == "space" else None
        if lift is not None and offset is not None and self.measures == "position":
            offset = offset + lift
        return Edge(tail.id, head.id, *maps, weight, offset, self.measures, self.directed, lift, link)


def edge_from_pair(value: Any) -> Any:
    """Let a bare pair stand for an edge with all defaults."""
    return {"between": value} if isinstance(value, list) else value


PairOrEdge = Annotated[LinearEdge, BeforeValidator(edge_from_pair, json_schema_input_type=LinearEdge | _Ends)]
"""An edge as a file may have it."""


class Anchor(Section):
    """A measurement of an agent's own position that should have a fixed value, such as an altimeter's."""

    agent: Id = Field(description="id of the agent that measures")
    axes: Annotated[list[Literal["x", "y", "z"]], Field(min_length=1, max_length=3)] | None = Field(
        None, description="coordinates that are anchored; give these or a map"
    )
    map: Matrix | None = Field(
        None, description="F, one row for each measured number, one column for each coordinate; give this or axes [-]"
    )
    value: Annotated[list[Number], Field(min_length=1)] = Field(
        description="desired F q, one for each measured number [m]"
    )
    weight: _Weight = Field(
        None, description="inner product K of the edge stalk, a matrix or a number times I; 1 unless given [-]"
    )
    parallel: bool = Field(
        False, description="a second sensor: it may repeat another anchor, and counts in addition to it"
    )

    @model_validator(mode="after")
    def _one(self) -> "Anchor":
        if (self.axes is None) == (self.map is None):
            raise ValueError("give either axes or map")
        return self

    @property
    def between(self) -> tuple[str, str]:
        """The ids of tail and head."""
        return self.agent, GROUND

    def build(self, agent: Member, _: Member) -> Edge:
        """The edge from its agent to the ground.

        Raises:
            InputError: the map, weight or value has the wrong shape, or the agent lacks an axis.
        """
        n = agent.dimension
        if self.map is not None:
            F = _matrix(self.map, "map", n)
        else:
            rows = ["xyz".index(axis) for axis in self.axes or []]
            if max(rows) >= n or len(set(rows)) != len(rows):
                has = f"{agent.id} has {', '.join('xyz'[:n])}"
                raise InputError(f"axes: [{', '.join(self.axes or [])}]: expected each axis once; {has}")
            F = np.eye(n)[rows]
        return anchor(agent.id, F, _vector(self.value, "value", len(F)), _inner_product(self.weight, len(F)))


def _inner_product(weight: float | Sequence[Sequence[float]] | None, m: int) -> Array:
    if weight is None or isinstance(weight, float | int):
        return (1.0 if weight is None else weight) * np.eye(m)
    return _matrix(weight, "weight, a positive number or a matrix,", m, m)


def _matrix(rows: Sequence[Sequence[float]], name: str, width: int, height: int | None = None) -> Array:
    """A field's rows as an array of shape (height, width), of any height where None is given."""
    lengths = {len(row) for row in rows}
    if lengths != {width} or height not in (None, len(rows)):
        found = f"shape ({len(rows)}, {lengths.pop()})" if len(lengths) == 1 else "rows of different lengths"
        raise InputError(f"{name} has {found}; expected shape ({height or 'm'}, {width})")
    return np.array(rows, dtype=np.float64)


def _vector(values: Sequence[float], name: str, length: int) -> Array:
    if len(values) != length:
        raise InputError(f"{name} has {len(values)} numbers; expected {length}, one for each row of the map")
    return np.array(values, dtype=np.float64)


def require_ends(tail: str, head: str, roles: Mapping[str, str], required: tuple[str, str]) -> None:
    """Require that the ends of an edge are known, differ, and have the right roles.

    Args:
        tail, head: Ids of the ends.
        roles: Role of every member by id, 'agent' or 'target', and 'ground' of GROUND.
        required: Role of tail and head.

    Raises:
        InputError: They do not; the message names an end.
    """
    for end, role in zip((tail, head), required, strict=True):
        if end not in roles or (roles[end] != role and "ground" in required):
            known = [i for i in roles if i != GROUND and roles[i] in required]
            raise InputError(f"{'agent: ' if 'ground' in required else ''}unknown id {end!r}; {expected(end, known)}")
    found = roles[tail], roles[head]
    if found != required:
        words = [
            f"{end} is {'an' if role == 'agent' else 'a'} {role}" for end, role in zip((tail, head), found, strict=True)
        ]
        swapped = f"; write [{head}, {tail}]" if found[::-1] == required else ""
        raise InputError(f"[{tail}, {head}]: expected [{', '.join(required)}], but {' and '.join(words)}{swapped}")
    if tail == head:
        raise InputError(f"({tail}, {head}) is a loop; the ends of an edge must differ")


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
    if name not in NAMES:
        raise InputError(f"unknown restriction map {name!r}; {expected(name, NAMES)}")
    if name == "identity" and n_tail != n_head:
        raise InputError(f"map 'identity' needs equal dimensions, but they are {n_tail} and {n_head}; use 'shared'")
    if name == "space":
        return np.eye(3, n_tail), np.eye(3, n_head)
    m = min(n_tail, n_head)
    R = rotation_to_local(*attitude, dimension=m) if name == "local_frame" else np.eye(m)
    return R @ np.eye(m, n_tail), R @ np.eye(m, n_head)


class Formation(Tagged):
    """Base of a group of members with a place for each; a shape says where, in `corners`."""

    name: Id = Field(description="unique name, which results and plots show")
    members: Annotated[list[Id], Field(min_length=1)] = Field(description="ids, in the order of the shape's places")
    about: Id | None = Field(
        None, description="id of the target that the group's centre should follow; free unless given"
    )
    height: Number = Field(0.0, description="added to z of spatial members [m]")
    centre: Point | None = Field(
        None,
        description="displacement of the whole group, x, y or x, y, z, added to each place; none unless given [m]",
    )

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
        return [self._displaced(o[:n].copy()) for o, n in zip(spatial, dimensions, strict=True)]

    def _displaced(self, place: Array) -> Array:
        """Return a place (n,) with height and displacement of the group added, m."""
        place[2:] += self.height
        for axis, value in enumerate((self.centre or [])[: len(place)]):
            place[axis] += value
        return place


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
        return [self._displaced(np.array(o, dtype=np.float64)) for o in self.displacements]


Group = Annotated[Polygon | Line | Tetrahedron | Explicit, Field(discriminator="shape")]


def _circumradius(side: float, count: int) -> float:
    return float(side / (2.0 * np.sin(np.pi / count)))


def _ring(count: int, radius: float, angle: float, clockwise: bool = False) -> Array:
    """Corners of a regular polygon about the origin, the first at a bearing in degrees, shape (count, 2)."""
    turn = np.deg2rad(angle) + (-1 if clockwise else 1) * 2.0 * np.pi * np.arange(count) / count
    return np.asarray(radius * np.column_stack([np.cos(turn), np.sin(turn)]))
