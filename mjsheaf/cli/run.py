"""Commands that run scenarios, `run`, `compare`, `expect` and `sweep`, or show finished runs.

The latter are `compare-runs`, `video`, `plot` and `report`.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from mjsheaf import lazy
from mjsheaf.cli.options import (
    FOXGLOVE,
    Backend,
    BackendOption,
    ControllerOption,
    Engine,
    EngineOption,
    FormatOption,
    LiveOption,
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
    changes_of,
    formats_of,
    make_console,
    make_table,
    note_idle_seed,
    prepare,
    print_lines,
    print_note,
    progress_bars,
    require_file_name,
    saying_what_is_kept,
)
from mjsheaf.errors import InputError, MjsheafError, PlaceError, UnstableError, in_field, printable, shortened

_NORMS = {
    "mean_disagreement": "mean over agents",
    "tracking_error": "RMS over agents",
    "formation_error": "RMS over edges",
    "centering_error": "largest group",
}
_WIDTH = 120  # least on a terminal, as numbers must not be cut; that of report.txt
_MAX_NOTES = 4  # lines
_MAX_ROWS = 5  # of the table


def announcing(
    scenario: "lazy.scenario.Scenario", backend: str, progress: "lazy.progress.Report", *more: str
) -> "lazy.progress.Report":
    """Return `progress` that prints what runs before its first report: a run that is refused prints nothing."""
    announced = False

    def report(what: str, done: int, total: int) -> None:
        nonlocal announced
        if not announced:
            announced = True
            print_start(scenario, backend)
            print_lines(*more)
        progress(what, done, total)

    return report


def print_start(scenario: "lazy.scenario.Scenario", backend: str) -> None:
    """Print the size, engine and duration of a run that starts."""
    agents = len(scenario.agents)
    targets = len(scenario.targets)
    team = f"{agents} agent{'' if agents == 1 else 's'} and {targets} target{'' if targets == 1 else 's'}"
    bodies = "MuJoCo bodies" if backend == "physics" else "ideal kinematics"
    line = f"{scenario.name}: {team} on {bodies}, {scenario.time.end - scenario.time.start:.6g} s"
    with suppress(BrokenPipeError):  # the run continues, for its files; the next line printed ends the command
        print(printable(line), flush=True)


def print_outcome(outcome: "lazy.publish.Outcome", *, overridden: bool = False) -> None:
    """Print the result of a published run, then its errors, its notes and its files.

    Args:
        outcome: The published run.
        overridden: True if fields of the scenario were overridden, which its expectation does not account for.
    """
    summary = outcome.summary
    final = summary["final"]
    if summary["status"] != "finished":
        headline = summary["message"]  # which begins with the status
    elif final["tracking_error"] is None:
        headline = "finished"
    else:
        headline = (
            f"finished: at {final['time']:.6g} s the agents are {final['tracking_error']:.3g} m from where they "
            "should be (tracking error, RMS over agents)"
        )
    print_lines(headline, _verdict(summary["expect"], overridden))
    make_console().print(_table(summary))
    # That bodies exceed the bound of ideal kinematics is no news: the page and summary.json have it.
    told = [note for note in summary["notes"] if note["kind"] != "bound" or summary["backend"] == "ideal"]
    notes = [f"note: {note['text']}" for note in told]
    if len(notes) > _MAX_NOTES:
        notes[_MAX_NOTES - 1 :] = [f"and {len(notes) - _MAX_NOTES + 1} more notes in summary.json"]
    sent = summary["communication"]
    speed = f"{summary['realtime_factor']:.3g} x real time"
    effort = [f"{summary['steps']} steps in {summary['wall_time_s']:.2f} s ({speed})"]
    if sent["exchanges_per_second"]:
        effort.append(
            f"{sent['exchanges_per_second']:.4g} exchanges between neighbours per second; each agent sends "
            f"{sent['numbers_per_agent_second']:.4g} numbers per second"
        )
    print_lines(
        *_safety(summary.get("safety")),
        *notes,
        *(f"DRIFTS: {direction}; errors refer to the q* of least norm" for direction in summary["free_directions"]),
        *effort,
        *([outcome.replaced] if outcome.replaced else []),
        *describe_files(outcome.directory, {"report.html": "replay, for any browser", "video.mp4": "video"}),
    )


def describe_files(directory: Path, about: Mapping[str, str]) -> list[str]:
    """Return where the files of a run or a comparison are.

    Args:
        directory: Their directory.
        about: What is in the most important ones, by name; they get lines of their own, if they exist.
    """
    names = sorted(path.name for path in directory.iterdir())
    lines = [f"  {directory / name}: {text}" for name, text in about.items() if name in names]
    others = [name for name in names if name not in about]
    return [*lines, f"  {directory}: {', '.join(others)}"] if others else lines


def _verdict(expect: dict[str, Any], overridden: bool) -> str:
    """Return the verdict on the scenario's expectation: what is missed, or else every measure with its bound."""
    if expect["met"] is None:
        return f"no expectation: {expect.get('reason') or 'the scenario has no `expect:` block for this backend'}"
    if not expect["met"]:
        scope = " (the expectation is for the scenario without --set)" if overridden else ""
        return f"NOT as expected: {'; '.join(lazy.expecting.missed(expect['checks']))}{scope}"
    held = [
        f"{_words(check['measure'])} {check['found']:.3g} m "
        f"(at {'least' if check['measure'] == 'smallest_separation' else 'most'} {check['bound']:g} m)"
        for check in expect["checks"]
    ]
    return f"as expected: {'; '.join(held)}"


def _table(summary: dict[str, Any]) -> Any:
    """Return the table of errors: the team, each group, and the end of each phase."""
    final = summary["final"]
    headings = {measure: f"{_words(measure)}\n{norm}" for measure, norm in _NORMS.items()}
    title = f"{summary['scenario']} on {summary['backend']}, errors in m at t = {final['time']:.6g} s"
    rows = list({"team": final, **final["groups"]}.items())
    for number, phase in enumerate(summary["phases"]):
        if phase["final"] is None:
            continue
        events = shortened(", ".join(phase["events"]) or "start", 36)
        rows.append((f"phase {number}, {events}, at {phase['final']['time']:.6g} s", phase["final"]))
    columns = list(headings.values())
    table = make_table("", *columns, numbers=columns, title=title, box=None, padding=(0, 2, 0, 0))
    shown = len(rows) if len(rows) <= _MAX_ROWS else _MAX_ROWS - 1
    for name, values in rows[:shown]:
        table.add_row(name, *("-" if values[measure] is None else f"{values[measure]:.4g}" for measure in _NORMS))
    if len(rows) > shown:
        table.add_row(f"and {len(rows) - shown} more in summary.json")
    return table


def _safety(safety: dict[str, Any] | None) -> list[str]:
    """Return how close vehicles came, and what the filter that keeps them apart did; nothing without one."""
    if safety is None:
        return []
    shares, left, closest = safety["filtered"], safety["smallest_separation"], safety.get("closest")
    busiest = max(shares, key=shares.__getitem__)
    lines = [
        f"separation: all distances exceed the required ones by at least {left:.3g} m; the filter acted on "
        f"{sum(share > 0.0 for share in shares.values())} of {len(shares)} agents, on {busiest} most, "
        f"{100.0 * shares[busiest]:.3g} % of the time"
        if left is not None and left >= 0.0
        else f"TOO CLOSE: {' and '.join(closest['pair'])} are {-closest['gap']:.3g} m closer than required at t = "
        f"{closest['time']:.6g} s"
        if closest
        else f"TOO CLOSE: a distance is {0.0 if left is None else -left:.3g} m below the required one"
    ]
    circling = safety["circling"]
    stopped = [name for name in safety["deadlocked"] if name not in circling]
    if stopped:
        lines.append(
            f"DEADLOCKED: the filter has stopped {shortened(', '.join(stopped))} short of their places; "
            "safety.tie_break: right_hand makes agents that stop turn right"
        )
    if circling:
        lines.append(
            f"DEADLOCKED: the filter keeps {shortened(', '.join(circling))} circling without arriving; "
            "a larger safety.rate lets such agents pass"
        )
    if safety["infeasible"]:
        names = shortened(", ".join(safety["infeasible"]))
        lines.append(f"INFEASIBLE: at some time no command kept all distances of {names}; no guarantee from then on")
    return lines


def _words(measure: str) -> str:
    """Return the name of a measure, or of one at the end of a phase, in words."""
    return measure.removeprefix("mean_").replace("_error", "").replace("_", " ")


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
    allow_drift: Annotated[
        bool,
        typer.Option(
            "--allow-drift", help="Run even if agents are free to drift; errors refer to the q* of least norm."
        ),
    ] = False,
    controller: ControllerOption = None,
    quality: QualityOption = None,
    formats: FormatOption = "png",
    title: TitleOption = True,
    engine: EngineOption = Engine.MUJOCO,
    threads: ThreadsOption = None,
    mcap: McapOption = False,
    ros2: Ros2Option = False,
    live: LiveOption = False,
) -> None:
    """Simulate a scenario and write data, plots, a page that replays the run, and a video.

    Writes result.nc, summary.json, scenario.yaml, errors.png, trajectories.png, configurations.png, report.html and
    then video.mp4 to a directory (default runs/NAME-BACKEND). Refuses a team in which an agent is free to drift (exit
    code 1).
    """
    with progress_bars() as bars:
        figures = lazy.style.FigureOptions(tuple(formats.split(",")), title)
        loaded, directory, origin = prepare(scenario, overrides, seed, out, str(backend), str(backend))
        if expect and getattr(loaded.expect, backend) is None and loaded.expect.refused is None:
            raise InputError(f"{scenario}: expect.{backend}: missing; --expect needs bounds for this backend")
        named = None
        if expect or controller is not None:
            named = lazy.expecting.expected_law(loaded, lazy.load.find_scenario(scenario).parent, controller)
        law = named.load(loaded.seed) if named else None
        options = lazy.film.video_options(loaded, quality=quality) if video else None
        with _as_expected(scenario, loaded.expect.refused if expect else None):
            outcome = lazy.publish.execute(
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
                exports=formats_of(mcap=mcap, ros2=ros2, live=live),
                progress=announcing(loaded, str(backend), bars, *([FOXGLOVE] if live else [])),
            )
    print_outcome(outcome, overridden=bool(overrides))
    if options is not None:
        _draw_video(
            directory / "video.mp4",
            lazy.publish.without_video(directory),
            lambda bars: "".join(lazy.publish.add_video(outcome, loaded, options, bars).notes),  # at most one
        )
    if outcome.summary["status"] == "unstable":
        raise UnstableError(f"{outcome.summary['message']}; what was recorded is in {directory}")
    if expect:
        misses = lazy.expecting.missed(outcome.summary["expect"]["checks"])
        if misses:
            raise NotHeldError(f"{scenario}: {', '.join(misses)}")
        parts = (outcome.summary, *outcome.summary["phases"])
        bounds = [part[name] for part in parts for name in ("theorem", "held_law") if name in part]
        if any(bound["wrong"] for bound in bounds):  # a fault in mjsheaf
            text = next(note["text"] for note in outcome.summary["notes"] if note["kind"] == "bound")
            raise NotHeldError(f"{scenario}: {text}")


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


def _draw_video(path: Path, kept: str, draw: Callable[["lazy.progress.Report"], str]) -> None:
    """Draw the video of a published run or comparison into its directory, and print its path or why there is none.

    Args:
        path: Path of the video.
        kept: Sentence about what is complete without the video.
        draw: Draws it, and returns the reason why there is none, or ''.
    """
    print_lines(f"drawing the video; all other files are written: open {path.with_name('report.html')} in any browser")
    with progress_bars() as bars, saying_what_is_kept(lambda: kept):
        reason = draw(bars)
    if reason:
        print_note(reason)
    else:
        print_lines(f"  {path}")


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
        figures = lazy.style.FigureOptions(tuple(formats.split(",")), title)
        loaded, directory, origin = prepare(scenario, overrides, seed, out, "physics", "compare")
        law = None if controller is None else lazy.load.find_law(controller)
        with in_field(scenario):
            published = lazy.comparing.publish(
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
        make_console(_WIDTH).print(lazy.comparing_page.report(record))
    else:
        print_lines(*lazy.comparing_page.summary(record))
    about = {
        "report.html": "replay of both runs, for any browser",
        "report.txt": "the whole report, which --full prints",
        "compare.json": "every number",
    }
    print_lines(*filter(None, [published.replaced]), *describe_files(directory, about))
    if video:
        _draw_video(
            directory / "compare.mp4",
            f"{directory} is complete except for its video",
            lambda bars: lazy.comparing.add_video(published, quality, bars),
        )
    for rung in map(record.rung, ("ideal", "all")):
        if rung.status != "finished":
            raise UnstableError(f"{rung.label}: {rung.message}; what was found is in {directory}")


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

    figures = lazy.style.FigureOptions(tuple(formats.split(",")), title)
    with progress_bars() as bars:
        record, place, replaced = lazy.overlay.publish_runs(directories, out, figures, bars)
    numbers = ["tracking", "at the end", "formation", "at the end ", "distance"]
    headings = ["run", "backend", "law", *numbers]
    above = (
        f"errors in m: RMS over agents (formation: over edges) and the second half of {record.start_s:g} to "
        f"{record.end_s:g} s, and at the end\nin brackets the difference from the first run; distance: of agents from "
        "the first run's"
    )
    table = make_table(*headings, numbers=numbers, fixed=["backend", *numbers], title=above)
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
        loaded = lazy.scenario.load_scenario(scenario)
        path = lazy.load.find_scenario(scenario)
        data = path.read_bytes()
        if update:
            if scenario in lazy.load.list_scenarios():
                raise InputError(f"{scenario}: comes with mjsheaf; copy {path} and update the copy")
            lazy.files.require_writable(path)
        order = lazy.expecting.BACKEND_ORDER
        wanted = sorted(map(str, set(backend or order)), key=order.index)
        known = wanted if update else lazy.expecting.expected_backends(loaded)
        missing = [name for name in wanted if name not in known]
        if missing and (backend or not known):
            raise InputError(f"{scenario}: expect.{missing[0]}: missing; --update writes it from a run")
        trials = []
        with in_field(scenario):
            law = lazy.expecting.expected_law(loaded, path.parent, controller)
        before = loaded.expect.model_dump(exclude_none=True)
        if update and law is not None:
            before["controller"] = lazy.load.name_law_from(law, path.parent)
        for name in [name for name in wanted if name in known]:
            with in_field(scenario):
                trials.append(
                    lazy.expecting.try_scenario(loaded, name, law=law, progress=partial(bars, f"simulating ({name})"))
                )
            print_lines(lazy.expecting.describe(trials[-1], loaded.name, scenario))
    if not update:
        misses = [f"{miss} on {trial.backend}" for trial in trials for miss in lazy.expecting.missed(trial.checks)]
        if misses:
            raise NotHeldError(f"{scenario}: {', '.join(misses)}")
        return
    for trial in trials:
        if trial.status == "unstable":
            raise UnstableError(f"{scenario}: blew up on {trial.backend}: {trial.message}; nothing is written")
    with in_field(scenario):
        block = lazy.expecting.expectation_from(trials, margin, before)
    comment = "" if "refused" in block else f"at most {100.0 * margin:g} % above what was found"
    text = lazy.files.with_field(data.decode("utf-8"), "expect", block, scenario, comment)
    lazy.files.replace_file(path, text.encode("utf-8"), expected=data)
    print_lines(f"wrote expect: of {path}")


_Measure = Literal["mean_disagreement", "tracking_error", "formation_error", "centering_error"]


def sweep(
    source: Annotated[
        str, typer.Argument(metavar="STUDY|SCENARIO", help="Name or YAML file of a study or a scenario.")
    ],
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Directory for the study: a new one, or that of a study to resume.")
    ],
    grid: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH=V1,V2,...", help="Values of a field, PATH as for --set. Repeat to run all combinations."
        ),
    ] = None,
    seeds: Annotated[
        str | None, typer.Option(metavar="A:B", help="Run every point with each of the seeds A to B - 1.")
    ] = None,
    overrides: SetOption = None,
    backend: Annotated[Backend | None, typer.Option(help="As for run.", show_default="physics")] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Local processes.", show_default="one per core")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Running dask scheduler to use instead of local processes.")
    ] = None,
    threads: Annotated[bool, typer.Option("--threads", help="Use threads of one process, not processes.")] = False,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Repeat all runs that did not finish.")] = False,
    trajectories: Annotated[
        bool, typer.Option("--trajectories", help="Keep result.nc of every run in DIR/trajectories.")
    ] = False,
    measure: Annotated[_Measure | None, typer.Option(help="Error that the plots show.", show_default="all")] = None,
    formats: FormatOption = "png",
    title: TitleOption = True,
    engine: Annotated[Engine | None, typer.Option(help="As for run.", show_default="mujoco")] = None,
    batch: Annotated[
        bool, typer.Option("--batch", help="Keep errors alone, not how runs end, in less time; on the fused engine.")
    ] = False,
    controller: ControllerOption = None,
) -> None:
    """Run a scenario with many gains, seeds or topologies, on all cores or a cluster.

    Writes table.csv and table.parquet with one row per run, plots, and index.html. If the command is interrupted, the
    same command resumes it. A failed run becomes a row of the table; the other runs continue, and the exit code is
    still 0.
    """
    for name in lazy.threads.ONE_THREAD:  # also for threads of this process, because numpy is not imported yet
        os.environ.setdefault(name, "1")
    with progress_bars() as bars:
        if scheduler is not None and (workers is not None or threads):
            option = "--threads" if workers is None else "--workers"
            reason = "has no meaning with --scheduler, which has its own workers; give one of the two"
            raise InputError(f"{option}: {reason}")
        figures = lazy.style.FigureOptions(tuple(formats.split(",")), title)
        plan = lazy.plan.load_plan(
            source,
            grid=_grid_of(grid or ()),
            seeds=None if seeds is None else lazy.plan.parse_seeds(seeds),
            overrides=changes_of(overrides),
            backend=backend and backend.value,
            engine=engine and engine.value,
            batch=batch,
            measure=measure,
            trajectories=trajectories,
            controller=controller,
        )
        if plan.study.seeds is not None and not plan.seed_matters:
            note_idle_seed(plan.scenario["name"], plan.study.backend)
        begin = (
            partial(lazy.workers.local_workers, workers, processes=not threads)
            if scheduler is None
            else partial(lazy.workers.workers_at, scheduler, print_note)
        )

        def kept() -> str:
            ended = len(list(out.glob("runs/[0-9]*.json")))
            return f"{ended} of {len(plan.points)} runs have ended and are kept in {out}; the same command resumes it"

        with saying_what_is_kept(kept):
            study = lazy.study.run_study(plan, out, begin, retry_failed=retry_failed, figures=figures, progress=bars)
    _print_study(study, out)


def _grid_of(texts: Iterable[str]) -> dict[str, Any]:
    """Return the values of each field that --grid names.

    Raises:
        InputError: A field is named twice, or a text is no field with values.
    """
    swept = [lazy.plan.parse_grid(text) for text in texts]
    for path, count in Counter(path for path, _ in swept).items():
        if count > 1:
            raise InputError(f"--grid {path}: is given twice; give all its values once")
    return dict(swept)


def _print_study(study: "lazy.study.Study", out: Path) -> None:
    """Print how the runs of a study ended, and its files."""
    records = study.records
    counts = Counter(record["status"] for record in records)
    before = len(records) - study.begun
    headline = f"{len(records)} runs: {', '.join(f'{count} {status}' for status, count in counts.items())}"
    print_lines(f"{headline} ({before} had ended before)" if before > 0 else headline)
    failed = [record for record in records if record["status"] != "finished"]
    if failed:
        status = failed[0]["status"]
        print_lines(f"  run {failed[0]['run']}: {status}: {failed[0]['message'].removeprefix(f'{status}: ')}")
    if len(failed) > 1:
        print_lines(f"  and {len(failed) - 1} more that did not finish; see {out / 'table.csv'}")
    unsettled = sum(record["status"] == "finished" and record["settled"] is False for record in records)
    print_lines(
        *filter(None, [lazy.study.not_converged(unsettled, counts["finished"])]),
        *(f"  {out / name}" for name in study.files),
    )


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
    with progress_bars() as bars, lazy.store.reopen_run(directory) as (scenario, dataset, summary):
        options = lazy.film.video_options(scenario, **changes)
        own = directory / "video.mp4"
        path = own if out is None else out
        require_place(path, own, ".mp4")
        backend, reason = lazy.gl.available_backend()
        if backend is None:
            raise InputError(f"no video can be drawn here: {reason}")
        film = lazy.film.film_of(scenario, dataset)
        frames = lazy.draw.draw_video([film], path, options, partial(bars, "drawing video"))
    if path.resolve() == own.resolve():
        entry = lazy.publish.video_entry(frames, options)
        lazy.store.save_summary({**summary, "video": entry}, directory / "summary.json")
    print_lines(f"{path}: {frames} frames, {options.width}x{options.height} at {options.fps:g} frames a second")


def report(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a finished run.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="HTML file to write.", show_default="DIR/report.html")
    ] = None,
) -> None:
    """Rewrite the page of a finished run: one HTML file that replays the run in any browser, offline."""
    with progress_bars("writing the page"):
        if out is not None:
            require_place(out, directory / "report.html", ".html")
        path = lazy.publish.replay(directory).save(out or directory / "report.html")
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
        figures = lazy.style.FigureOptions(tuple(formats.split(",")), title)
        if out is not None:
            if out.exists() and not out.is_dir():
                raise InputError(f"--out {out}: is not a directory")
            require_place(out / "errors.png", directory / "errors.png")
        found = lazy.publish.plot_again(directory, out or directory, figures, bars)
    for path in found:
        print_lines(path)


def require_place(path: Path, own: Path, *suffixes: str) -> None:
    """Refuse a file of --out with another suffix, or in the directory of a run, unless it is the run's `own`.

    Raises:
        InputError: The file cannot be written, or lies in the directory of a run.
    """
    if suffixes:
        require_file_name("--out", path, *suffixes)
    run = lazy.store.enclosing_run(path)
    if run is not None and path.resolve() != own.resolve():
        raise InputError(f"--out {path}: lies in {run}, a run's directory; expected {own}, or a place outside of runs")
