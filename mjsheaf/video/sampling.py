"""From the samples of a run to what is drawn at one instant."""

from dataclasses import dataclass

import numpy as np

from mjsheaf.video.film import Film, VideoOptions
from mjsheaf.video.series import FloatArray, Series, rows


@dataclass(frozen=True)
class Moment:
    """A run at one instant.

    Attributes:
        time: in s.
        positions: Shape (V, 3), in m.
        quaternions: unit, w x y z. Shape (V, 4).
        harmonic_extension: Shape (N, 3), in m.
        error: in the film's error_unit; NaN where the run has none.
    """

    time: float
    positions: FloatArray
    quaternions: FloatArray
    harmonic_extension: FloatArray
    error: float


def frame_times(film: Film, options: VideoOptions) -> FloatArray:
    """Return the frames' times, from the first sample on, speed / fps apart. Shape (F,), F >= 1, in s."""
    # The small excess is for a duration that is a whole number of frames but for rounding.
    count = int(np.floor((film.time[-1] - film.time[0]) * options.fps / options.speed + 1e-6)) + 1
    return film.time[0] + np.arange(count) * (options.speed / options.fps)


def moment(film: Film, time: float) -> Moment:
    """Return the run at a time: linear between samples, and for attitudes linear and normalised."""
    quaternions = between(film, film.quaternions, np.array([time]), same_sign=True)[0]
    return Moment(
        time,
        between(film, film.positions, np.array([time]))[0],
        quaternions / np.maximum(np.linalg.norm(quaternions, axis=-1, keepdims=True), 1e-12),
        between(film, film.harmonic_extension, np.array([time]))[0],
        float(between(film, film.error, np.array([time]))[0]),
    )


def between(film: Film, values: Series, times: FloatArray, same_sign: bool = False) -> FloatArray:
    """Interpolate samples linearly; before the first and after the last, hold.

    Args:
        film: gives the times of the samples.
        values: Shape (T, ...).
        times: Shape (K,), in s.
        same_sign: for quaternions, of which q and -q are the same attitude: go the shorter way.

    Returns:
        Shape (K, ...).
    """
    after = np.clip(np.searchsorted(film.time, times, side="right"), 1, max(len(film.time) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(film.time) - 1)
    span = film.time[after] - film.time[before]
    weight = np.clip((times - film.time[before]) / np.where(span > 0, span, 1.0), 0.0, 1.0)
    weight = weight.reshape(-1, *[1] * (len(values.shape) - 1))
    first, second = rows(values, before), rows(values, after)
    if same_sign:
        second = np.where((first * second).sum(axis=-1, keepdims=True) < 0, -second, second)
    with np.errstate(invalid="ignore"):  # a run that blew up has infinite values
        return np.where(weight > 0, (1 - weight) * first + weight * second, first)
