"""Events, against runs of smaller teams written out by hand, against the same run without them, and dense algebra."""

import itertools
from typing import Any

import mujoco
import numpy as np
import pytest
import xarray as xr

from mjsheaf import check, load_scenario, save, simulate
from mjsheaf.errors import InputError, NotUniqueError
from mjsheaf.loop.system import Phase
from mjsheaf.results.metrics import check_expectation, summarize, summarize_phases
from mjsheaf.runs.publish import execute
from mjsheaf.scenario import Scenario
from mjsheaf.video.camera import View
from mjsheaf.video.film import Frames, VideoOptions, film_of
from mjsheaf.video.scene import ABSENT, COMMUNICATION, Decorator, owners_of_geoms
from tests.builders import build_scenario, continued, mixed_scenario, positions_of
from tests.oracles.law import disagreement
from tests.strategies import slow

BACKENDS = ["ideal", "physics"]
LOST = 20  # sample at which an event happens in most of these tests
CHANNEL = {"centre": [4, 0], "direction": [0, 1], "beta": 0.5, "width": 4, "length": 10}
TERMS: dict[str, Any] = {"newton": {"rounds": 2}, "drift": {"filter": 0.1}, "integral": {"gain": 0.1}}


def chain(count: int, events: list[dict[str, Any]], **fields: Any) -> Scenario:
    """Boats in a row, each connected to the next; the first and the last sense a target."""
    places = {f"A{i}": [2.0 * i, (-1.0) ** i] for i in range(count)}
    usual: dict[str, Any] = {
        "time": {"end": 0.4},
        "controller": {"gain": 5.0, "control_period": 0.01},
        "communication": [list(pair) for pair in itertools.pairwise(places)],
        "flow": {"agents": {"dimension": 2, "drift": [0.3, 0.2], "channels": [CHANNEL]}},
        "events": events,
    }
    sensing = [["A0", "T1"], [f"A{count - 1}", "T2"]]
    return build_scenario(places, {"T1": [3, 3], "T2": [9, 0]}, sensing, **usual | fields)


def test_after_a_loss_the_run_is_that_of_the_smaller_team_from_there_on() -> None:
    """The smaller team is written out by hand, its formation with explicit places."""
    whole = mixed_scenario(time={"end": 0.6}, events=[{"time": 0.2, "lose": "boat"}])
    data = simulate(whole, "ideal").isel(time=slice(LOST, None))
    raw = whole.model_dump(mode="json", exclude_none=True)
    left = {"agents": raw["agents"][1:], "communication": [["front", "back"]], "sensing": raw["sensing"][1:]}
    smaller = continued(whole, data, 0, **left)
    fresh = simulate(smaller, "ideal")
    np.testing.assert_allclose(positions_of(data)[:, 1:], positions_of(fresh), rtol=0, atol=1e-12)
    for name in ("disagreement", "tracking_error", "harmonic_extension", "velocity_command"):
        np.testing.assert_allclose(data[name].values[:, 1:], fresh[name].values, rtol=0, atol=1e-11, err_msg=name)
        assert name == "velocity_command" or np.isnan(data[name].values[:, 0]).all()
    for name in ("formation_error", "centering_error"):
        np.testing.assert_allclose(data[name].values, fresh[name].values, rtol=0, atol=1e-11, err_msg=name)
    found, wanted = (summarize(s.team, d) for s, d in ((whole, data), (smaller, fresh)))
    for name in ("mean_disagreement", "tracking_error", "formation_error", "centering_error"):
        assert found[name] == pytest.approx(wanted[name], abs=1e-11), name


@pytest.mark.parametrize("backend", BACKENDS)
def test_news_of_a_loss_travels_one_edge_a_sample(backend: str) -> None:
    """Bit for bit, also on bodies, which a different neighbour affects only through the law."""
    plain, lost = (simulate(chain(5, e), backend) for e in ([], [{"time": 0.2, "lose": "A0"}]))
    apart = (plain["agent_position"].values != lost["agent_position"].values)[..., :2].any(axis=2)
    first = [int(np.flatnonzero(column)[0]) for column in apart.T]
    assert first == [LOST + 1, LOST + 1, LOST + 2, LOST + 3, LOST + 4]


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_a_lost_agent_does(backend: str) -> None:
    """It drifts with the medium; on bodies its thrusters stop, an aircraft falls and a boat floats."""
    scenario = mixed_scenario(
        time={"end": 1.0},
        controller={"gain": 3.0, "control_period": 0.01, **TERMS},
        events=[{"time": 0.2, "lose": "boat"}, {"time": 0.3, "lose": "back"}],
        flow={"agents": {"dimension": 3, "drift": [0.3, 0.2, 0]}},
    )
    aircraft = scenario.agents[2].model_copy(update={"vehicle": "hexarotor"})
    scenario = scenario.model_copy(update={"agents": [*scenario.agents[:2], aircraft]})
    data = simulate(scenario, backend)
    for agent, begin in ((0, 20), (2, 30)):
        assert not data["velocity_command"].values[begin:, agent, : 2 + (agent > 0)].any()
        assert data["velocity_command"].values[:begin, agent, :2].any()
        if backend == "ideal":
            after = data.isel(time=slice(begin, None), agent=agent)
            np.testing.assert_array_equal(after["agent_velocity"].values, after["agent_flow"].values)
        else:
            command = data["command"].values[begin:, agent]
            assert not np.nan_to_num(command).any()
            assert np.nan_to_num(data["command"].values[begin - 1, agent]).any()
    if backend == "physics":
        height = data["agent_height"].values
        thrown = data["agent_velocity"].values[30, 2, 2] * 0.7
        assert height[-1, 2] - height[30, 2] == pytest.approx(thrown - 0.5 * 9.81 * 0.7**2, rel=0.25)  # some drag
        assert abs(height[-1, 0] - height[LOST, 0]) < 0.05


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_who_joins_is_silent_until_then_and_keeps_afloat(backend: str) -> None:
    joins = mixed_scenario(time={"end": 0.6}, events=[{"time": 0.2, "join": "back"}])
    data, never = simulate(joins, backend), mixed_scenario(time={"end": 0.6}, events=[{"time": 0.6, "join": "back"}])
    alone = simulate(never, backend)
    np.testing.assert_array_equal(positions_of(data)[: LOST + 1], positions_of(alone)[: LOST + 1])
    assert (positions_of(data)[LOST + 1] != positions_of(alone)[LOST + 1])[2].any()
    np.testing.assert_array_equal(np.isnan(data["tracking_error"].values).sum(axis=0), [0, 0, LOST])
    if backend == "physics":
        assert abs(data["agent_height"].values[LOST, 2] - 5.0) < 0.1  # its rotors turn
        assert np.nan_to_num(data["command"].values[LOST - 1, 2]).any()


def waiting(flow: list[float], **agent: Any) -> Scenario:
    """Two boats and two aircraft in a flow; one of each joins after eight seconds."""
    return build_scenario(
        {
            "B1": {"position": [-10, 0], "vehicle": "otter"},
            "B2": {"position": [-10, 8], "vehicle": "wamv", "heading": 50, **agent},
            "Q1": {"position": [0, 0, 12], "vehicle": "quadrotor"},
            "Q2": {"position": [9, 5, 12], "vehicle": "hexarotor", **agent},
        },
        {"T": [0, 3, 10]},
        [["B1", "T"], ["Q1", "T"]],
        communication=[["B1", "B2"], ["Q1", "Q2"]],
        time={"end": 9.0},
        controller={"gain": 0.5, "control_period": 0.05, "velocity_limit": 4.0},
        events=[{"time": 8, "join": "B2"}, {"time": 8, "join": "Q2"}],
        flow={"water": {"dimension": 2, "drift": flow[:2]}, "air": {"dimension": 3, "drift": flow}},
        disturbance={"agents": {"bound": 0.1}},
        physics={"timestep": 0.01},
    )


def strayed(data: xr.Dataset) -> np.ndarray:
    """Largest distance of B2 and Q2 from where they began, before they join, m."""
    position = np.nan_to_num(data["agent_position"].sel(agent=["B2", "Q2"]).values[:161])
    return np.linalg.norm(position - position[0], axis=2).max(axis=0)


@pytest.mark.parametrize(
    ("backend", "engine", "most", "least"),
    [("ideal", "mujoco", 0.0, 4.0), ("physics", "mujoco", 0.5, 3.0), ("physics", "fused", 0.5, 3.0)],
)
def test_one_who_has_yet_to_join_keeps_its_station(backend: str, engine: str, most: float, least: float) -> None:
    """On ideal kinematics to the bit; with every other agent as if it drifted."""
    held, adrift = (simulate(waiting([0.5, -0.3, 0], **more), backend, engine=engine) for more in ({}, {"drift": True}))
    assert (strayed(held) <= most).all()
    assert (strayed(adrift) > least).all()
    ours, theirs = (data["agent_position"].sel(agent=["B1", "Q1"]).values[:161] for data in (held, adrift))
    np.testing.assert_array_equal(ours, theirs)
    if backend == "ideal":
        before = held.sel(agent=["B2", "Q2"]).isel(time=slice(0, 160))
        np.testing.assert_array_equal(before["velocity_command"], -before["agent_flow"])
        assert not np.nan_to_num(before["agent_velocity"]).any()


@pytest.mark.parametrize("backend", BACKENDS)
def test_station_keeping_obeys_the_velocity_limit(backend: str) -> None:
    """In wind faster than that it drifts off, more slowly than the wind."""
    scenario = waiting([0.0, 5.0, 0])
    data = simulate(scenario, backend)
    asked = np.linalg.norm(np.nan_to_num(data["velocity_command"].values), axis=2)[:160, [1, 3]]
    assert asked.max() == pytest.approx(4.0)
    speed = np.nan_to_num(data["agent_velocity"].sel(agent="Q2").values)[159, 1]
    assert 0.5 < speed < 1.5


def test_only_an_agent_that_joins_later_may_drift() -> None:
    raw = waiting([0, 0, 0]).model_dump(mode="json", exclude_none=True)
    raw["agents"][0]["drift"] = True
    with pytest.raises(InputError, match=r"agents.B1.drift: is true, but B1 is present from the start; expected"):
        load_scenario(raw)
    raw["agents"][0]["drift"] = False
    raw["agents"][1]["drift"] = True
    short = load_scenario(raw, {"time.end": 1.0})  # which has no event any more
    assert len(short.phases) == 1
    lost_first = [{"time": 1, "lose": "B2"}, {"time": 2, "join": "B2"}]
    with pytest.raises(InputError, match=r"agents.B2.drift"):
        load_scenario(raw | {"events": lost_first})


def test_cut_restore_lost_targets_and_gains_against_dense_algebra() -> None:
    scenario = mixed_scenario(
        time={"end": 0.6},
        events=[
            {"time": 0.1, "cut": ["back", "front"]},
            {"time": 0.2, "lose": "ship"},
            {"time": 0.3, "restore": ["front", "back"]},
            {"time": 0.3, "set": {"controller.gain": 1.5, "controller.velocity_limit": 0.75}},
            {"time": 0.4, "join": "ship"},
        ],
    )
    data, phases = simulate(scenario, "ideal", allow_drift=True), scenario.phases
    left = [[0, 1], [0], [0], [0, 1], [0, 1]]
    gains, seen = [3.0, 3.0, 3.0, 1.5, 1.5], [True, True, False, False, True]
    assert [phase.start for phase in phases] == [0, 10, 20, 30, 40]
    plain = mixed_scenario().team
    for k, phase in enumerate(phases):
        edges = [e for j, e in enumerate(plain.communication) if j in left[k]]
        edges += [e for e in plain.sensing if seen[k] or e.head != "ship"]
        x = positions_of(data)[phase.start]
        eta = disagreement(plain, x, edges)[:3]
        np.testing.assert_allclose(
            np.nan_to_num(data["disagreement_vector"].values[phase.start]), eta, rtol=0, atol=1e-12
        )
        wanted, limit = -gains[k] * eta, 0.75 if k > 2 else np.inf
        speed = np.linalg.norm(wanted, axis=1, keepdims=True)
        wanted *= np.minimum(1.0, limit / speed)
        np.testing.assert_allclose(np.nan_to_num(data["velocity_command"].values[phase.start]), wanted, atol=1e-12)
    assert data["phase"].values.tolist() == [min(k // 10, 4) for k in range(61)]


@pytest.mark.parametrize("backend", BACKENDS)
def test_while_nothing_arrives_nobody_is_commanded_and_then_all_goes_on(backend: str) -> None:
    """From its last event on the ideal run is one without links that begins where agents are then."""
    silence = [{"time": 0.2, "set": {"links.all.loss": 1}}, {"time": 0.3, "set": {"links.all.loss": 0}}]
    scenario = chain(4, silence)
    assert scenario.uses_seed(backend)
    data = simulate(scenario, backend)
    asked = np.abs(data["velocity_command"].values[..., :2]).max(axis=(1, 2))
    assert (asked[20:30] == 0.0).all()
    assert (np.delete(asked, np.s_[20:30]) > 0.1).all()
    np.testing.assert_allclose(data["delivery"].values, 31 / 41)
    if backend == "ideal":
        fresh = simulate(continued(scenario, data, 30), "ideal")
        np.testing.assert_allclose(positions_of(fresh), positions_of(data)[30:], rtol=0, atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_law_in_python_stops_with_its_agent(backend: str) -> None:
    def law(_: float, sample: Any) -> Any:
        return -3.0 * sample.disagreement + 0.1

    scenario = mixed_scenario(time={"end": 0.4}, events=[{"time": 0.2, "lose": "front"}])
    command = simulate(scenario, backend, controller=law, allow_drift=True)["velocity_command"].values
    assert not command[LOST:, 1].any()
    assert (np.abs(command[:, [0, 2], :2]) > 0.0).all()


def test_a_phase_that_leaves_agents_free_is_refused_beforehand() -> None:
    events = [{"time": 0.1, "set": {"controller.gain": 4}}, {"time": 0.2, "cut": ["A2", "A1"]}]
    scenario = chain(3, [*events, {"time": 0.3, "lose": "T2"}])
    with pytest.raises(NotUniqueError, match=r"phase 3, from t = 0\.3 s on \(lose T2\).*A2"):
        simulate(scenario, "ideal")
    data = simulate(scenario, "ideal", allow_drift=True)
    assert data.attrs["status"] == "finished"
    assert "A2" in data.attrs["free_directions"]


BAD = [
    ([{"time": 0.1, "lose": "A9"}], "events.0: lose", "A9", "A1"),
    ([{"time": 0.1, "lose": "A1"}, {"time": 0.2, "lose": "A1"}], "events.1: lose", "A1", "expected"),
    ([{"time": 0.2, "cut": ["A0", "A1"]}, {"time": 0.3, "cut": ["A1", "A0"]}], "events.1: cut", "A1 - A0", "expected"),
    ([{"time": 0.2, "cut": ["A0", "A2"]}], "events.0: cut", "A2", "A1"),
    ([{"time": 0.2, "restore": ["A0", "A1"]}], "events.0: restore", "A0 - A1", "expected"),
    ([{"time": 0.2, "join": "A1"}, {"time": 0.3, "join": "A1"}], "events.1: join", "A1", "expected"),
    ([{"time": 0.0, "join": "A1"}], "events.0: join", "start", "expected"),
    ([{"time": 0.2047, "lose": "A1"}], "events.0.time", "0.2047", "0.2 s"),
    ([{"time": 0.41, "lose": "A1"}], "events.0.time", "0.41", "0 to 0.4"),
    ([{"time": 0.1, "set": {"controller.gain": -1}}], "events.0: controller.gain", "-1", "above 0"),
    ([{"time": 0.1, "set": {"controller.gain": -1}}, {"time": 0.1, "lose": "A1"}], "events.0: controller.gain", "", ""),
    ([{"time": 0.1, "set": {"controller.gian": 1}}], "events.0: controller.gian", "unknown field", "gain"),
    ([{"time": 0.1, "set": {"seed": 1}}], "events.0: set.seed", "cannot", "controller"),
    ([{"time": 0.1, "set": {"controller.control_period": 1}}], "events.0: set.controller.control_period", "", "period"),
    ([{"time": 0.1, "set": {"controller" + ".x" * 5000: 1}}], "events.0: set", "10010 characters", "at most 200"),
    ([{"time": 0.1, "set": {}}], "events.0.set", "{}", "at least 1"),
    ([{"time": 0.1, "drop": "A1"}], "events.0", "drop", "lose, cut, restore, join, set"),
    ([{"time": 0.1, "cut": ["A1"]}], "events.0.cut", "A1", "2"),
    ([{"time": 0.1, "lose": id} for id in ("A0", "A1", "A2")], "events.2", "no agent", "at least one"),
]


@pytest.mark.parametrize(("events", "field", "value", "accepted"), BAD, ids=[f"{b[1]} {b[2]}" for b in BAD])
def test_bad_events_are_one_line(events: list[dict[str, Any]], field: str, value: str, accepted: str) -> None:
    with pytest.raises(InputError) as told:
        chain(3, events)
    line = str(told.value)
    assert "\n" not in line
    assert len(line) < 300
    for part in (f": {field}: ", value, accepted):
        assert part in line


def test_the_seed_counts_where_events_make_something_random() -> None:
    """Noise of odometry that an event begins; and losses in bursts, which two events describe together."""
    bursts = {"kind": "gilbert_elliott", "to_bad": 0.0, "to_good": 0.2}
    noisy = [{"time": 0.1, "set": {"controller.odometry.noise": 0.1}}]
    lossy = [{"time": 0.1, "set": {"links.all.loss": bursts}}, {"time": 0.2, "set": {"links.all.loss.to_bad": 0.1}}]
    law = {"time.end": 0.4, "controller.feedforward.rounds": 2}
    assert not load_scenario("paper", law).uses_seed("ideal")
    for events in (noisy, lossy):
        assert load_scenario("paper", law | {"events": events}).uses_seed("ideal")


PHASED: dict[str, Any] = {
    "time": {"end": 0.6},
    "events": [{"time": 0.2, "lose": "boat"}, {"time": 0.4, "cut": ["front", "back"]}],
    "expect": {"ideal": {"tracking_error": 99, "phases": [{}, {"tracking_error": 99}, {"mean_disagreement": 1e-9}]}},
}


def test_a_run_knows_its_phases() -> None:
    scenario = mixed_scenario(**PHASED)
    data, team = simulate(scenario, "ideal"), scenario.team
    found, final = summarize_phases(team, data), summarize(team, data)
    assert [(p["time"], p["events"]) for p in found] == [(0.0, []), (0.2, ["lose boat"]), (0.4, ["cut front - back"])]
    for phase, last in zip(found, (19, 39, 60), strict=True):
        error = np.sqrt(np.nanmean(data["tracking_error"].values[last] ** 2))
        assert phase["final"]["tracking_error"] == pytest.approx(error, rel=1e-12)
    assert found[2]["final"] == final
    checks = check_expectation(scenario.expect, "ideal", "finished", final, found)["checks"]
    assert {check["measure"]: check["met"] for check in checks} == {
        "tracking_error": True,
        "phases.1.tracking_error": True,
        "phases.2.mean_disagreement": False,
    }


@pytest.mark.long
def test_check_of_every_phase() -> None:
    scenario = chain(4, [{"time": 0.2, "lose": "A3"}, {"time": 0.3, "set": {"controller.gain": 300.0}}])
    record = check(scenario, trial=False)
    first, second, third = record["phases"]
    assert [p["start"] for p in record["phases"]] == [0.0, 0.2, 0.3]
    assert second["absent"] == ["A3"]
    alone = check(chain(4, [], time={"end": 0.2}), trial=False)  # each phase is checked over its own time
    for name in ("assumptions", "theorem", "law", "links", "margins", "fragility"):
        assert record[name] == first[name] == alone[name]
    # Without A3 no agent senses T2, and the others follow T1.
    assert [a["verdict"] for a in second["assumptions"]][4] == "fails"
    assert not second["ok"]
    assert not record["ok"]
    jumps = np.array(list(second["jumps"].values()))
    assert second["jump"] == pytest.approx(np.linalg.norm(jumps), rel=1e-9)
    H_left = np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    assert second["theorem"]["lambda_min"] == pytest.approx(np.linalg.eigvalsh(H_left)[0], rel=1e-9)
    assert {x["name"] for x in second["fragility"]["critical"]} >= {"A0", "A1", "A0 - A1", "A0 - T1"}
    assert third["jump"] == pytest.approx(0.0, abs=1e-9)
    assert second["law"]["stable"]
    assert third["law"]["stable"] is False


def test_the_film_shows_who_is_there() -> None:
    scenario = mixed_scenario(**PHASED)
    film, model = film_of(scenario, simulate(scenario, "ideal"))
    assert [film.stage(t) for t in (0.0, 0.19, 0.2, 0.39, 0.4, 0.6)] == [0, 0, 1, 1, 2, 2]
    assert [film.absent(t) for t in (0.1, 0.3, 0.5)] == [frozenset(), {0}, {0}]
    assert [[(i, j) for i, j, _ in stage.edges] for stage in film.stages] == [
        [(0, 1), (1, 2), (0, 4), (1, 3), (2, 3)],
        [(1, 2), (1, 3), (2, 3)],
        [(1, 3), (2, 3)],
    ]
    assert [stage.name for stage in film.stages] == ["", "lose boat", "cut front - back"]
    # Grey geoms are those of the boat, once it is lost; a ball stands at the q* of each agent that is there.
    options, owners = VideoOptions(), owners_of_geoms(model, film.body_id)
    frames, decorator = Frames(film, options), Decorator(film, options, owners)
    everything, camera, view = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.MjvCamera(), mujoco.MjvOption()
    boats, spheres = set(np.flatnonzero(np.equal(owners, 0)).tolist()), mujoco.mjtGeom.mjGEOM_SPHERE.value
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for time, lost in ((0.1, False), (0.3, True)):
        scene = mujoco.MjvScene(model, 500)
        mujoco.mjv_updateScene(model, data, view, None, camera, everything, scene)
        own = scene.ngeom
        now = frames.moment(int(np.abs(frames.times - time).argmin()))
        lines = decorator.add(scene, now, View(np.zeros(3), 30.0, -60.0, -35.0, 45.0))
        grey = {g.objid for g in scene.geoms[:own] if g.matid == -1 and np.array_equal(g.rgba, ABSENT)}
        seen = {g.objid for g in scene.geoms[:own] if g.objtype == mujoco.mjtObj.mjOBJ_GEOM.value}
        assert grey == (boats & seen if lost else set())
        large = [g for g in scene.geoms[own : scene.ngeom] if g.type == spheres and g.rgba[3] == np.float32(0.55)]
        assert len(large) == 3 - lost
        assert [len(batch.ends) for batch in lines if np.allclose(batch.rgba, COMMUNICATION)] == [2 - lost]
    assert boats & seen


def test_the_camera_does_not_follow_the_lost() -> None:
    """Wherever it goes, the camera's points of an absent agent lie where a target is."""
    scenario = mixed_scenario(time={"end": 0.6}, events=[{"time": 0.2, "lose": "back"}])
    film, _ = film_of(scenario, simulate(scenario, "physics"))
    frames = Frames(film, VideoOptions(fps=100))
    points, samples = frames.followed(0), frames.chunk(0)
    gone = samples.time >= 0.2
    for column in (2, 5 + 2):
        np.testing.assert_array_equal(points[gone, column], points[gone, 4])
    np.testing.assert_array_equal(points[~gone, 2], samples.positions[~gone, 2])


@pytest.mark.long
def test_jumps_are_those_of_the_run() -> None:
    """With targets that move: check follows their path, the run knows where they are."""
    scenario = load_scenario("paper", {"time.end": 2.0, "events": [{"time": 1.5, "lose": "A5"}]})
    data, k = simulate(scenario, "ideal"), scenario.phases[1].start
    old = scenario.whole.team.harmonic_extension(positions_of(data)[k])
    jump = np.linalg.norm(np.nan_to_num(data["harmonic_extension"].values[k]) - old, axis=1)
    found = check(scenario, trial=False)["phases"][1]["jumps"]
    assert "A5" not in found
    for id, size in zip(scenario.team.agent_ids, jump, strict=True):
        assert id == "A5" or found[id] == pytest.approx(size, abs=1e-6)
    assert max(found.values()) > 1.0


# -- an event changes nothing before its time --------------------------------------------------------------------------


HAPPENS = 0.4  # s
LEAD = {"feedforward": {"rounds": 2, "extrapolate": True}}
SWING = {"kind": "lissajous", "amplitude": [2, 2], "rate": [0.5, 0.7]}
LAWS: dict[str, dict[str, Any]] = {
    "paper's law": {},
    "feedforward": {"controller": {"feedforward": {"rounds": 2}}},
    "extrapolated": {"controller": LEAD},
    "newton": {"controller": {"newton": {"rounds": 2}}},
    "all terms": {"controller": {**LEAD, "newton": {"rounds": 3}, "drift": {}, "integral": {"gain": 0.1}}},
    "delayed rounds": {"controller": LEAD, "links": {"rounds": {"delay": 0.02, "loss": 0.1}}},
    "links": {"controller": LEAD, "links": {"all": {"noise": 0.05, "delay": 0.02, "loss": 0.2}}},
    "safety": {"controller": {**LEAD, "velocity_limit": 3.0}, "safety": {"distance": 1.0, "range": 8.0, "rate": 5.0}},
    "ranges": {
        "controller": {"newton": {"rounds": 2}},
        "communication": [
            {"between": [f"A{k}", f"A{(k + 1) % 4}"], "measures": "range", "offset": [5.0]} for k in range(4)
        ]
        + [["A0", "A2"], ["A1", "A3"]],
    },
}
EVENTS: list[dict[str, Any]] = [
    {"cut": ["A0", "A1"]},
    {"lose": "A2"},
    {"set": {"controller.gain": 1.0}},
    {"set": {"flow.agents.drift": [0.5, 0.0]}},
    {"set": {"links.all.noise": 0.1, "links.all.loss": 0.3}},
    {"set": {"controller.feedforward": {"rounds": 1, "filter": 0.3}}},
]
ENGINES = [("ideal", "mujoco"), ("physics", "mujoco"), ("physics", "fused")]


def boats_in_a_ring(law: dict[str, Any], events: list[dict[str, Any]]) -> Scenario:
    """Return four boats in a ring that follow a moving target."""
    fields: dict[str, Any] = {
        "seed": 3,
        "time": {"end": 0.5},
        "communication": [["A0", "A1"], ["A1", "A2"], ["A2", "A3"], ["A3", "A0"], ["A1", "A3"]],
        "flow": {"agents": {"dimension": 2, "drift": [0.2, 0.1]}},
        **law,
        "controller": {"gain": 0.5, "control_period": 0.02, **law.get("controller", {})},
        "events": [{"time": HAPPENS, **event} for event in events],
    }
    places = {"A0": [0, 0], "A1": [9, 2], "A2": [3, 8], "A3": [-5, 4]}
    target = {"position": [1, 1], "motion": SWING}
    return build_scenario(places, {"T": target}, [["A0", "T"], ["A3", "T"]], **fields)


QUICK = ("newton", "ideal", "mujoco")


@pytest.mark.parametrize(
    ("law", "backend", "engine"),
    [case if case == QUICK else slow(*case) for case in ((law, *engine) for law in LAWS for engine in ENGINES)],
)
def test_an_event_changes_nothing_before_its_time(law: str, backend: str, engine: str) -> None:
    options: dict[str, Any] = {"engine": engine, "threads": 1, "allow_drift": True, "progress": False}
    without = simulate(boats_in_a_ring(LAWS[law], []), backend, **options)
    past = without.time.values <= HAPPENS + 1e-9
    for event in EVENTS:
        if law == "ranges" and "lose" in event:  # rounds about a curved team need all of its agents
            continue
        found = simulate(boats_in_a_ring(LAWS[law], [event]), backend, **options)
        for name in ("agent_position", "target_position"):
            np.testing.assert_array_equal(found[name].values[past], without[name].values[past], err_msg=str(event))
        before = without.time.values < HAPPENS - 1e-9
        for name in ("velocity_command", "disagreement", "harmonic_extension"):
            np.testing.assert_array_equal(found[name].values[before], without[name].values[before], err_msg=str(event))
        assert not np.array_equal(found.velocity_command.values, without.velocity_command.values, equal_nan=True)


def test_a_run_without_events_has_no_phases() -> None:
    plain = simulate(mixed_scenario(), "ideal")
    assert "phases" not in plain.attrs
    assert plain["phase"].values.max() == 0
    assert [type(phase) for phase in mixed_scenario().phases] == [Phase]


@pytest.mark.long
def test_a_published_run_knows_its_phases_and_is_what_is_saved(tmp_path: Any) -> None:
    scenario = mixed_scenario(**PHASED)
    outcome, data = execute(scenario, "ideal", tmp_path / "run", video=None), simulate(scenario, "ideal")
    phases = summarize_phases(scenario.team, data)
    assert [{key: told[key] for key in phases[0]} for told in outcome.summary["phases"]] == phases
    assert outcome.summary["expect"]["met"] is False
    with xr.open_dataset(tmp_path / "run" / "result.nc", engine="h5netcdf") as written:
        np.testing.assert_array_equal(written["phase"].values, data["phase"].values)
        assert written.attrs["phases"] == data.attrs["phases"]
    save(data, tmp_path / "saved", video=False)
    assert (tmp_path / "saved" / "result.nc").read_bytes() == (tmp_path / "run" / "result.nc").read_bytes()
    again = load_scenario(tmp_path / "run" / "scenario.yaml")
    np.testing.assert_array_equal(positions_of(simulate(again, "ideal")), positions_of(data))
