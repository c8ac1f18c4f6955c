"""Speeds that the law and the motions command, against the speeds that vehicles reach, and the cost of their limit.

The cost of the law's velocity limit follows from the variants of the ladder without it.
"""

from typing import Literal

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array, IntArray
from mjsheaf.comparing.measures import Role, ScopeRecord, Span, vehicles_by_role, whole_run
from mjsheaf.comparing.variants import Run, has_limits, span_of_phase
from mjsheaf.section import Finite, FiniteRecord
from mjsheaf.system import System
from mjsheaf.vehicles.effects import capability_of
from mjsheaf.vehicles.loading import list_vehicles

Domain = Literal["the plane", "space"]

JUDGED: tuple[Literal["ideal"], Literal["all"]] = ("ideal", "all")
"""Keys of the runs whose demands and limits are examined."""

_DOMAIN: dict[int, Domain] = {2: "the plane", 3: "space"}
_AT_LIMIT = 1.0 - 1e-9  # of the limit


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


def _compared(key: Literal["ideal", "all"], runs: dict[str, Run], number: int | None, span: Span) -> UnlimitedRecord:
    speed, chosen = _late_speeds(runs[key], span)
    limits = runs[key].limits[chosen]
    held = (speed[:, : limits.shape[1]] >= _AT_LIMIT * limits)[limits > 0.0]
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
