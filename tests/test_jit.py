"""Compiled code on disk: an edit drops the code of the edited file and of its callers, and of no other file."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import mjsheaf
from mjsheaf import jit

PACKAGE = Path(mjsheaf.__file__).parent
HASHES = """
import sys
from pathlib import Path
from mjsheaf import jit
root = Path(jit.__file__).resolve().parent
for name in sys.argv[1:]:
    print(jit._source_hash(root / name))
"""
FILES = (
    "noise.py",
    "sheaf/edges.py",
    "media/flow.py",
    "control/terms.py",
    "simulation/ideal.py",
    "simulation/loop.py",
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
    source = package / "control" / "terms.py"
    source.write_text(source.read_text() + "\n# an edit\n")
    after = hashes(package)
    changed = {name for name in FILES if after[name] != before[name]}
    assert changed == {"control/terms.py", "simulation/ideal.py", "simulation/loop.py"}


def test_an_edit_of_the_decorator_makes_all_code_stale(tmp_path: Path) -> None:
    """Also in a directory whose name reads as a pattern."""
    package = tmp_path / "site [1]" / "mjsheaf"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__", "models", "scenarios"))
    before = hashes(package)
    source = package / "jit.py"
    source.write_text(source.read_text() + "\n# an edit\n")
    after = hashes(package)
    assert all(after[name] != before[name] for name in FILES)


def test_imports_are_found_as_the_parser_finds_them() -> None:
    """Oracle: Python's own parser, on every file with compiled functions."""
    package = Path(jit.__file__).resolve().parent
    for path in sorted(path for pattern in jit._SOURCES for path in package.glob(pattern)):
        nodes = [node for node in ast.walk(ast.parse(path.read_bytes())) if isinstance(node, ast.ImportFrom)]
        ours = [node for node in nodes if not node.level and str(node.module).split(".")[0] == "mjsheaf"]
        expected = {jit._origin_of(str(node.module), alias.name) for node in ours for alias in node.names}
        assert expected <= jit._imports_of(path), path
