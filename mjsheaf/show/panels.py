"""Common style of figures: size, fonts, colours (the same in videos), labels that never overlap, PNG, SVG and PDF.

Figures are drawn at the width of two columns of a journal, with the font size of the printed page. Groups differ by
colour, marker and dash at once, so they remain distinct without colour.

Matplotlib's object interface is used throughout: no global state, no display.
"""

import io
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import IO, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from mjsheaf.arrays import Array
from mjsheaf.show.style import AS_USUAL, LOST, MATPLOTLIB, FigureOptions, groups_of, marker_of
from mjsheaf.team import Team

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
        figure.set_layout_engine("none")


def lay_out(figure: Figure) -> None:
    """Give panels and legends their places, without drawing anything."""
    engine = figure.get_layout_engine()
    if engine is not None:
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


def place_names(
    axis: Any, names: Sequence[str], places: Array, obstacles: Array | None = None, colour: str = "black"
) -> int:
    """Write names next to points of a panel without overlap; call it after `settle`.

    Each name takes the first place about its point, near ones first, that is free of other text and covers the fewest
    points; one that is farther off is joined to its point. A name for which there is no place is left out.

    Args:
        axis: the panel.
        names: those of more importance first.
        places: Coordinates of their points, shape (K, 2), in data coordinates; NaN where there is none.
        obstacles: further points that names should not cover, shape (M, 2).
        colour: Colour of the names.

    Returns:
        How many were placed.
    """
    pixel = axis.figure.dpi / 72.0
    renderer = axis.figure.canvas.get_renderer()
    points = axis.transData.transform(np.asarray(places, dtype=np.float64).reshape(-1, 2))
    avoid = points if obstacles is None else np.vstack([points, axis.transData.transform(obstacles)])
    legend = axis.get_legend()
    written = [*axis.texts, *([legend] if legend else [])]
    taken = np.array([item.get_window_extent(renderer).extents for item in written]).reshape(-1, 4)
    low = axis.bbox.extents[:2]
    high = axis.bbox.extents[2:]
    placed = 0
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
        joined = {"arrowstyle": "-", "color": colour, "linewidth": 0.4, "shrinkA": 0.0, "shrinkB": 1.5}
        text = axis.annotate(
            name, place, (centres[k] - point) / pixel, textcoords="offset points", ha="center", va="center",
            fontsize=SMALL, color=colour, zorder=6, arrowprops=joined if k >= 8 else None,
        )  # fmt: skip
        text.set_in_layout(False)
        placed += 1
    return placed


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
    positive = values[np.isfinite(values) & (values > 0)]
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
