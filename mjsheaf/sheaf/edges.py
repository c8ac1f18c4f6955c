"""Bundles of edges: the storage of a sheaf's restriction maps, and the sparse matrices made from them."""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class EdgeBundle:
    """k edges whose maps have the same shapes.

    Attributes:
        tail, head: vertex numbers, shape (k,).
        F_tail, F_head: restriction maps, shapes (k, m, n_tail) and (k, m, n_head).
        offset: desired value b of each edge, shape (k, m).
        weight: inner product K of each edge stalk, shape (k, m, m), or None for the identity.
        row: first row of each edge in the coboundary, shape (k,).
    """

    tail: Index
    head: Index
    F_tail: Array
    F_head: Array
    offset: Array
    weight: Array | None
    row: Index

    @property
    def shape(self) -> tuple[int, int, int]:
        """(m, n_tail, n_head), the dimensions of the edge stalk and of the two vertex stalks."""
        return self.F_tail.shape[1], self.F_tail.shape[2], self.F_head.shape[2]

    def whitened(self) -> "EdgeBundle":
        """The same edges in edge coordinates in which the inner product is the identity.

        With K = C C^T, maps and offsets become C^T F and C^T b, so that the plain Laplacian of the result is
        delta^T K delta.
        """
        if self.weight is None:
            return self
        root = np.linalg.cholesky(self.weight).transpose(0, 2, 1)
        return EdgeBundle(
            self.tail,
            self.head,
            root @ self.F_tail,
            root @ self.F_head,
            np.einsum("kij,kj->ki", root, self.offset),
            None,
            self.row,
        )


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
        np.concatenate([b.F_tail for b in group]),
        np.concatenate([b.F_head for b in group]),
        np.concatenate([b.offset for b in group]),
        np.concatenate(weights) if weights else None,
        np.concatenate([b.row for b in group]),
    )


def coboundary_matrix(bundles: list[EdgeBundle], rows: int, column: Index, columns: int) -> sparse.csr_array:
    """Assemble delta, with row F_tail x_tail - F_head x_head for each edge.

    The compressed rows are written in place, one array operation for each block of a bundle.

    Args:
        bundles: the edges.
        rows: number of rows.
        column: first column of each vertex.
        columns: number of columns.
    """
    row_length = np.zeros(rows, dtype=np.int64)
    for b in bundles:
        m, n_tail, n_head = b.shape
        row_length[b.row[:, None] + np.arange(m)] = n_tail + n_head
    start = np.concatenate([[0], np.cumsum(row_length)])
    values = np.empty(start[-1])
    indices = np.empty(start[-1], dtype=np.int64)
    for b in bundles:
        m, n_tail, n_head = b.shape
        begin = start[b.row[:, None] + np.arange(m)][:, :, None]  # (k, m, 1)
        tail_first = (column[b.tail] < column[b.head])[:, None, None]
        for vertex, block, width, place in (
            (b.tail, b.F_tail, n_tail, np.where(tail_first, 0, n_head)),
            (b.head, -b.F_head, n_head, np.where(tail_first, n_tail, 0)),
        ):
            at = begin + place + np.arange(width)
            values[at] = block
            indices[at] = column[vertex][:, None, None] + np.arange(width)
    return sparse.csr_array((values, indices, start), shape=(rows, columns))
