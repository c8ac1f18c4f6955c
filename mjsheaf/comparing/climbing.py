"""Running the ladder, rung by rung; equal setups run once."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import xarray as xr

from mjsheaf.backends.ideal import run_ideal
from mjsheaf.backends.physics import run_physics, vehicles_of
from mjsheaf.backends.system import System
from mjsheaf.backends.trajectory import Trajectory
from mjsheaf.comparing.ladder import Rung, Setup
from mjsheaf.comparing.measures import Series, series_of
from mjsheaf.results import make_dataset, summarize
from mjsheaf.results.errors import evaluate_errors

Progress = Callable[[str, int, int], None]

_FINER = 10


@dataclass(frozen=True)
class Run:
    """A rung's run.

    Attributes:
        rung: the rung.
        system: what was simulated.
        trajectory: what came out.
        series: errors over time by scope.
        final: errors at the last sample, as summary.json has them.
        thrusters: number of thrusters of each vehicle, length V.
    """

    rung: Rung
    system: System
    trajectory: Trajectory
    series: dict[str, Series]
    final: dict[str, object]
    thrusters: list[int]

    @property
    def finished(self) -> bool:
        """Whether it came to its end."""
        return self.trajectory.status == "finished"

    def dataset(self, backend: str, seed: int) -> xr.Dataset:
        """The run as `simulate` would return it."""
        return make_dataset(self.system, self.trajectory, backend, seed)


def climb(system: System, ladder: list[Rung], progress: Progress | None = None) -> dict[str, Run]:
    """Run every rung of a ladder, by key. One that blows up ends early and is marked; the others go on.

    Bodies without mass can be too stiff for the timestep that suits the scenario's own. So a rung of bodies that blows
    up, but for the scenario as it stands, is run again with a tenth of it: what blows up then is not the integrator's.

    Args:
        system: the scenario's system.
        ladder: its rungs.
        progress: called with ('climbing', rungs done, rungs in all).
    """
    done: dict[Setup, tuple[System, Trajectory]] = {}
    whole = {rung.setup for rung in ladder if rung.kind == "all"}

    def run(setup: Setup) -> tuple[System, Trajectory]:
        if setup not in done:
            here = setup.apply(system)
            found = _simulate(here, setup, lambda other: run(other)[1])
            if found.status != "finished" and (setup.agents or setup.targets) and setup not in whole:
                here = replace(here, bodies=replace(here.bodies, timestep=here.bodies.timestep / _FINER))
                found = _simulate(here, setup, lambda other: run(other)[1])
            done[setup] = here, found
        return done[setup]

    runs = {}
    for k, rung in enumerate(ladder):
        if progress:
            progress("climbing", k, len(ladder))
        runs[rung.key] = _measured(rung, *run(rung.setup))
    if progress:
        progress("climbing", len(ladder), len(ladder))
    return runs


def _simulate(system: System, setup: Setup, other: Callable[[Setup], Trajectory]) -> Trajectory:
    """Run one setup; where only some are bodies, the targets are placed where another run had them."""
    if setup.agents == setup.targets:
        return run_physics(system) if setup.agents else run_ideal(system)
    source = other(replace(setup, agents=setup.targets))
    targets = source.positions[:, len(system.team.agents) :]
    if len(targets) < 2:
        return replace(source, quaternions=None, heights=None, thrust=None, saturation=None)
    found = run_physics(system, targets=targets) if setup.agents else run_ideal(system, targets=targets)
    if source.status != "finished" and found.status == "finished":
        return replace(found, status=source.status, message=f"the run that gives its targets ends: {source.message}")
    return found


def _measured(rung: Rung, system: System, trajectory: Trajectory) -> Run:
    # Of the last sample, and of bodies, errors need positions alone.
    last = Trajectory(trajectory.time[-1:], trajectory.positions[-1:], trajectory.status, trajectory.message)
    return Run(
        rung=rung,
        system=system,
        trajectory=trajectory,
        series=series_of(system, evaluate_errors(system.team, trajectory.positions)),
        final=summarize(system.team, make_dataset(system, last, "ideal", 0)),
        thrusters=[len(vehicle.thrusters) for vehicle in vehicles_of(system)],
    )
