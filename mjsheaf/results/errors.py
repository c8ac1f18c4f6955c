"""Error norms of a run, sample by sample: how far the team is from where theory wants it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjsheaf.team import Formation, Team

Array = NDArray[np.float64]

_ROUNDING = 1e-12  # share of the largest displacement below which a mean displacement is zero


@dataclass(frozen=True)
class Errors:
    """Errors of a run of T samples, in m.

    Attributes:
        harmonic_extension: q*, padded with NaN, shape (T, N, 3).
        disagreement: eta as padded vectors with NaN, shape (T, N, 3).
        tracking: |q*_i - q_i|, shape (T, N).
        formation: residual norm |F_i x_i - F_j x_j - b_e| of each edge inside a formation, for each group, (T, edges).
        centering: distance of each group's centroid from where its formation wants it, for each group, (T,): from
            its target's projection plus the mean of the members' wanted displacements. NaN where the group is about no
            target.
    """

    harmonic_extension: Array
    disagreement: Array
    tracking: Array
    formation: dict[str, Array]
    centering: dict[str, Array]

    def formation_rms(self, group: str | None = None) -> Array:
        """Root mean square over the edges of a group, or of all groups, shape (T,); NaN where there is no edge."""
        residuals = self.formation.values() if group is None else [self.formation[group]]
        r = np.concatenate([np.zeros((len(self.tracking), 0)), *residuals], axis=1)
        if r.shape[1] == 0:
            return np.full(len(r), np.nan)
        return np.sqrt((r**2).mean(axis=1))

    def largest_centering(self) -> Array:
        """Largest centering error over the groups that are about a target, shape (T,); NaN where there is none."""
        distances = [d for d in self.centering.values() if not np.isnan(d).all()]
        return np.max(distances, axis=0) if distances else np.full(len(self.tracking), np.nan)


def evaluate_errors(team: Team, positions: Array) -> Errors:
    """Compute all errors from positions (T, V, 3)."""
    x = team.pack(positions)
    problem = team.dirichlet
    n_q = problem.H.shape[0]
    q, p = x[:, :n_q], x[:, n_q:]
    eta = team.disagreement(x)
    q_star = problem.extend(p)
    return Errors(
        harmonic_extension=team.unpack(q_star, np.nan),
        disagreement=team.unpack(eta, np.nan),
        tracking=np.linalg.norm(team.unpack(q_star - q), axis=2),
        formation={f.name: _residuals(team, f, positions) for f in team.formations},
        centering={f.name: _centering(team, f, positions) for f in team.formations},
    )


def _residuals(team: Team, formation: Formation, positions: Array) -> Array:
    number = {m.id: v for v, m in enumerate(team.members)}
    columns = []
    for e in team.formation_edges(formation):
        tail = positions[:, number[e.tail], : e.F_tail.shape[1]] @ e.F_tail.T
        head = positions[:, number[e.head], : e.F_head.shape[1]] @ e.F_head.T
        columns.append(np.linalg.norm(tail - head - e.b, axis=1))
    return np.column_stack(columns) if columns else np.zeros((len(positions), 0))


def _centering(team: Team, formation: Formation, positions: Array) -> Array:
    """Distance of the centroid from the target's projection plus the mean wanted displacement, shape (T,), m.

    Only the coordinates that all members and the target have in common count. An explicit `offset` of an edge changes
    what the law does, not where the formation wants its members.
    """
    if formation.about is None:
        return np.full(len(positions), np.nan)
    number = {m.id: v for v, m in enumerate(team.members)}
    members = [number[m] for m in formation.members]
    target = number[formation.about]
    shared = min(team.members[v].dimension for v in [*members, target])
    wanted = np.array([o[:shared] for o in formation.displacements])
    mean = wanted.mean(axis=0)
    mean[np.abs(mean) <= _ROUNDING * np.abs(wanted).max()] = 0.0  # a polygon's corners cancel up to rounding only
    centroid = positions[:, members, :shared].mean(axis=1)
    return np.linalg.norm(centroid - positions[:, target, :shared] - mean, axis=1)
