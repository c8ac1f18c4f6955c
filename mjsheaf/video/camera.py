"""A camera path that keeps the whole team in the picture and moves slowly. Pure numpy.

The camera looks in one direction throughout, and only its place changes. In the camera's own axes (x to the
right, y up, z forward) and for an eye at e, a point is left of the picture's right-hand side when

    x - e_x <= right (z - e_z),    that is    e_x - right e_z >= x - right z,

and the other three sides are alike: each asks that something linear in the eye exceed something known. The
known parts are four *bounds* per sample, the largest over all points. Smoothing the bounds from above (a
moving maximum, then a moving average over the same window) smooths the eye, and no point leaves the picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d, maximum_filter1d

from mjsheaf.video.series import FloatArray, Series, blocks

# How much of the picture's half-width or half-height the team may fill: at the left, right, bottom and top.
# There is more room at the top, as the title stands there.
FILL = (0.88, 0.88, 0.86, 0.74)
SMOOTHING = 2.5  # half the window over which the camera's motion is smoothed, in s of video
MOST_KEYS = 6000  # times at which the camera's place is found: up to three minutes of video, every frame


@dataclass(frozen=True)
class View:
    """Where the camera is for one frame, in MuJoCo's terms.

    Attributes:
        lookat: the point that it looks at. Shape (3,), in m.
        distance: from the eye to that point, in m.
        azimuth: direction of view about z, from x, in degrees.
        elevation: angle above the horizon, in degrees; negative looks down.
        fovy: vertical angle of view, in degrees.
    """

    lookat: FloatArray
    distance: float
    azimuth: float
    elevation: float
    fovy: float

    def metres_per_pixel(self, height: int) -> float:
        """Return the size of a pixel at the point looked at, in m, for a frame so many pixels high."""
        return 2 * self.distance * float(np.tan(np.radians(self.fovy) / 2)) / height

    def project(self, points: FloatArray, width: int, height: int) -> tuple[FloatArray, FloatArray]:
        """Find the pixels at which points appear.

        Args:
            points: Shape (n, 3), in m.
            width: of the frame, in pixels.
            height: of the frame, in pixels.

        Returns:
            Columns and rows from the top left corner, shape (n, 2), in pixels; and depths along the view,
            shape (n,), in m. A point with a negative depth is behind the camera and its pixels mean nothing.
        """
        x, y, ahead = axes(self.azimuth, self.elevation) @ (points - self.lookat).T
        depth = ahead + self.distance
        focal = 0.5 * height / np.tan(np.radians(self.fovy) / 2)
        safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
        return np.stack([width / 2 + focal * x / safe, height / 2 - focal * y / safe], axis=1), depth


def axes(azimuth: float, elevation: float) -> FloatArray:
    """Return the camera's axes in the world: rows right, up, forward. Angles in degrees. Shape (3, 3)."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array(
        [
            [np.sin(a), -np.cos(a), 0.0],
            [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)],
            [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)],
        ]
    )


@dataclass(frozen=True)
class CameraPath:
    """The camera over a film of F frames, known at K <= F keys, evenly spaced from the first frame to the last.

    Attributes:
        frames: F.
        lookat: Shape (K, 3), in m.
        distance: Shape (K,), in m.
        azimuth: direction of view about z, in degrees.
        elevation: angle above the horizon, in degrees.
        fovy: vertical angle of view, in degrees.
    """

    frames: int
    lookat: FloatArray
    distance: FloatArray
    azimuth: float
    elevation: float
    fovy: float

    def view(self, frame: int) -> View:
        """Return the camera at one frame."""
        keys = len(self.distance)
        place = frame if keys == self.frames else frame * (keys - 1) / (self.frames - 1)
        key = min(int(place), max(keys - 2, 0))
        after, share = min(key + 1, keys - 1), place - key
        lookat = (1 - share) * self.lookat[key] + share * self.lookat[after]
        distance = (1 - share) * self.distance[key] + share * self.distance[after]
        return View(lookat, float(distance), self.azimuth, self.elevation, self.fovy)


def camera_path(
    time: FloatArray,
    points: Sequence[Series],
    frames: FloatArray,
    *,
    azimuth: float,
    elevation: float,
    fovy: float,
    aspect: float,
    radius: float,
    window: int,
    distance: float | None = None,
) -> CameraPath:
    """Follow the team.

    Args:
        time: of the samples, increasing. Shape (T,), in s.
        points: what must stay in the picture; each of shape (T, n, 3), in m, and finite.
        frames: times of the frames. Shape (F,), in s.
        azimuth: direction of view about z, in degrees.
        elevation: angle above the horizon, in degrees.
        fovy: vertical angle of view, in degrees.
        aspect: width of the picture over its height.
        radius: of the ball about each point that must be in the picture, in m; positive.
        window: frames on either side over which motion is smoothed.
        distance: from the eye to the middle of the team, in m, if it is not to be found from the points.
    """
    rotation = axes(azimuth, elevation)
    # Slopes of the sides and bounds on the eye: left, right, bottom, top.
    slopes = np.tan(np.radians(fovy) / 2) * np.array([aspect, aspect, 1.0, 1.0]) * FILL
    keys = frames if len(frames) <= MOST_KEYS else np.linspace(frames[0], frames[-1], MOST_KEYS)
    window = max(1, round(window * len(keys) / len(frames))) if window else 0
    bounds, depth = _bounds(time, points, keys, rotation, slopes, radius)
    left, right, bottom, top = (_smooth_above(bound, window) for bound in bounds.T)
    middle = _smooth(depth, window)

    # e_z: as far back as the tighter of the two pairs of sides asks; the other pair has room, shared equally.
    forward = -np.maximum((left + right) / (slopes[0] + slopes[1]), (bottom + top) / (slopes[2] + slopes[3]))
    if distance is not None:
        forward = middle - distance
    eye = np.stack(
        [
            (right - left + (slopes[1] - slopes[0]) * forward) / 2,
            (top - bottom + (slopes[3] - slopes[2]) * forward) / 2,
            forward,
        ],
        axis=1,
    )
    # The point looked at decides nothing in the picture, but its distance is the scale of all that is drawn.
    range_ = np.maximum(middle - forward, radius)
    lookat = (eye + np.stack([np.zeros_like(range_), np.zeros_like(range_), range_], axis=1)) @ rotation
    return CameraPath(len(frames), lookat, range_, azimuth, elevation, fovy)


def _bounds(
    time: FloatArray,
    points: Sequence[Series],
    keys: FloatArray,
    rotation: FloatArray,
    slopes: FloatArray,
    radius: float,
) -> tuple[FloatArray, FloatArray]:
    """Return what the sides ask of the eye, shape (K, 4), and the depth of the team's middle, shape (K,).

    At a key it is the most that is asked at any time between the key before and the key after, so that a camera that
    moves straight from key to key keeps everything in the picture.
    """
    bounds, depth = np.full((len(keys), 4), -np.inf), np.zeros(len(keys))
    signs = np.array([-1.0, 1.0, -1.0, 1.0])
    last: FloatArray | None = None
    for start, block in blocks(points[0]):
        stop = start + len(block)
        x, y, z = np.moveaxis(np.concatenate([block, *(p[start:stop] for p in points[1:])], axis=1) @ rotation.T, -1, 0)
        asked = [(signs[side] * across - slopes[side] * z).max(axis=1) for side, across in enumerate((x, x, y, y))]
        here = np.column_stack([time[start:stop], *asked, (z.min(axis=1) + z.max(axis=1)) / 2])
        if last is not None:  # the stretch between two blocks belongs to the second
            here = np.concatenate([last, here])
        instants = here[:, 0]
        after = np.searchsorted(keys, instants, side="left")
        before = np.searchsorted(keys, instants, side="right") - 1
        for near in (before, after):
            np.maximum.at(bounds, np.clip(near, 0, len(keys) - 1), here[:, 1:5])
        # Between two samples a key asks for what lies between.
        inside = np.flatnonzero((keys >= instants[0]) & ((keys <= instants[-1]) | (stop == len(time))))
        for side in range(4):
            at_key = np.interp(keys[inside], instants, here[:, 1 + side])
            bounds[inside, side] = np.maximum(bounds[inside, side], at_key)
        depth[inside] = np.interp(keys[inside], instants, here[:, 5])
        last = here[-1:]
    # A ball touches a side's plane when its centre is a radius away from it, measured at right angles.
    return bounds + radius * np.sqrt(1 + slopes**2), depth


def _smooth_above(values: FloatArray, window: int) -> FloatArray:
    """Return a smooth curve that is nowhere below the values. Shape (F,)."""
    return _smooth(maximum_filter1d(values, 2 * window + 1, mode="nearest"), window)


def _smooth(values: FloatArray, window: int) -> FloatArray:
    """Average over `window` values on either side, weighted by a Hann window. Shape (F,)."""
    weights = np.hanning(2 * window + 3)[1:-1]
    return convolve1d(values, weights / weights.sum(), mode="nearest")
