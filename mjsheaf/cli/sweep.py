"""`mjsheaf sweep`."""

import os
from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from mjsheaf.cli.options import (
    Backend,
    ControllerOption,
    Engine,
    FormatOption,
    SetOption,
    TitleOption,
    changes_of,
    figure_options,
    note_idle_seed,
    print_lines,
    print_note,
    progress_bars,
    saying_what_is_kept,
)
from mjsheaf.errors import InputError

if TYPE_CHECKING:
    from mjsheaf.studies.study import Study

Measure = Literal["mean_disagreement", "tracking_error", "formation_error", "centering_error"]


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
    threads: Annotated[
        bool, typer.Option("--threads", help="Use threads of one process instead of processes.")
    ] = False,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Repeat all runs that did not finish.")] = False,
    trajectories: Annotated[
        bool, typer.Option("--trajectories", help="Keep result.nc of every run in DIR/trajectories.")
    ] = False,
    measure: Annotated[Measure | None, typer.Option(help="Error that the plots show.", show_default="all")] = None,
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
    from mjsheaf.threads import ONE_THREAD

    for name in ONE_THREAD:  # also for threads of this process, because numpy is not imported yet
        os.environ.setdefault(name, "1")
    with progress_bars() as bars:
        from mjsheaf.studies import load_plan, run_study
        from mjsheaf.studies.plan import parse_grid, parse_seeds
        from mjsheaf.studies.workers import local_workers, workers_at

        for option, given in {"--workers": workers is not None, "--threads": threads}.items():
            if given and scheduler is not None:
                reason = "with --scheduler, which has its own workers; give one of the two"
                raise InputError(f"{option}: has no meaning {reason}")
        figures = figure_options(formats, title)
        swept = [parse_grid(text) for text in grid or ()]
        for path, count in Counter(path for path, _ in swept).items():
            if count > 1:
                raise InputError(f"--grid {path}: is given twice; give all its values once")
        plan = load_plan(
            source,
            grid=dict(swept),
            seeds=None if seeds is None else parse_seeds(seeds),
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
            partial(local_workers, workers, processes=not threads)
            if scheduler is None
            else partial(workers_at, scheduler, print_note)
        )

        def kept() -> str:
            ended, points = len(list(out.glob("runs/[0-9]*.json"))), len(plan.points)
            return f"{ended} of {points} runs have ended and are kept in {out}; the same command resumes the study"

        with saying_what_is_kept(kept):
            study = run_study(plan, out, begin, retry_failed=retry_failed, figures=figures, progress=bars)
    _print_study(study, out)


def _print_study(study: "Study", out: Path) -> None:
    """Print how the runs of a study ended, and its files."""
    from mjsheaf.studies.study import not_converged

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
        *filter(None, [not_converged(unsettled, counts["finished"])]),
        *(f"  {out / name}" for name in study.files),
    )
