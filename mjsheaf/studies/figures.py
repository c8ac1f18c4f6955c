"""Figures of a study, drawn by seaborn: errors against the swept fields, and the fraction of runs that finish."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.theorem.of_run import BROKEN
from mjsheaf.errors import shortened
from mjsheaf.files import SUFFIXES
from mjsheaf.results.metrics import MEASURES
from mjsheaf.show.plots import (
    HEADING,
    NORMAL,
    SMALL,
    TICK,
    WIDTH,
    figure_bytes,
    label_axes,
    legend_below,
    log_axis,
    new_figure,
    plain,
)
from mjsheaf.show.style import AS_USUAL, BLUE, RED, FigureOptions
from mjsheaf.studies.plan import Choice, LogUniform, StudyFile

_LABELS = {
    "mean_disagreement": "final disagreement, mean |η| (m)",
    "tracking_error": "final tracking error, RMS |q* − q| (m)",
    "formation_error": "final formation error, RMS residual (m)",
    "centering_error": "final centering error, largest (m)",
}
_RATIOS = {
    "bound_ratio": "largest |e| / (bound + accuracy), whole run (-)",
    "late_bound_ratio": "largest |e| / (bound + accuracy), second half (-)",
}
_ENDS = {True: "converged run", None: "run that was not judged", False: "run that has not converged"}
"""Ends of finished runs, by `settled`."""
_UNFINISHED = "run that did not finish"
_COLOURS = dict(zip(_ENDS.values(), (BLUE, "#555555", "#D55E00"), strict=True))
_MARKERS = dict(zip(_ENDS.values(), "osD", strict=True))
_MOST_LINES = 10  # maximum number of lines in a panel


@dataclass(frozen=True)
class SweptAxis:
    """A swept field with more than one value.

    Attributes:
        path: Path of the field; 'points' for named points.
        name: Name of the field in figures.
        numeric: True if all values are numbers.
        drawn: True if the values were drawn at random, so that few runs share a value.
        log: True if the axis is logarithmic.
        places: Positions of the distinct values on the axis, ascending, shape (K,). These are the values themselves if
            they are numeric, and 0 to K - 1 otherwise.
        labels: Labels of the distinct values.
        index: Index of each run's value among the distinct values, shape (R,).
    """

    path: str
    name: str
    numeric: bool
    drawn: bool
    log: bool
    places: Array
    labels: list[str]
    index: IntArray

    @property
    def step(self) -> int:
        """Step from one labelled value to the next: at most 12 have a label."""
        return -(-len(self.places) // 12)

    @property
    def upright(self) -> bool:
        """True if labels below a panel are rotated, because more than 32 letters do not fit side by side."""
        return not self.numeric and len("  ".join(self.labels[:: self.step])) > 32

    def label(self, panel: Any, which: str, places: NDArray[Any]) -> None:
        """Label an axis ('x' or 'y') of a panel, and put the values' labels at `places`."""
        shown = slice(None, None, self.step)
        turned = 90.0 if which == "x" and self.upright else 0.0
        getattr(panel, f"set_{which}label")(self.name, fontsize=NORMAL)
        getattr(panel, f"set_{which}ticks")(places[shown], self.labels[shown], rotation=turned, fontsize=TICK)


def swept_axes(study: StudyFile, records: list[dict[str, Any]]) -> list[SweptAxis]:
    """Return the swept fields that take more than one value, in the order of the study.

    If several fields always change together, the first one represents them.
    """
    columns = {path: [record["parameters"].get(path) for record in records] for path in study.paths}
    if study.names:
        runs = study.size // len(study.points)  # runs of one point; points change slowest
        listed = set(chain.from_iterable(study.points))
        others = {path: values for path, values in columns.items() if path not in listed}
        columns = {"points": [study.names[record["run"] // runs] for record in records], **others}
    axes = [_axis_of(study, path, values) for path, values in columns.items()]
    distinct = {(*axis.labels, *axis.index.tolist()): axis for axis in reversed(axes) if len(axis.places) > 1}
    return list(distinct.values())[::-1]


def _axis_of(study: StudyFile, path: str, values: list[Any]) -> SweptAxis:
    """Return the axis of a field, or of the named points; values other than numbers keep their order in the study."""
    draw = (study.draws.values if study.draws else {}).get(path)
    name = "" if path == "points" else plain(study.labels.get(path, path))
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        places, index = np.unique(np.array(values, dtype=np.float64), return_inverse=True)
        log = isinstance(draw, LogUniform) or _spans_decades(places)
        return SweptAxis(path, name, True, draw is not None, log, places, [f"{x:g}" for x in places], index)
    keys = [_key(value) for value in values]
    order = [_key(value) for value in draw.values] if isinstance(draw, Choice) else []
    names = [key for key in dict.fromkeys([*order, *keys]) if key in keys]
    index = pd.Index(names).get_indexer(keys).astype(np.int64)
    parts = [Path(name).name if name.endswith(SUFFIXES) else name for name in names]
    labels = [plain(part if path == "points" else shortened(part, 24)) for part in parts]  # characters
    return SweptAxis(path, name, False, draw is not None, False, np.arange(len(names), dtype=np.float64), labels, index)


def _key(value: Any) -> str:
    return "as given" if value is None else value if isinstance(value, str) else json.dumps(value)


def _spans_decades(values: Array) -> bool:
    """Return True for values on a logarithmic axis: positive, with a ratio of largest to smallest of at least 30."""
    known = values[np.isfinite(values)]
    return bool(known.size and known.min() > 0.0 and known.max() >= 30.0 * known.min())


def plot_study(
    study: StudyFile, name: str, records: list[dict[str, Any]], options: FigureOptions = AS_USUAL
) -> dict[str, bytes]:
    """Draw a study.

    Args:
        study: Contents of the study file. Its `measure` is drawn, or else every error that is defined.
        name: Name of the study, for titles.
        records: Records of all runs.
        options: Formats and style of the figures.

    Returns:
        Figures by file name, in each format: `error` if any run finished; `success` if any did not; `messages` if runs
        differ in the numbers that agents send; `over_time` for at most 10 runs with trajectories; and `bound`, a
        histogram of the ratio of errors to Theorem 1's bound, if the theorem applies to any run. One swept field gives
        a curve with its spread, two give a heat map, and more fields or random draws give a panel for each field. Runs
        that did not finish are marked at the lower edge of a curve.
    """
    axes = swept_axes(study, records)
    finished = np.array([r["status"] == "finished" for r in records])
    ends = np.array([_ENDS[r["settled"]] if r["status"] == "finished" else _UNFINISHED for r in records])
    measures = [study.measure] if study.measure else list(MEASURES)
    errors = _final_errors(study, measures, records)
    count = f"{len(finished)} runs" if finished.all() else f"{finished.sum()} of {len(finished)} runs finished"
    law = f", law {study.controller}" if study.controller else ""
    title = f"{name}   [{study.backend}{law}, {count}]" if options.title else ""
    success = {"fraction of runs that finish": finished.astype(np.float64)}
    figures = {
        "error": _draw(title, axes, errors, ends) if errors else None,
        "messages": _draw_messages(title, axes, errors, records),
        "bound": _draw_bound(title, records),
        "over_time": _draw_over_time(title, axes, measures, records),
        "success": None if finished.all() else _draw(title, axes, success, None),
    }
    return {
        f"{plot}.{form}": data
        for plot, figure in figures.items()
        if figure is not None
        for form, data in figure_bytes(figure, options).items()
    }


def _final_errors(study: StudyFile, measures: Sequence[str], records: list[dict[str, Any]]) -> dict[str, Array]:
    """Return the errors of all runs by label, NaN without one, for each measure that is defined in at least one run."""
    part = "late" if study.late else "final"
    rows = [(r[part] or {}) if r["status"] == "finished" else {} for r in records]
    table = pd.DataFrame(rows, columns=list(measures), dtype=np.float64).dropna(axis=1, how="all")
    late = "\nRMS over the second half"
    return {
        (_LABELS[name].removeprefix("final ") + late if study.late else _LABELS[name]): table[name].to_numpy()
        for name in table
    }


def _draw(title: str, axes: list[SweptAxis], values: dict[str, Array], ends: NDArray[np.str_] | None) -> Figure:
    """Draw panels for each kind of value: a heat map, a curve for each of the first six axes, or a distribution.

    A heat map has at most 40 cells along a side. Without `ends`, values are zeros and ones, and their fractions are
    drawn.
    """
    sizes = [len(axis.places) for axis in axes]
    cells = set(zip(*(axis.index.tolist() for axis in axes), strict=True))
    maps = len(axes) == 2 and max(sizes) <= 40 and len(cells) > 0.6 * sizes[0] * sizes[1]
    drawn: list[SweptAxis | None] = [None] if maps or not axes else list(axes[:6])
    columns = 1 if maps else len(drawn) if axes[1:] else 2
    below = 0.065 * max((len(max(axis.labels, key=len)) for axis in axes if axis.upright), default=0)
    figure, panels = _panels(len(values) * len(drawn), columns, title, below)
    for panel, (label, y, axis) in zip(panels, ((n, y, a) for n, y in values.items() for a in drawn), strict=True):
        if maps:
            _draw_map(panel, label, y, ends is None, axes)
        elif axis is None:
            _draw_distribution(panel, label, y, ends is None)
        else:
            _label_curve(panel, label, y, axis, shares=ends is None)
            over = " over all other fields and seeds" if len(axes) > 1 else ""
            _draw_shares(panel, axis, y) if ends is None else _draw_runs(panel, axis, y, ends, over)
    _share_legend(figure, panels)
    return figure


def _panels(count: int, columns: int, title: str, below: float = 0.0) -> tuple[Figure, list[Any]]:
    """Return a figure and its panels, in rows of at most `columns`, with extra height `below` each row, in."""
    columns = min(columns, count)
    rows = -(-count // columns)
    width = max(WIDTH if columns > 1 else 0.65 * WIDTH, 2.5 * columns)
    figure = new_figure(width, 0.6 + (2.7 + below) * rows, title)
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel in panels[count:]:
        panel.set_visible(False)
    return figure, panels[:count]


def _share_legend(figure: Figure, panels: list[Any], title: str | None = None) -> None:
    """Move the legends of the panels below the figure; converged runs alone need none."""
    handles: dict[str, Any] = {}
    for panel in panels:
        handles |= dict(zip(*panel.get_legend_handles_labels()[::-1], strict=True))
        if panel.get_legend():
            panel.get_legend().remove()
    if handles.keys() - {_ENDS[True]}:
        legend_below(figure, list(handles.values()), 6 if title else 3, title=title)


def _draw_over_time(
    title: str, axes: list[SweptAxis], measures: Sequence[str], records: list[dict[str, Any]]
) -> Figure | None:
    """Draw errors over time, one line per run; None for many runs, or without trajectories."""
    series = {_name_of_run(axes, k, r): pd.DataFrame(r["series"]) for k, r in enumerate(records) if r.get("series")}
    if not series or len(records) > _MOST_LINES:
        return None
    table = pd.concat(series, names=["run", None]).reset_index("run")
    drawn = [measure for measure in measures if table[measure].notna().any()]
    if not drawn:
        return None
    figure, panels = _panels(len(drawn), 1, title)
    figure.set_figwidth(WIDTH)
    for panel, measure in zip(panels, drawn, strict=True):
        label_axes(panel, "", "time (s)", _LABELS[measure].removeprefix("final "))
        known = table.astype({measure: np.float64})
        sns.lineplot(known, x="time", y=measure, hue="run", style="run", estimator=None, palette="colorblind", ax=panel)
        log_axis(panel, "y", known[measure].to_numpy())
    _share_legend(figure, panels)
    return figure


def _name_of_run(axes: list[SweptAxis], k: int, record: dict[str, Any]) -> str:
    """Return the values of the k-th run, and its status unless it finished."""
    named = [a.labels[a.index[k]] if a.path == "points" else f"{a.name}: {a.labels[a.index[k]]}" for a in axes]
    status = "" if record["status"] == "finished" else f" ({record['status']})"
    return (", ".join(named) or f"run {k}") + status


def _draw_messages(
    title: str, axes: list[SweptAxis], errors: dict[str, Array], records: list[dict[str, Any]]
) -> Figure | None:
    """Draw errors against the numbers that an agent sends per second; None if these do not differ.

    If exactly one swept field does not determine these numbers, each of its values gets a line.
    """
    sent = np.array([r["numbers_per_agent_second"] if r["status"] == "finished" else None for r in records], np.float64)
    if not errors or len(np.unique(sent[np.isfinite(sent)])) < 2:
        return None
    others = [a for a in axes if pd.Series(sent).groupby(a.index).nunique().max() > 1]
    lines = others[0] if len(others) == 1 and len(others[0].places) <= _MOST_LINES else None
    figure, panels = _panels(len(errors), 2, title)
    for panel, (label, y) in zip(panels, errors.items(), strict=True):
        label_axes(panel, "", "numbers that an agent sends (1/s)", label, which="major")
        if lines is None:
            sns.scatterplot(x=sent, y=y, color=BLUE, ax=panel)
        else:
            names = np.array(lines.labels)[lines.index]
            style = {"hue": names, "style": names, "markers": True, "estimator": None, "palette": "colorblind"}
            sns.lineplot(x=sent, y=y, ax=panel, **style)
        known = sent[np.isfinite(y) & np.isfinite(sent)]
        if known.min() > 0.0:
            log_axis(panel, "x", known)
        if _spans_decades(y):
            log_axis(panel, "y", y)
    _share_legend(figure, panels, lines.name if lines else None)
    return figure


def _draw_bound(title: str, records: list[dict[str, Any]]) -> Figure | None:
    """Draw a histogram of the ratio of errors to Theorem 1's bound, within it and beyond it; None if none is known."""
    known = {label: [r[ratio] for r in records if r.get(ratio) is not None] for ratio, label in _RATIOS.items()}
    ratios = {label: np.array(values) for label, values in known.items() if values}
    if not ratios:
        return None
    figure, panels = _panels(len(ratios), len(ratios), title)
    beyond = np.nextafter(BROKEN, 2.0)
    for panel, (label, values) in zip(panels, ratios.items(), strict=True):
        edges = np.linspace(values.min() - 0.02, values.max() + 0.02, min(60, 2 + int(np.sqrt(len(values)))))
        if edges[0] < beyond < edges[-1]:
            edges = np.union1d(edges, [beyond])  # no bar straddles the bound
        groups = {"run within the bound": (values < beyond, BLUE), "run beyond the bound": (values >= beyond, RED)}
        for name, (chosen, colour) in groups.items():
            if chosen.any():
                share = np.full(chosen.sum(), 1.0 / len(values))
                panel.hist(values[chosen], edges, weights=share, color=colour, label=name)
        panel.axvline(1.0, color="black", linewidth=1.2, linestyle="--", label="the bound of Theorem 1")
        heading = f"{len(values)} runs, {(values > BROKEN).sum()} beyond the bound"
        label_axes(panel, heading, label, "fraction of runs", which="major")
    _share_legend(figure, panels)
    return figure


def _label_curve(panel: Any, label: str, y: Array, axis: SweptAxis, *, shares: bool) -> None:
    """Label a panel with values against one field, and set its scales."""
    label_axes(panel, "", axis.name, label, which="major")
    if axis.log:
        log_axis(panel, "x", axis.places)
    elif axis.numeric:
        panel.xaxis.set_major_locator(MaxNLocator(5))
    else:
        axis.label(panel, "x", axis.places)
        panel.set_xlim(-0.5, len(axis.places) - 0.5)
    if shares:
        panel.set_ylim(-0.04, 1.04)
    elif _spans_decades(y):
        log_axis(panel, "y", y)


def _draw_runs(panel: Any, axis: SweptAxis, y: Array, ends: NDArray[np.str_], over: str) -> None:
    """Draw the median and range of values at each place, and a marker for each run by its end.

    Runs that did not finish are at the lower edge of the panel. `over` says what the range covers, if not only seeds.
    """
    x, known = axis.places[axis.index], np.isfinite(y)
    many = bool(known.sum() > 1.5 * len(axis.places))
    if not axis.drawn:
        style: dict[str, Any] = (
            {"linewidth": 1.8} if axis.numeric else {"linestyle": "", "marker": "_", "ms": 22, "mec": BLUE}
        )
        name = "median" if many else None
        sns.lineplot(x=x, y=y, estimator="median", errorbar=None, color=BLUE, label=name, ax=panel, **style)
        if many and axis.numeric:
            found = pd.Series(y).groupby(x).agg(["min", "max"]).dropna()
            band = {"color": BLUE, "alpha": 0.18, "linewidth": 0, "label": f"smallest to largest{over}"}
            panel.fill_between(found.index, found["min"], found["max"], **band)
    style = {"palette": _COLOURS, "markers": _MARKERS, "s": 25 if known.sum() <= 200 else 8}
    style |= {"hue_order": [end for end in _COLOURS if end in ends[known]]}
    faint = 0.55 if many else 1.0
    sns.scatterplot(x=x[known], y=y[known], hue=ends[known], style=ends[known], alpha=faint, ax=panel, **style)
    failed = x[ends == _UNFINISHED]
    if failed.size:
        sns.rugplot(x=failed, height=0.05, color="black", expand_margins=False, label=_UNFINISHED, ax=panel)
    panel.set(xlabel=axis.name)


def _draw_shares(panel: Any, axis: SweptAxis, y: Array) -> None:
    """Draw the mean of zeros and ones at each place, or in eight groups of equal size if values are drawn at random."""
    x = axis.places[axis.index]
    if not axis.numeric:
        sns.barplot(x=x, y=y, errorbar=None, color=BLUE, saturation=1.0, native_scale=True, width=0.6, ax=panel)
        return
    groups = pd.qcut(x, 8, labels=False, duplicates="drop") if axis.drawn else axis.index
    means = pd.DataFrame({"x": x, "y": y}).groupby(groups).agg({"x": "median", "y": "mean"})
    sns.lineplot(means, x="x", y="y", marker="o", color=BLUE, ax=panel)
    panel.set(xlabel=axis.name, ylabel=panel.get_ylabel())


def _draw_map(panel: Any, label: str, y: Array, shares: bool, axes: list[SweptAxis]) -> None:
    """Draw the median, or fraction, of the runs in each cell of two fields; a cell without a value is grey.

    Up to eight columns have their values in the cells.
    """
    across, up = axes
    cells = pd.Series(y).groupby([up.index, across.index]).agg("mean" if shares else "median").unstack()
    low, high = (0.0, 1.0) if shares else (np.nanmin(cells), np.nanmax(cells))
    log = not shares and _spans_decades(cells.to_numpy())
    norm: Normalize = LogNorm(low, high) if log else Normalize(low, high if high > low else low + 1.0)
    words = cells.map(lambda value: f"{value:.0%}" if shares else f"{value:.3g}")
    name = label if shares or len(y) <= cells.size else f"{label}, median"
    style = {"cmap": "viridis", "linewidths": 0.4, "xticklabels": False, "yticklabels": False, "fmt": ""}
    annotated = {"annot": words if cells.shape[1] <= 8 else None, "annot_kws": {"fontsize": SMALL}}
    panel.set_facecolor("#BBBBBB")
    bar = sns.heatmap(cells, norm=norm, ax=panel, **style, **annotated).collections[0].colorbar
    bar.set_label(name, fontsize=NORMAL)
    bar.ax.tick_params(labelsize=TICK)
    if log:
        ticks = np.geomspace(low, high, 5)
        bar.set_ticks(ticks, labels=[f"{x:.2g}" for x in ticks])
        bar.minorticks_off()
    panel.invert_yaxis()
    if cells.isna().any(axis=None):
        panel.set_title("grey: no run finished", fontsize=HEADING)
    across.label(panel, "x", np.arange(len(across.places)) + 0.5)
    up.label(panel, "y", np.arange(len(up.places)) + 0.5)


def _draw_distribution(panel: Any, label: str, y: Array, shares: bool) -> None:
    """Draw the distribution of values of runs that differ only in their seed."""
    panel.set_ylim(-0.02, 1.04)
    if shares:
        label_axes(panel, "", y="fraction of runs")
        sns.barplot(
            x=["finished", "did not"], y=[y.mean(), 1.0 - y.mean()], color=BLUE, saturation=1.0, width=0.6, ax=panel
        )
        return
    label_axes(panel, "", label, "fraction of runs at or below", which="major")
    sns.ecdfplot(x=y[np.isfinite(y)], color=BLUE, marker="o", markersize=4, ax=panel)
    if _spans_decades(y):
        log_axis(panel, "x", y)
