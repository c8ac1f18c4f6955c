"""A scenario as an environment of Gymnasium, and episodes whose actions and observations are arrays.

An action is an array in [-1, 1]: 1 is the largest of the agent's actions, and -1 the smallest; see `Episode.bounds`.
Zero is zero. What cannot be negative, such as the thrust of a rotor, is in [0, 1], and cut to its smallest. An
observation is an array of the parts that `Episode.observe` names, one after another.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mjsheaf.arguments import real_numbers
from mjsheaf.arrays import Array
from mjsheaf.envs.episode import Episode
from mjsheaf.errors import InputError, expected
from mjsheaf.scenario import Scenario

PARTS = ("measurements", "received", "attitude", "velocity", "angular_velocity", "present")
"""Parts of an observation, in order."""
LARGEST = 1e9
"""Bound of every number of an observation: a larger position is a blow-up."""
RENDER_MODES = ["rgb_array"]
_PICTURE = (480, 640)  # px
_ROOM = 1.6  # of the team's size, at which the camera stands


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
            InputError: As for `Episode`; or a part or the render mode is unknown.
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
            self._camera = MovableCamera(BodyPhysics(self), *_PICTURE)
        places = self.world.positions()
        low, high = places.min(axis=0), places.max(axis=0)
        self._camera.set_pose(0.5 * (low + high), _ROOM * float(np.linalg.norm(high - low)) + 3.0, 120.0, -35.0)
        return self._camera.render().copy()


def box(size: int, bound: float) -> Any:
    """Return the space of arrays (size,) within a bound."""
    return spaces.Box(-bound, bound, (size,), np.float64)


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
        episode.act(dict(zip(episode.agents, np.split(found, self._ends), strict=True)), normalized=True)
        episode.advance(episode.world.steps_per_sample)
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
