"""The loop of the vehicles against simulation.

Oracle: the gain at which a disturbance of a simulated team begins to grow (see `tests.oracles.linearised_run`), which
knows nothing of the linearisation; and the two ways of closing the loop against each other.
"""

import itertools
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjsheaf.checking.loop import body_loop as bodies
from mjsheaf.checking.loop.body_loop import BodyLoop, body_loop, difference_of, mean_medium
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.errors import NoModelError, OverpoweredError
from mjsheaf.loop.linear import HeldPoint
from mjsheaf.loop.system import System
from mjsheaf.scenario import scenario_from_mapping
from mjsheaf.vehicles.loading import load_vehicle
from tests import builders
from tests.builders import QUADROTOR_PAIR, known, make_fields, make_scenario, require
from tests.commands import Capture, call
from tests.oracles.linearised_run import radii_in_a_medium, spectral_radii
from tests.running import analyse
from tests.strategies import tried

RAFT = str(builders.RAFT)
PLANAR = {"wamv", "otter", "hull", RAFT}
SETTLING = 40.0  # s, of agents that begin at q*
SETTLING_IN_A_FLOW = 150.0  # s, where they first have to lean, and to turn
WITHIN = 0.03  # of the largest gain: where a simulation must have begun to grow; 5 % is what is promised
NEUTRAL = 1e-8  # the factor of a heading that nothing turns is 1, to rounding of the differences


def chain(
    vehicles: list[str],
    drift: list[float] | None = None,
    /,
    period: float = 0.02,
    headings: Any = (),
    delay: float = 0.0,
    **terms: Any,
) -> dict[str, Any]:
    """A chain of vehicles, both ends of which see a static target, in a uniform flow, under a law with terms."""
    planar, timestep = set(vehicles) <= PLANAR, 0.002 if {"hull", "aerial", "submersible"} & set(vehicles) else 0.005
    agents: dict[str, dict[str, Any]] = {
        f"A{i}": {"position": [12.0 * i, 3.0 * (i % 2)] + [10.0] * (name not in PLANAR), "vehicle": name}
        for i, name in enumerate(vehicles)
    }
    for agent, heading in zip(agents.values(), headings, strict=False):
        agent["heading"] = heading
    target = {"position": [3.0, 1.0] if planar else [3.0, 1.0, 12.0], "motion": {"kind": "static"}}
    found = make_fields(
        agents,
        {"T": target},
        [["A0", "T"], [[*agents][-1], "T"]],
        time={"end": 60},
        controller={"gain": 0.2, "control_period": period, **({} if period else {"record_period": timestep}), **terms},
        communication=[list(pair) for pair in itertools.pairwise(agents)],
        physics={"timestep": timestep},
        links={"all": {"delay": delay}} if delay else {},
    )
    if drift is not None:
        found["flow"] = {"agents": {"dimension": len(drift), "drift": drift}, "targets": {"dimension": len(drift)}}
    return found


def loop_of(scenario: dict[str, Any], gain: float | None = None, drift: list[float] | None = None) -> BodyLoop:
    system = system_of(scenario, gain)
    medium = np.zeros((len(system.team.agents), 3))
    medium[:, : len(drift or [])] = drift or []
    return body_loop(system, spectrum_of(system.team), medium)


def system_of(scenario: dict[str, Any], gain: float | None = None) -> System:
    controller = {**scenario["controller"], **({} if gain is None else {"gain": gain})}
    return scenario_from_mapping({**scenario, "controller": controller}).system


def resting(scenario: dict[str, Any]) -> dict[str, Any]:
    """Return the scenario with the agents at q*."""
    system = system_of(scenario)
    last = system.team.first_state[1:]
    places = np.split(system.team.at_rest(system.initial), last)
    agents = zip(scenario["agents"], places, strict=False)
    return {**scenario, "agents": [{**agent, "position": place.tolist()} for agent, place in agents]}


def hold_against_simulation(scenario: dict[str, Any], drift: list[float] | None = None) -> None:
    """The largest gain is where disturbances of a run on bodies cease to decay, and the loop there is marginal."""
    loop = loop_of(scenario, drift=drift)
    assert loop.stable is True
    largest = known(loop.largest_gain)
    assert abs(known(loop_of(scenario, largest, drift).least_damped).damping) < 0.01
    law = scenario["controller"]
    law = law | {"control_period": law["control_period"] or scenario["physics"]["timestep"]}  # continuous: at each step
    settled, below, above = (
        make_scenario(resting(scenario) | {"controller": law | {"gain": share * largest}})
        for share in (0.3, 1.0 - WITHIN, 1.0 + WITHIN)
    )
    settling = SETTLING if drift is None else SETTLING_IN_A_FLOW
    if law.keys() & {"newton", "integral", "feedforward", "drift"} or scenario["links"]:
        radii = spectral_radii(settled, "physics", settling, below, above)
    else:
        radii = radii_in_a_medium(settled, [below.system.gain, above.system.gain], settling)
    assert radii[0] < 1.0 + NEUTRAL < radii[1]


@pytest.mark.long
def test_check_refuses_the_ring(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "ring.yaml"
    path.write_text(json.dumps(QUADROTOR_PAIR))
    assert call("check", str(path), "--no-trial", "--json") == 1
    captured = capsys.readouterr()
    record = json.loads(captured.out)
    found = record["margins"]["bodies"]
    require(record, {"ok": False, "margins.bodies.stable": False})
    assert all(a["verdict"] == "holds" for a in record["assumptions"])
    assert found["spectral_radius"] > 1.0
    assert 1.5 < found["largest_gain"] < 2.0
    assert found["least_damped"]["damping"] < 0.0
    assert found["least_damped"]["agent"] in ("Q1", "Q2")
    assert "unstable" in captured.err
    assert call("check", str(path), "--no-trial", "--set", "controller.gain=1.5") == 0
    assert "stable" in capsys.readouterr().out


TERMS: list[dict[str, Any]] = [
    {"newton": {"rounds": 2}},
    {"newton": {"rounds": 1}, "integral": {"gain": 0.01}},
    {"integral": {"gain": 0.1}},
    {"newton": {"rounds": 3}, "feedforward": {"rounds": 2}, "drift": {}},
]
VEHICLES = ["hexarotor", "quadrotor", "x500", "wamv", "otter", "hull", "aerial", "submersible", RAFT]
PERIODS = [0.02, 0.1, 0.0]
"""Each vehicle is tried with one of these, and with all of them in `make test-all`."""


def words_of(value: Any) -> str:
    """Words for the cases below."""
    if isinstance(value, dict):
        return " ".join(f"{name} {number}" for name, number in value.items()) or "plain"
    return "+".join(map(str, value)) if value else "calm"


@pytest.mark.long
@pytest.mark.parametrize(
    ("vehicles", "drift", "options"),
    [
        (["otter", "wamv", "quadrotor"], [0.5, 0.3, 0.0], {"headings": [120, 60, 0]}),
        (["otter", "x500", "otter"], None, {"headings": [0, 0, 90]}),
        (["otter", "wamv", "quadrotor", "hull"], None, {"headings": [30, -40, 0, 90]}),
        (["quadrotor", "hexarotor", "wamv"], None, {}),
        (["wamv", RAFT, "otter"], [0.3, 0.0], {"headings": [10, 20, 30]}),
        (["hexarotor", "x500", "hexarotor"], [2.0, -1.0, 0.0], {"headings": [0, 50, -70]}),
        (["quadrotor"] * 2, [4.0, 2.0, 0.5], {}),
        (["otter"] * 3, [0.5, 0.3], {"headings": [0, 0, 120]}),
        (["wamv"] * 2, [0.8, 0.5], {"headings": [0, 60]}),
        *((["quadrotor"] * 3, None, terms) for terms in (TERMS[0], TERMS[2], TERMS[3])),
        *((["otter", "wamv", "x500"], None, terms) for terms in (TERMS[0], TERMS[2], TERMS[3])),
        (["quadrotor"] * 3, None, {"gain": 1.0, "newton": {"rounds": 1}, "integral": {"gain": 0.3}}),
        (["quadrotor"] * 2, None, {"delay": 0.1, "feedforward": {}, "drift": {}}),
        (["otter", "quadrotor"], None, {"delay": 0.3, "integral": {"gain": 0.05}}),
        *(
            ([vehicle] * 2, None, {"period": PERIODS[(k + j) % 3]})
            for k, vehicle in enumerate(VEHICLES)
            for j in range(tried(3, 1))
        ),
    ],
    ids=words_of,
)
def test_teams_swing_up_where_check_says(
    vehicles: list[str], drift: list[float] | None, options: dict[str, Any]
) -> None:
    """Every vehicle, mixed teams in a flow, terms and delays: of alike vehicles by modes, of unlike ones whole."""
    hold_against_simulation(chain(vehicles, drift, **options), drift)


def test_over_links_with_unlike_delays_nothing_is_said() -> None:
    loop = loop_of({**chain(["quadrotor"] * 2), "links": {"sensing": {"delay": 0.1}}})
    assert (loop.stable, loop.stable_over_exact_links) == (None, True)
    assert "delayed" in loop.reason


@pytest.mark.slow
@pytest.mark.parametrize("terms", [{}, *TERMS])
@pytest.mark.parametrize("vehicle", ["quadrotor", "wamv"])
def test_apart_by_modes_or_whole_is_the_same(
    vehicle: str, terms: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = chain([vehicle] * 4, headings=[0, 0, 0, 0], **terms)
    apart = [loop_of(scenario, gain) for gain in (0.2, 20.0)]
    monkeypatch.setattr(bodies, "_parts", lambda *_: [])
    whole = [loop_of(scenario, gain) for gain in (0.2, 20.0)]
    assert [x.stable for x in apart] == [x.stable for x in whole] == [True, False]
    for one, other in zip(apart, whole, strict=True):
        assert one.spectral_radius == pytest.approx(other.spectral_radius, rel=1e-7)
        assert one.largest_gain == pytest.approx(other.largest_gain, rel=2e-3)
        assert known(one.least_damped).damping == pytest.approx(known(other.least_damped).damping, rel=1e-3)


def test_a_large_team_is_decided_over_the_interval_of_its_spectrum(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = chain(["quadrotor"] * 6)
    exact = loop_of(scenario)
    monkeypatch.setattr(bodies, "DENSE_STATES", 1)
    rough = loop_of(scenario)
    assert rough.stable is exact.stable is True
    assert rough.largest_gain == pytest.approx(exact.largest_gain, rel=2e-3)
    assert rough.spectral_radius == pytest.approx(exact.spectral_radius, rel=1e-6)
    assert loop_of(scenario, 5.0).stable is False


@pytest.mark.parametrize(("agent", "stable"), [(-1, None), (1, False)])
def test_what_only_a_sampled_eigenvalue_makes_unstable_is_undecided(
    monkeypatch: pytest.MonkeyPatch, agent: int, stable: bool | None
) -> None:
    monkeypatch.setattr(bodies, "_eigenvalues", lambda *args: (np.array([1.0, 50.0]), np.array([0, agent])))
    loop = loop_of(chain(["quadrotor"] * 2))
    assert loop.stable is stable
    assert loop.reason.startswith("only eigenvalues between") is (stable is None)
    assert known(loop.spectral_radius) > 1.0


def test_a_hold_of_hours_leaves_no_trace_of_what_a_vehicle_does_by_itself() -> None:
    """Its modes decay to a factor of exactly 0 within a period: no warning, and no growth."""
    scenario = chain(["hull"] * 2, period=2e4) | {"time": {"end": 1e5}}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert loop_of(scenario, 1e-5).stable is True
        assert loop_of(scenario, 1e-3).stable is False


def test_headings_that_nothing_holds_are_no_instability() -> None:
    """Otters in still water keep whatever heading they have; turned all together, nothing else changes."""
    loops = [loop_of(chain(["otter"] * 3, headings=[angle, angle + 40, angle - 100])) for angle in (0, 77)]
    assert [loop.stable for loop in loops] == [True, True]
    assert loops[0].largest_gain == pytest.approx(loops[1].largest_gain, rel=2e-3)
    assert loops[0].spectral_radius == pytest.approx(loops[1].spectral_radius, rel=1e-6)


@pytest.mark.slow
def test_what_is_free_does_not_enter() -> None:
    """Nothing holds the drones' common height, whose factor of 1 is no mode of the law."""
    record = analyse("air_tracks_surface")["margins"]["bodies"]
    assert record["stable"] is True
    assert record["spectral_radius"] < 1.0 - 1e-4


@pytest.mark.parametrize(
    ("scenario", "drift", "why"),
    [
        (chain(["otter"] * 2), [4.0, 0.0], "A0 cannot hold station"),
        (chain(["quadrotor"] * 2), [np.nan, 0.0], "not known"),
        ({**QUADROTOR_PAIR, "communication": [], "sensing": []}, None, "nothing is held"),
    ],
)
def test_what_cannot_be_said_is_undecided(scenario: dict[str, Any], drift: list[float] | None, why: str) -> None:
    loop = loop_of(scenario, drift=drift)
    assert (loop.stable, loop.spectral_radius, loop.largest_gain, loop.least_damped) == (None, None, None, None)
    assert why in loop.reason


@pytest.mark.parametrize(
    ("vehicle", "medium", "wind", "error", "words"),
    [
        ("wamv_azimuth", [3.8, 0.0, 0.0], None, NoModelError, "at 3.8 m/s through the medium: why"),
        ("wamv_azimuth", [0.0, 0.0, 0.0], None, NoModelError, "A has no linear model at rest: why"),
        ("wamv_azimuth", [0.0, 0.0, 0.0], [5.0, 0.0, 0.0], NoModelError, "at rest and in its wind: why"),
        ("wamv_azimuth", [3.9, 0.0, 0.0], None, OverpoweredError, "in a mean flow of 3.9 m/s"),
        ("wamv_azimuth", [1.0, 0.0, 0.0], [5.0, 0.0, 0.0], OverpoweredError, "to its place and in its wind: why"),
        ("x500", [10.0, 0.0, 0.0], None, NoModelError, "at 10 m/s through the medium: why"),
        ("x500", [10.0, 0.0, 0.1], None, OverpoweredError, "in a mean flow of 10 m/s"),
    ],
)
def test_a_vehicle_without_a_model_holds_its_place_up_to_its_speed_in_level_flow_and_still_air(
    vehicle: str, medium: list[float], wind: list[float] | None, error: type[Exception], words: str
) -> None:
    """A wamv_azimuth makes 3.85 m/s in its slowest direction."""
    air = {} if wind is None else {"wind": np.array(wind)}
    point = HeldPoint(load_vehicle(vehicle), np.array(medium), 0.0, **air)
    with pytest.raises(error, match=words):
        bodies._require_linear("A", point, "why")


def test_a_loop_that_is_not_finite_is_undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bodies, "closed", lambda plant, law: np.full((1, 12, 12), np.nan))
    loop = loop_of(chain(["quadrotor"] * 2))
    assert loop.stable is None
    assert loop.reason.startswith("the loop cannot be solved: ")


def test_a_large_team_of_unlike_vehicles_is_undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bodies, "LARGEST_WHOLE", 20)
    loop = loop_of(chain(["otter", "wamv", "otter"]))
    assert loop.stable is None
    assert "too many unlike vehicles" in loop.reason


def test_a_velocity_limit_below_the_current_is_undecided() -> None:
    scenario = chain(["wamv"] * 2, velocity_limit=0.5)
    assert loop_of(scenario, drift=[0.4, 0.0]).stable is True
    assert "velocity limit" in loop_of(scenario, drift=[0.6, 0.0]).reason


def test_mean_medium_is_relative_to_what_the_team_follows() -> None:
    """In a drift of (1, 0) a target that goes at (0, 1) leaves agents a mean flow of (1, -1)."""
    scenario = chain(["wamv"] * 2, [1.0, 0.0])
    scenario["targets"][0]["position"] = [0.0, 0.0]
    system = system_of(scenario)
    time = np.linspace(5.0, 15.0, 50)  # a mean does not depend on when it begins
    start = system.team.pack(system.initial)[: system.team.dirichlet.H.shape[0]]
    q_star = start + np.outer(time - 5.0, np.tile([0.0, 1.0], 2))
    assert mean_medium(system, time, q_star) == pytest.approx(np.tile([1.0, -1.0, 0.0], (2, 1)))


def test_vehicles_are_alike_up_to_a_small_share_of_their_response() -> None:
    response = np.array([[1.0, 2.0], [3.0, 4.0]])
    assert difference_of(response, response) == 0.0
    assert difference_of(response, 0.75 * response) == difference_of(0.75 * response, response) == 0.25
