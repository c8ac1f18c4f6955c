"""The sheaf law as a policy: the baseline of learners, from the same local observations."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arguments import require_type
from mjsheaf.arrays import Array
from mjsheaf.envs.gym import FlatEpisode
from mjsheaf.errors import InputError
from mjsheaf.team import Edge


class SheafLaw:
    """Policy that follows the paper's law, for `env`, `vector_env` and `parallel_env`: -k1 eta within the limits.

    An agent computes eta_i from its own observation: eta is linear in what the edges of the agent deliver, with one
    block of a matrix for each agent. Edges that deliver nothing are left out.

    Where actions are velocities (`action="velocity"`), the policy is the law itself, without terms beyond the paper's,
    such as an integral. Where actions are added to the law of the scenario, the policy of zeros leaves the law as it
    is, and other policies may begin with `disagreement`.

    Actions end at the action limits: where the law has no velocity limit it may ask for more, and is cut.

    Attributes:
        agents: Ids of all agents.
        gain: Gain k1 of each number of the team's action, shape (n_a,), 1/s.
        limits: Velocity that an action of 1 stands for, shape (n_a,), m/s.
    """

    def __init__(self, episode: Any) -> None:
        """Collect the matrices of all agents.

        Args:
            episode: An environment of `env`, `parallel_env` or `vector_env`, or its episode.

        Raises:
            InputError: Actions are not velocities; the observations lack `measurements` or `received`; or an edge
                compares distances or directions, from which alone no agent can compute eta.
        """
        episode = getattr(episode, "envs", [episode])[0]
        episode = getattr(episode, "episode", episode)
        require_type("episode", episode, FlatEpisode, "an environment of env, parallel_env or vector_env")
        if episode.action == "thrust":
            raise InputError("action is 'thrust'; expected 'velocity' or 'residual', as the sheaf law is a velocity")
        for part in ("measurements", "received"):
            if part not in episode.parts:
                raise InputError(f"parts: {', '.join(episode.parts)}; expected {part} among them, for the sheaf law")
        self.agents = list(episode.agents)
        self.limits = np.repeat(episode.action_limits, episode.dimensions)
        law = episode.scenario.whole.law
        self.gain = np.repeat(law.gain[: len(self.agents)], episode.dimensions)
        self._speed = law.limit[: len(self.agents)].copy()
        self._starts = np.concatenate([[0], np.cumsum(episode.dimensions)])
        self._blocks = [_block(episode, name) for name in self.agents]
        self._ends = np.cumsum([block.shape[1] for block in self._blocks])

    def disagreement(self, observation: ArrayLike) -> Array:
        """Return eta of all agents from the observation of the team.

        Args:
            observation: Observation of one team or of n teams, shape (n_o,) or (n, n_o).

        Returns:
            One agent after the other, shape (n_a,) or (n, n_a), m.
        """
        parts = np.split(self._team_of(observation), self._ends[:-1], axis=-1)
        return np.concatenate([own @ M.T for own, M in zip(parts, self._blocks, strict=True)], axis=-1)

    def __call__(self, observation: ArrayLike) -> Array:
        """Return the action of the team, of the shape of `disagreement`: -k1 eta as a part of the action limits."""
        velocity = -self.gain * self.disagreement(observation)
        for i, limit in enumerate(self._speed):
            own = velocity[..., self._starts[i] : self._starts[i + 1]]
            speed = np.linalg.norm(own, axis=-1, keepdims=True)
            own *= np.minimum(1.0, limit / np.maximum(speed, np.finfo(np.float64).tiny))
        return np.clip(velocity / self.limits, -1.0, 1.0)

    def of(self, agent: str) -> Callable[[ArrayLike], Array]:
        """Return the policy of one agent, from its own observation to its own action, for `parallel_env`.

        Raises:
            InputError: There is no such agent.
        """
        if agent not in self.agents:
            raise InputError(f"unknown agent {agent!r}; expected one of {', '.join(self.agents)}")
        i = self.agents.index(agent)
        numbers = slice(self._ends[i] - self._blocks[i].shape[1], self._ends[i])

        def act(observation: ArrayLike) -> Array:
            team = np.zeros(self._ends[-1])  # of the others nothing is known, and nothing is needed
            team[numbers] = observation
            action: Array = self(team)[self._starts[i] : self._starts[i + 1]]
            return action

        return act

    def _team_of(self, observation: ArrayLike) -> Array:
        """Return the observation as numbers.

        Raises:
            InputError: It is of another size.
        """
        found = np.asarray(observation, dtype=np.float64)
        if found.shape[-1:] != (self._ends[-1],):
            raise InputError(f"observation has shape {found.shape}; expected {self._ends[-1]} numbers for each team")
        return found


def _block(episode: FlatEpisode, name: str) -> Array:
    """Return the matrix M_i of an agent, eta_i = M_i o_i, shape (n_i, size of its observation)."""
    n = episode.dimensions[episode.agents.index(name)]
    own = episode.observe()[name]
    blocks = {part: np.zeros((n, own[part].size)) for part in episode.parts}
    first = 0
    for number, edge in enumerate(episode.edges[name]):
        pull = _pull(edge, name)
        blocks["measurements"][:, first : first + len(edge.b)] = pull
        blocks["received"][:, number] = pull @ edge.b
        first += len(edge.b)
    return np.hstack([blocks[part] for part in episode.parts])


def _pull(edge: Edge, agent: str) -> Array:
    """Return the matrix that maps y + b of an edge to its part of an agent's eta, shape (n_i, m).

    Raises:
        InputError: The edge compares distances or directions.
    """
    if edge.measures != "position":
        raise InputError(f"edge {edge} measures a {edge.measures}; expected positions, for the sheaf law as a policy")
    if agent == edge.tail:
        return -edge.F_tail.T @ edge.weight
    return edge.F_head.T @ edge.weight
