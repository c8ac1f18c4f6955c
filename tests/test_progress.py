"""Progress bar in Python: shown soon, on a terminal or in a notebook, and nowhere else.

Oracle: stand-ins for a terminal and for IPython's display.
"""

import sys
from types import SimpleNamespace
from typing import Any

import pytest

import mjsheaf
from mjsheaf import progress
from tests.cli.test_progress import Screen
from tests.commands import wait_until


def test_nothing_is_shown_where_there_is_no_terminal(capfd: pytest.CaptureFixture[str]) -> None:
    with progress.shown(True, "working") as bar:
        assert bar is None
    assert capfd.readouterr() == ("", "")


class Handle:
    """Stands for what IPython's `display` returns."""

    def __init__(self) -> None:
        self.shown: list[dict[str, str]] = []

    def update(self, data: dict[str, str], raw: bool) -> None:
        assert raw
        self.shown.append(data)


@pytest.fixture
def notebook(monkeypatch: pytest.MonkeyPatch) -> Handle:
    handle = Handle()
    shell = SimpleNamespace(config={"IPKernelApp": {}})
    display = SimpleNamespace(display=lambda *_, **__: handle)
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell, display=display))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    return handle


def wait_for(handle: Handle, words: str) -> None:
    wait_until(lambda: any(words in data["text/html"] for data in handle.shown), 10.0)


def test_a_notebook_has_a_bar_that_goes_away(notebook: Handle) -> None:
    with progress.shown(True, "working") as bar:
        assert bar is not None
        bar("working", 3, 8)
        wait_for(notebook, 'max="8" value="3"')
        with progress.shown(True, "within") as inner:
            assert inner is None  # one bar at a time
    assert notebook.shown[-1]["text/html"] == ""


def test_what_is_shorter_than_the_delay_shows_nothing(notebook: Handle, monkeypatch: pytest.MonkeyPatch) -> None:
    assert progress.DELAY < 1.0
    monkeypatch.setattr(progress, "DELAY", 60.0)  # of a machine that may be busy
    for _ in range(3):
        mjsheaf.simulate(mjsheaf.load_scenario("midpoint", {"time.end": 0.1}), "ideal")
    assert notebook.shown == []


def test_a_run_has_a_bar_while_it_goes_on(notebook: Handle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "DELAY", 0.0)

    def law(t: float, sample: Any) -> Any:
        wait_for(notebook, "simulating")
        return -sample.disagreement

    mjsheaf.simulate(mjsheaf.load_scenario("midpoint", {"time.end": 0.1}), "ideal", controller=law)


def test_runs_side_by_side_have_one_bar(notebook: Handle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "DELAY", 0.0)
    scenarios = [mjsheaf.load_scenario("midpoint", {"time.end": 5.0, "seed": seed}) for seed in range(4)]
    mjsheaf.simulate_many(scenarios, "ideal", workers=2)
    assert any("running" in data["text/html"] for data in notebook.shown)
    assert not any("simulating" in data["text/html"] for data in notebook.shown)


def test_a_function_is_called_instead_or_nothing(notebook: Handle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "DELAY", 0.0)
    said: list[tuple[int, int]] = []
    scenario = mjsheaf.load_scenario("midpoint", {"time.end": 0.1})
    mjsheaf.simulate(scenario, "ideal", progress=lambda done, total: said.append((done, total)))
    assert said[-1][0] == said[-1][1] > 0
    for nothing in (None, False):
        mjsheaf.simulate(scenario, "ideal", progress=nothing)
    assert notebook.shown == []


def test_an_error_ends_the_bar(notebook: Handle) -> None:
    def fail() -> None:
        with progress.shown(True, "working"):
            wait_for(notebook, "working")
            raise ValueError("mine")

    with pytest.raises(ValueError, match="mine"):
        fail()
    assert notebook.shown[-1]["text/html"] == ""
    with progress.shown(True, "again") as bar:
        assert bar is not None


def test_the_terminal_is_left_clean(monkeypatch: pytest.MonkeyPatch) -> None:
    """The view itself, on a stream that stands for a terminal."""
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(progress, "DELAY", 0.0)
    with progress.shown(True, "working") as bar:
        assert bar is not None
        bar("working", 1, 2)
        wait_until(lambda: "working" in screen.getvalue(), 10.0)
    assert screen.getvalue().endswith("\x1b[2K")  # the line is erased
