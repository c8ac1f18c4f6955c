"""A rudder behind a propeller, and the Otter that has one.

Oracles: lift and drag at an incidence; energy and mirror; pencil and paper for the turn after a step of the rudder.
"""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mjsheaf import simulate
from mjsheaf.arrays import Array
from mjsheaf.loop.bodies import pack_fleet
from mjsheaf.loop.loop import STOPPED
from mjsheaf.vehicles.actuators import AzimuthThruster, RudderThruster, aim, flow_wrench
from mjsheaf.vehicles.effects import Effects, embody, has_effects
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import build_scenario
from tests.loop.one_vehicle import alone, ask, body, yaw_of
from tests.loop.test_one_sided import errors, make_run

NAME = "otter_rudder"
LIMIT, RATE, DENSITY = np.deg2rad(35.0), np.deg2rad(40.0), 1025.0
AREA, ASPECT_RATIO, SHARE, STALL = 0.03, 0.2**2 / 0.03, 0.5, np.deg2rad(30.0)
DISC = np.pi * 0.25**2 / 4.0  # m^2
PLACE = np.array([-1.24, 0.0, -0.0975])  # m
MOST = 239.36  # N
STILL = (0.0, 0.0, 0.0)

speeds = st.floats(-3.0, 3.0)
rates = st.floats(-1.0, 1.0)
thrusts = st.floats(0.0, MOST)
deflections = st.floats(-LIMIT, LIMIT)


VEHICLE = replace(load_vehicle(NAME), added_mass=np.zeros(6))  # without which forces are not scaled
CHANNELS = pack_fleet([VEHICLE], np.zeros(1), 0.01).thrusters


def flow_force(velocity: Any, turn: Any, thrust: float, deflection: float) -> tuple[Array, Array]:
    """Force and moment of the rudder."""
    act = np.array([thrust, deflection])
    force, moment = flow_wrench(CHANNELS, tuple(velocity), tuple(turn), act, act)
    return np.array(force), np.array(moment)


def oracle(velocity: Any, turn: Any, thrust: float, deflection: float) -> Array:
    """The same force from lift and drag at the incidence."""
    u, v, _ = np.asarray(velocity) + np.cross(turn, PLACE)
    square = u * abs(u) + SHARE * 2.0 * max(thrust, 0.0) / (DENSITY * DISC)
    u = float(np.sign(square) * np.sqrt(abs(square)))
    speed, course = np.hypot(u, v), np.arctan2(v, u)
    incidence = deflection - course
    most = np.sin(STALL)
    coefficient = 6.13 * ASPECT_RATIO / (ASPECT_RATIO + 2.25) * np.clip(np.sin(incidence), -most, most)
    lift, drag = coefficient * np.cos(incidence), coefficient * np.sin(incidence)
    ahead, aside = np.array([np.cos(course), np.sin(course)]), np.array([-np.sin(course), np.cos(course)])
    return np.asarray(0.5 * DENSITY * AREA * speed**2 * (lift * aside - drag * ahead))


@given(speeds, speeds, rates, thrusts, deflections)
@example(0.0, 0.0, 0.0, 0.0, 0.3)
@example(1.0, 0.0, 0.0, -50.0, 0.2)
def test_its_force_is_lift_and_drag_at_the_rudder(u: float, v: float, r: float, T: float, angle: float) -> None:
    """Without flow it has none, and the race of a propeller that pushes astern does not pass it."""
    force, moment = flow_force([u, v, 0.0], [0.0, 0.0, r], T, angle)
    np.testing.assert_allclose(force[:2], oracle([u, v, 0.0], [0.0, 0.0, r], T, angle), atol=1e-9)
    np.testing.assert_allclose(moment, np.cross(PLACE, force), atol=1e-9)
    assert abs(force[2]) < 1e-9


# -- allocation --------------------------------------------------------------------------------------------------------


def aimed(effort: Any, velocity: Any = STILL, turn: Any = STILL, channels: Any = None) -> Array:
    """Commands for an effort, with the time to get there."""
    channels = (CHANNELS if channels is None else channels).copy()
    channels["reach"] = np.inf
    ctrl = np.array(effort, dtype=np.float64)
    aim(channels, tuple(velocity), tuple(turn), np.zeros(2), ctrl)
    return ctrl


@given(st.floats(0.0, MOST), st.floats(-MOST, MOST), st.floats(-3.0, 3.0), st.floats(-4.0, 4.0))
def test_allocation_is_mirrored_whatever_the_drift(ahead: float, side: float, u: float, v: float) -> None:
    one = aimed([ahead, side], [u, v, 0.0])
    other = aimed([ahead, -side], [u, -v, 0.0])
    np.testing.assert_allclose(other, one * [1.0, -1.0], rtol=1e-9, atol=1e-9)


@settings(max_examples=300)
@given(st.floats(1.0, 0.95 * MOST), st.floats(-1.0, 1.0), st.floats(0.0, 3.0), st.floats(-0.1, 0.1))
def test_efforts_that_are_feasible_at_rest_are_made_at_any_speed_ahead(
    ahead: float, share: float, u: float, drift: float
) -> None:
    """Across the whole sector without drift; the inner part of it where the flow comes 0.1 rad from the side."""
    v = drift * np.sqrt(u**2 + SHARE * 2.0 * ahead / (DENSITY * DISC))
    inner = 0.98 if abs(drift) < 1e-3 else 0.6
    effort = np.array([ahead, inner * share * ahead * np.tan(LIMIT)])
    commands = aimed(effort, [u, v, 0.0])
    force, _ = flow_force([u, v, 0.0], STILL, *commands)
    if commands[0] < MOST:
        np.testing.assert_allclose([commands[0] + force[0], force[1]], (VEHICLE.W @ effort)[:2], atol=3e-3 * ahead)


def test_at_rest_full_deflection_is_the_edge_of_what_counts_as_feasible() -> None:
    """The sector of efforts is just what can be made: the ratio of its edge is that of the force at full deflection."""
    force, _ = flow_force(STILL, STILL, 100.0, STALL)
    ratio = force[1] / (100.0 + force[0])
    actuator = VEHICLE.actuators[0]
    assert isinstance(actuator, RudderThruster)
    assert actuator.side * np.tan(LIMIT) == pytest.approx(ratio, rel=1e-12)
    commands = aimed([100.0 + force[0], force[1] / actuator.side])
    np.testing.assert_allclose(commands, [100.0, STALL], rtol=2e-3)


@given(st.floats(-500, 500), st.floats(-500, 500), speeds, speeds, rates)
def test_commands_are_within_limits_in_any_flow(x: float, y: float, u: float, v: float, r: float) -> None:
    thrust, angle = aimed([x, y], [u, v, 0.0], [0.0, 0.0, r])
    assert 0.0 <= thrust <= MOST
    assert abs(angle) <= LIMIT


def test_rounding_does_not_turn_it() -> None:
    """At rest, efforts and speeds have a direction all the same: that of rounding."""
    for sign in (1.0, -1.0):
        assert abs(aimed([0.0, sign * 1e-12])[1]) < 1e-6
        assert abs(aimed([0.0, 0.0], [sign * 1e-13, 1e-13, 0.0])[1]) < 1e-6


def test_what_is_not_finite_stays_to_be_seen() -> None:
    assert np.isnan(aimed([np.nan, 1.0])[0])
    assert np.isinf(aimed([1.0, np.inf])[1])


def test_what_effects_it_has() -> None:
    assert has_effects(VEHICLE).limits
    free = embody(VEHICLE, Effects(limits=False)).actuators[0]
    assert type(free) is AzimuthThruster
    np.testing.assert_array_equal(free.wrenches, VEHICLE.actuators[0].wrenches)


# -- the boat ----------------------------------------------------------------------------------------------------------


def sail(deflection: float, thrust: float, steps: int, h: float = 0.01) -> tuple[Array, Array]:
    """Yaw rate (rad/s) and heading (rad) after a step of the rudder, once it goes straight ahead."""
    world = alone(NAME, timestep=h)
    _, _, d, own = body(world)
    world.data.qvel[d][0] = thrust / 77.55
    found = []
    for k in range(steps):
        world.close_loop(sample=False)
        world.data.ctrl[own] = thrust, deflection if k * h >= 5.0 else 0.0
        mujoco.mj_step(world.model, world.data)
        found.append((world.data.qvel[d][5], yaw_of(world)))
    rate, heading = np.array(found).T
    return rate, heading


def steady_rate(thrust: float) -> float:
    """Yaw rate for a deflection of 1 rad, of the linear equations of sway and yaw about a straight run, 1/s.

    Fossen, Handbook of Marine Craft Hydrodynamics, 2011, ch. 7, with the rudder's force -k a (v + x r - a delta).
    """
    m, x_g, u = VEHICLE.mass, VEHICLE.centre_of_mass[0], thrust / 77.55
    added_x, added_y = load_vehicle(NAME).added_mass[:2]
    k = 0.5 * DENSITY * AREA * 6.13 * ASPECT_RATIO / (ASPECT_RATIO + 2.25)
    a, x = np.sqrt(u**2 + SHARE * 2.0 * thrust / (DENSITY * DISC)), PLACE[0]
    hull = np.array([[162.5, (m + added_x) * u], [(added_y - added_x) * u, 42.65 + m * x_g * u]])
    lever = np.array([1.0, x])
    return float(np.linalg.solve(hull + k * a * np.outer(lever, lever), k * a**2 * lever)[1])


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("thrust", [60.0, 150.0])
def test_a_small_step_of_the_rudder_turns_it_as_the_linear_equations_say(thrust: float) -> None:
    step = 1e-4
    rate, heading = sail(step, thrust, 4000)
    before, after = heading[500], heading[-1]
    assert abs(before) < 1e-9
    assert after < before  # to starboard
    assert rate[-1] == pytest.approx(step * steady_rate(thrust), rel=0.02)
    assert np.ptp(rate[-500:]) < 1e-3 * abs(rate[-1])


def test_a_lost_boat_leaves_its_rudder_where_it_is() -> None:
    world = alone(NAME, timestep=0.01)
    ask(world, [1.5, 1.0])
    world.step(60)
    own = body(world)[3]
    before = world.data.act[own][1]
    assert abs(before) > 0.05
    world._loop.params.helm[:] = STOPPED
    world.step(100)
    assert world.data.act[own][1] == pytest.approx(before, abs=1e-12)
    assert world.data.act[own][0] < 1e-3 * MOST


def test_engines_agree_and_the_deflection_is_recorded_in_rad() -> None:
    agents = {f"A{k}": {"position": [0, 9 * k], "vehicle": NAME, "heading": 70 * k} for k in range(3)}
    scenario = build_scenario(
        agents,
        {"T": [15.0, 20.0]},
        [[id, "T"] for id in agents],
        time={"end": 6.0},
        flow={"agents": {"dimension": 2, "drift": [0.2, -0.1]}},
        controller={"gain": 0.2},
        physics={"timestep": 0.01},
    )
    data, other = (simulate(scenario, engine=name) for name in ("fused", "mujoco"))
    for name in ("agent_position", "command", "agent_thrust"):
        np.testing.assert_allclose(data[name].values, other[name].values, rtol=0, atol=1e-8)
    assert data.thruster.values[0].tolist()[:2] == ["propeller", "propeller_rudder"]
    assert data.thruster_unit.values[0].tolist()[:2] == ["N", "rad"]
    angle = data["agent_thrust"].values[..., 1]
    assert np.abs(angle).max() <= LIMIT + 1e-12
    step = float(data.time[1] - data.time[0])
    assert 0.9 * RATE * step < np.abs(np.diff(angle, axis=0)).max() <= RATE * step * (1.0 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("heading", [0.0, 120.0])
@pytest.mark.parametrize("target", [[4, 0], [0, 4], [-4, 0]])
def test_a_target_that_is_near_is_not_left(target: list[float], heading: float) -> None:
    """Below 12 % of its speed it drifts instead of turning round: the residual is at most that over the gain."""
    time, error = errors(make_run(NAME, target, heading=heading))
    assert error[time >= 80.0].max() < 0.12 * 3.09 / 0.2
