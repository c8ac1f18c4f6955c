"""The ladder: variants of a scenario from ideal kinematics to its own bodies, one effect at a time, and their runs.

    ideal      agents and targets move as the theory says
    targets    only targets are bodies, with ideal thrusters; agents are ideal and track where those bodies were
    agents     only agents are bodies, with ideal thrusters; targets are where the ideal run had them
    base       both are bodies with ideal thrusters: every effect off, no contacts
    +EFFECT    base with one effect
    all        the scenario as it stands
    -EFFECT    the scenario with one effect switched off

The ladder has variants only for effects that some vehicle of the scenario has and that the scenario leaves on.

A scenario may be worse without an effect than with it, as effects are not independent:

- -underactuation is no better vehicle but a stand-in: it holds its heading, is controlled at its origin, and has as
  much force abeam as ahead, which makes it only as fast abeam as its sway drag lets it be. A boat that turns its bows
  to where it goes is faster.
- -drag_law takes, beside the drag, the damping that quadratic drag gives at the speeds and rates of the run. The Otter
  of `otters`, whose only quadratic drag is in yaw, loses the larger part of its drag in yaw: with the lag of its
  propellers it swings its bows (yaw rate 0.51 rad/s RMS, not 0.17). Its thrusters are then at a limit 30% of the time;
  that is a consequence, as it swings without limits too, but hardly without lag.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from mjsheaf.checking.finished import Ending, ending_of, settling_time
from mjsheaf.comparing.measures import (
    FORMATION,
    ROLES,
    TEAM,
    TRACKING,
    DistanceRecord,
    SaturationRecord,
    ScopeRecord,
    Series,
    error_series,
    errors_by_scope,
    largest_distance,
    middle_of,
    positions_at_q_star,
    saturation_of,
)
from mjsheaf.io.section import FiniteRecord
from mjsheaf.results import make_dataset
from mjsheaf.simulation.ideal import run_ideal
from mjsheaf.simulation.loop import run_physics
from mjsheaf.simulation.trajectory import Trajectory
from mjsheaf.system import System
from mjsheaf.vehicles.effects import Effects, has_effects
from mjsheaf.vehicles.vehicle import Vehicle

Array = NDArray[np.float64]
Kind = Literal["ideal", "part", "base", "alone", "all", "without"]
Progress = Callable[[str, int, int], None]

CONTACTS = "contacts"
_OF_VEHICLES = ("inertia", "drag_law", "limits", "lag", "underactuation")
EFFECTS = (*_OF_VEHICLES, CONTACTS)
"""What makes bodies real, by the name that the scenario's physics section has for it."""

_TIMESTEP_DIVISOR = 10  # for a second try of bodies that blow up


class RungRecord(FiniteRecord):
    """One rung of the ladder."""

    key: str
    label: str
    kind: Kind
    effect: str | None = Field(description="what it adds to base ('alone') or takes from all ('without')")
    status: str
    message: str
    timestep_s: float | None = Field(description="of the physics; null on ideal kinematics")
    errors: dict[str, ScopeRecord] = Field(description="by scope: 'team', then the groups by name")
    ending: Literal["settled", "moving", "growing", "circling"] | None = Field(
        None,
        description="how it ends, by the team's tracking error: at a level; still changing; growing; or swinging by "
        "itself without end; null where it blew up or has fewer than 8 samples",
    )
    settling_time_s: float | None = Field(
        description="first time after the start from which the team's formation error (or that of tracking, in a "
        "team without formations) stays below 1.25 times the largest of the last half plus 2% of the largest of "
        "all; null where it is not level in the end, or the run has not settled"
    )
    distance: DistanceRecord | None = Field(description="from the ideal run, over all time")
    distance_late: DistanceRecord | None = Field(
        description="the same over the last half of the run, by which a run has settled that ever does"
    )
    saturation: list[SaturationRecord]


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
        return replace(self, effects=self.effects.model_copy(update={effect: on}))


@dataclass(frozen=True)
class Variant:
    """One rung of the ladder, to be run.

    Attributes:
        key: short and unique, such as 'base' or '+lag'.
        label: the same, human-readable.
        kind: its place in the ladder.
        setup: who is a body, and what bodies have.
        effect: the effect that it adds or takes away, or None.
    """

    key: str
    label: str
    kind: Kind
    setup: Setup
    effect: str | None = None


@dataclass(frozen=True)
class Run:
    """The run of a variant.

    Attributes:
        variant: the variant.
        system: what was simulated.
        trajectory: its samples.
        series: errors over time.
    """

    variant: Variant
    system: System
    trajectory: Trajectory
    series: Series

    @property
    def finished(self) -> bool:
        """Whether it reached its end."""
        return self.trajectory.status == "finished"

    @property
    def errors(self) -> dict[str, ScopeRecord]:
        """Final errors and those of the last half, by scope."""
        return errors_by_scope(self.system, self.trajectory.time, self.series, finished=self.finished)

    def dataset(self, backend: str, seed: int) -> xr.Dataset:
        """The run as `simulate` would return it."""
        return make_dataset(self.trajectory, backend, seed)

    def record(self, ideal: "Run") -> RungRecord:
        """The run as compare.json has it.

        Args:
            ideal: the run of ideal kinematics, from which distances are taken.
        """
        system, trajectory, setup, team = self.system, self.trajectory, self.variant.setup, self.series[TEAM]
        settles = team[TRACKING] if np.isnan(team[FORMATION]).all() else team[FORMATION]
        ending = self._ending() if self.finished else None
        far, late = (
            largest_distance(system, trajectory, ideal.trajectory, start)
            for start in (system.grid.start, middle_of(system))
        )
        return RungRecord(
            key=self.variant.key,
            label=self.variant.label,
            kind=self.variant.kind,
            effect=self.variant.effect,
            status=trajectory.status,
            message=trajectory.message,
            timestep_s=system.bodies.timestep if setup.agents or setup.targets else None,
            errors=self.errors,
            ending=ending,
            settling_time_s=settling_time(trajectory.time, settles) if ending == "settled" else None,
            distance=far,
            distance_late=late,
            saturation=saturation_of(system, trajectory, [role for role in ROLES if getattr(setup, role)]),
        )

    def _ending(self) -> Ending | None:
        positions, N = self.trajectory.positions, len(self.system.team.agents)
        q_star = positions_at_q_star(self.system, positions)[:, :N]
        on_bodies = self.variant.setup.agents
        return ending_of(self.system, self.trajectory.time, q_star, positions[:, :N], on_bodies=on_bodies)


def display_name(effect: str) -> str:
    """Human-readable name of an effect."""
    return effect.replace("_", " ")


def inertial_tau(vehicle: Vehicle) -> Array:
    """M / (M k_v + D) of the controlled velocity along body axes at low speed, shape (n,), s; thrusters do not lag.

    `ReducedModel.tau` has their lag too.
    """
    rows = vehicle.steering.velocity_rows[: vehicle.dimension]
    mass, drag = vehicle.moving_mass[rows], np.concatenate([vehicle.drag, vehicle.angular_drag])[rows]
    return np.asarray(mass / (mass * vehicle.rate + drag))


def effects_of(system: System, names: Iterable[str] | None = None) -> list[str]:
    """The effects that are on in a scenario and that some of its vehicles has, in the order of EFFECTS.

    A vehicle without an autopilot has inertia where its time constant exceeds `massless_tau`.

    Args:
        system: the scenario's system.
        names: of the vehicles to look at; None for all.
    """
    plan, found = system.bodies, set[str]()
    for name in dict.fromkeys(plan.vehicle if names is None else names):
        vehicle = system.described_vehicle(name).with_time_constant(plan.time_constant)
        own = has_effects(vehicle)
        found |= {effect for effect in _OF_VEHICLES if getattr(own, effect)}
        if inertial_tau(vehicle).max() > plan.effects.massless_tau * (1.0 + 1e-9):
            found.add("inertia")
    found = {effect for effect in found if getattr(plan.effects, effect)} | ({CONTACTS} if plan.contacts else set())
    return [effect for effect in EFFECTS if effect in found]


def ladder_of(system: System) -> list[Variant]:
    """The variants of a scenario, from ideal to all, then those without one effect."""
    plan, effects = system.bodies, effects_of(system)
    off = plan.effects.model_copy(update=dict.fromkeys(_OF_VEHICLES, False))
    base = Setup(agents=True, targets=True, effects=off, contacts=False)
    whole = replace(base, effects=plan.effects, contacts=plan.contacts)
    return [
        Variant("ideal", "ideal kinematics", "ideal", replace(base, agents=False, targets=False)),
        Variant("targets", "only targets are bodies", "part", replace(base, agents=False)),
        Variant("agents", "only agents are bodies", "part", replace(base, targets=False)),
        Variant("base", "bodies, ideal thrusters", "base", base),
        *(Variant(f"+{e}", f"base + {display_name(e)}", "alone", base.having(e, True), e) for e in effects),
        Variant("all", "all: as it stands", "all", whole),
        *(Variant(f"-{e}", f"all - {display_name(e)}", "without", whole.having(e, False), e) for e in effects),
    ]


def no_progress(what: str, done: int, total: int) -> None:
    """A `Progress` that reports nothing."""


def run_ablation(system: System, ladder: list[Variant], progress: Progress = no_progress) -> dict[str, Run]:
    """Run every variant of a ladder, equal setups once. One that blows up ends early and is marked; the others go on.

    Bodies without mass can be too stiff for the timestep of the scenario's own. So bodies that blow up, except those of
    the scenario as it stands, are run again with a tenth of it: what blows up then is not the integrator's fault.

    Args:
        system: the scenario's system.
        ladder: its variants.
        progress: called with ('simulating variants', variants done, variants in all).

    Returns:
        The runs by key.
    """
    done: dict[Setup, tuple[System, Trajectory]] = {}
    whole = {variant.setup for variant in ladder if variant.kind == "all"}

    def run(setup: Setup) -> tuple[System, Trajectory]:
        if setup not in done:
            here = setup.apply(system)
            found = _simulate(here, setup, lambda other: run(other)[1])
            if found.status != "finished" and (setup.agents or setup.targets) and setup not in whole:
                here = replace(here, bodies=replace(here.bodies, timestep=here.bodies.timestep / _TIMESTEP_DIVISOR))
                found = _simulate(here, setup, lambda other: run(other)[1])
            done[setup] = here, found
        return done[setup]

    runs = {}
    for k, variant in enumerate(ladder):
        progress("simulating variants", k, len(ladder))
        here, found = run(variant.setup)
        runs[variant.key] = Run(variant, here, found, error_series(here, found.positions))
    progress("simulating variants", len(ladder), len(ladder))
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
        return replace(found, message=f"the run that gives its targets ends: {source.message}")
    return found
