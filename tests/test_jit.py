"""Compiled code on disk: an edit drops the code of the edited file and of its callers, and of no other file."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mjsheaf
from mjsheaf.compile import machine_code
from tests.commands import python

PACKAGE = Path(mjsheaf.__file__).parent
HASHES = """
from pathlib import Path
from mjsheaf.compile import machine_code
root = Path(machine_code.__file__).resolve().parents[1]
for name in {names}:
    print(machine_code.source_hash(root / name))
"""
FILES = ("noise.py", "sheaf/edges.py", "media/flow.py", "law/terms.py", "loop/ideal.py", "loop/loop.py")


def hashes(package: Path) -> dict[str, str]:
    return dict(zip(FILES, python(HASHES.format(names=FILES), cwd=package.parent).stdout.split(), strict=True))


@pytest.mark.parametrize(
    ("edited", "stale"),
    [("law/terms.py", {"law/terms.py", "loop/ideal.py", "loop/loop.py"}), ("compile/jit.py", set(FILES))],
)
def test_an_edit_makes_stale_the_code_of_its_callers_alone(edited: str, stale: set[str], tmp_path: Path) -> None:
    """That of the decorator, all code. Also in a directory whose name reads as a pattern."""
    package = tmp_path / "site [1]" / "mjsheaf"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__", "models", "scenarios"))
    before = hashes(package)
    assert len(set(before.values())) == len(FILES)
    source = package / edited
    source.write_text(source.read_text() + "\n# an edit\n")
    after = hashes(package)
    assert {name for name in FILES if after[name] != before[name]} == stale


def test_functions_that_callers_inline_are_in_sources() -> None:
    """The code of a caller has a copy of them, so that their text must decide on it."""
    for path in PACKAGE.rglob("*.py"):
        if "\n@inline_jit\n" in path.read_text(encoding="utf-8"):
            assert any(path.relative_to(PACKAGE).match(pattern) for pattern in machine_code.SOURCES), path


def test_imports_are_found_as_the_parser_finds_them() -> None:
    """Oracle: Python's own parser, on every file with compiled functions."""
    package = Path(machine_code.__file__).resolve().parents[1]
    for path in sorted(path for pattern in machine_code.SOURCES for path in package.glob(pattern)):
        nodes = [node for node in ast.walk(ast.parse(path.read_bytes())) if isinstance(node, ast.ImportFrom)]
        ours = [node for node in nodes if not node.level and str(node.module).split(".")[0] == "mjsheaf"]
        expected = {machine_code._origin_of(str(node.module), alias.name) for node in ours for alias in node.names}
        assert expected <= machine_code._imports_of(path), path


TWO = """
import sys, time
from numba.core import event
from mjsheaf.compile.jit import is_waiting, jit

class Slow(event.Listener):
    count = 0
    def on_start(self, event):
        Slow.count += 1
        print("compiling", flush=True)
        sys.stdin.readline()
    def on_end(self, event):
        pass

event.register("numba:compile", Slow())

@jit
def twice(x):
    return 2.0 * x

from threading import Thread
def tell():
    while not is_waiting():
        time.sleep(0.01)
    print("waiting", flush=True)
Thread(target=tell, daemon=True).start()
kinds = sys.argv[1:] or ["float"]
assert all(twice({"float": float, "int": int}[kind](4)) == 8.0 for kind in kinds)
print(Slow.count, flush=True)
"""


def begin(folder: Path, *kinds: str) -> "subprocess.Popen[str]":
    """Start a process that needs the function for some types; it compiles once it reads a line."""
    (folder / "two.py").write_text(TWO)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(PACKAGE.parent)}
    command, pipe = [sys.executable, "two.py", *kinds], subprocess.PIPE
    return subprocess.Popen(command, cwd=folder, env=environment, text=True, stdin=pipe, stdout=pipe)


def first_line(process: "subprocess.Popen[str]") -> str:
    assert process.stdout is not None
    return process.stdout.readline()


@pytest.mark.long
def test_a_second_process_waits_for_the_code_of_the_first(tmp_path: Path) -> None:
    """The first process compiles until it is released; the second one compiles nothing.

    One that needs the function for another type compiles meanwhile, and neither's code is lost.
    """
    processes = []
    for said, kind in (("compiling", "float"), ("waiting", "float"), ("compiling", "int")):
        processes.append(begin(tmp_path, kind))
        assert first_line(processes[-1]) == f"{said}\n"
    assert [process.communicate("\n")[0] for process in processes] == ["1\n", "0\n", "1\n"]
    assert begin(tmp_path, "float", "int").communicate()[0] == "0\n"


@pytest.mark.slow
def test_a_process_that_dies_leaves_no_lock(tmp_path: Path) -> None:
    """The second one compiles in place of the first, which was killed."""
    first, second = begin(tmp_path), begin(tmp_path)
    said = {first: first_line(first), second: first_line(second)}
    assert sorted(said.values()) == ["compiling\n", "waiting\n"]
    killed, left = (first, second) if said[first] == "compiling\n" else (second, first)
    killed.kill()
    killed.wait()
    assert left.communicate("\n")[0] == "compiling\n1\n"
    killed.communicate()
