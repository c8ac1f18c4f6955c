"""Small pictures with transparency, drawn once with Pillow and laid over frames with numpy."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from mjsheaf.jit import kernel
from mjsheaf.video.renderer import Frame

Colour = tuple[int, int, int]  # RGB in 0..255

WHITE: Colour = (255, 255, 255)
GREY: Colour = (190, 200, 212)
BLACK: Colour = (8, 12, 20)

FINE = 4  # how many times larger lines are drawn before they are reduced


@dataclass(frozen=True)
class Sprite:
    """A picture to be laid over a frame.

    Attributes:
        colour: red, green, blue, already multiplied by the opacity. Shape (h, w, 3), 0..255.
        clear: how much of what is under it remains, 0..256. Shape (h, w, 1).
    """

    colour: npt.NDArray[np.uint16]
    clear: npt.NDArray[np.uint16]

    @classmethod
    def of(cls, image: Image.Image) -> "Sprite":
        """Make a sprite of an RGBA image."""
        pixels = np.asarray(image, dtype=np.uint16)
        alpha = pixels[..., 3:]
        # Fractions of 256 rather than 255, so that laying it over a frame takes a shift and not a division.
        return cls(pixels[..., :3] * alpha // 255, 256 - (alpha + alpha // 128))

    @property
    def width(self) -> int:
        """In pixels."""
        return self.colour.shape[1]

    @property
    def height(self) -> int:
        """In pixels."""
        return self.colour.shape[0]

    def lay(self, frame: Frame, column: int, row: int, columns: int | None = None) -> None:
        """Draw it into a frame, top left corner at the given pixel; what falls outside is cut off.

        Args:
            frame: Shape (H, W, 3), changed.
            column: of the sprite's left edge in the frame.
            row: of its top edge.
            columns: draw only this many of the sprite's, from its left edge; None for all.
        """
        right = column + (self.width if columns is None else min(columns, self.width))
        left, top = max(column, 0), max(row, 0)
        right, bottom = min(right, frame.shape[1]), min(row + self.height, frame.shape[0])
        if left >= right or top >= bottom:
            return
        part = (slice(top - row, bottom - row), slice(left - column, right - column))
        _blend(frame[top:bottom, left:right], self.colour[part], self.clear[part])


@kernel
def _blend(under, colour, clear):
    """Lay colours over what is under them, in place."""
    for row in range(under.shape[0]):
        for column in range(under.shape[1]):
            remains = clear[row, column, 0]
            for k in range(3):
                under[row, column, k] = colour[row, column, k] + (under[row, column, k] * remains >> 8)


@cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib and so is on every machine; size in pixels."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


def panel(width: int, height: int, radius: int) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    """Make a dark, half-transparent plate with round corners to write on."""
    image = Image.new("RGBA", (max(width, 1), max(height, 1)), (*BLACK, 0))
    draw = ImageDraw.Draw(image)
    draw.rounded_rectangle((0, 0, width - 1, height - 1), radius, fill=(*BLACK, 165))
    return image, draw


def text(words: str, size: int, colour: Colour, bold: bool = False, outline: bool = False) -> Sprite:
    """Write words on nothing; with a dark outline they are legible over anything."""
    stroke = max(1, round(size / 8)) if outline else 0
    left, top, right, bottom = font(size, bold).getbbox(words, stroke_width=stroke)
    image = Image.new("RGBA", (int(right - left) + 1, int(bottom - top) + 1), (*BLACK, 0))
    ImageDraw.Draw(image).text(
        (-left, -top), words, (*colour, 255), font(size, bold), stroke_width=stroke, stroke_fill=(*BLACK, 220)
    )
    return Sprite.of(image)


def fine(width: int, height: int, draw: Callable[[ImageDraw.ImageDraw, int], None]) -> Image.Image:
    """Draw with smooth edges, which Pillow's lines do not have: several times larger, then reduced.

    Args:
        width: of the image returned, in pixels.
        height: of the image returned, in pixels.
        draw: draws on a canvas so many times larger as it is told.
    """
    image = Image.new("RGBA", (max(width, 1) * FINE, max(height, 1) * FINE))
    draw(ImageDraw.Draw(image), FINE)
    # Pillow weighs colours by their opacity here, so transparent black leaves no dark rim.
    return image.resize((max(width, 1), max(height, 1)), Image.Resampling.BOX)


def diamond(size: int, colour: Colour) -> Image.Image:
    """Draw the sign of a target: a hollow diamond with a dark rim, in a square of so many pixels."""

    def paint(draw: ImageDraw.ImageDraw, scale: int) -> None:
        middle, reach = size * scale / 2, 0.42 * size * scale
        corners = [(middle, middle - reach), (middle + reach, middle), (middle, middle + reach)]
        corners += [(middle - reach, middle), *corners[:2]]
        draw.line(corners, (*BLACK, 200), round(0.17 * size * scale), joint="curve")
        draw.line(corners, (*colour, 255), round(0.09 * size * scale), joint="curve")

    return fine(size, size, paint)


def shorten(words: str, size: int, width: float, bold: bool = False) -> str:
    """Cut words with an ellipsis where they are wider than `width` pixels."""
    if font(size, bold).getlength(words) <= width:
        return words
    while words and font(size, bold).getlength(words + "…") > width:
        words = words[:-1]
    return words.rstrip() + "…"
