"""What `check`, `run` and `list --vehicles` note about files; scenarios that ship have nothing to note."""

import json
from pathlib import Path

import pytest
import yaml

from mjsheaf import load_scenario
from mjsheaf.scenario import list_scenarios
from mjsheaf.scenario.slips import slips_of, slips_of_vehicle
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import altered, make_fields
from tests.commands import answer_of, call
from tests.running import analyse


@pytest.mark.slow
@pytest.mark.usefixtures("without_plots")
def test_check_run_and_list_note_a_lean_that_the_thrust_does_not_carry(tmp_path: Path) -> None:
    altered(tmp_path, "quadrotor", steering={"largest_tilt": 80})
    agent = {"position": [0, 0, 9], "vehicle": "quadrotor.yaml"}
    target = {"position": [9, 5, 9], "motion": {"kind": "fixed"}}
    fields = make_fields({"A0": agent}, {"T1": target}, [["A0", "T1"]], time={"end": 0.1})
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(fields))
    slips = analyse(path)["notes"]
    assert any("a lean of 80 degrees takes quadrotor" in slip for slip in slips)
    assert "note: " in answer_of("check", str(path), "--no-trial").out
    whole = " ".join(answer_of("check", str(path), "--no-trial", "--full").out.split())
    assert all(f"note: {slip}" in whole for slip in slips)
    assert slips_of_vehicle(load_vehicle("quadrotor")) == []
    listed = answer_of("list", "--vehicles", str(tmp_path / "quadrotor.yaml"))
    assert listed.code == 0
    assert "note: " in listed.out
    assert "a lean of 80 degrees takes quadrotor" in " ".join(listed.out.split())
    assert call("run", path, "--no-video", "--out", tmp_path / "out") == 0
    notes = json.loads((tmp_path / "out" / "summary.json").read_text())["notes"]
    assert [n for n in notes if n["kind"] == "slip" and "a lean of 80 degrees" in n["text"]]


def test_no_scenario_that_ships_has_slips() -> None:
    for name in list_scenarios():
        if name != "lost_thruster":  # refused as it is loaded
            assert slips_of(load_scenario(name)) == [], name
