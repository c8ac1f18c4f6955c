"""The environments of PettingZoo and Gymnasium: their own conformance suites, and the run itself where nobody acts."""

from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from pettingzoo.test import parallel_api_test, parallel_seed_test  # type: ignore[import-untyped]

from mjsheaf import load_scenario
from mjsheaf.arrays import Array
from mjsheaf.envs import env, parallel_env, vector_env
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario
from tests.builders import mixed_scenario, refused
from tests.commands import drawing, python
from tests.strategies import tried

pytestmark = pytest.mark.filterwarnings("error")
LOST = {"time": {"end": 0.4}, "events": [{"time": 0.1, "lose": "boat"}, {"time": 0.2, "join": "boat"}]}
GONE = {"time": {"end": 0.4}, "events": [{"time": 0.1, "lose": "boat"}]}
SHIPPED = ["midpoint", "paper", "harbour_lost_hexarotor", "leader_follower", "range_formation", "quads"]
EARLIER = {"harbour_lost_hexarotor": {"events.1.time": 0.6, "events.2.time": 1.2}}


def still(space: Any) -> Array:
    """The action that changes nothing."""
    return np.zeros(space.shape)


def shipped(name: str) -> Scenario:
    """A shipped scenario, its events within two seconds."""
    return load_scenario(name, EARLIER.get(name))


def horizon(scenario: Scenario, cycles: int) -> float:
    """Length of an episode of so many periods, or of the whole scenario, s."""
    return min(cycles, scenario.whole.grid.steps) * scenario.whole.grid.period


def require_conformance(scenario: Scenario, **options: Any) -> None:
    """Run the suites of PettingZoo and of Gymnasium."""
    parallel_api_test(parallel_env(scenario, **options), num_cycles=60)
    parallel_seed_test(lambda: parallel_env(scenario, **options), num_cycles=30)
    check_env(env(scenario, **options), skip_render_check=True)


@pytest.mark.parametrize("change", [{"time": {"end": 0.2}}, LOST, GONE])
def test_the_conformance_suites_pass(change: dict[str, Any]) -> None:
    require_conformance(mixed_scenario(**change))


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("name", SHIPPED)
def test_the_conformance_suites_pass_on_shipped_scenarios(name: str) -> None:
    """Over 150 periods and all events, in `make test-all` over 1000."""
    scenario = shipped(name)
    last = max((event.time for event in scenario.events), default=scenario.time.start)
    cycles = max(tried(1000, 150), round((last - scenario.time.start) / scenario.whole.grid.period) + 10)
    fewer = tried(500, 100)
    parallel_api_test(parallel_env(scenario, horizon=horizon(scenario, cycles)), num_cycles=cycles)
    parallel_seed_test(lambda: parallel_env(scenario, horizon=horizon(scenario, fewer)), num_cycles=fewer)
    check_env(env(scenario, horizon=horizon(scenario, 5)), skip_render_check=True)


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


def test_parts_of_observations_are_chosen() -> None:
    scenario = mixed_scenario(time={"end": 0.1})
    one = env(scenario, parts=["measurements", "present"])
    assert len(one.reset()[0]) < len(env(scenario).reset()[0])
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
    done = python(script)
    assert done.stdout.strip() == "mjsheaf/midpoint-v0", done.stderr


@pytest.mark.slow
@drawing
def test_pictures_show_the_vehicles() -> None:
    seen = env(mixed_scenario(time={"end": 0.1}), render_mode="rgb_array")
    seen.reset()
    picture = seen.render()
    assert picture.shape == (480, 640, 3)
    assert picture.std() > 5.0


def test_a_run_that_ended_stands_still_until_it_is_reset() -> None:
    """Where that is asked for; else it begins again, which the tests of vectors compare."""
    scenario = mixed_scenario(time={"end": 0.05})
    worlds = vector_env(scenario, 2, autoreset_mode=AutoresetMode.DISABLED, same_episode=True)
    first, _ = worlds.reset()
    zero = still(worlds.action_space)
    for _ in range(5):
        last, _, _, truncated, _ = worlds.step(zero)
    assert truncated.all()
    after, rewards, _, truncated, _ = worlds.step(zero)
    assert not truncated.any()
    assert not rewards.any()
    np.testing.assert_array_equal(after, last)
    again, _ = worlds.reset(options={"reset_mask": np.array([True, False])})
    np.testing.assert_array_equal(again, np.stack([first[0], last[1]]))
