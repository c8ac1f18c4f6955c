"""Harmonic extension: the Dirichlet problem of a sheaf, factored once and solved for many boundary values."""

import itertools
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, sparse
from scipy.sparse import csgraph
from scipy.sparse import linalg as splinalg

from mjsheaf.errors import SheafError
from mjsheaf.sheaf.kernel import DENSE_COLUMNS, RANK_TOLERANCE, sparse_kernel_basis
from mjsheaf.sheaf.sheaf import Sheaf

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HarmonicExtension:
    """A harmonic extension, and what is free in it.

    Attributes:
        x: value of every vertex, boundary included.
        unique: whether H^0(G, U; F) = 0.
        null_basis: orthonormal basis of H^0(G, U; F), shape (n_W, dimension); any combination may be added to the
            interior values. Zero columns where the extension is unique.
        energy: Dirichlet energy 1/2 |delta x - b|_K^2.
    """

    x: dict[Hashable, Array]
    unique: bool
    null_basis: Array
    energy: float


class DirichletProblem:
    """Minimise 1/2 |delta x - b|_K^2 over the interior, the boundary held.

    The stationary point solves H x_W = B x_U + c, in the paper's symbols (eq. harmonic_equation) with an offset.

    Attributes:
        sheaf: the sheaf.
        boundary: the vertices U, in the order of boundary vectors.
        interior: the vertices W, in vertex order.
        H: L[W, W], sparse, shape (n_W, n_W).
        B: -L[W, U], sparse, shape (n_W, n_U).
        c: (delta^T K b) on W, shape (n_W,).
    """

    def __init__(self, sheaf: Sheaf, boundary: Sequence[Hashable]) -> None:
        """Assemble the blocks H, B and c; the whole Laplacian is not formed.

        Raises:
            SheafError: a boundary vertex is unknown or named twice.
        """
        if len(set(boundary)) != len(boundary):
            raise SheafError("a boundary vertex is named twice")
        self.sheaf = sheaf
        self.boundary = list(boundary)
        self.interior = sheaf.interior(self.boundary)
        D = sheaf.whitened_coboundary()
        self._D_W, self._D_U = D[:, sheaf.columns(self.interior)], D[:, sheaf.columns(self.boundary)]
        self._b = sheaf.whitened_offset()
        self.H = (self._D_W.T @ self._D_W).tocsr()
        self.B = -(self._D_W.T @ self._D_U).tocsr()
        self.c = self._D_W.T @ self._b

    @cached_property
    def sparse_null_basis(self) -> sparse.csc_array:
        """Orthonormal basis of H^0(G, U; F), shape (n_W, dimension); inner products on edges do not change it."""
        return sparse_kernel_basis(self.sheaf.coboundary()[:, self.sheaf.columns(self.interior)], RANK_TOLERANCE)

    @cached_property
    def null_basis(self) -> Array:
        """`sparse_null_basis` as a dense array."""
        return self.sparse_null_basis.toarray()

    @property
    def unique(self) -> bool:
        """Whether the extension is unique: H^0(G, U; F) = 0, the paper's Assumption on relative cohomology."""
        return self.sparse_null_basis.shape[1] == 0

    @cached_property
    def _solvers(self) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
        """Two solvers of H x = r, for r = D_W^T w given by w (m, k), and for r (n_W, k) in the range of H.

        D_W is the whitened coboundary on W. Solutions are of minimum norm where H is singular.
        """
        n, N = self.H.shape[0], self.sparse_null_basis
        if n <= DENSE_COLUMNS:
            # On D_W rather than on H, whose condition number is the square: what counts as injective can be solved.
            # The rows N^T make the columns independent, and agree with minimum norm.
            D_W = self._D_W.toarray()
            scale = float(np.max(np.abs(D_W), initial=0.0)) or 1.0
            Q, R = linalg.qr(np.vstack([D_W, scale * self.null_basis.T]), mode="economic")
            Q_w = Q[: len(D_W)].T

            def from_vertices(r: Array) -> Array:
                return _off(N, linalg.cho_solve((R, False), _off(N, r)))

            return lambda w: _off(N, linalg.solve_triangular(R, Q_w @ w)), from_vertices
        # Coordinates that single out each null direction are held at zero: that costs nothing, and makes H regular.
        grounds = np.zeros(n)
        grounds[_singling_out(N)] = self.H.diagonal().max() or 1.0
        factor = splinalg.splu((self.H + sparse.diags_array(grounds)).tocsc())

        def solve(r: Array) -> Array:
            return _off(N, factor.solve(_off(N, r)))

        return lambda w: solve(self._D_W.T @ w), solve

    def extend(self, boundary: Array) -> Array:
        """Interior values for one or many boundary vectors.

        Args:
            boundary: stacked boundary values, shape (..., n_U), in the order of `self.boundary`.

        Returns:
            Interior values, shape (..., n_W), in vertex order; of minimum norm where not unique.

        Raises:
            SheafError: the boundary vectors have the wrong length.
        """
        y = np.asarray(boundary, dtype=np.float64)
        n_W, n_U = self.B.shape
        if y.shape[-1:] != (n_U,):
            raise SheafError(f"boundary values have shape {y.shape}; legal is (..., {n_U})")
        result = np.zeros((*y.shape[:-1], n_W))
        if result.size:
            flat = y.reshape(result.size // n_W, n_U)
            result[:] = self._solvers[0](self._b[:, None] - self._D_U @ flat.T).T.reshape(result.shape)
        return result

    def solve(self, right_hand_side: Array) -> Array:
        """H^-1 r for one or many vectors r of shape (..., n_W); of minimum norm where H is singular."""
        r = np.asarray(right_hand_side, dtype=np.float64)
        return self._solvers[1](r.reshape(-1, r.shape[-1]).T).T.reshape(r.shape)

    def harmonic_extension(self, boundary: Mapping[Hashable, ArrayLike]) -> HarmonicExtension:
        """The harmonic extension of one set of boundary values, with its null basis.

        Raises:
            SheafError: a boundary vertex has no value, or one of the wrong shape.
        """
        missing = [v for v in self.boundary if v not in boundary]
        if missing:
            raise SheafError(f"no boundary value for {missing}")
        values = {v: self.sheaf.stalk_value(v, boundary[v]) for v in self.boundary}
        interior = self.extend(np.concatenate([np.zeros(0), *values.values()]))
        whole = np.zeros(self.sheaf.shape[1])
        whole[self.sheaf.columns(self.boundary)] = np.concatenate([np.zeros(0), *values.values()])
        whole[self.sheaf.columns(self.interior)] = interior
        return HarmonicExtension(
            self.sheaf.unpack(whole), self.unique, self.null_basis, self.sheaf.dirichlet_energy(whole)
        )


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
