"""The fields that a study sweeps, as axes of plots."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjsheaf.studies.schema import Choice, StudyFile

Array = NDArray[np.float64]

_DECADES = 30.0
"""Ratio of largest to smallest from which an axis is logarithmic."""

_MOST_TICKS = 12
_LONGEST_LABEL = 24


@dataclass(frozen=True)
class SweptAxis:
    """A swept field with more than one value.

    Attributes:
        path: of the field.
        numeric: whether all values are numbers; else each value has a place of its own.
        drawn: whether the values were drawn at random, so that few runs share one.
        places: of the distinct values, ascending, shape (K,): the numbers themselves, or 0 to K - 1.
        labels: of the distinct values.
        index: of each run's value among them, shape (R,).
    """

    path: str
    numeric: bool
    drawn: bool
    places: Array
    labels: list[str]
    index: NDArray[np.int64]

    @property
    def log(self) -> bool:
        """Whether values span decades."""
        return self.numeric and spans_decades(self.places)

    def dress(self, axis: Any, which: str = "x") -> None:
        """Give a matplotlib axis the field's name, scale and ticks."""
        getattr(axis, f"set_{which}label")(self.path)
        if self.log:
            getattr(axis, f"set_{which}scale")("log")
        if not self.numeric:
            step = -(-len(self.places) // _MOST_TICKS)
            rotation = 20 if which == "x" and max(map(len, self.labels)) > 8 else 0
            getattr(axis, f"set_{which}ticks")(self.places[::step], self.labels[::step], rotation=rotation)


def swept_axes(study: StudyFile, records: list[dict[str, Any]]) -> list[SweptAxis]:
    """The swept fields that take more than one value, in the order of the study."""
    drawn = study.draws.values if study.draws else {}
    axes = []
    for path in study.paths:
        how = drawn.get(path)
        order = how.values if isinstance(how, Choice) else []
        axes.append(_axis(path, [r["parameters"].get(path) for r in records], order, how is not None))
    return [axis for axis in axes if len(axis.places) > 1]


def _axis(path: str, values: list[Any], order: list[Any], drawn: bool) -> SweptAxis:
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        places, index = np.unique(np.array(values, dtype=np.float64), return_inverse=True)
        return SweptAxis(path, True, drawn, places, [f"{x:g}" for x in places], index)
    keys = [_key(value) for value in values]
    seen = set(keys)
    names = [name for name in dict.fromkeys([*map(_key, order), *keys]) if name in seen]
    number = {name: k for k, name in enumerate(names)}
    short = [n if len(n) <= _LONGEST_LABEL else n[: _LONGEST_LABEL - 1] + "…" for n in names]
    index = np.array([number[key] for key in keys], dtype=np.int64)
    return SweptAxis(path, False, drawn, np.arange(len(names), dtype=np.float64), short, index)


def _key(value: Any) -> str:
    return "as it is" if value is None else value if isinstance(value, str) else json.dumps(value)


def spans_decades(values: Array) -> bool:
    """Whether positive values differ so much that a logarithmic scale tells more."""
    known = values[np.isfinite(values)]
    return bool(known.size and known.min() > 0.0 and known.max() >= _DECADES * known.min())
