"""`mjsheaf compare-runs`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mjsheaf.cli.options import FormatOption, OutOption, TitleOption, figure_options
from mjsheaf.cli.terminal import make_console, make_table, print_lines, progress_bars

if TYPE_CHECKING:
    from mjsheaf.comparing.overlay import RunsRecord


_WIDTH = 120  # least on a terminal, as numbers must not be cut


def compare_runs(
    directories: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Directories of finished runs, 2 to 8.")],
    out: OutOption = None,
    formats: FormatOption = "png",
    title: TitleOption = True,
) -> None:
    """Compare finished runs with the first of them, without running anything.

    Draws their errors on one axis, prints a table of errors and differences, and makes a page on which the agents of
    the other runs are drawn translucent. Writes runs.json, runs.csv, errors.png and report.html into the directory,
    runs/SCENARIO-runs unless given.
    """
    figures = figure_options(formats, title)
    from mjsheaf.comparing.overlay import publish_runs

    with progress_bars() as bars:
        record, place, replaced = publish_runs(directories, out, figures, bars)
    _print_record(record)
    print_lines(*([replaced] if replaced else []), *(f"  {path}" for path in sorted(place.iterdir())))


def _print_record(record: "RunsRecord") -> None:
    from rich.text import Text

    numbers = ["tracking", "at the end", "formation", "at the end ", "distance"]
    headings = ["run", "backend", "law", *numbers]
    title = (
        f"errors in m: RMS over agents (formation: over edges) and the last half of {record.start_s:g} to "
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
    console = make_console()
    console.width = max(console.width, _WIDTH)
    console.print(table)
    print_lines(*(f"note: {note}" for note in record.notes))


def _shown(value: float | None, difference: float | None = None) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" + (f" ({difference:+.2g})" if difference else "")
