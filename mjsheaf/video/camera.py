"""A camera path that keeps the whole team in the picture and moves slowly. Pure numpy.

The camera looks in one direction throughout, and only its place changes. In the camera's own axes (x to the
right, y up, z forward) and for an eye at e, a point is inside the right-hand side of the picture if

    x - e_x <= right (z - e_z),    that is    e_x - right e_z >= x - right z,

and the other three sides are alike: each requires a linear function of the eye to exceed a constant. The
constants are four *bounds* per frame, each the maximum over all points. Smoothing the bounds from above (a
moving maximum, then a moving average over the same window) smooths the eye, and no point leaves the picture.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d, maximum_filter1d

from mjsheaf.arrays import Array

# Fraction of the picture's half-width or half-height that the team may fill at the left, right, bottom and top.
FILL = (0.88, 0.88, 0.86, 0.84)
SMOOTHING = 2.5  # half the window over which the camera's motion is smoothed, in s of video


@dataclass(frozen=True)
class View:
    """Camera of one frame, in MuJoCo's terms.

    Attributes:
        lookat: the point that it looks at. Shape (3,), in m.
        distance: Distance from the eye to that point, m.
        azimuth: direction of view about z, from x, in degrees.
        elevation: angle above the horizon, in degrees; negative looks down.
        fovy: vertical angle of view, in degrees.
    """

    lookat: Array
    distance: float
    azimuth: float
    elevation: float
    fovy: float

    def metres_per_pixel(self, height: int) -> float:
        """Return the size of a pixel at `lookat`, in m, for a frame of the given height in pixels."""
        return 2 * self.distance * float(np.tan(np.radians(self.fovy) / 2)) / height

    def project(self, points: Array, width: int, height: int) -> tuple[Array, Array]:
        """Find the pixels at which points appear.

        Args:
            points: Shape (n, 3), in m.
            width, height: Size of the frame, pixels.

        Returns:
            Columns and rows from the top left corner, shape (n, 2), in pixels; and depths along the view,
            shape (n,), in m. A point with a negative depth is behind the camera and its pixels mean nothing.
        """
        x, y, ahead = axes(self.azimuth, self.elevation) @ (points - self.lookat).T
        depth = ahead + self.distance
        focal = 0.5 * height / np.tan(np.radians(self.fovy) / 2)
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        return np.stack([width / 2 + focal * x / safe, height / 2 - focal * y / safe], axis=1), depth


def axes(azimuth: float, elevation: float) -> Array:
    """Return the camera's axes in the world: rows right, up, forward. Angles in degrees. Shape (3, 3)."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array(
        [
            [np.sin(a), -np.cos(a), 0.0],
            [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)],
            [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)],
        ]
    )


def camera_path(
    points: Iterable[Array],
    *,
    azimuth: float,
    elevation: float,
    fovy: float,
    aspect: float,
    radius: float,
    window: int,
    distance: float | None = None,
    fill: tuple[float, float, float, float] = FILL,
) -> list[View]:
    """Follow the team, and return the camera at each frame.

    Args:
        points: what must stay in the picture at consecutive frames, a few frames at a time: each of shape (f, n, 3),
            in m, and finite.
        azimuth, elevation, fovy: see `View`.
        aspect: width of the picture over its height.
        radius: Radius of the ball about each point that must be in the picture, m; positive.
        window: frames on either side over which motion is smoothed.
        distance: Distance from the eye to the centre of the team, m; None computes it from the points.
        fill: Fraction of the half-width or half-height to fill at the left, right, bottom and top.
    """
    rotation = axes(azimuth, elevation)
    # Slopes of the sides and bounds on the eye: left, right, bottom, top.
    slopes = np.tan(np.radians(fovy) / 2) * np.array([aspect, aspect, 1.0, 1.0]) * fill
    bounds = np.concatenate([_bounds(block, rotation, slopes) for block in points])
    # A ball touches a side's plane if its centre is a radius away from it, measured at right angles.
    bounds[:, :4] += radius * np.sqrt(1 + slopes**2)
    # The largest bound nearby is smoothed: such a curve is nowhere below the bounds, or the ones just before.
    largest = maximum_filter1d(bounds[:, :4], 2 * window + 3, axis=0, mode="nearest")
    left, right, bottom, top = (_smooth(bound, window) for bound in largest.T)
    middle = _smooth((bounds[:, 4] - bounds[:, 5]) / 2, window)

    # e_z: as far back as the tighter of the two pairs of sides requires; the other pair shares its room equally.
    forward = -np.maximum((left + right) / (slopes[0] + slopes[1]), (bottom + top) / (slopes[2] + slopes[3]))
    if distance is not None:
        forward = middle - distance
    eye_right = (right - left + (slopes[1] - slopes[0]) * forward) / 2
    eye_up = (top - bottom + (slopes[3] - slopes[2]) * forward) / 2
    # The point looked at does not change the picture, but its distance sets the scale of lines and balls.
    range_ = np.maximum(middle - forward, radius)
    lookat = np.stack([eye_right, eye_up, forward + range_], axis=1) @ rotation
    return [View(*each, azimuth, elevation, fovy) for each in zip(lookat, range_.tolist(), strict=True)]


def _bounds(points: Array, rotation: Array, slopes: Array) -> Array:
    """Return what the four sides ask of the eye, the largest depth, and minus the smallest. Shape (f, 6)."""
    x, y, z = np.moveaxis(points @ rotation.T, -1, 0)
    left, right, bottom, top = slopes
    asked = (-x - left * z, x - right * z, -y - bottom * z, y - top * z, z, -z)
    return np.stack([values.max(axis=1) for values in asked], axis=1)


def _smooth(values: Array, window: int) -> Array:
    """Average over `window` values on either side, weighted by a Hann window. Shape (F,)."""
    weights = np.hanning(2 * window + 3)[1:-1]
    return convolve1d(values, weights / weights.sum(), mode="nearest")
