"""Lines of progress where there is no terminal. Oracle: a clock that the test turns."""

import io
import sys
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from numba.core import event

from mjsheaf.cli import terminal


def test_what_takes_long_has_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setattr("time.monotonic", lambda: now)
    with terminal.progress_bars() as report:
        for done in range(1, 101):
            now += 1.0
            report("drawing video", done, 100)
    assert err.getvalue() == ""  # which is for the one line of an error
    lines = out.getvalue().splitlines()
    assert len(lines) == int(100.0 / terminal.BETWEEN_LINES)
    assert all(line.startswith("drawing video: ") and "of 100 (" in line for line in lines)
    shares = [int(line.split()[2]) for line in lines]
    assert shares == sorted(set(shares))


def test_what_is_short_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    with terminal.progress_bars() as report:
        for done in range(1000):
            report("simulating", done, 1000)
    assert (out.getvalue(), err.getvalue()) == ("", "")


def test_what_prints_json_says_nothing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    with terminal.progress_bars(lines=False) as report:
        for done in range(100):
            now += 10.0
            report("measuring", done, 100)
    assert capsys.readouterr() == ("", "")


class Screen(io.StringIO):
    """Stands for a terminal."""

    def isatty(self) -> bool:
        return True


def wait_until(condition: Callable[[], bool]) -> None:
    begun = time.monotonic()
    while not condition():
        assert time.monotonic() - begun < 10.0
        time.sleep(0.02)


@pytest.mark.parametrize("terminal_there", [True, False])
def test_compiling_is_shown_within_a_second(terminal_there: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the bar of a terminal; elsewhere on stdout, once in a while."""
    assert terminal.BETWEEN_LOOKS < 1.0
    out: Any = io.StringIO()
    err: Any = Screen() if terminal_there else io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setenv("TERM", "xterm")
    data = {"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__="elsewhere"))}
    shown = err if terminal_there else out
    with terminal.progress_bars():
        event.start_event("numba:compile", data=data)
        wait_until(lambda: "compiling loops" in shown.getvalue())
        event.end_event("numba:compile", data=data)
    if not terminal_there:
        assert err.getvalue() == ""
        assert out.getvalue().count("\n") == 1
