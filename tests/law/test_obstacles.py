"""Distances from obstacles, against a minimisation over their points, and the laws that the filter rests on."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.law.obstacles import ObstacleArrays, distance_from, distances, nearest_points, pack_obstacles
from mjsheaf.law.safety import Safety

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
