"""The spectrum of H, by the dense path and by Lanczos.

Oracle: dense eigenvalues and singular values of the same matrices; values known by hand, and an inverse in rational
numbers, where H is nearly singular.
"""

from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from mjsheaf.checking.spectrum import EIGENVALUE_TOLERANCE, Spectrum, agent_coboundary, smallest_eigenvalue, spectrum_of
from mjsheaf.sheaf.sections import smallest_eigenvectors
from mjsheaf.team import Edge, Team, anchor
from tests.builders import hold, make_edge, make_team
from tests.oracles.law import coboundary
from tests.strategies import shared_teams, whole_number_teams


def check(found: Spectrum, team: Team, rtol: float = 1e-9) -> None:
    """Compare with a dense decomposition of H, and of B."""
    H, B = team.dirichlet.H.toarray(), team.dirichlet.B.toarray()
    values = np.linalg.eigvalsh(H)
    k, r = len(found.smallest), found.nullity
    noise = 1e-13 * max(values[-1], 1.0)
    assert found.lambda_max == pytest.approx(values[-1], rel=rtol, abs=noise)
    assert found.sigma_max_B == pytest.approx(np.linalg.svd(B, compute_uv=False).max(initial=0.0), rel=1e-12)
    np.testing.assert_allclose(values[:r], 0.0, atol=noise)
    np.testing.assert_allclose(found.smallest, values[r : r + k], rtol=rtol, atol=noise)
    assert np.all(np.diff(found.smallest) >= 0.0)
    assert np.all(found.smallest > 0.0)
    assert found.lambda_min == (0.0 if r or not k else found.smallest[0])
    np.testing.assert_allclose(found.vectors.T @ found.vectors, np.eye(k), atol=1e-10)
    np.testing.assert_allclose(H @ found.vectors, found.vectors * found.smallest, atol=1e-7 * max(values[-1], 1.0))


@given(st.one_of(shared_teams(), whole_number_teams()))
def test_spectrum_of_any_maps(team: Team) -> None:
    found = spectrum_of(team, 20)
    check(found, team)
    assert found.nullity + len(found.smallest) == team.dirichlet.H.shape[0]
    assert smallest_eigenvalue(*agent_coboundary(team)) == pytest.approx(found.lambda_min, rel=1e-9, abs=1e-13)


@given(whole_number_teams())
def test_the_coboundary_on_the_agents(team: Team) -> None:
    delta, D = (x.toarray() for x in agent_coboundary(team))
    np.testing.assert_allclose(D.T @ D, team.dirichlet.H.toarray(), atol=1e-12)
    np.testing.assert_array_equal(D, coboundary(team)[:-1])
    np.testing.assert_array_equal(delta, D)


def swarm(seed: int, *, spatial: float = 0.5, weak: float = 1.0, name: str = "shared", top: str = "V0") -> Team:
    """Forty vehicles near one another in the plane, in two halves that one edge of the given weight joins."""
    rng = np.random.default_rng(seed)
    names = [f"{'U' if rng.uniform() < spatial else 'B'}{k}" for k in range(40)]
    links = []
    for half in (0, 20):
        place = rng.uniform(size=(20, 2))
        links += [(half + i, half + j) for i, j in cKDTree(place).query_pairs(0.5)]

    def turned(tail: str, head: str, weight: float = 1.0):  # type: ignore[no-untyped-def]
        return make_edge(tail, head, name=name, weight=weight, attitude=tuple(rng.uniform(-3, 3, 3)))

    edges = [turned(names[i], names[j]) for i, j in links]
    edges.append(turned(names[0], names[20], weak))
    return make_team(" ".join(names), f"S0 {top}", edges, [turned(names[0], "S0"), turned(names[1], top)])


@pytest.mark.parametrize("name", ["shared", "local_frame"])
@pytest.mark.parametrize(("spatial", "weak"), [(0.5, 1.0), (0.0, 1.0), (0.0, 1e-6), (0.0, 1e-10), (1.0, 1e-8)])
def test_lanczos_agrees_with_the_dense_answer(
    name: str, spatial: float, weak: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Free, held, and held by one weak edge alone, down to an eigenvalue of 1e-12 of the largest."""
    dense = spectrum_of(swarm(3, spatial=spatial, weak=weak, name=name))
    sizes: list[int] = []

    def lanczos(factor: Any, known: Any, count: int, tolerance: float) -> Any:
        sizes.append(len(known))
        return smallest_eigenvectors(factor, known, count, tolerance)

    monkeypatch.setattr("mjsheaf.checking.spectrum.smallest_eigenvectors", lanczos)
    monkeypatch.setattr("mjsheaf.checking.spectrum.DENSE_STATES", 12)
    monkeypatch.setattr("mjsheaf.sheaf.sections.DENSE_COLUMNS", 12)
    large = swarm(3, spatial=spatial, weak=weak, name=name)
    found = spectrum_of(large)
    assert max(sizes) == 40
    assert found.nullity == dense.nullity
    check(found, large, rtol=1e-7)
    np.testing.assert_allclose(found.smallest[:2], dense.smallest[:2], rtol=EIGENVALUE_TOLERANCE)
    assert smallest_eigenvalue(*agent_coboundary(large)) == pytest.approx(dense.lambda_min, rel=1e-7)
    np.testing.assert_array_equal(spectrum_of(swarm(3, spatial=spatial, weak=weak, name=name)).vectors, found.vectors)


@pytest.mark.parametrize("weight", [1.0, 1e-4, 1e-8, 1e-12, 1e-15, 1e-17])
def test_a_nearly_singular_h_is_right_to_the_last_digits(weight: float) -> None:
    """One boat held along x and y, the latter weakly: lambda_min is that weight, far under the rounding of H."""
    one = make_team("B1", "S1", [], [], [hold("B1", "x"), hold("B1", "y", weight)])
    pair = make_team("B1 B2", "S1", [("B1", "B2")], [], [hold("B1", "x"), hold("B2", "y", weight)])
    assert spectrum_of(one).lambda_min == pytest.approx(weight, rel=1e-12)
    # Two boats that agree on y, one of them held weakly: half the weight, to first order.
    assert spectrum_of(pair).lambda_min == pytest.approx(0.5 * weight, rel=0.3 if weight == 1.0 else 2e-4)
    assert smallest_eigenvalue(*agent_coboundary(pair)) == pytest.approx(spectrum_of(pair).lambda_min, rel=1e-9)


def exact_inverse(H: list[list[Fraction]]) -> np.ndarray:
    """H^-1 by Gauss and Jordan in rational numbers, rounded once."""
    n = len(H)
    rows = [[*row, *(Fraction(int(i == j)) for j in range(n))] for i, row in enumerate(H)]
    for k in range(n):  # H is positive definite: no pivot is 0
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(n):
            if i != k and rows[i][k]:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return np.array([[float(x) for x in row[n:]] for row in rows])


@pytest.mark.parametrize("seed", range(6))
def test_many_weak_edges_beside_a_stiff_one(seed: int) -> None:
    """Weights over 15 decades: eigenvectors of H mix all that is weak, and lambda_min must not come out too large."""
    rng = np.random.default_rng([seed, 5])
    names = [f"B{k}" for k in range(7)]
    weights = [1e9, *(1e-6 * rng.uniform(1, 10, 2 * len(names)))]

    def some(tail: str, head: str) -> Edge:
        F_tail, F_head = rng.standard_normal((2, 2, 2))
        return Edge(tail, head, F_tail, F_head, weights.pop(0) * np.eye(2))

    links = [some(a, b) for a, b in pairwise(names)]
    large = make_team(" ".join(names), "S1", links, [some(name, "S1") for name in names])
    H = [[Fraction(0)] * 14 for _ in range(14)]
    for e in [*links, *large.sensing]:
        for F_tail, F_head in zip(e.F_tail, e.F_head, strict=True):
            ends = [(e.tail, F_tail), (e.head, -F_head)]
            row = {2 * names.index(v) + k: Fraction(F[k]) for v, F in ends if v in names for k in range(2)}
            for a in row:
                for b in row:
                    H[a][b] += Fraction(e.weight[0, 0]) * row[a] * row[b]
    expected = 1.0 / np.linalg.norm(exact_inverse(H), 2)
    assert spectrum_of(large).lambda_min == pytest.approx(expected, rel=1e-9)
    assert smallest_eigenvalue(*agent_coboundary(large)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("gain", [1e-8, 2e-9, 0.5e-9, 1e-14])
def test_zero_is_what_the_relative_cohomology_says(gain: float) -> None:
    """A singular value of delta of at most 1e-9 of the largest counts as none; inner products do not matter."""
    faint = anchor("B1", np.array([[0.0, gain]]), np.zeros(1), np.eye(1))
    for loud in (1.0, 1e6):
        one = make_team("B1", "S1", [], [], [hold("B1", "x", loud), faint])
        found, free = spectrum_of(one), gain < 1e-9
        assert (found.nullity, one.dirichlet.unique) == (int(free), not free)
        assert found.lambda_min == (0.0 if free else pytest.approx(gain**2, rel=1e-9))
        assert smallest_eigenvalue(*agent_coboundary(one)) == found.lambda_min


def test_a_team_without_edges() -> None:
    found = spectrum_of(make_team("B1 U1", "S1", [], []))
    assert (found.lambda_min, found.lambda_max, found.sigma_max_B, found.nullity) == (0.0, 0.0, 0.0, 5)
    assert found.smallest.shape == (0,)
    assert found.vectors.shape == (5, 0)


def test_a_singular_h_is_zero_and_never_less() -> None:
    """Rotated frames leave rounding in H, whose dense eigenvalues come out on both sides of zero."""
    lowest = []
    for seed in range(6):
        loose = swarm(seed, spatial=1.0, name="local_frame", top="S1")
        lowest.append(np.linalg.eigvalsh(loose.dirichlet.H.toarray())[0])
        found = spectrum_of(loose)
        assert (found.nullity, found.lambda_min) == (1, 0.0)
    assert min(lowest) < 0.0 < max(lowest) < 1e-13
