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
"""
OTHER = """
@jit
def cube(x):
    return x * square(x)
"""


def run(folder: Path, functions: str, calls: str) -> list[str]:
    (folder / "program.py").write_text(COMPILED + functions)
    done = python(f"from program import *\n{calls}\nprint(*compiled)", cwd=folder, PYTHONDONTWRITEBYTECODE="1")
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.slow(first=True)
def test_a_function_is_linked_into_its_callers_and_still_callable_from_python(tmp_path: Path) -> None:
    calls = "assert hypotenuse(3.0, 4.0) == 5.0\nassert not square.signatures\nassert square(2.0) == 4.0"
    assert run(tmp_path, FUNCTIONS, calls) == ["hypotenuse", "square", "square"]
    assert run(tmp_path, FUNCTIONS, calls) == []


@pytest.mark.long
def test_another_caller_takes_the_linked_code_from_disk(tmp_path: Path) -> None:
    assert run(tmp_path, FUNCTIONS + OTHER, "assert hypotenuse(3.0, 4.0) == 5.0") == ["hypotenuse", "square"]
    assert run(tmp_path, FUNCTIONS + OTHER, "assert cube(2.0) == 8.0") == ["cube"]
