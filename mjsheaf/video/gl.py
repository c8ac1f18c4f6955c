"""Find an offscreen OpenGL that works on this machine, and make a context of it.

MuJoCo chooses its GL library when it is imported, from the variable MUJOCO_GL. Here the choice is made when a
video is drawn, so it does not matter what was imported or set before; the environment is left as it was.

As a script, this module draws a small picture with the backend that MUJOCO_GL names; it exits with 0 if that shows.
"""

import os
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

PROBE = Path(__file__)
PROBE_TIMEOUT = 60.0  # s; a second is enough, but a loaded machine with a cold disk has taken ten

AUTOMATIC = ("cgl", "glfw") if sys.platform == "darwin" else ("egl", "osmesa")
BACKENDS = ("egl", "osmesa", "glfw", "cgl")  # each is a submodule of mujoco with a GLContext
MUJOCO_DEFAULT = ("", "enable", "enabled", "on", "true", "1")  # values of MUJOCO_GL that name no backend


def available_backend() -> tuple[str | None, str]:
    """Find an offscreen GL that works: the one that MUJOCO_GL names or, if none, egl and then osmesa.

    Each is tried in a child process, as a bad driver may crash. The answer is kept for this process.

    Returns:
        The backend's name and how it was found; or None and a line that says what failed and what to install.
    """
    return _first_that_works(os.environ.get("MUJOCO_GL", "").lower().strip())


@cache
def _first_that_works(requested: str) -> tuple[str | None, str]:
    if requested in ("disable", "disabled", "off", "false", "0"):
        return None, f"rendering is turned off by MUJOCO_GL={requested}; unset it, or set it to egl or osmesa"
    if requested not in (*MUJOCO_DEFAULT, *BACKENDS):
        return None, f"MUJOCO_GL={requested} is not a backend; unset it, or set it to {' or '.join(BACKENDS)}"
    candidates = AUTOMATIC if requested in MUJOCO_DEFAULT else (requested,)
    failures = []
    for backend in candidates:
        failure = _probe(backend)
        if failure is None:
            return backend, "named by MUJOCO_GL" if backend == requested else "the first that works here"
        failures.append(f"{backend}: {failure}")
    only = "" if requested in MUJOCO_DEFAULT else f" with MUJOCO_GL={requested}"
    return None, (
        f"no offscreen OpenGL works{only} ({'; '.join(failures)}); on Debian or Ubuntu install libegl1 libgl1 "
        "libgl1-mesa-dri (for egl, no display needed) or libosmesa6 (for osmesa)"
    )


def _probe(backend: str) -> str | None:
    """Draw a small picture with the backend in a child process; None if that worked, else why not."""
    environment = {**os.environ, "MUJOCO_GL": backend}
    environment.pop("PYOPENGL_PLATFORM", None)
    command = [sys.executable, "-P", str(PROBE)]  # -P: this folder's modules must not shadow others
    try:
        child = subprocess.run(
            command, env=environment, capture_output=True, text=True, errors="replace", timeout=PROBE_TIMEOUT
        )
    except subprocess.TimeoutExpired:
        return f"no picture after {PROBE_TIMEOUT:g} s"
    except OSError as error:
        return f"cannot start {sys.executable}: {error}"
    if child.returncode == 0:
        return None
    if child.returncode < 0:
        return f"crashed with signal {-child.returncode}"
    lines = child.stderr.strip().splitlines()
    return lines[-1].strip() if lines else f"exit status {child.returncode}"


def open_context(backend: str, width: int, height: int) -> Any:
    """Create a GL context for frames of a size in pixels, with methods `make_current` and `free`, and make it current.

    Raises:
        MjsheafError: the driver refuses.
    """
    from mjsheaf.errors import MjsheafError  # here, as the script stands alone

    # PyOpenGL loads the library that this variable names at its first import, and mujoco.egl and mujoco.osmesa set it,
    # or refuse another's value. It is restored.
    before = os.environ.pop("PYOPENGL_PLATFORM", None)
    if backend in ("egl", "osmesa"):
        os.environ["PYOPENGL_PLATFORM"] = backend
    try:
        context = import_module(f"mujoco.{backend}").GLContext(width, height)
        context.make_current()
        return context
    except Exception as error:  # PyOpenGL, ctypes and the drivers each have their own
        reason = str(error).strip() or type(error).__name__
        raise MjsheafError(f"cannot open an OpenGL context with {backend}: {reason}") from error
    finally:
        os.environ.pop("PYOPENGL_PLATFORM", None)
        if before is not None:
            os.environ["PYOPENGL_PLATFORM"] = before


def _draw_ball() -> None:
    """Draw a white ball on a black background with the backend that MUJOCO_GL names, and look at the pixels."""
    try:
        import mujoco

        model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>")
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        renderer = mujoco.Renderer(model, 64, 64)
    except AttributeError:  # PyOpenGL has None where it does not find a library, and fails when that is used
        sys.exit("its library is not installed")
    renderer.update_scene(data)
    pixels = renderer.render()
    if int(pixels.max()) - int(pixels.min()) < 50:
        sys.exit("it draws an empty picture")


if __name__ == "__main__":
    _draw_ball()
    os._exit(0)  # without the drivers' own clean-up, which is where some of them crash
