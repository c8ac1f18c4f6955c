"""Theorem 1 of the paper: constants, gain condition, sets, and the bound on |e(t)|.

With e = q* - q the closed loop is e' = -k1 H e + f_B + f~ + Delta, |f_B| <= f_bar, |Delta| <= omega_bar and
|f~| <= rho(|e|) |e|. Here rho is a constant L, a Lipschitz bound of the agents' own drift over a region: rho_bar = 0,
chi is infinite, D and S are the whole space, and the gain condition k_min > rho(2 sqrt(mu / lambda_V)) + lambda_V reads
k_min - lambda_V > L. All of it holds in continuous time and while the run stays inside that region.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# The best rate is the supremum of those that satisfy a strict inequality; this share of it satisfies it.
_SHARE = 1.0 - 1e-9


@dataclass(frozen=True)
class Theorem:
    """The constants of Theorem 1.

    Attributes:
        gain: k1, 1/s.
        lambda_min: smallest eigenvalue of H.
        f_bar: bound on |f_B|, m/s.
        omega_bar: bound on |Delta|, m/s.
        lipschitz: rho, constant, 1/s.
        k_min: k1 lambda_min / 2, 1/s.
        rate: lambda_V, 1/s; the best one unless given; 0 where none satisfies the gain condition.
        applies: whether the gain condition holds for `rate`.
        mu: (f_bar + omega_bar)^2 / (2 k1 lambda_min), m^2/s.
        radius: of the ultimate set U, sqrt(mu / lambda_V), m; infinite where the condition fails.
    """

    gain: float
    lambda_min: float
    f_bar: float
    omega_bar: float
    lipschitz: float
    k_min: float
    rate: float
    applies: bool
    mu: float
    radius: float

    def bound(self, initial_error: float, elapsed: ArrayLike) -> Array:
        """The theorem's bound on |e(t)| in m, at times since the start in s; infinite where it does not apply."""
        elapsed = np.asarray(elapsed, dtype=np.float64)
        if not self.applies:
            return np.full(elapsed.shape, np.inf)
        decay = np.exp(-2.0 * self.rate * elapsed)
        return np.sqrt(decay * initial_error**2 + self.mu / self.rate * (1.0 - decay))


def theorem_1(
    gain: float, lambda_min: float, f_bar: float, omega_bar: float, lipschitz: float, rate: float | None = None
) -> Theorem:
    """Evaluate Theorem 1.

    Args:
        gain: k1, 1/s.
        lambda_min: smallest eigenvalue of H; 0 where the relative cohomology is not trivial.
        f_bar, omega_bar: bounds on |f_B| and |Delta|, m/s.
        lipschitz: rho, 1/s.
        rate: lambda_V, 1/s; None takes the largest that satisfies the gain condition, which also gives the smallest
            ultimate set.
    """
    k_min = 0.5 * gain * lambda_min
    best = (k_min - lipschitz) * _SHARE if math.isfinite(lipschitz) else -math.inf
    chosen = best if rate is None else rate
    applies = 0.0 < chosen <= best and math.isfinite(f_bar)
    mu = (f_bar + omega_bar) ** 2 / (2.0 * gain * lambda_min) if lambda_min > 0.0 else math.inf
    return Theorem(
        gain=gain,
        lambda_min=lambda_min,
        f_bar=f_bar,
        omega_bar=omega_bar,
        lipschitz=lipschitz,
        k_min=k_min,
        rate=chosen if applies or rate is not None else 0.0,
        applies=applies,
        mu=mu,
        radius=math.sqrt(mu / chosen) if applies else math.inf,
    )


def gain_for_radius(radius: float, lambda_min: float, f_bar: float, omega_bar: float, lipschitz: float) -> float:
    """The smallest k1 whose ultimate set, at the best rate, has the given radius.

    With kappa = k1 lambda_min the radius is (f_bar + omega_bar) / sqrt(kappa (kappa - 2 L)); solved for kappa.
    Infinite where no gain does it.

    Args:
        radius: wanted, m.
        lambda_min, f_bar, omega_bar, lipschitz: as in `theorem_1`.
    """
    drive = f_bar + omega_bar
    if lambda_min <= 0.0 or not math.isfinite(drive + lipschitz):
        return math.inf
    return (lipschitz + math.hypot(lipschitz, drive / radius)) / lambda_min


def disturbance_bound(sigma_max_B: float, lambda_min: float, agents: int, targets: int, largest: float) -> float:
    """omega_bar = (1 + sigma_max(B) / lambda_min(H)) sqrt(max(N, M)) max_i omega_bar_i, in m/s."""
    if largest == 0.0:
        return 0.0
    if lambda_min <= 0.0:
        return math.inf
    return (1.0 + sigma_max_B / lambda_min) * math.sqrt(max(agents, targets)) * largest
