"""Theorem 1 for a system, before any run: its constants, the region over which they hold, and what it says.

The constants are taken over the tube that the theorem's own bound makes about q* (see `constants`). That is no circle.
Let b(t) be the theorem's bound with some rho, and let rho be at least the flow's largest slope over a tube that is a
little wider than b. As |e(t0)| <= b(t0), e is inside the tube for a while. As long as it is, the segments from q* to q
are too, |f~| <= rho |e|, and the theorem's proof gives |e| <= b: so e does not come to the tube's boundary, and never
leaves it. The search starts with the smallest rho.

Under a hold h with k1 h lambda_max <= 1 the bound holds too, but for a floor. Let F = f_bar + omega_bar,
a = k1 lambda_min and R = F / (a - rho). As I - s k1 H has the norm 1 - s a for s <= h, after a sample e_k

    |e(t_k + s)| <= (1 - s a) |e_k| + s (F + rho E),       E the largest |e| of the period so far.

Where |e_k| <= R, E > R would give E - R <= s rho (E - R) with s rho < 1: so |e| <= R, then and ever after. Where
|e_k| > R, E > |e_k| is contradicted in the same way, and |e| <= |e_k| - s ((a - rho) |e_k| - F) is below the solution
of y' = -(a - rho) y + F from |e_k|, which is convex and has this tangent; y is below the theorem's bound, as
(y^2)' <= -2 lambda_V y^2 + F^2 / a. So |e(t)| <= max(b(t), R), where R is at most the ultimate radius.

Where the gain condition fails, the same holds of the bound with rho = 0 and f_bar enlarged by 2 sqrt(N) sup |f_i|,
which needs no slope; its tube is the region then.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjsheaf.checking.assumptions import Assumption, decide
from mjsheaf.checking.cohomology import RelativeCohomology, Spectrum, explain, spectrum_of
from mjsheaf.checking.constants import (
    FARTHEST,
    Constants,
    Region,
    Tube,
    difference_along,
    speed_everywhere,
    tube_about,
    tube_guessed,
)
from mjsheaf.checking.targets import Carrier, follow_targets, own_rate
from mjsheaf.control.theorem import ConstantRho, Rho, Theorem, disturbance_bound, theorem_1
from mjsheaf.dynamics.disturbance import bounds
from mjsheaf.dynamics.effectiveness import without_full_row_rank
from mjsheaf.system import System
from mjsheaf.threads import one_thread

Array = NDArray[np.float64]
_MOST_ROUNDS = 30  # of the search for a rho that holds over its own tube
_RHO_STEP = 1.02  # the next rho, over the slope in the last tube
_TUBE_OVER_BOUND = 1.0 + 1e-6
_WORTH_NARROWING = 0.98  # of the weaker bound's radius: a smaller region is taken below it


@dataclass(frozen=True)
class Certificate:
    """What the theory says of a system.

    Attributes:
        spectrum: of H and B.
        cohomology: the relative cohomology, explained.
        region: where its constants were taken.
        constants: the constants.
        assumptions: the paper's seven, decided.
        theorem: Theorem 1 with these constants; its own `applies` is the gain condition alone.
        weaker: the bound that holds whatever the slopes: rho = 0, and f_bar enlarged by 2 sqrt(sum_i sup |f_i|^2).
        proven: whether a bound confines an unlimited law to the region; a guess proves nothing.
        approximate: whether the law is held over a period; the theorem's law is continuous.
        reason: why it does not apply; empty where the gain condition, every assumption and the rest hold.
        obstacle: what excludes any bound of continuous time, gain condition or not; or empty.
    """

    spectrum: Spectrum
    cohomology: RelativeCohomology
    region: Region
    constants: Constants
    assumptions: list[Assumption]
    theorem: Theorem
    weaker: Theorem
    proven: bool
    approximate: bool
    reason: str
    obstacle: str

    @property
    def applies(self) -> bool:
        """Whether the theorem applies."""
        return not self.reason

    def bound(self, initial_error: float, elapsed: Array) -> Array:
        """The bound on |e(t)| in m from |e(t0)| in m, at times since the start in s; infinite where there is none."""
        t = self.theorem
        bound = t.bound(initial_error, elapsed)
        if not self.approximate or not t.applies:
            return bound
        return np.maximum(bound, (t.f_bar + t.omega_bar) / (t.gain * t.lambda_min - t.lipschitz))

    def describe_constants(self) -> str:
        """The constants in a line, for a report of a bound that was broken."""
        t, c = self.theorem, self.constants
        return (
            f"k1 = {t.gain:.6g} 1/s, lambda_min = {t.lambda_min:.6g}, f_bar = {t.f_bar:.6g} m/s, "
            f"omega_bar = {t.omega_bar:.6g} m/s, rho = {t.lipschitz:.6g} 1/s, lambda_V = {t.rate:.6g} 1/s, "
            f"|e(t0)| = {c.initial_error:.6g} m"
        )


@one_thread
def certify(system: System, rate: float | None = None, rho: Rho | None = None) -> Certificate:
    """Decide what the theory says of a system.

    Args:
        system: the system.
        rate: lambda_V in 1/s; None takes the best.
        rho: the user's own bound of the agents' slopes, for all |e|; None takes the flow's over the region.
    """
    search = _Search(system, rate, rho)
    region, constants, theorem = search.region()
    weaker = search.weaker(constants.speed.upper)
    cohomology = explain(system.team, search.spectrum)
    obstacle = _obstacle(system, constants, search.spectrum, theorem if theorem.applies else weaker)
    proven = region.verified
    region = replace(region, verified=proven and not obstacle)
    assumptions = decide(system, region, constants, cohomology)
    reason = _gain_condition(region, constants, search.spectrum, theorem, rate)
    if not reason and not proven:
        reason = region.source
    return Certificate(
        spectrum=search.spectrum,
        cohomology=cohomology,
        region=region,
        constants=constants,
        assumptions=assumptions,
        theorem=theorem,
        weaker=weaker,
        proven=proven,
        approximate=not system.grid.continuous,
        reason=reason or obstacle or next((a.failure for a in assumptions if a.failure), ""),
        obstacle=obstacle,
    )


class _Search:
    """The region over which a bound confines the agents to itself, and the constants there."""

    def __init__(self, system: System, rate: float | None, rho: Rho | None) -> None:
        team = system.team
        self._system, self._rate, self._rho = system, rate, rho
        self.spectrum = spectrum_of(team)
        self._carrier = Carrier(system, self.spectrum)
        self._path = follow_targets(system, self._carrier)
        self._difference = difference_along(system, self._path, self._carrier)
        self._largest = float(bounds(system.harmonics).max(initial=0.0))
        self._omega_bar = disturbance_bound(
            self.spectrum.sigma_max_B, self.spectrum.lambda_min, len(team.agents), len(team.targets), self._largest
        )
        n_q = team.dirichlet.H.shape[0]
        self._initial_error = float(np.linalg.norm(self._path.q_star[0] - team.pack(system.initial)[:n_q]))

    def region(self) -> tuple[Region, Constants, Theorem]:
        """The region, the constants over it, and Theorem 1 with these."""
        if self._path.cells is None:
            return self._guess(f"the targets' path is not known: {self._path.warning}")
        if self.spectrum.lambda_min <= 0.0:
            return self._guess("the harmonic extension is not unique")
        for rate in dict.fromkeys([self._rate, None]):  # the best rate, where the wanted one is too fast
            theorem, tube = self._own_slope(rate)
            if tube is not None:
                region, constants, found = self._over(tube, "a tube about q* as wide as the bound", True)
                if self._rho is not None:
                    return region, constants, found
                # The assumed slope may be a little more than the tube's.
                rho = replace(constants.rho, upper=theorem.lipschitz)
                return region, replace(constants, rho=rho), self._theorem(rho.upper, self._rate)
        weaker = self.weaker(speed_everywhere(self._system))
        if not self._confines(weaker):
            return self._guess("no bound confines the agents")
        tube = self._tube(weaker).joined()
        narrower = self.weaker(tube.speed.upper)
        if narrower.radius < _WORTH_NARROWING * weaker.radius:
            tube = self._tube(narrower).joined()
        return self._over(tube, "a tube about q* as wide as the weaker bound", True)

    def weaker(self, speed: float) -> Theorem:
        """The bound with rho = 0, where f~ = f_q(q*) - f_q(q) is at most twice the flow's speed for each agent."""
        return self._theorem(0.0, None, 2.0 * np.sqrt(len(self._system.team.agents)) * speed)

    def _theorem(self, rho: float | Rho, rate: float | None, more: float = 0.0) -> Theorem:
        f_bar = self._difference.bound + more
        return theorem_1(
            self._system.gain, self.spectrum.lambda_min, f_bar, self._omega_bar, rho, rate, self._initial_error
        )

    def _own_slope(self, rate: float | None) -> tuple[Theorem, Tube | None]:
        """Theorem 1 with a rho that holds over the tube of its own bound, and that tube; None where there is none."""
        if self._rho is not None:
            theorem = self._theorem(self._rho, rate)
            return theorem, self._tube(theorem) if self._confines(theorem) else None
        theorem = self._theorem(0.0, rate)
        for _ in range(_MOST_ROUNDS):
            if not self._confines(theorem):
                break
            tube = self._tube(theorem)
            if tube.slope.upper <= theorem.lipschitz:
                return theorem, tube
            theorem = self._theorem(_RHO_STEP * tube.slope.upper, rate)
        return theorem, None

    def _confines(self, bound: Theorem) -> bool:
        """Whether a bound keeps the agents in a region that can be looked at."""
        return bound.contains(self._initial_error) and max(bound.radius, self._initial_error) < FARTHEST

    def _tube(self, bound: Theorem) -> Tube:
        """The tube of a bound; under a hold as wide everywhere as it is at most."""
        start, system = self._path.time[0], self._system

        def radius(time: Array) -> Array:
            if system.grid.continuous:
                return _TUBE_OVER_BOUND * bound.bound(self._initial_error, time - start)
            return np.full(
                time.shape, _TUBE_OVER_BOUND * max(self._initial_error, bound.radius)
            )  # R is at most the radius

        return tube_about(system, self._path, self._carrier, radius)

    def _over(self, tube: Tube, source: str, verified: bool) -> tuple[Region, Constants, Theorem]:
        constants = Constants(
            difference=self._difference,
            rho=tube.slope,
            speed=tube.speed,
            largest_disturbance=self._largest,
            omega_bar=self._omega_bar,
            initial_error=self._initial_error,
        )
        theorem = self._theorem(self._rho or constants.rho.upper, self._rate)
        return Region(self._path, tube, source, verified), constants, theorem

    def _guess(self, why: str) -> tuple[Region, Constants, Theorem]:
        source = f"a guess from initial positions and q*: {why}"
        return self._over(tube_guessed(self._system, self._path), source, False)


def _gain_condition(
    region: Region, constants: Constants, spectrum: Spectrum, theorem: Theorem, rate: float | None
) -> str:
    """Why there is no bound by Theorem 1, or an empty string where there is."""
    if region.path.warning:
        return f"the targets' path is not known: {region.path.warning}"
    if spectrum.lambda_min <= 0.0:
        return "lambda_min(H) is 0: the harmonic extension is not unique"
    rho = theorem.rho(constants.initial_error)
    if not np.isfinite(constants.difference.bound):
        return "the targets' drift or the flow at q* is unbounded along the targets' path"
    if not np.isfinite(rho):
        at = f"the initial error of {constants.initial_error:.4g} m"
        given = not isinstance(theorem.rho, ConstantRho)
        return f"rho is infinite at {at}" if given else "a field is singular inside the region"
    if theorem.contains(constants.initial_error):
        return ""
    if theorem.applies:
        outside = f"the initial error of {constants.initial_error:.4g} m is outside S"
        return f"{outside}, whose radius is {theorem.radius_S:.4g} m"
    if rate is not None and theorem.k_min > rho:
        return f"lambda_V = {rate:.4g} 1/s is too fast: it must be below k_min - rho = {theorem.k_min - rho:.4g} 1/s"
    return (
        f"k_min = {theorem.k_min:.4g} 1/s does not exceed rho = {rho:.4g} 1/s; "
        f"that takes a gain above {2.0 * rho / spectrum.lambda_min:.4g} 1/s"
    )


def _obstacle(system: System, constants: Constants, spectrum: Spectrum, bound: Theorem) -> str:
    """Why no bound of the continuous, unlimited law holds: g lacks full rank, a hold, a speed limit; or empty."""
    agents = system.team.agents
    for i in without_full_row_rank(system.effectiveness, [agent.dimension for agent in agents]):
        return f"g of {agents[i].id} is not of full row rank: g g^+ is not the identity"
    if not system.grid.continuous:
        product = system.gain * system.grid.period * spectrum.lambda_max
        if product >= 1.0:
            what = "diverges" if product >= 2.0 else "rings"
            return f"the held law {what} (k1 h lambda_max = {product:.3g}): a bound of continuous time says nothing"
        if (product := own_rate(system) * system.grid.period) >= 2.0:
            return (
                "the targets' own held consensus and pull may diverge "
                f"(h times a bound on their rate is {product:.3g}, expected below 2)"
            )
    limit = float(system.law.limit[: len(agents)].min())
    asked = system.gain * spectrum.lambda_max * max(constants.initial_error, bound.radius)
    if np.isfinite(limit) and asked > limit:
        return f"the law may ask for {asked:.3g} m/s, beyond a speed limit of {limit:.3g} m/s"
    return ""
