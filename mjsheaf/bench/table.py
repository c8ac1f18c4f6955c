"""All measurements, one after the other, and what they say: the table of `mjsheaf bench`."""

import os
import platform
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

from mjsheaf.bench.rows import Row, at_least, at_most, informs
from mjsheaf.errors import InputError

TOPICS = ("startup", "ideal", "loop", "threads", "peers", "assembly", "sheaf", "video", "memory")
"""Each is a module here with `measure(short)`, a dictionary of figures, and `rows(figures)`, what they say."""

SHEAF_LEAD = 2.0
"""Wanted: published time of an operation on a sheaf of 500 vertices, over ours."""

SHEAF_GROWTH = 1.1
"""Wanted: exponent with which time grows with the number of vertices of a grid."""

LARGE_GRID = 1_000_000
LARGE_WANTED = {
    "assembly_s": ("assembly, s", 3.0),
    "extension_s": ("harmonic extension, s", 10.0),
    "peak_memory_gb": ("peak memory, GB", 3.0),
}
"""Wanted of the grid of so many vertices: field of its record to what it is and its bound."""


def available() -> list[str]:
    """The topics that can be measured."""
    return [topic for topic in TOPICS if find_spec(f"mjsheaf.bench.{topic}")]


def run_bench(
    topics: Sequence[str] | None = None,
    *,
    short: bool = True,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[str, Any]:
    """Measure on this machine.

    Args:
        topics: some of `available()`; None takes all.
        short: the short version of each, about a minute in all.
        progress: called with (what is measured, topics done, topics in all).

    Returns:
        `machine`; `figures`: what each topic's `measure` returned; `rows`: what they say, one dictionary for each.

    Raises:
        InputError: an unknown topic.
    """
    known = available()
    for topic in topics or ():
        if topic not in known:
            raise InputError(f"unknown topic {topic!r}; legal are {', '.join(known)}")
    chosen = [topic for topic in known if not topics or topic in topics]
    figures: dict[str, Any] = {}
    table: list[Row] = []
    for done, topic in enumerate(chosen):
        if progress:
            progress("measuring", done, len(chosen))
        module = import_module(f"mjsheaf.bench.{topic}")
        figures[topic] = module.measure(short)
        table += getattr(module, "rows", _ROWS.get(topic, _no_rows))(figures[topic])
    if progress:
        progress("measuring", len(chosen), len(chosen))
    return {"machine": machine(), "short": short, "figures": figures, "rows": [row.as_dict() for row in table]}


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    return {
        "processors": os.cpu_count(),
        "architecture": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        "mjsheaf": version("mjsheaf"),
        "mujoco": version("mujoco"),
        "numba": version("numba"),
    }


def sheaf_rows(figures: dict[str, Any]) -> list[Row]:
    """The figures of the sheaf algebra against those that CellularSheaves.jl publishes."""
    table = [
        at_least(
            "sheaf",
            f"{row['graph']} of 500: {row['operation'].replace('_', ' ')}, ms",
            row["ms"],
            row["published_ms"],
            row["ratio"],
            SHEAF_LEAD,
            "CellularSheaves.jl, published",
        )
        for row in figures["small"]
        if row["published_ms"] is not None
    ]
    largest = figures["grids"][-1]
    growth, vertices = figures["growth_exponent"], largest["vertices"]
    what = f"grids to {vertices:.0e} vertices: growth exponent"
    if vertices < LARGE_GRID:
        return [*table, informs("sheaf", what, growth, note=f"to {LARGE_GRID:.0e} with --full")]
    table.append(at_most("sheaf", what, growth, None, growth, SHEAF_GROWTH))
    for name, (label, bound) in LARGE_WANTED.items():
        what = f"grid of {vertices:.0e} vertices: {label}"
        table.append(at_most("sheaf", what, largest[name], bound, largest[name] / bound, 1.0, "wanted"))
    return table


def _no_rows(figures: dict[str, Any]) -> list[Row]:
    return []


_ROWS: dict[str, Callable[[dict[str, Any]], list[Row]]] = {"sheaf": sheaf_rows}
