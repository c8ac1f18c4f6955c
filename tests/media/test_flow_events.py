"""Events that set the flow: against runs glued by hand, bit for bit, and against the field's own velocity."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mjsheaf import check, medium, simulate
from mjsheaf.checking.theorem.of_run import bounds_of_phases
from mjsheaf.errors import InputError
from mjsheaf.loop.engine import Log
from mjsheaf.loop.system import Phase, System, on_engine
from mjsheaf.page.page import page_of
from mjsheaf.scenario import Scenario
from mjsheaf.show.played import media_of
from tests.builders import mixed_scenario
from tests.page.pages import said_in
from tests.running import stream_ideal, stream_physics

BEFORE = {"dimension": 2, "drift": [0.3, 0.2]}
VORTEX = {"centre": [2.0, 1.0], "gamma": 0.4}
AFTER = {"dimension": 2, "core": 1.0, "drift": [-0.2, 0.1], "vortices": [VORTEX]}
TIME, SAMPLE = 0.2, 20
BACKENDS = [("ideal", "mujoco"), ("physics", "mujoco"), ("physics", "fused")]


def scenario_in(flow: dict[str, Any], events: Any = (), **fields: Any) -> Scenario:
    disturbance = {"agents": {"bound": 0.1}, "targets": {"bound": 0.05}}
    raw = {"time": {"end": 0.4}, "flow": {"agents": flow}, "disturbance": disturbance, "events": list(events)}
    return mixed_scenario(**raw | fields)


def pieces_of(run: Any, backend: str, engine: str) -> dict[str, np.ndarray]:
    phases = (Phase(0, run),) if isinstance(run, System) else tuple(run)
    stream = stream_ideal if backend == "ideal" else stream_physics
    logs = [piece.log for piece in stream(on_engine(phases, engine), 1000)]
    return {name: np.concatenate([getattr(log, name) for log in logs]) for name in Log._fields}


def assert_met(scenario: Scenario, log: dict[str, np.ndarray], places: str = "positions") -> None:
    """Require that vehicles met what `medium` returns for where and when they were.

    The origins of bodies are `places` too; the vertical part that boats meet there, by waves, is not compared.
    """
    for v, member in enumerate(scenario.team.members):
        met = medium(scenario).velocity(member.id, scenario.system.grid.samples, log[places][:, v])
        n = 3 if places == "positions" else member.dimension
        np.testing.assert_allclose(log["medium"][:, v, :n], met[:, :n], rtol=0, atol=1e-12, err_msg=member.id)


@pytest.mark.parametrize(("backend", "engine"), BACKENDS)
@pytest.mark.parametrize(
    "change",
    [
        {"flow.agents": AFTER},
        {"flow.agents.drift": [-0.2, 0.1], "flow.agents.core": 1.0, "flow.agents.vortices": [VORTEX]},
    ],
    ids=["whole", "fields"],
)
def test_an_event_gives_the_run_that_is_glued_from_two_systems(
    backend: str, engine: str, change: dict[str, Any]
) -> None:
    events = scenario_in(BEFORE, [{"time": TIME, "set": change}])
    by_event = pieces_of(events.phases, backend, engine)
    before, after = (scenario_in(flow).system for flow in (BEFORE, AFTER))
    glued = pieces_of([Phase(0, before), Phase(SAMPLE, replace(before, flows=after.flows))], backend, engine)
    still = pieces_of(before, backend, engine)
    for name in Log._fields:
        np.testing.assert_array_equal(by_event[name], glued[name], err_msg=name)
        np.testing.assert_array_equal(by_event[name][:SAMPLE], still[name][:SAMPLE], err_msg=name)
    assert np.abs(by_event["positions"][-1] - still["positions"][-1]).max() > 1e-3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"flow": {"agents": AFTER}}, r"events\.0: set\.flow: cannot change during a run.*flow\.water"),
        ({"flow.sea.drift": [1, 0]}, r"events\.0: set\.flow\.sea\.drift: cannot change"),
        ({"disturbance.agents.bound": 1.0}, r"disturbance\.agents\.bound.*cannot change"),
        ({"flow.agents.speed": 1.0}, r"flow\.agents\.speed"),
        ({"flow.agents.drift": [1, 0, 0]}, r"flow\.agents.*drift has 3 numbers; expected 2"),
        ({"flow.water": AFTER}, "either agents and targets, or air and water"),
        ({"flow.targets.drift": [1, 0]}, r"flow\.targets\.dimension"),
    ],
)
def test_what_cannot_be_set_is_named(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        _ = scenario_in(BEFORE, [{"time": TIME, "set": change}]).phases


@pytest.mark.long
def test_check_decides_each_phase_in_its_own_flow() -> None:
    """A phase over targets at rest has the constants of a run that is in its flow from the start."""
    still = {"target_formation": None, "target_motion": {"kind": "static"}, "disturbance": {"agents": {"bound": 0.1}}}
    record = check(scenario_in(BEFORE, [{"time": TIME, "set": {"flow.agents": AFTER}}], **still), trial=False)
    for phase, flow in zip(record["phases"], (BEFORE, AFTER), strict=True):
        alone = check(scenario_in(flow, **still), trial=False)
        for name in ("f_bar", "omega_bar", "rho"):
            assert phase["theorem"][name] == pytest.approx(alone["theorem"][name], rel=1e-9), name
    first, second = (phase["theorem"] for phase in record["phases"])
    assert first["f_bar"] != second["f_bar"]
    assert first["rho"] == 0.0 < second["rho"]


def test_video_and_page_show_the_flow_of_each_phase() -> None:
    """A current that begins at an event is shown from there on, on one scale for the whole run."""
    events = [
        {"time": 0.1, "set": {"flow.water": {"dimension": 2, "drift": [1, 0]}}},
        {"time": 0.2, "lose": "boat"},
        {"time": 0.3, "set": {"flow.water.drift": [0, -2]}},
    ]
    scenario = mixed_scenario(time={"end": 0.4}, flow={}, events=events)
    phases = scenario.phases
    (current,) = media_of(phases, np.zeros((1, 5, 3)))
    assert (current.name, current.top) == ("current", 2.0)
    assert [time for time, _ in current.shots[1:]] == [0.1, 0.3]
    point = np.zeros((1, 3))
    for time, velocity in ((0.0, [0, 0, 0]), (0.1, [1, 0, 0]), (0.25, [1, 0, 0]), (0.3, [0, -2, 0])):
        np.testing.assert_array_equal(current.at(point, time), [velocity])
    data = simulate(scenario, "ideal", allow_drift=True)
    page = page_of(scenario, phases, data, {}, bounds_of_phases(phases, data))
    (shown,) = said_in(page)["flow"]
    assert not np.any(shown["velocity"])
    assert [change["time"] for change in shown["changes"]] == [0.1, 0.3]
    assert {tuple(v) for v in shown["changes"][1]["velocity"]} == {(0.0, -2.0, 0.0)}
