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
from mjsheaf.dynamics.disturbance import bounds
from mjsheaf.dynamics.effectiveness import without_full_row_rank

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Constants:
    """Constants over a region.

    Attributes:
        f_bar: supremum of |f_B| along the targets' trajectories, m/s; infinite where it meets a singular kernel.
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
    path = region.path
    padded = np.zeros((len(path.time), len(team.members), 3))
    padded[:, N:] = target_drift(system, path.time, path.positions)
    f_p = team.pack(padded)[:, n_q:]
    own = agent_drift(system, path.q_star)
    if not np.isfinite(f_p).all():  # a target sits on a singular kernel
        return np.full_like(own, np.nan), own, np.full_like(own, np.nan)
    carried = team.dirichlet.extend(f_p) - team.dirichlet.extend(np.zeros(f_p.shape[1]))
    return carried, own, carried - own


def take_constants(system: System, region: Region, spectrum: Spectrum) -> Constants:
    """Take the constants of a system over a region."""
    team = system.team
    _, _, f_B = difference(system, region)
    norm = np.nan_to_num(np.linalg.norm(f_B, axis=1), nan=np.inf)
    # Between two samples |f_B| exceeds both by at most half the length of its path there. Samples resolve every kernel
    # and motion (see targets), so that the path is not twice as long as the chord.
    chord = np.linalg.norm(np.diff(f_B, axis=0), axis=1).max(initial=0.0) if np.isfinite(norm).all() else 0.0
    met = system.fields_met(0, len(team.agents))
    lipschitz = [lipschitz_constant(flow, region.low, region.high, planar=planar) for flow, planar in met]
    speed = [largest_speed(flow, region.low, region.high, planar=planar, drift=False) for flow, planar in met]
    largest = bounds(system.harmonics).max(initial=0.0)
    n_q = team.dirichlet.H.shape[0]
    error = region.path.q_star[0] - team.pack(system.initial)[:n_q]
    return Constants(
        f_bar=float(norm.max() + chord),
        f_bar_time=float(region.path.time[np.argmax(norm)]),
        f_B=f_B,
        lipschitz=max(lipschitz, key=lambda s: s.upper),
        speed=max(speed, key=lambda s: s.upper),
        largest_disturbance=float(largest),
        omega_bar=disturbance_bound(
            spectrum.sigma_max_B, spectrum.lambda_min, len(team.agents), len(team.targets), float(largest)
        ),
        initial_error=float(np.linalg.norm(error)),
    )


@dataclass(frozen=True)
class Certificate:
    """Theorem 1 for a system over a region, with what else it takes.

    Attributes:
        theorem: the theorem with these constants; its own `applies` is the gain condition alone.
        weaker: the bound that holds whatever the slopes: rho = 0, and f_bar enlarged by 2 sqrt(sum_i sup |f_i|^2).
        applies: whether the gain condition holds and nothing else stands against the bound.
        approximate: the law is held over a period, or the region is a guess.
        reason: why it does not apply, or empty.
        obstacle: what stands against any bound of continuous time, gain condition or not; or empty.
    """

    theorem: Theorem
    weaker: Theorem
    applies: bool
    approximate: bool
    reason: str
    obstacle: str


def certify(
    system: System, region: Region, constants: Constants, spectrum: Spectrum, rate: float | None = None
) -> Certificate:
    """Decide what Theorem 1 says of a system over a region; `rate` is lambda_V, the best one unless given."""
    c = constants
    theorem = theorem_1(system.gain, spectrum.lambda_min, c.f_bar, c.omega_bar, c.lipschitz.upper, rate)
    # f~ = f_q(q*) - f_q(q) with both in the box; the speed is without the drift, which cancels.
    enlarged = c.f_bar + 2.0 * np.sqrt(len(system.team.agents)) * c.speed.upper
    weaker = theorem_1(system.gain, spectrum.lambda_min, enlarged, c.omega_bar, 0.0)
    obstacle = _obstacle(system, constants, spectrum, theorem if theorem.applies else weaker)
    reason = _gain_condition(constants, spectrum, theorem, rate) or obstacle
    return Certificate(
        theorem=theorem,
        weaker=weaker,
        applies=not reason,
        approximate=not system.grid.continuous or not region.verified,
        reason=reason,
        obstacle=obstacle,
    )


def _gain_condition(constants: Constants, spectrum: Spectrum, theorem: Theorem, rate: float | None) -> str:
    """Why the gain condition fails, or an empty string where it holds."""
    if theorem.applies:
        return ""
    if spectrum.lambda_min <= 0.0:
        return "lambda_min(H) is 0: the harmonic extension is not unique"
    rho = constants.lipschitz.upper
    if not np.isfinite(rho) or not np.isfinite(constants.f_bar):
        return "a field is singular inside the region"
    if rate is not None and theorem.k_min > rho:
        return f"lambda_V = {rate:.4g} 1/s is too fast: it must be below k_min - rho = {theorem.k_min - rho:.4g} 1/s"
    return (
        f"k_min = {theorem.k_min:.4g} 1/s does not exceed rho = {rho:.4g} 1/s; "
        f"that takes a gain above {2.0 * rho / spectrum.lambda_min:.4g} 1/s"
    )


def _obstacle(system: System, constants: Constants, spectrum: Spectrum, bound: Theorem) -> str:
    """What stands against a bound of the continuous, unlimited law: a g without full rank, a hold, a speed limit."""
    agents = system.team.agents
    for i in without_full_row_rank(system.effectiveness, [agent.dimension for agent in agents]):
        return f"g of {agents[i].id} is not of full row rank: g g^+ is not the identity"
    if not system.grid.continuous:
        product = system.gain * system.grid.period * spectrum.lambda_max
        if product >= 1.0:
            what = "diverges" if product >= 2.0 else "rings"
            return f"the held law {what} (k1 h lambda_max = {product:.3g}): a bound of continuous time says nothing"
    limit = float(system.law.limit[: len(system.team.agents)].min())
    asked = system.gain * spectrum.lambda_max * max(constants.initial_error, bound.radius)
    if np.isfinite(limit) and asked > limit:
        return f"the law may ask for {asked:.3g} m/s, beyond a speed limit of {limit:.3g} m/s"
    return ""
