"""The law of a team as stages over its edges: measure, pull back, terms, reference, limit.

`evaluate_law` is the list of stages. Both backends run it once a control period (or inside the integrator, where the
control period is 0), and what it leaves in `Memory` is what runs record. On an edge e = (i, j) with maps F, weight K
and desired value b,

    measure     y_e = F_j x_j - F_i x_i
    deliver     y_e as sensor and link leave it, where the edge has any (see `mjsheaf.control.links`)
    pull back   eta_i = sum of -F_i^T K (y_e + b_e) over the edges whose tail is i, F_j^T K (y_e + b_e) where i is head
    terms       -k1 eta (eq. controller-1), or the velocities that a law in Python asks for
    reference   targets' own motion
    limit       largest commanded speed

An edge moves those of its ends that listen: both of a communication edge, the agent of a sensing edge or an anchor,
both targets of an edge among targets. A vehicle's sums touch its own edges alone, so that what it does depends on its
neighbours alone, to the bit.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.control.links import (
    LinkArrays,
    LinkMemory,
    carry_links,
    deliver,
    no_links,
    size_of_link_memory,
    split_link_memory,
)
from mjsheaf.control.terms import (
    TermArrays,
    TermMemory,
    add_terms,
    begin_sample,
    carry_terms,
    integrate,
    limit_speed,
    navigate,
    no_terms,
    remember,
    size_of_memory,
    split_memory,
)
from mjsheaf.dynamics.motion import MotionArrays, add_reference
from mjsheaf.jit import inline_jit, jit
from mjsheaf.team import Edge, Member, Team


class EdgeArrays(NamedTuple):
    """The edges of a team of V vehicles: E of them, with m numbers y_e in all.

    Attributes:
        tail, head: vehicles at the ends, shape (E,); an anchor's head is its tail.
        listens: whether tail and head are moved by the edge, shape (E, 2).
        first: where each edge's numbers begin in y, and m at the end, shape (E + 1,).
        F_tail, F_head: restriction maps, padded, shape (m, 3).
        P_tail, P_head: K F, of which the transpose pulls back, shape (m, 3).
        b: desired values of F_tail x_tail - F_head x_head, shape (m,), m.
    """

    tail: IntArray
    head: IntArray
    listens: BoolArray
    first: IntArray
    F_tail: Array
    F_head: Array
    P_tail: Array
    P_head: Array
    b: Array


class LawArrays(NamedTuple):
    """The law of V vehicles, the first N of them agents.

    Attributes:
        edges: what they compare.
        gain: of -gain eta, shape (V,), 1/s.
        limit: largest commanded speed, shape (V,), m/s; infinite where there is none.
        supplied: how many vehicles, from the first on, take their velocity from `Memory.supplied` instead of -gain eta.
        terms: what is added to -gain eta.
        links: what happens to measurements.
    """

    edges: EdgeArrays
    gain: Array
    limit: Array
    supplied: int
    terms: TermArrays
    links: LinkArrays

    @property
    def random(self) -> bool:
        """Whether random numbers enter."""
        return bool(self.links.table["random"].any()) or self.terms.noisy or self.terms.rounds.lossy


class ControlArrays(NamedTuple):
    """What onboard computers know.

    Attributes:
        law: the law.
        motion: references of the targets.
    """

    law: LawArrays
    motion: MotionArrays


class Memory(NamedTuple):
    """What onboard computers hold from one sample to the next: views of one array, which is saved with the state.

    Attributes:
        flat: all of it, shape (m + 9 V + what terms and links hold,).
        y: measurements as delivered, -b where nothing is heard, shape (m,), m.
        residual: eta of the agents by these, L_T p - c_T of the targets, padded, shape (V, 3), m.
        command: commanded velocities, limited, shape (V, 3), m/s.
        supplied: velocities that a law in Python asks for, shape (V, 3), m/s.
        terms: what the terms hold.
        links: what the links hold.
    """

    flat: Array
    y: Array
    residual: Array
    command: Array
    supplied: Array
    terms: TermMemory
    links: LinkMemory


def new_memory(law: LawArrays, V: int) -> Memory:
    """The memory of a law of V vehicles before its first sample: zeros."""
    m = len(law.edges.b)
    ends = np.cumsum([m, 9 * V, size_of_memory(law.terms, law.edges.first, V), size_of_link_memory(law.links, m)])
    flat = np.zeros(ends[-1])
    y, rest, terms, links, _ = np.split(flat, ends)
    residual, command, supplied = rest.reshape(3, V, 3)
    of_terms, of_links = split_memory(terms, law.terms, law.edges.first, V), split_link_memory(links, law.links, m)
    return Memory(flat, y, residual, command, supplied, of_terms, of_links)


def carry(memory: Memory, law: LawArrays) -> Memory:
    """The memory of another law of the same vehicles, who keep what they hold of themselves and what is under way.

    An agent without edges, which is lost or has yet to join, forgets B p', v and delta.
    """
    V, m = len(memory.command), len(memory.y)
    new = new_memory(law, V)
    vehicles = slice(len(new.y), len(new.y) + 9 * V)
    new.flat[vehicles] = memory.flat[m : m + 9 * V]
    carry_terms(memory.terms, new.terms)
    if law.terms.agents:
        edges, alone = law.edges, np.ones(V, dtype=np.bool_)
        alone[edges.tail[edges.listens[:, 0]]] = alone[edges.head[edges.listens[:, 1]]] = False
        for values in (new.terms.rate, new.terms.v, new.terms.delta):
            values[alone] = 0.0
    carry_links(memory.links, new.links)
    return new


@inline_jit
def evaluate_law(control, t, x, drift, memory):
    """Sample every onboard computer at time t, s: write memory.y, residual and command for positions x (V, 3), m.

    `drift` (V, 3), m/s, is what bodies measure of the medium that carries them; None on ideal kinematics.
    """
    law = control.law
    if law.terms.agents > 0:
        begin_sample(t, memory.terms)
        navigate(law.terms, x, drift, memory.command, memory.terms)
    hear(law, t, x, drift is not None, memory)
    proportional(law, memory.residual, memory.supplied, memory.command)
    if law.terms.agents > 0:
        add_terms(law, x, memory.y, memory.residual, memory.command, memory.terms, memory.links)
    for v in range(x.shape[0]):
        add_reference(control.motion, v, t, x[v], memory.command[v])
        clipped = limit_speed(law.limit[v], memory.command[v])
        if law.terms.agents > v and not clipped:
            integrate(law.terms, memory.residual[v], memory.terms.z[v])
    if law.terms.agents > 0:
        remember(law.terms, t, x, memory.y, memory.terms)


@inline_jit
def hear(law, t, x, bodies, memory):
    """Write into the memory what agents hear at time t, s, and eta by it; of `bodies` it holds the attitudes."""
    measure(law.edges, x, memory.y)
    if law.links.of.shape[0] > 0:
        deliver(law, t, x, bodies, memory.y, memory.terms, memory.links)
    pull_back(law.edges, memory.y, memory.residual)


@jit
def observe(law, t, x, bodies, memory):
    """`hear`, for a law in Python, before it is called."""
    hear(law, t, x, bodies, memory)


@inline_jit
def measure(edges, x, y):
    """Write y_e = F_head x_head - F_tail x_tail of every edge into y (m,) for positions x (V, 3)."""
    for e in range(edges.tail.shape[0]):
        tail, head = x[edges.tail[e]], x[edges.head[e]]
        for r in range(edges.first[e], edges.first[e + 1]):
            F, G = edges.F_head[r], edges.F_tail[r]
            y[r] = (F[0] * head[0] + F[1] * head[1] + F[2] * head[2]) - (
                G[0] * tail[0] + G[1] * tail[1] + G[2] * tail[2]
            )


@inline_jit
def pull_back(edges, y, residual):
    """Write delta^T K (delta x - b), summed at the vehicles that listen, into residual (V, 3), from y (m,)."""
    for v in range(residual.shape[0]):
        residual[v, 0], residual[v, 1], residual[v, 2] = 0.0, 0.0, 0.0
    for e in range(edges.tail.shape[0]):
        tail, head = residual[edges.tail[e]], residual[edges.head[e]]
        for r in range(edges.first[e], edges.first[e + 1]):
            z = y[r] + edges.b[r]
            if edges.listens[e, 0]:
                for i in range(3):
                    tail[i] -= edges.P_tail[r, i] * z
            if edges.listens[e, 1]:
                for i in range(3):
                    head[i] += edges.P_head[r, i] * z


@inline_jit
def proportional(law, residual, supplied, command):
    """Write into command (V, 3) -gain eta, or of the first law.supplied vehicles what a law in Python asks for."""
    for v in range(residual.shape[0]):
        for i in range(3):
            command[v, i] = supplied[v, i] if v < law.supplied else -law.gain[v] * residual[v, i]


@jit
def _disagreement(law, x, y, residual):
    """Write residual (T, V, 3) for positions x (T, V, 3), m, and leave the last measurements in y (m,)."""
    for k in range(x.shape[0]):
        measure(law.edges, x[k], y)
        pull_back(law.edges, y, residual[k])


def disagreement(law: LawArrays, positions: Array) -> Array:
    """eta = delta^T K (delta x - b) of every vehicle, as the loops compute it where links are exact.

    Args:
        law: the law.
        positions: padded, shape (..., V, 3), m.

    Returns:
        Of the same shape, m; of targets L_T p - c_T, zero in what a vehicle has no coordinate for.
    """
    x = np.ascontiguousarray(positions, dtype=np.float64)
    flat = x.reshape(-1, *x.shape[-2:])
    residual = np.empty_like(flat)
    _disagreement(law, flat, np.empty(len(law.edges.b)), residual)
    return residual.reshape(x.shape)


def pack_law(
    team: Team,
    gain: float,
    target_gain: float,
    limits: Array,
    terms: TermArrays | None = None,
    links: LinkArrays | None = None,
) -> LawArrays:
    """Assemble the law of a team.

    Args:
        team: the team.
        gain: k1 of the agents, 1/s.
        target_gain: gain of the targets' own consensus, 1/s; 0 where they have none.
        limits: largest commanded speed of each vehicle, m/s, shape (V,).
        terms: beyond the paper's law.
        links: of its edges; exact unless given.
    """
    gains = np.concatenate([np.full(len(team.agents), gain), np.full(len(team.targets), target_gain)])
    kinds = [(team.communication, True), (team.sensing, False), (team.target_edges, True), (team.anchors, False)]
    edges = pack_edges(team.members, kinds)
    return LawArrays(edges, gains, limits.astype(float), 0, terms or no_terms(), links or no_links())


def pack_edges(members: Sequence[Member], kinds: Sequence[tuple[Sequence[Edge], bool]]) -> EdgeArrays:
    """Edges as arrays.

    Args:
        members: the vehicles.
        kinds: edges, and whether their heads listen too.
    """
    number = {member.id: v for v, member in enumerate(members)}
    edges = [(e, both) for kind, both in kinds for e in kind]
    first = np.cumsum([0, *(len(e.b) for e, _ in edges)])
    maps = np.zeros((4, first[-1], 3))
    for (e, _), begin, end in zip(edges, first, first[1:], strict=False):
        for padded, F in zip(maps, (e.F_tail, e.F_head, e.weight @ e.F_tail, e.weight @ e.F_head), strict=True):
            padded[begin:end, : F.shape[1]] = F
    return EdgeArrays(
        np.array([number[e.tail] for e, _ in edges], dtype=np.int64),
        np.array([number.get(e.head, number[e.tail]) for e, _ in edges], dtype=np.int64),
        np.array([(True, both) for _, both in edges], dtype=np.bool_).reshape(-1, 2),
        first.astype(np.int64),
        maps[0],
        maps[1],
        maps[2],
        maps[3],
        np.concatenate([np.zeros(0), *(e.b for e, _ in edges)]),
    )
