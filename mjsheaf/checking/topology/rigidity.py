"""Rigidity of a team at a shape.

The rank is that of the linearised coboundary of communication edges; where these do not fit together, in a team without
targets, that of the law's Jacobian, as stress holds a shape too. A rigid team has the rank of all motions except
those that edges of these kinds can never measure: translations, rotations and scaling, as far as the edges leave them
free. The required rank is n d - d (d + 1) / 2 for ranges alone, n d - d - 1 for bearings, and n d - d for positions.
"""

import itertools

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.checking.topology.bracing import Bracing, plan_bracing
from mjsheaf.section import Finite, Record
from mjsheaf.sheaf import RANK_TOLERANCE
from mjsheaf.sheaf.nonlinear import SOLVED_RANK_TOLERANCE
from mjsheaf.team import Team

MAX_STATES = 600
"""Largest number of the agents' coordinates for which a rank is computed."""

_UNSEEN = 1e-9  # of a rigid motion: what edges measure of it is rounding


class Rigidity(Record):
    """Rigidity of the linearised team at q*; everything about range and bearing edges is local."""

    rank: int | None = Field(
        description="rank of the communication edges' Jacobian, or of the law's in a formation whose edges do not fit; "
        "null in a large team"
    )
    needed: int | None = Field(description="rank with which they hold the shape; null in a large team")
    rigid: bool | None = Field(description="whether they hold it to first order; null in a large team")
    localizable: bool | None = Field(
        description="whether targets and anchors hold every agent's place to first order; null without any"
    )
    rate: Finite = Field(
        description="k1 times the smallest real part above zero of an eigenvalue of H, 1/s; null where there is none"
    )
    bracing: Bracing | None = Field(
        None,
        description="flexes and the edges that hold them, of a team without targets that is not rigid; else null, and "
        "in a large team",
    )


def rigidity_of(team: Team, original: Team, positions: Array, gain: float, values: Array) -> Rigidity:
    """Decide the rigidity of a team of linear edges.

    Args:
        team: The present agents; linearised at the shape.
        original: The team that was linearised.
        positions: Stacked positions of the agents there, m.
        gain: k1, 1/s.
        values: Eigenvalues of H that are not zero; of a large undirected team some of the smallest.
    """
    unique = team.dirichlet.unique if team.symmetric else len(values) == int(team.first_state[-1])
    localizable = None if team.free else bool(unique)
    rate = gain * float(values.real.min()) if len(values) else None
    n = int(team.first_state[-1])
    if n > MAX_STATES:
        return Rigidity(rank=None, needed=None, rigid=None, localizable=localizable, rate=rate)
    held_by_stress = team.free and team.stressed
    D = team.law_problem.H.toarray() if held_by_stress else _coboundary(team, n)
    tolerance = SOLVED_RANK_TOLERANCE if team.linearised_at is not None else RANK_TOLERANCE
    rank = int(np.linalg.matrix_rank(D, rtol=tolerance)) if len(D) else 0
    unseen = _basis(_unseen(D, _motions(team, positions), tolerance))  # one agent has no turn and no scale
    needed = n - unseen.shape[1]
    rigid = rank >= needed
    bracing = (
        None if rigid or held_by_stress or not team.free else plan_bracing(team, original, positions, unseen, D, gain)
    )
    return Rigidity(rank=rank, needed=needed, rigid=rigid, localizable=localizable, rate=rate, bracing=bracing)


def _coboundary(team: Team, n: int) -> Array:
    """Return the coboundary of the communication edges, rows scaled to length 1, shape (m, n)."""
    D = team.sheaf.coboundary()[: sum(len(edge.F_tail) for edge in team.communication), :n].toarray()
    length = np.linalg.norm(D, axis=1, keepdims=True)
    return np.asarray(D / np.where(length > 0.0, length, 1.0))


def _motions(team: Team, positions: Array) -> Array:
    """Return translations, rotations about the centroid, and the scale of a shape, shape (n, count)."""
    x = team.unpack(positions)
    x = x - x.mean(axis=0)
    axes = max(agent.dimension for agent in team.agents)
    size = float(np.abs(x).max()) or 1.0
    motions = [np.broadcast_to(np.eye(3)[a], x.shape) for a in range(axes)]
    for a, b in itertools.combinations(range(axes), 2):
        turn = np.zeros((3, 3))
        turn[a, b] = 1.0
        turn[b, a] = -1.0
        motions.append(x @ turn / size)
    motions.append(x / size)
    flat = np.array([motion.reshape(-1) for motion in motions])
    return np.asarray(flat[:, team.slots[: len(positions)]].T)


def _unseen(D: Array, motions: Array, tolerance: float) -> Array:
    """Return independent combinations of motions (n, count) that edges do not measure, shape (n, unseen)."""
    _, singular, combinations = np.linalg.svd(D @ motions)
    seen = int(np.count_nonzero(singular > max(_UNSEEN, tolerance) * np.sqrt(len(D))))
    return np.asarray(motions @ combinations[seen:].T)


def _basis(motions: Array) -> Array:
    """Return an orthonormal basis of motions (n, count), some of which may be zero, shape (n, rank)."""
    directions, singular, _ = np.linalg.svd(motions, full_matrices=False)
    return np.asarray(directions[:, singular > _UNSEEN * max(singular.max(initial=0.0), 1e-300)])
