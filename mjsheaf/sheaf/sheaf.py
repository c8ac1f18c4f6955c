"""The cellular sheaf on a graph."""

from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse import linalg as splinalg

from mjsheaf.errors import SheafError
from mjsheaf.sheaf.assembly import coboundary_matrix, laplacian_block
from mjsheaf.sheaf.building import checked_bundle, finite
from mjsheaf.sheaf.edges import EdgeBundle, EdgeTable, adjoint_product, merge, product, tabulate
from mjsheaf.sheaf.kernel import DENSE_COLUMNS, RANK_TOLERANCE
from mjsheaf.sheaf.sections import proved_sections, section_basis
from mjsheaf.sheaf.stalks import Cochain, Stalks

if TYPE_CHECKING:
    from mjsheaf.sheaf.dirichlet import HarmonicExtension

Array = NDArray[np.float64]


class Sheaf(Stalks):
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
        super().__init__(stalks)
        self._bundles: list[EdgeBundle] = []
        self._rows = 0
        self._edges = 0

    # -- structure ---------------------------------------------------------------------------------------------

    @property
    def number_of_edges(self) -> int:
        """How many edges have been added, parallel ones counted apart."""
        return self._edges

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (m, n) of the coboundary."""
        return self._rows, int(self._column[-1])

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
            return None if x is None else finite(x, f"edge ({tail!r}, {head!r})")[None]

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
        if len(heads) != len(tails):
            raise SheafError(f"{len(tails)} tails but {len(heads)} heads: each edge needs one of both")
        i, j = self.numbers(tails), self.numbers(heads)
        return self._append(
            [checked_bundle(tails, heads, i, j, self._dimension, F_tails, F_heads, offset, weight, self._rows)]
        )

    def add_mixed_edges(
        self,
        tails: Sequence[Hashable],
        heads: Sequence[Hashable],
        F_tails: Sequence[ArrayLike],
        F_heads: Sequence[ArrayLike],
        *,
        offset: Sequence[ArrayLike] | None = None,
        weight: Sequence[ArrayLike] | None = None,
    ) -> range:
        """Add k edges at once whose stalks need not have equal dimensions; rows and numbers in the order given.

        Args:
            tails, heads: k vertices each.
            F_tails, F_heads: k restriction maps each, of shapes (m, n_tail) and (m, n_head).
            offset: k desired values of shape (m,); zero unless given.
            weight: k inner products of shape (m, m), or positive numbers times the identity.

        Returns:
            The numbers of the edges.

        Raises:
            SheafError: as `add_edges`. Nothing is added then.
        """
        given = [x for x in (F_tails, F_heads, offset, weight) if x is not None]
        if any(len(x) != len(tails) for x in (heads, *given)):
            raise SheafError(
                f"{len(tails)} tails: each edge needs a head and two maps, and where any has them, b and K"
            )
        i, j = self.numbers(tails), self.numbers(heads)
        alike: dict[Any, list[int]] = defaultdict(list)
        for e, shapes in enumerate(zip(*(map(np.shape, x) for x in given), strict=True)):
            alike[shapes].append(e)
        size = np.array([shape[0] if shape else 0 for shape in map(np.shape, F_tails)], dtype=np.int64)
        row = self._rows + np.cumsum(size) - size
        bundles = []
        for edges in alike.values():

            def of(x: Any, edges: list[int] = edges) -> Any:
                return None if x is None else [x[e] for e in edges]

            ends = of(tails), of(heads), i[edges], j[edges]
            bundles.append(
                checked_bundle(*ends, self._dimension, of(F_tails), of(F_heads), of(offset), of(weight), row[edges])
            )
        return self._append(bundles)

    def _append(self, bundles: list[EdgeBundle]) -> range:
        first = self._edges
        for bundle in bundles:
            self._bundles.append(bundle)
            self._rows += len(bundle.tail) * bundle.shape[0]
            self._edges += len(bundle.tail)
        for name in ("_merged", "table", "whitened_table"):
            self.__dict__.pop(name, None)
        return range(first, self._edges)

    # -- operators ---------------------------------------------------------------------------------------------

    @cached_property
    def _merged(self) -> list[EdgeBundle]:
        return merge(self._bundles)

    @cached_property
    def table(self) -> EdgeTable:
        """All edges as the compiled loops walk them, without inner products."""
        return tabulate(self._merged, self._column)

    @cached_property
    def whitened_table(self) -> EdgeTable:
        """All edges in edge coordinates in which inner products are the identity."""
        if not self._weighted:
            return self.table
        return tabulate([b.whitened() for b in self._merged], self._column)

    @property
    def _weighted(self) -> bool:
        return any(b.weight is not None for b in self._bundles)

    def coboundary(self) -> sparse.csr_array:
        """delta, shape (m, n): rows by edge order, columns by vertex order."""
        return coboundary_matrix(self.table)

    def coboundary_operator(self) -> splinalg.LinearOperator:
        """delta without its matrix, shape (m, n): `A @ x` is delta x, `A.T @ y` is delta^T y, for one vector or many.

        It reads the maps that the sheaf holds. Edges added later are not in it.
        """
        t = self.table
        return splinalg.LinearOperator(
            self.shape,
            matvec=lambda x: product(t, x.reshape(-1, 1)).reshape(-1),
            rmatvec=lambda y: adjoint_product(t, y.reshape(-1, 1)).reshape(-1),
            matmat=lambda x: product(t, x),
            rmatmat=lambda y: adjoint_product(t, y),
            dtype=np.dtype(np.float64),
        )

    def whitened_coboundary(self) -> sparse.csr_array:
        """K^{1/2} delta, whose Gram matrix is the Laplacian, shape (m, n)."""
        return coboundary_matrix(self.whitened_table)

    def offset(self) -> Array:
        """Desired values b as a 1-cochain, shape (m,)."""
        return self._gather_offsets(self._merged)

    def whitened_offset(self) -> Array:
        """K^{1/2} b in the edge coordinates of `whitened_coboundary`, shape (m,)."""
        return self._gather_offsets([b.whitened() for b in self._merged] if self._weighted else self._merged)

    def _gather_offsets(self, bundles: list[EdgeBundle]) -> Array:
        b = np.zeros(self._rows)
        for bundle in bundles:
            if bundle.offset.any():
                b[bundle.row[:, None] + np.arange(bundle.shape[0])] = bundle.offset
        return b

    def laplacian(self) -> sparse.csr_array:
        """The sheaf Laplacian L = delta^T K delta, shape (n, n), symmetric positive semi-definite."""
        every = np.arange(len(self._dimension))
        return laplacian_block(self.whitened_table, every, every)

    def dirichlet_energy(self, x: Cochain) -> float:
        """Half the squared K-norm of the residual delta x - b."""
        residual = product(self.whitened_table, self.pack(x)[:, None])[:, 0] - self.whitened_offset()
        return 0.5 * float(np.einsum("i,i->", residual, residual))  # a BLAS product depends on the number of threads

    # -- cohomology --------------------------------------------------------------------------------------------

    def betti(self, *, rtol: float = RANK_TOLERANCE) -> tuple[int, int]:
        """Dimensions of H^0 = ker delta and H^1 = coker delta.

        Args:
            rtol: a singular value of delta at most rtol times the largest counts as zero.
        """
        m, n = self.shape
        h0 = self._sections([], rtol).shape[1]
        return h0, m - (n - h0)

    def global_sections(self, *, rtol: float = RANK_TOLERANCE) -> Array:
        """Orthonormal basis of H^0(G; F) = ker delta, shape (n, h0)."""
        return self._sections([], rtol).toarray()

    def _sections(self, boundary: Sequence[Hashable], rtol: float) -> sparse.csc_array:
        free = np.ones(len(self._dimension), dtype=bool)
        free[self.numbers(boundary)] = False
        return section_basis(self.table, free, rtol)

    def relative_sections(self, boundary: Iterable[Hashable], *, rtol: float = RANK_TOLERANCE) -> Array:
        """Orthonormal basis of H^0(G, U; F): sections that vanish on the boundary U.

        Args:
            boundary: the vertices U.
            rtol: relative tolerance, as in `betti`.

        Returns:
            Array of shape (n_W, dimension), rows by the other vertices W in vertex order.
        """
        return self._sections(list(boundary), rtol).toarray()

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
        every = np.ones(len(self._dimension), dtype=bool)
        found, left = proved_sections(self.table, every, RANK_TOLERANCE)
        if left.any() and len(value) > DENSE_COLUMNS:  # the minimum-norm correction d with delta d = delta x
            delta = self.coboundary()
            section = value - splinalg.lsmr(delta, delta @ value, atol=1e-14, btol=1e-14, maxiter=10**6)[0]
        elif left.any():
            sections = section_basis(self.table, every, RANK_TOLERANCE)
            section = sections @ (sections.T @ value)
        else:
            section = np.zeros_like(value)
            for place, basis in found:
                section[place] = basis @ (basis.T @ value[place])
        return self.unpack(section) if isinstance(x, Mapping) else section
