"""Vehicles in the compiled loop: forces of the medium, and the onboard computer.

Vehicles are records: compiled code passes one pointer, and a vehicle's numbers share cache lines. Numbers that all
vehicles of a kind share are stored once.

A vehicle with attitude R, velocity v and rates omega in a medium that moves at w experiences, with v_r = R^T (v - w),

    drag           -D v_r - Q |v_r| v_r, and the same about the axes                          body axes
    hydrostatics   weight carried at the centre of buoyancy, -K (height above the surface, roll, pitch)
    wind           on the velocity of the air relative to a hull: see `mjsheaf.vehicles.vehicle.Windage`
    added mass     -M_A a - C_A(v_r) v_r  (Kirchhoff; Fossen, Handbook of Marine Craft Hydrodynamics, 2011, ch. 6)

Stiff linear drag (D / M above 10 1/s, for any timestep) that does not counteract added mass is split. The largest
coefficient becomes damping of the free joint, which MuJoCo integrates implicitly, so no small steps are needed. The
joint damps along world axes. The difference to R D R^T, and the part due to the medium's velocity, is applied as a
force.

Added mass cannot be fed back as a force: that diverges if it exceeds the mass. Instead every wrench F on the body,
except those of contacts, is applied as S F with S = M_RB (M_RB + M_A)^-1, and MuJoCo's M_RB a = S F is
(M_RB + M_A) a = F. The medium's acceleration is neglected.

The onboard computer has the parameters of its vehicle and measures attitude, v_r and omega. It has no access to the
medium's velocity. With the commanded velocity v_c relative to the medium, in body axes, and the vehicle's drag law d,
it computes

    force      F = d(v_c) + M k_v (v_c - v_r), so that q' = w + v_c in the limit, with tau = M / (M k_v + D)
    attitude   J (k theta - b omega), theta twice the vector part of the quaternion to the desired attitude (Wie and
               Barba, J. Guidance 8, 1985: for small angles the rotation vector)
    efforts    u = W^+ [weight] + s_1 W^+ [roll, pitch] + s_2 W^+ [yaw] + s_3 W^+ [F], each s in [0, 1], one after the
               other, the largest within limits. For a boat with one-way thrusters, the efforts nearest to the desired
               wrench: see `vehicles.allocation`

The vehicle's steering converts the force, and its actuators convert the efforts to commands.

A lost aircraft falls and comes to rest on the surface of the scene. At a depth d below it, a critically damped spring
acts at its centre of mass:

    force      m (omega^2 d - 2 omega v_z) upwards, never downwards, its spring at most three times the weight; and
               -2 omega m v horizontally
    moment     -2 omega J times the rates, so it keeps the attitude of its fall

with omega = 50 rad/s on ground, where it sinks in by 4 mm, and 10 rad/s on water, where it floats 10 cm deep.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.arrays import Array, IntArray, firsts_of, quaternions_of
from mjsheaf.compile.jit import apart_jit, as_records, inline_jit, jit
from mjsheaf.vectors import add, cross, product, row_product, subtract, to_body, to_world, triple, upward
from mjsheaf.vehicles.actuators import (
    AZIMUTH,
    CHANNEL,
    FIXED,
    at_most,
    room_of_azimuth,
    room_within,
    unit_wrench,
)
from mjsheaf.vehicles.allocation import allocate_nearest
from mjsheaf.vehicles.effects import is_one_sided, turning_of
from mjsheaf.vehicles.steering import drag_force
from mjsheaf.vehicles.vehicle import GRAVITY, Vehicle, kinds_of

# Body axes, about the origin of the body frame.
KIND = np.dtype(
    [
        ("thruster", "i8"),  # the first of its channels among those of all kinds
        ("count", "i8"),  # number of channels
        ("turning", "i8"),  # 1 if some of them turn
        # forces of the medium
        ("planar", "i8"),
        ("drag", "f8", 6),  # of v, N s/m and N m s/rad
        ("quadratic", "f8", 6),  # of |v| v
        ("implicit", "f8"),  # linear damping that the joint takes, N s/m
        ("explicit", "f8"),  # fraction of the angular damping that it does not take
        ("ballast", "f8"),  # N
        ("buoyancy", "f8"),  # N
        ("com", "f8", 3),  # centre of mass, at which the weight acts, m
        ("ballast_point", "f8", 3),  # point at which the ballast acts, m
        ("centre", "f8", 3),  # centre of buoyancy, m
        ("restoring", "f8", 3),  # heave, roll, pitch, N/m and N m/rad
        # its autopilot
        ("steering", "i8"),  # its code
        ("gain", "f8", 6),  # M k_v, N s/m and N m s/rad
        ("inertia", "f8", (3, 3)),  # that a couple must overcome, kg m^2
        ("rigid_mass_fraction", "f8", 3),  # fraction of a force along each axis that accelerates the body itself
        ("stiffness", "f8"),  # of the attitude hold, 1/s^2
        ("rate_damping", "f8"),  # 1/s
        ("supported_weight", "f8"),  # weight that thrusters carry, N
        ("hand", "f8"),  # distance of the controlled point ahead, m
        ("tan_max_tilt", "f8"),  # tangent of the largest tilt
        ("most_thrust", "f8"),  # N
        # added mass, which few have: last, so that the others stay in fewer cache lines
        ("added", "i8"),  # 1 if it has any
        ("added_mass", "f8", 6),  # kg and kg m^2
        ("rigid_wrench_map", "f8", (6, 6)),  # M_RB (M_RB + M_A)^-1
        ("mass", "f8"),  # of the model, kg
        ("weight", "f8"),  # of the model, N
        ("rigid", "f8", (3, 3)),  # inertia of the model, kg m^2
        ("rest", "f8"),  # omega of the surface under it once it is lost, rad/s; 0 if there is no such surface
        # thrusters that do not push both ways
        ("one_sided", "i8"),  # 1 if it has any: see `vehicles.allocation`
        ("row_norm", "f8", 3),  # norms of the rows surge, sway and yaw of W; 0 for one that is not commanded
        ("forward_only", "i8"),  # 1 if it is steered at its hand point and cannot reverse
        ("turning_price", "f8"),  # surge force for each unit of yaw moment, 1/m
        ("turning_speed", "f8"),  # desired speed above which it turns round, m/s
        ("in_flow", "i8"),  # 1 if the force of some of its actuators depends on velocity: see `flow_wrench`
        ("windage", "f8", 4),  # see `vehicles.vehicle.Windage.pack`; its height is 0 if no wind acts
    ],
    align=True,
)
BODY = np.dtype(
    [
        ("kind", "i8"),  # number of its kind
        ("qpos", "i8"),  # addresses of its free joint in qpos and qvel
        ("dof", "i8"),
        ("actuator", "i8"),  # the first of its actuators
        ("state", "i8"),  # the first of its activations
        ("heading", "f8", 2),  # cosine and sine of half the heading to hold
    ],
    align=True,
)


BLOCK = 16
"""Largest number of vehicles that move together, so that their numbers stay in the cache for several steps."""

MIN_ALIKE = 3
"""Number of neighbours of one kind from which they form a block of their own, as they may move faster in lanes."""

_WORTH_LANES = 8  # vehicles in such blocks, below which code for lanes would take longer to compile than it saves

_REST = {"none": 0.0, "ground": 50.0, "water": 10.0}  # rad/s
_REST_IN_A_STEP = 0.25  # rad: a faster surface would not be stable as an applied force
_AIRCRAFT = 0.5  # fraction of its weight that thrusters must carry for an aircraft; water carries a submersible's
_SPRING_OVER_WEIGHT = 3.0  # limit, so that a vehicle lost far below the surface rises and is not thrown out


class Fleet(NamedTuple):
    """All vehicles, for compiled code.

    Attributes:
        kinds: a KIND for each kind.
        bodies: a BODY for each vehicle, shape (V,).
        thrusters: CHANNELs of each kind in turn.
        blocks: First vehicle of each block of vehicles that move together, and V, shape (B + 1,).
        lanes: () if all vehicles move alone: its type makes numba compile no code for lanes.
    """

    kinds: NDArray[np.void]
    bodies: NDArray[np.void]
    thrusters: NDArray[np.void]
    blocks: IntArray
    lanes: tuple[int, ...]

    @property
    def channels(self) -> NDArray[np.void]:
        """CHANNELs of all vehicles in turn, shape (A,)."""
        kinds = self.kinds[self.bodies["kind"]]
        count = kinds["count"]
        before = firsts_of(count)  # channels of the vehicles before each one
        return self.thrusters[np.arange(count.sum()) - np.repeat(before - kinds["thruster"], count)]


def pack_fleet(
    vehicles: Sequence[Vehicle], heading: Array, timestep: float, surface: str = "none", *, in_lanes: bool = False
) -> Fleet:
    """Pack vehicles in order, each on its own free joint.

    Args:
        vehicles: Models of the vehicles.
        heading: Heading that each keeps, shape (V,), rad.
        timestep: Physics step, s.
        surface: Surface of the scene, on which lost aircraft come to rest.
        in_lanes: True if enough neighbours of one kind may move in lanes.
    """
    types, number = kinds_of(vehicles)
    kinds = np.zeros(len(types), KIND)
    kinds["count"] = [len(vehicle.channels) for vehicle in types]
    kinds["thruster"] = firsts_of(kinds["count"])
    thrusters, states = np.zeros(kinds["count"].sum(), CHANNEL), np.zeros(len(types), dtype=np.int64)
    for k, (kind, vehicle) in enumerate(zip(kinds, types, strict=True)):
        _pack(vehicle, kind)
        if vehicle.description.hydrostatics is None and vehicle.weight > _AIRCRAFT * vehicle.mass * GRAVITY:
            kind["rest"] = min(_REST[surface], _REST_IN_A_STEP / timestep)
        channels = thrusters[kind["thruster"] : kind["thruster"] + kind["count"]]
        channels["direction"], channels["moment"] = vehicle.gears[:, :3], vehicle.gears[:, 3:]
        channels["row"] = vehicle.allocation
        channels["low"], channels["high"] = vehicle.limits.T
        W, norms = vehicle.W[_PLANAR], kind["row_norm"][:, None]
        channels["planar"] = np.divide(W, norms, out=np.zeros_like(W), where=norms > 0.0).T
        for actuator, own in zip(vehicle.actuators, vehicle.by_actuator(channels), strict=True):
            actuator.pack(own, timestep, vehicle.mass * GRAVITY)
        channels["state"] = firsts_of(channels["late"])
        kind["turning"] = (channels["code"] != FIXED).any()
        kind["in_flow"] = channels["flow"].any()
        states[k] = channels["late"].sum()
    bodies, v = np.zeros(len(vehicles), BODY), np.arange(len(vehicles))
    bodies["kind"], bodies["qpos"], bodies["dof"] = number, 7 * v, 6 * v
    for name, each in (("actuator", kinds["count"][number]), ("state", states[number])):
        bodies[name] = firsts_of(each)
    bodies["heading"] = quaternions_of(heading)[:, [0, 3]]
    blocks = split_into_blocks(number)
    sizes = np.diff(blocks)
    alike = sizes[(number[blocks[:-1]] == number[blocks[1:] - 1]) & (sizes >= MIN_ALIKE)].sum()
    lanes = (BLOCK,) if in_lanes and alike >= _WORTH_LANES else ()
    return Fleet(as_records(kinds), as_records(bodies), as_records(thrusters), blocks, lanes)


def split_into_blocks(kind: IntArray) -> IntArray:
    """Split vehicles into blocks of neighbours, of one kind where at least MIN_ALIKE lie side by side.

    Args:
        kind: Number of the kind of each vehicle, shape (V,).

    Returns:
        First vehicle of each block, and V, shape (B + 1,). A block has at most BLOCK vehicles.
    """
    changes = np.flatnonzero(np.diff(kind, prepend=-1))
    blocks = [0]
    alike = True  # the last block is of one kind and takes no others
    for first, last in pairwise([*changes, len(kind)]):
        for begin in range(first, last, BLOCK):
            end = min(begin + BLOCK, last)
            several = end - begin >= MIN_ALIKE
            if several or alike or end - blocks[-1] > BLOCK:
                blocks.append(begin)
            alike = several
    return np.array([*blocks[1:], len(kind)], dtype=np.int64)


def _pack(vehicle: Vehicle, kind: np.void) -> None:
    """Pack what vehicles of a kind have in common, but for their thrusters."""
    floats, hold, damping = vehicle.description.hydrostatics, vehicle.hold, vehicle.joint_damping
    added = bool(vehicle.added_mass.any())
    kind["planar"] = vehicle.dimension == 2
    kind["drag"], kind["quadratic"] = [*vehicle.drag, *vehicle.angular_drag], vehicle.quadratic_drag
    kind["implicit"], kind["explicit"] = damping[0], not damping.any()
    kind["ballast"] = vehicle.ballast
    kind["com"] = kind["ballast_point"] = kind["centre"] = vehicle.centre_of_mass
    if floats is None:
        kind["supported_weight"] = vehicle.weight
        if vehicle.ballast > 0.0:
            # Ballast has no rotational inertia, so with the lag of rotors it could topple the vehicle. It is therefore
            # placed such that its weight and the model's together act in the plane of the origin.
            kind["ballast_point"][2] *= 1.0 - vehicle.weight / vehicle.ballast
            kind["com"][2] = 0.0
    else:
        kind["buoyancy"], kind["restoring"] = vehicle.weight, [floats.heave, floats.roll, floats.pitch]
        if floats.centre is not None:
            kind["centre"][:2] = floats.centre
    kind["added"], kind["added_mass"], kind["rigid_wrench_map"] = added, vehicle.added_mass, vehicle.rigid_wrench_map
    kind["mass"], kind["weight"], kind["rigid"] = vehicle.mass, vehicle.weight - vehicle.ballast, vehicle.inertia
    kind["windage"] = vehicle.windage
    kind["gain"] = vehicle.moving_mass * vehicle.rate
    kind["inertia"] = vehicle.turning_inertia
    kind["rigid_mass_fraction"] = vehicle.mass / (vehicle.mass + vehicle.added_mass[:3])
    kind["stiffness"], kind["rate_damping"] = hold.frequency**2, 2.0 * hold.damping * hold.frequency
    vehicle.steering.pack(vehicle, kind)
    kind["one_sided"] = is_one_sided(vehicle)
    rows = [row for row in vehicle.controlled_rows if row in _PLANAR]
    norms = np.linalg.norm(vehicle.W[rows], axis=1)
    norms[norms < _FAINT_ROW * norms.max(initial=0.0)] = 0.0
    kind["row_norm"][[_PLANAR.index(row) for row in rows]] = norms
    if turning := turning_of(vehicle):
        kind["forward_only"], kind["turning_price"], kind["turning_speed"] = True, *turning


@inline_jit
def add_buoyancy(kind, height, normal, R, force, moment):
    """Add buoyancy and restoring moment of a hull.

    Args:
        kind: Parameters of the vehicle's kind; see KIND.
        height: Height of the origin above the surface, m.
        normal: Components of the surface's normal along the body's x and y axes.
        R: Attitude, (9,).
        force, moment: Wrench without buoyancy, body axes, (3,) each, N and N m.

    A moment K (b_z x n) rights the hull; its height and its tilt to the surface's normal n are small.
    """
    force = add(force, upward(R, kind.buoyancy - kind.restoring[0] * height))
    moment = add(moment, cross(triple(kind.centre), upward(R, kind.buoyancy)))
    moment = moment[0] - kind.restoring[1] * normal[1], moment[1] + kind.restoring[2] * normal[0], moment[2]
    return force, moment


@inline_jit
def add_ballast(kind, R, force, moment):
    """Add the weight of ballast; arguments as `add_buoyancy`."""
    weight = upward(R, -kind.ballast)
    return add(force, weight), add(moment, cross(triple(kind.ballast_point), weight))


@inline_jit
def drag_wrench(kind, s, omega):
    """Return force and moment of drag at a velocity through the medium and rates, all in body axes, (3,) each."""
    D, Q, k = kind.drag, kind.quadratic, kind.explicit
    force = drag_force(kind, s)
    moment = (
        -(k * D[3] + Q[3] * abs(omega[0])) * omega[0],
        -(k * D[4] + Q[4] * abs(omega[1])) * omega[1],
        -(k * D[5] + Q[5] * abs(omega[2])) * omega[2],
    )
    return (-force[0], -force[1], -force[2]), moment


@inline_jit
def wind_wrench(kind, a):
    """Return force and moment of air that moves at a (3,), m/s, relative to a hull, body axes, (3,) each."""
    x, y, n, height = kind.windage[0], kind.windage[1], kind.windage[2], kind.windage[3]
    speed = np.sqrt(a[0] * a[0] + a[1] * a[1])
    ahead, aside = x * speed * a[0], y * speed * a[1]
    return (ahead, aside, 0.0), (-height * aside, height * ahead, n * a[0] * a[1])


@inline_jit
def rest_on_surface(kind, depth, R, velocity, omega):
    """Return force and moment of the surface on a lost aircraft `depth` m below it, body axes, (3,) each.

    velocity (3,) is over ground in world axes, m/s; omega the rates in body axes, (3,).
    """
    rest, m = kind.rest, kind.mass
    spring = min(m * rest * rest * depth, _SPRING_OVER_WEIGHT * kind.supported_weight)
    damping = 2.0 * rest * m
    up = max(spring - damping * velocity[2], 0.0)
    force = to_body(R, (-damping * velocity[0], -damping * velocity[1], up))
    turning = product(kind.inertia, omega)
    brake = -2.0 * rest * turning[0], -2.0 * rest * turning[1], -2.0 * rest * turning[2]
    return force, add(cross(triple(kind.com), force), brake)


@inline_jit
def apply_wrench(kind, qvel, R, force, moment, applied):
    """Write force and moment, without the joint's damping, to a body's qfrc_applied, shape (6,), ordered as qvel."""
    force = to_world(R, force)
    for i in range(3):
        applied[i] = force[i] + kind.implicit * qvel[i]
        applied[3 + i] = moment[i]


@inline_jit
def share_with_medium(kind, R, s, omega, force, moment):
    """Return the wrench that moves MuJoCo's body as the given wrench moves a body with added mass, body axes.

    MuJoCo solves M_RB a + h = Q + G, where h is the rigid body's centrifugal wrench and G its weight. The desired
    motion is (M_RB + M_A) a + h = F + G + C with C = M_A [omega x v_r; 0] - C_A(v_r) v_r, because a refers to axes that
    do not rotate. Hence Q = S (F + G - h + C) + h - G.
    """
    m, c, A = kind.mass, triple(kind.com), kind.added_mass
    weight = upward(R, -kind.weight)
    outward = cross(omega, cross(omega, c))
    own_force = weight[0] - m * outward[0], weight[1] - m * outward[1], weight[2] - m * outward[2]
    own_moment = subtract(cross(c, weight), cross(omega, product(kind.rigid, omega)))  # G - h
    P = A[0] * s[0], A[1] * s[1], A[2] * s[2]  # momentum of the medium
    L = A[3] * omega[0], A[4] * omega[1], A[5] * omega[2]
    turn = cross(omega, s)
    coupling = subtract((A[0] * turn[0], A[1] * turn[1], A[2] * turn[2]), cross(omega, P))
    munk = add(cross(s, P), cross(omega, L))
    f = add(add(force, own_force), coupling)
    n = subtract(add(moment, own_moment), munk)
    S = kind.rigid_wrench_map
    shared_force = row_product(S[0], f, n), row_product(S[1], f, n), row_product(S[2], f, n)
    shared_moment = row_product(S[3], f, n), row_product(S[4], f, n), row_product(S[5], f, n)
    return subtract(shared_force, own_force), subtract(shared_moment, own_moment)


_PLANAR = [0, 1, 5]  # rows of the wrench: surge, sway, yaw
_FAINT_ROW = 1e-9  # of the largest norm, below which a row is rounding
_TIPPED = 0.5  # cosine of the tilt beyond which turning back comes before carrying the weight


@inline_jit
def desired_force(kind, R, s, desired):
    """Return the force for a desired velocity through the medium, body axes, (3,), N.

    Args:
        kind: Parameters of the vehicle's kind; see KIND.
        R: Attitude, (9,).
        s: Measured velocity through the medium, body axes, (3,), m/s.
        desired: Desired velocity through the medium, body axes, (3,), m/s.
    """
    K = kind.gain
    x, y, z = drag_force(kind, desired)
    if kind.planar:
        # A hull that is not quite level also drags along its own z axis, where it has no thrusters. Water that carries
        # the hull, and thrust, replace that part with the same horizontal force, unless it has tipped over.
        upwards, level = z / R[8], R[8] > _TIPPED
        ahead, aside = x - upwards * R[6], y - upwards * R[7]
        x, y = ahead if level else x, aside if level else y  # selections, no branch: also for lanes
    return x + K[0] * (desired[0] - s[0]), y + K[1] * (desired[1] - s[1]), z + K[2] * (desired[2] - s[2])


@inline_jit
def turn_gears(kind, thrusters, R, act, gear):
    """Write gears on the free joint, shape (s, 6): forces, in world axes, and the moments of what turns."""
    for k in range(kind.count):
        row = gear[k]
        row[0], row[1], row[2] = to_world(R, triple(thrusters[k].direction))
    if kind.turning:
        for k in range(kind.count):
            if thrusters[k].code != FIXED:
                row, (direction, moment) = gear[k], unit_wrench(thrusters, k, act)
                row[0], row[1], row[2] = to_world(R, direction)
                row[3], row[4], row[5] = moment


@apart_jit
def allocate_within_limits(kind, thrusters, upright, weight, turn, force, moment, effort):
    """Write efforts within their limits: weight, then roll and pitch, then yaw, then translation as far as possible.

    Yaw comes after roll and pitch, because rotors produce little of it, and thrust must point upwards first. Boats with
    one-sided thrusters have a separate allocation: see `vehicles.allocation`.
    """
    carry = cross(triple(kind.com), weight)
    if kind.one_sided:
        yaw = carry[2] + (turn[2] + moment[2])
        allocate_nearest(thrusters, triple(kind.row_norm), add(weight, force), yaw, effort)
        return
    none = (0.0, 0.0, 0.0)
    if upright < _TIPPED and kind.supported_weight > 0.0:
        # The part of its weight that an aircraft cannot carry while tipped over is a force of translation: thrusters
        # that had to carry it would saturate, and no thrust would remain to turn.
        carried = (0.0, 0.0, _TIPPED * kind.supported_weight)
        force, moment = subtract(add(force, weight), carried), add(moment, carry)
        weight, carry = carried, none
    for k in range(effort.shape[0]):
        effort[k] = row_product(thrusters[k].row, weight, carry)
    _add_within(thrusters, none, (turn[0], turn[1], 0.0), effort)
    _add_within(thrusters, none, (0.0, 0.0, turn[2]), effort)
    _add_within(thrusters, force, moment, effort)
    for k in range(effort.shape[0]):
        if thrusters[k].code == FIXED:
            effort[k] = at_most(effort[k], thrusters[k].low, thrusters[k].high)


@jit
def _add_within(thrusters, force, moment, effort):
    """Add the efforts for a wrench, or the largest fraction of them that keeps every actuator within its limits."""
    share = 1.0
    for k in range(effort.shape[0]):
        channel = thrusters[k]
        du = row_product(channel.row, force, moment)
        if channel.code == FIXED:
            share = min(share, room_within(effort[k], du, channel.low, channel.high))
        elif channel.code == AZIMUTH:
            angle = thrusters[k + 1]
            dv = row_product(angle.row, force, moment)
            share = min(share, room_of_azimuth(channel, angle, effort[k], du, effort[k + 1], dv))
    for k in range(effort.shape[0]):
        effort[k] += share * row_product(thrusters[k].row, force, moment)
