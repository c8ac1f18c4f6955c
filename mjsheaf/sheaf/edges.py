"""The edges of a sheaf: bundles that were added together, and one table of all with its matrices and products.

Compiled loops walk an `EdgeTable` t edge by edge or vertex by vertex, in one order, by one thread: the same bits
everywhere. Those that make arrays take them out of it first, as there each reading from the tuple costs. The Laplacian
here is delta^T delta; an inner product enters through whitened maps.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.compile.jit import allocating_jit, inline_jit, jit
from mjsheaf.compile.tiers import Tiered
from mjsheaf.errors import SheafError


@dataclass(frozen=True)
class EdgeBundle:
    """Bundle of k edges whose maps have the same shapes.

    Attributes:
        tail, head: Vertex numbers, shape (k,).
        maps: F_tail of every edge row by row, then F_head of every edge, in one array for the compiled loops.
        shape: Dimensions (m, n_tail, n_head) of the edge stalk and of the two vertex stalks.
        offset: Desired value b of each edge, shape (k, m).
        weight: Inner product K of each edge stalk, shape (k, m, m), or None for the identity.
        number: Number of each edge in the sheaf, in the order in which edges were added, shape (k,).
    """

    tail: IntArray
    head: IntArray
    maps: Array
    shape: tuple[int, int, int]
    offset: Array
    weight: Array | None
    number: IntArray

    @property
    def F_tail(self) -> Array:  # noqa: N802 - the field's symbol
        """Restriction maps to the tails, shape (k, m, n_tail)."""
        k, (m, n, _) = len(self.tail), self.shape
        return self.maps[: k * m * n].reshape(k, m, n)

    @property
    def F_head(self) -> Array:  # noqa: N802
        """Restriction maps to the heads, shape (k, m, n_head)."""
        k, (m, n_tail, n) = len(self.tail), self.shape
        return self.maps[k * m * n_tail :].reshape(k, m, n)

    def selected(self, chosen: BoolArray, vertex: IntArray, number: IntArray) -> "EdgeBundle":
        """The chosen edges (k,), with new numbers of all vertices (V,) and edges (E,)."""
        return replace(
            self,
            tail=vertex[self.tail[chosen]],
            head=vertex[self.head[chosen]],
            maps=packed([self.F_tail[chosen]], [self.F_head[chosen]]),
            offset=self.offset[chosen],
            weight=None if self.weight is None else self.weight[chosen],
            number=number[self.number[chosen]],
        )

    def whitened(self) -> "EdgeBundle":
        """The same edges in edge coordinates in which the inner product is the identity.

        With K = C C^T, maps and offsets become C^T F and C^T b, so that the plain Laplacian of the result is
        delta^T K delta.
        """
        if self.weight is None:
            return self
        root = np.linalg.cholesky(self.weight).transpose(0, 2, 1)
        maps = packed([root @ self.F_tail], [root @ self.F_head])
        return replace(self, maps=maps, offset=np.einsum("kij,kj->ki", root, self.offset), weight=None)


def packed(F_tails: list[Array], F_heads: list[Array]) -> Array:
    """A copy of maps to the tails, then to the heads, row by row."""
    return np.concatenate([F.ravel() for F in F_tails + F_heads])


class EdgeTable(NamedTuple):
    """All edges of a sheaf with what the compiled loops need to walk them; a named tuple because they take those.

    Attributes:
        rows: number of rows m of delta.
        column: first column of each vertex, and the number of columns at the end, shape (V + 1,).
        tail, head: vertex numbers, shape (E,).
        row: first row of each edge in the coboundary, shape (E,).
        size: dimension m of each edge stalk, shape (E,).
        F: the maps, row by row.
        at_tail, at_head: where the two maps of each edge begin in it, shape (E,).
        first: where the edges of each vertex begin in `incident`, and their number at the end, shape (V + 1,).
        incident: the edges at each vertex, ascending, shape (2 E,).
    """

    rows: int
    column: IntArray
    tail: IntArray
    head: IntArray
    row: IntArray
    size: IntArray
    F: Array
    at_tail: IntArray
    at_head: IntArray
    first: IntArray
    incident: IntArray


def merge(bundles: list[EdgeBundle]) -> list[EdgeBundle]:
    """Join bundles of equal shapes, so that later work is one array operation for each shape."""
    alike: dict[tuple[int, ...], list[EdgeBundle]] = defaultdict(list)
    for bundle in bundles:
        alike[(*bundle.shape, bundle.weight is None)].append(bundle)
    return [group[0] if len(group) == 1 else _join(group) for group in alike.values()]


def _join(group: list[EdgeBundle]) -> EdgeBundle:
    weights = [b.weight for b in group if b.weight is not None]
    return EdgeBundle(
        np.concatenate([b.tail for b in group]),
        np.concatenate([b.head for b in group]),
        packed([b.F_tail for b in group], [b.F_head for b in group]),
        group[0].shape,
        np.concatenate([b.offset for b in group]),
        np.concatenate(weights) if weights else None,
        np.concatenate([b.number for b in group]),
    )


def starts(length: IntArray) -> IntArray:
    """Return the start of each of k consecutive segments of the given lengths, shape (k,)."""
    return np.cumsum(length) - length


def ranges(begin: IntArray, length: IntArray) -> IntArray:
    """The numbers from begin[k] up to begin[k] + length[k], stretch after stretch."""
    return np.repeat(begin - starts(length), length) + np.arange(length.sum())


def tabulate(bundles: list[EdgeBundle], column: IntArray) -> EdgeTable:
    """The table of all edges of a sheaf, bundle after bundle, without their weights; `column` as in `EdgeTable`."""
    tail, head, number = (_joined([getattr(b, name) for b in bundles], np.int64) for name in ("tail", "head", "number"))
    F = _joined([b.maps for b in bundles], np.float64)
    size = _joined([np.full(len(b.tail), b.shape[0]) for b in bundles], np.int64)
    at_tail, at_head, begin = [], [], 0
    for b in bundles:
        k, (m, n_tail, n_head) = len(b.tail), b.shape
        at_tail.append(begin + m * n_tail * np.arange(k))
        at_head.append(begin + k * m * n_tail + m * n_head * np.arange(k))
        begin += len(b.maps)
    first, incident = incidence(tail, head, len(column) - 1)
    places = _joined(at_tail, np.int64), _joined(at_head, np.int64)
    of_number = np.empty_like(size)
    of_number[number] = size
    row = starts(of_number)[number]
    return EdgeTable(int(size.sum()), column, tail, head, row, size, F, *places, first, incident)


def _joined(parts: list[NDArray[Any]], dtype: type) -> NDArray[Any]:
    """One array of the parts; a single part is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0, dtype=dtype), *parts])


class Ends(NamedTuple):
    """Ends of k edges.

    Attributes:
        tails, heads: Names of the vertices.
        tail, head: Numbers of the vertices, shape (k,).
    """

    tails: Sequence[Any]
    heads: Sequence[Any]
    tail: IntArray
    head: IntArray

    def name(self, e: int) -> str:
        """An edge, for messages."""
        return f"edge ({self.tails[e]!r}, {self.heads[e]!r})"

    def selected(self, edges: list[int]) -> "Ends":
        """The ends of some of the edges."""
        return Ends([self.tails[e] for e in edges], [self.heads[e] for e in edges], self.tail[edges], self.head[edges])


def checked_bundle(
    ends: Ends, dimension: IntArray, number: IntArray, F_tail: Any, F_head: Any, b: Any = None, K: Any = None
) -> EdgeBundle:
    """Make a bundle of k edges of equal stalk dimensions; maps, offset, weight and errors as in `Sheaf.add_edges`.

    Args:
        ends: Ends of the edges.
        dimension: Dimension of each vertex stalk, shape (V,).
        number: Number of each edge, shape (k,).
        F_tail, F_head, b, K: Maps, offset and weight; of the last two, None for zero and the identity.
    """
    k = len(ends.tail)
    loops = np.flatnonzero(ends.tail == ends.head)
    if loops.size:
        raise SheafError(f"{ends.name(loops[0])} is a loop; its ends must differ")
    F_tail = finite(F_tail, "F_tail", ends)
    F_head = finite(F_head, "F_head", ends)
    _require_fitting_maps(F_tail, "tail", ends, ends.tails, dimension[ends.tail])
    _require_fitting_maps(F_head, "head", ends, ends.heads, dimension[ends.head])
    m = F_tail.shape[1]
    if F_head.shape[1] != m:
        raise SheafError(
            f"{ends.name(0)}: the maps have {m} and {F_head.shape[1]} rows; both must map to the same edge stalk"
        )
    # No memory for zeros: a million edges have enough to store.
    offset = np.broadcast_to(0.0, (k, m)) if b is None else np.array(finite(b, "offset", ends))
    if offset.shape != (k, m):
        raise SheafError(f"offset has shape {offset.shape}; expected ({k}, {m})")
    weight = None if K is None else _checked_weights(K, ends, m)
    return EdgeBundle(
        ends.tail,
        ends.head,
        packed([F_tail], [F_head]),
        (m, F_tail.shape[2], F_head.shape[2]),
        offset,
        weight,
        number,
    )


def _require_fitting_maps(F: Array, name: str, ends: Ends, vertices: Sequence[Any], dimension: IntArray) -> None:
    """Refuse maps unless there is one for each edge, from the stalk of its tail or head, which has a dimension (k,)."""
    if F.ndim != 3 or F.shape[0] != len(dimension):
        raise SheafError(f"maps of the {name}s have shape {F.shape}; expected ({len(dimension)}, m, n)")
    wrong = np.flatnonzero(dimension != F.shape[2])
    if wrong.size:
        e = wrong[0]
        raise SheafError(
            f"{ends.name(e)}: the map of {name} {vertices[e]!r} has shape {F.shape[1:]}, "
            f"but the stalk has dimension {dimension[e]}; expected (m, {dimension[e]})"
        )


def _checked_weights(K: Any, ends: Ends, m: int) -> Array:
    """Return inner products (k, m, m), given as such or as positive numbers (k,)."""
    k = len(ends.tail)
    weight = np.array(finite(K, "weight", ends))
    if weight.shape == (k,):
        weight = weight[:, None, None] * np.eye(m)
    if weight.shape != (k, m, m):
        raise SheafError(f"weight has shape {weight.shape}; expected ({k}, {m}, {m}) or ({k},)")
    require_positive_definite(weight, lambda e: f"{ends.name(e)}: the weight")
    return weight


def require_positive_definite(K: Array, name: Callable[[int], str]) -> None:
    """Raise a SheafError that names the first of k matrices, shape (k, d, d), that is not SPD to rounding."""
    scale = np.abs(K).max(axis=(1, 2), initial=0.0)
    asymmetry = np.abs(K - K.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
    smallest = np.linalg.eigvalsh(K).min(axis=1, initial=np.inf)
    bad = np.flatnonzero((asymmetry > 1e-12 * scale) | ~(smallest > 1e-14 * scale))
    if bad.size:
        raise SheafError(
            f"{name(bad[0])} is not symmetric positive definite "
            f"(smallest eigenvalue {smallest[bad[0]]:.3g}, asymmetry {asymmetry[bad[0]]:.3g})"
        )


def finite(x: Any, name: str, ends: Ends | None = None) -> Array:
    """An array of finite numbers, not a copy, or a SheafError that names it and, with one entry an edge, the edge."""
    try:
        array = np.asarray(x, dtype=np.float64)
    except (TypeError, ValueError):
        raise SheafError(f"{name}: not an array of numbers of equal row lengths") from None
    if not np.isfinite(array).all():
        known = ends is not None and array.ndim > 0 and len(array) == len(ends.tail)
        edge = f"{ends.name(np.argwhere(~np.isfinite(array))[0, 0])}: " if ends is not None and known else ""
        raise SheafError(f"{edge}{name}: an entry is not finite")
    return array


def product(t: EdgeTable, x: Array) -> Array:
    """delta x for x of shape (n, k), without the matrix; shape (m, k)."""
    y = np.empty((t.rows, x.shape[1]))
    _coboundary_times(t, np.ascontiguousarray(x), y)
    return y


def adjoint_product(t: EdgeTable, y: Array) -> Array:
    """delta^T y for y of shape (m, k), without the matrix; shape (n, k)."""
    x = np.zeros((t.column[-1], y.shape[1]))
    _add_adjoint_times(t, np.ascontiguousarray(y), x)
    return x


def coboundary_matrix(t: EdgeTable) -> sparse.csr_array:
    """delta, rows by edge order, columns by vertex order, shape (m, n)."""
    kind = np.int32 if len(t.F) < 2**31 else np.int64
    indptr, indices, values = np.zeros(t.rows + 1, dtype=kind), np.empty(len(t.F), dtype=kind), np.empty(len(t.F))
    _fill_coboundary(t, indptr, indices, values)
    return sparse.csr_array((values, indices, indptr), shape=(t.rows, int(t.column[-1])))


def laplacian_block(t: EdgeTable, rows: IntArray, columns: IntArray, sign: float = 1.0) -> sparse.csr_array:
    """sign * (delta^T delta)[rows, columns], for vertex numbers that occur at most once.

    Of whitened edges this is a block of the Laplacian delta^T K delta.
    """
    values, indices, indptr, _ = block_rows(t, first_rows(t, rows), columns, sign=sign)
    dimension = np.diff(t.column)
    shape = len(indptr) - 1, int(dimension[columns].sum())
    # Both index arrays of one type: scipy would copy the larger one otherwise.
    return sparse.csr_array((values, indices, indptr.astype(indices.dtype)), shape=shape)


def first_rows(t: EdgeTable, vertices: IntArray) -> IntArray:
    """First row of each of some vertices, in the order given, by vertex; -1 at the others, shape (V,)."""
    dimension = t.column[vertices + 1] - t.column[vertices]
    place = np.full(len(t.column) - 1, -1)
    place[vertices] = starts(dimension)
    return place


def block_rows(
    t: EdgeTable, place: IntArray, columns: IntArray, *, sign: float = 1.0, upper: bool = False
) -> tuple[Array, IntArray, IntArray, Array]:
    """Compute compressed rows (values, indices, indptr) of sign * delta^T delta, or of its strict upper triangle.

    Args:
        t: Table of the edges.
        place: First row of each vertex, -1 for vertices without rows, shape (V,).
        columns: Vertices of the columns, in order.
        sign: Factor of the product.
        upper: True to keep only entries above the diagonal. The fourth array is then the diagonal, else empty.
    """
    indptr = np.zeros(int(np.diff(t.column)[place >= 0].sum()) + 1, dtype=np.int64)
    nothing = indptr, np.empty(0, dtype=np.int32), np.empty(0)
    np.cumsum(fill_block(t, place, columns, upper, sign, nothing, np.empty(0), True), out=indptr[1:])
    indices = np.empty(indptr[-1], dtype=np.int32 if indptr[-1] < 2**31 else np.int64)
    values, diagonal = np.zeros(indptr[-1]), np.zeros(len(indptr) - 1 if upper else 0)
    fill_block(t, place, columns, upper, sign, (indptr, indices, values), diagonal, False)
    return values, indices, indptr, diagonal


@Tiered
@allocating_jit
def incidence(tail, head, vertices):
    """The edges at each vertex, ascending: (first (V + 1,), incident (2 E,))."""
    first = np.zeros(vertices + 1, dtype=np.int64)
    for e in range(len(tail)):
        first[tail[e] + 1] += 1
        first[head[e] + 1] += 1
    for v in range(vertices):
        first[v + 1] += first[v]
    place = first[:-1].copy()
    incident = np.empty(2 * len(tail), dtype=np.int64)
    for e in range(len(tail)):
        for v in (tail[e], head[e]):
            incident[place[v]] = e
            place[v] += 1
    return first, incident


@Tiered
@jit
def _fill_coboundary(t, indptr, indices, values):
    """Fill delta, all row pointers zero before: F_tail x_tail - F_head x_head for each edge, columns ascending."""
    for e in range(len(t.tail)):
        i, j = t.tail[e], t.head[e]
        for a in range(t.size[e]):
            indptr[t.row[e] + a + 1] = t.column[i + 1] - t.column[i] + t.column[j + 1] - t.column[j]
    for a in range(t.rows):
        indptr[a + 1] += indptr[a]
    for e in range(len(t.tail)):
        i, j = t.tail[e], t.head[e]
        for v, other, at, sign in ((i, j, t.at_tail[e], 1.0), (j, i, t.at_head[e], -1.0)):
            n = t.column[v + 1] - t.column[v]
            skip = 0 if v < other else t.column[other + 1] - t.column[other]
            for a in range(t.size[e]):
                place = indptr[t.row[e] + a] + skip
                for k in range(n):
                    indices[place + k] = t.column[v] + k
                    values[place + k] = sign * t.F[at + a * n + k]


@Tiered
@jit
def _coboundary_times(t, x, y):
    """Y = delta x; x of shape (n, k), y of shape (m, k)."""
    for e in range(len(t.tail)):
        left, right = t.column[t.tail[e]], t.column[t.head[e]]
        n_i, n_j = t.column[t.tail[e] + 1] - left, t.column[t.head[e] + 1] - right
        for a in range(t.size[e]):
            for c in range(x.shape[1]):
                total = 0.0
                for k in range(n_i):
                    total += t.F[t.at_tail[e] + a * n_i + k] * x[left + k, c]
                for k in range(n_j):
                    total -= t.F[t.at_head[e] + a * n_j + k] * x[right + k, c]
                y[t.row[e] + a, c] = total


@Tiered
@jit
def _add_adjoint_times(t, y, x):
    """X += delta^T y; y of shape (m, k), x of shape (n, k)."""
    for e in range(len(t.tail)):
        left, right = t.column[t.tail[e]], t.column[t.head[e]]
        n_i, n_j = t.column[t.tail[e] + 1] - left, t.column[t.head[e] + 1] - right
        for a in range(t.size[e]):
            for c in range(x.shape[1]):
                value = y[t.row[e] + a, c]
                for k in range(n_i):
                    x[left + k, c] += t.F[t.at_tail[e] + a * n_i + k] * value
                for k in range(n_j):
                    x[right + k, c] -= t.F[t.at_head[e] + a * n_j + k] * value


@inline_jit
def _open_row(row, begin, skip, n_u, rows, start, end, counting):
    """Append the columns from begin + skip up to begin + n_u to a row."""
    start[row] = end[row]
    end[row] += n_u - skip
    if not counting:
        for b in range(skip, n_u):
            rows[1][start[row] + b - skip] = begin + b


@inline_jit
def _inner_product(F, m, at_v, n_v, at_u, n_u, a, b):
    """Return entry (a, b) of F_v^T F_u for maps (m, n_v) and (m, n_u) of an edge."""
    total = 0.0
    for k in range(m):
        total += F[at_v + k * n_v + a] * F[at_u + k * n_u + b]
    return total


@Tiered
@allocating_jit
def fill_block(t, place, columns, upper, sign, rows, diagonal, counting):
    """Fill a block of sign * L; return where its rows end, which counts what they need if all begin at 0.

    Columns are walked in order and append themselves to the rows that they meet: rows come out sorted without sorting.

    Args:
        t: The edge table.
        place: First row of each vertex, or -1 where it has none, shape (V,).
        columns: Vertices of the columns, in order.
        upper: True keeps only what lies above the diagonal, and puts the diagonal into `diagonal`.
        sign: A factor.
        rows: (indptr, indices, values), compressed rows; values are zero before.
        diagonal: Shape (rows,), zero before; not touched unless `upper`.
        counting: True counts alone, and fills nothing.
    """
    _, column, tail, head, _, size, F, at_tail, at_head, first, incident = t
    indptr, _, values = rows
    last = np.full(len(place), -1, dtype=np.int64)
    end = indptr[:-1].copy()  # end of the entries written to each row
    start = indptr[:-1].copy()  # start of the row's newest block
    begin = 0
    for u in columns:
        n_u = column[u + 1] - column[u]
        for at in range(first[u], first[u + 1]):
            e = incident[at]
            from_tail = tail[e] == u
            at_u = at_tail[e] if from_tail else at_head[e]
            for own in (False, True):
                v = u if own else (head[e] if from_tail else tail[e])
                if place[v] < 0 or (upper and place[v] > begin):
                    continue
                n_v = column[v + 1] - column[v]
                at_v = at_tail[e] if from_tail == own else at_head[e]
                factor = sign if own else -sign
                for a in range(n_v):
                    row = place[v] + a
                    skip = min(max(row + 1 - begin, 0), n_u) if upper else 0
                    if last[v] != u:
                        _open_row(row, begin, skip, n_u, rows, start, end, counting)
                    if counting:
                        continue
                    if skip > 0 and row == begin + skip - 1:  # the diagonal is the last that is skipped
                        diagonal[row] += factor * _inner_product(F, size[e], at_v, n_v, at_u, n_u, a, skip - 1)
                    for b in range(skip, n_u):
                        values[start[row] + b - skip] += factor * _inner_product(F, size[e], at_v, n_v, at_u, n_u, a, b)
                last[v] = u
        begin += n_u
    return end


@Tiered
@allocating_jit
def neighbours(t, free):
    """Compressed rows (values, indices, indptr) of the graph on the free vertices, parallel edges repeated."""
    tail, head, first, incident = t.tail, t.head, t.first, t.incident
    indptr = np.zeros(len(free) + 1, dtype=np.int32)
    indices = np.empty(len(incident), dtype=np.int32)
    size = 0
    for v in range(len(free)):
        if free[v]:
            for at in range(first[v], first[v + 1]):
                e = incident[at]
                u = head[e] if tail[e] == v else tail[e]
                if free[u]:
                    indices[size] = u
                    size += 1
        indptr[v + 1] = size
    return np.ones(size, dtype=np.int8), indices[:size], indptr


@Tiered
@jit
def bandwidth(t, place):
    """Largest |i - j| over the entries of delta^T delta on the vertices with a place, which is their first row."""
    widest = 0
    for v in range(len(place)):
        if place[v] >= 0:
            widest = max(widest, t.column[v + 1] - t.column[v] - 1)
    for e in range(len(t.tail)):
        i, j = t.tail[e], t.head[e]
        if place[i] >= 0 and place[j] >= 0:
            end_i, end_j = place[i] + t.column[i + 1] - t.column[i], place[j] + t.column[j + 1] - t.column[j]
            widest = max(widest, max(end_i, end_j) - 1 - min(place[i], place[j]))
    return widest
