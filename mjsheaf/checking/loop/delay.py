"""Stability and delay margin of the law with delayed measurements, on ideal kinematics.

For the paper's law with one delay of d periods the condition is k1 h lambda < 2 sin(pi / (2 (2 d + 1))). With other
laws each number of periods is tried.

If the edges of the paper's law have different delays up to d, the condition at lambda_max suffices. A root
z = exp(i theta) of the team's loop, with vector x and w_e = k1 h x* H_e x >= 0, satisfies
sum w_e cos(theta (d_e + 1/2)) = 0 and sum w_e sin(theta (d_e + 1/2)) = 2 sin(theta / 2). The first equation requires
theta >= pi / (2 d + 1), so the second gives sum w_e >= 2 sin(pi / (2 (2 d + 1))). But sum w_e <= k1 h lambda_max. So no
root crosses the circle as the gain rises from a small value, for which the loop is stable.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.checking.loop.linked_law import LinkedLaw
from mjsheaf.checking.loop.sampled_loop import Loop
from mjsheaf.errors import UndecidedError
from mjsheaf.section import Finite, Record

MOST_STATES = 900  # of a matrix whose eigenvalues are found
MOST_WORK = 3e10  # modes times states cubed, of eigenvalues or of covariances
_MOST_SCANNED = 200  # periods of delay that are tried one by one
_ROUNDING = 1e-9  # of a spectral radius: closer to 1 nothing is decided


class DelayAnswer(Record):
    """The loop with measurements as old as they are, all of which arrive."""

    delay: Finite = Field(None, description="of the oldest measurements, s; null where not known")
    stable: bool | None = Field(None, description="null where undecided: see reason")
    spectral_radius: Finite = Field(None, description="of a period, with these delays; null where not computed")
    margin: Finite = Field(
        None,
        description="largest delay of all links alike, in whole periods, up to which the loop is stable, s; null where "
        "it is unstable without delay, or undecided",
    )
    largest_gain: Finite = Field(
        None,
        description="from which on the law is unstable with these delays if nothing is lost, 1/s; null where a term "
        "changes it, edges have unlike delays, or it is unstable at any gain",
    )
    reason: str = Field(description="why a number is missing, or empty")


def team_loop(law: LinkedLaw, delay: IntArray, most: int = MOST_STATES) -> tuple[Array, Array, Array]:
    """The loop of the whole team with a delay for each edge, in periods: x+ = (M + L C) x, m rows of C for m numbers.

    The states are e_k, e_{k-1}, ..., then what the law remembers in eigenvectors of H; C x is D_e e_{k-d} of each edge.
    Of a team that is free to move e is in eigenvectors of H too, without those of zero eigenvalues.

    Raises:
        UndecidedError: it has more than `most` states.
    """
    vectors, h = law.vectors, law.loop.period
    feedback, values = law.loop.feedback, law.loop.values
    n, r, d = vectors.shape[1], feedback.C.shape[1], int(delay.max(initial=0))
    if (size := n * (d + 1 + r)) > most:
        raise UndecidedError(f"with unlike delays, or losses, the loop has {size} states; up to {most} are looked at")
    m, begin = sum(len(edge.D) for edge in law.edges), 0
    free = n < len(vectors)
    C, pulled = np.zeros((m, size)), np.zeros((len(vectors), m))
    for edge, age in zip(law.edges, delay.tolist(), strict=True):
        rows = slice(begin, begin := begin + len(edge.D))
        if free:
            C[rows, n * age : n * (age + 1)] = edge.D @ vectors[edge.slots]
        else:
            C[rows, n * age + edge.slots] = edge.D
        pulled[edge.slots, rows] = edge.pull
    M, L = np.zeros((size, size)), np.zeros((size, m))
    M[n : n * (d + 1), : n * d] = np.eye(n * d)
    M[:n, :n] += np.eye(n)
    eta = vectors.T @ pulled  # in eigenvectors of H, where e has eta = lambda e
    if free:
        pulled = eta
        vectors = np.eye(n)
    L[:n] = -h * law.loop.gain * pulled if law.loop.is_papers else h * (vectors * (feedback.D[:, 0] / values)) @ eta
    kept = [slice(n * (d + 1 + i), n * (d + 2 + i)) for i in range(r)]
    for i, row in enumerate(kept):
        M[:n, row] = h * vectors * feedback.C[:, i]
        L[row] = (feedback.B[:, i, 0] / values)[:, None] * eta
        for k, column in enumerate(kept):
            M[row, column] = np.diag(feedback.A[:, i, k])
    return M, L, C


def spectral_radius(law: LinkedLaw, delay: IntArray) -> float:
    """Compute the spectral radius of the loop with a delay for each edge, in periods.

    Raises:
        UndecidedError: It has too many states.
    """
    d = int(delay.max(initial=0))
    if (delay == d).all():
        if len(law.vectors) * (d + 3.0) ** 3 > MOST_WORK / 25.0 or d + 3 > MOST_STATES:
            raise UndecidedError(f"with {d} periods of delay each of {len(law.vectors)} modes has too many states")
        return law.loop.radius_at(d)
    M, L, C = team_loop(law, delay)
    return float(np.abs(np.linalg.eigvals(M + L @ C)).max())


def is_stable(radius: float) -> bool | None:
    """Return True if a spectral radius is stable; None where it is too close to 1."""
    return None if abs(radius - 1.0) < _ROUNDING else radius < 1.0


def limit_from_eigenvalues(values: NDArray[Any], product: float) -> int:
    """Return the largest delay, in periods, up to which the paper's held law is stable; it is stable without.

    A root z = exp(i theta) of z^m (z - 1) + k1 h lambda has 2 sin(theta / 2) = k1 h |lambda| and
    theta (m + 1/2) = pi / 2 - |arg lambda|. The first such m of all eigenvalues is the limit.

    Args:
        values: Eigenvalues of H, real parts above zero, shape (L,).
        product: k1 h.
    """
    theta = 2.0 * np.arcsin(np.minimum(0.5 * product * np.abs(values), 1.0))
    limit = float(((0.5 * np.pi - np.abs(np.angle(values))) / theta).min()) - 0.5
    return int(np.ceil(limit - _ROUNDING)) - 1


def continuous_delay_margin(values: NDArray[Any], gain: float) -> float | None:
    """Return the delay of all measurements up to which x' = -k1 H x is stable, s; None if it is not without.

    A root i w of s + k1 lambda exp(-s T) has w = k1 |lambda| and w T = pi / 2 - |arg lambda|.
    """
    stable = len(values) and (values.real > 0.0).all()
    return float(((0.5 * np.pi - np.abs(np.angle(values))) / (gain * np.abs(values))).min()) if stable else None


def largest_delay(loop: Loop, linked: BoolArray, radius_of: Callable[[IntArray], float]) -> int | None:
    """Return the largest delay of all links, in periods, up to which a loop is stable; None if it is unstable without.

    Args:
        loop: Loop of the law.
        linked: True for each edge that has a link, shape (E,); the others measure at once.
        radius_of: Spectral radius with a delay for each edge, in periods.

    Raises:
        UndecidedError: It is not known.
    """
    if not is_stable(loop.radius):
        return None
    known = limit_from_eigenvalues(loop.values, loop.gain * loop.period) if loop.is_papers else 0
    if loop.is_papers and linked.all():
        return known
    work = 0.0
    n = len(loop.values)
    for d in range(known + 1, _MOST_SCANNED):
        work += n * (d + 3.0) ** 3 if linked.all() else (n * (d + 3.0)) ** 3
        if work > MOST_WORK:
            break
        if not is_stable(radius_of(d * linked)):
            return d - 1
        known = d
    raise UndecidedError(f"the loop is stable with any delay up to {known} periods; more are not looked at")


def delay_answer(loop: Loop, delay: IntArray, linked: BoolArray, radius_of: Callable[[IntArray], float]) -> DelayAnswer:
    """Decide a loop with a delay of each edge's measurements, in periods, shape (E,); see `largest_delay`."""
    limit = radius = None
    reason = ""
    d = int(delay.max(initial=0))
    try:
        limit = largest_delay(loop, linked, radius_of)
        reason = "the loop is unstable without delay" if limit is None else ""
    except UndecidedError as error:
        reason = str(error)
    try:
        radius = radius_of(delay)
        stable = is_stable(radius)
    except UndecidedError as error:
        # Of unlike delays, the limit decides only for the paper's law, and only that it is stable.
        decides = limit is not None and ((delay == d).all() or (loop.is_papers and d <= limit))
        stable = limit is not None and d <= limit if decides else None
        reason = reason or (str(error) if stable is None else "")
    return DelayAnswer(
        delay=d * loop.period,
        stable=stable,
        spectral_radius=radius,
        margin=None if limit is None else limit * loop.period,
        reason=reason,
    )


def answer_of_large_team(gain: float, period: float, largest: float, delay: IntArray, linked: BoolArray) -> DelayAnswer:
    """Answer for the paper's law from lambda_max alone, 1/s and s, with a delay in periods for each edge."""
    d = int(delay.max(initial=0))
    holds = 0.0 < gain * period * largest < 2.0 - _ROUNDING
    limit = limit_from_eigenvalues(np.array([largest]), gain * period) if holds else None
    enough = limit is not None and d <= limit
    decided = enough or bool((delay == d).all())
    reason = "" if decided and linked.all() else "edges have unlike delays, anchors none, and H is large"
    margin = None if limit is None or not linked.all() else limit * period
    return DelayAnswer(delay=d * period, stable=enough if decided else None, margin=margin, reason=reason)
