"""Inner products on vertex stalks (the paper's first definition).

Oracles: the definitions as dense matrices; a change of basis, under which nothing may change but coordinates; numpy's
least squares in coordinates in which the inner product is the identity.
"""

from collections.abc import Hashable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import block_diag

from mjsheaf import Sheaf
from mjsheaf.errors import SheafError
from tests.builders import bundle_on_a_grid
from tests.strategies import EdgeSpec, SheafSpec, sheaves, sheaves_with_boundary, split, vectors

Array = NDArray[np.float64]
Products = dict[Hashable, Array]


def draw_products(data: st.DataObject, spec: SheafSpec) -> Products:
    """An inner product for some of the vertices, with whole entries."""
    chosen = data.draw(st.lists(st.sampled_from(list(spec.stalks)), unique=True))
    products = {}
    for v in chosen:
        n = spec.stalks[v]
        A = np.array(data.draw(st.lists(st.integers(-2, 2), min_size=n * n, max_size=n * n)), float).reshape(n, n)
        products[v] = A @ A.T + data.draw(st.integers(1, 5)) * np.eye(n)
    return products


def build(spec: SheafSpec, products: Products) -> Sheaf:
    sheaf = spec.build()
    for v, M in products.items():
        sheaf.set_inner_product(v, M)
    return sheaf


def dense(spec: SheafSpec, products: Products, vertices: list[Hashable] | None = None) -> Array:
    """M, shape (n, n)."""
    names = list(spec.stalks) if vertices is None else vertices
    return block_diag(np.zeros((0, 0)), *(products.get(v, np.eye(spec.stalks[v])) for v in names))


@given(sheaves(), st.data())
def test_adjoint_and_laplacian(spec: SheafSpec, data: st.DataObject) -> None:
    products = draw_products(data, spec)
    sheaf, M = build(spec, products), dense(spec, products)
    x, y = data.draw(vectors(spec.n)), data.draw(vectors(spec.m))
    adjoint = sheaf.adjoint_coboundary()
    assert adjoint.shape == (spec.n, spec.m)
    np.testing.assert_allclose((spec.delta @ x) @ spec.K @ y, x @ M @ (adjoint @ y), rtol=1e-10, atol=1e-9)
    L = sheaf.laplacian().toarray()
    np.testing.assert_allclose(L, adjoint @ spec.delta, atol=1e-9)
    np.testing.assert_allclose(M @ L, (M @ L).T, atol=1e-9)
    values = np.linalg.eigvals(L)
    scale = max(1.0, np.abs(values).max(initial=0.0))
    assert np.abs(values.imag).max(initial=0.0) <= 1e-6 * scale  # defective to rounding: eps to the power 1 / 2 or so
    assert values.real.min(initial=0.0) >= -1e-6 * scale
    U = np.linalg.cholesky(M).T if spec.n else M
    symmetric = np.linalg.eigvalsh(U @ L @ np.linalg.inv(U)) if spec.n else np.zeros(0)
    np.testing.assert_allclose(np.sort(values.real), symmetric, atol=1e-6 * scale)


@given(sheaves(), st.data())
def test_what_an_inner_product_leaves_alone(spec: SheafSpec, data: st.DataObject) -> None:
    products = draw_products(data, spec)
    sheaf, plain = build(spec, products), spec.build()
    x = data.draw(vectors(spec.n))
    assert sheaf.betti() == plain.betti()
    assert sheaf.dirichlet_energy(x) == plain.dirichlet_energy(x)
    np.testing.assert_array_equal(sheaf.coboundary().toarray(), plain.coboundary().toarray())
    np.testing.assert_array_equal(sheaf.cohomology_basis(), plain.cohomology_basis())
    one, other = sheaf.global_sections(), plain.global_sections()
    np.testing.assert_allclose(other @ (other.T @ one), one, atol=1e-10)
    same = build(spec, {v: np.eye(n) for v, n in spec.stalks.items()})
    np.testing.assert_allclose(same.global_sections(), other, atol=1e-13)
    np.testing.assert_array_equal(same.laplacian().toarray(), plain.laplacian().toarray())


@given(sheaves(), st.data())
def test_bases_are_orthonormal_and_the_nearest_section_is_nearest(spec: SheafSpec, data: st.DataObject) -> None:
    products = draw_products(data, spec)
    sheaf, M = build(spec, products), dense(spec, products)
    S = sheaf.global_sections()
    assert S.shape[1] == sheaf.betti()[0]
    np.testing.assert_allclose(S.T @ M @ S, np.eye(S.shape[1]), atol=1e-10)
    np.testing.assert_allclose(spec.delta @ S, 0.0, atol=1e-10)
    names = list(spec.stalks)
    held = data.draw(st.lists(st.sampled_from(names), unique=True))
    rest = spec.rest(held)
    R = sheaf.relative_sections(held)
    M_rest = dense(spec, products, rest)
    np.testing.assert_allclose(R.T @ M_rest @ R, np.eye(R.shape[1]), atol=1e-10)
    np.testing.assert_allclose(spec.delta[:, spec.columns(rest)] @ R, 0.0, atol=1e-10)
    if rest:
        local = sheaf.local_sections(rest)
        np.testing.assert_allclose(local.T @ M_rest @ local, np.eye(local.shape[1]), atol=1e-10)
    x = data.draw(vectors(spec.n))
    nearest = sheaf.nearest_global_section(x)
    np.testing.assert_allclose(spec.delta @ nearest, 0.0, atol=1e-9)
    np.testing.assert_allclose(S.T @ M @ (x - nearest), 0.0, atol=1e-9)
    by_vertex = sheaf.nearest_global_section(split(spec, names, x))
    np.testing.assert_array_equal(np.concatenate([np.zeros(0), *by_vertex.values()]), nearest)


@given(sheaves_with_boundary(), st.data())
def test_the_extension_is_the_shortest_of_the_same_ones(problem: Any, data: st.DataObject) -> None:
    spec, boundary, y = problem
    products = draw_products(data, spec)
    rest = spec.rest(boundary)
    D, D_U = spec.delta[:, spec.columns(rest)], spec.delta[:, spec.columns(boundary)]
    M = dense(spec, products, rest)
    root = np.linalg.cholesky(spec.K).T if spec.m else spec.K
    U_inverse = np.linalg.inv(np.linalg.cholesky(M).T) if len(M) else M
    right = root @ (spec.b - D_U @ y)
    expected = U_inverse @ np.linalg.lstsq(root @ D @ U_inverse, right, rcond=1e-10)[0] if len(M) else np.zeros(0)
    dirichlet = build(spec, products).dirichlet_problem(boundary)
    found = dirichlet.extend(y)
    np.testing.assert_allclose(found, expected, atol=1e-8 * max(1.0, np.abs(expected).max(initial=0.0)))
    H, B = dirichlet.H, dirichlet.B
    scale = max(1.0, np.abs(H @ found).max(initial=0.0), np.abs(B @ y).max(initial=0.0))
    np.testing.assert_allclose(H @ found, B @ y + dirichlet.c, atol=1e-9 * scale)
    N = dirichlet.null_basis
    np.testing.assert_allclose(N.T @ M @ N, np.eye(N.shape[1]), atol=1e-10)
    np.testing.assert_allclose(N.T @ M @ found, 0.0, atol=1e-8 * scale)
    r = H @ np.arange(1.0, len(M) + 1.0)
    solution = dirichlet.solve(r)
    np.testing.assert_allclose(H @ solution, r, atol=1e-8 * max(1.0, np.abs(r).max(initial=0.0)))
    np.testing.assert_allclose(N.T @ M @ solution, 0.0, atol=1e-8 * max(1.0, np.abs(solution).max(initial=0.0)))
    plain = spec.build().harmonic_extension(split(spec, boundary, y))
    held = build(spec, products).harmonic_extension(split(spec, boundary, y))
    assert held.energy == pytest.approx(plain.energy, rel=1e-8, abs=1e-8)
    assert held.unique is plain.unique


@given(sheaves_with_boundary(), st.data())
def test_a_change_of_basis_changes_coordinates_alone(problem: Any, data: st.DataObject) -> None:
    """With x = T x': maps F T, inner products T^T M T; every operator and every answer is carried along."""
    spec, boundary, y = problem
    products = draw_products(data, spec)
    T: Products = {}
    for v, n in spec.stalks.items():
        entries = data.draw(st.lists(st.integers(-1, 1), min_size=n * n, max_size=n * n))
        T[v] = np.triu(np.array(entries, float).reshape(n, n), 1) + np.diag(data.draw(vectors(n)) % 2 + 1.0)
    edges = tuple(EdgeSpec(e.tail, e.head, e.F_tail @ T[e.tail], e.F_head @ T[e.head], e.b, e.K) for e in spec.edges)
    other_spec = SheafSpec(spec.stalks, edges)
    one = build(spec, products)
    other = build(other_spec, {v: T[v].T @ products.get(v, np.eye(n)) @ T[v] for v, n in spec.stalks.items()})
    C = dense(spec, T)
    np.testing.assert_allclose(C @ other.laplacian().toarray(), one.laplacian().toarray() @ C, atol=1e-8)
    np.testing.assert_allclose(C @ other.adjoint_coboundary(), one.adjoint_coboundary().toarray(), atol=1e-8)
    x = data.draw(vectors(spec.n))
    moved: Array = np.asarray(np.linalg.solve(C, x), dtype=np.float64)
    np.testing.assert_allclose(C @ other.nearest_global_section(moved), one.nearest_global_section(x), atol=1e-8)
    assert other.betti() == one.betti()
    held = {v: np.linalg.solve(T[v], value) for v, value in split(spec, boundary, y).items()}
    here, there = one.harmonic_extension(split(spec, boundary, y)), other.harmonic_extension(held)
    size = max(1.0, *(np.abs(value).max(initial=0.0) for value in here.x.values()))
    for v in spec.stalks:
        np.testing.assert_allclose(T[v] @ there.x[v], here.x[v], atol=1e-7 * size)


def test_an_edge_and_a_mass_each_by_hand() -> None:
    """Two particles of masses 1 and 3 agree on their centre of mass; L is M^-1 times the graph's."""
    sheaf = Sheaf({"light": 1, "heavy": 1}, inner_products={"heavy": 3.0})
    sheaf.add_edge("light", "heavy", [[1.0]], [[1.0]], weight=[[2.0]])
    np.testing.assert_allclose(sheaf.laplacian().toarray(), np.array([[2, -2], [-2 / 3, 2 / 3]]))
    np.testing.assert_allclose(np.abs(sheaf.global_sections()), np.full((2, 1), 0.5))
    x = np.array([0.0, 4.0])
    np.testing.assert_allclose(sheaf.nearest_global_section(x), np.full(2, 3.0))
    np.testing.assert_array_equal(sheaf.inner_product("heavy"), [[3.0]])
    np.testing.assert_array_equal(sheaf.inner_product("light"), [[1.0]])
    sheaf.set_inner_product("light", [[9.0]])
    np.testing.assert_allclose(sheaf.nearest_global_section(x), np.ones(2))
    part = sheaf.restricted(["heavy"])
    np.testing.assert_array_equal(part.inner_product("heavy"), [[3.0]])


@pytest.mark.parametrize(
    ("products", "message"),
    [
        ({"z": np.eye(2)}, "unknown vertex 'z'"),
        ({"a": np.eye(3)}, r"inner product of vertex 'a' has shape \(3, 3\); expected \(2, 2\)"),
        ({"a": [[1.0, 2.0], [2.0, 1.0]]}, "not symmetric positive definite"),
        ({"a": [[1.0, 0.1], [0.0, 1.0]]}, "not symmetric positive definite"),
        ({"a": np.zeros((2, 2))}, "not symmetric positive definite"),
        ({"a": -1.0}, "not symmetric positive definite"),
        ({"a": [[np.nan, 0], [0, 1]]}, "an entry is not finite"),
        ({"a": "wide"}, "not an array of numbers"),
    ],
)
def test_what_is_no_inner_product_is_refused(products: dict[str, Any], message: str) -> None:
    with pytest.raises(SheafError, match=message):
        Sheaf({"a": 2, "b": 1}, inner_products=products)


def random_spd(n: int, rng: np.random.Generator) -> Array:
    A = rng.standard_normal((n, n))
    return np.asarray(A @ A.T + 0.3 * np.eye(n))


def test_large_sheaves_have_inner_products_too() -> None:
    """A flat bundle (proved along a forest) and planes stacked in space (the iterative projection)."""
    rng = np.random.default_rng(2)
    sheaf, frames = bundle_on_a_grid(30)
    M = np.stack([random_spd(3, rng) for _ in range(900)])
    for v in range(900):
        sheaf.set_inner_product(v, M[v])
    S = sheaf.global_sections().reshape(900, 3, 3)
    np.testing.assert_allclose(np.einsum("vai,vab,vbj->ij", S, M, S), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(frames @ S, np.broadcast_to(frames[0] @ S[0], (900, 3, 3)), atol=1e-12)
    x = rng.standard_normal((900, 3))
    nearest = sheaf.nearest_global_section(x.ravel()).reshape(900, 3)
    np.testing.assert_allclose(np.einsum("vai,vab,vb->i", S, M, x - nearest), 0.0, atol=1e-10)

    n = 420
    stacked = Sheaf(dict.fromkeys(range(n), 3), inner_products={v: random_spd(3, rng) for v in range(n)})
    flat = np.broadcast_to(np.eye(2, 3), (n - 1, 2, 3))
    stacked.add_edges(list(range(n - 1)), list(range(1, n)), flat, flat)
    product = stacked.vertex_product
    assert product is not None
    S = stacked.global_sections()
    assert S.shape[0] == 3 * n
    assert S.shape[-1] == n + 2
    x = rng.standard_normal(3 * n)
    nearest = stacked.nearest_global_section(x)
    expected = S @ (S.T @ (product.matrix @ x))
    np.testing.assert_allclose(nearest, expected, atol=1e-9)
