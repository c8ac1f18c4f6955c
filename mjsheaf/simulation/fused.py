"""The fused engine: free vehicles moved by one compiled function, without MuJoCo, along its very trajectory.

A vehicle is one rigid body on a free joint. With R its attitude, m, c and J its mass, centre of mass and inertia about
the origin, and f and n the force and moment of medium, actuators and weight on it, in body axes about the origin,
MuJoCo's step of h is

    [[m I + h d, -m [c]], [m [c], J + h D]] [a; alpha] = [f - m omega x (omega x c); n - omega x J omega - D omega]

    v += h R a,   omega += h alpha,   x += h v,   q <- q exp(h omega / 2)

where the free joint takes the linear damping d and D implicitly (mj_Euler); what of d it takes explicitly, the loop
applies again as a force (see `bodies`), so that neither is in f. The matrix is of the kind, inverted once.
Everything else, from the law to the commands, is the functions that close the loop about MuJoCo's step; what it makes
of commands is `actuators.actuator_force` and `unit_wrench`.

Between two evaluations of the law vehicles do not know of one another: each is moved up to the next in one go, and
they are handed out to threads. Which thread moves a vehicle does not change a bit.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjsheaf.arrays import IntArray
from mjsheaf.jit import as_records, inline_jit, jit
from mjsheaf.media.medium import advance as advance_medium
from mjsheaf.simulation.bodies import kinds_of
from mjsheaf.simulation.engine import Recorder
from mjsheaf.simulation.gate import fail, take
from mjsheaf.simulation.loop import HUGE, Loop, record, sense_and_command
from mjsheaf.simulation.threaded import BLOCK, ThreadedLoop, begin_span, end_span, next_row
from mjsheaf.vehicles.actuators import actuator_force, unit_wrench
from mjsheaf.vehicles.vectors import add, cross, product, row_product, subtract, to_world, triple, upward
from mjsheaf.vehicles.vehicle import Vehicle

# How a kind moves; body axes, about the origin of the body frame.
MOTION = np.dtype(
    [
        ("inverse", "f8", (6, 6)),  # of the matrix above
        ("inertia", "f8", (3, 3)),  # J, kg m^2
        ("damping", "f8", 3),  # D, N m s/rad
        ("weight", "f8"),  # N
        ("weight_moment", "f8", 3),  # of the weight, upright, N m
        ("mass_moment", "f8", 3),  # m c, kg m
    ],
    align=True,
)

_TURNS = 8  # in which a thread takes its share of the vehicles, so that none waits long for another
_SMALL = 0.01  # rad^2: square of half a turn up to which its sine and cosine are short series


def pack_motion(vehicles: Sequence[Vehicle], timestep: float) -> NDArray[np.void]:
    """A MOTION for each kind of vehicle, in steps of so many s."""
    motion = np.zeros(len(vehicles), MOTION)
    for one, vehicle in zip(motion, vehicles, strict=True):
        taken = vehicle.joint_damping
        one["inverse"] = np.linalg.inv(vehicle.rigid_mass + timestep * np.diag(taken))
        one["inertia"], one["damping"] = vehicle.inertia, taken[3:]
        one["weight"], one["weight_moment"] = vehicle.weight - vehicle.ballast, vehicle.weight_moment
        one["mass_moment"] = vehicle.mass * vehicle.centre_of_mass
    return as_records(motion)


@inline_jit
def move(one, body, R, omega, force, moment, h, qpos, qvel):
    """Take MuJoCo's step of h, s, under a force and a moment beside the weight; return whether the state is still good.

    Args:
        one: see MOTION.
        body: see BODY.
        R, omega: attitude (9,) and rates (3,).
        force, moment: in body axes about the origin, (3,) each, N and N m.
        h: s.
        qpos, qvel: the state of all vehicles, of which the body's own is written.
    """
    a, d = body.qpos, body.dof
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
    good = True
    for i in range(3):
        qvel[d + i] += h * along[i]
        qvel[d + 3 + i] += h * about[i]
        qpos[a + i] += h * qvel[d + i]
        good &= (abs(along[i]) < HUGE) & (abs(about[i]) < HUGE) & (abs(qpos[a + i]) < HUGE)
        good &= (abs(qvel[d + i]) < HUGE) & (abs(qvel[d + 3 + i]) < HUGE)
    turn(qpos[a + 3 : a + 7], 0.5 * h * qvel[d + 3], 0.5 * h * qvel[d + 4], 0.5 * h * qvel[d + 5])
    return good


@inline_jit
def turn(q, x, y, z):
    """Make a quaternion q (4,) one again and turn it by twice the body's rotation vector (x, y, z), rad."""
    square = x * x + y * y + z * z
    if square < _SMALL:
        c = 1.0 + square * (-1.0 / 2.0 + square * (1.0 / 24.0 + square * (-1.0 / 720.0 + square / 40320.0)))
        s = 1.0 + square * (-1.0 / 6.0 + square * (1.0 / 120.0 + square * (-1.0 / 5040.0 + square / 362880.0)))
    else:
        half = np.sqrt(square)
        c, s = np.cos(half), np.sin(half) / half
    x, y, z = s * x, s * y, s * z
    a, b, e, f = q[0], q[1], q[2], q[3]
    square = a * a + b * b + e * e + f * f
    size = 1.5 - 0.5 * square if abs(square - 1.0) < 1e-8 else 1.0 / np.sqrt(square)
    a, b, e, f = size * a, size * b, size * e, size * f
    q[0] = a * c - b * x - e * y - f * z
    q[1] = a * x + b * c + e * z - f * y
    q[2] = a * y - b * z + e * c + f * x
    q[3] = a * z + b * y - e * x + f * c


@jit
def advance_block(loop, motion, first, last, step, count, log, row, bad):
    """Move vehicles from first up to last by `count` steps from step number `step`, fewer where one becomes bad.

    Their samples before the first step are recorded as `row` of the log, unless that is negative.

    Returns:
        Whether none did; see `ThreadedLoop._work` on `bad`.
    """
    params, state = loop
    h, all_good = params.timestep, True
    for k in range(step, step + count):
        advance_medium(params.medium, params.start + k * h, first, last, state.medium)
        for v in range(first, last):  # to the last, as all of them are recorded
            body = params.fleet.bodies[v]
            R, omega, force, moment = sense_and_command(loop, v)
            if k == step and row >= 0:
                record(loop, log, row, v, v + 1)
            good, force, moment = apply_actuators(loop, body, force, moment)
            if not good:
                bad[v], all_good = 2 * k + 1, False
            elif not move(motion[body.kind], body, R, omega, force, moment, h, state.qpos, state.qvel):
                bad[v], all_good = 2 * (k + 1), False
        if not all_good:
            break
    return all_good


@inline_jit
def apply_actuators(loop, body, force, moment):
    """Add to force and moment what a vehicle's actuators make of its commands, and go on with their activations.

    Returns:
        Whether all commands are good; force and moment, body axes, (3,) each.
    """
    fleet, state = loop.params.fleet, loop.state
    kind, good = fleet.kinds[body.kind], True
    channels = fleet.thrusters[kind.thruster : kind.thruster + kind.count]
    ctrl = state.ctrl[body.actuator : body.actuator + kind.count]
    act = state.act[body.state :]
    for j in range(kind.count):
        channel = channels[j]
        f, after = actuator_force(channel, ctrl[j], act[channel.state] if channel.late else 0.0)
        along, about = unit_wrench(channels, j, act)  # before the angle that comes next
        force = add(force, (f * along[0], f * along[1], f * along[2]))
        moment = add(moment, (f * about[0], f * about[1], f * about[2]))
        good &= abs(ctrl[j]) < HUGE
        if channel.late:
            act[channel.state] = after
    return good, force, moment


@jit
def advance(loop, motion, step, count, recorder, row, bad, thread, threads, gate):
    """See `ThreadedLoop._work`; motion has a MOTION for each kind."""
    k, end, meetings, V = step, step + count, 0, loop.params.fleet.bodies.shape[0]
    share = max(1, V // (BLOCK * threads * _TURNS))  # blocks that lie side by side, which caches like
    while k < end:
        span, sample = min(loop.params.per_law - k % loop.params.per_law, end - k), next_row(loop, k, recorder, row)
        if not begin_span(loop, k, recorder, sample, thread, threads, meetings, gate):
            return
        block = take(gate, share, threads)
        while block * BLOCK < V:
            for first in range(block * BLOCK, min((block + share) * BLOCK, V), BLOCK):
                last = min(first + BLOCK, V)
                if not advance_block(loop, motion, first, last, k, span, recorder.log, sample, bad):
                    fail(gate)
            block = take(gate, share, threads)
        if not end_span(threads, meetings, gate):
            return
        k, row, meetings = k + span, row + (sample >= 0), meetings + 2


@jit
def command_all(loop, t):
    """Let every vehicle measure and command at time t, s."""
    params, state = loop
    V = params.fleet.bodies.shape[0]
    advance_medium(params.medium, t, 0, V, state.medium)
    for v in range(V):
        sense_and_command(loop, v)


class Fused(ThreadedLoop):
    """A scenario on bodies that this module moves. It has no contacts, and takes no forces from outside."""

    def _prepare(self) -> None:
        super()._prepare()
        self._motion = pack_motion(kinds_of(self._vehicles)[0], self._timestep)

    @property
    def compiled(self) -> tuple[Loop, NDArray[np.void]]:
        """What compiled code is given: the loop, and a MOTION for each kind of vehicle."""
        return self._loop, self._motion

    def adopt(self, loop: Loop) -> None:
        """Go on in another place of memory: with a loop that is a copy of this one's."""
        self._loop = loop

    def _command(self) -> None:
        command_all(self._loop, self.time)

    def _work(
        self, loop: Loop, step: int, count: int, recorder: Recorder, row: int, thread: int, gate: IntArray
    ) -> None:
        advance(loop, self._motion, step, count, recorder, row, self._bad, thread, self._crew.count, gate)
