"""Suprema of a flow field over a box.

Oracles: the field itself at thousands of random points, half of them gathered at its kernels; single kernels, whose
peaks are known in closed form; the paper's field on a fine grid.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mjsheaf.checking.theorem.flow_bounds import Supremum, _Kernels, flow_scale
from mjsheaf.checking.theorem.flow_bounds import supremum as supremum_of
from mjsheaf.media.flow import FlowField
from tests.builders import FACTS, field_of, flow_jacobian, of_facts
from tests.strategies import examples

Array = NDArray[np.float64]

largest_speed = partial(supremum_of, slope=False)
lipschitz_constant = partial(supremum_of, slope=True)
BOTH = pytest.mark.parametrize("supremum", [largest_speed, lipschitz_constant], ids=["speed", "slope"])
PLANES = [(2, True), (2, False), (3, True), (3, False)]  # dimension of the field, and whether vehicles are planar
SPACES = st.sampled_from(PLANES)
SEEDS = st.integers(0, 2**31)


def random_field(rng: np.random.Generator, n: int) -> FlowField:
    """Up to three kernels of each kind, of scales over two decades."""

    def rows(width: int) -> Array:
        k = int(rng.integers(0, 4))
        numbers = rng.standard_normal((k, width)) * 10.0 ** rng.uniform(-1, 1, (k, 1))
        return np.hstack([3.0 * rng.standard_normal((k, n)), numbers])

    channels = rows(n + 1)
    channels = np.hstack([channels, 10.0 ** rng.uniform(-1.3, 0.7, (len(channels), 2))])
    core = 10.0 ** rng.uniform(-1.3, 0.5)
    drift = rng.standard_normal(n).tolist()
    return field_of(n, core, drift, rows(1).tolist(), rows(1 if n == 2 else 4).tolist(), channels.tolist())


def random_box(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """Small or large, long or flat, over the kernels or far from them."""
    centre = rng.standard_normal(n) * 10.0 ** rng.uniform(-1, 2)
    half = 10.0 ** rng.uniform(-2, 1.5, n) * (rng.uniform(size=n) > 0.1)
    return centre - half, centre + half


def centres_of(field: FlowField) -> Array:
    n = field.dimension
    return np.array([k.centre for kind in (field.sources, field.vortices, field.channels) for k in kind]).reshape(-1, n)


def points_in(field: FlowField, low: Array, high: Array, rng: np.random.Generator, count: int = 3000) -> Array:
    """Points of a box, half of them as near to the kernels as the box lets them be."""
    points = rng.uniform(low, high, (count, len(low)))
    centres = centres_of(field)
    if len(centres):
        scale = (field.core or 1.0) * 10.0 ** rng.uniform(-1.5, 1.0, (count // 2, 1))
        near = centres[rng.integers(0, len(centres), count // 2)]
        near = np.pad(near, ((0, 0), (0, 1)))[:, : len(low)]
        points[: count // 2] = np.clip(near + scale * rng.standard_normal(near.shape), low, high)
    return points


def value(supremum: Callable[..., Supremum], field: FlowField, points: Array, planar: bool) -> Array:
    """Evaluate the quantity under the supremum, by the field's own velocity and Jacobian."""
    points = points[..., :2] if planar else points
    if supremum is largest_speed:
        return np.asarray(np.linalg.norm(field.velocity(points), axis=-1))
    return np.asarray(np.linalg.norm(flow_jacobian(field, points), ord=2, axis=(-2, -1)))


@BOTH
@examples(150)
@given(seed=SEEDS, space=SPACES)
def test_nothing_in_the_box_exceeds_the_bound(
    supremum: Callable[..., Supremum], seed: int, space: tuple[int, bool]
) -> None:
    (n, planar), rng = space, np.random.default_rng(seed)
    field = random_field(rng, n)
    low, high = random_box(rng, 2 if planar else 3)
    tolerance = float(rng.choice([0.3, 0.02]))
    found = supremum(field, low, high, planar=planar, tolerance=tolerance, most_cells=int(rng.choice([1, 30, 20_000])))

    assert np.all(value(supremum, field, points_in(field, low, high, rng), planar) <= found.upper)
    assert 0.0 <= found.seen <= found.upper
    assert found.exact == (found.upper <= (1.0 + tolerance) * found.seen)
    assert np.all(low <= found.where)
    assert np.all(found.where <= high)
    np.testing.assert_allclose(value(supremum, field, found.where, planar), found.seen, rtol=1e-9, atol=1e-13)


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("slope", [False, True], ids=["speed", "slope"])
@examples(150)
@given(seed=SEEDS, space=SPACES)
def test_the_bound_of_one_cell_holds(slope: bool, seed: int, space: tuple[int, bool]) -> None:
    """Each bound separately: each kernel over a cell, and its second derivative, by differences."""
    (dimension, planar), rng = space, np.random.default_rng(seed)
    field = random_field(rng, dimension)
    kernels = _Kernels(field.table, dimension, 2 if planar or dimension == 2 else 3, True)
    n = kernels.n
    half = 10.0 ** rng.uniform(-2, 0.5, (1, n))
    if not kernels.count:
        return
    centre = kernels.centre[:1] + rng.standard_normal(n) * half * 2.0
    points = rng.uniform(centre - half, centre + half, (400, n))
    points = np.concatenate(
        [points, np.clip(np.concatenate([kernels.candidates(), centre]), centre - half, centre + half)]
    )

    a = np.linalg.norm(half, axis=1)
    both = kernels._pole_bounds(centre, half, slope), kernels._channel_bounds(centre, half, a, slope)
    largest, curvature = (np.concatenate(b, axis=1)[0] for b in zip(*both, strict=True))
    w, J = kernels.evaluate(points)
    sizes = np.linalg.norm(J, ord=2, axis=(-2, -1)) if slope else np.linalg.norm(w, axis=-1)
    assert np.all(sizes <= largest * (1.0 + 1e-12) + 1e-150)  # squares of less are subnormal
    i, j = np.triu_indices(len(points[:60]), 1)
    apart = np.linalg.norm(points[i] - points[j], axis=1)[:, None]
    change = np.linalg.norm(J[i] - J[j], ord=2, axis=(-2, -1))
    assert np.all(change <= curvature * apart * (1.0 + 1e-9) + 1e-9 * np.abs(J).max(initial=0.0))


def test_the_bound_of_the_second_derivative_is_attained_far_from_a_pole() -> None:
    """The velocity is the conjugate of 1 / z, whose second derivative is 2 / z^3."""
    kernels = _Kernels(field_of(2, 0.1, sources=[[0.0, 0.0, 1.0]]).table, 2, 2, True)
    _, curvature = kernels._pole_bounds(np.array([[60.0, 80.0]]), np.full((1, 2), 1e-6), True)
    assert curvature == pytest.approx(2.0 / 100.0**3, rel=1e-4)


@pytest.mark.slow
@BOTH
def test_the_gap_closes(supremum: Callable[..., Supremum]) -> None:
    """Within 50,000 cells, but for a few fields of channels that overlap in space: one in 600 in a longer study."""
    exact = []
    for n, planar in PLANES:
        for seed in range(60):
            rng = np.random.default_rng(seed)
            field, reach = random_field(rng, n), rng.uniform(1.0, 10.0, 2 if planar else 3)
            found = supremum(field, -reach, reach, planar=planar, tolerance=0.05)
            exact.append(found.exact)
            assert found.upper <= (1.05 if found.exact else 1.25) * found.seen
    assert np.mean(exact) > 0.98


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize("c", [0.05, 0.7])
def test_a_kernel_alone_has_its_known_peaks(n: int, planar: bool, c: float) -> None:
    """|alpha| / 2c and |alpha| / c^2 in the plane; 2 |alpha| / (3 sqrt 3 c^2) and |alpha| / c^3 in space."""
    origin, low, high = [0.3] * 2 + [0.0] * (n - 2), [-8.0, -5.0, -6.0], [9.0, 7.0, 5.0]
    source = field_of(n, c, sources=[[*origin, -3.0]])
    vortex = field_of(n, c, vortices=[[*origin, *([] if n == 2 else [0.0, 0.0, 2.0]), -3.0 if n == 2 else 1.5]])
    channel = field_of(n, channels=[[*origin, *[0.6, 0.8, 0.0][:n], -2.0, 0.4, 3.0]])
    expected = [
        (source, 1.5 / c if n == 2 else 6.0 / (3.0 * np.sqrt(3.0) * c**2), 3.0 / c**n),
        (vortex, 1.5 / c, 3.0 / c**2),
        (channel, 2.0, 2.0 / 0.4 * np.exp(-0.5)),
    ]
    for field, speed, slope in expected:
        for supremum, peak in ((largest_speed, speed), (lipschitz_constant, slope)):
            found = supremum(field, low, high, planar=planar, tolerance=0.001, most_cells=200_000)
            assert found.exact
            assert found.seen <= peak * (1.0 + 1e-12)
            assert peak <= found.upper <= 1.001 * peak


@pytest.mark.slow
def test_the_paper() -> None:
    """The planar agents' field has slopes up to 54 1/s near the cores: 53.6, at the strongest source."""
    field = of_facts(FACTS["agent_field"])
    slope = lipschitz_constant(field, [-100, -100], [150, 150], planar=True, tolerance=1e-3)
    assert slope.exact
    assert slope.seen == pytest.approx(53.584, abs=1e-3)
    assert slope.upper < 54.0
    np.testing.assert_allclose(slope.where, field.sources[0].centre[:2], atol=0.01)
    speed = largest_speed(field, [-100, -100], [150, 150], planar=True, tolerance=1e-3)
    assert speed.exact
    assert speed.seen == pytest.approx(4.262, abs=5e-3)

    centres = centres_of(field)
    grid = np.stack(np.meshgrid(*[np.linspace(-0.6, 0.6, 241)] * 2), axis=-1).reshape(-1, 2)
    near = (centres[:, None] + grid).reshape(-1, 2)
    for found, supremum in ((slope, lipschitz_constant), (speed, largest_speed)):
        on_grid = value(supremum, field, near, True).max()
        assert on_grid <= found.upper
        assert on_grid >= 0.998 * found.seen

    space = of_facts(FACTS["target_field"])
    box: tuple[list[float], list[float]] = [-60, -60, -70], [120, 120, 10]
    assert lipschitz_constant(space, *box, planar=False).seen == pytest.approx(355.8, abs=0.1)
    assert largest_speed(space, *box, planar=False).seen == pytest.approx(20.82, abs=0.1)


@BOTH
@pytest.mark.parametrize("name", ["agent_field", "target_field"])
def test_a_box_may_be_a_point(supremum: Callable[..., Supremum], name: str) -> None:
    field = of_facts(FACTS[name])
    for point in [*centres_of(field), np.zeros(field.dimension), np.full(field.dimension, 1e3)]:
        found = supremum(field, point, point, planar=field.dimension == 2, tolerance=1e-9)
        assert found.exact
        np.testing.assert_array_equal(found.where, point)
        here = value(supremum, field, point, False)
        assert here <= found.upper * (1.0 + 1e-12)
        np.testing.assert_allclose(found.upper, here, rtol=1e-9)


@BOTH
@pytest.mark.parametrize("distance", [1e2, 1e4, 1e6])
def test_far_from_every_kernel(supremum: Callable[..., Supremum], distance: float) -> None:
    """The speed is that of the drift alone, and the slope is almost zero; of a channel nothing is left."""
    field = of_facts(FACTS["target_field"])
    low, high = np.full(3, distance), np.full(3, distance + 30.0)
    found = supremum(field, low, high, planar=False)
    assert found.exact
    if supremum is largest_speed:
        assert found.seen == pytest.approx(np.linalg.norm(FACTS["target_field"]["drift"]), abs=2.0 / distance)
        assert largest_speed(field, low, high, planar=False, drift=False).upper <= 2.0 / distance
    else:
        assert found.upper <= 2.0 / distance**2
    jet = supremum(field_of(2, channels=[[0, 0, 1, 0, 5.0, 0.5, 2.0]]), low, high, planar=True)
    assert (jet.upper, jet.seen, jet.exact) == (0.0, 0.0, True)


@BOTH
@pytest.mark.parametrize("core", [0.0, 1e-200])
@pytest.mark.parametrize("n", [2, 3])
def test_without_a_core_the_supremum_is_infinite(supremum: Callable[..., Supremum], n: int, core: float) -> None:
    centre, axis = [1.0, 2.0, 0.0][:n], [[], [0.0, 0.0, 1.0]][n - 2]
    for field in (field_of(n, core, sources=[[*centre, 1.0]]), field_of(n, core, vortices=[[*centre, *axis, 1.0]])):
        for planar in (True, False):
            for low, high in (([-5, -5, -5], [5, 5, 5]), ([1, 2, 0], [1, 2, 0]), ([1, -3, 0], [2, 2, 1])):
                found = supremum(field, low, high, planar=planar)
                assert found.upper == found.seen == np.inf
                np.testing.assert_array_equal(found.where[:2], [1.0, 2.0])
            found = supremum(field, [1.5, 1.5, -1.0], [3.0, 3.0, 1.0], planar=planar)
            assert found.exact
            assert np.isfinite(found.upper)
    off = field_of(3, core, sources=[[0, 0, 2.0, 1.0]])  # two metres over the plane
    assert lipschitz_constant(off, [-5, -5], [5, 5], planar=True).upper == pytest.approx(1.0 / 8.0, rel=0.02)


@pytest.mark.parametrize("planar", [True, False])
def test_a_drift_alone_is_exact(planar: bool) -> None:
    still = {"sources": [[0.0, 0.0, 0.0, 0.0]], "vortices": [[0, 0, 0, 0, 0, 0, 1.0], [0, 0, 0, 0, 0, 1.0, 0.0]]}
    for field in (field_of(3, drift=[3.0, 4.0, 12.0]), field_of(3, 0.1, [3.0, 4.0, 12.0], **still)):
        low, high = np.full(3, -1e6), np.full(3, 1e6)
        speed = largest_speed(field, low, high, planar=planar, tolerance=0.0)
        assert speed.upper == speed.seen == (5.0 if planar else 13.0)
        assert not speed.where.any()  # the centre of the box
        assert speed.exact
        for none in (
            largest_speed(field, low, high, planar=planar, tolerance=0.0, drift=False),
            lipschitz_constant(field, low, high, planar=planar, tolerance=0.0),
        ):
            assert none.upper == none.seen == 0.0
            assert none.exact


@examples(150)
@given(seed=SEEDS, space=SPACES)
def test_leaving_out_the_drift(seed: int, space: tuple[int, bool]) -> None:
    (n, planar), rng = space, np.random.default_rng(seed)
    field = random_field(rng, n)
    still = field.model_copy(update={"drift": None})
    low, high = random_box(rng, 2 if planar else 3)
    same(largest_speed(field, low, high, planar=planar, drift=False), largest_speed(still, low, high, planar=planar))


def same(one: Supremum, other: Supremum) -> None:
    assert (one.upper, one.seen, one.exact) == (other.upper, other.seen, other.exact)
    np.testing.assert_array_equal(one.where, other.where)


@BOTH
def test_when_the_cells_run_out_the_bound_still_holds(supremum: Callable[..., Supremum]) -> None:
    field, box = of_facts(FACTS["target_field"]), ([-60, -60, -70], [120, 120, 10])
    good = supremum(field, *box, planar=False, tolerance=1e-3)
    assert good.exact
    last = np.inf
    for cells in (1, 10, 30):
        found = supremum(field, *box, planar=False, tolerance=1e-3, most_cells=cells)
        assert not found.exact
        assert good.seen <= found.upper <= last
        last = found.upper


def test_shapes() -> None:
    """A planar vehicle's point has two numbers; a planar field ignores the z of a box."""
    plane, space = of_facts(FACTS["agent_field"]), of_facts(FACTS["target_field"])
    assert flow_scale(field_of(2, 12.0, sources=[[0.0, 0.0, 1.0]]).table, 3.0, 4.0, 6.0) == pytest.approx(13.0)
    for field in (plane, space):
        same(
            largest_speed(field, [-1, -1], [1, 1], planar=True),
            largest_speed(field, [-1, -1, 5], [1, 1, 6], planar=True),
        )
    tall = largest_speed(plane, [-1, -1, 5], [1, 1, 7], planar=False)
    flat = largest_speed(plane, [-1, -1], [1, 1], planar=False)
    assert (tall.upper, tall.seen) == (flat.upper, flat.seen)
    assert (tall.where[2], len(flat.where)) == (6.0, 2)
