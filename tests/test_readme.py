"""What README shows works: commands end as they should, code runs and gives what its comments say, files are valid.

Oracle: README.md itself. Commands are shortened by options at their end: a fraction of a second, small films.
"""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydantic import TypeAdapter

from mjsheaf import load_scenario, simulate
from mjsheaf.studies import load_plan
from mjsheaf.vehicles.actuators import Azimuth
from tests.builders import RAFT, REPOSITORY
from tests.commands import answer_of, call

SHORT = ["--set", "time.end=0.2"]
SMALL = ["--set", "video.width=160", "--set", "video.height=120", "--set", "video.fps=2"]
SHORTENED = {"run": SHORT + SMALL, "compare": SHORT + SMALL, "sweep": SHORT, "video": ["--width", "160", "--fps", "1"]}
SLOW = {"compare", "sweep", "video", "report", "--expect", "--format", "controller.gain=30"}


def blocks(language: str) -> list[str]:
    text = (REPOSITORY / "README.md").read_text()
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands() -> list[Any]:
    """Every line of README that begins with mjsheaf, but for those on machines that are not here."""
    lines = [line for block in blocks("sh") for line in block.splitlines() if line.startswith("mjsheaf ")]
    found = dict.fromkeys(tuple(shlex.split(line, comments=True)[1:]) for line in lines if "HOST" not in line)
    return [
        pytest.param(words, id=" ".join(words), marks=[pytest.mark.slow] if SLOW & {*words} else []) for words in found
    ]


@pytest.mark.parametrize("words", commands())
def test_command_ends_as_it_should(words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if words[0] in ("video", "report"):  # which `make demo` leaves
        assert call("run", "paper", *SHORTENED["run"], "--out", words[1]) == 0
    shortened = [] if "--expect" in words else SHORTENED.get(words[0], [])
    if "swarm.size=1000" in words:
        shortened = [*shortened, "--set", "swarm.size=5"]
    answer = answer_of(*words, *(shortened or SMALL if words[0] == "run" else shortened))
    assert answer.code == (1 if words[:2] == ("check", "air_tracks_surface") else 0), answer.err
    if "--out" in words:
        assert (tmp_path / words[words.index("--out") + 1]).is_dir()


def test_terminal_shows_what_is_printed() -> None:
    for block in blocks("console"):
        prompt, _, *shown = block.splitlines()
        printed = answer_of(*shlex.split(prompt.removeprefix("$ mjsheaf "))).out.splitlines()
        begin = printed.index(shown[0])
        assert printed[begin : begin + len(shown)] == shown


def test_code_gives_what_its_comments_say(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A comment that begins with a value is what the expression before it gives."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    held = 0
    for code in blocks("python"):
        if "dask_jobqueue" in code:
            compile(code, "README.md", "exec")  # asks for a cluster
            continue
        names: dict[str, Any] = {"array": np.array}
        exec(compile(code, "README.md", "exec"), names)
        for expression, value in re.findall(r"^(\S.*?)  # (\([^)]*\)|True|False|array\([^)]*\))", code, re.MULTILINE):
            np.testing.assert_allclose(np.abs(eval(expression, names)), np.abs(eval(value, names)), atol=1e-12)
            held += 1
    assert held >= 3


def test_files_are_valid(tmp_path: Path) -> None:
    kinds = set()
    for text in blocks("yaml"):
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        fields = yaml.safe_load(text)
        if "mjcf" in fields:
            assert fields.items() <= yaml.safe_load(RAFT.read_text()).items()
            kinds.add("vehicle")
        elif "actuators" in fields:
            TypeAdapter(dict[str, Azimuth]).validate_python(fields["actuators"])
            kinds.add("part of a vehicle")
        elif "scenario" in fields:
            (runs,) = re.findall(r"# (\d+) runs", text)
            assert len(load_plan(str(path)).points) == int(runs)
            kinds.add("study")
        else:
            shorter = {} if "events" in fields else {"time.end": 0.2}
            assert simulate(load_scenario(path, shorter)).attrs["status"] == "finished"
            kinds.add("scenario")
    assert kinds >= {"vehicle", "study", "scenario"}
