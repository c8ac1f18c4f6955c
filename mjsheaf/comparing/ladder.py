"""The ladder: variants of a scenario from ideal kinematics to its own bodies, one effect at a time, and their runs.

    ideal      agents and targets move as the theory says
    targets    only targets are bodies, with ideal thrusters; agents are ideal and track where those bodies were
    agents     only agents are bodies, with ideal thrusters; targets are where the ideal run had them
    base       both are bodies with ideal thrusters: every effect off, no contacts
    +EFFECT    base with one effect
    all        the scenario as it stands
    -EFFECT    the scenario with one effect switched off
    X-terms    ideal kinematics and the scenario as it stands under the paper's law alone, without its terms
    X-links    the same two over perfect links: no noise, delay or loss
    all-mujoco the scenario as it stands, moved by MuJoCo

The ladder has variants only for effects that some vehicle of the scenario has and that the scenario leaves on, for
the paper's law only where the scenario's has terms beyond it, for perfect links only where its own are not, and for
MuJoCo only where another engine moves the bodies.

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
from functools import cache
from typing import Literal

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
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
from mjsheaf.control.links import no_links
from mjsheaf.control.terms import no_terms
from mjsheaf.io.section import FiniteRecord
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.simulation.ideal import run_ideal
from mjsheaf.simulation.physics import run_physics
from mjsheaf.simulation.trajectory import Trajectory
from mjsheaf.system import System
from mjsheaf.vehicles.effects import has_effects
from mjsheaf.vehicles.vehicle import Vehicle

Kind = Literal["ideal", "part", "base", "alone", "all", "without", "law", "links", "engine"]

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
    ending: Ending | None = Field(
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
        effects: those of EFFECTS that are on; without a meaning where nobody is a body.
        terms: whether the law keeps what it has beyond the paper's.
        links: whether links are as they are, or perfect.
        mujoco: whether MuJoCo moves the bodies, whatever else does.
    """

    agents: bool
    targets: bool
    effects: frozenset[str] = frozenset()
    terms: bool = True
    links: bool = True
    mujoco: bool = False

    def apply(self, system: System) -> System:
        """The system with these bodies."""
        effects = system.bodies.effects.model_copy(update={name: name in self.effects for name in _OF_VEHICLES})
        bodies = replace(system.bodies, effects=effects, contacts=CONTACTS in self.effects)
        bodies = replace(bodies, engine="mujoco") if self.mujoco else bodies
        lawful = system if self.terms else without_terms(system)
        return replace(lawful if self.links else without_links(lawful), bodies=bodies)


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
        trajectory: its samples, and the system that was simulated.
        series: errors over time.
    """

    variant: Variant
    trajectory: Trajectory
    series: Series

    @property
    def system(self) -> System:
        """What was simulated."""
        return self.trajectory.system

    @property
    def finished(self) -> bool:
        """Whether it reached its end."""
        return self.trajectory.status == "finished"

    @property
    def errors(self) -> dict[str, ScopeRecord]:
        """Final errors and those of the last half, by scope."""
        return errors_by_scope(self.trajectory, self.series)

    def record(self, ideal: "Run") -> RungRecord:
        """The run as compare.json has it.

        Args:
            ideal: the run of ideal kinematics, from which distances are taken.
        """
        system, trajectory, variant, team = self.system, self.trajectory, self.variant, self.series[TEAM]
        settles = team[TRACKING] if np.isnan(team[FORMATION]).all() else team[FORMATION]
        bodies = [role for role in ROLES if getattr(variant.setup, role)]
        ending = None
        if self.finished:
            agents = np.s_[:, : len(system.team.agents)]
            q_star = positions_at_q_star(system, trajectory.positions)[agents]
            on_bodies = variant.setup.agents
            ending = ending_of(system, trajectory.time, q_star, trajectory.positions[agents], on_bodies=on_bodies)
        return RungRecord(
            key=variant.key,
            label=variant.label,
            kind=variant.kind,
            effect=variant.effect,
            status=trajectory.status,
            message=trajectory.message,
            timestep_s=system.bodies.timestep if bodies else None,
            errors=self.errors,
            ending=ending,
            settling_time_s=settling_time(trajectory.time, settles) if ending == "settled" else None,
            distance=largest_distance(trajectory, ideal.trajectory, system.grid.start),
            distance_late=largest_distance(trajectory, ideal.trajectory, middle_of(system)),
            saturation=saturation_of(trajectory, bodies),
        )


def without_terms(system: System) -> System:
    """The system under the paper's law alone."""
    return replace(system, law=system.law._replace(terms=no_terms()))


def without_links(system: System) -> System:
    """The system over perfect links."""
    return replace(system, law=system.law._replace(links=no_links()))


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
    plan, found = system.bodies, {CONTACTS}
    for name in dict.fromkeys(plan.vehicle if names is None else names):
        vehicle = system.described_vehicle(name).with_time_constant(plan.time_constant)
        own = has_effects(vehicle)
        found |= {effect for effect in _OF_VEHICLES if getattr(own, effect)}
        if inertial_tau(vehicle).max() > plan.effects.massless_tau * (1.0 + 1e-9):
            found.add("inertia")
    return [effect for effect in EFFECTS if effect in found & _switched_on(system)]


def _switched_on(system: System) -> frozenset[str]:
    """The effects that a scenario leaves on, whether a vehicle has them or not."""
    plan = system.bodies
    return frozenset([e for e in _OF_VEHICLES if getattr(plan.effects, e)] + [CONTACTS] * plan.contacts)


def ladder_of(system: System) -> list[Variant]:
    """The variants of a scenario: ideal to all, without one effect, by the paper's law, on perfect links, by MuJoCo."""
    effects, own = effects_of(system), _switched_on(system)

    def bodies(effects: frozenset[str], terms: bool = True, links: bool = True) -> Setup:
        return Setup(agents=True, targets=True, effects=effects, terms=terms, links=links)

    law = [
        Variant("ideal-terms", "ideal, paper's law", "law", Setup(agents=False, targets=False, terms=False)),
        Variant("all-terms", "all, paper's law", "law", bodies(own, terms=False)),
    ]
    links = [
        Variant("ideal-links", "ideal, perfect links", "links", Setup(agents=False, targets=False, links=False)),
        Variant("all-links", "all, perfect links", "links", bodies(own, links=False)),
    ]
    engine = Variant("all-mujoco", "all, MuJoCo", "engine", replace(bodies(own), mujoco=True))
    return [
        Variant("ideal", "ideal kinematics", "ideal", Setup(agents=False, targets=False)),
        Variant("targets", "only targets are bodies", "part", Setup(agents=False, targets=True)),
        Variant("agents", "only agents are bodies", "part", Setup(agents=True, targets=False)),
        Variant("base", "bodies, ideal thrusters", "base", bodies(frozenset())),
        *(Variant(f"+{e}", f"base + {display_name(e)}", "alone", bodies(frozenset([e])), e) for e in effects),
        Variant("all", "all: as it stands", "all", bodies(own)),
        *(Variant(f"-{e}", f"all - {display_name(e)}", "without", bodies(own - {e}), e) for e in effects),
        *(law if system.law.terms.agents else []),
        *(links if len(system.law.links.table) else []),
        *([engine] if system.bodies.engine != "mujoco" else []),
    ]


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
    whole = {variant.setup for variant in ladder if variant.kind == "all"}

    @cache
    def run(setup: Setup) -> Trajectory:
        here = setup.apply(system)
        found = _simulate(here, setup, run)
        if found.status == "finished" or setup in whole or not (setup.agents or setup.targets):
            return found
        finer = replace(here.bodies, timestep=here.bodies.timestep / _TIMESTEP_DIVISOR)
        return _simulate(replace(here, bodies=finer), setup, run)

    runs = {}
    for k, variant in enumerate(ladder):
        progress("simulating variants", k, len(ladder))
        found = run(variant.setup)
        runs[variant.key] = Run(variant, found, error_series(system, found.positions))
    progress("simulating variants", len(ladder), len(ladder))
    return runs


def _simulate(system: System, setup: Setup, other: Callable[[Setup], Trajectory]) -> Trajectory:
    """Run one setup; where only some are bodies, the targets are placed where another run had them."""
    if setup.agents == setup.targets:
        return run_physics(system) if setup.agents else run_ideal(system)
    source = other(replace(setup, agents=setup.targets))
    targets = source.positions[:, len(system.team.agents) :]
    if len(targets) < 2:
        return replace(source, system=system)
    found = run_physics(system, targets=targets) if setup.agents else run_ideal(system, targets=targets)
    if source.status != "finished" and found.status == "finished":
        return replace(found, message=f"the run that gives its targets ends: {source.message}")
    return found
