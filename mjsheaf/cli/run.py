"""`mjsheaf run`."""

from pathlib import Path

from rich.table import Table

from mjsheaf.cli.console import make_console
from mjsheaf.cli.progress import progress_bars
from mjsheaf.errors import InputError, MjsheafError, UnstableError
from mjsheaf.filming import video_options
from mjsheaf.results.metrics import MEASURES
from mjsheaf.results.store import PlaceError, require_same_origin
from mjsheaf.runs.expecting import miss
from mjsheaf.runs.publish import Outcome, default_directory, execute
from mjsheaf.scenario import load_scenario
from mjsheaf.scenario.build import uses_seed
from mjsheaf.scenario.load import origin, parse_override
from mjsheaf.simulation.run import BACKENDS


class ExpectationMissedError(MjsheafError):
    """A run misses its scenario's `expect:` block."""

    exit_code = 1


class BoundBrokenError(MjsheafError):
    """A run exceeds a bound that should hold: an error of mjsheaf's, not of the scenario's."""

    exit_code = 1


def run_command(
    source: str,
    backend: str,
    overrides: list[str],
    seed: int | None,
    out: Path | None,
    video: bool,
    expect: bool,
    allow_drift: bool,
    quality: str | None = None,
) -> None:
    """Run a scenario, tell what came out, and raise what the exit code says."""
    if backend not in BACKENDS:
        raise InputError(f"--backend {backend}: expected {', '.join(BACKENDS)}")
    changes = dict(parse_override(text) for text in overrides)
    if seed is not None:
        changes["seed"] = seed
    scenario = load_scenario(source, changes)
    if expect and getattr(scenario.expect, backend) is None and scenario.expect.refused is None:
        raise InputError(f"{source}: expect.{backend}: missing; --expect needs bounds for this backend")
    notes = make_console(stderr=True, soft_wrap=True)
    if "seed" in changes and not uses_seed(scenario)[backend]:
        notes.print(
            f"note: the seed changes nothing: {scenario.name} has no spread and no disturbance on backend {backend}"
        )
    options = video_options(scenario, quality=quality) if video else None
    directory = default_directory(scenario, backend) if out is None else out
    where = origin(source, directory)
    if out is None:
        require_same_origin(directory, where)
    try:
        with progress_bars() as progress:
            outcome = execute(
                scenario, backend, directory, video=options, allow_drift=allow_drift, origin=where, progress=progress
            )
    except PlaceError:
        raise
    except MjsheafError as error:
        wanted = scenario.expect.refused
        other = expect and wanted is not None and wanted not in str(error)
        verdict = f" (NOT as expected: expect.refused is {wanted!r})" if other else ""
        raise type(error)(f"{source}: {error}{verdict}") from None
    for note in outcome.notes:
        notes.print(f"note: {note}", markup=False, highlight=False)
    _print_summary(outcome)
    if outcome.summary["status"] == "unstable":
        raise UnstableError(f"{outcome.summary['message']}; what was recorded is in {outcome.directory}")
    if expect and outcome.summary["expect"]["met"] is False:
        missed = [check for check in outcome.summary["expect"]["checks"] if not check["met"]]
        raise ExpectationMissedError(f"{source}: {', '.join(map(miss, missed))}")

    if expect and outcome.summary["theorem"]["wrong"]:
        raise BoundBrokenError(f"{source}: {next(note for note in outcome.notes if 'Theorem 1' in note)}")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _print_summary(outcome: Outcome) -> None:
    summary, final = outcome.summary, outcome.summary["final"]
    console = make_console()
    title = f"{summary['scenario']} on {summary['backend']}, errors in m at t = {final['time']:.6g} s"
    table = Table(title=title, title_justify="left", header_style="")
    table.add_column("")
    for measure in MEASURES:
        table.add_column(measure.removeprefix("mean_").removesuffix("_error"), justify="right")
    for name, values in {"team": final, **final["groups"]}.items():
        table.add_row(name, *(_number(values[measure]) for measure in MEASURES))
    console.print(table)
    met = summary["expect"]["met"]
    verdict = {True: "as expected", False: "NOT as expected", None: "no expectation"}[met]
    console.print(
        f"{summary['status']}, {verdict}; {summary['steps']} steps in {summary['wall_time_s']:.2f} s "
        f"({summary['realtime_factor']:.3g} x real time)",
        highlight=False,
        soft_wrap=True,
    )
    for direction in summary["free_directions"]:
        console.print(f"DRIFTS: {direction}; errors are against the q* of least norm", highlight=False, soft_wrap=True)
    if outcome.replaced:
        console.print(outcome.replaced, highlight=False, soft_wrap=True, markup=False)
    for path in sorted(outcome.directory.iterdir()):
        console.print(f"  {path}", highlight=False, soft_wrap=True, markup=False)
