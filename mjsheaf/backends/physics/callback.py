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
from mjsheaf.backends.physics.vectors import rotation, to_world, triple
from mjsheaf.backends.system import System, velocity_commands
from mjsheaf.compiled import kernel
from mjsheaf.engine import mujoco

Array = NDArray[np.float64]


class LoopState(NamedTuple):
    """Views of MuJoCo's arrays; x, residual, command (V, 3): where the law sees vehicles, eta, what it wants."""

    qpos: Array
    qvel: Array
    qacc: Array
    ctrl: Array
    gear: Array
    applied: Array
    x: Array
    residual: Array
    command: Array


@kernel
def controlled_position(body, qpos, x):
    """Write the position of a vehicle that the law controls into x (3,): its hand point, or its origin."""
    a = body.qpos
    x[0], x[1] = qpos[a], qpos[a + 1]
    x[2] = 0.0 if body.planar else qpos[a + 2]
    if body.hand > 0.0:
        w, i, j, k = qpos[a + 3], qpos[a + 4], qpos[a + 5], qpos[a + 6]
        x[0] += body.hand * (1.0 - 2.0 * (j * j + k * k))
        x[1] += body.hand * 2.0 * (i * j + w * k)


@kernel
def close_loop(control, medium, bodies, thrusters, t, sample, state):
    """All before a physics step: the law if it is due; then each vehicle measures, is pushed, and drives."""
    V = state.x.shape[0]
    if sample:
        for v in range(V):
            controlled_position(bodies[v], state.qpos, state.x[v])
        velocity_commands(control, t, state.x, state.residual, state.command)
    q = state.qpos
    for v in range(V):
        body, a = bodies[v], bodies[v].qpos
        quaternion = (q[a + 3], q[a + 4], q[a + 5], q[a + 6])
        R = rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
        s, omega = measure(body, medium, v, t, q, state.qvel, R)
        push(body, q, state.qvel, R, s, omega, state.applied)
        drive(body, thrusters, triple(state.command[v]), R, quaternion, s, omega, state.ctrl)
        for k in range(body.first, body.last):
            gear = to_world(R, triple(thrusters[k].direction))
            state.gear[k, 0], state.gear[k, 1], state.gear[k, 2] = gear


class BeforeStep:
    """What happens before a physics step, as one callable.

    Attributes:
        control, medium: what onboard computers know, and what surrounds the vehicles.
        bodies, thrusters: what the vehicles are; see BODY and THRUSTER.
        state: views of MuJoCo's arrays, and scratch; `state.command` holds the commanded velocities (V, 3) in m/s and
            `state.residual` the disagreements (V, 3) in m of the last evaluation of the law.
    """

    def __init__(self, system: System, arena: Arena, data: mujoco.MjData) -> None:
        """Pack the system for the vehicles of an arena, and take views of the arrays that are read and written."""
        V = len(arena.vehicles)
        self.control = system.control
        self.medium = system.medium
        self.bodies, self.thrusters = pack_bodies(arena, system.bodies.heading, system.bodies.surface_height)
        self.state = LoopState(
            qpos=data.qpos,
            qvel=data.qvel,
            qacc=data.qacc,
            ctrl=data.ctrl,
            gear=arena.model.actuator_gear,
            applied=data.qfrc_applied,
            x=np.zeros((V, 3)),
            residual=np.zeros((V, 3)),
            command=np.zeros((V, 3)),
        )

    def __call__(self, time: float, sample: bool) -> None:
        """Write commands and applied forces for the present state; `sample` says whether the law is evaluated."""
        close_loop(self.control, self.medium, self.bodies, self.thrusters, time, sample, self.state)
