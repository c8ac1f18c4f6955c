"""Positions in netCDF: a run's result.nc, or trajectories by the CF conventions.

CF has four forms of trajectories: a single one over time, several in an array, and several one after another, by their
counts (contiguous ragged array) or by an index of each sample (indexed ragged array).
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, in_field, listed
from mjsheaf.io.cf import decoded, open_netcdf
from mjsheaf.io.units import factor
from mjsheaf.recordings.selection import Rows, Selection, arrange

if TYPE_CHECKING:
    import xarray as xr

_HEIGHTS = ("height", "altitude", "height_above_mean_sea_level", "height_above_reference_ellipsoid", "depth")
_NAMED = ("height", "altitude", "depth")  # that count by their name where the file has no attributes
_AXES: dict[str, tuple[tuple[str, ...], str]] = {
    "x": (("projection_x_coordinate",), "m"),
    "y": (("projection_y_coordinate",), "m"),
    "z": (_HEIGHTS, "m"),
    "latitude": (("latitude",), "degree"),
    "longitude": (("longitude",), "degree"),
}
"""Standard names and unit of each coordinate."""


def read_netcdf(path: Path, selection: Selection) -> Rows:
    """Read a run's result.nc, or a trajectory with CF's names."""
    import xarray as xr

    selection.refuse("frame", "time")
    with open_netcdf(str(path)) as raw:
        dataset = xr.decode_cf(raw, decode_times=False, decode_timedelta=False)
        if "agent_position" in dataset:
            selection.refuse("axes", "origin")
            places = dict(zip("xyz", _of_vehicle(dataset, selection.topic).T, strict=False))
            return arrange(_seconds(raw["time"]), places, selection)
        found = {axis: raw[variable.name] for axis, variable in _find(dataset).items()}
        track = _of_trajectory(dataset, found, selection)
        seconds = _seconds(track["time"])
        columns = {name: _values(variable, name) for name, variable in track.items() if name != "time"}
    if "z" in columns and np.isnan(columns["z"]).all():
        del columns["z"]
    known = np.isfinite(seconds) & np.all([np.isfinite(values) for values in columns.values()], axis=0)
    if known.any():  # files have no values before a trajectory begins and after it ends
        inner = slice(int(known.argmax()), len(known) - int(known[::-1].argmax()))
        seconds, columns = seconds[inner], {name: values[inner] for name, values in columns.items()}
    if "since" in str(track["time"].attrs.get("units")):
        seconds = seconds - seconds[:1]
    return arrange(seconds, columns, selection)


def _of_vehicle(dataset: "xr.Dataset", vehicle: str | None) -> Array:
    """Return the positions of one agent or target of a run, shape (T, n), m."""
    known = {str(x): (kind, k) for kind in ("agent", "target") for k, x in enumerate(dataset[kind].values)}
    if vehicle not in known:
        raise InputError(f"topic: {vehicle!r} is no agent or target of this run; expected {', '.join(known)}")
    kind, k = known[vehicle]
    places = dataset[f"{kind}_position"].values[:, k]
    return np.asarray(places[:, ~np.isnan(places).all(axis=0)])


def _find(dataset: "xr.Dataset") -> dict[str, "xr.DataArray"]:
    """Return time and the coordinates of positions: by standard name or unit as CF has them, else by name."""
    import cf_xarray  # noqa: F401  # adds the accessor `cf`

    listing = dataset.set_coords(list(dataset.data_vars)).cf
    found = {}
    for axis, (standard, _) in _AXES.items():
        names = {name for word in standard for name in listing.standard_names.get(word, ())}
        names |= set(listing.coordinates.get(axis, ()))
        names = names or {
            name for name in dataset.variables if str(name).lower() in (axis, *(_NAMED if axis == "z" else ()))
        }
        names = {name for name in names if dataset[name].dims not in ((), (name,))}
        if len(names) > 1:
            raise InputError(f"{listed(sorted(map(str, names)))} are all {axis} by their standard names; expected one")
        if names:
            found[axis] = dataset[names.pop()]
    if not ({"x", "y"} <= set(found) or {"latitude", "longitude"} <= set(found)):
        raise InputError(
            "expected variables x, y, and in space z, over time, by these names or as projection_x_coordinate, "
            "projection_y_coordinate, height, altitude or depth; or latitude and longitude"
        )
    times = ["time"] if "time" in dataset else listing.standard_names.get("time", listing.coordinates.get("time", []))
    dims = next(found[axis].dims for axis in ("x", "latitude") if axis in found)
    if len(times) != 1 or not dataset[times[0]].dims or not set(dataset[times[0]].dims) <= set(dims):
        raise InputError(f"expected a coordinate time over {listed(list(map(str, dims)))}, as the positions")
    return {**found, "time": dataset[times[0]]}


def _of_trajectory(
    dataset: "xr.Dataset", found: dict[str, "xr.DataArray"], selection: Selection
) -> dict[str, "xr.DataArray"]:
    """Return the variables over the samples of one trajectory."""
    dims = next(found[axis].dims for axis in ("x", "latitude") if axis in found)
    variables = [dataset[name] for name in dataset.variables]
    counts = next((v for v in variables if v.attrs.get("sample_dimension") in dims), None)
    index = next((v for v in variables if "instance_dimension" in v.attrs and v.dims == dims), None)
    ids = [dataset[name] for name in dataset.cf.cf_roles.get("trajectory_id", ())]
    apart = [v for v in ids if v.ndim == 1 and v.dims[0] not in dims]
    if counts is None and index is None and apart:  # CF asks for an attribute; others only count
        length = found["time"].size
        counts = next(
            (v for v in variables if v.dims == apart[0].dims and v.dtype.kind in "iu" and v.sum() == length), None
        )
        if counts is None:
            raise InputError(
                f"{apart[0].name} names several trajectories; expected their counts or an index, as CF has it"
            )
    instance = None
    if counts is not None:
        instance = counts.dims[0]
    elif index is not None:
        instance = index.attrs["instance_dimension"]
    elif len(dims) > 1:
        of_ids = [dim for variable in ids for dim in variable.dims if dim in dims]
        instance = next((dim for dim in (*of_ids, *dims) if of_ids or dim not in found["time"].dims), dims[0])
    if instance is None:
        selection.refuse("topic")
        return found
    names = next((v for v in ids if instance in v.dims), dataset[instance])
    labels = [name.decode().strip() if isinstance(name, bytes) else str(name) for name in names.values.tolist()]
    k = labels.index(selection.choose(labels))
    samples: dict[object, object] = {instance: k}
    if counts is not None:
        ends = np.cumsum(counts.values.astype(np.int64))
        samples = {dims[0]: slice(int(ends[k - 1]) if k else 0, int(ends[k]))}
    elif index is not None:
        samples = {dims[0]: np.flatnonzero(index.values == k)}
    track = {axis: v.isel({dim: at for dim, at in samples.items() if dim in v.dims}) for axis, v in found.items()}
    for axis, variable in track.items():
        if variable.dims != track["time"].dims or variable.ndim != 1:
            raise InputError(
                f"{axis} is over {listed(list(map(str, variable.dims)))}; expected one trajectory over time"
            )
    return track


def _values(variable: "xr.DataArray", axis: str) -> Array:
    """Return the values of a coordinate in m, upwards, or in degrees; NaN where they are missing."""
    unit = _AXES[axis][1]
    with in_field(f"{axis} ({variable.name})"):
        values = np.asarray(decoded(variable).values, np.float64)
        values = factor(variable.attrs.get("units", unit), unit) * values
    kind = variable.attrs.get("standard_name", str(variable.name).lower())
    sense = str(variable.attrs.get("positive", "down" if kind == "depth" else "up"))
    return 0.0 - values if axis == "z" and sense.lower() == "down" else values


def _seconds(time: "xr.DataArray") -> Array:
    """Return times in s; differences from the first where they have a date, so that no digit is lost."""
    if time.ndim != 1:
        raise InputError("expected a coordinate time")
    units = str(time.attrs.get("units", "s"))
    word, _, rest = units.strip().partition(" ")
    with in_field("time"):
        scale = factor(word.lower(), "s")
        values = decoded(time).values
    if rest.lstrip().startswith("since") and len(values):
        values = values - values[np.isfinite(values).argmax()]
    return scale * np.asarray(values, np.float64)
