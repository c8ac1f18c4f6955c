"""Scenarios refused before a run are refused by every command, on both backends, with the same message.

Oracle: each way in against the others.
"""

import itertools
from pathlib import Path
from typing import Any

import pytest

from mjsheaf import load_scenario, simulate, simulate_many
from mjsheaf.errors import InputError
from mjsheaf.files import dump_yaml
from mjsheaf.runs.expecting import try_scenario
from mjsheaf.studies.plan import load_plan
from mjsheaf.studies.workers import run_job
from tests.builders import make_fields, make_scenario, mixed_scenario, refused
from tests.commands import answer_of

BACKENDS = ("ideal", "physics")
BAD: dict[str, tuple[str, Any, tuple[Any, ...]]] = {
    "unknown": ("agents.A.vehicle", "nonsense", ("agents.A.vehicle", "nonsense")),
    "of another dimension": ("agents.A.vehicle", "quadrotor", ("agents.A.vehicle", "quadrotor", 3, 2)),
    "a target's": ("targets.T.vehicle", "nonsense", ("targets.T.vehicle", "nonsense")),
    "too slow": ("vehicles", {"agents": "otter", "tau": 30.0}, ("otter", "time constant")),
}
ONE = make_fields({"A": [0, 0]}, {"T": [3, 0]}, [["A", "T"]], time={"end": 0.1})


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("case", BAD)
def test_a_vehicle_that_does_not_fit_is_refused_everywhere(case: str, backend: str, tmp_path: Path) -> None:
    path, value, named = BAD[case]
    file = tmp_path / "one.yaml"
    file.write_text(dump_yaml(ONE))
    scenario = load_scenario(file, {path: value})
    with refused(InputError, *named) as caught:
        simulate(scenario, backend)
    reason = str(caught.value)
    (of_many,) = simulate_many([scenario], backend)
    assert isinstance(of_many, InputError)
    assert str(of_many) == reason
    with pytest.raises(InputError) as of_trial:
        try_scenario(scenario, backend)
    assert str(of_trial.value) == reason
    plan = load_plan(str(file), overrides={path: value}, backend=backend)
    record = run_job(plan.job(plan.points[0])).record
    assert (record["status"], record["message"]) == ("invalid", reason)
    answer = answer_of("run", file, "--backend", backend, "--set", f"{path}={value}", "--out", tmp_path / "out")
    assert answer.code == 2
    assert reason in answer.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("tau", [None, 1e-3, 0.05, 10.0])
def test_what_vehicles_are_unless_named_fits_whatever_the_effects(tau: float | None) -> None:
    """The guard does not look at them."""
    names = ("inertia", "drag_law", "limits", "lag", "underactuation")
    for flags in itertools.product([True, False], repeat=len(names)):
        effects = dict(zip(names, flags, strict=True))
        fields: dict[str, Any] = {"physics": {"effects": effects}, "vehicles": {"tau": tau}}
        assert len(make_scenario({**ONE, **fields}).system.vehicles) == 2
        assert len(mixed_scenario(**fields).system.vehicles) == 5
