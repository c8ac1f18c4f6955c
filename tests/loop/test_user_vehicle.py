"""A vehicle that a user adds: an MJCF file and a short description, no code.

tests/data/raft.xml and raft.yaml are the example of the README. Oracles: what a pencil makes of their numbers; the
ideal backend; the errors that wrong files must give.
"""

import json
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
import yaml

from mjsheaf import load_scenario, simulate
from mjsheaf.cli.main import main
from mjsheaf.errors import InputError
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.steering import Full
from tests.builders import RAFT, Edit, alone, altered, ask, body, find, refused

SCENARIO = {
    "name": "rafts",
    "time": {"end": 40.0},
    "controller": {"gain": 0.4, "control_period": 0.05},
    "agents": [{"id": "one", "position": [-3, 1], "heading": 30}, {"id": "two", "position": [-1, -3]}],
    "targets": [
        {
            "id": "buoy",
            "position": [0, 0],
            "motion": {"kind": "waypoints", "points": [[16, 8]], "speed": 0.3, "pull": 1.0},
        }
    ],
    "communication": [["one", "two"]],
    "sensing": [["one", "buoy"], ["two", "buoy"]],
    "formations": [{"name": "pair", "shape": "line", "members": ["one", "two"], "about": "buoy", "spacing": 3.0}],
    "flow": {"agents": {"dimension": 2, "drift": [0.2, -0.1]}},
    "physics": {"timestep": 0.005},
    "vehicles": {"agents": "boats/raft.yaml"},
}


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """A scenario file with the raft's two files in a folder next to it."""
    (tmp_path / "boats").mkdir()
    for file in (RAFT, RAFT.with_suffix(".xml")):
        shutil.copy(file, tmp_path / "boats")
    path = tmp_path / "rafts.yaml"
    path.write_text(yaml.safe_dump(SCENARIO))
    return path


def test_the_example_is_as_short_as_the_readme_says() -> None:
    assert len(RAFT.read_text().splitlines()) <= 8
    assert len(RAFT.with_suffix(".xml").read_text().splitlines()) <= 30


def test_a_raft_is_what_its_files_say() -> None:
    """60 kg; thrusters in X at arms of .707 m; tau = (M + l D) / (M k_v + D) = (70 + .1 60) / (70 + 60) s."""
    raft = load_vehicle(str(RAFT))
    assert (raft.mass, raft.dimension, raft.steering, raft.weight) == (60.0, 2, Full(), 60.0 * 9.81)
    c = np.sqrt(0.5)
    np.testing.assert_allclose(raft.W[0], [c, c, c, c], atol=1e-12)
    np.testing.assert_allclose(raft.W[1], [-c, c, c, -c], atol=1e-12)
    np.testing.assert_allclose(raft.W[5], [-2 * 0.5 * c, 2 * 0.5 * c, -2 * 0.5 * c, 2 * 0.5 * c], atol=1e-12)
    np.testing.assert_allclose(raft.reduced_model().tau, 76 / 130, rtol=1e-12)
    np.testing.assert_array_equal(raft.limits, [[-40, 40]] * 4)
    assert raft.thrusters == ["bow_port", "bow_starboard", "stern_port", "stern_starboard"]


def test_a_raft_goes_where_it_is_told_to_through_the_current() -> None:
    world = alone(str(RAFT), heading=30, drift=[0.2, -0.1])
    _, _, dof, _ = body(world)
    ask(world, [-0.3, 0.4])
    world.step(15_000)
    np.testing.assert_allclose(world.data.qvel[dof], [-0.1, 0.3, 0, 0, 0, 0], atol=1e-5)


@pytest.mark.slow
@pytest.mark.usefixtures("without_plots")
def test_a_scenario_may_name_a_vehicle_by_its_path(scenario: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`mjsheaf run` in the files' folder or elsewhere: rafts keep the formation about as well as points would."""
    out = scenario.parent / "out"
    with pytest.raises(SystemExit) as stopped:
        main(["run", str(scenario), "--no-video", "--out", str(out)])
    assert not stopped.value.code, capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "finished"
    with xr.open_dataset(out / "result.nc") as run:
        assert float(np.abs(run.agent_height).max()) < 0.05
        assert float(run.agent_saturation[-200:].max()) == 0.0
    ideal = simulate(load_scenario(str(scenario)), backend="ideal")
    assert summary["final"]["tracking_error"] < 1.1 * float(np.sqrt((ideal.tracking_error[-1] ** 2).mean())) + 0.05
    assert summary["final"]["formation_error"] < 0.1


# -- what is refused ---------------------------------------------------------------------------------------------------


def weak(root: ElementTree.Element) -> None:
    find(root, ".//default[@class='thruster']/general").set("ctrlrange", "0 3")


def aft_only(root: ElementTree.Element) -> None:
    """As on an Otter: two thrusters along x."""
    actuators = find(root, "actuator")
    for actuator in list(actuators):
        if "bow" in actuator.get("name", ""):
            actuators.remove(actuator)
    for site in root.iter("site"):
        if site.get("name"):
            site.set("zaxis", "1 0 0")


def parallel(root: ElementTree.Element) -> None:
    for site in root.iter("site"):
        if site.get("name"):
            site.set("zaxis", "0 0 1")


def still_yaw(name: str) -> dict[str, Any]:
    drag = load_vehicle(name).description.drag.model_dump(exclude_none=True)
    return {"drag": {**drag, "angular": [*drag["angular"][:2], 0.0]}}


@pytest.mark.parametrize(
    ("name", "edit", "description", "named"),
    [
        (
            "hexarotor",
            weak,
            {},
            ("hexarotor.xml", "weight", 3.776),
        ),
        ("quadrotor", weak, {}, ("quadrotor.xml", "weight", "0 to 3")),
        ("otter", None, "yaw", ("otter.yaml", "drag.angular", "yaw")),
        (
            "otter",
            None,
            {"steering": None},
            ("sway", "Assumption 2", "steering"),
        ),
        ("wamv", aft_only, {}, ("sway", "steering")),
        ("quadrotor", None, {"steering": None}, ("Assumption 2", "steering")),
        ("hexarotor", parallel, {}, ("Assumption 2", "steering")),
        ("otter", None, {"steering": {"largest_tilt": 30}}, ("otter.yaml", "steering", "hand_point")),
        ("quadrotor", None, {"steering": {"hand_point": 1}}, ("quadrotor.yaml", "steering", "largest_tilt")),
        ("otter", None, {"steering": {}}, ("otter.yaml", "steering", "hand_point", "largest_tilt")),
        (
            "quadrotor",
            None,
            {"steering": {"largest_tilt": 90}},
            ("steering.largest_tilt",),
        ),
        ("wamv", None, {"added_mass": [1, 2, 3]}, ("added_mass", 6)),
        (
            "wamv",
            None,
            {"added_mass": [1, 2, 3, 4, 5, -6]},
            ("added_mass.5",),
        ),
        ("wamv", None, {"autopilot": {"rate": 0}}, ("autopilot.rate", 0)),
        ("wamv", None, {"attitude": None}, ("wamv.yaml", "attitude")),
    ],
)
def test_descriptions_that_cannot_work_are_refused(
    name: str, edit: Edit | None, description: Any, named: tuple[str, ...], tmp_path: Path
) -> None:
    path = altered(tmp_path, name, edit, **(still_yaw(name) if description == "yaw" else description))
    with refused(InputError, *named):
        load_vehicle(path)


def test_a_wrong_vehicle_is_one_line_on_stderr(scenario: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, and the line names the scenario's field, the vehicle's file, and what is wrong."""
    raft = scenario.parent / "boats" / "raft.yaml"
    raft.write_text(raft.read_text().replace("attitude:", "altitude:"))
    with pytest.raises(SystemExit) as stopped:
        main(["run", str(scenario), "--no-video", "--out", str(scenario.parent / "out")])
    assert stopped.value.code == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for part in ("rafts.yaml", "raft.yaml", "altitude"):
        assert part in error
