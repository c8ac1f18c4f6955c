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
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from mjsheaf.arrays import Array
from mjsheaf.control.controller import Controller, Law
from mjsheaf.control.law import new_memory
from mjsheaf.dynamics.disturbance import evaluate_sines
from mjsheaf.jit import inline_jit, jit
from mjsheaf.simulation.bodies import kinds_of, pack_fleet
from mjsheaf.simulation.loop import (
    HUGE,
    ClosedLoop,
    Loop,
    Recorder,
    close_loop,
    place_targets,
    record,
    sense_and_command,
)
from mjsheaf.system import Phase, System
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
    ]
)

_ARRIVED, _NEXT, _FAILED = 0, 16, 32  # places in a gate, in cache lines of their own
_CHUNK = 2_000_000  # steps times vehicles in one call: long enough for threads to find a processor each
_BLOCK = 8  # vehicles that a thread takes at a time
_PATIENCE = 1000  # looks at a gate before another process may have the processor
_SMALL = 0.01  # rad^2: square of half a turn up to which its sine and cosine are short series


def pack_motion(vehicles: Sequence[Vehicle], damping: Array, timestep: float) -> NDArray[np.void]:
    """A MOTION for each kind of vehicle, of which the joint takes damping (K, 6), in a step of so many s."""
    motion = np.zeros(len(vehicles), MOTION)
    for one, vehicle, taken in zip(motion, vehicles, damping, strict=True):
        one["inverse"] = np.linalg.inv(vehicle.rigid_mass + timestep * np.diag(taken))
        one["inertia"], one["damping"] = vehicle.inertia, taken[3:]
        one["weight"], one["weight_moment"] = vehicle.weight - vehicle.ballast, vehicle.weight_moment
        one["mass_moment"] = vehicle.mass * vehicle.centre_of_mass
    return motion


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


def _generate_fetch_add(typing: Any, array: Any, index: Any, amount: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind, of = signature.args[0], context.make_array(signature.args[0])(context, builder, arguments[0])
        place = cgutils.get_item_pointer(context, builder, kind, of, [arguments[1]], wraparound=False)
        return builder.atomic_rmw("add", place, arguments[2], "seq_cst")

    return types.int64(array, types.int64, types.int64), generate


_fetch_add: Any = intrinsic(_generate_fetch_add)
"""_fetch_add(array, index, amount): add to an entry of integers atomically; gives what was there before."""

_sched_yield = types.ExternalFunction("sched_yield", types.int32())


@inline_jit
def _wait(gate, arrivals, threads):
    """Arrive, and wait until so many have."""
    if threads > 1:
        _fetch_add(gate, _ARRIVED, 1)
        looks = 0
        while _fetch_add(gate, _ARRIVED, 0) < arrivals:
            looks += 1
            if looks > _PATIENCE:
                _sched_yield()


@jit
def advance_block(loop, motion, first, last, step, count, log, row):
    """Move vehicles from first up to last by `count` steps from step number `step`.

    Their samples before the first step are recorded as `row` of the log, unless that is negative.

    Returns:
        Which of them had a bad command or a bad state first, and at which step; (-1, -1) if none had.
    """
    for k in range(step, step + count):
        evaluate_sines(loop.medium.harmonics, loop.start + k * loop.timestep, first, last, loop.sines)
        for v in range(first, last):
            body = loop.fleet.bodies[v]
            R, omega, force, moment = sense_and_command(loop, v)
            if k == step and row >= 0:
                record(loop, log, row, v, v + 1)
            good, force, moment = apply_actuators(loop, body, force, moment)
            if not good:
                return v, k
            if not move(motion[body.kind], body, R, omega, force, moment, loop.timestep, loop.qpos, loop.qvel):
                return v, k + 1
    return -1, -1


@inline_jit
def apply_actuators(loop, body, force, moment):
    """Add to force and moment what a vehicle's actuators make of its commands, and go on with their activations.

    Returns:
        Whether all commands are good; force and moment, body axes, (3,) each.
    """
    kind, good = loop.fleet.kinds[body.kind], True
    channels = loop.fleet.thrusters[kind.thruster : kind.thruster + kind.count]
    ctrl, act = loop.ctrl[body.actuator : body.actuator + kind.count], loop.act[body.state :]
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
    """What one of several threads does of `count` steps from step number `step`; see `loop._advance`.

    Args:
        loop: the loop.
        motion: a MOTION for each kind.
        step, count: as there.
        recorder: where samples go, the next of them as `row`.
        bad: the step at which each vehicle's state was bad, shape (V,), written where it was.
        thread, threads: which of how many; thread 0 evaluates the law.
        gate: where they wait for one another, zeros before.
    """
    k, end, gates, V = step, step + count, 0, loop.fleet.bodies.shape[0]
    while k < end:
        span = min(loop.per_law - k % loop.per_law, end - k)
        recorded = k % loop.per_sample == 0 and row < recorder.log.positions.shape[0]
        if thread == 0:
            if recorded:
                place_targets(loop.fleet, loop.qpos, loop.x, recorder)
            if k % loop.per_law == 0:
                close_loop(loop, loop.start + k * loop.timestep, True, 0)
            if recorded:
                recorder.written[0] = row + 1
            gate[_NEXT] = 0
        gates += 1
        _wait(gate, gates * threads, threads)
        first = _fetch_add(gate, _NEXT, _BLOCK) if threads > 1 else 0
        while first < V:
            last = min(first + _BLOCK, V)
            v, at = advance_block(loop, motion, first, last, k, span, recorder.log, row if recorded else -1)
            if v >= 0:
                bad[v] = at
                gate[_FAILED] = 1
            first = _fetch_add(gate, _NEXT, _BLOCK) if threads > 1 else first + _BLOCK
        gates += 1
        _wait(gate, gates * threads, threads)
        if gate[_FAILED]:
            return
        k += span
        row += recorded


class Fused(ClosedLoop):
    """A scenario on bodies that this module moves. It has no contacts, and takes no forces from outside."""

    def __init__(
        self,
        run: System | Sequence[Phase],
        *,
        controller: Law | Controller | None = None,
    ) -> None:
        """Put every vehicle at its initial position and heading.

        Args:
            run: the System that a scenario describes, or the phases of a run.
            controller: as of `World`.

        Raises:
            InputError: as of `World`; or there are contacts.
        """
        super().__init__(run, controller, 0)
        plan, vehicles = self.system.bodies, self._vehicles
        plan.require_engine()
        kinds, number = kinds_of(vehicles)
        damping = np.array([vehicle.joint_damping(plan.timestep) for vehicle in kinds])
        fleet = pack_fleet(vehicles, damping[number], plan.heading, plan.surface_height, self._timestep)
        of_kind = [fleet.thrusters[kind["thruster"] : kind["thruster"] + kind["count"]] for kind in fleet.kinds]
        channels = np.concatenate([of_kind[k] for k in number])
        late = channels["late"] > 0
        V, control, medium = len(vehicles), self._control(), self.system.medium
        self._motion = pack_motion(kinds, damping, self._timestep)
        self._count, self._bad = 0, np.empty(V, dtype=np.int64)
        self._chunk = max(1, min(4000, _CHUNK // V))
        self._threads = max(1, min(plan.threads, V // _BLOCK))
        self._pool = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 else None
        self._begin(
            Loop(
                control=control,
                medium=medium,
                fleet=fleet,
                qpos=np.zeros(7 * V),
                qvel=np.zeros(6 * V),
                qacc=np.zeros(0),
                ctrl=np.zeros(len(channels)),
                act=np.zeros(int(late.sum())),
                applied=np.zeros(6 * V),
                gear=np.zeros((len(channels), 6)),
                gain=channels["gain"].reshape(-1, 1).copy(),
                lag=np.where(late, np.cumsum(late) - 1, -1).astype(np.int32),
                x=np.zeros((V, 3)),
                drift=np.zeros((V, 3)),
                memory=new_memory(control.law, V),
                sines=np.zeros(len(medium.harmonics.rate)),
                model=0,
                data=0,
                stopped=np.zeros(V, dtype=np.bool_),
            )
        )
        self._place()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._pool:
            self._pool.shutdown()

    @property
    def _step(self) -> int:
        """Physics steps since the start."""
        return self._count

    def _move(self, loop: Loop, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        """The vehicle that was bad first, and the step."""
        row, gate = int(recorder.written[0]), np.zeros(48, dtype=np.int64)
        self._bad[:] = -1

        def work(thread: int) -> None:
            advance(loop, self._motion, step, count, recorder, row, self._bad, thread, self._threads, gate)

        others = [self._pool.submit(work, n) for n in range(1, self._threads)] if self._pool else []
        work(0)
        for other in others:
            other.result()
        self._count = step + count
        bad = np.flatnonzero(self._bad >= 0)
        if not bad.size:
            return None
        vehicle = bad[np.argmin(self._bad[bad])]
        return int(vehicle), int(self._bad[vehicle])
