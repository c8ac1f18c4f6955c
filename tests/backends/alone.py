"""One vehicle alone in a medium that is at rest or moves evenly, asked for a constant velocity."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mjsheaf import World
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.vehicle import Vehicle

from .small import make

Array = NDArray[np.float64]

REAL = ("hexarotor", "quadrotor", "x500", "wamv", "otter")
MULTIROTORS, BOATS = REAL[:3], REAL[3:]
LAG = {"hexarotor": 0.05, "quadrotor": 0.025, "x500": 0.071, "wamv": 0.2, "otter": 0.1}  # s, from reference and MJCF


def alone(vehicle: str, *, heading: float = 0.0, drift: Any = None, timestep: float = 0.001, **effects: Any) -> World:
    """A world with vehicle 0, at the origin with a heading in degrees, in a medium that moves at `drift`, m/s.

    It is asked for no velocity; see `ask`. Effects are switched as in a scenario.
    """
    n = load_vehicle(vehicle).dimension
    flow = {} if drift is None else {"agents": {"dimension": n, "drift": list(drift)[:n]}}
    world = World(
        make(
            {
                "agents": [{"id": "A", "position": [0.0] * n, "vehicle": vehicle, "heading": heading}],
                "targets": [{"id": "T", "position": [50.0] * n}],
                "sensing": [["A", "T"]],
                "flow": flow,
                "controller": {"gain": 1.0, "control_period": 10 * timestep},
                "physics": {"timestep": timestep, "effects": effects},
            }
        )
    )
    ask(world, np.zeros(3))
    world.reset()
    return world


def ask(world: World, velocity: Any) -> None:
    """From now on vehicle 0 is asked for a velocity (n,) relative to the medium, world axes, in place of the law's."""
    law = world._before_step.control.law
    law.value[:] = 0.0  # command = gain c
    law.c[:3] = 0.0
    law.c[: len(velocity)] = velocity
    world.close_loop(sample=True)


def body(world: World) -> tuple[Vehicle, slice, slice, slice]:
    """Vehicle 0, and where it is in qpos, in qvel and among the actuators."""
    a, d, first = world.arena.qpos[0], world.arena.dof[0], world.arena.thruster
    return world.arena.vehicles[0], slice(a, a + 7), slice(d, d + 6), slice(first[0], first[1])


def attitude(world: World) -> Array:
    """Attitude of vehicle 0, body to world, shape (3, 3)."""
    return Rotation.from_quat(world.quaternions()[0], scalar_first=True).as_matrix()


def yaw_of(world: World) -> float:
    """Heading of vehicle 0, rad."""
    R = attitude(world)
    return float(np.arctan2(R[1, 0], R[0, 0]))


def place(world: World, R: Array, velocity: Any = (0, 0, 0), rates: Any = (0, 0, 0)) -> None:
    """Give vehicle 0 an attitude, a velocity in world axes and rates in body axes."""
    _, qpos, dof, _ = body(world)
    world.data.qpos[qpos][3:] = Rotation.from_matrix(R).as_quat(scalar_first=True)
    world.data.qvel[dof] = [*velocity, *rates]
    world.close_loop(sample=True)


def step_unpowered(world: World, count: int) -> None:
    """Step with the thrusters off."""
    for _ in range(count):
        world.close_loop(sample=False)
        world.data.ctrl[:] = 0.0
        mujoco.mj_step(world.model, world.data)


def wrench(world: World) -> Array:
    """What the commands of vehicle 0 amount to, body axes, shape (6,)."""
    vehicle, _, _, thrusters = body(world)
    return np.asarray(vehicle.W @ world.data.ctrl[thrusters])


def wanted_force(vehicle: Vehicle, R: Array, wanted: Array, measured: Array) -> Array:
    """d(v_c) + M k_v (v_c - v_r), written as in DESIGN section 2, for an attitude R and (3,) velocities in body axes.

    Surge and sway of a boat make the horizontal part of d alone, whatever it would take along its own z axis.
    """
    d = vehicle.drag * wanted + vehicle.quadratic_drag[:3] * np.abs(wanted) * wanted
    if vehicle.dimension == 2:
        d[:2] = np.linalg.solve(R[:2, :2], (R @ d)[:2])
    return np.asarray(d + (vehicle.mass + vehicle.added_mass[:3]) * vehicle.rate * (wanted - measured))
