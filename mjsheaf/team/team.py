"""The team: agents, targets and edges as one sheaf; and the directions in which agents are free to drift.

These null modes are those of a non-trivial relative cohomology.
"""

import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.errors import InputError, SheafError, expected, in_field
from mjsheaf.sheaf import RANK_TOLERANCE, DirichletProblem, NonlinearSheaf, Sheaf
from mjsheaf.sheaf.edges import assembled, parts
from mjsheaf.sheaf.nonlinear import (
    FREE_MOTION,
    SOLVED_RANK_TOLERANCE,
    Settled,
    StationaryProblem,
    StationarySolver,
    linear_edge,
    linear_sheaf,
)
from mjsheaf.team.edges import GROUND, Anchor, Edge, Explicit, Formation, LinearEdge, Member, Slope, require_ends
from mjsheaf.threads import one_thread

_GROUND = Member(GROUND, 0)
_COINCIDENT = 1e-9  # m, between places of a formation


@dataclass(frozen=True)
class Ramp:
    """Change of a team's formations: places move in straight lines, and offsets follow from where they are.

    It does not depend on how events divide it into phases: that a phase begins meanwhile changes no bit.

    Attributes:
        start, end: Times at which it begins and ends, s.
        first, last: The team then, with the same members and edges.
        begin: Time at which the present phase begins, s.
    """

    start: float
    end: float
    first: "Team"
    last: "Team"
    begin: float

    def share(self, time: ArrayLike | None) -> Array:
        """Return the fraction of the change made at times (T,) in s, shape (T, 1); as the phase begins without one."""
        now = np.asarray(self.begin if time is None else time, dtype=np.float64)
        return (now[..., None] - self.start) / (self.end - self.start)

    @cached_property
    def moved(self) -> Array:
        """Change of q* of the present agents, with the H of the law, stacked, shape (n_q,), m."""
        still = np.zeros(len(self.first.slots) - int(self.first.first_state[-1]))
        return np.asarray(self.last.law_problem.extend(still) - self.first.law_problem.extend(still))


class Team:
    """Agents and targets on a sheaf, with the formation as edge offsets.

    Attributes:
        agents, targets: members in order; ensemble vectors q and p are stacked in these orders.
        members: all vehicles, agents before targets.
        agent_ids, target_ids: their ids, in order.
        index: number of each member by id.
        communication, sensing, target_edges: edges with their offsets filled in.
        anchors: edges from an agent to GROUND.
        displacement: o_i of each agent by id, in m; zero where it is in no formation, and for targets.
        formations: groups of agents.
        sheaf: the sheaf F over the whole graph G.
        linearised_at: Stacked positions at which a team of other edges was linearised to get this one; None else.
        absent: ids of agents that are no part of the team now, as they are lost or have yet to join: they keep their
            places in all arrays, have no edges, and the harmonic extension is that of the others.
        ramp: Change of its formations; None if they stay. All else describes the team as the phase begins.
        changing: The team with such a change that was linearised to get this one, which describes its start; None else.
    """

    def __init__(
        self,
        agents: Sequence[Member],
        targets: Sequence[Member],
        communication: Iterable[Edge | LinearEdge],
        sensing: Iterable[Edge | LinearEdge],
        target_edges: Iterable[Edge | LinearEdge] = (),
        formations: Sequence[Formation] = (),
        target_formation: Formation | None = None,
        anchors: Iterable[Edge | Anchor] = (),
        absent: Collection[str] = (),
    ) -> None:
        """Assemble the team.

        Raises:
            InputError: duplicate or unknown ids, an edge between the wrong kinds of member, one that repeats another
                and does not say that it is parallel, a member in two formations, or a map or offset of the wrong shape
                (SheafError); the message begins with the field.
        """
        self.agents = tuple(agents)
        self.targets = tuple(targets)
        self.members = self.agents + self.targets
        self.agent_ids = [a.id for a in self.agents]
        self.target_ids = [t.id for t in self.targets]
        self.index: dict[str, int] = {}
        self.formations = tuple(formations)
        self.target_formation = target_formation
        self.absent = frozenset(absent)
        self.linearised_at: Array | None = None
        self.ramp: Ramp | None = None
        self.changing: Team | None = None
        if not self.agents:
            raise InputError("agents: a team needs at least one agent")
        for v, member in enumerate(self.members):
            if self.index.setdefault(member.id, v) != v:
                raise InputError(f"agents, targets: id {member.id!r} is used twice; each needs its own")
        self._roles = dict.fromkeys(self.agent_ids, "agent") | dict.fromkeys(self.target_ids, "target")
        self._roles[GROUND] = "ground"
        self._ends = {m.id: m for m in (*self.members, _GROUND)}
        self.displacement = {id: np.zeros(m.dimension) for id, m in self._ends.items()}
        own = dict(self.displacement)  # of targets among themselves; the agents' formation is about where they are
        names = [formation.name for formation in self.formations]
        if len(set(names)) != len(names):
            raise InputError(f"formations: each needs its own name, but they are {names}")
        placed: dict[str, str] = {}
        for k, formation in enumerate(self.formations):
            with in_field(f"formations.{k}"):
                self._place(formation, "agent", placed, self.displacement)
                if formation.about is not None and formation.about not in self.target_ids:
                    close = expected(formation.about, self.target_ids)
                    raise InputError(f"about: {formation.about!r} is not a target; {close}")
        if self.target_formation is not None:
            with in_field("target_formation.group"):
                if self.target_formation.about is not None:
                    raise InputError("about: targets hold their formation about no other; leave it out")
                self._place(self.target_formation, "target", {}, own)
        self.communication = self._edges("communication", communication, ("agent", "agent"), self.displacement)
        self.sensing = self._edges("sensing", sensing, ("agent", "target"), self.displacement)
        self.target_edges = self._edges("target_edges", target_edges, ("target", "target"), own)
        self.anchors = self._edges("anchors", anchors, ("agent", "ground"), self.displacement)
        ground = (_GROUND,) if self.anchors else ()
        with in_field("team"):
            stalks = {member.id: member.dimension for member in self.members + ground}
            edges = self.communication + self.sensing + self.target_edges + self.anchors
            self.sheaf = linear_sheaf(stalks, edges)

    def changed(self, absent: Collection[str], is_active: Callable[[Edge], bool]) -> "Team":
        """Return the same agents and targets, some of them absent, with the edges for which `is_active` is true."""
        return self._with_measuring(
            lambda edges: [e for e in edges if not {e.tail, e.head} & set(absent) and is_active(e)], absent
        )

    def _with_measuring(self, change: Callable[[Sequence[Edge]], list[Edge]], absent: Collection[str]) -> "Team":
        """Return the team with other agents absent, and with what `change` makes of each kind of measuring edges."""
        return Team(
            self.agents,
            self.targets,
            change(self.communication),
            change(self.sensing),
            self.target_edges,
            self.formations,
            self.target_formation,
            change(self.anchors),
            absent,
        )

    def begin_ramp(self, ramp: Ramp) -> None:
        """Let the places of formations move from a phase on.

        Raises:
            InputError: A range or bearing edge has both ends in one place on the way.
        """
        self.ramp = ramp
        for edge, other in zip(ramp.first.measuring_edges, ramp.last.measuring_edges, strict=True):
            if edge.measures == "position":
                continue
            way = other.aim - edge.aim
            share = float(np.clip(-(edge.aim @ way) / ((way @ way) or 1.0), 0.0, 1.0))
            if np.linalg.norm(edge.aim + share * way) < _COINCIDENT:
                raise InputError(
                    f"over: brings the places of {edge.tail} and {edge.head} together at "
                    f"{ramp.start + share * (ramp.end - ramp.start):.4g} s, where they have no {edge.measures}; "
                    "expected a smaller turn, or the change at once"
                )

    def desired_at(self, time: ArrayLike | None) -> Array | None:
        """Return the desired values of all rows of measuring edges at times (T,) in s, shape (T, m).

        Without a time, those as the phase begins. None if they do not change.
        """
        if self.ramp is None:
            return None
        teams = (self.ramp.first, self.ramp.last)
        first, last = (np.concatenate([np.zeros(0), *(e.aim for e in team.measuring_edges)]) for team in teams)
        return self.nonlinear_sheaf.desired_of(np.atleast_2d(first + self.ramp.share(time) * (last - first)))

    def edges_at(self, time: float) -> tuple[Edge, ...]:
        """Return the measuring edges with the offsets that they have at a time in s."""
        desired = self.desired_at(time)
        if desired is None:
            return self.measuring_edges
        values = np.split(desired[0], np.cumsum([len(e.b) for e in self.measuring_edges])[:-1])
        return tuple(
            replace(e, offset=value[: len(e.desired)]) for e, value in zip(self.measuring_edges, values, strict=True)
        )

    @cached_property
    def present(self) -> BoolArray:
        """True for each agent that is part of the team now, shape (N,)."""
        return np.array([agent.id not in self.absent for agent in self.agents])

    @cached_property
    def remaining(self) -> "Team":
        """The team of the present agents alone, who keep their places in formations; itself where all are present."""
        if not self.absent:
            return self
        members = {f.name: [m for m in f.members if m not in self.absent] for f in self.formations}
        remaining = Team(
            [agent for agent in self.agents if agent.id not in self.absent],
            self.targets,
            self.communication,
            self.sensing,
            self.target_edges,
            [
                Explicit(
                    name=f.name,
                    about=f.about,
                    members=members[f.name],
                    displacements=[self.displacement[m].tolist() for m in members[f.name]],
                )
                for f in self.formations
                if members[f.name]
            ],
            self.target_formation,
            self.anchors,
        )
        if self.ramp is not None:
            first, last = self.ramp.first.remaining, self.ramp.last.remaining
            remaining.ramp = replace(self.ramp, first=first, last=last)
        return remaining

    @property
    def measuring_edges(self) -> tuple[Edge, ...]:
        """Edges at which agents measure: communication, sensing, anchors."""
        return (*self.communication, *self.sensing, *self.anchors)

    @cached_property
    def slots(self) -> IntArray:
        """Places of the stacked vector (q, p) in a padded array of shape (V, 3), flattened; shape (n,)."""
        return np.concatenate([3 * v + np.arange(m.dimension) for v, m in enumerate(self.members)])

    @cached_property
    def first_state(self) -> IntArray:
        """Start of each agent's state in the stacked q, and its length at the end, shape (N + 1,)."""
        return np.concatenate([[0], np.cumsum([a.dimension for a in self.agents])]).astype(np.int64)

    def pack(self, positions: Array) -> Array:
        """Stack padded positions (..., V, 3) into (..., n); the z of planar vehicles is left out."""
        flat = np.asarray(positions).reshape(*np.shape(positions)[:-2], 3 * np.shape(positions)[-2])
        return flat[..., self.slots]

    def split(self, positions: Array) -> tuple[Array, Array]:
        """The stacked q (..., n_q) of the agents and p (..., n_p) of the targets in padded positions (..., V, 3)."""
        x, n_q = self.pack(positions), self.first_state[-1]
        return x[..., :n_q], x[..., n_q:]

    def unpack(self, x: Array, fill: float = 0.0) -> Array:
        """Spread stacked states (..., n) over padded positions (..., V, 3); `fill` where there is no state.

        A vector of the agents alone gives (..., N, 3).
        """
        count = len(self.members) if x.shape[-1] == len(self.slots) else len(self.agents)
        padded = np.full((*x.shape[:-1], 3 * count), fill)
        padded[..., self.slots[: x.shape[-1]]] = x
        return padded.reshape(*x.shape[:-1], count, 3)

    @cached_property
    def dirichlet(self) -> DirichletProblem | StationaryProblem:
        """The harmonic extension of the targets to the present agents: H q* = B p + c.

        Of a team linearised where its edges do not fit together, that of its law: see `law_problem`.
        """
        if self.absent:
            return self.remaining.dirichlet
        if self.stressed:
            return self.law_problem
        rtol = RANK_TOLERANCE if self.linearised_at is None else SOLVED_RANK_TOLERANCE
        return self.sheaf.dirichlet_problem(self.target_ids + ([GROUND] if self.anchors else []), rtol=rtol)

    @cached_property
    def law_problem(self) -> DirichletProblem | StationaryProblem:
        """H q* = B p + c with the H of the law u = -k1 (H q - B p - c), which need not be that of a sheaf."""
        if self.absent:
            return self.remaining.law_problem
        if not (self.stressed or self.directed):
            return self.dirichlet
        n_q = int(self.first_state[-1])
        p = np.zeros(len(self.slots) - n_q)
        at = np.concatenate([self.extend(p), p]) if self.linearised_at is None else self.linearised_at
        return StationaryProblem(self.law_jacobian, at[:n_q], at[n_q:])

    @property
    def law_jacobian(self) -> sparse.csr_array:
        """Derivative of the agents' eta by the positions of all members, of linear edges, shape (n_q, n)."""
        place = {vertex: self.sheaf.columns([vertex]) for vertex in self.sheaf.vertices}
        agents = set(self.agent_ids)
        blocks = []
        for e in self.measuring_edges:
            F_tail, F_head, K, _ = e.slope or Slope(e.F_tail, e.F_head, e.weight, e.b)
            ends = [(e.tail, -F_tail), (e.head, F_head)]
            moved = [end for end in ends if end[0] in agents and not (e.directed and end[0] == e.head)]
            blocks += [(place[i][:, None], place[j][None], F.T @ K @ G) for i, F in moved for j, G in ends]
        return assembled(blocks, (int(self.first_state[-1]), len(self.slots))).tocsr()

    def harmonic_extension(self, positions: Array, time: ArrayLike | None = None) -> Array:
        """Padded q* (..., N, 3) of the targets in padded positions (..., V, 3), m; 0 in z for planar agents.

        NaN for absent agents. Times (...), s, matter while formations change.
        """
        q, p = self.split(positions)
        return self.unpack(self.extend(p, q, time=time))

    def extend(
        self, p: Array, q: Array | None = None, path: "Path | None" = None, time: ArrayLike | None = None
    ) -> Array:
        """Return the stacked q* (..., n_q) of stacked targets (..., n_p), m; NaN for absent agents.

        If q* is not linear in p, or the team has neither targets nor anchors, this is the solution near the agents'
        positions q (..., n_q), or near 0 without q; see `mjsheaf.team.team`. It continues a path if one is given.
        While formations change, it is that of times (...), s, or as the phase begins without them.
        """
        if self.plain and self.ramp is not None:
            known = self.ramp.first.dirichlet.extend(p) + self.ramp.share(time) * self.ramp.moved
        elif self.plain:
            known = self.dirichlet.extend(p)
        else:
            present = np.repeat(self.present, np.diff(self.first_state))
            start = np.zeros((*p.shape[:-1], len(present))) if q is None else q
            remaining = self.remaining
            known = remaining.shapes.extend(p, start[..., present], path or Path(), remaining.desired_at(time))
        if not self.absent:
            return known
        q = np.full((*p.shape[:-1], int(self.first_state[-1])), np.nan)
        q[..., np.repeat(self.present, np.diff(self.first_state))] = known
        return q

    @cached_property
    def linear(self) -> bool:
        """True if all edges compare positions."""
        return all(edge.measures == "position" for edge in self.measuring_edges)

    @cached_property
    def directed(self) -> bool:
        """True if only the tail moves on some communication edge, so that H is not symmetric."""
        return any(edge.directed for edge in self.communication)

    @cached_property
    def stressed(self) -> bool:
        """True if the team is linearised where its edges do not fit, so that their pulls cancel without vanishing."""
        return any(edge.slope is not None for edge in self.measuring_edges)

    @property
    def symmetric(self) -> bool:
        """True if the H of the law of a team of linear edges is symmetric."""
        problem = self.law_problem if self.stressed else None
        return problem.symmetric if isinstance(problem, StationaryProblem) else not self.directed

    @property
    def free(self) -> bool:
        """True if the team keeps a formation alone: it has no targets and no anchors."""
        return not (self.sensing or self.anchors or self.targets)

    @property
    def plain(self) -> bool:
        """True if q* is the harmonic extension of a linear sheaf: H q* = B p + c with a symmetric H."""
        return self.linear and not self.directed and not self.free

    @cached_property
    def shapes(self) -> "Shapes":
        """Solver of q* for teams that are not plain."""
        return Shapes(self)

    @cached_property
    def nonlinear_sheaf(self) -> NonlinearSheaf:
        """The sheaf of all members and measuring edges, as edges of any kind see it; GROUND is its last vertex."""
        stalks = {member.id: member.dimension for member in (*self.members, _GROUND)}
        return NonlinearSheaf(stalks, self.measuring_edges)

    def linearised(self, x: Array, *, of_law: bool = False) -> "Team":
        """Return the team whose linear edges agree to first order with this one's where members are at x.

        Its residuals at x are those of this team, and its H is the matrix of Gauss-Newton there. Edges stay directed.

        Args:
            x: Padded positions (V, 3) or stacked ones (n,), m.
            of_law: True to give edges that do not fit at x their `slope`.
        """
        stacked = x if np.ndim(x) == 1 else self.pack(x)
        sheaf = self.nonlinear_sheaf
        misfits = sheaf.misfits(stacked) if of_law else itertools.repeat(None)
        linear = dict[int, Edge]()
        for e, z, misfit in zip(self.measuring_edges, sheaf.relative(stacked), misfits, strict=False):
            slope = None if misfit is None else Slope(e.F_tail, e.F_head, misfit, z)
            linear[id(e)] = replace(linear_edge(e, z), slope=slope)
        team = self.with_edges(linear)
        team.linearised_at = stacked
        if self.linear:
            team.ramp = self.ramp
        elif self.ramp is not None:
            team.changing = self
        return team

    def with_edges(self, changed: Mapping[int, Edge]) -> "Team":
        """Return the team with other measuring edges, by the `id()` of those that they replace."""
        return self._with_measuring(lambda edges: [changed[id(e)] for e in edges], self.absent)

    def linearised_about(self, positions: Array) -> "Team":
        """Return the team linearised at q* of the targets in padded positions (V, 3), m, near the agents in them.

        Its `dirichlet` and `law_problem` have the H of the law. If an edge does not fit at q*, this differs from
        F^T K F by the curvature of the measurement, and `Edge.slope` is the derivative of the edge's pull.
        """
        return self.linearised(self.at_rest(positions), of_law=True)

    def at_rest(self, positions: Array) -> Array:
        """Return q* and targets, stacked, (n,), m, for padded positions (V, 3) of targets and of agents near q*, m."""
        q, p = self.split(positions)
        return np.concatenate([self.extend(p, q), p])

    def is_settled(self, positions: Array) -> bool:
        """Return True if q* of the targets in padded positions (V, 3), m, is the only one near it.

        In a team without targets and anchors, which holds a shape and no place, True.
        """
        if self.plain or self.free:
            return self.free or self.dirichlet.unique
        q, p = self.split(positions)
        return not self.shapes.has_free_motions(self.extend(p, q), p)

    def edge_residuals(self, positions: Array, time: ArrayLike | None = None) -> Array:
        """Compute |F_i x_i - F_j x_j - b| of all measuring edges at positions (T, V, 3), shape (T, E), m.

        On a range or bearing edge it is the distance from the desired length or direction. Times (T,), s, matter while
        formations change.
        """
        return self.nonlinear_sheaf.residuals(self.pack(positions), self.desired_at(time))

    @cached_property
    def target_sheaf(self) -> Sheaf:
        """The sheaf of the targets alone, whose Laplacian drives their own formation."""
        return linear_sheaf({target.id: target.dimension for target in self.targets}, self.target_edges)

    def formation_edges(self, formation: Formation) -> list[Edge]:
        """The communication edges with both ends in a formation."""
        inside = set(formation.members)
        return [e for e in self.communication if e.tail in inside and e.head in inside]

    def _place(self, formation: Formation, role: str, placed: dict[str, str], displacement: dict[str, Array]) -> None:
        for member in formation.members:
            if self._roles.get(member) != role:
                known = [id for id, found in self._roles.items() if found == role]
                raise InputError(f"members: unknown id {member!r}; {expected(member, known)}")
            if member in placed:
                other = f"already in formation {placed[member]!r}"
                raise InputError(
                    f"members: {member!r} is {'named twice' if placed[member] == formation.name else other}"
                )
            placed[member] = formation.name
        dimensions = [self._ends[member].dimension for member in formation.members]
        displacement.update(zip(formation.members, formation.places(dimensions), strict=True))

    def _edges(
        self,
        field: str,
        given: Iterable[Edge | LinearEdge | Anchor],
        roles: tuple[str, str],
        displacement: dict[str, Array],
    ) -> tuple[Edge, ...]:
        made: list[Edge] = []
        first: dict[tuple[Any, ...], tuple[int, bool]] = {}
        for number, edge in enumerate(given):
            with in_field(f"{field}.{number}"):
                tail, head = edge.between
                require_ends(tail, head, self._roles, roles)
                if isinstance(edge, Edge):
                    built = edge
                else:
                    built = edge.build(self._ends[tail], self._ends[head])
                    k, parallel = first.setdefault(built.equation, (number, edge.parallel))
                    if k < number and not (parallel or edge.parallel):
                        raise InputError(
                            f"{built} says the same as {field}.{k}, {made[k]}, and would count double; leave one out, "
                            "give it another weight, map or offset, or write parallel: true if there are two sensors"
                        )
                if not (built.linear or field in ("communication", "sensing")):
                    what = "directed" if built.directed else "measures"
                    raise InputError(f"{what}: expected on communication and sensing edges alone, not on {field}")
                made.append(_with_offset(built, displacement))
        return tuple(made)


def _with_offset(edge: Edge, displacement: Mapping[str, Array]) -> Edge:
    """The edge with the offset that formations give it, unless it has its own."""
    o_tail, o_head = displacement[edge.tail], displacement[edge.head]
    shapes = [(len(edge.F_tail), len(o)) for o in (o_tail, o_head)]
    if [np.shape(edge.F_tail), np.shape(edge.F_head)] != shapes:
        raise SheafError(
            f"({edge.tail}, {edge.head}): the maps have shapes {np.shape(edge.F_tail)} and "
            f"{np.shape(edge.F_head)}; expected {shapes[0]} and {shapes[1]}"
        )
    if edge.offset is not None:
        return edge
    apart = edge.F_tail @ o_tail - edge.F_head @ o_head
    if edge.measures == "position":
        return replace(edge, offset=apart if edge.lift is None else apart + edge.lift)
    far = float(np.linalg.norm(apart))
    if far < _COINCIDENT:
        raise InputError(
            f"offset: the formations give [{edge.tail}, {edge.head}] no {edge.measures}, as both ends have one place; "
            "expected an offset, or different places"
        )
    return replace(edge, offset=np.array([far]) if edge.measures == "range" else -apart / far, apart=apart)


@dataclass
class Path:
    """q* along a run, up to the last computed sample.

    Attributes:
        last: q* there, shape (n_q,), m; None before the first.
        held: Targets there, shape (n_p,), m.
        moving: True if motions have been free at every sample.
        solver: Solver of the team and of this path alone; None before the first.
    """

    last: Array | None = None
    held: Array | None = None
    moving: bool = True
    solver: StationarySolver | None = None


class Shapes:
    """Solver of q* of teams with nonlinear or directed edges, and of teams without targets and anchors.

    None of its agents is absent. q* is a stationary point: D^T c = 0 at the agents (see `mjsheaf.sheaf.nonlinear`).
    Along a path it continues from sample to sample, whatever the pieces in which it is computed (see `Path`). At the
    first sample it is searched for from the present positions; if no exact shape is found there, also from the places
    of the formations, and the one with the smaller residual is q*. Where motions are free, as in a team without targets
    and anchors, each sample begins at its present positions and free motions stay as they are there: the centroid of a
    team and, of bearings, its size, as in the law.
    """

    def __init__(self, team: "Team") -> None:
        self._team = team

    @cached_property
    def solver(self) -> StationarySolver:
        """Solver with targets and ground held. Each path has a copy, because a solver stores its last factorisation."""
        return self._team.nonlinear_sheaf.solver([*self._team.target_ids, GROUND])

    @one_thread
    def extend(self, p: Array, q: Array, path: Path, desired: Array | None = None) -> Array:
        """Return q* (..., n_q) of targets at p (..., n_p), near agents at q (..., n_q), m; it continues the path.

        `desired` has the desired values of all rows, shape (..., m), if they change.
        """
        boundary = p.reshape(-1, p.shape[-1]) if p.shape[-1] else np.zeros((int(np.prod(p.shape[:-1])), 0))
        start = q.reshape(-1, q.shape[-1])
        found = np.full_like(start, np.nan)
        solver = path.solver = path.solver or copy(self.solver)
        for k, (held, near) in enumerate(zip(boundary, start, strict=True)):
            if desired is not None:
                now = desired.reshape(-1, desired.shape[-1])[k % len(desired)]
                solver.arrays = replace(solver.arrays, desired=now)
            if np.isfinite(held).all() and np.isfinite(near).all():
                if path.last is None or path.moving:
                    path.last = self.first(solver, held, near).x
                    path.moving = path.moving and self.has_free_motions(path.last, held)
                elif path.held is None or desired is not None or not np.array_equal(held, path.held):
                    path.last = solver.settle(path.last, held).x
                found[k] = path.last
            path.held = held
        return found.reshape(q.shape)

    def first(self, solver: StationarySolver, held: Array, near: Array, *, small: float = 1e-7) -> Settled:
        """Return q* of targets at `held` (n_p,) from the present positions `near` (n_q,), or from places.

        A shape is exact if its residual is at most `small` times the team's size.
        """
        found = solver.settle(near, held, free=True)
        exact = small * (1.0 + np.abs(solver.relative(near, held)).max(initial=0.0))
        if found.converged and found.residual <= exact:
            return found
        others = (solver.settle(x, held, free=True) for x in self._places(held, near))
        return min([found, *others], key=lambda each: (not each.converged, each.residual))

    def has_free_motions(self, q: Array, p: Array, *, most: int = 600) -> bool:
        """Return True if some motion of the agents at q changes no measurement to first order.

        More than `most` states are free in a team without targets and anchors alone.
        """
        if self._team.free or len(q) > most:
            return self._team.free
        H = self._team.nonlinear_sheaf.gradient_jacobian(np.concatenate([q, p]))[: len(q), : len(q)]
        values = np.linalg.svd(H.toarray(), compute_uv=False)
        return bool(values[-1] <= FREE_MOTION * values[0])

    def _places(self, held: Array, near: Array) -> list[Array]:
        """Return where formations place the agents about where they are; none if an agent is in no formation."""
        team = self._team
        placed = {member for formation in team.formations for member in formation.members}
        if not placed.issuperset(team.agent_ids):
            return []
        places = np.zeros((len(team.agents), 3))
        for i, agent in enumerate(team.agents):
            places[i, : agent.dimension] = team.displacement[agent.id]
        present = team.unpack(near)
        fitted = _scaled if any(edge.measures == "bearing" for edge in team.communication) else _turned
        for formation in team.formations:
            rows = [team.index[member] for member in formation.members]
            if formation.about is not None:
                about = team.unpack(np.concatenate([near, held]))[team.index[formation.about]]
                places[rows] += about
            else:
                centre = present[rows].mean(axis=0)
                places[rows] = centre + fitted(places[rows] - places[rows].mean(axis=0), present[rows] - centre)
        return [team.pack(np.concatenate([places, np.zeros((len(team.targets), 3))]))[: len(near)]]


def _scaled(places: Array, present: Array) -> Array:
    """Return centred places (N, 3) in the size of centred positions (N, 3); bearings fix how they are turned."""
    return places * (np.linalg.norm(present) / np.linalg.norm(places))


def _turned(places: Array, present: Array) -> Array:
    """Return centred places (N, 3), turned without reflection to lie near centred positions (N, 3)."""
    axes = 3 if places[:, 2].any() or present[:, 2].any() else 2
    u, _, v = np.linalg.svd(places[:, :axes].T @ present[:, :axes])
    signs = np.append(np.ones(axes - 1), np.sign(np.linalg.det(u @ v)) or 1.0)
    turned = np.zeros_like(places)
    turned[:, :axes] = places[:, :axes] @ (u * signs) @ v
    return turned


_AXES = "xyz"
_MOST_NAMED = 8  # agents named one by one before the rest are counted
_ENTRY_ROUNDING = 1e-7  # of the largest entry; null spaces close to small eigenvalues have more rounding
_STEP_TOLERANCE = 1e-6  # steps that differ by less are equal


@dataclass(frozen=True)
class NullMode:
    """Free motion of agents, which no edge measures.

    Attributes:
        agents: numbers of the agents that move, ascending, shape (k,).
        steps: how each moves, padded with zeros, shape (k, 3).
    """

    agents: IntArray
    steps: Array


def sparsified(basis: sparse.csr_array, owner: IntArray) -> sparse.csc_array:
    """Return a sparse basis of the same space: few agents move in each vector, along axes where possible.

    Independent parts are separated, and no vector's support contains that of another: the basis is in reduced echelon
    form.

    Args:
        basis: Columns of full column rank, shape (n, r).
        owner: Number of the agent that each row belongs to, ascending, shape (n,).

    Returns:
        Array of shape (n, r), with columns in the order of their first nonzero row. Each column has largest entry 1,
        and entries below 1e-7 are zero.
    """
    if basis.shape[1] == 0:
        return sparse.csc_array(basis.shape)
    clean = sparse.csr_array(basis, copy=True)
    clean.data[np.abs(clean.data) <= _ENTRY_ROUNDING * np.abs(clean.data).max()] = 0.0
    blocks = []
    for rows, columns, part in parts(clean):
        block, agent = part.toarray(), owner[rows]
        blocks.append((rows[:, None], columns, _echelon(block, _pivots(block, agent))))
    found = assembled(blocks, basis.shape).tocsc()
    found.eliminate_zeros()
    return found[:, np.argsort(found.indices[found.indptr[:-1]], kind="stable")]


def _pivots(block: Array, owner: IntArray, *, least: float = 0.1) -> IntArray:
    """Rows that determine all others, all of one agent where it has as many.

    One within the same agent is taken above `least` times the best pivot.
    """
    residual, pivots = block.copy(), list[int]()
    while len(pivots) < block.shape[1]:
        size = np.linalg.norm(residual, axis=1)
        last = owner == owner[pivots[-1]] if pivots else np.zeros(len(owner), dtype=bool)
        among = last if np.any(size[last] >= least * size.max()) else np.ones(len(owner), dtype=bool)
        # The first of those that are about as good as the best: rounding does not choose.
        pivot = int(np.flatnonzero(among & (size >= 0.5 * size[among].max()))[0])
        pivots.append(pivot)
        along = residual[pivot] / size[pivot]
        residual -= np.outer(residual @ along, along)
    return np.array(pivots, dtype=np.int64)


def _echelon(block: Array, pivots: IntArray) -> Array:
    """The basis in which each pivot row is moved by one vector alone, scaled to largest entry 1."""
    vectors = np.linalg.solve(block[pivots].T, block.T).T
    vectors[np.abs(vectors) <= _ENTRY_ROUNDING * np.abs(vectors).max()] = 0.0
    largest = np.argmax(np.abs(vectors) > (1.0 - _STEP_TOLERANCE) * np.abs(vectors).max(axis=0), axis=0)
    return vectors / vectors[largest, np.arange(vectors.shape[1])]


def describe_null_modes(team: Team) -> list[str]:
    """Describe the free directions of agents, a line for each basis vector of H^0(G, G_p; F)."""
    return [describe(team, mode) for mode in null_modes(team)]


def null_modes(team: Team) -> list[NullMode]:
    """A sparse basis of H^0(G, G_p; F), each vector with largest entry 1."""
    basis = null_mode_basis(team)
    ends = basis.indptr.tolist()
    return [null_mode_of(team, basis.data[a:b], basis.indices[a:b]) for a, b in itertools.pairwise(ends)]


def null_mode_basis(team: Team) -> sparse.csc_array:
    """A sparse basis of H^0(G, G_p; F), shape (n, dimension), rows in the order of the stacked q."""
    basis = team.dirichlet.sparse_null_basis
    return sparsified(basis.tocsr(), team.slots[: basis.shape[0]] // 3)


def null_mode_of(team: Team, values: Array, rows: IntArray | None = None) -> NullMode:
    """A vector of the agents as a mode: its entries (k,), at ascending rows of the stacked q, all by default."""
    agent, axis = np.divmod(team.slots[: len(values)] if rows is None else team.slots[rows], 3)
    agents, place = np.unique(agent, return_inverse=True)
    steps = np.zeros((len(agents), 3))
    steps[place, axis] = values
    return NullMode(agents, steps)


def describe_nearly(team: Team, mode: NullMode, *, named: float = 0.5, along: float = 0.2) -> str:
    """Describe which agents are nearly free in which directions, in a mode that hardly affects edges and anchors.

    Only agents that move at least `named` times as far as the one that moves furthest are named. A direction is rounded
    to an axis if the sine of the angle to it is below `along`.
    """
    far = np.linalg.norm(mode.steps, axis=1)
    much = far >= named * far.max()
    steps = mode.steps[much] / far[much, None]
    steps[np.abs(steps) < along] = 0.0
    steps *= np.sign(steps[0, np.argmax(np.abs(steps[0]))])  # an eigenvector has no sign of its own
    return describe(team, NullMode(mode.agents[much], _in_few_directions(steps)), "nearly free")


def _in_few_directions(steps: Array, *, cosine: float = 0.94) -> Array:
    """Return unit steps; those with nearly equal directions, by the cosine of their angle, are made equal."""
    steps = steps / np.linalg.norm(steps, axis=1)[:, None]
    left = np.ones(len(steps), dtype=bool)
    while left.any():
        alike = left & (steps @ steps[np.argmax(left)] > cosine)
        mean = steps[alike].mean(axis=0)
        steps[alike] = mean / np.linalg.norm(mean)
        left &= ~alike
    return steps


def describe(team: Team, mode: NullMode, free: str = "free") -> str:
    """Who is free, or only nearly free, along what."""
    _, first, kind = np.unique(np.round(mode.steps / _STEP_TOLERANCE), axis=0, return_index=True, return_inverse=True)
    names = [team.agents[a].id for a in mode.agents]
    if len(first) == 1:
        who = f"{_listed(names)} are" if len(names) > 1 else f"{names[0]} is"
        return f"{who} {free} along {_direction(mode.steps[0], team, mode.agents)}{' together' * (len(names) > 1)}"
    furthest = float(np.linalg.norm(mode.steps, axis=1).max())
    clauses = []
    for k in np.argsort(first, kind="stable")[:_MOST_NAMED].tolist():
        group = np.flatnonzero(kind == k)
        step = mode.steps[first[k]]
        far = float(np.linalg.norm(step)) / furthest
        share = "" if far > 1.0 - _STEP_TOLERANCE else f" ({far:.2g} times as far)"
        who = _listed([names[i] for i in group], " and ")
        clauses.append(f"{who} along {_direction(step, team, mode.agents[group])}{share}")
    more = ", ..." if len(first) > _MOST_NAMED else ""
    return f"{', '.join(clauses)}{more}, {'' if free == 'free' else f'{free}, '}moving together"


def _listed(names: Sequence[str], last: str = ", ") -> str:
    if len(names) > _MOST_NAMED:
        return f"{', '.join(names[:_MOST_NAMED])} and {len(names) - _MOST_NAMED} more"
    return last.join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _direction(step: Array, team: Team, agents: IntArray) -> str:
    """An axis by name, or a unit vector in the coordinates that the agents have."""
    axes = np.flatnonzero(step)
    if len(axes) == 1:
        return ("-" if step[axes[0]] < 0 else "") + _AXES[axes[0]]
    unit = step[: max(team.agents[a].dimension for a in agents)] / np.linalg.norm(step)
    return "(" + ", ".join(f"{x:.2g}" for x in np.where(np.abs(unit) < 0.005, 0.0, unit)) + ")"
