"""Worlds: runs of one team that take a control period at a time, for environments, without Python in between.

What a world has of its own is a row of one array: the state of a run, and the constants that depend on its seed.
Passing a whole Loop from Python to compiled code takes as long as a period of a small team. Therefore one Loop stands
for all worlds: each row is copied into the memory of that Loop, takes its period there, and is copied back. So worlds
go through the very functions of the fused engine, and each ends bit for bit as it does alone.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mjsheaf.arrays import BoolArray, IntArray, Room, lay_out, leaves_of, mapped
from mjsheaf.errors import InputError
from mjsheaf.jit import inline_jit, jit
from mjsheaf.law.custom import naming_terms
from mjsheaf.law.law import look, unlook
from mjsheaf.loop.fused import Fused, advance_blocks, command_vehicles
from mjsheaf.loop.loop import NEVER, Params, blow_up_of, is_seeded, run_law, seeded_of, with_seeded
from mjsheaf.loop.scores import goal_of, require_scorable, square_errors
from mjsheaf.loop.trajectory import new_log


@jit
def take_periods(loop, row, motion, goal, nothing, values, alive, bad, squares):
    """Take one control period in every world that is alive, and measure at its end.

    Args:
        loop: A loop of the worlds' team, whose own numbers lie in `row`.
        row: Numbers of one world, shape (n,).
        motion: A MOTION for each kind of vehicle.
        goal: Goal of the errors; see `scores`.
        nothing: Log without samples.
        values: Rows of the worlds, shape (W, n).
        alive: True for each world that takes a period, shape (W,).
        bad: Time at which each vehicle diverged, NEVER if it did not, shape (W, V); see `Fused._bad`.
        squares: Squared errors |q*_i - q_i|^2 of the agents, shape (W, N), m^2. A world that diverges keeps its own.
    """
    for w in range(values.shape[0]):
        if not alive[w]:
            continue
        for k in range(row.shape[0]):
            row[k] = values[w, k]
        if take_period(loop, motion, nothing, bad[w]):
            square_errors(goal, loop.state.x, squares[w])
        for k in range(row.shape[0]):
            values[w, k] = row[k]


@jit
def begin_periods(loop, row, values, which):
    """Evaluate the law at the start, and command, in the worlds `which`; other arguments as for `take_periods`."""
    start = loop.params.start
    for w in which:
        for k in range(row.shape[0]):
            row[k] = values[w, k]
        look(0.0, loop.state.memory.held, loop.state.memory.kept)
        run_law(loop, start)
        command_vehicles(loop, start)
        for k in range(row.shape[0]):
            values[w, k] = row[k]


@inline_jit
def take_period(loop, motion, nothing, bad):
    """Take the next control period, and evaluate the law at its end.

    Args:
        loop, motion, nothing: See `take_periods`.
        bad: Time at which each vehicle diverged, shape (V,).

    Returns:
        False if a vehicle diverged: then the steps of the period do not count.
    """
    params, memory = loop.params, loop.state.memory
    k, B = int(loop.state.steps[0]), params.fleet.blocks.shape[0] - 1
    unlook(float(k), memory.held, memory.kept)
    for _ in range(params.per_sample // params.per_law):
        run_law(loop, params.start + k * params.timestep)
        if not advance_blocks(loop, motion, 0, B, k, params.per_law, nothing, -1, bad):
            return False
        k += params.per_law
    look(float(k), memory.held, memory.kept)
    run_law(loop, params.start + k * params.timestep)
    loop.state.steps[0] = k
    return True


def _require_world(run: Fused) -> None:
    """Refuse a run that takes no periods together with others.

    Raises:
        InputError: It has begun, has events or another phase, a law in Python, or a team that is too large.
    """
    first, *later = run.phases
    if run.steps_taken:
        raise InputError(f"a run is at {run.time:g} s; expected runs at their start")
    if later or first.events:
        what = first.events[0] if first.events else f"{later[0].name} at {later[0].time:g} s"
        raise InputError(f"events: {what}; expected none in worlds that step together, which keep their edges")
    if run.controller:
        raise InputError("controller: a law in Python; expected the agents' own in worlds that step without Python")
    require_scorable(run.system)


def _shared(params: Params) -> Params:
    """Return constants with shapes in the place of what worlds do not share."""
    return with_seeded(params, mapped(lambda leaf: leaf.shape if is_seeded(leaf) else leaf, seeded_of(params)))


def _require_same(w: int, one: Any, other: Any, path: str = "params") -> None:
    """Refuse a world w that differs, if by a bit, from the others in one of what they share, trees of tuples.

    Raises:
        InputError: naming the first leaf in which it does.
    """
    if one is other:
        return
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        for name, part, others in zip(getattr(one, "_fields", range(len(one))), one, other, strict=True):
            _require_same(w, part, others, f"{path}.{name}")
        return
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        same = one.shape == other.shape and one.tobytes() == other.tobytes()
    else:
        same = type(one) is type(other) and bool(one == other)
    if not same:
        raise InputError(f"{path}: run {w} has another than the others; expected runs of one team")


class Worlds:
    """Runs of one team on the fused engine that take their control periods together.

    Attributes:
        values: Numbers of the worlds, shape (W, n). The runs themselves continue in their rows.
        columns: A Loop whose own numbers are their columns in `values`.
        squares: Squared errors |q*_i - q_i|^2 of the agents at the last sample, shape (W, N), m^2.
    """

    def __init__(self, runs: Sequence[Fused]) -> None:
        """Lay out runs at their start, and continue them there.

        Raises:
            InputError: There is no run, or one is not suitable: it differs from the first in what worlds share, has
                begun, has events or another phase, a law in Python, or is refused by `require_scorable`.
        """
        if not runs:
            raise InputError("no run; expected one or more")
        first, system = runs[0], runs[0].system
        shared, self._motion = _shared(first.params()), first.compiled[1]
        for w, run in enumerate(runs):
            _require_world(run)
            _require_same(w, _shared(run.params()), shared)
            _require_same(w, run.compiled[1], self._motion, "motion")
            _require_same(w, run.system.team.members, system.team.members, "team")
            _require_same(w, run.system.grid, system.grid, "time")
        W = len(runs)
        self._runs = list(runs)
        self._shared = shared
        self._row, self._loop = lay_out(first.loop_in)
        self._empty = lay_out(first.new_loop)[0]
        numbers, self.columns = lay_out(first.loop_in)
        numbers[:] = np.arange(len(numbers))
        self.values = np.zeros((W, len(self._row)))
        self._loops = [run.continue_in(Room(row)) for run, row in zip(runs, self.values, strict=True)]
        self._goal = goal_of(system)
        self._nothing = new_log(0, system.law, actuators=len(self._loop.state.ctrl))
        self._starts = self.values.copy()
        self._bad = np.full((W, len(system.team.members)), NEVER)
        self.squares = np.zeros((W, len(system.team.agents)))
        self.step(np.zeros(W, dtype=np.bool_))  # compiles, as does the next line
        begin_periods(self._loop, self._row, self.values, np.zeros(0, dtype=np.int64))

    @property
    def steps(self) -> IntArray:
        """Number of physics steps that each world has taken, shape (W,)."""
        return self.values[:, 0].astype(np.int64)

    def begin(self, seeds: Mapping[int, int]) -> None:
        """Begin runs anew, each with a seed, by the numbers of their worlds.

        Raises:
            InputError: A seed changes what worlds share.
        """
        which = np.array(list(seeds), dtype=np.int64)
        new = np.array([w for w, seed in seeds.items() if seed != self._runs[w].seed], dtype=np.int64)
        for w in new.tolist():
            run = self._runs[w]
            run.take_seed(seeds[w])
            params = run.params()
            _require_same(w, _shared(params), self._shared)
            self.values[w, : len(self._empty)] = self._empty
            old = leaves_of(seeded_of(self._loops[w].params))
            for own, value in zip(old, leaves_of(seeded_of(params)), strict=True):
                if is_seeded(own):
                    own[...] = value
            run.place()
        if len(new):
            begin_periods(self._loop, self._row, self.values, new)
        self._starts[new] = self.values[new]
        self.values[which] = self._starts[which]
        self._bad[which] = NEVER

    def step(self, alive: BoolArray) -> dict[int, str]:
        """Take one control period.

        Args:
            alive: True for each world that takes it, shape (W,).

        Returns:
            The reason for each world that diverged, by its number.
        """
        system = self._runs[0].system
        with naming_terms(system.law.custom, system.team, self._loop.state.memory.evaluated):
            of_worlds = self.values, alive, self._bad, self.squares
            take_periods(self._loop, self._row, self._motion, self._goal, self._nothing, *of_worlds)
        found = {}
        for w in np.flatnonzero((self._bad != NEVER).any(axis=1) & alive).tolist():
            vehicle = int(np.argmin(self._bad[w]))
            step = int(self._bad[w, vehicle]) // 2
            found[w] = blow_up_of(self._runs[w].system, self._loops[w], vehicle, step)
        return found
