"""The whole comparison as one record: ladder, budgets, ringing, convergence, demands, verdict; and its directory."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from mjsheaf._version import __version__
from mjsheaf.checking.theorem.of_run import bounds_of_phases
from mjsheaf.comparing.causes import CompareRecord, PhaseRecord, levers_of, verdict_of
from mjsheaf.comparing.figures import plot_budget, plot_convergence, plot_rungs
from mjsheaf.comparing.margins import (
    JUDGED,
    demands_of,
    fastest_vehicles,
    find_ringing,
    try_gains,
    velocity_limit_of,
    worst_loop,
)
from mjsheaf.comparing.page import report_text
from mjsheaf.comparing.variants import (
    ConvergenceRecord,
    Run,
    Series,
    budgets_of,
    converge,
    errors_by_scope,
    formation_size,
    ladder_of,
    run_ablation,
    series_at_q_star,
    span_of,
)
from mjsheaf.compile.jit import working_time
from mjsheaf.loop.session import prepare_run
from mjsheaf.loop.system import Phase
from mjsheaf.page.page import Ghost, page_of
from mjsheaf.progress import Report, no_progress
from mjsheaf.results.dataset import law_of
from mjsheaf.results.metrics import summarize
from mjsheaf.results.store import replaced_run, save_summary, staging
from mjsheaf.runs.diagnostics import examine_terms
from mjsheaf.runs.publish import draw_video, write_scenario
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import LawFile
from mjsheaf.show.style import AS_USUAL, FigureOptions
from mjsheaf.video.film import both_films, half_options


@dataclass(frozen=True)
class Comparison:
    """A comparison as compare.json records it, and the runs of its ladder by key."""

    record: CompareRecord
    runs: dict[str, Run]


def compare(
    scenario: Scenario,
    progress: Report = no_progress,
    *,
    engine: str = "mujoco",
    threads: int | None = None,
    law: LawFile | None = None,
) -> Comparison:
    """Compare a scenario's ideal kinematics with its bodies.

    Every variant of a scenario with events runs the same phases. Ringing is that of the phase with the smallest damping
    ratio. Convergence is measured for the team of the first phase.

    Args:
        scenario: Scenario from `load_scenario`.
        progress: Callback, called with the name of the activity, the steps done and the number of steps.
        engine: Engine of the bodies; see `simulate`. If it is not MuJoCo, the scenario as given also runs in MuJoCo.
        threads: Number of threads of the engine; see `simulate`.
        law: Law in Python that replaces the scenario's. It is constructed anew for every run.

    Raises:
        InputError: The engine does not support the scenario, a vehicle does not fit its agent, a g does not have full
            row rank, or a law in Python fails.
        NotUniqueError: The harmonic extension is not unique in some phase.
    """
    begun = working_time()
    phases = prepare_run(scenario, "physics", engine, threads)
    system = phases[0].system
    runs = run_ablation(phases, ladder_of(phases, controlled=law is not None), progress, law=law, seed=scenario.seed)
    ideal = runs["ideal"]
    at_q_star = series_at_q_star(phases, ideal.dataset)
    eventful = any(phase.events for phase in phases)
    draft = CompareRecord(
        mjsheaf_version=__version__,
        scenario=scenario.name,
        seed=scenario.seed,
        **_about_law(phases, runs, law, progress),
        time_s=system.grid.period * system.grid.steps,
        formation_size_m=formation_size(system),
        ladder=[run.record(ideal) for run in runs.values()],
        budgets=budgets_of(
            {key: run.errors() for key, run in runs.items()},
            errors_by_scope(at_q_star, span_of(phases), complete=ideal.finished),
        ),
        convergence=_convergence(phases, law, progress),
        velocity_limit=velocity_limit_of(runs),
        demands=[demand for key in JUDGED for demand in demands_of(system, key, runs[key])],
        fastest=fastest_vehicles(system),
        phases=[_phase(phases, k, runs, at_q_star) for k in range(ideal.phases_reached if eventful else 0)],
        verdict=[],
        wall_time_s=working_time() - begun,
        video=None,
    )
    own = [phase.model_copy(update={"levers": levers_of(draft, phase)}) for phase in draft.phases]
    return Comparison(draft.model_copy(update={"phases": own, "verdict": verdict_of(draft)}), runs)


def _about_law(phases: Sequence[Phase], runs: dict[str, Run], law: LawFile | None, progress: Report) -> dict[str, Any]:
    """Return the fields of a `CompareRecord` about the law; a law in Python has only a name."""
    if law is not None:
        return {"law": law.label, "controller": law.label, "gain": None, "usable_gain": None, "ringing": None}
    system = phases[0].system
    progress("closing the vehicles' loop", 0, 1)
    number, ringing = find_ringing(phases, runs["ideal"].dataset)
    loop = worst_loop(phases, runs["ideal"].dataset)
    progress("closing the vehicles' loop", 1, 1)
    terms = examine_terms(phases, runs["all"].dataset) if any(phase.system.law.extended for phase in phases) else None
    harm = [] if terms is None else terms["harm"]
    gains = [loop.largest_gain, *([] if ringing is None else [ringing.largest_gain, ringing.usable_gain])]
    largest, usable = (min(filter(None, some), default=None) for some in (gains[:2], gains))
    return {
        "law": law_of(system),
        "gain": system.gain,
        "terms": list(system.law.term_names),
        "harm": harm,
        "usable_gain": usable,
        "gains": try_gains(phases, runs["all"], largest, progress),
        "loop": loop,
        "ringing": ringing,
        "ringing_phase": None if ringing is None or len(phases) == 1 else number,
    }


def _phase(phases: Sequence[Phase], k: int, runs: dict[str, Run], at_q_star: Series) -> PhaseRecord:
    """Return the errors of a phase, by its number; those of runs that did not reach it are null."""
    span = span_of(phases, k)
    there = errors_by_scope(at_q_star, span, complete=runs["ideal"].completes(k))
    errors = {key: run.errors(k) for key, run in runs.items()}
    return PhaseRecord(
        start=phases[k].time,
        end=float(phases[k].system.grid.span(span.end - 1, span.end)[0]),
        events=list(phases[k].events),
        errors=errors,
        budgets=budgets_of(errors, there),
        velocity_limit=velocity_limit_of(runs, k) if k < runs["all"].phases_reached else None,
        levers=[],
    )


def _convergence(phases: Sequence[Phase], law: LawFile | None, progress: Report) -> ConvergenceRecord:
    """Measure the convergence of the first phase's team under the paper's law."""
    if law is None:
        return converge(phases[0].system.remaining, progress)
    grid = phases[0].system.grid
    return ConvergenceRecord(
        points=[],
        start_s=grid.start,
        end_s=grid.start,
        slope=None,
        constant=None,
        reason=f"the law is {law.label}, and the theory covers only the paper's law",
    )


# -- the directory of a comparison -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Published:
    """A published comparison.

    Attributes:
        directory: Its directory.
        scenario: Scenario that was compared.
        comparison: Its numbers and runs.
        replaced: Sentence about the earlier run that it replaced; None if there was none.
    """

    directory: Path
    scenario: Scenario
    comparison: Comparison
    replaced: str | None


def publish(
    scenario: Scenario,
    directory: Path,
    *,
    engine: str = "mujoco",
    threads: int | None = None,
    law: LawFile | None = None,
    origin: str | None = None,
    figures: FigureOptions = AS_USUAL,
    progress: Report = no_progress,
) -> Published:
    """Compare a scenario's ideal kinematics with its bodies and write the directory, even if bodies blow up.

    For the arguments see `runs.publish.publish` and `compare`. `add_video` draws the video afterwards.

    Raises:
        InputError: The scenario cannot be simulated. Nothing is written.
        PlaceError: The directory may not be replaced or cannot be written.
        NotUniqueError: The harmonic extension is not unique. Nothing is written.
    """
    replaced = replaced_run(directory)
    with staging(directory) as fresh:
        comparison = compare(scenario, progress, engine=engine, threads=threads, law=law)
        record = comparison.record.model_copy(update={"origin": origin})
        write_scenario(scenario, fresh)
        progress("plotting", 0, 1)
        plot_rungs(comparison.record, comparison.runs, fresh / "errors", figures)
        plot_budget(comparison.record, fresh / "budget", figures)
        plot_convergence(comparison.record, fresh / "convergence", figures)
        progress("writing the page", 0, 1)
        (fresh / "report.html").write_bytes(_page(scenario, comparison))
        (fresh / "report.txt").write_text(report_text(record), encoding="utf-8")
        progress("publishing", 0, 1)  # the user can interrupt up to here
        save_summary(record.model_dump(mode="json"), fresh / "compare.json")
    return Published(directory, scenario, replace(comparison, record=record), replaced)


def add_video(published: Published, quality: str | None = None, progress: Report = no_progress) -> str:
    """Draw ideal kinematics and bodies side by side into the directory of a published comparison.

    The video appears when it is complete, and compare.json then names it.

    Returns:
        The reason why there is no video; empty if there is one.

    Raises:
        PlaceError: The video cannot be written.
    """
    directory, scenario = published.directory, published.scenario
    path = directory / "compare.mp4"
    ideal, physics = (published.comparison.runs[key].dataset for key in ("ideal", "all"))
    options = half_options(scenario, quality)
    _, reason = draw_video(
        partial(both_films, scenario, ideal, physics, options),
        path,
        options,
        progress,
        f"{directory} is complete except for its video",
    )
    if not reason:
        record = published.comparison.record.model_copy(update={"video": path.name})
        save_summary(record.model_dump(mode="json"), directory / "compare.json")
    return reason


def _page(scenario: Scenario, comparison: Comparison) -> bytes:
    """Make the page of the run on bodies, with the ideal run as its ghost."""
    ideal, physics = (comparison.runs[key].dataset for key in ("ideal", "all"))
    finished = physics.attrs["status"] == "finished"
    summary = {
        "final": summarize(scenario.system.team, physics),
        "ending": comparison.record.rung("all").ending if finished else None,
    }
    bounds = bounds_of_phases(scenario.phases, physics)
    engine = f" --engine {physics.attrs['engine']}" if "engine" in physics.attrs else ""
    controller = comparison.record.controller
    law = f" --controller {controller}" if controller else ""
    again = f"mjsheaf compare scenario.yaml{engine}{law}", " in this directory"
    return page_of(
        scenario,
        scenario.phases,
        physics,
        summary,
        bounds,
        notes=comparison.record.verdict,
        ghosts=[Ghost("ideal kinematics", None, ideal, scenario.scene.height, twin=True)],
        again=again,
    )
