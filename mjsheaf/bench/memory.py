"""Peak memory of a run against one ten times as long: results stream to disk, so that it should not grow."""

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from mjsheaf.bench.rows import Row, at_most
from mjsheaf.errors import MjsheafError

WANTED = 1.15
"""Wanted: peak memory of the longer run, over that of the shorter."""


# Linux counts the memory of whoever starts a process as that process's own: this small one starts it.
_STARTER = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
process.returncode = os.waitstatus_to_exitcode(status)
print(process.returncode, usage.ru_maxrss)
"""


def measure(short: bool = False, ends: tuple[float, float] | None = None) -> dict[str, Any]:
    """Peak resident memory of `mjsheaf run midpoint`, 50 samples a second, in a process of its own.

    Args:
        short: runs of 200 and 2,000 s on ideal kinematics alone instead of 1,000 and 10,000 s on both backends.
        ends: other ends of the two runs, s.

    Returns:
        `runs`: for each backend `ends` in s, `peak_mb` of each and their `ratio`.
    """
    ends = ends or ((200.0, 2000.0) if short else (1000.0, 10000.0))
    peak_of("ideal", 1.0)  # compiles what is not in the cache
    runs = []
    for backend in ("ideal",) if short else ("ideal", "physics"):
        if backend != "ideal":
            peak_of(backend, 1.0)
        peaks = [peak_of(backend, end) for end in ends]
        runs.append({"backend": backend, "ends": list(ends), "peak_mb": peaks, "ratio": peaks[1] / peaks[0]})
    return {"runs": runs}


def peak_of(backend: str, end: float, *options: str) -> float:
    """Peak resident memory of one run of `midpoint` without video, in MB.

    Args:
        backend: 'ideal' or 'physics'.
        end: of the run, s.
        options: more of the command's.

    Raises:
        MjsheafError: the run failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        where = ["--backend", backend, "--out", str(Path(folder) / "run")]
        command = ["run", "midpoint", *where, "--set", f"time.end={end:g}", *(options or ["--no-video"])]
        started = [sys.executable, "-c", _STARTER, sys.executable, "-m", "mjsheaf", *command]
        code, peak = map(int, subprocess.run(started, capture_output=True, text=True, check=True).stdout.split())
    if code:
        raise MjsheafError(f"mjsheaf {' '.join(command)} exits with {code}")
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, kilobytes elsewhere
    return peak * unit / 1e6


def rows(figures: dict[str, Any]) -> list[Row]:
    """The figures of `measure` against what is wanted."""
    return [
        at_most(
            "memory", f"peak of {run['ends'][1]:g} s on {run['backend']}, MB", run["peak_mb"][1], run["peak_mb"][0],
            run["ratio"], WANTED, f"the same of {run['ends'][0]:g} s",
        )
        for run in figures["runs"]
    ]  # fmt: skip
