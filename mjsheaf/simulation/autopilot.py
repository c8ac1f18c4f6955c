"""Vehicles as records: what the compiled loop knows of them, side by side in memory.

Records, not a tuple of arrays: compiled code passes one pointer on, and a vehicle's numbers share cache lines. What
all vehicles of a kind have in common is there once.

The vehicle's onboard computer: from the velocity that the law wants to thruster commands within their limits.

It knows its vehicle, its attitude, and what it measures: velocity through the medium v_r and rates omega. It is not
handed the medium. With the commanded velocity v_c relative to the medium, in body axes, and d the vehicle's drag law:

    force      F = d(v_c) + M k_v (v_c - v_r), so that q' = w + v_c is left, with tau = M / (M k_v + D)
    attitude   J (k theta - b omega), theta twice the vector part of the quaternion to the wanted attitude (Wie and
               Barba, J. Guidance 8, 1985: for small angles the rotation vector)
    commands   u = W^+ [weight] + s_1 W^+ [roll, pitch] + s_2 W^+ [yaw] + s_3 W^+ [F], each s in [0, 1], one after the
               other, the largest within limits

A multirotor with parallel rotors thrusts weight + F along its own z axis and turns that axis there (Lee, Leok and
McClamroch, Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010). A boat with surge and yaw only steers a
point at l ahead of its origin: surge makes that point's velocity forward, and the yaw rate (v_c,y - v_r,y) / l its
velocity to port.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.jit import kernel, part
from mjsheaf.simulation.arena import Arena
from mjsheaf.simulation.forces import add, cross, drag_force, product, subtract, to_body, to_world, triple, upward
from mjsheaf.vehicles.vehicle import Vehicle

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


_SHARE_OF_FALL = 0.5  # a multirotor that points its thrust sinks with at most this much of its weight
_TIPPED = 0.5  # cosine of the tilt beyond which turning back comes before carrying the weight


@part
def drive(kind, thrusters, heading, command, R, quaternion, s, omega, ctrl):
    """Write the commands of a vehicle's thrusters.

    Args:
        kind: see KIND.
        thrusters: its own, shape (s,); see THRUSTER.
        heading: cosine and sine of half the heading to hold, (2).
        command: velocity wanted relative to the medium, world axes, (3), m/s.
        R, quaternion: attitude, body to world, (9) and (4).
        s, omega: measured velocity through the medium and rates, body axes, (3) each, m/s and rad/s.
        ctrl: the commands, shape (s,), written.
    """
    wanted = to_body(R, command)
    weight = upward(R, kind.lift)
    K = kind.gain
    force = drag_force(kind, wanted)
    if kind.planar and R[8] > _TIPPED:
        # A hull that is not quite level also drags along its own z axis, where it has no thrusters: that part of the
        # force is replaced, by water that carries the hull and by thrust, with the same horizontal force.
        upwards = force[2] / R[8]
        force = (force[0] - upwards * R[6], force[1] - upwards * R[7], force[2])
    force = (
        force[0] + K[0] * (wanted[0] - s[0]),
        force[1] + K[1] * (wanted[1] - s[1]),
        force[2] + K[2] * (wanted[2] - s[2]),
    )
    if kind.control == HAND_POINT:
        rate = (wanted[1] - s[1]) / kind.hand
        yaw = (kind.drag[5] + kind.quadratic[5] * abs(rate)) * rate + K[5] * (rate - omega[2])
        force, moment, turn = (force[0], 0.0, 0.0), (0.0, 0.0, yaw), (0.0, 0.0, 0.0)
    else:
        attitude = (heading[0], 0.0, 0.0, heading[1])
        if kind.control == THRUST_VECTOR:
            force, weight, attitude = _point_thrust(kind, heading, R, force, weight)
        turn = _turn_to(kind, attitude, quaternion, omega)
        # Thrust and drag act at the origin. What is left of them accelerates the centre of mass c, and added mass at
        # the origin: without turning the vehicle, the former takes a moment of c times it. (The Munk moment of
        # added mass is left to the attitude hold.)
        net, share = subtract(force, drag_force(kind, s)), kind.balance
        moment = cross(triple(kind.arm), (share[0] * net[0], share[1] * net[1], share[2] * net[2]))
    _allocate(kind, thrusters, R[8], weight, turn, force, moment, ctrl)


@part
def _point_thrust(kind, heading, R, force, weight):
    """Turn a force that is wanted beside the weight into thrust along z, and give the attitude that makes it.

    The force is scaled, never turned, until thrust, tilt and sinking are within what the vehicle may do.

    Returns:
        Force and weight along z, in body axes, which add up to what the present attitude makes of the wanted thrust;
        and the wanted attitude as a quaternion: the shortest turn of z to the thrust, after the turn to the heading.
    """
    lift, slope, most = kind.lift, kind.slope, kind.most_thrust
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


@part
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


@part
def _allocate(kind, thrusters, upright, weight, turn, force, moment, ctrl):
    """Commands for weight, attitude moment, and the force and moment of translation.

    `upright` is the cosine of the tilt.
    """
    carry = cross(triple(kind.arm), weight)
    F, N = add(weight, force), add(carry, add(turn, moment))
    within = True
    for k in range(ctrl.shape[0]):
        u = _command_for(thrusters[k].row, F, N)
        ctrl[k] = u
        within = within and thrusters[k].low <= u <= thrusters[k].high
    if not within:
        if upright < _TIPPED and kind.lift > 0.0:
            # Thrusters asked for a weight that they cannot carry would be at their limits, and none left to turn.
            force, moment = add(force, weight), add(moment, carry)
            weight, carry = (0.0, 0.0, _TIPPED * kind.lift), (0.0, 0.0, 0.0)
            force = subtract(force, weight)
        _allocate_in_ranks(thrusters, weight, carry, turn, force, moment, ctrl)


@kernel
def _allocate_in_ranks(thrusters, weight, carry, turn, force, moment, ctrl):
    """Commands within their limits: the weight, then roll and pitch, then yaw, then as much of translation as fits.

    Yaw comes after roll and pitch: rotors make little of it, and what points up must not wait for it.
    """
    for k in range(ctrl.shape[0]):
        ctrl[k] = _command_for(thrusters[k].row, weight, carry)
    none = (0.0, 0.0, 0.0)
    _add_within(thrusters, none, (turn[0], turn[1], 0.0), ctrl)
    _add_within(thrusters, none, (0.0, 0.0, turn[2]), ctrl)
    _add_within(thrusters, force, moment, ctrl)
    for k in range(ctrl.shape[0]):
        ctrl[k] = _at_most(ctrl[k], thrusters[k].low, thrusters[k].high)


@kernel
def _add_within(thrusters, force, moment, ctrl):
    """Add the commands for a wrench, or the largest share of them that keeps every thruster within its limits."""
    share = 1.0
    for k in range(ctrl.shape[0]):
        du = _command_for(thrusters[k].row, force, moment)
        share = min(share, _room(ctrl[k], du, thrusters[k].low, thrusters[k].high))
    for k in range(ctrl.shape[0]):
        ctrl[k] += share * _command_for(thrusters[k].row, force, moment)


@part
def _command_for(row, force, moment):
    """One row of W^+ [force; moment]."""
    translation = row[0] * force[0] + row[1] * force[1] + row[2] * force[2]
    return translation + row[3] * moment[0] + row[4] * moment[1] + row[5] * moment[2]


@part
def _room(u, du, low, high):
    """The largest share, 0 to 1, of du that keeps u + du within limits."""
    room = 1.0
    if u + du > high and du > 0.0:
        room = max(0.0, (high - u) / du)
    elif u + du < low and du < 0.0:
        room = max(0.0, (low - u) / du)
    return room


@part
def _at_most(u, low, high):
    """A command within its limits, at one if within rounding of it. What is not finite stays, to be seen."""
    slack = 1e-9 * (high - low)
    if u > high - slack:
        return high if u < np.inf else u
    if u < low + slack:
        return low if u > -np.inf else u
    return u
