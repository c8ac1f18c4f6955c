"""Where a run goes as it is made: a sink takes chunks, each an xarray Dataset of consecutive samples.

A sink needs one file with one class. Chunks may be as short as one sample; their variables and coordinates are those
of the lists in `variables`, and the same in all chunks of a run but for the length of `time`.
"""

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
    """Keeps a run in memory."""

    def __init__(self) -> None:
        """Begin without a run."""
        self._chunks: list[xr.Dataset] = []

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Need nothing: chunks say what they are."""

    def write(self, chunk: xr.Dataset) -> None:
        """Keep a chunk."""
        self._chunks.append(chunk)

    def close(self) -> None:
        """Keep what has come."""

    @property
    def dataset(self) -> xr.Dataset:
        """The whole run."""
        return join(self._chunks)


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
