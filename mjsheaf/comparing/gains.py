"""The gain of the law: what limits it, and what raising it gives on the bodies as given, measured."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from mjsheaf.checking.finished import Ending
from mjsheaf.comparing.ladder import Run, Variant, changed_systems, run_ablation
from mjsheaf.comparing.measures import TEAM, ErrorsRecord, saturation_of
from mjsheaf.comparing.ringing import RingingRecord, gain_limits
from mjsheaf.io.section import Finite, FiniteRecord
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.system import Phase, System

_FACTORS = (2.0, 4.0)  # of the present gain, that are tried
_BELOW_UNSTABLE = 0.9  # of the gain from which the loop is unstable, up to which gains are tried
_WORTH_TRYING = 1.05  # of the present gain


class GainLimitRecord(FiniteRecord):
    """A gain from which on something goes wrong."""

    gain: float = Field(description="k1, 1/s")
    kind: Literal["rings", "unstable"] = Field(
        description="rings: the damping ratio of the least damped mode falls to 0.3, or the sampled law begins to "
        "oscillate; unstable: the vehicles' loop is"
    )
    effect: Literal["inertia", "lag", "underactuation", "hold", "links", "loop"] = Field(
        description="what limits it: the bodies' inertia, thrusters that lag, vehicles that turn first, the hold of "
        "the law over its control period, the age of measurements, or all of the vehicles' loop"
    )
    agent: str = Field(description="agent that moves most in the mode; empty if all do, or it is not known")


class GainTrialRecord(FiniteRecord):
    """A run of the bodies as given at a gain."""

    gain: float = Field(description="k1, 1/s")
    status: str
    ending: Ending | None
    late: ErrorsRecord = Field(description="errors of the team, RMS over the last half, m")
    saturated: Finite = Field(description="share of time and thrusters of agents at a limit, 0 to 1")


class GainRecord(FiniteRecord):
    """The gain, what limits it, and runs at higher ones."""

    limits: list[GainLimitRecord] = Field(description="the lowest first")
    trials: list[GainTrialRecord] = Field(description="the present gain first, then higher ones; empty if none is")


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
        phases: What was run.
        runs: Runs of the ladder.
        part: System for which `ringing` was measured.
        ringing: See `ringing_of`.
        largest_stable: Gain from which on the vehicles' loop is unstable, 1/s; None if it is not known.
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
    """Choose by how much the gain is raised; not at all if there is none, or the loop is unstable just above it."""
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
