"""Lettering and colours of what is written over a video."""

from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.colors import to_hex
from PIL import Image, ImageDraw, ImageFont

from mjsheaf.video.film import FloatArray

Colour = tuple[float, float, float]  # RGB in 0..1
WHITE, GREY, BLUE = (1.0, 1.0, 1.0), (0.75, 0.78, 0.83), (0.47, 0.84, 1.0)
PLATE = (0.03, 0.05, 0.08, 0.65)  # ground of what is written, RGBA in 0..1
PANEL_GROUND = (0.09, 0.13, 0.18)  # of the panel next to the scene


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


def bright(colour: FloatArray) -> Colour:
    """Mix a group's colour with white until it can be read on a dark ground."""
    luminance = float(colour @ [0.21, 0.72, 0.07])
    white = max(0.0, (0.66 - luminance) / (1 - luminance)) if luminance < 1 else 0.0
    red, green, blue = (float(part) for part in colour + white * (1 - colour))
    return red, green, blue
