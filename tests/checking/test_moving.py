"""Checks of a medium that moves: waves are bounded, gusts are Gaussian, and bounds hold in runs."""

from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.checking import examine_scenario
from mjsheaf.checking.theorem.targets import follow_targets
from mjsheaf.media.medium import moving_along
from mjsheaf.scenario import Scenario
from tests.builders import mixed_scenario
from tests.media.test_flow_events import pieces_of

WAVES = {"kind": "jonswap", "significant_height": 0.4, "peak_period": 4.0, "spreading": "cos2", "components": 6}
GUSTS = {"kind": "dryden", "wind_speed": 5.0, "altitude": 10.0}


def waving(**fields: Any) -> Scenario:
    """Return the mixed team on a sea, without what its vehicles meet in addition."""
    flow = {"water": {"dimension": 2, "drift": [0.1, 0.0], "waves": WAVES}}
    return mixed_scenario(**{"flow": flow, "time": {"end": 4.0}, **fields})


def test_waves_are_bounded_and_enter_omega_bar() -> None:
    record = examine_scenario(waving()).record
    third = record.assumptions[2]
    assert (third.verdict, third.holds, third.applies) == ("holds", True, True)
    assert third.value == pytest.approx(waving().system.largest_disturbance.max())
    assert (record.theorem.omega_bar or 0.0) > (third.value or 0.0) > 0.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_bounds_of_waves_are_not_exceeded_anywhere(seed: int) -> None:
    system, rng = waving(seed=seed).system, np.random.default_rng(seed)
    V, h = len(system.team.members), 1e-4
    times = np.sort(rng.uniform(0.0, 1000.0, 3000))
    places = rng.uniform([-20, -20, -3], [20, 20, -1e-3], (3000, V, 3))
    at = moving_along(system.medium, times, places)
    bounds = system.moving_bounds
    assert (np.linalg.norm(at, axis=2) <= bounds.speed + 1e-12).all()
    assert np.linalg.norm(at, axis=2).max() > 0.5 * bounds.speed.max()
    later = moving_along(system.medium, times + h, places)
    assert (np.linalg.norm(later - at, axis=2) / h <= bounds.change + 1e-3).all()
    step = rng.standard_normal((3000, V, 3))
    step *= h / np.linalg.norm(step, axis=2, keepdims=True)
    beside = moving_along(system.medium, times, places + step * [1.0, 1.0, 0.0])
    assert (np.linalg.norm(beside - at, axis=2) / h <= bounds.slope + 1e-3).all()


def test_the_path_of_targets_in_waves_lies_within_its_cells() -> None:
    system = waving(controller={"gain": 3.0, "control_period": 0.05}).system
    path = follow_targets(system)
    assert path.cells is not None
    positions = pieces_of(system, "ideal", "mujoco")["positions"][:, len(system.team.agents) :]
    for time, where in zip(system.grid.samples[:-1], positions[:-1], strict=True):
        k = int(np.searchsorted(path.cells.end, time + 1e-12))
        share = (time - path.cells.begin[k]) / (path.cells.end[k] - path.cells.begin[k])
        on_segment = path.cells.centre[k] + (2.0 * share - 1.0) * path.cells.half[k]
        assert (np.linalg.norm(where - on_segment, axis=1) <= path.cells.bend[k] + 1e-5).all()


def test_the_third_assumption_does_not_apply_under_gusts_and_does_not_count() -> None:
    flow = {"air": {"dimension": 3, "gusts": GUSTS}}
    gusty = mixed_scenario(flow=flow)
    still = mixed_scenario(flow={"air": {"dimension": 3}})
    record, without = examine_scenario(gusty).record, examine_scenario(still).record
    third = record.assumptions[2]
    assert (third.verdict, third.holds, third.applies) == ("does not apply", None, False)
    assert "front, back, diver" in third.witness
    assert record.ok == without.ok
    assert not record.theorem.applies
    assert record.theorem.omega_bar is None
    assert mjsheaf.check(gusty)["assumptions"][2]["holds"] is None
    assert record.law.radius is None
    assert "gusts" in record.law.reason


def test_gusts_do_not_excuse_a_broken_topology() -> None:
    flow = {"air": {"dimension": 3, "gusts": GUSTS}}
    blind = mixed_scenario(flow=flow, sensing=[["boat", "ship"]], communication=[["front", "back"]], formations=[])
    assert not examine_scenario(blind).record.ok
