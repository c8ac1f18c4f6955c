"""Functions that only compiled code calls have no machine code of their own."""

from pathlib import Path

import pytest

from tests.commands import COMPILED, python

FUNCTIONS = """
import numpy as np
from mjsheaf.compile.jit import jit

@jit
def square(x):
    return x * x

@jit
def hypotenuse(x, y):
    return np.sqrt(square(x) + square(y))

@jit
def cube(x):
    return x * square(x)
"""


@pytest.mark.slow
def test_a_function_is_linked_into_its_callers_and_still_callable_from_python(tmp_path: Path) -> None:
    """Another caller takes the linked code from disk."""
    (tmp_path / "program.py").write_text(COMPILED + FUNCTIONS)
    for calls, compiled in (
        ("assert hypotenuse(3.0, 4.0) == 5.0\nassert not square.signatures", ["hypotenuse", "square"]),
        ("assert cube(2.0) == 8.0", ["cube"]),
        ("assert square(2.0) == 4.0", ["square"]),
        ("assert (hypotenuse(3.0, 4.0), square(2.0)) == (5.0, 4.0)", []),
    ):
        script = f"from program import *\n{calls}\nprint(*compiled)"
        done = python(script, cwd=tmp_path, PYTHONDONTWRITEBYTECODE="1")
        assert (done.stdout.split(), done.stderr) == (compiled, "")
