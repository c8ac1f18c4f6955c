"""`check`: all that can be said of a scenario before, or beside, running it."""

import math
from dataclasses import dataclass
from numbers import Real
from typing import Any

from pydantic import Field

from mjsheaf.checking.certificate import Assumption, Certificate, certify
from mjsheaf.checking.cohomology import Fragility, RelativeCohomology, fragility
from mjsheaf.checking.margins import Margins, margins
from mjsheaf.checking.mending import Augmentation, plan_augmentation
from mjsheaf.control.theorem import Rho, RhoLike, as_rho, gain_for_radius
from mjsheaf.errors import InputError
from mjsheaf.io.section import Finite, Record
from mjsheaf.scenario import Scenario
from mjsheaf.system import System
from mjsheaf.threads import one_thread


class RegionSummary(Record):
    """Where the constants were taken."""

    source: str
    verified: bool = Field(description="whether agents of an unlimited law are proven to stay there; else a guess")
    agents_low: list[float] = Field(description="corner of the box about the agents' region, m")
    agents_high: list[float] = Field(description="opposite corner, m")
    start: float = Field(description="s")
    end: float = Field(description="s")
    samples: int = Field(description="cells that cover the targets' path, or instants where it is not known")
    path_error: Finite = Field(description="of the targets' path, for which the bounds allow, m; null: not known")


class ExplainedCohomology(RelativeCohomology):
    """H^0(G, G_p; F), explained, and what would make it trivial."""

    mending: Augmentation | None = Field(description="null where nothing is free")


class WeakerBound(Record):
    """The bound with rho = 0 and f_bar enlarged by 2 sqrt(sum_i sup |f_i|^2)."""

    f_bar: Finite
    radius: Finite = Field(description="ultimate radius, m")


class TheoremSummary(Record):
    """Theorem 1, computed."""

    applies: bool = Field(
        description="the gain condition and every numbered assumption hold, and no hold or speed limit is in the way"
    )
    gain_condition: bool = Field(description="k_min > rho(2 sqrt(mu / lambda_V)) + lambda_V, the targets' path known")
    approximate: bool = Field(description="the law is held over a period; the theorem's is continuous")
    reason: str = Field(description="why it does not apply, or empty")
    gain: float = Field(description="k1, 1/s")
    lambda_min: float
    lambda_max: float
    sigma_max_B: float
    omega_bar: Finite = Field(description="m/s")
    f_bar: Finite = Field(description="m/s")
    rho: Finite = Field(description="constant Lipschitz bound, 1/s; of a user's rho its value at the initial error")
    rho_seen: Finite = Field(description="largest slope found, 1/s")
    rho_source: str
    lambda_V: Finite = Field(description="rate, 1/s; the best one unless given")
    lambda_V_given: bool
    k_min: float = Field(description="1/s")
    mu: Finite = Field(description="m^2/s")
    chi: Finite = Field(description="m; null where it is infinite: rho is constant over the region")
    chi_infinite: bool | None = Field(description="null where the gain condition fails")
    radius_D: Finite = Field(description="m; null: the whole space, or the condition fails")
    radius_S: Finite = Field(description="m; null: the whole space, or the condition fails")
    radius_U: Finite = Field(description="m; null where the condition fails")
    initial_error: float = Field(description="|e(t0)|, m")
    initial_error_inside_S: bool | None = Field(description="null where the gain condition fails: there is no S")
    wanted_radius: float = Field(description="m")
    gain_for_wanted_radius: Finite = Field(description="smallest k1 that meets it, 1/s")
    weaker: WeakerBound


class CheckRecord(Record):
    """A check of a scenario."""

    scenario: str
    ok: bool = Field(
        description="every numbered assumption holds (none fails, none is undecided), and the vehicles' loop is not "
        "unstable"
    )
    region: RegionSummary
    assumptions: list[Assumption]
    relative_cohomology: ExplainedCohomology
    theorem: TheoremSummary
    margins: Margins
    fragility: Fragility

    def verdict(self) -> str:
        """The check in a few words: what holds, where, and what does not."""
        region = f"along the targets' path from {self.region.start:g} to {self.region.end:g} s"
        counts = [sum(a.verdict == kind for a in self.assumptions) for kind in ("holds", "fails", "undecided")]
        loop = "; " + self.margins.bodies.verdict() if self.margins.bodies.stable is False else ""
        if counts[0] == len(self.assumptions):
            return f"all {counts[0]} assumptions hold, the 7th {region}{loop}"
        named = [
            f"{n} {word}"
            for n, word in zip(counts[1:], ("FAIL" if counts[1] > 1 else "FAILS", "undecided"), strict=True)
            if n
        ]
        return f"{counts[0]} assumptions hold, {', '.join(named)}; the 7th is taken {region}{loop}"


def check(
    scenario: Scenario, *, rate: float | None = None, radius: float = 1.0, rho: RhoLike | None = None
) -> dict[str, Any]:
    """Check a scenario: the paper's assumptions, Theorem 1, margins and fragility.

    Args:
        scenario: from `load_scenario`.
        rate: lambda_V in 1/s; None takes the best.
        radius: ultimate radius of |e| for which the smallest gain is wanted, m.
        rho: |f_q(q*) - f_q(q)| <= rho(|e|) |e|, as the caller claims: a number, coefficients c_0, c_1, ... of a
            polynomial, pairs (radius, value) or a function; None takes the flow's largest slope over the region.

    Returns:
        The record that `mjsheaf check --json` prints; its schema is that of `CheckRecord`.

    Raises:
        InputError: rate or radius is not positive, rho is no bound, or a vehicle does not fit its agent.
    """
    own = None if rho is None else as_rho(rho)
    return examine(scenario.system, rate=rate, radius=radius, rho=own).record.model_dump(mode="json")


@dataclass(frozen=True)
class Examination:
    """A check with what it was made from."""

    record: CheckRecord
    certificate: Certificate


@one_thread
def examine(system: System, *, rate: float | None = None, radius: float = 1.0, rho: Rho | None = None) -> Examination:
    """`check` of a system, as a typed record with its certificate."""
    for name, value in (("rate", rate), ("radius", radius)):
        if value is not None and not (isinstance(value, Real) and 0.0 < value < math.inf):
            raise InputError(f"{name} is {value!r}; expected a positive, finite number")
    certificate = certify(system, rate, rho)
    practice = margins(system, certificate)
    record = CheckRecord(
        scenario=system.name,
        ok=all(a.verdict == "holds" for a in certificate.assumptions) and practice.bodies.stable is not False,
        region=_region(certificate),
        assumptions=certificate.assumptions,
        relative_cohomology=ExplainedCohomology(**dict(certificate.cohomology), mending=plan_augmentation(system.team)),
        theorem=_theorem(system, certificate, rate, radius, rho),
        margins=practice,
        fragility=fragility(system.team),
    )
    return Examination(record, certificate)


def _region(certificate: Certificate) -> RegionSummary:
    region, path = certificate.region, certificate.constants.path
    low, high = region.tube.corners()
    time, cells = path.time, path.cells
    return RegionSummary(
        source=region.source,
        verified=region.verified and not certificate.obstacle,
        agents_low=low.tolist(),
        agents_high=high.tolist(),
        start=float(time[0]),
        end=float(time[-1] if cells is None else cells.end[-1]),
        samples=len(time if cells is None else cells.begin),
        path_error=path.error,
    )


def _theorem(
    system: System, certificate: Certificate, rate: float | None, radius: float, rho: Rho | None
) -> TheoremSummary:
    theorem, spectrum, constants = certificate.theorem, certificate.spectrum, certificate.constants
    slope, start = certificate.region.rho, constants.initial_error
    proven = certificate.region.verified
    holds = theorem.applies and proven
    gain = gain_for_radius(
        radius, spectrum.lambda_min, constants.difference.bound, constants.omega_bar, rho or slope.upper, start
    )
    source = "largest norm of the Jacobian of the agents' field over their region, by branch and bound"
    return TheoremSummary(
        applies=certificate.applies,
        gain_condition=holds,
        approximate=certificate.approximate,
        reason=certificate.reason,
        gain=system.gain,
        lambda_min=spectrum.lambda_min,
        lambda_max=spectrum.lambda_max,
        sigma_max_B=spectrum.sigma_max_B,
        omega_bar=constants.omega_bar,
        f_bar=constants.difference.bound,
        rho=slope.upper if rho is None else rho(start),
        rho_seen=slope.seen,
        rho_source=(source + ("" if slope.exact else " (an upper bound, not tight)"))
        if rho is None
        else "given by the user, here at the initial error",
        lambda_V=theorem.rate or None if holds or rate is not None else None,
        lambda_V_given=rate is not None,
        k_min=theorem.k_min,
        mu=theorem.mu,
        chi=theorem.chi if holds else None,
        chi_infinite=math.isinf(theorem.chi) if holds else None,
        radius_D=theorem.chi if holds else None,
        radius_S=theorem.radius_S if holds else None,
        radius_U=theorem.radius if holds else None,
        initial_error=start,
        initial_error_inside_S=theorem.contains(start) if holds else None,
        wanted_radius=radius,
        gain_for_wanted_radius=gain or None,
        weaker=WeakerBound(
            f_bar=certificate.weaker.f_bar if proven else None,
            radius=certificate.weaker.radius if proven and not certificate.obstacle else None,
        ),
    )
