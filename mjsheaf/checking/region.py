"""The region over which the theorem's constants are taken.

Targets do not react to agents, so where they go is known before a run: constants that depend on targets are taken along
their trajectories. Agents may be anywhere in a box that holds their trajectories and their harmonic extension.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.ideal import run_ideal
from mjsheaf.backends.system import System
from mjsheaf.checking.drift import agent_drift
from mjsheaf.checking.targets import TargetPath, follow_targets
from mjsheaf.dynamics.disturbance import bounds

Array = NDArray[np.float64]

MOST_VEHICLE_STEPS = 3_000_000
"""Beyond this product of vehicles and samples no run is made, and the box is guessed from the initial condition."""

_MARGIN = 0.05  # of the box's size, added on every side
_GUESS_MARGIN = 0.5


@dataclass(frozen=True)
class Region:
    """Where a run takes place.

    Attributes:
        path: the targets' trajectories and the harmonic extension along them.
        low, high: corners of the agents' box, shape (3,), m.
        source: how it was got.
        verified: whether the box holds a run and the targets' path was found, or both are only a guess.
    """

    path: TargetPath
    low: Array
    high: Array
    source: str
    verified: bool


def region_of_run(system: System, positions: Iterable[Array], source: str) -> Region:
    """The region of a run that has been made: positions at the system's samples, in pieces of shape (T, V, 3)."""
    path = follow_targets(system)
    corners, fastest = [], 0.0
    for piece in positions:
        corners += [piece.min(axis=0), piece.max(axis=0)]
        corners = [np.minimum.reduce(corners), np.maximum.reduce(corners)]
        fastest = max(fastest, _largest_speed(system, piece))
    low, high = _box(system, np.array(corners), path.q_star, _MARGIN)
    between = 0.5 * system.grid.period * fastest
    spatial = np.array([1.0, 1.0, float(any(agent.dimension == 3 for agent in system.team.agents))])
    return Region(path, low - between * spatial, high + between * spatial, source + path.complaint, not path.complaint)


def region_of_system(system: System) -> Region:
    """The region of a system's ideal run, or a guess where there is none."""
    if not system.team.dirichlet.unique:
        why = "the harmonic extension is not unique"
    elif len(system.team.members) * system.grid.steps > MOST_VEHICLE_STEPS:
        why = "too large for a run"
    else:
        run = run_ideal(system)
        if run.status == "finished":
            return region_of_run(system, [run.positions], "ideal run of this scenario")
        why = "the ideal run blows up"
    path = follow_targets(system)
    low, high = _box(system, system.initial[None], path.q_star, _GUESS_MARGIN)
    return Region(path, low, high, f"a guess from initial positions and q*: {why}{path.complaint}", False)


def _box(system: System, positions: Array, q_star: Array, margin: float) -> tuple[Array, Array]:
    both = (positions[:, : len(system.team.agents)], system.team.unpack(q_star))
    low = np.min([x.min(axis=(0, 1)) for x in both], axis=0)
    high = np.max([x.max(axis=(0, 1)) for x in both], axis=0)
    widen = margin * np.maximum(high - low, 1.0)
    widen[2] *= any(agent.dimension == 3 for agent in system.team.agents)
    return low - widen, high + widen


def _largest_speed(system: System, positions: Array) -> float:
    """Largest k1 |eta_i| + |f_i| + omega_bar over agents and samples: how fast an agent moves between samples, m/s."""
    team = system.team
    x = team.pack(positions)
    eta = team.disagreement(x)
    speed = system.gain * np.linalg.norm(team.unpack(eta), axis=2)
    speed += np.linalg.norm(team.unpack(agent_drift(system, x[:, : eta.shape[1]])), axis=2)
    return float(np.nan_to_num(speed, posinf=0.0).max() + bounds(system.harmonics).max(initial=0.0))
