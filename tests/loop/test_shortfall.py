"""Multirotors that cannot turn, or lift, as their description asks. Oracles: a pencil, and simulations."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.vehicles.effects import Effects, embody, shortfalls_of
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from mjsheaf.vehicles.vehicle import AttitudeHold
from tests.builders import pursuit

INERTIA = 2.4e-5  # kg m^2
SETTINGS = {"frequency": 10, "tilt": 30, "rate": 2, "thrust": 0.6}


def drone(folder: Path, moment: float, **changes: float) -> str:
    """Write a drone of 27 g with one thrust and three moments of its own; give the path of its description."""
    s = SETTINGS | changes
    parts = [("t", "0 0 1 0 0 0", f"0 {s['thrust']}")]
    gears = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    parts += [(axis, f"0 0 0 {gear}", f"{-moment} {moment}") for axis, gear in gears.items()]
    actuators = "".join(
        f'<general name="{name}" site="s" gear="{gear}" ctrllimited="true" ctrlrange="{limits}"/>'
        for name, gear, limits in parts
    )
    (folder / "drone.xml").write_text(
        f'<mujoco><worldbody><body><inertial pos="0 0 0" mass="0.027" diaginertia="{INERTIA} {INERTIA} 3.2e-5"/>'
        f'<site name="s"/></body></worldbody><actuator>{actuators}</actuator></mujoco>'
    )
    path = folder / "drone.yaml"
    path.write_text(
        "summary: small drone\nmjcf: drone.xml\ndomain: volume\ndrag: {linear: [0.01, 0.01, 0.02]}\n"
        f"attitude: {{frequency: {s['frequency']}}}\nautopilot: {{rate: {s['rate']}}}\n"
        f"steering: {{largest_tilt: {s['tilt']}}}\n"
    )
    return str(path)


def drop(vehicle: str) -> float:
    """Return how far a drone falls below its place while it follows a moving target at a modest gain, m."""
    scenario = pursuit(
        [0, 0, 50],
        [20, 0, 50],
        {"vehicle": vehicle},
        time={"end": 40},
        controller={"gain": 0.5},
        target_motion={"kind": "lissajous", "amplitude": [5, 5, 0], "rate": [0.3, 0.4, 0]},
    )
    return 50.0 - float(simulate(scenario, engine="fused")["agent_position"].values[:, 0, 2].min())


@pytest.mark.parametrize("name", list_vehicles())
def test_no_vehicle_that_ships_falls_short(name: str) -> None:
    vehicle = load_vehicle(name)
    for effects in (Effects(), Effects(inertia=False), Effects(limits=False), Effects(lag=False)):
        assert shortfalls_of(embody(vehicle, effects)) == []


def test_a_drone_of_27_g_with_moments_of_1e_5_is_named(tmp_path: Path) -> None:
    """1e-5 / 2.4e-5 rad/s^2 of 10^2 30 pi / 180 that are asked for."""
    (one,) = shortfalls_of(load_vehicle(drone(tmp_path, 1e-5)))
    assert one.axis in ("roll", "pitch")
    assert one.falls
    assert one.available == pytest.approx(1e-5 / INERTIA, rel=1e-9)
    assert one.available < one.needed < 100 * math.radians(30)
    for number in ("0.417", "52.4"):
        assert number in one.sentence


def test_a_drone_that_needs_no_more_than_it_has_is_not(tmp_path: Path) -> None:
    (short,) = shortfalls_of(load_vehicle(drone(tmp_path, 1e-5)))
    for share, number in ((0.2, 1), (0.9, 1), (1.1, 0)):
        found = shortfalls_of(load_vehicle(drone(tmp_path, share * short.needed * INERTIA)))
        assert len(found) == number
        assert all(one.falls == (share < 0.25) for one in found)


def test_what_is_available_is_what_the_weight_leaves_of_the_rotors() -> None:
    """X500: rotors of 1 to 12.13 N at arms of .17678 m; each carries a quarter of the weight, and may give way to 1."""
    vehicle = load_vehicle("x500")
    carried = 2.28 * 9.81 / 4
    arm, room = 0.17678, min(carried - 1.0, 12.13 - carried)
    (one,) = shortfalls_of(replace(vehicle, hold=AttitudeHold(frequency=27), rate=10.0))
    assert one.available == pytest.approx(4 * arm * room / 0.024, rel=1e-4)


def test_a_lean_that_the_thrust_does_not_carry_is_named(tmp_path: Path) -> None:
    """1.02 of the weight, all of it: 0.9 would not carry it, so 1.01 count."""
    weight = 0.027 * 9.81
    (one,) = shortfalls_of(load_vehicle(drone(tmp_path, 1e-3, thrust=1.02 * weight)))
    assert (one.axis, one.falls) == ("thrust", False)
    assert one.needed == pytest.approx(weight / math.cos(math.radians(30)))
    assert f"{math.degrees(math.acos(1 / 1.01)):.2g} degrees" in one.sentence


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("changes", [{}, {"frequency": 20}, {"tilt": 15}, {"rate": 4, "frequency": 15}])
def test_drones_fall_below_a_quarter_and_fly_with_enough(changes: dict[str, float], tmp_path: Path) -> None:
    """A lean to the limit starts the swing, so targets begin 20 m away."""
    (short,) = shortfalls_of(load_vehicle(drone(tmp_path, 1e-9, **changes)))
    drops = [drop(drone(tmp_path, share * short.needed * INERTIA, **changes)) for share in (0.15, 1.0)]
    assert drops[0] > 5.0
    assert drops[1] < 1.0
    assert np.isfinite(drops).all()
