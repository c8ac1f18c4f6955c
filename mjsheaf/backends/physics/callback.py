"""The callback before every physics step: the law if it is due, then flow, drag, buoyancy and thrust.

An object of ours that writes into MuJoCo's arrays, not one of MuJoCo's global callbacks: those belong to the whole
process, and slow down or break whatever else it simulates.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.arena import Arena
from mjsheaf.backends.physics.autopilot import drive
from mjsheaf.backends.physics.bodies import pack_bodies
from mjsheaf.backends.physics.forces import measure, push
from mjsheaf.backends.system import System, velocity_commands
from mjsheaf.compiled import kernel
from mjsheaf.engine import mujoco

Array = NDArray[np.float64]


class LoopState(NamedTuple):
    """Views of MuJoCo's arrays, what vehicles measure, measured (V, 6), and scratch.

    x, residual, command (V, 3): where the law sees vehicles, eta, and the velocities that it wants; R (3, 3); F (12,).
    """

    qpos: Array
    qvel: Array
    qacc: Array
    ctrl: Array
    gear: Array
    applied: Array
    measured: Array
    x: Array
    residual: Array
    command: Array
    R: Array
    F: Array


@kernel
def controlled_position(bodies, planar, v, qpos, x):
    """Write the position of vehicle v that the law controls into x (3,): its hand point, or its origin."""
    a = bodies.qpos[v]
    x[0], x[1] = qpos[a], qpos[a + 1]
    x[2] = 0.0 if planar[v] else qpos[a + 2]
    if bodies.hand[v] > 0.0:
        w, i, j, k = qpos[a + 3], qpos[a + 4], qpos[a + 5], qpos[a + 6]
        x[0] += bodies.hand[v] * (1.0 - 2.0 * (j * j + k * k))
        x[1] += bodies.hand[v] * 2.0 * (i * j + w * k)


@kernel
def close_loop(control, medium, bodies, t, sample, state):
    """All before a physics step: the law if it is due; then each vehicle measures, is pushed, and drives."""
    V = state.x.shape[0]
    if sample:
        for v in range(V):
            controlled_position(bodies, medium.planar, v, state.qpos, state.x[v])
        velocity_commands(control, t, state.x, state.residual, state.command)
    R = state.R
    for v in range(V):
        a, measured = bodies.qpos[v], state.measured[v]
        measure(bodies, medium, v, t, state.qpos, state.qvel, R, measured)
        push(bodies, v, state.qpos, state.qvel, R, measured, state.applied, state.F)
        drive(bodies, v, state.command[v], R, state.qpos[a + 3 : a + 7], measured, state.ctrl, state.F)
        for k in range(bodies.thruster[v], bodies.thruster[v + 1]):
            x, y, z = bodies.direction[k, 0], bodies.direction[k, 1], bodies.direction[k, 2]
            for i in range(3):
                state.gear[k, i] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z


class BeforeStep:
    """What happens before a physics step, as one callable.

    Attributes:
        control, medium, bodies: what onboard computers know, what surrounds the vehicles, what the vehicles are.
        state: views of MuJoCo's arrays, and scratch; `state.command` holds the commanded velocities (V, 3) in m/s and
            `state.residual` the disagreements (V, 3) in m of the last evaluation of the law.
    """

    def __init__(self, system: System, arena: Arena, data: mujoco.MjData) -> None:
        """Pack the system for the vehicles of an arena, and take views of the arrays that are read and written."""
        V = len(arena.vehicles)
        self.control = system.control
        self.medium = system.medium
        self.bodies = pack_bodies(arena, system.bodies.heading, system.bodies.surface_height)
        self.state = LoopState(
            qpos=data.qpos,
            qvel=data.qvel,
            qacc=data.qacc,
            ctrl=data.ctrl,
            gear=arena.model.actuator_gear,
            applied=data.qfrc_applied,
            measured=np.zeros((V, 6)),
            x=np.zeros((V, 3)),
            residual=np.zeros((V, 3)),
            command=np.zeros((V, 3)),
            R=np.zeros((3, 3)),
            F=np.zeros(12),
        )

    def __call__(self, time: float, sample: bool) -> None:
        """Write commands and applied forces for the present state; `sample` says whether the law is evaluated."""
        close_loop(self.control, self.medium, self.bodies, time, sample, self.state)
