"""Lines of progress where there is no terminal. Oracle: a clock that the test turns."""

import io
import sys

import pytest

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
