"""Laws in Python in `compare`, `expect`, the plots and the notes: they are named, and no gain is advised.

Oracles: the paper's law written in Python is the compiled one; plain runs under the same law.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import mjsheaf
from mjsheaf.comparing import CompareRecord, compare
from mjsheaf.comparing.page import report_text
from mjsheaf.errors import InputError
from mjsheaf.files import dump_yaml
from mjsheaf.runs.expecting import expected_law, try_scenario
from mjsheaf.runs.publish import account_of
from mjsheaf.scenario import load_scenario
from mjsheaf.scenario.load import find_law, load_controller, same_law
from tests.builders import LAWS, require, two_boats
from tests.commands import Capture, answer_of, call, is_refusal


@pytest.fixture(scope="module")
def laws(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("laws") / "laws.py"
    path.write_text(LAWS)
    return path


@pytest.fixture(scope="module")
def record(laws: Path) -> CompareRecord:
    return compare(two_boats("otter", "hull"), law=find_law(f"{laws}:Same")).record


@pytest.mark.long
def test_the_paper_s_law_in_python_compares_like_the_compiled_one(record: CompareRecord) -> None:
    compiled = compare(two_boats("otter", "hull")).record
    for key in ("ideal", "base", "+lag", "all"):
        own, other = (found.rung(key).errors["team"].late.tracking_error for found in (record, compiled))
        assert own == pytest.approx(other, rel=1e-6)
    assert record.rung("all-terms").errors == compiled.rung("all").errors


@pytest.mark.slow
def test_the_law_is_named_and_no_gain_advised(record: CompareRecord, laws: Path) -> None:
    assert record.controller == record.law == f"{laws}:Same"
    assert (record.gain, record.gains, record.usable_gain, record.loop) == (None, [], None, None)
    assert record.ringing is None
    page = report_text(record)
    assert "laws.py:Same" in page
    assert "controller.gain" not in page
    assert "gain 1 1/s" not in page


def test_every_run_constructs_the_law_anew(laws: Path) -> None:
    """The runs of the ladder are those of plain runs under a law with a state."""
    scenario = two_boats("hull", "hull")
    comparison = compare(scenario, law=find_law(f"{laws}:Stateful"))
    for key, backend in (("ideal", "ideal"), ("all", "physics")):
        alone = mjsheaf.simulate(scenario, backend, controller=load_controller(f"{laws}:Stateful"))
        found = comparison.runs[key].dataset
        np.testing.assert_array_equal(found["agent_position"].values, alone["agent_position"].values)


def test_every_dataset_names_its_law(laws: Path) -> None:
    scenario = two_boats("hull", "hull", time={"end": 0.1})
    plain = mjsheaf.simulate(scenario, "ideal")
    assert (plain.attrs["law"], plain.attrs["gain"]) == ("paper's law", 1.0)
    own = mjsheaf.simulate(scenario, "ideal", controller=lambda t, sample: -sample.disagreement)
    assert own.attrs["law"] == own.attrs["controller"] == "<lambda>"
    assert "gain" not in own.attrs
    law = {"gain": 1.0, "control_period": 0.02, "feedforward": {}, "drift": {}}
    terms = mjsheaf.simulate(two_boats("hull", "hull", time={"end": 0.1}, controller=law), "ideal")
    assert terms.attrs["law"] == "paper's law with feedforward and drift"


@pytest.mark.slow
def test_plots_and_summary_name_the_law(laws: Path, drawn: list[Figure], tmp_path: Path) -> None:
    command: list[str | Path] = ["run", expecting(laws), "--backend", "ideal", "--no-video", "--out", tmp_path / "out"]
    assert call(*command, "--controller", f"{laws}:Same") == 0
    assert drawn
    assert all("laws.py:Same" in figure.get_suptitle() and "gain" not in figure.get_suptitle() for figure in drawn)
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["law"].endswith("laws.py:Same")


def test_notes_do_not_advise_a_gain_that_the_law_ignores(laws: Path) -> None:
    scenario = two_boats("otter", "hull", links={"all": {"noise": 1.0}})
    dataset = mjsheaf.simulate(scenario, controller=load_controller(f"{laws}:wild"))
    notes = account_of(scenario, scenario.phases, dataset)[0]["notes"]
    assert "saturated" in [note["kind"] for note in notes]
    assert not any("gain" in note["text"] for note in notes)


def test_a_law_file_that_changes_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "law.py"
    path.write_text(LAWS)
    law = find_law(f"{path}:Same")
    law.load(0)
    path.write_text(f"{LAWS}\n")
    with pytest.raises(InputError, match="changed"):
        law.load(0)


def test_same_law_looks_at_names_alone() -> None:
    assert same_law("a/law.py:X", "law.py:X")
    assert not same_law("law.py:X", "law.py:Y")
    assert not same_law("law.py:X", None)


# -- expectations ------------------------------------------------------------------------------------------------------


def expecting(laws: Path, **expect: object) -> Path:
    """A scenario next to the laws, with an expectation."""
    scenario = two_boats("hull", "hull", time={"end": 0.5}).model_dump(mode="json", exclude_none=True)
    path = laws.parent / "pair.yaml"
    path.write_text(dump_yaml({**scenario, "expect": expect}))
    return path


def test_bounds_hold_for_the_law_that_the_file_names(laws: Path) -> None:
    path = expecting(laws, controller="laws.py:Stateful", ideal={"tracking_error": 100.0})
    scenario = load_scenario(path)
    law = expected_law(scenario, path.parent)
    trial = try_scenario(scenario, "ideal", law=law)
    alone = mjsheaf.simulate(scenario, "ideal", controller=load_controller(f"{laws}:Stateful"))
    expected = np.sqrt((alone["tracking_error"].values[-1] ** 2).mean())
    assert trial.final["tracking_error"] == pytest.approx(expected, rel=1e-12)
    assert trial.met
    plain = try_scenario(scenario, "ideal")
    assert plain.final["tracking_error"] != trial.final["tracking_error"]


def test_expect_takes_the_law_of_the_file_or_of_the_option(laws: Path, capsys: Capture) -> None:
    path = expecting(laws, controller="laws.py:Stateful", ideal={"tracking_error": 100.0})
    assert call("expect", path) == 0
    assert "under laws.py:Stateful" in capsys.readouterr().out
    assert call("expect", path, "--controller", f"{laws}:Same", "--update", "--backend", "ideal") == 0
    assert load_scenario(path).expect.controller == "laws.py:Same"
    assert call("expect", path) == 0


def test_a_law_outside_the_scenario_s_directory_is_refused(laws: Path, tmp_path: Path) -> None:
    path = expecting(laws, controller="../laws.py:Same", ideal={"tracking_error": 100.0})
    assert is_refusal(answer_of("expect", path), "expect.controller")
    (tmp_path / "far.py").write_text(LAWS)
    assert is_refusal(answer_of("expect", path, "--controller", f"{tmp_path}/far.py:Same", "--update"), "lies outside")


@pytest.mark.usefixtures("without_plots")
def test_run_compares_with_bounds_of_its_own_law_only(laws: Path, tmp_path: Path) -> None:
    path = expecting(laws, controller="laws.py:Same", ideal={"tracking_error": 1e-6})
    command: list[str | Path] = ["run", path, "--backend", "ideal", "--no-video", "--out", tmp_path / "out"]
    assert call(*command) == 0
    expect = json.loads((tmp_path / "out" / "summary.json").read_text())["expect"]
    assert expect == {"met": None, "checks": [], "reason": "the bounds are for the law laws.py:Same"}
    assert call(*command, "--expect") == 1
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    require(summary, {"controller": "laws.py:Same", "expect.met": False})
