"""Small teams for the tests of checking: members by letter, edges by name, and random ones.

B floats in the plane, U flies in space; S is a target in the plane, V one in space.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from mjsheaf.team import Edge, Member, Team, anchor, restriction_maps

Array = NDArray[np.float64]
Pair = tuple[str, str]

LAWS = settings(deadline=None, derandomize=True, max_examples=60)


def member(name: str) -> Member:
    return Member(name, 3 if name[0] in "UV" else 2)


def edge(tail: str, head: str, *, name: str = "shared", weight: float = 1.0, **attitude: Any) -> Edge:
    maps = restriction_maps(name, member(tail).dimension, member(head).dimension, **attitude)
    return Edge(tail, head, *maps, weight * np.eye(len(maps[0])))


def hold(agent: str, axes: str, weight: float = 1.0) -> Edge:
    """An anchor of some coordinates at zero."""
    F = np.eye(member(agent).dimension)[["xyz".index(a) for a in axes]]
    return anchor(agent, F, np.zeros(len(F)), weight * np.eye(len(F)))


def team(
    agents: str, targets: str, links: Sequence[Edge | Pair], seen: Sequence[Edge | Pair], anchors: Sequence[Edge] = ()
) -> Team:
    """A team of members named in a string; edges as pairs have 'shared' maps."""
    communication, sensing = ([e if isinstance(e, Edge) else edge(*e) for e in kind] for kind in (links, seen))
    return Team(
        [member(v) for v in agents.split()],
        [member(v) for v in targets.split()],
        communication,
        sensing,
        anchors=anchors,
    )


def turn(angle: float) -> Array:
    """Rotation in the plane by an angle in rad."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def coboundary(team: Team) -> Array:
    """The coboundary on the agents, dense, block by block from its definition; for inner products c I alone."""
    first = dict(zip(team.agent_ids, np.cumsum([0, *(a.dimension for a in team.agents)])[:-1].tolist(), strict=True))
    rows = []
    for e in team.communication + team.sensing + team.anchors:
        row = np.zeros((len(e.F_tail), sum(a.dimension for a in team.agents)))
        for end, F in ((e.tail, e.F_tail), (e.head, -e.F_head)):
            if end in first:
                row[:, first[end] : first[end] + F.shape[1]] += np.sqrt(e.weight[0, 0]) * F
        rows.append(row)
    return np.vstack([*rows, np.zeros((1, sum(a.dimension for a in team.agents)))])


@st.composite
def shared_teams(draw: st.DrawFn, most_agents: int = 4, most_targets: int = 2) -> Team:
    """A random team with 'shared' maps, often disconnected, sometimes with parallel edges and anchors."""
    agents = [f"{draw(st.sampled_from('BU'))}{k}" for k in range(draw(st.integers(1, most_agents)))]
    targets = [f"{draw(st.sampled_from('SV'))}{k}" for k in range(draw(st.integers(1, most_targets)))]
    pairs = list(itertools.permutations(agents, 2))
    links = draw(st.lists(st.sampled_from(pairs), max_size=6)) if pairs else []
    seen = draw(st.lists(st.tuples(st.sampled_from(agents), st.sampled_from(targets)), max_size=5))
    held = draw(st.lists(st.tuples(st.sampled_from(agents), st.sampled_from("xy")), max_size=2))
    weights = st.sampled_from([1.0, 0.25, 3.0])
    return team(
        " ".join(agents),
        " ".join(targets),
        [edge(*pair, weight=draw(weights)) for pair in links],
        [edge(*pair, weight=draw(weights)) for pair in seen],
        [hold(agent, axis) for agent, axis in held],
    )


@st.composite
def whole_number_teams(draw: st.DrawFn) -> Team:
    """A random team whose maps have small whole entries: ranks are exact, and kernels are common and oblique."""
    agents = [member(f"{draw(st.sampled_from('BU'))}{k}") for k in range(draw(st.integers(1, 4)))]
    targets = [member("S"), member("V")]

    def some(tails: list[Member], heads: list[Member], most: int) -> list[Edge]:
        pairs = [(a, b) for a in tails for b in heads if a is not b]
        edges = []
        for a, b in draw(st.lists(st.sampled_from(pairs), max_size=most)) if pairs else []:
            m = draw(st.integers(1, 3))
            F_a, F_b = (
                draw(arrays(np.float64, (m, v.dimension), elements=st.integers(-2, 2).map(float))) for v in (a, b)
            )
            edges.append(Edge(a.id, b.id, F_a, F_b, np.eye(m)))
        return edges

    return Team(agents, targets, some(agents, agents, 5), some(agents, targets, 4))
