"""Ranges and bearings that do not fit together, and directed teams: `check` against the law, simulated on its own."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.arrays import Array
from mjsheaf.checking.loop.held_law import loop_of
from mjsheaf.checking.loop.links import limit_from_eigenvalues
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, list_members, make_fields, make_scenario, require
from tests.oracles.law import disagreement
from tests.running import analyse
from tests.strategies import slow

PERIOD = 0.01
GAIN = 1.0
USUAL: dict[str, Any] = {"time": {"end": 1.0}, "controller": {"gain": GAIN, "control_period": PERIOD}}


def law(scenario: Scenario) -> Callable[[Array, Array], Array]:
    """The law of a team, u / k1 of stacked agents q (..., n_q) and targets p (n_p,), by the formulas of its edges."""
    team = scenario.team
    n = int(team.first_state[-1])

    def command(q: Array, p: Array) -> Array:
        x = np.concatenate([q, np.broadcast_to(p, (*q.shape[:-1], len(p)))], axis=-1)
        return np.asarray(-team.pack(disagreement(team, team.unpack(x)))[..., :n])

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

    steps = move * np.eye(n)
    change = (end(x[:n] + steps) - end(x[:n] - steps)) / (2.0 * move)
    return np.asarray(np.abs(np.linalg.eigvals(change)) ** (1.0 / periods))


def random_team(
    seed: int, misfit: float = 1.0, directed: float = 0.0, targets: bool = True, away: float = 0.3
) -> Scenario:
    """A random team `away` from a shape from which its ranges, bearings and positions are off by `misfit`, m."""
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
    start = q + away * rng.normal(size=q.shape)
    agents, seen = ({f"{kind}{k}": x for k, x in enumerate(each.tolist())} for kind, each in (("A", start), ("T", p)))
    links = [edge(f"A{i}", f"A{j}", q[j] - q[i], rng.random() < directed) for i, j in pairs]
    sensing = [edge(f"A{i}", f"T{k}", p[k] - q[i], False) for i, k in sensed]
    return build_scenario(agents, seen, sensing, communication=links, **USUAL)


def is_settled(scenario: Scenario) -> bool:
    """Return True if q* is an equilibrium of the law and nothing is free there."""
    team = scenario.team
    x = team.at_rest(scenario.system.initial)
    n = int(team.first_state[-1])
    return float(np.abs(law(scenario)(x[:n], x[n:])).max()) < 1e-9 and team.is_settled(scenario.system.initial)


@pytest.mark.parametrize("directed", [0.0, 0.5])
@pytest.mark.parametrize("seeds", [range(6), slow(range(6, 260))], ids=len)
def test_the_loop_of_edges_that_do_not_fit_is_that_of_the_law(seeds: range, directed: float) -> None:
    """Rates agree with the law's own decay to 2 %; small motions decay at 0.97 of the largest gain and grow at 1.03.

    Most random teams have one equilibrium near them.
    """
    decided = 0
    for seed in seeds:
        scenario = random_team(seed, directed=directed)
        if not is_settled(scenario):
            continue
        decided += 1
        loop = loop_of(scenario.system.local)
        measured = factors(scenario).max()
        stated, decay = (-np.log(radius) / PERIOD for radius in (loop.radius, measured))
        assert stated == pytest.approx(decay, rel=0.02, abs=1e-6), seed
        if loop.stable_gains is None:
            assert measured > 1.0, seed
            continue
        limit = loop.stable_gains[1]
        assert factors(scenario, 0.97 * limit, periods=4).max() < 1.0, seed
        assert factors(scenario, 1.03 * limit, periods=4).max() > 1.0, seed
    assert decided >= 0.7 * len(seeds)


@pytest.mark.parametrize("seeds", [range(15), slow(range(15, 100))], ids=len)
def test_q_star_of_directed_teams_without_targets_is_near_a_shape_that_is_near(seeds: range) -> None:
    """Agents 2 cm from a shape that they keep have q* within 0.1 m, an equilibrium, and an error of that size."""
    for seed in seeds:
        rng = np.random.default_rng(seed)
        shape = random_team(seed, misfit=0.0, directed=0.4, targets=False, away=0.0)
        q = shape.team.pack(shape.system.initial + 0.02 * rng.uniform(-1.0, 1.0, shape.system.initial.shape))
        found = shape.team.extend(np.zeros(0), q)
        assert np.abs(found - q).max() < 0.1, seed
        assert np.abs(law(shape)(found, np.zeros(0))).max() < 1e-12, seed


@pytest.mark.parametrize("values", [[1.0], [0.4 + 0.9j, 0.4 - 0.9j, 2.0], [1.0 - 1.0j, 1.0 + 1.0j], [0.02 + 1.0j]])
@pytest.mark.parametrize("product", [0.005, 0.03, 0.3])
def test_the_largest_delay_is_that_of_the_characteristic_roots(values: list[complex], product: float) -> None:
    """Roots of z^m (z - 1) + k1 h lambda are inside the circle up to the largest delay, and one is outside beyond."""

    def radius(delay: int) -> float:
        polynomials = (
            [1.0, -1.0, *[0.0] * (delay - 1), product * v] if delay else [1.0, product * v - 1.0] for v in values
        )
        return max(float(np.abs(np.roots(p)).max()) for p in polynomials)

    if radius(0) >= 1.0:
        return
    limit = limit_from_eigenvalues(np.array(values, dtype=complex), product)
    few = [delay for delay in (limit - 1, limit, limit + 1, limit + 2) if 0 <= delay <= 300]
    assert [radius(delay) < 1.0 for delay in few] == [delay <= limit for delay in few]


def test_ranges_too_short_to_meet_hold_an_agent_between_them() -> None:
    """H is 2 along the line, and across it 2 (1 - r/|z|) = 1: check and run agree that nothing is free."""
    sensing = [{"between": ["A", f"T{k}"], "measures": "range", "offset": [5]} for k in (1, 2)]
    law, targets = {"gain": 1.0, "control_period": 0.02}, {"T1": [-10, 0], "T2": [10, 0]}
    between = build_scenario({"A": [0.1, 0.3]}, targets, sensing, time={"end": 5.0}, controller=law)
    record = analyse(between)
    require(record, {"ok": True, "relative_cohomology.dimension": 0, "rigidity.localizable": True})
    rates = {"rigidity.rate": pytest.approx(1.0, rel=1e-9), "law.spectral_radius": pytest.approx(0.98, rel=1e-9)}
    require(record, rates)
    run = simulate(between, backend="ideal")
    assert run.agent_position.values[-1, 0, 1] == pytest.approx(0.3 * 0.98**250, rel=1e-3)


PLACES = {"T0": [0.1, 8.1], "T1": [-8.2, -9.1], "T2": [6.3, -8.4]}


def three_ranges(gain: float, **fields: Any) -> Scenario:
    """An agent with ranges to three targets that do not fit together; fields replace fields."""
    ranges = (16.4, 0.7, 17.2)
    sensing = [{"between": ["A", f"T{k}"], "measures": "range", "offset": [r]} for k, r in enumerate(ranges)]
    usual = {"time": {"end": 60.0}, "controller": {"gain": gain, "control_period": 0.1}}
    return make_scenario({**make_fields({"A": [-9.3, -7.1]}, PLACES, sensing, **usual), **fields})


def test_runs_converge_up_to_the_largest_gain_of_ranges_that_do_not_fit() -> None:
    """The largest gain is 9.275 1/s: a run at 0.97 of it ends at q*, and one at 1.03 of it does not."""
    limit = analyse(three_ranges(1.0))["law"]["largest_gain"]
    assert limit == pytest.approx(9.274966, abs=1e-5)
    assert analyse(three_ranges(1.0))["margins"]["hold"]["largest_gain"] == pytest.approx(limit, rel=1e-6)
    for share, settles in ((0.97, True), (1.03, False)):
        assert analyse(three_ranges(share * limit))["law"]["stable"] is settles
        error = simulate(three_ranges(share * limit), backend="ideal").tracking_error.values[-1]
        assert (error < 1e-3) == settles


@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_noise_of_ranges_that_do_not_fit_is_that_of_a_run(delay: float) -> None:
    """The RMS error of a long run, whose mean is not q* by the square of the noise, to 5 %."""
    links = {"all": {"noise": 0.05, "delay": delay}}
    scenario = three_ranges(2.0, links=links, time={"end": 2000.0})
    x = simulate(scenario, backend="ideal").agent_position.values[500:, 0, :2]
    measured = np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert analyse(scenario)["links"]["noise_rms"] == pytest.approx(measured, rel=0.05)


def test_stress_holds_a_shape_that_its_ranges_alone_do_not() -> None:
    """Cables around a square pull it against its diagonal struts: rank 5 of 5 by the law, as its motions have."""
    places = {"A0": [0.0, 0.0], "A1": [4.0, 0.0], "A2": [4.0, 4.0], "A3": [0.0, 4.0]}
    edges = [
        {"between": [f"A{i}", f"A{j}"], "measures": "range", "offset": [3.5 if (j - i) % 2 else 6.0]}
        for i, j in itertools.combinations(range(4), 2)
    ]
    scenario = build_scenario(places, {}, [], communication=edges, **USUAL)
    record = analyse(scenario)
    assert (record["rigidity"]["rank"], record["rigidity"]["needed"]) == (5, 5)
    assert record["ok"]
    moving = np.sort(factors(scenario))[:-3]
    assert record["law"]["spectral_radius"] == pytest.approx(moving.max(), abs=1e-8)


@pytest.mark.parametrize("seed", range(6))
def test_ranges_on_a_line_are_not_rigid(seed: int) -> None:
    """Three agents on a line in any direction have rank 2 of 3, from starts off the line."""
    rng = np.random.default_rng(seed)
    places = np.outer(np.sort(rng.uniform(0.0, 9.0, 3)), rng.normal(size=2)) + rng.uniform(-5.0, 5.0, 2)
    start = places + rng.normal(scale=0.3, size=places.shape)
    links = [{"between": [*pair], "measures": "range"} for pair in itertools.combinations("ABC", 2)]
    formation = {"name": "f", "shape": "explicit", "members": [*"ABC"], "displacements": places.tolist()}
    agents = dict(zip("ABC", start.tolist(), strict=True))
    record = analyse(make_fields(agents, {}, [], communication=links, formations=[formation], **USUAL))
    assert (record["rigidity"]["rank"], record["rigidity"]["needed"]) == (2, 3)
    assert not record["ok"]


def test_the_largest_eigenvalue_gives_the_largest_gain_of_check() -> None:
    """One answer for a directed team and for ranges that do not fit."""
    for scenario in (random_team(1, misfit=0.0, directed=0.5), three_ranges(2.0), random_team(2, directed=0.5)):
        limit = 2.0 / (scenario.system.grid.period * scenario.system.largest_eigenvalue)
        assert analyse(scenario)["law"]["largest_gain"] == pytest.approx(limit, rel=1e-9)


def test_a_place_at_which_ranges_push_the_agent_away_is_unstable() -> None:
    """Halfway between two targets, 1 m from each, whose ranges are 5 m: H is 2 (1 - 5) across the line."""
    sensing = [{"between": ["A", id], "measures": "range", "offset": [5.0]} for id in ("T0", "T1")]
    targets = {"T0": [-1.0, 0.0], "T1": [1.0, 0.0]}
    record = analyse(build_scenario({"A": [0.0, 0.0]}, targets, sensing, **USUAL))
    assert record["law"]["spectral_radius"] == pytest.approx(1.0 + 8.0 * GAIN * PERIOD)
    require(record["margins"]["bodies"], {"stable": False, "largest_gain": None})
    assert [problem["fix"] for problem in record["problems"]] == ["", ""]


BEARINGS = [[0.6, 0.8], [0.0, -1.0], [1.0, 0.0]]


def three_bearings(gain: float, **fields: Any) -> Scenario:
    """An agent with bearings to three targets that do not fit together; fields replace fields."""
    sensing = [{"between": ["A", f"T{k}"], "measures": "bearing", "offset": g} for k, g in enumerate(BEARINGS)]
    return three_ranges(gain, **{"sensing": sensing, "agents": list_members({"A": [-1.0, -2.0]}), **fields})


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("scenario", [three_ranges, three_bearings])
def test_the_steady_error_of_edges_that_do_not_fit_is_that_of_a_run(scenario: Any) -> None:
    """Targets sway by 5 cm: q* moves by the law's H^-1 B, and the error is that of its loop, to 1 %."""
    sway: dict[str, Any] = {"kind": "lissajous", "amplitude": [0.05, 0.05], "rate": [0.5, 0.7]}
    motions = [sway | {"phase": [float(k), 1.0]} for k in range(3)]
    targets = {id: {"position": PLACES[id], "motion": motion} for id, motion in zip(PLACES, motions, strict=True)}
    moving = scenario(3.0, targets=list_members(targets))
    error = simulate(moving, backend="ideal").tracking_error.values[300:]
    assert analyse(moving)["steady"]["ideal"] == pytest.approx(np.sqrt((error**2).mean()), rel=0.01)


@pytest.mark.long
def test_the_vehicles_loop_of_bearings_that_do_not_fit_is_that_of_a_run_on_bodies() -> None:
    """The slowest mode is real and far from the others: late errors fall by its factor in each period, to 1 %."""
    error = simulate(three_bearings(8.0), backend="physics").tracking_error.values[:, 0]
    first, last = (int(np.argmax(error < size)) for size in (1e-3, 1e-6))
    measured = np.log(error[last] / error[first]) / (last - first)
    bodies = analyse(three_bearings(8.0))["margins"]["bodies"]
    assert np.log(bodies["spectral_radius"]) == pytest.approx(measured, rel=0.01)


def test_edges_that_are_directed_both_ways_are_those_of_one_edge() -> None:
    """Two one-way edges pull as one that both ends measure: the rate, the gain and the delay margin are its own."""
    fields = make_fields({"A0": [0.0, 0.0], "A1": [3.0, 1.0]}, {"T": [5.0, 0.0]}, [["A0", "T"]], **USUAL)
    ways = [{"between": ["A0", "A1"], "directed": True}, {"between": ["A1", "A0"], "directed": True}]
    both, one = (analyse({**fields, "communication": edges}) for edges in (ways, [["A0", "A1"]]))
    for name in ("spectral_radius", "largest_gain"):
        assert both["law"][name] == pytest.approx(one["law"][name], rel=1e-9)
    assert both["links"]["delay_margin"] == pytest.approx(one["links"]["delay_margin"])
