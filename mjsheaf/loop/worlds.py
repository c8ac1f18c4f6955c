"""Worlds: runs of one team that take a control period at a time, for environments, without Python in between.

What a world has of its own is a row of one array: the state of a run, and the constants that depend on its seed.
Passing a whole Loop from Python to compiled code takes as long as a period of a small team. Therefore one Loop stands
for all worlds: each row is copied into the memory of that Loop, takes its period there, and is copied back. So worlds
go through the very functions of the fused engine, and each ends bit for bit as it does alone.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mjsheaf.arrays import Array, BoolArray, IntArray, Room, lay_out
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.errors import InputError
from mjsheaf.law.custom import naming_terms
from mjsheaf.law.law import look, unlook
from mjsheaf.loop.fused import Fused, advance_blocks
from mjsheaf.loop.log import new_log
from mjsheaf.loop.loop import NEVER, Params, blow_up_of, map_seeded, run_law
from mjsheaf.team import Team


@jit
def take_periods(loop, row, rigid, nothing, values, alive, bad):
    """Take one control period in every world that is alive.

    Args:
        loop: A loop of the worlds' team, whose own numbers lie in `row`.
        row: Numbers of one world, shape (n,).
        rigid: A RIGID for each kind of vehicle.
        nothing: Log without samples.
        values: Rows of the worlds, shape (W, n).
        alive: True for each world that takes a period, shape (W,).
        bad: Time at which each vehicle diverged, NEVER if it did not, shape (W, V); see `Fused._bad`.
    """
    for w in range(values.shape[0]):
        if not alive[w]:
            continue
        for k in range(row.shape[0]):
            row[k] = values[w, k]
        take_period(loop, rigid, nothing, bad[w])
        for k in range(row.shape[0]):
            values[w, k] = row[k]


@inline_jit
def take_period(loop, rigid, nothing, bad):
    """Take the next control period, and evaluate the law at its end; if a vehicle diverges, its steps do not count.

    Args:
        loop, rigid, nothing: See `take_periods`.
        bad: Time at which each vehicle diverged, shape (V,).
    """
    params, memory = loop.params, loop.state.memory
    k, B = int(loop.state.steps[0]), params.fleet.blocks.shape[0] - 1
    unlook(float(k), memory.held, memory.kept)
    for _ in range(params.per_sample // params.per_law):
        run_law(loop, params.start + k * params.timestep)
        if not advance_blocks(loop, rigid, 0, B, k, params.per_law, nothing, -1, bad):
            return
        k += params.per_law
    look(float(k), memory.held, memory.kept)
    run_law(loop, params.start + k * params.timestep)
    loop.state.steps[0] = k


def _shared(params: Params) -> Params:
    """Return constants with shapes in the place of what worlds do not share."""
    return map_seeded(lambda leaf: leaf.shape, params)


def _seeded(params: Params) -> list[Any]:
    """Return what worlds do not share, in order."""
    leaves: list[Any] = []
    map_seeded(leaves.append, params)
    return leaves


def _are_equal(one: Any, other: Any) -> bool:
    """Return True if trees of tuples are equal to the bit."""
    if one is other:
        return True
    if isinstance(one, tuple):
        return type(one) is type(other) and len(one) == len(other) and all(map(_are_equal, one, other))
    if isinstance(one, np.ndarray):
        return one.shape == other.shape and one.tobytes() == other.tobytes()
    return type(one) is type(other) and bool(one == other)


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
            InputError: A run differs from the first in what worlds share, has begun, has events or another phase, a law
                in Python, or a team whose q* is no linear function of the targets.
        """
        first, system = runs[0], runs[0].system
        self._shared, self._rigid = _shared(first.params()), first.compiled[1]
        for run in runs:
            start, *later = run.phases
            own = (_shared(run.params()), run.compiled[1], run.system.team.members, run.system.grid)
            alike = _are_equal(own, (self._shared, self._rigid, system.team.members, system.grid))
            if not (alike and run.system.team.plain) or run.steps_taken or later or start.events or run.controller:
                raise InputError(
                    f"{system.name}: expected runs of one team at their start, without events, a law in Python, or "
                    "edges of ranges, bearings or directions, in worlds that step together"
                )
        W = len(runs)
        self._runs = list(runs)
        self._row, self._loop = lay_out(first.loop_in)
        self._empty = lay_out(first.new_loop)[0]
        numbers, self.columns = lay_out(first.loop_in)
        numbers[:] = np.arange(len(numbers))
        self.values = np.zeros((W, len(self._row)))
        self._loops = [run.continue_in(Room(row)) for run, row in zip(runs, self.values, strict=True)]
        self._errors = SquareErrors(system.team)
        self._positions = self.columns.state.x.astype(np.int64)
        self._nothing = new_log(0, system.law, actuators=len(self._loop.state.ctrl))
        self._starts = self.values.copy()
        self._bad = np.full((W, len(system.team.members)), NEVER)
        self.squares = np.zeros((W, len(system.team.agents)))
        self.step(np.zeros(W, dtype=np.bool_))  # compiles

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
            if not _are_equal(_shared(params), self._shared):
                raise InputError(f"seed {run.seed} changes what worlds that step together share")
            self.values[w, : len(self._empty)] = self._empty
            for own, value in zip(_seeded(self._loops[w].params), _seeded(params), strict=True):
                own[...] = value
            run.place()
            run.close_loop(sample=True)
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
            take_periods(self._loop, self._row, self._rigid, self._nothing, self.values, alive, self._bad)
        diverged, found = (self._bad != NEVER).any(axis=1), {}
        for w in np.flatnonzero(diverged & alive).tolist():
            vehicle = int(np.argmin(self._bad[w]))
            step = int(self._bad[w, vehicle]) // 2
            found[w] = blow_up_of(self._runs[w].system, self._loops[w], vehicle, step)
        good = alive & ~diverged
        self.squares[good] = self._errors(self.values[good][:, self._positions])
        return found


class SquareErrors:
    """Squared errors |q*_i - q_i|^2 of the agents of a team, called with positions.

    The same positions give the same bits, alone or among others.

    Attributes:
        team: The team.
    """

    def __init__(self, team: Team) -> None:
        self.team = team
        agents = int(team.first_state[-1])
        targets = len(team.slots) - agents
        self._linear = team.plain and agents * targets <= _MAX_CARRIED
        if self._linear:
            self._rest = team.extend(np.zeros(targets))
            self._carry = team.extend(np.eye(targets)) - self._rest

    def __call__(self, x: Array) -> Array:
        """Compute them where vehicles are at x (..., V, 3), m, shape (..., N), m^2; NaN for absent agents."""
        q, p = self.team.split(x)
        goal = self._rest + np.einsum("pq,...p->...q", self._carry, p) if self._linear else self.team.extend(p, q)
        return np.add.reduceat((goal - q) ** 2, self.team.first_state[:-1], axis=-1)


_MAX_CARRIED = 12_000_000  # of what carries targets to q*
