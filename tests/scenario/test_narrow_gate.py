"""The scenario narrow_gate: a team passes between two towers that are closer together than its formation is wide."""

from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import load_scenario, simulate
from mjsheaf.scenario import Scenario
from tests.builders import REPOSITORY
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


@pytest.mark.slow
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


@pytest.mark.long
def test_engines_agree_on_the_gate() -> None:
    mujoco, fused = (simulate(gate(), engine=engine) for engine in ("mujoco", "fused"))
    np.testing.assert_allclose(
        mujoco["agent_position"].values, fused["agent_position"].values, rtol=0, atol=1e-6, equal_nan=True
    )


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
