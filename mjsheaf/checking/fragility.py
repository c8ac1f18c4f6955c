"""Assumptions that break when a single sensing edge, link, anchor, agent or target is lost, and lambda_min after it."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from typing import Literal

import numpy as np
from pydantic import Field

from mjsheaf.checking.spectrum import agent_coboundary, smallest_eigenvalue
from mjsheaf.errors import select_true
from mjsheaf.section import Record
from mjsheaf.sheaf.sections import sparse_null_space
from mjsheaf.team import GROUND, Edge, Team

Kind = Literal["sensing", "communication", "anchor", "agent", "link", "target"]

CONNECTED = "agent graph connected"
"""Broken where agents that were connected no longer are."""

SENSED = "every target sensed"
"""Broken where a target that was sensed no longer is."""

TRIVIAL = "relative cohomology trivial"
"""Broken where agents have a null mode that they did not have."""

MOST_CRITICAL = 50
EXACT_STATES = 200
EXACT_LOSSES = 1000
"""Largest numbers of agent states and single losses for which H is decomposed again after each loss."""


class Loss(Record):
    """Effect of losing one edge, agent or target, or all edges between two ends (a link)."""

    kind: Kind
    name: str = Field(description='such as "A1 - T2", "A1 - A4 (1 of 2)" or "A2 along z"')
    breaks: tuple[str, ...] = Field(description="what is newly broken, whatever failed before")
    lambda_min: float | None = Field(description="smallest eigenvalue of H after it; null where not computed")


Single = tuple[Loss, list[int], int | None]
"""What a loss breaks of CONNECTED and SENSED, which takes no linear algebra and is exact at any size; the edges that
are lost, by their places in the sheaf's order; and the number of the agent that is."""

KindOfEdge = tuple[Kind | None, Edge]


class Fragility(Record):
    """Single losses that break an assumption."""

    exact: bool = Field(description="whether H was decomposed after each loss; else lambda_min is not known")
    method: str
    critical: list[Loss] = Field(description=f"losses that break something, at most {MOST_CRITICAL}")
    critical_count: int
    worst: Loss | None = Field(description="the loss that breaks nothing with the smallest lambda_min; null if unknown")


def fragility(team: Team) -> Fragility:
    """Find the losses of `single_losses` that break something, and the worst of the others."""
    losses, exact = single_losses(team)
    critical = [loss for loss in losses if loss.breaks]
    method = (
        f"exact: H decomposed again after each of {len(losses)} losses"
        if exact
        else f"over {EXACT_STATES} states or {EXACT_LOSSES} single losses, or edges that do not fit together: "
        "bridges and articulation points of the agent graph, targets, and those that a single edge or agent senses; "
        "lambda_min and the relative cohomology after a loss were not computed"
    )
    return Fragility(
        exact=exact,
        method=method,
        critical=critical[:MOST_CRITICAL],
        critical_count=len(critical),
        worst=next((loss for loss in losses if not loss.breaks), None) if exact and team.dirichlet.unique else None,
    )


def single_losses(team: Team) -> tuple[list[Loss], bool]:
    """Try out each single loss; of a large team find those that break CONNECTED or SENSED without linear algebra.

    The loss of an agent takes its edges along, that of a target those that sense it; the last agent is not lost.
    Parallel edges are lost one at a time, and all at once where the link between their ends is cut.

    Returns:
        The losses, those that break something first, then by lambda_min; and whether each was tried out on H.
    """
    singles = list(_singles(team))
    if team.stressed or team.dirichlet.H.shape[0] > EXACT_STATES or len(singles) > EXACT_LOSSES:
        return [loss for loss, _, _ in singles if loss.breaks], False
    losses = list(_try_out(team, singles))
    losses.sort(key=lambda loss: (not loss.breaks, round(loss.lambda_min or 0.0, 12)))  # rounding does not choose
    return losses, True


def _try_out(team: Team, singles: Iterable[Single]) -> Iterator[Loss]:
    """Yield each loss with lambda_min of H after it; it breaks TRIVIAL too if an agent is then free to drift."""
    delta, D = agent_coboundary(team)
    free = team.dirichlet.sparse_null_basis.shape[1]
    sizes = [len(edge.b) for _, edge in _edges(team)]
    edge_of_row = np.repeat(np.arange(len(sizes)), sizes)
    agent_of_state = team.slots[: D.shape[1]] // 3
    for loss, edges, agent in singles:
        lost = agent_of_state == agent
        # What the lost agent alone was free to do is lost with it.
        gone = sparse_null_space(delta[:, lost]).shape[1] if free and lost.any() else 0
        left = [x[~np.isin(edge_of_row, edges)][:, ~lost] for x in (delta, D)]
        lambda_min = smallest_eigenvalue(*left)
        frees = lambda_min == 0.0 and sparse_null_space(left[0]).shape[1] > free - gone
        breaks = (*loss.breaks, TRIVIAL) if frees else loss.breaks
        yield loss.model_copy(update={"breaks": breaks, "lambda_min": lambda_min})


def _edges(team: Team) -> list[KindOfEdge]:
    """The edges in the order of the sheaf, with the kind of those that can be lost."""
    kinds: list[tuple[Kind | None, tuple[Edge, ...]]] = [
        ("communication", team.communication),
        ("sensing", team.sensing),
        (None, team.target_edges),
        ("anchor", team.anchors),
    ]
    return [(kind, edge) for kind, edges in kinds for edge in edges]


def _singles(team: Team) -> Iterator[Single]:
    """Yield everything that can be lost alone: edges, one of parallel ones at a time, links, targets, and agents."""
    import networkx as nx

    edges = _edges(team)
    graph = nx.Graph(list(map(_ends, team.communication)))
    graph.add_nodes_from(team.agent_ids)
    bridges = {(min(pair), max(pair)) for pair in nx.bridges(graph)}
    cuts = set(nx.articulation_points(graph))
    links = Counter(map(_ends, team.communication))
    sensors = Counter(edge.head for edge in team.sensing)

    def single(kind: Kind, name: str, numbers: list[int], agent: int | None = None) -> Single:
        lost = [edges[e] for e in numbers]
        apart = Counter(_ends(edge) for own, edge in lost if own == "communication")
        unseen = Counter(edge.head for own, edge in lost if own == "sensing")
        disconnects = any(pair in bridges and count == links[pair] for pair, count in apart.items())
        if agent is not None:
            disconnects = name in cuts
        blinds = any(count == sensors[target] for target, count in unseen.items())
        breaks = select_true({CONNECTED: disconnects, SENSED: blinds})
        return Loss(kind=kind, name=name, breaks=tuple(breaks), lambda_min=None), numbers, agent

    incident = defaultdict[str, list[int]](list)
    parallel = defaultdict[tuple[str, ...], list[int]](list)
    for e, (kind, edge) in enumerate(edges):
        parallel[_ends(edge)].append(e)
        if kind is not None:
            incident[edge.tail].append(e)
            incident[edge.head].append(e)
    for e, (kind, edge) in enumerate(edges):
        if kind is not None:
            alike = parallel[_ends(edge)]
            which = f" ({alike.index(e) + 1} of {len(alike)})" if len(alike) > 1 else ""
            yield single(kind, _name(edge) + which, [e])
    for several in parallel.values():
        kind, edge = edges[several[0]]
        if kind not in (None, "anchor") and len(several) > 1:
            yield single("link", f"{edge.tail} - {edge.head} (all {len(several)})", several)
    for target in sensors:
        yield single("target", target, incident[target])
    if len(team.agents) > 1:
        for i, agent in enumerate(team.agent_ids):
            yield single("agent", agent, incident[agent], i)


def _ends(edge: Edge) -> tuple[str, ...]:
    """Return the ends that parallel edges share; for an anchor, the name of what it holds."""
    return (_name(edge),) if edge.head == GROUND else (min(edge.tail, edge.head), max(edge.tail, edge.head))


def _name(edge: Edge) -> str:
    if edge.head != GROUND:
        return f"{edge.tail} - {edge.head}"
    axes = ["xyz"[k] for k in np.flatnonzero(np.any(edge.F_tail != 0.0, axis=0))]
    return f"{edge.tail} along {', '.join(axes)}" if len(axes) == len(edge.F_tail) else f"{edge.tail} to a fixed value"
