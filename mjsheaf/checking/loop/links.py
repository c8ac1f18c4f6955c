"""A law over its links, linear about q*: the measurements of edges, and the effects of delay, noise and loss.

The module is about the held law on ideal kinematics, within speed limits, while bodies are within range of one another,
and without the slope of the flow. Results are exact or null, except for estimates that are marked by `linearised` and
`accuracy`.

Range and bearing have an error along the line of sight and one across it. In space azimuth and elevation have the noise
s each, in a body frame that faces along the last displacement of the tail. With b the third axis of that frame, r the
range and l the line of sight, azimuth moves the measured point by s r |l x b| along b x l, and elevation by s r across
both. The covariance is at most that with |l x b| = 1, s^2 r^2 (1 - l l^T), which depends on no frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import sparse
from scipy.linalg import schur
from scipy.sparse.linalg import ArpackError, LinearOperator, cg, eigs, eigsh, gmres

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.checking.loop.held_law import Loop, common_delay, eigen_of, largest_gain, loop_of, stationary
from mjsheaf.checking.loop.linear_law import model_of, require_model
from mjsheaf.checking.spectrum import DENSE_STATES, held_eigenvalues, spectrum_of
from mjsheaf.checking.theorem.targets import TargetPath
from mjsheaf.errors import UndecidedError
from mjsheaf.law.terms import TermArrays
from mjsheaf.loop.system import System
from mjsheaf.section import OF_TEAM, PER_AGENT_RMS, TEAM_NORM, Finite, Norm, Record, per_agent
from mjsheaf.team import Edge, Team
from mjsheaf.team.links import KINDS


class MeasuredEdge(NamedTuple):
    """An edge at which agents measure: D q + a part that depends on targets.

    Attributes:
        slots: Indices of the states of q that it depends on, shape (k,).
        D: Map from these states to the measurement, shape (m, k).
        K: Inner product, shape (m, m); for an edge that does not fit at q*, the derivative of its pull.
        kind: 'communication', 'sensing' or 'anchor'.
        z: Relative position of an edge that does not fit, which D then measures, shape (m,), m; None otherwise.
    """

    slots: IntArray
    D: Array
    K: Array
    kind: str
    z: Array | None = None

    @property
    def linked(self) -> bool:
        """Return True if it has a link; anchors measure at once, without error."""
        return self.kind != "anchor"


def measured_edges(team: Team) -> list[MeasuredEdge]:
    """Return the edges at which agents measure: communication, sensing, anchors, in order."""
    first = dict(zip(team.agent_ids, team.first_state, strict=False))

    def measured(edge: Edge, kind: str) -> MeasuredEdge:
        F_tail, F_head, K, z = edge.slope or (edge.F_tail, edge.F_head, edge.weight, None)
        ends = [(id, sign * F) for id, F, sign in ((edge.head, F_head, 1.0), (edge.tail, F_tail, -1.0))]
        own = [(first[id] + np.arange(F.shape[1]), F) for id, F in ends if id in first]
        return MeasuredEdge(np.concatenate([s for s, _ in own]), np.hstack([F for _, F in own]), K, kind, z)

    kinds = (("communication", team.communication), ("sensing", team.sensing), ("anchor", team.anchors))
    return [measured(edge, kind) for kind, edges in kinds for edge in edges]


@dataclass(frozen=True)
class LinkParameters:
    """The links of E edges, in the order of `measured_edges`.

    Attributes:
        delay: Ages of measurements in whole periods, shape (E,).
        noise: Covariance of each edge's numbers, shapes (m_e, m_e), m^2.
        bias: Bias of each edge's numbers, shapes (m_e,), m.
        loss: Probabilities per sample to turn bad and to turn good, and of a loss while good and while bad, shape
            (E, 4); without bursts (0, 1, p, p).
        held: True for edges that replace a lost sample by an older one, shape (E,).
        linearised: True if a covariance is that of range and bearing, linearised.
        ranged: True if a link receives nothing beyond some range.
    """

    delay: IntArray
    noise: tuple[Array, ...]
    bias: tuple[Array, ...]
    loss: Array
    held: BoolArray
    linearised: bool = False
    ranged: bool = False

    @property
    def lossy(self) -> BoolArray:
        """True for each edge that loses measurements, shape (E,)."""
        return np.asarray((self.loss[:, 2:] > 0.0).any(axis=1))

    @property
    def noisy(self) -> bool:
        """Return True if an edge has noise or bias."""
        return any(x.any() for x in (*self.noise, *self.bias))

    @property
    def exact(self) -> bool:
        """Return True if everything is measured at once, without error."""
        return not (self.lossy.any() or self.delay.any() or self.noisy or self.ranged)

    @property
    def delivered(self) -> Array:
        """Fraction of each edge's measurements that arrive in the long run, shape (E,)."""
        to_bad, to_good, good, bad = self.loss.T
        total = to_bad + to_good
        share = np.where(total > 0.0, to_bad / np.where(total > 0.0, total, 1.0), 0.0)
        return np.asarray(1.0 - share * bad - (1.0 - share) * good)


def perfect_links(edges: Sequence[MeasuredEdge]) -> LinkParameters:
    """Return links without delay, noise and loss."""
    E = len(edges)
    noise = tuple(np.zeros((len(edge.D),) * 2) for edge in edges)
    bias = tuple(np.zeros(len(edge.D)) for edge in edges)
    return LinkParameters(
        np.zeros(E, dtype=np.int64), noise, bias, np.tile([0.0, 1.0, 0.0, 0.0], (E, 1)), np.zeros(E, dtype=np.bool_)
    )


@dataclass(frozen=True)
class LinkedLaw:
    """A law over its links, linear about q*, on ideal kinematics.

    Attributes:
        loop: Loop of the law as if its links were exact.
        vectors: Eigenvectors of H in the order of the loop's L eigenvalues, shape (n, L); of a free team L < n.
        edges: Edges at which agents measure.
        links: Their links.
        terms: Terms of the law.
    """

    loop: Loop
    vectors: Array
    edges: list[MeasuredEdge]
    links: LinkParameters
    terms: TermArrays

    @property
    def linked(self) -> BoolArray:
        """True for each edge that has a link, shape (E,)."""
        return np.array([edge.linked for edge in self.edges])

    @cached_property
    def numbers(self) -> tuple[Array, Array, IntArray]:
        """The m numbers of all edges: D, shape (m, n), D^T K, shape (n, m), and the edge of each, shape (m,)."""
        of = np.repeat(np.arange(len(self.edges)), np.array([len(edge.D) for edge in self.edges], dtype=np.int64))
        D = np.zeros((len(of), len(self.vectors)))
        pull = np.zeros(D.T.shape)
        for e, edge in enumerate(self.edges):
            D[np.ix_(of == e, edge.slots)] = edge.D
            pull[np.ix_(edge.slots, of == e)] = edge.D.T @ edge.K
        return D, pull, of

    @property
    def sensed_pull(self) -> Array:
        """D^T K of the edges from which feedforward computes velocities, 0 for the others, shape (n, m)."""
        _, pull, of = self.numbers
        return pull * np.array([edge.kind == "sensing" for edge in self.edges])[of]


def links_of(
    system: System,
    path: TargetPath,
    *,
    instants: int = 200,  # along q* at which noise of range and bearing is linearised
) -> LinkParameters:
    """Return the links of a system; noise of range and bearing is the mean of its linearisations along q*.

    Raises:
        UndecidedError: Bodies are beyond a link's range at the start, or at times at q*.
    """
    team = system.team
    table = system.law.links.table
    of = system.law.links.of
    edges = measured_edges(team)
    links = perfect_links(edges)
    if not len(table):
        return links
    noise = list(links.noise)
    bias = list(links.bias)
    x = path.positions.copy()
    x[:, : len(team.agents)] = team.unpack(path.q_star)
    everywhere = np.concatenate([system.initial[None], x]) + system.law.links.lift[None, :, None] * [0.0, 0.0, 1.0]
    few = slice(None, None, max(1, len(x) // instants))
    for e in [e for e, edge in enumerate(edges) if edge.linked and of[e] >= 0]:
        link = table[of[e]]
        tail, head = system.law.edges.tail[e], system.law.edges.head[e]
        apart = np.linalg.norm(everywhere[:, head] - everywhere[:, tail], axis=1)
        if apart.max() > link["range"]:
            when = "at the start" if apart[0] > link["range"] else "at q* at times"
            raise UndecidedError(f"{team.members[tail].id} and {team.members[head].id} are beyond range {when}")
        links.delay[e] = link["delay"]
        links.held[e] = link["hold"] > 0
        if link["lossy"]:
            links.loss[e] = link[["to_bad", "to_good", "loss_good", "loss_bad"]].tolist()
        m = len(edges[e].D)
        bias[e] = np.full(m, link["bias"])
        noise[e] = link["noise"] ** 2 * np.eye(m)
        if (z := edges[e].z) is not None:  # the error of a range is along z, that of a bearing turns z
            ranged = team.measuring_edges[e].F_tail.shape[0] == 1 and m > 1
            bias[e] = link["bias"] * z / np.linalg.norm(z)
            noise[e] = link["noise"] ** 2 * range_bearing_covariance(z[None], float(ranged), float(not ranged))
        if link["bearing"]:
            law = system.law.edges
            rows = slice(law.first[e], law.first[e + 1])
            y = x[few][:, head] @ law.F_head[rows].T - x[few][:, tail] @ law.F_tail[rows].T
            noise[e] = range_bearing_covariance(y, float(link["range_noise"]), float(link["bearing_noise"]))
    return replace(
        links,
        noise=tuple(noise),
        bias=tuple(bias),
        linearised=bool(table["bearing"].any()),
        ranged=bool(np.isfinite(table["range"]).any()),
    )


def range_bearing_covariance(y: Array, range_noise: float, bearing_noise: float) -> Array:
    """Return the mean covariance of y as measured by range and bearing, linearised, shape (m, m), m^2.

    In the plane it is exact to first order; in space it is an upper bound of the covariance.

    Args:
        y: Relative positions, shape (T, m), m; m is 2 or 3.
        range_noise, bearing_noise: Standard deviations, m and rad; in space, that of azimuth and of elevation.
    """
    square = (y**2).sum(axis=1)[:, None, None]
    outer = y[:, :, None] * y[:, None]
    along = outer / np.where(square > 0.0, square, 1.0)  # a range of zero has no direction
    across = square * np.eye(y.shape[1]) - outer
    return np.asarray((range_noise**2 * along + bearing_noise**2 * across).mean(axis=0))


# -- delayed measurements ----------------------------------------------------------------------------------------------
#
# For the paper's law with one delay of d periods the condition is k1 h lambda < 2 sin(pi / (2 (2 d + 1))). For other
# laws, one number of periods after the other is tried.
#
# If the edges of the paper's law have different delays up to d, the condition at lambda_max suffices. A root
# z = exp(i theta) of the team's loop, with vector x and w_e = k1 h x* H_e x >= 0, satisfies
# sum w_e cos(theta (d_e + 1/2)) = 0 and sum w_e sin(theta (d_e + 1/2)) = 2 sin(theta / 2). The first equation requires
# theta >= pi / (2 d + 1), so the second gives sum w_e >= 2 sin(pi / (2 (2 d + 1))). But sum w_e <= k1 h lambda_max. So
# no root crosses the circle as the gain rises from a small value. There the loop is stable.

MOST_STATES = 900  # of a matrix whose eigenvalues are found
MOST_WORK = 3e10  # modes times states cubed, of eigenvalues or of covariances
_ROUNDING = 1e-9  # of a spectral radius: closer to 1 nothing is decided


class DelayAnswer(Record):
    """The loop with the delays of its links, if no measurement is lost."""

    delay: Finite = Field(None, description="delay of the oldest measurements, s; null if not known")
    stable: bool | None = Field(None, description="null if undecided: see reason")
    spectral_radius: Finite = Field(None, description="spectral radius over a period, with these delays; or null")
    margin: Finite = Field(
        None,
        description="largest common delay of all links, in whole periods, up to which the loop is stable, s; null if "
        "it is unstable without delay, or undecided",
    )
    largest_gain: Finite = Field(
        None,
        description="gain above which the law is unstable with these delays if nothing is lost, 1/s; null if a term "
        "changes it, edges have different delays, or it is unstable at any gain",
    )
    reason: str = Field(description="why a number is missing, or empty")


def team_loop(law: LinkedLaw, delay: IntArray, most: int = MOST_STATES) -> tuple[Array, Array, Array]:
    """Return M, L and C of the whole team's loop x+ = (M + L C) x with a delay for each edge, in periods.

    The states are e_k, e_{k-1}, ..., then those of the law in eigenvectors of H. The m rows of C x are D_e e_{k-d} of
    the edges. For a team that is free to move, e is also in eigenvectors of H, without those of zero eigenvalues.

    Raises:
        UndecidedError: It has more than `most` states.
    """
    vectors, h = law.vectors, law.loop.period
    feedback, values = law.loop.feedback, law.loop.values
    n, r, d = vectors.shape[1], feedback.C.shape[1], int(delay.max(initial=0))
    if (size := n * (d + 1 + r)) > most:
        raise UndecidedError(f"with unlike delays, or losses, the loop has {size} states; up to {most} are looked at")
    Q = vectors if n < len(vectors) else np.eye(n)
    D, pull, of = law.numbers
    C = np.zeros((len(of), d + 1 + r, n))
    C[range(len(of)), delay[of]] = D @ Q
    M, L = np.zeros((size, size)), np.zeros((size, len(of)))
    M[n : n * (d + 1), : n * d] = np.eye(n * d)
    M[:n, :n] += np.eye(n)
    if law.loop.is_papers:
        L[:n] = -h * law.loop.gain * Q.T @ pull
    else:  # in an eigenvector of H, where e has eta = lambda e
        on_eta = replace(feedback, B=feedback.B / values[:, None, None], D=feedback.D / values[:, None])
        filters = on_eta.of_team(vectors)
        M[:n, n * (d + 1) :] = h * Q.T @ filters.C
        M[n * (d + 1) :, n * (d + 1) :] = filters.A
        L[:n] = h * Q.T @ filters.D @ pull
        L[n * (d + 1) :] = filters.B @ pull
    return M, L, C.reshape(len(of), size)


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
    """Return True if a spectral radius is stable; None if it is too close to 1."""
    return None if abs(radius - 1.0) < _ROUNDING else radius < 1.0


def limit_from_eigenvalues(values: NDArray[Any], product: float) -> int:
    """Return the largest delay, in periods, up to which the paper's held law is stable; it must be stable without.

    A root z = exp(i theta) of z^m (z - 1) + k1 h lambda has 2 sin(theta / 2) = k1 h |lambda| and
    theta (m + 1/2) = pi / 2 - |arg lambda|. The first such m of all eigenvalues is the limit.

    Args:
        values: Eigenvalues of H, real parts above zero, shape (L,).
        product: k1 h.
    """
    theta = 2.0 * np.arcsin(np.minimum(0.5 * product * np.abs(values), 1.0))
    limit = float(((0.5 * np.pi - np.abs(np.angle(values))) / theta).min()) - 0.5
    return int(np.ceil(limit - _ROUNDING)) - 1


def largest_delay(
    loop: Loop,
    linked: BoolArray,
    radius_of: Callable[[IntArray], float],
    *,
    most: int = 200,
) -> int | None:
    """Return the largest delay of all links, in periods, up to which a loop is stable; None if unstable without delay.

    Args:
        loop: Loop of the law.
        linked: True for each edge that has a link, shape (E,); the others have no delay.
        radius_of: Spectral radius with a delay for each edge, in periods.
        most: Periods of delay that are tried one by one.

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
    for d in range(known + 1, most):
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
        # With different delays, the limit is only a sufficient condition, for the paper's law and a symmetric H.
        known = loop.is_papers and not np.iscomplexobj(loop.values) and loop.radius < 1.0 - _ROUNDING
        stable = True if known and d <= limit_from_eigenvalues(loop.values, loop.gain * loop.period) else None
        if limit is not None and (delay == d).all():
            stable = d <= limit
        reason = reason or (str(error) if stable is None else "")
    return DelayAnswer(
        delay=d * loop.period,
        stable=stable,
        spectral_radius=radius,
        margin=None if limit is None else limit * loop.period,
        reason=reason,
    )


# -- losses ------------------------------------------------------------------------------------------------------------
#
# Second moments of a law over its links: the decay rate while measurements are lost, and the errors that noise makes.
#
# A lost measurement is skipped. E[x x^T] goes to E[A x x^T A^T], a linear operator T on matrices that maps positive
# semidefinite ones to positive semidefinite ones, so its spectral radius is an eigenvalue. For the paper's law without
# delay, where x is e, T is self-adjoint, and the error of its largest eigenvalue, computed by Lanczos, is at most the
# norm of the residual. With delay, newton or integral, x is more than e, and T is not self-adjoint; the eigenvalue may
# be multiple, and its eigenvector badly conditioned. The verdict then rests on X - T(X) = I, because T preserves the
# cone of positive semidefinite matrices:
#
# - If a solution has X > 0, then T(X) = X - I <= (1 - 1 / lambda_max(X)) X, so that the spectral radius is below 1.
# - If the spectral radius is below 1, then X = I + T(I) + T(T(I)) + ... > 0. So a solution with a negative eigenvalue
#   shows that it is not.
#
# Both hold for any positive definite right side, and so for that of the computed X, X - T(X), which is close to I.
#
# Feedforward and drift do not depend on e, whichever samples are lost. With losses in bursts (Gilbert and Elliott)
# the rate is undecided.

_FEW = 40  # largest number of second moments for which a dense matrix is used
_TOLERANCE = 1e-10  # of eigenvalues and of covariances, relative


class LossAnswer(Record):
    """Decay rate of the mean square error under packet loss; the law skips lost measurements.

    If edges disagree at q*, or if e does not converge to zero, each loss moves agents. The resulting errors are not
    included.
    """

    stable: bool | None = Field(None, description="E|e|^2 decays; null if undecided: see reason")
    factor: Finite = Field(None, description="factor of E|e|^2 over a period, in the long run")
    accuracy: Finite = Field(
        None,
        description="norm of the residual of the factor's eigenvector: an error bound of the factor for the paper's "
        "law without delay, else an estimate",
    )
    bound: Finite = Field(
        None, description="largest factor of E|e|^2 over any one period; null if the loop has states besides e"
    )
    rate: Finite = Field(None, description="decay rate of the root of E|e|^2, 1/s; negative if it grows")
    reason: str = Field(description="why a number is missing, or empty")


def loss_answer(law: LinkedLaw) -> LossAnswer:
    """Compute the decay rate of E|e|^2."""
    found: dict[str, Any] = {}
    try:
        moments = SecondMoments(law)
        found["bound"] = moments.bound
        factor, accuracy = found["factor"], found["accuracy"] = moments.factor
        found["stable"] = factor < 1.0 if abs(factor - 1.0) > max(accuracy, _ROUNDING) else moments.stable
        found["rate"] = -np.log(factor) / (2.0 * law.loop.period) if factor > 0.0 else None
    except UndecidedError as error:
        return LossAnswer(reason=str(error), **found)
    return LossAnswer(reason="the factor is too close to 1" if found["stable"] is None else "", **found)


class SecondMoments:
    """Map of the second moments of the states x of `team_loop`, x+ = (M + L C) x, over a period, under losses.

    If the numbers of edges arrive with probabilities r, and B = M + L r C, it is

        X -> B X B^T + L (r (1 - r) C X C^T) L^T, with only the diagonal block of each edge in C X C^T.
    """

    def __init__(
        self,
        law: LinkedLaw,
        *,
        most: int = 60_000,  # numbers in the second moments with delay, newton or integral
    ) -> None:
        """Compute the matrices of the map.

        Raises:
            UndecidedError: Lost samples are held, losses come in bursts, or the loop is too large.
        """
        links = law.links
        if (links.held & links.lossy).any():
            raise UndecidedError("lost samples are held")
        to_bad, to_good, good, bad = links.loss.T
        memoryless = (good == bad) | (to_bad == 0.0) | (to_good == 0.0) | (to_bad + to_good == 1.0)
        if not memoryless.all():
            raise UndecidedError("undecided with bursts")
        p = 1.0 - links.delivered
        self._symmetric = law.loop.is_papers and not links.delay.any()
        M, L, C = team_loop(law, links.delay, MOST_STATES if self._symmetric else int(most**0.5))
        of = law.numbers[2]
        self._arrives = (1.0 - p)[of]
        self._mean = M + L * self._arrives @ C
        self._law = law
        self._L = L
        self._around = sparse.csr_array(C)
        self._back = sparse.csr_array(L)
        rows = sparse.csr_array((np.ones(len(of)), (np.arange(len(of)), of)), shape=(len(of), len(p)))
        self._pairs = sparse.coo_array(rows @ rows.T).coords  # rows and columns of the numbers of each edge
        self._others = self._around[self._pairs[1]]
        self._variance = (p * (1.0 - p))[of[self._pairs[0]]]

    def _apply(self, X: Array) -> Array:
        """Return the moments a period after X, shape (n, n)."""
        seen = self._others.multiply((self._around @ X)[self._pairs[0]]).sum(axis=1)
        lost = sparse.csr_array((self._variance * seen, self._pairs), shape=(len(self._arrives),) * 2)
        return np.asarray(self._mean @ X @ self._mean.T + (self._back @ lost @ self._back.T).toarray())

    @property
    def bound(self) -> float | None:
        """Return the largest factor of E|e|^2 over any one period; None if the loop has states besides e."""
        return float(np.linalg.eigvalsh(self._apply(np.eye(len(self._mean)))).max()) if self._symmetric else None

    def covariances(self) -> Array:
        """Compute stationary covariances of e, m^2, and the command, m^2/s^2, due to noise of links, shape (2, n, n).

        Raises:
            UndecidedError: The loop is unstable, or the iteration did not converge.
        """
        if not self.factor[0] < 1.0:
            raise UndecidedError("the loop is unstable")
        noise = sparse.block_diag(self._law.links.noise)
        X = self._solve((self._back @ (sparse.diags_array(self._arrives) @ noise) @ self._back.T).toarray())
        command = 2.0 * (X - self._mean @ X)  # of h u = e_k - e_{k+1}
        vectors = self._law.vectors
        n = vectors.shape[1]
        error, asked = X[:n, :n], command[:n, :n]
        if n < len(vectors):  # a team that is free to move: from the coordinates of `team_loop`
            error, asked = (vectors @ x @ vectors.T for x in (error, asked))
        return np.stack([error, 0.5 * (asked + asked.T) / self._law.loop.period**2])

    def _operator(self, *, less: bool = False) -> LinearOperator:
        """Return the map from X to the moments a period later, or to X minus these if `less`, on flat vectors."""

        def apply(flat: Array) -> Array:
            after = self._apply(flat.reshape(self._mean.shape)).ravel()
            return flat.ravel() - after if less else after

        return LinearOperator((self._mean.size,) * 2, matvec=apply, dtype=np.float64)

    @cached_property
    def factor(self) -> tuple[float, float]:
        """Return the factor of E|e|^2 over a period in the long run, and the norm of its eigenvector's residual.

        Raises:
            UndecidedError: The iteration did not converge.
        """
        operator = self._operator()
        start = np.eye(len(self._mean)).ravel()
        if len(start) <= _FEW:
            # The Schur form needs no balancing, which would make multiple eigenvalues inaccurate.
            matrix = operator @ np.eye(len(start))
            value = float(np.abs(np.diagonal(schur(matrix, output="complex")[0])).max())
            return value, float(np.linalg.svd(matrix - value * np.eye(len(start)), compute_uv=False)[-1])
        try:
            lanczos = {"A": operator, "k": 1, "v0": start, "tol": _TOLERANCE}
            values, vectors = eigsh(**lanczos, which="LA") if self._symmetric else eigs(**lanczos, which="LM")
        except ArpackError:
            raise UndecidedError("the second moments' eigenvalue did not converge") from None
        value, vector = values[0], vectors[:, 0]
        after = operator @ vector.real + 1j * (operator @ vector.imag)
        return float(abs(value)), float(np.linalg.norm(after - value * vector))

    @cached_property
    def stable(self) -> bool | None:
        """Return True if E|e|^2 decays, by the solution of X - T(X) = I (see the module); None if rounding decides.

        Raises:
            UndecidedError: The iteration did not converge.
        """
        X = self._solve(np.eye(len(self._mean)))
        smallest, size = float(np.linalg.eigvalsh(X).min()), float(np.abs(X).max())
        known = np.linalg.eigvalsh(X - self._apply(X)).min() > 0.5 and abs(smallest) >= _ROUNDING * size
        return smallest > 0.0 if known else None

    def _solve(self, added: Array) -> Array:
        """Solve X - T(X) = added for symmetric matrices, shape (n, n)."""
        less, right = self._operator(less=True), added.ravel()
        solve = partial(cg, maxiter=2000) if self._symmetric else partial(gmres, restart=100, maxiter=20)
        found, failed = solve(less, right, rtol=_TOLERANCE)
        if failed:
            raise UndecidedError("the covariance under loss did not converge")
        X = found.reshape(self._mean.shape)
        return np.asarray(0.5 * (X + X.T))


# -- noise of links and of odometry ------------------------------------------------------------------------------------
#
# Noise is white in time, so the covariance of the states satisfies P = M P M^T + G U G^T, for each pair of modes of
# `Loop.with_noise`; it is solved by doubling. With different delays or losses, it is that of the whole team's loop.

_CHUNK = 4_000_000  # numbers of covariances computed at once


class AgentNoise(Record):
    """Effect of noise alone on an agent."""

    agent: str
    error: float = Field(description="RMS in time of |e_i| about its mean, m")
    norm: Norm = Field(PER_AGENT_RMS, description="which norm `error` is: of this agent alone")
    command: float = Field(description="RMS of the command, m/s")


class NoiseAnswer(Record):
    """Stationary errors at samples due to noise and bias of links and odometry.

    They add to those of targets' motion, flow and losses: means to means, and squares of the RMS to squares.
    """

    mean: Finite = Field(None, description="|mean of e| of the team, due to biases, m; null: see reason")
    error: Finite = Field(None, description="RMS in time of |e| of the team about its mean, m; null: see reason")
    mean_per_agent: Finite = Field(None, description="`mean` as RMS over agents, mean / sqrt(N), m")
    error_per_agent: Finite = Field(None, description="`error` as RMS over agents, error / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    command: Finite = Field(None, description="RMS of the commands of the team, 2-norm, m/s; null: see reason")
    agents: list[AgentNoise] = Field(description="each agent, in order; empty without a result")
    linearised: bool = Field(
        description="noise of range and bearing is linearised along q*; in space the result is then an upper estimate, "
        "by 1 % if lines of sight are level in the bodies' frames, by a factor sqrt(2) at most"
    )
    reason: str = Field(description="why a number is missing, or empty")


def noise_answer(law: LinkedLaw, team: Team) -> NoiseAnswer:
    """Compute the effect of noise of measurements and odometry in the long run, without saturation."""
    try:
        mean = mean_error(law)
        error, command = map(np.diagonal, noise_covariances(law))
    except UndecidedError as why:
        return NoiseAnswer(agents=[], linearised=law.links.linearised, reason=str(why))
    error, command = np.maximum(error, 0.0), np.maximum(command, 0.0)
    each = np.sqrt(np.add.reduceat([error, command], team.first_state[:-1], axis=1))
    offset, size, agents = float(np.linalg.norm(mean)), float(np.sqrt(error.sum())), len(team.agents)
    return NoiseAnswer(
        mean=offset,
        error=size,
        mean_per_agent=per_agent(offset, agents),
        error_per_agent=per_agent(size, agents),
        command=np.sqrt(command.sum()),
        agents=[
            AgentNoise(agent=id, error=e, command=u) for id, (e, u) in zip(team.agent_ids, each.T.tolist(), strict=True)
        ],
        linearised=law.links.linearised,
        reason="",
    )


def mean_error(law: LinkedLaw) -> Array:
    """Compute the mean of e due to biases, shape (n,), m: then neither eta nor the command has a mean.

    Raises:
        UndecidedError: Measurements with a bias are lost.
    """
    vectors, links, terms = law.vectors, law.links, law.terms
    if links.lossy.any() and any(bias.any() for bias in links.bias):
        raise UndecidedError("measurements with a bias are lost")
    D, pull, _ = law.numbers
    eta = pull @ np.concatenate([np.zeros(0), *links.bias])
    own_motion = np.full(len(vectors), terms.bias * law.loop.period)
    sensed_motion = law.sensed_pull @ D @ own_motion
    M, G, _ = law.loop.with_noise(0)
    inputs = np.stack([eta, 0.0 * eta, sensed_motion, own_motion], axis=1)
    q = np.linalg.solve(np.eye(M.shape[1]) - M, G @ (vectors.T @ inputs)[:, :, None])[:, 0, 0]
    return np.asarray(-vectors @ q)


def noise_covariances(law: LinkedLaw) -> Array:
    """Compute stationary covariances of e, m^2, and of the command, m^2/s^2, over the states of q, shape (2, n, n).

    Raises:
        UndecidedError: They are not known; the message is the reason.
    """
    links = law.links
    lossy = links.lossy.any()
    if lossy or (links.delay != links.delay[:1]).any():
        if law.terms.feedforward or law.terms.drift > 0.0:
            what = "measurements are lost" if lossy else "delays are unlike"
            raise UndecidedError(f"{what}, and the law has feedforward or drift")
        return SecondMoments(law).covariances()
    delay = int(links.delay.max(initial=0))
    M, G, command = law.loop.with_noise(delay)
    n = len(M)
    states, inputs = G.shape[1:]
    if n * n * states**3 > MOST_WORK:
        raise UndecidedError(f"{n} modes of {states} states each have too many covariances")
    if not law.loop.radius_at(delay) < 1.0:
        raise UndecidedError("the loop is unstable")
    D, pull, _ = law.numbers
    noise = sparse.csr_array(sparse.block_diag(links.noise))
    Q = law.vectors
    listened, sensed = Q.T @ pull, Q.T @ law.sensed_pull
    rate = sensed @ noise @ sensed.T
    S = sensed @ D @ Q
    variance = law.terms.noise**2
    U = np.zeros((n, n, inputs, inputs))  # covariances of the noise that enters the loops of two of n modes
    U[..., 0, 0] = listened @ noise @ listened.T
    U[..., 1, 1] = rate
    U[..., 0, 1] = U[..., 1, 0] = -rate  # a sensing agent is the tail: -F^T K in eta, F^T K in B p'
    U[..., 2, 2] = variance * S @ S
    U[..., 3, 3] = variance * np.eye(n)
    U[..., 2, 3] = U[..., 3, 2] = variance * S
    of_state = command[:, :states]
    of_input = command[:, states:]
    moments = np.zeros((2, n, n))
    step = max(1, _CHUNK // (n * states * states))
    for begin in range(0, n, step):
        rows = slice(begin, begin + step)
        P = stationary(M[rows, None], M, np.einsum("aik,abkl,bjl->abij", G[rows], U[rows], G, optimize=True))
        moments[0, rows] = P[..., 0, 0]
        moments[1, rows] = np.einsum("ai,abij,bj->ab", of_state[rows], P, of_state, optimize=True)
        moments[1, rows] += np.einsum("ai,abij,bj->ab", of_input[rows], U[rows], of_input, optimize=True)
    return np.asarray(law.vectors @ moments @ law.vectors.T)


# -- the record --------------------------------------------------------------------------------------------------------

UNSTABLE_LINKS = "over its links the law is unstable"


class LinkRecord(Record):
    """Effects of links on the law, on ideal kinematics and linear about q*; null if no exact result is known."""

    exact: bool = Field(description="whether every link is exact; then the record adds only the delay margin")
    stable: bool | None = Field(
        description="stable with the delays of the links, in mean square if measurements are lost; null: undecided"
    )
    delay_margin: Finite = Field(description="`margin` of `delay`, s")
    noise_rms: Finite = Field(description="RMS in time of |e| of the whole team due to noise in the long run, m")
    noise_rms_per_agent: Finite = Field(description="the same as RMS over agents, noise_rms / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    mean_square_rate: Finite = Field(
        description="factor of E|e|^2 over a period, in the long run: the spectral radius of X -> E[A X A^T]"
    )
    delivery: dict[str, Finite] = Field(
        description="fraction of measurements that arrive in the long run, mean over a kind's edges, within range"
    )
    assumed: str = Field(description="assumptions of these results")
    delay: DelayAnswer
    noise: NoiseAnswer | None = Field(description="null without noise and bias")
    loss: LossAnswer | None = Field(description="null without losses")


def link_answers(system: System, path: TargetPath) -> LinkRecord | None:
    """Compute the effects of links on a law, and its delay margin; None if links are exact and the margin is unknown.

    Args:
        system: The system.
        path: Path of its targets.
    """
    team, terms = system.team, system.law.terms
    why = ""
    try:
        require_model(system)
        edges, links = measured_edges(team), links_of(system, path)
        size = team.dirichlet.H.shape[0]
        if not team.symmetric:
            why = "H is not symmetric: only a delay of all measurements alike is decided"
        elif size > DENSE_STATES and not (system.grid.continuous or terms.newton):
            why = f"H has {size} rows; all its eigenvalues are found up to {DENSE_STATES}"
        if why:
            noise = partial(NoiseAnswer, agents=[], linearised=links.linearised, reason=why)
            record = _record(
                _delay_alone(system, edges, links, why), edges, links, terms, noise, partial(LossAnswer, reason=why)
            )
        else:
            record = answers_for(LinkedLaw(loop_of(system), eigen_of(system)[1], edges, links, terms), team)
        return record.model_copy(update={"delay": _with_gain(record.delay, system)})
    except UndecidedError as error:
        if not len(system.law.links.table):
            return None
        why = str(error)
        return LinkRecord(
            exact=False,
            stable=None,
            delay_margin=None,
            noise_rms=None,
            noise_rms_per_agent=None,
            mean_square_rate=None,
            delivery={},
            assumed="",
            delay=DelayAnswer(reason=why),
            noise=NoiseAnswer(agents=[], linearised=False, reason=why),
            loss=LossAnswer(reason=why),
        )


def _with_gain(answer: DelayAnswer, system: System) -> DelayAnswer:
    """Add the controller.gain above which the held law is unstable over its links, if it is known."""
    law, team, delay = system.law, system.local.team, common_delay(system)
    changed = law.terms.newton or law.terms.integral or law.custom or (law.extended and not team.symmetric)
    if system.grid.continuous or changed or delay is None:
        return answer
    values = np.array([system.largest_eigenvalue]) if team.symmetric else held_eigenvalues(team)
    return answer.model_copy(update={"largest_gain": largest_gain(values, system.grid.period, delay)})


def answers_for(law: LinkedLaw, team: Team) -> LinkRecord:
    """Compute the effects of a law's links, for a team."""
    delay = delay_answer(law.loop, law.links.delay, law.linked, partial(spectral_radius, law))
    noise, loss = partial(noise_answer, law, team), partial(loss_answer, law)
    return _record(delay, law.edges, law.links, law.terms, noise, loss)


def _delay_alone(system: System, edges: Sequence[MeasuredEdge], links: LinkParameters, why: str) -> DelayAnswer:
    """Decide the loop with a common delay of all measurements, for a team whose eigenvectors are not known.

    For a large team the largest and smallest eigenvalues decide: the spectral radius falls and then rises in between.

    Args:
        system: The system.
        edges: Its edges.
        links: Links of the edges.
        why: Reason why different delays are undecided.

    Raises:
        UndecidedError: The harmonic extension is not unique, or the law has an integral.
    """
    team, gain, period = system.team, system.gain, system.grid.period
    linked = np.array([edge.linked for edge in edges])
    if not team.symmetric and system.grid.continuous:
        values = held_eigenvalues(team)
        margin = None
        if len(values) and (values.real > 0.0).all():
            # A root i w of s + k1 lambda exp(-s T) has w = k1 |lambda| and w T = pi / 2 - |arg lambda|.
            margin = float(((0.5 * np.pi - np.abs(np.angle(values))) / (gain * np.abs(values))).min())
        return DelayAnswer(delay=0.0, stable=margin is not None, margin=margin, reason="")
    if not team.symmetric:
        loop = loop_of(system)
        linked[:] = True
    elif not team.dirichlet.unique:
        raise UndecidedError("the harmonic extension is not unique")
    elif system.law.terms.integral or system.law.custom:
        raise UndecidedError(why)
    else:
        values = np.array([spectrum_of(team).smallest[0], system.largest_eigenvalue])
        loop = Loop(model_of(system.law, period), values, gain, period)

    def radius_of(delay: IntArray) -> float:
        if np.ptp(delay) > 0:
            raise UndecidedError(why)
        return loop.radius_at(int(delay.max()))

    return delay_answer(loop, links.delay, linked, radius_of)


def _record(
    delay: DelayAnswer,
    edges: Sequence[MeasuredEdge],
    links: LinkParameters,
    terms: TermArrays,
    noise_of: Callable[[], NoiseAnswer],
    loss_of: Callable[[], LossAnswer],
) -> LinkRecord:
    """Return the record of links, with the effects of noise and of loss if there are any."""
    strays = (terms.noise > 0.0 or terms.bias != 0.0) and (terms.feedforward > 0 or terms.drift > 0.0)  # odometry
    noise = noise_of() if links.noisy or strays else None
    loss = loss_of() if links.lossy.any() else None
    rate = None if delay.spectral_radius is None else delay.spectral_radius**2
    delivered = {
        kind: [x for x, e in zip(links.delivered.tolist(), edges, strict=True) if e.kind == kind] for kind in KINDS
    }
    ranged = "; bodies within range of one another, as at the start and at q*" if links.ranged else ""
    return LinkRecord(
        exact=links.exact,
        stable=delay.stable if loss is None else loss.stable,
        delay_margin=delay.margin,
        noise_rms=0.0 if noise is None else noise.error,
        noise_rms_per_agent=0.0 if noise is None else noise.error_per_agent,
        mean_square_rate=rate if loss is None else loss.factor,
        delivery={kind: sum(own) / len(own) if own else None for kind, own in delivered.items()},
        assumed=f"no command at a limit of speed; the slope of the flow is left out{ranged}",
        delay=delay,
        noise=noise,
        loss=loss,
    )
