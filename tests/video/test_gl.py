"""Choice of OpenGL, and the message if none works. The probes are real child processes."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from mjsheaf.errors import MjsheafError
from mjsheaf.video import available_backend, gl


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No answer from before, none left behind, and MUJOCO_GL not set."""
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    gl._first_that_works.cache_clear()
    yield
    gl._first_that_works.cache_clear()


def test_answer_is_usable() -> None:
    backend, reason = available_backend()
    assert backend in (*gl.AUTOMATIC, None)
    assert reason
    assert "\n" not in reason


def test_backend_named_by_the_user_is_the_only_one_tried(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    tried = tmp_path / "tried"
    probe = tmp_path / "probe.py"
    probe.write_text(f"import os; open({str(tried)!r}, 'a').write(os.environ['MUJOCO_GL'] + ' ')")
    monkeypatch.setattr(gl, "PROBE", probe)
    monkeypatch.setenv("MUJOCO_GL", "OSMesa")
    assert available_backend()[0] == "osmesa"
    assert tried.read_text().split() == ["osmesa"]


def test_first_that_works_is_taken_and_remembered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    tried = tmp_path / "tried"
    probe = tmp_path / "probe.py"
    tell = f"import os, sys; backend = os.environ['MUJOCO_GL']; open({str(tried)!r}, 'a').write(backend + ' ')"
    probe.write_text(f"{tell}; sys.exit(backend == 'egl')")
    monkeypatch.setattr(gl, "PROBE", probe)
    monkeypatch.setattr(gl, "AUTOMATIC", ("egl", "osmesa"))
    assert available_backend()[0] == "osmesa"
    assert available_backend()[0] == "osmesa"
    assert tried.read_text().split() == ["egl", "osmesa"]


def test_none_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl, "AUTOMATIC", ("nonsense", "rubbish"))
    backend, reason = available_backend()
    assert backend is None
    for part in ("nonsense", "rubbish", "libegl1", "libosmesa6"):
        assert part in reason
    assert "\n" not in reason


@pytest.mark.parametrize("value", ["nonsense", "off"])
def test_value_that_names_no_backend(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    monkeypatch.setenv("MUJOCO_GL", value)
    backend, reason = available_backend()
    assert backend is None
    assert f"MUJOCO_GL={value}" in reason


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed with signal 11"),
        ("import time; time.sleep(60)", "no picture after 0.3 s"),
        ("import sys; sys.exit('some driver\\nis out of order')", "is out of order"),
        ("import sys; sys.exit(7)", "exit status 7"),
    ],
)
def test_drivers_that_misbehave(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, script: str, reason: str) -> None:
    probe = tmp_path / "probe.py"
    probe.write_text(script)
    monkeypatch.setattr(gl, "PROBE", probe)
    monkeypatch.setattr(gl, "PROBE_TIMEOUT", 0.3 if "sleep" in script else 30.0)
    monkeypatch.setattr(gl, "AUTOMATIC", ("egl",))
    assert reason in available_backend()[1]


def test_a_library_that_is_missing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """PyOpenGL has None in its place."""
    (tmp_path / "mujoco.py").write_text("None.glGetError")
    probe = tmp_path / "probe.py"
    probe.write_text(f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n" + gl.PROBE.read_text())
    monkeypatch.setattr(gl, "PROBE", probe)
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert "(osmesa: its library is not installed)" in available_backend()[1]


@pytest.mark.parametrize("before", [None, "glx"])
def test_environment_is_left_as_it_was(monkeypatch: pytest.MonkeyPatch, before: str | None) -> None:
    if before is None:
        monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    else:
        monkeypatch.setenv("PYOPENGL_PLATFORM", before)
    backend, reason = available_backend()
    if backend is None:
        pytest.skip(reason)
    gl.open_context(backend, 64, 64).free()
    assert os.environ.get("PYOPENGL_PLATFORM") == before
    assert "MUJOCO_GL" not in os.environ


def test_context_that_cannot_be_opened() -> None:
    with pytest.raises(MjsheafError, match="nonsense"):
        gl.open_context("nonsense", 64, 64)
