"""Fragility: what the loss of a single sensing edge, link, anchor or agent breaks, and what is left of lambda_min."""

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mjsheaf.checking.cohomology import AgentCoboundary, agent_coboundary, smallest_eigenvalue
from mjsheaf.sheaf.sections import sparse_kernel_basis
from mjsheaf.team import GROUND, Edge, Team

Index = NDArray[np.int64]
Kind = Literal["sensing", "communication", "anchor", "agent"]

CONNECTED = "agent graph connected"
SENSED = "every target sensed"
TRIVIAL = "relative cohomology trivial"

EXACT_STATES = 200
EXACT_LOSSES = 1000
"""Up to so many states of the agents and single losses, H is decomposed again after each loss."""


@dataclass(frozen=True)
class Loss:
    """What the loss of one edge or agent does.

    Attributes:
        kind: what is lost.
        name: such as "A1 - T2", "A1 - A4 (1 of 2)", "A2 along z" (an anchor), "A3".
        breaks: what is newly broken, whatever failed before. CONNECTED: agents that were connected no longer are.
            SENSED: a target that was sensed no longer is. TRIVIAL: agents have a motion free that was not.
        lambda_min: smallest eigenvalue of H after the loss; None where it was not computed.
    """

    kind: Kind
    name: str
    breaks: tuple[str, ...]
    lambda_min: float | None


@dataclass(frozen=True)
class Fragility:
    """What single losses do.

    Attributes:
        exact: whether every loss was tried out on H; else only losses that break CONNECTED or SENSED are listed.
        method: the same in words.
        losses: those that break something first, then by lambda_min.
        worst: the loss that breaks nothing and leaves the smallest lambda_min; None where there is none, where
            lambda_min was not computed, or where it is 0 already.
    """

    exact: bool
    method: str
    losses: list[Loss]
    worst: Loss | None


@dataclass(frozen=True)
class _Single:
    """One edge, or one agent with its edges."""

    kind: Kind
    name: str
    edges: tuple[int, ...]  # places in the sheaf's order of edges
    agent: int | None = None


def fragility(team: Team) -> Fragility:
    """Try out, or where the team is large reason about, each single loss.

    The loss of an agent takes its edges along; the last agent is not lost. Parallel edges are lost one at a time.
    """
    singles = list(_singles(team))
    breaks = _combinatorial(team, singles)
    states = team.dirichlet.H.shape[0]
    if states > EXACT_STATES or len(singles) > EXACT_LOSSES:
        losses = [Loss(s.kind, s.name, broken, None) for s, broken in zip(singles, breaks, strict=True) if broken]
        method = (
            f"over {EXACT_STATES} states or {EXACT_LOSSES} single losses: bridges and articulation points of the agent "
            "graph, and targets that a single edge or agent senses; lambda_min and the relative cohomology after a "
            "loss were not computed"
        )
        return Fragility(False, method, losses, None)

    coboundary, rows = agent_coboundary(team), _rows_of_edges(team)
    agent_of_state = team.slots[:states] // 3
    free = team.dirichlet.sparse_null_basis.shape[1]
    losses = []
    for single, broken in zip(singles, breaks, strict=True):
        kept = np.ones(coboundary.plain.shape[0], dtype=bool)
        for e in single.edges:
            kept[rows[e]] = False
        lost = agent_of_state == single.agent
        # What the lost agent alone was free to do is lost with it.
        free_before = free - _dimension(coboundary.plain[:, lost]) if free and lost.any() else free
        free_after, left = _free_and_lambda_min(coboundary.kept(kept, ~lost))
        if free_after > free_before:
            broken += (TRIVIAL,)
        losses.append(Loss(single.kind, single.name, broken, left))
    losses.sort(key=lambda loss: (not loss.breaks, round(loss.lambda_min or 0.0, 12)))  # rounding does not choose
    worst = None if free else next((loss for loss in losses if not loss.breaks), None)
    return Fragility(True, f"exact: H decomposed again after each of {len(losses)} losses", losses, worst)


def _free_and_lambda_min(coboundary: AgentCoboundary) -> tuple[int, float]:
    lambda_min = smallest_eigenvalue(coboundary)
    return (0, lambda_min) if lambda_min > 0.0 else (_dimension(coboundary.plain), 0.0)


def _dimension(plain: sparse.csr_array) -> int:
    return sparse_kernel_basis(plain).shape[1]


def _singles(team: Team) -> Iterator[_Single]:
    """Everything that can be lost alone, edges first in the order of the sheaf."""
    fields: list[tuple[Kind, tuple[Edge, ...]]] = [
        ("communication", team.communication),
        ("sensing", team.sensing),
        ("anchor", team.anchors),
    ]
    first = {
        "communication": 0,
        "sensing": len(team.communication),
        "anchor": len(team.communication + team.sensing + team.target_edges),
    }
    incident: dict[str, list[int]] = {agent: [] for agent in team.agent_ids}
    for kind, edges in fields:
        alike, seen = Counter(map(_ends, edges)), Counter[tuple[str, ...]]()
        for k, edge in enumerate(edges):
            ends = _ends(edge)
            seen[ends] += 1
            for end in (edge.tail, edge.head):
                if end in incident:
                    incident[end].append(first[kind] + k)
            which = f" ({seen[ends]} of {alike[ends]})" if alike[ends] > 1 else ""
            yield _Single(kind, _name(edge) + which, (first[kind] + k,))
    if len(team.agents) > 1:
        for i, agent in enumerate(team.agent_ids):
            yield _Single("agent", agent, tuple(incident[agent]), i)


def _ends(edge: Edge) -> tuple[str, ...]:
    """What parallel edges have in common; for anchors, what they hold."""
    return (_name(edge),) if edge.head == GROUND else (min(edge.tail, edge.head), max(edge.tail, edge.head))


def _name(edge: Edge) -> str:
    if edge.head != GROUND:
        return f"{edge.tail} - {edge.head}"
    axes = ["xyz"[k] for k in np.flatnonzero(np.any(edge.F_tail != 0.0, axis=0))]
    return f"{edge.tail} along {', '.join(axes)}" if len(axes) == len(edge.F_tail) else f"{edge.tail} to a fixed value"


def _rows_of_edges(team: Team) -> list[Index]:
    """Rows of the coboundary that belong to each edge, in the order of the sheaf."""
    edges = team.communication + team.sensing + team.target_edges + team.anchors
    ends = np.cumsum([0, *(len(e.F_tail) for e in edges)])
    return [np.arange(start, end) for start, end in itertools.pairwise(ends)]


def _combinatorial(team: Team, singles: list[_Single]) -> list[tuple[str, ...]]:
    """For each loss, which of CONNECTED and SENSED it breaks; this needs no linear algebra and is exact at any size."""
    edges = team.communication + team.sensing
    graph = nx.Graph()
    graph.add_nodes_from(team.agent_ids)
    links = Counter(map(_ends, team.communication))
    graph.add_edges_from(links)
    bridges = {(min(pair), max(pair)) for pair in nx.bridges(graph)}
    cuts = set(nx.articulation_points(graph))

    sensed_by = {target: Counter[str]() for target in team.target_ids}
    for e in team.sensing:
        sensed_by[e.head][e.tail] += 1
    once = {target for target, by in sensed_by.items() if by.total() == 1}
    alone = {agent for by in sensed_by.values() if len(by) == 1 for agent in by}

    def of(single: _Single) -> tuple[str, ...]:
        if single.agent is not None:
            disconnects, blinds = single.name in cuts, single.name in alone
        elif single.kind == "anchor":
            disconnects = blinds = False
        else:
            edge = edges[single.edges[0]]
            ends = _ends(edge)
            disconnects, blinds = ends in bridges and links[ends] == 1, edge.head in once
        return (CONNECTED,) * disconnects + (SENSED,) * blinds

    return [of(single) for single in singles]
