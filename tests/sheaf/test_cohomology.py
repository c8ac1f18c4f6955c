"""Cohomology of sheaves that the paper and its sources know by heart.

Oracles: components of a graph by networkx, and its independent cycles; the paper's constant sheaf.
"""

import networkx as nx
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf import Sheaf
from mjsheaf.sheaf import RANK_TOLERANCE

graphs = st.integers(1, 7).flatmap(
    lambda n: st.tuples(
        st.just(n),
        st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda e: e[0] != e[1]), max_size=12),
    )
)


@given(graphs, st.integers(1, 3), st.data())
def test_constant_sheaf_counts_components_and_cycles(
    graph: tuple[int, list[tuple[int, int]]], k: int, data: st.DataObject
) -> None:
    """H^0 is R^k for each component, H^1 is R^k for each independent cycle; parallel edges make cycles.

    Relative to a boundary only components without it are free; on a connected graph nothing is (the paper's Example).
    """
    n, edges = graph
    boundary = data.draw(st.lists(st.integers(0, n - 1), unique=True))
    graph_of_edges = nx.Graph(edges)
    graph_of_edges.add_nodes_from(range(n))
    parts = list(nx.connected_components(graph_of_edges))
    sheaf = Sheaf(dict.fromkeys(range(n), k))
    for i, j in edges:
        sheaf.add_edge(i, j, np.eye(k), np.eye(k))
    assert sheaf.betti() == (k * len(parts), k * (len(edges) - n + len(parts)))
    loose = [part for part in parts if part.isdisjoint(boundary)]
    assert sheaf.relative_sections(boundary).shape[1] == k * len(loose)


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
