"""Whole runs and runs in pieces of a System or of phases, as tests take them; their errors; answers of `check`."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import mjsheaf
from mjsheaf.arrays import Array
from mjsheaf.compile.tiers import Tiered
from mjsheaf.law.in_python import Controller, Law
from mjsheaf.law.law import Memory, carry, evaluate_law, look, new_memory
from mjsheaf.loop.engine import Trajectory
from mjsheaf.loop.session import engine_of
from mjsheaf.loop.system import Phase, System
from mjsheaf.scenario import Scenario

Run = System | Sequence[Phase]
Progress = Callable[[int, int], None]
OwnLaw = Law | Controller | None

sample_law = Tiered(evaluate_law, seconds=1e3, numbers=np.inf, records=True)
"""`evaluate_law` in Python: some samples of terms over links take less than compiling it, which runs do."""


def run_ideal(
    run: Run, progress: Progress | None = None, targets: Array | None = None, controller: OwnLaw = None
) -> Trajectory:
    return engine_of(run, "ideal", controller=controller).run(targets, progress)


def run_physics(
    run: Run, progress: Progress | None = None, targets: Array | None = None, controller: OwnLaw = None
) -> Trajectory:
    return engine_of(run, controller=controller).run(targets, progress)


def stream_ideal(run: Run, samples: int, *, targets: Array | None = None) -> Iterator[Trajectory]:
    return engine_of(run, "ideal").record(samples, targets)


def stream_physics(run: Run, samples: int, *, targets: Array | None = None) -> Iterator[Trajectory]:
    with engine_of(run) as engine:
        yield from engine.record(samples, targets)


def ideal_errors(system: System, *, may_blow_up: bool = False) -> Array:
    """Return e = q* - q of a run on ideal kinematics, stacked, shape (T, n_q), m."""
    run = run_ideal(system)
    assert may_blow_up or run.status == "finished"
    q, p = system.team.split(run.positions)
    return system.team.dirichlet.extend(p) - q


def walk(run: Run, steps: int) -> Iterator[tuple[int, Array, System, Memory]]:
    """Sample the law in Python, each sample twice as it may be taken again, across the phases of a run.

    Yields a sample's number, positions (V, 3), m, which may be moved before the next, the phase's system, and memory.
    """
    phases = [Phase(0, run)] if isinstance(run, System) else run
    before = phases[0].system
    memory, x = new_memory(before.law, len(before.initial)), before.initial.copy()
    for n in range(steps):
        system = [phase.system for phase in phases if phase.start <= n][-1]
        if system is not before:
            memory, before = carry(memory, before.law, system.law, n), system
        for _ in range(2):
            look(float(n), memory.held, memory.kept)
            sample_law(system.control, n * system.grid.period, x, None, memory)
        yield n, x, system, memory


def team_error(data: xr.Dataset) -> Array:
    """Return |e| of the agents that are present, at the samples of a run, shape (T,), m."""
    return np.sqrt(np.nansum(data["tracking_error"].values ** 2, axis=1))


def rms_error(data: xr.Dataset) -> Array:
    """Return the RMS over agents of the tracking error at the samples of a run, shape (T,), m."""
    return np.sqrt(np.nanmean(data["tracking_error"].values ** 2, axis=1))


def analyse(
    scenario: Scenario | str | Path | Mapping[str, Any], changes: Mapping[str, Any] | None = None, **options: Any
) -> Any:
    """Return what `check` says of a scenario, of one that ships, or of fields, without a trial."""
    if not isinstance(scenario, Scenario):
        scenario = mjsheaf.load_scenario(scenario, changes)
    elif changes:
        raise TypeError("changes are of a scenario that is loaded here")
    return mjsheaf.check(scenario, trial=False, **options)
