"""Large components: Lanczos kernels, sparse and iterative solvers, against the dense path on the same sheaf.

Oracle: the dense path (itself checked by exact ranks in test_laws), reached by leaving DENSE_COLUMNS as it is.
"""

import time

import numpy as np
import pytest
from scipy.stats import ortho_group

from mjsheaf import Sheaf
from mjsheaf.errors import SheafError
from mjsheaf.sheaf import dirichlet, kernel, sheaf

Array = np.ndarray


@pytest.fixture
def sparse_path(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """From 13 columns on, no dense decomposition."""
    for module in (kernel, dirichlet, sheaf):
        monkeypatch.setattr(module, "DENSE_COLUMNS", 12)
    return monkeypatch


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


def both(monkeypatch: pytest.MonkeyPatch, make: object) -> tuple[Array, Array]:
    """The same thing by the sparse path and by the dense one."""
    assert callable(make)
    sparse = make()
    monkeypatch.undo()
    return sparse, make()


CASES = {
    "three sections": (lambda: bundle(20, 3, flat=True), 3),
    "no section": (lambda: bundle(20, 3, flat=False), 0),
    "twenty sections, more than one Lanczos run finds": (lambda: bundle(12, 20, flat=True), 20),
    "two components": (lambda: bundle(11, 3, flat=True, copies=2), 6),
}


@pytest.mark.parametrize("name", CASES)
def test_lanczos_finds_every_section(name: str, sparse_path: pytest.MonkeyPatch) -> None:
    make, h0 = CASES[name]
    large = make()
    assert large.betti()[0] == h0
    sparse, dense = both(sparse_path, large.global_sections)
    assert sparse.shape == dense.shape == (large.shape[1], h0)
    np.testing.assert_allclose(sparse.T @ sparse, np.eye(h0), atol=1e-12)
    np.testing.assert_allclose(sparse @ sparse.T, dense @ dense.T, atol=1e-10)


def test_lanczos_keeps_to_the_tolerance(sparse_path: pytest.MonkeyPatch) -> None:
    """A chain with one weak link: one section more, or not, as its strength is under or over rtol."""
    chain = Sheaf(dict.fromkeys(range(40), 1))
    one = np.ones((1, 1))
    for i in range(39):
        F = one if i != 20 else 1e-7 * one
        chain.add_edge(i, i + 1, F, F)
    weak = np.linalg.svd(chain.coboundary().toarray(), compute_uv=False)[-1] / 2.0
    assert chain.betti(rtol=1.5 * weak) == (2, 1)
    assert chain.betti(rtol=0.5 * weak) == (1, 0)


def test_one_run_gives_the_bits_of_another(sparse_path: pytest.MonkeyPatch) -> None:
    large = bundle(20, 3, flat=True)
    np.testing.assert_array_equal(large.global_sections(), large.global_sections())


def test_a_kernel_that_fills_the_space_is_refused(sparse_path: pytest.MonkeyPatch) -> None:
    large = Sheaf({"a": 20, "b": 20})
    large.add_edge("a", "b", np.ones((1, 20)), np.ones((1, 20)))
    with pytest.raises(SheafError, match=r"the kernel .* has dimension over 20: too large"):
        large.betti()


@pytest.mark.parametrize("pinned", [[(0, 0)], [(0, 0), (0, 7), (1, 3)]], ids=["one component free", "unique"])
def test_sparse_solvers_extend_as_the_dense_one_does(
    pinned: list[tuple[int, int]], sparse_path: pytest.MonkeyPatch
) -> None:
    """Factorisation where the extension is unique, conjugate gradients and minimum norm where it is not."""
    large = bundle(11, 3, flat=True, copies=2)
    rng = np.random.default_rng(2)
    values = {v: rng.standard_normal(3) for v in pinned}

    def extend() -> Array:
        extension = large.harmonic_extension(values)
        assert extension.unique is (len(pinned) > 1)
        assert extension.null_basis.shape[1] == (0 if extension.unique else 3)
        return np.concatenate([*extension.x.values(), [extension.energy]])

    sparse, dense = both(sparse_path, extend)
    np.testing.assert_allclose(sparse, dense, atol=1e-10)


def test_thousands_of_free_directions_are_solved_in_seconds() -> None:
    """2000 chains of 5 vertices of which 30 are held at one end: the others settle around their mean."""
    islands = Sheaf(dict.fromkeys(range(10_000), 2) | dict.fromkeys(range(10_000, 10_030), 2))
    pairs = [(i, i + 1) for i in range(9_999) if (i + 1) % 5] + [(5 * k, 10_000 + k) for k in range(30)]
    eye = np.broadcast_to(np.eye(2), (len(pairs), 2, 2))
    islands.add_edges([i for i, _ in pairs], [j for _, j in pairs], eye, eye)
    problem = dirichlet.DirichletProblem(islands, range(10_000, 10_030))
    y = np.random.default_rng(0).standard_normal((30, 2))
    start = time.process_time()
    x = problem.extend(y.ravel()).reshape(2000, 5, 2)
    assert time.process_time() - start < 20.0  # 68 s by one dense decomposition of what is free
    assert problem.sparse_null_basis.shape == (20_000, 3940)
    np.testing.assert_allclose(x[:30], np.broadcast_to(y[:, None], (30, 5, 2)), atol=1e-12)
    np.testing.assert_allclose(x[30:], 0.0, atol=1e-12)


def test_vertices_that_nothing_holds_stay_where_they_are(sparse_path: pytest.MonkeyPatch) -> None:
    alone = Sheaf(dict.fromkeys(range(20), 2))
    extension = alone.harmonic_extension({0: [1.0, 2.0]})
    assert extension.null_basis.shape == (38, 38)
    np.testing.assert_array_equal(np.concatenate([extension.x[v] for v in range(1, 20)]), 0.0)


def test_sparse_projection_is_the_dense_one(sparse_path: pytest.MonkeyPatch) -> None:
    large = bundle(20, 3, flat=True)
    x = np.random.default_rng(3).standard_normal(60)
    sparse, dense = both(sparse_path, lambda: large.nearest_global_section(x))
    np.testing.assert_allclose(sparse, dense, atol=1e-11)


def test_many_edges_on_few_vertices() -> None:
    """A complete graph of 60 vertices: decomposed by columns, whatever the number of rows (5,310 here)."""
    n = 60
    tails, heads = np.triu_indices(n, 1)
    maps = np.tile(np.eye(3), (len(tails), 1, 1))
    complete = Sheaf(dict.fromkeys(range(n), 3))
    complete.add_edges(tails.tolist(), heads.tolist(), maps, maps)
    assert complete.betti() == (3, 3 * (len(tails) - n + 1))
    assert complete.relative_sections([0]).shape[1] == 0
