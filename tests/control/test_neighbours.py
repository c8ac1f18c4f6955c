"""The list of cells finds all pairs within range, whatever the places."""

import numpy as np
import pytest

from mjsheaf.arrays import Array
from mjsheaf.control.neighbours import Cells, cell_of, new_cells, row_around, sort_into_cells


def candidates(cells: Cells, v: int) -> list[int]:
    """Vehicles in the cells around that of vehicle v, as the filter visits them."""
    found = [int(j) for j in cells.near[v, : max(int(cells.listed[v]), 0)]]
    for row in range(9 if cells.listed[v] < 0 else 0):
        first, end = row_around(cells, cell_of(cells, v), row)
        found += [int(j) for j in cells.order[first:end]]
    return found


def clouds() -> list[Array]:
    rng = np.random.default_rng(0)
    flat = rng.uniform(-30, 30, (200, 3)) * [1, 1, 0]
    lost = rng.uniform(-10, 10, (120, 3))
    lost[7] = [1e6, -1e6, 50.0]
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3)
    line = np.column_stack([np.arange(50.0), np.zeros(50), np.zeros(50)])
    return [rng.uniform(-20, 20, (300, 3)), flat, lost, grid, line, np.zeros((6, 3)), np.array([[3.0, 4.0, 5.0]])]


@pytest.mark.parametrize("k", range(7))
@pytest.mark.parametrize("reach", [1e-6, 1.0, 3.0, 1000.0])
def test_every_pair_within_range_is_found_once(k: int, reach: float) -> None:
    places = clouds()[k]
    cells = new_cells(len(places))
    cells.places[:] = places
    assert sort_into_cells(cells, reach)
    away = np.linalg.norm(places[:, None] - places, axis=-1)
    for v in range(len(places)):
        near = candidates(cells, v)
        assert len(near) == len(set(near))
        assert set(np.flatnonzero(away[v] <= reach)) - {v} <= set(near)


@pytest.mark.parametrize("step", [0.0, 0.01, 0.1, 0.3, 1.0, 30.0])
def test_no_pair_is_missed_while_vehicles_move(step: float) -> None:
    """A sort serves for several samples: some pairs come within range long after it, at any speed."""
    rng = np.random.default_rng(2)
    places, reach, sorts = rng.uniform(-20.0, 20.0, (150, 3)) * [1, 1, 0.2], 2.0, 0
    heading = rng.normal(size=(150, 3))
    heading *= step / np.linalg.norm(heading, axis=1, keepdims=True)
    cells = new_cells(150)
    for k in range(60):
        before = cells.sorted.copy()
        cells.places[:] = places
        assert sort_into_cells(cells, reach if k < 40 else 3.0)  # an event may change the range
        sorts += bool((cells.sorted != before).any())
        away = np.linalg.norm(places[:, None] - places, axis=-1)
        for v in range(150):
            assert set(np.flatnonzero(away[v] <= reach)) - {v} <= set(candidates(cells, v))
        places = places + heading * rng.uniform(0.5, 1.0)
    assert sorts <= 60 * min(1.0, step / 0.125 + 0.05)


def test_a_team_that_moves_as_one_is_sorted_once_and_lists_are_in_order() -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(-20.0, 20.0, (150, 3))
    cells = new_cells(150)
    for k in range(90):
        moved = places + k * np.array([0.4, -0.3, 0.1]) + rng.uniform(-0.05, 0.05, (150, 3))
        cells.places[:] = moved
        assert sort_into_cells(cells, 4.0)
        if k == 0:
            before = cells.sorted.copy()
        away = np.linalg.norm(moved[:, None] - moved, axis=-1)
        for v in range(0, 150, 10):
            assert candidates(cells, v) == sorted(candidates(cells, v))
            assert set(np.flatnonzero(away[v] <= 4.0)) - {v} <= set(candidates(cells, v))
    np.testing.assert_array_equal(cells.sorted, before)


def test_the_work_is_proportional_to_the_number_of_vehicles() -> None:
    rng = np.random.default_rng(1)
    visited = []
    for V in (500, 4000):
        places = rng.uniform(0.0, 5.0 * np.sqrt(V), (V, 3)) * [1, 1, 0]
        places[0] = [1e5, 0.0, 0.0]  # one that is lost does not make the cells of the others wide
        cells = new_cells(V)
        cells.places[:] = places
        assert sort_into_cells(cells, 4.0)
        visited.append(np.mean([len(candidates(cells, v)) for v in range(V)]))
    assert visited[1] < 1.3 * visited[0]


def test_positions_that_blew_up_are_refused() -> None:
    for bad in (np.nan, np.inf, 1e30):
        cells = new_cells(3)
        cells.places[1, 2] = bad
        assert not sort_into_cells(cells, 1.0)
