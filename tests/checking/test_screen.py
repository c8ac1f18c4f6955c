"""The answer of `check` on one screen; that of every scenario is tried in test_check.py, which has their records."""

import html
import json
import pickle

import numpy as np
import pytest

import mjsheaf
from mjsheaf.checking import CheckRecord, examine_scenario
from mjsheaf.checking.screen import MAX_LINES, WIDTH, screen
from tests.commands import answer_of

NUMBERS = ("tracking error", "largest gain", "delay margin", "better law", "fragility")
FEW = ("midpoint", "unseen_target", "split_team", "air_tracks_surface", "lost_thruster")


def assert_fits(name: str) -> str:
    return assert_record_fits(examine_scenario(mjsheaf.load_scenario(name)).record, name)


def assert_record_fits(record: CheckRecord, name: str) -> str:
    lines = screen(record, name)
    assert len(lines) <= MAX_LINES
    assert max(map(len, lines)) <= WIDTH
    for label in NUMBERS:
        assert any(line.startswith(label) for line in lines), label
    return "\n".join(lines)


@pytest.mark.slow
@pytest.mark.parametrize("name", FEW)
def test_the_answer_fits_on_a_screen(name: str) -> None:
    assert_fits(name)


def test_what_fails_is_named_with_agents_and_a_fix() -> None:
    text = assert_fits("air_tracks_surface")
    assert "NOT OK: assumption 6 fails" in text
    assert "A1, A2, A3 are free along z" in text
    assert "Fix: give A1 an altimeter" in text


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unseen_target", "split_team"])
def test_the_edges_that_are_suggested_make_assumption_5_hold(name: str) -> None:
    scenario = mjsheaf.load_scenario(name)
    record = mjsheaf.check(scenario, trial=False)
    assert record["assumptions"][4]["holds"] is False
    fix = record["topology_fix"]
    fields = scenario.model_dump(mode="json", exclude_none=True)
    kind = "communication" if "communication" in fix else "sensing"
    ends = fix.split("[")[1].split("]")[0].split(", ")
    edges = fields.get(kind, [])
    changed = mjsheaf.load_scenario(name, {kind: [*edges, ends]})
    assert mjsheaf.check(changed, trial=False)["assumptions"][4]["holds"] is True


@pytest.mark.slow
def test_the_command_prints_the_answer_alone_on_stdout() -> None:
    short = answer_of("check", "midpoint")
    assert len(short.out.splitlines()) <= MAX_LINES
    assert "--full" in short.out
    whole = answer_of("check", "midpoint", "--no-trial", "--full").out
    assert whole.startswith(answer_of("check", "midpoint", "--no-trial").out.split("\n\nmjsheaf check")[0])
    assert len(whole.splitlines()) <= 200


def test_the_answer_in_python_prints_as_the_screen_and_stays_a_mapping() -> None:
    answer = mjsheaf.check(mjsheaf.load_scenario("midpoint"), trial=False, progress=False)
    said = answer_of("check", "midpoint", "--no-trial").out
    assert said.startswith(repr(answer))
    assert answer._repr_html_() == f"<pre>{html.escape(repr(answer))}</pre>"
    assert json.loads(json.dumps(answer)) == dict(answer) == answer
    again = pickle.loads(pickle.dumps(answer))
    assert (again, repr(again)) == (answer, repr(answer))


def test_scenarios_and_sheaves_have_a_short_form() -> None:
    assert str(mjsheaf.load_scenario("midpoint")) == "Scenario('midpoint': 1 agent, 2 targets, 2 edges; 0 to 40 s)"
    sheaf = mjsheaf.Sheaf({"a": 2, "b": 3})
    sheaf.add_edge("a", "b", np.eye(1, 2), np.eye(1, 3))
    assert repr(sheaf) == "Sheaf(2 vertices and 1 edges; dim C^0 = 5, dim C^1 = 1)"
