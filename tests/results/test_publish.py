"""Writing the directory of a run from data in memory.

Oracle: the directory that `execute` leaves of the same run, byte for byte but for the time that it took.
"""

import json
from pathlib import Path

import pytest

from mjsheaf import simulate
from mjsheaf.errors import PlaceError
from mjsheaf.runs.publish import execute, publish
from mjsheaf.scenario import load_scenario

TIMES = ("wall_time_s", "realtime_factor")


@pytest.mark.parametrize(("backend", "law"), [("ideal", {}), ("physics", {}), ("ideal", {"rounds": 2})])
def test_data_in_memory_leave_what_a_run_leaves(backend: str, law: dict[str, int], tmp_path: Path) -> None:
    """Over 2,048 samples, which a run writes in two pieces; what agents send is counted over both."""
    scenario = load_scenario("midpoint", {"time.end": 21.0} | ({"controller.newton": law} if law else {}))
    execute(scenario, backend, tmp_path / "run", video=None)
    saved = publish(simulate(scenario, backend), scenario, scenario.system, tmp_path / "saved")
    assert saved.replaced is None
    names = sorted(path.name for path in (tmp_path / "run").iterdir())
    assert sorted(path.name for path in saved.directory.iterdir()) == names
    for name in set(names) - {"summary.json"}:
        assert (saved.directory / name).read_bytes() == (tmp_path / "run" / name).read_bytes(), name
    run, own = (json.loads((tmp_path / d / "summary.json").read_text()) for d in ("run", "saved"))
    assert list(own) == list(run)
    assert {key for key in run if run[key] != own[key]} == set(TIMES)
    rounds, period = law.get("rounds", 0), scenario.system.grid.period
    assert run["communication"]["exchanges_per_second"] == pytest.approx(rounds / period)
    assert [own[key] for key in TIMES] == [None, None]
    assert all(run[key] > 0.0 for key in TIMES)


def test_data_in_memory_never_replace_what_is_not_a_run(tmp_path: Path) -> None:
    scenario = load_scenario("midpoint", {"time.end": 0.1})
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(PlaceError):
        publish(simulate(scenario, "ideal"), scenario, scenario.system, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
