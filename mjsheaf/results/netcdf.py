"""Outputs of a run, and the one to result.nc, which is written piece by piece during the run and read on access.

A sink receives chunks, each an xarray Dataset of consecutive samples, as short as one sample. Their variables and
coordinates are those listed in `dataset`. All chunks of a run have the same ones, and differ only in the length of
`time`.
"""

import io
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, Protocol

import h5netcdf
import numpy as np
import xarray as xr

from mjsheaf.arrays import IntArray
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


_COUNTED = ("delivery",)  # variables without time that later pieces update
_MOST_SAMPLES = 4000  # maximum number of samples of a thinned run; more are invisible in a plot
_MOST_POSITIONS = 400_000  # maximum number of agents' positions in a thinned run, which bounds its memory
_FEWEST_SAMPLES = 200
_POSITIONS_READ = 2**18  # approximate number of positions read at a time, which is six megabytes per variable
_COMPRESSION = 3  # level of zlib
_STRUCTURE = 2**20  # bytes reserved for the structure of the file
_CHUNK_STRUCTURE = 2**16  # bytes reserved for that of each chunk
MAX_BYTES_HELD = 2**29
"""Maximum size of a run that stays in memory while it is published, bytes."""


def write_dataset(pieces: Iterable[xr.Dataset], path: Path, *others: Sink) -> None:
    """Write a run as netCDF-4, compressed, one piece in memory at a time; equal runs give equal bytes.

    Args:
        pieces: Pieces from `make_datasets`, equal except for `time` and all of one length except for the last.
        path: Path of the file.
        others: Sinks that receive the run too.

    Raises:
        OSError: The file cannot be written, for example on a full disk. An incomplete file remains.
    """
    with path.open("w+b") as file:
        send(pieces, NetCDF(file), *others)


def write_and_open(pieces: Iterable[xr.Dataset], path: Path, *others: Sink) -> xr.Dataset:
    """Write a run as in `write_dataset`, and return it from memory if it is small, otherwise from the file."""
    memory = Memory(MAX_BYTES_HELD)
    write_dataset(pieces, path, memory, *others)
    return open_dataset(path) if memory.overflowed else memory.dataset


def dataset_bytes(dataset: xr.Dataset) -> bytes:
    """Return the bytes that `write_dataset` writes for a run in one piece."""
    file = io.BytesIO()
    send([dataset], NetCDF(file))
    return file.getvalue()


class NetCDF:
    """Sink that writes netCDF-4 in a separate thread, so that no signal interrupts HDF5."""

    def __init__(self, file: IO[bytes]) -> None:
        """Write into an open, empty file."""
        self._file = file
        self._reserved = 0
        self._reserve(_STRUCTURE)
        file.truncate(0)  # HDF5 begins in an empty file
        self._beside = ThreadPoolExecutor(1)
        self._netcdf = self._beside.submit(h5netcdf.File, file, "w")

    def _reserve(self, size: int) -> None:
        """Reserve room for more bytes, because HDF5 crashes the interpreter if a write fails.

        Raises:
            OSError: The disk has no room.
        """
        if isinstance(self._file, io.BytesIO):
            return
        begin = self._reserved
        self._reserved += size
        try:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(self._file.fileno(), 0, self._reserved)
            else:  # macOS: HDF5 has not come as far as the end of what was reserved
                os.pwrite(self._file.fileno(), bytes(size), begin)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._file.name)) from None

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Do nothing, because the first chunk includes the variables without time."""

    def write(self, chunk: xr.Dataset) -> None:
        """Append a chunk to the file."""
        netcdf = self._netcdf.result()
        self._reserve(chunk.nbytes + chunk.nbytes // 64 + _CHUNK_STRUCTURE)  # what does not compress grows a little
        self._beside.submit(_append, netcdf, chunk).result()

    def close(self) -> None:
        """Complete the file."""
        with self._beside:
            self._beside.submit(self._netcdf.result().close).result()


def _append(netcdf: h5netcdf.File, piece: xr.Dataset) -> None:
    """Append a piece to the file; the first one includes the variables without time."""
    if not netcdf.dimensions:
        _begin(netcdf, piece)
    if piece.sizes["time"]:
        _write_samples(netcdf, piece)
    for name, value in piece.attrs.items():  # the last piece has the run's status and its communication
        if netcdf.attrs[name] != value and isinstance(value, int):
            netcdf._h5group.attrs.modify(name, value)  # in place, so that the bytes equal those of a run in one piece
        elif netcdf.attrs[name] != value:
            netcdf.attrs[name] = value


def _write_samples(netcdf: h5netcdf.File, piece: xr.Dataset) -> None:
    """Append the variables with time to the file."""
    begin = len(netcdf.dimensions["time"])
    netcdf.resize_dimension("time", begin + piece.sizes["time"])
    for name, variable in piece.variables.items():
        # h5netcdf looks up the lengths of all dimensions at each access, which takes longer than the writing itself.
        stored = netcdf._h5group[netcdf.variables[name]._h5path]
        if name in _COUNTED:
            stored[...] = variable.values
        elif "time" in variable.dims:
            stored[begin:] = variable.values


def _begin(netcdf: h5netcdf.File, piece: xr.Dataset) -> None:
    """Create a file with the structure of its first piece, and write the variables without time."""
    packed = {"zlib": True, "complevel": _COMPRESSION, "shuffle": True}
    encoding: dict[str, Any] = {}
    for name, variable in piece.variables.items():
        if name in _COUNTED:
            continue  # stored contiguously, so that later pieces can overwrite it
        if variable.dtype.kind in "fi" and variable.ndim > 0:
            chunks = {"chunksizes": variable.shape} if "time" in variable.dims and variable.size else {}
            encoding[str(name)] = packed | chunks
    empty = piece.isel(time=slice(0, 0))
    empty.dump_to_store(xr.backends.H5NetCDFStore(netcdf), encoding=encoding, unlimited_dims=["time"])


def open_dataset(path: Path) -> xr.Dataset:
    """Open a run's dataset, whose values are read from the file on each access."""
    return xr.open_dataset(path, engine="h5netcdf", cache=False)


def pieces_of(dataset: xr.Dataset, names: Iterable[str]) -> Iterator[xr.Dataset]:
    """Yield selected variables of a dataset in memory, in pieces of consecutive samples."""
    return (piece.load() for piece in split(dataset[list(names)], length_of_piece(dataset)))


def split(dataset: xr.Dataset, samples: int) -> Iterator[xr.Dataset]:
    """Split a dataset into pieces of consecutive samples, for `write_dataset`."""
    for begin in range(0, dataset.sizes["time"], samples):
        yield dataset.isel(time=slice(begin, begin + samples))


def length_of_piece(dataset: xr.Dataset) -> int:
    """Return the number of samples to read at a time, a multiple of the file's chunk length.

    Each read takes about 10 ms whatever its size, because h5netcdf looks up the length of `time` in every variable.
    """
    variable = dataset["agent_position"]
    chunks = variable.encoding.get("chunksizes")
    together = int(chunks[0]) if chunks else max(1, min(2048, dataset.sizes["time"]))
    vehicles = dataset.sizes["agent"] + dataset.sizes.get("target", 0)
    return together * max(1, _POSITIONS_READ // (together * vehicles))


def thin(samples: int, most: int) -> IntArray:
    """Return the indices of at most `most` evenly spread samples, including the first and the last."""
    return np.unique(np.linspace(0, samples - 1, min(samples, most)).round().astype(np.int64))


def thinned(dataset: xr.Dataset) -> xr.Dataset:
    """Load at most a few thousand samples of a run, including the first and the last; fewer for a large team."""
    samples = dataset.sizes["time"]
    most = max(_FEWEST_SAMPLES, min(_MOST_SAMPLES, _MOST_POSITIONS // dataset.sizes["agent"]))
    kept = thin(samples, most)
    if len(kept) == samples:
        return dataset.load()
    return at_rows(dataset, kept)


def at_rows(dataset: xr.Dataset, rows: IntArray) -> xr.Dataset:
    """Load the samples at increasing rows; the data are read piece by piece."""
    step = length_of_piece(dataset)
    chosen = np.split(rows, np.searchsorted(rows, np.arange(step, dataset.sizes["time"], step)))
    pieces = zip(split(dataset, step), chosen, strict=True)
    return join(piece.load().isel(time=here % step) for piece, here in pieces if len(here))
