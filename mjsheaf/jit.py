"""Compiled functions: one decorator, and a cache on disk that never serves old code.

numba caches machine code next to the source and notices when that source changes, but not when a compiled function
that it calls, in another file, does. So the cache of every directory is stamped with a hash of the layers whose
compiled functions call one another across files, and emptied when the stamp does not match.
"""

import contextlib
import hashlib
import logging
from collections.abc import Callable
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any

from numba import config, njit
from numba.core import event

_logger = logging.getLogger("mjsheaf")
_PACKAGE = Path(__file__).resolve().parent
_SOURCES = ("system.py", "noise.py", "sheaf/*.py", "dynamics/*.py", "control/*.py", "vehicles/*.py", "simulation/*.py")


class _Compilations(event.Listener):
    """Adds up the time that compiling takes, and logs it once in a process: seconds that later runs do not take."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._begun: list[float] = []  # one within the other
        self._announced = False

    def on_start(self, event: Any) -> None:
        self._begun.append(perf_counter())
        if not self._announced and event.data["dispatcher"].py_func.__module__.startswith("mjsheaf."):
            self._announced = True
            _logger.info("compiling loops for this machine: some 50 seconds, once")

    def on_end(self, _: Any) -> None:
        begun = self._begun.pop()
        if not self._begun:
            self.seconds += perf_counter() - begun


_compilations = _Compilations()
event.register("numba:compile", _compilations)


def working_time() -> float:
    """A clock in s, of which differences count, that stands still while compiling."""
    return perf_counter() - _compilations.seconds


def jit(function: Callable[..., Any]) -> Any:
    """Compile a function: cached on disk, without the interpreter's lock, division as in C.

    It makes no arrays, and counts no references to those it is handed. numba counts one, by an atomic instruction, at
    every slice, row and field that is taken: that took a third of the time of closing the loop about a physics step.
    Its option for that is not a public one; a numba without it refuses to compile, and does not go wrong silently.
    """
    return _compile(function, _nrt=False)


def allocating_jit(function: Callable[..., Any]) -> Any:
    """Compile a function that makes arrays; otherwise as `jit`."""
    return _compile(function)


def inline_jit(function: Callable[..., Any]) -> Any:
    """Compile as `jit` does, and always inline, so that a call costs nothing."""
    return _compile(function, _nrt=False, forceinline=True)


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    if config.DISABLE_JIT:  # type: ignore[attr-defined]  # by the environment's NUMBA_DISABLE_JIT
        return function
    try:
        compiled = njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    except RuntimeError:  # no directory can be written: compile anew in each process
        return njit(nogil=True, error_model="numpy", **options)(function)
    _drop_stale_code(compiled.stats.cache_path)
    return compiled


@cache
def _source_hash() -> str:
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for path in sorted(p for pattern in _SOURCES for p in _PACKAGE.glob(pattern)):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _drop_stale_code(directory: str) -> None:
    stamp = Path(directory) / "mjsheaf.stamp"
    with contextlib.suppress(OSError):
        if stamp.exists() and stamp.read_text() == _source_hash():
            return
        for pattern in ("*.nbi", "*.nbc"):
            for path in Path(directory).glob(pattern):
                path.unlink(missing_ok=True)
        stamp.parent.mkdir(parents=True, exist_ok=True)
        stamp.write_text(_source_hash())
