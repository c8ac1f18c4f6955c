"""The relative cohomology in words.

Oracles: exact ranks in fractions; the paper's failing example; teams whose freedoms are plain to see, or are counted as
parts of a graph.
"""

import itertools

import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from mjsheaf.checking.spectrum import explain
from mjsheaf.sheaf import RANK_TOLERANCE
from mjsheaf.team import Edge, Team
from mjsheaf.team.team import sparsified
from tests.builders import hold, make_edge, make_team, turn
from tests.oracles.law import coboundary
from tests.strategies import exact_rank, shared_teams, whole_number_teams


def said(team: Team) -> list[str]:
    return [direction.description for direction in explain(team).basis]


@given(st.one_of(whole_number_teams(), shared_teams()))
def test_the_dimension_is_exact_and_the_basis_is_one(team: Team) -> None:
    found, delta = explain(team), coboundary(team)
    n = delta.shape[1]
    whole = np.sign(delta) if np.any(delta != np.round(delta)) else delta  # shared maps with weights: signs say it all
    assert found.dimension == len(found.basis) == n - exact_rank(whole)
    assert found.tolerance == RANK_TOLERANCE
    if found.basis:
        still = {agent.id: [0.0] * agent.dimension for agent in team.agents}
        vectors = np.array([np.concatenate([*(still | d.motion).values()]) for d in found.basis])
        np.testing.assert_allclose(delta @ vectors.T, 0.0, atol=1e-8)
        np.testing.assert_allclose(np.abs(vectors).max(axis=1), 1.0)
        np.testing.assert_allclose(vectors.max(axis=1), 1.0)
        assert np.linalg.matrix_rank(vectors, tol=1e-6) == len(vectors)
    for direction in found.basis:
        assert all(np.any(step) for step in direction.motion.values())
        assert all(name in direction.description for name in list(direction.motion)[:2])


def test_the_failing_example_of_the_paper() -> None:
    """Aircraft that talk and track boats: all of them together are free in height, whatever their number."""
    found = explain(make_team("U1 U2 U3", "S1 S2", [("U1", "U2"), ("U2", "U3")], [("U1", "S1"), ("U3", "S2")]))
    assert found.dimension == 1
    assert found.basis[0].description == "U1, U2, U3 are free along z together"
    assert found.basis[0].motion == {"U1": [0.0, 0.0, 1.0], "U2": [0.0, 0.0, 1.0], "U3": [0.0, 0.0, 1.0]}
    crowd = [f"U{k}" for k in range(30)]
    everyone = make_team(" ".join(crowd), "S1", list(itertools.pairwise(crowd)), [("U0", "S1")])
    assert said(everyone) == ["U0, U1, U2, U3, U4, U5, U6, U7 and 22 more are free along z together"]
    assert list(explain(everyone).basis[0].motion) == crowd


def test_independent_freedoms_come_apart_within_one_connected_component() -> None:
    """Two boats held by a third, each along one oblique line only: the free lines are theirs alone."""
    rows = [np.array([[0.8, -0.6]]), np.array([[0.28, -0.96]])]
    links = [Edge(b, "B3", F, F, np.eye(1)) for b, F in zip(("B1", "B2"), rows, strict=True)]
    assert said(make_team("B1 B2 B3", "S1", links, [("B3", "S1")])) == [
        "B1 is free along (0.6, 0.8)",
        "B2 is free along (0.96, 0.28)",
    ]


def test_a_drift_along_an_oblique_line() -> None:
    across = np.array([[0.8, -0.6]])
    blind = Edge("B1", "S1", across, across, np.eye(1))
    assert said(make_team("B1 B4", "S1", [("B1", "B4")], [blind])) == ["B1, B4 are free along (0.6, 0.8) together"]
    air = make_team("B1 U4 B5", "S1", [("B1", "U4"), ("U4", "B5")], [blind], [hold("U4", "z")])
    assert said(air) == ["B1, U4, B5 are free along (0.6, 0.8, 0) together"]


def test_agents_that_move_differently_are_described_apart() -> None:
    quarter, double = turn(np.pi / 2), 2.0 * np.eye(2)
    turned = Edge("B1", "B2", quarter, np.eye(2), np.eye(2))
    assert said(make_team("B1 B2 B3", "S1", [turned, ("B2", "B3")], [])) == [
        "B1 along x, B2 and B3 along y, moving together",
        "B1 along y, B2 and B3 along -x, moving together",
    ]
    scaled = Edge("B1", "B2", np.eye(2), double, np.eye(2))
    assert said(make_team("B1 B2", "S1", [scaled], [], [hold("B1", "y")])) == [
        "B1 along x, B2 along x (0.5 times as far), moving together"
    ]


def test_barely_held_directions_are_told() -> None:
    """Two aircraft whose height is held by a faint altimeter alone; the ratio is to the largest eigenvalue."""
    held = make_team("U1 U2 B1", "S1", [("U1", "U2")], [("U1", "S1"), ("B1", "S1")], [hold("U2", "z", 1e-4)])
    found = explain(held)
    assert found.dimension == 0
    assert [d.description for d in found.near_null] == ["U1, U2 are nearly free along z together"]
    values = np.linalg.eigvalsh(held.dirichlet.H.toarray())
    assert found.near_null[0].eigenvalue == pytest.approx(values[0], rel=1e-6)
    assert found.near_null[0].ratio == pytest.approx(values[0] / values[-1], rel=1e-6)
    firm = make_team("U1 U2 B1", "S1", [("U1", "U2")], [("U1", "S1"), ("B1", "S1")], [hold("U2", "z", 1e-2)])
    assert explain(firm).near_null == []


def test_free_directions_do_not_count_as_barely_held() -> None:
    both = make_team("U1 U2", "S1", [], [("U1", "S1"), ("U2", "S1")], [hold("U2", "z", 1e-5)])
    found = explain(both)
    assert [d.description for d in found.basis] == ["U1 is free along z"]
    assert [d.description for d in found.near_null] == ["U2 is nearly free along z"]
    assert found.near_null[0].eigenvalue == pytest.approx(1e-5)


def test_at_most_three_barely_held_directions() -> None:
    names = [f"U{k}" for k in range(5)]
    faint = [hold(v, "z", 1e-5 * (k + 1)) for k, v in enumerate(names)]
    found = explain(make_team(" ".join(names), "S1", [], [(v, "S1") for v in names], faint))
    assert [d.description for d in found.near_null] == [f"U{k} is nearly free along z" for k in range(3)]


# -- at size ---------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**31), st.lists(st.integers(1, 4), min_size=1, max_size=4))
def test_disjoint_motions_are_found_again(seed: int, sizes: list[int]) -> None:
    """Motions of disjoint groups of coordinates, mixed at random, come out as they were."""
    rng = np.random.default_rng(seed)
    motions = np.zeros((sum(sizes) + 2, len(sizes)))
    for k, block in enumerate(np.split(rng.permutation(len(motions))[: sum(sizes)], np.cumsum(sizes)[:-1])):
        motions[block, k] = rng.uniform(0.5, 1.0, len(block))
    motions /= motions.max(axis=0)
    order = np.argsort(np.argmax(motions != 0.0, axis=0))
    mixed = motions @ np.linalg.qr(rng.standard_normal((len(sizes), len(sizes))))[0]
    found = sparsified(csr_array(mixed), np.arange(len(mixed))).toarray()
    np.testing.assert_allclose(found, motions[:, order], atol=1e-9)


@pytest.mark.parametrize("name", ["shared", "local_frame"])
def test_hundreds_of_vehicles(name: str) -> None:
    """With maps that compare whole coordinates the freedoms can be counted: parts that nothing holds, axis by axis."""
    rng = np.random.default_rng(5)
    count = 500
    names = [f"{'U' if rng.uniform() < 0.5 else 'B'}{k}" for k in range(count)]
    pairs = cKDTree(rng.uniform(size=(count, 2))).query_pairs(np.sqrt(8.0 / (np.pi * count)))
    links = [(names[i], names[j]) for i, j in sorted(pairs)]
    seen = [(names[i], target) for target in ("S1", "V1") for i in rng.choice(count, 30, replace=False).tolist()]

    def turned(a: str, b: str) -> Edge:
        return make_edge(a, b, name=name, attitude=tuple(rng.uniform(-3.0, 3.0, 3)))

    found = explain(make_team(" ".join(names), "S1 V1", [turned(*e) for e in links], [turned(*e) for e in seen]))
    expected = []
    for kinds in ("BUSV", "BUSV", "UV"):  # who has x, y, z
        graph = nx.Graph()
        graph.add_nodes_from(v for v in [*names, "S1", "V1"] if v[0] in kinds)
        graph.add_edges_from((a, b) for a, b in links + seen if a[0] in kinds and b[0] in kinds)
        expected += [part for part in nx.connected_components(graph) if not part & {"S1", "V1"}]
    assert found.dimension == len(expected) >= 12
    assert sorted(sorted(d.motion) for d in found.basis) == sorted(map(sorted, expected))
    for direction in found.basis:
        steps = np.array([np.pad(step, (0, 3 - len(step))) for step in direction.motion.values()])
        assert np.all(steps == steps[0])
        assert np.count_nonzero(steps[0]) == 1
        assert steps.max() == 1.0
