"""Drift dynamics along a run: f_p of the targets, and f_q of the agents."""

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.system import System, flow_about, velocity_commands
from mjsheaf.compiled import kernel

Array = NDArray[np.float64]


@kernel
def _target_drifts(control, medium, time, positions, residual, command, out):
    N = medium.agents
    for k in range(len(time)):
        velocity_commands(control, time[k], positions[k], residual, command)
        for v in range(N, positions.shape[1]):
            x = positions[k, v]
            wx, wy, wz = flow_about(medium, v, x[0], x[1], x[2])
            out[k, v - N, 0] = command[v, 0] + wx
            out[k, v - N, 1] = command[v, 1] + wy
            out[k, v - N, 2] = command[v, 2] + wz


def target_drift(system: System, time: Array, positions: Array) -> Array:
    """f_p(p, t): reference, consensus and flow of every target, without disturbance; shape (T, M, 3), m/s."""
    V, N = len(system.team.members), len(system.team.agents)
    out = np.empty((len(time), V - N, 3))
    scratch = np.zeros((2, V, 3))
    _target_drifts(system.control, system.medium, time, np.ascontiguousarray(positions), *scratch, out)
    return out


def agent_drift(system: System, q: Array) -> Array:
    """f_q at stacked agent states (T, n_q): the flow that agents meet, stacked; shape (T, n_q), m/s."""
    spread = system.team.unpack(q)
    w = np.stack([system.flow_of(i).velocity(spread[:, i]) for i in range(spread.shape[1])], axis=1)
    n_q = system.team.dirichlet.H.shape[0]
    return w.reshape(len(q), -1)[:, system.team.slots[:n_q]]
