"""Linear model of a team's law, read off the compiled stages that run.

A team of one agent that senses one target with the weight lambda has H = lambda I. So the law of any team, in an
eigenvector of H, is the law of that agent. Its compiled stages are run once for every number that it remembers, with
that number and nothing else moved from rest. The differences are the columns of

    x_{k+1} = A x_k + b q_k,    u_k = c x_k + d q_k,

with q the agent's position, u its command and x what it remembers. No formula of a term is written here, so that
every linear term of the law is in the model. The columns of a linear law are exactly proportional to the size of the
motion, and a motion of all numbers at once is the sum of its parts. A law for which either fails is not linear.

Numbers of a delay line lie in a ring. They are sorted by age, so that the model does not change with time.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.loop.modelled import UndecidedError
from mjsheaf.control.law import ControlArrays, EdgeArrays, LawArrays, Memory, evaluate_law, new_memory
from mjsheaf.control.links import LINK, LinkArrays, cells_of, no_links
from mjsheaf.control.rounds import no_rounds
from mjsheaf.control.terms import TermArrays
from mjsheaf.dynamics.motion import MotionArrays
from mjsheaf.jit import jit

_SIZES = (2.0**-20, 2.0**-34)  # m, of a motion: powers of two, by which a linear law scales without rounding
_LINEAR = 1e-9  # relative difference of two answers of a linear law
_NEGLIGIBLE = 1e-11  # relative part of a new direction that is rounding
_SETTLING = 4  # samples, beyond the delay, after which counters of samples no longer matter


class LinearLaw(NamedTuple):
    """Linear model of the law in L eigenvectors of H, with n numbers that it remembers.

    Attributes:
        A: Numbers remembered from those of the sample before, shape (L, n, n).
        b: Numbers remembered from the position, shape (L, n).
        c: Command from the numbers remembered, shape (L, n).
        d: Command from the position, shape (L,), 1/s.
        start: Numbers remembered, and position, `first` samples after the start at position 1, shape (L, n + 1).
        first: Samples between the start of a run and `start`.
        early: Positions from the start up to then, shape (L, first).
        period: Control period h, s.
    """

    A: Array
    b: Array
    c: Array
    d: Array
    start: Array
    first: int
    early: Array
    period: float

    @property
    def closed(self) -> Array:
        """The law around an ideal agent, q_{k+1} = q_k + h u_k, on (x, q), shape (L, n + 1, n + 1)."""
        L, n = self.b.shape
        M = np.zeros((L, n + 1, n + 1))
        M[:, :n, :n] = self.A
        M[:, :n, n] = self.b
        M[:, n, :n] = self.period * self.c
        M[:, n, n] = 1.0 + self.period * self.d
        return M

    def responses(self, count: int) -> Array:
        """Return positions after a start at position 1, shape (L, count)."""
        position = np.zeros((len(self.d), count))
        known = min(self.first, count)
        position[:, :known] = self.early[:, :known]
        state = self.start
        closed = self.closed
        for k in range(known, count):
            position[:, k] = state[:, -1]
            state = (closed @ state[:, :, None])[:, :, 0]
        return position

    @property
    def radii(self) -> Array:
        """Spectral radius of what a start excites and a position shows, shape (L,)."""
        return np.array([_loop_radius(M, x) for M, x in zip(self.closed, self.start, strict=True)])


def _loop_radius(M: Array, start: Array) -> float:
    """Return the spectral radius of M on what follows from a state and shows in the last coordinate."""
    basis = _krylov_basis(M, start)
    excited = basis.T @ M @ basis
    basis = _krylov_basis(excited.T, basis[-1])
    return float(np.abs(np.linalg.eigvals(basis.T @ excited @ basis)).max())


def _krylov_basis(M: Array, start: Array) -> Array:
    """Return an orthonormal basis of the states that follow from one, shape (n, r)."""
    basis = np.zeros((len(M), 0))
    direction = start
    while basis.shape[1] < len(M):
        rest = direction - basis @ (basis.T @ direction)
        rest -= basis @ (basis.T @ rest)
        size = np.linalg.norm(rest)
        if size <= _NEGLIGIBLE * np.linalg.norm(direction):
            break
        basis = np.column_stack([basis, rest / size])
        direction = M @ basis[:, -1]
    return basis


@dataclass(frozen=True)
class OneAgent:
    """The law of a team for one agent that senses one target, exactly or late.

    Attributes:
        control: What its computer knows.
        delay: Age of its measurements, periods.
    """

    control: ControlArrays
    delay: int

    @cached_property
    def samples(self) -> int:
        """Samples from the start on after which counters no longer matter."""
        return self.delay + _SETTLING

    @property
    def memory(self) -> Memory:
        """Memory before the first sample."""
        return new_memory(self.control.law, 2)

    def by_age(self, sample: int) -> IntArray:
        """Return where in the memory before a sample its numbers are, those of a delay line by their age."""
        memory = self.memory
        memory.flat[:] = np.arange(len(memory.flat))
        if self.delay:
            cells = cells_of(self.control.law.links, memory.links, 0)
            cells.line[:] = np.roll(cells.line, -sample, axis=0)
            cells.received[:] = np.roll(cells.received, -sample, axis=0)
        return memory.flat.astype(np.int64)


def one_agent(law: LawArrays, gain: float, period: float, delay: int = 0) -> OneAgent:
    """Return a law as one agent runs it that senses one target, without limits, noise and losses.

    Args:
        law: Law of the team.
        gain: Gain k1, 1/s.
        period: Control period, s.
        delay: Age of measurements, periods.
    """
    row = np.array([[1.0, 0.0, 0.0]])
    none = np.zeros(2, dtype=np.int64)
    edges = EdgeArrays(
        tail=none[:1].copy(),
        head=none[:1] + 1,
        listens=np.array([[True, False]]),
        first=np.array([0, 1]),
        F_tail=row.copy(),
        F_head=row.copy(),
        P_tail=row.copy(),
        P_head=row.copy(),
        b=np.zeros(1),
    )
    motion = MotionArrays(
        pull=np.zeros(2),
        origin=np.zeros((2, 3)),
        amplitude=np.zeros((2, 3)),
        rate=np.zeros((2, 3)),
        phase=np.zeros((2, 3)),
        path=np.zeros((2, 2), dtype=np.int64),
        period=np.zeros(2),
        knots=np.zeros(0),
        coefficients=np.zeros((0, 6, 3)),
    )
    terms = _terms_of_one(law.terms)
    alone = LawArrays(edges, np.array([gain, 0.0]), np.full(2, np.inf), 0, terms, _late_link(terms, period, delay))
    return OneAgent(ControlArrays(alone, motion), delay)


def _terms_of_one(terms: TermArrays) -> TermArrays:
    """Return the terms of the first agent, over perfect rounds."""
    if not terms.agents:
        return terms
    return terms._replace(
        agents=1,
        dimension=np.ones(1, dtype=np.int64),
        sensing=np.array([0, 1]),
        lead=terms.lead[:1].copy(),
        settled=0,
        largest=np.inf,
        noise=0.0,
        bias=0.0,
        streams=np.zeros((1, 2), dtype=np.int64),
        rounds=no_rounds(),
    )


def _late_link(terms: TermArrays, period: float, delay: int) -> LinkArrays:
    """Return the link of one sensing edge whose measurements are so many periods old."""
    if not delay:
        return no_links()
    table = np.zeros(1, dtype=LINK)
    own = int(terms.feedforward > 0)
    table["received"] = (delay + 1) * (2 + own)
    table["own"] = own
    table["delay"] = delay
    table["range"] = np.inf
    size = int(table["received"][0]) + 2 * (3 + 2 * own)
    lift = np.zeros(2)
    return LinkArrays(table, np.zeros(1, dtype=np.int64), lift, np.zeros((0, 4)), size, own > 0, 0.0, period, 0, False)


@jit
def _answer(control, t, starts, positions, x, memory, ends, commands):
    """Evaluate the law once from each of K memories (K, n) and positions (K,), into ends (K, n) and commands (K,).

    `x` (2, 3) holds the position of the target, and that of the agent meanwhile.
    """
    for k in range(starts.shape[0]):
        for i in range(starts.shape[1]):
            memory.flat[i] = starts[k, i]
        x[0, 0] = positions[k]
        evaluate_law(control, t, x, None, memory)
        commands[k] = memory.command[0, 0]
        for i in range(starts.shape[1]):
            ends[k, i] = memory.flat[i]


class _Reader:
    """Answers of the law of one agent at one sample, to small motions from rest."""

    def __init__(self, agent: OneAgent, period: float) -> None:
        self.agent = agent
        self.period = period
        self.memory = agent.memory
        self.rest, _ = self.start(0.0)
        self.before = agent.by_age(agent.samples)
        self.after = agent.by_age(agent.samples + 1)
        self.cells = np.flatnonzero(self.rest[self.before] == 0.0)  # others count samples

    def weigh(self, value: float) -> None:
        """Let the target be sensed with a weight."""
        edges = self.agent.control.law.edges
        edges.P_tail[0, 0] = value
        edges.P_head[0, 0] = value

    def evaluate(self, sample: int, starts: Array, positions: Array) -> tuple[Array, Array]:
        """Return memories after a sample, shape (K, n), and commands, shape (K,), m/s."""
        ends = np.empty_like(starts)
        commands = np.empty(len(starts))
        _answer(
            self.agent.control, sample * self.period, starts, positions, np.zeros((2, 3)), self.memory, ends, commands
        )
        return ends, commands

    def start(self, position: float) -> tuple[Array, Array]:
        """Return the memory after the first samples of an ideal agent, and its positions up to then."""
        memory = self.agent.memory.flat[None]
        positions = [position]
        for k in range(self.agent.samples):
            memory, command = self.evaluate(k, memory, np.array(positions[-1:]))
            positions.append(positions[-1] + self.period * float(command[0]))
        return memory[0], np.array(positions)

    def columns(self, cells: IntArray, size: float) -> tuple[Array, Array]:
        """Return memory (K + 1, n) and command (K + 1,) per motion of each cell, the position the last."""
        count = len(cells)
        starts = np.repeat(self.rest[None], count + 1, axis=0)
        starts[np.arange(count), self.before[cells]] += size
        positions = np.zeros(count + 1)
        positions[count] = size
        ends, commands = self.evaluate(self.agent.samples, starts, positions)
        return (ends - self.end)[:, self.after] / size, commands / size

    @cached_property
    def end(self) -> Array:
        """Memory at rest one sample later."""
        return self.evaluate(self.agent.samples, self.rest[None], np.zeros(1))[0][0]


def linearise_law(law: LawArrays, gain: float, values: Array, period: float, delay: int = 0) -> LinearLaw:
    """Return the linear model of a law in eigenvectors of H with eigenvalues `values`, shape (L,).

    Args:
        law: Law of the team; noise, losses and limits are left out.
        gain: Gain k1, 1/s.
        values: Eigenvalues of H.
        period: Control period, s.
        delay: Age of measurements, periods.

    Raises:
        UndecidedError: The law is not linear.
    """
    reader = _Reader(one_agent(law, gain, period, delay), period)
    reader.weigh(float(values[-1]))
    cells = _cells_in_loop(reader)
    n = len(cells)
    A = np.zeros((len(values), n + 1, n))
    command = np.zeros((len(values), n + 1))
    start = np.zeros((len(values), n + 1))
    early = np.zeros((len(values), reader.agent.samples))
    for one, value in enumerate(values.tolist()):
        reader.weigh(value)
        ends, command[one] = reader.columns(cells, _SIZES[0])
        A[one] = ends[:, cells]
        memory, positions = reader.start(_SIZES[0])
        start[one, :n] = memory[reader.before[cells]] / _SIZES[0]
        start[one, n] = positions[-1] / _SIZES[0]
        early[one] = positions[:-1] / _SIZES[0]
    return LinearLaw(
        A[:, :n].swapaxes(1, 2), A[:, n], command[:, :n], command[:, n], start, reader.agent.samples, early, period
    )


def _cells_in_loop(reader: _Reader) -> IntArray:
    """Return the numbers remembered that depend on the position and on which the command depends.

    Raises:
        UndecidedError: The law is not linear.
    """
    cells = reader.cells
    n = len(cells)
    ends, command = reader.columns(cells, _SIZES[0])
    _require_linear(reader, cells, ends, command)
    acts = np.zeros((n + 1, n + 1), dtype=np.bool_)  # row on column, the position the last
    acts[:, :n] = ends[:, cells] != 0.0
    acts[:, n] = command != 0.0
    acts[n, n] = True
    graph = sparse.csr_array(acts)
    reached = breadth_first_order(graph, n, return_predecessors=False)
    seen = breadth_first_order(sparse.csr_array(graph.T), n, return_predecessors=False)
    both = np.intersect1d(reached, seen)
    return np.asarray(cells[both[both < n]])


def _require_linear(reader: _Reader, cells: IntArray, ends: Array, command: Array) -> None:
    """Raise an UndecidedError unless motions of another size, and of all numbers at once, have the same answer."""
    answer = np.column_stack([ends[:, cells], command])
    for size in (_SIZES[1], -_SIZES[0]):
        other_ends, other_command = reader.columns(cells, size)
        other = np.column_stack([other_ends[:, cells], other_command])
        if not np.allclose(other, answer, rtol=_LINEAR, atol=_LINEAR * np.abs(answer).max()):
            raise UndecidedError("the law is not linear about its equilibrium")
    mixed = np.random.default_rng(0).uniform(-1.0, 1.0, len(cells) + 1)
    start = reader.rest.copy()
    start[reader.before[cells]] += mixed[:-1] * _SIZES[0]
    end, moved = reader.evaluate(reader.agent.samples, start[None], mixed[-1:] * _SIZES[0])
    together = np.append((end[0] - reader.end)[reader.after][cells], moved) / _SIZES[0]
    if not np.allclose(together, mixed @ answer, rtol=_LINEAR, atol=_LINEAR * np.abs(answer).max()):
        raise UndecidedError("the law is not linear about its equilibrium")
