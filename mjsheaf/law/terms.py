"""Terms of the law in addition to -k1 eta, from the same data: neighbours' messages, own odometry and memory.

With H and B of the harmonic extension H q* = B p + c, an agent at a sample

    feedforward   adds v + lead (v - v_before), where H v = B p' + c' is the velocity of q*
    newton        commands k1 delta, where H delta = -eta, instead of -k1 eta
    drift         subtracts the agent's own estimate of the medium velocity
    integral      subtracts k_I z, where z' = eta

Both linear systems are solved by rounds of Chebyshev's iteration, starting from the result of the previous sample. A
round is one exchange: agent i receives F_j x_j from its neighbours j. Agents know bounds on the eigenvalues of H, which
change with events. Rounds over links on which messages can be delayed or lost are described below. An
agent that senses a target computes the target's velocity from the change of its measurement and from its own motion.

Differences need earlier samples. At the first sample of a run feedforward and drift add nothing. On an edge that is new
in a phase, the target is assumed to move with v for one sample. v is extrapolated once rounds have reduced the initial
residual to a thousandth. After a change of its edges an agent waits for that again; the others do not.

Rounds over links. To solve H x = b, agent i receives F_j x_j from its neighbours. If all messages arrive at once,
rounds are Chebyshev's iteration (`solve`). Over links with a delay, losses or a range, every agent instead moves its
own numbers towards the solution of its own rows, given the last messages it received (damped block Jacobi). Under a
delay there is one round a period:

    x_i <- x_i + w D_i^-1 (b_i - D_i x_i + sum F_i^T K z_e),   D_i = H_ii,   z_e = the last F_j x_j that arrived

The fixed point is the same. The iteration converges for any delay: if H is positive definite, the eigenvalues mu of
D^-1 (D - H) lie in [-1, 1), as F_i x_i + F_j x_j has a Laplacian too, and then no root of z^(d+1) = (1 - w) z^d + w mu
is on the unit circle or beyond (0 < w < 1). It does not diverge under independent losses with probability p either,
after which the last numbers of neighbours are kept: F_i x_i solves agent i's rows by a projection of z, so the mean of
(1 - w) / w |F x|_K^2 + |z|_K^2 / (1 - p) falls.

H of range and bearing edges changes with the measurements. In place of D_i^-1 there is the inverse of E_i, an upper
bound of D_i. Under a delay, while H is constant and positive definite, rounds converge too: v in
z v = v - w E^-1 D v + w z^-d E^-1 (D - H) v, multiplied by v* E and divided by v* E v, gives z = 1 - w a + w m z^-d,
0 < a <= 1 and -a <= m < a, and |z| >= 1 would need z^-d m = a with |z| = 1, thus z = 1 and m = a. Convergence under
losses, and with an H that changes slowly, is tested, not proven.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array, BoolArray, IntArray, Take
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.errors import InputError, in_field
from mjsheaf.law.edges import Slopes, add_changes, distance, linked_edges, next_state, require_held, slope
from mjsheaf.noise import normals, stream_of, uniforms
from mjsheaf.section import NonNegative, Positive, Section
from mjsheaf.team import Team
from mjsheaf.team.links import Link, LinkModel, Links, RoundLink, model_of, whole_periods

NEWTON, FEEDFORWARD = 0, 1
"""Terms with rounds; indices of their messages in `RoundMemory`."""

_WEIGHT = 0.9  # w
_COUNT = 2**20  # random numbers of rounds are counted from here on within a sample: apart from those of measurements


class RoundArrays(NamedTuple):
    """Links of the rounds of N agents with C communication edges, the first of a law; by default all is perfect.

    Attributes:
        present: (1,) if a message can be delayed or lost, on any edge; () leaves them out of the compiled code.
        delay: Delay of a message, periods; if positive, there is one round a period.
        loss: Link with the chain of losses of each edge.
        streams: Random streams, shape (C, 2).
        range: Range of each edge, beyond which it carries no messages, shape (C,), m.
        lift: Addition to z for the distance between bodies, shape (V,), m.
        own, inverse: D_i of each agent and its pseudo-inverse, shape (N, 3, 3).
        stiffest: Largest eigenvalue of any D_i.
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

    def settling(self, rounds: int, low: float) -> float:
        """Return about the fraction of the slowest error that the rounds of one period remove.

        Args:
            rounds: Number of rounds in a sample.
            low: Lower bound on the eigenvalues of H.
        """
        if self.stiffest == 0.0:  # no edge is left
            return 1.0
        lost = self.loss.bad * self.loss.loss_bad + (1.0 - self.loss.bad) * self.loss.loss_good
        late = self.delay + lost / max(1.0 - lost, 1e-3)
        return min(1.0, (1 if self.delay else rounds) * _WEIGHT * low / self.stiffest / (1.0 + _WEIGHT * late))


class RoundMemory(NamedTuple):
    """Messages received by agents, and messages in transit, on C communication edges with m numbers in all.

    Arrays by term have an axis for NEWTON and FEEDFORWARD; arrays by end have one for the tail and the head as senders.

    Attributes:
        state: State of the chain of each edge: 0 before it begins, 1 good, 2 bad, shape (C,).
        arrived: 1 if a message from an end has arrived, by term and end, shape (2, 2, C).
        last: Numbers of the last message that arrived, shape (2, 2, m).
        stamps: 1 + the number of the sample at which a message was sent and not lost, in a slot for each sample in
            transit, shape (delay + 1, 2, 2, C). A slot is written once.
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


def carry_rounds(old: RoundMemory, new: RoundMemory, edges: IntArray, rows: IntArray, sample: int) -> None:
    """Copy the messages on the edges that remain, up to a sample of the terms' clock.

    Args:
        old, new: Memory of the old and of the new phase.
        edges, rows: Number of each edge, and of each of its numbers, in the old phase; -1 if it was not there.
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
        stamp = int(stamps.max(initial=0.0))  # all are of one sample, except for lost messages
        if stamp > sample + 1 - slots:
            to = (stamp - 1) % len(new.stamps)
            new.stamps[to][..., kept] = stamps[..., edges]
            new.line[to][..., held] = line[..., rows]


def pack_rounds(team: Team, links: Links, *, period: float, height: float = 0.0) -> RoundArrays:
    """Pack the links of a team's rounds for compiled code.

    Args:
        team: The team.
        links: Link parameters; `links.rounds` and the range of communication edges are used.
        period: Control period, s; 0 if the law is continuous, which has no rounds.
        height: Height of the surface on which planar vehicles move, m.

    Raises:
        InputError: The delay is not a whole number of periods, or is too long; the message begins with the field.
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
        rounds: Links of the rounds.
        steepest: Largest 1 / |z| of bearing edges; see TermArrays.
        seed: Seed of the run.
        n: Number of the sample.
        term: NEWTON or FEEDFORWARD.
        count: Number of rounds; one under a delay.
        first: Number of rounds already done in this sample.
        b, x: Right side, and the solution, which is updated, shape (V, 3).
        y: Measurements that determine H of range and bearing edges, shape (m,), m.
        positions: Positions of the vehicles, shape (V, 3), m.
        memory: See RoundMemory.
        residue: Scratch space, shape (V, 3).
    """
    delay, N = rounds.delay, rounds.own.shape[0]
    for k in range(first, first + (1 if delay else count)):
        if delay == 0:
            send(edges, rounds, seed, n, term, k, x, positions, memory)
        if len(edges.kinds) > 0:
            subtract_own(edges, steepest, y, N, b, x, residue)
        else:
            for v in range(N):
                D = rounds.own[v]
                for i in range(3):
                    residue[v, i] = b[v, i] - (D[i, 0] * x[v, 0] + D[i, 1] * x[v, 1] + D[i, 2] * x[v, 2])
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
    """Add the neighbours' last messages to the residue (V, 3); an edge on which none arrived adds no difference."""
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
    """Return a number of a neighbour's last message, or of F x of the receiver if no message ever arrived."""
    return number if arrived else row[0] * own[0] + row[1] * own[1] + row[2] * own[2]


_ROUNDS = "exchanges a control period; in each, the ends of every communication edge send each other F x [-]"
Rounds = Annotated[int, Field(ge=1, le=1000)]


class Term(Section):
    """Base of the sections of terms."""


class Feedforward(Term):
    """The velocity of q*, from the velocities of targets that agents sense."""

    rounds: Rounds = Field(3, description=_ROUNDS)
    filter: NonNegative = Field(
        0.0, description="time constant of a filter on the measured velocity of targets; 0 leaves it out [s]"
    )
    extrapolate: bool = Field(
        False, description="whether to extrapolate by one control period and the vehicle's time constant"
    )


class Newton(Term):
    """Motion straight to q* instead of down the slope of the disagreement."""

    rounds: Rounds = Field(3, description=_ROUNDS)


class Drift(Term):
    """Observer of the medium velocity, which is subtracted from the command."""

    filter: NonNegative = Field(0.1, description="time constant of the observer [s]")


class Integral(Term):
    """Integral of the disagreement over time; it needs no odometry."""

    gain: Positive = Field(description="k_I [1/s^2]")
    limit: Positive = Field(1e9, description="largest correction [m/s]")


class Odometry(Section):
    """Errors of an agent's own displacement, on which feedforward and drift rest."""

    noise: NonNegative = Field(
        0.0, description="standard deviation of each coordinate of the displacement, at each sample [m]"
    )
    bias: float = Field(0.0, ge=-1e9, le=1e9, description="growth of the error of each coordinate [m/s]")


class Terms(Section):
    """Terms of a law, fields of the section `controller`; None leaves one out."""

    feedforward: Feedforward | None = Field(None, description="adds the velocity of q*; not in the law unless given")
    newton: Newton | None = Field(
        None, description="commands k1 (q* - q) instead of -k1 eta; not in the law unless given"
    )
    drift: Drift | None = Field(
        None, description="subtracts the velocity that adds to an agent's command; not in the law unless given"
    )
    integral: Integral | None = Field(None, description="adds the sum of eta over time; not in the law unless given")
    odometry: Odometry = Field(Odometry(), description="errors of odometry, on which feedforward and drift rest")

    @property
    def has_terms(self) -> bool:
        """Return True if the law has terms in addition to the paper's."""
        return any(isinstance(term, Term) for _, term in self)

    @property
    def has_rounds(self) -> bool:
        """Return True if a term has rounds."""
        return self.feedforward is not None or self.newton is not None


class TermArrays(NamedTuple):
    """The terms for compiled code; by default the law is the paper's.

    Attributes:
        present: (1,) with terms; () leaves them out of the compiled code.
        agents: Number of agents N; 0 if the law is the paper's.
        dimension: Dimension of each agent, shape (N,).
        period: Time between samples, s.
        sensing: Number of the first sensing edge, and of the edge after the last.
        eigenvalues: Lower and upper bound of the eigenvalues of H.
        steepest: Largest 1 / |z| that rounds use for bearing edges, shape (C + S,), 1/m; empty without such edges.
        fresh: True if rounds of newton begin with 0 at every sample.
        feedforward, newton: Number of rounds; 0 without the term.
        measured, drift: Weights of a new measurement in the filters of target velocity and medium velocity; drift is 0
            without that term.
        lead: Lead of feedforward, in samples, shape (N,).
        settled: Number of samples on the same edges after which an agent's feedforward leads.
        integral, largest: k_I, 1/s^2, 0 without the term, and the largest correction, m/s.
        noise, bias: Noise and bias of odometry, m and m/s.
        streams: Random streams, by the id of each agent, shape (N, 2).
        rounds: Links of the rounds.
    """

    present: tuple[int, ...] = ()
    agents: int = 0
    dimension: IntArray = np.zeros(0, dtype=np.int64)
    period: float = 1.0
    sensing: tuple[int, int] = (0, 0)
    eigenvalues: tuple[float, float] = (1.0, 1.0)
    steepest: Array = np.zeros(0)
    fresh: bool = False
    feedforward: int = 0
    newton: int = 0
    measured: float = 1.0
    drift: float = 0.0
    lead: Array = np.zeros(0)
    settled: int = 0
    integral: float = 0.0
    largest: float = np.inf
    noise: float = 0.0
    bias: float = 0.0
    streams: IntArray = np.zeros((0, 2), dtype=np.int64)
    rounds: RoundArrays = RoundArrays()

    def selected(self, agents: IntArray) -> "TermArrays":
        """Return the terms of some of the agents, by number."""
        if not self.agents:
            return self
        by_agent = {name: getattr(self, name)[agents] for name in ("dimension", "lead", "streams")}
        return self._replace(present=self.present[: len(agents)], agents=len(agents), **by_agent)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms that are present."""
        amounts = {name: getattr(self, name) for name in ("feedforward", "newton", "drift", "integral")}
        return tuple(name for name, amount in amounts.items() if amount > 0.0)


class TermMemory(NamedTuple):
    """State of the terms of V vehicles between samples; V is 0 without terms.

    Attributes:
        clock: Number of past samples, shape (1,).
        y: Measurements at the previous sample, shape (m,), m.
        rate: Filtered F p' of the targets, for the numbers of sensing edges, shape (m,), m/s.
        age: Number of past samples with the edge that measures each number, shape (m,).
        since: Number of samples since the edges of each vehicle last changed, shape (V,).
        x: Positions at the previous sample, shape (V, 3), m; an agent knows only the difference to its present
            position.
        moved: Displacement since the previous sample by odometry, shape (V, 3), m.
        walked: Sum of these displacements since the start, shape (V, 3), m.
        seen: Measured velocity of the medium since the previous sample, shape (V, 3), m/s.
        v: Solution of H v = B p', shape (V, 3), m/s.
        delta: Solution of H delta = -eta, shape (V, 3), m.
        drift: Medium velocity estimated by the observer, shape (V, 3), m/s.
        z: Integral of eta, shape (V, 3), m s.
        right: Right side of a linear system, shape (V, 3).
        direction, residue: Vectors of Chebyshev's iteration, shape (V, 3).
        rounds: Messages of the rounds.
    """

    clock: Array
    y: Array
    rate: Array
    age: Array
    since: Array
    x: Array
    moved: Array
    walked: Array
    seen: Array
    v: Array
    delta: Array
    drift: Array
    z: Array
    right: Array
    direction: Array
    residue: Array
    rounds: RoundMemory


def new_term_memory(terms: TermArrays, first: IntArray, V: int, lines: tuple[Array, Array], take: Take) -> TermMemory:
    """Return the memory of the terms of V vehicles before the first sample.

    Args:
        terms: The terms.
        first: Index at which the numbers of each edge begin, and m, shape (E + 1,).
        V: Number of vehicles.
        lines: Messages in transit; see `mjsheaf.law.terms.new_lines`.
        take: Function that returns zeros of a shape.
    """
    any = int(terms.agents > 0)
    m, V = any * int(first[-1]), any * V
    by_number, by_vehicle = [take(m) for _ in range(3)], [take(V), *(take((V, 3)) for _ in range(11))]
    C = len(terms.rounds.streams)
    sent = RoundMemory(take(C), take((2, 2, C)), take((2, 2, int(first[C]))), *lines)
    return TermMemory._make([take(any), *by_number, *by_vehicle, sent])


def carry_terms(old: TermMemory, new: TermMemory, edges: IntArray, rows: IntArray, changed: BoolArray) -> None:
    """Copy the state of the terms, for vehicles and for edges that remain, to the memory of another phase.

    Args:
        old, new: Memory of the old and of the new phase.
        edges, rows: Old number of each new edge, shape (E,), and of each of its numbers, shape (m,); -1 for an edge
            that is new.
        changed: True for vehicles whose edges differ from the previous phase, shape (V,).
    """
    if not (len(old.clock) and len(new.clock)):
        return
    for name in ("clock", "since", "x", "walked", "v", "delta", "drift", "z"):
        getattr(new, name)[:] = getattr(old, name)
    for name in ("y", "rate", "age"):
        getattr(new, name)[rows >= 0] = getattr(old, name)[rows[rows >= 0]]
    new.since[changed] = 0.0
    carry_rounds(old.rounds, new.rounds, edges, rows, int(old.clock[0]))


def require_symmetric(terms: TermArrays) -> None:
    """Refuse terms whose rounds solve with H if directed edges make it asymmetric.

    Raises:
        InputError: There is such a term; the message begins with the field.
    """
    for name in ("feedforward", "newton"):
        if getattr(terms, name):
            raise InputError(
                f"controller.{name}: its rounds assume a symmetric H, which a team with directed communication edges "
                f"does not have; expected no {name}, or undirected edges"
            )


def pack_terms(
    terms: Terms,
    team: Team,
    period: float,
    rounds: RoundArrays | None = None,
    slopes: Slopes | None = None,
) -> TermArrays:
    """Pack the terms of a law for compiled code, on ideal kinematics.

    Args:
        terms: The terms.
        team: The team.
        period: Time between samples, s; positive if there are terms.
        rounds: Links of their rounds; perfect ones unless given.
        slopes: Bounds on H, which rounds of a team with range or bearing edges need.

    Raises:
        InputError: Rounds of newton begin anew at every sample, and messages can be delayed or lost; the message begins
            with the field.
    """
    without = TermArrays(noise=terms.odometry.noise, bias=terms.odometry.bias)
    if not terms.has_terms:
        return without
    first = len(team.communication)
    packed = without._replace(
        present=(1,),
        agents=len(team.agents),
        dimension=np.array([a.dimension for a in team.agents], dtype=np.int64),
        period=period,
        sensing=(first, first + len(team.sensing)),
        lead=np.zeros(len(team.agents)),
        streams=np.array([stream_of("odometry", a.id) for a in team.agents], dtype=np.int64).reshape(-1, 2),
    )
    if terms.feedforward:
        packed = packed._replace(
            feedforward=terms.feedforward.rounds,
            measured=_share(period, terms.feedforward.filter),
            lead=np.full(packed.agents, float(terms.feedforward.extrapolate)),
        )
    if terms.newton:
        packed = packed._replace(newton=terms.newton.rounds)
    if terms.drift:
        packed = packed._replace(drift=_share(period, terms.drift.filter))
    if terms.integral:
        packed = packed._replace(integral=terms.integral.gain, largest=terms.integral.limit)
    if not (packed.feedforward or packed.newton):
        return packed
    packed = packed._replace(rounds=rounds or RoundArrays())
    if slopes is not None:
        packed = packed._replace(steepest=slopes.steepest, fresh=slopes.free)
        if packed.newton and packed.fresh and packed.rounds.imperfect:
            raise InputError(
                "controller.newton: range and bearing edges leave motions free, so its rounds begin anew at every "
                "sample; expected no links.rounds and no range of communication links, or targets that hold every "
                "agent's place"
            )
        return with_eigenvalues(packed, slopes.low, slopes.bound.dirichlet.eigenvalues[1])
    return packed if team.directed else with_eigenvalues(packed, *team.dirichlet.eigenvalues)


def with_eigenvalues(terms: TermArrays, low: float, high: float, *, settled: float = 1e-3) -> TermArrays:
    """Return the terms with bounds on the eigenvalues of H.

    Feedforward leads once the rounds have reduced the initial error to the fraction `settled`.
    """
    left = contraction(terms.feedforward, low, high)
    if terms.rounds.imperfect:
        left = 1.0 - terms.rounds.settling(terms.feedforward, low)
    samples = int(np.ceil(np.log(settled) / np.log(left))) if 0.0 < left < 1.0 else 1
    return terms._replace(eigenvalues=(float(low), float(high)), settled=samples)


def contraction(rounds: int, low: float, high: float) -> float:
    """Bound the fraction of an error that rounds leave, in the 2-norm.

    It is 1 / T_r((kappa + 1) / (kappa - 1)) with kappa = high / low.
    """
    if rounds == 0 or high <= low:
        return float(rounds == 0)
    return float(1.0 / np.cosh(min(rounds * np.arccosh((high + low) / (high - low)), 700.0)))


@dataclass
class Traffic:
    """Messages between agents.

    Attributes:
        rounds: Number of exchanges, in each of which every agent sends to all its neighbours. Measurements do not
            count. A law in Python calls `Sample.exchange`.
        messages: Number of messages from one agent to another.
        numbers: Number of scalars in the messages.
    """

    rounds: int = 0
    messages: int = 0
    numbers: int = 0


def traffic_of(terms: TermArrays, team: Team) -> Traffic:
    """Count the messages of the whole team in a sample.

    A round of feedforward or of Newton is a separate exchange: on each communication edge with m numbers, tail and head
    send each other F x, m numbers, which may be lost. Under a delay a term has one round per sample.
    """
    most = 1 if terms.rounds.delay else terms.feedforward + terms.newton
    rounds, edges = min(terms.feedforward, most) + min(terms.newton, most), team.communication
    pairs = {frozenset(e.between) for e in edges}
    return Traffic(rounds, 2 * rounds * len(pairs), 2 * rounds * sum(len(e.F_tail) for e in edges))


def _share(period: float, time_constant: float) -> float:
    """Return the weight of a new measurement in a first-order filter."""
    return float(-np.expm1(-period / time_constant)) if time_constant > 0.0 else 1.0


@inline_jit
def limit_speed(limit, velocity):
    """Shorten velocity (3,) to the limit, keeping its direction; return whether it was longer."""
    speed = np.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2])
    if speed > limit:
        share = limit / speed
        for i in range(3):
            velocity[i] *= share
        return True
    return False


@inline_jit
def difference(edges, agents, i, j, r, x):
    """Return row r of F_head x_head - F_tail x_tail for x (V, 3), whose first `agents` rows count."""
    z = 0.0
    if j < agents:
        z = edges.F_head[r, 0] * x[j, 0] + edges.F_head[r, 1] * x[j, 1] + edges.F_head[r, 2] * x[j, 2]
    if i < agents:
        z -= edges.F_tail[r, 0] * x[i, 0] + edges.F_tail[r, 1] * x[i, 1] + edges.F_tail[r, 2] * x[i, 2]
    return z


@inline_jit
def apply_laplacian(edges, terms, y, x, out):
    """Write H x into out (V, 3) for x (V, 3) of the agents: one exchange between them.

    H of range and bearing edges is that of the measurements y (m,).
    """
    agents = terms.agents
    for v in range(agents):
        out[v, 0], out[v, 1], out[v, 2] = 0.0, 0.0, 0.0
    for e in range(edges.tail.shape[0]):
        i, j = edges.tail[e], edges.head[e]
        pulls_tail, pulls_head = edges.listens[e, 0] and i < agents, edges.listens[e, 1] and j < agents
        a, b = slope(edges.kinds, terms.steepest, edges, y, e)
        along = 0.0
        if b != 0.0:
            for r in range(edges.first[e], edges.first[e + 1]):
                along += (y[r] + edges.b[r]) * difference(edges, agents, i, j, r, x)
        for r in range(edges.first[e], edges.first[e + 1]):
            z = difference(edges, agents, i, j, r, x)
            if len(edges.kinds) > 0:
                z = a * z + b * along * (y[r] + edges.b[r])
            for c in range(3):
                if pulls_tail:
                    out[i, c] -= edges.P_tail[r, c] * z
                if pulls_head:
                    out[j, c] += edges.P_head[r, c] * z


@inline_jit
def solve(edges, terms, rounds, b, y, x, memory):
    """Improve the solution x (V, 3) of H x = b (V, 3) by rounds of Chebyshev's iteration, H at measurements y (m,).

    If the eigenvalues lie in [a, b], the error falls by T_r((b + a) / (b - a)) in r rounds, in every eigenvector
    equally except for the sign (Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., algorithm 12.1; written so
    that nothing is divided by b - a).
    """
    low, high = terms.eigenvalues
    middle = 0.5 * (low + high)
    square = 0.25 * ((high - low) * (high - low))
    before, scale = 0.0, 1.0 / middle
    for r in range(rounds):
        apply_laplacian(edges, terms, y, x, memory.residue)
        kept, taken = square * before * scale, (2.0 if r else 1.0) * scale
        for v in range(terms.agents):
            for i in range(3):
                memory.direction[v, i] = taken * (b[v, i] - memory.residue[v, i]) + (
                    kept * memory.direction[v, i] if r else 0.0
                )
                x[v, i] += memory.direction[v, i]
        before, scale = scale, 1.0 / (2.0 * middle - square * scale)


@jit
def navigate(present, law, x, carried, command, memory):
    """Write the agents' odometry since the previous sample, and the medium velocity that they measure.

    Args:
        present: `law.terms.present`; as a separate argument, because numba leaves out a branch only if its condition is
            the length of an argument.
        law: The law.
        x: Positions, shape (V, 3), m.
        carried: Velocity over ground minus velocity through the medium, measured on bodies, shape (V, 3), m/s. If None,
            the medium velocity is the part of the displacement that the command does not explain.
        command: Limited commands since the previous sample, shape (V, 3), m/s.
        memory: See TermMemory.
    """
    if len(present) == 0:
        return
    terms = law.terms
    if memory.clock[0] == 0.0:
        return
    h = terms.period
    for v in range(terms.agents):
        error = (0.0, 0.0, 0.0, 0.0)
        if terms.noise > 0.0:
            error = normals(law.seed[0], terms.streams[v], int(memory.clock[0]), 0)
        for i in range(terms.dimension[v]):
            wrong = terms.noise * error[i] + terms.bias * h
            memory.moved[v, i] = x[v, i] - memory.x[v, i] + wrong
            memory.walked[v, i] += memory.moved[v, i]
            if carried is None:
                memory.seen[v, i] = memory.moved[v, i] / h - command[v, i]
            else:
                memory.seen[v, i] = carried[v, i] + wrong / h


@jit
def add_terms(present, law, x, everything):
    """Add the terms, if there are any, to the agents' commands, which hold -k1 eta.

    They are computed from the memory of the law, `everything`. The positions x (V, 3) decide only whether rounds reach
    a neighbour.
    """
    if len(present) == 0:
        return
    terms, memory, command = law.terms, everything.terms, everything.command
    if terms.newton > 0:  # k1 delta in place of -k1 eta, where H delta = -eta
        for v in range(terms.agents):
            for i in range(3):
                memory.right[v, i] = -everything.residual[v, i]
                if terms.fresh:
                    memory.delta[v, i] = 0.0
        _exchange(terms.rounds.present, law, NEWTON, x, memory.right, everything.y, memory.delta, memory)
        for v in range(terms.agents):
            for i in range(3):
                command[v, i] = law.gain[v] * memory.delta[v, i]
    if terms.feedforward > 0:
        _feed_forward(law, x, everything.y, command, memory)
    if terms.drift > 0.0 and memory.clock[0] > 0.0:
        share = terms.drift if memory.clock[0] > 1.0 else 1.0  # the first measurement has nothing to be mixed with
        for v in range(terms.agents):
            for i in range(3):
                memory.drift[v, i] += share * (memory.seen[v, i] - memory.drift[v, i])
                command[v, i] -= memory.drift[v, i]
    if terms.integral > 0.0:
        for v in range(terms.agents):
            for i in range(3):
                command[v, i] -= terms.integral * memory.z[v, i]


@inline_jit
def _exchange(imperfect, law, term, x, b, y, found, memory):
    """Improve the solution (V, 3) of H found = b (V, 3) by a term's rounds, over links if these are imperfect."""
    terms = law.terms
    rounds = terms.newton if term == NEWTON else terms.feedforward
    if len(imperfect) == 0:
        solve(law.edges, terms, rounds, b, y, found, memory)
    else:
        first, n = 0 if term == NEWTON else terms.newton, int(memory.clock[0])
        sent, seed, steep = memory.rounds, law.seed[0], terms.steepest
        relax(law.edges, terms.rounds, steep, seed, n, term, rounds, first, b, y, found, x, sent, memory.residue)


@inline_jit
def _feed_forward(law, x, y, command, memory):
    """Add the velocity v of q*, extrapolated by `lead` samples from its change since the previous sample."""
    terms = law.terms
    if memory.clock[0] > 0.0:
        _sense_targets(law, y, memory)
        for v in range(terms.agents):
            if memory.since[v] > terms.settled:
                for i in range(3):
                    command[v, i] -= terms.lead[v] * memory.v[v, i]
        _exchange(law.terms.rounds.present, law, FEEDFORWARD, x, memory.right, y, memory.v, memory)
        for v in range(terms.agents):
            if memory.since[v] > terms.settled:
                for i in range(3):
                    command[v, i] += terms.lead[v] * memory.v[v, i]
    for v in range(terms.agents):
        for i in range(3):
            command[v, i] += memory.v[v, i]


@inline_jit
def _sense_targets(law, y, memory):
    """Write B p', filtered, into memory.right, from changes of target measurements and the agents' displacements.

    Measurements over links may arrive at different times. They are filtered on arrival (see `mjsheaf.law.edges`).
    """
    edges, terms, measured, linked = law.edges, law.terms, memory.right, law.links.of.shape[0] > 0
    for v in range(terms.agents):
        measured[v, 0], measured[v, 1], measured[v, 2] = 0.0, 0.0, 0.0
    for e in range(terms.sensing[0], terms.sensing[1]):
        i = edges.tail[e]  # the agent is the tail: y_e = F_T p - F_i q_i
        has_link = linked and law.links.of[e] >= 0
        a, b = slope(edges.kinds, terms.steepest, edges, y, e)
        along = 0.0
        for r in range(edges.first[e], edges.first[e + 1]):
            if not has_link and memory.age[r] > 0.0:  # update F p' from how y changed and the agent moved
                F, share = edges.F_tail[r], terms.measured if memory.age[r] > 1.0 else 1.0  # the first needs no filter
                own = F[0] * memory.moved[i, 0] + F[1] * memory.moved[i, 1] + F[2] * memory.moved[i, 2]
                memory.rate[r] += share * ((y[r] - memory.y[r] + own) / terms.period - memory.rate[r])
            if b != 0.0:
                along += (y[r] + edges.b[r]) * _velocity_of(edges, memory, has_link, i, r)
        for r in range(edges.first[e], edges.first[e + 1]):
            velocity = _velocity_of(edges, memory, has_link, i, r)
            if len(edges.kinds) > 0:
                velocity = a * velocity + b * along * (y[r] + edges.b[r])
            for c in range(3):
                measured[i, c] += edges.P_tail[r, c] * velocity
    add_changes(edges.ramp, edges.kinds, edges, terms.agents, y, measured)


@inline_jit
def _velocity_of(edges, memory, has_link, i, r):
    """Return row r of F p' as agent i measures it, m/s."""
    if not has_link and memory.age[r] == 0.0:  # nothing is measured yet: the target is assumed to move with v
        F = edges.F_tail[r]
        return F[0] * memory.v[i, 0] + F[1] * memory.v[i, 1] + F[2] * memory.v[i, 2]
    return memory.rate[r]


@inline_jit
def integrate(present, terms, v, residual, memory):
    """Integrate eta_i (3,) of an agent over a period into z_i, up to the largest correction, if there are terms."""
    if len(present) == 0:
        return
    if v < terms.agents and terms.integral > 0.0:
        z = memory.z[v]
        for i in range(3):
            z[i] += terms.period * residual[i]
        limit_speed(terms.largest / terms.integral, z)


@inline_jit
def remember(present, terms, x, y, memory):
    """Store the values that the next sample compares with, if there are terms."""
    if len(present) == 0:
        return
    memory.clock[0] += 1.0
    for r in range(y.shape[0]):
        memory.y[r] = y[r]
        memory.age[r] += 1.0
    for v in range(terms.agents):
        memory.since[v] += 1.0
        for i in range(3):
            memory.x[v, i] = x[v, i]
