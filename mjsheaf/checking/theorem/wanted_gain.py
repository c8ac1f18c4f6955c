"""The smallest gain at which Theorem 1 gives a desired radius, certified at that gain.

The steepest slope rho of the flow is taken over a region that depends on the gain: a larger gain keeps the agents
nearer to q*. So the gain that a region's rho requires need not be one at which that rho holds. Here each gain is tried
with its own region (`Search.own_tube`), and the one that is returned has been certified as `check` would at that gain.

Let rho(k) be the slope over the tube of gain k, and Phi(k) = `gain_for_radius` of that slope: k gives the radius
exactly if Phi(k) <= k. A larger gain has a narrower tube, for

    y' = -2 lambda_V y + 2 mu,    y = |e|^2,    lambda_V = k lambda_min / 2 - rho,    mu = d^2 / (2 k lambda_min)

is below the same with a smaller gain and the same rho. So rho and Phi do not increase with k, and:

- If k gives the radius, all smaller gains than Phi(k) do not: theirs are steeper slopes, which require more.
- If k does not, Phi(k) does, where k has a region at all.

Both narrow the interval that holds the smallest gain. They only guide the search: computed slopes are upper bounds that
need not be monotone, and nothing is returned that was not certified.
"""

from dataclasses import dataclass

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.checking.theorem.certificate import (
    RHO_STEP,
    Certificate,
    Search,
    certificate_of,
    obstacle_of_law,
)
from mjsheaf.control.theorem import gain_for_radius

_ACCURACY = 1.01  # ratio of the result to the largest gain known to be too small
_MAX_TRIALS = 20  # gains
_RADII = 0.5 ** np.arange(12)  # times the desired radius: tubes for a gain that surely suffices
_ABOVE = 1.0 + 1e-9  # factor on a solved gain, which may miss its radius by rounding
_RESERVES = (1.0, 1.02, 1.1)  # factors on a gain that should suffice: computed slopes need not be monotone


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
    obstacles = [obstacle_of_law(search.system), *(a.failure for a in certificate.assumptions[1:])]
    reason = next(filter(None, obstacles), "")
    if reason:
        return WantedGain(None, reason)
    finite = np.isfinite([certificate.constants.difference.bound, certificate.constants.initial_error])
    if certificate.spectrum.lambda_min <= 0.0 or not finite.all():
        return WantedGain(None, certificate.reason)
    gain = _Trials(search, certificate, radius).smallest()
    if gain is None:
        steep = "the flow is too steep, or singular, where the agents may be"
        return WantedGain(None, f"{steep}: no gain was found that confines them")
    there = certificate_of(search.at_gain(gain))
    if not there.applies:
        return WantedGain(None, f"it requires {gain:.4g} 1/s, where {there.reason}")
    if not there.theorem.radius <= radius:
        return WantedGain(None, "no gain was found whose own region gives this radius")
    return WantedGain(gain)


class _Trials:
    """Gains that are tried for a radius.

    Attributes:
        below: Lower bound of the gains that give the radius, 1/s.
        does: Smallest gain found that gives the radius, 1/s; infinite without any.
    """

    def __init__(self, search: Search, certificate: Certificate, radius: float) -> None:
        self._search, self._certificate, self._radius = search, certificate, radius
        self._left = _MAX_TRIALS
        self.below, self.does = self._needed(0.0) * _ABOVE, np.inf
        theorem = certificate.theorem
        if certificate.applies and search.rate is None and theorem.radius <= radius:
            self.does = theorem.gain
            self._narrow(self._needed(certificate.region.rho.upper))

    def smallest(self) -> float | None:
        """Return the smallest gain found that gives the radius, 1/s; None without any."""
        asked = self._try(self.below)
        if self.does <= self.below:
            return self.does
        self._find_any(asked)
        while self._left > 0 and self.below * _ACCURACY < self.does < np.inf:
            asked = self._try(float(np.sqrt(self.below * self.does)))
            if self.below < asked < self.does:
                self._try(asked * _ABOVE)
        return self.does if np.isfinite(self.does) else None

    def _find_any(self, asked: float) -> None:
        """Look for a gain that gives the radius, first near one that the slope of a region requires."""
        if np.isfinite(asked):
            self._reach(asked)
        if not np.isfinite(self.does):
            for gain in sorted(self._sure()):
                if self._left > 0 and not np.isfinite(self.does):
                    self._reach(gain)

    def _reach(self, gain: float) -> None:
        """Try a gain that should give the radius, and slightly larger ones if it does not."""
        for reserve in _RESERVES:
            if gain * reserve * _ABOVE >= self.does:
                return
            self._try(gain * reserve * _ABOVE)

    def _try(self, gain: float) -> float:
        """Try a gain, and return the one that its region requires, 1/s; infinite where it has no region."""
        self._left -= 1
        at = self._search.at_gain(gain)
        region = at.own_tube(None)
        if region is None:
            self.below = max(self.below, gain)
            return np.inf
        theorem = at.theorem(at.rho or region.rho.upper, None)
        asked = self._needed(region.rho.upper)
        if theorem.contains(self._certificate.constants.initial_error) and theorem.radius <= self._radius:
            self.does = min(self.does, gain)
            self._narrow(asked)
        else:
            self.below = max(self.below, gain)
        return asked

    def _narrow(self, asked: float) -> None:
        """Raise the lower end: no gain below the one that a region requires gives the radius."""
        self.below = max(self.below, min(asked, self.does))

    def _needed(self, slope: float) -> float:
        """Return the gain that a slope, or the user's own bound, requires, 1/s."""
        c, spectrum = self._certificate.constants, self._certificate.spectrum
        rho = self._search.rho or slope + c.moving.slope
        return gain_for_radius(self._radius, spectrum.lambda_min, c.f_bar, c.moving.omega_bar, rho, c.initial_error)

    def _sure(self) -> Array:
        """Return gains that give the radius: the bound then stays in a tube of a fixed radius, with the slope there.

        With e_0 and the ultimate radius r within s = max(|e_0|, r), the bound never leaves the tube of the radius s.
        """
        c, spectrum = self._certificate.constants, self._certificate.spectrum
        gains = []
        for r in self._radius * _RADII:
            wide = max(float(r), c.initial_error)
            slope = RHO_STEP * self._search.tube_of(wide).slope.upper + c.moving.slope
            gains.append(gain_for_radius(float(r), spectrum.lambda_min, c.f_bar, c.moving.omega_bar, slope))
            if wide > r:
                break
        finite = np.array(gains)
        return finite[np.isfinite(finite)]
