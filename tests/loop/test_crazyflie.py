"""The Crazyflie: a drone of 32 g hovers, and four fly a square, on both engines and with steps of any usual size."""

from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.scenario import Scenario
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import build_scenario


def square(**fields: Any) -> Scenario:
    """Four Crazyflies about a fifth that circles."""
    flies = {
        f"C{k}": {"position": [0.5 * k - 0.7, 0.3 * (-1) ** k, 1.0 + 0.1 * k], "heading": 40.0 * k} for k in range(4)
    }
    circle = {"amplitude": [1, 1, 0.2], "rate": [0.1, 0.1, 0.15], "phase": [1.57, 0, 0], "pull": 0.5}
    usual: dict[str, Any] = {
        "time": {"end": 40},
        "controller": {"gain": 0.4, "control_period": 0.02, "velocity_limit": 1.5},
        "communication": [["C0", "C1"], ["C1", "C2"], ["C2", "C3"], ["C3", "C0"]],
        "formations": [{"name": "square", "shape": "square", "members": [*flies], "about": "T", "side": 1.0}],
        "vehicles": {"agents": "crazyflie", "targets": "crazyflie"},
        "physics": {"timestep": 0.002},
    }
    target = {"position": [0.0, 0.0, 1.5], "motion": {"kind": "lissajous", **circle}}
    return build_scenario(flies, {"T": target}, [[id, "T"] for id in flies], **usual | fields)


def test_its_numbers_are_those_of_the_source() -> None:
    fly = load_vehicle("crazyflie")
    assert fly.mass == 0.0319
    np.testing.assert_allclose(np.diag(fly.inertia), [16.8e-6, 16.8e-6, 29.8e-6], rtol=1e-12)
    np.testing.assert_allclose(np.abs(fly.W[3:]), np.outer([0.03253, 0.03253, 0.00735], np.ones(4)), rtol=1e-12)
    np.testing.assert_array_equal(fly.limits, [[0.0128, 0.12]] * 4)
    np.testing.assert_array_equal(fly.drag, [0.01472, 0.01472, 0.01278])
    assert fly.trim == pytest.approx(0.0319 * 9.81 / 4)
    assert fly.lag == 0.145
    assert np.linalg.matrix_rank(fly.W[2:]) == 4
    assert 0.1 < fly.size < 0.12


@pytest.mark.parametrize("engine", ["fused", "mujoco"])
def test_four_fly_a_square(engine: str) -> None:
    data = simulate(square(), engine=engine)
    assert data["tracking_error"].values[-500:].max() < 0.27
    assert (data["agent_saturation"].values == 0.0).all()
    rough = simulate(square(physics={"timestep": 0.02}), engine=engine)
    np.testing.assert_allclose(rough["agent_position"].values[-1], data["agent_position"].values[-1], atol=0.01)
