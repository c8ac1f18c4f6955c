"""Texts of a figure as drawn: the oracle is matplotlib's renderer."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from mjsheaf.arrays import Array
from mjsheaf.show.plots import settle


class Written(NamedTuple):
    """A text and its box in pixels: left, bottom, right, top."""

    text: str
    box: Array


def written(figure: Figure) -> list[Written]:
    """Every text that a figure shows."""
    settle(figure)
    found: list[Written] = []
    draw = Text.draw

    def noted(self: Text, renderer: Any, *rest: Any) -> None:
        if self.get_visible() and self.get_text().strip():
            found.append(Written(self.get_text(), np.array(Text.get_window_extent(self, renderer).extents)))
        draw(self, renderer, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", noted)
        FigureCanvasAgg(figure).draw()
    return found


def overlaps(texts: list[Written], spare: float = 0.5) -> list[tuple[str, str]]:
    """Return the texts that overlap by more than a number of pixels each way."""
    boxes = np.array([text.box for text in texts]) + spare * np.array([1, 1, -1, -1])
    both = (boxes[:, None, :2] < boxes[None, :, 2:]).all(axis=2) & (boxes[:, None, 2:] > boxes[None, :, :2]).all(axis=2)
    return [(texts[i].text, texts[j].text) for i, j in np.argwhere(np.triu(both, 1)).tolist()]


def outside(figure: Figure, texts: list[Written], spare: float = 1.0) -> list[str]:
    """Texts that leave the figure."""
    width, height = figure.bbox.size
    room = np.array([-spare, -spare, width + spare, height + spare])
    return [t.text for t in texts if (t.box[:2] < room[:2]).any() or (t.box[2:] > room[2:]).any()]


def in_other_panels(figure: Figure) -> list[str]:
    """Labels and titles of panels that reach into another panel."""
    settle(figure)
    renderer: Any = FigureCanvasAgg(figure).get_renderer()
    found = []
    for panel in figure.axes:
        for text in (panel.xaxis.label, panel.yaxis.label, panel.title):
            box = text.get_window_extent(renderer)
            others = [other for other in figure.axes if other is not panel and other.get_visible()]
            if text.get_text() and any(box.overlaps(other.get_window_extent(renderer)) for other in others):
                found.append(text.get_text())
    return found


def is_legible(figure: Figure) -> bool:
    """No text over text, none outside, none in the panel of another, no nameless row; a failure says which."""
    texts = written(figure)
    faults = {"overlap": overlaps(texts), "outside": outside(figure, texts), "in other panels": in_other_panels(figure)}
    rows = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    faults["nameless"] = [row for row in rows if not row.strip()]
    assert not any(faults.values()), faults
    return True
