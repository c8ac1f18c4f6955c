"""Errors in metres say which norm they are: RMS over agents, or the norm of the whole team.

Oracle: runs, whose tracking error is the RMS over agents.
"""

import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import mjsheaf
from tests.builders import make_fields
from tests.commands import Capture, call
from tests.running import analyse, rms_error

ERRORS = {"radius", "radius_U", "initial_error", "between", "largest", "unlimited", "noise_rms", "error", "mean"}
ERRORS |= {"bound", "jump", "tracking_error"}
NOT_IN_METRES = {"loss"}  # records whose fields of these names are ratios


def records(value: Any, name: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every record inside a record, with the name of its field."""
    if isinstance(value, dict):
        yield name, value
    for key, inner in value.items() if isinstance(value, dict) else [(name, x) for x in value]:
        if isinstance(inner, dict | list):
            yield from records(inner, key)


def errors_of(record: dict[str, Any]) -> set[str]:
    return {name for name in ERRORS & record.keys() if isinstance(record[name], float)}


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("certified", {}),
        ("steady_current", {"links.all.noise": 0.05, "links.all.loss": 0.1}),
        ("steady_current", {"events": [{"time": 20.0, "set": {"controller.gain": 3.0}}]}),
    ],
)
def test_every_error_of_check_states_its_norm(name: str, changes: dict[str, Any]) -> None:
    scenario = mjsheaf.load_scenario(name, changes)
    root = np.sqrt(len(scenario.team.agents))
    found = set()
    for field, record in records(analyse(scenario)):
        if field in NOT_IN_METRES or not (errors := errors_of(record)):
            continue
        assert record["norm"] in ("per_agent_rms", "team_norm"), field
        found |= errors
        for error in errors:
            if (own := record.get(f"{error}_per_agent")) is not None:
                assert record["norm"] == "team_norm"
                assert own == pytest.approx(record[error] / root, rel=1e-12)
    assert {"initial_error"} <= found


@pytest.mark.long
def test_every_error_of_a_run_states_its_norm(tmp_path: Path, capsys: Capture) -> None:
    out = tmp_path / "out"
    events = '--set=events=[{"time": 0.5, "set": {"controller.gain": 3.0}}]'
    options = ("--backend", "ideal", "--no-video", "--set", "time.end=1", events)
    assert call("run", "certified", *options, "--out", out) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "RMS over agents" in printed
    summary = json.loads((out / "summary.json").read_text())
    held = [record for _, record in records(summary) if "tracking_error" in record]
    assert len(held) >= 3
    assert all(record["norm"] == "per_agent_rms" for record in held)
    with xr.open_dataset(out / "result.nc") as run:
        last = run["tracking_error"].values[-1]
    assert summary["final"]["tracking_error"] == pytest.approx(float(np.sqrt((last**2).mean())), rel=1e-12)


def test_the_noise_of_check_is_that_of_runs_in_the_same_measure(capsys: Capture) -> None:
    """The finding: 0.2805 m by `check`, 0.1256 m by the run, of one and the same team."""
    ids = [f"A{k}" for k in range(5)]
    raw = make_fields(
        {id: [float(k), 0.0] for k, id in enumerate(ids)},
        {"T": [2.0, 0.0]},
        [["A0", "T"], ["A4", "T"]],
        time={"end": 60},
        controller={"gain": 2.0, "control_period": 0.05},
        physics={"timestep": 0.05},
        communication=[list(pair) for pair in itertools.pairwise(ids)],
        links={"all": {"noise": 0.3}},
    )
    links = analyse(raw)["links"]
    assert links["norm"] == "team_norm"
    runs = [mjsheaf.simulate(mjsheaf.load_scenario(raw | {"seed": seed}), backend="ideal") for seed in range(4)]
    rms = np.sqrt(np.mean([rms_error(run)[400:] ** 2 for run in runs]))
    assert links["noise_rms_per_agent"] == pytest.approx(rms, rel=0.1)
    assert links["noise"]["error_per_agent"] == links["noise_rms_per_agent"]
    assert links["noise_rms"] == pytest.approx(np.sqrt(5.0) * links["noise_rms_per_agent"], rel=1e-12)


def test_the_terminal_gives_the_rms_and_calls_the_norm_one(capsys: Capture) -> None:
    assert call("check", "certified", "--no-trial", "--full") == 0
    printed = capsys.readouterr().out
    theorem = analyse("certified")["theorem"]
    assert f"the error ends below {theorem['radius_U_per_agent']:.3g} m (RMS over agents)" in " ".join(printed.split())
    assert f"{theorem['radius_U']:.5g} (RMS {theorem['radius_U_per_agent']:.5g})" in printed
