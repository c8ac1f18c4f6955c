"""The terms of the law beyond the paper's.

Oracles: one Python object per agent, which is handed its own edges, its own displacement and what its neighbours send;
the textbook form of Chebyshev's iteration; distances in the graph; dense solutions of H; the runs without terms.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from typing import Any

import networkx as nx
import numpy as np
import pytest
import xarray as xr

from mjsheaf import World, load_scenario, simulate
from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.law.in_python import Agent, Controller, LocalSample, PerAgent
from mjsheaf.law.law import ControlArrays, Memory, evaluate_law, new_memory
from mjsheaf.law.terms import contraction, solve
from mjsheaf.loop.session import Session
from mjsheaf.loop.system import Phase, System, phases_of
from mjsheaf.runs.simulate import stream
from mjsheaf.scenario import Scenario
from mjsheaf.team import Edge, Team
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import make_scenario, mixed_scenario, positions_of, pursuit, random_scenario

BACKENDS = ("ideal", "physics")
FEEDFORWARD: dict[str, Any] = {"feedforward": {"rounds": 3}}
NEWTON: dict[str, Any] = {"newton": {"rounds": 2}}
DRIFT: dict[str, Any] = {"drift": {"filter": 0.1}}
INTEGRAL: dict[str, Any] = {"integral": {"gain": 0.5, "limit": 0.3}}
LED: dict[str, Any] = {"feedforward": {"rounds": 2, "filter": 0.03, "extrapolate": True}}
EACH: list[dict[str, Any]] = [FEEDFORWARD, NEWTON, DRIFT, INTEGRAL, LED]
MOVING: list[dict[str, Any]] = [
    {
        "id": "diver",
        "position": [1, 1, -2],
        "motion": {"kind": "lissajous", "amplitude": [2, 1, 1], "rate": [1, 2, 1], "phase": [1.5, 0, 0]},
    },
    {"id": "ship", "position": [-3, 2], "motion": {"kind": "waypoints", "points": [[0, 5], [5, 5]], "speed": 4.0}},
]
ALL: dict[str, Any] = LED | NEWTON | DRIFT | INTEGRAL


# -- local form --------------------------------------------------------------------------------------------------------


@dataclass
class Local:
    """One agent's law, in its own coordinates, from its own edges, its own displacement and received messages.

    Attributes:
        agent: Id of the agent.
        law: Field `controller` of the scenario.
        targets: Ids of targets.
        bounds: Bounds on the eigenvalues of H by time, s.
        lead: Lead of feedforward, in samples, once rounds have reduced the residual to a thousandth.
        limit: Largest speed, m/s.
    """

    agent: Agent
    law: Any
    targets: set[str]
    bounds: Callable[[float], tuple[float, float]]
    lead: float
    limit: float
    edges: tuple[Edge, ...] = ()
    samples: int = 0
    same: int = 0  # samples with these edges
    known: dict[Any, tuple[Array, Array, int]] = field(default_factory=dict)  # y, velocity and age by edge

    def __post_init__(self) -> None:
        n = self.agent.dimension
        self.command, self.delta, self.v, self.drift, self.z = np.zeros((5, n))

    def names(self) -> list[Any]:
        """By which edges are known again in another phase."""
        plain = [(e.tail, e.head, e.F_tail.tobytes(), e.F_head.tobytes()) for e in self.edges]
        return [(name, plain[:k].count(name)) for k, name in enumerate(plain)]

    def sense(self, local: LocalSample, moved: Array) -> Array:
        """B p' of the targets that this agent senses; one of which it knows nothing yet moves as v says."""
        h, measured = self.law.control_period, np.zeros(len(moved))
        for name, e, y in zip(self.names(), self.edges, local.measurements, strict=True):
            if e.head not in self.targets:
                continue
            velocity = e.F_tail @ self.v
            if name in self.known:
                earlier, rate, age = self.known[name]
                share = filtered(h, self.law.feedforward.filter) if age > 1 else 1.0
                velocity = rate + share * ((y - earlier + e.F_tail @ moved) / h - rate)
                self.known[name] = earlier, velocity, age
            measured += e.F_tail.T @ e.weight @ velocity
        return measured

    def remember(self, local: LocalSample) -> None:
        """Keep what the next sample compares with, of the present edges alone."""
        nothing = (np.zeros(0), 0.0, 0)
        named = zip(self.names(), local.measurements, strict=True)
        before = {name: (y, *self.known.get(name, nothing)[1:]) for name, y in named}
        self.known = {name: (y, rate + np.zeros(len(y)), age + 1) for name, (y, rate, age) in before.items()}

    def own(self, e: Edge) -> tuple[Array, Array, str]:
        """F of this agent on an edge, F of the other end, and who that is."""
        return (e.F_tail, e.F_head, e.head) if e.tail == self.agent.id else (e.F_head, e.F_tail, e.tail)

    def row_of_h(self, x: Array, received: dict[str, Array]) -> Array:
        """(H x)_i: on each edge F_i^T K (F_i x_i - F_j x_j), where x_j of targets and of the ground is zero."""
        out = np.zeros(len(x))
        for e in self.edges:
            F, G, other = self.own(e)
            theirs = G @ received[other][: G.shape[1]] if other in received else 0.0
            out += F.T @ e.weight @ (F @ x - theirs)
        return out

    def rounds(self, x: Array, b: Array, count: int) -> Generator[Array, dict[str, Array], Array]:
        """Chebyshev's iteration as in Saad, algorithm 12.1; Richardson's where the interval is a point."""
        low, high = self.bounds(self.time)
        theta, delta = (high + low) / 2, (high - low) / 2
        rho = delta / theta
        for k in range(count):
            r = b - self.row_of_h(x, (yield np.pad(x, (0, 3 - len(x)))))
            if k == 0 or delta == 0.0:
                d = r / theta
            else:
                after = 1.0 / (2.0 * theta / delta - rho)
                d = after * rho * d + 2.0 * after / delta * r
                rho = after
            x = x + d
        return x

    def __call__(self, t: float, local: LocalSample) -> Generator[Array, dict[str, Array], Array]:
        law, h, n = self.law, self.law.control_period, self.agent.dimension
        self.time = t
        if local.edges is not self.edges:
            names, self.edges = self.names(), local.edges
            self.same *= names == self.names()
        moved = local.displacement[:n] + law.odometry.bias * h * (self.samples > 0)
        eta = np.zeros(n)
        for e, y in zip(self.edges, local.measurements, strict=True):
            F, _, _ = self.own(e)
            eta += (-1.0 if e.tail == self.agent.id else 1.0) * F.T @ e.weight @ (y + e.b)
        wanted = -law.gain * eta
        if law.newton:
            self.delta = yield from self.rounds(self.delta, -eta, law.newton.rounds)
            wanted = law.gain * self.delta
        if law.feedforward:
            before = self.v
            if self.samples > 0:
                self.v = yield from self.rounds(self.v, self.sense(local, moved), law.feedforward.rounds)
            settled = contraction(law.feedforward.rounds, *self.bounds(t)) ** (self.same - 1) < 1e-3
            wanted = wanted + self.v + self.lead * settled * (self.v - before)
        if law.drift and self.samples > 0:
            share = 1.0 if self.samples == 1 else filtered(h, law.drift.filter)
            self.drift = self.drift + share * (moved / h - self.command - self.drift)
            wanted = wanted - self.drift
        if law.integral:
            wanted = wanted - law.integral.gain * self.z
        self.command = shortened(wanted, self.limit)
        if law.integral and np.linalg.norm(wanted) <= self.limit:
            self.z = shortened(self.z + h * eta, law.integral.limit / law.integral.gain)
        self.remember(local)
        self.samples, self.same = self.samples + 1, self.same + 1
        return self.command


def filtered(period: float, time_constant: float) -> float:
    return 1.0 - np.exp(-period / time_constant) if time_constant else 1.0


def shortened(x: Array, most: float) -> Array:
    size = np.linalg.norm(x)
    return x * most / size if size > most else x


def agentwise(
    scenario: Scenario, backend: str, bounds: Callable[[float], tuple[float, float]] | None = None
) -> Controller:
    """The scenario's law in local form, with bounds on the eigenvalues of H by time, s; the team's by default."""
    law, team = scenario.controller, scenario.team
    within = bounds or (lambda t: team.dirichlet.eigenvalues)

    def make(agent: Agent) -> Local:
        i = team.agent_ids.index(agent.id)
        lead = float(bool(law.feedforward and law.feedforward.extrapolate))
        if backend == "physics":
            names = scenario.vehicles.names(scenario.agents, scenario.targets)
            own = load_vehicle(names[i]).with_time_constant(scenario.vehicles.tau)
            lead *= 1.0 + own.reduced_model().tau[0] / law.control_period
        limit = scenario.agents[i].velocity_limit or law.velocity_limit or np.inf
        return Local(agent, law, set(team.target_ids), within, lead, limit)

    return Controller(PerAgent(make))


def unlike_team(seed: int, **controller: Any) -> Scenario:
    """A random team: dimensions, maps, anchors and flow as of `random_scenario`, and inner products on edges."""
    fields, rng = random_scenario(seed), np.random.default_rng(seed)
    for e in fields["communication"] + fields["sensing"]:
        if isinstance(e["map"], dict):
            root = 0.3 * rng.standard_normal((len(e["map"]["tail"]),) * 2)
            e["weight"] = (np.eye(len(root)) + root @ root.T).tolist()
    fields["time"] = {"end": 0.6}
    fields["controller"] = {"gain": 1.0, "control_period": 0.01, **controller}
    return make_scenario(fields)


def assert_alike(scenario: Scenario, backend: str, tolerance: float = 1e-10) -> None:
    """The scenario's own law and its local form make the same run, and say alike what they send."""
    ours = simulate(scenario, backend)
    theirs = simulate(scenario, backend, controller=agentwise(scenario, backend))
    for name in ("agent_position", "velocity_command"):
        scale = 1.0 + np.abs(np.nan_to_num(ours[name].values)).max()
        np.testing.assert_allclose(theirs[name].values, ours[name].values, rtol=0, atol=tolerance * scale)
    law = scenario.controller
    silent = law.feedforward.rounds if law.feedforward else 0  # before it has two samples
    assert theirs.attrs["exchange_rounds"] == ours.attrs["exchange_rounds"] - silent
    plain = simulate(edited(scenario, {"feedforward": None, "newton": None, "drift": None, "integral": None}), backend)
    assert np.nanmax(np.abs(plain["agent_position"] - ours["agent_position"])) > 1e-4  # the terms matter


def edited(scenario: Scenario, controller: dict[str, Any]) -> Scenario:
    fields = scenario.model_dump(mode="json", exclude_none=True)
    fields["controller"] = {k: v for k, v in {**fields["controller"], **controller}.items() if v is not None}
    return make_scenario(fields)


FORMS = [("ideal", terms) for terms in (*EACH, ALL, FEEDFORWARD | NEWTON)]
FORMS += [("physics", terms) for terms in (*EACH[:2], INTEGRAL, LED | NEWTON | INTEGRAL)]


@pytest.mark.parametrize(
    ("backend", "terms"), FORMS, ids=lambda form: "+".join(form) if isinstance(form, dict) else form
)
def test_local_form(backend: str, terms: dict[str, Any]) -> None:
    controller = {"gain": 3.0, "control_period": 0.01, **terms}
    if backend == "ideal":
        scenario = mixed_scenario(controller=controller | {"odometry": {"bias": 0.02}}, targets=MOVING)
    else:
        scenario = mixed_scenario(controller=controller, time={"end": 0.5}, vehicles={"tau": 0.05})
    assert_alike(scenario, backend)


RANDOM: list[Any] = [("ideal", seed, ALL) for seed in range(6)] + [("physics", 3, LED | NEWTON | INTEGRAL)]


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(("backend", "seed", "terms"), RANDOM)
def test_local_form_of_random_teams(backend: str, seed: int, terms: dict[str, Any]) -> None:
    assert_alike(unlike_team(seed, **terms), backend, 1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_local_form_where_commands_are_limited(backend: str) -> None:
    """An agent with a clipped command does not integrate, and drift is the velocity beyond the limited command."""
    terms = ALL if backend == "ideal" else LED | NEWTON | INTEGRAL
    controller = {"gain": 8.0, "control_period": 0.01, "velocity_limit": 9.0, **terms}
    scenario = mixed_scenario(time={"end": 1.0}, controller=controller)
    assert_alike(scenario, backend)
    speed = np.linalg.norm(np.nan_to_num(simulate(scenario, backend)["velocity_command"].values), axis=2)
    assert 0.05 < np.mean(speed > 8.9999) < 0.95
    assert speed.max() <= 9.0 + 1e-12


def with_other_edges(scenario: Scenario) -> System:
    raw = scenario.model_dump(mode="json", exclude_none=True)
    raw["communication"] = [["boat", "back"], {"between": ["back", "front"], "weight": 2.0}]
    raw["sensing"] = [["boat", "ship"], ["front", "diver"]]
    other = make_scenario(raw)
    return replace(scenario.system, team=other.team, law=other.system.law)


@pytest.mark.parametrize("backend", BACKENDS)
def test_phases_with_other_edges_keep_what_agents_know(backend: str) -> None:
    """Velocities of targets continue edge by edge, drift and integral too; bounds on H are those of the phase."""
    terms = ALL if backend == "ideal" else LED | NEWTON | INTEGRAL
    scenario = mixed_scenario(time={"end": 0.6}, controller={"gain": 5.0, "control_period": 0.01, **terms})
    other = with_other_edges(scenario)
    run = phases_of([Phase(0, scenario.system), Phase(25, other), Phase(40, scenario.system)])
    each = [phase.system.law.terms.eigenvalues for phase in run]
    assert each == [phase.system.team.dirichlet.eigenvalues for phase in run]
    assert run[0].system is run[2].system
    assert each[0] != each[1]

    def bounds(t: float) -> tuple[float, float]:
        return each[int(np.searchsorted([25, 40], round(t / 0.01), side="right"))]

    ours = list(stream(run, backend, 0))
    theirs = list(stream(run, backend, 0, controller=agentwise(scenario, backend, bounds)))
    assert len(ours) == 3
    for one, two in zip(ours, theirs, strict=True):
        for name in ("agent_position", "velocity_command"):
            np.testing.assert_allclose(two[name].values, one[name].values, rtol=0, atol=1e-9)
    assert ours[2].attrs["exchange_rounds"] == 61 * 4


@pytest.mark.parametrize("backend", BACKENDS)
def test_phases_with_and_without_terms(backend: str) -> None:
    """Terms that begin with a phase begin as in a run that starts there; those that end leave nothing behind."""
    law = {"gain": 5.0, "control_period": 0.01}
    with_terms, paper = (mixed_scenario(time={"end": 0.4}, controller=law | terms).system for terms in (ALL, {}))
    first, second, third = stream([Phase(0, paper), Phase(10, with_terms), Phase(30, paper)], backend, 0)
    plain = simulate(mixed_scenario(time={"end": 0.4}, controller=law), backend)
    np.testing.assert_array_equal(first["agent_position"], plain["agent_position"][:10])
    for data in (first, third):
        eta, asked = (np.nan_to_num(data[name].values) for name in ("disagreement_vector", "velocity_command"))
        np.testing.assert_array_equal(asked, -5.0 * eta)
    asked = np.nan_to_num(second["velocity_command"].values[0])
    np.testing.assert_array_equal(asked, commands_at(with_terms.control, positions_of(second)[:1])[0])
    assert second.attrs["exchange_rounds"] == 20 * 4


# -- flow of information -----------------------------------------------------------------------------------------------


def long_team(seed: int, **controller: Any) -> Scenario:
    """Ten agents of either dimension on a random tree with two links more, and two targets."""
    rng = np.random.default_rng(seed)
    agents = [{"id": f"A{k}", "position": rng.uniform(-9, 9, 2 + k % 2).tolist()} for k in range(10)]
    links = [[f"A{max(0, k - int(rng.integers(1, 3)))}", f"A{k}"] for k in range(1, 10)]
    links += [e for e in (["A2", "A5"], ["A6", "A9"]) if e not in links]
    return make_scenario(
        {
            "agents": agents,
            "targets": [{"id": f"T{k}", "position": rng.uniform(-9, 9, 3).tolist()} for k in range(2)],
            "communication": [{"between": e, "weight": float(rng.uniform(0.5, 2))} for e in links],
            "sensing": [["A1", "T0"], ["A8", "T1"]],
            "anchors": [{"agent": f"A{k}", "axes": ["z"], "value": [1.0]} for k in range(1, 10, 2)],
            "controller": {"gain": 2.0, "control_period": 0.01, **controller},
        }
    )


def distances(team: Team, source: str) -> Array:
    """Return the number of edges from a vehicle to each agent, over agents alone, shape (N,)."""
    own = [e.between for e in team.sensing if source in e.between]
    found = nx.single_source_shortest_path_length(nx.Graph([*own, *(e.between for e in team.communication)]), source)
    return np.array([found[a] for a in team.agent_ids])


def commands_at(control: ControlArrays, path: Array, memory: Memory | None = None) -> Array:
    """The agents' commands of samples at positions (T, V, 3), whatever the commands do, shape (T, N, 3)."""
    memory = memory or new_memory(control.law, path.shape[1])
    made = []
    for k, x in enumerate(path):
        evaluate_law(control, 0.01 * k, x, None, memory)
        made.append(memory.command[: control.law.terms.agents].copy())
    return np.array(made)


@pytest.mark.parametrize("shift", [1.0, np.nan], ids=["elsewhere", "not a number"])
@pytest.mark.parametrize("rounds", [1, 2, 3])
@pytest.mark.parametrize("term", ["feedforward", "newton", "both"])
def test_each_round_carries_news_one_edge_on_and_no_farther(term: str, rounds: int, shift: float) -> None:
    """A vehicle is moved in one sample alone. This reaches an agent at the distance d, and only then do bits change,
    in the sample j later with d <= (j + 1) rounds: its measurement is the first edge, and the first round is spent
    on its own data; but the rounds begin with the result of the sample before. Feedforward depends on
    targets; how an agent itself moved cancels up to rounding.
    """
    names = ("feedforward", "newton") if term == "both" else (term,)
    scenario = long_team(rounds, **{name: {"rounds": rounds} for name in names})
    team, control = scenario.team, scenario.system.control
    rng = np.random.default_rng(0)
    path = scenario.system.initial + np.cumsum(0.1 * rng.standard_normal((6, 12, 3)), axis=0)
    path[:, [m.dimension == 2 for m in team.members], 2] = 0.0
    plain = commands_at(control, path)
    for v, member in enumerate(team.members):
        moved = path.copy()
        moved[2, v, : member.dimension] += shift
        d = distances(team, member.id)
        changed = (commands_at(control, moved) != plain).any(axis=2)
        assert not changed[:2].any()
        for j in range(4):
            heard = d <= max(1 - j, (j + 1) * rounds)
            if term == "feedforward" and member.id not in team.target_ids:
                assert not (changed[2 + j] & ~heard).any()
            else:
                np.testing.assert_array_equal(changed[2 + j], heard, err_msg=f"{member.id} after {j}")


@pytest.mark.parametrize("terms", [DRIFT, INTEGRAL, DRIFT | INTEGRAL], ids=lambda terms: "+".join(terms))
def test_drift_and_integral_are_an_agents_own(terms: dict[str, Any]) -> None:
    """Without a measurement of a vehicle an agent receives nothing about it."""
    scenario = long_team(4, **terms)
    team, control = scenario.team, scenario.system.control
    path = np.repeat(scenario.system.initial[None], 8, axis=0)
    plain = commands_at(control, path)
    for v, member in enumerate(team.members):
        moved = path.copy()
        moved[2, v] = np.nan
        near = distances(team, member.id) <= 1
        commands = commands_at(control, moved)
        np.testing.assert_array_equal(commands[:, ~near], plain[:, ~near])
        assert np.isnan(commands[2:, near]).any(axis=2).all()


# -- the paper's law ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_terms_that_add_nothing_leave_the_papers_law_to_the_bit(backend: str) -> None:
    """An integral whose largest correction is 1e-300 m/s, added to the law: every number is the same."""
    end = 2.0 if backend == "ideal" else 0.3
    paper = load_scenario("paper", {"time.end": end})
    neutral = load_scenario("paper", {"time.end": end, "controller.integral": {"gain": 1.0, "limit": 1e-300}})
    assert neutral.system.law.terms.agents == 13
    one, other = simulate(paper, backend), simulate(neutral, backend)
    xr.testing.assert_equal(one, other)
    assert [r.attrs[k] for r in (one, other) for k in ("exchange_rounds", "numbers_sent")] == [0] * 4


def test_terms_want_a_control_period() -> None:
    for terms in EACH:
        with pytest.raises(InputError, match="control_period is 0"):
            make_scenario({**random_scenario(0), "controller": {"control_period": 0, **terms}})


# -- rounds ------------------------------------------------------------------------------------------------------------


def rounds_on(system: System, rounds: int, b: Array, x: Array) -> Array:
    """x after rounds on H x = b, as vectors of H's coordinates."""
    team, V = system.team, len(system.team.members)
    n = len(b)
    everything = new_memory(system.law, V)
    padded = [team.unpack(np.concatenate([values, np.zeros(team.sheaf.shape[1] - n)])) for values in (b, x)]
    solve(system.law.edges, system.law.terms, rounds, padded[0], everything.y, padded[1], everything.terms)
    return team.pack(padded[1])[:n]


TEAMS: list[Any] = [lambda: load_scenario("paper", {"controller.newton.rounds": 3}), lambda: long_team(1, **NEWTON)]
TEAMS += [lambda seed=seed: unlike_team(seed, **NEWTON) for seed in range(5)]


@pytest.mark.parametrize("make", TEAMS)
def test_rounds_contract_as_chebyshevs_polynomial_does(make: Any) -> None:
    """By 1 / T_r((kappa + 1) / (kappa - 1)) in the 2-norm at most, and by just that at both ends of the spectrum."""
    system = make().system
    H = system.team.dirichlet.H.toarray()
    values, vectors = np.linalg.eigh(H)
    kappa = values[-1] / values[0]
    rng = np.random.default_rng(0)
    for r in (1, 2, 3, 7):
        T = np.polynomial.chebyshev.chebval((kappa + 1) / (kappa - 1), [0] * r + [1]) if kappa > 1 + 1e-9 else np.inf
        assert contraction(r, values[0], values[-1]) == pytest.approx(1.0 / T, rel=1e-9)
        for _ in range(5):
            exact, start = rng.standard_normal((2, len(H)))
            left = np.linalg.norm(rounds_on(system, r, H @ exact, start) - exact)
            assert left <= (1.0 / T + 1e-9) * np.linalg.norm(start - exact)
        for end in (0, -1):
            left = rounds_on(system, r, H @ exact, exact + vectors[:, end]) - exact
            np.testing.assert_allclose(abs(left @ vectors[:, end]), 1.0 / T, rtol=1e-6, atol=1e-10)
            np.testing.assert_allclose(np.linalg.norm(left), 1.0 / T, rtol=1e-6, atol=1e-10)


def test_published_contraction() -> None:
    bounds = load_scenario("paper").team.dirichlet.eigenvalues
    found = [contraction(r, *bounds) for r in (1, 3, 5, 10)]
    np.testing.assert_allclose(found, [0.868, 0.377, 0.131, 0.0087], rtol=5e-3)
    assert contraction(0, *bounds) == 1.0
    assert contraction(1000, *bounds) < 1e-100


@pytest.mark.parametrize("weight", [1.0, 4.0])
def test_one_agent_alone_needs_one_round(weight: float) -> None:
    """H is a multiple of I, so that its eigenvalues are one number; by Newton the error decays at k1."""
    controller = {"gain": 10.0, "control_period": 0.01, "newton": {"rounds": 1}, **FEEDFORWARD}
    seen = [{"between": ["A", "T"], "weight": weight}]
    scenario = pursuit([5, 1], [0, 0], sensing=seen, time={"end": 0.5}, controller=controller)
    assert contraction(1, weight, weight) == 0.0
    error = simulate(scenario, "ideal")["tracking_error"].values[:, 0]
    np.testing.assert_allclose(error[1:] / error[:-1], 0.9, rtol=1e-12)


def test_an_agent_that_nobody_hears_and_that_hears_nobody() -> None:
    controller = {"gain": 10.0, "control_period": 0.01, **ALL}
    scenario = pursuit([5, 1], [0, 0], sensing=[], time={"end": 0.1}, controller=controller)
    data = simulate(scenario, "ideal", allow_drift=True)
    np.testing.assert_array_equal(data["agent_position"].values[..., :2], np.full((11, 1, 2), [5.0, 1.0]))


def test_free_directions_stay_where_they_are() -> None:
    """Agents that are free along z: the terms are zero there, and the other axes are tracked as before."""
    scenario = edited(load_scenario("air_tracks_surface", {"time.end": 3.0}), FEEDFORWARD | NEWTON)
    free = scenario.team.dirichlet.null_basis
    assert free.shape[1] == 1
    data = simulate(scenario, "ideal", allow_drift=True)
    commands = np.nan_to_num(data["velocity_command"].values)
    asked = scenario.team.pack(np.pad(commands, ((0, 0), (0, len(scenario.team.targets)), (0, 0))))[:, : len(free)]
    assert np.abs(asked @ free).max() < 1e-12 * np.abs(asked).max()
    assert data["disagreement"][-1].max() < 0.1 * data["disagreement"][0].max()


# -- odometry ----------------------------------------------------------------------------------------------------------


def still_scenario(**fields: Any) -> Scenario:
    """The published team about targets at rest in a constant current."""
    raw = load_scenario("paper").model_dump(mode="json", exclude_none=True)
    for name in ("target_motion", "target_formation", "target_edges", "expect"):
        raw.pop(name)
    raw |= {"time": {"end": 60.0}, "flow": {"agents": {"dimension": 2, "drift": [0.4, -0.3]}}, **fields}
    return make_scenario(raw)


def steady_error(terms: dict[str, Any], bias: float) -> tuple[Array, System]:
    """q* - q at the end, in H's coordinates, of a team at rest whose odometry drifts."""
    law = {"gain": 10.0, "control_period": 0.01, "odometry": {"bias": bias}}
    scenario = still_scenario(controller=law | terms)
    data = simulate(scenario, "ideal")
    e = (data["harmonic_extension"] - data["agent_position"]).values[-1][:, :2].ravel()
    return e, scenario.system


def test_a_bias_of_odometry_leaves_the_error_that_it_must() -> None:
    """Drift takes off b too much: k1 H e = b. Feedforward thinks that targets move: k1 H e = -v with H v = S b, where
    S is the share of sensing edges in H.
    """
    b = 0.03
    e, system = steady_error(DRIFT, b)
    H, B = system.team.dirichlet.H.toarray(), system.team.dirichlet.B.toarray()
    np.testing.assert_allclose(e, np.linalg.solve(H, np.full(26, b)) / 10.0, rtol=1e-5)
    e, _ = steady_error(FEEDFORWARD | {"integral": {"gain": 5.0}}, b)
    assert np.abs(e).max() < 1e-6  # an integral takes that away too
    e, _ = steady_error(FEEDFORWARD, b)
    sensed = np.diag(np.abs(B).sum(axis=1))  # of identity maps and weights
    v = np.linalg.solve(H, sensed @ np.full(26, b))
    carried = np.tile([0.4, -0.3], 13)
    np.testing.assert_allclose(e, -np.linalg.solve(H, v + carried) / 10.0, rtol=1e-5)


def test_noise_of_odometry_has_the_stated_size() -> None:
    drawing = [mixed_scenario(controller={"odometry": {"noise": 1.0}, **terms}) for terms in (DRIFT, NEWTON)]
    assert [scenario.uses_seed("ideal") for scenario in drawing] == [True, False]
    deviation, bias = 0.02, -0.5
    odometry = {"noise": deviation, "bias": bias}
    system = load_scenario("harbour", {"controller": {**DRIFT, "odometry": odometry}}).system
    terms, N = system.law.terms, len(system.team.agents)
    memory = new_memory(system.law, len(system.initial))
    drawn = []
    for k in range(4000):
        evaluate_law(system.control, terms.period * k, system.initial, None, memory)
        drawn.append(memory.terms.moved[:N].copy())
    np.testing.assert_array_equal(drawn[0], 0.0)
    has = np.arange(3) < terms.dimension[:, None]
    x = (np.array(drawn[1:])[:, has] - bias * terms.period) / deviation
    np.testing.assert_array_equal(np.array(drawn)[:, ~has], 0.0)
    assert abs(x.mean()) < 5 / np.sqrt(x.size)
    assert abs(x.var() - 1.0) < 5 * np.sqrt(2 / x.size)
    correlation = np.corrcoef(np.hstack([x[1:], x[:-1]]), rowvar=False) - np.eye(2 * x.shape[1])
    assert np.abs(correlation).max() < 5.5 / np.sqrt(len(x))


# -- bodies ------------------------------------------------------------------------------------------------------------


def test_drift_on_bodies_is_that_of_the_medium_about_them() -> None:
    """From the record: the filter of the medium's velocity, which contains no vehicle's lag."""
    law = {"gain": 3.0, "control_period": 0.01, "drift": {"filter": 0.05}}
    scenario = mixed_scenario(time={"end": 0.5}, controller=law, disturbance={"agents": {"bound": 0.5}})
    data = simulate(scenario, "physics")
    met = np.nan_to_num(data["agent_flow"].values)
    share, drift = filtered(0.01, 0.05), np.zeros_like(met)
    drift[1] = met[1]
    for k in range(2, len(met)):
        drift[k] = drift[k - 1] + share * (met[k] - drift[k - 1])
    wanted = -3.0 * np.nan_to_num(data["disagreement_vector"].values) - drift
    np.testing.assert_allclose(np.nan_to_num(data["velocity_command"].values), wanted, rtol=0, atol=1e-12)
    assert np.abs(drift).max() > 0.1


def test_a_sample_that_is_taken_twice_counts_once() -> None:
    """Also where the observer takes from the displacement what the command before explains."""
    law = {"gain": 8.0, "control_period": 0.01, **ALL, "odometry": {"noise": 1e-3}}
    scenario = mixed_scenario(time={"end": 0.1}, controller=law)
    asked, plain = World(scenario), World(scenario)
    for _ in range(50):
        asked.close_loop()
        asked.close_loop()
        asked.step()
    plain.step(50)
    np.testing.assert_array_equal(asked.get_state(), plain.get_state())
    engine = Session(scenario, "ideal").engine
    (piece,) = engine.record(100)
    for _ in range(2):
        np.testing.assert_array_equal(engine.observe().command, piece.log.command[-1, :3])


# -- what agents send --------------------------------------------------------------------------------------------------


def test_exchanges_and_numbers_are_counted() -> None:
    """Of a round: F x on each communication edge, in each direction; of a law in Python: what it was handed."""
    from mjsheaf.results.metrics import communication

    paper = load_scenario("paper", {"time.end": 1.0})
    scenario = edited(paper, {"feedforward": {"rounds": 3}, "newton": {"rounds": 2}})
    data = simulate(scenario, "ideal")
    T = data.sizes["time"]
    assert [data.attrs[k] for k in ("exchange_rounds", "messages", "numbers_sent")] == [5 * T, 5 * 36 * T, 5 * 72 * T]
    sent = communication(data, T, scenario.system.grid.period)
    assert sent["exchanges_per_second"] == pytest.approx(500.0)
    assert sent["numbers_per_agent_second"] == pytest.approx(500.0 * 72 / 13)
    own = simulate(scenario, "ideal", controller=agentwise(scenario, "ideal"))
    assert own.attrs["numbers_sent"] == 36 * 3 * own.attrs["exchange_rounds"]  # three coordinates to each neighbour
    assert communication(simulate(paper, "ideal"), T, paper.system.grid.period) == dict.fromkeys(sent, 0.0)
