"""Velocity nearest to a desired one, against quadprog, linear programs, and the conditions of optimality."""

import numpy as np
import pytest
import quadprog  # type: ignore[import-not-found]
from scipy.optimize import linprog

from mjsheaf.arrays import Array
from mjsheaf.law.safety import nearest, nearest_within


def random_rows(rng: np.random.Generator, count: int, dimension: int) -> Array:
    rows = np.zeros((count, 5))
    normals = rng.normal(size=(count, dimension))
    rows[:, :dimension] = normals / np.linalg.norm(normals, axis=1)[:, None]
    rows[:, 3] = rng.normal(size=count) - rng.uniform(0.0, 1.5)
    return rows


def slack(rows: Array, u: Array) -> Array:
    return rows[:, :3] @ u - rows[:, 3]


def by_quadprog(rows: Array, wanted: Array, dimension: int) -> Array | None:
    try:
        u = quadprog.solve_qp(np.eye(dimension), wanted[:dimension], rows[:, :dimension].T, rows[:, 3])[0]
    except ValueError:  # no velocity satisfies all
        return None
    return np.array([*u, 0.0][:3])


@pytest.mark.parametrize("dimension", [2, 3])
def test_it_is_what_quadprog_finds(dimension: int) -> None:
    rng = np.random.default_rng(dimension)
    met = {True: 0, False: 0}
    for _ in range(2000):
        rows = random_rows(rng, int(rng.integers(1, 21)), dimension)
        wanted = np.zeros(3)
        wanted[:dimension] = 3.0 * rng.normal(size=dimension)
        found, *u = nearest(rows, len(rows), 0.0, *wanted)
        theirs = by_quadprog(rows, wanted, dimension)
        assert found == (theirs is not None)
        met[found] += 1
        if theirs is not None:
            np.testing.assert_allclose(u, theirs, atol=1e-10)
    assert min(met.values()) > 200


def test_the_order_of_constraints_does_not_matter() -> None:
    rng = np.random.default_rng(5)
    for _ in range(300):
        rows = random_rows(rng, 8, 3)
        wanted = 3.0 * rng.normal(size=3)
        one = nearest(rows, 8, 0.0, *wanted)
        other = nearest(rng.permutation(rows), 8, 0.0, *wanted)
        assert one[0] == other[0]
        if one[0]:
            np.testing.assert_allclose(one[1:], other[1:], atol=1e-10)


def test_a_command_that_satisfies_all_stays_to_the_bit() -> None:
    rng = np.random.default_rng(6)
    for _ in range(500):
        rows = random_rows(rng, 10, 3)
        wanted = rng.normal(size=3)
        rows[:, 3] = np.minimum(rows[:, 3], rows[:, :3] @ wanted)
        assert nearest(rows, 10, 0.0, *wanted) == (True, *wanted)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_limit_is_part_of_the_problem_where_a_bound_is_positive(dimension: int) -> None:
    """The result is allowed, and no direction in which it may move brings it nearer: the conditions of a minimum."""
    rng = np.random.default_rng(10 + dimension)
    limited = 0.0
    for _ in range(500):
        rows = random_rows(rng, int(rng.integers(1, 6)), dimension)
        wanted = np.zeros(3)
        wanted[:dimension] = 4.0 * rng.normal(size=dimension)
        limit = float(rng.uniform(0.3, 3.0))
        *u, violation = nearest_within(rows, len(rows), limit, *wanted)
        u = np.array(u)
        if violation > 0.0 or rows[:, 3].max() <= 0.0:
            continue
        assert np.linalg.norm(u) <= limit * (1.0 + 1e-12)
        assert slack(rows, u).min() > -1e-9
        limited += float(np.linalg.norm(u) > limit * (1.0 - 1e-9))
        for _ in range(200):  # a convex set: all of it lies on the far side of the plane through u across u - wanted
            other = rng.normal(size=3)
            other[dimension:] = 0.0
            other *= limit * rng.random() ** (1.0 / 3.0) / np.linalg.norm(other)
            if slack(rows, other).min() >= 0.0:
                assert (u - wanted) @ (other - u) > -1e-7
    assert limited > 30


def test_a_command_that_is_scaled_to_the_limit_still_satisfies_bounds_that_are_not_positive() -> None:
    rng = np.random.default_rng(20)
    for _ in range(500):
        rows = random_rows(rng, 6, 3)
        rows[:, 3] = -np.abs(rows[:, 3])
        *u, violation = nearest_within(rows, 6, 1.0, *(5.0 * rng.normal(size=3)))
        assert violation == 0.0
        shorter = np.array(u) * min(1.0, 1.0 / np.linalg.norm(u))
        assert slack(rows, shorter).min() > -1e-12


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_violation_is_the_least_largest_one(dimension: int) -> None:
    rng = np.random.default_rng(30 + dimension)
    seen = 0
    for _ in range(300):
        rows = random_rows(rng, 12, dimension)
        rows[:, 3] += 1.0
        *u, violation = nearest_within(rows, 12, np.inf, *rng.normal(size=dimension), *np.zeros(3 - dimension))
        cost = np.zeros(dimension + 1)
        cost[-1] = 1.0
        sides = np.column_stack([-rows[:, :dimension], -np.ones(12)])
        bounds = [(None, None)] * dimension + [(0.0, None)]
        least = linprog(cost, A_ub=sides, b_ub=-rows[:, 3], bounds=bounds).fun
        assert violation == pytest.approx(least, abs=1e-9)
        assert slack(rows, np.array(u)).min() > -violation - 1e-9
        seen += violation > 0.0
    assert seen > 100


def test_planes_that_are_parallel_or_nearly_so() -> None:
    rows = np.array([[1.0, 0, 0, 1.0, 0], [1.0, 0, 0, 2.0, 0], [-1.0, 0, 0, -3.0, 0]])
    assert nearest(rows, 3, 0.0, 0.0, 5.0, 0.0) == (True, 2.0, 5.0, 0.0)
    assert nearest(rows, 3, 0.0, 9.0, 5.0, 0.0) == (True, 3.0, 5.0, 0.0)
    rows[2, 3] = -1.5  # between 2 and 1.5: nothing
    assert not nearest(rows, 3, 0.0, 0.0, 5.0, 0.0)[0]
    x, y, _, violation = nearest_within(rows, 3, np.inf, 0.0, 5.0, 0.0)
    assert (x, y, violation) == (pytest.approx(1.75), pytest.approx(5.0), pytest.approx(0.25))
    tilted = np.array([[1.0, 0, 0, 1.0, 0], [np.cos(1e-6), np.sin(1e-6), 0, 1.0, 0]])
    found, *u = nearest(tilted, 2, 0.0, 0.0, 0.0, 0.0)
    assert found
    assert slack(tilted, np.array(u)).min() > -1e-9


def nearly_degenerate(rng: np.random.Generator, dimension: int) -> tuple[Array, Array]:
    """Planes that are repeated, nearly parallel, through one line, all upright, or that w nearly lies on.

    Sets of allowed velocities are no thinner than 1e-8, because quadprog takes thinner ones for empty.
    """
    rows = random_rows(rng, int(rng.integers(3, 9)), dimension)
    wanted = np.zeros(3)
    wanted[:dimension] = 3.0 * rng.normal(size=dimension)
    kind = rng.integers(5)
    if kind == 0:
        rows[1] = rows[0]
    elif kind == 1:
        rows[1, :3] = rows[0, :3]
        rows[1, :dimension] += 1e-3 * rng.normal(size=dimension)
        rows[1, :3] /= np.linalg.norm(rows[1, :3])
        rows[1, 3] = rows[0, 3] + 1e-3 * rng.normal()
    elif kind == 2:
        at = rng.normal(size=3)
        at[dimension:] = 0.0
        rows[:3, 3] = rows[:3, :3] @ at - 10.0 ** rng.uniform(-8, -3, 3)
    elif kind == 3 and dimension == 3:
        rows[:, 2] = 0.0
        rows[:, :3] /= np.linalg.norm(rows[:, :3], axis=1)[:, None]
    else:
        rows[:, 3] = np.minimum(rows[:, 3], rows[:, :3] @ wanted - 1e-3)
        rows[0, 3] = rows[0, :3] @ wanted + 10.0 ** rng.uniform(-16, -6) * rng.choice([-1, 1])
    return rows, wanted


@pytest.mark.parametrize("dimension", [2, 3])
def test_it_is_what_quadprog_finds_where_planes_are_nearly_degenerate(dimension: int) -> None:
    rng = np.random.default_rng(40 + dimension)
    met = {True: 0, False: 0}
    for _ in range(2000):
        rows, wanted = nearly_degenerate(rng, dimension)
        found, *u = nearest(rows, len(rows), 0.0, *wanted)
        theirs = by_quadprog(rows, wanted, dimension)
        assert found == (theirs is not None)
        met[found] += 1
        if theirs is not None:
            np.testing.assert_allclose(u, theirs, atol=1e-10)
    assert min(met.values()) > 100


def touching(rng: np.random.Generator, dimension: int) -> tuple[Array, float]:
    """Sets of allowed velocities that are thin, of nearly a point, or that rounding makes empty; and a speed limit."""
    rows = random_rows(rng, int(rng.integers(3, 7)), dimension)
    limit = float(rng.uniform(0.3, 2.0))
    kind = rng.integers(4)
    if kind == 0:  # a plane touches the ball
        rows[0, 3] = limit * (1.0 - 10.0 ** rng.uniform(-17, -6) * rng.choice([-1, 1]))
    elif kind == 1:  # two planes face each other
        rows[1, :3] = -rows[0, :3]
        rows[1, 3] = -rows[0, 3] + 10.0 ** rng.uniform(-17, -6) * rng.choice([-1, 0, 1])
    elif kind == 2:  # three planes around an empty prism
        between = -rows[:2, :3].T @ rng.dirichlet([1.0, 1.0])
        rows[2, :3] = between / np.linalg.norm(between)
        rows[:3, 3] = rng.uniform(0.0, 0.15, 3)
    else:
        rows[:, 3] += 2.0
    return rows, limit


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_rounding_is_not_amplified(dimension: int) -> None:
    """Changes in the last bit change the result by less than 1e-8 m/s, wherever constraints and the limit touch."""
    rng = np.random.default_rng(50 + dimension)
    for _ in range(2000):
        rows, limit = touching(rng, dimension)
        wanted = np.zeros(3)
        wanted[:dimension] = 4.0 * rng.normal(size=dimension)
        result = nearest_within(rows, len(rows), limit, *wanted)
        for _ in range(4):
            other = rows * (1.0 + 2.0**-53 * rng.integers(-2, 3, rows.shape))
            moved = nearest_within(other, len(rows), limit, *(wanted * (1.0 + 2.0**-53 * rng.integers(-2, 3, 3))))
            np.testing.assert_allclose(moved, result, rtol=0.0, atol=1e-8)
