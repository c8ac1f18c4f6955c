"""The sea that a video shows is the one that boats meet."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.media.waves import pack_waves, wave_surface
from mjsheaf.scenario import Scenario
from mjsheaf.show.played import seas_of
from mjsheaf.video.camera import View
from mjsheaf.video.draw import Painter
from mjsheaf.video.film import film_of, video_options
from mjsheaf.video.scene import POINTS, mesh
from tests.builders import boat_and_drone

WAVES = {"kind": "jonswap", "significant_height": 0.8, "peak_period": 4.0, "direction": 25, "spreading": "cos2"}


def afloat(**water: Any) -> Scenario:
    scene = {"surface": "water", "height": 1.5}
    video = {"width": 320, "height": 240, "elevation": -15}
    return boat_and_drone(1.0, flow={"water": {"dimension": 2, **water}}, scene=scene, video=video)


def test_the_drawn_surface_is_what_boats_meet() -> None:
    """On a grid fine enough for all waves, elevation and slopes are those of the compiled sea."""
    (sea,) = seas_of(afloat(waves=WAVES).phases)
    x, y = np.linspace(-3.0, 3.0, 301), np.linspace(40.0, 44.0, 201)
    drawn = sea.surface(x, y, 7.25)
    packed = pack_waves(sea.waves, np.array([1]), sea.level)
    for i, j in ((0, 0), (85, 200), (300, 92)):
        boat = wave_surface(packed, packed.new_state(), 7.25, 0, x[i], y[j])
        np.testing.assert_allclose(drawn[:, i, j], boat[:3], atol=1e-4)


def test_the_mesh_lies_about_the_level_and_reaches_the_horizon() -> None:
    (sea,) = seas_of(afloat(waves=WAVES).phases)
    view = View(np.array([2.0, -1.0, 1.5]), 30.0, 90.0, -15.0, 45.0)
    points, rgba = mesh(sea, view, 3.0)
    assert points.shape == (POINTS, POINTS, 3)
    assert ((rgba >= 0.0) & (rgba <= 1.0)).all()
    middle = points[POINTS // 2, POINTS // 2]
    np.testing.assert_allclose(middle[:2], view.lookat[:2])
    assert abs(points[..., 2] - 1.5).max() <= sea.waves.amplitude.sum()
    assert points[POINTS // 4 : -POINTS // 4, POINTS // 4 : -POINTS // 4, 2].std() > 0.05
    # No wave is drawn that the grid is too coarse for.
    np.testing.assert_allclose(points[0, :, 2], 1.5, atol=1e-3)


def test_water_without_waves_has_no_sea() -> None:
    assert seas_of(afloat(drift=[0.1, 0.0]).phases) == []


@pytest.mark.long
def test_frames_show_a_sea_that_moves() -> None:
    scenario = afloat(waves=WAVES)
    data = simulate(scenario, backend="ideal")
    film, model = film_of(scenario, data)
    options = video_options(scenario)
    changed = {}
    for name, seas in (("sea", film.seas), ("level", ())):
        with Painter(replace(film, seas=seas), model, options) as painter:
            near = slice(options.panel, options.panel + 80)
            first, last = (np.array(painter.draw(k)())[120:, near].astype(int) for k in (0, len(painter.times) - 1))
        changed[name] = np.abs(last - first).mean()
    assert changed["sea"] > 2.0 * changed["level"] + 1.0
