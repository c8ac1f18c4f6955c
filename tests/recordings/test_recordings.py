"""Targets that follow positions out of logs and netCDF.

Oracle: a run of mjsheaf, exported and read back, to the bit; the same rows written into the scenario.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.errors import MjsheafError
from mjsheaf.export.log import require_installed
from mjsheaf.recordings import read_positions
from mjsheaf.results.store import send, write_dataset
from tests.builders import make_fields

WAY = {"kind": "waypoints", "points": [[4, 1, 5]], "speed": 1}
SCENARIO = make_fields(
    {"A1": [0, 0, 4]},
    {"T1": {"position": [2, 0, 3], "motion": WAY}, "T2": [1, 1]},
    [["A1", "T1"]],
    time={"end": 1},
    controller={"gain": 2, "control_period": 0.02},
)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """The same run as MCAP, as a bag, and as result.nc; and the rows of T1."""
    folder = tmp_path_factory.mktemp("logs")
    scenario = mjsheaf.load_scenario(SCENARIO)
    run = mjsheaf.simulate(scenario, backend="ideal")
    (folder / "scenario.yaml").write_text("")
    (folder / "bag").mkdir()
    for name, path in (("mcap", folder / "run.mcap"), ("ros2", folder / "bag")):
        (kind,) = require_installed([name])
        send([run], kind(path, scenario, scenario.phases, folder / "scenario.yaml"))
    write_dataset([run], folder / "result.nc")
    return folder, np.column_stack([run["time"].values, run["target_position"].values[:, 0]])


FILES = [
    ("run.mcap", {"topic": "/tf", "frame": "T1"}),
    ("bag", {"topic": "/tf", "frame": "T1"}),
    ("bag/run_ros2.mcap", {"topic": "/tf", "frame": "T1"}),
    ("result.nc", {"topic": "T1"}),
]


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(("name", "selection"), FILES)
def test_a_target_follows_a_log_as_it_follows_its_rows(
    name: str, selection: dict[str, Any], logs: tuple[Path, np.ndarray]
) -> None:
    """And is read back to the bit."""
    folder, rows = logs
    runs = []
    read = read_positions(str(folder / name), **selection)
    assert np.array_equal(np.array(read)[:, 1:], rows[:, 1:])
    np.testing.assert_allclose(np.array(read)[:, 0], rows[:, 0], atol=1e-9)  # logs have nanoseconds
    for source in ({"path": name, **selection}, {"samples": read}):
        moving = {**SCENARIO["targets"][0], "motion": {"kind": "recorded", **source}}
        (folder / "s.yaml").write_text(json.dumps({**SCENARIO, "targets": [moving]}))
        scenario = mjsheaf.load_scenario(folder / "s.yaml")
        assert scenario.model_dump(exclude_none=True)["targets"][0]["motion"]["samples"] == read
        runs.append(mjsheaf.simulate(scenario, backend="ideal"))
    assert runs[0].identical(runs[1])
    np.testing.assert_allclose(runs[0]["target_position"].values[:, 0], rows[:, 1:], atol=0.02)  # a period's way
    assert mjsheaf.check(scenario, trial=False)["ok"]


def test_a_log_ends_with_the_run_whatever_the_rounding_of_its_last_time() -> None:
    rows = [[0.0, 0.0, 0.0], [0.35, 1.0, 0.0], [0.7, 1.0, 1.0]]
    motion = {"kind": "recorded", "samples": rows, "pull": 0.0}
    times = {"targets.T1.motion": motion, "time.end": 0.7, "targets.T1.position": [0, 0], "agents.A1.position": [0, 0]}
    scenario = mjsheaf.load_scenario(SCENARIO, times)
    assert float(scenario.system.grid.span(35, 36)[0]) > 0.7
    assert np.isfinite(mjsheaf.simulate(scenario, backend="ideal")["target_position"].values[:, 0, :2]).all()
    with pytest.raises(MjsheafError, match=r"targets\.T1\.motion: samples cover 0 to 0\.69 s"):
        mjsheaf.load_scenario(
            SCENARIO, {**times, "targets.T1.motion": {**motion, "samples": [*rows[:2], [0.69, 1, 1]]}}
        )


@pytest.mark.parametrize(
    ("name", "selection", "message"),
    [
        ("run.mcap", {}, "topic: missing; expected /commands, /errors, /scene, /tf, /vehicles"),
        ("run.mcap", {"topic": "/tg"}, "topic: there is no '/tg'; expected"),
        ("run.mcap", {"topic": "/tf"}, "frame: missing; /tf has several; expected A1, T1, T2"),
        ("run.mcap", {"topic": "/tf", "frame": "T3"}, "frame: /tf has no position of 'T3'; expected A1, T1, T2"),
        ("run.mcap", {"topic": "/errors"}, "topic: messages of type Errors have no position"),
        ("bag", {"topic": "/scene"}, "topic: messages of type visualization_msgs/msg/MarkerArray have no position"),
        ("result.nc", {}, "topic: None is no agent or target of this run; expected A1, T1, T2"),
        ("result.nc", {"topic": "T1", "frame": "T1"}, "frame: this kind of file has none"),
        ("absent.mcap", {"topic": "/tf"}, "No such file"),
        ("absent.nc", {}, "No such file"),
        ("broken.mcap", {"topic": "/tf"}, "cannot be read"),
        ("broken.nc", {}, "cannot be read"),
        ("cut.mcap", {"topic": "/tf", "frame": "T1"}, "cannot be read"),
        ("empty", {}, "Is a directory"),
    ],
)
def test_mistakes_name_the_file_and_what_it_has(
    name: str, selection: dict[str, Any], message: str, logs: tuple[Path, np.ndarray]
) -> None:
    folder, _ = logs
    (folder / "empty").mkdir(exist_ok=True)
    (folder / "broken.mcap").write_bytes(b"no log")
    (folder / "broken.nc").write_bytes(b"no data")
    whole = (folder / "run.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    motion = {"kind": "recorded", "path": str(folder / name), **selection}
    with pytest.raises(MjsheafError, match=rf"targets\S*motion: .*{name}: {message}"):
        mjsheaf.load_scenario(SCENARIO, {"targets.T1.motion": motion})


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ({}, "expected either samples or path"),
        ({"samples": [[0, 0, 0], [1, 0, 0]], "topic": "/tf"}, "topic and frame select from the file"),
        ({"path": 3}, "path: "),
        ({"kind": ["recorded"], "path": "a.mcap"}, "kind"),
    ],
)
def test_fields_that_do_not_fit_are_refused(motion: dict[str, Any], message: str) -> None:
    with pytest.raises(MjsheafError, match=message):
        mjsheaf.load_scenario(SCENARIO, {"targets.T1.motion": {"kind": "recorded", **motion}})


@pytest.mark.parametrize(
    "motion", [{"kind": "file", "path": "../run.csv"}, {"kind": "recorded", "path": "../run.mcap", "topic": "/tf"}]
)
def test_the_file_of_a_motion_lies_next_to_the_scenario(motion: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "run.csv").write_text("0,0,0\n5,1,1\n")
    moving = {**SCENARIO["targets"][0], "motion": motion}
    (tmp_path / "in" / "s.yaml").write_text(json.dumps({**SCENARIO, "targets": [moving]}))
    with pytest.raises(MjsheafError, match="lies outside"):
        mjsheaf.load_scenario(tmp_path / "in" / "s.yaml")
