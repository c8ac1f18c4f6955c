"""Error due to the law's velocity limit.

Oracles: the commands of a plain run; the limit that is said to do, tried.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.comparing import CompareRecord, compare
from mjsheaf.comparing.variants import root_mean_square
from mjsheaf.scenario import Scenario
from tests.builders import known, two_boats
from tests.running import rms_error


def limited(limit: float | None, end: float = 24.0, **fields: Any) -> Scenario:
    """A target on a circle at 0.6 m/s, and boats that may do so much."""
    controller = {"gain": 1.0, "control_period": 0.02} | ({} if limit is None else {"velocity_limit": limit})
    return two_boats("hull", "hull", time={"end": end}, controller=controller, **fields)


def late_tracking(scenario: Scenario, backend: str) -> float:
    data = simulate(scenario, backend)
    grid = scenario.system.grid
    return root_mean_square(rms_error(data), data["time"].values >= grid.start + 0.5 * grid.period * grid.steps)


@pytest.fixture(scope="module")
def record() -> CompareRecord:
    return compare(limited(0.4)).record


@pytest.mark.slow(first=True)
def test_the_share_at_the_limit_is_that_of_the_commands(record: CompareRecord) -> None:
    speed = np.linalg.norm(np.nan_to_num(simulate(limited(0.4), "ideal")["velocity_command"].values), axis=2)
    half = speed[-(len(speed) // 2 + 1) :]
    found = known(record.velocity_limit)
    assert found.share_at_limit["ideal"] == pytest.approx((half >= 0.4 * (1 - 1e-9)).mean(), abs=2e-3)
    assert found.share_at_limit["ideal"] > 0.5


def test_the_limit_that_is_said_to_do_does(record: CompareRecord) -> None:
    found = known(record.velocity_limit)
    free = late_tracking(limited(None), "ideal")
    assert late_tracking(limited(found.asked_m_s), "ideal") == pytest.approx(free, rel=0.02)
    assert late_tracking(limited(0.8 * found.asked_m_s), "ideal") > 1.1 * free


def test_the_verdict_names_it(record: CompareRecord) -> None:
    found = known(record.velocity_limit)
    assert found.lowest_m_s == found.highest_m_s == 0.4
    (told,) = [s for s in record.verdict if s.startswith("tracking error:")]
    free = record.error("all-limit", "team", "tracking_error")
    assert f"dominant cause: the velocity limit ({free:.3g} m without)" in told
    assert f"raise velocity_limit to {found.asked_m_s:.3g} m/s" in told
    assert not any("the law, not the vehicles" in s for s in record.verdict if s.startswith("tracking error:"))


@pytest.mark.long
def test_a_limit_that_is_not_met_costs_nothing_and_is_not_spoken_of() -> None:
    record = compare(limited(30.0)).record
    assert known(record.velocity_limit).share_at_limit["ideal"] == 0.0
    assert record.saved_by("all-limit", "team", "tracking_error") == pytest.approx(0.0, abs=1e-12)
    assert "velocity" not in " ".join(record.verdict)
    assert compare(limited(None)).record.velocity_limit is None


@pytest.mark.slow
@pytest.mark.parametrize("authority", ["equal", "by_speed"])
def test_the_safety_filter_stays_that_of_the_limit_that_is_taken_away(authority: str) -> None:
    """Its range, the agents' shares and the margins of bodies follow from the limit."""
    scenario = limited(0.4, 6.0, safety={"distance": 0.5, "authority": authority})
    record = compare(scenario).record
    found = {key: known(record.error(key, "team", "tracking_error")) for key in ("all", "ideal-limit", "all-limit")}
    assert found["all-limit"] < 0.7 * found["all"]
    assert found["all-limit"] == pytest.approx(found["ideal-limit"], rel=0.1)
    free = replace(scenario.system, unlimited=True)
    for name in ("control", "control_of_bodies"):
        own, other = (getattr(system, name).law for system in (scenario.system, free))
        assert np.isinf(other.limit[:2]).all()
        for field, kept in own.safety._asdict().items():
            np.testing.assert_equal(getattr(other.safety, field), kept, err_msg=field)
