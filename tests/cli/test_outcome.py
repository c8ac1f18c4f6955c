"""Output of `mjsheaf run`, the result first, and its files after its video is interrupted.

Oracle: summary.json.
"""

import json
import signal
from pathlib import Path

import pytest

from mjsheaf.cli.run import print_outcome
from mjsheaf.runs.publish import Outcome
from tests.commands import RUN_FILES, answer_of, one_line, python

pytestmark = pytest.mark.usefixtures("without_plots")
RUN = ("run", "midpoint", "--backend", "ideal", "--set", "time.end=0.5")


def without_progress(text: str) -> list[str]:
    """Return the lines of a text that are not about progress; a busy machine prints more of those."""
    return [line for line in text.splitlines() if not line.endswith(" s since the start")]


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
    begins = ("midpoint on ideal, errors in m", f"note: {notes[0][:30]}", f"  {tmp_path}")
    places = [next(k for k, line in enumerate(lines) if line.startswith(begin)) for begin in begins]
    assert places == sorted(places)
    assert answer.err == ""


@pytest.mark.parametrize(
    ("change", "begin", "within"),
    [
        ("expect.ideal={tracking_error: 100, mean_disagreement: 200}", "as expected: ", ("tracking ", "at most 100")),
        ("expect.ideal=null", "no expectation", ()),
        ("expect.controller=own.py:mine", "no expectation: the bounds are for the law own.py:mine", ()),
    ],
)
def test_the_third_line_says_what_was_expected(
    change: str, begin: str, within: tuple[str, ...], tmp_path: Path
) -> None:
    lines = without_progress(answer_of(*RUN, "--set", change, "--no-video", "--out", tmp_path / "out").out)
    assert lines[2].startswith(begin)
    assert all(words in lines[2] for words in within)


def test_that_bodies_exceed_the_bound_of_ideal_kinematics_is_no_news(tmp_path: Path) -> None:
    answer = answer_of("run", "midpoint", "--set", "time.end=2", "--no-video", "--out", tmp_path / "out")
    assert answer.out.startswith("midpoint: 1 agent and 2 targets on MuJoCo bodies, 2 s\n")
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
    done = python(script)
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
