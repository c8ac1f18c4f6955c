"""`mjsheaf sweep`."""

import os
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

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
    from mjsheaf.studies.plan import Plan
    from mjsheaf.studies.study import Study

Measure = Literal["mean_disagreement", "tracking_error", "formation_error", "centering_error"]
GridOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATH=V1,V2,...", help="Values of a field, PATH as for --set. Repeat to run all combinations."
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Local processes.", show_default="one per core"),
]
_SchedulerOption = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Running dask scheduler to use instead of local processes.")
]
_ThreadsFlag = Annotated[bool, typer.Option("--threads", help="Use threads of one process instead of processes.")]
_BatchFlag = Annotated[
    bool,
    typer.Option("--batch", help="Keep errors alone, not how runs end, in less time; on the fused engine."),
]


def sweep(
    source: Annotated[
        str, typer.Argument(metavar="STUDY|SCENARIO", help="Name or YAML file of a study or a scenario.")
    ],
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Directory for the study: a new one, or that of a study to resume.")
    ],
    grid: GridOption = None,
    seeds: Annotated[
        str | None, typer.Option(metavar="A:B", help="Run every point with each of the seeds A to B - 1.")
    ] = None,
    overrides: SetOption = None,
    backend: Annotated[Backend | None, typer.Option(help="As for run.", show_default="physics")] = None,
    workers: WorkersOption = None,
    scheduler: _SchedulerOption = None,
    threads: _ThreadsFlag = False,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Repeat all runs that did not finish.")] = False,
    trajectories: Annotated[
        bool, typer.Option("--trajectories", help="Keep result.nc of every run in DIR/trajectories.")
    ] = False,
    measure: Annotated[Measure | None, typer.Option(help="Error that the plots show.", show_default="all")] = None,
    formats: FormatOption = "png",
    title: TitleOption = True,
    engine: Annotated[Engine | None, typer.Option(help="As for run.", show_default="mujoco")] = None,
    batch: _BatchFlag = False,
    controller: ControllerOption = None,
) -> None:
    """Run a scenario with many gains, seeds or topologies, on all cores or a cluster.

    Writes table.csv and table.parquet with one row per run, plots, and index.html. If the command is interrupted, the
    same command resumes it. A failed run becomes a row of the table; the other runs continue, and the exit code is
    still 0.
    """
    _take_one_thread_each()
    with progress_bars() as bars:
        from mjsheaf.studies import load_plan, run_study
        from mjsheaf.studies.workers import local_workers, workers_at

        given = {"--workers": workers is not None, "--threads": threads}
        _refuse(given, scheduler is not None, "with --scheduler, which has its own workers; give one of the two")
        figures = figure_options(formats, title)
        plan = load_plan(
            source,
            **_points_of(grid or (), seeds),
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
        with saying_what_is_kept(partial(_describe_kept, plan, out)):
            study = run_study(plan, out, begin, retry_failed=retry_failed, figures=figures, progress=bars)
    _print_study(study, out)


def _take_one_thread_each() -> None:
    """Limit every worker to one core.

    This includes threads of this process, because numpy is not imported yet.
    """
    from mjsheaf.threads import ONE_THREAD

    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")


def _describe_kept(plan: "Plan", out: Path) -> str:
    """Return how many runs of a study have ended."""
    ended = len(list(out.glob("runs/[0-9]*.json")))
    return f"{ended} of {len(plan.points)} runs have ended and are kept in {out}; the same command resumes the study"


def _refuse(given: dict[str, bool], excluded: bool, reason: str) -> None:
    """Refuse the first given one of some options, if they are excluded.

    Raises:
        InputError: An excluded option is given.
    """
    for option, is_given in given.items():
        if excluded and is_given:
            raise InputError(f"{option}: has no meaning {reason}")


def _points_of(grid: Sequence[str], seeds: str | None) -> dict[str, Any]:
    """Return the values of each field that --grid names, and the seeds.

    Raises:
        InputError: A field is named twice, or a text is no field with values or no range of seeds.
    """
    from mjsheaf.studies.plan import parse_grid, parse_seeds

    swept = [parse_grid(text) for text in grid]
    for path, count in Counter(path for path, _ in swept).items():
        if count > 1:
            raise InputError(f"--grid {path}: is given twice; give all its values once")
    return {"grid": dict(swept), "seeds": None if seeds is None else parse_seeds(seeds)}


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
        print_lines(*_first_failure(failed, out))
    unsettled = sum(record["status"] == "finished" and record["settled"] is False for record in records)
    print_lines(
        *filter(None, [not_converged(unsettled, counts["finished"])]),
        *(f"  {out / name}" for name in study.files),
    )


def _first_failure(failed: list[dict[str, Any]], out: Path) -> list[str]:
    """Return lines on the first of the runs that did not finish, and on the number of the others."""
    status = failed[0]["status"]
    first = f"  run {failed[0]['run']}: {status}: {failed[0]['message'].removeprefix(f'{status}: ')}"
    others = f"  and {len(failed) - 1} more that did not finish; see {out / 'table.csv'}"
    return [first, others] if len(failed) > 1 else [first]
