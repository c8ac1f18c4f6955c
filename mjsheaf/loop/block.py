"""The step of vehicles, written once for neighbours of one kind side by side and for a vehicle alone.

Only a steady medium is read in two ways: `_read_steady` takes one kernel for all lanes, `media.flow` all kernels for a
point.

A block is a record of the numbers of its vehicles, with one lane a vehicle. Functions here are of one lane, or loop
over the lanes in use; they are compiled for blocks of LANES lanes and for blocks of one. The fused engine moves
neighbours of one kind in the former, and all other vehicles one after the other in the latter, as MuJoCo's loop does.
Lanes do not mix, so that a vehicle's bits are the same in both.

Most loops over lanes are straight arithmetic, without calls and branches, and LLVM makes vector instructions of them.
Rare cases are handled afterwards, lane by lane: efforts beyond their limits, large turns in a step. Vehicles that
turn their thrusters, have rudders, are lost, or are commanded from outside are always alone.

A rigid body on a free joint takes the step that MuJoCo takes: see `fused`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjsheaf.compile.jit import as_records, inline_jit, lanes_for, on_stack
from mjsheaf.loop.bodies import (
    BLOCK,
    MIN_ALIKE,
    add_ballast,
    add_buoyancy,
    allocate_within_limits,
    desired_force,
    drag_wrench,
    rest_on_surface,
    share_with_medium,
    wind_wrench,
)
from mjsheaf.loop.loop import AUTOPILOT, HUGE, OUTSIDE, STOPPED, record
from mjsheaf.media.flow import SOURCE, VORTEX, channel_velocity, offset_from, source_velocity, vortex_velocity
from mjsheaf.media.medium import add_winds, advance, has_wind, medium_velocity, surface_about, upright_in
from mjsheaf.media.varying import sine
from mjsheaf.vectors import (
    add,
    cross,
    product,
    rotation,
    row_product,
    subtract,
    to_body,
    to_world,
    triple,
    upward,
)
from mjsheaf.vehicles.actuators import ANGLE, actuator_force, aim, flow_wrench, unit_wrench
from mjsheaf.vehicles.steering import (
    HAND_POINT,
    THRUST_VECTOR,
    is_within_thrust,
    share_within_thrust,
    steer_attitude,
    steer_hand_point,
)
from mjsheaf.vehicles.vehicle import Vehicle

# How a kind moves; body axes, about the origin of the body frame.
RIGID = np.dtype(
    [
        ("inverse", "f8", (6, 6)),  # of the matrix in `fused`
        ("inertia", "f8", (3, 3)),  # J, kg m^2
        ("damping", "f8", 3),  # D, N m s/rad
        ("weight", "f8"),  # N
        ("weight_moment", "f8", 3),  # of the weight, upright, N m
        ("mass_moment", "f8", 3),  # m c, kg m
    ],
    align=True,
)

SMALL = 0.01
"""Square of half a turn, rad^2, up to which its sine and cosine are short series."""

NEARLY_UNIT = 1e-8
"""Distance from 1 of a quaternion's square up to which one step of Newton's method makes it 1."""


def pack_rigid(vehicles: Sequence[Vehicle], timestep: float) -> NDArray[np.void]:
    """Return a RIGID for each kind of vehicle, for steps of `timestep`, s."""
    rigid = np.zeros(len(vehicles), RIGID)
    for one, vehicle in zip(rigid, vehicles, strict=True):
        taken = vehicle.joint_damping
        one["inverse"] = np.linalg.inv(vehicle.rigid_mass + timestep * np.diag(taken))
        one["inertia"], one["damping"] = vehicle.inertia, taken[3:]
        one["weight"], one["weight_moment"] = vehicle.weight - vehicle.ballast, vehicle.weight_moment
        one["mass_moment"] = vehicle.mass * vehicle.centre_of_mass
    return as_records(rigid)


@inline_jit
def accelerations(one, R, omega, force, moment):
    """Return the linear acceleration in world axes and the angular one in body axes, (3,) each."""
    up, lever = upward(R, 1.0), triple(one.mass_moment)
    force = subtract(force, upward(R, one.weight))
    force = subtract(force, cross(omega, cross(omega, lever)))
    moment = subtract(moment, cross(triple(one.weight_moment), up))
    moment = subtract(moment, cross(omega, product(one.inertia, omega)))
    D, inverse = one.damping, one.inverse
    moment = moment[0] - D[0] * omega[0], moment[1] - D[1] * omega[1], moment[2] - D[2] * omega[2]
    x = row_product(inverse[0], force, moment)
    y = row_product(inverse[1], force, moment)
    z = row_product(inverse[2], force, moment)
    along = to_world(R, (x, y, z))
    about = (
        row_product(inverse[3], force, moment),
        row_product(inverse[4], force, moment),
        row_product(inverse[5], force, moment),
    )
    return along, about


@inline_jit
def at(field, i):
    """Return a vector in lane i of a field of a block."""
    return field[0, i], field[1, i], field[2, i]


@inline_jit
def put(field, i, a):
    """Write a vector to lane i of a field of a block."""
    field[0, i] = a[0]
    field[1, i] = a[1]
    field[2, i] = a[2]


@inline_jit
def attitude(b, i):
    """Return the rotation of the vehicle in lane i of a block, body to world, after `_sense`."""
    R = b.attitude
    return R[0, i], R[1, i], R[2, i], R[3, i], R[4, i], R[5, i], R[6, i], R[7, i], R[8, i]


@inline_jit
def _rotation(b, i):
    q = b.quaternion
    return rotation(q[0, i], q[1, i], q[2, i], q[3, i])


@inline_jit
def move(one, h, b, i):
    """Take MuJoCo's step in a lane of a block, except for the turn, and write whether its state is good.

    Args:
        one: RIGID of the vehicle; the force and moment in the block are in addition to its weight.
        h: Timestep, s.
        b, i: Block and lane of the vehicle; see `block`.
    """
    along, about = accelerations(one, attitude(b, i), at(b.rates, i), at(b.force, i), at(b.moment, i))
    sound = True
    for j in range(3):
        b.velocity[j, i] += h * along[j]
        b.rates[j, i] += h * about[j]
        b.position[j, i] += h * b.velocity[j, i]
        sound &= (abs(along[j]) < HUGE) & (abs(about[j]) < HUGE) & (abs(b.position[j, i]) < HUGE)
        sound &= (abs(b.velocity[j, i]) < HUGE) & (abs(b.rates[j, i]) < HUGE)
    b.sound[i] = 1.0 if sound else 0.0


@inline_jit
def turn(h, lanes, b):
    """Normalise the quaternions in the lanes of a block, and turn them by the rates over a step of h, s."""
    large = 0
    for i in range(lanes):
        x, y, z = _half_turn(h, b, i)
        square, norm = x * x + y * y + z * z, _square_norm(b, i)
        b.parts[0, i], b.parts[1, i] = series(square)
        b.size[i] = 1.5 - 0.5 * norm
        large += 0 if (square < SMALL) & (abs(norm - 1.0) < NEARLY_UNIT) else 1
    if large > 0:
        for i in range(lanes):
            x, y, z = _half_turn(h, b, i)
            square, norm = x * x + y * y + z * z, _square_norm(b, i)
            if not square < SMALL:
                half = np.sqrt(square)
                b.parts[0, i] = np.cos(half)
                b.parts[1, i] = np.sin(half) / half
            if not abs(norm - 1.0) < NEARLY_UNIT:
                b.size[i] = 1.0 / np.sqrt(norm)
    for i in range(lanes):
        (x, y, z), s, q = _half_turn(h, b, i), b.parts[1, i], b.quaternion
        after = turned((q[0, i], q[1, i], q[2, i], q[3, i]), b.size[i], b.parts[0, i], (s * x, s * y, s * z))
        for j in range(4):
            q[j, i] = after[j]


@inline_jit
def _half_turn(h, b, i):
    return 0.5 * h * b.rates[0, i], 0.5 * h * b.rates[1, i], 0.5 * h * b.rates[2, i]


@inline_jit
def _square_norm(b, i):
    q = b.quaternion
    return q[0, i] * q[0, i] + q[1, i] * q[1, i] + q[2, i] * q[2, i] + q[3, i] * q[3, i]


@inline_jit
def series(square):
    """Return the cosine of an angle and its sine over the angle, from the square of the angle, rad^2, below SMALL."""
    c = 1.0 + square * (-1.0 / 2.0 + square * (1.0 / 24.0 + square * (-1.0 / 720.0 + square / 40320.0)))
    s = 1.0 + square * (-1.0 / 6.0 + square * (1.0 / 120.0 + square * (-1.0 / 5040.0 + square / 362880.0)))
    return c, s


@inline_jit
def turned(q, size, c, v):
    """Return the quaternion q (4,) times a size, times the unit quaternion with parts c and v (3,)."""
    a, b, e, f = size * q[0], size * q[1], size * q[2], size * q[3]
    x, y, z = v
    return (
        a * c - b * x - e * y - f * z,
        a * x + b * c + e * z - f * y,
        a * y - b * z + e * c + f * x,
        a * z + b * y - e * x + f * c,
    )


LANES = BLOCK
"""Lanes of a block of neighbours: four registers of AVX2, so that a processor always has independent work."""

_CHANNELS = 8  # largest number of actuators of a vehicle in lanes
_HARMONICS = 8  # largest number of harmonics of a disturbance in lanes

# Vectors are in body axes unless they say otherwise.
_VECTORS = {
    "position": 3,  # of the origin, world axes, m
    "quaternion": 4,
    "attitude": 9,  # the same as a rotation, body to world, row by row
    "velocity": 3,  # of the origin, world axes, m/s
    "rates": 3,  # rad/s
    "command": 3,  # desired velocity through the medium, world axes, m/s
    "heading": 2,  # cosine and sine of half the desired heading
    "medium": 3,  # its velocity, world axes, m/s
    "normal": 2,  # of the surface, along x and y
    "through": 3,  # velocity through the medium, m/s
    "force": 3,  # on the body, N
    "moment": 3,  # N m
    "push": 3,  # force for the desired velocity, in world axes where thrust is pointed
    "couple": 3,  # moment that goes with it
    "weight": 3,  # force that carries the vehicle
    "turn": 3,  # moment that turns it to its attitude
    "total_force": 3,  # that actuators are to make
    "total_moment": 3,
    "shake": 3,  # velocity of the disturbance, world axes, m/s
    "parts": 2,  # of the unit quaternion of a turn: cosine, sine over the angle
}
_SCALARS = (
    "height",  # of the origin above the surface, m
    "share",  # fraction of the push that is within the limits of thrust
    "within",  # 1 if all efforts are within their limits
    "good",  # 1 if the commands are good
    "sound",  # 1 if the state is good
    "size",  # factor that normalises the quaternion
)


def _block(lanes: int) -> np.dtype[np.void]:
    shapes = {name: (size, lanes) for name, size in _VECTORS.items()} | dict.fromkeys(_SCALARS, (lanes,))
    return np.dtype([(name, "f8", shape) for name, shape in shapes.items()], align=True)


ALONE = _block(1)
"""Type of a block for one vehicle, for `on_stack`."""

_WIDE = _block(LANES)

# Rows with a variable index are separate arrays: LLVM could not prove that they do not overlap fields of the block.
_ROWS = np.dtype([("row", "f8", (_CHANNELS, LANES))])
_WAVES = np.dtype(
    [
        ("rate", "f8", (_HARMONICS, LANES)),  # of the disturbance's harmonics, turns/s
        ("phase", "f8", (_HARMONICS, LANES)),  # turns
        ("amplitude", "f8", (_HARMONICS, 3, LANES)),  # world axes, m/s
        ("sine", "f8", LANES),  # of one harmonic
    ]
)


@inline_jit
def fits_lanes(fleet, helm, first, last):
    """Return True if the vehicles of a block, from first up to last, can be moved in lanes; see `loop.Params`."""
    kind = fleet.kinds[fleet.bodies[first].kind]
    fits = (last - first >= MIN_ALIKE) & (last - first <= LANES)
    fits &= (kind.turning == 0) & (kind.in_flow == 0) & (kind.count <= _CHANNELS)
    for v in range(first, last):
        fits &= (helm[v] == AUTOPILOT) & (fleet.bodies[v].kind == fleet.bodies[first].kind)
    return fits


@inline_jit
def _gather(body, qpos, qvel, command, b, i):
    """Read the state of a vehicle and its command (3,)."""
    a, d = body.qpos, body.dof
    for j in range(3):
        b.position[j, i] = qpos[a + j]
        b.velocity[j, i] = qvel[d + j]
        b.rates[j, i] = qvel[d + 3 + j]
        b.command[j, i] = command[j]
    for j in range(4):
        b.quaternion[j, i] = qpos[a + 3 + j]
    b.heading[0, i] = body.heading[0]
    b.heading[1, i] = body.heading[1]


@inline_jit
def _scatter(body, b, i, qpos, qvel):
    """Write the state of a vehicle."""
    for j in range(3):
        qpos[body.qpos + j] = b.position[j, i]
        qvel[body.dof + j] = b.velocity[j, i]
        qvel[body.dof + 3 + j] = b.rates[j, i]
    for j in range(4):
        qpos[body.qpos + 3 + j] = b.quaternion[j, i]


@inline_jit
def _place(b, i, planar):
    """Return the point at which a vehicle meets the medium, m; a planar vehicle's has height 0."""
    return b.position[0, i], b.position[1, i], 0.0 if planar else b.position[2, i]


@inline_jit
def _read_medium(medium, state, v, b, i):
    """Write the velocity of the medium at vehicle v, and height and normal of the surface."""
    x, y, z = _place(b, i, medium.planar[v])
    surface = surface_about(medium, state, v, x, y)
    w = medium_velocity(medium, state, v, x, y, z)
    rise = surface[3] if medium.planar[v] else 0.0
    put(b.medium, i, (w[0], w[1], w[2] + rise))
    b.height[i] = b.position[2, i] - surface[0]
    b.normal[0, i], b.normal[1, i] = upright_in(medium.parts, surface, _rotation(b, i))


@inline_jit
def _sense(kind, b, i):
    """Write attitude, velocity through the medium, wrench of drag, and force for the desired velocity."""
    R = _rotation(b, i)
    for j in range(9):
        b.attitude[j, i] = R[j]
    s = to_body(R, subtract(at(b.velocity, i), at(b.medium, i)))
    force, moment = drag_wrench(kind, s, at(b.rates, i))
    push = desired_force(kind, R, s, to_body(R, at(b.command, i)))
    if kind.steering == THRUST_VECTOR:
        push = to_world(R, push)
    put(b.through, i, s)
    put(b.force, i, force)
    put(b.moment, i, moment)
    put(b.push, i, push)


@inline_jit
def _want(kind, b, i, weight, turning, push, couple):
    """Write wrenches for the actuators, and their sum."""
    force, moment = add(weight, push), add(cross(triple(kind.com), weight), add(turning, couple))
    put(b.weight, i, weight)
    put(b.turn, i, turning)
    put(b.push, i, push)
    put(b.couple, i, couple)
    put(b.total_force, i, force)
    put(b.total_moment, i, moment)


@inline_jit
def _command(fleet, ctrl, first, last, lanes, b, effort):
    """Write the efforts for the desired velocities, within limits, of the vehicles from first up to last.

    Args:
        fleet: The vehicles.
        ctrl: Commands of all actuators, which serve as working memory.
        first, last: Range of vehicles.
        lanes: Number of lanes in use.
        b: Block of the vehicles, after `_sense`.
        effort: Efforts, shape (s, lanes), written.
    """
    kind = fleet.kinds[fleet.bodies[first].kind]
    thrusters = fleet.thrusters[kind.thruster : kind.thruster + kind.count]
    beyond = 0
    if kind.steering == THRUST_VECTOR:
        for i in range(lanes):
            b.share[i] = 1.0
            beyond += 0 if is_within_thrust(kind, at(b.push, i)) else 1
        if beyond > 0:  # rare
            for i in range(lanes):
                b.share[i] = share_within_thrust(kind, at(b.push, i))
    if kind.steering == HAND_POINT:
        for i in range(lanes):
            R, s = attitude(b, i), at(b.through, i)
            surge, yaw = steer_hand_point(kind, s, at(b.rates, i), to_body(R, at(b.command, i)), b.push[0, i])
            _want(kind, b, i, upward(R, kind.supported_weight), (0.0, 0.0, 0.0), (surge, 0.0, 0.0), (0.0, 0.0, yaw))
    else:
        for i in range(lanes):
            q, R, heading = b.quaternion, attitude(b, i), (b.heading[0, i], b.heading[1, i])
            quaternion, s, omega = (q[0, i], q[1, i], q[2, i], q[3, i]), at(b.through, i), at(b.rates, i)
            weight, turning, push, couple = steer_attitude(
                kind, heading, R, quaternion, s, omega, at(b.push, i), b.share[i], upward(R, kind.supported_weight)
            )
            _want(kind, b, i, weight, turning, push, couple)
    for i in range(lanes):
        b.within[i] = 0.0 if kind.turning else 1.0  # turning thrusters limit thrust and angle, not each effort
    beyond = kind.turning
    for j in range(kind.count):
        channel = thrusters[j]
        for i in range(lanes):
            u = row_product(channel.row, at(b.total_force, i), at(b.total_moment, i))
            effort[j, i] = u
            within = (channel.low <= u) & (u <= channel.high)
            b.within[i] = b.within[i] if within else 0.0
            beyond += 0 if within else 1
    if beyond > 0:
        for v in range(first, last):
            i, own = v - first, ctrl[fleet.bodies[v].actuator :][: kind.count]
            if not b.within[i] > 0.0:
                weight, turning, push, couple = at(b.weight, i), at(b.turn, i), at(b.push, i), at(b.couple, i)
                allocate_within_limits(kind, thrusters, attitude(b, i)[8], weight, turning, push, couple, own)
                for j in range(kind.count):
                    effort[j, i] = own[j]


@inline_jit
def _add_medium(medium, state, kind, first, last, lanes, b):
    """Add what the medium, whose state is given, does besides drag to the vehicles from first up to last."""
    if kind.buoyancy > 0.0:
        for i in range(lanes):
            normal = b.normal[0, i], b.normal[1, i]
            R, force, moment = attitude(b, i), at(b.force, i), at(b.moment, i)
            _put_wrench(b, i, add_buoyancy(kind, b.height[i], normal, R, force, moment))
    if kind.ballast > 0.0:
        for i in range(lanes):
            _put_wrench(b, i, add_ballast(kind, attitude(b, i), at(b.force, i), at(b.moment, i)))
    if has_wind(medium.parts) and kind.windage[3] > 0.0:
        for i in range(lanes):
            v, (x, y, _) = first + i if first + i < last else first, at(b.position, i)
            z = medium.level + kind.windage[3]
            air = add_winds(medium.parts, state.parts, (0.0, 0.0, 0.0), state.time[v], v, x, y, z)
            force, moment = wind_wrench(kind, to_body(attitude(b, i), subtract(air, at(b.velocity, i))))
            _add_wrench(b, i, force, moment)
    if kind.added:
        for i in range(lanes):
            R, s, omega = attitude(b, i), at(b.through, i), at(b.rates, i)
            _put_wrench(b, i, share_with_medium(kind, R, s, omega, at(b.force, i), at(b.moment, i)))


@inline_jit
def _put_wrench(b, i, wrench):
    put(b.force, i, wrench[0])
    put(b.moment, i, wrench[1])


@inline_jit
def _add_wrench(b, i, force, moment):
    put(b.force, i, add(at(b.force, i), force))
    put(b.moment, i, add(at(b.moment, i), moment))


@inline_jit
def command_alone(loop, v, b):
    """Measure the state of vehicle v and write its commands, with the medium at the present time.

    The block then contains its state and the force and moment on it: those of the medium, on its body and on its
    actuators, and those of the surface on which a lost vehicle rests.
    """
    params, state = loop.params, loop.state
    body = params.fleet.bodies[v]
    kind = params.fleet.kinds[body.kind]
    thrusters = params.fleet.thrusters[kind.thruster : kind.thruster + kind.count]
    ctrl, act = state.ctrl[body.actuator : body.actuator + kind.count], state.act[body.state :]
    _gather(body, state.qpos, state.qvel, state.memory.command[v], b, 0)
    _read_medium(params.medium, state.medium, v, b, 0)
    _sense(kind, b, 0)
    put(state.carried[v][:, None], 0, at(b.medium, 0))
    through, rates = at(b.through, 0), at(b.rates, 0)
    if params.helm[v] != OUTSIDE:
        _command(params.fleet, state.ctrl, v, v + 1, 1, b, ctrl[:, None])
        if kind.turning:
            aim(thrusters, through, rates, act, ctrl)
    _add_medium(params.medium, state.medium, kind, v, v + 1, 1, b)
    if params.helm[v] == STOPPED:
        for j in range(kind.count):
            if thrusters[j].code != ANGLE:
                ctrl[j] = 0.0
            elif kind.in_flow:
                ctrl[j] = act[thrusters[j].state]
        if kind.rest > 0.0 and b.height[0] < 0.0:
            force, moment = rest_on_surface(kind, -b.height[0], attitude(b, 0), at(b.velocity, 0), rates)
            _add_wrench(b, 0, force, moment)
    if kind.in_flow:
        force, moment = flow_wrench(thrusters, through, rates, act, ctrl)
        _add_wrench(b, 0, force, moment)


@inline_jit
def _act(kind, thrusters, lanes, b, effort, activation, own):
    """Add the wrenches of the actuators, update their activations, and mark bad commands.

    Args:
        kind, thrusters: KIND and CHANNELs of the vehicles.
        lanes: Number of lanes in use.
        b: Block of the vehicles.
        effort, activation: Commands and activations, shape (.., lanes).
        own: Activations of a vehicle alone, which may turn its thrusters; None in lanes.
    """
    for i in range(lanes):
        b.good[i] = 1.0
    for j in range(kind.count):
        channel = thrusters[j]
        along, about = triple(channel.direction), triple(channel.moment)
        if own is not None:
            along, about = unit_wrench(thrusters, j, own)  # before the angle that comes next
        if channel.late:  # no branch and no masked store in the loops over lanes
            row = activation[channel.state]
            for i in range(lanes):
                f, after = actuator_force(channel, True, effort[j, i], row[i])
                row[i] = after
                _push(b, i, effort[j, i], f, along, about)
        else:
            for i in range(lanes):
                _push(b, i, effort[j, i], actuator_force(channel, False, effort[j, i], 0.0)[0], along, about)


@inline_jit
def _push(b, i, effort, f, along, about):
    _add_wrench(b, i, (f * along[0], f * along[1], f * along[2]), (f * about[0], f * about[1], f * about[2]))
    b.good[i] = b.good[i] if abs(effort) < HUGE else 0.0


@inline_jit
def _take_step(fleet, rigid, h, first, last, lanes, k, b, effort, activation, own, qpos, qvel, bad):
    """Take step k, of h, with commands that were just made; return False, and write to `bad`, if a vehicle is bad."""
    number = fleet.bodies[first].kind
    kind, one = fleet.kinds[number], rigid[number]
    _act(kind, fleet.thrusters[kind.thruster :], lanes, b, effort, activation, own)
    all_good = True
    for v in range(first, last):
        if not b.good[v - first] > 0.0:
            _scatter(fleet.bodies[v], b, v - first, qpos, qvel)  # with the state that is kept
            bad[v], all_good = 2 * k + 1, False
    for i in range(lanes):
        move(one, h, b, i)
    turn(h, lanes, b)
    for v in range(first, last):
        if b.good[v - first] > 0.0 and not b.sound[v - first] > 0.0:
            bad[v], all_good = 2 * (k + 1), False
    return all_good


@inline_jit
def advance_alone(loop, rigid, first, last, step, count, log, row, bad):
    """Move vehicles one after the other; see `fused.advance_block`."""
    params, state = loop.params, loop.state
    fleet, h = params.fleet, params.timestep
    b, all_good = on_stack(ALONE), True
    for k in range(step, step + count):
        advance(params.medium, params.start + k * h, first, last, state.medium)
        for v in range(first, last):  # to the last, as all of them are recorded
            body = fleet.bodies[v]
            command_alone(loop, v, b)
            if k == step and row >= 0:
                record(loop, log, row, v, v + 1)
            ctrl, act = state.ctrl[body.actuator :], state.act[body.state :]
            effort, activation = ctrl[:, None], act[:, None]
            all_good &= _take_step(
                fleet, rigid, h, v, v + 1, 1, k, b, effort, activation, act, state.qpos, state.qvel, bad
            )
            if b.good[0] > 0.0:
                _scatter(body, b, 0, state.qpos, state.qvel)
        if not all_good:
            break
    return all_good


@inline_jit
def _read_steady(medium, first, t, lanes, waves, b):
    """Write the velocity of a steady medium with disturbances at each vehicle; see `medium.medium_velocity`.

    Args:
        medium: Medium of one steady flow and few harmonics.
        first: Number of the first vehicle.
        t: Time, s.
        lanes: Number of lanes in use.
        waves: Harmonics of the disturbances, one lane a vehicle.
        b: Block of the vehicles.
    """
    table = medium.kernels[medium.rows[first, 0] : medium.rows[first, 1]]
    planar, amplitude = medium.planar[first], medium.harmonics.amplitude
    for i in range(lanes):
        put(b.medium, i, triple(table[0, 2:]))
        put(b.shake, i, (0.0, 0.0, 0.0))
    for k in range(1, table.shape[0]):
        c = table[k]
        if c[0] == SOURCE:
            for i in range(lanes):
                put(b.medium, i, add(at(b.medium, i), source_velocity(c, offset_from(c, _place(b, i, planar)))))
        elif c[0] == VORTEX:
            for i in range(lanes):
                put(b.medium, i, add(at(b.medium, i), vortex_velocity(c, offset_from(c, _place(b, i, planar)))))
        else:
            for i in range(lanes):
                put(b.medium, i, add(at(b.medium, i), channel_velocity(c, offset_from(c, _place(b, i, planar)))))
    for k in range(amplitude.shape[1] if first < amplitude.shape[0] else 0):
        for i in range(lanes):  # apart, or there are not enough registers
            waves.sine[i] = sine(waves.rate[k, i] * t + waves.phase[k, i])
        for i in range(lanes):
            s, a = waves.sine[i], at(waves.amplitude[k], i)
            put(b.shake, i, add(at(b.shake, i), (a[0] * s, a[1] * s, a[2] * s)))
    for i in range(lanes):
        put(b.medium, i, add(at(b.medium, i), at(b.shake, i)))
    if planar:  # only planar vehicles float and need the surface height
        for i in range(lanes):
            R = _rotation(b, i)
            b.medium[2, i] = 0.0
            b.height[i] = b.position[2, i] - medium.level
            b.normal[0, i] = R[6]
            b.normal[1, i] = R[7]


@inline_jit
def _write_commands(fleet, state, first, last, b, effort):
    """Write the efforts to the commands of the vehicles, and the velocity of the medium that goes with them."""
    kind = fleet.kinds[fleet.bodies[first].kind]
    for v in range(first, last):
        for j in range(kind.count):
            state.ctrl[fleet.bodies[v].actuator + j] = effort[j, v - first]
        put(state.carried[v][:, None], 0, at(b.medium, v - first))


@inline_jit
def advance_lanes(loop, rigid, first, last, step, count, log, row, bad):
    """Move vehicles for which `fits_lanes` holds; see `fused.advance_block`."""
    params, state = loop.params, loop.state
    fleet, medium, h = params.fleet, params.medium, params.timestep
    kind = fleet.kinds[fleet.bodies[first].kind]
    thrusters = fleet.thrusters[kind.thruster : kind.thruster + kind.count]
    b, waves = on_stack(_WIDE), on_stack(_WAVES)
    effort, activation = on_stack(_ROWS).row, on_stack(_ROWS).row
    lanes, amplitude, all_good = lanes_for(last - first), medium.harmonics.amplitude, True
    # One steady flow and harmonics of few frequencies are all that moves the vehicles.
    steady, D, K = (len(medium.parts) == 0) & (amplitude.shape[1] <= _HARMONICS), amplitude.shape[0], amplitude.shape[1]
    for v in range(first, last):
        steady &= medium.rows[v, 0] == medium.rows[first, 0]
    for i in range(lanes):
        v = first + i if first + i < last else first  # lanes beyond the last repeat the first
        _gather(fleet.bodies[v], state.qpos, state.qvel, state.memory.command[v], b, i)
        for j in range(kind.count):
            channel = thrusters[j]
            if channel.late:
                activation[channel.state, i] = state.act[fleet.bodies[v].state + channel.state]
        for j in range(K if steady else 0):
            waves.rate[j, i] = medium.harmonics.rate[v * K + j] if v < D else 0.0
            waves.phase[j, i] = medium.harmonics.phase[v * K + j] if v < D else 0.0
            put(waves.amplitude[j], i, triple(amplitude[v, j]) if v < D else (0.0, 0.0, 0.0))
    for k in range(step, step + count):
        t = params.start + k * h
        if steady:
            _read_steady(medium, first, t, lanes, waves, b)
        else:
            advance(medium, t, first, last, state.medium)
            for i in range(lanes):
                _read_medium(medium, state.medium, first + i if first + i < last else first, b, i)
        for i in range(lanes):
            _sense(kind, b, i)
        _command(fleet, state.ctrl, first, last, lanes, b, effort)
        _add_medium(medium, state.medium, kind, first, last, lanes, b)
        if k == step and row >= 0:
            _write_commands(fleet, state, first, last, b, effort)
            record(loop, log, row, first, last)
        all_good = _take_step(
            fleet, rigid, h, first, last, lanes, k, b, effort, activation, None, state.qpos, state.qvel, bad
        )
        if not all_good:
            break
    _write_commands(fleet, state, first, last, b, effort)
    for v in range(first, last):
        if b.good[v - first] > 0.0:
            _scatter(fleet.bodies[v], b, v - first, state.qpos, state.qvel)
        for j in range(kind.count):
            channel = thrusters[j]
            if channel.late:
                state.act[fleet.bodies[v].state + channel.state] = activation[channel.state, v - first]
    return all_good
