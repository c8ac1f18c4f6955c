"""Sections that vanish on some vertices, computed along a forest, with a certificate that none was missed.

If the map F_w of an edge e = (u, w) is injective, the value at u and the residual on e determine the value at w:
x_w = F_w^+ (F_u x_u - y_e). Take a forest of such edges, rooted at fixed vertices, or at free ones if none is
reachable. Only the values r at the free roots remain unknown: x = P r + G y with y = delta x. The sections are those
P r that satisfy all edges. This is a small problem instead of a large one.

The certificate: |delta x| >= |x| / |G| for x orthogonal to P. So delta has at most dim r singular values below 1 / |G|,
which is compared with the tolerance. The inequality |x_w| <= a |x_u| + b |y_e| with a >= |F_w^+ F_u| and b >= |F_w^+|
bounds G entry by entry, and |G|^2 <= |G|_1 |G|_inf, both sums along the forest. Rotations give
|G|^2 <= depth times size of a tree, far from any tolerance. If the bound is too weak for a component, the general
method of `blocks` is used.
"""

from typing import NamedTuple

import numpy as np
from scipy import sparse

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.compile.jit import allocating_jit, inline_jit, jit
from mjsheaf.compile.tiers import Tiered
from mjsheaf.sheaf.blocks import DENSE_COLUMNS, ROUNDING, assembled, largest_singular_value, sparse_null_space
from mjsheaf.sheaf.edges import EdgeTable, coboundary_matrix, product, ranges

_LEAST_CONDITION = 1e-3  # of maps that may carry a value on along a forest
_MOST_OPEN = 64  # free directions of one component; with more of them the small problem is not small
_MOST_FOREST_ENTRIES = 30_000_000  # of P
_BOUND_MARGIN = 2.0  # for the rounding of the bounds
_SECTION_ACCURACY = 1e-7  # relative: sections are then good to rounding over this


class Forest(NamedTuple):
    """Forest on the free vertices.

    Attributes:
        order: Free vertices, each after its parent, shape (W,).
        parent: Edge to the parent of each vertex, -1 at free roots, shape (V,).
        component: Number of each vertex's component, the same for connected free vertices, at most V, shape (V,).
        rows, columns: Bounds on |G|_inf and |G|_1 of each component, shape (V,).
        norm_low, norm_high: Bounds on the largest singular value of delta on the free vertices.
    """

    order: IntArray
    parent: IntArray
    component: IntArray
    rows: Array
    columns: Array
    norm_low: float
    norm_high: float


@inline_jit
def _gram_matrix(F, at, m, n, L):
    """Fill L with F^T F of the map (m, n) that begins at `at`."""
    for a in range(n):
        for b in range(a + 1):
            L[a, b] = 0.0
            for k in range(m):
                L[a, b] += F[at + k * n + a] * F[at + k * n + b]
            L[b, a] = L[a, b]


@inline_jit
def _gershgorin(L, n):
    """Return bounds (largest, smallest) of the eigenvalues of the symmetric L (n, n)."""
    largest = 0.0
    smallest = np.inf
    for a in range(n):
        off = 0.0
        for b in range(n):
            off += abs(L[a, b]) if b != a else 0.0
        largest = max(largest, L[a, a] + off)
        smallest = min(smallest, L[a, a] - off)
    return largest, smallest


@inline_jit
def _factorise(L, n, tolerance):
    """Replace L by its Cholesky factor; return False if a pivot is not above the tolerance."""
    for a in range(n):
        for b in range(a + 1):
            for k in range(b):
                L[a, b] -= L[a, k] * L[b, k]
            if b < a:
                L[a, b] /= L[b, b]
        if not L[a, a] > tolerance:
            return False
        L[a, a] = np.sqrt(L[a, a])
    return True


@inline_jit
def _substitute(L, n, column):
    """Replace a column by L^-1 times it."""
    for a in range(n):
        for k in range(a):
            column[a] -= L[a, k] * column[k]
        column[a] /= L[a, a]


@inline_jit
def _inverse_norm(L, n, column):
    """Return the square of the Frobenius norm of L^-1."""
    total = 0.0
    for c in range(n):
        for a in range(n):
            column[a] = 1.0 if a == c else 0.0
        _substitute(L, n, column)
        for a in range(n):
            total += column[a] * column[a]
    return total


@inline_jit
def _solve_map(F, at_w, at_u, m, n, n_u, L, column, M):
    """Fill M (n, n_u) with (F_w^T F_w)^-1 F_w^T F_u, given the Cholesky factor L."""
    for c in range(n_u):
        for a in range(n):
            column[a] = 0.0
            for k in range(m):
                column[a] += F[at_w + k * n + a] * F[at_u + k * n_u + c]
        _substitute(L, n, column)
        for a in range(n - 1, -1, -1):
            for k in range(a + 1, n):
                column[a] -= L[k, a] * column[k]
            column[a] /= L[a, a]
            M[a, c] = column[a]


@inline_jit
def _norm_bound(M, n, n_u):
    """Bound |M| (n, n_u) by Gershgorin's theorem on M^T M or by the Frobenius norm."""
    frobenius = 0.0
    rows = 0.0
    for b in range(n_u):
        row = 0.0
        for c in range(n_u):
            total = 0.0
            for a in range(n):
                total += M[a, b] * M[a, c]
            row += abs(total)
            frobenius += total if b == c else 0.0
        rows = max(rows, row)
    return np.sqrt(min(frobenius, rows))


@inline_jit
def _carry(t, e, u, w, work):
    """Fill M = F_w^+ F_u (n_w, n_u); return bounds (a, b) of |M| and |F_w^+|, or (-1, -1) where F_w is not injective.

    Bounds are tight for multiples of isometries: Gershgorin's on F_w^T F_w and on M^T M, or the Frobenius norm. M is
    work[0].
    """
    F = t.F
    m = t.size[e]
    n = t.column[w + 1] - t.column[w]
    n_u = t.column[u + 1] - t.column[u]
    at_u, at_w = (t.at_tail[e], t.at_head[e]) if w == t.head[e] else (t.at_head[e], t.at_tail[e])
    if m < n:
        return -1.0, -1.0
    M, L, column = work[0], work[1], work[2, 0]
    _gram_matrix(F, at_w, m, n, L)
    largest, smallest = _gershgorin(L, n)
    if not _factorise(L, n, 1e-14 * largest):
        return -1.0, -1.0
    # Where Gershgorin's bound is poor, 1 / |L^-1|_F^2 is another of the smallest eigenvalue of L L^T.
    if not smallest > 0.5 * largest:
        smallest = max(smallest, 1.0 / _inverse_norm(L, n, column))
    if smallest < _LEAST_CONDITION * _LEAST_CONDITION * largest:
        return -1.0, -1.0
    _solve_map(F, at_w, at_u, m, n, n_u, L, column, M)
    return _norm_bound(M, n, n_u), 1.0 / np.sqrt(smallest)


@jit
def _root(up, v):
    while up[v] != v:
        up[v] = up[up[v]]
        v = up[v]
    return v


@allocating_jit
def _connect(tail, head, free):
    """Return by vertex a vertex closer to the root of its component of free vertices, as `_root` reads it."""
    component = np.arange(len(free))
    for e in range(len(tail)):
        if free[tail[e]] and free[head[e]]:
            i = _root(component, tail[e])
            j = _root(component, head[e])
            component[max(i, j)] = min(i, j)
    return component


@Tiered
@allocating_jit
def _grow(t, free, by_dimension, work):
    """Breadth first from all held vertices at once, then from free roots in the order given; see `Forest`."""
    # The arrays by themselves: reading them from the tuple in a loop costs more than the loop.
    tail, head, first, incident, count = t.tail, t.head, t.first, t.incident, len(free)
    parent = np.full(count, -2, dtype=np.int64)
    order = np.empty(count, dtype=np.int64)
    a, b = np.zeros(count), np.zeros(count)
    reach = np.zeros(count)  # the row of |G| that belongs to a vertex
    held = 0
    for v in range(count):
        if not free[v]:
            order[held] = v
            held += 1
    grown, done = held, 0
    for candidate in range(-1, count):  # -1: from the held vertices
        if candidate >= 0:
            v = by_dimension[candidate]
            if not free[v] or parent[v] != -2:
                continue
            order[grown], parent[v] = v, -1
            grown += 1
        while done < grown:
            u = order[done]
            done += 1
            for at in range(first[u], first[u + 1]):
                e = incident[at]
                w = head[e] if tail[e] == u else tail[e]
                if not free[w] or parent[w] != -2:
                    continue
                carried, inverse = _carry(t, e, u, w, work)
                if carried >= 0.0:
                    parent[w], b[w] = e, inverse
                    a[w] = carried if free[u] else 0.0  # a held vertex carries nothing of x
                    reach[w] = a[w] * reach[u] + b[w]
                    order[grown] = w
                    grown += 1
    component = _connect(tail, head, free)
    rows = np.zeros(count)
    columns = np.zeros(count)
    below = np.ones(count)  # what a unit at a vertex adds to its tree, itself included
    for at in range(grown - 1, held - 1, -1):
        v = order[at]
        component[v] = _root(component, v)
        rows[component[v]] = max(rows[component[v]], reach[v])
        columns[component[v]] = max(columns[component[v]], b[v] * below[v])
        if parent[v] >= 0:
            e = parent[v]
            below[head[e] if tail[e] == v else tail[e]] += a[v] * below[v]
    return order[held:grown], parent, component, rows, columns


@Tiered
@allocating_jit
def _norms(t, free):
    """Bounds of the largest singular value of delta on the free vertices: a column's norm, and sqrt(|.|_1 |.|_inf)."""
    one, square, infinity = np.zeros(t.column[-1] + 1), np.zeros(t.column[-1] + 1), 0.0
    for e in range(len(t.tail)):
        for k in range(t.size[e]):
            row = 0.0
            for v, at in ((t.tail[e], t.at_tail[e]), (t.head[e], t.at_head[e])):
                n = t.column[v + 1] - t.column[v]
                for c in range(n if free[v] else 0):
                    value = abs(t.F[at + k * n + c])
                    row += value
                    one[t.column[v] + c] += value
                    square[t.column[v] + c] += value * value
            infinity = max(infinity, row)
    return np.sqrt(square.max()), np.sqrt(one.max() * infinity)


@jit
def _propagate(t, free, order, parent, slot, P, work):
    """Fill P (n, k): the values everywhere that the free roots determine; vertices whose slot is -1 are left out."""
    M = work[0]
    for v in order:
        begin, n, e = t.column[v], t.column[v + 1] - t.column[v], parent[v]
        u = v if e < 0 else t.head[e] if t.tail[e] == v else t.tail[e]
        if slot[v] < 0 or not free[u]:
            continue
        if e < 0:
            for a in range(n):
                P[begin + a, slot[v] + a] = 1.0
            continue
        _carry(t, e, u, v, work)
        for a in range(n):
            for c in range(P.shape[1]):
                total = 0.0
                for k in range(t.column[u + 1] - t.column[u]):
                    total += M[a, k] * P[t.column[u] + k, c]
                P[begin + a, c] = total


def grow(t: EdgeTable, free: BoolArray) -> Forest:
    """The forest on the free vertices, given by a mask (V,); the others are held at a value."""
    # Vertices of large stalks determine those of small ones, seldom the other way: they make the fewest roots.
    by_dimension = np.argsort(-np.diff(t.column), kind="stable")
    return Forest(*_grow(t, free, by_dimension, _workspace(t)), *_norms(t, free))


def propagate(t: EdgeTable, free: BoolArray, forest: Forest, slot: IntArray, width: int) -> Array:
    """P of the forest, shape (n, width); the roots' values start at columns `slot`, -1 where a tree is left out."""
    P = np.zeros((int(t.column[-1]), width))
    _propagate(t, free, forest.order, forest.parent, slot, P, _workspace(t))
    return P


def _workspace(t: EdgeTable) -> Array:
    """Three matrices as large as the largest stalk needs."""
    widest = int(np.diff(t.column).max(initial=1))
    return np.empty((3, widest, widest))


def section_basis(t: EdgeTable, free: BoolArray, rtol: float) -> sparse.csc_array:
    """Orthonormal basis of the sections that vanish where `free` is false, rows by the columns of the free vertices.

    Arguments are those of `certified_sections`.
    """
    found, left = certified_sections(t, free, rtol)
    dimension = np.diff(t.column)
    rows = int(dimension[free].sum())
    if not found and not left.any():
        return sparse.csc_array((rows, 0))
    of_column = np.repeat(np.arange(len(free)), dimension)
    kept = free[of_column]
    number = np.cumsum(kept) - 1
    blocks, count = [], 0
    for place, Q in found:
        entries = np.where(np.abs(Q) > ROUNDING * np.abs(Q).max(axis=0, initial=0.0), Q, 0.0)
        blocks.append((number[place][:, None], count + np.arange(Q.shape[1]), entries))
        count += Q.shape[1]
    basis = assembled(blocks, (rows, count)).tocsc()
    basis.eliminate_zeros()
    if left.any():
        delta, at = coboundary_matrix(t), np.flatnonzero(left[of_column])
        rest = sparse_null_space(delta[:, at], rtol, largest_singular_value(delta[:, kept]))
        rest = sparse.csc_array((rest.data, number[at][rest.indices], rest.indptr), shape=(rows, rest.shape[1]))
        basis = sparse.hstack([basis, rest], format="csc")
    return basis


def certified_sections(t: EdgeTable, free: BoolArray, rtol: float) -> tuple[list[tuple[IntArray, Array]], BoolArray]:
    """Sections that vanish on the held vertices, of the components for which a forest certifies that they are all.

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
    enough = _BOUND_MARGIN * rtol * forest.norm_high  # singular values of at least this are surely not zero
    root = free & (forest.parent == -1)
    open_ = np.bincount(forest.component[root], np.diff(t.column)[root], len(free)).astype(np.int64)  # dim r
    inaccurate = G * _SECTION_ACCURACY * forest.norm_high > 1.0
    undecided = (G * enough > 1.0) | ((open_ > 0) & (inaccurate | (open_ > _MOST_OPEN)))
    wanted = np.flatnonzero((open_ > 0) & ~undecided)
    if open_[wanted].max(initial=0) * t.column[-1] > _MOST_FOREST_ENTRIES:
        undecided[wanted], wanted = True, wanted[:0]
    found: list[tuple[IntArray, Array]] = []
    if not wanted.size:
        return found, free & undecided[forest.component]

    chosen = np.zeros(len(free), dtype=bool)
    chosen[wanted] = True
    chosen = free & chosen[forest.component]
    P = propagate(t, free, forest, _slots(t, forest, chosen), int(open_[wanted].max()))
    places = _grouped(np.repeat(np.where(chosen, forest.component, -1), np.diff(t.column)), wanted)
    for c, place in zip(wanted, places, strict=True):
        P[place, : open_[c]] = np.linalg.qr(P[place, : open_[c]])[0]
    image = product(t, P)
    end = np.where(chosen[t.tail], t.tail, t.head)
    of_row = np.empty(t.rows, dtype=np.int64)
    of_row[ranges(t.row, t.size)] = np.repeat(np.where(chosen[end], forest.component[end], -1), t.size)
    for c, place, image_rows in zip(wanted, places, _grouped(of_row, wanted), strict=True):
        Q = P[place, : open_[c]]
        W = image[image_rows, : open_[c]]
        if np.linalg.norm(W) > rtol * forest.norm_low:  # else all of Q is null
            null = _certified_null_space(W, forest, float(G[c]), rtol)
            # In small components the general method keeps the axes apart.
            if null is None or (len(null) and len(place) <= DENSE_COLUMNS):
                undecided[c] = True
                continue
            Q = Q @ null.T
        found.append((place, Q))
    return found, free & undecided[forest.component]


def _certified_null_space(W: Array, forest: Forest, G: float, rtol: float) -> Array | None:
    """Return an orthonormal basis, as rows, of all r that are null in W = delta P; None if singular values are unclear.

    G bounds the forest's G in the component; see `certified_sections`.
    """
    square = np.vstack([W, np.zeros((max(W.shape[1] - len(W), 0), W.shape[1]))])
    _, s, V = np.linalg.svd(np.linalg.qr(square, mode="r"))
    null = s <= rtol * forest.norm_low
    above = float(s[~null].min(initial=np.inf))
    # Of x = P r + G y orthogonal to the null part, what of P r is not null is at most
    # (1 + |delta| |G|) |y| / above, and the rest at most 2 |G| |y|.
    inverse = float((1.0 + forest.norm_high * G) / above + 2.0 * G)
    enough = _BOUND_MARGIN * rtol * forest.norm_high
    weak = inverse * enough > 1.0 or (null.any() and inverse * _SECTION_ACCURACY * forest.norm_high > 1.0)
    return None if weak else V[null]


def _slots(t: EdgeTable, forest: Forest, chosen: BoolArray) -> IntArray:
    """First column in P of each free root's values, counted in each component apart; 0 at others, -1 if not chosen."""
    dimension, used = np.diff(t.column), np.zeros(len(chosen), dtype=np.int64)
    slot = np.where(chosen, 0, -1)
    for v in np.flatnonzero(chosen & (forest.parent == -1)):
        slot[v] = used[forest.component[v]]
        used[forest.component[v]] += dimension[v]
    return slot


def _grouped(label: IntArray, chosen: IntArray) -> list[IntArray]:
    """Return the indices of each chosen label, ascending."""
    order = np.argsort(label, kind="stable")
    begin, end = (np.searchsorted(label[order], chosen, side) for side in ("left", "right"))
    return [order[i:j] for i, j in zip(begin.tolist(), end.tolist(), strict=True)]
