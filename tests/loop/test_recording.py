"""Data recorded in the compiled loop on bodies equal those of a world that is stepped from Python."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mjsheaf import Session, World, simulate, simulate_many
from mjsheaf.arrays import Array
from mjsheaf.live.live import Recorder
from mjsheaf.loop.engine import Log
from mjsheaf.loop.loop import ClosedLoop
from mjsheaf.loop.system import System
from mjsheaf.results.dataset import make_datasets
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, mixed_scenario
from tests.running import run_ideal, run_physics, stream_ideal, stream_physics

RECORDED = (
    *("positions", "origin", "velocity", "command", "residual"),
    *("quaternions", "thruster_command", "thruster_output", "saturation"),
)


def looked_at(system: System, targets: Array | None) -> dict[str, Array]:
    """The same samples by the world's own methods; targets are moved by MuJoCo's arrays."""
    body, N = World(system), len(system.team.agents)
    samples = system.grid.steps + 1 if targets is None else len(targets)
    seen: dict[str, list[Array]] = {name: [] for name in RECORDED}
    for k in range(samples):
        if targets is not None:
            shift = targets[k] - body.positions()[N:]
            for v in range(N, len(body.arena.vehicles)):
                at, n = body.arena.qpos[v], body.arena.vehicles[v].dimension
                body.data.qpos[at : at + n] += shift[v - N, :n]
        body.close_loop(sample=True)
        velocity = body.data.qvel[body.arena.dof[:, None] + np.arange(3)]
        origin = body.data.qpos[body.arena.qpos[:, None] + np.arange(3)]
        lag = body.model.actuator_actadr
        output = body.model.actuator_gainprm[:, 0] * np.where(lag < 0, body.data.ctrl, np.append(body.data.act, 0)[lag])
        now = (body.positions(), origin, velocity, body.command.copy(), body.disagreement.copy())
        thrust = body.quaternions(), body.data.ctrl.copy(), output, body.saturation()
        for name, value in zip(RECORDED, (*now, *thrust), strict=True):
            seen[name].append(value)
        if k + 1 < samples:
            body.step(body.steps_per_sample)
    return {name: np.array(values) for name, values in seen.items()}


@pytest.mark.parametrize("chunk", [7, 4000], ids=["many-chunks", "one-chunk"])
@pytest.mark.parametrize("period", [0.0, 0.01], ids=["continuous", "held"])
@pytest.mark.parametrize("placed", [False, True], ids=["own-targets", "placed-targets"])
def test_samples_are_those_of_the_world_looked_at(
    placed: bool, period: float, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ClosedLoop, "_at_once", chunk * 5)
    fields: dict[str, Any] = {"time": {"end": 0.2}, "controller": {"gain": 30.0, "control_period": period}}
    system = mixed_scenario(**fields, disturbance={"agents": {"bound": 1.0}}).system
    time = np.linspace(0.0, 0.15, 16)[:, None, None]
    path = system.initial[3:] + np.concatenate([np.sin(time), time, 0.0 * time], axis=2)
    targets = path if placed else None
    trajectory = run_physics(system, targets=targets)
    assert len(trajectory.time) == (16 if placed else 21)
    for name, expected in looked_at(system, targets).items():
        np.testing.assert_array_equal(getattr(trajectory.log, name), expected, err_msg=name)
    if placed:
        np.testing.assert_allclose(trajectory.positions[:, 3:], path, rtol=0, atol=1e-14)


@pytest.mark.parametrize("samples", [1, 5, 16, 40])
@pytest.mark.parametrize("placed", [False, True], ids=["own-targets", "placed-targets"])
@pytest.mark.parametrize("backend", [(run_physics, stream_physics), (run_ideal, stream_ideal)], ids=["bodies", "ideal"])
def test_pieces_are_the_run(backend: Any, placed: bool, samples: int) -> None:
    """Bit for bit, whatever their length, also where it divides the run."""
    whole_run, stream = backend
    system = mixed_scenario(time={"end": 0.15}, disturbance={"agents": {"bound": 1.0}}).system
    targets = system.initial[3:] + np.linspace(0.0, 0.15, 16)[:, None, None] * [1.0, -2.0, 0.0] if placed else None
    whole = whole_run(system, targets=targets)
    pieces = list(stream(system, samples, targets=targets))
    assert [len(piece.time) for piece in pieces[:-1]] == [samples] * (len(pieces) - 1)
    np.testing.assert_array_equal(np.concatenate([piece.time for piece in pieces]), whole.time)
    for name in Log._fields:
        together = np.concatenate([getattr(piece.log, name) for piece in pieces])
        np.testing.assert_array_equal(together, getattr(whole.log, name), err_msg=name)


def test_progress_ends_at_the_last_sample_and_may_stop_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ClosedLoop, "_at_once", 250)
    seen: list[tuple[int, int]] = []
    system = mixed_scenario(time={"end": 0.2}).system
    run_physics(system, lambda done, of: seen.append((done, of)))
    assert seen[-1] == (20, 20)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)

    def stop(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_physics(system, stop)


RANGES = [{"between": ["B", target], "measures": "range", "offset": [4.0]} for target in ("T", "S")]


def two_places(ranges: Sequence[Any] = RANGES) -> Scenario:
    """B keeps two distances, which two places do; the line between the targets sweeps over it."""
    swinging = {"kind": "lissajous", "amplitude": [1, 8], "rate": [0.5, 1.5]}
    return build_scenario(
        {"A": [0, 0], "B": [3, -2]},
        {"T": {"position": [0, 0], "motion": {"kind": "fixed"}}, "S": {"position": [6, 0.5], "motion": swinging}},
        [["A", "T"], *ranges],
        communication=[["A", "B"]],
        time={"end": 2.0},
        controller={"gain": 0.2, "control_period": 0.02},
        events=[{"time": 0.1, "cut": ["A", "B"]}],
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", [("ideal", "mujoco"), pytest.param(("physics", "fused"), marks=pytest.mark.slow)])
@pytest.mark.parametrize("free", [False, True], ids=["two-places", "free"])
def test_the_harmonic_extension_does_not_depend_on_the_pieces(kind: tuple[str, str], free: bool) -> None:
    """Random pieces of a run, one after the other, have the q* of the whole; so has a run among many."""
    backend, engine = kind
    scenario = two_places(RANGES[:1] if free else RANGES)
    options: dict[str, Any] = {"engine": engine, "allow_drift": True, "progress": False}
    whole = simulate(scenario, backend, threads=1, **options)
    (alone,) = simulate_many([scenario], backend, **options)
    assert isinstance(alone, xr.Dataset)
    np.testing.assert_array_equal(alone.harmonic_extension, whole.harmonic_extension)
    for samples in np.random.default_rng(0).integers(1, 40, 4).tolist():
        with Session(scenario, backend, engine=engine, allow_drift=True) as session:
            pieces = list(make_datasets(session.engine.record(samples), backend, 0, session.engine.phases))
        for name in ("agent_position", "harmonic_extension", "tracking_error"):
            found = np.concatenate([piece[name].values for piece in pieces])
            np.testing.assert_array_equal(found, whole[name].values, err_msg=f"{name} in pieces of {samples}")


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
def test_the_harmonic_extension_of_a_live_session_is_that_of_the_run(seed: int) -> None:
    rng, scenario = np.random.default_rng(seed), two_places()
    whole = simulate(scenario, "ideal", progress=False)
    chunks = []
    with Session(scenario, "ideal") as session:
        recorder = Recorder(session)
        while not session.finished:
            chunks.append(recorder.record(int(rng.integers(1, 20)))[0])
    found = np.concatenate([chunk.harmonic_extension.values for chunk in chunks if chunk is not None])
    np.testing.assert_array_equal(found, whole.harmonic_extension.values[: len(found)])
