"""The writing of a video: a panel next to the scene with title, time, error and legend, and labels over the scene.

The constant part is one matplotlib figure, drawn once when the overlay is made. A frame costs a few pastes. The legend
has a row with a symbol for each thing that is drawn, and a bar of colours for each medium.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
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
from mjsheaf.show.played import Poses
from mjsheaf.show.style import OBSTACLE, STOPS, list_scales, round_number, speed_colours
from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, Moment, VideoOptions, error_range
from mjsheaf.video.scene import ABSENT, COMMUNICATION, RESTRAINED, SENSING

Colour = tuple[float, float, float]  # RGB in 0..1
WHITE, GREY, BLUE = (1.0, 1.0, 1.0), (0.75, 0.78, 0.83), (0.47, 0.84, 1.0)
PLATE = (0.03, 0.05, 0.08, 0.65)  # ground of what is written, RGBA in 0..1


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
WATER = np.array([0.36, 0.55, 0.68])  # behind arrows, RGB in 0..1
GAP = 0.8  # between a symbol and its words, in sizes of type


class Overlay:
    """Writes on frames. One is made for a video and a size of frame.

    Attributes:
        rows: Rows of the legend.
    """

    def __init__(
        self,
        film: Film,
        options: VideoOptions,
        survey: Poses,
        arrows: Mapping[str, tuple[float, int]] | None = None,
    ) -> None:
        """Draw everything that stays the same.

        Args:
            film: Content of the video.
            options: Size of the frame and so on.
            survey: Samples of the run, for the curve of its error.
            arrows: End of the scale of speeds, m/s, and number of the scale of colours of each medium by name.
        """
        self._film, self._unit = film, options.unit
        self._width, self._height = options.width, options.height
        self._panel, self._scene = options.panel, options.scene
        self._inner = max(self._panel - 2 * self._px(MARGIN), 1)
        self._left = self._px(MARGIN)
        size = self._panel / 72, options.height / 72
        figure = Figure(figsize=size, dpi=72, facecolor=(0.09, 0.13, 0.18))  # a point is a pixel
        canvas = FigureCanvasAgg(figure)
        self._add_title(figure)
        (curve,) = self._add_curve(figure, survey)
        self.rows = legend_rows(film, options, survey)
        top = self._height - self._px(STATUS_HEIGHT + 2 * MARGIN)
        bars = (BAR_ROOM * len(arrows) + BELOW_BARS) * self._unit if arrows else 0.0
        add_legend(figure, self.rows, (self._left, top, self._inner, top - self._px(MARGIN) - bars), SIZE * self._unit)
        add_bars(figure, arrows or {}, self._left, self._inner, self._unit)
        canvas.draw()
        self._whole = Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB")
        curve.set_visible(False)
        canvas.draw()
        self._bare = Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB")
        self._dot = text("●", self._px(12), WHITE)
        self._labels: list[tuple[int, Image.Image, Image.Image | None]] = []  # vehicle, name, and sign of a target
        for vehicle, name in enumerate(film.ids):
            target = vehicle >= film.agents
            if target or film.agents <= 24:  # labels of more than these would cover the picture
                tint = bright(film.colours[film.group[vehicle]])
                label = text(name, self._px(16 if target else 14), tint, bold=True, outline=self._px(2))
                sign = text("◇", self._px(32), tint, outline=self._px(1)) if target else None
                self._labels.append((vehicle, label, sign))
        ever = {agent for stage in film.stages for agent in stage.absent}
        self._grey = {i: text(film.agent_ids[i], self._px(14), GREY, bold=True, outline=self._px(2)) for i in ever}

    def write(self, image: Image.Image, moment: Moment, view: View) -> None:
        """Write on a frame, RGB, in place."""
        self._write_labels(image, moment, view)
        column, row = (float(np.interp(moment.time, self._curve_time, pixels)) for pixels in self._curve)
        # The curve is revealed up to now: the panel with it on the left, the panel without it on the right.
        split = max(round(column), 0)
        image.paste(self._bare, (0, 0))
        image.paste(self._whole.crop((0, 0, split, self._whole.height)), (0, 0))
        if np.isfinite(row):
            place = (round(column - self._dot.width / 2), round(row - self._dot.height / 2))
            image.paste(self._dot, place, self._dot)
        event = self._film.stages[self._film.stage(moment.time)].name
        time = f"t = {moment.time:.2f} s" + (f"   {event}" if event else "")
        error = f"RMS of |q* − q| = {number(moment.error)} m"
        draw = ImageDraw.Draw(image)
        self._write_scale(draw, view)
        for words, line, size, colour in ((time, TIME, 18, WHITE), (error, ERROR, 14, BLUE)):
            words = shorten(words, self._px(size), self._inner)
            draw.text((self._left, self._px(MARGIN + line)), words, to_hex(colour), font(self._px(size)))

    def _write_scale(self, draw: ImageDraw.ImageDraw, view: View) -> None:
        """Draw a bar of a round length at the bottom right, as long as that is at the team's centre."""
        metre = 1.0 / view.metres_per_pixel(self._height)
        length = round_number(self._px(150) / metre, up=False, steps=(1.0, 2.0, 5.0))
        right, row, width = self._width - self._px(2 * MARGIN), self._height - self._px(2 * MARGIN), self._px(2)
        left, end = right - length * metre, self._px(5)
        marks = [(x, row - end, x, row + end) for x in (left, right)]
        for thickness, colour in ((width + 2 * self._px(1), PLATE[:3]), (width, WHITE)):  # an outline, then the bar
            for ends in ((left, row, right, row), *marks):
                draw.line(ends, to_hex(colour), thickness)
        words = f"{length:g} m at the team's centre"
        outline: dict[str, Any] = {"stroke_width": self._px(2), "stroke_fill": to_hex(PLATE[:3])}
        draw.text((right, row - self._px(10)), words, to_hex(WHITE), font(self._px(13)), anchor="rs", **outline)

    def _add_title(self, figure: Figure) -> None:
        """Add title and subtitle at the top of the panel."""
        top = self._height - self._px(MARGIN)
        for words, row, size, colour, bold in (
            (self._film.name, TITLE, 24, WHITE, True),
            (self._film.subtitle, SUBTITLE, 14, GREY, False),
        ):
            words, pixels = fit(words, self._px(size), self._inner, bold)
            ascent, _ = font(self._px(size), bold).getmetrics()
            figure.text(
                self._left,
                top - self._px(row) - ascent,
                words,
                transform=None,
                fontsize=pixels,
                color=colour,
                weight="bold" if bold else "normal",
                parse_math=False,
            )

    def _add_curve(self, figure: Figure, survey: Poses) -> list[Line2D]:
        """Add the error over time on a log scale, and note where it is in the frame; return the curve."""
        left, width = self._left, max(self._inner - self._px(TICKS), 2)
        bottom = self._height - self._px(MARGIN + CURVE + CURVE_HEIGHT)
        size = (self._panel, self._height) * 2
        axes = figure.add_axes(tuple(np.divide((left, bottom, width, self._px(CURVE_HEIGHT)), size)))
        axes.set_facecolor((0.0, 0.0, 0.0, 0.35))
        axes.spines[:].set_visible(False)
        axes.tick_params(labelsize=self._px(11), colors=GREY, length=0, pad=self._px(4))
        axes.yaxis.tick_right()
        start, end = self._film.span
        room = 0.015 * max(end - start, 1e-9)
        axes.set_xlim(start - room, end + room)
        low, high = self._film.error_range or error_range(survey.error) or (1.0, 1.0)
        values = np.log10(np.clip(np.abs(survey.error), low, high))  # an error of zero lies on the floor
        known = np.isfinite(values)
        floor, top = np.log10(low), np.log10(high)
        room = 0.08 * max(top - floor, 1e-3)
        axes.set_ylim(floor - room, top + room)
        decades = np.arange(np.ceil(floor), np.floor(top) + 1)
        ticks = decades[:: max(1, len(decades) // 2)] if len(decades) > 1 else np.array([floor, top])
        labels = [f"{10.0**tick:.3g} m" for tick in ticks]
        axes.set_yticks(ticks, labels if known.any() else [""] * len(ticks))
        axes.set_xticks([start, end], [f"{time:.4g} s" for time in (start, end)])
        axes.grid(axis="y", color=GREY, alpha=0.25, linewidth=max(self._unit, 0.5))
        first, last = axes.get_xticklabels()
        first.set_horizontalalignment("left")
        last.set_horizontalalignment("right")
        curve = axes.plot(survey.time, values, color=BLUE, linewidth=1.6 * max(self._unit, 0.6))
        place = axes.transData.transform(np.column_stack([survey.time, np.where(known, values, floor)]))
        rows = np.where(known, self._height - place[:, 1], np.nan)
        self._curve_time, self._curve = survey.time, (place[:, 0], rows)
        return curve

    def _write_labels(self, image: Image.Image, moment: Moment, view: View) -> None:
        pixels, depth = view.project(moment.positions, *self._scene)
        pixels[:, 0] += self._panel
        absent = self._film.absent(moment.time)
        for vehicle, label, sign in self._labels:
            if depth[vehicle] <= 0:
                continue
            if vehicle in absent:
                label = self._grey[vehicle]
            column, row = np.clip(np.round(pixels[vehicle]), -1e5, 1e5).astype(int).tolist()
            if sign is not None:
                image.paste(sign, (column - sign.width // 2, row - sign.height // 2), sign)
            image.paste(label, (column + self._px(11), row - label.height - self._px(4)), label)

    def _px(self, size: float) -> int:
        """Convert a size given for a frame of the reference size to this frame's pixels."""
        return max(1, round(size * self._unit))


# -- the legend --------------------------------------------------------------------------------------------------------


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
    def lined(cls, words: str, rgba: Any, dashes: Any = "-", **style: Any) -> "Row":
        """Make a row with a line; `markersize` is in sizes of type."""
        return cls(words, {"color": tuple(rgba[:3].tolist()), "linestyle": dashes, "linewidth": 0.15} | style)

    def handle(self, size: float) -> Line2D:
        """Return the symbol for type of a size in pixels."""
        lengths = ("markersize", "markeredgewidth", "linewidth")
        return Line2D(
            [], [], **{name: value * size if name in lengths else value for name, value in self.style.items()}
        )


def legend_rows(film: Film, options: VideoOptions, survey: Poses) -> list[Row]:
    """List the legend's rows: groups, targets, q*, edges, tracks, heights, scales and speed; only what is shown.

    Args:
        film: The run to be drawn.
        options: Speed, trail and scales of vehicles.
        survey: Samples of the run.
    """
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
        rows.append(Row.marked("obstacle", OBSTACLE, "s"))
    if any(stage.absent for stage in film.stages):
        rows.append(Row.marked("lost, or yet to join", tuple(ABSENT[:3].tolist()), "o"))
    kinds = {kind for stage in film.stages for _, _, kind in stage.edges}
    if "communication" in kinds:
        rows.append(Row.lined("agents communicate", COMMUNICATION))
    if "one-way" in kinds:
        rows.append(Row.lined("agent senses agent, one way", COMMUNICATION, marker=">", markersize=0.6))
    if "sensing" in kinds:
        rows.append(Row.lined("agent senses target", SENSING, (0, (2.0, 1.4))))
    if film.restraints is not None:
        rows.append(Row.lined("the safety filter restrains an agent", RESTRAINED, marker="o", markersize=0.9))
    if options.trail:
        rows.append(Row.marked(f"track of the last {options.trail:g} s", GREY, r"$\sim$", markersize=1.5))
    # Lines to the surface begin at about 1 m.
    if film.surface != "none" and (np.abs(survey.positions[..., 2] - film.surface_height) > 1.0).any():
        rows.append(Row.marked("height above or below the surface", GREY, "|", markersize=1.2, markeredgewidth=0.09))
    if film.grid:
        square = {"markerfacecolor": "none", "markeredgewidth": 0.09}
        rows.append(Row.marked(f"squares {film.grid:g} m wide", GREY, "s", **square))
    scales = list_scales(film.kinds or film.ids, film.ids, film.scales)
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


def add_bars(figure: Figure, arrows: Mapping[str, tuple[float, int]], left: float, width: float, unit: float) -> None:
    """Add a bar of colours for the speed of each medium, above one another from the bottom of a figure in pixels.

    Args:
        figure: The figure; a point is a pixel.
        arrows: End of the scale of speeds, m/s, and number of the scale of colours, by the medium's name.
        left, width: Where bars begin, and how long they are.
        unit: Pixels in one of a 1000x720 frame.
    """
    size = (figure.bbox.width, figure.bbox.height) * 2
    for number, name in enumerate(reversed(list(arrows))):
        top, scale = arrows[name]
        bottom = (BELOW_BARS + BAR_ROOM * number) * unit
        axes = figure.add_axes(tuple(np.divide((left, bottom, width, max(BAR_HEIGHT * unit, 1.0)), size)))
        shades = speed_colours(scale, np.linspace(0.0, 1.0, 128))
        opacity = shades[:, 3:]
        blended = opacity * shades[:, :3] + (1.0 - opacity) * WATER
        axes.imshow(blended[None], aspect="auto", extent=(0.0, top, 0.0, 1.0))
        axes.set_yticks([])
        axes.set_xticks([0.0, top / 2.0, top], ["0", f"{top / 2.0:g}", f"{top:g} m/s"])
        first, _, last = axes.get_xticklabels()
        first.set_horizontalalignment("left")
        last.set_horizontalalignment("right")
        axes.spines[:].set_visible(False)
        axes.tick_params(labelsize=11 * unit, colors=GREY, length=0, pad=3 * unit)
        axes.set_title(f"speed of the {name}", loc="left", fontsize=SIZE * unit, color=WHITE, pad=5 * unit, x=0.14)
        tint = tuple(STOPS[scale % len(STOPS), 1, :3].tolist())
        above = bottom + (BAR_HEIGHT + 10.5) * unit
        arrow = Line2D(
            [left + 0.05 * width], [above], marker=r"$\rightarrow$", color=tint, markersize=1.6 * SIZE * unit
        )
        arrow.set(transform=None, linestyle="none", markeredgewidth=0.0)
        figure.add_artist(arrow)


# -- lettering ---------------------------------------------------------------------------------------------------------


@cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib and so is on every machine; size in pixels."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name
    return ImageFont.truetype(str(path), size, layout_engine=ImageFont.Layout.BASIC)


def text(words: str, size: int, colour: Colour, bold: bool = False, outline: int = 0) -> Image.Image:
    """Draw text on a transparent RGBA image. A dark outline, in pixels, makes it legible on any background."""
    left, top, right, bottom = font(size, bold).getbbox(words, stroke_width=outline)
    image = Image.new("RGBA", (int(right - left) + 1, int(bottom - top) + 1))
    ImageDraw.Draw(image).text(
        (-left, -top),
        words,
        to_hex(colour),
        font(size, bold),
        stroke_width=outline,
        stroke_fill=to_hex((*PLATE[:3], 220 / 255), keep_alpha=True),
    )
    return image


def shorten(words: str, size: int, width: float, bold: bool = False) -> str:
    """Cut words with an ellipsis where they are wider than `width` pixels."""
    if font(size, bold).getlength(words) <= width:
        return words
    while words and font(size, bold).getlength(words + "…") > width:
        words = words[:-1]
    return words.rstrip() + "…"


def fit(words: str, size: int, width: float, bold: bool = False) -> tuple[str, int]:
    """Write words as large as they fit, down to two thirds of a size in pixels; longer ones are cut."""
    smallest = max(round(size * 2 / 3), 1)
    while size > smallest and font(size, bold).getlength(words) > width:
        size -= 1
    return shorten(words, size, width, bold), size


def number(value: float) -> str:
    """Format with three significant digits; scientific notation with two below 1e-3 or from 1e5."""
    if value == 0 or not np.isfinite(value):
        return f"{value:g}"
    if not 1e-3 <= abs(value) < 1e5:
        return f"{value:.1e}"
    return f"{value:.{max(0, 2 - int(np.floor(np.log10(abs(value)))))}f}"


def bright(colour: Array) -> Colour:
    """Mix a group's colour with white until it can be read on a dark ground."""
    luminance = float(colour @ [0.21, 0.72, 0.07])
    white = max(0.0, (0.66 - luminance) / (1 - luminance)) if luminance < 1 else 0.0
    red, green, blue = (float(part) for part in colour + white * (1 - colour))
    return red, green, blue
