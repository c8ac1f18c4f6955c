"""Warnings about terms that increase the error of a run.

Oracles: white noise of a known deviation; scenarios that ship for one side or the other; the same run from a file.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.runs.diagnostics import examine_terms
from mjsheaf.scenario import load_scenario
from tests.builders import Simulated, known
from tests.commands import answer_of

BACKENDS = ("ideal", "physics")


def examined(name: str, backend: str, **changes: Any) -> dict[str, Any]:
    scenario = load_scenario(name, {path.replace("__", "."): value for path, value in changes.items()})
    return known(examine_terms(scenario.system, mjsheaf.simulate(scenario, backend)))


@pytest.mark.long
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ["harbour_feedforward", "otters_feedforward", "quads_feedforward", "steady_current"])
def test_healthy_terms_are_not_blamed(name: str, backend: str, simulated: Simulated) -> None:
    found = known(examine_terms(load_scenario(name).system, simulated(name, backend)))
    assert not found["harm"]
    assert found["jump_m_s"] < 0.01 * found["commanded_m_s"]
    assert (found["share_saturated"] is None) == (backend == "ideal")


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_unfiltered_noise_makes_commands_jump(backend: str, simulated: Simulated) -> None:
    found = known(examine_terms(load_scenario("noisy_odometry").system, simulated("noisy_odometry", backend)))
    assert found["share_at_limit"] > 0.9
    assert found["jump_m_s"] > 0.5 * found["commanded_m_s"]
    assert "commands jump" in found["harm"][0]
    assert "filters" in found["harm"][0]
    mended = examined("noisy_odometry", backend, controller__feedforward__filter=2, controller__drift__filter=2)
    assert not mended["harm"]


def test_extrapolation_on_bodies_multiplies_noise() -> None:
    """The factor is 1 + tau / h; on ideal kinematics, which have no tau, the same law causes no warning."""
    law = {"controller__feedforward": {"rounds": 3, "extrapolate": True}, "time__end": 30}
    (sentence,) = examined("harbour_feedforward", "physics", **law)["harm"]
    assert "commands jump" in sentence
    assert not examined("harbour_feedforward", "ideal", **law)["harm"]


def test_a_loop_that_rings_makes_commands_jump() -> None:
    changes = {"controller__gain": 100, "controller__velocity_limit": 40, "time__end": 10}
    assert "commands jump" in examined("paper_feedforward", "ideal", **changes)["harm"][0]
    assert not examined("paper_feedforward", "ideal", controller__gain=60, time__end=10)["harm"]


def test_a_limit_that_leaves_terms_no_room_is_named() -> None:
    found = examined("paper_feedforward", "ideal", controller__velocity_limit=15, time__end=10)
    (sentence,) = found["harm"]
    assert found["share_at_limit"] > 0.9
    assert found["jump_m_s"] < 0.01 * found["commanded_m_s"]
    assert "velocity_limit" in sentence
    assert "jump" not in sentence


@pytest.mark.parametrize("deviation", [0.3, 2.0])
def test_the_jump_is_the_deviation_of_white_noise(deviation: float, simulated: Simulated) -> None:
    dataset = simulated("quads_feedforward", "ideal").copy(deep=True)
    command = dataset["velocity_command"].values
    smooth = np.ones_like(command)
    noise = deviation / np.sqrt(3.0) * np.random.default_rng(1).standard_normal(command.shape)
    dataset["velocity_command"].values[:] = smooth + noise
    found = known(examine_terms(load_scenario("quads_feedforward").system, dataset))
    assert found["jump_m_s"] == pytest.approx(deviation, rel=0.03)
    assert found["commanded_m_s"] == pytest.approx(np.sqrt(3.0 + deviation**2), rel=0.03)


@pytest.mark.slow
def test_the_paper_s_law_and_laws_in_python_have_no_terms(simulated: Simulated) -> None:
    assert examine_terms(load_scenario("midpoint").system, simulated("midpoint", "ideal")) is None
    scenario = load_scenario("steady_current", {"time.end": 1})
    own = mjsheaf.simulate(scenario, "ideal", controller=lambda t, sample: -sample.disagreement)
    assert examine_terms(scenario.system, own) is None


@pytest.mark.usefixtures("without_plots")
def test_a_run_prints_the_note_and_keeps_it(tmp_path: Path) -> None:
    """From a file of several pieces it is what the data in memory give."""
    out = tmp_path / "run"
    options = ("--backend", "ideal", "--set", "time.end=60", "--no-video")
    answer = answer_of("run", "noisy_odometry", *options, "--out", out)
    assert answer.code == 0
    record = json.loads((out / "summary.json").read_text())["terms"]
    found = examined("noisy_odometry", "ideal", time__end=60)
    assert record["on"] == ["feedforward", "drift"]
    assert record["jump_m_s"] == pytest.approx(found["jump_m_s"], rel=1e-12)
    assert record["share_at_limit"] == found["share_at_limit"]
    assert record["harm"] == found["harm"]
    assert "commands jump" in " ".join(answer.out.split())
