"""Cholesky's factorisation of a band, by compiled loops.

LAPACK's would be as fast on narrow bands and faster on wide ones, but its bits depend on the number of threads.

Conjugate gradients for a matrix I + U + U^T of which only the strict upper triangle U is stored.

The preconditioner is symmetric successive over-relaxation, M = (I/w + U^T) w (I/w + U) for any 0 < w < 2, which is
positive definite. With Eisenstat's trick (SIAM J. Sci. Stat. Comput. 2, 1981) an iteration costs one pass over U
backwards and one forwards, as much as without a preconditioner: A = (I/w + U^T) + (I/w + U) + (1 - 2/w) I, so that of
the product with A between the two triangular solutions little is left to do.

Solvers of H x = r, H = D^T D, for the free vertices of a sheaf: three of them, each where it is the best.

| solver             | used                                                  | why                                     |
|--------------------|-------------------------------------------------------|-----------------------------------------|
| BandCholesky       | states times bandwidth squared is at most DIRECT_WORK | exact, factors once, then solves many   |
| DenseQR            | H is too badly conditioned, up to DENSE_COLUMNS       | works on D, whose condition is the root |
| ConjugateGradients | the band is too wide                                  | memory in proportion to the sheaf       |

Bandwidths are those after reordering the vertices (reverse Cuthill-McKee): a few stalks for paths, cycles and
whatever is long and thin, a side of it for a grid.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse import csgraph

from mjsheaf.errors import SheafError
from mjsheaf.jit import allocating_kernel, kernel
from mjsheaf.sheaf.edges import EdgeTable, adjoint_product, product
from mjsheaf.sheaf.loops import bandwidth, block_row_lengths, fill_band, fill_block, neighbours


@kernel
def factor_band(band):
    """Factor A = C C^T in place; return whether A is positive definite to rounding.

    Args:
        band: A[i, j], i >= j, is band[j, i - j]; then so is C. Shape (n, bandwidth + 1).
    """
    n, width = band.shape
    for j in range(n):
        if not band[j, 0] > 0.0:
            return False
        count = min(width, n - j)
        root = np.sqrt(band[j, 0])
        for i in range(count):
            band[j, i] /= root
        for i in range(1, count):
            factor = band[j, i]
            if factor != 0.0:
                for k in range(count - i):
                    band[j + i, k] -= factor * band[j, i + k]
    return True


@kernel
def solve_band(band, x):
    """Solve C C^T x = b in place, for b of shape (n, k)."""
    n, width = band.shape
    columns = x.shape[1]
    for j in range(n):
        for c in range(columns):
            x[j, c] /= band[j, 0]
        for i in range(1, min(width, n - j)):
            factor = band[j, i]
            for c in range(columns):
                x[j + i, c] -= factor * x[j, c]
    for j in range(n - 1, -1, -1):
        for i in range(1, min(width, n - j)):
            factor = band[j, i]
            for c in range(columns):
                x[j, c] -= factor * x[j + i, c]
        for c in range(columns):
            x[j, c] /= band[j, 0]


@kernel
def scale_symmetrically(indptr, indices, values, diagonal):
    """Turn the diagonal d into 1 / sqrt(d), and U into that on both sides of it; a zero of d has no row, and becomes 1.

    Args:
        indptr, indices, values: compressed rows of U.
        diagonal: shape (n,).
    """
    for i in range(len(diagonal)):
        diagonal[i] = 1.0 / np.sqrt(diagonal[i]) if diagonal[i] > 0.0 else 1.0
    for i in range(len(diagonal)):
        for k in range(indptr[i], indptr[i + 1]):
            values[k] *= diagonal[i] * diagonal[indices[k]]


@allocating_kernel
def conjugate_gradients(indptr, indices, values, b, relaxation, tolerance, most):
    """Solve (I + U + U^T) x = b from x = 0.

    Args:
        indptr, indices, values: compressed rows of U.
        b: right-hand side, shape (n,), in the range of the matrix.
        relaxation: w.
        tolerance: by how much to shrink the norm of the preconditioned residual.
        most: most iterations.

    Returns:
        x and the number of iterations.
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


Array = NDArray[np.float64]
Index = NDArray[np.int64]

DIRECT_WORK = 5e8
"""Largest states * bandwidth^2 of a direct solution: a tenth of a second, once."""

RESIDUAL = 1e-10
"""Relative residual |r - H x| / |r| that conjugate gradients aim at."""

LARGEST_RESIDUAL = 1e-8
"""Relative residual over which an iterative solution is an error."""

RELAXATION = 1.75
MOST_ITERATIONS = 20_000
_ROUNDS = 6  # of conjugate gradients, each on the true residual of the one before
_TRUSTED = 1e-6  # error of a solution by H up to which QR would gain nothing after refinement
_USABLE = 1e-2
_EXACT, _CLEAN = 1e-12, 1e-9  # errors up to which no refinement and one are enough


@dataclass(frozen=True)
class FreeProblem:
    """The free vertices W of a table of edges, and products with D = delta on them.

    Attributes:
        table: all edges, whitened.
        vertices: numbers of the free vertices, ascending, shape (W,).
        columns: their columns, shape (n_W,).
    """

    table: EdgeTable
    vertices: Index
    columns: Index

    @cached_property
    def dimension(self) -> Index:
        """Dimension of each free stalk, shape (W,)."""
        return self.table.column[self.vertices + 1] - self.table.column[self.vertices]

    @property
    def states(self) -> int:
        """n_W."""
        return len(self.columns)

    def image(self, x: Array) -> Array:
        """D x for x of shape (n_W, k)."""
        whole = np.zeros((int(self.table.column[-1]), x.shape[1]))
        whole[self.columns] = x
        return product(self.table, whole)

    def pulled_back(self, y: Array) -> Array:
        """D^T y for y of shape (m, k)."""
        return adjoint_product(self.table, y)[self.columns]

    def placed(self, order: Index | None = None) -> Index:
        """First row of each free vertex, by vertex, -1 at the others, shape (V,).

        Args:
            order: the free vertices in the order of their rows; ascending unless given.
        """
        vertices, dimension = self.vertices, self.dimension
        if order is not None:
            vertices, dimension = order, self.table.column[order + 1] - self.table.column[order]
        place = np.full(len(self.table.column) - 1, -1)
        place[vertices] = np.cumsum(dimension) - dimension
        return place


class BandCholesky:
    """Cholesky factor of H in band storage, with a refinement by the residual of D x = w itself.

    Attributes:
        error: relative error of a solution that is known, before refinement: about eps times the condition of H.
        refinements: how many bring that to rounding.
    """

    def __init__(self, problem: FreeProblem, place: Index, band: int, grounds: Array) -> None:
        """Factor H + diag(grounds).

        Args:
            problem: what is to be solved.
            place: first row of each free vertex in an order of small bandwidth, by vertex.
            band: the bandwidth.
            grounds: shape (n_W,).
        """
        self._problem, self._grounds = problem, grounds
        begin = np.cumsum(problem.dimension) - problem.dimension
        self._to = np.repeat(place[problem.vertices] - begin, problem.dimension) + np.arange(problem.states)
        self._factor = np.zeros((problem.states, band + 1))
        fill_band(problem.table, place, self._factor)
        self._factor[self._to, 0] += grounds
        self.error = self._probed() if factor_band(self._factor) else np.inf
        self.refinements = 0 if self.error < _EXACT else 1 if self.error < _CLEAN else 5

    def _probed(self) -> float:
        x: Array = (np.arange(self._problem.states, dtype=np.float64) % 7 - 3.0)[
            :, None
        ]  # anything that is in no way special
        r = self._problem.pulled_back(self._problem.image(x)) + self._grounds[:, None] * x
        return _norm((self._once(r) - x)[:, 0]) / _norm(x[:, 0])

    def _once(self, r: Array) -> Array:
        ordered = np.empty(r.shape)
        ordered[self._to] = r
        solve_band(self._factor, ordered)
        return ordered[self._to]

    def least_squares(self, w: Array) -> Array:
        """X that minimises |D x - w|, for w of shape (m, k)."""
        p = self._problem
        x = self._once(p.pulled_back(w))
        for _ in range(self.refinements):
            x += self._once(p.pulled_back(w - p.image(x)) - self._grounds[:, None] * x)
        return x

    def solve(self, r: Array) -> Array:
        """X with H x = r, for r of shape (n_W, k)."""
        p = self._problem
        x = self._once(r)
        for _ in range(self.refinements):
            x += self._once(r - p.pulled_back(p.image(x)) - self._grounds[:, None] * x)
        return x


class DenseQR:
    """QR of D stacked on the null directions, whose rows make the columns independent and agree with minimum norm."""

    def __init__(self, problem: FreeProblem, null: Array) -> None:
        D = problem.image(np.eye(problem.states))
        scale = float(np.max(np.abs(D), initial=0.0)) or 1.0
        Q, self._R = linalg.qr(np.vstack([D, scale * null.T]), mode="economic")
        self._Q_w = Q[: len(D)].T

    def least_squares(self, w: Array) -> Array:
        """X that minimises |D x - w|, for w of shape (m, k)."""
        return linalg.solve_triangular(self._R, self._Q_w @ w)

    def solve(self, r: Array) -> Array:
        """X with H x = r, for r of shape (n_W, k)."""
        return linalg.cho_solve((self._R, False), r)


class ConjugateGradients:
    """Conjugate gradients with symmetric over-relaxation; see `iteration`.

    Attributes:
        iterations: how many the last right-hand side took.
        residual: the relative residual |r - H x| / |r| that it reached, from D itself.
    """

    def __init__(self, problem: FreeProblem) -> None:
        self._problem = problem
        t, n = problem.table, problem.states
        place = problem.placed()
        indptr = np.empty(n + 1, dtype=np.int64)
        block_row_lengths(t, place, problem.vertices, True, indptr)
        self._indptr, self._indices, self._values = indptr, np.empty(indptr[-1], np.int32), np.zeros(indptr[-1])
        self._scale = np.zeros(n)
        fill_block(t, place, problem.vertices, True, 1.0, indptr, self._indices, self._values, self._scale)
        scale_symmetrically(indptr, self._indices, self._values, self._scale)
        self.iterations, self.residual = 0, 0.0

    def least_squares(self, w: Array) -> Array:
        """X that minimises |D x - w|, for w of shape (m, k).

        Raises:
            SheafError: the residual stays over LARGEST_RESIDUAL.
        """
        p = self._problem
        return self._each(p.pulled_back(w), lambda x, k: p.pulled_back(w[:, k : k + 1] - p.image(x)))

    def solve(self, r: Array) -> Array:
        """X with H x = r, for r of shape (n_W, k); SheafError as in `least_squares`."""
        p = self._problem
        return self._each(r, lambda x, k: r[:, k : k + 1] - p.pulled_back(p.image(x)))

    def _each(self, r: Array, left_over: Callable[[Array, int], Array]) -> Array:
        """Column by column; `left_over` is the true residual of a column, which recurrences drift away from."""
        x = np.zeros_like(r)
        for k in range(r.shape[1]):
            column, left, size = x[:, k : k + 1], r[:, k : k + 1], _norm(r[:, k])
            self.iterations, self.residual = 0, 1.0 if size else 0.0
            for _ in range(_ROUNDS):
                if self.residual <= RESIDUAL:
                    break
                step, iterations = conjugate_gradients(
                    self._indptr,
                    self._indices,
                    self._values,
                    left[:, 0] * self._scale,
                    RELAXATION,
                    0.5 * RESIDUAL / self.residual,
                    MOST_ITERATIONS - self.iterations,
                )
                step *= self._scale
                column += step[:, None]
                left = left_over(column, k)
                self.iterations += iterations
                self.residual = _norm(left[:, 0]) / size
            if not self.residual <= LARGEST_RESIDUAL:
                raise SheafError(
                    f"the harmonic extension to {len(r)} states did not converge: relative residual "
                    f"{self.residual:.1e} after {self.iterations} iterations, wanted {LARGEST_RESIDUAL:g}; "
                    "the maps or weights are too badly conditioned"
                )
        return x


Solver = BandCholesky | DenseQR | ConjugateGradients


def solver_of(problem: FreeProblem, null: sparse.csc_array, grounds: Callable[[], Array], dense_columns: int) -> Solver:
    """The best solver of a problem.

    Args:
        problem: what is to be solved.
        null: orthonormal basis of the kernel of D, shape (n_W, dimension); right-hand sides have no part in it.
        grounds: what to add to the diagonal of H to make it regular without a change to x off the kernel.
        dense_columns: most states that are decomposed densely.

    Raises:
        SheafError: more states than that, and H is singular to rounding where `null` says that it is not.
    """
    t, n = problem.table, problem.states
    free = problem.placed() >= 0
    graph = sparse.csr_array(neighbours(t, free), shape=(len(free), len(free)))
    order = csgraph.reverse_cuthill_mckee(graph, symmetric_mode=True)
    place = problem.placed(order[free[order]].astype(np.int64))
    band = bandwidth(t, place)
    if n > dense_columns and n * float(band) ** 2 > DIRECT_WORK:
        return ConjugateGradients(problem)
    factor = BandCholesky(problem, place, band, grounds())
    if factor.error <= _TRUSTED:
        return factor
    if n <= dense_columns:
        return DenseQR(problem, null.toarray())
    if factor.error <= _USABLE:
        return factor
    raise SheafError(
        f"the harmonic extension to {n} states is too badly conditioned to be solved: relative error {factor.error:.1e}"
    )


def _norm(x: Array) -> float:
    """The Euclidean norm, summed in one order whatever the number of threads."""
    return float(np.sqrt(np.einsum("i,i->", x, x)))
