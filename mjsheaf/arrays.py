"""Types of arrays: numbers in SI units, numbers of things, and yes or no."""

from collections.abc import Iterable
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

T = TypeVar("T")
OWN = "of each world"
Own = Annotated[T, OWN]
"""Field of a compiled struct that every world has for itself, of those that step together; they share the others.

There its arrays have a first axis more, which counts worlds: see `mjsheaf.loop.rows`.
"""


def freeze(values: Iterable[Any]) -> None:
    """Make those of the values that are arrays read-only, as they are shared."""
    for value in values:
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
