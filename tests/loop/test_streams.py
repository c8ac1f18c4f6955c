"""Random numbers belong to their vehicle: adding, removing, reordering or renaming others changes nothing for it.

Oracle: the same vehicle in another team, bit for bit. Each agent senses a target of its own, so that nothing but random
numbers could connect it with the others.
"""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import simulate
from tests.builders import make_fields, make_scenario

ENGINES = ("ideal", "mujoco", "fused")
PLACES = {"A": [0, 0, 5], "B": [9, -4], "C": [-8, 3, 9], "D": [4, 12]}
Fields = dict[str, Any]


def team(names: str) -> Fields:
    """Some of four pairs of an agent and its target, in this order, with everything random."""
    return make_fields(
        {name: PLACES[name] for name in names},
        {f"T{name}": [x + 2.0 for x in PLACES[name]] for name in names},
        [[name, f"T{name}"] for name in names],
        time={"end": 0.4},
        controller={"gain": 0.6, "control_period": 0.02, "drift": {"filter": 0.2}, "odometry": {"noise": 0.02}},
        links={"all": {"noise": 0.1, "loss": 0.2, "hold": 0.1}},
        spread={"position": 2.0, "heading": 30.0},
        disturbance={"agents": {"bound": 0.4, "components": 4}, "targets": {"bound": 0.3, "components": 5}},
        physics={"timestep": 0.01},
    )


def run(fields: Fields, engine: str) -> xr.Dataset:
    if engine == "ideal":
        return simulate(make_scenario(fields), backend="ideal")
    return simulate(make_scenario(fields), engine=engine, threads=1)


def renamed(fields: Fields, names: dict[str, str]) -> Fields:
    """The same team under other names."""
    new = copy.deepcopy(fields)
    for member in new["agents"] + new["targets"]:
        member["id"] = names.get(member["id"], member["id"])
    new["sensing"] = [[names.get(name, name) for name in ends] for ends in fields["sensing"]]
    return new


CHANGES: dict[str, tuple[Callable[[Fields], Fields], str]] = {
    "append": (lambda _: team("ABCD"), "ABC"),
    "remove": (lambda _: team("AC"), "AC"),
    "permute": (lambda _: team("CAB"), "ABC"),
    "rename others": (lambda fields: renamed(fields, {"B": "Z", "TB": "A0", "TC": "Y"}), "A"),
}


@pytest.mark.parametrize("engine", ENGINES)
def test_a_vehicle_s_run_depends_on_no_other_vehicle(engine: str) -> None:
    fields = team("ABC")
    usual = run(fields, engine)
    for change, (changed, names) in CHANGES.items():
        other = run(changed(fields), engine)
        for name in names:
            for variable in (name for name, values in usual.items() if {"time", "agent"} <= {*values.dims}):
                found, expected = (run[variable].sel(agent=name) for run in (other, usual))
                np.testing.assert_array_equal(found, expected, err_msg=f"{change}: {name}")
            if change != "rename others":
                found, expected = (run.target_position.sel(target=f"T{name}") for run in (other, usual))
                np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("engine", ENGINES)
def test_each_vehicle_has_random_numbers_of_its_own(engine: str) -> None:
    """Twins that differ in their names alone meet unlike disturbances, noise and initial conditions."""
    fields = team("AC")
    fields["agents"][1]["position"] = PLACES["A"]
    fields["targets"][1]["position"] = fields["targets"][0]["position"]
    found = run(fields, engine).agent_position.values
    assert np.abs(found[:, 0] - found[:, 1]).max() > 0.1


@pytest.mark.parametrize("engine", ENGINES)
def test_padding_changes_no_sum(engine: str) -> None:
    """Targets go their way to the bit whatever number of harmonics agents have."""
    fields = team("AB")
    padded = copy.deepcopy(fields)
    padded["disturbance"]["agents"]["components"] = 17
    np.testing.assert_array_equal(run(padded, engine).target_position, run(fields, engine).target_position)


def test_a_swarm_that_grows_leaves_its_first_agents_where_they_were() -> None:
    for graph in ("nearest", "random_geometric", "small_world", "k_regular"):
        swarm = {"size": 12, "about": "T", "graph": graph, "degree": 4, "scatter": 1.0}
        fields = {"targets": [{"id": "T", "position": [0, 0]}], "swarm": swarm}
        small = make_scenario(fields).system.initial[:12]
        large = make_scenario({**fields, "swarm": {**swarm, "size": 20}}).system.initial[:12]
        np.testing.assert_array_equal(small, large)
