"""The directory of a comparison: record, report, plots, replay and video."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from mjsheaf.comparing.compare import Comparison, compare
from mjsheaf.comparing.page import report_text
from mjsheaf.results import summarize
from mjsheaf.results.store import replaced_run, save_summary, staging
from mjsheaf.runs.publish import draw_video, write_scenario
from mjsheaf.runs.simulate import Progress, no_progress
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import LawFile
from mjsheaf.show.style import AS_USUAL, FigureOptions
from mjsheaf.video.film import both_films, half_options


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
    progress: Progress = no_progress,
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
        _plot(comparison, fresh, figures)
        progress("writing the page", 0, 1)
        (fresh / "report.html").write_bytes(_page(scenario, comparison))
        (fresh / "report.txt").write_text(report_text(record), encoding="utf-8")
        progress("publishing", 0, 1)  # the user can interrupt up to here
        save_summary(record.model_dump(mode="json"), fresh / "compare.json")
    return Published(directory, scenario, replace(comparison, record=record), replaced)


def add_video(published: Published, quality: str | None = None, progress: Progress = no_progress) -> str:
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
    films = partial(both_films, scenario, ideal, physics, options)
    _, reason = draw_video(films, path, options, progress, f"{directory} is complete except for its video")
    if not reason:
        record = published.comparison.record.model_copy(update={"video": path.name})
        save_summary(record.model_dump(mode="json"), directory / "compare.json")
    return reason


def _plot(comparison: Comparison, folder: Path, figures: FigureOptions) -> None:
    from mjsheaf.comparing.figures import plot_budget, plot_convergence, plot_rungs

    plot_rungs(comparison.record, comparison.runs, folder / "errors", figures)
    plot_budget(comparison.record, folder / "budget", figures)
    plot_convergence(comparison.record, folder / "convergence", figures)


def _page(scenario: Scenario, comparison: Comparison) -> bytes:
    """Make the page of the run on bodies, with the ideal run as its ghost."""
    from mjsheaf.checking.theorem.of_run import bounds_of_phases
    from mjsheaf.page import Ghost, page_of

    phases = scenario.phases
    ideal, physics = (comparison.runs[key].dataset for key in ("ideal", "all"))
    finished = physics.attrs["status"] == "finished"
    summary = {
        "final": summarize(scenario.system.team, physics),
        "ending": comparison.record.rung("all").ending if finished else None,
    }
    bounds = bounds_of_phases(phases, physics)
    engine = f" --engine {physics.attrs['engine']}" if "engine" in physics.attrs else ""
    controller = comparison.record.controller
    law = f" --controller {controller}" if controller else ""
    again = f"mjsheaf compare scenario.yaml{engine}{law}", " in this directory"
    notes = comparison.record.verdict
    twin = Ghost("ideal kinematics", None, ideal, scenario.scene.height, twin=True)
    return page_of(scenario, phases, physics, summary, bounds, notes=notes, ghosts=[twin], again=again)
