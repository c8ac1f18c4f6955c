"""Recorded positions: rows t, x, y[, z] out of CSV, netCDF, MCAP and bags of ROS.

Times of a table and of netCDF without a date are those of the run. Dates and clocks count from the first row.
"""

import os
import stat
import warnings
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from mjsheaf.errors import InputError, listed, shortened
from mjsheaf.section import Number, Section

Rows = list[list[float]]
Axes = Literal["enu", "ned"]


class Selection(Section):
    """Fields of a recorded motion that select from its file; None where the file decides."""

    topic: str | None = Field(
        None, description="topic of a log; the agent or target in a run's result.nc; one of several trajectories"
    )
    frame: str | None = Field(None, description="child frame, of a topic with the transforms of several")
    time: Literal["stamp", "log"] | None = Field(
        None, description="clock of a log: stamps in its messages, where they have any, or the times in the log"
    )
    axes: Axes | None = Field(
        None, description="axes of x, y and z, where the file does not say: east, north, up or north, east, down"
    )
    origin: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = Field(
        None, description="latitude and longitude of the scenario's origin, for positions in degrees [deg]"
    )

    @property
    def selects(self) -> bool:
        """True if a field is given."""
        return any(getattr(self, name) is not None for name in Selection.model_fields)

    def refuse(self, *fields: str) -> None:
        """Refuse fields that a kind of file has nothing for."""
        for field in fields:
            if getattr(self, field) is not None:
                raise InputError(f"{field}: this kind of file has none; leave it out")

    def choose(self, known: list[str]) -> str:
        """Return the topic to read, which may be left out where there is only one."""
        if self.topic is None and len(known) == 1:
            return known[0]
        if self.topic not in known:
            given = "missing" if self.topic is None else f"there is no {self.topic!r}"
            raise InputError(f"topic: {given}; expected {listed(known) or 'a log with a topic'}")
        return self.topic


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
    of_bag = os.path.isfile(place / "metadata.yaml")  # False also for a name that no file can have
    module, function = _READERS[".bag"] if of_bag else _READERS.get(place.suffix.lower(), ("tables", "read_table"))
    read: Callable[[Path, Selection], Rows] = getattr(import_module(f"mjsheaf.recordings.{module}"), function)
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
    if not 0 < len(rows) <= MAX_ROWS:
        raise InputError(f"{name}: samples: has {len(rows)} positions; expected 1 to {MAX_ROWS}")
    return rows


_READERS = {
    ".nc": ("tables", "read_netcdf"),
    ".mcap": ("logs", "read_mcap"),
    ".bag": ("logs", "read_bag"),
    ".db3": ("logs", "read_bag"),
}
"""Module and function that read a kind of file; they load libraries that take long, and are loaded when one is read."""
