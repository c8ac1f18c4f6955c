"""The held law on ideal kinematics, per eigenvalue of H: its loop, its stable gains, and a bound on a run.

Loops are closed in one place, `closed`: linear models of vehicles over a period, with a linear law. Ideal agents are
vehicles whose position moves as commanded (`ideal_vehicle`). A delay of measured positions adds states to the vehicle
(`delayed`).

In each eigenvector of H the law is a linear filter, which `linear_law` computes. With e = q* - q, the error of one
mode, and x, the state of the law,

    u_k = d e_{k-j} + c x_k,    x_{k+1} = A x_k + b e_{k-j},    e_{k+1} = e_k + h u_k

for measurements that are j periods old. Such a measurement is combined with odometry of the same age, so the responses
of feedforward and the observer to the motion cancel: they bring noise into the loop, but no feedback.

The bound on a run is that of the same loop, driven along the targets' path.

With one gain for all, every term is a polynomial in H, and under a hold h the team decouples into one small matrix for
each eigenvalue lambda. With e = q* - q, W and F the means over a period of q*' and of the medium's velocity at agents,

    s_k = alpha e_k + c s_{k-1}        newton: delta, c = T_r(..) as its rounds contract, alpha = 1 - c;
                                       without it s = lambda e: alpha = lambda, c = 0
    e_{k+1} = e_k - h (k1 s_k - k_I z_k) + h d_k,    z_{k+1} = z_k - h lambda e_k,    d_k = W_k - v_k - (F_k - phi_k)

is exact on ideal kinematics while no command is limited. Feedforward v and the observer's estimate phi do not depend on
e and are part of d. So with x = (e, s, z), x+ = M x + h g d, and in 2-norms over the team

    |e_k| <= max |(M^k)_ee| |e_0| + h sum_j max |(M^j g)_e| |d_{k-1-j}|,    max over the eigenvalues.

The known part of d along the targets' path is computed, because the path does not depend on agents, and disturbances
follow from the seed. The rest is bounded: q* by the error of the path, the flow between two samples and at q instead of
q* by its slope over balls that contain both points, odometry by its largest errors. The slope is not in M. It adds at
most rho_k |e| to |F_k|, which needs a bound on |e| itself. If the field is bounded, one follows from the largest speed
of the flow, |f(q) - f(q*)| <= 2 sup |f|. Otherwise, a radius is assumed that the bound computed with it does not reach:
up to the first instant at which |e| reached it, the bound would hold, so there is no such instant. From any bound that
is valid at all times of the run, a better one follows in the same way, so the bounds of successive rounds decrease, and
each is valid.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebroots
from numpy.typing import NDArray
from pydantic import Field
from scipy.fft import irfft, next_fast_len, rfft

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.linear_law import (
    LawModel,
    LinearController,
    LinearLaw,
    model_of,
    require_model,
    terms_without_bound,
    unmodelled_parts,
)
from mjsheaf.checking.spectrum import DENSE_STATES, agent_coboundary, held_eigenvalues
from mjsheaf.checking.theorem.certificate import FILTERED, Certificate, obstacle_of_rank
from mjsheaf.checking.theorem.constants import agent_slopes, flow_over_periods, speed_everywhere
from mjsheaf.checking.theorem.targets import Carrier, targets_loop
from mjsheaf.errors import UndecidedError, listed
from mjsheaf.law.terms import traffic_of
from mjsheaf.loop.linear import LinearVehicle
from mjsheaf.loop.system import System
from mjsheaf.noise import LARGEST_NORMAL
from mjsheaf.section import OF_TEAM, TEAM_NORM, Finite, Norm, Record, per_agent

_ROUNDING = 1e-9  # relative, of sums and eigenvalues
_SUMMED = 1e-7  # largest remainder, as a fraction of a sum of responses
_DOUBLINGS, _MOST_BLOCKS = 8, 8000  # doublings in a block of powers of the loop, and largest number of blocks
_BLOCK = 2**_DOUBLINGS


def closed(plant: LinearVehicle, law: LinearController) -> NDArray[Any]:
    """Return the closed loop of a law and vehicles, on their positions p, their states x, and the state z of the law.

    The vehicles are p' = p + C x + D u and x' = A x + B u, the law is u = D_l p + C_l z and z' = A_l z + B_l p. If the
    law has a matrix for each of L eigenvalues, so has the loop.
    """
    k, s, r = len(plant.C), len(plant.A), law.A.shape[-1]
    push = np.vstack([plant.D, plant.B])
    M = np.zeros((*law.D.shape[:-2], k + s + r, k + s + r), dtype=law.D.dtype)
    M[..., :k, :k] = np.eye(k)
    M[..., :k, k : k + s] = plant.C
    M[..., k : k + s, k : k + s] = plant.A
    M[..., : k + s, :k] += push @ law.D
    M[..., : k + s, k + s :] = push @ law.C
    M[..., k + s :, :k] = law.B
    M[..., k + s :, k + s :] = law.A
    return M


def driven(plant: LinearVehicle, law: LinearController) -> LinearController:
    """Return the closed loop from the inputs of the law other than positions to the command; states as in `closed`."""
    k = len(plant.C)
    of_positions, of_inputs = law.D[..., :k], law.D[..., k:]
    return LinearController(
        A=closed(plant, law._replace(B=law.B[..., :k], D=of_positions)),
        B=np.concatenate([np.vstack([plant.D, plant.B]) @ of_inputs, law.B[..., k:]], axis=-2),
        C=np.concatenate([of_positions, np.zeros((*law.D.shape[:-1], len(plant.A))), law.C], axis=-1),
        D=of_inputs,
    )


def delayed(plant: LinearVehicle, periods: int) -> LinearVehicle:
    """Return a vehicle whose position is measured with a delay: its state ends with the motions not yet measured."""
    n, s = plant.C.shape
    d = n * periods
    if not d:
        return plant
    A, B, C = np.zeros((s + d, s + d)), np.zeros((s + d, n)), np.zeros((n, s + d))
    A[:s, :s] = plant.A
    A[s : s + n, :s] = plant.C
    A[s + n :, s : s + d - n] = np.eye(d - n)
    B[:s] = plant.B
    B[s : s + n] = plant.D
    C[:, s + d - n :] = np.eye(n)
    return LinearVehicle(A, B, C, np.zeros_like(plant.D))


def ideal_vehicle(period: float, axes: int = 1) -> LinearVehicle:
    """Return an agent on ideal kinematics, whose position moves as commanded over a period, s."""
    return LinearVehicle(np.zeros((0, 0)), np.zeros((0, axes)), np.zeros((axes, 0)), period * np.eye(axes))


def largest_gain(values: NDArray[Any], period: float, delay: int = 0) -> float | None:
    """Return the gain above which the paper's held law is unstable, 1/s; None if it is unstable at any gain.

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


@dataclass(frozen=True)
class Loop:
    """The loop of an ideal agent per eigenvalue of H, on the error and the state of the law.

    Attributes:
        model: Linear model of the law.
        values: Eigenvalues of H above zero, shape (L,); complex if H is not symmetric.
        gain: k1, 1/s.
        period: h, s.
    """

    model: LawModel
    values: NDArray[Any]
    gain: float
    period: float

    @cached_property
    def law(self) -> LinearLaw:
        """The law in eigenvectors of H."""
        return self.model.at(self.gain, self.values)

    @cached_property
    def feedback(self) -> LinearLaw:
        """Return the law's response to the error."""
        return self.model.feedback(self.gain, self.values)

    @cached_property
    def is_papers(self) -> bool:
        """Return True if the feedback from the error is the paper's law; other terms may add to it."""
        papers = -self.gain * self.values
        alike = np.allclose(
            self.feedback.D[:, 0], papers, rtol=_ROUNDING, atol=_ROUNDING * np.abs(papers).max(initial=0.0)
        )
        return alike and not self.feedback.C.shape[1]

    def matrices(self, gain: float | None = None, delay: int = 0) -> NDArray[Any]:
        """Return M at a gain, shape (L, 1 + delay + r, 1 + delay + r), with measurements `delay` periods old.

        Its states are the measured e, the last motions that are not measured yet, and x.
        """
        feedback = self.feedback if gain is None else self.model.feedback(gain, self.values)
        return closed(delayed(ideal_vehicle(self.period), delay), feedback.alike(1))

    def radius_at(self, delay: int) -> float:
        """Return the largest spectral radius of the modes that errors excite, with measurements `delay` periods old."""
        return float(np.abs(np.linalg.eigvals(self.matrices(delay=delay))).max())

    @cached_property
    def radius(self) -> float:
        """Largest spectral radius."""
        return self.radius_at(0)

    @cached_property
    def stable_gains(self) -> tuple[float, float] | None:
        """Interval of gains at which every mode is stable, 1/s: the one with the present gain, or else the nearest.

        None if there is none, if the command is not affine in the gain, or with terms if H is not symmetric.
        """
        if self.model.plain:
            largest = largest_gain(self.values, self.period)
            return None if largest is None else (0.0, largest)
        if np.iscomplexobj(self.values):
            return None
        none, one, two = (self.matrices(k) for k in (0.0, 1.0, 2.0))
        change = one - none
        rounding = _ROUNDING * np.abs(two).max()
        if change[:, 1:].any() or not np.allclose(two - one, change, rtol=_ROUNDING, atol=rounding):
            return None
        stretches = np.array([[0.0, np.inf]])
        for low, high in map(self._stable, none, change):
            begin, end = np.maximum(stretches[:, None, 0], low), np.minimum(stretches[:, None, 1], high)
            stretches = np.stack([begin, end], axis=-1)[begin < end]
        if not len(stretches):
            return None
        away = np.maximum(stretches[:, 0] - self.gain, self.gain - stretches[:, 1])
        low, high = stretches[int(away.argmin())]
        return float(low), float(high)

    def _stable(
        self,
        M: Array,
        change: Array,
        *,
        no_gain: float = 1e-12,  # a gain times the period that is below it, or above its inverse, is rounding
    ) -> tuple[Array, Array]:
        """Find the intervals of gains k in which M + k change is stable: their lower and upper ends, ascending.

        Only the first row of `change` is not zero, so that the characteristic polynomial is a(z) + k b(z). A root
        passes the unit circle only at a gain -a(z) / b(z) with z on it, where the imaginary part of a(z) times the
        conjugate of b(z) is zero. With z = exp(i theta) that is a sum of s_m sin(m theta), and so sin(theta) times a
        polynomial in cos(theta). Every such gain is tried between its neighbours, so an extra one does not matter.
        """
        a = np.poly(M)[::-1]  # ascending powers of z
        b = np.poly(M + change)[::-1] - a
        n = len(a) - 1
        sines = np.array([a[m:] @ b[: n + 1 - m] - a[: n + 1 - m] @ b[m:] for m in range(1, n + 1)])
        # sin(m theta) / sin(theta) is U_{m-1} = 2 (T_{m-1} + T_{m-3} + ...), with T_0 counted once.
        cosines = np.array([2.0 * sines[m::2].sum() for m in range(n)])
        cosines[0] *= 0.5
        roots = chebroots(np.trim_zeros(cosines, "b")) if cosines[1:].any() else np.zeros(0)
        z = np.concatenate([[1.0, -1.0], np.exp(1j * np.arccos(np.clip(roots.real, -1.0, 1.0)))])
        with np.errstate(divide="ignore", invalid="ignore"):
            gains = (-np.polyval(a[::-1], z) / np.polyval(b[::-1], z)).real
        gains = np.sort(gains[(gains > no_gain / self.period) & (gains < 1.0 / (no_gain * self.period))])
        gains = np.concatenate([[0.0], gains, [2.0 * gains[-1] + 1.0 if len(gains) else 1.0]])
        middle = 0.5 * (gains[1:] + gains[:-1])
        stable = np.abs(np.linalg.eigvals(M + middle[:, None, None] * change)).max(axis=1) < 1.0
        turns = np.flatnonzero(np.diff([False, *stable.tolist(), False]))
        ends = np.append(gains[:-1], np.inf)[turns]
        return ends[::2], ends[1::2]

    @cached_property
    def error_per_disturbance(self) -> float:
        """h sum_j max |(M^j g)_e|, s; infinite if it does not converge, or too slowly."""
        if not self.radius < 1.0:
            return np.inf
        start = np.zeros((len(self.values), self.feedback.C.shape[1] + 1, 1))
        start[:, 0] = self.period
        total = 0.0
        for states in itertools.islice(self._powers(start), _MOST_BLOCKS):
            largest = np.abs(states[:, 0]).max(axis=0)
            total += float(largest.sum())
            if largest.max() < _SUMMED * (1.0 - self.radius) * total:
                return total * (1.0 + _SUMMED)
        return np.inf

    def _powers(self, start: Array) -> Iterator[Array]:
        """Yield M^j start, shape (L, n, k), for one block of powers j = 0, 1, ... after the other, (L, n, _BLOCK k)."""
        power = self.matrices()
        states = start
        for _ in range(_DOUBLINGS):
            states = np.concatenate([states, power @ states], axis=2)
            power = power @ power
        while True:
            yield states
            states = power @ states

    def responses(
        self,
        count: int,
        *,
        nothing: float = 1e-40,  # of a response: all that follows is lost in rounding
    ) -> Array:
        """Return the largest sizes over the eigenvalues, shape (6, count), of powers j = 0, 1, ...

        After e_0: e; the feedback's command, 1/s; z, s. After h d: e, s; the feedback's command; z, s^2.
        """
        feedback = self.feedback
        L, r = feedback.C.shape
        shown = np.zeros((L, 3, 1 + r))
        shown[:, 0, 0] = 1.0
        shown[:, 1, 0] = feedback.D[:, 0]
        shown[:, 1, 1:] = feedback.C
        shown[:, 2, 1:] = feedback.integral
        start = np.zeros((L, 1 + r, 2))
        start[:, 0] = [1.0, self.period]
        found = np.zeros((2, 3, count))
        for begin, states in zip(range(0, count, _BLOCK), self._powers(start), strict=False):
            size = np.abs(shown @ states).max(axis=0).reshape(3, _BLOCK, 2)
            found[:, :, begin : begin + _BLOCK] = size.transpose(2, 0, 1)[:, :, : count - begin]
            if np.abs(states).max() < nothing:
                break
        return found.reshape(6, count) * (1.0 + _ROUNDING)

    def with_noise(self, delay: int) -> tuple[Array, Array, Array]:
        """Return the loop from noise to the error with measurements `delay` (d) periods old.

        The state is e_k, ..., e_{k-d}, then the state of the law, then the last d errors of odometry, which are
        combined with measurements of the same age. The inputs are those of `linear_law.INPUTS` except the position:
        errors of eta, of the measurements of feedforward, of odometry in these, and of odometry itself.

        Returns:
            M and G of x+ = M x + G w, and the rows from x and w to the command: (L, n, n), (L, n, 4), (L, n + 4).
        """
        law = self.law
        d = delay
        L, n = law.C.shape
        waiting = d if law.B[:, :, 3].any() or law.D[:, 3].any() else 0
        size = d + 1 + n + waiting
        remembered = slice(d + 1, d + 1 + n)
        sensed_motion = size - 1 if waiting else size + 2
        inputs = [d, size, size + 1, sensed_motion, size + 3]  # of the law, among states and inputs
        command = np.zeros((L, size + 4))
        command[:, remembered] = law.C
        command[:, inputs] = law.D
        rows = np.zeros((L, size, size + 4))
        rows[:, remembered, remembered] = law.A
        rows[:, remembered, inputs] = law.B
        rows[:, 0] = self.period * command
        rows[:, 0, 0] += 1.0
        rows[:, range(1, d + 1), range(d)] = 1.0
        if waiting:
            first = d + 1 + n
            rows[:, first, size + 2] = 1.0
            rows[:, range(first + 1, size), range(first, size - 1)] = 1.0
        return rows[..., :size], rows[..., size:], command


def stationary(
    A: Array,
    B: Array,
    W: Array,
    *,
    smallest: float = 1e-12,  # of a power of a matrix, beyond which nothing is added
) -> Array:
    """Solve P = A P B^T + W for stable matrices A and B, shape (..., n, n), by doubling."""
    P = W
    while np.abs(A).max() * np.abs(B).max() > smallest:
        P = P + A @ P @ B.swapaxes(-1, -2)
        A, B = A @ A, B @ B
    return P


# -- the law of a team, and a bound on its run -------------------------------------------------------------------------


class Share(Record):
    """A part of the residual disturbance d."""

    part: str = Field(description="cause of the part")
    size: float = Field(description="its largest size over the second half of the run, 2-norm over the team, m/s")


class LawLoop(Record):
    """The law with its terms, held over a period on ideal kinematics."""

    terms: list[str] = Field(description="terms beyond the paper's law")
    unmodelled: list[str] = Field(
        description='parts of the law that check has no model of, such as "term NAME": with any of them the law, its '
        "links, the vehicles' loop and so the whole check are undecided"
    )
    stable: bool | None = Field(description="every spectral radius is below 1; null if undecided: see reason")
    spectral_radius: Finite = Field(description="largest over the eigenvalues of H; null if undecided")
    rate: Finite = Field(description="slowest decay, -log(spectral radius) / h, 1/s; null if undecided")
    largest_gain: Finite = Field(description="the larger of `stable_gains`; null if there is none or it is undecided")
    stable_gains: list[float] | None = Field(
        description="limits of k1 between which the loop is stable, 1/s: of the interval with the present gain, else "
        "of the nearest; null if there is none or it is undecided"
    )
    error_per_disturbance: Finite = Field(
        description="|e| of the team is finally at most this times the largest size of the residual disturbance d, s; "
        "null if undecided"
    )
    radius: Finite = Field(
        description="|e| of the team never exceeds it at samples of the second half of the run, m; null: see reason"
    )
    between: Finite = Field(description="the same between samples too, m")
    largest: Finite = Field(description="the same over the whole run, m")
    radius_per_agent: Finite = Field(description="`radius` as RMS over agents, radius / sqrt(N), m")
    between_per_agent: Finite = Field(description="`between` as RMS over agents, m")
    largest_per_agent: Finite = Field(description="`largest` as RMS over agents, m")
    unlimited_per_agent: Finite = Field(description="`unlimited` as RMS over agents, m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    command: Finite = Field(
        description="no agent's command exceeds it over the second half of the run, before its last sample, m/s"
    )
    unlimited: Finite = Field(description="`radius` of the same law without limits of speed and integral, m")
    left: list[Share] = Field(description="residual disturbance d by cause, the largest first")
    exchanges: float = Field(description="rounds of exchange between neighbours a second")
    numbers: float = Field(description="numbers that an agent sends a second, mean over the agents")
    noise: Finite = Field(
        description="upper bound on the RMS noise of the command over that of a sample of odometry, in closed loop, "
        "1/s; null if the loop is not stable"
    )
    reason: str = Field(description="why a number is missing, or empty")


UNKNOWN_ROUNDS = "messages of rounds can be delayed or lost, by links.rounds or a range of communication"
"""Why the loop of feedforward or newton is not known."""

ROUNDS_OF_FITTING_EDGES = "edges do not fit together, and rounds of newton or feedforward solve as if they did"
"""Why the loop of feedforward or newton is not known near a q* where pulls cancel without vanishing."""


def residual_polynomial(values: Array, rounds: int, low: float, high: float) -> Array:
    """Evaluate the factor of an error after some rounds of `mjsheaf.law.terms.solve`, by eigenvalue, shape (L,).

    It uses the same recurrence, so eigenvalues may lie outside [low, high], and low may equal high.
    """
    middle, square = 0.5 * (low + high), 0.25 * (high - low) ** 2
    error, direction, before, scale = np.ones_like(values), np.zeros_like(values), 0.0, 1.0 / middle
    for r in range(rounds):
        direction = -(2.0 if r else 1.0) * scale * values * error + (square * before * scale * direction if r else 0.0)
        error = error + direction
        before, scale = scale, 1.0 / (2.0 * middle - square * scale)
    return error


def eigen_of(system: System) -> tuple[Array, Array]:
    """Return eigenvalues and orthonormal eigenvectors of H, shapes (L,) and (n, L); of a free team those above zero.

    Raises:
        UndecidedError: H is not symmetric, it is singular in a team that is not free, the law is continuous, or H is
            too large.
    """
    team = system.team
    problem = team.dirichlet
    n = problem.H.shape[0]
    if not team.symmetric:
        raise UndecidedError("H is not symmetric")
    if system.grid.continuous:
        raise UndecidedError("the law is continuous: see Theorem 1")
    if not (team.free or problem.unique):
        raise UndecidedError("the harmonic extension is not unique")
    if n > DENSE_STATES:
        raise UndecidedError(f"H has {n} rows; all its eigenvalues are found up to {DENSE_STATES}")
    values, vectors = problem.eigenvectors
    free = problem.sparse_null_basis.shape[1]
    if free == n or (values[free] <= 0.0 and not team.stressed):
        raise UndecidedError("the smallest eigenvalue of H is lost in rounding")
    return values[free:], vectors[:, free:]


def loop_of(system: System) -> Loop:
    """Return the held loop of a system's law.

    Raises:
        UndecidedError: A part of the law is not modelled (see `linear_law`), the law is continuous, H is singular in
            a team that is not free or too large for its eigenvalues, or rounds can be delayed or lost.
    """
    require_model(system)
    if not system.team.symmetric and system.grid.continuous:
        raise UndecidedError("the law is continuous: see rigidity.rate")
    values: NDArray[Any] = eigen_of(system)[0] if system.team.symmetric else held_eigenvalues(system.team)
    if system.law.terms.rounds.imperfect:
        raise UndecidedError(UNKNOWN_ROUNDS)
    if system.team.stressed and (system.law.terms.newton or system.law.terms.feedforward):
        raise UndecidedError(ROUNDS_OF_FITTING_EDGES)
    return Loop(model_of(system.law, system.grid.period), values, system.gain, system.grid.period)


def common_delay(system: System) -> int | None:
    """Return the delay of all measurements, in periods; None if it is not the same for all."""
    delays = system.law.links.table["delay"]
    alike = len(delays) == len(system.team.measuring_edges) and len(set(delays.tolist())) == 1
    return int(delays.max(initial=0)) if alike or not delays.any() else None


@dataclass(frozen=True)
class _Drive:
    """Inputs of the loop along the targets' path, in K periods, and their errors.

    Attributes:
        left: W - v, residual of feedforward, shape (K, n_q), m/s.
        met: F - phi at q*, residual of the observer, shape (K, n_q), m/s.
        asked: v - phi, addition of the terms to the command, shape (K, n_q), m/s.
        unsure: Largest error of these due to path and odometry, m/s.
        middle: q* in the middle of each period, shape (K, n_q), m.
        moves: Bound on the distance of each agent's q* from there in the period, shape (K, N), m.
        ripple: Bound on the distance of q*' - omega from a constant in each period, shape (K,), m/s.
        share: Weight of a new measurement in the observer's filter; 0 without the term.
    """

    left: Array
    met: Array
    asked: Array
    unsure: float
    middle: Array
    moves: Array
    ripple: Array
    share: float

    def observed(self, values: Array) -> Array:
        """Return a bound on a part of phi from a bound on the same part of F, shape (K,)."""
        return _filtered(values[:, None], self.share)[:, 0] if self.share else np.zeros_like(values)


def _filtered(values: Array, share: float) -> Array:
    """Filter by a first-order lag, one sample delayed: 0, the first value, then averages; shape (K, n)."""
    from scipy.signal import lfilter  # which takes a third of a second to load

    found = np.zeros_like(values)
    if len(values) > 1:
        with np.errstate(invalid="ignore"):  # 0 times what is infinite
            state = (1.0 - share) * values[:1]
        found[1:] = lfilter([share], [1.0, share - 1.0], values[:-1], axis=0, zi=state)[0]
    return found


def _drive(
    system: System,
    certificate: Certificate,
    values: Array,
    vectors: Array,
    *,
    most: int = 20_000_000,  # largest product of samples and states
) -> _Drive:
    """Compute the inputs of the loop, with feedforward and observer, along the targets' path."""
    team, terms, h, path = system.team, system.law.terms, system.grid.period, certificate.constants.path
    n_q, N = len(values), len(team.agents)
    if path.cells is None:
        raise UndecidedError(f"the targets' path is not known: {path.warning}")
    if path.stride > 1 or len(path.samples) * n_q > most:
        raise UndecidedError("the run has too many samples")
    carrier = Carrier(system)
    K = len(path.samples) - 1
    q_star = carrier.extend(path.samples, system.grid.span(0, K + 1))
    W, middle = np.diff(q_star, axis=0) / h, 0.5 * (q_star[1:] + q_star[:-1])
    unsure = 2.0 * float(np.linalg.norm(carrier.reach(np.full(len(team.targets), path.error)))) / h
    total, v = unsure, np.zeros_like(W)
    if terms.feedforward:
        from scipy.signal import lfilter

        c = residual_polynomial(values, terms.feedforward, *terms.eigenvalues)
        # Agents know how offsets change: that is not filtered, and nothing is added at the first sample of a run.
        known = np.where(np.arange(K) > 0, 1.0, 0.0)[:, None] * (carrier.rate @ vectors)
        rate, lead = _filtered((W - carrier.rate) @ vectors, terms.measured) + known, float(terms.lead[0])
        for one, kept in enumerate(c):
            rate[:, one] = lfilter([1.0 - kept], [1.0, -kept], rate[:, one])
        before = np.vstack([np.zeros((1, n_q)), rate[:-1]])
        leads = np.where(np.arange(K) > terms.settled, lead, 0.0)[:, None]
        v = (rate + leads * (rate - before)) @ vectors.T
        total += (1.0 + 2.0 * lead) * _amplified(c) * (unsure + _odometry(system, sensed=True))
    moving = system.moving_bounds.speed
    if not np.isfinite(moving).all():
        raise UndecidedError("vehicles meet gusts, which are not bounded")
    total += float(np.linalg.norm(moving[:N]))
    F = flow_over_periods(system, middle, 0)
    observed = np.zeros_like(F)
    if terms.drift > 0.0:
        observed = _filtered(F, terms.drift)
        total += _odometry(system, sensed=False)
    # How far q* may be from the middle of its period: by the cells that cover it.
    cells = path.cells
    period = np.clip(((0.5 * (cells.begin + cells.end) - system.grid.start) / h).astype(int), 0, K - 1)
    reach = carrier.reach(np.linalg.norm(cells.half, axis=2) + cells.bend) + carrier.slide(cells.end - cells.begin)
    there = carrier.extend(cells.centre, 0.5 * (cells.begin + cells.end))
    away = np.linalg.norm(team.unpack(there - middle[period]), axis=2) + reach
    moves, ripple = np.zeros((K, N)), np.zeros(K)
    np.maximum.at(moves, period, away)
    carried = carrier.carry(cells.drift)
    first = np.searchsorted(period, np.arange(K))
    change = np.linalg.norm(carried - carried[first[period]], axis=1)
    np.maximum.at(ripple, period, change + np.linalg.norm(carrier.reach(cells.spread), axis=1))
    shake = 0.5 * h * (np.linalg.norm(system.harmonics[..., :3], axis=2) * np.abs(system.harmonics[..., 3])).sum(axis=1)
    shake[N:] += 2.0 * moving[N:]
    ripple += np.linalg.norm(shake[:N]) + np.linalg.norm(carrier.reach(shake[N:]))
    return _Drive(W - v, F - observed, v - observed, total, middle, moves, ripple, terms.drift)


def _amplified(
    c: Array,
    *,
    samples: int = 4000,  # samples of a filter's response
) -> float:
    """Bound the error of v due to errors of at most 1 at each sample, 2-norms: sum_j max |(1 - c) c^j|.

    The maximum is taken for each power, because the error may lie in another eigenvector at each sample.
    """
    kept, powers = np.abs(c), np.arange(samples + 1)[:, None]
    largest = (np.abs(1.0 - c) * kept**powers).max(axis=1)
    return float(largest[:-1].sum() + largest[-1] / (1.0 - kept.max()))


def _odometry(system: System, *, sensed: bool) -> float:
    """Return the largest error due to odometry of the observer or, if `sensed`, of H^-1 B p', 2-norm, m/s."""
    terms, n_q = system.law.terms, system.team.dirichlet.H.shape[0]
    if not (terms.noise or terms.bias):
        return 0.0
    wrong = np.sqrt(n_q) * (terms.noise * LARGEST_NORMAL / terms.period + abs(terms.bias))
    return float(wrong * _carried_odometry(system)) if sensed else float(wrong)


def _carried_odometry(system: System) -> float:
    """Return the 2-norm of H^-1 S, S = sum of F_i^T K F_i over sensing edges."""
    team = system.team
    first = sum(len(edge.b) for edge in team.communication)
    rows = agent_coboundary(team)[1][first : first + sum(len(edge.b) for edge in team.sensing)]
    if not rows.shape[0]:
        return 0.0
    return float(np.linalg.norm(np.linalg.solve(team.dirichlet.H.toarray(), (rows.T @ rows).toarray()), ord=2))


@dataclass(frozen=True)
class Envelope:
    """A bound on a run of K periods on ideal kinematics, 2-norms over the team.

    Attributes:
        samples: Bound on |e| at samples, shape (K + 1,), m.
        within: Bound on |e| within each period, shape (K,), m.
        command: Bound on every agent's command, shape (K, N), m/s.
        integral: Bound on the size of an agent's k_I z, m/s.
        left: Parts of d in the bound, by name, shape (K,) each, m/s.
        clipped: Reason why a limit may be reached, so that this bounds only the law without limits; or empty.
    """

    samples: Array
    within: Array
    command: Array
    integral: float
    left: dict[str, Array]
    clipped: str

    def late(self) -> float:
        """Return the bound at samples of the second half of the run, m."""
        return float(self.samples[len(self.within) // 2 :].max())


def envelope(system: System, certificate: Certificate) -> Envelope:
    """Bound a run of a system; see the module.

    Raises:
        UndecidedError: There is no bound; the message is the reason.
    """
    if system.team.linearised_at is not None:
        raise UndecidedError("the team is linearised: what is said of it is local, and bounds no run")
    loop = loop_of(system)
    if not np.isfinite(certificate.constants.initial_error):
        raise UndecidedError("the error with which the phase begins is not known")
    if len(system.law.links.table):
        raise UndecidedError("links are not exact: no bound is known with noise, delay, loss or range")
    if new := terms_without_bound(system.law):
        raise UndecidedError(f"no bound along the targets' path is known with {listed(new)}")
    if deficient := obstacle_of_rank(system):
        raise UndecidedError(deficient)
    if not loop.radius < 1.0:
        raise UndecidedError("the loop is unstable")
    if diverging := targets_loop(system).failure:
        raise UndecidedError(diverging)
    return _bounded(system, certificate, loop, _drive(system, certificate, *eigen_of(system)))


def _why_clipped(system: System, command: Array, integral: float) -> str:
    """Return the limit that a run may reach, by the bounds of an envelope; empty if it reaches none."""
    if system.safety is not None:
        return FILTERED
    limit = system.law.limit[: len(system.team.agents)]
    over = (command > limit).any(axis=0)
    if over.any():
        i = int(over.argmax())
        most = f"{command[:, i].max():.3g} m/s"
        return f"the law may command {most} for {system.team.agents[i].id}, above its speed limit of {limit[i]:.3g} m/s"
    more = integral > system.law.terms.largest
    return f"the integral may reach its limit: it may need {integral:.3g} m/s" if more else ""


def _bounded(
    system: System,
    certificate: Certificate,
    loop: Loop,
    drive: _Drive,
    *,
    worth: float = 0.99,  # largest ratio to the bound of the previous round that is worth another round
    rounds: int = 12,
    doublings: int = 23,  # of |e_0| or 1 mm, up to the largest radius that is tried in an unbounded field
) -> Envelope:
    K, N, h, start = len(drive.left), len(system.team.agents), loop.period, certificate.constants.initial_error
    decay, ask_start, kept_start, hit, ask, kept = loop.responses(K + 1)
    known = np.linalg.norm(drive.left - drive.met, axis=1) + drive.unsure

    def answer(apart: Array) -> tuple[Array, Array, Array]:
        """Return bounds at samples and within periods, and on |d|, from one on f(q) - f(q*)."""
        unknown = apart + change
        d = known + unknown + drive.observed(unknown)
        if not np.isfinite(d).all():
            return np.full(K + 1, np.inf), np.full(K, np.inf), d
        samples = _driven(decay * start, hit, d)
        return samples, np.maximum(samples[1:], samples[:-1]) + 0.5 * h * (drive.ripple + unknown), d

    def flow(within: Array) -> Array:
        """Return a bound on f(q) - f(q*) from one on |e| within periods."""
        slopes = agent_slopes(system, drive.middle, drive.moves + within[:, None])
        with np.errstate(invalid="ignore"):
            each = np.where(within[:, None] > 0.0, slopes * within[:, None], 0.0)
        # `within` bounds the norm over all agents: the smaller one of two bounds, by the steepest slope or by agent.
        return np.minimum(each.max(axis=1), np.linalg.norm(np.minimum(each, fastest), axis=1))

    with np.errstate(invalid="ignore"):  # an infinite slope where nothing moves
        near = np.where(drive.moves > 0.0, agent_slopes(system, drive.middle, drive.moves) * drive.moves, 0.0)
    change = np.linalg.norm(near, axis=1)
    fastest = 2.0 * speed_everywhere(system)  # bound on the difference of the flow at two points
    within = np.full(K, np.inf)
    if np.isfinite(fastest):
        within = answer(np.full(K, np.sqrt(N) * fastest))[1]
    else:
        for radius in max(start, 1e-3) * 2.0 ** np.arange(1, doublings + 1):
            trial = np.full(K, radius)
            if (answer(flow(trial))[1] < radius).all():
                within = trial
                break
    if not np.isfinite(within).all():
        raise UndecidedError("the flow is too steep or singular where the agents may be: no bound confines them")
    for _ in range(rounds):
        apart = flow(within)
        samples, narrower, d = answer(apart)
        better = narrower.sum() < worth * within.sum()
        within = np.minimum(within, narrower)
        if not better:
            break
    fed = _driven(ask_start * start, ask, d)[:K] + drive.unsure + drive.observed(apart + change)
    command = np.linalg.norm(system.team.unpack(drive.asked), axis=2) + fed[:, None]
    integral = system.law.terms.integral * float(_driven(kept_start * start, kept, d).max())
    terms = system.law.terms
    odometry = " and of odometry" if (terms.noise or terms.bias) and (terms.feedforward or terms.drift) else ""
    parts = {
        "targets' motion" + (", less feedforward" if terms.feedforward else ""): np.linalg.norm(drive.left, axis=1),
        "flow and disturbance along q*" + (", less the observed drift" if terms.drift else ""): np.linalg.norm(
            drive.met, axis=1
        ),
        "flow at q instead of q*, by its slope": apart + drive.observed(apart),
        "flow within a period": change + drive.observed(change),
        "errors of the targets' path" + odometry: np.full(len(drive.left), drive.unsure),
    }
    return Envelope(samples, within, command, integral, parts, _why_clipped(system, command, integral))


def _driven(free: Array, response: Array, d: Array) -> Array:
    """Add to a free motion (K + 1,) the convolution of a response with d (K,), by the fast Fourier transform."""
    K, size = len(d), next_fast_len(2 * len(d) - 1, real=True)
    free[1:] += irfft(rfft(response[:K], size) * rfft(d, size), size)[:K] * (1.0 + _ROUNDING)
    return free


def law_loop(system: System, certificate: Certificate, *, carried: bool = False) -> LawLoop:
    """Analyse the loop of a system's law, and bound its run if a bound exists.

    If `carried`, the law's terms keep their memory from the phase before. The bound assumes empty memory, so it is then
    computed for the paper's law only.
    """
    terms, h = system.law.terms, system.grid.period
    sent = traffic_of(terms, system.team)
    found: dict[str, Any] = {
        "terms": list(system.law.term_names),
        "unmodelled": unmodelled_parts(system),
        "exchanges": sent.rounds / h,
        "numbers": sent.numbers / (h * len(system.team.agents)),
        **dict.fromkeys(["stable", "spectral_radius", "rate", "largest_gain", "stable_gains", "noise"]),
        **dict.fromkeys(["error_per_disturbance", "radius", "between", "largest", "command", "unlimited"]),
        "left": [],
        "reason": "",
    }
    try:
        loop = loop_of(system)
        found |= {
            "stable": loop.radius < 1.0,
            "spectral_radius": loop.radius,
            "rate": -np.log(max(loop.radius, 1e-40)) / h,  # smaller radii are rounding
            "stable_gains": loop.stable_gains,
            "largest_gain": loop.stable_gains[1] if loop.stable_gains else None,
        }
        if not system.team.symmetric:
            raise UndecidedError("H is not symmetric: no bound along the targets' path is known")
        found["error_per_disturbance"] = loop.error_per_disturbance
        found["noise"] = _noise(system, loop) if loop.radius < 1.0 else None
        if carried and system.law.extended:
            raise UndecidedError("terms remember the phase before, which the bound does not cover")
        bound = envelope(system, certificate)
        late = slice(len(bound.within) // 2, None)
        found["unlimited"], found["reason"] = bound.late(), bound.clipped
        found["left"] = sorted(
            [Share(part=part, size=size[late].max()) for part, size in bound.left.items()],
            key=lambda share: -share.size,
        )
        if not bound.clipped:
            found["radius"], found["between"] = bound.late(), bound.within[late].max()
            found["largest"], found["command"] = bound.within.max(), bound.command[late].max()
    except UndecidedError as error:
        found["reason"] = str(error)
    agents = len(system.team.agents)
    for name in ("radius", "between", "largest", "unlimited"):
        found[f"{name}_per_agent"] = per_agent(found[name], agents)
    return LawLoop(**found)


def _noise(system: System, loop: Loop) -> float:
    """Return `LawLoop.noise`: bounds on the noise of odometry through sensed targets and through the agent's motion."""
    if not system.law.extended:
        return 0.0
    M, G, command = loop.with_noise(0)
    size = M.shape[1]
    noise = G.swapaxes(1, 2)[..., None] * G.swapaxes(1, 2)[..., None, :]  # (L, 4, n, n), of unit variance in each input
    P = stationary(M[:, None], M[:, None], noise)
    of_state = command[:, :size]
    rms = np.sqrt(np.einsum("li,lkij,lj->lk", of_state, P, of_state) + command[:, size:] ** 2)  # 1/s, shape (L, 4)
    carried = float((loop.values * rms[:, 2]).max()) * _carried_odometry(system)
    return carried + float(rms[:, 3].max())
