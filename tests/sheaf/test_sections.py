"""Sections along forests: what is proved is true, and what cannot be proved is left to the general method.

Oracles: singular values by numpy, exact ranks, frames that make a bundle flat.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf import Sheaf
from mjsheaf.sheaf.sections import certified_sections, grow
from tests.builders import bundle_on_a_grid
from tests.strategies import SheafSpec, sheaves


@given(sheaves(), st.data())
def test_the_bound_of_a_forest_holds(spec: SheafSpec, data: st.DataObject) -> None:
    """At most dim r singular values of delta on the free vertices are under 1 / |G|; P spans what the forest leaves."""
    names = list(spec.stalks)
    held = data.draw(st.lists(st.sampled_from(names), unique=True))
    free = np.array([v not in held for v in names])
    t = spec.build().edges
    forest = grow(t, free)
    assert sorted(forest.order) == list(range(len(names)))
    assert not free[forest.order[: np.sum(~free)]].any()
    delta = spec.delta[:, spec.columns(spec.rest(held))]
    if not delta.size:
        return
    values = np.zeros(delta.shape[1])
    found = np.linalg.svd(delta, compute_uv=False)
    values[: len(found)] = found
    assert forest.norm_low <= values[0] * (1 + 1e-12)
    assert values[0] <= forest.norm_high * (1 + 1e-12)
    roots = free & (forest.parent == -1)
    open_directions = int(np.diff(t.column)[roots].sum())
    G = np.sqrt(forest.rows * forest.columns).max()
    if G > 0.0:
        assert np.sum(values < 0.999 / G) <= open_directions


def test_a_flat_bundle_is_its_frames() -> None:
    """Sections of a flat bundle are R_v^T r, whatever the graph: 2,500 vertices, over what is decomposed densely."""
    sheaf, frames = bundle_on_a_grid(50)
    assert sheaf.betti() == (3, 3 * (2 * 50 * 49) - 3 * 2500 + 3)
    sections = sheaf.global_sections()
    expected = frames.transpose(0, 2, 1).reshape(-1, 3) / 50.0
    np.testing.assert_allclose(sections @ (sections.T @ expected), expected, atol=1e-12)
    x = np.random.default_rng(1).standard_normal(7500)
    np.testing.assert_allclose(sheaf.nearest_global_section(x), expected @ (expected.T @ x), atol=1e-12)
    assert sheaf.relative_sections([17]).shape == (7497, 0)


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("k", [2, 3])
def test_a_twisted_edge_leaves_the_axis_of_its_twist(k: int) -> None:
    """Sections are what the holonomy around a face leaves as it is; oracle: dense singular values."""
    sheaf, _ = bundle_on_a_grid(25, twist=300, k=k)
    values = np.linalg.svd(sheaf.coboundary().toarray(), compute_uv=False)
    expected = int(np.sum(values <= 1e-9 * values[0])) + max(0, sheaf.shape[1] - len(values))
    sections = sheaf.global_sections()
    assert sections.shape[1] == expected
    np.testing.assert_allclose(sheaf.coboundary() @ sections, 0.0, atol=1e-11)


def test_maps_that_grow_along_a_path_are_not_trusted_to_a_forest() -> None:
    """Values that double with each edge: the bound grows as fast, and the general method decides."""
    path = Sheaf(dict.fromkeys(range(60), 1))
    for v in range(59):
        path.add_edge(v, v + 1, np.array([[2.0]]), np.array([[1.0]]))
    _, left = certified_sections(path.edges, np.ones(60, dtype=bool), 1e-9)
    assert left.all()
    assert path.betti() == (1, 0)
