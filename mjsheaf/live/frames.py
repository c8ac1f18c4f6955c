"""Frames: the newest sample of a run in progress, in the arrays of its page."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.arrays import Array
from mjsheaf.checking.theorem.targets import follow_targets
from mjsheaf.page.replay import Packer, Scene, add_samples, edges_of, origin_of, positions_of
from mjsheaf.results.dataset import join
from mjsheaf.system import Phase, System

_MOST = 1000  # points of an outlook


class Row(Packer):
    """Packer that keeps one sample as 32-bit floats.

    Attributes:
        values: Values by name, flat.
    """

    def __init__(self) -> None:
        """Start empty."""
        super().__init__()
        self.values: dict[str, NDArray[np.float32]] = {}

    def add_fixed(self, name: str, values: Array, step: float) -> Array:
        """Keep values; `step` is not used."""
        self.add_float(name, values)
        return values

    def add_float(self, name: str, values: Array) -> None:
        """Keep values."""
        with np.errstate(over="ignore"):
            self.values[name] = np.asarray(values, "<f4").ravel()


def outlook(system: System) -> Array:
    """Return points that the run is expected to reach, in space, shape (K, 3), m.

    They are the targets' path without disturbance, and the harmonic extension of it. Where the path is not known, they
    are those of the start.
    """
    path = follow_targets(system.remaining)
    some = slice(None, None, 1 + path.positions[..., 0].size // _MOST)
    points = path.positions[some].copy()
    points[:, : len(system.team.agents)] = system.team.unpack(path.q_star[some])
    points[:, system.planar, 2] += system.bodies.surface_height
    points = points.reshape(-1, 3)
    return np.asarray(points[np.isfinite(points).all(axis=1)])


class Frames:
    """Frames that extend a page."""

    def __init__(self, phases: Sequence[Phase], dataset: xr.Dataset, surface_height: float, ahead: Array) -> None:
        """Take the arrays of a page.

        Args:
            phases: Phases of the run when the page was made.
            dataset: The page's samples.
            surface_height: z of the surface, m.
            ahead: Points that vehicles are expected to reach; see `outlook`.
        """
        self._surface = surface_height
        self._origin = origin_of(dataset)
        self._edges = list(edges_of(phases))
        self._scene = Scene.of(ahead - self._origin)
        self._last = dataset.isel(time=[-1])
        self._attitude: NDArray[np.float32] | None = None

    def frame(self, chunk: xr.Dataset, phases: Sequence[Phase], sample: int) -> bytes:
        """Return the last sample of a chunk: its time as a 64-bit float, then all arrays as 32-bit floats.

        Args:
            chunk: Consecutive samples, which follow those of the previous frame.
            phases: Phases of the run.
            sample: Number of the last sample in the run.
        """
        own = chunk.isel(time=[-1])
        both = join([self._last, own])  # headings along a path need two samples
        self._last = own
        positions = positions_of(own, self._surface) - self._origin
        row = Row()
        add_samples(row, both, own, positions, phases, np.array([sample], dtype=np.int64), self._scene, self._origin)
        self._keep_edges(row, phases)
        self._keep_sign(row)
        time = own["time"].values.astype("<f8")
        return b"".join([time.tobytes(), *(values.tobytes() for values in row.values.values())])

    def _keep_edges(self, row: Row, phases: Sequence[Phase]) -> None:
        """Put residuals in the page's order; NaN for edges that no phase has any more."""
        column = {key: k for k, key in enumerate(edges_of(phases))}
        residual = row.values["residual"]
        known = [residual[column[key]] if key in column else np.nan for key in self._edges]
        row.values["residual"] = np.array(known, "<f4")

    def _keep_sign(self, row: Row) -> None:
        """Choose the sign of each attitude that is nearer to the one in the previous frame."""
        attitude = row.values["quaternion"].reshape(-1, 4)
        if self._attitude is not None:
            attitude[(attitude * self._attitude).sum(axis=1) < 0.0] *= -1.0
        self._attitude = attitude
