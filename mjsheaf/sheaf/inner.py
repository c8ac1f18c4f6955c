"""Inner products on stalks: block-diagonal matrices, and bases that are orthonormal in them."""

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse import csgraph

from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import finite

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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

    def restricted(self, at: Index) -> "InnerProduct":
        """The same on some coordinates, whole stalks of them, in the order given."""
        return InnerProduct(*(m[at][:, at] for m in (self.matrix, self.inverse, self.root, self.root_inverse)))

    def orthonormal(self, basis: sparse.csc_array) -> sparse.csc_array:
        """A basis (n, k) of the same space that is orthonormal here, columns that share no stalk treated apart.

        A basis that is orthonormal already stays as it is, to rounding.
        """
        image = sparse.csc_array(self.root @ basis)
        pattern = abs(image)  # so that nothing cancels
        parts, label = csgraph.connected_components(pattern.T @ pattern, directed=False)
        by_part = np.split(np.argsort(label, kind="stable"), np.cumsum(np.bincount(label, minlength=parts))[:-1])
        rows, columns, values = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
        for members in by_part if basis.shape[1] else []:
            R = np.asarray(np.linalg.qr(_dense_rows(image[:, members])[1], mode="r"))
            R = R * np.where(np.diag(R) < 0.0, -1.0, 1.0)[:, None]
            at, block = _dense_rows(basis[:, members])
            new = linalg.solve_triangular(R, block.T, trans="T").T
            rows.append(np.repeat(at, len(members)))
            columns.append(np.tile(members, len(at)))
            values.append(new.ravel())
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        return sparse.coo_array(entries, shape=basis.shape).tocsc()


def _dense_rows(matrix: sparse.csc_array) -> tuple[Index, Array]:
    """The rows of a matrix that have entries, and the dense block of them."""
    at = np.unique(matrix.indices)
    return at, matrix[at].toarray()


def of_blocks(blocks: Iterable[tuple[Index, Array]], size: int) -> InnerProduct:
    """The inner product with the given blocks, the identity elsewhere.

    Args:
        blocks: first coordinate (k,) and matrices (k, d, d) of k stalks of dimension d, symmetric positive definite.
        size: n.
    """
    identity = np.ones(size, dtype=bool)
    places: list[tuple[Index, Index]] = []
    parts: list[list[Array]] = [[], [], [], []]
    for first, M in blocks:
        d = M.shape[1]
        at = np.asarray(first)[:, None] + np.arange(d)
        identity[at] = False
        places.append((np.repeat(at, d, axis=1).ravel(), np.tile(at, (1, d)).ravel()))
        root = np.linalg.cholesky(M).transpose(0, 2, 1)
        root_inverse = np.linalg.solve(root, np.broadcast_to(np.eye(d), M.shape))
        for part, values in zip(
            parts, (M, root_inverse @ root_inverse.transpose(0, 2, 1), root, root_inverse), strict=True
        ):
            part.append(values.ravel())
    rest = np.flatnonzero(identity)
    rows, columns = (np.concatenate([rest, *(place[i] for place in places)]) for i in range(2))
    matrices = []
    for part in parts:
        values = np.concatenate([np.ones(len(rest)), *part])
        matrices.append(sparse.coo_array((values, (rows, columns)), shape=(size, size)).tocsr())
    return InnerProduct(*matrices)


def of_vertices(products: Mapping[int, Array], column: Index) -> InnerProduct:
    """The inner product of C^0.

    Args:
        products: M of some vertices, by number; the others have the identity.
        column: first column of each vertex, and the number of columns at the end.
    """
    alike: dict[int, list[int]] = {}
    for v, M in products.items():
        alike.setdefault(len(M), []).append(v)
    blocks = [(column[numbers], np.stack([products[v] for v in numbers])) for numbers in alike.values()]
    return of_blocks(blocks, int(column[-1]))


def checked_inner_product(vertex: Hashable, M: Any, dimension: int) -> Array:
    """An inner product of a vertex stalk, shape (d, d), or a positive number times the identity.

    Raises:
        SheafError: wrong shape, non-finite entry, or not symmetric positive definite.
    """
    matrix = finite(M, f"inner product of vertex {vertex!r}")
    if matrix.shape == ():
        matrix = matrix * np.eye(dimension)
    if matrix.shape != (dimension, dimension):
        raise SheafError(
            f"inner product of vertex {vertex!r} has shape {matrix.shape}; expected ({dimension}, {dimension})"
        )
    scale = np.abs(matrix).max(initial=0.0)
    asymmetry = np.abs(matrix - matrix.T).max(initial=0.0)
    smallest = np.linalg.eigvalsh(matrix).min(initial=np.inf)
    if asymmetry > 1e-12 * scale or not smallest > 1e-14 * scale:
        raise SheafError(
            f"inner product of vertex {vertex!r}: expected a symmetric positive definite matrix "
            f"(smallest eigenvalue {smallest:.3g}, asymmetry {asymmetry:.3g})"
        )
    return 0.5 * (matrix + matrix.T)
