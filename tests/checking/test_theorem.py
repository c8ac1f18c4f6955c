"""Theorem 1 against simulation.

Oracle: the theorem itself. A certified run never exceeds the bound, and cases built to attain it come within 5 %.
"""

import numpy as np
import pytest

import mjsheaf
from mjsheaf.checking.theorem.of_run import RunBound, bound_of_run
from mjsheaf.checking.theorem.theorem import disturbance_bound, least_gain, theorem_1
from mjsheaf.scenario import scenario_from_mapping
from tests.builders import Simulated, build_scenario, known, random_scenario, require
from tests.running import analyse, team_error
from tests.strategies import cases

CERTIFIED = 500
WORKERS = 20  # pieces of the study, so that it spreads over processes


def certified_run(seed: int) -> RunBound:
    """Run a random scenario with a gain for which the theorem applies over the region of that very run."""
    raw = random_scenario(seed)
    team = scenario_from_mapping(raw).system.team
    smallest = float(np.linalg.eigvalsh(team.dirichlet.H.toarray())[0])
    assert smallest > 1e-6, f"seed {seed}: a random team should not be free to drift"
    gain = 1.0 / smallest
    for _ in range(8):
        raw["controller"] = {**raw["controller"], "gain": gain}
        scenario = scenario_from_mapping(raw)
        run = bound_of_run(scenario.system, mjsheaf.simulate(scenario, "ideal"))
        if run.applies:
            return run
        gain *= 2.0
    raise AssertionError(f"seed {seed}: no gain certifies it: {run.reason}")


@pytest.mark.slow
@pytest.mark.parametrize("piece", range(WORKERS))
def test_the_bound_is_never_exceeded(piece: int) -> None:
    """Of 100 teams, of which CI tries five, and of 500 in `make test-all`."""
    for seed in cases(CERTIFIED, 100)[piece::WORKERS]:
        run = certified_run(seed)
        assert not run.approximate
        assert known(run.ratio) <= 1.0 + 1e-6, f"seed {seed}: measured / bound is {known(run.ratio)}"


@pytest.mark.parametrize("seed", range(5))
def test_the_bound_is_attained_where_it_can_be(seed: int) -> None:
    """A constant f_B along the slowest eigenvector: static targets, uniform drift, every agent senses one target."""
    rng = np.random.default_rng(seed)
    N = int(rng.integers(1, 6))
    agents = [f"A{i}" for i in range(N)]
    place = rng.uniform(-4, 4, 2).tolist()
    scenario = build_scenario(
        dict.fromkeys(agents, place),  # e(t0) = 0
        {"T": place},
        [[a, "T"] for a in agents],
        communication=[[agents[i], agents[int(rng.integers(i))]] for i in range(1, N)],
        flow={"agents": {"dimension": 2, "drift": rng.uniform(-1, 1, 2).tolist()}},
        controller={"gain": float(rng.uniform(0.5, 4)), "control_period": 0},
        time={"end": 20.0},
    )
    run = bound_of_run(scenario.system, mjsheaf.simulate(scenario, "ideal"))
    assert run.applies
    assert 0.95 <= known(run.settled_ratio) <= known(run.ratio) <= 1.0 + 1e-9
    assert run.certificate.bound(0.0, np.zeros(1)) == 0.0  # nothing is added to it in continuous time


def test_sets_and_gain_condition() -> None:
    t = theorem_1(gain=10, lambda_min=2.0, f_bar=3.0, omega_bar=1.0, rho=4.0)
    assert t.k_min == 10.0
    assert t.applies
    assert t.rate == pytest.approx(6.0)  # the largest below k_min - L
    assert t.mu == pytest.approx(16 / 40)
    assert t.radius == pytest.approx(np.sqrt(t.mu / 6.0))
    assert t.k_min > t.lipschitz + t.rate  # strict, as the theorem asks
    slower = theorem_1(10, 2.0, 3.0, 1.0, 4.0, rate=2.0)
    assert slower.applies
    assert slower.radius > t.radius
    assert not theorem_1(10, 2.0, 3.0, 1.0, 4.0, rate=6.1).applies
    assert not theorem_1(3, 2.0, 3.0, 1.0, 4.0).applies
    assert not theorem_1(10, 0.0, 3.0, 1.0, 0.0).applies
    np.testing.assert_allclose(t.bound(7.0, [0.0, 1e9]), [7.0, t.radius])


def test_gain_for_a_wanted_radius_gives_that_radius() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        lambda_min, f_bar, omega_bar, lipschitz, radius = rng.uniform(0.1, 5, 5)
        k = least_gain(radius, lambda_min, f_bar, omega_bar, lipschitz)
        assert theorem_1(k, lambda_min, f_bar, omega_bar, lipschitz).radius == pytest.approx(radius, rel=1e-6)
        assert theorem_1(0.99 * k, lambda_min, f_bar, omega_bar, lipschitz).radius > radius


def test_disturbance_bound_is_the_papers() -> None:
    assert disturbance_bound(2.0, 0.5, 9, 4, 0.1) == pytest.approx((1 + 2 / 0.5) * 3 * 0.1)
    assert disturbance_bound(2.0, 0.0, 9, 4, 0.1) == np.inf
    assert disturbance_bound(2.0, 0.0, 9, 4, 0.0) == 0.0


@pytest.mark.long
def test_published_run_fails_the_gain_condition_and_keeps_the_weaker_bound(simulated: Simulated) -> None:
    record = analyse("paper")
    theorem = record["theorem"]
    assert record["ok"] is True
    require(theorem, {"applies": False, "k_min": pytest.approx(2.2105, abs=0.001)})
    assert theorem["rho"] > 50.0
    assert "does not exceed rho" in theorem["reason"]
    assert theorem["lambda_min"] == pytest.approx(0.4421094525282422, abs=1e-9)
    assert theorem["lambda_max"] == pytest.approx(6.269324221144499, abs=1e-9)
    result = simulated("paper", "ideal")
    assert team_error(result)[result["time"].values > 10.0].max() <= theorem["weaker"]["radius"]
