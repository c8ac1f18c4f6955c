"""The smallest set of edges that connects the agents and lets every target be sensed (Assumption 5)."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial.distance import cdist

from mjsheaf.arrays import Array, IntArray
from mjsheaf.team import Edge, Team

_MAX_AGENTS = 1500  # largest team whose pairwise distances are computed
_MAX_LISTED = 3


def suggest_edges(team: Team, positions: Array) -> dict[str, list[list[str]]]:
    """Return the shortest edges that would make Assumption 5 hold, by kind; empty if it holds.

    Args:
        team: The team.
        positions: Positions of all vehicles, padded, shape (V, 3), m.
    """
    N = len(team.agents)
    if N > _MAX_AGENTS:
        return {}
    places = np.nan_to_num(positions)
    distances = cdist(places, places)
    agents = np.flatnonzero(team.present)
    unseen = unsensed_targets(team, team.sensing)
    senses = [[team.agents[agents[distances[team.index[t], agents].argmin()]].id, t] for t in unseen]
    edges = {"communication": _between_parts(team, distances[:N, :N]), "sensing": senses}
    return {kind: found for kind, found in edges.items() if found}


def describe_edges(edges: Mapping[str, Sequence[Sequence[str]]]) -> str:
    """Return the suggestion to add edges, by kind, as a sentence; empty if there are none."""
    pairs = {kind: [f"[{tail}, {head}]" for tail, head in own] for kind, own in edges.items()}
    return " and ".join(f"add {kind} {_listed(own)}" for kind, own in pairs.items())


def unsensed_targets(team: Team, sensing: Iterable[Edge]) -> list[str]:
    """Return the targets that none of some sensing edges measures."""
    sensed = {e.head for e in sensing}
    return [t for t in team.target_ids if t not in sensed]


def label_parts(team: Team, edges: Iterable[Edge]) -> IntArray:
    """Number the connected parts of the agents' graph with some edges from 0 on, shape (N,)."""
    N = len(team.agents)
    ends = [(team.index[e.tail], team.index[e.head]) for e in edges]
    tails, heads = np.array(ends, dtype=np.int64).reshape(-1, 2).T
    graph = sparse.coo_array((np.ones(len(ends)), (tails, heads)), shape=(N, N))
    return connected_components(graph, directed=False)[1]


def _between_parts(team: Team, distances: Array) -> list[list[str]]:
    """Return the shortest edges that connect the parts of the agents' graph: one fewer than there are parts."""
    part = label_parts(team, team.communication)
    count = part.max() + 1
    present = team.present
    apart = (part[:, None] != part) & present[:, None] & present
    nearest: dict[tuple[int, int], tuple[float, int, int]] = {}
    for i, j in zip(*np.nonzero(np.triu(apart)), strict=True):
        pair = (min(part[i], part[j]), max(part[i], part[j]))
        candidate = (float(distances[i, j]), int(i), int(j))
        nearest[pair] = min(nearest.get(pair, candidate), candidate)
    lengths = sparse.lil_array((count, count))
    for (a, b), (length, _, _) in nearest.items():
        lengths[a, b] = length + 1e-9
    tree = minimum_spanning_tree(lengths.tocsr()).tocoo()
    chosen = [nearest[min(a, b), max(a, b)] for a, b in zip(tree.row.tolist(), tree.col.tolist(), strict=True)]
    return [[team.agents[i].id, team.agents[j].id] for _, i, j in sorted(chosen)]


def _listed(edges: list[str]) -> str:
    shown = ", ".join(edges[:_MAX_LISTED])
    return shown if len(edges) <= _MAX_LISTED else f"{shown} and {len(edges) - _MAX_LISTED} others"
