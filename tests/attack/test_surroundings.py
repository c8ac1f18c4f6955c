"""Strange machines: no home, no locale, no terminal, no working directory, closed streams, little memory, no asserts.

Oracle: the contract on exit codes and on errors; the bits of a run in usual surroundings.
"""

import os
import resource
import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mjsheaf.files import is_part_of
from mjsheaf.results.store import open_run
from tests.builders import REPOSITORY, known
from tests.commands import IDEAL, RUN_FILES, answer_of, command_line, is_refusal, one_line, python, start, wait_until

SHORT = ("run", "midpoint", *IDEAL)
BARE = {name: value for name, value in os.environ.items() if name == "PATH" or name.startswith("OPENBLAS_")}
BARE["PYTHONPATH"] = str(REPOSITORY)
"""Next to nothing; but bits depend on the kernels that OpenBLAS takes."""


def run(*arguments: str | Path, cwd: Path, **options: object) -> "subprocess.CompletedProcess[str]":
    """A command in a process of its own, with its output as text."""
    given = {"env": BARE, "capture_output": True, "text": True, "errors": "replace", "check": False, **options}
    return subprocess.run(command_line(*arguments), cwd=cwd, **given)  # type: ignore[call-overload]


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    directory = tmp_path_factory.mktemp("usual") / "out"
    assert answer_of(*SHORT, "--out", directory).code == 0
    return (directory / "result.nc").read_bytes()


SURROUNDINGS = {
    "no home": {},
    "home that is none": {"HOME": "/nonexistent", "MPLCONFIGDIR": "/nonexistent/x", "TMPDIR": "/nonexistent/y"},
    "C": {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "ASCII": {"PYTHONIOENCODING": "ascii:strict"},
    "one column": {"COLUMNS": "1", "LINES": "1"},
    "no column": {"COLUMNS": "0"},
    "columns that are no number": {"COLUMNS": "wide", "TERM": ""},
    "no asserts": {"PYTHONOPTIMIZE": "2"},
    "warnings are errors": {"PYTHONWARNINGS": "error"},
    "no cache of compiled code": {"NUMBA_CACHE_DIR": "/proc/nonexistent", "PYTHONDONTWRITEBYTECODE": "1"},
    "bogus GL": {"MUJOCO_GL": "crystal_ball"},
}


@pytest.mark.long
@pytest.mark.parametrize("name", SURROUNDINGS)
def test_strange_surroundings_change_no_bit(name: str, usual: bytes, tmp_path: Path) -> None:
    done = run(*SHORT, "--out", "où", cwd=tmp_path, env={**BARE, **SURROUNDINGS[name]})
    assert (done.returncode, done.stderr) == (0, "")
    assert "finished" in "".join(done.stdout.split())
    assert (tmp_path / "où" / "result.nc").read_bytes() == usual
    assert {p.name for p in (tmp_path / "où").iterdir()} == RUN_FILES


@pytest.mark.long
def test_a_machine_that_cannot_draw_keeps_its_data(tmp_path: Path) -> None:
    unable = {**BARE, "MUJOCO_GL": "off"}
    done = run(*[a for a in SHORT if a != "--no-video"], "--out", "out", cwd=tmp_path, env=unable)
    assert done.returncode == 0
    assert done.stderr.startswith("note: no video: ")
    assert done.stderr.count("\n") == 1
    assert {p.name for p in (tmp_path / "out").iterdir()} == RUN_FILES
    done = run("video", "out", cwd=tmp_path, env=unable)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


@pytest.mark.long
def test_names_that_are_no_text(tmp_path: Path) -> None:
    for encoding in ("utf-8:strict", "ascii:strict"):
        env = {**BARE, "PYTHONIOENCODING": encoding}
        out = os.fsdecode(b"o\xff\xfe")
        assert run(*SHORT, "--out", out, cwd=tmp_path, env=env).returncode == 0
        assert {p.name for p in (tmp_path / out).iterdir()} == RUN_FILES
        shutil.copy(REPOSITORY / "scenarios" / "midpoint.yaml", tmp_path / os.fsdecode(b"m\xff.yaml"))
        assert run("check", os.fsdecode(b"m\xff.yaml"), "--no-trial", cwd=tmp_path, env=env).returncode == 0
        done = run("run", os.fsdecode(b"none\xff.yaml"), cwd=tmp_path, env=env)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)


CLOSED = {"stdin": "<&-", "stdout": ">&-", "stderr": "2>&-", "all": "<&- >&- 2>&-"}


@pytest.mark.long
@pytest.mark.parametrize("name", CLOSED)
def test_closed_streams(name: str, usual: bytes, tmp_path: Path) -> None:
    """No file that is opened takes their numbers: what a library prints would go into it."""
    script = f'"$0" "$@" {CLOSED[name]}'
    for arguments, code in ((SHORT, 0), (("run", "nonsense"), 2), (("run", "air_tracks_surface"), 1)):
        command = ["sh", "-c", script, *command_line(*arguments, "--out", "out")]
        done = subprocess.run(command, cwd=tmp_path, env=BARE, capture_output=True, check=False)
        assert done.returncode == code
    assert (tmp_path / "out" / "result.nc").read_bytes() == usual
    assert {p.name for p in tmp_path.iterdir()} == {"out"}


@pytest.mark.long
def test_readers_that_go_away(tmp_path: Path) -> None:
    """As shells expect of what SIGPIPE ends: 141, and nothing on stderr."""
    checked = ("check", "midpoint", "--no-trial", "--json")
    for arguments in (("schema",), ("--help",), checked, (*SHORT, "--out", tmp_path / "out")):
        with start(*arguments, env=BARE, cwd=tmp_path) as process:
            known(process.stdout).close()
            assert known(process.stderr).read() == ""
        assert process.returncode == 141, arguments
    assert {p.name for p in (tmp_path / "out").iterdir()} == RUN_FILES
    if Path("/dev/full").exists():
        with open("/dev/full", "w") as full:
            done = run("schema", cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, capture_output=False)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_working_directory_that_is_gone(tmp_path: Path) -> None:
    here, gone = Path.cwd(), tmp_path / "gone"
    gone.mkdir()
    os.chdir(gone)
    gone.rmdir()
    try:
        for command in (SHORT, ("run", "midpoint"), ("check", "nothing.yaml"), ("sweep", "midpoint", "--out", "s")):
            answer = answer_of(*command)
            assert is_refusal(answer), answer
    finally:
        os.chdir(here)


def limited(megabytes: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))


ABORTED = (-signal.SIGABRT, -signal.SIGSEGV, -signal.SIGKILL)
LAST_WORDS = ("OpenBLAS error: Memory allocation still failed", "cannot allocate memory for thread-local data: ABORT")
"""Of libraries that end the process themselves, with 1 and 127."""


@pytest.mark.long
@pytest.mark.parametrize("megabytes", [300, 500, 700, 900, 1200])
def test_little_memory(megabytes: int, tmp_path: Path) -> None:
    """With too little memory there is no result, and one line of error if Python still runs.

    A library that gets no memory may end the process, and to remove files takes memory, too; what is left is hidden,
    and the next command removes it.
    OpenBLAS may retry the allocation of its buffer forever; then the test ends the process.
    """
    try:
        done = run(*SHORT, "--out", "out", cwd=tmp_path, preexec_fn=limited(megabytes), timeout=90)
        code, error = done.returncode, done.stderr
    except subprocess.TimeoutExpired:
        code, error = -signal.SIGKILL, ""
    if code == 0:
        return
    left = [path.name for path in tmp_path.iterdir()]
    assert all(is_part_of(name, ["out"]) for name in left)
    if code not in ABORTED and not any(words in error for words in LAST_WORDS):
        assert code == 2, error[-2000:]
        # An allocator has lines of its own, and so have finalizers of libraries that run without memory at the end.
        lines = error.split("Exception ignored in:")[0].splitlines()
        assert len([line for line in lines if not line.startswith("<jemalloc>")]) == 1, error[-2000:]
    assert run(*SHORT, "--out", "out", cwd=tmp_path).returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


@pytest.mark.long
def test_output_directory_that_is_removed_meanwhile(tmp_path: Path) -> None:
    parent = tmp_path / "parent"
    parent.mkdir()
    arguments = [a if a != "time.end=0.2" else "time.end=3000" for a in SHORT]
    with start(*arguments, "--out", parent / "out", env=BARE) as process:
        wait_until(lambda: list(parent.iterdir()), running=process)
        shutil.rmtree(parent)
        _, error = process.communicate()
    assert process.returncode == 2, error
    assert one_line(error, "cannot be written")
    assert not parent.exists()


@pytest.mark.long
def test_asserts_are_no_checks_of_what_users_write(tmp_path: Path) -> None:
    """Under -O nothing that is refused otherwise passes."""
    bad = ["controller.gain=-1", "time.end=-1", "agents.A1.position=[1]", "sensing.0.map=nonsense"]
    bad += ["agents.A1.vehicle=rocket", "physics.timestep=0"]
    script = (
        "import sys\nfrom tests.commands import answer_of\n"
        f"for override in {bad!r}:\n"
        f"    answer = answer_of(*{SHORT!r}, '--backend', 'physics', '--set', override, '--out', 'out')\n"
        "    print(sys.flags.optimize, answer.code, answer.err.count('\\n'))\n"
    )
    done = python(script, cwd=tmp_path, PYTHONOPTIMIZE="1")
    assert done.stdout.splitlines() == ["1 2 1"] * len(bad), done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow(first=True)
def test_a_number_of_threads_that_numba_refuses_is_named_in_one_line(tmp_path: Path) -> None:
    done = run("run", "midpoint", "--no-video", cwd=tmp_path, env=BARE | {"NUMBA_NUM_THREADS": "0"})
    assert done.returncode == 2
    assert all(line.startswith("loading") for line in done.stdout.splitlines())
    assert one_line(done.stderr, "NUMBA_NUM_THREADS", "from 1 on")


INTERPRETED = {
    "ideal": ("midpoint", "--backend", "ideal", "--set", "time.end=0.5"),
    "mujoco": ("midpoint", "--set", "time.end=1"),
    "fused": ("midpoint", "--engine", "fused", "--set", "time.end=1"),
    "links": ("noisy_harbour", "--set", "time.end=0.3"),
    "terms": ("paper_feedforward", "--engine", "fused", "--set", "time.end=0.05"),
    "threads": ("swarm", "--engine", "fused", "--threads", "2", "--set", "swarm.size=20", "--set", "time.end=0.06"),
}


@pytest.mark.long
@pytest.mark.parametrize("name", INTERPRETED)
def test_every_backend_runs_uncompiled(name: str, tmp_path: Path) -> None:
    """To rounding, so that a debugger can stop in any loop."""
    command = ("run", *INTERPRETED[name], "--no-video")
    assert answer_of(*command, "--out", tmp_path / "compiled").code == 0
    done = run(*command, "--out", "plain", cwd=tmp_path, env=BARE | {"NUMBA_DISABLE_JIT": "1"})
    assert done.returncode == 0, done.stderr
    with open_run(tmp_path / "compiled") as (compiled, _), open_run(tmp_path / "plain") as (plain, _):
        np.testing.assert_allclose(plain.agent_position, compiled.agent_position, rtol=0, atol=1e-9)
        np.testing.assert_allclose(plain.velocity_command, compiled.velocity_command, rtol=0, atol=1e-9)
