"""dm_control, imported so that no machine is too poor in ways to draw: physics needs none.

dm_control chooses how to draw when it is imported, by MUJOCO_GL. Without a display it takes a windowing library that
cannot draw there. Here EGL is tried first on such a machine, and what cannot be loaded is left out. The environment
variables stay as they were.
"""

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from mjsheaf.mujoco_import import mujoco

__all__ = ["MovableCamera", "Physics", "control", "mujoco", "specs", "wrapper"]

_VARIABLES = ("MUJOCO_GL", "PYOPENGL_PLATFORM")


@contextmanager
def _drawing_by(backend: str | None) -> Iterator[None]:
    """Name a way to draw within the block; None leaves the choice to dm_control."""
    before = {name: os.environ.get(name) for name in _VARIABLES}
    if backend is not None:
        os.environ["MUJOCO_GL"] = backend
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a windowing library without a display
            yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _candidates() -> tuple[str | None, ...]:
    """Ways to draw, the best first."""
    if os.environ.get("MUJOCO_GL"):
        return None, "off"
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not display:
        return "egl", "off"
    return None, "off"


def _load(module: str) -> Any:
    """Import a module of dm_control.

    Raises:
        ImportError: dm_control is not installed, or does not load.
    """
    failure: Exception | None = None
    for backend in _candidates():
        try:
            with _drawing_by(backend):
                import_module("dm_control._render")
                return import_module(module)
        except (ImportError, RuntimeError, AttributeError) as error:
            failure = error
    raise ImportError(
        f"dm_control cannot be loaded ({failure}); expected Python 3.11 or 3.12 and pip install dm-control"
    )


Physics: Any = _load("dm_control.mujoco").Physics
MovableCamera: Any = _load("dm_control.mujoco").MovableCamera
wrapper: Any = _load("dm_control.mujoco.wrapper")
control: Any = _load("dm_control.rl.control")
specs: Any = _load("dm_env.specs")
