"""A law over its links, linear about q*: what each edge measures, and what its link makes of that.

Range and bearing in space. Azimuth and elevation have the noise s each, in a body frame that faces along the last
displacement d of the tail. With b the third axis of that frame, r the range and l the line of sight, azimuth moves the
measured point by s r |l x b| along b x l, and elevation by s r across both. So their second moment has the trace
s^2 r^2 (1 + |l x b|^2): it depends on the frame. The noise of a sample is drawn after its frame is fixed, and has mean
zero given the frame (to first order in s), so that noises of different samples are uncorrelated, and every covariance
follows from the mean over the frames alone.

Frames are random where noise moves the agent. d is the motion of q* over a period plus h times the command that noise
makes, whose covariance the linear law has. `SpatialBearing.covariance` takes the mean over normal d, and
`link_noise` iterates, as the covariance of the command depends on the noise. (d is a sum of noises with different
frames, so that it is only nearly normal. Where q* rests, a heading that nothing turns was wrong by up to 7 %.)
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.checking.loop.held_law import eigen_of, loop_of
from mjsheaf.checking.loop.sampled_loop import Loop
from mjsheaf.checking.theorem.targets import TargetPath
from mjsheaf.errors import UndecidedError
from mjsheaf.law.terms import TermArrays
from mjsheaf.system import System
from mjsheaf.team import Edge, Team

_MOST_INSTANTS = 200  # along q* at which noise of range and bearing is linearised
_TURNED_INSTANTS = 20  # number of these instants with the mean over frames that noise turns
_NODES = 8  # of Gauss-Hermite quadrature in each direction of a displacement
_STILL = 1e-9  # m in a period: no direction of motion


class MeasuredEdge(NamedTuple):
    """An edge that agents listen to: D q + (what targets add) is measured.

    Attributes:
        slots: states of q that it touches, shape (k,).
        D: shape (m, k).
        K: the inner product, shape (m, m); of an edge that does not fit, the derivative of its pull.
        kind: communication, sensing or anchor.
        z: relative position of an edge that does not fit, which is what D measures then, shape (m,), m; None else.
    """

    slots: IntArray
    D: Array
    K: Array
    kind: str
    z: Array | None = None

    @property
    def sensing(self) -> bool:
        """Return True if feedforward learns a target's velocity from it."""
        return self.kind == "sensing"

    @property
    def linked(self) -> bool:
        """Return True if it has a link; anchors measure at once, without error."""
        return self.kind != "anchor"

    @property
    def pull(self) -> Array:
        """Matrix from its numbers to a part of eta on its slots, D^T K, shape (k, m)."""
        return self.D.T @ self.K

    @property
    def H(self) -> Array:  # noqa: N802 - the paper's symbol
        """Its part of H on its slots, shape (k, k)."""
        return self.pull @ self.D


def measured_edges(team: Team) -> list[MeasuredEdge]:
    """The edges that agents listen to: communication, sensing, anchors, in order."""
    first = dict(zip(team.agent_ids, team.first_state, strict=False))

    def measured(edge: Edge, kind: str) -> MeasuredEdge:
        F_tail, F_head, K, z = edge.slope or (edge.F_tail, edge.F_head, edge.weight, None)
        ends = [(id, sign * F) for id, F, sign in ((edge.head, F_head, 1.0), (edge.tail, F_tail, -1.0))]
        own = [(first[id] + np.arange(F.shape[1]), F) for id, F in ends if id in first]
        return MeasuredEdge(np.concatenate([s for s, _ in own]), np.hstack([F for _, F in own]), K, kind, z)

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
        bias: Bias of each edge's numbers, shapes (m_e,), m.
        loss: probabilities a sample to turn bad and to turn good, and of loss while good and while bad, shape (E, 4);
            without bursts (0, 1, p, p).
        held: True where a lost sample is replaced by an older one, shape (E,).
        linearised: True if a covariance is that of range and bearing.
        spatial: edges with range and bearing in space, whose noise depends on how the tail turns.
        ranged: True if a link receives nothing beyond some range.
    """

    delay: IntArray
    noise: tuple[Array, ...]
    bias: tuple[Array, ...]
    loss: Array
    held: BoolArray
    linearised: bool = False
    spatial: "tuple[SpatialBearing, ...]" = ()
    ranged: bool = False

    @property
    def lossy(self) -> BoolArray:
        """True for each edge that loses measurements, shape (E,)."""
        return np.asarray((self.loss[:, 2:] > 0.0).any(axis=1))

    @property
    def noisy(self) -> bool:
        """Return True if an edge has noise or bias."""
        return any(x.any() for x in (*self.noise, *self.bias))

    @property
    def exact(self) -> bool:
        """Return True if everything is measured at once, without error."""
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
        loop: Loop of the law as if its links were exact.
        vectors: Eigenvectors of H in the order of the loop's L eigenvalues, shape (n, L); of a free team L < n.
        edges: that agents listen to.
        links: theirs.
        terms: Terms of the law.
    """

    loop: Loop
    vectors: Array
    edges: list[MeasuredEdge]
    links: LinkParameters
    terms: TermArrays

    @property
    def paper(self) -> bool:
        """Return True if the loop itself, apart from additive terms, is that of the paper's law."""
        return not (self.terms.newton or self.terms.integral)

    @property
    def linked(self) -> BoolArray:
        """True for each edge that has a link, shape (E,)."""
        return np.array([edge.linked for edge in self.edges])

    def spread(self, parts: Sequence[Array]) -> Array:
        """The sum of matrices on each edge's slots, shape (n, n)."""
        return spread(self.edges, parts, len(self.vectors))


def linked_law(system: System, path: TargetPath) -> LinkedLaw:
    """The law of a system over its links.

    Raises:
        UndecidedError: the law is continuous, H has no known eigenvectors, or bodies are beyond a link's range.
    """
    loop, vectors = loop_of(system), eigen_of(system)[1]
    return LinkedLaw(loop, vectors, measured_edges(system.team), links_of(system, path), system.law.terms)


def links_of(system: System, path: TargetPath) -> LinkParameters:
    """The links of a system; noise of range and bearing is the mean of its linearisations along q*.

    Raises:
        UndecidedError: bodies are beyond a link's range at the start, or at q* at times.
    """
    team = system.team
    table = system.law.links.table
    of = system.law.links.of
    edges = measured_edges(team)
    links = perfect_links(edges)
    if not len(table):
        return links
    noise = list(links.noise)
    bias = list(links.bias)
    spatial = list[SpatialBearing]()
    x = path.positions.copy()
    x[:, : len(team.agents)] = team.unpack(path.q_star)
    everywhere = np.concatenate([system.initial[None], x]) + system.law.links.lift[None, :, None] * [0.0, 0.0, 1.0]
    few = slice(None, None, max(1, len(x) // _MOST_INSTANTS))
    for e in [e for e, edge in enumerate(edges) if edge.linked and of[e] >= 0]:
        link = table[of[e]]
        _require_in_range(system, e, everywhere, link["range"])
        links.delay[e] = link["delay"]
        links.held[e] = link["hold"] > 0
        if link["lossy"]:
            links.loss[e] = link[["to_bad", "to_good", "loss_good", "loss_bad"]].tolist()
        m = len(edges[e].D)
        bias[e] = np.full(m, link["bias"])
        noise[e] = link["noise"] ** 2 * np.eye(m)
        if (z := edges[e].z) is not None:  # the error of a range is along z, that of a bearing turns z
            along = np.outer(z, z) / (z @ z)
            ranged = team.measuring_edges[e].F_tail.shape[0] == 1 and m > 1
            bias[e] = link["bias"] * z / np.linalg.norm(z)
            noise[e] = link["noise"] ** 2 * (along if ranged else z @ z * (np.eye(m) - along))
        if link["bearing"] and m == 2:
            y = _relative_positions(system, e, x[few])
            deviations = (float(link["range_noise"]), float(link["bearing_noise"]))
            noise[e] = np.mean(range_bearing_covariances(y, *deviations), axis=0)
        elif link["bearing"]:
            spatial.append(_spatial_bearing(system, e, x[few], path.time[few]))
            noise[e] = spatial[-1].covariance(np.zeros((3, 3)))
    return replace(
        links,
        noise=tuple(noise),
        bias=tuple(bias),
        linearised=bool(table["bearing"].any()),
        spatial=tuple(spatial),
        ranged=bool(np.isfinite(table["range"]).any()),
    )


def _require_in_range(system: System, e: int, x: Array, reach: float) -> None:
    """Refuse an edge whose ends are beyond the reach of its link, m, at the first or at later positions (T, V, 3), m.

    Raises:
        UndecidedError: They are.
    """
    tail = system.law.edges.tail[e]
    head = system.law.edges.head[e]
    apart = np.linalg.norm(x[:, head] - x[:, tail], axis=1)
    if apart.max() > reach:
        when = "at the start" if apart[0] > reach else "at q* at times"
        ends = f"{system.team.members[tail].id} and {system.team.members[head].id}"
        raise UndecidedError(f"{ends} are beyond range {when}")


def _relative_positions(system: System, e: int, x: Array) -> Array:
    """Return what an edge compares at positions (T, V, 3), m: the head less the tail, shape (T, m), m."""
    edges = system.law.edges
    rows = slice(edges.first[e], edges.first[e + 1])
    return x[:, edges.head[e]] @ edges.F_head[rows].T - x[:, edges.tail[e]] @ edges.F_tail[rows].T


def _spatial_bearing(system: System, e: int, x: Array, time: Array) -> "SpatialBearing":
    """Return an edge with range and bearing in space, along positions (T, V, 3), m, at times (T,), s."""
    link = system.law.links.table[system.law.links.of[e]]
    edges = system.law.edges
    tail = edges.tail[e]
    y = _relative_positions(system, e, x)
    return SpatialBearing(
        edge=e,
        slots=system.team.first_state[tail] + np.arange(3),
        y=y,
        motion=np.gradient(x[:, tail], time, axis=0) * system.grid.period if len(time) > 1 else 0.0 * y,
        F=edges.F_tail[edges.first[e] : edges.first[e + 1]],
        heading=float(system.bodies.heading[tail]),
        range_noise=float(link["range_noise"]),
        bearing_noise=float(link["bearing_noise"]),
    )


def range_bearing_covariances(y: Array, range_noise: float, bearing_noise: float, body: Array | None = None) -> Array:
    """Covariances of y as measured by range and bearing, linearised, shape (T, m, m), m^2.

    Args:
        y: Relative positions, shape (T, m), m; m is 2 or 3.
        range_noise, bearing_noise: Standard deviations, m and rad. In space azimuth and elevation have it each.
        body: Rotations from the coordinates of y to those of the body, shape (T, m, m), about whose last axis azimuth
            turns; None where they are the same.
    """
    T, m = y.shape
    turn = np.broadcast_to(np.eye(m), (T, m, m)) if body is None else body
    seen = (turn @ y[:, :, None])[:, :, 0]
    r, flat = np.linalg.norm(seen, axis=1), np.hypot(seen[:, 0], seen[:, 1])
    one = np.where(flat > 0.0, flat, 1.0)
    cos = np.where(flat > 0.0, seen[:, 0] / one, 1.0)
    sin = np.where(flat > 0.0, seen[:, 1] / one, 0.0)
    columns = np.zeros((T, m, m))
    columns[:, :, 0] = range_noise * seen / np.where(r > 0.0, r, 1.0)[:, None]  # a range of zero has no direction
    columns[:, 0, 1] = -bearing_noise * flat * sin
    columns[:, 1, 1] = bearing_noise * flat * cos
    if m == 3:
        columns[:, 0, 2] = -bearing_noise * seen[:, 2] * cos
        columns[:, 1, 2] = -bearing_noise * seen[:, 2] * sin
        columns[:, 2, 2] = bearing_noise * flat
    J = turn.swapaxes(1, 2) @ columns
    return np.asarray(J @ J.swapaxes(1, 2))


@dataclass(frozen=True)
class SpatialBearing:
    """An edge measured by range and bearing in space, from a body that faces along its last displacement.

    Attributes:
        edge: Number of the edge, in the order of `measured_edges`.
        slots: States of q of its tail, shape (3,).
        y: Relative positions along q*, shape (T, 3), m.
        motion: Displacement of the tail over a period along q*, shape (T, 3), m.
        F: Restriction map of the tail, a rotation, shape (3, 3).
        heading: Initial heading of the tail, rad, which a body that never moves keeps.
        range_noise, bearing_noise: Standard deviations, m and rad.
    """

    edge: int
    slots: IntArray
    y: Array
    motion: Array
    F: Array
    heading: float
    range_noise: float
    bearing_noise: float

    def covariance(self, spread: Array) -> Array:
        """Return the mean covariance of the measured numbers, shape (3, 3), m^2.

        Args:
            spread: Covariance of the displacement that noise adds to `motion`, shape (3, 3), m^2.
        """
        y, d, weight = self.y, self.motion, np.ones(1)
        values, vectors = np.linalg.eigh(spread)
        if values[-1] > _STILL**2:
            nodes, weight = _normal_nodes()
            few = slice(None, None, -(-len(y) // _TURNED_INSTANTS))
            d = d[few, None] + nodes @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
            y = np.repeat(y[few], len(nodes), axis=0)
            d = d.reshape(-1, 3)
        body = self._facing(d) @ self.F.T
        each = range_bearing_covariances(y, self.range_noise, self.bearing_noise, body)
        return np.asarray(np.tensordot(weight, each.reshape(-1, len(weight), 3, 3).mean(axis=0), 1))

    def _facing(self, d: Array) -> Array:
        """Return rotations from the world to a body that faces along d (K, 3), its second axis level, (K, 3, 3)."""
        level = np.hypot(d[:, 0], d[:, 1])
        yaw = np.where(level > 0.0, np.arctan2(d[:, 1], d[:, 0]), 0.0)
        pitch = -np.arctan2(d[:, 2], level)
        still = np.linalg.norm(d, axis=1) <= _STILL
        yaw[still] = self.heading
        pitch[still] = 0.0
        return np.asarray(Rotation.from_euler("ZY", np.column_stack([yaw, pitch])).inv().as_matrix())


@cache
def _normal_nodes() -> tuple[Array, Array]:
    """Nodes (K, 3) and weights (K,) of a quadrature over independent standard normal numbers."""
    x, w = np.polynomial.hermite_e.hermegauss(_NODES)
    nodes = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1).reshape(-1, 3)
    weights = (w[:, None, None] * w[None, :, None] * w).ravel()
    return nodes, weights / weights.sum()
