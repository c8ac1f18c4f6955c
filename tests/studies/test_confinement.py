"""Files named in a study stay inside its directory and are found from anywhere; a user may name any file.

Oracle: the contract; a raft inside the study's directory, and one outside.
"""

import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from mjsheaf.errors import ScenarioError
from mjsheaf.studies.plan import load_plan
from tests.builders import DATA, ONE_BOAT


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A directory with a team and a raft in boats/; a team and a raft outside."""
    for folder in (tmp_path / "inside" / "boats", tmp_path / "outside"):
        folder.mkdir(parents=True)
        for suffix in (".yaml", ".xml"):
            shutil.copy(DATA / f"raft{suffix}", folder)
    for folder in (tmp_path / "inside", tmp_path / "outside"):
        (folder / "team.yaml").write_text(yaml.safe_dump(ONE_BOAT))
    return tmp_path / "inside"


def write(place: Path, **fields: Any) -> str:
    path = place / "study.yaml"
    path.write_text(yaml.safe_dump({"scenario": "team.yaml", "backend": "ideal", **fields}))
    return str(path)


def vehicles(source: str, **given: Any) -> list[str]:
    """The vehicle of A1 in each run."""
    plan = load_plan(source, **given)
    found = [plan.job(point).load() for point in plan.points]
    return [str(scenario.agents[0].vehicle or scenario.vehicles.agents) for scenario in found]


@pytest.mark.parametrize("scenario", ["../outside/team.yaml", "link.yaml", "/etc/passwd", "~/../../team.yaml"])
def test_a_scenario_outside_is_refused(place: Path, scenario: str) -> None:
    (place / "link.yaml").symlink_to(place.parent / "outside" / "team.yaml")
    with pytest.raises(ScenarioError, match=r"study.yaml: scenario: .* lies outside .*; expected a file in that dir"):
        load_plan(write(place, scenario=scenario))


OUTSIDE = "../outside/raft.yaml"


@pytest.mark.parametrize(
    ("fields", "where"),
    [
        ("set: {vehicles.agents: %s}", "vehicles.agents"),
        ("set: {vehicles: {targets: %s}}", "vehicles.targets"),
        ("grid: {agents.A1.vehicle: [hull, %s]}", "agents.A1.vehicle"),
        ("paired: {agents: [[{id: A1, position: [0, 0], vehicle: %s}]]}", "agents.0.vehicle"),
        ("points: [{targets.T1: {id: T1, position: [0, 0], vehicle: %s}}]", "targets.T1.vehicle"),
        ("draws: {count: 1, values: {swarm.vehicle: {kind: choice, values: [%s]}}}", "swarm.vehicle"),
    ],
)
def test_a_vehicle_outside_is_refused(place: Path, fields: str, where: str) -> None:
    with pytest.raises(ScenarioError, match=rf"study.yaml: {where}: '{OUTSIDE}' lies outside"):
        load_plan(write(place, **yaml.safe_load(fields % OUTSIDE)))


def test_vehicles_inside_are_found_from_anywhere(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raft = str(place / "boats" / "raft.yaml")
    source = write(place, grid={"vehicles.agents": ["hull", "boats/raft.yaml"]})
    for folder in (place, place.parent):
        monkeypatch.chdir(folder)
        assert vehicles(source) == ["hull", raft]
    plan = load_plan(source)
    assert set(plan.files) == {raft, raft.replace(".yaml", ".xml")}
    assert [point.parameters["vehicles.agents"] for point in plan.points] == ["hull", "boats/raft.yaml"]
    (place / "boats" / "raft.yaml").write_text((DATA / "raft.yaml").read_text() + "\n")
    assert load_plan(source).files[raft] != plan.files[raft]


def test_a_person_may_name_any_vehicle(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outside = str(place.parent / "outside" / "raft.yaml")
    monkeypatch.chdir(place.parent / "outside")
    assert vehicles(write(place), overrides={"vehicles.agents": "raft.yaml"}) == [outside]
    assert vehicles(write(place), grid={"agents.A1.vehicle": ["raft.yaml", "hull"]}) == [outside, "hull"]


def test_a_vehicle_that_is_missing_is_told_of_before_anything_begins(place: Path) -> None:
    with pytest.raises(ScenarioError, match=r"none\.yaml: cannot be read: No such file"):
        load_plan(write(place, grid={"vehicles.agents": ["hull", "none.yaml"]}))
