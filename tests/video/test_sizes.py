"""Vehicles are drawn large enough to be visible in the whole team, without overlapping their neighbours."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf import simulate
from mjsheaf.arrays import Array, IntArray
from mjsheaf.mujoco_import import mujoco
from mjsheaf.scenario import load_scenario
from mjsheaf.show.style import MAX_GAP_FRACTION, MIN_FRACTION, automatic_scales, round_number, run_size
from mjsheaf.vehicles.loading import SEEN_GROUPS
from mjsheaf.video.draw import Painter
from mjsheaf.video.film import both_films, film_of, half_options, video_options
from tests.commands import drawing
from tests.strategies import examples

WIDE = np.random.default_rng(0).uniform(-40, 40, (9, 12, 3)) * [1, 1, 0]


@examples(50)
@given(value=st.floats(1e-6, 1e6))
def test_round_numbers_are_near(value: float) -> None:
    up, down = round_number(value, up=True), round_number(value, up=False)
    assert down <= value * (1 + 1e-6)
    assert up >= value * (1 - 1e-6)
    assert up / down < 1.6
    assert float(f"{up:.2g}") == up


@pytest.mark.parametrize("length", [0.2, 0.5, 1.0, 6.0, 40.0])
def test_each_kind_fills_a_stated_fraction_and_is_never_shrunk(length: float) -> None:
    kinds, radii = ["drone", "boat"] * 6, np.tile([length / 2, 3.0], 6)
    scales = automatic_scales(kinds, radii, WIDE)
    assert (scales >= 1.0).all()
    drawn = 2 * radii * scales
    size = run_size(WIDE)
    assert drawn.min() >= MIN_FRACTION * size
    assert drawn[0] <= max(1.6 * MIN_FRACTION * size, length)
    assert len(set(scales[::2].tolist())) == 1


def test_a_swarm_is_not_drawn_over_itself() -> None:
    """Neighbours are 2 m apart in a team of a hundred metres."""
    x, y = np.meshgrid(2.0 * np.arange(50), 2.0 * np.arange(50))
    places = np.stack([x.ravel(), y.ravel(), np.zeros(2500)], axis=-1)[None]
    scales = automatic_scales(["drone"] * 2500, np.full(2500, 0.2), places)
    assert 1.0 < scales[0] <= MAX_GAP_FRACTION * 2.0 / 0.4


@pytest.mark.parametrize("places", [np.full((3, 4, 3), np.nan), np.zeros((3, 4, 3)), np.full((1, 4, 3), np.inf)])
def test_odd_runs_are_drawn_in_true_size(places: np.ndarray) -> None:
    np.testing.assert_array_equal(automatic_scales(["a", "a", "b", "b"], np.full(4, 0.3), places), np.ones(4))


def test_a_vehicle_that_is_lost_far_away_does_not_count() -> None:
    far = WIDE.copy()
    far[4:, 0] = [0.0, 0.0, -1e6]
    assert run_size(far) < 2.0 * run_size(WIDE)


def radii_of(model: mujoco.MjModel, body_id: IntArray) -> Array:
    """Find a radius about each vehicle's root body that holds its geoms, from body to body up to the root."""
    radii = []
    for root in body_id:
        radius = 0.05
        for g in np.flatnonzero((model.body_rootid[model.geom_bodyid] == root) & (model.geom_group < SEEN_GROUPS)):
            reach, body = model.geom_rbound[g] + np.linalg.norm(model.geom_pos[g]), model.geom_bodyid[g]
            while body != root:
                reach, body = reach + np.linalg.norm(model.body_pos[body]), model.body_parentid[body]
            radius = max(radius, float(reach))
        radii.append(radius)
    return np.array(radii)


@drawing
def test_the_smallest_vehicle_of_a_film_is_seen() -> None:
    """Drones of half a metre among boats of five. Oracle: the model that is drawn."""
    scenario = load_scenario("harbour", {"time.end": 0.02})
    film, model = film_of(scenario, simulate(scenario, backend="ideal"))
    options = video_options(scenario, width=640, height=360)
    scales = film.scales
    own = radii_of(model, film.body_id)
    np.testing.assert_allclose(own, scenario.system.vehicle_radii, rtol=1e-12)
    with Painter(film, model, options) as painter:
        drawn = radii_of(painter.model, film.body_id)
        pixel = painter.camera[0].metres_per_pixel(360)
    np.testing.assert_allclose(drawn, scales * own, rtol=1e-9)
    assert 2 * own.min() < 1.0
    assert (2 * drawn >= MIN_FRACTION * run_size(film.run.at(film.run.time[:1]).positions) * (1 - 1e-9)).all()
    assert 2 * drawn.min() / pixel > 12  # of 360


def test_both_halves_of_a_comparison_have_the_same_scales() -> None:
    scenario = load_scenario("harbour", {"time.end": 0.1})
    runs = [simulate(scenario, backend) for backend in ("ideal", "physics")]
    (left, _), (right, _) = both_films(scenario, runs[0], runs[1], half_options(scenario))
    np.testing.assert_array_equal(left.scales, right.scales)
