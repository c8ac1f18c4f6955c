"""Stalks and edges of a sheaf: cochains, bundles of edges and the coboundary."""

import itertools
from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse import csgraph

from mjsheaf.arrays import Array, BoolArray, IntArray, firsts_of
from mjsheaf.errors import SheafError


def assembled(blocks: Iterable[tuple[Any, Any, Any]], shape: tuple[int, int]) -> sparse.coo_array:
    """A matrix of blocks (rows, columns, values), three arrays each that are broadcast; zero elsewhere."""
    entries = [np.broadcast_arrays(*block) for block in blocks]
    index = np.int32 if max(shape) < 2**31 else np.int64  # as SciPy would choose after a look at all of them
    rows, columns, values = (
        np.concatenate([np.zeros(0, kind), *(entry[k].ravel() for entry in entries)], dtype=kind, casting="same_kind")
        for k, kind in enumerate((index, index, np.float64))
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


@dataclass(frozen=True)
class EdgeBundle:
    """Bundle of k edges whose maps have the same shapes.

    Attributes:
        tail, head: Vertex numbers, shape (k,).
        F_tail, F_head: Restriction maps, shapes (k, m, n_tail) and (k, m, n_head).
        offset: Desired value b of each edge, shape (k, m).
        weight: Inner product K of each edge stalk, shape (k, m, m), or None for the identity.
        number: Number of each edge in the sheaf, in the order in which edges were added, shape (k,).
    """

    tail: IntArray
    head: IntArray
    F_tail: Array
    F_head: Array
    offset: Array
    weight: Array | None
    number: IntArray

    def whitened(self) -> "EdgeBundle":
        """Return the same edges in edge coordinates in which the inner product is the identity.

        With K = C C^T, maps and offsets become C^T F and C^T b, so that the plain Laplacian of the result is
        delta^T K delta.
        """
        if self.weight is None:
            return self
        root = np.linalg.cholesky(self.weight).transpose(0, 2, 1)
        offset = np.einsum("kij,kj->ki", root, self.offset)
        return replace(self, F_tail=root @ self.F_tail, F_head=root @ self.F_head, offset=offset, weight=None)


@dataclass(frozen=True)
class EdgeSet:
    """All edges of a sheaf.

    Attributes:
        bundles: The edges, those of equal shapes together.
        column: First column of each vertex in delta, and the number of columns at the end, shape (V + 1,).
    """

    bundles: list[EdgeBundle]
    column: IntArray

    @cached_property
    def ends(self) -> tuple[IntArray, IntArray]:
        """Tail and head of each edge, bundle after bundle, shape (E,)."""
        none = np.zeros(0, dtype=np.int64)
        tail = np.concatenate([none, *(b.tail for b in self.bundles)])
        return tail, np.concatenate([none, *(b.head for b in self.bundles)])

    @cached_property
    def rows(self) -> list[IntArray]:
        """Rows of each edge in delta, shape (k, m), for each bundle."""
        size = np.zeros(sum(len(b.number) for b in self.bundles), dtype=np.int64)
        for b in self.bundles:
            size[b.number] = b.F_tail.shape[1]
        first = firsts_of(size)
        return [first[b.number][:, None] + np.arange(b.F_tail.shape[1]) for b in self.bundles]

    @cached_property
    def delta(self) -> sparse.csr_array:
        """The coboundary, rows by edge order, columns by vertex order, shape (m, n)."""
        matrices = [sparse.csr_array((0, int(self.column[-1])))]
        for b in self.bundles:
            k, m, _ = b.F_tail.shape
            ends = ((b.tail, b.F_tail), (b.head, b.F_head))
            met = np.hstack([self.column[vertex][:, None] + np.arange(F.shape[2]) for vertex, F in ends])
            values = np.concatenate([b.F_tail, -b.F_head], axis=2)
            begin = met.shape[1] * np.arange(k * m + 1)
            kind = np.int32 if values.size < 2**31 else np.int64
            entries = (values.ravel(), np.repeat(met.astype(kind), m, axis=0).ravel(), begin.astype(kind))
            matrices.append(sparse.csr_array(entries, shape=(k * m, matrices[0].shape[1])))
        delta = matrices[-1]
        if len(matrices) != 2:  # else the rows are in order
            delta = sparse.vstack(matrices, format="csr")[np.argsort(np.concatenate([[], *map(np.ravel, self.rows)]))]
        delta.sort_indices()
        return delta

    @cached_property
    def offset(self) -> Array:
        """Desired values b, shape (m,)."""
        b = np.zeros(sum(rows.size for rows in self.rows))
        for rows, bundle in zip(self.rows, self.bundles, strict=True):
            b[rows] = bundle.offset
        return b

    @cached_property
    def whitened(self) -> "EdgeSet":
        """The same edges in edge coordinates in which inner products are the identity; itself where they are."""
        if all(b.weight is None for b in self.bundles):
            return self
        return EdgeSet([b.whitened() for b in self.bundles], self.column)


def merge(bundles: list[EdgeBundle]) -> list[EdgeBundle]:
    """Join bundles of equal shapes, so that later work is one array operation for each shape."""
    alike: dict[tuple[int, ...], list[EdgeBundle]] = defaultdict(list)
    for bundle in bundles:
        alike[(*bundle.F_tail.shape[1:], bundle.F_head.shape[2], bundle.weight is None)].append(bundle)
    joined = []
    for group in alike.values():
        if len(group) > 1:
            columns: Any = ([getattr(bundle, one.name) for bundle in group] for one in fields(EdgeBundle))
            arrays: list[Any] = [None if column[0] is None else np.concatenate(column) for column in columns]
            group = [EdgeBundle(*arrays)]
        joined += group
    return joined


def ranges(begin: IntArray, length: IntArray) -> IntArray:
    """Return the numbers from begin[k] up to begin[k] + length[k], range after range."""
    return np.repeat(begin - firsts_of(length), length) + np.arange(length.sum())


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
    for F, name, vertices, numbers in (
        (F_tail, "tail", ends.tails, ends.tail),
        (F_head, "head", ends.heads, ends.head),
    ):
        if F.ndim != 3 or F.shape[0] != k:
            raise SheafError(f"maps of the {name}s have shape {F.shape}; expected ({k}, m, n)")
        wrong = np.flatnonzero(dimension[numbers] != F.shape[2])
        if wrong.size:
            e = wrong[0]
            n = dimension[numbers[e]]
            raise SheafError(
                f"{ends.name(e)}: the map of {name} {vertices[e]!r} has shape {F.shape[1:]}, "
                f"but the stalk has dimension {n}; expected (m, {n})"
            )
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
    return EdgeBundle(ends.tail, ends.head, F_tail.copy(), F_head.copy(), offset, weight, number)


def _checked_weights(K: Any, ends: Ends, m: int) -> Array:
    """Return inner products (k, m, m), given as such or as positive numbers (k,)."""
    k = len(ends.tail)
    weight = np.array(finite(K, "weight", ends))
    if weight.shape == (k,):
        weight = weight[:, None, None] * np.eye(m)
    if weight.shape != (k, m, m):
        raise SheafError(f"weight has shape {weight.shape}; expected ({k}, {m}, {m}) or ({k},)")
    scale = np.abs(weight).max(axis=(1, 2), initial=0.0)
    asymmetry = np.abs(weight - weight.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
    smallest = np.linalg.eigvalsh(weight).min(axis=1, initial=np.inf)
    bad = np.flatnonzero((asymmetry > 1e-12 * scale) | ~(smallest > 1e-14 * scale))
    if bad.size:
        raise SheafError(
            f"{ends.name(bad[0])}: the weight is not symmetric positive definite "
            f"(smallest eigenvalue {smallest[bad[0]]:.3g}, asymmetry {asymmetry[bad[0]]:.3g})"
        )
    return weight


def finite(x: Any, name: str, ends: Ends | None = None) -> Array:
    """An array of finite numbers, not a copy, or a SheafError that names it and, with one entry an edge, the edge."""
    try:
        array = np.asarray(x, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SheafError(f"{name}: not an array of numbers of equal row lengths") from None
    if not np.isfinite(array).all():
        known = ends is not None and array.ndim > 0 and len(array) == len(ends.tail)
        edge = f"{ends.name(np.argwhere(~np.isfinite(array))[0, 0])}: " if ends is not None and known else ""
        raise SheafError(f"{edge}{name}: an entry is not finite")
    return array


Cochain = Array | Mapping[Hashable, ArrayLike]


class Cochains:
    """The stalks R^{n_v} of the vertices of a sheaf; n = sum n_v."""

    def __init__(self, stalks: Mapping[Any, int]) -> None:
        """Make the stalks; see `Sheaf`."""
        if not stalks:
            raise SheafError("a sheaf needs at least one vertex")
        kinds = set(map(type, stalks.values()))  # types are compared once, as stalks may be many
        odd = {kind for kind in kinds if kind is bool or not issubclass(kind, int | np.integer)}
        if odd or min(stalks.values()) < 0:
            vertex, dimension = next((v, d) for v, d in stalks.items() if type(d) in odd or d < 0)
            raise SheafError(f"stalk of vertex {vertex!r}: dimension {dimension!r}; expected a whole number >= 0")
        self._dimension = np.fromiter(stalks.values(), np.int64, len(stalks))
        self._number = {vertex: i for i, vertex in enumerate(stalks)}
        self._column = np.concatenate([[0], np.cumsum(self._dimension)])

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

    def numbers(self, vertices: Sequence[Hashable]) -> IntArray:
        """Numbers of the given vertices, counted from 0 in vertex order."""
        try:
            return np.fromiter(map(self._number.__getitem__, vertices), np.int64, len(vertices))
        except (KeyError, TypeError):
            return np.array([self._find(v) for v in vertices], dtype=np.int64)

    def columns(self, vertices: Iterable[Hashable]) -> IntArray:
        """Columns of the coboundary that belong to the given vertices, in the given order."""
        return self.columns_of(self.numbers(list(vertices)))

    def columns_of(self, numbers: IntArray) -> IntArray:
        """The same for vertices given by number."""
        return ranges(self._column[numbers], self._dimension[numbers])

    def interior(self, boundary: Iterable[Hashable]) -> list[Hashable]:
        """The vertices that are not in the boundary, in vertex order."""
        return list(itertools.compress(self._number, self.free(list(boundary)).tolist()))

    def free(self, boundary: Sequence[Hashable]) -> BoolArray:
        """Return a mask of the vertices that are not in the boundary, shape (V,)."""
        free = np.ones(len(self._number), dtype=bool)
        free[self.numbers(boundary)] = False
        return free

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
        value = np.array(finite(x, "0-cochain"))
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
