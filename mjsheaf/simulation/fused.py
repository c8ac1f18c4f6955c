"""Fused engine: one compiled function that moves free vehicles along MuJoCo's trajectory, without MuJoCo.

A vehicle is one rigid body on a free joint. Let R be its attitude, m, c and J its mass, centre of mass and inertia
about the origin, and f and n the force and moment of medium, actuators and weight, in body axes about the origin.
MuJoCo's step of h is

    [[m I + h d, -m [c]], [m [c], J + h D]] [a; alpha] = [f - m omega x (omega x c); n - omega x J omega - D omega]

    v += h R a,   omega += h alpha,   x += h v,   q <- q exp(h omega / 2)

where the free joint integrates the linear damping d and D implicitly (mj_Euler). The loop compensates the explicit part
of d with a force (see `bodies`), so neither is in f. The matrix depends on the kind only and is inverted once. The law
and the commands of a single vehicle are the code of MuJoCo's loop; `actuators.actuator_force` and `unit_wrench` convert
commands to forces. `lanes` takes the same steps for several vehicles at a time, from the same elementary functions;
`tests/backends/test_fused.py` holds it to the bits of this module.

Between two evaluations of the law vehicles are independent: each is moved up to the next evaluation in one call, and
vehicles are divided among threads. The assignment to threads does not change a bit. Where possible, neighbours of one
kind move side by side: see `lanes`.
"""

import numpy as np
from numpy.typing import NDArray

from mjsheaf.arrays import IntArray
from mjsheaf.jit import inline_jit, jit, on_stack
from mjsheaf.media.medium import advance as advance_medium
from mjsheaf.simulation.block import ALONE, advance_alone, advance_lanes, command_alone, end_of_kind, fits_lanes
from mjsheaf.simulation.bodies import kinds_of
from mjsheaf.simulation.engine import Recorder
from mjsheaf.simulation.gate import fail, take
from mjsheaf.simulation.loop import Loop, finish_law
from mjsheaf.simulation.motion import pack_motion
from mjsheaf.simulation.threaded import ThreadedLoop, begin_span, end_span, next_row
from mjsheaf.tiers import Tiered

_MOST_NUMBERS = 50_000  # of a loop whose vehicles Python commands: some 150 vehicles


@inline_jit
def advance_block(loop, motion, first, last, step, count, log, row, bad):
    """Move vehicles from first up to last by `count` steps from step number `step`, fewer where one becomes bad.

    Their samples before the first step are recorded as `row` of the log, unless that is negative. Neighbours of one
    kind move in lanes where they fit, which does not change a bit.

    Returns:
        True if no vehicle became bad; see `ThreadedLoop._work` on `bad`.
    """
    all_good, fleet, helm = True, loop.params.fleet, loop.params.helm
    begin = first
    while begin < last:
        end = end_of_kind(fleet.bodies, begin, last)
        if fits_lanes(fleet, helm, begin, end):
            all_good &= advance_lanes(loop, motion, begin, end, step, count, log, row, bad)
        else:
            while end < last and not fits_lanes(fleet, helm, end, end_of_kind(fleet.bodies, end, last)):
                end = end_of_kind(fleet.bodies, end, last)
            all_good &= advance_alone(loop, motion, begin, end, step, count, log, row, bad)
        begin = end
    return all_good


@jit
def advance(loop, motion, steps, count, recorder, row, bad, thread, threads, gate):
    """See `ThreadedLoop._work`; motion has a MOTION for each kind, and steps (1,) the number of the first step."""
    k, end, meetings, blocks = steps[0], steps[0] + count, 0, loop.params.fleet.blocks
    B, joint = blocks.shape[0] - 1, loop.params.control.stages.joint
    while k < end:
        span = min(loop.params.per_law - k % loop.params.per_law, end - k)
        sample = next_row(loop.params.per_sample, k, recorder.log.positions, row)
        if not begin_span(loop, k, recorder, sample, thread, threads, meetings, gate):
            return
        block = take(gate, thread, threads, B)
        while block >= 0:
            first, last = blocks[block], blocks[block + 1]
            finish_law(joint, loop, k, first, last)
            if not advance_block(loop, motion, first, last, k, span, recorder.log, sample, bad):
                fail(gate)
            block = take(gate, thread, threads, B)
        if not end_span(steps, k + span, thread, threads, meetings, gate):
            return
        k, row, meetings = k + span, row + (sample >= 0), meetings + 3


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


class Fused(ThreadedLoop):
    """A scenario on bodies that this module moves. It has no contacts, and takes no forces from outside."""

    def _prepare(self) -> None:
        super()._prepare()
        self._motion = pack_motion(kinds_of(self._vehicles)[0], self._timestep)

    @property
    def compiled(self) -> tuple[Loop, NDArray[np.void]]:
        """Arguments of the compiled code: the loop, and a MOTION for each kind of vehicle."""
        return self._loop, self._motion

    def adopt(self, loop: Loop, steps: IntArray | None = None) -> None:
        """Continue with a copy of this loop in another place in memory, where `steps`, shape (1,), counts its steps."""
        self._loop = loop
        if steps is not None:
            self._count = steps

    def _command(self) -> None:
        command_all(self._loop, self.time)

    def _work(self, loop: Loop, count: int, recorder: Recorder, row: int, thread: int, gate: IntArray) -> None:
        advance(loop, self._motion, self._count, count, recorder, row, self._bad, thread, self._thread_team.count, gate)
