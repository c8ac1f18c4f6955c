"""Worlds that take one control period at a time, for environments, without Python in between.

A world's numbers are a row (see `rows`). Passing a whole Loop from Python to compiled code takes as long as a period of
a small team. Therefore one Loop stands for all worlds: each row is copied into the memory of that Loop, takes its
period there, and is copied back. Only random laws need a Loop of each world, because its seed is not in the row.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.errors import InputError
from mjsheaf.jit import inline_jit, jit
from mjsheaf.law.custom import naming_terms
from mjsheaf.law.law import look, unlook
from mjsheaf.loop.fused import Fused, advance_blocks, command_vehicles
from mjsheaf.loop.loop import NEVER, EngineArrays, Loop, blow_up_of, new_loop, run_law
from mjsheaf.loop.rows import Rows, is_seed, leaves_of
from mjsheaf.loop.scores import goal_of, require_scorable, square_errors
from mjsheaf.loop.trajectory import new_log


@jit
def take_periods(loop, row, motion, goal, nothing, values, alive, steps, bad, squares):
    """Take one control period in every world that is alive, and measure at its end.

    Args:
        loop: A loop of the worlds' team, whose own arrays lie in `row`.
        row: Numbers of one world, shape (n,).
        motion: A MOTION for each kind of vehicle.
        goal: Goal of the errors; see `scores`.
        nothing: Log without samples.
        values: Rows of the worlds, shape (W, n).
        alive: True for each world that takes a period, shape (W,).
        steps: Number of physics steps that each world has taken, shape (W,).
        bad: Time at which each vehicle diverged, NEVER if it did not, shape (W, V); see `Fused._bad`.
        squares: Squared errors |q*_i - q_i|^2 of the agents, shape (W, N), m^2. A world that diverges keeps its own.
    """
    for w in range(values.shape[0]):
        if not alive[w]:
            continue
        for k in range(row.shape[0]):
            row[k] = values[w, k]
        if take_period(loop, motion, nothing, steps[w], bad[w]):
            steps[w] += loop.params.per_sample
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
def take_period(loop, motion, nothing, k, bad):
    """Take the control period that begins at step k, and evaluate the law at its end.

    Args:
        loop, motion, nothing: See `take_periods`.
        k: Number of the first physics step.
        bad: Time at which each vehicle diverged, shape (V,).

    Returns:
        False if a vehicle diverged.
    """
    params, memory = loop.params, loop.state.memory
    B = params.fleet.blocks.shape[0] - 1
    unlook(float(k), memory.held, memory.kept)
    for _ in range(params.per_sample // params.per_law):
        run_law(loop, params.start + k * params.timestep)
        if not advance_blocks(loop, motion, 0, B, k, params.per_law, nothing, -1, bad):
            return False
        k += params.per_law
    look(float(k), memory.held, memory.kept)
    run_law(loop, params.start + k * params.timestep)
    return True


def _draws(loop: Loop) -> bool:
    """Return True if a run draws numbers from a seed while it runs."""
    law = loop.params.control.law
    idle = {"loop.params.control.law.links.seed"} if not len(law.links.of) else set()
    if not (law.terms.noise > 0.0 or law.terms.rounds.imperfect):
        idle.add("loop.params.control.law.terms.seed")
    return any(is_seed(leaf) and leaf.path not in idle for leaf in leaves_of(loop))


def _require_world(run: Fused) -> None:
    """Refuse a run that takes no periods together with others.

    Raises:
        InputError: It has events or another phase, a law in Python, or a team that is too large.
    """
    first, *later = run.phases
    if later or first.events:
        what = first.events[0] if first.events else f"{later[0].name} at {later[0].time:g} s"
        raise InputError(f"events: {what}; expected none in worlds that step together, which keep their edges")
    if run.controller:
        raise InputError("controller: a law in Python; expected the agents' own in worlds that step without Python")
    require_scorable(run.system)


class Worlds:
    """Runs of one team on the fused engine that take their control periods together.

    Attributes:
        rows: The worlds. The runs themselves continue in them.
        steps: Number of physics steps that each world has taken, shape (W,).
        squares: Squared errors |q*_i - q_i|^2 of the agents at the last sample, shape (W, N), m^2.
    """

    def __init__(self, runs: Sequence[Fused]) -> None:
        """Lay out runs at their start, and continue them there.

        Raises:
            InputError: One of the runs is not suitable; it has events or another phase, a law in Python, or is
                refused by `Rows` or `require_scorable`.
        """
        for run in runs:
            _require_world(run)
        self._runs = list(runs)
        self.rows = Rows(runs)
        template = Rows(runs[:1])
        self._row, self._loop = template.values[0], template.loop_of(0)
        system, W = runs[0].system, len(runs)
        law = system.law
        self._is_random = _draws(runs[0].compiled[0])
        self._goal = goal_of(system)
        self._nothing = new_log(0, law, actuators=self.rows.loop.state.ctrl.shape[1])
        self._starts = self.rows.values[:W].copy()
        params, state = runs[0].compiled[0]
        arrays = EngineArrays(
            *(np.zeros_like(each) for each in (state.qpos, state.qvel, state.ctrl, state.act, params.gain))
        )
        empty = new_loop(params.fleet, params.control, params.medium, arrays, timestep=params.timestep)
        self._empty = self.rows.row_of(empty)
        self._bad = np.full((W, len(system.team.members)), NEVER)
        self.steps = np.zeros(W, dtype=np.int64)
        self.squares = np.zeros((W, len(system.team.agents)))
        self._loops = [self._adopt(w) for w in range(W)]
        self.step(np.zeros(W, dtype=np.bool_))  # compiles, as does the next line
        begin_periods(self._loop, self._row, self.rows.values, np.zeros(0, dtype=np.int64))

    def _adopt(self, w: int) -> Loop:
        """Let run w continue in its world, and return the Loop of that."""
        loop = self.rows.loop_of(w)
        self._runs[w].adopt(loop, self.steps[w : w + 1])
        return loop

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
            self.rows.values[w] = self._empty
            self.rows.put(w, run.params())
            if self._is_random:
                self._loops[w] = self._adopt(w)
            run.place()
        if self._is_random:
            for w in new.tolist():
                begin_periods(self._loops[w], self.rows.values[w], self.rows.values, np.array([w]))
        elif len(new):
            begin_periods(self._loop, self._row, self.rows.values, new)
        self._starts[new] = self.rows.values[new]
        self.rows.values[which] = self._starts[which]
        self.steps[which] = 0
        self._bad[which] = NEVER

    def step(self, alive: BoolArray) -> dict[int, str]:
        """Take one control period.

        Args:
            alive: True for each world that takes it, shape (W,).

        Returns:
            The reason for each world that diverged, by its number.
        """
        if self._is_random:
            for w in np.flatnonzero(alive).tolist() or [0]:
                self._take(self._loops[w], self.rows.values[w], slice(w, w + 1), alive)
        else:
            self._take(self._loop, self._row, slice(0, len(alive)), alive)
        found = {}
        for w in np.flatnonzero((self._bad != NEVER).any(axis=1) & alive).tolist():
            vehicle = int(np.argmin(self._bad[w]))
            step = int(self._bad[w, vehicle]) // 2
            found[w] = blow_up_of(self._runs[w].system, self._loops[w], vehicle, step)
        return found

    def _take(self, loop: Loop, row: Array, own: slice, alive: BoolArray) -> None:
        of_worlds = self.rows.values[own], alive[own], self.steps[own], self._bad[own], self.squares[own]
        system = self._runs[0].system
        with naming_terms(system.law.custom, system.team, loop.state.memory.evaluated):
            take_periods(loop, row, self.rows.motion, self._goal, self._nothing, *of_worlds)
