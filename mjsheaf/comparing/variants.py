"""The ladder: variants of a scenario from ideal kinematics to its own bodies, one effect at a time.

With their runs, the errors of these, the budget of an error by effect, and how bodies converge to the ideal run.

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

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Literal, get_args

import numpy as np
import xarray as xr
from pydantic import Field

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.checking.loop.body_loop import ending_of_run
from mjsheaf.law.edges import LinkArrays
from mjsheaf.loop.session import engine_of
from mjsheaf.loop.system import Phase, System
from mjsheaf.progress import Report, no_progress
from mjsheaf.results import metrics
from mjsheaf.results.ending import Ending, settling_time
from mjsheaf.runs.simulate import datasets_of
from mjsheaf.scenario.load import LawFile
from mjsheaf.section import OF_NONE, PER_AGENT_RMS, Finite, FiniteRecord, Norm
from mjsheaf.vehicles.effects import Effects, has_effects

Role = Literal["agents", "targets"]
ROLES: tuple[Role, Role] = ("agents", "targets")

Statistic = Literal["late", "final"]
Measure = Literal["tracking_error", "formation_error"]

TRACKING: Literal["tracking_error"] = "tracking_error"
FORMATION: Literal["formation_error"] = "formation_error"

RMS_OVER = {TRACKING: "RMS over agents", FORMATION: "RMS over edges"}
"""Norm of a team's error at a sample."""
TEAM = "team"
"""Scope of the whole team's errors; the other scopes are names of groups."""

Series = dict[str, dict[str, Array]]
"""Errors over time by scope, then by field of ErrorsRecord, shape (T,), m; NaN where undefined."""


class ErrorsRecord(FiniteRecord):
    """Errors of the team or of a group, m."""

    tracking_error: Finite = Field(description="RMS over agents")
    formation_error: Finite = Field(description="RMS over edges inside formation groups")
    centering_error: Finite = Field(description="largest over groups")
    norm: Norm = Field(PER_AGENT_RMS, description=OF_NONE)


class ScopeRecord(FiniteRecord):
    """Errors of the team or of a group, at the end and on average."""

    final: ErrorsRecord = Field(description="at the last sample of the run or phase, as in summary.json")
    late: ErrorsRecord = Field(description="RMS over the second half of the run or phase")

    def error(self, measure: str, statistic: Statistic = "late") -> float | None:
        """Return one error by its field, m."""
        found: float | None = getattr(getattr(self, statistic), measure)
        return found


class DistanceRecord(FiniteRecord):
    """Largest distance of an agent from its position in the ideal run."""

    distance_m: float
    agent: str
    time_s: float


class SaturationRecord(FiniteRecord):
    """Fraction of the time that thrusters spend at a limit."""

    role: Role
    vehicle: str = Field(description="empty: all agents")
    share: float = Field(description="fraction of time and thrusters at a limit, 0 to 1")


def series_at_q_star(phases: Sequence[Phase], dataset: xr.Dataset) -> Series:
    """Compute the errors over time that a run would have with every agent at its harmonic extension."""
    positions = np.concatenate([dataset["harmonic_extension"].values, dataset["target_position"].values], axis=1)
    number = dataset["phase"].values
    parts = []
    for k in np.unique(number):
        team, groups = metrics.error_series(
            phases[k].system.team, positions[number == k], time=dataset["time"].values[number == k]
        )
        parts.append({TEAM: team, **groups})
    return {
        scope: {name: np.concatenate([part[scope][name] for part in parts]) for name in own}
        for scope, own in parts[0].items()
    }


@dataclass(frozen=True)
class Span:
    """Range of samples over which errors are measured: the whole run, or a phase.

    Attributes:
        first: Number of the first sample.
        end: Number of the last sample, plus 1.
    """

    first: int
    end: int

    def last_half(self, samples: int) -> BoolArray:
        """Mark the samples of its second half among those of a run, shape (T,)."""
        number = np.arange(samples)
        return np.asarray((number >= 0.5 * (self.first + self.end - 1)) & (number < self.end))


def span_of(phases: Sequence[Phase], number: int | None = None) -> Span:
    """Return the span of a phase, by its number, or of the whole run as requested."""
    end = phases[0].system.grid.steps + 1
    if number is None:
        return Span(0, end)
    following = phases[number + 1 :]
    return Span(phases[number].start, following[0].start if following else end)


def errors_by_scope(series: Series, span: Span, *, complete: bool) -> dict[str, ScopeRecord]:
    """Measure errors at the last sample of a span, and RMS over its second half.

    Args:
        series: Errors over the whole run.
        span: Range of samples.
        complete: False if the run blew up within the span, which makes all its errors null.
    """
    chosen = span.last_half(len(series[TEAM][TRACKING]))

    def record(value: Callable[[Array], float], own: Mapping[str, Array]) -> ErrorsRecord:
        return ErrorsRecord(**{name: value(x) if complete else None for name, x in own.items()})

    return {
        scope: ScopeRecord(
            final=record(lambda x: x[span.end - 1], own),
            late=record(lambda x: root_mean_square(x, chosen), own),
        )
        for scope, own in series.items()
    }


def positions_at_q_star(system: System, positions: Array) -> Array:
    """Return positions of a run with its agents moved to the harmonic extension of its targets, shape (T, V, 3), m."""
    placed = positions.copy()
    placed[:, : len(system.team.agents)] = system.team.harmonic_extension(positions)  # NaN for absent agents
    return placed


def formation_size(system: System) -> float:
    """Compute the RMS desired length of the edges inside groups, m; NaN if there are none."""
    asked = [float(e.b @ e.b) for f in system.team.formations for e in system.team.formation_edges(f)]
    return float(np.sqrt(np.mean(asked))) if asked else float("nan")


def root_mean_square(values: Array, chosen: BoolArray) -> float:
    """Compute the RMS of the chosen samples, ignoring NaN; NaN if there are none."""
    known = values[chosen][~np.isnan(values[chosen])]
    return float(np.sqrt((known**2).mean())) if known.size else float("nan")


def distances(one: xr.Dataset, other: xr.Dataset) -> Array:
    """Compute each agent's distance between two runs, over the samples that both have, shape (T, N), m.

    It is 0 while the agent is absent.
    """
    samples = min(one.sizes["time"], other.sizes["time"])
    apart = one["agent_position"].values[:samples] - other["agent_position"].values[:samples]
    return np.where(present_in(one)[:samples], np.linalg.norm(np.nan_to_num(apart), axis=2), 0.0)


def largest_distance(one: xr.Dataset, other: xr.Dataset, start: float) -> DistanceRecord | None:
    """Find the largest of `distances` after time `start`, s; None without samples, or if it is not finite."""
    apart = distances(one, other)
    time = one["time"].values[: len(apart)]
    apart[time < start - 1e-9] = -1.0
    k, i = np.unravel_index(int(apart.argmax()), apart.shape)
    if not 0.0 <= apart[k, i] < np.inf:
        return None
    return DistanceRecord(distance_m=apart[k, i], agent=str(one["agent"].values[i]), time_s=time[k])


def present_in(dataset: xr.Dataset) -> BoolArray:
    """Return True for agents that are part of the team at each sample of a run, shape (T, N)."""
    return np.isfinite(dataset["tracking_error"].values)


def vehicles_by_role(system: System) -> dict[tuple[Role, str], list[int]]:
    """Return the numbers of the vehicles of each kind by role and name, agents first."""
    found: dict[tuple[Role, str], list[int]] = {}
    for v, name in enumerate(system.bodies.vehicle):
        found.setdefault((ROLES[v >= len(system.team.agents)], name), []).append(v)
    return found


def saturation_of(system: System, dataset: xr.Dataset, roles: Sequence[Role]) -> list[SaturationRecord]:
    """Measure the fraction of time that thrusters are at a limit, for all agents, then by role and vehicle.

    Only the given `roles` are reported, which are bodies. Agents count while they are present.
    """
    if "agent_saturation" not in dataset:
        return []
    present = present_in(dataset)
    count = present.sum(axis=0)
    N = len(count)
    total = np.where(present, dataset["agent_saturation"].values, 0.0).sum(axis=0)
    share = np.append(total / np.maximum(count, 1), dataset["target_saturation"].values.mean(axis=0))
    found = [
        SaturationRecord(
            role="agents",
            vehicle="",
            share=np.average(share[:N], weights=count * [len(vehicle.thrusters) for vehicle in system.vehicles[:N]]),
        )
    ]
    for (role, name), members in vehicles_by_role(system).items():
        there = [v for v in members if v >= N or count[v]]
        if there and role in roles:
            found.append(SaturationRecord(role=role, vehicle=name, share=share[there].mean()))
    return found


class ItemRecord(FiniteRecord):
    """Part of an error that is due to one effect."""

    effect: str
    alone_m: Finite = Field(description="error that it adds to bodies with ideal thrusters")
    give_back_m: Finite = Field(description="error that removing it from the scenario as given saves")


class BudgetRecord(FiniteRecord):
    """Budget of one error: ideal + targets + agents + together + alone of all effects + interaction = all."""

    scope: str
    measure: Measure
    statistic: Statistic
    norm: Norm = Field(PER_AGENT_RMS, description=OF_NONE)
    at_q_star_m: Finite = Field(
        description="error with the agents at q* along the ideal run, which no law or vehicle can reduce; not part of "
        "the sum"
    )
    ideal_m: Finite
    targets_m: Finite = Field(description="error that targets add as bodies with ideal thrusters")
    agents_m: Finite = Field(description="error that agents add as bodies with ideal thrusters")
    together_m: Finite = Field(description="error that both together add beyond the sum of the two")
    effects: list[ItemRecord]
    interaction_m: Finite = Field(description="error that all effects together add beyond the sum of each alone")
    all_m: Finite


def budgets_of(
    errors: Mapping[str, Mapping[str, ScopeRecord]], at_q_star: Mapping[str, ScopeRecord]
) -> list[BudgetRecord]:
    """Compute the budget of every error, by scope, measure and statistic; see `budget_of`."""
    return [
        budget_of(
            (scope, measure, statistic),
            {key: own[scope].error(measure, statistic) for key, own in errors.items()},
            there.error(measure, statistic),
        )
        for scope, there in at_q_star.items()
        for measure in (FORMATION, TRACKING)
        for statistic in get_args(Statistic)
    ]


def budget_of(
    kind: tuple[str, Measure, Statistic], errors: Mapping[str, float | None], at_q_star: float | None
) -> BudgetRecord:
    """Compute the budget of one error. With each key standing for the error of that variant of the ladder:

        all = ideal + (targets - ideal) + (agents - ideal) + together + sum over effects (+EFFECT - base) + interaction

    Removing an effect gives back all - (-EFFECT). Because of the interaction this differs from what the effect adds
    alone. It is what the advice is based on.

    Args:
        kind: Scope, measure and statistic of the error.
        errors: Error of each variant of the ladder by key, m; None if it blew up, which makes its sums null.
        at_q_star: Error with the agents at q* along the ideal run, m.
    """
    value = {key: np.nan if error is None else error for key, error in errors.items()}
    ideal, base, whole = value["ideal"], value["base"], value["all"]
    targets, agents = value["targets"] - ideal, value["agents"] - ideal
    alone = {key[1:]: value[key] - base for key in value if key.startswith("+")}
    scope, measure, statistic = kind
    return BudgetRecord(
        scope=scope,
        measure=measure,
        statistic=statistic,
        at_q_star_m=at_q_star,
        ideal_m=ideal,
        targets_m=targets,
        agents_m=agents,
        together_m=base - ideal - (targets + agents),
        effects=[ItemRecord(effect=e, alone_m=alone[e], give_back_m=whole - value[f"-{e}"]) for e in alone],
        interaction_m=whole - base - sum(alone.values()),
        all_m=whole,
    )


# -- variants and their runs -------------------------------------------------------------------------------------------


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
        engine = "mujoco" if self.mujoco else system.bodies.engine
        changed = replace(
            system, bodies=replace(system.bodies, effects=effects, contacts=CONTACTS in self.effects, engine=engine)
        )
        changed = changed if self.terms else without_terms(changed)
        changed = changed if self.links else without_links(changed)
        return replace(changed, unlimited=not self.limited)


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
        return np.asarray(
            np.array([phase.system.law.limit[:agents] for phase in self.phases])[self.dataset["phase"].values]
        )

    @cached_property
    def series(self) -> Series:
        """Errors over time: the team's first, then its groups'."""
        team, groups = metrics.series_of(self.system.team, self.dataset, 0)
        names = (TRACKING, FORMATION, "centering_error")
        return {scope: {name: own[name] for name in names} for scope, own in {TEAM: team, **groups}.items()}

    def completes(self, number: int | None = None) -> bool:
        """Return True if the run reached the end of a phase, or its own."""
        return self.finished or (number is not None and self.dataset.sizes["time"] >= span_of(self.phases, number).end)

    def errors(self, number: int | None = None) -> dict[str, ScopeRecord]:
        """Measure the errors over a phase, or the whole run, by scope; they are null if the run did not complete it."""
        return errors_by_scope(self.series, span_of(self.phases, number), complete=self.completes(number))

    def record(self, ideal: "Run") -> RungRecord:
        """Return the record of the run for compare.json.

        Args:
            ideal: Run of ideal kinematics, the reference for distances.
        """
        system, variant = self.system, self.variant
        middle = system.grid.start + 0.5 * system.grid.period * system.grid.steps
        bodies = [role for role in ROLES if getattr(variant.setup, role)]
        ending = self.ending()
        settles = None
        if ending == "settled":
            number = self.dataset["phase"].values
            last = slice(int(np.searchsorted(number, number[-1])), None)
            team = {name: values[last] for name, values in self.series[TEAM].items()}
            settles = settling_time(
                self.time[last], team[TRACKING] if np.isnan(team[FORMATION]).all() else team[FORMATION]
            )
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
            distance_late=largest_distance(self.dataset, ideal.dataset, middle),
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


def has_limits(phases: Sequence[Phase]) -> bool:
    """Return True if some agent has a velocity limit in some phase."""
    agents = len(phases[0].system.team.agents)
    limits = np.array([phase.system.law.limit[:agents] for phase in phases])
    return bool((np.isfinite(limits) & (limits > 0.0)).any())


def display_name(effect: str) -> str:
    """Return the human-readable name of an effect or measure."""
    return effect.replace("_", " ")


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
        if vehicle.reduced_model().tau_with(0.0).max() > plan.effects.massless_tau * (1.0 + 1e-9):
            found.add("inertia")
    return [effect for effect in EFFECTS if effect in found & _switched_on(system)]


def _switched_on(system: System) -> frozenset[str]:
    """Return the effects that a scenario leaves on, including those that none of its vehicles has."""
    return frozenset(
        [e for e in _OF_VEHICLES if getattr(system.bodies.effects, e)] + [CONTACTS] * system.bodies.contacts
    )


def ladder_of(phases: Sequence[Phase], *, controlled: bool = False) -> list[Variant]:
    """List the variants of a scenario, in the order of the module's table.

    Args:
        phases: Phases of the scenario.
        controlled: True if a law in Python is in control.
    """
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
    phases: Sequence[Phase],
    ladder: list[Variant],
    progress: Report = no_progress,
    *,
    law: LawFile | None = None,
    seed: int = 0,
) -> dict[str, Run]:
    """Run every variant of a ladder; equal setups run once. A run that blows up is marked, and the others continue.

    Bodies without mass can be too stiff for the timestep of the scenario. If they blow up, they run again with a tenth
    of it, so that the integrator is ruled out as the cause. The scenario as given never runs again.

    Args:
        phases: Phases of the scenario.
        ladder: Variants to run.
        progress: Callback, called with 'simulating variants', the variants done and the number of variants.
        law: Law in Python, constructed anew for every run; None for the scenario's own.
        seed: Seed of the law's random numbers.

    Returns:
        Runs by key.
    """
    whole = {variant.setup for variant in ladder if variant.kind == "all"}

    @cache
    def record(setup: Setup) -> tuple[tuple[Phase, ...], xr.Dataset, Array]:
        here = changed_systems(phases, setup.apply)
        controlling = law if setup.terms else None
        dataset, asked = _simulate(here, setup, record, controlling, seed)
        if dataset.attrs["status"] == "unstable" and setup not in whole and (setup.agents or setup.targets):
            here = changed_systems(
                here, lambda s: replace(s, bodies=replace(s.bodies, timestep=s.bodies.timestep / 10))
            )
            dataset, asked = _simulate(here, setup, record, controlling, seed)
        return here, dataset, asked

    runs = {}
    for k, variant in enumerate(ladder):
        progress("simulating variants", k, len(ladder))
        runs[variant.key] = Run(variant, *record(variant.setup))
    progress("simulating variants", len(ladder), len(ladder))
    return runs


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
        dataset.attrs |= {
            "status": "unstable",
            "message": f"the run that provides its targets ended: {source.attrs['message']}",
        }
    return dataset, np.linalg.norm(np.concatenate([piece.log.command for piece in pieces]), axis=2)


# -- bodies with a shrinking time constant -----------------------------------------------------------------------------


_COUNT, _RATIO = 4, 2.0
_STEPS_PER_TAU = 10


class PointRecord(FiniteRecord):
    """Bodies with one time constant tau."""

    tau_s: float
    timestep_s: float
    distance_m: float | None


class ConvergenceRecord(FiniteRecord):
    """Largest distance to the ideal run, both from q*, against the time constant tau of all bodies.

    Both runs are under the paper's law alone and over perfect links, which are what the theory covers: terms and
    sensors respond differently to bodies and to ideal kinematics.
    """

    points: list[PointRecord]
    start_s: float
    end_s: float
    slope: float | None = Field(description="least-squares slope on log-log axes; theory: 1")
    constant: float | None = Field(description="distance = constant tau^slope, m and s")
    reason: str = Field(description="why there is no slope, or empty")


def converge(
    system: System,
    progress: Report = no_progress,
    *,
    span: float = 6.0,  # s; runs at short steps cost
    catch_up: float = 10.0,  # time constants over which bodies catch up with the flow
    shortest: float = 1e-5,  # s
    of_own: float = 0.5,  # of a vehicle's time constant
    of_law: float = 0.25,  # of the law's
) -> ConvergenceRecord:
    """Run bodies with inertia as their only effect, at time constants halved from one to the next.

    Agents start at q*, in the scenario's flow and following its targets. From anywhere else the law's first command
    would be a jump, which makes boats pitch and roll however small tau is.

    The largest time constant is half of the quickest vehicle's, and at most a quarter of 1 / (k1 lambda_max), the time
    constant of the law's fastest mode; above that, the distance is not yet of first order. Underactuated vehicles get
    thrusters along every axis. The timestep is at most a tenth of tau, and divides the period.
    """
    system = _with_inertia(replace(system, initial=positions_at_q_star(system, system.initial[None])[0]), None)
    grid = system.grid
    largest = of_own * min(float(v.reduced_model().tau_with(0.0).min()) for v in system.vehicles)
    fastest = system.gain * system.largest_eigenvalue
    if fastest > 0.0:
        largest = min(largest, of_law / fastest)
    start = grid.start + catch_up * largest
    steps = min(grid.steps, int(np.ceil((catch_up * largest + span) / grid.period)))
    end = grid.start + steps * grid.period
    taus = [largest / _RATIO**k for k in range(_COUNT)]
    smallest = taus[-1] / _STEPS_PER_TAU
    if smallest < shortest:
        return _record(start, end, [], f"bodies or law are so fast that timesteps of {smallest:.2g} s would be needed")
    system = replace(system, grid=replace(grid, steps=steps))
    ideal = engine_of(system, "ideal").run()
    if ideal.status != "finished" or end <= start:
        return _record(start, end, [], ideal.message or "the run is too short")
    points = []
    for k, tau in enumerate(taus):
        progress("converging", k, _COUNT)
        timestep = grid.period / np.ceil(grid.period / min(tau / _STEPS_PER_TAU, system.bodies.timestep) - 1e-9)
        here = _with_inertia(system, tau)
        run = engine_of(replace(here, bodies=replace(here.bodies, timestep=float(timestep)))).run()
        distance = None
        if run.status == "finished":
            apart = (run.positions - ideal.positions)[run.time >= start - 1e-9, : len(system.team.agents)]
            distance = float(np.linalg.norm(apart, axis=2).max())
        points.append(PointRecord(tau_s=tau, timestep_s=timestep, distance_m=distance))
    progress("converging", _COUNT, _COUNT)
    return _record(start, end, points)


def _record(start: float, end: float, points: list[PointRecord], reason: str = "") -> ConvergenceRecord:
    """Fit the distances over time constants by a power law, if at least two of them are known."""
    slope = constant = None
    known = [(p.tau_s, p.distance_m) for p in points if p.distance_m]
    if len(known) >= 2:
        tau, distance = np.log(np.array(known)).T
        slope, intercept = np.polyfit(tau, distance, 1)
        constant = np.exp(intercept)
    return ConvergenceRecord(points=points, start_s=start, end_s=end, slope=slope, constant=constant, reason=reason)


def _with_inertia(system: System, tau: float | None) -> System:
    """Return the system under the paper's law over perfect links, on bodies with inertia alone.

    `tau` is their time constant, s; None keeps each vehicle's own.
    """
    plan = system.bodies
    only = Effects(inertia=True, drag_law=False, limits=False, lag=False, underactuation=False)
    constant = plan.time_constant if tau is None else tau
    return replace(
        without_links(without_terms(system)), bodies=replace(plan, effects=only, time_constant=constant, contacts=False)
    )
