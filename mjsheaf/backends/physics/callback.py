"""The callback before every physics step: the law if it is due, then flow, drag, buoyancy and thrust.

An object of ours that writes into MuJoCo's arrays, not one of MuJoCo's global callbacks: those belong to the whole
process, and slow down or break whatever else it simulates.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics.arena import Arena
from mjsheaf.backends.physics.forces import apply_forces, pack_bodies
from mjsheaf.backends.system import System, velocity_commands
from mjsheaf.compiled import kernel
from mjsheaf.engine import mujoco

Array = NDArray[np.float64]


class LoopState(NamedTuple):
    """Views of MuJoCo's arrays, and scratch: x, residual, command (V, 3); R (3, 3); wrench (6,)."""

    qpos: Array
    qvel: Array
    qacc: Array
    ctrl: Array
    gear: Array
    applied: Array
    x: Array
    residual: Array
    command: Array
    R: Array
    wrench: Array


@kernel
def _sample_law(control, medium, bodies, t, state):
    """Measure positions and set the commanded velocities."""
    for v in range(state.x.shape[0]):
        a = bodies.qpos[v]
        state.x[v, 0], state.x[v, 1] = state.qpos[a], state.qpos[a + 1]
        state.x[v, 2] = 0.0 if medium.planar[v] else state.qpos[a + 2]
    velocity_commands(control, t, state.x, state.residual, state.command)


@kernel
def close_loop(control, medium, bodies, t, sample, state):
    """All that happens before a physics step: the law if it is due, then forces and thrust."""
    if sample:
        _sample_law(control, medium, bodies, t, state)
    apply_forces(
        bodies,
        medium,
        t,
        state.command,
        state.qpos,
        state.qvel,
        state.ctrl,
        state.gear,
        state.applied,
        state.R,
        state.wrench,
    )


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
            x=np.zeros((V, 3)),
            residual=np.zeros((V, 3)),
            command=np.zeros((V, 3)),
            R=np.zeros((3, 3)),
            wrench=np.zeros(6),
        )

    def __call__(self, time: float, sample: bool) -> None:
        """Write commands and applied forces for the present state; `sample` says whether the law is evaluated."""
        close_loop(self.control, self.medium, self.bodies, time, sample, self.state)
