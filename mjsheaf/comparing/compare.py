"""The whole comparison: ladder, budgets, ringing, convergence, demands and a verdict, as one record."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mjsheaf._version import __version__
from mjsheaf.checking.loop.body_loop import loop_along
from mjsheaf.comparing.convergence import ConvergenceRecord, converge
from mjsheaf.comparing.demands import JUDGED, UnlimitedRuns, demands_of, fastest_vehicles, run_without_limits
from mjsheaf.comparing.gains import examine_gain
from mjsheaf.comparing.ladder import Run, ladder_of, run_ablation, span_of_phase
from mjsheaf.comparing.measures import Series, budgets_of, errors_by_scope, formation_size, unknown_errors, whole_run
from mjsheaf.comparing.ringing import predicted_damping, ringing_of
from mjsheaf.comparing.verdict import CompareRecord, LoopRecord, PhaseRecord, levers_of, verdict_of
from mjsheaf.control.source import LawFile
from mjsheaf.jit import working_time
from mjsheaf.results.dataset import law_of
from mjsheaf.runs.diagnostics import examine_terms
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.session import moved_by, require_simulable
from mjsheaf.system import Phase, phases_of


@dataclass(frozen=True)
class Comparison:
    """A comparison, as compare.json holds it, and the runs of its ladder by key."""

    record: CompareRecord
    runs: dict[str, Run]


def compare(
    scenario: Scenario,
    progress: Progress = no_progress,
    *,
    engine: str = "mujoco",
    threads: int | None = None,
    law: LawFile | None = None,
) -> Comparison:
    """Compare a scenario's ideal kinematics with its bodies.

    Every variant of a scenario with events runs the same phases. Ringing is measured in the phase whose least damped
    mode is predicted to have the smallest damping ratio; convergence is that of the team with which the run begins.

    Args:
        scenario: from `load_scenario`.
        progress: called with (what is being done, done, in all).
        engine, threads: see `simulate`; with another engine than MuJoCo, MuJoCo's run is compared too.
        law: Law in Python in place of the scenario's; it is constructed anew for every run.

    Raises:
        InputError: The engine, a vehicle, g or the law does not fit the scenario.
        NotUniqueError: The harmonic extension is not unique, in some phase.
    """
    begun = working_time()
    phases = phases_of(moved_by(scenario.phases, "physics", engine, threads))
    require_simulable(phases, "physics")
    system = phases[0].system
    runs = run_ablation(phases, ladder_of(phases, controlled=law is not None), progress, law=law, seed=scenario.seed)
    ideal = runs["ideal"]
    at_q_star = ideal.recording.series_at_q_star()
    limits = run_without_limits(phases, runs, law, scenario.seed)
    watched = _least_damped_phase(phases)
    theory = _theory(phases, runs, watched, progress) if law is None else dict.fromkeys(_THEORY)
    draft = CompareRecord(
        mjsheaf_version=__version__,
        scenario=scenario.name,
        seed=scenario.seed,
        law=law.label if law else law_of(system),
        controller=law.label if law else None,
        terms=[] if law else list(system.law.term_names),
        harm=[] if law else _harm(phases, runs["all"], scenario.seed),
        time_s=system.grid.period * system.grid.steps,
        formation_size_m=formation_size(system),
        ladder=[run.record(ideal) for run in runs.values()],
        budgets=budgets_of(
            {key: run.errors for key, run in runs.items()},
            errors_by_scope(at_q_star, whole_run(system), complete=ideal.finished),
        ),
        ringing_phase=watched if theory["ringing"] and len(phases) > 1 else None,
        convergence=_convergence(phases, law, progress),
        velocity_limit=limits.record() if limits else None,
        demands=[demand for key in JUDGED for demand in demands_of(system, key, runs[key])],
        fastest=fastest_vehicles(system),
        phases=_phases(phases, runs, at_q_star, limits),
        verdict=[],
        wall_time_s=working_time() - begun,
        video=None,
        **theory,
    )
    own = [phase.model_copy(update={"levers": levers_of(draft, phase)}) for phase in draft.phases]
    return Comparison(draft.model_copy(update={"phases": own, "verdict": verdict_of(draft)}), runs)


_THEORY = ("gain", "ringing", "loop", "gains", "usable_gain")
"""Fields of a CompareRecord that a law in Python has not."""


def _theory(phases: Sequence[Phase], runs: dict[str, Run], watched: int, progress: Progress) -> dict[str, Any]:
    """Return what theory and experiments say of the compiled law's gain: see `_THEORY`."""
    damped = phases[watched].system.remaining
    progress("free-decay test", 0, 1)
    ringing = ringing_of(damped)
    progress("free-decay test", 1, 1)
    loop = _loop(phases, runs["ideal"])
    gains = examine_gain(phases, runs, damped, ringing, loop.largest_gain if loop else None, progress)
    usable = min((limit.gain for limit in gains.limits), default=None) if gains else None
    return dict(zip(_THEORY, (phases[0].system.gain, ringing, loop, gains, usable), strict=True))


def _phases(
    phases: Sequence[Phase], runs: dict[str, Run], at_q_star: Series, limits: UnlimitedRuns | None
) -> list[PhaseRecord]:
    """The errors of every phase that the ideal run reached; none without events."""
    if not any(phase.events for phase in phases):
        return []
    ideal, found = runs["ideal"], []
    for k, phase in enumerate(phases[: len(ideal.recording.pieces)]):
        span = span_of_phase(phases, k)
        reached = {key: k < len(run.recording.pieces) for key, run in runs.items()}
        errors = {key: run.errors_in_phase(k) for key, run in runs.items() if reached[key]}
        complete = ideal.finished or k + 1 < len(ideal.recording.pieces)
        there = errors_by_scope(at_q_star, span, complete=complete)
        known = {key: errors.get(key, unknown_errors(there)) for key in runs}
        judged = limits is not None and all(reached[key] for key in JUDGED)
        found.append(
            PhaseRecord(
                start=phase.time,
                end=float(phase.system.grid.span(span.end - 1, span.end)[0]),
                events=list(phase.events),
                errors=known,
                budgets=budgets_of(known, there),
                velocity_limit=limits.record(k) if limits is not None and judged else None,
                levers=[],
            )
        )
    return found


def _least_damped_phase(phases: Sequence[Phase]) -> int:
    """The number of the phase whose least damped mode is predicted to have the smallest damping ratio."""
    if len(phases) == 1:
        return 0
    dampings = [predicted_damping(phase.system.remaining) for phase in phases]
    return min(range(len(phases)), key=dampings.__getitem__)


def _convergence(phases: Sequence[Phase], law: LawFile | None, progress: Progress) -> ConvergenceRecord:
    """Convergence of the team with which the run begins, under the paper's law."""
    if law is None:
        return converge(phases[0].system.remaining, progress)
    grid = phases[0].system.grid
    why = f"the law is {law.label}, and theory is about the paper's"
    return ConvergenceRecord(points=[], start_s=grid.start, end_s=grid.start, slope=None, constant=None, reason=why)


def _loop(phases: Sequence[Phase], ideal: Run) -> LoopRecord | None:
    """The loop of the scenario's bodies in the mean flow along the ideal run; the worst of all phases.

    The systems of the ideal run itself are without the effects of bodies.
    """
    if not ideal.finished:
        return None
    found = []
    for phase, piece in zip(phases, ideal.recording.pieces, strict=False):
        if len(piece.time) > 1:
            team = phase.system.team
            q_star = team.harmonic_extension(piece.positions)[:, team.present]
            found.append(loop_along(phase.system.remaining, piece.time, q_star))
    gains = [loop.largest_gain for loop in found if loop.largest_gain is not None]
    stable = [loop.stable for loop in found]
    return LoopRecord(
        stable=False if False in stable else None if None in stable or not stable else True,
        largest_gain=min(gains, default=None),
        reason=next((loop.reason for loop in found if loop.reason), "" if found else "the run is too short"),
    )


def _harm(phases: Sequence[Phase], run: Run, seed: int) -> list[str]:
    """What the terms of the law do wrong in the run of the scenario as it stands."""
    if not any(phase.system.law.extended for phase in phases):
        return []
    found = examine_terms(phases, run.recording.dataset("physics", seed))
    return list(found.harm) if found else []
