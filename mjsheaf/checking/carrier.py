"""How motions of the targets carry over to the harmonic extension: K = H^-1 B."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.system import System
from mjsheaf.checking.spectrum import Spectrum

Array = NDArray[np.float64]

_DENSE = 200_000  # numbers of K that are held as such


class Carrier:
    """K = H^-1 B, which carries motions of targets to their harmonic extension.

    Where it is too large to be held, the norms of its blocks are bounded by sigma_max(B) / lambda_min(H), for which a
    spectrum is needed.
    """

    def __init__(self, system: System, spectrum: Spectrum | None = None) -> None:
        self._team = system.team
        self._problem = system.team.dirichlet
        n_q, n_p = self._problem.B.shape
        self._rest = self._problem.extend(np.zeros(n_p))
        self._norm = np.inf
        if spectrum is not None and spectrum.smallest.size:
            self._norm = spectrum.sigma_max_B / float(spectrum.smallest[0])
        self._K = self._problem.extend(np.eye(n_p)) - self._rest if n_q * n_p <= _DENSE else None  # (n_p, n_q)

    def extend(self, targets: Array) -> Array:
        """q* of targets at (..., M, 3), stacked, (..., n_q), m."""
        return self.carry(targets) + self._rest

    def carry(self, motions: Array) -> Array:
        """K applied to motions of the targets (..., M, 3), stacked, (..., n_q)."""
        flat = motions.reshape(*motions.shape[:-2], -1)[..., self._own]
        return flat @ self._K if self._K is not None else self._problem.extend(flat) - self._rest

    def reach(self, radii: Array) -> Array:
        """How far each agent's q*_i moves at most where targets move by at most `radii` (..., M), (..., N)."""
        if self._K is not None:
            return np.asarray(radii @ self._blocks.T)
        whole = self._norm * np.linalg.norm(radii, axis=-1, keepdims=True)
        return np.repeat(whole, len(self._team.agents), axis=-1)

    def spread(self, radii: Array, slopes: Array, moves: Array) -> Array:
        """A bound on |K s + F r|: s within `radii` (..., M), r within `moves` and F within `slopes` (..., N), (...)."""
        with np.errstate(invalid="ignore"):  # an infinite slope where nothing moves
            own = np.where(moves > 0.0, slopes * moves, 0.0)
        if self._K is not None:
            return np.linalg.norm(radii @ self._blocks.T + own, axis=-1)
        return self._norm * np.linalg.norm(radii, axis=-1) + np.linalg.norm(own, axis=-1)

    @cached_property
    def _own(self) -> NDArray[np.int64]:
        """Places of the stacked p in padded targets (M, 3), flattened."""
        slots = self._team.slots
        return slots[self._problem.H.shape[0] :] - 3 * len(self._team.agents)

    @cached_property
    def _blocks(self) -> Array:
        """|K_ik|, shape (N, M)."""
        N, M = len(self._team.agents), len(self._team.targets)
        padded = np.zeros((3 * M, N, 3))
        assert self._K is not None  # what reaches for its blocks
        padded[self._own] = self._team.unpack(self._K)
        return np.linalg.norm(padded.reshape(M, 3, N, 3).transpose(2, 0, 3, 1), ord=2, axis=(2, 3))
