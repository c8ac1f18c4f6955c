"""The writing of a video: a panel next to the scene with title, time, error and legend, and labels over the scene.

The constant part is one matplotlib figure, drawn once when the overlay is made. A frame costs a few pastes. The legend
has a row with a symbol for each thing that is drawn, and a bar of colours for each medium.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.transforms import IdentityTransform
from PIL import Image, ImageDraw, ImageFont

from mjsheaf.arrays import Array
from mjsheaf.show.played import Medium, Poses
from mjsheaf.show.style import OBSTACLE, STOPS, list_scales, round_number, speed_colours
from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, Moment, VideoOptions, error_range
from mjsheaf.video.scene import ABSENT, COMMUNICATION, RESTRAINED, SENSING

Colour = tuple[float, float, float]  # RGB in 0..1
WHITE, GREY, BLUE = (1.0, 1.0, 1.0), (0.75, 0.78, 0.83), (0.47, 0.84, 1.0)
OUTLINE = (0.03, 0.05, 0.08)  # of what is written over the scene, RGB in 0..1


# Sizes in pixels of a 1000x720 frame.
MARGIN = 14
TITLE, SUBTITLE, TIME, ERROR, CURVE, STATUS_HEIGHT = 8, 40, 66, 93, 120, 202  # rows of the status
CURVE_HEIGHT, TICKS = 58, 56  # height of the curve; width of the numbers next to it

MAX_GROUPS = 8  # with a row each
MAX_SCALES = 4  # rows on vehicles that are drawn larger
SIZE = 13  # of type, in pixels of a 1000x720 frame
BELOW_BARS = 30  # room for the numbers of the lowest bar
BAR_HEIGHT, BAR_ROOM = 9, 52  # of a bar of colours, and of all that belongs to it
HANDLE = 2.0  # width of symbols, in sizes of type
GAP = 0.8  # between a symbol and its words, in sizes of type


class Overlay:
    """Writes on frames. One is made for a video and a size of frame.

    Attributes:
        rows: Symbols of the legend, with their labels.
    """

    def __init__(self, film: Film, options: VideoOptions, survey: Poses) -> None:
        """Draw everything that stays the same.

        Args:
            film: Content of the video.
            options: Size of the frame and so on.
            survey: Samples of the run, for the curve of its error.
        """
        self._film, self._options = film, options
        self._inner = max(self._options.panel - 2 * self._px(MARGIN), 1)
        self._left = self._px(MARGIN)
        size = self._options.panel / 72, options.height / 72
        figure = Figure(figsize=size, dpi=72, facecolor=(0.09, 0.13, 0.18))  # a point is a pixel
        canvas = FigureCanvasAgg(figure)
        (curve,) = self._add_curve(figure, survey)
        self.rows = legend_rows(film, options, survey)
        top = self._options.height - self._px(STATUS_HEIGHT + 2 * MARGIN)
        bars = (BAR_ROOM * len(film.media) + BELOW_BARS) * options.unit if film.media else 0.0
        add_legend(
            figure, self.rows, (self._left, top, self._inner, top - self._px(MARGIN) - bars), SIZE * self._options.unit
        )
        add_bars(figure, film.media, self._left, self._inner, options.unit)
        curve.set_visible(False)
        canvas.draw()
        self._bare = Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB")
        curve.set_visible(True)
        figure.draw_artist(curve)
        self._whole = Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB")
        # The names of more agents would cover the picture.
        labelled = range(film.vehicles) if film.agents <= 24 else range(film.agents, film.vehicles)
        self._labels = {vehicle: bright(film.colours[film.group[vehicle]]) for vehicle in labelled}

    def write(self, image: Image.Image, moment: Moment, view: View) -> None:
        """Write on a frame, RGB, in place."""
        draw = ImageDraw.Draw(image)
        self._write_labels(draw, moment, view)
        column, row = (float(np.interp(moment.time, self._curve_time, pixels)) for pixels in self._curve)
        # The curve is revealed up to now: the panel with it on the left, the panel without it on the right.
        split = max(round(column), 0)
        image.paste(self._bare, (0, 0))
        image.paste(self._whole.crop((0, 0, split, self._whole.height)), (0, 0))
        if np.isfinite(row):
            draw.text((column, row), "●", to_hex(WHITE), font(self._px(12)), anchor="mm")
        event = self._film.stages[self._film.stage(moment.time)].name
        time = f"t = {moment.time:.2f} s" + (f"   {event}" if event else "")
        error = f"RMS of |q* − q| = {moment.error:.3g} m"
        self._write_scale(draw, view)
        for words, line, size, colour, bold in (
            (self._film.name, TITLE, 24, WHITE, True),
            (self._film.subtitle, SUBTITLE, 14, GREY, False),
            (time, TIME, 18, WHITE, False),
            (error, ERROR, 14, BLUE, False),
        ):
            words, pixels = fit(words, self._px(size), self._inner, bold)
            draw.text((self._left, self._px(MARGIN + line)), words, to_hex(colour), font(pixels, bold))

    def _write_scale(self, draw: ImageDraw.ImageDraw, view: View) -> None:
        """Draw a bar of a round length at the bottom right, as long as that is at the team's centre."""
        metre = 1.0 / view.metres_per_pixel(self._options.height)
        length = round_number(self._px(150) / metre, up=False, steps=(1.0, 2.0, 5.0))
        right, row, width = (
            self._options.width - self._px(2 * MARGIN),
            self._options.height - self._px(2 * MARGIN),
            self._px(2),
        )
        left, end = right - length * metre, self._px(5)
        marks = [(x, row - end, x, row + end) for x in (left, right)]
        for thickness, colour in ((width + 2 * self._px(1), OUTLINE), (width, WHITE)):  # an outline, then the bar
            for ends in ((left, row, right, row), *marks):
                draw.line(ends, to_hex(colour), thickness)
        words = f"{length:g} m at the team's centre"
        self._write_outlined(draw, (right, row - self._px(10)), words, WHITE, font(self._px(13)), "rs")

    def _add_curve(self, figure: Figure, survey: Poses) -> list[Line2D]:
        """Add the error over time on a log scale, and note where it is in the frame; return the curve."""
        left, width = self._left, max(self._inner - self._px(TICKS), 2)
        bottom = self._options.height - self._px(MARGIN + CURVE + CURVE_HEIGHT)
        size = (self._options.panel, self._options.height) * 2
        axes = figure.add_axes(tuple(np.divide((left, bottom, width, self._px(CURVE_HEIGHT)), size)))
        axes.set_facecolor((0.0, 0.0, 0.0, 0.35))
        axes.yaxis.tick_right()
        start, end = self._film.span
        room = 0.015 * max(end - start, 1e-9)
        axes.set_xlim(start - room, end + room)
        known = self._film.error_range or error_range(survey.error)
        low, high = known or (1.0, 1.0)
        values = np.log10(np.clip(np.abs(survey.error), low, high))  # an error of zero lies on the floor
        floor, top = np.log10(low), np.log10(high)
        room = 0.08 * max(top - floor, 1e-3)
        axes.set_ylim(floor - room, top + room)
        axes.set_yticks([floor, top], [f"{error:.3g} m" if known else "" for error in (low, high)])
        axes.grid(axis="y", color=GREY, alpha=0.25, linewidth=max(self._options.unit, 0.5))
        label_ends(axes, [start, end], [f"{time:.4g} s" for time in (start, end)], self._options.unit)
        curve = axes.plot(survey.time, values, color=BLUE, linewidth=1.6 * max(self._options.unit, 0.6))
        columns, rows = axes.transData.transform(np.column_stack([survey.time, np.nan_to_num(values)])).T
        self._curve_time, self._curve = (
            survey.time,
            (columns, self._options.height - np.where(np.isnan(values), np.nan, rows)),
        )
        return curve

    def _write_labels(self, draw: ImageDraw.ImageDraw, moment: Moment, view: View) -> None:
        """Write the names of vehicles next to them, and draw a diamond around each target."""
        pixels, depth = view.project(moment.positions, *self._options.scene)
        pixels[:, 0] += self._options.panel
        absent = self._film.absent(moment.time)
        for vehicle, tint in self._labels.items():
            if depth[vehicle] <= 0:
                continue
            colour = GREY if vehicle in absent else tint
            column, row = np.clip(pixels[vehicle], -1e5, 1e5).round().tolist()
            target = vehicle >= self._film.agents
            if target:
                self._write_outlined(draw, (column, row - self._px(3)), "◇", colour, font(self._px(32)), "mm", 1)
            place = column + self._px(11), row - self._px(4)
            letters = font(self._px(16 if target else 14), bold=True)
            self._write_outlined(draw, place, self._film.ids[vehicle], colour, letters, "lb")

    def _write_outlined(
        self,
        draw: ImageDraw.ImageDraw,
        place: tuple[float, float],
        words: str,
        colour: Colour,
        letters: ImageFont.FreeTypeFont,
        anchor: str,
        width: int = 2,
    ) -> None:
        """Write with a dark outline, which makes words legible on any background; `width` is for 1000x720."""
        outline: dict[str, Any] = {"stroke_width": self._px(width), "stroke_fill": to_hex(OUTLINE)}
        draw.text(place, words, to_hex(colour), letters, anchor=anchor, **outline)

    def _px(self, size: float) -> int:
        """Convert a size given for a frame of the reference size to this frame's pixels."""
        return max(1, round(size * self._options.unit))


def label_ends(axes: Any, places: list[float], labels: list[str], unit: float) -> None:
    """Label an axis along the bottom of a panel without frame; the first and the last label stay within its width."""
    axes.set_xticks(places, labels)
    first, *_, last = axes.get_xticklabels()
    first.set_horizontalalignment("left")
    last.set_horizontalalignment("right")
    axes.spines[:].set_visible(False)
    axes.tick_params(labelsize=11 * unit, colors=GREY, length=0, pad=4 * unit)


# -- the legend --------------------------------------------------------------------------------------------------------


def legend_rows(film: Film, options: VideoOptions, survey: Poses) -> list[Line2D]:
    """List the legend's symbols with their labels, only for what is shown.

    They are those of groups, targets, q*, edges, tracks, heights, scales and speed.

    Args:
        film: The run to be drawn.
        options: Speed, trail and scales of vehicles.
        survey: Samples of the run.
    """
    em = SIZE * options.unit

    def marked(words: str, tint: Any, shape: str, size: float = 0.9, edge: float = 0.0, **style: Any) -> Line2D:
        """Return a marker; its size and the width of its edge are in sizes of type."""
        look = {"markersize": size * em, "markeredgewidth": edge * em, "linestyle": "none", "color": tint}
        return Line2D([], [], label=words, marker=shape, **look | style)

    def lined(words: str, rgba: Any, **style: Any) -> Line2D:
        """Return a line; `markersize` is in pixels."""
        return Line2D([], [], label=words, color=tuple(rgba[:3].tolist()), linewidth=0.15 * em, **style)

    of_agents = list(dict.fromkeys(film.group[: film.agents].tolist()))  # in order, each once
    of_targets = list(dict.fromkeys(film.group[film.agents :].tolist()))
    rows = [marked(film.group_names[g], film.colours[g], "o") for g in of_agents[:MAX_GROUPS]]
    # Targets may have one colour of their own, or several.
    of_target = bright(film.colours[of_targets[0]]) if len(of_targets) == 1 else WHITE
    kinds = {kind for stage in film.stages for _, _, kind in stage.edges}
    obstacles = film.obstacles is not None and len(film.obstacles.kind) > 0
    absent = any(stage.absent for stage in film.stages)
    more = len(of_agents) - MAX_GROUPS
    # Lines to the surface begin at about 1 m.
    off_surface = film.surface != "none" and (np.abs(survey.positions[..., 2] - film.surface_height) > 1.0).any()
    scales = list_scales(film.kinds or film.ids, film.ids, film.scales)
    larger = [f"drawn ×{scale:g}: {', '.join(names)}" for scale, names in scales[:MAX_SCALES]]
    others = [
        (more > 0, marked(f"and {more} more groups", GREY, r"$\cdots$", 1.3)),
        (of_targets, marked("target, does not cooperate", of_target, "D", 0.85, 0.12, markerfacecolor="none")),
        (film.agents, marked("q*: where an agent should be", (*GREY, 0.45), "o", edge=0.07, markeredgecolor=GREY)),
        (obstacles, marked("obstacle", OBSTACLE, "s")),
        (absent, marked("lost, or yet to join", tuple(ABSENT[:3].tolist()), "o")),
        ("communication" in kinds, lined("agents communicate", COMMUNICATION)),
        ("one-way" in kinds, lined("agent senses agent, one way", COMMUNICATION, marker=">", markersize=0.6 * em)),
        ("sensing" in kinds, lined("agent senses target", SENSING, linestyle=(0, (2.0, 1.4)))),
        (
            film.restraints is not None,
            lined("the safety filter restrains an agent", RESTRAINED, marker="o", markersize=0.9 * em),
        ),
        (options.trail, marked(f"track of the last {options.trail:g} s", GREY, r"$\sim$", 1.5)),
        (off_surface, marked("height above or below the surface", GREY, "|", 1.2, 0.09)),
        (film.grid, marked(f"squares {film.grid or 0:g} m wide", GREY, "s", edge=0.09, markerfacecolor="none")),
        *((True, marked(words, WHITE, r"$\nearrow$", 1.1)) for words in larger),
        (len(scales) > MAX_SCALES, marked("others are drawn larger too", WHITE, r"$\nearrow$", 1.1)),
        (options.speed != 1, marked(f"played {options.speed:g} times as fast", BLUE, ">")),
    ]
    return [*rows, *(row for shown, row in others if shown)]


def add_legend(figure: Figure, rows: list[Line2D], room: tuple[float, float, float, float], largest: float) -> Legend:
    """Add a legend to a figure, in the largest type with which all rows fit.

    Args:
        figure: The figure; a point is a pixel.
        rows: The legend's symbols, for the largest type, with their labels.
        room: Left, top, width and height of the room for it, in pixels.
        largest: Largest size of type, in pixels.
    """
    left, top, width, height = room
    size = max(min(largest, height / (1.75 * max(len(rows), 1))), 1.0)  # a row is 1.75 sizes of type high
    longest = width - (HANDLE + GAP) * size
    return figure.legend(
        rows,
        [shorten(str(row.get_label()), max(round(size), 1), longest) for row in rows],
        loc="upper left",
        bbox_to_anchor=(left, top),
        bbox_transform=IdentityTransform(),
        borderaxespad=0.0,
        borderpad=0.0,
        labelspacing=0.55,
        handlelength=HANDLE,
        handletextpad=GAP,
        markerscale=size / largest,
        fontsize=size,
        labelcolor=WHITE,
        frameon=False,
    )


def add_bars(figure: Figure, media: Sequence[Medium], left: float, width: float, unit: float) -> None:
    """Add a bar of colours for the speed of each medium, above one another from the bottom of a figure in pixels.

    Args:
        figure: The figure; a point is a pixel.
        media: The media.
        left, width: Where bars begin, and how long they are.
        unit: Pixels in one of a 1000x720 frame.
    """
    size = (figure.bbox.width, figure.bbox.height) * 2
    for number, medium in enumerate(reversed(media)):
        top = medium.top
        bottom = (BELOW_BARS + BAR_ROOM * number) * unit
        axes = figure.add_axes(tuple(np.divide((left, bottom, width, max(BAR_HEIGHT * unit, 1.0)), size)))
        axes.set_facecolor((0.36, 0.55, 0.68))  # water, behind arrows
        shades = speed_colours(medium.scale, np.linspace(0.0, 1.0, 128))
        axes.imshow(shades[None], aspect="auto", extent=(0.0, top, 0.0, 1.0))
        axes.set_yticks([])
        label_ends(axes, [0.0, top / 2.0, top], ["0", f"{top / 2.0:g}", f"{top:g} m/s"], unit)
        axes.set_title(
            f"speed of the {medium.name}", loc="left", fontsize=SIZE * unit, color=WHITE, pad=5 * unit, x=0.14
        )
        tint = tuple(STOPS[medium.scale % len(STOPS), 1, :3].tolist())
        above = bottom + (BAR_HEIGHT + 3) * unit
        figure.text(left, above, "→", transform=None, fontsize=1.6 * SIZE * unit, color=tint)


# -- lettering ---------------------------------------------------------------------------------------------------------


@cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib and so is on every machine; size in pixels."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name
    return ImageFont.truetype(str(path), size, layout_engine=ImageFont.Layout.BASIC)


def shorten(words: str, size: int, width: float, bold: bool = False) -> str:
    """Cut words with an ellipsis where they are wider than `width` pixels."""
    if font(size, bold).getlength(words) <= width:
        return words
    while words and font(size, bold).getlength(words + "…") > width:
        words = words[:-1]
    return words.rstrip() + "…"


def fit(words: str, size: int, width: float, bold: bool = False) -> tuple[str, int]:
    """Write words as large as they fit, down to two thirds of a size in pixels; longer ones are cut."""
    fitting = int(size * width / max(font(size, bold).getlength(words), 1.0))
    size = max(min(size, fitting), round(size * 2 / 3), 1)
    return shorten(words, size, width, bold), size


def bright(colour: Array) -> Colour:
    """Mix a group's colour with white until it can be read on a dark ground."""
    luminance = float(colour @ [0.21, 0.72, 0.07])
    white = max(0.0, (0.66 - luminance) / (1 - luminance)) if luminance < 1 else 0.0
    red, green, blue = (float(part) for part in colour + white * (1 - colour))
    return red, green, blue
