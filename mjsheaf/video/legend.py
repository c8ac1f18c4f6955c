"""The legend of a video: a row with a symbol for each thing that is drawn, and a bar of colours for each medium.

It stands in a panel next to the scene, so that it hides no vehicle.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.transforms import IdentityTransform

from mjsheaf.video.film import Film, Samples, VideoOptions
from mjsheaf.video.flow import STOPS, colour
from mjsheaf.video.scene import ABSENT, COMMUNICATION, OBSTACLE, RESTRAINED, SENSING
from mjsheaf.video.sizes import list_scales
from mjsheaf.video.text import BLUE, GREY, WHITE, bright, shorten

MAX_GROUPS = 8  # with a row each
MAX_SCALES = 4  # rows on vehicles that are drawn larger
SIZE = 13  # of type, in pixels of a 1000x720 frame
BELOW_BARS = 30  # room for the numbers of the lowest bar
BAR_HEIGHT, BAR_ROOM = 9, 52  # of a bar of colours, and of all that belongs to it
HANDLE = 2.0  # width of symbols, in sizes of type
WATER = np.array([0.36, 0.55, 0.68])  # behind arrows, RGB in 0..1
GAP = 0.8  # between a symbol and its words, in sizes of type


@dataclass(frozen=True)
class Row:
    """A row of a legend.

    Attributes:
        words: What the symbol means.
        style: Matplotlib's properties of the symbol: a marker, a line or both.
    """

    words: str
    style: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def marked(cls, words: str, tint: Any, shape: str, **style: Any) -> "Row":
        """Make a row with a marker; `markersize` and `markeredgewidth` are in sizes of type."""
        plain = {"marker": shape, "color": tint, "linestyle": "none", "markersize": 0.9, "markeredgewidth": 0.0}
        return cls(words, plain | style)

    @classmethod
    def lined(cls, words: str, rgba: npt.NDArray[np.float32], dashes: Any = "-", **style: Any) -> "Row":
        """Make a row with a line; `markersize` is in sizes of type."""
        return cls(words, {"color": tuple(rgba[:3].tolist()), "linestyle": dashes, "linewidth": 0.15} | style)

    def handle(self, size: float) -> Line2D:
        """Return the symbol for type of a size in pixels."""
        lengths = ("markersize", "markeredgewidth", "linewidth")
        return Line2D(
            [], [], **{name: value * size if name in lengths else value for name, value in self.style.items()}
        )


def legend_rows(film: Film, options: VideoOptions, survey: Samples) -> list[Row]:
    """List the legend's rows: groups, targets, q*, edges, tracks, heights, scales and speed; only what is shown.

    Args:
        film: The run to be drawn.
        options: Speed, trail and scales of vehicles.
        survey: Samples of the run.
    """
    return [*_team_rows(film), *_edge_rows(film), *_notes(film, options, survey)]


def _team_rows(film: Film) -> list[Row]:
    of_agents = list(dict.fromkeys(film.group[: film.agents].tolist()))  # in order, each once
    of_targets = list(dict.fromkeys(film.group[film.agents :].tolist()))
    rows = [Row.marked(film.group_names[g], film.colours[g], "o") for g in of_agents[:MAX_GROUPS]]
    if len(of_agents) > MAX_GROUPS:
        dots = {"markersize": 1.3}
        rows.append(Row.marked(f"and {len(of_agents) - MAX_GROUPS} more groups", GREY, r"$\cdots$", **dots))
    hollow = {"markerfacecolor": "none", "markeredgewidth": 0.12, "markersize": 0.85}
    if of_targets:  # they may have one colour of their own, or several
        tint = bright(film.colours[of_targets[0]]) if len(of_targets) == 1 else WHITE
        rows.append(Row.marked("target, does not cooperate", tint, "D", **hollow))
    if film.agents:
        ball = {"markeredgecolor": GREY, "markeredgewidth": 0.07}
        rows.append(Row.marked("q*: where an agent should be", (*GREY, 0.45), "o", **ball))
    if film.obstacles is not None and len(film.obstacles.kind):
        rows.append(Row.marked("obstacle", tuple(OBSTACLE[:3].tolist()), "s"))
    if any(stage.absent for stage in film.stages):
        rows.append(Row.marked("lost, or yet to join", tuple(ABSENT[:3].tolist()), "o"))
    return rows


def _edge_rows(film: Film) -> list[Row]:
    kinds = {kind for edges in (film.edges, *(stage.edges for stage in film.stages)) for _, _, kind in edges}
    rows = []
    if "communication" in kinds:
        rows.append(Row.lined("agents communicate", COMMUNICATION))
    if "one-way" in kinds:
        rows.append(Row.lined("agent senses agent, one way", COMMUNICATION, marker=">", markersize=0.6))
    if "sensing" in kinds:
        rows.append(Row.lined("agent senses target", SENSING, (0, (2.0, 1.4))))
    if film.restraints is not None:
        rows.append(Row.lined("the safety filter restrains an agent", RESTRAINED, marker="o", markersize=0.9))
    return rows


def _notes(film: Film, options: VideoOptions, survey: Samples) -> list[Row]:
    rows = []
    if options.trail:
        rows.append(Row.marked(f"track of the last {options.trail:g} s", GREY, r"$\sim$", markersize=1.5))
    off = bool(
        (np.abs(survey.positions[..., 2] - film.surface_height) > 1.0).any()
    )  # lines to the surface begin at about 1 m
    if off and film.surface != "none":
        rows.append(Row.marked("height above or below the surface", GREY, "|", markersize=1.2, markeredgewidth=0.09))
    if film.grid:
        square = {"markerfacecolor": "none", "markeredgewidth": 0.09}
        rows.append(Row.marked(f"squares {film.grid:g} m wide", GREY, "s", **square))
    ids = [*film.agent_ids, *film.target_ids]
    scales = list_scales(film.kinds or ids, ids, film.scales(options))
    for scale, names in scales[:MAX_SCALES]:
        rows.append(Row.marked(f"drawn ×{scale:g}: {', '.join(names)}", WHITE, r"$\nearrow$", markersize=1.1))
    if len(scales) > MAX_SCALES:
        rows.append(Row.marked("others are drawn larger too", WHITE, r"$\nearrow$", markersize=1.1))
    if options.speed != 1:
        rows.append(Row.marked(f"played {options.speed:g} times as fast", BLUE, ">"))
    return rows


def add_legend(figure: Figure, rows: list[Row], room: tuple[float, float, float, float], size: float) -> Legend:
    """Add a legend to a figure; its type shrinks until all rows fit.

    Args:
        figure: The figure; a point is a pixel.
        rows: The legend's rows.
        room: Left, top, width and height of the room for it, in pixels.
        size: Largest size of type, in pixels.
    """
    left, top, width, height = room
    while True:
        longest = width - (HANDLE + GAP) * size
        legend = figure.legend(
            [row.handle(size) for row in rows],
            [shorten(row.words, max(round(size), 1), longest) for row in rows],
            loc="upper left",
            bbox_to_anchor=(left, top),
            bbox_transform=IdentityTransform(),
            borderaxespad=0.0,
            borderpad=0.0,
            labelspacing=0.55,
            handlelength=HANDLE,
            handletextpad=GAP,
            fontsize=size,
            labelcolor=WHITE,
            frameon=False,
        )
        taken = legend.get_window_extent().height
        if taken <= height or size <= 1.0:
            return legend
        legend.remove()
        size = max(min(0.95 * size, size * height / taken), 1.0)


def bars_height(arrows: Mapping[str, tuple[float, int]], unit: float) -> float:
    """Return the height that bars of colours take, in pixels."""
    return (BAR_ROOM * len(arrows) + BELOW_BARS) * unit if arrows else 0.0


def add_bars(figure: Figure, arrows: Mapping[str, tuple[float, int]], left: float, width: float, unit: float) -> None:
    """Add a bar of colours for the speed of each medium, above one another from the bottom of a figure in pixels.

    Args:
        figure: The figure; a point is a pixel.
        arrows: End of the scale of speeds, m/s, and number of the scale of colours, by the medium's name.
        left, width: Where bars begin, and how long they are.
        unit: Pixels in one of a 1000x720 frame.
    """
    for number, name in enumerate(reversed(list(arrows))):
        top, scale = arrows[name]
        bottom = (BELOW_BARS + BAR_ROOM * number) * unit
        axes = _add_bar(figure, scale, top, (left, bottom, width, max(BAR_HEIGHT * unit, 1.0)))
        axes.tick_params(labelsize=11 * unit, colors=GREY, length=0, pad=3 * unit)
        axes.set_title(f"speed of the {name}", loc="left", fontsize=SIZE * unit, color=WHITE, pad=5 * unit, x=0.14)
        tint = tuple(STOPS[scale % len(STOPS), 1, :3].tolist())
        above = bottom + (BAR_HEIGHT + 10.5) * unit
        arrow = Line2D(
            [left + 0.05 * width], [above], marker=r"$\rightarrow$", color=tint, markersize=1.6 * SIZE * unit
        )
        arrow.set(transform=None, linestyle="none", markeredgewidth=0.0)
        figure.add_artist(arrow)


def _add_bar(figure: Figure, scale: int, top: float, place: tuple[float, float, float, float]) -> Axes:
    """Add a bar of colours with its numbers; its place is left, bottom, width and height in pixels."""
    size = (figure.bbox.width, figure.bbox.height) * 2
    left, bottom, width, height = (float(each) for each in np.divide(place, size))
    axes = figure.add_axes((left, bottom, width, height))
    shades = colour(scale, np.linspace(0.0, 1.0, 128))
    opacity = shades[:, 3:]
    axes.imshow((opacity * shades[:, :3] + (1.0 - opacity) * WATER)[None], aspect="auto", extent=(0.0, top, 0.0, 1.0))
    axes.set_yticks([])
    axes.set_xticks([0.0, top / 2.0, top], ["0", f"{top / 2.0:g}", f"{top:g} m/s"])
    first, _, last = axes.get_xticklabels()
    first.set_horizontalalignment("left")
    last.set_horizontalalignment("right")
    axes.spines[:].set_visible(False)
    return axes
