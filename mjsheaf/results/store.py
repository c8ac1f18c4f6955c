"""The directory of a run: published whole, by rename, and never over what mjsheaf did not write."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import xarray as xr

from mjsheaf._version import __version__
from mjsheaf.errors import InputError

FILES = (
    "result.nc",
    "summary.json",
    "scenario.yaml",
    "errors.png",
    "trajectories.png",
    "configurations.png",
    "video.mp4",
)
"""What a run may leave in its directory."""


def check_replaceable(directory: Path) -> None:
    """Refuse a place that holds anything but an earlier run.

    Raises:
        InputError: it is a file, or a directory with contents that mjsheaf did not write.
    """
    if not directory.exists() and not directory.is_symlink():
        return
    if not directory.is_dir() or directory.is_symlink():
        raise InputError(f"{directory}: exists and is not a directory; choose another with --out")
    entries = {path.name for path in directory.iterdir()}
    if not entries:
        return
    strange = sorted(entries - set(FILES))
    if strange:
        raise InputError(
            f"{directory}: holds {strange[0]!r}, which mjsheaf did not write; move it or choose another with --out"
        )
    try:
        ours = "mjsheaf_version" in json.loads((directory / "summary.json").read_text())
    except (OSError, ValueError):
        ours = False
    if not ours:
        raise InputError(f"{directory}: exists and was not written by mjsheaf; choose another with --out")


@contextmanager
def staging(directory: Path) -> Iterator[Path]:
    """A fresh directory that takes the place of `directory` when the block ends without an exception.

    Raises:
        InputError: the place may not be replaced or cannot be written.
    """
    check_replaceable(directory)
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        # Beside its final place: a rename is atomic only within one file system.
        fresh = Path(tempfile.mkdtemp(prefix=f".{directory.name}.", dir=directory.parent))
    except OSError as error:
        raise InputError(f"{directory}: cannot be written: {error.strerror or error}") from None
    try:
        fresh.chmod(0o777 & ~_umask())
        yield fresh
        _swap(fresh, directory)
    except OSError as error:
        raise InputError(f"{directory}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _swap(fresh: Path, directory: Path) -> None:
    if not directory.exists():
        fresh.rename(directory)
        return
    old = fresh.with_name(fresh.name + ".old")
    directory.rename(old)
    try:
        fresh.rename(directory)
    except OSError:
        old.rename(directory)
        raise
    shutil.rmtree(old, ignore_errors=True)


def save_dataset(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset as netCDF-4, compressed; equal datasets give equal bytes."""
    encoding = {
        name: {"zlib": True, "complevel": 3, "shuffle": True}
        for name, variable in dataset.variables.items()
        if variable.dtype.kind == "f" and variable.ndim > 0
    }
    dataset.to_netcdf(path, engine="h5netcdf", encoding=encoding)


def save_summary(summary: dict[str, Any], path: Path) -> None:
    """Write summary.json."""
    path.write_text(json.dumps({"mjsheaf_version": __version__, **summary}, indent=2, allow_nan=False) + "\n")


def load_run(directory: Path) -> tuple[xr.Dataset, dict[str, Any]]:
    """Read result.nc and summary.json of a finished run.

    Raises:
        InputError: the directory holds no run.
    """
    for name in ("result.nc", "summary.json", "scenario.yaml"):
        if not (directory / name).is_file():
            raise InputError(f"{directory}: holds no {name}; legal is the directory of a finished run")
    try:
        with xr.open_dataset(directory / "result.nc", engine="h5netcdf") as file:
            dataset = file.load()
        return dataset, json.loads((directory / "summary.json").read_text())
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{directory}: cannot be read: {' '.join(str(error).split())}") from None
