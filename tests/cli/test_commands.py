"""Every command, as a user runs it.

Oracle: the contract (exit codes, files left, fields of summary.json).
"""

import json
import os
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import jsonschema
import pytest
import xarray as xr
import yaml

import mjsheaf as package
from mjsheaf.files import list_studies
from mjsheaf.results.store import FILES
from mjsheaf.runs.expecting import Trial, loose
from mjsheaf.scenario import Scenario, list_scenarios, load_scenario
from mjsheaf.vehicles.loading import list_vehicles
from tests.builders import RAFT, shipped
from tests.commands import (
    CAN_DRAW,
    DATA_FILES,
    RUN_FILES,
    SMALL,
    Answer,
    Published,
    all_contents,
    answer_of,
    call,
    drawing,
    is_refusal,
    one_line,
    python,
    start,
    wait_until,
)

QUICK = ["--backend", "ideal", "--no-video"]


EVERY = [(name, backend) for name in list_scenarios() for backend in ("ideal", "physics")]
QUICKLY_FILMED = [("midpoint", "ideal")]
"""Tests below draw the video of a diverging run on bodies; the slow tests draw those of healthy runs."""
LONG_ON_BODIES = ("certified", "harbour_gusts", "narrow_gate", "range_formation", "swarm_radio_shadow")
"""Scenarios whose runs on bodies take long, or have a loop that no other test compiles."""
IN_TURN = [run for k, run in enumerate(EVERY) if (k % 2 == 0 if run[0] in LONG_ON_BODIES else k % 4 in (0, 3))]
"""Each scenario on one of the backends."""


@pytest.mark.parametrize(
    ("name", "backend"),
    [
        *(
            pytest.param(*run, marks=[] if k % 12 == 0 else [pytest.mark.slow(each=True)])
            for k, run in enumerate(IN_TURN)
        ),
        *(pytest.param(*run, marks=pytest.mark.long) for run in EVERY if run not in IN_TURN),
    ],
)
def test_run_of_every_scenario(name: str, backend: str, published: Published) -> None:
    """To its end, with its expectations, which are met and at most a tenth wider than what is found."""
    (code, _, err), out = published(name, backend)
    refused = shipped()[name].expect.refused
    if refused is not None:
        assert code == (1 if name == "air_tracks_surface" else 2)
        assert one_line(err, refused)
        assert not out.exists()
        return
    assert code == 0, err
    assert {p.name for p in out.iterdir()} - {"vehicles"} == DATA_FILES  # which has a copy of the file of a flow
    summary = json.loads((out / "summary.json").read_text())
    assert summary.keys() >= {"scenario", "backend", "status", "seed", "steps", "wall_time_s", "realtime_factor"}
    assert summary["status"] == "finished"
    assert summary["expect"]["met"]
    assert loose(Trial(backend, "finished", "", checks=summary["expect"]["checks"]), 1.1) == []
    measures = {"mean_disagreement", "tracking_error", "formation_error", "centering_error", "groups"}
    assert summary["final"].keys() >= measures
    with xr.open_dataset(out / "result.nc", engine="h5netcdf") as ds:
        assert ds.attrs["scenario"] == name
        assert float(ds["time"][-1]) == pytest.approx(summary["final"]["time"])


@pytest.mark.parametrize(
    ("name", "backend"),
    [
        pytest.param(*run, marks=[] if run in QUICKLY_FILMED else [pytest.mark.slow])
        for run in dict.fromkeys([*QUICKLY_FILMED, *EVERY[::4], *EVERY[3::4]])  # the backends in turn
        if shipped()[run[0]].expect.refused is None and (run in QUICKLY_FILMED or run[0] not in dict(QUICKLY_FILMED))
    ],
)
def test_run_and_video_of_every_scenario(name: str, backend: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert call("run", name, "--backend", backend, "--set", "time.end=0.5", *SMALL, "--out", out) == 0
    assert {p.name for p in out.iterdir()} - {"vehicles"} == (set(FILES) if CAN_DRAW else RUN_FILES)
    if CAN_DRAW and (name, backend) in QUICKLY_FILMED:
        film_again(out)


def film_again(out: Path) -> None:
    """The command `video` replaces the video of a run and its entry in summary.json, and nothing else."""
    before = json.loads((out / "summary.json").read_text())
    assert call("video", out, "--width", "192", "--height", "128", "--fps", "4", "--elevation", "-80") == 0
    meta = next(imageio_ffmpeg.read_frames(str(out / "video.mp4")))
    assert meta["size"] == (192, 128)
    assert meta["fps"] == 4
    assert meta["codec"] == "h264"
    assert meta["pix_fmt"].startswith("yuv420p")
    again = json.loads((out / "summary.json").read_text())
    frames, _ = imageio_ffmpeg.count_frames_and_secs(str(out / "video.mp4"))
    assert again.pop("video") == {"frames": frames, "width": 192, "height": 128, "fps": 4}
    assert again == {k: v for k, v in before.items() if k != "video"}
    assert {p.name for p in out.iterdir()} - {"vehicles"} == set(FILES)


@pytest.mark.long
@pytest.mark.parametrize(
    ("backend", "gain"), [("ideal", "60"), ("physics", "60"), ("ideal", "1e9"), ("physics", "400")]
)
def test_unstable_run_is_published_and_exits_3(
    backend: str, gain: str, tmp_path: Path, mjsheaf: Callable[..., Any]
) -> None:
    """Thrusters of 1e9 N hold a gain of 60 back to a limit cycle of a kilometre. No library says more to a terminal."""
    out = tmp_path / "out"
    done = mjsheaf("run", "paper", "--backend", backend, "--set", f"controller.gain={gain}", *SMALL, "--out", out)
    assert done.returncode == 3
    words = ["unstable", "mjsheaf check names the margin"]
    assert done.stderr.count("\n") == 1, done.stderr
    for word in [*words, " at t = ", str(out)]:
        assert word in done.stderr
    summary = json.loads((out / "summary.json").read_text(), parse_constant=pytest.fail)
    assert summary["status"] == "unstable"
    assert {p.name for p in out.iterdir()} == (set(FILES) if CAN_DRAW else RUN_FILES)
    with xr.open_dataset(out / "result.nc", engine="h5netcdf") as ds:
        # A gain of 1e9 asks for more than any speed at once.
        assert len(ds["time"]) == 1 if (backend, gain) == ("ideal", "1e9") else 1 < len(ds["time"]) < 4999
        assert ds.attrs["status"] == "unstable"
    assert "unstable: unstable" not in done.stdout
    if CAN_DRAW and (backend, gain) == ("ideal", "60"):
        film_again(out)


Short = Callable[..., tuple[Answer, dict[str, Any]]]


@pytest.fixture
def short(tmp_path: Path, request: pytest.FixtureRequest) -> Short:
    """Run midpoint, or another scenario, for a tenth of a second: its answer and its summary."""
    request.getfixturevalue("without_plots")

    def run(*options: str, name: str = "midpoint", end: str = "0.1") -> tuple[Answer, dict[str, Any]]:
        answer = answer_of("run", name, *QUICK, "--set", f"time.end={end}", *options, "--out", tmp_path / "out")
        path = tmp_path / "out" / "summary.json"
        return answer, json.loads(path.read_text()) if path.exists() else {}

    return run


@pytest.mark.slow(first=True)
def test_expectation_missed_exits_1(short: Short) -> None:
    answer, summary = short()
    assert (answer.code, summary["expect"]["met"]) == (0, False)
    answer, _ = short("--expect")
    assert answer.code == 1
    assert "tracking_error is" in answer.err
    whole = load_scenario("midpoint").time.end
    assert short("--expect", end=str(whole))[0].code == 0


def test_run_that_should_have_been_refused(short: Short) -> None:
    answer, summary = short("--set", "expect.refused=free to drift")
    assert (answer.code, summary["expect"]["met"]) == (0, False)
    assert "NOT as expected" in answer.out
    answer, summary = short("--set", "expect.refused=free to drift", "--expect")
    assert answer.code == 1
    expected = {"measure": "refused", "bound": "free to drift", "found": None, "met": False}
    assert summary["expect"]["checks"][0] == expected
    assert one_line(answer.err, "midpoint", "ran", "'free to drift'")


@pytest.mark.parametrize(("name", "code"), [("air_tracks_surface", 1), ("lost_thruster", 2)])
def test_run_refused_for_another_reason(name: str, code: int, short: Short) -> None:
    end = str(load_scenario(name).time.end)
    answer, _ = short("--expect", name=name, end=end)
    assert answer.code == code
    assert "expected" not in answer.err
    answer, _ = short("--expect", "--set", "expect.refused=too windy", name=name, end=end)
    assert answer.code == code
    assert one_line(answer.err, name, "expect.refused", "'too windy'")


def test_missed_expectation_of_what_is_not_measured(short: Short) -> None:
    answer, _ = short("--expect", "--set", "expect.ideal.formation_error=1")
    assert answer.code == 1
    assert one_line(answer.err, "midpoint", "formation_error", 1)


@pytest.mark.parametrize("way", [["--seed", "5"], ["--set", "seed=5"]])
def test_seed_that_changes_nothing_is_said(way: list[str], short: Short) -> None:
    answer, summary = short(*way)
    assert (answer.code, summary["seed"]) == (0, 5)
    assert re.search(r"\bnote: .*\bseed\b", answer.err)


@pytest.mark.slow
def test_list_schema_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("list") == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in list_scenarios())
    assert all(name in listed[listed.index("studies, for mjsheaf sweep") :] for name in list_studies())
    assert call("list", "--vehicles", RAFT) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in ("hull", "aerial", "submersible"))
    row = next(line.split() for line in listed.splitlines() if line.split()[:1] == ["raft"])
    assert row == ["raft", "60", "1.2", "4", "113", "0.585", "1.89", "1.33"]
    assert call("list", RAFT) == 2
    capsys.readouterr()
    assert call("schema") == 0
    assert json.loads(capsys.readouterr().out) == Scenario.model_json_schema()  # to which every scenario is held
    for option, files in (("--study", list_studies()), ("--vehicle", list_vehicles())):
        assert call("schema", option) == 0
        schema = json.loads(capsys.readouterr().out)
        for path in files.values():
            jsonschema.validate(yaml.safe_load(path.read_text()), schema)
    assert call("schema", "--study", "--vehicle") == 2
    assert call("--version") == 0
    assert capsys.readouterr().out == f"mjsheaf {package.__version__}\n"


@pytest.mark.parametrize("command", [[], ["run"], ["video"], ["list"], ["schema"]])
def test_help(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert call(*command, "--help") == 0
    assert "Usage" in capsys.readouterr().out


def test_no_command_at_all_shows_help_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert call() == 2
    printed = capsys.readouterr()
    assert "Usage" in printed.out + printed.err
    assert "see mjsheaf --help" not in printed.err


def test_example_of_an_override_in_help_works(short: Short) -> None:
    assert "sensing.0.weight=2" in answer_of("run", "--help").out
    assert short("--set", "sensing.0.weight=2")[0].code == 0


def test_table_fits_a_narrow_terminal(short: Short, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    answer, _ = short(name="paper")
    assert answer.code == 0
    lines = answer.out[answer.out.index("paper on ideal") :].splitlines()
    rows = [line.split(" ")[0] for line in lines]
    groups = [group.name for group in load_scenario("paper").formations]
    headings = rows.index("team") - 1
    assert headings <= 3
    assert rows[2 + headings :][: len(groups)] == groups
    assert max(map(len, lines[: 2 + headings + len(groups)])) <= 80


@pytest.mark.long
@pytest.mark.usefixtures("without_plots")
def test_output_stays_out_of_the_directories_of_runs(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    run: list[str | Path] = ["run", "midpoint", *QUICK, "--set", "time.end=0.1", *SMALL]
    assert call(*run, "--out", first) == call(*run, "--out", second) == 0
    before = all_contents(tmp_path)
    for directory in (first, second):
        for arguments in (
            ["video", first, "--out", directory / "second.mp4"],
            ["video", first, "--out", second / "video.mp4"],
            [*run, "--out", directory / "inside"],
            [*run, "--out", directory / "deep" / "inside"],
        ):
            assert is_refusal(answer_of(*arguments), "directory")
    assert all_contents(tmp_path) == before
    assert call(*run, "--out", first) == 0


@pytest.mark.long
def test_video_that_cannot_be_written(short: Short, tmp_path: Path) -> None:
    run = tmp_path / "out"
    assert short()[0].code == 0
    (tmp_path / "folder.mp4").mkdir()
    for out, told in (
        ("/proc/x.mp4", "/proc/x.mp4: cannot be written" if CAN_DRAW else "no video"),
        (tmp_path / "folder.mp4", "folder.mp4: expected a file"),
        (tmp_path / "none" / "x.mp4", "no directory"),
        (tmp_path / "x.avi", "ends in .mp4"),
    ):
        assert is_refusal(answer_of("video", run, "--out", out), told)


@pytest.mark.long
def test_a_run_is_not_shown_again_with_data_of_another(short: Short, tmp_path: Path) -> None:
    run = tmp_path / "out"
    assert short()[0].code == 0
    own = (run / "scenario.yaml").read_text()
    (run / "scenario.yaml").write_text(own.replace("A1", "A9"))
    for command in ("video", "plot", "report"):
        told = f"{run}: result.nc and scenario.yaml do not match: their agents differ"
        assert is_refusal(answer_of(command, run), told)
    xr.Dataset({"x": 1.0}).to_netcdf(run / "result.nc", engine="h5netcdf")
    assert is_refusal(answer_of("video", run), run, "result.nc has changed since the run")


@pytest.mark.slow
def test_a_bound_beyond_all_measure_is_no_trouble(short: Short) -> None:
    assert short("--set", "controller.gain=1e-300")[0].code == 0


def test_warnings_of_libraries_are_not_shown() -> None:
    done = python(
        "import warnings\nfrom mjsheaf.cli import main, tools\n"
        "tools.schema_of = lambda what: warnings.warn('odd', RuntimeWarning)\nmain(['schema'])"
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
@pytest.mark.slow
@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_signal_stops_a_run_and_leaves_nothing(
    number: signal.Signals, code: int, word: str, backend: str, tmp_path: Path
) -> None:
    out = tmp_path / "deep" / "out"
    arguments = ["run", "paper", "--backend", backend, "--no-video", "--set", "time.end=40000", "--out", str(out)]
    with start(*arguments, process_group=0) as process:
        wait_until(lambda: out.parent.is_dir() and any(out.parent.iterdir()))
        time.sleep(1.0)
        process.send_signal(number)
        _, error = process.communicate(timeout=60)
    assert process.returncode == code
    assert one_line(error, word)
    assert list(tmp_path.iterdir()) == []


@drawing
@pytest.mark.long
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signal_stops_a_film_and_keeps_the_old_one(number: signal.Signals, code: int, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert call("run", "midpoint", "--backend", "ideal", "--set", "time.end=0.5", *SMALL, "--out", run) == 0
    before = {p.name: p.read_bytes() for p in run.iterdir()}
    with start("video", str(run), "--fps", "240", "--speed", "0.001", process_group=0) as process:
        wait_until(lambda: any(p.name.startswith(".video.") and p.stat().st_size > 0 for p in run.iterdir()))
        os.killpg(process.pid, number)  # as a terminal does: ffmpeg receives the signal too
        _, error = process.communicate(timeout=60)
    assert process.returncode == code
    assert error.count("\n") == 1
    assert {p.name: p.read_bytes() for p in run.iterdir()} == before


def test_an_interrupt_while_libraries_are_loaded_is_one_line() -> None:
    script = (
        "import os, signal, sys\n"
        "class Slow:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'typer':\n            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Slow())\n"
        "from mjsheaf.__main__ import start\nstart()"
    )
    done = python(script)
    assert (done.returncode, done.stdout) == (130, "")
    assert one_line(done.stderr, "interrupted", "nothing was written")


def test_signal_that_was_lost_stops_the_work_at_the_next_report() -> None:
    script = (
        "import gc, os, signal\nfrom mjsheaf.cli import tools, main\nfrom mjsheaf.cli.options import progress_bars\n"
        "class Lossy:\n    def __del__(self):\n        os.kill(os.getpid(), signal.SIGINT)\n"
        "def work(what):\n"
        "    with progress_bars() as report:\n        Lossy()\n        print('went on')\n        report('work', 1, 2)\n"
        "        print('not here')\n"
        "tools.schema_of = work\nmain(['schema'])"
    )
    done = python(script)
    assert (done.returncode, done.stdout) == (130, "went on\n")
    assert one_line(done.stderr, "interrupted")
