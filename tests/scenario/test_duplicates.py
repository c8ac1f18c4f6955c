"""The same edge twice counts double: it is refused unless the file says that it is meant.

Oracle: the Laplacian of the team, in which a parallel edge adds its weight.
"""

from typing import Any

import numpy as np
import pytest
import yaml

from mjsheaf.errors import ScenarioError
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, refused


def scenario(**fields: Any) -> Scenario:
    members = {"Q1": [0, 0, 3], "O1": [1, 0]}, {"T": [5, 5], "S": [6, 5]}, [["Q1", "T"], ["O1", "T"]]
    usual = {"time": {"end": 1}, "anchors": [{"agent": "Q1", "axes": ["z"], "value": [3]}]}
    return build_scenario(*members, **(usual | fields))


SAME = [
    "communication: [[Q1, O1], [Q1, O1]]",
    "communication: [[Q1, O1], [O1, Q1]]",
    "communication: [{between: [Q1, O1], offset: [1, 0]}, {between: [O1, Q1], offset: [-1, 0]}]",
    "communication: [[Q1, O1], {between: [O1, Q1], map: {tail: [[1, 0], [0, 1]], head: [[1, 0, 0], [0, 1, 0]]}}]",
    "sensing: [[Q1, T], [O1, T], [Q1, T]]",
    "target_edges: [[S, T], [T, S]]",
    "anchors: [{agent: Q1, axes: [z], value: [3]}, {agent: Q1, axes: [z], value: [3]}]",
]
DIFFERENT = [
    "communication: [[Q1, O1], {between: [O1, Q1], weight: 2}]",
    "communication: [{between: [Q1, O1], offset: [1, 0]}, {between: [O1, Q1], offset: [1, 0]}]",
    "communication: [[Q1, O1], {between: [Q1, O1], map: {tail: [[1, 0, 0]], head: [[1, 0]]}}]",
    "anchors: [{agent: Q1, axes: [z], value: [3]}, {agent: Q1, axes: [x], value: [3]}]",
    "anchors: [{agent: Q1, axes: [z], value: [3]}, {agent: Q1, axes: [z], value: [4]}]",
]


@pytest.mark.parametrize("case", SAME)
def test_the_same_edge_twice_is_refused_and_both_are_named(case: str) -> None:
    ((field, edges),) = yaml.safe_load(case).items()
    with refused(ScenarioError, f"{field}.{len(edges) - 1}", f"{field}.0", "parallel: true"):
        scenario(**{field: edges})


@pytest.mark.parametrize("case", SAME)
@pytest.mark.parametrize("which", [0, -1])
def test_a_parallel_edge_that_is_meant_counts_beside_the_other(case: str, which: int) -> None:
    ((field, edges),) = yaml.safe_load(case).items()
    plain = [{"between": edge} if isinstance(edge, list) else edge for edge in edges]
    plain[which] = {**plain[which], "parallel": True}
    twice = scenario(**{field: plain}).system.team.sheaf.laplacian().toarray()
    once = scenario(**{field: edges[:-1]}).system.team.sheaf.laplacian().toarray()
    without = scenario(**{field: edges[1:-1]}).system.team.sheaf.laplacian().toarray()
    np.testing.assert_allclose(twice - once, once - without, atol=1e-14)


@pytest.mark.parametrize("case", DIFFERENT)
def test_edges_that_differ_are_no_duplicates(case: str) -> None:
    scenario(**yaml.safe_load(case))


@pytest.mark.parametrize(
    ("edges", "words"),
    [
        (
            "sensing: [[T, Q1]]",
            "[T, Q1]: expected [agent, target], but T is a target and Q1 is an agent; write [Q1, T]",
        ),
        ("communication: [[Q1, T]]", "[Q1, T]: expected [agent, agent], but Q1 is an agent and T is a target"),
        ("communication: [[Q1, o1]]", "unknown id 'o1'; expected one of Q1, O1; did you mean O1?"),
        ("target_edges: [[S, TT]]", "unknown id 'TT'; expected one of T, S; did you mean T?"),
    ],
)
def test_ends_that_do_not_fit_are_told_in_words(edges: str, words: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario(**yaml.safe_load(edges))
    assert str(refused.value) == f"scenario: {edges.partition(':')[0]}.0: {words}"
