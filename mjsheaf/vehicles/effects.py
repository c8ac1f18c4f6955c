"""What a vehicle can do at best: thrust with its weight carried, and the speed that drag leaves of it.

Vehicles with some of what makes them real switched off, so that each effect's cost can be told from the others'.

- inertia: off, mass, inertia and added mass shrink until m / D is `massless_tau`; weight and drag stay what they are,
  and the autopilot, which has nothing left to do, is off.
- drag_law: off, drag is linear.
- limits: off, thrusters push as hard as asked, and multirotors tilt as far as 80 degrees.
- lag: off, thrusters follow their commands at once.
- underactuation: off, a vehicle has thrusters along every axis that it is controlled in, as strong and as slow as its
  own. A boat then holds its heading, is controlled at its origin, and is only as fast abeam as its sway drag leaves; a
  multirotor pushes sideways as hard as up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjsheaf.system import Effects
from mjsheaf.vehicles.vehicle import ROW_NAMES, Vehicle

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


_LIMITS = ("ctrl", "force", "act")
_FREE_TILT = 80.0  # degrees


def embody(vehicle: Vehicle, effects: Effects) -> Vehicle:
    """The vehicle with the effects that are wanted; see the module for what each is."""
    if not effects.underactuation and vehicle.control != "full":
        vehicle = _fully_actuated(vehicle)
    if not effects.limits:
        vehicle = _unlimited(vehicle)
    if not effects.lag:
        free = {"dyntype": "none", "actlimited": "false"}
        actuation = [{k: a for k, a in x.items() if k != "actrange"} | free for x in vehicle.actuation]
        vehicle = replace(vehicle, actuation=actuation)
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
        limits=bool(np.isfinite(vehicle.limits).any()),
        lag=any(a["dyntype"] != "none" for a in vehicle.actuation),
        underactuation=vehicle.control != "full",
    )


def _unlimited(vehicle: Vehicle) -> Vehicle:
    ranges, free = {f"{n}range" for n in _LIMITS}, {f"{n}limited": "false" for n in _LIMITS}
    actuation = [{k: a for k, a in x.items() if k not in ranges} | free for x in vehicle.actuation]
    tilt = _FREE_TILT if vehicle.tilt else 0.0
    return replace(vehicle, actuation=actuation, tilt=tilt)


def _massless(vehicle: Vehicle, tau: float) -> Vehicle:
    """Shrink the mass; the model's weight shrinks with it, and ballast makes up for that."""
    own = vehicle.mass / vehicle.drag[: vehicle.dimension]  # added mass goes altogether
    scale = min(1.0, tau / float(own.max()))
    inertials = [x._replace(mass=x.mass * scale, diagonal=x.diagonal * scale) for x in vehicle.inertials]
    # What turns keeps its drag in proportion, so that the attitude hold stays what it was. A boat rolls and pitches by
    # its restoring, and yaw at a hand point is a controlled velocity: these keep theirs.
    held = {"hand_point": [], "full": [2] if vehicle.dimension == 2 else [0, 1, 2], "thrust_vector": [0, 1, 2]}
    turning, axes = np.ones(3), held[vehicle.control]
    turning[axes] = (scale * np.diag(vehicle.inertia) / vehicle.moving_mass[3:])[axes]
    return replace(
        vehicle,
        angular_drag=vehicle.angular_drag * turning,
        quadratic_drag=vehicle.quadratic_drag * np.concatenate([np.ones(3), turning]),
        mass=vehicle.mass * scale,
        ballast=vehicle.ballast + (1.0 - scale) * vehicle.weight,
        inertia=vehicle.inertia * scale,
        inertials=inertials,
        added_mass=np.zeros(6),
        rate=0.0,
    )


def _fully_actuated(vehicle: Vehicle) -> Vehicle:
    """Thrusters along every controlled axis: as strong as the vehicle's own together, and as slow as their mean."""
    rows = [0, 1, 5] if vehicle.dimension == 2 else [0, 1, 2, 3, 4, 5]
    low, high = np.minimum(vehicle.limits[:, 0], 0.0), vehicle.limits[:, 1]
    used = vehicle.W != 0.0  # what a thruster without limits does not push at all is no push without limits
    reach = np.where(vehicle.W > 0.0, high, low) * np.where(used, vehicle.W, 1.0)
    strongest = np.where(used, reach, 0.0).sum(axis=1)
    force = strongest[:3].max()
    lags = [a for a in vehicle.actuation if a["dyntype"] != "none"]
    actuation = []
    for row in rows:
        bound = force if row < 3 else strongest[row]
        limited = "true" if np.isfinite(bound) and bound > 0.0 else "false"
        own = {
            "dyntype": "none",
            "dynprm": vehicle.actuation[0]["dynprm"],
            "gainprm": np.array([1.0]),
            "actearly": "false",
            "ctrllimited": limited,
            "forcelimited": "false",
            "actlimited": "false",
        }
        if limited == "true":
            own["ctrlrange"] = np.array([-bound, bound])
        if lags:
            own |= {"dyntype": lags[0]["dyntype"], "dynprm": np.array([vehicle.lag])}
        actuation.append(own)
    return replace(
        vehicle,
        control="full",
        thrusters=[f"virtual_{ROW_NAMES[row].replace(' ', '_')}" for row in rows],
        actuation=actuation,
        W=np.eye(6)[:, rows],
        hand=0.0,
        tilt=0.0,
    )
