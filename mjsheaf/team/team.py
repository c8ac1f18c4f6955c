"""Restriction maps by name: what the two ends of an edge can compare.

| name        | F_tail          | F_head          | edge stalk              | in the paper                         |
|-------------|-----------------|-----------------|-------------------------|--------------------------------------|
| identity    | I               | I               | R^n, equal dimensions   | constant sheaf                       |
| shared      | [I_m 0]         | [I_m 0]         | R^m, m the smaller n    | Example 4, USV-UAV projection        |
| local_frame | R_tail [I_m 0]  | R_tail [I_m 0]  | R^m in the tail's frame | Examples 5 and 6, R_i and R_i P      |

The team: agents, targets and edges as one sheaf.

The range-bearing measurement of an edge, and what is rebuilt from it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjsheaf.errors import InputError, SheafError
from mjsheaf.sheaf import DirichletProblem, Sheaf
from mjsheaf.team.formation import Formation

Array = NDArray[np.float64]

NAMES = ("identity", "shared", "local_frame")


def rotation_to_local(roll: float, pitch: float, yaw: float, dimension: int) -> Array:
    """R_i, which takes global coordinates to the frame of a vehicle with the given attitude.

    Args:
        roll, pitch, yaw: attitude of the local frame in rad: yaw about z, then pitch about y, then roll about x.
        dimension: 2 (yaw alone) or 3.

    Returns:
        A rotation of shape (dimension, dimension).
    """
    cy, sy = np.cos(yaw), np.sin(yaw)
    if dimension == 2:
        return np.array([[cy, sy], [-sy, cy]])
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return (about_z @ about_y @ about_x).T


def restriction_maps(
    name: str, n_tail: int, n_head: int, attitude: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Array, Array]:
    """Restriction maps (F_tail, F_head) of a named kind.

    Args:
        name: one of NAMES.
        n_tail, n_head: dimensions of the two vertex stalks.
        attitude: roll, pitch and yaw of the tail in rad; used by `local_frame`.

    Raises:
        InputError: unknown name, or `identity` between unequal dimensions.
    """
    m = min(n_tail, n_head)
    tail, head = np.eye(m, n_tail), np.eye(m, n_head)
    if name == "shared":
        return tail, head
    if name == "identity":
        if n_tail != n_head:
            raise InputError(f"map 'identity' needs equal dimensions, but they are {n_tail} and {n_head}; use 'shared'")
        return tail, head
    if name == "local_frame":
        R = rotation_to_local(*attitude, dimension=m)
        return R @ tail, R @ head
    raise InputError(f"unknown restriction map {name!r}; expected {', '.join(NAMES)}")


@dataclass(frozen=True)
class Member:
    """An agent or a target: its id and the dimension of its state space, 2 (planar) or 3 (spatial)."""

    id: str
    dimension: int


@dataclass(frozen=True)
class Edge:
    """An edge of the team's graph with its restriction maps.

    Attributes:
        tail, head: ids; on a sensing edge the tail is the agent.
        F_tail, F_head: restriction maps, shapes (m, n_tail) and (m, n_head).
        weight: inner product K of the edge stalk, shape (m, m).
        offset: desired value b of F_tail x_tail - F_head x_head, shape (m,), in m; None takes it from formations.
    """

    tail: str
    head: str
    F_tail: Array
    F_head: Array
    weight: Array
    offset: Array | None = None

    @property
    def b(self) -> Array:
        """The desired value as a number: zero where nothing set it."""
        return np.zeros(len(self.F_tail)) if self.offset is None else self.offset


GROUND = "(ground)"
"""Vertex with a stalk of dimension 0 that anchors end on; no id can be written like this."""


def anchor(agent: str, F: Array, value: Array, weight: Array) -> Edge:
    """An edge that ties what an agent measures by itself to a fixed value: F q_i should be `value`.

    Args:
        agent: id of the agent.
        F: what it measures, shape (m, n); for an altimeter [[0, 0, 1]].
        value: shape (m,), m.
        weight: inner product K, shape (m, m).
    """
    return Edge(agent, GROUND, F, np.zeros((len(F), 0)), weight, value)


class Team:
    """Agents and targets on a sheaf, with the formation as edge offsets.

    Attributes:
        agents, targets: members in order; ensemble vectors q and p are stacked in these orders.
        communication, sensing, target_edges: edges with their offsets filled in.
        anchors: edges from an agent to GROUND.
        formations: groups of agents.
        sheaf: the sheaf F over the whole graph G.
    """

    def __init__(
        self,
        agents: Sequence[Member],
        targets: Sequence[Member],
        communication: Iterable[Edge],
        sensing: Iterable[Edge],
        target_edges: Iterable[Edge] = (),
        formations: Sequence[Formation] = (),
        target_formation: Formation | None = None,
        anchors: Iterable[Edge] = (),
    ) -> None:
        """Assemble the team.

        Raises:
            InputError: duplicate or unknown ids, an edge between the wrong kinds of member, an agent in two
                formations, or a map or offset of the wrong shape (SheafError).
        """
        self.agents, self.targets = tuple(agents), tuple(targets)
        self.formations = tuple(formations)
        self.target_formation = target_formation
        self._check_ids()
        self._displacement = self._gather_displacements(self.formations)
        target_displacement = self._gather_displacements([target_formation] if target_formation else [])
        agent_ids, target_ids = set(self.agent_ids), set(self.target_ids)
        self.communication = self._edges(communication, agent_ids, agent_ids, self._displacement, "communication")
        self.sensing = self._edges(sensing, agent_ids, target_ids, self._displacement, "sensing")
        self.target_edges = self._edges(target_edges, target_ids, target_ids, target_displacement, "target")
        self.anchors = self._edges(anchors, agent_ids, {GROUND}, self._displacement, "anchor")
        ground = (Member(GROUND, 0),) if self.anchors else ()
        self.sheaf = _sheaf_of(
            self.agents + self.targets + ground, self.communication + self.sensing + self.target_edges + self.anchors
        )

    # -- members -----------------------------------------------------------------------------------------------

    @property
    def members(self) -> tuple[Member, ...]:
        """All vehicles: agents, then targets."""
        return self.agents + self.targets

    @property
    def agent_ids(self) -> list[str]:
        """Ids of the agents, in order."""
        return [a.id for a in self.agents]

    @property
    def target_ids(self) -> list[str]:
        """Ids of the targets, in order."""
        return [t.id for t in self.targets]

    @cached_property
    def slots(self) -> NDArray[np.int64]:
        """Places of the stacked vector (q, p) in a padded array of shape (V, 3), flattened; shape (n,)."""
        return np.concatenate([3 * v + np.arange(m.dimension) for v, m in enumerate(self.members)])

    @cached_property
    def first_state(self) -> NDArray[np.int64]:
        """Where each agent's state begins in the stacked q, and its length at the end, shape (N + 1,)."""
        return np.concatenate([[0], np.cumsum([a.dimension for a in self.agents])]).astype(np.int64)

    def pack(self, positions: Array) -> Array:
        """Stack padded positions (..., V, 3) into (..., n); the z of planar vehicles is left out."""
        flat = np.asarray(positions).reshape(*np.shape(positions)[:-2], -1)
        return flat[..., self.slots]

    def unpack(self, x: Array, fill: float = 0.0) -> Array:
        """Spread stacked states (..., n) over padded positions (..., V, 3); `fill` where there is no state.

        A vector of the agents alone gives (..., N, 3).
        """
        count = len(self.members) if x.shape[-1] == len(self.slots) else len(self.agents)
        padded = np.full((*x.shape[:-1], 3 * count), fill)
        padded[..., self.slots[: x.shape[-1]]] = x
        return padded.reshape(*x.shape[:-1], count, 3)

    def displacement(self, agent: str) -> Array:
        """o_i of an agent in m; zero where it is in no formation."""
        return self._displacement[agent]

    # -- the tracking problem ----------------------------------------------------------------------------------

    @cached_property
    def dirichlet(self) -> DirichletProblem:
        """The harmonic extension of the targets to the agents: H q* = B p + c."""
        return self.sheaf.dirichlet_problem(self.target_ids + ([GROUND] if self.anchors else []))

    @cached_property
    def target_sheaf(self) -> Sheaf:
        """The sheaf of the targets alone, whose Laplacian drives their own formation."""
        return _sheaf_of(self.targets, self.target_edges)

    def incident_edges(self, agent: str) -> list[Edge]:
        """The edges at an agent, in the order of the sheaf: all that it can measure."""
        return [e for e in self.communication + self.sensing + self.anchors if agent in (e.tail, e.head)]

    def formation_edges(self, formation: Formation) -> list[Edge]:
        """The communication edges with both ends in a formation."""
        inside = set(formation.members)
        return [e for e in self.communication if e.tail in inside and e.head in inside]

    # -- checks ------------------------------------------------------------------------------------------------

    def _check_ids(self) -> None:
        if not self.agents:
            raise InputError("a team needs at least one agent")
        if not self.targets:
            raise InputError("a team needs at least one target")
        seen: set[str] = set()
        for member in self.members:
            if member.id in seen:
                raise InputError(f"id {member.id!r} is used twice; each agent and target needs its own")
            seen.add(member.id)

    def _gather_displacements(self, formations: Sequence[Formation]) -> dict[str, Array]:
        displacement = {m.id: np.zeros(m.dimension) for m in (*self.members, Member(GROUND, 0))}
        placed: dict[str, str] = {}
        for formation in formations:
            if len(formation.members) != len(formation.displacements):
                raise InputError(f"formation {formation.name!r}: each member needs one displacement")
            for member, o in zip(formation.members, formation.displacements, strict=True):
                if member not in displacement:
                    raise InputError(f"formation {formation.name!r}: unknown member {member!r}")
                if member in placed:
                    raise InputError(f"formation {formation.name!r}: {member!r} is already in {placed[member]!r}")
                if np.shape(o) != displacement[member].shape:
                    raise InputError(
                        f"formation {formation.name!r}: displacement of {member!r} has shape {np.shape(o)}; "
                        f"expected {displacement[member].shape}"
                    )
                placed[member] = formation.name
                displacement[member] = o
        return displacement

    def _edges(
        self,
        edges: Iterable[Edge],
        tails: set[str],
        heads: set[str],
        displacement: dict[str, Array],
        kind: str,
    ) -> tuple[Edge, ...]:
        result = []
        for e in edges:
            for end, legal in ((e.tail, tails), (e.head, heads)):
                if end not in legal:
                    raise InputError(f"{kind} edge ({e.tail}, {e.head}): {end!r} must be one of {sorted(legal)}")
            legal_shapes = [(len(e.F_tail), *displacement[end].shape) for end in (e.tail, e.head)]
            if [np.shape(e.F_tail), np.shape(e.F_head)] != legal_shapes:
                raise SheafError(
                    f"{kind} edge ({e.tail}, {e.head}): the maps have shapes {np.shape(e.F_tail)} and "
                    f"{np.shape(e.F_head)}; expected {legal_shapes[0]} and {legal_shapes[1]}"
                )
            b = e.offset
            if b is None:
                b = e.F_tail @ displacement[e.tail] - e.F_head @ displacement[e.head]
            result.append(Edge(e.tail, e.head, e.F_tail, e.F_head, e.weight, b))
        return tuple(result)


def _sheaf_of(members: Sequence[Member], edges: Sequence[Edge]) -> Sheaf:
    """The sheaf of some members, its edges in the order given."""
    sheaf = Sheaf({m.id: m.dimension for m in members})
    sheaf.add_mixed_edges(
        [e.tail for e in edges],
        [e.head for e in edges],
        [e.F_tail for e in edges],
        [e.F_head for e in edges],
        offset=[e.b for e in edges],
        weight=[e.weight for e in edges],
    )
    return sheaf


def relative_state(F_tail: Array, F_head: Array, x_tail: ArrayLike, x_head: ArrayLike) -> Array:
    """y = F_head x_head - F_tail x_tail, the transported relative state in the edge stalk, shape (m,), m."""
    return F_head @ np.asarray(x_head) - F_tail @ np.asarray(x_tail)


def range_bearing(y: Array) -> tuple[float, Array]:
    """Range |y| in m and unit bearing y / |y|; at range 0 the bearing is zero, so that range * bearing is y."""
    r = float(np.linalg.norm(y))
    return r, y / r if r > 0.0 else np.zeros_like(y)
