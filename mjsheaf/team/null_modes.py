"""What a non-trivial relative cohomology means for the team: who is free to drift, and along what."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from mjsheaf.team.team import Team

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_AXES = "xyz"
_NAMED = 8  # agents named one by one before the rest are counted
_NOTHING = 1e-7  # of the largest entry: under this it is rounding, which a kernel near to small eigenvalues has more of
_SAME = 1e-6  # motions that differ by less are the same motion
_CONDITION = 0.1  # a pivot is taken within the same agent while it is at least this much of the best one
_SEARCHED = 40  # pivots times distinct rows up to which exchanges of pivots are tried
_EXCHANGES = 60
_SHARE = 0.5  # of the longest step, which an agent must move to be named where it is nearly free
_TILT = 0.2  # sine under which a step that is nearly along an axis is said to be along it
_ALIKE = 0.94  # cosine over which two steps are said to be one


@dataclass(frozen=True)
class NullMode:
    """How agents move together.

    Attributes:
        agents: numbers of the agents that move, ascending, shape (k,).
        steps: how each moves, padded with zeros, shape (k, 3).
    """

    agents: Index
    steps: Array


# -- a sparse basis --------------------------------------------------------------------------------------------


def sparsified(basis: sparse.csr_array, owner: Index) -> sparse.csc_array:
    """A basis of the same space in which few agents move, and along axes where that is possible.

    Independent parts come apart, and no vector's support contains that of another: they form a reduced echelon form.
    Where a part is small, its pivots are exchanged as long as fewer agents, or else fewer coordinates, move.

    Args:
        basis: columns, shape (n, r), of full column rank.
        owner: number of the agent that each row belongs to, ascending, shape (n,).

    Returns:
        Array of shape (n, r), its columns in the order of the first row that moves; each has largest entry 1, and
        entries below 1e-7 are zero.
    """
    n, r = basis.shape
    if r == 0:
        return sparse.csc_array((n, 0))
    clean = sparse.csr_array(basis, copy=True)
    clean.data[np.abs(clean.data) <= _NOTHING * np.abs(clean.data).max()] = 0.0
    clean.eliminate_zeros()
    _, label = csgraph.connected_components(sparse.block_array([[None, clean], [clean.T, None]]), directed=False)
    by_row, by_column = np.argsort(label[:n], kind="stable"), np.argsort(label[n:], kind="stable")
    parts = np.unique(label[n:])
    row_ends = [np.searchsorted(label[:n][by_row], parts, side).tolist() for side in ("left", "right")]
    column_ends = [np.searchsorted(label[n:][by_column], parts, side).tolist() for side in ("left", "right")]
    ordered = clean[by_row][:, by_column]
    rows, columns, values = list[Index](), list[Index](), list[Array]()
    for top, bottom, left, right in zip(*row_ends, *column_ends, strict=True):
        at = by_row[top:bottom]
        block = ordered[top:bottom, left:right].toarray()
        vectors = _echelon(block, _exchanged(_pivots(block, owner[at]), block, owner[at]))
        place, vector = np.nonzero(vectors)
        rows.append(at[place])
        columns.append(left + vector)
        values.append(vectors[place, vector])
    found = sparse.csc_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(n, r))
    found.sort_indices()
    return found[:, np.argsort(found.indices[found.indptr[:-1]], kind="stable")]


def _pivots(block: Array, owner: Index) -> Index:
    """Rows that determine all others, all of one agent where it has as many."""
    residual, pivots = block.copy(), list[int]()
    while len(pivots) < block.shape[1]:
        size = np.linalg.norm(residual, axis=1)
        last = owner == owner[pivots[-1]] if pivots else np.zeros(len(owner), dtype=bool)
        among = last if np.any(size[last] >= _CONDITION * size.max()) else np.ones(len(owner), dtype=bool)
        # The first of those that are about as good as the best: rounding does not choose.
        pivot = int(np.flatnonzero(among & (size >= 0.5 * size[among].max()))[0])
        pivots.append(pivot)
        along = residual[pivot] / size[pivot]
        residual -= np.outer(residual @ along, along)
    return np.array(pivots, dtype=np.int64)


def _echelon(block: Array, pivots: Index) -> Array:
    """The basis in which each pivot row is moved by one vector alone, scaled to largest entry 1."""
    vectors = np.linalg.solve(block[pivots].T, block.T).T
    vectors[np.abs(vectors) <= _NOTHING * np.abs(vectors).max()] = 0.0
    largest = np.argmax(np.abs(vectors) > (1.0 - _SAME) * np.abs(vectors).max(axis=0), axis=0)
    return vectors / vectors[largest, np.arange(vectors.shape[1])]


def _exchanged(pivots: Index, block: Array, owner: Index) -> Index:
    """Exchange one pivot after another while that leaves fewer agents, or else fewer coordinates, moving."""
    if block.shape[1] == 1:
        return pivots
    vectors = _echelon(block, pivots)
    _, candidates = np.unique(np.round(vectors, 6), axis=0, return_index=True)
    if len(candidates) * block.shape[1] > _SEARCHED:
        return pivots
    starts = np.flatnonzero(np.diff(owner, prepend=-1))

    def cost(v: Array) -> tuple[int, int]:
        moves = v != 0.0
        return int(np.logical_or.reduceat(moves, starts).sum()), int(moves.sum())

    best = cost(vectors)
    for _ in range(_EXCHANGES):
        options = []
        for row in candidates[np.count_nonzero(vectors[candidates], axis=1) > 1].tolist():
            for k in np.flatnonzero(np.abs(vectors[row]) >= _CONDITION).tolist():
                other = pivots.copy()
                other[k] = row
                options.append((cost(_echelon(block, other)), row, k))
        if not options or min(options)[0] >= best:
            break
        best, row, k = min(options)
        pivots[k] = row
        vectors = _echelon(block, pivots)
    return pivots


# -- in words --------------------------------------------------------------------------------------------------


def describe_null_modes(team: Team) -> list[str]:
    """Say, one line for each basis vector of H^0(G, G_p; F), which agents are free along what."""
    return [describe(team, motion) for motion in null_modes(team)]


def null_modes(team: Team) -> list[NullMode]:
    """A sparse basis of H^0(G, G_p; F), each vector with largest entry 1."""
    basis = null_mode_basis(team)
    spans = itertools.starmap(slice, itertools.pairwise(basis.indptr.tolist()))
    return [null_mode_of(team, basis.data[span], basis.indices[span]) for span in spans]


def null_mode_basis(team: Team) -> sparse.csc_array:
    """A sparse basis of H^0(G, G_p; F), shape (n, dimension), rows in the order of the stacked q."""
    basis = team.dirichlet.sparse_null_basis
    return sparsified(basis.tocsr(), team.slots[: basis.shape[0]] // 3)


def null_mode_of(team: Team, values: Array, rows: Index | None = None) -> NullMode:
    """A vector of the agents as a motion.

    Args:
        team: the team.
        values: entries of the vector, shape (k,).
        rows: their places in the stacked q, ascending; all of them unless given.
    """
    agent, axis = np.divmod(team.slots[: len(values)] if rows is None else team.slots[rows], 3)
    agents, place = np.unique(agent, return_inverse=True)
    steps = np.zeros((len(agents), 3))
    steps[place, axis] = values
    return NullMode(agents, steps)


def describe(team: Team, motion: NullMode) -> str:
    """Say who is free along what, of a motion that no edge or anchor notices."""
    return _say(team, motion, "free")


def describe_nearly(team: Team, motion: NullMode) -> str:
    """Say who is nearly free along what, of a motion that edges and anchors notice little.

    Only agents that move at least half as far as the one that moves furthest are named, and their directions are
    rounded.
    """
    far = np.linalg.norm(motion.steps, axis=1)
    much = far >= _SHARE * far.max()
    steps = motion.steps[much] / far[much, None]
    steps[np.abs(steps) < _TILT] = 0.0
    steps *= np.sign(steps[0, np.argmax(np.abs(steps[0]))])  # an eigenvector has no sign of its own
    return _say(team, NullMode(motion.agents[much], _in_few_directions(steps)), "nearly free")


def _in_few_directions(steps: Array) -> Array:
    """Unit steps, those that are close to one another made equal."""
    steps = steps / np.linalg.norm(steps, axis=1)[:, None]
    left = np.ones(len(steps), dtype=bool)
    while left.any():
        alike = left & (steps @ steps[np.argmax(left)] > _ALIKE)
        mean = steps[alike].mean(axis=0)
        steps[alike] = mean / np.linalg.norm(mean)
        left &= ~alike
    return steps


def _say(team: Team, motion: NullMode, free: str) -> str:
    _, first, kind = np.unique(np.round(motion.steps / _SAME), axis=0, return_index=True, return_inverse=True)
    names = [team.agents[a].id for a in motion.agents]
    if len(first) == 1:
        along = _direction(motion.steps[0], team, motion.agents)
        if len(names) == 1:
            return f"{names[0]} is {free} along {along}"
        if along[-1] in _AXES:
            return f"{_listed(names)} are {free} along {along} together"
        return f"{_listed(names, ' and ')} {'can' if free == 'free' else f'are {free} to'} drift together along {along}"
    furthest = float(np.linalg.norm(motion.steps, axis=1).max())
    clauses = []
    for k in np.argsort(first, kind="stable")[:_NAMED].tolist():
        group = np.flatnonzero(kind == k)
        step = motion.steps[first[k]]
        far = float(np.linalg.norm(step)) / furthest
        share = "" if far > 1.0 - _SAME else f" ({far:.2g} times as far)"
        who = _listed([names[i] for i in group], " and ")
        clauses.append(f"{who} along {_direction(step, team, motion.agents[group])}{share}")
    more = ", ..." if len(first) > _NAMED else ""
    return f"{', '.join(clauses)}{more}, {'' if free == 'free' else f'{free}, '}moving together"


def _listed(names: Sequence[str], last: str = ", ") -> str:
    if len(names) > _NAMED:
        return f"{', '.join(names[:_NAMED])} and {len(names) - _NAMED} more"
    return last.join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _direction(step: Array, team: Team, agents: Index) -> str:
    """An axis by name, or a unit vector in the coordinates that the agents have."""
    axes = np.flatnonzero(step)
    if len(axes) == 1:
        return ("-" if step[axes[0]] < 0 else "") + _AXES[axes[0]]
    unit = step[: max(team.agents[a].dimension for a in agents)] / np.linalg.norm(step)
    return "(" + ", ".join(f"{x:.2g}" for x in np.where(np.abs(unit) < 0.005, 0.0, unit)) + ")"
