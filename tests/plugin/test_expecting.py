"""Expectations: those made of a run, reports about them, and `mjsheaf expect`, which writes them into files.

Oracle: numbers computed by hand, a tiny team whose error is known exactly, and the file's own bytes.
"""

import math
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.errors import InputError, ScenarioError
from mjsheaf.files import parse_yaml, replace_file, with_field
from mjsheaf.results.metrics import check_expectation
from mjsheaf.runs.expecting import Trial, bounds_from, describe, expectation_from, loose, missed, round_up, try_scenario
from mjsheaf.scenario import load_scenario, scenario_from_mapping
from mjsheaf.scenario.scenario import Bounds, Expect
from tests.builders import refused
from tests.commands import answer_of, is_refusal
from tests.strategies import examples

TINY = """\
# A boat goes to a buoy.
time: {end: 1}
controller: {gain: 2, control_period: 0.01}   # 1/s

agents: [{id: A, position: [0, 0]}]
targets:
  - {id: T, position: [3, 4]}
sensing:
  - [A, T]
physics: {timestep: 0.005}
"""
FOUND = 5.0 * (1.0 - 2.0 * 0.01) ** 100  # a held first-order loop: the error shrinks by 1 - k h each period


@examples(200)
@given(st.floats(1e-12, 1e9))
def test_rounding_goes_up_to_three_digits_and_no_further(value: float) -> None:
    rounded = round_up(value)
    assert value <= rounded <= value * 1.0101
    assert float(f"{rounded:.3g}") == rounded


def test_bounds_are_what_was_found_and_a_margin() -> None:
    trial = Trial("ideal", "finished", "", {"mean_disagreement": 1.0, "tracking_error": 0.0, "formation_error": None})
    assert bounds_from(trial, 0.05) == {"mean_disagreement": 1.05, "tracking_error": 1e-9}


def test_what_was_not_tried_is_kept() -> None:
    old = {"physics": {"tracking_error": 3.0}}
    trial = Trial("ideal", "finished", "", {"tracking_error": 1.0})
    new = expectation_from([trial], 0.1, old)
    assert list(new.items()) == [("ideal", {"tracking_error": 1.1}), ("physics", {"tracking_error": 3.0})]
    refused = Trial("ideal", "refused", "drifts along z together")
    assert expectation_from([refused], 0.1, old) == {"refused": "drifts along z together"}
    assert expectation_from([refused], 0.1, {"refused": "along z"}) == {"refused": "along z"}
    assert expectation_from([trial], 0.1, {"refused": "along z"}) == {"ideal": {"tracking_error": 1.1}}


def trial_of(**expect: Any) -> Trial:
    raw = parse_yaml(TINY, "tiny")
    return try_scenario(scenario_from_mapping({"name": "tiny", **raw, "expect": expect}), "ideal")


@pytest.mark.slow(first=True)
def test_a_miss_shows_bound_and_value_and_the_command_to_watch() -> None:
    trial = trial_of(ideal={"tracking_error": 0.5, "mean_disagreement": 1.0})
    assert trial.met is False
    assert trial.final["tracking_error"] == pytest.approx(FOUND, rel=1e-9)
    assert [text.split()[0] for text in missed(trial.checks)] == ["tracking_error"]
    assert describe(trial, "tiny", "tiny.yaml").splitlines() == [
        "tiny on ideal: finished, NOT as expected",
        "  measure (m)           expected       found",
        "  mean_disagreement         <= 1      0.6631",
        "  tracking_error          <= 0.5      0.6631  32.6 % above",
        "  watch it: mjsheaf run tiny.yaml --backend ideal",
    ]


def test_loose_bounds_are_known() -> None:
    trial = trial_of(ideal={"tracking_error": 0.7, "mean_disagreement": 0.8})
    assert trial.met
    assert [check["measure"] for check in loose(trial, 1.1)] == ["mean_disagreement"]
    assert loose(trial, 1.3) == []


def test_a_refusal_is_met_missed_or_missing() -> None:
    scenario = load_scenario("air_tracks_surface")
    assert try_scenario(scenario, "physics").met is True
    other = load_scenario("air_tracks_surface", {"expect.refused": "another reason"})
    assert try_scenario(other, "ideal").met is False
    ran = trial_of(refused="along z")
    assert (ran.met, ran.status) == (False, "finished")
    bounds = load_scenario("air_tracks_surface", {"expect": {"ideal": {"tracking_error": 1}}})
    trial = try_scenario(bounds, "ideal")
    assert (trial.met, trial.status) == (False, "refused")
    told = describe(trial, "team", "team.yaml")
    assert "A1, A2, A3 are free along z together" in told
    assert "has no value" in told


EXPECT = {"ideal": {"tracking_error": 0.1}, "physics": {"tracking_error": 0.2}}
IDEAL, PHYSICS = "ideal: {tracking_error: 0.1}", "physics: {tracking_error: 0.2}"
LINES = f"\n  {IDEAL}\n  {PHYSICS}"
FORMS = {
    "in lines": (
        "a: 1\nexpect:  # why\n  ideal: {tracking_error: 3}\n\n# end\nb: 2\n",
        f"a: 1\nexpect:  # why{LINES}\n\n# end\nb: 2\n",
    ),
    "deeper lines": (
        "expect:\n    ideal:\n        tracking_error: 3 # was\n# end",
        f"expect:\n    {IDEAL}\n    {PHYSICS} # was\n# end",
    ),
    "in braces": ("expect: {ideal: {tracking_error: 3}}  # why\nb: 2\n", f"expect:{LINES}  # why\nb: 2\n"),
    "in braces on lines": ("expect: {ideal: {\n  tracking_error: 3}}\n", f"expect:{LINES}\n"),
    "nothing": ("expect:   # later\nb: 2\n", f"expect:{LINES}   # later\nb: 2\n"),
    "null": ("expect: ~\n", f"expect:{LINES}\n"),
    "a text in lines": ("expect:\n  refused: |\n    so\n    it\nb: 2\n", f"expect:{LINES}\nb: 2\n"),
    "at the end": ("a: 1  # é 漢 🚤\n# last", f"a: 1  # é 漢 🚤\n# last\nexpect:  # new{LINES}\n"),
    "indented": ("  a: 1\n  b: 2\n", f"  a: 1\n  b: 2\n  expect:  # new\n    {IDEAL}\n    {PHYSICS}\n"),
    "of another system": (
        "a: 1\r\nexpect:\r\n  ideal: {}\r\nb: 2\r\n",
        f"a: 1\r\nexpect:\r\n  {IDEAL}\r\n  {PHYSICS}\r\nb: 2\r\n",
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_the_rest_of_a_file_stays_as_it_is(form: str) -> None:
    text, edited = FORMS[form]
    assert with_field(text, "expect", EXPECT, "file", "new") == edited
    assert parse_yaml(edited, "file") == {**parse_yaml(text, "file"), "expect": EXPECT}


@pytest.mark.parametrize("text", ["a: 1\n...\n", "a: 1\n---\nb: 2\n", "[1]\n", "", "a: [\n", "{}"])
def test_what_cannot_be_edited_is_refused(text: str) -> None:
    with pytest.raises(ScenarioError, match=r"^file: "):
        with_field(text, "expect", EXPECT, "file")


@pytest.mark.parametrize("text", ['{"a": 1, "expect": {}}', '{"a": 1}\n'])
def test_the_refusal_to_edit_json_says_what_to_write(text: str) -> None:
    with refused(ScenarioError, "such as JSON", 'write "expect": {"ideal": {'):
        with_field(text, "expect", EXPECT, "file")


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, link = tmp_path / "real.yaml", tmp_path / "link.yaml"
    real.write_bytes(b"old")
    real.chmod(0o640)
    link.symlink_to(real)
    with refused(InputError, "changed"):
        replace_file(link, b"new", expected=b"other")
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(InputError, match=r"link\.yaml: cannot be written: No space left"):
        replace_file(link, b"new", expected=b"old")
    monkeypatch.undo()
    assert real.read_bytes() == b"old"
    replace_file(link, b"new", expected=b"old")
    assert real.read_bytes() == b"new"
    assert link.is_symlink()
    assert real.stat().st_mode & 0o777 == 0o640
    assert {p.name for p in tmp_path.iterdir()} == {"real.yaml", "link.yaml"}


@pytest.mark.slow
def test_an_expectation_is_written_held_and_missed(tmp_path: Path) -> None:
    path = tmp_path / "tiny.yaml"
    path.write_text(TINY)
    assert is_refusal(answer_of("expect", path), "expect.ideal: missing; --update writes it")
    code, out, _ = answer_of("expect", path, "--update")
    assert code == 0
    assert f"wrote expect: of {path}" in out
    text = path.read_text()
    assert text.startswith(TINY + "expect:  # at most 5 % above what was found\n  ideal: {")
    bounds = load_scenario(path).expect.ideal
    assert bounds is not None
    assert bounds.tracking_error == math.ceil(FOUND * 1050) / 1000
    assert answer_of("expect", path)[0] == 0
    path.write_text(text.replace("gain: 2", "gain: 1"))
    code, out, told = answer_of("expect", path, "--backend", "ideal")
    assert code == 1
    assert told.count("\n") == 1
    assert "tracking_error is 1.83, expected at most 0.697 on ideal" in told
    assert "physics" not in out


def test_a_refusal_is_written_as_one(tmp_path: Path) -> None:
    path = tmp_path / "team.yaml"
    call_text = TINY.replace("position: [0, 0]", "position: [0, 0, 9]")
    path.write_text(call_text)
    assert answer_of("expect", path, "--update")[0] == 0
    assert path.read_text().startswith(f"{call_text}expect:\n  refused: ")
    assert "A is free along z" in (load_scenario(path).expect.refused or "")
    assert answer_of("expect", path)[0] == 0


@pytest.mark.parametrize("margin", ["-1", "nan"])
def test_a_wrong_margin_is_refused(margin: str, tmp_path: Path) -> None:
    path = tmp_path / "tiny.yaml"
    path.write_text(TINY)
    assert is_refusal(answer_of("expect", path, "--margin", margin, "--update"), "'--margin'")
    assert path.read_text() == TINY


def test_a_run_that_blows_up_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "tiny.yaml"
    text = TINY.replace("gain: 2", "gain: 900").replace("end: 1}", "end: 3}")
    path.write_text(text)
    code, _, told = answer_of("expect", path, "--update", "--backend", "ideal")
    assert code == 3
    assert "nothing is written" in told
    assert path.read_text() == text


def test_vehicles_that_come_too_close_are_no_expectation(tmp_path: Path) -> None:
    """They begin too close: no bound is written, and a file with a negative one is refused; rounding counts as 0."""
    path = tmp_path / "close.yaml"
    text = TINY + "safety: {distance: 50, range: 60}\n"
    path.write_text(text)
    code, _, told = answer_of("expect", path, "--update", "--backend", "ideal")
    assert code == 2
    assert "expect.ideal.smallest_separation: a distance on ideal is" in told
    assert "nothing is written" in told
    assert path.read_text() == text
    path.write_text(text + "expect: {ideal: {smallest_separation: -1.46}}\n")
    with pytest.raises(ScenarioError, match=r"expect\.ideal\.smallest_separation"):
        load_scenario(path)
    trial = Trial("ideal", "finished", "", {"smallest_separation": -1e-10})
    assert expectation_from([trial], 0.05, {}) == {"ideal": {"smallest_separation": 0.0}}
    expect, safety = Expect(ideal=Bounds(smallest_separation=0.0)), {"smallest_separation": -1e-10}
    assert check_expectation(expect, "ideal", "finished", {}, (), safety)["met"]


def test_a_file_that_may_not_be_written_is_refused_before_it_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "tiny.yaml"
    path.write_text(TINY)
    monkeypatch.setattr(os, "access", lambda place, mode: mode != os.W_OK)  # the superuser may write anything
    code, out, told = answer_of("expect", path, "--update")
    assert (code, out) == (2, "")
    assert "tiny.yaml: cannot be written" in told
    assert "copy the scenario" in told


def test_a_scenario_that_comes_with_mjsheaf_is_not_rewritten() -> None:
    assert is_refusal(answer_of("expect", "midpoint", "--update", "--backend", "ideal"), "midpoint: comes with mjsheaf")
