"""Obstacles and the filter on a page. Oracles: the run's data, signed distances of each surface, rotation matrices."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mjsheaf.law.obstacles import centres, distances
from tests.builders import OBSTACLES
from tests.page.browser import missing, open_page
from tests.page.pages import Made, make_page, said_in, series_in

_WALLS = [*OBSTACLES, {"id": "ground", "kind": "half_space", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.1, 1.0]}]


@pytest.fixture(scope="module")
def swap() -> Made:
    return make_page("swap", "ideal", {"safety.obstacles": _WALLS, "time.end": 20})


def test_a_page_says_what_agents_are_kept_from(swap: Made) -> None:
    """Line ends are the other vehicle, or lie on the obstacle's surface as far away as its distance; else unknown."""
    said, found = said_in(swap.page), series_in(swap.page)
    run = swap.dataset.sel(time=said["time"], method="nearest")
    V, N = run.sizes["agent"] + run.sizes["target"], run.sizes["agent"]
    correction, cause = run["safety_correction"].values, found["cause"].astype(int)
    np.testing.assert_array_equal(cause, np.where(correction > 0.0, run["safety_cause"].values, 0))
    assert (cause > 0).any()
    assert (cause > V).any()
    assert (cause == 0).any()
    np.testing.assert_allclose(found["correction"], correction, rtol=2.0**-12, atol=1e-30)
    ends, places = found["kept_from"].reshape(len(cause), N, 3), found["position"].reshape(len(cause), V, 3)
    origin, step = np.array(said["origin"]), 4.0 * said["arrays"]["kept_from"]["step"]
    np.testing.assert_array_equal(np.isnan(ends).any(axis=2), cause == 0)
    obstacles = swap.scenario.system.control.law.safety.obstacles
    for k, i in np.argwhere(cause > 0)[::7].tolist():
        if cause[k, i] <= V:
            np.testing.assert_allclose(ends[k, i], places[k, cause[k, i] - 1], atol=step)
            continue
        both = np.stack([ends[k, i], places[k, i]])[None] + origin
        surface, away = distances(obstacles, run["time"].values[k : k + 1], both)[0, :, cause[k, i] - V - 1]
        assert abs(surface) < step
        assert np.linalg.norm(both[0, 1] - both[0, 0]) == pytest.approx(abs(away), abs=2.0 * step)


def test_solids_are_the_obstacles(swap: Made) -> None:
    """Points of each drawn solid's surface lie on the obstacle's surface, where it is at that time."""
    said, found = said_in(swap.page), series_in(swap.page)
    obstacles = swap.scenario.system.control.law.safety.obstacles
    assert [one["id"] for one in said["obstacles"]] == ["pole", "crate", "ball", "ground"]
    origin, step = np.array(said["origin"]), 4.0 * said["arrays"]["obstacle"]["step"]
    for k in (0, len(said["time"]) // 2, -1):
        t = np.array([said["time"][k]])
        middles = found["obstacle"][k].reshape(-1, 3) + origin
        np.testing.assert_allclose(middles[:3], centres(obstacles, t[0])[:3], atol=step)
        for n, one in enumerate(said["obstacles"]):
            size = np.array(one["size"])
            tips = {
                "capsule": [[0.0, 0.0, size[1] + size[0]], [size[0], 0.0, -size[1]]],
                "sphere": [[0.0, size[0], 0.0]],
                "box": [size * [1.0, 0.4, 0.3], size * [1.0, -1.0, 1.0]],
            }[one["shape"]]
            turn = Rotation.from_quat(np.roll(one["quaternion"], -1))
            surface = distances(obstacles, t, (turn.apply(tips) + middles[n])[None])[0, :, n]
            np.testing.assert_allclose(surface, 0.0, atol=step)


def test_a_page_without_filter_has_nothing_of_it() -> None:
    page = make_page("midpoint", "ideal", {"time.end": 0.1}).page
    assert said_in(page)["obstacles"] == []
    assert not {"cause", "correction", "kept_from", "obstacle"} & set(said_in(page)["arrays"])


@pytest.mark.long
@pytest.mark.skipif(bool(missing()), reason=f"no browser: {missing()}")
def test_the_browser_draws_and_names_what_restrains_an_agent(browser: Any, swap: Made, tmp_path: Path) -> None:
    """The panel of an agent names the obstacle that an agent is kept from, and hiding the lines changes the picture."""
    said, found = said_in(swap.page), series_in(swap.page)
    V, N = len(said["agents"]) + len(said["targets"]), len(said["agents"])
    k, i = np.argwhere(found["cause"].reshape(-1, N) > V)[0].tolist()
    name = said["obstacles"][int(found["cause"][k, i]) - V - 1]["id"]
    page = open_page(browser, swap.write(tmp_path / "report.html"), hash=f"#t={said['time'][k]}")
    page.evaluate("i => { window.mjsheaf.state.chosen = i; }", i)
    page.keyboard.press("n")
    page.keyboard.press("p")
    page.wait_for_timeout(600)
    assert f"the filter keeps it from {name}" in page.inner_text("#card")
    with_lines = page.locator("#scene").screenshot()
    page.evaluate("() => { window.mjsheaf.world.layers.safety = false; window.mjsheaf.world.changed(); }")
    page.wait_for_timeout(600)
    assert page.locator("#scene").screenshot() != with_lines
    assert page.failures == []
