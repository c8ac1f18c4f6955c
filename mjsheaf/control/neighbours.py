"""Vehicles near one another, by a list of cells, for compiled code.

Space is cut into cells at least as wide as the range, so that the neighbours of a vehicle lie in its own cell and those
around it. Cells along x follow one another, and vehicles are sorted by cell, so that three cells in a row are one run
of vehicles. There are at most two cells a vehicle: the work is proportional to the number of vehicles.

A sort serves while no vehicle is farther than half of a slack from where it was sorted (L. Verlet, Phys. Rev. 159,
1967): two that are within `reach` then were within reach + slack at the sort. Hence cells are as wide as that, and a
vehicle is looked for where it was sorted. If few were within reach + slack, they are listed at the sort, and the list
takes the place of the cells.
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
_SLACK = 0.125  # of the reach
_LISTED = 16  # maximum number of neighbours that are listed for a vehicle


class Cells(NamedTuple):
    """A list of cells; all of its arrays are scratch space, and what is found with them does not depend on it.

    They hold whole numbers as float64, as arrays do that every world of a batch has for itself.

    Attributes:
        places: Positions of all vehicles in one space, shape (V, 3), m.
        sorted: Positions when they were sorted, shape (V, 3), m.
        near: Vehicles within `reach` + slack of each vehicle when they were sorted, shape (V, 16).
        listed: Number of vehicles in each row of `near`; -1.0 if there was no room for all, shape (V,).
        corner: Smallest coordinates, shape (3,), m.
        shape: Number of cells along each axis, how many there are in a metre, and the reach, shape (5,).
        start: Where the vehicles of each cell begin in `order`, shape (2 V + 3,).
        order: Vehicles sorted by cell, shape (V,).
        cell: Cell of each vehicle, shape (V,).
    """

    places: Array
    sorted: Array
    near: Array
    listed: Array
    corner: Array
    shape: Array
    start: Array
    order: Array
    cell: Array


def new_cells(V: int) -> Cells:
    """Return room for a list of cells of V vehicles; none at all for none."""
    some = V > 0
    corner, shape, start = np.zeros(3 * some), np.zeros(5 * some), np.zeros((2 * V + 3) * some)
    near, listed = np.zeros((V, _LISTED)), np.zeros(V)
    return Cells(np.zeros((V, 3)), np.zeros((V, 3)), near, listed, corner, shape, start, np.zeros(V), np.zeros(V))


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


@inline_jit
def cell_of(cells, v):
    """Return the number of the cell of vehicle v along each axis."""
    x = triple(cells.sorted[v])
    return cell_along(cells, 0, x[0]), cell_along(cells, 1, x[1]), cell_along(cells, 2, x[2])


@inline_jit
def row_around(cells, cell, row):
    """Return where the vehicles in one of the nine rows of three cells around a cell begin and end in `cells.order`."""
    line, layer = cell[1] + row % 3 - 1, cell[2] + row // 3 - 1
    wide, high, deep = int(cells.shape[0]), int(cells.shape[1]), int(cells.shape[2])
    if line < 0 or line >= high or layer < 0 or layer >= deep:
        return 0, 0
    first = (layer * high + line) * wide
    return int(cells.start[first + max(cell[0] - 1, 0)]), int(cells.start[first + min(cell[0] + 2, wide)])


@jit
def sort_into_cells(cells, reach):
    """Sort the vehicles at `cells.places` into cells, if the last sort does not serve.

    Args:
        cells: List of cells, with the present places.
        reach: Distance within which every vehicle's neighbours are wanted, m.

    Returns:
        False if a position is not a number or huge.
    """
    V = cells.places.shape[0]
    serves = cells.shape[4] == reach
    most = 0.5 * _SLACK * reach
    for v in range(V):
        serves &= _square_between(cells.places[v], cells.sorted[v]) <= most * most  # not so for what is not a number
    if serves:
        return True
    cells.shape[4] = 0.0
    if not _lay_out(cells, (1.0 + _SLACK) * reach):
        return False
    _fill(cells)
    for v in range(V):
        cells.listed[v] = _list_near(cells, v, (1.0 + _SLACK) * reach)
    cells.shape[4] = reach
    return True


@inline_jit
def _square_between(a, b):
    """Compute |a - b|^2."""
    x, y, z = subtract(triple(a), triple(b))
    return x * x + y * y + z * z


@inline_jit
def _list_near(cells, v, reach):
    """List the vehicles within `reach` of vehicle v, and return their number; -1.0 if there is no room for all."""
    cell, count = cell_of(cells, v), 0
    for row in range(9):
        first, end = row_around(cells, cell, row)
        for k in range(first, end):
            j = int(cells.order[k])
            if j == v or _square_between(cells.places[v], cells.places[j]) > reach * reach * (1.0 + _ROUNDING):
                continue
            if count == _LISTED:
                return -1.0
            cells.near[v, count] = j
            count += 1
    return float(count)


@inline_jit
def _fill(cells):
    """Count the vehicles of each cell, and sort them."""
    V = cells.places.shape[0]
    count = int(cells.shape[0] * cells.shape[1] * cells.shape[2])
    for c in range(count + 1):
        cells.start[c] = 0.0
    for v in range(V):
        x = triple(cells.places[v])
        row = cell_along(cells, 2, x[2]) * int(cells.shape[1]) + cell_along(cells, 1, x[1])
        cell = row * int(cells.shape[0]) + cell_along(cells, 0, x[0])
        cells.cell[v] = cell
        cells.start[cell + 1] += 1.0
        for i in range(3):
            cells.sorted[v, i] = x[i]
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
