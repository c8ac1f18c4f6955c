"""What figures have in common: colours of groups (the same in videos), teams seen from above, logarithmic axes, PNG.

Matplotlib's object interface is used throughout: no global state, no display.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from numpy.typing import NDArray

from mjsheaf.arrays import Array
from mjsheaf.team import Team

# Okabe and Ito's palette (distinct with any colour vision), then Tol's muted scheme for further groups.
_COLOURS = (
    *("#E69F00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"),
    *("#882255", "#44AA99", "#999933", "#332288", "#AA4499", "#117733"),
)
_UNGROUPED, TARGET = "#F0E442", "#D62728"
BLUE, RED = "#0072B2", "#D62728"
LOST = "#9A9A9A"
"""Of agents that are lost or have yet to join."""
_EDGES: dict[str, dict[str, Any]] = {
    "communication": {"color": "#8A94A6", "linestyle": "-"},
    "sensing": {"color": "#B45309", "linestyle": ":"},
}
_MOST_LABELLED = 60  # vehicles; more are drawn small and without their names


def palette(count: int) -> Array:
    """RGB of `count` groups, then of ungrouped agents and of targets, shape (count + 2, 3)."""
    chosen = [_COLOURS[k % len(_COLOURS)] for k in range(count)]
    return np.array([to_rgb(code) for code in [*chosen, _UNGROUPED, TARGET]])


def groups_of(team: Team) -> tuple[NDArray[np.int64], list[str], Array]:
    """Index of each vehicle's group, shape (V,); the groups' names; their colours, RGB, shape (G, 3)."""
    names = [f.name for f in team.formations]
    index = {member: k for k, f in enumerate(team.formations) for member in f.members}
    agents = [index.get(a.id, len(names)) for a in team.agents]
    others = "agents without a group" if names else "agents"
    index_of_each = np.array(agents + [len(names) + 1] * len(team.targets))
    return index_of_each, [*names, others, "targets"], palette(len(names))


def new_figure(width: float, height: float, title: str) -> Figure:
    """A figure of the given size in inches, with its title; panels and legends get the room that they need."""
    figure = Figure((width, height), dpi=120, layout=ConstrainedLayoutEngine(h_pad=0.1, w_pad=0.1))
    figure.suptitle(title)
    return figure


def save_figure(figure: Figure, file: Path | IO[bytes]) -> None:
    """Write a figure as PNG; equal figures give equal bytes."""
    # No metadata: a version or date would make equal runs differ.
    figure.savefig(file, format="png", metadata={"Software": None})


def label_axes(axis: Any, title: str, x: str = "", y: str = "", **grid: Any) -> None:
    """Give a panel its title, labels and a pale grid."""
    axis.set_title(title, fontsize=11)
    axis.set(xlabel=x, ylabel=y)
    axis.grid(True, alpha=0.3, **grid)


def key(label: str, **style: Any) -> Line2D:
    """A row of a legend; without a `linestyle` a marker has no line."""
    return Line2D([], [], label=label, **({"linestyle": ""} if "marker" in style else {}) | style)


def edge_keys() -> list[Line2D]:
    """The rows of a legend for the edges of `draw_team`."""
    return [key(kind, **style) for kind, style in _EDGES.items()]


def legend_below(holder: Any, keys: Sequence[Any], columns: int) -> None:
    """Add a legend below the panels of a figure, or below a panel."""
    figure = isinstance(holder, Figure)
    place = {"loc": "outside lower center"} if figure else {"loc": "upper center", "bbox_to_anchor": (0.5, -0.12)}
    holder.legend(handles=keys, ncols=columns, frameon=False, fontsize=9, **place)


def finish_map(axis: Any, title: str, x: str, margin: float) -> None:
    """Make a panel a map seen from above, of equal scales, with a margin, as a part of its size."""
    label_axes(axis, title, x, "y (m)")
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(margin)


def draw_team(axis: Any, team: Team, place: Array) -> None:
    """Draw a team from above: edges, agents in the colours of their groups, targets as stars; `place` (V, 2) in m.

    Absent agents are grey, and left out where they are farther from the middle than all others.
    """
    for kind, edges in (("communication", team.communication), ("sensing", team.sensing)):
        lines = [place[[team.index[e.tail], team.index[e.head]]] for e in edges]
        axis.add_collection(LineCollection(lines, linewidths=1.0, zorder=1, **_EDGES[kind]))
    groups, _, colours = groups_of(team)
    few = len(place) <= _MOST_LABELLED
    there = np.array([member.id not in team.absent for member in team.members])
    away = np.abs(place - place[there].mean(axis=0)).max(axis=1)
    for v, member in enumerate(team.members):
        if away[v] > away[there].max():
            continue
        target = v >= len(team.agents)
        size = (13 if target else 8) if few else 3
        outline = {"markeredgecolor": "white", "markeredgewidth": 0.6} if few else {}
        colour = LOST if member.id in team.absent else colours[groups[v]]
        axis.plot(*place[v], "*" if target else "o", markersize=size, color=colour, zorder=3, **outline)
        if few:
            axis.annotate(member.id, place[v], xytext=(5, 5), textcoords="offset points", fontsize=8, zorder=5)


def log_axis(axis: Any, which: str, values: Array, decades: float = 12.0) -> None:
    """Make axis 'x' or 'y' of a panel logarithmic, of at most so many decades, with numbers written out.

    Of the values that are drawn only those that are finite and positive count; without any, a line says so.
    """
    positive = values[np.isfinite(values) & (values > 0)]
    if not positive.size:
        axis.text(0.5, 0.5, "not defined for this team", transform=axis.transAxes, ha="center", color="grey")
        return
    low, high = max(positive.min() / 1.5, positive.max() / 10.0**decades), positive.max() * 1.5
    axis.set(**{f"{which}scale": "log", f"{which}lim": (low, high)})
    ticks = getattr(axis, f"{which}axis")
    ticks.set_major_locator(FixedLocator(log_ticks(low, high)))
    ticks.set_minor_locator(NullLocator())
    ticks.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def log_ticks(low: float, high: float) -> list[float]:
    """Ticks of a logarithmic axis: powers of 10 where three or more are seen, else as few between as make it three.

    Two at least are seen where the axis spans a factor of 2.
    """
    ticks: list[float] = []
    first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
    for steps in ((1,), (1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)):
        ticks = [float(f"{step}e{power}") for power in range(first, last + 1) for step in steps]
        ticks = [tick for tick in ticks if low <= tick <= high]
        if len(ticks) >= 3:
            break
    return ticks
