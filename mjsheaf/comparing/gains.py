"""Limits of the law's gain, and runs of the bodies at higher gains."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from mjsheaf.checking.finished import Ending
from mjsheaf.comparing.ladder import Run, Variant, changed_systems, run_ablation
from mjsheaf.comparing.measures import TEAM, ErrorsRecord, saturation_of
from mjsheaf.comparing.ringing import RingingRecord, gain_limits
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.section import Finite, FiniteRecord
from mjsheaf.system import Phase, System

_FACTORS = (2.0, 4.0)  # multiples of the present gain that are tried
_BELOW_UNSTABLE = 0.9  # largest gain that is tried, as a fraction of the gain that makes the loop unstable
_WORTH_TRYING = 1.05  # smallest multiple of the present gain that is tried


class GainLimitRecord(FiniteRecord):
    """A gain above which the team rings or is unstable."""

    gain: float = Field(description="k1, 1/s")
    kind: Literal["rings", "unstable"] = Field(
        description="rings: the damping ratio of the least damped mode falls to 0.3, or the sampled law begins to "
        "oscillate; unstable: the vehicles' loop becomes unstable"
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


def examine_gain(
    phases: Sequence[Phase],
    runs: dict[str, Run],
    part: System,
    ringing: RingingRecord | None,
    largest_stable: float | None,
    progress: Progress = no_progress,
) -> GainRecord:
    """Find what limits the gain, and run the bodies as given at 2 and 4 times the gain.

    Args:
        phases: Phases of the scenario.
        runs: Runs of the ladder.
        part: System for which `ringing` was measured.
        ringing: See `ringing_of`.
        largest_stable: Gain above which the vehicles' loop is unstable, 1/s; None if unknown.
        progress: See `Progress`.
    """
    limits = [
        GainLimitRecord(gain=found.gain, kind="rings", effect=found.effect, agent=found.agent)
        for found in gain_limits(part, ringing)
    ]
    if largest_stable is not None:
        limits.append(GainLimitRecord(gain=largest_stable, kind="unstable", effect="loop", agent=""))
    factors = _factors(phases[0].system.gain, largest_stable)
    trials = [_trial(runs["all"], phases[0].system.gain)] if factors else []
    variant = Variant("all", "higher gain", "all", runs["all"].variant.setup)
    for k, factor in enumerate(factors):
        progress("trying higher gains", k, len(factors))
        raised = run_ablation(_with_gain(phases, factor), [variant])["all"]
        trials.append(_trial(raised, factor * phases[0].system.gain))
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
    total = saturation_of(run.trajectory, ["agents"], run.recording.present)
    return GainTrialRecord(
        gain=gain,
        status=run.trajectory.status,
        ending=run.ending(),
        late=run.errors[TEAM].late,
        saturated=total[0].share if total else None,
    )
