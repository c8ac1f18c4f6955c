"""What is measured of a run: errors, distance to the ideal run, saturation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjsheaf.results.metrics import Errors
from mjsheaf.simulation.trajectory import Trajectory
from mjsheaf.system import System

Array = NDArray[np.float64]

TRACKING, FORMATION, CENTERING = "tracking_error", "formation_error", "centering_error"
TEAM = "team"
"""The scope of an error that is the whole team's; the other scopes are names of groups."""


@dataclass(frozen=True)
class Series:
    """Errors of the team or of one group over time.

    Attributes:
        tracking_error: RMS over the agents of |q*_i - q_i|, shape (T,), m.
        formation_error: RMS over the edges inside groups, shape (T,), m; NaN where there is none.
        centering_error: largest distance of a group's centroid from where its formation wants it, shape (T,), m; NaN
            where there is none.
    """

    tracking_error: Array
    formation_error: Array
    centering_error: Array


@dataclass(frozen=True)
class Distance:
    """How far agents are from where they were in another run.

    Attributes:
        largest: m.
        agent: who was there.
        time: when, s.
    """

    largest: float
    agent: str
    time: float


def series_of(system: System, errors: Errors) -> dict[str, Series]:
    """Errors over time by scope: the team first, then its groups."""

    def tracking(members: list[int]) -> Array:
        return np.sqrt((errors.tracking[:, members] ** 2).mean(axis=1))

    found = {
        TEAM: Series(tracking(list(range(len(system.team.agents)))), errors.formation_rms(), errors.largest_centering())
    }
    for f in system.team.formations:
        found[f.name] = Series(
            tracking([system.team.index[m] for m in f.members]), errors.formation_rms(f.name), errors.centering[f.name]
        )
    return found


def positions_at_q_star(system: System, positions: Array) -> Array:
    """Positions (..., V, 3) with the agents where the harmonic extension of its targets wants them, m."""
    placed = positions.copy()
    placed[..., : len(system.team.agents), :] = system.team.harmonic_extension(positions)
    return placed


def formation_size(system: System) -> float:
    """RMS over the edges inside groups of the distance that they ask for, m; NaN where there is none."""
    team = system.team
    asked = [float(e.b @ e.b) for f in team.formations for e in team.formation_edges(f)]
    return float(np.sqrt(np.mean(asked))) if asked else float("nan")


def late(system: System, time: Array) -> NDArray[np.bool_]:
    """Which samples lie in the last half of the run that was asked for, shape (T,)."""
    grid = system.grid
    return np.asarray(time >= grid.start + 0.5 * grid.period * grid.steps)


def root_mean_square(values: Array, chosen: NDArray[np.bool_]) -> float:
    """RMS over the chosen samples; NaN where there are none, or the values have no meaning."""
    return float(np.sqrt((values[chosen] ** 2).mean())) if chosen.any() else float("nan")


def distance_between(system: System, one: Trajectory, other: Trajectory, start: float) -> Distance | None:
    """Largest distance of an agent in one run from itself in another, from time `start` on, s; None without samples."""
    samples = min(len(one.time), len(other.time))
    chosen = np.flatnonzero(one.time[:samples] >= start - 1e-9)
    if not chosen.size:
        return None
    N = len(system.team.agents)
    apart = np.linalg.norm(one.positions[chosen, :N] - other.positions[chosen, :N], axis=2)
    k, i = np.unravel_index(int(apart.argmax()), apart.shape)
    return Distance(float(apart[k, i]), system.team.agent_ids[int(i)], float(one.time[chosen[k]]))


def saturation_shares(system: System, trajectory: Trajectory, counts: list[int]) -> dict[tuple[str, str], float]:
    """Time share of thrusters at a limit, by role ('agents' or 'targets') and vehicle; ('agents', '') is all of them.

    Args:
        system: the system.
        trajectory: of bodies.
        counts: number of thrusters of each vehicle, length V.
    """
    share, N = trajectory.log.saturation.mean(axis=0), len(system.team.agents)
    found = {("agents", ""): float(np.average(share[:N], weights=counts[:N]))}
    for v, name in enumerate(system.bodies.vehicle):
        found.setdefault(("agents" if v < N else "targets", name), 0.0)
    for role, name in list(found)[1:]:
        span = range(N) if role == "agents" else range(N, len(counts))
        alike = [v for v in span if system.bodies.vehicle[v] == name]
        found[role, name] = float(share[alike].mean())
    return found
