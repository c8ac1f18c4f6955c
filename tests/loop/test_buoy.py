"""The buoy: a vehicle without thrusters, for targets. Oracles: the water, Archimedes, and errors that must be given."""

from typing import Any

import numpy as np
import pytest

from mjsheaf import load_scenario, simulate
from mjsheaf.errors import InputError
from mjsheaf.scenario import Scenario
from mjsheaf.vehicles.effects import authority_of
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from tests.builders import POWERED, altered

WATER = {"water": {"dimension": 2, "drift": [0.3, -0.2]}}


def watched(target: dict[str, Any], **fields: Any) -> Scenario:
    """A boat that watches a buoy."""
    return load_scenario(
        {
            "time": {"end": 30},
            "agents": [{"id": "A", "position": [0.0, 0.0], "vehicle": "otter"}],
            "targets": [{"id": "B", "position": [5.0, 3.0], "vehicle": "buoy", **target}],
            "sensing": [["A", "B"]],
            "physics": {"timestep": 0.01},
            **fields,
        }
    )


@pytest.mark.parametrize("engine", ["fused", "mujoco"])
def test_it_moves_with_the_water_and_stays_upright(engine: str) -> None:
    data = simulate(watched({}, flow=WATER), engine=engine)
    np.testing.assert_allclose(data["target_velocity"].values[-1, 0], [0.3, -0.2, 0.0], atol=2e-3)
    assert abs(data["target_height"].values[-1, 0]) < 1e-6
    assert data["target_orientation"].values[-1, 0, 0] == pytest.approx(1.0, abs=1e-9)
    assert np.isfinite(data["agent_position"].values[..., :2]).all()


def test_it_stays_where_it_is_in_still_water() -> None:
    data = simulate(watched({"motion": {"kind": "static", "pull": 1}}), engine="fused")
    np.testing.assert_allclose(data["target_position"].values[-1, 0, :2], [5.0, 3.0], atol=1e-9)
    assert (data["target_saturation"].values == 0.0).all()


def test_it_cannot_be_an_agent() -> None:
    scenario = watched({}, agents=[{"id": "A", "position": [0.0, 0.0], "vehicle": "buoy"}])
    with pytest.raises(InputError, match=r"agents\.A\.vehicle: 'buoy' has no thrusters and cannot be an agent"):
        simulate(scenario)


@pytest.mark.parametrize(
    "motion",
    [
        {"kind": "waypoints", "points": [[1, 2]], "speed": 1},
        {"kind": "lissajous", "amplitude": [1, 1], "rate": [0.1, 0.1], "phase": [0, 0]},
    ],
)
def test_it_follows_no_path(motion: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"targets\.B\.vehicle: 'buoy' has no thrusters and cannot follow a path"):
        simulate(watched({"motion": motion}))


def test_what_it_is() -> None:
    """It floats where its draft carries it, 1025 pi (.35 m)^2 .152 m = 60 kg, and is small."""
    buoy = load_vehicle("buoy")
    assert 1025 * np.pi * 0.35**2 * 0.152 == pytest.approx(buoy.mass, rel=1e-2)
    assert buoy.description.hydrostatics is not None
    assert buoy.description.hydrostatics.heave == pytest.approx(1025 * 9.81 * np.pi * 0.35**2, rel=1e-2)
    assert 1.0 < buoy.size < 2.0
    assert authority_of(buoy).describe() == "not at all"
    assert set(list_vehicles()) == {*POWERED, "buoy"}


def test_a_drifting_vehicle_has_no_thrusters(tmp_path: Any) -> None:
    with pytest.raises(InputError, match="a drifting vehicle has no thrusters"):
        load_vehicle(altered(tmp_path, "hull", drifts=True))
