"""Nonlinear sheaves: rigidity of known frameworks, random ones against exact ranks, and their harmonic extensions."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mjsheaf import NonlinearSheaf, Sheaf
from mjsheaf.errors import SheafError
from tests.oracles.frameworks import FRAMEWORKS, TETRAHEDRON, TRIANGLE, complete
from tests.strategies import exact_rank


def desired_of(measures: str, z: Any) -> Any:
    """Return the value of an edge whose head is at z from its tail; edges of positions desire -z."""
    length = np.linalg.norm(z)
    return {"position": -z, "range": [length], "bearing": z / length}[measures]


def framework(points: Any, edges: Any, measures: Any) -> tuple[NonlinearSheaf, NDArray[np.float64]]:
    x = np.array(points, dtype=np.float64)
    n, d = x.shape
    sheaf = NonlinearSheaf({v: d for v in range(n)})  # noqa: C420 - typed
    for i, j in edges:
        desired = desired_of(measures, x[j] - x[i])
        sheaf.add_edge(i, j, np.eye(d), np.eye(d), measures=measures, desired=desired)
    return sheaf, x.ravel()


@pytest.mark.parametrize(("points", "edges", "measures", "rank", "needed", "rate"), FRAMEWORKS)
def test_ranks_and_rates_of_known_frameworks(
    points: Any, edges: Any, measures: str, rank: int, needed: int, rate: float | None
) -> None:
    """They are those of the literature; H is the Laplacian of the Jacobian sheaf."""
    sheaf, x = framework(points, edges, measures)
    H = sheaf.gradient_jacobian(x).toarray()
    assert np.allclose(H, sheaf.jacobian(x).laplacian().toarray(), atol=1e-14)
    values = np.linalg.eigvalsh(H)
    positive = values[values > 1e-9]
    assert len(positive) == rank
    assert len(x) - sheaf.jacobian(x).betti()[0] == rank
    if rate is not None:
        assert positive[0] == pytest.approx(rate, abs=1e-6)


def exact_matrix(points: Any, edges: Any, measures: str) -> NDArray[np.float64]:
    """Return rows of whole numbers whose rank is that of the rigidity matrix, for points of whole coordinates."""
    n, d = points.shape
    rows = []
    for i, j in edges:
        z = points[j] - points[i]
        block = z[None] if measures == "range" else z @ z * np.eye(d) - np.outer(z, z)  # |z|^2 P
        row = np.zeros((len(block), n, d))
        row[:, i], row[:, j] = -block, block
        rows.append(row.reshape(len(block), n * d))
    return np.concatenate(rows)


@pytest.mark.long
def test_random_frameworks_are_decided_as_an_exact_rank_decides() -> None:
    """Of 500 frameworks on small lattices, where points are often collinear, most ranks are deficient."""
    rng = np.random.default_rng(7)
    rigid = 0
    for _ in range(500):
        d = int(rng.integers(2, 4))
        n = int(rng.integers(3, 8))
        lattice = np.array(list(itertools.product(range(3), repeat=d)))
        points = lattice[rng.choice(len(lattice), n, replace=False)]
        pairs = list(itertools.combinations(range(n), 2))
        edges = [pairs[k] for k in rng.choice(len(pairs), int(rng.integers(1, len(pairs) + 1)), replace=False)]
        measures = str(rng.choice(["range", "bearing"]))
        sheaf, x = framework(points, edges, measures)
        wanted = exact_rank(exact_matrix(points, edges, measures))
        assert len(x) - sheaf.jacobian(x).betti()[0] == wanted, (points.tolist(), edges, measures)
        rigid += wanted == (n * d - d * (d + 1) // 2 if measures == "range" else n * d - d - 1)
    assert 50 < rigid < 450


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6))
def test_the_jacobian_sheaf_has_the_residuals_and_the_slope(seed: int) -> None:
    """Its gradient at x is that of the sheaf; its coboundary is the derivative of h, up to the sign of positions."""
    rng = np.random.default_rng(seed)
    sheaf = NonlinearSheaf({"a": 2, "b": 3, "c": 3})
    lift = np.array([0.0, 0.0, 0.7])
    maps = {"a": np.eye(3, 2), "b": np.eye(3), "c": np.eye(3)}
    kinds: list[Any] = ["range", "bearing", "position"] * 2
    for (i, j), measures in zip(itertools.permutations("abc", 2), kinds, strict=True):
        desired = desired_of(measures, rng.normal(size=3))
        weight = float(rng.uniform(0.5, 2.0))
        sheaf.add_edge(i, j, maps[i], maps[j], measures=measures, desired=desired, weight=weight, lift=lift)
    x = rng.normal(size=8)
    linear = sheaf.jacobian(x)
    delta = linear.coboundary()
    root = linear.whitened_coboundary()
    assert np.allclose(root.T @ (root @ x - linear.whitened_offset()), sheaf.gradient(x), atol=1e-12)
    v = rng.normal(size=8)

    def measured(x: Any) -> NDArray[np.float64]:
        return np.concatenate([desired_of(e.measures, z) for e, z in zip(sheaf.edges, sheaf.relative(x), strict=True)])

    slope = (measured(x + 1e-6 * v) - measured(x - 1e-6 * v)) / 2e-6
    sign = np.concatenate(
        [{"position": [1.0] * 3, "range": [-1.0], "bearing": [-1.0] * 3}[e.measures] for e in sheaf.edges]
    )
    assert np.allclose(sign * slope, delta @ v, atol=1e-7)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.sampled_from(["range", "bearing"]))
def test_an_extension_from_nearby_finds_the_exact_shape(seed: int, measures: str) -> None:
    """With two vertices held, a complete graph has the shape that it had."""
    rng = np.random.default_rng(seed)
    points = np.array([*TRIANGLE, (0.2, 1.4), (1.5, 1.1)]) + rng.uniform(-0.1, 0.1, (5, 2))
    sheaf, x = framework(points, complete(5), measures)
    start = x + rng.uniform(-0.1, 0.1, len(x))
    found = sheaf.harmonic_extension({0: points[0], 1: points[1]}, start)
    assert found.unique
    assert found.null_basis.shape == (6, 0)
    assert found.energy < 1e-20
    assert np.allclose(sheaf.pack(found.x), x, atol=1e-9)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10**6))
def test_the_energy_is_that_of_the_misfits(seed: int) -> None:
    """By definition w / 2 times (|z| - r)^2 of a range, |z| |z / |z| - g|^2 of a bearing, |z + b|^2 of a position."""
    rng = np.random.default_rng(seed)
    x = np.array(TETRAHEDRON) + rng.uniform(-0.1, 0.1, (4, 3))
    sheaf = NonlinearSheaf({v: 3 for v in range(4)})  # noqa: C420 - typed
    terms: list[Any] = []
    for (i, j), kind in zip(itertools.combinations(range(4), 2), ["range", "bearing", "position"] * 2, strict=True):
        desired = desired_of(kind, x[j] - x[i] + rng.uniform(-0.1, 0.1, 3))
        weight = float(rng.uniform(0.5, 2.0))
        sheaf.add_edge(i, j, np.eye(3), np.eye(3), measures=kind, desired=desired, weight=weight)  # type: ignore[arg-type]
        terms.append((i, j, kind, np.asarray(desired), weight))
    found = sheaf.harmonic_extension({0: x[0]}, x.ravel())
    energy = 0.0
    for i, j, kind, desired, weight in terms:
        z = found.x[j] - found.x[i]
        length = np.linalg.norm(z)
        if kind == "range":
            energy += 0.5 * weight * (length - desired[0]) ** 2
        elif kind == "bearing":
            energy += 0.5 * weight * length * np.sum((z / length - desired) ** 2)
        else:
            energy += 0.5 * weight * np.sum((z + desired) ** 2)
    assert energy > 1e-6
    assert found.energy == pytest.approx(energy, rel=1e-12)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10**6), st.sampled_from([0.3, 3.0]))
def test_bearings_keep_centroid_and_size(seed: int, scale: float) -> None:
    """From any start an extension with nothing held is the shape, with the size and the centroid of the start."""
    rng = np.random.default_rng(seed)
    sheaf, x = framework(TETRAHEDRON, complete(4), "bearing")
    start = x + rng.normal(scale=scale, size=len(x))
    found = sheaf.harmonic_extension({}, start)
    assert found.energy < 1e-12
    assert found.null_basis.shape == (12, 4)
    before, after = start.reshape(4, 3), sheaf.pack(found.x).reshape(4, 3)
    assert np.abs(after.mean(axis=0) - before.mean(axis=0)).max() < 1e-6
    sizes = [np.linalg.norm(points - points.mean(axis=0)) for points in (before, after)]
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-3)


def test_positions_alone_are_a_linear_sheaf() -> None:
    rng = np.random.default_rng(3)
    linear, curved = Sheaf({"a": 2, "b": 3, "c": 2}), NonlinearSheaf({"a": 2, "b": 3, "c": 2})
    for tail, head in itertools.combinations("abc", 2):
        F = [rng.normal(size=(3, 3 if end == "b" else 2)) for end in (tail, head)]
        b = rng.normal(size=3)
        linear.add_edge(tail, head, *F, offset=b)
        curved.add_edge(tail, head, *F, desired=b)
    held = {"a": [0.3, -0.2]}
    found = curved.harmonic_extension(held, np.zeros(7))
    wanted = linear.harmonic_extension(held)
    assert all(np.allclose(found.x[v], wanted.x[v], atol=1e-12) for v in "abc")
    assert found.energy == pytest.approx(wanted.energy)


def test_a_sheaf_without_edges_pulls_nothing_and_has_no_misfits() -> None:
    sheaf = NonlinearSheaf({"a": 2, "b": 3})
    x = np.arange(5.0)
    assert not sheaf.gradient(x).any()
    assert not sheaf.gradient_jacobian(x).toarray().any()
    assert sheaf.misfits(x) == []
    assert sheaf.residuals(x[None]).shape == (1, 0)


def test_coincident_vertices_pull_nothing() -> None:
    """There is no direction between them, and nothing is NaN."""
    for measures in ("range", "bearing"):
        sheaf, x = framework(TRIANGLE, [(0, 1)], measures)
        together = np.zeros_like(x)
        assert not sheaf.gradient(together).any()
        assert not sheaf.jacobian(together).laplacian().toarray().any()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"measures": "range", "desired": [0.0]}, "positive distance"),
        ({"measures": "range", "desired": [1.0, 2.0]}, "a distance"),
        ({"measures": "bearing", "desired": [1.0, 1e-2]}, "unit vector"),
        ({"measures": "bearing"}, "no desired bearing"),
        ({"measures": "angle", "desired": [1.0]}, "expected one of position, range, bearing"),
        ({"measures": "range", "desired": [1.0], "weight": np.eye(2)}, "expected a positive number"),
    ],
)
def test_bad_edges_are_refused(fields: Any, message: str) -> None:
    with pytest.raises(SheafError, match=message):
        NonlinearSheaf({"a": 2, "b": 2}).add_edge("a", "b", np.eye(2), np.eye(2), **fields)
