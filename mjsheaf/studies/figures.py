"""Plots of a study, which answer what was asked: error against what was swept, and how often runs end well."""

import io
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from numpy.typing import NDArray

from mjsheaf.plotting import new_figure
from mjsheaf.results.metrics import MEASURES
from mjsheaf.studies.figure_axis import SweptAxis, plain, plain_decades, spans_decades, swept_axes
from mjsheaf.studies.schema import StudyFile

Array = NDArray[np.float64]

_LABELS = {
    "mean_disagreement": "final disagreement, mean |η| (m)",
    "tracking_error": "final tracking error, RMS |q* − q| (m)",
    "formation_error": "final formation error, RMS residual (m)",
    "centering_error": "final centering error, largest (m)",
}
_LINE, _UNSETTLED, _FAILED = "#0072B2", "#D55E00", "#BBBBBB"
_SETTLED, _MOVING, _UNKNOWN = "run that has settled", "run that still changes at its end", "run too short to tell"
_UNFINISHED = "run that did not finish"
_MARKS: dict[str, dict[str, Any]] = {
    _SETTLED: {"color": _LINE},
    _UNKNOWN: {"color": "#555555"},
    _MOVING: {"color": _UNSETTLED, "markerfacecolor": "none"},
}
"""How runs that finished are marked, by how they ended."""
_LETTER = 0.068  # width of one in a legend, inches
_MOST_AXES = 6  # of the plots with a panel for each swept field
_MOST_CELLS = 40  # along a side of a heat map
_WRITTEN_CELLS = 14  # along a side, with their values in them
_BINS = 8


def plot_study(study: StudyFile, name: str, records: list[dict[str, Any]]) -> dict[str, bytes]:
    """Draw a study.

    Args:
        study: what was asked; its `measure` is drawn, or else every error that is defined.
        name: of the study, for titles.
        records: of all runs.

    Returns:
        PNG by file name: error.png where any run finished, success.png where any did not. One swept field gives a
        curve with its spread, two give a heat map, more (or random draws) a panel for each field. Runs that did not
        finish are marked at the lower edge of a curve.
    """
    axes = swept_axes(study, records)
    finished = np.array([r["status"] == "finished" for r in records])
    ends = np.array([_end_of(r) for r in records])
    errors = {}
    for measure in [study.measure] if study.measure else MEASURES:
        found = [(r["final"] or {}).get(measure) if r["status"] == "finished" else None for r in records]
        values = np.array([np.nan if x is None else x for x in found], dtype=np.float64)
        if np.isfinite(values).any():
            errors[measure] = values
    count = f"{len(records)} runs" if finished.all() else f"{finished.sum()} of {len(records)} runs finished"
    title = f"{plain(name)}   [{study.backend}, {count}]"
    plots = {}
    if errors:
        plots["error.png"] = _draw(title, axes, {_LABELS[m]: v for m, v in errors.items()}, ends)
    if not finished.all():
        rate = {"share of runs that finish": finished.astype(np.float64)}
        plots["success.png"] = _draw(title, axes, rate, None)
    return plots


def _end_of(record: dict[str, Any]) -> str:
    if record["status"] != "finished":
        return _UNFINISHED
    return {True: _SETTLED, False: _MOVING, None: _UNKNOWN}[record["settled"]]


def _draw(title: str, axes: list[SweptAxis], values: dict[str, Array], ends: NDArray[np.str_] | None) -> bytes:
    """Panels for each kind of value; without `ends` the values are zeros and ones, whose shares are drawn."""
    grid = len(axes) == 2 and _is_grid(axes)
    columns = 1 if grid or len(axes) < 2 else min(len(axes), _MOST_AXES)
    rows = len(values)
    if columns == 1 and rows > 1:  # several errors of one field: two beside each other
        columns, rows = 2, -(-rows // 2)
    figure = new_figure(max(7.5, 5.6 * columns), 1.0 + 4.2 * rows)
    figure.suptitle(title, fontsize=12)
    panels = figure.subplots(rows, columns, squeeze=False)
    each_axis = not grid and len(axes) > 1
    flat = panels.ravel() if not each_axis else None
    for k, (label, y) in enumerate(values.items()):
        if flat is None:
            for panel, axis in zip(panels[k], axes, strict=False):
                _marginal(panel, axis, label, y, ends, " over all other fields and seeds")
        elif grid:
            _heat_map(figure, flat[k], axes[0], axes[1], label, y, shares=ends is None)
        elif axes:
            _marginal(flat[k], axes[0], label, y, ends)
        else:
            _distribution(flat[k], label, y, shares=ends is None)
    for panel in flat[len(values) :] if flat is not None else []:
        panel.set_visible(False)
    legends = [panel.get_legend_handles_labels() for panel in panels.ravel()]
    told = {label: handle for legend in legends for handle, label in zip(*legend, strict=True)}
    if not told.keys() - {_SETTLED}:  # which needs no telling where there is nothing else
        told = {}
    lines = 0
    if told:
        wide = _LETTER * sum(len(label) + 8 for label in told) > figure.get_figwidth()
        lines = 2 if wide else 1
        columns = -(-len(told) // lines)
        figure.legend(told.values(), told.keys(), loc="lower center", ncols=columns, frameon=False, fontsize=9)
    figure.tight_layout(rect=(0, (0.1 + 0.25 * lines) / figure.get_figheight() if told else 0, 1, 0.98))
    # No metadata: a version or date would make equal studies differ.
    png = io.BytesIO()
    figure.savefig(png, format="png", metadata={"Software": None})
    return png.getvalue()


def _is_grid(axes: list[SweptAxis]) -> bool:
    """Whether two axes fill a table well enough to be drawn as one."""
    sizes = [len(axis.places) for axis in axes]
    if max(sizes) > _MOST_CELLS:
        return False
    filled = len(set(zip(*(axis.index.tolist() for axis in axes), strict=True)))
    return filled > 0.6 * sizes[0] * sizes[1]


def _groups(axis: SweptAxis, y: Array) -> list[Array]:
    """The known values at each place of an axis."""
    return [own[np.isfinite(own)] for own in (y[axis.index == k] for k in range(len(axis.places)))]


def _marginal(panel: Any, axis: SweptAxis, label: str, y: Array, ends: NDArray[np.str_] | None, over: str = "") -> None:
    """Values over one field; `over` says of what the band is the spread, where that is not the seeds alone."""
    axis.dress(panel)
    panel.set_ylabel(label)
    panel.grid(True, which="major", alpha=0.3)
    if ends is None:
        _shares(panel, axis, y)
        return
    known = np.isfinite(y)
    if spans_decades(y):
        panel.set_yscale("log")
        plain_decades(panel.yaxis)
    x = axis.places[axis.index]
    many = known.sum() > 1.5 * len(axis.places)
    if not axis.drawn:
        groups = _groups(axis, y)
        at = [k for k, group in enumerate(groups) if group.size]
        places = axis.places[at]
        median = [float(np.median(groups[k])) for k in at]
        panel.plot(
            places, median, color=_LINE, linewidth=1.8 if axis.numeric else 0.0, marker="_" if not axis.numeric else "",
            markersize=22, label="median" if many else None,
        )  # fmt: skip
        if many and axis.numeric:
            low, high = [groups[k].min() for k in at], [groups[k].max() for k in at]
            panel.fill_between(
                places, low, high, color=_LINE, alpha=0.18, linewidth=0, label=f"smallest to largest{over}"
            )
    size = 5.0 if known.sum() <= 200 else 2.5
    for end, mark in _MARKS.items():
        these = known & (ends == end)
        if these.any():
            hollow = end == _MOVING
            faint = 0.55 if many and not hollow else 1.0
            panel.plot(x[these], y[these], "o", markersize=size + hollow, alpha=faint, label=end, **mark)
    failed = ends == _UNFINISHED
    if failed.any():
        foot = np.full(failed.sum(), 0.02)  # of the panel's height
        edge = panel.get_xaxis_transform()
        panel.plot(x[failed], foot, "x", color="black", markersize=size, transform=edge, label=_UNFINISHED)


def _shares(panel: Any, axis: SweptAxis, y: Array) -> None:
    panel.set_ylim(-0.04, 1.04)
    if axis.numeric and axis.drawn:
        order = np.argsort(axis.places[axis.index], kind="stable")
        bins = [part for part in np.array_split(order, _BINS) if part.size]
        x = axis.places[axis.index]
        panel.plot([np.median(x[b]) for b in bins], [y[b].mean() for b in bins], "o-", color=_LINE)
        return
    share = [group.mean() for group in _groups(axis, y)]
    if axis.numeric:
        panel.plot(axis.places, share, "o-", color=_LINE)
    else:
        panel.bar(axis.places, share, width=0.6, color=_LINE)


def _heat_map(figure: Any, panel: Any, across: SweptAxis, up: SweptAxis, label: str, y: Array, *, shares: bool) -> None:
    """Median, or share, of the runs of every cell; a cell without a value is grey."""
    cells = np.full((len(up.places), len(across.places)), np.nan)
    for i in range(len(up.places)):
        for j in range(len(across.places)):
            own = y[(up.index == i) & (across.index == j)]
            own = own[np.isfinite(own)]
            if own.size:
                cells[i, j] = own.mean() if shares else np.median(own)
    known = cells[np.isfinite(cells)]
    low, high = (0.0, 1.0) if shares else (known.min(), known.max())
    log = not shares and spans_decades(cells)
    norm: Normalize = LogNorm(low, high) if log else Normalize(low, high if high > low else low + 1.0)
    panel.set_facecolor(_FAILED)
    if np.isnan(cells).any():
        panel.set_title("grey: no run finished", fontsize=9)
    mesh = panel.pcolormesh(np.ma.masked_invalid(cells), norm=norm, cmap="viridis", edgecolors="white", linewidth=0.4)
    several = len(y) > cells.size and not shares
    figure.colorbar(mesh, ax=panel, label=label + (", median" if several else ""))
    for which, axis in (("x", across), ("y", up)):
        step = -(-len(axis.places) // 12)
        ticks, shown = np.arange(len(axis.places))[::step] + 0.5, axis.labels[::step]
        getattr(panel, f"set_{which}ticks")(ticks, shown, rotation=axis.rotation(shown) if which == "x" else 0.0)
        getattr(panel, f"set_{which}label")(axis.name)
    if max(cells.shape) <= _WRITTEN_CELLS:
        for (i, j), value in np.ndenumerate(cells):
            if np.isfinite(value):
                dark = norm(value) < 0.6
                panel.text(
                    j + 0.5, i + 0.5, f"{100 * value:.0f}%" if shares else _two_digits(value), ha="center", va="center",
                    fontsize=8, color="white" if dark else "black",
                )  # fmt: skip


def _two_digits(value: float) -> str:
    return f"{value:.0f}" if 10.0 <= abs(value) < 1e5 else f"{value:.2g}"


def _distribution(panel: Any, label: str, y: Array, *, shares: bool) -> None:
    """Nothing but the seed differs: how the values are spread."""
    panel.grid(True, which="major", alpha=0.3)
    if shares:
        panel.bar([0, 1], [y.mean(), 1.0 - y.mean()], color=[_LINE, _UNSETTLED], width=0.6)
        panel.set_xticks([0, 1], ["finished", "did not"])
        panel.set_ylabel("share of runs")
        panel.set_ylim(0.0, 1.04)
        return
    x = np.sort(y[np.isfinite(y)])
    panel.step(np.concatenate([x[:1], x]), np.linspace(0.0, 1.0, len(x) + 1), where="post", color=_LINE)
    panel.plot(x, np.arange(1, len(x) + 1) / len(x), "o", color=_LINE, markersize=4)
    if spans_decades(x):
        panel.set_xscale("log")
        plain_decades(panel.xaxis)
    panel.set_xlabel(label)
    panel.set_ylabel("share of runs at or below")
    panel.set_ylim(-0.02, 1.04)
