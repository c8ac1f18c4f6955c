"""Azimuth thrusters, and the WAM-V that has two of them at its stern.

Oracles: wrenches and equilibria that a pencil finds; MuJoCo's own forces and activations; the mean delay of a linear
loop; a search of all thrusts and angles.
"""

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mjsheaf import simulate
from mjsheaf.arrays import Array
from mjsheaf.loop.linear import HeldPoint, linearise
from mjsheaf.vehicles.actuators import CHANNEL, AzimuthThruster, aim
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.steering import Full
from tests.builders import altered, known, pursuit
from tests.loop.one_vehicle import alone, ask, attitude, body, least_thrust, mean_delay, place, wanted_force

NAME = "wamv_azimuth"
PUSH = 2353.5  # N
STILL = (0.0, 0.0, 0.0)  # m/s, rad/s
RATE, END = np.deg2rad(60.0), np.pi / 2


def efforts(thrusts_and_angles: Array) -> Array:
    """Components of each thrust ahead and to port, interleaved as their channels are."""
    thrust, angle = np.asarray(thrusts_and_angles).reshape(-1, 2).T
    return np.column_stack([thrust * np.cos(angle), thrust * np.sin(angle)]).ravel()


def both(**fields: Any) -> dict[str, Any]:
    """The description of both engines, each written out: YAML must not say that they are one."""
    sides = ("thruster_port", "thruster_starboard")
    return {name: copy.deepcopy({"kind": "azimuth", "angle": [-90, 90], "rate": 60} | fields) for name in sides}


# -- what it is --------------------------------------------------------------------------------------------------------


def test_two_engines_that_turn_make_surge_sway_and_yaw() -> None:
    """211 kg; arms of 2.3738 m aft and 1.0271 m abeam. Four efforts: fully actuated. Without angles of rank 2 only."""
    vehicle = load_vehicle(NAME)
    assert vehicle.mass == pytest.approx(180 + 2 * 15.5, rel=1e-12)
    y, x = 1.0271, -2.3738
    planar = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [-y, x, y, x]])
    np.testing.assert_allclose(vehicle.W[[0, 1, 5]], planar, atol=1e-12)
    assert isinstance(vehicle.steering, Full)
    assert vehicle.controlled_rows == [0, 1, 5]
    assert np.linalg.matrix_rank(vehicle.W[[0, 1, 5]][:, ::2]) == 2
    assert [(c.unit, c.low, c.high) for c in vehicle.channels] == [("N", -PUSH, PUSH), ("rad", -END, END)] * 2
    assert vehicle.thrusters[:2] == ["thruster_port", "thruster_port_angle"]


def test_its_reduced_model() -> None:
    """tau = (M + l D) / (M k_v + D) with M = 211 + 12 and 211 + 120 kg, l = .2 s; g = R diag(1 / 100) W."""
    model = load_vehicle(NAME).reduced_model()
    np.testing.assert_allclose(model.tau, [(223 + 20) / (223 + 100), (331 + 20) / (331 + 100)], rtol=1e-12)
    R = Rotation.from_rotvec([0, 0, 0.7]).as_matrix()
    np.testing.assert_allclose(model.g(R), R[:2, :2] @ [[0.01, 0, 0.01, 0], [0, 0.01, 0, 0.01]], atol=1e-15)
    np.testing.assert_allclose(model.g(R) @ model.g_inverse(R), np.eye(2), atol=1e-12)
    np.testing.assert_allclose((load_vehicle(NAME).W @ model.g_inverse(R))[5], 0.0, atol=1e-10)


def test_what_it_can_push() -> None:
    """Ahead both in full. Abeam Y: half of it each, and +-x with 2 x 1.0271 = 2.3738 Y against the yaw."""
    vehicle = load_vehicle(NAME)
    assert vehicle.capability.forward_thrust == pytest.approx(2 * PUSH, rel=1e-9)
    assert least_thrust(vehicle) == pytest.approx(PUSH / np.hypot(0.5, 2.3738 / 2 / 1.0271), rel=2e-3)


def turner(low: float, high: float, weakest: float = -1.0) -> AzimuthThruster:
    """One with limits of its angle in degrees, thrust from `weakest` to 1, no rate limit."""
    wrench = np.array([1.0, 0, 0, 0, 0, 0])
    low, high = np.deg2rad([low, high])
    more: dict[str, Any] = {"sideways": np.roll(wrench, 1), "rate": np.inf, "angle_lag": 0.0}
    return AzimuthThruster("pod", wrench, ctrl=(weakest, 1.0), low=low, high=high, **more)


def packed(pod: AzimuthThruster) -> NDArray[np.void]:
    """Its two channels, thrust and angle."""
    channels = np.zeros(2, CHANNEL)
    low, high = known(pod.ctrl)
    channels["low"], channels["high"], channels["state"] = [low, pod.low], [high, pod.high], [0, 1]
    pod.pack(channels, 0.01)
    return channels


def aimed(channels: NDArray[np.void], x: float, y: float, angle: float) -> Array:
    """Commands for a force (x, y) at an angle of now."""
    ctrl = np.array([x, y])
    aim(channels, STILL, STILL, np.array([0.0, angle]), ctrl)
    return ctrl


LIMITS = [(-90, 90, -1.0), (-35, 35, -1.0), (-35, 35, 0.0), (20, 100, -0.3), (-180, 180, 0.0), (-350, 10, -0.5)]


@pytest.mark.parametrize(("low", "high", "weakest"), LIMITS)
def test_the_half_planes_hold_all_that_it_can_push_and_touch_it(low: float, high: float, weakest: float) -> None:
    pod = turner(low, high, weakest)
    angle, thrust = np.meshgrid(np.deg2rad(np.linspace(low, high, 721)), np.linspace(weakest, 1.0, 41))
    able = np.column_stack([(thrust * np.cos(angle)).ravel(), (thrust * np.sin(angle)).ravel()])
    A, b = pod.half_planes
    np.testing.assert_allclose((able @ A.T).max(axis=0), b, atol=1e-4)
    np.testing.assert_allclose(np.column_stack([able.min(axis=0), able.max(axis=0)]), pod.bounds, atol=1e-4)


@pytest.mark.parametrize(("low", "high", "weakest"), LIMITS)
def test_it_takes_the_best_thrust_and_angle_that_it_can_reach(low: float, high: float, weakest: float) -> None:
    """Whatever the angle now: it leaves no more out than the best of all does, and the share that spares a turn."""
    pod = turner(low, high, weakest)
    channels = packed(pod)
    angles, thrusts = np.meshgrid(np.linspace(pod.low, pod.high, 1441), np.linspace(weakest, 1.0, 101))
    able = thrusts * np.exp(1j * angles)

    @given(st.floats(0.01, 1.0), st.floats(-np.pi, np.pi), st.floats(0.0, 1.0))
    def each(size: float, bearing: float, share: float) -> None:
        f, now = size * np.exp(1j * bearing), pod.low + share * (pod.high - pod.low)
        for _ in range(2):  # the first turns it, the second thrusts there
            thrust, now = aimed(channels, f.real, f.imag, now)
            assert weakest <= thrust <= 1.0
            assert pod.low <= now <= pod.high
        missed = abs(thrust * np.exp(1j * now) - f)
        assert missed <= np.abs(able - f).min() + 0.2 * size + 1e-12

    each()


def test_it_does_not_turn_round_for_thrust_astern_or_for_nothing() -> None:
    channels = packed(turner(-90, 90))
    for x, y, thrust, angle in ((-0.3, -0.4, -0.5, np.arctan2(4, 3)), (0.0, 0.0, 0.0, 0.9)):
        np.testing.assert_allclose(aimed(channels, x, y, angle), [thrust, angle], atol=1e-15)


def test_rounding_does_not_turn_it() -> None:
    """A force of rounding's size turns it by 1e-7 of its reach at most, the dead band by all of it."""
    channels = packed(replace(turner(-90, 90), rate=1.0))
    for size, share in ((1e-16, 1e-10), (1e-13, 1e-7), (1e-9, 1e-3), (0.5e-6, 0.5), (1e-6, 1.0), (1e-3, 1.0)):
        assert aimed(channels, 0.0, size, 0.2)[1] - 0.2 == pytest.approx(0.01 * share, rel=1e-6, abs=1e-16)


# -- in the world ------------------------------------------------------------------------------------------------------


def test_engines_agree_although_rounding_has_a_direction() -> None:
    """Commands are zero for half a second, then not: no engine and no shift of the origin turns a thruster before."""

    def positions(engine: str, shift: float) -> Array:
        scenario = pursuit(
            [shift, 0],
            [shift + 8, 5],
            {"vehicle": NAME, "heading": 77},
            time={"end": 2.0},
            controller={"gain": 0.6, "control_period": 0.02},
            links={"all": {"delay": 0.5}},
            physics={"timestep": 0.002},
        )
        run = simulate(scenario, engine=engine, threads=1)
        return np.asarray(run.agent_position.values[:, 0, :2] - [shift, 0.0])

    plain = positions("fused", 0.0)
    assert np.abs(plain - plain[0]).max() > 0.5
    for engine, shift in (("mujoco", 0.0), ("mujoco", 100.0), ("fused", 100.0)):
        np.testing.assert_allclose(positions(engine, shift), plain, rtol=0, atol=1e-9)


def test_mujoco_pushes_along_the_angle() -> None:
    """qfrc_actuator for random thrusts and angles, in any attitude, is S W f; the angle itself pushes nothing."""
    world, rng = alone(NAME, heading=30), np.random.default_rng(5)
    vehicle, _, dof, own = body(world)
    for _ in range(20):
        place(world, Rotation.random(random_state=rng).as_matrix())
        state = np.column_stack([rng.uniform(-PUSH, PUSH, 2), rng.uniform(-END, END, 2)])
        world.data.act[own] = state.ravel()
        world.close_loop(sample=False)
        mujoco.mj_forward(world.model, world.data)
        made = vehicle.rigid_wrench_map @ vehicle.W @ efforts(state)
        expected = np.concatenate([attitude(world) @ made[:3], made[3:]])
        np.testing.assert_allclose(world.data.qfrc_actuator[dof], expected, atol=1e-9)
        np.testing.assert_allclose(world.data.actuator_force[own], state.ravel(), atol=1e-9)


@pytest.mark.slow
@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize(
    ("axis", "before", "after"),
    [(0, [0.0, 0.0], [1e-3, 0.0]), (1, [0.0, 0.1], [0.0, 0.101]), (1, [0.0, -0.1], [0.0, -0.102])],
)
def test_a_step_is_followed_with_its_time_constant(axis: int, before: list[float], after: list[float]) -> None:
    """Abeam while the engines point there already: (M + l D) / (M k_v + D) with the slope of the drag law for D."""
    world = alone(NAME, heading=0)
    M, D, v = (223.0, 100.0, 0.0) if axis == 0 else (331.0, 100.0, abs(before[1]))
    D += 2 * (150, 100)[axis] * v
    delay = mean_delay(world, before, after)
    assert delay == pytest.approx((M + 0.2 * D) / (M + D), rel=0.02)
    if v == 0.0:
        assert delay == pytest.approx(load_vehicle(NAME).reduced_model().tau[axis], rel=0.01)


@pytest.mark.slow
@pytest.mark.usefixtures("engine")
def test_a_step_abeam_from_rest_waits_for_the_engines_to_turn() -> None:
    """Later than tau, by no more than twice the time of that turn, atan(1 / 2.31) at 60 degrees/s."""
    tau, turn = load_vehicle(NAME).reduced_model().tau[1], np.arctan2(0.5, 2.3738 / 2 / 1.0271) / RATE
    assert tau < mean_delay(alone(NAME, heading=0), [0.0, 0.0], [0.0, 0.05]) < tau + 2 * turn


@pytest.mark.slow
@pytest.mark.parametrize("end", [90.0, 30.0])
def test_rate_and_limits_of_the_angle_hold_at_every_step(end: float, tmp_path: Path) -> None:
    """With a new command every half second, some far too high, and narrow limits, the boat still moves ahead."""
    path = altered(tmp_path, NAME, actuators=both(angle=[-end, end]))
    world, rng = alone(path, drift=[0.3, 0.1]), np.random.default_rng(7)
    own, angles = body(world)[3], []
    for _ in range(40):
        ask(world, rng.uniform(-1, 1, 2) * rng.choice([0.1, 1.0, 10.0]))
        for _ in range(500):
            world.step(1)
            angles.append(world.data.act[own][1::2].copy())
            assert np.abs(world.data.act[own][::2]).max() <= PUSH * (1 + 1e-12)
    steps = np.abs(np.diff(angles, axis=0))
    assert steps.max() <= RATE * 0.001 * (1 + 1e-9)
    assert steps.max() >= RATE * 0.001 * (1 - 1e-9)  # it is not slower than it may be
    assert np.abs(angles).max() <= np.deg2rad(end) + 1e-12
    assert end == 90.0 or np.abs(angles).max() == pytest.approx(np.deg2rad(end), abs=1e-12)


def test_a_lag_of_the_angle_is_first_order_and_keeps_the_rate(tmp_path: Path) -> None:
    """angle' = (desired - angle) / lag, limited by the rate; the oracle is the exact solution of both cases."""
    world = alone(altered(tmp_path, NAME, actuators=both(lag=0.5)))
    own, h = body(world)[3], 0.001
    ask(world, [0.0, 2.0])
    before = world.data.act[own][1]
    for _ in range(3000):
        world.close_loop(sample=False)
        ahead = world.data.ctrl[own][1] - before
        mujoco.mj_step(world.model, world.data)
        now = world.data.act[own][1]
        assert now - before == pytest.approx(ahead * (1 - np.exp(-h / 0.5)), abs=1e-12)
        assert abs(now - before) <= RATE * h * (1 + 1e-9)
        before = now


@pytest.mark.long
def test_far_beyond_its_limits_it_pushes_where_it_is_asked_to() -> None:
    """Level, on its heading, with turned engines: a positive multiple of the desired force, one engine saturated."""
    world, rng = alone(NAME, heading=-70), np.random.default_rng(2)
    vehicle, _, _, own = body(world)
    for _ in range(20):
        v = rng.standard_normal(2) * 100.0
        ask(world, v)
        for _ in range(5000):  # time for the engines to turn, while nothing else moves
            world.data.act[own][1::2] = world.data.ctrl[own][1::2]
            world.close_loop(sample=False)
        R = attitude(world)
        wanted = wanted_force(vehicle, R, R.T @ [*v, 0.0], np.zeros(3))[:2]
        angles, thrusts = world.data.act[own][1::2], world.data.ctrl[own][::2]
        force = (vehicle.W @ efforts(np.column_stack([thrusts, angles])))[:2]
        share = force @ wanted / (wanted @ wanted)
        assert 0.0 < share < 1.0
        np.testing.assert_allclose(force, share * wanted, atol=1e-6 * PUSH)
        assert np.abs(thrusts).max() == pytest.approx(PUSH, rel=1e-9)
        assert world.saturation()[0] >= 0.25


def test_without_limits_and_lag_the_force_is_the_wanted_one_at_once() -> None:
    world, rng = alone(NAME, heading=20, limits=False, lag=False), np.random.default_rng(4)
    vehicle = body(world)[0]
    for _ in range(20):
        v = rng.standard_normal(2) * 10.0
        ask(world, v)
        world.data.act[body(world)[3].start :][:2] = world.data.ctrl[1::2][:2]  # thrusts have no activation now
        world.close_loop(sample=False)
        R = attitude(world)
        wanted = wanted_force(vehicle, R, R.T @ [*v, 0.0], np.zeros(3))[:2]
        commands = world.data.ctrl[body(world)[3]]
        np.testing.assert_allclose((vehicle.W @ efforts(commands))[:2], wanted, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "current", "error"),
    [(NAME, [0.5, 0.3, 0.0], 1e-3), ("otter_rudder", [-0.8, 0.0, 0.0], 1e-2)],
)
def test_its_loop_is_linear_in_a_current_and_not_at_rest(name: str, current: list[float], error: float) -> None:
    """Without thrust it has no direction; with some, the loop's sway mode decays at about 1 / tau."""
    vehicle, control = load_vehicle(name), alone(name).system.control
    stations = [HeldPoint(vehicle, np.array(w), 0.0) for w in ([0.0, 0.0, 0.0], current)]
    still, model = linearise(stations, control, 0.005, 1)
    assert isinstance(still, str)
    assert not isinstance(model, str)
    assert np.abs(np.linalg.eigvals(model.A)).max() < 1.0
    # Held, a velocity command of 1 along each axis ends as that velocity.
    steady = model.C @ np.linalg.solve(np.eye(len(model.A)) - model.A, model.B) + model.D
    np.testing.assert_allclose(steady / 0.005, np.eye(2), atol=error)
