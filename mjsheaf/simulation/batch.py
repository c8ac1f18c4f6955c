"""Simulate many runs of one team with one kernel and keep their scores.

Each run is a world (see `rows`). Its scores are the errors at the end and over the second half, and the fraction of a
bound that it reached (see `scores`). Processor threads and a GPU both run `run_world`.
"""

from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from functools import partial
from threading import Event
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from mjsheaf.arguments import require_type, require_whole
from mjsheaf.arrays import Array, IntArray
from mjsheaf.control.custom import naming_terms
from mjsheaf.errors import InputError
from mjsheaf.jit import inline_jit, jit
from mjsheaf.simulation.fused import Fused, advance_block
from mjsheaf.simulation.gate import ThreadTeam
from mjsheaf.simulation.gate import wait as meet  # a GPU has its own
from mjsheaf.simulation.loop import Loop, blow_up_of, run_law
from mjsheaf.simulation.rows import Rows
from mjsheaf.simulation.scores import (
    DISAGREEMENT,
    LATE_DISAGREEMENT,
    LATE_TRACKING,
    RATIO,
    SETTLED_RATIO,
    TAKEN,
    TRACKING,
    Goal,
    Scores,
    goal_of,
    require_scorable,
    score,
    square_error,
)
from mjsheaf.simulation.threaded import AT_ONCE, NEVER
from mjsheaf.simulation.trajectory import new_log
from mjsheaf.system import Phase


@jit
def run_world(loop, motion, goal, scores, nothing, w, there, begin, end, member, members, gate):
    """Do one member's share of world w from sample `begin` up to `end`, each with the steps after it.

    A world is simulated by one or more threads, its members. Member 0 evaluates the law and writes the scores. Agents,
    and vehicles in blocks, are divided among all members. Every member reaches the same barriers, even if its world has
    diverged or does not exist, because on a GPU the members of many worlds share a barrier.

    Args:
        loop: Loop of the world.
        motion: A MOTION for each kind of vehicle.
        goal, scores: Goal and scores of the batch; see `scores`.
        nothing: Log without samples.
        w: Number of the world.
        there: True if the world exists.
        begin, end: Range of samples; after the goal's last sample no step is taken.
        member, members: Number of this member, and number of members.
        gate: Barrier of the members, in its initial state.
    """
    params = loop.params
    N, meetings = goal.first.shape[0] - 1, 0
    for n in range(begin, end):
        last = n + 1 == goal.samples
        for part in range(1 if last else params.per_sample // params.per_law):
            k = n * params.per_sample + part * params.per_law
            if there and member == 0 and scores.ended[w, 0] < 0:
                run_law(loop, params.start + k * params.timestep)
            if not meet(gate, meetings + 1, members):
                return
            alive = there and scores.ended[w, 0] < 0
            if alive and part == 0:
                for i in range(member, N, members):
                    scores.squares[w, i] = square_error(goal, loop.state.x, i)
            if alive and not last:
                advance_share(loop, motion, k, nothing, scores.bad[w], member, members)
            if not meet(gate, meetings + 2, members):
                return
            if alive and member == 0:
                if part == 0:
                    score(goal, scores, w, n, loop)
                keep_first(scores.bad[w], scores.ended[w])
            meetings += 2


@inline_jit
def advance_share(loop, motion, k, nothing, bad, member, members):
    """Move a member's share of the vehicles of a world, in blocks, up to the next evaluation of the law."""
    blocks = loop.params.fleet.blocks
    for b in range(member, blocks.shape[0] - 1, members):
        advance_block(loop, motion, blocks[b], blocks[b + 1], k, loop.params.per_law, nothing, -1, bad)


@inline_jit
def keep_first(bad, ended):
    """Write the vehicle that was bad first, and when, into `ended`, if one was."""
    for v in range(bad.shape[0]):
        if bad[v] != NEVER and (ended[0] < 0 or bad[v] < ended[1]):
            ended[0], ended[1] = v, bad[v]


class Outcome(NamedTuple):
    """Outcome of a world.

    Attributes:
        message: Vehicle, place and time of a divergence; empty if there was none.
        samples: Number of samples taken.
        tracking_error, mean_disagreement: Errors of the team at the last sample: RMS of |q*_i - q_i|, mean |eta_i|, m.
        late_tracking_error, late_mean_disagreement: RMS of both over the second half; None if the run diverged.
        ratio, settled_ratio: Maximum of |e| over its bound after the start, and over the second half; None without a
            bound.
    """

    message: str
    samples: int
    tracking_error: float
    mean_disagreement: float
    late_tracking_error: float | None
    late_mean_disagreement: float | None
    ratio: float | None
    settled_ratio: float | None


def require_world(run: Fused) -> None:
    """Refuse a run that no batch takes.

    Raises:
        InputError: it has events or another phase, a law in Python, or a team that is too large to be scored this way.
    """
    require_type("run", run, Fused, "a Fused run, at its start")
    require_phases(run.phases)
    if run.controller:
        raise InputError("controller: a law in Python; expected the agents' own in a batch, which calls no Python")


def require_phases(phases: Sequence[Phase]) -> None:
    """Refuse the phases of a run that no batch takes.

    Raises:
        InputError: There is more than one or an event, or the team is too large to be scored this way.
    """
    first, *later = phases
    if later or first.events:
        what = first.events[0] if first.events else f"{later[0].name} at {later[0].time:g} s"
        raise InputError(f"events: {what}; expected none in a batch, whose runs keep their edges")
    require_scorable(first.system)


class Batch:
    """Worlds of one team, at their start.

    Attributes:
        rows: the worlds.
        goal, scores: see there.
        nothing: a Log without samples.
    """

    def __init__(
        self,
        runs: Sequence[Fused],
        bounds: Sequence[Array] | None = None,
        *,
        order: Literal["C", "F"] = "C",
        number: DTypeLike = np.float64,
    ) -> None:
        """Lay out the worlds.

        Args:
            runs: Runs of one team at their start, which are copied. A unique q* is not required here.
            bounds: Bound on |e| of each run at every sample, including the error that counts as none, shape (T,), above
                0 m; runs may share one. Infinite bounds have no effect. Without bounds, no ratio is computed.
            order, number: Layout and number type, as for `Rows`.

        Raises:
            InputError: As for `Rows` and `require_world`; or the number of bounds is not that of the runs, or a bound
                has another length or is not above 0.
        """
        runs = list(runs)
        for run in runs:
            require_world(run)
        self.rows = Rows(runs, order=order, number=number)
        self._systems = [run.system for run in runs]
        system, W = self._systems[0], len(self.rows.values)
        N, V, T = len(system.team.agents), len(system.team.members), system.grid.steps + 1
        which, several = _distinct(
            [np.full(T, np.inf)] * len(runs) if bounds is None else _checked(bounds, len(runs), T)
        )
        self.goal: Goal = self.rows.in_numbers(goal_of(system, several))
        kind, linked = self.rows.values.dtype, len(system.law.links.of) > 0
        self.scores = Scores(
            bound=np.resize(which, W),
            squares=np.zeros((W, N), order=order),
            y=np.zeros((W, len(system.law.edges.b) * linked), kind, order),
            eta=np.zeros((W, V * linked, 3), kind, order),
            bad=np.full((W, V), NEVER, order=order),
            found=np.zeros((W, 7), order=order),
            ended=np.full((W, 2), -1, dtype=np.int64, order=order),
        )
        self.nothing = self.rows.in_numbers(new_log(0, system.law, actuators=self.rows.loop.state.ctrl.shape[1]))

    def __len__(self) -> int:
        return len(self._systems)

    @property
    def chunk(self) -> int:
        """Number of samples between two checks for the end."""
        params = self.rows.loop.params
        return max(1, AT_ONCE // (params.per_sample * len(params.fleet.bodies)))

    def run(self, threads: int = 1, members: int = 1) -> None:
        """Run all worlds to their end; see `each`."""
        for _ in self.each(threads, members):
            pass

    def each(self, threads: int = 1, members: int = 1) -> Generator[int]:
        """Run all worlds, once, on threads of this machine; the results do not depend on their number.

        Args:
            threads: Number of worlds at a time.
            members: Number of threads that share each world.

        Yields:
            The number of each world as it ends, in any order.

        Raises:
            InputError: threads or members below 1; or the worlds are at their end.
        """
        require_whole("threads", threads, 1)
        require_whole("members", members, 1)
        if self.scores.found[:, TAKEN].any():
            raise InputError("a batch runs once; expected a new one")
        T, chunk, stop, rows = self.goal.samples, self.chunk, Event(), self.rows

        def one(w: int) -> None:
            system, loop, thread_team = self._systems[w], rows.loop_of(w), ThreadTeam(members)
            try:
                for begin in range(0, T, chunk):
                    if stop.is_set():
                        return
                    with naming_terms(system.law.custom, system.team, loop.state.memory.evaluated):
                        thread_team.run(partial(part, loop, w, begin, min(begin + chunk, T)))
            finally:
                thread_team.close()

        def part(loop: Loop, w: int, begin: int, end: int, member: int, gate: IntArray) -> None:
            goal, scores, nothing = self.goal, self.scores, self.nothing
            run_world(loop, rows.motion, goal, scores, nothing, w, True, begin, end, member, members, gate)

        part(rows.loop_of(0), 0, 0, 0, 0, ThreadTeam.gate())  # compiles, lest a member does while others wait
        with ThreadPoolExecutor(threads) as pool:
            try:
                futures = {pool.submit(one, w): w for w in range(len(self))}
                for future in as_completed(futures):
                    future.result()
                    yield futures[future]
            finally:
                stop.set()

    def outcomes(self) -> list[Outcome]:
        """Return the outcomes of all worlds after the run; see `outcome`."""
        return [self.outcome(w) for w in range(len(self))]

    def outcome(self, w: int) -> Outcome:
        """Return the outcome of a world after its run.

        Raises:
            InputError: The world has not run.
        """
        found, goal, (vehicle, when) = self.scores.found[w], self.goal, self.scores.ended[w]
        if found[TAKEN] < goal.samples and vehicle < 0:
            raise InputError(f"run {w} of the batch is not at its end; expected `run` before")
        message = ""
        if vehicle >= 0:
            message = blow_up_of(self._systems[w], self.rows.loop_of(w), int(vehicle), int(when) // 2)
        late = np.sqrt(found[[LATE_TRACKING, LATE_DISAGREEMENT]] / (goal.samples - goal.half))
        bounded = not message and bool(np.isfinite(goal.bounds[self.scores.bound[w]]).any())
        return Outcome(
            message,
            int(found[TAKEN]),
            float(found[TRACKING]),
            float(found[DISAGREEMENT]),
            None if message else float(late[0]),
            None if message else float(late[1]),
            float(found[RATIO]) if bounded else None,
            float(found[SETTLED_RATIO]) if bounded else None,
        )


def _checked(bounds: Sequence[Array], runs: int, samples: int) -> list[Array]:
    """Bounds as arrays.

    Raises:
        InputError: see `Batch`.
    """
    if len(bounds) == runs and all(np.shape(bound) == (samples,) for bound in bounds):
        with suppress(TypeError, ValueError):
            found = [np.asarray(bound, dtype=np.float64) for bound in bounds]
            if all((bound > 0.0).all() for bound in found):
                return found
    shapes = f"{len(bounds)} bounds of shapes {sorted({np.shape(bound) for bound in bounds})}"
    raise InputError(f"bounds: {shapes}; expected one for each of {runs} runs, of shape ({samples},) and above 0 m")


def _distinct(bounds: Sequence[Array]) -> tuple[IntArray, Array]:
    """Return the index of each array among the distinct ones, and the distinct arrays, shape (U, T)."""
    found = dict[bytes, tuple[int, Array]]()
    which = [found.setdefault(one.tobytes(), (len(found), one))[0] for one in bounds]
    return np.array(which, dtype=np.int64), np.array([one for _, one in found.values()])
