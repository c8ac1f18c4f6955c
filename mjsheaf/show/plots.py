"""The figures of a run, and the style of all figures: size, fonts, colours (the same in videos), labels, file formats.

The figures of a run are errors over time and by agent, trajectories, first and last configuration.

Figures are drawn at the width of two columns of a journal, with the font size of the printed page. Groups differ by
colour, marker and dash at once, so they remain distinct without colour. Labels never overlap.

Matplotlib's object interface is used throughout: no global state, no display.
"""

import io
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill, wrap
from typing import IO, Any

import numpy as np
import xarray as xr
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import isotonic_regression

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.law.obstacles import HALF_SPACE, ObstacleArrays, centres
from mjsheaf.results.metrics import law_in_words, mean_known, phases_in
from mjsheaf.results.store import thin
from mjsheaf.show.played import joined
from mjsheaf.show.solids import farthest, outline
from mjsheaf.show.style import (
    AS_USUAL,
    DASHES,
    LOST,
    MATPLOTLIB,
    OBSTACLE,
    VIEW,
    FigureOptions,
    groups_of,
    marker_of,
)
from mjsheaf.team import Team

# -- style of all figures ----------------------------------------------------------------------------------------------

WIDTH = 7.16
"""Width of two columns, in."""
HEADING, NORMAL, TICK, SMALL = 9.5, 8.0, 7.5, 7.0
"""Sizes of type, pt."""

_EDGES: dict[str, dict[str, Any]] = {
    "communication": {"color": "#8A94A6", "linestyle": "-"},
    "sensing": {"color": "#B45309", "linestyle": ":"},
}
MOST_NAMED = 60
"""Vehicles of a team whose names are drawn; of more, only the targets' and those of the worst agents are."""
_MOST_KEYS = 12  # groups in a legend


def new_figure(width: float, height: float, title: str, options: FigureOptions = AS_USUAL) -> Figure:
    """A figure of the given size in inches, with its title; panels and legends get the room that they need."""
    figure = Figure((width, height), dpi=150, layout=ConstrainedLayoutEngine(h_pad=0.06, w_pad=0.06))
    FigureCanvasAgg(figure)
    if options.title and title:
        figure.suptitle(fill(title, int(width * 13)), fontsize=10.5, parse_math=False)
    return figure


def plain(text: str) -> str:
    """Return text that a label or a legend shows letter by letter.

    Between dollars it would be read as mathematics; a legend leaves out what begins with an underscore.
    """
    return (" " if text.startswith("_") else "") + text.replace("$", r"\$")


def settle(figure: Figure) -> None:
    """Fix where everything is, so that names can be placed; what is added later takes no more room."""
    if figure.get_layout_engine() is not None:
        lay_out(figure)
        with rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
            figure.set_layout_engine(None)  # that of these settings, which is none; "none" makes savefig draw twice


def lay_out(figure: Figure) -> None:
    """Give panels and legends their places, without drawing anything."""
    engine: Any = figure.get_layout_engine()
    engine.execute(figure)
    for axis in figure.axes:
        axis.apply_aspect()


def write_figure(figure: Figure, file: Path | IO[bytes], form: str) -> None:
    """Write a figure in one format; equal figures give equal bytes."""
    # Type that journals take (TrueType in PDF) and that editors can change (text in SVG); ids that stay the same.
    settings: Any = {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "mjsheaf"}
    # A version or a date would make equal runs differ.
    without = {"png": ["Software"], "svg": ["Date", "Creator"], "pdf": ["CreationDate", "Creator", "Producer"]}
    with MATPLOTLIB, rc_context(settings):
        settle(figure)
        figure.savefig(file, format=form, metadata=dict.fromkeys(without[form]))


def save_figure(figure: Figure, path: Path, options: FigureOptions) -> None:
    """Write a figure in each format; the suffix of `path` gives way to theirs."""
    for file in options.paths(path):
        write_figure(figure, file, file.suffix[1:])


def figure_bytes(figure: Figure, options: FigureOptions) -> dict[str, bytes]:
    """A figure in each format, by the format's name."""
    found = {}
    for form in options.formats:
        buffer = io.BytesIO()
        write_figure(figure, buffer, form)
        found[form] = buffer.getvalue()
    return found


def label_axes(axis: Any, title: str, x: str = "", y: str = "", **grid: Any) -> None:
    """Give a panel its title, labels and a pale grid, and open it above and at the right."""
    axis.set_title(title, fontsize=HEADING)
    axis.set_xlabel(x, fontsize=NORMAL)
    axis.set_ylabel(y, fontsize=NORMAL)
    axis.tick_params(labelsize=TICK, length=3)
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(True, alpha=0.3, linewidth=0.6, **grid)
    axis.set_axisbelow(True)


def key(label: str, **style: Any) -> Line2D:
    """A row of a legend; without a `linestyle` a marker has no line."""
    return Line2D([], [], label=label, **({"linestyle": ""} if "marker" in style else {}) | style)


def group_keys(groups: NDArray[np.int64], names: list[str], colours: Array, *, lines: bool = True) -> list[Line2D]:
    """The rows of a legend for the groups of `groups_of` that are there; of very many, the first ones."""
    there = sorted(set(groups.tolist()))
    targets = [k for k in there if names[k] == "targets"]
    agents = [k for k in there if k not in targets]
    keys = []
    for k in [*agents[:_MOST_KEYS], *targets]:
        style: dict[str, Any] = {"marker": marker_of(k, names), "markersize": 7 if k in targets else 5}
        if lines:
            style |= {"linestyle": (0, (4, 1.5)) if k in targets else "-", "linewidth": 1.1}
        keys.append(key(names[k], color=colours[k], **style))
    if len(agents) > _MOST_KEYS:
        keys.insert(_MOST_KEYS, key(f"and {len(agents) - _MOST_KEYS} more groups", linestyle=""))
    return keys


def edge_keys(*teams: Team) -> list[Line2D]:
    """The rows of a legend for the edges of `draw_team`."""
    one_way = {"one way, to the agent that is sensed": _EDGES["communication"] | _HEAD}
    styles = _EDGES | (one_way if any(team.directed for team in teams) else {})
    return [key(kind, linewidth=1.0, **style) for kind, style in styles.items()]


def legend_below(figure: Figure, keys: Sequence[Any], columns: int, **style: Any) -> None:
    """Add a legend below the panels of a figure, which grows by it; with as many columns as there is room for."""
    longest = 90 if len(keys) <= 2 * columns else 30  # letters of a name
    names = [str(item.get_label()) for item in keys]
    names = [name if len(name) <= longest else name[: longest - 1] + "…" for name in names]
    for most in range(min(columns, len(keys)), 0, -1):
        count = -(-len(keys) // -(-len(keys) // most))  # rows of about one length
        legend = figure.legend(
            keys, names, ncols=count, frameon=False, fontsize=NORMAL, title_fontsize=NORMAL, columnspacing=1.5,
            handlelength=2.6, loc="outside lower center", **style,
        )  # fmt: skip
        size = legend.get_window_extent()
        if count == 1 or size.width <= figure.bbox.width:
            figure.set_figheight(figure.get_figheight() + size.height / figure.dpi)
            return
        legend.remove()


def finish_map(axis: Any, title: str, x: str, margin: float) -> None:
    """Make a panel a map seen from above, of equal scales, with a margin, as a part of its size."""
    label_axes(axis, title, x, "y (m)")
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(margin)
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))


_HEAD: dict[str, Any] = {"marker": (3, 0, -90.0), "markersize": 6.0, "markeredgewidth": 0.0}


def draw_team(axis: Any, team: Team, place: Array) -> NDArray[np.int64]:
    """Draw a team from above: edges, agents in the colours of their groups, targets as stars; `place` (V, 2) in m.

    Absent agents are grey, and left out where they are farther from the middle than all others.

    Returns:
        Which vehicles are drawn, for `place_names`.
    """
    for kind, edges in (("communication", team.communication), ("sensing", team.sensing)):
        lines = [place[[team.index[e.tail], team.index[e.head]]] for e in edges]
        width = 0.9 if len(edges) <= 2 * MOST_NAMED else 0.4
        axis.add_collection(LineCollection(lines, linewidths=width, zorder=1, **_EDGES[kind]))
    # Arrowheads on directed edges, towards the agents that are sensed. The panel has equal scales.
    for tail, head in [place[[team.index[e.tail], team.index[e.head]]] for e in team.communication if e.directed]:
        style = _HEAD | {"marker": (3, 0, float(np.degrees(np.arctan2(*(head - tail)[::-1]))) - 90.0)}
        axis.plot(*(0.4 * tail + 0.6 * head), color=_EDGES["communication"]["color"], zorder=1, **style)
    groups, names, colours = groups_of(team)
    there = np.array([member.id not in team.absent for member in team.members])
    away = np.abs(place - place[there].mean(axis=0)).max(axis=1)
    shown = away <= away[there].max()
    few = len(place) <= MOST_NAMED
    for k in sorted(set(groups.tolist())):
        target = names[k] == "targets"
        style = {"markersize": 11.0 if target else 6.0 if few else 2.5, "zorder": 4 if target else 3}
        style |= {"markeredgecolor": "white", "markeredgewidth": 0.5} if few or target else {"markeredgewidth": 0.0}
        for own, colour in ((there, colours[k]), (~there, LOST)):
            chosen = (groups == k) & own & shown
            if chosen.any():
                axis.plot(*place[chosen].T, linestyle="", marker=marker_of(k, names), color=colour, **style)
    return np.flatnonzero(shown)


def place_names(axis: Any, names: Sequence[str], places: Array, obstacles: Array | None = None) -> None:
    """Write names next to points of a panel without overlap; call it after `settle`.

    Each name takes the first place about its point, near ones first, that is free of other text and covers the fewest
    points; one that is farther off is joined to its point. A name for which there is no place is left out.

    Args:
        axis: the panel.
        names: those of more importance first.
        places: Coordinates of their points, shape (K, 2), in data coordinates; NaN where there is none.
        obstacles: further points that names should not cover, shape (M, 2).
    """
    pixel = axis.figure.dpi / 72.0
    renderer = axis.figure.canvas.get_renderer()
    points = axis.transData.transform(np.asarray(places, dtype=np.float64).reshape(-1, 2))
    avoid = points if obstacles is None else np.vstack([points, axis.transData.transform(obstacles)])
    taken = np.array([text.get_window_extent(renderer).extents for text in axis.texts]).reshape(-1, 4)
    low = axis.bbox.extents[:2]
    high = axis.bbox.extents[2:]
    for name, place, point in zip(names, places, points, strict=True):
        if not (point >= low).all() or not (point <= high).all():  # outside, or not finite
            continue
        half = _size_of(axis.figure, name) / 2.0 + 0.8 * pixel
        centres = point + _WAYS * half + _WAYS * _GAPS * pixel
        frames = np.concatenate([centres - half, centres + half], axis=1)
        over = (taken[:, None, :2] < frames[:, 2:]).all(axis=2) & (taken[:, None, 2:] > frames[:, :2]).all(axis=2)
        free = (frames[:, :2] >= low).all(axis=1) & (frames[:, 2:] <= high).all(axis=1) & ~over.any(axis=0)
        if not free.any():
            continue
        hidden = ((avoid[:, None] > frames[:, :2]) & (avoid[:, None] < frames[:, 2:])).all(axis=2).sum(axis=0)
        k = int(np.where(free, hidden, len(avoid) + 1).argmin())
        taken = np.vstack([taken, frames[k]])
        joined = {"arrowstyle": "-", "color": "black", "linewidth": 0.4, "shrinkA": 0.0, "shrinkB": 1.5}
        text = axis.annotate(
            name, place, (centres[k] - point) / pixel, textcoords="offset points", ha="center", va="center",
            fontsize=SMALL, color="black", zorder=6, arrowprops=joined if k >= 8 else None,
        )  # fmt: skip
        text.set_in_layout(False)


# Places for names: eight directions, and the gap from the point in each, pt, the nearest eight places first.
_WAYS = np.tile(
    [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)], (6, 1)
)
_GAPS = np.repeat([4.0, 8.0, 14.0, 22.0, 32.0, 44.0], 8)[:, None] * np.where(_WAYS.all(axis=1, keepdims=True), 0.7, 1.0)


def label_ends(axis: Any, ends: Sequence[tuple[float, str, Any]]) -> None:
    """Name lines at their right ends next to a panel, in their colours; make room with `spread_ends` after `settle`.

    Args:
        axis: the panel, its limits final.
        ends: value at the end, name and colour of each line; a value that is not finite has its name at the foot.
    """
    low = axis.get_ylim()[0]
    for value, name, colour in ends:
        at = float(np.clip(value, *axis.get_ylim())) if np.isfinite(value) else low
        joined = {"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkA": 0.0, "shrinkB": 0.0}
        text = axis.annotate(
            name, (1.0, at), (14.0, 0.0), xycoords=axis.get_yaxis_transform(), textcoords="offset points",
            va="center", fontsize=SMALL, color=colour, annotation_clip=False,
            arrowprops={**joined, "relpos": (0.0, 0.5)},
        )  # fmt: skip
        text.set_gid("end")


def spread_ends(axis: Any) -> None:
    """Move the names of `label_ends` up and down until none is over another; call it after `settle`."""
    texts = [text for text in axis.texts if text.get_gid() == "end"]
    if not texts:
        return
    pixel = axis.figure.dpi / 72.0
    wanted = axis.get_yaxis_transform().transform([text.xy for text in texts])[:, 1]
    heights = [_size_of(axis.figure, text.get_text())[1] for text in texts]
    places = spread(wanted, max(heights) + 0.6 * pixel, axis.bbox.y0, axis.bbox.y1)
    for text, place, line in zip(texts, places, wanted, strict=True):
        text.set_position((14.0, (place - line) / pixel))


def spread(wanted: Array, gap: float, low: float, high: float) -> Array:
    """Return places near the given ones, shape (K,), in order and `gap` apart, within a range if there is room."""
    order = np.argsort(wanted, kind="stable")
    steps = gap * np.arange(len(order))
    ascending = isotonic_regression(wanted[order] - steps).x  # without the gaps, places only have to ascend
    places = np.empty(len(order))
    places[order] = np.clip(ascending, low + gap / 2, max(high - gap / 2 - steps[-1], low + gap / 2)) + steps
    return places


def _size_of(figure: Figure, words: str) -> Array:
    """Width and height of a small line of text, shape (2,), pixels."""
    canvas: Any = figure.canvas
    probe = Text(0.0, 0.0, words, fontsize=SMALL)
    probe.set_figure(figure)
    return np.array(probe.get_window_extent(canvas.get_renderer()).size)


def log_axis(axis: Any, which: str, values: Array, decades: float = 12.0) -> None:
    """Make axis 'x' or 'y' of a panel logarithmic, with labels in one style and a maximum number of decades.

    The labels are powers of 10, at least two of them visible, with minor ticks between. Only finite positive values
    determine the limits; if there are none, the panel says so. If values hardly differ, the axis stays linear.
    """
    positive = np.minimum(values[np.isfinite(values) & (values > 0)], 1e300)  # ticks beyond would be infinite
    if not positive.size:
        axis.text(0.5, 0.5, "not defined for this team", transform=axis.transAxes, ha="center", color="grey",
                  fontsize=NORMAL)  # fmt: skip
        axis.set(**{f"{which}ticks": []})
        return
    # Ratio of largest to smallest value below which a logarithmic axis would have almost no labels.
    if positive.max() < 5.0 * positive.min() and np.nanmin(values) > 0.0:
        return
    low, high = log_limits(max(positive.min() / 1.5, positive.max() / 10.0**decades), positive.max() * 1.5)
    axis.set(**{f"{which}scale": "log", f"{which}lim": (0.999 * low, 1.001 * high)})
    side = getattr(axis, f"{which}axis")
    side.set_major_locator(LogLocator(numticks=7))
    side.set_minor_formatter(NullFormatter())


def log_limits(low: float, high: float) -> tuple[float, float]:
    """Return limits of a logarithmic axis, no narrower than those given, with two powers of 10 at least in them."""
    while True:
        first, last = int(np.ceil(np.log10(low) - 1e-9)), int(np.floor(np.log10(high) + 1e-9))
        if last > first:
            return low, high
        # Out to the nearer one of the next powers below and above.
        below, above = 10.0 ** (first - 1), 10.0 ** (last + 1)
        low, high = (below, high) if low / below < above / high else (low, above)


# -- the figures of a run ----------------------------------------------------------------------------------------------

_WORST = 3  # number of worst agents that are highlighted and named
_MOST_RANKED = 26  # maximum number of agents with a name each below their bars
_PALE = 0.35  # opacity of earlier rounds, of that of the last
_MOST_POINTS = 1500  # maximum number of points of a curve, about the width of a printed panel in dots
_BESIDE = 1.0  # of the room of the tracks, beyond which obstacles do not enlarge a view
_MOST_EVENTS = 12  # maximum number of events listed below a figure


_EVERYONE: dict[str, Any] = {"color": "black", "linewidth": 1.5}
_BOUND: dict[str, Any] = {"color": "black", "linewidth": 1.2, "linestyle": (0, (3, 1.2))}
_EVENT: dict[str, Any] = {"color": "#6B7280", "linewidth": 0.9, "linestyle": (0, (4, 3))}


def _draw_error(
    axis: Any,
    time: Array,
    styles: dict[int, dict[str, Any]],
    title: str,
    label: str,
    groups: dict[int, Array],
    team: Array,
    bound: Array | None = None,
) -> None:
    """Draw an error over time, of groups if there are several and of the whole team.

    The first moments are drawn again in a corner where the error falls so fast that its curve is vertical. The corner
    is empty if what is drawn in the second half of the run is far below the top.

    Args:
        axis: The panel.
        time: Times, shape (T,), s.
        styles: Style of each group by its number.
        title: Title of the panel.
        label: Label of its vertical axis.
        groups: Error of each group by its number, shape (T,), m.
        team: Error of the whole team, shape (T,), m.
        bound: Bound on the error of the whole team, shape (T,), m; None without one.
    """
    for k, values in groups.items() if len(styles) > 1 else ():
        axis.plot(time, values, **styles[k])
    own = [(team, _EVERYONE), *([] if bound is None else [(bound, _BOUND)])]
    for values, style in own:
        axis.plot(time, values, **style)
    drawn = [*groups.values(), *(values for values, _ in own)]
    log_axis(axis, "y", np.concatenate(drawn))
    label_axes(axis, title, y=label)
    axis.set_xlim(*_span(time))
    late = float(np.nanmax(np.concatenate([[0.0], *(values[_last_half(time)] for values in drawn)])))
    above = np.flatnonzero(team > 1.5 * late)
    first = time <= time[0] + 2.0 * (time[above[-1]] - time[0]) if len(above) else np.zeros(len(time), dtype=bool)
    low, high = axis.get_ylim()
    if not 8 <= first.sum() <= 0.04 * len(time) or late > low * (high / low) ** 0.5:
        return
    corner = axis.inset_axes((0.5, 0.62, 0.48, 0.33))
    for values, style in own:
        corner.plot(time[first], values[first], **style)
    log_axis(corner, "y", team[first])
    corner.tick_params(labelsize=SMALL)
    corner.set_title("the beginning", fontsize=SMALL, pad=2)


def _error_panels(
    team: Team, dataset: xr.Dataset, members: dict[int, BoolArray], bound: Array | None
) -> list[tuple[Any, ...]]:
    """List the errors over time, each as arguments of `_draw_error`; `members` marks the agents of each group."""
    eta = dataset["disagreement"].values
    squares = dataset["tracking_error"].values ** 2
    tracking = {k: np.sqrt(mean_known(squares[:, chosen])) for k, chosen in members.items()}
    disagreement = {k: mean_known(eta[:, chosen]) for k, chosen in members.items()}
    panels: list[tuple[Any, ...]] = [
        ("disagreement", "mean |η| (m)", disagreement, mean_known(eta)),
        ("tracking error |q* − q|", "RMS over agents (m)", tracking, np.sqrt(mean_known(squares)), bound),
    ]
    of_groups = {
        "formation_error": ("formation error", "RMS edge residual (m)"),
        "centering_error": ("centering error; team: the largest", "centroid off its place (m)"),
    }
    if any(not np.isnan(dataset[name].values).all() for name in of_groups):
        for name, (title, label) in of_groups.items():
            groups = dict(enumerate(dataset[f"group_{name}"].values.T)) if team.formations else {}
            panels.append((title, label, groups, dataset[name].values))
    return panels


def draw_errors(
    team: Team, dataset: xr.Dataset, bound: tuple[str, Array] | None = None, options: FigureOptions = AS_USUAL
) -> Figure:
    """Draw errors over time: disagreement, tracking, formation and centering by group, and tracking by agent.

    The last two panels show the worst agents: their curves, and all agents ranked by their error over the second half.

    Args:
        team: Team of the run.
        dataset: Data of the run, thinned to the visible detail.
        bound: Name and values of a bound on the team's RMS error, shape (T,), m; or None.
        options: Formats and style of the figures.
    """
    groups, names, colours = groups_of(team)
    agents = groups[: len(team.agents)]
    shown = thin(dataset.sizes["time"], _MOST_POINTS)
    curves = dataset.isel(time=shown)
    time = curves["time"].values
    members = {k: agents == k for k in sorted(set(agents.tolist()))}
    limit = None if bound is None else bound[1][shown]
    panels = _error_panels(team, curves, members, limit)
    rows = len(panels) // 2 + 1
    linked = "arrival" in dataset
    figure = new_figure(WIDTH, 0.6 + 2.3 * rows + 1.4 * linked, _title(dataset, "errors over time"), options)
    grid = figure.add_gridspec(rows + linked, 2, height_ratios=[1.0] * rows + [0.45] * linked)
    axes = [figure.add_subplot(grid[row, column]) for row in range(rows) for column in (0, 1)]
    if linked:
        share = dataset["arrival"].values  # averaged over a hundredth of the run around each sample
        axis = figure.add_subplot(grid[rows, :])
        axis.plot(
            dataset["time"].values,
            uniform_filter1d(share, 2 * max(1, len(share) // 200) + 1),
            color="black",
            linewidth=1.0,
        )
        label_axes(axis, "measurements that arrive", "time (s)", "fraction of edges")
        axis.set(xlim=_span(dataset["time"].values), ylim=(-0.03, 1.03))
    styles = {k: {"color": colours[k], "linestyle": DASHES[k % len(DASHES)], "linewidth": 1.0} for k in members}
    for axis, panel in zip(axes, panels, strict=False):
        _draw_error(axis, time, styles, *panel)
    curves_axis, ranking_axis = axes[-2:]
    tracking = curves["tracking_error"].values
    # RMS of each agent's error over the second half, m; NaN for those absent at the end.
    late = np.where(np.isnan(tracking[-1]), np.nan, np.sqrt(mean_known(tracking[_last_half(time)].T ** 2)))
    known = ~np.isnan(late)
    order = np.argsort(np.where(known, -late, np.inf), kind="stable")[: int(known.sum())]
    keys = _draw_agents(curves_axis, team, time, tracking, order, colours[agents])
    _draw_ranking(ranking_axis, team, tracking[_last_half(time)], late, order, agents)
    curves_axis.set_xlabel("time (s)", fontsize=NORMAL)
    found = [phase for phase in phases_in(dataset) if phase["events"]]
    for axis in [*axes[:-1], *figure.axes[len(axes) :]]:
        mark_times(axis, [phase["time"] for phase in found])
    told = [f"{k}: {', '.join(p['events'])} ({p['time']:.6g} s)" for k, p in enumerate(found[:_MOST_EVENTS], 1)]
    if len(found) > _MOST_EVENTS:
        told.append(f"and {len(found) - _MOST_EVENTS} more")
    groups_shown = [*styles][:_MOST_KEYS] if len(styles) > 1 else []
    legend = [
        *(key(names[k], **styles[k], marker=marker_of(k, names), markersize=4.5) for k in groups_shown),
        key("whole team", **_EVERYONE),
        *([] if bound is None else [key(f"bound: {bound[0]}", **_BOUND)]),
        *keys,
        *([key("events", **_EVENT)] if told else []),
    ]
    legend_below(figure, legend, 6, title="\n".join(wrap("   ".join(told), 105, max_lines=5, placeholder=" …")))
    settle(figure)
    spread_ends(curves_axis)
    if len(order) > _MOST_RANKED:
        places = np.column_stack([np.arange(1, len(order) + 1), late[order]])
        place_names(ranking_axis, [team.agents[i].id for i in order[:_WORST]], places[:_WORST], places)
    return figure


def _last_half(time: Array) -> BoolArray:
    """Mark the samples in the second half of a run, shape (T,)."""
    return np.asarray(time >= (time[0] + time[-1]) / 2)


def _draw_agents(axis: Any, team: Team, time: Array, errors: Array, order: IntArray, colours: Array) -> list[Line2D]:
    """Draw each agent's tracking error (T, N) over time, with the worst ones bold and named; for large teams, a band.

    `order` lists the agents that are present at the end, the worst first; `colours` are the agents', (N, 3). Returns
    rows for a legend.
    """
    keys = []
    worst = order[:_WORST] if len(order) > 1 else order
    others = np.setdiff1d(np.arange(errors.shape[1]), worst)
    if len(others) > 60:  # maximum number of agents with a curve each
        with np.errstate(all="ignore"):
            low, middle, high = np.nanquantile(np.where(np.isfinite(errors), errors, np.nan), (0.05, 0.5, 0.95), axis=1)
        axis.fill_between(time, low, high, color="#B8BEC8", linewidth=0, alpha=0.6)
        axis.plot(time, middle, color="#4B5563", linewidth=0.9)
        keys = [
            key("90 % of the agents", color="#B8BEC8", linewidth=6, alpha=0.6),
            key("median agent", color="#4B5563", linewidth=0.9),
        ]
    else:
        lines = [np.column_stack([time, errors[:, i]]) for i in others]
        axis.add_collection(LineCollection(lines, colors=[(*colours[i], 0.55) for i in others], linewidths=0.6))
    for k, i in enumerate(worst):
        axis.plot(time, errors[:, i], color=colours[i], linewidth=1.5, linestyle=DASHES[k])
    log_axis(axis, "y", errors)
    title = "tracking error by agent" + (", the worst named" if len(order) > 1 else "")
    label_axes(axis, title, y="|q* − q| (m)")
    axis.set_xlim(*_span(time))
    label_ends(axis, [(errors[-1, i], _short(team.agents[i].id), "black") for i in worst])
    return keys


def _draw_ranking(axis: Any, team: Team, errors: Array, late: Array, order: IntArray, groups: IntArray) -> None:
    """Draw all agents ranked by their RMS error over the second half (N,), with the range of their errors (T, N)."""
    _, names, colours = groups_of(team)
    rank = np.arange(1, len(order) + 1)
    few = len(order) <= _MOST_RANKED
    with np.errstate(all="ignore"):
        low, high = (bound(errors[:, order], axis=0) for bound in (np.nanmin, np.nanmax))
    axis.vlines(rank, low, high, color=[colours[k] for k in groups[order]], linewidth=2.5 if few else 0.6, alpha=0.45)
    for k in sorted(set(groups[order].tolist())):
        own = groups[order] == k
        style = {"color": colours[k], "markersize": 5.0 if few else 2.0}
        axis.plot(rank[own], late[order][own], linestyle="", marker=marker_of(k, names), **style)
    log_axis(axis, "y", errors)
    label_axes(axis, "agents by error over the second half", "" if few else "rank of the agent", "RMS and range (m)")
    axis.set_xlim(0.3, max(len(order), 1) + 0.7)
    if few:
        axis.set_xticks(rank, [_short(team.agents[i].id) for i in order], rotation=90, fontsize=SMALL)
        axis.grid(False, axis="x")


def _short(name: str) -> str:
    return name if len(name) <= 12 else name[:11] + "…"


def _span(time: Array) -> tuple[float, float]:
    """Return the limits of a time axis, s."""
    start, end = float(time[0]), float(time[-1])
    room = 0.01 * (end - start) or 0.5
    return start - room, end + room


def mark_times(axis: Any, times: list[float]) -> None:
    """Mark and number times, s; times that are close together share a label."""
    low, high = axis.get_xlim()
    first = 0
    for k, time in enumerate(times):
        axis.axvline(time, zorder=1, **_EVENT)
        if k + 1 == len(times) or times[k + 1] - time > 0.04 * (high - low):
            number = f"{first + 1}" if first == k else f"{first + 1}–{k + 1}"
            axis.annotate(number, (time, 0.0), (2, 2), xycoords=axis.get_xaxis_transform(),
                          textcoords="offset points", fontsize=SMALL, color="#4B5563")  # fmt: skip
            first = k + 1


def draw_trajectories(
    team: Team,
    dataset: xr.Dataset,
    options: FigureOptions = AS_USUAL,
    view: tuple[float, float] = VIEW,
    obstacles: ObstacleArrays | None = None,
) -> Figure:
    """Draw all trajectories of a thinned run from above and, for a team in space, from two sides and in perspective.

    Views share one scale, except for heights: a title states by how much they are stretched. Absent agents are grey,
    and drawn only near the others.

    `view` is the azimuth and elevation of the eye of the view in space, degrees, the same as in the video and the page.
    """
    groups, names, colours = groups_of(team)
    dataset = dataset.isel(time=thin(dataset.sizes["time"], _MOST_POINTS))
    absent = np.isnan(dataset["tracking_error"].values).T
    spatial = max(m.dimension for m in team.members) == 3
    tracks = np.moveaxis(_positions(dataset), 0, 2)  # (V, 3, T)
    rounds = _start_of_last_round(tracks)
    low, high = _room(tracks, absent)
    inside = np.asarray(((tracks >= low) & (tracks <= high)).all(axis=1))
    low, high = include_obstacles(low, high, obstacles, dataset["time"].values)
    middle = (low + high)[:, 0] / 2.0
    size = np.maximum(high - low, 0.02 * float((high - low).max()) or 1.0)[:, 0]
    wide, deep = max(size[0], size[1] / 3.0), max(size[1], size[0] / 3.0)
    tall = float(np.clip(size[2], 0.25 * min(wide, deep), 0.5 * min(wide, deep))) if spatial else 0.0
    scale = min((WIDTH - 1.2) / (wide + tall), 5.6 / (deep + tall))  # in/m
    title = _title(dataset, "all trajectories")
    figure = new_figure(WIDTH, scale * (deep + tall) + (1.5 if spatial else 1.1), title, options)
    if spatial:
        ratios = {"width_ratios": [wide, tall], "height_ratios": [deep, tall]}
        ((above, side), (front, corner)) = figure.subplots(2, 2, gridspec_kw=ratios)
        views = {above: (0, 1), front: (0, 2), side: (2, 1)}
    else:
        above = figure.subplots()
        views = {above: (0, 1)}
    for axis, plane in views.items():
        _draw_tracks(axis, team, tracks[:, plane], absent, inside, rounds)
        draw_obstacles(axis, obstacles, dataset["time"].values, np.eye(3)[list(plane)])
        label_axes(axis, "", *(f"{'xyz'[coordinate]} (m)" for coordinate in plane))
        for line in (axis.xaxis, axis.yaxis):
            line.set_major_locator(MaxNLocator(6 if axis is above else "auto", steps=[1, 2, 2.5, 5, 10]))
    keys = [
        *group_keys(groups, names, colours),
        key("start", color="black", marker="o", markerfacecolor="white", markersize=4),
        key("end", color="black", marker="o", markersize=5),
        *([key("earlier rounds", color="black", linewidth=0.4, alpha=_PALE)] if rounds else []),
        *([key("lost", color="black", marker="X", markersize=5)] if absent[:, -1].any() else []),
        *([key("obstacle", color=OBSTACLE, marker="s", markersize=6)] if obstacles and len(obstacles.kind) else []),
    ]
    legend_below(figure, keys, 6)
    if spatial:
        for axis, name in ((above, "above"), (front, "the front"), (side, "the side")):
            axis.set_title(f"from {name}", fontsize=HEADING, loc="right" if axis is side else "center")
        seen = _draw_in_space(corner, team, tracks, absent, inside, rounds, view)
        draw_obstacles(corner, obstacles, dataset["time"].values, seen)
    lay_out(figure)  # the sizes of the panels determine the region that each shows
    _fill_views(views, middle, size)
    settle(figure)  # with the tick labels of these limits
    stretch = _fill_views(views, middle, size)
    if spatial and not 0.95 < stretch < 1.05:
        front.set_title(f"from the front, heights ×{stretch:.2g}", fontsize=HEADING)
    _name_members(above, team, dataset, tracks[:, :2, -1], tracks[:, :2, 0])
    return figure


def _fill_views(views: dict[Any, tuple[int, int]], middle: Array, size: Array) -> float:
    """Set the limits of views, given each panel's two coordinates, so that they fill the first one to scale.

    Returns:
        Ratio of the scale of heights to that of the other coordinates.
    """
    above, *others = views
    width, height = above.get_window_extent().size
    metre = min(width / size[0], height / size[1])  # pixels
    reach = 0.5 * np.array([width / metre, height / metre, size[2]])
    for axis, (x, y) in views.items():
        axis.set_xlim(middle[x] - reach[x], middle[x] + reach[x])
        axis.set_ylim(middle[y] - reach[y], middle[y] + reach[y])
    return float(others[0].get_window_extent().height / (size[2] * metre)) if others else 1.0


def _start_of_last_round(tracks: Array) -> int:
    """Return the sample at which a team that goes round and round begins its last round; 0 if it does not.

    Trajectories are (V, 3, T). It is the last sample at which the team was where it ends, having been elsewhere since.
    """
    with np.errstate(all="ignore"):
        away = np.nan_to_num(np.sqrt(np.nanmean((tracks - tracks[:, :, -1:]) ** 2, axis=(0, 1))))
    farthest = away[len(away) // 2 :].max()
    elsewhere = np.flatnonzero(away > 0.5 * farthest)
    back = np.flatnonzero(away[: elsewhere[-1]] < 0.15 * farthest) if len(elsewhere) else elsewhere
    return int(back[-1]) if len(back) else 0


def _draw_tracks(axis: Any, team: Team, tracks: Array, absent: BoolArray, inside: BoolArray, round_from: int) -> None:
    """Draw the trajectories (V, 2, T) in a view as lines with start and end points; pale up to the sample `round_from`.

    `absent` (N, T) marks absent agents, and `inside` (V, T) vehicles near the others.
    """
    groups, names, colours = groups_of(team)
    N, few = len(absent), len(tracks) <= MOST_NAMED
    there = np.vstack([~absent, np.ones((len(tracks) - N, tracks.shape[2]), dtype=bool)])
    seen = np.where(there, 0, np.where(inside, 1, 2))  # 2: not drawn
    earlier = np.where(there & (np.arange(tracks.shape[2]) <= round_from), 0, 2)
    seen[there & (np.arange(tracks.shape[2]) < round_from)] = 2
    width, faint = (0.8, 0.8) if few else (0.3, 0.5)
    for own, dashes in ((slice(0, N), "-"), (slice(N, None), (0, (4, 1.5)))):
        style = {"linewidths": width, "linestyles": [dashes], "zorder": 2}
        if round_from:
            pale = {**style, "linewidths": 0.5 * width, "zorder": 1}
            _draw_paths(axis, tracks[own], earlier[own], [(*colours[k], _PALE * faint) for k in groups[own]], pale)
        _draw_paths(axis, tracks[own], seen[own], [(*colours[k], faint) for k in groups[own]], style)
    first = tracks[np.arange(len(tracks)), :, there.argmax(axis=1)]
    lost = ~there[:, -1]
    for k in sorted(set(groups.tolist())):
        target, own = names[k] == "targets", groups == k
        size = 7.0 if target else 4.5 if few else 1.6
        start = {"marker": "o", "markersize": 3.5 if few else 1.2, "markerfacecolor": "white", "markeredgewidth": 0.7}
        axis.plot(*first[own].T, linestyle="", color=colours[k], zorder=3, **start)
        edge = {"markeredgecolor": "white", "markeredgewidth": 0.4} if few or target else {}
        here = own & ~lost
        axis.plot(*tracks[here, :, -1].T, linestyle="", color=colours[k], zorder=4,
                  marker=marker_of(k, names), markersize=size, **edge)  # fmt: skip
    gone = np.flatnonzero(lost & there.any(axis=1))
    when = tracks.shape[2] - 1 - there[gone, ::-1].argmax(axis=1)
    axis.plot(*tracks[gone, :, when].T, linestyle="", marker="X", color="black", markersize=5, zorder=4)


def _draw_paths(axis: Any, tracks: Array, seen: IntArray, colours: list[Any], style: dict[str, Any]) -> None:
    """Draw trajectories (V, 2, T), where `seen` (V, T) is 0 in their colours, and where it is 1 in that of the lost."""
    for kind, colour in ((0, colours), (1, LOST)):
        if kind == 0 or (seen == 1).any():
            lines = [np.where(w == kind, xy, np.nan).T for xy, w in zip(tracks, seen, strict=True)]
            axis.add_collection(LineCollection(lines, colors=colour, **style))


def _draw_in_space(
    axis: Any, team: Team, tracks: Array, absent: BoolArray, inside: BoolArray, start: int, view: tuple[float, float]
) -> Array:
    """Draw the trajectories (V, 3, T) from the azimuth and elevation of an eye, degrees, without tick labels.

    Returns:
        The axes of the picture in space, shape (2, 3).
    """
    turn, tilt = np.radians(view)
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    up = np.array([-np.sin(tilt) * np.cos(turn), -np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    seen = np.stack([right, up])
    _draw_tracks(axis, team, np.einsum("ij,vjt->vit", seen, tracks), absent, inside, start)
    axis.set_axis_off()
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(0.05)
    axis.set_title("in space", fontsize=HEADING)
    for direction, name in zip(seen.T, "xyz", strict=True):  # axes, in the corner
        tip = np.array([0.16, 0.06]) + 0.13 * direction
        axis.annotate("", tip, (0.16, 0.06), xycoords=axis.transAxes, textcoords=axis.transAxes,
                      arrowprops={"arrowstyle": "->", "linewidth": 0.7, "shrinkA": 0.0, "shrinkB": 0.0})  # fmt: skip
        axis.text(*(tip + 0.05 * direction), name, transform=axis.transAxes, fontsize=SMALL, ha="center", va="center")
    return seen


def _name_members(axis: Any, team: Team, dataset: xr.Dataset, places: Array, avoid: Array) -> None:
    """Label vehicles at places (V, 2): all of a small team; the targets and the worst agents of a large one.

    Labels also avoid the points `avoid`, (M, 2).
    """
    N = len(team.agents)
    error = np.nan_to_num(dataset["tracking_error"].values[-1], nan=-1.0, posinf=np.inf)
    order = np.argsort(-error, kind="stable")
    agents = order if len(team.members) <= MOST_NAMED else order[:_WORST]
    chosen = np.concatenate([np.arange(N, len(team.members))[:MOST_NAMED], agents])
    place_names(axis, [team.members[v].id for v in chosen], places[chosen], np.vstack([places, avoid]))


def _room(tracks: Array, absent: BoolArray) -> tuple[Array, Array]:
    """Return the corners of the box around tracks (V, axes, T) of present agents, enlarged by a tenth each way."""
    known = tracks.copy()
    known[: len(absent)] = np.where(absent[:, None], np.nan, known[: len(absent)])
    low, high = (bound(known, axis=(0, 2))[:, None] for bound in (np.nanmin, np.nanmax))
    return low - 0.1 * (high - low), high + 0.1 * (high - low)


def draw_configurations(team: Team, last: Team, dataset: xr.Dataset, options: FigureOptions = AS_USUAL) -> Figure:
    """Draw the initial and final configuration from above, with edges and each agent's harmonic extension.

    `last` is the team of the last phase; absent agents are grey.
    """
    title = _title(dataset, "initial and final configuration, seen from above")
    sizes = [np.ptp(_positions(dataset.isel(time=[k]))[0, :, :2], axis=0) + 1e-9 for k in (0, -1)]
    ratio = max(float(y / x) for x, y in sizes)
    figure = new_figure(WIDTH, 1.2 + 3.2 * float(np.clip(ratio, 0.55, 1.2)), title, options)
    groups, names, colours = groups_of(team)
    N, few = len(team.agents), len(team.members) <= MOST_NAMED
    panels = figure.subplots(1, 2)
    shown = zip(panels, (0, -1), ("initial", "final"), (team, last), strict=True)
    placed = []
    for axis, k, word, now_team in shown:
        now = dataset.isel(time=[k])
        place, goals = _positions(now)[0, :, :2], now["harmonic_extension"].values[0, :, :2]
        drawn = draw_team(axis, now_team, place)
        ties = np.stack([place[:N], goals], axis=1)
        tints = colours[groups[:N]]
        axis.add_collection(
            LineCollection(list(ties), colors=tints, linewidths=0.7, linestyles=[(0, (2, 1.5))], zorder=2)
        )
        for group in sorted(set(groups[:N].tolist())):
            own = goals[groups[:N] == group]
            axis.plot(*own.T, "x", color=colours[group], markersize=5 if few else 2, mew=1.0 if few else 0.5, zorder=2)
        finish_map(axis, f"{word}, t = {float(now['time'][0]):.6g} s", "x (m)", 0.08)
        if axis is panels[1]:
            axis.set_ylabel("")
        placed.append((axis, now, np.where(np.isin(np.arange(len(place)), drawn)[:, None], place, np.nan), goals))
    keys = [*group_keys(groups, names, colours, lines=False), *edge_keys(team, last)]
    legend_below(figure, [*keys, key("harmonic extension q*", color="black", marker="x", markersize=5)], 5)
    settle(figure)
    for axis, now, place, goals in placed:
        _name_members(axis, team, now, place, goals)
    return figure


def _title(dataset: xr.Dataset, what: str) -> str:
    attrs = dataset.attrs
    unstable = "" if attrs["status"] == "finished" else "   (run blew up)"
    return f"{attrs['scenario']}: {what}   [{attrs['backend']}, {law_in_words(dataset)}]{unstable}"


def _positions(dataset: xr.Dataset) -> Array:
    """Return the positions (T, V, 3), m, with planar vehicles at z = 0."""
    return np.nan_to_num(joined(dataset, "position"))


def include_obstacles(low: Array, high: Array, obstacles: ObstacleArrays | None, times: Array) -> tuple[Array, Array]:
    """Enlarge a box, low and high (3, 1) in m, by the obstacles at the first and last of some times, s.

    A half-space is not part of it, nor what is farther away than the box is wide.
    """
    if obstacles is None:
        return low, high
    least = low - _BESIDE * (high - low).max()
    most = high + _BESIDE * (high - low).max()
    for time in (times[0], times[-1]):
        for n, centre in enumerate(centres(obstacles, float(time))):
            if obstacles.kind[n] == HALF_SPACE:
                continue
            half = np.diagonal(farthest(obstacles, n, np.eye(3)))
            low = np.minimum(low, np.clip((centre - half)[:, None], least, most))
            high = np.maximum(high, np.clip((centre + half)[:, None], least, most))
    return low, high


def draw_obstacles(axis: Any, obstacles: ObstacleArrays | None, times: Array, projection: Array) -> None:
    """Draw obstacles where they are at the last of some times, s, and the outlines of those that moved at the first."""
    if obstacles is None:
        return
    first, last = (centres(obstacles, float(time)) for time in (times[0], times[-1]))
    style: dict[str, Any] = {"edgecolor": OBSTACLE, "linewidth": 0.8, "zorder": 1}
    for n in range(len(obstacles.kind)):
        shape = outline(obstacles, n, last[n], projection)
        if shape is None:
            continue
        axis.add_artist(Polygon(shape, facecolor=(*OBSTACLE, 0.5), **style))
        began = outline(obstacles, n, first[n], projection)
        if began is not None and (first[n] != last[n]).any():
            axis.add_artist(Polygon(began, fill=False, linestyle=(0, (3, 2)), **style))
