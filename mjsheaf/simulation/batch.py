"""Worlds side by side: many runs of one team that differ in seed, gain, disturbance or where they begin.

A world is a run on the fused engine. What its own numbers are (state, memory of the law, gains, harmonics) is a row of
one array, everything else is there once. `world_of` makes the Loop of a world from both, in Python and in compiled code
alike, so that worlds go through the very functions of `fused`: each ends bit for bit as it does alone.

Of a run only scores are kept: its errors at the end and over the last half, and how much of a bound it used. Rows lie
one after the other for threads of this machine, of which each takes a world at a time; and number by number for a card
(`order="F"`, see `card`), where neighbouring threads take the same vehicle of neighbouring worlds.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from threading import Event
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import DTypeLike, NDArray

from mjsheaf.arrays import Array, IntArray
from mjsheaf.control.law import ControlArrays, LawArrays, Memory, measure, pull_back
from mjsheaf.control.links import LinkArrays, LinkMemory
from mjsheaf.control.rounds import RoundMemory
from mjsheaf.control.terms import TermArrays, TermMemory
from mjsheaf.dynamics.disturbance import HarmonicArrays
from mjsheaf.dynamics.motion import MotionArrays
from mjsheaf.errors import InputError
from mjsheaf.jit import inline_jit, jit
from mjsheaf.simulation.fused import Fused, advance_block
from mjsheaf.simulation.gate import Crew, wait
from mjsheaf.simulation.loop import Loop, run_law
from mjsheaf.simulation.trajectory import new_log
from mjsheaf.system import MediumArrays, Phase, System, phases_of

GOOD = np.iinfo(np.int64).max
"""Of a vehicle that has not been bad: see `ThreadedLoop._work`."""

_MOST_NUMBERS = 4_000_000  # of what carries targets to q*
_CHUNK = 2_000_000  # steps times vehicles in one compiled call, after which Ctrl-C is heard


class Worlds(NamedTuple):
    """What W worlds have of their own, for compiled code; as in the Loop of one, the first axis counts worlds.

    Attributes:
        seed: of the links' and terms' random numbers, shape (W,).
        gain, limit: of the law.
        origin: of the targets' references.
        amplitude, rate, phase: of the disturbances' harmonics.
        qpos, qvel, ctrl, act, x, drift, sines: of the Loop.
        memory: of the law.
    """

    seed: IntArray
    gain: Array
    limit: Array
    origin: Array
    amplitude: Array
    rate: Array
    phase: Array
    qpos: Array
    qvel: Array
    ctrl: Array
    act: Array
    x: Array
    drift: Array
    sines: Array
    memory: Memory


class Goal(NamedTuple):
    """What worlds of N agents are scored by, over T samples.

    Attributes:
        carry, rest: q* = carry p + rest of stacked positions p, shapes (n_q, n_p) and (n_q,).
        own: vehicle and axis of each number of q, then of p, shape (n_q + n_p, 2).
        first: where each agent's numbers begin in q, shape (N + 1,).
        bounds: on |e| at each sample, shape (U, T), m; infinite where there is none.
        samples: T.
        late, second: the first samples of the last half: of late errors, and of the settled ratio.
    """

    carry: Array
    rest: Array
    own: IntArray
    first: IntArray
    bounds: Array
    samples: int
    late: int
    second: int


class Scores(NamedTuple):
    """What becomes of W worlds, written as they run.

    Attributes:
        bound: which of the goal's bounds is a world's, shape (W,).
        squares: |q*_i - q_i|^2 at the present sample, shape (W, N), m^2.
        y, eta: what exact links would measure and the eta of that, shapes (W, m) and (W, V, 3), m; of links that are
            exact it is the law's own, and these have no numbers.
        bad: when each vehicle was bad, GOOD while it was not, shape (W, V); see `ThreadedLoop._work`.
        found: see the columns below, shape (W, 7).
        ended: the vehicle that was bad first, and when; -1 while none is, shape (W, 2).
    """

    bound: IntArray
    squares: Array
    y: Array
    eta: Array
    bad: IntArray
    found: Array
    ended: IntArray


TRACKING, DISAGREEMENT, LATE_TRACKING, LATE_DISAGREEMENT, RATIO, SETTLED_RATIO, TAKEN = range(7)
"""Columns of `Scores.found`: RMS of |e_i| and mean |eta_i| at the last sample, m; sums of their squares over the last
half; largest |e| over its bound, after the start and over the last half; samples taken."""


@inline_jit
def world_of(loop, worlds, w):
    """The Loop of world w; `loop` is that of any."""
    law, medium, motion = loop.control.law, loop.medium, loop.control.motion
    terms, links = law.terms, law.links
    seed = worlds.seed[w]
    own_terms = TermArrays(
        terms.agents,
        terms.dimension,
        terms.period,
        terms.sensing,
        terms.eigenvalues,
        terms.feedforward,
        terms.newton,
        terms.measured,
        terms.drift,
        terms.lead,
        terms.settled,
        terms.integral,
        terms.largest,
        terms.noise,
        terms.bias,
        seed,
        terms.rounds,
    )
    own_links = LinkArrays(
        links.table,
        links.of,
        links.lift,
        links.facing,
        links.size,
        links.odometry,
        links.start,
        links.period,
        seed,
        links.record,
    )
    own_law = LawArrays(law.edges, worlds.gain[w], worlds.limit[w], law.supplied, own_terms, own_links)
    harmonics = HarmonicArrays(worlds.amplitude[w], worlds.rate[w], worlds.phase[w])
    own_motion = MotionArrays(
        motion.pull,
        worlds.origin[w],
        motion.amplitude,
        motion.rate,
        motion.phase,
        motion.path,
        motion.period,
        motion.knots,
        motion.coefficients,
    )
    memory = worlds.memory
    remembered, heard = memory.terms, memory.links
    rounds = remembered.rounds
    memory_of_terms = TermMemory(
        remembered.now[w],
        remembered.before[w],
        remembered.clock[w],
        remembered.y[w],
        remembered.x[w],
        remembered.moved[w],
        remembered.walked[w],
        remembered.seen[w],
        remembered.rate[w],
        remembered.v[w],
        remembered.delta[w],
        remembered.drift[w],
        remembered.z[w],
        remembered.right[w],
        remembered.direction[w],
        remembered.residue[w],
        RoundMemory(rounds.held[w], rounds.line[w], rounds.streams, rounds.first),
    )
    memory_of_links = LinkMemory(
        heard.heard[w],
        heard.velocity[w],
        heard.attitude[w],
        heard.before[w],
        heard.cells[w],
        heard.streams,
        heard.places,
    )
    own_memory = Memory(
        memory.flat[w],
        memory.y[w],
        memory.residual[w],
        memory.command[w],
        memory.supplied[w],
        memory_of_terms,
        memory_of_links,
    )
    return Loop(
        ControlArrays(own_law, own_motion),
        MediumArrays(medium.agents, medium.planar, medium.kernels, medium.rows, harmonics),
        loop.fleet,
        worlds.qpos[w],
        worlds.qvel[w],
        worlds.ctrl[w],
        loop.gain,
        worlds.act[w],
        worlds.x[w],
        worlds.drift[w],
        own_memory,
        worlds.sines[w],
        loop.stopped,
        loop.start,
        loop.timestep,
        loop.per_law,
        loop.per_sample,
    )


@inline_jit
def meet(gate, meetings, members):
    """Wait until all members are here, for the `meetings`th time; return False where one will never come."""
    return wait(gate, meetings, members)


@inline_jit
def square_error(goal, x, i):
    """|q*_i - q_i|^2 of agent i, m^2, where vehicles are at x (V, 3), m."""
    n, total = goal.rest.shape[0], 0.0
    for r in range(goal.first[i], goal.first[i + 1]):
        e = goal.rest[r] - x[goal.own[r, 0], goal.own[r, 1]]
        for c in range(goal.carry.shape[1]):
            e += goal.carry[r, c] * x[goal.own[n + c, 0], goal.own[n + c, 1]]
        total += e * e
    return total


@inline_jit
def score(goal, scores, w, n, loop):
    """Take sample n of world w into its scores, from `squares` and what the law left."""
    N, found, square, size, eta = goal.first.shape[0] - 1, scores.found[w], 0.0, 0.0, loop.memory.residual
    if scores.eta.shape[1] > 0:
        eta = scores.eta[w]
        measure(loop.control.law.edges, loop.x, scores.y[w])
        pull_back(loop.control.law.edges, scores.y[w], eta)
    for i in range(N):
        square += scores.squares[w, i]
        size += np.sqrt(eta[i, 0] ** 2 + eta[i, 1] ** 2 + eta[i, 2] ** 2)
    found[TRACKING], found[DISAGREEMENT], found[TAKEN] = np.sqrt(square / N), size / N, n + 1.0
    if n >= goal.late:
        found[LATE_TRACKING] += square / N
        found[LATE_DISAGREEMENT] += (size / N) ** 2
    if n > 0:  # at the start both are |e|
        ratio = np.sqrt(square) / goal.bounds[scores.bound[w], n]
        if ratio > found[RATIO] or ratio != ratio:
            found[RATIO] = ratio
        if n >= goal.second and (ratio > found[SETTLED_RATIO] or ratio != ratio):
            found[SETTLED_RATIO] = ratio


@jit
def run_world(loop, motion, goal, scores, nothing, w, there, begin, end, member, members, gate):
    """What one of its members does of world w from sample `begin` up to `end`, each with the steps after it.

    Member 0 evaluates the law and keeps the scores; agents and vehicles are dealt out to all. Members come to the same
    meetings whatever becomes of their world, also where there is none: on a card those of many worlds meet together.

    Args:
        loop: of the world.
        motion: a MOTION for each kind.
        goal, scores: see there.
        nothing: a Log without samples.
        w: number of the world.
        there: whether there is such a world.
        begin, end: samples; after the last of the goal's no step is taken.
        member, members: which of how many.
        gate: where they meet, a new one.
    """
    V, N, meetings = loop.fleet.bodies.shape[0], goal.first.shape[0] - 1, 0
    for n in range(begin, end):
        last = n + 1 == goal.samples
        for part in range(1 if last else loop.per_sample // loop.per_law):
            k = n * loop.per_sample + part * loop.per_law
            if there and member == 0 and scores.ended[w, 0] < 0:
                run_law(loop, loop.start + k * loop.timestep)
            if not meet(gate, meetings + 1, members):
                return
            alive = there and scores.ended[w, 0] < 0
            if alive and part == 0:
                for i in range(member, N, members):
                    scores.squares[w, i] = square_error(goal, loop.x, i)
            if alive and not last:
                for v in range(member, V, members):
                    advance_block(loop, motion, v, v + 1, k, loop.per_law, nothing, -1, scores.bad[w])
            if not meet(gate, meetings + 2, members):
                return
            if alive and member == 0:
                if part == 0:
                    score(goal, scores, w, n, loop)
                keep_first(scores.bad[w], scores.ended[w])
            meetings += 2


@inline_jit
def keep_first(bad, ended):
    """Write the vehicle that was bad first, and when, into `ended`, if one was."""
    for v in range(bad.shape[0]):
        if bad[v] != GOOD and (ended[0] < 0 or bad[v] < ended[1]):
            ended[0], ended[1] = v, bad[v]


class Outcome(NamedTuple):
    """What became of a world.

    Attributes:
        message: what blew up, where and when; empty where nothing did.
        samples: taken.
        tracking_error, mean_disagreement: of the team at the last of them: RMS of |q*_i - q_i| and mean |eta_i|, m.
        late_tracking_error, late_mean_disagreement: RMS of both over the last half; None where the run blew up.
        ratio, settled_ratio: largest |e| over its bound after the start, and over the last half; None without a bound.
    """

    message: str
    samples: int
    tracking_error: float
    mean_disagreement: float
    late_tracking_error: float | None
    late_mean_disagreement: float | None
    ratio: float | None
    settled_ratio: float | None


class Batch:
    """Worlds of one team, at their start.

    Attributes:
        loop: what they have in common; what each world has of its own is that of the first.
        motion: a MOTION for each kind of vehicle.
        rows: what all worlds have of their own, shape (W, n), of which `worlds` has views.
        worlds, goal, scores: see there.
        nothing: a Log without samples.
    """

    def __init__(
        self,
        runs: Sequence[System | Sequence[Phase]],
        bounds: Sequence[Array] | None = None,
        *,
        order: Literal["C", "F"] = "C",
        number: DTypeLike = np.float64,
    ) -> None:
        """Lay out the worlds.

        Args:
            runs: of one phase each, and of one team.
            bounds: for each, on |e| at every sample, with what counts as no error, shape (T,), m; runs may share one.
                Without any, no ratio is computed.
            order: "C" puts a world's numbers side by side, "F" each number of all worlds.
            number: type of all that is not a count.

        Raises:
            InputError: there is no run, one has events or contacts, or it differs from the first in what worlds share;
                or bounds are not one for each, or of another length.
        """
        if not runs:
            raise InputError("no run; expected one or more")
        self._count, repeated = len(runs), 1 + (len(runs) == 1)
        # One row lies in C's order and in Fortran's, and would be compiled otherwise than several: it is there twice.
        self._systems = [_only_system(run) for run in runs] * repeated
        self._type, first = np.dtype(number), self._systems[0]
        W, T, seeds = len(self._systems), first.grid.steps + 1, list[int]()
        if bounds is not None and [np.shape(bound) for bound in bounds] != [(T,)] * len(runs):
            shapes = f"{len(bounds)} bounds of shapes {sorted({np.shape(bound) for bound in bounds})}"
            raise InputError(f"bounds: {shapes}; expected one of shape ({T},) for each of {len(runs)} runs")
        for w, system in enumerate(self._systems):
            with Fused(system) as fused:
                loop, known = fused._loop, _shared(fused)
            if w == 0:
                whole, common, self.motion = loop, known, self._in_numbers(fused._motion)
                size = sum(part.size for part in _own(loop))
                self.rows = np.empty((W, size), dtype=self._type, order=order)
            elif (where := _difference(common, known)) is not None:
                raise InputError(f"{where}: run {w} has another than run 0; expected runs of one team")
            seeds.append(system.law.links.seed if len(system.law.links.table) else system.law.terms.seed)
            self.rows[w] = np.concatenate([part.ravel() for part in _own(loop)])
        self.loop: Loop = mapped(self._in_numbers, whole)
        self.worlds = Worlds(np.array(seeds, dtype=np.int64), *self._views(whole))
        which, several = _distinct(list(bounds) * repeated if bounds else [np.full(T, np.inf)] * W)
        self.goal: Goal = mapped(self._in_numbers, _goal_of(first, several))
        linked = len(first.law.links.of) > 0
        self.scores = Scores(
            bound=which,
            squares=np.zeros((W, len(first.team.agents)), order=order),
            y=np.zeros((W, len(first.law.edges.b) * linked), self._type, order),
            eta=np.zeros((W, len(first.team.members) * linked, 3), self._type, order),
            bad=np.full((W, len(first.team.members)), GOOD, order=order),
            found=np.zeros((W, 7), order=order),
            ended=np.full((W, 2), -1, dtype=np.int64, order=order),
        )
        self.nothing = mapped(self._in_numbers, new_log(0, first.law, actuators=len(self.loop.ctrl)))

    def _in_numbers(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values with the batch's type in place of double precision."""
        if values.dtype.names is None:
            return values.astype(self._type) if values.dtype == np.float64 else values
        fields = [(name, *_field(values.dtype[name], self._type)) for name in values.dtype.names]
        return values.astype(np.dtype(fields, align=True))

    def _views(self, loop: Loop) -> Iterator[Any]:
        """What Worlds have after the seed, as views of the rows that are laid out as parts of one Loop."""
        begin = 0

        def view(part: Array, offset: int) -> Array:
            strides = (self.rows.strides[0], *(n // 8 * self.rows.strides[1] for n in part.strides))
            start = self.rows[:, offset:] if part.size else self.rows[:, :0]
            return as_strided(start, (len(self.rows), *part.shape), strides)

        *parts, flat = _own(loop)
        for part in parts:
            yield view(part, begin)
            begin += part.size
        origin = flat.ctypes.data

        def of_memory(values: NDArray[Any]) -> NDArray[Any]:
            own = values.dtype == np.float64  # others are not what a world remembers
            return view(values, begin + (values.ctypes.data - origin) // 8 * (values.size > 0)) if own else values

        yield mapped(of_memory, loop.memory)

    def __len__(self) -> int:
        return self._count

    def loop_of(self, w: int) -> Loop:
        """The Loop of world w, for threads of this machine."""
        found: Loop = world_of.py_func(self.loop, self.worlds, w)
        return found

    def run(self, threads: int = 1, members: int = 1, progress: Callable[[int, int], None] | None = None) -> None:
        """Run all worlds to their end, once, on threads of this machine; these change nothing of what comes out.

        Args:
            threads: worlds at a time.
            members: threads that share each world.
            progress: called from the calling thread with (worlds done, worlds in all).

        Raises:
            InputError: threads or members below 1; or the worlds are at their end.
        """
        if threads < 1 or members < 1:
            raise InputError(f"threads is {threads} and members {members}; expected 1 or more")
        if self.scores.found[:, TAKEN].any():
            raise InputError("a batch runs once; expected a new one")
        T, stop = self.goal.samples, Event()
        chunk = max(1, _CHUNK // (self.loop.per_sample * len(self.loop.fleet.bodies)))

        def one(w: int) -> None:
            loop, crew = self.loop_of(w), Crew(members)
            try:
                for begin in range(0, T, chunk):
                    if stop.is_set():
                        return
                    crew.run(partial(part, loop, w, begin, min(begin + chunk, T)))
            finally:
                crew.close()

        def part(loop: Loop, w: int, begin: int, end: int, member: int, gate: IntArray) -> None:
            run_world(
                loop, self.motion, self.goal, self.scores, self.nothing, w, True, begin, end, member, members, gate
            )

        part(self.loop_of(0), 0, 0, 0, 0, Crew.gate())  # compiles, lest a member does while others wait
        with ThreadPoolExecutor(threads) as pool:
            futures = [pool.submit(one, w) for w in range(len(self))]
            try:
                for done, future in enumerate(as_completed(futures), 1):
                    future.result()
                    if progress:
                        progress(done, len(self))
            finally:
                stop.set()

    def outcomes(self) -> list[Outcome]:
        """What became of the worlds, once they have run.

        Raises:
            InputError: they have not.
        """
        if not self.scores.found[: len(self), TAKEN].all():
            raise InputError("the batch has not run to its end; expected `run` before")
        return [self._outcome(w) for w in range(len(self))]

    def _outcome(self, w: int) -> Outcome:
        found, goal, (vehicle, when) = self.scores.found[w], self.goal, self.scores.ended[w]
        message = ""
        if vehicle >= 0:
            with Fused(self._systems[w]) as fused:
                fused._loop = self.loop_of(w)
                message = fused._blow_up(int(vehicle), int(when) // 2)
        late = np.sqrt(found[[LATE_TRACKING, LATE_DISAGREEMENT]] / (goal.samples - goal.late))
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


def mapped(function: Callable[[NDArray[Any]], NDArray[Any]], tree: Any) -> Any:
    """A tree of named tuples with another array in the place of each."""
    if isinstance(tree, tuple):
        return type(tree)(*(mapped(function, part) for part in tree))
    return function(tree) if isinstance(tree, np.ndarray) else tree


def _field(kind: np.dtype[Any], number: np.dtype[Any]) -> tuple[Any, ...]:
    """Type and shape of a record's field, with a type in place of double precision."""
    base, shape = kind.subdtype or (kind, ())
    return (number if base == np.float64 else base), shape


def _only_system(run: System | Sequence[Phase]) -> System:
    phases = phases_of(run)
    if len(phases) > 1:
        raise InputError(f"events: {phases[1].name} at {phases[1].time:g} s; expected none, as worlds keep their edges")
    return phases[0].system


def _own(loop: Loop) -> tuple[Array, ...]:
    """What a world has of its own, in the order of Worlds, the memory as one."""
    law, harmonics = loop.control.law, loop.medium.harmonics
    of_loop = loop.qpos, loop.qvel, loop.ctrl, loop.act, loop.x, loop.drift, loop.sines
    return law.gain, law.limit, loop.control.motion.origin, *harmonics, *of_loop, loop.memory.flat


def groups_of_one_team(runs: Sequence[System]) -> list[list[int]]:
    """The numbers of the runs that can be worlds of one batch, group by group."""
    groups = list[tuple[dict[str, Any], list[int]]]()
    for k, system in enumerate(runs):
        with Fused(system) as fused:
            known = _shared(fused)
        for common, group in groups:
            if _difference(common, known) is None:
                group.append(k)
                break
        else:
            groups.append((known, [k]))
    return [group for _, group in groups]


def _shared(fused: Fused) -> dict[str, Any]:
    """What worlds share, by name, and the shapes of what they do not."""
    loop, system = fused._loop, fused.system
    rest = _named(loop)
    own = {"qpos", "qvel", "ctrl", "act", "x", "drift", "sines", "control.motion.origin"}
    own |= {"control.law.gain", "control.law.limit", "control.law.terms.seed", "control.law.links.seed"}
    rest = {name: value for name, value in rest.items() if not name.startswith(("memory.", "medium.harmonics."))}
    shared = {name: value for name, value in rest.items() if name not in own}
    return shared | {
        "sizes": [x.shape for x in _own(loop)],
        "motion": fused._motion,
        "team": system.team.members,
        "time": system.grid,
    }


def _named(tree: Any, name: str = "") -> dict[str, Any]:
    """The leaves of a tree, by their path."""
    if isinstance(tree, tuple) and hasattr(tree, "_asdict"):
        tree = tree._asdict()
    if not isinstance(tree, dict):
        return {name: tree}
    return {
        path: leaf for key, part in tree.items() for path, leaf in _named(part, f"{name}.{key}"[not name :]).items()
    }


def _difference(one: dict[str, Any], other: dict[str, Any]) -> str | None:
    """Where two differ first."""
    for name, value in one.items():
        other_value = other[name]
        if isinstance(value, np.ndarray):
            same = value.shape == other_value.shape and value.tobytes() == other_value.tobytes()
        else:
            same = value == other_value
        if not same:
            return name
    return None


def _distinct(bounds: Sequence[Array]) -> tuple[IntArray, Array]:
    """Which of the distinct arrays each is, and these, shape (U, T)."""
    found = dict[bytes, tuple[int, Array]]()
    which = [found.setdefault(one.tobytes(), (len(found), one))[0] for one in bounds]
    return np.array(which, dtype=np.int64), np.array([one for _, one in found.values()])


def _goal_of(system: System, bounds: Array) -> Goal:
    """What the worlds of a system are scored by."""
    team, steps = system.team, system.grid.steps
    N, n_p = len(team.agents), team.dirichlet.B.shape[1]
    if len(team.first_state) * n_p > _MOST_NUMBERS:
        raise InputError(f"agents: {N} with {n_p} coordinates of targets are more than a batch scores")
    rest = team.extend(np.zeros(n_p))
    places = np.column_stack(np.divmod(team.slots, 3)).astype(np.int64)
    time = system.grid.samples
    return Goal(
        carry=np.ascontiguousarray((team.extend(np.eye(n_p)) - rest).T),
        rest=rest,
        own=places,
        first=np.asarray(team.first_state, dtype=np.int64),
        bounds=bounds,
        samples=steps + 1,
        late=int(np.searchsorted(time, 0.5 * (time[0] + time[-1]) - 1e-9)),
        second=(steps + 1) // 2,
    )
