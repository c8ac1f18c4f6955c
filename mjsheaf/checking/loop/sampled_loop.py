"""The closed loop, and that of ideal agents: one small matrix for each eigenvalue of H, with and without delay.

A loop is closed in one place, `closed`: vehicles, linearised over a period, around a law, which is linear too. Ideal
agents are vehicles whose position moves as commanded (`ideal_vehicle`). Vehicles whose position is measured some
periods late are vehicles with more states (`delayed`).

In each eigenvector of H the law is the linear filter that `linear_law` reads off it, so that with e = q* - q, the
errors of one mode, and x, what the law remembers of them,

    u_k = d e_{k-j} + c x_k,    x_{k+1} = A x_k + b e_{k-j},    e_{k+1} = e_k + h u_k

with measurements j periods old. A measurement that is j periods old is met by odometry of the same age, so that what
feedforward and the drift's observer make of motion cancels: they carry noise into the loop, and nothing back.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebroots
from numpy.typing import NDArray

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.linear_law import LawModel, LinearController, LinearLaw
from mjsheaf.loop.linear import LinearVehicle

_ROUNDING = 1e-9  # relative, of sums and eigenvalues
_SUMMED = 1e-7  # of a sum of responses: what the rest may be
_DOUBLINGS, _MOST_BLOCKS = 8, 8000  # of powers of the loop that are found at a time, and how often
_BLOCK = 2**_DOUBLINGS


def closed(plant: LinearVehicle, law: LinearController) -> NDArray[Any]:
    """Close a law's loop around vehicles: on their positions, their states, and what the law remembers.

    p' = p + C x + D u and x' = A x + B u are the vehicles, u = D_l p + C_l z and z' = A_l z + B_l p is the law. Where
    the law has a matrix for each of L eigenvalues, so has the loop.
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
    """Close a law's loop, driven by the inputs that the law has beyond the positions; its output is the command.

    Its states are those of `closed`.
    """
    k = len(plant.C)
    of_positions, of_inputs = law.D[..., :k], law.D[..., k:]
    unseen = np.zeros((*law.D.shape[:-1], len(plant.A)))
    return LinearController(
        A=closed(plant, law._replace(B=law.B[..., :k], D=of_positions)),
        B=np.concatenate([np.vstack([plant.D, plant.B]) @ of_inputs, law.B[..., k:]], axis=-2),
        C=np.concatenate([of_positions, unseen, law.C], axis=-1),
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


@dataclass(frozen=True)
class Loop:
    """The loop of an ideal agent per eigenvalue of H, on the error and what the law remembers of it.

    Attributes:
        model: Linear model of the law.
        values: Eigenvalues of H above zero, shape (L,); complex where H is not symmetric.
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
        """Return True if errors meet the paper's law, whatever terms add to it."""
        papers = -self.gain * self.values
        alike = np.allclose(
            self.feedback.D[:, 0], papers, rtol=_ROUNDING, atol=_ROUNDING * np.abs(papers).max(initial=0.0)
        )
        return alike and not self.feedback.C.shape[1]

    def matrices(self, gain: float | None = None, delay: int = 0) -> NDArray[Any]:
        """Return M at a gain, shape (L, 1 + delay + r, 1 + delay + r), with measurements some periods old.

        It acts on e as it is measured, what is not measured yet of its last motions, and x.
        """
        feedback = self.feedback if gain is None else self.model.feedback(gain, self.values)
        return closed(delayed(ideal_vehicle(self.period), delay), feedback.alike(1))

    def radius_at(self, delay: int) -> float:
        """Return the largest spectral radius of what errors excite, with measurements some periods old."""
        return float(np.abs(np.linalg.eigvals(self.matrices(delay=delay))).max())

    @cached_property
    def radius(self) -> float:
        """Largest spectral radius."""
        return self.radius_at(0)

    @cached_property
    def stable_gains(self) -> tuple[float, float] | None:
        """Gains that hold every mode stable, about the present one or else the nearest, 1/s.

        None if there are none, if the command is not affine in the gain, and with terms where H is not symmetric.
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
        no_gain: float = 1e-12,  # times the period: a gain below it is rounding, and one over its inverse
    ) -> tuple[Array, Array]:
        """Find the gains k between which M + k change is stable: where they begin and end, ascending.

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
        """h sum_j max |(M^j g)_e|, s; infinite where it does not converge, or too slowly."""
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
        """Return how noise enters the loop with measurements d periods old.

        The state holds e_k, ..., e_{k-d}, then what the law remembers, then the last d errors of odometry, which meet
        measurements of their age. The inputs are those of `linear_law.INPUTS` but the position: errors of eta, of what
        feedforward senses, and of odometry in that and by itself.

        Returns:
            M and G of x+ = M x + G w, and rows that give the command of x and w: (L, n, n), (L, n, 4), (L, n + 4).
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

    def command_variances(self) -> Array:
        """Return the variance of the command by white noise of unit variance in each input, shape (L, 4), 1/s^2.

        See `with_noise`.
        """
        M, G, command = self.with_noise(0)
        size = M.shape[1]
        noise = G.swapaxes(1, 2)[..., None] * G.swapaxes(1, 2)[..., None, :]  # (L, 4, n, n)
        P = stationary(M[:, None], M[:, None], noise)
        of_state = command[:, :size]
        return np.asarray(np.einsum("li,lkij,lj->lk", of_state, P, of_state) + command[:, size:] ** 2)


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
