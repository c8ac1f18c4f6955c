"""Generated swarms: any number, graph and seed makes a whole scenario.

Oracle: the graphs' own definitions, by networkx.
"""

from collections import Counter
from typing import Any

import networkx
import numpy as np
import pytest

from mjsheaf import load_scenario
from mjsheaf.errors import ScenarioError
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.scenario import Swarm, _k_regular, _nearest, _sunflower

GRAPHS = ("nearest", "ring", "random_geometric", "small_world", "k_regular")


def swarm(seed: int = 0, **fields: Any) -> Scenario:
    return load_scenario("swarm", {"seed": seed, **{f"swarm.{name}": value for name, value in fields.items()}})


def graph_of(scenario: Scenario) -> networkx.Graph:
    graph = networkx.Graph()
    graph.add_nodes_from(a.id for a in scenario.agents)
    graph.add_edges_from(tuple(e.between) for e in scenario.communication)
    return graph


@pytest.mark.parametrize("size", [1, 2, 3, 7, 60])
@pytest.mark.parametrize("graph", GRAPHS)
def test_every_swarm_is_connected_and_unique(graph: str, size: int) -> None:
    scenario = swarm(graph=graph, size=size, degree=2)
    assert len(scenario.agents) == size
    assert networkx.is_connected(graph_of(scenario))
    assert scenario.system.team.dirichlet.unique
    assert len({tuple(sorted(e.between)) for e in scenario.communication}) == len(scenario.communication)


def test_graphs_are_what_they_are_called() -> None:
    assert networkx.is_isomorphic(graph_of(swarm(graph="ring", size=12)), networkx.cycle_graph(12))
    assert graph_of(swarm(graph="small_world", size=40, degree=4)).number_of_edges() >= 80
    crowd = graph_of(swarm(graph="random_geometric", size=400, degree=6))
    assert 4.0 < 2.0 * crowd.number_of_edges() / 400 < 8.0


@pytest.mark.parametrize(("size", "degree"), [(2, 2), (3, 2), (20, 2), (8, 3), (9, 4), (40, 3)])
def test_k_regular_is_regular_and_connected_with_every_seed(size: int, degree: int) -> None:
    drawn = set()
    for seed in range(60):
        edges = _k_regular(
            _sunflower(size, 6.0), Swarm(size=size, about="T1", degree=degree), np.random.default_rng(seed)
        )
        graph = networkx.Graph(edges)
        assert networkx.is_connected(graph)
        assert Counter(dict(graph.degree).values()) == {min(degree, size - 1): size}
        drawn.add(frozenset(edges))
    assert len(drawn) == (1 if degree >= size - 1 else 60)


GRID = np.stack(np.meshgrid(np.arange(30.0), np.arange(30.0)), axis=-1).reshape(-1, 2)
PLACES = {
    **{(size, degree): _sunflower(size, 6.0) for size, degree in ((2, 2), (5, 8), (40, 64), (300, 4))},
    (900, 6): GRID[np.random.default_rng(0).permutation(900)],  # many equally near, of which the nearest come last
}


@pytest.mark.parametrize(("size", "degree"), [*PLACES, pytest.param(9000, 5, marks=pytest.mark.slow)])
def test_nearest_is_as_by_brute_force(size: int, degree: int) -> None:
    """Each agent is next to the nearest one before it; of two equally near ones, the first."""
    places = PLACES[size, degree] if (size, degree) in PLACES else _sunflower(size, 6.0)
    expected = set()
    for k in range(1, size):
        distance = ((places[:k] - places[k]) ** 2).sum(axis=1)
        expected |= {(int(j), k) for j in np.argsort(distance, kind="stable")[: degree // 2]}
    assert _nearest(places, Swarm(size=size, about="T1", degree=degree), np.random.default_rng(0)) == expected


def test_the_seed_draws_places_and_links() -> None:
    one, same, other = (swarm(graph="random_geometric", seed=seed) for seed in (1, 1, 2))
    assert one == same
    assert graph_of(one).edges != graph_of(other).edges
    assert [a.position for a in one.agents] != [a.position for a in other.agents]


def test_places_fill_a_disc_about_the_target_at_their_spacing() -> None:
    scenario = swarm(size=200, spacing=4.0, scatter=0.0)
    places = np.array([a.position for a in scenario.agents])
    apart = np.linalg.norm(places[:, None] - places, axis=2) + 1e9 * np.eye(200)
    assert 0.75 * 4.0 < apart.min() < 4.5
    assert np.linalg.norm(places[:, :2], axis=1).max() == pytest.approx(4.0 * np.sqrt(200 / np.pi), rel=0.01)
    assert set(places[:, 2]) == {20.0}
    np.testing.assert_allclose(places[:, :2].mean(axis=0), 0.0, atol=1.0)


def test_a_planar_swarm_has_boats() -> None:
    scenario = load_scenario("swarm", {"swarm.altitude": None, "swarm.vehicle": "otter", "swarm.size": 5})
    assert {len(a.position) for a in scenario.agents} == {2}


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"swarm.size": 0}, "swarm.size: expected at least 1"),
        ({"swarm.graph": "torus"}, "swarm.graph: expected 'nearest'"),
        ({"swarm.about": "nobody"}, "swarm.about: 'nobody' is no target with a position"),
        ({"swarm.graph": "k_regular", "swarm.size": 5, "swarm.degree": 3}, "swarm.degree: no graph of 5 agents has 3"),
        ({"swarm.degree": 5}, "swarm.degree: 5 is odd; expected an even number with graph nearest"),
        ({"agents": [{"id": "A", "position": [0, 0]}]}, "swarm: makes agents itself; give either"),
    ],
)
def test_wrong_swarms_are_refused(overrides: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        load_scenario("swarm", overrides)
    assert message in str(refused.value)
