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

PACKAGE = Path(mjsheaf.__file__).parent
HASHES = """
import sys
from pathlib import Path
from mjsheaf.compile import machine_code
root = Path(machine_code.__file__).resolve().parents[1]
for name in sys.argv[1:]:
    print(machine_code.source_hash(root / name))
"""
FILES = (
    "noise.py",
    "sheaf/edges.py",
    "media/flow.py",
    "law/terms.py",
    "loop/ideal.py",
    "loop/loop.py",
)


def hashes(package: Path) -> dict[str, str]:
    command = [sys.executable, "-c", HASHES, *FILES]
    run = subprocess.run(command, cwd=package.parent, capture_output=True, text=True, check=True)
    return dict(zip(FILES, run.stdout.split(), strict=True))


def test_an_edit_makes_stale_the_code_of_its_callers_alone(tmp_path: Path) -> None:
    package = tmp_path / "mjsheaf"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__", "models", "scenarios"))
    before = hashes(package)
    assert len(set(before.values())) == len(FILES)
    source = package / "law" / "terms.py"
    source.write_text(source.read_text() + "\n# an edit\n")
    after = hashes(package)
    changed = {name for name in FILES if after[name] != before[name]}
    assert changed == {"law/terms.py", "loop/ideal.py", "loop/loop.py"}


def test_functions_that_callers_inline_are_in_sources() -> None:
    """The code of a caller has a copy of them, so that their text must decide on it."""
    for path in PACKAGE.rglob("*.py"):
        if "\n@inline_jit\n" in path.read_text(encoding="utf-8"):
            assert any(path.relative_to(PACKAGE).match(pattern) for pattern in machine_code.SOURCES), path


def test_an_edit_of_the_decorator_makes_all_code_stale(tmp_path: Path) -> None:
    """Also in a directory whose name reads as a pattern."""
    package = tmp_path / "site [1]" / "mjsheaf"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__", "models", "scenarios"))
    before = hashes(package)
    source = package / "compile/jit.py"
    source.write_text(source.read_text() + "\n# an edit\n")
    after = hashes(package)
    assert all(after[name] != before[name] for name in FILES)


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


@pytest.mark.long
def test_a_second_process_waits_for_the_code_of_the_first(tmp_path: Path) -> None:
    """The first process compiles until it is released; the second one compiles nothing.

    One that needs the function for another type compiles meanwhile, and neither's code is lost.
    """
    (tmp_path / "two.py").write_text(TWO)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(PACKAGE.parent)}
    processes = []
    for said, kind in (("compiling", "float"), ("waiting", "float"), ("compiling", "int")):
        process = subprocess.Popen(
            [sys.executable, "two.py", kind], cwd=tmp_path, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        processes.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == f"{said}\n"
    assert [process.communicate("\n")[0] for process in processes] == ["1\n", "0\n", "1\n"]
    both = [sys.executable, "two.py", "float", "int"]
    assert subprocess.run(both, cwd=tmp_path, env=environment, capture_output=True, text=True).stdout == "0\n"


@pytest.mark.slow
def test_a_process_that_dies_leaves_no_lock(tmp_path: Path) -> None:
    """The second one compiles in place of the first, which was killed."""
    (tmp_path / "two.py").write_text(TWO)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(PACKAGE.parent)}
    first, second = (
        subprocess.Popen(
            [sys.executable, "two.py"], cwd=tmp_path, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )
        for _ in range(2)
    )  # fmt: skip
    assert first.stdout is not None
    assert second.stdout is not None
    said = {first: first.stdout.readline(), second: second.stdout.readline()}
    assert sorted(said.values()) == ["compiling\n", "waiting\n"]
    killed, left = (first, second) if said[first] == "compiling\n" else (second, first)
    killed.kill()
    killed.wait()
    assert left.communicate("\n")[0] == "compiling\n1\n"
    killed.communicate()
