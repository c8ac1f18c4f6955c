"""The list of cells finds all pairs within range, whatever the places."""

import numpy as np
import pytest

from mjsheaf.arrays import Array
from mjsheaf.law.safety import Cells, find_near, new_cells, sort_into_cells


def near(cells: Cells, v: int, reach: float) -> list[int]:
    """Vehicles within reach of vehicle v, as the filter finds them."""
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
@pytest.mark.parametrize("reach", [1e-6, 1.0, 3.0, 1000.0])
def test_every_vehicle_within_range_is_found_once_and_in_order(k: int, reach: float) -> None:
    places = clouds()[k]
    cells = new_cells(len(places))
    cells.places[:] = places
    assert sort_into_cells(cells, reach)
    away = places[:, None] - places
    within = (away * away) @ np.ones(3) <= reach * reach
    for v in range(len(places)):
        assert near(cells, v, reach) == [j for j in np.flatnonzero(within[v]) if j != v]


def test_a_grid_forgets_where_vehicles_were_and_what_the_range_was() -> None:
    rng = np.random.default_rng(2)
    cells = new_cells(150)
    for reach in (2.0, 3.0, 0.5):
        cells.places[:] = rng.uniform(-20.0, 20.0, (150, 3)) * [1, 1, 0.2]
        assert sort_into_cells(cells, reach)
        away = np.linalg.norm(cells.places[:, None] - cells.places, axis=-1)
        for v in range(150):
            assert near(cells, v, reach) == [j for j in np.flatnonzero(away[v] <= reach) if j != v]


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
