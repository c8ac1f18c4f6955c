"""The last results of a function, for calls that ask the same again: what a study's runs have in common."""

import pickle
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def remember_last(key: Callable[P, Any], *, most: int = 1) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Let a function return one of its last results again where `key` of its arguments is the same.

    The key is compared as pickled bytes, so that a result that is returned again is the one that would be computed: two
    runs of a study that differ in their seed alone have the same targets, vehicles and graph to the bit. The result
    is shared, and must not be written to.

    Args:
        key: Function of the arguments that returns everything on which the result depends.
        most: Number of results that are kept.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        last: list[tuple[bytes, T]] = []

        @wraps(function)
        def remembering(*args: P.args, **kwargs: P.kwargs) -> T:
            asked = pickle.dumps(key(*args, **kwargs))
            for known, result in tuple(last):
                if known == asked:
                    return result
            result = function(*args, **kwargs)
            last[:] = [(asked, result), *last[: most - 1]]
            return result

        return remembering

    return decorate
