"""Measures of a run (errors, distance to the ideal run, saturation) and the budget of an error by effect."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import xarray as xr
from pydantic import Field

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.loop.system import Phase, System, phases_of
from mjsheaf.results import metrics
from mjsheaf.section import OF_NONE, PER_AGENT_RMS, Finite, FiniteRecord, Norm

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


_MEASURED = ("tracking_error", "formation_error", "centering_error")


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


def series_of(system: System, dataset: xr.Dataset) -> Series:
    """Read the errors of a run over time: the team's first, then its groups'."""
    team, groups = metrics.series_of(system.team, dataset, 0)
    return {scope: {name: own[name] for name in _MEASURED} for scope, own in {TEAM: team, **groups}.items()}


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


def span_of(run: System | Sequence[Phase], number: int | None = None) -> Span:
    """Return the span of a phase, by its number, or of the whole run as requested."""
    phases = phases_of(run)
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
    team = system.team
    placed = positions.copy()
    placed[:, : len(team.agents)] = team.harmonic_extension(positions)  # NaN for absent agents
    return placed


def formation_size(system: System) -> float:
    """Compute the RMS desired length of the edges inside groups, m; NaN if there are none."""
    team = system.team
    asked = [float(e.b @ e.b) for f in team.formations for e in team.formation_edges(f)]
    return float(np.sqrt(np.mean(asked))) if asked else float("nan")


def middle_of(system: System) -> float:
    """Return the time at which the second half of the requested run begins, s."""
    return system.grid.start + 0.5 * system.grid.period * system.grid.steps


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
    distance = np.linalg.norm(np.nan_to_num(apart), axis=2)
    return np.where(present_in(one)[:samples], distance, 0.0)


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
    weights = count * [len(vehicle.thrusters) for vehicle in system.vehicles[:N]]
    found = [SaturationRecord(role="agents", vehicle="", share=np.average(share[:N], weights=weights))]
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
