"""Parts of the filter that keeps vehicles apart: nearest velocities, pairs within range, distances from obstacles.

Oracles: quadprog, linear programs, conditions of optimality; all pairs; a minimisation over the points of an obstacle.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import quadprog  # type: ignore[import-not-found]
from scipy.optimize import linprog, minimize

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.law.obstacles import ObstacleArrays, distance_from, distances, nearest_points, pack_obstacles
from mjsheaf.law.safety import Cells, Safety, find_near, nearest, nearest_within, new_cells, sort_into_cells


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
        others = rng.normal(size=(200, 3))
        others[:, dimension:] = 0.0
        others *= (limit * rng.random(200) ** (1.0 / 3.0) / np.linalg.norm(others, axis=1))[:, None]
        allowed = others[(others @ rows[:, :3].T >= rows[:, 3]).all(axis=1)]
        # A convex set: all of it lies on the far side of the plane through u across u - wanted.
        assert ((allowed - u) @ (u - wanted)).min(initial=0.0) > -1e-7
    assert limited > 30


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


def random_problem(rng: np.random.Generator, dimension: int) -> tuple[Array, Array]:
    rows = random_rows(rng, int(rng.integers(1, 21)), dimension)
    return rows, np.array([*3.0 * rng.normal(size=dimension), 0.0][:3])


@pytest.mark.parametrize("problem", [random_problem, nearly_degenerate])
@pytest.mark.parametrize("dimension", [2, 3])
def test_it_is_what_quadprog_finds(problem: Callable[..., tuple[Array, Array]], dimension: int) -> None:
    """In whatever order the constraints come."""
    rng = np.random.default_rng(40 + dimension)
    met = {True: 0, False: 0}
    for _ in range(2000):
        rows, wanted = problem(rng, dimension)
        found, *u = nearest(rows, len(rows), 0.0, *wanted)
        theirs = by_quadprog(rows, wanted, dimension)
        assert found == (theirs is not None)
        met[found] += 1
        if theirs is not None:
            np.testing.assert_allclose(u, theirs, atol=1e-10)
    assert min(met.values()) > (200 if problem is random_problem else 100)


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


def near(cells: Cells, v: int, reach: float) -> list[int]:
    found = np.full(len(cells.places), -1.0)
    count = find_near(cells, v, reach, found)
    return [int(j) for j in found[:count]]


def clouds() -> list[Array]:
    rng = np.random.default_rng(0)
    flat = rng.uniform(-30, 30, (200, 3)) * [1, 1, 0]
    lost = rng.uniform(-10, 10, (120, 3))
    lost[7] = [1e6, -1e6, 50.0]
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3)
    line = np.column_stack([np.arange(50.0), np.zeros(50), np.zeros(50)])
    return [rng.uniform(-20, 20, (300, 3)), flat, lost, grid, line, np.zeros((6, 3)), np.array([[3.0, 4.0, 5.0]])]


@pytest.mark.parametrize("k", range(7))
def test_every_vehicle_within_range_is_found_once_and_in_order(k: int) -> None:
    """The cells forget where vehicles were, and what the range was."""
    cells, rng = new_cells(len(clouds()[k])), np.random.default_rng(2)
    for reach in (1e-6, 1.0, 3.0, 1000.0, 0.5):
        cells.places[:] = places = rng.permutation(clouds()[k])
        assert sort_into_cells(cells, reach)
        away = places[:, None] - places
        within = (away * away) @ np.ones(3) <= reach * reach
        for v in range(len(places)):
            assert near(cells, v, reach) == [j for j in np.flatnonzero(within[v]) if j != v]


def test_the_work_is_proportional_to_the_number_of_vehicles() -> None:
    rng = np.random.default_rng(1)
    visited = []  # vehicles in a vehicle's own cell, on average
    for V in (500, 4000):
        places = rng.uniform(0.0, 5.0 * np.sqrt(V), (V, 3)) * [1, 1, 0]
        places[0] = [1e5, 0.0, 0.0]  # one that is lost does not make the cells of the others wide
        cells = new_cells(V)
        cells.places[:] = places
        assert sort_into_cells(cells, 4.0)
        visited.append(np.square(np.bincount(cells.cell.astype(int))).sum() / V)
    assert visited[1] < 1.3 * visited[0]


def test_positions_that_blew_up_are_refused() -> None:
    for bad in (np.nan, np.inf, 1e30):
        cells = new_cells(3)
        cells.places[1, 2] = bad
        assert not sort_into_cells(cells, 1.0)


MOTION = {"kind": "lissajous", "amplitude": [1.0, 2.0, 0.5], "rate": [0.3, 0.2, 0.7], "phase": [0.1, 0.2, 0.3]}
SOME: list[dict[str, Any]] = [
    {"kind": "sphere", "centre": [1.0, 2.0, 3.0], "radius": 1.5},
    {"kind": "capsule", "ends": [[-2.0, 0.0, 1.0], [3.0, 1.0, 2.0]], "radius": 0.7},
    {"kind": "box", "centre": [0.0, -1.0, 0.5], "sides": [3.0, 1.0, 2.0], "heading": 30.0, "motion": MOTION},
    {"kind": "half_space", "point": [0.0, 0.0, -4.0], "normal": [0.5, 0.2, 2.0]},
    {"kind": "sphere", "centre": [4.0, -3.0], "radius": 0.5},
    {"kind": "capsule", "ends": [[0.0, 0.0, -1.0], [0.0, 0.0, 3.0]], "radius": 0.4},
]


def packed(height: float = 0.0) -> ObstacleArrays:
    return pack_obstacles(Safety.model_validate({"distance": 1.0, "obstacles": SOME}).obstacles, height, 0.0, 10.0)


def nearest_point(k: int, p: Array) -> Array:
    """The point of obstacle k's core at time 0 that is nearest, by minimisation."""
    one = SOME[k]
    if one["kind"] == "capsule":
        a, b = np.array(one["ends"])
        share = minimize(lambda s: ((a + s * (b - a) - p) ** 2).sum(), 0.5, bounds=[(0, 1)], tol=1e-14).x
        return np.asarray(a + share * (b - a))
    angle = np.deg2rad(one["heading"])
    axes = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    half = 0.5 * np.array(one["sides"])
    at = minimize(lambda q: ((one["centre"] + axes.T @ q - p) ** 2).sum(), 0 * half, bounds=[(-h, h) for h in half]).x
    return np.asarray(one["centre"] + axes.T @ at)


def test_distances_are_those_of_a_minimisation() -> None:
    obstacles, rng = packed(), np.random.default_rng(0)
    for p in rng.uniform(-6.0, 6.0, (60, 3)):
        found = distances(obstacles, np.zeros(1), p[None, None])[0, 0]
        assert found[0] == pytest.approx(np.linalg.norm(p - [1, 2, 3]) - 1.5)
        assert found[1] == pytest.approx(np.linalg.norm(p - nearest_point(1, p)) - 0.7, abs=1e-6)
        away = np.linalg.norm(p - nearest_point(2, p))
        assert found[2] == pytest.approx(away, abs=1e-5) if away > 1e-4 else found[2] < 1e-4
        normal = np.array([0.5, 0.2, 2.0]) / np.linalg.norm([0.5, 0.2, 2.0])
        assert found[3] == pytest.approx((p - [0, 0, -4]) @ normal)


def test_the_obstacle_lies_behind_its_plane_and_the_normal_is_the_gradient() -> None:
    """The proof requires dist(q) >= dist(p) + n . (q - p) for every q, with equality to first order."""
    obstacles, rng = packed(), np.random.default_rng(1)
    for _ in range(400):
        k, p, q = int(rng.integers(len(SOME))), rng.uniform(-6, 6, 3), rng.uniform(-6, 6, 3)
        away, *normal = distance_from(obstacles, k, 0.0, *p)
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        there, *_ = distance_from(obstacles, k, 0.0, *q)
        if away > 0.0:
            assert there >= away + np.dot(normal, q - p) - 1e-9
        step = 1e-6 * rng.normal(size=3)
        after, *_ = distance_from(obstacles, k, 0.0, *(p + step))
        assert after - away == pytest.approx(np.dot(normal, step), abs=3e-9 if abs(away) > 1e-3 else 1e-5)


def test_nearest_points_lie_on_the_surface_as_far_away_as_it_is() -> None:
    obstacles, rng = packed(), np.random.default_rng(2)
    points = np.repeat(rng.uniform(-6.0, 6.0, (30, 3)), len(SOME), axis=0)
    which, times = np.tile(np.arange(len(SOME)), 30), np.zeros(30 * len(SOME))
    of_each = np.arange(len(which)), which
    away = distances(obstacles, np.zeros(1), points[None])[0][of_each]
    near = nearest_points(obstacles, which, times, points)
    outside = away > 1e-6
    assert np.linalg.norm(points - near, axis=1) == pytest.approx(np.abs(away))
    assert distances(obstacles, np.zeros(1), near[None])[0][of_each][outside] == pytest.approx(0.0, abs=1e-9)


def test_one_that_moves_is_no_faster_than_its_bound() -> None:
    obstacles = packed()
    times = np.linspace(0.0, 10.0, 2001)
    points = np.broadcast_to(np.array([5.0, 4.0, 1.0]), (2001, 1, 3))
    away = distances(obstacles, times, points)[:, 0]
    rate = np.abs(np.diff(away, axis=0)).max(axis=0) / (times[1] - times[0])
    assert (rate <= obstacles.speed + 1e-9).all()
    assert rate[2] > 0.3 * obstacles.speed[2]
    assert obstacles.speed[[0, 1, 3]].max() == 0.0


def test_an_obstacle_in_the_plane_is_at_the_height_of_the_surface() -> None:
    at = distances(packed(height=2.5), np.zeros(1), np.array([[[4.0, -3.0, 3.5]]]))
    assert at[0, 0, 4] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("obstacle", "told"),
    [
        ({"kind": "capsule", "ends": [[0, 0], [0, 0]], "radius": 1}, "two different points"),
        ({"kind": "half_space", "point": [0, 0], "normal": [0, 0]}, "expected a direction"),
        ({"kind": "sphere", "centre": [0, 0], "radius": 0}, "greater than 0"),
        ({"kind": "cone", "centre": [0, 0]}, "sphere"),
    ],
)
def test_bad_obstacles_are_refused(obstacle: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        Safety.model_validate({"distance": 1.0, "obstacles": [obstacle]})


def test_a_motion_of_another_dimension_is_refused() -> None:
    one = {"kind": "sphere", "centre": [0, 0], "radius": 1, "motion": MOTION}
    with pytest.raises(InputError, match=r"safety\.obstacles"):
        pack_obstacles(Safety.model_validate({"distance": 1.0, "obstacles": [one]}).obstacles, 0.0, 0.0, 1.0)
