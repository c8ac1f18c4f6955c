"""The writing over the picture: title, time, error, legend, labels.

The constant part is one matplotlib figure, drawn once when the overlay is made. A frame costs a few pastes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle
from PIL import Image, ImageDraw

from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, Moment, Samples, VideoOptions, error_range
from mjsheaf.video.legend import SIZE, add_bars, add_legend, bars_height, legend_rows
from mjsheaf.video.scene import round_length
from mjsheaf.video.text import BLUE, GREY, PANEL_GROUND, PLATE, WHITE, bright, fit, font, number, shorten, text

LABELLED_AGENTS = 24  # labels of more than these would cover the picture

# Sizes in pixels of a 1000x720 frame.
MARGIN, PAD, CORNER = 14, 12, 8
SCALE_BAR = 150  # longest
STATUS_WIDTH = (330, 460)  # of the status plate: as wide as its title needs, within these
TITLE, SUBTITLE, TIME, ERROR, CURVE, STATUS_HEIGHT = 8, 40, 66, 93, 120, 202  # rows in the status plate
CURVE_HEIGHT, TICKS = 58, 56  # height of the curve; width of the numbers next to it


class Overlay:
    """Writes on frames. One is made for a video and a size of frame.

    Attributes:
        rows: Rows of the legend; none where it is off.
    """

    def __init__(
        self,
        film: Film,
        options: VideoOptions,
        survey: Samples,
        beside: Sequence[Film] = (),
        arrows: Mapping[str, tuple[float, int]] | None = None,
    ) -> None:
        """Draw everything that stays the same.

        Args:
            film: Content of the video.
            options: Size of the frame and so on.
            survey: Samples of the run, for the curve of its error.
            beside: Content of the pictures next to this one, whose curves get the same size.
            arrows: End of the scale of speeds, m/s, and number of the scale of colours of each medium by name.
        """
        self._film, self._unit = film, options.unit
        self._width, self._height = options.width, options.height
        self._panel, self._scene = options.panel, options.scene
        self._inner = self._room_for_status((film, *beside))
        figure = Figure(figsize=(options.width / 72, options.height / 72), dpi=72)  # a point is a pixel
        figure.patch.set_alpha(0.0)
        plate = self._add_status(figure)
        curve = self._add_curve(figure, survey)
        self.rows = legend_rows(film, options, survey) if options.legend else []
        if options.legend:
            self._add_legend(figure, arrows or {})
        ((self._whole, self._status_place),) = _cut(figure, plate)
        curve.set_visible(False)
        ((self._bare, _),) = _cut(figure, plate)
        self._dot = text("●", self._px(12), WHITE)
        self._labels = self._draw_labels()
        ever = {agent for stage in film.stages for agent in stage.absent}
        self._grey = {i: text(film.agent_ids[i], self._px(14), GREY, bold=True, outline=self._px(2)) for i in ever}

    def write(self, image: Image.Image, moment: Moment, view: View) -> None:
        """Write on a frame, RGB, in place."""
        self._write_labels(image, moment, view)
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
        error = f"RMS of |q* − q| = {number(moment.error)} m"
        draw = ImageDraw.Draw(image)
        self._write_scale(draw, view)
        for words, line, size, colour in ((time, TIME, 18, WHITE), (error, ERROR, 14, BLUE)):
            words = shorten(words, self._px(size), self._inner)
            draw.text((self._left, self._px(MARGIN + line)), words, to_hex(colour), font(self._px(size)))

    def _room_for_status(self, films: Sequence[Film]) -> int:
        """Return the width of what is written in the status, in pixels; several videos side by side share one."""
        if self._panel:
            return max(self._panel - 2 * self._px(MARGIN), 1)
        title, note = font(self._px(24), bold=True), font(self._px(14))
        widest = max(max(title.getlength(film.name), note.getlength(film.subtitle)) for film in films)
        least, most = (self._px(width - 2 * PAD) for width in STATUS_WIDTH)
        return min(max(int(np.ceil(widest)), least), most)

    def _add_legend(self, figure: Figure, arrows: Mapping[str, tuple[float, int]]) -> None:
        """Add the legend and the bars of colours below the status."""
        left = self._left
        top = self._height - self._px(STATUS_HEIGHT + 2 * MARGIN)
        height = top - self._px(MARGIN) - bars_height(arrows, self._unit)
        add_legend(figure, self.rows, (left, top, self._inner, height), SIZE * self._unit)
        add_bars(figure, arrows, left, self._inner, self._unit)

    @property
    def _left(self) -> int:
        """Column at which the status begins, in pixels."""
        return self._px(MARGIN) if self._panel else self._px(MARGIN + PAD)

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

    def _add_status(self, figure: Figure) -> Artist:
        """Add the plate at the top left, with title and subtitle; return the plate."""
        top = self._height - self._px(MARGIN)
        plate = self._ground()
        figure.add_artist(plate)
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
        return plate

    def _ground(self) -> FancyBboxPatch | Rectangle:
        """Return the ground of the writing: the panel next to the scene, or a plate at the top left of the scene."""
        if self._panel:
            return Rectangle(
                (0, 0), self._panel, self._height, facecolor=PANEL_GROUND, linewidth=0, transform=None, zorder=-1
            )
        corner, top = self._px(CORNER), self._height - self._px(MARGIN)
        width, height = self._inner + 2 * self._px(PAD), self._px(STATUS_HEIGHT)
        return FancyBboxPatch(
            (self._px(MARGIN) + corner, top - height + corner),
            max(width - 2 * corner, 1),
            max(height - 2 * corner, 1),
            boxstyle=f"round,pad={corner},rounding_size={corner}",
            facecolor=PLATE,
            linewidth=0,
            transform=None,
            zorder=-1,
        )

    def _add_curve(self, figure: Figure, survey: Samples) -> Artist:
        """Add the error over time on a log scale, and note where it is in the frame; return the curve."""
        left, width = self._left, max(self._inner - self._px(TICKS), 2)
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
