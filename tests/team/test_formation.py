"""Formations: shapes about their centroid.

Oracles: distances and angles of the shapes, the paper's vertices of a tetrahedron, and the displacements of the
published run.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.errors import InputError
from mjsheaf.team.edges import Explicit, Line, Polygon, Tetrahedron
from tests.builders import FACTS


def named(count: int) -> dict[str, Any]:
    return {"name": "g", "members": [f"A{k}" for k in range(count)]}


def polygon(count: int, **options: Any) -> np.ndarray:
    return Polygon(**named(count), **options).corners()


def line(count: int, **options: Any) -> np.ndarray:
    return Line(**named(count), **options).corners()


def tetrahedron(side: float) -> np.ndarray:
    return Tetrahedron(**named(4), side=side).corners()


sizes = st.floats(0.01, 1e3)
bearings = st.floats(-360.0, 360.0)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@given(st.integers(2, 9), sizes, bearings, st.booleans())
def test_polygons_are_regular(count: int, side: float, angle: float, clockwise: bool) -> None:
    corners = polygon(count, side=side, angle=angle, clockwise=clockwise)
    radius = np.linalg.norm(corners, axis=1)
    np.testing.assert_allclose(corners.mean(axis=0), 0.0, atol=1e-12 * side * count)
    np.testing.assert_allclose(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1), side, rtol=1e-10)
    np.testing.assert_allclose(radius, radius[0], rtol=1e-12)
    np.testing.assert_allclose(corners, polygon(count, radius=radius[0], angle=angle, clockwise=clockwise))
    heading = np.deg2rad(angle)
    np.testing.assert_allclose(corners[0], radius[0] * np.array([np.cos(heading), np.sin(heading)]), rtol=1e-9)
    if count > 2:
        turning = cross(corners[0], corners[1])
        assert turning < 0 if clockwise else turning > 0


@given(sizes)
def test_tetrahedron_is_the_papers_about_its_centroid(d: float) -> None:
    s3, s6 = np.sqrt(3.0), np.sqrt(6.0)
    vertices = d * np.array([[0, 0, 0], [1, 0, 0], [1 / 2, s3 / 2, 0], [1 / 2, s3 / 6, s6 / 3]])
    np.testing.assert_allclose(tetrahedron(d), vertices - vertices.mean(axis=0), atol=1e-13 * d)


def test_tetrahedron_of_the_published_run() -> None:
    given_places = np.array(FACTS["target_displacement"])
    side = float(np.linalg.norm(given_places[0] - given_places[1]))
    np.testing.assert_allclose(tetrahedron(side), given_places, rtol=0, atol=1e-12)


def test_polygons_of_the_published_run() -> None:
    given_places = np.array(FACTS["agent_displacement"])
    radius = given_places[0, 1]
    for triangle in range(3):
        np.testing.assert_allclose(
            polygon(3, radius=radius, clockwise=True), given_places[3 * triangle : 3 * triangle + 3], rtol=0, atol=1e-12
        )
    side = given_places[10, 0] - given_places[9, 0]
    square = polygon(4, side=side, angle=225.0)
    np.testing.assert_allclose(square, given_places[9:], rtol=0, atol=1e-12)


@given(st.integers(1, 9), sizes, bearings)
def test_lines_are_straight_and_evenly_spaced(count: int, spacing: float, angle: float) -> None:
    places = line(count, spacing=spacing, angle=angle)
    along = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    np.testing.assert_allclose(places.mean(axis=0), 0.0, atol=1e-12 * spacing * count)
    np.testing.assert_allclose(np.diff(places, axis=0), np.tile(spacing * along, (count - 1, 1)), atol=1e-11 * spacing)


def test_members_get_displacements_in_their_own_dimension() -> None:
    corners = polygon(3, radius=2.0, angle=0.0)
    boat, aircraft, other = Polygon(**named(3), radius=2.0, angle=0.0, height=5.0).places([2, 3, 3])
    np.testing.assert_array_equal(boat, corners[0])
    np.testing.assert_array_equal(aircraft, [*corners[1], 5.0])
    np.testing.assert_array_equal(other, [*corners[2], 5.0])
    solid = Tetrahedron(**named(4), side=1.0, height=1.0).places([3, 3, 2, 3])
    np.testing.assert_allclose(solid[3], tetrahedron(1.0)[3] + [0, 0, 1])
    np.testing.assert_array_equal(solid[2], tetrahedron(1.0)[2, :2])


def test_explicit_displacements_are_kept() -> None:
    places = Explicit(**named(2), displacements=((1, 2), np.array([3, 4, 5]))).places([2, 3])  # type: ignore[arg-type]
    assert [list(o) for o in places] == [[1, 2], [3, 4, 5]]
    low, high = Explicit(**named(2), displacements=[[1, 2], [3, 4, 5]], height=2.0).places([2, 3])
    assert [list(low), list(high)] == [[1, 2], [3, 4, 7]]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: polygon(1, side=1.0), "a polygon does not have 1 members"),
        (lambda: polygon(3, shape="square", side=1.0), "a square does not have 3 members"),
        (lambda: polygon(3), "give either side or radius"),
        (lambda: polygon(3, side=1.0, radius=1.0), "give either side or radius"),
        (lambda: Tetrahedron(**named(2), side=1.0).places([3, 3]), "4 places but the formation has 2 mem"),
        (lambda: Explicit(**named(2), displacements=[[0, 0]]).places([2, 2]), "1 displacements for 2 members"),
        (lambda: Explicit(**named(1), displacements=[[0, 0, 0]]).places([2]), "displacement 0 has 3 entries.*2"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
