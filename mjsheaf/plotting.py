"""Figures without a display, and the colours of groups: the same in plots and videos."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from mjsheaf.arrays import Array, IntArray
from mjsheaf.team import Team

# Okabe and Ito's palette (distinct with any colour vision), then Tol's muted scheme for further groups.
_COLOURS = (
    *("#E69F00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"),
    *("#882255", "#44AA99", "#999933", "#332288", "#AA4499", "#117733"),
)
COMMUNICATION = "#8A94A6"
_UNGROUPED, _TARGET = "#F0E442", "#D62728"


def palette(count: int) -> Array:
    """RGB of `count` groups, then of ungrouped agents and of targets, shape (count + 2, 3)."""
    chosen = [_COLOURS[k % len(_COLOURS)] for k in range(count)]
    return np.array([to_rgb(code) for code in [*chosen, _UNGROUPED, _TARGET]])


def group_of_vehicles(team: Team) -> tuple[IntArray, list[str]]:
    """Index of each vehicle's group in `palette`, shape (V,), and the names that go with the palette."""
    names = [f.name for f in team.formations]
    index = {member: k for k, f in enumerate(team.formations) for member in f.members}
    agents = [index.get(a.id, len(names)) for a in team.agents]
    others = "agents without a group" if names else "agents"
    return np.array(agents + [len(names) + 1] * len(team.targets)), [*names, others, "targets"]


def new_figure(width: float, height: float) -> Figure:
    """A figure of the given size in inches that needs no display."""
    figure = Figure(figsize=(width, height), dpi=120)
    FigureCanvasAgg(figure)
    return figure


class LogTicks(LogLocator):
    """Powers of 10 where three or more are seen, else as few between as make it three.

    Two at least are seen where the axis spans a factor of 2.
    """

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        """The ticks between two positive numbers, ascending."""
        powers = range(int(np.floor(np.log10(vmin))), int(np.ceil(np.log10(vmax))) + 1)
        ticks: list[float] = []
        for steps in ((1,), (1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)):
            if len(ticks) < 3:
                found = [float(f"{step}e{power}") for power in powers for step in steps]
                ticks = [tick for tick in found if vmin <= tick <= vmax]
        return ticks


def label_logarithmic(axis: Any) -> None:
    """Label a logarithmic axis, such as `panel.xaxis`, at `LogTicks`, with numbers that are written out."""
    axis.set_major_locator(LogTicks())
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def fit_logarithmic(panel: Any, values: Array, margin: float, span: float) -> bool:
    """Make the y axis of a panel logarithmic over the values above 0; where there are none, say so and return False.

    Args:
        panel: matplotlib's axes.
        values: what is drawn; some may be NaN.
        margin: room above and below, as a factor.
        span: the smallest value shown, of the largest.
    """
    positive = values[np.isfinite(values) & (values > 0)]
    if not positive.size:
        panel.text(0.5, 0.5, "not defined for this team", transform=panel.transAxes, ha="center", color="grey")
        return False
    panel.set_yscale("log")
    panel.set_ylim(max(positive.min() / margin, positive.max() * span), positive.max() * margin)
    return True


def draw_team(panel: Any, team: Team, place: Array, sensing: str) -> None:
    """Edges, and every vehicle in its group's colour, with its name where there are 60 or fewer.

    Args:
        panel: matplotlib's axes.
        team: the team.
        place: of every vehicle, shape (V, 2), m.
        sensing: colour of sensing edges.
    """
    for edges, colour, style in ((team.communication, COMMUNICATION, "-"), (team.sensing, sensing, ":")):
        lines = [place[[team.index[e.tail], team.index[e.head]]] for e in edges]
        panel.add_collection(LineCollection(lines, colors=colour, linestyles=style, linewidths=1.0, zorder=1))
    (groups, _), colours, few = group_of_vehicles(team), palette(len(team.formations)), len(place) <= 60
    for v, member in enumerate(team.members):
        marker, size = ("*", 13) if v >= len(team.agents) else ("o", 8)
        edge = {"markeredgecolor": "white", "markeredgewidth": 0.6}
        panel.plot(*place[v], marker, markersize=size if few else 3, color=colours[groups[v]], zorder=3, **edge)
        if few:
            panel.annotate(member.id, place[v], xytext=(5, 5), textcoords="offset points", fontsize=8, zorder=5)


def finish_map(panel: Any, margin: float, x_label: str = "x (m)") -> None:
    """Label a view from above, with one scale on both axes."""
    panel.set(xlabel=x_label, ylabel="y (m)")
    panel.set_aspect("equal", adjustable="datalim")
    panel.margins(margin)
    panel.grid(True, alpha=0.3)


def thin(samples: int, most: int) -> IntArray:
    """Indices of at most so many samples, evenly spread, the first and the last among them."""
    return np.unique(np.linspace(0, samples - 1, min(samples, most)).round().astype(np.int64))


def save_figure(figure: Figure, path: Path | BytesIO) -> None:
    """Write a figure as PNG; equal figures give equal bytes."""
    # No metadata: a version or date would make equal runs differ.
    figure.savefig(path, format="png", metadata={"Software": None})
