"""The answer of `check` on one screen; that of every scenario is tried in test_check.py, which has their records."""

import html
import json
import pickle
from io import StringIO

import numpy as np
import pytest
from pydantic import Field
from rich.console import Console

import mjsheaf
from mjsheaf.checking import CheckRecord, examine_scenario
from mjsheaf.checking.loop.held_law import LawLoop
from mjsheaf.checking.report import MAX_LINES, WIDTH, report, screen
from tests.commands import answer_of
from tests.running import analyse

NUMBERS = ("tracking error", "largest gain", "delay margin", "better law", "fragility")


def assert_record_fits(record: CheckRecord, name: str) -> str:
    lines = screen(record, name)
    assert len(lines) <= MAX_LINES
    assert max(map(len, lines)) <= WIDTH
    for label in NUMBERS:
        assert any(line.startswith(label) for line in lines), label
    return "\n".join(lines)


def test_what_fails_is_named_with_agents_and_a_fix() -> None:
    record = examine_scenario(mjsheaf.load_scenario("air_tracks_surface")).record
    text = assert_record_fits(record, "air_tracks_surface")
    assert "NOT OK: assumption 6 fails" in text
    assert "A1, A2, A3 are free along z" in text
    assert "Fix: give A1 an altimeter" in text


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


class MoreOfALaw(LawLoop):
    extra: float = Field(1.5, description="made up, m; in words [of a kind] that look like markup")
    sentence: str = Field("", description="why")
    nothing: float | None = Field(None, description="never known, m; null where it is not")


def test_the_whole_report_has_every_field_of_the_record_by_itself() -> None:
    record = examine_scenario(mjsheaf.load_scenario("midpoint")).record
    law = MoreOfALaw(**dict(record.law), sentence="of [a] kind " * 20)
    first = page(record.model_copy(update={"law": law}))
    (line,) = [line for line in first if line.startswith("  extra ")]
    assert line.split() == ["extra", "1.5", "made", "up,", "m"]
    assert " ".join(first).count("[a] kind") == 20
    assert not any(line.startswith("  nothing ") for line in first)


def test_after_an_event_the_whole_report_has_what_differs() -> None:
    event = {"time": 20.0, "set": {"controller.gain": 4.0}}
    record = examine_scenario(mjsheaf.load_scenario("midpoint", {"events": [event]})).record
    lines = page(record)
    start = lines.index("From 20 s on: gain = 4.0")
    gains = [line.split() for line in lines if line.split()[:1] == ["gain"]]
    assert gains == [["gain", "3", "k1,", "1/s"], ["gain", "4", "before:", "3"]]
    assert not any(line.startswith("fragility") for line in lines[start:])
    assert any(line.startswith("fragility") for line in lines[:start])


def test_the_whole_report_says_when_the_last_absent_agent_joins() -> None:
    agents = [{"id": "A1", "position": [1, 0]}, {"id": "A2", "position": [3, 0]}]
    fields = {"agents": agents, "communication": [["A1", "A2"]], "sensing": [["A1", "left"], ["A1", "right"]]}
    targets = [{"id": id, "position": [x, 0], "motion": {"kind": "static"}} for id, x in (("left", 0), ("right", 2))]
    events = [{"time": 10.0, "join": "A2"}]
    scenario = mjsheaf.load_scenario("midpoint", {**fields, "targets": targets, "events": events})
    lines = page(examine_scenario(scenario).record)
    later = lines[lines.index("From 10 s on: join A2") :]
    absent = later.index("absent  agents that are lost or have not joined yet")
    assert later[absent + 1].split() == ["null", "before:", "A2"]
    titles = [line for line in later if line.startswith("jump")]
    assert titles[0] == "jump  |q*_new - q*_old| at its start, of the agents present before and after, m"


def page(record: CheckRecord) -> list[str]:
    console = Console(width=120, file=StringIO())
    console.print(report(record))
    return console.file.getvalue().splitlines()  # type: ignore[attr-defined]


def test_scenarios_and_sheaves_have_a_short_form() -> None:
    assert str(mjsheaf.load_scenario("midpoint")) == "Scenario('midpoint': 1 agent, 2 targets, 2 edges; 0 to 40 s)"
    sheaf = mjsheaf.Sheaf({"a": 2, "b": 3})
    sheaf.add_edge("a", "b", np.eye(1, 2), np.eye(1, 3))
    assert repr(sheaf) == "Sheaf(2 vertices and 1 edges; dim C^0 = 5, dim C^1 = 1)"


@pytest.mark.long
@pytest.mark.parametrize("name", ["unseen_target", "split_team"])
def test_the_edges_that_are_suggested_make_assumption_5_hold(name: str) -> None:
    scenario = mjsheaf.load_scenario(name)
    record = analyse(scenario)
    assert record["assumptions"][4]["holds"] is False
    fix = record["topology_fix"]
    kind = "communication" if "communication" in fix else "sensing"
    ends = fix.split("[")[1].split("]")[0].split(", ")
    edges = scenario.model_dump(mode="json", exclude_none=True).get(kind, [])
    assert analyse(name, {kind: [*edges, ends]})["assumptions"][4]["holds"] is True
