"""`make bench` as a user runs it; the measurement behind it is small here."""

import json
from dataclasses import replace

import pytest

from benchmarks import simulations
from benchmarks.__main__ import main
from benchmarks.measuring import Row
from tests.commands import one_line


@pytest.fixture(autouse=True)
def _a_short_run(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = simulations.ideal

    def ideal(short: bool) -> list[Row]:
        return [replace(row, note=f"{row.note}, short: {short}") for row in whole(short, end=0.06)]

    monkeypatch.setattr(simulations, "ideal", ideal)


def test_the_table_names_what_ours_and_the_bound(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ideal"]) == 0
    printed = capsys.readouterr().out
    for text in ("ideal", "published run, 5 steps, s", "at most 1", "yes", "the authors' code", "processors"):
        assert text in printed


@pytest.mark.parametrize("full", [False, True])
def test_json_has_figures_rows_and_machine(full: bool, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ideal", "--json", *["--full"] * full]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["figures"]["ideal"]["published run, 5 steps, s"] == found["rows"][0]["ours"]
    assert found["rows"][0]["note"].endswith(f"short: {not full}")
    assert found["short"] is not full
    assert set(found["rows"][0]) == {"topic", "what", "ours", "reference", "ratio", "wanted", "met", "note"}
    assert {"processors", "mujoco", "python"} <= set(found["machine"])


def test_an_unknown_topic_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["speed"]) == 2
    assert one_line(capsys.readouterr().err, "'speed'", "startup", "ideal", "loop")
