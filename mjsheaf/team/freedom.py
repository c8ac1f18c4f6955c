"""What a non-trivial relative cohomology means for the team: who is free to drift, and along what."""

from collections.abc import Sequence

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
_SEARCHED = 40  # distinct agents, and pivots times agents, up to which exchanges of pivots are tried
_EXCHANGES = 60


# -- a sparse basis --------------------------------------------------------------------------------------------


def sparse_basis(basis: Array, owner: Index | None = None) -> Array:
    """A basis of the same space in which few agents move, and along axes where that is possible.

    Independent parts come apart, and each vector of a reduced echelon form has a support that contains no smaller one.
    Where a part is small, pivots are exchanged as long as fewer agents, or else fewer coordinates, move.

    Args:
        basis: columns, shape (n, r), of full column rank.
        owner: number of the agent that each row belongs to, ascending, shape (n,); each its own unless given.

    Returns:
        Array of shape (n, r), its columns in the order of the first row that moves; each has largest entry 1, and
        entries below 1e-7 are zero.
    """
    n, r = basis.shape
    owner = np.arange(n) if owner is None else owner
    at = np.nonzero(np.abs(basis) > _NOTHING * np.abs(basis).max(axis=0, initial=0.0))
    clean = sparse.csr_array((basis[at], at), shape=(n, r))
    bipartite = sparse.block_array([[None, clean], [clean.T, None]]) if r else sparse.csr_array((n, n))
    _, label = csgraph.connected_components(bipartite, directed=False)
    vectors = np.zeros((r, n))
    done = 0
    by_row, by_column = (np.argsort(x, kind="stable") for x in (label[:n], label[n:]))
    for part in np.unique(label[n:]):
        rows = by_row[slice(*np.searchsorted(label[:n][by_row], [part, part + 1]))]
        columns = by_column[slice(*np.searchsorted(label[n:][by_column], [part, part + 1]))]
        block = clean[rows][:, columns].toarray()
        pivots = _exchanged(_pivots(block, owner[rows]), block, owner[rows])
        vectors[done : done + len(columns), rows] = _echelon(block, pivots).T
        done += len(columns)
    first = np.argmax(vectors != 0.0, axis=1)
    return vectors[np.argsort(first, kind="stable")].T


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
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    _, kind, count = np.unique(np.round(vectors, 6), axis=0, return_inverse=True, return_counts=True)
    candidates = [int(np.flatnonzero(kind == k)[0]) for k in range(len(count))]
    if len(candidates) * block.shape[1] > _SEARCHED:
        return pivots

    def cost(v: Array) -> tuple[int, int]:
        moves = v != 0.0
        return int(np.logical_or.reduceat(moves, starts).sum()), int(moves.sum())

    best = cost(vectors)
    for _ in range(_EXCHANGES):
        options = []
        for row in candidates:
            for k in np.flatnonzero(np.abs(vectors[row]) >= _CONDITION):
                if np.count_nonzero(vectors[row]) > 1:
                    other = pivots.copy()
                    other[k] = row
                    options.append((cost(_echelon(block, other)), len(options), other))
        if not options or min(options)[0] >= best:
            break
        best, _, pivots = min(options)
        vectors = _echelon(block, pivots)
    return pivots


# -- in words --------------------------------------------------------------------------------------------------


def free_directions(team: Team) -> list[str]:
    """Say, one line for each basis vector of H^0(G, G_p; F), which agents are free along what."""
    return [describe(team, vector) for vector in free_basis(team).T]


def free_basis(team: Team) -> Array:
    """The sparse basis of H^0(G, G_p; F), shape (n, dimension), rows in the order of the stacked q."""
    basis = team.dirichlet.null_basis
    return sparse_basis(basis, team.slots[: len(basis)] // 3)


def describe(team: Team, vector: Array) -> str:
    """Say who is free along what.

    Args:
        team: the team.
        vector: a motion of the agents that costs nothing, shape (n,).
    """
    agents, motion = _movers(team, vector)
    return _say(team, agents, motion, "free")


def describe_nearly(team: Team, vector: Array) -> str:
    """Say who is nearly free along what: the agents that move at least half as far as the one that moves most.

    Args:
        team: the team.
        vector: a motion of the agents that costs little, shape (n,).
    """
    agents, motion = _movers(team, vector)
    size = np.linalg.norm(motion, axis=1)
    much = size >= 0.5 * size.max()
    agents, motion = agents[much], motion[much] / size[much, None]
    motion[np.abs(motion) < 0.2] = 0.0
    return _say(team, agents, _rounded_directions(motion), "nearly free")


def _movers(team: Team, vector: Array) -> tuple[Index, Array]:
    """Numbers of the agents that move, and their motions, shape (k, 3)."""
    motion = team.unpack(vector)
    agents = np.flatnonzero(np.any(motion != 0.0, axis=1))
    return agents, motion[agents]


def _rounded_directions(motion: Array) -> Array:
    """Let motions within about 20 degrees of one another be one motion."""
    result = motion / np.linalg.norm(motion, axis=1)[:, None]
    left = np.ones(len(result), dtype=bool)
    while left.any():
        alike = left & (result @ result[np.flatnonzero(left)[0]] > 0.94)
        mean = result[alike].mean(axis=0)
        result[alike] = mean / np.linalg.norm(mean)
        left &= ~alike
    return result


def _say(team: Team, agents: Index, motion: Array, free: str) -> str:
    _, first, kind = np.unique(np.round(motion / _SAME), axis=0, return_index=True, return_inverse=True)
    if len(first) == 1:
        direction = _direction(motion[0], team, agents)
        names = [team.agents[a].id for a in agents]
        if len(names) == 1:
            return f"{names[0]} is {free} along {direction}"
        if direction[-1] in _AXES:
            return f"{_listed(names)} are {free} along {direction} together"
        drift = "can drift" if free == "free" else f"are {free} to drift"
        return f"{_enumerated(names)} {drift} together along {direction}"
    furthest = float(np.linalg.norm(motion, axis=1).max())
    clauses = []
    for k in np.argsort(first, kind="stable")[:_NAMED]:
        group = agents[kind == k]
        far = float(np.linalg.norm(motion[first[k]])) / furthest
        share = "" if far > 1.0 - _SAME else f" ({far:.2g} as far)"
        names = [team.agents[a].id for a in group]
        clauses.append(f"{_enumerated(names)} along {_direction(motion[first[k]], team, group)}{share}")
    more = ", ..." if len(first) > _NAMED else ""
    return f"{', '.join(clauses)}{more}, {'moving' if free == 'free' else f'{free} to move'} together"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")


def _enumerated(names: Sequence[str]) -> str:
    if len(names) > _NAMED or len(names) == 1:
        return _listed(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _direction(d: Array, team: Team, agents: Index) -> str:
    """An axis by name, or a unit vector in the coordinates that the agents have."""
    axes = np.flatnonzero(d)
    if len(axes) == 1:
        return ("-" if d[axes[0]] < 0 else "") + _AXES[axes[0]]
    unit = d[: max(team.agents[a].dimension for a in agents)] / np.linalg.norm(d)
    return "(" + ", ".join(f"{x:.2g}" for x in np.where(np.abs(unit) < 0.005, 0.0, unit)) + ")"
