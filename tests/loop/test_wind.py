"""Wind on hulls. Oracles: Fossen's formula by angle, the balance of forces by root finding, and laws of symmetry."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import fsolve

from mjsheaf import check, simulate
from mjsheaf.arrays import Array
from mjsheaf.checking.trial import _limited
from mjsheaf.loop.bodies import pack_fleet, wind_wrench
from mjsheaf.loop.session import engine_of
from mjsheaf.results.ending import find_stuck
from mjsheaf.scenario import Scenario
from mjsheaf.vehicles.effects import hold_station
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.vehicle import AIR_DENSITY, Vehicle
from tests.builders import altered, build_scenario, turn
from tests.strategies import long, slow

HULLS = ["wamv", "otter", "buoy"]
BOATS = HULLS[:2]
ENGINES = ["fused", "mujoco"]
HEADINGS = np.arange(0.0, 360.0, 30.0)
"""Degrees, by which the wind's direction is turned from the hulls' heading."""

SPEED = 8.0
"""Speed of the wind, m/s."""

CURRENT = np.array([0.2, -0.1])


def fossen(vehicle: Vehicle, air: Array) -> tuple[float, float, float]:
    """Force ahead and to port and yaw moment to port of air at (2,) in the hull's axes, by the book's angle of attack.

    The book has y to starboard, z down, and gamma = -atan2(v_r, u_r) of the hull's velocity through the air.
    """
    w = vehicle.description.windage
    assert w is not None
    (frontal, lateral), (cx, cy, cn), length = w.area, w.coefficients, w.length or vehicle.size
    u, v = -air[0], air[1]  # of the hull through the air, y to starboard
    gamma, q = -np.arctan2(v, u), 0.5 * AIR_DENSITY * (u**2 + v**2)
    X, Y = -q * cx * np.cos(gamma) * frontal, q * cy * np.sin(gamma) * lateral
    return X, -Y, -q * cn * np.sin(2.0 * gamma) * lateral * length


def steady_drift(vehicle: Vehicle, wind: Array, current: Array, velocity: Array, heading: float) -> Array:
    """Solve for the velocity over ground (2,), m/s, and heading, rad, at which forces on a hull balance, from a guess.

    Forces are those of the wind and of drag through the water, moments those of the wind, of Munk, and of trim.
    """
    D, Q, A, floats = vehicle.drag, vehicle.quadratic_drag, vehicle.added_mass, vehicle.description.hydrostatics
    assert floats is not None
    couple = vehicle.weight * (floats.centre[0] - vehicle.centre_of_mass[0]) if floats.centre else 0.0

    def unbalanced(z: Array) -> list[float]:
        water = turn(-z[2]) @ (z[:2] - current)
        X, Y, N = fossen(vehicle, turn(-z[2]) @ (wind - z[:2]))
        heel = -vehicle.windage[3] * Y / floats.roll  # which turns the couple of weight and buoyancy about z
        turning = N - (A[1] - A[0]) * water[0] * water[1] + couple * heel
        round_hull = vehicle.windage[2] == 0.0
        return [
            X - (D[0] + Q[0] * abs(water[0])) * water[0],
            Y - (D[1] + Q[1] * abs(water[1])) * water[1],
            z[2] - heading if round_hull else turning,
        ]

    found, _, status, message = fsolve(unbalanced, [*velocity, heading], full_output=True, xtol=1e-12)
    assert status == 1, message
    return np.asarray(found)


def scenario(vehicle: str, wind: Any, current: Any = (0.0, 0.0), headings: Any = HEADINGS, **fields: Any) -> Scenario:
    """Hulls far from one another, each with its own target, in wind and current; None for no wind."""
    buoys = vehicle == "buoy"
    own: dict[str, Any] = {"vehicle": "hull"} | ({} if buoys else {"motion": {"kind": "fixed"}})
    hulls = [{"position": [1000.0 * k, 0.0], "heading": float(h), "vehicle": vehicle} for k, h in enumerate(headings)]
    others = [{"position": [1000.0 * k + 3.0, 0.0], **own} for k in range(len(hulls))]
    agents, targets = (others, hulls) if buoys else (hulls, others)
    usual: dict[str, Any] = {
        "time": {"end": 150},
        "controller": {"gain": 0.3, "control_period": 0.1},
        "flow": {"water": {"dimension": 2, "drift": list(current)}},
        "physics": {"timestep": 0.01},
    }
    usual["flow"] |= {} if wind is None else {"air": {"dimension": 2, "drift": list(wind)}}
    return build_scenario(
        {f"A{k}": agent for k, agent in enumerate(agents)},
        {f"T{k}": target for k, target in enumerate(targets)},
        [[f"A{k}", f"T{k}"] for k in range(len(hulls))],
        **usual | fields,
    )


def drifted(given: Scenario, engine: str) -> tuple[Array, Array]:
    """Velocities over ground (H, 2), m/s, and headings (H,), rad, at the end of a run of hulls without thrust."""
    system = given.system
    stopped = np.ones(len(system.team.members), dtype=np.bool_)
    system = replace(system, bodies=replace(system.bodies, engine=engine), stopped=stopped)
    run = engine_of(system).run()
    hulls = np.flatnonzero([vehicle.windage.any() for vehicle in system.vehicles])
    a, b, c, d = run.log.quaternions[-1, hulls].T
    return run.log.velocity[-1, hulls, :2], np.arctan2(2 * (b * c + a * d), 1 - 2 * (c**2 + d**2))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("hull", HULLS)
@pytest.mark.parametrize("at", [pytest.param(range(12), marks=pytest.mark.long), (1, 5)], ids=["every", "two"])
def test_drift_without_thrust_is_the_balance_of_forces(at: Sequence[int], hull: str, engine: str) -> None:
    """From these headings, in a current."""
    wind = SPEED * turn(0.3)[:, 0]
    headings = np.degrees(0.3) + HEADINGS[list(at)]
    velocities, ends = drifted(scenario(hull, wind, CURRENT, headings), engine)
    vehicle = load_vehicle(hull)
    for velocity, end in zip(velocities, ends, strict=True):
        vx, vy, heading = steady_drift(vehicle, wind, CURRENT, velocity, end)
        assert np.linalg.norm(velocity - [vx, vy]) < 0.01 * np.linalg.norm([vx, vy] - CURRENT)
        assert abs(heading - end) < np.radians(1.0)
        assert np.linalg.norm(velocity - CURRENT) > 0.02 * SPEED  # the wind drives it


@pytest.mark.parametrize("hull", HULLS)
def test_the_formula_is_that_of_the_book(hull: str) -> None:
    vehicle = load_vehicle(hull)
    kind = pack_fleet([vehicle], np.zeros(1), 0.01).kinds[0]
    for air in map(tuple, np.random.default_rng(1).normal(0.0, 5.0, (50, 3)).tolist()):
        (x, y, z), (roll, pitch, yaw) = wind_wrench(kind, air)
        np.testing.assert_allclose([x, y, yaw], fossen(vehicle, np.array(air[:2])), atol=1e-9)
        assert (z, roll, pitch) == (0.0, -vehicle.windage[3] * y, vehicle.windage[3] * x)
        assert x * air[0] + y * air[1] > 0.0  # it opposes the motion of the hull through the air
        port = wind_wrench(kind, (air[0], -air[1], air[2]))
        np.testing.assert_array_equal(port[0], [x, -y, z])
        np.testing.assert_array_equal(port[1], [-roll, pitch, -yaw])
        astern = wind_wrench(kind, (-air[0], air[1], air[2]))
        np.testing.assert_array_equal(astern[0], [-x, y, z])
        np.testing.assert_array_equal(astern[1], [roll, -pitch, -yaw])
    assert wind_wrench(kind, (0.0, 0.0, 3.0)) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("air", [{"dimension": 2}, {"dimension": 3}, {"dimension": 2, "drift": [0.0, 0.0]}])
def test_still_air_slows_a_hull(air: dict[str, Any]) -> None:
    water = {"dimension": 2, "drift": [0.6, 0.0]}
    given = scenario("otter", None, headings=[0.0], flow={"air": air, "water": water})
    through = drifted(given, "fused")[0] - drifted(scenario("otter", None, [0.6, 0.0], [0.0]), "fused")[0]
    assert -0.05 < through[0, 0] < -1e-4


@pytest.mark.parametrize("engine", ENGINES)
def test_wind_current_and_frame_that_move_together_change_nothing(engine: str) -> None:
    frame, wind = np.array([0.7, -0.4]), np.array([6.0, 2.0])
    still = drifted(scenario("otter", wind, [0.0, 0.0], [20.0]), engine)
    moving = drifted(scenario("otter", wind + frame, frame, [20.0]), engine)
    np.testing.assert_allclose(moving[0] - frame, still[0], atol=1e-6)
    np.testing.assert_allclose(moving[1], still[1], atol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_without_windage_or_wind_no_bit_changes(engine: str, tmp_path: Path) -> None:
    none = altered(tmp_path / "none", "otter", windage=None)
    zero = altered(tmp_path / "zero", "otter", windage={"area": [1, 2], "coefficients": [0, 0, 0], "height": 0.4})

    def places(vehicle: str, wind: Any) -> Array:
        run = simulate(scenario(vehicle, wind, CURRENT, [20.0], time={"end": 10}), engine=engine)
        return np.asarray(run["agent_position"].values)

    plain = places(none, None)
    np.testing.assert_array_equal(places("otter", None), plain)
    np.testing.assert_array_equal(places(none, [6.0, 2.0]), plain)
    np.testing.assert_array_equal(places(zero, [6.0, 2.0]), plain)
    assert np.nanmax(np.abs(places("otter", [6.0, 2.0]) - plain)) > 0.1


# -- the wind that a boat can hold ---------------------------------------------------------------------------------


def wind_to_hold(given: Scenario) -> tuple[float, dict[str, Any]]:
    answer = check(given, trial=False)
    return answer["margins"]["wind"]["A0"][1], answer


@pytest.mark.parametrize("headings", [(60.0,), slow((160.0, 180.0)), long(HEADINGS + 1.0)], ids=["60", "bows", "all"])
@pytest.mark.parametrize("limit", [1.0, long(100.0)])
@pytest.mark.parametrize("engine", ["fused", long("mujoco")])
@pytest.mark.parametrize("boat", BOATS)
def test_a_boat_holds_station_up_to_the_wind_that_check_names(
    boat: str, engine: str, limit: float, headings: Sequence[float]
) -> None:
    """But exactly in line with the wind, where nothing turns a boat.

    An otter with its bows in the wind holds more, too, until something turns it: `check` names what it holds beside
    that heading.
    """
    law = {"gain": 0.3, "control_period": 0.1, "velocity_limit": limit}
    for heading in headings:
        blown = partial(scenario, boat, headings=[heading], controller=law, time={"end": 200})
        largest, _ = wind_to_hold(blown([5.0, 0.0]))
        bows = boat == "otter" and abs(heading - 180.0) < 2.0
        for share, holds in ((0.9, True),) if bows else ((0.9, True), (1.1, False)):
            error = simulate(blown([share * largest, 0.0]), engine=engine)["tracking_error"].values[:, 0]
            assert (abs(error[-1] - error[-100]) < 0.05) == holds, (heading, share, error[-1])


@pytest.mark.slow
def test_check_says_which_boat_the_wind_blows_away() -> None:
    law = {"gain": 0.3, "control_period": 0.1, "velocity_limit": 1.0}
    largest, calm = wind_to_hold(scenario("wamv", [8.0, 0.0], headings=[60.0], controller=law))
    assert not [problem for problem in calm["problems"] if problem["kind"] == "wind"]
    assert calm["margins"]["bodies"]["stable"]
    _, blown = wind_to_hold(scenario("wamv", [1.2 * largest, 0.0], headings=[60.0], controller=law))
    (problem,) = [problem for problem in blown["problems"] if problem["kind"] == "wind"]
    assert problem["what"] == "A0 cannot hold station in the wind"
    assert f"at most {largest:.3g} m/s" in problem["why"]
    assert not blown["ok"]


@pytest.mark.parametrize("boat", BOATS)
def test_the_predicted_error_is_that_of_the_run(boat: str) -> None:
    given = scenario(boat, [7.0, 3.0], headings=[20.0, 140.0])
    foreseen = check(given, trial=False)["steady"]["bodies"]
    error = simulate(given, engine="fused")["tracking_error"].values
    seen = float(np.sqrt(np.mean(error[len(error) // 2 :] ** 2)))
    assert foreseen == pytest.approx(seen, rel=0.05)
    assert seen > 0.1


@pytest.mark.parametrize("height", [0.0, 40.0])
def test_the_wind_of_the_prediction_is_that_above_the_surface(height: float) -> None:
    channel = {"centre": [0, 0, height], "direction": [1, 0, 0], "beta": 10, "width": 5, "length": 200}
    air = {"dimension": 3, "channels": [channel]}
    given = scenario("wamv", None, headings=[60.0], flow={"air": air}, scene={"surface": "water", "height": height})
    foreseen = check(given, trial=False)["steady"]["bodies"]
    error = simulate(given, engine="fused")["tracking_error"].values[-1, 0]
    assert foreseen == pytest.approx(error, rel=0.05)
    assert error > 0.1


def test_an_error_that_targets_in_the_wind_decide_is_not_known() -> None:
    answer = check(scenario("buoy", [6.0, 2.0], headings=[0.0]), trial=False)
    assert "not known on the vehicles" in " ".join(repr(answer).split())


def test_a_buoy_in_the_wind_drifts_as_far_as_check_says() -> None:
    given = scenario("buoy", [6.0, 2.0], CURRENT, [0.0], time={"end": 60})
    data = simulate(given, engine="fused")["target_position"].values[:, 0, :2]
    under_way = 2.0 * np.linalg.norm(data[-1] - data[len(data) // 2])  # without the time that it takes to drift
    assert check(given, trial=False)["drifts"]["T0"] == pytest.approx(under_way, rel=0.01)


BREEZES = [long(boat, [v, 0.2 * v], 40.0) for boat in ("wamv_azimuth", "otter_rudder") for v in (0.3, 4.0)]


@pytest.mark.parametrize(("boat", "wind", "heading"), [slow("wamv", [12.0, 5.0], 60.0), *BREEZES])
def test_check_has_no_fault_to_find_in_a_wind_that_a_boat_can_hold(boat: str, wind: Any, heading: float) -> None:
    """Standing against the wind is not being stuck."""
    answer = check(scenario(boat, wind, headings=[heading]))
    assert answer["ok"], answer


@pytest.mark.parametrize("heading", [0.0, 45.0, 180.0])
def test_a_boat_at_its_hand_point_lies_with_its_bows_in_the_wind(heading: float) -> None:
    wind = np.array([5.0, 0.0, 0.0])
    lies, command, _ = hold_station(load_vehicle("otter"), np.radians(heading), np.zeros(3), wind)
    assert np.cos(lies) == pytest.approx(-1.0, abs=2e-4)
    assert command[0] < -0.01


@pytest.mark.parametrize("boat", BOATS)
def test_a_hull_that_something_holds_fast_is_stuck_in_any_wind(boat: str) -> None:
    """Of a run in a light wind, commands and velocities are changed to those of a boat that is moored."""
    given = scenario(boat, [2.0, 0.5], headings=[60.0])
    data = simulate(given, engine="fused")
    assert not find_stuck(given.phases, data)
    assert (_limited(given.system, data) < 1.0).all()
    data["velocity_command"].values[..., :2] = [0.3, 0.4]
    data["agent_velocity"].values[:] = data["agent_flow"].values
    (stuck,) = find_stuck(given.phases, data)
    assert stuck.asked == pytest.approx(0.5)
    assert (_limited(given.system, data) == 1.0).all()


def test_the_length_is_the_size_unless_given(tmp_path: Path) -> None:
    windage = {"area": [1, 2], "coefficients": [0.5, 0.7, 0.1], "height": 1}
    vehicle = load_vehicle(altered(tmp_path, "otter", windage=windage))
    assert vehicle.windage[2] == pytest.approx(-AIR_DENSITY * 0.1 * 2.0 * vehicle.size)


@pytest.mark.long
@pytest.mark.parametrize("boat", BOATS)
@pytest.mark.parametrize("dimension", [2, 3])
def test_neighbours_in_lanes_meet_the_wind_that_they_meet_alone(dimension: int, boat: str) -> None:
    """Steady, or in gusts that the seed decides."""
    air: dict[str, Any] = {"dimension": dimension, "drift": [6.0, 2.0, 0.0][:dimension]}
    gusty = {**air, "gusts": {"kind": "dryden", "wind_speed": 12.0, "altitude": 4.0}}
    for flow in ({"air": air}, {"air": gusty}):
        given = scenario(boat, None, time={"end": 10}, flow=flow)
        together, apart = (simulate(given, engine=engine)["agent_position"].values for engine in ENGINES)
        np.testing.assert_allclose(together, apart, atol=1e-9)
    other = simulate(given.with_seed(1), engine="fused")["agent_position"].values
    assert np.nanmax(np.abs(together - other)) > 0.01
