"""The smallest gain at which Theorem 1 gives a desired radius, certified at that gain.

The steepest slope of the flow is taken over a region that depends on the gain: a larger gain keeps the agents nearer to
q*, so that its region, its slope and its radius are smaller. For

    y' = -2 lambda_V y + 2 mu,    y = |e|^2,    lambda_V = k lambda_min / 2 - rho,    mu = d^2 / (2 k lambda_min)

is below the same with a smaller gain k and the same rho. So doubling finds a gain that gives the radius, and halves the
smallest one. That only guides the search: computed slopes are upper bounds that need not be monotone, and the gain that
is returned was certified with its own region, as `check` would at that gain.
"""

from dataclasses import dataclass

import numpy as np

from mjsheaf.checking.theorem.certificate import Certificate, Search, certificate_of, obstacle_of_law
from mjsheaf.checking.theorem.theorem import gain_for_radius

_ACCURACY = 1.01  # ratio of the result to the largest gain known to be too small
_MAX_DOUBLINGS = 30
_ABOVE = 1.0 + 1e-9  # factor on a solved gain, which may miss its radius by rounding


@dataclass(frozen=True)
class WantedGain:
    """The gain for a desired radius.

    Attributes:
        gain: Smallest k1 that was found, 1/s; None without any.
        reason: Reason for None, or empty.
    """

    gain: float | None
    reason: str = ""


def gain_for_wanted_radius(search: Search, certificate: Certificate, radius: float) -> WantedGain:
    """Find the smallest gain at which Theorem 1 applies with an ultimate radius of at most `radius`, m.

    Args:
        search: Search of the system; the best rate at each gain takes the place of its own.
        certificate: Certificate at the system's gain.
        radius: Desired radius, m.
    """
    c, spectrum = certificate.constants, certificate.spectrum
    obstacles = [obstacle_of_law(search.system), *(a.failure for a in certificate.assumptions[1:])]
    reason = next(filter(None, obstacles), "")
    if not reason and not (spectrum.lambda_min > 0.0 and np.isfinite([c.difference.bound, c.initial_error]).all()):
        reason = certificate.reason
    if reason:
        return WantedGain(None, reason)

    def gives(gain: float) -> bool:
        at = search.at_gain(gain)
        region = at.own_tube(None)
        if region is None:
            return False
        theorem = at.theorem(at.rho or region.rho.upper, None)
        return theorem.contains(c.initial_error) and theorem.radius <= radius

    rho = search.rho or c.moving.slope  # at least that of any region
    low = gain_for_radius(radius, spectrum.lambda_min, c.f_bar, c.moving.omega_bar, rho, c.initial_error)
    low = low or search.system.gain  # any gain does where nothing moves
    high = low * _ABOVE
    for _ in range(_MAX_DOUBLINGS):
        if not np.isfinite(high) or gives(high):
            break
        low, high = high, 2.0 * high
    else:
        high = np.inf
    if not np.isfinite(high):
        steep = "the flow is too steep, or singular, where the agents may be"
        return WantedGain(None, f"{steep}: no gain was found that confines them")
    while high > _ACCURACY * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if gives(middle) else (middle, high)
    there = certificate_of(search.at_gain(high))
    return WantedGain(high) if there.applies else WantedGain(None, f"it requires {high:.4g} 1/s, where {there.reason}")
