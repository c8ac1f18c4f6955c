"""The targets' own law under a hold: consensus and pull.

Oracles: runs on both backends, whose targets grow or decay by the factor that `check` names.
"""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.scenario import Scenario
from tests.builders import make_fields, require
from tests.commands import Answer, Capture, call
from tests.running import analyse


def pulled(pull: float, **fields: Any) -> dict[str, Any]:
    """A target in a current, pulled back to its place once in 0.1 s, and a boat that follows it."""
    usual = make_fields(
        {"A": [0, 0]},
        {"T": {"position": [0, 0], "motion": {"kind": "static", "pull": pull}}},
        [["A", "T"]],
        time={"end": 1.5},
        controller={"gain": 1, "control_period": 0.1},
        physics={"timestep": 0.1},
        flow={"targets": {"dimension": 2, "drift": [0.1, 0]}},
    )
    return usual | fields


def together(pull: float, gain: float) -> dict[str, Any]:
    """Three targets in a ring of consensus, two of them pulled to their places."""
    motions = [{"motion": {"kind": "static", "pull": pull}}, {"motion": {"kind": "static", "pull": 0.5 * pull}}, {}]
    targets = [{"id": f"T{k}", "position": [3.0 * k, float(k == 1)]} | motions[k] for k in range(3)]
    ring, seen = [["T0", "T1"], ["T1", "T2"], ["T2", "T0"]], [["A", f"T{k}"] for k in range(3)]
    return pulled(pull, targets=targets, sensing=seen, target_edges=ring, target_formation={"gain": gain})


def positions(scenario: Scenario, backend: Any = "ideal") -> Any:
    """Positions of the targets in a run, stacked, shape (T, n_p), m."""
    result = mjsheaf.simulate(scenario, backend=backend)
    planar = np.nan_to_num(result.target_position.values[..., :2])
    return planar.reshape(len(planar), -1)


def test_a_pull_that_diverges_under_the_hold_is_not_certified(capsys: Capture, tmp_path: Any) -> None:
    """The finding: "all 7 assumptions hold", a bound of 2e12 m and exit code 0, where pull times hold is 2.5."""
    path = tmp_path / "held_pull.yaml"
    path.write_text(json.dumps(pulled(25.0, time={"end": 8})))
    assert call("check", path, "--no-trial", "--json") == 1
    printed = capsys.readouterr()
    record = json.loads(printed.out)
    require(record, {"ok": False, "targets.stable": False, "targets.product": pytest.approx(2.5)})
    require(record, {"targets.spectral_radius": pytest.approx(1.5), "targets.targets": ["T"]})
    require(record, {"targets.largest_period": pytest.approx(0.08), "targets.bodies.stable": False})
    require(record, {"law.radius": None, "theorem.applies": False})
    assert record["assumptions"][6]["verdict"] == "fails"
    for words in ("pull of T", "2.5", "below 2", "control_period below 0.08 s", "motion.pull"):
        assert words in printed.err
    assert call("check", path, "--no-trial") == 1
    assert "the targets' own held law diverges" in " ".join(capsys.readouterr().out.split())


def test_the_fix_that_is_named_is_one() -> None:
    changed = pulled(25.0, controller={"gain": 1, "control_period": 0.079}, physics={"timestep": 0.079})
    record = analyse(changed | {"time": {"end": 1.58}})
    assert record["targets"]["stable"] is True
    assert record["law"]["radius"] is not None
    controller = {"gain": 1, "control_period": 0, "record_period": 0.1}
    record = analyse(pulled(25.0, controller=controller, physics={"timestep": 0.01}))
    require(record, {"ok": True, "targets.product": None, "targets.stable": True})


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(("pull", "gain"), [(3.0, 6.0), (8.0, 5.0), (16.0, 1.0), (4.0, 4.0)])
def test_consensus_and_pull_act_together(pull: float, gain: float) -> None:
    """Neither 8 + 15 nor either alone decides: the largest eigenvalue of the sum does."""
    scenario = mjsheaf.load_scenario(together(pull, gain) | {"time": {"end": 12.0}})
    targets = analyse(scenario)["targets"]
    L = 3.0 * np.eye(3) - np.ones((3, 3))
    values = np.linalg.eigvalsh(gain * L + np.diag([pull, 0.5 * pull, 0.0]))
    assert targets["rate"] == pytest.approx(values[-1])
    assert targets["spectral_radius"] == pytest.approx(np.abs(1.0 - 0.1 * values).max())
    assert targets["stable"] is bool(0.1 * values[-1] < 2.0)
    steps = np.linalg.norm(np.diff(positions(scenario), axis=0), axis=1)
    assert bool(steps[-1] < steps[-40]) is targets["stable"]
    growth = (steps[-1] / steps[-21]) ** (1.0 / 20.0)
    assert growth == pytest.approx(targets["spectral_radius"], rel=1e-2)


@pytest.mark.parametrize("pull", [12.0, 25.0, 45.0])
def test_targets_on_bodies(pull: float) -> None:
    """A vehicle follows its command with a lag: the factor over a period is another one, that of the run."""
    fields = pulled(pull, time={"end": 4.0}, physics={"timestep": 0.01})
    fields["flow"] = {"targets": {"dimension": 2, "drift": [1e-6, 0.0]}}
    scenario = mjsheaf.load_scenario(fields)
    bodies = analyse(scenario)["targets"]["bodies"]
    assert bodies["stable"] is bool(bodies["spectral_radius"] < 1.0)
    steps = np.abs(np.diff(positions(scenario, "physics")[:, 0]))
    growth = (steps[-6:].max() / steps[-26:-20].max()) ** (1.0 / 20.0)
    assert bool(growth < 1.0) is bodies["stable"]
    if not bodies["stable"]:
        assert growth == pytest.approx(bodies["spectral_radius"], rel=0.02)


def test_targets_that_nothing_holds_are_none_of_it(checked: Callable[[str], Answer]) -> None:
    targets = json.loads(checked("certified").out)["targets"]
    require(targets, {"rate": 0.0, "stable": True, "bodies": None})


@pytest.mark.parametrize("place", [0, 1])
def test_a_target_without_thrusters_beside_one_that_is_pulled(place: int) -> None:
    """A buoy drifts, in whichever place of the list it is, and leaves the loop of the other target as stable."""
    fields = pulled(5.0, physics={"timestep": 0.01}, sensing=[["A", "T"], ["A", "B"]])
    fields["targets"].insert(place, {"id": "B", "position": [3, 0], "vehicle": "buoy", "motion": {"kind": "static"}})
    bodies = analyse(fields)["targets"]["bodies"]
    require(bodies, {"stable": True, "spectral_radius": pytest.approx(1.0)})
