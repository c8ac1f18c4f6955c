"""Every command, as a user runs it.

Oracle: the contract (exit codes, files left, fields of summary.json).
"""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import pytest
import xarray as xr

import mjsheaf as package
from mjsheaf.cli.main import main
from mjsheaf.results.store import FILES
from mjsheaf.scenario import list_scenarios, load_scenario
from mjsheaf.video import available_backend

SMALL = ["--set", "video.width=160", "--set", "video.height=120", "--set", "video.fps=5"]
DATA = {"result.nc", "summary.json", "scenario.yaml", "errors.png", "trajectories.png", "configurations.png"}
CAN_DRAW = available_backend()[0] is not None


def call(*arguments: str | Path) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    return int(stopped.value.code or 0)


@pytest.mark.parametrize("backend", ["ideal", "physics"])
@pytest.mark.parametrize("name", list_scenarios())
def test_run_and_video_of_every_scenario(
    name: str, backend: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    code = call("run", name, "--backend", backend, "--set", "time.end=0.5", *SMALL, "--out", out)
    printed = capsys.readouterr()
    refused = load_scenario(name).expect.refused
    if refused is not None:
        assert code == (1 if name == "air_tracks_surface" else 2)
        assert refused in printed.err
        assert printed.err.count("\n") == 1
        assert not out.exists()
        return
    assert code == 0, printed.err
    assert {p.name for p in out.iterdir()} == (set(FILES) if CAN_DRAW else DATA)
    summary = json.loads((out / "summary.json").read_text())
    for field in (
        "scenario",
        "backend",
        "status",
        "seed",
        "steps",
        "wall_time_s",
        "realtime_factor",
        "expect",
        "final",
    ):
        assert field in summary
    assert summary["status"] == "finished"
    assert summary["final"]["time"] == pytest.approx(0.5)
    for field in ("mean_disagreement", "tracking_error", "formation_error", "centering_error", "groups"):
        assert field in summary["final"]
    with xr.open_dataset(out / "result.nc", engine="h5netcdf") as ds:
        assert ds.attrs["scenario"] == name
        assert float(ds["time"][-1]) == pytest.approx(0.5)
    if CAN_DRAW:
        assert call("video", out, "--width", "192", "--height", "128", "--fps", "4", "--elevation", "-80") == 0
        meta = next(imageio_ffmpeg.read_frames(str(out / "video.mp4")))
        assert meta["size"] == (192, 128)
        assert meta["fps"] == 4
        assert meta["codec"] == "h264"
        assert meta["pix_fmt"].startswith("yuv420p")


def test_run_replaces_its_own_directory_and_repeats_its_bits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["run", "local_frames", "--backend", "ideal", "--no-video", "--set", "time.end=0.5", "--out", out]
    assert call(*arguments) == 0
    first = {p.name: p.read_bytes() for p in out.iterdir()}
    assert call(*arguments) == 0
    second = {p.name: p.read_bytes() for p in out.iterdir()}
    assert first.keys() == second.keys()
    for name in first.keys() - {"summary.json"}:  # which holds the wall time
        assert first[name] == second[name], name
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    again = tmp_path / "again"
    assert call("run", out / "scenario.yaml", "--backend", "ideal", "--no-video", "--out", again) == 0
    assert (again / "result.nc").read_bytes() == first["result.nc"]


def test_unstable_run_is_published_and_exits_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for backend in ("ideal", "physics"):
        out = tmp_path / backend
        code = call("run", "paper", "--backend", backend, "--set", "controller.gain=60", *SMALL, "--out", out)
        printed = capsys.readouterr()
        assert code == 3
        assert printed.err.count("\n") == 1
        for word in ("unstable", " at t = ", "k1 h lambda_max = 3.76", "controller.gain below 31.9", str(out)):
            assert word in printed.err
        summary = json.loads((out / "summary.json").read_text())
        assert summary["status"] == "unstable"
        assert {p.name for p in out.iterdir()} == (set(FILES) if CAN_DRAW else DATA)
        with xr.open_dataset(out / "result.nc", engine="h5netcdf") as ds:
            assert 1 < len(ds["time"]) < 4999
            assert ds.attrs["status"] == "unstable"


def test_expectation_missed_exits_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    arguments = ["run", "midpoint", "--backend", "ideal", "--no-video", "--set", "time.end=0.1", "--out", out]
    assert call(*arguments) == 0
    assert json.loads((out / "summary.json").read_text())["expect"]["met"] is False
    assert call(*arguments, "--expect") == 1
    assert "tracking_error is" in capsys.readouterr().err
    assert call("run", "midpoint", "--backend", "ideal", "--no-video", "--expect", "--out", out) == 0


def test_seed_that_changes_nothing_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", "midpoint", "--backend", "ideal", "--no-video", "--set", "time.end=0.1", "--seed", "5"]
    assert call(*arguments, "--out", tmp_path / "out") == 0
    assert "the seed changes nothing" in capsys.readouterr().err
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["seed"] == 5


def test_list_schema_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("list") == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in list_scenarios())
    assert call("list", "--vehicles") == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in ("hull", "aerial", "submersible"))
    assert call("schema") == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["properties"]["controller"]
    assert call("--version") == 0
    assert capsys.readouterr().out == f"mjsheaf {package.__version__}\n"


@pytest.mark.parametrize("command", [[], ["run"], ["video"], ["list"], ["schema"]])
def test_help(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert call(*command, "--help") == 0
    assert "Usage" in capsys.readouterr().out


def test_help_loads_nothing_heavy() -> None:
    script = (
        "import sys\nfrom mjsheaf.cli.main import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'mujoco', 'numba', 'matplotlib', 'scipy', 'xarray', 'pydantic'} & set(sys.modules)\n"
        "print('heavy:', sorted(heavy))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip().endswith("heavy: []")


def test_without_opengl_the_run_finishes_and_says_why(tmp_path: Path, mjsheaf: Callable) -> None:
    out = tmp_path / "out"
    done = mjsheaf("run", "midpoint", "--set", "time.end=0.2", "--out", out, MUJOCO_GL="nonsense")
    assert done.returncode == 0, done.stderr
    assert "note: no video:" in done.stderr
    assert {p.name for p in out.iterdir()} == DATA
    assert json.loads((out / "summary.json").read_text())["video"] is None


def test_run_from_an_empty_directory_goes_to_runs(tmp_path: Path, mjsheaf: Callable) -> None:
    done = mjsheaf("run", "midpoint", "--backend", "ideal", "--no-video", "--set", "time.end=0.2", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "midpoint-ideal" / "result.nc").is_file()
