"""Fragility: what the loss of a single sensing edge, link, anchor or agent breaks, and what is left of lambda_min."""

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import networkx as nx
import numpy as np
from pydantic import Field

from mjsheaf.checking.cohomology import agent_coboundary, smallest_eigenvalue
from mjsheaf.io.section import Record
from mjsheaf.sheaf.sections import sparse_null_space
from mjsheaf.team import GROUND, Edge, Team

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
        found = zip(singles, breaks, strict=True)
        return [Loss(kind=s.kind, name=s.name, breaks=broken, lambda_min=None) for s, broken in found if broken], False

    coboundary, free = agent_coboundary(team), team.dirichlet.sparse_null_basis.shape[1]
    sizes = [len(edge.b) for _, edge in _edges(team)]
    edge_of_row, agent_of_state = np.repeat(np.arange(len(sizes)), sizes), team.slots[:states] // 3
    losses = []
    for single, broken in zip(singles, breaks, strict=True):
        lost = agent_of_state == single.agent
        # What the lost agent alone was free to do is lost with it.
        gone = sparse_null_space(coboundary.plain[:, lost]).shape[1] if free and lost.any() else 0
        left = coboundary.kept(~np.isin(edge_of_row, single.edges), ~lost)
        lambda_min = smallest_eigenvalue(left)
        if lambda_min == 0.0 and sparse_null_space(left.plain).shape[1] > free - gone:
            broken += (TRIVIAL,)
        losses.append(Loss(kind=single.kind, name=single.name, breaks=broken, lambda_min=lambda_min))
    losses.sort(key=lambda loss: (not loss.breaks, round(loss.lambda_min or 0.0, 12)))  # rounding does not choose
    return losses, True


def _edges(team: Team) -> list[tuple[Kind | None, Edge]]:
    """The edges in the order of the sheaf, with the kind of those that can be lost."""
    kinds: list[tuple[Kind | None, tuple[Edge, ...]]] = [
        ("communication", team.communication),
        ("sensing", team.sensing),
        (None, team.target_edges),
        ("anchor", team.anchors),
    ]
    return [(kind, edge) for kind, edges in kinds for edge in edges]


def _singles(team: Team) -> Iterator[_Single]:
    """Everything that can be lost alone, edges first in the order of the sheaf."""
    edges = _edges(team)
    alike, seen = Counter(_ends(edge) for _, edge in edges), Counter[tuple[str, ...]]()
    incident = defaultdict[str, list[int]](list)
    for e, (kind, edge) in enumerate(edges):
        if kind is not None:
            ends = _ends(edge)
            seen[ends] += 1
            incident[edge.tail].append(e)
            incident[edge.head].append(e)
            which = f" ({seen[ends]} of {alike[ends]})" if alike[ends] > 1 else ""
            yield _Single(kind, _name(edge) + which, (e,))
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


def _combinatorial(team: Team, singles: list[_Single]) -> list[tuple[str, ...]]:
    """For each loss, which of CONNECTED and SENSED it breaks; this needs no linear algebra and is exact at any size."""
    edges, links = [edge for _, edge in _edges(team)], Counter(map(_ends, team.communication))
    graph = nx.Graph(list(links))
    graph.add_nodes_from(team.agent_ids)
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
        else:
            edge = edges[single.edges[0]]
            disconnects, blinds = links[_ends(edge)] == 1 and _ends(edge) in bridges, edge.head in once
        return (CONNECTED,) * disconnects + (SENSED,) * blinds

    return [of(single) for single in singles]
