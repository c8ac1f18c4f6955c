"""Effects switched off one at a time: each changes what it should, and nothing else.

Oracles: the fields of a vehicle that may differ; what the simulation does without the effect.
"""

from dataclasses import fields
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mjsheaf.vehicles.actuators import Thruster
from mjsheaf.vehicles.effects import Effects, embody, has_effects
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from mjsheaf.vehicles.steering import Full
from mjsheaf.vehicles.vehicle import Vehicle
from tests.builders import BOATS, DATA, MULTIROTORS, POWERED, REAL
from tests.loop.one_vehicle import alone, ask, attitude, body, largest_tilt, least_thrust, place, yaw_of

IDEAL = ("hull", "aerial", "submersible")
CHANGES = {
    # Angular drag too, in proportion to the inertia, so that the attitude hold stays what it was.
    "inertia": {"mass", "ballast", "weight_moment", "inertia", "inertials", "added_mass", "rate"}
    | {"angular_drag", "quadratic_drag"},
    "drag_law": {"quadratic_drag", "windage"},
    "limits": {"actuators", "steering"},
    "lag": {"actuators"},
    "underactuation": {"actuators", "steering"},
}
HAS = {
    "hexarotor": {"inertia", "drag_law", "limits", "lag"},
    "quadrotor": {"inertia", "drag_law", "limits", "lag", "underactuation"},
    "x500": {"inertia", "limits", "lag", "underactuation"},
    "wamv": {"inertia", "drag_law", "limits", "lag"},
    "otter": {"inertia", "drag_law", "limits", "lag", "underactuation"},
    "wamv_azimuth": {"inertia", "drag_law", "limits", "lag"},
}


def same(one: Any, other: Any) -> bool:
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, Thruster):
        return type(one) is type(other) and same(list(vars(one).values()), list(vars(other).values()))
    return bool(np.array_equal(one, other))


def differing(one: Vehicle, other: Vehicle) -> set[str]:
    return {f.name for f in fields(Vehicle) if not same(getattr(one, f.name), getattr(other, f.name))}


@pytest.mark.parametrize("name", list_vehicles())
def test_with_all_effects_on_a_vehicle_is_itself(name: str) -> None:
    vehicle = load_vehicle(name)
    assert not differing(embody(vehicle, Effects()), vehicle)
    assert name not in IDEAL or not any(getattr(has_effects(vehicle), effect) for effect in CHANGES)


@pytest.mark.parametrize("effect", CHANGES)
@pytest.mark.parametrize("name", HAS)
def test_an_effect_that_is_off_changes_its_own_fields_alone(name: str, effect: str) -> None:
    vehicle = load_vehicle(name)
    off = embody(vehicle, Effects(**{effect: False}))
    changed = differing(off, vehicle)
    assert changed <= CHANGES[effect]
    assert bool(changed) == (effect in HAS[name])
    assert not getattr(has_effects(off), effect)
    for other in set(CHANGES) - {effect}:
        assert getattr(has_effects(off), other) == (other in HAS[name]), other


@pytest.mark.parametrize("name", REAL)
def test_without_limits_thrusters_push_as_hard_as_asked(name: str) -> None:
    vehicle, free = load_vehicle(name), alone(name, limits=False)
    ask(free, [30.0, 0.0, 0.0][: vehicle.dimension])
    free.step(1_000)
    force, (low, high) = free.data.actuator_force[body(free)[3]], vehicle.limits.T
    assert np.isinf(free.arena.vehicles[0].limits).all()
    assert (force > high).any() or (force < low).any()
    assert free.saturation()[0] == 0.0


@pytest.mark.parametrize("name", REAL)
def test_without_lag_thrusters_follow_at_once(name: str) -> None:
    n = load_vehicle(name).dimension
    for lag in (True, False):
        world = alone(name, lag=lag)
        thrusters = body(world)[3]
        before = world.data.ctrl[thrusters].copy()
        ask(world, [0.2, 0.1, 0.2][:n])
        mujoco.mj_forward(world.model, world.data)
        wanted = before if lag else world.data.ctrl[thrusters]
        np.testing.assert_allclose(world.data.actuator_force[thrusters], wanted, atol=1e-9)
        assert np.abs(world.data.ctrl[thrusters] - before).max() > 0.05


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(("name", "D"), [("wamv", 100.0), ("hexarotor", 0.6)])
def test_without_the_drag_law_thrust_grows_with_speed(name: str, D: float) -> None:
    """At a steady 2 m/s: D v + Q v^2 of the whole law, D v without it; the vehicle is as fast with either."""
    Q = {"wamv": 150.0, "hexarotor": 0.1}[name]
    for drag_law, force in ((True, 2 * D + 4 * Q), (False, 2 * D)):
        world = alone(name, drag_law=drag_law, timestep=0.005)
        vehicle, _, dof, thrusters = body(world)
        ask(world, [2.0, 0.0, 0.0][: vehicle.dimension])
        world.step(4_000)
        assert world.data.qvel[dof][0] == pytest.approx(2.0, abs=1e-4)
        assert (vehicle.W @ world.data.ctrl[thrusters])[0] == pytest.approx(force, rel=1e-4)


@pytest.mark.parametrize("name", REAL)
def test_without_inertia_a_body_is_as_light_as_it_is_told_to_be(name: str) -> None:
    """m / D of the slowest controlled axis is massless_tau, with no added mass and no autopilot; weight stays."""
    real = load_vehicle(name)
    vehicle = embody(real, Effects(inertia=False, massless_tau=0.05))
    n = real.dimension
    assert (vehicle.mass / vehicle.drag[:n]).max() == pytest.approx(0.05)
    assert vehicle.rate == 0.0
    assert not vehicle.added_mass.any()
    assert vehicle.weight == real.weight
    np.testing.assert_array_equal(vehicle.trim, real.trim)
    np.testing.assert_allclose(vehicle.inertia, real.inertia * vehicle.mass / real.mass)


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_without_inertia_a_body_stays_where_trim_has_it(name: str) -> None:
    """Its weight is still carried: multirotors hover, boats float at their draft and trim."""
    real, light = alone(name, heading=20), alone(name, heading=20, inertia=False)
    for world in (real, light):
        world.step(30_000)
    np.testing.assert_allclose(light.heights(), real.heights(), atol=1e-6)
    tilt = (attitude(real)[2], attitude(light)[2])
    np.testing.assert_allclose(*tilt, atol=1e-6)
    if name in MULTIROTORS:
        np.testing.assert_allclose(light.positions()[0], 0.0, atol=1e-6)


@pytest.mark.parametrize("name", [*MULTIROTORS, "wamv"])
def test_without_inertia_a_heading_is_held_as_before(name: str) -> None:
    """The attitude hold's frequency is the same: a yaw of 3 degrees is taken back in the same time."""
    seen = []
    for inertia in (True, False):
        world = alone(name, inertia=inertia, limits=False, lag=False)
        place(world, Rotation.from_euler("z", 3, degrees=True).as_matrix())
        hold = world.arena.vehicles[0].hold
        record = []
        for _ in range(4):
            world.step(round(1000 / hold.frequency))
            record.append(np.rad2deg(yaw_of(world)))
        seen.append(record)
    np.testing.assert_allclose(seen[1], seen[0], atol=0.1)
    assert abs(seen[0][-1]) < 0.6


@pytest.mark.parametrize("name", ["quadrotor", "x500", "otter"])
def test_virtual_thrusters_are_along_every_controlled_axis_as_strong_and_as_slow_as_its_own(name: str) -> None:
    real = load_vehicle(name)
    vehicle = embody(real, Effects(underactuation=False))
    rows = [0, 1, 5] if name in BOATS else list(range(6))
    assert (vehicle.steering, vehicle.steering.hand, vehicle.controlled_rows) == (Full(), 0.0, rows)
    np.testing.assert_array_equal(vehicle.W[rows], np.eye(len(rows)))
    forces = vehicle.limits[: vehicle.dimension, 1]
    strongest = {"quadrotor": 4 * 13.0, "x500": 4 * 12.13, "otter": 2 * 119.68}[name]
    np.testing.assert_allclose(forces, strongest, rtol=1e-9)
    np.testing.assert_array_equal(vehicle.limits[:, 0], -vehicle.limits[:, 1])
    lag = [actuator.lag for actuator in vehicle.actuators]
    np.testing.assert_allclose(lag, real.actuators[0].lag)


# -- capabilities: sums of thrusts, and simulations --------------------------------------------------------------------


def test_an_otter_is_as_fast_as_its_source_says() -> None:
    """Weakest ahead too: it turns first."""
    otter = load_vehicle("otter")
    found = otter.capability
    assert found.forward_thrust == pytest.approx(2 * 119.68, rel=1e-9)
    assert found.forward_speed == pytest.approx(3.086, rel=1e-3)
    assert (least_thrust(otter), found.least_speed) == (found.forward_thrust, found.forward_speed)


def test_a_wamv_pushes_along_its_thrusters_axes() -> None:
    """Four of 2353.5 N at 45 degrees: four cosines ahead, with 100 v + 150 v^2 = F; abeam with less, for the yaw."""
    wamv = load_vehicle("wamv")
    found = wamv.capability
    F = 4 * 2353.5 * np.sqrt(0.5)
    assert found.forward_thrust == pytest.approx(F, rel=1e-6)
    assert found.forward_speed == pytest.approx((np.sqrt(100**2 + 600 * F) - 100) / 300, rel=1e-6)
    assert 0.3 * F < least_thrust(wamv) < F
    # Sideways, with the pairs at levers a (rear) and b (front): F_s a = F_b b, the weaker pair saturated.
    rows = wamv.W
    stern, bow = np.abs(rows[5, :2]).sum() / 2, np.abs(rows[5, 2:]).sum() / 2
    full = 2 * 2353.5 * np.sqrt(0.5)
    sideways = full * (1 + min(stern, bow) / max(stern, bow))
    assert least_thrust(wamv) <= sideways * (1 + 1e-9)


def test_a_bow_thruster_moves_a_boat_abeam() -> None:
    """150 v = 50 N: there is no quadratic drag abeam, but for the rounding of the direction's cosine."""
    catamaran = load_vehicle(str(DATA / "catamaran.yaml"))
    assert least_thrust(catamaran) == pytest.approx(50.0, rel=1e-9)
    assert catamaran.capability.least_speed == pytest.approx(50.0 / 150.0, rel=1e-9)


def test_a_tilted_hexarotor_pushes_sideways_by_about_its_tilt() -> None:
    """All rotors leaning one way would make tan 30 x lift; without a moment it is half of that.

    A force F along x takes +-F cos(b) / (3 sin 30) of a rotor, b between x and the way that the rotor leans: on the two
    that lean along x all of what each carries, W / (6 cos 30).
    """
    vehicle = load_vehicle("hexarotor")
    half = 0.5 * np.tan(np.deg2rad(30)) * vehicle.weight
    assert vehicle.capability.forward_thrust == pytest.approx(half, rel=1e-6)
    assert least_thrust(vehicle) == pytest.approx(half, rel=1e-6)


@pytest.mark.parametrize("name", ["quadrotor", "x500"])
def test_a_quadrotor_is_bounded_by_its_tilt(name: str) -> None:
    vehicle = load_vehicle(name)
    found = vehicle.capability
    by_tilt = vehicle.weight * np.tan(np.deg2rad(largest_tilt(vehicle)))
    assert found.forward_thrust == pytest.approx(by_tilt, rel=1e-9)
    v, D, Q = found.forward_speed, vehicle.drag[0], vehicle.quadratic_drag[0]
    assert D * v + Q * v * v == pytest.approx(by_tilt, rel=1e-9)


@pytest.mark.parametrize("name", POWERED)
def test_without_limits_there_is_no_bound(name: str) -> None:
    """But for a multirotor's tilt of 80 degrees, which its limits free it to."""
    vehicle = load_vehicle(name)
    free = embody(vehicle, Effects(limits=False))
    found = free.capability
    if largest_tilt(vehicle):
        assert found.forward_thrust == pytest.approx(vehicle.weight * np.tan(np.deg2rad(80)), rel=1e-9)
    else:
        assert np.isinf([found.forward_thrust, found.forward_speed, least_thrust(free), found.least_speed]).all()
    if name in ("hull", "aerial", "submersible"):
        assert np.isinf(vehicle.capability.least_speed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["otter", "wamv", "hexarotor"])
def test_the_simulation_is_as_fast_ahead_as_was_said(name: str) -> None:
    """With a command of twice that speed, it settles within 2 % of it."""
    speed = load_vehicle(name).capability.forward_speed
    world = alone(name, timestep=0.005)
    ask(world, [2 * speed, 0, 0][: world.arena.vehicles[0].dimension])
    world.step(8_000)
    assert world.data.qvel[body(world)[2]][0] == pytest.approx(speed, rel=0.02)
