"""The gain: what limits it, and what a higher one gives, measured.

Oracles: plain runs at the higher gain; `check`.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf import check, simulate
from mjsheaf.comparing import CompareRecord, compare
from mjsheaf.comparing.causes import LIMITED_BY
from mjsheaf.comparing.margins import try_gains
from mjsheaf.comparing.page import report_text
from mjsheaf.comparing.variants import ladder_of, run_ablation
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
    assert len(record.gains) >= 2
    for trial in record.gains:
        data = simulate(boats(trial.gain))
        time, error = data["time"].values, np.sqrt((data["tracking_error"].values ** 2).mean(axis=1))
        late = time >= 1.5 - 1e-9
        assert approx(trial.late.tracking_error, rel=1e-9) == np.sqrt((error[late] ** 2).mean())
        assert approx(trial.saturated) == data["agent_saturation"].values.mean()
    assert record.gains[0].gain == record.gain
    assert record.gains[0].late == record.rung("all").errors["team"].late


@pytest.mark.slow
def test_the_verdict_says_what_limits_and_the_page_what_was_measured(record: CompareRecord) -> None:
    assert record.ringing is not None
    (limit,) = [s for s in record.verdict if s.startswith("gain 1 1/s")]
    assert f"{record.usable_gain:.2g} 1/s" in limit
    assert LIMITED_BY[record.ringing.effect] in limit
    page = report_text(record)
    for trial in record.gains:
        error = f"{trial.late.tracking_error:.3g}"
        assert any(row.split()[:2] == [f"{trial.gain:.4g}", error] for row in page.splitlines())
    assert "thrusters at a limit" in page


def test_the_usable_gain_is_below_the_stable_one(record: CompareRecord) -> None:
    assert record.ringing is not None
    assert record.ringing.largest_gain is not None
    assert record.usable_gain is not None
    assert record.usable_gain == record.ringing.usable_gain
    assert record.usable_gain < record.ringing.largest_gain
    assert record.loop is not None
    assert (record.loop.largest_gain, record.loop.stable, record.loop.reason) == (record.ringing.largest_gain, True, "")


def test_the_loop_is_that_of_the_bodies_with_their_effects(record: CompareRecord) -> None:
    """Oracle: `check`, whose mean flow is that along the targets' path in theory."""
    assert record.ringing is not None
    bodies = check(boats(), trial=False)["margins"]["bodies"]
    assert record.ringing.stable is bodies["stable"]
    assert record.ringing.largest_gain == pytest.approx(bodies["largest_gain"], rel=0.05)
    assert record.ringing.least_damped is not None
    assert record.ringing.least_damped.damping == pytest.approx(bodies["least_damped"]["damping"], rel=0.05)


def test_every_error_of_a_comparison_states_its_norm(record: CompareRecord) -> None:
    held = [part for _, part in records(record.model_dump(mode="json")) if errors_of(part) or "at_q_star_m" in part]
    assert len(held) >= 2 * len(record.ladder) + len(record.budgets)
    assert {part["norm"] for part in held} == {"per_agent_rms"}


@pytest.mark.parametrize(
    ("largest", "expected"), [(None, [1.0, 2.0, 4.0]), (3.0, [1.0, 2.0, 2.7]), (2.0, [1.0, 1.8]), (1.1, [])]
)
def test_gains_are_tried_below_that_at_which_the_loop_is_unstable(largest: float | None, expected: list[float]) -> None:
    phases = boats(time={"end": 0.2}).phases
    given = run_ablation(phases, [rung for rung in ladder_of(phases) if rung.key == "all"])["all"]
    assert [trial.gain for trial in try_gains(phases, given, largest)] == expected
