"""A rerun replaces the run of the same scenario and says so, never another scenario's in the default directory.

Oracle: the contract on DIR; what lies on the disk afterwards.
"""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from mjsheaf import load_scenario
from mjsheaf.errors import ScenarioError
from tests.builders import refused
from tests.commands import Answer, all_contents, answer_of, is_refusal

pytestmark = pytest.mark.usefixtures("without_plots")

TINY = """\
name: same
time: {end: 0.1}
agents: [{id: A, position: [0, 0]}]
targets: [{id: T, position: [3, 4]}]
sensing: [[A, T]]
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory with two files of one name."""
    home = tmp_path / "project"
    (home / "b").mkdir(parents=True)
    (home / "a.yaml").write_text(TINY)
    (home / "b" / "other.yaml").write_text(TINY.replace("3, 4", "5, 6"))
    monkeypatch.chdir(home)
    return home


def run(*arguments: str) -> Answer:
    return answer_of("run", *arguments, "--backend", "ideal", "--no-video")


def summary(directory: str = "runs/same-ideal") -> dict[str, object]:
    loaded: dict[str, object] = json.loads((Path(directory) / "summary.json").read_text())
    return loaded


@pytest.mark.slow
def test_a_rerun_replaces_its_own_and_says_so(project: Path) -> None:
    first = run("a.yaml")
    assert first.code == 0
    assert "replaced" not in first.out
    assert summary()["origin"] == "../../a.yaml"
    resolved = ["runs/same-ideal/scenario.yaml"]
    for again in (["a.yaml"], ["a.yaml", "--seed", "3"], ["b/../a.yaml"], [str(project / "a.yaml")], resolved):
        answer = run(*again)
        assert answer.code == 0
        assert "replaced the run of 20" in answer.out


def test_another_scenario_of_the_same_name_is_left_alone(project: Path) -> None:
    assert run("a.yaml").code == 0
    kept = all_contents(Path("runs"))
    assert is_refusal(run("b/other.yaml"), "runs/same-ideal", "a.yaml", "b/other.yaml", "--out")
    assert all_contents(Path("runs")) == kept
    assert run("b/other.yaml", "--out", "runs/same-ideal").code == 0  # the user says so
    assert summary()["origin"] == "../../b/other.yaml"


def test_a_name_of_mjsheafs_own_is_no_file(project: Path) -> None:
    assert run("midpoint", "--set", "time.end=0.1").code == 0
    assert summary("runs/midpoint-ideal")["origin"] == "midpoint"
    (project / "mine.yaml").write_text(TINY.replace("same", "midpoint"))
    assert is_refusal(run("mine.yaml"), "midpoint", "mine.yaml")


def test_view_takes_a_name_for_a_scenario_where_a_directory_holds_no_run(project: Path) -> None:
    for name in ("midpoint", "mine"):
        (project / name).mkdir()
    assert is_refusal(answer_of("view", "midpoint", "--speed", "3"), "--speed 3")
    assert is_refusal(answer_of("view", "mine", "--speed", "3"), "mine", "holds no result.nc")


def test_a_project_may_be_moved(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run("a.yaml").code == 0
    monkeypatch.chdir(project.parent)
    moved = project.rename(project.parent / "moved")
    monkeypatch.chdir(moved)
    assert run("a.yaml").code == 0


def test_a_run_from_before_origins_were_kept_is_replaced(project: Path) -> None:
    assert run("a.yaml").code == 0
    old = summary()
    del old["origin"]
    Path("runs/same-ideal/summary.json").write_text(json.dumps(old))
    assert run("b/other.yaml").code == 0


def test_a_comparison_keeps_its_place_likewise(project: Path) -> None:
    """Without the cost of two comparisons: what a run of another scenario left stands in the way."""
    assert run("a.yaml").code == 0
    shutil.move("runs/same-ideal", "runs/same-compare")
    assert is_refusal(answer_of("compare", "b/other.yaml", "--no-video"), "b/other.yaml", "--out")


def test_a_mapping_is_a_scenario() -> None:
    fields: dict[str, Any] = {
        "agents": [{"id": "A", "position": (0, 0)}],
        "targets": [{"id": "T", "position": [1, 1]}],
        "sensing": [["A", "T"]],
    }
    scenario = load_scenario(fields, {"controller.gain": 3})
    assert (scenario.name, scenario.controller.gain) == ("scenario", 3.0)
    assert load_scenario({**fields, "name": "mine"}).name == "mine"
    assert "name" not in fields
    with refused(ScenarioError, "gian"):
        load_scenario({**fields, "gian": 3})
    for wrong in (None, 3, [fields], b"paper", scenario):
        with refused(ScenarioError, "mapping", type(wrong).__name__):
            load_scenario(wrong)  # type: ignore[arg-type]
