"""The law of a team as stages over its edges: measure, pull back, terms, reference, limit.

`evaluate_law` is the list of stages. Both backends run it once a control period (or inside the integrator, where the
control period is 0), and what it leaves in `Memory` is what runs record. On an edge e = (i, j) with maps F, weight K
and desired value b,

    offsets     b_e, where formations change (see `mjsheaf.law.edges`)
    measure     y_e = F_j x_j - F_i x_i
    deliver     y_e after its sensor and link, if the edge has any (see `mjsheaf.law.edges`)
    compare     y_e + b_e as it is, or what a range or bearing edge makes of it (see `mjsheaf.law.edges`)
    pull back   eta_i = sum of -F_i^T K (y_e + b_e) over the edges whose tail is i, F_j^T K (y_e + b_e) where i is head
    terms       -k1 eta (eq. controller-1), or the velocities that a law in Python commands
    custom      terms that users registered (see `mjsheaf.law.custom`)
    residual    velocities from outside, such as the action of an environment
    reference   targets' own motion
    safety      the safety filter, which keeps vehicles apart (see `mjsheaf.law.safety`)
    limit       largest commanded speed

An edge moves both ends if it is a communication edge or an edge among targets, and only the agent if it is a sensing
edge or an anchor (`EdgeArrays.listens`). The sums of a vehicle run over its own edges only, so its command depends on
its neighbours alone, bit for bit.

Station keeping is not part of the law: each vehicle that has not joined yet holds its position by itself. Vehicle v at
x commands gain (position - x) - w relative to the medium, whose velocity w it measures there. Over ground, it returns
to its position at the rate of the gain. Its speed limit is that of its other commands. The gain is 1 / (4 (tau + h)),
at most MAX_GAIN, with the time constant tau of the body and the control period h: the loop of position and velocity is
then critically damped or slower.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray, IntArray, Room, lay_out
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.law.custom import add_custom, carry_custom, names_of, new_custom_memory
from mjsheaf.law.edges import (
    LinkArrays,
    LinkMemory,
    OffsetRamp,
    compare,
    deliver,
    line_of,
    move_offsets,
    new_link_memory,
    pack_kinds,
)
from mjsheaf.law.paths import MotionArrays, add_reference
from mjsheaf.law.safety import SafetyMemory, is_restrained, keep_apart, new_safety_memory
from mjsheaf.law.terms import (
    TermArrays,
    TermMemory,
    add_terms,
    carry_terms,
    integrate,
    limit_speed,
    navigate,
    new_lines,
    new_term_memory,
    remember,
    require_symmetric,
)
from mjsheaf.team import Edge, Member, Team


class EdgeArrays(NamedTuple):
    """The edges of a team of V vehicles: E of them, with m numbers y_e in all.

    Attributes:
        tail, head: Numbers of the vehicles at the ends, shape (E,); an anchor's head is its tail.
        listens: True if the edge moves its tail, and its head, shape (E, 2).
        first: Index in y at which each edge's numbers begin, and m, shape (E + 1,).
        F_tail, F_head: Restriction maps, padded, shape (m, 3).
        P_tail, P_head: K F, whose transpose pulls back, shape (m, 3).
        b: Desired values of F_tail x_tail - F_head x_head, shape (m,), m.
        kinds: EdgeKinds; () if all edges compare positions.
        ramp: OffsetRamp if b and the desired values of `kinds` change; they are then those of the last evaluation. ()
            if they are constant.
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
    kinds: Any = ()
    ramp: Any = ()


class LawArrays(NamedTuple):
    """The law of V vehicles, the first N of them agents.

    Attributes:
        edges: Edges of the team.
        gain: Proportional gain k1 of each vehicle, shape (V,), 1/s.
        limit: Largest commanded speed, shape (V,), m/s; infinite if there is none.
        supplied: Number of vehicles, the first ones, whose velocity is `Memory.supplied` instead of -gain eta.
        terms: Terms that are added to -gain eta.
        links: Links and sensors of the edges.
        custom: Terms that users registered, of the types that `mjsheaf.law.custom` makes.
        safety: SafetyArrays of the safety filter; () without one.
        seed: Seed of the random numbers of links and terms, shape (1,).
    """

    edges: EdgeArrays
    gain: Array
    limit: Array
    supplied: int
    terms: TermArrays
    links: LinkArrays
    custom: tuple[Any, ...] = ()
    safety: Any = ()
    seed: IntArray = np.zeros(1, dtype=np.int64)

    @property
    def term_names(self) -> tuple[str, ...]:
        """Names of the terms beyond -k1 eta."""
        return self.terms.names + names_of(self.custom)

    def selected(self, rows: IntArray, agents: int) -> "LawArrays":
        """Return the law of some vehicles, the first `agents` of them agents; all edges are between them."""
        number = np.zeros(len(self.gain), dtype=np.int64)
        number[rows] = np.arange(len(rows))
        return self._replace(
            edges=self.edges._replace(tail=number[self.edges.tail], head=number[self.edges.head]),
            gain=self.gain[rows],
            limit=self.limit[rows],
            terms=self.terms.selected(rows[:agents]),
            links=self.links.selected(rows),
            custom=tuple(term._replace(agents=agents) for term in self.custom),
        )

    @property
    def without_terms(self) -> "LawArrays":
        """Return the paper's law: the same without terms."""
        return self._replace(terms=TermArrays(), custom=())

    @property
    def extended(self) -> bool:
        """Return True if the law has terms in addition to -k1 eta."""
        return bool(self.terms.agents or self.custom)

    @property
    def random(self) -> bool:
        """Return True if the law uses random numbers."""
        terms = self.terms
        noisy = terms.noise > 0.0 and (terms.feedforward > 0 or terms.drift > 0.0)
        return bool(self.links.table["random"].any()) or noisy or terms.rounds.loss.lossy


class ControlArrays(NamedTuple):
    """Parameters of the onboard computers.

    Attributes:
        law: Law of the vehicles.
        motion: References of the targets.
    """

    law: LawArrays
    motion: MotionArrays


def with_seed(law: LawArrays, seed: int) -> LawArrays:
    """Return a law whose links and terms draw from another seed."""
    return law._replace(seed=np.array([seed]))


class Memory(NamedTuple):
    """State of the onboard computers between samples: parts of one array.

    Attributes:
        flat: The part of the array that is state of the run: this memory, and the parts laid out before it.
        y: Delivered measurements, -b if nothing is received, shape (m,), m.
        residual: eta of the agents by these, L_T p - c_T of the targets, padded, shape (V, 3), m.
        command: Commanded velocities, limited, shape (V, 3), m/s.
        supplied: Velocities commanded by a law in Python, shape (V, 3), m/s; without one, velocities added to the
            compiled law's.
        held: Numbers on which the next sample depends, command included, shape (k,).
        kept: 1 + the number of a step, and `held` before the law was evaluated there, shape (1 + k,); see `look`.
        terms: State of the terms.
        links: State of the links.
        custom: State of each registered term for each vehicle, shape (V, k).
        compared: Vectors that are pulled back, minus b, shape (m,); y itself if all edges compare positions.
        safety: Results of the safety filter at the last sample; not part of the state.
        evaluated: Number of the registered term called last, its vehicle, and the time, s, shape (3,); not part of the
            state.
    """

    flat: Array
    y: Array
    residual: Array
    command: Array
    supplied: Array
    held: Array
    kept: Array
    terms: TermMemory
    links: LinkMemory
    custom: tuple[Array, ...]
    compared: Array
    safety: SafetyMemory
    evaluated: Array


def new_memory(law: LawArrays, V: int, room: Room | None = None) -> Memory:
    """Return the memory of a law of V vehicles before its first sample: zeros, from a room or a new array."""
    if room is None:
        return lay_out(lambda room: new_memory(law, V, room))[1]
    m, first, take = len(law.edges.b), law.edges.first, room.take
    y = take(m)
    compared = take(m) if law.edges.kinds else y
    residual, supplied = take((V, 3)), take((V, 3))
    lines, line = new_lines(law.terms.rounds, first, take), take(law.links.size)
    before = room.taken
    command = take((V, 3))
    terms = new_term_memory(law.terms, first, V, lines, take)
    custom = new_custom_memory(law.custom, V, take)
    links = new_link_memory(law.links, m, line, take)
    held = room.since(before)
    return Memory(
        flat=room.since(0),
        y=y,
        residual=residual,
        command=command,
        supplied=supplied,
        held=held,
        kept=take(1 + len(held)),
        terms=terms,
        links=links,
        custom=custom,
        compared=compared,
        safety=new_safety_memory(law.safety, V, take),
        evaluated=take(3),
    )


def carry(memory: Memory, old: LawArrays, law: LawArrays, sample: int, new: Memory | None = None) -> Memory:
    """Return the memory of the same vehicles under the law of a phase that begins at a sample; fill `new` if given.

    Vehicles keep their own state. An edge that remains keeps its measurements, the messages received over it and those
    in transit. An agent without edges (lost, or not joined yet) resets v and delta.
    """
    V = len(memory.command)
    new = new or new_memory(law, V)
    for name in ("residual", "command", "supplied"):
        getattr(new, name)[:] = getattr(memory, name)
    carry_custom(old.custom, memory.custom, law.custom, new.custom)
    kept, rows = edges_kept(old.edges, law.edges)
    gone = np.ones(len(old.edges.tail), dtype=np.bool_)
    gone[kept[kept >= 0]] = False
    changed = np.zeros(V, dtype=np.bool_)  # vehicles moved by an edge that is new or was removed
    for edges, which in ((old.edges, gone), (law.edges, kept < 0)):
        changed[edges.tail[which & edges.listens[:, 0]]] = True
        changed[edges.head[which & edges.listens[:, 1]]] = True
    carry_terms(memory.terms, new.terms, kept, rows, changed)
    if len(old.links.of) or len(law.links.of):
        _carry_links(memory, old, new, law, kept, sample)
    if law.terms.agents:
        if not old.terms.feedforward:  # filters of velocities begin, and rounds from v = 0
            np.minimum(new.terms.age, 1.0, out=new.terms.age)
            new.terms.since[:] = 0.0
            new.terms.v[:] = 0.0
        edges, alone = law.edges, np.ones(V, dtype=np.bool_)
        alone[edges.tail[edges.listens[:, 0]]] = alone[edges.head[edges.listens[:, 1]]] = False
        for values in (new.terms.v, new.terms.delta):
            values[alone] = 0.0
    return new


def edges_kept(old: EdgeArrays, new: EdgeArrays) -> tuple[IntArray, IntArray]:
    """Find the edges that two laws share: edges of the same kind and ends, with the same maps.

    Returns:
        The number of each new edge among the old ones, shape (E,), and the old indices of its y_e, shape (m,); -1 for
        an edge that is not among them.
    """
    known = {name: e for e, name in enumerate(_names(old))}
    kept = np.array([known.get(name, -1) for name in _names(new)], dtype=np.int64)
    size, size_before = np.diff(new.first), np.diff(old.first)
    kept[kept >= 0] = np.where(size_before[kept[kept >= 0]] == size[kept >= 0], kept[kept >= 0], -1)
    edge = np.repeat(np.arange(len(size)), size)
    rows = np.where(kept[edge] >= 0, old.first[kept[edge]] + np.arange(len(edge)) - new.first[edge], -1)
    there = rows >= 0
    other = np.zeros(len(rows), dtype=np.bool_)
    for name in ("F_tail", "F_head"):
        other[there] |= (getattr(new, name)[there] != getattr(old, name)[rows[there]]).any(axis=1)
    kept[edge[other]] = -1
    return kept, np.where(kept[edge] >= 0, rows, -1)


def _names(edges: EdgeArrays) -> Iterator[tuple[int, int, bool, int]]:
    """Yield tail, head, True if the edge moves both, and its number among edges equal in these three, for each edge."""
    met = dict[tuple[int, int, bool], int]()
    for tail, head, both in zip(edges.tail.tolist(), edges.head.tolist(), edges.listens[:, 1].tolist(), strict=True):
        nth = met.get((tail, head, both), 0)
        met[tail, head, both] = nth + 1
        yield tail, head, both, nth


def _carry_links(memory: Memory, old: LawArrays, new: Memory, law: LawArrays, kept: IntArray, sample: int) -> None:
    """Carry the state of links over to the next phase, also for edges with a link in only one of them: see `carry`."""
    before, now = memory.links, new.links
    if len(before.attitude) == len(now.attitude):  # sensors need it in both phases, or in neither
        now.attitude[:] = before.attitude
        now.before[:] = before.before
    for e in np.flatnonzero(kept >= 0).tolist():
        earlier = int(kept[e])
        k, k_now = link_of(old, earlier), link_of(law, e)
        was, rows = slice(*old.edges.first[earlier : earlier + 2]), slice(*law.edges.first[e : e + 2])
        if k >= 0 and k_now >= 0:
            link, link_now = old.links.table[k], law.links.table[k_now]
            if link_now["moves"] > link["moves"]:  # feedforward needs the displacement of every sample
                continue
            line, line_now = line_of(before, link), line_of(now, link_now)
            under_way = line[line[:, 0] > sample - min(link["delay"], link_now["delay"])]
            line_now[(under_way[:, 0].astype(np.int64) - 1) % len(line_now)] = under_way[:, : link_now["width"]]
            now.state[k_now] = before.state[k]
            if before.last[k] > 0.0:  # the age counts from the arrival
                now.last[k_now] = before.last[k] + link_now["delay"] - link["delay"]
            now.y[rows] = before.y[was]
            if link_now["moves"]:
                now.walked[rows] = before.walked[was]
        elif k_now >= 0 and sample > 0 and not law.links.table[k_now]["delay"]:
            now.last[k_now] = sample
            now.y[rows] = memory.y[was]
            if law.links.table[k_now]["moves"] and old.terms.agents:
                now.walked[rows] = old.edges.F_tail[was] @ memory.terms.walked[old.edges.tail[earlier]]
        elif k >= 0 and k_now < 0 and law.terms.agents and old.terms.agents:
            fresh = old.links.table[k]["delay"] == 0 and before.last[k] == sample
            new.terms.age[rows] = 2.0 * fresh  # else the difference to the next measurement means nothing


def link_of(law: LawArrays, edge: int) -> int:
    """Return the number of an edge's link, or -1."""
    return int(law.links.of[edge]) if len(law.links.of) else -1


@inline_jit
def evaluate_law(control, t, x, carried, memory):
    """Sample every onboard computer at time t, s: write memory.y, residual and command for positions x (V, 3), m.

    `carried` (V, 3), m/s, is what bodies measure of the medium that carries them; None on ideal kinematics.
    """
    law, edges = control.law, control.law.edges
    V = x.shape[0]
    move_offsets(edges.ramp, edges.kinds, edges, t)
    navigate(law.terms.present, law, x, carried, memory.command, memory.terms)
    measure(edges, x, memory.y)
    deliver(law.links.present, law, t, x, carried is not None, memory.y, memory.terms, memory.links)
    compare(edges.kinds, edges, memory.y, memory.compared)
    pull_back(edges, memory.compared, memory.residual)
    for v in range(V):
        for i in range(3):
            memory.command[v, i] = memory.supplied[v, i] if v < law.supplied else -law.gain[v] * memory.residual[v, i]
    add_terms(law.terms.present, law, x, memory)
    add_custom(law.custom, memory.custom, None, t, memory.residual, memory.command, memory.evaluated)
    for v in range(V):
        for i in range(3):
            if v >= law.supplied and memory.supplied[v, i] != 0.0:  # adding zeros would turn -0.0 into 0.0
                memory.command[v, i] += memory.supplied[v, i]
        add_reference(control.motion, v, t, x[v], memory.command[v])
    keep_apart(law.safety, law.limit, t, x, memory)
    for v in range(V):
        clipped = limit_speed(law.limit[v], memory.command[v]) or is_restrained(law.safety, memory.safety, v)
        if not clipped:
            integrate(law.terms.present, law.terms, v, memory.residual[v], memory.terms)
    remember(law.terms.present, law.terms, x, memory.y, memory.terms)


@inline_jit
def look(step, held, kept):
    """Save the state of the onboard computers at a step at which the law is evaluated, possibly again; see `unlook`."""
    unlook(step, held, kept)
    kept[0] = step + 1.0
    for k in range(held.shape[0]):
        kept[1 + k] = held[k]


@inline_jit
def unlook(step, held, kept):
    """Restore the state of the onboard computers from before the law was evaluated at this step, if it was.

    A sample counts once, however often the law is evaluated at it before the next step.
    """
    if kept[0] == step + 1.0:
        for k in range(held.shape[0]):
            held[k] = kept[1 + k]


@inline_jit
def measure(edges, x, y):
    """Write y_e = F_head x_head - F_tail x_tail into y (m,), for positions x (V, 3)."""
    for e in range(edges.tail.shape[0]):
        tail, head = x[edges.tail[e]], x[edges.head[e]]
        for r in range(edges.first[e], edges.first[e + 1]):
            F, G = edges.F_head[r], edges.F_tail[r]
            y[r] = (F[0] * head[0] + F[1] * head[1] + F[2] * head[2]) - (
                G[0] * tail[0] + G[1] * tail[1] + G[2] * tail[2]
            )


@inline_jit
def pull_back(edges, y, residual):
    """Write delta^T K (delta x - b) into residual (V, 3), from y (m,)."""
    residual[:] = 0.0
    for e in range(edges.tail.shape[0]):
        tail, head = residual[edges.tail[e]], residual[edges.head[e]]
        moves_tail, moves_head = edges.listens[e, 0], edges.listens[e, 1]
        for r in range(edges.first[e], edges.first[e + 1]):
            z = y[r] + edges.b[r]
            P, Q = edges.P_tail[r], edges.P_head[r]
            for i in range(3):
                if moves_tail:
                    tail[i] -= P[i] * z
                if moves_head:
                    head[i] += Q[i] * z


@inline_jit
def disagree(edges, x, y, residual):
    """Write eta (V, 3) of all vehicles at positions x (V, 3) over exact links; y (m,) is overwritten."""
    measure(edges, x, y)
    compare(edges.kinds, edges, y, y)
    pull_back(edges, y, residual)


@jit
def _disagreement(law, times, x, y, residual):
    for k in range(x.shape[0]):
        move_offsets(law.edges.ramp, law.edges.kinds, law.edges, times[k])
        disagree(law.edges, x[k], y, residual[k])


def disagreement(law: LawArrays, positions: Array, times: Array | None = None) -> Array:
    """Compute eta = delta^T K (delta x - b) of every vehicle, as the loops do over exact links.

    Args:
        law: The law.
        positions: Positions, padded, shape (..., V, 3), m.
        times: Time of each of them, s, if offsets change; see `with_ramp`.

    Returns:
        eta of agents and L_T p - c_T of targets, padded, shape (..., V, 3), m.
    """
    x = np.ascontiguousarray(positions, dtype=np.float64)
    flat = x.reshape(-1, *x.shape[-2:])
    residual = np.empty_like(flat)
    _disagreement(law, np.zeros(len(flat)) if times is None else times, flat, np.empty(len(law.edges.b)), residual)
    return residual.reshape(x.shape)


def pack_law(
    team: Team,
    gain: float,
    target_gain: float | Array,
    limits: Array,
    terms: TermArrays | None = None,
    links: LinkArrays | None = None,
    custom: tuple[Any, ...] = (),
    seed: int = 0,
) -> LawArrays:
    """Assemble the law of a team.

    Args:
        team: The team.
        gain: k1 of the agents, 1/s.
        target_gain: Gain of the targets' own consensus, 1/s, or that of each, shape (M,); 0 if they have none.
        limits: Largest commanded speed of each vehicle, shape (V,), m/s.
        terms: Terms in addition to the paper's law.
        links: Links of its edges; exact unless given.
        custom: Registered terms.
        seed: Seed of the run.
    """
    gains = np.concatenate([np.full(len(team.agents), gain), np.broadcast_to(target_gain, len(team.targets))])
    terms = terms or TermArrays()
    if team.directed:
        require_symmetric(terms)
    law = LawArrays(edges_of(team), gains, limits.astype(float), 0, terms, links or LinkArrays(), custom)
    return with_seed(law, seed)


def edges_of(team: Team) -> EdgeArrays:
    """Return all edges of a team as arrays."""
    kinds = [(team.communication, True), (team.sensing, False), (team.target_edges, True), (team.anchors, False)]
    return pack_edges(team.members, kinds)


def with_ramp(law: LawArrays, team: Team) -> LawArrays:
    """Return the law of a team whose offsets change, in arrays of its own; itself if they stay."""
    if team.ramp is None:
        return law
    first, last = (
        np.concatenate([np.zeros(0), *(e.aim for e in (*t.communication, *t.sensing, *t.target_edges, *t.anchors))])
        for t in (team.ramp.first, team.ramp.last)
    )
    rate = (last - first) / (team.ramp.end - team.ramp.start)
    edges = law.edges
    kinds = edges.kinds
    if kinds:
        kinds = kinds._replace(desired=kinds.desired.copy())
    return law._replace(
        edges=edges._replace(
            b=edges.b.copy(),
            kinds=kinds,
            ramp=OffsetRamp(team.ramp.start, first, rate, first.copy()),
        )
    )


def pack_edges(members: Sequence[Member], kinds: Sequence[tuple[Sequence[Edge], bool]]) -> EdgeArrays:
    """Pack edges into arrays.

    Args:
        members: The vehicles.
        kinds: Lists of edges, each with True if its edges also move their heads.
    """
    edges = [e for kind, _ in kinds for e in kind]
    listens = np.array([(True, both and not e.directed) for kind, both in kinds for e in kind], dtype=np.bool_)
    first = np.cumsum([0, *(len(e.b) for e in edges)])
    maps = np.zeros((4, first[-1], 3))
    for e, begin, end in zip(edges, first, first[1:], strict=False):
        for padded, F in zip(maps, (e.F_tail, e.F_head, e.weight @ e.F_tail, e.weight @ e.F_head), strict=True):
            padded[begin:end, : F.shape[1]] = F
    number = {member.id: v for v, member in enumerate(members)}
    tail = np.array([number[e.tail] for e in edges], dtype=np.int64)
    head = np.array([number.get(e.head, number[e.tail]) for e in edges], dtype=np.int64)  # an anchor's is its tail
    b = np.concatenate([np.zeros(0), *(e.b for e in edges)])
    first, listens = first.astype(np.int64), listens.reshape(-1, 2)
    F_tail, F_head, P_tail, P_head = maps
    return EdgeArrays(tail, head, listens, first, F_tail, F_head, P_tail, P_head, b, pack_kinds(edges))


MAX_GAIN = 1.0
"""Largest gain of station keeping, 1/s."""


class Station(NamedTuple):
    """Positions that vehicles hold, for compiled code.

    Attributes:
        holds: True for each vehicle that holds its position, shape (V,).
        position: Controlled position to hold, padded, shape (V, 3), m.
        gain: Gain of each vehicle, shape (V,), 1/s.
        limit: Largest commanded speed of each vehicle, shape (V,), m/s.
    """

    holds: BoolArray
    position: Array
    gain: Array
    limit: Array

    def with_time_constants(self, tau: Array, period: float) -> "Station":
        """Return the same station with gains for time constants tau (V,) and a control period, in s."""
        delay = np.maximum(tau + period, 0.25 / MAX_GAIN)
        return self._replace(gain=0.25 / delay)


def no_station(V: int) -> Station:
    """Return a station that none of V vehicles keeps."""
    return Station(np.zeros(V, dtype=np.bool_), np.zeros((V, 3)), np.zeros(V), np.full(V, np.inf))


@inline_jit
def keep_station(station, v, x, w, command):
    """Write into command (3,) the velocity with which vehicle v at x (3,) holds its position in a medium at w (3,)."""
    for i in range(3):
        command[i] = station.gain[v] * (station.position[v, i] - x[i]) - w[i]
    limit_speed(station.limit[v], command)
