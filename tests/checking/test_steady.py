"""The predicted steady tracking error against simulation."""

from typing import Any

import numpy as np
import pytest

import mjsheaf


def measured(scenario: Any, backend: str) -> float:
    """Return the RMS over agents and samples of the tracking error in the second half of a run, m."""
    error = mjsheaf.simulate(scenario, backend=backend)["tracking_error"].values
    return float(np.sqrt(np.nanmean(error[len(error) // 2 :] ** 2)))


@pytest.mark.parametrize(
    "controller",
    [
        {},
        {"controller.feedforward.rounds": 3},
        {"controller.newton.rounds": 3},
        {"controller.drift.filter": 0.1, "flow.water": {"dimension": 2, "drift": [0.4, -0.2]}},
        {"controller.feedforward.rounds": 1, "controller.newton.rounds": 1, "controller.drift.filter": 0.1},
        {"flow.water": {"dimension": 2, "drift": [0.2, 0.0], "tide": {"amplitude": 0.5, "minor": 0.2, "period": 7.0}}},
        {"flow.water": {"dimension": 2, "waves": {"kind": "jonswap", "significant_height": 0.3, "peak_period": 5.0}}},
    ],
    ids=["paper", "feedforward", "newton", "drift", "all", "tide", "waves"],
)
def test_ideal_kinematics_make_what_is_predicted(controller: dict[str, Any]) -> None:
    scenario = mjsheaf.load_scenario("midpoint", controller)
    steady = mjsheaf.check(scenario)["steady"]
    assert steady["norm"] == "per_agent_rms"
    assert steady["exact_links"]
    assert steady["ideal"] == pytest.approx(measured(scenario, "ideal"), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["harbour", "quads", "quads_feedforward", "paper", "paper_feedforward", "double_gyre", "open_sea"]
)
def test_shipped_scenarios_make_what_is_predicted(name: str) -> None:
    scenario = mjsheaf.load_scenario(name)
    steady = mjsheaf.check(scenario)["steady"]
    assert steady["ideal"] == pytest.approx(measured(scenario, "ideal"), rel=0.02)
    assert steady["bodies"] == pytest.approx(measured(scenario, "physics"), rel=0.15)


def test_limits_of_speed_are_named() -> None:
    limited = mjsheaf.check(mjsheaf.load_scenario("midpoint", {"controller.velocity_limit": 0.5}))["steady"]
    assert limited["limited"] == ["A1"]
    assert (
        mjsheaf.check(mjsheaf.load_scenario("midpoint", {"controller.velocity_limit": 50.0}))["steady"]["limited"] == []
    )


def test_what_is_not_known_has_a_reason() -> None:
    steady = mjsheaf.check(mjsheaf.load_scenario("air_tracks_surface"))["steady"]
    assert steady["ideal"] is None
    assert "unique" in steady["reason"]
    noisy = mjsheaf.check(mjsheaf.load_scenario("midpoint", {"links.all.noise": 0.1}))["steady"]
    assert not noisy["exact_links"]
    assert noisy["ideal"] > 0.0
