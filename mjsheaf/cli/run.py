"""`mjsheaf run`, `mjsheaf expect`, and the commands that draw a finished run again: `video`, `plot` and `report`."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mjsheaf.cli.options import (
    Backend,
    BackendOption,
    ControllerOption,
    Engine,
    EngineOption,
    FormatOption,
    McapOption,
    NotHeldError,
    OutOption,
    QualityOption,
    Ros2Option,
    ScenarioArgument,
    SeedOption,
    SetOption,
    ThreadsOption,
    TitleOption,
    VideoOption,
    figure_options,
    formats_of,
    prepare,
    require_file_name,
)
from mjsheaf.cli.terminal import print_lines, print_note, progress_bars, saying_what_is_kept
from mjsheaf.errors import InputError, MjsheafError, PlaceError, UnstableError, in_field

if TYPE_CHECKING:
    from mjsheaf.law.in_python import Controller
    from mjsheaf.runs.expecting import Trial
    from mjsheaf.runs.publish import Outcome
    from mjsheaf.scenario import Scenario
    from mjsheaf.video.film import VideoOptions

_DriftFlag = Annotated[
    bool,
    typer.Option("--allow-drift", help="Run even if agents are free to drift; errors refer to the q* of least norm."),
]


def run(
    scenario: ScenarioArgument,
    backend: BackendOption = Backend.PHYSICS,
    overrides: SetOption = None,
    seed: SeedOption = None,
    out: OutOption = None,
    video: VideoOption = True,
    expect: Annotated[
        bool, typer.Option("--expect", help="Exit with code 1 if the run violates the scenario's `expect:` block.")
    ] = False,
    allow_drift: _DriftFlag = False,
    controller: ControllerOption = None,
    quality: QualityOption = None,
    formats: FormatOption = "png",
    title: TitleOption = True,
    engine: EngineOption = Engine.MUJOCO,
    threads: ThreadsOption = None,
    mcap: McapOption = False,
    ros2: Ros2Option = False,
) -> None:
    """Simulate a scenario and write data, plots, a page that replays the run, and a video.

    Writes result.nc, summary.json, scenario.yaml, errors.png, trajectories.png, configurations.png, report.html and
    then video.mp4 to a directory (default runs/NAME-BACKEND). Refuses a team in which an agent is free to drift (exit
    code 1).
    """
    with progress_bars() as bars:
        from mjsheaf.cli.outcome import announcing, print_outcome
        from mjsheaf.runs.publish import execute
        from mjsheaf.video.film import video_options

        figures = figure_options(formats, title)
        loaded, directory, origin = prepare(scenario, overrides, seed, out, str(backend), str(backend))
        if expect and getattr(loaded.expect, backend) is None and loaded.expect.refused is None:
            raise InputError(f"{scenario}: expect.{backend}: missing; --expect needs bounds for this backend")
        law = _law_of(scenario, loaded, controller, expect)
        options = video_options(loaded, quality=quality) if video else None
        with _as_expected(scenario, loaded.expect.refused if expect else None):
            outcome = execute(
                loaded,
                str(backend),
                directory,
                video=None,
                engine=str(engine),
                threads=threads,
                allow_drift=allow_drift,
                controller=law,
                origin=origin,
                figures=figures,
                exports=formats_of(mcap, ros2),
                progress=announcing(loaded, str(backend), bars),
            )
    print_outcome(outcome, overridden=bool(overrides))
    if options is not None:
        outcome = _draw_video(outcome, loaded, options)
    if outcome.summary["status"] == "unstable":
        raise UnstableError(f"{outcome.summary['message']}; what was recorded is in {directory}")
    if expect:
        _require_expected(scenario, outcome.summary)


def _law_of(scenario: str, loaded: "Scenario", controller: str | None, expect: bool) -> "Controller | None":
    """Return the law in Python of a run: that of --controller, else with --expect that of `expect.controller`."""
    from mjsheaf.runs.expecting import expected_law
    from mjsheaf.scenario.law_file import load_controller
    from mjsheaf.scenario.load import find_scenario

    if controller is not None:
        return load_controller(controller, loaded.seed)
    named = expected_law(loaded, find_scenario(scenario).parent) if expect else None
    return named.load(loaded.seed) if named else None


@contextmanager
def _as_expected(scenario: str, refusal: str | None) -> Iterator[None]:
    """Name the scenario in the errors of a block, and add whether another refusal was expected."""
    try:
        yield
    except PlaceError:
        raise
    except MjsheafError as error:
        other = refusal is not None and refusal not in str(error)
        verdict = f" (NOT as expected: expect.refused is {refusal!r})" if other else ""
        raise type(error)(f"{scenario}: {error}{verdict}") from None


def _require_expected(scenario: str, summary: dict[str, Any]) -> None:
    """Refuse a run that misses its expectation, or exceeds a bound.

    Raises:
        NotHeldError: The run does. An exceeded bound is a fault in mjsheaf.
    """
    from mjsheaf.runs.expecting import miss

    missed = [miss(check) for check in summary["expect"]["checks"] if not check["met"]]
    if missed:
        raise NotHeldError(f"{scenario}: {', '.join(missed)}")
    unproven: dict[str, bool] = {"wrong": False}
    parts = (summary, *summary["phases"])
    if any(part.get(name, unproven)["wrong"] for part in parts for name in ("theorem", "held_law")):
        raise NotHeldError(f"{scenario}: {next(n['text'] for n in summary['notes'] if n['kind'] == 'bound')}")


def _draw_video(outcome: "Outcome", scenario: "Scenario", options: "VideoOptions") -> "Outcome":
    """Draw the video of a published run into its directory, and print where it is or why there is none."""
    from mjsheaf.runs.publish import add_video, without_video

    directory = outcome.directory
    print_lines(f"drawing the video; all other files are written: open {directory / 'report.html'} in any browser")
    with progress_bars() as bars, saying_what_is_kept(partial(without_video, directory)):
        outcome = add_video(outcome, scenario, options, bars)
    for note in outcome.notes:
        print_note(note)
    if outcome.summary["video"] is not None:
        print_lines(f"  {directory / 'video.mp4'}")
    return outcome


def expect(
    scenario: ScenarioArgument,
    update: Annotated[
        bool, typer.Option("--update", help="Write the `expect:` block from the measured errors.")
    ] = False,
    backend: Annotated[
        list[Backend] | None,
        typer.Option(
            help="Backend to run on; may be repeated.", show_default="those with an expectation; with --update both"
        ),
    ] = None,
    margin: Annotated[
        float,
        typer.Option(
            min=0.0, max=10.0, help="Margin of the bounds that --update writes, relative to the measured errors."
        ),
    ] = 0.05,
    controller: ControllerOption = None,
) -> None:
    """Run a scenario and compare its errors with its `expect:` block, or write that block from the run.

    The law is that of --controller, else that of `expect.controller`, else the scenario's own. The command writes no
    directory. The exit code is 1 if an expectation is missed.

    --update changes nothing else in the file. If the team is refused, it writes that a refusal is expected. If the run
    diverges, it writes nothing (exit code 3).
    """
    with progress_bars() as bars:
        from mjsheaf.io.files import require_writable
        from mjsheaf.runs import expecting
        from mjsheaf.scenario.law_file import find_law, name_law_from
        from mjsheaf.scenario.load import find_scenario, load_scenario

        loaded = load_scenario(scenario)
        path = find_scenario(scenario)
        data = b""
        if update:
            data = path.read_bytes()
            require_writable(path)
        backends = _backends_to_try(scenario, loaded, backend, update)
        trials = []
        with in_field(scenario):
            law = expecting.expected_law(loaded, path.parent) if controller is None else find_law(controller)
        law_name = name_law_from(law, path.parent) if update and law is not None else None
        for name in backends:
            with in_field(scenario):
                progress = partial(bars, f"simulating ({name})")
                trials.append(expecting.try_scenario(loaded, name, law=law, progress=progress))
            print_lines(expecting.describe(trials[-1], loaded.name, scenario))
    if not update:
        _require_met(scenario, trials)
        return
    for trial in trials:
        if trial.status == "unstable":
            raise UnstableError(f"{scenario}: blew up on {trial.backend}: {trial.message}; nothing is written")
    before = loaded.expect.model_dump(exclude_none=True) | ({} if law_name is None else {"controller": law_name})
    with in_field(scenario):
        block = expecting.expectation_from(trials, margin, before)
    expecting.replace_expectation(path, data, scenario, block, margin)
    print_lines(f"wrote expect: of {path}")


def _require_met(scenario: str, trials: "Sequence[Trial]") -> None:
    """Refuse runs that miss an expectation.

    Raises:
        NotHeldError: A run does.
    """
    from mjsheaf.runs.expecting import miss, missed

    misses = [f"{miss(check)} on {trial.backend}" for trial in trials for check in missed(trial)]
    if misses:
        raise NotHeldError(f"{scenario}: {', '.join(misses)}")


def _backends_to_try(scenario: str, loaded: "Scenario", chosen: "Sequence[Backend] | None", update: bool) -> list[str]:
    """Return the backends on which `expect` runs a scenario.

    Raises:
        InputError: A chosen backend, or every one, has no expectation, and --update is not given.
    """
    from mjsheaf.runs.expecting import BACKEND_ORDER, expected_backends

    wanted = sorted(map(str, set(chosen or BACKEND_ORDER)), key=BACKEND_ORDER.index)
    known = wanted if update else expected_backends(loaded)
    missing = [name for name in wanted if name not in known]
    if missing and (chosen or not known):
        raise InputError(f"{scenario}: expect.{missing[0]}: missing; --update writes it from a run")
    return [name for name in wanted if name in known]


def video(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a finished run.")],
    out: Annotated[Path | None, typer.Option(help="MP4 file to write.", show_default="DIR/video.mp4")] = None,
    width: Annotated[int | None, typer.Option(help="Frame width in pixels, even.")] = None,
    height: Annotated[int | None, typer.Option(help="Frame height in pixels, even.")] = None,
    fps: Annotated[int | None, typer.Option(help="Frames per second of video.")] = None,
    speed: Annotated[float | None, typer.Option(help="Simulated seconds per second of video.")] = None,
    azimuth: Annotated[float | None, typer.Option(help="Azimuth of the camera, degrees.")] = None,
    elevation: Annotated[
        float | None, typer.Option(help="Elevation of the camera, degrees; -90 looks straight down.")
    ] = None,
    distance: Annotated[
        float | None, typer.Option(help="Distance of the camera, m; by default it keeps the team in view.")
    ] = None,
    trail: Annotated[float | None, typer.Option(help="Length of the trails, s.")] = None,
    quality: QualityOption = None,
) -> None:
    """Redraw the video of a finished run, without simulating.

    Options that are not given come from the scenario of the run.
    """
    changes = {k: v for k, v in locals().items() if k not in ("directory", "out")}
    with progress_bars() as bars:
        from mjsheaf.results.store import reopen_run, save_summary
        from mjsheaf.runs.publish import video_entry
        from mjsheaf.video import available_backend
        from mjsheaf.video.film import film_run, video_options

        with reopen_run(directory) as (scenario, dataset, summary):
            options = video_options(scenario, **changes)
            own = directory / "video.mp4"
            path = own if out is None else out
            require_file_name("--out", path, ".mp4")
            require_outside_of_runs(path, own)
            backend, reason = available_backend()
            if backend is None:
                raise InputError(f"no video can be drawn here: {reason}")
            frames = film_run(scenario, dataset, path, options, partial(bars, "drawing video"))
    if path.resolve() == own.resolve():
        save_summary({**summary, "video": video_entry(frames, options)}, directory / "summary.json")
    print_lines(f"{path}: {frames} frames, {options.width}x{options.height} at {options.fps:g} frames a second")


def report(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a finished run.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="HTML file to write.", show_default="DIR/report.html")
    ] = None,
) -> None:
    """Rewrite the page of a finished run: one HTML file that replays the run in any browser, offline."""
    with progress_bars("writing the page"):
        from mjsheaf.page import write_page_again

        if out is not None:
            require_file_name("--out", out, ".html")
            require_outside_of_runs(out, directory / "report.html")
        path = write_page_again(directory, out)
    print_lines(path)


def plot(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a finished run.")],
    formats: FormatOption = "png",
    title: TitleOption = True,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Directory for the plots.", show_default="DIR")
    ] = None,
) -> None:
    """Redraw the plots of a finished run, for example as PDF without titles for a paper."""
    with progress_bars() as bars:
        figures = figure_options(formats, title)
        from mjsheaf.runs.publish import plot_again

        if out is not None:
            if out.exists() and not out.is_dir():
                raise InputError(f"--out {out}: is not a directory")
            require_outside_of_runs(out / "errors.png", directory / "errors.png")
        found = plot_again(directory, out or directory, figures, bars)
    for path in found:
        print_lines(path)


def require_outside_of_runs(path: Path, own: Path) -> None:
    """Refuse a file of --out in the directory of a run, unless it is the run's `own`.

    Raises:
        InputError: The file lies in the directory of a run.
    """
    from mjsheaf.results.store import enclosing_run

    run = enclosing_run(path)
    if run is not None and path.resolve() != own.resolve():
        raise InputError(f"--out {path}: lies in {run}, a run's directory; expected {own}, or a place outside of runs")
