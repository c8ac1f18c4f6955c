"""Waves: moments of the spectrum, the kinematics of Airy's waves, drift, and hulls that ride on the sea."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import mjsheaf
from mjsheaf.errors import InputError
from mjsheaf.media.medium import advance, mean_flow, new_state, surface_about
from mjsheaf.media.waves import GRAVITY, Waves, wave_numbers
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, mixed_scenario, pursuit
from tests.media.test_flow_events import pieces_of

PM = {"kind": "pierson_moskowitz", "significant_height": 1.0, "peak_period": 2.0 * np.pi}
JONSWAP = {"kind": "jonswap", "significant_height": 2.0, "peak_period": 8.0, "gamma": 3.3}


def sea(waves: dict[str, Any], **fields: Any) -> Scenario:
    flow = {"water": {"dimension": 2, "waves": waves}}
    return mixed_scenario(**{"time": {"end": 0.4}, "flow": flow, **fields})


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("components", [1, 7, 50, 300])
@pytest.mark.parametrize("kind", [PM, JONSWAP])
def test_height_and_moments_are_exact_for_any_number_of_waves(kind: dict[str, Any], components: int) -> None:
    waves = Waves.model_validate({**kind, "components": components})
    c = waves.components_of(3)
    m0, m2 = np.sum(c.amplitude**2) / 2.0, np.sum((c.amplitude * c.rate) ** 2) / 2.0
    assert 4.0 * np.sqrt(m0) == pytest.approx(waves.significant_height, rel=1e-14)
    many = Waves.model_validate({**kind, "components": 1000}).components_of(0)
    assert m2 == pytest.approx(np.sum((many.amplitude * many.rate) ** 2) / 2.0, rel=1e-12)
    peak = waves.peak_rate
    pieces = [(0.05 * peak, peak), (peak, 3.0 * peak), (3.0 * peak, 1000.0 * peak)]
    integral = sum(quad(lambda w: w**2 * waves.spectrum(np.array([w]))[0], *ends, limit=200)[0] for ends in pieces)
    assert m2 == pytest.approx(integral, rel=3e-6)
    assert len(set(c.rate)) == components


def test_periods_and_the_velocity_at_the_surface_are_those_of_pierson_and_moskowitz() -> None:
    waves = Waves.model_validate(PM)
    c = waves.components_of(0)
    m0, m2 = np.sum(c.amplitude**2) / 2.0, np.sum((c.amplitude * c.rate) ** 2) / 2.0
    assert np.sqrt(m0 / m2) == pytest.approx(0.7103706810, abs=1e-9)
    m1 = quad(lambda w: w * waves.spectrum(np.array([w]))[0], 0.1, 200.0, limit=500, points=[1.0])[0]
    assert m0 / m1 == pytest.approx(0.7717714367, abs=1e-6)
    assert np.sum(c.speed**2) / 2.0 == pytest.approx(1.9816636488 / 16.0, rel=1e-9)
    assert waves.spectrum(np.array([1.3]))[0] == pytest.approx(
        5.0 / 16.0 * 1.3**-5.0 * np.exp(-1.25 * 1.3**-4.0), rel=1e-9
    )


@pytest.mark.parametrize("depth", [0.1, 3.0, 40.0, 4000.0])
def test_wave_numbers_satisfy_the_dispersion_relation(depth: float) -> None:
    rate = np.geomspace(1e-3, 30.0, 400)
    k = wave_numbers(rate, depth)
    assert GRAVITY * k * np.tanh(k * depth) == pytest.approx(rate**2, rel=1e-13)
    assert wave_numbers(rate, None) == pytest.approx(rate**2 / GRAVITY)


@pytest.mark.parametrize("depth", [None, 4.0])
@pytest.mark.parametrize("spreading", ["none", "cos2"])
def test_velocity_and_elevation_are_airys_sums(depth: float | None, spreading: str) -> None:
    given = {**JONSWAP, "direction": 30.0, "spreading": spreading} | ({"depth": depth} if depth else {})
    scenario, rng = sea(given, seed=5), np.random.default_rng(0)
    c = Waves.model_validate(given).components_of(5)
    times = np.sort(rng.uniform(0.0, 500.0, 40))
    points = rng.uniform(-50.0, 50.0, (40, 3))
    points[:, 2] = rng.uniform(-3.9, -0.1, 40)
    theta = (points[:, :2] @ (c.number[:, None] * c.unit).T) - np.outer(times, c.rate) + c.phase
    z = points[:, 2:]
    if depth is None:
        along = upward = np.exp(c.number * z)
        surface = np.ones_like(c.number)
    else:
        along = np.cosh(c.number * (z + depth)) / np.sinh(c.number * depth)
        upward = np.sinh(c.number * (z + depth)) / np.sinh(c.number * depth)
        surface = 1.0 / np.tanh(c.number * depth)
    speed = c.amplitude * c.rate
    probe = mjsheaf.medium(scenario)
    diver = np.column_stack([(speed * along * np.cos(theta)) @ c.unit, (speed * upward * np.sin(theta)).sum(axis=1)])
    assert probe.velocity("diver", times, points) == pytest.approx(diver, abs=1e-11)
    boat = np.column_stack([(speed * surface * np.cos(theta)) @ c.unit, np.zeros(40)])
    assert probe.velocity("boat", times, points) == pytest.approx(boat, abs=1e-11)
    assert probe.surface(times, points) == pytest.approx(np.cos(theta) @ c.amplitude, abs=1e-11)
    assert not probe.velocity("front", times, abs(points)).any()
    assert not mean_flow(scenario.system.medium, scenario.team.index["diver"], 0.0, points).any()
    assert scenario.system.largest_disturbance[scenario.team.index["boat"]] == pytest.approx(np.sum(speed * surface))


def test_slopes_and_rate_of_the_surface_are_its_derivatives() -> None:
    medium = sea({**JONSWAP, "spreading": "cos2"}).system.medium
    state = new_state(medium)

    def surface(t: float, x: float, y: float) -> np.ndarray:
        advance(medium, t, 0, 1, state)
        return np.array(surface_about(medium, state, 0, x, y))

    h = 1e-4
    for t, x, y in np.random.default_rng(2).uniform(-20.0, 20.0, (5, 3)):
        at = surface(t, x, y)
        differences = (
            surface(t, x + h, y) - surface(t, x - h, y),
            surface(t, x, y + h) - surface(t, x, y - h),
            surface(t + h, x, y) - surface(t - h, x, y),
        )
        assert at[1:] == pytest.approx([d[0] / (2.0 * h) for d in differences], abs=1e-6)


def drifting(waves: dict[str, Any], depth: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return how fast a buoy and a free particle at a depth drift on ideal kinematics, shape (2,) each, m/s."""
    scenario = build_scenario(
        {"A": [0, 50]},
        {"buoy": [0, 0], "particle": [0, 0, -depth]},
        [["A", "buoy"]],
        time={"end": end},
        controller={"gain": 1e-9, "control_period": 0.1},
        flow={"water": {"dimension": 2, "waves": waves}},
    )
    positions = pieces_of(scenario.phases, "ideal", "mujoco")["positions"]
    moved = (positions[-1] - positions[0])[:, :2] / end
    return moved[1], moved[2]


@pytest.mark.long
@pytest.mark.parametrize(
    ("components", "height", "depth", "end"),
    [(1, 0.07, 2.0, 267.8), (1, 0.14, 2.0, 267.8), (8, 0.05, 1.0, 20_000.0)],  # steepness of 0.005 and 0.01; irregular
)
def test_drift_is_half_of_stokes_at_the_surface_and_stokes_below(
    components: int, height: float, depth: float, end: float
) -> None:
    """Over 60 periods of one wave; in an irregular sea it is the sum over its waves."""
    waves = {**PM, "significant_height": height, "components": components, "direction": 90.0}
    c = Waves.model_validate(waves).components_of(0)
    buoy, particle = drifting(waves, depth, end)
    stokes = c.amplitude**2 * c.rate * c.number
    assert buoy[1] == pytest.approx(0.5 * stokes.sum(), rel=0.02)
    assert particle[1] == pytest.approx((stokes * np.exp(-2.0 * depth * c.number)).sum(), rel=0.02)
    assert abs(buoy[0]) < 1e-12


@pytest.mark.long
@pytest.mark.parametrize("engine", ["mujoco", "fused"])
def test_a_hull_heaves_rolls_and_pitches_with_a_long_wave(engine: str) -> None:
    waves = {**PM, "significant_height": 1.0, "peak_period": 12.0, "components": 1, "direction": 90.0}
    scenario = pursuit(
        [0, 0],
        [5, 0],
        {"vehicle": "otter", "heading": 0},
        time={"end": 30.0},
        controller={"gain": 0.5, "control_period": 0.1},
        flow={"water": {"dimension": 2, "waves": waves}},
        physics={"timestep": 0.01, "contacts": False},
    )
    log = pieces_of(scenario.phases, "physics", engine)
    late = slice(100, None)
    times, where = scenario.system.grid.samples[late], log["origin"][late, 0]
    probe = mjsheaf.medium(scenario)
    height = probe.surface(times, where)
    assert where[:, 2] == pytest.approx(height, abs=0.03)
    w, x, y, z = log["quaternions"][late, 0].T
    normal = np.column_stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x)])
    slopes = [(probe.surface(times, where + d) - probe.surface(times, where - d)) / 0.02 for d in 0.01 * np.eye(3)[:2]]
    trim = [normal[:, 0].mean(), 0.0]  # of the thrust, which is below the origin
    assert normal - trim == pytest.approx(-np.column_stack(slopes), abs=0.02)
    assert np.ptp(slopes[1]) > 0.03


def test_waves_belong_to_the_water_and_a_gamma_to_jonswap() -> None:
    with pytest.raises(InputError, match=r"flow.*air\.waves: only water has waves"):
        mixed_scenario(flow={"air": {"dimension": 3, "waves": PM}})
    with pytest.raises(InputError, match="gamma"):
        sea({**PM, "gamma": 2.0})


def test_spread_waves_come_from_both_sides_of_their_direction() -> None:
    """Of the density 2 cos^2 x / pi the mean is 0, and the variance pi^2 / 12 - 1 / 2."""
    unit = Waves.model_validate({**PM, "spreading": "cos2", "components": 1000}).components_of(0).unit
    angle = np.arctan2(unit[:, 1], unit[:, 0])
    assert angle.mean() == pytest.approx(0.0, abs=0.06)
    assert angle.var() == pytest.approx(np.pi**2 / 12.0 - 0.5, rel=0.1)


def test_the_sea_has_a_seed_of_its_own_or_the_scenarios() -> None:
    times, place = np.arange(50.0), [1.0, 2.0, 0.0]

    def surface(seed: int) -> np.ndarray:
        return mjsheaf.medium(sea(PM, seed=seed)).surface(times, place)

    assert not np.allclose(surface(1), surface(2))
    assert np.array_equal(mjsheaf.medium(sea({**PM, "seed": 2}, seed=1)).surface(times, place), surface(2))
