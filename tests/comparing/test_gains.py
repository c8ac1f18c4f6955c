"""The gain: what limits it, and what a higher one gives, measured.

Oracles: plain runs at the higher gain; `check`.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf import check, simulate
from mjsheaf.comparing import CompareRecord, compare
from mjsheaf.comparing.causes import LIMITED_BY
from mjsheaf.comparing.margins import _factors
from mjsheaf.comparing.page import report_text
from mjsheaf.scenario import Scenario
from tests.builders import approx, two_boats
from tests.checking.test_norms import errors_of, records


def boats(gain: float = 1.0, vehicle: str = "otter", **fields: Any) -> Scenario:
    return two_boats(vehicle, "hull", **{"controller": {"gain": gain, "control_period": 0.02}, **fields})


@pytest.fixture(scope="module")
def record() -> CompareRecord:
    return compare(boats()).record


@pytest.mark.slow
def test_trials_are_plain_runs_at_their_gains(record: CompareRecord) -> None:
    assert record.gains is not None
    assert len(record.gains.trials) >= 2
    for trial in record.gains.trials:
        data = simulate(boats(trial.gain))
        time, error = data["time"].values, np.sqrt((data["tracking_error"].values ** 2).mean(axis=1))
        late = time >= 1.5 - 1e-9
        assert approx(trial.late.tracking_error, rel=1e-9) == np.sqrt((error[late] ** 2).mean())
        assert approx(trial.saturated) == data["agent_saturation"].values.mean()
    assert record.gains.trials[0].gain == record.gain
    assert record.gains.trials[0].late == record.rung("all").errors["team"].late


def test_the_verdict_says_what_limits_and_the_page_what_was_measured(record: CompareRecord) -> None:
    assert record.gains is not None
    lowest = record.gains.limits[0]
    (limit,) = [s for s in record.verdict if s.startswith("gain 1 1/s")]
    assert f"{lowest.gain:.2g} 1/s" in limit
    assert LIMITED_BY[lowest.effect] in limit or lowest.kind == "unstable"
    page = report_text(record)
    for trial in record.gains.trials:
        error = f"{trial.late.tracking_error:.3g}"
        assert any(row.split()[:2] == [f"{trial.gain:.4g}", error] for row in page.splitlines())
    assert "thrusters at a limit" in page


def test_limits_are_the_usable_gain_and_the_stable_one(record: CompareRecord) -> None:
    assert record.gains is not None
    assert record.loop is not None
    gains = [limit.gain for limit in record.gains.limits]
    assert gains == sorted(gains)
    assert record.usable_gain == gains[0]
    assert record.loop.largest_gain in gains


def test_the_loop_is_that_of_the_bodies_with_their_effects(record: CompareRecord) -> None:
    """Oracle: `check`, whose mean flow is that along the targets' path in theory."""
    assert record.loop is not None
    bodies = check(boats(), trial=False)["margins"]["bodies"]
    assert record.loop.stable is bodies["stable"]
    assert record.loop.largest_gain == pytest.approx(bodies["largest_gain"], rel=0.05)
    assert record.ringing is not None
    assert record.ringing.least_damped is not None
    assert record.ringing.least_damped.damping == pytest.approx(bodies["least_damped"]["damping"], rel=0.05)


def test_every_error_of_a_comparison_states_its_norm(record: CompareRecord) -> None:
    held = [part for _, part in records(record.model_dump(mode="json")) if errors_of(part) or "at_q_star_m" in part]
    assert len(held) >= 2 * len(record.ladder) + len(record.budgets)
    assert {part["norm"] for part in held} == {"per_agent_rms"}


def test_gains_are_tried_below_that_at_which_the_loop_is_unstable() -> None:
    assert _factors(1.0, None) == [2.0, 4.0]
    assert _factors(1.0, 3.0) == [2.0, 2.7]
    assert _factors(1.0, 2.0) == [1.8]
    assert _factors(1.0, 1.1) == []
    assert _factors(0.0, None) == []
