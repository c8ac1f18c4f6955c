"""`mjsheaf bench`: how fast mjsheaf is on this machine, each figure beside what it is held against."""

import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib import import_module
from importlib.metadata import version
from typing import Any

from mjsheaf.bench.rows import Row
from mjsheaf.errors import InputError

TOPICS = {
    "startup": "processes",
    "ideal": "simulations",
    "loop": "simulations",
    "threads": "simulations",
    "peers": "simulations",
    "assembly": "simulations",
    "sheaf": "sheaf",
    "video": "processes",
    "memory": "processes",
}
"""Each is a function `topic(short) -> list[Row]` in the module here that is named."""


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
        `machine`; `short`; `figures`: for each topic what was measured, to the figure; `rows`: the `Row`s.

    Raises:
        InputError: an unknown topic.
    """
    for topic in topics or ():
        if topic not in TOPICS:
            raise InputError(f"unknown topic {topic!r}; expected {', '.join(TOPICS)}")
    report = progress or (lambda what, done, total: None)
    chosen = [topic for topic in TOPICS if not topics or topic in topics]
    rows: list[Row] = []
    for done, topic in enumerate(chosen):
        report("measuring", done, len(chosen))
        rows += getattr(import_module(f"mjsheaf.bench.{TOPICS[topic]}"), topic)(short)
    report("measuring", len(chosen), len(chosen))
    figures = {topic: {row.what: row.ours for row in rows if row.topic == topic} for topic in chosen}
    return {"machine": machine(), "short": short, "figures": figures, "rows": [asdict(row) for row in rows]}


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    return {
        "processors": os.cpu_count(),
        "architecture": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("mjsheaf", "mujoco", "numba")},
    }
