"""Commands run in this process, where a call costs milliseconds, or in their own; and what they leave on the disk."""

import contextlib
import io
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from mjsheaf.cli import main
from mjsheaf.video.gl import available_backend
from tests.builders import names

IDEAL = ("--backend", "ideal", "--no-video", "--set", "time.end=0.2")
SMALL = ("--set", "video.width=160", "--set", "video.height=120", "--set", "video.fps=5")
CAN_DRAW = available_backend()[0] is not None
drawing = pytest.mark.skipif(not CAN_DRAW, reason="no offscreen OpenGL")
DATA_FILES = {"result.nc", "summary.json", "scenario.yaml", "report.html"}
RUN_FILES = DATA_FILES | {"errors.png", "trajectories.png", "configurations.png"}
"""What `mjsheaf run --no-video` writes."""


Capture = pytest.CaptureFixture[str]


COMPILED = """
from numba.core import event

compiled = []

class Listener(event.Listener):
    def on_start(self, event):
        compiled.append(event.data["dispatcher"].py_func.__qualname__)
    def on_end(self, event):
        pass

event.register("numba:compile", Listener())
"""
"""Begin of a script for `python`: names of the functions that its process compiles."""


class Answer(NamedTuple):
    """Answer of a command: exit code, stdout, stderr."""

    code: int
    out: str
    err: str


Published = Callable[[str, str], tuple[Answer, Path]]


def call(*arguments: str | Path) -> int:
    """Run a command and return its exit code; what it prints is for `capsys`."""
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    return int(stopped.value.code or 0)


def answer_of(*arguments: str | Path) -> Answer:
    """Run a command and return what it said; an exception that leaves it fails the test."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = call(*arguments)
    return Answer(code, out.getvalue(), err.getvalue())


def is_refusal(answer: Answer, *named: object) -> bool:
    """Return True if a command was refused by the contract: exit code 2 and one line that contains all of these."""
    return answer.code == 2 and one_line(answer.err, *named)


def only_errors(text: str) -> bool:
    """Return True if stderr is an error of mjsheaf's: a line for each mistake, at most eleven of them."""
    lines = text.split("\n")[:-1]
    return text.endswith("\n") and 0 < len(lines) <= 11 and all(line.startswith("mjsheaf: ") for line in lines)


def one_line(text: str, *named: object) -> bool:
    """Return True if stderr is one line of mjsheaf's, next to progress, that contains all of these, in any wording."""
    lines = text.splitlines(keepends=True)
    text = "".join(line for line in lines if not line.endswith(" s since the start\n"))
    return text.startswith("mjsheaf: ") and text.count("\n") == 1 and text.endswith("\n") and names(text, *named)


def command_line(*arguments: str | Path) -> list[str]:
    """A command in a process of its own."""
    return [sys.executable, "-m", "mjsheaf", *map(str, arguments)]


def start(*arguments: str | Path, **options: Any) -> "subprocess.Popen[str]":
    """Start a command whose output is read at its end, with SIGINT as a terminal's shell gives it."""
    return subprocess.Popen(
        command_line(*arguments),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
        **options,
    )


def python(script: str, cwd: Path | None = None, **environment: str) -> "subprocess.CompletedProcess[str]":
    """Run a script in a process of its own, with signals as in a shell."""
    return subprocess.run(
        [sys.executable, "-c", script],
        cwd=cwd,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=heed_interrupts,
    )


def heed_interrupts() -> None:
    """Stop ignoring signals in a new process: SIGINT is ignored in a shell's background, SIGHUP by `nohup`."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def wait_until(
    condition: Callable[[], object], seconds: float = 90.0, running: "subprocess.Popen[str] | None" = None
) -> None:
    """Wait for a condition, for at most so long and while a process goes on that is to bring it about."""
    end = time.monotonic() + seconds
    while not condition():
        assert running is None or running.poll() is None, ("it ended before", running.communicate())
        assert time.monotonic() < end, f"not within {seconds} s"
        time.sleep(0.01)


@contextlib.contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Limit the size of files of this process and its children, in bytes, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def contents(directory: Path) -> dict[str, bytes]:
    """All that equal runs, and equal studies, have alike: every file but a study's timings and lock."""
    return {
        name: data for name, data in all_contents(directory).items() if Path(name).name not in ("timings.csv", ".lock")
    }


def all_contents(directory: Path) -> dict[str, bytes]:
    """Every file below a directory."""
    return {str(p.relative_to(directory)): p.read_bytes() for p in sorted(directory.rglob("*")) if p.is_file()}


def leftovers(directory: Path) -> list[str]:
    """Hidden files and directories in a directory."""
    return sorted(name for name in os.listdir(directory) if name.startswith("."))
