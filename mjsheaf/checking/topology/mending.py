"""Smallest set of extra edges or anchors that makes the relative cohomology trivial.

Candidates are links between any two agents, sensing of any target by any agent, comparing the coordinates that both
ends have, and position measurements of any agent along one axis. A pair that already shares an edge with other maps may
get a second one. All candidates have inner product I.

A candidate C holds the row space of C T in the r free directions T. The search is for the fewest subspaces whose sum is
R^r. Candidates that hold the same subspace form a group. Among the smallest sets, the search chooses the one with the
largest lambda_min. For a set with rows C, lambda_min is to first order the smallest eigenvalue of
S = (C N)^T (I + C H^+ C^T)^-1 (C N), where N is an orthonormal basis of the free directions. Sets are ranked by it, and
the best ones are compared by lambda_min itself.
"""

import itertools
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field
from scipy import sparse
from scipy.sparse import csgraph

from mjsheaf.arrays import Array, IntArray
from mjsheaf.checking.topology.cohomology import agent_coboundary, smallest_eigenvalue
from mjsheaf.section import Record
from mjsheaf.team import Edge, Member, Team, anchor, restriction_maps
from mjsheaf.team.null_modes import null_mode_basis

Kind = Literal["communication", "sensing", "anchor"]

EXACT_COMBINATIONS = 20_000
"""Largest number of sets of one size that are tried one by one."""

JOINT_DIMENSION = 12
JOINT_CLASSES = 60
"""Largest numbers of free directions, and of classes of agents with the same motion, that one joint set covers. Above,
directions in which different agents move are treated separately."""

RANKED_STATES = 400
"""Largest number of agents' states for which sets are ranked by lambda_min; above, the first set is taken."""

COMPARED = ((150, 32), (RANKED_STATES, 8))
"""Pairs of a largest number of states, and the number of sets compared by lambda_min itself up to there."""

_AXES = "xyz"
_RANK = 1e-6  # singular values, of vectors whose largest entry is 1
_HELD = 1e-9  # eigenvalue above which a sum of projectors holds a direction
_MOST_COMBINATIONS = 1000  # of groups, ranked by one candidate each
_COMBINATIONS_KEPT = 16  # of which more candidates are compared
_MOST_CANDIDATES = 1000  # ranked one by one
_MOST_SETS = 64  # ranked for each combination that is kept
_MOST_ALTERNATIVES = 5


@dataclass(frozen=True)
class Candidate:
    """An edge or anchor that could be added.

    Attributes:
        kind: what it is.
        agent: number of the agent, of a link the smaller one.
        end: number of the other agent or of the target that it ends on, or of the coordinate that an anchor would hold.
    """

    kind: Kind
    agent: int
    end: int

    @property
    def preference(self) -> int:
        """Rank among equals: an altimeter, a link, a sensor, a fixed place in the plane."""
        return {"communication": 1, "sensing": 2}.get(self.kind, 0 if self.end == 2 else 3)

    def edge(self, team: Team) -> Edge:
        """The edge; its offset comes from the team's formations, and an anchor holds the value 0."""
        agent = team.agents[self.agent]
        if self.kind == "anchor":
            return anchor(agent.id, np.eye(agent.dimension)[[self.end]], np.zeros(1), np.eye(1))
        end = (team.agents if self.kind == "communication" else team.targets)[self.end]
        maps = restriction_maps("shared", agent.dimension, end.dimension)
        return Edge(agent.id, end.id, *maps, np.eye(len(maps[0])))

    def describe(self, team: Team, linked: Container[tuple[str, str]] = ()) -> str:
        """Such as "give A2 an altimeter (anchor along z)", "let A1 talk to A4", "let A3 sense T2".

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


def edge_rows(team: Team, candidates: Sequence[Candidate]) -> sparse.csr_array:
    """The rows C of candidates in the coboundary on the agents, shape (m, n)."""
    first, edges = team.first_state, [candidate.edge(team) for candidate in candidates]
    ends = np.cumsum([len(edge.F_tail) for edge in edges])
    C = sparse.lil_array((int(ends[-1]), int(first[-1])))
    for candidate, edge, end in zip(candidates, edges, ends, strict=True):
        C[end - len(edge.F_tail) : end, first[candidate.agent] : first[candidate.agent + 1]] = edge.F_tail
        if candidate.kind == "communication":
            C[end - len(edge.F_head) : end, first[candidate.end] : first[candidate.end + 1]] = -edge.F_head
    return C.tocsr()


@dataclass
class Group:
    """Candidates that hold the same free directions.

    Attributes:
        projector: Projector on the row space of C T, where T are the free directions, shape (r, r).
        rank: Number of free directions that each candidate holds.
        blocks: Kind, agents and ends; each pair of an agent and an end is a candidate.
    """

    projector: Array
    rank: int
    blocks: list[tuple[Kind, Sequence[int], Sequence[int]]]

    def members(self, most: int) -> list[Candidate]:
        """Return the candidates by preference; of each block at most `most`, spread evenly."""
        found = []
        for kind, agents, ends in self.blocks:
            size = len(agents) * len(ends)
            for k in np.unique(np.linspace(0, size - 1, min(size, most)).astype(np.int64)).tolist():
                pair = agents[k // len(ends)], ends[k % len(ends)]
                found.append(Candidate(kind, *(sorted(pair) if kind == "communication" else pair)))
        return sorted(found, key=lambda candidate: candidate.preference)


Alike = tuple[list[int], Array]
"""Numbers of agents with the same motion, and that motion in each of r directions, shape (dimension, r)."""


def alike(team: Team, free: sparse.csc_array) -> list[Alike]:
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


def by_dimension(members: Sequence[Member], numbers: Iterable[int]) -> dict[int, list[int]]:
    """Return the numbers of agents or targets, by the dimension of their state."""
    found: dict[int, list[int]] = {}
    for k in numbers:
        found.setdefault(members[k].dimension, []).append(k)
    return found


def group_candidates(
    team: Team, classes: Sequence[Alike], still: Mapping[int, Sequence[int]], links: bool
) -> list[Group]:
    """Group all useful candidates by the subspace that they hold, groups of highest rank first.

    Args:
        team: The team.
        classes: Moving agents, grouped by their motion.
        still: Numbers of the agents that move in no free direction, by dimension.
        links: True if links between agents that both move are candidates.
    """
    targets = by_dimension(team.targets, range(len(team.targets)))
    groups: dict[bytes, Group] = {}
    blocks: list[tuple[Array, Kind, Sequence[int], Sequence[int]]] = []
    for own, motion in classes:
        blocks += [
            *((motion[axis : axis + 1], "anchor", own, [axis]) for axis in range(len(motion))),
            *((motion[:n], "communication", own, numbers) for n, numbers in still.items()),
            *((motion[:n], "sensing", own, numbers) for n, numbers in targets.items()),
        ]
    for (some, one), (others, other) in itertools.combinations(classes, 2) if links else ():
        m = min(len(one), len(other))
        blocks.append((one[:m] - other[:m], "communication", some, others))
    for rows, kind, agents, ends in blocks:
        _, singular, directions = np.linalg.svd(rows, full_matrices=False)
        directions = directions[singular > _RANK]
        if len(directions):
            projector = directions.T @ directions
            key = (np.round(projector, 6) + 0.0).tobytes()
            groups.setdefault(key, Group(projector, len(directions), [])).blocks.append((kind, agents, ends))
    return sorted(groups.values(), key=lambda group: -group.rank)


Choice = tuple[Candidate, ...]


class Repair(Record):
    """One edge or anchor to add, with maps [I 0] and inner product I."""

    kind: Kind
    description: str = Field(
        description='such as "give A2 an altimeter (anchor along z)", "let A1 talk to A4", "let A3 sense T2"'
    )
    entry: Any = Field(description="the edge or anchor as the scenario's list has it")
    nullity_reduction: int = Field(alias="removes", description="number of free directions that it holds by itself")
    lambda_min_alone: float = Field(description="of H with this repair alone")
    lambda_min_without: float = Field(description="of H with all repairs but this one; 0, as none can be spared")


class Augmentation(Record):
    """The smallest set of repairs that makes the relative cohomology trivial."""

    needed: int
    exact: bool = Field(
        description="true if no smaller set exists among the candidates; else greedy, and no repair is redundant"
    )
    candidates: int = Field(description="number of edges and anchors that would hold a free direction")
    repairs: list[Repair]
    lambda_min: float = Field(description="of H with all repairs")
    alternatives: list[list[str]] = Field(description="other sets of the same size, described, the best first")


def plan_augmentation(team: Team) -> Augmentation | None:
    """Find the smallest set of edges and anchors that makes H^0(G, G_p; F) trivial; None if it is already."""
    free = null_mode_basis(team)
    r = free.shape[1]
    if r == 0:
        return None
    states = free.shape[0]
    owner, moving_axis = np.divmod(team.slots[:states], 3)
    choices, count, certain = _list_choices(team, free, owner)
    # A candidate has one row for each axis, and holds nothing along an axis in which no agent moves.
    axes = len(np.unique(moving_axis[free.indices]))
    certain |= len(choices[0]) == math.ceil(r / axes)
    (lambda_min, chosen), *others = _compare(team, choices, states)
    linked = {pair for e in team.communication + team.sensing for pair in ((e.tail, e.head), (e.head, e.tail))}
    repairs = [
        Repair(
            kind=x.kind,
            description=x.describe(team, linked),
            entry=x.entry(team),
            nullity_reduction=int(np.linalg.matrix_rank((edge_rows(team, [x]) @ free).toarray(), tol=_RANK)),
            lambda_min_alone=lambda_min if len(chosen) == 1 else 0.0,
            lambda_min_without=0.0,
        )
        for x in chosen
    ]
    return Augmentation(
        needed=len(chosen),
        exact=certain,
        candidates=count,
        repairs=repairs,
        lambda_min=lambda_min,
        alternatives=[[x.describe(team, linked) for x in other] for _, other in others[:_MOST_ALTERNATIVES]],
    )


def _list_choices(team: Team, free: sparse.csc_array, owner: IntArray) -> tuple[list[Choice], int, bool]:
    """List sets of candidates that hold all free directions.

    Args:
        team: The team.
        free: Basis of the free directions, shape (n, r).
        owner: Agent that each state belongs to, shape (n,).

    Returns:
        Sets of one size, likely the best first; the number of candidates; and True if it is certain that no smaller set
        exists.
    """
    still = by_dimension(team.agents, np.setdiff1d(np.arange(len(team.agents)), owner[free.indices]).tolist())
    joint = free.shape[1] <= JOINT_DIMENSION and len(alike(team, free)) <= JOINT_CLASSES
    parts = [free] if joint else _parts(free, owner)
    certain = len(parts) == 1
    count = 0
    choices: list[Choice] = [()]
    for part in parts:
        classes = alike(team, part)
        groups = group_candidates(team, classes, still, links=len(classes) <= JOINT_CLASSES)
        count += sum(len(agents) * len(ends) for group in groups for _, agents, ends in group.blocks)
        combinations, smallest = smallest_combinations(groups, part.shape[1])
        certain &= smallest and len(classes) <= JOINT_CLASSES
        if len(parts) == 1 and free.shape[0] <= RANKED_STATES:
            return _ranked(team, free, groups, combinations), count, certain
        first = tuple(groups[k].members(1)[0] for k in combinations[0])
        choices = [choices[0] + first]
    return choices, count, certain


def _compare(team: Team, choices: Sequence[Choice], states: int) -> list[tuple[float, Choice]]:
    """Compute lambda_min of H with each of the first sets of candidates, and sort by it, the largest first."""
    number = next((number for limit, number in COMPARED if states <= limit), 1)
    coboundary = agent_coboundary(team)
    compared = []
    for choice in choices[:number]:
        C = edge_rows(team, choice)
        augmented = (sparse.vstack([y, C]).tocsr() for y in coboundary)
        compared.append((smallest_eigenvalue(*augmented), choice))
    scale = max(value for value, _ in compared) or 1.0
    return sorted(compared, key=lambda pair: (-round(pair[0] / scale, 9), _preference(pair[1])))


def _parts(free: sparse.csc_array, owner: IntArray) -> list[sparse.csc_array]:
    """Split the free directions into parts, such that no agent moves in two parts."""
    entries = free.tocoo()
    moves = sparse.coo_array((np.ones(free.nnz), (owner[entries.row], entries.col))).tocsr()
    _, label = csgraph.connected_components(moves.T @ moves, directed=False)
    order = np.argsort(label, kind="stable")
    return [free[:, columns] for columns in np.split(order, np.cumsum(np.bincount(label))[:-1])]


def smallest_combinations(groups: Sequence[Group], r: int) -> tuple[list[tuple[int, ...]], bool]:
    """Smallest combinations of groups whose subspaces sum to R^r, and whether it is certain that none is smaller.

    Groups are those of highest rank first, and hold everything together; r is the number of free directions.
    """
    projectors = np.array([group.projector for group in groups])
    rank = np.array([group.rank for group in groups])
    size = int(np.searchsorted(np.cumsum(rank), r)) + 1  # fewer cannot have enough rank
    while math.comb(len(groups), size) <= EXACT_COMBINATIONS:
        tried = np.array(list(itertools.combinations(range(len(groups)), size)))
        tried = tried[rank[tried].sum(axis=1) >= r]
        full = np.linalg.eigvalsh(projectors[tried].sum(axis=1))[:, 0] > _HELD
        if full.any():
            return [tuple(combination) for combination in tried[full].tolist()], True
        size += 1
    greedy = _greedy(projectors)
    return [greedy], len(greedy) == size


def _greedy(projectors: Array) -> tuple[int, ...]:
    """Add the subspace that adds most rank, and of those the one least aligned with the others; spare what can be."""
    r = projectors.shape[1]

    def held(chosen: Sequence[int]) -> int:
        return int(np.sum(np.linalg.eigvalsh(projectors[list(chosen)].sum(axis=0)) > _HELD))

    total, taken = np.zeros((r, r)), list[int]()
    while held(taken) < r:
        values = np.linalg.eigvalsh(total + projectors)
        rank = np.sum(values > _HELD, axis=1)
        weakest = np.where(values > _HELD, values, np.inf).min(axis=1)
        taken.append(int(np.lexsort((-weakest.round(9), -rank))[0]))
        total = total + projectors[taken[-1]]
    for k in tuple(taken):
        rest = [x for x in taken if x != k]
        if held(rest) == r:
            taken = rest
    return tuple(taken)


def _ranked(
    team: Team, free: sparse.csc_array, groups: Sequence[Group], combinations: Sequence[tuple[int, ...]]
) -> list[Choice]:
    """Sets of candidates in the order of the first-order estimate of lambda_min."""
    N = np.linalg.qr(free.toarray())[0]
    H_inverse = np.linalg.pinv(team.dirichlet.H.toarray(), hermitian=True)

    def held(choice: Choice) -> Array:
        C = edge_rows(team, choice)
        C_N = C @ N
        return C_N.T @ np.linalg.solve(np.eye(C.shape[0]) + C @ (C @ H_inverse).T, C_N)

    def best(choices: Sequence[Choice]) -> list[Choice]:
        return sorted(choices, key=lambda x: (-round(float(np.linalg.eigvalsh(held(x))[0]), 9), _preference(x)))

    combinations = combinations[:_MOST_COMBINATIONS]
    if len(combinations) > _COMBINATIONS_KEPT:
        first = {tuple(groups[k].members(1)[0] for k in combination): combination for combination in combinations}
        combinations = [first[choice] for choice in best(list(first))[:_COMBINATIONS_KEPT]]
    used = set(itertools.chain.from_iterable(combinations))
    most = max(_MOST_CANDIDATES // len(used), 8)
    members = {
        k: sorted(groups[k].members(most), key=lambda candidate: -round(float(np.trace(held((candidate,)))), 9))
        for k in used
    }
    width = max(int(_MOST_SETS ** (1.0 / len(combinations[0])) + 1e-9), 1)
    choices = [
        choice
        for combination in combinations
        for choice in itertools.product(*(members[k][:width] for k in combination))
    ]
    return best(choices)


def _preference(choice: Choice) -> int:
    return sum(candidate.preference for candidate in choice)
