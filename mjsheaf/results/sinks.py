"""Where a run goes as it is made: a sink takes chunks, each an xarray Dataset of consecutive samples.

A sink needs one file with one class. Chunks may be as short as one sample; their variables and coordinates are those
of the lists in `variables`, and the same in all chunks of a run but for the length of `time`.
"""

import math
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from typing import Any, Protocol

import xarray as xr

from mjsheaf.results.dataset import join


class Sink(Protocol):
    """Takes a run."""

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Begin: called once, before the first chunk, with its variables and coordinates by name and its attributes."""

    def write(self, chunk: xr.Dataset) -> None:
        """Take the samples that follow; the attributes of the last chunk are those of the whole run."""

    def close(self) -> None:
        """End, also where a run ends with an exception or before it has begun."""


class Memory:
    """Keeps a run in memory.

    Attributes:
        overflowed: True if the run is larger than allowed; nothing of it is kept then.
    """

    def __init__(self, limit: float = math.inf) -> None:
        """Begin without a run, of which at most `limit` bytes are kept."""
        self.overflowed = False
        self._left = limit
        self._chunks: list[xr.Dataset] = []

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Need nothing: chunks say what they are."""

    def write(self, chunk: xr.Dataset) -> None:
        """Keep a chunk."""
        self._left -= chunk.nbytes
        self._chunks.append(chunk)
        if self._left < 0.0:
            self.overflowed = True
            self._chunks.clear()

    def close(self) -> None:
        """Keep what has come."""

    @property
    def dataset(self) -> xr.Dataset:
        """The whole run; it remembers the length of its chunks, as a file does."""
        first = self._chunks[0]
        whole = join(self._chunks)
        for name, variable in first.variables.items():
            if "time" in variable.dims:
                whole[name].encoding["chunksizes"] = variable.shape
        return whole


def send(chunks: Iterable[xr.Dataset], *sinks: Sink) -> None:
    """Hand the chunks of a run to sinks, one chunk after the other, each to all of them."""
    with ExitStack() as stack:
        for sink in sinks:
            stack.callback(sink.close)
        for number, chunk in enumerate(chunks):
            for sink in sinks:
                if number == 0:
                    sink.open(chunk.variables, chunk.attrs)
                sink.write(chunk)
