"""The trial at the end of `check`: missions that fail, each for a reason of its own, and missions that work.

Oracle: pencil and paper, and the run itself as `simulate` gives it.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import mjsheaf
from mjsheaf.checking import Examination, examine_scenario
from mjsheaf.checking import trial as trials
from mjsheaf.checking.check import try_out
from mjsheaf.checking.record import CheckRecord, headline
from mjsheaf.checking.report import screen
from mjsheaf.cli.figures import draw_check
from mjsheaf.scenario import Scenario
from mjsheaf.show.style import AS_USUAL
from tests.builders import DATA, dump_scenario, list_members, make_fields, require, two_boats
from tests.commands import Answer, answer_of
from tests.media import double_gyre
from tests.running import analyse
from tests.strategies import slow

STILL = {"kind": "static", "pull": 1}
CHASING = {"motion": {"kind": "waypoints", "points": [[1000, 0]], "speed": 5.0}}
FILTERED: dict[str, Any] = {
    "safety": {"distance": 4.0, "range": 30.0},
    "controller": {"gain": 0.01, "velocity_limit": 1.0},
}


def lone(vehicle: str, place: list[float], target: dict[str, Any], **fields: Any) -> Scenario:
    """One agent that tracks one target."""
    usual = make_fields(
        {"A": {"position": place, "vehicle": vehicle}},
        {"T": {"position": [0.0] * len(place), "motion": STILL, **target}},
        [["A", "T"]],
        name="scenario",
        time={"end": 40},
        controller={"gain": 0.5},
        physics={"timestep": 0.01},
    )
    return mjsheaf.load_scenario(usual | fields)


def near(**fields: Any) -> Scenario:
    """An Otter 5 m from its place."""
    return lone("otter", [5.0, 0.0], {}, **fields)


def circling(speed: float, *, axes: int = 2, radius: float = 100.0) -> dict[str, Any]:
    """A target that moves on a circle at a constant speed, m/s."""
    fields = {"amplitude": [radius, radius, 0.0], "rate": [speed / radius] * 3, "phase": [0, 1.5708, 0]}
    return {"motion": {"kind": "lissajous", **{name: values[:axes] for name, values in fields.items()}}}


def kinds(scenario: Scenario) -> set[str]:
    trial = mjsheaf.check(scenario)["trial"]
    assert trial["ok"] == (not trial["problems"])
    return {problem["kind"] for problem in trial["problems"]}


def test_a_mission_that_works_is_ok_with_the_error_of_its_run() -> None:
    scenario = near()
    record = mjsheaf.check(scenario)
    run = mjsheaf.simulate(scenario, engine="fused")["tracking_error"].values
    half = run[np.arange(len(run)) * 2 >= len(run) - 1]
    require(record, {"ok": True, "trial.ok": True, "trial.seconds": 40.0})
    assert record["trial"]["tracking_error"] == pytest.approx(np.sqrt((half**2).mean()), rel=1e-12)
    assert headline(CheckRecord(**analyse(scenario))).endswith("not tried")


def test_a_target_that_is_faster_leaves_its_agent_behind() -> None:
    """An Otter makes 3.09 m/s: it follows a target at 1 m/s, and none at 4 m/s."""
    assert kinds(lone("otter", [0.0, 0.0], circling(1.0))) == set()
    record = mjsheaf.check(lone("otter", [0.0, 0.0], circling(4.0)))
    assert record["problems"][-1]["what"] == "1 of 1 agents are slower than their places (3.09 of 4 m/s)"
    (failure,) = record["trial"]["problems"]
    assert (failure["kind"], failure["agent"], failure["time"]) == ("saturated", "A", 40.0)
    assert failure["number"] > 20.0


@pytest.mark.parametrize("own", [False, True])
def test_a_limit_that_is_too_low_is_raised_and_that_is_tried(own: bool) -> None:
    """Of an agent with a limit of its own that one."""
    agent = {"position": [0.0, 0.0, 0.0], "vehicle": "x500"} | ({"velocity_limit": 1.0} if own else {})
    law = {"gain": 0.5} | ({} if own else {"velocity_limit": 1.0})
    fields = {"scene": {"surface": "none"}, "agents": list_members({"A": agent}), "controller": law}
    record = mjsheaf.check(lone("x500", [0.0, 0.0, 0.0], circling(2.0, axes=3), **fields))
    (problem,) = record["problems"]
    assert not record["ok"]
    field = "agents.A.velocity_limit" if own else "controller.velocity_limit"
    assert problem["changes"] == {field: pytest.approx(2.4)}
    assert problem["tried"]["ok"]
    assert problem["tried"]["tracking_error"] < 0.2 * problem["tried"]["without"]
    assert problem["tried"]["without"] == record["trial"]["tracking_error"]


@pytest.mark.parametrize("bound", [0.0, slow(0.1)])
def test_a_gain_above_that_of_the_vehicles_ends_in_a_limit_cycle(bound: float) -> None:
    """That of a disturbance, m/s, explains no oscillation by metres."""
    law, disturbance = {"gain": 20.0}, {"agents": {"bound": bound}}
    target = {"position": [0.0, 0.0, 20.0]}
    record = mjsheaf.check(lone("quadrotor", [3.0, 0.0, 20.0], target, controller=law, disturbance=disturbance))
    (problem,) = record["problems"]
    assert "the vehicles' loop is unstable" in problem["what"]
    assert problem["tried"]["ok"]
    assert [one["kind"] for one in record["trial"]["problems"]] == ["limit_cycle"]


@pytest.mark.parametrize(("delay", "expected"), [(1.0, {"limit_cycle"}), (0.0, set())])
def test_noise_hides_no_limit_cycle(delay: float, expected: set[str]) -> None:
    """Of a gain that is too high for the delay; noise of 1 m could move a boat as far."""
    law, links = {"gain": 2.0, "control_period": 0.05, "velocity_limit": 4.0}, {"all": {"delay": delay, "noise": 1.0}}
    assert kinds(lone("hull", [3.0, 0.0], {}, controller=law, links=links, time={"end": 60})) == expected


def test_a_team_with_a_free_direction_is_refused_and_its_fix_is_tried(checked: Callable[[str], Answer]) -> None:
    record = json.loads(checked("air_tracks_surface").out)
    assert [problem["kind"] for problem in record["trial"]["problems"]] == ["refused"]
    assert record["trial"]["seconds"] == 0.0
    fix = record["problems"][0]
    assert fix["additions"] == {"anchors": [{"agent": "A1", "axes": ["z"], "value": [0.0]}]}
    assert fix["tried"]["tracking_error"] < 2.0
    assert fix["tried"]["without"] is None


@pytest.mark.slow(each=True)
@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        ("swap", {"safety.tie_break": "none"}, {"deadlock", "expectation"}),
        # Noise of odometry keeps the commands of these drones at their speed limit.
        ("noisy_odometry", {}, {"far_off"}),
    ],
)
def test_missions_fail_that_no_linear_analysis_faults(name: str, changes: dict[str, Any], expected: set[str]) -> None:
    assert kinds(mjsheaf.load_scenario(name, changes)) == expected


@pytest.mark.parametrize("ahead", [-1.0, -0.4])
def test_a_boat_that_cannot_go_astern_is_stuck_however_near_it_is(ahead: float) -> None:
    law = {"gain": 0.4, "velocity_limit": 2}
    assert kinds(lone(str(DATA / "skiff.yaml"), [0.0, 0.0], {"position": [ahead, 0.0]}, controller=law)) == {"stuck"}


def test_a_run_that_blows_up_says_which_vehicle_did() -> None:
    (problem,) = mjsheaf.check(lone("hull", [3.0, 0.0], {}, controller={"gain": 5000.0}))["trial"]["problems"]
    assert problem["kind"] == "blow_up"
    assert "A" in problem["text"].split()


@pytest.mark.long
def test_a_boat_runs_aground(tmp_path: Path) -> None:
    path = tmp_path / "land.nc"
    double_gyre.write(path, 40, 41, 400.0, land=True)
    water = {"kind": "gridded", "path": str(path), "origin": [double_gyre.LATITUDE, double_gyre.LONGITUDE]}
    sails = {"kind": "waypoints", "points": [[140, 50]], "speed": 1.0}
    target = {"position": [60.0, 50.0], "motion": sails}
    scenario = lone("otter", [60.0, 50.0], target, time={"end": 90}, flow={"water": water})
    (problem,) = mjsheaf.check(scenario)["trial"]["problems"]
    assert problem["kind"] == "blow_up"
    assert "ran aground" in problem["text"]


@pytest.mark.slow
def test_a_bound_for_bodies_that_is_missed_fails_and_one_that_is_met_does_not() -> None:
    for bound, expected in ((0.0, {"expectation"}), (1.0, set[str]())):
        scenario = near(expect={"physics": {"tracking_error": bound}})
        assert kinds(scenario) == expected


@pytest.mark.slow
def test_vehicles_that_come_closer_than_they_may_are_named_with_the_time() -> None:
    """A target without a filter of its own runs into an agent that is slower, and then keeps it from its place."""
    scenario = lone("otter", [20.0, 0.0], CHASING, **FILTERED)
    found = mjsheaf.check(scenario)["trial"]["problems"]
    problem, deadlock = found
    assert (problem["kind"], deadlock["kind"]) == ("too_close", "deadlock")
    assert problem["text"].startswith("A and T come ")
    run = mjsheaf.simulate(scenario, engine="fused")
    gaps = run["separation"].values
    assert problem["number"] == pytest.approx(-gaps.min(), rel=1e-12)
    assert problem["time"] == pytest.approx(float(run["time"][int(gaps.argmin())]))


@pytest.mark.slow
@pytest.mark.parametrize(("side", "expected"), [(-1, ["far_off"]), (1, [])])
def test_a_team_that_rests_in_another_equilibrium_is_far_off(side: int, expected: list[str]) -> None:
    """A triangle reflected in a point has the directions that its bearings desire, but for their signs."""
    places = dict(zip("ABC", ([0, 0], [8, 0], [2, 4]), strict=True))
    bearings = [{"between": [*pair], "measures": "bearing"} for pair in ("AB", "BC", "CA")]
    shape = {"name": "f", "shape": "explicit", "members": [*places], "displacements": [*places.values()]}
    agents = {id: [side * x, side * y] for id, (x, y) in places.items()}
    fields = make_fields(agents, {}, [], communication=bearings, formations=[shape], time={"end": 20})
    scenario = mjsheaf.load_scenario(fields | {"physics": {"timestep": 0.01, "contacts": True}})
    found = mjsheaf.check(scenario)["trial"]["problems"]
    assert [problem["kind"] for problem in found] == expected
    assert all("in another equilibrium" in problem["text"] for problem in found)


def test_a_mission_that_is_too_large_is_tried_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = near(expect={"physics": {"tracking_error": 1e-9}})
    monkeypatch.setattr(trials, "MAX_VEHICLE_STEPS", 2 * 2000)  # two vehicles, steps of 0.01 s
    record = mjsheaf.check(scenario)
    # What is expected at the end is not asked of a part.
    require(record["trial"], {"seconds": pytest.approx(20.0), "complete": False, "ok": True})
    assert "20 s, the part that fits" in " ".join(screen(CheckRecord(**record), "lone"))


def test_another_run_is_compared_over_the_same_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """An ideal run would get as far as the event, which loses an agent."""
    places = {"A": [5, 0], "B": [40, 0], "C": [0, 40]}
    boats = {name: {"position": place, "vehicle": "otter_rudder"} for name, place in places.items()}
    tide = {"water": {"dimension": 2, "tide": {"amplitude": 1.5, "period": 10.0}}}
    law = {"controller": {"gain": 0.2, "control_period": 0.05}, "events": [{"time": 100, "lose": "B"}]}
    target = {"T": {"position": [0.0, 0.0], "motion": STILL}}
    fields = make_fields(
        boats, target, [[name, "T"] for name in boats], name="cut", time={"end": 120}, flow=tide, **law
    )
    monkeypatch.setattr(trials, "MAX_VEHICLE_STEPS", 4 * 9600)
    assert kinds(mjsheaf.load_scenario(fields | {"physics": {"timestep": 0.01}})) == {"stuck"}


def test_thinning_changes_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = lone("otter", [0.0, 0.0], circling(4.0))
    whole = mjsheaf.check(scenario)["trial"]
    monkeypatch.setattr(trials, "_MAX_JUDGED", 200)
    part = mjsheaf.check(scenario)["trial"]
    assert [p["kind"] for p in part["problems"]] == [p["kind"] for p in whole["problems"]]
    assert part["tracking_error"] == pytest.approx(whole["tracking_error"], rel=0.05)


def test_the_command_tells_the_verdict_in_its_first_line(tmp_path: Path) -> None:
    path = tmp_path / "slow.yaml"
    path.write_text(dump_scenario(lone("otter", [0.0, 0.0], circling(4.0))))
    result = answer_of("check", str(path))
    assert result.code == 1
    assert result.out.startswith("scenario: NOT OK: ")
    assert "trial on bodies       40 s" in result.out
    left = answer_of("check", str(path), "--no-trial", "--json")
    assert left.code == 1
    assert json.loads(left.out)["trial"] is None


@pytest.mark.slow
def test_a_boat_that_moves_one_way_only_is_slower_than_any_place_that_moves() -> None:
    """The catamaran's bow thruster pushes both ways, and its slowest direction is its way abeam, 0.333 m/s."""
    record = mjsheaf.check(lone(str(DATA / "catamaran.yaml"), [0.0, 0.0], circling(3.0), controller={"gain": 0.3}))
    assert "slow" in {problem["kind"] for problem in record["problems"]}
    assert not record["ok"]


def test_a_target_that_starts_to_move_late_leaves_no_one_behind() -> None:
    """The error of a law without feedforward is in proportion to the target's speed, which is no fault."""
    samples = [[float(t), max(0.0, t - 60.0), 0.0] for t in np.arange(0.0, 91.0)]
    motion = {"kind": "recorded", "samples": samples}
    scenario = lone("otter", [0.0, 0.0], {"motion": motion}, time={"end": 90}, controller={"gain": 0.8})
    record = mjsheaf.check(scenario)
    assert record["trial"]["problems"] == []
    assert record["ok"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "fields",
    [
        {"physics": {"timestep": 0.01, "contacts": True}},
        {"controller": {"gain": 0.5, "control_period": 0}},
        {"time": {"start": 5.0, "end": 30.0}},
        {"events": [{"time": 20.0, "set": {"controller.gain": 0.6}}]},
    ],
    ids=["contacts", "continuous", "start", "event"],
)
def test_any_mission_is_tried(fields: dict[str, Any]) -> None:
    apart = [{"between": ["A", "T"], "offset": [8.0, 0.0]}]
    record = mjsheaf.check(lone("otter", [12.0, 0.0], {}, **fields, sensing=apart))
    require(record, {"ok": True, "trial.ok": True, "trial.complete": True})


def test_expectations_for_a_law_in_python_do_not_count_and_a_note_says_so() -> None:
    bound = {"controller": "law.py:law", "physics": {"tracking_error": 0.0}}
    record = mjsheaf.check(near(expect=bound))
    assert record["ok"]
    assert any("expectations are for the law law.py:law" in note for note in record["notes"])


@pytest.mark.slow
def test_a_boat_without_a_linear_model_is_undecided_unless_it_is_tried() -> None:
    scenario = lone("otter_rudder", [5.0, 0.0], {})
    (problem,) = analyse(scenario)["problems"]
    assert problem["kind"] == "untried"
    assert "untried" not in {one["kind"] for one in mjsheaf.check(scenario)["problems"]}


@pytest.mark.slow
def test_a_pair_that_begins_too_close_does_not_hide_another() -> None:
    """B and its target begin 1 m apart where 4 m are required; A and its target close in from afar."""
    raw = lone("otter", [20.0, 0.0], CHASING, **FILTERED).model_dump(mode="json", exclude_none=True)
    raw["agents"].append({"id": "B", "position": [0.0, 200.0], "vehicle": "otter"})
    raw["targets"].append({"id": "U", "position": [1.0, 200.0], "motion": STILL})
    raw["sensing"].append(["B", "U"])
    raw["communication"] = [{"between": ["A", "B"], "offset": [20.0, -200.0], "weight": 1e-6}]
    problems = mjsheaf.check(mjsheaf.load_scenario(raw))["trial"]["problems"]
    assert any(one["text"].startswith("A and T come ") for one in problems)


def test_the_plot_of_a_check_has_the_verdict_of_the_trial(tmp_path: Path) -> None:
    scenario = near(expect={"physics": {"tracking_error": 0.0}})
    analysis = examine_scenario(scenario)
    assert analysis.certificate.applies is analysis.record.theorem.applies
    record = try_out(analysis.record, scenario)
    figure = draw_check(Examination(record, analysis.certificate, analysis.system), AS_USUAL)
    assert "NOT OK" in figure.get_suptitle()


# -- what is no failure, and what is just beyond -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("speed", "wind", "expected"),
    [
        (3.05, 0.0, set[str]()),
        (3.2, 0.0, {"saturated"}),
        pytest.param(2.3, 12.0, set[str](), marks=pytest.mark.slow),
        pytest.param(2.5, 12.0, {"saturated"}, marks=pytest.mark.slow),
        pytest.param(2.9, 8.0, {"saturated"}, marks=pytest.mark.slow),
    ],
)
def test_a_place_a_little_faster_than_a_boat_at_full_thrust_leaves_it_behind(
    speed: float, wind: float, expected: set[str]
) -> None:
    """An Otter makes 3.08 m/s, 2.66 m/s into a wind of 8 m/s and 2.32 m/s into one of 12 m/s.

    The gain is so low that the command exceeds that by a few percent only. Errors grow, too, where it makes its command
    against the wind.
    """
    sails = {"kind": "recorded", "samples": [[t, speed * t, 0.0] for t in (0.0, 61.0)]}
    law = {"gain": 0.02, "feedforward": {}, "control_period": 0.1}
    flow = {"air": {"dimension": 2, "drift": [-wind, 0.0]}, "water": {"dimension": 2, "drift": [0.0, 0.0]}}
    fields = {"flow": flow} if wind else {}
    scenario = lone("otter", [0.0, 0.0], {"motion": sails}, time={"end": 60}, controller=law, **fields)
    assert {problem.kind for problem in trials.try_mission(scenario).problems} == expected


def pair_with_errors(first: list[float], second: list[float]) -> tuple[Scenario, xr.Dataset]:
    """Return two agents that track a target each, and a run in which the errors of each quarter are these, m."""
    scenario = two_boats("otter", "otter", time={"end": 20})
    data = mjsheaf.simulate(scenario, engine="fused")
    for number, errors in enumerate((first, second)):
        parts = np.array_split(np.arange(data.sizes["time"]), 4)
        for part, error in zip(parts, errors, strict=True):
            data["tracking_error"].values[part, number] = error
    return scenario, data


@pytest.mark.parametrize(
    ("errors", "counts"),
    [
        ([8.0, 6.0, 4.0, 3.3], False),
        ([8.0, 6.0, 4.0, 3.4], True),  # more than half is left after another run
        ([8.0, 4.0, 6.0, 4.0], True),  # driven away, and on its way back
        ([8.0, 8.0, 6.0, 4.0], True),
        ([np.nan] * 4, False),
    ],
)
def test_an_error_that_does_not_fall_throughout_is_compared_with_the_foreseen_one(
    errors: list[float], counts: bool
) -> None:
    scenario, data = pair_with_errors([0.1] * 4, errors)
    found = list(trials._far_off(scenario.phases, data, 3.0, 0.2))
    assert [problem.kind for problem in found] == ["far_off"] * counts


@pytest.mark.parametrize("other", [[9.0, 6.0, 4.0, 2.0], [np.nan] * 4])
def test_an_agent_that_approaches_or_is_absent_hides_no_other(other: list[float]) -> None:
    scenario, data = pair_with_errors([5.0] * 4, other)
    (problem,) = trials._far_off(scenario.phases, data, 6.5, 0.2)
    assert "the error is 6.5 m (RMS over agents, second half), and the analysis foresees 0.2 m" in problem.text
    counted = "agents on their first way to q* aside, it is 3.54 m"
    assert (counted in problem.text) == (not np.isnan(other).any())


@pytest.mark.parametrize(
    ("error", "largest", "away"),
    [(0.49, 30.0, False), (0.51, 30.0, True), (0.19, 2.0, False), (0.21, 2.0, True), (0.1, 0.1, True)],
)
def test_an_agent_that_has_done_its_way_is_not_away(error: float, largest: float, away: bool) -> None:
    _, data = pair_with_errors([100.0] * 4, [largest, error, error, error])
    assert bool(error > trials._away(data)[1]) is away
