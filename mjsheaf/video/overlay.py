"""The writing over the picture: title, time, error, legend, labels.

The constant part is one matplotlib figure, drawn once when the overlay is made. A frame costs a few pastes.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image, ImageDraw

from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, Moment, Samples, VideoOptions, error_range
from mjsheaf.video.legend import SIZE, add_bars, add_legend, bars_height, legend_rows
from mjsheaf.video.scene import round_length
from mjsheaf.video.text import BLUE, GREY, PANEL_GROUND, PLATE, WHITE, bright, fit, font, number, shorten, text

LABELLED_AGENTS = 24  # labels of more than these would cover the picture

# Sizes in pixels of a 1000x720 frame.
MARGIN = 14
SCALE_BAR = 150  # longest
TITLE, SUBTITLE, TIME, ERROR, CURVE, STATUS_HEIGHT = 8, 40, 66, 93, 120, 202  # rows of the status
CURVE_HEIGHT, TICKS = 58, 56  # height of the curve; width of the numbers next to it


class Overlay:
    """Writes on frames. One is made for a video and a size of frame.

    Attributes:
        rows: Rows of the legend.
    """

    def __init__(
        self,
        film: Film,
        options: VideoOptions,
        survey: Samples,
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
        figure = Figure(figsize=size, dpi=72, facecolor=PANEL_GROUND)  # a point is a pixel
        canvas = FigureCanvasAgg(figure)
        self._add_title(figure)
        (curve,) = self._add_curve(figure, survey)
        self.rows = legend_rows(film, options, survey)
        self._add_legend(figure, arrows or {})
        canvas.draw()
        self._whole = Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB")
        curve.set_visible(False)
        canvas.draw()
        self._bare = Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB")
        self._dot = text("●", self._px(12), WHITE)
        self._labels = self._draw_labels()
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
            _paste(image, self._dot, (round(column - self._dot.width / 2), round(row - self._dot.height / 2)))
        stages = self._film.stages
        event = stages[self._film.stage(moment.time)].name if stages else ""
        time = f"t = {moment.time:.2f} s" + (f"   {event}" if event else "")
        error = f"RMS of |q* − q| = {number(moment.error)} m"
        draw = ImageDraw.Draw(image)
        self._write_scale(draw, view)
        for words, line, size, colour in ((time, TIME, 18, WHITE), (error, ERROR, 14, BLUE)):
            words = shorten(words, self._px(size), self._inner)
            draw.text((self._left, self._px(MARGIN + line)), words, to_hex(colour), font(self._px(size)))

    def _add_legend(self, figure: Figure, arrows: Mapping[str, tuple[float, int]]) -> None:
        """Add the legend and the bars of colours below the status."""
        top = self._height - self._px(STATUS_HEIGHT + 2 * MARGIN)
        height = top - self._px(MARGIN) - bars_height(arrows, self._unit)
        add_legend(figure, self.rows, (self._left, top, self._inner, height), SIZE * self._unit)
        add_bars(figure, arrows, self._left, self._inner, self._unit)

    def _write_scale(self, draw: ImageDraw.ImageDraw, view: View) -> None:
        """Draw a bar of a round length at the bottom right, as long as that is at the team's centre."""
        metre = 1.0 / view.metres_per_pixel(self._height)
        length = round_length(self._px(SCALE_BAR) / metre)
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

    def _add_curve(self, figure: Figure, survey: Samples) -> list[Line2D]:
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
                _paste(image, sign, (column - sign.width // 2, row - sign.height // 2))
            _paste(image, label, (column + self._px(11), row - label.height - self._px(4)))

    def _px(self, size: float) -> int:
        """Convert a size given for a frame of the reference size to this frame's pixels."""
        return max(1, round(size * self._unit))


def _paste(image: Image.Image, part: Image.Image, place: tuple[int, int]) -> None:
    """Lay an RGBA image over a frame, its top left corner at a pixel; what falls outside is cut off."""
    image.paste(part, place, part)
