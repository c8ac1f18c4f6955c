"""The public interface, in Python alone: no file is written or named.

Oracle: the ways to one run against each other.
"""

import json
from pathlib import Path

import numpy as np
import pytest

import mjsheaf
from tests.commands import python

FIELDS = {
    "time": {"end": 0.5},
    "controller": {"gain": 2.0, "control_period": 0.01},
    "agents": [{"id": "boat", "position": (0, 0)}, {"id": "drone", "position": (1, 0, 4)}],
    "targets": [{"id": "buoy", "position": np.array([3.0, 4.0])}, {"id": "kite", "position": [3.0, 0.0, 9.0]}],
    "communication": [("boat", "drone")],
    "sensing": [("boat", "buoy"), ("drone", "kite")],
}


def test_every_name_is_there() -> None:
    assert set(dir(mjsheaf)) == set(mjsheaf.__all__)
    assert all(getattr(mjsheaf, name) is not None for name in mjsheaf.__all__)
    with pytest.raises(AttributeError, match="simulat"):
        mjsheaf.simulat  # noqa: B018


IMPORTING = """
import importlib, pkgutil, sys, mjsheaf, mjsheaf.envs
public = {(package, name): getattr(package, name) for package in (mjsheaf, mjsheaf.envs) for name in package.__all__}
for module in pkgutil.walk_packages(mjsheaf.__path__, "mjsheaf."):
    if module.name.rpartition(".")[2] != "__main__":
        importlib.import_module(module.name)
changed = [name for (package, name), kept in public.items() if getattr(package, name) is not kept]
modules = [name for (_, name), kept in public.items() if type(kept) is type(sys) and name != "envs"]
print(changed, modules)
"""


@pytest.mark.long
def test_no_public_name_is_that_of_a_module() -> None:
    """Python replaces a function of a package by a module of the same name as soon as somebody imports that.

    So public functions worked once, before what they import.
    """
    assert python(IMPORTING).stdout == "[] []\n"


def test_all_that_a_scenario_is_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    scenario = mjsheaf.load_scenario(FIELDS, {"vehicles.tau": 0.05})
    assert isinstance(scenario, mjsheaf.Scenario)
    for backend in ("ideal", "physics"):
        run = mjsheaf.simulate(scenario, backend)
        assert run.attrs["status"] == "finished"
        assert len(mjsheaf.simulate_many([scenario], backend)) == 1
    mjsheaf.World(scenario).step(10)
    record = json.loads(json.dumps(mjsheaf.check(scenario, trial=False)))
    assert record["ok"] is True
    assert mjsheaf.load_vehicle("hull").dimension == 2
    assert list(tmp_path.iterdir()) == []
