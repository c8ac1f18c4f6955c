"""Figures of a study: errors against the swept fields, and the fraction of runs that finish."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.theorem.of_run import BROKEN
from mjsheaf.files import SUFFIXES
from mjsheaf.results.metrics import MEASURES
from mjsheaf.show.panels import (
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
    settle,
)
from mjsheaf.show.style import AS_USUAL, BLUE, RED, FigureOptions, line_style
from mjsheaf.studies.plan import Choice, LogUniform, StudyFile

Ends = NDArray[np.str_] | None
"""Description of each run's end."""

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
_MOST_BINS, _NARROWEST = 60, 0.02
_GREY = "#BBBBBB"
_SETTLED, _UNFINISHED = "converged run", "run that did not finish"
_MARKS: dict[bool | None, tuple[str, dict[str, Any]]] = {
    True: (_SETTLED, {"color": BLUE}),
    None: ("run too short to judge", {"color": "#555555"}),
    False: ("run that has not converged", {"color": "#D55E00", "markerfacecolor": "none"}),
}
"""Markers of finished runs, keyed by `settled`."""
_DECADES = 30.0  # ratio of largest to smallest value at or above which an axis is logarithmic
_MOST_LINES = 10  # maximum number of lines in a panel
_MOST_AXES = 6  # maximum number of swept fields that get a panel each
_MOST_CELLS = 40  # maximum number of cells along a side of a heat map
_MOST_TICKS = 12  # maximum number of tick labels
_LONGEST_TICK = 24  # maximum number of characters in a tick label
_UNROTATED = 32  # maximum number of characters of all tick labels together, unless they are upright
_PANEL = 2.5  # minimum width of a panel, in


@dataclass(frozen=True)
class SweptAxis:
    """A swept field with more than one value.

    Attributes:
        path: Path of the field.
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

    def alike(self, other: "SweptAxis") -> bool:
        """Return True if both fields partition the runs in the same way and have the same labels."""
        return self.labels == other.labels and np.array_equal(self.index, other.index)

    def label(self, panel: Any, which: str, places: NDArray[Any]) -> None:
        """Label an axis ('x' or 'y') of a panel, and put the values' labels at `places`."""
        step, rotation = -(-len(places) // _MOST_TICKS), 90.0 if which == "x" and self.upright else 0.0
        getattr(panel, f"set_{which}label")(self.name, fontsize=NORMAL)
        getattr(panel, f"set_{which}ticks")(places[::step], self.labels[::step], rotation=rotation, fontsize=TICK)

    @property
    def upright(self) -> bool:
        """True if the labels of the values are rotated below a panel, because they do not fit side by side."""
        shown = self.labels[:: -(-len(self.places) // _MOST_TICKS)]
        return sum(map(len, shown)) + 2 * len(shown) > _UNROTATED


def swept_axes(study: StudyFile, records: list[dict[str, Any]]) -> list[SweptAxis]:
    """Return the swept fields that take more than one value, in the order of the study.

    If several fields always change together, the first one represents them.
    """
    listed = set(chain.from_iterable(study.points)) if study.names else set()
    axes = [_axis_of_points(study, records)] if study.names else []
    axes += [_axis_of_field(study, records, path) for path in study.paths if path not in listed]
    distinct: list[SweptAxis] = []
    for axis in axes:
        if len(axis.places) > 1 and not any(axis.alike(other) for other in distinct):
            distinct.append(axis)
    return distinct


def _axis_of_points(study: StudyFile, records: list[dict[str, Any]]) -> SweptAxis:
    """Return the axis of the named points of a study."""
    runs = study.size // len(study.points)  # runs of one point; points change slowest
    index = np.array([record["run"] // runs for record in records], dtype=np.int64)
    places = np.arange(len(study.names), dtype=np.float64)
    return SweptAxis("points", "", False, False, False, places, [plain(name) for name in study.names], index)


def _axis_of_field(study: StudyFile, records: list[dict[str, Any]], path: str) -> SweptAxis:
    """Return the axis of a field."""
    values = [record["parameters"].get(path) for record in records]
    draw = (study.draws.values if study.draws else {}).get(path)
    numeric = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    axis_of = _axis_of_numbers if numeric else _axis_of_choices
    return axis_of(path, plain(study.labels.get(path, path)), values, draw)


def _axis_of_numbers(path: str, name: str, values: list[Any], draw: Any) -> SweptAxis:
    """Return the axis of a field whose values are numbers, drawn as `draw` says if it is not None."""
    places, index = np.unique(np.array(values, dtype=np.float64), return_inverse=True)
    log = isinstance(draw, LogUniform) or _spans_decades(places)
    return SweptAxis(path, name, True, draw is not None, log, places, [f"{x:g}" for x in places], index)


def _axis_of_choices(path: str, name: str, values: list[Any], draw: Any) -> SweptAxis:
    """Return the axis of a field with other values, in the order of `draw` if that lists them."""
    keys = [_key(value) for value in values]
    order = [_key(value) for value in draw.values] if isinstance(draw, Choice) else []
    names = list(dict.fromkeys([*(key for key in order if key in keys), *keys]))
    index = np.array([names.index(key) for key in keys])
    labels = [plain(_shortened(name)) for name in names]
    return SweptAxis(path, name, False, draw is not None, False, np.arange(len(names), dtype=np.float64), labels, index)


def _key(value: Any) -> str:
    return "as given" if value is None else value if isinstance(value, str) else json.dumps(value)


def _shortened(name: str) -> str:
    if len(name) <= _LONGEST_TICK:
        return name
    kept = _LONGEST_TICK - 1
    return "…" + name[-kept:] if name.endswith(SUFFIXES) else name[:kept] + "…"  # paths differ at their ends


def _spans_decades(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return bool(known.size and known.min() > 0.0 and known.max() >= _DECADES * known.min())


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
    ends = np.array([_MARKS[r["settled"]][0] if r["status"] == "finished" else _UNFINISHED for r in records])
    errors = _final_errors(study, records)
    title = _title_of(study, name, finished) if options.title else ""
    success = {"fraction of runs that finish": finished.astype(np.float64)}
    figures = {
        "error": _draw(title, axes, errors, ends) if errors else None,
        "messages": _draw_messages(title, axes, errors, records),
        "bound": _draw_bound(title, records),
        "over_time": _draw_over_time(title, axes, _measures_of(study), records),
        "success": None if finished.all() else _draw(title, axes, success, None),
    }
    return {
        f"{plot}.{form}": data
        for plot, figure in figures.items()
        if figure is not None
        for form, data in figure_bytes(figure, options).items()
    }


def _measures_of(study: StudyFile) -> Sequence[str]:
    """Return the measures that a study draws."""
    return [study.measure] if study.measure else MEASURES


def _of_finished(records: list[dict[str, Any]], read: Callable[[dict[str, Any]], float | None]) -> Array:
    """Return one number per run, NaN if it is undefined or the run did not finish."""
    return np.array([read(r) if r["status"] == "finished" else None for r in records], dtype=np.float64)


def _final_errors(study: StudyFile, records: list[dict[str, Any]]) -> dict[str, Array]:
    """Return the errors of all runs by label, for each measure that is defined in at least one run."""
    when = "late" if study.late else "final"
    errors = {}
    for measure in _measures_of(study):
        values = _of_finished(records, lambda record, measure=measure: (record[when] or {}).get(measure))  # type: ignore[misc]
        if np.isfinite(values).any():
            label = _LABELS[measure]
            errors[f"{label.removeprefix('final ')}\nRMS over the second half" if study.late else label] = values
    return errors


def _title_of(study: StudyFile, name: str, finished: NDArray[np.bool_]) -> str:
    """Return the title of a study's figures."""
    count = f"{len(finished)} runs" if finished.all() else f"{finished.sum()} of {len(finished)} runs finished"
    law = f", law {study.controller}" if study.controller else ""
    return f"{name}   [{study.backend}{law}, {count}]"


def _draw(title: str, axes: list[SweptAxis], values: dict[str, Array], ends: Ends) -> Figure:
    """Draw panels for each kind of value; without `ends`, values are zeros and ones and their fractions are drawn."""
    kinds = _kinds_of_panels(axes)
    upright = [len(max(axis.labels, key=len)) for axis in axes if axis.upright and not axis.numeric]
    columns = len(kinds) if len(kinds) > 1 else min(len(values), 2)
    figure, panels = _panels(len(values) * len(kinds), columns, title, 0.065 * max(upright, default=0))
    for panel, ((label, y), kind) in zip(panels, product(values.items(), kinds), strict=True):
        kind(panel, label, y, ends)
    handles = _handles_of(panels)
    if handles.keys() - {_SETTLED}:  # converged runs alone need no legend
        legend_below(figure, list(handles.values()), 3)
    settle(figure)
    for panel in panels:
        _drop_what_does_not_fit(panel)
    return figure


def _kinds_of_panels(axes: list[SweptAxis]) -> list[Callable[..., None]]:
    """Return the functions that draw the panels of a value: a heat map, a curve for each axis, or a distribution."""
    if not axes:
        return [_distribution]
    if len(axes) == 2 and _fill_a_grid(axes):
        return [partial(_heat_map, axes=axes)]
    over = " over all other fields and seeds" if len(axes) > 1 else ""
    return [partial(_marginal, axis=axis, over=over) for axis in axes[:_MOST_AXES]]


def _panels(count: int, columns: int, title: str, below: float = 0.0) -> tuple[Figure, list[Any]]:
    """Return a figure and its panels, in rows of `columns`, with extra height `below` each row, in."""
    rows = -(-count // columns)
    width = max(WIDTH if columns > 1 else 0.65 * WIDTH, _PANEL * columns)
    figure = new_figure(width, 0.6 + (2.7 + below) * rows, title)
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel in panels[count:]:
        panel.set_visible(False)
    return figure, panels[:count]


def _drop_what_does_not_fit(panel: Any) -> None:
    """Remove the text in the cells of a heat map if any of it is larger than a cell."""
    cells = [text for text in panel.texts if text.get_gid() == "cell"]
    renderer = panel.figure.canvas.get_renderer()
    (left, low), (right, high) = panel.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    sizes = [text.get_window_extent(renderer) for text in cells]
    if any(size.width > right - left or size.height > high - low for size in sizes):
        for text in cells:
            text.remove()


def _draw_over_time(
    title: str, axes: list[SweptAxis], measures: Sequence[str], records: list[dict[str, Any]]
) -> Figure | None:
    """Draw errors over time, one line per run; None for many runs, or without trajectories."""
    known = {k: r["series"] for k, r in enumerate(records) if r.get("series")}
    if not known or len(records) > _MOST_LINES:
        return None
    drawn = [m for m in measures if _is_defined(m, known.values())]
    figure = new_figure(WIDTH, 0.8 + 2.2 * len(drawn), title)
    panels = figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
    for panel, measure in zip(panels, drawn, strict=True):
        for k, series in known.items():
            _draw_line(panel, series["time"], series[measure], k, _name_of_run(axes, k, records[k]))
        log_axis(panel, "y", np.concatenate([line.get_ydata() for line in panel.lines]))
        label_axes(panel, "", y=_LABELS[measure].removeprefix("final "))
    panels[-1].set_xlabel("time (s)", fontsize=NORMAL)
    legend_below(figure, panels[0].get_legend_handles_labels()[0], 3)
    return figure


def _is_defined(measure: str, series: Iterable[dict[str, Any]]) -> bool:
    """Return True if a measure has a value in some series."""
    return any(value is not None for each in series for value in each[measure])


def _draw_line(panel: Any, time: list[float], values: list[float | None], k: int, label: str) -> None:
    y = np.array(values, dtype=np.float64)
    marked = {} if np.isfinite(y).any() else {"markevery": None}  # markers cannot be spaced along an empty line
    panel.plot(time, y, label=label, **line_style(k) | marked)


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
    sent = _of_finished(records, lambda record: record.get("numbers_per_agent_second"))
    if not errors or len(np.unique(sent[np.isfinite(sent)])) < 2:
        return None
    others = [a for a in axes if pd.Series(sent).groupby(a.index).nunique().max() > 1]
    lines = others[0] if len(others) == 1 and len(others[0].places) <= _MOST_LINES else None
    figure, panels = _panels(len(errors), min(len(errors), 2), title)
    for panel, (label, y) in zip(panels, errors.items(), strict=True):
        label_axes(panel, "", "numbers that an agent sends (1/s)", label, which="major")
        _draw_against(panel, sent, y, lines)
    if lines:
        legend_below(figure, panels[0].get_legend_handles_labels()[0], 6, title=lines.name)
    return figure


def _draw_against(panel: Any, x: Array, y: Array, lines: SweptAxis | None) -> None:
    """Draw the values of runs against others: a line for each value of a field, or points alone."""
    known = np.isfinite(y) & np.isfinite(x)
    runs = {"": known} if lines is None else {name: known & (lines.index == k) for k, name in enumerate(lines.labels)}
    for k, (name, chosen) in enumerate(runs.items()):
        own = np.flatnonzero(chosen)
        own = own[np.argsort(x[own], kind="stable")]
        style = line_style(k) | {"markevery": None} | ({} if lines else {"linestyle": ""})
        panel.plot(x[own], y[own], label=name or None, **style)
    if x[known].min() > 0.0:
        log_axis(panel, "x", x[known])
    if _spans_decades(y[known]):
        log_axis(panel, "y", y[known])


def _draw_bound(title: str, records: list[dict[str, Any]]) -> Figure | None:
    """Draw a histogram of the ratio of errors to Theorem 1's bound; None if none is known."""
    known = {label: [r[ratio] for r in records if r.get(ratio) is not None] for ratio, label in _RATIOS.items()}
    ratios = {label: np.array(values) for label, values in known.items() if values}
    if not ratios:
        return None
    figure, panels = _panels(len(ratios), len(ratios), title)
    for panel, (label, values) in zip(panels, ratios.items(), strict=True):
        _draw_histogram(panel, label, values)
    legend_below(figure, list(_handles_of(panels).values()), 3)
    return figure


def _draw_histogram(panel: Any, label: str, known: Array) -> None:
    """Draw a histogram of ratios of errors to the bound, within it and beyond it."""
    middle = 0.5 * (known.min() + known.max())
    half = max(0.5 * np.ptp(known), _NARROWEST)
    edges = np.linspace(middle - half, middle + half, min(_MOST_BINS, 2 + int(np.sqrt(len(known)))))
    beyond = np.nextafter(BROKEN, 2.0)
    edges = np.union1d(edges, [beyond]) if edges[0] < beyond < edges[-1] else edges  # no bar straddles the bound
    counts, _ = np.histogram(known, edges)
    within = edges[1:] <= beyond
    for these, colour, name in ((within, BLUE, "run within the bound"), (~within, RED, "run beyond the bound")):
        if counts[these].any():
            heights = counts[these] / len(known)
            panel.bar(edges[:-1][these], heights, np.diff(edges)[these], align="edge", color=colour, label=name)
    panel.axvline(1.0, color="black", linewidth=1.2, linestyle="--", label="the bound of Theorem 1")
    heading = f"{len(known)} runs, {(known > BROKEN).sum()} beyond the bound"
    label_axes(panel, heading, label, "fraction of runs", which="major")


def _handles_of(panels: Iterable[Any]) -> dict[str, Any]:
    """Return the legend handles of several panels by label."""
    return {label: handle for panel in panels for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)}


def _fill_a_grid(axes: list[SweptAxis]) -> bool:
    """Return True if the runs fill enough cells of two axes for a heat map."""
    sizes = [len(axis.places) for axis in axes]
    filled = len(set(zip(*(axis.index.tolist() for axis in axes), strict=True)))
    return max(sizes) <= _MOST_CELLS and filled > 0.6 * sizes[0] * sizes[1]


def _marginal(panel: Any, label: str, y: Array, ends: Ends, axis: SweptAxis, over: str) -> None:
    """Draw values against one field; `over` says what the band covers if that is not only the seeds."""
    label_axes(panel, "", axis.name, label, which="major")
    if axis.log:
        log_axis(panel, "x", axis.places)
    elif axis.numeric:
        panel.xaxis.set_major_locator(MaxNLocator(5))
    if not axis.numeric:
        axis.label(panel, "x", axis.places)
        panel.set_xlim(-0.5, len(axis.places) - 0.5)
    if ends is None:
        _shares(panel, axis, y)
        return
    if _spans_decades(y):
        log_axis(panel, "y", y)
    many = bool(np.isfinite(y).sum() > 1.5 * len(axis.places))
    if not axis.drawn:
        _draw_median(panel, axis, y, over if many else None)
    _draw_runs(panel, axis, y, ends, many)


def _draw_median(panel: Any, axis: SweptAxis, y: Array, over: str | None) -> None:
    """Draw the median of runs at each value of a field and, unless `over` is None, the band that holds all of them."""
    found = pd.Series(y).groupby(axis.index).agg(["median", "min", "max"]).dropna()
    places = axis.places[found.index]
    style = {"linewidth": 1.8} if axis.numeric else {"linewidth": 0.0, "marker": "_", "markersize": 22}
    panel.plot(places, found["median"], color=BLUE, label=None if over is None else "median", **style)
    if over is not None and axis.numeric:
        band = {"color": BLUE, "alpha": 0.18, "linewidth": 0}
        panel.fill_between(places, found["min"], found["max"], label=f"smallest to largest{over}", **band)


def _draw_runs(panel: Any, axis: SweptAxis, y: Array, ends: NDArray[np.str_], many: bool) -> None:
    """Draw a marker for each run by its end; those that did not finish are at the lower edge of the panel."""
    known = np.isfinite(y)
    x = axis.places[axis.index]
    size = 5.0 if known.sum() <= 200 else 2.5
    for end, style in _MARKS.values():
        these = known & (ends == end)
        if these.any():
            hollow = "markerfacecolor" in style
            faint = 0.55 if many and not hollow else 1.0
            panel.plot(x[these], y[these], "o", markersize=size + hollow, alpha=faint, label=end, **style)
    failed = x[ends == _UNFINISHED]
    if failed.size:  # whatever the scale of errors
        foot = {"transform": panel.get_xaxis_transform(), "color": "black", "markersize": size}
        panel.plot(failed, np.full(failed.size, 0.02), "x", label=_UNFINISHED, **foot)


def _shares(panel: Any, axis: SweptAxis, y: Array) -> None:
    """Draw the mean of zeros and ones at each value, or in eight bins if the values were drawn at random."""
    found, group = pd.DataFrame({"x": axis.places[axis.index], "y": y}), axis.index
    if axis.numeric and axis.drawn:
        found = found.sort_values("x", kind="stable")
        group = np.repeat(np.arange(8), [part.size for part in np.array_split(y, 8)])
    found = found.groupby(group).agg({"x": "median", "y": "mean"})
    panel.set_ylim(-0.04, 1.04)
    if axis.numeric:
        panel.plot(found["x"], found["y"], "o-", color=BLUE)
    else:
        panel.bar(found["x"], found["y"], width=0.6, color=BLUE)


def _heat_map(panel: Any, label: str, y: Array, ends: Ends, axes: list[SweptAxis]) -> None:
    """Draw the median, or fraction, of the runs in each cell; a cell without a value is grey."""
    across, up = axes
    shares = ends is None
    cells = pd.Series(y).groupby([up.index, across.index]).agg("mean" if shares else "median").unstack().to_numpy()
    low, high = (0.0, 1.0) if shares else (np.nanmin(cells), np.nanmax(cells))
    log = not shares and _spans_decades(cells)
    norm: Normalize = LogNorm(low, high) if log else Normalize(low, high if high > low else low + 1.0)
    panel.set_facecolor(_GREY)
    if np.isnan(cells).any():
        panel.set_title("grey: no run finished", fontsize=HEADING)
    mesh = panel.pcolormesh(np.ma.masked_invalid(cells), norm=norm, cmap="viridis", edgecolors="white", linewidth=0.4)
    bar = panel.figure.colorbar(mesh, ax=panel)
    bar.set_label(label if shares or len(y) <= cells.size else f"{label}, median", fontsize=NORMAL)
    bar.ax.tick_params(labelsize=TICK)
    across.label(panel, "x", np.arange(len(across.places)) + 0.5)
    up.label(panel, "y", np.arange(len(up.places)) + 0.5)
    _write_in_cells(panel, cells, norm, "{:.0%}" if shares else "")


def _write_in_cells(panel: Any, cells: Array, norm: Normalize, form: str) -> None:
    """Write the values of a heat map into its cells in a form; an empty one stands for the shortest."""
    place = {"ha": "center", "va": "center", "gid": "cell", "in_layout": False}
    for (i, j), value in np.ndenumerate(cells):
        if np.isfinite(value):
            shortest = "{:.0f}" if 10.0 <= abs(value) < 1e5 else "{:.2g}"
            colour = "white" if norm(value) < 0.6 else "black"
            panel.text(j + 0.5, i + 0.5, (form or shortest).format(value), fontsize=SMALL, color=colour, **place)


def _distribution(panel: Any, label: str, y: Array, ends: Ends) -> None:
    """Draw the distribution of values of runs that differ only in their seed."""
    if ends is None:
        panel.bar(["finished", "did not"], [y.mean(), 1.0 - y.mean()], color=[BLUE, _GREY], width=0.6)
        label_axes(panel, "", y="fraction of runs")
        panel.set_ylim(-0.02, 1.04)
        return
    label_axes(panel, "", label, "fraction of runs at or below", which="major")
    panel.set_ylim(-0.02, 1.04)
    panel.ecdf(y[np.isfinite(y)], color=BLUE, marker="o", markersize=4)
    if _spans_decades(y):
        log_axis(panel, "x", y)
