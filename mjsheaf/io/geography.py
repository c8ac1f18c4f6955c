"""The plane about an origin in which longitude and latitude become x and y.

It is equirectangular, an affine map, so that cells of a grid stay rectangles:

    x = R cos(lat_0) (lon - lon_0),   y = R (lat - lat_0),   R = 6,371,000 m.
"""

import math

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError

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
