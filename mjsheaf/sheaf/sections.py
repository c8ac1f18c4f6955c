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

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import spsolve_triangular

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.sheaf.blocks import DENSE_COLUMNS, ROUNDING, assembled, largest_singular_value, sparse_null_space
from mjsheaf.sheaf.edges import EdgeSet, ranges

_LEAST_CONDITION = 1e-3  # of maps that may carry a value on along a forest
_MOST_OPEN = 64  # free directions of one component; with more of them the small problem is not small
_MOST_FOREST_ENTRIES = 30_000_000  # of P
_BOUND_MARGIN = 2.0  # for the rounding of the bounds
_SECTION_ACCURACY = 1e-7  # relative: sections are then good to rounding over this


class Ways(NamedTuple):
    """Ways from vertices u to free vertices w, in one direction of a bundle, by injective and well-conditioned maps.

    Attributes:
        source, target: Vertices u and w, shape (k,).
        F_source, F_target: Maps F_u and F_w, shapes (k, m, n_u) and (k, m, n_w).
        gram: F_w^T F_w, shape (k, n_w, n_w).
        inverse: Bound b of |F_w^+|, shape (k,).
    """

    source: IntArray
    target: IntArray
    F_source: Array
    F_target: Array
    gram: Array
    inverse: Array


class Forest(NamedTuple):
    """Forest on the free vertices.

    Attributes:
        order: Held vertices, then free ones, each after its parent, shape (V,).
        parent: Parent of each vertex; -1 of free roots and held vertices, shape (V,).
        carries: Vertices w with a free parent u and matrices F_w^+ F_u, shapes (k,) and (k, n_w, n_u), of equal shapes.
        component: Number of each vertex's component of connected free vertices, shape (V,).
        rows, columns: Bounds on |G|_inf and |G|_1 of each component, shape (V,).
        norm_low, norm_high: Bounds on the largest singular value of delta on the free vertices.
    """

    order: IntArray
    parent: IntArray
    carries: list[tuple[IntArray, Array]]
    component: IntArray
    rows: Array
    columns: Array
    norm_low: float
    norm_high: float


def _eigenvalue_bounds(gram: Array) -> tuple[Array, Array]:
    """Bound the smallest and largest eigenvalue of matrices (k, n, n), by Gershgorin's theorem where that is tight."""
    radius = np.abs(gram).sum(axis=2)
    largest = radius.max(axis=1, initial=0.0)
    smallest = (2.0 * np.einsum("kaa->ka", gram) - radius).min(axis=1, initial=np.inf)
    poor = ~(smallest > 0.5 * largest)
    if poor.any():
        exact = np.linalg.eigvalsh(gram[poor]).min(axis=1, initial=np.inf)
        smallest[poor] = exact - ROUNDING * largest[poor]
    return smallest, largest


def _find_ways(edges: EdgeSet, free: BoolArray) -> list[Ways]:
    ways = []
    for e in edges.bundles:
        for u, F_u, w, F_w in ((e.tail, e.F_tail, e.head, e.F_head), (e.head, e.F_head, e.tail, e.F_tail)):
            gram = F_w.transpose(0, 2, 1) @ F_w
            smallest, largest = _eigenvalue_bounds(gram)
            good = free[w] & (smallest >= np.maximum(_LEAST_CONDITION**2 * largest, np.finfo(float).tiny))
            chosen = slice(None) if good.all() else good
            ways.append(Ways(u[chosen], w[chosen], F_u[chosen], F_w[chosen], gram[chosen], smallest[chosen] ** -0.5))
    return ways


def grow(edges: EdgeSet, free: BoolArray) -> Forest:
    """Grow the forest on the free vertices, given by a mask (V,); the others are held at a value.

    Its roots are the held vertices, and one free vertex of each set of vertices that all reach one another and are
    reached by no others.
    """
    count = len(free)
    ways = _find_ways(edges, free)
    none = np.zeros(0, dtype=np.int64)
    source = np.concatenate([none, *(way.source for way in ways)])
    target = np.concatenate([none, *(way.target for way in ways)])
    graph = _graph(source, target, count)
    group = csgraph.connected_components(graph, connection="strong")[1]
    reached = np.zeros(count, dtype=bool)
    reached[group[target[group[source] != group[target]]]] = True
    roots = np.flatnonzero(free & ~reached[group])
    roots = roots[np.argsort(np.diff(edges.column)[roots], kind="stable")[::-1]]
    root = np.full(count, -1)
    root[group[roots]] = roots  # of each group the first of the smallest stalks, which leave the least open
    roots = root[root >= 0]
    held = np.flatnonzero(~free)
    # All trees grow from one vertex more, whose number is V.
    indices = np.concatenate([graph.indices, held, roots])
    indptr = np.concatenate([graph.indptr, [len(indices)]])
    graph = sparse.csr_array((np.ones(len(indices)), indices, indptr), shape=(count + 1, count + 1))
    order, parent = csgraph.breadth_first_order(graph, count)
    order = order[1:].astype(np.int64)
    parent = np.where(parent[:count] == count, -1, parent[:count]).astype(np.int64)

    taken = np.flatnonzero(parent[target] == source)[::-1]
    way_of = np.full(count, -1)
    way_of[target[taken]] = taken  # of parallel edges the first
    a = np.zeros(count)
    b = np.zeros(count)
    carries = []
    begin = 0
    for way in ways:
        w = np.flatnonzero((way_of >= begin) & (way_of < begin + len(way.target)))
        b[w] = way.inverse[way_of[w] - begin]
        w = w[free[parent[w]]]  # a held vertex carries nothing of x
        k = way_of[w] - begin
        M = np.linalg.solve(way.gram[k], way.F_target[k].transpose(0, 2, 1) @ way.F_source[k])
        square = M.transpose(0, 2, 1) @ M
        frobenius = np.einsum("kaa->k", square)
        a[w] = np.sqrt(np.minimum(frobenius, np.abs(square).sum(axis=2).max(axis=1, initial=0.0)))
        carries.append((w, M))
        begin += len(way.target)

    upper = parent.tolist()
    bound = a.tolist()
    reach = b.tolist()  # row of |G| that belongs to a vertex
    below = [1.0] * count  # what a unit at a vertex adds to its tree, itself included
    grown = order[len(held) :].tolist()
    for v in grown:
        if upper[v] >= 0:
            reach[v] += bound[v] * reach[upper[v]]
    for v in reversed(grown):
        if upper[v] >= 0:
            below[upper[v]] += bound[v] * below[v]
    tail, head = edges.ends
    inside = free[tail] & free[head]
    component = csgraph.connected_components(_graph(tail[inside], head[inside], count), directed=False)[1]
    rows = np.zeros(count)
    columns = np.zeros(count)
    np.maximum.at(rows, component[free], np.array(reach)[free])
    np.maximum.at(columns, component[free], (b * below)[free])
    return Forest(order, parent, carries, component.astype(np.int64), rows, columns, *_norms(edges, free))


def _graph(source: IntArray, target: IntArray, count: int) -> sparse.csr_array:
    return sparse.coo_array((np.ones(len(source)), (source, target)), shape=(count, count)).tocsr()


def _norms(edges: EdgeSet, free: BoolArray) -> tuple[float, float]:
    """Bound the largest singular value of delta on the free vertices, by a column's norm and by |.|_1 and |.|_inf."""
    delta = edges.delta
    size = np.abs(delta.data)
    size[~np.repeat(free, np.diff(edges.column))[delta.indices]] = 0.0
    low = np.bincount(delta.indices, size * size, delta.shape[1]).max(initial=0.0)
    one = np.bincount(delta.indices, size, delta.shape[1]).max(initial=0.0)
    infinity = (sparse.csr_array((size, delta.indices, delta.indptr), shape=delta.shape)).sum(axis=1).max(initial=0.0)
    return float(np.sqrt(low)), float(np.sqrt(one * infinity))


def propagate(edges: EdgeSet, free: BoolArray, forest: Forest, slot: IntArray, width: int) -> Array:
    """Compute P of the forest, shape (n, width).

    The values of roots start at columns `slot`, -1 where a tree is left out, shape (V,).
    """
    n = int(edges.column[-1])
    dimension = np.diff(edges.column)
    at = np.empty(len(dimension), dtype=np.int64)  # first place of each vertex, after that of its parent
    at[forest.order] = np.cumsum(dimension[forest.order]) - dimension[forest.order]
    blocks: list[tuple[Any, Any, Any]] = [(np.arange(n), np.arange(n), np.ones(n))]
    for w, M in forest.carries:
        chosen = slot[w] >= 0
        to = at[w[chosen]][:, None, None] + np.arange(M.shape[1])[:, None]
        blocks.append((to, at[forest.parent[w[chosen]]][:, None, None] + np.arange(M.shape[2]), -M[chosen]))
    roots = np.flatnonzero(free & (forest.parent < 0) & (slot >= 0))
    P = np.zeros((n, width))
    P[ranges(at[roots], dimension[roots]), ranges(slot[roots], dimension[roots])] = 1.0
    steps = assembled(blocks, (n, n)).tocsr()
    return spsolve_triangular(steps, P, lower=True, unit_diagonal=True, overwrite_b=True)[ranges(at, dimension)]


def section_basis(edges: EdgeSet, free: BoolArray, rtol: float) -> sparse.csc_array:
    """Orthonormal basis of the sections that vanish where `free` is false, rows by the columns of the free vertices.

    Arguments are those of `certified_sections`.
    """
    found, left = certified_sections(edges, free, rtol)
    dimension = np.diff(edges.column)
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
        delta = edges.delta
        at = np.flatnonzero(left[of_column])
        rest = sparse_null_space(delta[:, at], rtol, largest_singular_value(delta[:, kept]))
        rest = sparse.csc_array((rest.data, number[at][rest.indices], rest.indptr), shape=(rows, rest.shape[1]))
        basis = sparse.hstack([basis, rest], format="csc")
    return basis


def certified_sections(edges: EdgeSet, free: BoolArray, rtol: float) -> tuple[list[tuple[IntArray, Array]], BoolArray]:
    """Sections that vanish on the held vertices, of the components for which a forest certifies that they are all.

    Args:
        edges: The edges, without inner products.
        free: True for free vertices, shape (V,).
        rtol: Singular values of delta on the free vertices of at most rtol times the largest count as zero.

    Returns:
        For each component with sections its columns of delta (k,) and an orthonormal basis on them (k, dimension); and
        the free vertices that belong to other components, shape (V,).
    """
    forest = grow(edges, free)
    G = np.sqrt(forest.rows * forest.columns)
    enough = _BOUND_MARGIN * rtol * forest.norm_high  # singular values of at least this are surely not zero
    root = free & (forest.parent == -1)
    open_ = np.bincount(forest.component[root], np.diff(edges.column)[root], len(free)).astype(np.int64)  # dim r
    inaccurate = G * _SECTION_ACCURACY * forest.norm_high > 1.0
    undecided = ~(G * enough <= 1.0) | ((open_ > 0) & (inaccurate | (open_ > _MOST_OPEN)))
    wanted = np.flatnonzero((open_ > 0) & ~undecided)
    if open_[wanted].max(initial=0) * edges.column[-1] > _MOST_FOREST_ENTRIES:
        undecided[wanted], wanted = True, wanted[:0]
    found: list[tuple[IntArray, Array]] = []
    if not wanted.size:
        return found, free & undecided[forest.component]

    chosen = np.zeros(len(free), dtype=bool)
    chosen[wanted] = True
    chosen = free & chosen[forest.component]
    P = propagate(edges, free, forest, _slots(edges, forest, chosen), int(open_[wanted].max()))
    places = _grouped(np.repeat(np.where(chosen, forest.component, -1), np.diff(edges.column)), wanted)
    for c, place in zip(wanted, places, strict=True):
        P[place, : open_[c]] = np.linalg.qr(P[place, : open_[c]])[0]
    image = edges.delta @ P
    of_row = np.empty(len(image), dtype=np.int64)
    for b, rows in zip(edges.bundles, edges.rows, strict=True):
        end = np.where(chosen[b.tail], b.tail, b.head)
        of_row[rows] = np.where(chosen[end], forest.component[end], -1)[:, None]
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


def _slots(edges: EdgeSet, forest: Forest, chosen: BoolArray) -> IntArray:
    """First column in P of each free root's values, counted in each component apart; 0 at others, -1 if not chosen."""
    dimension, used = np.diff(edges.column), np.zeros(len(chosen), dtype=np.int64)
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
