"""How long it takes to begin: the command line's help, and processes that find their kernels compiled, or do not."""

import os
import subprocess
import sys
import tempfile
from typing import Any

from mjsheaf.bench.clock import best_wall
from mjsheaf.bench.rows import Row, at_most, informs

WANTED_S = 0.3

_FIRST_RUN = """
import mjsheaf
from time import perf_counter
scenario = mjsheaf.load_scenario("midpoint", {{"time.end": 0.1}})
begun = perf_counter()
mjsheaf.simulate(scenario, backend={backend!r})
print(perf_counter() - begun)
"""


def measure(short: bool = False) -> dict[str, Any]:
    """Time whole processes by the wall, and first simulations in them.

    Args:
        short: fewer repetitions.

    Returns:
        In s: `python_s`, an interpreter that does nothing; `help_s` and `version_s` of the command line;
        `first_ideal_s` and `first_physics_s`: the first simulation of a process, whose kernels an earlier one compiled;
        `compiling_s`, by how much longer a process with the first on bodies takes where none has, unless `short`.
    """
    repetitions = 5 if short else 15
    return {
        "python_s": best_wall(lambda: _run("-c", "pass"), repetitions),
        "help_s": best_wall(lambda: _run("-m", "mjsheaf", "--help"), repetitions),
        "version_s": best_wall(lambda: _run("-m", "mjsheaf", "--version"), repetitions),
        "first_ideal_s": _first_run("ideal"),
        "first_physics_s": _first_run("physics"),
        **({} if short else {"compiling_s": _compiling()}),
    }


def _run(*arguments: str, **environment: str) -> str:
    return subprocess.run(
        [sys.executable, *arguments], check=True, capture_output=True, text=True, env={**os.environ, **environment}
    ).stdout


def _first_run(backend: str) -> float:
    code = _FIRST_RUN.format(backend=backend)
    _run("-c", code)  # compiles where no earlier process has
    return min(float(_run("-c", code)) for _ in range(2))


def _compiling() -> float:
    code = _FIRST_RUN.format(backend="physics")
    with tempfile.TemporaryDirectory() as folder:
        first, second = (best_wall(lambda: _run("-c", code, NUMBA_CACHE_DIR=folder), 1) for _ in range(2))
    return first - second


def rows(figures: dict[str, Any]) -> list[Row]:
    """The figures of `measure` against what is wanted."""
    table = []
    for option in ("help", "version"):
        seconds = figures[f"{option}_s"]
        table.append(
            at_most("startup", f"mjsheaf --{option}, s", seconds, WANTED_S, seconds / WANTED_S, 1.0, "wanted time")
        )
    for backend in ("ideal", "physics"):
        table.append(informs("startup", f"first simulate() on {backend}, s", figures[f"first_{backend}_s"]))
    if "compiling_s" in figures:
        table.append(informs("startup", "compiling, once on a machine, s", figures["compiling_s"]))
    return table
