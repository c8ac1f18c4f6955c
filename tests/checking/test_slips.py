"""Angles that look like radians are noted, by `check`, by `run`, and where a vehicle is listed; others are not."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mjsheaf import check, load_scenario
from mjsheaf.checking.slips import slips_of, slips_of_vehicle
from mjsheaf.scenario import list_scenarios
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import REPOSITORY
from tests.commands import answer_of, call


def team(*headings: float, target: float = 0.0) -> dict[str, Any]:
    agents = [{"id": f"A{k}", "position": [9 * k, 0], "heading": heading} for k, heading in enumerate(headings)]
    return {
        "time": {"end": 0.1},
        "agents": agents,
        "targets": [{"id": "T1", "position": [9, 5], "heading": target}],
        "communication": [[a["id"], b["id"]] for a, b in pairwise(agents)],
        "sensing": [["A0", "T1"]],
    }


@pytest.mark.parametrize("headings", [(1.57,), (1.5708, 90.0), (0.0, -0.7854), (3.14, 22.5), (6.2832,)])
def test_headings_in_radians_are_noted(headings: tuple[float, ...]) -> None:
    (slip,) = slips_of(load_scenario(team(*headings)))
    number, small = next((k, x) for k, x in enumerate(headings) if abs(x) < 6.3 and x % 1.0)
    assert f"A{number}" in slip
    assert f"{np.rad2deg(small):.4g} degrees" in slip


@pytest.mark.parametrize("headings", [(90.0, 3.0), (0.0,), (-45.0, 360.0), (22.5, 67.5, 1.5)])
def test_headings_in_degrees_are_not(headings: tuple[float, ...]) -> None:
    assert slips_of(load_scenario(team(*headings))) == []


def test_headings_of_targets_are_looked_at_too() -> None:
    assert "T1" in slips_of(load_scenario(team(90.0, target=1.57)))[0]


def test_a_circle_of_headings_is_in_degrees_or_in_radians() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    assert slips_of(load_scenario(team(*np.rad2deg(turn).round(3)))) == []
    assert slips_of(load_scenario(team(*turn.round(3))))


@pytest.fixture
def stiff(tmp_path: Path) -> Path:
    """A quadrotor whose largest tilt was meant in radians, in a scenario."""
    models = REPOSITORY / "models"
    (tmp_path / "stiff.xml").write_text((models / "quadrotor.xml").read_text())
    description = yaml.safe_load((models / "quadrotor.yaml").read_text())
    description |= {"mjcf": "stiff.xml", "steering": {"largest_tilt": 0.5}}
    (tmp_path / "stiff.yaml").write_text(yaml.safe_dump(description))
    fields = team(90.0) | {"agents": [{"id": "A0", "position": [0, 0, 9], "vehicle": "stiff.yaml"}]}
    fields["targets"][0]["position"] = [9, 5, 9]
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(fields))
    return tmp_path


def test_check_notes_a_small_tilt(stiff: Path) -> None:
    path = stiff / "mine.yaml"
    (slip,) = check(load_scenario(path), trial=False)["notes"]
    assert "largest_tilt" in slip
    assert "28.6 degrees" in slip
    shown = " ".join(answer_of("check", str(path), "--no-trial").out.split())
    assert f"note: {slip}" in shown
    assert slips_of_vehicle(load_vehicle("quadrotor")) == []


@pytest.mark.slow
def test_a_run_and_a_list_note_it_too(stiff: Path) -> None:
    listed = answer_of("list", "--vehicles", str(stiff / "stiff.yaml"))
    assert listed.code == 0
    assert "note: steering.largest_tilt of stiff" in " ".join(listed.out.split())
    assert call("run", stiff / "mine.yaml", "--no-video", "--out", stiff / "out") == 0
    notes = json.loads((stiff / "out" / "summary.json").read_text())["notes"]
    assert [n for n in notes if n["kind"] == "slip" and "largest_tilt" in n["text"]]


def test_no_scenario_that_ships_has_slips() -> None:
    for name in list_scenarios():
        if name != "lost_thruster":  # refused as it is loaded
            assert slips_of(load_scenario(name)) == [], name
