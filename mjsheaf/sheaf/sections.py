"""Sections that vanish on some vertices, and null spaces of sparse matrices, with a stated tolerance.

A singular value counts as zero when it is at most `rtol` times the largest one.

Null spaces in general: each connected component of the matrix is treated apart, exactly, by a dense singular value
decomposition, up to DENSE_COLUMNS columns; beyond, by shift-invert Lanczos on A^T A, repeated on the complement of
what was found until nothing more is null, which also finds every copy of a multiple eigenvalue. Rows that meet the same
columns are first rotated among themselves, so that what a rotated frame only seems to connect is apart.

Sections: where the map F_w of an edge e = (u, w) is injective, the value at u and the residual on e determine the value
at w, x_w = F_w^+ (F_u x_u - y_e). A forest of such edges, rooted at held vertices and, where none is in reach, at free
ones, leaves only the free roots open: x = P r + G y, with r the values at the free roots and y = delta x. The sections
are those P r that all edges accept: a small problem in place of a large one. A certificate shows that none was missed:
delta x >= |x| / |G| for x orthogonal to P, so that delta has at most dim r singular values under 1 / |G|, which is
compared with the tolerance. |x_w| <= a |x_u| + b |y_e| with a >= |F_w^+ F_u| and b >= |F_w^+| bounds G entry by entry,
and |G|^2 <= |G|_1 |G|_inf, both sums along the forest. Rotations give |G|^2 <= depth times size of a tree, far from any
tolerance. Components for which the bound is too weak are left to the general method.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse import csgraph
from scipy.sparse import linalg as splinalg

from mjsheaf.errors import SheafError
from mjsheaf.jit import allocating_jit, jit
from mjsheaf.sheaf.edges import EdgeTable, coboundary_matrix, product

Array = NDArray[np.float64]
Index = NDArray[np.int64]

RANK_TOLERANCE = 1e-9
"""Default relative tolerance under which a singular value counts as zero."""

DENSE_COLUMNS = 1200
"""Largest component that is decomposed densely."""

MOST_CLASSES = 64
"""Largest dimension of a cokernel that is sought in components of more than DENSE_COLUMNS rows."""

MOST_ENTRIES = 50_000_000
"""Largest basis of a cokernel, rows times dimension."""

_LANCZOS_VECTORS = 8
_INVERTED_COLUMNS = 60  # from which a triangular inverse is tried before a decomposition
_INVERSE_MARGIN = 0.5  # leaves room for the rounding of the inverse
_ROUNDING = 64 * np.finfo(np.float64).eps
_LEAST_CONDITION = 1e-3  # of maps that may carry a value on along a forest
_MOST_OPEN = 64  # free directions of one component; with more of them the small problem is not small
_MOST_FOREST_ENTRIES = 30_000_000  # of P
_BOUND_MARGIN = 2.0  # for the rounding of the bounds
_SECTION_ACCURACY = 1e-7  # relative: sections are then good to rounding over this


def sparse_null_space(
    matrix: sparse.csr_array, rtol: float = RANK_TOLERANCE, scale: float | None = None
) -> sparse.csc_array:
    """Return an orthonormal basis of the null space of a matrix, shape (columns, dimension).

    It is stored sparse, as each vector lives on one connected component: with a thousand small free components among
    ten thousand vertices, the dense array would not be small.

    Args:
        matrix: the matrix.
        rtol: singular values of at most rtol times the scale count as zero.
        scale: the scale, where that is not the matrix's own largest singular value.
    """
    columns = matrix.shape[1]
    if scale is None:
        scale = largest_singular_value(matrix)
    at, vectors, values, found = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], [np.zeros(0)], 0
    for members, part in components(matrix):
        local = (
            _dense_null_space(part.toarray(), scale, rtol)
            if len(members) <= DENSE_COLUMNS
            else _lanczos_null_space(part, scale, rtol)
        )
        if local.shape[1]:
            at.append(np.repeat(members, local.shape[1]))
            vectors.append(np.tile(found + np.arange(local.shape[1]), len(members)))
            values.append(local.ravel())
            found += local.shape[1]
    place = (np.concatenate(at), np.concatenate(vectors))
    return sparse.coo_array((np.concatenate(values), place), shape=(columns, found)).tocsc()


def cokernel_basis(matrix: sparse.csr_array, dimension: int, rtol: float = RANK_TOLERANCE) -> sparse.csc_array:
    """Return an orthonormal basis of the complement of the image of a matrix, shape (rows, dimension).

    Args:
        matrix: the matrix.
        dimension: of the cokernel, known from the rank.
        rtol: singular values of at most rtol times the largest count as zero.

    Raises:
        SheafError: the basis has more than MOST_ENTRIES numbers; a component has more than DENSE_COLUMNS rows while the
            dimension exceeds MOST_CLASSES; or a singular value is so close to the tolerance that the dimension found
            is another.
    """
    rows = matrix.shape[0]
    if dimension == 0:
        return sparse.csc_array((rows, 0))
    transposed = sparse.csr_array(matrix.T)
    largest = 0 if dimension <= MOST_CLASSES else max(len(members) for members, _ in components(transposed))
    if largest > DENSE_COLUMNS or rows * dimension > MOST_ENTRIES:
        raise SheafError(
            f"a basis of H^1 of dimension {dimension} over {rows} rows is too large; expected at most {MOST_ENTRIES} "
            f"numbers, and at most {DENSE_COLUMNS} rows in one component or a dimension of at most {MOST_CLASSES}"
        )
    basis = sparse_null_space(transposed, rtol, largest_singular_value(matrix))
    if basis.shape[1] != dimension:
        raise SheafError(
            f"H^1 has dimension {dimension} or {basis.shape[1]}: a singular value is at the tolerance of {rtol:g}; "
            "expected another rtol"
        )
    return basis


def components(matrix: sparse.csr_array) -> Iterator[tuple[NDArray[np.int64], sparse.csr_array]]:
    """Yield the columns of each connected component, in order, and a matrix for it alone.

    The rows of that matrix may be rotated among themselves: its singular values and right vectors are those of
    the component.
    """
    matrix = _sparser_rows(matrix)
    pattern = matrix.copy()
    pattern.data[:] = 1.0  # so that nothing cancels
    parts, label = csgraph.connected_components(pattern.T @ pattern, directed=False)
    matrix = matrix[np.diff(matrix.indptr) > 0]
    row_label = label[matrix.indices[matrix.indptr[:-1]]]
    by_column, by_row = np.argsort(label, kind="stable"), np.argsort(row_label, kind="stable")
    column_end, row_end = (np.cumsum(np.bincount(x, minlength=parts)) for x in (label, row_label))
    ordered = matrix[by_row][:, by_column]
    first_column, first_row = 0, 0
    for last_column, last_row in zip(column_end.tolist(), row_end.tolist(), strict=True):
        yield by_column[first_column:last_column], ordered[first_row:last_row, first_column:last_column]
        first_column, first_row = last_column, last_row


def _sparser_rows(matrix: sparse.csr_array) -> sparse.csr_array:
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
            upper[np.abs(upper) <= _ROUNDING * np.abs(block).max(axis=(1, 2), keepdims=True)] = 0.0
            values[at] = 0.0
            values[at[:, : upper.shape[1]]] = upper
    matrix.eliminate_zeros()  # also those of a stored map such as [I 0], which connect nothing
    return matrix


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
    return splinalg.eigsh(operator, k=count, which="LM", v0=start, tol=tolerance)[1]


def _dense_null_space(matrix: Array, scale: float, rtol: float) -> Array:
    if matrix.shape[0] == 0:
        return np.eye(matrix.shape[1])
    matrix = _with_few_rows(matrix)
    if _surely_injective(matrix, rtol * scale):
        return np.zeros((matrix.shape[1], 0))
    _, singular, rows = np.linalg.svd(matrix, full_matrices=True)
    rank = int(np.sum(singular > rtol * scale))
    return rows[rank:].T


def _surely_injective(upper: Array, tolerance: float) -> bool:
    """Whether a triangular inverse alone shows it: the smallest singular value is at least 1 / |R^-1|_F.

    That costs a fraction of the decomposition, which only a matrix with a null space, or nearly one, then needs.
    """
    if upper.shape[0] < upper.shape[1] or upper.shape[1] < _INVERTED_COLUMNS:
        return False
    inverse, singular = linalg.lapack.dtrtri(np.asfortranarray(upper))
    norm = float(np.linalg.norm(inverse))
    return singular == 0 and np.isfinite(norm) and norm * tolerance < _INVERSE_MARGIN


def _with_few_rows(matrix: Array) -> Array:
    """A matrix of the same singular values and right vectors: upper triangular unless there are fewer rows still."""
    return np.asarray(np.linalg.qr(matrix, mode="r")) if len(matrix) >= matrix.shape[1] else matrix


def _lanczos_null_space(matrix: sparse.csr_array, scale: float, rtol: float) -> Array:
    n = matrix.shape[1]
    factor = shifted_factor(matrix.T @ matrix, 1e-10 * scale**2)
    found, count = np.zeros((n, 0)), _LANCZOS_VECTORS
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


# -- sections along a forest -----------------------------------------------------------------------------------


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


@jit
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
    if smallest < _LEAST_CONDITION**2 * largest:
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


@jit
def _root(up, v):
    while up[v] != v:
        up[v] = up[up[v]]
        v = up[v]
    return v


@allocating_jit
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
                at_u, at_w = (at_tail[e], at_head[e]) if w == head[e] else (at_head[e], at_tail[e])
                norms = _carry(F, at_u, n_u, at_w, n_w, size[e], work)
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


@allocating_jit
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


@allocating_jit
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
        at_u, at_v = (t.at_tail[e], t.at_head[e]) if v == t.head[e] else (t.at_head[e], t.at_tail[e])
        _carry(t.F, at_u, n_u, at_v, n, t.size[e], work)
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


def section_basis(t: EdgeTable, free: NDArray[np.bool_], rtol: float) -> sparse.csc_array:
    """Orthonormal basis of the sections that vanish where `free` is false, rows by the columns of the free vertices.

    Args:
        t: the edges, without inner products.
        free: which vertices are free, shape (V,).
        rtol: singular values of delta on the free vertices of at most rtol times the largest count as zero.
    """
    found, left = certified_sections(t, free, rtol)
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
    rest = sparse_null_space(delta[:, at], rtol, largest_singular_value(delta[:, kept])).tocoo()
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


def certified_sections(
    t: EdgeTable, free: NDArray[np.bool_], rtol: float
) -> tuple[list[tuple[Index, Array]], NDArray[np.bool_]]:
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
    dimension = np.diff(t.column)
    root = free & (forest.parent == -1) & (dimension > 0)
    open_ = np.bincount(forest.component[root], dimension[root], len(free)).astype(np.int64)  # dim r by component
    undecided = G * enough > 1.0
    small = open_ <= _MOST_OPEN
    undecided |= (open_ > 0) & (~small | (G * _SECTION_ACCURACY * forest.norm_high > 1.0))
    wanted = np.flatnonzero((open_ > 0) & ~undecided)
    if open_[wanted].max(initial=0) * t.column[-1] > _MOST_FOREST_ENTRIES:
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
    P = propagate(t, free, forest, _slots(t, forest, chosen), int(open_[wanted].max()))
    of_column = np.repeat(np.where(chosen, forest.component, -1), np.diff(t.column))
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
            weak = inverse * enough > 1.0 or (null.any() and inverse * _SECTION_ACCURACY * forest.norm_high > 1.0)
            if weak or (null.any() and len(place) <= DENSE_COLUMNS):  # there the general method keeps the axes apart
                failed.append(int(c))
                continue
            Q = Q @ V[null].T
        found.append((place, Q))
    return found, failed


def _slots(t: EdgeTable, forest: Forest, chosen: NDArray[np.bool_]) -> Index:
    """First column in P of each free root's values, counted in each component apart; 0 at others, -1 if not chosen."""
    dimension, used = np.diff(t.column), np.zeros(len(chosen), dtype=np.int64)
    slot = np.where(chosen, 0, -1)
    for v in np.flatnonzero(chosen & (forest.parent == -1)):
        slot[v] = used[forest.component[v]]
        used[forest.component[v]] += dimension[v]
    return slot


def _grouped(label: Index, wanted: Index) -> list[Index]:
    """The places of each of the wanted labels, ascending."""
    order = np.argsort(label, kind="stable")
    begin, end = (np.searchsorted(label[order], wanted, side) for side in ("left", "right"))
    return [order[i:j] for i, j in zip(begin.tolist(), end.tolist(), strict=True)]
