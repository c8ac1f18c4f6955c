"""Coordinates that say what each agent, target and sample is: group, vehicle, kind, phase.

Oracle: the scenario's own fields.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.scenario import Scenario, load_scenario
from tests.builders import REPOSITORY, build_scenario

BACKENDS = ("ideal", "physics")
EVENTS = [{"time": 0.2, "lose": "D"}, {"time": 0.3, "set": {"controller.gain": 1.5}}]


def scenario(**fields: Any) -> Scenario:
    """A boat, a drone, a submersible and an ungrouped boat."""
    boat, submersible = {"position": [0, 0], "vehicle": "otter"}, {"position": [3, 3, -2], "vehicle": "submersible"}
    return build_scenario(
        {"B": boat, "D": [3, 0, 2], "S": submersible, "F": [9, 0]},
        {"T": [5, 1, 2], "U": [5, 9]},
        [["B", "T"], ["D", "T"], ["S", "T"], ["F", "U"]],
        communication=[["B", "D"], ["D", "S"], ["S", "F"]],
        formations=[
            {"name": "pair", "members": ["B", "D"], "about": "T", "shape": "line", "spacing": 2},
            {"name": "dive", "shape": "explicit", "members": ["S"], "displacements": [[0, 0, -1]]},
        ],
        time={"end": 0.5},
        scene={"surface": "water"},
        **fields,
    )


@pytest.mark.parametrize("backend", BACKENDS)
def test_members_have_a_group_a_vehicle_and_a_kind(backend: str) -> None:
    found = simulate(scenario(), backend)
    assert found["group"].dims == found["vehicle"].dims == found["kind"].dims == ("agent",)
    assert found["group"].values.tolist() == ["pair", "pair", "dive", ""]
    assert found["vehicle"].values.tolist() == ["otter", "aerial", "submersible", "hull"]
    assert found["kind"].values.tolist() == ["surface", "aerial", "underwater", "surface"]
    assert found["target_group"].values.tolist() == ["pair", ""]
    assert found["target_vehicle"].values.tolist() == ["aerial", "hull"]
    assert found["target_kind"].values.tolist() == ["aerial", "surface"]
    assert found["group_formation_error"].sel(formation="pair").dims == ("time",)


@pytest.mark.parametrize("name", ["group", "vehicle", "kind"])
def test_errors_are_grouped_by_a_name(name: str) -> None:
    found = simulate(scenario(), "ideal")
    means = found["tracking_error"].groupby(name).mean()
    assert set(means[name].values.tolist()) == set(found[name].values.tolist())
    for label in means[name].values:
        own = found["tracking_error"].values[:, found[name].values == label]
        np.testing.assert_allclose(means.sel({name: label}).values, own.mean(axis=1), rtol=1e-14)
    assert found.groupby(name).mean()["agent_position"].sizes[name] == len(means[name])
    targets = found["target_position"].groupby(f"target_{name}").mean()
    assert targets.sizes[f"target_{name}"] == len(set(found[f"target_{name}"].values.tolist()))


def test_a_vehicle_of_ones_own_has_the_name_of_its_file(tmp_path: Path) -> None:
    for suffix in ("yaml", "xml"):
        text = (REPOSITORY / "models" / f"otter.{suffix}").read_text()
        (tmp_path / f"my_boat.{suffix}").write_text(text.replace("otter.xml", "my_boat.xml"))
    own = {"vehicles": {"agents": str(tmp_path / "my_boat.yaml")}}
    fields = {**load_scenario("midpoint").model_dump(mode="json", exclude_none=True), **own}
    planar = [agent for agent in fields["agents"] if len(agent["position"]) == 2]
    assert planar
    found = load_scenario(fields | {"time": {"end": 0.1}})
    names = simulate(found, "ideal")["vehicle"].values.tolist()
    assert set(names) == {"my_boat"}


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_sample_has_its_phase(backend: str) -> None:
    plain, eventful = simulate(scenario(), backend), simulate(scenario(events=EVENTS), backend)
    assert "phase" in plain.coords
    assert plain["phase"].dims == ("time",)
    assert set(plain["phase"].values.tolist()) == {0}
    starts = [0.0, 0.2, 0.3]
    times = np.round(eventful["time"].values, 9)
    expected = np.searchsorted(starts, times, side="right") - 1
    np.testing.assert_array_equal(eventful["phase"].values, expected)
    attributes = eventful["phase"].attrs
    np.testing.assert_allclose(attributes["start_times"], starts)
    assert list(attributes["flag_values"]) == [0, 1, 2]
    meanings = attributes["flag_meanings"].split()
    assert len(meanings) == 3
    assert meanings[0] == "start"
    assert "lose_D" in meanings[1]
    assert json.loads(attributes["events"])[0] == []
    assert len(json.loads(attributes["events"])[1]) == 1
    by_phase = eventful["tracking_error"].groupby("phase").mean()
    assert by_phase["phase"].values.tolist() == [0, 1, 2]
