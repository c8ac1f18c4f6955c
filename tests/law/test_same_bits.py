"""A run in pieces, in idle phases, among others on threads, or gone on with from a state has the same bits.

Oracle: the run at once.
"""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
import xarray as xr

from mjsheaf import World, simulate, simulate_many
from mjsheaf.loop.system import Phase
from mjsheaf.results.dataset import join
from mjsheaf.runs.simulate import stream
from mjsheaf.scenario import Scenario
from tests.builders import mixed_scenario
from tests.law.test_links import BURSTS, tangled
from tests.law.test_terms import ALL, MOVING
from tests.media.test_on_bodies import AIR, WATER

NOISY: dict[str, Any] = {"gain": 3.0, "control_period": 0.01, "odometry": {"noise": 1e-3, "bias": 0.1}, **ALL}
FIELDS: dict[str, Any] = {"time": {"end": 0.3}, "seed": 11}
TEAMS: dict[str, Scenario] = {
    "terms": mixed_scenario(controller=NOISY, **FIELDS),
    "links": tangled(**FIELDS),
    "media": mixed_scenario(flow={"air": AIR, "water": {"dimension": 2, "waves": WATER["waves"]}}, **FIELDS),
    "rounds": mixed_scenario(
        controller=NOISY, targets=MOVING, links={"rounds": {"delay": 0.02, "loss": BURSTS}}, **FIELDS
    ),
}
NAMES = ["terms", "links", "media", pytest.param("rounds", marks=pytest.mark.long)]


@pytest.mark.parametrize("backend", ["ideal", "physics"])
@pytest.mark.parametrize("name", NAMES)
def test_pieces_phases_and_threads_give_the_bits_of_the_run(name: str, backend: str) -> None:
    scenario = TEAMS[name]
    system, whole = scenario.system, simulate(scenario, backend)
    xr.testing.assert_identical(join(stream(system, backend, 11, samples=7)), whole)
    phases = [Phase(0, system), Phase(11, replace(system)), Phase(20, replace(system))]
    joined = join(stream(phases, backend, 11))
    np.testing.assert_array_equal(joined["phase"], np.repeat([0, 1, 2], [11, 9, 11]))
    xr.testing.assert_equal(joined.drop_vars("phase"), whole.drop_vars("phase"))
    runs = simulate_many([scenario, scenario.with_seed(12)], backend, workers=2)
    again, other = (cast(xr.Dataset, run) for run in runs)
    xr.testing.assert_identical(again, whole)
    assert np.nanmax(np.abs(other["agent_position"] - whole["agent_position"])) > 1e-6


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("steps", [0, 1, 137, 140])
def test_a_world_goes_on_from_a_state(name: str, steps: int) -> None:
    """At a sample and between; what is under way and what terms remember is in the state, and nothing else is."""
    one, other, whole = (World(TEAMS[name]) for _ in range(3))
    one.step(steps)
    state = one.get_state()
    one.step(40)
    whole.step(steps + 160)
    for world in (one, other):
        world.step(5)
        world.set_state(state)
        np.testing.assert_array_equal(world.get_state(), state)
        world.step(160)
        np.testing.assert_array_equal(world.get_state(), whole.get_state())
    one.reset()
    one.step(steps + 160)
    np.testing.assert_array_equal(one.get_state(), whole.get_state())
