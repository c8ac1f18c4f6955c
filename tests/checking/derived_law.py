"""Dynamics of the sampled law derived by hand, as oracles for the model that `check` reads off the compiled stages.

With e = q* - q in an eigenvector of H of eigenvalue lambda, and measurements d periods old,

    s_k = alpha (e_{k-d} - n_k / lambda) + c s_{k-1}    newton: c = T_r(..), as its rounds contract, and alpha = 1 - c;
                                                        without it alpha = lambda and c = 0
    z_{k+1} = z_k - h lambda e_{k-d} + h n_k
    e_{k+1} = e_k - h (k1 s_k - k_I z_k + v_k + lead (v_k - v_{k-1}) - phi_k),

where n is the noise of eta, and v and phi are the responses of feedforward and observer to noise alone.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import lfilter, ss2tf

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.held_law import residual_polynomial
from mjsheaf.law.terms import TermArrays


@dataclass(frozen=True)
class DerivedLaw:
    """The law by its formulas, for eigenvalues of H (L,), a gain, 1/s, a period, s, and a delay in periods."""

    terms: TermArrays
    values: Array
    gain: float
    period: float
    delay: int = 0

    @cached_property
    def c(self) -> Array:
        """Fraction of an error that remains after newton's rounds, shape (L,)."""
        rounds = self.terms.newton
        if not rounds:
            return np.zeros_like(self.values)
        return residual_polynomial(self.values, rounds, *self.terms.eigenvalues)

    @cached_property
    def alpha(self) -> Array:
        """Coefficient of an error in s, shape (L,)."""
        return 1.0 - self.c if self.terms.newton else self.values

    @property
    def names(self) -> list[str]:
        """The states, those of the loop itself first."""
        d, terms = self.delay, self.terms
        names = [f"e{j}" for j in range(d + 1)] + ["s"] * (terms.newton > 0) + ["z"] * (terms.integral > 0.0)
        if terms.feedforward:
            names += ["rate", "v", "sensed", *(f"odometry{j}" for j in range(1, d + 1))]
        return names + ["drift"] * (terms.drift > 0.0)

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array]:
        """M and G of x+ = M x + G u, and rows that give the command of x and u: (L, n, n), (L, n, 4), (L, n + 4)."""
        terms, d, values, names, h = self.terms, self.delay, self.values, self.names, self.period
        n, L = len(names), len(values)

        def unit(name: str) -> Array:
            row = np.zeros((L, n + 4))
            if name in names:
                row[:, names.index(name)] = 1.0
            return row

        def given(i: int) -> Array:
            row = np.zeros((L, n + 4))
            row[:, n + i] = 1.0
            return row

        eta = -values[:, None] * unit(f"e{d}") + given(0)
        s = (-self.alpha / values)[:, None] * eta + self.c[:, None] * unit("s")
        command = self.gain * s - terms.integral * unit("z")
        new = {"s": s, "z": unit("z") + h * eta}
        if terms.feedforward:
            c, lead = residual_polynomial(values, terms.feedforward, *terms.eigenvalues), float(terms.lead[0])
            moved = unit(f"odometry{d}") if d else given(2)
            rate = unit("rate") + terms.measured * ((given(1) - unit("sensed") + moved) / h - unit("rate"))
            v = c[:, None] * unit("v") + ((1.0 - c) / values)[:, None] * rate
            command = command + v + lead * (v - unit("v"))
            new |= {"rate": rate, "v": v, "sensed": given(1), "odometry1": given(2)}
            new |= {f"odometry{j}": unit(f"odometry{j - 1}") for j in range(2, d + 1)}
        if terms.drift > 0.0:
            new["drift"] = unit("drift") + terms.drift * (given(3) / h - unit("drift"))
            command = command - new["drift"]
        new |= {"e0": unit("e0") - h * command} | {f"e{j}": unit(f"e{j - 1}") for j in range(1, d + 1)}
        rows = np.stack([new[name] for name in names], axis=1)
        return rows[..., :n], rows[..., n:], command

    @property
    def own(self) -> Array:
        """Matrices of the loop itself, shape (L, n, n)."""
        n = self.delay + 1 + (self.terms.newton > 0) + (self.terms.integral > 0.0)
        return self.matrices[0][:, :n, :n]

    def answered(self, one: int, added: Array) -> Array:
        """The command of one eigenvalue where `added` (n,) is added to it, and feedback answers."""
        push = np.zeros((len(self.own[one]), 1))
        push[0] = -self.period
        ask = self.matrices[2][one, : len(push)]
        above, below = ss2tf(self.own[one], push, ask[None], [[1.0]])
        return np.asarray(lfilter(above[0], below, added))
