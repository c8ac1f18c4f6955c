"""Formations that change: against dense algebra, against runs that start from there, and between backends and faces."""

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mjsheaf import Session, World, envs, load_scenario, simulate
from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, continued, list_members, positions_of
from tests.oracles.law import disagreement, harmonic_extension
from tests.running import rms_error

PERIOD = 0.02
BEGIN, OVER = 0.2, 0.4  # s, of the change in most of these tests
FIRST, LAST = 10, 30  # its samples
MOVED = {"formations.ring.radius": 1.5, "formations.ring.angle": 40.0, "formations.ring.centre": [0.5, 0.2, 0.3]}
FEEDFORWARD = {"gain": 2.0, "control_period": PERIOD, "feedforward": {"rounds": 3}}
BACKENDS = ["ideal", pytest.param("physics", marks=pytest.mark.slow)]


def ring(events: list[dict[str, Any]], **fields: Any) -> Scenario:
    """Return a ring of drones and boats about a boat that moves, with a change of it."""
    agents = {"A1": [3.2, 0, 5], "A2": [0.1, 3, 5.5], "B1": [-3, 0.2], "B2": [0, -3.1]}
    target = {"position": [0, 0], "motion": {"kind": "waypoints", "points": [[9, 3]], "speed": 0.5}}
    usual: dict[str, Any] = {
        "time": {"end": 1.0},
        "controller": {"gain": 2.0, "control_period": PERIOD},
        "communication": [["A1", "A2"], ["A2", "B1"], ["B1", "B2"], ["B2", "A1"]],
        "anchors": [{"agent": "A1", "axes": ["z"], "value": [5]}],
        "formations": [{"name": "ring", "shape": "polygon", "members": [*agents], "radius": 3, "angle": 0}],
        "events": events,
    }
    return build_scenario(agents, {"T": target}, [["A1", "T"], ["B1", "T"]], **usual | fields)


def change(values: dict[str, Any] | None = None, time: float = BEGIN, over: float | None = OVER) -> dict[str, Any]:
    event = {"time": time, "set": values or MOVED}
    return event if over is None else event | {"over": over}


def offsets_of(scenario: Scenario) -> Array:
    return np.concatenate([e.b for e in scenario.team.measuring_edges])


def fields_after(scenario: Scenario, values: dict[str, Any] | None = None) -> Scenario:
    """Return the scenario without events, with the values that a change sets from its start."""
    raw = scenario.model_dump(mode="json", exclude_none=True) | {"events": []}
    for path, value in (values or MOVED).items():
        raw["formations"][0][path.rsplit(".", 1)[1]] = value
    return load_scenario(raw)


@pytest.mark.parametrize("backend", BACKENDS)
def test_q_star_and_the_true_disagreement_are_those_of_interpolated_offsets(backend: str) -> None:
    """Whatever agents receive over noisy links."""
    scenario = ring([change()], links={"all": {"noise": 0.1}})
    data = simulate(scenario, backend, engine="mujoco")
    before, after = offsets_of(scenario), offsets_of(fields_after(scenario))
    team = scenario.team
    ends = np.cumsum([len(e.b) for e in team.measuring_edges])[:-1]
    for k in range(0, data.sizes["time"], 3):
        share = np.clip((k - FIRST) / (LAST - FIRST), 0.0, 1.0)
        offsets = np.split(before + share * (after - before), ends)
        edges = [replace(e, offset=b) for e, b in zip(team.measuring_edges, offsets, strict=True)]
        expected = harmonic_extension(team, data["target_position"].values[k], edges)
        found = np.nan_to_num(data["harmonic_extension"].values[k])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
        away = np.linalg.norm(found - np.nan_to_num(data["agent_position"].values[k]), axis=1)
        np.testing.assert_allclose(data["tracking_error"].values[k], away, rtol=0, atol=1e-12)
        eta = np.linalg.norm(disagreement(team, positions_of(data)[k], edges), axis=1)[: len(team.agents)]
        np.testing.assert_allclose(data["disagreement"].values[k], eta, rtol=0, atol=1e-12)


@pytest.mark.parametrize("over", [None, 0.0])
def test_at_once_is_the_run_of_the_new_scenario_from_there(over: float | None) -> None:
    fixed = [{"id": "T", "position": [1, 0.5], "motion": {"kind": "fixed"}}]
    scenario = ring([change(over=over)], targets=fixed)
    data = simulate(scenario, "ideal").isel(time=slice(FIRST, None))
    fresh = simulate(continued(fields_after(scenario), data, 0), "ideal")
    for name in (
        *("agent_position", "harmonic_extension", "disagreement", "tracking_error", "velocity_command"),
        *("formation_error", "centering_error"),
    ):
        np.testing.assert_allclose(data[name].values, fresh[name].values, rtol=0, atol=1e-12, err_msg=name)


@pytest.mark.slow
@pytest.mark.usefixtures("in_python")
def test_with_exact_feedforward_the_error_decays_as_without_a_change() -> None:
    """On ideal kinematics, without flow: the offsets' rate is known and exact, from the first sample of a change on."""
    law = FEEDFORWARD | {"feedforward": {"rounds": 60}}
    still, moving = (rms_error(simulate(ring(events, controller=law), "ideal")) for events in ([], [change()]))
    np.testing.assert_allclose(moving, still, rtol=0, atol=1e-9)
    without = rms_error(simulate(ring([change()]), "ideal"))
    assert without[LAST] > 0.5  # which lags


def test_an_event_meanwhile_leaves_the_change_as_it_is() -> None:
    scenario = ring([change(), {"time": 0.4, "cut": ["A1", "A2"]}])
    assert [phase.start for phase in scenario.phases] == [0, FIRST, 20, LAST]
    data = simulate(scenario, "ideal", allow_drift=True)
    before, after = offsets_of(scenario), offsets_of(fields_after(scenario))
    rows = np.repeat(np.arange(len(scenario.team.measuring_edges)), [len(e.b) for e in scenario.team.measuring_edges])
    for k in range(FIRST, LAST + 1, 2):
        share = (k - FIRST) / (LAST - FIRST)
        team = scenario.phases[1 + (k >= 20) + (k >= LAST)].system.team
        left = rows if k < 20 else rows[rows > 0]
        b = (before + share * (after - before))[-len(left) :]
        found = np.concatenate([e.b for e in team.edges_at(k * PERIOD)])
        np.testing.assert_allclose(found, b, rtol=0, atol=1e-14)
    assert np.isfinite(data["tracking_error"]).all()


def test_a_change_in_two_halves_gives_the_same_q_star() -> None:
    middle = {"formations.ring.radius": 2.25}
    end = {"formations.ring.radius": 1.5}
    whole, halves = (
        simulate(ring(events), "ideal")
        for events in ([change(end)], [change(middle, over=OVER / 2), change(end, BEGIN + OVER / 2, OVER / 2)])
    )
    for name in ("harmonic_extension", "agent_position"):
        np.testing.assert_allclose(whole[name].values, halves[name].values, rtol=0, atol=1e-12, equal_nan=True)


@pytest.mark.long
def test_without_any_measurement_agents_stay_where_they_are_whatever_the_offsets_do() -> None:
    silent = simulate(ring([change()], links={"all": {"loss": 1.0}}, anchors=[]), "ideal", allow_drift=True)
    assert not silent["velocity_command"].fillna(0.0).values.any()


@pytest.mark.slow
def test_a_law_in_python_sees_the_offsets_of_now() -> None:
    seen = []

    def law(t: float, sample: Any) -> Array:
        for e, y, residual in zip(sample.edges, sample.measurements, sample.residuals, strict=True):
            np.testing.assert_array_equal(y + e.b, residual)
        seen.append(sample.truth.harmonic_extension)
        eta = disagreement(sample.team, sample.truth.positions, sample.edges, sample.measurements)
        return -2.0 * eta[: len(sample.team.agents)]

    plain, own = simulate(ring([change()]), "ideal"), simulate(ring([change()]), "ideal", controller=law)
    np.testing.assert_allclose(own["agent_position"].values, plain["agent_position"].values, rtol=0, atol=1e-12)
    np.testing.assert_allclose(seen, np.nan_to_num(plain["harmonic_extension"].values[: len(seen)]), rtol=0, atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_session_and_an_environment_are_the_run(backend: str) -> None:
    scenario = ring([change()])
    data = simulate(scenario, backend)
    with Session(scenario, backend) as session:
        for k in range(25):
            if k == 18:
                state = session.state
            np.testing.assert_array_equal(session.observe().truth.positions[0], data["agent_position"].values[k, 0])
            session.step()
        later = session.observe().truth.positions
        session.state = state
        for _ in range(25 - 18):
            session.step()
        np.testing.assert_array_equal(session.observe().truth.positions, later)
    if backend == "physics":
        episode, vector = envs.env(scenario), envs.vector_env(scenario, 2)
        episode.reset(seed=scenario.seed)
        vector.reset(seed=[scenario.seed] * 2)
        for k in range(1, 25):
            _, reward, *_ = episode.step(np.zeros(int(np.prod(episode.action_space.shape or ()))))
            error = float((data["tracking_error"].values[k] ** 2).sum())
            assert reward == pytest.approx(-error, rel=1e-9)
            rewards = vector.step(np.zeros((2, int(np.prod(episode.action_space.shape or ())))))[1]
            np.testing.assert_allclose(rewards, -error, rtol=1e-9)


@pytest.mark.long
def test_runs_on_two_engines_at_a_time_do_not_share_offsets() -> None:
    """One system, two runs at different times: each has its own offsets."""
    scenario = ring([change()])
    alone, first, second = (World(scenario) for _ in range(3))
    alone.step(300)
    first.step(250)
    second.step(200)  # in the change
    second.step(350)
    first.step(50)
    np.testing.assert_array_equal(first.positions(), alone.positions())


@pytest.mark.slow
def test_threads_do_not_share_desired_ranges() -> None:
    """One thread computes q* along a change while another one asks for q* as it begins."""
    raw = ring([change()]).model_dump(mode="json", exclude_none=True)
    for edge in raw["communication"]:
        edge["measures"] = "range"
    system = load_scenario(raw).phases[1].system
    times = np.linspace(BEGIN, BEGIN + OVER, 200)
    places = np.repeat(system.initial[None], len(times), axis=0)
    alone = system.team.harmonic_extension(places, times)
    assert np.abs(alone[-1] - alone[0]).max() > 1.0
    ended = threading.Event()

    def ask() -> None:
        while not ended.is_set():
            system.team.harmonic_extension(system.initial)

    other = threading.Thread(target=ask)
    other.start()
    try:
        beside = system.team.harmonic_extension(places, times)
    finally:
        ended.set()
        other.join()
    np.testing.assert_array_equal(beside, alone)


@pytest.mark.long
@pytest.mark.parametrize("measures", ["range", "bearing"])
def test_ranges_and_bearings_follow_their_places(measures: str) -> None:
    """Places move in straight lines, so that at all times some team fits all edges: it is q*."""
    ids = ["A", "B", "C", "D"]
    edges = [{"between": [i, j], "measures": measures} for k, i in enumerate(ids) for j in ids[k + 1 :]]
    places = [[3, 0], [0.2, 3], [-3, 0], [0, -3]]
    wide = [[4, 0.5], [0.4, 2], [-2, 0], [0.5, -3]]
    scenario = ring(
        [change({"formations.ring.displacements": wide})],
        controller=FEEDFORWARD | {"feedforward": {"rounds": 200}},
        agents=list_members(dict(zip(ids, places, strict=True))),
        targets=list_members({"T": [0, 0]}),
        communication=edges,
        sensing=[["A", "T"], ["B", "T"]],
        anchors=[],
        formations=[{"name": "ring", "shape": "explicit", "members": ids, "displacements": places}],
    )
    data = simulate(scenario, "ideal")
    for k in (0, FIRST, 17, 25, LAST, 45):
        share = np.clip((k - FIRST) / (LAST - FIRST), 0.0, 1.0)
        expected = (1.0 - share) * np.array(places) + share * np.array(wide)
        np.testing.assert_allclose(data["harmonic_extension"].values[k, :, :2], expected, rtol=0, atol=1e-9)
    error = rms_error(data)
    assert error[LAST] < 0.02  # the rounds solve for the velocity of q*; without them it lags by 0.5 m
    plain = {"controller": {"gain": 2.0, "control_period": PERIOD}}
    lagging = simulate(load_scenario(scenario.model_dump(mode="json", exclude_none=True) | plain), "ideal")
    assert rms_error(lagging)[LAST] > 5 * error[LAST]


def test_a_free_team_keeps_its_centroid_while_it_changes() -> None:
    raw = ring([change({"formations.ring.radius": 1.5})]).model_dump(mode="json", exclude_none=True)
    raw |= {"targets": [], "sensing": [], "anchors": []}
    data = simulate(load_scenario(raw), "ideal")
    middle = data["harmonic_extension"].values[..., :2].mean(axis=1)
    np.testing.assert_allclose(middle, np.broadcast_to(middle[0], middle.shape), rtol=0, atol=1e-7)
    assert np.isfinite(data["tracking_error"]).all()
    places = data["harmonic_extension"].values
    apart = [np.linalg.norm(places[k, 2, :2] - places[k, 3, :2]) for k in (0, LAST)]
    np.testing.assert_allclose(apart, [3 * np.sqrt(2), 1.5 * np.sqrt(2)], atol=1e-9)


BAD = [
    ({"time": 0.2, "set": {"formations.rung.radius": 1}}, "unknown formation; expected ring; did you mean ring?"),
    ({"time": 0.2, "set": {"formations.ring.radus": 1}}, "did you mean radius?"),
    ({"time": 0.2, "set": {"formations.ring.radius": -1}}, "formations.ring.radius: expected a number above 0"),
    ({"time": 0.2, "set": {"formations.ring.members": ["A1"]}}, "members cannot change during a run"),
    ({"time": 0.2, "set": {"formations.ring": 3}}, "set.formations.ring: expected fields of a formation"),
    ({"time": 0.2, "set": {"formations.ring": {"shape": "line"}}}, "formations.ring.spacing: missing"),
    ({"time": 0.2, "set": {"controller.gain": 3}, "over": 0.2}, "over: only formations change over a time"),
    ({"time": 0.2, "set": {"formations.ring.radius": 1}, "over": 0.21}, "lies between samples"),
    ({"time": 0.2, "set": {"formations.ring.radius": 1}, "over": -1}, "over: expected at least 0"),
    ({"time": 0.2, "lose": "A1", "over": 1}, "over"),
]


@pytest.mark.parametrize(("event", "message"), BAD)
def test_a_change_that_cannot_be(event: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=r"events\.0") as error:
        _ = ring([event]).phases
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_change_may_end_after_the_run(backend: str) -> None:
    """The run is then the beginning of the longer one, to the bit, as with `--set time.end=...`."""
    whole, begun = (simulate(ring([change()], time={"end": end}), backend) for end in (1.0, 0.4))
    assert begun.sizes["time"] == 21
    for name in ("agent_position", "harmonic_extension", "tracking_error", "formation_error"):
        np.testing.assert_array_equal(begun[name].values, whole[name].values[:21], err_msg=name)


@pytest.mark.slow
def test_a_phase_that_begins_meanwhile_changes_no_bit() -> None:
    """As a live session needs it, which repeats what happened with other events in it."""
    same = [{"time": time, "set": {"controller.gain": 2.0}} for time in (0.26, 0.4, 0.5)]
    whole, cut = (simulate(ring([change(), *more], controller=FEEDFORWARD), "ideal") for more in ([], same))
    for name in ("agent_position", "harmonic_extension", "velocity_command", "tracking_error", "formation_error"):
        np.testing.assert_array_equal(whole[name].values, cut[name].values, err_msg=name)


def test_changes_of_one_formation_follow_one_another() -> None:
    late = change({"formations.ring.radius": 2}, time=0.4, over=None)
    with pytest.raises(InputError, match=r"events\.1.*formations\.ring: still changes from an earlier event"):
        _ = ring([change(), late]).phases
    assert len(ring([change(), change({"formations.ring.radius": 2}, time=0.6)]).phases) == 4


def test_a_turn_through_one_point_is_refused_for_ranges() -> None:
    raw = ring([change({"formations.ring.angle": 180})]).model_dump(mode="json", exclude_none=True)
    raw["communication"][2] |= {"measures": "range"}
    with pytest.raises(InputError, match=r"over: brings the places of B1 and B2 together at 0\.4 s, .* no range"):
        _ = load_scenario(raw).phases
