"""A velocity limit below the speed that q* takes is named, and only such a one.

Oracle: the ideal run, which falls behind for ever or does not.
"""

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.checking import examine
from tests.builders import build_scenario
from tests.commands import Capture, call
from tests.running import analyse

DRIFT = 1.25  # m/s, which both agents must make up for to stay where they are


@pytest.mark.slow(first=True)
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
    """Of two boats in a current about a target that stands still."""
    scenario = build_scenario(
        {
            "A": {"position": [1.0, 0.0], "velocity_limit": limits[0]},
            "B": {"position": [-1.0, 2.0], "velocity_limit": limits[1]},
        },
        {"T": [0, 0]},
        [["A", "T"], ["B", "T"]],
        communication=[["A", "B"]],
        time={"end": 60},
        controller={"gain": 2.0},
        flow={"agents": {"dimension": 2, "drift": [0.75, -1.0]}},
    )
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
        assert problem.why.startswith(f"{short} stays ")
        assert DRIFT < problem.changes["controller.velocity_limit"] < 1.3 * DRIFT
        assert late[-1] > late[0] + 1.0  # it is carried away


@pytest.mark.slow
@pytest.mark.parametrize("limit", [0.4, 1.0, 1.7])
def test_one_that_is_outrun_on_a_circle_stays_within_it(limit: float) -> None:
    """Pure pursuit of a point on a circle of radius R at speed v ends on a circle of radius R top / v."""
    radius, rate = 2.0, 0.8
    place = {"amplitude": [radius, radius], "rate": [rate, rate], "phase": [np.pi / 2, 0.0]}
    target = {"position": [radius, 0], "motion": {"kind": "lissajous", "pull": 50.0, **place}}
    law = {"gain": 2.0, "velocity_limit": limit}
    scenario = build_scenario({"A": [0, 0]}, {"T": target}, [["A", "T"]], time={"end": 60}, controller=law)
    (demand,) = examine(scenario.system).record.margins.speed
    assert demand.steady is not None
    assert demand.steady == pytest.approx(radius * rate, rel=1e-2)  # its target's field pulls it within the circle
    expected = demand.steady / rate * np.sqrt(max(1.0 - (limit / demand.steady) ** 2, 0.0))
    assert demand.deficit == pytest.approx(expected, rel=0.01)
    late = simulate(scenario, "ideal")["tracking_error"].values[-500:]
    assert demand.deficit < late.min()  # the law turns to where its target is, too, and slows down as it comes near


@pytest.mark.long
def test_the_speeds_of_a_vehicle_have_names(capsys: Capture) -> None:
    """5.95, 5.28 and 3.85 m/s were three numbers for "a WAM-V": two vehicles, forward and in every direction."""
    assert call("list", "--vehicles") == 0
    rows: dict[str, list[str]] = {}
    listed = capsys.readouterr().out
    assert "all-way" in listed
    for line in listed.splitlines():
        if words := line.split():
            rows.setdefault(words[0], words)  # the table comes first
    assert rows["wamv"][-2:] == ["6.34", "5.95"]
    assert rows["wamv_azimuth"][-2:] == ["5.28", "3.85"]
    changes = {"vehicles.agents": "wamv_azimuth", "time.end": 2}
    for speed in analyse("steady_current", changes)["margins"]["speed"]:
        assert speed["able"] == pytest.approx(3.853, abs=1e-3)
        assert speed["able_forward"] == pytest.approx(5.278, abs=1e-3)
    options = [word for field, value in changes.items() for word in ("--set", f"{field}={value}")]
    assert call("check", "steady_current", "--no-trial", "--full", *options) in (0, 1)
    printed = " ".join(capsys.readouterr().out.split())
    assert "3.853" in printed
