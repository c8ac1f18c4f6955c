"""The figure of the packages: what a run goes through, from the file to what is looked at."""

from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

import mjsheaf
from mjsheaf.show.plots import new_figure

_BLUE, _BROWN, _GREY = "#0072B2", "#B45309", "#4B5563"

# Left end, bottom, width and colour of each box, and what is in it.
BOXES: dict[str, tuple[float, float, float, str, str]] = {
    "cli": (0.1, 5.3, 1.4, _BROWN, "the commands"),
    "runs": (1.8, 5.3, 1.9, _BROWN, "one run, its directory"),
    "studies": (4.0, 5.3, 1.4, _BROWN, "many runs"),
    "comparing": (5.7, 5.3, 2.0, _BROWN, "theory with physics"),
    "envs": (8.0, 5.3, 1.9, _BROWN, "for learning"),
    "scenario": (0.1, 2.9, 1.4, _BLUE, "the file"),
    "team": (1.8, 4.1, 1.9, _BLUE, "edges, links, q*"),
    "law": (1.8, 3.3, 1.9, _BLUE, "commands; targets"),
    "media": (1.8, 2.5, 1.9, _BLUE, "flow, gusts, waves"),
    "vehicles": (1.8, 1.7, 1.9, _BLUE, "bodies, thrusters"),
    "loop": (4.0, 2.9, 1.4, _BLUE, "System, engines"),
    "results": (5.7, 2.9, 2.0, _BLUE, "variables, sinks"),
    "show": (8.0, 2.9, 1.9, _BLUE, "what is where; plots"),
    "live": (5.7, 4.1, 2.0, _BLUE, "watched, changed"),
    "page": (8.0, 4.1, 0.9, _BLUE, "replay"),
    "video": (9.0, 4.1, 0.9, _BLUE, "film"),
    "export": (8.0, 1.7, 1.9, _BLUE, "MCAP, ROS 2"),
    "checking": (4.0, 1.7, 3.7, _BROWN, "assumptions, Theorem 1, the linear loop"),
    "sheaf": (0.1, 0.5, 3.6, _GREY, "the linear algebra of sheaves"),
    "recordings": (4.0, 0.5, 2.3, _GREY, "positions out of files"),
    "compile": (6.6, 0.5, 3.3, _GREY, "what compiles functions"),
}

ARROWS = (
    *(("scenario", part) for part in ("team", "law", "media", "vehicles")),
    *((part, "loop") for part in ("team", "law", "media", "vehicles")),
    *(("loop", "results"), ("loop", "live"), ("loop", "checking"), ("results", "show")),
    *(("show", "page"), ("show", "video"), ("show", "export")),
)
_HIGH = 0.62


def draw() -> Figure:
    """Draw the packages and what they hand on.

    Raises:
        ValueError: A package has no box, or a box no package.
    """
    packages = {place.parent.name for place in Path(mjsheaf.__file__).parent.glob("*/__init__.py")}
    if packages != set(BOXES):
        raise ValueError(f"packages without a box, or boxes without a package: {packages ^ set(BOXES)}")
    figure = new_figure(7.6, 4.6, "")
    figure.set_layout_engine("none")
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set(xlim=(0.0, 10.0), ylim=(0.3, 6.3))
    axis.set_axis_off()
    headings = {6.1: "call what is below", 4.9: "a run, from its file to what is looked at", 1.3: "underneath"}
    for row, words in headings.items():
        axis.text(0.1, row, words, ha="left", va="center", fontsize=8, color=_GREY, style="italic")
    for name, (left, bottom, width, colour, content) in BOXES.items():
        shape = "round,pad=0.0,rounding_size=0.1"
        axis.add_patch(FancyBboxPatch((left, bottom), width, _HIGH, shape, facecolor=f"{colour}14", edgecolor=colour))
        middle = {"x": left + width / 2, "ha": "center", "va": "center"}
        axis.text(y=bottom + 0.41, s=name, fontsize=9, weight="bold", color=colour, **middle)
        axis.text(y=bottom + 0.18, s=content, fontsize=7, **middle)
    for tail, head in ARROWS:
        _connect(axis, BOXES[tail], BOXES[head])
    return figure


def _connect(axis: Any, tail: tuple[float, float, float, str, str], head: tuple[float, float, float, str, str]) -> None:
    """Draw an arrow from the right side of a box to the left one of another, or from above to below."""
    (left, bottom, width, *_), (to, below, wide, *_) = tail, head
    start, end = (left + width, bottom + _HIGH / 2), (to, below + _HIGH / 2)
    if to < left + width:
        middle, up = max(left, to) + min(width, wide) / 2, below > bottom
        start, end = (middle, bottom + _HIGH * up), (middle, below + _HIGH * (not up))
    style = {"arrowstyle": "-|>", "color": _GREY, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", end, start, arrowprops=style)


def write(path: Path) -> None:
    """Write the figure as SVG; equal figures give equal bytes."""
    with rc_context({"svg.hashsalt": "mjsheaf"}):
        draw().savefig(path, format="svg", metadata={"Date": None, "Creator": None}, facecolor="white")
