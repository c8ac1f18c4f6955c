"""The gain: how the team rings, what limits it, and runs of the bodies at higher gains.

Ringing is the least damped mode of the vehicles' loop of `check` (see `body_loop`), in the mean flow along the ideal
run. Losses of links are left out, and so is their noise; delays are part of the loop. The usable gain is that up to
which every mode keeps a damping ratio of 0.3: a displacement then overshoots by 37 %. What limits it is the effect
without which the loop has the largest usable gain.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.body_loop import BodyLoop, loop_along
from mjsheaf.comparing.measures import TEAM, ErrorsRecord, saturation_of
from mjsheaf.comparing.variants import Run, Variant, changed_systems, effects_of, run_ablation, without_links
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.ending import Ending
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.section import Finite, FiniteRecord
from mjsheaf.system import Phase, System

MIN_DAMPING = 0.3
"""Smallest damping ratio at a usable gain."""

_NOTABLE = 1.2  # factor on the usable gain, without an effect, below which it is no cause
_FACTORS = (2.0, 4.0)  # multiples of the present gain that are tried
_BELOW_UNSTABLE = 0.9  # largest gain that is tried, as a fraction of the gain that makes the loop unstable
_WORTH_TRYING = 1.05  # smallest multiple of the present gain that is tried

Effect = Literal["inertia", "lag", "underactuation", "hold", "links"]


class RingingRecord(BodyLoop):
    """The vehicles' loop for small motions: its least damped mode, and what limits the gain."""

    usable_gain: float | None = Field(
        description=f"gain from which on the damping ratio of a mode is below {MIN_DAMPING}, 1/s; null if there is none"
    )
    effect: Effect = Field(description="effect that limits it: without it the usable gain is largest; else inertia")
    without: dict[Effect, float | None] = Field(
        description="usable gain without lag of thrusters, underactuation, the hold of the law or the links' delays, "
        "1/s; null if every gain is usable"
    )


class GainLimitRecord(FiniteRecord):
    """A gain above which the team rings or is unstable."""

    gain: float = Field(description="k1, 1/s")
    kind: Literal["rings", "unstable"] = Field(
        description=f"rings: the damping ratio of the least damped mode falls to {MIN_DAMPING}; unstable: the "
        "vehicles' loop becomes unstable"
    )
    effect: Literal["inertia", "lag", "underactuation", "hold", "links", "loop"] = Field(
        description="cause of the limit: inertia, thruster lag, vehicles that turn before they thrust, the hold of the "
        "law over its control period, the age of measurements, or the vehicles' loop as a whole"
    )
    agent: str = Field(description="agent that moves most in the mode; empty if all do, or if unknown")


class GainTrialRecord(FiniteRecord):
    """A run of the bodies as given at a gain."""

    gain: float = Field(description="k1, 1/s")
    status: str
    ending: Ending | None
    late: ErrorsRecord = Field(description="errors of the team, RMS over the second half, m")
    saturated: Finite = Field(description="fraction of time and of agents' thrusters at a limit, 0 to 1")


class GainRecord(FiniteRecord):
    """Limits of the gain, and runs at higher gains."""

    limits: list[GainLimitRecord] = Field(description="limits of the gain, lowest first")
    trials: list[GainTrialRecord] = Field(description="runs at the present gain, then at higher ones; may be empty")


class Way(NamedTuple):
    """A phase of the ideal run.

    Attributes:
        number: Number of the phase.
        system: Its system, of the agents that are present.
        time: Times of its samples, shape (T,), s.
        q_star: Harmonic extensions, padded with 0, shape (T, N, 3), m.
    """

    number: int
    system: System
    time: Array
    q_star: Array


def ways_of(phases: Sequence[Phase], ideal: Run) -> list[Way]:
    """Return the phases that the ideal run reached, with the bodies of the scenario."""
    found = []
    for k in range(ideal.phases_reached):
        system, data = of_phase(phases, ideal.dataset, k)
        q_star = np.nan_to_num(data["harmonic_extension"].values)
        found.append(Way(k, system, data["time"].values, q_star))
    return [way for way in found if len(way.time) > 1]


def find_ringing(ways: Sequence[Way]) -> tuple[int, RingingRecord | None]:
    """Return the number of the phase whose loop is least damped, and that loop; None if it is undecided in all."""
    least = np.inf
    found: tuple[Way, BodyLoop] | None = None
    for way in ways:
        loop = loop_along(_without_losses(way.system), way.time, way.q_star)
        if loop.least_damped is not None and loop.least_damped.damping < least:
            least = loop.least_damped.damping
            found = way, loop
    if found is None:
        return 0, None
    way, loop = found
    usable = _usable(way, _without_losses(way.system)).largest_gain
    without = {name: one.largest_gain for name, one in _variants(way) if one.least_damped is not None}
    effect: Effect = "inertia"
    if without and usable is not None:
        largest = max(without, key=lambda name: without[name] or np.inf)
        effect = largest if (without[largest] or np.inf) > _NOTABLE * usable else effect
    return way.number, RingingRecord(**loop.model_dump(), usable_gain=usable, effect=effect, without=without)


def _usable(way: Way, system: System) -> BodyLoop:
    """Close the loop of a system; its `largest_gain` is the usable gain."""
    return loop_along(system, way.time, way.q_star, least_damping=MIN_DAMPING)


def _variants(way: Way) -> Iterator[tuple[Effect, BodyLoop]]:
    """Yield the loop without each effect that may limit the gain."""
    system = _without_losses(way.system)
    present = effects_of(system, system.bodies.vehicle[: len(system.team.agents)])
    effects: tuple[Effect, Effect] = ("lag", "underactuation")
    for name in effects:
        if name in present:
            without = system.bodies.effects.model_copy(update={name: False})
            yield name, _usable(way, replace(system, bodies=replace(system.bodies, effects=without)))
    if not (system.grid.continuous or system.law.extended):
        yield "hold", _usable(way, replace(system, grid=replace(system.grid, continuous=True)))
    if system.law.links.table["delay"].any():
        yield "links", _usable(way, without_links(system))


def _without_losses(system: System) -> System:
    """Return the system over links that lose nothing."""
    table = system.law.links.table.copy()
    table["lossy"] = 0
    table["range"] = np.inf
    return replace(system, law=system.law._replace(links=system.law.links._replace(table=table)))


def examine_gain(
    phases: Sequence[Phase],
    runs: dict[str, Run],
    ringing: RingingRecord | None,
    largest_stable: float | None,
    progress: Progress = no_progress,
) -> GainRecord:
    """Find what limits the gain, and run the bodies as given at 2 and 4 times the gain.

    Args:
        phases: Phases of the scenario.
        runs: Runs of the ladder.
        ringing: See `find_ringing`.
        largest_stable: Gain above which the vehicles' loop is unstable, 1/s; None if unknown.
        progress: See `Progress`.
    """
    limits = []
    if ringing is not None and ringing.usable_gain is not None:
        agent = ringing.least_damped.agent if ringing.least_damped else None
        limits.append(GainLimitRecord(gain=ringing.usable_gain, kind="rings", effect=ringing.effect, agent=agent or ""))
    if largest_stable is not None:
        limits.append(GainLimitRecord(gain=largest_stable, kind="unstable", effect="loop", agent=""))
    gain = phases[0].system.gain
    factors = _factors(gain, largest_stable)
    trials = [_trial(runs["all"], gain)] if factors else []
    variant = Variant("all", "higher gain", "all", runs["all"].variant.setup)
    for k, factor in enumerate(factors):
        progress("trying higher gains", k, len(factors))
        raised = run_ablation(_with_gain(phases, factor), [variant])["all"]
        trials.append(_trial(raised, factor * gain))
    return GainRecord(limits=sorted(limits, key=lambda limit: limit.gain), trials=trials)


def _factors(gain: float, largest_stable: float | None) -> list[float]:
    """Choose the factors to raise the gain by; none if the gain is 0, or the loop is unstable just above it."""
    if gain <= 0.0:
        return []
    most = np.inf if largest_stable is None else _BELOW_UNSTABLE * largest_stable / gain
    chosen = dict.fromkeys(min(factor, most) for factor in _FACTORS)
    return [float(f"{factor:.3g}") for factor in chosen if factor > _WORTH_TRYING]


def _with_gain(phases: Sequence[Phase], factor: float) -> tuple[Phase, ...]:
    """Multiply the agents' gain in every phase."""

    def raised(system: System) -> System:
        gain = system.law.gain.copy()
        gain[: len(system.team.agents)] *= factor
        return replace(system, gain=factor * system.gain, law=system.law._replace(gain=gain))

    return changed_systems(phases, raised)


def _trial(run: Run, gain: float) -> GainTrialRecord:
    total = saturation_of(run.system, run.dataset, ["agents"])
    return GainTrialRecord(
        gain=gain,
        status=run.dataset.attrs["status"],
        ending=run.ending(),
        late=run.errors[TEAM].late,
        saturated=total[0].share if total else None,
    )
