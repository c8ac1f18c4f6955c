"""Choice of OpenGL, and the message if none works. The probes are real child processes."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mjsheaf.errors import MjsheafError
from mjsheaf.video import gl
from mjsheaf.video.gl import available_backend
from tests.commands import drawing

Probe = Callable[[str], None]


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No answer from before, none left behind, and MUJOCO_GL not set."""
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    gl._first_that_works.cache_clear()
    yield
    gl._first_that_works.cache_clear()


@pytest.fixture
def probe(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Probe:
    """Let a script stand for the program that tries to draw; its output goes to a file `tried`."""

    def replace(script: str) -> None:
        path = tmp_path / "probe.py"
        path.write_text(f"import os, sys; tried = open({str(tmp_path / 'tried')!r}, 'a')\n{script}")
        monkeypatch.setattr(gl, "PROBE", path)

    return replace


def test_backend_named_by_the_user_is_the_only_one_tried(
    probe: Probe, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    probe("tried.write(os.environ['MUJOCO_GL'] + ' ')")
    monkeypatch.setenv("MUJOCO_GL", "OSMesa")
    assert available_backend()[0] == "osmesa"
    assert (tmp_path / "tried").read_text().split() == ["osmesa"]


def test_first_that_works_is_taken_and_remembered(
    probe: Probe, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    probe("backend = os.environ['MUJOCO_GL']; tried.write(backend + ' '); sys.exit(backend == 'egl')")
    monkeypatch.setattr(gl, "AUTOMATIC", ("egl", "osmesa"))
    assert available_backend()[0] == "osmesa"
    assert available_backend()[0] == "osmesa"
    assert (tmp_path / "tried").read_text().split() == ["egl", "osmesa"]


def test_none_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl, "AUTOMATIC", ("nonsense", "rubbish"))
    backend, reason = available_backend()
    assert backend is None
    for part in ("nonsense", "rubbish", "libegl1", "libosmesa6"):
        assert part in reason
    assert "\n" not in reason


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("import signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed with signal 11"),
        ("import time; time.sleep(60)", "no picture after 0.3 s"),
        ("sys.exit('some driver\\nis out of order')", "is out of order"),
        ("sys.exit(7)", "exit status 7"),
    ],
)
def test_drivers_that_misbehave(probe: Probe, monkeypatch: pytest.MonkeyPatch, script: str, reason: str) -> None:
    probe(script)
    monkeypatch.setattr(gl, "PROBE_TIMEOUT", 0.3 if "sleep" in script else 30.0)
    monkeypatch.setattr(gl, "AUTOMATIC", ("egl",))
    assert reason in available_backend()[1]


def test_a_library_that_is_missing(probe: Probe, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """PyOpenGL has None in its place."""
    (tmp_path / "mujoco.py").write_text("None.glGetError")
    probe(f"sys.path.insert(0, {str(tmp_path)!r})\n" + gl.PROBE.read_text())
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert "(osmesa: its library is not installed)" in available_backend()[1]


@drawing
@pytest.mark.parametrize("before", [None, "glx"])
def test_environment_is_left_as_it_was(monkeypatch: pytest.MonkeyPatch, before: str | None) -> None:
    if before is None:
        monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    else:
        monkeypatch.setenv("PYOPENGL_PLATFORM", before)
    backend, _ = available_backend()
    assert backend is not None
    gl.open_context(backend, 64, 64).free()
    assert os.environ.get("PYOPENGL_PLATFORM") == before
    assert "MUJOCO_GL" not in os.environ


def test_context_that_cannot_be_opened() -> None:
    with pytest.raises(MjsheafError, match="nonsense"):
        gl.open_context("nonsense", 64, 64)
