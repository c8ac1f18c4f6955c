"""The writing over the picture: title, time, error, legend, labels.

Everything that stays the same is drawn once, when the overlay is made; a frame costs a few blends.
"""

import numpy as np

from mjsheaf.video.camera import View
from mjsheaf.video.curve import LINE, ErrorCurve, number
from mjsheaf.video.film import Film, VideoOptions
from mjsheaf.video.legend import bright, draw_legend
from mjsheaf.video.renderer import Frame
from mjsheaf.video.sampling import Moment
from mjsheaf.video.sprite import GREY, WHITE, Sprite, diamond, font, panel, shorten, text

LABELLED_AGENTS = 24  # labels of more than these would cover the picture

# Sizes in pixels of a 1000x720 frame.
MARGIN, PAD = 14, 12
STATUS_WIDTH = (330, 460)  # of the status plate: as wide as its title needs, within these
TITLE, SUBTITLE, TIME, ERROR, CURVE, CURVE_HEIGHT = 8, 40, 66, 93, 118, 54  # rows in the status plate


class Overlay:
    """Writes on frames. One is made for a film and a size of frame."""

    def __init__(self, film: Film, options: VideoOptions) -> None:
        self._film = film
        self._unit = options.unit
        self._width, self._height = options.width, options.height
        title = font(self._px(24), bold=True).getlength(film.name)
        subtitle = font(self._px(14)).getlength(film.subtitle)
        narrowest, widest = (self._px(width - 2 * PAD) for width in STATUS_WIDTH)
        self._inner = int(np.clip(np.ceil(max(title, subtitle)), narrowest, widest))
        self._curve = ErrorCurve(film, self._inner, self._px(CURVE_HEIGHT), self._unit)
        self._status = self._draw_status()
        self._legend = draw_legend(film, options)
        self._labels = self._draw_labels()

    def write(self, frame: Frame, moment: Moment, view: View) -> None:
        """Write on a frame, shape (height, width, 3), in place."""
        self._write_labels(frame, moment, view)
        self._write_status(frame, moment)
        margin = self._px(MARGIN)
        self._legend.lay(frame, margin, self._height - margin - self._legend.height)

    def _draw_status(self) -> Sprite:
        """Draw the plate at the top left, with all of it that stays the same."""
        image, draw = panel(self._inner + 2 * self._px(PAD), self._px(CURVE + CURVE_HEIGHT + PAD), self._px(8))
        name = shorten(self._film.name, self._px(24), self._inner, bold=True)
        draw.text((self._px(PAD), self._px(TITLE)), name, WHITE, font(self._px(24), bold=True))
        subtitle = shorten(self._film.subtitle, self._px(14), self._inner)
        draw.text((self._px(PAD), self._px(SUBTITLE)), subtitle, GREY, font(self._px(14)))
        image.alpha_composite(self._curve.plate, (self._px(PAD), self._px(CURVE)))
        return Sprite.of(image)

    def _write_status(self, frame: Frame, moment: Moment) -> None:
        margin = self._px(MARGIN)
        left = margin + self._px(PAD)
        self._status.lay(frame, margin, margin)
        time = f"t = {moment.time:.2f} s"
        text(time, self._px(18), WHITE).lay(frame, left, margin + self._px(TIME))
        error = f"{self._film.error_name} = {number(moment.error)} {self._film.error_unit}".rstrip()
        error = shorten(error, self._px(14), self._inner)
        text(error, self._px(14), LINE).lay(frame, left, margin + self._px(ERROR))
        self._curve.lay(frame, left, margin + self._px(CURVE), moment.time)

    def _draw_labels(self) -> list[tuple[int, Sprite, Sprite | None]]:
        """List index, name and sign of each vehicle with a label: targets, and agents if they are few."""
        film, labels = self._film, []
        for vehicle, name in enumerate([*film.agent_ids, *film.target_ids]):
            target = vehicle >= film.agents
            if target or film.agents <= LABELLED_AGENTS:
                colour = bright(film.colours[film.group[vehicle]])
                label = text(name, self._px(16 if target else 14), colour, bold=True, outline=True)
                labels.append((vehicle, label, Sprite.of(diamond(self._px(26), colour)) if target else None))
        return labels

    def _write_labels(self, frame: Frame, moment: Moment, view: View) -> None:
        pixels, depth = view.project(moment.positions, self._width, self._height)
        for vehicle, label, sign in self._labels:
            column, row = np.clip(np.round(pixels[vehicle]), -1e5, 1e5).astype(int).tolist()
            if depth[vehicle] <= 0:
                continue
            if sign is not None:
                sign.lay(frame, column - sign.width // 2, row - sign.height // 2)
            label.lay(frame, column + self._px(11), row - label.height - self._px(4))

    def _px(self, size: float) -> int:
        """Convert a size given for a frame of the reference size to this frame's pixels."""
        return max(1, round(size * self._unit))
