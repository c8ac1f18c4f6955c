"""Decay rate of errors in mean square while measurements are lost, a lost one being skipped.

E[x x^T] goes to E[A x x^T A^T], a linear operator on matrices that keeps the positive semidefinite ones, so that its
spectral radius is an eigenvalue. For the paper's law without delay, where x is e, it is self-adjoint: its largest
eigenvalue, by Lanczos, is within the norm of the residual of the one that is stated. With delay, newton or integral x
is more than e, and the operator T is not self-adjoint; the eigenvalue may be multiple, and its eigenvector badly
conditioned. The verdict then rests on X - T(X) = I. T maps the cone of positive semidefinite matrices into itself,
hence:

- If a solution has X > 0, then T(X) = X - I <= (1 - 1 / lambda_max(X)) X, so that the spectral radius is below 1.
- If the spectral radius is below 1, then X = I + T(I) + T(T(I)) + ... > 0. So a solution with a negative eigenvalue
  shows that it is not.

Both hold of any right side that is positive definite, and so of the computed one, X - T(X), which is close to I.

Feedforward and drift do not depend on e, whichever samples they miss. With losses in bursts (Gilbert and Elliott)
nothing is claimed.
"""

from functools import cached_property, partial
from typing import Any

import numpy as np
from pydantic import Field
from scipy.linalg import block_diag, schur
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackError, LinearOperator, cg, eigs, eigsh, gmres

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.delay import MOST_STATES, team_loop
from mjsheaf.checking.loop.linked_law import LinkedLaw
from mjsheaf.errors import UndecidedError
from mjsheaf.section import Finite, Record

_MOST_MOMENTS = 60_000  # numbers in the second moments with delay, newton or integral
_FEW = 40  # second moments whose eigenvalue is found of a dense matrix
_TOLERANCE = 1e-10  # of eigenvalues and of covariances, relative
_ROUNDING = 1e-9  # of a factor: closer to 1 nothing is decided


class LossAnswer(Record):
    """Decay rate of the mean square error under packet loss; the law skips lost measurements.

    If edges disagree at q*, or if e does not converge to zero, each loss moves agents. The resulting errors are not
    counted.
    """

    stable: bool | None = Field(None, description="E|e|^2 falls; null where undecided: see reason")
    factor: Finite = Field(None, description="by which E|e|^2 falls in a period, in the long run")
    accuracy: Finite = Field(
        None,
        description="norm of the residual of the factor's eigenvector: an error bound of the factor of the paper's law "
        "without delay, else an estimate",
    )
    bound: Finite = Field(
        None, description="of E|e|^2 in any one period, at most; null where e is not all that the loop remembers"
    )
    rate: Finite = Field(None, description="at which the root of E|e|^2 decays, 1/s; negative where it grows")
    reason: str = Field(description="why a number is missing, or empty")


def loss_answer(law: LinkedLaw) -> LossAnswer:
    """Compute the decay rate of E|e|^2."""
    found: dict[str, Any] = {}
    try:
        moments = SecondMoments(law)
        found["bound"] = moments.bound
        factor, accuracy = found["factor"], found["accuracy"] = moments.factor
        found["stable"] = factor < 1.0 if abs(factor - 1.0) > max(accuracy, _ROUNDING) else moments.stable
        found["rate"] = -np.log(factor) / (2.0 * law.loop.period) if factor > 0.0 else None
    except UndecidedError as error:
        return LossAnswer(reason=str(error), **found)
    return LossAnswer(reason="the factor is too close to 1" if found["stable"] is None else "", **found)


def _chances(loss: Array) -> Array:
    """Return the probability of loss of each edge, shape (E,).

    Raises:
        UndecidedError: Losses come in bursts.
    """
    to_bad, to_good, good, bad = loss.T
    alike = (good == bad) | (to_bad == 0.0)
    if not (alike | (to_good == 0.0) | (to_bad + to_good == 1.0)).all():
        raise UndecidedError("undecided with bursts")
    return np.where(alike, good, np.where(to_good == 0.0, bad, to_good * good + to_bad * bad))


class SecondMoments:
    """Map of the second moments of the states x of `team_loop`, x+ = (M + L C) x, over a period, under losses.

    Where the numbers of edges arrive with probabilities r, with B = M + L r C,

        X -> B X B^T + L (r (1 - r) C X C^T) L^T, of C X C^T each edge's own block.
    """

    def __init__(self, law: LinkedLaw) -> None:
        """Prepare it.

        Raises:
            UndecidedError: Lost samples are held, losses come in bursts, or the loop is too large.
        """
        links = law.links
        if (links.held & links.lossy).any():
            raise UndecidedError("lost samples are held")
        p = _chances(links.loss)
        self._symmetric = law.loop.is_papers and not links.delay.any()
        M, L, C = team_loop(law, links.delay, MOST_STATES if self._symmetric else int(_MOST_MOMENTS**0.5))
        sizes = np.array([len(edge.D) for edge in law.edges])
        self._arrives = np.repeat(1.0 - p, sizes)
        self._mean = M + L * self._arrives @ C
        self._law = law
        self._L = L
        self._lost: list[tuple[Array, Array, Array]] = []  # alike in size: C, L^T (E, m, n), weight (E, 1, 1)
        for m in set(sizes.tolist()):
            chosen = np.flatnonzero((sizes == m) & (p * (1.0 - p) > 0.0))
            rows = (np.cumsum(sizes) - sizes)[chosen, None] + np.arange(m)
            if len(chosen):
                self._lost.append((C[rows], L.T[rows], (p * (1.0 - p))[chosen, None, None]))

    def _apply(self, X: Array) -> Array:
        """Return the moments a period after X, shape (n, n)."""
        out = self._mean @ X @ self._mean.T
        for C, L, weight in self._lost:
            n = len(X)
            around, back = csr_array(C.reshape(-1, n)), csr_array(L.reshape(-1, n).T)
            block = weight * ((around @ X).reshape(C.shape) @ C.swapaxes(1, 2))
            out += back @ (block @ L).reshape(-1, n)
        return np.asarray(out)

    @property
    def bound(self) -> float | None:
        """By which E|e|^2 falls in any one period, at most; None where e is not all that the loop remembers."""
        return float(np.linalg.eigvalsh(self._apply(np.eye(len(self._mean)))).max()) if self._symmetric else None

    def covariances(self) -> Array:
        """Stationary covariances of e, m^2, and of the command, m^2/s^2, shape (2, n, n), by the noise of links.

        Raises:
            UndecidedError: the loop is unstable, or the iteration did not converge.
        """
        if not self.factor[0] < 1.0:
            raise UndecidedError("the loop is unstable")
        noise = block_diag(*self._law.links.noise)
        X = self._solve(self._L * self._arrives @ noise @ self._L.T)
        command = 2.0 * (X - self._mean @ X)  # of h u = e_k - e_{k+1}
        vectors = self._law.vectors
        n = vectors.shape[1]
        error, asked = X[:n, :n], command[:n, :n]
        if n < len(vectors):  # a team that is free to move: from the coordinates of `team_loop`
            error, asked = (vectors @ x @ vectors.T for x in (error, asked))
        return np.stack([error, 0.5 * (asked + asked.T) / self._law.loop.period**2])

    def _operator(self, *, less: bool = False) -> LinearOperator:
        """X -> the moments a period later, or X less those, on flat vectors."""

        def apply(flat: Array) -> Array:
            after = self._apply(flat.reshape(self._mean.shape)).ravel()
            return flat.ravel() - after if less else after

        return LinearOperator((self._mean.size,) * 2, matvec=apply, dtype=np.float64)

    @cached_property
    def factor(self) -> tuple[float, float]:
        """By which E|e|^2 falls in the long run, and the norm of its eigenvector's residual.

        Raises:
            UndecidedError: the iteration did not converge.
        """
        operator = self._operator()
        start = np.eye(len(self._mean)).ravel()
        if len(start) <= _FEW:
            # A Schur form scales nothing: the scaling of the usual routine spoils multiple eigenvalues.
            matrix = operator @ np.eye(len(start))
            value = float(np.abs(np.diagonal(schur(matrix, output="complex")[0])).max())
            return value, float(np.linalg.svd(matrix - value * np.eye(len(start)), compute_uv=False)[-1])
        try:
            lanczos = {"A": operator, "k": 1, "v0": start, "tol": _TOLERANCE}
            values, vectors = eigsh(**lanczos, which="LA") if self._symmetric else eigs(**lanczos, which="LM")
        except ArpackError:
            raise UndecidedError("the second moments' eigenvalue did not converge") from None
        value, vector = values[0], vectors[:, 0]
        after = operator @ vector.real + 1j * (operator @ vector.imag)
        return float(abs(value)), float(np.linalg.norm(after - value * vector))

    @cached_property
    def stable(self) -> bool | None:
        """Return True if E|e|^2 falls, by the solution of X - T(X) = I (see the module); None if rounding decides.

        Raises:
            UndecidedError: the iteration did not converge.
        """
        X = self._solve(np.eye(len(self._mean)))
        smallest, size = float(np.linalg.eigvalsh(X).min()), float(np.abs(X).max())
        drop = X - self._apply(X)
        known = np.linalg.eigvalsh(drop).min() > 0.5 and abs(smallest) >= _ROUNDING * size
        return smallest > 0.0 if known else None

    def _solve(self, added: Array) -> Array:
        """Solve X - T(X) = added for symmetric matrices, shape (n, n)."""
        less, right = self._operator(less=True), added.ravel()
        solve = partial(cg, maxiter=2000) if self._symmetric else partial(gmres, restart=100, maxiter=20)
        found, failed = solve(less, right, rtol=_TOLERANCE)
        if failed:
            raise UndecidedError("the covariance under loss did not converge")
        X = found.reshape(self._mean.shape)
        return np.asarray(0.5 * (X + X.T))
