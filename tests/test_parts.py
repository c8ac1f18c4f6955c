"""Tuples of parts of unlike kinds. Oracle: a loop in Python over the parts."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from mjsheaf.arrays import Array
from mjsheaf.compile.jit import for_each, has_any, inline_jit, jit


class Scaled(NamedTuple):
    """A part that returns numbers and holds one."""

    factors: Array


class Shifted(NamedTuple):
    """A part that returns numbers alone."""

    shifts: Array


class Silent(NamedTuple):
    """A part without functions."""

    values: Array


@jit
def _scale(part, state, v, x):
    return part.factors[v] * x, state[v]


@inline_jit
def _shift(part, state, v, x):
    return part.shifts[v] + x, 1.0


@inline_jit
def _hold(part, state, t, first, last):
    for v in range(first, last):
        state[v] = t + v


@inline_jit
def _add(a, b):
    return 2.0 * a[0] + b[0], a[1] + b[1]  # depends on the order


VALUES: dict[type, Any] = {Scaled: _scale, Shifted: _shift, Silent: None}
HOLDS: dict[type, Any] = {Scaled: _hold}
values = for_each(lambda kind: VALUES[kind], _add)
hold = for_each(lambda kind: HOLDS.get(kind))
holds = has_any(lambda kind: HOLDS.get(kind))


@jit
def _evaluate(parts, states, v, x):
    hold(parts, states, (), 5.0, 0, 2)
    return values(parts, states, (0.5, 0.25), v, x), holds(parts)


@pytest.mark.parametrize(
    "kinds",
    [(), (Silent,), (Scaled,), (Shifted, Scaled), (Scaled, Silent, Shifted), (Scaled, Scaled)],
    ids=lambda kinds: "-".join(kind.__name__ for kind in kinds) or "none",
)
def test_every_part_is_called_once_in_order(kinds: tuple[Any, ...]) -> None:
    parts = tuple(kind(np.array([1.0, 10.0 + k])) for k, kind in enumerate(kinds))
    states = tuple(np.zeros(2) for _ in parts)
    total = (0.5, 0.25)
    for part in parts:
        if isinstance(part, Scaled):
            total = 2.0 * total[0] + part.factors[1] * 3.0, total[1] + 6.0
        elif isinstance(part, Shifted):
            total = 2.0 * total[0] + part.shifts[1] + 3.0, total[1] + 1.0
    assert _evaluate(parts, states, 1, 3.0) == (total, Scaled in kinds)
    for kind, state in zip(kinds, states, strict=True):
        assert state.tolist() == ([5.0, 6.0] if kind is Scaled else [0.0, 0.0])
