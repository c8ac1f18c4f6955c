"""Capabilities of a vehicle, and vehicles with physical effects switched off, which isolates the cost of each effect.

The capabilities are the thrust available in addition to carrying the weight, and the resulting speed. The less obvious
effects are:

- inertia: If off, mass, inertia and added mass shrink until m / D is `massless_tau`. Weight and drag stay the same. The
  autopilot is off, because it is no longer needed.
- limits: If off, thrusters have no limits, and multirotors tilt up to 80 degrees.
- underactuation: If off, a vehicle has thrusters along every controlled axis, with the strength and lag of its own. A
  boat then holds its heading and is controlled at its origin, and its sway drag limits its speed abeam. A multirotor
  has as much force sideways as up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.section import Duration, Section
from mjsheaf.vehicles.actuators import WEAK_SIDE, Thruster
from mjsheaf.vehicles.steering import Full
from mjsheaf.vehicles.vehicle import ROW_NAMES, Vehicle

SURGE, YAW = 0, 5
_TURNING_SHARE = 0.12  # fraction of the speed ahead above which a boat that cannot back turns round under way
_HALF = 0.5  # fraction of the largest yaw moment at which its price in surge is taken


@dataclass(frozen=True)
class Capability:
    """Capabilities of a level vehicle in steady motion; infinite if its thrusters have no limits.

    Attributes:
        forward_thrust: Maximum thrust along x in addition to the trim, N.
        forward_speed: Maximum speed along x through the medium, m/s.
        least_thrust: Maximum thrust in the weakest horizontal direction, N; the forward thrust of a boat at its hand
            point, which turns first.
        least_speed: Maximum speed through the medium in the slowest horizontal direction, m/s.
        top_speed: Maximum speed through the medium in the fastest horizontal direction, m/s.
    """

    forward_thrust: float
    forward_speed: float
    least_thrust: float
    least_speed: float
    top_speed: float


def capability_of(vehicle: Vehicle) -> Capability:
    """Compute the thrust and speed of a vehicle."""
    directions = vehicle.steering.directions
    thrust = np.array([vehicle.steering.largest_force(vehicle, d) for d in directions])
    speed = np.array([_speed(vehicle, d, F) for d, F in zip(directions, thrust, strict=True)])
    return Capability(float(thrust[0]), float(speed[0]), float(thrust.min()), float(speed.min()), float(speed.max()))


def of_each(vehicles: Sequence[Vehicle], measure: Callable[[Vehicle], float]) -> Array:
    """Evaluate a measure of every vehicle, shape (V,), once for identical ones."""
    known = {id(vehicle): vehicle for vehicle in vehicles}
    found = {key: measure(vehicle) for key, vehicle in known.items()}
    return np.array([found[id(vehicle)] for vehicle in vehicles])


def _speed(vehicle: Vehicle, direction: Array, thrust: float) -> float:
    """Solve D v + Q v^2 = F for the steady speed along a unit vector of the body's plane, m/s.

    The root is written without a difference, because abeam Q is the rounding of a cosine, and not 0.
    """
    D = float(vehicle.drag[:2] @ direction**2)
    Q = float(vehicle.quadratic_drag[:2] @ np.abs(direction) ** 3)
    if not np.isfinite(thrust):
        return float("inf")
    return float(2.0 * thrust / (D + np.sqrt(D**2 + 4.0 * Q * thrust)))


def is_one_sided(vehicle: Vehicle) -> bool:
    """Return True for a boat with an actuator that pushes in one direction only, or very little in the other."""
    return vehicle.dimension == 2 and any(actuator.one_sided for actuator in vehicle.actuators)


class Turning(NamedTuple):
    """Turning parameters of a boat that cannot back; see `steering.steer_hand_point`.

    Attributes:
        price: Surge force that comes with each unit of yaw moment, 1/m; 0 if it turns on the spot.
        speed: Commanded speed above which it turns round instead of drifting, m/s.
    """

    price: float
    speed: float


def turning_of(vehicle: Vehicle) -> Turning | None:
    """Return the turning parameters of a boat steered at its hand point; None for a vehicle that can back."""
    if YAW not in vehicle.controlled_rows or vehicle.steering.attitude or not is_one_sided(vehicle):
        return None
    ahead, astern = (largest_wrench(vehicle, SURGE, sign, []) for sign in (1.0, -1.0))
    if not ahead > 0.0 or astern >= WEAK_SIDE * ahead:
        return None
    prices = []
    for sign in (1.0, -1.0):
        moment = _HALF * largest_wrench(vehicle, YAW, sign, [SURGE])
        if np.isfinite(moment) and moment > 0.0:
            prices.append(_least_surge(vehicle, sign * moment) / moment)
    speed = _TURNING_SHARE * capability_of(vehicle).forward_speed
    return Turning(max(prices, default=0.0), speed if np.isfinite(speed) else 0.0)


def largest_wrench(vehicle: Vehicle, row: int, sign: float, free: list[int]) -> float:
    """Compute the largest wrench along a row in one direction, N or N m; other controlled rows are zero or `free`."""
    rows = [other for other in vehicle.controlled_rows if other not in free]
    along = np.zeros(6)
    along[row] = sign
    return vehicle.largest_along(rows, along, vehicle.W @ vehicle.steering.trim_effort(vehicle))


def _least_surge(vehicle: Vehicle, moment: float) -> float:
    """Compute the smallest surge force >= 0 with which a boat produces a yaw moment, N."""
    W = vehicle.W
    A = np.column_stack([W[[SURGE, YAW]], [-1.0, 0.0]])
    return vehicle.solve_for_efforts(A, np.array([0.0, moment]), np.append(np.zeros(W.shape[1]), 1.0))


class Effects(Section):
    """Physical effects of bodies; each can be switched off separately."""

    inertia: bool = Field(True, description="off: bodies are so light that m / D is massless_tau; no autopilot")
    drag_law: bool = Field(True, description="off: drag is linear")
    limits: bool = Field(True, description="off: thrusters have no limits")
    lag: bool = Field(True, description="off: thrusters follow their commands without lag")
    underactuation: bool = Field(True, description="off: thrusters along every controlled axis")
    massless_tau: Duration = Field(0.02, description="m / D without inertia [s]")


def embody(vehicle: Vehicle, effects: Effects) -> Vehicle:
    """Return the vehicle with the given effects; see `Effects` and the module."""
    if not effects.underactuation and vehicle.steering.underactuated:
        vehicle = _fully_actuated(vehicle)
    if not effects.limits:
        free = [actuator.without_limits() for actuator in vehicle.actuators]
        vehicle = replace(vehicle, actuators=free, steering=vehicle.steering.without_limits())
    if not effects.lag:
        vehicle = replace(vehicle, actuators=[actuator.without_lag() for actuator in vehicle.actuators])
    if not effects.drag_law:
        vehicle = replace(vehicle, quadratic_drag=np.zeros(6))
    if not effects.inertia:
        vehicle = _massless(vehicle, effects.massless_tau)
    return vehicle


def has_effects(vehicle: Vehicle) -> Effects:
    """Return the effects that a vehicle has; switching off another one changes nothing."""
    return Effects(
        inertia=vehicle.rate > 0.0 or bool(vehicle.added_mass.any()),
        drag_law=bool(vehicle.quadratic_drag.any()),
        limits=bool(np.isfinite(vehicle.limits).any()),
        lag=vehicle.lag > 0.0,
        underactuation=vehicle.steering.underactuated,
    )


def _massless(vehicle: Vehicle, tau: float) -> Vehicle:
    """Shrink the mass; ballast compensates for the model's lower weight."""
    own = vehicle.mass / vehicle.drag[: vehicle.dimension]  # added mass is removed
    scale = min(1.0, tau / float(own.max()))
    inertials = [x._replace(mass=x.mass * scale, diagonal=x.diagonal * scale) for x in vehicle.inertials]
    # Angular drag shrinks with the inertia, so that the attitude hold stays the same. Exceptions keep their drag: roll
    # and pitch of a boat, which follow from its restoring moments, and yaw at a hand point, a controlled velocity.
    turning, axes = np.ones(3), [row - 3 for row in vehicle.controlled_rows if row > 2 and vehicle.steering.attitude]
    turning[axes] = (scale * np.diag(vehicle.inertia) / vehicle.moving_mass[3:])[axes]
    return replace(
        vehicle,
        angular_drag=vehicle.angular_drag * turning,
        quadratic_drag=vehicle.quadratic_drag * np.concatenate([np.ones(3), turning]),
        mass=vehicle.mass * scale,
        ballast=vehicle.ballast + (1.0 - scale) * vehicle.weight,
        weight_moment=vehicle.weight_moment * scale,
        inertia=vehicle.inertia * scale,
        inertials=inertials,
        added_mass=np.zeros(6),
        rate=0.0,
    )


def _fully_actuated(vehicle: Vehicle) -> Vehicle:
    """Give a vehicle thrusters along every controlled axis, as strong as its own together and as slow as their mean."""
    low, high = np.minimum(vehicle.effort_bounds[:, 0], 0.0), vehicle.effort_bounds[:, 1]
    used = vehicle.W != 0.0  # a thruster without limits has no effect along an axis where it has no wrench
    reach = np.where(vehicle.W > 0.0, high, low) * np.where(used, vehicle.W, 1.0)
    strongest = np.where(used, reach, 0.0).sum(axis=1)
    force, steering = strongest[:3].max(), Full()
    actuators: list[Thruster] = []
    for row in steering.rows[vehicle.dimension]:
        bound = force if row < 3 else strongest[row]
        limits = (-bound, bound) if np.isfinite(bound) and bound > 0.0 else None
        law, name = "filterexact" if vehicle.lag > 0.0 else "none", f"virtual_{ROW_NAMES[row].replace(' ', '_')}"
        actuators.append(Thruster(name, np.eye(6)[row], ctrl=limits, law=law, time_constant=vehicle.lag))
    return replace(vehicle, steering=steering, actuators=actuators)
