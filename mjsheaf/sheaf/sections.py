"""Sections that vanish on some vertices: proved along a forest where that can be, decomposed where it cannot.

The sections of a sheaf are those P r (see `forest`) that all edges accept: a small problem instead of a large one. That
none was missed is proved: delta x >= |x| / |G| for x orthogonal to P, so that delta has at most dim r singular values
under 1 / |G|, which is compared with the tolerance of the rank. Rotations give |G|^2 <= depth times size of a tree, far
from any tolerance. Components for which the bound is too weak are left to the general method of `kernel`.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mjsheaf.sheaf.assembly import coboundary_matrix
from mjsheaf.sheaf.edges import EdgeTable, product
from mjsheaf.sheaf.forest import Forest, grow, propagate
from mjsheaf.sheaf.kernel import DENSE_COLUMNS, largest_singular_value, sparse_kernel_basis

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_SINGLE_DIRECTIONS = 64  # free directions of one component; with more of them the small problem is not small
_ENTRIES = 30_000_000  # of P
_MARGIN = 2.0  # for the rounding of the bounds
_ACCURATE = 1e-7  # relative: sections are then good to rounding over this
_ROUNDING = 64 * np.finfo(np.float64).eps


def section_basis(t: EdgeTable, free: NDArray[np.bool_], rtol: float) -> sparse.csc_array:
    """Orthonormal basis of the sections that vanish where `free` is false, rows by the columns of the free vertices.

    Args:
        t: the edges, without inner products.
        free: which vertices are free, shape (V,).
        rtol: singular values of delta on the free vertices of at most rtol times the largest count as zero.
    """
    found, left = proved_sections(t, free, rtol)
    dimension = np.diff(t.column)
    if not found and not left.any():
        return sparse.csc_array((int(dimension[free].sum()), 0))
    of_column = np.repeat(np.arange(len(free)), dimension)
    kept = free[of_column]
    number = np.cumsum(kept) - 1
    basis = _stacked([(number[place], Q) for place, Q in found], int(kept.sum()))
    if not left.any():
        return basis
    delta = coboundary_matrix(t)
    at = np.flatnonzero(left[of_column])
    rest = sparse_kernel_basis(delta[:, at], rtol, largest_singular_value(delta[:, kept])).tocoo()
    rest = sparse.coo_array((rest.data, (number[at[rest.row]], rest.col)), shape=(basis.shape[0], rest.shape[1]))
    return sparse.hstack([basis, rest], format="csc")


def _stacked(blocks: list[tuple[Index, Array]], size: int) -> sparse.csc_array:
    """Blocks of columns, each on some rows of its own, as one matrix of `size` rows without their rounding errors."""
    rows, columns, values, count = [], [], [], 0
    for place, Q in blocks:
        row, column = np.nonzero(np.abs(Q) > _ROUNDING * np.abs(Q).max(axis=0, initial=0.0))
        rows.append(place[row])
        columns.append(count + column)
        values.append(Q[row, column])
        count += Q.shape[1]
    if not blocks:
        return sparse.csc_array((size, 0))
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sparse.coo_array(entries, shape=(size, count)).tocsc()


def proved_sections(
    t: EdgeTable, free: NDArray[np.bool_], rtol: float
) -> tuple[list[tuple[Index, Array]], NDArray[np.bool_]]:
    """Sections that vanish on the held vertices, of the components for which a forest proves that they are all.

    Args:
        t: the edges, without inner products.
        free: which vertices are free, shape (V,).
        rtol: singular values of delta on the free vertices of at most rtol times the largest count as zero.

    Returns:
        For each component with sections its columns of delta (k,) and an orthonormal basis on them (k, dimension); and
        the free vertices that belong to other components, shape (V,).
    """
    forest = grow(t, free)
    G = np.sqrt(forest.rows * forest.columns)
    enough = _MARGIN * rtol * forest.norm_high  # singular values of at least this are surely not zero
    dimension = np.diff(t.column)
    root = free & (forest.parent == -1) & (dimension > 0)
    open_ = np.bincount(forest.component[root], dimension[root], len(free)).astype(np.int64)  # dim r by component
    undecided = G * enough > 1.0
    small = open_ <= _SINGLE_DIRECTIONS
    undecided |= (open_ > 0) & (~small | (G * _ACCURATE * forest.norm_high > 1.0))
    wanted = np.flatnonzero((open_ > 0) & ~undecided)
    if open_[wanted].max(initial=0) * t.column[-1] > _ENTRIES:
        undecided[wanted], wanted = True, wanted[:0]
    found: list[tuple[Index, Array]] = []
    if wanted.size:
        found, failed = _accepted(t, free, forest, G, open_, wanted, rtol, enough)
        undecided[failed] = True
    return found, free & undecided[forest.component]


def _accepted(
    t: EdgeTable,
    free: NDArray[np.bool_],
    forest: Forest,
    G: Array,
    open_: Index,
    wanted: Index,
    rtol: float,
    enough: float,
) -> tuple[list[tuple[Index, Array]], list[int]]:
    """The sections P r of the wanted components that the other edges accept, and the components left undecided."""
    chosen = np.zeros(len(free), dtype=bool)
    chosen[wanted] = True
    chosen = free & chosen[forest.component]
    slot = np.full(len(free), -1)
    slot[chosen] = 0
    dimension = np.diff(t.column)
    used = np.zeros(len(free), dtype=np.int64)
    for v in np.flatnonzero(chosen & (forest.parent == -1)):
        slot[v] = used[forest.component[v]]
        used[forest.component[v]] += dimension[v]
    P = propagate(t, free, forest, slot, int(open_[wanted].max()))

    of_column = np.repeat(np.where(chosen, forest.component, -1), dimension)
    places = _grouped(of_column, wanted)
    for c, place in zip(wanted, places, strict=True):
        P[place, : open_[c]] = np.linalg.qr(P[place, : open_[c]])[0]
    image = product(t, P)
    end = np.where(chosen[t.tail], t.tail, t.head)
    of_edge = np.where(chosen[end], forest.component[end], -1)
    of_row = np.empty(t.rows, dtype=np.int64)
    of_row[np.repeat(t.row - np.cumsum(t.size) + t.size, t.size) + np.arange(t.rows)] = np.repeat(of_edge, t.size)
    found: list[tuple[Index, Array]] = []
    failed: list[int] = []
    for c, place, image_rows in zip(wanted, places, _grouped(of_row, wanted), strict=True):
        Q, W = P[place, : open_[c]], image[image_rows, : open_[c]]
        if np.linalg.norm(W) > rtol * forest.norm_low:  # else all of Q is null
            if len(W) < W.shape[1]:
                W = np.vstack([W, np.zeros((W.shape[1] - len(W), W.shape[1]))])
            _, s, V = np.linalg.svd(np.linalg.qr(W, mode="r"))
            null = s <= rtol * forest.norm_low
            above = float(s[~null].min(initial=np.inf))
            # Of x = P r + G y orthogonal to the null part, what of P r is not null is at most
            # (1 + |delta| |G|) |y| / above, and the rest at most 2 |G| |y|.
            inverse = float((1.0 + forest.norm_high * G[c]) / above + 2.0 * G[c])
            weak = inverse * enough > 1.0 or (null.any() and inverse * _ACCURATE * forest.norm_high > 1.0)
            if weak or (null.any() and len(place) <= DENSE_COLUMNS):  # where it can, `kernel` keeps the axes apart
                failed.append(int(c))
                continue
            Q = Q @ V[null].T
        found.append((place, Q))
    return found, failed


def _grouped(label: Index, wanted: Index) -> list[Index]:
    """The places of each of the wanted labels, ascending."""
    order = np.argsort(label, kind="stable")
    begin, end = (np.searchsorted(label[order], wanted, side) for side in ("left", "right"))
    return [order[i:j] for i, j in zip(begin.tolist(), end.tolist(), strict=True)]
