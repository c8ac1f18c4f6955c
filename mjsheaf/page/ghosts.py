"""Other runs on a page: their agents are drawn translucent next to those of the run that the page replays.

The counterpart in the browser is web/src/ghosts.js.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from mjsheaf.arrays import Array
from mjsheaf.results.metrics import mean_known
from mjsheaf.show.played import RecordedRun

if TYPE_CHECKING:
    from mjsheaf.page.replay import Packer, Scene

_QUATERNION_STEP = 2.0**-13


@dataclass(frozen=True)
class Ghost:
    """A run that is drawn translucent.

    Attributes:
        name: Name of the run.
        colour: Colour of its agents and curves, #rrggbb.
        dataset: Its data, in memory or opened.
        surface_height: z of the surface on which planar vehicles lie where they have no height, m.
    """

    name: str
    colour: str
    dataset: xr.Dataset
    surface_height: float


def add_ghosts(
    packer: "Packer", ghosts: Sequence[Ghost], dataset: xr.Dataset, time: Array, scene: "Scene", origin: Array
) -> list[dict[str, Any]]:
    """Pack where the agents of other runs are at the samples of a page, and their RMS tracking errors.

    Agents are matched by id. A run has no agents before its start and after its end, nor while they are absent.

    Args:
        packer: Gets the arrays ghost0, ghost_quaternion0 and ghost_error0, and so on.
        ghosts: The other runs.
        dataset: Run that the page replays.
        time: Samples that the page keeps, shape (K,), s.
        scene: Where the page's run takes place.
        origin: Origin of the page's places, shape (3,), m.

    Returns:
        Name and colour of each, for the page.
    """
    for k, ghost in enumerate(ghosts):
        places, attitudes = _agents_of(ghost, dataset, time)
        packer.add_fixed(f"ghost{k}", scene.confined(places - origin), scene.tolerance / 4.0)
        packer.add_fixed(f"ghost_quaternion{k}", attitudes, _QUATERNION_STEP)
        packer.add_float(f"ghost_error{k}", _error_of(ghost, time)[:, None])
    return [{"name": ghost.name, "colour": ghost.colour} for ghost in ghosts]


def _agents_of(ghost: Ghost, dataset: xr.Dataset, time: Array) -> tuple[Array, Array]:
    """Positions and attitudes of a ghost's agents in the rows of the page's vehicles, (K, V, 3) m and (K, V, 4).

    Positions are NaN where the ghost has no such agent.
    """
    own = ghost.dataset["time"].values
    inside = (time >= own[0] - 1e-9) & (time <= own[-1] + 1e-9)
    samples = RecordedRun(ghost.dataset, ghost.surface_height).at(np.clip(time, own[0], own[-1]))
    present = _present(ghost.dataset, own, time) & inside[:, None]
    number = {str(name): i for i, name in enumerate(ghost.dataset["agent"].values)}
    vehicles = dataset.sizes["agent"] + dataset.sizes["target"]
    places = np.full((len(time), vehicles, 3), np.nan)
    attitudes = np.full((len(time), vehicles, 4), np.nan)
    for v, name in enumerate(map(str, dataset["agent"].values)):
        if name in number:
            i = number[name]
            places[:, v] = np.where(present[:, i, None], samples.positions[:, i], np.nan)
            attitudes[:, v] = samples.quaternions[:, i]
    return places, np.where(np.isfinite(attitudes), attitudes, [1.0, 0.0, 0.0, 0.0])


def _present(dataset: xr.Dataset, own: Array, time: Array) -> Array:
    """Mark the agents that are part of the team at times, shape (K, N)."""
    rows = np.searchsorted(own, time + 1e-9, side="right").clip(1, len(own)) - 1
    kept, place = np.unique(rows, return_inverse=True)
    return np.asarray(np.isfinite(dataset["tracking_error"].isel(time=kept).values)[place])


def _error_of(ghost: Ghost, time: Array) -> Array:
    """RMS tracking error over agents at times, shape (K,), m; NaN outside the ghost's run."""
    own = ghost.dataset["time"].values
    error = np.sqrt(mean_known(ghost.dataset["tracking_error"].values ** 2))
    return np.interp(time, own, error, left=np.nan, right=np.nan)
