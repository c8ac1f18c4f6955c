"""Local sections over a subgraph, and a basis of H^1.

Oracles: dense null spaces of coboundaries written block by block in `strategies`, exact ranks, cycles by hand.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space

from mjsheaf import Sheaf
from mjsheaf.errors import SheafError
from tests.builders import bundle_on_a_grid
from tests.strategies import SheafSpec, exact_rank, sheaves


@given(sheaves(), st.data())
def test_local_sections_agree_along_the_edges_of_the_subgraph(spec: SheafSpec, data: st.DataObject) -> None:
    names = data.draw(st.permutations(list(spec.stalks)))
    chosen = names[: data.draw(st.integers(1, len(names)))]
    inside = [k for k, e in enumerate(spec.edges) if e.tail in chosen and e.head in chosen]
    edges = None
    if data.draw(st.booleans()):
        edges = data.draw(st.lists(st.sampled_from(inside), unique=True)) if inside else []
    kept = sorted(inside if edges is None else edges)
    part = SheafSpec({v: spec.stalks[v] for v in chosen}, tuple(spec.edges[k] for k in kept))
    sheaf = spec.build()
    sections = sheaf.local_sections(chosen, edges)
    np.testing.assert_allclose(sections.T @ sections, np.eye(sections.shape[1]), atol=1e-12)
    other = null_space(part.delta, rcond=1e-9) if part.delta.size else np.eye(part.n)
    assert sections.shape == other.shape
    np.testing.assert_allclose(sections @ sections.T, other @ other.T, atol=1e-10)
    # What is a section on the whole is one here: the restriction of sections.
    whole = sheaf.global_sections()[spec.columns(chosen)]
    np.testing.assert_allclose(sections @ (sections.T @ whole), whole, atol=1e-10)


def test_edges_go_by_the_numbers_that_adding_them_gave() -> None:
    """Parallel edges apart, whatever the order in which shapes were bundled."""
    sheaf = Sheaf({"a": 2, "b": 2, "c": 1})
    x, y = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    mixed = sheaf.add_mixed_edges(
        ["a", "a", "b", "a"], ["b", "b", "c", "b"], [x, np.eye(2), x, y], [x, np.eye(2), np.ones((1, 1)), y]
    )
    late = sheaf.add_edge("c", "a", np.ones((1, 1)), y)
    assert [*mixed, late] == [0, 1, 2, 3, 4]
    dimension = {(): 4, (0,): 3, (3,): 3, (1,): 2, (0, 3): 2, (0, 1, 3): 2}
    for edges, expected in dimension.items():
        assert sheaf.local_sections(["a", "b"], edges).shape == (4, expected)
    section = sheaf.local_sections(["b", "a"], [3])
    np.testing.assert_allclose(section[1], section[3], atol=1e-14)
    assert np.abs(section[0] - section[2]).max() > 0.5
    assert sheaf.local_sections(["a", "b"]).shape == (4, 2)
    assert sheaf.local_sections(["a", "c"]).shape == (3, 2)
    assert sheaf.local_sections(["c"]).shape == (1, 1)


@pytest.mark.parametrize(
    ("vertices", "edges", "message"),
    [
        ([], None, "at least one vertex"),
        (["a", "z"], None, "unknown vertex 'z'"),
        (["a", "a"], None, "named twice"),
        (["a", "b"], [1], r"edges \[1\]: expected different numbers of edges between these vertices, \[0\]"),
        (["a", "b"], [0, 0], "expected different numbers"),
        (["a", "b"], [2], "expected different numbers"),
        (["a", "b"], [-1], "expected different numbers"),
        (["a", "b"], [True], "expected different numbers"),
        (["a", "b"], [("a", "b")], "expected different numbers"),
    ],
)
def test_what_is_no_subgraph_is_refused(vertices: list[Any], edges: list[Any] | None, message: str) -> None:
    sheaf = Sheaf({"a": 1, "b": 1, "c": 1})
    one = np.ones((1, 1))
    sheaf.add_edge("a", "b", one, one)
    sheaf.add_edge("b", "c", one, one)
    with pytest.raises(SheafError, match=message):
        sheaf.local_sections(vertices, edges)


@given(sheaves())
def test_a_basis_of_h1_is_orthonormal_and_complements_the_image(spec: SheafSpec) -> None:
    sheaf = spec.build()
    basis = sheaf.cohomology_basis()
    assert basis.shape == (spec.m, sheaf.betti()[1])
    assert basis.shape[1] == spec.m - exact_rank(spec.delta)
    np.testing.assert_allclose(basis.T @ spec.K @ basis, np.eye(basis.shape[1]), atol=1e-10)
    np.testing.assert_allclose(spec.delta.T @ spec.K @ basis, 0.0, atol=1e-10)
    if spec.m:
        assert np.linalg.matrix_rank(np.hstack([spec.delta, basis]), tol=1e-8) == spec.m


@pytest.mark.slow
def test_h1_of_large_sheaves() -> None:
    """A cycle of 2,000 planes is over what is decomposed densely, with two classes; a large grid has too many."""
    rng = np.random.default_rng(0)
    n = 2000
    F = np.array([[[c, -s], [s, c]] for c, s in ((np.cos(a), np.sin(a)) for a in rng.uniform(0, 6.3, n))])
    cycle = Sheaf(dict.fromkeys(range(n), 2))
    cycle.add_edges(list(range(n)), [*range(1, n), 0], F, np.roll(F, -1, axis=0))
    assert cycle.betti() == (2, 2)
    basis = cycle.cohomology_basis()
    np.testing.assert_allclose(basis.T @ basis, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(cycle.coboundary().T @ basis, 0.0, atol=1e-10)

    grid, _ = bundle_on_a_grid(60, k=2)
    with pytest.raises(SheafError, match=r"6962 .* 14160"):
        grid.cohomology_basis()
    tree, ones = Sheaf(dict.fromkeys(range(3600), 1)), np.ones((3599, 1, 1))
    tree.add_edges(list(range(3599)), list(range(1, 3600)), ones, ones)
    assert tree.cohomology_basis().shape == (3599, 0)


def test_the_class_of_a_cycle_goes_round_it() -> None:
    """Edges alternate in direction; weights enter the representative: K y is the same all the way round."""
    n = 5
    weight = np.array([1e-3, 1.0, 2.0, 50.0, 1e3])
    sheaf = Sheaf(dict.fromkeys(range(n), 1))
    sign = np.array([1.0, -1.0, 1.0, 1.0, -1.0])
    one = np.ones((1, 1))
    for v in range(n):
        tail, head = (v, (v + 1) % n) if sign[v] > 0 else ((v + 1) % n, v)
        sheaf.add_edge(tail, head, one, one, weight=weight[v])
    expected = sign / weight
    expected /= np.sqrt(expected @ (weight * expected))
    basis = sheaf.cohomology_basis()
    np.testing.assert_allclose(basis * np.sign(basis[0]), expected[:, None], rtol=1e-10)
