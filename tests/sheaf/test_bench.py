"""The benchmark measures what it prints: tests of its figures, not of speed."""

import json

from benchmarks import sheaf as bench


def test_each_published_figure_is_measured() -> None:
    found = bench.measure_small("path", 1)
    assert set(found) == set(bench.PUBLISHED_MS)
    assert min(found.values()) > 0.0


def test_a_grid_is_solved() -> None:
    """The residual that is reported is small for both kinds of solver."""
    for side, solver in ((20, "BandCholesky"), (80, "ConjugateGradients")):
        record = bench.measure_grid(side)
        assert record["solver"] == solver
        assert record["unique"]
        assert record["residual"] < 1e-8
        json.dumps(record)
