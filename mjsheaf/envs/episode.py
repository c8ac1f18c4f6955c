"""The core of all environments: a scenario on bodies as a sequence of control periods, each with an action.

An action is a velocity for each agent, relative to the medium, or the commands of its actuators. A velocity is added to
the law's command before the speed limit; see `mjsheaf.law.law.evaluate_law`. An observation holds what the
agent itself measures and nothing else. The reward of an agent is -|q* - q|^2, so that its distance from 0 is the regret
against a known optimum.
"""

import logging
from collections import Counter
from collections.abc import Iterable, Mapping
from copy import deepcopy
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arguments import real_numbers, require_choice, require_scenario, require_seed
from mjsheaf.arrays import Array, BoolArray
from mjsheaf.errors import InputError, UnstableError, expected
from mjsheaf.loop.engine import Commanded
from mjsheaf.loop.fused import SquareErrors
from mjsheaf.loop.loop import ClosedLoop
from mjsheaf.loop.session import Session
from mjsheaf.noise import next_seed
from mjsheaf.progress import shown
from mjsheaf.scenario import Scenario
from mjsheaf.team import Edge

DEFAULT_ACTION_LIMIT = 10.0
"""Largest action of an agent without a velocity limit whose thrusters have no limits either, m/s."""

_COMMANDED: dict[str, Commanded] = {"residual": False, "velocity": True, "thrust": "thrust"}
ACTIONS = tuple(_COMMANDED)
"""Kinds of actions: velocities that are added to the commands of the law, velocities that take their place, or commands
of actuators, which take the place of law and autopilot."""


def named_edges(edges: Iterable[Edge]) -> dict[tuple[tuple[str, str], int], Edge]:
    """Return edges by a name that each has in all phases: its ends, and its number among edges of these ends."""
    met: Counter[tuple[str, str]] = Counter()
    named = {}
    for edge in edges:
        named[edge.between, met[edge.between]] = edge
        met[edge.between] += 1
    return named


class Episode:
    """A scenario on MuJoCo bodies, one control period at a time, with actions added to its law.

    Attributes:
        session: The run, period by period.
        world: Its closed loop on bodies.
        agents: Ids of all agents, those included that are lost or have yet to join.
        action: Kind of the actions, see `ACTIONS`.
        dimensions: Components of each agent's action, shape (N,).
        action_limits: Largest size of each component of an agent's velocity, shape (N,), m/s: its velocity limit or, if
            it has none, its top speed, or `DEFAULT_ACTION_LIMIT` if nothing limits its thrusters.
        bounds: Smallest and largest action by agent id, shape (2, n_i): `action_limits` both ways, m/s; of 'thrust' the
            limits of the agent's actuators, N, or rad for angles.
        edges: Edges at which each agent measures in some phase, by its id.
        keys: Names of these edges; see `named_edges`.
        periods: Control periods of an episode.
        same_episode: True if `reset` repeats the episode.
        begun: True once an episode has begun by `reset`.
        message: Reason why the simulation blew up; empty if it did not.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        horizon: float | None = None,
        seed: int | None = None,
        visible: bool = True,
        action: str = "residual",
        engine: str = "mujoco",
        same_episode: bool = False,
    ) -> None:
        """Prepare the first episode.

        Args:
            scenario: The scenario, as `mjsheaf.load_scenario` returns it.
            horizon: Length of an episode, s, a whole number of control periods; up to `time.end` unless given.
            seed: Seed of the first episode instead of the scenario's.
            visible: False for a model without the geoms that are only to be seen.
            action: 'residual': actions are added to the commands of the agents' law; 'velocity': they take their place;
                'thrust': actions are the commands of the agents' actuators. They replace law and autopilot, so neither
                the speed limit nor `safety` acts on these agents. Zero stops all thrusters.
            engine: Engine that moves the bodies, 'mujoco' or 'fused'.
            same_episode: True to begin the same episode again with each `reset`, to the bit; see there.

        Raises:
            InputError: The scenario cannot be simulated on bodies, or an argument is not valid; or actions are 'thrust'
                and the thrust of an agent has no limits.
            NotUniqueError: The harmonic extension is not unique.
        """
        require_scenario(scenario)
        if seed is not None:
            scenario = scenario.with_seed(seed)
        require_choice("action", action, ACTIONS)
        self.action = action
        with shown(True, f"preparing {scenario.name}"):
            self.session = Session(scenario, visible=visible, commanded=_COMMANDED[action], engine=engine)
            self.session.engine.compile()
        self.same_episode = same_episode
        self.visible = visible
        self.engine = engine
        self.begun = False
        self.world = cast(ClosedLoop, self.session.engine)
        team = scenario.team
        self.agents = list(team.agent_ids)
        limits = scenario.whole.law.limit[: len(self.agents)]
        vehicles = scenario.whole.vehicles[: len(self.agents)]
        speed = np.array([vehicle.capability.forward_speed for vehicle in vehicles])
        limits = np.where(np.isfinite(limits), limits, speed)
        self.action_limits = np.where(np.isfinite(limits) & (limits > 0.0), limits, DEFAULT_ACTION_LIMIT)
        sizes = zip(self.action_limits, team.agents, strict=True)
        velocities = [np.outer([-limit, limit], np.ones(agent.dimension)) for limit, agent in sizes]
        each = _thrust_limits(scenario) if action == "thrust" else velocities
        self.bounds = dict(zip(self.agents, each, strict=True))
        self.dimensions = np.array([limits.shape[1] for limits in each])
        grid = scenario.whole.grid
        self.periods = grid.steps if horizon is None else _whole_periods(horizon, grid.period, grid.steps)
        every = named_edges(team.measuring_edges)
        self.keys = {  # both ends of an edge measure, but only the tail of a directed one
            name: [k for k, edge in every.items() if name == edge.tail or (name == edge.head and not edge.directed)]
            for name in self.agents
        }
        self.edges = {name: [every[key] for key in keys] for name, keys in self.keys.items()}
        self._errors = SquareErrors(self.world.system.team)
        self.repeat()

    @property
    def scenario(self) -> Scenario:
        """The scenario, with the seed of the present episode."""
        return self.session.scenario

    @property
    def seed(self) -> int:
        """Seed of the present episode, which `mjsheaf run --seed` takes to repeat it."""
        return self.scenario.seed

    def next_seed(self, seed: int | None = None) -> int:
        """Return the seed of the episode that `reset` begins.

        Raises:
            InputError: The argument is not a seed.
        """
        if seed is not None:
            require_seed("seed", seed)
            return int(seed)
        return next_seed(self.seed) if self.begun and not self.same_episode else self.seed

    def reset(self, seed: int | None = None) -> None:
        """Begin an episode: that of a seed or, without one, the next.

        The first episode is that of the scenario's seed. Each seed determines the next one (see
        `mjsheaf.noise.next_seed`), so one seed determines all episodes that follow.

        Raises:
            InputError: The argument is not a seed; the present episode continues.
        """
        new = self.next_seed(seed)
        self.repeat(None if new == self.seed else new)
        self.begun = True

    def repeat(self, seed: int | None = None) -> None:
        """Go back to the start of the present episode, or to that of a seed."""
        self.session.reset(seed)
        self.message = ""
        self.sample()

    def act(self, actions: Mapping[str, ArrayLike], *, normalized: bool = False) -> None:
        """Choose the actions of the agents from now on.

        Args:
            actions: Action by agent id, shape (n_i,), cut to `bounds`: a velocity relative to the medium, m/s, or the
                commands of the agent's actuators. An agent that is not named, or absent at present, gets zeros.
            normalized: True if actions are in [-1, 1]: 1 and -1 stand for the bounds, and 0 for 0.

        Raises:
            InputError: An id is unknown, or an action is not finite or of another shape.
        """
        if not isinstance(actions, Mapping):
            raise InputError(f"action is a {type(actions).__name__}; expected a mapping of agent ids to arrays")
        unit = "commands of its actuators" if self.action == "thrust" else "velocities in m/s"
        given = {name: np.zeros(n) for name, n in zip(self.agents, self.dimensions.tolist(), strict=True)}
        for name, action in actions.items():
            if name not in given:
                raise InputError(f"action: unknown agent {name!r}; {expected(str(name), self.agents)}")
            bounds = self.bounds[name]
            numbers = real_numbers(f"action of {name}", action, bounds.shape[1:], f"{bounds.shape[1]} finite {unit}")
            given[name] = np.clip(scaled(numbers, bounds) if normalized else numbers, *bounds)
        if self.action == "thrust":
            self.world.add_to_command(np.concatenate(list(given.values())))
            return
        velocity = np.zeros((len(self.agents), 3))
        for i in np.flatnonzero(self.present).tolist():
            velocity[i, : self.dimensions[i]] = given[self.agents[i]]
        self.world.add_to_command(velocity)

    def advance(self, steps: int) -> None:
        """Take physics steps, `world.steps_per_sample` in a control period, and a sample at the end of a period.

        If the simulation blows up, `message` says why. Observations and rewards stay those of the sample before.
        """
        try:
            self.world.step(steps)
        except UnstableError as error:
            self.message = str(error)
            logging.getLogger("mjsheaf").warning("episode of %s: %s", self.scenario.name, self.message)
            return
        self.sample()

    @property
    def finished(self) -> bool:
        """True from the end of an episode on."""
        return self.world.steps_taken >= self.periods * self.world.steps_per_sample

    @property
    def horizon(self) -> float:
        """Length of an episode, s."""
        return self.periods * self.scenario.whole.grid.period

    @property
    def present(self) -> BoolArray:
        """True for each agent that is part of the team now, shape (N,)."""
        return self.world.system.team.present

    @property
    def gone(self) -> BoolArray:
        """True for each agent that is lost for good, shape (N,): it is part of the team now and later in no phase."""
        now = self.world.steps_taken // self.world.steps_per_sample
        later = [phase.system.team.present for phase in self.world.phases if phase.start > now]
        return ~np.logical_or.reduce([self.present, *later])

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
        return self.session.state

    def set_state(self, state: Array) -> None:
        """Continue from a result of `state`, to the bit: also in the episode of another seed, and all that follow.

        Raises:
            InputError: It is not a state of this scenario.
        """
        self.session.state = state
        self.begun = True
        self.message = ""
        self.sample()

    @property
    def options(self) -> dict[str, Any]:
        """Arguments that make an equal episode."""
        names = ("horizon", "visible", "action", "engine", "same_episode")
        return {name: getattr(self, name) for name in names}

    def present_state(self) -> dict[str, Any]:
        """Return all that a copy of the episode has of its own; see `continue_from`."""
        # The spaces of a `FlatEpisode` draw samples from generators of their own.
        names = ("begun", "message", "_observations", "_rewards", "action_spaces", "observation_spaces")
        return {"state": self.state(), **{name: self.__dict__[name] for name in names if name in self.__dict__}}

    def continue_from(self, present: Mapping[str, Any]) -> None:
        """Continue from a result of `present_state`, also within a period, or after a blow-up."""
        self.world.restore(present["state"])
        self.__dict__ |= {name: value for name, value in present.items() if name != "state"}

    def __reduce__(self) -> tuple[Any, ...]:
        return _copy, (type(self), self.scenario, self.options, self.present_state())

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        copied = _copy(type(self), self.scenario, self.options, deepcopy(self.present_state(), memo))
        return cast(Self, copied)  # with the same scenario, which does not change

    def sample(self) -> None:
        """Let agents measure, if a control period begins now, and keep their observations and rewards."""
        world = self.world
        if self.message or world.steps_taken % world.steps_per_sample:
            return
        world.close_loop(sample=True)
        sample = self.session.observe()
        numbers = dict(zip(named_edges(sample.edges), sample.measurements, strict=True))
        received = dict(zip(named_edges(sample.edges), sample.received, strict=True))
        self._observations = {}
        for i, (name, keys) in enumerate(self.keys.items()):
            heard = np.array([received.get(key, False) for key in keys], dtype=np.bool_)
            parts = [
                numbers[key] if there else np.zeros(1 if edge.measures == "range" else len(edge.b))
                for key, there, edge in zip(keys, heard, self.edges[name], strict=True)
            ]
            present = self.present[i]
            self._observations[name] = {
                "measurements": np.concatenate([np.zeros(0), *parts]),
                "received": heard,
                "attitude": np.where(present, sample.attitude[i], 0.0),
                "velocity": np.where(present, sample.velocity[i], 0.0),
                "angular_velocity": np.where(present, sample.angular_velocity[i], 0.0),
                "present": np.array(present),
            }
        if self._errors.team is not world.system.team:
            self._errors = SquareErrors(world.system.team)
        self._rewards = np.where(self.present, -self._errors(sample.truth.positions, sample.time), 0.0)


def _copy(kind: type[Episode], scenario: Scenario, options: dict[str, Any], present: Mapping[str, Any]) -> Episode:
    """Make an episode that continues from a result of `present_state`."""
    episode = kind(scenario, **options)
    episode.continue_from(present)
    return episode


def scaled(action: Array, bounds: Array) -> Array:
    """Return actions in [-1, 1], shape (..., n), in the units of their bounds (2, n); 0 stays 0."""
    return np.where(action < 0.0, -bounds[0] * action, bounds[1] * action)


def _thrust_limits(scenario: Scenario) -> list[Array]:
    """Return the limits of each agent's actuators, shape (2, s_i), N, or rad for angles.

    Raises:
        InputError: A thrust has no limits.
    """
    limits = []
    vehicles = scenario.whole.vehicles[: len(scenario.team.agents)]
    for agent, vehicle in zip(scenario.team.agents, vehicles, strict=True):
        each = np.array([(channel.low, channel.high) for channel in vehicle.channels]).reshape(-1, 2).T
        if not np.isfinite(each).all():
            raise InputError(
                f"action is 'thrust', but the thrust of {agent.id} (vehicle {vehicle.name}) has no limits; expected "
                "'residual', 'velocity', or agents whose vehicles have limits (physics.vehicles)"
            )
        limits.append(each)
    return limits


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
