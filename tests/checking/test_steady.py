"""The predicted steady tracking error against simulation."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import mjsheaf
from tests.builders import list_members, make_fields, make_scenario
from tests.commands import Answer
from tests.running import analyse


def measured(scenario: Any, backend: str) -> float:
    """Return the RMS over agents and samples of the tracking error in the second half of a run, m."""
    error = mjsheaf.simulate(scenario, backend=backend)["tracking_error"].values
    return float(np.sqrt(np.nanmean(error[len(error) // 2 :] ** 2)))


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(
    "controller",
    [
        {"controller.feedforward.rounds": 1, "controller.newton.rounds": 1, "controller.drift.filter": 0.1},
        {"flow.water": {"dimension": 2, "drift": [0.2, 0.0], "tide": {"amplitude": 0.5, "minor": 0.2, "period": 7.0}}},
        {"flow.water": {"dimension": 2, "waves": {"kind": "jonswap", "significant_height": 0.3, "peak_period": 5.0}}},
    ],
    ids=["terms", "tide", "waves"],
)
def test_ideal_kinematics_make_what_is_predicted(controller: dict[str, Any]) -> None:
    scenario = mjsheaf.load_scenario("midpoint", controller)
    steady = analyse(scenario)["steady"]
    assert steady["norm"] == "per_agent_rms"
    assert steady["exact_links"]
    assert steady["ideal"] == pytest.approx(measured(scenario, "ideal"), rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["harbour", "quads", "quads_feedforward", "paper", "paper_feedforward", "double_gyre", "open_sea"]
)
def test_shipped_scenarios_make_what_is_predicted(name: str) -> None:
    scenario = mjsheaf.load_scenario(name)
    steady = analyse(scenario)["steady"]
    assert steady["ideal"] == pytest.approx(measured(scenario, "ideal"), rel=0.02)
    assert steady["bodies"] == pytest.approx(measured(scenario, "physics"), rel=0.15)


def slow(**fields: Any) -> Any:
    """Return two agents far from their places about a target that swings, with a loop of 10 s and a run of 30 s."""
    law = {"gain": 0.1, "control_period": 0.05} | fields.pop("controller", {})
    swings = {"kind": "lissajous", "amplitude": [1, 2], "rate": [0.3, 0.2]}
    usual = make_fields(
        {"A": [-12, 4], "B": [3, -20]},
        {"T": {"position": [0, 0], "motion": swings}},
        [["A", "T"], {"between": ["B", "T"], "offset": [2, 0]}],
        communication=[["A", "B"]],
        time={"end": 30.0},
        controller=law,
        physics={"timestep": 0.05, "contacts": False},
    )
    return make_scenario(usual | fields)


def test_what_is_left_of_the_initial_error_is_in_the_prediction() -> None:
    """A lone agent's error is (1 - k h)^n times its 10 m."""
    members = {"agents": list_members({"A": [0, 0]}), "targets": list_members({"T": [10, 0]})}
    scenario = slow(**members, communication=[], sensing=[["A", "T"]])
    steady = analyse(scenario)["steady"]
    error = 10.0 * (1.0 - 0.1 * 0.05) ** np.arange(601)
    assert steady["ideal"] == pytest.approx(np.sqrt(np.mean(error[300:] ** 2)), rel=1e-9)
    run = mjsheaf.simulate(scenario, "ideal")
    np.testing.assert_allclose(run["tracking_error"].values[:, 0], error, rtol=1e-9)
    assert steady["leaves_out"] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"controller": {"velocity_limit": 0.5}},
        {"controller": {"newton": {"rounds": 2}}},
        {"controller": {"feedforward": {"rounds": 3}}},
        {"controller": {"feedforward": {"rounds": 2, "filter": 0.1}}},
        {"controller": {"integral": {"gain": 0.002}}},
        {"controller": {"drift": {"filter": 0.05}}, "flow": {"water": {"dimension": 2, "drift": [0.4, -0.2]}}},
        {"communication": [], "sensing": [["A", "T"], {"between": ["B", "T"], "offset": [2, 0], "weight": 0.3}]},
    ],
    ids=["paper", "limit", "newton", "feedforward", "filtered", "integral", "drift", "weights"],
)
def test_a_run_that_has_not_settled_makes_what_is_predicted(fields: dict[str, Any]) -> None:
    scenario = slow(**fields)
    steady = analyse(scenario)["steady"]
    assert steady["ideal"] == pytest.approx(measured(scenario, "ideal"), rel=5e-3)
    assert steady["ideal"] > 0.5
    assert steady["leaves_out"] == []
    if not fields:
        assert steady["bodies"] == pytest.approx(measured(scenario, "physics"), rel=0.03)


@pytest.mark.long
def test_what_boats_far_from_their_places_do_is_left_out_and_named() -> None:
    """Otters turn towards their places first, so that they arrive later than linear ones."""
    scenario = slow(vehicles={"agents": "otter"})
    steady = analyse(scenario)["steady"]
    assert steady["leaves_out"] == ["thrust limits", "turns of boats that hold no heading"]
    assert steady["bodies"] < measured(scenario, "physics")
    near = mjsheaf.load_scenario("otters")
    assert analyse(near)["steady"]["leaves_out"] == []


@pytest.mark.slow
def test_limits_of_speed_are_named() -> None:
    limited = analyse("midpoint", {"controller.velocity_limit": 0.5})["steady"]
    assert limited["limited"] == ["A1"]
    assert analyse("midpoint", {"controller.velocity_limit": 50.0})["steady"]["limited"] == []


def test_what_is_not_known_has_a_reason(checked: Callable[[str], Answer]) -> None:
    steady = json.loads(checked("air_tracks_surface").out)["steady"]
    assert steady["ideal"] is None
    assert "unique" in steady["reason"]
    noisy = analyse("midpoint", {"links.all.noise": 0.1})["steady"]
    assert not noisy["exact_links"]
    assert noisy["ideal"] > 0.0
    assert noisy["leaves_out"] == ["noise, delays and losses of links"]
