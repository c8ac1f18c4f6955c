"""Flow out of files: against the analytic double gyre, at its bounds, and beyond its edges."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mjsheaf
from mjsheaf.errors import InputError, UnstableError
from mjsheaf.media.gridded import _cell
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, list_members
from tests.media import double_gyre
from tests.media.test_flow_events import pieces_of

ORIGIN = [double_gyre.LATITUDE, double_gyre.LONGITUDE]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flow") / "gyre.nc"
    double_gyre.write(path, 20, 41, 400.0)
    return path


def in_flow(path: Path, *, start: Any = (30.0, 40.0), **fields: Any) -> Scenario:
    water = {"kind": "gridded", "path": str(path), "origin": ORIGIN, **fields.pop("water", {})}
    usual = {"time": {"end": 40.0}, "controller": {"gain": 0.5, "control_period": 0.5}, "flow": {"water": water}}
    return build_scenario({"A": [50, 60]}, {"buoy": list(start)}, [["A", "buoy"]], **usual | fields)


def test_the_flow_of_a_file_is_the_analytic_one_with_an_error_of_second_order(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0.0, 200.0, 400), rng.uniform(0.0, 100.0, 400), np.zeros(400)])
    times = np.sort(rng.uniform(0.0, 400.0, 400))
    exact = np.column_stack([*double_gyre.velocity(points[:, 0], points[:, 1], times), np.zeros(400)])
    errors = []
    for k in range(3):
        path = tmp_path / f"{k}.nc"
        double_gyre.write(path, 10 * 2**k, 20 * 2**k + 1, 400.0)
        found = mjsheaf.medium(in_flow(path)).velocity("buoy", times, points)
        errors.append(np.sqrt(np.mean((found - exact) ** 2)))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)
    assert errors[2] < 1e-3


@pytest.mark.parametrize("backend", ["ideal", pytest.param("physics", marks=pytest.mark.slow)])
def test_a_free_buoy_drifts_along_the_analytic_flow(file: Path, backend: str) -> None:
    scenario = in_flow(file, time={"end": 20.0}, vehicles={"tau": 0.05}, physics={"timestep": 0.02, "contacts": False})
    positions = pieces_of(scenario.phases, backend, "mujoco")["positions"][:, 1, :2]
    exact = solve_ivp(lambda t, x: double_gyre.velocity(x[0], x[1], t), (0.0, 20.0), [30.0, 40.0], rtol=1e-9)
    assert positions[-1] == pytest.approx(exact.y[:, -1], abs=0.05)


def test_bounds_are_attained_at_nodes_and_not_exceeded_between(file: Path) -> None:
    scenario = in_flow(file)
    bounds, rng, h = scenario.system.moving_bounds, np.random.default_rng(1), 1e-5
    probe = mjsheaf.medium(scenario)
    times = np.sort(rng.uniform(0.0, 399.0, 20_000))
    points = rng.uniform([1.0, 1.0, 0.0], [199.0, 99.0, 0.0], (20_000, 3))
    at = probe.velocity("buoy", times, points)
    assert np.linalg.norm(at, axis=1).max() <= bounds.speed[1]
    assert np.linalg.norm(at, axis=1).max() > 0.97 * bounds.speed[1]
    turn = rng.uniform(0.0, 2.0 * np.pi, 20_000)
    beside = probe.velocity("buoy", times, points + h * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn]))
    slopes = np.linalg.norm(beside - at, axis=1) / h
    assert slopes.max() <= bounds.slope[1] + 1e-6
    assert slopes.max() > 0.9 * bounds.slope[1]
    changes = np.linalg.norm(probe.velocity("buoy", times + h, points) - at, axis=1) / h
    assert changes.max() <= bounds.change[1] + 1e-6
    assert bounds.speed[0] == bounds.speed[1]


def test_every_node_of_an_axis_is_in_a_cell() -> None:
    axis = np.array([0.0, 1.0, 3.0, 7.0])
    for x in axis:
        k = _cell(axis, x)
        assert axis[k] <= x <= axis[k + 1]


def test_places_and_times_beyond_the_file_are_refused_with_the_numbers(file: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"flow: current: path: buoy begins .* left the file .*x from 0 to 200 m"):
        in_flow(file, start=(250.0, 40.0))
    with pytest.raises(InputError, match=r"covers 0 to 400 s .* expected 0 to 500 s"):
        in_flow(file, time={"end": 500.0})
    with pytest.raises(InputError, match=r"covers -100 to 300 s"):
        in_flow(file, water={"start": "2026-05-01T00:01:40Z"}, time={"end": 350.0})
    with pytest.raises(InputError, match=r"buoy: it left the file of the flow at \(300, 40\) m"):
        mjsheaf.medium(in_flow(file)).velocity("buoy", [1.0], [300.0, 40.0, 0.0])
    with pytest.raises(InputError, match="there is no file"):
        in_flow(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("no netCDF")
    with pytest.raises(InputError, match="no netCDF file"):
        in_flow(tmp_path / "text.nc")


@pytest.mark.parametrize("backend", ["ideal", pytest.param("physics", marks=pytest.mark.slow)])
def test_a_vehicle_that_meets_land_runs_aground(tmp_path: Path, backend: str) -> None:
    path = tmp_path / "land.nc"
    double_gyre.write(path, 40, 41, 400.0, land=True)
    motion = {"kind": "waypoints", "points": [[140, 50]], "speed": 4.0}
    buoy, agent = list_members({"buoy": [60, 50]}, motion=motion), list_members({"A": [50, 20]})
    scenario = in_flow(path, targets=buoy, agents=agent)
    aground = pytest.raises(UnstableError, match=r"buoy.*ran aground at \(")
    with mjsheaf.Session(scenario, backend) as session, aground:
        while not session.finished:
            session.step()


def test_an_event_cannot_name_a_file(file: Path) -> None:
    water = {"kind": "gridded", "path": str(file), "origin": ORIGIN}
    with pytest.raises(InputError, match="an event cannot name a file"):
        in_flow(file, flow={"water": {"dimension": 2}}, events=[{"time": 1.0, "set": {"flow.water": water}}])
