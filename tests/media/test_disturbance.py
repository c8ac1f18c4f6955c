"""Disturbances: bounded, continuous in time, and the same for the same seed (the paper's Assumption 3).

Oracle: the bound and the Lipschitz constant 2 pi f_max bound that follow from the construction.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.media import varying
from mjsheaf.media.varying import Disturbance, disturbance_velocity, evaluate_sines

kinds = st.builds(
    Disturbance,
    bound=st.just(0.0) | st.floats(1e-100, 100.0),  # squares of smaller ones are subnormal in the norms below
    frequencies=st.tuples(st.floats(0.01, 1.0), st.floats(1.0, 5.0)),
    components=st.integers(1, 9),
)
dimensions = st.lists(st.sampled_from([2, 3]), min_size=1, max_size=4)


def ids(vehicles: Sequence[Any]) -> list[str]:
    return [f"V{k}" for k in range(len(vehicles))]


@given(kinds, dimensions, st.integers(0, 2**31))
def test_disturbances_are_bounded_and_continuous(kind: Disturbance, sizes: list[int], seed: int) -> None:
    harmonics = varying.draw([kind] * len(sizes), sizes, ids(sizes), seed)
    rng = np.random.default_rng(seed + 1)
    times = np.concatenate([np.linspace(0.0, 30.0, 500), rng.uniform(0, 1e4, 500)])
    omega = varying.evaluate(harmonics, times)
    assert omega.shape == (1000, len(sizes), 3)
    slack = 1.0 + 1e-12
    assert np.linalg.norm(omega, axis=2).max() <= kind.bound * slack
    np.testing.assert_array_equal(omega[:, [n == 2 for n in sizes], 2], 0.0)
    steepest = 2.0 * np.pi * kind.frequencies[1] * kind.bound
    for h in (1e-1, 1e-3):
        change = varying.evaluate(harmonics, times + h) - omega
        assert np.linalg.norm(change, axis=2).max() <= steepest * h * slack + 1e-9 * kind.bound


@given(st.integers(0, 2**31))
def test_disturbances_do_disturb(seed: int) -> None:
    """The bound is not a fiction: over a long time each vehicle sees a good part of it, in every direction it has."""
    harmonics = varying.draw([Disturbance(bound=2.0)] * 3, [3, 2, 3], ["A", "B", "C"], seed)
    omega = varying.evaluate(harmonics, np.linspace(0.0, 400.0, 4000))
    assert np.linalg.norm(omega, axis=2).max(axis=0).min() > 0.6
    spread = omega.std(axis=0)
    assert spread[[0, 2]].min() > 0.05
    assert spread[1, :2].min() > 0.05
    assert np.abs(omega.mean(axis=0)).max() < 0.1


@given(kinds, dimensions, st.sets(st.integers(0, 3)), st.integers(0, 2**31), st.floats(0.0, 1e300), st.floats(0.0, 1e6))
def test_the_bound_holds_at_any_time_and_both_forms_agree_where_the_loop_may_run(
    kind: Disturbance, sizes: list[int], calm: set[int], seed: int, late: float, early: float
) -> None:
    """Also where some vehicles, the first, the last, or all of them, have no disturbance."""
    each = [None if v in calm else kind for v in range(len(sizes))]
    harmonics = varying.draw(each, sizes, ids(sizes), seed)
    packed = varying.pack(harmonics)

    def compiled(t: float) -> Array:
        sines, at_once = np.zeros(packed.rate.shape), np.zeros(packed.rate.shape)
        for v in range(len(sizes)):  # one at a time or all at once: the same bits
            evaluate_sines(packed, t, v, v + 1, sines)
        evaluate_sines(packed, t, 0, len(sizes), at_once)
        np.testing.assert_array_equal(sines, at_once)
        assert np.abs(sines).max(initial=0.0) <= 1.0 + 1e-15
        return np.array([disturbance_velocity(packed, sines, v) for v in range(len(sizes))])

    for t in (late, 1e17, 1e9, -1e12):
        assert np.linalg.norm(compiled(t), axis=1).max() <= kind.bound * (1.0 + 1e-12)
    for t in (min(early, 1e3), min(early, kind.longest_time), kind.longest_time):
        turns = packed.rate.max(initial=0.0) * t + packed.phase.max(initial=0.0)
        assert 2.0 * np.pi * turns <= varying.LARGEST_PHASE * (1.0 + 1e-12)
        expected = varying.evaluate(harmonics, np.array([t]))[0]
        np.testing.assert_allclose(compiled(t), expected, rtol=0, atol=1e-14 * max(kind.bound, 1e-300))


@pytest.mark.parametrize("most", [1.0, 1e3, 1e5, 1e7])
def test_the_sine_of_the_loops_is_the_sine(most: float) -> None:
    """To a unit in the last place of 1, also at multiples of a quarter turn; the oracle has 64 bits of fraction."""
    quarters = np.arange(-2000.0, 2000.0) / 4.0
    close = np.concatenate([np.nextafter(quarters, np.inf), quarters, np.nextafter(quarters, -np.inf)])
    x = np.concatenate([np.random.default_rng(0).uniform(-most, most, 20_000), close])
    found = np.array([varying.sine(value) for value in x])
    pi = 4.0 * np.arctan(np.longdouble(1.0))
    np.testing.assert_allclose(found, np.sin(2.0 * pi * (x - np.rint(x))), rtol=0, atol=2.3e-16)
    np.testing.assert_array_equal(np.abs(found) <= 1.0, True)


WRONG: list[tuple[str, Any, str]] = [
    *(("bound", value, "bound") for value in (-1.0, float("nan"), "1")),
    ("frequencies", (0.0, 1.0), "frequencies.0"),
    ("frequencies", (2.0, 1.0), "lowest <= highest frequency"),
    ("components", 0, "components"),
]


@pytest.mark.parametrize(("field", "value", "words"), WRONG)
def test_wrong_disturbances_are_refused(field: str, value: Any, words: str) -> None:
    with pytest.raises(InputError, match=f"Disturbance: .*{words}"):
        Disturbance(**{"bound": 1.0, field: value})
