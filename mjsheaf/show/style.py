"""Style of everything that is drawn: colours, scales of vehicles and of speeds, settings of figure files.

Video, page, exports and figures share the colours of groups, edges' kinds, obstacles and speeds. Nothing here needs
matplotlib, which takes long to import.

A drone of half a metre is a speck next to a boat of six. Each kind of vehicle is enlarged until it fills a stated
fraction of the size of the run. It stays smaller than the usual gap between neighbours, so that vehicles do not cover
each other.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import InputError
from mjsheaf.files import FIGURE_FORMATS
from mjsheaf.team import Team

# -- files of figures --------------------------------------------------------------------------------------------------

VIEW = (-60.0, 35.0)
"""Azimuth and elevation of the eye in degrees, unless a scenario has its own (`video.eye`)."""

MATPLOTLIB = RLock()
"""Lock for drawing with matplotlib, whose settings and formula parser are global."""


@dataclass(frozen=True)
class FigureOptions:
    """Settings of figure files.

    Attributes:
        formats: Formats of their files, one file for each; from FIGURE_FORMATS.
        title: True for figures with a title; papers have captions instead.
    """

    formats: tuple[str, ...] = ("png",)
    title: bool = True

    def __post_init__(self) -> None:
        """Check the formats.

        Raises:
            InputError: There are none, or one is unknown or given twice.
        """
        unknown = [form for form in self.formats if form not in FIGURE_FORMATS]
        if unknown or not self.formats or len(set(self.formats)) < len(self.formats):
            what = f"{unknown[0]!r} is none of them" if unknown else f"not {','.join(self.formats) or 'none'!r}"
            raise InputError(f"format: expected one or more of {', '.join(FIGURE_FORMATS)}, each once; {what}")

    def paths(self, path: Path) -> list[Path]:
        """Return the files of a figure: `path` with the suffix of each format."""
        return [path.with_suffix(f".{form}") for form in self.formats]


AS_USUAL = FigureOptions()


# -- colours -----------------------------------------------------------------------------------------------------------

# Okabe and Ito's palette without its vermilion, which is too like the targets' red for some, then mostly Tol's muted
# scheme for further groups. Their sky blue is for agents without a group.
_COLOURS = (
    *("#E69F00", "#0072B2", "#009E73", "#CC79A7", "#882255", "#332288"),
    *("#D55E00", "#999933", "#44AA99", "#AA4499", "#117733", "#661100"),
)
_UNGROUPED, TARGET = "#56B4E9", "#D62728"
BLUE, RED = "#0072B2", "#D62728"
LOST = "#9A9A9A"
"""Of agents that are lost or have yet to join."""
OBSTACLE = (0.78, 0.55, 0.38)
"""RGB of obstacles."""
MARKERS = "os^Dv<>Phdp8"
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (9, 2)))
STOPS: Array = np.array(
    [
        [[1.00, 0.97, 0.85, 0.30], [1.00, 0.80, 0.25, 0.60], [0.93, 0.32, 0.02, 0.85]],
        [[0.07, 0.15, 0.42, 0.40], [0.38, 0.14, 0.62, 0.70], [1.00, 0.25, 0.85, 0.85]],
    ]
)
"""RGBA in 0..1 of the first and the second medium at rest, at half of the scale, and at its end, shape (2, 3, 4)."""


def palette(count: int) -> Array:
    """RGB of `count` groups, then of ungrouped agents and of targets, shape (count + 2, 3)."""
    chosen = [_COLOURS[k % len(_COLOURS)] for k in range(count)]
    codes = [*chosen, _UNGROUPED if count else BLUE, TARGET]
    return np.array([[int(code[k : k + 2], 16) / 255.0 for k in (1, 3, 5)] for code in codes])


def groups_of(team: Team) -> tuple[IntArray, list[str], Array]:
    """Index of each vehicle's group, shape (V,); the groups' names; their colours, RGB, shape (G, 3)."""
    names = [f.name for f in team.formations]
    index = {member: k for k, f in enumerate(team.formations) for member in f.members}
    agents = [index.get(a.id, len(names)) for a in team.agents]
    others = "agents without a group" if names else "agents"
    index_of_each = np.array(agents + [len(names) + 1] * len(team.targets))
    return index_of_each, [*names, others, "targets"], palette(len(names))


def marker_of(group: int, names: Sequence[str]) -> str:
    """The marker of a group of `groups_of`."""
    return "*" if group == len(names) - 1 else MARKERS[group % len(MARKERS)]


def line_style(k: int) -> dict[str, Any]:
    """Return colour, dashes and markers of the k-th of some lines, which stay distinct in grey."""
    return {
        "color": _COLOURS[k % len(_COLOURS)],
        "linestyle": DASHES[k % len(DASHES)],
        "linewidth": 1.1,
        "marker": MARKERS[k % len(MARKERS)],
        "markersize": 4.0,
        "markevery": (0.015 * (k % 10), 0.15),
    }


def speed_colours(medium: int, fraction: Array) -> Array:
    """Compute the colours of speeds.

    Args:
        medium: Number of the medium, 0 or 1.
        fraction: Speeds as fractions of the scale's end, shape (n,).

    Returns:
        RGBA in 0..1, shape (n, 4).
    """
    stops = STOPS[medium % len(STOPS)]
    at = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(fraction, at, stops[:, channel]) for channel in range(4)], axis=-1)


# -- scales of vehicles ------------------------------------------------------------------------------------------------

MIN_FRACTION = 1 / 18
"""Smallest size of a vehicle as it is drawn, as a fraction of the size of the run."""
MAX_GAP_FRACTION = 0.8
"""Largest size of an enlarged vehicle as it is drawn, as a fraction of the gap between neighbours."""
_STEPS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)


def automatic_scales(kinds: Sequence[str], radii: Array, positions: Array) -> Array:
    """Choose a scale for each kind of vehicle, one that is easily said.

    Args:
        kinds: Kind of each of V vehicles.
        radii: Radius of each vehicle about its origin, shape (V,), m.
        positions: Positions of all vehicles at K times, shape (K, V, 3), m; NaN where a vehicle is absent.

    Returns:
        Scale of each vehicle, at least 1, shape (V,).
    """
    gaps = [np.inf]  # from each vehicle to its nearest neighbour, m
    for places in positions:
        known = places[np.isfinite(places).all(axis=1)]
        if len(known) > 1:
            gaps.append(float(np.median(cKDTree(known).query(known, k=2)[0][:, 1])))
    room = MAX_GAP_FRACTION * float(np.median(gaps[1:] or gaps))
    wanted = MIN_FRACTION * run_size(positions)
    found = np.ones(len(kinds))
    for kind in dict.fromkeys(kinds):
        own = np.array([each == kind for each in kinds])
        length = 2.0 * float(radii[own].max())
        scale = round_number(min(wanted, room) / length, up=wanted <= room)
        found[own] = max(scale, 1.0)
    return found


def run_size(positions: Array) -> float:
    """Compute the diameter in m of what holds nine tenths of all positions of a run.

    Args:
        positions: Shape (K, V, 3), m; vehicles without a finite position do not count.
    """
    known = positions[np.isfinite(positions).all(axis=2)]
    if not len(known):
        return 0.0
    away = np.linalg.norm(known - np.median(known, axis=0), axis=1)
    return 2.0 * float(np.quantile(away, 0.9))


def round_number(value: float, *, up: bool, steps: Sequence[float] = _STEPS) -> float:
    """Round up or down to one of some steps times a power of ten; 1 for what is not positive or not finite."""
    if not (np.isfinite(value) and value > 0.0):
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    near = [step * power for step in (*steps, 10.0)]
    higher = [number for number in near if number >= value * (1.0 - 1e-9)]
    lower = [number for number in near if number <= value * (1.0 + 1e-9)]
    return float(f"{min(higher) if up else max(lower, default=power):.6g}")


def list_scales(kinds: Sequence[str], ids: Sequence[str], scales: Array) -> list[tuple[float, list[str]]]:
    """Group vehicles that are not drawn in their true size by scale, the largest first.

    Vehicles are named by kind, by id where a kind has several scales, and by "every vehicle" where all have one.
    """
    if len(set(scales.tolist())) == 1:
        kinds = ["every vehicle"] * len(kinds)
    groups: dict[float, list[str]] = defaultdict(list)
    for kind in dict.fromkeys(kinds):
        own = [v for v, each in enumerate(kinds) if each == kind]
        alike = len(set(scales[own].tolist())) == 1
        for v in own[:1] if alike else own:
            groups[float(scales[v])].append(kind if alike else ids[v])
    return [(scale, groups[scale]) for scale in sorted(groups, reverse=True) if scale != 1.0]
