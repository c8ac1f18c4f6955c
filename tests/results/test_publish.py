"""Writing the directory of a run from data in memory.

Oracle: the directory that `execute` leaves of the same run, byte for byte but for the time that it took.
"""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import xarray as xr

from mjsheaf import simulate
from mjsheaf.errors import PlaceError
from mjsheaf.results.store import open_run
from mjsheaf.runs.publish import Timings, execute, publish
from mjsheaf.scenario import Scenario, load_scenario
from mjsheaf.video.film import video_options
from tests.commands import RUN_FILES

TIMES = ("wall_time_s", "realtime_factor", "timings")


@pytest.fixture
def short() -> Scenario:
    return load_scenario("midpoint", {"time.end": 0.1})


@pytest.mark.long
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
    assert own["wall_time_s"] is own["realtime_factor"] is None
    assert run["wall_time_s"] > 0.0
    assert run["realtime_factor"] > 0.0


@pytest.mark.slow
def test_timings_say_where_the_time_went(short: Scenario, tmp_path: Path) -> None:
    begun = time.perf_counter()
    summary = execute(short, "ideal", tmp_path / "run", video=None).summary
    elapsed = time.perf_counter() - begun
    timings = dict(summary["timings"])
    assert timings.keys() == {
        "checks", "simulation", "data", "bounds", "notes", "plots", "page", "compilation", "total",
    }  # fmt: skip
    assert timings["simulation"] == summary["wall_time_s"]
    total = timings.pop("total")
    assert min(timings.values()) >= 0.0
    assert 0.5 * elapsed < sum(timings.values()) <= total * (1.0 + 1e-9) <= elapsed * (1.0 + 1e-9)


def drawn_by(draw: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a function of a path stand for what draws videos."""
    monkeypatch.setattr("mjsheaf.video.draw.available_backend", lambda: ("none", ""))
    monkeypatch.setattr("mjsheaf.video.draw.draw_video", lambda films, path, *_: draw(path))


@pytest.mark.slow
def test_the_run_is_there_before_its_video(short: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole: it can be opened, and says that it has no video yet."""
    place = tmp_path / "run"

    def draw(path: Path) -> int:
        assert path == place / "video.mp4"
        assert {p.name for p in place.iterdir()} == RUN_FILES
        with open_run(place) as (dataset, summary):
            assert dataset.sizes["time"] > 1
            assert summary["video"] is None
        path.write_bytes(b"film")
        return 7

    drawn_by(draw, monkeypatch)
    options = video_options(short)
    outcome = execute(short, "ideal", place, video=options)
    assert outcome.summary["video"]["frames"] == 7
    assert json.loads((place / "summary.json").read_text())["video"] == outcome.summary["video"]
    assert {p.name for p in place.iterdir()} == RUN_FILES | {"video.mp4"}


@pytest.mark.long
@pytest.mark.parametrize(
    "error", [KeyboardInterrupt(), SystemExit(), MemoryError(), PlaceError("No space left")], ids=repr
)
def test_what_ends_the_video_leaves_the_run(
    error: BaseException, short: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where it cannot be written, the error says that the run is there."""

    def draw(path: Path) -> int:
        raise error

    drawn_by(draw, monkeypatch)
    said = r"No space left; .*run is complete except for its video, which `mjsheaf" if str(error) else None
    with pytest.raises(type(error), match=said):
        execute(short, "ideal", tmp_path / "run", video=video_options(short))
    assert {p.name for p in (tmp_path / "run").iterdir()} == RUN_FILES
    with open_run(tmp_path / "run") as (_, summary):
        assert summary["video"] is None


def test_the_time_of_a_run_is_without_that_of_compiling() -> None:
    """Also where a function is compiled on the way to another."""
    from numba.core import event

    pause = 0.05  # s

    def pieces() -> Iterator[xr.Dataset]:
        nested = {"dispatcher": SimpleNamespace(py_func=lambda: None)}
        for _ in range(2):
            event.start_event("numba:compile", data=nested)
        time.sleep(pause)
        for _ in range(2):
            event.end_event("numba:compile", data=nested)
        yield xr.Dataset()

    timings = Timings()
    timed = timings.simulating(pieces())
    begun = time.perf_counter()
    next(timed)
    assert time.perf_counter() - begun >= pause
    assert 0.0 <= timings.parts["simulation"] <= time.perf_counter() - begun - pause
