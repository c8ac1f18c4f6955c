"""The same edge twice counts double: it is refused unless the file says that it is meant.

Oracle: the Laplacian of the team, in which a parallel edge adds its weight.
"""

from typing import Any

import numpy as np
import pytest

from mjsheaf.errors import ScenarioError
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, refused


def scenario(**fields: Any) -> Scenario:
    members = {"Q1": [0, 0, 3], "O1": [1, 0]}, {"T": [5, 5], "S": [6, 5]}, [["Q1", "T"], ["O1", "T"]]
    usual = {"time": {"end": 1}, "anchors": [{"agent": "Q1", "axes": ["z"], "value": [3]}]}
    return build_scenario(*members, **(usual | fields))


SAME: dict[str, tuple[str, list[Any]]] = {
    "again": ("communication", [["Q1", "O1"], ["Q1", "O1"]]),
    "the other way round": ("communication", [["Q1", "O1"], ["O1", "Q1"]]),
    "another between them": ("sensing", [["Q1", "T"], ["O1", "T"], ["Q1", "T"]]),
    "of targets": ("target_edges", [["S", "T"], ["T", "S"]]),
    "an offset with its sign turned": (
        "communication",
        [{"between": ["Q1", "O1"], "offset": [1, 0]}, {"between": ["O1", "Q1"], "offset": [-1, 0]}],
    ),
    "maps written out": (
        "communication",
        [["Q1", "O1"], {"between": ["O1", "Q1"], "map": {"tail": [[1, 0], [0, 1]], "head": [[1, 0, 0], [0, 1, 0]]}}],
    ),
    "a weight of one": ("communication", [["Q1", "O1"], {"between": ["Q1", "O1"], "weight": 1}]),
    "anchors": ("anchors", [{"agent": "Q1", "axes": ["z"], "value": [3]}] * 2),
}
DIFFERENT: dict[str, tuple[str, list[Any]]] = {
    "weight": ("communication", [["Q1", "O1"], {"between": ["O1", "Q1"], "weight": 2}]),
    "offset": ("communication", [["Q1", "O1"], {"between": ["O1", "Q1"], "offset": [1, 0]}]),
    "offsets of one sign": (
        "communication",
        [{"between": ["Q1", "O1"], "offset": [1, 0]}, {"between": ["O1", "Q1"], "offset": [1, 0]}],
    ),
    "map": ("communication", [["Q1", "O1"], {"between": ["Q1", "O1"], "map": {"tail": [[1, 0, 0]], "head": [[1, 0]]}}]),
    "anchors of other axes": (
        "anchors",
        [{"agent": "Q1", "axes": ["z"], "value": [3]}, {"agent": "Q1", "axes": ["x"], "value": [3]}],
    ),
    "value": ("anchors", [{"agent": "Q1", "axes": ["z"], "value": [v]} for v in (3, 4)]),
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_edge_twice_is_refused_and_both_are_named(case: str) -> None:
    field, edges = SAME[case]
    with refused(ScenarioError, f"{field}.{len(edges) - 1}", f"{field}.0", "parallel: true"):
        scenario(**{field: edges})


@pytest.mark.parametrize("case", SAME)
@pytest.mark.parametrize("which", [0, -1])
def test_a_parallel_edge_that_is_meant_counts_beside_the_other(case: str, which: int) -> None:
    field, edges = SAME[case]
    plain = [{"between": edge} if isinstance(edge, list) else edge for edge in edges]
    plain[which] = {**plain[which], "parallel": True}
    twice = scenario(**{field: plain}).system.team.sheaf.laplacian().toarray()
    once = scenario(**{field: edges[:-1]}).system.team.sheaf.laplacian().toarray()
    without = scenario(**{field: edges[1:-1]}).system.team.sheaf.laplacian().toarray()
    np.testing.assert_allclose(twice - once, once - without, atol=1e-14)


@pytest.mark.parametrize("case", DIFFERENT)
def test_edges_that_differ_are_no_duplicates(case: str) -> None:
    field, edges = DIFFERENT[case]
    scenario(**{field: edges})


@pytest.mark.parametrize(
    ("field", "edge", "words"),
    [
        (
            "sensing",
            ["T", "Q1"],
            "[T, Q1]: expected [agent, target], but T is a target and Q1 is an agent; write [Q1, T]",
        ),
        ("sensing", ["Q1", "O1"], "[Q1, O1]: expected [agent, target], but Q1 is an agent and O1 is an agent"),
        ("communication", ["Q1", "T"], "[Q1, T]: expected [agent, agent], but Q1 is an agent and T is a target"),
        ("communication", ["Q1", "o1"], "unknown id 'o1'; expected one of Q1, O1; did you mean O1?"),
        ("target_edges", ["S", "TT"], "unknown id 'TT'; expected one of T, S; did you mean T?"),
    ],
)
def test_ends_that_do_not_fit_are_told_in_words(field: str, edge: list[str], words: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario(**{field: [edge]})
    assert str(refused.value) == f"scenario: {field}.0: {words}"
