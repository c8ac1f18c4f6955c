"""Forests along which the value at one vertex determines the next.

Where the map F_w of an edge e = (u, w) is injective, the value at u and the residual on e determine the value at w:
x_w = F_w^+ (F_u x_u - y_e). A forest of such edges, rooted at held vertices and, where none is in reach, at free ones,
leaves only the free roots open: x = P r + G y, with r the values at the free roots and y = delta x.

|x_w| <= a |x_u| + b |y_e| with a >= |F_w^+ F_u| and b >= |F_w^+| bounds G entry by entry, and |G|^2 <= |G|_1 |G|_inf,
both of which are sums along the forest.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.jit import allocating_kernel, kernel
from mjsheaf.sheaf.edges import EdgeTable

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_CONDITION = 1e-3  # of maps that may carry a value on


class Forest(NamedTuple):
    """A forest on the free vertices.

    Attributes:
        order: the free vertices, each after its parent, shape (W,).
        parent: by vertex: the edge to the parent, or -1 at free roots, shape (V,).
        component: by vertex: a number that connected free vertices share, at most V, shape (V,).
        rows, columns: by component: bounds of |G|_inf and |G|_1, shape (V,).
        norm_low, norm_high: bounds of the largest singular value of delta on the free vertices.
    """

    order: Index
    parent: Index
    component: Index
    rows: Array
    columns: Array
    norm_low: float
    norm_high: float


@kernel
def _carry(F, at_u, n_u, at_w, n, m, work):
    """Fill M = F_w^+ F_u (n_w, n_u); return bounds (a, b) of |M| and |F_w^+|, or (-1, -1) where F_w is not injective.

    Maps of m rows are stored row by row in F, from at_u and at_w on. Bounds are tight for multiples of isometries:
    Gershgorin's on F_w^T F_w and on M^T M, or the Frobenius norm. M is work[0].
    """
    if m < n:
        return -1.0, -1.0
    M, L, column = work[0], work[1], work[2, 0]
    largest, gershgorin = 0.0, np.inf
    for a in range(n):
        for b in range(a + 1):
            L[a, b] = 0.0
            for k in range(m):
                L[a, b] += F[at_w + k * n + a] * F[at_w + k * n + b]
            L[b, a] = L[a, b]
    for a in range(n):
        off = 0.0
        for b in range(n):
            off += abs(L[a, b]) if b != a else 0.0
        largest, gershgorin = max(largest, L[a, a] + off), min(gershgorin, L[a, a] - off)
    # Where Gershgorin's bound is poor, 1 / |L^-1|_F^2 is another of the smallest eigenvalue of L L^T.
    inverse, begin = 0.0, n if gershgorin > 0.5 * largest else 0
    for a in range(n):
        for b in range(a + 1):
            for k in range(b):
                L[a, b] -= L[a, k] * L[b, k]
            if b < a:
                L[a, b] /= L[b, b]
        if not L[a, a] > 1e-14 * largest:
            return -1.0, -1.0
        L[a, a] = np.sqrt(L[a, a])
    for c in range(begin, n + n_u):  # columns of L^-1, then those of M
        for a in range(n):
            if c < n:
                column[a] = 1.0 if a == c else 0.0
            else:
                column[a] = 0.0
                for k in range(m):
                    column[a] += F[at_w + k * n + a] * F[at_u + k * n_u + c - n]
            for k in range(a):
                column[a] -= L[a, k] * column[k]
            column[a] /= L[a, a]
        if c < n:
            for a in range(n):
                inverse += column[a] ** 2
        else:
            for a in range(n - 1, -1, -1):
                for k in range(a + 1, n):
                    column[a] -= L[k, a] * column[k]
                column[a] /= L[a, a]
                M[a, c - n] = column[a]
    smallest = gershgorin if begin == n else max(gershgorin, 1.0 / inverse)
    if smallest < _CONDITION**2 * largest:
        return -1.0, -1.0
    frobenius, rows = 0.0, 0.0
    for b in range(n_u):
        row = 0.0
        for c in range(n_u):
            total = 0.0
            for a in range(n):
                total += M[a, b] * M[a, c]
            row += abs(total)
            frobenius += total if b == c else 0.0
        rows = max(rows, row)
    return np.sqrt(min(frobenius, rows)), 1.0 / np.sqrt(smallest)


@kernel
def _root(up, v):
    while up[v] != v:
        up[v] = up[up[v]]
        v = up[v]
    return v


@allocating_kernel
def _grow(t, free, by_dimension, widest):
    """Breadth first from all held vertices at once, then from free roots in the order given; see `Forest`."""
    # The arrays by themselves: reading them from the tuple in a loop costs more than the loop.
    _, column, tail, head, _, size, F, at_tail, at_head, first, incident = t
    count = len(free)
    parent = np.full(count, -2, dtype=np.int64)
    order = np.empty(count, dtype=np.int64)
    a, b = np.zeros(count), np.zeros(count)
    reach = np.zeros(count)  # the row of |G| that belongs to a vertex
    work = np.empty((3, widest, widest))
    held = 0
    for v in range(count):
        if not free[v]:
            order[held] = v
            held += 1
    grown, done, candidate = held, 0, 0
    while True:
        while done < grown:
            u = order[done]
            done += 1
            n_u = column[u + 1] - column[u]
            for at in range(first[u], first[u + 1]):
                e = incident[at]
                w = head[e] if tail[e] == u else tail[e]
                if not free[w] or parent[w] != -2:
                    continue
                n_w = column[w + 1] - column[w]
                if w == head[e]:
                    norms = _carry(F, at_tail[e], n_u, at_head[e], n_w, size[e], work)
                else:
                    norms = _carry(F, at_head[e], n_u, at_tail[e], n_w, size[e], work)
                if norms[1] >= 0.0:
                    parent[w], b[w] = e, norms[1]
                    a[w] = norms[0] if free[u] else 0.0  # a held vertex carries nothing of x
                    reach[w] = a[w] * reach[u] + b[w]
                    order[grown] = w
                    grown += 1
        while candidate < count and (not free[by_dimension[candidate]] or parent[by_dimension[candidate]] != -2):
            candidate += 1
        if candidate == count:
            break
        order[grown] = by_dimension[candidate]
        parent[by_dimension[candidate]] = -1
        grown += 1

    component = np.arange(count)
    for e in range(len(tail)):
        if free[tail[e]] and free[head[e]]:
            i, j = _root(component, tail[e]), _root(component, head[e])
            component[max(i, j)] = min(i, j)
    rows, columns = np.zeros(count), np.zeros(count)
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


@allocating_kernel
def _norms(t, free):
    """Bounds of the largest singular value of delta on the free vertices: a column's norm, and sqrt(|.|_1 |.|_inf)."""
    one, square = np.zeros(t.column[-1]), np.zeros(t.column[-1])
    infinity = 0.0
    for e in range(len(t.tail)):
        for k in range(t.size[e]):
            row = 0.0
            for end in range(2):
                v = t.tail[e] if end == 0 else t.head[e]
                at = t.at_tail[e] if end == 0 else t.at_head[e]
                n = t.column[v + 1] - t.column[v]
                if free[v]:
                    for c in range(n):
                        value = abs(t.F[at + k * n + c])
                        row += value
                        one[t.column[v] + c] += value
                        square[t.column[v] + c] += value * value
            infinity = max(infinity, row)
    low, high = 0.0, 0.0
    for c in range(len(one)):
        low, high = max(low, square[c]), max(high, one[c])
    return np.sqrt(low), np.sqrt(high * infinity)


@allocating_kernel
def _propagate(t, free, order, parent, slot, P):
    """Fill P (n, k): the values everywhere that the free roots determine; vertices whose slot is -1 are left out."""
    widest = 1
    for v in range(len(free)):
        widest = max(widest, t.column[v + 1] - t.column[v])
    work = np.empty((3, widest, widest))
    M = work[0]
    for v in order:
        if slot[v] < 0:
            continue
        begin, n, e = t.column[v], t.column[v + 1] - t.column[v], parent[v]
        if e < 0:
            for a in range(n):
                P[begin + a, slot[v] + a] = 1.0
            continue
        u = t.head[e] if t.tail[e] == v else t.tail[e]
        if not free[u]:
            continue
        n_u = t.column[u + 1] - t.column[u]
        if v == t.head[e]:
            _carry(t.F, t.at_tail[e], n_u, t.at_head[e], n, t.size[e], work)
        else:
            _carry(t.F, t.at_head[e], n_u, t.at_tail[e], n, t.size[e], work)
        for a in range(n):
            for c in range(P.shape[1]):
                total = 0.0
                for k in range(n_u):
                    total += M[a, k] * P[t.column[u] + k, c]
                P[begin + a, c] = total


def grow(t: EdgeTable, free: NDArray[np.bool_]) -> Forest:
    """The forest on the free vertices.

    Args:
        t: the edges.
        free: which vertices are free, the others are held at a value, shape (V,).
    """
    dimension = np.diff(t.column)
    # Vertices of large stalks determine those of small ones, seldom the other way: they make the fewest roots.
    by_dimension = np.argsort(-dimension, kind="stable")
    return Forest(*_grow(t, free, by_dimension, int(dimension.max(initial=1))), *_norms(t, free))


def propagate(t: EdgeTable, free: NDArray[np.bool_], forest: Forest, slot: Index, width: int) -> Array:
    """P of the forest, shape (n, width); the roots' values start at columns `slot`, -1 where a tree is left out."""
    P = np.zeros((int(t.column[-1]), width))
    _propagate(t, free, forest.order, forest.parent, slot, P)
    return P
