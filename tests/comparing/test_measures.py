"""Spans and budgets: on curves whose answer is known.

Oracle: closed forms, and the identity that a budget must satisfy.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.comparing.ladder import ladder_of
from mjsheaf.comparing.measures import late, root_mean_square
from mjsheaf.comparing.verdict import budget_of
from tests.builders import two_boats


def test_late_is_the_last_half_of_the_run_that_was_asked_for() -> None:
    system = two_boats("hull", "hull").system
    time = system.grid.samples
    chosen = late(system, time)
    assert time[chosen][0] == pytest.approx(1.5)
    assert root_mean_square(np.full(len(time), 3.0), chosen) == 3.0
    assert np.isnan(root_mean_square(time[:10], late(system, time[:10])))  # it blew up before


@given(st.integers(0, 2**32 - 1))
def test_a_budget_sums_to_the_whole(seed: int) -> None:
    """Ideal + targets + agents + together + every effect alone + interaction = all, whatever the errors."""
    ladder = ladder_of(two_boats("otter", "hull").system)
    values = np.random.default_rng(seed).uniform(0.0, 10.0, len(ladder))
    error = {rung.key: float(x) for rung, x in zip(ladder, values, strict=True)}
    budget = budget_of(ladder, error.__getitem__)
    parts = [budget.ideal, budget.targets, budget.agents, budget.together, budget.interaction]
    total = sum(x for x in [*parts, *(item.alone for item in budget.items)] if x is not None)
    assert total == pytest.approx(error["all"])
    assert budget.whole == error["all"]
    for item in budget.items:
        assert item.give_back == pytest.approx(error["all"] - error[f"-{item.effect}"])


def test_a_rung_that_blew_up_leaves_a_hole_in_the_budget() -> None:
    ladder = ladder_of(two_boats("otter", "hull").system)
    budget = budget_of(ladder, lambda key: float("nan") if key == "+lag" else 1.0)
    assert next(item for item in budget.items if item.effect == "lag").alone is None
    assert budget.interaction is None
    assert budget.whole == 1.0
