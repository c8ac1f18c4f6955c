"""The region over which the theorem's constants are taken.

Targets do not react to agents, so what they do in a run is known before it: constants that depend on targets are taken
along their trajectories. Agents may be anywhere in a box that holds their trajectories and their harmonic extension.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from mjsheaf.backends.ideal import run_ideal
from mjsheaf.backends.system import System
from mjsheaf.checking.drift import target_drift
from mjsheaf.dynamics.disturbance import evaluate

Array = NDArray[np.float64]

MOST_VEHICLE_STEPS = 3_000_000
"""Beyond this product of vehicles and samples no run is made, and the box is guessed from the initial condition."""

_MARGIN = 0.05  # of the box's size, added on every side
_GUESS_MARGIN = 0.5
_MOST_EXTENSIONS = 100  # instants at which q* is computed without a run


@dataclass(frozen=True)
class Region:
    """Where a run takes place.

    Attributes:
        time: instants at which targets are known, shape (T,), s.
        positions: of all vehicles at these instants, shape (T, V, 3), m; agents stay at their initial positions where
            there was no run.
        q_star: harmonic extension at these instants, stacked, shape (T, n_q), m.
        low, high: corners of the agents' box, shape (3,), m.
        source: how it was got.
        verified: whether it holds a run, and is not only a guess.
    """

    time: Array
    positions: Array
    q_star: Array
    low: Array
    high: Array
    source: str
    verified: bool


def region_of_run(system: System, time: Array, positions: Array, source: str) -> Region:
    """The region of a run that has been made: positions (T, V, 3) at times (T,)."""
    q_star = _extension(system, positions)
    return Region(time, positions, q_star, *_box(system, positions, q_star, _MARGIN), source, True)


def region_of_system(system: System) -> Region:
    """The region of a system's ideal run, or a guess where the run would take too long."""
    N, V = len(system.team.agents), len(system.team.members)
    if V * system.grid.steps <= MOST_VEHICLE_STEPS and system.team.dirichlet.unique:
        run = run_ideal(system)
        if run.status == "finished":
            return region_of_run(system, run.time, run.positions, "ideal run of this scenario")
        why = "the ideal run blows up"
    else:
        why = "no run was made" if system.team.dirichlet.unique else "the harmonic extension is not unique"
    time, positions = _targets_alone(system)
    positions[:, :N] = system.initial[:N]
    q_star = _extension(system, positions)
    low, high = _box(system, positions, q_star, _GUESS_MARGIN)
    return Region(time, positions, q_star, low, high, f"initial positions and q*, widened ({why})", False)


def _extension(system: System, positions: Array) -> Array:
    n_q = system.team.dirichlet.H.shape[0]
    return system.team.dirichlet.extend(system.team.pack(positions)[:, n_q:])


def _box(system: System, positions: Array, q_star: Array, margin: float) -> tuple[Array, Array]:
    points = np.concatenate([positions[:, : len(system.team.agents)], system.team.unpack(q_star)]).reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    widen = margin * np.maximum(high - low, 1.0)
    widen[2] *= any(agent.dimension == 3 for agent in system.team.agents)
    return low - widen, high + widen


def _targets_alone(system: System) -> tuple[Array, Array]:
    """Trajectories of the targets, integrated roughly without the agents, at few instants: (T,) and (T, V, 3)."""
    N, V = len(system.team.agents), len(system.team.members)
    samples = system.grid.samples
    time = samples[np.unique(np.linspace(0, len(samples) - 1, _MOST_EXTENSIONS).astype(int))]

    def slope(t: float, p: Array) -> Array:
        x = np.array(system.initial)
        x[N:] = p.reshape(-1, 3)
        instant = np.array([t])
        omega = evaluate(system.harmonics, instant)[0, N:]
        return (target_drift(system, instant, x[None])[0] + omega).ravel()

    solution = solve_ivp(slope, (time[0], time[-1]), system.initial[N:].ravel(), t_eval=time, rtol=1e-6, atol=1e-6)
    positions = np.repeat(system.initial[None], len(time), axis=0)
    if solution.success:
        positions[:, N:] = solution.y.T.reshape(len(time), V - N, 3)
    return time, positions
