"""result.nc: written piece by piece as a run goes on, and read where it is looked at."""

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import xarray as xr

from mjsheaf.results.dataset import join

_MOST_SAMPLES = 4000  # of a thinned run: more cannot be seen in a plot
_MOST_POSITIONS = 400_000  # of agents in a thinned run, which bounds its memory where there are many
_FEWEST_SAMPLES = 200


def write_dataset(pieces: Iterable[xr.Dataset], path: Path) -> None:
    """Write a run as netCDF-4, compressed, one piece in memory at a time; equal runs give equal bytes.

    Args:
        pieces: as `make_datasets` gives them: alike but for `time`, all of one length but for the last.
        path: the file.
    """
    iterator = iter(pieces)
    first = next(iterator)
    samples = first.sizes["time"]
    encoding: dict[str, Any] = {}
    for name, variable in first.variables.items():
        if variable.dtype.kind == "f" and variable.ndim > 0:
            encoding[str(name)] = {"zlib": True, "complevel": 3, "shuffle": True}
            if "time" in variable.dims and variable.size:
                encoding[str(name)]["chunksizes"] = variable.shape
    first.to_netcdf(path, engine="h5netcdf", encoding=encoding, unlimited_dims=["time"])
    second = next(iterator, None)
    if second is None:
        return
    growing = [str(name) for name, variable in first.variables.items() if "time" in variable.dims]
    del first
    with h5netcdf.File(path, "a") as file:
        for piece in chain([second], iterator):
            new = samples + piece.sizes["time"]
            file.resize_dimension("time", new)
            for name in growing:
                file.variables[name][samples:new] = piece[name].values
            samples = new
            for name in ("status", "message"):
                if file.attrs[name] != piece.attrs[name]:
                    file.attrs[name] = piece.attrs[name]


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
