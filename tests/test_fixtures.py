"""The fixtures that other tests rely on. Oracle: the plain way to the same thing."""

import pytest
import xarray as xr

from mjsheaf import load_scenario, simulate
from tests.builders import Simulated


@pytest.mark.long
def test_a_simulation_that_was_kept_is_the_simulation(simulated: Simulated) -> None:
    for backend in ("ideal", "physics"):
        overrides = {"time.end": 0.2}
        first, again = (simulated("local_frames", backend, overrides) for _ in range(2))
        xr.testing.assert_identical(first, simulate(load_scenario("local_frames", overrides), backend))
        xr.testing.assert_identical(first, again)
        assert not first.identical(simulated("local_frames", backend, {"time.end": 0.3}))
    xr.testing.assert_identical(simulated("swap", "ideal"), simulate(load_scenario("swap"), "ideal"))
