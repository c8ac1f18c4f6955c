"""The onboard computer at one instant: what it asks of the thrusters, what gives way at their limits, what it knows.

Oracles: W u taken apart into weight, attitude moment and translation, each written here from `docs/mathematics.md`; the
largest shares of these that the limits leave, by linear programming.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from mjsheaf import World
from mjsheaf.arrays import Array
from mjsheaf.vehicles.vehicle import Vehicle
from tests.builders import MULTIROTORS, REAL, altered
from tests.loop.one_vehicle import alone, ask, attitude, body, largest_tilt, place, wanted_force, wrench, yaw_of
from tests.oracles.rigid_body import hold_moment
from tests.strategies import slow

FULL = ("hexarotor", "wamv")
POINTING = ("quadrotor", "x500")


def asked_wrenches(world: World, velocity: Array) -> list[Array]:
    """Return the wrenches of a fully actuated vehicle by rank: weight; roll and pitch; yaw; translation. Shapes (6,).

    A force that accelerates an eccentric mass must not turn it: c times (thrust less drag) is part of the translation.
    """
    vehicle, _, dof, _ = body(world)
    R, c, planar = attitude(world), vehicle.centre_of_mass, vehicle.dimension == 2
    measured, rates = R.T @ world.data.qvel[dof][:3], world.data.qvel[dof][3:]
    force = wanted_force(vehicle, R, R.T @ velocity, measured)
    drag = vehicle.drag * measured + vehicle.quadratic_drag[:3] * np.abs(measured) * measured
    lift = R.T @ [0.0, 0.0, 0.0 if planar else vehicle.weight]
    heading = Rotation.from_rotvec([0, 0, world.system.bodies.heading[0]]).as_matrix()
    turn = hold_moment(vehicle, R, heading, rates)
    own = vehicle.mass / (vehicle.mass + vehicle.added_mass[:3])  # the rest accelerates the medium, at the origin
    return ranked(vehicle, lift, turn, force, np.cross(c, own * (force - drag)))


def ranked(vehicle: Vehicle, lift: Array, turn: Array, force: Array, balance: Array) -> list[Array]:
    """Return the desired wrenches by rank; `balance` is part of the force."""
    none = np.zeros(3)
    return [
        np.concatenate([lift, np.cross(vehicle.centre_of_mass, lift)]),
        np.concatenate([none, turn * [1, 1, 0]]),
        np.concatenate([none, turn * [0, 0, 1]]),
        np.concatenate([force, balance]),
    ]


def within_limits(vehicle: Vehicle, asked: list[Array]) -> tuple[Array, list[float]]:
    """Return the controlled rows of the desired wrenches within limits, and the fraction of each.

    If the sum exceeds the limits: the first, then of each the largest fraction, 0 to 1, feasible with those before,
    by linear programming.
    """
    rows = vehicle.controlled_rows
    P, (low, high) = np.linalg.pinv(vehicle.W[rows]), vehicle.limits.T
    whole = np.sum(asked, axis=0)[rows]
    if (low <= P @ whole).all() and (P @ whole <= high).all():
        return whole, [1.0] * len(asked)
    total, shares = asked[0][rows].copy(), [1.0]
    for more in asked[1:]:
        u, du = P @ total, P @ more[rows]
        A, room = np.concatenate([du, -du])[:, None], np.concatenate([high - u, u - low])
        finite = np.isfinite(room)
        found = linprog([-1.0], A_ub=A[finite], b_ub=room[finite] + 1e-9, bounds=[(0.0, 1.0)])
        assert found.status == 0  # what was there before fits by itself
        shares.append(float(found.x[0]))
        total += shares[-1] * more[rows]
    return total, shares


@pytest.mark.parametrize("speed", [0.05, slow(3.0), 100.0])
@pytest.mark.parametrize("name", FULL)
def test_at_the_limits_weight_goes_before_attitude_and_attitude_before_translation(name: str, speed: float) -> None:
    """W u = weight + s_1 roll and pitch + s_2 yaw + s_3 translation, each s the largest that then fits."""
    rng = np.random.default_rng(1)
    world = alone(name, heading=40)
    vehicle, _, _, thrusters = body(world)
    low, high = vehicle.limits.T
    shares = []
    for _ in range(60):
        tilt = Rotation.from_rotvec(rng.uniform(-0.15, 0.15, 3) * [1, 1, 2]).as_matrix()
        level = Rotation.from_euler("z", 40, degrees=True).as_matrix()
        place(world, level @ tilt, rng.uniform(-1, 1, 3) * min(speed, 1.0), rng.uniform(-0.5, 0.5, 3))
        velocity = rng.standard_normal(3) * [1, 1, vehicle.dimension == 3]
        velocity *= speed / np.linalg.norm(velocity)
        ask(world, velocity)
        u = world.data.ctrl[thrusters]
        assert (u >= low).all()
        assert (u <= high).all()
        asked = asked_wrenches(world, velocity)
        expected, share = within_limits(vehicle, asked)
        size = sum(s * np.abs(a).max() for s, a in zip(share, asked, strict=True))
        np.testing.assert_allclose(wrench(world)[vehicle.controlled_rows], expected, atol=1e-6 * size)
        shares.append(share)
    least, most = np.min(shares, axis=0), np.max(shares, axis=0)
    assert most[3] > 0.0
    if speed == 100.0:
        assert most[3] < 1.0
    if name == "hexarotor":
        assert least[1] == 1.0  # it has roll and pitch to spare, but little yaw
        assert least[2] < 1.0
    else:
        assert least[2] == 1.0
    if speed == 0.05 and name == "wamv":
        assert least[3] == 1.0


def test_an_otter_turns_and_goes_in_proportion() -> None:
    """Surge force and yaw moment are cut by the same share: the hand point's acceleration keeps its direction."""
    rng = np.random.default_rng(3)
    world = alone("otter", heading=25)
    vehicle, _, _, thrusters = body(world)
    R, ahead_by = attitude(world), 1.0
    for speed in (0.1, 20.0):
        for _ in range(40):
            v = speed * rng.uniform(-1, 1, 3) * [1, 1, 0]
            ask(world, v)
            ahead, port = (R.T @ v)[:2]
            M_x, M_r, k = 80.0 + 5.5, vehicle.inertia[2, 2] + 25.7, 1.0
            r = port / ahead_by
            surge = 77.55 * ahead + M_x * k * ahead
            yaw = (42.65 + 426.5 * abs(r)) * r + M_r * k * r
            found = wrench(world)[[0, 5]]
            share = found @ [surge, yaw] / (surge**2 + yaw**2)
            np.testing.assert_allclose(found, share * np.array([surge, yaw]), atol=1e-9 * np.hypot(surge, yaw))
            assert share == pytest.approx(1.0, abs=1e-12) if speed == 0.1 else 0.0 < share < 1.0
            assert world.data.ctrl[thrusters].min() >= -66.71
            assert world.data.ctrl[thrusters].max() <= 119.68


def pointed(vehicle: Vehicle, F: Array) -> Array:
    """Weight + s F in world axes, s the largest in [0, 1], by bisection, within tilt, thrust and sinking allowed."""
    W = vehicle.weight
    most = 0.9 * float(vehicle.limits[:, 1].sum())

    def allowed(s: float) -> bool:
        x, y, z = s * F
        tilt = np.hypot(x, y) <= np.tan(np.deg2rad(largest_tilt(vehicle))) * (W + z) * (1 + 1e-12)
        return bool(tilt and W + z >= 0.5 * W * (1 - 1e-12) and np.linalg.norm([x, y, W + z]) <= most * (1 + 1e-12))

    low, high = 0.0, 1.0
    if allowed(1.0):
        return np.array([0, 0, W]) + F
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return np.array([0, 0, W]) + low * F


def facing(thrust: Array, heading: float) -> Array:
    """The attitude that turns z to the thrust the shortest way, after the turn to the heading."""
    z = thrust / np.linalg.norm(thrust)
    axis = np.cross([0, 0, 1], z)
    angle = np.arctan2(np.linalg.norm(axis), z[2])
    turn = axis / np.linalg.norm(axis) * angle if np.linalg.norm(axis) > 0 else axis
    return (Rotation.from_rotvec(turn) * Rotation.from_rotvec([0, 0, heading])).as_matrix()


@pytest.mark.parametrize("speed", [0.2, slow(4.0), 200.0])
@pytest.mark.parametrize("name", POINTING)
def test_a_multirotor_with_parallel_rotors_points_weight_and_force(name: str, speed: float, tmp_path: Path) -> None:
    """In the attitude that it wants, its thrust is weight + s F: no less carried, toward where it is asked to go."""
    rng = np.random.default_rng(4)
    # Alike along all axes, so that F does not depend on the attitude that it is to give.
    world = alone(altered(tmp_path, name, drag={"linear": [0.6] * 3}), heading=35)
    vehicle, _, _, thrusters = body(world)
    cut = 0
    for _ in range(40):
        velocity = rng.standard_normal(3)
        velocity *= speed / np.linalg.norm(velocity)
        F = (0.6 + vehicle.mass * vehicle.rate) * velocity
        thrust = pointed(vehicle, F)
        cut += bool(np.linalg.norm(thrust - [0, 0, vehicle.weight]) < 0.999 * np.linalg.norm(F))
        R = facing(thrust, np.deg2rad(35))
        ask(world, velocity)
        place(world, R)
        made = wrench(world)
        moment = np.cross(vehicle.centre_of_mass, R.T @ (thrust - [0, 0, vehicle.weight]))
        weight = np.cross(vehicle.centre_of_mass, R.T @ [0, 0, vehicle.weight])
        np.testing.assert_allclose(R @ [0, 0, made[2]], thrust, atol=1e-8 * vehicle.weight)
        np.testing.assert_allclose(made[3:], (moment + weight) * [1, 1, 0], atol=1e-6)
        assert np.degrees(np.arccos(R[2, 2])) <= largest_tilt(vehicle) + 1e-6
        assert thrust[2] >= 0.5 * vehicle.weight * (1 - 1e-9)
        assert (world.data.ctrl[thrusters] >= vehicle.limits[:, 0]).all()
        assert (world.data.ctrl[thrusters] <= vehicle.limits[:, 1]).all()
        # And from where it is level it begins to turn there, with as much of the thrust as points there already.
        place(world, Rotation.from_euler("z", 35, degrees=True).as_matrix())
        weight = np.array([0.0, 0.0, vehicle.weight])
        force = np.array([0.0, 0.0, thrust[2]]) - weight
        hold = hold_moment(vehicle, attitude(world), R, np.zeros(3))
        asked = ranked(vehicle, weight, hold, force, np.cross(vehicle.centre_of_mass, force))
        expected = within_limits(vehicle, asked)[0]
        np.testing.assert_allclose(wrench(world)[2:], expected, atol=1e-6 * vehicle.weight)
    assert (cut > 0) == (speed > 0.2)
    assert speed < 200.0 or cut == 40


@pytest.mark.slow(first=True)
@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize(("tilt", "fall"), [(60, 2.0), (150, 7.0)])
@pytest.mark.parametrize("name", MULTIROTORS)
def test_a_multirotor_recovers_from_a_tilt(name: str, tilt: float, fall: float) -> None:
    """To a level hover with its heading, before it has fallen far."""
    world = alone(name, heading=35)
    _, _, dof, _ = body(world)
    lean = Rotation.from_rotvec(np.deg2rad(tilt) * np.array([0.6, 0.8, 0.0]))
    place(world, (lean * Rotation.from_euler("z", 35, degrees=True)).as_matrix(), rates=[2.0, -1.0, 0.5])
    lowest = 0.0
    for _ in range(100):
        world.step(100)
        lowest = min(lowest, world.positions()[0, 2])
    assert lowest > -fall
    np.testing.assert_allclose(world.data.qvel[dof], 0.0, atol=1e-3)
    up = attitude(world)[:, 2]
    assert np.degrees(np.arctan2(np.hypot(up[0], up[1]), up[2])) < 0.01
    assert np.degrees(yaw_of(world)) == pytest.approx(35, abs=0.01)


@pytest.mark.parametrize("name", REAL)
def test_commands_depend_on_the_velocity_through_the_medium_alone(name: str) -> None:
    """In a flow w at v + w, or in still air at v: the same commands bit for bit, and the same motion but for w t."""
    w = np.array([0.5, -0.25, 0.125 if name in MULTIROTORS else 0.0])  # sums of these are exact
    still, moving = alone(name, heading=20), alone(name, heading=20, drift=w)
    R = Rotation.from_rotvec([0.1, -0.2, 0.5]).as_matrix()
    v, rates = np.array([1.25, -0.75, 0.5]), [0.25, 0.5, -0.125]
    for world, velocity in ((still, v), (moving, v + w)):
        place(world, R, velocity, rates)
        ask(world, [0.75, 0.5, 0.25][: world.arena.vehicles[0].dimension])
    np.testing.assert_array_equal(moving.data.ctrl[body(moving)[3]], still.data.ctrl[body(still)[3]])
    assert np.abs(still.data.ctrl[body(still)[3]]).max() > 1.0
    for _ in range(4):
        still.step(500)
        moving.step(500)
        shift = moving.positions()[0] - still.positions()[0]
        np.testing.assert_allclose(shift, (w * still.time)[:3], atol=1e-9)
        np.testing.assert_allclose(moving.quaternions()[0], still.quaternions()[0], atol=1e-9)
