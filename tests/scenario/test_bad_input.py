"""Bad input: exit code 2, one line that names file and field and says what is legal, and nothing written.

Oracle: the contract on errors (exit codes, one line on stderr, no traceback).
"""

import contextlib
import io
import pickle
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mjsheaf import load_scenario
from mjsheaf.cli.options import print_lines, print_note
from mjsheaf.errors import ScenarioError
from tests.builders import refused
from tests.commands import all_contents, answer_of

GOOD = {
    "agents": [{"id": "A1", "position": [0, 0]}, {"id": "A2", "position": [1.0, 0]}],
    "targets": [{"id": "T1", "position": [5, 5, 5]}],
    "communication": [["A1", "A2"]],
    "sensing": [["A1", "T1"]],
    "formations": [{"name": "pair", "shape": "line", "members": ["A1", "A2"], "spacing": 2}],
    "time": {"end": 0.1},
}

MISTAKES = [
    ("gain: 3", "gain", "unknown field", "controller"),
    ("controller: {gian: 3}", "controller.gian", "unknown field", "; did you mean gain?"),
    ("controller: {gain: ten}", "controller.gain", "'ten'"),
    ("controller: {gain: true}", "controller.gain", "True"),
    ("controller: {gain: .nan}", "controller.gain", "finite"),
    ("controller: {gain: -1}", "controller.gain", "above 0"),
    ("anchors: [{agent: A1, axes: [z], value: [1]}]", "anchors.0", "axes", "[z]", "A1 has x, y"),
    ("physics: {timestep: 1e-310}", "physics.timestep", "at least 1e-09"),
    ("physics: {contacts: yes}", "physics.contacts", "'yes'"),
    (
        "disturbance: {agents: {bound: 1, frequencies: [1, 1e9]}}",
        *("disturbance.agents: frequencies", "1e+09 Hz over 0.1 s", "at most 1e+07 rad", "time.end up to", "Hz"),
    ),
    ("sensing: [{between: [A1, T1], weight: -2}]", "sensing.0.weight: expected"),
    ("sensing: [{between: [A1, T1], weight: [[1, x]]}]", "sensing.0.weight.0.1: ", "'x'"),
    ("sensing: [{between: [A1, T1], weight: [[1, 2], [2, 1]]}]", "not symmetric positive definite", "A1", "T1"),
    ("sensing: [{between: [A1, T1], offset: [1]}]", "sensing.0", "offset"),
    ("sensing: [{between: [A1, T1], map: identity}]", "sensing.0", "shared"),
    ("sensing: [{between: [A1, T1], map: magic}]", "sensing.0.map: ", "'shared'"),
    ("sensing: [{between: [A1, T1], map: {tail: [[1, 0]]}}]", "sensing.0.map.head: missing"),
    ("sensing: [{between: [A1, T1], map: {tail: [[1, 0, 0]], head: [[1]]}}]", "0: map.tail", "(1, 3)", "(m, 2)"),
    ("sensing: [{between: [A1, T1], map: {tail: [[1, 0]], head: [[1, 0]]}}]", "0: map.head", "(1, 2)", "(1, 3)"),
    ("sensing: [{between: [A1, T1], map: {tail: [[1, 0], [1]], head: [[1]]}}]", "0: map.tail", "lengths"),
    ("communication: [[A1, A1]]", "communication.0", "loop"),
    ("target_edges: [{between: [T1, T2], noise: 1}]", "target_edges.0.noise", "targets have no links", "weight"),
    (f"target_motion: {{kind: {'a' * 3000}}}", "target_motion.kind: unknown 'aaaa", "...", "waypoints"),
    ("target_motion: {speed: 1}", "target_motion.kind: missing"),
    (
        "target_motion: {kind: lissajous, amplitude: [1, 1], rate: [1, 1], phase: [0, 0]}",
        *("targets", "amplitude", "dimension 3"),
    ),
    (r'target_motion: {kind: file, path: "\e]0;x\a"}', "target_motion: ", r"/\x1b]0;x\x07: No such"),
    ("target_motion: {kind: file, path: ''}", "target_motion: ", "directory"),
    ("time: {end: 1e308}", "time.end", "at most 1e+09"),
    ("time: {start: 3, end: 1}", "time", "after start"),
    ("time: {end: 0.001}", "time", "end", "control periods"),
    ("agents: []", "agents"),
    (
        "agents: [{id: A1, position: [0, 0], effectiveness: {layout: [[1, 0], [2, 0]]}}, {id: A2, position: [1, 0]}]",
        *("agents", "full row rank"),
    ),
    ("targets: [{id: A1, position: [0, 0]}]", "'A1'", "twice"),
    ("targets: [{id: a/b, position: [0, 0]}]", "targets.0.id", "letters"),
    ("targets: [{id: T1, position: [0, 0, 0, 0]}]", "targets.0.position", "3"),
    ("formations: [{name: pair, shape: blob, members: [A1, A2]}]", "formations.0", "'blob'", "polygon"),
    ("formations: [{name: p, shape: line, members: [A1, A2], spacing: 2, about: A1}]", "formations.0", "about", "T1"),
    ("flow: {agents: {dimension: 2, sources: [{centre: [0, 0], alpha: 1}]}}", "flow.agents", "core"),
    ("events: [{time: 0.05, set: {controller..gain: 1}}]", "events.0", "set", "'controller..gain'", "empty"),
    ("events: [{time: 0.05, set: {controller: {}}}]", "events.0: set.controller: names no field"),
    (r'scene: {vehicle_scales: {"\e[2J": 2}}', r"vehicle_scales.\x1b[2J: there"),
    ("video: {width: 641}", "video.width", "multiple of 2"),
]
"""Sections of a file, and the words that the message must contain."""


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake[0][:60])
def test_each_mistake_is_one_clear_line(mistake: tuple[str, ...], tmp_path: Path) -> None:
    section, *expected = mistake
    rest = {name: value for name, value in GOOD.items() if not section.startswith(f"{name}:")}
    path = tmp_path / "mistake.yaml"
    path.write_text(f"{yaml.safe_dump(rest)}{section}\n")
    _refused(["run", str(path), "--backend", "ideal", "--no-video"], [str(path), *expected], tmp_path)


BROKEN = {
    "broken YAML": (b"agents: [1, 2\ntargets: 3\n", ["line"]),
    "empty": (b"", ["empty"]),
    "a list": (b"- 1\n- 2\n", ["list", "mapping"]),
    "binary": (bytes(range(256)), ["UTF-8"]),
    "control characters": (b"a: \x01\n", ["allowed"]),
    "a tag": (b"agents: !!python/object/apply:os.system ['true']\n", ["line 1", "tag"]),
    "an anchor": (b"a: &x [1]\nb: *x\n", ["line 1", "anchor"]),
    "a key twice": (b"seed: 1\nseed: 2\n", ["'seed'", "twice"]),
    "a key that is no text": (b"1: 2\n", ["1", "not text"]),
    "a bomb": (b"a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: &d [*c, *c]\n", ["line 1", "anchor"]),
    "an endless number": (b"seed: " + b"9" * 5000, ["5000 digits"]),
    "endless nesting": (b"a: " + b"[" * 20000, ["deep"]),
    "endless nesting of keys": (b"? " * 20000, ["deep"]),
    "endless nesting of lines": (b"".join(b" " * k + b"a:\n" for k in range(300)), ["line", "deep"]),
    "a key that a terminal obeys": (yaml.safe_dump(GOOD).encode() + b'"\\e[2J": 1\n', ["\\x1b[2J: unknown field"]),
}


@pytest.mark.parametrize("name", BROKEN)
def test_files_that_are_no_scenario(name: str, tmp_path: Path) -> None:
    data, expected = BROKEN[name]
    path = tmp_path / "broken.yaml"
    path.write_bytes(data)
    _refused(["run", str(path)], [str(path), *expected], tmp_path)


USAGE: dict[str, tuple[list[str], list[str]]] = {
    "missing file": (["run", "{tmp}/none.yaml"], ["none.yaml", "No such file"]),
    "a directory": (["run", "{tmp}"], ["directory"]),
    "unknown name": (["run", "papper"], ["papper", "paper"]),
    "unknown backend": (["run", "midpoint", "--backend", "real"], ["real", "physics"]),
    "override without value": (["run", "midpoint", "--set", "controller.gain"], ["PATH=VALUE"]),
    "override of an unknown item": (["run", "midpoint", "--set", "agents.A9.heading=3"], ["A9", "A1"]),
    "override of an item by a strange digit": (["run", "midpoint", "--set", "agents.²=3"], ["'²'", "A1"]),
    "override inside a number": (["run", "midpoint", "--set", "seed.x=3"], ["seed", "whole number"]),
    "override of endless dots": (["run", "midpoint", "--set", "a" + ".a" * 5000 + "=3"], ["--set", "10001 characters"]),
    "override of nothing between dots": (["run", "midpoint", "--set", "controller..gain=3"], ["--set", "..", "empty"]),
    "grid of nothing between dots": (["sweep", "midpoint", "--grid", "a..b=3", "--out", "s"], ["--grid", "empty"]),
    "override that is not YAML": (["run", "midpoint", "--set", "seed=[1"], ["--set seed"]),
    "seed that is no number": (["run", "midpoint", "--seed", "x"], ["--seed", "integer"]),
    "unknown option": (["run", "midpoint", "--fast"], ["--fast"]),
    "unknown command": (["fly"], ["fly"]),
    "missing argument": (["run"], ["SCENARIO"]),
    "output is here": (["run", "midpoint", "--out", "."], [".: is the current directory", "--out"]),
    "output is a mount point": (["run", "midpoint", "--out", "/dev/shm"], ["/dev/shm"]),
    "video of nothing": (["video", "{tmp}"], ["result.nc"]),
    "period no multiple": (
        ["run", "midpoint", "--set", "controller.control_period=0.0031"],
        ["physics.timestep", "controller.control_period", "multiple"],
    ),
    "unknown vehicle": (["run", "midpoint", "--set", "vehicles.agents=rocket"], ["rocket", "hull"]),
    "vehicle of the wrong dimension": (["run", "midpoint", "--set", "vehicles.agents=aerial"], ["A1", "aerial"]),
}  # fmt: skip


@pytest.mark.parametrize("name", USAGE)
def test_usage(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments, expected = USAGE[name]
    monkeypatch.chdir(tmp_path)
    _refused([a.replace("{tmp}", str(tmp_path)) for a in arguments], expected, tmp_path)


PLACES: dict[str, tuple[dict[str, str], str]] = {
    "file": ({"out": "mine"}, "out"),
    "below a file": ({"file": "mine"}, "file/out"),
    "foreign directory": ({"out/summary.json": "{}"}, "out"),
    "foreign file in a run": ({"out/summary.json": '{"mjsheaf_version": "0"}', "out/notes.txt": "mine"}, "out"),
    "link": ({}, "link"),
    "read-only parent": ({}, "/proc/mjsheaf/out"),  # where nobody, the superuser included, makes directories
}
"""Files that are there, and where the run is to go."""


@pytest.mark.parametrize("name", PLACES)
def test_output_is_never_put_over_what_is_not_ours(name: str, tmp_path: Path) -> None:
    files, place = PLACES[name]
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    for file, text in files.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text)
    run = ["run", "midpoint", "--backend", "ideal", "--no-video", "--set", "time.end=0.1"]
    _refused([*run, "--out", str(tmp_path / place)], [str(tmp_path / place)], tmp_path)


def test_every_mistake_has_a_line(tmp_path: Path) -> None:
    """Unknown fields first: a field that is missing may be one of them, misspelt."""
    path = tmp_path / "mistakes.yaml"
    wrong = {"time": {"end": -1, "start": "x"}, "sede": 3, "controller": {"gian": 1}}
    path.write_text(yaml.safe_dump(GOOD | wrong))

    def told() -> list[str]:
        answer = answer_of("check", path)
        assert (answer.code, answer.out) == (2, "")
        assert all(line.startswith(f"mjsheaf: {path}: ") for line in answer.err.splitlines())
        return [line.removeprefix(f"mjsheaf: {path}: ") for line in answer.err.splitlines()]

    assert [line.split(";")[0] for line in told()] == [
        "controller.gian: unknown field",
        "sede: unknown field",
        "time.start: expected a number, not 'x'",
        "time.end: expected at least 0, not -1",
    ]
    path.write_text(yaml.safe_dump(GOOD | {f"f{k:02}": 1 for k in range(26)}))
    lines = told()
    assert [line[:4] for line in lines[:10]] == [f"f{k:02}:" for k in range(10)]
    assert lines[9] == "f09: unknown field"
    assert lines[10:] == ["and 16 more errors"]
    with pytest.raises(ScenarioError) as caught:
        load_scenario(GOOD | wrong)
    assert len(caught.value.args) == 4
    assert str(caught.value).count("\n") == 3


def test_overrides_in_python_have_the_same_limits() -> None:
    deep: dict[str, object] = {}
    for _ in range(3000):
        deep = {"a": deep}
    with refused(ScenarioError, "nested more than 50 deep"):
        load_scenario("midpoint", {"controller": deep})
    with refused(ScenarioError, "nested more than 50 deep"):
        load_scenario({"agents": deep})


@pytest.mark.slow
@settings(max_examples=200)
@given(text=st.text(min_size=1, max_size=20))
def test_no_text_of_a_user_reaches_the_terminal_raw(text: str) -> None:
    """Whatever quotes it: an error, a note, a line of output."""
    shown = str(ScenarioError(f"{text}: wrong"))
    assert shown.isprintable()
    assert str(ScenarioError(shown)) == shown
    for print_it in (lambda: print_lines(text), lambda: print_note(text)):
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            print_it()
        assert all(line.isprintable() for line in out.getvalue().split("\n"))


def test_a_message_has_an_end() -> None:
    assert len(str(ScenarioError("x" * 100_000))) <= 4000
    assert pickle.loads(pickle.dumps(ScenarioError("a", "b"))).args == ("a", "b")


def _refused(arguments: list[str], expected: list[str], folder: Path) -> None:
    before = all_contents(folder)
    answer = answer_of(*arguments)
    assert answer.code == 2, answer
    assert answer.err.count("\n") == 1, answer.err
    assert "Traceback" not in answer.err
    assert all(line.endswith(" s since the start") for line in answer.out.splitlines())  # progress of a slow machine
    for word in expected:
        assert word in answer.err
    assert all_contents(folder) == before
