"""Large components: Lanczos kernels, proofs along forests, band and iterative harmonic.

Oracle: dense decompositions by numpy, and the dense path (itself checked by exact ranks in test_laws), reached by
leaving the limits as they are.
"""

import time

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import null_space
from scipy.stats import ortho_group

from mjsheaf import Sheaf
from mjsheaf.errors import SheafError
from mjsheaf.sheaf import sections, sheaf


@pytest.fixture
def sparse_path(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """From 13 columns on, no dense decomposition."""
    for module in (sections, sheaf):
        monkeypatch.setattr(module, "DENSE_COLUMNS", 12)
    return monkeypatch


@pytest.fixture
def unproved(sparse_path: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """And forests prove nothing: everything is left to the general method."""
    sparse_path.setattr(sections, "_BOUND_MARGIN", 1e300)
    return sparse_path


def bundle(vertices: int, k: int, *, flat: bool, seed: int = 0, copies: int = 1) -> Sheaf:
    """Rings with chords whose maps are rotations of R^k; flat: they come from a frame at each vertex, so h0 = k."""
    rng = np.random.default_rng(seed)
    result = Sheaf({(c, v): k for c in range(copies) for v in range(vertices)})
    for c in range(copies):
        frame = ortho_group.rvs(k, size=vertices, random_state=rng).reshape(vertices, k, k)
        pairs = [(v, (v + step) % vertices) for step in (1, 5) for v in range(vertices)]
        heads = [frame[j] if flat else ortho_group.rvs(k, random_state=rng).reshape(k, k) for _, j in pairs]
        result.add_edges(
            [(c, i) for i, _ in pairs],
            [(c, j) for _, j in pairs],
            [frame[i] for i, _ in pairs],
            heads,
            offset=rng.standard_normal((len(pairs), k)),
            weight=rng.uniform(0.5, 2.0, len(pairs)),
        )
    return result


CASES = {
    "three sections": (lambda: bundle(20, 3, flat=True), 3),
    "no section": (lambda: bundle(20, 3, flat=False), 0),
    "twenty sections, more than one Lanczos run finds": (lambda: bundle(12, 20, flat=True), 20),
    "two components": (lambda: bundle(11, 3, flat=True, copies=2), 6),
}


@pytest.mark.parametrize("way", ["sparse_path", "unproved"])
@pytest.mark.parametrize("name", CASES)
def test_forests_and_lanczos_find_every_section(name: str, way: str, request: pytest.FixtureRequest) -> None:
    request.getfixturevalue(way)
    make, h0 = CASES[name]
    large = make()
    assert large.betti()[0] == h0
    found = large.global_sections()
    null = null_space(large.coboundary().toarray(), rcond=1e-9)
    assert found.shape == null.shape == (large.shape[1], h0)
    np.testing.assert_allclose(found.T @ found, np.eye(h0), atol=1e-12)
    np.testing.assert_allclose(found @ found.T, null @ null.T, atol=1e-10)


def test_lanczos_keeps_to_the_tolerance(unproved: pytest.MonkeyPatch) -> None:
    """A chain with one weak link: one section more, or not, as its strength is under or over rtol."""
    chain = Sheaf(dict.fromkeys(range(40), 1))
    one = np.ones((1, 1))
    for i in range(39):
        F = one if i != 20 else 1e-7 * one
        chain.add_edge(i, i + 1, F, F)
    weak = np.linalg.svd(chain.coboundary().toarray(), compute_uv=False)[-1] / 2.0
    assert chain.betti(rtol=1.5 * weak) == (2, 1)
    assert chain.betti(rtol=0.5 * weak) == (1, 0)


def test_one_run_gives_the_bits_of_another(unproved: pytest.MonkeyPatch) -> None:
    large = bundle(20, 3, flat=True)
    np.testing.assert_array_equal(large.global_sections(), large.global_sections())


def test_a_kernel_that_fills_the_space_is_refused(unproved: pytest.MonkeyPatch) -> None:
    large = Sheaf({"a": 20, "b": 20})
    large.add_edge("a", "b", np.ones((1, 20)), np.ones((1, 20)))
    with pytest.raises(SheafError, match=r"null space .* over 20"):
        large.betti()


def test_equal_eigenvalues_are_found_from_any_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """ARPACK fails on about one start in 200 where 39 of 40 are equal."""
    map_ = sparse.csr_array(np.hstack([np.ones((1, 20)), -np.ones((1, 20))]))
    factor = sections.shifted_factor(map_.T @ map_, 1e-9)
    generator = np.random.default_rng
    for seed in range(400):
        monkeypatch.setattr(np.random, "default_rng", lambda _, seed=seed: generator(seed))
        vectors = sections.smallest_eigenvectors(factor, np.zeros((40, 0)), 8)
        np.testing.assert_allclose(vectors.T @ vectors, np.eye(8), atol=1e-10)
        np.testing.assert_allclose(map_ @ vectors, 0.0, atol=1e-6)


@pytest.mark.parametrize("way", ["band", "conjugate gradients"])
@pytest.mark.parametrize("pinned", [[(0, 0)], [(0, 0), (0, 7), (1, 3)]], ids=["one component free", "unique"])
def test_sparse_solvers_extend_as_the_dense_one_does(
    pinned: list[tuple[int, int]], way: str, sparse_path: pytest.MonkeyPatch
) -> None:
    """A factor or conjugate gradients, of minimum norm where the extension is not unique; oracle: pseudo-inverse."""
    if way != "band":
        sparse_path.setattr(sheaf, "DIRECT_WORK", 0.0)
    large = bundle(11, 3, flat=True, copies=2)
    rng = np.random.default_rng(2)
    problem = large.dirichlet_problem(pinned)
    assert type(problem.solver) is (sheaf.BandCholesky if way == "band" else sheaf.ConjugateGradients)
    values = {v: rng.standard_normal(3) for v in pinned}
    extension = problem.harmonic_extension(values)
    assert extension.unique is (len(pinned) > 1)
    assert extension.null_basis.shape[1] == (0 if extension.unique else 3)
    D, b = large.whitened_coboundary().toarray(), large.whitened_offset()
    W, U = large.columns(large.interior(pinned)), large.columns(pinned)
    expected = np.zeros(large.shape[1])
    expected[U] = np.concatenate(list(values.values()))
    expected[W] = np.linalg.pinv(D[:, W], rcond=1e-10) @ (b - D[:, U] @ expected[U])
    np.testing.assert_allclose(np.concatenate(list(extension.x.values())), expected, atol=1e-9)
    np.testing.assert_allclose(extension.energy, 0.5 * np.sum((D @ expected - b) ** 2), rtol=1e-9)
    r = problem.H @ rng.standard_normal((len(W), 4))
    np.testing.assert_allclose(problem.H @ problem.solve(r.T).T, r, atol=1e-8)


def test_thousands_of_free_directions_are_solved_in_seconds() -> None:
    """2000 chains of 5 vertices of which 30 are held at one end: the others settle around their mean."""
    islands = Sheaf(dict.fromkeys(range(10_000), 2) | dict.fromkeys(range(10_000, 10_030), 2))
    pairs = [(i, i + 1) for i in range(9_999) if (i + 1) % 5] + [(5 * k, 10_000 + k) for k in range(30)]
    eye = np.broadcast_to(np.eye(2), (len(pairs), 2, 2))
    islands.add_edges([i for i, _ in pairs], [j for _, j in pairs], eye, eye)
    problem = islands.dirichlet_problem(range(10_000, 10_030))
    y = np.random.default_rng(0).standard_normal((30, 2))
    start = time.process_time()
    x = problem.extend(y.ravel()).reshape(2000, 5, 2)
    assert time.process_time() - start < 20.0  # 68 s by one dense decomposition of what is free
    assert problem.sparse_null_basis.shape == (20_000, 3940)
    np.testing.assert_allclose(x[:30], np.broadcast_to(y[:, None], (30, 5, 2)), atol=1e-12)
    np.testing.assert_allclose(x[30:], 0.0, atol=1e-12)
