"""The edges of a sheaf: bundles that were added together, one table of all for the compiled loops, and its matrices."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mjsheaf.errors import SheafError
from mjsheaf.sheaf.loops import (
    adjoint_times,
    block_row_lengths,
    coboundary_times,
    fill_block,
    fill_coboundary,
    incidence,
    row_lengths,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class EdgeBundle:
    """k edges whose maps have the same shapes.

    Attributes:
        tail, head: vertex numbers, shape (k,).
        maps: F_tail of every edge row by row, then F_head of every edge, in one array for the compiled loops.
        shape: (m, n_tail, n_head), the dimensions of the edge stalk and of the two vertex stalks.
        offset: desired value b of each edge, shape (k, m).
        weight: inner product K of each edge stalk, shape (k, m, m), or None for the identity.
        row: first row of each edge in the coboundary, shape (k,).
    """

    tail: Index
    head: Index
    maps: Array
    shape: tuple[int, int, int]
    offset: Array
    weight: Array | None
    row: Index

    @property
    def F_tail(self) -> Array:  # noqa: N802 - the field's symbol
        """Restriction maps to the tails, shape (k, m, n_tail)."""
        m, n, _ = self.shape
        return self.maps[: len(self.tail) * m * n].reshape(-1, m, n) if m * n else np.zeros((len(self.tail), m, n))

    @property
    def F_head(self) -> Array:  # noqa: N802
        """Restriction maps to the heads, shape (k, m, n_head)."""
        m, n_tail, n = self.shape
        begin = len(self.tail) * m * n_tail
        return self.maps[begin:].reshape(-1, m, n) if m * n else np.zeros((len(self.tail), m, n))

    def selected(self, chosen: NDArray[np.bool_], number: Index, row: Index) -> "EdgeBundle":
        """The chosen edges (k,), with new numbers of the vertices (V,) and new first rows (k,)."""
        maps = packed([self.F_tail[chosen]], [self.F_head[chosen]])
        weight = None if self.weight is None else self.weight[chosen]
        tail, head = number[self.tail[chosen]], number[self.head[chosen]]
        return EdgeBundle(tail, head, maps, self.shape, self.offset[chosen], weight, row[chosen])

    def whitened(self) -> "EdgeBundle":
        """The same edges in edge coordinates in which the inner product is the identity.

        With K = C C^T, maps and offsets become C^T F and C^T b, so that the plain Laplacian of the result is
        delta^T K delta.
        """
        if self.weight is None:
            return self
        root = np.linalg.cholesky(self.weight).transpose(0, 2, 1)
        maps = packed([root @ self.F_tail], [root @ self.F_head])
        offset = np.einsum("kij,kj->ki", root, self.offset)
        return EdgeBundle(self.tail, self.head, maps, self.shape, offset, None, self.row)


def packed(F_tails: list[Array], F_heads: list[Array]) -> Array:
    """A copy of maps to the tails, then to the heads, row by row."""
    maps = np.empty(sum(F.size for F in F_tails + F_heads))
    end = 0
    for F in F_tails + F_heads:
        maps[end : end + F.size].reshape(F.shape)[...] = F
        end += F.size
    return maps


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
    column: Index
    tail: Index
    head: Index
    row: Index
    size: Index
    F: Array
    at_tail: Index
    at_head: Index
    first: Index
    incident: Index


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
        np.concatenate([b.row for b in group]),
    )


def tabulate(bundles: list[EdgeBundle], column: Index) -> EdgeTable:
    """The table of the given bundles, one after the other, without their weights; `column` as in `EdgeTable`."""
    tail, head, row = (_joined([getattr(b, name) for b in bundles], np.int64) for name in ("tail", "head", "row"))
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
    return EdgeTable(int(size.sum()), column, tail, head, row, size, F, *places, first, incident)


def _joined(parts: list[NDArray], dtype: type) -> NDArray:
    """One array of the parts; a single part is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0, dtype=dtype), *parts])


def product(t: EdgeTable, x: Array) -> Array:
    """delta x for x of shape (n, k), without the matrix; shape (m, k)."""
    y = np.empty((t.rows, x.shape[1]))
    coboundary_times(t, np.ascontiguousarray(x), y)
    return y


def adjoint_product(t: EdgeTable, y: Array) -> Array:
    """delta^T y for y of shape (m, k), without the matrix; shape (n, k)."""
    x = np.empty((t.column[-1], y.shape[1]))
    adjoint_times(t, np.ascontiguousarray(y), x)
    return x


class Ends(NamedTuple):
    """Where k edges begin and end.

    Attributes:
        tails, heads: the vertices as the user calls them.
        tail, head: the same by number, shape (k,).
    """

    tails: Sequence
    heads: Sequence
    tail: Index
    head: Index

    def name(self, e: int) -> str:
        """An edge, for messages."""
        return f"edge ({self.tails[e]!r}, {self.heads[e]!r})"


def checked_bundle(
    ends: Ends, dimension: Index, F_tails: Any, F_heads: Any, offset: Any, weight: Any, row: Any
) -> EdgeBundle:
    """A bundle of k edges of equal stalk dimensions.

    Args:
        ends: of the edges.
        dimension: dimension of each vertex stalk, shape (V,).
        F_tails, F_heads: maps, shapes (k, m, n_tail) and (k, m, n_head).
        offset: desired values, shape (k, m), or None.
        weight: inner products, shape (k, m, m), or positive numbers of shape (k,) times the identity, or None.
        row: first row of each edge, shape (k,), or of the first edge, from where they follow each other.

    Raises:
        SheafError: loop, wrong shape, non-finite entry, or a weight that is not SPD.
    """
    k = len(ends.tail)
    loops = np.flatnonzero(ends.tail == ends.head)
    if loops.size:
        raise SheafError(f"{ends.name(loops[0])} is a loop; its ends must differ")
    F_tail, F_head = _of_edges(F_tails, "F_tail", ends), _of_edges(F_heads, "F_head", ends)
    for name, F, vertices, at in (("tail", F_tail, ends.tails, ends.tail), ("head", F_head, ends.heads, ends.head)):
        if F.ndim != 3 or F.shape[0] != k:
            raise SheafError(f"maps of the {name}s have shape {F.shape}; expected ({k}, m, n)")
        wrong = np.flatnonzero(dimension[at] != F.shape[2])
        if wrong.size:
            e = wrong[0]
            raise SheafError(
                f"{ends.name(e)}: the map of {name} {vertices[e]!r} has shape {F.shape[1:]}, "
                f"but the stalk has dimension {dimension[at[e]]}; expected (m, {dimension[at[e]]})"
            )
    m = F_tail.shape[1]
    if F_head.shape[1] != m:
        raise SheafError(
            f"{ends.name(0)}: the maps have {m} and {F_head.shape[1]} rows; both must map to the same edge stalk"
        )
    # No memory for zeros: a million edges have enough to store.
    b = np.broadcast_to(0.0, (k, m)) if offset is None else np.array(_of_edges(offset, "offset", ends))
    if b.shape != (k, m):
        raise SheafError(f"offset has shape {b.shape}; expected ({k}, {m})")
    K = None if weight is None else np.array(_of_edges(weight, "weight", ends))
    if K is not None:
        K = K[:, None, None] * np.eye(m) if K.shape == (k,) else K
        if K.shape != (k, m, m):
            raise SheafError(f"weight has shape {K.shape}; expected ({k}, {m}, {m}) or ({k},)")
        require_positive_definite(K, lambda e: f"{ends.name(e)}: the weight")
    rows = row + m * np.arange(k) if np.ndim(row) == 0 else row
    shape = m, F_tail.shape[2], F_head.shape[2]
    return EdgeBundle(ends.tail, ends.head, packed([F_tail], [F_head]), shape, b, K, rows)


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


def finite(x: Any, name: str) -> Array:
    """A copy of an array of finite numbers, or a SheafError that names it."""
    array = np.array(_numbers(x, name))
    if not np.isfinite(array).all():
        raise SheafError(f"{name}: an entry is not finite")
    return array


def _of_edges(x: Any, name: str, ends: Ends) -> Array:
    """One finite entry of an array for each edge; not a copy."""
    array = _numbers(x, name)
    if not np.isfinite(array).all():
        e = np.argwhere(~np.isfinite(array))[0, 0] if array.ndim and len(array) == len(ends.tail) else None
        raise SheafError(f"{'' if e is None else f'{ends.name(e)}: '}{name}: an entry is not finite")
    return array


def _numbers(x: Any, name: str) -> Array:
    try:
        return np.asarray(x, dtype=np.float64)
    except (TypeError, ValueError):
        raise SheafError(f"{name}: not an array of numbers of equal row lengths") from None


def coboundary_matrix(t: EdgeTable) -> sparse.csr_array:
    """delta, rows by edge order, columns by vertex order, shape (m, n)."""
    kind = np.int32 if len(t.F) < 2**31 else np.int64
    indptr, indices, values = np.empty(t.rows + 1, dtype=kind), np.empty(len(t.F), dtype=kind), np.empty(len(t.F))
    row_lengths(t, indptr)
    fill_coboundary(t, indptr, indices, values)
    return sparse.csr_array((values, indices, indptr), shape=(t.rows, int(t.column[-1])))


def laplacian_block(t: EdgeTable, rows: Index, columns: Index, sign: float = 1.0) -> sparse.csr_array:
    """sign * (delta^T delta)[rows, columns], for vertex numbers that occur at most once.

    Of whitened edges this is a block of the Laplacian delta^T K delta.
    """
    values, indices, indptr, _ = block_rows(t, first_rows(t, rows), columns, sign=sign)
    dimension = np.diff(t.column)
    shape = len(indptr) - 1, int(dimension[columns].sum())
    # Both index arrays of one type: scipy would copy the larger one otherwise.
    return sparse.csr_array((values, indices, indptr.astype(indices.dtype)), shape=shape)


def first_rows(t: EdgeTable, vertices: Index) -> Index:
    """First row of each of some vertices, in the order given, by vertex; -1 at the others, shape (V,)."""
    dimension = t.column[vertices + 1] - t.column[vertices]
    place = np.full(len(t.column) - 1, -1)
    place[vertices] = np.cumsum(dimension) - dimension
    return place


def block_rows(
    t: EdgeTable, place: Index, columns: Index, *, sign: float = 1.0, upper: bool = False
) -> tuple[Array, Index, Index, Array]:
    """Compressed rows (values, indices, indptr) of sign * delta^T delta, or of its strict upper triangle.

    Args:
        t: the edges.
        place: first row of each vertex, -1 at those without rows, shape (V,).
        columns: vertices of the columns, in order.
        sign: a factor.
        upper: whether to keep only what lies above the diagonal; the diagonal comes last then, else an empty array.
    """
    indptr = np.empty(int(np.diff(t.column)[place >= 0].sum()) + 1, dtype=np.int64)
    block_row_lengths(t, place, columns, upper, indptr)
    indices = np.empty(indptr[-1], dtype=np.int32 if indptr[-1] < 2**31 else np.int64)
    values, diagonal = np.zeros(indptr[-1]), np.zeros(len(indptr) - 1 if upper else 0)
    fill_block(t, place, columns, upper, sign, (indptr, indices, values), diagonal)
    return values, indices, indptr, diagonal
