"""`check`: everything that can be said of a scenario before, or beside, running it."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from mjsheaf.backends.physics import vehicles_of
from mjsheaf.backends.system import System
from mjsheaf.checking import record as r
from mjsheaf.checking.assumptions import decide
from mjsheaf.checking.cohomology import RelativeCohomology, explain
from mjsheaf.checking.constants import Constants, certify, take_constants, weaken
from mjsheaf.checking.fragility import Fragility, Loss, fragility
from mjsheaf.checking.margins import body_margin, hold_margin, speed_demands, steady_lag
from mjsheaf.checking.mending import MendPlan, mend
from mjsheaf.checking.region import Region, region_of_system
from mjsheaf.checking.spectrum import Spectrum, spectrum_of
from mjsheaf.control.theorem import gain_for_radius
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario

_MOST_ROWS = 20
_MOST_LOSSES = 50


def check(scenario: Scenario, *, rate: float | None = None, radius: float = 1.0) -> dict[str, Any]:
    """Check a scenario: the paper's assumptions, Theorem 1, margins and fragility.

    Args:
        scenario: from `load_scenario`.
        rate: lambda_V in 1/s; None takes the best.
        radius: ultimate radius of |e| for which the smallest gain is wanted, m.

    Returns:
        The record that `mjsheaf check --json` prints; its schema is `CheckRecord`. `ok` is whether no numbered
        assumption of the paper fails.

    Raises:
        InputError: rate or radius is not positive, or a vehicle does not fit its agent.
    """
    return examine(scenario.system(), rate=rate, radius=radius).model_dump(mode="json")


def examine(system: System, *, rate: float | None = None, radius: float = 1.0) -> r.CheckRecord:
    """`check` of a system, as a typed record."""
    for name, value in (("rate", rate), ("radius", radius)):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"{name} is {value}; it must be positive and finite")
    spectrum = spectrum_of(system.team)
    cohomology = explain(system.team, spectrum)
    region = region_of_system(system)
    constants = take_constants(system, region, spectrum)
    assumptions = decide(system, region, constants, cohomology)
    return r.CheckRecord(
        scenario=system.name,
        ok=all(a.verdict != "fails" for a in assumptions),
        region=_region(region),
        assumptions=[r.AssumptionRecord(**asdict(a) | {"value": _finite(a.value)}) for a in assumptions],
        relative_cohomology=_cohomology(cohomology, mend(system.team) if cohomology.dimension else None),
        theorem=_theorem(system, constants, spectrum, region, rate, radius),
        margins=_margins(system, constants, spectrum, region),
        fragility=_fragility(fragility(system.team)),
    )


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _region(region: Region) -> r.RegionRecord:
    return r.RegionRecord(
        source=region.source,
        verified=region.verified,
        agents_low=region.low.tolist(),
        agents_high=region.high.tolist(),
        start=float(region.time[0]),
        end=float(region.time[-1]),
        samples=len(region.time),
    )


def _cohomology(found: RelativeCohomology, plan: MendPlan | None) -> r.CohomologyRecord:
    return r.CohomologyRecord(
        dimension=found.dimension,
        tolerance=found.tolerance,
        method=found.method,
        basis=[r.DirectionRecord(description=d.description, motion=d.motion) for d in found.basis],
        near_null=[
            r.NearNullRecord(description=d.description, eigenvalue=d.eigenvalue, ratio=d.ratio) for d in found.near_null
        ],
        mending=None
        if plan is None
        else r.MendingRecord(
            needed=plan.needed,
            exact=plan.exact,
            candidates=plan.candidates,
            repairs=[
                r.RepairRecord(
                    kind=x.kind,
                    description=x.description,
                    removes=x.removes,
                    lambda_min_alone=x.lambda_min_alone,
                    lambda_min_without=x.lambda_min_without,
                )
                for x in plan.repairs
            ],
            lambda_min=plan.lambda_min,
            alternatives=[[x.description for x in other] for other in plan.alternatives],
        ),
    )


def _theorem(
    system: System, constants: Constants, spectrum: Spectrum, region: Region, rate: float | None, radius: float
) -> r.TheoremRecord:
    theorem = certify(system, constants, spectrum, rate)
    weaker = weaken(system, constants, spectrum)
    slope = constants.lipschitz
    return r.TheoremRecord(
        applies=theorem.applies,
        approximate=not system.grid.continuous,
        reason=why_not(system, constants, spectrum, rate),
        gain=system.gain,
        lambda_min=spectrum.lambda_min,
        lambda_max=spectrum.lambda_max,
        sigma_max_B=spectrum.sigma_max_B,
        omega_bar=_finite(constants.omega_bar),
        f_bar=_finite(constants.f_bar),
        rho=_finite(slope.upper),
        rho_seen=_finite(slope.seen),
        rho_source="largest norm of the Jacobian of the agents' field over their box, by branch and bound"
        + ("" if slope.exact else " (stopped early: an upper bound, not tight)"),
        lambda_V=_finite(theorem.rate) or None,
        lambda_V_given=rate is not None,
        k_min=theorem.k_min,
        mu=_finite(theorem.mu),
        chi=None,
        chi_infinite=theorem.applies,
        radius_D=None,
        radius_S=None,
        radius_U=_finite(theorem.radius),
        initial_error=constants.initial_error,
        initial_error_inside_S=theorem.applies,
        wanted_radius=radius,
        gain_for_wanted_radius=_finite(
            gain_for_radius(radius, spectrum.lambda_min, constants.f_bar, constants.omega_bar, slope.upper)
        ),
        weaker=r.WeakerRecord(f_bar=_finite(weaker.f_bar), radius=_finite(weaker.radius)),
    )


def why_not(system: System, constants: Constants, spectrum: Spectrum, rate: float | None = None) -> str:
    """Why the gain condition fails, or an empty string where it holds."""
    theorem = certify(system, constants, spectrum, rate)
    if theorem.applies:
        return ""
    if spectrum.lambda_min <= 0.0:
        return "lambda_min(H) is 0: the harmonic extension is not unique"
    if not math.isfinite(constants.lipschitz.upper) or not math.isfinite(constants.f_bar):
        return "the agents' field is singular inside their region"
    if rate is not None and theorem.k_min > constants.lipschitz.upper:
        best = theorem.k_min - constants.lipschitz.upper
        return f"lambda_V = {rate:.4g} 1/s is too fast: it must be below k_min - rho = {best:.4g} 1/s"
    needed = 2.0 * constants.lipschitz.upper / spectrum.lambda_min
    return (
        f"k_min = {theorem.k_min:.4g} 1/s does not exceed rho = {constants.lipschitz.upper:.4g} 1/s; "
        f"that takes a gain above {needed:.4g} 1/s"
    )


def _margins(system: System, constants: Constants, spectrum: Spectrum, region: Region) -> r.MarginsRecord:
    hold = hold_margin(system, spectrum)
    bodies = body_margin(system, spectrum, time_constants(system))
    lag = steady_lag(system, constants)
    ids = system.team.agent_ids
    return r.MarginsRecord(
        hold=None if hold is None else r.HoldRecord(**asdict(hold)),
        bodies=r.BodyRecord(
            tau=list(bodies.tau),
            damping_slowest=_finite(bodies.damping_slowest),
            damping_fastest=_finite(bodies.damping_fastest),
            spectral_radius=bodies.spectral_radius,
        ),
        speed=[r.SpeedRecord(**asdict(d)) for d in speed_demands(system)[:_MOST_ROWS]],
        lag=[r.LagRecord(agent=ids[i], lag=float(lag[i])) for i in np.argsort(-lag, kind="stable")[:_MOST_ROWS]],
    )


def time_constants(system: System) -> np.ndarray:
    """m / D of each agent's body along its most sluggish controlled axis, shape (N,), s."""
    agents = vehicles_of(system)[: len(system.team.agents)]
    return np.array([vehicle.mass / vehicle.drag[: vehicle.dimension].min() for vehicle in agents])


def _fragility(found: Fragility) -> r.FragilityRecord:
    def one(loss: Loss) -> r.LossRecord:
        return r.LossRecord(
            kind=loss.kind, name=loss.name, breaks=list(loss.breaks), lambda_min=_finite(loss.lambda_min)
        )

    critical = [loss for loss in found.losses if loss.breaks]
    return r.FragilityRecord(
        exact=found.exact,
        method=found.method,
        critical=[one(loss) for loss in critical[:_MOST_LOSSES]],
        critical_count=len(critical),
        worst=None if found.worst is None else one(found.worst),
    )
