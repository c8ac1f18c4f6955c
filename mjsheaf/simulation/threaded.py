"""A closed loop whose vehicles are moved by several threads, which meet before and after each evaluation of the law.

In between vehicles do not know of one another: which thread moves one does not change a bit.
"""

from abc import abstractmethod
from collections.abc import Sequence
from types import TracebackType
from typing import Self

import numpy as np

from mjsheaf.arrays import IntArray
from mjsheaf.control.controller import Controller, Law
from mjsheaf.errors import InputError
from mjsheaf.jit import inline_jit
from mjsheaf.simulation.gate import Crew, failed, refill, wait
from mjsheaf.simulation.loop import ClosedLoop, EngineArrays, Loop, Recorder, place_targets, run_law
from mjsheaf.system import Phase, PhysicsOptions, System

BLOCK = 8
"""Vehicles that a thread takes at a time; fewer are not worth one."""

AT_ONCE = 2_000_000
"""Steps times vehicles in one compiled call, after which Ctrl-C is heard; long enough for threads to find a processor
each."""

NEVER = int(np.iinfo(np.int64).max)
"""When a vehicle was bad that was not: see `ThreadedLoop._work`."""


def crew_size(plan: PhysicsOptions, controlled: bool) -> int:
    """How many threads move a run: one where a law in Python is in control, which it is called for too often."""
    return 1 if controlled else max(1, min(plan.threads, len(plan.vehicle) // BLOCK))


@inline_jit
def begin_span(loop, k, recorder, row, thread, threads, meetings, gate):
    """Evaluate the law where step k is due, on thread 0, while the others wait; return whether to go on.

    Targets are put where the recorder wants them, and the sample counted that is to be `row` of its log, unless that is
    negative.
    """
    if thread == 0:
        if row >= 0:
            place_targets(loop, recorder)
        if k % loop.params.per_law == 0:
            run_law(loop, loop.params.start + k * loop.params.timestep)
        if row >= 0:
            recorder.written[0] = row + 1
        refill(gate)
    return wait(gate, meetings + 1, threads)


@inline_jit
def end_span(threads, meetings, gate):
    """Wait until all vehicles have moved; return whether to go on."""
    return wait(gate, meetings + 2, threads) and not failed(gate)


@inline_jit
def next_row(loop, k, recorder, row):
    """The row of the log for step k, or -1 where it is no sample or there is no room for it."""
    return row if k % loop.params.per_sample == 0 and row < recorder.log.positions.shape[0] else -1


class ThreadedLoop(ClosedLoop):
    """A run without contacts whose state is the loop's own, moved by the threads that its plan names.

    Subclasses call `_start` once they are ready to move. A law in Python keeps them to one thread: between two
    calls, starting others would take longer than they save.
    """

    _at_once = AT_ONCE

    def __init__(self, run: System | Sequence[Phase], controller: Law | Controller | None) -> None:
        """Take over a run; arguments as of `World`.

        Raises:
            InputError: as `World` does; or there are contacts.
        """
        super().__init__(run, controller, 0)
        plan, V = self.system.bodies, len(self._vehicles)
        if plan.contacts:
            raise InputError("physics.contacts: is true; expected false, as only World has contacts")
        channels = self._fleet.channels
        self._bad, self._count = np.empty(V, dtype=np.int64), 0
        self._crew = Crew(crew_size(plan, self._controller is not None))
        self._begin(
            EngineArrays(
                qpos=np.zeros(7 * V),
                qvel=np.zeros(6 * V),
                ctrl=np.zeros(len(channels)),
                act=np.zeros(channels["late"].sum()),
                gain=channels["gain"].reshape(-1, 1).copy(),
            )
        )

    def _start(self) -> None:
        """Put the vehicles where they begin, and compile what threads run, lest one compiles while others wait."""
        self._place()
        self._work(self._loop, 0, 0, self._unrecorded, 0, 0, self._crew.gate())

    @abstractmethod
    def _work(
        self, loop: Loop, step: int, count: int, recorder: Recorder, row: int, thread: int, gate: IntArray
    ) -> None:
        """Do one thread's part of `count` steps from step number `step`.

        Whose state or command is bad first gets 2 k or 2 k + 1 in `_bad`: a state after k steps, or a command there.

        Args:
            loop: the loop.
            step, count: as said.
            recorder, row: where samples go, the next of them as this row.
            thread: which.
            gate: where threads meet; of a count of 0 nobody does.
        """

    @property
    def _step(self) -> int:
        """Physics steps since the start."""
        return self._count

    def _move(self, loop: Loop, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        """The vehicle that was bad first, and the step."""
        row = int(recorder.written[0])
        self._bad[:] = NEVER

        def work(thread: int, gate: IntArray) -> None:
            self._work(loop, step, count, recorder, row, thread, gate)

        self._crew.run(work)
        self._count = step + count
        vehicle = int(np.argmin(self._bad))
        return None if self._bad[vehicle] == NEVER else (vehicle, int(self._bad[vehicle]) // 2)

    def close(self) -> None:
        """End the threads."""
        self._crew.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()
