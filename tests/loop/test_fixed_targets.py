"""Targets that are fixed, adrift or static in a flow. Oracles: they stay, or go as far as the water does."""

from typing import Any

import numpy as np
import pytest

from mjsheaf import check, simulate
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.slips import drifts_of, slips_of
from mjsheaf.vehicles.effects import authority_of
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from tests.builders import POWERED, build_scenario, list_members
from tests.strategies import long

MOVING: dict[str, Any] = {
    "water": {
        "dimension": 2,
        "drift": [1.0, 0.2],
        "waves": {"kind": "jonswap", "significant_height": 0.3, "peak_period": 4, "direction": 30},
    },
    "air": {"dimension": 3, "drift": [2, 0, 0], "gusts": {"kind": "dryden", "wind_speed": 4, "altitude": 12}},
}
STEADY: dict[str, Any] = {"water": {"dimension": 2, "drift": [3.5, 0.0]}}
SWIRL: dict[str, Any] = {"water": {"dimension": 2, "vortices": [{"centre": [10, 0], "gamma": 20}], "core": 1}}


def team(motion: dict[str, Any] | None, flow: dict[str, Any], **fields: Any) -> Scenario:
    """A boat and a drone, each with a target."""
    boat, drone = {"vehicle": "wamv"}, {"vehicle": "x500"}
    own = {} if motion is None else {"motion": motion}
    return build_scenario(
        {"B": {"position": [0, 0], **boat}, "D": {"position": [0, 0, 9], **drone}},
        {"S": {"position": [4, 1], **boat, **own}, "U": {"position": [3, 1, 12], **drone, **own}},
        [["B", "S"], ["D", "U"]],
        **{"time": {"end": 20}, "controller": {"gain": 0.5}, "flow": flow} | fields,
    )


def excursion(scenario: Scenario, **options: Any) -> np.ndarray:
    """Return how far each target gets from where it begins, m."""
    path = np.nan_to_num(simulate(scenario, **options)["target_position"].values)
    return np.asarray(np.linalg.norm(path - path[0], axis=2).max(axis=0))


@pytest.mark.parametrize("period", [0.1, 0])
def test_a_fixed_target_does_not_move_on_ideal_kinematics(period: float) -> None:
    """Not by a bit, in current, waves, wind, gusts and disturbance, also where another target would pull it along."""
    fields: dict[str, Any] = {
        "disturbance": {"targets": {"bound": 0.2}},
        "controller": {"gain": 0.5, "control_period": period},
    }
    fields |= {"target_formation": {"gain": 1.0}, "target_edges": [["S", "U"]]}
    if period == 0:
        fields["controller"]["record_period"] = 0.5
    flow = MOVING if period else STEADY
    assert (excursion(team({"kind": "fixed"}, flow, **fields), backend="ideal") == 0.0).all()


@pytest.mark.parametrize("engine", [long("fused"), "mujoco"])
def test_a_fixed_body_holds_its_place_in_a_current(engine: str) -> None:
    """A boat in 1 m/s and waves, a drone in 2 m/s and gusts: adrift they go 20 and 40 m."""
    assert (excursion(team({"kind": "fixed"}, MOVING), engine=engine) < 0.5).all()


@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_adrift_is_static_and_no_motion(backend: str) -> None:
    """The three are one, to the bit."""
    runs = [
        simulate(team(motion, MOVING), backend=backend) for motion in ({"kind": "static"}, {"kind": "adrift"}, None)
    ]
    for run in runs[1:]:
        for name in ("target_position", "agent_position"):
            np.testing.assert_array_equal(run[name].values, runs[0][name].values)


def test_agents_reach_a_fixed_target_and_theory_knows_that_it_rests() -> None:
    """q* rests, so f_B and the disturbance that targets carry to q* are those of the agents alone."""
    scenario = team({"kind": "fixed"}, {"agents": {"dimension": 2}, "targets": {"dimension": 2, "drift": [1.0, 0.0]}})
    record = check(scenario, trial=False)
    assert record["theorem"]["f_bar"] == 0.0
    adrift = team({"kind": "adrift"}, {"targets": {"dimension": 2, "drift": [1.0, 0.0]}})
    assert check(adrift, trial=False)["theorem"]["f_bar"] > 0.9
    result = simulate(scenario, backend="ideal")
    np.testing.assert_allclose(result["agent_position"].values[-1, 0, :2], [4.0, 1.0], atol=1e-3)


def test_a_fixed_target_stays_when_agents_are_lost_and_join() -> None:
    """Events change who holds a position; the fixed targets always do."""
    events = [
        {"time": 5, "lose": "D"},
        {"time": 10, "set": {"flow.water.drift": [0.5, 1.0]}},
        {"time": 15, "join": "C"},
    ]
    agents = list_members({"B": [0, 0], "C": [9, 9], "D": [0, 0, 9]})
    sensing = [["B", "S"], ["C", "S"], ["D", "U"]]
    scenario = team({"kind": "fixed"}, STEADY, events=events, agents=agents, sensing=sensing)
    assert (excursion(scenario, backend="ideal") == 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("flow", [STEADY, SWIRL])
def test_a_static_target_in_a_flow_is_noted_with_how_far_it_drifts(flow: dict[str, Any]) -> None:
    scenario = team({"kind": "static"}, flow)
    path = simulate(scenario, backend="ideal")["target_position"].values[:, 0, :2]
    far = drifts_of(scenario)
    assert far == {"S": pytest.approx(np.linalg.norm(path[-1] - path[0]), rel=1e-3)}
    (slip,) = slips_of(scenario)
    for word in ("S away", f"{far['S']:.3g} m", "fixed", "adrift"):
        assert word in slip
    assert slip in check(scenario, trial=False)["notes"]


@pytest.mark.parametrize(
    ("motion", "flow"),
    [
        ({"kind": "static"}, {}),
        ({"kind": "static", "pull": 1}, STEADY),
        ({"kind": "adrift"}, STEADY),
        ({"kind": "fixed"}, STEADY),
        (None, STEADY),
        ({"kind": "static"}, {"agents": {"dimension": 2, "drift": [1, 0]}}),
    ],
)
def test_other_targets_are_not_noted(motion: dict[str, Any] | None, flow: dict[str, Any]) -> None:
    assert slips_of(team(motion, flow)) == []


def test_drifts_follow_events() -> None:
    scenario = team(None, STEADY, events=[{"time": 10, "set": {"flow.water.drift": [0.0, 0.0]}}])
    assert drifts_of(scenario) == {"S": pytest.approx(35.0)}


def test_an_obstacle_cannot_be_adrift() -> None:
    obstacle = {"kind": "sphere", "centre": [50, 50, 0], "radius": 1}
    for kind, right in (("fixed", True), ("static", True), ("adrift", False)):
        safety = {"distance": 1, "range": 5, "obstacles": [{**obstacle, "motion": {"kind": kind}}]}
        if right:
            team(None, {}, safety=safety)
        else:
            with pytest.raises(InputError, match="no flow carries an obstacle"):
                team(None, {}, safety=safety)


# -- the buoy, a vehicle without thrusters -----------------------------------------------------------------------------


WATER = {"water": {"dimension": 2, "drift": [0.3, -0.2]}}


def watched(target: dict[str, Any], **fields: Any) -> Scenario:
    """A boat that watches a buoy."""
    boat, buoy = {"position": [0.0, 0.0], "vehicle": "otter"}, {"position": [5.0, 3.0], "vehicle": "buoy"}
    usual: dict[str, Any] = {"time": {"end": 30}, "physics": {"timestep": 0.01}}
    return build_scenario({"A": boat}, {"B": buoy | target}, [["A", "B"]], **usual | fields)


@pytest.mark.parametrize("engine", ["fused", "mujoco"])
def test_it_moves_with_the_water_and_stays_upright(engine: str) -> None:
    data = simulate(watched({}, flow=WATER), engine=engine)
    np.testing.assert_allclose(data["target_velocity"].values[-1, 0], [0.3, -0.2, 0.0], atol=2e-3)
    assert abs(data["target_height"].values[-1, 0]) < 1e-6
    assert data["target_orientation"].values[-1, 0, 0] == pytest.approx(1.0, abs=1e-9)
    assert np.isfinite(data["agent_position"].values[..., :2]).all()


def test_it_cannot_be_an_agent() -> None:
    scenario = watched({}, agents=list_members({"A": [0.0, 0.0]}, vehicle="buoy"))
    with pytest.raises(InputError, match=r"agents\.A\.vehicle: 'buoy' has no thrusters and cannot be an agent"):
        simulate(scenario)


@pytest.mark.parametrize(
    ("motion", "what"),
    [
        ({"kind": "fixed"}, "stay where it is"),
        ({"kind": "waypoints", "points": [[1, 2]], "speed": 1}, "follow a path"),
        ({"kind": "lissajous", "amplitude": [1, 1], "rate": [0.1, 0.1], "phase": [0, 0]}, "follow a path"),
    ],
)
def test_it_goes_nowhere_by_itself(motion: dict[str, Any], what: str) -> None:
    with pytest.raises(InputError, match=rf"targets\.B\.vehicle: 'buoy' has no thrusters and cannot {what}"):
        simulate(watched({"motion": motion}))


def test_what_it_is() -> None:
    """It floats where its draft carries it, 1025 pi (.35 m)^2 .152 m = 60 kg, and is small."""
    buoy = load_vehicle("buoy")
    assert 1025 * np.pi * 0.35**2 * 0.152 == pytest.approx(buoy.mass, rel=1e-2)
    assert buoy.description.hydrostatics is not None
    assert buoy.description.hydrostatics.heave == pytest.approx(1025 * 9.81 * np.pi * 0.35**2, rel=1e-2)
    assert 1.0 < buoy.size < 2.0
    assert authority_of(buoy).describe() == "not at all"
    assert set(list_vehicles()) == {*POWERED, "buoy"}
