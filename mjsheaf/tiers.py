"""Functions that run in Python while they have little to do, and compiled from then on.

Compiling a function takes seconds, and a team of a few vehicles asks some of them for a millisecond's work. Both ways
compute the same operations in the same order, so that results have the same bits whichever is taken; tests hold the
functions that use this to it. A function whose machine code is on disk is never run in Python.
"""

from collections.abc import Callable
from pathlib import Path
from time import thread_time
from types import FunctionType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from mjsheaf.jit import INTERPRETED

_MAX_SECONDS = 0.3  # processor time that a function may take in Python, in a process
_MAX_NUMBERS = 10_000  # in the arrays of a call that Python carries out


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
        self._left = 0.0 if INTERPRETED else seconds
        self._numbers = numbers
        self._records = records

    def __call__(self, *arguments: Any) -> Any:
        """Call the function, in Python or compiled."""
        if self._python is None:
            self._python = in_python(self.compiled)
            if _is_on_disk(self.compiled):
                self._left = 0.0
        if self._left <= 0.0 or (self._numbers < np.inf and _numbers_in(arguments) > self._numbers):
            return self.compiled(*arguments)
        begun = thread_time()
        with np.errstate(all="ignore"):  # as compiled code
            result = self._python(*(_as_records(arguments) if self._records else arguments))
        self._left -= thread_time() - begun
        return result


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
            names[name] = made[id(value)] if id(value) in made else _in_python(value, made)
        else:
            names[name] = value
    return twin


def _is_on_disk(compiled: Any) -> bool:
    path = Path(compiled.stats.cache_path or "")
    return any(path.glob(f"{Path(compiled.py_func.__code__.co_filename).stem}.{compiled.py_func.__qualname__}-*.nbi"))


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
