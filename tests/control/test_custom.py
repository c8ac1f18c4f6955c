"""Terms that users register: compiled into the law, on every backend, in batches, and seen by `check`.

Oracles: the paper's law at another gain; the shipped integral; the same run without compiling.
"""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.control import custom
from mjsheaf.errors import InputError

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


def test_a_term_along_eta_is_a_larger_gain(file: Path) -> None:
    scenario = with_term(file, "steeper", {"gain": 0.7})
    gain = scenario.controller.gain + 0.7
    other = mjsheaf.load_scenario("midpoint", {"time.end": 1.0, "controller.gain": gain})
    found = mjsheaf.simulate(scenario, backend="ideal")
    expected = mjsheaf.simulate(other, backend="ideal")
    np.testing.assert_allclose(found.agent_position, expected.agent_position, rtol=0.0, atol=1e-12)
    record = mjsheaf.check(scenario)["law"]
    plain = mjsheaf.check(other)["law"]
    assert record["terms"] == ["steeper"]
    assert record["spectral_radius"] == pytest.approx(plain["spectral_radius"], rel=1e-12)
    assert record["largest_gain"] == pytest.approx(plain["largest_gain"] - 0.7, rel=1e-9)
    assert record["radius"] is None
    assert "term steeper" in record["reason"]


@pytest.mark.slow
def test_what_a_term_remembers(file: Path) -> None:
    """The shipped integral, written as a user would write it; `check` says the same of both, delays included."""
    own = with_term(file, "summed", {"gain": 0.2})
    shipped = mjsheaf.load_scenario("midpoint", {"time.end": 1.0, "controller.integral": {"gain": 0.2}})
    one, other = (mjsheaf.simulate(scenario, backend="ideal") for scenario in (own, shipped))
    np.testing.assert_allclose(one.agent_position, other.agent_position, rtol=0.0, atol=1e-12)
    found, expected = mjsheaf.check(own), mjsheaf.check(shipped)
    for name in ("spectral_radius", "rate", "largest_gain", "error_per_disturbance"):
        assert found["law"][name] == pytest.approx(expected["law"][name], rel=1e-9)
    assert found["links"]["delay_margin"] == pytest.approx(expected["links"]["delay_margin"], rel=1e-12)


def test_a_term_that_is_not_linear_is_undecided(file: Path) -> None:
    record = mjsheaf.check(with_term(file, "bounded", {"gain": 30.0, "width": 1e-3}))
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
    ("body", "message"),
    [("command[0] = undefined_name", "does not compile"), ("raise SystemExit(3)", "SystemExit"), (None, "ValueError")],
)
def test_faults_of_a_file_are_one_message(tmp_path: Path, body: str | None, message: str) -> None:
    path = tmp_path / "faulty.py"
    top = "raise ValueError('no')\n" if body is None else ""
    if body and body.startswith("raise"):
        top, body = body + "\n", "pass"
    source = f"import mjsheaf\n{top}\n@mjsheaf.register()\ndef faulty(residual, command, memory, parameters, period):\n"
    path.write_text(source + f"    {body or 'pass'}\n")
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


def test_the_cache_names_types_of_terms_that_are_not_registered_yet() -> None:
    """The index of compiled functions is read with them in it, whatever a process registers."""
    kind = custom.__getattr__("Term_elsewhere_0123456789abcdef")
    assert pickle.loads(pickle.dumps(kind)) is kind
    assert kind._fields == custom.TermOfLaw._fields
    with pytest.raises(AttributeError):
        custom.__getattr__("Term_elsewhere")


@pytest.mark.slow
def test_engines_batches_and_phases_agree(file: Path) -> None:
    scenario = with_term(file, "summed", {"gain": 0.5}, events=[{"time": 0.5, "set": {"controller.gain": 2.0}}])
    bodies = mjsheaf.simulate(scenario)
    fused = mjsheaf.simulate(scenario, engine="fused")
    np.testing.assert_allclose(fused.agent_position, bodies.agent_position, rtol=0.0, atol=1e-9)
    without = mjsheaf.simulate(mjsheaf.load_scenario("midpoint", {"time.end": 1.0}), engine="fused")
    assert float(abs(without.agent_position - fused.agent_position).max()) > 1e-4
    single = with_term(file, "summed", {"gain": 0.5})
    alone = mjsheaf.simulate(single, engine="fused")
    for run in mjsheaf.simulate_many([single, single], engine="fused"):
        assert isinstance(run, type(alone))
        np.testing.assert_array_equal(run.agent_position, alone.agent_position)


@pytest.mark.slow
def test_without_compiling_and_from_the_cache(file: Path, tmp_path: Path) -> None:
    """A second process compiles nothing; another source is another term; uncompiled, the run is the same."""
    script = (
        "import json, sys, mjsheaf\n"
        "from numba.core import event\n"
        "compiled = []\n"
        "class Listener(event.Listener):\n"
        "    def on_start(self, event): compiled.append(event.data['dispatcher'].py_func.__module__)\n"
        "    def on_end(self, event): pass\n"
        "event.register('numba:compile', Listener())\n"
        f"section = {{'file': {str(file)!r}, 'parameters': {{'gain': float(sys.argv[1])}}}}\n"
        "changes = {'time.end': 0.2, 'controller.custom.steeper': section}\n"
        "run = mjsheaf.simulate(mjsheaf.load_scenario('midpoint', changes), backend='ideal')\n"
        "own = [name for name in compiled if str(name).startswith('mjsheaf.')]\n"
        "print(json.dumps([run.agent_position.values[-1, :, :2].tolist(), own]))\n"
    )

    def run(**environment: str) -> tuple[list[Any], list[str]]:
        done = subprocess.run(
            [sys.executable, "-c", script, "0.7"], env={**os.environ, **environment}, capture_output=True, check=True
        )
        position, compiled = json.loads(done.stdout)
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
