"""What theory leaves out and practice needs: sampling, inertia, speed limits, lag."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from mjsheaf.checking.cohomology import Spectrum
from mjsheaf.checking.drift import Difference
from mjsheaf.control import disagreement
from mjsheaf.system import System

Array = NDArray[np.float64]

_AT_REST = 1e-6  # share of z, against tau v, under which z is at rest

_MOST_NUMBERS = 1_000_000  # of lags that are solved for

LARGEST_SECOND_ORDER = 600
"""Largest n_q for which eigenvalues of the second-order system of unlike bodies are computed."""


@dataclass(frozen=True)
class HoldMargin:
    """A law held over a period h, on ideal kinematics: q grows by (1 - k1 h lambda) in each mode.

    Attributes:
        period: h, s.
        product: k1 h lambda_max; below 2 the sampled law converges, up to 1 it does not ring.
        largest_gain: 2 / (h lambda_max), 1/s; None where lambda_max is 0, and any gain will do.
        ringing_gain: 1 / (h lambda_max): beyond it the fastest mode changes sign at each sample, 1/s; None likewise.
    """

    period: float
    product: float
    largest_gain: float | None
    ringing_gain: float | None


@dataclass(frozen=True)
class BodyMargin:
    """Inertia alone: tau q'' + q' = u with tau = m / D. What is free does not enter, and `bodies` has all the rest.

    Attributes:
        tau: smallest and largest time constant of the agents, s.
        damping_slowest, damping_fastest: damping ratio 1 / (2 sqrt(k1 lambda tau)) at the smallest lambda above zero
            and the largest; infinite where there is none. For unlike bodies -Re s / |s| of the smallest and of the
            largest root s, by |s|, of the second-order system: 1 where that root is real. For unlike bodies of over
            LARGEST_SECOND_ORDER states, a lower bound of the damping ratio of all modes, twice.
    """

    tau: tuple[float, float]
    damping_slowest: float
    damping_fastest: float


@dataclass(frozen=True)
class SpeedDemand:
    """How fast an agent must be, and can be, m/s.

    Attributes:
        agent: its id.
        asked: what the law asks of it at the start, k1 |eta_i|.
        limit: that the law keeps; None without one.
        steady: largest |q*'_i - f_i(q*)| along the run: what following the harmonic extension takes; None where a
            field is singular.
        able: what its body can make through the medium in every direction; None where its thrusters have no limits.
    """

    agent: str
    asked: float
    limit: float | None
    steady: float | None
    able: float | None


def hold_margin(system: System, spectrum: Spectrum) -> HoldMargin | None:
    """The margin of the held law, or None where the law is continuous."""
    if system.grid.continuous:
        return None
    h = system.grid.period
    ringing = 1.0 / (h * spectrum.lambda_max) if spectrum.lambda_max > 0.0 else None
    return HoldMargin(
        period=h,
        product=system.gain * h * spectrum.lambda_max,
        largest_gain=None if ringing is None else 2.0 * ringing,
        ringing_gain=ringing,
    )


def body_margin(system: System, spectrum: Spectrum, tau: Array) -> BodyMargin:
    """The damping that inertia alone leaves.

    Args:
        system: the system.
        spectrum: of H.
        tau: time constant m / D of each agent, shape (N,), s.
    """
    k = system.gain
    low, high = float(tau.min()), float(tau.max())
    n = system.team.dirichlet.H.shape[0]
    if not spectrum.smallest.size:  # nothing is held, so nothing swings
        return BodyMargin((low, high), np.inf, np.inf)
    slowest = float(spectrum.smallest[0])
    if high - low <= 1e-9 * high:
        ratio = [float(1.0 / (2.0 * np.sqrt(k * eigenvalue * low))) for eigenvalue in (slowest, spectrum.lambda_max)]
        return BodyMargin((low, high), ratio[0], ratio[1])
    if n > LARGEST_SECOND_ORDER:
        bound = float(1.0 / (2.0 * np.sqrt(k * spectrum.lambda_max * high)))
        return BodyMargin((low, high), bound, bound)
    each = np.concatenate([np.full(a.dimension, t) for a, t in zip(system.team.agents, tau, strict=True)])
    modes, Q = _held_modes(system, spectrum)
    swing = np.block([[np.zeros((len(modes),) * 2), Q.T], [-k / each[:, None] * Q * modes, -np.diag(1.0 / each)]])
    roots = _moving(swing, len(modes), low)
    ratios = (-roots.real / np.abs(roots))[np.argsort(np.abs(roots))]
    return BodyMargin((low, high), float(ratios[0]), float(ratios[-1]))


def _held_modes(system: System, spectrum: Spectrum) -> tuple[Array, Array]:
    """Eigenvalues of H above zero, ascending, and their vectors, shape (n, m); what is free is left out."""
    values, vectors = linalg.eigh(system.team.dirichlet.H.toarray())
    return np.maximum(values[spectrum.nullity :], spectrum.smallest[0]), vectors[:, spectrum.nullity :]


def _moving(matrix: Array, m: int, tau: float) -> NDArray[np.complex128]:
    """Eigenvalues of a matrix on (z, v), z of length m; not those that leave z at rest, coasting along what is free.

    Args:
        matrix: square.
        m: number of modes that are held.
        tau: a time that makes v comparable to z.
    """
    values, vectors = linalg.eig(matrix)
    z, v = np.linalg.norm(vectors[:m], axis=0), np.linalg.norm(vectors[m:], axis=0)
    return values[z > _AT_REST * tau * v]


def speed_demands(system: System, difference: Difference, able: Array) -> list[SpeedDemand]:
    """The speeds that are asked of each agent, at the start or along q*, the largest share of its limit first.

    Args:
        system: the system.
        difference: f_B along the targets' path.
        able: speed that each agent's body can make, shape (N,), m/s; infinite where it has no limits.
    """
    team = system.team
    # q*' - f_q = f_B + H^-1 B omega, at the instants that the path keeps.
    steady = np.linalg.norm(team.unpack(difference.values + difference.shaken), axis=2).max(axis=0)
    asked = system.gain * np.linalg.norm(disagreement(system.law, system.initial)[: len(team.agents)], axis=1)
    limits = system.law.limit[: len(asked)]
    most = np.fmax(asked, steady)  # a singular field leaves no steady speed
    order = np.argsort(-most / np.where(np.isfinite(limits), limits, 1e300), kind="stable")
    return [
        SpeedDemand(team.agents[i].id, *(_finite(x[i]) for x in (asked, limits, steady, able)))  # type: ignore[arg-type]
        for i in order
    ]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def steady_lag(system: System, difference: Difference) -> Array:
    """Largest quasi-static lag |(H^-1 f_B)_i| / k1 of each agent along the run, shape (N,), m.

    It is what remains of e once e' is small: k1 H e = f_B.
    """
    problem = system.team.dirichlet
    if not np.isfinite(difference.values).all():
        return np.full(len(system.team.agents), np.nan)
    few = max(20, _MOST_NUMBERS // difference.values.shape[1])  # an estimate: some of the instants do where H is large
    lag = problem.solve(difference.values[:: -(-len(difference.values) // few)]) / system.gain
    return np.linalg.norm(system.team.unpack(lag), axis=2).max(axis=0)
