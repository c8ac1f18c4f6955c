"""Theorem 1 for a system before a run: its constants, the region over which they hold, and its bound.

The constants are taken over the tube around q* that the theorem's own bound defines (see `constants`). This is not
circular. Let b(t) be the theorem's bound with some rho, and let rho be at least the flow's largest slope over a tube
slightly wider than b. Because |e(t0)| <= b(t0), e is inside the tube at first. While it is, the segments from q* to q
are too, |f~| <= rho |e|, and the theorem's proof gives |e| <= b. So e never reaches the boundary of the tube and never
leaves it. The search starts with the smallest rho.

With a hold h and k1 h lambda_max <= 1 the bound also holds, down to a floor. Let F = f_bar + omega_bar,
a = k1 lambda_min and R = F / (a - rho). Because I - s k1 H has norm 1 - s a for s <= h, after a sample e_k

    |e(t_k + s)| <= (1 - s a) |e_k| + s (F + rho E),       E the largest |e| since the sample.

If |e_k| <= R, then E > R would give E - R <= s rho (E - R) with s rho < 1, a contradiction. So |e| <= R from then on.
If |e_k| > R, then E > |e_k| is contradicted in the same way. So |e| <= |e_k| - s ((a - rho) |e_k| - F), which is below
the solution y of y' = -(a - rho) y + F from |e_k|, because y is convex and has this tangent. And y is below the
theorem's bound, because (y^2)' <= -2 lambda_V y^2 + F^2 / a. So |e(t)| <= max(b(t), R), where R is at most the
ultimate radius.

If the gain condition fails, the same is true of the bound with rho = 0 and f_bar enlarged by 2 sqrt(N) sup |f_i|, which
needs no slope. The region is then the tube of that bound.

This module also decides the paper's numbered assumptions, each with the number behind its verdict and a witness.
"""

from copy import copy
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.checking.repairs import label_parts, unsensed_targets
from mjsheaf.checking.spectrum import RelativeCohomology, Spectrum, explain, spectrum_of
from mjsheaf.checking.theorem.constants import (
    FARTHEST,
    Constants,
    Region,
    Tube,
    bound_moving,
    difference_along,
    speed_everywhere,
    tube_about,
    tube_guessed,
)
from mjsheaf.checking.theorem.flow_bounds import singular_points
from mjsheaf.checking.theorem.targets import Carrier, follow_targets, targets_loop
from mjsheaf.checking.theorem.theorem import Rho, Theorem, least_gain, theorem_1
from mjsheaf.errors import select_true
from mjsheaf.loop.system import System
from mjsheaf.section import Finite, Record
from mjsheaf.team import Edge, Team
from mjsheaf.threads import one_thread
from mjsheaf.vehicles.allocation import is_rank_deficient, without_full_row_rank

FILTERED = "the filter that keeps vehicles apart may act; undecided while it does"
"""Why there is no bound on an error with a section `safety`."""

Verdict = Literal["holds", "fails", "undecided", "does not apply"]
Finding = tuple[Verdict, float | None, str, str]
"""Verdict, value, unit and witness of an assumption."""


class Assumption(Record):
    """A numbered assumption of the paper."""

    number: int
    name: str
    verdict: Verdict
    holds: bool | None = Field(description="null if it is undecided or does not apply")
    applies: bool = Field(
        description="false if it is about other teams, or gusts are Gaussian; then it does not count in `ok`"
    )
    value: Finite
    unit: str
    witness: str

    @property
    def failure(self) -> str:
        """Reason why it does not hold, in a sentence; empty if it holds."""
        word = {"holds": "", "fails": "fails", "undecided": "is undecided"}.get(self.verdict, self.verdict)
        return word and f"assumption {self.number} {word}: {self.witness}"


@dataclass(frozen=True)
class Certificate:
    """Result of the theory for a system.

    Attributes:
        spectrum: Spectrum of H and sigma_max(B).
        cohomology: Relative cohomology, explained.
        constants: Constants along the targets' path.
        region: Region that holds the agents.
        assumptions: Verdicts on the paper's seven assumptions.
        theorem: Theorem 1 with these constants; its own `applies` is the gain condition alone.
        weaker: Bound that holds for any slope: rho = 0, and f_bar enlarged by 2 sqrt(sum_i sup |f_i|^2).
        approximate: True if the law is held over a period; the theorem's law is continuous.
        reason: Reason why the theorem does not apply; empty if it does.
        obstacle: Reason why no bound of continuous time exists, with or without the gain condition; or empty.
    """

    spectrum: Spectrum
    cohomology: RelativeCohomology
    constants: Constants
    region: Region
    assumptions: list[Assumption]
    theorem: Theorem
    weaker: Theorem
    approximate: bool
    reason: str
    obstacle: str

    @property
    def applies(self) -> bool:
        """Return True if the theorem applies."""
        return not self.reason

    def bound(self, initial_error: float, elapsed: Array) -> Array:
        """Return the bound on |e(t)|, m, from |e(t0)|, m, at times since the start, s; infinite if there is none."""
        return self._bound(self.theorem, initial_error, elapsed)

    def at_end(self, elapsed: float) -> float:
        """Return the smaller of this bound and the weaker one, m, at a time since the start, s; infinite without."""
        start, time = self.constants.initial_error, np.array(elapsed)
        weaker = self._bound(self.weaker, start, time) if self.region.verified and not self.obstacle else np.inf
        return float(min(weaker, self.bound(start, time) if self.applies else np.inf))

    def _bound(self, theorem: Theorem, initial_error: float, elapsed: Array) -> Array:
        bound = theorem.bound(initial_error, elapsed)
        if not self.approximate or not theorem.applies:
            return bound
        held = theorem.gain * theorem.lambda_min - theorem.lipschitz
        return np.maximum(bound, (theorem.f_bar + theorem.omega_bar) / held)


@one_thread
def certify(
    system: System, rate: float | None = None, rho: Rho | None = None, initial_error: float | None = None
) -> Certificate:
    """Decide what the theory says of a system.

    Args:
        system: The system.
        rate: lambda_V, 1/s; None selects the best.
        rho: User's bound on the agents' slopes, for all |e|; None uses the flow's bound over the region.
        initial_error: Bound on |e(t0)|, m; infinite without one; None uses that of the initial positions.
    """
    return certificate_of(Search(system, rate, rho, initial_error))


def certificate_of(search: "Search") -> Certificate:
    """Find the region of a search, and decide what the theory says there."""
    system = search.system
    region = search.region()
    theorem = search.theorem(search.rho or region.rho.upper, search.rate)
    weaker = search.weaker(region.tube.speed.upper)
    cohomology = explain(system.team, search.spectrum)
    obstacle = (
        obstacle_of_team(system.team)
        or obstacle_of_law(system)
        or obstacle_of_gain(system, search.constants, search.spectrum, theorem if theorem.applies else weaker)
    )
    assumptions = _decide(system, region, region.verified and not obstacle, search.constants, cohomology)
    failed = next((a.failure for a in assumptions if a.failure), "")
    constants = search.constants
    unknown = {
        "the error with which the phase begins is not known": not np.isfinite(constants.initial_error),
        f"the targets' path is not known: {constants.path.warning}": constants.path.warning,
        "lambda_min(H) is 0: the harmonic extension is not unique": search.spectrum.lambda_min <= 0.0,
        "the targets' drift or the flow at q* is unbounded along the targets' path": not np.isfinite(
            constants.difference.bound
        ),
    }
    unbounded = (
        obstacle_of_team(system.team)
        or targets_loop(system).failure
        or next(iter(select_true(unknown)), "")
        or _gain_condition(theorem, constants.initial_error, search.rate, region)
        or ("" if region.verified else region.source)
    )
    return Certificate(
        spectrum=search.spectrum,
        cohomology=cohomology,
        constants=search.constants,
        region=region,
        assumptions=assumptions,
        theorem=theorem,
        weaker=weaker,
        approximate=not system.grid.continuous,
        reason=unbounded or obstacle or failed,
        obstacle=obstacle,
    )


class Search:
    """The constants along the targets' path, and the search for a region to which a bound confines the agents.

    Attributes:
        system: System under the law.
        rate: Rate lambda_V, 1/s; None selects the best.
        rho: User's bound on the agents' slopes; None selects the flow's bound over the region.
        spectrum: Spectrum of H and sigma_max(B).
        constants: Constants along the targets' path.
    """

    def __init__(
        self, system: System, rate: float | None = None, rho: Rho | None = None, initial_error: float | None = None
    ) -> None:
        """Follow the targets; see `certify`."""
        self.system = system = system.local
        self.rate = rate
        self.rho = rho
        self.spectrum = spectrum = spectrum_of(system.team)
        self._carrier = Carrier(system)
        path = follow_targets(system, self._carrier)
        difference = difference_along(system, path, self._carrier)
        moving, level = bound_moving(system, path, self._carrier, spectrum, difference.bound)
        if initial_error is None:
            initial_error = float(np.linalg.norm(path.q_star[0] - system.team.split(system.initial)[0]))
        self.constants = Constants(
            path=path,
            difference=difference,
            moving=level if rho is not None else moving,
            level=level,
            initial_error=initial_error,
        )

    def at_gain(self, gain: float) -> "Search":
        """Return the same search for the paper's law at another gain and the best rate, from the same |e(t0)|."""
        other = copy(self)
        gains = self.system.law.gain.copy()
        gains[: len(self.system.team.agents)] = gain
        other.system = replace(self.system, gain=gain, law=self.system.law._replace(gain=gains))
        other.rate = None
        return other

    def region(
        self,
        *,
        worth: float = 0.98,  # largest ratio of radii at which the tube is computed again
    ) -> Region:
        """Return the region: a tube to which a bound confines the agents, or a guess if no bound does."""
        if self.constants.path.cells is None:
            return self._guess(f"the targets' path is not known: {self.constants.path.warning}")
        if self.spectrum.lambda_min <= 0.0:
            return self._guess("the harmonic extension is not unique")
        if not np.isfinite(self.constants.initial_error):
            return self._guess("the error with which the phase begins is not known")
        for rate in dict.fromkeys([self.rate, None]):  # the best rate if the requested one is too fast
            if (region := self.own_tube(rate)) is not None:
                return region
        weaker = self.weaker(speed_everywhere(self.system))
        if not self._confines(weaker):
            return self._guess("no bound confines the agents")
        tube = self.tube(weaker).joined()
        narrower = self.weaker(tube.speed.upper)
        if narrower.radius < worth * weaker.radius:
            tube = self.tube(narrower).joined()
        return Region(tube, "a tube about q* as wide as the weaker bound", True, tube.slope)

    def weaker(self, speed: float) -> Theorem:
        """Return the bound with rho = 0; f~ = f_q(q*) - f_q(q) is at most twice the flow's speed for each agent."""
        c, gain = self.constants, self.system.gain
        f_bar = c.difference.bound + c.level.f_bar + 2.0 * np.sqrt(len(self.system.team.agents)) * speed
        return theorem_1(gain, self.spectrum.lambda_min, f_bar, c.level.omega_bar, 0.0, None, c.initial_error)

    def theorem(self, rho: float | Rho, rate: float | None) -> Theorem:
        """Evaluate Theorem 1 with a rho of the steady flow, or with the user's own rho for all of it."""
        c, gain = self.constants, self.system.gain
        whole = rho if isinstance(rho, Rho) else rho + c.moving.slope
        return theorem_1(gain, self.spectrum.lambda_min, c.f_bar, c.moving.omega_bar, whole, rate, c.initial_error)

    def own_tube(
        self,
        rate: float | None,
        *,
        rounds: int = 30,  # of the search for a rho that holds over its own tube
        step: float = 1.02,  # next rho that is tried, relative to the slope in the last tube
    ) -> Region | None:
        """Return the tube of Theorem 1's own bound, with a rho that holds over it; None if none is found."""
        slope = 0.0
        for _ in range(rounds):
            theorem = self.theorem(self.rho or slope, rate)
            if not self._confines(theorem):
                return None
            tube = self.tube(theorem)
            if self.rho is not None or tube.slope.upper <= slope:
                # The assumed slope may be a little more than the tube's.
                return Region(
                    tube,
                    "a tube about q* as wide as the bound",
                    True,
                    tube.slope if self.rho is not None else replace(tube.slope, upper=slope),
                )
            slope = step * tube.slope.upper
        return None

    def _confines(self, bound: Theorem) -> bool:
        """Return True if a bound keeps the agents within a region of finite, searchable size."""
        return (
            bound.contains(self.constants.initial_error) and max(bound.radius, self.constants.initial_error) < FARTHEST
        )

    def tube(
        self,
        bound: Theorem,
        *,
        wider: float = 1.0 + 1e-6,
    ) -> Tube:
        """Return the tube of a bound; under a hold, its radius is the largest one throughout."""
        path, start = self.constants.path, self.constants.initial_error

        def radius(time: Array) -> Array:
            held = np.full(time.shape, max(start, bound.radius))  # R is at most the radius
            within = bound.bound(start, time - path.time[0]) if self.system.grid.continuous else held
            return wider * within

        return tube_about(self.system, path, self._carrier, radius)

    def _guess(self, why: str) -> Region:
        tube = tube_guessed(self.system, self.constants.path)
        return Region(tube, f"a guess from initial positions and q*: {why}", False, tube.slope)


def _gain_condition(theorem: Theorem, initial_error: float, rate: float | None, region: Region) -> str:
    """Return why the gain condition fails, or the error begins outside S; empty if neither is the case."""
    rho = theorem.rho(initial_error)
    start = f"the initial error of {initial_error:.4g} m"
    constant = theorem.rho.constant
    if not np.isfinite(rho):
        return "a field is singular inside the region" if constant else f"rho is infinite at {start}"
    if theorem.contains(initial_error):
        return ""
    if theorem.applies:
        return f"{start} is outside S, whose radius is {theorem.radius_S:.4g} m"
    if rate is not None and theorem.k_min > rho:
        return f"lambda_V = {rate:.4g} 1/s is too fast: it must be below k_min - rho = {theorem.k_min - rho:.4g} 1/s"
    where = f"the steepest slope over {region.source}" if constant else f"at {start}"
    return f"k_min = {theorem.k_min:.4g} 1/s does not exceed rho = {rho:.4g} 1/s, {where}"


def obstacle_of_team(team: Team) -> str:
    """Return why Theorem 1 does not apply to a team at all; or empty."""
    if team.directed:
        return "does not apply: H is not symmetric, as communication edges are directed"
    if team.free:
        return "does not apply: the team has no targets and no anchors, and holds a shape instead of places"
    if team.linearised_at is not None:
        return "does not apply: edges measure ranges or bearings, and what is said of their linearisation is local"
    return ""


def obstacle_of_law(system: System) -> str:
    """Return why no bound of the continuous, unlimited law holds at any gain (links, rank of g, targets); or empty."""
    if len(system.law.links.table):
        return "links are not exact: the theorem's agents measure everything at once, without error"
    return obstacle_of_rank(system) or targets_loop(system).failure


def obstacle_of_rank(system: System) -> str:
    """Name the first agent whose g is not of full row rank; empty if there is none."""
    for i in without_full_row_rank(system.effectiveness, [agent.dimension for agent in system.team.agents]):
        return f"g of {system.team.agents[i].id} is not of full row rank: g g^+ is not the identity"
    return ""


def obstacle_of_gain(system: System, constants: Constants, spectrum: Spectrum, bound: Theorem) -> str:
    """Return why no bound of the continuous, unlimited law holds at this gain (hold, limit, filter); or empty."""
    if not system.grid.continuous:
        product = system.gain * system.grid.period * spectrum.lambda_max
        if product >= 1.0:
            what = "diverges" if product >= 2.0 else "rings"
            return f"the held law {what} (k1 h lambda_max = {product:.3g}): the continuous-time bound does not apply"
    if system.safety is not None:
        return FILTERED
    limit = float(system.law.limit[: len(system.team.agents)].min())
    asked = system.gain * spectrum.lambda_max * max(constants.initial_error, bound.radius)
    return (
        f"the law may command {asked:.3g} m/s, above a speed limit of {limit:.3g} m/s"
        if np.isfinite(limit) and asked > limit
        else ""
    )


def gain_for_wanted_radius(
    search: Search, certificate: Certificate, radius: float, *, accuracy: float = 1.01, doublings: int = 30
) -> tuple[float | None, str]:
    """Find the smallest gain at which Theorem 1 applies with an ultimate radius of at most `radius`, m.

    The steepest slope of the flow is taken over a region that depends on the gain: a larger gain keeps the agents
    nearer to q*, so that its region, its slope and its radius are smaller. For

        y' = -2 lambda_V y + 2 mu,    y = |e|^2,    lambda_V = k lambda_min / 2 - rho,    mu = d^2 / (2 k lambda_min)

    is below the solution with a smaller gain k and the same rho. So doubling finds a gain that gives the radius, and
    bisection the smallest one. This only guides the search: computed slopes are upper bounds and need not be monotone.
    The gain that is returned was certified with its own region, as `check` does at that gain.

    Args:
        search: Search of the system; its rate is replaced by the best one at each gain.
        certificate: Certificate at the system's gain.
        radius: Desired radius, m.
        accuracy: Ratio of the result to the largest gain known to be too small.
        doublings: Largest number of doublings.

    Returns:
        The smallest k1 that was found, 1/s, or None; and the reason for None, or empty.
    """
    c, spectrum = certificate.constants, certificate.spectrum
    obstacles = [obstacle_of_law(search.system), *(a.failure for a in certificate.assumptions[1:])]
    reason = next(filter(None, obstacles), "")
    if not reason and not (spectrum.lambda_min > 0.0 and np.isfinite([c.difference.bound, c.initial_error]).all()):
        reason = certificate.reason
    if reason:
        return None, reason

    def gives(gain: float) -> bool:
        at = search.at_gain(gain)
        region = at.own_tube(None)
        if region is None:
            return False
        theorem = at.theorem(at.rho or region.rho.upper, None)
        return theorem.contains(c.initial_error) and theorem.radius <= radius

    rho = search.rho or c.moving.slope  # at least that of any region
    low = least_gain(radius, spectrum.lambda_min, c.f_bar, c.moving.omega_bar, rho, c.initial_error)
    low = low or search.system.gain  # any gain is large enough if nothing moves
    high = low * (1.0 + 1e-9)  # it may miss its radius by rounding
    for _ in range(doublings):
        if not np.isfinite(high) or gives(high):
            break
        low, high = high, 2.0 * high
    else:
        high = np.inf
    if not np.isfinite(high):
        steep = "the flow is too steep, or singular, where the agents may be"
        return None, f"{steep}: no gain was found that confines them"
    while high > accuracy * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if gives(middle) else (middle, high)
    there = certificate_of(search.at_gain(high))
    return (high, "") if there.applies else (None, f"it requires {high:.4g} 1/s, where {there.reason}")


# -- the paper's assumptions -----------------------------------------------------------------------------------


def _decide(
    system: System, region: Region, confined: bool, constants: Constants, cohomology: RelativeCohomology
) -> list[Assumption]:
    """Decide all seven assumptions over a region; `confined` is True if the agents provably stay in it."""
    smooth, (rank, inverse) = _smooth(system, region, confined, constants), _rank_and_inverse(system)
    trivial: Finding = "does not apply", None, "", "the team has no targets and no anchors: see rigidity"
    if not system.team.free:
        witness = (
            _first([direction.description for direction in cohomology.basis], 4, "; ") or "no agent is free to drift"
        )
        trivial = "fails" if cohomology.basis else "holds", float(cohomology.dimension), "", witness
    found = {
        "f is continuously differentiable": smooth,
        "g has full row rank": rank,
        "disturbances are continuous and bounded": _bounded(system),
        "g^+ is continuous and bounded": inverse,
        "G_q is connected and every target is sensed": _topology(system.team),
        "H^0(G, G_p; F) = 0": trivial,
        "bounded difference of target and agent dynamics, along the targets' path": _bounded_difference(
            system, constants, smooth[0], cohomology.dimension > 0
        ),
    }
    return [
        Assumption(
            number=number,
            name=name,
            verdict=verdict,
            holds={"holds": True, "fails": False}.get(verdict),
            applies=verdict != "does not apply",
            value=value,
            unit=unit,
            witness=witness,
        )
        for number, (name, (verdict, value, unit, witness)) in enumerate(found.items(), 1)
    ]


def _bounded(system: System) -> Finding:
    """Decide the bound of disturbances: sums of sines, waves, tides and files have one; Gaussian gusts have none."""
    largest = float(system.largest_disturbance.max(initial=0.0))
    if not np.isfinite(largest):
        gusts = np.flatnonzero(~np.isfinite(system.largest_disturbance))
        who = _first([system.team.members[v].id for v in gusts], 6)
        return "does not apply", None, "m/s", f"the gusts of {who} are Gaussian, not bounded: see disturbance.rms"
    witness = "sums of sines: continuous, and bounded by construction" if largest else "there is no disturbance"
    if system.moving and largest:
        witness = "what moves in the medium is continuous and bounded; what vehicles share counts in f_bar and rho"
    return "holds", largest, "m/s", witness


def _smooth(system: System, region: Region, confined: bool, constants: Constants) -> Finding:
    """Decide smoothness: singularities with a core are smooth; without one, only if agents cannot reach the centre."""
    N, V, rho, path = len(system.team.agents), len(system.team.members), region.rho, constants.path
    near = f"near ({', '.join(f'{x:.3g}' for x in rho.where)})"
    if _has_poles(system, N, V) and path.cells is None:
        why = f"a kernel of the flow that targets meet has no core, and their path is not known: {path.warning}"
        return "undecided", None, "1/s", why
    if not _has_poles(system, 0, N):
        steepest = f"every kernel is smooth; the agents' field is steepest {near}"
        return "holds", rho.upper, "1/s", steepest if rho.upper > 0.0 else "no agent's drift depends on where it is"
    if confined and np.isfinite(rho.upper):
        return (
            "holds",
            rho.upper,
            "1/s",
            f"the singular kernels lie outside the agents' region, where the field is steepest {near}",
        )
    between = tube_guessed(system, path, margin=0.0).slope
    if not np.isfinite(between.upper):
        at = ", ".join(f"{x:.3g}" for x in between.where)
        return (
            "fails",
            None,
            "1/s",
            f"the field that agents meet is singular at ({at}), inside their region: a core radius is 0",
        )
    why = "a kernel of the flow that agents meet has no core, and nothing proves that they keep away from it"
    return "undecided", None, "1/s", why


def _has_poles(system: System, first: int, last: int) -> bool:
    return any(len(singular_points(flow, planar=planar)) for flow, planar in system.fields_met(first, last))


def _rank_and_inverse(system: System) -> tuple[Finding, Finding]:
    """Decide rank and pseudo-inverse of g: the scenario's for the ideal backend, or else that of the reduced model.

    g = R W with a rotation R, so its singular values are those of W at any position.
    """
    vehicles = dict(zip(system.bodies.vehicle, system.vehicles, strict=True))
    given, agents = system.effectiveness.given, system.team.agents
    found = [
        (a.id, np.linalg.svd(system.effectiveness.W[i, : a.dimension], compute_uv=False), "", "")
        for i, a in enumerate(agents)
        if given[i]
    ]
    for name in dict.fromkeys(name for i, name in enumerate(system.bodies.vehicle[: len(agents)]) if not given[i]):
        singular = np.linalg.svd(vehicles[name].reduced_model().g(np.eye(3)), compute_uv=False)
        found.append((f"body {name}", singular, "m/s per unit command", "units of command per m/s"))
    deficient = next((g for g in found if is_rank_deficient(g[1])), None)
    who, singular, unit, inverse_unit = deficient or min(found, key=lambda g: float(g[1][-1]))
    least, where = float(singular[-1]), "the same at every position and heading, as g only turns with them"
    if deficient:
        rank = f"{who} cannot push in every direction of its state space, {where}"
        return ("fails", least, unit, rank), (
            "fails",
            None,
            "",
            f"g of {who} loses rank, so that g^+ is not bounded near it",
        )
    return (
        ("holds", least, unit, f"smallest singular value, that of {who}; {where}"),
        ("holds", 1.0 / least, inverse_unit, f"largest gain of g^+, that of {who}"),
    )


def _topology(team: Team) -> Finding:
    links = list(filter(_couples, team.communication))
    label = label_parts(team, links)
    parts = sorted(np.flatnonzero(label == k).tolist() for k in range(label.max() + 1))
    unseen = unsensed_targets(team, filter(_couples, team.sensing))
    groups = ["{" + _first([team.agents[i].id for i in part], 6) + "}" for part in parts]
    failures = {
        f"the agents fall into {len(parts)} parts: {_first(groups, 4, '; ')}": len(parts) > 1,
        f"no agent senses {_first(unseen, 8)}": unseen,
    }
    warnings = "; ".join(select_true(failures))
    connected = f"{len(links)} links connect {len(team.agents)} agents; every target is sensed"
    verdict: Verdict = "fails" if warnings else "holds"
    return verdict, float(len(parts)), "part" if len(parts) == 1 else "parts", warnings or connected


def _first(words: list[str], most: int, separator: str = ", ") -> str:
    return separator.join(words[:most] + ["..."] * (len(words) > most))


def _couples(edge: Edge) -> bool:
    """Return True if an edge couples its ends: F_i^T K F_j is not zero."""
    return bool(np.any(edge.F_tail.T @ edge.weight @ edge.F_head))


def _bounded_difference(system: System, constants: Constants, smooth: Verdict, free: bool) -> Finding:
    """Decide the bound along the targets' path. The paper requires it for all p, but its proof uses only the path."""
    bound, path = constants.difference.bound, constants.path
    if obstacle_of_team(system.team):
        return "does not apply", None, "", "it is an assumption of Theorem 1 alone, which is about other teams"
    if smooth == "fails":
        return "fails", None, "m/s", "a field is unbounded inside the region: a core radius is 0 there"
    if diverging := targets_loop(system).failure:
        return "fails", None, "m/s", diverging
    if not np.isfinite(system.largest_disturbance[len(system.team.agents) :]).all():
        return "does not apply", None, "m/s", f"the targets have no certain path: {path.warning}"
    if path.warning:
        return "undecided", None, "m/s", f"the path is not known: {path.warning}"
    if free:
        return "undecided", bound, "m/s", "q* is not unique, so f_q(q*) is undefined"
    if not np.isfinite(bound):
        return "undecided", bound, "m/s", "q* or a target comes near a singular kernel of the flow"
    return (
        "holds",
        bound,
        "m/s",
        f"largest near t = {constants.difference.time:.4g} s; the path error is at most {path.error:.1g} m",
    )
