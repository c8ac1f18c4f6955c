"""How far gain and speeds are from their limits: ringing, runs at higher gains, commanded speeds, the velocity limit.

Ringing is the least damped mode of the vehicles' loop of `check` (see `body_loop`), in the mean flow along the ideal
run. Losses of links are left out, and so is their noise; delays are part of the loop. The usable gain is that up to
which every mode keeps a damping ratio of 0.3: a displacement then overshoots by 37 %. What limits it is the effect
without which the loop has the largest usable gain.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.loop.body_loop import BodyLoop, loop_along
from mjsheaf.comparing.measures import (
    TEAM,
    ErrorsRecord,
    Role,
    ScopeRecord,
    Span,
    saturation_of,
    vehicles_by_role,
    whole_run,
)
from mjsheaf.comparing.variants import (
    Run,
    Variant,
    changed_systems,
    effects_of,
    has_limits,
    run_ablation,
    span_of_phase,
    without_links,
)
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.ending import Ending
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.section import Finite, FiniteRecord
from mjsheaf.system import Phase, System
from mjsheaf.vehicles.effects import capability_of
from mjsheaf.vehicles.loading import list_vehicles

MIN_DAMPING = 0.3
"""Smallest damping ratio at a usable gain."""

_FACTORS = (2.0, 4.0)  # multiples of the present gain that are tried

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


class GainLimitRecord(FiniteRecord):
    """A gain above which the team rings or is unstable."""

    gain: float = Field(description="k1, 1/s")
    kind: Literal["rings", "unstable"] = Field(
        description=f"rings: the damping ratio of the least damped mode falls to {MIN_DAMPING}; unstable: the "
        "vehicles' loop becomes unstable"
    )
    effect: Literal["inertia", "lag", "underactuation", "hold", "links", "loop"] = Field(
        description="cause of the limit: inertia, thruster lag, vehicles that turn before they thrust, the hold of the "
        "law over its control period, the age of measurements, or the vehicles' loop as a whole"
    )
    agent: str = Field(description="agent that moves most in the mode; empty if all do, or if unknown")


class GainTrialRecord(FiniteRecord):
    """A run of the bodies as given at a gain."""

    gain: float = Field(description="k1, 1/s")
    status: str
    ending: Ending | None
    late: ErrorsRecord = Field(description="errors of the team, RMS over the second half, m")
    saturated: Finite = Field(description="fraction of time and of agents' thrusters at a limit, 0 to 1")


class GainRecord(FiniteRecord):
    """Limits of the gain, and runs at higher gains."""

    limits: list[GainLimitRecord] = Field(description="limits of the gain, lowest first")
    trials: list[GainTrialRecord] = Field(description="runs at the present gain, then at higher ones; may be empty")


class Way(NamedTuple):
    """A phase of the ideal run.

    Attributes:
        number: Number of the phase.
        system: Its system, of the agents that are present.
        time: Times of its samples, shape (T,), s.
        q_star: Harmonic extensions, padded with 0, shape (T, N, 3), m.
    """

    number: int
    system: System
    time: Array
    q_star: Array


def ways_of(phases: Sequence[Phase], ideal: Run) -> list[Way]:
    """Return the phases that the ideal run reached, with the bodies of the scenario."""
    found = []
    for k in range(ideal.phases_reached):
        system, data = of_phase(phases, ideal.dataset, k)
        q_star = np.nan_to_num(data["harmonic_extension"].values)
        found.append(Way(k, system, data["time"].values, q_star))
    return [way for way in found if len(way.time) > 1]


def find_ringing(
    ways: Sequence[Way],
    *,
    notable: float = 1.2,  # factor on the usable gain, without an effect, below which it is no cause
) -> tuple[int, RingingRecord | None]:
    """Return the number of the phase whose loop is least damped, and that loop; None if it is undecided in all."""
    least = np.inf
    found: tuple[Way, BodyLoop] | None = None
    for way in ways:
        loop = loop_along(_without_losses(way.system), way.time, way.q_star)
        if loop.least_damped is not None and loop.least_damped.damping < least:
            least = loop.least_damped.damping
            found = way, loop
    if found is None:
        return 0, None
    way, loop = found
    usable = _usable(way, _without_losses(way.system)).largest_gain
    without = {name: one.largest_gain for name, one in _variants(way) if one.least_damped is not None}
    effect: Effect = "inertia"
    if without and usable is not None:
        largest = max(without, key=lambda name: without[name] or np.inf)
        effect = largest if (without[largest] or np.inf) > notable * usable else effect
    return way.number, RingingRecord(**loop.model_dump(), usable_gain=usable, effect=effect, without=without)


def _usable(way: Way, system: System) -> BodyLoop:
    """Close the loop of a system; its `largest_gain` is the usable gain."""
    return loop_along(system, way.time, way.q_star, least_damping=MIN_DAMPING)


def _variants(way: Way) -> Iterator[tuple[Effect, BodyLoop]]:
    """Yield the loop without each effect that may limit the gain."""
    system = _without_losses(way.system)
    present = effects_of(system, system.bodies.vehicle[: len(system.team.agents)])
    effects: tuple[Effect, Effect] = ("lag", "underactuation")
    for name in effects:
        if name in present:
            without = system.bodies.effects.model_copy(update={name: False})
            yield name, _usable(way, replace(system, bodies=replace(system.bodies, effects=without)))
    if not (system.grid.continuous or system.law.extended):
        yield "hold", _usable(way, replace(system, grid=replace(system.grid, continuous=True)))
    if system.law.links.table["delay"].any():
        yield "links", _usable(way, without_links(system))


def _without_losses(system: System) -> System:
    """Return the system over links that lose nothing."""
    table = system.law.links.table.copy()
    table["lossy"] = 0
    table["range"] = np.inf
    return replace(system, law=system.law._replace(links=system.law.links._replace(table=table)))


def examine_gain(
    phases: Sequence[Phase],
    runs: dict[str, Run],
    ringing: RingingRecord | None,
    largest_stable: float | None,
    progress: Progress = no_progress,
) -> GainRecord:
    """Find what limits the gain, and run the bodies as given at 2 and 4 times the gain.

    Args:
        phases: Phases of the scenario.
        runs: Runs of the ladder.
        ringing: See `find_ringing`.
        largest_stable: Gain above which the vehicles' loop is unstable, 1/s; None if unknown.
        progress: See `Progress`.
    """
    limits = []
    if ringing is not None and ringing.usable_gain is not None:
        agent = ringing.least_damped.agent if ringing.least_damped else None
        limits.append(GainLimitRecord(gain=ringing.usable_gain, kind="rings", effect=ringing.effect, agent=agent or ""))
    if largest_stable is not None:
        limits.append(GainLimitRecord(gain=largest_stable, kind="unstable", effect="loop", agent=""))
    gain = phases[0].system.gain
    factors = _factors(gain, largest_stable)
    trials = [_trial(runs["all"], gain)] if factors else []
    variant = Variant("all", "higher gain", "all", runs["all"].variant.setup)
    for k, factor in enumerate(factors):
        progress("trying higher gains", k, len(factors))
        raised = run_ablation(_with_gain(phases, factor), [variant])["all"]
        trials.append(_trial(raised, factor * gain))
    return GainRecord(limits=sorted(limits, key=lambda limit: limit.gain), trials=trials)


def _factors(
    gain: float,
    largest_stable: float | None,
    *,
    below_unstable: float = 0.9,  # largest gain that is tried, as a fraction of the gain that makes the loop unstable
    worth_trying: float = 1.05,  # smallest multiple of the present gain that is tried
) -> list[float]:
    """Choose the factors to raise the gain by; none if the gain is 0, or the loop is unstable just above it."""
    if gain <= 0.0:
        return []
    most = np.inf if largest_stable is None else below_unstable * largest_stable / gain
    chosen = dict.fromkeys(min(factor, most) for factor in _FACTORS)
    return [float(f"{factor:.3g}") for factor in chosen if factor > worth_trying]


def _with_gain(phases: Sequence[Phase], factor: float) -> tuple[Phase, ...]:
    """Multiply the agents' gain in every phase."""

    def raised(system: System) -> System:
        gain = system.law.gain.copy()
        gain[: len(system.team.agents)] *= factor
        return replace(system, gain=factor * system.gain, law=system.law._replace(gain=gain))

    return changed_systems(phases, raised)


def _trial(run: Run, gain: float) -> GainTrialRecord:
    total = saturation_of(run.system, run.dataset, ["agents"])
    return GainTrialRecord(
        gain=gain,
        status=run.dataset.attrs["status"],
        ending=run.ending(),
        late=run.errors[TEAM].late,
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


class UnlimitedRecord(FiniteRecord):
    """A run with the law's velocity limit, and the same run without it."""

    run: Literal["ideal", "all"]
    share_at_limit: float = Field(
        description="fraction of agents and samples at the limit, in the second half of the run or phase"
    )
    status_without: str
    errors_without: dict[str, ScopeRecord] = Field(description="by scope, as in the ladder")


class VelocityLimitRecord(FiniteRecord):
    """The law's velocity limit (controller.velocity_limit, or that of single agents) and its cost."""

    lowest_m_s: float
    highest_m_s: float
    asked_m_s: float = Field(
        description="maximum speed in the second half of the ideal run or phase without a limit; a sufficient limit"
    )
    who: str
    runs: list[UnlimitedRecord]

    def run(self, key: str) -> UnlimitedRecord:
        """Return the record of the ideal run ('ideal') or of the scenario as given ('all')."""
        return next(run for run in self.runs if run.run == key)


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
    speed, chosen = _late_speeds(run, whole_run(system))
    found = []
    for (role, name), members in vehicles_by_role(system).items():
        k, j = np.unravel_index(int(speed[:, members].argmax()), (len(chosen), len(members)))
        v, able = members[int(j)], capability_of(system.vehicles[members[0]])
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
        domain, speed = _DOMAIN[vehicle.dimension], capability_of(vehicle).least_speed
        if np.isfinite(speed) and (domain not in fastest or speed > fastest[domain].speed_m_s):
            fastest[domain] = FastestRecord(moves_in=domain, vehicle=name, speed_m_s=speed)
    return [fastest[domain] for domain in _DOMAIN.values() if domain in fastest]


def velocity_limit_of(runs: dict[str, Run], number: int | None = None) -> VelocityLimitRecord | None:
    """Compare runs with and without the velocity limit, over the whole run or a phase; None if no agent has one there.

    Args:
        runs: Runs of the ladder by key.
        number: Number of the phase, which the ideal run and the scenario as given must have reached; None for the whole
            run.
    """
    phases = runs["ideal"].phases
    system = phases[0].system
    some = phases if number is None else phases[number : number + 1]
    if not has_limits(some):
        return None
    span = whole_run(system) if number is None else span_of_phase(phases, number)
    limits = np.array([phase.system.law.limit[: len(system.team.agents)] for phase in some])
    limited = np.isfinite(limits) & (limits > 0.0)
    speed, _ = _late_speeds(runs["ideal-limit"], span)
    largest = np.where(limited.any(axis=0), speed[:, : limits.shape[1]].max(axis=0, initial=0.0), -1.0)
    return VelocityLimitRecord(
        lowest_m_s=float(limits[limited].min()),
        highest_m_s=float(limits[limited].max()),
        asked_m_s=float(largest.max()),
        who=system.team.agent_ids[int(largest.argmax())],
        runs=[_compared(key, runs, number, span) for key in JUDGED],
    )


def _compared(
    key: Literal["ideal", "all"],
    runs: dict[str, Run],
    number: int | None,
    span: Span,
    *,
    at_limit: float = 1.0 - 1e-9,  # of the limit
) -> UnlimitedRecord:
    speed, chosen = _late_speeds(runs[key], span)
    limits = runs[key].limits[chosen]
    held = (speed[:, : limits.shape[1]] >= at_limit * limits)[limits > 0.0]
    without = runs[f"{key}-limit"]
    return UnlimitedRecord(
        run=key,
        share_at_limit=float(held.mean()) if held.size else 0.0,
        status_without=without.dataset.attrs["status"],
        errors_without=without.errors if number is None else without.errors_in_phase(number),
    )


def _late_speeds(run: Run, span: Span) -> tuple[Array, IntArray]:
    """Return |v_c| of every vehicle in the second half of a span, shape (T, V), m/s, and the numbers of its samples."""
    chosen = np.flatnonzero(span.last_half(len(run.asked)))
    return run.asked[chosen], chosen
