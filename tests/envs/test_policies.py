"""The sheaf law as a policy. Oracles: eta of the law in the loop, and the run under it."""

from typing import Any

import numpy as np
import pytest

from mjsheaf import load_scenario, simulate
from mjsheaf.envs import SheafLaw, env, parallel_env, vector_env
from mjsheaf.errors import InputError
from tests.builders import mixed_scenario, refused

LAW = {"gain": 3.0, "control_period": 0.01, "velocity_limit": 2.0}
VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "links": {"links": {"all": {"noise": 0.05, "loss": 0.3, "delay": 0.02}}},
    "lost": {"events": [{"time": 0.1, "lose": "boat"}, {"time": 0.2, "join": "boat"}]},
    "cut": {"events": [{"time": 0.1, "cut": ["boat", "front"]}]},
}


@pytest.mark.parametrize("name", VARIANTS)
def test_eta_from_observations_is_that_of_the_loop(name: str) -> None:
    team = env(mixed_scenario(time={"end": 0.3}, controller=LAW, **VARIANTS[name]))
    law, rng = SheafLaw(team.episode), np.random.default_rng(0)
    observation, _ = team.reset()
    over = False
    while not over:
        expected = team.episode.world.disagreement[: len(law.agents)].copy()
        expected[~team.episode.present] = 0.0
        known = np.arange(3) < team.episode.dimensions[:, None]
        np.testing.assert_allclose(law.disagreement(observation), expected[known], rtol=1e-12, atol=1e-13)
        observation, _, broken, over, _ = team.step(rng.uniform(-1.0, 1.0, team.action_space.shape))
        assert not broken


def test_in_the_place_of_the_law_it_moves_the_team_as_the_law_does() -> None:
    scenario = mixed_scenario(time={"end": 1.0}, controller=LAW)
    team = env(scenario, action="velocity")
    law = SheafLaw(team.episode)
    observation, _ = team.reset()
    over = False
    while not over:
        observation, _, _, over, _ = team.step(law(observation))
    expected = np.nan_to_num(simulate(scenario)["agent_position"].values[-1])
    start = np.nan_to_num(simulate(scenario)["agent_position"].values[0])
    assert np.abs(expected - start).max() > 0.5
    np.testing.assert_allclose(team.episode.world.positions()[: len(expected)], expected, atol=1e-9)


def test_agents_alone_and_teams_at_once_act_as_the_team_does() -> None:
    scenario = mixed_scenario(time={"end": 0.1}, controller=LAW)
    single, worlds, agents = env(scenario), vector_env(scenario, 2), parallel_env(scenario)
    law = SheafLaw(single.episode)
    whole = law(single.reset()[0])
    for one in (single, worlds, agents, worlds.envs[0].episode):
        np.testing.assert_array_equal(SheafLaw(one).gain, law.gain)
    assert 0.1 < np.abs(whole).max() <= 1.0
    np.testing.assert_allclose(law(worlds.reset()[0]), [whole, whole], rtol=1e-12)
    observed, _ = agents.reset()
    alone = [law.of(name)(observed[name]) for name in agents.agents]
    np.testing.assert_allclose(np.concatenate(alone), whole, rtol=1e-12)


def test_an_agent_uses_its_own_observation_only() -> None:
    team = env(mixed_scenario(time={"end": 0.1}))
    law = SheafLaw(team.episode)
    sizes = [len(own) for own in team.episode.flat().values()]
    before, rng = team.reset()[0], np.random.default_rng(1)
    others = rng.normal(size=before.shape)
    others[: sizes[0]] = before[: sizes[0]]
    n = team.episode.dimensions[0]
    np.testing.assert_array_equal(law(others)[:n], law(before)[:n])
    assert (law(others)[n:] != law(before)[n:]).any()


def test_what_has_no_law_is_refused() -> None:
    with refused(InputError, "parts", "received"):
        SheafLaw(env(mixed_scenario(), parts=["measurements"]).episode)
    with refused(InputError, "range", "positions"):
        SheafLaw(env(load_scenario("range_formation")).episode)
    with refused(InputError, "episode is 'midpoint' (str)"):
        SheafLaw("midpoint")
    law = SheafLaw(env(mixed_scenario()).episode)
    with refused(InputError, "observation has shape (3,)"):
        law(np.zeros(3))
    with refused(InputError, "unknown agent 'ship'"):
        law.of("ship")
