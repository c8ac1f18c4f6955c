"""From bodies to the paper's first-order model: the physics converges to the ideal run as m / D goes to zero.

Oracles: the ideal backend on the same scenario (itself checked against the published run), and the value measured on
bodies before mjsheaf was written (tests/data/paper_facts.json).
"""

import numpy as np
import pytest
import xarray as xr

from mjsheaf import load_scenario
from tests.builders import FACTS, Simulated


def distance(one: xr.Dataset, other: xr.Dataset) -> float:
    """Sup over t >= 5 s and over the agents of the distance between two runs, m."""
    apart = np.linalg.norm((one.agent_position - other.agent_position).sel(axis=["x", "y"]), axis=2)
    return float(apart[one.time.values >= 5.0].max())


@pytest.mark.slow
def test_distance_to_the_ideal_run_is_of_first_order_in_m_over_d(simulated: Simulated) -> None:
    """Slope 1 +- 0.05 from 0.03 s to 0.001 s. The first seconds hold a jump that no body can follow."""
    taus = [0.03, 0.01, 0.003, 0.001]
    ideal = simulated("paper", "ideal", {"time.end": 12.0})
    apart = []
    for tau in taus:
        steps = int(np.ceil(0.01 / (tau / 10.0) - 1e-9))  # of at most tau / 10, a whole number in a control period
        overrides = {"time.end": 12.0, "vehicles.tau": tau, "physics.timestep": 0.01 / steps}
        apart.append(distance(simulated("paper", "physics", overrides), ideal))
    slopes = np.diff(np.log(apart)) / np.diff(np.log(taus))
    np.testing.assert_allclose(slopes, 1.0, atol=0.05)
    np.testing.assert_allclose(apart, 31.8 * np.array(taus), rtol=0.05)  # 0.032 m at 0.001 s, as measured before


@pytest.fixture(scope="module")
def on_bodies(simulated: Simulated) -> xr.Dataset:
    assert load_scenario("paper").vehicles.tau == FACTS["bodies_gain_10"]["tau"]
    return simulated("paper", "physics")


@pytest.mark.slow
def test_published_run_on_bodies_comes_within_a_percent(on_bodies: xr.Dataset, simulated: Simulated) -> None:
    """Mean disagreement over the last 25 s at m / D = 0.01 s."""
    ideal = simulated("paper", "ideal")
    late = on_bodies.time >= 25.0
    body, point = (float(run.disagreement.where(late, drop=True).mean()) for run in (on_bodies, ideal))
    assert body == pytest.approx(point, rel=0.01)
    assert body != pytest.approx(point, rel=1e-6)


@pytest.mark.slow
def test_published_run_on_bodies_ends_where_it_was_measured_to(on_bodies: xr.Dataset) -> None:
    measured = FACTS["bodies_gain_10"]["mean_disagreement_at_49.99"]
    assert float(on_bodies.time[-1]) == pytest.approx(49.99)
    assert float(on_bodies.disagreement[-1].mean()) == pytest.approx(measured, abs=2e-4)


def test_boats_stay_on_the_water_and_hold_their_headings(on_bodies: xr.Dataset) -> None:
    """Whatever the law asks of them in the plane, they float level, with the heading they began with."""
    assert np.abs(on_bodies.agent_height).max() < 1e-3
    turned = np.abs((on_bodies.agent_orientation * on_bodies.agent_orientation[0]).sum("quaternion"))
    assert float(turned.min()) > 1.0 - 1e-6
    assert np.unique(on_bodies.agent_orientation[0, :, 3].values.round(6)).size > 10  # and those are not alike
    assert not on_bodies.agent_saturation.any()
