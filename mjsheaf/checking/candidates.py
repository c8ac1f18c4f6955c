"""The edges and anchors that a team could be given, and what each would hold of what is free.

Every agent may be linked to every other and may sense every target, comparing the coordinates that both have, and may
be given a position measurement along one axis. A pair that already shares an edge with other maps may get this one
beside it. All have inner product I.
"""

import itertools
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mjsheaf.team import Edge, Member, Team, anchor, restriction_maps

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_AXES = "xyz"
_RANK = 1e-6  # of vectors whose largest entry is 1


@dataclass(frozen=True)
class Candidate:
    """An edge or anchor that could be added.

    Attributes:
        agent: number of the agent.
        other: number of the other agent of a link, else None.
        target: number of the target that it would sense, else None.
        axis: coordinate that an anchor would hold, else None.
    """

    agent: int
    other: int | None = None
    target: int | None = None
    axis: int | None = None

    @property
    def kind(self) -> Literal["communication", "sensing", "anchor"]:
        """What would be added."""
        return "anchor" if self.axis is not None else "sensing" if self.target is not None else "communication"

    @property
    def preference(self) -> int:
        """Which is told first where all else is equal: an altimeter, a link, a sensor, a fixed place in the plane."""
        return {"communication": 1, "sensing": 2}.get(self.kind, 0 if self.axis == 2 else 3)

    def edge(self, team: Team) -> Edge:
        """The edge; its offset comes from the team's formations, and an anchor holds the value 0."""
        agent = team.agents[self.agent]
        if self.axis is not None:
            return anchor(agent.id, np.eye(agent.dimension)[[self.axis]], np.zeros(1), np.eye(1))
        end = team.agents[self.other] if self.other is not None else team.targets[self.target or 0]
        maps = restriction_maps("shared", agent.dimension, end.dimension)
        return Edge(agent.id, end.id, *maps, np.eye(len(maps[0])))

    def describe(self, team: Team, linked: Container[tuple[str, str]] = ()) -> str:
        """Such as "give A2 an altimeter (anchor along z)", "let A1 talk to A4", "let A3 sense T2".

        Args:
            team: the team.
            linked: pairs of ids, in the order agent 1, agent 2 or agent, target, that share an edge already.
        """
        edge = self.edge(team)
        if self.axis is not None:
            sensor = "an altimeter" if self.axis == 2 else "a position sensor"
            return f"give {edge.tail} {sensor} (anchor along {_AXES[self.axis]})"
        verb = "talk to" if self.target is None else "sense"
        about = f" and compare {', '.join(_AXES[: len(edge.F_tail)])}" if (edge.tail, edge.head) in linked else ""
        return f"let {edge.tail} {verb} {edge.head}{about}"


def edge_rows(team: Team, candidates: Iterable[Candidate]) -> sparse.csr_array:
    """The rows C of candidates in the coboundary on the agents, shape (m, n)."""
    first = team.first_state
    row, column, value = list[Index](), list[Index](), list[Array]()
    m = 0
    for candidate in candidates:
        edge = candidate.edge(team)
        ends = [(candidate.agent, edge.F_tail)]
        if candidate.other is not None:
            ends.append((candidate.other, -edge.F_head))
        for agent, F in ends:
            k, axis = np.nonzero(F)
            row.append(m + k)
            column.append(first[agent] + axis)
            value.append(F[k, axis])
        m += len(edge.F_tail)
    entries = (np.concatenate(value), (np.concatenate(row), np.concatenate(column)))
    return sparse.coo_array(entries, shape=(m, int(first[-1]))).tocsr()


@dataclass
class Group:
    """Candidates that hold the same free directions.

    Attributes:
        projector: on the row space of C T, where T are the free directions, shape (r, r).
        rank: how many free directions each candidate holds.
        count: how many candidates there are.
    """

    projector: Array
    rank: int
    count: int
    _makers: list[tuple[Callable[[int, int], Candidate], Sequence[int], Sequence[int]]]

    def members(self, most: int) -> list[Candidate]:
        """The candidates, those told first first; of each kind at most `most`, spread evenly."""
        found = []
        for make, left, right in self._makers:
            size = len(left) * len(right)
            for k in np.unique(np.linspace(0, size - 1, min(size, most)).astype(np.int64)).tolist():
                a, b = divmod(k, len(right))
                found.append(make(left[a], right[b]))
        return sorted(found, key=lambda candidate: candidate.preference)


@dataclass(frozen=True)
class Alike:
    """Agents of one dimension that move alike in all free directions.

    Attributes:
        agents: their numbers.
        motion: how they move in each of r directions, shape (dimension, r).
    """

    agents: list[int]
    motion: Array


def alike(team: Team, free: sparse.csc_array) -> list[Alike]:
    """Sort the agents that move by how they move.

    Args:
        team: the team.
        free: free directions T, shape (n, r).
    """
    entries = free.tocoo()
    agent, axis = np.divmod(team.slots[entries.row], 3)
    agents, place = np.unique(agent, return_inverse=True)
    motion = np.zeros((len(agents), 3, free.shape[1]))
    motion[place, axis, entries.col] = entries.data
    found: dict[tuple[int, bytes], Alike] = {}
    for i, block in zip(agents.tolist(), motion, strict=True):
        n = team.agents[i].dimension
        key = n, (np.round(block, 6) + 0.0).tobytes()
        found.setdefault(key, Alike([], block[:n])).agents.append(i)
    return list(found.values())


def by_dimension(members: Sequence[Member], numbers: Iterable[int]) -> dict[int, list[int]]:
    """Numbers of agents or targets, by the dimension of their state."""
    found: dict[int, list[int]] = {}
    for k in numbers:
        found.setdefault(members[k].dimension, []).append(k)
    return found


def group_candidates(
    team: Team, classes: Sequence[Alike], still: Mapping[int, Sequence[int]], links: bool
) -> list[Group]:
    """Group all candidates that hold something by what they hold.

    Args:
        team: the team.
        classes: the agents that move, by how they move.
        still: numbers of the agents that move in no free direction, by dimension.
        links: whether links between agents that both move are candidates.

    Returns:
        Groups, those of highest rank first.
    """
    targets = by_dimension(team.targets, range(len(team.targets)))
    groups: dict[bytes, Group] = {}

    def add(rows: Array, make: Callable[[int, int], Candidate], left: Sequence[int], right: Sequence[int]) -> None:
        _, singular, directions = np.linalg.svd(rows, full_matrices=False)
        directions = directions[singular > _RANK]
        if len(directions):
            projector = directions.T @ directions
            group = groups.setdefault(
                (np.round(projector, 6) + 0.0).tobytes(), Group(projector, len(directions), 0, [])
            )
            group.count += len(left) * len(right)
            group._makers.append((make, left, right))

    for c in classes:
        for axis in range(len(c.motion)):
            add(c.motion[axis : axis + 1], _anchor, c.agents, [axis])
        for make, ends in ((_link, still), (_sensing, targets)):
            for dimension, numbers in ends.items():
                add(c.motion[:dimension], make, c.agents, numbers)
    for a, b in itertools.combinations(classes, 2) if links else ():
        m = min(len(a.motion), len(b.motion))
        add(a.motion[:m] - b.motion[:m], _link, a.agents, b.agents)
    return sorted(groups.values(), key=lambda group: -group.rank)


def _anchor(agent: int, axis: int) -> Candidate:
    return Candidate(agent, axis=axis)


def _sensing(agent: int, target: int) -> Candidate:
    return Candidate(agent, target=target)


def _link(agent: int, other: int) -> Candidate:
    return Candidate(min(agent, other), other=max(agent, other))
