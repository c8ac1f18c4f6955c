"""Fragility: what the loss of a single sensing edge, link, anchor or agent breaks, and what is left of lambda_min."""

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import sparse

from mjsheaf.checking.cohomology import agent_coboundary, smallest_eigenvalue
from mjsheaf.io.section import Record
from mjsheaf.sheaf.blocks import sparse_null_space
from mjsheaf.team import GROUND, Edge, Team

Index = NDArray[np.int64]
Kind = Literal["sensing", "communication", "anchor", "agent"]

CONNECTED = "agent graph connected"
"""Broken where agents that were connected no longer are."""

SENSED = "every target sensed"
"""Broken where a target that was sensed no longer is."""

TRIVIAL = "relative cohomology trivial"
"""Broken where agents have a null mode that they did not have."""

MOST_CRITICAL = 50
EXACT_STATES = 200
EXACT_LOSSES = 1000
"""Up to so many states of the agents and single losses, H is decomposed again after each loss."""


class Loss(Record):
    """What the loss of one edge or agent does."""

    kind: Kind
    name: str = Field(description='such as "A1 - T2", "A1 - A4 (1 of 2)", "A2 along z" (an anchor), "A3"')
    breaks: tuple[str, ...] = Field(description="what is newly broken, whatever failed before")
    lambda_min: float | None = Field(description="smallest eigenvalue of H after it; null where not computed")


class Fragility(Record):
    """Which single loss breaks an assumption."""

    exact: bool = Field(description="whether H was decomposed after each loss; else lambda_min is not known")
    method: str
    critical: list[Loss] = Field(description=f"losses that break something, at most {MOST_CRITICAL}")
    critical_count: int
    worst: Loss | None = Field(description="the loss that breaks nothing with the smallest lambda_min; null if unknown")


@dataclass(frozen=True)
class _Single:
    """One edge, or one agent with its edges."""

    kind: Kind
    name: str
    edges: tuple[int, ...]  # places in the sheaf's order of edges
    agent: int | None = None


def fragility(team: Team) -> Fragility:
    """Which of the losses of `single_losses` break something, and the worst of the others."""
    losses, exact = single_losses(team)
    critical = [loss for loss in losses if loss.breaks]
    method = (
        f"exact: H decomposed again after each of {len(losses)} losses"
        if exact
        else f"over {EXACT_STATES} states or {EXACT_LOSSES} single losses: bridges and articulation points of the "
        "agent graph, and targets that a single edge or agent senses; lambda_min and the relative cohomology after a "
        "loss were not computed"
    )
    known = exact and team.dirichlet.unique
    return Fragility(
        exact=exact,
        method=method,
        critical=critical[:MOST_CRITICAL],
        critical_count=len(critical),
        worst=next((loss for loss in losses if not loss.breaks), None) if known else None,
    )


def single_losses(team: Team) -> tuple[list[Loss], bool]:
    """Try out each single loss; of a large team find those that break CONNECTED or SENSED without linear algebra.

    The loss of an agent takes its edges along; the last agent is not lost. Parallel edges are lost one at a time.

    Returns:
        The losses, those that break something first, then by lambda_min; and whether each was tried out on H.
    """
    singles = list(_singles(team))
    breaks = _combinatorial(team, singles)
    states = team.dirichlet.H.shape[0]
    if states > EXACT_STATES or len(singles) > EXACT_LOSSES:
        return [_loss(s, broken, None) for s, broken in zip(singles, breaks, strict=True) if broken], False

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
        left = coboundary.kept(kept, ~lost)
        lambda_min = smallest_eigenvalue(left)
        if lambda_min == 0.0 and _dimension(left.plain) > free_before:
            broken += (TRIVIAL,)
        losses.append(_loss(single, broken, lambda_min))
    losses.sort(key=lambda loss: (not loss.breaks, round(loss.lambda_min or 0.0, 12)))  # rounding does not choose
    return losses, True


def _loss(single: _Single, breaks: tuple[str, ...], lambda_min: float | None) -> Loss:
    return Loss(kind=single.kind, name=single.name, breaks=breaks, lambda_min=lambda_min)


def _dimension(plain: sparse.csr_array) -> int:
    return sparse_null_space(plain).shape[1]


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
