"""What the analysis leaves to the trial. Oracles: a run, and long series of gusts and waves."""

from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, known, pursuit
from tests.running import analyse

STILL = {"kind": "static", "pull": 1.0}
CIRCLE = {"kind": "lissajous", "amplitude": [2.26, 2.26], "rate": [1.3, 1.3], "phase": [1.57, 0.0]}


def hunt(vehicle: str = "hull", motion: Any = STILL, place: tuple[float, ...] = (0.0, 0.0), **fields: Any) -> Scenario:
    """An agent A at the place of its target, 10 m off."""
    agent = {"position": [place[0] - 10.0, *place[1:]], "vehicle": vehicle}
    target = {"position": list(place), "vehicle": "hull" if len(place) == 2 else "aerial", "motion": motion}
    return build_scenario({"A": agent}, {"T": target}, [["A", "T"]], **{"time": {"end": 40.0}} | fields)


def exchange(tie_break: str, *obstacles: dict[str, Any], x: float = 9.0) -> Scenario:
    """Two agents on one line that change places, below their targets."""
    agents = {name: {"position": [x, 0.0], "vehicle": "hull"} for name, x in [("A", 1.0 - x), ("B", x - 1.0)]}
    targets = {name: {"position": [x, 0.0, 30.0], "motion": STILL} for name, x in [("T", x), ("U", -x)]}
    return build_scenario(
        agents,
        targets,
        [["A", "T"], ["B", "U"]],
        communication=[{"between": ["A", "B"], "offset": [2.0 * x, 0.0], "weight": 0.01}],
        time={"end": 40.0},
        controller={"velocity_limit": 2.0},
        safety={"distance": 1.5, "tie_break": tie_break, "obstacles": list(obstacles)},
    )


PILLAR = {"kind": "sphere", "centre": [0.0, 0.0, 0.0], "radius": 1.0}


@pytest.mark.parametrize(
    ("scenario", "doubt"),
    [
        (hunt(), ""),
        (hunt(links={"all": {"loss": 0.5}}), ""),
        (hunt(links={"all": {"loss": 0.6}}), "most measurements are lost"),
        (hunt("otter", links={"all": {"loss": 0.1}}), "A may not turn as fast as commands change"),
        (hunt("wamv", CIRCLE, controller={"gain": 1.2, "control_period": 0.02}), "the vehicles may be too slow"),
        (hunt("hull", CIRCLE, controller={"gain": 1.2, "control_period": 0.02}), ""),
        (
            hunt("quadrotor", place=(0.0, 0.0, 10.0), controller={"gain": 4.0}, links={"all": {"noise": 3.0}}),
            "A may not follow commands that noise makes",
        ),
        (hunt("quadrotor", place=(0.0, 0.0, 10.0), links={"all": {"noise": 0.1}}), ""),
        (exchange("right_hand"), ""),
        (exchange("none"), "the safety filter may block agents"),
        (exchange("none", x=1500.0), "the safety filter may block agents"),
        (exchange("right_hand", PILLAR), "the safety filter may block agents"),
    ],
)
def test_what_only_a_trial_can_decide_is_not_ok_without_one(scenario: Scenario, doubt: str) -> None:
    found = analyse(scenario)
    assert found["ok"] is (not doubt)
    assert [(one["kind"], one["what"]) for one in found["problems"]] == (
        [("untried", f"{doubt}, and the mission was not tried")] if doubt else []
    )


SEA = {"kind": "jonswap", "significant_height": 2.0, "peak_period": 8.0, "direction": 30}


@pytest.mark.parametrize(
    ("vehicle", "limit", "flow", "kind"),
    [
        ("quadrotor", None, {"drift": [3.0, 0.0, 0.0], "gusts": {"kind": "dryden", "wind_speed": 6.0}}, None),
        ("quadrotor", None, {"drift": [6.0, 0.0, 0.0], "gusts": {"kind": "dryden", "wind_speed": 8.0}}, "untried"),
        ("quadrotor", None, {"drift": [9.3, 0.0, 0.0], "gusts": {"kind": "dryden", "wind_speed": 8.0}}, "gusts"),
        # Waves without spreading move a boat along one axis.
        ("wamv", 0.4, {"waves": SEA}, "untried"),
        ("wamv", 0.4, {"drift": [0.3, 0.1], "waves": SEA}, "gusts"),
    ],
)
def test_gusts_and_waves_are_too_fast_as_often_as_foreseen(
    vehicle: str, limit: float | None, flow: dict[str, Any], kind: str | None
) -> None:
    medium, place = ("air", (0.0, 0.0, 20.0)) if "gusts" in flow else ("water", (0.0, 0.0))
    scenario = hunt(
        vehicle,
        place=place,
        time={"end": 20_000.0},
        controller={"control_period": 0.5} | ({"velocity_limit": limit} if limit else {}),
        flow={medium: {"dimension": len(place), **flow}},
    )
    times = np.arange(0.0, 20_000.0, 0.5)
    there = np.resize(place, 3) * [1.0, 1.0, len(place) == 3]
    speed = np.linalg.norm(mjsheaf.medium(scenario).velocity("A", times, there)[:, :2], axis=1)
    faster = float((speed > (limit or scenario.whole.vehicles[0].capability.top_speed)).mean())
    record = analyse(scenario)
    assert record["disturbance"]["too_fast"].get("A", 0.0) == pytest.approx(faster, abs=0.02)
    assert [problem["kind"] for problem in record["problems"]] == ([kind] if kind else [])


def test_a_vehicle_is_no_slower_than_in_its_fastest_direction() -> None:
    """A hexarotor moves at 8.06 m/s to its rear, and at 5.10 m/s forward; a steeper way of its rotors may be faster."""
    scenario = pursuit([0, 0, 20], [-500, 0, 20], {"vehicle": "hexarotor", "heading": 0}, time={"end": 30.0})
    run = mjsheaf.simulate(scenario, engine="fused", progress=False)
    (demand,) = analyse(scenario)["margins"]["speed"]
    fastest = float(np.linalg.norm(run["agent_velocity"].values[-1, 0]))
    assert 1.5 * known(demand["able"]) < fastest <= known(demand["able_fastest"]) < 1.1 * fastest
