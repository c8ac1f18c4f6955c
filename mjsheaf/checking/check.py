"""`check`: everything that can be said of a scenario before, or beside, running it."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mjsheaf.backends.physics import vehicles_of
from mjsheaf.backends.physics.capability import capability_of, of_each
from mjsheaf.backends.system import System
from mjsheaf.checking import record as r
from mjsheaf.checking.assumptions import decide
from mjsheaf.checking.cohomology import RelativeCohomology, explain
from mjsheaf.checking.constants import Constants, certify, take_constants
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
    return examine(scenario.system(), rate=rate, radius=radius).record.model_dump(mode="json")


@dataclass(frozen=True)
class Examination:
    """A check with what it was made from: the record, and the region it was taken over."""

    record: r.CheckRecord
    region: Region


def examine(system: System, *, rate: float | None = None, radius: float = 1.0) -> Examination:
    """`check` of a system, as a typed record with its region."""
    for name, value in (("rate", rate), ("radius", radius)):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"{name} is {value}; it must be positive and finite")
    spectrum = spectrum_of(system.team)
    cohomology = explain(system.team, spectrum)
    region = region_of_system(system)
    constants = take_constants(system, region, spectrum)
    assumptions = decide(system, region, constants, cohomology)
    record = r.CheckRecord(
        scenario=system.name,
        ok=all(a.verdict != "fails" for a in assumptions),
        region=_region(region),
        assumptions=[r.AssumptionRecord(**asdict(a) | {"value": _finite(a.value)}) for a in assumptions],
        relative_cohomology=_cohomology(cohomology, mend(system.team) if cohomology.dimension else None),
        theorem=_theorem(system, region, constants, spectrum, rate, radius),
        margins=_margins(system, region, constants, spectrum),
        fragility=_fragility(fragility(system.team)),
    )
    return Examination(record, region)


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _region(region: Region) -> r.RegionRecord:
    return r.RegionRecord(
        source=region.source,
        verified=region.verified,
        agents_low=region.low.tolist(),
        agents_high=region.high.tolist(),
        start=float(region.path.time[0]),
        end=float(region.path.time[-1]),
        samples=len(region.path.time),
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
    system: System, region: Region, constants: Constants, spectrum: Spectrum, rate: float | None, radius: float
) -> r.TheoremRecord:
    certificate = certify(system, region, constants, spectrum, rate)
    theorem, slope = certificate.theorem, constants.lipschitz
    gain = gain_for_radius(radius, spectrum.lambda_min, constants.f_bar, constants.omega_bar, slope.upper)
    return r.TheoremRecord(
        applies=certificate.applies,
        gain_condition=theorem.applies,
        approximate=certificate.approximate,
        reason=certificate.reason,
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
        gain_for_wanted_radius=_finite(gain) or None,
        weaker=r.WeakerRecord(
            f_bar=_finite(certificate.weaker.f_bar),
            radius=None if certificate.obstacle else _finite(certificate.weaker.radius),
        ),
    )


def _margins(system: System, region: Region, constants: Constants, spectrum: Spectrum) -> r.MarginsRecord:
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
        speed=[r.SpeedRecord(**asdict(d)) for d in speed_demands(system, region.path, top_speeds(system))[:_MOST_ROWS]],
        lag=[
            r.LagRecord(agent=ids[i], lag=_finite(float(lag[i]))) for i in np.argsort(-lag, kind="stable")[:_MOST_ROWS]
        ],
    )


def time_constants(system: System) -> np.ndarray:
    """Time constant of each agent's body along its most sluggish controlled axis, shape (N,), s."""
    agents = vehicles_of(system)[: len(system.team.agents)]
    return of_each(agents, lambda vehicle: float(vehicle.reduced_model().tau.max()))


def top_speeds(system: System) -> np.ndarray:
    """Speed through the medium that each agent's body can make in every direction, shape (N,), m/s."""
    agents = vehicles_of(system)[: len(system.team.agents)]
    return of_each(agents, lambda vehicle: capability_of(vehicle).least_speed)


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
