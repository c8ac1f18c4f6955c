"""Scenarios that ship do what they are for, and show the numbers that their comments and the docs give.

Oracle: each scenario over links against itself with other links.
"""

from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import load_scenario, simulate
from mjsheaf.scenario import Scenario
from tests.builders import REPOSITORY, Simulated
from tests.running import analyse
from tests.test_claims import agrees, late_error

BEFORE, JUMP = 15.0, 5.0  # s
LINKS = load_scenario("noisy_harbour").links.model_dump(mode="json", exclude_none=True)
ROWS: dict[str, dict[str, Any]] = {
    "ideal kinematics": {"backend": "ideal"},
    "ideal kinematics, changes of 20 s": {"backend": "ideal", "over": 20.0},
    "bodies": {},
    "bodies, changes of 20 s": {"over": 20.0},
    "bodies, the links of `noisy_harbour`": {"links": LINKS},
    "bodies, these links, changes of 20 s": {"links": LINKS, "over": 20.0},
    "bodies, changes at once": {"over": None},
}
PAGE = (REPOSITORY / "docs" / "howto" / "failures.md").read_text()
SHOWN = {row.split("|")[1].strip(): row.split("|")[2:6] for row in PAGE.splitlines() if row.startswith("| ")}


def gate(over: float | None = 40.0, links: dict[str, Any] | None = None) -> Scenario:
    raw = load_scenario("narrow_gate").model_dump(mode="json", exclude_none=True)
    for event in raw["events"]:
        event["over"] = over
    return load_scenario(raw | ({"links": links} if links else {}))


def errors_about_changes(data: xr.Dataset, scenario: Scenario) -> list[float]:
    time = data["time"].values + 1e-9
    found = []
    for event in scenario.events:
        span = event.model_dump()["over"] or JUMP
        for begin, end in ((event.time - BEFORE, event.time), (event.time, event.time + span)):
            inside = (time >= begin) & (time < end)
            found.append(float(np.sqrt((data["tracking_error"].values[inside] ** 2).mean())))
    return found


@pytest.mark.long
@pytest.mark.parametrize("name", ROWS)
def test_the_error_through_a_change_is_that_before_it(name: str) -> None:
    """At most twice, also with noisy links and in half of the time; distances are kept at every sample."""
    options = dict(ROWS[name])
    backend = options.pop("backend", "physics")
    scenario = gate(**options)
    data = simulate(scenario, backend)
    before_first, first, before_second, second = found = errors_about_changes(data, scenario)
    assert float(data["separation"].min()) > 2.9
    if options.get("over", 40.0) is None:
        assert first > 50 * before_first
    else:
        assert first <= 2 * before_first
        assert second <= 2 * before_second
    for shown, value in zip(SHOWN[name], found, strict=True):
        assert agrees(shown.strip(), value), (shown, value)


def test_check_says_of_scenarios_over_links_what_their_comments_say() -> None:
    """That their runs do is in `test_runs` of test_claims.py."""
    fast = {"controller.gain": 10}
    for changes, margin in (({}, 0.07), (fast, 0.01), ({**fast, "controller.newton.rounds": 2}, 0.13)):
        answer = analyse("paper_delay", changes)["links"]["delay"]
        assert answer["stable"] is (margin >= 0.05)
        assert answer["margin"] == pytest.approx(margin)
    lost = analyse("paper_half_lost")
    assert lost["law"]["rate"] == pytest.approx(4.52, abs=0.01)
    assert lost["links"]["loss"]["rate"] == pytest.approx(2.23, abs=0.01)
    noise = analyse("noisy_harbour")["links"]["noise"]
    assert noise["error"] == pytest.approx(0.2, abs=0.01)
    assert noise["command"] == pytest.approx(2.4, abs=0.05)


NEWTON = {"controller.gain": 10, "controller.newton.rounds": 2}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "changes", "shown"),
    [
        ("paper_delay", {}, "9.99"),
        ("paper_delay", {"controller.gain": 10}, "unstable"),
        ("paper_delay", NEWTON, "2.01"),
        ("paper_half_lost", {}, "7.04"),
        ("paper_half_lost", {"links.all.hold": 0.05}, "4.01"),
        ("paper_half_lost", {"links.all.loss": 0.9}, "14.3"),
    ],
)
def test_links_do_on_ideal_kinematics_what_they_do_on_bodies(name: str, changes: dict[str, Any], shown: str) -> None:
    scenario = load_scenario(name, changes)
    if shown == "unstable":
        assert all(simulate(scenario, each).attrs["status"] == "unstable" for each in ("ideal", "physics"))
    else:
        assert agrees(shown, late_error(simulate(scenario, "ideal")))


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_the_swarm_is_carried_off_in_the_shadow_and_comes_back(backend: str, simulated: Simulated) -> None:
    data = simulated("swarm_radio_shadow", backend)
    error = np.sqrt((data["tracking_error"].values ** 2).mean(axis=1))
    before, carried, back = (error[int(50 * t)] for t in (15, 30, 60))
    assert carried > 4 * before
    assert back < 1.1 * before
    silent = 1.0 - float(data["delivery"].mean())  # ten of eleven in the shadow, a quarter of the run
    assert silent == pytest.approx(10 / 44, abs=0.01)


def test_the_gate_is_narrower_than_the_formation() -> None:
    scenario = gate()
    assert scenario.safety
    one, other = (tower.model_dump() for tower in scenario.safety.obstacles)
    gap = abs(one["ends"][0][1] - other["ends"][0][1]) - 2 * one["radius"]
    teams = [phase.system.team for phase in scenario.phases]
    width = [np.ptp([team.displacement[agent][1] for agent in team.agent_ids]) for team in teams]
    assert width[0] > gap > width[2] + 2 * 4.2  # with the distance, and the margin of an Otter, on both sides
