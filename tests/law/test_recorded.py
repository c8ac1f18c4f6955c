"""Targets that follow recorded positions, from a table in the scenario or a CSV file; their curve stays on the track.

Oracles: scipy's cubic spline through the same points; a motion whose formula is known, which the spline approaches with
the fourth power of the time between samples; straight tracks, which no curve may leave by more than the noise.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

import mjsheaf
from mjsheaf.arrays import Array
from mjsheaf.errors import MjsheafError
from mjsheaf.law.paths import (
    MAX_DEVIATION,
    Recorded,
    Waypoints,
    add_reference,
    fit_curve,
    pack_motions,
    reference_bounds,
)
from mjsheaf.scenario.slips import slips_of
from tests.builders import make_fields

LAW = {"gain": 2, "control_period": 0.02}
SCENARIO = make_fields({"A1": [0, 0]}, {"T1": [2, 0]}, [["A1", "T1"]], time={"end": 4}, controller=LAW)


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


@pytest.mark.slow(first=True)
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


def off_track(t: Array, places: Array) -> Array:
    path = fit_curve(t, places).path
    at = np.linspace(t[0], t[-1], 2001)
    lines = np.column_stack([np.interp(at, t, column) for column in places.T])
    return np.asarray(np.linalg.norm(path(at) - lines, axis=1))


@given(st.integers(4, 40), st.integers(0, 10**6), st.sampled_from([1e-4, 1.0, 1e4]))
@settings(max_examples=60, deadline=None)
def test_even_samples_keep_their_spline_whatever_they_are(count: int, seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 0.1 * (count - 1), count)
    steps = scale * rng.normal(size=(count, 3)) * 2.0 ** rng.integers(-20, 1, (count, 1))
    curve = fit_curve(t, np.cumsum(steps, axis=0))
    assert curve.note == ""
    spline = CubicSpline(t, np.cumsum(steps, axis=0))
    at = rng.uniform(t[0], t[-1], 50)
    np.testing.assert_allclose(curve.path(at), spline(at), atol=1e-9 * scale)


def test_no_even_samples_reach_the_limit() -> None:
    """The deviation is linear in the chords: its supremum is a sum of absolute weights."""
    largest = 0.0
    for count in (4, 5, 6, 10, 30):
        t = np.arange(float(count))
        unit = np.tri(count, count - 1, -1)  # a step in each chord
        path = CubicSpline(t, unit)
        for k in range(count - 1):
            share = np.linspace(0.0, 1.0, 21)[:, None]
            weights = np.abs(path(k + share[:, 0]) - (1.0 - share) * unit[k] - share * unit[k + 1])
            largest = max(largest, float((weights @ 2.0 ** np.abs(np.arange(count - 1) - k)).max()))
    assert 1.9 < largest < MAX_DEVIATION


@pytest.mark.parametrize("late", [1e-6, 5e-5, 1e-3])
def test_bursts_are_thinned(late: float) -> None:
    """Pairs of messages arrive together, 1 cm apart: the track is straight, and the target stays on it."""
    t = np.arange(0.0, 10.01, 0.1)
    t[5::5] = t[4:-1:5] + late
    rng = np.random.default_rng(1)
    places = np.column_stack([0.5 * t, 0 * t, 10 + 0 * t]) + rng.uniform(-0.01, 0.01, (len(t), 3))
    assert np.abs(CubicSpline(t, places)(np.linspace(0, t[-1], 5000))[:, 1]).max() > 0.3
    curve = fit_curve(t, places)
    at = np.linspace(0.0, t[-1], 5000)
    assert np.abs(curve.path(at) - np.column_stack([0.5 * at, 0 * at, 10 + 0 * at])).max() < 0.06
    assert "its spline is up to" in curve.note
    assert f"20 of {len(t)} samples" in curve.note
    motion = pack_motions([Recorded(samples=np.column_stack([t, places]).tolist())], np.zeros((1, 3)), 0.0, [3], t[-1])
    speed, _ = reference_bounds(motion)
    assert speed[0] < 2.0  # of the curve that is followed, not of 1 cm in 50 us


@pytest.mark.parametrize("gap", [20.0, 60.0])
@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_dropout_is_crossed_without_overshoot(gap: float, speed: float) -> None:
    """A receiver with a noise of 1 m loses its fix: the spline extrapolates the noise of its speed."""
    t = np.concatenate([np.arange(0.0, 30.0), np.arange(30.0 + gap, 60.0 + gap)])
    rng = np.random.default_rng(2)
    places = np.column_stack([speed * t, 0 * t]) + rng.normal(0.0, 1.0, (len(t), 2))
    inside = (np.linspace(t[0], t[-1], 2001) > 29.0) & (np.linspace(t[0], t[-1], 2001) < 30.0 + gap)
    assert np.abs(CubicSpline(t, places)(np.linspace(29.0, 30.0 + gap, 200))[:, 1]).max() > 3.0
    assert off_track(t, places)[inside].max() < max(2.0, 0.2 * gap * speed)
    curve = fit_curve(t, places)
    assert "a gap from t = 29 to" in curve.note
    ends = curve.path(t[:-1] + 1e-9) - curve.path(t[:-1] - 1e-9)
    assert np.abs(ends).max() < 1e-6
    np.testing.assert_allclose(curve.path(t[1:-1] - 1e-7, 1), curve.path(t[1:-1] + 1e-7, 1), atol=1e-4)


@pytest.mark.parametrize("t", [[0.0, 1.0], [0.0, 1.0, 1.000001], [0.0, 1e-6, 1.0, 2.0]])
def test_few_samples_keep_their_ends(t: list[float]) -> None:
    places = np.column_stack([np.arange(float(len(t))), np.zeros(len(t))])
    path = fit_curve(np.array(t), places).path
    assert (path.x[0], path.x[-1]) == (t[0], t[-1])
    np.testing.assert_allclose(path([t[0], t[-1]]), places[[0, -1]], atol=1e-9)


def test_repeated_positions_and_a_late_start_stay_on_their_lines() -> None:
    t = np.concatenate([np.arange(0.0, 30.0, 1.0), 30.0 + 0.05 * np.arange(100)])
    places = np.column_stack([np.maximum(0.0, t - 30.0), 0.0 * t])
    places[40:44] = places[40]
    assert off_track(t, places).max() < 0.1


def test_check_and_run_say_what_differs() -> None:
    samples = [[0.0, 0, 0], [1.0, 1, 0], [1.00005, 1.01, 0.01], [2.0, 2, 0], [3.0, 3, 0], [4.0, 4, 0], [5.0, 5, 0]]
    motion = {"targets.T1.motion": {"kind": "recorded", "samples": samples}}
    (note,) = slips_of(mjsheaf.load_scenario(SCENARIO, motion))
    assert note.startswith("recorded path of T1: its spline is up to")
    assert "1 of 7 samples within 0.1 s of another left out" in note
    del samples[2]
    assert slips_of(mjsheaf.load_scenario(SCENARIO, motion)) == []
