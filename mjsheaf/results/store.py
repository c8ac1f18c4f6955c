"""Outputs of a run: result.nc and other sinks, and the directory in which everything is published.

result.nc is written piece by piece during the run and read on access. A sink receives chunks, each an xarray Dataset of
consecutive samples, as short as one sample. Their variables and coordinates are those listed in `dataset`. All chunks
of a run have the same ones, and differ only in the length of `time`.

The directory of a run or a comparison is published atomically by rename, never over files of other programs.
"""

import io
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import IO, Any

import h5netcdf
import numpy as np
import xarray as xr
from pydantic_core import to_json

from mjsheaf._version import __version__
from mjsheaf.arrays import IntArray
from mjsheaf.errors import InputError, PlaceError
from mjsheaf.files import (
    SUFFIXES,
    digest,
    figure_files,
    is_part_of,
    naming,
    remove_empty,
    whole_directory,
    write_whole,
)
from mjsheaf.results.dataset import fault_of, join
from mjsheaf.scenario import Scenario, load_scenario


class Sink:
    """Interface for receiving a run; a subclass need not do anything at its start and at its end."""

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Start; called once before the first chunk, with its variables and coordinates by name and its attributes."""

    def write(self, chunk: xr.Dataset) -> None:
        """Receive the next samples; the attributes of the last chunk are those of the whole run."""

    def close(self) -> None:
        """Finish; also called if a run ends with an exception, or before it has started."""


class Memory(Sink):
    """Sink that keeps a run in memory; chunks contain everything.

    Attributes:
        overflowed: True if the run exceeds the limit; none of it is kept then.
    """

    def __init__(self, limit: float = math.inf) -> None:
        """Start empty; a run larger than `limit` bytes is not kept."""
        self.overflowed = False
        self._left = limit
        self._chunks: list[xr.Dataset] = []

    def write(self, chunk: xr.Dataset) -> None:
        """Keep a chunk."""
        self._left -= chunk.nbytes
        self._chunks.append(chunk)
        if self._left < 0.0:
            self.overflowed = True
            self._chunks.clear()

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
_POSITIONS_READ = 2**18  # approximate number of positions read at a time, which is six megabytes per variable


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
    """Write a run as in `write_dataset`, and return it from memory if it has up to 512 MB, otherwise from the file."""
    memory = Memory(2**29)
    write_dataset(pieces, path, memory, *others)
    return open_dataset(path) if memory.overflowed else memory.dataset


def dataset_bytes(dataset: xr.Dataset) -> bytes:
    """Return the bytes that `write_dataset` writes for a run in one piece."""
    file = io.BytesIO()
    send([dataset], NetCDF(file))
    return file.getvalue()


class NetCDF(Sink):
    """Sink that writes netCDF-4 in a separate thread, so that no signal interrupts HDF5.

    The first chunk includes the variables without time.
    """

    def __init__(self, file: IO[bytes]) -> None:
        """Write into an open, empty file."""
        self._file = file
        self._reserved = 0
        self._reserve(2**20)  # for the structure of the file
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

    def write(self, chunk: xr.Dataset) -> None:
        """Append a chunk to the file."""
        netcdf = self._netcdf.result()
        # What does not compress grows a little; the last part is for the structure of the chunk.
        self._reserve(chunk.nbytes + chunk.nbytes // 64 + 2**16)
        self._beside.submit(_append, netcdf, chunk).result()

    def close(self) -> None:
        """Complete the file."""
        with self._beside:
            self._beside.submit(self._netcdf.result().close).result()


def _append(netcdf: h5netcdf.File, piece: xr.Dataset) -> None:
    """Append a piece to the file; the first one brings the structure of the file and the variables without time."""
    if not netcdf.dimensions:
        encoding: dict[str, Any] = {}
        for name, variable in piece.variables.items():  # _COUNTED ones are contiguous, so that they can be overwritten
            if name not in _COUNTED and variable.dtype.kind in "fi" and variable.ndim > 0:
                chunks = {"chunksizes": variable.shape} if "time" in variable.dims and variable.size else {}
                encoding[str(name)] = {"zlib": True, "complevel": 3, "shuffle": True, **chunks}
        empty = piece.isel(time=slice(0, 0))
        empty.dump_to_store(xr.backends.H5NetCDFStore(netcdf), encoding=encoding, unlimited_dims=["time"])
    if piece.sizes["time"]:
        begin = len(netcdf.dimensions["time"])
        netcdf.resize_dimension("time", begin + piece.sizes["time"])
        for name, variable in piece.variables.items():
            # h5netcdf looks up the lengths of all dimensions at each access, which takes longer than the writing.
            stored = netcdf._h5group[netcdf.variables[name]._h5path]
            if name in _COUNTED:
                stored[...] = variable.values
            elif "time" in variable.dims:
                stored[begin:] = variable.values
    for name, value in piece.attrs.items():  # the last piece has the run's status and its communication
        if netcdf.attrs[name] != value and isinstance(value, int):
            netcdf._h5group.attrs.modify(name, value)  # in place, so that the bytes equal those of a run in one piece
        elif netcdf.attrs[name] != value:
            netcdf.attrs[name] = value


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
    chunks = dataset["agent_position"].encoding.get("chunksizes")
    together = int(chunks[0]) if chunks else max(1, min(2048, dataset.sizes["time"]))
    vehicles = dataset.sizes["agent"] + dataset.sizes.get("target", 0)
    return together * max(1, _POSITIONS_READ // (together * vehicles))


def thin(samples: int, most: int) -> IntArray:
    """Return the indices of at most `most` evenly spread samples, including the first and the last."""
    return np.unique(np.linspace(0, samples - 1, min(samples, most)).round().astype(np.int64))


def thinned(dataset: xr.Dataset) -> xr.Dataset:
    """Load at most 4000 samples of a run, including the first and the last; more are invisible in a plot.

    A large team has fewer, so that memory has at most 400,000 positions of agents, but at least 200.
    """
    samples = dataset.sizes["time"]
    most = max(200, min(4000, 400_000 // dataset.sizes["agent"]))
    kept = thin(samples, most)
    return dataset.load() if len(kept) == samples else at_rows(dataset, kept)


def at_rows(dataset: xr.Dataset, rows: IntArray) -> xr.Dataset:
    """Load the samples at increasing rows; the data are read piece by piece."""
    step = length_of_piece(dataset)
    chosen = np.split(rows, np.searchsorted(rows, np.arange(step, dataset.sizes["time"], step)))
    pieces = zip(split(dataset, step), chosen, strict=True)
    return join(piece.load().isel(time=here % step) for piece, here in pieces if len(here))


_FIGURES = ("errors", "trajectories", "configurations", "budget", "convergence")
FILES = (
    *("result.nc", "summary.json", "scenario.yaml", "video.mp4", "report.html"),
    *("errors.png", "trajectories.png", "configurations.png"),
)
"""Names of files in the directory of a run; plots may have other formats."""

COMPARISON_FILES = (
    *("compare.json", "scenario.yaml", "report.txt", "compare.mp4", "report.html"),
    *("errors.png", "budget.png", "convergence.png"),
)
"""Names of files in the directory of a comparison; plots may have other formats."""

RUNS_FILES = ("runs.json", "runs.csv", "errors.png", "report.html")
"""Files that `compare-runs` writes into its directory; plots may have other formats."""

LOG = "run.mcap"
"""File in the directory of a run with its log for Foxglove."""

BAG = "run_ros2"
"""Folder in the directory of a run with a bag of ROS 2."""

BAG_FILES = frozenset({"metadata.yaml", f"{BAG}.mcap", "scenario.yaml"})
"""Names of files in that folder."""

VEHICLES = "vehicles"
"""Folder in either directory with the files of vehicles that do not come with mjsheaf."""

CHECKSUMS = "SHA256SUMS"
"""File in that folder with the checksums of the files that mjsheaf wrote, in the format of sha256sum."""

RESULT_DIGEST = "result_sha256"
"""Field of summary.json that detects a damaged or changed result.nc."""

_RECORDS = ("summary.json", "compare.json", "runs.json")


def check_replaceable(directory: Path) -> None:
    """Refuse a path that holds anything but an earlier run.

    Raises:
        PlaceError: The path is a file, a directory with contents that mjsheaf did not write, a directory that cannot be
            renamed, or inside the directory of another run, which could then no longer be replaced.
    """
    run = enclosing_run(directory)
    is_link = directory.is_symlink()
    exists = directory.exists() or is_link
    mounted = os.path.ismount(directory)
    what = "a mount point" if mounted else "the current directory"
    if run is not None:
        raise PlaceError(f"{directory}: lies inside {run}, the directory of another run; choose another with --out")
    if exists and (is_link or not directory.is_dir()):
        raise PlaceError(f"{directory}: exists and is not a directory; choose another with --out")
    if mounted or directory.resolve() == Path.cwd():
        raise PlaceError(f"{directory}: is {what}, which no rename can replace; name a directory in it with --out")
    entries = {path.name for path in directory.iterdir()} if exists else set()
    ours = {*FILES, LOG, *COMPARISON_FILES, *RUNS_FILES, *figure_files(_FIGURES), VEHICLES, BAG}
    strange = [
        *sorted(name for name in entries - ours if not is_part_of(name, ours)),
        *_strange_vehicles(directory / VEHICLES),
        *(f"{BAG}/{name}" for name in strange_in_bag(directory / BAG)),
    ]
    if strange:
        raise PlaceError(
            f"{directory}: holds {strange[0]!r}, which mjsheaf did not write; move it or choose another with --out"
        )
    if entries and record_in(directory) is None:
        raise PlaceError(f"{directory}: exists and was not written by mjsheaf; choose another with --out")


def write_checksums(folder: Path) -> None:
    """Write the checksums of the files in the folder of vehicles."""
    (folder / CHECKSUMS).write_text("".join(f"{line}\n" for line in _checksums(folder).values()), encoding="utf-8")


def _checksums(folder: Path) -> dict[str, str]:
    """Compute the line of sha256sum for each file or link below a folder, by its relative path."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_symlink() or not path.is_dir()]
    return {name: f"{digest(path)}  {name}" for path in files if (name := str(path.relative_to(folder))) != CHECKSUMS}


def _strange_vehicles(folder: Path) -> list[str]:
    """List unknown or changed files in the folder of vehicles, relative to the run's directory."""
    if not folder.is_dir() or folder.is_symlink():
        return [VEHICLES] if folder.exists() or folder.is_symlink() else []
    known: list[str] = []
    with suppress(OSError, ValueError):
        known = (folder / CHECKSUMS).read_text(encoding="utf-8").splitlines()
    return [f"{VEHICLES}/{name}" for name, line in _checksums(folder).items() if line not in known]


def strange_in_bag(folder: Path) -> list[str]:
    """List the files in the folder of a bag that mjsheaf did not write; the folder's own name if it is no folder."""
    if not folder.is_dir() or folder.is_symlink():
        return [folder.name] if folder.exists() or folder.is_symlink() else []
    return sorted({entry.name for entry in folder.iterdir()} - BAG_FILES)


def record_in(directory: Path, names: Iterable[str] = _RECORDS) -> dict[str, Any] | None:
    """Return the contents of the first of these JSON files in a directory that mjsheaf wrote; None without one."""
    records = (read_mapping(directory / name) or {} for name in names)
    return next((record for record in records if "mjsheaf_version" in record), None)


def read_mapping(path: Path) -> dict[str, Any] | None:
    """Read the mapping in a JSON file; None if there is no such file, or it is not a mapping."""
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def require_same_origin(directory: Path, origin: str) -> None:
    """Refuse a default directory that holds the run of another scenario with the same name.

    Raises:
        PlaceError: The message names both.
    """
    before = (record_in(directory) or {}).get("origin")
    if before is None or origin in (before, "scenario.yaml"):  # the latter repeats this run
        return

    def shown(of: str) -> str:
        return of if os.sep not in of and not of.endswith(SUFFIXES) else os.path.relpath(directory / of)

    raise PlaceError(
        f"{directory}: holds the run of {shown(before)}, another scenario of the same name as {shown(origin)}; choose "
        "another directory with --out, or change the name in one of them"
    )


def replaced_run(directory: Path) -> str | None:
    """Return a message about the run or comparison that a new one would replace; None if there is none."""
    if record_in(directory) is None:
        return None
    data = next((path for name in ("result.nc", *_RECORDS) if (path := directory / name).exists()), directory)
    return f"replaced the run of {datetime.fromtimestamp(data.stat().st_mtime):%Y-%m-%d %H:%M:%S} in {directory}"


def enclosing_run(path: Path, *others: str) -> Path | None:
    """Return the directory of a run that contains a path, or one with a record of `others`; None if there is none."""
    folder = Path(os.path.realpath(Path(os.path.abspath(path)).parent))
    return next((place for place in (folder, *folder.parents) if record_in(place, (*_RECORDS, *others))), None)


@contextmanager
def staging(directory: Path) -> Iterator[Path]:
    """Yield a new directory that replaces `directory` when the block ends without an exception.

    After an exception, it is removed together with the parents that were created for it.

    Raises:
        PlaceError: The directory may not be replaced or cannot be written.
    """
    check_replaceable(directory)
    place = Path(os.path.abspath(directory))
    missing = [parent for parent in place.parents if not parent.exists()]  # the deepest first
    try:
        with naming(directory, kind=PlaceError):
            place.parent.mkdir(parents=True, exist_ok=True)
            with whole_directory(place) as fresh:
                yield fresh
                check_replaceable(place)  # again, because it may have changed since
    finally:
        remove_empty(missing)  # those that do not hold the published directory


def save_summary(summary: dict[str, Any], path: Path) -> None:
    """Write summary.json atomically; non-finite numbers become null."""
    record = {"mjsheaf_version": __version__, **summary}
    write_whole(path, to_json(record, indent=2, inf_nan_mode="null", ensure_ascii=True) + b"\n")


def _is_whole(summary: dict[str, Any]) -> bool:
    """Return True if the fields of a summary.json that are read later have the right types, or are missing."""
    try:
        groups = ((summary.get("final") or {}).get("groups") or {}).values()
        checks = (summary.get("expect") or {}).get("checks") or []
        return all(isinstance(entry, dict) for entry in (*groups, *checks, *(summary.get("notes") or [])))
    except (AttributeError, TypeError):
        return False


@contextmanager
def open_run(directory: Path) -> Iterator[tuple[xr.Dataset, dict[str, Any]]]:
    """Open the data and summary.json of a finished run; data are read on access, within the block.

    Raises:
        InputError: The directory holds no run.
    """
    no_data = "which keeps no data; expected the directory of a run"
    outputs = "`mjsheaf compare` makes its pages, plots and video"
    if (directory / "compare.json").is_file():
        raise InputError(f"{directory}: holds a comparison, {no_data}. {outputs}")
    if (directory / "runs.json").is_file():
        raise InputError(f"{directory}: holds a comparison of runs, {no_data}")
    for name in ("result.nc", "summary.json", "scenario.yaml"):
        if not (directory / name).is_file():
            raise InputError(f"{directory}: holds no {name}; expected the directory of a finished run")
    summary, data = read_mapping(directory / "summary.json"), directory / "result.nc"
    if summary is None or not _is_whole(summary):
        raise InputError(f"{directory}: summary.json cannot be read; expected the mapping that a run leaves there")
    if not summary.get(RESULT_DIGEST):
        raise InputError(f"{directory}: summary.json has no checksum of result.nc; run the scenario again")
    if digest(data) != summary[RESULT_DIGEST]:  # HDF5 reads damaged data without an error, or crashes
        raise InputError(f"{directory}: result.nc has changed since the run; run the scenario again")
    with open_dataset(data) as dataset:
        yield dataset, summary


@contextmanager
def reopen_run(directory: Path) -> Iterator[tuple[Scenario, xr.Dataset, dict[str, Any]]]:
    """Open the scenario, data and summary.json of a finished run, and check that the data match the scenario.

    Raises:
        InputError: The directory holds no run, or one that does not match its scenario.
    """
    with open_run(directory) as (dataset, summary):
        scenario = load_scenario(directory / "scenario.yaml")
        fault = fault_of(dataset)
        if fault:
            raise InputError(f"{directory}: result.nc is not that of a run: it {fault}")
        for kind, members in (("agent", scenario.agents), ("target", scenario.targets)):
            place = dataset[f"{kind}_position"].isel(time=0).transpose(kind, "axis").notnull()
            found = dict(zip(map(str, dataset[kind].values), place.sum("axis").values.tolist(), strict=True))
            if found != {m.id: len(m.position) for m in members}:
                raise InputError(
                    f"{directory}: result.nc and scenario.yaml do not match: their {kind}s differ; run the scenario "
                    "again"
                )
        yield scenario, dataset, summary
