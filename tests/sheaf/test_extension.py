"""Harmonic extension: what it minimises, how it depends on the boundary, and what is free in it.

Oracles: the dense blocks of delta^T K delta written from the definition, numpy's pseudo-inverse, and the paper's P3.
"""

from collections.abc import Callable, Hashable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf import Sheaf
from mjsheaf.errors import SheafError
from tests.strategies import Array, SheafSpec, exact_rank, orthogonal, sheaves_with_boundary, split

Case = tuple[SheafSpec, list[Hashable], Array]


@pytest.mark.parametrize(("a", "c"), [(0.0, 1.0), (-3.0, 8.0)])
def test_the_agent_between_two_targets_goes_to_the_midpoint(a: float, c: float) -> None:
    sheaf = Sheaf(dict.fromkeys((1, 2, 3), 1))
    sheaf.add_edges([1, 2], [2, 3], np.ones((2, 1, 1)), np.ones((2, 1, 1)))
    extension = sheaf.harmonic_extension({1: a, 3: c})
    assert extension.unique
    np.testing.assert_allclose(extension.x[2], (a + c) / 2, rtol=1e-14)
    np.testing.assert_allclose(extension.energy, (c - a) ** 2 / 4, rtol=1e-14)


@given(sheaves_with_boundary())
def test_blocks_are_those_of_the_laplacian(case: Case) -> None:
    spec, boundary, _ = case
    sheaf = spec.build()
    problem = sheaf.dirichlet_problem(boundary)
    W, U = spec.columns(spec.rest(boundary)), spec.columns(boundary)
    L = spec.delta.T @ spec.K @ spec.delta
    np.testing.assert_allclose(problem.H.toarray(), L[np.ix_(W, W)], atol=1e-11)
    np.testing.assert_allclose(problem.B.toarray(), -L[np.ix_(W, U)], atol=1e-11)
    np.testing.assert_allclose(problem.c, (spec.delta.T @ spec.K @ spec.b)[W], atol=1e-11)
    assert sheaf.interior(boundary) == spec.rest(boundary)


@given(sheaves_with_boundary())
def test_what_is_free_is_told_and_left_at_zero(case: Case) -> None:
    """Not unique just where H^0(G, U) is not zero; then the null basis spans it and x_W has minimum norm.

    (L x - delta^T K b) vanishes on the interior: H q* = B p + c. It is affine in the boundary, of several at once too.
    """
    spec, boundary, y = case
    sheaf = spec.build()
    extension = sheaf.harmonic_extension(split(spec, boundary, y))
    assert list(extension.x) == list(spec.stalks)
    interior = spec.columns(spec.rest(boundary))
    free = len(interior) - exact_rank(spec.delta[:, interior])
    N = extension.null_basis
    assert N.shape == (len(interior), free)
    assert extension.unique is (free == 0)
    np.testing.assert_allclose(N.T @ N, np.eye(free), atol=1e-12)
    relative = sheaf.relative_sections(boundary)
    np.testing.assert_allclose(N @ N.T, relative @ relative.T, atol=1e-9)
    np.testing.assert_allclose(relative.T @ relative, np.eye(free), atol=1e-12)
    np.testing.assert_allclose(spec.delta[:, interior] @ relative, 0.0, atol=1e-12)

    x = np.concatenate(list(extension.x.values()))
    root = np.linalg.cholesky(spec.K) if spec.m else spec.K
    known = spec.b - spec.delta[:, spec.columns(boundary)] @ y
    shortest = np.linalg.pinv(root.T @ spec.delta[:, interior], rcond=1e-10) @ (root.T @ known)
    np.testing.assert_allclose(x[interior], shortest, atol=1e-8 * (1.0 + np.abs(shortest).max(initial=0.0)))
    np.testing.assert_allclose(extension.energy, spec.energy(x), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(x[spec.columns(boundary)], y)
    size = np.abs(spec.delta.T @ spec.K).sum(initial=1.0) * max(1.0, np.abs(x).max(initial=0.0))
    gradient = spec.delta.T @ spec.K @ (spec.delta @ x - spec.b)
    np.testing.assert_allclose(gradient[interior], 0.0, atol=1e-12 * size)
    values = sheaf.dirichlet_problem(boundary).extend(np.array([y, -y, 3.0 * y - 2.0 * -y]))
    size = 1.0 + np.abs(values).max(initial=0.0)
    np.testing.assert_allclose(values[0], x[interior], atol=1e-11 * size)
    np.testing.assert_allclose(values[2], 3.0 * values[0] - 2.0 * values[1], atol=1e-10 * size)


@given(sheaves_with_boundary(), st.integers(0, 2**31), st.data())
def test_extension_does_not_depend_on_frames_order_or_direction(case: Case, seed: int, data: st.DataObject) -> None:
    spec, boundary, y = case
    names = data.draw(st.permutations(list(spec.stalks)))
    edges = [e.in_frame(orthogonal(len(e.b), seed + k)) for k, e in enumerate(spec.edges)]
    edges = [e.reversed() if data.draw(st.booleans()) else e for e in data.draw(st.permutations(edges))]
    other = SheafSpec({v: spec.stalks[v] for v in names}, tuple(edges))
    given_values = split(spec, boundary, y)
    one, two = spec.build().harmonic_extension(given_values), other.build().harmonic_extension(given_values)
    size = 1.0 + max(np.abs(x).max(initial=0.0) for x in one.x.values())
    for v in spec.stalks:
        np.testing.assert_allclose(two.x[v], one.x[v], atol=1e-9 * size)
    assert one.unique is two.unique
    np.testing.assert_allclose(two.energy, one.energy, atol=1e-9 * size**2)


@pytest.mark.parametrize("smallest", [2e-9, 1e-8, 1e-6, 1e-3])
@pytest.mark.parametrize("seed", range(5))
def test_badly_conditioned_maps_are_solved_as_well_as_they_can_be(smallest: float, seed: int) -> None:
    """Maps that count as injective give the extension to machine precision over their smallest singular value."""
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(2))
    F = left @ np.diag([1.0, 0.7, smallest]) @ right.T
    sheaf = Sheaf({"a": 3, "b": 3})
    sheaf.add_edge("a", "b", F, F, weight=2.0)
    y = rng.standard_normal(3)
    extension = sheaf.harmonic_extension({"b": y})
    assert extension.unique
    np.testing.assert_allclose(extension.x["a"], y, atol=20 * np.finfo(float).eps / smallest)


def test_wrong_boundaries_are_refused() -> None:
    sheaf = Sheaf({"a": 2, "b": 2})
    sheaf.add_edge("a", "b", np.eye(2), np.eye(2))
    wrong: list[tuple[Callable[[], object], str]] = [
        (lambda: sheaf.dirichlet_problem(["a", "a"]), "named twice"),
        (lambda: sheaf.harmonic_extension({"c": [0, 0]}), r"'c'.* 'a', 'b'"),
        (lambda: sheaf.harmonic_extension({"b": [0, 0, 0]}), r"'b'.* \(3,\).* \(2,\)"),
        (lambda: sheaf.harmonic_extension({"b": [0, np.nan]}), r"'b'.* finite"),
        (lambda: sheaf.dirichlet_problem(["b"]).extend(np.zeros((5, 3))), r"boundary.* \(5, 3\).* \(\.\.\., 2\)"),
    ]
    for make, message in wrong:
        with pytest.raises(SheafError, match=message):
            make()
