"""Values of every sample of a run, in memory or read block by block when they are looked at."""

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

KEPT = 6  # blocks in memory: what a frame and its trails need
STEP = 4096  # samples of an array in memory that are looked at together


class Blocks:
    """One of a film's arrays, of which blocks of consecutive samples are loaded when needed.

    Attributes:
        shape: (T, ...).
        length: samples in each block but the last.
    """

    def __init__(self, shape: tuple[int, ...], length: int, load: Callable[[int], FloatArray]) -> None:
        """Say where the values come from.

        Args:
            shape: (T, ...).
            length: samples in each block but the last.
            load: returns the block of a number, shape (samples, ...); it should remember the last few.
        """
        self.shape, self.length, self._load = shape, length, load

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: slice) -> FloatArray:
        """Samples one after the other, shape (n, ...)."""
        return self.rows(np.arange(*key.indices(len(self))))

    def rows(self, samples: IntArray) -> FloatArray:
        """Samples of these numbers, shape (n, ...)."""
        found = np.empty((len(samples), *self.shape[1:]))
        block = samples // self.length
        for number in np.unique(block):
            here = block == number
            found[here] = self._load(int(number))[samples[here] - number * self.length]
        return found

    def map(self, change: Callable[[int, FloatArray], FloatArray]) -> "Blocks":
        """The same with every block changed: `change` is given the number of its first sample, and it."""
        load = lru_cache(KEPT)(lambda number: change(number * self.length, self._load(number)))
        return Blocks(self.shape, self.length, load)


Series = Any  # FloatArray | Blocks; whoever made a film knows which


def rows(values: Series, samples: IntArray) -> FloatArray:
    """Samples of these numbers, shape (n, ...)."""
    return values.rows(samples) if isinstance(values, Blocks) else values[samples]


def blocks(values: Series) -> Iterator[tuple[int, FloatArray]]:
    """All samples in turn: the number of a block's first sample, and the block, shape (n, ...)."""
    step = values.length if isinstance(values, Blocks) else STEP
    for start in range(0, len(values), step):
        yield start, values[start : start + step]


def changed(values: Series, change: Callable[[int, FloatArray], FloatArray]) -> Series:
    """The series with every block of it changed, at once or when it is loaded; see `Blocks.map`."""
    return values.map(change) if isinstance(values, Blocks) else change(0, values)
