"""The wheel, as a user gets it: built, installed in a clean environment, run from another directory.

Oracle: it ships models, scenarios and studies and gives the same bits as the repository.
"""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import mjsheaf
from tests.builders import REPOSITORY


@pytest.mark.long
def test_wheel_installs_and_runs_elsewhere(tmp_path: Path) -> None:
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # which may be the repository

    def run(*command: str | Path, cwd: Path = tmp_path) -> str:
        done = subprocess.run(
            [*map(str, command)], cwd=cwd, env=own, capture_output=True, text=True, timeout=600, check=False
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    # From the source archive, as a release is: what the archive lacks, the wheel lacks too.
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", tmp_path / "dist", REPOSITORY)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    for path in [*(REPOSITORY / "models").iterdir(), *(REPOSITORY / "scenarios").iterdir()]:
        assert f"mjsheaf/{path.parent.name}/{path.name}" in names
    for path in (REPOSITORY / "studies").iterdir():
        assert f"mjsheaf/studies/shipped/{path.name}" in names
    assert not any(name.startswith("tests") for name in names)

    constraints = REPOSITORY / "constraints.txt"
    run(sys.executable, "-m", "venv", tmp_path / "venv")
    python = tmp_path / "venv" / "bin" / "python"
    run(python, "-m", "pip", "install", "--quiet", "--constraint", constraints, wheel)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    command = tmp_path / "venv" / "bin" / "mjsheaf"
    listed = run(command, "list", cwd=elsewhere)
    assert "paper" in listed[: listed.index("studies")]
    assert "gain" in listed[listed.index("studies") :]
    run(command, "sweep", "gain", "--set", "time.end=0.5", "--threads", "--out", "study", cwd=elsewhere)
    run(command, "run", "local_frames", "--no-video", "--set", "time.end=0.5", cwd=elsewhere)
    act = "import mjsheaf; print(mjsheaf.envs.dm_env(mjsheaf.load_scenario('midpoint')).reset().first())"
    if sys.version_info < (3, 13):  # later ones lack a build of what dm-control needs
        assert "True" in run(python, "-c", act, cwd=elsewhere)
    where = run(python, "-c", "import mjsheaf; print(mjsheaf.__file__)", cwd=elsewhere)
    assert str(REPOSITORY) not in where

    from mjsheaf.results.store import open_run

    with open_run(elsewhere / "runs" / "local_frames-physics") as (dataset, _):
        installed = dataset.load()
    here = mjsheaf.simulate(mjsheaf.load_scenario("local_frames", {"time.end": 0.5}), "physics")
    for name in here.data_vars:
        assert here[name].values.tobytes() == installed[name].values.tobytes(), name
