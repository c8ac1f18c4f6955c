"""0-cochains of a sheaf: a value in the stalk of each vertex, and the inner products of stalks."""

import itertools
from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.errors import SheafError
from mjsheaf.sheaf.blocks import InnerProduct
from mjsheaf.sheaf.edges import finite, ranges, require_positive_definite

Cochain = Array | Mapping[Hashable, ArrayLike]


def _require_dimensions(stalks: Mapping[Any, int]) -> None:
    """Refuse a stalk whose dimension is not a whole number >= 0; types are compared once, as stalks may be many."""
    kinds = set(map(type, stalks.values()))
    odd = {kind for kind in kinds if kind is bool or not issubclass(kind, int | np.integer)}
    if odd or min(stalks.values()) < 0:
        vertex, dimension = next((v, d) for v, d in stalks.items() if type(d) in odd or d < 0)
        raise SheafError(f"stalk of vertex {vertex!r}: dimension {dimension!r}; expected a whole number >= 0")


class Cochains:
    """The stalks R^{n_v} of the vertices of a sheaf, with inner products M_v; n = sum n_v."""

    def __init__(self, stalks: Mapping[Any, int], *, inner_products: Mapping[Any, ArrayLike] | None = None) -> None:
        """Make the stalks; see `Sheaf`."""
        if not stalks:
            raise SheafError("a sheaf needs at least one vertex")
        _require_dimensions(stalks)
        self._dimension = np.fromiter(stalks.values(), np.int64, len(stalks))
        self._number = {vertex: i for i, vertex in enumerate(stalks)}
        self._column = np.concatenate([[0], np.cumsum(self._dimension)])
        self._products: dict[int, Array] = {}
        for vertex, M in (inner_products or {}).items():
            self.set_inner_product(vertex, M)

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

    def set_inner_product(self, vertex: Hashable, M: ArrayLike) -> None:
        """Give a vertex stalk the inner product M, SPD (n_v, n_v) or a positive number times I, instead of its own.

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
    def vertex_product(self) -> InnerProduct | None:
        """The inner product M of C^0; None where it is the identity."""
        alike: dict[int, list[int]] = defaultdict(list)
        for v, M in self._products.items():
            alike[len(M)].append(v)
        blocks = [(self._column[v], np.stack([self._products[k] for k in v])) for v in alike.values()]
        return InnerProduct.of_blocks(blocks, int(self._column[-1])) if blocks else None
