"""Eigenvalues of an H that is not symmetric, as some edges are directed, or bearings do not fit together.

The law is that of the undirected team in each eigenvector of H, with its complex eigenvalue (see `linear_law`). For the
paper's law the limits of gain and delay are known from the eigenvalues alone.
"""

import numpy as np
from numpy.typing import NDArray

from mjsheaf.arrays import Array
from mjsheaf.errors import UndecidedError
from mjsheaf.sheaf.nonlinear import FREE_MOTION
from mjsheaf.team import Team

MAX_STATES = 600
"""Largest number of rows of H whose eigenvalues are found."""

_ZERO = 1e-9  # of the largest: an eigenvalue of H that is no more is zero

Complex = NDArray[np.complex128]


def matrix_of(team: Team) -> Array:
    """Return H of a team of linear edges, shape (n, n).

    Raises:
        UndecidedError: It is too large.
    """
    n_q = int(team.remaining.first_state[-1])
    if n_q > MAX_STATES:
        raise UndecidedError(f"H has {n_q} rows; all its eigenvalues are found up to {MAX_STATES}")
    return team.law_problem.H.toarray()


def eigenvalues_of(team: Team) -> Complex:
    """Return the eigenvalues of H of a team of linear edges, by real part, shape (n,).

    Raises:
        UndecidedError: H is too large.
    """
    values = np.linalg.eigvals(matrix_of(team)).astype(np.complex128)
    return values[np.argsort(values.real, kind="stable")]


def zero_of(team: Team) -> float:
    """Return the size of an eigenvalue of H, relative to the largest, up to which it counts as zero."""
    return _ZERO if team.linearised_at is None else FREE_MOTION


def held_eigenvalues(team: Team) -> Complex:
    """Return the eigenvalues of H that decide its loop: without zeros where a team without targets is free to move.

    Raises:
        UndecidedError: H is too large.
    """
    values = eigenvalues_of(team)
    zero = np.abs(values) <= zero_of(team) * float(np.abs(values).max(initial=0.0))
    return values[~zero] if team.free else np.where(zero, 0.0, values)


def largest_gain(values: Complex | Array, period: float, delay: int = 0) -> float | None:
    """Return the gain from which on the paper's held law is unstable, 1/s; None if it is at any gain.

    With k1 h |lambda| = 2 sin(theta / 2), see `largest_delay`, that is min 2 sin(theta / 2) / (h |lambda|), which is
    2 min Re(lambda) / (h |lambda|^2) without delay.

    Args:
        values: Eigenvalues of H, shape (L,).
        period: h, s.
        delay: Delay of all measurements, m periods.
    """
    if not len(values) or not (values.real > 0.0).all():
        return None
    half = (0.5 * np.pi - np.abs(np.angle(values))) / (2 * delay + 1)
    return float((2.0 * np.sin(half) / np.abs(values)).min() / period)


def largest_delay(values: Complex, product: float) -> int:
    """Return the largest delay, in periods, up to which the paper's held law is stable; it is stable without.

    A root z = exp(i theta) of z^m (z - 1) + k1 h lambda has 2 sin(theta / 2) = k1 h |lambda| and
    theta (m + 1/2) = pi / 2 - |arg lambda|. The first such m of all eigenvalues is the limit.

    Args:
        values: Eigenvalues of H, real parts above zero, shape (L,).
        product: k1 h.
    """
    theta = 2.0 * np.arcsin(np.minimum(0.5 * product * np.abs(values), 1.0))
    limit = float(((0.5 * np.pi - np.abs(np.angle(values))) / theta).min()) - 0.5
    return int(np.ceil(limit - _ZERO)) - 1


def continuous_delay_margin(values: Complex, gain: float) -> float | None:
    """Return the delay of all measurements up to which x' = -k1 H x is stable, s; None if it is not without.

    A root i w of s + k1 lambda exp(-s T) has w = k1 |lambda| and w T = pi / 2 - |arg lambda|.
    """
    stable = len(values) and (values.real > 0.0).all()
    return float(((0.5 * np.pi - np.abs(np.angle(values))) / (gain * np.abs(values))).min()) if stable else None
