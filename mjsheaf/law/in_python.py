"""Laws in Python: one call a control period, in place of the agents' own law, on both backends.

A law is a callable `law(t, sample)` that returns the agents' velocities relative to the medium, shape (N, 3), m/s; it
may have a method `reset(team, rng)`, called before the first sample. `sample` holds the local information of the agents
and, separately in `sample.truth`, what no agent can measure. Targets, references, speed limits and recording are as for
the compiled law.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, visible
from mjsheaf.files import describe, in_this_directory
from mjsheaf.law.law import LawArrays, Memory, link_of
from mjsheaf.law.terms import Traffic
from mjsheaf.sheaf.nonlinear import measure
from mjsheaf.team import Edge, Team


class ReadOnlyTeam(Team):
    """Read-only view of the run's team, passed to a law."""

    def __init__(self, team: Team) -> None:
        """Take over all that a team has; `remaining` is computed anew, because it may be the run's own team."""
        vars(self).update({name: _read_only(value) for name, value in vars(team).items() if name != "remaining"})

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"cannot set {name}: the team that a law is handed is read-only")


def _read_only(value: Any) -> Any:
    """Return views of arrays and mappings that cannot be written, also those of edges, and copies of lists."""
    if isinstance(value, np.ndarray):
        view = value.view()
        view.flags.writeable = False
        return view
    if isinstance(value, dict):
        return MappingProxyType({key: _read_only(one) for key, one in value.items()})
    if isinstance(value, Edge):
        return replace(value, **{field.name: _read_only(getattr(value, field.name)) for field in fields(value)})
    if type(value) in (list, tuple):
        return type(value)(map(_read_only, value))
    return value


class View:
    """Places of the agents' measurements in the memory of a law; each phase of a run has its own.

    Attributes:
        team: The run's team.
        shown: The same, read-only.
        edges: Edges at which agents measure: communication, sensing, anchors; E of them.
        places: Slice of `memory.y` with the numbers of each edge.
        linked: True for each edge that has a link, shape (E,).
        links: Index of each edge with a link in the links' memory.
        neighbours: Indices of the agents that each agent communicates with.
    """

    def __init__(self, team: Team, law: LawArrays) -> None:
        self.team = team
        self.shown = ReadOnlyTeam(team)
        self.edges = self.shown.measuring_edges
        every, linked = range(len(law.edges.tail)), len(team.communication) + len(team.sensing)
        rows = [*every[:linked], *every[len(every) - len(team.anchors) :]]  # without those among targets
        slices = [slice(begin, end) for begin, end in pairwise(law.edges.first)]
        self.places = [slices[row] for row in rows]
        links = np.array([link_of(law, row) for row in rows], dtype=np.int64)
        self.linked = links >= 0
        self.links = links[self.linked]
        near: list[dict[int, None]] = [{} for _ in team.agents]
        for e in team.communication:
            i, j = team.index[e.tail], team.index[e.head]
            near[i][j] = near[j][i] = None
        self.neighbours = [list(js) for js in near]


@dataclass(frozen=True)
class Truth:
    """Quantities that no agent can measure; for debugging, for rewards and for drawing.

    Attributes:
        positions: Positions of agents, then targets, padded, shape (V, 3), m.
        attitude: Quaternions (w, x, y, z) of agents, then targets, body to world, shape (V, 4).
    """

    positions: Array
    attitude: Array
    _team: Team  # the run's own
    _time: float = 0.0

    @cached_property
    def harmonic_extension(self) -> Array:
        """q*, padded, shape (N, 3), m."""
        return self._team.harmonic_extension(self.positions, self._time)


class Sample:
    """Local information of N agents at a sample, with E edges at which they measure.

    Attributes:
        time: Time of the sample, s.
        team: The team as the phase begins, read-only; `team.agent_ids` names the rows of arrays.
        edges: The edges at which agents measure: communication, sensing, anchors; with the present offsets.
        measurements: y_e = F_head x_head - F_tail x_tail of each edge, in its stalk, m, as its link delivers it; -b_e
            if nothing is received. For a range edge the distance, shape (1,), m; for a bearing edge the unit vector
            from tail to head; both zero if nothing is received.
        jacobians: dh/dz of each edge, h what it measures and z = F_head x_head - F_tail x_tail: the identity, of a
            range shape (1, m), of a bearing shape (m, m), 1/m.
        residuals: Measured minus desired value of each edge: y_e + b_e, and h - h* of ranges and bearings. The edge
            adds -F_tail^T J^T K residual to its tail's disagreement; for a bearing, K contains the factor |z|.
        received: True for each edge with a measurement, new or held, shape (E,).
        disagreement: eta computed from these measurements, padded, shape (N, 3), m.
        command: Velocities relative to the medium that the compiled law commands, padded, shape (N, 3), m/s; under a
            law in Python, those that it returned last. Velocities added from outside are not included.
        velocity: Velocities over ground, shape (N, 3), m/s: of bodies now, on ideal kinematics the mean since the
            sample before.
        angular_velocity: Angular velocities in body axes, shape (N, 3), rad/s; zero on ideal kinematics.
        displacement: Displacements of the controlled positions since the sample before, zero at the first, shape
            (N, 3), m.
        attitude: Quaternions (w, x, y, z), body to world, shape (N, 4).
        truth: Quantities that no agent can measure.
    """

    def __init__(
        self,
        view: View,
        time: float,
        positions: Array,
        attitude: Array,
        displacement: Array,
        velocity: Array,
        memory: Memory,
        traffic: Traffic,
    ) -> None:
        N = len(view.team.agents)
        self.time = time
        self.team: Team = view.shown
        self.edges = view.edges if view.team.ramp is None else view.shown.edges_at(time)
        self.measurements, self.jacobians, self.residuals = list[Array](), list[Array](), list[Array]()
        for edge, place in zip(self.edges, view.places, strict=True):
            y = memory.y[place].copy()  # of the relative position, less b
            h, J, residual = y, np.eye(len(y)), y + edge.b
            if edge.measures != "position" and edge.offset is not None:
                h, J = measure(edge.measures, residual)
                residual = h - edge.offset if h.any() else np.zeros_like(h)
            self.measurements.append(h)
            self.jacobians.append(J)
            self.residuals.append(residual)
        self.received = np.ones(len(view.edges), dtype=np.bool_)
        self.received[view.linked] = memory.links.heard[view.links] > 0.0
        self.disagreement = memory.residual[:N].copy()
        self.command = memory.command[:N].copy()
        self.velocity = velocity[:, :3].copy()
        self.angular_velocity = velocity[:, 3:].copy()
        self.displacement = displacement
        self.attitude = attitude[:N].copy()
        self.truth = Truth(positions, attitude, view.team, time)
        self._view = view
        self._traffic = traffic

    @property
    def heard(self) -> list[bool]:
        """The same as `received`, as a list."""
        return cast(list[bool], self.received.tolist())

    def exchange(self, values: ArrayLike) -> list[dict[str, Array]]:
        """Let every agent send numbers to its neighbours: one round of communication, which is counted.

        Args:
            values: Numbers that each agent sends, shape (N, ...).

        Returns:
            For each agent what it receives, by the neighbour's id.
        """
        sent = real_numbers(values)
        ids = self._view.team.agent_ids
        neighbours = self._view.neighbours
        if sent.shape[:1] != (len(ids),):
            raise InputError(f"exchange: values have shape {sent.shape}; expected ({len(ids)}, ...)")
        messages = sum(map(len, neighbours))
        self._traffic.rounds += 1
        self._traffic.messages += messages
        self._traffic.numbers += messages * (sent.size // len(sent))
        return [{ids[j]: sent[j].copy() for j in near} for near in neighbours]


def real_numbers(values: ArrayLike) -> Array:
    """Return numbers as float64.

    Raises:
        TypeError: They are complex, not numbers, or a masked array with missing values.
    """
    if isinstance(values, (list, tuple)) and any(isinstance(row, np.ma.MaskedArray) for row in values):
        values = cast(ArrayLike, np.ma.array(values))
    if np.ma.is_masked(values):
        raise TypeError("expected real numbers, not a masked array with masked entries")
    found = np.asarray(values)
    if found.dtype.kind not in "buif":
        raise TypeError(f"expected real numbers, not {str(values)[:40]} of type {found.dtype}")
    return found.astype(np.float64)


MAX_SPEED = 1e9
"""Largest velocity that a law may return, m/s."""

_STREAM = 0x6C6177  # keeps a law's random numbers apart from others of the same seed
Law = Callable[[float, Sample], ArrayLike]


class Controller:
    """A law in Python, called once a control period.

    Attributes:
        law: The law.
        name: Name in messages and results.
        seed: Seed of the random generator that is passed to the law's `reset`.
        traffic: Communication since the start of the run.
    """

    def __init__(self, law: Law, name: str = "", seed: int = 0) -> None:
        """Wrap a law; `seed` is that of the random generator passed to its `reset`.

        Raises:
            InputError: It cannot be called.
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
        self.traffic = Traffic()

    def reset(self, team: Team) -> None:
        """Begin a run with a team."""
        self.traffic.rounds = self.traffic.messages = self.traffic.numbers = 0
        reset = getattr(self.law, "reset", None)
        if reset is not None:
            rng = np.random.default_rng([self.seed, _STREAM])
            self._guarded("reset", lambda: reset(team, rng))

    def call(self, team: Team, sample: Sample) -> Array:
        """Call the law of a team and return the velocities that it commands, padded, shape (N, 3), m/s.

        Raises:
            InputError: the law raised an exception, or did not return finite velocities of shape (N, 3).
        """
        ids = team.agent_ids
        t = sample.time
        when = f"t = {t:.6g} s"
        returned = self._guarded(when, lambda: real_numbers(self.law(t, sample)))
        if returned.shape != (len(ids), 3):
            raise InputError(
                f"controller {self.name} at {when}: returned shape {returned.shape}; "
                f"expected ({len(ids)}, 3), a velocity in m/s for each agent"
            )
        good = np.abs(returned) <= MAX_SPEED  # False if not finite
        if not good.all():
            i = int(np.flatnonzero(~good.all(axis=1))[0])
            raise InputError(
                f"controller {self.name} at {when}: returned {returned[i]} for {ids[i]}; "
                f"expected finite velocities of at most {MAX_SPEED:g} m/s"
            )
        return cast(Array, returned)

    def cause_of_blow_up(self, team: Team, vehicle: int, command: Array) -> str:
        """Return a message that the law may have caused a blow-up under commands (V, 3), m/s; empty for a target."""
        if vehicle >= len(team.agents):
            return ""
        speed = float(np.linalg.norm(command[vehicle]))
        return (
            f"likely cause: controller {self.name}, which commands {speed:.3g} m/s for {team.agent_ids[vehicle]}, "
            "or a flow too strong to integrate"
        )

    def _guarded(self, when: str, call: Callable[[], Any]) -> Any:
        try:
            with in_this_directory():
                return call()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            who = f"{error}, " if isinstance(error, _AgentError) else ""
            cause = error.__cause__ if isinstance(error, _AgentError) and error.__cause__ else error
            raise InputError(f"controller {self.name}: {who}{when}: {describe(cause)}") from error


def controller_of(law: Law | Controller | None, system: Any, seed: int = 0) -> Controller | None:
    """Return the controller of a run, or None if it has none.

    Raises:
        InputError: The control period is 0, so there is no sample at which to call it.
    """
    if law is not None and system.grid.continuous:
        raise InputError("controller.control_period is 0; expected a positive one with a law in Python, in s")
    return law if law is None or isinstance(law, Controller) else Controller(law, seed=seed)


class _AgentError(Exception):
    """The law of an agent, its one argument, raised an exception, its cause."""


@dataclass(frozen=True)
class LocalSample:
    """Local information of one agent at a sample.

    Attributes:
        edges: Present edges of the agent, with the present offsets; a subset of `Agent.edges` if a phase has fewer.
        measurements: y_e of each of them, m; -b_e if nothing is received. See `Sample` for these and the next two.
        jacobians: dh/dz of each of them.
        residuals: Measured minus desired value of each of them.
        disagreement: eta_i, padded, shape (3,), m.
        velocity: Velocity over ground, shape (3,), m/s.
        displacement: Change of its controlled position since the previous sample, zero at the first, shape (3,), m.
        attitude: quaternion (w, x, y, z), body to world, shape (4,).
    """

    edges: tuple[Edge, ...]
    measurements: list[Array]
    jacobians: list[Array]
    residuals: list[Array]
    disagreement: Array
    velocity: Array
    displacement: Array
    attitude: Array


@dataclass(frozen=True)
class Agent:
    """Description of an agent for its law.

    Attributes:
        id: Id of the agent.
        dimension: Dimension of its state, 2 or 3.
        edges: Edges of the agent: communication, sensing, anchors.
        rng: Random number generator of the agent.
    """

    id: str
    dimension: int
    edges: tuple[Edge, ...]
    rng: np.random.Generator


class PerAgent:
    """A law made of one object per agent, each of which receives only the agent's own edges.

    `make(agent)` returns agent i's law, called as `law(t, local)`; it returns the agent's velocity, shape (n_i,) or
    (3,), m/s. A law that is a generator exchanges numbers with its neighbours: `received = yield values` sends `values`
    and gets a dict of theirs, by id. Generators advance in rounds together: in a round all agents yield, or all return.
    """

    def __init__(self, make: Callable[[Agent], Callable[[float, LocalSample], Any]]) -> None:
        """Store the function that makes the agents' laws.

        Raises:
            InputError: It cannot be called.
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
        """Return the velocities of all agents, shape (N, 3), m/s."""
        if sample.team is not self._team:
            self._enter(sample.team)
        ids = sample.team.agent_ids
        velocity = np.zeros((len(self._laws), 3))
        running: dict[int, Any] = {}
        for i, law in enumerate(self._laws):
            with _naming(ids[i]):
                local = LocalSample(
                    tuple(sample.edges[k] for k in self._own[i]),
                    [sample.measurements[k].copy() for k in self._own[i]],
                    [sample.jacobians[k].copy() for k in self._own[i]],
                    [sample.residuals[k].copy() for k in self._own[i]],
                    sample.disagreement[i],
                    sample.velocity[i],
                    sample.displacement[i],
                    sample.attitude[i],
                )
                found = law(t, local)
                if inspect.isgenerator(found):
                    running[i] = found
                else:
                    _put(velocity[i], found)
        received: Sequence[Mapping[str, Array] | None] = [None] * len(ids)
        while running:
            sent: dict[int, Array] = {}
            for i, law in list(running.items()):
                with _naming(ids[i]):
                    try:
                        sent[i] = np.atleast_1d(real_numbers(law.send(received[i])))
                    except StopIteration as done:
                        del running[i]
                        _put(velocity[i], done.value)
            if not sent:
                break
            if len(sent) != len(ids):
                silent = next(ids[i] for i in range(len(ids)) if i not in sent)
                raise InputError(f"{silent} has no numbers for a round in which others exchange; all agents must yield")
            sizes = {values.shape for values in sent.values()}
            if len(sizes) > 1:
                raise InputError(f"agents exchange values of unlike shapes {sorted(sizes)}; expected one shape")
            received = sample.exchange(np.stack([sent[i] for i in range(len(ids))]))
        return velocity


def _put(row: Array, value: Any) -> None:
    found = real_numbers(value)
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
