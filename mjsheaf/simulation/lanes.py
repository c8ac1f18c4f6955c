"""Vehicles of one kind side by side: the fused engine's step, several vehicles an instruction.

A block's numbers lie in rows of LANES, one lane a vehicle; as many lanes are computed as the vehicles need. Every loop
over lanes is straight arithmetic, which LLVM turns into vector instructions: it calls nothing and takes no branch.
Arithmetic is that of `fused.advance_each`, in its order, and lanes do not mix, so that a vehicle's bits are the same in
a lane and alone. What happens rarely is done afterwards: efforts beyond their limits in lanes too, large turns in a
step and one-sided thrusters lane by lane.

Lanes take drones and boats with thrusters fixed on the body. `advance_each` moves vehicles that turn their thrusters,
have rudders, cannot back, are lost, or are commanded from outside. Waves, gusts and gridded flows are evaluated lane by
lane.
"""

import numpy as np

from mjsheaf.jit import LANES, inline_jit, lane_array, lanes_for
from mjsheaf.media.disturbance import sine
from mjsheaf.media.flow import SOURCE, VORTEX, channel_velocity, offset_from, source_velocity, vortex_velocity
from mjsheaf.media.medium import advance as advance_medium
from mjsheaf.media.medium import medium_velocity, surface_about
from mjsheaf.media.moving import upright_in
from mjsheaf.simulation.bodies import (
    MIN_ALIKE,
    add_ballast,
    add_buoyancy,
    allocate_within_limits,
    carried_by_water,
    drag_wrench,
    share_with_medium,
    within_thrust,
)
from mjsheaf.simulation.loop import AUTOPILOT, HUGE, record
from mjsheaf.simulation.motion import NEARLY_UNIT, SMALL, accelerations, series, turned
from mjsheaf.vehicles.actuators import actuator_force, at_most, room_of_fixed
from mjsheaf.vehicles.steering import (
    HAND_POINT,
    THRUST_VECTOR,
    drag_force,
    hand_point_moment,
    is_within_thrust,
    point_share,
    share_within_thrust,
    turn_to,
)
from mjsheaf.vehicles.vectors import add, cross, rotation, row_product, subtract, to_body, to_world, triple, upward

_CHANNELS = 8  # largest number of actuators of a vehicle
_HARMONICS = 8  # largest number of harmonics of a disturbance

# Rows of a block.
_POSITION, _QUATERNION, _VELOCITY, _RATES = 0, 3, 7, 10
_MEDIUM, _COMMAND, _HEADING = 13, 16, 19
_FORCE, _MOMENT = 21, 24  # on the body
_WEIGHT, _TURN, _PUSH, _COUPLE = 27, 30, 33, 36  # that actuators are to make: see `bodies`
_TOTAL = 39  # their sum, (6,)
_GOOD = 45  # 1 where the commands are good
_SOUND = 46  # 1 where the state is
_PARTS = 47  # of the unit quaternion of a turn: cosine, sine over the angle
_SIZE = 49  # what makes the quaternion one
_LARGE = 50  # 1 where the turn is large, or the quaternion far from one
_SHAKE = 51  # velocity of the disturbance
_HEIGHT = 54  # above the surface, before the normal
_NORMAL = 55  # of the surface, along the body's x and y axes
_WITHIN = 57  # 1 where all efforts are within their limits
_SHARE = 58  # of the force that is within the limits of thrust
_ROWS = 59

_WRENCH_ROWS = 24  # four wrenches, which actuators make one after the other as far as limits allow

# Rows of the disturbances, one for each harmonic.
_RATE, _PHASE, _AMPLITUDE = 0, _HARMONICS, 2 * _HARMONICS
_WAVE_ROWS = 5 * _HARMONICS


@inline_jit
def end_of_kind(bodies, first, last):
    """Return the number after the last of the vehicles from `first` on, and before `last`, that are of one kind."""
    end = first + 1
    while end < last and bodies[end].kind == bodies[first].kind:
        end += 1
    return end


@inline_jit
def fits_lanes(fleet, helm, qpos, first, last):
    """Return True if the vehicles from first up to last, of one kind, can be moved in lanes; see `loop.Params`."""
    kind = fleet.kinds[fleet.bodies[first].kind]
    fits = (last - first >= MIN_ALIKE) & (last - first <= LANES)
    fits &= kind.steering <= HAND_POINT
    fits &= (kind.turning == 0) & (kind.in_flow == 0) & (kind.forward_only == 0) & (kind.count <= _CHANNELS)
    fits &= qpos.itemsize == 8
    for v in range(first, last):
        fits &= helm[v] == AUTOPILOT
    return fits


@inline_jit
def _three(block, row, lane):
    return block[row, lane], block[row + 1, lane], block[row + 2, lane]


@inline_jit
def _put(block, row, lane, a):
    block[row, lane] = a[0]
    block[row + 1, lane] = a[1]
    block[row + 2, lane] = a[2]


@inline_jit
def _quaternion(block, lane):
    q = _QUATERNION
    return block[q, lane], block[q + 1, lane], block[q + 2, lane], block[q + 3, lane]


@inline_jit
def _attitude(block, lane):
    w, x, y, z = _quaternion(block, lane)
    return rotation(w, x, y, z)


@inline_jit
def _gather(fleet, qpos, qvel, act, command, first, last, lanes, block, activation):
    """Read the state of the vehicles and their commands (V, 3); lanes beyond the last repeat the first."""
    kind = fleet.kinds[fleet.bodies[first].kind]
    for lane in range(lanes):
        v = first + lane if first + lane < last else first
        body = fleet.bodies[v]
        for i in range(7):
            block[_POSITION + i, lane] = qpos[body.qpos + i]
        for i in range(6):
            block[_VELOCITY + i, lane] = qvel[body.dof + i]
        for i in range(3):
            block[_COMMAND + i, lane] = command[v, i]
        block[_HEADING, lane] = body.heading[0]
        block[_HEADING + 1, lane] = body.heading[1]
        for j in range(kind.count):
            channel = fleet.thrusters[kind.thruster + j]
            activation[j, lane] = act[body.state + channel.state] if channel.late else 0.0


@inline_jit
def _scatter(fleet, qpos, qvel, act, first, last, block, activation):
    """Write the activations of the vehicles, and the state of those whose commands are good."""
    kind = fleet.kinds[fleet.bodies[first].kind]
    for v in range(first, last):
        lane = v - first
        body = fleet.bodies[v]
        if block[_GOOD, lane] > 0.0:
            for i in range(7):
                qpos[body.qpos + i] = block[_POSITION + i, lane]
            for i in range(6):
                qvel[body.dof + i] = block[_VELOCITY + i, lane]
        for j in range(kind.count):
            channel = fleet.thrusters[kind.thruster + j]
            if channel.late:
                act[body.state + channel.state] = activation[j, lane]


@inline_jit
def _through_medium(block, lane, R):
    return to_body(R, subtract(_three(block, _VELOCITY, lane), _three(block, _MEDIUM, lane)))


@inline_jit
def _wrench(block, lane):
    return _three(block, _FORCE, lane), _three(block, _MOMENT, lane)


@inline_jit
def _put_wrench(block, lane, force, moment):
    _put(block, _FORCE, lane, force)
    _put(block, _MOMENT, lane, moment)


@inline_jit
def _add_medium(kind, lanes, block):
    """Add what the medium does besides drag; see `bodies.medium_wrench`."""
    if kind.buoyancy > 0.0:
        for lane in range(lanes):
            R, (force, moment) = _attitude(block, lane), _wrench(block, lane)
            normal = block[_NORMAL, lane], block[_NORMAL + 1, lane]
            force, moment = add_buoyancy(kind, block[_HEIGHT, lane], normal, R, force, moment)
            _put_wrench(block, lane, force, moment)
    if kind.ballast > 0.0:
        for lane in range(lanes):
            force, moment = _wrench(block, lane)
            force, moment = add_ballast(kind, _attitude(block, lane), force, moment)
            _put_wrench(block, lane, force, moment)
    if kind.added:
        for lane in range(lanes):
            R, (force, moment) = _attitude(block, lane), _wrench(block, lane)
            s = _through_medium(block, lane, R)
            force, moment = share_with_medium(kind, R, s, _three(block, _RATES, lane), force, moment)
            _put_wrench(block, lane, force, moment)


@inline_jit
def _steer_hand_point(kind, lanes, block):
    """Write the wrench of drag and the wrenches that actuators are to make; see `bodies.thruster_commands`."""
    K, com, none = kind.gain, triple(kind.com), (0.0, 0.0, 0.0)
    for lane in range(lanes):
        R, omega = _attitude(block, lane), _three(block, _RATES, lane)
        s = _through_medium(block, lane, R)
        drag, moment = drag_wrench(kind, s, omega)
        _put_wrench(block, lane, drag, moment)
        wanted = to_body(R, _three(block, _COMMAND, lane))
        force = carried_by_water(R, drag_force(kind, wanted))
        force = (force[0] + K[0] * (wanted[0] - s[0]), 0.0, 0.0)
        weight = upward(R, kind.supported_weight)
        couple = (0.0, 0.0, hand_point_moment(kind, s, omega, wanted[1]))
        _put_wrenches(block, lane, com, weight, none, force, couple)


@inline_jit
def _put_wrenches(block, lane, com, weight, turn, force, couple):
    _put(block, _WEIGHT, lane, weight)
    _put(block, _TURN, lane, turn)
    _put(block, _PUSH, lane, force)
    _put(block, _COUPLE, lane, couple)
    _put(block, _TOTAL, lane, add(weight, force))
    _put(block, _TOTAL + 3, lane, add(cross(com, weight), add(turn, couple)))


@inline_jit
def _steer(kind, lanes, block):
    """Write the wrench of drag and the wrenches that actuators are to make; see `bodies.thruster_commands`."""
    com, share, points = triple(kind.com), triple(kind.rigid_mass_fraction), kind.steering == THRUST_VECTOR
    _want_force(kind, lanes, block)
    if points:
        _limit_thrust(kind, lanes, block)
    for lane in range(lanes):
        quaternion = _quaternion(block, lane)
        R = rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
        omega, force = _three(block, _RATES, lane), _three(block, _PUSH, lane)
        weight = upward(R, kind.supported_weight)
        heading = (block[_HEADING, lane], block[_HEADING + 1, lane])
        attitude = (heading[0], 0.0, 0.0, heading[1])
        if points:
            force, weight, attitude = point_share(kind, heading, R, force, block[_SHARE, lane], weight)
        turn = turn_to(kind, attitude, quaternion, omega)
        net = add(force, _three(block, _FORCE, lane))  # the force of drag is in no other wrench yet
        couple = cross(com, (share[0] * net[0], share[1] * net[1], share[2] * net[2]))
        _put_wrenches(block, lane, com, weight, turn, force, couple)


@inline_jit
def _want_force(kind, lanes, block):
    """Write the wrench of drag, and the force for the desired velocity: in world axes where thrust is pointed."""
    K = kind.gain
    for lane in range(lanes):
        R = _attitude(block, lane)
        s = _through_medium(block, lane, R)
        drag, moment = drag_wrench(kind, s, _three(block, _RATES, lane))
        _put_wrench(block, lane, drag, moment)
        wanted = to_body(R, _three(block, _COMMAND, lane))
        force = drag_force(kind, wanted)
        if kind.planar:
            force = carried_by_water(R, force)
        force = (
            force[0] + K[0] * (wanted[0] - s[0]),
            force[1] + K[1] * (wanted[1] - s[1]),
            force[2] + K[2] * (wanted[2] - s[2]),
        )
        if kind.steering == THRUST_VECTOR:
            force = to_world(R, force)
        _put(block, _PUSH, lane, force)


@inline_jit
def _limit_thrust(kind, lanes, block):
    """Write the shares of the forces that are within the limits of thrust: 1 but for few vehicles."""
    beyond = 0
    for lane in range(lanes):
        block[_SHARE, lane] = 1.0
        beyond += 0 if is_within_thrust(kind, _three(block, _PUSH, lane)) else 1
    if beyond > 0:
        for lane in range(lanes):
            block[_SHARE, lane] = share_within_thrust(kind, _three(block, _PUSH, lane))


@inline_jit
def _allocate(fleet, ctrl, first, last, lanes, block, effort):
    """Write the efforts; see `bodies.thruster_commands`.

    Args:
        fleet: The vehicles.
        ctrl: Commands of all actuators, which serve as working memory.
        first, last: Range of vehicles.
        lanes: Number of lanes in use.
        block, effort: Rows of the vehicles, and of their efforts.
    """
    kind = fleet.kinds[fleet.bodies[first].kind]
    thrusters = fleet.thrusters[kind.thruster : kind.thruster + kind.count]
    beyond = 0
    for lane in range(lanes):
        block[_WITHIN, lane] = 1.0
    for j in range(kind.count):
        channel = thrusters[j]
        for lane in range(lanes):
            u = row_product(channel.row, _three(block, _TOTAL, lane), _three(block, _TOTAL + 3, lane))
            effort[j, lane] = u
            within = (channel.low <= u) & (u <= channel.high)
            block[_WITHIN, lane] = block[_WITHIN, lane] if within else 0.0
            beyond += 0 if within else 1
    if beyond > 0:
        if kind.one_sided:
            _allocate_nearest(fleet.bodies, ctrl, kind, thrusters, first, last, block, effort)
        else:
            _allocate_within_limits(kind, thrusters, lanes, block, effort)


@inline_jit
def _allocate_nearest(bodies, ctrl, kind, thrusters, first, last, block, effort):
    """Replace the efforts of vehicles of which one is beyond its limits, one vehicle after the other."""
    for v in range(first, last):
        lane = v - first
        if not block[_WITHIN, lane] > 0.0:
            nearest = ctrl[bodies[v].actuator :]
            weight, turn = _three(block, _WEIGHT, lane), _three(block, _TURN, lane)
            force, moment = _three(block, _PUSH, lane), _three(block, _COUPLE, lane)
            upright = _attitude(block, lane)[8]
            allocate_within_limits(kind, thrusters, upright, weight, turn, force, moment, nearest)
            for j in range(kind.count):
                effort[j, lane] = nearest[j]


@inline_jit
def _allocate_within_limits(kind, thrusters, lanes, block, effort):
    """Replace the efforts of vehicles of which one is beyond its limits; see `bodies.allocate_within_limits`."""
    limited = lane_array(_CHANNELS)
    added = lane_array(_CHANNELS)
    fraction = lane_array(1)
    wrenches = lane_array(_WRENCH_ROWS)
    com = triple(kind.com)
    for lane in range(lanes):
        weight, turn = _three(block, _WEIGHT, lane), _three(block, _TURN, lane)
        push, couple = _three(block, _PUSH, lane), _three(block, _COUPLE, lane)
        upright = _attitude(block, lane)[8]
        weight, carry, push, couple = within_thrust(kind, upright, weight, cross(com, weight), push, couple)
        _put(wrenches, 0, lane, weight)
        _put(wrenches, 3, lane, carry)
        _put(wrenches, 6, lane, (0.0, 0.0, 0.0))
        _put(wrenches, 9, lane, (turn[0], turn[1], 0.0))
        _put(wrenches, 12, lane, (0.0, 0.0, 0.0))
        _put(wrenches, 15, lane, (0.0, 0.0, turn[2]))
        _put(wrenches, 18, lane, push)
        _put(wrenches, 21, lane, couple)
    for j in range(kind.count):
        for lane in range(lanes):
            limited[j, lane] = row_product(thrusters[j].row, _three(wrenches, 0, lane), _three(wrenches, 3, lane))
    for first in range(6, _WRENCH_ROWS, 6):
        for lane in range(lanes):
            fraction[0, lane] = 1.0
        for j in range(kind.count):
            channel = thrusters[j]
            for lane in range(lanes):
                du = row_product(channel.row, _three(wrenches, first, lane), _three(wrenches, first + 3, lane))
                added[j, lane] = du
                room = room_of_fixed(channel.low, channel.high, limited[j, lane], du)
                fraction[0, lane] = min(fraction[0, lane], room)
        for j in range(kind.count):
            for lane in range(lanes):
                limited[j, lane] += fraction[0, lane] * added[j, lane]
    for j in range(kind.count):
        channel = thrusters[j]
        for lane in range(lanes):
            u = at_most(limited[j, lane], channel.low, channel.high)
            effort[j, lane] = effort[j, lane] if block[_WITHIN, lane] > 0.0 else u


@inline_jit
def _act(kind, thrusters, lanes, block, activation, effort):
    """Add the wrenches of the actuators, update their activations, and mark bad efforts."""
    for lane in range(lanes):
        block[_GOOD, lane] = 1.0
    for j in range(kind.count):
        channel = thrusters[j]
        along, about = triple(channel.direction), triple(channel.moment)
        for lane in range(lanes):
            u = effort[j, lane]
            f, after = actuator_force(channel, u, activation[j, lane])
            activation[j, lane] = after
            force, moment = _wrench(block, lane)
            force = add(force, (f * along[0], f * along[1], f * along[2]))
            moment = add(moment, (f * about[0], f * about[1], f * about[2]))
            _put_wrench(block, lane, force, moment)
            block[_GOOD, lane] = block[_GOOD, lane] if abs(u) < HUGE else 0.0


@inline_jit
def _move(one, h, lanes, block):
    """Take MuJoCo's step of h, s; see `motion.move`."""
    for lane in range(lanes):
        R, omega = _attitude(block, lane), _three(block, _RATES, lane)
        along, about = accelerations(one, R, omega, _three(block, _FORCE, lane), _three(block, _MOMENT, lane))
        sound = (abs(along[0]) < HUGE) & (abs(along[1]) < HUGE) & (abs(along[2]) < HUGE)
        sound &= (abs(about[0]) < HUGE) & (abs(about[1]) < HUGE) & (abs(about[2]) < HUGE)
        v = _three(block, _VELOCITY, lane)
        x = _three(block, _POSITION, lane)
        v = (v[0] + h * along[0], v[1] + h * along[1], v[2] + h * along[2])
        omega = (omega[0] + h * about[0], omega[1] + h * about[1], omega[2] + h * about[2])
        x = (x[0] + h * v[0], x[1] + h * v[1], x[2] + h * v[2])
        sound &= (abs(v[0]) < HUGE) & (abs(v[1]) < HUGE) & (abs(v[2]) < HUGE)
        sound &= (abs(omega[0]) < HUGE) & (abs(omega[1]) < HUGE) & (abs(omega[2]) < HUGE)
        sound &= (abs(x[0]) < HUGE) & (abs(x[1]) < HUGE) & (abs(x[2]) < HUGE)
        _put(block, _VELOCITY, lane, v)
        _put(block, _RATES, lane, omega)
        _put(block, _POSITION, lane, x)
        block[_SOUND, lane] = 1.0 if sound else 0.0


@inline_jit
def _turn(h, lanes, block):
    """Turn the quaternions; see `motion.turn`."""
    large = 0.0
    for lane in range(lanes):
        omega, q = _three(block, _RATES, lane), _quaternion(block, lane)
        x, y, z = 0.5 * h * omega[0], 0.5 * h * omega[1], 0.5 * h * omega[2]
        square = x * x + y * y + z * z
        block[_PARTS, lane], block[_PARTS + 1, lane] = series(square)
        norm = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
        block[_SIZE, lane] = 1.5 - 0.5 * norm
        block[_LARGE, lane] = 0.0 if (square < SMALL) & (abs(norm - 1.0) < NEARLY_UNIT) else 1.0
    for lane in range(lanes):
        large += block[_LARGE, lane]
    if large > 0.0:
        _turn_far(h, lanes, block)
    for lane in range(lanes):
        omega, s = _three(block, _RATES, lane), block[_PARTS + 1, lane]
        x, y, z = s * (0.5 * h * omega[0]), s * (0.5 * h * omega[1]), s * (0.5 * h * omega[2])
        q = turned(_quaternion(block, lane), block[_SIZE, lane], block[_PARTS, lane], (x, y, z))
        for i in range(4):
            block[_QUATERNION + i, lane] = q[i]


@inline_jit
def _turn_far(h, lanes, block):
    """Replace the series where a turn is large, and the size where a quaternion is far from one."""
    for lane in range(lanes):
        omega, q = _three(block, _RATES, lane), _quaternion(block, lane)
        x, y, z = 0.5 * h * omega[0], 0.5 * h * omega[1], 0.5 * h * omega[2]
        square = x * x + y * y + z * z
        if not square < SMALL:
            half = np.sqrt(square)
            block[_PARTS, lane] = np.cos(half)
            block[_PARTS + 1, lane] = np.sin(half) / half
        norm = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
        if not abs(norm - 1.0) < NEARLY_UNIT:
            block[_SIZE, lane] = 1.0 / np.sqrt(norm)


@inline_jit
def _mark_commands(bodies, qpos, qvel, first, last, k, block, bad):
    """Return True if all commands are good; write to `bad`, and keep the state of vehicles whose commands are not."""
    all_good = True
    for v in range(first, last):
        if not block[_GOOD, v - first] > 0.0:
            body = bodies[v]
            for i in range(7):
                qpos[body.qpos + i] = block[_POSITION + i, v - first]
            for i in range(6):
                qvel[body.dof + i] = block[_VELOCITY + i, v - first]
            bad[v] = 2 * k + 1
            all_good = False
    return all_good


@inline_jit
def _mark_states(first, last, k, block, bad):
    """Return True if all states after step k are good; write to `bad`, unless the commands were."""
    all_good = True
    for v in range(first, last):
        if block[_GOOD, v - first] > 0.0 and not block[_SOUND, v - first] > 0.0:
            bad[v] = 2 * (k + 1)
            all_good = False
    return all_good


@inline_jit
def _is_steady(medium, first, last):
    """Return True if one steady flow and harmonics of few frequencies are all that moves the vehicles."""
    steady = (len(medium.parts) == 0) & (medium.harmonics.amplitude.shape[1] <= _HARMONICS)
    for v in range(first, last):
        steady &= medium.rows[v, 0] == medium.rows[first, 0]
    return steady


@inline_jit
def _gather_waves(harmonics, first, last, lanes, waves):
    """Read the harmonics of the vehicles' disturbances, as `_gather` reads their state."""
    D, K = harmonics.amplitude.shape[0], harmonics.amplitude.shape[1]
    for lane in range(lanes):
        v = first + lane if first + lane < last else first
        for k in range(K):
            waves[_RATE + k, lane] = harmonics.rate[v * K + k] if v < D else 0.0
            waves[_PHASE + k, lane] = harmonics.phase[v * K + k] if v < D else 0.0
            _put(waves, _AMPLITUDE + 3 * k, lane, triple(harmonics.amplitude[v, k]) if v < D else (0.0, 0.0, 0.0))


@inline_jit
def _place(block, lane, planar):
    """Return the point of the medium that a vehicle meets: in the plane, a boat's is at a height of 0."""
    return block[_POSITION, lane], block[_POSITION + 1, lane], 0.0 if planar else block[_POSITION + 2, lane]


@inline_jit
def _read_steady(medium, first, t, lanes, waves, block):
    """Write the velocity of a steady medium with disturbances at each vehicle; see `medium.medium_velocity`.

    Args:
        medium: Medium for which `_is_steady` holds.
        first: Number of the first vehicle.
        t: Time, s.
        waves: Harmonics of the disturbances, from `_gather_waves`.
        block: Rows of the vehicles.
    """
    table = medium.kernels[medium.rows[first, 0] : medium.rows[first, 1]]
    planar, amplitude = medium.planar[first], medium.harmonics.amplitude
    for lane in range(lanes):
        _put(block, _MEDIUM, lane, triple(table[0, 2:]))
        _put(block, _SHAKE, lane, (0.0, 0.0, 0.0))
    for k in range(1, table.shape[0]):
        c = table[k]
        if c[0] == SOURCE:
            for lane in range(lanes):
                w = source_velocity(c, offset_from(c, _place(block, lane, planar)))
                _put(block, _MEDIUM, lane, add(_three(block, _MEDIUM, lane), w))
        elif c[0] == VORTEX:
            for lane in range(lanes):
                w = vortex_velocity(c, offset_from(c, _place(block, lane, planar)))
                _put(block, _MEDIUM, lane, add(_three(block, _MEDIUM, lane), w))
        else:
            for lane in range(lanes):
                w = channel_velocity(c, offset_from(c, _place(block, lane, planar)))
                _put(block, _MEDIUM, lane, add(_three(block, _MEDIUM, lane), w))
    for k in range(amplitude.shape[1] if first < amplitude.shape[0] else 0):
        for lane in range(lanes):
            s = sine(waves[_RATE + k, lane] * t + waves[_PHASE + k, lane])
            a = _three(waves, _AMPLITUDE + 3 * k, lane)
            _put(block, _SHAKE, lane, add(_three(block, _SHAKE, lane), (a[0] * s, a[1] * s, a[2] * s)))
    for lane in range(lanes):
        _put(block, _MEDIUM, lane, add(_three(block, _MEDIUM, lane), _three(block, _SHAKE, lane)))
    if planar:
        for lane in range(lanes):
            R = _attitude(block, lane)
            block[_MEDIUM + 2, lane] = 0.0
            block[_HEIGHT, lane] = block[_POSITION + 2, lane] - medium.level
            block[_NORMAL, lane] = R[6]
            block[_NORMAL + 1, lane] = R[7]


@inline_jit
def _read_medium(medium, state, first, last, lanes, block):
    """Write the velocity of the medium at each vehicle, and the surface at each boat; see `loop.sense_and_command`.

    Lanes beyond the last meet what the first one does: undefined numbers could bring efforts beyond their limits.
    """
    planar = medium.planar[first]
    for v in range(first, last):
        lane = v - first
        x, y, z = _place(block, lane, planar)
        w = medium_velocity(medium, state, v, x, y, z)
        if planar:
            surface = surface_about(medium, state, v, x, y)
            w = w[0], w[1], w[2] + surface[3]
            block[_HEIGHT, lane] = block[_POSITION + 2, lane] - surface[0]
            normal = upright_in(medium.parts, surface, _attitude(block, lane))
            block[_NORMAL, lane] = normal[0]
            block[_NORMAL + 1, lane] = normal[1]
        _put(block, _MEDIUM, lane, w)
    for lane in range(last - first, lanes):
        _put(block, _MEDIUM, lane, _three(block, _MEDIUM, 0))
        _put(block, _HEIGHT, lane, _three(block, _HEIGHT, 0))


@inline_jit
def _write_commands(fleet, ctrl, first, last, effort):
    """Write the efforts to the commands of the vehicles."""
    kind = fleet.kinds[fleet.bodies[first].kind]
    for v in range(first, last):
        for j in range(kind.count):
            ctrl[fleet.bodies[v].actuator + j] = effort[j, v - first]


@inline_jit
def advance_lanes(loop, motion, first, last, step, count, log, row, bad):
    """Move vehicles for which `fits_lanes` holds; see `fused.advance_block`."""
    params, state = loop
    fleet, h, qpos, qvel = params.fleet, params.timestep, state.qpos, state.qvel
    number = fleet.bodies[first].kind
    kind, one = fleet.kinds[number], motion[number]
    thrusters = fleet.thrusters[kind.thruster : kind.thruster + kind.count]
    block, activation, effort = lane_array(_ROWS), lane_array(_CHANNELS), lane_array(_CHANNELS)
    lanes = lanes_for(last - first)
    waves, steady = lane_array(_WAVE_ROWS), _is_steady(params.medium, first, last)
    _gather(fleet, qpos, qvel, state.act, state.memory.command, first, last, lanes, block, activation)
    if steady:
        _gather_waves(params.medium.harmonics, first, last, lanes, waves)
    all_good = True
    for k in range(step, step + count):
        t, recorded = params.start + k * h, k == step and row >= 0
        if recorded or not steady:
            advance_medium(params.medium, t, first, last, state.medium)
        if steady:
            _read_steady(params.medium, first, t, lanes, waves, block)
        else:
            _read_medium(params.medium, state.medium, first, last, lanes, block)
        if kind.steering == HAND_POINT:
            _steer_hand_point(kind, lanes, block)
        else:
            _steer(kind, lanes, block)
        _add_medium(kind, lanes, block)
        _allocate(fleet, state.ctrl, first, last, lanes, block, effort)
        if recorded:
            _write_commands(fleet, state.ctrl, first, last, effort)
            record(loop, log, row, first, last)
        _act(kind, thrusters, lanes, block, activation, effort)
        all_good &= _mark_commands(fleet.bodies, qpos, qvel, first, last, k, block, bad)
        _move(one, h, lanes, block)
        _turn(h, lanes, block)
        all_good &= _mark_states(first, last, k, block, bad)
        if not all_good:
            break
    _write_commands(fleet, state.ctrl, first, last, effort)
    _scatter(fleet, qpos, qvel, state.act, first, last, block, activation)
    return all_good
