"""Data made by others: netCDF by the CF conventions, units, and the plane about an origin.

Of CF: attributes that are text, packed values and missing data; xarray reads the files. Units are as CF and UDUNITS
write them: 'm s-1', 'm/s', 'knots', 'millibars'; pint reads them.

The plane in which longitude and latitude become x and y is equirectangular. It is an affine map, so that cells of a
grid stay rectangles:

    x = R cos(lat_0) (lon - lon_0),   y = R (lat - lat_0),   R = 6,371,000 m.
"""

import hashlib
import math
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, listed, shortened
from mjsheaf.files import open_regular

if TYPE_CHECKING:
    import xarray as xr

_SIGNATURE = b"\x89HDF"
_FILLS = {"f4": 9.969209968386869e36, "f8": 9.969209968386869e36, "i2": -32767, "u2": 65535, "i4": -2147483647}
_FILLS |= {"u4": 4294967295, "i8": -9223372036854775806, "u8": 18446744073709551614}
"""Values that netCDF writes where nothing was written; bytes have none."""
_WORDS = ("standard_name", "long_name", "axis", "positive", "coordinates", "grid_mapping", "bounds", "cell_methods")


@contextmanager
def open_netcdf(path: str, sha256: str | None = None) -> "Iterator[xr.Dataset]":
    """Open a netCDF file as it is, with attributes that are text where CF says so, and without warnings.

    Raises:
        InputError: It cannot be read, or its content is not the expected one.
    """
    import xarray as xr  # slow to import

    with open_regular(path) as file, warnings.catch_warnings():
        if sha256 is not None and hashlib.file_digest(file, "sha256").hexdigest() != sha256:
            raise InputError("has changed since it was read; expected the content of its sha256, or no such field")
        file.seek(0)
        warnings.simplefilter("ignore")
        try:
            _require_whole(file)
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


def _require_whole(file: BinaryIO) -> None:
    """Refuse a file of HDF5 that is cut or damaged at its beginning; others pass.

    h5netcdf refuses it too, but then prints an error to stderr when it forgets what it could not open.

    Raises:
        OSError: HDF5 cannot open it.
    """
    import h5py  # slow to import

    whole = file.read(len(_SIGNATURE)) != _SIGNATURE
    file.seek(0)
    if not whole:
        with h5py.File(file, "r") as data:
            data.attrs.get("_nc3_strict")
        file.seek(0)


def text_of(variable: Any, key: str) -> str:
    """Return an attribute of a variable as text; empty if there is none."""
    return str(variable.attrs.get(key, ""))


def coordinates_of(part: "xr.DataArray", *roles: str) -> list[str]:
    """Return the names of the coordinates of a variable that have one of these roles by cf-xarray."""
    import cf_xarray  # noqa: F401  # registers the accessor

    tables = {**part.cf.axes, **part.cf.coordinates}
    return list(dict.fromkeys(str(name) for role in roles for name in tables.get(role, ()) if name in part.coords))


def decoded(part: "xr.DataArray") -> "xr.DataArray":
    """Return a variable with its values unpacked, and NaN where they are missing or not valid.

    `valid_min`, `valid_max` and `valid_range` are about packed values, unless they have the type of unpacked ones.

    Raises:
        InputError: The values, or their limits, are no numbers.
    """
    import xarray as xr

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
    from cf_xarray.units import units  # slow to import

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
