"""Data made by others: netCDF by the CF conventions, units, and the plane about an origin.

Of CF: attributes that are text, packed values and missing data; xarray reads the files. Units are as CF and UDUNITS
write them: 'm s-1', 'm/s', 'knots', 'millibars'; pint reads them.

The plane in which longitude and latitude become x and y is equirectangular. It is an affine map, so that cells of a
grid stay rectangles:

    x = R cos(lat_0) (lon - lon_0),   y = R (lat - lat_0),   R = 6,371,000 m.

A projected grid keeps its axes, and the plane is turned to them where the origin is; pyproj knows CF's projections.
"""

import hashlib
import math
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import cf_xarray  # noqa: F401  # adds the accessor `cf`
import h5py
import numpy as np
import xarray as xr
from pyproj import CRS, Transformer
from pyproj.enums import TransformDirection
from pyproj.exceptions import CRSError, ProjError

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, in_field, listed, shortened
from mjsheaf.files import open_regular

_SIGNATURE = b"\x89HDF"
_FILLS = {"f4": 9.969209968386869e36, "f8": 9.969209968386869e36, "i2": -32767, "u2": 65535, "i4": -2147483647}
_FILLS |= {"u4": 4294967295, "i8": -9223372036854775806, "u8": 18446744073709551614}
"""Values that netCDF writes where nothing was written; bytes have none."""
_WORDS = ("standard_name", "long_name", "axis", "positive", "coordinates", "grid_mapping", "bounds", "cell_methods")


@contextmanager
def open_netcdf(path: str, sha256: str | None = None) -> Iterator[xr.Dataset]:
    """Open a netCDF file as it is, with attributes that are text where CF says so, and without warnings.

    Raises:
        InputError: It cannot be read, or its content is not the expected one.
    """
    with open_regular(path) as file, warnings.catch_warnings():
        if sha256 is not None and hashlib.file_digest(file, "sha256").hexdigest() != sha256:
            raise InputError("has changed since it was read; expected the content of its sha256, or no such field")
        file.seek(0)
        warnings.simplefilter("ignore")
        try:
            if file.read(len(_SIGNATURE)) == _SIGNATURE:
                # h5netcdf refuses a file that is cut or damaged at its beginning too, but then prints an error to
                # stderr when it forgets what it could not open.
                with h5py.File(file, "r") as whole:
                    whole.attrs.get("_nc3_strict")
            file.seek(0)
            data = xr.open_dataset(file, decode_cf=False)
        except Exception as error:  # of any of the libraries that read files
            reason = shortened(" ".join(str(error).split()), 200)
            raise InputError(f"cannot be read, or is no netCDF file: {reason}") from None
        try:
            for variable in data.variables.values():
                attrs = variable.attrs
                for key in [key for key in _WORDS if not isinstance(attrs.get(key, ""), str)]:
                    del attrs[key]
                if isinstance(text := attrs.get("missing_value"), str):  # which xarray compares as text
                    attrs["missing_value"] = variable.dtype.type(text) if text else np.nan
                if "_Unsigned" in attrs:
                    attrs["_Unsigned"] = str(attrs["_Unsigned"]).lower()
            yield data
        except InputError:
            raise
        except (OSError, RuntimeError, ValueError, TypeError, MemoryError) as error:  # about damaged data, attributes
            raise InputError(f"cannot be read: {shortened(' '.join(str(error).split()), 200) or 'no memory'}") from None
        finally:
            data.close()


def text_of(variable: Any, key: str) -> str:
    """Return an attribute of a variable as text; empty if there is none."""
    return str(variable.attrs.get(key, ""))


def coordinates_of(part: xr.DataArray, *roles: str) -> list[str]:
    """Return the names of the coordinates of a variable that have one of these roles by cf-xarray."""
    tables = {**part.cf.axes, **part.cf.coordinates}
    return list(dict.fromkeys(str(name) for role in roles for name in tables.get(role, ()) if name in part.coords))


def decoded(part: xr.DataArray) -> xr.DataArray:
    """Return a variable with its values unpacked, and NaN where they are missing or not valid.

    `valid_min`, `valid_max` and `valid_range` are about packed values, unless they have the type of unpacked ones.

    Raises:
        InputError: The values, or their limits, are no numbers.
    """
    part = part.load()
    attrs = part.attrs
    if not {"flag_values", "flag_masks", "flag_meanings"}.isdisjoint(attrs) or part.dtype.kind not in "fiu":
        raise InputError(f"has values of type {part.dtype}; expected numbers")
    unpacked = xr.decode_cf(xr.Dataset({"it": part}), decode_times=False, decode_timedelta=False)["it"]
    raw = part.values
    limits = [attrs.get("valid_min"), attrs.get("valid_max")]
    if "valid_range" in attrs:
        limits = list(np.ravel(attrs["valid_range"])[:2])
    if any(np.asarray(limit).dtype.kind not in "fiu" for limit in limits if limit is not None):
        shown = listed(list(map(str, limits)))
        raise InputError(f"has a valid_min, valid_max or valid_range of {shown}; expected numbers")
    missing = np.zeros(raw.shape, bool)
    if str(attrs.get("_Unsigned", "")).lower() == "true" and raw.dtype.kind == "i":
        raw = raw.view(f"u{raw.dtype.itemsize}")
        limits = [None if v is None else np.asarray(v).astype(part.dtype).view(raw.dtype) for v in limits]
    for limit, beyond in zip(limits, (np.less, np.greater), strict=False):
        if limit is not None:
            internal = np.asarray(limit).dtype.kind == "f" and raw.dtype.kind in "iu"
            missing |= beyond(unpacked.values if internal else raw, np.asarray(limit).astype(np.float64))
    if "_FillValue" not in attrs and "missing_value" not in attrs:
        fill = _FILLS.get(f"{raw.dtype.kind}{raw.dtype.itemsize}")
        missing |= False if fill is None else raw == np.asarray(fill).astype(raw.dtype)
    return (unpacked.where(~missing) if missing.any() else unpacked).rename(part.name)


_OF_NO_LENGTH = re.compile(r"(common_|leap_)?(months?|years?|yr?)$", re.IGNORECASE)


def factor(unit: object, into: str) -> float:
    """Return what values in a unit are multiplied by to be in another.

    Months and years are none, as they have no fixed length.

    Raises:
        InputError: It is no unit, or one of something else.
    """
    from cf_xarray.units import units  # takes a second

    text = " ".join(str(unit).split())
    if into == "m s-1" and text.lower() in ("m/s", "ms-1"):  # the second would be 1/ms
        text = into
    try:
        if not text or "since" in text or isinstance(unit, int | float) or _OF_NO_LENGTH.match(text):
            raise ValueError
        return float(units.Quantity(1.0, units.Unit(text)).to(into).magnitude)
    except Exception:  # of the parser, which raises many kinds on what is no unit
        raise InputError(f"the unit is {shortened(repr(unit), 50)}; expected {into} or what converts to it") from None


def converts(unit: object, into: str) -> bool:
    """Return True if values in a unit can be converted to another; see `factor`."""
    try:
        return factor(unit, into) > 0.0
    except InputError:
        return False


EARTH = 6_371_000.0
"""Mean radius of the earth, m."""


def to_plane(latitude: Array, longitude: Array, origin: tuple[float, float]) -> tuple[Array, Array]:
    """Return x and y, m, of places in degrees; longitudes count within half a turn of the origin's.

    Raises:
        InputError: The origin is no place between the poles.
    """
    lat, lon = origin
    if not (abs(lat) <= 90.0 and abs(lon) <= 360.0):
        raise InputError(f"origin: ({lat:g}, {lon:g}) is no place; expected latitude and longitude in degrees")
    turned = (longitude.astype(np.float64) - lon + 180.0) % 360.0 - 180.0
    x = math.radians(1.0) * EARTH * math.cos(math.radians(lat)) * turned
    return np.asarray(x), np.asarray(math.radians(1.0) * EARTH * (latitude.astype(np.float64) - lat))


_LATITUDES, _LONGITUDES = ("lat", "latitude", "nav_lat"), ("lon", "longitude", "nav_lon")
_STEP = 100.0  # m, of differences of a projection, which pyproj inverts to 1 mm


class Plane(NamedTuple):
    """Places of the nodes of a grid in the plane about an origin.

    Attributes:
        x, y: Places along the axes of the grid, in the order of the file, m.
        origin: Latitude and longitude of the origin, deg.
        turn: Matrix from a place in the plane to one along the axes of the grid, shape (2, 2).
        geographic: Function from x and y to latitude and longitude, deg.
        projected: True if the axes of the grid are not longitude and latitude.
    """

    x: Array
    y: Array
    origin: tuple[float, float]
    turn: Array
    geographic: Callable[[Any, Any], tuple[Any, Any]]
    projected: bool = False

    def axes(self, x: Any, y: Any) -> Array:
        """Return the directions of the axes at places, as columns (east, north), shape (..., 2, 2)."""
        columns = []
        for dx, dy in ((_STEP, 0.0), (0.0, _STEP)):
            lat, lon = self.geographic(x - dx, y - dy)
            further = self.geographic(x + dx, y + dy)
            east = ((further[1] - lon + 180.0) % 360.0 - 180.0) * np.cos(np.radians(0.5 * (lat + further[0])))
            column = np.stack([east, further[0] - lat], axis=-1)
            columns.append(column / np.linalg.norm(column, axis=-1, keepdims=True))
        return np.stack(columns, axis=-1)


def plane_of(
    data: xr.Dataset, part: xr.DataArray, origin: tuple[float, float] | None
) -> tuple[xr.DataArray, xr.DataArray, Plane]:
    """Return the coordinates of a variable along x and y, and its plane; without an origin, that about its middle.

    Raises:
        InputError: The grid is not rectangular in degrees, or in a projection that pyproj knows.
    """
    lats, lons = _find_places(part, "latitude", _LATITUDES), _find_places(part, "longitude", _LONGITUDES)
    y, x = lats[0] if lats else None, lons[0] if lons else None
    if x is not None and y is not None and x.ndim == y.ndim == 1:
        if x.dims == y.dims:
            raise InputError(
                f"lies at places in a list ({x.dims[0]}), not on a grid; expected one: interpolate it first"
            )
        lat, lon = _degrees(y), _degrees(x)
        if np.abs(lon).max() > 720.0:
            raise InputError(f"{x.name} has values from {lon.min():g} to {lon.max():g}; expected at most 720 degrees")
        if np.abs(lat).max() > 90.0:
            raise InputError(f"{y.name} has values from {lat.min():g} to {lat.max():g}; expected at most 90 degrees")
        lat0, lon0 = origin or (float(np.mean(lat)), float(lon[len(lon) // 2]))
        per_degree = math.radians(1.0) * EARTH
        per_longitude = per_degree * math.cos(math.radians(lat0))
        across, along = to_plane(lat, lon, (lat0, lon0))
        steps = np.abs(np.diff(across))
        if len(steps) > 2 and steps.max() > math.pi * EARTH * math.cos(math.radians(lat0)):
            # Longitudes end half a turn from the origin, and begin again: without a gap, which would have no flow.
            turned = np.sort(lon % 360.0)
            gaps = np.append(np.diff(turned), turned[0] + 360.0 - turned[-1])
            if gaps.max() > 1.5 * np.sort(gaps)[-2]:
                raise InputError(
                    f"{x.name} extends further than half a turn from longitude {lon0:g}; expected an origin in its "
                    "middle"
                )
        plane = Plane(
            across,
            along,
            (lat0, lon0),
            np.eye(2),
            lambda x, y: (lat0 + y / per_degree, lon0 + x / per_longitude),
        )
        return x, y, plane
    axes = [part[c] for role in ("X", "Y") for c in [c for c in coordinates_of(part, role) if part[c].ndim == 1][:1]]
    if len(axes) == 2 and 1 not in (getattr(x, "ndim", 0), getattr(y, "ndim", 0)):
        dims = (*axes[1].dims, *axes[0].dims)
        places = [a.transpose(*dims) if a is not None and set(a.dims) == set(dims) else None for a in (y, x)]
        reasons = []
        for crs in _projections(data, part, axes[0]):
            unit = "degree" if crs.is_geographic else "m"
            try:
                across, along = (factor(a.attrs.get("units"), unit) * a.values.astype(np.float64) for a in axes)
                return axes[0], axes[1], _project(crs, across, along, (places[0], places[1]), origin)
            except (InputError, ProjError) as error:
                reasons.append(" ".join(str(error).split()))
        if reasons or x is None or y is None:
            why = "".join(f"; {reason}" for reason in dict.fromkeys(reasons))
            raise InputError(
                f"its axes {axes[0].name} and {axes[1].name} ({text_of(axes[0], 'units') or 'no unit'}) are not "
                f"degrees; expected these, or a grid_mapping that pyproj reads{why}"
            )
    # One of them is not along an axis.
    axis, kind = (y, "latitude") if x is not None and x.ndim == 1 else (x, "longitude")
    if axis is not None and axis.ndim > 1:
        raise InputError(
            f"the grid is curvilinear ({axis.name} has {axis.ndim} dimensions); expected one along longitude and "
            "latitude: interpolate it first, for example with cdo remapbil"
        )
    raise InputError(f"has no {kind} along an axis; expected one in degrees")


def _find_places(part: xr.DataArray, role: str, names: tuple[str, ...]) -> list[xr.DataArray]:
    """Return the longitudes or latitudes of a variable, those along one axis first."""
    found = [part[name] for name in coordinates_of(part, role)]
    bare = [c for c in part.coords if str(c).lower() in names and not text_of(part[c], "standard_name")]
    return sorted([*found, *(part[c] for c in bare if c not in [f.name for f in found])], key=lambda c: abs(c.ndim - 1))


def _degrees(axis: xr.DataArray) -> Array:
    """Return angles in degrees; those without units are in degrees.

    Raises:
        InputError: They are in something else, or missing.
    """
    with in_field(str(axis.name)):
        to_degrees = factor(axis.attrs["units"], "degree") if "units" in axis.attrs else 1.0
        if axis.dtype.kind not in "fiu" or not np.isfinite(axis.values).all():
            raise InputError("has missing values; expected a number everywhere")
    values = axis.values.astype(np.float64)
    return values if to_degrees == 1.0 else to_degrees * values


def _project(
    crs: CRS,
    across: Array,
    along: Array,
    places: tuple[xr.DataArray | None, xr.DataArray | None],
    origin: tuple[float, float] | None,
) -> Plane:
    """Return the plane of a projected grid: with its axes, but with the scale that holds about the origin.

    Args:
        crs: Projection.
        across, along: Places along the axes, m, or degrees of a rotated pole.
        places: Latitude and longitude of the nodes, which must agree; None where the file has none along both axes.
        origin: Latitude and longitude of the origin; None for the middle of the grid.

    Raises:
        InputError: The projection does not agree, or the origin lies outside.
    """
    to_places = Transformer.from_crs(crs, crs.source_crs, always_xy=True)
    step = _STEP / EARTH if crs.is_geographic else _STEP
    size = 1.0 if crs.is_geographic else crs.axis_info[0].unit_conversion_factor

    def places_of(x: Any, y: Any) -> tuple[Any, Any]:
        lon, lat = to_places.transform(np.asarray(x) / size, np.asarray(y) / size)
        return np.asarray(lat), np.asarray(lon)

    lat0, lon0 = origin or map(float, places_of(across[len(across) // 2], along[len(along) // 2]))
    x0, y0 = (size * value for value in to_places.transform(lon0, lat0, direction=TransformDirection.INVERSE))
    scales = []
    for dx, dy in ((step, 0.0), (0.0, step)):
        ends = to_plane(*places_of(np.array([x0 - dx, x0 + dx]), np.array([y0 - dy, y0 + dy])), (lat0, lon0))
        scales.append(float(np.hypot(*np.diff(ends, axis=1))[0]) / (2.0 * step))
    sx, sy = scales
    if not 0.0 < sx * sy < math.inf:
        raise InputError(f"origin: ({lat0:g}, {lon0:g}) lies outside the projection of the file")
    corners = np.ix_([0, -1], [0, -1])
    if places[0] is not None and places[1] is not None:
        lat, lon = (place.values[corners] for place in places if place is not None)
        there = places_of(*np.meshgrid(across[[0, -1]], along[[0, -1]]))
        off = np.hypot(((there[1] - lon + 180.0) % 360.0 - 180.0) * np.cos(np.radians(lat)), there[0] - lat)
        worst = math.radians(float(off.max())) * EARTH
        if not worst < 0.1 * sx * float(np.abs(np.diff(across)).min()):
            raise InputError(f"it misses {places[0].name} and {places[1].name} by {worst:.3g} m")
    plane = Plane(
        sx * (across - x0),
        sy * (along - y0),
        (lat0, lon0),
        np.eye(2),
        lambda x, y: places_of(np.asarray(x) / sx + x0, np.asarray(y) / sy + y0),
        projected=True,
    )
    axes = plane.axes(np.zeros(()), np.zeros(()))
    return (
        plane
        if np.abs(axes - np.eye(2)).max() < 1e-7
        else plane._replace(turn=np.asarray(np.linalg.inv(axes), np.float64))
    )


def _projections(data: xr.Dataset, part: xr.DataArray, x: xr.DataArray) -> Iterator[CRS]:
    """Yield the projections of a variable, from its CF attributes and from a PROJ string if there is one."""
    for name in text_of(part, "grid_mapping").replace(":", " ").split():
        attrs = data.variables[name].attrs if name in data.variables and name != x.name else {}
        ways: list[tuple[Callable[[Any], CRS], Any]] = [(CRS.from_cf, attrs)]
        ways += [(CRS.from_proj4, attrs[key]) for key in ("proj4", "proj4_string", "proj4text") if key in attrs]
        for read, given in ways if attrs else []:
            try:
                crs = read(given)
            except (CRSError, KeyError, TypeError, ValueError):  # attributes are missing, or no numbers
                continue
            if crs.is_projected or crs.is_bound or crs.is_derived:
                yield crs
