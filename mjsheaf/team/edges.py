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

Links say how measurements are made and how they get from one end of an edge to the other. A measurement of an edge is
made by the tail at every sample and sent to the head; what is lost is lost for both. Fields are set for all edges, for
those of a kind, or on an edge itself: the finest that names a field counts, field by field.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, expected, in_field
from mjsheaf.section import Id, Matrix, NonNegative, Number, Point, Positive, Section, Tagged
from mjsheaf.sheaf.nonlinear import Measure, NonlinearEdge, desired_value

KINDS = ("communication", "sensing")
"""The kinds of edges that have links."""

Probability = Annotated[float, Field(ge=0, le=1)]


class Exact(Tagged):
    """The relative state itself, with white noise and bias where the link has them."""

    kind: Literal["exact"] = Field("exact", description="always exact")


class RangeBearing(Tagged):
    """Range and bearing in the body frame of the tail, which knows its own attitude.

    On an edge with two rows the bearing is an angle in their plane, on one with three azimuth and elevation in the body
    frame as it turns: along the motion on ideal kinematics, the true attitude on bodies.
    """

    kind: Literal["range_bearing"] = Field("range_bearing", description="always range_bearing")
    range_noise: NonNegative = Field(0.0, description="standard deviation of the range [m]")
    bearing_noise: Annotated[float, Field(ge=0, le=180)] = Field(
        0.0, description="standard deviation of every angle [degrees]"
    )


class GilbertElliott(Tagged):
    """Losses in bursts: a Markov chain of a good and a bad state, which changes before each sample."""

    kind: Literal["gilbert_elliott"] = Field("gilbert_elliott", description="always gilbert_elliott")
    to_bad: Probability = Field(description="probability of a change from good to bad, at each sample [-]")
    to_good: Probability = Field(description="probability of a change from bad to good, at each sample [-]")
    loss_good: Probability = Field(0.0, description="probability of a loss in the good state, at each sample [-]")
    loss_bad: Probability = Field(1.0, description="probability of a loss in the bad state, at each sample [-]")

    @property
    def bad(self) -> float:
        """Stationary probability of the bad state, also at the start; 0 if no state ever changes."""
        total = self.to_bad + self.to_good
        return self.to_bad / total if total > 0.0 else 0.0

    @property
    def lossy(self) -> bool:
        """True if anything can be lost."""
        return self.loss_good > 0.0 or self.loss_bad * self.bad > 0.0


def chain_of(loss: float | GilbertElliott | None) -> GilbertElliott:
    """Return losses as a chain of two states, which have equal losses if losses are independent."""
    return loss if isinstance(loss, GilbertElliott) else GilbertElliott(
        to_bad=0.0, to_good=1.0, loss_good=loss or 0.0, loss_bad=loss or 0.0
    )  # fmt: skip


class Link(Section):
    """Effects of a link on the measurements of an edge; None leaves a field to a more general section."""

    noise: NonNegative | None = Field(
        None,
        description="standard deviation of white noise on each measured number; of a bearing in degrees [m]",
    )
    bias: Number | None = Field(None, description="constant added to each measured number [m]")
    delay: NonNegative | None = Field(
        None, description="age of a measurement, a whole number of periods of controller.control_period [s]"
    )
    loss: Probability | GilbertElliott | None = Field(
        None, description="probability that a sample is lost, or a chain of a good and a bad state [-]"
    )
    range: Positive | None = Field(
        None, description="distance of the bodies beyond which the link receives nothing [m]"
    )
    hold: NonNegative | None = Field(
        None, description="how long the last measurement stands in for lost ones; after that the edge adds nothing [s]"
    )
    sensor: Annotated[Exact | RangeBearing, Field(discriminator="kind")] | None = Field(
        None, description="what measures; exact but for noise and bias unless given"
    )

    @model_validator(mode="after")
    def _one_noise(self) -> "Link":
        if self.noise and isinstance(self.sensor, RangeBearing):
            raise ValueError("noise with sensor range_bearing; expected its range_noise and bearing_noise, or exact")
        return self

    @property
    def own(self) -> dict[str, Any]:
        """The fields that are named."""
        return {name: value for name in Link.model_fields if (value := getattr(self, name)) is not None}


class RoundLink(Section):
    """Effects of links on the messages of agents in rounds of feedforward and newton."""

    delay: NonNegative = Field(
        0.0, description="age of a message, a whole number of control periods; if positive, one round a period [s]"
    )
    loss: Probability | GilbertElliott = Field(
        0.0, description="probability that a message is lost, or a chain of a good and a bad state, round by round [-]"
    )


class Links(Section):
    """Links of all edges and of each kind; an edge may have the same fields."""

    all: Link | None = Field(None, description="of communication and sensing")
    communication: Link | None = Field(None, description="of communication edges, before `all`")
    sensing: Link | None = Field(None, description="of sensing edges, before `all`")
    rounds: RoundLink | None = Field(
        None, description="of the messages of feedforward and newton; at once and never lost unless given"
    )
    record: bool | None = Field(None, description="whether result.nc has every measurement, as agents had it")

    def resolve(self, kind: str, own: Link | None = None) -> "LinkModel":
        """The link of an edge of a kind, with its own fields.

        Raises:
            InputError: A sensor range_bearing has noise from a more specific section.
        """
        return _model(self.all, getattr(self, kind), own)


class LinkModel(NamedTuple):
    """A link with every field, in SI units; compiled code has the same fields (`mjsheaf.law.links.LINK`).

    Attributes:
        noise: Standard deviation of white noise on each measured number, m.
        bias: Constant added to each measured number, m.
        bearing: True for the sensor range_bearing.
        range_noise: Standard deviation of its range, m.
        bearing_noise: Standard deviation of its angles, rad.
        delay: Age of a measurement, s.
        hold: Time for which the last measurement stands in for lost ones, s.
        range: Distance beyond which the link receives nothing, infinite without one, m.
        to_bad, to_good: Probabilities that the chain of losses changes its state, at each sample.
        bad: Probability that the chain begins in the bad state.
        loss_good, loss_bad: Probabilities of a loss in each state; equal where losses are independent.
    """

    noise: float = 0.0
    bias: float = 0.0
    bearing: bool = False
    range_noise: float = 0.0
    bearing_noise: float = 0.0
    delay: float = 0.0
    hold: float = 0.0
    range: float = np.inf
    to_bad: float = 0.0
    to_good: float = 1.0
    bad: float = 0.0
    loss_good: float = 0.0
    loss_bad: float = 0.0

    @property
    def lossy(self) -> bool:
        """True if a measurement can be lost at random."""
        return self.loss_good > 0.0 or self.loss_bad * self.bad > 0.0

    @property
    def bursts(self) -> bool:
        """True if losses depend on the state of the chain."""
        return self.loss_good != self.loss_bad

    @property
    def random(self) -> bool:
        """True if random numbers enter."""
        return self.noise > 0.0 or self.range_noise > 0.0 or self.bearing_noise > 0.0 or self.lossy

    @property
    def exact(self) -> bool:
        """True if measurements arrive at once, all of them, without error."""
        return not (self.random or self.bias != 0.0 or self.delay > 0.0 or np.isfinite(self.range))


def _model(*sections: Link | None) -> LinkModel:
    """The link of sections from the coarsest to the finest."""
    fields: dict[str, Any] = {}
    for section in sections:
        own = section.own if section else {}
        if isinstance(own.get("sensor"), RangeBearing):
            fields.pop("noise", None)  # that of the exact sensor which it replaces
        fields |= own
    sensor, loss = fields.pop("sensor", None), fields.pop("loss", None)
    if isinstance(sensor, RangeBearing):
        if fields.get("noise"):
            raise InputError(
                "noise with the sensor range_bearing of a more general section; expected sensor: {kind: exact} with it"
            )
        angle = float(np.deg2rad(sensor.bearing_noise))
        fields |= {"bearing": True, "range_noise": sensor.range_noise, "bearing_noise": angle}
    chain = chain_of(loss)
    return LinkModel(**fields, **chain.model_dump(exclude={"kind"}), bad=chain.bad)


def require_bearing(F_tail: Array, F_head: Array) -> None:
    """Check that maps are F_tail = R P and F_head = R P, P two or three common axes and R a rotation.

    Raises:
        InputError: they are not.
    """
    used = [np.flatnonzero(np.abs(F).max(axis=0, initial=0.0) > 0.0) for F in (F_tail, F_head)]
    m = len(F_tail)
    fits = m in (2, 3) and np.array_equal(used[0], used[1]) and len(used[0]) == m
    R = F_tail[:, used[0]] if fits else np.eye(2)
    if not (fits and np.array_equal(R, F_head[:, used[1]]) and np.allclose(R.T @ R, np.eye(m), rtol=0.0, atol=1e-9)
            and np.linalg.det(R) > 0.0):  # fmt: skip
        raise InputError(
            "sensor range_bearing: expected maps F_tail = R P and F_head = R P, P two or three common axes and R a "
            "rotation: shared, identity or local_frame"
        )


def whole_periods(seconds: float, period: float) -> int:
    """A delay in control periods.

    Raises:
        InputError: it is no whole number of them.
    """
    ratio = seconds / period
    n = round(ratio)
    if abs(ratio - n) > 1e-6 * max(1.0, ratio):
        below, above = (f"{k * period:.6g}" for k in (int(ratio), int(ratio) + 1))
        raise InputError(
            f"{seconds:.6g} s is no whole number of control periods of {period:.6g} s; expected {below} or {above}"
        )
    return n


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
    """

    link: Link | None = None
    slope: Slope | None = None

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
            InputError: a map, weight or offset has the wrong shape.
        """
        if isinstance(self.map, ExplicitMaps):
            F = _matrix(self.map.tail, "map.tail", tail.dimension)
            maps = F, _matrix(self.map.head, "map.head", head.dimension, len(F))
        else:
            maps = restriction_maps(self.map, tail.dimension, head.dimension, tail.attitude)
        m = len(maps[0])
        self._require_measurable(m)
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

    def _require_measurable(self, m: int) -> None:
        """Refuse what a range or a bearing of m coordinates cannot have.

        Raises:
            InputError: a weight is a matrix, a sensor is for positions, or a bearing has one coordinate.
        """
        if self.measures == "position":
            return
        if isinstance(self.sensor, RangeBearing):
            raise InputError(f"sensor: range_bearing measures positions; expected none on an edge of a {self.measures}")
        if isinstance(self.weight, list):
            raise InputError(
                f"weight: is a matrix; expected a positive number on an edge that measures {self.measures}"
            )
        if self.measures == "bearing" and m not in (2, 3):
            raise InputError(f"measures: a bearing needs maps of two or three rows, and they have {m}; expected range")


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


def require_ends(tail: str, head: str, roles: Mapping[str, str], wanted: tuple[str, str]) -> None:
    """Raise an InputError that names an end of an edge if it is unknown, of the wrong role, or the same as the other.

    Args:
        tail, head: ids.
        roles: 'agent' or 'target' of every member by id.
        wanted: Expected role of tail and head; 'ground' is that of GROUND.
    """

    def unknown(end: str) -> str:
        return f"unknown id {end!r}; {expected(end, [i for i in roles if roles[i] in wanted])}"

    if (head, wanted[1]) == (GROUND, "ground"):
        if roles.get(tail) != wanted[0]:
            raise InputError(f"agent: {unknown(tail)}")
        return
    for end in (tail, head):
        if end not in roles:
            raise InputError(unknown(end))
    found = roles[tail], roles[head]
    if found != wanted:
        words = [
            f"{end} is {'an' if role == 'agent' else 'a'} {role}" for end, role in zip((tail, head), found, strict=True)
        ]
        swapped = f"; write [{head}, {tail}]" if found[::-1] == wanted else ""
        raise InputError(f"[{tail}, {head}]: expected [{', '.join(wanted)}], but {' and '.join(words)}{swapped}")
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
