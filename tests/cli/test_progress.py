"""Progress of a command: a bar on a terminal, lines on stdout elsewhere. Oracle: what the streams receive, and when."""

import io
import sys
import time
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba.core import event

from mjsheaf import progress
from mjsheaf.cli import options
from mjsheaf.compile import jit
from tests.commands import wait_until


def redirect(monkeypatch: pytest.MonkeyPatch, err: io.StringIO) -> tuple[io.StringIO, io.StringIO]:
    out = io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    return out, err


def test_there_is_a_line_within_a_second_and_every_two_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    assert progress.DELAY < 1.0
    assert progress.BETWEEN_LINES + progress._INTERVAL <= 2.2
    now = 0.0
    printed: list[float] = []
    monkeypatch.setattr("builtins.print", lambda *_, **__: printed.append(now))
    with progress.in_lines(sys.stdout) as update:
        for now in np.arange(0.0, 10.0, 0.1).tolist():
            update("working", 0, 0, now)
    assert printed[0] == 0.0
    assert max(b - a for a, b in pairwise(printed)) < 2.15
    assert len(printed) == 5


def test_lines_say_how_far_the_work_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "DELAY", 0.0)
    monkeypatch.setattr(progress, "BETWEEN_LINES", 0.0)
    out, err = redirect(monkeypatch, io.StringIO())
    with options.progress_bars("loading") as report:
        wait_until(lambda: "loading, 0 s since the start" in out.getvalue())
        report("drawing video", 30, 120)
        wait_until(lambda: "drawing video 30 of 120 (25 %), " in out.getvalue())
    assert err.getvalue() == ""  # which is for the one line of an error


@pytest.mark.parametrize(("delay", "given"), [(60.0, {}), (0.0, {"lines": None})], ids=["short", "JSON"])
def test_what_is_short_or_prints_json_says_nothing(
    delay: float, given: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    streams = redirect(monkeypatch, io.StringIO())
    monkeypatch.setattr(progress, "DELAY", delay)  # a minute, as a machine may be busy
    with options.progress_bars(**given) as report:
        for done in range(10):
            report("working", done, 10)
            time.sleep(0.03)
    assert [stream.getvalue() for stream in streams] == ["", ""]


class Screen(io.StringIO):
    """Stands for a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("terminal_there", [True, False])
def test_compiling_is_shown_within_a_second(terminal_there: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the bar of a terminal; elsewhere on stdout, once in a while."""
    assert progress.DELAY + progress._INTERVAL < 1.0
    assert not jit.is_compiling()
    out, err = redirect(monkeypatch, Screen() if terminal_there else io.StringIO())
    monkeypatch.setenv("TERM", "xterm")
    data = {"dispatcher": SimpleNamespace(py_func=wait_until)}
    shown = err if terminal_there else out
    with options.progress_bars():
        event.start_event("numba:compile", data=data)
        wait_until(lambda: "compiling the loops" in shown.getvalue())
        event.end_event("numba:compile", data=data)
    if not terminal_there:
        assert err.getvalue() == ""
        assert out.getvalue().count("\n") == 1
