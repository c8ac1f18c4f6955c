"""Laws of the coboundary and the Laplacian on random sheaves.

Oracles: the definitions, as dense matrices written block by block in `strategies`, and ranks by exact elimination in
fractions.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf import Sheaf
from mjsheaf.errors import SheafError
from tests.strategies import SheafSpec, exact_rank, orthogonal, sheaves, split, vectors


@given(sheaves(), st.data())
def test_the_adjoint_of_the_coboundary_pulls_edges_back_to_their_ends(spec: SheafSpec, data: st.DataObject) -> None:
    """<delta x, y>_K = <x, delta^T K y>, where vertex i gets F_i^T K y_e from edges that leave it, less from others."""
    x, y = data.draw(vectors(spec.n)), data.draw(vectors(spec.m))
    pulled, row = {v: np.zeros(n) for v, n in spec.stalks.items()}, 0
    for e in spec.edges:
        force = e.K @ y[row : row + len(e.b)]
        pulled[e.tail] += e.F_tail.T @ force
        pulled[e.head] -= e.F_head.T @ force
        row += len(e.b)
    pulled_back = np.concatenate(list(pulled.values()))
    delta = spec.build().coboundary()
    assert (delta @ x) @ spec.K @ y == x @ pulled_back
    np.testing.assert_array_equal(delta.T @ (spec.K @ y), pulled_back)


@given(sheaves(), st.data())
def test_dirichlet_energy_is_the_quadratic_form_of_the_residual(spec: SheafSpec, data: st.DataObject) -> None:
    x = data.draw(vectors(spec.n))
    sheaf = spec.build()
    np.testing.assert_allclose(sheaf.dirichlet_energy(x), spec.energy(x), rtol=1e-12)
    np.testing.assert_array_equal(sheaf.offset(), spec.b)
    step = data.draw(vectors(spec.n))
    slope = sheaf.laplacian() @ x - spec.delta.T @ spec.K @ spec.b
    curvature = 0.5 * step @ (sheaf.laplacian() @ step)
    np.testing.assert_allclose(
        sheaf.dirichlet_energy(x + step), spec.energy(x) + slope @ step + curvature, rtol=1e-9, atol=1e-9
    )


@given(sheaves())
def test_betti_numbers_are_exact(spec: SheafSpec) -> None:
    """h0 = n - rank and h1 = m - rank, so that h0 - h1 = n - m, the Euler characteristic."""
    rank = exact_rank(spec.delta)
    h0, h1 = spec.build().betti()
    assert (h0, h1) == (spec.n - rank, spec.m - rank)
    assert h0 - h1 == spec.n - spec.m


@given(sheaves())
def test_global_sections_are_the_kernel_of_the_laplacian(spec: SheafSpec) -> None:
    sheaf = spec.build()
    sections = sheaf.global_sections()
    assert sections.shape == (spec.n, spec.n - exact_rank(spec.delta))
    np.testing.assert_allclose(sections.T @ sections, np.eye(sections.shape[1]), atol=1e-12)
    np.testing.assert_allclose(sheaf.laplacian() @ sections, 0.0, atol=1e-10)
    values = np.linalg.eigvalsh(sheaf.laplacian().toarray())
    assert np.sum(values > 1e-9 * values.max(initial=0.0)) == spec.n - sections.shape[1]


@given(sheaves(), st.integers(0, 2**31))
def test_the_choice_of_edge_frames_does_not_matter(spec: SheafSpec, seed: int) -> None:
    """An orthogonal change of the coordinates of edge stalks: the paper's Remark on range and bearing, (ii)."""
    turned = SheafSpec(spec.stalks, tuple(e.in_frame(orthogonal(len(e.b), seed + k)) for k, e in enumerate(spec.edges)))
    one, other = spec.build(), turned.build()
    np.testing.assert_allclose(other.laplacian().toarray(), one.laplacian().toarray(), atol=1e-11)
    assert other.betti() == one.betti()
    x = np.random.default_rng(seed).standard_normal(spec.n)
    np.testing.assert_allclose(other.dirichlet_energy(x), one.dirichlet_energy(x), rtol=1e-11)


@given(sheaves(), st.integers(0, 2**31))
def test_nearest_global_section_is_the_orthogonal_projection(spec: SheafSpec, seed: int) -> None:
    """With an offset it is that on the states with these differences.

    Where no state has them, on those of the least residual in the edges' inner products, as of the extension.
    """
    sheaf = spec.build()
    rng = np.random.default_rng(seed)
    x, b, c = rng.standard_normal(spec.n), rng.standard_normal(sheaf.shape[0]), rng.standard_normal(spec.n)
    found = sheaf.nearest_global_section(x, offset=b)
    weighted = spec.delta.T @ spec.K
    tolerance = float(1e-12 * (1.0 + np.linalg.norm(found)) * (1.0 + np.linalg.norm(weighted @ spec.delta, 2)))
    np.testing.assert_allclose(weighted @ (spec.delta @ found - b), 0.0, atol=tolerance)
    np.testing.assert_allclose(sheaf.global_sections().T @ (x - found), 0.0, atol=tolerance)
    moved = sheaf.nearest_global_section(x + c, offset=b + spec.delta @ c)
    np.testing.assert_allclose(moved, found + c, atol=float(1e-9 * (1.0 + np.linalg.norm(found))))
    np.testing.assert_allclose(sheaf.nearest_global_section(found, offset=b), found, atol=1e-9)
    section = sheaf.nearest_global_section(x)
    np.testing.assert_allclose(sheaf.nearest_global_section(x, offset=0.0 * b), section, atol=1e-12)
    np.testing.assert_allclose(spec.delta @ section, 0.0, atol=1e-11)
    np.testing.assert_allclose(sheaf.nearest_global_section(section), section, atol=1e-12)
    np.testing.assert_allclose(sheaf.global_sections().T @ (x - section), 0.0, atol=1e-12)
    by_vertex = sheaf.nearest_global_section(split(spec, list(spec.stalks), x))
    assert list(by_vertex) == list(spec.stalks)
    np.testing.assert_array_equal(np.concatenate(list(by_vertex.values())), section)


@pytest.mark.parametrize(
    ("offset", "message"),
    [
        ([0.0], r"offset has shape \(1,\); expected \(4,\)"),
        (np.zeros((4, 1)), r"offset has shape \(4, 1\); expected \(4,\)"),
        ([np.nan] * 4, "offset: an entry is not finite"),
        ([10**400] * 4, "offset: not an array of numbers"),
        ("north", "offset: not an array of numbers"),
    ],
)
def test_an_offset_that_does_not_fit_is_refused(offset: Any, message: str) -> None:
    sheaf = Sheaf({"A": 2, "B": 2, "C": 2})
    sheaf.add_edge("A", "B", np.eye(2), np.eye(2))
    sheaf.add_edge("B", "C", np.eye(2), np.eye(2))
    with pytest.raises(SheafError, match=message):
        sheaf.nearest_global_section(np.zeros(6), offset=offset)
