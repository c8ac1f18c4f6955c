"""What a vehicle can do at best: thrust with its weight carried, and the speed that drag leaves of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.vehicle import Vehicle

Array = NDArray[np.float64]

_DIRECTIONS = 24  # of the plane, at which thrust is looked at


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
    if vehicle.control == "full":
        angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
    else:
        directions = np.array([[1.0, 0.0]])
    thrust = np.array([_thrust(vehicle, d) for d in directions])
    speed = np.array([_speed(vehicle, d, F) for d, F in zip(directions, thrust, strict=True)])
    return Capability(float(thrust[0]), float(speed[0]), float(thrust.min()), float(speed.min()))


def of_each(vehicles: Sequence[Vehicle], measure: Callable[[Vehicle], float]) -> Array:
    """A measure of every vehicle, shape (V,), taken once of those that are the same."""
    known = {id(vehicle): vehicle for vehicle in vehicles}
    found = {key: measure(vehicle) for key, vehicle in known.items()}
    return np.array([found[id(vehicle)] for vehicle in vehicles])


def _thrust(vehicle: Vehicle, direction: Array) -> float:
    """Largest horizontal force along a unit vector of the body's plane, N."""
    if vehicle.control == "thrust_vector":
        most = vehicle.usable_lift
        by_tilt = vehicle.weight * np.tan(np.deg2rad(vehicle.tilt))
        return float(min(by_tilt, np.sqrt(max(most**2 - vehicle.weight**2, 0.0))))
    from scipy.optimize import linprog

    # max s over commands u within limits with W u = weight + s direction on the controlled rows
    rows = vehicle.controlled_rows
    along = np.array([*direction, 0.0, 0.0, 0.0, 0.0])
    carried = np.zeros(6) if vehicle.dimension == 2 else vehicle.W @ vehicle.trim
    equations = np.column_stack([vehicle.W[rows], -along[rows]])
    found = linprog(
        np.r_[np.zeros(vehicle.W.shape[1]), -1.0],
        A_eq=equations,
        b_eq=carried[rows],
        bounds=[*vehicle.limits, (0.0, np.inf)],
    )
    return float(found.x[-1]) if found.status == 0 else (float("inf") if found.status == 3 else 0.0)


def _speed(vehicle: Vehicle, direction: Array, thrust: float) -> float:
    """Steady speed at which drag takes a thrust along a unit vector of the body's plane: D v + Q v^2 = F, m/s."""
    D = float(vehicle.drag[:2] @ direction**2)
    Q = float(vehicle.quadratic_drag[:2] @ np.abs(direction) ** 3)
    if not np.isfinite(thrust):
        return float("inf")
    return thrust / D if Q == 0.0 else (np.sqrt(D**2 + 4.0 * Q * thrust) - D) / (2.0 * Q)
