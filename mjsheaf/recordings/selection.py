"""What a recorded motion says about its file, and how columns of positions become rows t, x, y[, z]."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.cf import to_plane
from mjsheaf.errors import InputError, listed
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


def arrange(seconds: Array, columns: dict[str, Array], selection: Selection, axes: Axes = "enu") -> Rows:
    """Return the rows of columns of positions.

    Args:
        seconds: Times, shape (T,), s.
        columns: x and y in m, east and north in m, or latitude and longitude in degrees, each of shape (T,), and z or
            up in m where there is a third coordinate. x, y and z are along `axes`, the others along their names.
        selection: Fields of the motion; their axes override `axes`.
        axes: Axes of x, y and z.

    Raises:
        InputError: Degrees have no origin, or a value is not a number.
    """
    in_plane = {"x", "y"} <= set(columns)
    geodetic = {"latitude", "longitude"} <= set(columns) and (not in_plane or selection.origin is not None)
    if geodetic:
        columns = _in_plane(columns, selection.origin)
    elif selection.origin is not None:
        raise InputError("origin: positions are in metres, not in degrees; leave it out")
    if selection.axes is not None and (geodetic or not in_plane):
        raise InputError("axes: the file names the directions of its coordinates; leave it out")
    up = columns.get("up", columns.get("z"))
    if {"east", "north"} <= set(columns):
        east, north = columns["east"], columns["north"]
    else:
        down = (selection.axes or axes) == "ned"
        east, north = (columns["y"], columns["x"]) if down else (columns["x"], columns["y"])
        if "z" in columns:
            up = 0.0 - columns["z"] if down else columns["z"]
    rows = np.column_stack([seconds, east, north, *([] if up is None else [up])])
    if not np.isfinite(rows).all():
        k = int((~np.isfinite(rows)).any(axis=1).argmax())
        raise InputError(f"position {k} is not a number")
    found: Rows = rows.tolist()
    return found


def _in_plane(columns: dict[str, Array], origin: list[float] | None) -> dict[str, Array]:
    """Return columns with east and north, m, in place of latitude and longitude."""
    if origin is None:
        raise InputError(
            "origin: missing; positions are in degrees; expected the latitude and longitude of the scenario's origin, "
            "as in {kind: recorded, path: ..., origin: [59.9, 10.7]}"
        )
    latitude, longitude = columns["latitude"], columns["longitude"]
    for name, values, limit in (("latitude", latitude, 90.0), ("longitude", longitude, 360.0)):
        if (np.abs(values) > limit).any():
            raise InputError(f"{name} is {float(values[np.abs(values) > limit][0]):g}; expected degrees")
    if ((latitude == 0.0) & (longitude == 0.0)).any():
        raise InputError("a position is at 0, 0 degrees, as receivers write without a fix; expected it left out")
    east, north = to_plane(latitude, longitude, (origin[0], origin[1]))
    height = columns.get("up", columns.get("z"))
    return {"east": east, "north": north} | ({} if height is None else {"up": height})
