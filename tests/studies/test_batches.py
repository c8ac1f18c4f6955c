"""Runs of a study in a batch have the records of separate runs.

A batch runs here on threads of this machine, instead of a GPU.
"""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mjsheaf.checking.finished import bound_ahead
from mjsheaf.errors import InputError, ScenarioError
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import read_scenario
from mjsheaf.simulation.batch import Batch
from mjsheaf.studies import load_plan, run_study
from mjsheaf.studies.batches import Batches, _bounds_of
from mjsheaf.studies.job import Job, run_job
from mjsheaf.studies.schema import Point
from tests.builders import REPOSITORY, refused
from tests.commands import answer_of, call, is_refusal

SHORT = {"time.end": 1.0, "physics.contacts": False, "disturbance": {"agents": {"bound": 0.2}}}
SEA = {"significant_height": 0.2, "peak_period": 6.0, "spreading": "cos2"}
KNOWN = "tracking_error", "mean_disagreement"


def jobs_of(source: str, points: list[dict[str, Any]], seeds: list[int]) -> list[Job]:
    numbered = [(changes, seed) for changes in points for seed in seeds]
    read = read_scenario(source)
    return [
        Job(Point(k, changes, seed), source, read, SHORT, "/", "physics", "fused")
        for k, (changes, seed) in enumerate(numbered)
    ]


def together(jobs: list[Job]) -> dict[int, dict[str, Any]]:
    batches = Batches(Batch.each, "C")
    return {result.record["run"]: result.record for result in batches.run(jobs)}


def test_records_of_a_batch_are_those_of_runs_alone() -> None:
    """Of seeds and gains, among them one that blows up and one that no scenario takes, and a second team."""
    points = [{"controller.gain": 1.0}, {"controller.gain": 1e4}, {"controller.gain": -1.0}]
    points += [{"controller.gain": 2.0, "controller.control_period": 0.02}]
    jobs = jobs_of("certified", points, [0, 3])
    found = together(jobs)
    assert sorted(found) == list(range(8))
    statuses = []
    for job in jobs:
        alone, record = run_job(job).record, found[job.point.number]
        statuses.append(alone["status"])
        for name in ("run", "parameters", "seed", "status", "message", "numbers_per_agent_second"):
            assert record[name] == alone[name]
        assert record["settled"] == (None if alone["status"] == "finished" else alone["settled"])
        for part in ("final", "late"):
            assert (record[part] is None) == (alone[part] is None)
            for name in KNOWN if alone[part] else ():
                assert record[part][name] == pytest.approx(alone[part][name], rel=1e-12)
        assert record.keys() == alone.keys()
        for name in ("bound_ratio", "late_bound_ratio") if alone["bound_ratio"] is not None else ():
            assert record[name] == pytest.approx(alone[name], rel=1e-6)
    assert statuses == ["finished"] * 2 + ["unstable"] * 2 + ["invalid"] * 2 + ["finished"] * 2
    assert found[0]["bound_ratio"] is not None
    assert found[0]["final"] != found[1]["final"]


def test_a_team_that_begins_and_stays_at_its_goal_uses_nothing_of_the_bound() -> None:
    """Rounding over a bound of nearly nothing is neither beyond it nor no number."""
    still = {
        "name": "still",
        "agents": [{"id": "A", "position": [1.0, 2.0]}],
        "targets": [{"id": "T", "position": [1.0, 2.0]}],
        "sensing": [["A", "T"]],
        "controller": {"gain": 1.0},
        "time": {"end": 0.5},
    }
    job = Job(Point(0, {}, 0), "still", still, {}, "/", "physics", "fused")
    alone, record = run_job(job).record, together([job])[0]
    for name in ("bound_ratio", "late_bound_ratio"):
        assert record[name] == pytest.approx(alone[name], abs=1e-3)
        assert 0.0 <= record[name] < 1e-3


def test_a_record_does_not_depend_on_the_runs_beside_it() -> None:
    jobs = jobs_of("certified", [{"controller.gain": 1.0}], [0, 3, 4])
    several = together(jobs)
    assert several[0]["bound_ratio"] is not None
    for job in jobs:
        assert together([job]) == {job.point.number: several[job.point.number]}


@pytest.mark.parametrize(
    "moving",
    [
        {"flow.agents.tide": {"amplitude": 0.3, "period": 60.0}},
        {"flow": {"water": {"dimension": 2, "waves": {"kind": "jonswap", **SEA}}}},
    ],
    ids=["tide", "waves"],
)
def test_what_moves_in_the_medium_counts_once_in_the_bound_and_for_its_own_run(moving: dict[str, Any]) -> None:
    """The bound of a run in a batch is that of the run alone, but for the rounding of disturbances."""
    runs: list[Any] = [SimpleNamespace(system=job.load().system) for job in jobs_of("certified", [moving], [0, 3])]
    several = _bounds_of(runs, Event())
    for run, bound in zip(runs, several, strict=True):
        alone = bound_ahead(run.system)
        assert alone is not None
        np.testing.assert_allclose(bound, alone, rtol=1e-6)
        np.testing.assert_array_equal(bound, _bounds_of([run], Event())[0])
    assert (several[0] == several[1]).all() == ("flow.agents.tide" in moving)  # which no seed changes


def test_a_run_with_events_is_refused_and_others_are_not() -> None:
    lost = {"events": [{"time": 0.5, "lose": "A1"}]}
    records = together(jobs_of("certified", [{}, lost], [0]))
    assert [records[k]["status"] for k in (0, 1)] == ["finished", "invalid"]
    assert records[1]["message"].startswith("events")


def test_the_next_batch_is_prepared_while_one_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first run does not end before the second is loaded, nor is the third loaded then; a stop loads no more."""
    loaded, load, second = list[int](), Job.load, Event()

    def noted(job: Job) -> Scenario:
        loaded.append(job.point.number)
        if job.point.number == 1:
            second.set()
        return load(job)

    def run(batch: Batch) -> Generator[int]:
        assert second.wait(60.0)
        yield from batch.each()

    monkeypatch.setattr(Job, "load", noted)
    results = Batches(run, "C", most=1).run(jobs_of("certified", [{}], list(range(6))))
    assert next(results).record["status"] == "finished"
    assert loaded == [0, 1]
    results.close()
    assert loaded == [0, 1]


@pytest.mark.parametrize("gone", [False, True])
def test_a_file_that_changes_during_a_study_ends_it(gone: bool, tmp_path: Path) -> None:
    """Runs that ended before are kept; none is made of another file than study.json names."""
    for path in sorted((REPOSITORY / "models").glob("hull.*")):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    own = tmp_path / "hull.xml"
    overrides = {**SHORT, "vehicles.agents": str(tmp_path / "hull.yaml")}
    plan = load_plan("midpoint", seeds=(0, 4), overrides=overrides, batch=True)
    assert str(own) in plan.files
    results = Batches(Batch.each, "C", most=1).run(plan.job(point) for point in plan.points)
    assert next(results).record["status"] == "finished"
    if gone:
        own.unlink()
    else:
        own.write_text(own.read_text() + "<!-- edited -->")
    with refused(InputError, "hull.xml", "changed"):
        list(results)
    with refused(InputError, "hull.xml", "changed"):
        run_job(plan.job(plan.points[3]))


def test_a_study_that_no_batch_takes_is_refused_before_it_begins() -> None:
    with refused(ScenarioError, "range, bearing or directed edges"):
        load_plan("range_formation", seeds=(0, 3), batch=True)


def test_a_study_on_a_batch_has_its_table_and_plots(tmp_path: Path) -> None:
    @contextmanager
    def batches() -> Any:
        yield Batches(Batch.each, "C")

    plan = load_plan("midpoint", seeds=(0, 3), overrides=SHORT, device="gpu")
    assert plan.study.engine == "fused"
    assert plan.record()["asked"]["device"] == "gpu"
    study = run_study(plan, tmp_path / "study", batches)
    assert [record["status"] for record in study.records] == ["finished"] * 3
    assert "table.csv" in study.files
    assert "tracking_error" in (tmp_path / "study" / "table.csv").read_text()


@pytest.mark.slow
def test_runs_of_a_batch_are_on_threads(tmp_path: Path) -> None:
    """The same bytes on one and on two, and after a stop in mid-study; how a run ended is not judged."""
    given = ["--seeds", "0:70", "--set", "time.end=0.2", "--set", "disturbance.agents.bound=0.3"]
    for out, more in (("one", ["--workers", "1"]), ("two", [])):
        assert call("sweep", "midpoint", "--batch", *given, "--out", str(tmp_path / out), *more) == 0
    one, two = ((tmp_path / name / "table.csv").read_bytes() for name in ("one", "two"))
    assert one == two
    for number in (0, 3, 69):
        (tmp_path / "two" / "runs" / f"{number:06d}.json").unlink()
    assert call("sweep", "midpoint", "--batch", *given, "--out", str(tmp_path / "two")) == 0
    assert (tmp_path / "two" / "table.csv").read_bytes() == one
    rows = one.decode().splitlines()
    assert len(set(rows)) == 71
    with refused(ScenarioError, "batch", "fused"):
        load_plan("midpoint", batch=True, engine="mujoco")
    answer = answer_of("sweep", "midpoint", "--batch", "--scheduler", "tcp://a:1", "--out", tmp_path / "no")
    assert is_refusal(answer, "--scheduler", "--batch")


def test_what_a_card_cannot_do_is_refused_by_its_field() -> None:
    with refused(ScenarioError, "device", "fused"):
        load_plan("midpoint", device="gpu", engine="mujoco")
    with refused(ScenarioError, "trajectories", "cpu"):
        load_plan("midpoint", device="gpu", trajectories=True)
    with refused(ScenarioError, "fused", "ideal"):
        load_plan("midpoint", device="gpu", backend="ideal")
    assert "device" not in load_plan("midpoint").record()["asked"]


def test_sweep_says_in_a_line_that_there_is_no_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is written."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    out = tmp_path / "study"
    for given, named in (((), "numba-cuda"), (("--workers", "2"), "workers"), (("--engine", "mujoco"), "fused")):
        answer = answer_of("sweep", "midpoint", "--device", "gpu", "--out", out, *given)
        assert is_refusal(answer, "gpu", named)
        assert not out.exists()
