"""Functions that run in Python at first, and are compiled once that pays off.

Compiling a function takes seconds, and a check of a few vehicles may need it for only milliseconds. Python and compiled
code carry out the same operations in the same order, so results are the same to the bit; tests verify this for the
functions that use this module. A function is compiled for given types of arguments in two cases: if Python has taken
long for them in one process, or if it has taken about as long as compiling in several processes together, which add up
their times in a file. Machine code on disk is used at once.
"""

import contextlib
import math
import os
from collections.abc import Callable
from pathlib import Path
from time import thread_time
from types import FunctionType, SimpleNamespace
from typing import Any
from zlib import crc32

import numpy as np

from mjsheaf.arrays import mapped
from mjsheaf.compile.jit import INTERPRETED, Dispatcher, Held, kinds_of
from mjsheaf.compile.machine_code import source_hash

_PROCESSES = 4  # Python may take this multiple of the limit of a process in all processes together
_NOTICEABLE = 0.1  # s: a process writes down its time in steps of this size


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


def _of_scalars(of_library: Callable[..., float], of_numpy: Any) -> Callable[..., Any]:
    def call(*arguments: float) -> Any:
        try:
            return of_library(*arguments)
        except (ValueError, OverflowError):  # nan and infinity
            return of_numpy(*arguments)

    return call


_NUMPY = SimpleNamespace(
    **vars(np) | {name: _of_scalars(function, getattr(np, name)) for name, function in _FUNCTIONS.items()}
)
"""numpy with the functions of the C library, for scalars."""


class Tiered:
    """A compiled function, carried out by Python while that is quicker than compiling it.

    Args:
        compiled: Function as `mjsheaf.compile.jit.jit` makes it. It is called by Python alone.
        seconds: Processor time that it may take in Python, s.
        numbers: Numbers in the arrays of a call that Python may carry out.
        records: True if the arguments hold arrays of records.

    Attributes:
        compiled: The compiled function.
    """

    def __init__(self, compiled: Any, seconds: float = 0.3, numbers: float = 10_000, records: bool = False) -> None:
        self.compiled = compiled
        self._python: Callable[..., Any] | None = None
        self._left: dict[Any, float] = {}  # of the time of Python, s, by types of arguments; -inf of those compiled
        self._seconds = seconds
        self._numbers = numbers
        self._records = records

    def __call__(self, *arguments: Any) -> Any:
        """Call the function, in Python or compiled."""
        if INTERPRETED:
            return self.compiled(*arguments)
        kinds = tuple(one._numba_type_ if isinstance(one, Held) else kinds_of(one) for one in arguments)
        if kinds not in self._left:
            spent = _total_time(_file_of_times(self.compiled, kinds))
            self._left[kinds] = self._seconds if spent <= _PROCESSES * self._seconds else 0.0
        if self._left[kinds] == -math.inf:
            return self.compiled(*arguments)
        values = tuple(one.value if isinstance(one, Held) else one for one in arguments)
        if self._left[kinds] <= 0.0 or (self._numbers < np.inf and _numbers_in(values) > self._numbers):
            self._left[kinds] = -math.inf  # in later processes too
            _add_time(_file_of_times(self.compiled, kinds), math.inf)
            return self.compiled(*arguments)
        self._python = self._python or in_python(self.compiled)
        begun = thread_time()
        with np.errstate(all="ignore"):  # as compiled code
            result = self._python(*(_as_records(values) if self._records else values))
        self._take(kinds, thread_time() - begun)
        return result

    def _take(self, kinds: Any, seconds: float) -> None:
        """Subtract a time in s from the time that Python may still take."""
        before = self._left[kinds] // _NOTICEABLE
        self._left[kinds] -= seconds
        steps = before - self._left[kinds] // _NOTICEABLE
        if steps:
            _add_time(_file_of_times(self.compiled, kinds), steps * _NOTICEABLE)


def tiered(**limits: Any) -> Callable[[Any], Tiered]:
    """Return a decorator that makes a Tiered function with other limits."""
    return lambda compiled: Tiered(compiled, **limits)


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


def _file_of_times(compiled: Any, kinds: Any) -> Path:
    """Return a file next to the machine code of a function, with the times that Python took for it, s.

    There is one for each combination of types. Where no machine code can be kept, times cannot either: the file is the
    one that stays empty.
    """
    function = compiled.py_func
    source = Path(function.__code__.co_filename).resolve()
    kind = crc32(repr(kinds).encode())
    name = f"{source.stem}.{function.__qualname__}.{source_hash(source)}.{kind:08x}.used"
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


def _numbers_in(tree: Any) -> int:
    """Count the numbers in the arrays of nested tuples."""
    if isinstance(tree, tuple):
        return sum(map(_numbers_in, tree))
    return int(np.size(tree)) if isinstance(tree, np.ndarray) else 0


def _as_records(tree: Any) -> Any:
    """Return nested tuples with records whose fields are attributes, as compiled code reads them."""

    def with_attributes(leaf: Any) -> Any:
        return leaf.view(np.recarray) if isinstance(leaf, np.ndarray) and leaf.dtype.names else leaf

    return mapped(with_attributes, tree)
