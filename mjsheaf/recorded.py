"""Poses of all bodies, read from a run's data block by block as they are drawn."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.results.netcdf import length_of_piece
from mjsheaf.video.series import KEPT, Blocks

Array = NDArray[np.float64]

_HEADING = 0.5  # s over which headings of bodies without attitude are smoothed


class Block(NamedTuple):
    """Consecutive samples of V vehicles, the first N of them agents.

    positions (n, V, 3) m; quaternions (n, V, 4); harmonic_extension (n, N, 3) m; error (n,) m.
    """

    positions: Array
    quaternions: Array
    harmonic_extension: Array
    error: Array


class Recorded:
    """A run's data as a film has them.

    Ideal kinematics have neither height in the plane nor attitude: vehicles lie on the surface and face where they go.

    Attributes:
        time: of all samples, shape (T,), s.
    """

    def __init__(self, dataset: xr.Dataset, surface_height: float) -> None:
        """Say where the data are.

        Args:
            dataset: of a run, in memory or opened.
            surface_height: z of what lies on the surface, m.
        """
        self._dataset, self._surface = dataset, surface_height
        self._physics = dataset.attrs["backend"] == "physics"
        self.time: Array = dataset["time"].values
        self._length = length_of_piece(dataset)
        self._block = lru_cache(KEPT)(self._read)

    def series(self, name: str) -> Blocks:
        """One field of `Block` over all samples."""
        sample = getattr(self._block(0), name)
        shape = (len(self.time), *sample.shape[1:])
        return Blocks(shape, self._length, lambda number: getattr(self._block(number), name))

    def _read(self, number: int) -> Block:
        first, end = number * self._length, min((number + 1) * self._length, len(self.time))
        window = max(1, min(len(self.time), round(_HEADING / self._period()))) if len(self.time) > 1 else 1
        # Headings come from the velocity, smoothed: they need what is before and after.
        margin = 0 if self._physics else window + 1
        begin, stop = max(first - margin, 0), min(end + margin, len(self.time))
        data = self._dataset.isel(time=slice(begin, stop))
        positions = np.concatenate([data["agent_position"].values, data["target_position"].values], axis=1)
        if self._physics:
            heights = [data["agent_height"].values, data["target_height"].values]
            positions[..., 2] = np.concatenate(heights, axis=1)
            both = [data["agent_orientation"].values, data["target_orientation"].values]
            quaternions = np.concatenate(both, axis=1)
        else:
            positions[..., 2] = np.where(np.isnan(positions[..., 2]), self._surface, positions[..., 2])
            quaternions = _facing_forward(self.time[begin:stop], positions, window)
        own = slice(first - begin, end - begin)
        q_star = data["harmonic_extension"].values[own].copy()
        positions = positions[own]
        q_star[..., 2] = np.where(np.isnan(q_star[..., 2]), positions[:, : q_star.shape[1], 2], q_star[..., 2])
        return Block(positions, quaternions[own], q_star, data["disagreement"].values[own].mean(axis=1))

    def _period(self) -> float:
        return float(self.time[1] - self.time[0])


def _facing_forward(time: Array, positions: Array, window: int) -> Array:
    """Level attitudes whose heading follows the horizontal velocity, smoothed over so many samples."""
    quaternions = np.zeros((*positions.shape[:2], 4))
    quaternions[..., 0] = 1.0
    if len(time) < 3:
        return quaternions
    velocity = np.gradient(positions[..., :2], time, axis=0)
    speed = np.linalg.norm(velocity, axis=2, keepdims=True)
    direction = velocity / np.maximum(speed, 1e-9)  # the first seconds are fast: each instant has an equal say
    kernel = np.ones(min(window, len(time))) / window
    for v in range(positions.shape[1]):
        smooth = np.column_stack([np.convolve(direction[:, v, i], kernel, mode="same") for i in range(2)])
        heading = np.arctan2(smooth[:, 1], smooth[:, 0])
        quaternions[:, v, 0], quaternions[:, v, 3] = np.cos(heading / 2), np.sin(heading / 2)
    return quaternions
