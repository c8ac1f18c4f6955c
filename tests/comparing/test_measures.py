"""Time spans and error budgets of curves with a known answer.

Oracle: closed forms, and the identity that a budget must satisfy.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.comparing.variants import budget_of, ladder_of, root_mean_square, span_of
from tests.builders import two_boats


def test_late_is_the_last_half_of_the_run_that_was_asked_for() -> None:
    system = two_boats("hull", "hull").system
    time = system.grid.samples
    chosen = span_of(system).last_half(len(time))
    assert time[chosen][0] == pytest.approx(1.5)
    assert root_mean_square(np.full(len(time), 3.0), chosen) == 3.0
    assert np.isnan(root_mean_square(time[:10], chosen[:10]))  # it blew up before


@given(st.integers(0, 2**32 - 1))
def test_a_budget_sums_to_the_whole(seed: int) -> None:
    """Ideal + targets + agents + together + every effect alone + interaction = all, whatever the errors."""
    ladder = ladder_of(two_boats("otter", "hull").system)
    values = np.random.default_rng(seed).uniform(0.0, 10.0, len(ladder))
    error = {rung.key: float(x) for rung, x in zip(ladder, values, strict=True)}
    budget = budget_of(("team", "tracking_error", "late"), error, None)
    parts = [budget.ideal_m, budget.targets_m, budget.agents_m, budget.together_m, budget.interaction_m]
    total = sum(x for x in [*parts, *(item.alone_m for item in budget.effects)] if x is not None)
    assert total == pytest.approx(error["all"])
    assert budget.all_m == error["all"]
    assert [item.effect for item in budget.effects] == [v.effect for v in ladder if v.kind == "alone"]
    for item in budget.effects:
        assert item.give_back_m == pytest.approx(error["all"] - error[f"-{item.effect}"])


def test_a_rung_that_blew_up_leaves_a_hole_in_the_budget() -> None:
    ladder = ladder_of(two_boats("otter", "hull").system)
    error = {variant.key: None if variant.key == "+lag" else 1.0 for variant in ladder}
    budget = budget_of(("team", "tracking_error", "late"), error, None)
    assert next(item for item in budget.effects if item.effect == "lag").alone_m is None
    assert budget.interaction_m is None
    assert budget.all_m == 1.0
