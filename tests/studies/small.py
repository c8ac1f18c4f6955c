"""Small studies, and ways to look at what they leave."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

from mjsheaf.studies import Plan, load_plan
from mjsheaf.studies.engine import Engine, local_engine

SHORT = {"time.end": 0.5}
IN_THREADS: Callable[[], AbstractContextManager[Engine]] = partial(local_engine, 1, processes=False)


def small_plan(gains: tuple[float, ...] = (1.0, 3.0), seeds: tuple[int, int] | None = (0, 2), **fields: Any) -> Plan:
    """Runs of half a second of one boat."""
    overrides = {**SHORT, **fields.pop("overrides", {})}
    return load_plan(
        "midpoint", grid={"controller.gain": gains}, seeds=seeds, overrides=overrides, backend="ideal", **fields
    )


def command(*arguments: str | Path) -> list[str]:
    """The command line, to be run in a process of its own."""
    return [sys.executable, "-m", "mjsheaf", "sweep", *map(str, arguments)]


def start(*arguments: str | Path, **options: Any) -> "subprocess.Popen[str]":
    """Begin a command whose output is read at its end, with SIGINT as a terminal's shell gives it."""
    return subprocess.Popen(
        command(*arguments),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ),
        preexec_fn=heed_interrupts,
        **options,
    )


def heed_interrupts() -> None:
    """In a process that begins: where the tests run in a shell's background, it inherits that SIGINT is ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def contents(directory: Path) -> dict[str, bytes]:
    """All that equal studies have alike: every file but the timings and the lock."""
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in sorted(directory.rglob("*"))
        if path.is_file() and path.name not in ("timings.csv", ".lock")
    }
