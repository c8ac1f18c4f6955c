"""Runs that are stepped together equal `env` of the fused engine, whatever the others do.

Oracle: the same episodes one by one, through a Session each.
"""

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from mjsheaf import load_scenario
from mjsheaf.envs import env, vector_env
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario
from tests.builders import boat_and_drone, mixed_scenario, refused
from tests.envs.test_faces import still

NOISY = {"all": {"delay": 0.02, "noise": 0.2, "loss": 0.3, "range": 50.0}}
CHANGES: dict[str, dict[str, Any]] = {
    "plain": {},
    "disturbed": {"disturbance": {"agents": {"bound": 0.3}}, "spread": {"position": 0.5}},
    "links": {"links": NOISY},
    "terms": {
        "controller": {"gain": 3.0, "control_period": 0.01, "integral": {"gain": 0.5}, "feedforward": {"rounds": 3}}
    },
    "held": {"controller": {"gain": 3.0, "control_period": 0.05}},
    "limited": {"controller": {"gain": 3.0, "control_period": 0.01, "velocity_limit": 1.0}},
    "safe": {"safety": {"distance": 4.0, "range": 9.0}},
}
COMPILED = ["links", "terms", "safe"]  # which take a while to compile
WORLDS = 5
SPREAD = {"quads": {"spread.position": 0.3}}
SHIPPED = ["harbour", "open_sea", "paper_safe", "noisy_harbour", "double_gyre", "harbour_lost_hexarotor"]
SHIPPED += ["harbour_gusts", *SPREAD]


def compare(scenario: Scenario, periods: int, *, together: bool = True, **options: Any) -> None:
    """Compare the runs of a vector environment with environments of their seeds, under random actions.

    Each goes on by its own seeds into new episodes, whenever it ends; one is reset on the way.
    """
    worlds: Any = vector_env(scenario, WORLDS, **options)
    assert (worlds._worlds is not None) is together
    alone = [env(scenario.with_seed(scenario.seed + k), engine="fused", **options) for k in range(WORLDS)]
    rng = np.random.default_rng(3)
    found, _ = worlds.reset()
    np.testing.assert_array_equal(found, [one.reset()[0] for one in alone])
    ended = [False] * WORLDS
    for period in range(periods):
        if period == 3:
            found, _ = worlds.reset(options={"reset_mask": np.arange(WORLDS) == 1})
            np.testing.assert_array_equal(found[1], alone[1].reset()[0])
            ended[1] = False
        actions = rng.uniform(-1.5, 1.5, still(worlds.action_space).shape)
        *found, info = worlds.step(actions)
        for k, (one, action) in enumerate(zip(alone, actions, strict=True)):
            if ended[k]:
                own, named = one.reset()
                expected = own, 0.0, False, False
                assert info["seed"][k] == named["seed"]
            else:
                expected = one.step(action)[:4]
            for own, other in zip(found, expected, strict=True):
                np.testing.assert_array_equal(own[k], other)
            place = worlds.envs[k].episode.world
            np.testing.assert_array_equal(place.positions(), one.episode.world.positions())
            assert place.time == one.episode.world.time
            ended[k] = expected[2] or expected[3]
    assert (worlds._worlds is not None) is together


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in COMPILED else name for name in CHANGES]
)
@pytest.mark.parametrize("options", [{}, {"action": "velocity", "parts": ["received", "measurements", "velocity"]}])
def test_every_run_is_that_of_its_seed(name: str, options: dict[str, Any]) -> None:
    end = 0.25 if name == "held" else 0.05
    compare(mixed_scenario(**{"time": {"end": end}} | CHANGES[name]), 15, **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        {"events": [{"time": 0.05, "lose": "boat"}]},
        {"communication": [["boat", "front"], {"between": ["front", "back"], "directed": True}]},
    ],
)
def test_runs_that_no_batch_takes_are_stepped_one_by_one(change: dict[str, Any]) -> None:
    compare(mixed_scenario(**{"time": {"end": 0.3}} | change), 8, together=False)


@pytest.mark.long
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenarios(name: str) -> None:
    """Gusts, waves, rotors and noise, in new episodes too."""
    change: dict[str, Any] = {"physics.contacts": False} | SPREAD.get(name, {})
    scenario = load_scenario(name, change)
    end = {} if scenario.events else {"time.end": scenario.time.start + 4 * scenario.whole.grid.period}
    scenario = load_scenario(name, change | end)
    compare(scenario, 15, together=vector_env(scenario, 2)._worlds is not None)


def test_a_new_seed_changes_neither_paths_nor_fixed_targets() -> None:
    """Agents begin elsewhere, and the runs stay together: all that targets do is shared."""
    targets = [{"id": "beacon", "position": [5, 1], "motion": {"kind": "fixed"}}]
    targets += [{"id": "lead", "position": [5, 9], "motion": {"kind": "waypoints", "points": [[9, 9]], "speed": 1}}]
    agents = [{"id": name, "position": [k, 0]} for k, name in enumerate("AB")]
    spread, sensing = {"position": 0.5}, [["A", "beacon"], ["B", "lead"]]
    scenario = boat_and_drone(0.1, agents=agents, targets=targets, spread=spread, sensing=sensing)
    compare(scenario, 15)


def test_a_run_that_diverges_ends_alone() -> None:
    scenario = mixed_scenario(time={"end": 0.3})
    worlds = vector_env(scenario, 3, autoreset_mode=AutoresetMode.DISABLED, same_episode=True)
    worlds.reset()
    zero = still(worlds.action_space)
    worlds.step(zero)
    worlds.envs[1].episode.world._loop.state.qvel[:] = 1e30
    before = worlds.step(zero)
    assert before[2].tolist() == [False, True, False]
    assert "boat" in worlds.envs[1].episode.message or "diverged" in worlds.envs[1].episode.message
    after = worlds.step(zero)
    assert after[2].tolist() == [False, False, False]
    assert (after[1] != 0.0).tolist() == [True, False, True]
    np.testing.assert_array_equal(after[0][1], before[0][1])
    again, _ = worlds.reset()
    np.testing.assert_array_equal(again[1], again[0])
    assert worlds.envs[1].episode.message == ""


def test_actions_of_another_kind_are_refused() -> None:
    worlds = vector_env(mixed_scenario(time={"end": 0.1}), 2)
    for actions in (np.zeros(3), still(worlds.action_space) + np.nan):
        with refused(InputError, "actions", "finite"):
            worlds.step(actions)
