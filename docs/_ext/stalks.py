"""The figure of stalks and restriction maps: a boat and a drone, drawn from a Sheaf."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from mjsheaf import Sheaf
from mjsheaf.show.plots import new_figure

PROJECTION = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Restriction map of the drone: its horizontal position."""
PLACES = {"boat": np.array([1.0, 3.0]), "drone": np.array([5.0, 1.0, 8.0])}
"""Positions, m."""

_COLOURS = {"boat": "#0072B2", "drone": "#B45309", "edge": "#4B5563"}
_COLUMN, _ROW = 0.34, 0.34  # between the numbers of a matrix


def sheaf() -> Sheaf:
    """Return the sheaf of a boat and a drone that compare horizontal positions."""
    found = Sheaf({"boat": 2, "drone": 3})
    found.add_edge("boat", "drone", np.eye(2), PROJECTION)
    return found


def draw() -> Figure:
    """Draw the stalks of both vertices and of the edge, the maps between them, the coboundary and its value."""
    s = sheaf()
    delta = s.coboundary().toarray()
    value = delta @ np.concatenate(list(PLACES.values()))
    shown = {"boat": delta[:, :2] @ PLACES["boat"], "drone": -delta[:, 2:] @ PLACES["drone"]}
    figure = new_figure(7.4, 3.7, "")
    figure.set_layout_engine("none")
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set(xlim=(0.0, 10.0), ylim=(0.0, 5.0))
    axis.set_axis_off()
    _box(axis, 1.35, "boat", "boat", "vertex stalk $\\mathbb{R}^2$", f"x = {vector(PLACES['boat'])}")
    _box(axis, 8.55, "drone", "drone", "vertex stalk $\\mathbb{R}^3$", f"x = {vector(PLACES['drone'])}")
    _box(axis, 4.95, "edge", "edge boat-drone", "edge stalk $\\mathbb{R}^2$", "horizontal position")
    for name, start, end, middle, matrix in (
        ("boat", 2.5, 3.75, 3.12, delta[:, :2]),
        ("drone", 7.4, 6.15, 6.78, -delta[:, 2:]),
    ):
        arrow = {"arrowstyle": "-|>", "color": _COLOURS[name], "linewidth": 1.6, "shrinkA": 0.0, "shrinkB": 0.0}
        axis.annotate("", (end, 3.55), (start, 3.55), arrowprops=arrow)
        _matrix(axis, middle, 4.2, matrix, [_COLOURS[name]] * matrix.shape[1])
        axis.text(middle, 4.72, f"$F_\\mathrm{{{name}}}$", ha="center", va="center", fontsize=10, color=_COLOURS[name])
        axis.text(middle, 3.25, f"sends {vector(shown[name])}", ha="center", va="center", fontsize=8,
                  color=_COLOURS[name])  # fmt: skip
    _draw_coboundary(axis, delta, value)
    kernel, cokernel = s.betti()
    axis.text(
        5.0, 0.32,
        f"$H^0 = \\ker\\delta$ has dimension {kernel}: the drone is above the boat, at any height.   "
        f"$H^1$ has dimension {cokernel}.",
        ha="center", va="center", fontsize=9,
    )  # fmt: skip
    return figure


def _draw_coboundary(axis: Any, delta: Any, value: Any) -> None:
    """Draw the coboundary, its columns in the colours of their vertices, and its value."""
    colours = [_COLOURS["boat"]] * 2 + [_COLOURS["drone"]] * 3
    axis.text(0.35, 1.6, "coboundary", ha="left", va="center", fontsize=9, color=_COLOURS["edge"])
    axis.text(1.75, 1.6, "$\\delta\\ =$", ha="left", va="center", fontsize=11)
    _matrix(axis, 3.35, 1.6, delta, colours)
    for name, at in (("boat", 2.84), ("drone", 3.69)):
        axis.text(at, 2.2, name, ha="center", va="center", fontsize=8, color=_COLOURS[name])
    words = "$\\delta x = F_\\mathrm{boat}\\,x_\\mathrm{boat} - F_\\mathrm{drone}\\,x_\\mathrm{drone}$"
    axis.text(4.9, 1.6, f"{words} = {vector(value)} m", ha="left", va="center", fontsize=10)
    axis.text(4.9, 1.12, "disagreement of the two", ha="left", va="center", fontsize=8, color=_COLOURS["edge"])


def _box(axis: Any, middle: float, colour: str, name: str, stalk: str, content: str) -> None:
    shape = "round,pad=0.02,rounding_size=0.12"
    tint = _COLOURS[colour]
    axis.add_patch(FancyBboxPatch((middle - 1.1, 2.95), 2.2, 1.2, shape, facecolor=f"{tint}14", edgecolor=tint))
    axis.text(middle, 3.9, name, ha="center", va="center", fontsize=10, color=tint, weight="bold")
    axis.text(middle, 3.55, stalk, ha="center", va="center", fontsize=9)
    axis.text(middle, 3.2, content, ha="center", va="center", fontsize=8)


def _matrix(axis: Any, x: float, y: float, values: Any, colours: list[str]) -> None:
    """Draw a matrix about a point, each column in its colour, between brackets."""
    rows, columns = values.shape
    wide = 0.5 * _COLUMN * columns
    high = 0.5 * _ROW * rows
    for side in (-1, 1):
        edge = x + side * wide
        tick = edge - side * 0.08
        axis.plot([tick, edge, edge, tick], [y - high, y - high, y + high, y + high], color="black", linewidth=0.9)
    for i in range(rows):
        for j in range(columns):
            place = (x + _COLUMN * (j - 0.5 * (columns - 1)), y - _ROW * (i - 0.5 * (rows - 1)))
            number = f"{values[i, j] + 0.0:.0f}".replace("-", "−")
            axis.text(*place, number, ha="center", va="center", fontsize=9, color=colours[j])


def vector(values: Any) -> str:
    """Format a vector with true minus signs."""
    return "(" + ", ".join(f"{v:g}".replace("-", "−") for v in values) + ")"


def write(path: Path) -> None:
    """Write the figure as SVG; equal figures give equal bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with rc_context({"svg.hashsalt": "mjsheaf"}):
        draw().savefig(path, format="svg", metadata={"Date": None, "Creator": None}, facecolor="white")
