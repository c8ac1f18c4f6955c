"""Speeds that the law and the motions command, against the speeds that vehicles reach.

The cost of the law's velocity limit follows from the ideal run and the scenario as given, both run again without it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.comparing.ladder import Run, changed_systems, ladder_of, run_ablation, span_of_phase
from mjsheaf.comparing.measures import Role, ScopeRecord, Span, middle_of, vehicles_by_role, whole_run
from mjsheaf.scenario.load import LawFile
from mjsheaf.section import Finite, FiniteRecord
from mjsheaf.system import Phase, System
from mjsheaf.vehicles.effects import capability_of
from mjsheaf.vehicles.loading import list_vehicles

Domain = Literal["the plane", "space"]

JUDGED: tuple[Literal["ideal"], Literal["all"]] = ("ideal", "all")
"""Keys of the runs whose demands and limits are examined."""

_DOMAIN: dict[int, Domain] = {2: "the plane", 3: "space"}
_MOST_SAMPLES = 20_000  # approximate maximum number of samples of a run that are examined
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
    time = run.trajectory.time
    chosen, speed = _commanded_speeds(run, time >= middle_of(system) - 1e-9)
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
                time_s=float(time[chosen[k]]),
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


@dataclass(frozen=True)
class UnlimitedRuns:
    """Runs with the law's velocity limit, and the same runs without it.

    Attributes:
        limited: Runs of the ladder by key.
        without: Runs without velocity limits by key, those of JUDGED.
    """

    limited: dict[str, Run]
    without: dict[str, Run]

    def record(self, phase: int | None = None) -> VelocityLimitRecord | None:
        """Compare them over the whole run, or over a phase; None if no agent has a limit there."""
        ideal = self.limited["ideal"]
        system, phases = ideal.system, ideal.recording.phases
        span = whole_run(system) if phase is None else span_of_phase(phases, phase)
        some = phases if phase is None else phases[phase : phase + 1]
        limits = np.array([one.system.law.limit[: len(system.team.agents)] for one in some])
        limited = np.isfinite(limits) & (limits > 0.0)
        if not limited.any():
            return None
        asked, _ = _late_speeds(self.without["ideal"], span)
        most = np.where(limited.any(axis=0), asked.max(axis=0, initial=0.0), -1.0)
        return VelocityLimitRecord(
            lowest_m_s=float(limits[limited].min()),
            highest_m_s=float(limits[limited].max()),
            asked_m_s=float(most.max()),
            who=system.team.agent_ids[int(most.argmax())],
            runs=[self._compared(key, phase, span) for key in JUDGED],
        )

    def _compared(self, key: Literal["ideal", "all"], phase: int | None, span: Span) -> UnlimitedRecord:
        without = self.without[key]
        speed, limits = _late_speeds(self.limited[key], span)
        held = (speed >= _AT_LIMIT * limits)[limits > 0.0]
        return UnlimitedRecord(
            run=key,
            share_at_limit=float(held.mean()) if held.size else 0.0,
            status_without=without.trajectory.status,
            errors_without=without.errors if phase is None else without.errors_in_phase(phase),
        )


def run_without_limits(
    phases: Sequence[Phase], runs: dict[str, Run], law: LawFile | None = None, seed: int = 0
) -> UnlimitedRuns | None:
    """Run a scenario without its velocity limits; None if no agent has one. See `run_ablation` for `law` and `seed`."""
    agents = len(phases[0].system.team.agents)
    if not any(np.isfinite(phase.system.law.limit[:agents]).any() for phase in phases):
        return None
    unlimited = changed_systems(phases, _without_limits)
    judged = [variant for variant in ladder_of(unlimited) if variant.key in JUDGED]
    return UnlimitedRuns(runs, run_ablation(unlimited, judged, law=law, seed=seed))


def _without_limits(system: System) -> System:
    """Return the system without velocity limits; absent agents are still commanded to rest."""
    return replace(system, law=system.law._replace(limit=np.where(system.law.limit > 0.0, np.inf, 0.0)))


def _late_speeds(run: Run, span: Span) -> tuple[Array, Array]:
    """Return |v_c| of every agent in the second half of a span, thinned, and its limit, shapes (T, N), m/s.

    The limit of an absent agent is 0.
    """
    chosen, speeds = _commanded_speeds(run, span.last_half(len(run.trajectory.time)))
    return speeds[:, : len(run.system.team.agents)], run.recording.limits[chosen]


def _commanded_speeds(run: Run, wanted: NDArray[np.bool_]) -> tuple[NDArray[np.int64], Array]:
    """Return the indices of the selected samples, thinned, and |v_c| of every vehicle there, shape (T, V), m/s.

    At most about _MOST_SAMPLES are returned. v_c is the law's command, relative to the medium.
    """
    chosen = np.flatnonzero(wanted)
    chosen = chosen[:: max(1, len(chosen) // _MOST_SAMPLES)]
    return chosen, np.linalg.norm(run.trajectory.log.command[chosen], axis=2)
