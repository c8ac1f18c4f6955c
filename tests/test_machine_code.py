"""Machine code on disk: whatever becomes of its files, a function returns what its source says. Oracle: the source."""

import errno
import logging
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import pytest

import mjsheaf
from mjsheaf.compile import machine_code
from mjsheaf.compile.jit import INTERPRETED, jit
from tests.attack.test_tampering import flipped

pytestmark = pytest.mark.skipif(INTERPRETED, reason="nothing is compiled")


@pytest.fixture
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    return tmp_path


def triple(x: Any) -> Any:
    return 3 * x


def compiled_anew() -> bool:
    """Call the function for two types as a new process would; return whether it was compiled for them."""
    function = jit(triple)
    assert (function(2), function(2.5)) == (6, 7.5)
    return not function.stats.cache_hits


def files(directory: Path, ending: str) -> list[Path]:
    return sorted(directory.rglob(f"*{ending}"))


def write_another_form(path: Path) -> None:
    """Whole, but of a form that this numba does not know, as another version may write."""
    content = path.read_bytes()[16:][::-1]
    path.write_bytes(machine_code._hash(content) + content)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "gone": Path.unlink,
    "empty": lambda path: path.write_bytes(b""),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:100]),
    "a bit of it": lambda path: path.write_bytes(flipped(path.read_bytes(), random.Random(0))),
    "another form": write_another_form,
}


@pytest.mark.parametrize("ending", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_files_are_compiled_again(directory: Path, damage: str, ending: str) -> None:
    assert compiled_anew()
    assert not compiled_anew()
    for path in files(directory, ending):
        DAMAGES[damage](path)
    assert compiled_anew()
    assert not compiled_anew()


def test_a_full_disk_is_one_warning(
    directory: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(machine_code.StoredCode, "_warned", False)
    monkeypatch.setattr(machine_code._Files, "_write", fail)
    with caplog.at_level(logging.WARNING, "mjsheaf"):
        assert compiled_anew()
        assert compiled_anew()
    assert [record.getMessage() for record in caplog.records] == [
        f"{files(directory, '')[0]}: machine code cannot be kept, and is compiled again: No space left on device"
    ]


def test_files_of_other_versions_stay_a_month(directory: Path) -> None:
    """So that two versions, or two branches, do not compile in turns."""
    assert compiled_anew()
    place = files(directory, ".nbi")[0].parent
    name = files(directory, ".nbi")[0].name.split(".")
    recent, old = (place / ".".join([*name[:-2], version, "1.nbc"]) for version in ("0123456789abcdef", "0"))
    another = place / "test_machine_code.else-1.py311.0.1.nbc"
    for path in (recent, old, another):
        path.write_bytes(b"")
    for path in (old, another):
        os.utime(path, (0, 0))
    for path in files(directory, ".nbi"):
        path.unlink()
    assert compiled_anew()
    assert (recent.exists(), old.exists(), another.exists()) == (True, False, True)


CALLEE = "from mjsheaf.compile.jit import inline_jit\n\n\n@inline_jit\ndef f(x):\n    return 1.0 * x\n"
CALLER = (
    "from mjsheaf.law.zz_f import f\nfrom mjsheaf.compile.jit import jit\n\n\n@jit\ndef g(x):\n    return f(x) + 0.0\n"
)
WAIT = "import sys\nprint('imported', flush=True)\nsys.stdin.readline()\n"
BOTH = f"from mjsheaf.law.zz_g import g\n{WAIT}print(g(2.0))\n"
LATE = f"import mjsheaf.law.zz_f\n{WAIT}from mjsheaf.law.zz_g import g\nprint(g(2.0))\n"


@pytest.mark.long
@pytest.mark.parametrize("program", [BOTH, LATE], ids=["both imported", "caller imported after the edit"])
def test_an_edit_while_a_process_runs(tmp_path: Path, program: str) -> None:
    """The process has the old code, in memory alone; the next ones have the new one."""
    package = tmp_path / "mjsheaf"
    ignored = shutil.ignore_patterns("__pycache__", "models", "scenarios")
    shutil.copytree(Path(mjsheaf.__file__).parent, package, ignore=ignored)
    callee = package / "law" / "zz_f.py"
    callee.write_text(CALLEE)
    (package / "law" / "zz_g.py").write_text(CALLER)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def begin(program: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", program]
        pipe = subprocess.PIPE
        return subprocess.Popen(command, cwd=tmp_path, env=environment, text=True, stdin=pipe, stdout=pipe)

    running = begin(program)
    assert running.stdout is not None
    assert running.stdout.readline() == "imported\n"
    callee.write_text(CALLEE.replace("1.0 * x", "10.0 * x"))
    assert begin(LATE).communicate("\n")[0] == "imported\n20.0\n"
    assert running.communicate("\n")[0] == "2.0\n"
    assert begin(BOTH).communicate("\n")[0] == "imported\n20.0\n"
