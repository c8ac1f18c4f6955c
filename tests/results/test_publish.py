"""Writing the directory of a run from data in memory.

Oracle: the directory that `execute` leaves of the same run, byte for byte but for the time that it took.
"""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Condition, get_ident
from types import SimpleNamespace
from typing import Any

import pytest
import xarray as xr
from matplotlib.mathtext import MathTextParser

from mjsheaf import simulate
from mjsheaf.errors import PlaceError
from mjsheaf.runs.publish import TimedIterator, execute, publish
from mjsheaf.scenario import load_scenario
from mjsheaf.video import available_backend
from mjsheaf.video.from_run import video_options

TIMES = ("wall_time_s", "realtime_factor")


@pytest.mark.parametrize(
    ("backend", "law"),
    [pytest.param("ideal", {}, marks=pytest.mark.slow), ("physics", {}), ("ideal", {"rounds": 2})],
)
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


@pytest.mark.slow
def test_plots_and_film_never_parse_formulas_at_the_same_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """matplotlib's parser is one for all threads and knows none. Each thread waits in it at first for another."""
    backend, reason = available_backend()
    if backend is None:
        pytest.skip(reason)
    inside, within, seen, met = Condition(), list[int](), set[int](), list[set[int]]()
    parse = MathTextParser.parse

    def watched(parser: "MathTextParser[Any]", *args: Any, **named: Any) -> Any:
        me = get_ident()
        with inside:
            within.append(me)
            inside.notify_all()
            if len({*within}) > 1:
                met.append({*within})
            elif me not in seen:
                seen.add(me)
                inside.wait_for(lambda: bool(met), timeout=1.0)
            seen.add(me)
        try:
            return parse(parser, *args, **named)
        finally:
            with inside:
                within.remove(me)

    monkeypatch.setattr(MathTextParser, "parse", watched)
    scenario = load_scenario("paper", {"time.end": 1.0})
    small = video_options(scenario, width=160, height=120, fps=5)
    outcome = execute(scenario, "ideal", tmp_path / "run", video=small)
    assert outcome.summary["video"] is not None
    assert len(seen) == 2
    assert met == []


def test_the_time_of_a_run_is_without_that_of_compiling() -> None:
    """Also where a function is compiled on the way to another."""
    from numba.core import event

    pause = 0.05  # s

    def pieces() -> Iterator[xr.Dataset]:
        nested = {"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__="elsewhere"))}
        for _ in range(2):
            event.start_event("numba:compile", data=nested)
        time.sleep(pause)
        for _ in range(2):
            event.end_event("numba:compile", data=nested)
        yield xr.Dataset()

    timed = TimedIterator(pieces())
    begun = time.perf_counter()
    next(timed)
    assert time.perf_counter() - begun >= pause
    assert 0.0 <= timed.seconds <= time.perf_counter() - begun - pause
