"""The vertex stalks of a sheaf: names, numbers and columns, cochains on them, and inner products."""

import itertools
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, sparse
from scipy.sparse import csgraph

from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import finite, require_positive_definite

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Cochain = Array | Mapping[Hashable, ArrayLike]


class Stalks:
    """Vertices in order, with a stalk R^{n_v} and an inner product M_v each.

    0-cochains are vectors of length n = sum n_v in vertex order, or mappings from vertex to value.
    """

    def __init__(self, stalks: Mapping[Any, int], *, inner_products: Mapping[Any, ArrayLike] | None = None) -> None:
        """Number the vertices.

        Args:
            stalks: dimension of each vertex stalk, in order.
            inner_products: M_v of some vertices, see `set_inner_product`; the identity unless given.

        Raises:
            SheafError: a dimension is not a non-negative integer, there is no vertex, or as `set_inner_product`.
        """
        if not stalks:
            raise SheafError("a sheaf needs at least one vertex")
        kinds = set(map(type, stalks.values()))
        odd = {kind for kind in kinds if kind is bool or not issubclass(kind, int | np.integer)}
        if odd or min(stalks.values()) < 0:
            vertex, dimension = next((v, d) for v, d in stalks.items() if type(d) in odd or d < 0)
            raise SheafError(f"stalk of vertex {vertex!r}: dimension {dimension!r}; expected a whole number >= 0")
        self._dimension = np.fromiter(stalks.values(), np.int64, len(stalks))
        self._number = {vertex: i for i, vertex in enumerate(stalks)}
        self._column = np.concatenate([[0], np.cumsum(self._dimension)])
        self._products: dict[int, Array] = {}
        for vertex, M in (inner_products or {}).items():
            self.set_inner_product(vertex, M)

    def set_inner_product(self, vertex: Hashable, M: ArrayLike) -> None:
        """Give a vertex stalk the inner product M, in place of the one it has.

        Args:
            vertex: the vertex.
            M: symmetric positive definite, shape (n_v, n_v), or a positive number times the identity.

        Raises:
            SheafError: unknown vertex, wrong shape, non-finite entry, or M is not SPD.
        """
        v = self._find(vertex)
        d, name = int(self._dimension[v]), f"inner product of vertex {vertex!r}"
        matrix = finite(M, name)
        if matrix.shape == ():
            matrix = matrix * np.eye(d)
        if matrix.shape != (d, d):
            raise SheafError(f"{name} has shape {matrix.shape}; expected ({d}, {d})")
        require_positive_definite(matrix[None], lambda _: name)
        self._products[v] = 0.5 * (matrix + matrix.T)
        self.__dict__.pop("vertex_product", None)

    def inner_product(self, vertex: Hashable) -> Array:
        """The inner product M_v of a vertex stalk, shape (n_v, n_v)."""
        v = self._find(vertex)
        return self._products[v].copy() if v in self._products else np.eye(int(self._dimension[v]))

    @cached_property
    def vertex_product(self) -> "InnerProduct | None":
        """The inner product M of C^0; None where it is the identity."""
        alike: dict[int, list[int]] = {}
        for v, M in self._products.items():
            alike.setdefault(len(M), []).append(v)
        blocks = [(self._column[v], np.stack([self._products[k] for k in v])) for v in alike.values()]
        return of_blocks(blocks, int(self._column[-1])) if blocks else None

    @property
    def vertices(self) -> list[Hashable]:
        """The vertices, in order."""
        return list(self._number)

    def dimension(self, vertex: Hashable) -> int:
        """Dimension of the stalk of a vertex."""
        return int(self._dimension[self._find(vertex)])

    def _find(self, vertex: Hashable) -> int:
        try:
            return self._number[vertex]
        except (KeyError, TypeError):
            known = list(self._number)
            listed = ", ".join(map(repr, known[:12])) + (", ..." if len(known) > 12 else "")
            raise SheafError(f"unknown vertex {vertex!r}; the vertices are {listed}") from None

    def numbers(self, vertices: Sequence[Hashable]) -> Index:
        """Numbers of the given vertices, counted from 0 in vertex order."""
        try:
            return np.fromiter(map(self._number.__getitem__, vertices), np.int64, len(vertices))
        except (KeyError, TypeError):
            return np.array([self._find(v) for v in vertices], dtype=np.int64)

    def columns(self, vertices: Iterable[Hashable]) -> Index:
        """Columns of the coboundary that belong to the given vertices, in the given order."""
        return self.columns_of(self.numbers(list(vertices)))

    def columns_of(self, numbers: Index) -> Index:
        """The same for vertices given by number."""
        dimension = self._dimension[numbers]
        begin = np.cumsum(dimension) - dimension
        return np.repeat(self._column[numbers] - begin, dimension) + np.arange(dimension.sum())

    def interior(self, boundary: Iterable[Hashable]) -> list[Hashable]:
        """The vertices that are not in the boundary, in vertex order."""
        free = np.ones(len(self._number), dtype=bool)
        free[self.numbers(list(boundary))] = False
        return list(itertools.compress(self._number, free.tolist()))

    def pack(self, x: Cochain) -> Array:
        """A 0-cochain as a vector of length n.

        Raises:
            SheafError: a vertex is missing or unknown, a value has the wrong length, or an entry is not finite.
        """
        if isinstance(x, Mapping):
            missing = [v for v in self._number if v not in x]
            if missing or len(x) != len(self._number):
                strange = [v for v in x if v not in self._number]
                raise SheafError(f"a 0-cochain needs a value for each vertex; missing {missing}, unknown {strange}")
            return np.concatenate([self.stalk_value(v, x[v]) for v in self._number])
        value = finite(x, "0-cochain")
        if value.shape != (self._column[-1],):
            raise SheafError(f"a 0-cochain has shape ({self._column[-1]},); this one has {value.shape}")
        return value

    def unpack(self, x: Array) -> dict[Hashable, Array]:
        """A vector of length n as a mapping from vertex to value."""
        d = int(self._dimension[0])
        if d and (self._dimension == d).all():  # a million slices take a second
            return dict(zip(self._number, x.reshape(-1, d), strict=True))
        ends = self._column.tolist()
        return {v: x[i:j] for v, i, j in zip(self._number, ends, ends[1:], strict=False)}

    def stalk_value(self, vertex: Hashable, value: ArrayLike) -> Array:
        """A value in the stalk of a vertex, checked."""
        x = np.atleast_1d(finite(value, f"value of vertex {vertex!r}"))
        if x.shape != (self.dimension(vertex),):
            raise SheafError(f"value of vertex {vertex!r} has shape {x.shape}; expected ({self.dimension(vertex)},)")
        return x


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
        rows, columns, values = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
        for members in column_parts(image):
            R = np.asarray(np.linalg.qr(dense_rows(image[:, members])[1], mode="r"))
            R = R * np.where(np.diag(R) < 0.0, -1.0, 1.0)[:, None]
            at, block = dense_rows(basis[:, members])
            new = linalg.solve_triangular(R, block.T, trans="T").T
            rows.append(np.repeat(at, len(members)))
            columns.append(np.tile(members, len(at)))
            values.append(new.ravel())
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        return sparse.coo_array(entries, shape=basis.shape).tocsc()


def column_parts(matrix: sparse.csc_array) -> list[Index]:
    """The columns of each connected part of a matrix, ascending: columns that share a row are in one part."""
    if not matrix.shape[1]:
        return []
    pattern = abs(matrix)  # so that nothing cancels
    parts, label = csgraph.connected_components(pattern.T @ pattern, directed=False)
    return np.split(np.argsort(label, kind="stable"), np.cumsum(np.bincount(label, minlength=parts))[:-1])


def dense_rows(matrix: sparse.csc_array) -> tuple[Index, Array]:
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
