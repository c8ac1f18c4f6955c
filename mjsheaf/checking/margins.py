"""What theory leaves out and practice needs: sampling, inertia, speed limits, lag."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from mjsheaf.backends.system import System
from mjsheaf.checking.constants import Constants
from mjsheaf.checking.spectrum import Spectrum

Array = NDArray[np.float64]

_NULL = 1e-12  # of the largest eigenvalue: such a mode counts as free

LARGEST_SECOND_ORDER = 600
"""Largest n_q for which eigenvalues of the second-order system of unlike bodies are computed."""


@dataclass(frozen=True)
class HoldMargin:
    """A law held over a period h, on ideal kinematics: q grows by (1 - k1 h lambda) in each mode.

    Attributes:
        period: h, s.
        product: k1 h lambda_max; below 2 the sampled law converges, up to 1 it does not ring.
        largest_gain: 2 / (h lambda_max), 1/s.
        ringing_gain: 1 / (h lambda_max): beyond it the fastest mode changes sign at each sample, 1/s.
    """

    period: float
    product: float
    largest_gain: float
    ringing_gain: float


@dataclass(frozen=True)
class BodyMargin:
    """Inertia: tau q'' + q' = u with tau = m / D.

    Attributes:
        tau: smallest and largest time constant of the agents, s.
        damping_slowest, damping_fastest: damping ratio 1 / (2 sqrt(k1 lambda tau)) at lambda_min and lambda_max; for
            unlike bodies the least damping ratio among the second-order system's eigenvalues, twice.
        spectral_radius: of the sampled plant under the held law; below 1 it is stable. None where the law is
            continuous or the team is too large.
    """

    tau: tuple[float, float]
    damping_slowest: float
    damping_fastest: float
    spectral_radius: float | None


@dataclass(frozen=True)
class SpeedDemand:
    """What the law asks of an agent at the start: k1 |eta_i|, against its limit (None: no limit), m/s."""

    agent: str
    asked: float
    limit: float | None


def hold_margin(system: System, spectrum: Spectrum) -> HoldMargin | None:
    """The margin of the held law, or None where the law is continuous."""
    if system.grid.continuous:
        return None
    h = system.grid.period
    return HoldMargin(
        period=h,
        product=system.gain * h * spectrum.lambda_max,
        largest_gain=2.0 / (h * spectrum.lambda_max),
        ringing_gain=1.0 / (h * spectrum.lambda_max),
    )


def body_margin(system: System, spectrum: Spectrum, tau: Array) -> BodyMargin:
    """The margins of inertia.

    Args:
        system: the system.
        spectrum: of H.
        tau: time constant m / D of each agent, shape (N,), s.
    """
    k, h = system.gain, None if system.grid.continuous else system.grid.period
    low, high = float(tau.min()), float(tau.max())
    n = system.team.dirichlet.H.shape[0]
    if high - low <= 1e-9 * high:
        ratio = [
            1.0 / (2.0 * np.sqrt(k * eigenvalue * low)) if eigenvalue > 0.0 else np.inf
            for eigenvalue in (spectrum.lambda_min, spectrum.lambda_max)
        ]
        radius = None
        if h is not None:
            # The spectral radius is not monotone in lambda: look along the whole interval of the spectrum.
            modes = np.linspace(spectrum.lambda_min, spectrum.lambda_max, 200)
            if n <= LARGEST_SECOND_ORDER:
                modes = linalg.eigvalsh(system.team.dirichlet.H.toarray())
            modes = modes[modes > _NULL * spectrum.lambda_max]  # what is free neither decays nor grows
            radius = max((_radius(_sampled(np.array([[m]]), np.array([low]), k, h)) for m in modes), default=None)
        return BodyMargin((low, high), ratio[0], ratio[1], radius)
    if n > LARGEST_SECOND_ORDER:
        bounds = [1.0 / (2.0 * np.sqrt(k * spectrum.lambda_max * t)) for t in (high, low)]
        return BodyMargin((low, high), min(bounds), min(bounds), None)
    each = np.concatenate([np.full(a.dimension, t) for a, t in zip(system.team.agents, tau, strict=True)])
    H = system.team.dirichlet.H.toarray()
    inertia = np.diag(1.0 / each)
    roots = linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-k * inertia @ H, -inertia]]))
    moving = roots[np.abs(roots) > 1e-9]
    least = float(np.min(-moving.real / np.abs(moving)))
    radius = None if h is None else _radius(_sampled(H, each, k, h))
    return BodyMargin((low, high), least, least, radius)


def _sampled(H: Array, tau: Array, k: float, h: float) -> Array:
    """One period of tau v' = u - v, q' = v with u = -k H q held, exactly: the matrix on (q, v)."""
    decay = np.exp(-h / tau)
    reach = tau * (1.0 - decay)
    n = len(tau)
    return np.block(
        [
            [np.eye(n) - k * (h - reach)[:, None] * H, np.diag(reach)],
            [-k * (1.0 - decay)[:, None] * H, np.diag(decay)],
        ]
    )


def _radius(matrix: Array) -> float:
    return float(np.abs(linalg.eigvals(matrix)).max())


def speed_demands(system: System) -> list[SpeedDemand]:
    """The speed that the initial error asks of each agent, the largest share of its limit first."""
    team = system.team
    n_q = team.dirichlet.H.shape[0]
    x = team.pack(system.initial)
    eta = team.dirichlet.H @ x[:n_q] - team.dirichlet.B @ x[n_q:] - team.dirichlet.c
    asked = system.gain * np.linalg.norm(team.unpack(eta), axis=1)
    limits = system.law.limit
    order = np.argsort(-asked / np.where(np.isfinite(limits[: len(asked)]), limits[: len(asked)], 1e300), kind="stable")
    return [
        SpeedDemand(team.agents[i].id, float(asked[i]), float(limits[i]) if np.isfinite(limits[i]) else None)
        for i in order
    ]


def steady_lag(system: System, constants: Constants) -> Array:
    """Largest quasi-static lag |(H^-1 f_B)_i| / k1 of each agent along the run, shape (N,), m.

    It is what remains of e once e' is small: k1 H e = f_B.
    """
    problem = system.team.dirichlet
    thin = constants.f_B[:: max(1, len(constants.f_B) // 2000)]
    lag = problem.solve(thin) / system.gain
    return np.linalg.norm(system.team.unpack(lag), axis=2).max(axis=0)
