"""Centering: how far a group's centroid is from where its formation wants it.

Oracles: a team placed exactly where its formation wants it, shifted by a known vector; the plain distance from the
target for formations whose displacements cancel.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf import load_scenario, simulate
from mjsheaf.results.metrics import evaluate_errors, separations, summarize
from mjsheaf.scenario import scenario_from_mapping
from mjsheaf.team import Team
from tests.builders import make_fields
from tests.oracles.law import residual

TARGET = [10.0, 5.0, 8.0]


def scenario(dimensions: list[int], target: int, **group: Any) -> dict[str, Any]:
    agents = {f"A{k}": [float(k)] * n for k, n in enumerate(dimensions)}
    goal = {"T": {"position": TARGET[:target], "motion": {"kind": "static"}}}
    formation = {"name": "group", "members": [*agents], "about": "T", **group}
    return make_fields(agents, goal, [[name, "T"] for name in agents], time={"end": 20}, formations=[formation])


def in_place(team: Team, shift: list[float]) -> np.ndarray:
    """One sample of the team where its formation wants it, all agents shifted, shape (1, V, 3)."""
    dimension = team.targets[0].dimension
    target = np.array([*TARGET[:dimension], 0.0, 0.0])[:3]
    places = [target + np.pad(team.displacement[a], (0, 3 - len(team.displacement[a]))) + shift for a in team.agent_ids]
    return np.array([[*places, target]])


EXPLICIT = {"shape": "explicit", "displacements": [[5, 2], [5, -2], [4, 1]]}
CASES: dict[str, tuple[list[int], int, dict[str, Any], int]] = {
    "height": ([3, 3, 3], 3, {"shape": "polygon", "radius": 4, "height": 3}, 3),
    "mean (5, 0)": ([2, 2, 2], 2, EXPLICIT, 2),
    "a boat among drones": ([3, 2, 3], 3, {"shape": "polygon", "radius": 4, "height": 3}, 2),
    "drones over a boat": ([3, 3, 3], 2, {"shape": "polygon", "radius": 4, "height": 3}, 2),
    "boats under a drone": ([2, 2, 2], 3, EXPLICIT, 2),
    "unlike displacements": ([3, 2], 3, {"shape": "explicit", "displacements": [[1, 2, 9], [3, -5]]}, 2),
}


@pytest.mark.parametrize("case", CASES)
def test_centering_is_the_shift_of_a_group_from_its_place(case: str) -> None:
    dimensions, target, group, shared = CASES[case]
    team = scenario_from_mapping(scenario(dimensions, target, **group)).team
    shift = [0.3, -0.4, 1.2]
    there = evaluate_errors(team, in_place(team, [0.0, 0.0, 0.0])).centering["group"]
    off = evaluate_errors(team, in_place(team, shift)).centering["group"]
    np.testing.assert_allclose(there, 0.0, atol=1e-14)
    np.testing.assert_allclose(off, np.linalg.norm(shift[:shared]), rtol=1e-13)


@pytest.mark.parametrize("count", [2, 3, 7, 13])
def test_formations_that_cancel_keep_the_plain_distance_to_the_bit(count: int) -> None:
    """A polygon's displacements cancel up to rounding only; its centering is the distance to the target exactly."""
    team = scenario_from_mapping(scenario([2] * count, 3, shape="polygon", radius=4.7, angle=17.0)).team
    positions = np.random.default_rng(count).normal(size=(50, count + 1, 3))
    plain = np.linalg.norm(positions[:, :count, :2].mean(axis=1) - positions[:, count, :2], axis=1)
    np.testing.assert_array_equal(evaluate_errors(team, positions).centering["group"], plain)


@pytest.mark.parametrize("case", ["height", "mean (5, 0)"])
def test_a_team_that_tracks_perfectly_is_centred(case: str) -> None:
    """Dataset, summary and group agree; the desired displacement is no error."""
    dimensions, target, group, _ = CASES[case]
    loaded = scenario_from_mapping(scenario(dimensions, target, **group))
    data = simulate(loaded, "ideal")
    final = summarize(loaded.team, data)
    assert final["tracking_error"] < 1e-6
    assert final["centering_error"] < 1e-6
    assert final["groups"]["group"]["centering_error"] == final["centering_error"]
    assert float(data["centering_error"][-1]) == pytest.approx(final["centering_error"], abs=1e-15)
    assert float(data["group_centering_error"][-1, 0]) == pytest.approx(final["centering_error"], abs=1e-15)


def test_an_offset_of_an_edge_does_not_move_the_place_that_the_formation_names() -> None:
    """An edge's own `offset` overrides the formation in the law; centering then shows what that costs."""
    raw = scenario([2, 2], 2, shape="explicit", displacements=[[5, 2], [5, -2]])
    raw["sensing"] = [{"between": [a, "T"], "offset": [0.0, 0.0]} for a in ("A0", "A1")]
    data = simulate(scenario_from_mapping(raw), "ideal")
    assert float(data["centering_error"][-1]) == pytest.approx(5.0, abs=1e-6)


@pytest.mark.parametrize("vehicles", [2, 30, 130])
def test_separations_are_those_of_all_pairs(vehicles: int) -> None:
    """Slow motion, motion together, a crossing at speed, a jump, some that part from one place, a missing position."""
    rng = np.random.default_rng(vehicles)
    steps = 0.01 * rng.normal(size=(40, vehicles, 3))
    steps[:, :, 0] += 3.0  # together
    steps[10:, : vehicles // 4, 1] += 0.3  # some through the others
    steps[30] += 50.0 * rng.normal(size=(vehicles, 3))
    positions = 5.0 * rng.normal(size=(vehicles, 3)) + np.cumsum(steps, axis=0)
    few = vehicles // 5  # vehicles at the places of others at the second sample
    positions[:, vehicles - few :] = positions[:, :few] + 1e-3 * np.arange(-1, 39)[:, None, None]
    positions[[0, 17], 1] = np.nan
    away = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=3) + np.diag(np.full(vehicles, np.inf))
    expected = away.min(axis=2)
    expected[[0, 17]] = np.nan  # a sample at which one is unknown is unknown
    np.testing.assert_allclose(separations(positions), expected, rtol=1e-13)
    assert separations(positions[:0]).shape == (0, vehicles)


@pytest.mark.parametrize("name", ["paper", "range_formation", "bearing_formation"])
def test_residuals_of_edges_of_unlike_shapes_are_those_of_each_edge(name: str) -> None:
    team = load_scenario(name).team
    positions = 5.0 * np.random.default_rng(0).normal(size=(3, len(team.members), 3))
    found = team.edge_residuals(positions)
    for column, edge in zip(found.T, team.measuring_edges, strict=True):
        np.testing.assert_allclose(column, residual(team, edge, positions), rtol=1e-12, atol=1e-12)
