"""A command builds its system once, and compiles every vehicle's files once.

Oracle: counts of the calls that build and compile, by what they are called with.
"""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import mjsheaf.scenario.scenario as building
import mjsheaf.team as teams
import mjsheaf.vehicles.loading as loading
from mjsheaf.files import dump_yaml
from mjsheaf.scenario import Scenario, load_scenario
from mjsheaf.studies.workers import run_job
from tests.builders import make_fields, small_plan
from tests.commands import call

BOATS = {"A1": ([0, 0], "otter"), "A2": ([9, 0], "wamv"), "A3": ([0, 9], "otter")}
TEAM = make_fields(
    {id: {"position": place, "vehicle": vehicle} for id, (place, vehicle) in BOATS.items()},
    {"T1": {"position": [5, 5, 5], "vehicle": "x500"}},
    [["A1", "T1"]],
    time={"end": 0.3},
    controller={"gain": 0.5, "control_period": 0.02},
    communication=[["A1", "A2"], ["A2", "A3"]],
    physics={"timestep": 0.004},
    expect={"ideal": {"tracking_error": 1e3}, "physics": {"tracking_error": 1e3}},
)


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often a team was built, and the files of each vehicle compiled."""
    found: Counter[str] = Counter()
    team, compile_vehicle = teams.Team, loading._compile

    def build(*arguments: Any) -> Any:
        found["team"] += 1
        return team(*arguments)

    def compile_counted(path: Path) -> Any:
        found[path.name] += 1
        return compile_vehicle(path)

    monkeypatch.setattr(building, "Team", build)
    monkeypatch.setattr(loading, "_compile", compile_counted)
    loading._shipped.cache_clear()  # vehicles that ship are kept, for all runs of a process
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        ["run", "--no-video", "--out", "out"],
        ["run", "--no-video", "--out", "out", "--backend", "ideal"],
        ["check"],
        ["compare", "--no-video", "--out", "out"],
        ["expect"],
    ],
    ids=" ".join,
)
def test_a_command_builds_and_compiles_once(
    command: list[str], counts: Counter[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("fleet.yaml").write_text(dump_yaml(TEAM))
    assert call(command[0], "fleet.yaml", *command[1:]) == 0
    assert set(counts.values()) == {1}, counts
    assert len(counts) >= 4


def test_a_copy_with_changes_is_built_anew_and_an_equal_one_is_equal() -> None:
    scenario = load_scenario("midpoint", {"spread.position": 1.0})
    other = scenario.model_copy(update={"seed": 7})
    assert other.system is not scenario.system
    assert (other.system.initial != scenario.system.initial).any()
    assert other != scenario
    again = Scenario.model_validate(scenario.model_dump(mode="json"))
    assert again == scenario
    assert (again.system.initial == scenario.system.initial).all()


def test_a_job_of_a_study_does(counts: Counter[str]) -> None:
    plan = small_plan(gains=(1.0,), seeds=None)
    job = plan.job(plan.points[0])
    counts.clear()
    assert run_job(job).record["status"] == "finished"
    assert counts["team"] == 1
    assert set(counts.values()) == {1}
