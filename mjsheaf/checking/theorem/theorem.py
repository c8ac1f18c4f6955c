"""Theorem 1 of the paper: constants, gain condition, sets, and the bound on |e(t)|.

rho bounds the agents' drift: |f~| = |f_q(q*, t) - f_q(q, t)| <= rho(|e|) |e| with e = q* - q. The closed loop is
e' = -k1 H e + f_B + f~ + Delta, |f_B| <= f_bar, |Delta| <= omega_bar. With V = |e|^2 / 2, completing the square gives
V' <= -(k_min - rho(|e|)) |e|^2 + mu, in continuous time and while the run stays where rho and f_bar hold.

If rho is strictly increasing and unbounded, this is the paper's theorem unchanged (its proof writes rho once where it
means rho_bar). Here rho only has to be nondecreasing. chi is then any radius with rho(chi) <= k_min - lambda_V, the
largest that can be proven, and the argument still holds:

- D = {|e| <= chi} has rho(|e|) <= rho(chi) <= k_min - lambda_V, hence V' <= -2 lambda_V V + mu in it. This uses neither
  an inverse nor continuity of rho.
- There |e(t)|^2 is at most the estimate, a mean of |e_0|^2 and r^2 with r^2 = mu / lambda_V. For e_0 in
  S = {|e_0| <= chi - r} and r > 0 it is below (|e_0| + r)^2 <= chi^2: no solution reaches the boundary of D, so it
  never leaves. For r = 0, the drive is 0 and V' < 0 on the boundary. (Either way D itself is never left as long as
  r < chi: the paper's S is smaller than it need be.)
- The gain condition rho(2 r) < k_min - lambda_V makes chi >= 2 r, so r <= chi - r: U lies in S. A jump of rho exactly
  at 2 r would allow equality. To exclude it, the condition is required at slightly more than 2 r.

A constant rho gives an infinite chi: D and S are the whole space.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import exprel

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError

# The best rate is the supremum of those that satisfy a strict inequality; this fraction of it satisfies it.
_BELOW_SUPREMUM = 1.0 - 1e-9
# Radii at which rho is evaluated, and those subtracted from chi, are enlarged by this factor.
_OUTWARD = 1.0 + 1e-12


class Rho:
    """A bound of the slope of the drift, 1/s, as a function of a radius >= 0, m; infinite if nothing is known.

    It must be non-negative and nondecreasing. This is checked only on a grid: 0 and 1e-9 to 1e9 m, eight radii a
    decade. That it bounds the drift is the user's responsibility. NaN counts as infinite. Values of the function are
    used as they are, also if they were rounded down.

    Attributes:
        constant: True if it is a Lipschitz constant over the whole region.
    """

    def __init__(self, function: Callable[[float], float], *, constant: bool = False) -> None:
        """Wrap a function of the radius, m.

        Raises:
            InputError: The function is negative or decreases on the grid.
        """
        self._function = function
        self.constant = constant
        before, at = 0.0, 0.0
        for radius in (0.0,) if constant else (0.0, *np.logspace(-9, 9, 145).tolist()):
            value = self(radius)
            if value < before and not radius:
                raise InputError(f"rho(0) = {value:.6g}; expected a bound >= 0")
            if value < before:
                raise InputError(
                    f"rho({radius:.6g}) = {value:.6g} but rho({at:.6g}) = {before:.6g}; expected a bound >= 0 that "
                    "does not decrease"
                )
            before, at = value, radius

    def __call__(self, radius: float) -> float:
        """Evaluate the bound at a radius."""
        try:
            value = float(self._function(radius))
        except (OverflowError, ZeroDivisionError):  # of plain floats at large or infinite radii
            return math.inf
        return math.inf if math.isnan(value) else value

    def reach(self, level: float) -> float | None:
        """Return the largest radius s, m, with rho(s) <= level, less about 1e-15 of it; None if there is none."""
        if not self(0.0) <= level:
            return None
        if self(math.inf) <= level:
            return math.inf
        low = 1.0
        while low > 0.0 and not self(low) <= level:
            low *= 0.5
        while 0.0 < 2.0 * low < math.inf and self(2.0 * low) <= level:
            low *= 2.0
        return _bisect_down(lambda radius: self(radius) <= level, low, 2.0 * low)


def _bisect_down(
    holds: Callable[[float], bool],
    low: float,
    high: float,
    *,
    bisections: int = 64,
) -> float:
    """Return the largest number from `low` to `high` at which a condition holds; it must hold at `low`.

    If the condition is not monotone, the result is a number at which it holds, but perhaps not the largest. If `high`
    is infinite, `low` is returned.
    """
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        if not low < middle < high < math.inf:
            break
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


RhoLike = float | Sequence[float] | Sequence[tuple[float, float]] | Callable[[float], float] | Rho
"""See `as_rho`."""


def as_rho(rho: RhoLike) -> Rho:
    """Return a bound from one of its forms.

    Args:
        rho: A number L, 1/s, is a Lipschitz constant over the whole region, infinite if there is none. Coefficients
            c_k >= 0, in 1/s, 1/(m s), ..., give rho(s) = c_0 + c_1 s + c_2 s^2 + ... Pairs (radius_k in m, L_k in 1/s)
            are a table: rho(s) = L_k on (radius_{k-1}, radius_k], infinite beyond the last radius. L_k may be a
            Lipschitz constant of the drift over the tube of radius_k about the path of q*: q lies in the tube of
            radius |e|, with the whole segment from q* to q. A function takes a radius in m. A `Rho` is returned as is.

    Raises:
        InputError: It has none of these forms, or is not a valid bound.
    """
    if isinstance(rho, Rho):
        return rho
    if callable(rho):
        return Rho(rho)
    values = np.empty((0, 0))
    with suppress(TypeError, ValueError):
        values = np.asarray(rho, dtype=np.float64)
    if values.ndim == 0:
        if not values >= 0.0:
            raise InputError(f"rho is {rho}; expected a number >= 0")
        return Rho(lambda _: float(values), constant=True)
    if values.ndim == 1:
        if not (values.size and np.all((values >= 0.0) & (values < np.inf))):
            raise InputError(f"the coefficients of rho are {rho}; expected finite numbers >= 0")
        return Rho(partial(_polynomial, np.trim_zeros(values, "b").tolist() or [0.0]))
    if values.ndim == 2 and values.shape[1] == 2:
        radii, levels = values.T.tolist()
        rising = all(a < b for a, b in pairwise([0.0, *radii]))
        if not (radii and rising and all(a <= b for a, b in pairwise([0.0, *levels]))):
            raise InputError(
                f"the table of rho is {rho}; expected pairs (radius, L), radii increasing from above 0, "
                "L >= 0 and never smaller than before"
            )
        return Rho(lambda radius: [*levels, math.inf][bisect_left(radii, radius)])
    raise InputError(
        f"rho is {rho!r}; expected a number, coefficients c_0, c_1, ..., pairs (radius, L), or a function of the radius"
    )


def _polynomial(coefficients: list[float], radius: float) -> float:
    """Evaluate c_0 + c_1 s + ... with coefficients >= 0, rounded up."""
    *lower, value = coefficients
    for c in reversed(lower):
        value = c + value * radius
    # Horner's scheme without cancellation: each of its 2 n roundings costs at most 2^-53 of the value.
    return value * (1.0 + 4.0 * len(lower) * 2.0**-53)


@dataclass(frozen=True)
class Theorem:
    """The constants of Theorem 1, and its sets, which are balls about 0.

    Attributes:
        gain: k1, 1/s.
        lambda_min: Smallest eigenvalue of H.
        f_bar: Bound on |f_B|, m/s.
        omega_bar: Bound on |Delta|, m/s.
        rho: Bound of the drift's slope.
        k_min: k1 lambda_min / 2, 1/s.
        rate: lambda_V, 1/s; the best one unless given; 0 if none satisfies the gain condition.
        applies: True if the gain condition holds for `rate`.
        mu: (f_bar + omega_bar)^2 / (2 k1 lambda_min), m^2/s.
        radius: Radius of the ultimate set U, sqrt(mu / lambda_V), m; infinite if the condition fails.
        chi: Radius of D, which no solution that starts in S leaves, m; 0 if the condition fails.
        radius_S: Radius of S, chi - sqrt(mu / lambda_V), rounded down, m; 0 if the condition fails.
    """

    gain: float
    lambda_min: float
    f_bar: float
    omega_bar: float
    rho: Rho
    k_min: float
    rate: float
    applies: bool
    mu: float
    radius: float
    chi: float
    radius_S: float

    @property
    def lipschitz(self) -> float:
        """Bound of the drift's slope over all of D, rho(chi), 1/s; its Lipschitz constant if rho is constant."""
        return self.rho(self.chi)

    def contains(self, initial_error: float) -> bool:
        """Return True if the theorem applies and e_0 lies in S, for |e_0| in m."""
        return self.applies and initial_error <= self.radius_S

    def bound(self, initial_error: float, elapsed: ArrayLike) -> Array:
        """Return the theorem's bound on |e(t)|, m, at times since the start, s; infinite if there is none."""
        elapsed = np.asarray(elapsed, dtype=np.float64)
        if not self.contains(initial_error):
            return np.full(elapsed.shape, np.inf)
        decay = np.exp(-2.0 * self.rate * elapsed)
        grown = 2.0 * elapsed * exprel(-2.0 * self.rate * elapsed)  # (1 - decay) / rate, also for a tiny rate
        return np.sqrt(decay * initial_error**2 + self.mu * grown)


def theorem_1(
    gain: float,
    lambda_min: float,
    f_bar: float,
    omega_bar: float,
    rho: float | Rho,
    rate: float | None = None,
    initial_error: float | None = None,
) -> Theorem:
    """Evaluate Theorem 1.

    Args:
        gain: k1, 1/s.
        lambda_min: Smallest eigenvalue of H; 0 if the relative cohomology is not trivial.
        f_bar, omega_bar: Bounds on |f_B| and |Delta|, m/s.
        rho: Bound of the drift's slope, 1/s; a number is a constant bound.
        rate: lambda_V, 1/s; None selects the largest that satisfies the gain condition and, if possible, has the
            initial error in S: that gives the smallest ultimate set. Without an initial error S may be hardly larger
            than U.
        initial_error: |e_0|, m, used only for the choice of the rate.
    """
    rho = as_rho(rho)
    k_min = 0.5 * gain * lambda_min
    mu = (f_bar + omega_bar) ** 2 / (2.0 * gain * lambda_min) if k_min > 0.0 else math.inf

    def allowed(rate: float, start: float) -> float:
        """Return a rate up to which k_min - rate > rho(s), s the largest radius that matters at `rate`.

        It satisfies the inequality itself.
        """
        ultimate = math.sqrt(mu / rate) * _OUTWARD
        # Slopes over 2 r: the gain condition. Over |e_0| + r: chi reaches that far, which puts e_0 into S.
        return (k_min - rho(max(2.0 * ultimate, start * _OUTWARD + ultimate))) * _BELOW_SUPREMUM

    chosen = rate or 0.0
    if rate is None and mu < math.inf:
        # The largest rate that satisfies the gain condition and, if possible, has e_0 in S.
        chosen = _largest_fixed_point(lambda rate: allowed(rate, initial_error or 0.0), k_min)
        chosen = chosen or _largest_fixed_point(lambda rate: allowed(rate, 0.0), k_min)
    if not (chosen > 0.0 and mu < math.inf and chosen <= allowed(chosen, 0.0)):
        return Theorem(
            gain, lambda_min, f_bar, omega_bar, rho, k_min, rate or 0.0, False, mu, math.inf, chi=0.0, radius_S=0.0
        )
    radius = math.sqrt(mu / chosen)
    chi = rho.reach(k_min - chosen) or 0.0
    radius_S = chi if math.isinf(chi) else chi - radius * _OUTWARD  # a tiny rate makes the radius infinite, too
    return Theorem(gain, lambda_min, f_bar, omega_bar, rho, k_min, chosen, True, mu, radius, chi, radius_S)


def _largest_fixed_point(
    allowed: Callable[[float], float],
    most: float,
    *,
    descents: int = 1000,
) -> float:
    """Return the largest x in (0, most] with x <= allowed(x), or 0; `allowed` is nondecreasing and at most `most`.

    x, allowed(x), ... descends from above to the largest fixed point and never passes a solution (Tarski, Pacific J.
    Math. 5, 1955). If it is slow, bisection finds a solution that is perhaps not the largest.
    """
    x = most
    for _ in range(descents):
        following = allowed(x)
        if following >= x:
            return x
        if not following > 0.0:
            return 0.0
        x = following
    below = (x * (1.0 - 2.0**-k) for k in range(48, 0, -1))
    low = next((y for y in (x, *below) if y <= allowed(y)), 0.0)
    return _bisect_down(lambda y: y <= allowed(y), low, x) if low else 0.0


def least_gain(
    radius: float, lambda_min: float, f_bar: float, omega_bar: float, rho: float | Rho, initial_error: float = 0.0
) -> float:
    """Return a lower bound, 1/s, of all k1 with an ultimate radius of at most `radius`, m.

    For a constant rho, it is the smallest such k1.

    With kappa = k1 lambda_min, d = f_bar + omega_bar and an ultimate radius r, the rate is d^2 / (2 kappa r^2), and the
    conditions read kappa / 2 - d^2 / (2 kappa r^2) > rho(max(2 r, |e_0| + r)) >= rho(|e_0|). It is infinite if no gain
    satisfies them. Other arguments are those of `theorem_1`.
    """
    slope = as_rho(rho)(initial_error)
    return (slope + math.hypot(slope, (f_bar + omega_bar) / radius)) / lambda_min if lambda_min > 0.0 else math.inf


def disturbance_bound(sigma_max_B: float, lambda_min: float, agents: int, targets: int, largest: float) -> float:
    """Return omega_bar = (1 + sigma_max(B) / lambda_min(H)) sqrt(max(N, M)) max_i omega_bar_i, m/s."""
    if largest == 0.0:
        return 0.0
    if lambda_min <= 0.0:
        return math.inf
    return (1.0 + sigma_max_B / lambda_min) * math.sqrt(max(agents, targets)) * largest
