"""Running commands in this process, where an attack costs milliseconds, and the laws that hold for all of them."""

import contextlib
import io
import os
import resource
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from mjsheaf.cli import main

IDEAL = ("--backend", "ideal", "--no-video", "--set", "time.end=0.2")
SMALL = ("--set", "video.width=160", "--set", "video.height=120", "--set", "video.fps=5")


class Answer(NamedTuple):
    """What a command said: exit code, stdout, stderr."""

    code: int
    out: str
    err: str


def call(*arguments: str | Path) -> Answer:
    """Run a command; an exception that leaves it fails the test."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    return Answer(int(stopped.value.code or 0), out.getvalue(), err.getvalue())


def is_refusal(answer: Answer, word: str = "") -> bool:
    """Whether a command was refused as the contract says: exit code 2, one line that contains a word."""
    one_line = answer.err.count("\n") == 1 and answer.err.startswith("mjsheaf: ")
    return answer.code == 2 and one_line and word in answer.err


@contextlib.contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """No file of this process, or of those that it starts, grows beyond so many bytes: as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def contents(directory: Path) -> dict[str, bytes]:
    """All files below a directory."""
    return {str(p.relative_to(directory)): p.read_bytes() for p in sorted(directory.rglob("*")) if p.is_file()}


def leftovers(directory: Path) -> list[str]:
    """Hidden files and directories in a directory."""
    return sorted(name for name in os.listdir(directory) if name.startswith("."))


def command_line(*arguments: str | Path) -> list[str]:
    """A command in a process of its own."""
    return [sys.executable, "-m", "mjsheaf", *map(str, arguments)]
