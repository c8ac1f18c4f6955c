"""Scenarios that ship do what they are for, and show the numbers that their comments and the docs give.

Oracles: the bounds that were set before `harbour` was built; each scenario over links against itself with other links.
"""

from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import check, load_scenario, simulate
from mjsheaf.results.metrics import late_errors
from mjsheaf.scenario import Scenario
from tests.builders import REPOSITORY, Simulated
from tests.test_claims import agrees

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
    """Return the RMS error before and over each change, m."""
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


BACKENDS = ["ideal", "physics"]


def late(simulated: Simulated, name: str, backend: str, **overrides: Any) -> float:
    """Tracking error, RMS over the last half of the run, m."""
    changes = {path.replace("__", "."): value for path, value in overrides.items()}
    data = simulated(name, backend, changes)
    assert data.attrs["status"] == "finished"
    found = late_errors(load_scenario(name, changes).system.team, data)["tracking_error"]
    assert found is not None
    return found


@pytest.mark.long
@pytest.mark.parametrize("backend", BACKENDS)
def test_the_delay_that_breaks_the_published_run_and_what_mends_it(backend: str, simulated: Simulated) -> None:
    fast = {"controller.gain": 10}
    for changes, margin in (({}, 0.07), (fast, 0.01), ({**fast, "controller.newton.rounds": 2}, 0.13)):
        answer = check(load_scenario("paper_delay", changes), trial=False)["links"]["delay"]
        assert answer["stable"] is (margin >= 0.05)
        assert answer["margin"] == pytest.approx(margin)
        assert simulated("paper_delay", backend, changes).attrs["status"] == (
            "finished" if answer["stable"] else "unstable"
        )
    assert late(simulated, "paper", backend) == pytest.approx(3.95, abs=0.03)
    assert late(simulated, "paper_delay", backend) == pytest.approx(10.0, abs=0.1)
    newton = late(simulated, "paper_delay", backend, controller__gain=10, controller__newton__rounds=2)
    assert newton == pytest.approx(2.0, abs=0.05)


@pytest.mark.long
@pytest.mark.parametrize("backend", BACKENDS)
def test_half_of_the_messages_is_half_of_the_gain(backend: str, simulated: Simulated) -> None:
    scenario = load_scenario("paper_half_lost")
    record = check(scenario, trial=False)
    assert record["law"]["rate"] == pytest.approx(4.52, abs=0.01)
    assert record["links"]["loss"]["rate"] == pytest.approx(2.23, abs=0.01)
    assert late(simulated, "paper_half_lost", backend) == pytest.approx(7.05, abs=0.05)
    assert late(simulated, "paper_half_lost", backend, links__all__hold=0.05) == pytest.approx(4.02, abs=0.02)
    assert late(simulated, "paper_half_lost", backend, links__all__loss=0.9) == pytest.approx(14.3, abs=0.1)
    if backend == "physics":  # a held measurement is an old one
        held = {"links.all.loss": 0.9, "links.all.hold": 0.1}
        assert simulated("paper_half_lost", backend, held).attrs["status"] == "unstable"


@pytest.mark.long
def test_noise_is_averaged(simulated: Simulated) -> None:
    """What losses cost, and that a hold mends them, is in `test_runs` of test_claims.py."""
    assert late(simulated, "noisy_harbour", "physics", links__communication__loss=0) == pytest.approx(2.74, abs=0.02)
    noise = check(load_scenario("noisy_harbour"), trial=False)["links"]["noise"]
    assert noise["error"] == pytest.approx(0.2, abs=0.01)
    assert noise["command"] == pytest.approx(2.4, abs=0.05)


@pytest.mark.long
@pytest.mark.parametrize("backend", BACKENDS)
def test_the_swarm_is_carried_off_in_the_shadow_and_comes_back(backend: str, simulated: Simulated) -> None:
    data = simulated("swarm_radio_shadow", backend)
    error = np.sqrt((data["tracking_error"].values ** 2).mean(axis=1))
    before, carried, back = (error[int(50 * t)] for t in (15, 30, 60))
    assert carried > 4 * before
    assert back < 1.1 * before
    silent = 1.0 - float(data["delivery"].mean())  # ten of eleven in the shadow, a quarter of the run
    assert silent == pytest.approx(10 / 44, abs=0.01)


def test_the_gate_is_narrower_than_the_formation() -> None:
    scenario = load_scenario("narrow_gate")
    assert scenario.safety is not None
    towers = [obstacle.model_dump() for obstacle in scenario.safety.obstacles]
    gap = abs(towers[0]["ends"][0][1] - towers[1]["ends"][0][1]) - 2 * towers[0]["radius"]
    width = [
        np.ptp([phase.system.team.displacement[agent][1] for agent in scenario.team.agent_ids])
        for phase in scenario.phases
    ]
    assert width[0] > gap > width[2] + 2 * 4.2  # with the distance, and the margin of an Otter, on both sides
