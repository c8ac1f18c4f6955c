"""q* of teams with nonlinear or directed edges, and of teams without targets and anchors.

q* is a stationary point: D^T c = 0 at the agents (see `mjsheaf.sheaf.nonlinear`). Along a path it continues from sample
to sample, whatever the pieces in which it is computed (see `Path`). At the first sample it is searched for from the
present positions; if no exact shape is found there, also from the places of the formations, and the one with the
smaller residual is q*. Where motions are free, as in a team without targets and anchors, each sample begins at its
present positions and free motions stay as they are there: the centroid of a team and, of bearings, its size, as in the
law.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.sheaf.nonlinear import FREE_MOTION, Settled, StationarySolver
from mjsheaf.team.edges import GROUND

if TYPE_CHECKING:
    from mjsheaf.team.team import Team

_EXACT = 1e-7  # of the team's size: residual of an exact shape
_DENSE = 600  # states up to which free directions are counted


@dataclass
class Path:
    """q* along a run, up to the last of the samples computed so far.

    Attributes:
        last: q* there, shape (n_q,), m; None before the first.
        held: Targets there, shape (n_p,), m.
        moving: True if motions have been free at every sample.
    """

    last: Array | None = None
    held: Array | None = None
    moving: bool = True


class Shapes:
    """Solver of q* of a team without absent agents."""

    def __init__(self, team: "Team") -> None:
        self._team = team

    @cached_property
    def solver(self) -> StationarySolver:
        """Solver with targets and ground held."""
        return self._team.nonlinear_sheaf.solver([*self._team.target_ids, GROUND])

    def extend(self, p: Array, q: Array, path: Path) -> Array:
        """Return q* (..., n_q) of targets at p (..., n_p), near agents at q (..., n_q), m; it continues the path."""
        boundary = p.reshape(-1, p.shape[-1]) if p.shape[-1] else np.zeros((int(np.prod(p.shape[:-1])), 0))
        start = q.reshape(-1, q.shape[-1])
        found = np.full_like(start, np.nan)
        for k, (held, near) in enumerate(zip(boundary, start, strict=True)):
            if np.isfinite(held).all() and np.isfinite(near).all():
                if path.last is None or path.moving:
                    path.last = self.first(held, near).x
                    path.moving = path.moving and self.has_free_motions(path.last, held)
                elif path.held is None or not np.array_equal(held, path.held):
                    path.last = self.solver.settle(path.last, held).x
                found[k] = path.last
            path.held = held
        return found.reshape(q.shape)

    def first(self, held: Array, near: Array) -> Settled:
        """Return q* of targets at `held` (n_p,) from the present positions `near` (n_q,), or from places."""
        found = self.solver.settle(near, held, free=True)
        exact = _EXACT * (1.0 + np.abs(self.solver.relative(near, held)).max(initial=0.0))
        if found.converged and found.residual <= exact:
            return found
        others = (self.solver.settle(x, held, free=True) for x in self._places(held, near))
        return min([found, *others], key=lambda each: (not each.converged, each.residual))

    def has_free_motions(self, q: Array, p: Array) -> bool:
        """Return True if some motion of the agents at q changes no measurement to first order."""
        if self._team.free or len(q) > _DENSE:
            return self._team.free
        values = np.linalg.svd(self.solver.H(q, p).toarray(), compute_uv=False)
        return bool(values[-1] <= FREE_MOTION * values[0])

    def _places(self, held: Array, near: Array) -> list[Array]:
        """Return where formations place the agents about where they are; none if an agent is in no formation."""
        team = self._team
        placed = {member for formation in team.formations for member in formation.members}
        if not placed.issuperset(team.agent_ids):
            return []
        places = np.zeros((len(team.agents), 3))
        for i, agent in enumerate(team.agents):
            places[i, : agent.dimension] = team.displacement[agent.id]
        present = team.unpack(near)
        fitted = _scaled if any(edge.measures == "bearing" for edge in team.communication) else _turned
        for formation in team.formations:
            rows = [team.index[member] for member in formation.members]
            if formation.about is not None:
                about = team.unpack(np.concatenate([near, held]))[team.index[formation.about]]
                places[rows] += about
            else:
                centre = present[rows].mean(axis=0)
                places[rows] = centre + fitted(places[rows] - places[rows].mean(axis=0), present[rows] - centre)
        return [team.pack(np.concatenate([places, np.zeros((len(team.targets), 3))]))[: len(near)]]


def _scaled(places: Array, present: Array) -> Array:
    """Return centred places (N, 3) in the size of centred positions (N, 3); bearings fix how they are turned."""
    return places * (np.linalg.norm(present) / np.linalg.norm(places))


def _turned(places: Array, present: Array) -> Array:
    """Return centred places (N, 3), turned without reflection to lie near centred positions (N, 3)."""
    axes = 3 if places[:, 2].any() or present[:, 2].any() else 2
    u, _, v = np.linalg.svd(places[:, :axes].T @ present[:, :axes])
    signs = np.append(np.ones(axes - 1), np.sign(np.linalg.det(u @ v)) or 1.0)
    turned = np.zeros_like(places)
    turned[:, :axes] = places[:, :axes] @ (u * signs) @ v
    return turned
