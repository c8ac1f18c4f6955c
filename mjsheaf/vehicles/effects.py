"""What a vehicle can do at best: thrust with its weight carried, and the speed that drag leaves of it.

Vehicles with some of what makes them real switched off, so that each effect's cost can be told from the others'.

- inertia: off, mass, inertia and added mass shrink until m / D is `massless_tau`; weight and drag stay what they are,
  and the autopilot, which has nothing left to do, is off.
- limits: off, thrusters push as hard as asked, and multirotors tilt as far as 80 degrees.
- underactuation: off, a vehicle has thrusters along every axis that it is controlled in, as strong and as slow as its
  own. A boat then holds its heading, is controlled at its origin, and is only as fast abeam as its sway drag leaves; a
  multirotor pushes sideways as hard as up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.io.section import Duration, Section
from mjsheaf.vehicles.actuators import Thruster
from mjsheaf.vehicles.body import ROW_NAMES
from mjsheaf.vehicles.steering import Full
from mjsheaf.vehicles.vehicle import Vehicle


@dataclass(frozen=True)
class Capability:
    """The best that a level vehicle can do in steady motion; infinite where its thrusters have no limits.

    Attributes:
        forward_thrust: N, along x with no other wrench but what carries the weight.
        forward_speed: m/s through the medium.
        least_thrust: N, in the horizontal direction in which it is weakest; of a boat at its hand point, which turns
            first, that forward.
        least_speed: m/s through the medium, in the horizontal direction in which it is slowest.
    """

    forward_thrust: float
    forward_speed: float
    least_thrust: float
    least_speed: float


def capability_of(vehicle: Vehicle) -> Capability:
    """Thrust and speed of a vehicle."""
    directions = vehicle.steering.directions
    thrust = np.array([vehicle.steering.largest_force(vehicle, d) for d in directions])
    speed = np.array([_speed(vehicle, d, F) for d, F in zip(directions, thrust, strict=True)])
    return Capability(float(thrust[0]), float(speed[0]), float(thrust.min()), float(speed.min()))


def of_each(vehicles: Sequence[Vehicle], measure: Callable[[Vehicle], float]) -> Array:
    """A measure of every vehicle, shape (V,), taken once of those that are the same."""
    known = {id(vehicle): vehicle for vehicle in vehicles}
    found = {key: measure(vehicle) for key, vehicle in known.items()}
    return np.array([found[id(vehicle)] for vehicle in vehicles])


def _speed(vehicle: Vehicle, direction: Array, thrust: float) -> float:
    """Steady speed at which drag takes a thrust along a unit vector of the body's plane: D v + Q v^2 = F, m/s."""
    D = float(vehicle.drag[:2] @ direction**2)
    Q = float(vehicle.quadratic_drag[:2] @ np.abs(direction) ** 3)
    if not np.isfinite(thrust):
        return float("inf")
    return thrust / D if Q == 0.0 else (np.sqrt(D**2 + 4.0 * Q * thrust) - D) / (2.0 * Q)


class Effects(Section):
    """What makes bodies real; each can be switched off alone."""

    inertia: bool = Field(True, description="off: bodies are so light that m / D is massless_tau; no autopilot")
    drag_law: bool = Field(True, description="off: drag is linear")
    limits: bool = Field(True, description="off: thrusters push as hard as asked")
    lag: bool = Field(True, description="off: thrusters follow their commands at once")
    underactuation: bool = Field(True, description="off: thrusters along every controlled axis")
    massless_tau: Duration = Field(0.02, description="m / D without inertia [s]")


def embody(vehicle: Vehicle, effects: Effects) -> Vehicle:
    """The vehicle with the effects that are wanted; see `Effects` and the module for what each is."""
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
    """Which effects a vehicle has at all: switching off another changes nothing."""
    return Effects(
        inertia=vehicle.rate > 0.0 or bool(vehicle.added_mass.any()),
        drag_law=bool(vehicle.quadratic_drag.any()),
        limits=any(actuator.limited for actuator in vehicle.actuators),
        lag=vehicle.lag > 0.0,
        underactuation=vehicle.steering.underactuated,
    )


def _massless(vehicle: Vehicle, tau: float) -> Vehicle:
    """Shrink the mass; the model's weight shrinks with it, and ballast makes up for that."""
    own = vehicle.mass / vehicle.drag[: vehicle.dimension]  # added mass goes altogether
    scale = min(1.0, tau / float(own.max()))
    inertials = [x._replace(mass=x.mass * scale, diagonal=x.diagonal * scale) for x in vehicle.inertials]
    # What turns keeps its drag in proportion, so that the attitude hold stays what it was. A boat rolls and pitches by
    # its restoring, and yaw at a hand point is a controlled velocity: these keep theirs.
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
    """Thrusters along every controlled axis: as strong as the vehicle's own together, and as slow as their mean."""
    low, high = np.minimum(vehicle.effort_bounds[:, 0], 0.0), vehicle.effort_bounds[:, 1]
    used = vehicle.W != 0.0  # what a thruster without limits does not push at all is no push without limits
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
