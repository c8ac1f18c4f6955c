"""Targets that follow recorded positions, from a table in the scenario or a CSV file.

Oracles: scipy's cubic spline through the same points; a motion whose formula is known, which the spline approaches with
the fourth power of the time between samples.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import mjsheaf
from mjsheaf.errors import MjsheafError
from mjsheaf.files import read_yaml
from mjsheaf.law.paths import Recorded, Waypoints, add_reference, pack_motions, reference_bounds

SCENARIO: dict[str, Any] = {
    "time": {"end": 4},
    "controller": {"gain": 2, "control_period": 0.02},
    "agents": [{"id": "A1", "position": [0, 0]}],
    "targets": [{"id": "T1", "position": [2, 0]}],
    "sensing": [["A1", "T1"]],
}


def circle(step: float) -> np.ndarray:
    t = np.arange(0.0, 5.0 + step / 2, step)
    return np.column_stack([t, 2.0 * np.cos(t), 2.0 * np.sin(t)])


def test_the_reference_is_the_cubic_spline() -> None:
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.1, 1.0, 40))
    points = rng.uniform(-5, 5, (40, 3))
    motion = Recorded(samples=np.column_stack([t, points]).tolist(), pull=0.0)
    packed = pack_motions([None, motion], np.zeros((2, 3)), t[0], [3, 3], t[-1])
    spline = CubicSpline(t, points)
    speed, acceleration = reference_bounds(packed)
    for at in np.concatenate([t[:-1], rng.uniform(t[0], t[-1], 300)]):
        command = np.zeros(3)
        add_reference(packed, 1, at, np.zeros(3), command)
        np.testing.assert_allclose(command, spline(at, 1), atol=1e-9)
        assert np.linalg.norm(command) <= speed[1] * (1 + 1e-12)
        assert np.linalg.norm(spline(at, 2)) <= acceleration[1] * (1 + 1e-12)


def test_a_target_in_the_plane_takes_x_and_y() -> None:
    samples = [[0.0, 0.0, 1.0, 7.0], [1.0, 3.0, 1.0, 9.0]]
    packed = pack_motions([Recorded(samples=samples, pull=0.0)], np.zeros((1, 3)), 0.0, [2], 1.0)
    command = np.zeros(3)
    add_reference(packed, 0, 0.5, np.zeros(3), command)
    np.testing.assert_allclose(command, [3.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.slow
def test_a_run_follows_a_file_as_it_follows_the_formula(tmp_path: Path) -> None:
    formula = {"kind": "lissajous", "amplitude": [2, 2], "rate": [1, 1], "phase": [np.pi / 2, 0], "pull": 1.0}
    exact = mjsheaf.simulate(mjsheaf.load_scenario(SCENARIO, {"targets.T1.motion": formula}), backend="ideal")
    errors = []
    for step in (0.2, 0.1):
        table = circle(step)
        np.savetxt(tmp_path / "run.csv", table[:, [2, 0, 1]], delimiter=",", header="y,Time,x", comments="")
        moving = {**SCENARIO["targets"][0], "motion": {"kind": "file", "path": "run.csv"}}
        (tmp_path / "s.yaml").write_text(json.dumps({**SCENARIO, "targets": [moving]}))
        scenario = mjsheaf.load_scenario(tmp_path / "s.yaml")
        recorded = scenario.targets[0].motion
        assert isinstance(recorded, Recorded)
        np.testing.assert_allclose(np.array(recorded.samples), table)
        run = mjsheaf.simulate(scenario, backend="ideal")
        errors.append(float(np.abs((run.target_position - exact.target_position).values[..., :2]).max()))
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] > 8.0
    assert mjsheaf.check(scenario, trial=False)["ok"]


@pytest.mark.slow
def test_a_run_s_scenario_holds_the_samples(tmp_path: Path) -> None:
    scenario = mjsheaf.load_scenario(
        SCENARIO, {"targets.T1.motion": {"kind": "recorded", "samples": circle(0.5)}, "time.end": 0.1}
    )
    first = mjsheaf.simulate(scenario, backend="ideal")
    mjsheaf.save(first, tmp_path / "run", video=False)
    assert read_yaml(tmp_path / "run" / "scenario.yaml")["targets"][0]["motion"]["kind"] == "recorded"
    again = mjsheaf.simulate(mjsheaf.load_scenario(tmp_path / "run" / "scenario.yaml"), backend="ideal")
    assert first.identical(again)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,x,y\n0,1,2\n1,oops,3\n", "line 3: expected a number in each column, not '1,oops,3'"),
        ("0,1,2\n0,1,2\n", "sample 1 is of t = 0 s, after one of 0 s"),
        ("0,0,0\n3,1,1\n", "samples cover 0 to 3 s; expected all of the run, 0 to 4 s"),
        ("", "samples: "),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "run.csv").write_text(text)
    motion = {"kind": "file", "path": str(tmp_path / "run.csv")}
    with pytest.raises(MjsheafError, match=r"targets\S*: .*" + message) as caught:
        mjsheaf.load_scenario(SCENARIO, {"targets.T1.motion": motion})
    assert all("samples" in line or line == str(caught.value) for line in str(caught.value).splitlines())


@pytest.mark.parametrize("parts", [1, 4, 16])
def test_bounds_of_speed_hold_and_are_tight_where_pieces_are_cut(parts: int) -> None:
    """A quintic from rest to rest over 10 m at a mean speed of 2 m/s is fastest half way, at 15 / 8 of that."""
    moving = Waypoints(points=[[10.0, 0.0]], speed=2.0)
    motion = pack_motions([moving], np.zeros((1, 3)), 0.0, [2])
    speed, acceleration = reference_bounds(motion, parts)
    assert speed[0] >= 3.75 * (1.0 - 1e-12)
    assert acceleration[0] >= 10.0 / 3.0**0.5 * 4.0 / 10.0 * (1.0 - 1e-9)
    if parts == 16:
        assert speed[0] < 3.8
