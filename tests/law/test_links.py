"""Links and sensors in the loop.

Oracles: one Python object per edge, which receives the true measurements of a run, in numpy and scipy; one Python
object per agent, which receives delivered measurements; means of random numbers, with bounds of five standard
errors; numbers worked out by hand; the runs without links.
"""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from scipy.spatial.transform import Rotation

import mjsheaf
from mjsheaf import load_scenario, simulate
from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.law.edges import linked_edges
from mjsheaf.law.in_python import PerAgent
from mjsheaf.law.law import new_memory
from mjsheaf.loop.system import Phase
from mjsheaf.noise import LARGEST_NORMAL, normal_of, stream_of, uniforms
from mjsheaf.results.store import dataset_bytes
from mjsheaf.runs.simulate import stream
from mjsheaf.scenario import Scenario
from mjsheaf.team import Edge
from mjsheaf.team.links import Exact, Link, LinkModel, Links
from tests.builders import mixed_scenario, positions_of, team_of, two_boats
from tests.oracles.law import PaperLaw, disagreement, measurement
from tests.running import sample_law, walk

BACKENDS = ("ideal", "physics")
BURSTS = {"kind": "gilbert_elliott", "to_bad": 0.1, "to_good": 0.3, "loss_good": 0.05, "loss_bad": 0.9}
RANGE_BEARING = {"kind": "range_bearing", "range_noise": 0.3, "bearing_noise": 4.0}
H = 0.01


def tangled(**fields: Any) -> Scenario:
    """Boats and aircraft of which every edge has another link; fields replace fields."""
    wanted: dict[str, Any] = {
        "seed": 11,
        "links": {
            "all": {"noise": 0.2, "delay": 0.02},
            "communication": {"loss": 0.3, "hold": 0.02},
            "sensing": {"sensor": RANGE_BEARING, "loss": BURSTS},
            "record": True,
        },
        "communication": [["boat", "front"], {"between": ["front", "back"], "bias": 0.3, "range": 5.5, "delay": 0.0}],
        "sensing": [
            {"between": ["boat", "ship"], "bias": -0.1, "delay": 0.05, "hold": 1.0},
            ["front", "diver"],
            {"between": ["back", "diver"], "map": "local_frame"},
        ],
    }
    return mixed_scenario(**(wanted | fields))


def attitudes(scenario: Scenario, data: xr.Dataset) -> list[Rotation]:
    """Body to world of every agent, T each: true on bodies, along the motion on ideal kinematics."""
    if "agent_orientation" in data:
        q = data["agent_orientation"].values
        return [Rotation.from_quat(q[:, i], scalar_first=True) for i in range(q.shape[1])]
    found, heading = [], scenario.system.bodies.heading
    for i, x in enumerate(np.nan_to_num(data["agent_position"].values).transpose(1, 0, 2)):
        d = np.diff(x, axis=0)
        angles = np.column_stack([np.arctan2(d[:, 1], d[:, 0]), -np.arctan2(d[:, 2], np.hypot(d[:, 0], d[:, 1]))])
        found.append(Rotation.from_euler("ZY", np.vstack([[heading[i], 0.0], angles])))
    return found


class Line:
    """One edge's link: what it is handed at each sample, as a textbook would say it."""

    def __init__(self, kind: str, edge: Edge, link: LinkModel, seed: int) -> None:
        self.edge, self.link, self.seed, self.stream = edge, link, seed, stream_of(kind, edge.tail, edge.head, 0)
        self.sent: list[Array | None] = []
        self.bad: bool | None = None
        self.last: tuple[int, Array] | None = None

    def lost(self, n: int) -> bool:
        loss, chance = self.link, uniforms(self.seed, self.stream, n, 1)[0]
        if loss.loss_good != loss.loss_bad:
            if self.bad is None:
                self.bad = chance < loss.to_bad / (loss.to_bad + loss.to_good)
            else:
                self.bad = chance >= loss.to_good if self.bad else chance < loss.to_bad
        return uniforms(self.seed, self.stream, n, 0)[0] < (loss.loss_bad if self.bad else loss.loss_good)

    def sense(self, n: int, y: Array, body: Rotation) -> Array:
        error = stats.norm.ppf(uniforms(self.seed, self.stream, n, 0)[1:])
        link, m = self.link, len(y)
        if not link.bearing:
            return y + link.noise * error[:m] + link.bias
        far, angles = link.range_noise * error[0], link.bearing_noise * error[1:]
        r = np.linalg.norm(y)
        if m == 2:
            bearing = np.arctan2(y[1], y[0]) + angles[0]
            return (r + far) * np.array([np.cos(bearing), np.sin(bearing)]) + link.bias
        seen = body.inv().apply(self.edge.F_tail.T @ y)
        azimuth, elevation = np.arctan2(seen[1], seen[0]) + angles[0], np.arcsin(seen[2] / r) + angles[1]
        ray = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
        return self.edge.F_tail @ body.apply((r + far) * np.array(ray)) + link.bias

    def hear(self, n: int, y: Array, distance: float, body: Rotation) -> tuple[int, Array]:
        """0, 1 or 2 for nothing, held or new, and the measurement."""
        lost = self.lost(n) or distance > self.link.range
        self.sent.append(None if lost else self.sense(n, y, body))
        delay, hold = round(self.link.delay / H), int(self.link.hold / H + 1e-6)
        arrived = self.sent[n - delay] if n >= delay else None
        if arrived is not None:
            self.last = n, arrived
            return 2, arrived
        if self.last is not None and n - self.last[0] <= hold:
            return 1, self.last[1]
        return 0, np.full(len(y), np.nan)


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_edge_hears_what_its_link_makes_of_the_truth(backend: str) -> None:
    """The law's eta is the sum over received measurements; the true eta is recorded next to it."""
    scenario = tangled()
    data, team = simulate(scenario, backend), scenario.team
    body, begin, seen, used = attitudes(scenario, data), 0, set(), []
    x = positions_of(data)
    resolved = linked_edges(team, scenario.links)
    assert data["measuring_edge"].values[1] == "communication front-back"
    for k, (kind, *_, edge, link) in enumerate(resolved):
        y = measurement(team, edge, x)
        distance = np.linalg.norm(x[:, team.index[edge.head]] - x[:, team.index[edge.tail]], axis=1)
        line, i, m = Line(kind, edge, link, 11), team.index[edge.tail], y.shape[1]
        heard, found = data["heard"].values[:, k], data["measurement"].values[:, begin : begin + m]
        begin += m
        for n in range(len(y)):
            state, measured = line.hear(n, y[n], distance[n], body[i][n])
            seen.add((k, state))
            assert heard[n] == state, (str(edge), n)
            np.testing.assert_allclose(found[n], measured, rtol=0, atol=1e-8, err_msg=f"{edge} {n}")
            assert state != 1 or np.array_equal(found[n], found[n - 1])  # held to the bit
        used.append(np.where(np.isnan(found), -edge.b, found))  # what does not arrive adds nothing
    assert len(seen) >= 12  # new, held and without a measurement on most
    edges, N = [each.edge for each in resolved], len(team.agents)
    eta, true_eta = disagreement(team, x, edges, used), disagreement(team, x, edges)
    measured = np.nan_to_num(data["measured_disagreement_vector"].values)
    np.testing.assert_allclose(measured, eta[:, :N], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.nan_to_num(data["disagreement_vector"].values), true_eta[:, :N], rtol=0, atol=1e-9)
    np.testing.assert_allclose(data["disagreement"], np.linalg.norm(true_eta[:, :N], axis=2), rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.nan_to_num(data["velocity_command"].values), -3.0 * measured, rtol=0, atol=1e-9)
    # Delivery counts what could have arrived.
    delays = [round(link.delay / H) for *_, link in resolved]
    shares = [(data["heard"].values[d:, k] == 2).mean() for k, d in enumerate(delays)]
    np.testing.assert_allclose(data["delivery"], shares, rtol=0, atol=1e-12)


@pytest.mark.slow(each=True)
@pytest.mark.parametrize("backend", BACKENDS)
def test_the_local_form_does_the_same(backend: str) -> None:
    scenario = tangled()
    law = PerAgent(partial(PaperLaw, gain=3.0))
    ours, theirs = (simulate(scenario, backend, controller=controller) for controller in (None, law))
    np.testing.assert_array_equal(theirs["heard"], ours["heard"])
    np.testing.assert_allclose(theirs["agent_position"], ours["agent_position"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(theirs["measurement"], ours["measurement"], rtol=0, atol=1e-9)


def test_laws_in_python_know_what_they_heard() -> None:
    heard = []

    def law(t: float, sample: Any) -> Array:
        heard.append(sample.heard)
        return np.zeros((3, 3))

    scenario = tangled(anchors=[{"agent": "front", "axes": ["z"], "value": [2.0]}])
    data = simulate(scenario, "ideal", controller=law)
    np.testing.assert_array_equal(np.array(heard)[:, :5], data["heard"].values > 0)
    assert np.array(heard)[:, 5].all()  # an anchor has no link


# -- one thing at a time -----------------------------------------------------------------------------------------------


def still(links: dict[str, Any], end: float, **fields: Any) -> tuple[Scenario, xr.Dataset]:
    rest = {"targets": [{"id": "T1", "position": [0, 0]}], "controller": {"control_period": H}}
    scenario = two_boats("hull", "hull", time={"end": end}, links={**links, "record": True}, **(rest | fields))
    return scenario, simulate(scenario, "ideal", controller=lambda t, sample: np.zeros((2, 3)))


def test_normal_numbers() -> None:
    p = np.concatenate([np.arange(1, 3000) / 3000, 2.0 ** -np.arange(10.0, 34), 1 - 2.0 ** -np.arange(10.0, 34)])
    np.testing.assert_allclose([normal_of(x) for x in p], stats.norm.ppf(p), rtol=1.2e-9, atol=1e-15)
    assert normal_of(2.0**-33) > -LARGEST_NORMAL


def test_beyond_its_range_a_link_is_silent() -> None:
    """By the distance of bodies in space, whatever the edge compares; its limit is within; the surface has a height."""
    pairs = "boat front, boat diver, front diver"
    team = team_of({"boat": [0, 0], "front": [0, 4, 8]}, {"diver": [0, 1]}, pairs, time={"end": 0.05})
    team["anchors"] = [{"agent": "front", "axes": ["z"], "value": [8.0]}]
    for height, distance in ((0.0, np.sqrt(80.0)), (5.0, 5.0)):
        for far, heard in ((float(np.nextafter(distance, 0.0)), 0), (float(distance), 2)):
            links = {"communication": {"range": far}, "record": True}
            data = simulate(load_scenario(team | {"links": links, "scene": {"height": height}}), "ideal")
            assert data["heard"].values[0].tolist() == [heard, 2, 2]


def test_a_range_of_zero_is_accepted() -> None:
    agents = [{"id": "A1", "position": [0, 0]}, {"id": "A2", "position": [0, 0]}]
    sensor = {"sensor": RANGE_BEARING}
    _, data = still({"all": sensor}, end=0.1, agents=agents, formations=[])
    np.testing.assert_array_equal(data["measurement"].values, 0.0)


@pytest.mark.parametrize("lossy", [{}, {"loss": 0.5}, {"loss": BURSTS, "hold": 0.03}])
def test_feedforward_knows_the_velocity_of_a_target_from_two_old_samples(lossy: dict[str, Any]) -> None:
    """The same with rare and delayed measurements, for an agent that moves arbitrarily in between."""
    controller = {"gain": 1.0, "control_period": H, "feedforward": {"rounds": 2}}
    scenario = tangled(controller=controller, links={"sensing": {"delay": 0.04, **lossy}}, communication=[],
                       sensing=[["boat", "ship"], ["front", "diver"], ["back", "diver"]])  # fmt: skip
    system, rng = scenario.system, np.random.default_rng(3)
    velocity = np.array([[0.5, -0.4, 1.0], [2.0, 1.0, 0.0]])
    first, count = system.law.edges.first, np.zeros(3)
    for _, x, _, memory in walk(system, 80):
        count += memory.links.heard == 2.0
        for k, target in enumerate((1, 0, 0)):
            found = memory.terms.rate[first[k] : first[k + 1]]
            wanted = velocity[target, : len(found)] * (count[k] >= 2)
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)
        x[:3] += rng.normal(0, 0.1, (3, 3)) * [[1, 1, 0], [1, 1, 1], [1, 1, 1]]
        x[3:] += velocity * H
    assert (count >= 10).all()


@pytest.mark.parametrize("fields", [
    {"links": {"sensing": {"noise": 0.5}}},
    {"links": {"sensing": {"noise": 0.5, "delay": 0.05}}},
    {"links": {"sensing": {"noise": 0.5, "loss": 0.3}}},
    {"links": {"sensing": {"noise": 0.5, "loss": {"kind": "gilbert_elliott", "to_bad": 0.1, "to_good": 0.2}}}},
    {"links": {"sensing": {"noise": 0.5}}, "events": [{"time": k, "set": {"controller.gain": 0.5}} for k in (2, 4, 6)]},
])  # fmt: skip
def test_noise_cancels_in_the_filtered_velocity_of_a_target(fields: dict[str, Any]) -> None:
    """The sum of differences over a second equals the error of its ends, also over losses and events."""
    law = {"gain": 0.5, "control_period": H, "feedforward": {"rounds": 2, "filter": 0.5}}
    worst = [float(at_target(law, seed=seed, **fields)["tracking_error"].max()) for seed in range(4)]
    assert max(worst) < 0.9, worst


def test_a_phase_begins_with_what_filters_hold() -> None:
    """Noise of odometry, which a first difference after every event would pass on unfiltered."""
    law = {"gain": 0.5, "control_period": H, "feedforward": {"rounds": 2, "filter": 0.5}, "odometry": {"noise": 0.1}}
    cut = [{"time": 5, "cut": ["A1", "A2"]}]
    worst = [[float(at_target(law, seed=k, events=e)["tracking_error"].max()) for k in range(3)] for e in ([], cut)]
    assert max(worst[1]) < 1.5 * max(worst[0]), worst


def at_target(law: dict[str, Any], **fields: Any) -> xr.Dataset:
    fields = {"time": {"end": 12.0}, "controller": law, **fields}
    team = team_of({"A1": [0, 0], "A2": [0, 0]}, {"T1": [0, 0]}, "A1 A2, A1 T1, A2 T1", **fields)
    return simulate(load_scenario(team), "ideal")


def test_over_a_delay_longer_than_the_run_nothing_could_have_arrived() -> None:
    _, data = still({"all": {"delay": 5.0, "noise": 0.1, "hold": 1.0}}, end=0.1)
    assert np.isnan(data["delivery"].values).all()
    assert not data["heard"].values.any()


def test_samples_that_were_never_taken_do_not_arrive() -> None:
    """As of a world that was stepped without its law: what arrives is as old as its link makes it."""
    system = mixed_scenario(links={"all": {"delay": 0.03}}).system
    memory, heard = new_memory(system.law, 5), {}
    for n in [*range(10), *range(12, 20), *range(100, 106), 3, 4]:
        sample_law(system.control, n * H, system.initial, None, memory)
        heard[n] = memory.links.heard.tolist() == [2.0] * 5
    silent = {0, 1, 2, 13, 14, 100, 101, 102, 3, 4}
    assert {n for n, arrives in heard.items() if not arrives} == silent


@pytest.mark.parametrize("m", [pytest.param(4, marks=pytest.mark.slow), 6])
def test_every_number_of_an_edge_has_noise_of_its_own(m: int) -> None:
    rng = np.random.default_rng(m)
    maps = {"tail": rng.normal(size=(m, 2)).tolist(), "head": rng.normal(size=(m, 2)).tolist()}
    twice = [{"between": ["A1", "A2"], "map": maps, "parallel": True} for _ in range(2)]
    scenario, data = still({"communication": {"noise": 0.3}}, end=20.0, communication=twice, formations=[])
    team, x = scenario.team, positions_of(data)
    truth = np.hstack([measurement(team, edge, x) for edge in (*team.communication, *team.sensing)])[:, : 2 * m]
    error = data["measurement"].values[:, : 2 * m] - truth
    n = len(error)
    assert (np.abs(error.var(axis=0) / 0.09 - 1) < 5 * np.sqrt(2 / n)).all()
    assert np.abs(np.corrcoef(error.T) - np.eye(2 * m)).max() < 5 / np.sqrt(n)


# -- the same bits -----------------------------------------------------------------------------------------------------


def test_an_edge_keeps_its_numbers_whatever_else_there_is() -> None:
    scenario = tangled()
    fewer = tangled(communication=scenario.model_dump(mode="json", exclude_none=True)["communication"][1:])
    one, other = scenario.system.law.links.table, fewer.system.law.links.table
    np.testing.assert_array_equal(one["stream"][1:], other["stream"])
    assert len({tuple(s) for s in one["stream"].tolist()}) == 5
    assert (one["stream"][:, 0] >= 2**30).all()
    assert (one["stream"] < 2**31).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_links_that_do_nothing_change_no_bit(backend: str) -> None:
    nothing = {"noise": 0.0, "bias": 0.0, "delay": 0.0, "loss": 0.0, "hold": 1.0, "sensor": {"kind": "range_bearing"}}
    plain = mixed_scenario(time={"end": 0.2})
    idle = mixed_scenario(time={"end": 0.2}, links={"all": nothing, "sensing": {"loss": {**BURSTS, "loss_good": 0.0,
                                                                                        "loss_bad": 0.0}}})  # fmt: skip
    assert dataset_bytes(simulate(idle, backend)) == dataset_bytes(simulate(plain, backend))
    assert not idle.uses_seed("ideal")
    assert tangled().uses_seed("ideal")


@pytest.mark.long
def test_a_saved_run_says_what_was_delivered(tmp_path: Path) -> None:
    whole = simulate(tangled(time={"end": 0.3}), "ideal")
    outcome = mjsheaf.save(whole, tmp_path / "run", video=False)
    shares, kinds = whole["delivery"].values, whole["edge_kind"].values
    said = json.loads((tmp_path / "run" / "summary.json").read_text())["delivery"]
    edges = said.pop("edges")
    assert said == {kind: pytest.approx(shares[kinds == kind].mean()) for kind in ("communication", "sensing")}
    assert {kind: list(own.values()) for kind, own in edges.items()} == {
        kind: shares[kinds == kind].tolist() for kind in edges
    }
    assert not outcome.summary["theorem"]["applies"]
    assert not outcome.summary["held_law"]["bounded"]


# -- phases ------------------------------------------------------------------------------------------------------------


def changing(events: list[dict[str, Any]], **fields: Any) -> Scenario:
    """Boats and aircraft over delayed links, with events; fields replace fields."""
    links = {"all": {"delay": 0.05}, "record": True}
    return mixed_scenario(**({"time": {"end": 0.4}, "links": links, "events": events} | fields))


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_edge_of_a_later_phase_alone_is_delivered_and_recorded(backend: str) -> None:
    """An agent that has yet to join has no eta; then its edge receives after a delay, which is not a loss."""
    data = simulate(changing([{"time": 0.2, "join": "back"}]), backend)
    k = data["edge"].values.tolist().index("front-back")
    heard = data["heard"].values[:, data["measuring_edge"].values.tolist().index("communication front-back")]
    assert heard.tolist() == [0] * 25 + [2] * 16
    assert data.sizes["edge"] == 5
    assert data["delivery"].values[k] == 1.0
    rows = [str(row).startswith("communication front-back") for row in data["measured_number"].values]
    assert (np.isnan(data["measurement"].values[:, rows]).all(axis=1) == (heard == 0)).all()
    for name in ("disagreement_vector", "measured_disagreement_vector"):
        assert np.isnan(data[name].values[:20, 2]).all()
        assert np.isfinite(data[name].values[20:, 2]).all()
        assert np.isfinite(data[name].values[:, 1]).all()


@pytest.mark.parametrize("how", [{"cut": ["back", "diver"]}, {"lose": "back"}, {"lose": "diver"}], ids=str)
def test_nothing_from_before_arrives_over_a_link_that_is_back(how: dict[str, Any]) -> None:
    """Neither what was under way, nor what was held, nor a velocity from a difference over the gap."""
    back = {"restore": how["cut"]} if "cut" in how else {"join": how["lose"]}
    scenario = changing(
        [{"time": 0.2, **how}, {"time": 0.23, **back}],
        controller={"control_period": H, "feedforward": {"rounds": 2}},
        links={"all": {"delay": 0.05, "hold": 10.0, "noise": 0.1}, "record": True},
    )
    data = simulate(scenario, "ideal", allow_drift=True)
    heard = data["heard"].values[:, data["measuring_edge"].values.tolist().index("sensing back-diver")]
    assert heard.tolist() == [0] * 5 + [2] * 15 + [0] * 8 + [2] * 13
    for n, x, now, memory in walk(scenario.phases, 40):
        x += H * np.array([1.0, 0.5, 0.0])
        if n >= 23:
            rows = slice(*now.law.edges.first[len(now.team.communication) + 2 :][:2])
            assert (np.abs(memory.terms.rate[rows]).max() > 0.0) == (n > 28)


def test_a_term_that_begins_later_changes_nothing_of_what_is_heard() -> None:
    """Nor does odometry that begins with it say anything of how the agent moved before."""
    events = [{"time": 0.2, "set": {"controller.feedforward.rounds": 2}}]
    links = {"sensing": {"delay": 0.05, "loss": 0.3, "hold": 0.02}, "record": True}
    scenario, plain = (changing(e, links=links, controller={"control_period": H, "gain": 3.0}) for e in (events, []))
    data, alone = simulate(scenario, "ideal"), simulate(plain, "ideal")
    np.testing.assert_array_equal(data["heard"], alone["heard"])
    np.testing.assert_array_equal(data["measurement"][:21], alone["measurement"][:21])
    np.testing.assert_array_equal(data["measurement"].values[:25, -3:], alone["measurement"].values[:25, -3:])
    velocity, seen, rng = np.array([[0.5, -0.4, 1.0], [2.0, 1.0, 0.0]]), 0, np.random.default_rng(2)
    for n, x, now, memory in walk(scenario.phases, 80):
        for k, target in enumerate((1, 0)):
            begin, end = now.law.edges.first[2 + k : 4 + k]
            found = memory.terms.rate[begin:end]
            if found.any():
                np.testing.assert_allclose(found, velocity[target, : len(found)], rtol=0, atol=1e-9)
                assert n >= 26
                seen += 1
        x[:3] += rng.normal(0, 0.1, (3, 3)) * [[1, 1, 0], [1, 1, 1], [1, 1, 1]]
        x[3:] += velocity * H
    assert seen > 100


def test_one_who_comes_back_has_forgotten_where_the_team_goes() -> None:
    """While it is alone it has no v, and none is left when it comes back."""
    law = {"control_period": H, "feedforward": {"rounds": 3, "filter": 1.0}, "newton": {"rounds": 2}}
    scenario = changing([{"time": 0.2, "lose": "boat"}, {"time": 0.3, "join": "boat"}], controller=law, links={})
    moves, others_move = [], []
    for _, x, _, memory in walk(scenario.phases, 40):
        moves.append(bool(memory.terms.v[0].any()))
        others_move.append(bool(memory.terms.v[1:].any()))
        x[3:] += [0.04, 0.01, 0.0]
    assert moves == [False] + [True] * 19 + [False] * 10 + [True] * 10
    assert others_move == [False] + [True] * 39


def test_one_who_joins_faces_where_it_moves() -> None:
    """The same although no sensor needed its attitude until then."""
    sensing = [["boat", "ship"], ["front", "diver"], {"between": ["back", "diver"], "sensor": RANGE_BEARING}]
    scenario = changing([{"time": 0.2, "join": "back"}], sensing=sensing, links={"record": True}, seed=4)
    data = simulate(scenario, "ideal")
    body = attitudes(scenario, data)[2]
    kind, *_, edge, link = linked_edges(scenario.team, scenario.links)[4]
    line, y = Line(kind, edge, link, 4), measurement(scenario.team, edge, positions_of(data))
    for n in range(20, 41):
        found = data["measurement"].values[n, -3:]
        np.testing.assert_allclose(found, line.sense(n, y[n], body[n]), rtol=0, atol=1e-8)


def test_a_sensor_that_needs_attitudes_from_a_phase_on_begins_with_the_headings() -> None:
    """The agents rest: their measurements are those of a run that had the sensor from the start."""
    fields = team_of({"A": [3, 4, 5]}, {"T": [9, 1, 7]}, "A T", time={"end": 0.2})
    fields |= {"controller": {"gain": 1e-12, "control_period": 0.02}}
    fields["agents"][0]["heading"] = 70
    sensor = {"record": True, "sensing": {"sensor": RANGE_BEARING}}
    plain, measured = (load_scenario(fields | {"links": links}).system for links in ({"record": True}, sensor))
    pieces = list(stream([Phase(0, plain), Phase(5, measured)], "ideal", 0))
    after = np.concatenate([piece["measurement"].values for piece in pieces])[5:]
    whole = np.concatenate([piece["measurement"].values for piece in stream([Phase(0, measured)], "ideal", 0)])[5:]
    np.testing.assert_allclose(after, whole, rtol=0, atol=1e-9)


# -- what a file may say -----------------------------------------------------------------------------------------------


def test_the_finest_section_counts_field_by_field() -> None:
    links = Links.model_validate(
        {"all": {"noise": 0.3, "delay": 0.1, "loss": 0.5}, "sensing": {"noise": 0.2, "loss": BURSTS}}
    )
    found = links.resolve("sensing", Link(delay=0.0, range=5.0))
    assert (found.noise, found.delay, found.range, found.to_bad) == (0.2, 0.0, 5.0, 0.1)
    plain = links.resolve("communication")
    assert (plain.noise, plain.delay, plain.loss_good, plain.loss_bad) == (0.3, 0.1, 0.5, 0.5)
    assert not links.resolve("communication", Link(loss=0.0, noise=0.0, delay=0.0)).lossy
    other = Links.model_validate({"all": {"noise": 0.3}, "sensing": {"sensor": RANGE_BEARING}})
    assert other.resolve("sensing").noise == 0.0
    assert other.resolve("sensing", Link(sensor=Exact(), noise=0.1)).noise == 0.1


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"links.all.delay": 0.055}, ["links.all.delay: 0.055", "0.05 or 0.06"]),
        ({"links.sensing.loss": 1.2}, ["links.sensing.loss", "at most 1"]),
        ({"links.all.loss": {"kind": "gilbert_elliott", "to_bad": 2, "to_good": 0.1}}, ["loss.to_bad", "at most 1"]),
        ({"links.all.hold": -1}, ["links.all.hold", "at least 0"]),
        ({"links.all.lost": 0.1}, ["links.all.lost", "unknown field", "loss"]),
        ({"links.radio": {"loss": 0.1}}, ["links.radio", "communication"]),
        ({"links.all.noise": 0.1, "controller": {"control_period": 0}}, ["controller.control_period is 0", "positive"]),
        ({"links.all": {"noise": 1.0, "sensor": RANGE_BEARING}}, ["links.all", "noise", "range_noise"]),
        ({"links.all.sensor": RANGE_BEARING, "links.sensing.noise": 1.0}, ["links.sensing", "noise", "exact"]),
        ({"communication.3": {"between": ["A4", "A5"], "delay": 0.005}}, ["communication.3.delay", "0 or 0.01"]),
        ({"links.all.delay": 1e6, "links.all.noise": 1.0}, ["links", "delay lines", "shorter"]),
        ({"links.rounds.delay": 0.055}, ["links.rounds.delay: 0.055", "0.05 or 0.06"]),
        ({"links.rounds.noise": 0.1}, ["links.rounds.noise", "unknown field"]),
        ({"links.rounds.delay": 1e6}, ["links.rounds", "delay lines", "shorter"]),
    ],
)  # fmt: skip
def test_bad_links_are_one_line_that_names_the_field(fields: dict[str, Any], said: list[str]) -> None:
    with pytest.raises(InputError) as error:
        _ = load_scenario("paper", {"controller.newton.rounds": 2} | fields).system
    assert "\n" not in str(error.value)
    for words in said:
        assert words in str(error.value)


@pytest.mark.parametrize(
    ("maps", "fits"),
    [
        ("identity", True),
        ("local_frame", True),
        ({"tail": [[0, 1, 0], [-1, 0, 0]], "head": [[0, 1, 0], [-1, 0, 0]]}, True),
        ({"tail": [[0, 1, 0], [1, 0, 0]], "head": [[0, 1, 0], [1, 0, 0]]}, False),
        ({"tail": [[2, 0, 0], [0, 2, 0]], "head": [[2, 0, 0], [0, 2, 0]]}, False),
        ({"tail": [[1, 0, 0], [0, 1, 0]], "head": [[0, 1, 0], [-1, 0, 0]]}, False),
        ({"tail": [[0, 0, 1]], "head": [[0, 0, 1]]}, False),
    ],
)
def test_range_and_bearing_need_a_frame(maps: Any, fits: bool) -> None:
    edge = {"between": ["front", "back"], "map": maps, "sensor": RANGE_BEARING}
    scenario: Callable[[], Any] = lambda: mixed_scenario(communication=[["boat", "front"], edge]).system  # noqa: E731
    if fits:
        assert scenario().law.links.table["bearing"].tolist() == [1]
    else:
        with pytest.raises(InputError, match=r"communication\.1.*range_bearing.*F_tail = R P"):
            scenario()
