"""The team: agents, targets and edges as one sheaf."""

import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.errors import InputError, SheafError, expected, in_field
from mjsheaf.sheaf import RANK_TOLERANCE, DirichletProblem, NonlinearSheaf, Sheaf
from mjsheaf.sheaf.edges import assembled
from mjsheaf.sheaf.nonlinear import (
    FREE_MOTION,
    SOLVED_RANK_TOLERANCE,
    Settled,
    StationaryProblem,
    StationarySolver,
    linear_maps,
)
from mjsheaf.team.edges import GROUND, Anchor, Edge, Explicit, Formation, LinearEdge, Member, Slope, require_ends

_GROUND = Member(GROUND, 0)
_COINCIDENT = 1e-9  # m, between places of a formation


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
        if not self.agents:
            raise InputError("agents: a team needs at least one agent")
        for v, member in enumerate(self.members):
            if self.index.setdefault(member.id, v) != v:
                raise InputError(f"agents, targets: id {member.id!r} is used twice; each needs its own")
        self._roles = dict.fromkeys(self.agent_ids, "agent") | dict.fromkeys(self.target_ids, "target")
        self._ends = {m.id: m for m in (*self.members, _GROUND)}
        self.displacement = {id: np.zeros(m.dimension) for id, m in self._ends.items()}
        own = dict(self.displacement)  # of targets among themselves; the agents' formation is about where they are
        self._place_formations(own)
        self.communication = self._edges("communication", communication, ("agent", "agent"), self.displacement)
        self.sensing = self._edges("sensing", sensing, ("agent", "target"), self.displacement)
        self.target_edges = self._edges("target_edges", target_edges, ("target", "target"), own)
        self.anchors = self._edges("anchors", anchors, ("agent", "ground"), self.displacement)
        ground = (_GROUND,) if self.anchors else ()
        with in_field("team"):
            self.sheaf = _sheaf_of(
                self.members + ground, self.communication + self.sensing + self.target_edges + self.anchors
            )

    def changed(self, absent: Collection[str], is_active: Callable[[Edge], bool]) -> "Team":
        """Return the same agents and targets, some of them absent, with the edges for which `is_active` is true."""

        def kept(edges: Iterable[Edge]) -> list[Edge]:
            return [e for e in edges if not {e.tail, e.head} & set(absent) and is_active(e)]

        return Team(
            self.agents,
            self.targets,
            kept(self.communication),
            kept(self.sensing),
            self.target_edges,
            self.formations,
            self.target_formation,
            kept(self.anchors),
            absent,
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
        return Team(
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
        flat = np.asarray(positions).reshape(*np.shape(positions)[:-2], -1)
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
        slots = np.cumsum([0, *(member.dimension for member in self.members)])
        place = {
            member.id: np.arange(*ends) for member, ends in zip(self.members, itertools.pairwise(slots), strict=True)
        }
        place[GROUND] = np.zeros(0, dtype=np.int64)
        agents = set(self.agent_ids)
        blocks = []
        for e in self.measuring_edges:
            F_tail, F_head, K, _ = e.slope or Slope(e.F_tail, e.F_head, e.weight, e.b)
            ends = [(e.tail, -F_tail), (e.head, F_head)]
            moved = [end for end in ends if end[0] in agents and not (e.directed and end[0] == e.head)]
            blocks += [(place[i][:, None], place[j][None], F.T @ K @ G) for i, F in moved for j, G in ends]
        return assembled(blocks, (int(self.first_state[-1]), int(slots[-1]))).tocsr()

    def harmonic_extension(self, positions: Array) -> Array:
        """Padded q* (..., N, 3) of the targets in padded positions (..., V, 3), m; 0 in z for planar agents.

        NaN for absent agents.
        """
        q, p = self.split(positions)
        return self.unpack(self.extend(p, q))

    def extend(self, p: Array, q: Array | None = None, path: "Path | None" = None) -> Array:
        """Return the stacked q* (..., n_q) of stacked targets (..., n_p), m; NaN for absent agents.

        If q* is not linear in p, or the team has neither targets nor anchors, this is the solution near the agents'
        positions q (..., n_q), or near 0 without q; see `mjsheaf.team.team`. It continues a path if one is given.
        """
        if self.plain:
            known = self.dirichlet.extend(p)
        else:
            present = np.repeat(self.present, np.diff(self.first_state))
            start = np.zeros((*p.shape[:-1], len(present))) if q is None else q
            known = self.remaining.shapes.extend(p, start[..., present], path or Path())
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

    def linearised(self, x: Array) -> "Team":
        """Return the team whose linear edges agree to first order with this one's where members are at x.

        Its residuals at x are those of this team, and its H is the matrix of Gauss-Newton there. Edges stay directed.

        Args:
            x: Padded positions (V, 3) or stacked ones (n,), m.
        """
        stacked = x if np.ndim(x) == 1 else self.pack(x)
        linear = dict[int, Edge]()
        for e, z in zip(self.measuring_edges, self.nonlinear_sheaf.relative(stacked), strict=True):
            linear[id(e)] = replace(e, **linear_maps(e, z)._asdict(), measures="position", lift=None)
        team = self.with_edges(linear)
        team.linearised_at = stacked
        return team

    def with_edges(self, changed: Mapping[int, Edge]) -> "Team":
        """Return the team with other measuring edges, by the `id()` of those that they replace."""

        def exchange(edges: Iterable[Edge]) -> list[Edge]:
            return [changed[id(e)] for e in edges]

        return Team(
            self.agents,
            self.targets,
            exchange(self.communication),
            exchange(self.sensing),
            self.target_edges,
            self.formations,
            self.target_formation,
            exchange(self.anchors),
            self.absent,
        )

    def linearised_about(self, positions: Array) -> "Team":
        """Return the team linearised at q* of the targets in padded positions (V, 3), m, near the agents in them.

        Its `dirichlet` and `law_problem` have the H of the law. If an edge does not fit at q*, that is not F^T K F,
        which lacks the curvature of what the edge measures: `Edge.slope` then has the derivative of its pull.
        """
        x = self.at_rest(positions)
        linear = self.linearised(x)
        sheaf = self.nonlinear_sheaf
        changed = dict[int, Edge]()
        given = zip(self.measuring_edges, linear.measuring_edges, sheaf.relative(x), sheaf.misfits(x), strict=True)
        for e, own, z, misfit in given:
            slope = None if misfit is None else Slope(e.F_tail, e.F_head, misfit, z)
            changed[id(own)] = replace(own, slope=slope)
        team = linear.with_edges(changed)
        team.linearised_at = x
        return team

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

    @cached_property
    def target_sheaf(self) -> Sheaf:
        """The sheaf of the targets alone, whose Laplacian drives their own formation."""
        return _sheaf_of(self.targets, self.target_edges)

    def formation_edges(self, formation: Formation) -> list[Edge]:
        """The communication edges with both ends in a formation."""
        inside = set(formation.members)
        return [e for e in self.communication if e.tail in inside and e.head in inside]

    def _place_formations(self, own: dict[str, Array]) -> None:
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
        try:
            for edge in given:
                tail, head = edge.between
                require_ends(tail, head, self._roles, roles)
                if isinstance(edge, Edge):
                    built = edge
                else:
                    built = edge.build(self._ends[tail], self._ends[head])
                    k, parallel = first.setdefault(built.equation, (len(made), edge.parallel))
                    if k < len(made) and not (parallel or edge.parallel):
                        raise InputError(
                            f"{built} says the same as {field}.{k}, {made[k]}, and would count double; leave one out, "
                            "give it another weight, map or offset, or write parallel: true if there are two sensors"
                        )
                if not (built.linear or field in ("communication", "sensing")):
                    what = "directed" if built.directed else "measures"
                    raise InputError(f"{what}: expected on communication and sensing edges alone, not on {field}")
                made.append(_with_offset(built, displacement))
        except InputError as error:
            raise error.within(f"{field}.{len(made)}") from None
        return tuple(made)


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
    return replace(edge, offset=np.array([far]) if edge.measures == "range" else -apart / far)


_EXACT = 1e-7  # of the team's size: residual of an exact shape
_DENSE = 600  # states up to which free directions are counted


@dataclass
class Path:
    """q* along a run, up to the last of the samples computed so far.

    Attributes:
        last: q* there, shape (n_q,), m; None before the first.
        held: Targets there, shape (n_p,), m.
        moving: True if motions have been free at every sample.
    """

    last: Array | None = None
    held: Array | None = None
    moving: bool = True


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
        """Solver with targets and ground held."""
        return self._team.nonlinear_sheaf.solver([*self._team.target_ids, GROUND])

    def extend(self, p: Array, q: Array, path: Path) -> Array:
        """Return q* (..., n_q) of targets at p (..., n_p), near agents at q (..., n_q), m; it continues the path."""
        boundary = p.reshape(-1, p.shape[-1]) if p.shape[-1] else np.zeros((int(np.prod(p.shape[:-1])), 0))
        start = q.reshape(-1, q.shape[-1])
        found = np.full_like(start, np.nan)
        for k, (held, near) in enumerate(zip(boundary, start, strict=True)):
            if np.isfinite(held).all() and np.isfinite(near).all():
                if path.last is None or path.moving:
                    path.last = self.first(held, near).x
                    path.moving = path.moving and self.has_free_motions(path.last, held)
                elif path.held is None or not np.array_equal(held, path.held):
                    path.last = self.solver.settle(path.last, held).x
                found[k] = path.last
            path.held = held
        return found.reshape(q.shape)

    def first(self, held: Array, near: Array) -> Settled:
        """Return q* of targets at `held` (n_p,) from the present positions `near` (n_q,), or from places."""
        found = self.solver.settle(near, held, free=True)
        exact = _EXACT * (1.0 + np.abs(self.solver.relative(near, held)).max(initial=0.0))
        if found.converged and found.residual <= exact:
            return found
        others = (self.solver.settle(x, held, free=True) for x in self._places(held, near))
        return min([found, *others], key=lambda each: (not each.converged, each.residual))

    def has_free_motions(self, q: Array, p: Array) -> bool:
        """Return True if some motion of the agents at q changes no measurement to first order."""
        if self._team.free or len(q) > _DENSE:
            return self._team.free
        values = np.linalg.svd(self.solver.H(q, p).toarray(), compute_uv=False)
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
