"""Named tuples that compiled code is handed by their address. Oracle: the same numbers and arrays read in Python."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mjsheaf.compile.jit import as_records, held, inline_jit, jit, pinned


class Inner(NamedTuple):
    """Fields of several sizes: one that is misplaced shows."""

    flag: bool
    grid: NDArray[np.float64]
    pair: tuple[int, float]
    nothing: tuple[()]
    kinds: NDArray[np.void]
    small: NDArray[np.int8]


class Outer(NamedTuple):
    """A named tuple in another."""

    scale: float
    other: bool
    inner: Inner
    parts: tuple[Inner, ...]
    number: int


@inline_jit
def read_and_write(outer):
    inner = outer.inner
    total = outer.scale * inner.grid[1, 2] + inner.pair[0] * inner.pair[1] + 100 * len(inner) + outer.number
    for k in range(inner.kinds.shape[0]):
        total += inner.kinds[k].weight * inner.small[k]
    inner.grid[0, 0] += 1.0
    total += outer.parts[0].grid[0, 1]
    return total if inner.flag and not outer.other else -total


@jit
def by_value(outer):
    return read_and_write(outer)


@jit
def by_address(outer):
    return read_and_write(pinned(pinned(outer)))


def in_python(outer: Outer) -> float:
    inner = outer.inner
    total = outer.scale * inner.grid[1, 2] + inner.pair[0] * inner.pair[1] + 100 * len(inner) + outer.number
    total += (inner.kinds["weight"] * inner.small).sum() + outer.parts[0].grid[0, 1]
    inner.grid[0, 0] += 1.0
    return float(total if inner.flag and not outer.other else -total)


def outer_of(flag: bool, other: bool, whole: int, number: int) -> Outer:
    kinds = np.zeros(3, np.dtype([("code", "i4"), ("weight", "f8")], align=True))
    kinds["weight"] = 1.0, number, 3.0
    grid, small = np.arange(12.0).reshape(3, 4) + number, np.array([1, -2, 3], dtype=np.int8)
    inner = Inner(flag, grid, (whole, float(number)), (), as_records(kinds), small)
    return Outer(float(number), other, inner, (inner,), whole)


WAYS: dict[str, Callable[[Outer], Any]] = {
    "by value": by_value,
    "pinned": by_address,
    "held": lambda outer: by_address(held(outer)),
}


@pytest.mark.parametrize("way", WAYS)
@given(st.booleans(), st.booleans(), st.integers(-5, 5), st.integers(-9, 9))
def test_a_tuple_by_its_address_is_the_tuple(way: str, flag: bool, other: bool, whole: int, number: int) -> None:
    outer = outer_of(flag, other, whole, number)
    inner = outer.inner
    expected = in_python(outer)
    inner.grid[0, 0] -= 1.0
    assert WAYS[way](outer) == expected
    assert inner.grid[0, 0] == number + 1.0  # written to the array itself


def test_a_held_tuple_is_read_anew_at_each_call() -> None:
    outer = outer_of(True, False, 1, 2)
    kept = held(outer)
    first = by_address(kept)
    outer.inner.grid[1, 2] += 5.0
    assert by_address(kept) == first + 2.0 * 5.0
