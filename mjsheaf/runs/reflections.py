"""Formations that end in another equilibrium of their edges: a mirror image, a line, or a point reflection.

Range edges do not distinguish a shape from its mirror image, and a team that starts on a line stays on it. Bearing
edges have one more equilibrium, the shape reflected in a point, which is unstable.
"""

from collections.abc import Iterator, Set
from typing import TYPE_CHECKING

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.team import Team

if TYPE_CHECKING:
    import xarray as xr

_FLAT = 1e-3  # extent, as a fraction of the longest one, below which a shape is a line or a plane
_ALIKE = 0.05  # maximum misfit of equal shapes, as a fraction of their size
_UNLIKE = 0.2  # minimum misfit of different shapes, as a fraction of their size


def describe_reflections(team: Team, dataset: "xr.Dataset") -> Iterator[str]:
    """Yield a sentence about each formation that ends in an equilibrium other than its desired shape."""
    if team.linear:
        return
    end = np.nan_to_num(dataset["agent_position"][-1].values)
    for formation in team.formations:
        members = [member for member in formation.members if member not in team.absent]
        kinds = {edge.measures for edge in team.formation_edges(formation)}
        if len(members) < 3 or kinds <= {"position"}:
            continue
        found = _fault(end[[team.index[m] for m in members]], _places(team, members), kinds)
        if found:
            yield f"formation {formation.name} ends {found}"


def _places(team: Team, members: list[str]) -> Array:
    """Return the desired positions of members about their centroid, padded, shape (n, 3), m."""
    places = np.zeros((len(members), 3))
    for row, member in zip(places, members, strict=True):
        row[: len(team.displacement[member])] = team.displacement[member]
    return np.asarray(places - places.mean(axis=0))


def _fault(x: Array, places: Array, kinds: Set[str]) -> str:
    """Describe how a shape x (n, 3) differs from the desired one `places` (n, 3); empty if it does not."""
    x = x - x.mean(axis=0)
    size, wanted = np.linalg.norm(x), np.linalg.norm(places)
    if not (size > 0.0 and wanted > 0.0):
        return ""
    extent = np.linalg.svd(x, compute_uv=False)
    if extent[1] <= _FLAT * extent[0] and np.linalg.matrix_rank(places, rtol=_FLAT) > 1:
        return "on a line, where range edges keep it: start its members off a line"
    if kinds == {"bearing"}:
        across = np.linalg.norm(x / size + places / wanted)
        return "reflected in a point, an unstable equilibrium of bearing edges" if across <= _ALIKE else ""
    if "bearing" not in kinds and _misfit(x, places, 1.0) > _UNLIKE and _misfit(x, places, -1.0) <= _ALIKE:
        return "as the mirror image of its shape, which has the same distances"
    return ""


def _misfit(x: Array, places: Array, handedness: float) -> float:
    """Compute the misfit of a shape, relative to its size, after the best rotation (1) or reflection (-1) of places."""
    axes = int(np.linalg.matrix_rank(places, rtol=_FLAT))
    if axes < 2 or np.linalg.matrix_rank(x, rtol=_FLAT) > axes:
        return np.inf
    axes = 3 if axes == 3 else 2
    u, s, v = np.linalg.svd(places[:, :axes].T @ x[:, :axes])
    s[-1] *= handedness * np.sign(np.linalg.det(u @ v))
    square = (x**2).sum() + (places**2).sum() - 2.0 * s.sum()
    return float(np.sqrt(max(square, 0.0)) / np.linalg.norm(places))
