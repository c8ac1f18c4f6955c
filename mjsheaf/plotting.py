"""Figures without a display, and the colours of groups: the same in plots and videos."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from mjsheaf.arrays import Array, IntArray
from mjsheaf.team import Team

# Okabe and Ito's palette (distinct with any colour vision), then Tol's muted scheme for further groups.
_COLOURS = (
    *("#E69F00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"),
    *("#882255", "#44AA99", "#999933", "#332288", "#AA4499", "#117733"),
)
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


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG; equal figures give equal bytes."""
    # No metadata: a version or date would make equal runs differ.
    figure.savefig(path, format="png", metadata={"Software": None})
