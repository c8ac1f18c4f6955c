"""A session that its user changes equals the run of the recorded scenario, to the bit.

Oracle: `simulate` of the recorded scenario.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import check, load_scenario, simulate
from mjsheaf.errors import InputError, MjsheafError, NotUniqueError
from mjsheaf.live.live import Recorder, stable_gain
from mjsheaf.loop.session import Session
from mjsheaf.runs.publish import write_scenario
from mjsheaf.scenario import scenario_from_mapping

ACTIONS: dict[int, list[dict[str, Any]]] = {
    0: [{"gain": 4.0}, {"gain": 6.0}],
    7: [{"lose": "A5"}],
    19: [{"cut": ["A1", "A2"]}, {"flow": 0.5}],
    33: [{"join": "A5"}, {"gain": 12.0}],
    46: [{"restore": ["A1", "A2"]}],
}


def drive(session: Session, every: int) -> tuple[Recorder, list[xr.Dataset]]:
    """Run a session in chunks, with ACTIONS at their samples."""
    recorder = Recorder(session)
    chunks = []
    sample = 0
    end = session.engine.system.grid.steps
    while sample <= end:
        for action in ACTIONS.get(sample, ()):
            recorder.do(action)
        ahead = [k for k in ACTIONS if k > sample]
        chunk, message = recorder.record(min([every, *(k - sample for k in ahead)]))
        assert chunk is not None
        assert not message
        chunks.append(chunk)
        sample += chunk.sizes["time"]
    return recorder, chunks


@pytest.mark.parametrize("backend", ["ideal", pytest.param("physics", marks=pytest.mark.slow)])
@pytest.mark.parametrize("overrides", [{}, {"links.all.delay": 0.03, "links.all.noise": 0.1, "links.all.loss": 0.2}])
def test_the_recorded_scenario_gives_the_session_to_the_bit(
    backend: str, overrides: dict[str, Any], tmp_path: Path
) -> None:
    scenario = load_scenario("paper", {"time.end": 0.6, "controller.integral.gain": 0.5, **overrides})
    with Session(scenario, backend) as session:
        recorder, chunks = drive(session, 5)
    assert len(recorder.events) == 7  # the second gain at sample 0 replaced the first
    again = simulate(load_scenario(str(write_scenario(session.scenario, tmp_path))), backend, threads=1)
    untouched = simulate(scenario, backend, threads=1)
    for name in ("agent_position", "target_position", "disagreement", "tracking_error", "velocity_command", "phase"):
        seen = np.concatenate([chunk[name].values for chunk in chunks])
        np.testing.assert_array_equal(seen, again[name].values, err_msg=name)
    assert not np.array_equal(untouched.agent_position.values, again.agent_position.values)


@pytest.mark.parametrize(
    ("action", "words"),
    [
        ({"lose": "Z9"}, "unknown id 'Z9'"),
        ({"lose": ["A1"]}, "lose: expected text"),
        ({"cut": ["A1"]}, "cut: "),
        ({"cut": ["A1", "A1"]}, "has no link"),
        ({"restore": ["A1", "A2"]}, "is not cut"),
        ({"join": "A1"}, "is present already"),
        ({"gain": 1e9}, "expected a number from 1 to 100"),
        ({"gain": float("nan")}, "expected a number"),
        ({"gain": True}, "expected a number"),
        ({"flow": -1}, "expected a number from 0 to 10"),
        ({"set": {"controller.custom": {}}}, "expected one of lose"),
        ({"lose": "A1", "gain": 5}, "expected one of lose"),
        ({}, "expected one of lose"),
    ],
)
def test_what_is_not_possible_is_refused_and_changes_nothing(action: dict[str, Any], words: str) -> None:
    with Session(load_scenario("paper", {"time.end": 0.1}), "ideal") as session:
        recorder = Recorder(session)
        phases = session.engine.phases
        with pytest.raises(InputError, match=words):
            recorder.do(action)
        assert recorder.events == []
        assert session.engine.phases is phases


def test_agents_that_would_be_free_to_drift_cannot_be_made_so() -> None:
    """Every action that is accepted leaves a scenario that `mjsheaf run` accepts."""
    scenario = load_scenario("midpoint", {"time.end": 0.1})
    with Session(scenario, "ideal") as session:
        recorder = Recorder(session)
        agents = scenario.team.agent_ids
        refused = ""
        for agent in agents:
            try:
                recorder.do({"lose": agent})
            except MjsheafError as error:
                refused = str(error)
        assert "not unique" in refused or "no agent is left" in refused
        assert 0 <= len(recorder.events) < len(agents)
        session.step()


def test_a_refusal_says_who_would_be_free() -> None:
    """Three boats in a chain of which the first senses the target."""
    raw = {
        "name": "chain",
        "time": {"end": 1.0},
        "agents": [{"id": f"B{k}", "position": [5.0 * k, 0.0]} for k in (1, 2, 3)],
        "targets": [{"id": "T", "position": [0.0, 0.0]}],
        "communication": [["B1", "B2"], ["B2", "B3"]],
        "sensing": [["B1", "T"]],
    }
    with Session(scenario_from_mapping(raw), "ideal") as session:
        recorder = Recorder(session)
        for action, event, words in (
            ({"lose": "B2"}, "lose B2: ", "B3 is free along x"),
            ({"cut": ["B1", "B2"]}, "cut B1 - B2: ", "B2, B3 are free along x together"),
        ):
            with pytest.raises(NotUniqueError) as caught:
                recorder.do(action)
            assert event in str(caught.value)
            assert words in str(caught.value)
        assert recorder.events == []


@pytest.mark.slow
@pytest.mark.parametrize(("name", "backend"), [("midpoint", "ideal"), ("midpoint", "physics"), ("paper", "ideal")])
def test_the_stable_gain_of_the_live_page_is_that_of_check(name: str, backend: str) -> None:
    scenario = load_scenario(name)
    record = check(scenario, trial=False)
    wanted = record["margins"]["bodies"]["largest_gain"] if backend == "physics" else record["law"]["largest_gain"]
    assert stable_gain(scenario.phases[0].system.remaining, backend) == pytest.approx(wanted, rel=1e-9)
    late = load_scenario("paper_delay")
    found = stable_gain(late.phases[0].system.remaining, backend)
    over_links = check(late, trial=False)["margins"]["bodies"]["largest_gain"]
    assert found == (pytest.approx(over_links, rel=1e-9) if backend == "physics" else None)


def test_an_agent_that_joins_later_cannot_be_lost_before() -> None:
    """Its first event would be another, and the past with it."""
    scenario = load_scenario("paper", {"time.end": 0.1, "events": [{"time": 0.05, "join": "A5"}]})
    with Session(scenario, "ideal") as session:
        recorder = Recorder(session)
        session.step()
        with pytest.raises(InputError, match="A5 has not joined yet"):
            recorder.do({"lose": "A5"})
