"""result.nc: written piece by piece as a run goes on, and read where it is looked at."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from io import BytesIO, RawIOBase
from pathlib import Path
from typing import IO, Any

import h5netcdf
import numpy as np
import xarray as xr

from mjsheaf.results.dataset import join
from mjsheaf.results.enduring import EnduringFile

_MOST_SAMPLES = 4000  # of a thinned run: more cannot be seen in a plot
_MOST_POSITIONS = 400_000  # of agents in a thinned run, which bounds its memory where there are many
_FEWEST_SAMPLES = 200


def write_dataset(pieces: Iterable[xr.Dataset], path: Path) -> None:
    """Write a run as netCDF-4, compressed, one piece in memory at a time; equal runs give equal bytes.

    Args:
        pieces: as `make_datasets` gives them: alike but for `time`, all of one length but for the last.
        path: the file.

    Raises:
        OSError: it cannot be written, as on a full disk; what was written of it remains.
    """
    with EnduringFile(path) as file:
        _write(pieces, file, file.raise_refusal)
    file.raise_refusal()


def dataset_bytes(dataset: xr.Dataset) -> bytes:
    """What `write_dataset` writes of a run in one piece."""
    file = BytesIO()
    _write([dataset], file, lambda: None)
    return file.getvalue()


def _write(pieces: Iterable[xr.Dataset], file: IO[bytes] | RawIOBase, check: Callable[[], None]) -> None:
    """Write pieces in a thread beside, where no signal gets between HDF5 and the file; check after each of them."""
    growing = _GrowingFile(file)
    with ThreadPoolExecutor(1) as beside:
        try:
            for piece in pieces:
                beside.submit(growing.append, piece).result()
                check()
        finally:
            beside.submit(growing.close).result()


class _GrowingFile:
    """A netCDF-4 file to which pieces of a run are appended."""

    def __init__(self, file: IO[bytes] | RawIOBase) -> None:
        self._file = file
        self._netcdf: h5netcdf.File | None = None
        self._samples = 0
        self._growing: list[str] = []

    def append(self, piece: xr.Dataset) -> None:
        if self._netcdf is None:
            self._begin(piece)
        elif piece.sizes["time"]:
            samples = self._samples + piece.sizes["time"]
            self._netcdf.resize_dimension("time", samples)
            for name in self._growing:
                self._netcdf.variables[name][self._samples : samples] = piece[name].values
            self._samples = samples
        assert self._netcdf is not None
        for name in ("status", "message"):
            if self._netcdf.attrs[name] != piece.attrs[name]:
                self._netcdf.attrs[name] = piece.attrs[name]

    def _begin(self, first: xr.Dataset) -> None:
        encoding: dict[str, Any] = {}
        for name, variable in first.variables.items():
            if variable.dtype.kind == "f" and variable.ndim > 0:
                encoding[str(name)] = {"zlib": True, "complevel": 3, "shuffle": True}
                if "time" in variable.dims and variable.size:
                    encoding[str(name)]["chunksizes"] = variable.shape
        self._netcdf = h5netcdf.File(self._file, "w")
        first.dump_to_store(xr.backends.H5NetCDFStore(self._netcdf), encoding=encoding, unlimited_dims=["time"])
        self._growing = [str(name) for name, variable in first.variables.items() if "time" in variable.dims]
        self._samples = first.sizes["time"]

    def close(self) -> None:
        if self._netcdf is not None:
            self._netcdf.close()


def open_dataset(path: Path) -> xr.Dataset:
    """A run's dataset of which values are read from the file each time that they are asked for."""
    return xr.open_dataset(path, engine="h5netcdf", cache=False)


def pieces_of(dataset: xr.Dataset, names: Iterable[str]) -> Iterator[xr.Dataset]:
    """Some of a dataset's variables, in memory, in pieces of consecutive samples."""
    chosen = dataset[list(names)]
    step = length_of_piece(dataset)
    for begin in range(0, dataset.sizes["time"], step):
        yield chosen.isel(time=slice(begin, begin + step)).load()


def length_of_piece(dataset: xr.Dataset) -> int:
    """How many samples are read at a time: those that lie together in the file, or all that are in memory already."""
    variable = dataset["agent_position"]
    chunks = variable.encoding.get("chunksizes")
    return int(chunks[0]) if chunks else max(1, min(2048, dataset.sizes["time"]))


def thinned(dataset: xr.Dataset) -> xr.Dataset:
    """At most a few thousand samples of a run, in memory, the first and the last among them; fewer of a large team."""
    samples = dataset.sizes["time"]
    most = max(_FEWEST_SAMPLES, min(_MOST_SAMPLES, _MOST_POSITIONS // dataset.sizes["agent"]))
    kept = np.unique(np.linspace(0, samples - 1, min(samples, most)).round().astype(np.int64))
    if len(kept) == samples:
        return dataset.load()
    step = length_of_piece(dataset)
    parts = []
    for begin in range(0, samples, step):
        here = kept[(kept >= begin) & (kept < begin + step)]
        if len(here):
            parts.append(dataset.isel(time=slice(begin, begin + step)).load().isel(time=here - begin))
    return join(parts)
