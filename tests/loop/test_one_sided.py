"""Vehicles whose thrusters do not push both ways: what they can make, how they go about, and what is said of them.

tests/data/skiff.yaml has two propellers that cannot reverse, airboat.yaml one fan that steers, otter_rudder one
propeller with a rudder. Oracles: linear programs and bounded least squares; pencil and paper.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

from mjsheaf import check, simulate
from mjsheaf.comparing.variants import ladder_of, run_ablation
from mjsheaf.loop.bodies import pack_fleet
from mjsheaf.results.ending import ending_of_motion, find_stuck
from mjsheaf.runs.diagnostics import notes_of_run
from mjsheaf.scenario import Scenario
from mjsheaf.vehicles.actuators import Thruster
from mjsheaf.vehicles.allocation import allocate_nearest
from mjsheaf.vehicles.effects import Effects, authority_of, embody, is_one_sided, may_lack, turning_of
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from mjsheaf.vehicles.steering import Full
from mjsheaf.vehicles.vehicle import Vehicle
from tests.builders import DATA, Array, pursuit
from tests.commands import call
from tests.strategies import tried

SKIFF, AIRBOAT = DATA / "skiff.yaml", DATA / "airboat.yaml"
RUDDER = Path("otter_rudder")  # a name in models/
BOATS = [SKIFF, AIRBOAT, RUDDER]


def make_run(boat: Path | str, target: Any, *, heading: float = 0.0, end: float = 90.0, **fields: Any) -> Scenario:
    """One boat and one target, with the gain and velocity limit of the case that deadlocked."""
    usual: dict[str, Any] = {
        "time": {"end": end},
        "controller": {"gain": 0.2, "velocity_limit": 2},
        "target_motion": {"kind": "static", "pull": 1},
        "physics": {"timestep": 0.01},
    }
    return pursuit([0.0, 0.0], target, {"vehicle": str(boat), "heading": heading}, **usual | fields)


def errors(scenario: Scenario, engine: str = "fused") -> tuple[Array, Array]:
    """Times, s, and tracking errors, m."""
    data = simulate(scenario, engine=engine)
    return data["time"].values, data["tracking_error"].values[:, 0]


# -- allocation --------------------------------------------------------------------------------------------------------


def with_thrusters(places: list[tuple[float, float, float, float, float]]) -> Vehicle:
    """The skiff with other thrusters: x, y, angle in degrees, lowest and highest thrust; it pushes in the plane."""
    actuators = []
    for k, (x, y, degrees, low, high) in enumerate(places):
        c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
        actuators.append(Thruster(f"t{k}", np.array([c, s, 0, 0, 0, x * s - y * c]), ctrl=(low, high)))
    return replace(load_vehicle(str(SKIFF)), steering=Full(), actuators=actuators)


def allocate(vehicle: Vehicle, wanted: Array) -> Array:
    """Efforts for surge, sway and yaw (3,)."""
    fleet = pack_fleet([vehicle], np.zeros(1), 0.01)
    effort = np.empty(len(vehicle.channels))
    norms = tuple(fleet.kinds[0]["row_norm"].tolist())
    allocate_nearest(fleet.thrusters, norms, (float(wanted[0]), float(wanted[1]), 0.0), float(wanted[2]), effort)
    return effort


grid = st.integers(-6, 6).map(lambda n: 0.25 * n)
placed = st.tuples(
    grid,
    grid,
    st.integers(0, 23).map(lambda n: 15.0 * n),
    st.sampled_from([0.0, 0.0, -5.0, -40.0, -100.0]),
    st.sampled_from([50.0, 100.0, 250.0]),
)
sets = st.lists(placed, min_size=2, max_size=8)
shares = st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8)
wrenches = st.tuples(*[st.floats(-500.0, 500.0) | st.floats(-1e5, 1e5)] * 3).map(np.array)


@pytest.mark.slow(first=True)
@settings(max_examples=tried(300, 60))
@given(places=sets, wanted=wrenches)
@example([(0, 0, 0, 0, 50)] * 3 + [(0, 0, 120, -100, 50), (0, 0, 180, 0, 50)], [0, -89, 0])
@example(
    [(0, 0, 120, -100, 50), (0.5, 0, 105, -5, 100), (0, 0, 330, -40, 250)], [-136.38953330538675, 0, 111.483804707]
)
@example([(0.75, 0, 315, -40, 50), (0.25, 0, 345, -40, 50)], [9933.94953415934, -5317.754612164397, 0])
@example(  # lever arms that are almost the same
    [(1.1, 0.28, 126.76, 0, 250), (1.24, 0.26, 126.76, 0, 50), (1.16, 0.2, 126.76, 0, 100), (1.27, 0.34, 299, 0, 100)],
    [-184.5, -168.5, 39.6],
)
def test_efforts_are_within_limits_and_make_the_nearest_wrench(places: Any, wanted: Array) -> None:
    vehicle = with_thrusters(places)
    W, (low, high) = vehicle.W[[0, 1, 5]], vehicle.effort_bounds.T
    effort = allocate(vehicle, wanted)
    assert (effort >= low).all()
    assert (effort <= high).all()
    made = W @ effort
    reach = np.minimum(W[2] * low, W[2] * high).sum(), np.maximum(W[2] * low, W[2] * high).sum()
    norm = np.linalg.norm(W, axis=1)
    scale = np.divide(1.0, norm, out=np.zeros(3), where=norm > 1e-9)
    weight = scale * [1.0, 1.0, 1e5**0.5]  # of the program
    wish = np.array([*wanted[:2], np.clip(wanted[2], *reach)])
    exact: dict[str, Any] = {"bounds": (low, high), "method": "bvls", "tol": 1e-14, "max_iter": 500}
    nearest = W @ lsq_linear(weight[:, None] * W, weight * wish, **exact).x
    assert (np.abs(made - nearest) <= 1e-8 * (np.abs(W) @ np.maximum(-low, high)) + 1e-9).all()
    weight = scale * [1.0, 1.0, 1e4]  # a yaw moment that gives way by 1e-4 of what the force lacks at most
    missed = scale * (W @ lsq_linear(weight[:, None] * W, weight * wish, **exact).x - wish)
    assert scale[2] * abs(made[2] - wish[2]) <= np.hypot(*missed[:2]) / 300 + 1e-6


@pytest.mark.slow(each=True)
@settings(max_examples=tried(300, 60))
@given(places=sets, share=shares)
@example(  # corners, with all thrusters at a limit, where the dual function is flat for a long way
    places=[
        (0.75, -1.5, 240.0, -5.0, 50.0),
        (1.0, 0.25, 105.0, -5.0, 100.0),
        (1.25, -0.5, 210.0, -40.0, 100.0),
        (1.25, -1.0, 270.0, -100.0, 100.0),
    ],
    share=[1.0, 1.0, 0.0, 1.0],
)
@example(
    places=[
        (0.0, 0.0, 30.0, 0.0, 50.0),
        (-1.0, 0.0, 345.0, 0.0, 50.0),
        (-1.5, -0.25, 15.0, 0.0, 50.0),
        (-1.5, 1.25, 120.0, 0.0, 50.0),
    ],
    share=[0.0, 0.0, 1.0, 0.0],
)
@example(
    places=[*[(0.0, 0.0, 0.0, 0.0, 50.0)] * 6, (0.0, 1.5, 150.0, 0.0, 50.0), (-0.75, -0.5, 75.0, 0.0, 250.0)],
    share=[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
)
@example(
    places=[
        (1.25, -1.0, 75.0, 0.0, 100.0),
        (-0.25, 1.5, 270.0, -5.0, 100.0),
        (0.25, 0.25, 30.0, 0.0, 50.0),
        (1.5, -0.25, 255.0, -5.0, 100.0),
        (1.25, -1.25, 240.0, 0.0, 50.0),
        (1.25, -1.0, 225.0, 0.0, 50.0),
        (-1.0, -0.75, 90.0, -100.0, 100.0),
        (0.0, -0.5, 120.0, -5.0, 100.0),
    ],
    share=[1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0],
)
@example(  # of a ship
    places=[
        (-1.0, -0.75, 60.0, -1e7, 1e7),
        (0.25, -1.0, 180.0, -5e5, 2.5e7),
        (1.0, -1.5, 60.0, -4e6, 5e6),
        (1.25, 1.0, 270.0, -5e5, 2.5e7),
    ],
    share=[0.0, 0.3072632702312723, 0.3072632702312723, 1.0],
)
@example(  # sway of a millinewton
    places=[(0.25, -0.5, 150.0, 0.0, 0.001), (-0.75, -0.25, 0.0, 0.0, 100.0)],
    share=[0.27, 0.61],
)
def test_a_wrench_that_is_feasible_is_made(places: Any, share: list[float]) -> None:
    vehicle = with_thrusters(places)
    W, (low, high) = vehicle.W[[0, 1, 5]], vehicle.effort_bounds.T
    wanted = W @ (low + np.array(share[: len(low)]) * (high - low))
    effort = allocate(vehicle, wanted)
    size = np.abs(W) @ np.maximum(-low, high)
    assert (np.abs(W @ effort - wanted) <= 1e-8 * size + 1e-9).all()


@pytest.mark.parametrize("wanted", [(0, 100), (0, -100), (-50, 30), (500, 0), (500, 200), (20, 300)])
def test_a_fan_pushes_within_its_sector(wanted: tuple[float, float]) -> None:
    vehicle = load_vehicle(str(AIRBOAT))
    ahead, port = allocate(vehicle, np.array([wanted[0], 0, wanted[1]]))
    assert np.hypot(ahead, port) <= 400 * (1 + 1e-12)
    assert abs(port) <= np.tan(np.deg2rad(40)) * ahead + 1e-9
    assert -1.6 * port == pytest.approx(wanted[1], abs=0.02)


def test_symmetric_vehicles_do_not_take_the_branch() -> None:
    """So that their runs keep their bits."""
    for name in set(list_vehicles()) - {str(RUDDER)}:
        vehicle = load_vehicle(name)
        assert not is_one_sided(vehicle)
        kind = pack_fleet([vehicle], np.zeros(1), 0.01).kinds[0]
        assert not kind["one_sided"]
        assert not kind["forward_only"]
        if vehicle.actuators:
            assert not authority_of(vehicle).lacking
    assert not is_one_sided(embody(load_vehicle(str(SKIFF)), Effects(limits=False)))


# -- directions --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("boat", BOATS)
def test_which_ways_they_push(boat: Path) -> None:
    vehicle = load_vehicle(str(boat))
    found = authority_of(vehicle)
    assert may_lack(vehicle)
    assert found.lacking == ("astern", "turn to port", "turn to starboard")
    assert found.describe() == "ahead only, turns under way"
    assert found.forward_only
    assert found.turns_under_way


def test_what_turning_takes() -> None:
    """The skiff: 1 N at an arm of .5 m. The airboat: 1 / tan 40 N ahead for 1 N aside, at an arm of 1.6 m."""
    skiff, airboat = (turning_of(load_vehicle(str(boat))) for boat in (SKIFF, AIRBOAT))
    assert skiff is not None
    assert airboat is not None
    assert skiff.price == pytest.approx(2.0, rel=1e-6)
    assert airboat.price == pytest.approx(1 / np.tan(np.deg2rad(40)) / 1.6, rel=1e-2)
    assert skiff.speed == pytest.approx(0.12 * (np.sqrt(60**2 + 4 * 80 * 500) - 60) / 160, rel=1e-6)


def skiff_with(folder: Path, low: float, high: float = 250.0) -> str:
    """The skiff with other limits."""
    text = SKIFF.with_suffix(".xml").read_text().replace("0 250", f"{low:g} {high:g}")
    (folder / "skiff.xml").write_text(text)
    (folder / "skiff.yaml").write_text(SKIFF.read_text())
    return str(folder / "skiff.yaml")


@pytest.mark.parametrize(("low", "one_sided"), [(0, True), (-20, True), (-50, False), (-250, False)])
def test_a_weak_side_counts_as_none_below_a_tenth(low: float, one_sided: bool, tmp_path: Path) -> None:
    vehicle = load_vehicle(skiff_with(tmp_path, low))
    assert is_one_sided(vehicle) is one_sided
    assert bool(authority_of(vehicle).lacking) is one_sided


@given(places=sets)
def test_reach_is_as_far_as_efforts_go(places: Any) -> None:
    """Efforts make a little less along each direction, and no more."""
    vehicle = with_thrusters(places)
    W = vehicle.W[[0, 1, 5]]
    if np.linalg.matrix_rank(W) < 3:
        return
    found = authority_of(vehicle)
    bounds, cost = vehicle.effort_bounds.tolist(), np.zeros(len(vehicle.channels))
    for row, (some, other) in enumerate(found.reach):
        for sign, value in ((1.0, some), (-1.0, other)):
            along = sign * np.eye(3)[row]
            assert linprog(cost, A_eq=W, b_eq=0.99 * value * along, bounds=bounds).status == 0
            assert linprog(cost, A_eq=W, b_eq=(1.01 * value + 1e-3) * along, bounds=bounds).status == 2


# -- runs --------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("heading", [0.0, 120.0])
@pytest.mark.parametrize("target", [[30, 0], [0, 30], [0, -30], [-30, 0]])
@pytest.mark.parametrize("boat", BOATS)
def test_it_reaches_a_target_on_every_side(boat: Path, target: list[float], heading: float) -> None:
    time, error = errors(make_run(boat, target, heading=heading))
    assert error[time <= 60.0][-1] < 3.0
    assert error[-1] < 3.0
    assert error[time >= 75.0].max() < 3.0


@pytest.mark.parametrize("drift", [[0.3, 0.0], [-0.2, 0.2]])
@pytest.mark.parametrize("boat", BOATS)
def test_it_turns_into_a_current(boat: Path, drift: list[float]) -> None:
    """It stays downstream by |w| / k, and there it lies to the current."""
    flow = {"agents": {"dimension": 2, "drift": drift}}
    time, error = errors(make_run(boat, [-20.0, 10.0], end=120.0, flow=flow))
    assert np.abs(error[time >= 100.0] - np.linalg.norm(drift) / 0.2).max() < 3.0


def test_a_weak_astern_is_no_worse_than_none(tmp_path: Path) -> None:
    _, error = errors(make_run(skiff_with(tmp_path, -50.0), [0.0, 30.0], end=60.0))
    assert error[-1] < 3.0


def test_thrusters_that_rest_are_at_no_limit() -> None:
    data = simulate(make_run(SKIFF, [20.0, 0.0], end=80.0), engine="fused")
    assert data["agent_saturation"].values[-1, 0] == 0.0


# -- what is said ------------------------------------------------------------------------------------------------------


def notes(scenario: Scenario, data: xr.Dataset) -> dict[str, Any]:
    """Notes of a run by kind."""
    found = notes_of_run(scenario.phases, data, ending_of_motion(scenario.phases, data), [], None)
    return {note.kind: note for note in found}


def test_a_run_that_arrives_is_settled() -> None:
    scenario = make_run(SKIFF, [0.0, 30.0])
    data = simulate(scenario, engine="fused")
    assert ending_of_motion(scenario.phases, data) == "settled"
    assert not find_stuck(scenario.phases, data)
    said = notes(scenario, data)
    assert "stuck" not in said
    assert said["saturated"].text.startswith("thrusters of A are at a limit for ")


def test_a_boat_that_drifts_beside_its_target_is_stuck() -> None:
    """Its target is abeam by 1.2 m, so the command is .24 m/s; it turns round for .26 m/s or more."""
    scenario = make_run(SKIFF, [0.0, 1.2], end=30.0)
    data = simulate(scenario, engine="fused")
    (stuck,) = find_stuck(scenario.phases, data)
    assert stuck.error == pytest.approx(1.2, rel=0.05)
    assert stuck.asked == pytest.approx(0.24, rel=0.05)
    assert stuck.duration > 20.0
    assert ending_of_motion(scenario.phases, data) == "not settled"
    said = notes(scenario, data)
    assert said["stuck"].agent == "A"
    assert "cannot push astern" in said["stuck"].text
    assert "saturated" not in said
    assert "the law commands too much" not in " ".join(note.text for note in said.values())


def test_a_comparison_does_not_call_a_stuck_boat_settled() -> None:
    scenario = make_run(SKIFF, [0.0, 1.2], end=30.0)
    (given,) = [variant for variant in ladder_of(scenario.phases) if variant.kind == "all"]
    run = run_ablation(scenario.phases, [given])["all"]
    assert run.ending() == "not settled"
    assert run.record(run).settling_time_s is None


def test_one_sided_thrusters_are_named() -> None:
    """A run in which nothing moves though 2 m/s are asked: the boat as it was before it learned to turn."""
    scenario = make_run(SKIFF, [0.0, 30.0], end=20.0)
    data = simulate(scenario, engine="fused").copy(deep=True)
    data["agent_velocity"].values[:] = 0.0
    (stuck,) = find_stuck(scenario.phases, data)
    assert stuck.duration == pytest.approx(20.0)
    assert "one-sided" in stuck.reason


def test_an_agent_that_is_lost_is_not_stuck() -> None:
    scenario = make_run("otter", [300.0, 0.0], end=20.0, events=[{"time": 4, "lose": "A"}], targets=[
        {"id": "T", "position": [300.0, 0.0]}], agents=[
            {"id": "A", "position": [0.0, 0.0], "vehicle": "otter"},
            {"id": "B", "position": [0.0, 9.0], "vehicle": "otter"}], sensing=[["A", "T"], ["B", "T"]])  # fmt: skip
    assert not find_stuck(scenario.phases, simulate(scenario, engine="fused"))


def test_check_names_them() -> None:
    record = check(make_run(SKIFF, [0.0, 30.0]), trial=False)
    (named,) = record["margins"]["one_sided"]
    assert named["agents"] == ["A"]
    assert named["vehicle"] == "skiff"
    assert "astern" in named["lacking"]
    assert "turns round" in named["meaning"]
    assert record["margins"]["bodies"]["reason"].startswith("A has no linear model at rest")


def test_a_table_names_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("list", "--vehicles", SKIFF) == 0
    out = capsys.readouterr().out
    assert "ahead only" in out
    assert "both ways" in out
