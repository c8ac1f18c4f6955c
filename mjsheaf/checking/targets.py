"""The targets' trajectories by themselves, sampled finely enough that nothing along them is missed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from mjsheaf.backends.system import System
from mjsheaf.checking.drift import target_drift
from mjsheaf.dynamics.disturbance import evaluate
from mjsheaf.dynamics.flow import FlowField

Array = NDArray[np.float64]

_MOST_NUMBERS = 4_000_000  # of all harmonic extensions together
_FEWEST_SAMPLES = 400
_SAMPLES_PER_TURN = 64  # of the fastest motion or disturbance
_SHARE_OF_KERNEL = 0.5  # of the smallest kernel's size: how far a point may move between samples
_TOLERANCE = 1e-9
_MOST_EVALUATIONS = 400_000


@dataclass(frozen=True)
class TargetPath:
    """Targets of a system over the span of its run, under the continuous law of their own.

    Attributes:
        time: shape (T,), s.
        positions: padded over all vehicles, agents at their initial positions, shape (T, V, 3), m.
        q_star: harmonic extension, stacked, shape (T, n_q), m.
        complaint: empty, or what is wrong with it.
    """

    time: Array
    positions: Array
    q_star: Array
    complaint: str


class _TooLongError(Exception):
    pass


def follow_targets(system: System) -> TargetPath:
    """Integrate the targets alone (Dormand and Prince's 8(5,3) pair, 1e-9) and sample them.

    Samples are so close that neither a target nor any q*_i moves by more than half the size of the smallest kernel,
    and that the fastest motion has 64 of them in a turn; a complaint says where that would be too many.
    """
    start, end = float(system.grid.samples[0]), float(system.grid.samples[-1])
    fastest = _fastest_rate(system)
    path, complaint = _integrate(system, start, end, fastest)
    n_q = system.team.dirichlet.H.shape[0]
    most = max(_MOST_NUMBERS // max(n_q, 3 * len(system.team.members)), 50)
    count = int(min(max(_FEWEST_SAMPLES, (end - start) * fastest / (2 * np.pi) * _SAMPLES_PER_TURN), most))
    size = min(_kernel_size(flow) for flow in system.flows)
    while True:
        time = np.linspace(start, end, count + 1)
        positions = np.repeat(system.initial[None], len(time), axis=0)
        positions[:, len(system.team.agents) :] = path(time)
        q_star = system.team.dirichlet.extend(system.team.pack(positions)[:, n_q:])
        moves = [np.diff(positions[:, len(system.team.agents) :], axis=0), np.diff(system.team.unpack(q_star), axis=0)]
        farthest = max(float(np.linalg.norm(m, axis=2).max(initial=0.0)) for m in moves)
        if farthest <= _SHARE_OF_KERNEL * size:
            return TargetPath(time, positions, q_star, complaint)
        wanted = int(count * 1.1 * farthest / (_SHARE_OF_KERNEL * size)) + 1
        if count >= most:
            note = "; targets are sampled too coarsely for the smallest kernel of the flow"
            return TargetPath(time, positions, q_star, complaint + note)
        count = min(max(wanted, count + 1), most)


def _integrate(system: System, start: float, end: float, fastest: float) -> tuple[Callable[[Array], Array], str]:
    N, V = len(system.team.agents), len(system.team.members)
    evaluations = 0

    def slope(t: float, p: Array) -> Array:
        nonlocal evaluations
        evaluations += 1
        if evaluations > _MOST_EVALUATIONS:
            raise _TooLongError
        x = np.array(system.initial)
        x[N:] = p.reshape(-1, 3)
        instant = np.array([t])
        return (target_drift(system, instant, x[None])[0] + evaluate(system.harmonics, instant)[0, N:]).ravel()

    initial = system.initial[N:].ravel()
    try:
        solution = solve_ivp(
            slope,
            (start, end),
            initial,
            method="DOP853",
            dense_output=True,
            rtol=_TOLERANCE,
            atol=_TOLERANCE,
            max_step=(end - start) if fastest == 0.0 else min(end - start, 1.0 / fastest),
        )
    except (_TooLongError, ValueError):  # a singular field: the solution cannot be followed
        solution = None
    if solution is None or not solution.success:
        return lambda t: np.tile(initial, (len(t), 1)).reshape(-1, V - N, 3), "; the targets' path cannot be followed"
    return lambda t: solution.sol(t).T.reshape(-1, V - N, 3), ""


def _fastest_rate(system: System) -> float:
    """Largest angular frequency of motions and disturbances, rad/s; of waypoint paths, one turn in each piece."""
    rates = [float(np.abs(system.motion.rate).max(initial=0.0))]
    rates.append(float(np.abs(system.harmonics[..., 3]).max(initial=0.0)))
    pieces = np.diff(system.motion.knots)
    if (pieces > 0.0).any():
        rates.append(2.0 * np.pi / float(pieces[pieces > 0.0].min()))
    return max(rates)


def _kernel_size(field: FlowField) -> float:
    """Core radius or smallest channel width, m; infinite for a uniform field, and 1 mm where a core is 0."""
    sizes = [float(min(channel[-2:])) for channel in field.channels]
    if len(field.sources) or len(field.vortices):
        sizes.append(max(float(field.core or 0.0), 1e-3))
    return min(sizes, default=np.inf)
