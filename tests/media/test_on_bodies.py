"""Gusts, frozen gusts, a tide, a ramp, a moving vortex and waves, all at once on every backend, as `medium` has them.

Each is tried alone next to its formulas. A loop is compiled for each combination, for half a minute, so that there is
one of all, which begins, ends and begins again.
"""

from typing import Any

import numpy as np
import pytest

from tests.builders import mixed_scenario
from tests.media.test_flow_events import BACKENDS, assert_met, pieces_of
from tests.media.test_gusts import DRIFT, FIXED
from tests.media.test_varying import RAMP, TIDE, VORTEX
from tests.media.test_waves import JONSWAP

AIR = {"dimension": 3, "drift": DRIFT, "gusts": FIXED}
WATER: dict[str, Any] = {
    "dimension": 2,
    "core": 0.7,
    "tide": TIDE,
    "ramp": RAMP,
    "vortices": [VORTEX],
    "waves": {**JONSWAP, "spreading": "cos2"},
    "gusts": {**FIXED, "frozen": True},
}


@pytest.mark.parametrize("frozen", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_run_on_ideal_kinematics_meets_what_medium_returns(frozen: bool) -> None:
    """Gusts and waves, whose loop `open_sea` has."""
    air = {**AIR, "gusts": {**FIXED, "frozen": frozen}}
    scenario = mixed_scenario(flow={"air": air, "water": {"dimension": 2, "waves": WATER["waves"]}}, time={"end": 0.4})
    assert_met(scenario, pieces_of(scenario.phases, "ideal", "mujoco"))


@pytest.mark.long
@pytest.mark.parametrize(("backend", "engine"), BACKENDS)
def test_a_run_meets_all_that_moves_before_and_after_events(backend: str, engine: str) -> None:
    changes = [
        {"time": 0.1, "set": {"flow.water.tide.amplitude": 0.3, "flow.air.gusts.wind_speed": 3.0}},
        {"time": 0.2, "set": {"flow.water": None, "flow.air": {"dimension": 3}}},
        {"time": 0.3, "set": {"flow.water": WATER, "flow.air": AIR}},
    ]
    scenario = mixed_scenario(flow={"water": WATER, "air": AIR}, time={"end": 0.4}, events=changes)
    assert [len(phase.system.moving) for phase in scenario.phases] == [4, 4, 0, 4]
    log = pieces_of(scenario.phases, backend, engine)
    assert_met(scenario, log, "positions" if backend == "ideal" else "origin")
    assert not log["medium"][20:30].any()
    for part in (slice(0, 20), slice(30, None)):
        assert np.linalg.norm(log["medium"][part], axis=-1).all()
