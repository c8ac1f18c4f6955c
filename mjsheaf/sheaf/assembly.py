"""Sparse matrices of a sheaf, made from its table of edges."""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mjsheaf.sheaf.edges import EdgeTable
from mjsheaf.sheaf.loops import block_row_lengths, fill_block, fill_coboundary, row_lengths

Index = NDArray[np.int64]


def coboundary_matrix(t: EdgeTable) -> sparse.csr_array:
    """delta, rows by edge order, columns by vertex order, shape (m, n)."""
    kind = np.int32 if len(t.F) < 2**31 else np.int64
    indptr, indices, values = np.empty(t.rows + 1, dtype=kind), np.empty(len(t.F), dtype=kind), np.empty(len(t.F))
    row_lengths(t, indptr)
    fill_coboundary(t, indptr, indices, values)
    return sparse.csr_array((values, indices, indptr), shape=(t.rows, int(t.column[-1])))


def laplacian_block(t: EdgeTable, rows: Index, columns: Index, sign: float = 1.0) -> sparse.csr_array:
    """sign * (delta^T delta)[rows, columns].

    Args:
        t: the edges; of whitened ones this is a block of the Laplacian delta^T K delta.
        rows, columns: vertex numbers, each at most once.
        sign: a factor.
    """
    dimension = np.diff(t.column)
    place = np.full(len(dimension), -1)
    place[rows] = np.cumsum(dimension[rows]) - dimension[rows]
    indptr = np.empty(int(dimension[rows].sum()) + 1, dtype=np.int64)
    block_row_lengths(t, place, columns, False, indptr)
    kind = np.int32 if indptr[-1] < 2**31 else np.int64
    indices, values = np.empty(indptr[-1], dtype=kind), np.zeros(indptr[-1])
    fill_block(t, place, columns, False, sign, indptr, indices, values, np.zeros(0))
    # Both index arrays of one type: scipy would copy the larger one otherwise.
    return sparse.csr_array(
        (values, indices, indptr.astype(kind)), shape=(len(indptr) - 1, int(dimension[columns].sum()))
    )
