"""Trajectories in netCDF: each form of CF is read with the right value, or refused.

Values that are packed, missing or out of range are decoded as those of flows: see `test_flow_files`.

Oracle: xarray's own decoding of times and missing values; values that the test chose.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf.errors import InputError
from mjsheaf.recordings import read_positions
from mjsheaf.recordings.cf import EARTH

COUNT = 4
T = np.array([0.0, 60.0, 120.0, 300.0])
LAT, LON = 60.0 + 2e-4 * np.arange(COUNT), 10.0 + 1e-4 * np.arange(COUNT)
UP = -np.array([1.0, 2.0, 4.0, 3.0])
METRE = np.radians(1.0) * EARTH
ROWS = np.column_stack([T, METRE * 1e-4 * np.arange(COUNT) / 2, METRE * 2e-4 * np.arange(COUNT), UP])
ORIGIN = {"origin": [60.0, 10.0]}
NORTH = {"standard_name": "latitude", "units": "degrees_north"}
EAST = {"standard_name": "longitude", "units": "degrees_east"}
HEIGHT = {"standard_name": "height", "units": "m", "positive": "up"}
CLOCK = {"standard_name": "time", "units": "seconds since 2026-01-01"}
Variables = dict[str, Any]


def single(dim: str = "time", **change: Any) -> Variables:
    """One trajectory over time; `change` replaces variables."""
    own = {"lat": (dim, LAT, NORTH), "lon": (dim, LON, EAST), "z": (dim, UP, HEIGHT), "time": (dim, T, CLOCK)}
    return {**own, **change}


def several(time_of_each: bool = False) -> Variables:
    """Three trajectories in an array, of which `b` begins later and ends earlier than the others."""
    dims = ("trajectory", "obs" if time_of_each else "time")
    shift = np.array([5.0, 0.0, 7.0])[:, None]
    pad = np.full((3, 1), np.nan)

    def padded(values: np.ndarray) -> np.ndarray:
        return np.hstack([pad, values, pad])

    ids = np.array(["a", "b", "c"], dtype=object)
    times = np.array([-60.0, *T, 400.0])
    own: Variables = {
        "trajectory": ("trajectory", ids, {"cf_role": "trajectory_id"}),
        "lat": (dims, padded(LAT + shift), NORTH),
        "lon": (dims, padded(LON + shift), EAST),
        "z": (dims, padded(UP + shift), HEIGHT),
        "time": (dims, padded(T + 0 * shift), CLOCK) if time_of_each else ("time", times, CLOCK),
    }
    return own


def ragged(indexed: bool = False, attribute: bool = True) -> Variables:
    """Trajectories 11 (two samples), 12 and 13 (one sample), one after another or by an index of each sample."""
    owners = np.array([0, 0, 1, 1, 1, 1, 2])
    order = np.array([2, 0, 3, 4, 1, 6, 5]) if indexed else np.arange(7)  # the samples of each in order
    places = [np.concatenate([[1, 2], values, [5]])[order] for values in (LAT, LON, UP, T)]
    named = dict(zip(("lat", "lon", "z", "time"), places, strict=True))
    own: Variables = {name: ("obs", values, single()[name][2]) for name, values in named.items()}
    own["trajectory"] = ("trajectory", np.array([11, 12, 13]), {"cf_role": "trajectory_id"})
    if indexed:
        own["owner"] = ("obs", owners[order], {"instance_dimension": "trajectory"})
    else:
        own["rowsize"] = ("trajectory", np.array([2, 4, 1]), {"sample_dimension": "obs"} if attribute else {})
    return own


def in_metres(**change: Any) -> Variables:
    x, y = ROWS[:, 1], ROWS[:, 2]
    return {
        "x": ("time", x, {"units": "m"}),
        "y": ("time", y, {"units": "m"}),
        "z": ("time", UP, {"units": "m"}),
        "time": ("time", T, CLOCK),
        **change,
    }


def timed(units: str, scale: float, shift: float = 0.0, **attributes: Any) -> Variables:
    shift = 7.0 if "since" in units else shift
    return single(time=("time", T / scale + shift, {"units": units, **attributes}))


FORMS: dict[str, Variables | tuple[Variables, dict[str, Any], np.ndarray]] = {
    "one trajectory over time": single(),
    "one trajectory over its samples": single("obs"),
    "one trajectory with a name": {**single(), "id": ((), "b", {"cf_role": "trajectory_id"})},
    "an array with one time for all": (several(), {"topic": "b", **ORIGIN}, ROWS),
    "an array with times of each": (several(True), {"topic": "b", **ORIGIN}, ROWS),
    "counts": (ragged(), {"topic": "12", **ORIGIN}, ROWS),
    "counts without their attribute": (ragged(attribute=False), {"topic": "12", **ORIGIN}, ROWS),
    "an index": (ragged(indexed=True), {"topic": "12", **ORIGIN}, ROWS),
    "units alone": single(lat=("time", LAT, {"units": "degree_north"}), lon=("time", LON, {"units": "degrees_E"})),
    "names alone": single(lat=None, lon=None, latitude=("time", LAT), longitude=("time", LON)),
    "metres by name": (in_metres(), {}, ROWS),
    "metres with standard names": (
        in_metres(
            x=None,
            y=None,
            e=("time", ROWS[:, 1] / 1e3, {"standard_name": "projection_x_coordinate", "units": "km"}),
            n=("time", ROWS[:, 2], {"standard_name": "projection_y_coordinate", "units": "m"}),
        ),
        {},
        ROWS,
    ),
    "metres with degrees of their own": ({**in_metres(), **single(z=("time", UP, HEIGHT))}, {}, ROWS),
    "degrees with metres of their own": {**in_metres(x=("time", 9 * T), y=("time", 9 * T)), **single()},
    "axes ned": (in_metres(x=("time", ROWS[:, 2]), y=("time", ROWS[:, 1]), z=("time", -UP)), {"axes": "ned"}, ROWS),
    "depth": single(z=("time", -UP, {"standard_name": "depth", "units": "m"})),
    "depth by name alone": single(z=None, depth=("time", -UP, {"units": "m"})),
    "depth that points up": single(z=("time", UP, {"standard_name": "depth", "units": "m", "positive": "up"})),
    "positive down": single(z=("time", -UP * 100, {"units": "cm", "positive": "down"})),
    "no height": (single(z=None), ORIGIN, ROWS[:, :3]),
    "a height that is missing everywhere": (single(z=("time", np.nan * UP, HEIGHT)), ORIGIN, ROWS[:, :3]),
    "longitudes of another turn": (single(lon=("time", LON - 360.0, EAST)), {"origin": [60.0, 10.0]}, ROWS),
    "radians": single(lat=("time", np.radians(LAT), {**NORTH, "units": "radian"})),
    "days since, another calendar": timed("days since 2026-02-01", 86400.0, calendar="360_day"),
    "seconds that do not begin at 0": (timed("s", 1.0, shift=10.0), ORIGIN, np.add(ROWS, [10.0, 0.0, 0.0, 0.0])),
    "other variables": {**single(), "sst": ("time", T), "u": ("time", T, {"standard_name": "eastward_wind"})},
}


def write(path: Path, variables: Variables) -> str:
    kept = {name: variable for name, variable in variables.items() if variable is not None}
    xr.Dataset(kept).to_netcdf(path, engine="h5netcdf")
    return str(path)


@pytest.mark.parametrize("form", FORMS)
def test_a_form_is_read(form: str, tmp_path: Path) -> None:
    case = FORMS[form]
    variables, fields, expected = case if isinstance(case, tuple) else (case, ORIGIN, ROWS)
    rows = np.array(read_positions(write(tmp_path / "a.nc", variables), **fields))
    np.testing.assert_allclose(rows, expected, rtol=1e-9, atol=1e-5)


def test_times_are_those_that_xarray_decodes(tmp_path: Path) -> None:
    time = np.array(
        [1_778_234_355_123_456_789, 1_778_234_355_123_456_790, 1_778_234_356_000_000_000, 1_778_234_357_000_000_000]
    )
    path = write(tmp_path / "a.nc", single(time=("time", time, {"units": "nanoseconds since 1970-01-01"})))
    with xr.open_dataset(path) as dataset:
        expected = (dataset["time"].values - dataset["time"].values[0]) / np.timedelta64(1, "ns") / 1e9
    times = [row[0] for row in read_positions(path, origin=[60.0, 10.0])]
    np.testing.assert_allclose(times, expected, rtol=1e-15)


def test_files_of_netcdf_3_are_read(tmp_path: Path) -> None:
    xr.Dataset(single()).to_netcdf(tmp_path / "a.nc", engine="scipy", format="NETCDF3_CLASSIC")
    rows = np.array(read_positions(str(tmp_path / "a.nc"), origin=[60.0, 10.0]))
    np.testing.assert_allclose(rows, ROWS, rtol=1e-9, atol=1e-5)


@pytest.mark.parametrize(
    ("variables", "fields", "message"),
    [
        (single(), {"topic": "b", **ORIGIN}, "topic: this kind of file has none"),
        (several(), ORIGIN, "topic: missing; expected a, b, c"),
        (several(), {"topic": "d", **ORIGIN}, "topic: there is no 'd'; expected a, b, c"),
        (ragged(), ORIGIN, "topic: missing; expected 11, 12, 13"),
        ({**ragged(), "rowsize": None}, ORIGIN, "trajectory names several trajectories; expected their counts"),
        (single(lat=("time", [*LAT[:2], np.nan, LAT[3]], NORTH)), ORIGIN, "position 2 is not a number"),
        (single(lat2=("time", LAT, NORTH)), ORIGIN, "lat, lat2 are all latitude .* expected one"),
        (single(lat=("time", LAT, {**NORTH, "units": "m"})), ORIGIN, r"latitude \(lat\): the unit is 'm'"),
        (single(z=("time", UP, {"standard_name": "height", "units": "Pa"})), ORIGIN, r"z \(z\): the unit is 'Pa'"),
        (in_metres(x=("time", T, {"units": "degrees"})), {}, r"x \(x\): the unit is 'degrees'; expected m"),
        (timed("months since 2026-01-01", 1.0), ORIGIN, "time: the unit is 'months'; expected s"),
        (single(time=None), ORIGIN, "expected a coordinate time over time"),
        ({"u": ("time", T), "time": ("time", T)}, {}, "expected variables x, y, and in space z"),
    ],
)
def test_what_is_not_understood_is_refused_in_one_line(
    variables: Variables, fields: dict[str, Any], message: str, tmp_path: Path
) -> None:
    path = write(tmp_path / "a.nc", variables)
    with pytest.raises(InputError, match=rf"^[^\n]*a\.nc: {message}[^\n]*$"):
        read_positions(path, **fields)
