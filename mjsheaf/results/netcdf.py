"""result.nc: written piece by piece as a run goes on, also to a disk that gets full; read where it is looked at."""

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
from mjsheaf.results.sinks import Memory, send
from mjsheaf.threads import usable_processors


class EnduringFile(io.FileIO):
    """A file whose writes never fail as far as HDF5 can see.

    HDF5 does not survive a write that fails while it closes a file: it frees what it goes on to use, and the
    interpreter crashes. So this file accepts everything, keeps in memory what the disk refuses, where HDF5 may read it
    back, and remembers why. The caller asks for that after each piece (`raise_refusal`), before memory fills.

    Use it from a thread other than the main one: there no signal raises an exception inside HDF5's callbacks.

    Attributes:
        refusal: the first error of the disk; None while it holds all that was written.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._size = 0
        self._refused: list[tuple[int, bytes]] = []
        self.refusal: OSError | None = None

    def raise_refusal(self) -> None:
        """Raise what the disk said.

        Raises:
            OSError: something could not be written, or read back.
        """
        if self.refusal is not None:
            raise OSError(self.refusal.errno, self.refusal.strerror, str(self.name))

    def write(self, data: Any, /) -> int:
        """Write all of `data`, or keep what the disk refuses."""
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
        """Read back what was written, wherever it is; returns how many bytes there were."""
        view, begin = memoryview(buffer).cast("B"), self.tell()
        end = min(begin + len(view), max(self._size, begin))
        view[: end - begin] = bytes(end - begin)  # beyond what the disk took
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
        """Move to a place; the end is that of all that was written."""
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
        """Close it; a network's disk may refuse only now."""
        try:
            super().close()
        except OSError as error:
            self.refusal = self.refusal or error


_COUNTED = ("delivery",)  # variables without time that later pieces know better
_MOST_SAMPLES = 4000  # of a thinned run: more cannot be seen in a plot
_MOST_POSITIONS = 400_000  # of agents in a thinned run, which bounds its memory where there are many
_FEWEST_SAMPLES = 200
_POSITIONS_READ = 2**18  # of vehicles at a time, about: six megabytes a variable
_COMPRESSION = 3  # level of zlib
MAX_BYTES_HELD = 2**29
"""Size of a run up to which it stays in memory while it is published, bytes."""


def write_dataset(pieces: Iterable[xr.Dataset], path: Path, memory: Memory | None = None) -> None:
    """Write a run as netCDF-4, compressed, one piece in memory at a time; equal runs give equal bytes.

    Args:
        pieces: as `make_datasets` gives them: alike but for `time`, all of one length but for the last.
        path: the file.
        memory: gets the run too.

    Raises:
        OSError: it cannot be written, as on a full disk; what was written of it remains.
    """
    others = [] if memory is None else [memory]
    with EnduringFile(path) as file:
        send(pieces, NetCDF(file), *others)
    file.raise_refusal()


def write_and_open(pieces: Iterable[xr.Dataset], path: Path) -> xr.Dataset:
    """Write a run as `write_dataset` does and return it, from memory if it is small, otherwise from the file."""
    memory = Memory(MAX_BYTES_HELD)
    write_dataset(pieces, path, memory)
    return open_dataset(path) if memory.overflowed else memory.dataset


def dataset_bytes(dataset: xr.Dataset) -> bytes:
    """Return what `write_dataset` writes of a run in one piece."""
    file = io.BytesIO()
    send([dataset], NetCDF(file))
    return file.getvalue()


class NetCDF:
    """Sink that writes netCDF-4 in a thread beside, where no signal gets between HDF5 and the file."""

    def __init__(self, file: io.BytesIO | EnduringFile) -> None:
        """Write into an open file, of which the disk is asked after each chunk."""
        self._file = file
        self._beside = ThreadPoolExecutor(1)
        self._packing = ThreadPoolExecutor(usable_processors())
        self._netcdf = self._beside.submit(h5netcdf.File, file, "w")

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Need nothing: the first chunk brings all that has no time, too."""

    def write(self, chunk: xr.Dataset) -> None:
        """Write a chunk after those that the file holds already."""
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
    """Write a piece after those that the file holds already; the first one brings all that has no time, too."""
    if not netcdf.dimensions:
        _begin(netcdf, piece)
    if piece.sizes["time"]:
        _write_samples(netcdf, piece, packing)
    for name, value in piece.attrs.items():  # the last piece has the run's status, and what agents have sent
        if netcdf.attrs[name] != value and isinstance(value, int):
            netcdf._h5group.attrs.modify(name, value)  # in place, so that the bytes are those of one piece
        elif netcdf.attrs[name] != value:
            netcdf.attrs[name] = value


def _write_samples(netcdf: h5netcdf.File, piece: xr.Dataset, packing: ThreadPoolExecutor) -> None:
    """Write what changes over time, after the samples that the file holds already."""
    begin = len(netcdf.dimensions["time"])
    end = begin + piece.sizes["time"]
    netcdf.resize_dimension("time", end)
    # h5netcdf looks up the lengths of all dimensions at each access, which takes longer than writing.
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
    """Return True if values from sample `begin` on are at most one chunk of a compressed dataset and begin with it."""
    chunks = stored.chunks
    if "time" not in variable.dims or stored.compression != "gzip" or stored.dtype != variable.dtype or chunks is None:
        return False
    return begin % chunks[0] == 0 and variable.shape[0] <= chunks[0] and variable.shape[1:] == chunks[1:]


def _pack(values: NDArray[Any], shape: tuple[int, ...]) -> bytes:
    """Return a chunk as HDF5 stores it: bytes sorted by their significance, then compressed.

    HDF5 compresses one chunk at a time; this may run in several threads.
    """
    chunk = np.zeros(shape, values.dtype)
    chunk[: len(values)] = values
    planes = chunk.reshape(-1).view(np.uint8).reshape(-1, chunk.itemsize).T
    return zlib.compress(planes.tobytes(), _COMPRESSION)


def _begin(netcdf: h5netcdf.File, piece: xr.Dataset) -> None:
    """Begin a file like its first piece, with all that has no time."""
    packed = {"zlib": True, "complevel": _COMPRESSION, "shuffle": True}
    encoding: dict[str, Any] = {}
    for name, variable in piece.variables.items():
        if name in _COUNTED:
            continue  # in one place, to be written anew
        if variable.dtype.kind in "fi" and variable.ndim > 0:
            chunks = {"chunksizes": variable.shape} if "time" in variable.dims and variable.size else {}
            encoding[str(name)] = packed | chunks
    empty = piece.isel(time=slice(0, 0))
    empty.dump_to_store(xr.backends.H5NetCDFStore(netcdf), encoding=encoding, unlimited_dims=["time"])


def open_dataset(path: Path) -> xr.Dataset:
    """A run's dataset of which values are read from the file each time that they are asked for."""
    return xr.open_dataset(path, engine="h5netcdf", cache=False)


def pieces_of(dataset: xr.Dataset, names: Iterable[str]) -> Iterator[xr.Dataset]:
    """Some of a dataset's variables, in memory, in pieces of consecutive samples."""
    return (piece.load() for piece in split(dataset[list(names)], length_of_piece(dataset)))


def split(dataset: xr.Dataset, samples: int) -> Iterator[xr.Dataset]:
    """A dataset in pieces of consecutive samples, for `write_dataset`."""
    for begin in range(0, dataset.sizes["time"], samples):
        yield dataset.isel(time=slice(begin, begin + samples))


def length_of_piece(dataset: xr.Dataset) -> int:
    """Return how many samples are read at a time: a multiple of those that lie together in the file.

    Each read takes some 10 ms whatever its size, as h5netcdf looks up the length of `time` in every variable.
    """
    variable = dataset["agent_position"]
    chunks = variable.encoding.get("chunksizes")
    together = int(chunks[0]) if chunks else max(1, min(2048, dataset.sizes["time"]))
    vehicles = dataset.sizes["agent"] + dataset.sizes.get("target", 0)
    return together * max(1, _POSITIONS_READ // (together * vehicles))


def thin(samples: int, most: int) -> IntArray:
    """Indices of at most so many samples, evenly spread, the first and the last among them."""
    return np.unique(np.linspace(0, samples - 1, min(samples, most)).round().astype(np.int64))


def thinned(dataset: xr.Dataset) -> xr.Dataset:
    """At most a few thousand samples of a run, in memory, the first and the last among them; fewer of a large team."""
    samples = dataset.sizes["time"]
    most = max(_FEWEST_SAMPLES, min(_MOST_SAMPLES, _MOST_POSITIONS // dataset.sizes["agent"]))
    kept = thin(samples, most)
    if len(kept) == samples:
        return dataset.load()
    step = length_of_piece(dataset)
    chosen = np.split(kept, np.searchsorted(kept, np.arange(step, samples, step)))
    pieces = zip(split(dataset, step), chosen, strict=True)
    return join(piece.load().isel(time=here % step) for piece, here in pieces if len(here))
