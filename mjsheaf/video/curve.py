"""The small curve of the error, which grows as the video plays."""

import numpy as np
from PIL import Image, ImageDraw

from mjsheaf.video.film import Film
from mjsheaf.video.renderer import Frame
from mjsheaf.video.sampling import between
from mjsheaf.video.series import FloatArray
from mjsheaf.video.sprite import GREY, Colour, Sprite, fine, font

DECADES = 6  # most that the curve shows; smaller values lie on its floor
LINE: Colour = (120, 214, 255)


class ErrorCurve:
    """A film's error over its whole duration, on a log scale, with its largest and smallest value.

    The whole curve is drawn once; a frame shows it up to that frame's time.

    Attributes:
        plate: what stays the same, to be put under it: a dark ground and the two values. RGBA.
    """

    def __init__(self, film: Film, width: int, height: int, unit: float) -> None:
        """Draw the curve.

        Args:
            film: gives time and error.
            width: of the whole, in pixels.
            height: of the whole, in pixels.
            unit: pixels of this frame in one of a 1000x720 frame.
        """
        self._start, self._duration = float(film.time[0]), float(film.time[-1] - film.time[0])
        size = max(1, round(11 * unit))
        columns = max(2, width - round(58 * unit))
        self._edge = max(2, round(4 * unit))
        rows, low, high = _rows(film, columns - 2 * self._edge, self._edge, height - 1 - self._edge)
        self._rows = rows

        self.plate = Image.new("RGBA", (width, height))
        draw = ImageDraw.Draw(self.plate)
        draw.rectangle((0, 0, columns, height), (0, 0, 0, 90))
        for value, anchor, row in ((high, "lt", 1), (low, "ls", height - 1)):
            if np.isfinite(value):
                draw.text((columns + round(5 * unit), row), number(value), GREY, font(size), anchor=anchor)

        def paint(draw: ImageDraw.ImageDraw, scale: int) -> None:
            joints = [((self._edge + x) * scale, y * scale) for x, y in enumerate(rows) if np.isfinite(y)]
            if len(joints) > 1:
                draw.line(joints, (*LINE, 255), round(1.6 * max(unit, 0.6) * scale), joint="curve")

        def dot(draw: ImageDraw.ImageDraw, scale: int) -> None:
            draw.ellipse((0, 0, 2 * self._edge * scale, 2 * self._edge * scale), (255, 255, 255, 255))

        self._curve = Sprite.of(fine(columns, height, paint))
        self._dot = Sprite.of(fine(2 * self._edge + 1, 2 * self._edge + 1, dot))

    def lay(self, frame: Frame, left: int, top: int, time: float) -> None:
        """Draw it up to a time, in s, with its top left corner at the given pixel of the frame."""
        share = (time - self._start) / self._duration if self._duration > 0 else 1.0
        column = round(share * (len(self._rows) - 1))
        self._curve.lay(frame, left, top, columns=self._edge + column + 1)
        if np.isfinite(self._rows[column]):
            self._dot.lay(frame, left + column, top + round(self._rows[column]) - self._edge)


def number(value: float) -> str:
    """Write three digits, as a person would; two and an exponent where the value is very small or large."""
    if value == 0 or not np.isfinite(value):
        return f"{value:g}"
    if not 1e-3 <= abs(value) < 1e5:
        return f"{value:.1e}"
    return f"{value:.{max(0, 2 - int(np.floor(np.log10(abs(value)))))}f}"


def error_range(*errors: FloatArray) -> tuple[float, float] | None:
    """The lowest and highest value of an axis that shows all of these errors, at most DECADES apart.

    None where none of them is finite and positive.
    """
    sizes = np.abs(np.concatenate([np.ravel(error) for error in errors]))
    shown = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    if not len(shown):
        return None
    high = float(shown.max())
    return max(float(shown.min()), high / 10.0**DECADES), high


def _rows(film: Film, columns: int, top: int, bottom: int) -> tuple[FloatArray, float, float]:
    """Return the curve's row in each column, NaN where it has none, and the values at its bottom and top."""
    times = np.linspace(film.time[0], film.time[-1], max(columns, 1))
    values = np.abs(between(film, film.error, times))
    axis = film.error_range or error_range(values)
    if axis is None:
        return np.full(len(times), np.nan), np.nan, np.nan
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        low, high, values = np.log10(axis[0]), np.log10(axis[1]), np.log10(values)
    # An error of zero has no logarithm, and lies on the floor with the smallest.
    values = np.where(np.isneginf(values), low, values)
    share = (np.clip(values, low, high) - low) / max(high - low, 1e-3)
    return np.where(np.isfinite(values), bottom - share * (bottom - top), np.nan), *axis
