"""Worlds: runs of one team that take a control period at a time, for environments, without Python in between.

What a world has of its own is a row of one array: the state of a run, and the constants that depend on its seed.
Passing a whole Loop from Python to compiled code takes as long as a period of a small team. Therefore one Loop stands
for all worlds: each row is copied into the memory of that Loop, takes its period there, and is copied back. So worlds
go through the very functions of the fused engine, and each ends bit for bit as it does alone.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray, IntArray, Room, lay_out
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.compile.tiers import Tiered
from mjsheaf.errors import InputError
from mjsheaf.law.custom import naming_terms
from mjsheaf.law.law import look, unlook
from mjsheaf.loop.fused import Fused, advance_blocks, command_vehicles
from mjsheaf.loop.log import new_log
from mjsheaf.loop.loop import NEVER, Params, blow_up_of, map_seeded, run_law
from mjsheaf.system import System


@jit
def take_periods(loop, row, rigid, goal, nothing, values, alive, bad, squares):
    """Take one control period in every world that is alive, and measure at its end.

    Args:
        loop: A loop of the worlds' team, whose own numbers lie in `row`.
        row: Numbers of one world, shape (n,).
        rigid: A RIGID for each kind of vehicle.
        goal: Goal of the errors; see `Goal`.
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
        if take_period(loop, rigid, nothing, bad[w]):
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
def take_period(loop, rigid, nothing, bad):
    """Take the next control period, and evaluate the law at its end.

    Args:
        loop, rigid, nothing: See `take_periods`.
        bad: Time at which each vehicle diverged, shape (V,).

    Returns:
        False if a vehicle diverged: then the steps of the period do not count.
    """
    params, memory = loop.params, loop.state.memory
    k, B = int(loop.state.steps[0]), params.fleet.blocks.shape[0] - 1
    unlook(float(k), memory.held, memory.kept)
    for _ in range(params.per_sample // params.per_law):
        run_law(loop, params.start + k * params.timestep)
        if not advance_blocks(loop, rigid, 0, B, k, params.per_law, nothing, -1, bad):
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
    return map_seeded(lambda leaf: leaf.shape, params)


def _seeded(params: Params) -> list[Any]:
    """Return what worlds do not share, in order."""
    leaves: list[Any] = []
    map_seeded(leaves.append, params)
    return leaves


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
        shared, self._rigid = _shared(first.params()), first.compiled[1]
        for w, run in enumerate(runs):
            _require_world(run)
            _require_same(w, _shared(run.params()), shared)
            _require_same(w, run.compiled[1], self._rigid, "rigid")
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
            for own, value in zip(_seeded(self._loops[w].params), _seeded(params), strict=True):
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
            take_periods(self._loop, self._row, self._rigid, self._goal, self._nothing, *of_worlds)
        found = {}
        for w in np.flatnonzero((self._bad != NEVER).any(axis=1) & alive).tolist():
            vehicle = int(np.argmin(self._bad[w]))
            step = int(self._bad[w, vehicle]) // 2
            found[w] = blow_up_of(self._runs[w].system, self._loops[w], vehicle, step)
        return found


_MOST_NUMBERS = 12_000_000  # of what carries targets to q*


class Goal(NamedTuple):
    """Reference for the errors of N agents.

    Attributes:
        carry, rest: Coefficients of q* = carry p + rest for stacked positions p, shapes (n_q, n_p) and (n_q,).
        own: Vehicle and axis of each number of q, then of p, shape (n_q + n_p, 2).
        first: Index of each agent's first number in q, shape (N + 1,).
    """

    carry: Array
    rest: Array
    own: IntArray
    first: IntArray


@inline_jit
def square_errors(goal, x, squares):
    """Write |q*_i - q_i|^2 of all agents at x (V, 3), m, into squares (N,), m^2; NaN for absent agents."""
    n = goal.rest.shape[0]
    for i in range(squares.shape[0]):
        squares[i] = 0.0
        for r in range(goal.first[i], goal.first[i + 1]):
            e = goal.rest[r] - x[goal.own[r, 0], goal.own[r, 1]]
            for c in range(goal.carry.shape[1]):
                e += goal.carry[r, c] * x[goal.own[n + c, 0], goal.own[n + c, 1]]
            squares[i] += e * e


class SquareErrors:
    """Squared errors |q*_i - q_i|^2 of the agents of a team, called with positions.

    Attributes:
        team: The team.
    """

    def __init__(self, system: System) -> None:
        self.team = system.team
        self._goal = goal_of(system) if _is_scorable(system) else None

    def __call__(self, x: Array) -> Array:
        """Compute them where vehicles are at x (V, 3), m, shape (N,), m^2; NaN for absent agents."""
        N = len(self.team.agents)
        squares = np.empty(N)
        if self._goal is None:
            return np.asarray(((self.team.harmonic_extension(x) - x[:N]) ** 2).sum(axis=1))
        _square_errors(self._goal, x, squares)
        return squares


_square_errors = Tiered(square_errors)


def require_scorable(system: System) -> None:
    """Refuse a team of which no errors can be computed this way.

    Raises:
        InputError: what carries its targets to q* is too large, or q* is no linear function of them.
    """
    if not system.team.plain:
        raise InputError(
            "communication: q* of a team with range, bearing or directed edges, or without targets and anchors, is no "
            "linear function of the targets, as worlds that step together require; expected separate runs"
        )
    n_q, n_p = system.team.first_state[-1], system.team.dirichlet.B.shape[1]
    if not _is_scorable(system):
        raise InputError(
            f"agents: {n_q} coordinates of theirs by {n_p} of targets are too many for worlds that step together; "
            f"expected a product of at most {_MOST_NUMBERS}, or runs one by one"
        )


def _is_scorable(system: System) -> bool:
    """Return True if q* is a linear function of the targets, of moderate size."""
    team = system.team
    return team.plain and int(team.first_state[-1]) * team.dirichlet.B.shape[1] <= _MOST_NUMBERS


def goal_of(system: System) -> Goal:
    """Return the goal of a system that passed `require_scorable`."""
    team, n_p = system.team, system.team.dirichlet.B.shape[1]
    rest = team.extend(np.zeros(n_p))
    return Goal(
        carry=np.ascontiguousarray((team.extend(np.eye(n_p)) - rest).T),
        rest=rest,
        own=np.column_stack(np.divmod(team.slots, 3)).astype(np.int64),
        first=np.asarray(team.first_state, dtype=np.int64),
    )
