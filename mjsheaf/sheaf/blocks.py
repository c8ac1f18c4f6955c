"""Sparse matrices in blocks: put together, taken apart, their null spaces, and inner products that do not mix stalks.

A singular value counts as zero when it is at most `rtol` times the largest one. Each connected part of a matrix is
treated apart: exactly, by a dense singular value decomposition, up to DENSE_COLUMNS columns; beyond, by shift-invert
Lanczos on A^T A, repeated on the complement of what was found until nothing more is null, which also finds every copy
of a multiple eigenvalue. Rows that meet the same columns are first rotated among themselves, so that what a rotated
frame only seems to connect is apart.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse import csgraph
from scipy.sparse import linalg as splinalg

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import SheafError

RANK_TOLERANCE = 1e-9
"""Default relative tolerance under which a singular value counts as zero."""

DENSE_COLUMNS = 1200
"""Largest component that is decomposed densely."""

MOST_CLASSES = 64
"""Largest dimension of a cokernel that is sought in components of more than DENSE_COLUMNS rows."""

MOST_ENTRIES = 50_000_000
"""Largest basis of a cokernel, rows times dimension."""

ROUNDING = 64 * np.finfo(np.float64).eps

_LANCZOS_VECTORS = 8
_INVERTED_COLUMNS = 60  # from which a triangular inverse is tried before a decomposition
_INVERSE_MARGIN = 0.5  # leaves room for the rounding of the inverse


def assembled(blocks: Iterable[tuple[Any, Any, Any]], shape: tuple[int, int]) -> sparse.coo_array:
    """A matrix of blocks (rows, columns, values), three arrays each that are broadcast; zero elsewhere."""
    entries = [np.broadcast_arrays(*block) for block in blocks]
    rows, columns, values = (
        np.concatenate([np.zeros(0, kind), *(entry[k].ravel() for entry in entries)])
        for k, kind in enumerate((np.int64, np.int64, np.float64))
    )
    return sparse.coo_array((values, (rows, columns)), shape=shape)


def parts(matrix: sparse.sparray) -> Iterator[tuple[IntArray, IntArray, sparse.csr_array]]:
    """Yield rows, columns and block of each connected part of a matrix: columns that share a row are in one part.

    Parts are in the order of their first columns; rows without entries are in none.
    """
    matrix = sparse.csr_array(matrix, copy=True)
    matrix.eliminate_zeros()
    pattern = matrix.copy()
    pattern.data[:] = 1.0  # so that nothing cancels
    count, label = csgraph.connected_components(pattern.T @ pattern, directed=False)
    met = np.flatnonzero(np.diff(matrix.indptr))
    row_label = label[matrix.indices[matrix.indptr[met]]]
    by_row, by_column = met[np.argsort(row_label, kind="stable")], np.argsort(label, kind="stable")
    row_end, column_end = (np.cumsum(np.bincount(x, minlength=count)).tolist() for x in (row_label, label))
    ordered = matrix[by_row][:, by_column]
    for top, bottom, left, right in zip([0, *row_end], row_end, [0, *column_end], column_end, strict=False):
        yield by_row[top:bottom], by_column[left:right], ordered[top:bottom, left:right]


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


@dataclass(frozen=True)
class InnerProduct:
    """An inner product <x, y> = x^T M y that does not mix stalks.

    Attributes:
        matrix: M, block diagonal, symmetric positive definite, shape (n, n).
        inverse: M^-1.
        root: upper triangular U with M = U^T U, so that |x|_M = |U x|.
        root_inverse: U^-1.
    """

    matrix: sparse.csr_array
    inverse: sparse.csr_array
    root: sparse.csr_array
    root_inverse: sparse.csr_array

    @classmethod
    def of_blocks(cls, blocks: Iterable[tuple[IntArray, Array]], size: int) -> "InnerProduct":
        """Assemble the inner product from blocks, with the identity elsewhere.

        Args:
            blocks: First coordinates (k,) and SPD matrices (k, d, d) of k stalks of dimension d, for each d.
            size: Dimension n of the space.
        """
        rest = np.ones(size, dtype=bool)
        placed: list[tuple[NDArray[Any], tuple[Any, ...]]] = []
        for first, M in blocks:
            at = first[:, None] + np.arange(M.shape[1])
            rest[at] = False
            root = np.linalg.cholesky(M).transpose(0, 2, 1)
            root_inverse = np.linalg.solve(root, np.broadcast_to(np.eye(M.shape[1]), M.shape))
            placed.append((at, (M, root_inverse @ root_inverse.transpose(0, 2, 1), root, root_inverse)))
        identity = (np.flatnonzero(rest), np.flatnonzero(rest), 1.0)
        four = ([identity, *((at[:, :, None], at[:, None], values[k]) for at, values in placed)] for k in range(4))
        return cls(*(assembled(entries, (size, size)).tocsr() for entries in four))

    def restricted(self, at: IntArray) -> "InnerProduct":
        """The same on some coordinates, whole stalks of them, in the order given."""
        return InnerProduct(*(m[at][:, at] for m in (self.matrix, self.inverse, self.root, self.root_inverse)))

    def orthonormal(self, basis: sparse.csc_array) -> sparse.csc_array:
        """A basis (n, k) of the same space that is orthonormal here, columns that share no stalk treated apart.

        A basis that is orthonormal already stays as it is, to rounding.
        """
        blocks = []
        for _, columns, image in parts(self.root @ basis):
            R = np.asarray(np.linalg.qr(image.toarray(), mode="r"))
            R = R * np.where(np.diag(R) < 0.0, -1.0, 1.0)[:, None]
            own = basis[:, columns]
            rows = np.unique(own.indices)
            blocks.append((rows[:, None], columns, linalg.solve_triangular(R, own[rows].toarray().T, trans="T").T))
        return assembled(blocks, basis.shape).tocsc()


def sparse_null_space(
    matrix: sparse.csr_array, rtol: float = RANK_TOLERANCE, scale: float | None = None
) -> sparse.csc_array:
    """Return an orthonormal basis of the null space of a matrix, each vector on one part, shape (columns, dimension).

    Singular values of at most rtol times the scale count as zero; that is the matrix's own largest unless given.
    """
    scale = largest_singular_value(matrix) if scale is None else scale
    blocks, found = [], 0
    for _, columns, part in parts(sparser_rows(matrix)):
        dense = len(columns) <= DENSE_COLUMNS
        local = _dense_null_space(part.toarray(), scale, rtol) if dense else _lanczos_null_space(part, scale, rtol)
        blocks.append((columns[:, None], found + np.arange(local.shape[1]), local))
        found += local.shape[1]
    return assembled(blocks, (matrix.shape[1], found)).tocsc()


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
    basis = sparse_null_space(transposed, rtol, largest_singular_value(matrix))
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
    except splinalg.ArpackError:  # so many eigenvalues are equal that its few vectors span them all: more of them
        return splinalg.eigsh(operator, k=count, ncv=min(n, 6 * count), which="LM", v0=start, tol=tolerance)[1]


def _dense_null_space(matrix: Array, scale: float, rtol: float) -> Array:
    if matrix.shape[0] == 0:
        return np.eye(matrix.shape[1])
    matrix = _with_few_rows(matrix)
    if _surely_injective(matrix, rtol * scale):
        return np.zeros((matrix.shape[1], 0))
    _, singular, rows = np.linalg.svd(matrix, full_matrices=True)
    return rows[np.count_nonzero(singular > rtol * scale) :].T


def _surely_injective(upper: Array, tolerance: float) -> bool:
    """Return True if a triangular inverse proves full rank: the smallest singular value is at least 1 / |R^-1|_F.

    This costs a fraction of a singular value decomposition, which then only matrices of deficient or nearly deficient
    rank need.
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
