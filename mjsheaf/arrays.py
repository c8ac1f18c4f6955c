"""Types of arrays: numbers in SI units, numbers of things, and yes or no; and arrays that are parts of one array."""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

T = TypeVar("T")
Take = Callable[[Any], Array]
"""Called with a shape, as np.zeros; returns zeros."""


def freeze(values: Iterable[Any]) -> None:
    """Make those of the values that are arrays read-only, as they are shared."""
    for value in values:
        if isinstance(value, np.ndarray):
            value.flags.writeable = False


def firsts_of(counts: IntArray) -> IntArray:
    """Return the number of the first of each group, if groups of these sizes follow one another."""
    return np.cumsum(counts) - counts


class Room:
    """One array whose parts are handed out one after another.

    Attributes:
        values: The array, shape (n,); None while numbers are only counted.
        taken: How many numbers have been handed out.
    """

    def __init__(self, values: Array | None = None) -> None:
        self.values = values
        self.taken = 0

    def take(self, shape: Any) -> Array:
        """Return the next part as an array of a shape."""
        first = self.taken
        self.taken += int(np.prod(shape))
        return np.zeros(shape) if self.values is None else self.values[first : self.taken].reshape(shape)

    def since(self, first: int) -> Array:
        """Return all that has been handed out after the first numbers, in one piece."""
        return np.zeros(self.taken - first) if self.values is None else self.values[first : self.taken]


def lay_out(make: Callable[[Room], T]) -> tuple[Array, T]:
    """Make something whose arrays are parts of one new array, and return both."""
    count = Room()
    make(count)
    values = np.zeros(count.taken)
    return values, make(Room(values))


def mapped(function: Callable[[Any], Any], tree: Any) -> Any:
    """Return a tree of tuples with another value in the place of each leaf."""
    if not isinstance(tree, tuple):
        return function(tree)
    make = getattr(type(tree), "_make", tuple)
    return make(mapped(function, part) for part in tree)


def quaternions_of(heading: Array) -> Array:
    """Return level attitudes (w, x, y, z), body to world, for headings (V,) in rad, shape (V, 4)."""
    zero = np.zeros_like(heading)
    return np.column_stack([np.cos(heading / 2.0), zero, zero, np.sin(heading / 2.0)])
