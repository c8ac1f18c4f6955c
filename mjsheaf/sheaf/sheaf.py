"""The cellular sheaf on a graph: stalks, edges, operators, cohomology, and harmonic extensions.

A harmonic extension solves the Dirichlet problem of a sheaf, prepared once and solved for many boundary values. H x =
r, H = D^T D on the free vertices, has three solvers:

| solver             | used                                                  | why                                     |
|--------------------|-------------------------------------------------------|-----------------------------------------|
| BandCholesky       | states times bandwidth squared is at most DIRECT_WORK | exact, factors once, then solves many   |
| DenseQR            | H is too badly conditioned, up to DENSE_COLUMNS       | works on D, whose condition is the root |
| ConjugateGradients | the band is too wide                                  | memory in proportion to the sheaf       |

Bandwidths are those after reordering the states (reverse Cuthill-McKee): one for paths and cycles, a side of it for a
grid. LAPACK runs on one thread here, since its bits depend on the number of threads.

Conjugate gradients solve I + U + U^T of which only the strict upper triangle U is stored. The preconditioner is
symmetric successive over-relaxation, M = (I/w + U^T) w (I/w + U) for any 0 < w < 2, which is positive definite. With
Eisenstat's trick (SIAM J. Sci. Stat. Comput. 2, 1981) an iteration costs one pass over U backwards and one forwards, as
much as without a preconditioner: A = (I/w + U^T) + (I/w + U) + (1 - 2/w) I, so that of the product with A between the
two triangular solutions little is left to do.
"""

from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import eigsh

from mjsheaf.arrays import Array, IntArray
from mjsheaf.compile.jit import allocating_jit
from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import (
    Cochain,
    Cochains,
    EdgeBundle,
    EdgeSet,
    Ends,
    assembled,
    checked_bundle,
    finite,
    merge,
    parts,
)
from mjsheaf.sheaf.sections import (
    DENSE_COLUMNS,
    RANK_TOLERANCE,
    cokernel_basis,
    section_basis,
)
from mjsheaf.threads import one_thread

DIRECT_WORK = 5e8
"""Largest states * bandwidth^2 of a direct solution: a tenth of a second, once."""

RESIDUAL = 1e-10
"""Relative residual |r - H x| / |r| that conjugate gradients aim at."""

LARGEST_RESIDUAL = 1e-8
"""Relative residual over which an iterative solution is an error."""

RELAXATION = 1.75
MOST_ITERATIONS = 20_000
_DENSE = 600  # rows up to which eigenvalues are found of a dense matrix


@dataclass(frozen=True)
class HarmonicExtension:
    """Harmonic extension with its free directions.

    Attributes:
        x: Value of every vertex, boundary included.
        unique: True if H^0(G, U; F) = 0.
        null_basis: Orthonormal basis of H^0(G, U; F), shape (n_W, dimension). Any combination may be added to the
            interior values. It has no columns if the extension is unique.
        energy: Dirichlet energy 1/2 |delta x - b|_K^2.
    """

    x: dict[Hashable, Array]
    unique: bool
    null_basis: Array
    energy: float


class DirichletProblem:
    """Minimise 1/2 |delta x - b|_K^2 over the interior, the boundary held.

    The stationary point solves H x_W = B x_U + c, in the paper's symbols (eq. harmonic_equation) with an offset. Blocks
    are assembled on demand, without the whole Laplacian; solving needs none of them.

    Attributes:
        boundary: the vertices U, in the order of boundary vectors.
    """

    def __init__(
        self, stalks: Cochains, edges: EdgeSet, boundary: Sequence[Hashable], rtol: float = RANK_TOLERANCE
    ) -> None:
        """Set up the problem for a boundary; `Sheaf.dirichlet_problem` does this for a sheaf.

        Args:
            stalks: Stalks of the vertices.
            edges: Edges as given; edges added to the sheaf later are not part of the problem.
            boundary: Vertices U of the boundary.
            rtol: Singular values of the coboundary that count as zero, relative to the largest.

        Raises:
            SheafError: A boundary vertex is unknown or named twice.
        """
        if len(set(boundary)) != len(boundary):
            raise SheafError("a boundary vertex is named twice")
        self.boundary = list(boundary)
        self._rtol = rtol
        self._stalks = stalks
        self._plain = edges
        self._edges = edges.whitened
        self._free = stalks.free(self.boundary)
        self._columns_U = stalks.columns_of(stalks.numbers(self.boundary))
        self._columns_W = stalks.columns_of(np.flatnonzero(self._free))

    @cached_property
    def _D(self) -> sparse.csr_array:  # noqa: N802 - the symbol of the module
        return self._edges.delta[:, self._columns_W]

    @cached_property
    def _held(self) -> sparse.csr_array:
        return self._edges.delta[:, self._columns_U]

    @cached_property
    def interior(self) -> list[Hashable]:
        """The vertices W, in vertex order."""
        return self._stalks.interior(self.boundary)

    @cached_property
    def H(self) -> sparse.csr_array:  # noqa: N802 - the paper's symbol
        """L[W, W], shape (n_W, n_W)."""
        return gram(self._D, self._D)

    @cached_property
    def B(self) -> sparse.csr_array:  # noqa: N802 - the paper's symbol
        """-L[W, U], shape (n_W, n_U)."""
        return -gram(self._D, self._held)

    @cached_property
    def c(self) -> Array:
        """(delta^T K b) on W, shape (n_W,)."""
        return np.asarray(self._D.T @ self._edges.offset)

    @cached_property
    def eigenvectors(self) -> tuple[Array, Array]:
        """All eigenvalues of H, ascending, shape (n_W,), and orthonormal eigenvectors; H is made dense."""
        return np.linalg.eigh(self.H.toarray())

    @cached_property
    def eigenvalues(self) -> tuple[float, float]:
        """The smallest eigenvalue of H that belongs to no section of the null space, and the largest; 1 if H = 0."""
        H, free = self.H, self.sparse_null_basis.shape[1]
        if free == H.shape[0]:
            return 1.0, 1.0
        if H.shape[0] <= _DENSE:
            values = self.eigenvectors[0]
            return float(values[free]), float(values[-1])
        start = np.ones(H.shape[0])
        largest = float(eigsh(H, k=1, which="LA", v0=start, return_eigenvectors=False)[0])
        near = eigsh(H.tocsc(), k=1 + free, sigma=-1e-6 * largest, v0=start, return_eigenvectors=False)
        return float(near.max()), largest

    @cached_property
    def sparse_null_basis(self) -> sparse.csc_array:
        """Orthonormal basis of H^0(G, U; F), shape (n_W, dimension); inner products on edges do not change it."""
        return section_basis(self._plain, self._free, self._rtol)

    @cached_property
    def null_basis(self) -> Array:
        """`sparse_null_basis` as a dense array."""
        return self.sparse_null_basis.toarray()

    @property
    def unique(self) -> bool:
        """True if the extension is unique: H^0(G, U; F) = 0, the paper's Assumption on relative cohomology."""
        return self.sparse_null_basis.shape[1] == 0

    @cached_property
    @one_thread
    def solver(self) -> "Solver":
        """The solver of H x = r: a factorisation that is kept, or conjugate gradients; see the module.

        Raises:
            SheafError: over DENSE_COLUMNS states, and H is singular to rounding where its null space says that it is
                not.
        """
        D, H = self._D, gram(self._D, self._D)
        n = H.shape[0]
        order = csgraph.reverse_cuthill_mckee(H, symmetric_mode=True)
        place = np.empty_like(order)
        place[order] = np.arange(n)
        column = np.repeat(place, np.diff(H.indptr))
        off = place[H.indices] - column
        width = int(off.max(initial=0))
        if n > DENSE_COLUMNS and n * float(width) ** 2 > DIRECT_WORK:
            return ConjugateGradients(D, H)
        below = off >= 0
        band = np.zeros((width + 1, n))
        band[off[below], column[below]] = H.data[below]
        # One coordinate for each null direction is fixed at zero, which costs no energy. The coordinates are chosen
        # such that the null directions are linearly independent on them.
        regularisation = np.zeros(n)
        if not self.unique:
            for rows, columns, block in parts(self.sparse_null_basis):
                first = linalg.qr(block.toarray().T, mode="r", pivoting=True)[1][: len(columns)]
                regularisation[rows[first]] = np.abs(D.data).max(initial=0.0) ** 2 or 1.0
        factor = BandCholesky(D, band, order, regularisation)
        if factor.error <= 1e-6:  # after refinement QR would gain nothing
            return factor
        if n <= DENSE_COLUMNS:
            return DenseQR(D, self.null_basis)
        if factor.error <= 1e-2:  # refinement still converges
            return factor
        raise SheafError(
            f"the harmonic extension to {n} states is too badly conditioned to be solved: relative error "
            f"{factor.error:.1e}"
        )

    @one_thread
    def extend(self, boundary: ArrayLike) -> Array:
        """Compute interior values, shape (..., n_W), in vertex order, for boundary vectors of shape (..., n_U).

        If they are not unique, the result has minimum norm.

        Raises:
            SheafError: The boundary vectors have the wrong length, or the solution is inaccurate (see `solver`).
        """
        y = np.asarray(boundary, dtype=np.float64)
        n_W = len(self._columns_W)
        n_U = len(self._columns_U)
        if y.shape[-1:] != (n_U,):
            raise SheafError(f"boundary values have shape {y.shape}; expected (..., {n_U})")
        result = np.zeros((*y.shape[:-1], n_W))
        if result.size:
            w = self._edges.offset[:, None] - self._held @ y.reshape(result.size // n_W, n_U).T
            result[:] = self._off_null_space(self.solver.solve(self._D.T @ w, w)).T.reshape(result.shape)
        return result

    def _off_null_space(self, x: Array) -> Array:
        """Remove from the columns of x their component in the null space, which minimises their norm."""
        N = self.sparse_null_basis
        return x - N @ (N.T @ x) if N.shape[1] else x

    @one_thread
    def solve(self, right_hand_side: ArrayLike) -> Array:
        """Compute H^-1 r for one or many vectors r of shape (..., n_W).

        If H is singular, the result has minimum norm, and the component of r in the null space is ignored.
        """
        r = np.asarray(right_hand_side, dtype=np.float64)
        if not r.size:
            return np.zeros(r.shape)
        x = self.solver.solve(self._off_null_space(r.reshape(-1, r.shape[-1]).T))
        return self._off_null_space(x).T.reshape(r.shape)

    def harmonic_extension(self, boundary: Mapping[Any, ArrayLike]) -> HarmonicExtension:
        """The harmonic extension of one set of boundary values, with its null basis.

        Raises:
            SheafError: a boundary vertex has no value, or one of the wrong shape; or as in `extend`.
        """
        missing = [v for v in self.boundary if v not in boundary]
        if missing:
            raise SheafError(f"no boundary value for {missing}")
        values = [np.zeros(0), *(self._stalks.stalk_value(v, boundary[v]) for v in self.boundary)]
        whole = np.zeros(int(self._edges.column[-1]))
        whole[self._columns_U] = y = np.concatenate(values)
        whole[self._columns_W] = self.extend(y)
        energy = energy_of(self._edges, whole)
        return HarmonicExtension(self._stalks.unpack(whole), self.unique, self.null_basis, energy)


def gram(D: sparse.csr_array, E: sparse.csr_array) -> sparse.csr_array:
    """Return D^T E, columns ascending."""
    product = sparse.csr_array(D.T @ E)
    product.sort_indices()
    return product


def energy_of(edges: EdgeSet, x: Array) -> float:
    """Return half the square of |delta x - b|, for whitened edges."""
    residual = edges.delta @ x - edges.offset
    return 0.5 * float(np.einsum("i,i->", residual, residual))  # a BLAS product depends on the number of threads


# -- solvers ---------------------------------------------------------------------------------------------------


class BandCholesky:
    """Cholesky factor of H in band storage, with a refinement by the residual of D x = w itself.

    Attributes:
        error: Relative error of a solution that is known, before refinement: about eps times the condition of H.
        refinements: Number of refinements that bring it to rounding.
    """

    def __init__(self, D: sparse.csr_array, band: Array, order: IntArray, regularisation: Array) -> None:
        """Factor H + diag(regularisation), given its lower triangle in an order (n_W,) that keeps the band narrow.

        Args:
            D: delta on the free vertices.
            band: H[i + k, i] at [k, i] in that order, shape (bandwidth + 1, n_W).
            order: State at each place.
            regularisation: What is added to the diagonal, by state, shape (n_W,).
        """
        self._D = D
        self._order = order
        self._regularisation = regularisation[:, None]
        band[0] += regularisation[order]
        self.error = np.inf
        try:
            self._factor = linalg.cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
        except linalg.LinAlgError:
            return
        x: Array = (np.arange(len(order), dtype=np.float64) % 7 - 3.0)[:, None]  # not special in any way
        r = D.T @ (D @ x) + self._regularisation * x
        self.error = _norm((self._once(r) - x)[:, 0]) / (_norm(x[:, 0]) or 1.0)
        self.refinements = 0 if self.error < 1e-12 else 1 if self.error < 1e-9 else 5

    def _once(self, r: Array) -> Array:
        x = np.empty(r.shape)
        x[self._order] = linalg.cho_solve_banded((self._factor, True), r[self._order], check_finite=False)
        return x

    def solve(self, r: Array, w: Array | None = None) -> Array:
        """Return X with H X = r, for r of shape (n_W, k); r = D^T w where w, shape (m, k), is given."""
        x = self._once(r)
        for _ in range(self.refinements):
            x += self._once(_left_over(self._D, x, r, w) - self._regularisation * x)
        return x


class DenseQR:
    """QR of D stacked on the null directions, whose rows make the columns independent and agree with minimum norm."""

    def __init__(self, D: sparse.csr_array, null: Array) -> None:
        dense = D.toarray()
        scale = float(np.max(np.abs(dense), initial=0.0)) or 1.0
        Q, self._R = linalg.qr(np.vstack([dense, scale * null.T]), mode="economic")
        self._Q_w = Q[: len(dense)].T

    def solve(self, r: Array, w: Array | None = None) -> Array:
        """As `BandCholesky.solve`."""
        return linalg.cho_solve((self._R, False), r) if w is None else linalg.solve_triangular(self._R, self._Q_w @ w)


class ConjugateGradients:
    """Conjugate gradients with symmetric over-relaxation; see the module.

    Attributes:
        iterations: how many the last right-hand side took.
        residual: the relative residual |r - H x| / |r| that it reached, from D itself.
    """

    def __init__(self, D: sparse.csr_array, H: sparse.csr_array) -> None:
        self._D = D
        diagonal = H.diagonal()
        self._scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        row = np.repeat(np.arange(H.shape[0], dtype=H.indices.dtype), np.diff(H.indptr))
        above = H.indices > row
        row = row[above]
        indices = H.indices[above]
        values = H.data[above]
        values *= self._scale[row]
        values *= self._scale[indices]
        self._upper = np.searchsorted(row, np.arange(H.shape[0] + 1)), indices, values

    def solve(self, r: Array, w: Array | None = None) -> Array:
        """As `BandCholesky.solve`, column by column; restarts on the true residual, which recurrences drift away from.

        Raises:
            SheafError: the residual stays over LARGEST_RESIDUAL.
        """
        x = np.zeros_like(r)
        for k in range(r.shape[1]):
            column = x[:, k : k + 1]
            left = r[:, k : k + 1]
            size = _norm(r[:, k])
            self.iterations = 0
            self.residual = 1.0 if size else 0.0
            for _ in range(6):  # restarts, each on the true residual of the one before
                if self.residual <= RESIDUAL:
                    break
                step, iterations = conjugate_gradients(
                    *self._upper,
                    left[:, 0] * self._scale,
                    RELAXATION,
                    0.5 * RESIDUAL / self.residual,
                    MOST_ITERATIONS - self.iterations,
                )
                step *= self._scale
                column += step[:, None]
                left = _left_over(self._D, column, r[:, k : k + 1], None if w is None else w[:, k : k + 1])
                self.iterations += iterations
                self.residual = _norm(left[:, 0]) / size
            if not self.residual <= LARGEST_RESIDUAL:
                raise SheafError(
                    f"the harmonic extension to {len(r)} states did not converge: relative residual "
                    f"{self.residual:.1e} after {self.iterations} iterations, expected {LARGEST_RESIDUAL:g}; "
                    "the maps or weights are too badly conditioned"
                )
        return x


Solver = BandCholesky | DenseQR | ConjugateGradients


def _left_over(D: sparse.csr_array, x: Array, r: Array, w: Array | None) -> Array:
    """Return r - H x; by D^T (w - D x), which is more exact, where r = D^T w."""
    return np.asarray(r - D.T @ (D @ x) if w is None else D.T @ (w - D @ x))


def _norm(x: Array) -> float:
    """The Euclidean norm, summed in one order whatever the number of threads."""
    return float(np.sqrt(np.einsum("i,i->", x, x)))


@allocating_jit
def conjugate_gradients(indptr, indices, values, b, relaxation, tolerance, most):
    """Solve (I + U + U^T) x = b from x = 0, for b (n,) in the range of the matrix: x and the number of iterations.

    U is in compressed rows; relaxation is w; tolerance is by how much the norm of the preconditioned residual shrinks.
    """
    n = len(b)
    x, p, w, q = np.zeros(n), np.zeros(n), np.empty(n), np.empty(n)
    # Everything is multiplied by w once, so that the triangles have unit diagonals: r = (I + w U^T)^-1 w b.
    r = relaxation * b
    for i in range(n):
        value = relaxation * r[i]
        for k in range(indptr[i], indptr[i + 1]):
            r[indices[k]] -= values[k] * value
    square = 0.0
    for i in range(n):
        square += r[i] * r[i]
    enough, beta, iterations = tolerance * tolerance * square, 0.0, 0
    while iterations < most and square > enough:
        iterations += 1
        for i in range(n - 1, -1, -1):  # w = (I + w U)^-1 p
            p[i] = r[i] + beta * p[i]
            total = 0.0
            for k in range(indptr[i], indptr[i + 1]):
                total += values[k] * w[indices[k]]
            w[i] = p[i] - relaxation * total
            q[i] = p[i] + (relaxation - 2.0) * w[i]
        curvature = 0.0
        for i in range(n):  # q = w + (I + w U^T)^-1 (p + (w - 2) w)
            value = relaxation * q[i]
            for k in range(indptr[i], indptr[i + 1]):
                q[indices[k]] -= values[k] * value
            q[i] += w[i]
            curvature += p[i] * q[i]
        if not curvature > 0.0:  # b was not in the range, or rounding is all that is left
            break
        alpha, new = square / curvature, 0.0
        for i in range(n):
            x[i] += alpha * w[i]
            r[i] -= alpha * q[i]
            new += r[i] * r[i]
        beta, square = new / square, new
    return x, iterations


class Sheaf(Cochains):
    """Cellular sheaf on a graph, with inner products and desired values on its edges.

    Vertex v has the stalk R^{n_v}; an edge e = (i, j) has the stalk R^{m_e} and restriction maps F_{i,e} (m_e, n_i)
    and F_{j,e} (m_e, n_j). The coboundary is (delta x)_e = F_{i,e} x_i - F_{j,e} x_j. An edge may also carry a desired
    value b_e of that difference (`offset`) and an inner product K_e on its stalk (`weight`, symmetric positive
    definite). Parallel edges may be added, loops not.

    0-cochains are vectors of length n = sum n_v in vertex order, or mappings from vertex to value; 1-cochains are
    vectors of length m = sum m_e in the order in which edges were added.
    """

    def __init__(self, stalks: Mapping[Any, int]) -> None:
        """Make a sheaf without edges; `stalks` maps each vertex to the dimension of its stalk, in order.

        Raises:
            SheafError: a dimension is not a non-negative integer, or there is no vertex.
        """
        super().__init__(stalks)
        self._bundles: list[EdgeBundle] = []
        self._edges = 0

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"Sheaf({len(self.vertices)} vertices and {self._edges} edges; dim C^0 = {columns}, dim C^1 = {rows})"

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
            some = Ends([tails[e] for e in edges], [heads[e] for e in edges], ends.tail[edges], ends.head[edges])
            bundles.append(checked_bundle(some, self._dimension, number, **own))
        return self._append(bundles)

    def _append(self, bundles: list[EdgeBundle]) -> range:
        first = self._edges
        self._bundles += bundles
        self._edges += sum(len(b.number) for b in bundles)
        self.__dict__.pop("edges", None)
        return range(first, self._edges)

    @cached_property
    def edges(self) -> EdgeSet:
        """All edges."""
        return EdgeSet(merge(self._bundles), self._column)

    def coboundary(self) -> sparse.csr_array:
        """delta, shape (m, n): rows by edge order, columns by vertex order."""
        return self.edges.delta.copy()

    def whitened_coboundary(self) -> sparse.csr_array:
        """K^{1/2} delta, whose Gram matrix is the Laplacian, shape (m, n)."""
        return self.edges.whitened.delta.copy()

    def offset(self) -> Array:
        """Desired values b as a 1-cochain, shape (m,)."""
        return self.edges.offset.copy()

    def whitened_offset(self) -> Array:
        """K^{1/2} b in the edge coordinates of `whitened_coboundary`, shape (m,)."""
        return self.edges.whitened.offset.copy()

    def laplacian(self) -> sparse.csr_array:
        """The sheaf Laplacian L = delta^T K delta, shape (n, n)."""
        return gram(self.edges.whitened.delta, self.edges.whitened.delta)

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
        return self.relative_sections([], rtol=rtol)

    def local_sections(
        self, vertices: Iterable[Hashable], edges: Iterable[int] | None = None, *, rtol: float = RANK_TOLERANCE
    ) -> Array:
        """Orthonormal basis of Gamma(G'; F), shape (n_V', dimension): 0-cochains on V' that agree along the edges E'.

        Args:
            vertices: Vertices V', in the order of the rows.
            edges: Numbers of the edges E', whose ends must be in V'; unless given, all edges between vertices of V'.
            rtol: Tolerance, see `betti`.

        Raises:
            SheafError: V' is empty, a vertex or an edge is unknown or named twice, or an edge has an end outside of V'.
        """
        names = list(vertices)
        at = self.numbers(names)
        if not names or len(set(names)) != len(names):
            raise SheafError(f"vertices {names}: expected at least one vertex, and none named twice")
        inside = np.zeros(len(self._dimension), dtype=bool)
        inside[at] = True
        kept = np.zeros(self._edges, dtype=bool)
        for b in self.edges.bundles:
            kept[b.number] = inside[b.tail] & inside[b.head]
        if edges is not None:
            chosen = list(edges)
            known = {
                e for e in chosen if isinstance(e, int | np.integer) and type(e) is not bool and 0 <= e < len(kept)
            }
            if len(known) != len(chosen) or not all(kept[e] for e in known):
                between = np.flatnonzero(kept).tolist()
                raise SheafError(
                    f"edges {chosen}: expected different numbers of edges between these vertices, {between}"
                )
            kept[:] = False
            kept[list(known)] = True
        sheaf, vertices = Sheaf(dict(zip(names, self._dimension[at].tolist(), strict=True))), self.vertices
        for b in self.edges.bundles:
            mine = kept[b.number]
            tails, heads = ([vertices[v] for v in end[mine].tolist()] for end in (b.tail, b.head))
            sheaf.add_edges(tails, heads, b.F_tail[mine], b.F_head[mine])
        return sheaf.global_sections(rtol=rtol)

    def cohomology_basis(self, *, rtol: float = RANK_TOLERANCE) -> Array:
        """Basis of H^1(G; F) = coker delta by its harmonic representatives, orthonormal in K, shape (m, h1).

        They span ker delta^* = {y: delta^T K y = 0}, the orthogonal complement of im delta: each class of C^1 / im
        delta has one representative there, its shortest.

        Raises:
            SheafError: the basis is too large (see `sections.cokernel_basis`), or its dimension is not decided at this
                tolerance, which is as in `betti`.
        """
        basis = cokernel_basis(self.edges.delta, self.betti(rtol=rtol)[1], rtol)
        if self.edges.whitened is self.edges:
            return basis.toarray()
        blocks = []  # of C^-1, where K = C C^T
        for b, rows in zip(self.edges.bundles, self.edges.rows, strict=True):
            inverse = np.eye(rows.shape[1]) if b.weight is None else np.linalg.inv(np.linalg.cholesky(b.weight))
            blocks.append((rows[:, :, None], rows[:, None], inverse))
        root = assembled(blocks, (len(self.edges.offset),) * 2).tocsr()
        shortest = [(rows[:, None], columns, np.linalg.qr(x.toarray())[0]) for rows, columns, x in parts(root @ basis)]
        return np.asarray((root.T @ assembled(shortest, basis.shape)).toarray())

    def relative_sections(self, boundary: Iterable[Hashable], *, rtol: float = RANK_TOLERANCE) -> Array:
        """Orthonormal basis of H^0(G, U; F), sections that vanish on the boundary U, shape (n_W, dimension).

        Rows are by the other vertices W in vertex order; rtol is as in `betti`.
        """
        return section_basis(self.edges, self.free(list(boundary)), rtol).toarray()

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

    def nearest_global_section(self, x: Cochain, *, offset: ArrayLike | None = None) -> Any:
        """Orthogonal projection of a 0-cochain on H^0, or on the states whose edges differ by an offset.

        Those are the x with delta x = b or, where there is none, with the least |delta x - b|_K, as of the harmonic
        extension.

        Args:
            x: 0-cochain; a mapping gives a mapping, a vector a vector.
            offset: b, one edge after another, in the order of `offset`, which returns that of the edges; zero unless
                given.

        Raises:
            SheafError: The offset has another shape, or is not finite; or as in `DirichletProblem.extend`.
        """
        value, edges = self.pack(x), self.edges
        b = np.zeros(self.shape[0]) if offset is None else finite(offset, "offset")
        if b.shape != (self.shape[0],):
            raise SheafError(f"offset has shape {b.shape}; expected ({self.shape[0]},)")
        N = section_basis(edges, self.free([]), RANK_TOLERANCE)
        section = N @ (N.T @ value)
        if b.any():
            bundles = [replace(own, offset=b[rows]) for own, rows in zip(edges.bundles, edges.rows, strict=True)]
            section += DirichletProblem(self, EdgeSet(bundles, edges.column), []).extend(np.zeros(0))
        return self.unpack(section) if isinstance(x, Mapping) else section
