"""Small scenarios for the tests of the comparison."""

from typing import Any

import pytest

from mjsheaf.scenario import Scenario, scenario_from_mapping


def pair(agents: str, targets: str, /, **fields: Any) -> Scenario:
    """Two boats in a line behind a third that moves; fields replace fields."""
    return scenario_from_mapping(
        {
            "name": "pair",
            "time": {"end": 3.0},
            "controller": {"gain": 1.0, "control_period": 0.02},
            "agents": [{"id": "A1", "position": [-4, 1], "heading": 20}, {"id": "A2", "position": [-3, -2]}],
            "targets": [
                {
                    "id": "T1",
                    "position": [0, 0],
                    "motion": {"kind": "lissajous", "amplitude": [2, 2], "rate": [0.3, 0.3], "phase": [1.57, 0]},
                }
            ],
            "communication": [["A1", "A2"]],
            "sensing": [["A1", "T1"], ["A2", "T1"]],
            "formations": [{"name": "line", "shape": "line", "members": ["A1", "A2"], "about": "T1", "spacing": 3}],
            "vehicles": {"agents": agents, "targets": targets},
            "physics": {"timestep": 0.005},
            **fields,
        }
    )


def swarm(vehicle: str, /, **fields: Any) -> Scenario:
    """Two aircraft about a third that moves; fields replace fields."""
    return scenario_from_mapping(
        {
            "name": "swarm",
            "time": {"end": 3.0},
            "controller": {"gain": 1.0, "control_period": 0.02},
            "agents": [{"id": "A1", "position": [-4, 1, 5]}, {"id": "A2", "position": [-3, -2, 6]}],
            "targets": [
                {
                    "id": "T1",
                    "position": [0, 0, 5],
                    "motion": {
                        "kind": "lissajous",
                        "amplitude": [2, 2, 0.5],
                        "rate": [0.3, 0.3, 0.3],
                        "phase": [1.57, 0, 0],
                    },
                }
            ],
            "communication": [["A1", "A2"]],
            "sensing": [["A1", "T1"], ["A2", "T1"]],
            "formations": [{"name": "line", "shape": "line", "members": ["A1", "A2"], "about": "T1", "spacing": 3}],
            "vehicles": {"agents": vehicle, "targets": "aerial"},
            "physics": {"timestep": 0.002},
            **fields,
        }
    )


def approx(value: float | None, rel: float | None = None, abs: float | None = None) -> Any:
    """As pytest's, of what must be there."""
    assert value is not None
    return pytest.approx(value, rel=rel, abs=abs)
