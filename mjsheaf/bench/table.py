"""All measurements, one after the other, and what they say: the table of `mjsheaf bench`."""

import os
import platform
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Any

from mjsheaf.bench.rows import Row
from mjsheaf.errors import InputError

TOPICS = ("startup", "ideal", "loop", "threads", "peers", "assembly", "sheaf", "video", "memory")
"""Each is a module here with `measure(short)`, a dictionary of figures, and `rows(figures)`, what they say."""


def run_bench(
    topics: Sequence[str] | None = None,
    *,
    short: bool = True,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[str, Any]:
    """Measure on this machine.

    Args:
        topics: some of TOPICS; None takes all.
        short: the short version of each, about a minute in all.
        progress: called with (what is measured, topics done, topics in all).

    Returns:
        `machine`; `figures`: what each topic's `measure` returned; `rows`: what they say, one dictionary for each.

    Raises:
        InputError: an unknown topic.
    """
    for topic in topics or ():
        if topic not in TOPICS:
            raise InputError(f"unknown topic {topic!r}; expected {', '.join(TOPICS)}")
    chosen = [topic for topic in TOPICS if not topics or topic in topics]
    figures: dict[str, Any] = {}
    table: list[Row] = []
    for done, topic in enumerate(chosen):
        if progress:
            progress("measuring", done, len(chosen))
        module = import_module(f"mjsheaf.bench.{topic}")
        figures[topic] = module.measure(short)
        table += module.rows(figures[topic])
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
