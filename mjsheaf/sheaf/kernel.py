"""Kernels and ranks of sparse matrices, with a stated tolerance.

A singular value counts as zero when it is at most `rtol` times the largest one. Each connected component of the
matrix is treated apart: exactly, by a dense singular value decomposition, up to DENSE_COLUMNS columns; beyond, by
shift-invert Lanczos on A^T A, repeated on the complement of what was found until nothing more is null, which also
finds every copy of a multiple eigenvalue.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse import linalg as splinalg

from mjsheaf.errors import SheafError

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-9
"""Default relative tolerance under which a singular value counts as zero."""

DENSE_COLUMNS = 1200
"""Largest component that is decomposed densely."""

_LANCZOS_VECTORS = 8


def kernel_basis(matrix: sparse.csr_array, rtol: float = RANK_TOLERANCE) -> Array:
    """Return an orthonormal basis of the kernel of a matrix, shape (columns, dimension)."""
    columns = matrix.shape[1]
    if columns == 0:
        return np.zeros((0, 0))
    gram_pattern = matrix.T @ matrix if matrix.nnz else sparse.csr_array((columns, columns))
    parts, label = csgraph.connected_components(gram_pattern, directed=False)
    scale = _largest_singular_value(matrix)
    order = np.argsort(label, kind="stable")
    blocks = []
    for members in np.split(order, np.cumsum(np.bincount(label, minlength=parts))[:-1]):
        part = matrix[:, members]
        part = part[np.diff(part.indptr) > 0]
        local = (
            _dense_kernel(part.toarray(), scale, rtol)
            if len(members) <= DENSE_COLUMNS
            else _lanczos_kernel(part, scale, rtol)
        )
        basis = np.zeros((columns, local.shape[1]))
        basis[members] = local
        blocks.append(basis)
    return np.hstack(blocks)


def _largest_singular_value(matrix: sparse.csr_array) -> float:
    if matrix.nnz == 0:
        return 0.0
    if min(matrix.shape) <= DENSE_COLUMNS:
        gram = matrix.T @ matrix if matrix.shape[1] <= matrix.shape[0] else matrix @ matrix.T
        return float(np.sqrt(np.linalg.eigvalsh(gram.toarray())[-1]))  # of the largest value, squaring loses nothing
    start = np.ones(min(matrix.shape))  # a fixed start vector keeps the answer the same in every run
    return float(splinalg.svds(matrix, k=1, v0=start, return_singular_vectors=False)[0])


def _dense_kernel(matrix: Array, scale: float, rtol: float) -> Array:
    if matrix.shape[0] == 0:
        return np.eye(matrix.shape[1])
    if len(matrix) > matrix.shape[1]:
        # The same singular values and right vectors in a square, however many edges there are.
        matrix = np.asarray(np.linalg.qr(matrix, mode="r"))
    _, singular, rows = np.linalg.svd(matrix, full_matrices=True)
    rank = int(np.sum(singular > rtol * scale))
    return rows[rank:].T


def _lanczos_kernel(matrix: sparse.csr_array, scale: float, rtol: float) -> Array:
    n = matrix.shape[1]
    shift = 1e-10 * scale**2
    gram = (matrix.T @ matrix).tocsc()
    factor = splinalg.splu(gram + shift * sparse.eye_array(n, format="csc"))
    found = np.zeros((n, 0))
    start = np.random.default_rng(0).standard_normal(n)

    while True:
        known = found

        def inverse(x: Array, known: Array = known) -> Array:
            y = factor.solve(x - known @ (known.T @ x))
            return y - known @ (known.T @ y)

        operator = splinalg.LinearOperator((n, n), matvec=inverse, dtype=np.float64)
        _, vectors = splinalg.eigsh(operator, k=_LANCZOS_VECTORS, which="LM", v0=inverse(start))
        # Lanczos on the square sees singular values only down to 1e-8 of the largest; the candidates' own
        # singular values, taken on A itself, are exact to machine precision.
        vectors, _ = np.linalg.qr(vectors - found @ (found.T @ vectors))
        _, singular, rows = np.linalg.svd(matrix @ vectors, full_matrices=True)
        null = np.append(singular, np.zeros(len(rows) - len(singular))) <= rtol * scale  # fewer rows than vectors
        if not null.any():
            return found
        found, _ = np.linalg.qr(np.hstack([found, vectors @ rows[null].T]))
        if found.shape[1] > n // 2:
            raise SheafError(f"the kernel of this {matrix.shape} map has dimension over {n // 2}: too large")
