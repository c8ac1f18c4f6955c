"""Forces on bodies: thrust, drag, flow and buoyancy, at one instant and over time.

Oracles: the wrench W u turned into world axes; m v' = R D R^T (v_c + w - v) with exact solutions (matrix exponential);
the same vehicle with MuJoCo's own site transmissions, from the unmodified MJCF file; textbook oscillators.
"""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from mjsheaf import World, simulate
from mjsheaf.arrays import Array
from mjsheaf.vehicles import vehicle as vehicles
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import altered, attitudes, build_scenario, find, mixed_scenario, pursuit, setting, xml_of
from tests.loop.one_vehicle import attitude, body
from tests.oracles.law import medium, velocity_commands
from tests.oracles.rigid_body import hold_moment

LINEAR = {"linear": [200.0, 900.0, 1500.0], "angular": [50.0, 60.0, 70.0]}
SHIFTED = setting(".//inertial", pos="0.15 -0.1 0.2")


def turn(world: World, v: int, R: Array) -> None:
    """Give vehicle v an attitude."""
    world.data.qpos[body(world, v)[1]][3:] = Rotation.from_matrix(R).as_quat(scalar_first=True)


@pytest.fixture
def world(tmp_path: Path) -> World:
    """The mixed team; the aircraft drag unlike along each axis, one with its mass off the origin of its frame."""
    scenario = mixed_scenario()
    agents = [a.model_dump(exclude_none=True) for a in scenario.agents]
    agents[1]["vehicle"] = altered(tmp_path / "drag", "aerial", drag=LINEAR)
    agents[2]["vehicle"] = altered(tmp_path / "shift", "aerial", SHIFTED, drag=LINEAR)
    return World(mixed_scenario(agents=agents, disturbance={"agents": {"bound": 0.5}}))


@pytest.mark.parametrize("seed", range(5))
def test_force_is_drag_relative_to_medium_and_command_and_the_moment_holds_the_attitude(
    world: World, seed: int
) -> None:
    """Thrust, flow, damping and weight together: R D R^T (v_c + w - v) on whatever moves in a volume.

    The moment is that of the hold to the level attitude with the given heading, and what accelerates an eccentric mass
    without turning it, c times thrust less drag; and the body's own drag.
    """
    for v, R in enumerate(attitudes(len(world.arena.vehicles), seed)):
        turn(world, v, R)
    world.data.qvel[:] = np.random.default_rng(seed).uniform(-2, 2, world.model.nv)
    world.close_loop(sample=True)
    mujoco.mj_forward(world.model, world.data)
    system, data, x = world.system, world.data, world.positions()
    command = velocity_commands(system, world.time, x)
    for v, vehicle in enumerate(world.arena.vehicles):
        if vehicle.dimension == 2:
            continue
        dof = body(world, v)[2]
        R, omega, force = attitude(world, v), data.qvel[dof][3:], data.qfrc_actuator[dof]
        others = (data.qfrc_applied + data.qfrc_passive)[dof]
        slip = medium(system, v, world.time, x[v]) - data.qvel[dof][:3]
        expected = R @ (vehicle.drag * (R.T @ (command[v] + slip))) - vehicle.mass * world.model.opt.gravity
        np.testing.assert_allclose((force + others)[:3], expected, atol=1e-11 * vehicle.drag.max() * 20.0)
        level = Rotation.from_rotvec([0, 0, system.bodies.heading[v]]).as_matrix()
        assert (vehicle.hold.frequency, vehicle.hold.damping) == (10.0, 1.0)
        hold = hold_moment(vehicle, R, level, omega)
        trim = np.cross(vehicle.centre_of_mass, R.T @ force[:3] + vehicle.drag * (R.T @ slip))
        np.testing.assert_allclose(force[3:], hold + trim, atol=1e-9 * (1 + np.abs(hold).max()))
        drag = -np.array(vehicle.description.drag.angular) * omega
        np.testing.assert_allclose(others[3:], drag, atol=1e-10)


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("name", ["hull", "aerial", "submersible", "hexarotor", "quadrotor", "x500"])
def test_gears_on_the_joint_are_thrusters_on_sites(name: str, tmp_path: Path) -> None:
    """Step by step, tumbling, the trajectory of the file's own site transmissions under the same commands."""
    place = [0, 0, 0][: load_vehicle(name).dimension]
    world = World(pursuit(place, [40, 30, 20], {"vehicle": name, "heading": 50}, controller={"gain": 0.3}))
    rng = np.random.default_rng(4)
    turn(world, 0, Rotation.from_rotvec(0.8 * rng.standard_normal(3)).as_matrix())
    _, qpos, dof, thrusters = body(world)
    world.data.qvel[dof] = rng.uniform(-1, 1, 6)

    root = xml_of(name)
    ElementTree.SubElement(find(root, ".//body[@name='body']"), "freejoint")
    option = ElementTree.SubElement(root, "option", gravity="0 0 -9.81")
    ElementTree.SubElement(option, "flag", contact="disable")
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    model.opt.timestep, model.opt.integrator = world.model.opt.timestep, world.model.opt.integrator
    model.dof_damping[:] = world.model.dof_damping[dof]
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = world.data.qpos[qpos], world.data.qvel[dof]
    data.act[:] = world.data.act[: model.na]
    assert (model.actuator_trntype == mujoco.mjtTrn.mjTRN_SITE).all()

    for _ in range(1500):
        world.step(1)
        data.ctrl[:], data.qfrc_applied[:] = world.data.ctrl[thrusters], world.data.qfrc_applied[dof]
        mujoco.mj_step(model, data)
        np.testing.assert_allclose(data.qpos, world.data.qpos[qpos], rtol=0, atol=1e-10)
        np.testing.assert_allclose(data.qvel, world.data.qvel[dof], rtol=0, atol=1e-9)
    assert np.linalg.norm(data.qpos[:2]) > 1.0  # it went somewhere


def drifting(tmp_path: Path, timestep: float, flow: dict[str, Any], **vehicle: Any) -> World:
    """A submersible that commands nothing, in a flow."""
    target = {"position": [1, 2, -3], "heading": 35, "vehicle": altered(tmp_path, "submersible", **vehicle)}
    fields: dict[str, Any] = {"flow": {"targets": {"dimension": 3, **flow}}, "physics": {"timestep": timestep}}
    return World(build_scenario({"A": [9, 9]}, {"T": target}, [], **fields))


@pytest.mark.parametrize("stiff", [0.0, np.inf], ids=["joint", "force"])
def test_a_body_comes_up_to_the_flow_as_its_drag_says(
    stiff: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """v(t) = w - exp(-R D R^T t / m) w, to first order, whether the joint takes drag or a force is applied."""
    monkeypatch.setattr(vehicles, "_STIFF", stiff)
    w = np.array([0.7, -0.4, 0.2])
    R = Rotation.from_euler("z", 35, degrees=True).as_matrix()
    A = R @ np.diag(LINEAR["linear"]) @ R.T / 300.0
    exact = w - expm(-0.2 * A) @ w
    errors = []
    for steps in (100, 200, 400):
        world = drifting(tmp_path, 0.2 / steps, {"drift": w.tolist()}, drag=LINEAR)
        world.step(steps)
        errors.append(np.abs(world.data.qvel[body(world, 1)[2]][:3] - exact).max())
    assert errors[0] < 0.003
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.05)
    assert errors[1] / errors[2] == pytest.approx(2.0, abs=0.05)


UNLIKE = {"hull": [0, 0], "aerial": [0, 0, 10], "submersible": [0, 0, -10], "otter": [9, 0], "quadrotor": [9, 0, 10]}


@pytest.mark.parametrize("engine", ["mujoco", "fused"])
def test_the_error_falls_with_the_step(engine: str) -> None:
    """By half for half the step, whatever the vehicle: how drag is integrated does not depend on the step."""

    def positions(timestep: float, engine: str) -> Array:
        scenario = build_scenario(
            {name: {"position": p, "vehicle": name, "heading": 20} for name, p in UNLIKE.items()},
            {f"T{name}": p for name, p in UNLIKE.items()},
            [[name, f"T{name}"] for name in UNLIKE],
            time={"end": 0.6},
            controller={"gain": 1.0, "control_period": 0.02},
            physics={"timestep": timestep},
        )
        spatial = np.array([len(p) == 3 for p in UNLIKE.values()])

        def law(t: float, _: Any) -> Array:
            return np.column_stack([np.full(5, np.sin(t)), np.full(5, np.cos(2 * t)), 0.3 * np.sin(3 * t) * spatial])

        run = simulate(scenario, engine=engine, threads=1, controller=law)
        return np.asarray(run.agent_position.fillna(0.0))

    exact = 2.0 * positions(0.00005, "fused") - positions(0.0001, "fused")
    steps = (0.004, 0.002, 0.001, 0.0005, 0.00025)
    errors = np.array([np.abs(positions(step, engine) - exact).max(axis=(0, 2)) for step in steps])
    np.testing.assert_allclose(errors[:-1] / errors[1:], 2.0, atol=0.1)


def test_stiff_drag_needs_no_small_steps(tmp_path: Path) -> None:
    """m / D of a tenth of a step: the implicit part keeps it stable, isotropic or not."""
    for drag in ({"time_constant": 1e-4}, {"linear": [3e6, 2.5e6, 2e6]}):
        world = drifting(tmp_path, 0.001, {"drift": [0.7, -0.4, 0.2]}, drag=drag)
        world.step(200)
        np.testing.assert_allclose(world.data.qvel[body(world, 1)[2]][:3], [0.7, -0.4, 0.2], rtol=1e-9)


def test_a_boat_heaves_and_rolls_like_an_oscillator() -> None:
    """m z'' = -D z' - K z and I phi'' = -c phi' - k phi, from rest, for small angles."""
    world = World(pursuit([0, 0], [0, 0], {"heading": 20}, scene={"surface": "water"}))
    description = load_vehicle("hull").description
    assert description.hydrostatics is not None
    vehicle, floats = world.arena.vehicles[0], description.hydrostatics
    c = description.drag.angular
    turn(world, 0, attitude(world) @ Rotation.from_euler("xy", [0.01, 0.005]).as_matrix())
    world.data.qpos[body(world)[1]][2] = 0.02
    world.step(150)
    R = attitude(world)
    seen = world.heights()[0], R[2, 1], -R[2, 0]
    cases = (
        (0.02, vehicle.mass, vehicle.drag[2], floats.heave),
        (0.01, vehicle.inertia[0, 0], c[0], floats.roll),
        (0.005, vehicle.inertia[1, 1], c[1], floats.pitch),
    )
    for value, (start, inertia, damping, stiffness) in zip(seen, cases, strict=True):
        motion = expm(0.15 * np.array([[0.0, 1.0], [-stiffness / inertia, -damping / inertia]])) @ [start, 0.0]
        assert abs(motion[0]) < 0.9 * start
        assert value == pytest.approx(motion[0], abs=0.01 * start)


THRUSTER = "default/default[@class='thruster']/general"


@pytest.mark.parametrize(
    ("limits", "bound"),
    [
        ({"forcerange": "-30 30", "gainprm": "2"}, 30.0),
        ({"forcerange": "-1e6 1e6"}, None),
        ({"forcerange": "-30 30", "dyntype": "filter", "dynprm": "0.02"}, 30.0),
        ({"actrange": "-30 30", "actlimited": "true", "dyntype": "filter", "dynprm": "0.02"}, 30.0),
        ({"ctrlrange": "-30 30"}, 30.0),
    ],
)
def test_saturation_sees_every_limit(limits: dict[str, str], bound: float | None, tmp_path: Path) -> None:
    """Oracle: MuJoCo's own forces, which come to a limit where the vehicle is saturated, and go no further."""
    world = World(pursuit([0, 0], [50, 0], {"vehicle": altered(tmp_path, "hull", setting(THRUSTER, **limits))}))
    world.step(200)
    world.close_loop()
    mujoco.mj_forward(world.model, world.data)
    force = np.abs(world.data.actuator_force[:4])
    if bound is None:
        assert world.saturation()[0] == 0.0
        assert force.max() > 40.0
    else:
        assert world.saturation()[0] == 1.0
        np.testing.assert_allclose(force, bound, rtol=1e-3)
