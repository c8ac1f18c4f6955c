"""Cohomology of sheaves that the paper and its sources know by heart.

Oracles: components of a graph by networkx, and its independent cycles; the paper's constant sheaf and its projection
between boats in R^2 and aircraft in R^3.
"""

import itertools
from collections.abc import Iterable

import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf import Sheaf
from mjsheaf.sheaf import RANK_TOLERANCE

FLAT = np.eye(2, 3)  # R^3 -> R^2, the paper's projection

graphs = st.integers(1, 7).flatmap(
    lambda n: st.tuples(
        st.just(n),
        st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda e: e[0] != e[1]), max_size=12),
    )
)


def parts_of(n: int, edges: Iterable[tuple[int, int]]) -> list[set[int]]:
    """The vertices of each connected component."""
    graph = nx.Graph(edges)
    graph.add_nodes_from(range(n))
    return list(nx.connected_components(graph))


def constant_sheaf(n: int, edges: Iterable[tuple[int, int]], k: int) -> Sheaf:
    sheaf = Sheaf(dict.fromkeys(range(n), k))
    for i, j in edges:
        sheaf.add_edge(i, j, np.eye(k), np.eye(k))
    return sheaf


@given(graphs, st.integers(1, 3))
def test_constant_sheaf_counts_components_and_cycles(graph: tuple[int, list[tuple[int, int]]], k: int) -> None:
    """H^0 is R^k for each component, H^1 is R^k for each independent cycle; parallel edges make cycles."""
    n, edges = graph
    parts = len(parts_of(n, edges))
    sheaf = constant_sheaf(n, edges, k)
    assert sheaf.betti() == (k * parts, k * (len(edges) - n + parts))


@given(graphs, st.integers(1, 3), st.data())
def test_constant_sheaf_relative_to_a_boundary(
    graph: tuple[int, list[tuple[int, int]]], k: int, data: st.DataObject
) -> None:
    """Only the components without a boundary vertex are free; on a connected graph nothing is (the paper's Example)."""
    n, edges = graph
    boundary = data.draw(st.lists(st.integers(0, n - 1), unique=True))
    loose = [part for part in parts_of(n, edges) if part.isdisjoint(boundary)]
    assert constant_sheaf(n, edges, k).relative_sections(boundary).shape[1] == k * len(loose)


def test_a_cycle_with_a_twist_has_no_sections() -> None:
    """Going round a cycle of lines turns the sign: no section but zero, and no class in H^1."""
    sheaf = Sheaf(dict.fromkeys("abc", 1))
    one = np.ones((1, 1))
    sheaf.add_edge("a", "b", one, one)
    sheaf.add_edge("b", "c", one, one)
    sheaf.add_edge("c", "a", one, -one)
    assert sheaf.betti() == (0, 0)


@pytest.mark.parametrize("links", [[], [(0, 1)], [(0, 1), (1, 2)], [(0, 1), (1, 2), (0, 2)]])
def test_aircraft_that_see_only_a_boat_are_free_in_height(links: list[tuple[int, int]]) -> None:
    """One height for each group of aircraft that talk, the group moving together: the paper's failing case."""
    sheaf = Sheaf({**dict.fromkeys(range(3), 3), "boat": 2})
    for i, j in links:
        sheaf.add_edge(i, j, np.eye(3), np.eye(3))
    for i in range(3):
        sheaf.add_edge(i, "boat", FLAT, np.eye(2))
    free = sheaf.relative_sections(["boat"])
    groups = parts_of(3, links)
    up = np.zeros((9, len(groups)))
    for column, group in enumerate(groups):
        up[[3 * i + 2 for i in group], column] = 1.0 / np.sqrt(len(group))
    np.testing.assert_allclose(free @ free.T, up @ up.T, atol=1e-12)


@pytest.mark.parametrize("seen", [[0], [0, 1], [0, 1, 2]])
def test_boats_that_see_an_aircraft_are_held(seen: list[int]) -> None:
    sheaf = Sheaf({**dict.fromkeys(range(3), 2), "aircraft": 3})
    for i, j in itertools.pairwise(range(3)):
        sheaf.add_edge(i, j, np.eye(2), np.eye(2))
    for i in seen:
        sheaf.add_edge(i, "aircraft", np.eye(2), FLAT)
    assert sheaf.relative_sections(["aircraft"]).shape == (6, 0)
    assert sheaf.betti() == (3, 2 * (len(seen) - 1))


def test_the_rank_tolerance_is_relative_and_as_stated() -> None:
    """A singular value s of delta counts as zero when s <= rtol s_max, whatever the scale of the maps."""
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    for scale in (1e-6, 1.0, 1e6):
        for smallest in (0.5 * RANK_TOLERANCE, 2.0 * RANK_TOLERANCE, 1e-3):
            F = scale * turn @ np.diag([1.0, 0.7, smallest]) @ turn.T
            sheaf = Sheaf({"a": 3, "b": 3})
            sheaf.add_edge("a", "b", F, F)
            null = smallest <= RANK_TOLERANCE
            assert sheaf.betti() == (3 + null, null)
            assert sheaf.relative_sections(["b"]).shape[1] == null
            assert sheaf.harmonic_extension({"b": np.ones(3)}).unique is not null
            assert sheaf.betti(rtol=1.5 * smallest) == (4, 1)
            assert sheaf.global_sections(rtol=0.5 * smallest).shape[1] == 3
            assert sheaf.relative_sections(["b"], rtol=1.5 * smallest).shape[1] == 1
