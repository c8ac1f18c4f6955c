"""Vehicles as records: what the compiled loop knows of them, side by side in memory.

Records, not a tuple of arrays: compiled code passes one pointer on, and a vehicle's numbers share cache lines. What
all vehicles of a kind have in common is there once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.arena import Arena
from mjsheaf.backends.physics.vehicle import Vehicle

Array = NDArray[np.float64]

FULL, THRUST_VECTOR, HAND_POINT = 0, 1, 2
_CONTROLS = {"full": FULL, "thrust_vector": THRUST_VECTOR, "hand_point": HAND_POINT}

# Body axes, about the origin of the body frame.
KIND = np.dtype(
    [
        ("thruster", "i8"),  # the first of its thrusters among those of all kinds
        ("count", "i8"),  # how many it has
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
BODY = np.dtype(
    [
        ("kind", "i8"),  # number of its kind
        ("qpos", "i8"),  # addresses of its free joint in qpos and qvel
        ("dof", "i8"),
        ("actuator", "i8"),  # the first of its actuators
        ("heading", "f8", 2),  # cosine and sine of half the heading to hold
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


class Fleet(NamedTuple):
    """All vehicles, for compiled code: a KIND for each kind, a BODY for each vehicle, each kind's THRUSTERs in turn."""

    kinds: NDArray[np.void]
    bodies: NDArray[np.void]
    thrusters: NDArray[np.void]


def pack_fleet(arena: Arena, heading: Array, level: float) -> Fleet:
    """Pack an arena's vehicles; headings (V,) in rad are held, `level` is the height of the water in m."""
    vehicles = list({id(vehicle): vehicle for vehicle in arena.vehicles}.values())
    number = {id(vehicle): k for k, vehicle in enumerate(vehicles)}
    kinds = np.zeros(len(vehicles), KIND)
    kinds["count"] = [len(vehicle.thrusters) for vehicle in vehicles]
    kinds["thruster"] = np.cumsum(kinds["count"]) - kinds["count"]
    kinds["level"] = level
    for vehicle, kind in zip(vehicles, kinds, strict=True):
        at = arena.dof[next(v for v, other in enumerate(arena.vehicles) if other is vehicle)]
        _pack(vehicle, kind, arena.model.dof_damping[at : at + 6])
    bodies = np.zeros(len(arena.vehicles), BODY)
    bodies["kind"] = [number[id(vehicle)] for vehicle in arena.vehicles]
    bodies["qpos"], bodies["dof"], bodies["actuator"] = arena.qpos, arena.dof, arena.thruster[:-1]
    bodies["heading"] = np.column_stack([np.cos(heading / 2.0), np.sin(heading / 2.0)])
    return Fleet(kinds, bodies, np.concatenate([_thrusters(vehicle) for vehicle in vehicles]))


def _thrusters(vehicle: Vehicle) -> NDArray[np.void]:
    thrusters = np.zeros(len(vehicle.thrusters), THRUSTER)
    thrusters["direction"] = vehicle.gears[:, :3]
    thrusters["row"] = vehicle.allocation
    thrusters["low"], thrusters["high"] = vehicle.limits.T
    return thrusters


def _pack(vehicle: Vehicle, kind: np.void, damping: Array) -> None:
    """Pack a vehicle of which the free joint takes some damping, shape (6,), N s/m and N m s/rad."""
    floats, hold = vehicle.description.hydrostatics, vehicle.description.attitude
    added = bool(vehicle.added_mass.any())
    kind["planar"] = vehicle.dimension == 2
    kind["drag"], kind["quadratic"] = [*vehicle.drag, *vehicle.angular_drag], vehicle.quadratic_drag
    kind["implicit"], kind["explicit"] = damping[0], not damping.any()
    kind["ballast"] = vehicle.ballast
    kind["arm"] = kind["hung"] = kind["centre"] = vehicle.centre_of_mass
    if floats is None:
        kind["lift"] = vehicle.weight
        if vehicle.ballast > 0.0:
            # Ballast has no inertia that would swing with it, and the lag of rotors would let it topple the vehicle:
            # it hangs where it and the model's weight together act in the plane of the origin.
            kind["hung"][2] *= 1.0 - vehicle.weight / vehicle.ballast
            kind["arm"][2] = 0.0
    else:
        kind["buoyancy"], kind["restoring"] = vehicle.weight, [floats.heave, floats.roll, floats.pitch]
        if floats.centre is not None:
            kind["centre"][:2] = floats.centre
    kind["added"], kind["added_mass"], kind["share"] = added, vehicle.added_mass, vehicle.share
    kind["mass"], kind["weight"], kind["rigid"] = vehicle.mass, vehicle.weight - vehicle.ballast, vehicle.inertia
    kind["control"], kind["gain"] = _CONTROLS[vehicle.control], vehicle.moving_mass * vehicle.rate
    kind["inertia"] = vehicle.turning_inertia
    kind["balance"] = vehicle.mass / (vehicle.mass + vehicle.added_mass[:3])
    kind["stiffness"], kind["rate_damping"] = hold.frequency**2, 2.0 * hold.damping * hold.frequency
    kind["hand"], kind["slope"] = vehicle.hand, np.tan(np.deg2rad(vehicle.tilt))
    kind["most_thrust"] = vehicle.usable_lift
