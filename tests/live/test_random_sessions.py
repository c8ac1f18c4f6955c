"""A session that its user changes at random is repeated by its recording, to the bit.

Oracle: `simulate` of the recorded scenario.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import Session, load_scenario, simulate
from mjsheaf.errors import MjsheafError
from mjsheaf.live.live import Recorder
from mjsheaf.runs.publish import write_scenario
from mjsheaf.scenario import Scenario

PERIODS = 50
SCENARIOS: dict[str, tuple[str, dict[str, Any]]] = {
    "paper": ("paper", {}),
    "paper over links": (
        "paper",
        {"controller.integral.gain": 0.5, "links.all.delay": 0.03, "links.all.noise": 0.1, "links.all.loss": 0.2},
    ),
    "feedforward": ("paper_feedforward", {}),
    "extrapolated": ("harbour_feedforward", {"controller.feedforward.extrapolate": True}),
    "newton": ("midpoint", {"controller.newton.rounds": 2, "controller.integral.gain": 0.1}),
    "all terms": (
        "paper_feedforward",
        {"controller.newton.rounds": 3, "controller.drift.filter": 0.1, "controller.integral.gain": 0.2},
    ),
    "lossy rounds": ("paper_feedforward", {"links.rounds.delay": 0.02, "links.rounds.loss": 0.1}),
    "links": ("harbour_feedforward", {"links.all.noise": 0.05, "links.all.loss": 0.2, "links.sensing.delay": 0.04}),
    "safety": ("paper_safe", {}),
    "gusts": ("harbour_gusts", {}),
    "bearings": ("bearing_formation", {}),
    "ranges": ("range_formation", {}),
    "directed": ("leader_follower", {}),
    "formations": ("narrow_gate", {"events": [{"time": 0.5, "set": {"formations.boats.radius": 10}, "over": 4}]}),
}
ENGINES = [("ideal", "mujoco"), ("physics", "mujoco"), ("physics", "fused")]
NAMES = ("agent_position", "target_position", "disagreement", "tracking_error", "velocity_command", "phase")


def shortened(name: str) -> Scenario:
    base, overrides = SCENARIOS[name]
    overrides = {"physics.contacts": False, **overrides}
    grid = load_scenario(base, overrides).whole.grid
    return load_scenario(base, {"events": [], **overrides, "time.end": grid.start + PERIODS * grid.period})


def random_action(rng: np.random.Generator, scenario: Scenario) -> dict[str, Any]:
    links = [list(edge.between) for edge in (*scenario.team.communication, *scenario.team.sensing)]
    ids = [*scenario.team.agent_ids, *scenario.team.target_ids]
    kind = rng.choice(["cut", "restore", "lose", "join", "gain", "flow"])
    if kind in ("cut", "restore"):
        return {str(kind): links[rng.integers(len(links))]}
    if kind in ("lose", "join"):
        return {str(kind): ids[rng.integers(len(ids))]}
    size = float(rng.uniform(0.3, 1.5))
    return {str(kind): size * scenario.controller.gain if kind == "gain" else size}


def require_repeated(name: str, backend: str, engine: str, seed: int, folder: Path) -> int:
    """Drive a session at random, compare it with its recording, and return the number of actions that it took."""
    scenario = shortened(name)
    rng = np.random.default_rng(seed)
    chunks: list[xr.Dataset] = []
    with Session(scenario, backend, engine=engine) as session:
        recorder = Recorder(session)
        while recorder.samples <= PERIODS:
            for _ in range(int(rng.integers(1, 8))):
                try:
                    recorder.do(random_action(rng, scenario))
                except MjsheafError:  # not possible now
                    continue
            chunk, message = recorder.record(int(rng.integers(1, 15)))
            assert not message
            assert chunk is not None
            chunks.append(chunk)
        recorded = session.scenario
    given: dict[str, Any] = {"engine": engine, "threads": 1, "progress": False}
    again = simulate(load_scenario(str(write_scenario(recorded, folder))), backend, **given)
    untouched = simulate(scenario, backend, **given)
    assert not np.array_equal(untouched.agent_position, again.agent_position)
    for variable in NAMES:
        seen = np.concatenate([chunk[variable].values for chunk in chunks])
        np.testing.assert_array_equal(seen, again[variable].values, err_msg=f"{name} {seed} {variable}")
    return len(recorder.events)


@pytest.mark.parametrize("name", ["feedforward", "newton", "paper over links"])
def test_a_random_session_is_repeated_by_its_recording(name: str, tmp_path: Path) -> None:
    assert require_repeated(name, "ideal", "mujoco", 1, tmp_path) > 3


@pytest.mark.long
@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize(("backend", "engine"), ENGINES)
def test_random_sessions_of_all_laws_are_repeated(name: str, backend: str, engine: str, tmp_path: Path) -> None:
    taken = 0
    for seed in range(4):
        folder = tmp_path / str(seed)
        folder.mkdir()
        taken += require_repeated(name, backend, engine, seed, folder)
    assert taken > 12
