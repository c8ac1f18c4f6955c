"""Importing MuJoCo where MUJOCO_GL names a way to draw that does not work here.

It chooses an OpenGL backend when it is imported and fails with it. Physics needs none: it must not fail then.
"""

import os

__all__ = ["mujoco"]

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
