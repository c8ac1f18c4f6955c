"""Ranges and bearings that do not fit together, and directed teams: `check` against the law, simulated on its own."""

import itertools
from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.arrays import Array
from mjsheaf.checking import check
from mjsheaf.checking.loop.directed import directed_loop, largest_delay
from mjsheaf.checking.loop.held_law import loop_of
from mjsheaf.scenario import Scenario
from mjsheaf.system import System
from tests.builders import make_scenario

PERIOD = 0.01
GAIN = 1.0


def law(scenario: Scenario) -> Any:
    """The law of a team of one dimension, u / k1 of stacked agents q (n_q,) and targets p (n_p,), from its formulas."""
    team = scenario.team
    d = team.agents[0].dimension
    number = {id: k for k, id in enumerate([*team.agent_ids, *team.target_ids])}
    edges = [(number[e.tail], number[e.head], e) for e in (*team.communication, *team.sensing)]

    def command(q: Array, p: Array) -> Array:
        x = np.concatenate([q, p]).reshape(-1, d)
        u = np.zeros((len(team.agents), d))
        for i, j, e in edges:
            z, w = x[j] - x[i], e.weight[0, 0]
            far = np.linalg.norm(z)
            assert e.offset is not None
            pull = {
                "position": lambda z=z, e=e: z + e.offset,
                "range": lambda z=z, e=e, far=far: (1.0 - e.offset[0] / far) * z,
                "bearing": lambda z=z, e=e, far=far: z * (z @ e.offset) / far**2 - e.offset,
            }[e.measures]()
            u[i] += w * pull
            if j < len(u) and not e.directed:
                u[j] -= w * pull
        return u.ravel()

    return command


def factors(scenario: Scenario, gain: float = GAIN, periods: int = 20, move: float = 1e-6) -> Array:
    """Sizes of the factors by which small motions about q* change in a period of the held law, simulated, (n_q,)."""
    team, command = scenario.team, law(scenario)
    x = team.at_rest(scenario.system.initial)
    n = int(team.first_state[-1])

    def end(q: Array) -> Array:
        for _ in range(periods):
            q = q + gain * PERIOD * command(q, x[n:])
        return q

    ends = [end(x[:n] + row) - end(x[:n] - row) for row in move * np.eye(n)]
    return np.asarray(np.abs(np.linalg.eigvals(np.array(ends) / (2.0 * move))) ** (1.0 / periods))


def random_team(seed: int, misfit: float = 1.0, directed: float = 0.0, targets: bool = True) -> Scenario:
    """A random team near a shape from which its ranges, bearings and positions are off by `misfit`, m."""
    rng = np.random.default_rng(seed)
    d, n = int(rng.integers(2, 4)), int(rng.integers(2, 6))
    m = int(rng.integers(2, 5)) if targets else 0
    q, p = rng.uniform(-8.0, 8.0, (n, d)), rng.uniform(-10.0, 10.0, (m, d))
    kinds = [("range",), ("bearing",), ("range", "bearing", "position")][seed % 3]

    def edge(tail: str, head: str, z: Array, one_way: bool) -> dict[str, Any]:
        kind = str(rng.choice(kinds))
        z = z + misfit * rng.normal(size=d)
        far = float(np.linalg.norm(z))
        offset = {"range": [far], "bearing": (z / far).tolist(), "position": (-z).tolist()}[kind]
        weight = float(rng.uniform(0.5, 2.0))
        fields = {"between": [tail, head], "measures": kind, "offset": offset, "weight": weight}
        return {**fields, "directed": True} if one_way else fields

    pairs = [pair for pair in itertools.combinations(range(n), 2) if pair[1] == pair[0] + 1 or rng.random() < 0.7]
    pairs = [pair[::-1] if rng.random() < 0.5 else pair for pair in pairs]
    sensed = [(i, k) for i in range(n) for k in range(m) if rng.random() < 0.6]
    start = q + 0.3 * rng.normal(size=q.shape)
    return make_scenario(
        {
            "time": {"end": 1.0},
            "controller": {"gain": GAIN, "control_period": PERIOD},
            "agents": [{"id": f"A{i}", "position": x} for i, x in enumerate(start.tolist())],
            "targets": [{"id": f"T{k}", "position": x} for k, x in enumerate(p.tolist())],
            "communication": [edge(f"A{i}", f"A{j}", q[j] - q[i], rng.random() < directed) for i, j in pairs],
            "sensing": [edge(f"A{i}", f"T{k}", p[k] - q[i], False) for i, k in sensed],
        }
    )


def radius_of(system: System) -> float:
    """The spectral radius that `check` states for the held law."""
    local = system.local
    return loop_of(local).radius if local.team.symmetric else directed_loop(local).radius


def is_settled(scenario: Scenario) -> bool:
    """Return True if q* is an equilibrium of the law and nothing is free there."""
    team = scenario.team
    x = team.at_rest(scenario.system.initial)
    n = int(team.first_state[-1])
    return float(np.abs(law(scenario)(x[:n], x[n:])).max()) < 1e-9 and team.is_settled(scenario.system.initial)


@pytest.mark.parametrize("directed", [0.0, 0.5])
@pytest.mark.parametrize("seeds", [range(10), pytest.param(range(10, 260), marks=pytest.mark.slow)], ids=len)
def test_the_rate_of_edges_that_do_not_fit_is_that_of_the_law(seeds: range, directed: float) -> None:
    """Rates agree with the law's own decay to 2 %; nearly every random team has an equilibrium and is decided."""
    decided = 0
    for seed in seeds:
        scenario = random_team(seed, directed=directed)
        if not is_settled(scenario):
            continue
        decided += 1
        stated, measured = (-np.log(r) / PERIOD for r in (radius_of(scenario.system), factors(scenario).max()))
        assert stated == pytest.approx(measured, rel=0.02, abs=1e-6), seed
    assert decided >= 0.9 * len(seeds)


@pytest.mark.parametrize("directed", [0.0, 0.5])
@pytest.mark.parametrize("seeds", [range(6), pytest.param(range(6, 60), marks=pytest.mark.slow)], ids=len)
def test_the_largest_gain_of_edges_that_do_not_fit_is_that_of_the_law(seeds: range, directed: float) -> None:
    """Small motions decay at 0.97 of the largest gain and grow at 1.03 of it."""
    for seed in seeds:
        scenario = random_team(seed, directed=directed)
        if not is_settled(scenario):
            continue
        local = scenario.system.local
        loop = loop_of(local) if local.team.symmetric else directed_loop(local)
        if loop.stable_gains is None:
            assert factors(scenario).max() > 1.0, seed
            continue
        limit = loop.stable_gains[1]
        assert factors(scenario, 0.97 * limit, periods=4).max() < 1.0, seed
        assert factors(scenario, 1.03 * limit, periods=4).max() > 1.0, seed
