"""Margins of gain and speed: ringing, runs at higher gains, commanded speeds, the velocity limit.

Ringing is the least damped mode of the vehicles' loop of `check` (see `body_loop`), in the mean flow along the ideal
run. Delays of links are part of the loop; their losses and noise are left out. The usable gain is the largest at which
every mode has a damping ratio of at least 0.3; a displacement then overshoots by 37 %. Its dominant cause is the effect
without which the usable gain would be largest.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import xarray as xr
from pydantic import Field

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.loop.body_loop import BodyLoop, loop_in_run
from mjsheaf.comparing.variants import (
    TEAM,
    ErrorsRecord,
    Role,
    Run,
    Span,
    Variant,
    changed_systems,
    effects_of,
    has_limits,
    run_ablation,
    saturation_of,
    span_of,
    vehicles_by_role,
    without_links,
)
from mjsheaf.loop.system import Phase, System
from mjsheaf.progress import Report, no_progress
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.ending import Ending
from mjsheaf.section import Finite, FiniteRecord
from mjsheaf.vehicles.loading import list_vehicles

MIN_DAMPING = 0.3
"""Smallest damping ratio at a usable gain."""

Effect = Literal["inertia", "lag", "underactuation", "hold", "links"]


class RingingRecord(BodyLoop):
    """The vehicles' loop for small motions: its least damped mode, and what limits the gain."""

    usable_gain: float | None = Field(
        description=f"gain from which on the damping ratio of a mode is below {MIN_DAMPING}, 1/s; null if there is none"
    )
    effect: Effect = Field(description="effect that limits it: without it the usable gain is largest; else inertia")
    without: dict[Effect, float | None] = Field(
        description="usable gain without lag of thrusters, underactuation, the hold of the law or the links' delays, "
        "1/s; null if every gain is usable"
    )


class LoopRecord(FiniteRecord):
    """Stability of the vehicles' loop for small motions, as `check` reports it, over all phases."""

    stable: bool | None = Field(
        description="false where the loop of a phase is unstable, else null where that of a phase is undecided"
    )
    largest_gain: float | None = Field(description="smallest of all phases from which on a mode grows, 1/s; or null")
    reason: str = Field(description="why it is undecided in a phase, or empty")


class GainTrialRecord(FiniteRecord):
    """A run of the bodies at a gain."""

    gain: float = Field(description="k1, 1/s")
    status: str
    ending: Ending | None
    late: ErrorsRecord = Field(description="errors of the team, RMS over the second half, m")
    saturated: Finite = Field(description="fraction of time and of agents' thrusters at a limit, 0 to 1")


def find_ringing(
    phases: Sequence[Phase],
    ideal: xr.Dataset,
    *,
    notable: float = 1.2,  # factor on the usable gain, without an effect, below which it is no cause
) -> tuple[int, RingingRecord | None]:
    """Analyse the loop of the bodies in the mean flow along the ideal run, in the phase in which it is least damped.

    Returns:
        Number of the phase, and the loop; None if no phase has two samples.
    """
    loops = {k: loop_in_run(_without_losses(system), data) for k, system, data in _ways(phases, ideal)}
    if not loops:
        return 0, None
    damping = {k: np.inf if loop.least_damped is None else loop.least_damped.damping for k, loop in loops.items()}
    number = min(damping, key=damping.__getitem__)
    loop = loops[number]
    system, data = of_phase(phases, ideal, number)
    system = _without_losses(system)
    usable: float | None = None
    effect: Effect = "inertia"
    without = dict[Effect, float | None]()
    if loop.least_damped is not None:
        usable = loop_in_run(system, data, least_damping=MIN_DAMPING).largest_gain
        for name, variant in _variants(system):
            other = loop_in_run(variant, data, least_damping=MIN_DAMPING)
            if other.least_damped is not None:
                without[name] = other.largest_gain
        largest = max(without, key=lambda name: without[name] or np.inf, default=None)
        if largest is not None and usable is not None and (without[largest] or np.inf) > notable * usable:
            effect = largest
    return number, RingingRecord(**loop.model_dump(), usable_gain=usable, effect=effect, without=without)


def worst_loop(phases: Sequence[Phase], ideal: xr.Dataset) -> LoopRecord:
    """Analyse the loop of the bodies in the mean flow along the ideal run, over its links, in the worst phase."""
    loops = [loop_in_run(system, data) for _, system, data in _ways(phases, ideal)]
    stable = {loop.stable for loop in loops}
    reasons = [*(loop.reason for loop in loops), "" if loops else "the run is too short"]
    return LoopRecord(
        stable=next((verdict for verdict in (False, None, True) if verdict in stable), None),
        largest_gain=min((loop.largest_gain for loop in loops if loop.largest_gain is not None), default=None),
        reason=next(filter(None, reasons), ""),
    )


def _ways(phases: Sequence[Phase], ideal: xr.Dataset) -> Iterator[tuple[int, System, xr.Dataset]]:
    """Yield the number, the system and the data of each phase of the ideal run that has two samples."""
    for k in np.unique(ideal["phase"].values).tolist():
        system, data = of_phase(phases, ideal, k)
        if data.sizes["time"] > 1:
            yield k, system, data


def _variants(system: System) -> Iterator[tuple[Effect, System]]:
    """Yield the system without each effect that may limit the gain."""
    present = effects_of(system, system.bodies.vehicle[: len(system.team.agents)])
    effects: tuple[Effect, Effect] = ("lag", "underactuation")
    for name in effects:
        if name in present:
            without = system.bodies.effects.model_copy(update={name: False})
            yield name, replace(system, bodies=replace(system.bodies, effects=without))
    if not (system.grid.continuous or system.law.extended):
        yield "hold", replace(system, grid=replace(system.grid, continuous=True))
    if system.law.links.table["delay"].any():
        yield "links", without_links(system)


def _without_losses(system: System) -> System:
    """Return the system over links that lose nothing."""
    table = system.law.links.table.copy()
    table["lossy"] = 0
    table["range"] = np.inf
    return replace(system, law=system.law._replace(links=system.law.links._replace(table=table)))


def try_gains(
    phases: Sequence[Phase],
    given: Run,
    largest_stable: float | None,
    progress: Report = no_progress,
    *,
    factors: Sequence[float] = (2.0, 4.0),
    below_unstable: float = 0.9,
    worth_trying: float = 1.05,
) -> list[GainTrialRecord]:
    """Run the bodies as given at multiples of the gain; return these runs after that at the gain itself, or nothing.

    Args:
        phases: Phases of the scenario.
        given: Run of the scenario as given.
        largest_stable: Gain above which the vehicles' loop is unstable, 1/s; None if unknown.
        progress: See `Report`.
        factors: Multiples of the present gain that are tried.
        below_unstable: Largest gain that is tried, as a fraction of the gain that makes the loop unstable.
        worth_trying: Smallest multiple of the present gain that is tried.
    """
    gain = phases[0].system.gain
    most = np.inf if largest_stable is None else below_unstable * largest_stable / gain
    tried = [float(f"{min(factor, most):.3g}") for factor in factors]
    tried = [factor for factor in dict.fromkeys(tried) if factor > worth_trying]
    trials = [_trial(given, gain)] if tried else []
    variant = Variant("all", "higher gain", "all", given.variant.setup)
    for k, factor in enumerate(tried):
        progress("trying higher gains", k, len(tried))
        higher = changed_systems(phases, partial(_with_gain, factor))
        trials.append(_trial(run_ablation(higher, [variant])["all"], factor * gain))
    return trials


def _with_gain(factor: float, system: System) -> System:
    """Multiply the agents' gain."""
    gain = system.law.gain.copy()
    gain[: len(system.team.agents)] *= factor
    return replace(system, gain=factor * system.gain, law=system.law._replace(gain=gain))


def _trial(run: Run, gain: float) -> GainTrialRecord:
    total = saturation_of(run.system, run.dataset, ["agents"])
    return GainTrialRecord(
        gain=gain,
        status=run.dataset.attrs["status"],
        ending=run.ending(),
        late=run.errors()[TEAM].late,
        saturated=total[0].share if total else None,
    )


# -- speeds ------------------------------------------------------------------------------------------------------------
#
# Speeds that the law and the motions command, against the speeds that vehicles reach. The cost of the law's velocity
# limit follows from the variants of the ladder without it.

Domain = Literal["the plane", "space"]

JUDGED: tuple[Literal["ideal"], Literal["all"]] = ("ideal", "all")
"""Keys of the runs whose demands and limits are examined."""

_DOMAIN: dict[int, Domain] = {2: "the plane", 3: "space"}


class VelocityLimitRecord(FiniteRecord):
    """The law's velocity limit (controller.velocity_limit, or that of single agents); the ladder has its cost."""

    lowest_m_s: float
    highest_m_s: float
    asked_m_s: float = Field(
        description="maximum speed in the second half of the ideal run or phase without a limit; a sufficient limit"
    )
    who: str
    exceeded: bool = Field(description="there, an agent is asked for more than its own limit; else on the way alone")
    share_at_limit: dict[Literal["ideal", "all"], float] = Field(
        description="fraction of agents and samples at the limit, in the second half of the ideal run or phase, and in "
        "that of the scenario as given"
    )


class DemandRecord(FiniteRecord):
    """Speeds commanded to the vehicles of one kind in the second half of a run, relative to the medium."""

    run: Literal["ideal", "all"]
    role: Role
    vehicle: str
    moves_in: Domain
    asked_m_s: float
    who: str
    time_s: float
    share_beyond: float = Field(description="fraction of the time in which `who` is commanded beyond least_speed_m_s")
    least_speed_m_s: Finite = Field(
        description="steady speed through the medium at full thrust in the slowest horizontal direction; null: no limit"
    )
    forward_speed_m_s: Finite = Field(
        description="steady speed through the medium at full thrust straight ahead; null: no limit"
    )


class FastestRecord(FiniteRecord):
    """The fastest vehicle with limits that comes with mjsheaf."""

    moves_in: Domain
    vehicle: str
    speed_m_s: float


def demands_of(system: System, key: Literal["ideal", "all"], run: Run) -> list[DemandRecord]:
    """Return the speeds commanded to each kind of vehicle in the second half of a run; none if it blew up."""
    if not run.finished:
        return []
    speed, chosen = _late_speeds(run, span_of(run.phases))
    found = []
    for (role, name), members in vehicles_by_role(system).items():
        k, j = np.unravel_index(int(speed[:, members].argmax()), (len(chosen), len(members)))
        v, able = members[int(j)], system.vehicles[members[0]].capability
        found.append(
            DemandRecord(
                run=key,
                role=role,
                vehicle=name,
                moves_in=_DOMAIN[system.team.members[v].dimension],
                asked_m_s=float(speed[k, v]),
                who=system.team.members[v].id,
                time_s=float(run.time[chosen[k]]),
                share_beyond=float((speed[:, v] > able.least_speed).mean()),
                least_speed_m_s=able.least_speed,
                forward_speed_m_s=able.forward_speed,
            )
        )
    return found


def fastest_vehicles(system: System) -> list[FastestRecord]:
    """Return the fastest vehicle with limits in the plane, then in space."""
    fastest: dict[Domain, FastestRecord] = {}
    for name in list_vehicles():
        vehicle = system.described_vehicle(name)
        domain, speed = _DOMAIN[vehicle.dimension], vehicle.capability.least_speed
        if np.isfinite(speed) and (domain not in fastest or speed > fastest[domain].speed_m_s):
            fastest[domain] = FastestRecord(moves_in=domain, vehicle=name, speed_m_s=speed)
    return [fastest[domain] for domain in _DOMAIN.values() if domain in fastest]


def velocity_limit_of(
    runs: dict[str, Run],
    number: int | None = None,
    *,
    at_limit: float = 1.0 - 1e-9,  # of the limit
) -> VelocityLimitRecord | None:
    """Find the velocity limit that would suffice, over the whole run or a phase; None if no agent has one there.

    Args:
        runs: Runs of the ladder by key.
        number: Number of the phase, which the ideal run and the scenario as given must have reached; None for the whole
            run.
        at_limit: Fraction of the limit at which a command is at it.
    """
    phases = runs["ideal"].phases
    system = phases[0].system
    some = phases if number is None else phases[number : number + 1]
    if not has_limits(some):
        return None
    span = span_of(phases, number)
    limits = np.array([phase.system.law.limit[: len(system.team.agents)] for phase in some])
    limited = np.isfinite(limits) & (limits > 0.0)
    speed, _ = _late_speeds(runs["ideal-limit"], span)
    largest = np.where(limited.any(axis=0), speed[:, : limits.shape[1]].max(axis=0, initial=0.0), -1.0)
    share = dict[Literal["ideal", "all"], float]()
    for key in JUDGED:
        speed, chosen = _late_speeds(runs[key], span)
        own = runs[key].limits[chosen]
        held = (speed[:, : own.shape[1]] >= at_limit * own)[own > 0.0]
        share[key] = float(held.mean()) if held.size else 0.0
    return VelocityLimitRecord(
        lowest_m_s=float(limits[limited].min()),
        highest_m_s=float(limits[limited].max()),
        asked_m_s=float(largest.max()),
        who=system.team.agent_ids[int(largest.argmax())],
        exceeded=bool((largest > np.where(limited, limits, np.inf).min(axis=0)).any()),
        share_at_limit=share,
    )


def _late_speeds(run: Run, span: Span) -> tuple[Array, IntArray]:
    """Return |v_c| of every vehicle in the second half of a span, shape (T, V), m/s, and the numbers of its samples."""
    chosen = np.flatnonzero(span.last_half(len(run.asked)))
    return run.asked[chosen], chosen
