"""Standoff of the safety filter around q*: where agents of a run on ideal kinematics come to rest, and by hand."""

from typing import Any

import numpy as np
import pytest

from mjsheaf import load_scenario, simulate
from mjsheaf.checking import examine
from mjsheaf.checking.separation import SafetyRecord

DRIFT = 1.0  # m/s


def in_flow(place: tuple[float, float], **changes: Any) -> dict[str, Any]:
    """One boat at a place about a target that is pulled to the origin, in a uniform flow along x."""
    return {
        "name": "standoff",
        "time": {"end": 30.0},
        "controller": {"gain": 20.0, "control_period": 0.02, "velocity_limit": 20.0},
        "agents": [{"id": "A", "position": list(place)}],
        "targets": [{"id": "T", "position": [0.0, 0.0], "motion": {"kind": "static", "pull": 20.0}}],
        "sensing": [{"between": ["A", "T"], "offset": list(place)}],
        "flow": {"water": {"dimension": 2, "drift": [DRIFT, 0.0]}},
        "safety": {"distance": 2.0, "rate": 1.0},
        **changes,
    }


def behind() -> dict[str, Any]:
    """A boat that follows a target at 1 m/s in still water: the target might stop, as far as the filter knows."""
    path = {"kind": "recorded", "samples": [[0.0, 0.0, 0.0], [30.0, 30.0 * DRIFT, 0.0]]}
    raw = in_flow((-3.0, 0.0), targets=[{"id": "T", "position": [0.0, 0.0], "motion": path}])
    del raw["flow"]
    return raw


def two_anchored() -> dict[str, Any]:
    """Two boats that hold their places in a flow, one downstream of the other."""
    raw = in_flow((0.0, 0.0), targets=[], sensing=[])
    raw["agents"] = [{"id": "B", "position": [0.0, 0.0]}, {"id": "A", "position": [3.0, 0.0]}]
    raw["anchors"] = [{"agent": one["id"], "axes": ["x", "y"], "value": one["position"]} for one in raw["agents"]]
    return raw


def by_a_pile() -> dict[str, Any]:
    """A boat that holds its place downstream of a pile."""
    raw = in_flow((3.5, 0.0), targets=[], sensing=[])
    raw["anchors"] = [{"agent": "A", "axes": ["x", "y"], "value": [3.5, 0.0]}]
    raw["safety"] = raw["safety"] | {"obstacles": [{"kind": "sphere", "id": "P", "centre": [0.0, 0.0], "radius": 0.5}]}
    return raw


def record_of(raw: dict[str, Any]) -> SafetyRecord:
    found = examine(load_scenario(raw).phases).record.safety
    assert found is not None
    return found


def final_distance(raw: dict[str, Any], other: str) -> float:
    run = simulate(load_scenario(raw), backend="ideal")
    last = {str(id): place[:2] for id, place in zip(run["agent"].values, run["agent_position"].values[-1], strict=True)}
    if "target" in run:
        last |= zip(map(str, run["target"].values), run["target_position"].values[-1, :, :2], strict=True)
    surface = 0.5 if other == "P" else 0.0
    return float(np.linalg.norm(last["A"] - last.get(other, np.zeros(2))) - surface)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("raw", "other", "s"),
    [
        (in_flow((3.0, 0.0)), "T", 2.0 * DRIFT),  # downstream it pushes towards the target
        (in_flow((0.0, 3.0)), "T", DRIFT),  # abeam it does not
        (behind(), "T", 2.0 * DRIFT),
        (two_anchored(), "B", 2.0 * DRIFT),  # half of the constraint is its own: |w| / (1/2)
        (by_a_pile(), "P", 2.0 * DRIFT),
    ],
)
def test_agents_stop_at_the_standoff_and_reach_their_places_at_the_rate_that_suffices(
    raw: dict[str, Any], other: str, s: float
) -> None:
    (found,) = record_of(raw).out_of_reach()
    assert found.pair == ["A", other]
    assert found.desired == pytest.approx(3.0, abs=1e-3)
    assert found.kept == pytest.approx(s + np.hypot(s, 2.0), rel=0.01)
    assert found.rate == pytest.approx(2.0 * 3.0 * s / (9.0 - 4.0), rel=0.01)
    assert found.rate is not None
    assert found.fraction == 1.0
    assert final_distance(raw, other) == pytest.approx(found.kept, rel=0.02)
    faster = raw | {"safety": raw["safety"] | {"rate": 1.02 * found.rate}}
    assert record_of(faster).standoff == []
    assert final_distance(faster, other) == pytest.approx(3.0, abs=0.1)  # but for the law's own lag


def test_upstream_nothing_is_out_of_reach() -> None:
    assert record_of(in_flow((-3.0, 0.0))).out_of_reach() == []
    assert final_distance(in_flow((-3.0, 0.0)), "T") == pytest.approx(3.0, abs=0.1)


def test_no_rate_suffices_beyond_one_over_the_control_period() -> None:
    """At 0.5 s it is 2 1/s at most, and 2.4 1/s would be needed."""
    raw = in_flow((3.0, 0.0), controller={"gain": 1.0, "control_period": 0.5, "velocity_limit": 20.0})
    raw["targets"][0]["motion"]["pull"] = 1.0
    (found,) = record_of(raw).out_of_reach()
    assert found.rate is None


@pytest.mark.slow
def test_bodies_keep_more_and_what_is_unsafe_is_not_listed_again() -> None:
    raw = in_flow((3.0, 0.0))
    raw["agents"][0] |= {"vehicle": "otter", "velocity_limit": 3.0}
    found = record_of(raw)
    (on_bodies,) = found.out_of_reach(on_bodies=True)
    assert on_bodies.rate is None  # the distance and its stopping distance are more than 3 m
    assert on_bodies.kept > found.standoff[0].kept + 1.0
    near = record_of(in_flow((1.5, 0.0)))
    assert [one.pair for one in near.unsafe] == [["A", "T"]]
    assert near.standoff == []
