"""Steering by kind: conversion of the law's commanded velocity into wrenches by a vehicle's computer.

- `Full`: A vehicle with thrust along every controlled axis. It holds its heading.
- `HandPoint`: A boat with surge and yaw only. It steers a point at l ahead of its origin: surge gives that point its
  forward velocity, and the yaw rate (v_c,y - v_r,y) / l its velocity to port. A boat that cannot back turns round for
  commands astern, see `_turn_under_way`.
- `ThrustVector`: A multirotor with parallel rotors. Its thrust along its z axis is weight + F, and it turns the axis
  into that direction (Lee, Leok and McClamroch, Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010).

A new kind subclasses `Steering`, is named in `AnySteering`, and has a code with a branch in `steer_attitude`, or a
function of its own next to it and `steer_hand_point`.
"""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Discriminator, Field, Tag

from mjsheaf.arrays import Array
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.section import Section
from mjsheaf.vectors import cross, product, subtract, triple

if TYPE_CHECKING:
    from mjsheaf.vehicles.vehicle import Body

FULL, THRUST_VECTOR, HAND_POINT = 0, 1, 2  # codes

_FREE_TILT = 80.0  # degrees
_SHARE_OF_FALL = 0.5  # maximum downward force on a multirotor that points its thrust, as a fraction of its weight
_DIRECTIONS = 2.0 * np.pi * np.arange(24) / 24  # rad, of the plane


class Steering(Section, ABC):
    """Conversion of a desired velocity into wrenches.

    Attributes:
        code: Code of its branch in compiled code.
        rows: Rows of the wrench that actuators must produce, by the number n of controlled coordinates.
        velocity_rows: Rows of mass and drag for the controlled velocity; the first n are used.
        underactuated: True if it compensates for axes without thrust.
        attitude: True if it holds a desired attitude.
        directions: Horizontal directions of thrust at rest, shape (d, 2), the first one forward.
    """

    code: ClassVar[int]
    rows: ClassVar[dict[int, list[int]]]
    velocity_rows: ClassVar[list[int]] = [0, 1, 2]
    underactuated: ClassVar[bool] = True
    attitude: ClassVar[bool] = True
    directions: ClassVar[Array] = np.array([[1.0, 0.0]])

    @property
    def hand(self) -> float:
        """Distance of the controlled point ahead of the origin, m."""
        return 0.0

    def allocation(self, body: "Body") -> Array:
        """Return W^+ on the commanded rows and zero on the others, shape (s, 6); it maps wrenches to efforts.

        It includes the moment rows, because the pseudo-inverse of the force rows alone would spin a free body.
        """
        rows, P = self.rows[body.dimension], np.zeros((body.W.shape[1], 6))
        P[:, rows] = np.linalg.pinv(body.W[rows])
        return P

    def trim_effort(self, body: "Body") -> Array:
        """Return the efforts that carry the weight of the level vehicle, shape (s,); zero if water carries it."""
        force = np.array([0.0, 0.0, body.weight * (body.dimension == 3)])
        return np.asarray(self.allocation(body) @ np.concatenate([force, np.cross(body.centre_of_mass, force)]))

    def delays(self, body: "Body") -> Array:
        """Return the delay of the force along each axis, shape (n,), s."""
        return np.full(body.dimension, body.lag)

    @abstractmethod
    def g(self, body: "Body", R: Array) -> Array:
        """Compute the control effectiveness at an attitude R (3, 3), shape (n, s); see `ReducedModel`."""

    @abstractmethod
    def g_inverse(self, body: "Body", R: Array) -> Array:
        """Compute the right inverse of g that causes no other motion, shape (s, n)."""

    def largest_force(self, body: "Body", direction: Array) -> float:
        """Compute the largest horizontal force of a level vehicle along a unit vector of its plane, N."""
        along = np.array([*direction, 0.0, 0.0, 0.0, 0.0])
        return body.largest_along(self.rows[body.dimension], along, body.W @ self.trim_effort(body))

    def without_limits(self) -> "Steering":
        """Return the same steering without limits."""
        return self

    def pack(self, body: "Body", kind: np.void) -> None:
        """Write the parameters of the branch into the vehicle's KIND."""
        kind["steering"], kind["hand"] = self.code, self.hand


class Full(Steering):
    """Thrust along every controlled axis."""

    code = FULL
    rows: ClassVar = {2: [0, 1, 5], 3: [0, 1, 2, 3, 4, 5]}
    underactuated = False
    directions = np.column_stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])

    def g(self, body: "Body", R: Array) -> Array:
        """Compute C R D^-1 W_f."""
        return np.asarray((R @ (body.W[:3] / body.drag[:, None]))[: body.dimension])

    def g_inverse(self, body: "Body", R: Array) -> Array:
        """Compute W^+ D R^T on the force rows."""
        return np.asarray((self.allocation(body)[:, :3] @ (body.drag[:, None] * R.T))[:, : body.dimension])


class HandPoint(Steering):
    """Surge and yaw, at a point ahead of the origin."""

    code = HAND_POINT
    rows: ClassVar = {2: [0, 5]}
    velocity_rows: ClassVar = [0, 5]
    attitude = False

    hand_point: Annotated[float, Field(gt=0)] = Field(
        description="distance ahead of its origin at which a boat with surge and yaw only is controlled [m]"
    )

    @property
    def hand(self) -> float:
        """As given."""
        return self.hand_point

    def _gain(self, body: "Body") -> Array:
        """Compute the velocity of the hand point, forward and to port, for a surge force and a yaw moment of 1."""
        return np.array([1.0 / body.drag[0], self.hand_point / body.angular_drag[2]])

    def g(self, body: "Body", R: Array) -> Array:
        """Compute R(psi) diag(1 / D_surge, l / D_yaw) W on the rows surge and yaw."""
        return np.asarray(R[:2, :2] @ (body.W[[0, 5]] * self._gain(body)[:, None]))

    def g_inverse(self, body: "Body", R: Array) -> Array:
        """Compute the right inverse of g, which is the inverse if there are two efforts."""
        return np.asarray(self.allocation(body)[:, [0, 5]] / self._gain(body) @ R[:2, :2].T)


class ThrustVector(Steering):
    """Thrust along z alone, pointed by tilting."""

    code = THRUST_VECTOR
    rows: ClassVar = {3: [2, 3, 4, 5]}

    largest_tilt: Annotated[float, Field(gt=0, le=_FREE_TILT)] = Field(
        description="largest tilt of a multirotor with parallel rotors, which tilts to point its thrust [degrees]"
    )

    def delays(self, body: "Body") -> Array:
        """Return 2 zeta / omega of the attitude, which must turn first, and the thrusters' lag for the vertical."""
        hold = body.hold
        return np.array([*[2.0 * hold.damping / hold.frequency] * 2, body.lag])

    def g(self, body: "Body", R: Array) -> Array:
        """Compute R D^-1 R^T."""
        return np.asarray(R / body.drag @ R.T)

    def g_inverse(self, body: "Body", R: Array) -> Array:
        """Compute R D R^T."""
        return np.asarray(R * body.drag @ R.T)

    def largest_thrust(self, body: "Body", *, usable: float = 0.9) -> float:
        """Return the usable thrust along z, N, a fraction of all; the rest is reserved for turning."""
        lifting = body.W[2] > 0.0
        reach = body.W[2, lifting] @ body.effort_bounds[lifting, 1]
        return max(usable * float(reach), 1.01 * body.weight)

    def largest_force(self, body: "Body", direction: Array) -> float:
        """Compute the largest horizontal force, limited by tilt or by thrust, N."""
        by_tilt = body.weight * np.tan(np.deg2rad(self.largest_tilt))
        return float(min(by_tilt, np.sqrt(max(self.largest_thrust(body) ** 2 - body.weight**2, 0.0))))

    def without_limits(self) -> "ThrustVector":
        """Return the same steering with a tilt of up to 80 degrees."""
        return ThrustVector(largest_tilt=_FREE_TILT)

    def pack(self, body: "Body", kind: np.void) -> None:
        """Write the parameters of the branch, with the limits of tilt and thrust."""
        super().pack(body, kind)
        kind["tan_max_tilt"] = np.tan(np.deg2rad(self.largest_tilt))
        kind["most_thrust"] = self.largest_thrust(body)


def _kind_of_steering(value: Any) -> str | None:
    """Return the class of the given field; None unless exactly one is given."""
    kinds = {"hand_point": "HandPoint", "largest_tilt": "ThrustVector"}
    given = set(kinds) & set(value if isinstance(value, dict) else type(value).model_fields)
    return kinds[given.pop()] if len(given) == 1 else None


AnySteering = Annotated[
    Annotated[HandPoint, Tag("HandPoint")] | Annotated[ThrustVector, Tag("ThrustVector")],
    Discriminator(
        _kind_of_steering,
        custom_error_type="steering",
        custom_error_message="give either hand_point or largest_tilt",
    ),
]
"""Section of a description about its steering."""


@inline_jit
def drag_force(kind, s):
    """Compute D s + Q |s| s, the force that moves a vehicle at s (3,) through the medium, body axes, N."""
    D, Q = kind.drag, kind.quadratic
    return (
        (D[0] + Q[0] * abs(s[0])) * s[0],
        (D[1] + Q[1] * abs(s[1])) * s[1],
        (D[2] + Q[2] * abs(s[2])) * s[2],
    )


@inline_jit
def steer_hand_point(kind, s, omega, desired, surge):
    """Convert the force for a desired velocity into the wrench that the actuators should produce, at a hand point.

    Args:
        kind: Parameters of the vehicle's kind; see KIND.
        s, omega: Velocity through the medium, m/s, and rates, rad/s, body axes, (3,) each.
        desired: Desired velocity relative to the medium, body axes, (3,), m/s.
        surge: Force ahead for that velocity, N.

    Returns:
        Surge force, N, and yaw moment, N m.
    """
    aside = desired[1]
    if kind.forward_only and desired[0] < 0.0:  # turn as for a command abeam
        aside = np.copysign(np.sqrt(desired[0] * desired[0] + aside * aside), aside)
    rate = (aside - s[1]) / kind.hand
    yaw = (kind.drag[5] + kind.quadratic[5] * abs(rate)) * rate + kind.gain[5] * (rate - omega[2])
    if kind.forward_only:
        yaw = _turn_under_way(kind, s, desired, surge, yaw)
    return surge, yaw


@inline_jit
def steer_attitude(kind, heading, R, quaternion, s, omega, force, share, weight):
    """Convert the force for a desired velocity into the wrenches that the actuators should produce.

    Args:
        kind: Parameters of the vehicle's kind; see KIND.
        heading: Cosine and sine of half the heading to hold, (2,).
        R, quaternion: Attitude, body to world, (9,) and (4,).
        s, omega: See `steer_hand_point`.
        force: Force for the desired velocity, body axes, (3,), N; in world axes if thrust is pointed.
        share: Fraction of the force that is within the limits of thrust, if thrust is pointed.
        weight: Force that carries the vehicle, body axes, (3,), N.

    Returns:
        Weight, attitude moment, and force and moment of translation, body axes, (3,) each, N and N m.
    """
    attitude = (heading[0], 0.0, 0.0, heading[1])
    if kind.steering == THRUST_VECTOR:
        force, weight, attitude = point_thrust(kind, heading, R, force, share, weight)
    turn = turn_to(kind, attitude, quaternion, omega)
    # Thrust and drag act at the origin. Their sum accelerates the centre of mass c and the added mass at the origin. To
    # avoid turning the vehicle, the part that acts on c needs a moment of c times it. (The attitude hold compensates
    # for the Munk moment of added mass.)
    net, own = subtract(force, drag_force(kind, s)), kind.rigid_mass_fraction
    moment = cross(triple(kind.com), (own[0] * net[0], own[1] * net[1], own[2] * net[2]))
    return weight, turn, force, moment


@jit
def _turn_under_way(kind, s, desired, surge, yaw):
    """Limit a yaw moment according to the surge force that comes with it.

    A boat that cannot reverse, and needs thrust to turn, must not exceed the desired speed, because it would circle
    near its target. Below the speed for turning round, it turns only as much as the desired surge force allows, and
    drifts.

    Args:
        kind: Parameters of the vehicle's kind; see KIND.
        s: Velocity through the medium, body axes, (3,), m/s.
        desired: Desired velocity through the medium, body axes, (3,), m/s.
        surge: Desired surge force, N.
        yaw: Desired yaw moment, N m.
    """
    if kind.turning_price <= 0.0:
        return yaw
    speed, least = np.sqrt(desired[0] * desired[0] + desired[1] * desired[1]), kind.turning_speed
    worth = min(max(speed - least, 0.0) / least, 1.0) if least > 0.0 else 1.0
    free = (kind.drag[0] + kind.quadratic[0] * speed) * speed + kind.gain[0] * (speed - s[0])
    surge = max(surge, 0.0)
    largest = (surge + worth * max(free - surge, 0.0)) / kind.turning_price
    return min(max(yaw, -largest), largest)


@inline_jit
def is_within_thrust(kind, force):
    """Return True if thrust, tilt and downward force are within the limits for a force, world axes, (3,), N."""
    lift, slope, most = kind.supported_weight, kind.tan_max_tilt, kind.most_thrust
    x, y, z = force
    square = x * x + y * y + z * z
    within = -z <= _SHARE_OF_FALL * lift
    within &= np.sqrt(x * x + y * y) - slope * z <= slope * lift
    return within & (square + 2.0 * z * lift + lift * lift <= most * most)


@inline_jit
def share_within_thrust(kind, force):
    """Return the largest share of a force, world axes, (3,), N, that satisfies `is_within_thrust`, at most 1."""
    lift, slope, most = kind.supported_weight, kind.tan_max_tilt, kind.most_thrust
    x, y, z = force
    share = 1.0
    if -z > _SHARE_OF_FALL * lift:
        share = _SHARE_OF_FALL * lift / -z
    beyond = np.sqrt(x * x + y * y) - slope * z
    if share * beyond > slope * lift:
        share = slope * lift / beyond
    square = x * x + y * y + z * z
    if share * share * square + 2.0 * share * z * lift + lift * lift > most * most:
        share = (np.sqrt(z * z * lift * lift + square * (most * most - lift * lift)) - z * lift) / square
    return share


@inline_jit
def point_thrust(kind, heading, R, force, share, weight):
    """Convert a share of a desired force, world axes, (3,), N, into thrust along z and the attitude that points it.

    The force is scaled, never turned, until thrust, tilt and downward force are within the vehicle's limits: see
    `share_within_thrust`.

    Returns:
        Force and weight along z, body axes, whose sum is the component of the desired thrust along the present z axis;
        and the desired attitude as a quaternion: the turn to the heading, then the shortest turn of z to the thrust.
    """
    x, y, z = share * force[0], share * force[1], kind.supported_weight + share * force[2]
    along = x * R[2] + y * R[5] + z * R[8]
    a, b, c = np.sqrt(x * x + y * y + z * z) + z, -y, x
    size = 1.0 / np.sqrt(a * a + b * b + c * c)
    a, b, c = a * size, b * size, c * size
    hw, hz = heading[0], heading[1]
    attitude = (a * hw, b * hw + c * hz, c * hw - b * hz, a * hz)
    return (0.0, 0.0, along - weight[2]), (0.0, 0.0, weight[2]), attitude


@inline_jit
def turn_to(kind, attitude, quaternion, omega):
    """Compute the moment that turns the vehicle from its quaternion to a desired attitude, body axes, N m."""
    w, x, y, z = attitude
    a, b, c, d = quaternion
    # conj(quaternion) times the desired one
    stiffness = 2.0 * kind.stiffness if a * w + b * x + c * y + d * z >= 0.0 else -2.0 * kind.stiffness
    damping = kind.rate_damping
    wanted = (
        stiffness * (a * x - b * w - c * z + d * y) - damping * omega[0],
        stiffness * (a * y + b * z - c * w - d * x) - damping * omega[1],
        stiffness * (a * z - b * y + c * x - d * w) - damping * omega[2],
    )
    return product(kind.inertia, wanted)
