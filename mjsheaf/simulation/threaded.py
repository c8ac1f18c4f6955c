"""A closed loop whose vehicles are moved by several threads, which share the law and meet between its parts.

In between vehicles do not know of one another: which thread moves one does not change a bit.
"""

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import InputError
from mjsheaf.jit import INTERPRETED, inline_jit
from mjsheaf.simulation.engine import Recorder
from mjsheaf.simulation.gate import ThreadTeam, failed, refill, wait
from mjsheaf.simulation.loop import (
    ClosedLoop,
    EngineArrays,
    Loop,
    controlled_positions,
    place_targets,
    share_law,
)
from mjsheaf.system import PhysicsOptions

_MIN_VEHICLES = 8  # that are worth a thread

AT_ONCE = 2_000_000
"""Steps times vehicles in one compiled call; Ctrl-C takes effect between calls. A call is long enough for each thread
to get a processor."""

NEVER = int(np.iinfo(np.int64).max)
"""When a vehicle was bad that was not: see `ThreadedLoop._work`."""


def thread_count(plan: PhysicsOptions, controlled: bool) -> int:
    """Return how many threads move a run.

    One if a law in Python is in control, which is called too often for more, or if nothing is compiled.
    """
    if controlled or INTERPRETED:
        return 1
    return max(1, min(plan.threads, len(plan.vehicle) // _MIN_VEHICLES))


@inline_jit
def begin_span(loop, k, recorder, row, thread, threads, meetings, gate):
    """Do a thread's share of what comes before step k; return True to continue.

    Targets are placed for the recorder, and the sample that becomes `row` of its log is counted, unless `row` is
    negative; the law is evaluated if it is due, but for what `finish_law` does.
    """
    params, state = loop
    V = params.fleet.bodies.shape[0]
    first, last, due = V * thread // threads, V * (thread + 1) // threads, k % params.per_law == 0
    if row >= 0:
        place_targets(params.fleet, state.qpos, state.x, recorder, first, last)
    if due:
        controlled_positions(params.fleet, state.qpos, first, last, state.x)
    if not wait(gate, meetings + 1, threads):
        return False
    if thread == 0:
        refill(gate, threads)
        if row >= 0:
            recorder.written[0] = row + 1
    if due:
        share_law(params.control.stages.joint, loop, params.start + k * params.timestep, thread, threads)
    return wait(gate, meetings + 2, threads)


@inline_jit
def end_span(steps, k, thread, threads, meetings, gate):
    """Wait until all vehicles have moved up to step k, which is written to `steps`; return True to continue.

    Ctrl-C takes effect when compiled code returns, before Python could count what it did.
    """
    if not wait(gate, meetings + 3, threads) or failed(gate):
        return False
    if thread == 0:
        steps[0] = k
    return True


@inline_jit
def next_row(per_sample, k, positions, row):
    """The row of the log for step k, or -1 where it is no sample or there is no room for it."""
    return row if k % per_sample == 0 and row < positions.shape[0] else -1


def first_bad(bad: IntArray) -> tuple[int, int] | None:
    """Return the vehicle that was bad first and the number of its step, from `ThreadedLoop._work`; None if none was."""
    vehicle = int(np.argmin(bad))
    return None if bad[vehicle] == NEVER else (vehicle, int(bad[vehicle]) // 2)


class ThreadedLoop(ClosedLoop):
    """A run without contacts whose state is the loop's own, moved by the threads that its plan names.

    Subclasses must implement `_work`. A law in Python keeps them to one thread: between two calls, starting others
    would take longer than they save.
    """

    _at_once = AT_ONCE

    def _prepare(self) -> None:
        plan = self.system.bodies
        if plan.contacts:
            raise InputError("physics.contacts: is true; expected false, as only World has contacts")
        V = len(self._vehicles)
        channels = self._fleet.channels
        self._count = np.zeros(1, dtype=np.int64)
        self._arrays = EngineArrays(
            qpos=np.zeros(7 * V),
            qvel=np.zeros(6 * V),
            ctrl=np.zeros(len(channels)),
            act=np.zeros(channels["late"].sum()),
            gain=channels["gain"].reshape(-1, 1).copy(),
        )
        self._bad = np.empty(V, dtype=np.int64)
        self._thread_team = ThreadTeam(thread_count(plan, self.controller is not None))

    def reset(self) -> None:
        """Go back to the initial condition; compile what threads run, lest one compiles while others wait."""
        arrays = self._arrays
        for values in (self._count, arrays.qpos, arrays.qvel, arrays.ctrl, arrays.act):
            values[:] = 0
        super().reset()
        self._work(self._loop, 0, self._unrecorded, 0, 0, self._thread_team.gate())

    def _state_arrays(self) -> EngineArrays:
        return self._arrays

    @abstractmethod
    def _work(self, loop: Loop, count: int, recorder: Recorder, row: int, thread: int, gate: IntArray) -> None:
        """Do one thread's part of the next `count` steps, and let the first thread count them in `_count`.

        A vehicle's entry of `_bad` is 2 k if its state after k steps is the first that is bad, and 2 k + 1 if its
        command there is.

        Args:
            loop: Loop of the present phase.
            count: Number of steps; with 0, no thread waits for another.
            recorder: Destination of samples.
            row: Row of the next sample.
            thread: Number of the thread.
            gate: Gate at which threads meet.
        """

    @property
    def steps_taken(self) -> int:
        """Number of physics steps since the start."""
        return int(self._count[0])

    @property
    def _moving(self) -> Sequence[Array | IntArray]:
        state = self._loop.state
        return self._count, state.qpos, state.qvel, state.ctrl, state.act

    def _move(self, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        row = int(recorder.written[0])
        self._bad[:] = NEVER

        def work(thread: int, gate: IntArray) -> None:
            self._work(self._loop, count, recorder, row, thread, gate)

        self._thread_team.run(work)
        self._count[0] = step + count  # also where a vehicle is bad and its span does not count
        return first_bad(self._bad)

    def close(self) -> None:
        """End the threads."""
        self._thread_team.close()
