"""Tuples of parts of unlike kinds, in compiled loops: the types alone tell which functions to call.

A loop compiles for the parts that are there, so that what a run has not costs nothing.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

from mjsheaf.compile.jit import inline_jit, overload

FunctionOf = Callable[[type], Any]
"""Called with the type of a part; returns the compiled function for it, or None if there is nothing to do."""


def for_each(function_of: FunctionOf, add: Any = None) -> Any:
    """Return a function that calls the function of each part, one after the other.

    Args:
        function_of: Functions of the parts, which are called with (part, its state, *arguments).
        add: Compiled function that adds what they return to a total; None if they return nothing.

    Returns:
        A function of (parts, states, total, *arguments), which returns the total.
    """

    @cache
    def written(kinds: tuple[type, ...]) -> Any:
        def calls(parts, states, total, *arguments):
            return total

        for k, kind in enumerate(kinds):
            function = function_of(kind)
            if function is not None:
                calls = _then(inline_jit(calls), k, function, add)
        return calls

    def call(parts, states, total, *arguments):
        return written(tuple(map(type, parts)))(parts, states, total, *arguments)

    @overload(call)
    def _compiled(parts, states, total, *arguments):
        return written(_kinds(parts))

    return call


def _then(before: Any, k: int, function: Any, add: Any) -> Any:
    """Return a function that calls `before`, and then the function of part k."""
    if add is None:

        def calls(parts, states, total, *arguments):
            before(parts, states, total, *arguments)
            function(parts[k], states[k], *arguments)
            return total

    else:

        def calls(parts, states, total, *arguments):
            total = before(parts, states, total, *arguments)
            return add(total, function(parts[k], states[k], *arguments))

    return calls


def has_any(function_of: FunctionOf) -> Any:
    """Return a function of parts that returns True if one of them has a function, a constant in compiled code."""

    def call(parts):
        return any(function_of(type(part)) is not None for part in parts)

    @overload(call)
    def _compiled(parts):
        found = any(function_of(kind) is not None for kind in _kinds(parts))
        return lambda parts: found

    return call


def _kinds(parts: Any) -> tuple[type, ...]:
    """Return the types of parts from numba's type of their tuple."""
    return tuple(kind.instance_class for kind in parts)
