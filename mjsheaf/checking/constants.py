"""The constants that Theorem 1 needs, taken over a region."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.system import System
from mjsheaf.checking.drift import agent_drift, target_drift
from mjsheaf.checking.region import Region
from mjsheaf.checking.spectrum import Spectrum
from mjsheaf.control.theorem import Theorem, disturbance_bound, theorem_1
from mjsheaf.dynamics.bounds import Supremum, largest_speed, lipschitz_constant

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Constants:
    """Constants over a region.

    Attributes:
        f_bar: supremum of |f_B| along the targets' trajectories, m/s.
        f_bar_time: when it is attained, s.
        f_B: the difference itself, stacked, shape (T, n_q), m/s.
        lipschitz: rho: supremum of the Jacobian's norm of the agents' field over their box, 1/s, and where.
        speed: supremum of the speed of the agents' field without its uniform drift over their box, m/s: a uniform drift
            cancels in f~.
        largest_disturbance: largest omega_bar_i, m/s.
        omega_bar: bound on |Delta|, m/s.
        initial_error: |e(t0)|, m.
    """

    f_bar: float
    f_bar_time: float
    f_B: Array
    lipschitz: Supremum
    speed: Supremum
    largest_disturbance: float
    omega_bar: float
    initial_error: float


def difference(system: System, region: Region) -> tuple[Array, Array, Array]:
    """The bounded-difference assumption along a run.

    Returns:
        H^-1 B f_p, f_q(q*) and f_B, their difference, stacked over agents, each of shape (T, n_q), m/s.
    """
    team = system.team
    n_q = team.dirichlet.H.shape[0]
    N = len(team.agents)
    padded = np.zeros((len(region.time), len(team.members), 3))
    padded[:, N:] = target_drift(system, region.time, region.positions)
    f_p = team.pack(padded)[:, n_q:]
    carried = team.dirichlet.extend(f_p) - team.dirichlet.extend(np.zeros(f_p.shape[1]))
    own = agent_drift(system, region.q_star)
    return carried, own, carried - own


def take_constants(system: System, region: Region, spectrum: Spectrum) -> Constants:
    """Take the constants of a system over a region."""
    team = system.team
    _, _, f_B = difference(system, region)
    norm = np.linalg.norm(f_B, axis=1)
    # Between two samples |f_B| can exceed both by no more than half of how far f_B moves.
    between = np.linalg.norm(np.diff(f_B, axis=0), axis=1).max(initial=0.0)
    kinds = sorted({agent.dimension for agent in team.agents})
    lipschitz = [lipschitz_constant(system.agent_flow, region.low, region.high, planar=n == 2) for n in kinds]
    speed = [largest_speed(system.agent_flow, region.low, region.high, planar=n == 2, drift=False) for n in kinds]
    largest = disturbance_bounds(system).max(initial=0.0)
    n_q = team.dirichlet.H.shape[0]
    error = region.q_star[0] - team.pack(system.initial)[:n_q]
    return Constants(
        f_bar=float(norm.max() + 0.5 * between),
        f_bar_time=float(region.time[np.argmax(norm)]),
        f_B=f_B,
        lipschitz=max(lipschitz, key=lambda s: s.upper),
        speed=max(speed, key=lambda s: s.upper),
        largest_disturbance=float(largest),
        omega_bar=disturbance_bound(
            spectrum.sigma_max_B, spectrum.lambda_min, len(team.agents), len(team.targets), float(largest)
        ),
        initial_error=float(np.linalg.norm(error)),
    )


def disturbance_bounds(system: System) -> Array:
    """omega_bar_i of every vehicle: the sum of the amplitudes of its harmonics, shape (V,), m/s."""
    if system.harmonics.shape[1] == 0:
        return np.zeros(len(system.team.members))
    return np.linalg.norm(system.harmonics[..., :3], axis=2).sum(axis=1)


def certify(system: System, constants: Constants, spectrum: Spectrum, rate: float | None = None) -> Theorem:
    """Theorem 1 with these constants."""
    return theorem_1(
        system.gain, spectrum.lambda_min, constants.f_bar, constants.omega_bar, constants.lipschitz.upper, rate
    )


def weaken(system: System, constants: Constants, spectrum: Spectrum) -> Theorem:
    """The bound that holds whatever the slopes: rho = 0, and f_bar enlarged by what f~ can be at most.

    |f~| <= 2 sqrt(sum_i sup |f_i|^2), with the supremum over the agents' box.
    """
    largest = 2.0 * np.sqrt(len(system.team.agents)) * constants.speed.upper
    return theorem_1(system.gain, spectrum.lambda_min, constants.f_bar + largest, constants.omega_bar, 0.0)
