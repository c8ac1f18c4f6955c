"""What links do to the held law on ideal kinematics: delay, noise and loss, answered exactly where an answer is known.

With e = q* - q and D_e q what edge e measures of the agents, H is the sum of H_e = D_e^T K_e D_e. A measurement that is
d periods old is met by odometry of the same age, so that feedforward and the drift's observer stay outside the loop:
they carry noise into it, and nothing back. In each eigenvector of H, with the symbols of `held_law`,

    s_k = alpha (e_{k-d} - n_k / lambda) + c s_{k-1},    z_{k+1} = z_k - h lambda e_{k-d} + h n_k,
    e_{k+1} = e_k - h (k1 s_k - k_I z_k + v_k + lead (v_k - v_{k-1}) - phi_k),

where n is the noise of eta, and v and phi are what feedforward and observer make of noise alone.

**Delay.** 1 + L(z) z^-d = 0 in each mode, L that of the loop without delay. Where |L| = 1 at one frequency theta only,
the loop is stable up to d theta = pi + arg L there, and unstable from there on (Nyquist). Of the paper's law that is
k1 h lambda < 2 sin(pi / (2 (2 d + 1))). Where its edges have unlike delays up to d, that with lambda_max suffices: a
root z = exp(i theta) has sum w_e cos(theta (d_e + 1/2)) = 0 and sum w_e sin(theta (d_e + 1/2)) = 2 sin(theta / 2), with
w_e = k1 h x* H_e x, of which the first takes theta >= pi / (2 d + 1), and the second then sum w_e at least that limit.

**Noise.** White in time, so P = M P M^T + G U G^T, between each pair of modes: summed up by doubling.

**Loss.** Lost samples are skipped. E[x x^T] goes to E[A x x^T A^T], an operator that is self-adjoint for the paper's
law: its largest eigenvalue, by Lanczos, is within the norm of the residual of the one that is stated. With bursts
(Gilbert and Elliott) it acts on one matrix for each state of the channels, and stays self-adjoint in the measure of the
channels' stationary state. With delay, newton or integral x is more than e, and the operator is not self-adjoint.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebroots
from pydantic import Field
from scipy.linalg import block_diag
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, cg, eigs, eigsh, gmres
from scipy.spatial.transform import Rotation

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.checking.held_law import Loop, UndecidedError, loop_of, residual_polynomial
from mjsheaf.checking.targets import TargetPath
from mjsheaf.control.terms import TermArrays
from mjsheaf.io.section import Finite, Record
from mjsheaf.system import System
from mjsheaf.team import Edge, Team

_MOST_STATES = 900  # of a matrix whose eigenvalues are found
_MOST_WORK = 3e10  # modes times states cubed, of eigenvalues or of covariances
_MOST_SCANNED = 200  # periods of delay that are tried one by one
_CHUNK = 4_000_000  # numbers of covariances at once
_SMALLEST = 1e-12  # of a power of a stable matrix: what it adds to a covariance is lost
_MOST_MOMENTS = 60_000  # numbers in the second moments with bursts
_MOST_BURSTS = 8  # channels with bursts
_MOST_INSTANTS = 200  # along q* at which noise of range and bearing is linearised
_FEW = 40  # second moments whose eigenvalue is found of a dense matrix
_TOLERANCE = 1e-10  # of Lanczos' eigenvalue


class DelayAnswer(Record):
    """The loop with measurements as old as they are, on ideal kinematics."""

    delay: Finite = Field(description="of the oldest measurements, s; null where not known")
    stable: bool | None = Field(description="null where undecided: see reason")
    spectral_radius: Finite = Field(description="of a period, with these delays; null where not computed")
    margin: Finite = Field(
        description="largest delay of all edges alike, in whole periods, with which the loop is stable, s; null where "
        "it is unstable without delay, or undecided"
    )
    reason: str = Field(description="why a number is missing, or empty")


class AgentNoise(Record):
    """What noise alone does to an agent."""

    agent: str
    error: float = Field(description="RMS of |e_i| about its mean, m")
    command: float = Field(description="RMS of the command, m/s")


class NoiseAnswer(Record):
    """The stationary errors that noise and bias of links and of odometry make alone, at samples."""

    mean: Finite = Field(description="|mean of e| of the team, by biases, m; null: see reason")
    error: Finite = Field(description="RMS of |e| of the team about its mean, m; null: see reason")
    command: Finite = Field(description="RMS of the commands of the team, 2-norm, m/s; null: see reason")
    agents: list[AgentNoise] = Field(description="each agent, in order; empty where there is no answer")
    linearised: bool = Field(
        description="noise of range and bearing is linearised along q*, in space in bodies that face along q*: to its "
        "second order, and in space as far as the noise itself does not turn them"
    )
    reason: str = Field(description="why a number is missing, or empty")


class LossAnswer(Record):
    """How fast errors fall in mean square while measurements are lost, a lost one being skipped.

    Where edges do not agree with one another at q*, losses also leave an error, which is not counted.
    """

    stable: bool | None = Field(description="E|e|^2 falls; null where undecided: see reason")
    factor: Finite = Field(description="by which E|e|^2 falls in a period, in the long run")
    accuracy: Finite = Field(description="of the factor: the norm of its eigenvector's residual")
    bound: Finite = Field(
        description="of E|e|^2 in any one period, at most; null where e is not all that the loop remembers"
    )
    rate: Finite = Field(description="at which the root of E|e|^2 decays, 1/s; negative where it grows")
    reason: str = Field(description="why a number is missing, or empty")


class LinkRecord(Record):
    """What links do to the law, on ideal kinematics, within limits of speed."""

    delay: DelayAnswer
    noise: NoiseAnswer | None = Field(description="null where nothing has noise or bias")
    loss: LossAnswer | None = Field(description="null where nothing is lost")

    @property
    def stable(self) -> bool:
        """Whether nothing that is known is unstable."""
        return self.delay.stable is not False and (self.loss is None or self.loss.stable is not False)


# -- edges and their links ---------------------------------------------------------------------------------------------


class MeasuredEdge(NamedTuple):
    """An edge that agents listen to: D q + (what targets add) is measured.

    Attributes:
        slots: states of q that it touches, shape (k,).
        D: shape (m, k).
        K: the inner product, shape (m, m).
        sensing: whether feedforward learns a target's velocity from it.
    """

    slots: IntArray
    D: Array
    K: Array
    sensing: bool

    @property
    def H(self) -> Array:  # noqa: N802 - the paper's symbol
        """Its part of H on its slots, shape (k, k)."""
        return self.D.T @ self.K @ self.D


def measured_edges(team: Team) -> list[MeasuredEdge]:
    """The edges that agents listen to: communication, sensing, anchors, in order."""
    first = dict(zip(team.agent_ids, team.first_state, strict=False))

    def measured(edge: Edge, sensing: bool) -> MeasuredEdge:
        ends = [(id, sign * F) for id, F, sign in ((edge.head, edge.F_head, 1.0), (edge.tail, edge.F_tail, -1.0))]
        own = [(first[id] + np.arange(F.shape[1]), F) for id, F in ends if id in first]
        return MeasuredEdge(np.concatenate([s for s, _ in own]), np.hstack([F for _, F in own]), edge.weight, sensing)

    kinds = ((team.communication, False), (team.sensing, True), (team.anchors, False))
    return [measured(edge, sensing) for edges, sensing in kinds for edge in edges]


@dataclass(frozen=True)
class LinkParameters:
    """The links of E edges, in the order of `measured_edges`.

    Attributes:
        delay: ages of measurements in whole periods, shape (E,).
        noise: covariance of each edge's numbers, shapes (m_e, m_e), m^2.
        bias: of each edge's numbers, shapes (m_e,), m.
        loss: probabilities a sample to turn bad and to turn good, and of loss while good and while bad, shape (E, 4);
            without bursts (0, 1, p, p).
        held: whether a lost sample is replaced by an older one, shape (E,).
        linearised: whether a covariance is that of range and bearing.
    """

    delay: IntArray
    noise: tuple[Array, ...]
    bias: tuple[Array, ...]
    loss: Array
    held: BoolArray
    linearised: bool = False

    @property
    def lossy(self) -> BoolArray:
        """Whether an edge loses measurements, shape (E,)."""
        return np.asarray((self.loss[:, 2:] > 0.0).any(axis=1))


def perfect_links(edges: Sequence[MeasuredEdge]) -> LinkParameters:
    """Links without delay, noise and loss."""
    E, calm = len(edges), np.array([0.0, 1.0, 0.0, 0.0])
    noise = tuple(np.zeros((len(edge.D),) * 2) for edge in edges)
    bias = tuple(np.zeros(len(edge.D)) for edge in edges)
    return LinkParameters(np.zeros(E, dtype=np.int64), noise, bias, np.tile(calm, (E, 1)), np.zeros(E, dtype=np.bool_))


def range_bearing_covariance(y: Array, range_noise: float, bearing_noise: float, body: Array | None = None) -> Array:
    """Covariance of y as measured by range and bearing, linearised, shape (m, m), m^2.

    Args:
        y: the relative position, shape (m,), m; m is 2 or 3.
        range_noise, bearing_noise: standard deviations, m and degrees. In space azimuth and elevation have it each.
        body: rotation from the coordinates of y to those of the body, shape (m, m), about whose last axis azimuth
            turns; None where they are the same.
    """
    turn = np.eye(len(y)) if body is None else body
    seen, spread = turn @ y, np.deg2rad(bearing_noise)
    r, flat = float(np.linalg.norm(seen)), float(np.hypot(*seen[:2]))
    if r == 0.0:
        return np.zeros((len(y),) * 2)  # a range of zero has no direction
    cos, sin = (seen[:2] / flat) if flat > 0.0 else (1.0, 0.0)
    columns = [range_noise * seen / r, spread * flat * np.array([-sin, cos, 0.0][: len(y)])]
    if len(y) == 3:
        columns.append(spread * np.array([-seen[2] * cos, -seen[2] * sin, flat]))
    J = turn.T @ np.stack(columns, axis=1)
    return J @ J.T


def _spread(edges: Sequence[MeasuredEdge], parts: Sequence[Array], n: int) -> Array:
    """The sum of matrices on each edge's slots, shape (n, n)."""
    total = np.zeros((n, n))
    for edge, part in zip(edges, parts, strict=True):
        total[np.ix_(edge.slots, edge.slots)] += part
    return total


# -- the loop in one mode ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DelayedLoop:
    """The loop per eigenvalue of H with measurements d periods old, and how noise enters it.

    The state holds e_k, ..., e_{k-d}, then s and z where the law has them, then what makes feedforward and drift of
    noise; the inputs are the noise of eta, that of B p', what odometry adds to that, and that of odometry.

    Attributes:
        loop: without delay.
        terms: of the law.
        delay: d, in periods.
    """

    loop: Loop
    terms: TermArrays
    delay: int

    @cached_property
    def _names(self) -> list[str]:
        """The states, those of the loop itself first."""
        d, terms = self.delay, self.terms
        names = [f"e{j}" for j in range(d + 1)] + ["s"] * (terms.newton > 0) + ["z"] * (terms.integral > 0.0)
        if terms.feedforward:
            names += ["rate", "v", "sensed", *(f"odometry{j}" for j in range(1, d + 1))]
        return names + ["drift"] * (terms.drift > 0.0)

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array]:
        """M and G of x+ = M x + G u, and rows that give the command of x and u: (L, n, n), (L, n, 4), (L, n + 4)."""
        loop, terms, d, values, names = self.loop, self.terms, self.delay, self.loop.values, self._names
        h, n, L = loop.period, len(names), len(values)

        def unit(name: str) -> Array:
            row = np.zeros((L, n + 4))
            if name in names:
                row[:, names.index(name)] = 1.0
            return row

        def given(i: int) -> Array:
            row = np.zeros((L, n + 4))
            row[:, n + i] = 1.0
            return row

        def each(number: Array) -> Array:
            return number[:, None]

        eta = each(-values) * unit(f"e{d}") + given(0)
        s = each(-loop.alpha / values) * eta + each(loop.c) * unit("s")
        command, new = loop.gain * s - loop.integral * unit("z"), {"s": s, "z": unit("z") + h * eta}
        if terms.feedforward:
            c, lead = residual_polynomial(values, terms.feedforward, *terms.eigenvalues), float(terms.lead[0])
            moved = unit(f"odometry{d}") if d else given(2)
            rate = unit("rate") + terms.measured * ((given(1) - unit("sensed") + moved) / h - unit("rate"))
            v = each(c) * unit("v") + each((1.0 - c) / values) * rate
            command = command + v + lead * (v - unit("v"))
            new |= {"rate": rate, "v": v, "sensed": given(1), "odometry1": given(2)}
            new |= {f"odometry{j}": unit(f"odometry{j - 1}") for j in range(2, d + 1)}
        if terms.drift > 0.0:
            new["drift"] = unit("drift") + terms.drift * (given(3) / h - unit("drift"))
            command = command - new["drift"]
        new |= {"e0": unit("e0") - h * command} | {f"e{j}": unit(f"e{j - 1}") for j in range(1, d + 1)}
        rows = np.stack([new[name] for name in names], axis=1)
        return rows[..., :n], rows[..., n:], command

    @property
    def own(self) -> Array:
        """The matrices of the loop itself, shape (L, n, n)."""
        n = self.delay + 1 + (self.terms.newton > 0) + (self.terms.integral > 0.0)
        return self.matrices[0][:, :n, :n]

    @cached_property
    def radius(self) -> float:
        """The largest spectral radius of the loop itself."""
        return float(np.abs(np.linalg.eigvals(self.own)).max())


def largest_delay(loop: Loop, terms: TermArrays) -> int | None:
    """The largest delay in periods up to which the loop is stable; None where it is unstable without.

    Raises:
        UndecidedError: there is no limit that is known.
    """
    if not loop.radius < 1.0:
        return None
    limits = [_limit(loop, one) for one in range(len(loop.values))]
    if None not in limits:
        return int(np.ceil(min(x for x in limits if x is not None))) - 1
    for d in range(1, _MOST_SCANNED):
        if not DelayedLoop(loop, terms, d).radius < 1.0:
            return d - 1
    raise UndecidedError(f"the loop is stable with any delay up to {_MOST_SCANNED} periods")


def _limit(loop: Loop, one: int) -> float | None:
    """The delay, in periods, with which a mode is no more stable; None where |L| is 1 at several frequencies."""
    h, k, value, alpha, c = loop.period, loop.gain, loop.values[one], loop.alpha[one], loop.c[one]
    below, above = np.array([1.0, -1.0 - c, c]), np.array([0.0, h * k * alpha, 0.0])  # of L, powers of z descending
    if loop.integral > 0.0:
        below = np.convolve(below, [1.0, -1.0])
        above = np.convolve(above[1:], [1.0, -1.0])
        above = np.concatenate([[0.0], above]) + h * h * loop.integral * value * np.array([0.0, 0.0, 1.0, -c])
    square = [np.correlate(p, p, "full")[len(p) - 1 :] for p in (below, above)]
    series = (square[0] - square[1]) * np.concatenate([[1.0], np.full(len(below) - 1, 2.0)])
    roots = chebroots(np.trim_zeros(series, "b"))
    cosines = roots[(np.abs(roots.imag) < 1e-9) & (np.abs(roots.real) < 1.0)].real
    if len(cosines) != 1:
        return None
    theta = float(np.arccos(cosines[0]))
    z = np.exp(1j * theta)
    L = np.polyval(above, z) / np.polyval(below, z)
    return float(((np.angle(L) + np.pi) % (2.0 * np.pi)) / theta)


def team_loop(
    loop: Loop, vectors: Array, edges: Sequence[MeasuredEdge], delay: IntArray, terms: TermArrays, most: int
) -> tuple[Array, Array, Array]:
    """The loop of the whole team with a delay for each edge, in periods: x+ = (M + L C) x, m rows of C for m numbers.

    The states are e_k, e_{k-1}, ..., then s and z where the law has them; C x is D_e e_{k-d} of each edge.

    Raises:
        UndecidedError: it has more than `most` states.
    """
    n, d, h = len(vectors), int(delay.max(initial=0)), loop.period
    newton, integral = terms.newton > 0, terms.integral > 0.0
    if (size := n * (d + 1 + newton + integral)) > most:
        raise UndecidedError(f"with unlike delays, or losses, the loop has {size} states; up to {most} are looked at")
    m, begin = sum(len(edge.D) for edge in edges), 0
    C, pulled = np.zeros((m, size)), np.zeros((n, m))
    for edge, age in zip(edges, delay.tolist(), strict=True):
        rows = slice(begin, begin := begin + len(edge.D))
        C[rows, n * age + edge.slots] = edge.D
        pulled[edge.slots, rows] = edge.D.T @ edge.K
    e, s, z = slice(0, n), slice(n * (d + 1), n * (d + 2)), slice(size - n, size)
    M, L = np.zeros((size, size)), np.zeros((size, m))
    M[n : n * (d + 1), : n * d] = np.eye(n * d)
    M[e, e] += np.eye(n)
    climbed = vectors * (loop.alpha / loop.values) @ vectors.T @ pulled
    L[e] = -h * loop.gain * climbed
    if newton:
        kept = vectors * loop.c @ vectors.T
        M[e, s], M[s, s], L[s] = -h * loop.gain * kept, kept, climbed
    if integral:
        M[e, z], M[z, z], L[z] = h * loop.integral * np.eye(n), np.eye(n), -h * pulled
    return M, L, C


def delay_answer(
    loop: Loop, vectors: Array, edges: Sequence[MeasuredEdge], delay: IntArray, terms: TermArrays
) -> DelayAnswer:
    """The loop with these delays.

    Args:
        loop: without delay; vectors: eigenvectors of H, shape (n, n).
        edges, delay: the edges, and the ages of what they measure, in periods, shape (E,).
        terms: of the law.
    """
    d, h, paper = int(delay.max(initial=0)), loop.period, not (terms.newton or terms.integral)
    found: dict[str, Any] = dict.fromkeys(["stable", "spectral_radius", "margin"])
    reason, limit = "", None
    try:
        limit = largest_delay(loop, terms)
        if limit is None:
            reason = "the loop is unstable without delay"
        else:
            found["margin"] = limit * h
    except UndecidedError as error:
        reason = str(error)
    like = bool((delay == d).all())
    try:
        if like:
            small = len(loop.values) * (d + 3.0) ** 3 <= _MOST_WORK / 25.0 and d + 3 <= _MOST_STATES
            if small:
                found["spectral_radius"] = DelayedLoop(loop, terms, d).radius
                found["stable"] = found["spectral_radius"] < 1.0
            elif not reason and limit is not None:
                found["stable"] = d <= limit
        else:
            if paper and limit is not None and d <= limit:
                found["stable"] = True
            M, L, C = team_loop(loop, vectors, edges, delay, terms, _MOST_STATES)
            found["spectral_radius"] = float(np.abs(np.linalg.eigvals(M + L @ C)).max())
            found["stable"] = found["spectral_radius"] < 1.0
    except UndecidedError as error:
        reason = reason or str(error)
    return DelayAnswer(delay=d * h, reason=reason, **found)


# -- noise -------------------------------------------------------------------------------------------------------------


def noise_answer(
    loop: Loop,
    vectors: Array,
    edges: Sequence[MeasuredEdge],
    links: LinkParameters,
    terms: TermArrays,
    team: Team,
) -> NoiseAnswer:
    """What noise of measurements and odometry does in the long run, nobody being clipped."""
    try:
        error, command = noise_variances(loop, vectors, edges, links, terms)
        mean = mean_error(loop, vectors, edges, links, terms)
    except UndecidedError as why:
        return NoiseAnswer(mean=None, error=None, command=None, agents=[], linearised=links.linearised, reason=str(why))
    first = team.first_state
    each = [np.sqrt(np.add.reduceat(variance, first[:-1])) for variance in (error, command)]
    return NoiseAnswer(
        mean=np.linalg.norm(mean),
        error=np.sqrt(error.sum()),
        command=np.sqrt(command.sum()),
        agents=[
            AgentNoise(agent=id, error=e, command=u)
            for id, e, u in zip(team.agent_ids, each[0].tolist(), each[1].tolist(), strict=True)
        ],
        linearised=links.linearised,
        reason="",
    )


def mean_error(
    loop: Loop, vectors: Array, edges: Sequence[MeasuredEdge], links: LinkParameters, terms: TermArrays
) -> Array:
    """The mean of e that biases make, shape (n,), m: where neither eta nor the command has a mean.

    Raises:
        UndecidedError: measurements with a bias are lost.
    """
    n, biased = len(vectors), any(bias.any() for bias in links.bias)
    if biased and links.lossy.any():
        raise UndecidedError("measurements with a bias are lost")
    eta, sensed = np.zeros(n), np.zeros(n)
    for edge, bias in zip(edges, links.bias, strict=True):
        eta[edge.slots] += edge.D.T @ edge.K @ bias
        sensed[edge.slots] += edge.sensing * terms.bias * edge.H.sum(axis=1)
    added = vectors.T @ sensed / loop.values * (terms.feedforward > 0)
    if terms.drift > 0.0:
        added -= terms.bias * vectors.sum(axis=0)
    if terms.integral > 0.0:
        added[:] = 0.0  # the integral takes it up
    slow = loop.alpha / (1.0 - loop.c) if terms.newton else loop.values  # s of a constant e
    return np.asarray(vectors @ (vectors.T @ eta / loop.values - added / (loop.gain * slow)))


def noise_variances(
    loop: Loop, vectors: Array, edges: Sequence[MeasuredEdge], links: LinkParameters, terms: TermArrays
) -> tuple[Array, Array]:
    """Stationary variances of e, m^2, and of the command, m^2/s^2, of each state of q, shape (n,) each.

    Raises:
        UndecidedError: they are not known, and why.
    """
    n, Q = len(vectors), vectors
    pulled = [e.D.T @ e.K @ noise @ e.K @ e.D for e, noise in zip(edges, links.noise, strict=True)]
    unlike = bool((links.delay != links.delay[:1]).any())
    if links.lossy.any() or unlike:
        if terms.feedforward or terms.drift > 0.0:
            what = "measurements are lost" if links.lossy.any() else "delays are unlike"
            raise UndecidedError(f"{what}, and the law has feedforward or drift")
        return _moments(loop, vectors, edges, links, terms).variances(pulled, edges)
    delayed = DelayedLoop(loop, terms, int(links.delay.max(initial=0)))
    M, G, command = delayed.matrices
    states, inputs = G.shape[1:]
    if n * n * states**3 > _MOST_WORK:
        raise UndecidedError(f"{n} modes of {states} states each have too many covariances")
    if not delayed.radius < 1.0:
        raise UndecidedError("the loop is unstable")
    eta = Q.T @ _spread(edges, pulled, n) @ Q
    rate = Q.T @ _spread(edges, [e.sensing * part for e, part in zip(edges, pulled, strict=True)], n) @ Q
    S = Q.T @ _spread(edges, [e.sensing * e.H for e in edges], n) @ Q
    U = np.zeros((n, n, inputs, inputs))
    U[..., 0, 0], U[..., 1, 1] = eta, rate
    U[..., 0, 1] = U[..., 1, 0] = -rate  # a sensing agent is the tail: -F^T K in eta, F^T K in B p'
    U[..., 2, 2], U[..., 3, 3] = terms.noise**2 * S @ S, terms.noise**2 * np.eye(n)
    U[..., 2, 3] = U[..., 3, 2] = terms.noise**2 * S
    of_state, of_input = command[:, :states], command[:, states:]
    moments = np.zeros((2, n, n))
    step = max(1, _CHUNK // (n * states * states))
    for begin in range(0, n, step):
        rows = slice(begin, begin + step)
        P = _stationary(M[rows], M, np.einsum("aik,abkl,bjl->abij", G[rows], U[rows], G, optimize=True))
        moments[0, rows] = P[..., 0, 0]
        moments[1, rows] = np.einsum("ai,abij,bj->ab", of_state[rows], P, of_state, optimize=True)
        moments[1, rows] += np.einsum("ai,abij,bj->ab", of_input[rows], U[rows], of_input, optimize=True)
    error, asked = np.einsum("ia,cab,ib->ci", Q, moments, Q, optimize=True)
    return np.maximum(error, 0.0), np.maximum(asked, 0.0)


def _stationary(A: Array, B: Array, W: Array) -> Array:
    """P_ab = A_a P_ab B_b^T + W_ab by doubling, for stable A (k, n, n), B (L, n, n) and W (k, L, n, n)."""
    P = W
    while np.abs(A).max() * np.abs(B).max() > _SMALLEST:
        P = P + A[:, None] @ P @ B[None].swapaxes(-1, -2)
        A, B = A @ A, B @ B
    return P


# -- loss --------------------------------------------------------------------------------------------------------------


def loss_answer(
    loop: Loop, vectors: Array, edges: Sequence[MeasuredEdge], links: LinkParameters, terms: TermArrays
) -> LossAnswer:
    """How fast E|e|^2 falls; feedforward and drift do not depend on e, whichever samples they miss."""
    found: dict[str, Any] = dict.fromkeys(["stable", "factor", "accuracy", "bound", "rate"])
    try:
        moments = _moments(loop, vectors, edges, links, terms)
        found["bound"] = moments.bound
        factor, accuracy = found["factor"], found["accuracy"] = moments.factor()
        if abs(factor - 1.0) > accuracy:
            found["stable"] = factor < 1.0
        found["rate"] = -np.log(factor) / (2.0 * loop.period) if factor > 0.0 else None
    except UndecidedError as error:
        return LossAnswer(reason=str(error), **found)
    return LossAnswer(reason="", **found)


def _moments(
    loop: Loop, vectors: Array, edges: Sequence[MeasuredEdge], links: LinkParameters, terms: TermArrays
) -> "SecondMoments | TeamMoments":
    """The second moments of a loop where they are known, and else an UndecidedError."""
    if (links.held & links.lossy).any():
        raise UndecidedError("lost samples are held")
    if terms.newton or terms.integral > 0.0 or (links.delay > 0).any():
        return TeamMoments(loop, vectors, edges, links, terms)
    return SecondMoments(loop, edges, links.loss)


def chances(loss: Array) -> tuple[Array, list[int]]:
    """The probability of loss of each edge whose losses are independent, shape (E,), and the numbers of the others."""
    chance, bursts = np.zeros(len(loss)), []
    for e, (to_bad, to_good, good, bad) in enumerate(loss):
        if good == bad or to_bad == 0.0:
            chance[e] = good
        elif to_good == 0.0:
            chance[e] = bad
        elif to_bad + to_good == 1.0:
            chance[e] = to_good * good + to_bad * bad
        else:
            bursts.append(e)
    return chance, bursts


class TeamMoments:
    """What a period does to E[x x^T], x the states of `team_loop`, lost samples being skipped without bursts.

    With B = M + L (1 - p) C, X -> B X B^T + L (p (1 - p) C X C^T) L^T, the product edge by edge.
    """

    bound = None

    def __init__(
        self, loop: Loop, vectors: Array, edges: Sequence[MeasuredEdge], links: LinkParameters, terms: TermArrays
    ) -> None:
        """Prepare it.

        Raises:
            UndecidedError: it is too large, or there are bursts.
        """
        chance, bursts = chances(links.loss)
        if bursts:
            raise UndecidedError(
                "losses come in bursts, and measurements are delayed or the law has newton or integral"
            )
        M, self._L, self._C = team_loop(loop, vectors, edges, links.delay, terms, int(_MOST_MOMENTS**0.5))
        of = np.repeat(np.arange(len(edges)), [len(edge.D) for edge in edges])
        self._heard = 1.0 - chance[of]
        self._mean = M + self._L * self._heard @ self._C
        self._weight = (of[:, None] == of) * (chance * (1.0 - chance))[of]
        self._period, self._n, self._noise = loop.period, len(vectors), links.noise

    def _within(self, X: Array) -> Array:
        return self._mean @ X @ self._mean.T + self._L @ (self._weight * (self._C @ X @ self._C.T)) @ self._L.T

    def _operator(self, sign: float) -> LinearOperator:
        """X -> the moments a period later, or X less those."""
        shape = self._mean.shape

        def apply(flat: Array) -> Array:
            after = self._within(flat.reshape(shape)).ravel()
            return after if sign > 0.0 else flat.ravel() - after

        return LinearOperator((shape[0] ** 2,) * 2, matvec=apply, dtype=np.float64)

    def factor(self) -> tuple[float, float]:
        """See `SecondMoments.factor`; the operator is not self-adjoint, and a residual no bound."""
        operator, start = self._operator(1.0), np.eye(len(self._mean)).ravel()
        if len(start) <= _FEW:
            values, vectors = np.linalg.eig(operator @ np.eye(len(start)))
        else:
            try:
                values, vectors = eigs(operator, k=1, which="LM", v0=start, tol=_TOLERANCE)
            except ArpackNoConvergence:
                raise UndecidedError("the second moments' eigenvalue did not converge") from None
        largest = int(np.abs(values).argmax())
        value, vector = values[largest], vectors[:, largest]
        after = operator @ vector.real + 1j * (operator @ vector.imag)
        return float(abs(value)), float(np.linalg.norm(after - value * vector))

    def variances(self, pulled: Sequence[Array], edges: Sequence[MeasuredEdge]) -> tuple[Array, Array]:
        """See `SecondMoments.variances`."""
        if not self.factor()[0] < 1.0:
            raise UndecidedError("the loop is unstable")
        added = self._L @ (self._heard[:, None] * block_diag(*self._noise)) @ self._L.T
        flat, failed = gmres(self._operator(-1.0), added.ravel(), rtol=_TOLERANCE, restart=100, maxiter=20)
        if failed:
            raise UndecidedError("the covariance under loss did not converge")
        X, n = flat.reshape(self._mean.shape), self._n
        command = 2.0 * X - self._mean @ X - X @ self._mean.T  # of h u = e_k - e_{k+1}
        return np.diagonal(X)[:n], np.diagonal(command)[:n] / self._period**2


class SecondMoments:
    """What a period does to E[e e^T; state of the channels] under the paper's law, lost samples being skipped.

    In a state in which edge e is lost with probability p_e, with A = I - h k1 sum (1 - p_e) H_e,

        X -> A X A + (h k1)^2 sum p_e (1 - p_e) H_e X H_e,

    after which the channels change their state.
    """

    def __init__(self, loop: Loop, edges: Sequence[MeasuredEdge], loss: Array) -> None:
        """Prepare it for edges and their probabilities (E, 4), see LinkParameters.

        Raises:
            UndecidedError: it is too large, or not self-adjoint.
        """
        n, gain, (chance, bursts) = len(loop.values), loop.period * loop.gain, chances(loss)
        if (loss[bursts, 0] + loss[bursts, 1] > 1.0).any():
            raise UndecidedError("a channel changes its state more often than not")
        if bursts and (len(bursts) > _MOST_BURSTS or n * n * 2 ** len(bursts) > _MOST_MOMENTS):
            raise UndecidedError(f"{len(bursts)} channels with bursts and {n} states have too many second moments")
        states = np.arange(2 ** len(bursts))
        p, root, share = np.tile(chance, (len(states), 1)), np.ones((1, 1)), np.ones(1)
        for place, e in enumerate(bursts):
            to_bad, to_good, good, bad = loss[e]
            p[:, e] = np.where(states >> (len(bursts) - 1 - place) & 1, bad, good)
            across = np.sqrt(to_bad * to_good)
            values, vectors = np.linalg.eigh([[1.0 - to_bad, across], [across, 1.0 - to_good]])
            root = np.kron(root, vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
            share = np.kron(share, np.array([to_good, to_bad]) / (to_good + to_bad))
        self._root, self._n, self._p, self._share = root, n, p, share
        self._period, self._gain = loop.period, gain
        self._mean = np.stack([np.eye(n) - gain * _spread(edges, _scaled(edges, 1.0 - each), n) for each in p])
        self._edges: list[tuple[IntArray, Array, Array]] = []  # alike in size: slots (E, k), H (E, k, k), (S, E)
        for k in {len(edge.slots) for edge in edges}:
            chosen = [e for e, edge in enumerate(edges) if len(edge.slots) == k and (p[:, e] * (1.0 - p[:, e])).any()]
            if chosen:
                slots, H = np.array([edges[e].slots for e in chosen]), np.array([edges[e].H for e in chosen])
                self._edges.append((slots, gain * H, p[:, chosen] * (1.0 - p[:, chosen])))

    def within(self, X: Array) -> Array:
        """What the loop does to X (S, n, n) while the channels keep their state."""
        out = self._mean @ X @ self._mean
        for slots, H, weight in self._edges:
            places: Any = (slice(None), slots[:, :, None], slots[:, None, :])
            np.add.at(out, places, weight[..., None, None] * (H @ X[places] @ H))
        return out

    @property
    def bound(self) -> float:
        """By which E|e|^2 falls in any one period, at most."""
        return float(np.linalg.eigvalsh(self.within(np.tile(np.eye(self._n), (len(self._root), 1, 1)))).max())

    def factor(self) -> tuple[float, float]:
        """By which E|e|^2 falls in the long run, and how far that may be from an eigenvalue.

        Raises:
            UndecidedError: Lanczos did not converge.
        """
        size = len(self._root) * self._n**2
        if size <= _FEW:
            columns = [self._apply(column) for column in np.eye(size)]
            values, vectors = np.linalg.eigh(np.stack(columns, axis=1))
        else:
            start = np.tile(np.eye(self._n), (len(self._root), 1, 1)).ravel()
            try:
                values, vectors = eigsh(self._operator, k=1, which="LA", v0=start, tol=_TOLERANCE)
            except ArpackNoConvergence:
                raise UndecidedError("the second moments' eigenvalue did not converge") from None
        value, vector = float(values[-1]), vectors[:, -1]
        return value, float(np.linalg.norm(self._apply(vector) - value * vector))

    def variances(self, pulled: Sequence[Array], edges: Sequence[MeasuredEdge]) -> tuple[Array, Array]:
        """Stationary variances of e and of the command, shape (n,) each, by noise whose part of eta is `pulled`.

        With shares w of the channels' states and X_s = sqrt(w_s) (R Z)_s, R the root of their symmetric transitions T,
        Z = R (within(R Z) + sqrt(w) V) where V is what a period adds.

        Raises:
            UndecidedError: the loop is unstable, or conjugate gradients did not converge.
        """
        if not self.factor()[0] < 1.0:
            raise UndecidedError("the loop is unstable")
        n, h, root = self._n, self._period, np.sqrt(self._share)[:, None, None]
        added = np.stack([
            _spread(edges, [x * part for x, part in zip(1.0 - each, pulled, strict=True)], n) for each in self._p
        ])  # fmt: skip
        added *= self._gain**2
        right = np.tensordot(self._root, root * added, 1).ravel()
        shape = self._operator.shape
        less = LinearOperator(shape, matvec=lambda flat: flat - self._apply(flat), dtype=np.float64)
        Z, failed = cg(less, right, rtol=_TOLERANCE, maxiter=10 * _MOST_SCANNED)
        if failed:
            raise UndecidedError("the covariance under loss did not converge")
        X = root * np.tensordot(self._root, Z.reshape(-1, n, n), 1)
        weighted = self._share[:, None, None] * added
        command = self.within(X) + X - self._mean @ X - X @ self._mean + weighted
        return tuple(np.diagonal(x, axis1=1, axis2=2).sum(axis=0) for x in (X, command / h**2))

    @property
    def _operator(self) -> LinearOperator:
        size = len(self._root) * self._n**2
        return LinearOperator((size, size), matvec=self._apply, dtype=np.float64)

    def _apply(self, flat: Array) -> Array:
        X = np.tensordot(self._root, flat.reshape(-1, self._n, self._n), 1)
        return np.asarray(np.tensordot(self._root, self.within(X), 1)).ravel()


def _scaled(edges: Sequence[MeasuredEdge], scale: Array) -> list[Array]:
    """H_e times a number for each edge."""
    return [x * edge.H for x, edge in zip(scale, edges, strict=True)]


# -- all together ------------------------------------------------------------------------------------------------------


def links_of(system: System, path: TargetPath) -> LinkParameters:
    """The links of a system; noise of range and bearing is the mean of its linearisations along q*.

    Raises:
        UndecidedError: bodies at q* are beyond a link's range at times.
    """
    team, table, of, law = system.team, system.law.links.table, system.law.links.of, system.law.edges
    edges, C = measured_edges(team), len(team.communication) + len(team.sensing)
    links = perfect_links(edges)
    noise, bias, N = list(links.noise), list(links.bias), len(team.agents)
    stride = max(1, len(path.time) // _MOST_INSTANTS)
    x = path.positions[::stride].copy()
    x[:, :N] = team.unpack(path.q_star[::stride])
    lifted = x + system.law.links.lift[None, :, None] * np.array([0.0, 0.0, 1.0]) if len(of) else x
    for e in range(C if len(of) else 0):
        if of[e] < 0:
            continue
        link, m = table[of[e]], len(edges[e].D)
        tail, head = law.tail[e], law.head[e]
        if np.linalg.norm(lifted[:, head] - lifted[:, tail], axis=1).max() > link["range"]:
            raise UndecidedError(f"{team.members[tail].id} and {team.members[head].id} at q* are beyond range at times")
        links.delay[e] = link["delay"]
        links.held[e] = link["hold"] > 0
        if link["lossy"]:
            links.loss[e] = [link[name] for name in ("to_bad", "to_good", "loss_good", "loss_bad")]
        bias[e] = np.full(m, link["bias"])
        noise[e] = link["noise"] ** 2 * np.eye(m)
        if link["bearing"]:
            rows = slice(law.first[e], law.first[e + 1])
            y = x[:, head] @ law.F_head[rows].T - x[:, tail] @ law.F_tail[rows].T
            spread, angle = float(link["range_noise"]), float(np.rad2deg(link["bearing_noise"]))
            turns = [None] * len(y) if m == 2 else _facing(x[:, tail], system, tail) @ law.F_tail[rows].T
            each = [range_bearing_covariance(*pair) for pair in zip(y, repeat(spread), repeat(angle), turns)]
            noise[e] = np.mean(each, axis=0)
    return replace(links, noise=tuple(noise), bias=tuple(bias), linearised=bool(table["bearing"].any()))


def _facing(x: Array, system: System, v: int) -> Array:
    """Rotations from the world to a body that faces where it moves along x (T, 3), its second axis level."""
    motion = np.diff(x, axis=0, append=x[-1:])
    if len(x) > 1:
        motion[-1] = motion[-2]
    yaw, level = np.arctan2(motion[:, 1], motion[:, 0]), np.hypot(motion[:, 0], motion[:, 1])
    pitch = -np.arctan2(motion[:, 2], level)
    still = ~motion.any(axis=1)
    yaw[still], pitch[still] = system.bodies.heading[v], 0.0
    turns = Rotation.from_euler("ZY", np.column_stack([yaw, pitch]))
    return np.asarray(turns.inv().as_matrix())


def link_answers(system: System, path: TargetPath) -> LinkRecord | None:
    """What links do to the law of a system, and how much delay it bears; None where links are exact and that unknown.

    Args:
        system: the system.
        path: of its targets.
    """
    try:
        return answers_for(system, loop_of(system), links_of(system, path))
    except UndecidedError as error:
        numbers: dict[str, Any] = dict.fromkeys(["delay", "stable", "spectral_radius", "margin"])
        unknown = LinkRecord(delay=DelayAnswer(reason=str(error), **numbers), noise=None, loss=None)
        return unknown if len(system.law.links.table) else None


def answers_for(system: System, loop: Loop, links: LinkParameters) -> LinkRecord:
    """What links in the order of `measured_edges` do to a loop."""
    terms, edges, vectors = system.law.terms, measured_edges(system.team), system.team.dirichlet.eigenvectors[1]
    noisy = terms.noise > 0.0 or terms.bias != 0.0 or any(x.any() for x in (*links.noise, *links.bias))
    return LinkRecord(
        delay=delay_answer(loop, vectors, edges, links.delay, terms),
        noise=noise_answer(loop, vectors, edges, links, terms, system.team) if noisy else None,
        loss=loss_answer(loop, vectors, edges, links, terms) if links.lossy.any() else None,
    )
