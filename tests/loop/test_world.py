"""The loop on bodies: stepping, clock, determinism, blow-up, contacts.

Oracles: one step at a time by hand with MuJoCo's own mj_step; where bodies can and cannot be.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mjsheaf import World, load_scenario, simulate
from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, UnstableError
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import build_scenario, mixed_scenario, refused
from tests.running import run_physics


def bits(world: World) -> bytes:
    return world.data.qpos.tobytes() + world.data.qvel.tobytes()


def test_the_initial_condition_is_the_scenarios() -> None:
    world = World(mixed_scenario())
    assert world.time == 0.0
    np.testing.assert_array_equal(world.positions(), world.system.initial)
    headings = Rotation.from_quat(world.quaternions(), scalar_first=True).as_euler("ZYX", degrees=True)
    np.testing.assert_allclose(headings, [[a, 0, 0] for a in (30, -60, 120, 10, 45)], atol=1e-12)
    np.testing.assert_array_equal(world.data.qvel, 0.0)
    assert world.model.ngeom > 0
    assert world.data.ctrl.any()  # the loop is closed from the start
    assert world.steps_per_sample == 10


@pytest.mark.parametrize("period", [0.01, 0.0], ids=["held", "continuous"])
def test_steps_by_hand_are_the_loops_own(period: float) -> None:
    """The loop is the user's if they want it: close it, then call MuJoCo; clock and control period go along."""
    scenario = mixed_scenario(
        controller={"gain": 3.0, "control_period": period}, disturbance={"targets": {"bound": 1.0}}
    )
    ours, theirs = World(scenario), World(scenario)
    ours.step(57)
    for k in range(57):
        theirs.close_loop()
        mujoco.mj_step(theirs.model, theirs.data)
        assert theirs.time == pytest.approx(0.001 * (k + 1))
    assert bits(ours) == bits(theirs)
    ours.step(10)
    theirs.step(10)
    assert bits(ours) == bits(theirs)


def test_start_time_is_respected() -> None:
    scenario = mixed_scenario(time={"start": 2.5, "end": 3.0})
    world = World(scenario)
    assert world.time == world.data.time == 2.5
    world.step(500)
    assert world.time == pytest.approx(3.0, abs=1e-12)
    trajectory = run_physics(scenario.system)
    np.testing.assert_allclose(trajectory.time, np.linspace(2.5, 3.0, 51), atol=1e-12)


def test_what_is_only_to_be_seen_does_not_matter() -> None:
    """To the bit, contacts and tumbling included; and the model is smaller."""
    scenario = load_scenario("harbour", {"time.end": 2})
    seen, unseen = World(scenario), World(scenario, visible=False)
    assert unseen.model.ngeom < 0.3 * seen.model.ngeom
    for world in (seen, unseen):
        world.step(800)
    np.testing.assert_array_equal(seen.data.qpos, unseen.data.qpos)
    np.testing.assert_array_equal(seen.data.qvel, unseen.data.qvel)


def test_the_height_of_the_water_does_not_matter_in_the_plane() -> None:
    """A boat meets the flow at z = 0 of the plane that it is controlled in, wherever the scene puts the water."""
    low, high = (run_physics(mixed_scenario(time={"end": 0.3}, scene={"height": z}).system) for z in (0.0, 30.0))
    np.testing.assert_allclose(high.positions, low.positions, rtol=0, atol=1e-11)
    np.testing.assert_allclose(high.log.origin[..., 2][:, [0, 4]], 30.0, atol=1e-9)


def test_forces_of_the_users_own_are_felt() -> None:
    pushed, left = World(mixed_scenario()), World(mixed_scenario())
    body = pushed.arena.body[1]
    pushed.data.xfrc_applied[body, :3] = [0.0, 0.0, 1000.0]
    pushed.step(50)
    left.step(50)
    assert pushed.positions()[1, 2] > left.positions()[1, 2] + 0.01
    np.testing.assert_array_equal(pushed.data.xfrc_applied[body], [0, 0, 1000, 0, 0, 0])


@pytest.mark.parametrize("value", [1e12, -1e12, np.nan, np.inf])
@pytest.mark.parametrize(("name", "v"), [("boat", 0), ("back", 2), ("ship", 4)])
@pytest.mark.parametrize("array", ["qvel", "qpos"])
def test_a_bad_state_ends_the_run_and_names_the_vehicle(value: float, name: str, v: int, array: str) -> None:
    """MuJoCo would reset state and time and continue."""
    world = World(mixed_scenario())
    world.step(25)
    at = world.arena.dof[v] if array == "qvel" else world.arena.qpos[v]
    getattr(world.data, array)[at + 1] = value
    with pytest.raises(UnstableError, match=rf"\b{name} .*\bt = 0\.02[56] s"):
        world.step(3)
    assert world.time == pytest.approx(0.0255, abs=0.0006)
    assert world.data.time == pytest.approx(world.time)
    world.reset()
    world.step(25)
    assert np.isfinite(world.data.qpos).all()


@pytest.mark.parametrize(("backend", "shown", "least"), [("ideal", "commanded", 1e6), ("physics", "speed", 100.0)])
def test_a_run_that_blows_up_keeps_what_was_recorded(backend: str, shown: str, least: float) -> None:
    """A held gain over its limit, 31.9 of the published team: it is named, and where its margin is to be found."""
    scenario = load_scenario("paper", {"controller.gain": 40, "time.end": 5})
    if backend == "physics":
        law = {"gain": 500.0, "control_period": 0.01}
        scenario = mixed_scenario(controller=law, time={"end": 5.0}, vehicles={"tau": 0.001})
    result = simulate(scenario, backend=backend)
    message, last = result.attrs["message"], float(result.time[-1])
    assert result.attrs["status"] == "unstable"
    vehicle = message.removeprefix("unstable: ").split(" ")[0]
    assert vehicle in [*result.agent.values, *result.target.values]
    assert f" at t = {last:.6g} s" in message
    assert float(message.split(f", {shown} ")[1].split(" m/s")[0]) > least
    assert "likely cause: the law, with a controller.gain that is too high" in message
    assert "mjsheaf check names the margin" in message
    assert 0.0 < last < 1.0
    assert np.isfinite(result.agent_position.sel(axis=["x", "y"])).all()


@pytest.mark.parametrize("factor", [1.0, np.nan])
def test_a_run_that_is_bad_from_the_start_keeps_its_start(factor: float) -> None:
    """The first commands are huge or NaN; they are not passed to MuJoCo, which does not warn."""
    system = mixed_scenario(controller={"gain": 1e9, "control_period": 0.01}).system
    system = replace(system, law=system.law._replace(gain=factor * system.law.gain))
    world = World(system)
    assert not np.abs(world.data.ctrl).max() < 1e10
    np.testing.assert_allclose(world.data.xpos[world.arena.body[1]], [3, 1, 2])
    with refused(UnstableError, "t = 0 s", "law"):
        world.step()
    trajectory = run_physics(system)
    assert trajectory.status == "unstable"
    np.testing.assert_array_equal(trajectory.positions, [world.system.initial])
    assert all(warning.number == 0 for warning in world.data.warning)


def test_every_command_has_the_name_of_its_thruster() -> None:
    result = simulate(mixed_scenario(time={"end": 0.02}), backend="physics")
    teams = (("agent", "thruster", "command"), ("target", "target_thruster", "target_command"))
    vehicles = {"boat": "hull", "front": "aerial", "back": "aerial", "diver": "aerial", "ship": "hull"}
    for kind, name, command in teams:
        for member in result[kind].values:
            commands, own = result[command].sel({kind: member}), load_vehicle(vehicles[member]).thrusters
            row = commands[name].values.tolist()  # a coordinate of what it labels
            assert row == own + [""] * (len(row) - len(own))
            assert commands.notnull().all("time").values.tolist() == [bool(label) for label in row]


@pytest.mark.parametrize("visible", [True, False])
def test_all_that_a_vehicle_has_carries_its_prefix(visible: bool) -> None:
    """Indices of every included vehicle: its free joint, bodies, sites and actuators. Oracle: MuJoCo's names."""
    planar = ["hull", "otter", "wamv"]
    agents = {
        f"V{k}": {"position": [10.0 * k, 0.0, 20.0][: 2 if kind in planar else 3], "vehicle": kind}
        for k, kind in enumerate([*planar, "aerial", "hexarotor", "quadrotor", "x500", "submersible"])
    }
    world = World(build_scenario(agents, {"V": [0, 0, 5]}, [[id, "V"] for id in agents]), visible=visible)
    model, seen = world.model, 0
    for name, vehicle in zip([*agents, "V"], world.arena.vehicles, strict=True):
        own = world.actuators(name)
        assert [model.actuator(k).name for k in own] == [f"{name}/{thruster}" for thruster in vehicle.thrusters]
        root = model.joint(f"{name}/").bodyid[0]
        assert all(model.actuator_trnid[own, 0] == model.joint(f"{name}/").id)
        bodies = np.flatnonzero(model.body_rootid == root)
        sites = np.flatnonzero(np.isin(model.site_bodyid, bodies))
        assert len(bodies) >= 1
        assert len(sites) >= len(vehicle.thrusters)
        assert all(model.body(b).name.startswith(f"{name}/") for b in bodies)
        assert all(model.site(s).name.startswith(f"{name}/") for s in sites)
        seen += len(own)
    assert seen == model.nu
    with refused(InputError, "'v1'", "V0", "V1"):
        world.actuators("v1")


def head_on(contacts: bool) -> Array:
    """Two boats that are commanded to exchange places; x of both, shape (T, 2)."""
    places = {"A": [8, 0], "B": [-8, 0]}
    scenario = build_scenario(
        {"A": [-8, 0], "B": {"position": [8, 0], "heading": 180}},
        {},
        [],
        anchors=[{"agent": id, "axes": ["x", "y"], "value": place} for id, place in places.items()],
        time={"end": 12.0},
        controller={"gain": 0.5},
        physics={"contacts": contacts},
    )
    return run_physics(scenario.system).positions[:, :2, 0]


def test_with_contacts_boats_stop_each_other_that_would_pass_through() -> None:
    """Bow to bow: their collision boxes reach 3.02 m ahead of their middles."""
    np.testing.assert_allclose(head_on(False)[-1], [8.0, -8.0], atol=0.1)
    x = head_on(True)
    gap = x[:, 1] - x[:, 0]
    assert gap.min() > 5.5
    assert gap[-1] == pytest.approx(6.0, abs=0.5)
