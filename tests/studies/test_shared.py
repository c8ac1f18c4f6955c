"""Data that the seeds of a study share are computed once and equal those of each run alone."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.checking.theorem.targets import follow_targets
from mjsheaf.errors import ScenarioError
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import read_scenario, scenario_from_mapping
from mjsheaf.studies.plan import Job, Plan, Point, StudyFile
from tests.builders import ONE_BOAT, altered, find

SHORT: dict[str, Any] = {"time.end": 0.3, "disturbance": {"agents": {"bound": 0.2}}}


def job_of(seed: int | None, source: str = "paper", changes: dict[str, Any] | None = None) -> Job:
    """A run of a study over seeds."""
    study = StudyFile(scenario=source, set=SHORT, backend="ideal")
    plan = Plan("study", source, study, read_scenario(source), Path("/"), {}, [])
    return plan.job(Point(0, changes or {}, seed))


def packed(scenario: Scenario) -> bytes:
    """All that decides how a run goes, but the team, which is its edges in the law."""
    return pickle.dumps([replace(phase.system, team=None) for phase in scenario.phases])  # type: ignore[arg-type]


@pytest.mark.parametrize("source", ["paper", "noisy_odometry", "swarm", "harbour_lost_hexarotor"])
def test_a_seed_gives_the_scenario_that_it_gives_alone(source: str) -> None:
    """Of disturbances, noise, swarms and events; whatever was loaded before."""
    for seed in (3, 0, 3):
        alone = scenario_from_mapping(read_scenario(source), {**SHORT, "seed": seed}, source)
        assert packed(job_of(seed, source).load()) == packed(alone)


def test_seeds_share_the_team_and_points_do_not() -> None:
    one, two = job_of(1).load(), job_of(2).load()
    assert one.team is two.team
    assert spectrum_of(one.team) is spectrum_of(two.team)
    assert packed(one) != packed(two)
    other = job_of(2, changes={"controller.gain": 3.0}).load()
    assert other.team is not two.team
    assert other.system.gain == 3.0


def test_the_path_of_targets_is_kept_for_those_targets_alone() -> None:
    """Agents' disturbances do not touch it; targets' and where they begin do."""
    one, two = job_of(1).load().system, job_of(2).load().system
    path = follow_targets(one)
    assert follow_targets(two) is path
    moved = replace(one, initial=one.initial + 0.1)
    assert follow_targets(moved) is not path
    assert abs(follow_targets(moved).q_star - path.q_star).max() > 0.01
    assert abs(follow_targets(one).q_star - path.q_star).max() == 0.0


def test_a_seed_that_no_scenario_takes_is_refused_as_alone() -> None:
    for changes in ({"seed": -1}, {"seed": -1, "controller.gain": "x"}):
        with pytest.raises(ScenarioError) as alone:
            scenario_from_mapping(read_scenario("paper"), {**SHORT, **changes}, "paper")
        rest = {path: value for path, value in changes.items() if path != "seed"}
        with pytest.raises(ScenarioError, match=r"seed|gain") as shared:
            job_of(-1, changes=rest).load()
        assert str(shared.value) == str(alone.value)


def test_a_file_that_changed_is_read_again(tmp_path: Path) -> None:
    """A worker outlives the studies that it works for; the digests of a job tell their files apart."""
    masses = []
    for mass in ("400", "401"):
        altered(tmp_path, "hull", lambda root, mass=mass: find(root, ".//inertial").set("mass", mass))  # type: ignore[misc]
        scenario = {"name": "boat", **ONE_BOAT, "vehicles": {"agents": str(tmp_path / "hull.yaml"), "targets": "hull"}}
        study = StudyFile(scenario="boat", backend="ideal")
        plan = Plan("study", "boat", study, scenario, Path("/"), {"hull.xml": mass}, [])
        masses.append(plan.job(Point(0, {}, 0)).load().system.vehicles[0].mass)
    assert masses == [400.0, 401.0]
