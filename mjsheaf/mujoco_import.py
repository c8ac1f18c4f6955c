"""MuJoCo, imported where MUJOCO_GL names a way to draw that does not work here, and its errors in one line.

It chooses an OpenGL backend when it is imported and fails with it. Physics needs none: it must not fail then.

MuJoCo writes warnings to stderr and to a file MUJOCO_LOG.TXT in the working directory, unless there is a handler, which
belongs to the process. Within `quiet` there is one that drops them: what matters of them is said in mjsheaf's words.
"""

import locale
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock, RLock
from typing import Any

from mjsheaf.errors import InputError

__all__ = ["mujoco", "quiet", "refusing"]

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


_READING = RLock()
_HANDLER = Lock()
_handlers: list[Any] = []  # for each `quiet` that is entered, the handler of warnings from before the first one


@contextmanager
def quiet() -> Iterator[None]:
    """Drop MuJoCo's warnings, in all threads of the process; the handler from before returns after the last exit."""
    with _HANDLER:
        _handlers.append(_handlers[0] if _handlers else mujoco.get_mju_user_warning())
        mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        with _HANDLER:
            before = _handlers.pop()
            if not _handlers:
                mujoco.set_mju_user_warning(before)


@contextmanager
def refusing(what: str) -> Iterator[None]:
    """Raise an InputError that begins so where MuJoCo refuses a model or has no memory for it.

    One thread at a time reads and compiles models here, without warnings, and with LC_NUMERIC set to C. MuJoCo reads
    the numbers of a mesh by the locale of the process, and would take 2.5 for 2 where that has decimal commas. Another
    thread that formats numbers by locale sees C meanwhile.
    """
    with _READING, quiet(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        numbers = locale.setlocale(locale.LC_NUMERIC)
        locale.setlocale(locale.LC_NUMERIC, "C")
        try:
            yield
        except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
            raise InputError(f"{what}: {' '.join(str(error).split())}") from None
        finally:
            locale.setlocale(locale.LC_NUMERIC, numbers)
