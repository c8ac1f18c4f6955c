"""A law over its links, linear about q*: what each edge measures, what its link makes of that, and how much delay it
tolerates.

Range and bearing have an error along the line of sight and one across it. In space azimuth and elevation have the noise
s each, in a body frame that faces along the last displacement of the tail. With b the third axis of that frame, r the
range and l the line of sight, azimuth moves the measured point by s r |l x b| along b x l, and elevation by s r across
both. The covariance is at most that with |l x b| = 1, s^2 r^2 (1 - l l^T), which depends on no frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.checking.loop.sampled_loop import Loop
from mjsheaf.checking.theorem.targets import TargetPath
from mjsheaf.errors import UndecidedError
from mjsheaf.law.terms import TermArrays
from mjsheaf.section import Finite, Record
from mjsheaf.system import System
from mjsheaf.team import Edge, Team


class MeasuredEdge(NamedTuple):
    """An edge that agents listen to: D q + (what targets add) is measured.

    Attributes:
        slots: states of q that it touches, shape (k,).
        D: shape (m, k).
        K: the inner product, shape (m, m); of an edge that does not fit, the derivative of its pull.
        kind: communication, sensing or anchor.
        z: relative position of an edge that does not fit, which is what D measures then, shape (m,), m; None else.
    """

    slots: IntArray
    D: Array
    K: Array
    kind: str
    z: Array | None = None

    @property
    def sensing(self) -> bool:
        """Return True if feedforward learns a target's velocity from it."""
        return self.kind == "sensing"

    @property
    def linked(self) -> bool:
        """Return True if it has a link; anchors measure at once, without error."""
        return self.kind != "anchor"

    @property
    def pull(self) -> Array:
        """Matrix from its numbers to a part of eta on its slots, D^T K, shape (k, m)."""
        return self.D.T @ self.K

    @property
    def H(self) -> Array:  # noqa: N802 - the paper's symbol
        """Its part of H on its slots, shape (k, k)."""
        return self.pull @ self.D


def measured_edges(team: Team) -> list[MeasuredEdge]:
    """The edges that agents listen to: communication, sensing, anchors, in order."""
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
        delay: ages of measurements in whole periods, shape (E,).
        noise: covariance of each edge's numbers, shapes (m_e, m_e), m^2.
        bias: Bias of each edge's numbers, shapes (m_e,), m.
        loss: probabilities a sample to turn bad and to turn good, and of loss while good and while bad, shape (E, 4);
            without bursts (0, 1, p, p).
        held: True where a lost sample is replaced by an older one, shape (E,).
        linearised: True if a covariance is that of range and bearing.
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
    def bursty(self) -> bool:
        """Return True if losses of an edge depend on earlier ones."""
        to_bad, to_good, good, bad = self.loss.T
        memoryless = (good == bad) | (to_bad == 0.0) | (to_good == 0.0) | (to_bad + to_good == 1.0)
        return not memoryless.all()

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
        """The share of an edge's measurements that arrive in the long run, shape (E,)."""
        to_bad, to_good, good, bad = self.loss.T
        total = to_bad + to_good
        share = np.where(total > 0.0, to_bad / np.where(total > 0.0, total, 1.0), 0.0)
        return np.asarray(1.0 - share * bad - (1.0 - share) * good)


def perfect_links(edges: Sequence[MeasuredEdge]) -> LinkParameters:
    """Links without delay, noise and loss."""
    E = len(edges)
    noise = tuple(np.zeros((len(edge.D),) * 2) for edge in edges)
    bias = tuple(np.zeros(len(edge.D)) for edge in edges)
    loss = np.tile([0.0, 1.0, 0.0, 0.0], (E, 1))
    return LinkParameters(np.zeros(E, dtype=np.int64), noise, bias, loss, np.zeros(E, dtype=np.bool_))


@dataclass(frozen=True)
class LinkedLaw:
    """A law over its links, linear about q*, on ideal kinematics.

    Attributes:
        loop: Loop of the law as if its links were exact.
        vectors: Eigenvectors of H in the order of the loop's L eigenvalues, shape (n, L); of a free team L < n.
        edges: that agents listen to.
        links: theirs.
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

    def spread(self, parts: Sequence[Array]) -> Array:
        """The sum of matrices on each edge's slots, shape (n, n)."""
        total = np.zeros((len(self.vectors), len(self.vectors)))
        for edge, part in zip(self.edges, parts, strict=True):
            total[np.ix_(edge.slots, edge.slots)] += part
        return total


def links_of(
    system: System,
    path: TargetPath,
    *,
    instants: int = 200,  # along q* at which noise of range and bearing is linearised
) -> LinkParameters:
    """The links of a system; noise of range and bearing is the mean of its linearisations along q*.

    Raises:
        UndecidedError: bodies are beyond a link's range at the start, or at q* at times.
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
        _require_in_range(system, e, everywhere, link["range"])
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
            y = x[few][:, law.head[e]] @ law.F_head[rows].T - x[few][:, law.tail[e]] @ law.F_tail[rows].T
            noise[e] = range_bearing_covariance(y, float(link["range_noise"]), float(link["bearing_noise"]))
    return replace(
        links,
        noise=tuple(noise),
        bias=tuple(bias),
        linearised=bool(table["bearing"].any()),
        ranged=bool(np.isfinite(table["range"]).any()),
    )


def _require_in_range(system: System, e: int, x: Array, reach: float) -> None:
    """Refuse an edge whose ends are beyond the reach of its link, m, at the first or at later positions (T, V, 3), m.

    Raises:
        UndecidedError: They are.
    """
    tail = system.law.edges.tail[e]
    head = system.law.edges.head[e]
    apart = np.linalg.norm(x[:, head] - x[:, tail], axis=1)
    if apart.max() > reach:
        when = "at the start" if apart[0] > reach else "at q* at times"
        ends = f"{system.team.members[tail].id} and {system.team.members[head].id}"
        raise UndecidedError(f"{ends} are beyond range {when}")


def range_bearing_covariance(y: Array, range_noise: float, bearing_noise: float) -> Array:
    """Return the mean covariance of y as measured by range and bearing, linearised, shape (m, m), m^2.

    In the plane it is exact to first order, and in space at least what it is there.

    Args:
        y: Relative positions, shape (T, m), m; m is 2 or 3.
        range_noise, bearing_noise: Standard deviations, m and rad. In space azimuth and elevation have it each.
    """
    square = (y**2).sum(axis=1)[:, None, None]
    outer = y[:, :, None] * y[:, None]
    along = outer / np.where(square > 0.0, square, 1.0)  # a range of zero has no direction
    across = square * np.eye(y.shape[1]) - outer
    return np.asarray((range_noise**2 * along + bearing_noise**2 * across).mean(axis=0))


# -- delayed measurements ----------------------------------------------------------------------------------------------
#
# For the paper's law with one delay of d periods the condition is k1 h lambda < 2 sin(pi / (2 (2 d + 1))). With other
# laws each number of periods is tried.
#
# If the edges of the paper's law have different delays up to d, the condition at lambda_max suffices. A root
# z = exp(i theta) of the team's loop, with vector x and w_e = k1 h x* H_e x >= 0, satisfies
# sum w_e cos(theta (d_e + 1/2)) = 0 and sum w_e sin(theta (d_e + 1/2)) = 2 sin(theta / 2). The first equation requires
# theta >= pi / (2 d + 1), so the second gives sum w_e >= 2 sin(pi / (2 (2 d + 1))). But sum w_e <= k1 h lambda_max. So
# no root crosses the circle as the gain rises from a small value, for which the loop is stable.

MOST_STATES = 900  # of a matrix whose eigenvalues are found
MOST_WORK = 3e10  # modes times states cubed, of eigenvalues or of covariances
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
    Q = vectors if n < len(vectors) else np.eye(n)
    rows = np.split(np.arange(sum(len(edge.D) for edge in law.edges)), np.cumsum([len(edge.D) for edge in law.edges]))
    m = sum(map(len, rows))
    C, pulled = np.zeros((m, size)), np.zeros((len(vectors), m))
    for edge, own, age in zip(law.edges, rows, delay.tolist(), strict=False):
        C[own, n * age : n * (age + 1)] = edge.D @ Q[edge.slots]
        pulled[np.ix_(edge.slots, own)] = edge.pull
    M, L = np.zeros((size, size)), np.zeros((size, m))
    M[n : n * (d + 1), : n * d] = np.eye(n * d)
    M[:n, :n] += np.eye(n)
    modes = Q.T @ vectors
    eta = vectors.T @ pulled  # in eigenvectors of H, where e has eta = lambda e
    papers = -h * law.loop.gain * Q.T @ pulled
    L[:n] = papers if law.loop.is_papers else h * (modes * (feedback.D[:, 0] / values)) @ eta
    kept = [slice(n * (d + 1 + i), n * (d + 2 + i)) for i in range(r)]
    for i, row in enumerate(kept):
        M[:n, row] = h * modes * feedback.C[:, i]
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


def largest_delay(
    loop: Loop,
    linked: BoolArray,
    radius_of: Callable[[IntArray], float],
    *,
    most: int = 200,
) -> int | None:
    """Return the largest delay of all links, in periods, up to which a loop is stable; None if it is unstable without.

    Args:
        loop: Loop of the law.
        linked: True for each edge that has a link, shape (E,); the others measure at once.
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


def _is_below_limit(loop: Loop, delay: int) -> bool:
    """Return True if a loop is stable with any delays up to this one, in periods."""
    papers = loop.is_papers and not np.iscomplexobj(loop.values) and loop.radius < 1.0 - _ROUNDING
    return papers and delay <= limit_from_eigenvalues(loop.values, loop.gain * loop.period)


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
        # Of unlike delays, the limit decides only for the paper's law and a symmetric H, and only that it is stable.
        stable = True if _is_below_limit(loop, d) else None
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
