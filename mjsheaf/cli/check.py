"""`mjsheaf check`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mjsheaf.cli.options import (
    NotHeldError,
    ScenarioArgument,
    SetOption,
    TitleOption,
    changes_of,
    require_file_name,
)
from mjsheaf.cli.terminal import make_console, print_lines, progress_bars
from mjsheaf.errors import InputError
from mjsheaf.io.figures import AS_USUAL, FORMATS, FigureOptions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mjsheaf.checking.check import CheckRecord, Examination, PhaseRecord
    from mjsheaf.checking.loop.held_law import LawLoop
    from mjsheaf.checking.loop.links import LinkRecord
    from mjsheaf.control.theorem import Rho


def check(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the results as JSON (see mjsheaf schema --check).")
    ] = False,
    full: Annotated[bool, typer.Option("--full", help="Print the whole report instead of one screen.")] = False,
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
    """Check whether the law can work for a team; if not, name the agents responsible and suggest a fix.

    Decides the paper's assumptions and predicts the tracking error, the largest stable gain and the delay margin. With
    --full it also prints the constants and bounds of Theorem 1, the sampled loop over its links, and better laws.

    The exit code is 1 if an assumption fails or is undecided, if the loop of the law, of the vehicles or of the targets
    is unstable, or if the law has a term that check cannot model. Errors are the RMS over agents, in metres.
    """
    figures = _figures_of(plot, formats, title)
    import json

    with progress_bars("loading", lines=None):
        from mjsheaf.checking import examine_scenario
        from mjsheaf.scenario import load_scenario

        loaded = load_scenario(scenario, changes_of(overrides))
        _ = loaded.whole.vehicles  # what cannot be read is refused in one line, without progress before it
    with progress_bars("checking", lines=None if as_json else "stderr"):  # the answer alone is on stdout
        examination = examine_scenario(loaded, rate=rate, radius=radius, rho=_rho_of(rho))
    record = examination.record
    if as_json:
        print(json.dumps(record.model_dump(mode="json"), indent=2, allow_nan=False))
    else:
        _print_record(record, scenario, full=full)
    drawn = [] if plot is None else _draw(examination, figures, plot)
    if not as_json:
        print_lines(*drawn)
    _require_ok(scenario, record)


def _print_record(record: "CheckRecord", scenario: str, *, full: bool) -> None:
    """Print the answer, or the whole report."""
    from mjsheaf.checking.report import report
    from mjsheaf.checking.screen import screen

    if full:
        make_console().print(report(record))
    else:
        print_lines(*screen(record, scenario))


def _figures_of(plot: Path | None, formats: str | None, title: bool) -> FigureOptions:
    """Return the formats of the plot, that of its name first, and its other options.

    Raises:
        InputError: The name or a format is not one of figures, or formats are given without a plot.
    """
    if plot is None and formats is not None:
        raise InputError(f"--format {formats}: no plot to write; expected --plot FILE too")
    if plot is None:
        return AS_USUAL
    require_file_name("--plot", plot, *(f".{form}" for form in FORMATS))
    named = plot.suffix[1:]
    others = [form for form in (formats or named).split(",") if form != named]
    return FigureOptions((named, *others), title)


def _rho_of(text: str | None) -> "Rho | None":
    """Return the bound given by --rho.

    Raises:
        InputError: The text is not a polynomial with coefficients of at least 0.
    """
    from mjsheaf.control.theorem import as_rho

    if text is None:
        return None
    try:
        return as_rho([float(c) for c in text.split(",")])
    except (ValueError, InputError):
        raise InputError(f"--rho {text}: expected coefficients >= 0, separated by commas, such as 0.1,0.02") from None


def _draw(examination: "Examination", figures: FigureOptions, plot: Path) -> list[Path]:
    """Draw an examination into files, and return them."""
    from mjsheaf.checking.figures import draw_check
    from mjsheaf.io.files import naming, whole_file
    from mjsheaf.plotting import write_figure

    figure = draw_check(examination, figures)
    paths = list(figures.paths(plot))
    for path in paths:
        with naming(f"--plot {path}"), whole_file(path) as part:
            write_figure(figure, part, path.suffix[1:])
    return paths


def _require_ok(scenario: str, record: "CheckRecord") -> None:
    """Refuse a scenario whose check, or that of one of its phases, is not ok.

    Raises:
        NotHeldError: A check is not ok; the message gives the reasons.
    """
    failures = [
        f"from t = {part.start:g} s on ({', '.join(part.events) or 'start'}): {why}"
        for part in record.phases
        for why in _failures(part)
    ]
    failures = failures or _failures(record)
    if failures:
        raise NotHeldError(f"{scenario}: {'; '.join(failures)}")


def _failures(part: "CheckRecord | PhaseRecord") -> list[str]:
    """Return why a check, or that of a phase, is not ok, in sentences."""
    failures = [
        *_failures_of_assumptions(part),
        *(_failures_of_shape(part) if part.theorem.holds is None else ()),
        *_failures_of_law(part.law),
        *_failures_of_links(part.links),
    ]
    if part.targets.unstable:
        failures = [why for why in failures if part.targets.failure not in why or not part.targets.failure]
        failures.append(part.targets.verdict())
    if part.margins.bodies.stable is False:
        failures.append(part.margins.bodies.verdict())
    return failures


def _failures_of_assumptions(part: "CheckRecord | PhaseRecord") -> "Iterator[str]":
    """Yield which assumptions do not hold, of a team outside the scope of Theorem 1 those on topology."""
    for a in part.assumptions:
        if a.applies and not a.holds and (part.theorem.holds is not None or a.number in (5, 6)):
            yield f"assumption {a.number} {'fails' if a.verdict == 'fails' else 'is undecided'} ({a.name}): {a.witness}"


def _failures_of_shape(part: "CheckRecord | PhaseRecord") -> "Iterator[str]":
    """Yield why a team outside the scope of Theorem 1 does not, or may not, hold its shape."""
    shape = part.rigidity
    if shape.localizable is None and shape.rigid is not True:
        why = f": {shape.bracing.describe()}" if shape.bracing is not None else ""
        yield f"the formation is not rigid, its edges have rank {shape.rank} of {shape.needed}{why}"
    if shape.localizable is False and part.law.stable is not None:
        yield "targets and anchors do not hold every agent's place"
    if part.law.stable is None and not part.ok:
        yield f"the law is undecided: {part.law.reason}"


def _failures_of_law(law: "LawLoop") -> "Iterator[str]":
    """Yield why the loop of the held law is not known to be stable."""
    from mjsheaf.checking.loop.modelled import because_of

    if law.unmodelled:
        yield f"the law is undecided, {because_of(law.unmodelled)}"
    if law.stable is False:
        gains = " to ".join(f"{gain:.4g}" for gain in law.stable_gains or [])
        expected = f": expected controller.gain from {gains} 1/s" if gains else " at any controller.gain"
        yield f"the held law is unstable{expected}"


def _failures_of_links(links: "LinkRecord | None") -> "Iterator[str]":
    """Yield why the loop of the law over its links is unstable."""
    from mjsheaf.checking.loop.links import UNSTABLE_LINKS

    if links is not None and links.stable is False:
        known = links.delay_margin is not None and not links.delay.stable
        yield UNSTABLE_LINKS + (f"; it tolerates {links.delay_margin:.6g} s of delay" if known else "")
