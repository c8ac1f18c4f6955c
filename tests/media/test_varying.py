"""Tides, ramps and moving vortices against their formulas and bounds."""

from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.errors import InputError
from mjsheaf.media.medium import moving_along
from mjsheaf.scenario import Scenario
from tests.builders import mixed_scenario

TIDE = {"amplitude": 0.8, "minor": 0.2, "period": 50.0, "direction": 30.0, "phase": 20.0}
RAMP = {"velocity": [0.5, -0.3], "start": 2.0, "end": 6.0}
VORTEX = {"centre": [1.0, -2.0], "gamma": 1.5, "velocity": [0.4, 0.1]}
STILL = [-2.0, 1.0, 0.0]


def water(**fields: Any) -> Scenario:
    return mixed_scenario(flow={"water": {"dimension": 2, "core": 0.7, **fields}}, time={"end": 0.4})


def test_a_tide_turns_along_its_ellipse() -> None:
    times = np.linspace(0.0, 100.0, 201)
    found = mjsheaf.medium(water(tide=TIDE)).velocity("boat", times, STILL)
    phi, along = 2.0 * np.pi * times / 50.0 + np.radians(20.0), np.radians(30.0)
    major = 0.8 * np.cos(phi)[:, None] * [np.cos(along), np.sin(along)]
    minor = 0.2 * np.sin(phi)[:, None] * [-np.sin(along), np.cos(along)]
    assert found[:, :2] == pytest.approx(major + minor, abs=1e-13)
    assert np.linalg.norm(found, axis=1).max() == pytest.approx(0.8, rel=1e-3)


def test_a_ramp_rises_once() -> None:
    found = mjsheaf.medium(water(ramp=RAMP)).velocity("boat", [0.0, 2.0, 3.0, 6.0, 99.0], STILL)
    assert found[:, :2] == pytest.approx(np.outer([0.0, 0.0, 0.25, 1.0, 1.0], [0.5, -0.3]), abs=1e-15)


def test_a_moving_vortex_is_a_resting_one_whose_centre_moves() -> None:
    moving = mjsheaf.medium(water(vortices=[VORTEX]))
    for t in (0.0, 3.0, 40.0):
        there = {"centre": [1.0 + 0.4 * t, -2.0 + 0.1 * t], "gamma": 1.5}
        resting = mjsheaf.medium(water(vortices=[there]))
        place = [2.0 + 0.4 * t, 1.0, 0.0]
        assert moving.velocity("boat", [t], place) == pytest.approx(resting.velocity("boat", [t], place), abs=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("fields", [{"tide": TIDE}, {"ramp": RAMP}, {"vortices": [VORTEX]}])
def test_bounds_are_not_exceeded_and_nearly_attained(fields: dict[str, Any]) -> None:
    system, rng, h = water(**fields).system, np.random.default_rng(0), 1e-5
    V, v = len(system.team.members), system.team.index["boat"]
    times = np.sort(rng.uniform(0.0, 20.0, 30_000))
    places = rng.uniform(-6.0, 6.0, (30_000, V, 3)) + [[0.4 * t * np.eye(3)[0]] for t in times]
    at = moving_along(system.medium, times, places)
    later = moving_along(system.medium, times + h, places)
    beside = moving_along(system.medium, times, places + h * np.eye(3)[rng.integers(0, 2, 30_000)][:, None])
    seen = [np.linalg.norm(d[:, v], axis=1).max() for d in (at, (later - at) / h, (beside - at) / h)]
    bounds = system.moving_bounds
    for largest, bound in zip(seen, (bounds.speed[v], bounds.change[v], bounds.slope[v]), strict=True):
        assert 0.4 * bound <= largest <= bound * (1.0 + 1e-6) + 1e-9
    assert mjsheaf.check(water(**fields), trial=False)["assumptions"][2]["value"] == pytest.approx(bounds.speed[v])


def test_a_vortex_that_moves_needs_a_core() -> None:
    with pytest.raises(InputError, match="one that moves needs a 'core' radius above 0"):
        mixed_scenario(flow={"water": {"dimension": 2, "core": 0.0, "vortices": [VORTEX]}})
