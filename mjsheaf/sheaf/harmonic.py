"""Harmonic extension: the Dirichlet problem of a sheaf, prepared once and solved for many boundary values.

H x = r, H = D^T D on the free vertices, has three solvers:

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

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
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
from mjsheaf.sheaf.edges import Cochains, EdgeSet, parts
from mjsheaf.sheaf.sections import DENSE_COLUMNS, RANK_TOLERANCE, section_basis
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
_MOST_RESTARTS = 6  # of conjugate gradients, each on the true residual of the one before
_NO_QR_BELOW = 1e-6  # error of a solution by H up to which QR would gain nothing after refinement
_UNUSABLE_ABOVE = 1e-2
_NO_REFINEMENT_BELOW, _ONE_REFINEMENT_BELOW = 1e-12, 1e-9


@dataclass(frozen=True)
class HarmonicExtension:
    """Harmonic extension with its free directions.

    Attributes:
        x: Value of every vertex, boundary included.
        unique: True if H^0(G, U; F) = 0.
        null_basis: Basis of H^0(G, U; F), orthonormal in the inner products of the vertex stalks, shape
            (n_W, dimension). Any combination may be added to the interior values. It has no columns if the extension is
            unique.
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

    H, B and c are derivatives of the energy, blocks of delta^T K delta. Where vertex stalks have inner products M those
    of the Laplacian are M_W^-1 times them: the same equation, with the same solutions. Which of many solutions is the
    shortest, and which null basis is orthonormal, depends on M.

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
        M = stalks.vertex_product
        self._product = None if M is None else M.restricted(self._columns_W)

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
        """(delta^T K delta)[W, W], shape (n_W, n_W): L[W, W] where M is the identity."""
        return gram(self._D, self._D)

    @cached_property
    def B(self) -> sparse.csr_array:  # noqa: N802 - the paper's symbol
        """-(delta^T K delta)[W, U], shape (n_W, n_U)."""
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
        H, free = self.H, self._null_space.shape[1]
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
    def _null_space(self) -> sparse.csc_array:
        """A basis of H^0(G, U; F) that is orthonormal in R^{n_W}."""
        return section_basis(self._plain, self._free, self._rtol)

    @cached_property
    def sparse_null_basis(self) -> sparse.csc_array:
        """Orthonormal basis of H^0(G, U; F), shape (n_W, dimension); inner products on edges do not change it."""
        return self._null_space if self._product is None else self._product.orthonormal(self._null_space)

    @cached_property
    def null_basis(self) -> Array:
        """`sparse_null_basis` as a dense array."""
        return self.sparse_null_basis.toarray()

    @property
    def unique(self) -> bool:
        """True if the extension is unique: H^0(G, U; F) = 0, the paper's Assumption on relative cohomology."""
        return self.sparse_null_basis.shape[1] == 0

    @cached_property
    def solver(self) -> "Solver":
        """The solver of H x = r: a factorisation that is kept, or conjugate gradients; see the module."""
        return _choose_solver(self._D, gram(self._D, self._D), self._null_space, self._regularisation)

    def _regularisation(self) -> Array:
        """Diagonal matrix that makes H regular when added to it, shape (n_W,).

        It fixes at zero the coordinates that identify each null direction, which costs no energy.
        """
        diagonal = np.zeros(len(self._columns_W))
        if not self.unique:
            diagonal[_pivot_rows(self._null_space)] = np.abs(self._D.data).max(initial=0.0) ** 2 or 1.0
        return diagonal

    @one_thread
    def extend(self, boundary: ArrayLike) -> Array:
        """Compute interior values, shape (..., n_W), in vertex order, for boundary vectors of shape (..., n_U).

        If they are not unique, the result has minimum norm in the inner products of the vertex stalks.

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
            result[:] = self._shortest(self.solver.solve(self._D.T @ w, w)).T.reshape(result.shape)
        return result

    def _shortest(self, x: Array) -> Array:
        """Remove from the columns of x their component in the null space, which minimises their norm."""
        x = _project_out(self._null_space, x)
        if self._product is None or not self._null_space.shape[1]:
            return x
        N = self.sparse_null_basis
        return np.asarray(x - N @ (N.T @ (self._product.matrix @ x)))

    @one_thread
    def solve(self, right_hand_side: ArrayLike) -> Array:
        """Compute H^-1 r for one or many vectors r of shape (..., n_W).

        If H is singular, the result has minimum norm, and the component of r in the null space is ignored.
        """
        r = np.asarray(right_hand_side, dtype=np.float64)
        if not r.size:
            return np.zeros(r.shape)
        x = self.solver.solve(_project_out(self._null_space, r.reshape(-1, r.shape[-1]).T))
        return self._shortest(x).T.reshape(r.shape)

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


def _pivot_rows(null_basis: sparse.csc_array) -> IntArray:
    """As many rows as there are columns, on which they are independent; columns that share rows are treated apart."""
    pivots = [
        rows[linalg.qr(block.toarray().T, mode="r", pivoting=True)[1][: len(columns)]]
        for rows, columns, block in parts(null_basis)
    ]
    return np.concatenate([np.zeros(0, dtype=np.int64), *pivots])


def _project_out(null_basis: sparse.csc_array, x: Array) -> Array:
    """Remove the null directions from the columns of x."""
    return x - null_basis @ (null_basis.T @ x) if null_basis.shape[1] else x


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
        self.refinements = 0 if self.error < _NO_REFINEMENT_BELOW else 1 if self.error < _ONE_REFINEMENT_BELOW else 5

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
        self.iterations = 0
        self.residual = 0.0

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
            for _ in range(_MOST_RESTARTS):
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


@one_thread
def _choose_solver(
    D: sparse.csr_array, H: sparse.csr_array, null: sparse.csc_array, regularisation: Callable[[], Array]
) -> Solver:
    """Return the best solver of a problem.

    Args:
        D: delta on the free vertices.
        H: D^T D.
        null: Orthonormal basis of the null space of D, shape (n_W, dimension); right-hand sides have no part in it.
        regularisation: What to add to the diagonal of H to make it regular without a change to x off the null space.

    Raises:
        SheafError: over DENSE_COLUMNS states, and H is singular to rounding where `null` says that it is not.
    """
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
    factor = BandCholesky(D, band, order, regularisation())
    if factor.error <= _NO_QR_BELOW:
        return factor
    if n <= DENSE_COLUMNS:
        return DenseQR(D, null.toarray())
    if factor.error <= _UNUSABLE_ABOVE:
        return factor
    raise SheafError(
        f"the harmonic extension to {n} states is too badly conditioned to be solved: relative error {factor.error:.1e}"
    )


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
