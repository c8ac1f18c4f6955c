"""Effects of single losses.

Oracle: each edge and agent taken out of a fresh team, which is then checked again: components by networkx, targets by
looking, uniqueness and lambda_min from its own Dirichlet problem.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mjsheaf.checking.spectrum import CONNECTED, MOST_CRITICAL, SENSED, TRIVIAL, Loss, fragility, single_losses
from mjsheaf.team import Edge, Team
from tests.builders import hold, make_edge, make_team
from tests.strategies import shared_teams, tried, whole_number_teams


def reach(team: Team) -> dict[str, set[str]]:
    """The part of the communication graph that each agent is in."""
    graph = nx.Graph(e.between for e in team.communication)
    graph.add_nodes_from(team.agent_ids)
    return {agent: part for part in nx.connected_components(graph) for agent in part}


def newly_free(before: Team, after: Team) -> bool:
    """Return True if the remaining agents have a free motion that they did not have before."""

    def motions(team: Team) -> np.ndarray:
        rows = [agent.id for agent in team.agents for _ in range(agent.dimension)]
        return team.dirichlet.null_basis[[row in after.agent_ids for row in rows]]

    old, new = motions(before), motions(after)
    return bool(np.linalg.matrix_rank(np.hstack([old, new]), tol=1e-6) > np.linalg.matrix_rank(old, tol=1e-6))


def by_trying(team: Team) -> list[Loss]:
    """Every loss, tried out on a fresh team; edges that are alike are numbered."""
    before, losses = reach(team), list[Loss]()

    def lose(kind: str, name: str, keep: Callable[[Edge], bool], agents: Sequence[str]) -> None:
        members, kinds = [a for a in team.agents if a.id in agents], (team.communication, team.sensing, team.anchors)
        communication, sensing, anchors = ([e for e in edges if keep(e)] for edges in kinds)
        left = Team(members, team.targets, communication, sensing, anchors=anchors)
        after = reach(left)
        broken = {
            CONNECTED: any(after[a] != before[a] & set(after) for a in after),
            SENSED: {e.head for e in left.sensing} != {e.head for e in team.sensing},
            TRIVIAL: newly_free(team, left),
        }
        breaks = tuple(what for what in broken if broken[what])
        lowest = np.linalg.eigvalsh(left.dirichlet.H.toarray())[0] if left.dirichlet.unique else 0.0
        losses.append(Loss.model_validate({"kind": kind, "name": name, "breaks": breaks, "lambda_min": lowest}))

    for kind, edges in (("communication", team.communication), ("sensing", team.sensing), ("anchor", team.anchors)):
        plain = [f"{e.tail} - {e.head}" if kind != "anchor" else f"{e.tail} along {axes(e)}" for e in edges]
        ends = [frozenset(name.split(" - ")) for name in plain]
        for k, lost in enumerate(edges):
            alike = f" ({ends[: k + 1].count(ends[k])} of {ends.count(ends[k])})" if ends.count(ends[k]) > 1 else ""
            lose(kind, plain[k] + alike, lambda e, lost=lost: e is not lost, team.agent_ids)  # type: ignore[misc]
    linked = (*team.communication, *team.sensing)
    for pair in dict.fromkeys(frozenset(e.between) for e in linked):
        own = [e for e in linked if pair == frozenset(e.between)]
        if len(own) > 1:
            name = f"{own[0].tail} - {own[0].head} (all {len(own)})"
            lose("link", name, lambda e, pair=pair: frozenset(e.between) != pair, team.agent_ids)  # type: ignore[misc]
    for target in dict.fromkeys(e.head for e in team.sensing):
        lose("target", target, lambda e, target=target: e.head != target, team.agent_ids)  # type: ignore[misc]
    for agent in team.agent_ids if len(team.agents) > 1 else []:
        rest = [a for a in team.agent_ids if a != agent]
        lose("agent", agent, lambda e, agent=agent: agent not in (e.tail, e.head), rest)  # type: ignore[misc]
    return losses


def axes(anchor: Edge) -> str:
    return ", ".join("xyz"[k] for k in np.flatnonzero(anchor.F_tail.any(axis=0)))


def same(found: Sequence[Loss], tried: Sequence[Loss]) -> None:
    def table(losses: Sequence[Loss]) -> dict[tuple[str, str], Loss]:
        return {(loss.kind, loss.name): loss for loss in losses}

    assert len(table(found)) == len(found)
    assert table(found).keys() == table(tried).keys()
    for key, loss in table(tried).items():
        assert table(found)[key].breaks == loss.breaks, key
        assert table(found)[key].lambda_min == pytest.approx(loss.lambda_min, rel=1e-6, abs=1e-15), key


def everything_is_as_tried(team: Team) -> None:
    """Each loss is; what breaks something comes first, then by lambda_min; the worst breaks nothing."""
    (losses, exact), found = single_losses(team), fragility(team)
    assert exact
    assert found.exact
    same(losses, by_trying(team))
    keys = [(not loss.breaks, round(loss.lambda_min or 0.0, 12)) for loss in losses]
    assert keys == sorted(keys)
    critical, harmless = ([loss for loss in losses if bool(loss.breaks) is kind] for kind in (True, False))
    assert (found.critical, found.critical_count) == (critical[:MOST_CRITICAL], len(critical))
    assert found.worst == (harmless[0] if harmless and team.dirichlet.unique else None)


@pytest.mark.slow
@settings(max_examples=tried(200, 20))
@given(st.one_of(shared_teams(), whole_number_teams()))
def test_fragility_is_what_trying_each_loss_shows(team: Team) -> None:
    everything_is_as_tried(team)


RING = [("U1", "U2"), ("U2", "U3"), ("U3", "U1")]
Z = np.eye(3)[2:]
BY_HEIGHT = replace(make_edge("U1", "U2"), F_tail=Z, F_head=Z, weight=np.eye(1), offset=np.zeros(1))
SPLIT = make_team(
    "B1 B2 B3 B4 B5", "S1 S2 S3", [("B1", "B2"), ("B3", "B4"), ("B4", "B5")], [("B1", "S1"), ("B2", "S2")]
)
"""B1 alone senses S1, B2 alone S2, no agent S3; B3, B4 and B5 are a part of their own, free to drift."""


@pytest.mark.parametrize(
    ("team", "breaking"),
    [
        (make_team("U1 U2 U3", "V1", RING[:2], [("U1", "V1")]), "U1 - U2, U2 - U3, U1 - V1, U1, U2, V1"),
        (
            make_team("U1 U2", "S1", [("U1", "U2")], [("U1", "S1"), ("U2", "S1")], [hold("U1", "z")]),
            "U1 along z, U1, U1 - U2, S1",
        ),
        (  # losing one of two leaves the other, and each is named; a cut takes both
            make_team("B1 B2", "S1", [("B1", "B2"), ("B2", "B1")], [("B1", "S1"), ("B1", "S1")]),
            "B1 - B2 (all 2), B1 - S1 (all 2), S1, B1",
        ),
        (
            make_team("B1 B2", "S1", [("B1", "B2"), make_edge("B1", "B2", weight=0.5)], [("B1", "S1")]),
            "B1 - B2 (all 2), B1 - S1, S1, B1",
        ),
        (make_team("B1", "S1", [], [("B1", "S1")]), "B1 - S1, S1"),
        (SPLIT, "B1 - S1, B2 - S2, S1, S2, B1, B2, B1 - B2, B3 - B4, B4 - B5, B4"),
        (  # U1, free along x and y, alone keeps U2 at its height: without it fewer directions are free, but a new one
            make_team("U1 U2", "S1", [BY_HEIGHT], [("U2", "S1")], [hold("U1", "z")]),
            "U1 - U2, U2 - S1, S1, U1 along z, U1, U2",
        ),
    ],
    ids=["chain", "altimeter", "parallel", "uneven", "last agent", "split", "by height"],
)
def test_what_breaks_is_named(team: Team, breaking: str) -> None:
    """What a lost agent was free to do is lost with it."""
    everything_is_as_tried(team)
    assert {loss.name for loss in single_losses(team)[0] if loss.breaks} == set(breaking.split(", "))


@pytest.mark.slow
@example(SPLIT)
@given(shared_teams(most_agents=6))
def test_the_large_path_finds_what_trying_shows(team: Team) -> None:
    """Bridges, articulation points and targets seen once, with no word on lambda_min."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr("mjsheaf.checking.spectrum.EXACT_STATES", 0)
        found, (losses, exact) = fragility(team), single_losses(team)
    assert not exact
    assert not found.exact
    assert "bridges and articulation points" in found.method
    assert (found.critical, found.worst) == (losses[:MOST_CRITICAL], None)
    tried = [
        x.model_copy(update={"breaks": tuple(b for b in x.breaks if b != TRIVIAL), "lambda_min": None})
        for x in by_trying(team)
    ]
    assert sorted(losses, key=repr) == sorted((x for x in tried if x.breaks), key=repr)


def test_anchors_with_maps_of_their_own_are_named() -> None:
    skew = replace(hold("U1", "xyz"), F_tail=np.array([[1.0, 1.0, 0.0]]), F_head=np.zeros((1, 0)), weight=np.eye(1))
    skew = replace(skew, offset=np.zeros(1))
    found = single_losses(make_team("U1 B1", "S1", [], [("B1", "S1")], [skew, hold("B1", "xy")]))[0]
    names = {loss.name for loss in found if loss.kind == "anchor"}
    assert names == {"U1 to a fixed value", "B1 along x, y"}
