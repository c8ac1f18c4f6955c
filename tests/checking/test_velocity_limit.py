"""A velocity limit below the speed that q* takes is named, and only such a one.

Oracle: the ideal run, which falls behind for ever or does not.
"""

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.checking.check import examine
from mjsheaf.scenario import Scenario, scenario_from_mapping

DRIFT = 1.25  # m/s, which both agents must make up for to stay where they are


def stream(limits: tuple[float | None, float | None]) -> Scenario:
    """Two boats in a current about a target that stands still."""
    places = {"A": [1.0, 0.0], "B": [-1.0, 2.0]}
    agents = [
        {"id": i, "position": x} | ({"velocity_limit": limit} if limit else {})
        for (i, x), limit in zip(places.items(), limits, strict=True)
    ]
    return scenario_from_mapping(
        {
            "name": "stream",
            "time": {"end": 60},
            "agents": agents,
            "targets": [{"id": "T", "position": [0, 0]}],
            "communication": [["A", "B"]],
            "sensing": [["A", "T"], ["B", "T"]],
            "controller": {"gain": 2.0},
            "flow": {"agents": {"dimension": 2, "drift": [0.75, -1.0]}},
        }
    )


@pytest.mark.parametrize(
    ("limits", "short"),
    [
        ((None, None), None),
        ((1.3, None), None),
        ((1.2, None), "A"),
        ((None, 0.5), "B"),
        ((1.2, 0.5), "B"),
        ((1.3, 1.27), None),
    ],
)
def test_a_limit_below_what_q_star_takes_is_named(limits: tuple[float | None, float | None], short: str | None) -> None:
    scenario = stream(limits)
    found = examine(scenario.system).record.problems
    error = simulate(scenario, "ideal")["tracking_error"]
    late = np.asarray(error[len(error) // 2 :].max("agent"))
    if short is None:
        assert not found
        assert np.ptp(late) < 1e-3  # it stays a constant lag behind
    else:
        (problem,) = found
        limit = limits["AB".index(short)]
        slow = sum(each is not None and each < DRIFT for each in limits)
        assert problem.what == f"{slow} of 2 agents are slower than their places ({limit:.3g} of {DRIFT:.3g} m/s)"
        assert problem.why.startswith(f"{short} falls ")
        assert DRIFT < problem.changes["controller.velocity_limit"] < 1.3 * DRIFT
        assert late[-1] > late[0] + 1.0  # it is carried away
