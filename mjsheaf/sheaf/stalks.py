"""The vertex stalks of a sheaf: their names, their numbers, their columns, and cochains on them."""

import itertools
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjsheaf.errors import SheafError
from mjsheaf.sheaf.building import finite

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Cochain = Array | Mapping[Hashable, ArrayLike]


class Stalks:
    """Vertices in order, with a stalk R^{n_v} each.

    0-cochains are vectors of length n = sum n_v in vertex order, or mappings from vertex to value.
    """

    def __init__(self, stalks: Mapping[Any, int]) -> None:
        """Number the vertices.

        Args:
            stalks: dimension of each vertex stalk, in order.

        Raises:
            SheafError: a dimension is not a non-negative integer, or there is no vertex.
        """
        if not stalks:
            raise SheafError("a sheaf needs at least one vertex")
        odd = {
            kind for kind in set(map(type, stalks.values())) if kind is bool or not issubclass(kind, int | np.integer)
        }
        if odd or min(stalks.values()) < 0:
            vertex, dimension = next((v, d) for v, d in stalks.items() if type(d) in odd or d < 0)
            raise SheafError(f"stalk of vertex {vertex!r}: dimension {dimension!r} is not a whole number >= 0")
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
