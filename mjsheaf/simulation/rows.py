"""Runs of one team side by side in memory, which differ in seed, gain, disturbance or where they begin.

What such a run, a world, has of its own (state, memory of the law, gains, harmonics) is a row of one array; all else is
there once. `world_of` makes the Loop of a world from both, in Python and in compiled code alike, so that worlds go
through the very functions of the fused engine: each ends bit for bit as it does alone.

A row's numbers lie one after the other for threads of this machine, each of which takes a world at a time; and number
by number for a card (`order="F"`, see `card`), where neighbouring threads take the same vehicle of neighbouring worlds.
"""

import pickle
from collections.abc import Callable, Iterator, Sequence
from hashlib import sha256
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import DTypeLike, NDArray

from mjsheaf.arrays import Array, IntArray
from mjsheaf.control.law import ControlArrays, LawArrays, Memory
from mjsheaf.control.links import LinkArrays, LinkMemory
from mjsheaf.control.rounds import RoundMemory
from mjsheaf.control.terms import TermArrays, TermMemory
from mjsheaf.dynamics.disturbance import HarmonicArrays
from mjsheaf.dynamics.motion import MotionArrays
from mjsheaf.errors import InputError
from mjsheaf.jit import inline_jit
from mjsheaf.simulation.fused import Fused
from mjsheaf.simulation.loop import Loop
from mjsheaf.system import MediumArrays

LARGEST = 100_000_000
"""Numbers of the rows of one group, at most."""


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
        terms.streams,
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
        remembered.rate[w],
        remembered.age[w],
        remembered.since[w],
        remembered.x[w],
        remembered.moved[w],
        remembered.walked[w],
        remembered.seen[w],
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
        loop.station,
        loop.start,
        loop.timestep,
        loop.per_law,
        loop.per_sample,
    )


class Rows:
    """Runs of one team, at their start, as rows.

    Attributes:
        loop: what they have in common; what each has of its own is that of the first.
        motion: a MOTION for each kind of vehicle.
        values: what all have of their own, shape (W, n), of which `worlds` has views.
        worlds: see there.
    """

    def __init__(
        self, runs: Sequence[Fused], *, order: Literal["C", "F"] = "C", number: DTypeLike = np.float64
    ) -> None:
        """Lay out copies of the runs.

        Args:
            runs: at their start, of one team.
            order: "C" puts a world's numbers side by side, "F" each number of all worlds.
            number: type of all that is not a count, float64 or float32. Single precision loses what is small beside
                a coordinate: near the origin up to 2e-4 m, 10 km away from it much of a step.

        Raises:
            InputError: there is no run, one has begun, or it differs from the first in what worlds share; or a type
                other than double or single precision.
        """
        if not runs:
            raise InputError("no run; expected one or more")
        self._type, common = np.dtype(number), _shared(runs[0])
        if self._type not in (np.float64, np.float32):
            raise InputError(f"number: {self._type}; expected float64 or float32")
        whole, motion = runs[0].compiled
        # One row lies in C's order and in Fortran's, and would be compiled otherwise than several: it is there twice.
        several = list(runs) * (1 + (len(runs) == 1))
        self.values = np.empty((len(several), _size(whole)), dtype=self._type, order=order)
        for w, run in enumerate(several):
            if run.time != run.system.grid.start:
                raise InputError(f"run {w} is at {run.time:g} s; expected one at its start")
            if w and (where := _difference(common, _shared(run))) is not None:
                raise InputError(f"{where}: run {w} has another than run 0; expected runs of one team")
            self.values[w] = np.concatenate([part.ravel() for part in _own(run.compiled[0])])
        self.loop: Loop = mapped(self.in_numbers, whole)
        self.motion = self.in_numbers(motion)
        seeds = [_seed(run.compiled[0]) for run in several]
        self.worlds = Worlds(np.array(seeds, dtype=np.int64), *self._views(whole))

    def loop_of(self, w: int) -> Loop:
        """The Loop of world w, for threads of this machine."""
        found: Loop = world_of.py_func(self.loop, self.worlds, w)
        return found

    def in_numbers(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values with the rows' type in place of double precision."""
        if values.dtype.names is None:
            return values.astype(self._type) if values.dtype == np.float64 else values
        fields = [(name, *_field(values.dtype[name], self._type)) for name in values.dtype.names]
        return values.astype(np.dtype(fields, align=True))

    def _views(self, loop: Loop) -> Iterator[Any]:
        """What Worlds have after the seed, as views of the rows that are laid out as parts of one Loop."""
        begin = 0

        def view(part: Array, offset: int) -> Array:
            strides = (self.values.strides[0], *(n // 8 * self.values.strides[1] for n in part.strides))
            start = self.values[:, offset:] if part.size else self.values[:, :0]
            return as_strided(start, (len(self.values), *part.shape), strides)

        *parts, flat = _own(loop)
        for part in parts:
            yield view(part, begin)
            begin += part.size
        origin = flat.ctypes.data

        def of_memory(values: NDArray[Any]) -> NDArray[Any]:
            if not _is_remembered(values):
                return values
            return view(values, begin + (values.ctypes.data - origin) // 8 * (values.size > 0))

        yield mapped(of_memory, loop.memory)


def mapped(function: Callable[[NDArray[Any]], NDArray[Any]], tree: Any) -> Any:
    """A tree of named tuples with another array in the place of each."""
    if isinstance(tree, tuple):
        return type(tree)(*(mapped(function, part) for part in tree))
    return function(tree) if isinstance(tree, np.ndarray) else tree


def _field(kind: np.dtype[Any], number: np.dtype[Any]) -> tuple[Any, ...]:
    """Type and shape of a record's field, with a type in place of double precision."""
    base, shape = kind.subdtype or (kind, ())
    return (number if base == np.float64 else base), shape


def _own(loop: Loop) -> tuple[Array, ...]:
    """What a world has of its own, in the order of Worlds, the memory as one."""
    law, harmonics = loop.control.law, loop.medium.harmonics
    of_loop = loop.qpos, loop.qvel, loop.ctrl, loop.act, loop.x, loop.drift, loop.sines
    return law.gain, law.limit, loop.control.motion.origin, *harmonics, *of_loop, loop.memory.flat


def _is_remembered(values: NDArray[Any]) -> bool:
    """Whether an array of a Memory is a part of what it remembers; others say where to look, and are shared."""
    return values.dtype == np.float64


def _size(loop: Loop) -> int:
    """How many numbers a world has of its own."""
    return sum(part.size for part in _own(loop))


def _seed(loop: Loop) -> int:
    """Of the links' and terms' random numbers."""
    law = loop.control.law
    return law.links.seed if len(law.links.table) else law.terms.seed


def groups_of_one_team(runs: Sequence[Fused]) -> list[list[int]]:
    """The numbers of the runs that can be rows together, group by group, each of LARGEST numbers at most."""
    groups = dict[bytes, list[list[int]]]()
    for k, run in enumerate(runs):
        most = max(1, LARGEST // _size(run.compiled[0]))
        of_team = groups.setdefault(sha256(pickle.dumps(_shared(run))).digest(), [[]])
        if len(of_team[-1]) == most:
            of_team.append([])
        of_team[-1].append(k)
    return [group for of_team in groups.values() for group in of_team]


def _shared(run: Fused) -> dict[str, Any]:
    """What worlds share, by name, and the shapes of what they do not."""
    loop, motion = run.compiled
    own = {"qpos", "qvel", "ctrl", "act", "x", "drift", "sines", "control.motion.origin"}
    own |= {"control.law.gain", "control.law.limit", "control.law.terms.seed", "control.law.links.seed"}
    own |= set(_named(loop.medium.harmonics, "medium.harmonics"))
    own |= {name for name, values in _named(loop.memory, "memory").items() if _is_remembered(values)}
    return {name: value for name, value in _named(loop).items() if name not in own} | {
        "sizes": [x.shape for x in _own(loop)],
        "motion": motion,
        "team": run.system.team.members,
        "time": run.system.grid,
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
        if value is other_value:
            continue
        if isinstance(value, np.ndarray):
            same = value.shape == other_value.shape and value.tobytes() == other_value.tobytes()
        else:
            same = value == other_value
        if not same:
            return name
    return None
