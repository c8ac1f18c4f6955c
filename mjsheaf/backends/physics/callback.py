"""The callback before every physics step: the law if it is due, then flow, drag, buoyancy and thrust.

An object of ours that writes into MuJoCo's arrays, not one of MuJoCo's global callbacks: those belong to the whole
process, and slow down or break whatever else it simulates.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.arena import Arena
from mjsheaf.backends.physics.autopilot import drive
from mjsheaf.backends.physics.bodies import pack_fleet
from mjsheaf.backends.physics.forces import measure, push
from mjsheaf.backends.physics.vectors import rotation, to_world, triple
from mjsheaf.backends.system import ControlArrays, MediumArrays, velocity_commands
from mjsheaf.compiled import kernel
from mjsheaf.dynamics.disturbance import evaluate_sines
from mjsheaf.engine import mujoco

Array = NDArray[np.float64]


class LoopState(NamedTuple):
    """Views of MuJoCo's arrays; x, residual, command (V, 3): where the law sees vehicles, eta, what it wants.

    sines (V K,): of the disturbances, now.
    """

    qpos: Array
    qvel: Array
    qacc: Array
    ctrl: Array
    gear: Array
    applied: Array
    x: Array
    residual: Array
    command: Array
    sines: Array


@kernel
def controlled_position(kind, body, qpos, x):
    """Write the position of a vehicle that the law controls into x (3,): its hand point, or its origin."""
    a = body.qpos
    x[0], x[1] = qpos[a], qpos[a + 1]
    x[2] = 0.0 if kind.planar else qpos[a + 2]
    if kind.hand > 0.0:
        w, i, j, k = qpos[a + 3], qpos[a + 4], qpos[a + 5], qpos[a + 6]
        x[0] += kind.hand * (1.0 - 2.0 * (j * j + k * k))
        x[1] += kind.hand * 2.0 * (i * j + w * k)


@kernel
def close_loop(control, medium, fleet, t, sample, state):
    """All before a physics step: the law if it is due; then each vehicle measures, is pushed, and drives."""
    kinds, bodies = fleet.kinds, fleet.bodies
    if sample:
        for v in range(bodies.shape[0]):
            controlled_position(kinds[bodies[v].kind], bodies[v], state.qpos, state.x[v])
        velocity_commands(control, t, state.x, state.residual, state.command)
    evaluate_sines(medium.harmonics, t, 0, bodies.shape[0], state.sines)
    q = state.qpos
    for v in range(bodies.shape[0]):
        body = bodies[v]
        kind, a, first = kinds[body.kind], body.qpos, body.actuator
        thrusters = fleet.thrusters[kind.thruster : kind.thruster + kind.count]
        ctrl = state.ctrl[first : first + kind.count]
        quaternion = (q[a + 3], q[a + 4], q[a + 5], q[a + 6])
        R = rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
        s, omega = measure(kind, body, medium, state.sines, v, q, state.qvel, R)
        push(kind, body, q, state.qvel, R, s, omega, state.applied)
        drive(kind, thrusters, body.heading, triple(state.command[v]), R, quaternion, s, omega, ctrl)
        for k in range(kind.count):
            gear, row = to_world(R, triple(thrusters[k].direction)), state.gear[first + k]
            row[0], row[1], row[2] = gear


class BeforeStep:
    """What happens before a physics step, as one callable.

    Attributes:
        control, medium: what onboard computers know, and what surrounds the vehicles.
        fleet: what the vehicles are.
        state: views of MuJoCo's arrays, and scratch; `state.command` holds the commanded velocities (V, 3) in m/s and
            `state.residual` the disagreements (V, 3) in m of the last evaluation of the law.
    """

    def __init__(
        self,
        control: ControlArrays,
        medium: MediumArrays,
        arena: Arena,
        data: mujoco.MjData,
        heading: Array,
        level: float,
    ) -> None:
        """Pack the vehicles of an arena, and take views of the arrays that are read and written.

        Args:
            control, medium: the same as the attributes.
            arena, data: the vehicles and their state.
            heading: that each vehicle holds, shape (V,), rad.
            level: height of the water, m.
        """
        V = len(arena.vehicles)
        self.control = control
        self.medium = medium
        self.fleet = pack_fleet(arena, heading, level)
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
            sines=np.zeros(len(medium.harmonics.rate)),
        )

    def __call__(self, time: float, sample: bool) -> None:
        """Write commands and applied forces for the present state; `sample` says whether the law is evaluated."""
        close_loop(self.control, self.medium, self.fleet, time, sample, self.state)
