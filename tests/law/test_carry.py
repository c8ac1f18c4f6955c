"""Memory of a run across phases: an event does not affect an agent for which it changes nothing.

Oracle: the run without the event.
"""

from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import load_scenario, simulate
from mjsheaf.law.law import carry, edges_kept, evaluate_law, new_memory
from mjsheaf.loop.system import Phase
from mjsheaf.runs.simulate import stream
from mjsheaf.scenario import Scenario
from tests.builders import team_of
from tests.running import walk

BACKENDS: dict[str, dict[str, Any]] = {
    "ideal": {"backend": "ideal"},
    "mujoco": {"backend": "physics"},
    "fused": {"backend": "physics", "engine": "fused", "threads": 1},
}
STILL_GOOD = {"kind": "gilbert_elliott", "to_bad": 0, "to_good": 1}
H = 0.02


def delayed(events: list[dict[str, Any]], **links: Any) -> Scenario:
    """Two boats in a line behind a target, with a delay of six periods."""
    fields: dict[str, Any] = {"time": {"end": 0.5}, "seed": 3, "events": events, "physics": {"timestep": 0.01}}
    fields |= {"controller": {"gain": 3, "control_period": H}}
    fields |= {"links": {"all": {"delay": 6 * H} | links, "record": True}}
    return load_scenario(team_of({"A1": [0, 0], "A2": [4, 1]}, {"T1": [9, 3]}, "A1 T1, A1 A2", **fields))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("links", "change"),
    [
        ({}, {"hold": 0.2}),
        ({}, {"loss": STILL_GOOD}),
        ({"loss": STILL_GOOD}, {"loss": 0}),
        ({"loss": 0.3}, {"loss": 0.3, "noise": 0}),
        ({"hold": 0.2}, {"hold": 0.1}),
        ({"hold": 0.2}, {"hold": 0, "bias": 0}),
    ],
)
def test_an_event_that_changes_nothing_keeps_what_is_under_way(
    links: dict[str, Any], change: dict[str, Any], backend: str
) -> None:
    event = {"time": 0.2, "set": {f"links.all.{name}": value for name, value in change.items()}}
    plain, changed = (simulate(delayed(events, **links), **BACKENDS[backend]) for events in ([], [event]))
    np.testing.assert_array_equal(changed["delivery"], plain["delivery"])
    for name in ("agent_position", "velocity_command", "heard", "measurement"):
        np.testing.assert_array_equal(changed[name], plain[name], err_msg=name)
    assert (plain["heard"].values[10:] > 0).any()


def test_what_an_exact_edge_measured_last_is_held() -> None:
    """It has no delay line; from the event on everything is lost."""
    events = [{"time": 0.2, "set": {"links.all.loss": 1}}]
    data = simulate(delayed(events, delay=0, hold=0.1), "ideal")
    heard = data["heard"].values
    assert heard[:10].tolist() == [[2, 2]] * 10
    assert heard[10:].tolist() == [[1, 1]] * 5 + [[0, 0]] * 11
    held = data["measurement"].values[10:15]
    np.testing.assert_array_equal(held, np.broadcast_to(data["measurement"].values[9], held.shape))


@pytest.mark.parametrize(("before", "after"), [(2, 5), (5, 2)])
def test_a_phase_with_another_delay_keeps_what_arrives_in_it(before: int, after: int) -> None:
    """Measurements due earlier under the new delay are superseded; newer ones arrive after their delay."""
    first, second = (delayed([], delay=d * H).system for d in (before, after))
    pieces = list(stream([Phase(0, first), Phase(10, second)], "ideal", 0))
    heard = np.concatenate([piece["heard"].values for piece in pieces])
    y = np.concatenate([piece["measurement"].values for piece in pieces])[:, -2:]
    positions = np.concatenate([piece["agent_position"].values for piece in pieces])[:, 0]
    true = np.array([9.0, 3.0]) - positions[:, :2]
    silent = max(after - before, 0)
    assert heard[:, -1].tolist() == [0] * before + [2] * (10 - before) + [0] * silent + [2] * (16 - silent)
    np.testing.assert_allclose(y[10 + silent :], true[10 + silent - after : len(true) - after], rtol=0, atol=1e-12)


TERMS: dict[str, Any] = {
    "feedforward": {"rounds": 2, "filter": 0.1, "extrapolate": True},
    "newton": {"rounds": 2},
    "drift": {"filter": 0.1},
    "integral": {"gain": 0.1},
}


def following(events: list[dict[str, Any]], links: dict[str, Any]) -> Scenario:
    """Boats and an aircraft behind a target on a curve, and Z9, which no other agent measures."""
    team = team_of(
        {"B0": [-3, 1], "B1": [4, 2], "D0": [1, -2, 6], "Z9": [3, 3]},
        {"T0": [2, 1, 8]},
        "B0 B1, B1 D0, D0 T0, B0 T0, Z9 T0",
        time={"end": 1.2},
        seed=5,
        controller={"gain": 1.0, "control_period": 0.05, **TERMS},
        target_motion={"kind": "lissajous", "amplitude": [5, 5, 1], "rate": [1, 2, 1], "phase": [1, 2, 3]},
        physics={"timestep": 0.01},
    )
    return load_scenario(team | {"links": links, "events": events})


GAIN = [{"time": 0.5, "set": {"controller.gain": 1.0, "controller.velocity_limit": 1e8}}]
ELSEWHERE = [{"time": 0.5, "lose": "Z9"}, {"time": 0.8, "join": "Z9"}]
AWAY = [{"time": 0.5, "cut": ["Z9", "T0"]}, {"time": 0.7, "restore": ["Z9", "T0"]}]
FAR = [{"time": 0.5, "set": {"links.sensing.range": 1e8}}]
FAR_AND_BACK = [*FAR, {"time": 0.8, "set": {"links.sensing.range": None}}]
LOST = {"all": {"delay": 0.1, "loss": 0.3, "hold": 0.1}}
ROUNDS = {"all": {"delay": 0.1}, "rounds": {"delay": 0.05, "loss": 0.2}}


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("backend", ["ideal", "fused"])
@pytest.mark.parametrize(
    ("events", "links", "tolerance"),
    [
        (GAIN, {}, 0.0),
        (GAIN, LOST, 0.0),
        (GAIN, ROUNDS, 0.0),
        (ELSEWHERE, {}, 0.0),
        (ELSEWHERE, ROUNDS, 0.0),
        (AWAY, {}, 0.0),
        (AWAY, LOST, 0.0),
        (FAR, {}, 1e-12),
        (FAR_AND_BACK, {}, 1e-12),
        (FAR, LOST, 0.0),
        ([{"time": 0.5, "set": {"links.all.hold": 0.5}}], {"all": {"delay": 0.1}}, 0.0),
        ([{"time": 0.5, "set": {"links.all.loss": STILL_GOOD}}], ROUNDS, 0.0),
    ],
    ids=["gain", "gain-lost", "gain-rounds", "lose", "lose-rounds", "cut", "cut-lost", "range", "range-and-back",
         "range-lost", "hold", "chain-rounds"],
)  # fmt: skip
def test_an_event_that_changes_nothing_for_an_agent_does_not_disturb_it(
    events: list[dict[str, Any]], links: dict[str, Any], tolerance: float, backend: str
) -> None:
    plain, changed = (run(following(e, links), backend) for e in ([], events))
    for name in ("agent_position", "velocity_command"):
        ours, theirs = (np.nan_to_num(data[name].sel(agent=["B0", "B1", "D0"]).values) for data in (changed, plain))
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance * 30, err_msg=name)
    assert len(np.unique(changed["phase"].values)) == len(events) + 1


def run(scenario: Scenario, backend: str) -> xr.Dataset:
    return simulate(scenario, allow_drift=True, **BACKENDS[backend])


@pytest.mark.slow
def test_only_agents_whose_edges_change_wait_before_they_extrapolate() -> None:
    """A cut link restarts its two ends, and on a restored edge a target moves as v says for one sample."""
    events = [{"time": 0.5, "cut": ["B0", "T0"]}, {"time": 0.6, "restore": ["B0", "T0"]}]
    systems = [phase.system for phase in following(events, {}).phases]
    memory, x = new_memory(systems[0].law, 5), systems[0].initial.copy()
    speed = np.array([1.0, -0.5, 0.2])
    for n in range(16):
        now = systems[(n >= 10) + (n >= 12)]
        if n in (10, 12):
            memory = carry(memory, systems[(n >= 12)].law, now.law, n)
            assert memory.terms.since[:4].tolist() == [0.0, n, n, n]
        if n == 12:
            rows = slice(*now.law.edges.first[3:5])
            assert not memory.terms.age[rows].any()
            expected = now.law.edges.P_tail[rows].T @ (now.law.edges.F_tail[rows] @ memory.terms.v[0])
        evaluate_law(now.control, 0.05 * n, x, None, memory)
        if n == 12:
            np.testing.assert_allclose(memory.terms.right[0], expected, rtol=0, atol=1e-12)
        if n == 13:
            np.testing.assert_allclose(memory.terms.rate[rows], now.law.edges.F_tail[rows] @ speed, rtol=0, atol=1e-9)
        x[4] += 0.05 * speed


def test_edges_are_known_again_by_their_ends_and_maps() -> None:
    """Parallel edges by their order; one with other maps, or of another size, is another edge."""
    scenario = following([], {})
    raw = scenario.model_dump(mode="json", exclude_none=True)
    one_row = {"tail": [[1.0, 0.0]], "head": [[1.0, 0.0]]}
    double = {"tail": (2 * np.eye(3)).tolist(), "head": np.eye(3).tolist()}
    raw["communication"] = [["B1", "D0"], ["B0", "B1"], {"between": ["B0", "B1"], "map": one_row}]
    raw["sensing"] = [{"between": ["D0", "T0"], "map": double}, {"between": ["B0", "T0"], "weight": 3.0}, ["Z9", "T0"]]
    old, new = (each.system.law.edges for each in (scenario, load_scenario(raw)))
    assert edges_kept(old, new)[0].tolist() == [1, 0, -1, -1, 3, 4]
    assert edges_kept(new, new)[0].tolist() == [*range(6)]


def test_feedforward_that_begins_again_waits_before_it_extrapolates() -> None:
    """Other terms have been there all the time."""
    sets = {0.3: None, 0.5: TERMS["feedforward"]}
    events = [{"time": time, "set": {"controller.feedforward": value}} for time, value in sets.items()]
    phases = following(events, {}).phases
    systems = [phase.system for phase in phases]
    for _, x, _, now in walk(phases[:2], 10):
        x[4] += [0.05, 0.0, 0.0]
        memory = now
    law = systems[-1].law
    assert law.terms.settled > 1
    memory = carry(memory, systems[-2].law, law, 10)
    assert not memory.terms.since.any()
    assert not memory.terms.v.any()
    still = law._replace(terms=law.terms._replace(lead=np.zeros_like(law.terms.lead)))
    commands = []
    for control in (systems[-1].control, systems[-1].control._replace(law=still)):
        own = new_memory(law, 5)
        own.flat[:] = memory.flat
        evaluate_law(control, 0.5, x, None, own)
        commands.append(own.command.copy())
    np.testing.assert_array_equal(commands[0], commands[1])
    assert np.abs(commands[0]).max() > 0.0
