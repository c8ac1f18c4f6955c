"""`check`: everything that can be said of a scenario before, or beside, running it."""

import math
from dataclasses import asdict, dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjsheaf.checking import record as r
from mjsheaf.checking.bodies import body_loop, mean_medium
from mjsheaf.checking.certificate import Certificate, certify
from mjsheaf.checking.cohomology import RelativeCohomology
from mjsheaf.checking.fragility import Fragility, Loss, fragility
from mjsheaf.checking.margins import body_margin, hold_margin, speed_demands, steady_lag
from mjsheaf.checking.mending import MendPlan, mend
from mjsheaf.checking.region import Region
from mjsheaf.checking.targets import TargetPath
from mjsheaf.control.theorem import Rho, RhoLike, as_rho, gain_for_radius
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.loop import vehicles_of
from mjsheaf.system import System
from mjsheaf.threads import one_thread
from mjsheaf.vehicles.effects import capability_of, of_each

Array = NDArray[np.float64]

_MOST_ROWS = 20
_MOST_LOSSES = 50


def check(
    scenario: Scenario, *, rate: float | None = None, radius: float = 1.0, rho: RhoLike | None = None
) -> dict[str, Any]:
    """Check a scenario: the paper's assumptions, Theorem 1, margins and fragility.

    Args:
        scenario: from `load_scenario`.
        rate: lambda_V in 1/s; None takes the best.
        radius: ultimate radius of |e| for which the smallest gain is wanted, m.
        rho: |f_q(q*) - f_q(q)| <= rho(|e|) |e|, a claim of the caller's: a number, coefficients c_0, c_1, ... of a
            polynomial, pairs (radius, value) or a function; None takes the flow's largest slope over the region.

    Returns:
        The record that `mjsheaf check --json` prints; its schema is `CheckRecord`. `ok` is whether every numbered
        assumption of the paper holds (none fails, and none is undecided) and the vehicles' loop is not unstable.

    Raises:
        InputError: rate or radius is not positive, rho is no bound, or a vehicle does not fit its agent.
    """
    return examine(
        scenario.system(), rate=rate, radius=radius, rho=None if rho is None else as_rho(rho)
    ).record.model_dump(mode="json")


@dataclass(frozen=True)
class Examination:
    """A check with what it was made from."""

    record: r.CheckRecord
    certificate: Certificate


@one_thread
def examine(system: System, *, rate: float | None = None, radius: float = 1.0, rho: Rho | None = None) -> Examination:
    """`check` of a system, as a typed record with its certificate."""
    for name, value in (("rate", rate), ("radius", radius)):
        if value is not None and not (isinstance(value, Real) and 0.0 < value < math.inf):
            raise InputError(f"{name} is {value!r}; it must be positive and finite")
    certificate = certify(system, rate, rho)
    cohomology = certificate.cohomology
    margins = _margins(system, certificate)
    record = r.CheckRecord(
        scenario=system.name,
        ok=all(a.verdict == "holds" for a in certificate.assumptions) and margins.bodies.stable is not False,
        region=_region(certificate.region),
        assumptions=[r.AssumptionRecord(**asdict(a) | {"value": _finite(a.value)}) for a in certificate.assumptions],
        relative_cohomology=_cohomology(cohomology, mend(system.team) if cohomology.dimension else None),
        theorem=_theorem(system, certificate, rate, radius, rho),
        margins=margins,
        fragility=_fragility(fragility(system.team)),
    )
    return Examination(record, certificate)


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _region(region: Region) -> r.RegionRecord:
    low, high = region.tube.corners()
    return r.RegionRecord(
        source=region.source,
        verified=region.verified,
        agents_low=low.tolist(),
        agents_high=high.tolist(),
        start=float(region.path.time[0]),
        end=float(region.path.time[-1] if region.path.cells is None else region.path.cells.end[-1]),
        samples=len(region.path.time if region.path.cells is None else region.path.cells.begin),
        path_error=_finite(region.path.error),
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
    system: System, certificate: Certificate, rate: float | None, radius: float, rho: Rho | None
) -> r.TheoremRecord:
    theorem, spectrum, constants = certificate.theorem, certificate.spectrum, certificate.constants
    slope, start = constants.rho, constants.initial_error
    holds = theorem.applies and certificate.proven
    gain = gain_for_radius(
        radius, spectrum.lambda_min, constants.difference.bound, constants.omega_bar, rho or slope.upper, start
    )
    source = "largest norm of the Jacobian of the agents' field over their region, by branch and bound"
    return r.TheoremRecord(
        applies=certificate.applies,
        gain_condition=holds,
        approximate=certificate.approximate,
        reason=certificate.reason,
        gain=system.gain,
        lambda_min=spectrum.lambda_min,
        lambda_max=spectrum.lambda_max,
        sigma_max_B=spectrum.sigma_max_B,
        omega_bar=_finite(constants.omega_bar),
        f_bar=_finite(constants.difference.bound),
        rho=_finite(slope.upper if rho is None else rho(start)),
        rho_seen=_finite(slope.seen),
        rho_source=(source + ("" if slope.exact else " (an upper bound, not tight)"))
        if rho is None
        else "given by the user, here at the initial error",
        lambda_V=_finite(theorem.rate) or None if holds or rate is not None else None,
        lambda_V_given=rate is not None,
        k_min=theorem.k_min,
        mu=_finite(theorem.mu),
        chi=_finite(theorem.chi) if holds else None,
        chi_infinite=math.isinf(theorem.chi) if holds else None,
        radius_D=_finite(theorem.radius_D) if holds else None,
        radius_S=_finite(theorem.radius_S) if holds else None,
        radius_U=_finite(theorem.radius) if holds else None,
        initial_error=start,
        initial_error_inside_S=theorem.contains(start) if holds else None,
        wanted_radius=radius,
        gain_for_wanted_radius=_finite(gain) or None,
        weaker=r.WeakerRecord(
            f_bar=_finite(certificate.weaker.f_bar) if certificate.proven else None,
            radius=_finite(certificate.weaker.radius) if certificate.proven and not certificate.obstacle else None,
        ),
    )


def _margins(system: System, certificate: Certificate) -> r.MarginsRecord:
    spectrum, region, difference = certificate.spectrum, certificate.region, certificate.constants.difference
    hold = hold_margin(system, spectrum)
    inertia = body_margin(system, spectrum, time_constants(system))
    loop = body_loop(system, spectrum, _mean_medium(system, region.path))
    lag = steady_lag(system, difference)
    speeds = speed_demands(system, difference, top_speeds(system))
    ids = system.team.agent_ids
    return r.MarginsRecord(
        hold=None if hold is None else r.HoldRecord(**asdict(hold)),
        bodies=r.BodyRecord(
            tau=list(inertia.tau),
            damping_slowest=_finite(inertia.damping_slowest),
            damping_fastest=_finite(inertia.damping_fastest),
            stable=loop.stable,
            spectral_radius=loop.spectral_radius,
            period=loop.period,
            largest_gain=loop.largest_gain,
            least_damped=None if loop.least_damped is None else r.SwingRecord(**asdict(loop.least_damped)),
            reason=loop.reason,
        ),
        speed=[r.SpeedRecord(**asdict(d)) for d in speeds[:_MOST_ROWS]],
        lag=[
            r.LagRecord(agent=ids[i], lag=_finite(float(lag[i]))) for i in np.argsort(-lag, kind="stable")[:_MOST_ROWS]
        ],
    )


def _mean_medium(system: System, path: TargetPath) -> Array:
    """The mean flow that agents meet relative to q*; NaN where the targets' path is not known."""
    if path.cells is None:
        return np.full((len(system.team.agents), 3), np.nan)
    return mean_medium(system, path.time, path.q_star)


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
