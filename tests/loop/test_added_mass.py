"""Bodies with their added mass: what is conserved, and that (M_RB + M_A) a = F.

Oracles: Kirchhoff's energy and impulses of a body in an ideal fluid; Fossen's equations of motion, solved densely here
(Handbook of Marine Craft Hydrodynamics and Motion Control, 2011: 6.3 for C(nu), 8.2 for a current that does not turn).
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mjsheaf import World
from mjsheaf.arrays import Array
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.vehicle import Vehicle
from tests.builders import REAL, altered, setting
from tests.loop.one_vehicle import alone, attitude, body, place, step_unpowered
from tests.oracles.rigid_body import rigid_mass, skew

GRAVITY = 9.81
W = np.array([0.5, -0.3, 0.2])  # m/s, of the medium
FRICTIONLESS = {"linear": [1e-9] * 3, "angular": [1e-9] * 3}
BALANCED = {"heave": 1e-9, "roll": 1e-9, "pitch": 1e-9}  # weight and buoyancy meet at the centre of mass
BODIES = ("wamv", "otter", "submersible")


def relative_velocity(world: World, w: Array) -> Array:
    """nu_r: velocity through the medium and rates, body axes, shape (6,)."""
    velocity = world.data.qvel[body(world)[2]]
    return np.concatenate([attitude(world).T @ (velocity[:3] - w), velocity[3:]])


def frictionless(folder: Path, name: str) -> str:
    """A copy of a vehicle on which nothing acts, with its own added mass; the submersible is given some."""
    if name != "submersible":
        return altered(folder, name, drag=FRICTIONLESS, hydrostatics=BALANCED)
    eccentric = setting(".//inertial", pos=".2 -.1 .3")
    return altered(folder, name, eccentric, drag=FRICTIONLESS, added_mass=[30, 400, 500, 20, 60, 40])


def conserved(world: World, w: Array) -> Array:
    """Kirchhoff's energy, impulse and its moment, as seen from the medium, shape (7,): J, N s, N m s."""
    vehicle, qpos, _, _ = body(world)
    nu, R, M = relative_velocity(world, w), attitude(world), rigid_mass(vehicle) + np.diag(vehicle.added_mass)
    x, P = world.data.qpos[qpos][:3] - w * world.time, R @ (M @ nu)[:3]
    return np.concatenate([[0.5 * nu @ M @ nu], P, np.cross(x, P) + R @ (M @ nu)[3:]])


@pytest.mark.slow(first=True)
@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize("moving", [False, True], ids=["still", "moving"])
@pytest.mark.parametrize("name", BODIES)
def test_energy_and_impulses_are_conserved_to_the_order_of_the_integrator(
    name: str, moving: bool, tmp_path: Path
) -> None:
    """Tumbling for 2 s with thrusters off: what is lost halves with the step, in still and in moving water."""
    w = np.array([W[0], W[1], 0.0 if name != "submersible" else W[2]]) * moving
    path, errors = frictionless(tmp_path, name), []
    for timestep in (0.002, 0.001, 0.0005):
        world = alone(path, drift=w, timestep=timestep)
        R = Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix()
        place(world, R, w + np.array([0.9, -0.6, 0.4]), [0.5, -0.4, 0.7])
        before = conserved(world, w)
        step_unpowered(world, round(2.0 / timestep))
        change = conserved(world, w) - before
        size = [before[0], *[np.linalg.norm(before[1:4])] * 3, *[np.linalg.norm(before[4:])] * 3]
        scaled = change / size
        errors.append([abs(scaled[0]), np.linalg.norm(scaled[1:4]), np.linalg.norm(scaled[4:])])
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.max(errors[-1]) < 3e-3
    np.testing.assert_allclose(ratios, 2.0, atol=0.1)


def acceleration(vehicle: Vehicle, R: Array, z: float, nu: Array, thrust: Array) -> Array:
    """d nu_r / dt in body axes, from Fossen's equations, shape (6,).

    M nu' + C(nu) nu = thrust + drag + weight + buoyancy, with M and C of body and medium together, all nu relative.
    """
    M = rigid_mass(vehicle) + np.diag(vehicle.added_mass)
    momentum = M @ nu
    C = np.block([[np.zeros((3, 3)), -skew(momentum[:3])], [-skew(momentum[:3]), -skew(momentum[3:])]])
    D = np.concatenate([vehicle.drag, vehicle.angular_drag])
    drag = -D * nu - vehicle.quadratic_drag * np.abs(nu) * nu
    up, c = R.T @ [0.0, 0.0, 1.0], vehicle.centre_of_mass
    weight = -vehicle.mass * GRAVITY * up
    total = vehicle.W @ thrust + drag + np.concatenate([weight, np.cross(c, weight)])
    floats = vehicle.description.hydrostatics
    if floats is not None:
        b = np.array([*(floats.centre or c[:2]), c[2]])
        buoyancy = vehicle.mass * GRAVITY * up
        righting = np.array([floats.roll, floats.pitch, 0.0]) * np.cross([0.0, 0.0, 1.0], up)
        total += np.concatenate([buoyancy - floats.heave * z * up, np.cross(b, buoyancy) + righting])
    return np.asarray(np.linalg.solve(M, total - C @ nu))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", REAL)
def test_accelerations_solve_the_equations_of_motion(name: str, seed: int) -> None:
    """At random attitudes, velocities, rates and thrusts, in moving water.

    The free joint's linear axes are the world's: the upper half of d nu_r / dt is R^T a - omega x v_r.
    """
    rng = np.random.default_rng(seed)
    vehicle = load_vehicle(name)
    w = W * [1, 1, vehicle.dimension == 3]
    world = alone(name, drift=w)
    _, qpos, dof, thrusters = body(world)
    world.data.qpos[qpos][2] = rng.uniform(-0.2, 0.2)
    place(world, Rotation.random(random_state=seed).as_matrix(), rng.uniform(-2, 2, 3), rng.uniform(-1.5, 1.5, 3))
    low, high = vehicle.limits.T
    thrust = rng.uniform(low, high)
    world.data.act[thrusters] = thrust
    mujoco.mj_forward(world.model, world.data)
    np.testing.assert_allclose(world.data.actuator_force[thrusters], thrust, rtol=1e-12)

    R, nu, qacc = attitude(world), relative_velocity(world, w), world.data.qacc[dof]
    found = np.concatenate([R.T @ qacc[:3] - np.cross(nu[3:], nu[:3]), qacc[3:]])
    expected = acceleration(vehicle, R, world.data.qpos[qpos][2], nu, thrust)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
