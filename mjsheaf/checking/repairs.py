"""Edges and anchors that remove the free directions of a team: the fewest that are found, and of those the nearest.

There are three searches: for free directions of the relative cohomology (`plan_augmentation`), for flexes of a
formation (`plan_bracing`), and for disconnected parts of the agents' graph and targets that are not sensed
(`suggest_edges`). In the first two, a candidate with rows C holds the row space of C T in the r free directions T. The
search is for the fewest subspaces whose sum is R^r. If m is the largest rank of a candidate, at least r / m are needed.
"""

import itertools
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy import linalg, sparse
from scipy.sparse import csgraph
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.spectrum import (
    DENSE_STATES,
    agent_coboundary,
    held_eigenvalues,
    smallest_eigenvalue,
    spectrum_of,
    zero_of,
)
from mjsheaf.errors import UndecidedError, listed
from mjsheaf.loop.system import System
from mjsheaf.section import Finite, Record
from mjsheaf.sheaf import RANK_TOLERANCE
from mjsheaf.sheaf.edges import parts as connected_parts
from mjsheaf.sheaf.nonlinear import FREE_MOTION, SOLVED_RANK_TOLERANCE, Measure, linear_edge
from mjsheaf.team import Edge, Member, Team, anchor, restriction_maps
from mjsheaf.team.edges import LinearEdge
from mjsheaf.team.team import describe, null_mode_basis, null_mode_of, sparsified

# -- the search --------------------------------------------------------------------------------------------------------

_RANK = 1e-6  # singular values of vectors whose largest entry is 1
_HELD = 1e-9  # eigenvalue above which a sum of projectors holds a direction


def hold_greedily(rows: Array, tolerance: float = _HELD) -> tuple[list[int], bool]:
    """Choose candidates that hold all directions, none of which is redundant.

    Each step adds the candidate that holds most further directions. Among equal ones, it takes the first whose weakest
    direction is held as well as by any other, to a tenth.

    Args:
        rows: Rows of the candidates on the free directions, of length 1 at most, shape (C, m, r).
        tolerance: Eigenvalue above which a direction is held.

    Returns:
        Numbers of the candidates, empty if all together leave a direction free; and True if no smaller set holds all.
    """
    r = rows.shape[2]
    left = rows.copy()
    chosen = list[int]()
    largest = held = 0
    while held < r:
        values = np.linalg.eigvalsh(left @ left.swapaxes(1, 2))
        holds = values > tolerance
        rank = np.count_nonzero(holds, axis=1)
        if not rank.max(initial=0):
            return [], False
        largest = largest or int(rank.max())
        weakest = np.where(holds, values, np.inf).min(axis=1)
        k = int(np.lexsort((-weakest.round(1), -rank))[0])
        chosen.append(k)
        directions = np.linalg.svd(left[k], full_matrices=False)[2][: rank[k]]
        left -= left @ directions.T @ directions
        held += int(rank[k])
    for k in tuple(chosen):
        others = [other for other in chosen if other != k]
        if others and np.linalg.matrix_rank(rows[others].reshape(-1, r), tol=math.sqrt(tolerance)) == r:
            chosen = others
    return chosen, len(chosen) == math.ceil(r / largest)


def smallest_sets(rows: Array, most: int) -> tuple[list[list[int]], bool]:
    """Find the smallest sets of candidates that hold all directions; also return True if they are proven smallest.

    Args:
        rows: Orthonormal rows of the candidates on the free directions, padded with zero rows, those of highest rank
            first, shape (C, m, r). All together hold all directions.
        most: Largest number of sets of one size that are tried one by one; above it, a greedy set is found.
    """
    r = rows.shape[2]
    rank = np.count_nonzero(rows.any(axis=2), axis=1)
    size = int(np.searchsorted(np.cumsum(rank), r)) + 1  # fewer cannot have enough rank
    while math.comb(len(rows), size) <= most:
        sets = np.array(list(itertools.combinations(range(len(rows)), size)))
        sets = sets[rank[sets].sum(axis=1) >= r]
        held = rows[sets].reshape(len(sets), -1, r)
        full = np.linalg.eigvalsh(held.swapaxes(1, 2) @ held)[:, 0] > _HELD
        if full.any():
            return sets[full].tolist(), True
        size += 1
    greedy, exact = hold_greedily(rows)
    return [greedy], exact or len(greedy) == size


# -- free directions ---------------------------------------------------------------------------------------------------

Kind = Literal["communication", "sensing", "anchor"]

_AXES = "xyz"


@dataclass(frozen=True)
class Candidate:
    """An edge or anchor that could be added, with inner product I.

    Attributes:
        kind: Kind of edge, or an anchor.
        agent: Number of the agent; for a link, the smaller number.
        end: Number of the other agent or of the target among all vehicles, or of the coordinate that an anchor holds.
    """

    kind: Kind
    agent: int
    end: int

    def edge(self, team: Team) -> Edge:
        """Return the edge; its offset comes from the team's formations, and an anchor holds the value 0."""
        agent = team.agents[self.agent]
        if self.kind == "anchor":
            return anchor(agent.id, np.eye(agent.dimension)[[self.end]], np.zeros(1), np.eye(1))
        end = team.members[self.end]
        maps = restriction_maps("shared", agent.dimension, end.dimension)
        return Edge(agent.id, end.id, *maps, np.eye(len(maps[0])))

    def describe(self, team: Team, linked: Container[tuple[str, str]] = ()) -> str:
        """Describe it, as in "give A2 an altimeter (anchor along z)", "let A1 talk to A4", "let A3 sense T2".

        `linked` holds the pairs of ids, agent before target, that share an edge already.
        """
        edge = self.edge(team)
        if self.kind == "anchor":
            sensor = "an altimeter" if self.end == 2 else "a position sensor"
            return f"give {edge.tail} {sensor} (anchor along {_AXES[self.end]})"
        verb = "talk to" if self.kind == "communication" else "sense"
        about = f" and compare {', '.join(_AXES[: len(edge.F_tail)])}" if (edge.tail, edge.head) in linked else ""
        return f"let {edge.tail} {verb} {edge.head}{about}"

    def entry(self, team: Team) -> dict[str, Any]:
        """Return the edge or anchor as a scenario has it; an anchor is at the value 0."""
        edge = self.edge(team)
        if self.kind == "anchor":
            return {"agent": edge.tail, "axes": [_AXES[self.end]], "value": [0.0]}
        return {"between": [edge.tail, edge.head]}


class Group(NamedTuple):
    """Candidates that hold the same free directions.

    Attributes:
        rows: Orthonormal basis of the row space of C T, padded with zero rows, shape (3, r).
        distance: Distance between the ends of the nearest of them, m. An altimeter counts as near, and an absolute
            position in the plane as the largest distance between vehicles.
        nearest: The nearest of them.
    """

    rows: Array
    distance: float
    nearest: Candidate


class Repair(Record):
    """One edge or anchor to add, with maps [I 0] and inner product I."""

    kind: Kind
    description: str = Field(
        description='such as "give A2 an altimeter (anchor along z)", "let A1 talk to A4", "let A3 sense T2"'
    )
    entry: Any = Field(description="the edge or anchor as the scenario's list has it")
    nullity_reduction: int = Field(alias="removes", description="number of free directions that it holds by itself")


class Augmentation(Record):
    """The smallest set of repairs that makes the relative cohomology trivial."""

    needed: int
    exact: bool = Field(
        description="true if no smaller set exists among the candidates; else greedy, and no repair is redundant"
    )
    repairs: list[Repair]
    lambda_min: float = Field(description="smallest eigenvalue of H with all repairs")


def plan_augmentation(
    team: Team, places: Array, *, sets: int = 20_000, directions: int = 12, classes: int = 60
) -> Augmentation | None:
    """Find the smallest set of edges and anchors that makes H^0(G, G_p; F) trivial; None if it is already.

    Candidates are links between any two agents, sensing of any target by any agent, both of the coordinates that both
    ends have, and position measurements of any agent along one axis. A pair that already shares an edge with other maps
    may get a second one. Candidates that hold the same subspace form a group.

    Args:
        team: The team.
        places: Positions of all vehicles, padded, shape (V, 3), m.
        sets: Largest number of sets of one size that are tried one by one.
        directions, classes: Largest numbers of free directions, and of classes of agents with the same motion, that one
            set of repairs covers. Above, directions in which different agents move are treated separately.
    """
    free = null_mode_basis(team)
    n, r = free.shape
    if r == 0:
        return None
    owner, moving_axis = np.divmod(team.slots[:n], 3)
    still = _by_dimension(team.agents, np.setdiff1d(np.arange(len(team.agents)), owner[free.indices]).tolist())
    parts = [free] if r <= directions and len(_alike(team, free)) <= classes else _parts(free, owner)
    exact = len(parts) == 1
    chosen = list[Candidate]()
    for part in parts:
        alike = _alike(team, part)
        groups = _group_candidates(team, alike, still, np.nan_to_num(places), links=len(alike) <= classes)
        groups.sort(key=lambda group: (-np.count_nonzero(group.rows.any(axis=1)), group.distance))
        found, smallest = smallest_sets(np.array([group.rows for group in groups]), sets)
        exact &= smallest and len(alike) <= classes
        nearest = min(found, key=lambda numbers: sum(groups[k].distance for k in numbers))
        chosen += [groups[k].nearest for k in nearest]
    # A candidate has one row for each axis, and holds nothing along an axis in which no agent moves.
    exact |= len(chosen) == math.ceil(r / len(np.unique(moving_axis[free.indices])))
    added = _rows_of(team, chosen)
    linked = {pair for e in team.communication + team.sensing for pair in ((e.tail, e.head), (e.head, e.tail))}
    repairs = [
        Repair(
            kind=x.kind,
            description=x.describe(team, linked),
            entry=x.entry(team),
            nullity_reduction=int(np.linalg.matrix_rank((_rows_of(team, [x]) @ free).toarray(), tol=_RANK)),
        )
        for x in chosen
    ]
    return Augmentation(
        needed=len(chosen),
        exact=exact,
        repairs=repairs,
        lambda_min=smallest_eigenvalue(*(sparse.vstack([y, added]).tocsr() for y in agent_coboundary(team))),
    )


def _rows_of(team: Team, candidates: Sequence[Candidate]) -> sparse.csr_array:
    """Return the rows C of candidates in the coboundary on the agents, shape (m, n)."""
    first = team.first_state
    edges = [candidate.edge(team) for candidate in candidates]
    ends = np.cumsum([len(edge.F_tail) for edge in edges])
    C = sparse.lil_array((int(ends[-1]), int(first[-1])))
    for candidate, edge, end in zip(candidates, edges, ends, strict=True):
        C[end - len(edge.F_tail) : end, first[candidate.agent] : first[candidate.agent + 1]] = edge.F_tail
        if candidate.kind == "communication":
            C[end - len(edge.F_head) : end, first[candidate.end] : first[candidate.end + 1]] = -edge.F_head
    return C.tocsr()


Alike = tuple[list[int], Array]
"""Numbers of agents with the same motion, and that motion in each of r directions, shape (dimension, r)."""


def _alike(team: Team, free: sparse.csc_array) -> list[Alike]:
    """Group the moving agents by their motion in the free directions T, shape (n, r)."""
    entries = free.tocoo()
    agent, axis = np.divmod(team.slots[entries.row], 3)
    agents, place = np.unique(agent, return_inverse=True)
    motion = np.zeros((len(agents), 3, free.shape[1]))
    motion[place, axis, entries.col] = entries.data
    found: dict[tuple[int, bytes], Alike] = {}
    for i, block in zip(agents.tolist(), motion, strict=True):
        n = team.agents[i].dimension
        key = n, (np.round(block, 6) + 0.0).tobytes()
        found.setdefault(key, ([], block[:n]))[0].append(i)
    return list(found.values())


def _by_dimension(members: Sequence[Member], numbers: Sequence[int]) -> dict[int, list[int]]:
    """Return the numbers of members, by the dimension of their state."""
    dimensions = dict.fromkeys(members[k].dimension for k in numbers)
    return {n: [k for k in numbers if members[k].dimension == n] for n in dimensions}


def _group_candidates(
    team: Team, classes: Sequence[Alike], still: Mapping[int, Sequence[int]], places: Array, *, links: bool
) -> list[Group]:
    """Group all useful candidates by the subspace that they hold.

    Args:
        team: The team.
        classes: Moving agents, grouped by their motion.
        still: Numbers of the agents that move in no free direction, by dimension.
        places: Positions of all vehicles, shape (V, 3), m.
        links: True if links between agents that both move are candidates.
    """
    targets = _by_dimension(team.members, range(len(team.agents), len(team.members)))
    blocks: list[tuple[Array, Kind, Sequence[int], Sequence[int]]] = []
    for own, motion in classes:
        blocks += [
            *((motion[:n], "communication", own, numbers) for n, numbers in still.items()),
            *((motion[:n], "sensing", own, numbers) for n, numbers in targets.items()),
            *((motion[axis : axis + 1], "anchor", own, [axis]) for axis in range(len(motion))),
        ]
    for (some, one), (others, other) in itertools.combinations(classes, 2) if links else ():
        m = min(len(one), len(other))
        blocks.append((one[:m] - other[:m], "communication", some, others))
    groups: dict[bytes, Group] = {}
    for rows, kind, agents, ends in blocks:
        _, singular, directions = np.linalg.svd(rows, full_matrices=False)
        held = np.zeros((3, rows.shape[1]))
        held[: np.count_nonzero(singular > _RANK)] = directions[singular > _RANK]
        if held.any():
            key = (np.round(held.T @ held, 6) + 0.0).tobytes()
            group = Group(held, *_nearest(kind, agents, ends, places))
            if key not in groups or group.distance < groups[key].distance:
                groups[key] = group
    return list(groups.values())


def _nearest(kind: Kind, agents: Sequence[int], ends: Sequence[int], places: Array) -> tuple[float, Candidate]:
    """Return the nearest candidate of a kind between some agents and some ends, after its distance; see `Group`."""
    if kind == "anchor":
        far = float(np.linalg.norm(np.ptp(places, axis=0)))
        return 0.0 if ends[0] == 2 else far, Candidate(kind, agents[0], ends[0])
    distance, which = KDTree(places[list(ends)]).query(places[list(agents)])
    k = int(np.argmin(distance))
    pair = agents[k], ends[which[k]]
    return float(distance[k]), Candidate(kind, *(sorted(pair) if kind == "communication" else pair))


def _parts(free: sparse.csc_array, owner: IntArray) -> list[sparse.csc_array]:
    """Split the free directions into parts, such that no agent moves in two parts."""
    entries = free.tocoo()
    moves = sparse.coo_array((np.ones(free.nnz), (owner[entries.row], entries.col)))
    return [free[:, columns] for _, columns, _ in connected_parts(moves)]


# -- flexes of a formation ---------------------------------------------------------------------------------------------

_SHOWN = 3  # flexes in a sentence


class Brace(Record):
    """A communication edge to add."""

    between: list[str] = Field(description="ids of its ends")
    measures: Measure
    map: Literal["shared", "space"]

    def describe(self) -> str:
        """Return the edge as a scenario has it."""
        fields = [f"between: [{', '.join(self.between)}]"]
        if self.measures != "position":
            fields.append(f"measures: {self.measures}")
        if self.map != "shared":
            fields.append(f"map: {self.map}")
        return f"{{{', '.join(fields)}}}"


class Bracing(Record):
    """Flexes of a formation, and the smallest set of edges with which it is rigid."""

    flexes: list[str] = Field(description="independent motions that change the shape and that no edge measures")
    edges: list[Brace] = Field(
        description="edges that hold all flexes; empty if no edges of the team's kinds do, as on a line"
    )
    exact: bool = Field(description="true if no smaller set of such edges exists; else none of them is redundant")
    rate: Finite = Field(description="slowest decay of the continuous law near the shape with these edges, 1/s")

    def describe(self) -> str:
        """Return the flexes and the edges in one sentence."""
        sentence = "; ".join(self.flexes[:_SHOWN])
        if len(self.flexes) > _SHOWN:
            sentence += f"; and {len(self.flexes) - _SHOWN} more"
        added = f"add communication {', '.join(edge.describe() for edge in self.edges)}"
        return (
            f"{sentence}; {added if self.edges else 'no edges of these kinds hold that to first order at this shape'}"
        )


def plan_bracing(
    team: Team,
    original: Team,
    positions: Array,
    motions: Array,
    D: Array,
    gain: float,
    *,
    most: int = 200,
) -> Bracing | None:
    """Find flexes and the edges that hold them; None for a rigid team, and for one that is too large.

    A flex is a motion of the agents that changes the shape and that no communication edge measures to first order.
    Motions that edges of the team's kinds can never measure may be added to it. Candidates are edges between any two
    agents, of every kind that the team's communication edges have.

    Args:
        team: The team, linearised at the shape.
        original: The team that was linearised.
        positions: Stacked positions of the agents at the shape, shape (n,), m.
        motions: Motions that edges of the team's kinds never measure, orthonormal, shape (n, t).
        D: Coboundary of the communication edges, rows of length 1, shape (m, n).
        gain: k1, 1/s.
        most: Largest number of the agents' states for which edges are searched.
    """
    if len(positions) > most:
        return None
    # Motions that D does not measure, orthogonal to the given ones; rows have length 1, as the tolerance is relative.
    flexes = linalg.null_space(np.vstack([D, motions.T]), rcond=SOLVED_RANK_TOLERANCE)
    if not flexes.shape[1]:
        return None
    edges, rows = _list_candidates(original, positions)
    length = np.linalg.norm(rows, axis=(1, 2), keepdims=True)
    chosen, exact = hold_greedily(rows / np.where(length > 0.0, length, 1.0) @ flexes, FREE_MOTION)
    rate = None
    if chosen:
        added = rows[chosen].reshape(-1, len(positions))
        H = team.dirichlet.H.toarray()
        rate = gain * float(np.linalg.eigvalsh((H + H.T) / 2.0 + added.T @ added)[motions.shape[1]])
    return Bracing(
        flexes=_describe_flexes(team, positions, flexes, motions),
        edges=[edges[k] for k in chosen],
        exact=exact,
        rate=rate if team.symmetric else None,
    )


def _describe_flexes(team: Team, positions: Array, flexes: Array, motions: Array) -> list[str]:
    """Describe the flexes in the frame of the agent with most edges and of those nearest to it, which is at rest.

    The number of fixed coordinates is that of the motions that no edge measures.
    """
    owner = team.slots[: len(flexes)] // 3
    ends = [team.index[id] for edge in team.communication for id in (edge.tail, edge.head)]
    centre = int(np.bincount(ends, minlength=len(team.agents)).argmax())
    x = team.unpack(positions)
    order = np.argsort(np.linalg.norm(x - x[centre], axis=1).round(6), kind="stable").tolist()
    fixed = _frame(motions, owner, order)
    relative = flexes - motions @ np.linalg.solve(motions[fixed], flexes[fixed])
    relative[np.abs(relative) <= SOLVED_RANK_TOLERANCE * np.abs(relative).max()] = 0.0
    basis = sparsified(sparse.csr_array(relative), owner)
    modes = [null_mode_of(team, basis.data[a:b], basis.indices[a:b]) for a, b in itertools.pairwise(basis.indptr)]
    return [f"{describe(team, mode)}, relative to {team.agents[centre].id}" for mode in modes]


def _frame(
    motions: Array,
    owner: IntArray,
    order: Sequence[int],
    *,
    pivot: float = 1e-6,  # length of a row of orthonormal motions below which its coordinate fixes none of them
) -> list[int]:
    """Choose coordinates whose rest leaves none of the motions, shape (n, t), agents in the given order."""
    left = motions.copy()
    fixed = list[int]()
    for agent in order:
        rows = np.flatnonzero(owner == agent)
        for _ in rows:
            length = np.linalg.norm(left[rows], axis=1)
            if length.max() <= pivot:
                break
            row = int(rows[length.argmax()])
            along = left[row] / length.max()
            left -= np.outer(left @ along, along)
            fixed.append(row)
    return fixed


def _list_candidates(team: Team, positions: Array) -> tuple[list[Brace], Array]:
    """List the edges between any two agents of a team, of the kinds that its communication edges have, by length.

    Returns:
        The edges; and their rows sqrt(K) F of the linearised coboundary, filled up with zero rows, shape (C, 3, n).
    """
    kinds = sorted({edge.measures for edge in team.communication}) or ["position"]
    map_name: Literal["shared", "space"] = "space" if any(e.lift is not None for e in team.communication) else "shared"
    first: list[int] = team.first_state.tolist()
    x = team.unpack(positions)
    pairs = itertools.combinations(np.flatnonzero(team.present).tolist(), 2)
    nearest_first = sorted(pairs, key=lambda pair: round(float(np.linalg.norm(x[pair[0]] - x[pair[1]])), 6))
    edges = []
    rows = []
    for (i, j), kind in itertools.product(nearest_first, kinds):
        tail, head = team.agents[i], team.agents[j]
        edge = LinearEdge(between=[tail.id, head.id], map=map_name, measures=kind).build(tail, head)
        z = edge.F_head @ positions[first[j] : first[j + 1]] - edge.F_tail @ positions[first[i] : first[i + 1]] + edge.b
        maps = linear_edge(edge, z)
        scale = math.sqrt(maps.weight[0, 0])
        block = np.zeros((3, len(positions)))
        block[: len(maps.F_tail), first[i] : first[i + 1]] = scale * maps.F_tail
        block[: len(maps.F_head), first[j] : first[j + 1]] = -scale * maps.F_head
        edges.append(Brace(between=[tail.id, head.id], measures=kind, map=map_name))
        rows.append(block)
    return edges, np.array(rows).reshape(-1, 3, len(positions))


# -- rigidity ----------------------------------------------------------------------------------------------------------
#
# The rank is that of the linearised coboundary of communication edges; where these do not fit together, in a team
# without targets, that of the law's Jacobian, as stress holds a shape too. A rigid team has the rank of all motions
# except those that edges of these kinds can never measure: translations, rotations and scaling, as far as the edges
# leave them free. The required rank is n d - d (d + 1) / 2 for ranges alone, n d - d - 1 for bearings, and n d - d for
# positions.


class Rigidity(Record):
    """Rigidity of the linearised team at q*; everything about range and bearing edges is local."""

    rank: int | None = Field(
        description="rank of the communication edges' Jacobian, or of the law's in a formation whose edges do not fit; "
        "null in a large team"
    )
    needed: int | None = Field(description="rank with which they hold the shape; null in a large team")
    rigid: bool | None = Field(description="whether they hold it to first order; null in a large team")
    localizable: bool | None = Field(
        description="whether targets and anchors hold every agent's place to first order; null without any"
    )
    rate: Finite = Field(
        description="k1 times the smallest real part above zero of an eigenvalue of H, 1/s; null if there is none"
    )
    bracing: Bracing | None = Field(
        None,
        description="flexes and the edges that hold them, of a team without targets that is not rigid; else null, and "
        "in a large team",
    )


def rigidity_of(system: System, original: Team, *, nothing: float = 1e-9) -> Rigidity:
    """Decide the rigidity of a system's present team, all of whose edges are linear.

    Args:
        system: The system; its team is linearised at the shape.
        original: The team that was linearised.
        nothing: Fraction of a rigid motion below which the measurements of edges are rounding.
    """
    team = system.team
    n = int(team.first_state[-1])
    positions = (team.pack(system.initial) if team.linearised_at is None else team.linearised_at)[:n]
    try:
        values = held_eigenvalues(team)
    except UndecidedError:  # a large team: some of the smallest
        values = spectrum_of(team).smallest.astype(np.complex128)
    values = values[np.abs(values) > zero_of(team) * np.abs(values).max(initial=0.0)]
    unique = team.dirichlet.unique if team.symmetric else len(values) == n
    localizable = None if team.free else bool(unique)
    rate = system.gain * float(values.real.min()) if len(values) else None
    if n > DENSE_STATES:
        return Rigidity(rank=None, needed=None, rigid=None, localizable=localizable, rate=rate)
    held_by_stress = team.free and team.stressed
    if held_by_stress:
        D = team.law_problem.H.toarray()
    else:
        D = team.sheaf.coboundary()[: sum(len(edge.F_tail) for edge in team.communication), :n].toarray()
        length = np.linalg.norm(D, axis=1, keepdims=True)
        D = D / np.where(length > 0.0, length, 1.0)  # the tolerance is relative
    tolerance = SOLVED_RANK_TOLERANCE if team.linearised_at is not None else RANK_TOLERANCE
    rank = int(np.linalg.matrix_rank(D, rtol=tolerance)) if len(D) else 0
    # Translations, rotations about the centroid, and the scale of the shape, shape (n, count).
    x = team.unpack(positions)
    x = x - x.mean(axis=0)
    axes = max(agent.dimension for agent in team.agents)
    size = float(np.abs(x).max()) or 1.0
    along = np.eye(3)[:axes]
    turns = [np.outer(a, b) - np.outer(b, a) for a, b in itertools.combinations(along, 2)]
    every = [*(np.broadcast_to(a, x.shape) for a in along), *(x @ turn / size for turn in turns), x / size]
    motions = np.array([motion.reshape(-1) for motion in every])[:, team.slots[:n]].T
    _, singular, combinations = np.linalg.svd(np.linalg.qr(D @ motions, mode="r"))
    seen = int(np.count_nonzero(singular > max(nothing, tolerance) * np.sqrt(len(D))))
    # One agent has no turn and no scale.
    unseen = linalg.orth(motions @ combinations[seen:].T, rcond=nothing)
    needed = n - unseen.shape[1]
    rigid = rank >= needed
    bracing = (
        None
        if rigid or held_by_stress or not team.free
        else plan_bracing(team, original, positions, unseen, D, system.gain)
    )
    return Rigidity(rank=rank, needed=needed, rigid=rigid, localizable=localizable, rate=rate, bracing=bracing)


# -- connection --------------------------------------------------------------------------------------------------------


def suggest_edges(
    team: Team,
    positions: Array,
    *,
    most: int = 1500,
) -> dict[str, list[list[str]]]:
    """Return the shortest edges that connect the agents and let every target be sensed (Assumption 5), by kind.

    Args:
        team: The team.
        positions: Positions of all vehicles, padded, shape (V, 3), m.
        most: Largest number of agents whose pairwise distances are computed.
    """
    agents = np.flatnonzero(team.present)
    if len(agents) > most:
        return {}
    places = np.nan_to_num(positions)
    part = label_parts(team, team.communication)[agents]
    lengths = 1.0 + cdist(places[agents], places[agents])  # a tree is the shortest with any constant added
    lengths[part[:, None] == part] = 0.5
    tree = csgraph.minimum_spanning_tree(lengths).tocoo()
    pairs = sorted((min(i, j), max(i, j)) for i, j in zip(tree.row, tree.col, strict=True) if part[i] != part[j])
    unseen = unsensed_targets(team, team.sensing)
    near = [agents[np.linalg.norm(places[agents] - places[team.index[t]], axis=1).argmin()] for t in unseen]
    edges = {
        "communication": [[team.agents[agents[i]].id, team.agents[agents[j]].id] for i, j in pairs],
        "sensing": [[team.agents[i].id, t] for i, t in zip(near, unseen, strict=True)],
    }
    return {kind: found for kind, found in edges.items() if found}


def describe_edges(edges: Mapping[str, Sequence[Sequence[str]]]) -> str:
    """Return the suggestion to add edges, by kind, as a sentence; empty if there are none."""
    return " and ".join(
        f"add {kind} {listed([f'[{tail}, {head}]' for tail, head in pairs])}" for kind, pairs in edges.items()
    )


def unsensed_targets(team: Team, sensing: Iterable[Edge]) -> list[str]:
    """Return the targets that none of some sensing edges measures."""
    sensed = {e.head for e in sensing}
    return [t for t in team.target_ids if t not in sensed]


def label_parts(team: Team, edges: Iterable[Edge]) -> IntArray:
    """Number the connected parts of the agents' graph with some edges from 0 on, shape (N,)."""
    N = len(team.agents)
    ends = [(team.index[e.tail], team.index[e.head]) for e in edges]
    tails, heads = np.array(ends, dtype=np.int64).reshape(-1, 2).T
    return csgraph.connected_components(
        sparse.coo_array((np.ones(len(ends)), (tails, heads)), shape=(N, N)), directed=False
    )[1]
