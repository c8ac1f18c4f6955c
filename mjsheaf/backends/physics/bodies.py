"""Vehicles as records: what the compiled loop knows of each, side by side in memory.

Records, not a tuple of arrays: compiled code passes one pointer on, and a vehicle's numbers share cache lines.
"""

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.arena import Arena
from mjsheaf.backends.physics.vehicle import Vehicle

Array = NDArray[np.float64]

FULL, THRUST_VECTOR, HAND_POINT = 0, 1, 2
_CONTROLS = {"full": FULL, "thrust_vector": THRUST_VECTOR, "hand_point": HAND_POINT}

# Body axes, about the origin of the body frame.
BODY = np.dtype(
    [
        # where it is: addresses of its free joint in qpos and qvel, its thrusters
        ("qpos", "i8"),
        ("dof", "i8"),
        ("first", "i8"),
        ("last", "i8"),
        # what the medium does to it
        ("planar", "i8"),
        ("drag", "f8", 6),  # of v, N s/m and N m s/rad
        ("quadratic", "f8", 6),  # of |v| v
        ("implicit", "f8"),  # linear damping that the joint takes, N s/m
        ("explicit", "f8"),  # share of the angular damping that it leaves
        ("ballast", "f8"),  # N
        ("buoyancy", "f8"),  # N
        ("arm", "f8", 3),  # where the weight acts, m: the centre of mass
        ("hung", "f8", 3),  # where the ballast does, m
        ("centre", "f8", 3),  # of buoyancy, m
        ("restoring", "f8", 3),  # heave, roll, pitch, N/m and N m/rad
        ("level", "f8"),  # height of the water, m
        # its autopilot
        ("control", "i8"),  # FULL, THRUST_VECTOR or HAND_POINT
        ("gain", "f8", 6),  # M k_v, N s/m and N m s/rad
        ("inertia", "f8", (3, 3)),  # that a couple must overcome, kg m^2
        ("balance", "f8", 3),  # share of a force along each axis that accelerates the body itself
        ("stiffness", "f8"),  # of the attitude hold, 1/s^2
        ("rate_damping", "f8"),  # 1/s
        ("heading", "f8", 2),  # cosine and sine of half the heading to hold
        ("lift", "f8"),  # weight that thrusters carry, N
        ("hand", "f8"),  # distance of the controlled point ahead, m
        ("slope", "f8"),  # tangent of the largest tilt
        ("most_thrust", "f8"),  # N
        # added mass, which few have: last, so that the others stay in fewer cache lines
        ("added", "i8"),  # whether it has any
        ("added_mass", "f8", 6),  # kg and kg m^2
        ("share", "f8", (6, 6)),  # M_RB (M_RB + M_A)^-1
        ("mass", "f8"),  # of the model, kg
        ("weight", "f8"),  # of the model, N
        ("rigid", "f8", (3, 3)),  # inertia of the model, kg m^2
    ]
)
THRUSTER = np.dtype(
    [
        ("direction", "f8", 3),  # force for a force of 1, as gear
        ("row", "f8", 6),  # of the allocation W^+
        ("low", "f8"),  # limits of the command
        ("high", "f8"),
    ]
)


def pack_bodies(arena: Arena, heading: Array, level: float) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Pack an arena's vehicles; headings (V,) in rad are held, `level` is the height of the water in m.

    Returns:
        A BODY for each vehicle, shape (V,), and a THRUSTER for each thruster, shape (A,).
    """
    bodies = np.zeros(len(arena.vehicles), BODY)
    bodies["qpos"], bodies["dof"], bodies["level"] = arena.qpos, arena.dof, level
    bodies["first"], bodies["last"] = arena.thruster[:-1], arena.thruster[1:]
    bodies["heading"] = np.column_stack([np.cos(heading / 2.0), np.sin(heading / 2.0)])
    for v, vehicle in enumerate(arena.vehicles):
        _pack(vehicle, bodies[v])
    thrusters = np.zeros(arena.thruster[-1], THRUSTER)
    thrusters["direction"] = arena.model.actuator_gear[:, :3]
    thrusters["row"] = np.vstack([vehicle.allocation for vehicle in arena.vehicles])
    thrusters["low"], thrusters["high"] = np.vstack([vehicle.limits for vehicle in arena.vehicles]).T
    return bodies, thrusters


def _pack(vehicle: Vehicle, body: np.void) -> None:
    floats, hold = vehicle.description.hydrostatics, vehicle.description.attitude
    added = bool(vehicle.added_mass.any())
    body["planar"] = vehicle.dimension == 2
    body["drag"], body["quadratic"] = [*vehicle.drag, *vehicle.angular_drag], vehicle.quadratic_drag
    # What is shared with the medium must not be damped by the joint (see forces).
    body["implicit"], body["explicit"] = (0.0, 1.0) if added else (vehicle.drag.max(), 0.0)
    body["ballast"] = vehicle.ballast
    body["arm"] = body["hung"] = body["centre"] = vehicle.centre_of_mass
    if floats is None:
        body["lift"] = vehicle.weight
        if vehicle.ballast > 0.0:
            # Ballast has no inertia that would swing with it, and the lag of rotors would let it topple the vehicle:
            # it hangs where it and the model's weight together act in the plane of the origin.
            body["hung"][2] *= 1.0 - vehicle.weight / vehicle.ballast
            body["arm"][2] = 0.0
    else:
        body["buoyancy"], body["restoring"] = vehicle.weight, [floats.heave, floats.roll, floats.pitch]
        if floats.centre is not None:
            body["centre"][:2] = floats.centre
    body["added"], body["added_mass"], body["share"] = added, vehicle.added_mass, vehicle.share
    body["mass"], body["weight"], body["rigid"] = vehicle.mass, vehicle.weight - vehicle.ballast, vehicle.inertia
    body["control"], body["gain"] = _CONTROLS[vehicle.control], vehicle.moving_mass * vehicle.rate
    body["inertia"] = vehicle.turning_inertia
    body["balance"] = vehicle.mass / (vehicle.mass + vehicle.added_mass[:3])
    body["stiffness"], body["rate_damping"] = hold.frequency**2, 2.0 * hold.damping * hold.frequency
    body["hand"], body["slope"] = vehicle.hand, np.tan(np.deg2rad(vehicle.tilt))
    body["most_thrust"] = vehicle.usable_lift
