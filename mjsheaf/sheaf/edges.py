"""Edges as they are stored: bundles that were added together, and one table of all for the compiled loops."""

from collections import defaultdict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.sheaf.loops import adjoint_times, coboundary_times, incidence

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
        """Some of the edges.

        Args:
            chosen: which, shape (k,).
            number: new number of each vertex, shape (V,).
            row: new first row of each edge, shape (k,).
        """
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
    """The table of the given bundles, one after the other.

    Args:
        bundles: the edges; their weights are left out.
        column: first column of each vertex, and the number of columns at the end.
    """
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
