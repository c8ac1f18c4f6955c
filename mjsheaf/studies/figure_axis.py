"""The fields that a study sweeps, as axes of plots."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from mjsheaf.studies.schema import Choice, Distribution, LogUniform, StudyFile

Array = NDArray[np.float64]

_DECADES = 30.0
"""Ratio of largest to smallest from which an axis is logarithmic."""

_MOST_TICKS = 12
_LONGEST_LABEL = 24
_LEVEL_LABELS = 40  # characters of all tick labels together, which still stand beside each other


@dataclass(frozen=True)
class SweptAxis:
    """A swept field with more than one value.

    Attributes:
        path: of the field.
        name: what plots call it.
        numeric: whether all values are numbers; else each value has a place of its own.
        drawn: whether the values were drawn at random, so that few runs share one.
        log: whether a logarithmic scale tells more of them.
        places: of the distinct values, ascending, shape (K,): the numbers themselves, or 0 to K - 1.
        labels: of the distinct values.
        index: of each run's value among them, shape (R,).
    """

    path: str
    name: str
    numeric: bool
    drawn: bool
    log: bool
    places: Array
    labels: list[str]
    index: NDArray[np.int64]

    def dress(self, panel: Any) -> None:
        """Give a matplotlib axis the field's name, scale and ticks along x."""
        panel.set_xlabel(self.name)
        if self.log:
            panel.set_xscale("log")
            plain_decades(panel.xaxis)
        if not self.numeric:
            step = -(-len(self.places) // _MOST_TICKS)
            shown = self.labels[::step]
            panel.set_xticks(self.places[::step], shown, rotation=self.rotation(shown))
            panel.set_xlim(-0.5, len(self.places) - 0.5)

    def rotation(self, shown: list[str]) -> float:
        """Of tick labels along x, degrees."""
        return 20.0 if sum(map(len, shown)) > _LEVEL_LABELS else 0.0


def swept_axes(study: StudyFile, records: list[dict[str, Any]]) -> list[SweptAxis]:
    """The swept fields that take more than one value, in the order of the study."""
    drawn = study.draws.values if study.draws else {}
    axes = []
    for path in study.paths:
        values = [r["parameters"].get(path) for r in records]
        axes.append(_axis(path, plain(study.labels.get(path, path)), values, drawn.get(path)))
    return [axis for axis in axes if len(axis.places) > 1]


def _axis(path: str, name: str, values: list[Any], how: Distribution | None) -> SweptAxis:
    drawn = how is not None
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        places, index = np.unique(np.array(values, dtype=np.float64), return_inverse=True)
        log = isinstance(how, LogUniform) or spans_decades(places)
        return SweptAxis(path, name, True, drawn, log, places, [f"{x:g}" for x in places], index)
    order = how.values if isinstance(how, Choice) else []
    keys = [_key(value) for value in values]
    seen = set(keys)
    names = [name for name in dict.fromkeys([*map(_key, order), *keys]) if name in seen]
    number = {name: k for k, name in enumerate(names)}
    short = [plain(_short(name)) for name in names]
    index = np.array([number[key] for key in keys], dtype=np.int64)
    return SweptAxis(path, name, False, drawn, False, np.arange(len(names), dtype=np.float64), short, index)


def _short(name: str) -> str:
    if len(name) <= _LONGEST_LABEL:
        return name
    kept = _LONGEST_LABEL - 1
    return "…" + name[-kept:] if name.endswith((".yaml", ".yml")) else name[:kept] + "…"  # paths differ at their ends


def _key(value: Any) -> str:
    return "as it is" if value is None else value if isinstance(value, str) else json.dumps(value)


def spans_decades(values: Array) -> bool:
    """Whether positive values differ so much that a logarithmic scale tells more."""
    known = values[np.isfinite(values)]
    return bool(known.size and known.min() > 0.0 and known.max() >= _DECADES * known.min())


def plain(text: str) -> str:
    """Text as matplotlib shows it letter by letter: between dollars it would be read as mathematics."""
    return text.replace("$", r"\$")


def plain_decades(axis: Any) -> None:
    """Give a logarithmic axis numbers that are written out, also between decades where these are few."""
    axis.set_major_locator(_Decades())
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_formatter(NullFormatter())


class _Decades(LogLocator):
    """Ticks at 1, 2 and 5 of each decade where there are at most two, else at the decades."""

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """The ticks between two ends."""
        self.set_params(subs=(1.0, 2.0, 5.0) if vmin > 0.0 and vmax <= 200.0 * vmin else (1.0,))
        return super().tick_values(vmin, vmax)
