"""Vehicles near one another, by a list of cells, for compiled code.

Space is cut into cells at least as wide as the range, so that the neighbours of a vehicle lie in its own cell and those
around it. Cells along x follow one another, and vehicles are sorted by cell, so that three cells in a row are one run
of vehicles. There are at most two cells a vehicle: the work is proportional to the number of vehicles.

A sort serves for some time (L. Verlet, Phys. Rev. 159, 1967). Let d_v be the displacement of vehicle v since the sort,
and c any vector. The distance of two vehicles has changed by at most |d_v - d_j| <= |d_v - c| + |d_j - c|. If no d_v is
farther than half of a slack from c, two that are within `reach` were within reach + slack at the sort. With c in the
middle of the displacements, a team that moves as one is sorted once. Hence cells are as wide as reach + slack, and a
vehicle is looked for where it was sorted. If few were within reach + slack, they are listed at the sort, and the list
takes the place of the cells. The slack is doubled or halved from sort to sort, as lists have room and sorts last.
"""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.jit import inline_jit, jit
from mjsheaf.vehicles.vectors import add, square_of, subtract, triple

_FARTHEST = 1e10  # m; positions beyond it are a blow-up, which is reported elsewhere
_USUAL = 4.0  # mean distances from the middle, within which cells end
_ROUNDING = 1e-12  # by which cells are wider: a product may round up
_GROWTH = 1.25  # of the cells' width until there are few enough
_SLACKS = (0.125, 1.0)  # smallest and largest slack, of the reach
_LISTED = 32  # maximum number of neighbours that are listed for a vehicle
_FEW = 22  # if no list is longer than that over 1 + slack, the slack may be doubled
_SHORT, _LASTING = 10, 40  # samples: if a sort serves for fewer, the slack is doubled; if for more, halved
_ASTRAY = 100.0  # of the slack; c beyond it is rounded too much


class Cells(NamedTuple):
    """A list of cells; all of its arrays are scratch space, and what is found with them does not depend on it.

    They hold whole numbers as float64, as arrays do that every world has for itself.

    Attributes:
        places: Positions of all vehicles in one space, shape (V, 3), m.
        sorted: Positions when they were sorted, shape (V, 3), m.
        near: Vehicles within `reach` + slack of each vehicle when they were sorted, shape (V, <= 33).
        listed: Number of vehicles in each row of `near`; -1.0 if there was no room for all, shape (V,).
        found: Vehicles near each vehicle in the order in which they were found, shape (V, <= 33).
        lengths: Number of vehicles in each row of `found`, or for which there was no room, shape (V,).
        corner: Smallest coordinates, shape (3,), m.
        shape: Number of cells along each axis, how many there are in a metre, the reach in m, the slack as a
            fraction of the reach, that of the next sort, and the samples since the last one, shape (8,).
        start: Where the vehicles of each cell begin in `order`, shape (2 V + 3,).
        order: Vehicles sorted by cell, shape (V,).
        lined: Positions in this order, shape (3, V), m.
        cell: Cell of each vehicle, shape (V,).
    """

    places: Array
    sorted: Array
    near: Array
    listed: Array
    found: Array
    lengths: Array
    corner: Array
    shape: Array
    start: Array
    order: Array
    lined: Array
    cell: Array


def new_cells(V: int) -> Cells:
    """Return room for a list of cells of V vehicles; none at all for none."""
    some, room = V > 0, min(V, _LISTED + 1)
    return Cells(
        places=np.zeros((V, 3)),
        sorted=np.zeros((V, 3)),
        near=np.zeros((V, room)),
        listed=np.zeros(V),
        found=np.zeros((V, room)),
        lengths=np.zeros(V),
        corner=np.zeros(3 * some),
        shape=np.zeros(8 * some),
        start=np.zeros((2 * V + 3) * some),
        order=np.zeros(V),
        lined=np.zeros((3, V)),
        cell=np.zeros(V),
    )


@inline_jit
def cell_along(cells, axis, value):
    """Return the number of the cell along an axis that holds a coordinate, or the nearest one."""
    place = (value - cells.corner[axis]) * cells.shape[3]
    return int(min(max(place, 0.0), cells.shape[axis] - 1.0))


@inline_jit
def _extent(cells, since):
    """Return the smallest, largest and sum of the places less `since` (0.0 or 1.0) times those at the last sort, m."""
    lowest = (np.inf, np.inf, np.inf)
    highest = (-np.inf, -np.inf, -np.inf)
    total = (0.0, 0.0, 0.0)
    for v in range(cells.places.shape[0]):
        x, y, z = triple(cells.sorted[v])
        d = subtract(triple(cells.places[v]), (since * x, since * y, since * z))
        lowest = (min(lowest[0], d[0]), min(lowest[1], d[1]), min(lowest[2], d[2]))
        highest = (max(highest[0], d[0]), max(highest[1], d[1]), max(highest[2], d[2]))
        total = add(total, d)
    return lowest, highest, total


@inline_jit
def _lay_out(cells, reach):
    """Choose the width of the cells and their number along each axis; return False for positions that blew up.

    The few vehicles that are far from all others count for the outermost cells: they would make all cells wide.
    """
    V = cells.places.shape[0]
    lowest, highest, total = _extent(cells, 0.0)
    if not square_of(total) < np.inf or max(max(highest), -min(lowest)) > _FARTHEST:  # the first for what is no number
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


@inline_jit
def square_between(cells, v, j):
    """Compute the squared distance of two vehicles, m^2."""
    return square_of(subtract(triple(cells.places[v]), triple(cells.places[j])))


@jit
def sort_into_cells(cells, reach):
    """Sort the vehicles at `cells.places` into cells, if the last sort does not serve.

    Args:
        cells: List of cells, with the present places.
        reach: Distance within which every vehicle's neighbours are wanted, m.

    Returns:
        False if a position is not a number or huge.
    """
    cells.shape[7] += 1.0
    if cells.shape[4] == reach and _serves(cells, cells.shape[5] * reach):
        return True
    share = min(max(cells.shape[6], _SLACKS[0]), _SLACKS[1])
    cells.shape[4] = 0.0
    if not _lay_out(cells, (1.0 + share) * reach):
        return False
    _fill(cells)
    longest = _list_near(cells, (1.0 + share) * reach)
    cells.shape[4] = reach
    cells.shape[5] = share
    few, lasted = (1.0 + share) * longest <= _FEW, cells.shape[7]
    shorten = longest > _LISTED or lasted > _LASTING
    cells.shape[6] = share * (0.5 if shorten else 2.0 if few and lasted < _SHORT else 1.0)
    cells.shape[7] = 0.0
    return True


@inline_jit
def _serves(cells, slack):
    """Return True if the last sort serves with a slack in m; see the head of this file."""
    lowest, highest, total = _extent(cells, 1.0)
    c, wide = add(lowest, highest), subtract(highest, lowest)
    c = (0.5 * c[0], 0.5 * c[1], 0.5 * c[2])
    known = square_of(total) < np.inf  # not so for what is not a number
    if not known or square_of(c) > _ASTRAY * _ASTRAY * slack * slack:
        return False
    most = 0.25 * slack * slack * (1.0 - _ROUNDING)
    if square_of(wide) <= 4.0 * most:
        return True
    serves = True
    for v in range(cells.places.shape[0]):
        d = subtract(subtract(triple(cells.places[v]), triple(cells.sorted[v])), c)
        serves &= square_of(d) <= most
    return serves


@inline_jit
def _list_near(cells, reach):
    """List the vehicles within `reach` of each vehicle, in their order, and return the length of the longest list.

    Pairs are found once, from the cell that comes first. Then each vehicle is written into the lists of its neighbours.
    """
    V, longest = cells.places.shape[0], 0.0
    for v in range(V):
        cells.lengths[v] = 0.0
        cells.listed[v] = 0.0
    for c in range(int(cells.shape[0] * cells.shape[1] * cells.shape[2])):
        begin, after = int(cells.start[c]), int(cells.start[c + 1])
        if begin < after:
            _find_pairs(cells, begin, after, reach * reach * (1.0 + _ROUNDING))
    for v in range(V):
        longest = max(longest, cells.lengths[v])
        for m in range(int(min(cells.lengths[v], _LISTED))):
            _append(cells.near, cells.listed, int(cells.found[v, m]), v)
    for v in range(V):
        if cells.listed[v] < cells.lengths[v] or cells.lengths[v] > _LISTED:  # it or a neighbour has too many
            cells.listed[v] = -1.0
    return longest


@inline_jit
def _find_pairs(cells, begin, after, farthest):
    """Find pairs of a vehicle of one cell, `begin` to `after` in `cells.order`, and one that comes later, near it."""
    cell = cell_of(cells, int(cells.order[begin]))
    for row in range(4, 9):
        first, end = row_around(cells, cell, row)
        for k in range(begin, after):
            x = cells.lined[0, k], cells.lined[1, k], cells.lined[2, k]
            for m in range(k + 1 if row == 4 else first, end):
                d = subtract(x, (cells.lined[0, m], cells.lined[1, m], cells.lined[2, m]))
                if square_of(d) <= farthest:
                    _append(cells.found, cells.lengths, int(cells.order[k]), cells.order[m])
                    _append(cells.found, cells.lengths, int(cells.order[m]), cells.order[k])


@inline_jit
def _append(lists, lengths, v, j):
    """Append vehicle j to the list of vehicle v, if there is room."""
    lists[v, int(min(lengths[v], _LISTED))] = j
    lengths[v] += 1.0


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
    for v in range(V - 1, -1, -1):  # so that each cell's vehicles keep their order
        cell = int(cells.cell[v])
        cells.start[cell + 1] -= 1.0
        k = int(cells.start[cell + 1])
        cells.order[k] = v
        for i in range(3):
            cells.lined[i, k] = cells.places[v, i]
    for c in range(count):  # what was counted down is where the next cell began
        cells.start[c] = cells.start[c + 1]
    cells.start[count] = V
