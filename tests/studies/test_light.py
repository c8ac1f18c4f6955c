"""Light records (`batch: true`) are those of whole runs but for the ending. Oracle: the whole record of that run."""

from pathlib import Path
from typing import Any

import pytest

from mjsheaf.errors import ScenarioError
from mjsheaf.scenario.load import read_scenario
from mjsheaf.studies.plan import Plan, Point, StudyFile, load_plan
from mjsheaf.studies.workers import run_job
from tests.builders import refused
from tests.commands import call

SHORT: dict[str, Any] = {"time.end": 1.0, "physics.contacts": False, "disturbance": {"agents": {"bound": 0.2}}}
SEA = {"significant_height": 0.2, "peak_period": 6.0, "spreading": "cos2"}
MOVING: list[dict[str, Any]] = [
    {"flow.agents.tide": {"amplitude": 0.3, "period": 60.0}},
    {"flow": {"water": {"dimension": 2, "waves": {"kind": "jonswap", **SEA}}}},
]


def records_of(source: str, changes: dict[str, Any], seed: int = 0) -> list[dict[str, Any]]:
    """The light record of a point and the whole one."""
    studies = [StudyFile(scenario=source, set=SHORT, engine="fused", batch=light) for light in (True, False)]
    plans = [Plan("study", source, study, read_scenario(source), Path("/"), {}, []) for study in studies]
    return [run_job(plan.job(Point(0, changes, seed))).record for plan in plans]


@pytest.mark.parametrize(
    ("source", "changes", "status"),
    [
        ("certified", {}, "finished"),
        pytest.param("certified", MOVING[0], "finished", marks=pytest.mark.slow),
        pytest.param("certified", MOVING[1], "finished", marks=pytest.mark.slow),
        ("certified", {"controller.gain": 1e4}, "unstable"),
        ("certified", {"controller.gain": -1.0}, "invalid"),
        ("certified", {"events": [{"time": 0.5, "lose": "A1"}]}, "finished"),
        pytest.param("range_formation", {}, "finished", marks=pytest.mark.slow),
        ("air_tracks_surface", {}, "refused"),
    ],
)
def test_a_light_record_is_that_of_the_whole_run(source: str, changes: dict[str, Any], status: str) -> None:
    for seed in (0, 3):  # the second one takes the bound of the first
        light, whole = records_of(source, changes, seed)
        assert light["status"] == status
        assert light.keys() == whole.keys()
        ratios = [(record.pop("bound_ratio"), record.pop("late_bound_ratio")) for record in (light, whole)]
        assert light.pop("ending") is None
        whole.pop("ending")
        assert light.pop("settled") == (None if status == "finished" else whole.pop("settled"))
        whole.pop("settled", None)
        assert light == whole
        if source == "certified" and (not changes or changes in MOVING):
            assert ratios[1][0] is not None
            assert ratios[0] == pytest.approx(ratios[1], rel=1e-6)


def test_a_batch_has_an_engine_and_keeps_no_trajectories() -> None:
    assert load_plan("midpoint", batch=True).study.engine == "fused"
    assert load_plan("midpoint", batch=True).study.batch
    assert "batch" not in load_plan("midpoint").record()["asked"]
    with refused(ScenarioError, "batch", "fused"):
        load_plan("midpoint", batch=True, engine="mujoco")
    with refused(ScenarioError, "trajectories", "batch"):
        load_plan("midpoint", batch=True, trajectories=True)


@pytest.mark.long
def test_a_study_of_light_records_has_its_table(tmp_path: Path) -> None:
    """The same bytes from one worker and two, and after a stop in mid-study."""
    given = ["--seeds", "0:20", "--set", "time.end=0.2", "--set", "disturbance.agents.bound=0.3"]
    for out, more in (("one", ["--workers", "1"]), ("two", ["--threads", "--workers", "2"])):
        assert call("sweep", "midpoint", "--batch", *given, "--out", str(tmp_path / out), *more) == 0
    one, two = ((tmp_path / name / "table.csv").read_bytes() for name in ("one", "two"))
    assert one == two
    assert len(set(one.decode().splitlines())) == 21
    for number in (0, 3, 19):
        (tmp_path / "two" / "runs" / f"{number:06d}.json").unlink()
    assert call("sweep", "midpoint", "--batch", *given, "--threads", "--out", str(tmp_path / "two")) == 0
    assert (tmp_path / "two" / "table.csv").read_bytes() == one
