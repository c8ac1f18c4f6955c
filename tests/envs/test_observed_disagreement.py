"""Disagreement of a team from its observations, by the matrix of the example. Oracle: eta of the law in the loop."""

import ast
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag

from mjsheaf.envs import env
from tests.builders import mixed_scenario

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "17_sheaf_law_as_policy.py"
LAW = {"gain": 3.0, "control_period": 0.01, "velocity_limit": 2.0}
VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "links": {"links": {"all": {"noise": 0.05, "loss": 0.3, "delay": 0.02}}},
    "lost": {"events": [{"time": 0.1, "lose": "boat"}, {"time": 0.2, "join": "boat"}]},
    "cut": {"events": [{"time": 0.1, "cut": ["boat", "front"]}]},
}


def matrix_of_example() -> Any:
    """Return the function of the example, without what the example runs."""
    tree = ast.parse(EXAMPLE.read_text())
    [function] = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    names: dict[str, Any] = {"np": np, "block_diag": block_diag}
    exec(compile(ast.Module([function], []), str(EXAMPLE), "exec"), names)
    return names[function.name]


@pytest.mark.parametrize("name", VARIANTS)
def test_eta_from_observations_is_that_of_the_loop(name: str) -> None:
    team = env(mixed_scenario(time={"end": 0.3}, controller=LAW, **VARIANTS[name]))
    episode, rng = team.episode, np.random.default_rng(0)
    observation, _ = team.reset()
    M = matrix_of_example()(episode)
    over = False
    while not over:
        expected = episode.world.disagreement[: len(episode.agents)].copy()
        expected[~episode.present] = 0.0
        known = np.arange(3) < episode.dimensions[:, None]
        np.testing.assert_allclose(M @ observation, expected[known], rtol=1e-12, atol=1e-13)
        observation, _, broken, over, _ = team.step(rng.uniform(-1.0, 1.0, team.action_space.shape))
        assert not broken
