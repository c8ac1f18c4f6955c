"""eq. controller-1: u_i = -k1 g_i^+ eta_i, with eta = H q - B p - c.

`LocalLaw` is what one agent carries: it is handed its own measurements and nothing else. `disagreement` is the same
law for the whole team at once, as one sparse product whose row i touches only the neighbours of i; the compiled loops
use it. Targets that hold a formation among themselves follow the same equation on their own sheaf.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mjsheaf.jit import part
from mjsheaf.team import Team

Array = NDArray[np.float64]


class LocalLaw:
    """The law of one agent.

    On an edge e = (i, j) with measurement y_e = F_j x_j - F_i x_i and desired value b_e, the tail forms
    d = -F_i^T K (y_e + b_e) and the head d = F_j^T K (y_e + b_e); eta_i is the sum of its d.

    Attributes:
        edges: (tail, head) of each edge at the agent, in the order in which measurements are expected.
        gain: k1 in 1/s.
        limit: largest commanded speed, m/s.
    """

    def __init__(self, team: Team, agent: str, gain: float, limit: float = np.inf) -> None:
        """Keep what the agent needs to know: its own maps, weights and offsets."""
        incident = team.incident_edges(agent)
        self.edges = [(e.tail, e.head) for e in incident]
        self.gain = gain
        self.limit = limit
        self._dimension = team.sheaf.dimension(agent)
        self._pullback = [-e.F_tail.T @ e.weight if e.tail == agent else e.F_head.T @ e.weight for e in incident]
        self._offset = [e.b for e in incident]

    def disagreement(self, measurements: list[Array]) -> Array:
        """eta_i from the measurements y_e of the agent's edges (range times bearing), shape (n_i,), m."""
        eta = np.zeros(self._dimension)
        for pullback, y, b in zip(self._pullback, measurements, self._offset, strict=True):
            eta += pullback @ (y + b)
        return eta

    def command(self, measurements: list[Array], g_pinv: Array | None = None) -> Array:
        """u_i = -k1 g_i^+ eta_i, shape (s_i,), limited; g_i^+ is the identity unless given, shape (s_i, n_i)."""
        velocity = -self.gain * self.disagreement(measurements)
        speed = float(np.linalg.norm(velocity))
        if speed > self.limit:
            velocity *= self.limit / speed
        return velocity if g_pinv is None else g_pinv @ velocity


class LawArrays(NamedTuple):
    """The law of all vehicles over padded positions x (V, 3).

    Residual r = A x - c: the disagreement eta for agents, (L_T p - c_T) for targets. A is held by compressed rows:
    start (3V + 1,), column and value (nnz,); c (3V,). gain (V,) 1/s and limit (V,) m/s, infinite where there is none.
    """

    start: NDArray[np.int64]
    column: NDArray[np.int64]
    value: Array
    c: Array
    gain: Array
    limit: Array


@part
def disagreement(law, x, residual):
    """Write the residual A x - c into residual (V, 3) for positions x (V, 3); a row reads only its neighbours."""
    flat = x.reshape(-1)
    out = residual.reshape(-1)
    for row in range(out.shape[0]):
        total = -law.c[row]
        for k in range(law.start[row], law.start[row + 1]):
            total += law.value[k] * flat[law.column[k]]
        out[row] = total


@part
def limit_speed(limit, velocity):
    """Shorten velocity (3,) to the limit, keeping its direction."""
    speed = np.sqrt(velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2)
    if speed > limit:
        velocity *= limit / speed


def limited_commands(velocity: Array, limit: Array) -> Array:
    """Shorten velocities (T, V, 3) to each vehicle's limit (V,), as the loops do; NaN stays NaN."""
    speed = np.linalg.norm(np.nan_to_num(velocity), axis=2)
    over = speed > limit
    share = np.ones_like(speed)
    share[over] = np.broadcast_to(limit, speed.shape)[over] / speed[over]
    return velocity * share[..., None]


def pack_law(team: Team, gain: float, target_gain: float, limits: Array) -> LawArrays:
    """Assemble the law of a team.

    Args:
        team: the team.
        gain: k1 of the agents, 1/s.
        target_gain: gain of the targets' own consensus, 1/s; 0 where they have none.
        limits: largest commanded speed of each vehicle, m/s, shape (V,).
    """
    problem = team.dirichlet
    n_q, n_p = problem.B.shape
    L_T = team.target_sheaf.laplacian()
    A = sparse.block_array([[problem.H, -problem.B], [sparse.csr_array((n_p, n_q)), L_T]]).tocoo()
    c_T = team.target_sheaf.whitened_coboundary().T @ team.target_sheaf.whitened_offset()
    V = len(team.members)
    padded = sparse.csr_array((A.data, (team.slots[A.row], team.slots[A.col])), shape=(3 * V, 3 * V))
    padded.sort_indices()
    c = np.zeros(3 * V)
    c[team.slots] = np.concatenate([problem.c, c_T])
    gains = np.concatenate([np.full(len(team.agents), gain), np.full(len(team.targets), target_gain)])
    return LawArrays(
        padded.indptr.astype(np.int64),
        padded.indices.astype(np.int64),
        padded.data,
        c,
        gains,
        limits.astype(float),
    )
