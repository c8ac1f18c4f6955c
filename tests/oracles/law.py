"""The law by its definitions, edge by edge: measurements and eq. controller-1 of the paper, with weights and offsets.

An edge e = (i, j) measures y_e = F_j x_j - F_i x_i. Its tail adds -F_i^T K (y_e + b_e) to its eta, its head
F_j^T K (y_e + b_e), and q* is where every eta is zero; for ranges and bearings see `pull`. Positions x are padded to
(..., V, 3), m, agents first.

Of the package it takes the team's matrices, and for `velocity_commands` and `medium` the targets' reference, the steady
flow and the disturbance, which tests of their own hold to formulas.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjsheaf.law.paths import add_reference
from mjsheaf.loop.system import System
from mjsheaf.media import varying
from mjsheaf.team import Edge, Team

Array = NDArray[np.float64]


def measurement(team: Team, edge: Edge, x: Array) -> Array:
    """Return y of an edge, shape (..., m); the ground, where anchors end, is at zero."""
    y = -x[..., team.index[edge.tail], : edge.F_tail.shape[1]] @ edge.F_tail.T
    if edge.head in team.index:
        y = y + x[..., team.index[edge.head], : edge.F_head.shape[1]] @ edge.F_head.T
    return np.asarray(y)


def residual(team: Team, edge: Edge, x: Array) -> Array:
    """Return how far an edge is from its desired value, m, shape (...).

    Of a bearing it is the distance from the place at the same range in the desired direction.
    """
    z = measurement(team, edge, x) + edge.b
    length = np.linalg.norm(z, axis=-1)
    if edge.measures == "range":
        return np.abs(length - edge.desired[0])
    return np.linalg.norm(z - length[..., None] * edge.desired, axis=-1) if edge.measures == "bearing" else length


def residuals_of(team: Team, x: Array) -> dict[str, float]:
    """Return the residuals of edges with two ends by name, such as A1-A2, of a team at positions x (V, 3), m."""
    edges = (*team.communication, *team.sensing)
    return {f"{edge.tail}-{edge.head}": float(residual(team, edge, x)) for edge in edges}


def pull(edge: Edge, z: Array) -> Array:
    """Return what an edge that measures z (..., m), offset included, pulls its tail with, before K, shape (..., m).

    That is z itself; of a desired range r it is (1 - r / |z|) z, of a desired bearing g it is z (z . g) / |z|^2 - g.
    """
    if edge.measures == "position":
        return z
    length = np.linalg.norm(z, axis=-1, keepdims=True)
    if edge.measures == "range":
        return np.asarray((1.0 - edge.desired[0] / length) * z)
    return np.asarray(z * (z @ edge.desired)[..., None] / length**2 - edge.desired)


def disagreement(
    team: Team, x: Array, edges: Sequence[Edge] | None = None, measured: Sequence[Array] | None = None
) -> Array:
    """Return eta of all vehicles, shape (..., V, 3); of agents from all their edges, unless edges are given.

    Args:
        team: Team.
        x: Positions.
        edges: Edges that count. Of two targets both ends move, of an agent and a target the agent.
        measured: Measurements to use in place of the true ones, (..., m) for each edge.
    """
    eta = np.zeros(x.shape)
    for k, e in enumerate(team.measuring_edges if edges is None else edges):
        y = measurement(team, e, x) if measured is None else measured[k]
        pulled = pull(e, y + e.b) @ e.weight
        tail, head = team.index[e.tail], team.index.get(e.head)
        eta[..., tail, : e.F_tail.shape[1]] -= pulled @ e.F_tail
        alike = head is not None and (head < len(team.agents)) == (tail < len(team.agents))
        if alike and not e.directed:
            eta[..., head, : e.F_head.shape[1]] += pulled @ e.F_head
    return eta


class PaperLaw:
    """-k1 eta of one agent, from the measurements that it is handed and nothing else, for `PerAgent`."""

    def __init__(self, agent: Any, gain: float) -> None:
        self.agent, self.gain = agent, gain

    def __call__(self, t: float, local: Any) -> Array:
        eta = np.zeros(self.agent.dimension)
        for e, y in zip(local.edges, local.measurements, strict=True):
            pull = e.weight @ (y + e.b)
            eta += -e.F_tail.T @ pull if e.tail == self.agent.id else e.F_head.T @ pull
        return -self.gain * eta


def velocity_commands(system: System, t: float, x: Array) -> Array:
    """Return -k1 eta of agents, and -k_T (L_T p - c_T) + v(t) of targets, shape (V, 3), m/s."""
    team = system.team
    command = -system.gain * disagreement(team, x) - system.law.gain[-1] * disagreement(team, x, team.target_edges)
    for v in range(len(x)):
        add_reference(system.motion, v, t, x[v], command[v])
    return command


def medium(system: System, v: int, t: float, x: Array) -> Array:
    """Return the flow and the disturbance about vehicle v at x (3,), m/s."""
    w = system.flows[system.field[v]].velocity(x)
    w[system.team.members[v].dimension :] = 0.0
    return w + varying.evaluate(system.harmonics, np.array([t]))[0, v]


def coboundary(team: Team) -> Array:
    """Return sqrt(K) delta on the agents, block by block, for inner products c I alone; a last row is zero."""
    first = dict(zip(team.agent_ids, team.first_state.tolist(), strict=False))
    n = int(team.first_state[-1])
    rows = []
    for e in team.measuring_edges:
        row = np.zeros((len(e.F_tail), n))
        for end, F in ((e.tail, e.F_tail), (e.head, -e.F_head)):
            if end in first:
                row[:, first[end] : first[end] + F.shape[1]] += np.sqrt(e.weight[0, 0]) * F
        rows.append(row)
    return np.vstack([*rows, np.zeros((1, n))])


def harmonic_extension(team: Team, targets: Array, edges: Sequence[Edge] | None = None) -> Array:
    """Return q* for places of the targets (M, 3), m: where every eta is zero, of least size; shape (N, 3), padded."""
    N, own = len(team.agents), team.slots[: team.first_state[-1]]
    n = len(own)
    x = np.zeros((n + 1, len(team.members), 3))
    x[:, N:] = np.nan_to_num(targets)
    x.reshape(n + 1, -1)[np.arange(n), own] = 1.0
    eta = disagreement(team, x, edges).reshape(n + 1, -1)[:, own]
    q = np.zeros((N, 3))
    q.reshape(-1)[own] = np.linalg.lstsq((eta[:n] - eta[n]).T, -eta[n], rcond=None)[0]
    return q
