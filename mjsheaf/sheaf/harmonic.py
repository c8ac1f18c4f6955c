"""Harmonic extension: the Dirichlet problem of a sheaf, prepared once and solved for many boundary values."""

import itertools
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, sparse
from scipy.sparse import csgraph

from mjsheaf.errors import SheafError
from mjsheaf.sheaf.edges import laplacian_block, product
from mjsheaf.sheaf.sections import DENSE_COLUMNS, RANK_TOLERANCE, section_basis
from mjsheaf.sheaf.sheaf import Sheaf
from mjsheaf.sheaf.solvers import FreeProblem, Solver, solver_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HarmonicExtension:
    """A harmonic extension, and what is free in it.

    Attributes:
        x: value of every vertex, boundary included.
        unique: whether H^0(G, U; F) = 0.
        null_basis: basis of H^0(G, U; F), orthonormal in the inner products of the vertex stalks, shape
            (n_W, dimension); any combination may be added to the interior values. Zero columns where the extension is
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
    are assembled when they are asked for, without the whole Laplacian; solving needs none of them.

    H, B and c are derivatives of the energy, blocks of delta^T K delta. Where vertex stalks have inner products M those
    of the Laplacian are M_W^-1 times them: the same equation, with the same solutions. Which of many solutions is the
    shortest, and which null basis is orthonormal, depends on M.

    Attributes:
        sheaf: the sheaf, as it was when the problem was made.
        boundary: the vertices U, in the order of boundary vectors.
    """

    def __init__(self, sheaf: Sheaf, boundary: Sequence[Hashable]) -> None:
        """Name the boundary.

        Raises:
            SheafError: a boundary vertex is unknown or named twice.
        """
        if len(set(boundary)) != len(boundary):
            raise SheafError("a boundary vertex is named twice")
        self.sheaf = sheaf
        self.boundary = list(boundary)
        self._table, self._plain, self._b = sheaf.whitened_table, sheaf.table, sheaf.whitened_offset()
        self._U = sheaf.numbers(self.boundary)
        self._free = np.ones(len(self._table.column) - 1, dtype=bool)
        self._free[self._U] = False
        W = np.flatnonzero(self._free)
        self._columns_U, self._columns_W = sheaf.columns_of(self._U), sheaf.columns_of(W)
        self._problem = FreeProblem(self._table, W, self._columns_W)
        M = sheaf.vertex_product
        self._product = None if M is None else M.restricted(self._columns_W)

    @cached_property
    def interior(self) -> list[Hashable]:
        """The vertices W, in vertex order."""
        return self.sheaf.interior(self.boundary)

    @cached_property
    def H(self) -> sparse.csr_array:  # noqa: N802 - the paper's symbol
        """(delta^T K delta)[W, W], shape (n_W, n_W): L[W, W] where M is the identity."""
        return laplacian_block(self._table, self._problem.vertices, self._problem.vertices)

    @cached_property
    def B(self) -> sparse.csr_array:  # noqa: N802 - the paper's symbol
        """-(delta^T K delta)[W, U], shape (n_W, n_U)."""
        return laplacian_block(self._table, self._problem.vertices, self._U, -1.0)

    @cached_property
    def c(self) -> Array:
        """(delta^T K b) on W, shape (n_W,)."""
        return self._problem.pulled_back(self._b[:, None])[:, 0]

    @cached_property
    def _kernel(self) -> sparse.csc_array:
        """A basis of H^0(G, U; F) that is orthonormal in R^{n_W}."""
        return section_basis(self._plain, self._free, RANK_TOLERANCE)

    @cached_property
    def sparse_null_basis(self) -> sparse.csc_array:
        """Orthonormal basis of H^0(G, U; F), shape (n_W, dimension); inner products on edges do not change it."""
        return self._kernel if self._product is None else self._product.orthonormal(self._kernel)

    @cached_property
    def null_basis(self) -> Array:
        """`sparse_null_basis` as a dense array."""
        basis = self.sparse_null_basis
        return basis.toarray() if basis.shape[1] else np.zeros(basis.shape)

    @property
    def unique(self) -> bool:
        """Whether the extension is unique: H^0(G, U; F) = 0, the paper's Assumption on relative cohomology."""
        return self.sparse_null_basis.shape[1] == 0

    @cached_property
    def solver(self) -> Solver:
        """What solves H x = r: a factorisation that is kept, or conjugate gradients; see `solvers`."""
        return solver_of(self._problem, self._kernel, self._grounds, DENSE_COLUMNS)

    def _grounds(self) -> Array:
        """What makes H regular when added to its diagonal, shape (n_W,).

        Coordinates that single out each null direction are held at zero: that costs nothing.
        """
        grounds = np.zeros(self._problem.states)
        if not self.unique:
            grounds[_singling_out(self._kernel)] = np.abs(self._table.F).max(initial=0.0) ** 2 or 1.0
        return grounds

    def extend(self, boundary: ArrayLike) -> Array:
        """Interior values for one or many boundary vectors.

        Args:
            boundary: stacked boundary values, shape (..., n_U), in the order of `self.boundary`.

        Returns:
            Interior values, shape (..., n_W), in vertex order; where not unique, of minimum norm in the inner products
            of the vertex stalks.

        Raises:
            SheafError: the boundary vectors have the wrong length, or the solution is not accurate (see `solvers`).
        """
        y = np.asarray(boundary, dtype=np.float64)
        n_W, n_U = self._problem.states, len(self._columns_U)
        if y.shape[-1:] != (n_U,):
            raise SheafError(f"boundary values have shape {y.shape}; expected (..., {n_U})")
        result = np.zeros((*y.shape[:-1], n_W))
        if result.size:
            flat = y.reshape(result.size // n_W, n_U)
            whole = np.zeros((int(self._table.column[-1]), len(flat)))
            whole[self._columns_U] = flat.T
            w = product(self._table, whole)
            np.subtract(self._b[:, None], w, out=w)  # in place: a million vertices have enough arrays
            result[:] = self._shortest(self.solver.least_squares(w)).T.reshape(result.shape)
        return result

    def _shortest(self, x: Array) -> Array:
        """The columns of x without their part in the null space: as short as they can be made along it."""
        x = _off(self._kernel, x)
        if self._product is None or not self._kernel.shape[1]:
            return x
        N = self.sparse_null_basis
        return np.asarray(x - N @ (N.T @ (self._product.matrix @ x)))

    def solve(self, right_hand_side: ArrayLike) -> Array:
        """H^-1 r for one or many vectors r of shape (..., n_W); of minimum norm where H is singular.

        What r has along the null space, where H has no inverse, is left out.
        """
        r = np.asarray(right_hand_side, dtype=np.float64)
        if not r.size:
            return np.zeros(r.shape)
        x = self.solver.solve(_off(self._kernel, r.reshape(-1, r.shape[-1]).T))
        return self._shortest(x).T.reshape(r.shape)

    def harmonic_extension(self, boundary: Mapping[Any, ArrayLike]) -> HarmonicExtension:
        """The harmonic extension of one set of boundary values, with its null basis.

        Raises:
            SheafError: a boundary vertex has no value, or one of the wrong shape; or as in `extend`.
        """
        missing = [v for v in self.boundary if v not in boundary]
        if missing:
            raise SheafError(f"no boundary value for {missing}")
        values = [np.zeros(0), *(self.sheaf.stalk_value(v, boundary[v]) for v in self.boundary)]
        whole = np.zeros(int(self._table.column[-1]))
        whole[self._columns_U] = y = np.concatenate(values)
        whole[self._columns_W] = self.extend(y)
        residual = product(self._table, whole[:, None])[:, 0]
        residual -= self._b
        energy = 0.5 * float(np.einsum("i,i->", residual, residual))
        return HarmonicExtension(self.sheaf.unpack(whole), self.unique, self.null_basis, energy)


def _singling_out(null_basis: sparse.csc_array) -> NDArray[np.int64]:
    """As many rows as there are columns, on which they are independent; columns that share rows are treated apart."""
    pattern = abs(null_basis)  # so that nothing cancels
    parts, label = csgraph.connected_components(pattern.T @ pattern, directed=False)
    ordered = null_basis[:, np.argsort(label, kind="stable")]
    found = [np.zeros(0, dtype=np.int64)]
    for left, right in itertools.pairwise([0, *np.cumsum(np.bincount(label, minlength=parts)).tolist()]):
        part = ordered[:, left:right]
        rows, place = np.unique(part.indices, return_inverse=True)
        block = np.zeros((right - left, len(rows)))
        block[np.repeat(np.arange(right - left), np.diff(part.indptr)), place] = part.data
        found.append(rows[linalg.qr(block, mode="r", pivoting=True)[1][: right - left]])
    return np.concatenate(found)


def _off(null_basis: sparse.csc_array, x: Array) -> Array:
    """Remove the null directions from the columns of x."""
    return x - null_basis @ (null_basis.T @ x) if null_basis.shape[1] else x
