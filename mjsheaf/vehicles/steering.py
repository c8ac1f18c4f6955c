"""Steering by kind: how a vehicle's computer turns the velocity that the law wants into wrenches.

- `Full`: pushes along every axis in which it is controlled, and holds its heading.
- `HandPoint`: a boat with surge and yaw only. It steers a point at l ahead of its origin: surge makes that point's
  velocity forward, and the yaw rate (v_c,y - v_r,y) / l its velocity to port. A boat that cannot back turns round for
  what is astern, see `_turn_under_way`.
- `ThrustVector`: a multirotor with parallel rotors. It thrusts weight + F along its z axis and turns that axis there
  (Lee, Leok and McClamroch, Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010).

A new kind subclasses `Steering` and has a code with a branch in `steer`.
"""

from abc import ABC, abstractmethod
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.io.section import Section
from mjsheaf.jit import inline_jit, jit
from mjsheaf.vehicles.body import Body
from mjsheaf.vehicles.vectors import cross, product, subtract, to_world, triple

FULL, THRUST_VECTOR, HAND_POINT = 0, 1, 2  # codes

_USABLE = 0.9  # share of a multirotor's thrust that may carry and move it; the rest turns it
_FREE_TILT = 80.0  # degrees
_SHARE_OF_FALL = 0.5  # a multirotor that points its thrust sinks with at most this much of its weight
_DIRECTIONS = 2.0 * np.pi * np.arange(24) / 24  # rad, of the plane


class Steering(Section, ABC):
    """How a vehicle makes the velocity that is wanted.

    Attributes:
        code: of its branch in `steer`.
        rows: those of the wrench that actuators must produce, by the number n of controlled coordinates.
        velocity_rows: those of mass and drag that the controlled velocity has; the first n.
        underactuated: whether it makes up for axes along which nothing pushes.
        attitude: whether it holds the attitude that is wanted.
        directions: of the plane along which it can push at rest, shape (d, 2), the first of them forward.
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

    def allocation(self, body: Body) -> Array:
        """W^+ on the rows that are commanded, zero on the others, shape (s, 6): efforts that make a wanted wrench.

        The moment rows belong to it: the pseudo-inverse of the force rows alone would spin a free body.
        """
        rows, P = self.rows[body.dimension], np.zeros((body.W.shape[1], 6))
        P[:, rows] = np.linalg.pinv(body.W[rows])
        return P

    def trim_effort(self, body: Body) -> Array:
        """Efforts that carry the weight of the level vehicle, shape (s,); zero where water carries it."""
        force = np.array([0.0, 0.0, body.weight * (body.dimension == 3)])
        return np.asarray(self.allocation(body) @ np.concatenate([force, np.cross(body.centre_of_mass, force)]))

    def delays(self, body: Body) -> Array:
        """How late the force along each axis comes, shape (n,), s."""
        return np.full(body.dimension, body.lag)

    @abstractmethod
    def g(self, body: Body, R: Array) -> Array:
        """Control effectiveness at an attitude R (3, 3), shape (n, s): see `ReducedModel`."""

    @abstractmethod
    def g_inverse(self, body: Body, R: Array) -> Array:
        """The right inverse of g that makes no other motion, shape (s, n)."""

    def largest_force(self, body: Body, direction: Array) -> float:
        """Largest horizontal force of a level vehicle along a unit vector of its plane, N."""
        along = np.array([*direction, 0.0, 0.0, 0.0, 0.0])
        return body.largest_along(self.rows[body.dimension], along, body.W @ self.trim_effort(body))

    def without_limits(self) -> "Steering":
        """The same with nothing limited."""
        return self

    def fault(self, body: Body) -> str:
        """Why a vehicle cannot be steered so; empty where it can."""
        return ""

    def pack(self, body: Body, kind: np.void) -> None:
        """Write what the branch needs into the vehicle's KIND."""
        kind["steering"], kind["hand"] = self.code, self.hand


class Full(Steering):
    """Thrust along every controlled axis."""

    code = FULL
    rows: ClassVar = {2: [0, 1, 5], 3: [0, 1, 2, 3, 4, 5]}
    underactuated = False
    directions = np.column_stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])

    def g(self, body: Body, R: Array) -> Array:
        """C R D^-1 W_f."""
        return np.asarray((R @ (body.W[:3] / body.drag[:, None]))[: body.dimension])

    def g_inverse(self, body: Body, R: Array) -> Array:
        """W^+ D R^T on the force rows."""
        whole = self.allocation(body)[:, :3] @ (body.drag[:, None] * R.T)
        return np.asarray(whole[:, : body.dimension])


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

    def _gain(self, body: Body) -> Array:
        """Velocity of the hand point forward and to port for a surge force and a yaw moment of 1."""
        return np.array([1.0 / body.drag[0], self.hand_point / body.angular_drag[2]])

    def g(self, body: Body, R: Array) -> Array:
        """R(psi) diag(1 / D_surge, l / D_yaw) W on the rows surge and yaw."""
        return np.asarray(R[:2, :2] @ (body.W[[0, 5]] * self._gain(body)[:, None]))

    def g_inverse(self, body: Body, R: Array) -> Array:
        """Its inverse where there are two efforts."""
        return np.asarray(self.allocation(body)[:, [0, 5]] / self._gain(body) @ R[:2, :2].T)

    def fault(self, body: Body) -> str:
        """That g would be infinite."""
        if body.angular_drag[2] > 0.0:
            return ""
        return "a hand point needs a positive drag.angular in yaw, as g divides by it"


class ThrustVector(Steering):
    """Thrust along z alone, and a tilt that points it."""

    code = THRUST_VECTOR
    rows: ClassVar = {3: [2, 3, 4, 5]}

    largest_tilt: Annotated[float, Field(gt=0, le=_FREE_TILT)] = Field(
        description="largest tilt of a multirotor with parallel rotors, which points its thrust [degrees]"
    )

    def delays(self, body: Body) -> Array:
        """2 zeta / omega of the attitude that must turn first; upward the thrusters' lag."""
        hold = body.hold
        return np.array([*[2.0 * hold.damping / hold.frequency] * 2, body.lag])

    def g(self, body: Body, R: Array) -> Array:
        """R D^-1 R^T."""
        return np.asarray(R / body.drag @ R.T)

    def g_inverse(self, body: Body, R: Array) -> Array:
        """R D R^T."""
        return np.asarray(R * body.drag @ R.T)

    def largest_thrust(self, body: Body) -> float:
        """Thrust along z that may be used, N: some is left for turning."""
        lifting = body.W[2] > 0.0
        reach = body.W[2, lifting] @ body.effort_bounds[lifting, 1]
        return max(_USABLE * float(reach), 1.01 * body.weight)

    def largest_force(self, body: Body, direction: Array) -> float:
        """By tilt or by thrust, whichever ends first."""
        by_tilt = body.weight * np.tan(np.deg2rad(self.largest_tilt))
        return float(min(by_tilt, np.sqrt(max(self.largest_thrust(body) ** 2 - body.weight**2, 0.0))))

    def without_limits(self) -> "ThrustVector":
        """Tilting as far as it is any use."""
        return ThrustVector(largest_tilt=_FREE_TILT)

    def pack(self, body: Body, kind: np.void) -> None:
        """Tilt and thrust, too."""
        super().pack(body, kind)
        kind["tan_max_tilt"] = np.tan(np.deg2rad(self.largest_tilt))
        kind["most_thrust"] = self.largest_thrust(body)


@inline_jit
def drag_force(kind, s):
    """D s + Q |s| s: the force that moves a vehicle at s (3,) through the medium, body axes, N."""
    D, Q = kind.drag, kind.quadratic
    return (
        (D[0] + Q[0] * abs(s[0])) * s[0],
        (D[1] + Q[1] * abs(s[1])) * s[1],
        (D[2] + Q[2] * abs(s[2])) * s[2],
    )


@inline_jit
def steer(kind, heading, sensed, wanted, force, weight):
    """Turn the force that a velocity takes into what the actuators are to make.

    Args:
        kind: see KIND.
        heading: cosine and sine of half the heading to hold, (2,).
        sensed: see `Sensed`.
        wanted: velocity wanted relative to the medium, body axes, (3,), m/s.
        force, weight: the force that makes it, and what carries the vehicle, body axes, (3,) each, N.

    Returns:
        Weight, attitude moment, and force and moment of translation, body axes, (3,) each, N and N m.
    """
    R, s, omega = sensed.R, sensed.velocity, sensed.rates
    if kind.steering == HAND_POINT:
        aside = wanted[1]
        if kind.forward_only and wanted[0] < 0.0:  # turning is then as urgent as for what is abeam
            aside = np.copysign(np.sqrt(wanted[0] * wanted[0] + aside * aside), aside)
        rate = (aside - s[1]) / kind.hand
        yaw = (kind.drag[5] + kind.quadratic[5] * abs(rate)) * rate + kind.gain[5] * (rate - omega[2])
        if kind.forward_only:
            yaw = _turn_under_way(kind, s, wanted, force[0], yaw)
        force, moment, turn = (force[0], 0.0, 0.0), (0.0, 0.0, yaw), (0.0, 0.0, 0.0)
    else:
        attitude = (heading[0], 0.0, 0.0, heading[1])
        if kind.steering == THRUST_VECTOR:
            force, weight, attitude = _point_thrust(kind, heading, R, force, weight)
        turn = _turn_to(kind, attitude, sensed.quaternion, omega)
        # Thrust and drag act at the origin. What is left of them accelerates the centre of mass c, and added mass at
        # the origin: without turning the vehicle, the former takes a moment of c times it. (The Munk moment of
        # added mass is left to the attitude hold.)
        net, share = subtract(force, drag_force(kind, s)), kind.rigid_mass_fraction
        moment = cross(triple(kind.com), (share[0] * net[0], share[1] * net[1], share[2] * net[2]))
    return weight, turn, force, moment


@jit
def _turn_under_way(kind, s, wanted, surge, yaw):
    """Limit a yaw moment by the surge force that comes with it.

    A boat that cannot back, and turns by pushing, must not go faster than the speed that is wanted: near its target it
    would circle. Below the speed at which turning round is worth it, the boat turns no harder than its wanted surge
    force allows, and drifts.

    Args:
        kind: see KIND.
        s: velocity through the medium, body axes, (3,), m/s.
        wanted: the same that is wanted.
        surge: force that is wanted, N.
        yaw: moment that is wanted, N m.
    """
    if kind.turning_price <= 0.0:
        return yaw
    speed, least = np.sqrt(wanted[0] * wanted[0] + wanted[1] * wanted[1]), kind.turning_speed
    worth = min(max(speed - least, 0.0) / least, 1.0) if least > 0.0 else 1.0
    free = (kind.drag[0] + kind.quadratic[0] * speed) * speed + kind.gain[0] * (speed - s[0])
    surge = max(surge, 0.0)
    largest = (surge + worth * max(free - surge, 0.0)) / kind.turning_price
    return min(max(yaw, -largest), largest)


@inline_jit
def _point_thrust(kind, heading, R, force, weight):
    """Turn a force (3,) in N that is wanted beside the weight (3,) into thrust along z, and the attitude that makes it.

    The force is scaled, never turned, until thrust, tilt and sinking are within what the vehicle may do.

    Returns:
        Force and weight along z, in body axes, which add up to what the present attitude makes of the wanted thrust;
        and the wanted attitude as a quaternion: the shortest turn of z to the thrust, after the turn to the heading.
    """
    lift, slope, most = kind.supported_weight, kind.tan_max_tilt, kind.most_thrust
    x, y, z = to_world(R, force)
    share = 1.0
    if -z > _SHARE_OF_FALL * lift:
        share = _SHARE_OF_FALL * lift / -z
    beyond = np.sqrt(x * x + y * y) - slope * z
    if share * beyond > slope * lift:
        share = slope * lift / beyond
    square = x * x + y * y + z * z
    if share * share * square + 2.0 * share * z * lift + lift * lift > most * most:
        share = (np.sqrt(z * z * lift * lift + square * (most * most - lift * lift)) - z * lift) / square
    x, y, z = share * x, share * y, lift + share * z
    along = x * R[2] + y * R[5] + z * R[8]
    a, b, c = np.sqrt(x * x + y * y + z * z) + z, -y, x
    size = 1.0 / np.sqrt(a * a + b * b + c * c)
    a, b, c = a * size, b * size, c * size
    hw, hz = heading[0], heading[1]
    attitude = (a * hw, b * hw + c * hz, c * hw - b * hz, a * hz)
    return (0.0, 0.0, along - weight[2]), (0.0, 0.0, weight[2]), attitude


@inline_jit
def _turn_to(kind, attitude, quaternion, omega):
    """The moment that turns the vehicle from its quaternion to a wanted attitude, body axes, N m."""
    w, x, y, z = attitude
    a, b, c, d = quaternion
    # conj(quaternion) times the wanted one
    stiffness = 2.0 * kind.stiffness if a * w + b * x + c * y + d * z >= 0.0 else -2.0 * kind.stiffness
    damping = kind.rate_damping
    wanted = (
        stiffness * (a * x - b * w - c * z + d * y) - damping * omega[0],
        stiffness * (a * y + b * z - c * w - d * x) - damping * omega[1],
        stiffness * (a * z - b * y + c * x - d * w) - damping * omega[2],
    )
    return product(kind.inertia, wanted)
