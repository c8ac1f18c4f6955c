"""Fused engine: one compiled function that moves free vehicles along MuJoCo's trajectory, without MuJoCo.

A vehicle is one rigid body on a free joint. Let R be its attitude, m, c and J its mass, centre of mass and inertia
about the origin, and f and n the force and moment of medium, actuators and weight, in body axes about the origin.
MuJoCo's step of h is

    [[m I + h d, -m [c]], [m [c], J + h D]] [a; alpha] = [f - m omega x (omega x c); n - omega x J omega - D omega]

    v += h R a,   omega += h alpha,   x += h v,   q <- q exp(h omega / 2)

where the free joint integrates the linear damping d and D implicitly (mj_Euler). The loop compensates the explicit part
of d with a force (see `bodies`), so neither is in f. The matrix depends on the kind only and is inverted once. The law
and the commands of a vehicle are the code of MuJoCo's loop; `actuators.actuator_force` and `unit_wrench` convert
commands to forces. `block` has a vehicle's whole step.

Between two evaluations of the law vehicles are independent: each is moved up to the next evaluation in one call, and
the vehicles of a large team are divided among threads. The assignment to threads does not change a bit. Where possible,
neighbours of one kind move side by side: see `block`.
"""

from concurrent.futures import ThreadPoolExecutor, wait
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mjsheaf.arrays import Room
from mjsheaf.compile.jit import INTERPRETED, inline_jit, jit, on_stack
from mjsheaf.compile.tiers import Tiered
from mjsheaf.loop.block import ALONE, advance_alone, advance_lanes, command_alone, end_of_kind, fits_lanes, pack_rigid
from mjsheaf.loop.bodies import kinds_of
from mjsheaf.loop.engine import Recorder
from mjsheaf.loop.loop import NEVER, Bodies, ClosedLoop, Loop, begin_span
from mjsheaf.media.medium import advance as advance_medium

_MOST_NUMBERS = 50_000  # of a loop whose vehicles Python commands: some 150 vehicles
_WORTH_A_THREAD = 25_000  # vehicles times steps between two evaluations of the law: a round takes 0.2 ms


@inline_jit
def advance_block(loop, rigid, first, last, step, count, log, row, bad):
    """Move vehicles from first up to last by `count` steps from step number `step`, fewer where one becomes bad.

    Their samples before the first step are recorded as `row` of the log, unless that is negative. Neighbours of one
    kind move in lanes where they fit, which does not change a bit.

    Returns:
        True if no vehicle became bad; see `Fused._bad` on `bad`.
    """
    return _advance_block(loop.params.fleet.lanes, loop, rigid, first, last, step, count, log, row, bad)


@inline_jit
def _advance_block(lanes, loop, rigid, first, last, step, count, log, row, bad):
    if len(lanes) == 0:  # a matter of types: the rest is not compiled
        return advance_alone(loop, rigid, first, last, step, count, log, row, bad)
    all_good, fleet, helm = True, loop.params.fleet, loop.params.helm
    begin = first
    while begin < last:
        end = end_of_kind(fleet.bodies, begin, last)
        if fits_lanes(fleet, helm, begin, end):
            all_good &= advance_lanes(loop, rigid, begin, end, step, count, log, row, bad)
        else:
            while end < last and not fits_lanes(fleet, helm, end, end_of_kind(fleet.bodies, end, last)):
                end = end_of_kind(fleet.bodies, end, last)
            all_good &= advance_alone(loop, rigid, begin, end, step, count, log, row, bad)
        begin = end
    return all_good


@inline_jit
def advance_blocks(loop, rigid, first, last, step, count, log, row, bad):
    """Move the vehicles of blocks from first up to last; other arguments and the result as for `advance_block`."""
    blocks, all_good = loop.params.fleet.blocks, True
    for b in range(first, last):
        all_good &= advance_block(loop, rigid, blocks[b], blocks[b + 1], step, count, log, row, bad)
    return all_good


@jit
def advance(loop, rigid, count, recorder, bad):
    """Take `count` steps with all vehicles, fewer where one becomes bad.

    Args:
        loop: The closed loop.
        rigid: A RIGID for each kind of vehicle.
        count: Number of steps.
        recorder: Destination of samples.
        bad: See `Fused._bad`.
    """
    params, steps = loop.params, loop.state.steps
    k, B = int(steps[0]), params.fleet.blocks.shape[0] - 1
    end = k + count
    while k < end:
        span = min(params.per_law - k % params.per_law, end - k)
        row = begin_span(loop, k, recorder)
        if not advance_blocks(loop, rigid, 0, B, k, span, recorder.log, row, bad):
            return
        k += span
        steps[0] = k


@jit
def _advance_part(loop, rigid, first, last, step, count, log, row, bad):
    advance_blocks(loop, rigid, first, last, step, count, log, row, bad)


@inline_jit
def command_vehicles(loop, t):
    """Let every vehicle measure and command at time t, s."""
    params, state = loop
    V = params.fleet.bodies.shape[0]
    advance_medium(params.medium, t, 0, V, state.medium)
    b = on_stack(ALONE)
    for v in range(V):
        command_alone(loop, v, b)


command_all = Tiered(command_vehicles, records=True, numbers=_MOST_NUMBERS)
"""`command_vehicles`, for calls by Python."""


class Fused(ClosedLoop):
    """A scenario on bodies that this module moves. It has no contacts, and takes no forces from outside.

    A large team is moved by the threads that its plan names, unless a law in Python is in control: the law is evaluated
    by one thread, then each thread moves a part of the vehicles up to its next evaluation.

    Attributes:
        _bad: Time at which each vehicle was bad, shape (V,): 2 k if its state after k steps is the first that is bad,
            2 k + 1 if its command there is, NEVER if it was good.
    """

    _at_once = 2_000_000
    _in_lanes = True
    _pool: ThreadPoolExecutor | None = None

    def _prepare(self) -> None:
        plan, V = self.system.bodies, len(self._vehicles)
        plan.refuse_contacts()
        self._rigid = pack_rigid(kinds_of(self._vehicles)[0], self._timestep)
        self._bad = np.full(V, NEVER)
        self._gain = self._fleet.channels["gain"].reshape(-1, 1).copy()
        steps = 1 if self.system.grid.continuous else self.steps_per_sample
        threads = min(plan.threads, V * steps // _WORTH_A_THREAD)
        if threads > 1 and not self.controller and not INTERPRETED:
            self._pool = ThreadPoolExecutor(threads)
            self._ends = (np.arange(threads + 1) * (len(self._fleet.blocks) - 1) // threads).tolist()

    def _bodies(self, room: Room) -> Bodies:
        V = len(self._vehicles)
        return room.take(7 * V), room.take(6 * V), room.take(len(self._gain)), room.take(len(self._act))

    @property
    def compiled(self) -> tuple[Loop, NDArray[np.void]]:
        """Arguments of the compiled code: the loop, and a RIGID for each kind of vehicle."""
        return self._loop, self._rigid

    def continue_in(self, room: Room) -> Loop:
        """Continue with a copy of the loop in a room, and return that; see `loop_in`."""
        self._loop = self.loop_in(room)
        self._values = room.since(0)[: len(self._values)]
        self._count = self._loop.state.steps
        return self._loop

    def _command(self) -> None:
        command_all(self._loop, self.time)

    def _move(self, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        self._bad[:] = NEVER
        if self._pool is None:
            advance(self._loop, self._rigid, count, recorder, self._bad)
        else:
            # Not by this thread, where Ctrl-C would leave some vehicles behind.
            moving = self._pool.submit(self._move_in_parts, self._pool, step + count, recorder)
            try:
                wait([moving])
            finally:
                moving.result()
        self._count[0] = step + count  # also where a vehicle is bad and its span does not count
        vehicle = int(np.argmin(self._bad))
        return None if self._bad[vehicle] == NEVER else (vehicle, int(self._bad[vehicle]) // 2)

    def _move_in_parts(self, pool: ThreadPoolExecutor, end: int, recorder: Recorder) -> None:
        """Do what `advance` does up to step `end`; each thread moves a part of the vehicles."""
        params, log = self._loop.params, recorder.log
        while self.steps_taken < end and self._bad.min() == NEVER:
            k = self.steps_taken
            span = min(params.per_law - k % params.per_law, end - k)
            row = begin_span(self._loop, k, recorder)
            others = [
                pool.submit(_advance_part, self._loop, self._rigid, first, last, k, span, log, row, self._bad)
                for first, last in pairwise(self._ends[1:])
            ]
            _advance_part(self._loop, self._rigid, 0, self._ends[1], k, span, log, row, self._bad)
            for other in others:
                other.result()
            self._count[0] = k + span

    def close(self) -> None:
        """End the threads."""
        pool, self._pool = self._pool, None  # what follows moves on one thread
        if pool is not None:
            pool.shutdown()
