"""What the colours and lines of the picture mean: a plate drawn once for a film."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from mjsheaf.video.decorate import COMMUNICATION, SENSING
from mjsheaf.video.film import Film, VideoOptions
from mjsheaf.video.series import FloatArray
from mjsheaf.video.sprite import GREY, WHITE, Colour, Sprite, diamond, fine, font, panel

MOST_GROUPS = 8  # more rows would hide the picture


@dataclass(frozen=True)
class Entry:
    """One row: words, and before them a glyph, which is drawn when its height in pixels is known; or none."""

    words: str
    glyph: Callable[[int], Image.Image] | None = None


def draw_legend(film: Film, options: VideoOptions) -> Sprite:
    """Draw the legend."""
    unit = options.unit
    entries = _entries(film, options)
    words = font(max(1, round(13 * unit)))
    pad, row = max(1, round(10 * unit)), max(1, round(20 * unit))
    left = pad + 2 * row
    width = left + round(max((words.getlength(entry.words) for entry in entries), default=0)) + pad
    image, draw = panel(width, len(entries) * row + 2 * pad, round(8 * unit))
    for number, entry in enumerate(entries):
        top = pad + number * row
        if entry.glyph is None:
            draw.text((pad, top + row // 2), entry.words, GREY, words, anchor="lm")
            continue
        glyph = entry.glyph(row)
        image.alpha_composite(glyph, (left // 2 - glyph.width // 2, top))
        draw.text((left, top + row // 2), entry.words, WHITE, words, anchor="lm")
    return Sprite.of(image)


def _entries(film: Film, options: VideoOptions) -> list[Entry]:
    """List the rows: groups of agents, targets, q*, edges, notes. Only what is in the picture has one."""
    of_agents = list(dict.fromkeys(film.group[: film.agents].tolist()))  # in order, each once
    of_targets = list(dict.fromkeys(film.group[film.agents :].tolist()))
    entries = [Entry(film.group_names[g], _dot(rgb(film.colours[g]))) for g in of_agents[:MOST_GROUPS]]
    if len(of_agents) > MOST_GROUPS:
        entries.append(Entry(f"and {len(of_agents) - MOST_GROUPS} more groups"))
    if of_targets:
        # Targets may have one colour of their own, or several.
        colour = bright(film.colours[of_targets[0]]) if len(of_targets) == 1 else WHITE
        entries.append(Entry("target, does not cooperate", lambda height: diamond(height, colour)))
    if film.agents:
        entries.append(Entry("q*: where an agent should be", _ball))
    kinds = {kind for _, _, kind in film.edges}
    if "communication" in kinds:
        entries.append(Entry("agents communicate", _line(rgb(COMMUNICATION[:3]), dashes=1)))
    if "sensing" in kinds:
        entries.append(Entry("agent senses target", _line(rgb(SENSING[:3]), dashes=3)))
    notes = []
    if options.speed != 1:
        notes.append(f"{options.speed:g}x speed")
    if options.vehicle_scale != 1:
        notes.append(f"vehicles drawn {options.vehicle_scale:g}x larger")
    if notes:
        entries.append(Entry(", ".join(notes)))
    return entries


def rgb(colour: npt.NDArray[np.floating]) -> Colour:
    """Return a colour in 0..1 as RGB in 0..255."""
    red, green, blue = (round(255 * float(part)) for part in colour)
    return red, green, blue


def bright(colour: FloatArray) -> Colour:
    """Mix a group's colour with white until it can be read on a dark ground. RGB in 0..255."""
    luminance = float(colour @ [0.21, 0.72, 0.07])
    white = max(0.0, (0.66 - luminance) / (1 - luminance)) if luminance < 1 else 0.0
    return rgb(colour + white * (1 - colour))


def _ball(height: int) -> Image.Image:
    """Draw the sign of q*."""

    def paint(draw: ImageDraw.ImageDraw, scale: int) -> None:
        near, far = 0.14 * height * scale, 0.86 * height * scale
        draw.ellipse((near, near, far, far), (*GREY, 110), (*GREY, 230), max(1, height * scale // 14))

    return fine(height, height, paint)


def _dot(colour: Colour) -> Callable[[int], Image.Image]:
    """Return what draws the sign of a group."""

    def glyph(height: int) -> Image.Image:
        near, far = 0.2 * height, 0.8 * height
        return fine(
            height,
            height,
            lambda draw, scale: draw.ellipse((near * scale, near * scale, far * scale, far * scale), colour),
        )

    return glyph


def _line(colour: Colour, dashes: int) -> Callable[[int], Image.Image]:
    """Return what draws the sign of a kind of edge: so many dashes; one is a solid line."""

    def glyph(height: int) -> Image.Image:
        def paint(draw: ImageDraw.ImageDraw, scale: int) -> None:
            step = 1.3 * height * scale / (2 * dashes - 1)
            middle, thickness = height * scale / 2, height * scale // 9
            for dash in range(dashes):
                draw.line((2 * dash * step, middle, (2 * dash + 1) * step, middle), colour, thickness)

        return fine(round(1.3 * height), height, paint)

    return glyph
