"""result.nc: written piece by piece during a run, safely even if the disk gets full, and read on access."""

import io
import os
import zlib
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.arrays import IntArray
from mjsheaf.results.dataset import join
from mjsheaf.results.sinks import Memory, Sink, send
from mjsheaf.threads import usable_processors


class EnduringFile(io.FileIO):
    """A file whose writes never fail from HDF5's point of view.

    If a write fails while HDF5 closes a file, HDF5 uses memory that it has freed, and the interpreter crashes. This
    file therefore accepts every write. Data that the disk refuses stay in memory, where HDF5 can read them back, and
    the error is stored. The caller checks for it after each piece (`raise_refusal`), before memory is full.

    Use it from a thread other than the main one, so that no signal raises an exception inside HDF5's callbacks.

    Attributes:
        refusal: First error of the disk; None while all writes have succeeded.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._size = 0
        self._refused: list[tuple[int, bytes]] = []
        self.refusal: OSError | None = None

    def raise_refusal(self) -> None:
        """Raise the stored error of the disk, if there is one.

        Raises:
            OSError: Data could not be written, or read back.
        """
        if self.refusal is not None:
            raise OSError(self.refusal.errno, self.refusal.strerror, str(self.name))

    def write(self, data: Any, /) -> int:
        """Write all of `data`, and keep in memory what the disk refuses."""
        rest, end = memoryview(data).cast("B"), self.tell() + memoryview(data).nbytes
        while rest and self.refusal is None:
            try:
                rest = rest[super().write(rest) :]
            except OSError as error:
                self.refusal = error
        if rest:
            self._refused.append((end - len(rest), bytes(rest)))
        self._size = max(self._size, end)
        self.seek(end)
        return memoryview(data).nbytes

    def readinto(self, buffer: Any, /) -> int:
        """Read back data from disk or memory, and return the number of bytes."""
        view, begin = memoryview(buffer).cast("B"), self.tell()
        end = min(begin + len(view), max(self._size, begin))
        view[: end - begin] = bytes(end - begin)  # not on the disk
        try:
            super().readinto(view[: end - begin])
        except OSError as error:
            self.refusal = self.refusal or error
        for place, kept in self._refused:
            first, last = max(begin, place), min(end, place + len(kept))
            if first < last:
                view[first - begin : last - begin] = kept[first - place : last - place]
        return self.seek(end) - begin

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        """Move to a position; the end includes data in memory."""
        if whence == os.SEEK_END:
            offset, whence = offset + self._size, os.SEEK_SET
        return super().seek(offset, whence)

    def truncate(self, size: int | None = None, /) -> int:
        """Change the length."""
        self._size = self.tell() if size is None else size
        try:
            super().truncate(self._size)
        except OSError as error:
            self.refusal = self.refusal or error
        return self._size

    def close(self) -> None:
        """Close the file; a network disk may report an error only now."""
        try:
            super().close()
        except OSError as error:
            self.refusal = self.refusal or error


_COUNTED = ("delivery",)  # variables without time that later pieces update
_MOST_SAMPLES = 4000  # maximum number of samples of a thinned run; more are invisible in a plot
_MOST_POSITIONS = 400_000  # maximum number of agents' positions in a thinned run, which bounds its memory
_FEWEST_SAMPLES = 200
_POSITIONS_READ = 2**18  # approximate number of positions read at a time, which is six megabytes per variable
_COMPRESSION = 3  # level of zlib
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
    with EnduringFile(path) as file:
        send(pieces, NetCDF(file), *others)
    file.raise_refusal()


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

    def __init__(self, file: io.BytesIO | EnduringFile) -> None:
        """Write into an open file, whose errors are checked after each chunk."""
        self._file = file
        self._beside = ThreadPoolExecutor(1)
        self._packing = ThreadPoolExecutor(usable_processors())
        self._netcdf = self._beside.submit(h5netcdf.File, file, "w")

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Do nothing, because the first chunk includes the variables without time."""

    def write(self, chunk: xr.Dataset) -> None:
        """Append a chunk to the file."""
        try:
            self._beside.submit(_append, self._netcdf.result(), chunk, self._packing).result()
        except RuntimeError as error:
            if "new thread" not in str(error):
                raise
            raise MemoryError("no thread can be started") from error
        if isinstance(self._file, EnduringFile):
            self._file.raise_refusal()

    def close(self) -> None:
        """Complete the file."""
        with self._beside, self._packing:
            self._beside.submit(self._netcdf.result().close).result()


def _append(netcdf: h5netcdf.File, piece: xr.Dataset, packing: ThreadPoolExecutor) -> None:
    """Append a piece to the file; the first one includes the variables without time."""
    if not netcdf.dimensions:
        _begin(netcdf, piece)
    if piece.sizes["time"]:
        _write_samples(netcdf, piece, packing)
    for name, value in piece.attrs.items():  # the last piece has the run's status and its communication
        if netcdf.attrs[name] != value and isinstance(value, int):
            netcdf._h5group.attrs.modify(name, value)  # in place, so that the bytes equal those of a run in one piece
        elif netcdf.attrs[name] != value:
            netcdf.attrs[name] = value


def _write_samples(netcdf: h5netcdf.File, piece: xr.Dataset, packing: ThreadPoolExecutor) -> None:
    """Append the variables with time to the file."""
    begin = len(netcdf.dimensions["time"])
    end = begin + piece.sizes["time"]
    netcdf.resize_dimension("time", end)
    # h5netcdf looks up the lengths of all dimensions at each access, which takes longer than the writing itself.
    stored = {name: netcdf._h5group[netcdf.variables[name]._h5path] for name in piece.variables}
    packed = {}
    for name, variable in piece.variables.items():
        if name in _COUNTED:
            stored[name][...] = variable.values
        elif _is_chunk_of(stored[name], variable, begin):
            packed[name] = packing.submit(_pack, variable.values, stored[name].chunks)
        elif "time" in variable.dims:
            stored[name][begin:end] = variable.values
    for name, chunk in packed.items():
        place = (begin, *(0 for _ in stored[name].shape[1:]))
        stored[name].id.write_direct_chunk(place, chunk.result())


def _is_chunk_of(stored: h5py.Dataset, variable: xr.Variable, begin: int) -> bool:
    """Return True if values from sample `begin` on start a chunk of a compressed dataset and fit into it."""
    chunks = stored.chunks
    if "time" not in variable.dims or stored.compression != "gzip" or stored.dtype != variable.dtype or chunks is None:
        return False
    return begin % chunks[0] == 0 and variable.shape[0] <= chunks[0] and variable.shape[1:] == chunks[1:]


def _pack(values: NDArray[Any], shape: tuple[int, ...]) -> bytes:
    """Return a chunk in HDF5's storage format: bytes sorted by significance, then compressed.

    HDF5 compresses one chunk at a time, but this function may run in several threads.
    """
    chunk = np.zeros(shape, values.dtype)
    chunk[: len(values)] = values
    planes = chunk.reshape(-1).view(np.uint8).reshape(-1, chunk.itemsize).T
    return zlib.compress(planes.tobytes(), _COMPRESSION)


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
    step = length_of_piece(dataset)
    chosen = np.split(kept, np.searchsorted(kept, np.arange(step, samples, step)))
    pieces = zip(split(dataset, step), chosen, strict=True)
    return join(piece.load().isel(time=here % step) for piece, here in pieces if len(here))
