"""result.nc: written piece by piece as a run goes on, also to a disk that gets full; read where it is looked at."""

import io
import os
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import xarray as xr

from mjsheaf.arrays import IntArray
from mjsheaf.results.dataset import join
from mjsheaf.results.sinks import send


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


def write_dataset(pieces: Iterable[xr.Dataset], path: Path) -> None:
    """Write a run as netCDF-4, compressed, one piece in memory at a time; equal runs give equal bytes.

    Args:
        pieces: as `make_datasets` gives them: alike but for `time`, all of one length but for the last.
        path: the file.

    Raises:
        OSError: it cannot be written, as on a full disk; what was written of it remains.
    """
    with EnduringFile(path) as file:
        send(pieces, NetCDF(file))
    file.raise_refusal()


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
        self._netcdf = self._beside.submit(h5netcdf.File, file, "w")

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Need nothing: the first chunk brings all that has no time, too."""

    def write(self, chunk: xr.Dataset) -> None:
        """Write a chunk after those that the file holds already."""
        self._beside.submit(_append, self._netcdf.result(), chunk).result()
        if isinstance(self._file, EnduringFile):
            self._file.raise_refusal()

    def close(self) -> None:
        """Complete the file."""
        with self._beside:
            self._beside.submit(self._netcdf.result().close).result()


def _append(netcdf: h5netcdf.File, piece: xr.Dataset) -> None:
    """Write a piece after those that the file holds already; the first one brings all that has no time, too."""
    if not netcdf.dimensions:
        _begin(netcdf, piece)
    elif piece.sizes["time"]:
        begin = netcdf.dimensions["time"].size
        end = begin + piece.sizes["time"]
        netcdf.resize_dimension("time", end)
        for name, variable in piece.variables.items():
            if "time" in variable.dims:
                netcdf.variables[name][begin:end] = variable.values
            elif name in _COUNTED:
                netcdf.variables[name][:] = variable.values
    for name, value in piece.attrs.items():  # the last piece has the run's status, and what agents have sent
        if netcdf.attrs[name] != value and isinstance(value, int):
            netcdf._h5group.attrs.modify(name, value)  # in place, so that the bytes are those of one piece
        elif netcdf.attrs[name] != value:
            netcdf.attrs[name] = value


def _begin(netcdf: h5netcdf.File, piece: xr.Dataset) -> None:
    """Write the first piece, which brings all that has no time, too."""
    packed = {"zlib": True, "complevel": 3, "shuffle": True}
    encoding: dict[str, Any] = {}
    for name, variable in piece.variables.items():
        if name in _COUNTED:
            continue  # in one place, to be written anew
        if variable.dtype.kind in "fi" and variable.ndim > 0:
            chunks = {"chunksizes": variable.shape} if "time" in variable.dims and variable.size else {}
            encoding[str(name)] = packed | chunks
    piece.dump_to_store(xr.backends.H5NetCDFStore(netcdf), encoding=encoding, unlimited_dims=["time"])


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
