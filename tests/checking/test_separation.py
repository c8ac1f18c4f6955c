"""Record of `check` about the safety filter."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mjsheaf import load_scenario, simulate
from mjsheaf.checking import examine
from mjsheaf.checking.separation import SafetyRecord, Standoff
from tests.builders import known, list_members, make_fields, require
from tests.commands import answer_of
from tests.running import analyse


def escort(**safety: Any) -> dict[str, Any]:
    """Two boats next to a target that passes a pier; at its place in q* one of them meets the pier."""
    sails = {"kind": "waypoints", "points": [[20, 0]], "speed": 1.0}
    abeam = {"shape": "explicit", "about": "T", "members": ["B1", "B2"], "displacements": [[0, 5], [0, -5]]}
    return make_fields(
        {"B1": [-20, 5], "B2": [-20, -5]},
        {"T": {"position": [-20, 0], "motion": sails}},
        [["B1", "T"], ["B2", "T"]],
        time={"end": 40},
        controller={"gain": 0.5, "control_period": 0.05, "velocity_limit": 3},
        communication=[["B1", "B2"]],
        formations=[{"name": "pair", **abeam}],
        safety={"distance": 2.0, **safety},
    )


def lasting(standoffs: list[Standoff]) -> list[Standoff]:
    """Return those that are larger than the formation at most samples, so that it cannot be reached."""
    return [one for one in standoffs if one.lasts]


PIER = {"kind": "sphere", "id": "pier", "centre": [0.0, 6.0], "radius": 0.5}


@pytest.mark.slow
def test_places_in_q_star_that_are_too_close_are_named_with_time_and_gap() -> None:
    found = analyse(escort(obstacles=[PIER]))["safety"]
    (worst,) = found["unsafe"]
    assert worst["pair"] == ["B1", "pier"]
    assert worst["gap"] == pytest.approx(1.0 - 0.5 - 2.0, abs=1e-3)
    run = simulate(load_scenario(escort()), backend="ideal")
    q_star = run["harmonic_extension"].values[:, 0, :2]
    away = np.linalg.norm(q_star - [0.0, 6.0], axis=1)
    assert worst["time"] == pytest.approx(float(run["time"][away.argmin()]), abs=0.2)


def test_pairs_that_begin_too_close_are_named() -> None:
    raw = escort()
    raw["agents"][0]["position"] = [-20, -4]
    assert analyse(raw)["safety"]["initial"] == [
        {"pair": ["B1", "B2"], "time": 0.0, "gap": pytest.approx(-1.0), "fraction": 1.0}
    ]


@pytest.mark.slow
@pytest.mark.usefixtures("without_plots")
def test_a_run_names_the_pair_that_is_closest_and_when(tmp_path: Path) -> None:
    raw = escort()
    raw["agents"][0]["position"] = [-20, -4]
    raw["time"] = {"end": 1}
    place = tmp_path / "escort.yaml"
    place.write_text(yaml.safe_dump(raw))
    answer = answer_of("run", place, "--backend", "ideal", "--no-video", "--out", tmp_path / "run")
    assert "TOO CLOSE: B1 and B2 are 1 m closer than required at t = 0 s" in answer.out
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["safety"]["closest"] == {"pair": ["B1", "B2"], "time": 0.0, "gap": pytest.approx(-1.0)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"controller.control_period": 0, "controller.record_period": 0.05}, "the law is continuous"),
        ({"safety.rate": 30}, "above 1"),
        ({"safety.range": 2.05}, "safety.range"),
        ({"controller.velocity_limit": 1.0}, "T may come at"),
        ({"targets.T.motion.pull": 40.0}, "motion.pull of T times the control period is 2, not below 2"),
        ({"flow.water": {"dimension": 2, "core": 1, "vortices": [{"centre": [9, 9], "gamma": 20}]}}, "towards B1"),
        ({"flow.water": {"dimension": 2, "core": 0, "vortices": [{"centre": [9, 9], "gamma": 1}]}}, "core"),
    ],
)
def test_what_the_theorem_requires_is_decided(change: dict[str, Any], told: str) -> None:
    found = analyse(escort(), change)["safety"]
    assert not found["guaranteed"]
    assert any(told in reason for reason in found["reasons"])


@pytest.mark.long
@pytest.mark.parametrize(
    "air",
    [
        {"drift": [14, 0]},
        {"channels": [{"centre": [0, 90], "direction": [1, 0], "beta": 9, "width": 5, "length": 99}]},
        {"gusts": {"kind": "dryden", "wind_speed": 12.0, "altitude": 4.0}},
    ],
)
def test_nothing_is_guaranteed_of_boats_that_wind_pushes(air: dict[str, Any]) -> None:
    def of(vehicle: str, flow: dict[str, Any]) -> Any:
        raw = escort()
        raw["agents"][0]["vehicle"] = vehicle
        return analyse(raw | {"flow": flow})["safety"]

    wind = {"air": {"dimension": 2, **air}}
    assert of("otter", {})["guaranteed"]
    assert of("hull", wind)["guaranteed"]
    found = of("otter", wind)
    assert not found["guaranteed"]
    assert found["reasons"] == ["on bodies, the air pushes the hull of B1, whose error the margins do not include"]


@pytest.mark.slow
def test_everything_else_is_about_the_team_while_the_filter_does_not_act() -> None:
    raw = escort()
    found = analyse(raw)
    without = analyse({key: value for key, value in raw.items() if key != "safety"})
    require(without, {"ok": True, "safety": None})
    assert without["steady"]["ideal"] is not None
    require(found, {"ok": True, "safety.guaranteed": True, "safety.unsafe": [], "law.rate": without["law"]["rate"]})
    require(found, {"steady.ideal": None, "law.radius": None, "theorem.applies": False})
    for part in ("steady", "law"):
        assert "filter" in found[part]["reason"]


@pytest.mark.long
def test_without_a_velocity_limit_the_margin_is_that_of_the_vehicles_top_speed() -> None:
    """An Otter makes 3.09 m/s, and its limit counts if it has one; a hull without limits has no margin."""
    raw = escort(range=15) | {"time": {"end": 1}}
    del raw["controller"]["velocity_limit"]
    raw["agents"][0] |= {"vehicle": "otter", "velocity_limit": 3.0}
    raw["agents"][1] |= {"vehicle": "otter"}
    system = load_scenario(raw).system
    limited, free, _ = system.safety_margins
    hand = system.vehicles[0].steering.hand
    assert (free - hand) / (limited - hand) == pytest.approx(3.0865 / 3.0, rel=1e-3)
    assert analyse(raw)["safety"]["without_margin"] == []
    raw["agents"][1] |= {"vehicle": "hull"}
    found = analyse(raw)["safety"]
    require(found, {"without_margin": ["B2"], "margins.B2": 0.0})


# -- where agents of a run on ideal kinematics come to rest, and by hand -----------------------------------------------


DRIFT = 1.0  # m/s


def in_flow(place: tuple[float, float], **changes: Any) -> dict[str, Any]:
    """One boat at a place about a target that is pulled to the origin, in a uniform flow along x."""
    usual = make_fields(
        {"A": list(place)},
        {"T": {"position": [0.0, 0.0], "motion": {"kind": "static", "pull": 20.0}}},
        [{"between": ["A", "T"], "offset": list(place)}],
        time={"end": 15.0},
        controller={"gain": 20.0, "control_period": 0.02, "velocity_limit": 20.0},
        flow={"water": {"dimension": 2, "drift": [DRIFT, 0.0]}},
        safety={"distance": 2.0, "rate": 1.0},
    )
    return usual | changes


def anchored(places: dict[str, list[float]]) -> dict[str, Any]:
    """Boats that hold their places in that flow."""
    anchors = [{"agent": id, "axes": ["x", "y"], "value": place} for id, place in places.items()]
    return in_flow((0.0, 0.0), targets=[], sensing=[], agents=list_members(places), anchors=anchors)


def behind() -> dict[str, Any]:
    """A boat that follows a target at 1 m/s in still water: the target might stop, as far as the filter knows."""
    path = {"kind": "recorded", "samples": [[0.0, 0.0, 0.0], [30.0, 30.0 * DRIFT, 0.0]]}
    raw = in_flow((-3.0, 0.0), targets=[{"id": "T", "position": [0.0, 0.0], "motion": path}])
    del raw["flow"]
    return raw


def by_a_pile() -> dict[str, Any]:
    """A boat that holds its place downstream of a pile."""
    raw = anchored({"A": [3.5, 0.0]})
    raw["safety"]["obstacles"] = [{"kind": "sphere", "id": "P", "centre": [0.0, 0.0], "radius": 0.5}]
    return raw


APART = anchored({"B": [0.0, 0.0], "A": [3.0, 0.0]})


def record_of(raw: dict[str, Any]) -> SafetyRecord:
    return known(examine(load_scenario(raw).phases).record.safety)


def final_distance(raw: dict[str, Any], other: str) -> float:
    run = simulate(load_scenario(raw), backend="ideal")
    last = {str(id): place[:2] for id, place in zip(run["agent"].values, run["agent_position"].values[-1], strict=True)}
    if "target" in run:
        last |= zip(map(str, run["target"].values), run["target_position"].values[-1, :, :2], strict=True)
    surface = 0.5 if other == "P" else 0.0
    return float(np.linalg.norm(last["A"] - last.get(other, np.zeros(2))) - surface)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("raw", "other", "s"),
    [
        (in_flow((3.0, 0.0)), "T", 2.0 * DRIFT),  # downstream it pushes towards the target
        (in_flow((0.0, 3.0)), "T", DRIFT),  # abeam it does not
        (behind(), "T", 2.0 * DRIFT),
        (APART, "B", 2.0 * DRIFT),  # half of the constraint is its own: |w| / (1/2)
        (by_a_pile(), "P", 2.0 * DRIFT),
    ],
)
def test_agents_stop_at_the_standoff_and_reach_their_places_at_the_rate_that_suffices(
    raw: dict[str, Any], other: str, s: float
) -> None:
    (found,) = lasting(record_of(raw).standoff)
    assert found.pair == ["A", other]
    assert found.desired == pytest.approx(3.0, abs=1e-3)
    assert found.kept == pytest.approx(s + np.hypot(s, 2.0), rel=0.01)
    assert found.rate == pytest.approx(2.0 * 3.0 * s / (9.0 - 4.0), rel=0.01)
    assert found.fraction == 1.0
    assert final_distance(raw, other) == pytest.approx(found.kept, rel=0.02)
    faster = raw | {"safety": raw["safety"] | {"rate": 1.02 * known(found.rate)}}
    assert record_of(faster).standoff == []
    assert final_distance(faster, other) == pytest.approx(3.0, abs=0.1)  # but for the law's own lag


@pytest.mark.slow
def test_upstream_nothing_is_out_of_reach() -> None:
    assert lasting(record_of(in_flow((-3.0, 0.0))).standoff) == []
    assert final_distance(in_flow((-3.0, 0.0)), "T") == pytest.approx(3.0, abs=0.1)


def test_no_rate_suffices_beyond_one_over_the_control_period() -> None:
    """At 0.5 s it is 2 1/s at most, and 2.4 1/s would be needed."""
    raw = in_flow((3.0, 0.0), controller={"gain": 1.0, "control_period": 0.5, "velocity_limit": 20.0})
    raw["targets"][0]["motion"]["pull"] = 1.0
    (found,) = lasting(record_of(raw).standoff)
    assert found.rate is None


@pytest.mark.long
def test_bodies_keep_more_and_what_is_unsafe_is_not_listed_again() -> None:
    raw = in_flow((3.0, 0.0))
    raw["agents"][0] |= {"vehicle": "otter", "velocity_limit": 3.0}
    found = record_of(raw)
    (on_bodies,) = lasting(found.standoff_on_bodies)
    assert on_bodies.rate is None  # the distance and its stopping distance are more than 3 m
    assert on_bodies.kept > found.standoff[0].kept + 1.0
    near = record_of(in_flow((1.5, 0.0)))
    assert [one.pair for one in near.unsafe] == [["A", "T"]]
    assert near.standoff == []
