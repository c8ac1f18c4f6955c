"""MuJoCo, imported where MUJOCO_GL names a way to draw that does not work here, and its errors in one line.

It chooses an OpenGL backend when it is imported and fails with it. Physics needs none: it must not fail then.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from mjsheaf.errors import InputError

__all__ = ["mujoco", "refusing"]

try:
    import mujoco
except (ImportError, RuntimeError, AttributeError):  # what a missing or unknown backend raises
    given = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "off"
    try:
        import mujoco
    finally:
        if given is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = given


@contextmanager
def refusing(what: str) -> Iterator[None]:
    """Raise an InputError that begins so where MuJoCo refuses a model or has no memory for it."""
    try:
        yield
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        raise InputError(f"{what}: {' '.join(str(error).split())}") from None
