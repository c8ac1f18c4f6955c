"""Coordinates that say what each agent, target and sample is: group, vehicle, kind, phase.

Oracle: the scenario's own fields.
"""

import json

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.scenario import Scenario, load_scenario
from tests.builders import RAFT, build_scenario

EVENTS = [{"time": 0.2, "lose": "D"}, {"time": 0.3, "set": {"controller.gain": 1.5}}]


def scenario() -> Scenario:
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
        events=EVENTS,
    )


@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_members_have_a_group_a_vehicle_and_a_kind_and_samples_a_phase(backend: str) -> None:
    found = simulate(scenario(), backend)
    assert found["group"].dims == found["vehicle"].dims == found["kind"].dims == ("agent",)
    assert found["group"].values.tolist() == ["pair", "pair", "dive", ""]
    assert found["vehicle"].values.tolist() == ["otter", "aerial", "submersible", "hull"]
    assert found["kind"].values.tolist() == ["surface", "aerial", "underwater", "surface"]
    assert found["target_group"].values.tolist() == ["pair", ""]
    assert found["target_vehicle"].values.tolist() == ["aerial", "hull"]
    assert found["target_kind"].values.tolist() == ["aerial", "surface"]
    assert found["group_formation_error"].sel(formation="pair").dims == found["phase"].dims == ("time",)
    expected = np.searchsorted([0.0, 0.2, 0.3], np.round(found["time"].values, 9), side="right") - 1
    np.testing.assert_array_equal(found["phase"].values, expected)
    attributes = found["phase"].attrs
    np.testing.assert_allclose(attributes["start_times"], [0.0, 0.2, 0.3])
    assert list(attributes["flag_values"]) == [0, 1, 2]
    first, second, _ = attributes["flag_meanings"].split()
    assert first == "start"
    assert "lose_D" in second
    assert [len(happened) for happened in json.loads(attributes["events"])][:2] == [0, 1]


def test_a_vehicle_of_ones_own_has_the_name_of_its_file() -> None:
    found = simulate(load_scenario("midpoint", {"vehicles.agents": str(RAFT), "time.end": 0.1}), "ideal")
    assert found["vehicle"].values.tolist() == ["raft"]
