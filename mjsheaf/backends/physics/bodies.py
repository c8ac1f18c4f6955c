"""Vehicles as arrays: what the compiled loop knows of them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.arena import Arena
from mjsheaf.backends.physics.vehicle import Vehicle

Array = NDArray[np.float64]

FULL, THRUST_VECTOR, HAND_POINT = 0, 1, 2
_CONTROLS = {"full": FULL, "thrust_vector": THRUST_VECTOR, "hand_point": HAND_POINT}
_RESERVE = 0.9  # of its thrust is what a multirotor that points its thrust may use for going somewhere


class BodyArrays(NamedTuple):
    """V vehicles with A thrusters in all; body axes, about the origin of the body frame.

    Where they are: qpos, dof (V,), thruster (V + 1,): addresses.

    The medium's doing: drag, quadratic (V, 6): of v and |v| v, N s/m, N s^2/m^2 and angular; damping (V, 2): linear and
    angular share that the joint's implicit damping takes, N s/m and 0 or 1; ballast, buoyancy (V,): N; arm, centre
    (V, 3): centres of mass and of buoyancy, m; restoring (V, 3): heave, roll, pitch; level (V,): height of the water,
    m.

    Added mass, where `added` (V,): added_mass (V, 6); share (V, 6, 6): M_RB (M_RB + M_A)^-1; mass, weight (V,): of the
    model, kg and N; rigid (V, 3, 3): inertia of the model, kg m^2.

    The autopilot's: control (V,): FULL, THRUST_VECTOR or HAND_POINT; gain (V, 6): M k_v; inertia (V, 3, 3): with added
    mass; stiffness, rate_damping (V,) of the attitude hold, 1/s^2 and 1/s; heading (V, 2): cosine and sine of half the
    heading to hold; lift (V,): weight that thrusters carry, N; hand (V,): m; slope (V,): tangent of the largest tilt;
    most_thrust (V,): N.

    Thrusters: direction (A, 3): force for a force of 1, as gear; allocation (A, 6): W^+; limits (A, 2): of the
    commands.
    """

    qpos: NDArray[np.int64]
    dof: NDArray[np.int64]
    thruster: NDArray[np.int64]
    drag: Array
    quadratic: Array
    damping: Array
    ballast: Array
    buoyancy: Array
    arm: Array
    centre: Array
    restoring: Array
    level: Array
    added: NDArray[np.bool_]
    added_mass: Array
    share: Array
    mass: Array
    weight: Array
    rigid: Array
    control: NDArray[np.int64]
    gain: Array
    inertia: Array
    stiffness: Array
    rate_damping: Array
    heading: Array
    lift: Array
    hand: Array
    slope: Array
    most_thrust: Array
    direction: Array
    allocation: Array
    limits: Array


def pack_bodies(arena: Arena, heading: Array, level: float) -> BodyArrays:
    """Pack an arena's vehicles; headings (V,) in rad are held, `level` is the height of the water in m."""
    vehicles = arena.vehicles
    floats = [v.description.hydrostatics for v in vehicles]
    frequency = np.array([v.description.attitude.frequency for v in vehicles])
    ratio = np.array([v.description.attitude.damping for v in vehicles])
    weight, afloat = np.array([v.weight for v in vehicles]), np.array([h is not None for h in floats])
    arm = np.array([v.centre_of_mass for v in vehicles])
    centre = arm.copy()
    for v, h in enumerate(floats):
        if h is not None and h.centre is not None:
            centre[v, :2] = h.centre
    heading = np.asarray(heading, dtype=np.float64)
    return BodyArrays(
        qpos=arena.qpos,
        dof=arena.dof,
        thruster=arena.thruster,
        drag=np.array([[*v.drag, *v.angular_drag] for v in vehicles]),
        quadratic=np.array([v.quadratic_drag for v in vehicles]),
        damping=np.array([[0.0, 0.0] if v.added_mass.any() else [v.drag.max(), 1.0] for v in vehicles]),
        ballast=np.array([v.ballast for v in vehicles]),
        buoyancy=np.where(afloat, weight, 0.0),
        arm=arm,
        centre=centre,
        restoring=np.array([[h.heave, h.roll, h.pitch] if h is not None else [0.0] * 3 for h in floats]),
        level=np.full(len(vehicles), level),
        added=np.array([v.added_mass.any() for v in vehicles]),
        added_mass=np.array([v.added_mass for v in vehicles]),
        share=np.array([v.share for v in vehicles]),
        mass=np.array([v.mass for v in vehicles]),
        weight=np.array([v.weight - v.ballast for v in vehicles]),
        rigid=np.array([v.inertia for v in vehicles]),
        control=np.array([_CONTROLS[v.control] for v in vehicles], dtype=np.int64),
        gain=np.array([v.moving_mass * v.rate for v in vehicles]),
        inertia=np.array([v.inertia + np.diag(v.added_mass[3:]) for v in vehicles]),
        stiffness=frequency**2,
        rate_damping=2.0 * ratio * frequency,
        heading=np.column_stack([np.cos(heading / 2.0), np.sin(heading / 2.0)]),
        lift=np.where(afloat, 0.0, weight),
        hand=np.array([v.hand for v in vehicles]),
        slope=np.tan(np.deg2rad([v.tilt for v in vehicles])),
        most_thrust=np.array([_most_thrust(v) for v in vehicles]),
        direction=arena.model.actuator_gear[:, :3].copy(),
        allocation=np.vstack([v.allocation for v in vehicles]),
        limits=np.vstack([v.limits for v in vehicles]),
    )


def _most_thrust(vehicle: Vehicle) -> float:
    """Thrust along z that a vehicle may use for its translation, N."""
    reach = np.where(vehicle.W[2] > 0.0, vehicle.W[2] * vehicle.limits[:, 1], 0.0).sum()
    return max(_RESERVE * float(reach), 1.01 * vehicle.weight)
