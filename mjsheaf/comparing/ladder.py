"""The time constant that inertia alone gives a vehicle.

The ladder of fidelity: from the theory's kinematics to the bodies that a scenario has, one effect at a time.

    ideal      agents and targets move as the theory says
    targets    only targets are bodies, with ideal thrusters; agents are ideal and track where those bodies were
    agents     only agents are bodies, with ideal thrusters; targets are where the ideal run had them
    base       both are bodies with ideal thrusters: every effect off, no contacts
    +EFFECT    base with one effect
    all        the scenario as it stands
    -EFFECT    the scenario with one effect switched off

Only effects that some vehicle of the scenario has, and that the scenario has not switched off itself, make rungs.

A scenario may be worse without an effect than with it, as effects are not apart from each other:

- -underactuation is no better vehicle but a stand-in: it holds its heading, is controlled at its origin, and has as
  much force abeam as ahead, which makes it only as fast abeam as its sway drag lets it be. A boat that turns its bows
  to where it goes is faster.
- -drag_law takes, beside the drag, the damping that quadratic drag gives at the speeds and rates of the run. The Otter
  of `otters`, whose only quadratic drag is in yaw, loses the larger part of its drag in yaw: with the lag of its
  propellers it swings its bows (yaw rate 0.51 rad/s RMS, not 0.17). Its thrusters are then at a limit 30% of the time;
  that is a consequence, as it swings without limits too, but hardly without lag.

Running the ladder, rung by rung; equal setups run once.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.comparing.measures import Series, series_of
from mjsheaf.results import make_dataset, summarize
from mjsheaf.results.metrics import evaluate_errors
from mjsheaf.simulation.ideal import run_ideal
from mjsheaf.simulation.loop import run_physics, vehicles_of
from mjsheaf.simulation.trajectory import Trajectory
from mjsheaf.system import Effects, System
from mjsheaf.vehicles.effects import has_effects
from mjsheaf.vehicles.loading import load_vehicle
from mjsheaf.vehicles.vehicle import Vehicle

Array = NDArray[np.float64]


def inertial_tau(vehicle: Vehicle) -> Array:
    """M / (M k_v + D) of the controlled velocity along body axes at low speed, shape (n,), s; thrusters do not lag.

    `ReducedModel.tau` has their lag too.
    """
    rows = vehicle.steering.velocity_rows[: vehicle.dimension]
    mass, drag = vehicle.moving_mass[rows], np.concatenate([vehicle.drag, vehicle.angular_drag])[rows]
    return np.asarray(mass / (mass * vehicle.rate + drag))


Kind = Literal["ideal", "part", "base", "alone", "all", "without"]

CONTACTS = "contacts"
_OF_VEHICLES = ("inertia", "drag_law", "limits", "lag", "underactuation")
EFFECTS = (*_OF_VEHICLES, CONTACTS)
"""What makes bodies real, by the name that the scenario's physics section has for it."""


@dataclass(frozen=True)
class Setup:
    """Who is a body, and what bodies have.

    Attributes:
        agents, targets: whether they are bodies.
        effects: which effects are on; without a meaning where nobody is a body.
        contacts: whether bodies collide.
    """

    agents: bool
    targets: bool
    effects: Effects
    contacts: bool

    def apply(self, system: System) -> System:
        """The system with these bodies."""
        return replace(system, bodies=replace(system.bodies, effects=self.effects, contacts=self.contacts))

    def having(self, effect: str, on: bool) -> "Setup":
        """The same with one effect switched."""
        if effect == CONTACTS:
            return replace(self, contacts=on)
        return replace(self, effects=replace(self.effects, **{effect: on}))


@dataclass(frozen=True)
class Rung:
    """One step of the ladder.

    Attributes:
        key: short and unique, such as 'base' or '+lag'.
        label: the same for a person.
        kind: its place in the ladder.
        effect: the effect that it adds or takes away, or None.
        setup: who is a body, and what bodies have.
    """

    key: str
    label: str
    kind: Kind
    effect: str | None
    setup: Setup


def effects_of(system: System, names: Iterable[str] | None = None) -> list[str]:
    """The effects that are on in a scenario and that some of its vehicles has, in the order of EFFECTS.

    Inertia is also that of a vehicle without an autopilot whose time constant is beyond `massless_tau`.

    Args:
        system: the scenario's system.
        names: of the vehicles to look at; None for all.
    """
    plan = system.bodies
    names = dict.fromkeys(plan.vehicle if names is None else names)
    vehicles = [load_vehicle(name).with_time_constant(plan.time_constant) for name in names]
    found: set[str] = set()
    for vehicle in vehicles:
        own = has_effects(vehicle)
        slow = float(inertial_tau(vehicle).max()) > plan.effects.massless_tau * (1.0 + 1e-9)
        found |= {name for name in _OF_VEHICLES if getattr(own, name)}
        found |= {"inertia"} if slow else set()
    found = {name for name in found if getattr(plan.effects, name)} | ({CONTACTS} if plan.contacts else set())
    return [name for name in EFFECTS if name in found]


def ladder_of(system: System) -> list[Rung]:
    """The rungs of a scenario, from ideal to all, then what is left without each effect."""
    plan = system.bodies
    off = replace(plan.effects, **dict.fromkeys(_OF_VEHICLES, False))
    base = Setup(agents=True, targets=True, effects=off, contacts=False)
    whole = Setup(agents=True, targets=True, effects=plan.effects, contacts=plan.contacts)
    effects = effects_of(system)
    return [
        Rung("ideal", "ideal kinematics", "ideal", None, replace(base, agents=False, targets=False)),
        Rung("targets", "only targets are bodies", "part", None, replace(base, agents=False)),
        Rung("agents", "only agents are bodies", "part", None, replace(base, targets=False)),
        Rung("base", "bodies, ideal thrusters", "base", None, base),
        *(Rung(f"+{name}", f"base + {words(name)}", "alone", name, base.having(name, True)) for name in effects),
        Rung("all", "all: as it stands", "all", None, whole),
        *(Rung(f"-{name}", f"all - {words(name)}", "without", name, whole.having(name, False)) for name in effects),
    ]


def words(effect: str) -> str:
    """An effect as a person writes it."""
    return effect.replace("_", " ")


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
        return make_dataset(self.trajectory, backend, seed)


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
        return source
    found = run_physics(system, targets=targets) if setup.agents else run_ideal(system, targets=targets)
    if source.status != "finished" and found.status == "finished":
        return replace(found, status=source.status, message=f"the run that gives its targets ends: {source.message}")
    return found


def _measured(rung: Rung, system: System, trajectory: Trajectory) -> Run:
    # Of the last sample, and of bodies, errors need positions alone.
    last = replace(
        trajectory, time=trajectory.time[-1:], log=trajectory.log.span(len(trajectory.time) - 1, len(trajectory.time))
    )
    return Run(
        rung=rung,
        system=system,
        trajectory=trajectory,
        series=series_of(system, evaluate_errors(system.team, trajectory.positions)),
        final=summarize(system.team, make_dataset(last, "ideal", 0)),
        thrusters=[len(vehicle.thrusters) for vehicle in vehicles_of(system)],
    )
