"""Environment of dm_control: the run itself without actions, local observations, ends of episodes.

Oracles: `simulate` and a plain `World`, to the bit; the dataset's tracking error; dm_env's own conformance tests.
"""

import io
import unittest
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dm_control")  # has no build for the newest Pythons

import dm_env as interface
from absl.testing import absltest
from dm_env import test_utils

from mjsheaf import World, simulate
from mjsheaf.envs import dm_env
from mjsheaf.errors import InputError
from tests.builders import mixed_scenario, refused
from tests.commands import python
from tests.envs.test_faces import LOST, SHIPPED, horizon, shipped
from tests.loop.test_session import CONTINUOUS, TANGLED
from tests.strategies import slow

EVENTS = [
    {"time": 0.05, "cut": ["boat", "front"]},
    {"time": 0.1, "lose": "boat"},
    {"time": 0.15, "set": {"controller.gain": 2.0}},
    {"time": 0.2, "join": "boat"},
    {"time": 0.25, "restore": ["boat", "front"]},
]
ALL = {
    **TANGLED,
    "controller": TANGLED["controller"] | {"drift": {"filter": 0.1}},
    "anchors": [{"agent": "back", "axes": ["z"], "value": [4.0]}],
    "events": EVENTS,
}
VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {"time": {"end": 0.2}},
    "continuous": CONTINUOUS,
    "newton": {"time": {"end": 0.2}, "controller": {"gain": 3.0, "control_period": 0.01, "newton": {"rounds": 5}}},
    "late start": {"time": {"start": 1.0, "end": 1.2}},
    "all": ALL,
}


def idle(env: Any) -> dict[str, Any]:
    """The action that leaves the law as it is."""
    return {name: np.zeros(spec.shape) for name, spec in env.action_spec().items()}


def steps(env: Any, action: dict[str, Any] | None = None) -> Iterator[Any]:
    """An episode's time steps after the first."""
    step = env.reset()
    while not step.last():
        step = env.step(idle(env) if action is None else action)
        yield step


def same(one: Any, other: Any) -> bool:
    """Return True if two observations have the same bits."""
    return all(value.tobytes() == other[name].tobytes() for name, value in one.items())


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("name", VARIANTS)
def test_without_actions_it_is_the_run_to_the_bit(name: str) -> None:
    scenario = mixed_scenario(**VARIANTS[name])
    run, env, world = simulate(scenario), dm_env(scenario), World(scenario)
    loop = env.task.episode.world
    positions, attitudes, rewards = [loop.positions()], [loop.quaternions()], []
    for step in steps(env):
        world.step(world.steps_per_sample)
        assert env.physics.data.qpos.tobytes() == world.data.qpos.tobytes()
        assert env.physics.data.qvel.tobytes() == world.data.qvel.tobytes()
        positions.append(loop.positions())
        attitudes.append(loop.quaternions())
        rewards.append(step.reward)
    world.close_loop(sample=True)
    assert loop.command.tobytes() == world.command.tobytes()  # signs of zeros too
    flat = [run[f"{kind}_position"].fillna(0.0).values for kind in ("agent", "target")]
    assert np.array(positions).tobytes() == np.concatenate(flat, axis=1).tobytes()
    assert np.array_equal(np.array(attitudes)[:, :3], run["agent_orientation"].values)
    errors = run["tracking_error"].fillna(0.0).values[1:]
    np.testing.assert_allclose(rewards, -(errors**2), rtol=1e-9, atol=1e-15)
    assert step.discount == 1.0
    assert env.physics.time() == pytest.approx(run["time"].values[-1])


def test_an_action_is_added_to_the_law_before_the_speed_limit() -> None:
    law = {"gain": 3.0, "control_period": 0.01, "velocity_limit": 2.0}
    free, scenario = mixed_scenario(controller=law | {"velocity_limit": 1e6}), mixed_scenario(controller=law)
    world, env = World(free), dm_env(scenario)
    assert {spec.maximum.item() for spec in env.action_spec().values()} == {2.0}
    assert [spec.shape for spec in env.action_spec().values()] == [(2,), (3,), (3,)]
    action = {"boat": np.array([0.3, -1.5]), "front": np.array([2.0, 2.0, -2.0]), "back": [50.0, 0.0, 0.0]}
    world.close_loop(sample=True)
    expected = world.command[:3].copy()
    expected[:, :] += [[0.3, -1.5, 0.0], [2.0, 2.0, -2.0], [2.0, 0.0, 0.0]]  # cut to the bounds of the spec
    speed = np.linalg.norm(expected, axis=1, keepdims=True)
    expected *= np.minimum(1.0, 2.0 / speed)
    env.reset()
    env.task.before_step(action, env.physics)
    env.physics.step(1)
    np.testing.assert_allclose(env.task.episode.world.command[:3], expected, rtol=1e-14)
    assert (speed > 2.0).any()
    acted, rest = [env.reset(), env.step(action), env.step(idle(env))], dm_env(scenario)
    assert not same(acted[1].observation["boat"], [rest.reset(), rest.step({})][1].observation["boat"])


def test_observations_are_local() -> None:
    """A change of a vehicle that an agent does not measure leaves its observation, to the bit, as it was."""
    env = dm_env(mixed_scenario())
    before = env.reset().observation
    with env.physics.reset_context():
        env.physics.named.data.qpos["boat/"][:2] += 0.7
    after = env.task.get_observation(env.physics)
    assert same(after["back"], before["back"])
    assert not same(after["front"], before["front"])
    moved = after["front"]["measurements"] - before["front"]["measurements"]
    np.testing.assert_allclose(moved[:2], [-0.7, -0.7], rtol=1e-12)  # boat is the tail of their edge
    np.testing.assert_array_equal(moved[2:], 0.0)
    team = env.task.episode.scenario.team
    own = [("boat", "front"), ("front", "back"), ("front", "diver")]
    assert [edge.between for edge in env.task.episode.edges["front"]] == own
    assert before["front"]["measurements"].shape == (2 + 3 + 3,)
    assert team.agent_ids == list(before)


def test_what_no_link_delivers_is_masked() -> None:
    env = dm_env(mixed_scenario(links={"all": {"delay": 0.03}}, time={"end": 0.1}))
    heard = [step.observation["front"]["received"].tolist() for step in [env.reset(), *steps(env)]]
    assert heard[:5] == [[False] * 3, [False] * 3, [False] * 3, [True] * 3, [True] * 3]
    first, fourth = env.reset().observation["front"], env.observation_spec()["front"]
    assert not first["measurements"].any()
    assert fourth["measurements"].shape == first["measurements"].shape


def test_absent_agents_keep_their_places() -> None:
    env, fast = dm_env(mixed_scenario(**LOST)), {"boat": [2.0, 2.0]}
    kept = [step.observation["boat"] for step in [env.reset(), *steps(env)]]
    present = [bool(own["present"]) for own in kept]
    assert present == [True] * 10 + [False] * 10 + [True] * 21
    for own, there in zip(kept, present, strict=True):
        assert there or not any(value.any() for value in own.values())
        assert own["received"].all() == there
    acting, resting = dm_env(mixed_scenario(**LOST)), dm_env(mixed_scenario(**LOST))
    for other in (acting, resting):
        other.reset()
    for k in range(20):
        step = acting.step(fast if k >= 10 else {})
        resting.step({})
        assert acting.physics.data.qpos.tobytes() == resting.physics.data.qpos.tobytes()
        assert (step.reward[0] == 0.0) == (9 <= k < 19)  # by the sample at the end of the step
        assert step.reward[1] < 0.0
    acting.step(fast)
    resting.step({})
    assert acting.physics.data.qpos.tobytes() != resting.physics.data.qpos.tobytes()


def test_horizon_shortens_an_episode() -> None:
    scenario = mixed_scenario(time={"end": 0.2})
    taken = list(steps(dm_env(scenario, horizon=0.05)))
    assert len(taken) == 5
    assert [step.discount for step in taken] == [1.0] * 5
    for wrong in (0.0, -1, 0.3, 0.015, float("nan"), "1", True):
        with refused(InputError, "horizon", "control periods of 0.01 s", "0.2 s"):
            dm_env(scenario, horizon=wrong)  # type: ignore[arg-type]


def test_an_episode_that_blows_up_ends_with_discount_0(caplog: pytest.LogCaptureFixture) -> None:
    env = dm_env(mixed_scenario(controller={"gain": 1e8, "control_period": 0.01}))
    before, start, step = env.reset(), env.task.episode.state(), env.step({})
    while not step.last():
        before, step = step, env.step({})
    assert step.discount == 0.0
    assert np.isfinite(step.reward).all()
    assert all(same(own, before.observation[name]) for name, own in step.observation.items())
    assert env.task.episode.message.startswith("unstable: ")
    assert env.task.episode.message in caplog.text
    env.task.episode.set_state(start)
    assert env.task.get_termination(env.physics) is None
    assert env.step({}).first()
    assert env.task.episode.message == ""


@pytest.mark.filterwarnings("ignore::UserWarning")  # of its windowing library, where there is no display
def test_the_viewers_loop_runs_it() -> None:
    from dm_control.viewer import runtime

    env = dm_env(mixed_scenario(time={"end": 0.1}))
    loop = runtime.Runtime(env)
    for _ in range(6):
        loop.tick(0.02, paused=False)
    assert 0.0 < env.physics.time() < 0.105
    np.testing.assert_array_equal(loop.last_action["boat"], 0.0)


@pytest.mark.slow
def test_a_wrapper_draws_it() -> None:
    from dm_control.suite.wrappers import pixels

    env = pixels.Wrapper(dm_env(mixed_scenario(time={"end": 0.05})), render_kwargs={"width": 64, "height": 48})
    picture = env.reset().observation["pixels"]
    assert picture.shape == (48, 64, 3)
    assert picture.std() > 1.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", [None, *map(slow, SHIPPED)])
def test_the_conformance_suite_passes(name: str | None) -> None:
    """dm_env's own tests, each on an environment of its own; also over the end of an episode with events."""
    scenario = shipped(name) if name else mixed_scenario(**LOST)

    class OfScenario(test_utils.EnvironmentTestMixin, absltest.TestCase):  # type: ignore[misc]
        def make_object_under_test(self) -> interface.Environment:
            return dm_env(scenario, horizon=horizon(scenario, 25 if name else 40))

        def make_action_sequence(self) -> Iterator[Any]:
            rng = np.random.default_rng(0)
            for _ in range(60):
                specs = self.environment.action_spec().items()
                yield {name: rng.uniform(spec.minimum, spec.maximum, spec.shape) for name, spec in specs}

    report = io.StringIO()
    tests = unittest.defaultTestLoader.loadTestsFromTestCase(OfScenario)
    result = unittest.TextTestRunner(report).run(tests)
    assert result.testsRun >= 4
    assert result.wasSuccessful(), report.getvalue()


def test_shimmy_makes_it_an_environment_of_gymnasium() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its windowing library, where there is no display
        shimmy = pytest.importorskip("shimmy.dm_control_compatibility")
    env = dm_env(mixed_scenario(**LOST), one_reward=True)
    rewards = [step.reward for step in steps(dm_env(mixed_scenario(**LOST)))]
    outer = shimmy.DmControlCompatibilityV0(env)
    outer.reset(seed=1)
    assert idle(env) in outer.action_space
    assert env.reward_spec().shape == ()
    for k, own in enumerate(rewards):
        observation, reward, terminated, truncated, _ = outer.step(idle(env))
        assert observation in outer.observation_space
        assert reward == own.sum()
        assert (terminated, truncated) == (False, k == len(rewards) - 1)
    outer.step(outer.action_space.sample())


@pytest.mark.slow
def test_only_the_environment_loads_its_library() -> None:
    """Gymnasium is asked for by its register of environments alone, which knows the scenarios once `envs` is loaded."""
    libraries = "{'dm_control', 'gymnasium', 'pettingzoo'}"
    code = f"import sys, mjsheaf; mjsheaf.simulate; mjsheaf.World; print({libraries} & set(sys.modules))"
    done = python(code + f"; mjsheaf.envs; print({libraries} & set(sys.modules))", PYTHONWARNINGS="error")
    assert (done.stdout, done.stderr) == ("set()\n{'gymnasium'}\n", "")


@pytest.mark.slow
@pytest.mark.parametrize("backend", [None, "off", "nonsense", "egl"])
def test_no_way_to_draw_stops_it(backend: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MUJOCO_GL", "DISPLAY", "PYOPENGL_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    code = (
        "import os, mjsheaf.mujoco_import, mjsheaf.envs; before = dict(os.environ); env = mjsheaf.envs.dm_env;"
        "print(callable(env), dict(os.environ) == before)"
    )
    done = python(code, None, PYTHONWARNINGS="error", **({"MUJOCO_GL": backend} if backend else {}))
    assert (done.stdout, done.stderr) == ("True True\n", "")
