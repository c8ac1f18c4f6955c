"""What a run on bodies records of each sample, written inside the compiled loop into arrays allocated once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.callback import controlled_position
from mjsheaf.compiled import part

Array = NDArray[np.float64]


class Log(NamedTuple):
    """Samples of a run, T of them, of which the first `written` are there.

    positions (T, V, 3) m: where the law sees the vehicles; quaternions (T, V, 4); heights (T, V) m, of the bodies;
    thrust (T, A): thruster commands; saturation (T, V): share of thrusters at a limit; placed (T, V - N, 3) m: where
    targets are put at each sample, or (0, V - N, 3) to leave them to their bodies; written (1,).
    """

    positions: Array
    quaternions: Array
    heights: Array
    thrust: Array
    saturation: Array
    placed: Array
    written: NDArray[np.int64]


def new_log(samples: int, vehicles: int, thrusters: int, placed: Array | None = None) -> Log:
    """A log for so many samples; 0 samples record nothing."""
    return Log(
        positions=np.empty((samples, vehicles, 3)),
        quaternions=np.empty((samples, vehicles, 4)),
        heights=np.empty((samples, vehicles)),
        thrust=np.empty((samples, thrusters)),
        saturation=np.empty((samples, vehicles)),
        placed=np.empty((0, 0, 3)) if placed is None else np.ascontiguousarray(placed),
        written=np.zeros(1, dtype=np.int64),
    )


@part
def place_targets(fleet, log, state):
    """Put every target where the log wants its controlled position at this sample, with its attitude and speed."""
    k, bodies = log.written[0], fleet.bodies
    agents = bodies.shape[0] - log.placed.shape[1]
    if k >= log.placed.shape[0]:
        return
    for v in range(agents, bodies.shape[0]):
        x, body, kind = state.x[v], bodies[v], fleet.kinds[bodies[v].kind]
        controlled_position(kind, body, state.qpos, x)
        for i in range(2 if kind.planar else 3):
            state.qpos[body.qpos + i] += log.placed[k, v - agents, i] - x[i]


@part
def record(fleet, state, log):
    """Write the present state, and the commands just made for it, as the next sample."""
    k = log.written[0]
    log.written[0] = k + 1
    for v in range(fleet.bodies.shape[0]):
        body = fleet.bodies[v]
        kind, a = fleet.kinds[body.kind], body.qpos
        controlled_position(kind, body, state.qpos, log.positions[k, v])
        log.heights[k, v] = state.qpos[a + 2]
        for i in range(4):
            log.quaternions[k, v, i] = state.qpos[a + 3 + i]
        at_limit = 0
        for j in range(kind.count):
            command, thruster = state.ctrl[body.actuator + j], fleet.thrusters[kind.thruster + j]
            log.thrust[k, body.actuator + j] = command
            at_limit += command <= thruster.low or command >= thruster.high
        log.saturation[k, v] = at_limit / kind.count
