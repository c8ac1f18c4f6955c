"""Outlines of obstacles in figures. Oracle: signed distances of points along the line of sight."""

import numpy as np
import pytest
from matplotlib.patches import Polygon

from mjsheaf import load_scenario, plot, simulate
from mjsheaf.law.obstacles import centres, distances
from mjsheaf.loop.system import System
from mjsheaf.show.solids import outline
from tests.builders import OBSTACLES

_WALLS = [*OBSTACLES, {"id": "wall", "kind": "half_space", "point": [0.0, 9.0, 0.0], "normal": [0.0, -1.0, 0.0]}]


@pytest.fixture(scope="module")
def system() -> System:
    return load_scenario("swap", {"safety.obstacles": _WALLS, "time.end": 1}).system


@pytest.mark.parametrize("seed", range(4))
def test_lines_of_sight_through_corners_touch_the_obstacle(system: System, seed: int) -> None:
    """Through each corner the line of sight comes as near as 0; pushed out from the middle, it misses the body."""
    frame = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0].T
    obstacles, time = system.obstacles, np.array([0.7])
    assert obstacles is not None
    middles = centres(obstacles, 0.7)
    depth = np.linspace(-8.0, 8.0, 4001)[:, None] * frame[2]
    for n in range(3):
        corners = outline(obstacles, n, middles[n], frame[:2])
        assert corners is not None
        middle = frame[:2] @ middles[n]
        for factor, low, high in ((1.0, -1e-9, 3e-3), (1.05, 1e-3, 1.0)):
            lines = (middle + factor * (corners[::9] - middle)) @ frame[:2] + frame[2] * (frame[2] @ middles[n])
            nearest = [distances(obstacles, time, (line + depth)[None])[0, :, n].min() for line in lines]
            assert low <= min(nearest)
            assert max(nearest) <= high
    assert outline(obstacles, 3, middles[3], frame[:2]) is None


@pytest.mark.slow
def test_figures_show_obstacles(system: System) -> None:
    """Seen from above: three bodies, the first place of the one that moves, and the wall behind y = 9 m."""
    scenario = load_scenario("swap", {"safety.obstacles": _WALLS, "time.end": 1})
    figure = plot(simulate(scenario, "ideal"))["trajectories"]
    above = figure.axes[0]
    shapes = [patch for patch in above.get_children() if isinstance(patch, Polygon)]
    assert len(shapes) == 5
    assert min(shapes[-1].get_xy()[:, 1]) == pytest.approx(9.0)
    keys = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert "obstacle" in keys


@pytest.mark.slow
def test_a_view_shows_whole_obstacles_unless_they_are_far() -> None:
    quays = [{"kind": "box", "centre": [0.0, y, 5.0], "sides": [30.0, 4.0, 2.0]} for y in (20.0, 900.0)]
    scenario = load_scenario("swap", {"safety.obstacles": quays, "time.end": 1})
    above = plot(simulate(scenario, "ideal"))["trajectories"].axes[0]
    near, _ = (patch.get_xy() for patch in above.get_children() if isinstance(patch, Polygon))
    (left, right), (bottom, top) = above.get_xlim(), above.get_ylim()
    assert left < near[:, 0].min() < near[:, 0].max() < right
    assert bottom < near[:, 1].min() < near[:, 1].max() < top < 100.0
