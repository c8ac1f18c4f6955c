"""Python files of users, executed as modules, with their exceptions described in one line."""

import importlib.util
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType

from mjsheaf.errors import visible

_PACKAGE = Path(__file__).parents[1]
_MAX_MESSAGE = 300  # maximum number of characters of an exception in a message


@contextmanager
def in_this_directory() -> Iterator[None]:
    """Restore the working directory at the end, because paths of results and files are relative to it."""
    place = _working_directory()
    try:
        yield
    finally:
        if place is not None and _working_directory() != place:
            with suppress(OSError):
                os.chdir(place)


def _working_directory() -> str | None:
    """Return the working directory; None if it no longer exists."""
    with suppress(OSError):
        return os.getcwd()
    return None


def describe(error: BaseException) -> str:
    """Describe an exception of the user's code and its location in one line; compiled code may not know the latter."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not Path(frame.filename).is_relative_to(_PACKAGE)][-1:]
    place = "".join(f" ({visible(Path(frame.filename).name)}, line {frame.lineno})" for frame in own)
    try:
        text = str(error)
    except (Exception, SystemExit):
        text = "an exception that cannot be printed, because its __str__ raises another"
    return f"{visible(type(error).__name__)}: {visible(text, _MAX_MESSAGE)}{place}"


def execute_file(path: Path, prefix: str) -> ModuleType:
    """Execute a user's Python file as a module named after it, and return the module."""
    name = f"{prefix}_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None  # of a .py file
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickle look a class's module up
    with in_this_directory():
        spec.loader.exec_module(module)
    return module
