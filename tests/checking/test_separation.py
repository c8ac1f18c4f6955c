"""Record of `check` about the safety filter."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mjsheaf import check, load_scenario, simulate
from tests.commands import answer_of


def escort(**safety: Any) -> dict[str, Any]:
    """Two boats next to a target that passes a pier; at its place in q* one of them meets the pier."""
    return {
        "name": "escort",
        "time": {"end": 40},
        "controller": {"gain": 0.5, "control_period": 0.05, "velocity_limit": 3},
        "agents": [{"id": "B1", "position": [-20, 5]}, {"id": "B2", "position": [-20, -5]}],
        "targets": [
            {"id": "T", "position": [-20, 0], "motion": {"kind": "waypoints", "points": [[20, 0]], "speed": 1.0}}
        ],
        "communication": [["B1", "B2"]],
        "sensing": [["B1", "T"], ["B2", "T"]],
        "formations": [
            {
                "name": "pair",
                "shape": "explicit",
                "about": "T",
                "members": ["B1", "B2"],
                "displacements": [[0, 5], [0, -5]],
            }
        ],
        "safety": {"distance": 2.0, **safety},
    }


PIER = {"kind": "sphere", "id": "pier", "centre": [0.0, 6.0], "radius": 0.5}


@pytest.mark.slow
def test_places_in_q_star_that_are_too_close_are_named_with_time_and_gap() -> None:
    found = check(load_scenario(escort(obstacles=[PIER])), trial=False)["safety"]
    (worst,) = found["unsafe"]
    assert worst["pair"] == ["B1", "pier"]
    assert worst["gap"] == pytest.approx(1.0 - 0.5 - 2.0, abs=1e-3)
    run = simulate(load_scenario(escort()), backend="ideal")
    q_star = run["harmonic_extension"].values[:, 0, :2]
    away = np.linalg.norm(q_star - [0.0, 6.0], axis=1)
    assert worst["time"] == pytest.approx(float(run["time"][away.argmin()]), abs=0.2)
    assert check(load_scenario(escort()), trial=False)["safety"]["unsafe"] == []


def test_pairs_that_begin_too_close_are_named() -> None:
    raw = escort()
    raw["agents"][0]["position"] = [-20, -4]
    assert check(load_scenario(raw), trial=False)["safety"]["initial"] == [
        {"pair": ["B1", "B2"], "time": 0.0, "gap": pytest.approx(-1.0), "fraction": 1.0}
    ]


@pytest.mark.slow
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
        (
            {"flow.water": {"dimension": 2, "core": 1, "vortices": [{"centre": [9, 9], "gamma": 20}]}},
            "towards B1",
        ),
        (
            {"flow.water": {"dimension": 2, "gusts": None, "core": 0, "vortices": [{"centre": [9, 9], "gamma": 1}]}},
            "core",
        ),
    ],
)
def test_what_the_theorem_requires_is_decided(change: dict[str, Any], told: str) -> None:
    found = check(load_scenario(escort(), change), trial=False)["safety"]
    assert not found["guaranteed"]
    assert any(told in reason for reason in found["reasons"])


@pytest.mark.slow
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
        return check(load_scenario(raw | {"flow": flow}), trial=False)["safety"]

    wind = {"air": {"dimension": 2, **air}}
    assert of("otter", {})["guaranteed"]
    assert of("hull", wind)["guaranteed"]
    found = of("otter", wind)
    assert not found["guaranteed"]
    assert found["reasons"] == ["on bodies, the air pushes the hull of B1, whose error the margins do not include"]


def test_everything_else_is_about_the_team_while_the_filter_does_not_act() -> None:
    raw = escort()
    found = check(load_scenario(raw), trial=False)
    without = check(load_scenario({key: value for key, value in raw.items() if key != "safety"}), trial=False)
    assert found["safety"]["guaranteed"]
    assert found["ok"]
    assert without["ok"]
    assert found["law"]["rate"] == without["law"]["rate"]
    assert without["steady"]["ideal"] is not None
    for unknown in (found["steady"]["ideal"], found["law"]["radius"]):
        assert unknown is None
    assert "filter" in found["steady"]["reason"]
    assert "filter" in found["law"]["reason"]
    assert not found["theorem"]["applies"]
    assert without["safety"] is None


@pytest.mark.slow
def test_without_a_velocity_limit_the_margin_is_that_of_the_vehicles_top_speed() -> None:
    """An Otter makes 3.09 m/s, and its limit counts if it has one; a hull without limits has no margin."""
    raw = escort(range=15)
    del raw["controller"]["velocity_limit"]
    raw["agents"][0] |= {"vehicle": "otter", "velocity_limit": 3.0}
    raw["agents"][1] |= {"vehicle": "otter"}
    system = load_scenario(raw).system
    limited, free, _ = system.safety_margins
    hand = system.vehicles[0].steering.hand
    assert (free - hand) / (limited - hand) == pytest.approx(3.0865 / 3.0, rel=1e-3)
    assert check(load_scenario(raw), trial=False)["safety"]["without_margin"] == []
    raw["agents"][1] |= {"vehicle": "hull"}
    found = check(load_scenario(raw), trial=False)["safety"]
    assert found["without_margin"] == ["B2"]
    assert found["margins"]["B2"] == 0.0
