"""A law over its links, linear about q*: what each edge measures, and what its link makes of that."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.checking.held_law import Loop, UndecidedError, loop_of
from mjsheaf.checking.targets import TargetPath
from mjsheaf.control.terms import TermArrays
from mjsheaf.system import System
from mjsheaf.team import Edge, Team

_MOST_INSTANTS = 200  # along q* at which noise of range and bearing is linearised


class MeasuredEdge(NamedTuple):
    """An edge that agents listen to: D q + (what targets add) is measured.

    Attributes:
        slots: states of q that it touches, shape (k,).
        D: shape (m, k).
        K: the inner product, shape (m, m).
        kind: communication, sensing or anchor.
    """

    slots: IntArray
    D: Array
    K: Array
    kind: str

    @property
    def sensing(self) -> bool:
        """Whether feedforward learns a target's velocity from it."""
        return self.kind == "sensing"

    @property
    def linked(self) -> bool:
        """Whether it has a link; anchors measure at once, without error."""
        return self.kind != "anchor"

    @property
    def pull(self) -> Array:
        """What turns its numbers into a part of eta on its slots, D^T K, shape (k, m)."""
        return self.D.T @ self.K

    @property
    def H(self) -> Array:  # noqa: N802 - the paper's symbol
        """Its part of H on its slots, shape (k, k)."""
        return self.pull @ self.D


def measured_edges(team: Team) -> list[MeasuredEdge]:
    """The edges that agents listen to: communication, sensing, anchors, in order."""
    first = dict(zip(team.agent_ids, team.first_state, strict=False))

    def measured(edge: Edge, kind: str) -> MeasuredEdge:
        ends = [(id, sign * F) for id, F, sign in ((edge.head, edge.F_head, 1.0), (edge.tail, edge.F_tail, -1.0))]
        own = [(first[id] + np.arange(F.shape[1]), F) for id, F in ends if id in first]
        return MeasuredEdge(np.concatenate([s for s, _ in own]), np.hstack([F for _, F in own]), edge.weight, kind)

    kinds = (("communication", team.communication), ("sensing", team.sensing), ("anchor", team.anchors))
    return [measured(edge, kind) for kind, edges in kinds for edge in edges]


def spread(edges: Sequence[MeasuredEdge], parts: Sequence[Array], n: int) -> Array:
    """The sum of matrices on each edge's slots, shape (n, n)."""
    total = np.zeros((n, n))
    for edge, part in zip(edges, parts, strict=True):
        total[np.ix_(edge.slots, edge.slots)] += part
    return total


@dataclass(frozen=True)
class LinkParameters:
    """The links of E edges, in the order of `measured_edges`.

    Attributes:
        delay: ages of measurements in whole periods, shape (E,).
        noise: covariance of each edge's numbers, shapes (m_e, m_e), m^2.
        bias: of each edge's numbers, shapes (m_e,), m.
        loss: probabilities a sample to turn bad and to turn good, and of loss while good and while bad, shape (E, 4);
            without bursts (0, 1, p, p).
        held: whether a lost sample is replaced by an older one, shape (E,).
        linearised: whether a covariance is that of range and bearing.
        ranged: whether a link falls silent beyond some range.
    """

    delay: IntArray
    noise: tuple[Array, ...]
    bias: tuple[Array, ...]
    loss: Array
    held: BoolArray
    linearised: bool = False
    ranged: bool = False

    @property
    def lossy(self) -> BoolArray:
        """Whether an edge loses measurements, shape (E,)."""
        return np.asarray((self.loss[:, 2:] > 0.0).any(axis=1))

    @property
    def noisy(self) -> bool:
        """Whether an edge has noise or bias."""
        return any(x.any() for x in (*self.noise, *self.bias))

    @property
    def exact(self) -> bool:
        """Whether all is measured at once, without error."""
        return not (self.lossy.any() or self.delay.any() or self.noisy or self.ranged)

    @property
    def delivered(self) -> Array:
        """The share of an edge's measurements that arrive in the long run, shape (E,)."""
        to_bad, to_good, good, bad = self.loss.T
        total = to_bad + to_good
        share = np.where(total > 0.0, to_bad / np.where(total > 0.0, total, 1.0), 0.0)
        return np.asarray(1.0 - share * bad - (1.0 - share) * good)


def perfect_links(edges: Sequence[MeasuredEdge]) -> LinkParameters:
    """Links without delay, noise and loss."""
    E = len(edges)
    noise = tuple(np.zeros((len(edge.D),) * 2) for edge in edges)
    bias = tuple(np.zeros(len(edge.D)) for edge in edges)
    loss = np.tile([0.0, 1.0, 0.0, 0.0], (E, 1))
    return LinkParameters(np.zeros(E, dtype=np.int64), noise, bias, loss, np.zeros(E, dtype=np.bool_))


@dataclass(frozen=True)
class LinkedLaw:
    """A law over its links, linear about q*, on ideal kinematics.

    Attributes:
        loop: of the law as if its links were exact.
        vectors: eigenvectors of H, shape (n, n), in the order of the loop's eigenvalues.
        edges: that agents listen to.
        links: theirs.
        terms: of the law.
    """

    loop: Loop
    vectors: Array
    edges: list[MeasuredEdge]
    links: LinkParameters
    terms: TermArrays

    @property
    def paper(self) -> bool:
        """Whether the loop itself, but for what stands beside it, is that of the paper's law."""
        return not (self.terms.newton or self.terms.integral)

    def spread(self, parts: Sequence[Array]) -> Array:
        """The sum of matrices on each edge's slots, shape (n, n)."""
        return spread(self.edges, parts, len(self.vectors))


def linked_law(system: System, path: TargetPath) -> LinkedLaw:
    """The law of a system over its links.

    Raises:
        UndecidedError: the law is continuous, H has no known eigenvectors, or bodies are beyond a link's range.
    """
    loop, vectors = loop_of(system), system.team.dirichlet.eigenvectors[1]
    return LinkedLaw(loop, vectors, measured_edges(system.team), links_of(system, path), system.law.terms)


def links_of(system: System, path: TargetPath) -> LinkParameters:
    """The links of a system; noise of range and bearing is the mean of its linearisations along q*.

    Raises:
        UndecidedError: bodies are beyond a link's range at the start, or at q* at times.
    """
    team, table, of, law = system.team, system.law.links.table, system.law.links.of, system.law.edges
    edges = measured_edges(team)
    links, N = perfect_links(edges), len(team.agents)
    if not len(table):
        return links
    noise, bias = list(links.noise), list(links.bias)
    x = path.positions.copy()
    x[:, :N] = team.unpack(path.q_star)
    everywhere = np.concatenate([system.initial[None], x]) + system.law.links.lift[None, :, None] * [0.0, 0.0, 1.0]
    x = x[:: max(1, len(x) // _MOST_INSTANTS)]
    for e in np.flatnonzero([edge.linked for edge in edges]):
        if of[e] < 0:
            continue
        link, m = table[of[e]], len(edges[e].D)
        tail, head = law.tail[e], law.head[e]
        apart = np.linalg.norm(everywhere[:, head] - everywhere[:, tail], axis=1)
        if apart.max() > link["range"]:
            when = "at the start" if apart[0] > link["range"] else "at q* at times"
            raise UndecidedError(f"{team.members[tail].id} and {team.members[head].id} are beyond range {when}")
        links.delay[e] = link["delay"]
        links.held[e] = link["hold"] > 0
        if link["lossy"]:
            links.loss[e] = [link[name] for name in ("to_bad", "to_good", "loss_good", "loss_bad")]
        bias[e] = np.full(m, link["bias"])
        noise[e] = link["noise"] ** 2 * np.eye(m)
        if link["bearing"]:
            rows = slice(law.first[e], law.first[e + 1])
            y = x[:, head] @ law.F_head[rows].T - x[:, tail] @ law.F_tail[rows].T
            far, angle = float(link["range_noise"]), float(link["bearing_noise"])
            turns = repeat(None) if m == 2 else _facing(x[:, tail], system, tail) @ law.F_tail[rows].T
            each = [range_bearing_covariance(at, far, angle, turn) for at, turn in zip(y, turns, strict=False)]
            noise[e] = np.mean(each, axis=0)
    ranged = bool(np.isfinite(table["range"]).any())
    return replace(links, noise=tuple(noise), bias=tuple(bias), linearised=bool(table["bearing"].any()), ranged=ranged)


def range_bearing_covariance(y: Array, range_noise: float, bearing_noise: float, body: Array | None = None) -> Array:
    """Covariance of y as measured by range and bearing, linearised, shape (m, m), m^2.

    Args:
        y: the relative position, shape (m,), m; m is 2 or 3.
        range_noise, bearing_noise: standard deviations, m and rad. In space azimuth and elevation have it each.
        body: rotation from the coordinates of y to those of the body, shape (m, m), about whose last axis azimuth
            turns; None where they are the same.
    """
    turn = np.eye(len(y)) if body is None else body
    seen = turn @ y
    r, flat = float(np.linalg.norm(seen)), float(np.hypot(*seen[:2]))
    if r == 0.0:
        return np.zeros((len(y),) * 2)  # a range of zero has no direction
    cos, sin = (seen[:2] / flat) if flat > 0.0 else (1.0, 0.0)
    columns = [range_noise * seen / r, bearing_noise * flat * np.array([-sin, cos, 0.0][: len(y)])]
    if len(y) == 3:
        columns.append(bearing_noise * np.array([-seen[2] * cos, -seen[2] * sin, flat]))
    J = turn.T @ np.stack(columns, axis=1)
    return J @ J.T


def _facing(x: Array, system: System, v: int) -> Array:
    """Rotations from the world to a body that faces where it moves along x (T, 3), its second axis level."""
    motion = np.diff(x, axis=0, append=x[-1:])
    if len(x) > 1:
        motion[-1] = motion[-2]
    yaw, level = np.arctan2(motion[:, 1], motion[:, 0]), np.hypot(motion[:, 0], motion[:, 1])
    pitch = -np.arctan2(motion[:, 2], level)
    still = ~motion.any(axis=1)
    yaw[still], pitch[still] = system.bodies.heading[v], 0.0
    turns = Rotation.from_euler("ZY", np.column_stack([yaw, pitch]))
    return np.asarray(turns.inv().as_matrix())
