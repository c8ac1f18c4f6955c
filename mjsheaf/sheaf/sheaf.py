"""The cellular sheaf on a graph: stalks, edges, inner products, its operators and its cohomology."""

from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse import linalg as splinalg

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import (
    Cochain,
    Cochains,
    EdgeBundle,
    EdgeSet,
    Ends,
    InnerProduct,
    checked_bundle,
    finite,
    merge,
)
from mjsheaf.sheaf.harmonic import DirichletProblem, HarmonicExtension, energy_of, gram
from mjsheaf.sheaf.sections import DENSE_COLUMNS, RANK_TOLERANCE, certified_sections, cokernel_basis, section_basis


class Sheaf(Cochains):
    """Cellular sheaf on a graph, with inner products on its stalks and desired values on its edges.

    Vertex v has the stalk R^{n_v}; an edge e = (i, j) has the stalk R^{m_e} and restriction maps F_{i,e} (m_e, n_i)
    and F_{j,e} (m_e, n_j). The coboundary is (delta x)_e = F_{i,e} x_i - F_{j,e} x_j. An edge may also carry a desired
    value b_e of that difference (`offset`) and an inner product K_e on its stalk (`weight`, symmetric positive
    definite). Parallel edges may be added, loops not.

    A vertex stalk has the inner product M_v (`inner_products`), by default the identity. It defines lengths and angles
    of 0-cochains, and so the adjoint delta^* = M^-1 delta^T K, the Laplacian delta^* delta, orthonormal bases of
    sections, the nearest section, and the harmonic extension of minimum norm. Null spaces, Betti numbers, Dirichlet
    energies and the set of harmonic extensions do not depend on it. Neither does the tolerance of ranks, which applies
    to delta in the given coordinates.

    0-cochains are vectors of length n = sum n_v in vertex order, or mappings from vertex to value; 1-cochains are
    vectors of length m = sum m_e in the order in which edges were added.
    """

    def __init__(self, stalks: Mapping[Any, int], *, inner_products: Mapping[Any, ArrayLike] | None = None) -> None:
        """Make a sheaf without edges.

        Args:
            stalks: dimension of each vertex stalk, in order.
            inner_products: M_v of some vertices, see `set_inner_product`; the identity unless given.

        Raises:
            SheafError: a dimension is not a non-negative integer, there is no vertex, or as `set_inner_product`.
        """
        super().__init__(stalks, inner_products=inner_products)
        self._bundles: list[EdgeBundle] = []
        self._edges = 0

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"Sheaf({len(self.vertices)} vertices and {self._edges} edges; dim C^0 = {columns}, dim C^1 = {rows})"

    @cached_property
    def edge_product(self) -> InnerProduct | None:
        """The inner product K of C^1; None where it is the identity."""
        edges = zip(self.edges.rows, self.edges.bundles, strict=True)
        blocks = [(rows[:, 0], b.weight) for rows, b in edges if b.weight is not None]
        return InnerProduct.of_blocks(blocks, self.shape[0]) if blocks else None

    @property
    def number_of_edges(self) -> int:
        """Number of edges, counting parallel edges separately."""
        return self._edges

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (m, n) of the coboundary."""
        return sum(b.offset.size for b in self._bundles), int(self._column[-1])

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
        """Add the edge (tail, head) and return its number; as `add_edges`, without the first axis of each array."""

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
        ends = Ends(tails, heads, self.numbers(tails), self.numbers(heads))
        number = self._edges + np.arange(len(tails))
        return self._append([checked_bundle(ends, self._dimension, number, F_tails, F_heads, offset, weight)])

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

        As `add_edges`, with a sequence of k arrays in place of each array.
        """
        arrays = {"F_tail": F_tails, "F_head": F_heads, "b": offset, "K": weight}
        given = {name: x for name, x in arrays.items() if x is not None}
        if any(len(x) != len(tails) for x in (heads, *given.values())):
            raise SheafError(f"{len(tails)} tails: each edge needs a head and two maps, and, where any has it, b and K")
        ends = Ends(tails, heads, self.numbers(tails), self.numbers(heads))
        alike: dict[Any, list[int]] = defaultdict(list)
        for e, shapes in enumerate(zip(*(map(np.shape, x) for x in given.values()), strict=True)):
            alike[shapes].append(e)
        bundles = []
        for edges in alike.values():
            own = {name: [x[e] for e in edges] for name, x in given.items()}
            number = self._edges + np.array(edges)
            bundles.append(checked_bundle(ends.selected(edges), self._dimension, number, **own))
        return self._append(bundles)

    def _append(self, bundles: list[EdgeBundle]) -> range:
        first = self._edges
        self._bundles += bundles
        self._edges += sum(len(b.number) for b in bundles)
        for name in ("edges", "edge_product"):
            self.__dict__.pop(name, None)
        return range(first, self._edges)

    def restricted(self, vertices: Iterable[Hashable], edges: Iterable[int] | None = None) -> "Sheaf":
        """The sheaf over a subgraph G' = (V', E'), with the inner products and offsets that it has there.

        Args:
            vertices: V', in the order that the vertices of the result have.
            edges: numbers of the edges E', whose ends must be in V'; unless given, all edges between vertices of V'.
                In the result edges keep their order and are counted anew.

        Raises:
            SheafError: V' is empty; a vertex is unknown or named twice; an edge is unknown, named twice, or has an end
                outside of V'.
        """
        names = list(vertices)
        at = self.numbers(names)
        if len(set(at.tolist())) != len(at):
            raise SheafError("a vertex of the subgraph is named twice")
        place = np.full(len(self._dimension), -1)
        place[at] = np.arange(len(at))
        kept = np.zeros(self._edges, dtype=bool)
        for b in self._bundles:
            kept[b.number] = (place[b.tail] >= 0) & (place[b.head] >= 0)
        if edges is not None:
            kept = self._chosen(edges, kept)
        number = np.cumsum(kept) - 1
        sheaf = Sheaf(
            dict(zip(names, self._dimension[at].tolist(), strict=True)),
            inner_products={names[place[v]]: M for v, M in self._products.items() if place[v] >= 0},
        )
        sheaf._append([b.selected(kept[b.number], place, number) for b in self._bundles if kept[b.number].any()])
        return sheaf

    def _chosen(self, edges: Iterable[int], inside: BoolArray) -> BoolArray:
        """Return a mask of the given edges, after validation; `inside` marks edges with both ends in the subgraph."""
        chosen = np.zeros(self._edges, dtype=bool)
        for e in edges:
            if isinstance(e, bool) or not isinstance(e, int | np.integer) or not 0 <= e < self._edges:
                raise SheafError(f"unknown edge {e!r}; expected a number from 0 to {self._edges - 1}")
            if chosen[e] or not inside[e]:
                wrong = "is named twice" if chosen[e] else "has an end outside of the subgraph's vertices"
                raise SheafError(f"edge {e} {wrong}")
            chosen[e] = True
        return chosen

    @cached_property
    def edges(self) -> EdgeSet:
        """All edges."""
        return EdgeSet(merge(self._bundles), self._column)

    def coboundary(self) -> sparse.csr_array:
        """delta, shape (m, n): rows by edge order, columns by vertex order."""
        return self.edges.delta.copy()

    def coboundary_operator(self) -> splinalg.LinearOperator:
        """delta without its matrix, shape (m, n), for one vector or many; edges added later are not in it."""
        return splinalg.aslinearoperator(self.edges.delta)

    def whitened_coboundary(self) -> sparse.csr_array:
        """K^{1/2} delta, whose Gram matrix is the Laplacian, shape (m, n)."""
        return self.edges.whitened.delta.copy()

    def adjoint_coboundary(self) -> sparse.csr_array:
        """The adjoint delta^* = M^-1 delta^T K, shape (n, m): <delta x, y>_K = <x, delta^* y>_M."""
        adjoint = self.coboundary().T
        if self.edge_product is not None:
            adjoint = adjoint @ self.edge_product.matrix
        if self.vertex_product is not None:
            adjoint = self.vertex_product.inverse @ adjoint
        return sparse.csr_array(adjoint)

    def offset(self) -> Array:
        """Desired values b as a 1-cochain, shape (m,)."""
        return self.edges.offset.copy()

    def whitened_offset(self) -> Array:
        """K^{1/2} b in the edge coordinates of `whitened_coboundary`, shape (m,)."""
        return self.edges.whitened.offset.copy()

    def laplacian(self) -> sparse.csr_array:
        """The sheaf Laplacian L = delta^* delta = M^-1 delta^T K delta, shape (n, n).

        It is self-adjoint in the inner product M, M L = L^T M, and positive semi-definite there: as a matrix it is
        symmetric where M is the identity.
        """
        form = gram(self.edges.whitened.delta, self.edges.whitened.delta)
        return form if self.vertex_product is None else sparse.csr_array(self.vertex_product.inverse @ form)

    def dirichlet_energy(self, x: Cochain) -> float:
        """Half the squared K-norm of the residual delta x - b."""
        return energy_of(self.edges.whitened, self.pack(x))

    def betti(self, *, rtol: float = RANK_TOLERANCE) -> tuple[int, int]:
        """Dimensions of H^0 = ker delta and H^1 = coker delta.

        A singular value of delta at most rtol times the largest counts as zero.
        """
        m, n = self.shape
        h0 = section_basis(self.edges, self.free([]), rtol).shape[1]
        return h0, m - (n - h0)

    def global_sections(self, *, rtol: float = RANK_TOLERANCE) -> Array:
        """Orthonormal basis of H^0(G; F) = ker delta, shape (n, h0)."""
        return self._orthonormal_sections([], rtol).toarray()

    def _orthonormal_sections(self, boundary: Sequence[Hashable], rtol: float) -> sparse.csc_array:
        """The sections that vanish on the boundary, orthonormal in the inner products of the other vertices."""
        free, M = self.free(boundary), self.vertex_product
        sections = section_basis(self.edges, free, rtol)
        return sections if M is None else M.restricted(self.columns_of(np.flatnonzero(free))).orthonormal(sections)

    def local_sections(
        self, vertices: Iterable[Hashable], edges: Iterable[int] | None = None, *, rtol: float = RANK_TOLERANCE
    ) -> Array:
        """Orthonormal basis of Gamma(G'; F), shape (n_V', dimension): 0-cochains on V' that agree along the edges E'.

        Rows are by the vertices in the order given; vertices, edges and errors as in `restricted`, rtol as in `betti`.
        """
        return self.restricted(vertices, edges).global_sections(rtol=rtol)

    def cohomology_basis(self, *, rtol: float = RANK_TOLERANCE) -> Array:
        """Basis of H^1(G; F) = coker delta by its harmonic representatives, orthonormal in K, shape (m, h1).

        They span ker delta^* = {y: delta^T K y = 0}, the orthogonal complement of im delta: each class of C^1 / im
        delta has one representative there, its shortest.

        Raises:
            SheafError: the basis is too large (see `sections.cokernel_basis`), or its dimension is not decided at this
                tolerance, which is as in `betti`.
        """
        basis = cokernel_basis(self.coboundary(), self.betti(rtol=rtol)[1], rtol)
        K = self.edge_product
        return (basis if K is None else K.orthonormal(sparse.csc_array(K.inverse @ basis))).toarray()

    def relative_sections(self, boundary: Iterable[Hashable], *, rtol: float = RANK_TOLERANCE) -> Array:
        """Orthonormal basis of H^0(G, U; F), sections that vanish on the boundary U, shape (n_W, dimension).

        Rows are by the other vertices W in vertex order; rtol is as in `betti`.
        """
        return self._orthonormal_sections(list(boundary), rtol).toarray()

    def dirichlet_problem(self, boundary: Sequence[Hashable], *, rtol: float = RANK_TOLERANCE) -> DirichletProblem:
        """The problem of extending values on U harmonically, for many of them; edges added later are not in it.

        Boundary vectors are in the order of the given vertices U. Singular values of the coboundary of at most `rtol`
        times the largest count as zero.

        Raises:
            SheafError: a boundary vertex is unknown or named twice.
        """
        return DirichletProblem(self, self.edges, boundary, rtol)

    def harmonic_extension(self, boundary: Mapping[Any, ArrayLike]) -> HarmonicExtension:
        """Return the 0-cochain of least Dirichlet energy with the given values of boundary vertices.

        If it is not unique, the result has minimum norm, and comes with a basis of the free directions.
        """
        return self.dirichlet_problem(list(boundary)).harmonic_extension(boundary)

    def nearest_global_section(self, x: Cochain) -> Any:
        """Orthogonal projection of a 0-cochain on H^0; a mapping gives a mapping, a vector a vector."""
        value, M = self.pack(x), self.vertex_product
        found, left = certified_sections(self.edges, self.free([]), RANK_TOLERANCE)
        if left.any() and len(value) > DENSE_COLUMNS:  # the shortest correction d with delta d = delta x, by U d
            delta = self.coboundary()
            A = delta if M is None else delta @ M.root_inverse
            d = splinalg.lsmr(A, delta @ value, atol=1e-14, btol=1e-14, maxiter=10**6)[0]
            section = value - (d if M is None else M.root_inverse @ d)
        elif M is not None or left.any():
            sections = self._orthonormal_sections([], RANK_TOLERANCE)
            section = sections @ (sections.T @ (value if M is None else M.matrix @ value))
        else:
            section = np.zeros_like(value)
            for place, basis in found:
                section[place] = basis @ (basis.T @ value[place])
        return self.unpack(section) if isinstance(x, Mapping) else section
