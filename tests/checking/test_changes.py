"""Bounds while formations change, against runs and differences of q*; and what `check` says of a change."""

from typing import Any

import numpy as np
import pytest

from mjsheaf import check, load_scenario, simulate
from mjsheaf.checking.check import examine_scenario
from mjsheaf.checking.report import screen
from mjsheaf.checking.theorem.certificate import certify
from mjsheaf.checking.theorem.constants import agent_flow
from mjsheaf.checking.theorem.of_run import bounds_of_phases
from mjsheaf.loop.system import during
from mjsheaf.scenario import Scenario
from tests.loop.test_ramps import BEGIN, OVER, change, ring

VORTEX = {"centre": [4, 2, 0], "axis": [0, 0, 1], "gamma": 0.3}
FLOW = {"agents": {"dimension": 3, "core": 3, "drift": [0.1, 0, 0], "vortices": [VORTEX]}}
LAW = {"gain": 4.0, "control_period": 0.02}


def changing(events: list[dict[str, Any]], **fields: Any) -> Scenario:
    return ring(events, **{"flow": FLOW, "controller": LAW, **fields})


def test_f_bar_has_the_velocity_of_q_star() -> None:
    """Never below |f_B| by central differences of q* along the path, and close to its largest value."""
    scenario = changing([change()])
    system = during(scenario.phases, 1)
    assert system.team.ramp is not None
    path = certify(system).constants.path
    assert path.cells is not None
    found = []
    step = 1e-4
    for t in np.linspace(BEGIN + 2 * step, BEGIN + OVER - 2 * step, 57):
        places = [
            np.array([np.interp(s, path.time, x) for x in path.positions[:, -1].T])[:2] for s in (t - step, t + step)
        ]
        earlier, later = (system.team.extend(p, time=s) for p, s in zip(places, (t - step, t + step), strict=True))
        flow = agent_flow(system, 0.5 * (earlier + later)[None])[0]
        found.append(float(np.linalg.norm((later - earlier) / (2 * step) - flow)))
    bound = certify(system).constants.difference.bound
    assert max(found) <= bound * (1 + 1e-6)
    assert max(found) >= 0.98 * bound
    assert certify(during(scenario.phases, 0)).constants.difference.bound < 0.5 * bound


@pytest.mark.slow
def test_no_run_exceeds_its_bounds_through_a_change() -> None:
    scenario = changing([change()])
    data = simulate(scenario, "ideal")
    bounds = bounds_of_phases(scenario.phases, data)
    assert len(bounds) == 3
    for theorem, held in bounds:
        assert theorem.applies, theorem.reason
        assert theorem.ratio is not None
        assert 0.0 < theorem.ratio <= 1.0
        assert held.ratio is not None
        assert 0.0 < held.ratio <= 1.0
    assert bounds[1][1].settled_ratio is not None
    assert bounds[1][1].settled_ratio > 0.4


@pytest.mark.slow
@pytest.mark.parametrize(
    "terms", [{"feedforward": {"rounds": 3, "filter": 0.1}}, {"drift": {}}, {"newton": {"rounds": 2}}]
)
def test_the_bound_with_terms_holds_from_the_first_sample(terms: dict[str, Any]) -> None:
    """A change from the start of a run: feedforward knows its rate but for the first sample."""
    scenario = changing([change(time=0.0, over=0.8)], controller=LAW | terms)
    data = simulate(scenario, "ideal")
    _, held = bounds_of_phases(scenario.phases, data)[0]
    assert held.ratio is not None
    assert 0.2 < held.ratio <= 1.0
    assert held.settled_ratio is not None
    assert held.settled_ratio > 0.2


@pytest.mark.slow
def test_check_names_each_phase_and_its_speeds() -> None:
    record = check(changing([change(), change({"formations.ring.radius": 3}, time=0.8, over=None)]), trial=False)
    phases = record["phases"]
    assert [phase["events"] for phase in phases[1:]] == [
        ["ring.radius = 1.5, ring.angle = 40.0, ring.centre = [0.5, 0.2, 0.3] over 0.4 s"],
        ["ring.radius = 1.5, ring.angle = 40.0, ring.centre = [0.5, 0.2, 0.3] reached"],
        ["ring.radius = 3"],
    ]
    jumps = [phase["jump"] for phase in phases[1:]]
    np.testing.assert_allclose(jumps[:2], 0.0, atol=1e-9)
    assert jumps[2] > 2.0
    steady = [max(one["steady"] for one in phase["margins"]["speed"]) for phase in phases]
    assert steady[1] > steady[0] + 3.0  # m/s
    assert steady[2] < steady[0] + 0.5


@pytest.mark.slow
def test_a_change_from_the_start_has_no_predicted_error() -> None:
    record = check(changing([change(time=0.0)]), trial=False)
    assert record["steady"]["ideal"] is None
    assert record["steady"]["reason"] == "formations change from the start"


IDS = ["A", "B", "C", "D"]
SIDES = [[3.0, 0.0], [0.2, 3.0], [-3.0, 0.0], [0.0, -3.0]]
SWAPPED = [[-3.0, 0.3], [0.2, 3.0], [3.0, -0.3], [0.0, -3.0]]


def swapping(measures: str, time: float = 1.0) -> Scenario:
    """Two of four agents about a fixed target swap sides over 6 s."""
    change = {"time": time, "set": {"formations.four.displacements": SWAPPED}, "over": 6.0}
    formation = {"name": "four", "shape": "explicit", "members": IDS, "displacements": SIDES}
    pairs = [[i, j] for k, i in enumerate(IDS) for j in IDS[k + 1 :]]
    return load_scenario(
        {
            "time": {"end": 8.0},
            "controller": {"gain": 1.0, "control_period": 0.05, "velocity_limit": 3},
            "agents": [{"id": id, "position": place} for id, place in zip(IDS, SIDES, strict=True)],
            "targets": [{"id": "T", "position": [0, 0], "motion": {"kind": "fixed"}}],
            "communication": [{"between": pair, "measures": measures} for pair in pairs],
            "sensing": [["A", "T"], ["B", "T"]],
            "formations": [formation],
            "events": [change],
        }
        | ({"safety": {"distance": 1.0, "rate": 1.0, "range": 20}} if time else {})
    )


@pytest.mark.slow
@pytest.mark.parametrize("measures", ["position", "range"])
def test_places_that_come_too_close_on_the_way_are_a_problem(measures: str) -> None:
    """A and C are 0.3 m apart halfway, at 4 s, and T is between them."""
    record = examine_scenario(swapping(measures)).record
    assert record.phases[1].safety is not None
    found = {frozenset(one.pair): one for one in record.phases[1].safety.unsafe}
    assert set(found) == {frozenset("AC"), frozenset("AT"), frozenset("CT")}
    for pair, far in (("AC", 0.3), ("AT", 0.15), ("CT", 0.15)):
        assert found[frozenset(pair)].time == pytest.approx(4.0)
        assert found[frozenset(pair)].gap == pytest.approx(far - 1.0, abs=1e-6)
    assert not record.ok
    assert [problem.kind for problem in record.problems] == ["unsafe"]
    text = " ".join(" ".join(screen(record)).split())
    assert "A and T are too close in q* from 1 s on" in text
    assert "0.85 m nearer than the required distance at 4 s, and 2 more pairs" in text


@pytest.mark.slow
def test_of_ranges_that_change_neither_the_error_nor_the_speeds_are_known() -> None:
    record = examine_scenario(swapping("range", time=0.0)).record
    assert record.steady.ideal is None
    assert record.steady.reason == "formations change from the start"
    assert {demand.steady for demand in record.margins.speed} == {None}
    assert record.theorem.f_bar is None
    later = examine_scenario(swapping("range")).record.phases
    assert {demand.steady for demand in later[1].margins.speed} == {None}
    assert max(demand.steady or 0.0 for demand in later[0].margins.speed) < 1e-9
