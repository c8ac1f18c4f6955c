"""Purpose of `harbour`: real vehicles keep their formations nearly as well as ideal kinematics do.

Oracle: the bounds that were set before it was built, on each group and on the scenario itself.
"""

import numpy as np
import pytest

from mjsheaf import load_scenario
from mjsheaf.results import summarize
from tests.builders import Simulated


@pytest.mark.slow
@pytest.mark.parametrize(("group", "formation"), [("air", 0.5), ("water", 1.5)])
def test_groups_do_on_bodies_nearly_what_they_do_ideally(group: str, formation: float, simulated: Simulated) -> None:
    team = load_scenario("harbour").system.team
    ideal, bodies = (
        summarize(team, simulated("harbour", backend))["groups"][group] for backend in ("ideal", "physics")
    )
    assert bodies["tracking_error"] <= 1.15 * ideal["tracking_error"] + 0.3
    assert bodies["formation_error"] <= ideal["formation_error"] + formation


@pytest.mark.slow
def test_targets_move_fast_and_apart(simulated: Simulated) -> None:
    dataset = simulated("harbour", "physics")
    position = dataset["target_position"].values.copy()
    position[..., 2] = np.nan_to_num(position[..., 2])
    speed = np.linalg.norm(np.gradient(position, dataset["time"].values, axis=0), axis=2)
    late = dataset["time"].values >= 5.0  # they set off from rest
    assert speed[late].min() >= 1.0
    assert np.linalg.norm((position[:, 0] - position[:, 1])[:, :2], axis=1).min() >= 10.0


def test_the_team_is_tied_together_and_sees_little() -> None:
    team = load_scenario("harbour").system.team
    kinds = {agent.id: agent.dimension for agent in team.agents}
    across = [e for e in team.communication if kinds[e.tail] != kinds[e.head]]
    assert len(across) >= 2
    for edge in across:
        np.testing.assert_array_equal(edge.weight, np.eye(2))
    seers = {e.tail for e in team.sensing}
    assert all(sum(kinds[a] == n for a in seers) <= 2 for n in (2, 3))
    assert len(load_scenario("harbour").agents) == 8
    vehicles = [a.vehicle for a in load_scenario("harbour").agents]
    assert vehicles == ["hexarotor"] * 4 + ["wamv"] * 4
