"""Functions that run in Python at first, and compiled once they have enough to do.

Compiling a function takes seconds, and a check of a few vehicles needs some of them for milliseconds only. Python and
compiled code carry out the same operations in the same order, so that results have the same bits whichever is taken;
tests hold the functions that use this to it. A function is compiled when Python has taken a while in one process, or
when it has taken about as long as compiling takes in several ones, which add up their times in a file. Machine code on
disk is used at once.
"""

import contextlib
import math
import os
from collections.abc import Callable
from pathlib import Path
from time import thread_time
from types import FunctionType
from typing import Any

import numpy as np

from mjsheaf.jit import INTERPRETED, Dispatcher

_MAX_SECONDS = 0.3  # processor time that a function may take in Python, in a process
_PROCESSES = 4  # Python may take so many times the limit of a process in all of them together
_NOTICEABLE = 0.1  # s: a process writes down its time in steps of this size
_MAX_NUMBERS = 10_000  # in the arrays of a call that Python carries out


_FUNCTIONS: dict[str, Callable[..., float]] = {
    "exp": math.exp,
    "log": math.log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "arcsin": math.asin,
    "arccos": math.acos,
    "arctan": math.atan,
    "arctan2": math.atan2,
}
"""Functions of numpy and those of the C library, which compiled code calls; numpy itself differs by rounding."""


class _Numpy:
    """numpy with the functions of the C library, for scalars."""

    def __getattr__(self, name: str) -> Any:
        of_numpy = getattr(np, name)
        of_library = _FUNCTIONS.get(name)
        if of_library is None:
            return of_numpy

        def call(*arguments: float) -> Any:
            try:
                return of_library(*arguments)
            except (ValueError, OverflowError):  # nan and infinity
                return of_numpy(*arguments)

        setattr(self, name, call)
        return call


class Tiered:
    """A compiled function, carried out by Python while that is quicker than compiling it.

    Args:
        compiled: Function as `mjsheaf.jit.jit` makes it. It is called by Python alone.
        seconds: Processor time that it may take in Python, s.
        numbers: Numbers in the arrays of a call that Python may carry out.
        records: True if the arguments hold arrays of records.

    Attributes:
        compiled: The compiled function.
    """

    def __init__(
        self, compiled: Any, seconds: float = _MAX_SECONDS, numbers: float = _MAX_NUMBERS, records: bool = False
    ) -> None:
        self.compiled = compiled
        self._python: Callable[..., Any] | None = None
        self._left = seconds
        self._seconds = seconds
        self._unwritten = 0.0
        self._numbers = numbers
        self._records = records

    def __call__(self, *arguments: Any) -> Any:
        """Call the function, in Python or compiled."""
        if INTERPRETED:
            return self.compiled(*arguments)
        if self._python is None:
            self._python = in_python(self.compiled)
            self._times = _file_of_times(self.compiled)
            if _total_time(self._times) > _PROCESSES * self._seconds or _is_on_disk(self.compiled):
                self._left = 0.0
        if self._left <= 0.0 or (self._numbers < np.inf and _numbers_in(arguments) > self._numbers):
            return self.compiled(*arguments)
        begun = thread_time()
        with np.errstate(all="ignore"):  # as compiled code
            result = self._python(*(_as_records(arguments) if self._records else arguments))
        taken = thread_time() - begun
        self._left -= taken
        self._unwritten += taken
        if self._unwritten > _NOTICEABLE:
            _add_time(self._times, self._unwritten)
            self._unwritten = 0.0
        return result


def tiered(**limits: Any) -> Callable[[Any], Tiered]:
    """Return a decorator that makes a Tiered function with other limits."""
    return lambda compiled: Tiered(compiled, **limits)


_NUMPY = _Numpy()


def in_python(compiled: Any) -> Callable[..., Any]:
    """Return a compiled function as a function of Python that calls no compiled one."""
    return _in_python(compiled, {})


def _in_python(compiled: Any, made: dict[int, Callable[..., Any]]) -> Callable[..., Any]:
    function = compiled.py_func
    names: dict[str, Any] = {}
    twin = FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)
    made[id(compiled)] = twin
    for name, value in function.__globals__.items():
        if name in function.__code__.co_names and isinstance(value, Dispatcher):
            names[name] = made.get(id(value)) or _in_python(value, made)
        else:
            names[name] = _NUMPY if value is np else value
    return twin


def _file_of_times(compiled: Any) -> Path:
    """Return a file next to the machine code of a function, with the times that Python took for it, s.

    Where no machine code can be kept, times cannot either: the file is the one that stays empty.
    """
    function = compiled.py_func
    name = f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}.used"
    return Path(compiled.stats.cache_path, name) if compiled.stats.cache_path else Path(os.devnull)


def _total_time(file: Path) -> float:
    """Return the sum of the times in a file, s; 0 if there is none, and infinity if it is not readable."""
    try:
        return sum(map(float, file.read_text(encoding="ascii").split()))
    except FileNotFoundError:
        return 0.0
    except (OSError, ValueError):
        return math.inf


def _add_time(file: Path, seconds: float) -> None:
    """Append a time to a file, in one write, as other processes append to it too."""
    with contextlib.suppress(OSError), open(file, "a", encoding="ascii") as times:
        times.write(f"{seconds:.3f}\n")


def _is_on_disk(compiled: Any) -> bool:
    """Return True if numba has saved the function for calls from Python, not only for those of compiled callers."""
    times = _file_of_times(compiled)
    return any(".linked." not in index.name for index in times.parent.glob(f"{times.stem}-*.nbi"))


def _numbers_in(tree: Any) -> int:
    """Count the numbers in the arrays of nested tuples."""
    if isinstance(tree, tuple):
        return sum(map(_numbers_in, tree))
    return int(np.size(tree)) if isinstance(tree, np.ndarray) else 0


def _as_records(tree: Any) -> Any:
    """Return nested tuples with records whose fields are attributes, as compiled code reads them."""
    if isinstance(tree, tuple):
        values = map(_as_records, tree)
        return type(tree)._make(values) if hasattr(tree, "_make") else tuple(values)
    if isinstance(tree, np.ndarray) and tree.dtype.names:
        return tree.view(np.recarray)
    return tree
