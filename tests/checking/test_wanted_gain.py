"""The gain for a desired radius.

Oracle: `check` at the named gain, and runs there.
"""

from typing import Any

import pytest

import mjsheaf
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, pursuit
from tests.commands import Capture, call
from tests.running import analyse, team_error


def between_jets(gain: float, **fields: Any) -> Scenario:
    """A boat that stays between two narrow jets, which a wider region holds."""
    jets = [{"centre": [0, y], "direction": [1, 0], "beta": 100, "width": 0.03, "length": 1000} for y in (0.2, -0.2)]
    law = {"gain": gain, "control_period": 0, "record_period": 0.05}
    sway = {"bound": 0.5, "frequencies": [0.01, 0.011], "components": 1}
    usual: dict[str, Any] = {
        "seed": 1,
        "time": {"end": 100},
        "controller": law,
        "disturbance": {"agents": sway, "targets": {"bound": 0}},
        "flow": {"agents": {"dimension": 2, "channels": jets}},
    }
    return pursuit([0, 0], [0, 0], **usual | fields)


def beside_a_jet(gain: float) -> Scenario:
    """A boat whose target passes a jet: at a small gain the region reaches into it."""
    motion = {"kind": "lissajous", "amplitude": [1, 0], "rate": [0.4, 0], "phase": [0, 0]}
    jet = {"centre": [0, 0.5], "direction": [1, 0], "beta": 3, "width": 0.08, "length": 1000}
    law = {"gain": gain, "control_period": 0, "record_period": 0.01}
    flow = {"agents": {"dimension": 2, "channels": [jet]}}
    target = {"position": [0, 0], "motion": motion}
    return build_scenario({"A": [0, 0]}, {"T": target}, [["A", "T"]], time={"end": 20}, controller=law, flow=flow)


def largest_error(scenario: Scenario) -> float:
    """Largest |e| of a run on ideal kinematics, m."""
    return float(team_error(mjsheaf.simulate(scenario, backend="ideal")).max())


@pytest.mark.long
@pytest.mark.parametrize("radius", [1.0, 0.03])
def test_at_the_named_gain_the_radius_is_certified_and_kept(radius: float) -> None:
    """The finding: 1.0003 1/s was named for 1 m, and the run there ended 79 m away."""
    gain = analyse(between_jets(50.0), radius=radius)["theorem"]["gain_for_wanted_radius"]
    there = analyse(between_jets(gain), radius=radius)["theorem"]
    assert there["applies"]
    assert there["radius_U"] <= radius
    assert largest_error(between_jets(gain)) <= radius
    assert there["gain_for_wanted_radius"] <= gain * (1.0 + 1e-9)


@pytest.mark.slow
def test_the_gain_that_was_named_does_not_do_it() -> None:
    """Its run leaves the channel, so no smaller bound than the search's own would be honest."""
    theorem = analyse(between_jets(1.0003))["theorem"]
    assert not theorem["applies"]
    assert largest_error(between_jets(1.0003, time={"end": 20})) > 1.0
    assert theorem["gain_for_wanted_radius"] == pytest.approx(15.65, rel=0.02)


@pytest.mark.long
def test_no_gain_is_said_to_be_needed_where_a_smaller_one_does_it(capsys: Capture) -> None:
    """The finding: "that takes a gain above 45.49 1/s", where the theorem applies at 5 1/s."""
    theorem = analyse(beside_a_jet(2.0))["theorem"]
    assert not theorem["applies"]
    assert "does not exceed rho" in theorem["reason"]
    assert "takes a gain" not in theorem["reason"]
    assert analyse(beside_a_jet(5.0))["theorem"]["applies"]
    gain = theorem["gain_for_wanted_radius"]
    assert gain < 5.0
    there = analyse(beside_a_jet(gain))["theorem"]
    assert there["applies"]
    assert there["radius_U"] <= 1.0
    assert largest_error(beside_a_jet(gain)) <= 1.0
    lower = analyse(beside_a_jet(0.97 * gain))["theorem"]
    assert not lower["applies"] or lower["radius_U"] > 1.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("paper", {}, "the held law diverges"),
        ("quads", {"time.end": 5}, "the held law rings"),
        ("certified", {"links.all.noise": 0.1, "controller.control_period": 0.01}, "links are not exact"),
        ("split_team", {}, "assumption 5 fails"),
        ("air_tracks_surface", {}, "assumption 6 fails"),
    ],
)
def test_without_such_a_gain_the_reason_is_said(name: str, changes: dict[str, Any], words: str) -> None:
    theorem = analyse(name, changes)["theorem"]
    assert theorem["gain_for_wanted_radius"] is None
    assert words in theorem["gain_for_wanted_radius_reason"]


def test_a_bound_of_ones_own_is_certified_too() -> None:
    scenario = mjsheaf.load_scenario("certified")
    theorem = analyse(scenario, rho=[0.5, 0.01], radius=0.5)["theorem"]
    gain = theorem["gain_for_wanted_radius"]
    changed = mjsheaf.load_scenario("certified", {"controller.gain": gain})
    there = analyse(changed, rho=[0.5, 0.01], radius=0.5)["theorem"]
    assert there["applies"]
    assert there["radius_U"] <= 0.5


def test_the_terminal_says_it(capsys: Capture) -> None:
    assert call("check", "certified", "--no-trial", "--full", "--radius", "0.4") == 0
    assert "gain_for_wanted_radius  " in capsys.readouterr().out


def test_where_nothing_moves_the_gain_of_the_scenario_does_it() -> None:
    raw = mjsheaf.load_scenario("midpoint").model_dump(mode="json", exclude_none=True)
    for target in raw["targets"]:
        target["motion"] = {"kind": "fixed"}
    theorem = analyse(raw)["theorem"]
    assert theorem["radius_U"] == 0.0
    assert theorem["gain_for_wanted_radius"] == pytest.approx(raw["controller"]["gain"], rel=1e-6)
