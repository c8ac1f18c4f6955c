"""`mjsheaf check`."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from mjsheaf import lazy
from mjsheaf.cli.options import (
    NotHeldError,
    ScenarioArgument,
    SetOption,
    TitleOption,
    changes_of,
    make_console,
    print_lines,
    progress_bars,
    require_file_name,
)
from mjsheaf.errors import InputError


def check(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the results as JSON (see mjsheaf schema --check).")
    ] = False,
    full: Annotated[bool, typer.Option("--full", help="Print the whole report instead of one screen.")] = False,
    trial: Annotated[
        bool, typer.Option("--trial/--no-trial", help="Run the mission once on bodies, and judge how it ends.")
    ] = True,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Plot the spectrum, the graph and the bounded difference to this file: .png, .svg or .pdf.",
        ),
    ] = None,
    formats: Annotated[
        str | None,
        typer.Option("--format", metavar="F1[,F2,...]", help="Additional formats of the plot: png, svg, pdf."),
    ] = None,
    title: TitleOption = True,
    rate: Annotated[float | None, typer.Option(help="lambda_V of Theorem 1, 1/s.", show_default="the best one")] = None,
    radius: Annotated[
        float, typer.Option(help="Desired bound on |e|, norm of the whole team, m; gains and laws are proposed for it.")
    ] = 1.0,
    rho: Annotated[
        str | None,
        typer.Option(
            metavar="C0[,C1,...]",
            help="Your own bound on the slope of the agents' dynamics, C0 + C1 |e| + ..., 1/s.",
            show_default="from the flow",
        ),
    ] = None,
) -> None:
    """Check whether a mission can work, and try it; if not, name the agents responsible and suggest a fix.

    Decides the paper's assumptions and predicts the tracking error, the largest stable gain and the delay margin. With
    --full it also prints every number of the record under its name in --json.

    At the end the mission is run once on bodies, without files. OK means that the assumptions hold, and that it worked
    when tried.

    The exit code is 1 if an assumption fails or is undecided, if the loop of the law, of the vehicles or of the targets
    is unstable, if the law has a term that check cannot model, if the mission demands more than a vehicle can do, or if
    the mission failed when it was tried. Errors are the RMS over agents, in metres.
    """
    figures = _figures_of(plot, formats, title)

    with progress_bars("loading", lines=None):
        loaded = lazy.scenario.load_scenario(scenario, changes_of(overrides))
        _ = loaded.whole.vehicles  # what cannot be read is refused in one line, without progress before it
    with progress_bars("checking", lines=None if as_json else "stderr"):  # the answer alone is on stdout
        examination = lazy.checking.examine_scenario(loaded, rate=rate, radius=radius, rho=_rho_of(rho))
    record = examination.record
    if not trial:
        record = lazy.examining.untried(record)
    else:
        above = [] if as_json or full else [*lazy.report.screen(record, pending=True), ""]
        with progress_bars("trying the mission", lines=None if as_json else "stderr", above=above) as bar:
            record = lazy.examining.try_out(record, loaded, partial(bar, "trying the mission"))
    if as_json:
        print(json.dumps(record.model_dump(mode="json"), indent=2, allow_nan=False))
    elif full:
        make_console(lazy.report.PAGE_WIDTH).print(lazy.report.report(record))
    else:
        print_lines(*lazy.report.screen(record, scenario))
    drawn = [] if plot is None else _draw(replace(examination, record=record), figures, plot)
    if not as_json:
        print_lines(*drawn)
    if not record.ok:
        raise NotHeldError(f"{scenario}: {'; '.join(lazy.record.reasons_of(record))}")


def _figures_of(plot: Path | None, formats: str | None, title: bool) -> "lazy.style.FigureOptions":
    """Return the formats of the plot, that of its name first, and its other options.

    Raises:
        InputError: The name or a format is not one of figures, or formats are given without a plot.
    """
    if plot is None and formats is not None:
        raise InputError(f"--format {formats}: no plot to write; expected --plot FILE too")
    if plot is None:
        return lazy.style.AS_USUAL
    require_file_name("--plot", plot, *(f".{form}" for form in lazy.files.FIGURE_FORMATS))
    named = plot.suffix[1:]
    others = [form for form in (formats or named).split(",") if form != named]
    return lazy.style.FigureOptions((named, *others), title)


def _rho_of(text: str | None) -> "lazy.theorem.Rho | None":
    """Return the bound given by --rho.

    Raises:
        InputError: The text is not a polynomial with coefficients of at least 0.
    """
    if text is None:
        return None
    try:
        return lazy.theorem.as_rho([float(c) for c in text.split(",")])
    except (ValueError, InputError):
        raise InputError(f"--rho {text}: expected coefficients >= 0, separated by commas, such as 0.1,0.02") from None


def _draw(examination: "lazy.checking.Examination", figures: "lazy.style.FigureOptions", plot: Path) -> list[Path]:
    """Draw an examination into files, and return them."""
    figure = lazy.check_figure.draw_check(examination, figures)
    paths = list(figures.paths(plot))
    for path in paths:
        with lazy.files.naming(f"--plot {path}"), lazy.files.whole_file(path) as part:
            lazy.plots.write_figure(figure, part, path.suffix[1:])
    return paths
