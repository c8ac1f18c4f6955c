"""Vehicles near one another, by a grid of cells, for compiled code.

Space is cut into cells at least as wide as the range, so that the neighbours of a vehicle lie in its own cell and those
around it. Cells along x follow one another, and vehicles are sorted by cell, so that three cells in a row are one run
of vehicles. There are at most two cells a vehicle: the work is proportional to the number of vehicles.
"""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, Take
from mjsheaf.jit import inline_jit, jit
from mjsheaf.vehicles.vectors import square_of, subtract, triple

_FARTHEST = 1e10  # m; positions beyond it are a blow-up, which is reported elsewhere
_USUAL = 4.0  # mean distances from the middle, within which cells end
_ROUNDING = 1e-12  # fraction by which cells are wider, because a product may round up
_GROWTH = 1.25  # of the cells' width until there are few enough
_FEW = 32  # vehicles that lie in one cell, which is quicker than several


class Cells(NamedTuple):
    """A grid of cells; all of its arrays are scratch space, and what is found with them does not depend on it.

    They hold whole numbers as float64, as all that is part of the one array of a run.

    Attributes:
        places: Positions of all vehicles in one space, shape (V, 3), m.
        corner: Smallest coordinates of the grid, shape (3,), m.
        shape: Number of cells along each axis, and how many there are in a metre, shape (4,).
        cell: Number of each vehicle's cell, shape (V,).
        start: Where the vehicles of each cell begin in `order`, shape (2 V + 1,).
        order: Vehicles sorted by cell, and in a cell by number, shape (V,).
        sorted: Positions in this order, shape (V, 3), m.
        found: Vehicles near one vehicle, not in order, shape (V,).
    """

    places: Array
    corner: Array
    shape: Array
    cell: Array
    start: Array
    order: Array
    sorted: Array
    found: Array


def new_cells(V: int, take: Take = np.zeros) -> Cells:
    """Return room for the cells of V vehicles; none at all for none."""
    some = V > 0
    return Cells(
        places=take((V, 3)),
        corner=take(3 * some),
        shape=take(4 * some),
        cell=take(V),
        start=take((2 * V + 1) * some),
        order=take(V),
        sorted=take((V, 3)),
        found=take(V),
    )


@inline_jit
def _lay_out(cells, reach):
    """Choose the width of the cells and their number along each axis; return False for positions that blew up.

    The few vehicles that are far from all others count for the outermost cells: they would make all cells wide.
    """
    V, shape = cells.places.shape[0], cells.shape
    for axis in range(3):
        lowest, highest, total, away = np.inf, -np.inf, 0.0, 0.0
        for v in range(V):
            x = cells.places[v, axis]
            if not abs(x) <= _FARTHEST:
                return False
            lowest = min(lowest, x)
            highest = max(highest, x)
            total += x
        middle = total / V
        for v in range(V):
            away += abs(cells.places[v, axis] - middle)
        usual = _USUAL * away / V
        cells.corner[axis] = max(lowest, middle - usual)
        shape[axis] = max(min(highest, middle + usual) - cells.corner[axis], 0.0)
    width = np.inf if V <= _FEW else max(reach, 1e-3)
    while _cells_along(shape, 0, width) * _cells_along(shape, 1, width) * _cells_along(shape, 2, width) > 2.0 * V:
        width *= _GROWTH
    for axis in range(3):
        shape[axis] = _cells_along(shape, axis, width)
    shape[3] = (1.0 - _ROUNDING) / width
    return True


@inline_jit
def _cells_along(extent, axis, width):
    return np.floor(extent[axis] / width) + 1.0


@inline_jit
def _place_along(cells, axis, value):
    """Return the number of the cell along an axis that holds a coordinate, or the nearest one."""
    place = (value - cells.corner[axis]) * cells.shape[3]
    return int(min(max(place, 0.0), cells.shape[axis] - 1.0))


@jit
def sort_into_cells(cells, reach):
    """Sort the vehicles at `cells.places` into cells.

    Args:
        cells: The grid, with the present places.
        reach: Distance within which every vehicle's neighbours are wanted, m.

    Returns:
        False if a position is not a number or huge.
    """
    if not _lay_out(cells, reach):
        return False
    V, start = cells.places.shape[0], cells.start
    count = int(cells.shape[0] * cells.shape[1] * cells.shape[2])
    for c in range(count + 1):
        start[c] = 0.0
    for v in range(V):
        x, y, z = triple(cells.places[v])
        row = _place_along(cells, 2, z) * int(cells.shape[1]) + _place_along(cells, 1, y)
        cell = row * int(cells.shape[0]) + _place_along(cells, 0, x)
        cells.cell[v] = cell
        start[cell] += 1.0
    for c in range(count):
        start[c + 1] += start[c]
    for v in range(V - 1, -1, -1):  # so that each cell's vehicles keep their order, and `start` ends where they begin
        cell = int(cells.cell[v])
        start[cell] -= 1.0
        k = int(start[cell])
        cells.order[k] = v
        for i in range(3):
            cells.sorted[k, i] = cells.places[v, i]
    return True


@inline_jit
def find_near(cells, v, reach, near):
    """Write the numbers of the vehicles within `reach` of vehicle v to `near`, in order, and return how many there are.

    The vehicles are sorted by `sort_into_cells` for this reach.
    """
    own, count, farthest = triple(cells.places[v]), 0, reach * reach
    column, line, layer = _place_along(cells, 0, own[0]), _place_along(cells, 1, own[1]), _place_along(cells, 2, own[2])
    wide, high, deep = int(cells.shape[0]), int(cells.shape[1]), int(cells.shape[2])
    for k in range(max(layer - 1, 0), min(layer + 2, deep)):
        for j in range(max(line - 1, 0), min(line + 2, high)):
            row = (k * high + j) * wide
            first, end = cells.start[row + max(column - 1, 0)], cells.start[row + min(column + 2, wide)]
            for n in range(int(first), int(end)):  # without a branch, which would be mispredicted
                cells.found[count] = cells.order[n]
                within = square_of(subtract(own, triple(cells.sorted[n]))) <= farthest
                count += within & (cells.order[n] != v)
    for n in range(count):
        m = n
        while m > 0 and near[m - 1] > cells.found[n]:
            near[m] = near[m - 1]
            m -= 1
        near[m] = cells.found[n]
    return count
