"""Compile a function for given types in one process at a time: the others wait, and load the code that it has saved.

Workers of a study, or two commands in two terminals, would otherwise compile the same functions side by side. For other
types they do: each has code of its own. A lock is a byte of a file in the cache's directory, which the operating system
releases when its process ends.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

from numba.core.compiler_lock import global_compiler_lock

try:
    import fcntl
except ImportError:  # Windows: every process compiles
    fcntl = None  # type: ignore[assignment]

_LOCKS = "mjsheaf.locks"  # file in a directory of the cache
_waits: list[str] = []  # functions and types that this process waits for


def is_waiting() -> bool:
    """Return True while this process waits for code that another one compiles."""
    return bool(_waits)


def keep_code(dispatcher: Any, cache: Any, kind: str = "") -> None:
    """Keep a function's machine code on disk, and let other processes wait while one compiles it for the same types."""
    dispatcher._cache = cache
    if fcntl is None:
        return
    compile_here, function = dispatcher.compile, dispatcher.py_func
    name = f"{function.__module__}.{function.__qualname__}{kind and f', {kind}'}"

    def compile_or_load(signature: Any) -> Any:
        # numba's own lock comes first: a thread that holds it must not wait for a thread that needs it.
        with global_compiler_lock, _locked(cache.cache_path, f"{name} {signature}"):
            return compile_here(signature)

    dispatcher.compile = compile_or_load
    # Code for all types is in one index, which numba reads, and writes again with one file more.
    cache.save_overload = _locked(cache.cache_path, name)(cache.save_overload)


@contextmanager
def _locked(directory: str, name: str) -> Iterator[None]:
    """Hold the lock of a name; where there are no locks, as on some network drives, hold none."""
    place = crc32(name.encode())
    try:
        file = _open_locks(directory)
        _wait_for(file, place, name)
    except OSError:
        yield
        return
    try:
        yield
    finally:
        fcntl.lockf(file, fcntl.LOCK_UN, 1, place)


def _wait_for(file: int, place: int, name: str) -> None:
    """Take the lock at a place of a file; a function that is compiled within itself has it already."""
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
    except BlockingIOError:
        _waits.append(name)
        try:
            fcntl.lockf(file, fcntl.LOCK_EX, 1, place)
        finally:
            _waits.remove(name)


@cache
def _open_locks(directory: str) -> int:
    """Open the file of locks, for as long as the process lives: closing it would release all of them."""
    Path(directory).mkdir(parents=True, exist_ok=True)
    return os.open(Path(directory) / _LOCKS, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
