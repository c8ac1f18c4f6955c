"""The section `safety` of a scenario, and its arrays for compiled code: see `mjsheaf.law.safety`.

Station keeping is the other part: vehicles that have yet to join hold their position, each by itself. Vehicle v at x
commands gain (position - x) - w relative to the medium, whose velocity w it measures there: over ground it returns to
its position at the rate of the gain. The speed is limited as the vehicle's commands are.

The gain is 1 / (4 (tau + h)), at most MAX_GAIN, with the time constant tau of the body and the control period h: the
loop of position and velocity is then critically damped or slower.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator, model_validator

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.compile.jit import inline_jit
from mjsheaf.errors import InputError, in_field
from mjsheaf.law.obstacles import KINDS, ObstacleArrays
from mjsheaf.law.safety import SafetyArrays
from mjsheaf.law.terms import limit_speed
from mjsheaf.paths import Adrift, Motion, pack_motions, reference_bounds
from mjsheaf.section import Id, Number, Point, Positive, Section, Tagged

_PARTS = 16  # into which pieces of paths are cut, for tight bounds on speeds


class Obstacle(Tagged, ABC):
    """Base of all obstacles; subclasses must implement `place`, and `axis` and `size` if they have them."""

    id: Id | None = Field(None, description="name that results and pictures show; kind and number unless given")
    motion: Motion | None = Field(None, description="motion of the centre, without turning; at rest unless given")

    @field_validator("motion")
    @classmethod
    def _not_carried(cls, motion: Motion | None) -> Motion | None:
        if isinstance(motion, Adrift):
            raise ValueError("no flow carries an obstacle; expected a motion other than adrift, or none")
        return motion

    @property
    @abstractmethod
    def place(self) -> list[float]:
        """Initial position of the centre, 2 or 3 coordinates, m."""

    @property
    def axis(self) -> Array:
        """Direction of the x axis, shape (3,)."""
        return np.array([1.0, 0.0, 0.0])

    @property
    def size(self) -> list[float]:
        """Sizes as `mjsheaf.law.obstacles` has them, m; none unless overridden."""
        return []


class Sphere(Obstacle):
    """A ball."""

    kind: Literal["sphere"] = Field("sphere", description="always sphere")
    centre: Point = Field(description="its centre; of two numbers the third is scene.height [m]")
    radius: Positive = Field(description="its radius [m]")

    @property
    def place(self) -> list[float]:
        """The centre."""
        return self.centre

    @property
    def size(self) -> list[float]:
        """The radius."""
        return [self.radius]


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

    @property
    def _span(self) -> Array:
        return np.array([*np.subtract(self.ends[1], self.ends[0]), 0.0][:3])

    @property
    def place(self) -> list[float]:
        """The middle of the segment."""
        return [0.5 * (a + b) for a, b in zip(*self.ends, strict=True)]

    @property
    def axis(self) -> Array:
        """From one end to the other."""
        return np.asarray(self._span / np.linalg.norm(self._span, axis=0))

    @property
    def size(self) -> list[float]:
        """Half the length of the segment, and the radius."""
        return [0.5 * float(np.linalg.norm(self._span, axis=0)), self.radius]


class Box(Obstacle):
    """A box that stands upright."""

    kind: Literal["box"] = Field("box", description="always box")
    centre: Point = Field(description="its centre; of two numbers the third is scene.height [m]")
    sides: Annotated[list[Positive], Field(min_length=3, max_length=3)] = Field(
        description="lengths of its sides along its x, y and z axes [m]"
    )
    heading: Number = Field(0.0, description="rotation about z [degrees]")

    @property
    def place(self) -> list[float]:
        """The centre."""
        return self.centre

    @property
    def axis(self) -> Array:
        """Direction of the first side."""
        angle = np.deg2rad(self.heading)
        return np.array([np.cos(angle), np.sin(angle), 0.0])

    @property
    def size(self) -> list[float]:
        """Half of each side."""
        return [0.5 * side for side in self.sides]


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

    @property
    def place(self) -> list[float]:
        """A point of the plane."""
        return self.point

    @property
    def axis(self) -> Array:
        """The normal."""
        normal = np.array([*self.normal, 0.0][:3])
        return np.asarray(normal / np.linalg.norm(normal, axis=0))


AnyObstacle = Annotated[Sphere | Capsule | Box | HalfSpace, Field(discriminator="kind")]


class Safety(Section):
    """Fields of the safety filter; see `mjsheaf.law.safety`."""

    distance: Positive | Literal["size"] = Field(
        description="between the positions of any two vehicles of which one is an agent, and from an agent to the "
        "surface of an obstacle; `size`: spheres about the vehicles do not touch each other or an obstacle [m]"
    )
    range: Positive | None = Field(
        None,
        description="within which agents see other vehicles and obstacles, by a sensor of its own; as far as the "
        "filter can act unless given [m]",
    )
    rate: Positive = Field(1.0, description="largest rate gamma at which h = |z|^2 - distance^2 may fall [1/s]")
    authority: Literal["equal", "by_speed"] = Field(
        "equal", description="by_speed: of two agents, the faster one gives way more, in proportion to velocity_limit"
    )
    tie_break: Literal["none", "right_hand"] = Field(
        "none", description="right_hand: an agent turns what the filter takes off its speed to the right"
    )
    obstacles: list[AnyObstacle] = Field(default_factory=list, description="what agents keep away from too")

    @property
    def obstacle_ids(self) -> list[str]:
        """Name of each obstacle."""
        return [one.id or f"{one.kind}_{k}" for k, one in enumerate(self.obstacles, 1)]

    @model_validator(mode="after")
    def _named_once(self) -> "Safety":
        ids = self.obstacle_ids
        for k, id in enumerate(ids):
            if id in ids[:k]:
                raise ValueError(f"obstacles.{k}.id: there is another obstacle {id!r}; expected a unique name")
        return self


def pack_safety(
    safety: Safety,
    *,
    ids: Sequence[str],
    planar: BoolArray,
    height: float,
    limit: Array,
    yields: BoolArray,
    radius: Array,
    margin: Array,
    speed: Array,
    carried: Array,
    unsteady: Array,
    period: float,
    start: float,
    end: float,
) -> SafetyArrays:
    """Return the section for compiled code, for V vehicles; see `SafetyArrays` for carried and unsteady.

    Args:
        safety: The section.
        ids: Ids of the agents.
        planar: True for vehicles that live in the plane, shape (V,).
        height: Height of planar vehicles, m.
        limit: Largest commanded speed of each vehicle, shape (V,), m/s.
        yields: True for present agents, shape (V,).
        radius: Radius of each vehicle, which counts if the distance is their size, shape (V,), m.
        margin: Addition to the distance for each vehicle, shape (V,), m.
        speed: Bound on the speed relative to the medium of a vehicle that does not yield, shape (V,), m/s.
        carried, unsteady: Bounds of the medium about each vehicle.
        period: Time for which commands are held, s.
        start, end: Start and end time of the run, s.

    Raises:
        InputError: The range is missing, and an agent has no velocity limit from which it follows; or the motion of an
            obstacle does not fit. The message begins with the field.
    """
    V = len(planar)
    own = radius if safety.distance == "size" else np.full(V, 0.5 * float(safety.distance))
    padded = own + margin
    obstacles = pack_obstacles(safety, height, start, end)
    lift = np.zeros((V, 3))
    lift[planar, 2] = height
    shares = np.ones(V)
    for v, id in enumerate(ids if safety.authority == "by_speed" else []):
        if not np.isfinite(limit[v]):
            raise InputError(f"safety.authority: {id} has no velocity_limit; expected one, or authority equal")
        shares[v] = limit[v] if yields[v] else 1.0
    stirred = np.linalg.norm(carried - carried[0], axis=1) + unsteady
    moving = np.where(yields, 0.0, speed)
    clearance = (own if safety.distance == "size" else 2.0 * own) + margin
    if safety.range is None:
        limits = {id: limit[v] for v, id in enumerate(ids) if yields[v]}
        others = max(speed.max(initial=0.0), obstacles.speed.max(initial=0.0))
        flows = np.linalg.norm(carried, axis=1).max(initial=0.0) + unsteady.max(initial=0.0)
        D = max(2.0 * float(padded.max()), float(clearance.max()))
        reach = _farthest(limits, others, flows, D, safety.rate, period)
    else:
        reach = safety.range + 2.0 * float(margin.max())
    return SafetyArrays(
        agents=len(ids),
        radius=padded,
        clearance=clearance,
        reach=reach,
        rate=safety.rate,
        period=period or 1.0 / safety.rate,
        pairing=np.column_stack([padded, shares * yields, unsteady + moving]),
        yields=yields,
        carried=carried,
        unsteady=unsteady,
        lift=lift,
        planar=planar,
        closing=stirred + stirred.max() + moving.max(),
        burden=1.0 + shares.max() / shares,
        widest=float(padded.max()),
        uniform=bool((carried == carried[0]).all()),
        right=safety.tie_break == "right_hand",
        obstacles=obstacles,
    )


def _farthest(limits: dict[str, float], others: float, flows: float, D: float, rate: float, period: float) -> float:
    """Return the distance beyond which the filter changes no command that is within the velocity limits, m.

    The bound of a constraint at distance r is at most q - gamma (r^2 - D^2) / (2 r), taken as a whole for a pair, with
    q the fastest at which two vehicles can close in.

    Args:
        limits: Velocity limit of each present agent, m/s.
        others: Largest speed of what does not yield, m/s.
        flows: Largest speed of the medium, m/s.
        D: Largest distance that is kept, m.
        rate: gamma, 1/s.
        period: Time for which commands are held, s.

    Raises:
        InputError: An agent has no velocity limit.
    """
    for id, limit in limits.items():
        if not np.isfinite(limit):
            raise InputError(f"safety.range: {id} has no velocity_limit from which a range follows; expected either")
    closing = 2.0 * max(limits.values(), default=0.0) + others + 2.0 * flows
    settled = closing / rate
    return float(max(settled + np.hypot(settled, D), D + closing * period))


def pack_obstacles(safety: Safety, height: float, start: float, end: float) -> ObstacleArrays:
    """Return the obstacles of a section for compiled code; those in the plane are at a height in m.

    Raises:
        InputError: A motion does not fit; the message begins with the field.
    """
    some = safety.obstacles
    K = len(some)
    places, size, axes = np.zeros((K, 3)), np.zeros((K, 3)), np.zeros((K, 3, 3))
    for k, one in enumerate(some):
        places[k] = [*one.place, height][:3]
        size[k, : len(one.size)] = one.size
        x = one.axis
        aside = np.array([0.0, 0.0, 1.0]) if abs(x[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        y = np.cross(aside, x)
        y /= np.linalg.norm(y, axis=0)
        axes[k] = x, y, np.cross(x, y)
    dimensions = [len(one.place) for one in some]
    with in_field("safety.obstacles"):
        motion = pack_motions([one.motion for one in some], places, start, dimensions, end)
    kinds = np.array([KINDS.index(one.kind) for one in some], dtype=np.int64)
    return ObstacleArrays(kinds, axes, size, reference_bounds(motion, parts=_PARTS)[0], motion)


MAX_GAIN = 1.0
"""Largest gain of station keeping, 1/s."""


class Station(NamedTuple):
    """Positions that vehicles hold, for compiled code.

    Attributes:
        holds: True for each vehicle that holds its position, shape (V,).
        position: Controlled position to hold, padded, shape (V, 3), m.
        gain: Gain of each vehicle, shape (V,), 1/s.
        limit: Largest commanded speed of each vehicle, shape (V,), m/s.
    """

    holds: BoolArray
    position: Array
    gain: Array
    limit: Array

    def with_time_constants(self, tau: Array, period: float) -> "Station":
        """Return the same station with gains for time constants tau (V,) and a control period, in s."""
        delay = np.maximum(tau + period, 0.25 / MAX_GAIN)
        return self._replace(gain=0.25 / delay)


def no_station(V: int) -> Station:
    """Return a station that none of V vehicles keeps."""
    return Station(np.zeros(V, dtype=np.bool_), np.zeros((V, 3)), np.zeros(V), np.full(V, np.inf))


@inline_jit
def keep_station(station, v, x, w, command):
    """Write into command (3,) the velocity with which vehicle v at x (3,) holds its position in a medium at w (3,)."""
    for i in range(3):
        command[i] = station.gain[v] * (station.position[v, i] - x[i]) - w[i]
    limit_speed(station.limit[v], command)
