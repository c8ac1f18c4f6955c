"""The cellular sheaf on a graph."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse import linalg as splinalg

from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import EdgeBundle, coboundary_matrix, merge
from mjsheaf.sheaf.kernel import DENSE_COLUMNS, RANK_TOLERANCE, kernel_basis

if TYPE_CHECKING:
    from mjsheaf.sheaf.dirichlet import HarmonicExtension

Array = NDArray[np.float64]
Cochain = Array | Mapping[Hashable, ArrayLike]


class Sheaf:
    """A cellular sheaf on a graph, with inner products and desired values on its edges.

    Vertex v has the stalk R^{n_v}; an edge e = (i, j) has the stalk R^{m_e} and restriction maps F_{i,e} (m_e, n_i)
    and F_{j,e} (m_e, n_j). The coboundary is (delta x)_e = F_{i,e} x_i - F_{j,e} x_j. An edge may also carry a desired
    value b_e of that difference (`offset`) and an inner product K_e on its stalk (`weight`, symmetric positive
    definite). Parallel edges are legal, loops are not.

    0-cochains are vectors of length n = sum n_v in vertex order, or mappings from vertex to value; 1-cochains are
    vectors of length m = sum m_e in the order in which edges were added.
    """

    def __init__(self, stalks: Mapping[Any, int]) -> None:
        """Make a sheaf without edges.

        Args:
            stalks: dimension of each vertex stalk, in order.

        Raises:
            SheafError: a dimension is not a non-negative integer, or there is no vertex.
        """
        if not stalks:
            raise SheafError("a sheaf needs at least one vertex")
        for vertex, dimension in stalks.items():
            if isinstance(dimension, bool) or not isinstance(dimension, int | np.integer) or dimension < 0:
                raise SheafError(f"stalk of vertex {vertex!r}: dimension {dimension!r} is not a whole number >= 0")
        self._dimension = np.array(list(stalks.values()), dtype=np.int64)
        self._number = {vertex: i for i, vertex in enumerate(stalks)}
        self._column = np.concatenate([[0], np.cumsum(self._dimension)])
        self._bundles: list[EdgeBundle] = []
        self._rows = 0
        self._edges = 0

    # -- structure ---------------------------------------------------------------------------------------------

    @property
    def vertices(self) -> list[Hashable]:
        """The vertices, in order."""
        return list(self._number)

    @property
    def number_of_edges(self) -> int:
        """How many edges have been added, parallel ones counted apart."""
        return self._edges

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (m, n) of the coboundary."""
        return self._rows, int(self._column[-1])

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

    def columns(self, vertices: Iterable[Hashable]) -> NDArray[np.int64]:
        """Columns of the coboundary that belong to the given vertices, in the given order."""
        numbers = [self._find(v) for v in vertices]
        if not numbers:
            return np.zeros(0, dtype=np.int64)
        return np.concatenate([np.arange(self._column[i], self._column[i + 1]) for i in numbers])

    # -- building ----------------------------------------------------------------------------------------------

    def add_edge(
        self,
        tail: Hashable,
        head: Hashable,
        F_tail: ArrayLike,
        F_head: ArrayLike,
        *,
        offset: ArrayLike | None = None,
        weight: ArrayLike | None = None,
    ) -> int:
        """Add the edge (tail, head); see `add_edges`.

        Args:
            tail, head: its vertices.
            F_tail, F_head: restriction maps, shapes (m, n_tail) and (m, n_head).
            offset: desired value b of F_tail x_tail - F_head x_head, shape (m,); zero unless given.
            weight: inner product K of the edge stalk, shape (m, m), or a positive number times the identity.

        Returns:
            The number of the edge, counted from 0.

        Raises:
            SheafError: unknown vertex, loop, wrong shape, non-finite entry, or a weight that is not SPD.
        """

        def one(x: ArrayLike | None) -> Array | None:
            return None if x is None else _finite(x, f"edge ({tail!r}, {head!r})")[None]

        return self.add_edges([tail], [head], one(F_tail), one(F_head), offset=one(offset), weight=one(weight))[0]

    def add_edges(
        self,
        tails: Sequence[Hashable],
        heads: Sequence[Hashable],
        F_tails: Any,
        F_heads: Any,
        *,
        offset: Any = None,
        weight: Any = None,
    ) -> range:
        """Add k edges of equal stalk dimensions at once.

        Args:
            tails, heads: k vertices each.
            F_tails, F_heads: restriction maps, shapes (k, m, n_tail) and (k, m, n_head).
            offset: desired values, shape (k, m); zero unless given.
            weight: inner products, shape (k, m, m), or positive numbers of shape (k,) times the identity.

        Returns:
            The numbers of the edges.

        Raises:
            SheafError: unknown vertex, loop, wrong shape, non-finite entry, or a weight that is not SPD. Nothing
                is added then.
        """
        k = len(tails)
        if len(heads) != k:
            raise SheafError(f"{k} tails but {len(heads)} heads: each edge needs one of both")
        number = np.arange(self._edges, self._edges + k)
        tail = np.array([self._find(v) for v in tails], dtype=np.int64)
        head = np.array([self._find(v) for v in heads], dtype=np.int64)
        loops = np.flatnonzero(tail == head)
        if loops.size:
            raise SheafError(f"edge ({tails[loops[0]]!r}, {heads[loops[0]]!r}) is a loop; its ends must differ")

        F_tail, F_head = _finite(F_tails, "F_tail"), _finite(F_heads, "F_head")
        for name, F, vertices, at in (("tail", F_tail, tails, tail), ("head", F_head, heads, head)):
            if F.ndim != 3 or F.shape[0] != k:
                raise SheafError(f"maps of the {name}s have shape {F.shape}; legal is ({k}, m, n)")
            wrong = np.flatnonzero(self._dimension[at] != F.shape[2])
            if wrong.size:
                e = wrong[0]
                raise SheafError(
                    f"edge ({tails[e]!r}, {heads[e]!r}): the map of {name} {vertices[e]!r} has shape "
                    f"{F.shape[1:]}, but the stalk has dimension {self._dimension[at[e]]}; "
                    f"legal is (m, {self._dimension[at[e]]})"
                )
        m = F_tail.shape[1]
        if F_head.shape[1] != m:
            raise SheafError(
                f"edge ({tails[0]!r}, {heads[0]!r}): the maps have {m} and {F_head.shape[1]} rows; "
                "both must map to the same edge stalk"
            )
        b = np.zeros((k, m)) if offset is None else _finite(offset, "offset")
        if b.shape != (k, m):
            raise SheafError(f"offset has shape {b.shape}; legal is ({k}, {m})")
        K = None if weight is None else self._inner_products(weight, k, m, tails, heads)

        row = self._rows + m * np.arange(k)
        self._bundles.append(EdgeBundle(tail, head, F_tail, F_head, b, K, row))
        self._rows += m * k
        self._edges += k
        self.__dict__.pop("_merged", None)
        return range(int(number[0]), int(number[-1]) + 1) if k else range(0)

    @staticmethod
    def _inner_products(weight: Any, k: int, m: int, tails: Sequence, heads: Sequence) -> Array:
        K = _finite(weight, "weight")
        if K.shape == (k,):
            K = K[:, None, None] * np.eye(m)
        if K.shape != (k, m, m):
            raise SheafError(f"weight has shape {K.shape}; legal is ({k}, {m}, {m}) or ({k},)")
        scale = np.abs(K).max(axis=(1, 2), initial=0.0)
        asymmetry = np.abs(K - K.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
        smallest = np.linalg.eigvalsh(K).min(axis=1, initial=np.inf)
        bad = np.flatnonzero((asymmetry > 1e-12 * scale) | ~(smallest > 1e-14 * scale))
        if bad.size:
            e = bad[0]
            raise SheafError(
                f"edge ({tails[e]!r}, {heads[e]!r}): the weight is not symmetric positive definite "
                f"(smallest eigenvalue {smallest[e]:.3g}, asymmetry {asymmetry[e]:.3g})"
            )
        return K

    # -- operators ---------------------------------------------------------------------------------------------

    @cached_property
    def _merged(self) -> list[EdgeBundle]:
        return merge(self._bundles)

    def coboundary(self) -> sparse.csr_array:
        """delta, shape (m, n): rows by edge order, columns by vertex order."""
        return coboundary_matrix(self._merged, *self._matrix_layout())

    def whitened_coboundary(self) -> sparse.csr_array:
        """K^{1/2} delta, whose Gram matrix is the Laplacian, shape (m, n)."""
        return coboundary_matrix([b.whitened() for b in self._merged], *self._matrix_layout())

    def _matrix_layout(self) -> tuple[int, NDArray[np.int64], int]:
        return self._rows, self._column[:-1], int(self._column[-1])

    def offset(self) -> Array:
        """Desired values b as a 1-cochain, shape (m,)."""
        return self._gather_offsets(self._merged)

    def whitened_offset(self) -> Array:
        """K^{1/2} b in the edge coordinates of `whitened_coboundary`, shape (m,)."""
        return self._gather_offsets([b.whitened() for b in self._merged])

    def _gather_offsets(self, bundles: list[EdgeBundle]) -> Array:
        b = np.zeros(self._rows)
        for bundle in bundles:
            b[bundle.row[:, None] + np.arange(bundle.shape[0])] = bundle.offset
        return b

    def laplacian(self) -> sparse.csr_array:
        """The sheaf Laplacian L = delta^T K delta, shape (n, n), symmetric positive semi-definite."""
        D = self.whitened_coboundary()
        return (D.T @ D).tocsr()

    def dirichlet_energy(self, x: Cochain) -> float:
        """Half the squared K-norm of the residual delta x - b."""
        residual = self.whitened_coboundary() @ self.pack(x) - self.whitened_offset()
        return 0.5 * float(residual @ residual)

    # -- cohomology --------------------------------------------------------------------------------------------

    def betti(self, *, rtol: float = RANK_TOLERANCE) -> tuple[int, int]:
        """Dimensions of H^0 = ker delta and H^1 = coker delta.

        Args:
            rtol: a singular value of delta at most rtol times the largest counts as zero.
        """
        m, n = self.shape
        h0 = self.global_sections(rtol=rtol).shape[1]
        return h0, m - (n - h0)

    def global_sections(self, *, rtol: float = RANK_TOLERANCE) -> Array:
        """Orthonormal basis of H^0(G; F) = ker delta, shape (n, h0)."""
        return kernel_basis(self.coboundary(), rtol)

    def relative_sections(self, boundary: Iterable[Hashable], *, rtol: float = RANK_TOLERANCE) -> Array:
        """Orthonormal basis of H^0(G, U; F): sections that vanish on the boundary U.

        Args:
            boundary: the vertices U.
            rtol: relative tolerance, as in `betti`.

        Returns:
            Array of shape (n_W, dimension), rows by the other vertices W in vertex order.
        """
        return kernel_basis(self.coboundary()[:, self.columns(self.interior(boundary))], rtol)

    def interior(self, boundary: Iterable[Hashable]) -> list[Hashable]:
        """The vertices that are not in the boundary, in vertex order."""
        pinned = {self._find(v) for v in boundary}
        return [v for v, i in self._number.items() if i not in pinned]

    def harmonic_extension(self, boundary: Mapping[Any, ArrayLike]) -> "HarmonicExtension":
        """The 0-cochain of least Dirichlet energy with the given boundary values.

        Args:
            boundary: value of each boundary vertex.

        Returns:
            The extension; where it is not unique, the one of minimum norm, with the basis of what is free.
        """
        from mjsheaf.sheaf.dirichlet import DirichletProblem

        return DirichletProblem(self, list(boundary)).harmonic_extension(boundary)

    def nearest_global_section(self, x: Cochain) -> Any:
        """Orthogonal projection of a 0-cochain on H^0; a mapping gives a mapping, a vector a vector."""
        value = self.pack(x)
        delta = self.coboundary()
        if delta.shape[1] <= DENSE_COLUMNS:
            sections = self.global_sections()
            section = sections @ (sections.T @ value)
        else:  # the minimum-norm correction d with delta d = delta x
            section = value - splinalg.lsmr(delta, delta @ value, atol=1e-14, btol=1e-14, maxiter=10**6)[0]
        return self.unpack(section) if isinstance(x, Mapping) else section

    # -- cochains ----------------------------------------------------------------------------------------------

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
        value = _finite(x, "0-cochain")
        if value.shape != (self._column[-1],):
            raise SheafError(f"a 0-cochain has shape ({self._column[-1]},); this one has {value.shape}")
        return value

    def unpack(self, x: Array) -> dict[Hashable, Array]:
        """A vector of length n as a mapping from vertex to value."""
        return {v: x[self._column[i] : self._column[i + 1]] for v, i in self._number.items()}

    def stalk_value(self, vertex: Hashable, value: ArrayLike) -> Array:
        """A value in the stalk of a vertex, checked."""
        x = np.atleast_1d(_finite(value, f"value of vertex {vertex!r}"))
        if x.shape != (self.dimension(vertex),):
            raise SheafError(f"value of vertex {vertex!r} has shape {x.shape}; legal is ({self.dimension(vertex)},)")
        return x


def _finite(x: Any, name: str) -> Array:
    try:
        array = np.array(x, dtype=np.float64)  # a copy: later changes by the caller do not reach the sheaf
    except (TypeError, ValueError):
        raise SheafError(f"{name}: not an array of numbers of equal row lengths") from None
    if not np.isfinite(array).all():
        raise SheafError(f"{name}: an entry is not finite")
    return array
