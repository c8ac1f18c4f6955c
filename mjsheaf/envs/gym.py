"""A scenario as an environment of Gymnasium, many runs of it as a vector environment, and episodes with arrays.

An action is an array in [-1, 1]: 1 is the largest of the agent's actions, and -1 the smallest; see `Episode.bounds`.
Zero is zero. What cannot be negative, such as the thrust of a rotor, is in [0, 1], and cut to its smallest. An
observation is an array of the parts that `Episode.observe` names, one after another.

In a vector environment, runs of one team are stepped together: see `mjsheaf.loop.fused`. Runs with events, with range,
bearing or directed edges, or whose seeds draw headings, which worlds share, are stepped one after the other, which is
slower.
"""

from collections.abc import Sequence
from contextlib import suppress
from copy import deepcopy
from functools import cached_property
from typing import Any, Self, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from mjsheaf.arguments import real_numbers, require_scenario, require_seed, require_whole
from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.envs.episode import Episode, named_edges, scaled
from mjsheaf.errors import InputError, expected
from mjsheaf.law.in_python import View
from mjsheaf.loop.fused import Fused, Worlds
from mjsheaf.loop.loop import Loop
from mjsheaf.progress import shown
from mjsheaf.scenario import Scenario, load_scenario

PARTS = ("measurements", "received", "attitude", "velocity", "angular_velocity", "present")
"""Parts of an observation, in order."""
LARGEST = 1e9
"""Bound of every number of an observation: a larger position is a blow-up."""
RENDER_MODES = ["rgb_array"]


class FlatEpisode(Episode):
    """An episode with actions and observations as arrays.

    Attributes:
        parts: Parts of an observation.
        render_mode: 'rgb_array', or None.
    """

    def __init__(
        self,
        scenario: Any,
        *,
        parts: Sequence[str] = PARTS,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Prepare the first episode; `options` are those of `Episode`.

        Raises:
            InputError: An option is invalid, see `Episode`; or a part or the render mode is unknown.
        """
        for part in parts:
            if part not in PARTS:
                raise InputError(f"parts: unknown part {part!r}; {expected(str(part), PARTS)}")
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise InputError(f"render_mode is {render_mode!r}; expected None or 'rgb_array'")
        self.parts = tuple(parts)
        self.render_mode = render_mode
        super().__init__(scenario, visible=render_mode is not None, **options)

    @property
    def options(self) -> dict[str, Any]:
        """Arguments that make an equal episode."""
        options = super().options | {"parts": self.parts, "render_mode": self.render_mode}
        del options["visible"]  # follows from the render mode
        return options

    @cached_property
    def action_spaces(self) -> dict[str, spaces.Box]:
        """Space of each agent's action, by id."""
        lows = {name: -(limits[0] < 0.0).astype(np.float64) for name, limits in self.bounds.items()}
        return {name: spaces.Box(low, 1.0, dtype=np.float64) for name, low in lows.items()}

    @cached_property
    def observation_spaces(self) -> dict[str, spaces.Box]:
        """Space of each agent's observation, by id."""
        return {name: box(len(own), LARGEST) for name, own in self.flat().items()}

    def flat(self) -> dict[str, Array]:
        """Return the observation of each agent at the last sample, by id."""
        return {
            name: np.concatenate([np.zeros(0), *(np.ravel(own[part]).astype(np.float64) for part in self.parts)])
            for name, own in self.observe().items()
        }

    def picture(self) -> Any:
        """Draw the vehicles as they are, shape (480, 640, 3), 8 bits a colour; headless where there is no display."""
        from mjsheaf.envs.control_suite import BodyPhysics, MovableCamera

        if not hasattr(self, "_camera"):
            self._camera = MovableCamera(BodyPhysics(self), 480, 640)  # px
        places = self.world.positions()
        low, high = places.min(axis=0), places.max(axis=0)
        # The camera is 1.6 times the size of the team, and 3 m, away.
        self._camera.set_pose(0.5 * (low + high), 1.6 * float(np.linalg.norm(high - low)) + 3.0, 120.0, -35.0)
        return self._camera.render().copy()


def box(size: int, bound: float) -> Any:
    """Return the space of arrays (size,) within a bound."""
    return spaces.Box(-bound, bound, (size,), np.float64)


class EpisodeEnv:
    """The part of an environment that Gymnasium and PettingZoo share.

    Attributes:
        episode: The core.
    """

    def __init__(self, episode: FlatEpisode, **metadata: Any) -> None:
        """Offer an episode, which is at its start."""
        self.episode = episode
        rate = max(1, round(1.0 / episode.scenario.whole.grid.period))
        self.metadata = {"render_modes": RENDER_MODES, "render_fps": rate, **metadata}
        self.render_mode = episode.render_mode

    def render(self) -> Any:
        """Return a picture, shape (480, 640, 3); None without a render mode."""
        return self.episode.picture() if self.render_mode else None

    def close(self) -> None:
        """End the run."""
        self.episode.session.close()


class TeamEnv(EpisodeEnv, gymnasium.Env[Array, Array]):
    """The environment that `env` returns; see `EpisodeEnv`."""

    def __init__(self, episode: FlatEpisode) -> None:
        """Offer an episode, which is at its start."""
        super().__init__(episode)
        each = episode.action_spaces.values()
        low, high = (np.concatenate([getattr(space, end) for space in each]) for end in ("low", "high"))
        self.action_space = spaces.Box(low, high, dtype=np.float64)
        self._shape = low.shape
        self.observation_space = box(len(self.observe()), LARGEST)
        self._ends = np.cumsum(episode.dimensions)[:-1]

    def observe(self) -> Array:
        """Return the observations of all agents at the last sample, one after another."""
        return np.concatenate(list(self.episode.flat().values()))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode, that of a seed or the next, see `Episode.reset`; `options` are accepted and not used."""
        self.episode.reset(seed)
        super().reset(seed=None if seed is None else int(seed))
        return self.observe(), {"seed": self.episode.seed}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Take one control period; see `env`."""
        episode = self.episode
        found = real_numbers("action", action, self._shape, f"{self._shape} finite numbers")
        episode.act(dict(zip(episode.agents, np.split(found, self._ends), strict=True)), normalized=True)
        episode.advance(episode.world.steps_per_sample)
        broken = bool(episode.message)
        info = {"message": episode.message} if broken else {}
        return self.observe(), float(episode.rewards.sum()), broken, episode.finished and not broken, info


def env(scenario: Scenario, **options: Any) -> TeamEnv:
    """Return the whole team of a scenario on bodies as a `gymnasium.Env`; a step is one control period.

    Actions and observations are those of all agents one after another, in the order of the file; see
    `mjsheaf.envs.parallel_env`, also for the options. The reward is the sum of the agents'. Zero actions give the run
    of `mjsheaf run`, to the bit. An episode is truncated at `time.end`, or at the horizon, and terminates if the
    simulation blows up. Shipped scenarios are registered as `mjsheaf/NAME-v0`.

    Raises:
        InputError: The scenario cannot be simulated on bodies, or an option is not valid.
        NotUniqueError: The harmonic extension is not unique.
    """
    return TeamEnv(FlatEpisode(scenario, **options))


def make_named(name: str, **options: Any) -> TeamEnv:
    """Return `env` of a shipped scenario by name."""
    return env(load_scenario(name), **options)


_OF_RUNS = ("envs", "_worlds", "_gathering")  # what a copy of an environment makes anew


class Gathering:
    """Places of the observations of a whole team in the rows of its worlds.

    Attributes:
        source: Column of each number of an observation, shape (n,).
        heard: Column of the flag that a link sets on reception, for each number of an edge with a link, shape (m,).
        linked: True for numbers of an edge with a link, shape (n,).
        fixed: Values of numbers that do not change, NaN for others, shape (n,).
    """

    def __init__(self, episode: FlatEpisode, columns: Loop) -> None:
        """Find the places of an episode's observations.

        Args:
            episode: One of the runs.
            columns: Columns of the worlds; see `Worlds`.
        """
        found: list[tuple[float, float, float]] = []  # source, flag of reception or -1, fixed value
        state = columns.state
        view = View(episode.world.system.team, columns.params.control.law)
        names = list(named_edges(view.edges))
        places = dict(zip(names, view.places, strict=True))
        linked = [name for name, is_linked in zip(names, view.linked, strict=True) if is_linked]
        flags = dict.fromkeys(names, -1.0) | dict(zip(linked, state.memory.links.heard[view.links], strict=True))
        for i, name in enumerate(episode.agents):
            velocity = state.qvel[6 * i : 6 * i + 6]
            fields = {
                "measurements": [
                    (y, flags[key], np.nan) for key in episode.keys[name] for y in state.memory.y[places[key]]
                ],
                "received": [(0, flags[key], 1.0) for key in episode.keys[name]],
                "attitude": [(column, -1, np.nan) for column in state.qpos[7 * i + 3 : 7 * i + 7]],
                "velocity": [(column, -1, np.nan) for column in velocity[:3]],
                "angular_velocity": [(column, -1, np.nan) for column in velocity[3:]],
                "present": [(0, -1, 1.0)],
            }
            found += [number for part in episode.parts for number in fields[part]]
        source, heard, fixed = np.array(found).reshape(-1, 3).T
        self.source: IntArray = source.astype(np.int64)
        self.linked: BoolArray = heard >= 0.0
        self.heard: IntArray = heard[self.linked].astype(np.int64)
        self.fixed: Array = fixed

    def observations(self, values: Array) -> Array:
        """Return the observations in worlds with these numbers, shape (K, n), at their last sample, shape (K, m)."""
        found = np.where(np.isnan(self.fixed), values[:, self.source], self.fixed)
        found[:, self.linked] *= values[:, self.heard] > 0.0
        return cast(Array, found)


class TeamVectorEnv(VectorEnv[Array, Array, NDArray[Any]]):
    """The environment that `vector_env` returns.

    Attributes:
        envs: The runs, on the fused engine. Where they are stepped together, `episode.world` has the present state.
    """

    def __init__(self, envs: Sequence[TeamEnv], autoreset_mode: AutoresetMode) -> None:
        """Lay the runs out side by side if possible.

        Args:
            envs: Runs of one scenario with different seeds, on the fused engine.
            autoreset_mode: See `vector_env`.
        """
        self.envs = list(envs)
        self.num_envs = len(self.envs)
        first = self.envs[0]
        self.metadata = {**first.metadata, "autoreset_mode": autoreset_mode}
        self.render_mode = None
        self.single_action_space, self.single_observation_space = first.action_space, first.observation_space
        self.action_space = batch_space(first.action_space, self.num_envs)
        self.observation_space = batch_space(first.observation_space, self.num_envs)
        self._mode = autoreset_mode
        self._shape = (self.num_envs, int(first.episode.dimensions.sum()))
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        self._observations = np.stack([one.observe() for one in self.envs])
        episode = first.episode
        self._bounds = np.hstack(list(episode.bounds.values()))
        agent = np.repeat(np.arange(len(episode.agents)), episode.dimensions)
        axis = np.concatenate([np.arange(n) for n in episode.dimensions.tolist()])
        self._worlds: Worlds | None = None
        with suppress(InputError):  # they are stepped one after the other
            self._worlds = Worlds([cast(Fused, one.episode.world) for one in self.envs])
            columns = self._worlds.columns
            self._gathering = Gathering(episode, columns)
            thrusts = columns.state.ctrl[: self._shape[1]]
            commands = thrusts if episode.action == "thrust" else columns.state.memory.supplied[agent, axis]
            self._commands = commands.astype(np.int64)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode of each run.

        Args:
            seed: One for each run, or the first run's, followed by the next numbers. None, also for one of several
                runs, begins the run's next episode; see `Episode.reset`.
            options: `reset_mask` True for the runs to reset, shape (n,); all unless given.

        Returns:
            The observations, and the seeds of the episodes that begin.
        """
        n = self.num_envs
        mask = np.ones(n, dtype=np.bool_)
        if options and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.dtype != np.bool_ or mask.shape != (n,):
                raise InputError(f"reset_mask is {mask.dtype} of shape {mask.shape}; expected ({n},) bools")
        seeds: Sequence[int | None] = [None] * n
        if isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str):
            seeds = list(seed)
            if len(seeds) != n:
                raise InputError(f"seed has {len(seeds)} entries; expected {n}")
        elif seed is not None:
            require_seed("seed", seed)
            seeds = [int(seed) + k for k in range(n)]
        which = np.flatnonzero(mask).tolist()
        info = self._begin({k: self._episode(k).next_seed(seeds[k]) for k in which})
        return self._observations.copy(), info

    def _episode(self, k: int) -> FlatEpisode:
        """Return the episode of run k."""
        return self.envs[k].episode

    def _begin(self, seeds: dict[int, int]) -> dict[str, Any]:
        """Begin episodes with these seeds, by the numbers of their runs, and return the info that names them."""
        began = np.isin(np.arange(self.num_envs), list(seeds))
        if self._worlds is not None:
            try:
                self._worlds.begin(seeds)
            except InputError:  # a seed changes what worlds share
                self._worlds = None
            else:
                self._observations[began] = self._gathering.observations(self._worlds.values[began])
        for k, seed in seeds.items():
            if self._worlds is None:
                self._episode(k).reset(seed)
                self._observations[k] = self.envs[k].observe()
            self._episode(k).begun = True
            self._episode(k).message = ""
        self._ended[began] = False
        named = np.zeros(self.num_envs, dtype=np.int64)
        named[list(seeds)] = list(seeds.values())
        return {"seed": named, "_seed": began} if seeds else {}

    def step(self, actions: Array) -> tuple[Array, Array, BoolArray, BoolArray, dict[str, Any]]:
        """Take one control period of every run; one that has ended begins its next episode instead, or stands still."""
        alive = ~self._ended
        given = real_numbers("actions", actions, self._shape, f"{self._shape} finite numbers", alive)
        take = self._take_one_by_one if self._worlds is None else self._take_together
        rewards, terminated = take(given, alive)
        truncated = alive & self._finished & ~terminated
        info: dict[str, Any] = {}
        if self._mode is AutoresetMode.NEXT_STEP:
            info = self._begin({k: self._episode(k).next_seed() for k in np.flatnonzero(self._ended).tolist()})
        self._ended |= terminated | truncated
        return self._observations.copy(), rewards, terminated, truncated, info

    def state(self) -> list[Array]:
        """Return all that determines the rest of each run, see `Episode.state`, one array for each."""
        return [one.episode.state() for one in self.envs]

    def set_state(self, states: Sequence[Array]) -> None:
        """Continue each run from its part of a result of `state`, to the bit, also in the episodes of other seeds.

        Raises:
            InputError: There is another number of them, or one is not a state of this scenario.
        """
        if len(states) != self.num_envs:
            raise InputError(f"states has {len(states)} entries; expected {self.num_envs}")
        self._begin({k: self._episode(k).world.seed_of(state) for k, state in enumerate(states)})
        for k, state in enumerate(states):
            self._episode(k).set_state(state)
            self._observations[k] = self.envs[k].observe()
        self._ended = self._finished

    def __reduce__(self) -> tuple[Any, ...]:
        episodes = [one.episode for one in self.envs]
        first = episodes[0]
        kept = {name: value for name, value in self.__dict__.items() if name not in _OF_RUNS}
        presents = [episode.present_state() for episode in episodes]
        return _copy, (first.scenario, first.options, [episode.seed for episode in episodes], presents, kept)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        make, (scenario, *rest) = self.__reduce__()
        return cast(Self, make(scenario, *deepcopy(rest, memo)))  # with the same scenario, which does not change

    @property
    def _finished(self) -> BoolArray:
        """True for each run at the end of its episode, shape (n,)."""
        if self._worlds is None:
            return np.array([one.episode.finished for one in self.envs])
        episode = self.envs[0].episode
        return self._worlds.steps >= episode.periods * episode.world.steps_per_sample

    def _take_one_by_one(self, actions: Array, alive: BoolArray) -> tuple[Array, BoolArray]:
        """Take a control period of each run that is alive; return rewards, shape (n,), and whether each diverged."""
        rewards, broken = np.zeros(self.num_envs), np.zeros(self.num_envs, dtype=np.bool_)
        for k in np.flatnonzero(alive).tolist():
            self._observations[k], rewards[k], broken[k], _, _ = self.envs[k].step(actions[k])
        return rewards, broken

    def _take_together(self, actions: Array, alive: BoolArray) -> tuple[Array, BoolArray]:
        """Return the same as `_take_one_by_one`."""
        worlds = self._worlds
        assert worlds is not None, "the runs are stepped one by one"
        worlds.values[:, self._commands] = np.clip(scaled(actions, self._bounds), *self._bounds)
        broken = np.zeros(self.num_envs, dtype=np.bool_)
        for k, message in worlds.step(alive).items():
            self.envs[k].episode.message = message
            broken[k] = True
        good = alive & ~broken
        self._observations[good] = self._gathering.observations(worlds.values[good])
        return np.where(alive, -worlds.squares.sum(axis=1), 0.0), broken

    def close_extras(self, **kwargs: Any) -> None:
        """End the runs."""
        for one in self.envs:
            one.close()


def _make(scenario: Scenario, seeds: Sequence[int], mode: AutoresetMode, options: dict[str, Any]) -> TeamVectorEnv:
    """Make runs of a scenario under these seeds."""
    runs = [scenario.with_seed(seed) for seed in seeds]
    with shown(True, f"preparing {len(seeds)} runs of {scenario.name}"):
        return TeamVectorEnv([TeamEnv(FlatEpisode(run, **options)) for run in runs], mode)


def _copy(
    scenario: Scenario,
    options: dict[str, Any],
    seeds: Sequence[int],
    presents: Sequence[dict[str, Any]],
    kept: dict[str, Any],
) -> TeamVectorEnv:
    """Make a copy of an environment from what it has of its own; see `TeamVectorEnv.__reduce__`."""
    made = _make(scenario, seeds, kept["_mode"], options)
    for one, present in zip(made.envs, presents, strict=True):
        one.episode.continue_from(present)
    made.__dict__ |= kept
    return made


def vector_env(
    scenario: Scenario, n: int, *, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, **options: Any
) -> TeamVectorEnv:
    """Return n runs of a scenario on the fused engine as a `gymnasium.vector.VectorEnv`, with the spaces of `env`.

    Run k begins with the scenario's seed plus k, and continues by itself: the seed of an episode determines that of the
    run's next one, whenever others end; see `Episode.reset`. `info["seed"]` names the episodes that begin. Samples
    under zero actions are those of `simulate_many(..., engine="fused")` with that seed, to the bit. The runs are
    stepped together by compiled code, unless the scenario has events, edges that are not linear, or headings that the
    seed draws.

    Args:
        scenario: The scenario, as `mjsheaf.load_scenario` returns it.
        n: Number of runs.
        autoreset_mode: What becomes of a run that has ended: NEXT_STEP, or DISABLED and `reset` with a `reset_mask`.
        **options: Options of `env` except for `engine`, `seed` and `render_mode`, among them `same_episode`.

    Raises:
        InputError: An option is invalid, see `env`; the fused engine does not support the scenario, for example its
            contacts; or n or the mode is invalid.
    """
    require_whole("n", n, 1)
    mode = AutoresetMode(autoreset_mode)
    if mode is AutoresetMode.SAME_STEP:
        raise InputError("autoreset_mode is SAME_STEP; expected NEXT_STEP or DISABLED")
    require_scenario(scenario)
    return _make(scenario, [scenario.seed + k for k in range(n)], mode, {"engine": "fused", **options})
