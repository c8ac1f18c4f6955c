"""A lost aircraft falls and rests on the surface of the scene, on every engine; nothing else changes.

Oracles: the equilibrium of a spring, m omega^2 d = m g; the same run without a surface, bit for bit above it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import simulate
from mjsheaf.runs.diagnostics import notes_of_run
from mjsheaf.scenario import Scenario
from tests.builders import altered, build_scenario, setting

SPARE = {"position": [0, 30, 12], "vehicle": "aerial"}
DEPTH = {"ground": 9.81 / 50.0**2, "water": 9.81 / 10.0**2}


PAIR = {
    "A": {"position": [0, 0, 8], "vehicle": "hexarotor"},
    "B": {"position": [9, 0, 6], "vehicle": "hexarotor", "heading": 40},
}


def scenario(surface: str, pair: Any = PAIR, target: Sequence[float] = (0, 4, 9), **fields: Any) -> Scenario:
    """Aircraft over a surface 2 m high; all but one are lost while the law pushes them sideways."""
    usual: dict[str, Any] = {
        "time": {"end": 5.0},
        "controller": {"gain": 0.5, "control_period": 0.02},
        "events": [{"time": 1.0, "lose": id} for id in pair],
        "flow": {"air": {"dimension": 3, "drift": [1.0, 0.5, 0.0]}},
        "physics": {"timestep": 0.002},
        "scene": {"surface": surface, "height": 2.0},
    }
    agents = {**pair, "C": SPARE}
    return build_scenario(agents, {"T": list(target)}, [[id, "T"] for id in agents], **usual | fields)


def run(surface: str, engine: str, *members: Any, **fields: Any) -> xr.Dataset:
    return simulate(scenario(surface, *members, **fields), engine=engine, threads=1, allow_drift=True)


@pytest.mark.parametrize("surface", ["ground", "water"])
def test_it_rests_where_the_spring_carries_it(surface: str) -> None:
    results = [run(surface, engine, flow={}) for engine in ("mujoco", "fused")]
    np.testing.assert_allclose(results[1].agent_position, results[0].agent_position, rtol=0, atol=1e-6)
    for result in results:
        assert result.attrs["status"] == "finished"
        result = result.sel(agent=["A", "B"])
        last = result.isel(time=-1)
        np.testing.assert_allclose(2.0 - last.agent_height, DEPTH[surface], rtol=1e-3)
        moved = last.agent_position - result.agent_position.isel(time=-51)
        assert np.abs(moved).max() < 1e-3
        turned = last.agent_orientation - result.agent_orientation.isel(time=-51)
        assert np.abs(turned).max() < 1e-3


@pytest.mark.parametrize("engine", ["mujoco", "fused"])
def test_nothing_changes_above_the_surface(engine: str) -> None:
    none, ground = run("none", engine), run("ground", engine)
    above = (none.agent_height > 2.0).all("agent").values
    assert 50 < above.sum() < len(above)
    assert float(none.agent_height.min()) < -20.0
    np.testing.assert_array_equal(ground.agent_position[above], none.agent_position[above])
    moved = (ground.agent_position[-1] - ground.agent_position[-51]).sel(agent=["A", "B"], axis=["x", "y"])
    assert np.abs(moved).max() < 0.1  # in a second, in wind of 1.1 m/s


@pytest.mark.parametrize("engine", ["mujoco", "fused"])
def test_what_is_lost_below_comes_up_slowly_and_what_flies_there_is_not_touched(engine: str) -> None:
    diver = {"A": {"position": [0, 0, -20], "vehicle": "aerial"}}
    wet, dry = (run(surface, engine, diver, (0, 4, -20), events=[]) for surface in ("water", "none"))
    np.testing.assert_array_equal(wet.agent_position, dry.agent_position)
    height = run("water", engine, diver, (0, 0, -20)).agent_height.values[:, 0]
    assert height[-1] > -20.0 + 1.0
    assert np.diff(height).max() / 0.02 <= 1.0  # (3 - 1) g / (2 omega), less drag


def test_a_coarse_step_is_stable() -> None:
    result = run("ground", "fused", physics={"timestep": 0.02}, time={"end": 8.0}, flow={})
    assert result.attrs["status"] == "finished"
    np.testing.assert_allclose(2.0 - result.agent_height[-1, :2], 9.81 / 12.5**2, rtol=1e-2)


def test_only_what_flies_below_the_surface_is_noted() -> None:
    for of, said in ((scenario("ground"), 0), (scenario("ground", target=(0, 4, -9), events=[]), 1)):
        result = simulate(of, engine="fused", allow_drift=True)
        notes = [note for note in notes_of_run(of.phases, result, None, [], None, []) if note.kind == "submerged"]
        assert len(notes) == said
        assert all("in the ground" in note.text for note in notes)


@pytest.mark.parametrize("engine", ["mujoco", "fused"])
def test_an_underwater_vehicle_that_is_a_little_heavy_sinks(engine: str, tmp_path: Path) -> None:
    """Water carries most of its weight: it is no aircraft, and does not come up when it is lost."""
    heavy = altered(tmp_path, "submersible", setting(".//body", gravcomp=".98"))
    diver = {"A": {"position": [0, 0, -20], "vehicle": heavy}}
    sunk, free = (run(surface, engine, diver, (0, 0, -20)).agent_height.values[:, 0] for surface in ("water", "none"))
    np.testing.assert_array_equal(sunk, free)
    assert sunk[-1] < -20.03
