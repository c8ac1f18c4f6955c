"""Edges in the law: what range and bearing edges compare, and what links and sensors deliver.

Range and bearing edges are a stage between measurement and pullback. Let z = y + b be the relative position of an edge
and g = z / |z|. The vector pulled back instead of z is

    range      (1 - r / |z|) z
    bearing    (g . g*) g - g*

(see `mjsheaf.sheaf.nonlinear`), and zero if z is 0, as without a measurement. The kinds of a team's edges are a named
tuple in `EdgeArrays`, or () if all edges compare positions. The type () makes numba compile nothing for this stage.

Rounds of feedforward and newton solve with H = sum F^T w M F over edges, F x = F_head x_head - F_tail x_tail. M is that
of the measured z: g g^T of a range, min(1 / |z|, s) (I - g g^T) of a bearing, with s twice 1 / |z| at the initial
q*, and 0 if z is 0. Projections are between 0 and I, so 0 <= M <= a I with a = 1 of a range and a = s of a bearing, and

    0 <= H <= sum a w F^T F    at every x,

whose largest eigenvalue is the upper bound that Chebyshev's iteration takes. Its polynomial is between 0 and 1 from 0
to the lower bound: a lower bound that is too large for the present H slows the rounds down, and no error grows in them.

Links and sensors are the stage after `measure`, which replaces the truth by what agents receive. Of every edge with a
link, at sample n, in this order:

    loss       the link's chain changes state, and the measurement is lost with the probability of that state
    range      beyond its range the link receives nothing
    sensor     the tail's errors are added to y_e: white noise and bias, or those of range and bearing in its body frame
    delay      what was measured d periods ago arrives, if it was sent
    hold       without an arrival the last measurement is held for a limited time; then y_e = -b_e, which has no effect

Random numbers are those of the edge's stream at n (see `mjsheaf.noise`), so they do not depend on the pieces of a run,
on threads or on the machine.

Numbers that agents send each other in rounds have links of their own: see `mjsheaf.law.terms`.

While formations change, every edge has a vector a(t), its aim, that moves in a straight line. The aim of a position
edge is b. That of a range or bearing edge is the vector from head to tail between the positions in the formation.
Desired values follow from it: b = a, r = |a|, g* = -a / |a|. Let a' be the rate of a. For a constant measurement, the
vector that is pulled back changes at the rate

    position   a'
    range      -g (a . a') / |a|
    bearing    P_g (a' - a (a . a') / |a|^2) / |a|,    P_g = I - g g^T
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.arrays import Array, IntArray, Take
from mjsheaf.compile.jit import as_records, inline_jit, jit
from mjsheaf.errors import InputError, in_field
from mjsheaf.noise import normal_of, stream_of, uniforms
from mjsheaf.sheaf.nonlinear import MEASURES
from mjsheaf.team import Edge, Team
from mjsheaf.team.links import KINDS, WHOLE, LinkModel, Links, perceive, require_bearing, whole_periods

POSITION, RANGE, BEARING = 0, 1, 2
"""Kinds of edges."""


class EdgeKinds(NamedTuple):
    """Kinds of the edges of a team.

    Attributes:
        code: POSITION, RANGE or BEARING, shape (E,).
        desired: The distance in the first number of a range edge, the unit vector of a bearing edge, shape (m,).
    """

    code: IntArray
    desired: Array


def pack_kinds(edges: Sequence[Edge]) -> Any:
    """Return the EdgeKinds of edges; () if all compare positions."""
    if all(edge.measures == "position" for edge in edges):
        return ()
    desired = []
    for edge in edges:
        value = np.zeros(len(edge.F_tail))
        if edge.measures != "position" and edge.offset is not None:
            value[: len(edge.offset)] = edge.offset
        desired.append(value)
    code = np.array([MEASURES.index(edge.measures) for edge in edges], dtype=np.int64)
    return EdgeKinds(code, np.concatenate(desired))


class OffsetRamp(NamedTuple):
    """Offsets of the edges of a team that change; see the module.

    Attributes:
        start: Time at which they begin to change, s.
        first: Aims at the start, shape (m,), m.
        rate: Their velocities, shape (m,), m/s.
        aim: Aims at the last evaluation of the law, shape (m,), m. Like b and the desired values, each run has its own.
    """

    start: float
    first: Array
    rate: Array
    aim: Array


@inline_jit
def move_offsets(ramp, kinds, edges, t):
    """Write the aims, b and desired values at time t, s, if they change."""
    if len(ramp) == 0:
        return
    for e in range(edges.tail.shape[0]):
        square = 0.0
        for r in range(edges.first[e], edges.first[e + 1]):
            ramp.aim[r] = ramp.first[r] + (t - ramp.start) * ramp.rate[r]
            square += ramp.aim[r] * ramp.aim[r]
        for r in range(edges.first[e], edges.first[e + 1]):
            if len(kinds) == 0:  # noqa: SIM114 - then there are no codes
                edges.b[r] = ramp.aim[r]
            elif kinds.code[e] == POSITION:
                edges.b[r] = ramp.aim[r]
            elif kinds.code[e] == RANGE:
                kinds.desired[r] = np.sqrt(square) if r == edges.first[e] else 0.0
            else:
                kinds.desired[r] = -ramp.aim[r] / np.sqrt(square)


@inline_jit
def add_changes(ramp, kinds, edges, agents, y, right):
    """Add to the right side (V, 3) of H v = B p' the contribution of changing offsets, at measurements y (m,)."""
    if len(ramp) == 0:
        return
    for e in range(edges.tail.shape[0]):
        i, j = edges.tail[e], edges.head[e]
        for r in range(edges.first[e], edges.first[e + 1]):
            change = change_of(kinds, ramp, edges, y, e, r)
            for c in range(3):
                if edges.listens[e, 0] and i < agents:
                    right[i, c] += edges.P_tail[r, c] * change
                if edges.listens[e, 1] and j < agents:
                    right[j, c] -= edges.P_head[r, c] * change


@inline_jit
def change_of(kinds, ramp, edges, y, e, r):
    """Return the rate of row r of the vector that edge e pulls back, at measurements y (m,), m/s; see the module."""
    if len(kinds) == 0:
        return ramp.rate[r]
    if kinds.code[e] == POSITION:
        return ramp.rate[r]
    square, length2, growth, turn, lean = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(edges.first[e], edges.first[e + 1]):
        z, aim = y[k] + edges.b[k], ramp.aim[k]
        square += z * z
        length2 += aim * aim
        growth += aim * ramp.rate[k]
        turn += z * ramp.rate[k]
        lean += z * aim
    if square == 0.0:
        return 0.0
    z, share = y[r] + edges.b[r], growth / length2
    if kinds.code[e] == RANGE:
        return -growth / np.sqrt(length2 * square) * z
    return (ramp.rate[r] - share * ramp.aim[r] - (turn - share * lean) / square * z) / np.sqrt(length2)


@inline_jit
def compare(kinds, edges, y, out):
    """Write the vectors that are pulled back, minus b, into out (m,), from measurements y (m,); out may be y.

    Nothing is written if all edges compare positions: then they are y itself.
    """
    if len(kinds) == 0:
        return
    for e in range(edges.tail.shape[0]):
        first, end = edges.first[e], edges.first[e + 1]
        if kinds.code[e] == POSITION:
            for r in range(first, end):
                out[r] = y[r]
            continue
        square, along = 0.0, 0.0
        for r in range(first, end):
            z = y[r] + edges.b[r]
            square += z * z
            along += z * kinds.desired[r]
        length = np.sqrt(square)
        if length == 0.0:
            for r in range(first, end):
                out[r] = -edges.b[r]
        elif kinds.code[e] == RANGE:
            share = 1.0 - kinds.desired[first] / length
            for r in range(first, end):
                out[r] = share * (y[r] + edges.b[r]) - edges.b[r]
        else:
            share = along / square
            for r in range(first, end):
                out[r] = share * (y[r] + edges.b[r]) - kinds.desired[r] - edges.b[r]


class Slopes(NamedTuple):
    """Bounds on H of a team with range and bearing edges, for rounds.

    Attributes:
        low: Smallest eigenvalue of H above zero at the initial q*.
        steepest: Largest 1 / |z| of communication and sensing edges, shape (C + S,), 1/m.
        bound: Team of position edges whose H is an upper bound at all positions.
        free: True if motions are free at the initial q*. Rounds of newton then begin with 0 at every sample, because
            the free motions change with the positions.
    """

    low: float
    steepest: Array
    bound: Team
    free: bool


def bound_slopes(team: Team, positions: Array, *, steeper: float = 2.0) -> Slopes | None:
    """Bound H of the present agents of a team whose members begin at padded positions (V, 3), m.

    The largest 1 / |z| that rounds count is `steeper` times that at the initial q*.

    Absent agents have no q*, and measure at no edge.

    Returns:
        The bounds; None if H is not symmetric.
    """
    if team.directed:
        return None
    there = np.concatenate([team.present, np.ones(len(team.targets), dtype=np.bool_)])
    shape = team.remaining.linearised(team.remaining.at_rest(positions[there]))
    steepest = []
    changed = {}
    for edge, local in zip(team.measuring_edges, shape.measuring_edges, strict=True):
        ratio = steeper * edge.weight[0, 0] / local.weight[0, 0] if edge.measures == "bearing" else 1.0
        steepest.append(ratio)
        linear = replace(edge, measures="position", weight=ratio * edge.weight, offset=np.zeros(len(edge.F_tail)))
        changed[id(edge)] = linear
    problem = shape.dirichlet
    return Slopes(problem.eigenvalues[0], np.array(steepest), team.with_edges(changed), not problem.unique)


@inline_jit
def slope(kinds, steepest, edges, y, e):
    """Return a and c of M = a I + c z z^T of an edge at its measured z = y + b, without its weight.

    Both are 0 if a range or bearing edge measures nothing.

    Args:
        kinds: Kinds of the edges.
        steepest: Largest 1 / |z| of communication and sensing edges, shape (C + S,), 1/m.
        edges: Edges of the law.
        y: Measurements, shape (m,), m.
        e: Number of the edge.
    """
    if len(kinds) == 0:
        return 1.0, 0.0
    if kinds.code[e] == POSITION:
        return 1.0, 0.0
    square = 0.0
    for r in range(edges.first[e], edges.first[e + 1]):
        square += (y[r] + edges.b[r]) * (y[r] + edges.b[r])
    if square == 0.0:
        return 0.0, 0.0
    if kinds.code[e] == RANGE:
        return 0.0, 1.0 / square
    inverse = min(1.0 / np.sqrt(square), steepest[e])
    return inverse, -inverse / square


@inline_jit
def disturb(kinds, link, edges, first, end, draw, y):
    """Add the errors of a link to the range or the bearing of its edge, in y[first:end]; False of a position edge.

    A range gets noise and bias in m; a bearing is turned by a random angle about every axis, with noise in rad.
    """
    if len(kinds) == 0:
        return False
    code = kinds.code[link.edge]
    if code == POSITION:
        return False
    square, along = 0.0, 0.0
    for r in range(first, end):
        z = y[r] + edges.b[r]
        square += z * z
        along += z * normal_of(draw[1 + (r - first) % 3])
    length = np.sqrt(square)
    if length == 0.0:
        return True
    if code == RANGE:
        scale = (length + link.noise * normal_of(draw[1]) + link.bias) / length
        for r in range(first, end):
            y[r] = scale * (y[r] + edges.b[r]) - edges.b[r]
        return True
    across = 0.0
    for r in range(first, end):
        n = normal_of(draw[1 + (r - first) % 3]) - along * (y[r] + edges.b[r]) / square
        across += n * n
    across = np.sqrt(across)
    angle = link.noise * across
    turned = length * np.sin(angle) / across if across > 0.0 else 0.0
    for r in range(first, end):
        z = y[r] + edges.b[r]
        n = normal_of(draw[1 + (r - first) % 3]) - along * z / square
        y[r] = np.cos(angle) * z + turned * n - edges.b[r]
    return True


SILENT, HELD, NEW = 0.0, 1.0, 2.0
"""Reception of an edge at a sample: nothing, the last measurement held, or a new one."""

_STILL = 1e-9  # m in a period: no direction of motion

LINK = np.dtype(
    [
        ("edge", "i8"),  # number of the edge
        ("place", "i8"),  # index in LinkMemory.line where the delay line begins
        ("width", "i8"),  # numbers of a sample in the delay line
        ("moves", "i8"),  # 1 if the displacement of the agent goes with a sample: feedforward's, of sensing
        ("random", "i8"),  # 1 if the link takes random numbers
        ("lossy", "i8"),  # 1 if anything is lost at random
        ("bursts", "i8"),  # 1 if losses depend on the state of a chain
        ("stream", "i8", 2),  # stream of random numbers, the same wherever the edge stands
        *((name, "i8" if name in WHOLE else "f8") for name in LinkModel._fields),
    ],
    align=True,
)
"""A link for compiled code: the fields of a `LinkModel`, with `delay` and `hold` in periods, and those of its place."""


class LinkArrays(NamedTuple):
    """The links of a team of V vehicles: L edges of E have one that changes anything; by default none has.

    Attributes:
        present: (1,) if any edge of the run has one; (), another type, leaves them out of the compiled code.
        table: the links, of the type LINK, shape (L,).
        of: Number of each edge's link, or -1, shape (E,); empty without links.
        lift: Addition to z for the distance between bodies, shape (V,), m.
        facing: Initial attitudes if a sensor needs them, quaternions (w, x, y, z), shape (V, 4) or (0, 4).
        size: Length of LinkMemory.line.
        odometry: True if agents store how they moved since they sensed a target, for feedforward.
        start, period: Time of sample 0, and time between samples, s.
        record: True if measurements are recorded.
    """

    present: tuple[int, ...] = ()
    table: NDArray[np.void] = as_records(np.zeros(0, dtype=LINK))
    of: IntArray = np.zeros(0, dtype=np.int64)
    lift: Array = np.zeros(0)
    facing: Array = np.zeros((0, 4))
    size: int = 0
    odometry: bool = False
    start: float = 0.0
    period: float = 1.0
    record: bool = False

    def selected(self, rows: IntArray) -> "LinkArrays":
        """Return the links among some of the vehicles, by number."""
        facing = self.facing[rows] if len(self.facing) else self.facing
        return self._replace(lift=self.lift[rows], facing=facing) if len(self.table) else self


class LinkMemory(NamedTuple):
    """State of the links between samples: views of the law's memory, of size 0 without links.

    Attributes:
        heard: Reception on each link at the present sample, SILENT, HELD or NEW, shape (L,).
        state: State of the chain of losses of each link: 0 before it begins, 1 good, 2 bad, shape (L,).
        last: 1 + the number of the sample at which something last arrived on each link, 0 before that, shape (L,).
        y: Last received measurement on each edge that has a link, shape (m,), m.
        walked: F times the displacement of the agent up to when it took that measurement, of sensing edges, shape (m,),
            m; empty without feedforward.
        attitude: Attitudes of the vehicles, shape (V, 4), if a sensor needs them.
        before: Positions at the last sample, shape (V, 3), m, if a sensor needs attitudes.
        line: Delay line of each link, with a slot for each sample in transit: 1 + its number (0 if lost), y, and F
            times the agent's displacement up to it. A slot is written once.
    """

    heard: Array
    state: Array
    last: Array
    y: Array
    walked: Array
    attitude: Array
    before: Array
    line: Array


def new_link_memory(links: LinkArrays, m: int, line: Array, take: Take) -> LinkMemory:
    """Return the memory of the links of edges with m numbers before the first sample; `line` has all delay lines."""
    L, V, m = len(links.table), len(links.facing), m if len(links.of) else 0
    walked = take(m * links.odometry)
    return LinkMemory(take(L), take(L), take(L), take(m), walked, take((V, 4)), take((V, 3)), line)


def line_of(memory: LinkMemory, link: np.void) -> Array:
    """Return the delay line of a link of the type LINK, shape (delay + 1, width)."""
    size = (link["delay"] + 1) * link["width"]
    return memory.line[link["place"] :][:size].reshape(-1, link["width"])


class LinkedEdge(NamedTuple):
    """An edge of communication or sensing: the `number`th of its kind, the `nth` of it between the same ends."""

    kind: str
    number: int
    nth: int
    edge: Edge
    link: LinkModel

    @property
    def stream(self) -> tuple[int, int]:
        """Stream of its random numbers, from the ids of its ends: it does not depend on the order of edges."""
        return stream_of(self.kind, self.edge.tail, self.edge.head, self.nth)


def linked_edges(team: Team, links: Links) -> list[LinkedEdge]:
    """Return the communication and sensing edges with their links, in the order of the law.

    Raises:
        InputError: Sections contradict each other; the message begins with the field.
    """
    found, plain, met = list[LinkedEdge](), dict[str, LinkModel](), dict[tuple[str, ...], int]()
    for kind in KINDS:
        with in_field(f"links.{kind}"):
            plain[kind] = links.resolve(kind)
    for kind, edges in zip(KINDS, (team.communication, team.sensing), strict=True):
        for k, edge in enumerate(edges):
            ends, link = (kind, *edge.between), plain[kind]
            met[ends] = met.get(ends, -1) + 1
            if edge.link is not None:
                with in_field(f"{kind}.{k}"):
                    link = links.resolve(kind, edge.link)
            if edge.measures != "position":
                with in_field(f"{kind}.{k}, {edge}"):
                    if link.bearing:
                        raise InputError(
                            f"sensor range_bearing measures positions, and the edge a {edge.measures}; expected noise, "
                            "or sensor: {kind: exact}"
                        )
                    if edge.measures == "bearing" and link.bias:
                        raise InputError(
                            "bias: expected none on an edge that measures a bearing, which has no number to add it to"
                        )
            if edge.measures == "bearing":
                link = link._replace(noise=float(np.deg2rad(link.noise)))  # given in degrees
            found.append(LinkedEdge(kind, k, met[ends], edge, link))
    return found


def pack_links(
    team: Team,
    links: Links,
    *,
    period: float,
    start: float = 0.0,
    height: float = 0.0,
    heading: Array | None = None,
    feedforward: bool = False,
    run: Team | None = None,
) -> LinkArrays:
    """Pack the links of a team for compiled code.

    Args:
        team: The team; its edges have their own link fields.
        links: Link parameters of all edges and of each kind of edge.
        period: Control period, s; 0 if the law is continuous.
        start: Start of the run, s.
        height: Height of the surface on which planar vehicles move, m.
        heading: Initial heading of each vehicle, shape (V,), rad.
        feedforward: True if the law has feedforward, in any phase of the run.
        run: The team with the edges of all phases; `team` unless given.

    Raises:
        InputError: A delay is not a whole number of periods, the period is 0, or a sensor does not fit an edge's maps;
            the message begins with the field.
    """
    sections = [(f"links.{name}", getattr(links, name)) for name in ("all", *KINDS)]
    sections += [(f"{kind}.{k}", edge.link) for kind in KINDS for k, edge in enumerate(getattr(team, kind))]
    for field, section in sections:
        if section is not None and section.delay and period > 0.0:
            with in_field(f"{field}.delay"):
                whole_periods(section.delay, period)
    present = linked_edges(team, links)
    ever = linked_edges(run or team, links)
    if all(one.link.exact for one in ever):
        return LinkArrays(record=bool(links.record))
    if period == 0.0:
        raise InputError(
            "links: controller.control_period is 0; expected a positive one with noise, delay, loss or range"
        )
    table, size = _pack_table(present, period, feedforward)
    of = np.full(len(present) + len(team.target_edges) + len(team.anchors), -1)
    of[table["edge"]] = np.arange(len(table))
    half = 0.5 * (np.zeros(len(team.members)) if heading is None else heading)
    facing = np.column_stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)])
    # Measurements of these depend on the attitude of the tail.
    turning = any(one.link.bearing and not one.link.exact and len(one.edge.F_tail) == 3 for one in ever)
    return LinkArrays(
        present=(1,),
        table=as_records(table),
        of=of,
        lift=np.array([height if member.dimension == 2 else 0.0 for member in team.members]),
        facing=facing if turning else np.zeros((0, 4)),
        size=size,
        odometry=feedforward,
        start=start,
        period=period,
        record=bool(links.record),
    )


def _pack_table(edges: Sequence[LinkedEdge], period: float, feedforward: bool) -> tuple[NDArray[np.void], int]:
    """Return the links that change anything, of the type LINK, and the size of their delay lines; see `pack_links`."""
    rows: list[tuple[Any, ...]] = []
    size = 0
    for e, one in enumerate(edges):
        link, edge = one.link, one.edge
        if link.exact:
            continue
        if link.bearing:
            with in_field(f"{one.kind}.{one.number}, {edge}"):
                require_bearing(edge.F_tail, edge.F_head)
        moves = int(feedforward and one.kind == "sensing")
        width = 1 + len(edge.F_tail) * (1 + moves)
        delay = whole_periods(link.delay, period)
        fields = link._asdict() | {
            "edge": e,
            "place": size,
            "width": width,
            "moves": moves,
            "random": link.random,
            "lossy": link.lossy,
            "bursts": link.loss_good != link.loss_bad,
            "stream": one.stream,
            "delay": delay,
            "hold": int(min(link.hold / period + 1e-6, 1e9)),
        }
        rows.append(tuple(fields[name] for name in LINK.names or ()))
        size += (delay + 1) * width
        with in_field("links"):
            require_held(size)
    return np.array(rows, dtype=LINK), size


def require_held(numbers: int, *, most: int = 100_000_000) -> None:
    """Raise an InputError if delay lines cannot store this many numbers."""
    if numbers > most:
        raise InputError(f"delay lines hold more than {most} numbers; expected shorter delays")


@jit
def deliver(present, law, t, x, bodies, y, terms, memory):
    """Replace true measurements y (m,) at time t, s, by those that arrive now; y = -b if nothing arrives.

    Args:
        present: `law.links.present`; see `terms.navigate`.
        law: Law of the team.
        t: Time, s.
        x: Positions, shape (V, 3), m.
        bodies: True if memory.attitude has the true attitudes; otherwise vehicles face in the direction of motion.
        y: Measurements, in place.
        terms: Memory of the terms.
        memory: Memory of the links.
    """
    if len(present) == 0:
        return
    links = law.links
    n = int(np.rint((t - links.start) / links.period))
    if memory.attitude.shape[0] > 0 and not bodies:
        face_along(links, x, n, memory)
    delay, ring, oldest = -1, 0, 0
    for k in range(links.table.shape[0]):
        link = links.table[k]
        if link.delay != delay:
            delay = link.delay
            ring, oldest = n % (delay + 1), (n + 1) % (delay + 1)
        send(law, link, k, n, memory.line[link.place + ring * link.width :], x, y, terms, memory)
        memory.heard[k] = take_in(law, link, k, n, memory.line[link.place + oldest * link.width :], y, terms, memory)


@inline_jit
def send(law, link, k, n, slot, x, y, terms, memory):
    """Write the measurement of an edge with link k at sample n, unless it is lost, to a slot of the delay line.

    The Markov chain of losses takes a step.
    """
    links, first, end = law.links, law.edges.first[link.edge], law.edges.first[link.edge + 1]
    tail, head = law.edges.tail[link.edge], law.edges.head[link.edge]
    lost, draw = False, (0.5, 0.5, 0.5, 0.5)
    if link.random:
        draw = uniforms(law.seed[0], link.stream, n, 0)
    if link.bursts:
        chance = uniforms(law.seed[0], link.stream, n, 1)[0]
        memory.state[k] = next_state(memory.state[k], chance, link.to_bad, link.to_good, link.bad)
    if link.lossy:
        lost = draw[0] < (link.loss_bad if memory.state[k] == 2.0 else link.loss_good)
    if link.range < np.inf:
        lost |= distance(x[tail], links.lift[tail], x[head], links.lift[head]) > link.range
    slot[0] = 0.0 if lost else n + 1.0
    if not lost:
        edges, moved = law.edges, terms.walked
        if not disturb(edges.kinds, link, edges, first, end, draw, y):  # of `draw`, errors take the last three
            perceive(law.seed[0], link, n, draw, edges.F_tail[first:end], memory.attitude, tail, y[first:end])
        for r in range(first, end):
            slot[1 + r - first] = y[r]
        if link.moves > 0 and law.terms.agents > 0:
            for r in range(first, end):
                F = edges.F_tail[r]
                slot[1 + end - first + r - first] = (
                    F[0] * moved[tail, 0] + F[1] * moved[tail, 1] + F[2] * moved[tail, 2]
                )


@inline_jit
def take_in(law, link, k, n, slot, y, terms, memory):
    """Write the measurement of an edge at sample n to y and, with its velocity, to the memory.

    Args:
        law: Law of the team.
        link: Link of the edge.
        k: Number of the link.
        n: Number of the sample.
        slot: Sample of the delay line that is due.
        y: Measurements, in place.
        terms: Memory of the terms.
        memory: Memory of the links.

    Returns:
        Reception: NEW, HELD or SILENT.
    """
    edges, first, end = law.edges, law.edges.first[link.edge], law.edges.first[link.edge + 1]
    last, heard, periods = memory.last[k], SILENT, 0.0
    if n >= link.delay and slot[0] == n - link.delay + 1.0:
        heard = NEW
    elif 0.0 < last <= n and n + 1.0 - last <= link.hold:  # above n: the delay has grown
        heard = HELD
    if heard == NEW:
        if link.moves > 0:
            if law.terms.agents > 0 and last > 0.0 and last - 1.0 - link.delay >= n - terms.clock[0]:
                periods = n + 1.0 - last  # odometry ran without a break since the last one was sent
            # A mean over several periods gets the weight of as many updates of the filter, which begins at rest.
            # Otherwise noise would accumulate, although it cancels in the sum of differences. The next mean also needs
            # the displacement up to this sample.
            share = 1.0 - (1.0 - law.terms.measured) ** periods
            for r in range(first, end):
                walked = slot[1 + end - first + r - first]
                if periods > 0.0:
                    moved = (slot[1 + r - first] + walked) - (memory.y[r] + memory.walked[r])
                    terms.rate[r] += share * (moved / (periods * law.links.period) - terms.rate[r])
                elif law.terms.agents > 0:
                    terms.rate[r] = 0.0
                memory.walked[r] = walked
        for r in range(first, end):
            memory.y[r] = slot[1 + r - first]
        memory.last[k] = n + 1.0
    for r in range(first, end):
        y[r] = -edges.b[r] if heard == SILENT else memory.y[r]
    return heard


@inline_jit
def next_state(state, chance, to_bad, to_good, begins_bad):
    """Return the next state of a chain of losses, 1 good or 2 bad.

    Args:
        state: State at the previous sample; 0 before the first.
        chance: Random number, uniform in [0, 1).
        to_bad, to_good: Probabilities of the transitions from good to bad and from bad to good.
        begins_bad: Probability that the first state is bad.
    """
    if state == 0.0:
        return 2.0 if chance < begins_bad else 1.0
    if state == 2.0:
        return 1.0 if chance < to_good else 2.0
    return 2.0 if chance < to_bad else 1.0


@inline_jit
def distance(x, x_lift, y, y_lift):
    """Return the distance between bodies at x and y (3,) whose z is higher by `x_lift` and `y_lift`, all in m."""
    dx, dy, dz = y[0] - x[0], y[1] - x[1], y[2] + y_lift - x[2] - x_lift
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@jit
def face_along(links, x, n, memory):
    """Turn the attitude of every vehicle along its displacement since the last sample: first axis ahead, second level.

    A vehicle that does not move keeps its attitude. At the first sample, and when a phase begins whose sensors are the
    first to need attitudes, the initial headings are used.
    """
    for v in range(memory.attitude.shape[0]):
        attitude, last = memory.attitude[v], memory.before[v]
        dx, dy, dz = x[v, 0] - last[0], x[v, 1] - last[1], x[v, 2] - last[2]
        if n == 0 or (attitude[0] == 0.0 and attitude[1] == 0.0 and attitude[2] == 0.0 and attitude[3] == 0.0):
            for i in range(4):
                attitude[i] = links.facing[v, i]
        elif dx * dx + dy * dy + dz * dz > _STILL * _STILL:
            level = np.sqrt(dx * dx + dy * dy)
            yaw = 0.5 * np.arctan2(dy, dx) if level > 0.0 else 0.0
            pitch = -0.5 * np.arctan2(dz, level)
            attitude[0], attitude[1] = np.cos(yaw) * np.cos(pitch), -np.sin(yaw) * np.sin(pitch)
            attitude[2], attitude[3] = np.cos(yaw) * np.sin(pitch), np.sin(yaw) * np.cos(pitch)
        for i in range(3):
            memory.before[v, i] = x[v, i]
