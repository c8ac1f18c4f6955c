"""Null modes of a team, the directions of a non-trivial relative cohomology: who is free to drift, and along what."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from mjsheaf.arrays import Array, IntArray
from mjsheaf.sheaf.edges import assembled, parts
from mjsheaf.team.team import Team

_AXES = "xyz"
_MOST_NAMED = 8  # agents named one by one before the rest are counted
_ENTRY_ROUNDING = 1e-7  # of the largest entry; null spaces close to small eigenvalues have more rounding
_STEP_TOLERANCE = 1e-6  # steps that differ by less are equal
_LEAST_PIVOT = 0.1  # of the best pivot: one within the same agent is taken above it
_MOST_SEARCHED_PIVOTS = 40  # pivots times distinct rows up to which exchanges of pivots are tried
_MOST_EXCHANGES = 60
_NAMED_SHARE = 0.5  # of the longest step, which an agent must move to be named where it is nearly free
_LEAST_SINE = 0.2  # a step that is nearly along an axis counts as along it below this sine
_SAME_DIRECTION_COSINE = 0.94


@dataclass(frozen=True)
class NullMode:
    """Free motion of agents, which no edge measures.

    Attributes:
        agents: numbers of the agents that move, ascending, shape (k,).
        steps: how each moves, padded with zeros, shape (k, 3).
    """

    agents: IntArray
    steps: Array


def sparsified(basis: sparse.csr_array, owner: IntArray) -> sparse.csc_array:
    """Return a sparse basis of the same space: few agents move in each vector, along axes where possible.

    Independent parts are separated, and no vector's support contains that of another: the basis is in reduced echelon
    form. In a small part, pivots are exchanged as long as fewer agents, or as many agents and fewer coordinates, move.

    Args:
        basis: Columns of full column rank, shape (n, r).
        owner: Number of the agent that each row belongs to, ascending, shape (n,).

    Returns:
        Array of shape (n, r), with columns in the order of their first nonzero row. Each column has largest entry 1,
        and entries below 1e-7 are zero.
    """
    if basis.shape[1] == 0:
        return sparse.csc_array(basis.shape)
    clean = sparse.csr_array(basis, copy=True)
    clean.data[np.abs(clean.data) <= _ENTRY_ROUNDING * np.abs(clean.data).max()] = 0.0
    blocks = []
    for rows, columns, part in parts(clean):
        block, agent = part.toarray(), owner[rows]
        blocks.append((rows[:, None], columns, _echelon(block, _exchanged(_pivots(block, agent), block, agent))))
    found = assembled(blocks, basis.shape).tocsc()
    found.eliminate_zeros()
    return found[:, np.argsort(found.indices[found.indptr[:-1]], kind="stable")]


def _pivots(block: Array, owner: IntArray) -> IntArray:
    """Rows that determine all others, all of one agent where it has as many."""
    residual, pivots = block.copy(), list[int]()
    while len(pivots) < block.shape[1]:
        size = np.linalg.norm(residual, axis=1)
        last = owner == owner[pivots[-1]] if pivots else np.zeros(len(owner), dtype=bool)
        among = last if np.any(size[last] >= _LEAST_PIVOT * size.max()) else np.ones(len(owner), dtype=bool)
        # The first of those that are about as good as the best: rounding does not choose.
        pivot = int(np.flatnonzero(among & (size >= 0.5 * size[among].max()))[0])
        pivots.append(pivot)
        along = residual[pivot] / size[pivot]
        residual -= np.outer(residual @ along, along)
    return np.array(pivots, dtype=np.int64)


def _echelon(block: Array, pivots: IntArray) -> Array:
    """The basis in which each pivot row is moved by one vector alone, scaled to largest entry 1."""
    vectors = np.linalg.solve(block[pivots].T, block.T).T
    vectors[np.abs(vectors) <= _ENTRY_ROUNDING * np.abs(vectors).max()] = 0.0
    largest = np.argmax(np.abs(vectors) > (1.0 - _STEP_TOLERANCE) * np.abs(vectors).max(axis=0), axis=0)
    return vectors / vectors[largest, np.arange(vectors.shape[1])]


def _exchanged(pivots: IntArray, block: Array, owner: IntArray) -> IntArray:
    """Exchange one pivot after another while that leaves fewer agents, or else fewer coordinates, moving."""
    if block.shape[1] == 1:
        return pivots
    vectors = _echelon(block, pivots)
    _, candidates = np.unique(np.round(vectors, 6), axis=0, return_index=True)
    if len(candidates) * block.shape[1] > _MOST_SEARCHED_PIVOTS:
        return pivots
    starts = np.flatnonzero(np.diff(owner, prepend=-1))

    def cost(v: Array) -> tuple[int, int]:
        moves = v != 0.0
        return int(np.logical_or.reduceat(moves, starts).sum()), int(moves.sum())

    best = cost(vectors)
    for _ in range(_MOST_EXCHANGES):
        options = []
        for row in candidates[np.count_nonzero(vectors[candidates], axis=1) > 1].tolist():
            for k in np.flatnonzero(np.abs(vectors[row]) >= _LEAST_PIVOT).tolist():
                other = pivots.copy()
                other[k] = row
                options.append((cost(_echelon(block, other)), row, k))
        if not options or min(options)[0] >= best:
            break
        best, row, k = min(options)
        pivots[k] = row
        vectors = _echelon(block, pivots)
    return pivots


def describe_null_modes(team: Team) -> list[str]:
    """Describe the free directions of agents, a line for each basis vector of H^0(G, G_p; F)."""
    return [describe(team, mode) for mode in null_modes(team)]


def free_axes(team: Team) -> dict[tuple[str, ...], str]:
    """Return the axes along which agents are free, such as "xy", by the ids of those that are free together."""
    found: dict[tuple[str, ...], set[int]] = {}
    for mode in null_modes(team):
        names = tuple(team.agents[agent].id for agent in mode.agents)
        found.setdefault(names, set()).update(np.flatnonzero(mode.steps.any(axis=0)).tolist())
    return {names: "".join(_AXES[axis] for axis in sorted(axes)) for names, axes in found.items()}


def null_modes(team: Team) -> list[NullMode]:
    """A sparse basis of H^0(G, G_p; F), each vector with largest entry 1."""
    basis = null_mode_basis(team)
    ends = basis.indptr.tolist()
    return [null_mode_of(team, basis.data[a:b], basis.indices[a:b]) for a, b in itertools.pairwise(ends)]


def null_mode_basis(team: Team) -> sparse.csc_array:
    """A sparse basis of H^0(G, G_p; F), shape (n, dimension), rows in the order of the stacked q."""
    basis = team.dirichlet.sparse_null_basis
    return sparsified(basis.tocsr(), team.slots[: basis.shape[0]] // 3)


def null_mode_of(team: Team, values: Array, rows: IntArray | None = None) -> NullMode:
    """A vector of the agents as a mode: its entries (k,), at ascending rows of the stacked q, all by default."""
    agent, axis = np.divmod(team.slots[: len(values)] if rows is None else team.slots[rows], 3)
    agents, place = np.unique(agent, return_inverse=True)
    steps = np.zeros((len(agents), 3))
    steps[place, axis] = values
    return NullMode(agents, steps)


def describe_nearly(team: Team, mode: NullMode) -> str:
    """Who is nearly free along what, in a mode that edges and anchors notice little.

    Only agents that move at least half as far as the one that moves furthest are named, and their directions are
    rounded.
    """
    far = np.linalg.norm(mode.steps, axis=1)
    much = far >= _NAMED_SHARE * far.max()
    steps = mode.steps[much] / far[much, None]
    steps[np.abs(steps) < _LEAST_SINE] = 0.0
    steps *= np.sign(steps[0, np.argmax(np.abs(steps[0]))])  # an eigenvector has no sign of its own
    return describe(team, NullMode(mode.agents[much], _in_few_directions(steps)), "nearly free")


def _in_few_directions(steps: Array) -> Array:
    """Unit steps, those that are close to one another made equal."""
    steps = steps / np.linalg.norm(steps, axis=1)[:, None]
    left = np.ones(len(steps), dtype=bool)
    while left.any():
        alike = left & (steps @ steps[np.argmax(left)] > _SAME_DIRECTION_COSINE)
        mean = steps[alike].mean(axis=0)
        steps[alike] = mean / np.linalg.norm(mean)
        left &= ~alike
    return steps


def describe(team: Team, mode: NullMode, free: str = "free") -> str:
    """Who is free, or only nearly free, along what."""
    _, first, kind = np.unique(np.round(mode.steps / _STEP_TOLERANCE), axis=0, return_index=True, return_inverse=True)
    names = [team.agents[a].id for a in mode.agents]
    if len(first) == 1:
        return _describe_one_direction(names, _direction(mode.steps[0], team, mode.agents), free)
    furthest = float(np.linalg.norm(mode.steps, axis=1).max())
    clauses = []
    for k in np.argsort(first, kind="stable")[:_MOST_NAMED].tolist():
        group = np.flatnonzero(kind == k)
        step = mode.steps[first[k]]
        far = float(np.linalg.norm(step)) / furthest
        share = "" if far > 1.0 - _STEP_TOLERANCE else f" ({far:.2g} times as far)"
        who = _listed([names[i] for i in group], " and ")
        clauses.append(f"{who} along {_direction(step, team, mode.agents[group])}{share}")
    more = ", ..." if len(first) > _MOST_NAMED else ""
    return f"{', '.join(clauses)}{more}, {'' if free == 'free' else f'{free}, '}moving together"


def _describe_one_direction(names: Sequence[str], along: str, free: str) -> str:
    """Who is free along a direction that is the same for all."""
    if len(names) == 1:
        return f"{names[0]} is {free} along {along}"
    if along[-1] in _AXES:
        return f"{_listed(names)} are {free} along {along} together"
    return f"{_listed(names, ' and ')} {'can' if free == 'free' else f'are {free} to'} drift together along {along}"


def _listed(names: Sequence[str], last: str = ", ") -> str:
    if len(names) > _MOST_NAMED:
        return f"{', '.join(names[:_MOST_NAMED])} and {len(names) - _MOST_NAMED} more"
    return last.join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _direction(step: Array, team: Team, agents: IntArray) -> str:
    """An axis by name, or a unit vector in the coordinates that the agents have."""
    axes = np.flatnonzero(step)
    if len(axes) == 1:
        return ("-" if step[axes[0]] < 0 else "") + _AXES[axes[0]]
    unit = step[: max(team.agents[a].dimension for a in agents)] / np.linalg.norm(step)
    return "(" + ", ".join(f"{x:.2g}" for x in np.where(np.abs(unit) < 0.005, 0.0, unit)) + ")"
