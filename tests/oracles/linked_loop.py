"""The law over links, with targets at rest, in plain numpy, step by step: equations (2) and (3) of the paper.

Each edge measures, its numbers are delayed, noisy or lost, and agents follow the law with them, by Chebyshev's
iteration as in textbooks. Without delay and noise it is the ideal backend's run.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mjsheaf.loop.system import System

Array = NDArray[np.float64]


def chebyshev(H: Array, interval: tuple[float, float], rounds: int, x: Array, b: Array) -> Array:
    """Saad, Iterative Methods for Sparse Linear Systems, algorithm 12.1, for rows x of solutions."""
    low, high = interval
    theta, delta = 0.5 * (high + low), 0.5 * (high - low)
    if delta == 0.0:
        return b / theta
    sigma = theta / delta
    rho, residue = 1.0 / sigma, b - x @ H
    step = residue / theta
    for _ in range(rounds):
        x = x + step
        residue = residue - step @ H
        after = 1.0 / (2.0 * sigma - rho)
        step = after * rho * step + 2.0 * after / delta * residue
        rho = after
    return x


class LinkedLoop:
    """R runs of a closed loop, shape (R, n) each."""

    def __init__(self, system: System) -> None:
        team, self.system = system.team, system
        first, n = dict(zip(team.agent_ids, team.first_state, strict=False)), int(team.first_state[-1])
        _, p = team.split(system.initial)
        at, targets = 0, {}
        for target in team.targets:
            targets[target.id] = p[at : at + target.dimension]
            at += target.dimension
        kinds = ((team.communication, False), (team.sensing, True), (team.anchors, False))
        edges = [(e, sensing) for some, sensing in kinds for e in some]
        m = sum(len(e.b) for e, _ in edges)
        self.D, self.N, self.S = np.zeros((m, n)), np.zeros((n, m)), np.zeros((n, m))
        self.y0, self.b, self.edge, begin = np.zeros(m), np.zeros(m), np.zeros(m, dtype=int), 0
        for number, (e, sensing) in enumerate(edges):
            rows = slice(begin, begin + len(e.b))
            begin, self.b[rows], self.edge[rows] = rows.stop, e.b, number
            i = slice(first[e.tail], first[e.tail] + e.F_tail.shape[1])
            self.D[rows, i] = -e.F_tail
            self.N[i, rows] = -e.F_tail.T @ e.weight
            if sensing:
                self.S[i, rows] = e.F_tail.T @ e.weight
                self.y0[rows] = e.F_head @ targets[e.head]
            elif e.head in first:
                j = slice(first[e.head], first[e.head] + e.F_head.shape[1])
                self.D[rows, j] = e.F_head
                self.N[j, rows] = e.F_head.T @ e.weight
        self.E, self.H = len(edges), team.dirichlet.H.toarray()
        self.q_star = np.linalg.solve(self.H, -self.N @ (self.y0 + self.b))

    def agree_at_q_star(self) -> None:
        """Change the offsets so that all edges agree at q*, where a loss then moves no agent."""
        self.b = -(self.y0 + self.D @ self.q_star)

    def run(
        self,
        e0: Array,
        steps: int,
        delay: NDArray[np.int64] | int = 0,
        noise: Array | None = None,
        bias: Array | float = 0.0,
        rng: np.random.Generator | None = None,
        loss: Array | None = None,
    ) -> Iterator[tuple[int, Array, Array]]:
        """Run, and yield (k, e, command) of each sample.

        Args:
            e0: Errors, shape (R, n); delay: Delay of each edge, in periods.
            noise: Factor of standard normal numbers in the noise of y, shape (m, m).
            bias: Bias of y, shape (m,).
            loss: Probability that an edge does not deliver, shape (E,).
        """
        terms, h, k1 = self.system.law.terms, self.system.grid.period, self.system.gain
        late = np.broadcast_to(delay, self.E)[self.edge]
        R, n, m = *e0.shape, len(self.b)
        q, keep = self.q_star - e0, int(late.max()) + 2
        ys, moves, rows = np.zeros((keep, R, m)), np.zeros((keep, R, n)), np.arange(m)
        rate, v, delta, drift, z, command = (np.zeros((R, n)) for _ in range(6))
        before, interval = q, terms.eigenvalues
        for k in range(steps):
            ys[k % keep] = q @ self.D.T + self.y0 + bias
            if noise is not None and rng is not None:
                ys[k % keep] += rng.standard_normal((R, m)) @ noise.T
            moved = q - before + terms.bias * h * (k > 0)
            if terms.noise and rng is not None and k:
                moved = moved + terms.noise * rng.standard_normal((R, n))
            moves[k % keep], before = moved, q
            y = ys[(k - late) % keep, :, rows].T
            z_e = np.where(k >= late, y + self.b, 0.0)
            if loss is not None and rng is not None:
                z_e = z_e * (rng.random((R, self.E)) >= loss)[:, self.edge]
            eta = z_e @ self.N.T
            seen = moved / h - command
            command = -k1 * eta
            if terms.newton:
                delta = chebyshev(self.H, interval, terms.newton, delta, -eta)
                command = k1 * delta
            if terms.feedforward:
                last = ys[(k - late - 1) % keep, :, rows].T
                own = (moves[:, :, :] @ self.D.T)[(k - late) % keep, :, rows].T
                measured = np.where(k > late, (y - last - own) / h, 0.0) @ self.S.T
                rate = rate + (terms.measured if k > 1 else 1.0) * (measured - rate)
                new = chebyshev(self.H, interval, terms.feedforward, v, rate)
                command = command + new + (terms.lead[0] * (new - v) if k > terms.settled else 0.0)
                v = new
            if terms.drift and k:
                drift = drift + (terms.drift if k > 1 else 1.0) * (seen - drift)
                command = command - drift
            command = command - terms.integral * z
            z = z + h * eta
            yield k, self.q_star - q, command
            q = q + h * command
