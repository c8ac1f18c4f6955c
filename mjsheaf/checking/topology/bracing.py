"""Flexes of a formation that is not rigid, and the smallest set of edges that holds them.

A flex is a motion of the agents that changes the shape and that no communication edge measures to first order. Motions
that edges of the team's kinds can never measure may be added to it. Each flex is described with a frame at rest: as
many coordinates are fixed as there are such motions, first those of one agent, then those of its neighbours.

Candidates are edges between any two agents, of every kind that the team's communication edges have. A candidate with
rows C holds the row space of C T in the flexes T, shape (n, r). The search is greedy: it adds the candidate that holds
most further flexes, and of those the one that holds its weakest flex best. With m the largest rank of a candidate, no
set of fewer than r / m edges holds R^r, so a set of that size, rounded up, is a smallest one. Range edges and planar
bearing edges have rank 1. Each one taken holds one flex more, and a set of r edges is found wherever there is one.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy import sparse
from scipy.sparse import csgraph

from mjsheaf.arrays import Array, IntArray
from mjsheaf.section import Finite, Record
from mjsheaf.sheaf.nonlinear import FREE_MOTION, SOLVED_RANK_TOLERANCE, Measure, NonlinearEdge, linear_maps
from mjsheaf.team import Team
from mjsheaf.team.edges import LinearEdge
from mjsheaf.team.null_modes import describe, null_mode_of, sparsified

MAX_STATES = 200
"""Largest number of the agents' coordinates for which edges are searched."""

_PIVOT = 1e-6  # length of a row of orthonormal motions below which its coordinate fixes none of them
_SHOWN = 3  # flexes in a sentence


class Brace(Record):
    """A communication edge to add."""

    between: list[str] = Field(description="ids of its ends")
    measures: Measure
    map: Literal["shared", "space"]

    def describe(self) -> str:
        """Return the edge as a scenario has it."""
        fields = [f"between: [{', '.join(self.between)}]"]
        if self.measures != "position":
            fields.append(f"measures: {self.measures}")
        if self.map != "shared":
            fields.append(f"map: {self.map}")
        return f"{{{', '.join(fields)}}}"


class Bracing(Record):
    """Flexes of a formation, and the smallest set of edges with which it is rigid."""

    flexes: list[str] = Field(description="independent motions that change the shape and that no edge measures")
    edges: list[Brace] = Field(
        description="edges that hold all flexes; empty where no edges of the team's kinds do, as on a line"
    )
    exact: bool = Field(description="true if no smaller set of such edges exists; else none of them is redundant")
    rate: Finite = Field(description="slowest decay of the continuous law near the shape with these edges, 1/s")

    def describe(self) -> str:
        """Return the flexes and the edges in one sentence."""
        sentence = "; ".join(self.flexes[:_SHOWN])
        if len(self.flexes) > _SHOWN:
            sentence += f"; and {len(self.flexes) - _SHOWN} more"
        added = f"add communication {', '.join(edge.describe() for edge in self.edges)}"
        return (
            f"{sentence}; {added if self.edges else 'no edges of these kinds hold that to first order at this shape'}"
        )


class _Candidates(NamedTuple):
    """Edges that could be added.

    Attributes:
        edges: The edges.
        rows: Their rows sqrt(K) F of the linearised coboundary, filled up with zero rows, shape (C, 3, n).
    """

    edges: list[Brace]
    rows: Array


def plan_bracing(team: Team, original: Team, positions: Array, motions: Array, D: Array, gain: float) -> Bracing | None:
    """Find flexes and the edges that hold them; None of a rigid team, and of one that is too large.

    Args:
        team: The team, linearised at the shape.
        original: The team that was linearised.
        positions: Stacked positions of the agents at the shape, shape (n,), m.
        motions: Motions that edges of the team's kinds never measure, orthonormal, shape (n, t).
        D: Coboundary of the communication edges, rows of length 1, shape (m, n).
        gain: k1, 1/s.
    """
    if len(positions) > MAX_STATES:
        return None
    flexes = _flexes(D, motions)
    if not flexes.shape[1]:
        return None
    candidates = _list_candidates(original, positions)
    chosen, exact = _choose(candidates.rows, flexes)
    rate = None
    if chosen:
        added = candidates.rows[chosen].reshape(-1, len(positions))
        H = team.dirichlet.H.toarray()
        values = np.linalg.eigvalsh((H + H.T) / 2.0 + added.T @ added)
        rate = gain * float(values[motions.shape[1]])
    return Bracing(
        flexes=_describe_flexes(team, flexes, motions),
        edges=[candidates.edges[k] for k in chosen],
        exact=exact,
        rate=rate if team.symmetric else None,
    )


def _flexes(D: Array, motions: Array) -> Array:
    """Return an orthonormal basis of the motions that D does not measure, across the given ones, shape (n, r)."""
    _, singular, directions = np.linalg.svd(D)
    rank = int(np.count_nonzero(singular > SOLVED_RANK_TOLERANCE * max(singular.max(initial=0.0), 1e-300)))
    free = directions[rank:].T
    return np.asarray(free @ np.linalg.svd(free.T @ motions)[0][:, motions.shape[1] :])


def _describe_flexes(team: Team, flexes: Array, motions: Array) -> list[str]:
    """Describe the flexes with a frame at rest."""
    owner = team.slots[: len(flexes)] // 3
    order = _breadth_first(team)
    fixed = _frame(motions, owner, order)
    relative = flexes - motions @ np.linalg.solve(motions[fixed], flexes[fixed])
    relative[np.abs(relative) <= SOLVED_RANK_TOLERANCE * np.abs(relative).max()] = 0.0
    basis = sparsified(sparse.csr_array(relative), owner)
    first = team.agents[order[0]].id
    ends = itertools.pairwise(basis.indptr.tolist())
    modes = [null_mode_of(team, basis.data[a:b], basis.indices[a:b]) for a, b in ends]
    return [f"{describe(team, mode)}, relative to {first}" for mode in modes]


def _breadth_first(team: Team) -> list[int]:
    """Return the numbers of the agents, from the one with most edges on to its neighbours and theirs."""
    N = len(team.agents)
    ends = [(team.index[e.tail], team.index[e.head]) for e in team.communication]
    tails, heads = np.array(ends, dtype=np.int64).reshape(-1, 2).T
    graph = sparse.coo_array((np.ones(len(ends)), (tails, heads)), shape=(N, N)).tocsr()
    degree = np.bincount(np.concatenate([tails, heads]), minlength=N)
    reached = csgraph.breadth_first_order(graph, int(degree.argmax()), False, False).tolist()
    return [*reached, *np.setdiff1d(np.arange(N), reached).tolist()]


def _frame(motions: Array, owner: IntArray, order: Sequence[int]) -> list[int]:
    """Choose coordinates whose rest leaves none of the motions, shape (n, t), agents in the given order."""
    left = motions.copy()
    fixed = list[int]()
    for agent in order:
        rows = np.flatnonzero(owner == agent)
        for _ in rows:
            length = np.linalg.norm(left[rows], axis=1)
            if length.max() <= _PIVOT:
                break
            row = int(rows[length.argmax()])
            along = left[row] / length.max()
            left -= np.outer(left @ along, along)
            fixed.append(row)
    return fixed


def _list_candidates(team: Team, positions: Array) -> _Candidates:
    """List the edges between any two agents of a team, of the kinds that its communication edges have."""
    kinds = sorted({edge.measures for edge in team.communication}) or ["position"]
    map_name: Literal["shared", "space"] = "space" if any(e.lift is not None for e in team.communication) else "shared"
    first = team.first_state.tolist()
    present = np.flatnonzero(team.present).tolist()
    edges = []
    rows = []
    for (i, j), kind in itertools.product(itertools.combinations(present, 2), kinds):
        tail, head = team.agents[i], team.agents[j]
        edge = LinearEdge(between=[tail.id, head.id], map=map_name, measures=kind).build(tail, head)
        m = len(edge.F_tail)
        lift = np.zeros(m) if edge.lift is None else edge.lift
        z = edge.F_head @ positions[first[j] : first[j + 1]] - edge.F_tail @ positions[first[i] : first[i + 1]] + lift
        curved = NonlinearEdge(
            edge.tail, edge.head, edge.F_tail, edge.F_head, kind, np.zeros(m), edge.weight, lift, False
        )
        maps = linear_maps(curved, z)
        scale = math.sqrt(maps.weight[0, 0])
        block = np.zeros((3, len(positions)))
        block[: len(maps.F_tail), first[i] : first[i + 1]] = scale * maps.F_tail
        block[: len(maps.F_head), first[j] : first[j + 1]] = -scale * maps.F_head
        edges.append(Brace(between=[tail.id, head.id], measures=kind, map=map_name))
        rows.append(block)
    return _Candidates(edges, np.array(rows).reshape(-1, 3, len(positions)))


def _choose(rows: Array, flexes: Array) -> tuple[list[int], bool]:
    """Choose candidates that hold all flexes, the fewest that are found, and return True if no fewer do.

    Args:
        rows: Rows of the candidates, shape (C, 3, n).
        flexes: Orthonormal basis, shape (n, r).
    """
    r = flexes.shape[1]
    length = np.linalg.norm(rows, axis=(1, 2), keepdims=True)
    held = rows / np.where(length > 0.0, length, 1.0) @ flexes
    left = held.copy()
    chosen = list[int]()
    largest = 0
    found = 0
    while found < r:
        values = np.linalg.eigvalsh(left @ left.swapaxes(1, 2))
        rank = np.count_nonzero(values > FREE_MOTION, axis=1)
        if not rank.max(initial=0):
            return [], False
        largest = largest or int(rank.max())
        weakest = np.where(values > FREE_MOTION, values, np.inf).min(axis=1)
        k = int(np.lexsort((-weakest.round(9), -rank))[0])
        chosen.append(k)
        directions = np.linalg.svd(left[k], full_matrices=False)[2][: rank[k]]
        left -= left @ directions.T @ directions
        found += int(rank[k])
    for k in tuple(chosen):
        others = [other for other in chosen if other != k]
        if others and np.linalg.matrix_rank(held[others].reshape(-1, r), tol=math.sqrt(FREE_MOTION)) == r:
            chosen = others
    return chosen, len(chosen) == math.ceil(r / largest)
