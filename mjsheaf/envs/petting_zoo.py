"""A scenario as a parallel environment of PettingZoo."""

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv  # type: ignore[import-untyped]

from mjsheaf.arrays import Array
from mjsheaf.envs.gym import EpisodeEnv, FlatEpisode
from mjsheaf.scenario import Scenario


class TeamParallelEnv(EpisodeEnv, ParallelEnv):  # type: ignore[misc] # PettingZoo's type variables are its own
    """The environment that `parallel_env` returns; see `EpisodeEnv`.

    Attributes:
        possible_agents: Ids of all agents, those included that join later.
        agents: Ids of the agents whose episode has not ended.
    """

    def __init__(self, episode: FlatEpisode) -> None:
        super().__init__(episode, name=f"mjsheaf_{episode.scenario.name}_v0", is_parallelizable=True)
        self.possible_agents = list(episode.agents)
        self.agents: list[str] = []
        self.state_space = spaces.Box(-np.inf, np.inf, episode.state().shape, np.float64)

    def observation_space(self, agent: str) -> spaces.Box:
        """Return the space of an agent's observation."""
        return self.episode.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box:
        """Return the space of an agent's action."""
        return self.episode.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Begin an episode, that of a seed or the next, see `Episode.reset`; `options` are accepted and not used."""
        self.episode.reset(seed)
        self.agents = list(self.possible_agents)
        return self.episode.flat(), {name: {"seed": self.episode.seed} for name in self.agents}

    def step(
        self, actions: dict[str, Array]
    ) -> tuple[dict[str, Array], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Take one control period; see `parallel_env`. Actions of agents whose episode has ended are ignored."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        episode = self.episode
        live = self.agents
        ended = set(self.possible_agents) - set(live)
        given = isinstance(actions, Mapping)
        live_actions = {k: a for k, a in actions.items() if k not in ended} if given else actions
        episode.act(live_actions, normalized=True)
        episode.advance(episode.world.steps_per_sample)
        rows = [episode.agents.index(name) for name in live]
        terminated = episode.gone[rows] | bool(episode.message)
        truncated = ~terminated & episode.finished
        self.agents = list(itertools.compress(live, ~(terminated | truncated)))
        observations = episode.flat()
        reason = {"message": episode.message} if episode.message else {}
        return (
            {name: observations[name] for name in live},
            dict(zip(live, episode.rewards[rows].tolist(), strict=True)),
            dict(zip(live, terminated.tolist(), strict=True)),
            dict(zip(live, truncated.tolist(), strict=True)),
            {name: dict(reason) for name in live},
        )

    def state(self) -> Array:
        """Return all that determines the rest of the episode."""
        return self.episode.state()


def parallel_env(scenario: Scenario, **options: Any) -> TeamParallelEnv:
    """Return a scenario on bodies as a `pettingzoo.ParallelEnv`; a step is one control period.

    Zero actions give the run of `mjsheaf run`, to the bit. An action is an array (n_i,) in [-1, 1], times the agent's
    action limit a velocity that is added to the law's command; `episode.action_limits` has the limits in m/s. With
    `action="velocity"` it is the whole command. With `action="thrust"` it is the commands of the agent's actuators, 1
    their upper and -1 their lower limit; `episode.bounds` has the limits. Zeros of these two are commands: to stand
    still in the medium, or no thrust, with which aircraft fall. An observation is an array of what the agent itself
    measures. The reward is -|q* - q|^2 of the agent, m^2.

    An agent that is lost for good terminates. One that rejoins, or joins later, takes part from the start: while it is
    absent its observation is zero, and its action is ignored. All are truncated at `time.end`, or at the horizon, and
    terminate if the simulation blows up. `reset(seed)` begins the episode of that seed, and `reset()` the next one.
    `info["seed"]` is the seed of each, for `mjsheaf run --seed`.

    Args:
        scenario: The scenario, as `mjsheaf.load_scenario` returns it.
        **options: `horizon`, `seed`, `action`, `engine` and `same_episode` of `Episode`; `parts` of an observation (see
            `mjsheaf.envs.gym.PARTS`); `render_mode` None or 'rgb_array'.

    Raises:
        InputError: The scenario cannot be simulated on bodies, or an option is not valid.
        NotUniqueError: The harmonic extension is not unique.
    """
    return TeamParallelEnv(FlatEpisode(scenario, **options))
