"""The benchmark measures what it prints: tests of its sheaves and figures, not of speed."""

import json

import numpy as np

from benchmarks import sheaf as bench


def test_small_sheaves_are_constant() -> None:
    assert bench.small_sheaf("path").betti() == (2, 0)
    assert bench.small_sheaf("cycle").betti() == (2, 2)


def test_each_published_figure_is_measured() -> None:
    found = bench.measure_small("path", 1)
    assert set(found) == set(bench.PUBLISHED_MS)
    assert min(found.values()) > 0.0


def test_a_grid_is_a_flat_bundle_and_is_solved() -> None:
    """Each frame is a rotation, and the residual that is reported is small for both kinds of solver."""
    tails, heads, F_tails, F_heads, values = bench.grid_maps(20)
    assert len(tails) == len(heads) == 2 * 20 * 19
    assert len(values) == 4
    frames: dict[int, np.ndarray] = {}
    for v, F in [*zip(tails, F_tails, strict=True), *zip(heads, F_heads, strict=True)]:
        np.testing.assert_array_equal(frames.setdefault(v, F), F)
        np.testing.assert_allclose(F.T @ F, np.eye(3), atol=1e-14)
    for side, solver in ((20, "BandCholesky"), (80, "ConjugateGradients")):
        record = bench.measure_grid(side)
        assert record["solver"] == solver
        assert record["unique"]
        assert record["residual"] < 1e-8
        json.dumps(record)
