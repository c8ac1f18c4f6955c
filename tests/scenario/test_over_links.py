"""Scenarios over links show the numbers that their comments give.

Oracle: each against itself with other links.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf import check, load_scenario
from mjsheaf.results.metrics import late_errors
from tests.builders import Simulated

BACKENDS = ["ideal", "physics"]
pytestmark = pytest.mark.long


def late(simulated: Simulated, name: str, backend: str, **overrides: Any) -> float:
    """Tracking error, RMS over the last half of the run, m."""
    changes = {path.replace("__", "."): value for path, value in overrides.items()}
    data = simulated(name, backend, changes)
    assert data.attrs["status"] == "finished"
    found = late_errors(load_scenario(name, changes).system.team, data)["tracking_error"]
    assert found is not None
    return found


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_delay_that_breaks_the_published_run_and_what_mends_it(backend: str, simulated: Simulated) -> None:
    fast = {"controller.gain": 10}
    for changes, margin in (({}, 0.07), (fast, 0.01), ({**fast, "controller.newton.rounds": 2}, 0.13)):
        answer = check(load_scenario("paper_delay", changes), trial=False)["links"]["delay"]
        assert answer["stable"] is (margin >= 0.05)
        assert answer["margin"] == pytest.approx(margin)
        assert simulated("paper_delay", backend, changes).attrs["status"] == (
            "finished" if answer["stable"] else "unstable"
        )
    assert late(simulated, "paper", backend) == pytest.approx(3.95, abs=0.03)
    assert late(simulated, "paper_delay", backend) == pytest.approx(10.0, abs=0.1)
    newton = late(simulated, "paper_delay", backend, controller__gain=10, controller__newton__rounds=2)
    assert newton == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("backend", BACKENDS)
def test_half_of_the_messages_is_half_of_the_gain(backend: str, simulated: Simulated) -> None:
    scenario = load_scenario("paper_half_lost")
    record = check(scenario, trial=False)
    assert record["law"]["rate"] == pytest.approx(4.52, abs=0.01)
    assert record["links"]["loss"]["rate"] == pytest.approx(2.23, abs=0.01)
    assert late(simulated, "paper_half_lost", backend) == pytest.approx(7.05, abs=0.05)
    assert late(simulated, "paper_half_lost", backend, links__all__hold=0.05) == pytest.approx(4.02, abs=0.02)
    assert late(simulated, "paper_half_lost", backend, links__all__loss=0.9) == pytest.approx(14.3, abs=0.1)
    if backend == "physics":  # a held measurement is an old one
        held = {"links.all.loss": 0.9, "links.all.hold": 0.1}
        assert simulated("paper_half_lost", backend, held).attrs["status"] == "unstable"


def test_noise_is_averaged_losses_cost_and_a_hold_mends_them(simulated: Simulated) -> None:
    perfect = late(simulated, "harbour", "physics")
    assert perfect == pytest.approx(2.71, abs=0.02)
    assert late(simulated, "noisy_harbour", "physics") == pytest.approx(3.34, abs=0.02)
    assert late(simulated, "noisy_harbour", "physics", links__communication__loss=0) == pytest.approx(2.74, abs=0.02)
    assert late(simulated, "noisy_harbour", "physics", links__communication__hold=0.1) == pytest.approx(2.74, abs=0.02)
    noise = check(load_scenario("noisy_harbour"), trial=False)["links"]["noise"]
    assert noise["error"] == pytest.approx(0.2, abs=0.01)
    assert noise["command"] == pytest.approx(2.4, abs=0.05)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_swarm_is_carried_off_in_the_shadow_and_comes_back(backend: str, simulated: Simulated) -> None:
    data = simulated("swarm_radio_shadow", backend)
    error = np.sqrt((data["tracking_error"].values ** 2).mean(axis=1))
    before, carried, back = (error[int(50 * t)] for t in (15, 30, 60))
    assert carried > 4 * before
    assert back < 1.1 * before
    silent = 1.0 - float(data["delivery"].mean())  # ten of eleven in the shadow, a quarter of the run
    assert silent == pytest.approx(10 / 44, abs=0.01)
