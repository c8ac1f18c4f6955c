"""The ladder: variants of a scenario from ideal kinematics to its own bodies, one effect at a time, and their runs.

    ideal      ideal kinematics: agents and targets move as in the theory
    targets    targets are bodies with ideal thrusters; agents are ideal and track the recorded targets
    agents     agents are bodies with ideal thrusters; targets follow their positions in the ideal run
    base       both are bodies with ideal thrusters: every effect off, no contacts
    +EFFECT    base with one effect
    all        the scenario as given
    -EFFECT    the scenario with one effect switched off
    X-terms    X (ideal or all) under the paper's law alone, without its terms
    X-links    X (ideal or all) over perfect links: no noise, delay or loss
    X-limit    X (ideal or all) without the law's velocity limit
    all-mujoco the scenario as given, with MuJoCo as its engine

The ladder leaves out variants that could not differ. An effect must be on in the scenario, and some vehicle must have
it. X-terms need a law with terms, X-links need links that are not perfect, X-limit needs an agent with a velocity
limit, and all-mujoco needs another engine.

Effects are not independent, so a scenario may be worse without an effect than with it:

- -underactuation replaces the vehicle by a stand-in that holds its heading, is controlled at its origin, and has as
  much force abeam as ahead. Its sway drag limits its speed abeam. A boat that turns its bows into its course is faster.
- -drag_law also removes the damping that quadratic drag gives at the speeds and rates of the run. The only quadratic
  drag of the Otter in `otters` is in yaw, so it loses most of its yaw damping, and with the lag of its propellers the
  heading oscillates (yaw rate 0.51 rad/s RMS instead of 0.17). Its thrusters are then at a limit 30% of the time. The
  limits are not the cause: it oscillates without them too, but hardly without lag.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Literal

import numpy as np
import xarray as xr
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.body_loop import ending_of_run
from mjsheaf.comparing.measures import (
    FORMATION,
    ROLES,
    TEAM,
    TRACKING,
    DistanceRecord,
    SaturationRecord,
    ScopeRecord,
    Series,
    errors_by_scope,
    largest_distance,
    middle_of,
    saturation_of,
    series_of,
    span_of,
)
from mjsheaf.law.edges import LinkArrays
from mjsheaf.loop.session import engine_of
from mjsheaf.loop.system import Phase, System, phases_of
from mjsheaf.results.ending import Ending, settling_time
from mjsheaf.runs.simulate import Progress, datasets_of, no_progress
from mjsheaf.scenario.load import LawFile
from mjsheaf.section import FiniteRecord
from mjsheaf.vehicles.effects import has_effects
from mjsheaf.vehicles.vehicle import Vehicle

Kind = Literal["ideal", "part", "base", "alone", "all", "without", "law", "links", "limit", "engine"]

CONTACTS = "contacts"
_OF_VEHICLES = ("inertia", "drag_law", "limits", "lag", "underactuation")
EFFECTS = (*_OF_VEHICLES, CONTACTS)
"""Effects of real bodies, named as in the scenario's physics section."""


class RungRecord(FiniteRecord):
    """One variant of the ladder."""

    key: str
    label: str
    kind: Kind
    effect: str | None = Field(description="effect that it adds to base ('alone') or removes from all ('without')")
    status: str
    message: str
    timestep_s: float | None = Field(description="timestep of the physics; null on ideal kinematics")
    errors: dict[str, ScopeRecord] = Field(description="by scope: 'team', then the groups by name")
    ending: Ending | None = Field(
        None,
        description="state of the team's tracking error at the end: settled, diverging, or not settled: it still "
        "changes, is in a limit cycle, or an agent does not move; null if it blew up or has fewer than 8 samples",
    )
    settling_time_s: float | None = Field(
        description="time after which the team's formation error (or, in a team without formations, its tracking "
        "error) stays below 1.25 times its maximum over the second half plus 2% of its maximum over the run; null if "
        "the run has not converged"
    )
    distance: DistanceRecord | None = Field(description="largest distance to the ideal run")
    distance_late: DistanceRecord | None = Field(description="largest distance to the ideal run over the second half")
    saturation: list[SaturationRecord]

    def error_in_words(self, measure: str) -> str:
        """Return the team's error over the second half, or that the run blows up."""
        if self.status != "finished":
            return "blows up"
        value = self.errors[TEAM].error(measure)
        return "-" if value is None else f"{value:.3g} m"


@dataclass(frozen=True)
class Setup:
    """The vehicles that are bodies, and the effects of those bodies.

    Attributes:
        agents: True if agents are bodies.
        targets: True if targets are bodies.
        effects: Names out of EFFECTS that are on; meaningless if there are no bodies.
        terms: True if the law is the run's own, with its terms or in Python; False if it is the paper's.
        links: True if links are the scenario's; False if they are perfect.
        limited: True if velocity limits are the scenario's; False if there are none.
        mujoco: True if the engine is MuJoCo, whatever the scenario's engine is.
    """

    agents: bool
    targets: bool
    effects: frozenset[str] = frozenset()
    terms: bool = True
    links: bool = True
    limited: bool = True
    mujoco: bool = False

    def apply(self, system: System) -> System:
        """Return the system with these bodies."""
        effects = system.bodies.effects.model_copy(update={name: name in self.effects for name in _OF_VEHICLES})
        bodies = replace(system.bodies, effects=effects, contacts=CONTACTS in self.effects)
        bodies = replace(bodies, engine="mujoco") if self.mujoco else bodies
        changed = replace(system, bodies=bodies)
        changed = changed if self.terms else without_terms(changed)
        changed = changed if self.links else without_links(changed)
        return changed if self.limited else _without_limits(changed)


@dataclass(frozen=True)
class Variant:
    """A variant of a scenario.

    Attributes:
        key: Short unique name, such as 'base' or '+lag'.
        label: Human-readable name.
        kind: Place in the ladder.
        setup: Vehicles that are bodies, and effects of the bodies.
        effect: Effect that it adds or removes, or None.
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
        variant: Variant that was run.
        phases: Phases that were simulated.
        dataset: Data of the run, as `simulate` returns them.
        asked: Speed commanded to every vehicle at each sample, relative to the medium, shape (T, V), m/s.
    """

    variant: Variant
    phases: tuple[Phase, ...]
    dataset: xr.Dataset
    asked: Array

    @property
    def system(self) -> System:
        """System that was simulated; with events, that of the first phase."""
        return self.phases[0].system

    @property
    def finished(self) -> bool:
        """True if the run reached its end."""
        return bool(self.dataset.attrs["status"] == "finished")

    @property
    def time(self) -> Array:
        """Times of the samples, shape (T,), s."""
        return np.asarray(self.dataset["time"].values)

    @property
    def phases_reached(self) -> int:
        """Number of phases that the run reached."""
        return int(self.dataset["phase"].values[-1]) + 1

    @property
    def limits(self) -> Array:
        """Velocity limit of each agent at each sample, 0 if it is absent, shape (T, N), m/s."""
        agents = self.dataset.sizes["agent"]
        limits = np.array([phase.system.law.limit[:agents] for phase in self.phases])
        return np.asarray(limits[self.dataset["phase"].values])

    @cached_property
    def series(self) -> Series:
        """Errors over time."""
        return series_of(self.system, self.dataset)

    def completes(self, number: int | None = None) -> bool:
        """Return True if the run reached the end of a phase, or its own."""
        reached = number is not None and self.dataset.sizes["time"] >= span_of(self.phases, number).end
        return self.finished or reached

    def errors(self, number: int | None = None) -> dict[str, ScopeRecord]:
        """Measure the errors over a phase, or the whole run, by scope; they are null if the run did not complete it."""
        return errors_by_scope(self.series, span_of(self.phases, number), complete=self.completes(number))

    def record(self, ideal: "Run") -> RungRecord:
        """Return the record of the run for compare.json.

        Args:
            ideal: Run of ideal kinematics, the reference for distances.
        """
        system, variant = self.system, self.variant
        bodies = [role for role in ROLES if getattr(variant.setup, role)]
        ending = self.ending()
        settles = None
        if ending == "settled":
            number = self.dataset["phase"].values
            last = slice(int(np.searchsorted(number, number[-1])), None)
            team = {name: values[last] for name, values in self.series[TEAM].items()}
            error = team[TRACKING] if np.isnan(team[FORMATION]).all() else team[FORMATION]
            settles = settling_time(self.time[last], error)
        return RungRecord(
            key=variant.key,
            label=variant.label,
            kind=variant.kind,
            effect=variant.effect,
            status=self.dataset.attrs["status"],
            message=self.dataset.attrs["message"],
            timestep_s=system.bodies.timestep if bodies else None,
            errors=self.errors(),
            ending=ending,
            settling_time_s=settles,
            distance=largest_distance(self.dataset, ideal.dataset, system.grid.start),
            distance_late=largest_distance(self.dataset, ideal.dataset, middle_of(system)),
            saturation=saturation_of(system, self.dataset, bodies),
        )

    def ending(self) -> Ending | None:
        """Classify the end of the run, or of its last phase if it has events; None if it blew up."""
        return ending_of_run(self.phases, self.dataset) if self.finished else None


def changed_systems(phases: Sequence[Phase], change: Callable[[System], System]) -> tuple[Phase, ...]:
    """Change the system of every phase; phases that share a system still share one."""
    made: dict[int, System] = {}
    for phase in phases:
        if id(phase.system) not in made:
            made[id(phase.system)] = change(phase.system)
    return tuple(replace(phase, system=made[id(phase.system)]) for phase in phases)


def without_terms(system: System) -> System:
    """Return the system under the paper's law alone."""
    return replace(system, law=system.law.without_terms)


def without_links(system: System) -> System:
    """Return the system over perfect links."""
    return replace(system, law=system.law._replace(links=LinkArrays()))


def _without_limits(system: System) -> System:
    """Return the system without velocity limits; absent agents are still commanded to rest."""
    return replace(system, law=system.law._replace(limit=np.where(system.law.limit > 0.0, np.inf, 0.0)))


def has_limits(phases: Sequence[Phase]) -> bool:
    """Return True if some agent has a velocity limit in some phase."""
    agents = len(phases[0].system.team.agents)
    limits = np.array([phase.system.law.limit[:agents] for phase in phases])
    return bool((np.isfinite(limits) & (limits > 0.0)).any())


def display_name(effect: str) -> str:
    """Return the human-readable name of an effect or measure."""
    return effect.replace("_", " ")


def inertial_tau(vehicle: Vehicle) -> Array:
    """Compute M / (M k_v + D) of the controlled velocity along body axes at low speed, shape (n,), s.

    Thrusters do not lag here; `ReducedModel.tau` includes their lag.
    """
    rows = vehicle.steering.velocity_rows[: vehicle.dimension]
    mass, drag = vehicle.moving_mass[rows], np.concatenate([vehicle.drag, vehicle.angular_drag])[rows]
    return np.asarray(mass / (mass * vehicle.rate + drag))


def effects_of(system: System, names: Iterable[str] | None = None) -> list[str]:
    """Return the effects that are on in a scenario and that some of its vehicles have, in the order of EFFECTS.

    A vehicle without an autopilot has inertia if its time constant exceeds `massless_tau`.

    Args:
        system: System of the scenario.
        names: Names of the vehicles to consider; None for all.
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
    """Return the effects that a scenario leaves on, including those that none of its vehicles has."""
    plan = system.bodies
    return frozenset([e for e in _OF_VEHICLES if getattr(plan.effects, e)] + [CONTACTS] * plan.contacts)


def ladder_of(run: System | Sequence[Phase], *, controlled: bool = False) -> list[Variant]:
    """List the variants of a scenario, in the order of the module's table.

    Args:
        run: System of the scenario, or its phases.
        controlled: True if a law in Python is in control.
    """
    phases = phases_of(run)
    system = phases[0].system
    effects, own = effects_of(system), _switched_on(system)
    has_terms = controlled or any(phase.system.law.extended for phase in phases)
    has_links = any(len(phase.system.law.links.table) for phase in phases)
    limited = has_limits(phases)
    ideal = Setup(agents=False, targets=False)

    def bodies(effects: frozenset[str]) -> Setup:
        return Setup(agents=True, targets=True, effects=effects)

    def both(kind: Kind, suffix: str, name: str, change: Callable[[Setup], Setup]) -> list[Variant]:
        return [
            Variant(f"ideal-{suffix}", f"ideal, {name}", kind, change(ideal)),
            Variant(f"all-{suffix}", f"all, {name}", kind, change(bodies(own))),
        ]

    engine = Variant("all-mujoco", "all, MuJoCo", "engine", replace(bodies(own), mujoco=True))
    return [
        Variant("ideal", "ideal kinematics", "ideal", ideal),
        Variant("targets", "only targets are bodies", "part", Setup(agents=False, targets=True)),
        Variant("agents", "only agents are bodies", "part", Setup(agents=True, targets=False)),
        Variant("base", "bodies, ideal thrusters", "base", bodies(frozenset())),
        *(Variant(f"+{e}", f"base + {display_name(e)}", "alone", bodies(frozenset([e])), e) for e in effects),
        Variant("all", "all: as given", "all", bodies(own)),
        *(Variant(f"-{e}", f"all - {display_name(e)}", "without", bodies(own - {e}), e) for e in effects),
        *(both("law", "terms", "paper's law", lambda s: replace(s, terms=False)) if has_terms else []),
        *(both("links", "links", "perfect links", lambda s: replace(s, links=False)) if has_links else []),
        *(both("limit", "limit", "no velocity limit", lambda s: replace(s, limited=False)) if limited else []),
        *([engine] if system.bodies.engine != "mujoco" else []),
    ]


def run_ablation(
    run: System | Sequence[Phase],
    ladder: list[Variant],
    progress: Progress = no_progress,
    *,
    law: LawFile | None = None,
    seed: int = 0,
) -> dict[str, Run]:
    """Run every variant of a ladder; equal setups run once. A run that blows up is marked, and the others continue.

    Bodies without mass can be too stiff for the timestep of the scenario. If they blow up, they run again with a tenth
    of it, so that the integrator is ruled out as the cause. The scenario as given never runs again.

    Args:
        run: System of the scenario, or its phases.
        ladder: Variants to run.
        progress: Callback, called with 'simulating variants', the variants done and the number of variants.
        law: Law in Python, constructed anew for every run; None for the scenario's own.
        seed: Seed of the law's random numbers.

    Returns:
        Runs by key.
    """
    phases = phases_of(run)
    whole = {variant.setup for variant in ladder if variant.kind == "all"}

    @cache
    def record(setup: Setup) -> tuple[tuple[Phase, ...], xr.Dataset, Array]:
        here = changed_systems(phases, setup.apply)
        controlling = law if setup.terms else None
        dataset, asked = _simulate(here, setup, record, controlling, seed)
        if dataset.attrs["status"] == "unstable" and setup not in whole and (setup.agents or setup.targets):
            here = changed_systems(here, _with_finer_timestep)
            dataset, asked = _simulate(here, setup, record, controlling, seed)
        return here, dataset, asked

    runs = {}
    for k, variant in enumerate(ladder):
        progress("simulating variants", k, len(ladder))
        runs[variant.key] = Run(variant, *record(variant.setup))
    progress("simulating variants", len(ladder), len(ladder))
    return runs


def _with_finer_timestep(system: System) -> System:
    """Return the system with a tenth of its timestep."""
    return replace(system, bodies=replace(system.bodies, timestep=system.bodies.timestep / 10))


def _simulate(
    phases: tuple[Phase, ...],
    setup: Setup,
    other: Callable[[Setup], tuple[tuple[Phase, ...], xr.Dataset, Array]],
    law: LawFile | None,
    seed: int,
) -> tuple[xr.Dataset, Array]:
    """Run one setup, and return its data and the commanded speeds; see `Run`.

    If only agents or only targets are bodies, the targets follow their positions in another run.
    """
    source = targets = None
    if setup.agents != setup.targets:
        _, source, asked = other(replace(setup, agents=setup.targets))
        targets = np.nan_to_num(source["target_position"].values)
        if len(targets) < 2:
            return source, asked
    backend = "physics" if setup.agents else "ideal"
    with engine_of(phases, backend, controller=law.load(seed) if law else None) as engine:
        samples = phases[0].system.grid.steps + 1
        pieces = list(engine.record(samples, targets))
        (dataset,) = datasets_of(pieces, phases, backend, seed, samples, engine.controller)
    if source is not None and source.attrs["status"] == "unstable" and dataset.attrs["status"] == "finished":
        why = f"the run that provides its targets ended: {source.attrs['message']}"
        dataset.attrs |= {"status": "unstable", "message": why}
    return dataset, np.linalg.norm(np.concatenate([piece.log.command for piece in pieces]), axis=2)
