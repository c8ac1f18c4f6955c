"""Vehicles near one another, by a list of cells, for compiled code.

Space is cut into cells at least as wide as the range, so that the neighbours of a vehicle lie in its own cell and those
around it. Cells along x follow one another, and vehicles are sorted by cell, so that three cells in a row are one run
of vehicles. There are at most two cells a vehicle: the work is proportional to the number of vehicles.
"""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.jit import inline_jit, jit
from mjsheaf.vehicles.vectors import add, subtract, triple

_FARTHEST = 1e10  # m; positions beyond it are a blow-up, which is reported elsewhere
_USUAL = 4.0  # mean distances from the middle, within which cells end
_ROUNDING = 1e-12  # by which cells are wider: a product may round up
_GROWTH = 1.25  # of the cells' width until there are few enough


class Cells(NamedTuple):
    """A list of cells; all of its arrays are scratch space, overwritten at every sample.

    They hold whole numbers as float64, as arrays do that every world of a batch has for itself.

    Attributes:
        places: Positions of all vehicles in one space, shape (V, 3), m.
        corner: Smallest coordinates, shape (3,), m.
        shape: Number of cells along each axis, and how many there are in a metre, shape (4,).
        start: Where the vehicles of each cell begin in `order`, shape (2 V + 3,).
        order: Vehicles sorted by cell, shape (V,).
        cell: Cell of each vehicle, shape (V,).
    """

    places: Array
    corner: Array
    shape: Array
    start: Array
    order: Array
    cell: Array


def new_cells(V: int) -> Cells:
    """Return room for a list of cells of V vehicles; none at all for none."""
    some = V > 0
    places, corner, shape = np.zeros((V, 3)), np.zeros(3 * some), np.zeros(4 * some)
    return Cells(places, corner, shape, np.zeros((2 * V + 3) * some), np.zeros(V), np.zeros(V))


@inline_jit
def cell_along(cells, axis, value):
    """Return the number of the cell along an axis that holds a coordinate, or the nearest one."""
    place = (value - cells.corner[axis]) * cells.shape[3]
    return int(min(max(place, 0.0), cells.shape[axis] - 1.0))


@inline_jit
def _lay_out(cells, reach):
    """Choose the width of the cells and their number along each axis; return False for positions that blew up.

    The few vehicles that are far from all others count for the outermost cells: they would make all cells wide.
    """
    V = cells.places.shape[0]
    lowest = (np.inf, np.inf, np.inf)
    highest = (-np.inf, -np.inf, -np.inf)
    total = (0.0, 0.0, 0.0)
    known = True
    for v in range(V):
        x = triple(cells.places[v])
        known &= (abs(x[0]) < _FARTHEST) & (abs(x[1]) < _FARTHEST) & (abs(x[2]) < _FARTHEST)
        lowest = (min(lowest[0], x[0]), min(lowest[1], x[1]), min(lowest[2], x[2]))
        highest = (max(highest[0], x[0]), max(highest[1], x[1]), max(highest[2], x[2]))
        total = add(total, x)
    if not known:
        return False
    middle = (total[0] / V, total[1] / V, total[2] / V)
    away = (0.0, 0.0, 0.0)
    for v in range(V):
        apart = subtract(triple(cells.places[v]), middle)
        away = add(away, (abs(apart[0]), abs(apart[1]), abs(apart[2])))
    for axis in range(3):
        usual = _USUAL * away[axis] / V
        low, high = max(lowest[axis], middle[axis] - usual), min(highest[axis], middle[axis] + usual)
        cells.corner[axis] = low
        cells.shape[axis] = max(high - low, 0.0)
    width = max(reach, 1e-3)
    count = np.inf
    while count > 2.0 * V:
        count = 1.0
        for axis in range(3):
            count *= np.floor(cells.shape[axis] / width) + 1.0
        if count > 2.0 * V:
            width *= _GROWTH
    for axis in range(3):
        cells.shape[axis] = np.floor(cells.shape[axis] / width) + 1.0
    cells.shape[3] = (1.0 - _ROUNDING) / width
    return True


@jit
def sort_into_cells(cells, reach):
    """Sort the vehicles at `cells.places` into cells for neighbours within `reach`, m.

    Returns:
        False if a position is not a number or huge.
    """
    if not _lay_out(cells, reach):
        return False
    V = cells.places.shape[0]
    count = int(cells.shape[0] * cells.shape[1] * cells.shape[2])
    for c in range(count + 1):
        cells.start[c] = 0.0
    for v in range(V):
        x, y, z = cells.places[v, 0], cells.places[v, 1], cells.places[v, 2]
        row = cell_along(cells, 2, z) * int(cells.shape[1]) + cell_along(cells, 1, y)
        cell = row * int(cells.shape[0]) + cell_along(cells, 0, x)
        cells.cell[v] = cell
        cells.start[cell + 1] += 1.0
    for c in range(count):
        cells.start[c + 1] += cells.start[c]
    for k in range(V):  # from the last vehicle back, so that each cell's vehicles keep their order
        v = V - 1 - k
        cell = int(cells.cell[v])
        cells.start[cell + 1] -= 1.0
        cells.order[int(cells.start[cell + 1])] = v
    for c in range(count):  # what was counted down is where the next cell began
        cells.start[c] = cells.start[c + 1]
    cells.start[count] = V
    return True
