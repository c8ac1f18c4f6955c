"""Repairs of a team.

Oracle: every set of candidates of a small team, tried in order of size by exact rank; lambda_min from a fresh team.
"""

import itertools
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given

from mjsheaf.checking.repairs import Augmentation, plan_augmentation, suggest_edges
from mjsheaf.checking.spectrum import explain
from mjsheaf.team import Edge, Team, anchor, restriction_maps
from tests.builders import Array, known, make_team, turn
from tests.oracles.law import coboundary
from tests.strategies import exact_rank, examples, shared_teams, whole_number_teams


def candidate_rows(team: Team) -> list[Array]:
    """Rows on the agents of every edge and anchor that could be added, from their definition."""
    first = np.cumsum([0, *(a.dimension for a in team.agents)])
    unit = np.eye(first[-1])
    blocks = [unit[first[i] : first[i + 1]] for i in range(len(team.agents))]
    rows = [row[None] for row in unit]
    rows += [block[: t.dimension] for block in blocks for t in team.targets]
    for a, b in itertools.combinations(blocks, 2):
        m = min(len(a), len(b))
        rows.append(a[:m] - b[:m])
    return rows


def smallest_by_trying(team: Team) -> int:
    """Size of the smallest set of candidates that leaves nothing free."""
    delta = np.sign(coboundary(team))
    useful = [C for C in candidate_rows(team) if exact_rank(np.vstack([delta, C])) > exact_rank(delta)]
    for size in itertools.count():
        for chosen in itertools.combinations(useful, size):
            if exact_rank(np.vstack([delta, *chosen])) == delta.shape[1]:
                return size
    raise AssertionError


def edge_as_described(description: str, team: Team) -> tuple[str, Edge]:
    """Kind and edge of "give A2 an altimeter (anchor along z)", "let A1 talk to A4", "let A3 sense T2"."""
    words = description.split()
    dimension = {m.id: m.dimension for m in team.members}
    if words[0] == "give":
        F = np.eye(dimension[words[1]])[["xyz".index(words[-1].strip("()"))]]
        return "anchor", anchor(words[1], F, np.zeros(1), np.eye(1))
    kind, head = ("sensing", words[3]) if words[2] == "sense" else ("communication", words[4])
    maps = restriction_maps("shared", dimension[words[1]], dimension[head])
    return kind, Edge(words[1], head, *maps, np.eye(len(maps[0])))


def repaired(team: Team, descriptions: list[str]) -> Team:
    """The team with what a user reads; anchors hold the value 0."""
    edges: dict[str, list[Edge]] = {"communication": [], "sensing": [], "anchor": []}
    for description in descriptions:
        kind, extra = edge_as_described(description, team)
        edges[kind].append(extra)
    return Team(
        team.agents,
        team.targets,
        [*team.communication, *edges["communication"]],
        [*team.sensing, *edges["sensing"]],
        anchors=[*team.anchors, *edges["anchor"]],
    )


def places_of(team: Team) -> Array:
    """Positions of a team's vehicles on a spiral, so that no two distances are equal."""
    k = np.arange(len(team.members))
    return np.stack([(1.0 + 0.1 * k) * np.cos(k), (1.0 + 0.1 * k) * np.sin(k), 0.3 * k], axis=1)


def planned(team: Team, **limits: int) -> Augmentation:
    """Return the repairs of a team with free directions."""
    return known(plan_augmentation(team, places_of(team), **limits))


def length(team: Team, descriptions: list[str]) -> float:
    """Sum of the distances that the edges of a set span; a position sensor counts as far as vehicles are apart."""
    places, total = places_of(team), 0.0
    for kind, edge in (edge_as_described(description, team) for description in descriptions):
        if kind != "anchor":
            total += float(np.linalg.norm(places[team.index[edge.tail]] - places[team.index[edge.head]]))
        elif not edge.F_tail[:, 2:].any():
            total += float(np.linalg.norm(np.ptp(places, axis=0)))
    return round(total, 6)


def check(plan: Augmentation, team: Team) -> None:
    """The set repairs the team, no repair is redundant, and its numbers are those of the repaired team."""
    names = [repair.description for repair in plan.repairs]
    mended = repaired(team, names)
    assert mended.dirichlet.unique
    assert plan.needed == len(plan.repairs)
    lowest = np.linalg.eigvalsh(mended.dirichlet.H.toarray())[0]
    assert plan.lambda_min == pytest.approx(lowest, rel=1e-6)
    for k, repair in enumerate(plan.repairs):
        rest = [*names[:k], *names[k + 1 :]]
        assert not repaired(team, rest).dirichlet.unique
        freed = explain(team).dimension - explain(repaired(team, [repair.description])).dimension
        assert repair.nullity_reduction == freed
        assert repair.kind == edge_as_described(repair.description, team)[0]


@pytest.mark.slow
@examples(80)
@given(shared_teams(most_agents=3))
def test_no_smaller_set_mends(team: Team) -> None:
    plan = plan_augmentation(team, places_of(team))
    assert smallest_by_trying(team) == (plan.needed if plan else 0)
    if plan is None:
        return
    check(plan, team)
    assert plan.exact


@given(whole_number_teams())
def test_any_maps_are_mended(team: Team) -> None:
    """An edge with special maps may get a second one that compares whole coordinates."""
    if (plan := plan_augmentation(team, places_of(team))) is not None:
        check(plan, team)
    assert (plan is None) == team.dirichlet.unique


def every_smallest_set(team: Team, size: int) -> Iterator[float]:
    """Yield the length of each set of that many candidates that mends a team."""
    names = [f"give {a.id} a sensor ({'xyz'[axis]})" for a in team.agents for axis in range(a.dimension)]
    names += [f"let {a} sense {t}" for a in team.agent_ids for t in team.target_ids]
    names += [f"let {a} talk to {b}" for a, b in itertools.combinations(team.agent_ids, 2)]
    delta = coboundary(team)
    for chosen in itertools.combinations(zip(names, candidate_rows(team), strict=True), size):
        rows = np.vstack([delta, *(C for _, C in chosen)])
        if np.linalg.matrix_rank(rows) == delta.shape[1]:
            yield length(team, [name for name, _ in chosen])


@pytest.mark.parametrize(
    ("agents", "links", "seen"),
    [
        ("U1 U2 U3 U4", [("U1", "U2"), ("U2", "U3"), ("U3", "U4")], [("U1", "S1"), ("U4", "S1")]),
        ("U1 U2 B1 B2", [("U1", "U2"), ("B1", "B2")], [("U1", "S1")]),
        ("B1 B2 B3", [("B1", "B2")], []),
        ("U1 U2 B1", [("U1", "B1"), ("B1", "U2")], [("B1", "V1")]),
    ],
)
def test_among_the_smallest_sets_the_nearest_is_proposed(
    agents: str, links: list[tuple[str, str]], seen: list[tuple[str, str]]
) -> None:
    loose = make_team(agents, "S1 V1", links, seen)
    plan = planned(loose)
    assert plan.needed <= 2
    chosen = [repair.description for repair in plan.repairs]
    assert length(loose, chosen) == min(every_smallest_set(loose, plan.needed))


def test_repairs_are_told_in_the_words_of_the_team() -> None:
    lost = make_team("B1 B2 B3", "S1 S2", [("B1", "B2")], [("B1", "S1"), ("B2", "S2")])
    plan = planned(lost)
    assert [x.description for x in plan.repairs] == [
        min(
            ("let B1 talk to B3", "let B2 talk to B3", "let B3 sense S1", "let B3 sense S2"),
            key=lambda name: length(lost, [name]),
        )
    ]
    blind = make_team("B1", "S1", [], [Edge("B1", "S1", np.array([[1.0, 0]]), np.array([[1.0, 0]]), np.eye(1))])
    plan = planned(blind)
    assert [x.description for x in plan.repairs] == ["let B1 sense S1 and compare x, y"]
    check(plan, blind)


# -- beyond the sizes that are tried one by one ----------------------------------------------------------------


LARGE = [
    make_team("U1 U2 U3 B1", "S1 V1", [("U1", "U2"), ("U3", "B1")], [("U1", "S1")]),
    make_team("U1 U2 U3 U4", "S1", [("U1", "U2")], [(f"U{k}", "S1") for k in (1, 2, 3, 4)]),
    make_team("B1 B2 B3 B4 B5", "S1", [("B1", "B2"), ("B3", "B4")], []),
    make_team("B1 B2", "S1", [Edge("B1", "B2", turn(0.5), np.eye(2), np.eye(2))], []),
]


@pytest.mark.slow
@pytest.mark.parametrize("k", range(len(LARGE)))
@pytest.mark.parametrize("limit", ["sets", "directions", "classes"])
def test_the_greedy_plan_mends_with_nothing_to_spare(k: int, limit: str) -> None:
    fewest = planned(LARGE[k])
    assert fewest.exact
    plan = planned(LARGE[k], **{limit: 0})
    check(plan, LARGE[k])
    assert plan.needed >= fewest.needed
    if plan.exact:
        assert plan.needed == fewest.needed


def test_it_says_whether_the_plan_is_the_smallest() -> None:
    """Four heights need four holds whatever they are; a boat and an aircraft adrift could do with fewer than found."""
    heights = planned(LARGE[1], directions=0)
    assert (heights.needed, heights.exact) == (3, True)
    adrift = planned(LARGE[2], directions=0)
    assert adrift.needed == 3
    assert adrift.exact  # six coordinates, two axes


def test_many_agents_of_one_kind() -> None:
    """Sixty aircraft in a ring over a boat: any altimeter will do, and all of them are counted."""
    names = [f"U{k}" for k in range(60)]
    links = list(itertools.pairwise([*names, names[0]]))
    plan = planned(make_team(" ".join(names), "S1", links, [(names[0], "S1")]))
    assert (plan.needed, plan.exact) == (1, True)
    assert plan.repairs[0].description.endswith("an altimeter (anchor along z)")


def test_edges_that_connect_are_the_shortest() -> None:
    """There is one edge fewer than there are parts, and the agent nearest to a target senses it."""
    apart = make_team("B1 B2 B3 B4", "S1", [("B1", "B2")], [])
    places = np.array([[0, 0, 0], [9.0, 0, 0], [0, 4.0, 0], [9.0, 3.0, 0], [1.0, 5.0, 0]])
    assert suggest_edges(apart, places) == {"communication": [["B1", "B3"], ["B2", "B4"]], "sensing": [["B3", "S1"]]}
    whole = make_team("B1 B2", "S1", [("B1", "B2")], [("B1", "S1")])
    assert suggest_edges(whole, places[[0, 1, 4]]) == {}
