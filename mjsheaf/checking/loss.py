"""How fast errors fall in mean square while measurements are lost, a lost one being skipped.

E[x x^T] goes to E[A x x^T A^T], a linear operator on matrices that keeps the positive semidefinite ones, so that its
spectral radius is an eigenvalue. For the paper's law, where x is e, it is self-adjoint: its largest eigenvalue, by
Lanczos, is within the norm of the residual of the one that is stated. With bursts (Gilbert and Elliott) it acts on one
matrix for each state of the channels, and stays self-adjoint in the measure of the channels' stationary state. With
delay, newton or integral x is more than e, and the operator is not self-adjoint.

Feedforward and drift do not depend on e, whichever samples they miss.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import Field
from scipy.linalg import block_diag
from scipy.sparse.linalg import ArpackError, LinearOperator, cg, eigs, eigsh, gmres

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.delay import team_loop
from mjsheaf.checking.held_law import UndecidedError
from mjsheaf.checking.linked_law import LinkedLaw
from mjsheaf.io.section import Finite, Record

_MOST_MOMENTS = 60_000  # numbers in the second moments with bursts, delay or terms
_MOST_BURSTS = 8  # channels with bursts
_FEW = 40  # second moments whose eigenvalue is found of a dense matrix
_TOLERANCE = 1e-10  # of eigenvalues and of covariances, relative
_ROUNDING = 1e-9  # of a factor: closer to 1 nothing is decided


class LossAnswer(Record):
    """How fast errors fall in mean square while measurements are lost, a lost one being skipped.

    Where edges disagree at q*, or where e does not go to zero, each loss moves agents: the errors that this leaves are
    not counted.
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
    """How fast E|e|^2 falls."""
    found: dict[str, Any] = {}
    try:
        moments = moments_of(law)
        found["bound"] = moments.bound
        factor, accuracy = found["factor"], found["accuracy"] = moments.factor
        if abs(factor - 1.0) > max(accuracy, _ROUNDING):
            found["stable"] = factor < 1.0
        found["rate"] = -np.log(factor) / (2.0 * law.loop.period) if factor > 0.0 else None
    except UndecidedError as error:
        return LossAnswer(reason=str(error), **found)
    return LossAnswer(reason="", **found)


def moments_of(law: LinkedLaw) -> "SecondMoments":
    """What a period does to the second moments.

    Raises:
        UndecidedError: that is not known, or too large.
    """
    if (law.links.held & law.links.lossy).any():
        raise UndecidedError("lost samples are held")
    return PaperMoments(law) if law.paper and not law.links.delay.any() else TeamMoments(law)


def chances(loss: Array) -> tuple[Array, list[int]]:
    """The probability of loss of each edge whose losses are independent, shape (E,), and the numbers of the others."""
    chance, bursts = np.zeros(len(loss)), []
    for e, (to_bad, to_good, good, bad) in enumerate(loss):
        if good == bad or to_bad == 0.0:
            chance[e] = good
        elif to_good == 0.0:
            chance[e] = bad
        elif to_bad + to_good == 1.0:
            chance[e] = to_good * good + to_bad * bad
        else:
            bursts.append(e)
    return chance, bursts


class SecondMoments(ABC):
    """A linear operator on second moments, S matrices (n, n); subclasses must implement `_apply` and `variances`."""

    _shape: tuple[int, int, int]
    _symmetric: bool
    bound: float | None = None
    """By which E|e|^2 falls in any one period, at most."""

    @abstractmethod
    def _apply(self, X: Array) -> Array:
        """The moments (S, n, n) a period later."""

    @abstractmethod
    def variances(self, pulled: Sequence[Array]) -> tuple[Array, Array]:
        """Stationary variances of e and of the command, shape (n,) each, by noise whose part of eta is `pulled`.

        Raises:
            UndecidedError: the loop is unstable, or the iteration did not converge.
        """

    def _operator(self, *, less: bool = False) -> LinearOperator:
        """X -> the moments a period later, or X less those, on flat vectors."""

        def apply(flat: Array) -> Array:
            after = self._apply(flat.reshape(self._shape)).ravel()
            return flat.ravel() - after if less else after

        return LinearOperator((int(np.prod(self._shape)),) * 2, matvec=apply, dtype=np.float64)

    @cached_property
    def factor(self) -> tuple[float, float]:
        """By which E|e|^2 falls in the long run, and the norm of its eigenvector's residual.

        Raises:
            UndecidedError: the iteration did not converge.
        """
        operator, (S, n, _) = self._operator(), self._shape
        if S * n * n <= _FEW:
            matrix = operator @ np.eye(S * n * n)
            values, vectors = np.linalg.eigh(matrix) if self._symmetric else np.linalg.eig(matrix)
        else:
            start = np.tile(np.eye(n), (S, 1, 1)).ravel()
            try:
                lanczos = {"A": operator, "k": 1, "v0": start, "tol": _TOLERANCE}
                values, vectors = eigsh(**lanczos, which="LA") if self._symmetric else eigs(**lanczos, which="LM")
            except ArpackError:
                raise UndecidedError("the second moments' eigenvalue did not converge") from None
        largest = int(np.abs(values).argmax())
        value, vector = values[largest], vectors[:, largest]
        after = operator @ vector.real + 1j * (operator @ vector.imag)
        return float(abs(value)), float(np.linalg.norm(after - value * vector))

    def _settled(self, added: Array) -> Array:
        """The moments (S, n, n) that stay as they are where each period adds so much."""
        if not self.factor[0] < 1.0:
            raise UndecidedError("the loop is unstable")
        less, right = self._operator(less=True), added.ravel()
        if self._symmetric:
            found, failed = cg(less, right, rtol=_TOLERANCE, maxiter=2000)
        else:
            found, failed = gmres(less, right, rtol=_TOLERANCE, restart=100, maxiter=20)
        if failed:
            raise UndecidedError("the covariance under loss did not converge")
        return np.asarray(found.reshape(self._shape))


class TeamMoments(SecondMoments):
    """Those of the states of `team_loop`, losses being independent.

    With B = M + L (1 - p) C, X -> B X B^T + L (p (1 - p) C X C^T) L^T, the product edge by edge.
    """

    def __init__(self, law: LinkedLaw) -> None:
        """Prepare it.

        Raises:
            UndecidedError: it is too large, or there are bursts.
        """
        chance, bursts = chances(law.links.loss)
        if bursts:
            raise UndecidedError("losses come in bursts, and measurements are late or the law has newton or integral")
        M, self._L, self._C = team_loop(law, law.links.delay, int(_MOST_MOMENTS**0.5))
        of = np.repeat(np.arange(len(law.edges)), [len(edge.D) for edge in law.edges])
        self._heard = 1.0 - chance[of]
        self._mean = M + self._L * self._heard @ self._C
        self._weight = (of[:, None] == of) * (chance * (1.0 - chance))[of]
        self._shape, self._symmetric, self._law = (1, *M.shape), False, law

    def _apply(self, X: Array) -> Array:
        lost = self._L @ (self._weight * (self._C @ X[0] @ self._C.T)) @ self._L.T
        return np.asarray(self._mean @ X[0] @ self._mean.T + lost)[None]

    def variances(self, pulled: Sequence[Array]) -> tuple[Array, Array]:
        """See SecondMoments."""
        added = self._L @ (self._heard[:, None] * block_diag(*self._law.links.noise)) @ self._L.T
        X, n = self._settled(added)[0], len(self._law.vectors)
        command = 2.0 * X - self._mean @ X - X @ self._mean.T  # of h u = e_k - e_{k+1}
        return np.diagonal(X)[:n], np.diagonal(command)[:n] / self._law.loop.period**2


class PaperMoments(SecondMoments):
    """Those of e in each state of the channels, under the paper's law without delay.

    In a state in which edge e is lost with probability p_e, with A = I - h k1 sum (1 - p_e) H_e,

        X -> A X A + (h k1)^2 sum p_e (1 - p_e) H_e X H_e,

    after which the channels change their state. With shares w of these and the root R of their transitions, which are
    symmetric in that measure, X_s = sqrt(w_s) (R Z)_s, and Z -> R within(R Z) is self-adjoint.
    """

    def __init__(self, law: LinkedLaw) -> None:
        """Prepare it.

        Raises:
            UndecidedError: it is too large, or not self-adjoint.
        """
        loss, edges, n = law.links.loss, law.edges, len(law.vectors)
        gain, (chance, bursts) = law.loop.period * law.loop.gain, chances(loss)
        if (loss[bursts, 0] + loss[bursts, 1] > 1.0).any():
            raise UndecidedError("a channel changes its state more often than not")
        if bursts and (len(bursts) > _MOST_BURSTS or n * n * 2 ** len(bursts) > _MOST_MOMENTS):
            raise UndecidedError(f"{len(bursts)} channels with bursts and {n} states have too many second moments")
        states = np.arange(2 ** len(bursts))
        p, root, share = np.tile(chance, (len(states), 1)), np.ones((1, 1)), np.ones(1)
        for place, e in enumerate(bursts):
            to_bad, to_good, good, bad = loss[e]
            p[:, e] = np.where(states >> (len(bursts) - 1 - place) & 1, bad, good)
            across = np.sqrt(to_bad * to_good)
            values, vectors = np.linalg.eigh([[1.0 - to_bad, across], [across, 1.0 - to_good]])
            root = np.kron(root, vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
            share = np.kron(share, np.array([to_good, to_bad]) / (to_good + to_bad))
        self._shape, self._symmetric, self._law = (len(states), n, n), True, law
        self._gain, self._root, self._share, self._p = gain, root, share, p
        parts = [edge.H for edge in edges]
        self._mean = np.stack([np.eye(n) - gain * law.spread(_scaled(1.0 - each, parts)) for each in p])
        self._lost: list[tuple[IntArray, Array, Array]] = []  # alike in size: slots (E, k), H (E, k, k), weight (S, E)
        for k in {len(edge.slots) for edge in edges}:
            chosen = [e for e, edge in enumerate(edges) if len(edge.slots) == k and (p[:, e] * (1.0 - p[:, e])).any()]
            if chosen:
                slots, H = np.array([edges[e].slots for e in chosen]), np.array([parts[e] for e in chosen])
                self._lost.append((slots, gain * H, p[:, chosen] * (1.0 - p[:, chosen])))

    def _within(self, X: Array) -> Array:
        """What the loop does to X (S, n, n) while the channels keep their state."""
        out = self._mean @ X @ self._mean
        for slots, H, weight in self._lost:
            places: Any = (slice(None), slots[:, :, None], slots[:, None, :])
            np.add.at(out, places, weight[..., None, None] * (H @ X[places] @ H))
        return np.asarray(out)

    def _apply(self, X: Array) -> Array:
        return np.asarray(np.tensordot(self._root, self._within(np.tensordot(self._root, X, 1)), 1))

    @property
    def bound(self) -> float:  # type: ignore[override]
        """See SecondMoments."""
        S, n, _ = self._shape
        return float(np.linalg.eigvalsh(self._within(np.tile(np.eye(n), (S, 1, 1)))).max())

    def variances(self, pulled: Sequence[Array]) -> tuple[Array, Array]:
        """See SecondMoments: Z = R (within(R Z) + sqrt(w) V), where V is what a period adds."""
        share = self._share[:, None, None]
        added = self._gain**2 * np.stack([self._law.spread(_scaled(1.0 - each, pulled)) for each in self._p])
        Z = self._settled(np.tensordot(self._root, np.sqrt(share) * added, 1))
        X = np.sqrt(share) * np.tensordot(self._root, Z, 1)
        command = self._within(X) + X - self._mean @ X - X @ self._mean + share * added
        error, asked = (np.diagonal(x, axis1=1, axis2=2).sum(axis=0) for x in (X, command))
        return error, asked / self._law.loop.period**2


def _scaled(scale: Array, parts: Sequence[Array]) -> list[Array]:
    """Matrices times a number each."""
    return [x * part for x, part in zip(scale, parts, strict=True)]
