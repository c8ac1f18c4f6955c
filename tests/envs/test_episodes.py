"""Episodes that follow one another, copies and pickles, seeds, and actions that are refused, in all environments.

Oracles: `simulate` of the seed that `info` names, to the bit, and a `Session` that is handed the same velocities.
"""

import copy
import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dm_control")  # has no build for the newest Pythons

from gymnasium.vector import AsyncVectorEnv

from mjsheaf import Session, simulate
from mjsheaf.arrays import Array
from mjsheaf.envs import dm_env, env, parallel_env, vector_env
from mjsheaf.errors import InputError
from mjsheaf.noise import next_seed
from mjsheaf.scenario import Scenario
from tests.builders import mixed_scenario, refused, two_aircraft

pytestmark = pytest.mark.filterwarnings("error")
RANDOM: dict[str, Any] = {
    "spread": {"position": 0.5},
    "disturbance": {"agents": {"bound": 0.5}, "targets": {"bound": 0.2}},
    "links": {"all": {"noise": 0.05, "loss": 0.3, "delay": 0.02}},
}
STEPS = 5


def random_scenario(**changes: Any) -> Scenario:
    """A mixed team with five control periods an episode, in which everything depends on the seed."""
    return mixed_scenario(**{"time": {"end": 0.01 * STEPS}} | RANDOM | changes)


class Face:
    """An environment as all of them are used here."""

    engine = "mujoco"
    begins_again = False  # in a step after the end

    def __init__(self, made: Any) -> None:
        self.env = made

    @property
    def episodes(self) -> list[Any]:
        """The episode of each run."""
        return [self.env.episode]

    def reset(self, seed: int | None = None) -> Any:
        """Begin an episode; return what it begins with, without the seed."""
        return self.env.reset(seed=seed)[0]

    def step(self, action: Array) -> tuple[Any, bool]:
        """Take a period with the action of the team in [-1, 1]; return all of it, and True if the episode has ended."""
        found = self.env.step(action)
        return found[:2], bool(found[3])

    def size(self) -> int:
        """Numbers in the action of the team."""
        return int(self.env.action_space.shape[-1])


class ParallelFace(Face):
    def step(self, action: Array) -> tuple[Any, bool]:
        ends = np.cumsum(self.episodes[0].dimensions)[:-1]
        found = self.env.step(dict(zip(self.env.possible_agents, np.split(action, ends), strict=True)))
        return found[:2], not self.env.agents

    def size(self) -> int:
        return int(self.episodes[0].dimensions.sum())


class ControlFace(ParallelFace):
    begins_again = True

    @property
    def episodes(self) -> list[Any]:
        return [self.env.task.episode]

    def reset(self, seed: int | None = None) -> Any:
        assert seed is None
        return self.env.reset().observation

    def step(self, action: Array) -> tuple[Any, bool]:
        episode = self.episodes[0]
        parts = np.split(action, np.cumsum(episode.dimensions)[:-1])
        bounds = [episode.bounds[name][1] for name in episode.agents]
        actions = {name: own * b for name, own, b in zip(episode.agents, parts, bounds, strict=True)}
        found = self.env.step(actions)
        return (found.observation, found.reward), found.last()


class VectorFace(Face):
    engine = "fused"
    begins_again = True

    @property
    def episodes(self) -> list[Any]:
        return [one.episode for one in self.env.envs]

    def step(self, action: Array) -> tuple[Any, bool]:
        found = self.env.step(np.tile(action, (self.env.num_envs, 1)))
        return found[:2], bool(found[3].all())


FACES: dict[str, Callable[..., Face]] = {
    "env": lambda scenario, **options: Face(env(scenario, **options)),
    "parallel_env": lambda scenario, **options: ParallelFace(parallel_env(scenario, **options)),
    "dm_env": lambda scenario, **options: ControlFace(dm_env(scenario, **options)),
    "vector_env": lambda scenario, **options: VectorFace(vector_env(scenario, 2, **options)),
}
COPIED: dict[str, Callable[[Any], Any]] = {"copy": copy.deepcopy, "pickle": lambda one: pickle.loads(pickle.dumps(one))}


def places(face: Face) -> list[Array]:
    """Return the positions of all vehicles in each run, m."""
    return [episode.world.positions() for episode in face.episodes]


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("name", FACES)
def test_each_reset_begins_the_run_of_the_seed_that_it_names(name: str) -> None:
    scenario = random_scenario()
    face = FACES[name](scenario)
    seeds = []
    for number in range(3):
        face.reset()
        seeds.append([episode.seed for episode in face.episodes])
        over, starts = False, places(face)
        while not over:
            _, over = face.step(np.zeros(face.size()))
        for seed, start, end in zip(seeds[-1], starts, places(face), strict=True):
            run = simulate(scenario.with_seed(seed), engine=face.engine, progress=False)["agent_position"].fillna(0.0)
            assert run.values[0].tobytes() == start[:3].tobytes(), number
            assert run.values[-1].tobytes() == end[:3].tobytes(), number
    assert seeds[0] == [scenario.seed + k for k in range(len(seeds[0]))]
    assert seeds[1:] == [[next_seed(seed) for seed in seeds[k]] for k in range(2)]
    assert len({seed for own in seeds for seed in own}) == 3 * len(seeds[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", FACES)
def test_one_seed_determines_all_episodes(name: str) -> None:
    one, other = (FACES[name](random_scenario()) for _ in range(2))
    for _ in range(3):
        np.testing.assert_equal(one.reset(), other.reset())
        other.step(np.ones(other.size()))  # when a run is reset, and where it then is, changes no later episode
    same = FACES[name](random_scenario(), same_episode=True)
    first = same.reset()
    same.step(np.ones(same.size()))
    np.testing.assert_equal(same.reset(), first)


@pytest.mark.long
def test_info_names_the_seed() -> None:
    scenario = random_scenario()
    whole, team = env(scenario), parallel_env(scenario)
    runs: Any = vector_env(scenario, 2)
    assert whole.reset(seed=7)[1] == {"seed": 7}
    assert whole.reset()[1] == {"seed": next_seed(7)}
    assert team.reset(seed=7)[1] == {name: {"seed": 7} for name in team.possible_agents}
    assert runs.reset(seed=7)[1]["seed"].tolist() == [7, 8]
    _, info = runs.reset(seed=[None, 3], options={"reset_mask": np.array([True, False])})
    assert (info["seed"].tolist(), info["_seed"].tolist()) == ([next_seed(7), 0], [True, False])
    for _ in range(STEPS):
        *_, info = runs.step(np.zeros(runs.action_space.shape))
        assert info == {}
    *_, info = runs.step(np.zeros(runs.action_space.shape))
    assert info["seed"].tolist() == [next_seed(next_seed(7)), next_seed(8)]


@pytest.mark.long
def test_runs_whose_seeds_change_what_they_share_go_on_one_by_one() -> None:
    """Frozen gusts have as many nodes as the ways along which vehicles may go, which begin where a seed draws them."""
    gusts = {"kind": "dryden", "wind_speed": 6, "frozen": True}
    flow = {"air": {"dimension": 3, "drift": [1, 0, 0], "gusts": gusts}}
    scenario = two_aircraft("x500", spread={"position": 4}, flow=flow, formations=[])
    runs: Any = vector_env(scenario, 1)
    alone = env(scenario, engine="fused")
    for seed in (0, None, None):
        found, info = runs.reset(seed=seed)
        own, named = alone.reset(seed=seed)
        assert info["seed"][0] == named["seed"]
        np.testing.assert_array_equal(found[0], own)
    assert runs._worlds is None


def play(face: Face, actions: Array) -> list[Any]:
    """Return all that a face says of these actions, one after another, in as many episodes as they take."""
    said: list[Any] = []
    for action in actions:
        found, over = face.step(action)
        said.append(found)
        if over and not face.begins_again:
            said.append(face.reset())
    return [*said, [episode.seed for episode in face.episodes]]


@pytest.mark.slow
@pytest.mark.parametrize("how", COPIED)
@pytest.mark.parametrize("name", FACES)
def test_copies_go_on_by_themselves_to_the_bit(name: str, how: str) -> None:
    face = FACES[name](random_scenario())
    face.reset()
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (3 * STEPS, face.size()))
    play(face, actions[: STEPS + 3])  # to the second episode
    copied = type(face)(COPIED[how](face.env))
    np.testing.assert_equal(play(face, actions), play(copied, actions))


def test_a_copy_within_a_period_and_after_a_blow_up() -> None:
    control = dm_env(random_scenario())
    control.reset()
    control.physics.step(13)
    copies = [copy.deepcopy(control).physics, control.physics.copy(), pickle.loads(pickle.dumps(control.physics))]
    control.physics.step(37)
    for copied in copies:
        assert copied.data.qpos.tobytes() != control.physics.data.qpos.tobytes()
        copied.step(37)
        assert copied.data.qpos.tobytes() == control.physics.data.qpos.tobytes()
    whole: Any = env(mixed_scenario(controller={"gain": 1e8, "control_period": 0.01}))
    whole.reset()
    over = False
    while not over:
        last, _, over, *_ = whole.step(np.zeros(whole.action_space.shape))
    again = pickle.loads(pickle.dumps(whole))
    assert again.episode.message == whole.episode.message
    np.testing.assert_array_equal(again.observe(), last)
    np.testing.assert_array_equal(again.reset()[0], whole.reset()[0])


def test_spaces_of_copies_draw_the_same() -> None:
    team = parallel_env(random_scenario())
    team.action_space("boat").seed(3)
    copied, pickled = copy.deepcopy(team), pickle.loads(pickle.dumps(team))
    drawn = [one.action_space("boat").sample() for one in (team, copied, pickled)]
    np.testing.assert_array_equal(drawn[1:], [drawn[0]] * 2)


@pytest.mark.long
@pytest.mark.parametrize("make", [np.int8, np.uint8, np.int16, np.int32, np.uint32, np.int64, np.uint64, int])
def test_every_whole_number_is_a_seed(make: Any) -> None:
    whole = env(random_scenario())
    runs: Any = vector_env(random_scenario(), 2)
    for seed in (0, 7):
        np.testing.assert_array_equal(whole.reset(seed=make(seed))[0], whole.reset(seed=seed)[0])
        assert runs.reset(seed=make(seed))[1]["seed"].tolist() == [seed, seed + 1]
        for several in ([make(seed), make(2)], (make(seed), None), np.array([seed, 2], make)):
            assert runs.reset(seed=several)[1]["seed"][0] == seed
    assert all(type(episode.seed) is int for episode in (whole.episode, runs.envs[0].episode))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2**63, 2**64, -1, np.int64(-1), True, 1.0, "1", 1 + 0j, object()])
def test_what_is_no_seed_is_refused_and_changes_nothing(seed: Any) -> None:
    scenario = random_scenario()
    whole, team = env(scenario), parallel_env(scenario)
    runs: Any = vector_env(scenario, 2)
    resets: list[Callable[[], Any]] = [
        partial(whole.reset, seed=seed),
        partial(team.reset, seed=seed),
        partial(runs.reset, seed=seed),
        partial(runs.reset, seed=[0, seed]),
        partial(dm_env, scenario, seed=seed),
    ]
    for reset in resets:
        with refused(InputError, "seed is", "expected a whole number"):
            reset()
    assert whole.reset()[1] == {"seed": scenario.seed}
    assert runs.reset()[1]["seed"].tolist() == [scenario.seed, scenario.seed + 1]
    with refused(InputError, "seed is", "2^63"):
        runs.reset(seed=2**63 - 1)  # of which the second run has no next number
    for several in ([], [1], [1, 2, 3], np.zeros((2, 2), int)):
        with refused(InputError, "seed"):
            runs.reset(seed=several)
    for mask in ([0, 1], "ab", None, [1, 1], np.zeros(3, bool), [2, 0]):
        with refused(InputError, "reset_mask", "(2,) bools"):
            runs.reset(options={"reset_mask": mask})


def test_states_keep_large_seeds() -> None:
    whole = env(random_scenario())
    for seed in (2**53 + 1, 2**62 + 3, 2**63 - 1):
        whole.reset(seed=seed)
        state = whole.episode.state()
        whole.reset(seed=1)
        whole.episode.set_state(state)
        assert whole.episode.seed == seed


WRONG: list[Any] = ["x", None, {}, 1, [], [[0.0]], 1j, object(), ["1"], 10**400, {"boat": "x"}, [None], [0.0, np.nan]]


@pytest.mark.slow
@pytest.mark.parametrize("wrong", WRONG, ids=[str(k) for k in range(len(WRONG))])
def test_wrong_actions_are_refused_in_one_line_and_change_nothing(wrong: Any) -> None:
    scenario = random_scenario()
    whole, team, runs, control = env(scenario), parallel_env(scenario), vector_env(scenario, 2), dm_env(scenario)
    acting: list[Any] = [team, control]
    for one in (whole, runs, *acting):
        one.reset()
    episodes = [whole.episode, team.episode, control.task.episode, *(single.episode for single in runs.envs)]
    before = [episode.state() for episode in episodes]
    steps: list[Callable[[], Any]] = [partial(whole.step, wrong), partial(runs.step, wrong)]
    if wrong != {}:  # no agent need be named
        steps += [partial(one.step, wrong) for one in acting]
    steps += [partial(one.step, {"boat": wrong}) for one in acting]
    steps += [partial(one.step, {"boat": [0.0, 0.0], "Z": [0.0, 0.0]}) for one in acting]
    for step in steps:
        with refused(InputError, "expected"):
            step()
    np.testing.assert_equal([episode.state() for episode in episodes], before)


def test_agents_that_have_ended_need_no_action_and_may_have_one() -> None:
    gone = mixed_scenario(time={"end": 0.1}, events=[{"time": 0.02, "lose": "boat"}])
    team = parallel_env(gone)
    team.reset()
    while "boat" in team.agents:
        team.step({})
    team.step({"boat": np.zeros(2)})
    with refused(InputError, "unknown agent 'ship'"):
        team.step({"ship": np.zeros(2)})


@pytest.mark.long
def test_environments_travel_to_other_processes() -> None:
    """Processes that begin afresh are handed pickles."""
    scenario = random_scenario()
    make, alone = partial(env, scenario), env(scenario)
    runs = AsyncVectorEnv([make, make], context="spawn")
    try:
        np.testing.assert_array_equal(runs.reset(seed=[5, 6])[0][0], alone.reset(seed=5)[0])
        zero = np.zeros((2, *alone.action_space.shape))  # type: ignore[misc]
        np.testing.assert_array_equal(runs.step(zero)[0][0], alone.step(zero[0])[0])
    finally:
        runs.close()


def replayed(scenario: Scenario, engine: str, actions: list[Array], bounds: Array, dimensions: Any) -> Array:
    """Return the positions to which a session comes by these actions of the team in [-1, 1]."""
    with Session(scenario, engine=engine) as session:
        for action in actions:
            velocity = np.zeros((len(dimensions), 3))
            rows, axes = np.nonzero(np.arange(3) < np.asarray(dimensions)[:, None])
            velocity[rows, axes] = action * bounds
            session.step(velocity)
        return session.engine.positions()


@pytest.mark.long
@pytest.mark.parametrize("name", FACES)
def test_random_sequences_are_sessions_to_the_bit(name: str) -> None:
    """Over 1,000 sequences of reset, step, copy, pickle and restore in all environments together.

    Oracle: a Session of the seed that the environment names, which is handed the episode's actions.
    """
    scenario = random_scenario()
    face = FACES[name](scenario)
    face.reset()
    taken: list[list[Array]] = [[] for _ in face.episodes]  # actions since the start of each run's episode
    saved: tuple[Any, list[list[Array]], bool] | None = None
    over = False
    rng = np.random.default_rng(11)
    for number in range(250):
        for _ in range(int(rng.integers(1, 6))):
            what = rng.choice(["step", "step", "step", "reset", "seed", "copy", "pickle", "save", "restore"])
            if what == "step":
                action = rng.uniform(-1.0, 1.0, face.size())
                if over and not face.begins_again:
                    face.reset()
                    taken, over = [[]], False
                began = over
                _, over = face.step(action)
                taken = [[] if began else [*own, action] for own in taken]
            elif what in ("reset", "seed"):
                face.reset(int(rng.integers(2**62)) if what == "seed" and name != "dm_env" else None)
                taken, over = [[] for _ in taken], False
            elif what in COPIED:
                face = type(face)(COPIED[what](face.env))
            elif what == "save":
                state = face.env.state() if name == "vector_env" else face.episodes[0].state()
                saved = state, [list(own) for own in taken], over
            elif saved is not None and not (saved[2] or over):
                if name == "vector_env":
                    face.env.set_state(saved[0])
                else:
                    face.episodes[0].set_state(saved[0])
                    if name == "parallel_env":
                        face.env.agents = list(face.env.possible_agents)
                taken, over = [list(own) for own in saved[1]], saved[2]
        for episode, own in zip(face.episodes, taken, strict=True):
            limits = np.concatenate([episode.bounds[agent][1] for agent in episode.agents])
            of_seed = scenario.with_seed(episode.seed)
            expected = replayed(of_seed, face.engine, own, limits, episode.dimensions)
            assert episode.world.positions().tobytes() == expected.tobytes(), (number, what)
