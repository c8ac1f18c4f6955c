"""`mjsheaf compare` and `mjsheaf compare-runs`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from mjsheaf.cli.options import (
    ControllerOption,
    Engine,
    EngineOption,
    FormatOption,
    OutOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    ThreadsOption,
    TitleOption,
    VideoOption,
    figure_options,
    make_console,
    make_table,
    prepare,
    print_lines,
    print_note,
    progress_bars,
    saying_what_is_kept,
)
from mjsheaf.cli.run import describe_files
from mjsheaf.errors import UnstableError, in_field

if TYPE_CHECKING:
    from mjsheaf.comparing.compare import Published

_WIDTH = 120  # least on a terminal, as numbers must not be cut; that of report.txt
_FILES = {
    "report.html": "replay of both runs, for any browser",
    "report.txt": "the whole report, which --full prints",
    "compare.json": "every number",
}


def compare(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    seed: SeedOption = None,
    out: OutOption = None,
    video: VideoOption = True,
    formats: FormatOption = "png",
    title: TitleOption = True,
    engine: EngineOption = Engine.MUJOCO,
    threads: ThreadsOption = None,
    controller: ControllerOption = None,
    quality: Annotated[
        Literal["good", "draft"], typer.Option(help="Quality of the video; a draft takes a fraction of the time.")
    ] = "draft",
    full: Annotated[bool, typer.Option("--full", help="Print the whole report instead of one screen.")] = False,
) -> None:
    """Compare ideal kinematics with bodies: the error due to each effect, and what to change.

    Simulates a series of variants from ideal kinematics to the scenario's bodies, adding one effect at a time. In a
    scenario with events every variant runs the same phases, and each phase has its own error budget. Writes
    compare.json, report.txt, errors.png, budget.png, convergence.png, scenario.yaml and then compare.mp4 (ideal left,
    bodies right) to a directory (default runs/NAME-compare).
    """
    with progress_bars() as bars:
        from mjsheaf.comparing.compare import publish
        from mjsheaf.comparing.page import report, summary
        from mjsheaf.scenario.load import find_law

        figures = figure_options(formats, title)
        loaded, directory, origin = prepare(scenario, overrides, seed, out, "physics", "compare")
        law = None if controller is None else find_law(controller)
        with in_field(scenario):
            published = publish(
                loaded,
                directory,
                engine=str(engine),
                threads=threads,
                law=law,
                origin=origin,
                figures=figures,
                progress=bars,
            )
    record = published.comparison.record
    if full:
        make_console(_WIDTH).print(report(record))
    else:
        print_lines(*summary(record))
    print_lines(*filter(None, [published.replaced]), *describe_files(directory, _FILES))
    if video:
        _draw_video(published, quality)
    for rung in map(record.rung, ("ideal", "all")):
        if rung.status != "finished":
            raise UnstableError(f"{rung.label}: {rung.message}; what was found is in {directory}")


def _draw_video(published: "Published", quality: str) -> None:
    """Draw the video of a published comparison and print its path, or why there is none."""
    from mjsheaf.comparing.compare import add_video

    directory = published.directory
    print_lines(f"drawing the video; all other files are written: open {directory / 'report.html'} in any browser")
    with progress_bars() as bars, saying_what_is_kept(lambda: f"{directory} is complete except for its video"):
        reason = add_video(published, quality, bars)
    if reason:
        print_note(reason)
    else:
        print_lines(f"  {directory / 'compare.mp4'}")


def compare_runs(
    directories: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Directories of 2 to 8 finished runs.")],
    out: OutOption = None,
    formats: FormatOption = "png",
    title: TitleOption = True,
) -> None:
    """Compare finished runs with the first of them, without simulating.

    Plots their errors on one axis, prints a table of errors and differences, and writes a page that draws the agents of
    the other runs translucent. Writes runs.json, runs.csv, errors.png and report.html to a directory (default
    runs/SCENARIO-runs).
    """
    from rich.text import Text

    figures = figure_options(formats, title)
    with progress_bars() as bars:
        from mjsheaf.runs.overlay import publish_runs

        record, place, replaced = publish_runs(directories, out, figures, bars)
    numbers = ["tracking", "at the end", "formation", "at the end ", "distance"]
    headings = ["run", "backend", "law", *numbers]
    title = (
        f"errors in m: RMS over agents (formation: over edges) and the second half of {record.start_s:g} to "
        f"{record.end_s:g} s, and at the end\nin brackets the difference from the first run; distance: of agents from "
        "the first run's"
    )
    table = make_table(*headings, numbers=numbers, fixed=["backend", *numbers], title=title)
    for column in table.columns[:3]:
        column.overflow = "fold"
    for run in record.runs:
        cells = [
            run.name,
            run.backend if run.engine in (None, "mujoco") else f"{run.backend}, {run.engine}",
            run.law if run.gain is None else f"gain {run.gain:g} 1/s",
            _shown(run.late.tracking_error, run.late_difference.tracking_error),
            _shown(run.final.tracking_error, run.final_difference.tracking_error),
            _shown(run.late.formation_error, run.late_difference.formation_error),
            _shown(run.final.formation_error, run.final_difference.formation_error),
            _shown(run.distance_m),
        ]
        table.add_row(*map(Text, cells))
    make_console(_WIDTH).print(table)
    print_lines(*(f"note: {note}" for note in record.notes))
    print_lines(*filter(None, [replaced]), *(f"  {path}" for path in sorted(place.iterdir())))


def _shown(value: float | None, difference: float | None = None) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" + (f" ({difference:+.2g})" if difference else "")
