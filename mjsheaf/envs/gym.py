"""A scenario as an environment of Gymnasium."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mjsheaf.arguments import real_numbers
from mjsheaf.arrays import Array
from mjsheaf.envs.flat import LARGEST, RENDER_MODES, FlatEpisode, box
from mjsheaf.scenario import Scenario


class TeamEnv(gymnasium.Env[Array, Array]):
    """The environment that `env` returns.

    Attributes:
        episode: The core.
    """

    def __init__(self, episode: FlatEpisode) -> None:
        """Offer an episode.

        Args:
            episode: The core, at the start of an episode.
        """
        self.episode = episode
        period = episode.scenario.whole.grid.period
        self.metadata = {"render_modes": RENDER_MODES, "render_fps": max(1, round(1.0 / period))}
        self.render_mode = episode.render_mode
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
        episode.act_flat(dict(zip(episode.agents, np.split(found, self._ends), strict=True)))
        episode.step_period()
        broken = bool(episode.message)
        info = {"message": episode.message} if broken else {}
        return self.observe(), float(episode.rewards.sum()), broken, episode.finished and not broken, info

    def render(self) -> Any:
        """Return a picture, shape (480, 640, 3); None without a render mode."""
        return self.episode.picture() if self.render_mode else None

    def close(self) -> None:
        """End the run."""
        self.episode.session.close()


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
    from mjsheaf.scenario import load_scenario

    return env(load_scenario(name), **options)
