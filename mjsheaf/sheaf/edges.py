"""The edges of a sheaf: bundles that were added together, and the coboundary of all of them as a sparse matrix."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.errors import SheafError


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

    @property
    def size(self) -> int:
        """Dimension m of the edge stalks."""
        return self.F_tail.shape[1]

    def selected(self, chosen: BoolArray, vertex: IntArray, number: IntArray) -> "EdgeBundle":
        """Select edges by a mask (k,), with new numbers of all vertices (V,) and edges (E,)."""
        return EdgeBundle(
            vertex[self.tail[chosen]],
            vertex[self.head[chosen]],
            self.F_tail[chosen],
            self.F_head[chosen],
            self.offset[chosen],
            None if self.weight is None else self.weight[chosen],
            number[self.number[chosen]],
        )

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
            size[b.number] = b.size
        first = np.cumsum(size) - size
        return [first[b.number][:, None] + np.arange(b.size) for b in self.bundles]

    @cached_property
    def delta(self) -> sparse.csr_array:
        """The coboundary, rows by edge order, columns by vertex order, shape (m, n)."""
        width = np.zeros(sum(rows.size for rows in self.rows), dtype=np.int64)
        for b, rows in zip(self.bundles, self.rows, strict=True):
            width[rows] = b.F_tail.shape[2] + b.F_head.shape[2]
        end = np.cumsum(width)
        entries = int(width.sum())
        kind = np.int32 if entries < 2**31 else np.int64
        indices = np.empty(entries, dtype=kind)
        values = np.empty(entries)
        for b, rows in zip(self.bundles, self.rows, strict=True):
            begin = end[rows] - width[rows]
            for vertex, F in ((b.tail, b.F_tail), (b.head, -b.F_head)):
                at = begin[:, :, None] + np.arange(F.shape[2])
                values[at] = F
                indices[at] = self.column[vertex][:, None, None] + np.arange(F.shape[2])
                begin = begin + F.shape[2]
        indptr = np.concatenate([[0], end]).astype(kind)
        delta = sparse.csr_array((values, indices, indptr), shape=(len(width), int(self.column[-1])))
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
        np.concatenate([b.number for b in group]),
    )


def ranges(begin: IntArray, length: IntArray) -> IntArray:
    """Return the numbers from begin[k] up to begin[k] + length[k], range after range."""
    return np.repeat(begin - np.cumsum(length) + length, length) + np.arange(length.sum())


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
    return EdgeBundle(ends.tail, ends.head, F_tail.copy(), F_head.copy(), offset, weight, number)


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
