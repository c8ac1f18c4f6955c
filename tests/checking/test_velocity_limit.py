"""A velocity limit below the speed that q* takes is named, and only such a one.

Oracle: the ideal run, which falls behind for ever or does not.
"""

import re

import numpy as np
import pytest
from rich.console import Console

from mjsheaf import simulate
from mjsheaf.checking.check import examine
from mjsheaf.checking.report import report
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


def told(scenario: Scenario) -> str:
    console = Console(width=400)
    with console.capture() as captured:
        console.print(report(examine(scenario.system).record))
    return captured.get()


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
    found = re.search(r"velocity limit +│ +([\d.]+) m/s +│ of (\w+), BELOW the ([\d.]+) m/s that q\*", told(scenario))
    error = simulate(scenario, "ideal")["tracking_error"]
    late = np.asarray(error[len(error) // 2 :].max("agent"))
    if short is None:
        assert found is None
        assert np.ptp(late) < 1e-3  # it stays a constant lag behind
    else:
        assert found is not None
        assert found[2] == short
        assert float(found[1]) == limits["AB".index(short)]
        assert float(found[3]) == pytest.approx(DRIFT, rel=1e-3)
        assert late[-1] > late[0] + 1.0  # it is carried away
    assert (", as are those of 1 more" in told(scenario)) == (limits == (1.2, 0.5))
