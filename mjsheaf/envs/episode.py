"""The core of all environments: a scenario on bodies as a sequence of control periods, each with an action.

An action is a velocity for each agent, relative to the medium. It is added to the law's command before the speed limit;
see `add_supplied` in `mjsheaf.control.law`. An observation holds what the agent itself measures and nothing else. The
reward of an agent is -|q* - q|^2, so that its distance from 0 is the regret against a known optimum.
"""

import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arguments import require_scenario
from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.control.law import link_of, rows_of_measuring_edges
from mjsheaf.errors import InputError, UnstableError, expected
from mjsheaf.runs.simulate import require_simulable
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.world import World
from mjsheaf.system import System
from mjsheaf.team import Edge
from mjsheaf.vehicles.effects import capability_of, of_each

DEFAULT_ACTION_LIMIT = 10.0
"""Largest action of an agent without a velocity limit whose thrusters have no limits either, m/s."""

_log = logging.getLogger("mjsheaf")


class _Senses(NamedTuple):
    """Indices of the measurements of all agents, one agent after another, in the memory of a law.

    Attributes:
        numbers: Index in `memory.y` of each measured number; -1 where the edge is absent.
        links: Index in `memory.links.heard` of each edge; -1 where it is exact, -2 where it is absent.
    """

    numbers: IntArray
    links: IntArray


def _keys(edges: Iterable[Edge]) -> Iterator[tuple[tuple[str, str], int]]:
    """Yield a name for each edge that it has in all phases: its ends, and its number among edges of these ends."""
    met: Counter[tuple[str, str]] = Counter()
    for edge in edges:
        yield edge.between, met[edge.between]
        met[edge.between] += 1


def _senses(system: System, edges: Sequence[Edge], keys: Sequence[Any]) -> _Senses:
    """Find the edges of all agents, which have these keys, in the law of a system; see `_Senses`."""
    team, law = system.team, system.law
    first = law.edges.first
    row_of = dict(zip(_keys(team.measuring_edges), rows_of_measuring_edges(team, law), strict=True))
    numbers: list[int] = []
    links: list[int] = []
    for edge, key in zip(edges, keys, strict=True):
        row = row_of.get(key)
        if row is None:
            numbers += [-1] * len(edge.b)
            links.append(-2)
        else:
            numbers += range(first[row], first[row + 1])
            links.append(link_of(law, row))
    return _Senses(np.array(numbers, dtype=np.int64), np.array(links, dtype=np.int64))


class Episode:
    """A scenario on MuJoCo bodies, one control period at a time, with actions added to its law.

    Attributes:
        scenario: The scenario, with the seed of its episodes.
        world: The closed loop on bodies.
        agents: Ids of all agents, those included that are lost or have yet to join.
        dimensions: Components of each agent's action, shape (N,).
        action_limits: Largest size of each component of an agent's action, shape (N,), m/s: its velocity limit or, if
            it has none, its top speed, or `DEFAULT_ACTION_LIMIT` if nothing limits its thrusters.
        edges: Edges at which each agent measures in some phase, by its id.
        periods: Control periods of an episode.
        message: Reason why the simulation blew up; empty if it did not.
    """

    def __init__(
        self, scenario: Scenario, *, horizon: float | None = None, seed: int | None = None, visible: bool = True
    ) -> None:
        """Prepare the first episode.

        Args:
            scenario: The scenario, as `mjsheaf.load_scenario` returns it.
            horizon: Length of an episode, s, a whole number of control periods; up to `time.end` unless given.
            seed: Seed of every episode instead of the scenario's.
            visible: False for a model without the geoms that are only to be seen.

        Raises:
            InputError: The scenario cannot be simulated on bodies, or an argument is not valid.
            NotUniqueError: The harmonic extension is not unique.
        """
        require_scenario(scenario)
        if seed is not None:
            scenario = scenario.with_seed(seed)
        require_simulable(scenario.phases, "physics")
        self.scenario = scenario
        self.world = World(scenario, visible=visible)
        team = scenario.team
        self.agents = list(team.agent_ids)
        self.dimensions = np.array([agent.dimension for agent in team.agents])
        self.action_limits = _action_limits(scenario)
        grid = scenario.whole.grid
        self.periods = grid.steps if horizon is None else _whole_periods(horizon, grid.period, grid.steps)
        every = list(zip(team.measuring_edges, _keys(team.measuring_edges), strict=True))
        own = [[(edge, key) for edge, key in every if name in edge.between] for name in self.agents]
        self.edges = {name: [edge for edge, _ in mine] for name, mine in zip(self.agents, own, strict=True)}
        edges, keys = zip(*(both for mine in own for both in mine), strict=True) if every else ((), ())
        systems = {id(phase.system): phase.system for phase in self.world.phases}
        self._senses = {key: _senses(system, edges, keys) for key, system in systems.items()}
        self._sizes = np.array([len(edge.b) for edge in edges], dtype=np.int64)
        self._edge_ends = np.cumsum([len(mine) for mine in own])[:-1]
        self._number_ends = np.cumsum([sum(len(edge.b) for edge, _ in mine) for mine in own])[:-1]
        self.reset()

    def reset(self) -> None:
        """Go back to the start: the same episode again, to the bit."""
        self.world.reset()
        self.message = ""
        self.sample()

    def act(self, actions: Mapping[str, ArrayLike]) -> None:
        """Choose the velocities that are added to the law's commands from now on.

        Args:
            actions: Velocity relative to the medium by agent id, shape (n_i,), m/s; larger ones are cut to
                `action_limits`. An agent that is not named, or absent at present, gets none.

        Raises:
            InputError: An id is unknown, or an action is not finite or of another shape.
        """
        if not isinstance(actions, Mapping):
            raise InputError(f"action is a {type(actions).__name__}; expected a mapping of agent ids to velocities")
        velocity = np.zeros((len(self.agents), 3))
        for name, action in actions.items():
            if name not in self.scenario.team.index or name not in self.agents:
                raise InputError(f"action: unknown agent {name!r}; {expected(str(name), self.agents)}")
            i = self.scenario.team.index[name]
            n = self.dimensions[i]
            velocity[i, :n] = _velocity(name, action, n)
        velocity[~self.present] = 0.0
        limits = self.action_limits[:, None]
        self.world.add_to_command(np.clip(velocity, -limits, limits))

    def advance(self, steps: int) -> None:
        """Take physics steps, `world.steps_per_sample` in a control period, and a sample at the end of a period.

        If the simulation blows up, `message` says why. Observations and rewards stay those of the sample before.
        """
        try:
            self.world.step(steps)
        except UnstableError as error:
            self.message = str(error)
            _log.warning("episode of %s: %s", self.scenario.name, self.message)
            return
        self.sample()

    @property
    def finished(self) -> bool:
        """True from the end of an episode on."""
        return self._steps >= self.periods * self.world.steps_per_sample

    @property
    def _steps(self) -> int:
        """Physics steps since the start."""
        return round((self.world.time - self.scenario.whole.grid.start) / self.world.system.timestep)

    @property
    def horizon(self) -> float:
        """Length of an episode, s."""
        return self.periods * self.scenario.whole.grid.period

    @property
    def present(self) -> BoolArray:
        """True for each agent that is part of the team now, shape (N,)."""
        return self.world.system.team.present

    @property
    def rewards(self) -> Array:
        """-|q* - q|^2 of each agent at the last sample, shape (N,), m^2; 0 for absent agents."""
        return self._rewards.copy()

    def observe(self) -> dict[str, dict[str, Array]]:
        """Return what each agent measures at the last sample, by id.

        Returns:
            For each agent a dict with `measurements`: y_e of its edges (see `edges`) one after another, as their links
            deliver them, zero where nothing is received, m; `received`: True for each edge with a measurement;
            `attitude`: quaternion (w, x, y, z), body to world; `velocity`: over ground, world axes, (3,), m/s;
            `angular_velocity`: body axes, (3,), rad/s; `present`: False while the agent is lost or has yet to join:
            all the rest is then zero.
        """
        return {agent: {name: value.copy() for name, value in own.items()} for agent, own in self._observations.items()}

    def state(self) -> Array:
        """Return everything that determines the rest of the episode, as `World.get_state` does."""
        return self.world.get_state()

    def set_state(self, state: Array) -> None:
        """Continue from a result of `state`, to the bit.

        Raises:
            InputError: It is not a state of this scenario.
        """
        self.world.set_state(state)
        self.message = ""
        self.sample()

    def sample(self) -> None:
        """Let agents measure, if a control period begins now, and keep their observations and rewards.

        A sample may be taken again.
        """
        world = self.world
        if self._steps % world.steps_per_sample:
            return
        world.close_loop(sample=True)
        memory, senses = world.memory, self._senses[id(world.system)]
        received = np.concatenate([memory.links.heard > 0.0, [False, True]])[senses.links]
        numbers = np.concatenate([memory.y, [0.0]])[senses.numbers]
        numbers[~np.repeat(received, self._sizes)] = 0.0
        N = len(self.agents)
        present = self.present
        attitude = np.where(present[:, None], world.quaternions()[:N], 0.0)
        velocity = np.where(present[:, None], world.data.qvel.reshape(-1, 6)[:N], 0.0)
        by_agent = zip(
            self.agents,
            np.split(numbers, self._number_ends),
            np.split(received, self._edge_ends),
            attitude,
            velocity[:, :3],
            velocity[:, 3:],
            present,
            strict=True,
        )
        names = ("measurements", "received", "attitude", "velocity", "angular_velocity", "present")
        self._observations = {
            agent: {name: np.array(value) for name, value in zip(names, own, strict=True)} for agent, *own in by_agent
        }
        x = world.positions()
        error = world.system.team.harmonic_extension(x) - x[:N]
        self._rewards = np.where(present, -(error**2).sum(axis=1), 0.0)


def _action_limits(scenario: Scenario) -> Array:
    """The largest action of each agent, shape (N,), m/s; see `Episode.action_limits`."""
    system = scenario.whole
    N = len(system.team.agents)
    limits = system.law.limit[:N].copy()
    speed = of_each(system.vehicles[:N], lambda vehicle: capability_of(vehicle).forward_speed)
    limits = np.where(np.isfinite(limits), limits, speed)
    return np.where(np.isfinite(limits) & (limits > 0.0), limits, DEFAULT_ACTION_LIMIT)


def _whole_periods(horizon: float, period: float, most: int) -> int:
    """The control periods of a horizon in s.

    Raises:
        InputError: It is not a whole number of periods between 1 and `most`.
    """
    good = isinstance(horizon, int | float | np.integer | np.floating) and not isinstance(horizon, bool)
    ratio = float(horizon) / period if good else np.nan
    if not (0.5 < ratio < most + 0.5 and abs(ratio - round(ratio)) <= 1e-6 * ratio):
        raise InputError(
            f"horizon is {horizon!r}; expected a whole number of control periods of {period:g} s, up to the run's "
            f"{most * period:g} s"
        )
    return round(ratio)


def _velocity(name: str, action: ArrayLike, n: int) -> Array:
    """An action as numbers.

    Raises:
        InputError: It is of another shape, or not finite.
    """
    try:
        velocity = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        velocity = np.full(0, np.nan)
    if velocity.shape != (n,) or not np.isfinite(velocity).all():
        raise InputError(f"action of {name} is {str(action)[:60]}; expected {n} finite velocities in m/s")
    return velocity
