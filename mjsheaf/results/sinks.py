"""Outputs of a run: a sink receives chunks, each an xarray Dataset of consecutive samples.

A sink is one class in one file. Chunks may be as short as one sample. Their variables and coordinates are those listed
in `variables`. All chunks of a run have the same ones, and differ only in the length of `time`.
"""

import math
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from typing import Any, Protocol

import xarray as xr

from mjsheaf.results.dataset import join


class Sink(Protocol):
    """Interface for receiving a run."""

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Start; called once before the first chunk, with its variables and coordinates by name and its attributes."""

    def write(self, chunk: xr.Dataset) -> None:
        """Receive the next samples; the attributes of the last chunk are those of the whole run."""

    def close(self) -> None:
        """Finish; also called if a run ends with an exception, or before it has started."""


class Memory:
    """Sink that keeps a run in memory.

    Attributes:
        overflowed: True if the run exceeds the limit; none of it is kept then.
    """

    def __init__(self, limit: float = math.inf) -> None:
        """Start empty; a run larger than `limit` bytes is not kept."""
        self.overflowed = False
        self._left = limit
        self._chunks: list[xr.Dataset] = []

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Do nothing, because chunks contain everything."""

    def write(self, chunk: xr.Dataset) -> None:
        """Keep a chunk."""
        self._left -= chunk.nbytes
        self._chunks.append(chunk)
        if self._left < 0.0:
            self.overflowed = True
            self._chunks.clear()

    def close(self) -> None:
        """Keep the chunks that were received."""

    @property
    def dataset(self) -> xr.Dataset:
        """Return the whole run; it stores the length of its chunks, like a file."""
        first = self._chunks[0]
        whole = join(self._chunks)
        for name, variable in first.variables.items():
            if "time" in variable.dims:
                whole[name].encoding["chunksizes"] = variable.shape
        return whole


def send(chunks: Iterable[xr.Dataset], *sinks: Sink) -> None:
    """Pass the chunks of a run in order to all sinks."""
    with ExitStack() as stack:
        for sink in sinks:
            stack.callback(sink.close)
        for number, chunk in enumerate(chunks):
            for sink in sinks:
                if number == 0:
                    sink.open(chunk.variables, chunk.attrs)
                sink.write(chunk)
