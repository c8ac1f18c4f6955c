"""Settling, distances, budgets: on curves whose answer is known.

Oracle: closed forms, and the identity that a budget must satisfy.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.comparing.budget import budget_of
from mjsheaf.comparing.ladder import ladder_of
from mjsheaf.comparing.measures import late, root_mean_square, settling_time
from tests.comparing.small import pair

TIME = np.linspace(0.0, 20.0, 2001)


def test_an_exponential_settles_when_two_percent_are_left() -> None:
    found = settling_time(TIME, 5.0 * np.exp(-TIME))
    assert found == pytest.approx(np.log(50.0), abs=0.02)


def test_an_oscillation_that_never_was_worse_has_settled_at_once() -> None:
    assert settling_time(TIME, 1.0 + 0.3 * np.sin(3.0 * TIME)) == 0.0


def test_a_transient_over_an_oscillation() -> None:
    steady = 0.2 + 0.1 * np.sin(3.0 * TIME)
    found = settling_time(TIME, steady + 10.0 * np.exp(-TIME))
    assert found is not None
    assert 2.0 < found < 5.0


@pytest.mark.parametrize("curve", [np.exp(0.2 * TIME), np.exp(-0.2 * TIME), TIME**3])
def test_what_grows_or_still_falls_never_settles(curve: np.ndarray) -> None:
    assert settling_time(TIME, curve) is None


def test_what_is_not_finite_never_settles() -> None:
    assert settling_time(TIME, np.where(TIME > 10.0, np.nan, 1.0)) is None


def test_late_is_the_last_half_of_the_run_that_was_asked_for() -> None:
    system = pair("hull", "hull").system()
    time = system.grid.samples
    chosen = late(system, time)
    assert time[chosen][0] == pytest.approx(1.5)
    assert root_mean_square(np.full(len(time), 3.0), chosen) == 3.0
    assert np.isnan(root_mean_square(time[:10], late(system, time[:10])))  # it blew up before


@given(st.integers(0, 2**32 - 1))
def test_a_budget_sums_to_the_whole(seed: int) -> None:
    """Ideal + targets + agents + together + every effect alone + interaction = all, whatever the errors."""
    ladder = ladder_of(pair("otter", "hull").system())
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
    ladder = ladder_of(pair("otter", "hull").system())
    budget = budget_of(ladder, lambda key: float("nan") if key == "+lag" else 1.0)
    assert next(item for item in budget.items if item.effect == "lag").alone is None
    assert budget.interaction is None
    assert budget.whole == 1.0
