"""An event changes nothing before its time: up to it, the run is the run without it, to the bit."""

from typing import Any

import numpy as np
import pytest

from mjsheaf import load_scenario, simulate

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


def scenario(law: dict[str, Any], events: list[dict[str, Any]]) -> Any:
    """Return four boats in a ring that follow a moving target."""
    places = [[0, 0], [9, 2], [3, 8], [-5, 4]]
    fields: dict[str, Any] = {
        "seed": 3,
        "time": {"end": 0.5},
        "agents": [{"id": f"A{k}", "position": place} for k, place in enumerate(places)],
        "targets": [{"id": "T", "position": [1, 1], "motion": SWING}],
        "communication": [["A0", "A1"], ["A1", "A2"], ["A2", "A3"], ["A3", "A0"], ["A1", "A3"]],
        "sensing": [["A0", "T"], ["A3", "T"]],
        "flow": {"agents": {"dimension": 2, "drift": [0.2, 0.1]}},
        **law,
        "events": [{"time": HAPPENS, **event} for event in events],
    }
    fields["controller"] = {"gain": 0.5, "control_period": 0.02, **law.get("controller", {})}
    return load_scenario(fields)


def require_same_past(law: str, backend: str, engine: str) -> None:
    options: dict[str, Any] = {"engine": engine, "threads": 1, "allow_drift": True, "progress": False}
    without = simulate(scenario(LAWS[law], []), backend, **options)
    past = without.time.values <= HAPPENS + 1e-9
    for event in EVENTS:
        if law == "ranges" and "lose" in event:  # rounds about a curved team need all of its agents
            continue
        found = simulate(scenario(LAWS[law], [event]), backend, **options)
        for name in ("agent_position", "target_position"):
            np.testing.assert_array_equal(found[name].values[past], without[name].values[past], err_msg=str(event))
        before = without.time.values < HAPPENS - 1e-9
        for name in ("velocity_command", "disagreement", "harmonic_extension"):
            np.testing.assert_array_equal(found[name].values[before], without[name].values[before], err_msg=str(event))
        assert not np.array_equal(found.velocity_command.values, without.velocity_command.values, equal_nan=True)


@pytest.mark.parametrize("law", ["extrapolated", "newton"])
def test_an_event_changes_nothing_before_its_time(law: str) -> None:
    require_same_past(law, "ideal", "mujoco")


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("backend", "engine"), ENGINES)
def test_no_event_changes_the_past_of_any_law(law: str, backend: str, engine: str) -> None:
    require_same_past(law, backend, engine)
