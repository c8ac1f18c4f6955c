"""Rounds over links: messages of feedforward and newton that are delayed, lost or out of range.

Oracles: one Python object per message line, and the iteration of each agent in numpy; dense solutions of H; the runs
over perfect links.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from mjsheaf import load_scenario, simulate
from mjsheaf.arrays import Array
from mjsheaf.law.law import evaluate_law, new_memory
from mjsheaf.noise import stream_of, uniforms
from mjsheaf.results.store import dataset_bytes
from mjsheaf.scenario import Scenario
from tests.builders import make_scenario, mixed_scenario, team_of
from tests.law.test_terms import ALL, MOVING, NEWTON, long_team, unlike_team
from tests.running import walk

BACKENDS = ("ideal", "physics")
BURSTS = {"kind": "gilbert_elliott", "to_bad": 0.2, "to_good": 0.3, "loss_good": 0.05, "loss_bad": 0.9}
BOTH = {"feedforward": {"rounds": 3}, "newton": {"rounds": 2}}
H = 0.01


def rounds(scenario: Scenario, **fields: Any) -> Scenario:
    raw = scenario.model_dump(mode="json", exclude_none=True)
    return make_scenario(raw | {"links": {**raw.get("links", {}), "rounds": fields}})


class Messages:
    def __init__(self, delay: int) -> None:
        self.delay = delay
        self.sent: dict[int, Array] = {}
        self.last: Array | None = None

    def receive(self, n: int) -> Array | None:
        self.last = self.sent.pop(n - self.delay, self.last)
        return self.last


class Oracle:
    """All agents' rounds in numpy, of a scenario's own fields."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self.team, link = scenario.team, scenario.links.rounds
        self.seed, self.delay = seed, round(link.delay / H) if link else 0
        loss = link.loss if link else 0.0
        chain = loss if not isinstance(loss, float) else None
        self.chain = (chain.to_bad, chain.to_good, chain.loss_good, chain.loss_bad) if chain else (0, 1, loss, loss)
        law = scenario.controller
        self.count = {"newton": law.newton.rounds if law.newton else 0}
        self.count["feedforward"] = law.feedforward.rounds if law.feedforward else 0
        self.bad: dict[int, bool] = {}
        edges = self.team.communication
        self.lines = {(t, id(e), end): Messages(self.delay) for t in self.count for e in edges for end in e.between}
        self.x = {t: [np.zeros(a.dimension) for a in self.team.agents] for t in self.count}

    def send(self, term: str, n: int, k: int, positions: Array) -> None:
        to_bad, to_good, good, bad = self.chain
        for e in self.team.communication:
            chance = uniforms(self.seed, stream_of("communication", e.tail, e.head, 0), n, 2**20 + k)
            if id(e) in self.bad:
                self.bad[id(e)] = chance[2] >= to_good if self.bad[id(e)] else chance[2] < to_bad
            else:
                self.bad[id(e)] = chance[2] < (to_bad / (to_bad + to_good) if to_bad else 0)
            i, j = self.team.index[e.tail], self.team.index[e.head]
            far = e.link is not None and np.linalg.norm(positions[i] - positions[j]) > (e.link.range or np.inf)
            for end, F, lot in ((e.tail, e.F_tail, chance[0]), (e.head, e.F_head, chance[1])):
                if not far and lot >= (bad if self.bad[id(e)] else good):
                    self.lines[term, id(e), end].sent[n] = F @ self.x[term][self.team.index[end]]

    def improve(self, term: str, n: int, b: Array) -> None:
        x = self.x[term]
        D = [np.zeros((len(own), len(own))) for own in x]
        right = [b[i, : len(own)].copy() for i, own in enumerate(x)]
        for e in (*self.team.communication, *self.team.sensing, *self.team.anchors):
            for end, F, other in ((e.tail, e.F_tail, e.head), (e.head, e.F_head, e.tail)):
                i = self.team.index.get(end, len(x))
                if i >= len(x):
                    continue
                D[i] += F.T @ e.weight @ F
                if (term, id(e), other) in self.lines:
                    z = self.lines[term, id(e), other].receive(n)
                    right[i] += F.T @ e.weight @ (F @ x[i] if z is None else z)
        for i in range(len(x)):
            x[i] = x[i] + 0.9 * np.linalg.pinv(D[i]) @ (right[i] - D[i] @ x[i])

    def sample(self, term: str, n: int, b: Array, positions: Array) -> list[Array]:
        first = 0 if term == "newton" else self.count["newton"]
        for k in range(first, first + (1 if self.delay else self.count[term])):
            if not self.delay:
                self.send(term, n, k, positions)
            self.improve(term, n, b)
            if self.delay:
                self.send(term, n, k, positions)
        return self.x[term]


LINKS = [{"delay": 0.03, "loss": 0.4}, {"loss": 0.3}, {"delay": 0.01}, {"delay": 0.02, "loss": BURSTS}, {}]


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("link", LINKS, ids=str)
def test_rounds_are_what_each_agent_makes_of_what_it_was_sent(link: dict[str, Any]) -> None:
    edges = [{"between": ["boat", "front"], "range": 7.0}, ["front", "back"]]
    scenario = rounds(mixed_scenario(controller={"control_period": H, **BOTH}, communication=edges, seed=8), **link)
    oracle, rng = Oracle(scenario, 8), np.random.default_rng(4)
    dimension = np.array([m.dimension for m in scenario.team.members])
    for n, x, _, memory in walk(scenario.system, 60):
        for i, own in enumerate(oracle.sample("newton", n, -memory.residual[:3], x)):
            np.testing.assert_allclose(memory.terms.delta[i, : len(own)], own, rtol=0, atol=1e-9)
        for i, own in enumerate(oracle.sample("feedforward", n, memory.terms.right[:3], x) if n > 0 else ()):
            np.testing.assert_allclose(memory.terms.v[i, : len(own)], own, rtol=1e-9, atol=1e-7)
        x += 0.1 * rng.normal(0, 1, x.shape) * (np.arange(3) < dimension[:, None])
    assert scenario.system.law.terms.rounds.imperfect


def frustrated(**controller: Any) -> Scenario:
    """Three agents in a ring whose maps change sign once: Jacobi's iteration has the eigenvalue -1 and would ring."""
    flip = {"tail": [[1.0, 0.0], [0.0, 1.0]], "head": [[-1.0, 0.0], [0.0, -1.0]]}
    ring = [{"between": pair, "map": flip} for pair in (["A0", "A1"], ["A1", "A2"], ["A2", "A0"])]
    places = {f"A{k}": [k, 1.0 - k] for k in range(3)}
    controller = {"control_period": H, **controller}
    return make_scenario(team_of(places, {"T": [4, 4]}, communication=ring, controller=controller))


TEAMS: dict[str, Callable[[], Scenario]] = {
    "paper": lambda: load_scenario("paper", {"controller.newton.rounds": 3}),
    "long": lambda: long_team(1, **NEWTON),
    "frustrated": lambda: frustrated(**NEWTON),
    **{f"unlike {seed}": partial(unlike_team, seed, **NEWTON) for seed in range(2)},
}


@pytest.mark.long
@pytest.mark.parametrize("make", TEAMS.values(), ids=TEAMS)
@pytest.mark.parametrize(
    "link", [{"delay": 0.01}, {"delay": 0.07, "loss": 0.3}, {"loss": 0.8}, {"delay": 0.02, "loss": BURSTS}], ids=str
)
def test_the_fixed_point_is_the_same(make: Callable[[], Scenario], link: dict[str, Any]) -> None:
    """Under any delay and losses delta of a team at rest becomes -H^-1 eta, as soon as `settling` says.

    But for eigenvalues of Jacobi's iteration near -1 that have none of the same size near 1: it knows nothing of them.
    """
    scenario = rounds(make(), **link)
    system, team = scenario.system, scenario.team
    terms = system.law.terms
    share = terms.rounds.settling(terms.newton, terms.eigenvalues[0])
    T = int(min(20.0 / share, 60_000)) * (10 if not team.sensing else 1)
    memory, x = new_memory(system.law, len(system.initial)), system.initial
    n_q = team.dirichlet.H.shape[0]
    error, exact = [], np.zeros(n_q)
    for n in range(T):
        evaluate_law(system.control, n * H, x, None, memory)
        if n == 0:
            exact = np.linalg.solve(team.dirichlet.H.toarray(), -team.pack(memory.residual)[:n_q])
        error.append(np.abs(team.pack(memory.terms.delta)[:n_q] - exact).max())
    assert error[0] > 0.01 * np.abs(exact).max() > 0.0
    assert error[-1] < 1e-3 * error[0]


@pytest.mark.parametrize("backend", ["ideal", pytest.param("physics", marks=pytest.mark.slow)])
def test_without_delay_and_losses_no_bit_changes(backend: str) -> None:
    """And a link that loses measurements loses no rounds, nor do rounds matter to the paper's law."""
    fields: dict[str, Any] = {"time": {"end": 0.2}, "targets": MOVING, "seed": 3}
    plain = mixed_scenario(controller={"control_period": H, **ALL}, **fields)
    assert dataset_bytes(simulate(rounds(plain, delay=0.0, loss=0.0), backend)) == dataset_bytes(
        simulate(plain, backend)
    )
    assert not rounds(plain, delay=0.0).uses_seed("ideal")
    assert rounds(plain, loss=0.1).uses_seed("ideal")
    lossy = mixed_scenario(
        controller={"control_period": H, **ALL}, links={"all": {"loss": 0.5, "delay": 0.02}}, **fields
    )
    assert not lossy.system.law.terms.rounds.imperfect
    paper = mixed_scenario(controller={"control_period": H}, **fields)
    assert dataset_bytes(simulate(rounds(paper, delay=0.05, loss=0.5), backend)) == dataset_bytes(
        simulate(paper, backend)
    )


@pytest.mark.slow
def test_nothing_from_before_arrives_over_a_restored_link() -> None:
    """Messages in transit when a link is cut are lost, and neighbours' last numbers are those of the present phase."""
    cut = [{"time": 0.1, "cut": ["boat", "front"]}, {"time": 0.13, "restore": ["boat", "front"]}]
    scenario = rounds(mixed_scenario(controller={"control_period": H, **BOTH}, events=cut), delay=0.05)
    for n, _, _, memory in walk(scenario.phases, 19):
        sent = (memory.terms.rounds.arrived[0, 0] > 0.0).tolist()  # of newton, by tails
        stays = n >= 5
        assert sent == ([stays] if 10 <= n < 13 else [stays if n < 10 else n >= 18, stays])


@pytest.mark.long
def test_traffic_is_one_round_a_term_and_period_under_a_delay() -> None:
    scenario = load_scenario(
        "paper", {"time.end": 0.2, "controller.feedforward.rounds": 3, "controller.newton.rounds": 2}
    )
    sent = [
        simulate(rounds(scenario, **link), "ideal").attrs["exchange_rounds"]
        for link in ({}, {"loss": 0.5}, {"delay": 0.01}, {"delay": 0.1, "loss": 0.1})
    ]
    assert sent == [5 * 20, 5 * 20, 2 * 20, 2 * 20]


@pytest.mark.slow
def test_rounds_over_no_edge_at_all(in_python: None) -> None:
    """All links are cut: H is 0, no agent receives messages, and all stay."""
    controller = {"control_period": 0.02, "feedforward": {"rounds": 2}, "newton": {"rounds": 2}}
    rest = {"links": {"rounds": {"delay": 0.02, "loss": 0.3}}, "events": [{"time": 0.1, "cut": ["A1", "T1"]}]}
    fields = {"time": {"end": 0.2}, "controller": controller, **rest}
    scenario = load_scenario(team_of({"A1": [0, 0]}, {"T1": [2, 0]}, "A1 T1", **fields))
    data = simulate(scenario, "ideal", allow_drift=True)
    assert np.isfinite(data["velocity_command"].values[..., :2]).all()
    assert not data["velocity_command"].values[5:, 0, :2].any()
