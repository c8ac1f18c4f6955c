"""Actions of a user in a session: what each does, and what is refused. That a recording repeats the session, to the
bit, is tested for random actions.
"""

from typing import Any

import pytest

from mjsheaf import check, load_scenario
from mjsheaf.errors import InputError, NotUniqueError
from mjsheaf.live.live import Recorder, event_of, stable_gain
from mjsheaf.loop.session import Session
from tests.builders import build_scenario, refused


def test_a_later_gain_at_the_same_sample_replaces_the_first() -> None:
    with Session(load_scenario("paper", {"time.end": 0.1}), "ideal") as session:
        recorder = Recorder(session)
        for gain in (4.0, 6.0):
            recorder.do({"gain": gain})
        assert len(recorder.events) == 1
        assert session.scenario.phases[0].system.gain == 6.0


@pytest.mark.parametrize(
    ("action", "words"),
    [
        ({"lose": "Z9"}, "unknown id 'Z9'"),
        ({"lose": ["A1"]}, "lose: expected text"),
        ({"cut": ["A1", "A1"]}, "has no link"),
        ({"restore": ["A1", "A2"]}, "is not cut"),
        ({"join": "A1"}, "is present already"),
        ({"gain": 1e9}, "expected a number from 1 to 100"),
        ({"gain": float("nan")}, "expected a number"),
        ({"gain": True}, "expected a number"),
        ({"flow": -1}, "expected a number from 0 to 10"),
        ({"set": {"controller.custom": {}}}, "expected one of lose"),
        ({"lose": "A1", "gain": 5}, "expected one of lose"),
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


def test_a_gridded_flow_has_no_factor() -> None:
    scenario = load_scenario("double_gyre", {"flow.air": {"dimension": 3, "drift": [1, 0, 0]}})
    with pytest.raises(InputError, match="flow: the scenario has no steady flow, or a gridded one"):
        event_of({"flow": 2.0}, scenario, 0.0)


def test_agents_cannot_be_left_free_to_drift_and_a_refusal_says_who_would_be() -> None:
    """Three boats in a chain of which the first senses the target; what is refused leaves a session that goes on."""
    chain = build_scenario(
        {f"B{k}": [5.0 * k, 0.0] for k in (1, 2, 3)},
        {"T": [5, 1, 2]},
        [["B1", "T"]],
        communication=[["B1", "B2"], ["B2", "B3"]],
    )
    with Session(chain, "ideal") as session:
        recorder = Recorder(session)
        for action, words in (
            ({"lose": "B2"}, ("lose B2", "B3 is free along x")),
            ({"cut": ["B1", "B2"]}, ("cut B1 - B2", "B2, B3 are free along x together")),
        ):
            with refused(NotUniqueError, *words):
                recorder.do(action)
        assert recorder.events == []
        for agent in ("B3", "B2"):
            recorder.do({"lose": agent})
        with refused(InputError, "no agent is left"):
            recorder.do({"lose": "B1"})
        session.step()


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
