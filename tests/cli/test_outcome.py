"""Output of `mjsheaf run`, the result first, and its files after its video is interrupted.

Oracle: summary.json.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mjsheaf.cli.run import print_outcome, print_start
from mjsheaf.runs.publish import Outcome
from mjsheaf.scenario import load_scenario
from tests.commands import RUN_FILES, answer_of, heed_interrupts, one_line

pytestmark = pytest.mark.usefixtures("without_plots")
RUN = ("run", "midpoint", "--backend", "ideal", "--set", "time.end=0.5")


def without_progress(text: str) -> list[str]:
    """Return the lines of a text that are not about progress; a busy machine prints more of those."""
    return [line for line in text.splitlines() if not line.endswith(" s since the start")]


def place_of(lines: list[str], begin: str) -> int:
    """The number of the first line that begins so."""
    return next(k for k, line in enumerate(lines) if line.startswith(begin))


def test_the_result_comes_first_and_notes_after_the_numbers(tmp_path: Path) -> None:
    answer = answer_of(*RUN, "--set", "controller.velocity_limit=0.1", "--no-video", "--out", tmp_path / "out")
    lines = without_progress(answer.out)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert lines[0] == "midpoint: 1 agent and 2 targets on ideal kinematics, 0.5 s"
    assert lines[1].startswith(f"finished: at 0.5 s the agents are {summary['final']['tracking_error']:.3g} m from")
    assert "RMS over agents" in lines[1]
    assert lines[2].startswith("NOT as expected: mean_disagreement is ")
    assert lines[2].endswith("(the expectation is for the scenario without --set)")
    notes = [note["text"] for note in summary["notes"]]
    assert notes
    assert (
        place_of(lines, "midpoint on ideal, errors in m")
        < place_of(lines, f"note: {notes[0][:30]}")
        < place_of(lines, f"  {tmp_path}")
    )
    assert answer.err == ""


def test_what_holds_is_told_with_its_bounds(tmp_path: Path) -> None:
    changes = ["--set", "expect.ideal={tracking_error: 100, mean_disagreement: 200}", "--no-video"]
    lines = without_progress(answer_of(*RUN, *changes, "--out", tmp_path / "out").out)
    assert lines[2].startswith("as expected: ")
    assert "tracking " in lines[2]
    assert "at most 100" in lines[2]


def test_without_an_expectation_it_says_so(tmp_path: Path) -> None:
    changes = ["--set", "expect.ideal=null", "--no-video"]
    lines = without_progress(answer_of(*RUN, *changes, "--out", tmp_path / "out").out)
    assert lines[2].startswith("no expectation")


def test_bounds_for_another_law_are_said_to_be(tmp_path: Path) -> None:
    changes = ["--set", "expect.controller=mylaw.py:mine", "--no-video"]
    lines = without_progress(answer_of(*RUN, *changes, "--out", tmp_path / "out").out)
    assert lines[2] == "no expectation: the bounds are for the law mylaw.py:mine"


def test_the_first_line_is_there_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    print_start(load_scenario("paper"), "physics")
    assert capsys.readouterr().out == "paper: 13 agents and 4 targets on MuJoCo bodies, 49.98 s\n"


def test_notes_are_in_order_of_importance(tmp_path: Path) -> None:
    """A limit matters more than a team that still approaches, and that more than an aircraft below the surface."""
    changes = ["--set", "scene.height=50", "--set", "controller.velocity_limit=0.5", "--no-video"]
    assert answer_of("run", "harbour", "--set", "time.end=2", *changes, "--out", tmp_path / "out").code == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    kinds = [note["kind"] for note in summary["notes"]]
    assert kinds[-1] == "submerged"
    assert "limited" in kinds
    assert kinds.index("limited") < kinds.index("submerged")


def test_that_bodies_exceed_the_bound_of_ideal_kinematics_is_no_news(tmp_path: Path) -> None:
    """The page and summary.json have it."""
    answer = answer_of("run", "midpoint", "--set", "time.end=2", "--no-video", "--out", tmp_path / "out")
    notes = json.loads((tmp_path / "out" / "summary.json").read_text())["notes"]
    assert [note["kind"] for note in notes] == ["bound"]
    assert "Theorem 1" in notes[0]["text"]
    assert "note" not in answer.out


INTERRUPTED = """
import os, sys
from mjsheaf.cli import main
from mjsheaf.runs import publish
from mjsheaf.video import draw
def film(films, path, *_):
    os.kill(os.getpid(), {number})
    raise AssertionError
publish.available_backend = lambda: ("none", "")
draw.draw_video = film
main({arguments})
"""


@pytest.mark.long
@pytest.mark.parametrize(("number", "code", "word"), [("SIGINT", 130, "interrupted"), ("SIGTERM", 143, "terminated")])
def test_a_signal_during_the_video_leaves_the_run_and_says_how_to_draw_it(
    number: str, code: int, word: str, tmp_path: Path
) -> None:
    out = tmp_path / "my out"
    script = INTERRUPTED.format(number=int(signal.Signals[number]), arguments=[*RUN, "--out", str(out)])
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, preexec_fn=heed_interrupts
    )
    assert done.returncode == code
    assert one_line(done.stderr, word, "complete except for its video", f"mjsheaf video '{out}'")
    assert "nothing was written" not in done.stderr
    assert {path.name for path in out.iterdir()} == RUN_FILES
    assert json.loads((out / "summary.json").read_text())["video"] is None
    assert "finished: " in done.stdout


def test_many_notes_groups_and_phases_leave_twenty_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "report.html").touch()
    for name in ("video.mp4", "result.nc", "errors.png"):
        (tmp_path / name).touch()
    numbers = dict.fromkeys(("mean_disagreement", "tracking_error", "formation_error", "centering_error"), 1.0)
    summary = {
        "scenario": "many",
        "backend": "ideal",
        "status": "finished",
        "expect": {"met": None},
        "final": {"time": 9.0, **numbers, "groups": {f"group {k}": numbers for k in range(9)}},
        "phases": [{"final": {"time": 1.0, **numbers}, "events": ["lose A1"]}] * 9,
        "notes": [{"kind": "stuck", "text": f"note number {k}"} for k in range(9)],
        "free_directions": [],
        "steps": 1,
        "wall_time_s": 1.0,
        "realtime_factor": 1.0,
        "communication": {"exchanges_per_second": 5.0, "numbers_per_agent_second": 7.0},
    }
    print_outcome(Outcome(tmp_path, summary, [], replaced="replaced the run of yesterday"))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 20
    assert "and 6 more notes in summary.json" in lines
    assert any(line.startswith("and 15 more in summary.json") for line in lines)
    assert lines[-2:] == [f"  {tmp_path / 'video.mp4'}: video", f"  {tmp_path}: errors.png, result.nc"]
