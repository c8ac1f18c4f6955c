"""Runs that are stepped period by period, on all engines: they are `simulate`'s, and nothing that looks at them shows.

Oracles: `simulate`'s dataset and plain worlds, to the bit; sessions against each other.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mjsheaf import Session, World, simulate
from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, NotUniqueError, UnstableError
from mjsheaf.law.in_python import Sample
from mjsheaf.scenario import Scenario
from tests.builders import mixed_scenario, refused
from tests.strategies import long

ENGINES: dict[str, dict[str, Any]] = {"ideal": {"backend": "ideal"}, "mujoco": {}, "fused": {"engine": "fused"}}
TANGLED: dict[str, Any] = {
    "time": {"end": 0.3},
    "controller": {
        "gain": 3.0,
        "control_period": 0.01,
        "velocity_limit": 2.0,
        "feedforward": {"rounds": 4, "filter": 0.05},
        "integral": {"gain": 0.2, "limit": 1.0},
        "odometry": {"noise": 0.02},
    },
    "links": {"all": {"noise": 0.05, "loss": 0.3, "delay": 0.02, "hold": 0.02}},
    "disturbance": {"agents": {"bound": 0.5}, "targets": {"bound": 0.2}},
    "spread": {"position": 0.5},
    "events": [{"time": 0.1, "lose": "boat"}, {"time": 0.2, "join": "boat"}],
}
CONTINUOUS = {"time": {"end": 0.1}, "controller": {"gain": 3.0, "control_period": 0.0, "record_period": 0.02}}
HELD = {"gain": 3.0, "control_period": 0.01}
NOISY = {"all": {"noise": 0.02}}

engines = pytest.mark.parametrize("engine", ENGINES)


def session_of(scenario: Scenario, engine: str, **options: Any) -> Session:
    return Session(scenario, **ENGINES[engine], **options)


def end_of(session: Session, command: Callable[[Session], Any] = lambda session: None) -> Array:
    """The state after the whole run."""
    while not session.finished:
        session.step(command(session))
    return session.state


def known(sample: Sample) -> list[bytes]:
    """All that a sample holds."""
    arrays = (sample.received, sample.disagreement, sample.command, sample.velocity, sample.angular_velocity)
    moved = (sample.displacement, sample.attitude, sample.truth.positions, sample.truth.attitude)
    return [np.float64(sample.time).tobytes(), *(x.tobytes() for x in (*sample.measurements, *arrays, *moved))]


@pytest.mark.parametrize(
    ("engine", "fields"),
    [
        *((engine, fields) for fields in ({"time": {"end": 0.2}}, CONTINUOUS) for engine in ENGINES),
        *(long(engine, TANGLED) for engine in ENGINES),
    ],
)
def test_periods_are_the_samples_of_simulate(fields: dict[str, Any], engine: str) -> None:
    scenario = mixed_scenario(**fields)
    run, session = simulate(scenario, **ENGINES[engine]), session_of(scenario, engine)
    shown = [session.observe()]
    while not session.finished:
        session.step()
        shown.append(session.observe())
    np.testing.assert_array_equal([sample.time for sample in shown], run["time"].values)
    flat = [run[f"{kind}_position"].fillna(0.0).values for kind in ("agent", "target")]
    positions = np.array([sample.truth.positions for sample in shown])
    assert positions.tobytes() == np.concatenate(flat, axis=1).tobytes()
    there = [sample.team.present for sample in shown]
    linked = "measured_" if "links" in fields else ""
    for name, values in (
        (f"{linked}disagreement_vector", [sample.disagreement for sample in shown]),
        ("velocity_command", [sample.command for sample in shown]),
    ):
        np.testing.assert_array_equal(np.array(values)[there], run[name].fillna(0.0).values[there], err_msg=name)
    if engine != "ideal":
        attitude = np.array([sample.attitude for sample in shown])
        np.testing.assert_array_equal(attitude, run["agent_orientation"].values)


@pytest.mark.long
@engines
def test_what_looks_changes_nothing(engine: str) -> None:
    scenario = mixed_scenario(**TANGLED)
    plain, watched = session_of(scenario, engine), session_of(scenario, engine)
    while not plain.finished:
        before = watched.state
        first, second = watched.observe(), watched.observe()
        assert known(first) == known(second)
        np.testing.assert_array_equal(watched.state, before)
        plain.step()
        watched.step(np.zeros((3, 3)))  # zeros are nothing
    np.testing.assert_array_equal(watched.state, plain.state)


@pytest.mark.slow(first=True)
@engines
def test_a_seed_is_a_run(engine: str) -> None:
    scenario = mixed_scenario(**TANGLED)
    session = session_of(scenario, engine)
    own = end_of(session)
    ends = []
    for seed in (None, 5, 5, 6, scenario.seed):
        session.reset(seed)
        assert session.time == 0.0
        ends.append(end_of(session))
        fresh = session_of(scenario if seed is None else scenario.with_seed(seed), engine)
        np.testing.assert_array_equal(ends[-1], end_of(fresh))
    np.testing.assert_array_equal(ends[0], own)
    np.testing.assert_array_equal(ends[1], ends[2])
    np.testing.assert_array_equal(ends[4], own)
    assert not np.array_equal(ends[1], own)
    assert not np.array_equal(ends[1], ends[3])
    assert session.scenario.seed == scenario.seed


@engines
def test_a_state_brings_its_seed(engine: str) -> None:
    """A session with another seed continues and restarts as the one from which the state was taken."""
    scenario = mixed_scenario(**TANGLED)
    session, other = session_of(scenario, engine), session_of(scenario.with_seed(5), engine)
    whole = end_of(session_of(scenario, engine))
    for _ in range(7):
        session.step()
    other.state = session.state
    np.testing.assert_array_equal(end_of(other), whole)
    assert other.scenario.seed == scenario.seed
    other.reset()
    np.testing.assert_array_equal(end_of(other), whole)


@pytest.mark.slow(each=True)
@engines
@pytest.mark.parametrize("at", [0, 7, 10, 15])
def test_a_state_goes_on_to_the_bit(engine: str, at: int) -> None:
    """In the same session and in another, also across events; what is observed next is the same."""
    scenario = mixed_scenario(**TANGLED)
    session, other = session_of(scenario, engine), session_of(scenario, engine)
    for _ in range(at):
        session.step()
    state, seen = session.state, known(session.observe())
    end = end_of(session)
    for continued in (session, other):
        continued.state = state
        np.testing.assert_array_equal(continued.state, state)
        assert known(continued.observe()) == seen
        np.testing.assert_array_equal(end_of(continued), end)
    for wrong in (state[:-1], np.append(state, 0.0), state * np.nan, state + np.inf, state[:0], np.zeros((2, 2))):
        with refused(InputError, "state has shape", "finite numbers"):
            other.state = wrong
        np.testing.assert_array_equal(other.state, end)


@engines
def test_the_rest_of_a_run_is_recorded(engine: str) -> None:
    scenario = mixed_scenario(time={"end": 0.2})
    session, whole = session_of(scenario, engine), session_of(scenario, engine).engine.run()
    for _ in range(7):
        session.step()
    (rest,) = session.engine.record(1000)
    np.testing.assert_array_equal(rest.time, whole.time[7:])
    np.testing.assert_array_equal(rest.positions, whole.positions[7:])
    moved = (whole.positions[-1] - whole.positions[-2])[:3]
    np.testing.assert_array_equal(session.observe().displacement, moved)


def wavering(t: float, sample: Sample) -> Array:
    """A law that depends on all that it is shown."""
    pull = -3.0 * sample.disagreement + 0.2 * sample.velocity - 0.1 * sample.displacement
    return np.asarray(pull + 0.01 * sum(float(y[0]) for y in sample.measurements) * np.cos(t))


@pytest.mark.slow(each=True)
@engines
def test_a_law_in_python_is_a_loop_of_the_users_own(engine: str) -> None:
    """Called inside, as `simulate` does, or outside: observe, decide, step."""
    scenario = mixed_scenario(time={"end": 0.2}, links={"all": {"noise": 0.02, "loss": 0.2}})
    inside = session_of(scenario, engine, controller=wavering)
    outside = session_of(scenario, engine, commanded=True)
    run = simulate(scenario, controller=wavering, **ENGINES[engine])
    positions = [inside.observe().truth.positions]
    while not inside.finished:
        inside.step()
        outside.step(wavering(outside.time, outside.observe()))
        positions.append(inside.observe().truth.positions)
        np.testing.assert_array_equal(outside.observe().truth.positions, positions[-1])
    np.testing.assert_array_equal(np.array(positions)[:, :3], run["agent_position"].fillna(0.0).values)


@pytest.mark.slow
@engines
def test_commands_are_added_or_take_the_place_of_the_law(engine: str) -> None:
    scenario = mixed_scenario(controller={**HELD, "velocity_limit": 2.0}, links=NOISY)
    push = np.array([[0.3, -0.5, 0.0], [0.2, 0.2, -2.0], [5.0, 0.0, 0.0]])
    added, placed = session_of(scenario, engine), session_of(scenario, engine, commanded=True)
    nominal = added.observe().command
    law = session_of(mixed_scenario(controller=HELD, links=NOISY), engine).observe().command  # without the limit
    for session, whole in ((added, law + push), (placed, push)):
        session.step(push)
        speed = np.linalg.norm(whole, axis=1, keepdims=True)
        expected = whole * np.minimum(1.0, 2.0 / np.maximum(speed, 1e-300))
        np.testing.assert_allclose(session.engine.memory.command[:3], expected, rtol=1e-13, atol=1e-15)
    assert np.linalg.norm(nominal, axis=1).max() > 1.0
    assert placed.observe().disagreement.tobytes() != added.observe().disagreement.tobytes()


@engines
def test_an_action_of_one_period_is_gone_in_the_next(engine: str) -> None:
    scenario = mixed_scenario(time={"end": 0.1})
    session = session_of(scenario, engine)
    session.step(np.ones((3, 3)))
    session.step()
    assert not session.engine.memory.supplied.any()


@engines
def test_a_law_begins_again_with_every_episode(engine: str) -> None:
    seen: list[float] = []

    class Law:
        def reset(self, team: Any, rng: np.random.Generator) -> None:
            seen.append(rng.random())

        def __call__(self, t: float, sample: Sample) -> Array:
            sample.exchange(sample.disagreement)
            return -sample.disagreement

    scenario = mixed_scenario(time={"end": 0.1})
    session = session_of(scenario, engine, controller=Law())
    session.step()
    session.reset()
    session.reset(scenario.seed + 1)
    session_of(scenario.with_seed(scenario.seed + 1), engine, controller=Law())
    assert seen[0] == seen[1]
    assert seen[2] == seen[3] != seen[0]
    assert session.engine.controller is not None
    assert session.engine.controller.traffic.rounds == 0


def test_a_period_that_has_begun_is_taken_to_its_end() -> None:
    session, whole = (Session(mixed_scenario(time={"end": 0.1})) for _ in range(2))
    assert isinstance(session.engine, World)
    session.engine.step(3)
    session.step()
    whole.step()
    assert session.time == whole.time
    np.testing.assert_array_equal(session.observe().truth.positions, whole.observe().truth.positions)


@engines
def test_a_blow_up_is_raised(engine: str) -> None:
    scenario = mixed_scenario(controller={"gain": 1e9, "control_period": 0.01}, time={"end": 1.0})
    session = session_of(scenario, engine)
    start = session.state
    with pytest.raises(UnstableError, match="unstable: "):
        end_of(session)
    session.state = start
    np.testing.assert_array_equal(session.state, start)
    session.reset()
    np.testing.assert_array_equal(session.state, start)


@engines
@pytest.mark.parametrize("command", [np.zeros((2, 3)), np.zeros(9), np.full((3, 3), np.nan), 1.0])
def test_a_wrong_command_is_refused(engine: str, command: Any) -> None:
    session = session_of(mixed_scenario(time={"end": 0.1}), engine)
    before = session.state
    with refused(InputError, "command has shape", "(3, 3) finite velocities"):
        session.step(command)
    np.testing.assert_array_equal(session.state, before)


def test_what_cannot_be_simulated_is_refused() -> None:
    free = mixed_scenario(sensing=[["boat", "ship"]], communication=[])
    for options in ENGINES.values():
        with pytest.raises(NotUniqueError):
            Session(free, **options)
        assert not Session(free, **options, allow_drift=True).finished
    scenario = mixed_scenario()
    for wrong, parts in (
        ({"backend": "real"}, ("unknown backend", "physics")),
        ({"engine": "warp"}, ("unknown engine", "fused")),
        ({"backend": "ideal", "engine": "fused"}, ("fused", "ideal")),
        ({"threads": 0}, ("threads", "at least 1")),
        ({"backend": "ideal", "threads": 2}, ("threads", 2, "ideal")),
        ({"controller": "law"}, ("controller", "callable")),
    ):
        with refused(InputError, *parts):
            Session(scenario, **wrong)
    with refused(InputError, "scenario is 'paper' (str)"):
        Session("paper")  # type: ignore[arg-type]
    for seed in (-1, "x", 1.5):
        with refused(InputError, "seed is"):
            Session(scenario).reset(seed)  # type: ignore[arg-type]


def test_a_world_takes_another_seed() -> None:
    scenario = mixed_scenario(**TANGLED)
    world, fresh = World(scenario), World(scenario.with_seed(5))
    world.step(30)
    world.reset(5)
    for one in (world, fresh):
        one.step(30)
    np.testing.assert_array_equal(world.get_state(), fresh.get_state())
    of_phases = World(scenario.phases)
    with refused(InputError, "seed", "Scenario"):
        of_phases.reset(5)
    with refused(InputError, "seed"):
        world.reset(-1)
