"""Predictions of the RMS error by gusts and waves: published numbers, and long runs on ideal kinematics and bodies."""

from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy.signal import lfilter

import mjsheaf
from mjsheaf.checking import examine_scenario
from mjsheaf.checking.loop.prediction import DisturbanceRecord, predict_rms
from mjsheaf.checking.report import report, screen
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import scenario_from_mapping
from tests.builders import known, list_members, make_fields, make_scenario, mixed_scenario, require
from tests.running import analyse
from tests.strategies import long, slow

PM = {"kind": "pierson_moskowitz", "significant_height": 1.0, "peak_period": 2.0 * np.pi}
SHORT = {"kind": "jonswap", "significant_height": 0.3, "peak_period": 4.0, "spreading": "cos2"}
OTTER = list_members({"A": [5, 0]}, vehicle="otter")
GUSTS = {"kind": "dryden", "wind_speed": 6.0, "altitude": 20.0}


def sea_of(scenario: Scenario) -> Any:
    """The components of a scenario's waves."""
    water = known(scenario.flow.water)
    return known(water.waves).components_of(0)


def lone(gain: float, period: float, waves: dict[str, Any], **fields: Any) -> Scenario:
    """Return an agent in waves about a target in still air."""
    law = {"gain": gain, "control_period": period} | ({} if period else {"record_period": 0.1})
    flow = {"water": {"dimension": 2, "waves": waves}}
    usual = make_fields({"A": [5, 0]}, {"T": [5, 0, 8]}, [["A", "T"]], time={"end": 10.0}, controller=law, flow=flow)
    return make_scenario({**usual, **fields})


def prediction(scenario: Scenario) -> Any:
    """Return what `check` says of gusts and waves."""
    return analyse(scenario)["disturbance"]


def team(**fields: Any) -> Scenario:
    """Return two Otters in waves and two hexarotors in gusts about a drone."""
    boats = {"O1": [-6, 4], "O2": [-6, -4]}
    drones = {"H1": [5, 6, 20], "H2": [5, -6, 20]}
    line = {"shape": "line", "about": "T", "angle": 90}
    usual = {
        "name": "team",
        "time": {"end": 10.0},
        "controller": {"gain": 0.4, "control_period": 0.1},
        "agents": list_members(boats, vehicle="otter") + list_members(drones, vehicle="hexarotor"),
        "targets": list_members({"T": [0, 0, 20]}, vehicle="hexarotor", motion={"kind": "static", "pull": 1.0}),
        "communication": [["O1", "O2"], ["O1", "H1"], ["H1", "H2"]],
        "sensing": [["O1", "T"], ["H1", "T"], ["H2", "T"]],
        "formations": [
            {"name": "boats", "members": ["O1", "O2"], "spacing": 8, **line},
            {"name": "drones", "members": ["H1", "H2"], "spacing": 12, **line},
        ],
        "flow": {
            "air": {"dimension": 3, "drift": [2.0, 0.0, 0.0], "gusts": GUSTS},
            "water": {"dimension": 2, "waves": SHORT},
        },
        "physics": {"timestep": 0.01, "contacts": False},
    }
    return make_scenario({**usual, **fields})


def measured(scenario: Scenario, backend: str, end: float, seeds: int, engine: str = "mujoco") -> dict[str, float]:
    """Return the RMS of each agent's error about its mean over long runs, m."""
    squares = 0.0
    for seed in range(seeds):
        raw = scenario.model_dump(mode="json", exclude_none=True) | {"seed": seed, "time": {"end": end}}
        data = mjsheaf.simulate(scenario_from_mapping(raw), backend=backend, engine=engine)
        error = (data.agent_position - data.harmonic_extension).values[len(data.time) // 10 :]
        error = error - error.mean(axis=0)
        squares = squares + np.nansum(error**2, axis=2).mean(axis=0)
    return dict(zip(scenario.team.agent_ids, np.sqrt(squares / seeds).tolist(), strict=True))


@pytest.mark.long
@pytest.mark.parametrize(("gain", "rms"), [(0.1, 0.249017), (0.5, 0.229216), (1.0, 0.191609), (5.0, 0.065049)])
@pytest.mark.parametrize("spreading", ["none", "cos2"])
def test_the_continuous_law_leaves_the_published_errors(gain: float, rms: float, spreading: str) -> None:
    record = prediction(lone(gain, 0.0, {**PM, "spreading": spreading, "direction": 70.0}))
    require(record, {"rms": pytest.approx(rms, abs=2e-06), "agents": {"A": record["rms"]}})
    assert record["norm"] == "per_agent_rms"


def lone_wave(period: float, rate: float, law: float, pull: float) -> float:
    """Return the RMS distance of a drone from its place above a boat that is pulled back in one small wave, m.

    Both are held: p+ = p - h pull p + h w, q+ = q + h k (p - q), w the mean over a period of the water's velocity.
    """
    a, count = 0.02 / np.sqrt(8.0), 200_000
    phase = rate * period * np.arange(count + 1) + 0.3
    mean = a * (np.sin(phase[1:]) - np.sin(phase[:-1])) / period  # of a omega cos
    p = lfilter([0.0, period], [1.0, period * pull - 1.0], mean)
    q = lfilter([0.0, period * law], [1.0, period * law - 1.0], p)
    return float((q - p)[count // 2 :].std())


@pytest.mark.slow
@pytest.mark.parametrize("pull", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("period", [0.05, 0.4])
def test_the_pull_of_a_target_is_held_as_the_law_is(period: float, pull: float) -> None:
    wave = {"kind": "jonswap", "significant_height": 0.02, "peak_period": 3.0, "components": 1}
    agents = list_members({"A": [5, 0, 10]})
    targets = list_members({"T": [5, 0]}, motion={"kind": "static", "pull": pull})
    anchor = [{"agent": "A", "axes": ["z"], "value": [10]}]
    scenario = lone(1.1, period, wave, agents=agents, targets=targets, anchors=anchor, physics={"timestep": 0.01})
    record = prediction(scenario)
    (rate,) = sea_of(scenario).rate
    assert record["rms"] == pytest.approx(lone_wave(period, rate, 1.1, pull), rel=2e-3)


@pytest.mark.long
def test_steep_waves_are_named_as_beyond_a_linear_prediction() -> None:
    """The waves of PM are 2 pi 9.81 m long."""
    for height, beyond in ((0.9, []), (1.2, ["slow drift in groups of steep waves"])):
        record = prediction(lone(0.5, 0.1, {**PM, "significant_height": height}))
        assert record["leaves_out"] == beyond


def under_water(depth: float | None, **fields: Any) -> Scenario:
    """Return a submersible, a drone and a boat about a submerged target in small waves; fields replace fields."""
    waves = {"kind": "pierson_moskowitz", "significant_height": 0.2, "peak_period": 5.0, "components": 120}
    sea = {**waves, "spreading": "cos2"} | ({} if depth is None else {"depth": depth})
    usual = {
        "agents": list_members({"S": [3, 0, -2], "D": [-3, 0, 3], "B": [0, 4]}),
        "targets": list_members({"T": [0, 0, -1]}),
        "sensing": [{"between": [id, "T"], "offset": place} for id, place in (("S", [3, 0, -1]), ("B", [0, 4]))],
        "communication": [{"between": ["S", "D"], "offset": [6, 0, -5]}],
        "physics": {"timestep": 0.02, "contacts": False},
    }
    return lone(1.0, 0.1, sea, **{**usual, **fields})


@pytest.mark.parametrize("depth", [None, 4.0])
def test_water_moves_as_airy_s_waves_do_at_any_depth(depth: float | None) -> None:
    """Amplitudes as cosh and sinh over sinh, typed in from the theory."""
    sea = sea_of(under_water(depth))
    z, h = -1.5, 200.0 if depth is None else depth
    k = sea.number
    ratios = [np.exp(k * z)] * 2 if depth is None else [f(k * (z + h)) / np.sinh(k * h) for f in (np.cosh, np.sinh)]
    found = sea.speeds_at(np.array([z]))
    for amplitudes, ratio in zip(found, ratios, strict=True):
        assert amplitudes[:, 0] == pytest.approx(sea.amplitude * sea.rate * ratio, rel=1e-9)


def hull_on_slopes(peak_period: float) -> Scenario:
    """Return a boat in a single short wave: at 2 s its slope moves the hand point 40 % farther than its velocity."""
    wave = {"kind": "jonswap", "significant_height": 0.02, "peak_period": peak_period, "components": 1}
    return lone(0.5, 0.1, wave, agents=OTTER, physics={"timestep": 0.01, "contacts": False})


@pytest.mark.parametrize(
    ("scenario", "ideal", "bodies"),
    [
        slow(lone(0.5, 0.1, {**PM, "components": 3}), (4000.0, 1, 0.01), None),
        *(long(hull_on_slopes(peak_period), None, (200.0, 1, 0.02)) for peak_period in (2.0, 4.0)),
        *(long(under_water(depth), (1000.0, 4, 0.02), (600.0, 3, 0.05)) for depth in (None, 4.0)),
    ],
    ids=["few waves", "slopes at 2 s", "slopes at 4 s", "deep", "shallow"],
)
def test_long_runs_move_as_predicted(scenario: Scenario, ideal: Any, bodies: Any) -> None:
    """Each for so long, of so many seeds, and to this accuracy."""
    record = prediction(scenario)
    if ideal is not None:
        end, seeds, accuracy = ideal
        assert measured(scenario, "ideal", end, seeds) == pytest.approx(record["agents"], rel=accuracy)
    if bodies is not None:
        end, seeds, accuracy = bodies
        assert measured(scenario, "physics", end, seeds, "fused") == pytest.approx(record["bodies"], rel=accuracy)


def predicted(scenario: Scenario) -> DisturbanceRecord:
    """Return the prediction where nothing but waves moves the water."""
    team = scenario.system.team
    return predict_rms(scenario.system, spectrum_of(team), np.zeros((len(team.agents), 3)))


@pytest.mark.parametrize(("place", "height", "id"), [(-1.0, 2.0, "T"), (-2.0, 0.3, "S")], ids=["target", "agent"])
def test_what_passes_through_the_surface_has_no_prediction(place: float, height: float, id: str) -> None:
    """The place of S is 1.8 m above T."""
    motion = {"kind": "lissajous", "amplitude": [0, 0, height], "rate": [0, 0, 0.5]}
    sensing = [{"between": ["S", "T"], "offset": [3, 0, 1.8]}, {"between": ["B", "T"], "offset": [0, 4]}]
    targets = list_members({"T": [0, 0, place]}, motion=motion)
    record = predicted(under_water(None, targets=targets, sensing=sensing, time={"end": 4.0}))
    assert record.rms is None
    assert f"{id} passes through the surface of the waves" in record.reason
    assert set(record.agents.values()) == {None}


@pytest.mark.parametrize("link", [{"delay": 0.1}, {"loss": 0.1}, {"range": 90.0}], ids=str)
def test_over_links_that_are_not_exact_there_is_no_prediction(link: dict[str, float]) -> None:
    assert "delayed or lost" in predicted(lone(0.5, 0.1, PM, links={"sensing": link})).reason


@pytest.mark.parametrize("period", [0.0, 0.1])
def test_a_boat_at_its_target_is_moved_as_the_target_is(period: float) -> None:
    assert predicted(lone(0.5, period, PM, targets=list_members({"T": [5, 0]}))).rms == pytest.approx(0.0, abs=1e-12)


def over_seeds(name: str, backend: str, runs: int) -> dict[str, float]:
    """Return the RMS of each agent's error about the mean of runs that differ in their seeds, after a third, m."""
    found = []
    for seed in range(runs):
        scenario = mjsheaf.load_scenario(name, {"seed": seed})
        data = mjsheaf.simulate(scenario, backend=backend, engine="fused" if backend == "physics" else "mujoco")
        found.append((data.agent_position - data.harmonic_extension).values[len(data.time) // 3 :])
    variance = np.nansum(np.var(found, axis=0, ddof=1), axis=2).mean(axis=0)
    return dict(zip(scenario.team.agent_ids, np.sqrt(variance).tolist(), strict=True))


@pytest.mark.long
@pytest.mark.parametrize("name", ["boat", "own", "frozen", "open_sea"])
def test_predictions_agree_with_long_runs_as_the_guide_has_it(name: str) -> None:
    """Within 3 % on ideal kinematics and 10 % on bodies, and with the table of docs/howto/media.md.

    A boat in waves, a team in gusts of each vehicle's own or in a frozen field, and the scenario that ships.
    """
    if name == "open_sea":
        scenario = mjsheaf.load_scenario(name)
        ideal, bodies = over_seeds(name, "ideal", 300), over_seeds(name, "physics", 150)
    else:
        flow = team().flow.model_dump(mode="json", exclude_none=True)
        flow["air"]["gusts"]["frozen"] = name == "frozen"
        boat = lone(0.5, 0.1, SHORT, agents=OTTER, physics={"contacts": False})
        scenario = boat if name == "boat" else team(flow=flow)
        ideal, bodies = measured(scenario, "ideal", 3000.0, 10), measured(scenario, "physics", 1500.0, 10, "fused")
    record = prediction(scenario)
    assert record["rms"] == pytest.approx(np.sqrt(np.mean(np.square(list(record["agents"].values())))))
    assert record["bodies_reason"] == ""
    guide = (Path(__file__).parents[2] / "docs/howto/media.md").read_text()
    for id in ideal:
        found = [record["agents"][id], ideal[id], record["bodies"][id], bodies[id]]
        print(f"| {name} | {id} | " + " | ".join(f"{x:.3f}" for x in found) + " |")
        assert found[0] == pytest.approx(found[1], rel=0.03)
        assert found[2] == pytest.approx(found[3], rel=0.1)
        line = next(line for line in guide.splitlines() if line.startswith(f"| {name} | {id} |"))
        numbers = [float(cell) for cell in line.split("|")[3:7]]
        assert numbers[::2] == pytest.approx(found[::2], abs=6e-4)
        assert numbers[1::2] == pytest.approx(found[1::2], rel=0.01)


@pytest.mark.long
def test_altitudes_outside_the_model_of_the_gusts_are_named() -> None:
    agents = list_members({f"H{z}": [z, 0, z] for z in (1, 20, 400)}, vehicle="hexarotor")
    flow = {"air": {"dimension": 3, "gusts": {"kind": "dryden", "wind_speed": 6.0}}}
    scenario = lone(0.5, 0.1, PM, agents=agents, sensing=[[agent["id"], "T"] for agent in agents], flow=flow)
    record = examine_scenario(scenario).record
    assert record.disturbance.clipped == pytest.approx({"H1": 3.048, "H400": 304.8})
    terminal = Console(width=200, record=True, file=StringIO())
    terminal.print(report(record))
    assert "H1: 3.048, H400: 304.8" in terminal.export_text()
    assert prediction(team())["clipped"] == {}


@pytest.mark.long
def test_the_screen_has_the_error_of_waves_and_who_cannot_hold_station() -> None:
    """Twice the RMS of the velocity of the surface, 2 (1.98166 / 16)^(1/2) = 0.704 m/s, exceeds a limit of 0.5."""
    law = {"gain": 0.5, "control_period": 0.1, "velocity_limit": 0.5}
    record = examine_scenario(lone(0.5, 0.1, PM, controller=law)).record
    (row,) = [k for k, line in enumerate(screen(record, "lone")) if line.startswith("gusts and waves")]
    text = " ".join(line.strip() for line in screen(record, "lone")[row : row + 3])
    assert f"{record.disturbance.rms:.3g} m on ideal kinematics" in text
    assert "A cannot hold station at times: the medium is up to 0.204 m/s too fast" in text
    still = screen(examine_scenario(mixed_scenario()).record, "still")
    assert not any(line.startswith("gusts and waves") for line in still)


@pytest.mark.slow
def test_a_still_medium_leaves_no_error_and_what_is_unknown_is_null() -> None:
    still = prediction(mixed_scenario())
    assert still["rms"] == 0.0
    assert set(still["agents"].values()) == {0.0}
    law = {"gain": 0.5, "control_period": 0.1, "feedforward": {"rounds": 2}}
    ahead = prediction(lone(0.5, 0.1, PM, controller=law))
    assert ahead["rms"] is None
    assert "follows the targets" in ahead["reason"]


@pytest.mark.long
def test_a_loop_that_is_not_finite_has_no_prediction(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*args: Any) -> None:
        raise np.linalg.LinAlgError("not finite")

    monkeypatch.setattr("mjsheaf.checking.loop.prediction.whole_loop", fails)
    sea = prediction(team())
    assert (sea["rms"], sea["reason"], sea["bodies_reason"]) == (None, "not finite", "not finite")
