"""The writing over the picture: title, time, error, legend, labels.

What stays the same is one matplotlib figure, drawn once when the overlay is made. A frame costs a few pastes.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import FancyBboxPatch
from PIL import Image, ImageDraw, ImageFont

from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, FloatArray, Moment, Samples, VideoOptions, error_range
from mjsheaf.video.scene import ABSENT, COMMUNICATION, SENSING, round_length

LABELLED_AGENTS = 24  # labels of more than these would cover the picture
MOST_GROUPS = 8  # in the legend, for the same reason

Colour = tuple[float, float, float]  # RGB in 0..1
WHITE, GREY, BLUE = (1.0, 1.0, 1.0), (0.75, 0.78, 0.83), (0.47, 0.84, 1.0)
PLATE = (0.03, 0.05, 0.08, 0.65)  # ground of what is written, RGBA in 0..1

# Sizes in pixels of a 1000x720 frame.
MARGIN, PAD, CORNER = 14, 12, 8
SCALE_BAR = 150  # longest
STATUS_WIDTH = (330, 460)  # of the status plate: as wide as its title needs, within these
TITLE, SUBTITLE, TIME, ERROR, CURVE, STATUS_HEIGHT = 8, 40, 66, 93, 120, 202  # rows in the status plate
CURVE_HEIGHT, TICKS = 58, 56  # of the curve; width of the numbers beside it


class Overlay:
    """Writes on frames. One is made for a film and a size of frame."""

    def __init__(
        self,
        film: Film,
        options: VideoOptions,
        survey: Samples,
        beside: Sequence[Film] = (),
        arrows: Mapping[str, tuple[float, npt.NDArray[np.float32]]] | None = None,
    ) -> None:
        """Draw everything that stays the same.

        Args:
            film: what is written about.
            options: size of the frame and so on.
            survey: the film at some times, for the curve of its error.
            beside: films whose pictures stand beside this one; their curves are of one size with its own.
            arrows: what arrows show: the speed of those of full length, m/s, and their colour.
        """
        self._film, self._unit = film, options.unit
        self._arrows = dict(arrows or {})
        self._width, self._height = options.width, options.height
        title, note = font(self._px(24), bold=True), font(self._px(14))
        widest = max(max(title.getlength(f.name), note.getlength(f.subtitle)) for f in (film, *beside))
        least, most = (self._px(width - 2 * PAD) for width in STATUS_WIDTH)
        self._inner = min(max(int(np.ceil(widest)), least), most)
        figure = Figure(figsize=(options.width / 72, options.height / 72), dpi=72)  # a point is a pixel
        figure.patch.set_alpha(0.0)
        plate = self._add_status(figure)
        curve = self._add_curve(figure, survey)
        legend = self._add_legend(figure, options, survey)
        (self._legend, self._legend_place), (self._whole, self._status_place) = _cut(figure, legend, plate)
        curve.set_visible(False)
        ((self._bare, _),) = _cut(figure, plate)
        self._dot = text("●", self._px(12), WHITE)
        self._labels = self._draw_labels()
        ever = {agent for stage in film.stages for agent in stage.absent}
        self._grey = {i: text(film.agent_ids[i], self._px(14), GREY, bold=True, outline=self._px(2)) for i in ever}

    def write(self, image: Image.Image, moment: Moment, view: View) -> None:
        """Write on a frame, RGB, in place."""
        self._write_labels(image, moment, view)
        _paste(image, self._legend, self._legend_place)
        column, row = (float(np.interp(moment.time, self._curve_time, pixels)) for pixels in self._curve)
        # The curve is revealed up to now: the plate with it on the left, the plate without it on the right.
        left, top = self._status_place
        split = max(round(column) - left, 0)
        _paste(image, self._whole.crop((0, 0, split, self._whole.height)), (left, top))
        _paste(image, self._bare.crop((split, 0, self._bare.width, self._bare.height)), (left + split, top))
        if np.isfinite(row):
            _paste(image, self._dot, (round(column - self._dot.width / 2), round(row - self._dot.height / 2)))
        stages = self._film.stages
        event = stages[self._film.stage(moment.time)].name if stages else ""
        time = f"t = {moment.time:.2f} s" + (f"   {event}" if event else "")
        error = f"mean |η| = {number(moment.error)} m"
        draw = ImageDraw.Draw(image)
        self._write_scale(draw, view)
        for words, line, size, colour in ((time, TIME, 18, WHITE), (error, ERROR, 14, BLUE)):
            words = shorten(words, self._px(size), self._inner)
            draw.text((self._px(MARGIN + PAD), self._px(MARGIN + line)), words, to_hex(colour), font(self._px(size)))

    def _write_scale(self, draw: ImageDraw.ImageDraw, view: View) -> None:
        """Draw a bar of a round length at the bottom right, as long as that is at the team's middle."""
        metre = 1.0 / view.metres_per_pixel(self._height)
        length = round_length(self._px(SCALE_BAR) / metre)
        right, row, width = self._width - self._px(2 * MARGIN), self._height - self._px(2 * MARGIN), self._px(2)
        left, end = right - length * metre, self._px(5)
        marks = [(x, row - end, x, row + end) for x in (left, right)]
        for thickness, colour in ((width + 2 * self._px(1), PLATE[:3]), (width, WHITE)):  # an outline, then the bar
            for ends in ((left, row, right, row), *marks):
                draw.line(ends, to_hex(colour), thickness)
        words = f"{length:g} m at the team's middle"
        outline: dict[str, Any] = {"stroke_width": self._px(2), "stroke_fill": to_hex(PLATE[:3])}
        draw.text((right, row - self._px(10)), words, to_hex(WHITE), font(self._px(13)), anchor="rs", **outline)

    def _add_status(self, figure: Figure) -> Artist:
        """Add the plate at the top left, with title and subtitle; return the plate."""
        corner, pad, top = self._px(CORNER), self._px(PAD), self._height - self._px(MARGIN)
        width, height = self._inner + 2 * pad, self._px(STATUS_HEIGHT)
        plate = FancyBboxPatch(
            (self._px(MARGIN) + corner, top - height + corner),
            max(width - 2 * corner, 1),
            max(height - 2 * corner, 1),
            boxstyle=f"round,pad={corner},rounding_size={corner}",
            facecolor=PLATE,
            linewidth=0,
            transform=None,
            zorder=-1,
        )
        figure.add_artist(plate)
        for words, row, size, colour, bold in (
            (self._film.name, TITLE, 24, WHITE, True),
            (self._film.subtitle, SUBTITLE, 14, GREY, False),
        ):
            ascent, _ = font(self._px(size), bold).getmetrics()
            figure.text(
                self._px(MARGIN) + pad,
                top - self._px(row) - ascent,
                shorten(words, self._px(size), self._inner, bold),
                transform=None,
                fontsize=self._px(size),
                color=colour,
                weight="bold" if bold else "normal",
            )
        return plate

    def _add_curve(self, figure: Figure, survey: Samples) -> Artist:
        """Add the error over time on a log scale, and note where it is in the frame; return the curve."""
        left, width = self._px(MARGIN + PAD), max(self._inner - self._px(TICKS), 2)
        bottom = self._height - self._px(MARGIN + CURVE + CURVE_HEIGHT)
        size = (self._width, self._height) * 2
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
        (curve,) = axes.plot(survey.time, values, color=BLUE, linewidth=1.6 * max(self._unit, 0.6))
        place = axes.transData.transform(np.column_stack([survey.time, np.where(known, values, floor)]))
        rows = np.where(known, self._height - place[:, 1], np.nan)
        self._curve_time, self._curve = survey.time, (place[:, 0], rows)
        return curve

    def _add_legend(self, figure: Figure, options: VideoOptions, survey: Samples) -> Legend:
        """Add what the colours and lines mean: groups of agents, targets, q*, edges, notes; only what is shown."""
        film, size = self._film, self._px(13)

        def marker(colour: Any, shape: str = "o", **style: Any) -> Line2D:
            style = {"markersize": 0.9 * size, "markeredgewidth": 0.0} | style
            return Line2D([], [], linestyle="none", marker=shape, color=colour, **style)

        def line(rgba: npt.NDArray[np.float32], style: Any) -> Line2D:
            return Line2D([], [], color=tuple(rgba[:3]), linestyle=style, linewidth=self._px(2))

        of_agents = list(dict.fromkeys(film.group[: film.agents].tolist()))  # in order, each once
        of_targets = list(dict.fromkeys(film.group[film.agents :].tolist()))
        rows = [(film.group_names[g], marker(film.colours[g])) for g in of_agents[:MOST_GROUPS]]
        if len(of_agents) > MOST_GROUPS:
            rows.append((f"and {len(of_agents) - MOST_GROUPS} more groups", marker("none")))
        if of_targets:  # they may have one colour of their own, or several
            colour = bright(film.colours[of_targets[0]]) if len(of_targets) == 1 else WHITE
            hollow = {"markerfacecolor": "none", "markeredgewidth": 0.12 * size, "markersize": 0.85 * size}
            rows.append(("target, does not cooperate", marker(colour, "D", **hollow)))
        if film.agents:
            ball = marker((*GREY, 0.45), markeredgecolor=GREY, markeredgewidth=0.07 * size)
            rows.append(("q*: where an agent should be", ball))
        kinds = {kind for _, _, kind in film.edges}
        if "communication" in kinds:
            rows.append(("agents communicate", line(COMMUNICATION, "-")))
        if "sensing" in kinds:
            rows.append(("agent senses target", line(SENSING, (0, (2.0, 1.4)))))
        if any(stage.absent for stage in film.stages):
            rows.append(("grey: lost, or yet to join", marker(tuple(ABSENT[:3]))))
        for name, (speed, rgba) in self._arrows.items():
            arrow = marker(tuple(rgba[:3]), r"$\rightarrow$", markersize=1.6 * size)
            rows.append((f"{name}: full arrow {speed:g} m/s or more", arrow))
        off = bool((np.abs(survey.positions[..., 2] - film.surface_height) > 1.0).any())  # 1 m; stems begin about there
        notes = [
            "upright line: to the surface" if off and film.surface != "none" else "",
            f"squares {film.grid:g} m wide" if film.grid else "",
            f"tracks {options.trail:g} s long" if options.trail else "",
            f"{options.speed:g}x speed" if options.speed != 1 else "",
            _larger(film, options),
        ]
        for several in (notes[:1], notes[1:3], notes[3:]):
            rows += [(", ".join(filter(None, several)), marker("none"))] if any(several) else []
        margin = self._px(MARGIN)
        return figure.legend(
            [handle for _, handle in rows],
            [words for words, _ in rows],
            loc="lower left",
            bbox_to_anchor=(margin / self._width, margin / self._height),
            borderaxespad=0.0,
            fontsize=size,
            labelcolor=WHITE,
            facecolor=PLATE[:3],
            framealpha=PLATE[3],
            edgecolor="none",
            borderpad=0.8,
        )

    def _draw_labels(self) -> list[tuple[int, Image.Image, Image.Image | None]]:
        """List index, name and sign of each vehicle with a label: targets, and agents if they are few."""
        film, labels = self._film, []
        for vehicle, name in enumerate([*film.agent_ids, *film.target_ids]):
            target = vehicle >= film.agents
            if target or film.agents <= LABELLED_AGENTS:
                colour = bright(film.colours[film.group[vehicle]])
                label = text(name, self._px(16 if target else 14), colour, bold=True, outline=self._px(2))
                sign = text("◇", self._px(32), colour, outline=self._px(1)) if target else None
                labels.append((vehicle, label, sign))
        return labels

    def _write_labels(self, image: Image.Image, moment: Moment, view: View) -> None:
        pixels, depth = view.project(moment.positions, self._width, self._height)
        absent = self._film.absent(moment.time)
        for vehicle, label, sign in self._labels:
            if depth[vehicle] <= 0:
                continue
            if vehicle in absent:
                label = self._grey[vehicle]
            column, row = np.clip(np.round(pixels[vehicle]), -1e5, 1e5).astype(int).tolist()
            if sign is not None:
                _paste(image, sign, (column - sign.width // 2, row - sign.height // 2))
            _paste(image, label, (column + self._px(11), row - label.height - self._px(4)))

    def _px(self, size: float) -> int:
        """Convert a size given for a frame of the reference size to this frame's pixels."""
        return max(1, round(size * self._unit))


def _larger(film: Film, options: VideoOptions) -> str:
    """How much larger vehicles are drawn, in words; empty where none is."""
    scales = film.scales(options)
    if np.ptp(scales) == 0.0:
        return f"vehicles drawn {scales[0]:g}x larger" if scales[0] != 1.0 else ""
    return f"vehicles drawn {scales.min():g}x to {scales.max():g}x larger"


def _cut(figure: Figure, *artists: Artist) -> list[tuple[Image.Image, tuple[int, int]]]:
    """Draw a figure and cut out what each artist covers: an RGBA image, and the pixel of its top left corner."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    drawn = Image.fromarray(np.asarray(canvas.buffer_rgba()))
    cuts = []
    for artist in artists:
        x0, y0, x1, y1 = artist.get_window_extent(canvas.get_renderer()).extents
        left, top = max(int(x0) - 1, 0), max(int(drawn.height - y1) - 1, 0)
        right, bottom = min(int(x1) + 2, drawn.width), min(int(drawn.height - y0) + 2, drawn.height)
        cuts.append((drawn.crop((left, top, max(right, left + 1), max(bottom, top + 1))), (left, top)))
    return cuts


def _paste(image: Image.Image, part: Image.Image, place: tuple[int, int]) -> None:
    """Lay an RGBA image over a frame, its top left corner at a pixel; what falls outside is cut off."""
    image.paste(part, place, part)


@cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib and so is on every machine; size in pixels."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name
    return ImageFont.truetype(str(path), size, layout_engine=ImageFont.Layout.BASIC)


def text(words: str, size: int, colour: Colour, bold: bool = False, outline: int = 0) -> Image.Image:
    """Write words on nothing, RGBA; with a dark outline, so many pixels wide, they are legible over anything."""
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


def number(value: float) -> str:
    """Format with three significant digits; scientific notation with two below 1e-3 or from 1e5."""
    if value == 0 or not np.isfinite(value):
        return f"{value:g}"
    if not 1e-3 <= abs(value) < 1e5:
        return f"{value:.1e}"
    return f"{value:.{max(0, 2 - int(np.floor(np.log10(abs(value)))))}f}"


def bright(colour: FloatArray) -> Colour:
    """Mix a group's colour with white until it can be read on a dark ground."""
    luminance = float(colour @ [0.21, 0.72, 0.07])
    white = max(0.0, (0.66 - luminance) / (1 - luminance)) if luminance < 1 else 0.0
    red, green, blue = (float(part) for part in colour + white * (1 - colour))
    return red, green, blue
