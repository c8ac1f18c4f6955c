"""Speeds that the law and the motions ask for, against what vehicles can do.

What the law's velocity limit costs: the ideal run and the scenario as it stands, run again without it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjsheaf.comparing.ladder import Run, climb, ladder_of
from mjsheaf.comparing.measures import late
from mjsheaf.system import System
from mjsheaf.vehicles.effects import capability_of
from mjsheaf.vehicles.loading import list_vehicles

Array = NDArray[np.float64]

_MOST_SAMPLES = 20_000  # of a run that are looked at


@dataclass(frozen=True)
class Demand:
    """What the vehicles of one kind and role are asked for in a run, from some time on.

    Attributes:
        role: 'agents' or 'targets'.
        vehicle: name of the vehicle.
        dimension: 2 on the surface, 3 in a volume.
        asked: largest |v_c| relative to the medium, m/s.
        who: which of them was asked for it.
        time: when, s.
        share_beyond: time share in which who is asked for more than `least_speed`.
        least_speed: steady speed that the vehicle can hold in every horizontal direction, m/s; infinite without limits.
        forward_speed: the same forward.
    """

    role: str
    vehicle: str
    dimension: int
    asked: float
    who: str
    time: float
    share_beyond: float
    least_speed: float
    forward_speed: float


@dataclass(frozen=True)
class Fastest:
    """The fastest vehicle with limits that comes with mjsheaf, in one dimension.

    Attributes:
        dimension: 2 on the surface, 3 in a volume.
        vehicle: its name.
        speed: m/s through the medium, in every horizontal direction.
    """

    dimension: int
    vehicle: str
    speed: float


def demands_of(system: System, time: Array, commands: Array, start: float) -> list[Demand]:
    """What each kind of vehicle is asked for in a run, from time `start` on, s; agents first.

    Args:
        system: the scenario's, whose vehicles must do it.
        time: of the run, shape (T,), s.
        commands: velocities that the law asked for in the run, shape (T, V, 3), m/s.
        start: s.
    """
    chosen = np.flatnonzero(time >= start - 1e-9)
    chosen = chosen[:: max(1, len(chosen) // _MOST_SAMPLES)]
    if not chosen.size:
        return []
    speed = np.linalg.norm(commands[chosen], axis=2)
    vehicles, members, N = system.vehicles, system.team.members, len(system.team.agents)
    kinds = dict.fromkeys(("agents" if v < N else "targets", system.bodies.vehicle[v]) for v in range(len(members)))
    found = []
    for role, name in kinds:
        span = range(N) if role == "agents" else range(N, len(members))
        alike = [v for v in span if system.bodies.vehicle[v] == name]
        k, j = np.unravel_index(int(speed[:, alike].argmax()), (len(chosen), len(alike)))
        v, able = alike[int(j)], capability_of(vehicles[alike[0]])
        found.append(
            Demand(
                role=role,
                vehicle=name,
                dimension=members[v].dimension,
                asked=float(speed[k, v]),
                who=members[v].id,
                time=float(time[chosen[k]]),
                share_beyond=float((speed[:, v] > able.least_speed).mean()),
                least_speed=able.least_speed,
                forward_speed=able.forward_speed,
            )
        )
    return found


def fastest_vehicles(system: System) -> list[Fastest]:
    """The fastest real vehicle of mjsheaf on the surface, then in the air; a system has some of them already."""
    able = {name: system.described_vehicle(name) for name in list_vehicles()}
    found = []
    for dimension in (2, 3):
        speeds = {n: capability_of(v).least_speed for n, v in able.items() if v.dimension == dimension}
        real = {name: speed for name, speed in speeds.items() if np.isfinite(speed)}
        if real:
            best = max(real, key=lambda name: real[name])
            found.append(Fastest(dimension, best, real[best]))
    return found


RUNS = ("ideal", "all")
_AT_LIMIT = 1.0 - 1e-9


@dataclass(frozen=True)
class VelocityLimit:
    """The law's limits and what runs without them give.

    Attributes:
        lowest, highest: limits of the agents that have one, m/s.
        shares: share of the last half of a run, over samples and agents, at the limit; by key of RUNS.
        asked: largest speed in the last half of the ideal run without limits, of an agent that has one, m/s.
        who: that agent.
        without: runs without limits, by key of RUNS.
    """

    lowest: float
    highest: float
    shares: dict[str, float]
    asked: float
    who: str
    without: dict[str, Run]


def examine_limit(system: System, runs: dict[str, Run]) -> VelocityLimit | None:
    """Run a scenario without its velocity limits; None where no agent has one.

    Args:
        system: the scenario's system.
        runs: of the ladder, by key; those of RUNS are looked at.
    """
    team, limits = system.team, system.law.limit[: len(system.team.agents)]
    limited = np.flatnonzero(np.isfinite(limits))
    if not limited.size:
        return None
    free = replace(system, law=system.law._replace(limit=np.full_like(system.law.limit, np.inf)))
    without = climb(free, [rung for rung in ladder_of(free) if rung.key in RUNS])
    asked = _late_speeds(free, without["ideal"])[:, limited]
    most = asked.max(axis=0, initial=0.0)
    return VelocityLimit(
        lowest=float(limits[limited].min()),
        highest=float(limits[limited].max()),
        shares={key: _share(system, runs[key]) for key in RUNS},
        asked=float(most.max()),
        who=team.agent_ids[int(limited[most.argmax()])],
        without=without,
    )


def _share(system: System, run: Run) -> float:
    limits = system.law.limit[: len(system.team.agents)]
    speeds = _late_speeds(system, run)
    return float((speeds >= _AT_LIMIT * limits).mean()) if speeds.size else 0.0


def _late_speeds(system: System, run: Run) -> np.ndarray:
    """|v_c| of every agent in the last half of a run, thinned, shape (T, N), m/s."""
    time = run.trajectory.time
    chosen = np.flatnonzero(late(system, time))
    chosen = chosen[:: max(1, len(chosen) // _MOST_SAMPLES)]
    return np.linalg.norm(run.trajectory.log.command[chosen, : len(system.team.agents)], axis=2)
