"""Rounds over links: messages of neighbours for terms of the law, where a message can be delayed or lost.

Solving H x = b, agent i is sent F_j x_j by its neighbours. Where all of that arrives at once, rounds are Chebyshev's
iteration (`terms.solve`). Over links with a delay, losses or a range, every agent instead takes its own numbers towards
the solution of its own rows, given the last message it received (damped block Jacobi), a round a period under a delay:

    x_i <- x_i + w D_i^-1 (b_i - D_i x_i + sum F_i^T K z_e),   D_i = H_ii,   z_e = the last F_j x_j that arrived

Its fixed point is the same. It converges whatever the delay is: where H is positive definite, eigenvalues mu of
D^-1 (D - H) lie in [-1, 1), as F_i x_i + F_j x_j has a Laplacian too, and then no root of z^(d+1) = (1 - w) z^d + w mu
is on the unit circle or beyond (0 < w < 1). Nor does a loss with a probability p of its own each time, after which
neighbours' last numbers stay, let it diverge: F_i x_i solves agent i's rows by a projection of z, so that the mean of
(1 - w) / w |F x|_K^2 + |z|_K^2 / (1 - p) falls.

H of range and bearing edges changes with what is measured. In place of D_i^-1 there is the inverse of E_i, an upper
bound of D_i. Under a delay, while H stays the same and is positive definite, rounds converge too: v in
z v = v - w E^-1 D v + w z^-d E^-1 (D - H) v, multiplied by v* E and divided by v* E v, gives z = 1 - w a + w m z^-d,
0 < a <= 1 and -a <= m < a, and |z| >= 1 would need z^-d m = a with |z| = 1, thus z = 1 and m = a. That losses leave the
same result, and that an H which changes slowly does, is tested, not proven.
"""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, IntArray, Take
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.errors import in_field
from mjsheaf.law.edges import slope
from mjsheaf.law.links import distance, linked_edges, next_state, require_held
from mjsheaf.noise import uniforms
from mjsheaf.team import Team
from mjsheaf.team.links import Link, LinkModel, Links, RoundLink, model_of, whole_periods

NEWTON, FEEDFORWARD = 0, 1
"""Whose rounds they are."""

_WEIGHT = 0.9  # w
_COUNT = 2**20  # random numbers of rounds are counted from here on within a sample: apart from those of measurements


class RoundArrays(NamedTuple):
    """Links of the rounds of N agents with C communication edges, the first of a law; by default all is perfect.

    Attributes:
        present: (1,) if a message can be delayed or lost, on any edge; () leaves them out of the compiled code.
        delay: Delay of a message, periods; if positive, there is one round a period.
        loss: Link with the chain of losses of each edge.
        streams: Random streams, shape (C, 2).
        range: beyond which an edge carries no messages, shape (C,), m.
        lift: what is added to z for the distance between bodies, shape (V,), m.
        own, inverse: D_i of each agent and its pseudo-inverse, shape (N, 3, 3).
        stiffest: largest eigenvalue of any D_i.
    """

    present: tuple[int, ...] = ()
    delay: int = 0
    loss: LinkModel = LinkModel()
    streams: IntArray = np.zeros((0, 2), dtype=np.int64)
    range: Array = np.zeros(0)
    lift: Array = np.zeros(0)
    own: Array = np.zeros((0, 3, 3))
    inverse: Array = np.zeros((0, 3, 3))
    stiffest: float = 1.0

    @property
    def imperfect(self) -> bool:
        """Return True if a message can be delayed or lost."""
        return bool(self.present)

    @property
    def lossy(self) -> bool:
        """Return True if a message can be lost at random."""
        return self.loss.lossy

    def settling(self, rounds: int, low: float) -> float:
        """Fraction of the slowest error that the rounds of one period remove, nearly; `low` bounds H from below."""
        if self.stiffest == 0.0:  # no edge is left
            return 1.0
        lost = self.loss.bad * self.loss.loss_bad + (1.0 - self.loss.bad) * self.loss.loss_good
        late = self.delay + lost / max(1.0 - lost, 1e-3)
        return min(1.0, (1 if self.delay else rounds) * _WEIGHT * low / self.stiffest / (1.0 + _WEIGHT * late))


class RoundMemory(NamedTuple):
    """Messages received by agents, and messages under way, on C communication edges with m numbers in all.

    Arrays by term have an axis for NEWTON and FEEDFORWARD; arrays by end have one for the tail and the head as senders.

    Attributes:
        state: State of the chain of each edge: 0 before it begins, 1 good, 2 bad, shape (C,).
        arrived: 1 if something has arrived that an end sent, by term and end, shape (2, 2, C).
        last: Last of that, shape (2, 2, m).
        stamps: 1 + the number of the sample at which a message was sent and not lost, in a slot for each sample under
            way, shape (delay + 1, 2, 2, C). A slot is written once.
        line: Numbers of these messages, shape (delay + 1, 2, 2, m).
    """

    state: Array
    arrived: Array
    last: Array
    stamps: Array
    line: Array


def new_lines(rounds: RoundArrays, first: IntArray, take: Take) -> tuple[Array, Array]:
    """Return `stamps` and `line` of a RoundMemory before the first sample; edges' numbers begin at `first`."""
    C, slots = len(rounds.streams), rounds.delay + 1
    return take((slots, 2, 2, C)), take((slots, 2, 2, int(first[C])))


def new_round_memory(rounds: RoundArrays, first: IntArray, lines: tuple[Array, Array], take: Take) -> RoundMemory:
    """Return the memory of rounds before the first sample, with the messages under way of `new_lines`."""
    C = len(rounds.streams)
    return RoundMemory(take(C), take((2, 2, C)), take((2, 2, int(first[C]))), *lines)


def carry_rounds(old: RoundMemory, new: RoundMemory, edges: IntArray, rows: IntArray, sample: int) -> None:
    """Copy what was sent on the edges that remain, up to a sample of the terms' clock.

    Args:
        old, new: Memory of either phase.
        edges, rows: Number of each edge, and of each of its numbers, in the old phase; -1 where it was not there.
        sample: Number of past samples.
    """
    C, m = len(old.state), old.last.shape[-1]
    edges, rows = edges[: len(new.state)], rows[: new.last.shape[-1]]
    kept, held = np.flatnonzero((edges >= 0) & (edges < C)), np.flatnonzero((rows >= 0) & (rows < m))
    edges, rows = edges[kept], rows[held]
    new.state[kept] = old.state[edges]
    new.arrived[..., kept] = old.arrived[..., edges]
    new.last[..., held] = old.last[..., rows]
    slots = min(len(old.stamps), len(new.stamps))
    for stamps, line in zip(old.stamps, old.line, strict=True):
        stamp = int(stamps.max(initial=0.0))  # of one sample, but for what was lost
        if stamp > sample + 1 - slots:
            to = (stamp - 1) % len(new.stamps)
            new.stamps[to][..., kept] = stamps[..., edges]
            new.line[to][..., held] = line[..., rows]


def pack_rounds(team: Team, links: Links, *, period: float, height: float = 0.0) -> RoundArrays:
    """The links of a team's rounds for compiled code.

    Args:
        team: the team.
        links: those of all and of each kind; `links.rounds`, and the range of communication edges, count here.
        period: the control period, s; 0 where the law is continuous, which has no rounds.
        height: Height of the surface on which planar vehicles move, m.

    Raises:
        InputError: the delay is no whole number of periods, or too long; the message begins with the field.
    """
    wanted = links.rounds or RoundLink()
    with in_field("links.rounds.delay"):
        delay = whole_periods(wanted.delay, period) if period > 0.0 else 0
    loss = model_of(Link(loss=wanted.loss))
    edges = linked_edges(team, links)[: len(team.communication)]
    far = np.array([one.link.range for one in edges])
    if not (delay or loss.lossy or np.isfinite(far).any()):
        return RoundArrays()
    with in_field("links.rounds"):
        require_held(4 * (delay + 1) * sum(1 + len(edge.F_tail) for edge in team.communication))
    own = np.zeros((len(team.agents), 3, 3))  # D_i
    for edge in team.measuring_edges:
        for end, F in ((edge.tail, edge.F_tail), (edge.head, edge.F_head)):
            if team.index.get(end, len(own)) < len(own):
                n = F.shape[1]
                own[team.index[end], :n, :n] += F.T @ edge.weight @ F
    return RoundArrays(
        present=(1,),
        delay=delay,
        loss=loss,
        streams=np.array([one.stream for one in edges], dtype=np.int64).reshape(-1, 2),
        range=far,
        lift=np.where([member.dimension == 2 for member in team.members], height, 0.0),
        own=own,
        inverse=np.asarray(np.linalg.pinv(own, hermitian=True), dtype=np.float64),
        stiffest=float(np.linalg.eigvalsh(own)[:, -1].max()),
    )


@jit
def relax(edges, rounds, steepest, seed, n, term, count, first, b, y, x, positions, memory, residue):
    """Improve the solution x (V, 3) of H x = b (V, 3) by rounds over links.

    Args:
        edges: Edges of the law.
        rounds: their links.
        steepest: Largest 1 / |z| of bearing edges, see TermArrays.
        seed: Seed of the run.
        n: number of the sample.
        term: NEWTON or FEEDFORWARD.
        count: rounds; one under a delay.
        first: Number of rounds already done in this sample.
        b, x: shape (V, 3).
        y: Measurements, shape (m,), m, at which H of range and bearing edges is.
        positions: Positions of the vehicles, shape (V, 3), m.
        memory: see RoundMemory.
        residue: shape (V, 3), overwritten.
    """
    delay, N = rounds.delay, rounds.own.shape[0]
    for k in range(first, first + (1 if delay else count)):
        if delay == 0:
            send(edges, rounds, seed, n, term, k, x, positions, memory)
        if len(edges.kinds) > 0:
            subtract_own(edges, steepest, y, N, b, x, residue)
        else:
            subtract_fixed(rounds.own, b, x, residue)
        receive(edges, rounds, steepest, n, term, y, x, memory, residue)
        for v in range(N):
            r, inverse = residue[v], rounds.inverse[v]
            for i in range(3):
                x[v, i] += _WEIGHT * (inverse[i, 0] * r[0] + inverse[i, 1] * r[1] + inverse[i, 2] * r[2])
        if delay > 0:
            send(edges, rounds, seed, n, term, k, x, positions, memory)


@inline_jit
def send(edges, rounds, seed, n, term, k, x, positions, memory):
    """Let both ends of every edge send F x in round k of sample n, unless the message is lost."""
    chain, slot = rounds.loss, n % (rounds.delay + 1)
    for e in range(rounds.streams.shape[0]):
        tail, head = edges.tail[e], edges.head[e]
        chance = uniforms(seed, rounds.streams[e], n, _COUNT + k)
        memory.state[e] = next_state(memory.state[e], chance[2], chain.to_bad, chain.to_good, chain.bad)
        loss = chain.loss_bad if memory.state[e] == 2.0 else chain.loss_good
        if rounds.range[e] < np.inf:
            far = distance(positions[tail], rounds.lift[tail], positions[head], rounds.lift[head])
            loss = 1.0 if far > rounds.range[e] else loss
        for end in range(2):
            memory.stamps[slot, term, end, e] = 0.0 if chance[end] < loss else n + 1.0
            F, own = (edges.F_head, x[head]) if end else (edges.F_tail, x[tail])
            for r in range(edges.first[e], edges.first[e + 1]):
                memory.line[slot, term, end, r] = F[r, 0] * own[0] + F[r, 1] * own[1] + F[r, 2] * own[2]


@inline_jit
def subtract_fixed(own, b, x, residue):
    """Write b - D x of every agent into the residue (V, 3), with its D in `own` (N, 3, 3)."""
    for v in range(own.shape[0]):
        D = own[v]
        for i in range(3):
            residue[v, i] = b[v, i] - (D[i, 0] * x[v, 0] + D[i, 1] * x[v, 1] + D[i, 2] * x[v, 2])


@inline_jit
def subtract_own(edges, steepest, y, N, b, x, residue):
    """Write b - D x of N agents into the residue (V, 3), with D = H_ii at measurements y (m,)."""
    for v in range(N):
        for i in range(3):
            residue[v, i] = b[v, i]
    for e in range(edges.tail.shape[0]):
        a, c = slope(edges.kinds, steepest, edges, y, e)
        tail, head = edges.tail[e], edges.head[e]
        if tail < N and edges.listens[e, 0]:
            _subtract_at(edges, edges.F_tail, edges.P_tail, a, c, y, e, x[tail], residue[tail])
        if head < N and edges.listens[e, 1]:
            _subtract_at(edges, edges.F_head, edges.P_head, a, c, y, e, x[head], residue[head])


@inline_jit
def _subtract_at(edges, F, P, a, c, y, e, own, residue):
    """Subtract F^T K M F x of one end of edge e from its residue.

    Args:
        edges: Edges of the law.
        F, P: Maps F and K F of this end, shape (m, 3).
        a, c: M = a I + c z z^T.
        y: Measurements, shape (m,), m.
        e: Number of the edge.
        own: x of this end, shape (3,).
        residue: Residue of this end, shape (3,).
    """
    along = 0.0
    for r in range(edges.first[e], edges.first[e + 1]):
        along += (y[r] + edges.b[r]) * (F[r, 0] * own[0] + F[r, 1] * own[1] + F[r, 2] * own[2])
    for r in range(edges.first[e], edges.first[e + 1]):
        z = a * (F[r, 0] * own[0] + F[r, 1] * own[1] + F[r, 2] * own[2]) + c * along * (y[r] + edges.b[r])
        for i in range(3):
            residue[i] -= P[r, i] * z


@inline_jit
def receive(edges, rounds, steepest, n, term, y, x, memory, residue):
    """Add to the residue (V, 3) what neighbours sent last; an edge on which nothing ever came adds no difference."""
    due = (n + 1) % (rounds.delay + 1)
    for e in range(rounds.streams.shape[0]):
        first, last = edges.first[e], edges.first[e + 1]
        for end in range(2):  # of the sender
            if n >= rounds.delay and memory.stamps[due, term, end, e] == n - rounds.delay + 1.0:
                memory.arrived[term, end, e] = 1.0
                for r in range(first, last):
                    memory.last[term, end, r] = memory.line[due, term, end, r]
            arrived, sent = memory.arrived[term, end, e] > 0.0, memory.last[term, end]
            v = edges.tail[e] if end else edges.head[e]
            F, P = (edges.F_tail, edges.P_tail) if end else (edges.F_head, edges.P_head)
            a, b = slope(edges.kinds, steepest, edges, y, e)
            along = 0.0
            if b != 0.0:
                for r in range(first, last):
                    along += (y[r] + edges.b[r]) * _sent(arrived, sent[r], F[r], x[v])
            for r in range(first, last):
                z = _sent(arrived, sent[r], F[r], x[v])
                if len(edges.kinds) > 0:
                    z = a * z + b * along * (y[r] + edges.b[r])
                for c in range(3):
                    residue[v, c] += P[r, c] * z


@inline_jit
def _sent(arrived, number, row, own):
    """Return a number that a neighbour sent last, or F x of the receiver if nothing ever came."""
    return number if arrived else row[0] * own[0] + row[1] * own[1] + row[2] * own[2]
