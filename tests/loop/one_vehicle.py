"""One vehicle alone, in a uniform medium, with a constant velocity command."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mjsheaf import World
from mjsheaf.arrays import Array
from mjsheaf.loop.fused import Fused
from mjsheaf.loop.loop import AUTOPILOT, STOPPED
from mjsheaf.scenario import Scenario
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.vehicle import Vehicle
from tests.builders import pursuit

ENGINE = "mujoco"
"""What moves a vehicle that is alone: see the fixture `engine`."""


class Alone(World):
    """Make a world whose law commands vehicle 0 to move with `wanted` (3,), m/s."""

    wanted = np.zeros(3)

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario, controller=lambda *_: self.wanted[None])


class AloneFused(Fused):
    """The same on the fused engine, with as much of `data` and `arena` as it has."""

    wanted = np.zeros(3)

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario.phases, controller=lambda *_: self.wanted[None])
        V = np.arange(len(self._vehicles))
        first = np.cumsum([0, *(len(vehicle.channels) for vehicle in self._vehicles)])
        self.arena = SimpleNamespace(vehicles=self._vehicles, qpos=7 * V, dof=6 * V, thruster=first)

    @property
    def data(self) -> Any:
        """The state, which lies elsewhere after a reset."""
        state = self._loop.state
        return SimpleNamespace(qpos=state.qpos, qvel=state.qvel, act=state.act, ctrl=state.ctrl)


def alone(
    vehicle: str,
    *,
    heading: float = 0.0,
    drift: Any = None,
    timestep: float = 0.001,
    **effects: Any,
) -> World:
    """A world with vehicle 0, at the origin with a heading in degrees, in a medium that moves at `drift`, m/s.

    Its command is zero; see `ask`. Effects are switched as in a scenario.
    """
    n = load_vehicle(vehicle).dimension
    flow = {} if drift is None else {"agents": {"dimension": n, "drift": list(drift)[:n]}}
    scenario = pursuit(
        [0.0] * n,
        [50.0] * n,
        {"vehicle": vehicle, "heading": heading},
        flow=flow,
        scene={"surface": "water"},
        controller={"gain": 1.0, "control_period": 10 * timestep},
        physics={"timestep": timestep, "effects": effects},
    )
    world: Any = (Alone if ENGINE == "mujoco" else AloneFused)(scenario)
    ask(world, np.zeros(3))
    world.reset()
    return world


def ask(world: World, velocity: Any) -> None:
    """Replace the command of vehicle 0 by a velocity (n,) relative to the medium, world axes."""
    assert isinstance(world, Alone | AloneFused)
    world.wanted = np.append(velocity, np.zeros(3))[:3]
    world.close_loop(sample=True)


def body(world: World, v: int = 0) -> tuple[Vehicle, slice, slice, slice]:
    """Vehicle v, and where it is in qpos, in qvel and among the actuators."""
    a, d, first = world.arena.qpos[v], world.arena.dof[v], world.arena.thruster
    return world.arena.vehicles[v], slice(a, a + 7), slice(d, d + 6), slice(first[v], first[v + 1])


def largest_tilt(vehicle: Vehicle) -> float:
    """Largest tilt of a vehicle that points its thrust, degrees; 0 for others."""
    return float(getattr(vehicle.steering, "largest_tilt", 0.0))


def attitude(world: World, v: int = 0) -> Array:
    """Attitude of vehicle v, body to world, shape (3, 3)."""
    return Rotation.from_quat(world.quaternions()[v], scalar_first=True).as_matrix()


def least_thrust(vehicle: Vehicle) -> float:
    """Maximum thrust of a level vehicle in the weakest horizontal direction, N; of a boat at its hand point ahead."""
    return min(vehicle.steering.largest_force(vehicle, direction) for direction in vehicle.steering.directions)


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


def mean_delay(world: World, before: Any, after: Any) -> float:
    """Delay of the velocity (n,) after a step of the command, s: time less way, in units of the change of speed.

    It is the integral of 1 - v / v_end, along the change, where v_end is what the speed comes to.
    """
    n, change = len(before), np.subtract(after, before)
    ask(world, before)
    world.step(30_000)
    start = world.positions()[0, :n]
    ask(world, after)
    world.step(15_000)
    way = world.positions()[0, :n] - start - 15.0 * np.asarray(before)
    world.step(1_000)
    last = world.positions()[0, :n] - start - way - 16.0 * np.asarray(before)
    assert last @ change == pytest.approx(change @ change, rel=5e-3)  # the Otter's trim makes it lose .2 %
    return float(15.0 - way @ change / (last @ change))


def step_unpowered(world: World, count: int) -> None:
    """Step with the thrusters off."""
    world._loop.params.helm[:] = STOPPED
    world.step(count)
    world._loop.params.helm[:] = AUTOPILOT


def wrench(world: World) -> Array:
    """Return the wrench of the commands of vehicle 0, body axes, shape (6,)."""
    vehicle, _, _, thrusters = body(world)
    return np.asarray(vehicle.W @ world.data.ctrl[thrusters])


def wanted_force(vehicle: Vehicle, R: Array, wanted: Array, measured: Array) -> Array:
    """d(v_c) + M k_v (v_c - v_r), as in `docs/mathematics.md`, for an attitude R and (3,) velocities in body axes.

    Surge and sway of a boat make the horizontal part of d alone, whatever it would take along its own z axis.
    """
    d = vehicle.drag * wanted + vehicle.quadratic_drag[:3] * np.abs(wanted) * wanted
    if vehicle.dimension == 2:
        d[:2] = np.linalg.solve(R[:2, :2], (R @ d)[:2])
    return np.asarray(d + (vehicle.mass + vehicle.added_mass[:3]) * vehicle.rate * (wanted - measured))
