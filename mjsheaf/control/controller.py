"""The door for laws in Python: one call a control period, in place of the agents' own law, on both backends.

A law is a callable `law(t, sample)` that returns the agents' velocities relative to the medium, shape (N, 3), m/s; it
may have a method `reset(team, rng)`, called before the first sample. `sample` holds what agents may know, and apart
from that, named so, the truth. Targets, references, speed limits and recording are as for the compiled law.
"""

import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arrays import Array
from mjsheaf.control.law import ControlArrays, LawArrays, Memory, link_of, observe, rows_of_measuring_edges
from mjsheaf.control.terms import no_terms
from mjsheaf.errors import InputError, expected, visible
from mjsheaf.team import Edge, Team

MAX_SPEED = 1e9
"""Largest velocity that a law may return, m/s."""

_STREAM = 0x6C6177  # keeps a law's random numbers apart from others of the same seed
_MAX_MESSAGE = 300  # characters of an exception that a message repeats
Law = Callable[[float, "Sample"], ArrayLike]


@dataclass(frozen=True)
class Truth:
    """What no agent knows; for debugging.

    Attributes:
        positions: of agents, then targets, padded, shape (V, 3), m.
        harmonic_extension: q*, padded, shape (N, 3), m.
    """

    positions: Array
    harmonic_extension: Array


class ReadOnlyTeam(Team):
    """A team as a law is handed it: the run's own, of which the law can change nothing."""

    def __init__(self, team: Team) -> None:
        """Take over all that a team has, with read-only views of its arrays and mappings and copies of its lists."""
        own = dict(vars(team))
        own.pop("remaining", None)  # which may be the run's own team
        for name, value in own.items():
            if isinstance(value, np.ndarray):
                own[name] = _read_only(value)
        own["index"] = MappingProxyType(team.index)
        own["displacement"] = MappingProxyType({id: _read_only(o) for id, o in team.displacement.items()})
        for name in ("agent_ids", "target_ids"):
            own[name] = list(own[name])
        for name in ("communication", "sensing", "target_edges", "anchors"):
            own[name] = tuple(_read_only_edge(edge) for edge in own[name])
        vars(self).update(own)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"cannot set {name}: the team that a law is handed is read-only")


def _read_only(values: Array) -> Array:
    """Return a view that cannot be written."""
    view = values.view()
    view.flags.writeable = False
    return view


def _read_only_edge(edge: Edge) -> Edge:
    """Return an edge whose arrays cannot be written."""
    return replace(
        edge,
        F_tail=_read_only(edge.F_tail),
        F_head=_read_only(edge.F_head),
        weight=_read_only(edge.weight),
        offset=None if edge.offset is None else _read_only(edge.offset),
    )


class Sample:
    """What N agents may know at a sample.

    Attributes:
        team: the team, read-only; `team.agent_ids` names the rows of arrays.
        edges: those at which agents measure: communication, sensing, anchors.
        measurements: y_e = F_head x_head - F_tail x_tail of each edge, in its stalk, m, as its link delivers it; -b_e
            where nothing is heard.
        heard: whether each edge has a measurement, new or held.
        disagreement: eta by these, padded, shape (N, 3), m.
        velocity: over ground, shape (N, 3), m/s: of bodies now, on ideal kinematics the mean since the sample before.
        displacement: of the controlled position since the sample before, zero at the first, shape (N, 3), m.
        attitude: quaternions (w, x, y, z), body to world, shape (N, 4).
    """

    def __init__(
        self, door: "Controller", x: Array, memory: Memory, velocity: Array, displacement: Array, attitude: Array
    ) -> None:
        N = len(door.team.agents)
        self.team: Team = door.shown
        self.edges = door.edges
        self.measurements = [memory.y[place].copy() for place in door.places]
        self.heard = [link < 0 or bool(memory.links.heard[link] > 0.0) for link in door.links]
        self.disagreement = memory.residual[:N].copy()
        self.velocity, self.displacement, self.attitude = velocity, displacement, attitude.copy()
        self._door, self._x = door, x.copy()

    @cached_property
    def truth(self) -> Truth:
        """What no agent knows; for debugging."""
        return Truth(self._x, self._door.team.harmonic_extension(self._x))

    def exchange(self, values: ArrayLike) -> list[dict[str, Array]]:
        """Let every agent send numbers to its neighbours: one round of communication, which is counted.

        Args:
            values: what each agent sends, shape (N, ...).

        Returns:
            For each agent what it receives, by the neighbour's id.
        """
        sent, ids = _real(values), self._door.team.agent_ids
        if sent.shape[:1] != (len(ids),):
            raise InputError(f"exchange: values have shape {sent.shape}; expected ({len(ids)}, ...)")
        messages = sum(map(len, self._door.neighbours))
        self._door.rounds += 1
        self._door.messages += messages
        self._door.numbers += messages * (sent.size // len(sent))
        return [{ids[j]: sent[j].copy() for j in near} for near in self._door.neighbours]


class Controller:
    """A law in Python, called once a control period.

    Attributes:
        name: what messages call it.
        team: the team that it controls now.
        shown: The same as the law is handed it.
        rounds, messages, numbers: of communication so far: calls of `exchange`, what they sent from agent to agent, and
            how many numbers were in that.
    """

    def __init__(self, law: Law, name: str = "", seed: int = 0) -> None:
        """Wrap a law; the seed is that of the random numbers which its `reset` is handed.

        Raises:
            InputError: it cannot be called.
        """
        if inspect.isclass(law):
            raise InputError(f"controller: {law.__name__} is a class; expected an object, such as {law.__name__}()")
        if not callable(law):
            hint = "; load_controller reads one from FILE.py:NAME" if isinstance(law, str) else ""
            raise InputError(f"controller: expected a callable law(t, sample), not {type(law).__name__}{hint}")
        self.law = law
        called = name or str(getattr(law, "__name__", type(law).__name__))
        self.name = called if called.isprintable() else visible(called)
        self.seed = seed
        self.rounds = self.messages = self.numbers = 0

    def reset(self) -> None:
        """Begin a run with the team that was entered."""
        self.rounds = self.messages = self.numbers = 0
        self._time, self._before, self._now = -np.inf, np.zeros(0), np.zeros(0)
        reset = getattr(self.law, "reset", None)
        if reset is not None:
            rng = np.random.default_rng([self.seed, _STREAM])
            self._guarded("reset", lambda: reset(self.shown, rng))

    def enter(self, team: Team, control: ControlArrays) -> ControlArrays:
        """Control this team from here on, with other edges in another phase; return its law with agents supplied."""
        self.team = team
        self.shown = shown = ReadOnlyTeam(team)
        self.edges = shown.measuring_edges
        rows = rows_of_measuring_edges(team, control.law)
        slices = [slice(begin, end) for begin, end in pairwise(control.law.edges.first)]
        self.places = [slices[row] for row in rows]
        self.links = [link_of(control.law, row) for row in rows]
        near: list[dict[int, None]] = [{} for _ in team.agents]
        for e in team.communication:
            i, j = team.index[e.tail], team.index[e.head]
            near[i][j] = near[j][i] = None
        self.neighbours = [list(js) for js in near]
        return control._replace(law=control.law._replace(supplied=len(team.agents), terms=no_terms()))

    def supply(
        self, law: LawArrays, t: float, x: Array, memory: Memory, velocity: Array, attitude: Array, *, bodies: bool
    ) -> None:
        """Call the law at time t, s, for positions x (V, 3), m, and leave in the memory what it asks for.

        `bodies` says that the links' memory has the vehicles' attitudes.

        Raises:
            InputError: the law raised an exception, or did not return finite velocities of shape (N, 3).
        """
        N = len(self.team.agents)
        observe(law, t, x, bodies, memory)
        shown = Sample(self, x, memory, velocity, self._moved(t, x[:N].copy()), attitude)
        wanted = self._guarded(f"t = {t:.6g} s", lambda: _real(self.law(t, shown)))
        if wanted.shape != (N, 3):
            raise InputError(f"controller {self.name} at t = {t:.6g} s: returned shape {wanted.shape}; "
                             f"expected ({N}, 3), a velocity in m/s for each agent")  # fmt: skip
        good = np.abs(wanted) <= MAX_SPEED  # False where it is not finite
        if not good.all():
            i = int(np.flatnonzero(~good.all(axis=1))[0])
            raise InputError(
                f"controller {self.name} at t = {t:.6g} s: returned {wanted[i]} for {self.team.agent_ids[i]}; expected "
                f"finite velocities of at most {MAX_SPEED:g} m/s"
            )
        for i, agent in enumerate(self.team.agents):
            memory.supplied[i, : agent.dimension] = wanted[i, : agent.dimension]

    def cause_of_blow_up(self, vehicle: int, command: Array) -> str:
        """Say that the law may be why a vehicle's state blew up under commands (V, 3), m/s; empty for a target."""
        if vehicle >= len(self.team.agents):
            return ""
        speed = float(np.linalg.norm(command[vehicle]))
        return (
            f"likely cause: controller {self.name}, which asks for {speed:.3g} m/s for {self.team.agent_ids[vehicle]}, "
            "or a flow too strong to integrate"
        )

    def _moved(self, t: float, q: Array) -> Array:
        """How far agents at q (N, 3), m, have moved since the sample before, shape (N, 3), m."""
        if t != self._time:  # a sample may be taken again
            self._time, self._before = t, self._now
        self._now = q
        return q - self._before if len(self._before) else np.zeros_like(q)

    def _guarded(self, when: str, call: Callable[[], Any]) -> Any:
        try:
            with _in_this_directory():
                return call()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            who = f"{error}, " if isinstance(error, _AgentError) else ""
            cause = error.__cause__ if isinstance(error, _AgentError) and error.__cause__ else error
            raise InputError(f"controller {self.name}: {who}{when}: {_described(cause)}") from error


@contextmanager
def _in_this_directory() -> Iterator[None]:
    """Come back to the working directory, by which the results' place and files are named."""
    place = _working_directory()
    try:
        yield
    finally:
        if place is not None and _working_directory() != place:
            with suppress(OSError):
                os.chdir(place)


def _working_directory() -> str | None:
    """Return the working directory; None where it is gone."""
    with suppress(OSError):
        return os.getcwd()
    return None


def _real(values: ArrayLike) -> Array:
    """Return numbers as float64.

    Raises:
        TypeError: they are complex, no numbers, or a masked array that lacks some.
    """
    if isinstance(values, (list, tuple)) and any(isinstance(row, np.ma.MaskedArray) for row in values):
        values = cast(ArrayLike, np.ma.array(values))
    if np.ma.is_masked(values):
        raise TypeError("expected real numbers, not a masked array with masked entries")
    found = np.asarray(values)
    if found.dtype.kind not in "buif":
        raise TypeError(f"expected real numbers, not {str(values)[:40]} of type {found.dtype}")
    return found.astype(np.float64)


def _described(error: BaseException) -> str:
    """An exception of the user's code in a line, with where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)[-1:]
    place = "".join(f" ({visible(Path(frame.filename).name)}, line {frame.lineno})" for frame in frames)
    try:
        text = str(error)
    except (Exception, SystemExit):
        text = "an exception that cannot be printed, as its __str__ raises another"
    return f"{visible(type(error).__name__)}: {visible(text, _MAX_MESSAGE)}{place}"


def controller_of(law: "Law | Controller | None", system: Any, seed: int) -> "Controller | None":
    """The controller of a run, where it has one.

    Raises:
        InputError: the control period is 0, so that there is no sample at which to call it.
    """
    if law is not None and system.grid.continuous:
        raise InputError("controller.control_period is 0; expected a positive one with a law in Python, in s")
    return law if law is None or isinstance(law, Controller) else Controller(law, seed=seed)


class _AgentError(Exception):
    """The law of an agent, its one argument, raised an exception, its cause."""


@dataclass(frozen=True)
class LocalSample:
    """What one agent may know at a sample.

    Attributes:
        edges: of the agent, now; those of its `Agent.edges` up to a phase with other edges.
        measurements: y_e of each of them, m; -b_e where nothing is heard.
        disagreement: eta_i, padded, shape (3,), m.
        velocity: over ground, shape (3,), m/s.
        displacement: of its controlled position since the sample before, zero at the first, shape (3,), m.
        attitude: quaternion (w, x, y, z), body to world, shape (4,).
    """

    edges: tuple[Edge, ...]
    measurements: list[Array]
    disagreement: Array
    velocity: Array
    displacement: Array
    attitude: Array


@dataclass(frozen=True)
class Agent:
    """What one agent's law is made from.

    Attributes:
        id: of the agent.
        dimension: of its state, 2 or 3.
        edges: its own edges: communication, sensing, anchors.
        rng: its own random numbers.
    """

    id: str
    dimension: int
    edges: tuple[Edge, ...]
    rng: np.random.Generator


class PerAgent:
    """A law made of one object per agent, each handed its own edges only.

    `make(agent)` returns agent i's law, called as `law(t, local)`; it returns the agent's velocity, shape (n_i,) or
    (3,), m/s. A law that is a generator exchanges numbers with its neighbours: `received = yield values` sends `values`
    and gets a dict of theirs, by id. Generators advance in rounds together: in a round all agents yield, or all return.
    """

    def __init__(self, make: Callable[[Agent], Callable[[float, LocalSample], Any]]) -> None:
        """Keep what makes the agents' laws.

        Raises:
            InputError: it cannot be called.
        """
        if not callable(make):
            raise InputError(f"PerAgent: expected a callable make(agent) that returns a law, not {type(make).__name__}")
        self._make = make
        self.__name__ = getattr(make, "__name__", type(make).__name__)

    def reset(self, team: Team, rng: np.random.Generator) -> None:
        """Make the agents' laws."""
        self._enter(team)
        self._laws = []
        for agent, edges, child in zip(team.agents, self._edges, rng.spawn(len(team.agents)), strict=True):
            with _naming(agent.id):
                law = self._make(Agent(agent.id, agent.dimension, edges, child))
                if not callable(law):
                    raise TypeError(f"make(agent) returned {type(law).__name__}; expected a callable law(t, local)")
                self._laws.append(law)

    def _enter(self, team: Team) -> None:
        edges, self._team = team.measuring_edges, team
        self._own = [[k for k, e in enumerate(edges) if a.id in (e.tail, e.head)] for a in team.agents]
        self._edges = [tuple(edges[k] for k in own) for own in self._own]

    def __call__(self, t: float, sample: Sample) -> Array:
        """The velocities of all agents, shape (N, 3), m/s."""
        if sample.team is not self._team:
            self._enter(sample.team)
        ids, velocity = sample.team.agent_ids, np.zeros((len(self._laws), 3))
        running: dict[int, Any] = {}
        for i, law in enumerate(self._laws):
            local = LocalSample(
                self._edges[i],
                [sample.measurements[k].copy() for k in self._own[i]],
                sample.disagreement[i],
                sample.velocity[i],
                sample.displacement[i],
                sample.attitude[i],
            )
            with _naming(ids[i]):
                found = law(t, local)
                if inspect.isgenerator(found):
                    running[i] = found
                else:
                    _put(velocity[i], found)
        received: list[Mapping[str, Array] | None] = [None] * len(ids)
        while running:
            sent: dict[int, Array] = {}
            for i, law in list(running.items()):
                with _naming(ids[i]):
                    try:
                        sent[i] = np.atleast_1d(_real(law.send(received[i])))
                    except StopIteration as done:
                        del running[i]
                        _put(velocity[i], done.value)
            if not sent:
                break
            if len(sent) != len(ids):
                silent = next(ids[i] for i in range(len(ids)) if i not in sent)
                raise InputError(f"{silent} has no numbers for a round in which others exchange; all agents must yield")
            if len(sizes := {values.shape for values in sent.values()}) > 1:
                raise InputError(f"agents exchange values of unlike shapes {sorted(sizes)}; expected one shape")
            received = list(sample.exchange(np.stack([sent[i] for i in range(len(ids))])))
        return velocity


def _put(row: Array, value: Any) -> None:
    found = _real(value)
    if found.ndim != 1 or len(found) not in (2, 3):
        raise InputError(f"returned shape {found.shape}; expected (2,) or (3,), a velocity in m/s")
    row[: len(found)] = found


@contextmanager
def _naming(agent: str) -> Iterator[None]:
    """Name the agent whose law raises."""
    try:
        yield
    except Exception as error:
        raise _AgentError(agent) from error


def load_controller(source: str, seed: int = 0) -> Controller:
    """The law FILE.py:NAME, a function, an object or a class that is made without arguments.

    Raises:
        InputError: there is no such file or name, or the file raises an exception.
    """
    if not isinstance(source, str):
        raise InputError(f"controller: expected FILE.py:NAME as a str, not {type(source).__name__}")
    file, colon, name = source.rpartition(":")
    path = Path(file)
    if not colon or not name.isidentifier() or path.suffix != ".py":
        raise InputError(f"--controller {source!r}: expected FILE.py:NAME, for example mylaw.py:MyLaw")
    source = source if source.isprintable() else visible(source)
    if not path.is_file():
        raise InputError(f"--controller {source}: there is no such file")
    module_name = f"mjsheaf_controller_{path.stem}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None  # of a .py file
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # dataclasses and pickle look a class's module up
    try:
        with _in_this_directory():
            spec.loader.exec_module(module)
            law: Any = getattr(module, name, None)
            law = law() if inspect.isclass(law) else law
        if not hasattr(module, name):
            public = [n for n, value in vars(module).items() if callable(value) and not n.startswith("_")]
            raise InputError(f"there is no {name!r} in it; {expected(name, public)}")
        return Controller(cast(Law, law), source, seed)
    except KeyboardInterrupt:
        raise
    except InputError as error:
        raise InputError(f"--controller {source}: {error}") from None
    except BaseException as error:
        raise InputError(f"--controller {source}: {_described(error)}") from error
