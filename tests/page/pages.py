"""Pages of short runs, and what they hold, read as a browser reads it but by other code."""

import base64
import json
import re
import zlib
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf import simulate
from mjsheaf.checking.theorem.of_run import bounds_of_phases
from mjsheaf.page.page import page_of
from mjsheaf.scenario import Scenario, load_scenario
from tests.builders import known

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Made:
    """A page, and the run that it is of."""

    page: bytes
    scenario: Scenario
    dataset: xr.Dataset

    def write(self, path: Path) -> Path:
        """Write the page."""
        path.write_bytes(self.page)
        return path


def make_page(name: Any, backend: str, overrides: dict[str, Any] | None = None, **options: Any) -> Made:
    """The page of a scenario that ships, or of fields; options are those of `page_of`."""
    scenario = load_scenario(name, overrides or {})
    dataset = simulate(scenario, backend)
    phases = scenario.phases
    bounds = bounds_of_phases(phases, dataset)
    return Made(page_of(scenario, phases, dataset, {}, bounds, **options), scenario, dataset)


class Elements(HTMLParser):
    """Elements of a page with their attributes, those still open, and the text of each script and style."""

    def __init__(self, page: bytes) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.texts: list[str] = []
        self.feed(page.decode())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "link", "input", "br"):  # which never end
            self.open.append(tag)
        if tag in ("script", "style"):
            self.texts.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("script", "style"):
            self.texts[-1] += data


def said_in(page: bytes) -> dict[str, Any]:
    """Return the data of a page."""
    return json.loads(_element(page, "said"))


def series_in(page: bytes) -> dict[str, Array]:
    """The arrays of a page by name, shape (K, columns)."""
    data = zlib.decompress(base64.b64decode(_element(page, "data")))
    found = {}
    for name, entry in said_in(page)["arrays"].items():
        rows, columns = entry["shape"]
        count = rows * columns
        planes = np.frombuffer(data, np.uint8, 4 * count, entry["at"]).reshape(4, count).astype(np.uint32)
        z = planes[0] | planes[1] << 8 | planes[2] << 16 | planes[3] << 24
        change = (z >> 1) ^ (np.uint32(0) - (z & 1))
        whole = np.cumsum(change.reshape(columns, rows), axis=1, dtype=np.uint32).view(np.int32).T
        if entry["step"]:
            found[name] = np.where(whole == -(2**31), np.nan, whole * entry["step"])
        else:
            found[name] = np.ascontiguousarray(whole).view(np.float32).astype(np.float64)
    return found


def _element(page: bytes, name: str) -> str:
    return known(re.search(rf'id="{name}">(.*?)</script>', page.decode(), re.DOTALL))[1]


def positions_of(dataset: xr.Dataset, surface: float = 0.0) -> Array:
    """Return the positions of all vehicles in result.nc, shape (T, V, 3), m."""
    parts = []
    for kind in ("agent", "target"):
        place = dataset[f"{kind}_position"].values.copy()
        level = dataset[f"{kind}_height"].values if f"{kind}_height" in dataset else surface
        place[..., 2] = np.where(np.isnan(place[..., 2]), level, place[..., 2])
        parts.append(place)
    return np.concatenate(parts, axis=1)
