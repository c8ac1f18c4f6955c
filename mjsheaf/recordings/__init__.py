"""Recorded positions: rows t, x, y[, z] out of CSV, netCDF, MCAP and bags of ROS.

Times of a table and of netCDF without a date are those of the run. Dates and clocks count from the first row.
"""

import os
import stat
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mjsheaf.errors import InputError, shortened
from mjsheaf.recordings.logs import read_bag, read_mcap
from mjsheaf.recordings.tables import Rows, Selection, read_netcdf, read_table

MAX_ROWS = 200_000
"""Maximum number of rows; a scenario with more could not be read again."""


def read_positions(path: str, selection: Selection | None = None, **fields: Any) -> Rows:
    """Read the rows of a file or of a bag's directory.

    Args:
        path: CSV table, netCDF (.nc), MCAP, or bag of ROS (.bag, .db3, directory).
        selection: What is read of the file.
        **fields: Fields of a `Selection` unless one is given.

    Raises:
        InputError: The file cannot be read, or does not hold positions; the message names the file and what is missing.
    """
    name = shortened(path, 100) or "''"
    place = Path(path)
    read: Callable[[Path, Selection], Rows] = _READERS.get(place.suffix.lower(), read_table)
    if (place / "metadata.yaml").is_file():
        read = read_bag
    try:
        mode = os.stat(path).st_mode  # also refuses an empty path, which Path takes for the working directory
        inner = [entry.stat().st_mode for entry in os.scandir(path)] if stat.S_ISDIR(mode) else []
        if not all(stat.S_ISREG(found) or stat.S_ISDIR(found) for found in (mode, *inner)):  # these block a reader
            raise InputError("is a pipe or a device; expected a file, or the directory of a bag")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of libraries, about attributes that do not matter here
            rows = read(place, selection or Selection(**fields))
    except OSError as error:
        raise InputError(f"{name}: {error.strerror or f'cannot be read: {error}'}") from None
    except InputError as error:
        raise error.within(name) from None
    except ImportError as error:
        raise InputError(f"{name}: needs {error.name}, which is not installed: pip install 'mjsheaf[mcap]'") from None
    except Exception as error:  # damaged files raise many kinds of exceptions in their readers
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{name}: cannot be read: {shortened(reason, 200)}") from None
    if len(rows) > MAX_ROWS:
        raise InputError(f"{name}: has {len(rows)} positions; expected at most {MAX_ROWS}, so leave some out")
    return rows


_READERS: dict[str, Callable[[Path, Selection], Rows]] = {
    ".nc": read_netcdf,
    ".mcap": read_mcap,
    ".bag": read_bag,
    ".db3": read_bag,
}
