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

`Worlds` are runs of one team that advance one control period at a time, for environments, in one compiled call. The
data of each world is a row of one array: the state of its run, and the constants that depend on its seed. Passing a
whole Loop from Python to compiled code takes as long as a period of a small team. Therefore all worlds share one Loop:
each row is copied into the memory of that Loop, advances one period there, and is copied back. So worlds use the same
functions as the fused engine, and the result of each is bit for bit that of the run alone.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjsheaf.arrays import Array, BoolArray, IntArray, Room, lay_out
from mjsheaf.compile.jit import INTERPRETED, held, inline_jit, jit, on_stack, pinned
from mjsheaf.compile.tiers import Tiered
from mjsheaf.errors import InputError
from mjsheaf.law.custom import naming_terms
from mjsheaf.law.law import look, unlook
from mjsheaf.loop.block import ALONE, advance_alone, advance_lanes, command_alone, fits_lanes, pack_rigid
from mjsheaf.loop.engine import Recorder, new_log
from mjsheaf.loop.loop import NEVER, Bodies, ClosedLoop, Loop, Params, begin_span, blow_up_of, map_seeded, run_law
from mjsheaf.media.medium import advance as advance_medium
from mjsheaf.team import Team
from mjsheaf.vehicles.vehicle import kinds_of

_MOST_NUMBERS = 50_000  # of a loop whose vehicles Python commands: some 150 vehicles
_WORTH_A_THREAD = 25_000  # vehicles times steps between two evaluations of the law: a round takes 0.2 ms


@inline_jit
def advance_block(loop, rigid, first, last, step, count, log, row, bad):
    """Move vehicles from first up to last by `count` steps from step number `step`, fewer where one becomes bad.

    Their samples before the first step are recorded as `row` of the log, unless that is negative. They move in lanes if
    they fit, which does not change a bit.

    Returns:
        True if no vehicle became bad; see `Fused._bad` on `bad`.
    """
    return _advance_block(loop.params.fleet.lanes, loop, rigid, first, last, step, count, log, row, bad)


@inline_jit
def _advance_block(lanes, loop, rigid, first, last, step, count, log, row, bad):
    if len(lanes) == 0:  # a matter of types: the rest is not compiled
        return advance_alone(loop, rigid, first, last, step, count, log, row, bad)
    if fits_lanes(loop.params.fleet, loop.params.helm, first, last):
        return advance_lanes(loop, rigid, first, last, step, count, log, row, bad)
    return advance_alone(loop, rigid, first, last, step, count, log, row, bad)


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
    loop, recorder = pinned(loop), pinned(recorder)
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
    advance_blocks(pinned(loop), rigid, first, last, step, count, pinned(log), row, bad)


@inline_jit
def command_vehicles(loop, t):
    """Compute the measurements and commands of every vehicle at time t, s."""
    loop = pinned(loop)
    params, state = loop.params, loop.state
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
        self._go_on(self.loop_in(room))
        self._values = room.since(0)[: len(self._values)]
        return self._loop

    def _command(self) -> None:
        command_all(self._held, self.time)

    def _move(self, step: int, count: int, recorder: Recorder) -> tuple[int, int] | None:
        self._bad[:] = NEVER
        if self._pool is None:
            advance(self._held, self._rigid, count, recorder, self._bad)
        else:
            # Not by this thread, where Ctrl-C would leave some vehicles behind.
            moving = self._pool.submit(self._move_in_parts, self._pool, step + count, recorder)
            try:
                wait([moving])
            finally:
                moving.result()
        self._count[0] = step + count  # also if a vehicle is bad and its span does not count
        vehicle = int(np.argmin(self._bad))
        return None if self._bad[vehicle] == NEVER else (vehicle, int(self._bad[vehicle]) // 2)

    def _move_in_parts(self, pool: ThreadPoolExecutor, end: int, recorder: Recorder) -> None:
        """Do what `advance` does up to step `end`; each thread moves a part of the vehicles."""
        params, log = self._loop.params, recorder.log
        while self.steps_taken < end and self._bad.min() == NEVER:
            k = self.steps_taken
            span = min(params.per_law - k % params.per_law, end - k)
            row = begin_span(self._held, k, recorder)
            others = [
                pool.submit(_advance_part, self._held, self._rigid, first, last, k, span, log, row, self._bad)
                for first, last in pairwise(self._ends[1:])
            ]
            _advance_part(self._held, self._rigid, 0, self._ends[1], k, span, log, row, self._bad)
            for other in others:
                other.result()
            self._count[0] = k + span

    def close(self) -> None:
        """End the threads."""
        pool, self._pool = self._pool, None  # what follows moves on one thread
        if pool is not None:
            pool.shutdown()


@jit
def take_periods(loop, row, rigid, nothing, values, alive, bad):
    """Take one control period in every world that is alive.

    Args:
        loop: A loop of the worlds' team, whose data is in `row`.
        row: Numbers of one world, shape (n,).
        rigid: A RIGID for each kind of vehicle.
        nothing: Log with no samples.
        values: Rows of the worlds, shape (W, n).
        alive: True for each world that takes a period, shape (W,).
        bad: Time at which each vehicle diverged, NEVER if it did not, shape (W, V); see `Fused._bad`.
    """
    loop, nothing = pinned(loop), pinned(nothing)
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
    """Return the constants with each array that worlds do not share replaced by its shape."""
    return map_seeded(lambda leaf: leaf.shape, params)


def _seeded(params: Params) -> list[Any]:
    """Return the arrays that worlds do not share, in order."""
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
        columns: A Loop with the column in `values` in place of each number.
        squares: Squared errors |q*_i - q_i|^2 of the agents at the last sample, shape (W, N), m^2.
    """

    def __init__(self, runs: Sequence[Fused]) -> None:
        """Copy runs, at their start, to the rows of `values`, where they continue.

        Raises:
            InputError: A run differs from the first in the constants that worlds share, has begun, has events or
                another phase, a law in Python, random headings, or a team whose q* is not a linear function of the
                targets.
        """
        first, system = runs[0], runs[0].system
        shared, self._rigid = _shared(first.params()), first.compiled[1]
        for run in runs:
            start, *later = run.phases
            own = (_shared(run.params()), run.compiled[1], run.system.team.members, run.system.grid)
            alike = _are_equal(own, (shared, self._rigid, system.team.members, system.grid)) and run.system.team.plain
            turned = run.scenario is not None and run.scenario.spread.heading > 0.0  # a seed changes what they share
            if not alike or run.steps_taken or later or start.events or run.controller or turned:
                raise InputError(
                    f"{system.name}: expected runs of one team at their start, without events, headings that a seed "
                    "draws, a law in Python, or edges of ranges, bearings or directions, in worlds that step together"
                )
        W = len(runs)
        self._runs = list(runs)
        self._row, self._loop = lay_out(first.loop_in)
        self._empty = lay_out(first.new_loop)[0]
        numbers, self.columns = lay_out(first.loop_in)
        numbers[:] = np.arange(len(numbers))
        self.values = np.zeros((W, len(self._row)))
        self._loops = [run.continue_in(Room(row)) for run, row in zip(runs, self.values, strict=True)]
        self._seeded = [_seeded(loop.params) for loop in self._loops]
        self._errors = SquareErrors(system.team)
        self._positions = self.columns.state.x.astype(np.int64)
        self._held = held(self._loop)
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
            InputError: A constant that worlds share depends on the seed, such as the number of nodes of frozen gusts.
        """
        which = np.array(list(seeds), dtype=np.int64)
        new = np.array([w for w, seed in seeds.items() if seed != self._runs[w].seed], dtype=np.int64)
        for w in new.tolist():
            run = self._runs[w]
            run.take_seed(seeds[w])
            drawn = _seeded(run.params())
            if any(own.shape != value.shape for own, value in zip(self._seeded[w], drawn, strict=True)):
                raise InputError(f"seed {run.seed} changes what worlds that step together share")
            self.values[w, : len(self._empty)] = self._empty
            for own, value in zip(self._seeded[w], drawn, strict=True):
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
            take_periods(self._held, self._row, self._rigid, self._nothing, self.values, alive, self._bad)
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

    def __init__(self, team: Team, *, most: int = 12_000_000) -> None:
        """Prepare for a team; q* of linear edges takes a matrix of at most `most` numbers, else a solver."""
        self.team = team
        agents = int(team.first_state[-1])
        targets = len(team.slots) - agents
        self._linear = team.plain and team.ramp is None and agents * targets <= most
        if self._linear:
            self._rest = team.extend(np.zeros(targets))
            self._carry = team.extend(np.eye(targets)) - self._rest

    def __call__(self, x: Array, time: float | None = None) -> Array:
        """Compute the squared errors for vehicles at x (..., V, 3), m, shape (..., N), m^2; NaN for absent agents.

        The time, in s, is needed while formations change.
        """
        q, p = self.team.split(x)
        goal = (
            self._rest + np.einsum("pq,...p->...q", self._carry, p)
            if self._linear
            else self.team.extend(p, q, time=time)
        )
        return np.add.reduceat((goal - q) ** 2, self.team.first_state[:-1], axis=-1)
