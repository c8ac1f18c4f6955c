"""The environments of PettingZoo and Gymnasium: their own conformance suites, and the run itself where nobody acts."""

import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from pettingzoo.test import parallel_api_test, parallel_seed_test  # type: ignore[import-untyped]

import mjsheaf
from mjsheaf import load_scenario, simulate, simulate_many
from mjsheaf.arrays import Array
from mjsheaf.envs import env, parallel_env, vector_env
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import list_scenarios
from mjsheaf.video import available_backend
from tests.builders import mixed_scenario, refused
from tests.strategies import tried

LOST = {"time": {"end": 0.4}, "events": [{"time": 0.1, "lose": "boat"}, {"time": 0.2, "join": "boat"}]}
GONE = {"time": {"end": 0.4}, "events": [{"time": 0.1, "lose": "boat"}]}
SHIPPED = ["midpoint", "paper", "harbour_lost_hexarotor", "leader_follower", "range_formation", "quads"]
if os.environ.get("MJSHEAF_SCENARIOS") == "all":
    SHIPPED = [name for name in list_scenarios() if len(load_scenario(name).agents) <= 20]

EARLIER = {"harbour_lost_hexarotor": {"events.1.time": 0.6, "events.2.time": 1.2}}


def still(space: Any) -> Array:
    """The action that changes nothing."""
    return np.zeros(space.shape)


@pytest.fixture(autouse=True)
def _warnings_are_errors() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def shipped(name: str) -> Scenario | None:
    """A shipped scenario, its events within two seconds; None if it is refused."""
    scenario = load_scenario(name, EARLIER.get(name))
    return scenario if scenario.expect.refused is None else None


def cycles_beyond_events(scenario: Scenario, cycles: int) -> int:
    """A number of periods, or more if some event comes later."""
    last = max((event.time for event in scenario.events), default=scenario.time.start)
    return max(cycles, round((last - scenario.time.start) / scenario.whole.grid.period) + 10)


def compare_seeds(scenario: Scenario, cycles: int) -> None:
    """Compare two environments of one seed under equal random actions; `parallel_seed_test` stops after one step."""
    one, other = parallel_env(scenario), parallel_env(scenario)
    rng = np.random.default_rng(5)
    for _ in range(cycles):
        if not one.agents:
            np.testing.assert_equal(one.reset(seed=42), other.reset(seed=42))
        actions = {name: rng.uniform(-1.0, 1.0, one.action_space(name).shape) for name in one.agents}
        np.testing.assert_equal(one.step(actions), other.step(actions))
        assert one.agents == other.agents


def horizon(scenario: Scenario, cycles: int) -> float:
    """Length of an episode of so many periods, or of the whole scenario, s."""
    return min(cycles, scenario.whole.grid.steps) * scenario.whole.grid.period


@pytest.mark.parametrize("change", [{"time": {"end": 0.2}}, LOST, GONE])
def test_the_conformance_suites_pass(change: dict[str, Any]) -> None:
    scenario = mixed_scenario(**change)
    parallel_api_test(parallel_env(scenario), num_cycles=60)
    parallel_seed_test(lambda: parallel_env(scenario), num_cycles=30)
    compare_seeds(scenario, 60)
    check_env(env(scenario), skip_render_check=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_the_conformance_suites_pass_on_shipped_scenarios(name: str) -> None:
    """Over 150 periods and all events, in `make test-all` over 1000.

    `MJSHEAF_SCENARIOS=all` tries every one of at most 20 agents.
    """
    scenario = shipped(name)
    if scenario is None:
        return
    cycles, fewer = cycles_beyond_events(scenario, tried(1000, 150)), tried(500, 100)
    parallel_api_test(parallel_env(scenario, horizon=horizon(scenario, cycles)), num_cycles=cycles)
    parallel_seed_test(lambda: parallel_env(scenario, horizon=horizon(scenario, fewer)), num_cycles=fewer)
    compare_seeds(scenario, cycles_beyond_events(scenario, fewer))
    check_env(env(scenario, horizon=horizon(scenario, 5)), skip_render_check=True)


@pytest.mark.parametrize("change", [{"time": {"end": 0.2}}, LOST])
def test_zero_actions_are_the_run_to_the_bit(change: dict[str, Any]) -> None:
    scenario = mixed_scenario(**change)
    expected = simulate(scenario)["agent_position"].values
    team, whole = parallel_env(scenario), env(scenario)
    team.reset()
    whole.reset()
    for k in range(1, len(expected)):
        team.step({name: still(team.action_space(name)) for name in team.agents})
        whole.step(still(whole.action_space))
        for world in (team.episode.world, whole.episode.world):
            found = world.positions()[: len(scenario.agents)]
            known = ~np.isnan(expected[k])
            np.testing.assert_array_equal(found[known], expected[k][known])
    assert not team.agents


def test_an_agent_that_is_lost_for_good_terminates_and_one_that_rejoins_is_masked() -> None:
    for change, ends in ((LOST, False), (GONE, True)):
        team = parallel_env(mixed_scenario(**change))
        team.reset()
        ended: dict[str, int] = {}
        step = 0
        while team.agents:
            observations, rewards, terminated, truncated, _ = team.step({})
            step += 1
            for name, own in terminated.items():
                if own:
                    ended[name] = step
            if "boat" in observations and 10 <= step < 20:
                assert not observations["boat"].any()
                assert rewards["boat"] == 0.0
        assert ("boat" in ended) is ends
        assert set(truncated) | set(ended) == set(team.possible_agents)


def test_every_world_is_the_fused_run_of_its_seed_to_the_bit() -> None:
    scenario = mixed_scenario(time={"end": 0.2}, spread={"position": 0.5}, disturbance={"agents": {"bound": 0.3}})
    worlds = vector_env(scenario, 3)
    worlds.reset(seed=5)
    expected = simulate_many([scenario.with_seed(5 + k) for k in range(3)], engine="fused")
    steps = expected[0].sizes["time"] - 1  # type: ignore[union-attr]
    for _ in range(steps):
        _, rewards, _, truncated, _ = worlds.step(still(worlds.action_space))
    assert truncated.all()
    for k, run in enumerate(expected):
        last = run["agent_position"].values[-1]  # type: ignore[index]
        found = worlds.envs[k].episode.world.positions()[: len(last)]
        np.testing.assert_array_equal(found[~np.isnan(last)], last[~np.isnan(last)])
        error = run["tracking_error"].values[-1]  # type: ignore[index]
        assert rewards[k] == pytest.approx(-np.nansum(error**2))


def test_a_run_that_ended_begins_again_or_stands_still() -> None:
    scenario = mixed_scenario(time={"end": 0.05})
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED):
        worlds = vector_env(scenario, 2, autoreset_mode=mode, same_episode=True)
        first, _ = worlds.reset()
        zero = still(worlds.action_space)
        for _ in range(5):
            last, _, _, truncated, _ = worlds.step(zero)
        assert truncated.all()
        after, rewards, _, truncated, _ = worlds.step(zero)
        assert not truncated.any()
        assert not rewards.any()
        np.testing.assert_array_equal(after, first if mode is AutoresetMode.NEXT_STEP else last)
        if mode is AutoresetMode.DISABLED:
            again, _ = worlds.reset(options={"reset_mask": np.array([True, False])})
            np.testing.assert_array_equal(again, np.stack([first[0], last[1]]))


def test_actions_in_place_of_the_law_move_the_vehicles() -> None:
    scenario = mixed_scenario(
        time={"end": 1.0}, controller={"gain": 1.0, "control_period": 0.01, "velocity_limit": 2.0}
    )
    moved = env(scenario, action="velocity")
    moved.reset()
    action = still(moved.action_space)
    action[0] = 1.0
    before = moved.episode.world.positions()[0]
    over = False
    while not over:
        *_, over, _ = moved.step(action)
    after = moved.episode.world.positions()[0]
    assert 1.0 < after[0] - before[0] <= 2.2
    np.testing.assert_allclose(after[1:], before[1:], atol=0.5)


def test_seeds_and_parts() -> None:
    scenario = mixed_scenario(time={"end": 0.1}, spread={"position": 0.5})
    one = env(scenario, parts=["measurements", "present"], same_episode=True)
    first, _ = one.reset(seed=3)
    other, _ = one.reset(seed=4)
    again, _ = one.reset(seed=3)
    same, _ = one.reset()
    assert not np.array_equal(first, other)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, same)
    whole = env(scenario)
    assert len(first) < len(whole.reset()[0])
    for wrong in ({"parts": ["smell"]}, {"render_mode": "human"}, {"action": "force"}, {"horizon": 99.0}):
        with refused(InputError):
            env(scenario, **wrong)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["range_formation", "bearing_formation"])
def test_observations_keep_their_size_where_nothing_is_received(name: str) -> None:
    """A distance is one number, also while its link has delivered none."""
    team = parallel_env(load_scenario(name, {"links.all.delay": 0.1}))
    seen = [team.reset()[0]]
    seen += [team.step({})[0] for _ in range(12)]
    for agent in team.agents:
        assert len({own[agent].shape for own in seen}) == 1
        assert seen[-1][agent] in team.observation_space(agent)
        assert team.episode.observe()[agent]["received"].all()


def test_only_the_tail_observes_a_directed_edge() -> None:
    team = parallel_env(load_scenario("leader_follower"))
    edges = {name: [edge.between for edge in own] for name, own in team.episode.edges.items()}
    assert edges["leader"] == [("leader", "ship")]
    assert edges["left"] == [("left", "leader")]
    assert edges["last"] == [("last", "left"), ("last", "right")]


@pytest.mark.long
def test_shipped_scenarios_are_registered() -> None:
    lines = ("import gymnasium, mjsheaf.envs", "made = gymnasium.make('mjsheaf/midpoint-v0', horizon=0.1)")
    script = "\n".join([*lines, "made.reset()", "print(made.spec.id)"])
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "mjsheaf/midpoint-v0", done.stderr


@pytest.mark.slow
@pytest.mark.skipif(available_backend()[0] is None, reason="no offscreen GL")
def test_pictures_show_the_vehicles() -> None:
    seen = env(mixed_scenario(time={"end": 0.1}), render_mode="rgb_array")
    seen.reset()
    picture = seen.render()
    assert picture.shape == (480, 640, 3)
    assert picture.std() > 5.0


def test_importing_the_package_loads_neither_library() -> None:
    script = "import sys, mjsheaf\nprint({'gymnasium', 'pettingzoo'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
    assert mjsheaf.envs.__all__ == ["Episode", "SheafLaw", "dm_env", "env", "parallel_env", "vector_env"]
