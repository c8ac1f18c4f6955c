"""Importing MuJoCo and PyMJCF where MUJOCO_GL names a way to draw that does not work here.

Both choose an OpenGL backend when they are imported and fail with it. Physics needs none: it must not fail then.
"""

import os
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from mjsheaf.errors import InputError

__all__ = ["mujoco", "pymjcf"]

_ALONE = threading.RLock()  # environment and warnings belong to the whole process


@contextmanager
def _without_drawing() -> Iterator[None]:
    with _ALONE, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        given = os.environ.get("MUJOCO_GL")
        os.environ["MUJOCO_GL"] = "off"
        try:
            yield
        finally:
            if given is None:
                del os.environ["MUJOCO_GL"]
            else:
                os.environ["MUJOCO_GL"] = given


try:
    import mujoco
except (ImportError, RuntimeError, AttributeError):  # what a missing or unknown backend raises
    with _without_drawing():
        import mujoco


@cache
def pymjcf() -> Any:
    """The module dm_control.mjcf, imported without choosing a way to draw."""
    try:
        with _without_drawing():
            from dm_control import mjcf
    except ModuleNotFoundError as error:
        raise InputError(
            f"bodies need PyMJCF, but {error.name} is not installed: run 'pip install --no-deps dm-control'"
        ) from None
    return mjcf
