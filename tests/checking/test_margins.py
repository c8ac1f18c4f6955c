"""Margins against simulation and against matrices.

Oracle: where a simulation begins to diverge.
"""

import numpy as np
import pytest

import mjsheaf
from mjsheaf.checking.loop.margins import hold_margin
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.scenario import scenario_from_mapping
from tests.commands import call


def growth(gain: float) -> float:
    """Size of the fastest mode of a held law after 400 periods, from about 1."""
    scenario = mjsheaf.load_scenario(
        "local_frames",
        {"controller.gain": gain, "controller.control_period": 0.05, "time.end": 20, "disturbance": {}, "flow": {}},
    )
    result = mjsheaf.simulate(scenario, "ideal")
    if result.attrs["status"] == "unstable":
        return np.inf
    H = scenario.system.team.dirichlet.H.toarray()
    _, vectors = np.linalg.eigh(H)
    error = result["harmonic_extension"].values - result["agent_position"].values
    last = np.nan_to_num(error[-1]).reshape(-1)[scenario.system.team.slots[: len(H)]]
    return float(abs(vectors[:, -1] @ last))


def test_hold_limit_is_where_simulation_begins_to_diverge() -> None:
    changes = {"controller.control_period": 0.05, "disturbance": {}, "flow": {}}
    system = mjsheaf.load_scenario("local_frames", changes).system
    margin = hold_margin(system, spectrum_of(system.team))
    assert margin is not None
    assert margin.largest_gain is not None
    assert margin.ringing_gain == pytest.approx(margin.largest_gain / 2)
    assert growth(0.99 * margin.largest_gain) < 1.0
    assert growth(1.01 * margin.largest_gain) > 100.0


def test_continuous_law_has_no_hold_margin() -> None:
    system = mjsheaf.load_scenario("certified").system
    assert hold_margin(system, spectrum_of(system.team)) is None


FREE = {
    "name": "free",
    "agents": [{"id": f"A{i}", "position": [float(i), 0.0]} for i in range(5)],
    "targets": [{"id": "T", "position": [0.0, 0.0]}],
    "communication": [["A0", "A1"], ["A2", "A3"]],
    "sensing": [["A0", "T"]],
    "controller": {"gain": 2.0, "control_period": 0.1},
}


def test_a_held_team_without_edges_has_no_limit() -> None:
    system = scenario_from_mapping({**FREE, "communication": [], "sensing": []}).system
    margin = hold_margin(system, spectrum_of(system.team))
    assert margin is not None
    assert (margin.product, margin.largest_gain, margin.ringing_gain) == (0.0, None, None)


@pytest.mark.long
def test_the_speeds_of_a_vehicle_have_names(capsys: pytest.CaptureFixture[str]) -> None:
    """5.95, 5.28 and 3.85 m/s were three numbers for "a WAM-V": two vehicles, forward and in every direction."""
    assert call("list", "--vehicles") == 0
    rows: dict[str, list[str]] = {}
    listed = capsys.readouterr().out
    assert "all-way" in listed
    for line in listed.splitlines():
        if words := line.split():
            rows.setdefault(words[0], words)  # the table comes first
    assert rows["wamv"][-2:] == ["6.34", "5.95"]
    assert rows["wamv_azimuth"][-2:] == ["5.28", "3.85"]
    scenario = mjsheaf.load_scenario("steady_current", {"vehicles.agents": "wamv_azimuth", "time.end": 2})
    for speed in mjsheaf.check(scenario, trial=False)["margins"]["speed"]:
        assert speed["able"] == pytest.approx(3.853, abs=1e-3)
        assert speed["able_forward"] == pytest.approx(5.278, abs=1e-3)
    assert call(
        "check",
        "steady_current",
        "--no-trial",
        "--full",
        "--set",
        "vehicles.agents=wamv_azimuth",
        "--set",
        "time.end=2",
    ) in (0, 1)
    printed = " ".join(capsys.readouterr().out.split())
    assert "3.853" in printed
