"""Terms that users register: compiled into the law, on every backend, and seen by `check`.

Oracles: the paper's law at another gain; the shipped integral; the same run without compiling.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.checking.loop import linear_law
from mjsheaf.errors import InputError, UndecidedError
from mjsheaf.law import custom
from mjsheaf.runs.publish import write_scenario
from tests.commands import COMPILED, python

SOURCE = """
import mjsheaf


@mjsheaf.register(parameters=["gain"])
def steeper(residual, command, memory, parameters, period):
    for i in range(3):
        command[i] -= parameters[0] * residual[i]


@mjsheaf.register(parameters=["gain"], memory=3)
def summed(residual, command, memory, parameters, period):
    for i in range(3):
        command[i] -= parameters[0] * memory[i]
        memory[i] += period * residual[i]


@mjsheaf.register(parameters=["gain", "width"])
def bounded(residual, command, memory, parameters, period):
    for i in range(3):
        command[i] -= parameters[0] * residual[i] / (abs(residual[i]) + parameters[1])
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("terms") / "own_terms.py"
    path.write_text(SOURCE)
    return path


def with_term(file: Path, name: str, values: dict[str, float], **changes: Any) -> mjsheaf.Scenario:
    section = {"file": str(file), "parameters": values}
    return mjsheaf.load_scenario("midpoint", {"time.end": 1.0, f"controller.custom.{name}": section, **changes})


def require_alike(own: mjsheaf.Scenario, changes: dict[str, Any], *names: str) -> tuple[Any, Any]:
    """Compare a scenario with the shipped law: runs, and what `check` says of both laws, delays included."""
    shipped = mjsheaf.load_scenario("midpoint", {"time.end": 1.0, **changes})
    one, other = (mjsheaf.simulate(scenario, backend="ideal") for scenario in (own, shipped))
    np.testing.assert_allclose(one.agent_position, other.agent_position, rtol=0.0, atol=1e-12)
    found, expected = mjsheaf.check(own, trial=False), mjsheaf.check(shipped, trial=False)
    for name in names:
        assert found["law"][name] == pytest.approx(expected["law"][name], rel=1e-9)
    assert found["links"]["delay_margin"] == pytest.approx(expected["links"]["delay_margin"], rel=1e-12)
    return found["law"], expected["law"]


@pytest.mark.long
def test_a_term_along_eta_is_a_larger_gain(file: Path) -> None:
    scenario = with_term(file, "steeper", {"gain": 0.7})
    record, plain = require_alike(scenario, {"controller.gain": scenario.controller.gain + 0.7})
    assert record["spectral_radius"] == pytest.approx(plain["spectral_radius"], rel=1e-12)
    assert record["terms"] == ["steeper"]
    assert record["largest_gain"] == pytest.approx(plain["largest_gain"] - 0.7, rel=1e-9)
    assert record["radius"] is None
    assert "term steeper" in record["reason"]


@pytest.mark.long
def test_what_a_term_remembers(file: Path) -> None:
    names = ("spectral_radius", "rate", "largest_gain", "error_per_disturbance")
    require_alike(with_term(file, "summed", {"gain": 0.2}), {"controller.integral": {"gain": 0.2}}, *names)


def test_a_term_that_is_not_linear_is_undecided(file: Path) -> None:
    record = mjsheaf.check(with_term(file, "bounded", {"gain": 30.0, "width": 1e-3}), trial=False)
    assert record["ok"] is False
    assert record["law"]["unmodelled"] == ["term bounded"]
    assert record["law"]["stable"] is None
    assert record["margins"]["bodies"]["stable"] is None


@pytest.mark.parametrize(
    ("name", "section", "message"),
    [
        ("steper", {"parameters": {}}, "custom.steper: no term of this name"),
        ("steeper", {"parameters": {}}, "custom.steeper: parameters: gain missing"),
        ("steeper", {"parameters": {"gain": 1.0, "gian": 2.0}}, "parameters.gian: unknown"),
        ("steeper", {"file": "/nowhere/terms.py", "parameters": {"gain": 1.0}}, "there is no file"),
        ("steeper", {"file": "/nowhere/terms.py/", "parameters": {"gain": 1.0}}, "expected a Python file"),
    ],
)
def test_what_does_not_fit_is_refused(file: Path, name: str, section: dict[str, Any], message: str) -> None:
    with_term(file, "steeper", {"gain": 1.0})
    with pytest.raises(InputError, match=message):
        mjsheaf.load_scenario("midpoint", {f"controller.custom.{name}": section})


def test_a_continuous_law_has_no_terms(file: Path) -> None:
    with pytest.raises(InputError, match="control_period is 0"):
        with_term(file, "steeper", {"gain": 1.0}, **{"controller.control_period": 0.0})


@pytest.mark.parametrize(
    ("top", "body", "message"),
    [
        ("", "command[0] = undefined_name", "does not compile"),
        ("", "residual[0] = 0.0", "does not compile"),
        ("raise SystemExit(3)", "pass", "SystemExit"),
        ("raise ValueError('no')", "pass", "ValueError"),
    ],
)
def test_faults_of_a_file_are_one_message(tmp_path: Path, top: str, body: str, message: str) -> None:
    path = tmp_path / "faulty.py"
    source = f"import mjsheaf\n{top}\n@mjsheaf.register()\ndef faulty(residual, command, memory, parameters, period):\n"
    path.write_text(source + f"    {body}\n")
    with pytest.raises(InputError, match=message) as caught:
        with_term(path, "faulty", {})
    assert "controller.custom.faulty" in str(caught.value)


@pytest.mark.parametrize("name", ["newton", "integral"])
def test_names_of_shipped_terms_are_taken(name: str) -> None:
    def term(residual: Any, command: Any, memory: Any, parameters: Any, period: float) -> None: ...

    term.__name__ = name
    with pytest.raises(InputError, match="cannot be named"):
        mjsheaf.register()(term)


@pytest.mark.parametrize(
    "options", [{"parameters": "gain"}, {"parameters": ["a", "a"]}, {"memory": -1}, {"memory": 0.5}]
)
def test_options_of_register(options: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="register: "):
        mjsheaf.register(**options)


@pytest.mark.long
def test_engines_agree_across_phases(file: Path) -> None:
    scenario = with_term(file, "summed", {"gain": 0.5}, events=[{"time": 0.5, "set": {"controller.gain": 2.0}}])
    bodies = mjsheaf.simulate(scenario)
    fused = mjsheaf.simulate(scenario, engine="fused")
    np.testing.assert_allclose(fused.agent_position, bodies.agent_position, rtol=0.0, atol=1e-9)
    without = mjsheaf.simulate(mjsheaf.load_scenario("midpoint", {"time.end": 1.0}), engine="fused")
    assert float(abs(without.agent_position - fused.agent_position).max()) > 1e-4


@pytest.mark.long
def test_without_compiling_and_from_the_cache(file: Path, tmp_path: Path) -> None:
    """A second process compiles nothing; another source is another term; uncompiled, the run is the same."""
    script = COMPILED + (
        "import json, mjsheaf\n"
        f"section = {{'file': {str(file)!r}, 'parameters': {{'gain': 0.7}}}}\n"
        "changes = {'time.end': 0.2, 'controller.custom.steeper': section}\n"
        "run = mjsheaf.simulate(mjsheaf.load_scenario('midpoint', changes), backend='ideal')\n"
        "own = [name for name in compiled if name not in ('steeper', 'summed', 'bounded')]\n"
        "print(json.dumps([run.agent_position.values[-1, :, :2].tolist(), own]))\n"
    )

    def run(**environment: str) -> tuple[list[Any], list[str]]:
        position, compiled = json.loads(python(script, None, **environment).stdout)
        return position, compiled

    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    first, compiled = run(**cache)
    assert compiled
    again, compiled = run(**cache)
    assert compiled == []
    assert again == first
    interpreted, _ = run(NUMBA_DISABLE_JIT="1")
    np.testing.assert_allclose(interpreted, first, rtol=0.0, atol=1e-12)
    before = file.read_text()
    try:
        file.write_text(before.replace("command[i] -= parameters[0] * residual[i]\n", "command[i] -= residual[i]\n"))
        changed, compiled = run(**cache)
    finally:
        file.write_text(before)
    assert compiled
    assert changed != first


UNFIT = """
import mjsheaf


@mjsheaf.register(parameters=["gain", "kind"], memory=4)
def unfit(residual, command, memory, parameters, period):
    gain, kind = parameters[0], parameters[1]
    if kind == 0.0:  # crossed
        command[0] -= gain * residual[1]
        command[1] += gain * residual[0]
    elif kind == 1.0:  # one_axis
        command[1] -= gain * residual[1]
    elif kind == 2.0 or kind == 3.0:  # later, stirred
        if kind == 2.0 or residual[0] != 0.0:
            memory[0] += 1.0
        if memory[0] > 100.0:
            for i in range(3):
                command[i] -= gain * residual[i]
    elif kind == 4.0:  # latched
        for i in range(3):
            if memory[3] == 0.0:
                memory[i] = gain * residual[i]
            command[i] += memory[i]
        memory[3] = 1.0
    elif kind == 5.0:  # cancelled
        for i in range(3):
            memory[i] += period * (command[i] + residual[i])
            command[i] -= gain * memory[i]
    elif kind == 6.0:  # ramp
        memory[3] = min(memory[3] + 1.0, 20.0)
        for i in range(2):
            command[i] -= gain * memory[3] / 20.0 * residual[i]
    elif kind == 7.0:  # slope
        for i in range(3):
            if memory[3] > 0.0:
                command[i] -= gain * (residual[i] - memory[i])
            memory[i] = residual[i]
        memory[3] = 1.0
"""
KINDS = ("crossed", "one_axis", "later", "stirred", "latched", "cancelled", "ramp", "slope")


def model_with(tmp_path: Path, kind: str, gain: float) -> linear_law.LawModel:
    """Return the model of a kind of term; one function has them all, so that one loop is compiled."""
    path = tmp_path / "unfit.py"
    path.write_text(UNFIT)
    system = with_term(path, "unfit", {"gain": gain, "kind": float(KINDS.index(kind))}).system
    return linear_law.model_of(system.law, system.grid.period)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("crossed", "not linear"),
        ("one_axis", "not linear"),
        ("later", "changes with time"),
        ("stirred", "not in proportion"),
        ("latched", "keeps what it met"),
    ],
)
def test_what_is_no_linear_law_of_each_axis_is_undecided(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(UndecidedError, match=message):
        model_with(tmp_path, name, 5.0)


@pytest.mark.long
def test_models_of_terms_with_a_start_of_their_own(tmp_path: Path) -> None:
    """A ramp that ends, a difference whose first sample is another, and what cancels at the gain 1."""
    one = np.ones(1)
    ramp = model_with(tmp_path, "ramp", 2.0).at(5.0, one)
    assert ramp.D[0, 0] == pytest.approx(-7.0)
    slope = model_with(tmp_path, "slope", 0.1).at(5.0, one)
    np.testing.assert_allclose([slope.A[0, 0, 0], slope.B[0, 0, 0], slope.C[0, 0], slope.D[0, 0]], [0, 1, 0.1, -5.1])
    cancelled = model_with(tmp_path, "cancelled", 3.0)
    assert cancelled.at(5.0, one).A.shape == (1, 1, 1)
    assert cancelled.feedback(5.0, one).C[0, 0] * cancelled.feedback(5.0, one).B[0, 0, 0] != 0.0


def test_other_constants_are_another_term() -> None:
    """A closure's value is frozen in compiled code, which the cache finds by the type."""

    def make(size: float) -> str:
        @mjsheaf.register()
        def enclosing(residual: Any, command: Any, memory: Any, parameters: Any, period: float) -> None:
            command[0] -= size * residual[0]

        return custom._registered["enclosing"].kind.__name__

    assert make(1.0) != make(2.0)
    assert make(1.0) == make(1.0)


@pytest.mark.long
def test_events_keep_what_terms_remember_and_name_no_file(file: Path) -> None:
    section: dict[str, Any] = {"parameters": {"gain": 0.0}}
    events = [{"time": 0.5, "set": {"controller.custom.steeper": section}}]
    plain, changed = (with_term(file, "summed", {"gain": 5.0}, events=each) for each in ([], events))
    expected, found = (mjsheaf.simulate(scenario, backend="ideal") for scenario in (plain, changed))
    np.testing.assert_allclose(found.agent_position, expected.agent_position, rtol=0.0, atol=1e-12)
    elsewhere = file.with_name("elsewhere.py")
    elsewhere.write_text(SOURCE)
    section["file"] = str(elsewhere)
    with pytest.raises(InputError, match="cannot name a file"):
        with_term(file, "summed", {"gain": 5.0}, events=events)


def test_a_run_can_be_repeated_from_its_directory(file: Path, tmp_path: Path) -> None:
    scenario = with_term(file, "steeper", {"gain": 0.7})
    path = write_scenario(scenario, tmp_path)
    again = mjsheaf.load_scenario(path)
    assert again.controller.custom["steeper"].file == str(tmp_path / "vehicles/own_terms/own_terms.py")
    outside = path.read_text().replace("vehicles/own_terms/own_terms.py", "../steeper.py")
    path.write_text(outside)
    with pytest.raises(InputError, match="lies outside"):
        mjsheaf.load_scenario(path)


FACES = Path(__file__).with_name("faces_of_terms.py")
INTERPRETED = [{"NUMBA_DISABLE_JIT": "1"}, pytest.param({}, marks=pytest.mark.slow)]


@pytest.mark.long
@pytest.mark.parametrize("environment", INTERPRETED, ids=["interpreted", "compiled"])
def test_a_sample_counts_once_on_every_face(environment: dict[str, str]) -> None:
    """Every face gives the run of `simulate`, to the bit, and looking at a run changes nothing of it."""
    command = [sys.executable, str(FACES)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | environment)
    for name, found in json.loads(done.stdout).items():
        assert found["counts"] == [3.0, 3.0, 7.0], name
        expected = found["ends"]["simulate"]
        for face, places in found["ends"].items():
            assert places == expected, (name, face)


FAULTS = """
import mjsheaf


@mjsheaf.register(parameters=["kind"], memory=3)
def faulty(residual, command, memory, parameters, period):
    memory[0] += 1.0
    if memory[0] == 4.0 and residual[0] < 0.0:
        if parameters[0] == 0.0:
            memory[int(memory[0]) - 1] += 1.0  # one beyond its three numbers is the next agent's
        if parameters[0] == 1.0:
            raise ValueError("no such residual")
        command[1] += 1.0 / (residual[0] - residual[0])
"""


@pytest.mark.slow
@pytest.mark.parametrize("environment", INTERPRETED, ids=["interpreted", "compiled"])
def test_a_fault_of_a_term_names_term_agent_and_time(environment: dict[str, str], tmp_path: Path) -> None:
    """One line and exit code 2 on both backends, in environments too, whether compiled or not."""
    (tmp_path / "faulty.py").write_text(FAULTS)
    script = (
        "import mjsheaf\n"
        "from mjsheaf.envs import vector_env\n"
        "for kind in (0.0, 1.0, 2.0):\n"
        "    section = {'file': 'faulty.py', 'parameters': {'kind': kind}}\n"
        "    scenario = mjsheaf.load_scenario('midpoint', {'time.end': 0.2, 'controller.custom.faulty': section})\n"
        "    for backend, engine in (('ideal', 'mujoco'), ('physics', 'mujoco'), ('physics', 'fused'), ('env', '')):\n"
        "        try:\n"
        "            if backend == 'env':\n"
        "                worlds = vector_env(scenario, 2)\n"
        "                worlds.reset()\n"
        "                for _ in range(5): worlds.step(0.0 * worlds.action_space.low)\n"
        "            else: mjsheaf.simulate(scenario, backend, engine=engine, progress=False)\n"
        "        except mjsheaf.errors.InputError as error: print(error)\n"
    )
    done = python(script, tmp_path, **environment)
    lines = done.stdout.splitlines()
    assert len(lines) == 12, done.stderr
    for k, line in enumerate(lines):
        assert re.match(r"controller\.custom\.faulty: \w+ at t = 0\.06 s: ", line), line
        assert ("out of bounds", "ValueError: no such residual (faulty.py, line 12)", "not finite")[k // 4] in line
