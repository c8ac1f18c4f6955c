"""Null spaces of sparse matrices, and sections computed along a forest, with a certificate that none was missed.

A singular value counts as zero when it is at most `rtol` times the largest one. Each connected part of a matrix is
treated apart: exactly, by a dense singular value decomposition, up to DENSE_COLUMNS columns; beyond, by shift-invert
Lanczos on A^T A, repeated on the complement of what was found until nothing more is null, which also finds every copy
of a multiple eigenvalue. Rows that meet the same columns are first rotated among themselves, so that what a rotated
frame only seems to connect is apart.

Sections that vanish on some vertices need no decomposition where a forest determines them.

If the map F_w of an edge e = (u, w) is injective, the value at u and the residual on e determine the value at w:
x_w = F_w^+ (F_u x_u - y_e). Take a forest of such edges, rooted at fixed vertices, or at free ones if none is
reachable. Only the values r at the free roots remain unknown: x = P r + G y with y = delta x. The sections are those
P r that satisfy all edges. This is a small problem instead of a large one.

The certificate: |delta x| >= |x| / |G| for x orthogonal to P. So delta has at most dim r singular values below 1 / |G|.
1 / |G| is compared with the tolerance. The inequality |x_w| <= a |x_u| + b |y_e| with a >= |F_w^+ F_u| and
b >= |F_w^+| bounds G entry by entry, and |G|^2 <= |G|_1 |G|_inf, both sums along the forest. Rotations give
|G|^2 <= depth times size of a tree, far from any tolerance. If the bound is too weak for a component, the general
method above is used.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy import linalg, sparse
from scipy.sparse import csgraph
from scipy.sparse import linalg as splinalg

from mjsheaf.arrays import Array, BoolArray, IntArray, firsts_of
from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import EdgeSet, assembled, parts, ranges

RANK_TOLERANCE = 1e-9
"""Default relative tolerance under which a singular value counts as zero."""

DENSE_COLUMNS = 1200
"""Largest component that is decomposed densely."""

MOST_CLASSES = 64
"""Largest dimension of a cokernel that is sought in components of more than DENSE_COLUMNS rows."""

MOST_ENTRIES = 50_000_000
"""Largest basis of a cokernel, rows times dimension."""

ROUNDING = 64 * np.finfo(np.float64).eps


def sparser_rows(matrix: sparse.csr_array) -> sparse.csr_array:
    """Rotate rows that meet the same columns among themselves, so that each meets as few as possible.

    An edge measured in a rotated frame, R [I -I], connects each coordinate with every other; R^T undoes it and leaves
    the axes apart. Entries at the level of rounding are zeros here: that moves no singular value by more.
    """
    matrix = sparse.csr_array(matrix, copy=True)
    matrix.sort_indices()
    length = np.diff(matrix.indptr)
    values, place = matrix.data, matrix.indptr[:-1]
    for width in np.unique(length[length > 1]):
        rows = np.flatnonzero(length == width)
        meets = matrix.indices[place[rows][:, None] + np.arange(width)]
        first = np.ones(len(rows), dtype=bool)  # of a run of neighbours that meet the same columns
        first[1:] = (np.diff(rows) > 1) | np.any(meets[1:] != meets[:-1], axis=1)
        start = np.flatnonzero(first)
        size = np.diff(np.append(start, len(rows)))
        for count in np.unique(size[size > 1]):
            at = place[rows[start[size == count]]][:, None, None] + width * np.arange(count)[:, None] + np.arange(width)
            block = values[at]
            upper = np.asarray(np.linalg.qr(block, mode="r"))
            upper[np.abs(upper) <= ROUNDING * np.abs(block).max(axis=(1, 2), keepdims=True)] = 0.0
            values[at] = 0.0
            values[at[:, : upper.shape[1]]] = upper
    matrix.eliminate_zeros()  # also those of a stored map such as [I 0], which connect nothing
    return matrix


def sparse_null_space(matrix: sparse.csr_array, rtol: float = RANK_TOLERANCE) -> sparse.csc_array:
    """Return an orthonormal basis of the null space of a matrix, each vector on one part, shape (columns, dimension).

    Singular values of at most rtol times the largest count as zero.
    """
    return _joined(_null_spaces(matrix, rtol, largest_singular_value(matrix)), matrix.shape[1])


def _null_spaces(matrix: sparse.csr_array, rtol: float, scale: float) -> list[tuple[IntArray, Array]]:
    """Return the columns of each part of a matrix and an orthonormal basis on them (columns, dimension)."""
    return [(columns, _null_space(part, scale, rtol)) for _, columns, part in parts(sparser_rows(matrix))]


def _joined(bases: list[tuple[IntArray, Array]], rows: int) -> sparse.csc_array:
    """Return the basis (rows, dimension) that consists of bases on some of the rows each."""
    first = np.cumsum([0, *(Q.shape[1] for _, Q in bases)])
    blocks = [(place[:, None], k + np.arange(Q.shape[1]), Q) for k, (place, Q) in zip(first, bases, strict=False)]
    return assembled(blocks, (rows, int(first[-1]))).tocsc()


def cokernel_basis(matrix: sparse.csr_array, dimension: int, rtol: float = RANK_TOLERANCE) -> sparse.csc_array:
    """Return an orthonormal basis of the complement of the image of a matrix, shape (rows, dimension).

    The dimension is known from the rank; singular values of at most rtol times the largest count as zero.

    Raises:
        SheafError: the basis has more than MOST_ENTRIES numbers; a component has more than DENSE_COLUMNS rows while the
            dimension exceeds MOST_CLASSES; or a singular value is so close to the tolerance that the dimension found
            is another.
    """
    rows = matrix.shape[0]
    if dimension == 0:
        return sparse.csc_array((rows, 0))
    transposed = sparse.csr_array(matrix.T)
    largest = 0 if dimension <= MOST_CLASSES else max(len(columns) for _, columns, _ in parts(sparser_rows(transposed)))
    if largest > DENSE_COLUMNS or rows * dimension > MOST_ENTRIES:
        raise SheafError(
            f"a basis of H^1 of dimension {dimension} over {rows} rows is too large; expected at most {MOST_ENTRIES} "
            f"numbers, and at most {DENSE_COLUMNS} rows in one component or a dimension of at most {MOST_CLASSES}"
        )
    basis = sparse_null_space(transposed, rtol)
    if basis.shape[1] != dimension:
        raise SheafError(
            f"H^1 has dimension {dimension} or {basis.shape[1]}: a singular value is at the tolerance of {rtol:g}; "
            "expected another rtol"
        )
    return basis


def largest_singular_value(matrix: sparse.csr_array) -> float:
    """Return the largest singular value of a matrix; 0 where it has no entries."""
    if matrix.nnz == 0:
        return 0.0
    if min(matrix.shape) <= DENSE_COLUMNS:
        gram = matrix.T @ matrix if matrix.shape[1] <= matrix.shape[0] else matrix @ matrix.T
        return float(np.sqrt(np.linalg.eigvalsh(gram.toarray())[-1]))  # of the largest value, squaring loses nothing
    start = np.ones(min(matrix.shape))  # a fixed start vector keeps the answer the same in every run
    return float(splinalg.svds(matrix, k=1, v0=start, return_singular_vectors=False)[0])


def shifted_factor(gram: sparse.csr_array, shift: float) -> splinalg.SuperLU:
    """The factorisation of gram + shift I."""
    return splinalg.splu((gram + shift * sparse.eye_array(gram.shape[0])).tocsc())


def smallest_eigenvectors(factor: splinalg.SuperLU, known: Array, count: int, tolerance: float = 0.0) -> Array:
    """Vectors of a few of the smallest eigenvalues off `known`, by shift-invert Lanczos, shape (n, count)."""

    def inverse(x: Array) -> Array:
        y = factor.solve(x - known @ (known.T @ x))
        return y - known @ (known.T @ y)

    n = len(known)
    start = inverse(np.random.default_rng(0).standard_normal(n))  # the same in every run
    operator = splinalg.LinearOperator((n, n), matvec=inverse, dtype=np.float64)
    try:
        return splinalg.eigsh(operator, k=count, which="LM", v0=start, tol=tolerance)[1]
    except splinalg.ArpackError:  # more equal eigenvalues than vectors: use more vectors
        return splinalg.eigsh(operator, k=count, ncv=min(n, 6 * count), which="LM", v0=start, tol=tolerance)[1]


def _null_space(part: sparse.csr_array, scale: float, rtol: float) -> Array:
    n = part.shape[1]
    if n > DENSE_COLUMNS:
        return _lanczos_null_space(part, scale, rtol)
    if part.shape[0] == 0:
        return np.eye(n)
    matrix = _with_few_rows(part.toarray())
    if len(matrix) >= n >= 60:
        # A triangular inverse proves full rank, as the smallest singular value is at least 1 / |R^-1|_F. It costs a
        # fraction of a decomposition, which then only matrices of deficient or nearly deficient rank need.
        inverse, failed = linalg.lapack.dtrtri(np.asfortranarray(matrix))
        norm = float(np.linalg.norm(inverse))
        if not failed and np.isfinite(norm) and norm * (rtol * scale) < 0.5:  # which leaves room for its rounding
            return np.zeros((n, 0))
    _, singular, rows = np.linalg.svd(matrix, full_matrices=True)
    return rows[np.count_nonzero(singular > rtol * scale) :].T


def _with_few_rows(matrix: Array) -> Array:
    """A matrix of the same singular values and right vectors: upper triangular unless there are fewer rows still."""
    return np.asarray(np.linalg.qr(matrix, mode="r")) if len(matrix) >= matrix.shape[1] else matrix


def _lanczos_null_space(matrix: sparse.csr_array, scale: float, rtol: float) -> Array:
    n = matrix.shape[1]
    factor = shifted_factor(matrix.T @ matrix, 1e-10 * scale**2)
    found, count = np.zeros((n, 0)), 8
    while True:
        vectors = smallest_eigenvectors(factor, found, count)
        # Lanczos on the square sees singular values only down to 1e-8 of the largest; the candidates' own
        # singular values, taken on A itself, are exact to machine precision.
        vectors, _ = np.linalg.qr(vectors - found @ (found.T @ vectors))
        image = _with_few_rows(matrix @ vectors)
        _, singular, rows = np.linalg.svd(image, full_matrices=True)
        null = np.append(singular, np.zeros(len(rows) - len(singular))) <= rtol * scale  # fewer rows than vectors
        if not null.any():
            return found
        found, _ = np.linalg.qr(np.hstack([found, vectors @ rows[null].T]))
        count = max(count, min(2 * count, n // 4))  # where there is one batch there are often many
        if found.shape[1] > n // 2:
            raise SheafError(f"the null space of this {matrix.shape} map has dimension over {n // 2}: too large")


_BOUND_MARGIN = 2.0  # for the rounding of the bounds
_SECTION_ACCURACY = 1e-7  # relative: sections are then good to rounding over this


class Ways(NamedTuple):
    """Ways from vertices u to free vertices w, in one direction of a bundle, by injective and well-conditioned maps.

    Attributes:
        source, target: Vertices u and w, shape (k,).
        edge: Numbers of the edges in the bundle, shape (k,).
        inverse: Bound b of |F_w^+|, shape (k,).
        F_source, F_target: Maps F_u and F_w of all edges of the bundle.
        gram: F_w^T F_w of all of them.
    """

    source: IntArray
    target: IntArray
    edge: IntArray
    inverse: Array
    F_source: Array
    F_target: Array
    gram: Array


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
            gram = np.einsum("kma,kmb->kab", F_w, F_w)
            smallest, largest = _eigenvalue_bounds(gram)
            # Maps of a worse condition than 1000 may not carry a value on.
            good = free[w] & (smallest >= np.maximum(1e-6 * largest, np.finfo(float).tiny))
            edge = np.flatnonzero(good)
            ways.append(Ways(u[edge], w[edge], edge, smallest[edge] ** -0.5, F_u, F_w, gram))
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
    tail, head = edges.ends
    inside = free[tail] & free[head]
    component = csgraph.connected_components(_graph(tail[inside], head[inside], count), directed=False)[1]
    group = component  # where all ways lead in both directions, all free vertices of a component reach one another
    if len(target) < np.count_nonzero(free[tail]) + np.count_nonzero(free[head]):
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
        k = way.edge[way_of[w] - begin]
        M = np.linalg.solve(way.gram[k], np.einsum("kma,kmb->kab", way.F_target[k], way.F_source[k]))
        square = np.einsum("kma,kmb->kab", M, M)
        frobenius = np.einsum("kaa->k", square)
        a[w] = np.sqrt(np.minimum(frobenius, np.abs(square).sum(axis=2).max(axis=1, initial=0.0)))
        carries.append((w, M))
        begin += len(way.target)

    reach = b.copy()  # row of |G| that belongs to a vertex
    below = np.ones(count)  # what a unit at a vertex adds to its tree, itself included
    ancestor = parent.copy()  # the next one, then the one two steps up, then four
    while (v := np.flatnonzero(ancestor >= 0)).size:
        up = ancestor[v]
        below += np.bincount(up, a[v] * below[v], count)
        reach[v] += a[v] * reach[up]
        a[v] *= a[up]
        ancestor[v] = ancestor[up]
    rows = np.zeros(count)
    columns = np.zeros(count)
    np.maximum.at(rows, component[free], reach[free])
    np.maximum.at(columns, component[free], (b * below)[free])
    return Forest(order, parent, carries, component.astype(np.int64), rows, columns, *_norms(edges, free))


def _graph(source: IntArray, target: IntArray, count: int) -> sparse.csr_array:
    # Parallel edges become one entry: SciPy's search for strong components does not end on repeated ones.
    return sparse.coo_array((np.ones(len(source)), (source, target)), shape=(count, count)).tocsr()


def _norms(edges: EdgeSet, free: BoolArray) -> tuple[float, float]:
    """Bound the largest singular value of delta on the free vertices, by a column's norm and by |.|_1 and |.|_inf."""
    delta = edges.delta
    size = np.abs(delta.data)
    size[~np.repeat(free, np.diff(edges.column))[delta.indices]] = 0.0
    low = np.bincount(delta.indices, size * size, delta.shape[1]).max(initial=0.0)
    one = np.bincount(delta.indices, size, delta.shape[1]).max(initial=0.0)
    infinity = np.bincount(np.repeat(np.arange(delta.shape[0]), np.diff(delta.indptr)), size).max(initial=0.0)
    return float(np.sqrt(low)), float(np.sqrt(one * infinity))


def propagate(edges: EdgeSet, free: BoolArray, forest: Forest, slot: IntArray, width: int) -> Array:
    """Compute P of the forest, shape (n, width).

    The values of roots start at columns `slot`, -1 where a tree is left out, shape (V,).
    """
    n = int(edges.column[-1])
    dimension = np.diff(edges.column)
    at = np.empty(len(dimension), dtype=np.int64)  # first place of each vertex, after that of its parent
    at[forest.order] = firsts_of(dimension[forest.order])
    blocks: list[tuple[Any, Any, Any]] = [(np.arange(n), np.arange(n), np.ones(n))]
    for w, M in forest.carries:
        chosen = slot[w] >= 0
        to = at[w[chosen]][:, None, None] + np.arange(M.shape[1])[:, None]
        blocks.append((to, at[forest.parent[w[chosen]]][:, None, None] + np.arange(M.shape[2]), -M[chosen]))
    roots = np.flatnonzero(free & (forest.parent < 0) & (slot >= 0))
    P = np.zeros((n, width))
    P[ranges(at[roots], dimension[roots]), ranges(slot[roots], dimension[roots])] = 1.0
    steps = assembled(blocks, (n, n)).tocsr()
    return splinalg.spsolve_triangular(steps, P, lower=True, unit_diagonal=True, overwrite_b=True)[
        ranges(at, dimension)
    ]


def section_basis(edges: EdgeSet, free: BoolArray, rtol: float) -> sparse.csc_array:
    """Orthonormal basis of the sections that vanish where `free` is false, rows by the columns of the free vertices.

    Arguments are those of `certified_sections`.
    """
    found, left = certified_sections(edges, free, rtol)
    of_column = np.repeat(np.arange(len(free)), np.diff(edges.column))
    kept = free[of_column]
    number = np.cumsum(kept) - 1
    bases = [
        (number[place], np.where(np.abs(Q) > ROUNDING * np.abs(Q).max(axis=0, initial=0.0), Q, 0.0))
        for place, Q in found
    ]
    if left.any():
        at = np.flatnonzero(left[of_column])
        rest = edges.delta[:, at]
        scale = largest_singular_value(edges.delta[:, kept])
        bases += [(number[at[columns]], Q) for columns, Q in _null_spaces(rest, rtol, scale)]
    basis = _joined(bases, int(kept.sum()))
    basis.eliminate_zeros()
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
    # With more free directions in one component the small problem is not small.
    undecided = ~(G * enough <= 1.0) | ((open_ > 0) & (inaccurate | (open_ > 64)))
    wanted = np.flatnonzero((open_ > 0) & ~undecided)
    if open_[wanted].max(initial=0) * edges.column[-1] > 30_000_000:  # numbers in P
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
    null = np.zeros((0, W.shape[1]))
    above = np.inf
    clean = sparse.csr_array(np.where(np.abs(W) > ROUNDING * np.abs(W).max(), W, 0.0))
    for _, columns, part in parts(sparser_rows(clean)):  # so that null directions of the axes stay apart
        square = np.vstack([part.toarray(), np.zeros((max(len(columns) - part.shape[0], 0), len(columns)))])
        _, s, V = np.linalg.svd(np.linalg.qr(square, mode="r"))
        zero = s <= rtol * forest.norm_low
        above = min(above, float(s[~zero].min(initial=np.inf)))
        own = np.zeros((np.count_nonzero(zero), W.shape[1]))
        own[:, columns] = V[zero]
        null = np.vstack([null, own])
    # Of x = P r + G y orthogonal to the null part, what of P r is not null is at most
    # (1 + |delta| |G|) |y| / above, and the rest at most 2 |G| |y|.
    inverse = float((1.0 + forest.norm_high * G) / above + 2.0 * G)
    enough = _BOUND_MARGIN * rtol * forest.norm_high
    weak = inverse * enough > 1.0 or (len(null) > 0 and inverse * _SECTION_ACCURACY * forest.norm_high > 1.0)
    return None if weak else null


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
