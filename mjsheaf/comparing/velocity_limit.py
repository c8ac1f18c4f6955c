"""What the law's velocity limit costs: the ideal run and the scenario as it stands, run again without it."""

from dataclasses import dataclass, replace

import numpy as np

from mjsheaf.backends.system import System
from mjsheaf.comparing.climbing import Run, climb
from mjsheaf.comparing.demands import commanded_speeds
from mjsheaf.comparing.ladder import ladder_of
from mjsheaf.comparing.measures import late

RUNS = ("ideal", "all")
_AT_LIMIT = 1.0 - 1e-9
_MOST_SAMPLES = 20_000


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
    time, positions = run.trajectory.time, run.trajectory.positions
    chosen = np.flatnonzero(late(system, time))
    chosen = chosen[:: max(1, len(chosen) // _MOST_SAMPLES)]
    return commanded_speeds(system, time[chosen], positions[chosen])[:, : len(system.team.agents)]
