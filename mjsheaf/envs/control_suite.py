"""A scenario as an environment of dm_control: its viewer, wrappers and learners work on it.

dm_control chooses how to draw when it is imported, by MUJOCO_GL. Without a display it takes a windowing library that
cannot draw there. Here EGL is tried first on such a machine, and what cannot be loaded is left out. The environment
variables stay as they were.
"""

import os
import sys
import warnings
from collections.abc import Mapping
from copy import deepcopy
from importlib import import_module
from typing import Any, cast
from unittest.mock import patch

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.envs.episode import Episode
from mjsheaf.loop.mujoco_engine import World
from mjsheaf.mujoco_import import mujoco
from mjsheaf.scenario import Scenario


def _load(module: str) -> Any:
    """Import a module of dm_control.

    Raises:
        ImportError: dm_control is not installed, or does not load.
    """
    named = os.environ.get("MUJOCO_GL")
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or not sys.platform.startswith("linux")
    failure: Exception | None = None
    for backend in ({} if named or display else {"MUJOCO_GL": "egl"}, {"MUJOCO_GL": "off"}):
        try:
            with patch.dict(os.environ, backend), warnings.catch_warnings():  # it names more variables itself
                warnings.simplefilter("ignore")  # of a windowing library without a display
                import_module("dm_control._render")
                return import_module(module)
        except (ImportError, RuntimeError, AttributeError) as error:
            failure = error
    raise ImportError(
        f"dm_control cannot be loaded ({failure}); expected Python 3.11 or 3.12 and pip install dm-control"
    )


Physics: Any = _load("dm_control.mujoco").Physics
MovableCamera: Any = _load("dm_control.mujoco").MovableCamera
wrapper: Any = _load("dm_control.mujoco.wrapper")
control: Any = _load("dm_control.rl.control")
specs: Any = _load("dm_env.specs")


class BodyPhysics(Physics):  # type: ignore[misc] # dm_control has no types
    """MuJoCo's model and data of a `World`, stepped with the loop closed.

    `model` and `data` are the world's own objects: what is read or set here is read or set there. Every step overwrites
    `data.ctrl`; forces of your own go to `data.xfrc_applied`.

    Attributes:
        episode: The episode that the steps belong to.
    """

    def __init__(self, episode: Episode) -> None:
        self.episode = episode
        super().__init__(wrapper.MjData(cast(World, episode.world).data))

    def step(self, nstep: int = 1) -> None:
        """Take physics steps with the loop closed."""
        self.episode.advance(nstep)

    def reset(self, keyframe_id: int | None = None) -> None:
        """Go back to the initial condition of the present episode; there are no keyframes."""
        self.episode.repeat()

    def after_reset(self) -> None:
        """Update what depends on positions, which may have been changed since the reset."""
        mujoco.mj_fwdPosition(self.model.ptr, self.data.ptr)
        self.episode.sample()

    def copy(self, share_model: bool = False) -> "BodyPhysics":
        """Return physics in the same state with a world of its own, whose model it does not share."""
        return deepcopy(self)

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return BodyPhysics, (self.episode,)


class Tracking(control.Task):  # type: ignore[misc] # dm_control has no types
    """Tracking the harmonic extension: actions added to the law, local observations, a reward for each agent.

    Attributes:
        episode: The episode that the physics steps through.
        one_reward: True if the reward is the sum over all agents.
    """

    def __init__(self, episode: Episode, one_reward: bool = False) -> None:
        self.episode = episode
        self.one_reward = one_reward

    def initialize_episode(self, physics: BodyPhysics) -> None:
        """Begin the next episode."""
        self.episode.reset()

    def before_step(self, action: Mapping[str, Array], physics: BodyPhysics) -> None:
        """Choose the action of the coming control period."""
        self.episode.act(action)

    def action_spec(self, physics: BodyPhysics) -> dict[str, Any]:
        """Action of each agent within `Episode.bounds`, by id."""
        found = {}
        for name, bounds in self.episode.bounds.items():
            low, high = bounds if self.episode.action == "thrust" else bounds[:, 0]  # a velocity has one for all axes
            found[name] = specs.BoundedArray(bounds.shape[1:], np.float64, low, high, name=name)
        return found

    def observation_spec(self, physics: BodyPhysics) -> dict[str, Any]:
        """Shapes of `Episode.observe`, by agent id."""
        return {
            agent: {name: specs.Array(value.shape, value.dtype, name=f"{agent}/{name}") for name, value in own.items()}
            for agent, own in self.episode.observe().items()
        }

    def get_observation(self, physics: BodyPhysics) -> dict[str, dict[str, Array]]:
        """Return what each agent measures itself."""
        return self.episode.observe()

    def get_reward(self, physics: BodyPhysics) -> Array | float:
        """Return -|q* - q|^2 of each agent, shape (N,), or the sum, m^2."""
        rewards = self.episode.rewards
        return float(rewards.sum()) if self.one_reward else rewards

    def get_termination(self, physics: BodyPhysics) -> float | None:
        """Return the final discount, 0 if the simulation blew up and 1 otherwise; None before the episode ends."""
        if self.episode.message:
            return 0.0
        return 1.0 if self.episode.finished else None


class TeamEnvironment(control.Environment):  # type: ignore[misc] # dm_control has no types
    """The environment that `dm_env` returns."""

    def __init__(self, episode: Episode, one_reward: bool = False) -> None:
        steps = episode.world.steps_per_sample
        task = Tracking(episode, one_reward)
        super().__init__(BodyPhysics(episode), task, n_sub_steps=steps, legacy_step=False)

    def reward_spec(self) -> Any:
        """Rewards of all agents in order, shape (N,), or their sum, m^2."""
        task = self.task
        return specs.Array(() if task.one_reward else (len(task.episode.agents),), np.float64, name="reward")


def dm_env(
    scenario: Scenario,
    *,
    horizon: float | None = None,
    seed: int | None = None,
    action: str = "residual",
    one_reward: bool = False,
    same_episode: bool = False,
) -> TeamEnvironment:
    """Return a scenario on bodies as an environment of dm_control; a step is one control period.

    Zero actions give the run of `mjsheaf run`, to the bit. The first episode is that of the seed, and each `reset`
    begins the next, whose seed is `env.task.episode.seed`; see `Episode.reset`.

    Action: a dict by agent id of velocities (n_i,), m/s, that are added to the law's commands before the speed limit.
    Of other kinds of `action` zeros are commands, and not the run: to stand still in the medium, or no thrust.
    Observation: a dict by agent id, see `Episode.observe`. Reward: -|q* - q|^2 of each agent, shape (N,), m^2, in the
    order of `scenario.team.agent_ids`. Agents that are lost or have yet to join keep their places: their observation is
    zero, with `present` False, their reward is 0, and their action is ignored.

    An episode ends at `time.end`, or at the horizon, with discount 1. One that blows up ends with discount 0 and the
    observation and reward of the sample before; `env.task.episode.message` and a warning in the log `mjsheaf` say why.

    Args:
        scenario: The scenario, as `mjsheaf.load_scenario` returns it.
        horizon: Length of an episode, s, a whole number of control periods; up to `time.end` unless given.
        seed: Seed of the first episode instead of the scenario's.
        action: Kind of the actions; see `Episode`.
        one_reward: True for the sum of the rewards, for learners and wrappers that take one number, such as Shimmy.
        same_episode: True to begin the same episode again with each `reset`, to the bit.

    Raises:
        InputError: The scenario cannot be simulated on bodies, an argument is not valid, or dm_control is missing.
        NotUniqueError: The harmonic extension is not unique.
    """
    episode = Episode(scenario, horizon=horizon, seed=seed, action=action, same_episode=same_episode)
    return TeamEnvironment(episode, one_reward)
