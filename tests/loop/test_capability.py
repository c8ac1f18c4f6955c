"""Capabilities printed by `mjsheaf list --vehicles`. Oracles: sums of thrusts, and simulations."""

import numpy as np
import pytest

from mjsheaf.vehicles.effects import Effects, embody
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import DATA, POWERED, alone, ask, body, largest_tilt


def test_an_otter_is_as_fast_as_its_source_says() -> None:
    """Weakest ahead too: it turns first."""
    found = load_vehicle("otter").capability
    assert found.forward_thrust == pytest.approx(2 * 119.68, rel=1e-9)
    assert found.forward_speed == pytest.approx(3.086, rel=1e-3)
    assert (found.least_thrust, found.least_speed) == (found.forward_thrust, found.forward_speed)


def test_a_wamv_pushes_along_its_thrusters_axes() -> None:
    """Four of 2353.5 N at 45 degrees: four cosines ahead, with 100 v + 150 v^2 = F; abeam with less, for the yaw."""
    found = load_vehicle("wamv").capability
    F = 4 * 2353.5 * np.sqrt(0.5)
    assert found.forward_thrust == pytest.approx(F, rel=1e-6)
    assert found.forward_speed == pytest.approx((np.sqrt(100**2 + 600 * F) - 100) / 300, rel=1e-6)
    assert 0.3 * F < found.least_thrust < F
    # Sideways, with the pairs at levers a (rear) and b (front): F_s a = F_b b, the weaker pair saturated.
    rows = load_vehicle("wamv").W
    stern, bow = np.abs(rows[5, :2]).sum() / 2, np.abs(rows[5, 2:]).sum() / 2
    full = 2 * 2353.5 * np.sqrt(0.5)
    sideways = full * (1 + min(stern, bow) / max(stern, bow))
    assert found.least_thrust <= sideways * (1 + 1e-9)


def test_a_bow_thruster_moves_a_boat_abeam() -> None:
    """150 v = 50 N: there is no quadratic drag abeam, but for the rounding of the direction's cosine."""
    found = load_vehicle(str(DATA / "catamaran.yaml")).capability
    assert found.least_thrust == pytest.approx(50.0, rel=1e-9)
    assert found.least_speed == pytest.approx(50.0 / 150.0, rel=1e-9)


def test_a_tilted_hexarotor_pushes_sideways_by_about_its_tilt() -> None:
    """All rotors leaning one way would make tan 30 x lift; without a moment it is half of that.

    A force F along x takes +-F cos(b) / (3 sin 30) of a rotor, b between x and the way that the rotor leans: on the two
    that lean along x all of what each carries, W / (6 cos 30).
    """
    vehicle = load_vehicle("hexarotor")
    found = vehicle.capability
    half = 0.5 * np.tan(np.deg2rad(30)) * vehicle.weight
    assert found.forward_thrust == pytest.approx(half, rel=1e-6)
    assert found.least_thrust == pytest.approx(half, rel=1e-6)


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
    found = embody(vehicle, Effects(limits=False)).capability
    if largest_tilt(vehicle):
        assert found.forward_thrust == pytest.approx(vehicle.weight * np.tan(np.deg2rad(80)), rel=1e-9)
    else:
        assert np.isinf([found.forward_thrust, found.forward_speed, found.least_thrust, found.least_speed]).all()
    if name in ("hull", "aerial", "submersible"):
        assert np.isinf(vehicle.capability.least_speed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["otter", "wamv", "hexarotor"])
def test_the_simulation_is_as_fast_ahead_as_was_said(name: str) -> None:
    """With a command of twice that speed, it settles within 2 % of it."""
    speed = load_vehicle(name).capability.forward_speed
    world = alone(name)
    ask(world, [2 * speed, 0, 0][: world.arena.vehicles[0].dimension])
    world.step(40_000)
    assert world.data.qvel[body(world)[2]][0] == pytest.approx(speed, rel=0.02)
