"""The double gyre of Shadden, Lekien and Marsden (Physica D 212, 2005), as a function and as a netCDF file.

python -m tests.media.double_gyre scenarios/double_gyre.nc
"""

import math
import sys
from pathlib import Path

import numpy as np
import xarray as xr

from mjsheaf.recordings.cf import EARTH

LENGTH = 100.0
"""Side of one gyre, m."""
SPEED = 0.4
"""Largest speed of the steady gyre, m/s."""
PERIOD = 200.0
"""Period of the oscillation, s."""
_SWING = 0.25
LATITUDE, LONGITUDE = 43.0, 7.0


def velocity(x: np.ndarray, y: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocity at places in [0, 2 LENGTH] x [0, LENGTH], m, and times, s, in m/s."""
    a = _SWING * np.sin(2.0 * np.pi * t / PERIOD)
    b = 1.0 - 2.0 * a
    X, Y = x / LENGTH, y / LENGTH
    f = a * X**2 + b * X
    slope = 2.0 * a * X + b
    return (-SPEED * np.sin(np.pi * f) * np.cos(np.pi * Y), SPEED * np.cos(np.pi * f) * np.sin(np.pi * Y) * slope)


def write(path: Path, cells: int, times: int, end: float, *, land: bool = False, short: bool = False) -> None:
    """Write a file with a number of cells along each gyre's side, and of times from 0 to `end` s.

    Its latitudes fall, as those of many files do; `short` rounds to single precision, and compresses.
    """
    x = np.linspace(0.0, 2.0 * LENGTH, 2 * cells + 1)
    y = np.linspace(LENGTH, 0.0, cells + 1)
    t = np.linspace(0.0, end, times)
    u, v = velocity(x[None, None], y[None, :, None], t[:, None, None])
    if land:
        v[:, (y[:, None] > 0.4 * LENGTH) & (y[:, None] < 0.6 * LENGTH) & (abs(x - LENGTH) < 0.1 * LENGTH)] = np.nan
    encoding = {name: {"dtype": "float32", "zlib": True} for name in ("uo", "vo")} if short else {}
    per_degree = math.radians(1.0) * EARTH
    zero = np.datetime64("2026-05-01T00:00:00", "ns")
    xr.Dataset(
        {
            "uo": (("time", "lat", "lon"), u, {"standard_name": "eastward_sea_water_velocity", "units": "m s-1"}),
            "vo": (("time", "lat", "lon"), v, {"standard_name": "northward_sea_water_velocity", "units": "m s-1"}),
        },
        {
            "time": zero + (t * 1e9).astype("timedelta64[ns]"),
            "lat": ("lat", LATITUDE + y / per_degree, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": (
                "lon",
                LONGITUDE + x / per_degree / math.cos(math.radians(LATITUDE)),
                {"standard_name": "longitude", "units": "degrees_east"},
            ),
        },
        {"Conventions": "CF-1.8", "title": "Double gyre, synthetic"},
    ).to_netcdf(path, engine="h5netcdf", encoding=encoding)


if __name__ == "__main__":
    write(Path(sys.argv[1]), 12, 31, 300.0, short=True)
