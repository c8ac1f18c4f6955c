"""`make demo`, `.ci/run` and what installs, with stand-ins for the commands that they call.

Oracle: what the stand-ins left, and whether they were called.
"""

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.builders import REPOSITORY


def stand_in(folder: Path, name: str, script: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


@pytest.mark.skipif(shutil.which("make") is None, reason="no make")
@pytest.mark.parametrize("drawn", [True, False])
def test_demo_names_a_video_only_where_there_is_one(drawn: bool, tmp_path: Path) -> None:
    out, stamp = tmp_path / "out", tmp_path / "installed"
    stamp.touch()
    stand_in(tmp_path / "bin", "mjsheaf", f"mkdir {out}; {f'touch {out}/video.mp4' if drawn else 'true'}")
    variables = [f"BIN={tmp_path / 'bin'}", f"DEMO={out}", f"STAMP={stamp}"]
    done = subprocess.run(
        ["make", "-C", str(REPOSITORY), "demo", *variables], capture_output=True, text=True, check=True
    )
    assert (f"video   {out}/video.mp4" in done.stdout) == drawn
    assert ("video   none" in done.stdout) != drawn
    assert f"{out}/result.nc" in done.stdout


@pytest.mark.parametrize("installed", [True, False])
def test_integration_installs_opengl_only_where_it_is_missing(installed: bool, tmp_path: Path) -> None:
    folder, called, made = tmp_path / "bin", tmp_path / "called", tmp_path / "made"
    stand_in(folder, "id", "echo 0")
    stand_in(folder, "make", f'echo "$@" >> {made}')
    stand_in(folder, "apt-get", f"touch {called}")
    for name in ("chromium", "npm"):
        stand_in(folder, name, "true")
    # What is looked for comes first and much follows: a reader that leaves then breaks the pipe.
    stand_in(folder, "ldconfig", ("echo libEGL_mesa.so.0; " if installed else "") + "seq 200000")
    environment = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"}
    subprocess.run([str(REPOSITORY / ".ci" / "run")], env=environment, capture_output=True, check=True)
    assert called.exists() != installed
    goals = made.read_text().splitlines()
    assert "test-ci" in goals
    assert any(" lint " in goal and goal.endswith(" check-bundle") for goal in goals)
    assert sum(goal.startswith("docs") for goal in goals) == 1


def test_uv_looks_where_pip_does() -> None:
    settings_for_uv = runpy.run_path(str(REPOSITORY / "tools" / "install.py"))["settings_for_uv"]
    settings = [
        (":env:", "find-links", "/wheels /more"),
        ("global", "constraint", "/of/everybody.txt"),
        ("global", "extra-index-url", "\none\ntwo"),
        ("global", "find-links", "/not/these"),
        ("global", "index-url", "everybody"),
        ("global", "timeout", "60"),
        ("install", "index-url", "mirror"),
        ("download", "index-url", "elsewhere"),
    ]
    listed = "".join(f"{section}.{name}={value!r}\n" for section, name, value in settings)
    found = {
        "UV_INDEX_STRATEGY": "unsafe-best-match",
        "UV_DEFAULT_INDEX": "mirror",
        "UV_INDEX": "one two",
        "UV_FIND_LINKS": "/wheels,/more",
        "UV_CONSTRAINT": "constraints.txt /of/everybody.txt",
    }
    assert settings_for_uv(listed, {}) == found
    given = {"UV_INDEX": "mine"}
    assert settings_for_uv(listed, {**given, "HOME": "/home"}) == found | given
    assert settings_for_uv("", {}) == {"UV_INDEX_STRATEGY": "unsafe-best-match", "UV_CONSTRAINT": "constraints.txt"}


@pytest.mark.parametrize("found", [True, False])
def test_pip_installs_what_uv_does_not_find(found: bool, tmp_path: Path) -> None:
    called = tmp_path / "called"
    stand_in(tmp_path / "bin", "uv", f"echo uv >> {called}; exit {0 if found else 1}")
    stand_in(tmp_path / "bin", "python", f'case "$*" in *config*) ;; *) echo pip >> {called};; esac')
    call = "import runpy, sys; sys.executable = sys.argv.pop(); runpy.run_path(sys.argv[0], run_name='__main__')"
    program = [sys.executable, "-c", f"import sys; sys.argv = sys.argv[1:]; {call}"]
    arguments = map(str, (REPOSITORY / "tools" / "install.py", ".", tmp_path / "bin" / "python"))
    done = subprocess.run([*program, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert called.read_text().split() == (["uv"] if found else ["uv", "pip"])
