"""A scenario as an environment of Gymnasium, and many runs of it as a vector environment."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from mjsheaf.arguments import require_whole
from mjsheaf.arrays import Array, BoolArray
from mjsheaf.envs.flat import LARGEST, RENDER_MODES, FlatEpisode, box
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario


class TeamEnv(gymnasium.Env[Array, Array]):
    """The environment that `env` returns.

    Attributes:
        episode: The core.
    """

    def __init__(self, episode: FlatEpisode) -> None:
        self.episode = episode
        period = episode.scenario.whole.grid.period
        self.metadata = {"render_modes": RENDER_MODES, "render_fps": max(1, round(1.0 / period))}
        self.render_mode = episode.render_mode
        self.action_space = box(int(episode.dimensions.sum()), 1.0)
        self.observation_space = box(len(self._observe()), LARGEST)
        self._ends = np.cumsum(episode.dimensions)[:-1]

    def _observe(self) -> Array:
        return np.concatenate(list(self.episode.flat().values()))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode: that of a seed, or the same again; `options` are accepted and not used."""
        super().reset(seed=seed)
        self.episode.reset(seed)
        return self._observe(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Take one control period; see `env`."""
        episode = self.episode
        found = np.asarray(action, dtype=np.float64)
        if found.shape != self.action_space.shape:
            raise InputError(f"action has shape {found.shape}; expected {self.action_space.shape}")
        episode.act_flat(dict(zip(episode.agents, np.split(found, self._ends), strict=True)))
        episode.step_period()
        broken = bool(episode.message)
        info = {"message": episode.message} if broken else {}
        return self._observe(), float(episode.rewards.sum()), broken, episode.finished and not broken, info

    def render(self) -> Any:
        """Return a picture, shape (480, 640, 3); None without a render mode."""
        return self.episode.picture() if self.render_mode else None

    def close(self) -> None:
        """End the run."""
        self.episode.session.close()


class TeamVectorEnv(VectorEnv[Array, Array, NDArray[Any]]):
    """The environment that `vector_env` returns.

    Attributes:
        envs: The runs, on the fused engine.
    """

    def __init__(self, envs: Sequence[TeamEnv], autoreset_mode: AutoresetMode) -> None:
        self.envs = list(envs)
        self.num_envs = len(self.envs)
        first = self.envs[0]
        self.metadata = {**first.metadata, "autoreset_mode": autoreset_mode}
        self.render_mode = None
        self.single_action_space, self.single_observation_space = first.action_space, first.observation_space
        self.action_space = batch_space(first.action_space, self.num_envs)
        self.observation_space = batch_space(first.observation_space, self.num_envs)
        self._mode = autoreset_mode
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        self._observations = np.stack([one._observe() for one in self.envs])

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode of each run.

        Args:
            seed: One for each run, or that of the first, from which the others count on; None for the same again.
            options: `reset_mask` True for the runs to reset, shape (n,); all unless given.
        """
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"], dtype=np.bool_)
            if mask.shape != (self.num_envs,):
                raise InputError(f"reset_mask has shape {mask.shape}; expected ({self.num_envs},)")
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else seed or [None] * self.num_envs
        if len(seeds) != self.num_envs:
            raise InputError(f"seed has {len(seeds)} entries; expected {self.num_envs}")
        for k in np.flatnonzero(mask).tolist():
            self._observations[k], _ = self.envs[k].reset(seed=seeds[k])
        self._ended[mask] = False
        return self._observations.copy(), {}

    def step(self, actions: Array) -> tuple[Array, Array, BoolArray, BoolArray, dict[str, Any]]:
        """Take one control period of every run; one that has ended begins again instead, or stands still."""
        n = self.num_envs
        rewards, terminated, truncated = np.zeros(n), np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
        for k, (one, action) in enumerate(zip(self.envs, np.asarray(actions), strict=True)):
            if not self._ended[k]:
                self._observations[k], rewards[k], terminated[k], truncated[k], _ = one.step(action)
            elif self._mode is AutoresetMode.NEXT_STEP:
                self._observations[k], _ = one.reset()
        self._ended = terminated | truncated | (self._ended & (self._mode is AutoresetMode.DISABLED))
        return self._observations.copy(), rewards, terminated, truncated, {}

    def close_extras(self, **kwargs: Any) -> None:
        """End the runs."""
        for one in self.envs:
            one.close()


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


def vector_env(
    scenario: Scenario, n: int, *, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, **options: Any
) -> TeamVectorEnv:
    """Return n runs of a scenario on the fused engine as a `gymnasium.vector.VectorEnv`, with the spaces of `env`.

    Run k begins with the scenario's seed plus k. Its samples under zero actions are those of
    `simulate_many(..., engine="fused")` with that seed, to the bit.

    Args:
        scenario: The scenario, as `mjsheaf.load_scenario` returns it.
        n: Number of runs.
        autoreset_mode: What becomes of a run that has ended: NEXT_STEP, or DISABLED and `reset` with a `reset_mask`.
        **options: As of `env`, but for `engine`, `seed` and `render_mode`.

    Raises:
        InputError: As for `env`; or n or the mode is not valid.
    """
    require_whole("n", n, 1)
    mode = AutoresetMode(autoreset_mode)
    if mode is AutoresetMode.SAME_STEP:
        raise InputError("autoreset_mode is SAME_STEP; expected NEXT_STEP or DISABLED")
    runs = [scenario.with_seed(scenario.seed + k) for k in range(n)]
    return TeamVectorEnv([TeamEnv(FlatEpisode(run, engine="fused", **options)) for run in runs], mode)


def make_named(name: str, **options: Any) -> TeamEnv:
    """Return `env` of a shipped scenario by name."""
    from mjsheaf.scenario import load_scenario

    return env(load_scenario(name), **options)
