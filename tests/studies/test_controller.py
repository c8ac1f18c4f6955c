"""Studies of a law in Python: named, loaded anew for each run, and part of what a study is.

Oracles: plain runs under the same law.
"""

import csv
import json
import re
from pathlib import Path

import pytest

import mjsheaf
from mjsheaf.errors import PlaceError
from mjsheaf.results.metrics import summarize
from mjsheaf.scenario.load import load_controller
from mjsheaf.studies.plan import Plan, load_plan
from mjsheaf.studies.study import run_study
from tests.builders import IN_THREADS, LAWS, small_plan
from tests.commands import answer_of, contents, is_refusal
from tests.page.pages import said_in


@pytest.fixture
def law(tmp_path: Path) -> Path:
    path = tmp_path / "law.py"
    path.write_text(LAWS)
    return path


def plan_of(law: Path | None, name: str = "Stateful") -> Plan:
    """Four runs of half a second, under a law of a file or the sheaf's."""
    return small_plan(overrides={"spread.position": 1.0}, controller=f"{law}:{name}" if law else None)


@pytest.mark.parametrize("own", [True, False], ids=["law of a file", "the sheaf's"])
def test_every_run_is_that_of_its_scenario_under_a_fresh_law(own: bool, law: Path, tmp_path: Path) -> None:
    study = run_study(plan_of(law if own else None), tmp_path / "s", IN_THREADS)
    assert [record["run"] for record in study.records] == [0, 1, 2, 3]
    for record in study.records:
        changes = {"time.end": 0.5, "spread.position": 1.0, "seed": record["seed"], **record["parameters"]}
        scenario = mjsheaf.load_scenario("midpoint", changes)
        controller = load_controller(f"{law}:Stateful", scenario.seed) if own else None
        alone = mjsheaf.simulate(scenario, "ideal", controller=controller)
        assert record["final"] == summarize(scenario.team, alone)
        assert record["law"] == alone.attrs["law"].removeprefix(f"{law.parent}/")
        assert (record["status"], record["message"]) == ("finished", "")


@pytest.mark.slow(first=True)
def test_results_name_the_law_but_not_its_place(law: Path, tmp_path: Path) -> None:
    run_study(plan_of(law), tmp_path / "s", IN_THREADS)
    rows = list(csv.DictReader((tmp_path / "s" / "table.csv").open()))
    assert {row["law"] for row in rows} == {"law.py:Stateful"}
    page = (tmp_path / "s" / "index.html").read_text()
    assert "--controller law.py:Stateful" in page
    assert str(tmp_path) not in page
    asked = json.loads((tmp_path / "s" / "study.json").read_text())["law"]
    assert (asked["file"], asked["name"], len(asked["sha256"])) == ("law.py", "Stateful", 64)
    (tmp_path / "far").mkdir()
    run_study(plan_of(law.rename(tmp_path / "far" / "law.py")), tmp_path / "far" / "s", IN_THREADS)
    assert contents(tmp_path / "far" / "s") == contents(tmp_path / "s")


@pytest.mark.slow
def test_a_study_does_not_go_on_under_another_law(law: Path, tmp_path: Path) -> None:
    run_study(plan_of(law), tmp_path / "s", IN_THREADS)
    again = run_study(plan_of(law), tmp_path / "s", IN_THREADS)
    assert again.begun == 0
    with pytest.raises(PlaceError, match=r"law\.name was 'Stateful', is now 'wild'"):
        run_study(plan_of(law, "wild"), tmp_path / "s", IN_THREADS)
    law.write_text(LAWS.replace("-0.01", "-0.02"))
    with pytest.raises(PlaceError, match=r"law\.sha256 was"):
        run_study(plan_of(law), tmp_path / "s", IN_THREADS)
    with pytest.raises(PlaceError, match="holds another study"):
        run_study(plan_of(None), tmp_path / "s", IN_THREADS)


def test_a_law_that_changes_meanwhile_ends_the_study(law: Path, tmp_path: Path) -> None:
    plan = plan_of(law)
    law.write_text(LAWS + "\n")
    with pytest.raises(mjsheaf.errors.InputError, match="has changed since the study began"):
        run_study(plan, tmp_path / "s", IN_THREADS)
    assert not (tmp_path / "s").exists()


def test_a_law_that_raises_is_a_failed_run(law: Path, tmp_path: Path) -> None:
    study = run_study(plan_of(law, "broken"), tmp_path / "s", IN_THREADS)
    assert {record["status"] for record in study.records} == {"failed"}
    assert all("no such luck" in record["message"] for record in study.records)


def test_a_study_file_names_a_law_from_its_own_directory(law: Path, tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text("scenario: midpoint\nbackend: ideal\nset: {time.end: 0.2}\ncontroller: law.py:wild\n")
    assert answer_of("sweep", path, "--threads", "--out", tmp_path / "s").code == 0
    assert "law.py:wild" in (tmp_path / "s" / "table.csv").read_text()
    path.write_text("scenario: midpoint\ncontroller: ../law.py:wild\n")
    assert is_refusal(answer_of("sweep", path, "--out", tmp_path / "t"), "controller", "lies outside")


@pytest.mark.parametrize("kept", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_page_names_the_best_point_and_runs_that_have_not_converged(kept: bool, tmp_path: Path) -> None:
    """The higher gain has the smaller error; after half a second neither has converged. No sentence is long."""
    study = run_study(small_plan((0.5, 2.0), None, trajectories=kept), tmp_path / "s", IN_THREADS)
    page = (tmp_path / "s" / "index.html").read_text()
    errors = [record["final"]["tracking_error"] for record in study.records]
    assert errors[1] < errors[0]
    assert f"controller.gain = 2. Its tracking error is {errors[1]:.4g} m at the last sample." in page
    moving = sum(record["settled"] is False for record in study.records)
    assert moving
    assert f"{moving} of 2 runs had not converged at the end" in page
    assert ("controller.gain=2.0" in page) is not kept  # in a command, where there is no replay
    assert "<h1>midpoint over controller.gain</h1>" in page
    assert ("--trajectories" in page) is not kept
    assert ('<a href="trajectories/000001.html">Replay run 1</a>' in page) is kept
    replay = tmp_path / "s" / "trajectories" / "000001.html"
    assert replay.exists() is kept
    assert not kept or "gain 2 1/s" in said_in(replay.read_bytes())["facts"]["law"]
    items = re.findall(r"<li>(.*?)</li>", page) + re.findall(r"<p>(.*?)</p>", page)
    texts = [re.sub(r"<code>.*?</code>|<[^>]*>", "", item) for item in items]
    assert len(texts) > 5
    assert max(len(sentence.split()) for text in texts for sentence in text.split(". ")) <= 35


def test_the_title_is_the_summary_or_the_name(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text("scenario: midpoint\nsummary: a question\n")
    assert load_plan(str(path)).title == "a question"
    path.write_text("scenario: midpoint\nname: A title\nsummary: a question\n")
    assert load_plan(str(path)).title == "A title"
