"""Margins against simulation and against matrices.

Oracle: where a simulation begins to diverge; the exact discretisation by the matrix exponential.
"""

import numpy as np
import pytest
from scipy.linalg import expm

import mjsheaf
from mjsheaf.checking.margins import body_margin, hold_margin
from mjsheaf.checking.spectrum import spectrum_of


def growth(gain: float) -> float:
    """Size of the fastest mode of a held law after 400 periods, from about 1."""
    scenario = mjsheaf.load_scenario(
        "local_frames",
        {"controller.gain": gain, "controller.control_period": 0.05, "time.end": 20, "disturbance": {}, "flow": {}},
    )
    result = mjsheaf.simulate(scenario, "ideal")
    if result.attrs["status"] == "unstable":
        return np.inf
    H = scenario.system().team.dirichlet.H.toarray()
    _, vectors = np.linalg.eigh(H)
    error = result["harmonic_extension"].values - result["agent_position"].values
    last = np.nan_to_num(error[-1]).reshape(-1)[scenario.system().team.slots[: len(H)]]
    return float(abs(vectors[:, -1] @ last))


def test_hold_limit_is_where_simulation_begins_to_diverge() -> None:
    changes = {"controller.control_period": 0.05, "disturbance": {}, "flow": {}}
    system = mjsheaf.load_scenario("local_frames", changes).system()
    margin = hold_margin(system, spectrum_of(system.team))
    assert margin is not None
    assert margin.ringing_gain == pytest.approx(margin.largest_gain / 2)
    assert growth(0.99 * margin.largest_gain) < 1.0
    assert growth(1.01 * margin.largest_gain) > 100.0


def test_continuous_law_has_no_hold_margin() -> None:
    system = mjsheaf.load_scenario("certified").system()
    assert hold_margin(system, spectrum_of(system.team)) is None


@pytest.mark.parametrize("spread", [0.0, 0.4])
def test_sampled_bodies_against_the_matrix_exponential(spread: float) -> None:
    system = mjsheaf.load_scenario("local_frames", {"controller.control_period": 0.1}).system()
    H, k, h = system.team.dirichlet.H.toarray(), system.gain, 0.1
    tau = 0.3 * (1.0 + spread * np.linspace(-1, 1, len(system.team.agents)))
    margin = body_margin(system, spectrum_of(system.team), tau)
    each = np.concatenate([np.full(a.dimension, t) for a, t in zip(system.team.agents, tau, strict=True)])
    n = len(each)
    plant = np.block([[np.zeros((n, n)), np.eye(n)], [np.zeros((n, n)), -np.diag(1 / each)]])
    push = np.vstack([np.zeros((n, n)), np.diag(1 / each)])
    whole = expm(h * np.block([[plant, push], [np.zeros((n, 3 * n))]]))
    A, B = whole[: 2 * n, : 2 * n], whole[: 2 * n, 2 * n :]
    closed = A + B @ np.hstack([-k * H, np.zeros((n, n))])
    expected = np.abs(np.linalg.eigvals(closed)).max()
    assert margin.spectral_radius == pytest.approx(expected, rel=1e-9)
    if spread == 0.0:
        values = np.linalg.eigvalsh(H)
        assert margin.damping_slowest == pytest.approx(1 / (2 * np.sqrt(k * values[0] * 0.3)))
        assert margin.damping_fastest == pytest.approx(1 / (2 * np.sqrt(k * values[-1] * 0.3)))
