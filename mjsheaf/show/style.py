"""Settings of figure files: formats and title. Without matplotlib, which takes long to import."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from threading import RLock

from mjsheaf.errors import InputError

FORMATS = ("png", "svg", "pdf")

VIEW = (-60.0, 35.0)
"""Azimuth and elevation of the eye in degrees, unless a scenario has its own (`video.eye`)."""

MATPLOTLIB = RLock()
"""Lock for drawing with matplotlib, whose settings and formula parser are global."""


@dataclass(frozen=True)
class FigureOptions:
    """Settings of figure files.

    Attributes:
        formats: Formats of their files, one file for each; from FORMATS.
        title: True for figures with a title; papers have captions instead.
    """

    formats: tuple[str, ...] = ("png",)
    title: bool = True

    def __post_init__(self) -> None:
        """Check the formats.

        Raises:
            InputError: There are none, or one is unknown or given twice.
        """
        unknown = [form for form in self.formats if form not in FORMATS]
        if unknown or not self.formats or len(set(self.formats)) < len(self.formats):
            what = f"{unknown[0]!r} is none of them" if unknown else f"not {','.join(self.formats) or 'none'!r}"
            raise InputError(f"format: expected one or more of {', '.join(FORMATS)}, each once; {what}")

    def paths(self, path: Path) -> list[Path]:
        """Return the files of a figure: `path` with the suffix of each format."""
        return [path.with_suffix(f".{form}") for form in self.formats]


AS_USUAL = FigureOptions()


def names_of(figures: Iterable[str]) -> list[str]:
    """List all possible file names of figures, which are given without suffix."""
    return [f"{figure}.{form}" for figure in figures for form in FORMATS]
