"""`mjsheaf sweep`."""

import os
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
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
)
from mjsheaf.cli.terminal import Stopped, print_lines, print_note, progress_bars
from mjsheaf.errors import InputError

if TYPE_CHECKING:
    from mjsheaf.studies.plan import Plan
    from mjsheaf.studies.study import Study

    Begin = Callable[[], AbstractContextManager[Any]]

Measure = Literal["mean_disagreement", "tracking_error", "formation_error", "centering_error"]


_Source = Annotated[
    str, typer.Argument(metavar="STUDY|SCENARIO", help="A study file or a scenario: a name, or a YAML file.")
]
_Out = Annotated[Path, typer.Option(metavar="DIR", help="Directory of the study: new, or one to be gone on with.")]
_Grid = Annotated[
    list[str] | None,
    typer.Option(metavar="PATH=V1,V2,...", help="Sweep a field that --set reaches; each with every other."),
]
_Seeds = Annotated[str | None, typer.Option(metavar="A:B", help="Every point with the seeds A to B - 1.")]
_Workers = Annotated[
    int | None,
    typer.Option(
        min=1, metavar="N", help="Processes of this machine, threads with --batch.", show_default="one a core"
    ),
]
_Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A dask scheduler that exists, instead of this machine.")
]
_Threads = Annotated[bool, typer.Option("--threads", help="Threads of one process instead of processes.")]
_Retry = Annotated[bool, typer.Option("--retry-failed", help="Run again what ended otherwise than finished.")]
_Trajectories = Annotated[bool, typer.Option("--trajectories", help="Keep result.nc of every run in DIR/trajectories.")]
_Measured = Annotated[Measure | None, typer.Option(help="The error that plots show.", show_default="all")]
_Device = Annotated[
    Literal["cpu", "gpu"] | None,
    typer.Option(help="gpu: many runs at once on a CUDA card, by the fused engine.", show_default="cpu"),
]
_Batch = Annotated[
    bool, typer.Option("--batch", help="Runs of one team together, by the fused engine; records keep less.")
]


def sweep(
    source: _Source,
    out: _Out,
    grid: _Grid = None,
    seeds: _Seeds = None,
    overrides: SetOption = None,
    backend: Annotated[Backend | None, typer.Option(help="As for run.", show_default="physics")] = None,
    workers: _Workers = None,
    scheduler: _Scheduler = None,
    threads: _Threads = False,
    retry_failed: _Retry = False,
    trajectories: _Trajectories = False,
    measure: _Measured = None,
    formats: FormatOption = "png",
    title: TitleOption = True,
    engine: Annotated[Engine | None, typer.Option(help="As for run.", show_default="mujoco")] = None,
    device: _Device = None,
    batch: _Batch = False,
    controller: ControllerOption = None,
) -> None:
    """Run a scenario many times, on every core or a cluster; killed at any moment, the same command goes on.

    Writes table.csv and table.parquet with a row a run, plots and index.html. The table reports a run that fails, and
    the others go on; the exit code is then still 0.
    """
    from mjsheaf.threads import ONE_THREAD

    # Workers side by side share the cores: each takes one, also where they are threads of this process, whose numpy is
    # not imported yet.
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    from mjsheaf.studies import load_plan, run_study
    from mjsheaf.studies.plan import parse_seeds

    given = {"--workers": workers is not None, "--threads": threads, "--scheduler": scheduler is not None}
    if scheduler is not None:
        _refuse({**given, "--scheduler": False}, "beside --scheduler, whose workers exist; give either")
    figures = figure_options(formats, title)
    plan = load_plan(
        source,
        grid=_grid_of(grid or ()),
        seeds=None if seeds is None else parse_seeds(seeds),
        overrides=changes_of(overrides),
        backend=backend and backend.value,
        engine=engine and engine.value,
        device=device,
        batch=batch,
        measure=measure,
        trajectories=trajectories,
        controller=controller,
    )
    if plan.study.seeds is not None and not plan.seed_matters:
        note_idle_seed(plan.scenario["name"], plan.study.backend)
    begin = _workers_for(plan, given, workers, scheduler)
    with progress_bars() as bars:
        try:
            study = run_study(plan, out, begin, retry_failed=retry_failed, figures=figures, progress=bars)
        except Stopped as stopped:
            ended = len(list(out.glob("runs/[0-9]*.json")))
            kept = f"{ended} of {len(plan.points)} runs have ended and are kept in {out}; the same command goes on"
            stopped.message = stopped.message.replace("nothing was written", kept)
            raise
    _print_study(study, out)


def _refuse(given: dict[str, bool], reason: str) -> None:
    """Refuse the first of some options that is given.

    Raises:
        InputError: One is.
    """
    for option, is_given in given.items():
        if is_given:
            raise InputError(f"{option}: has no meaning {reason}")


def _grid_of(texts: Sequence[str]) -> dict[str, Any]:
    """Return the values of each field that --grid names.

    Raises:
        InputError: A field is named twice, or a text is no field with values.
    """
    from mjsheaf.studies.plan import parse_grid

    swept = [parse_grid(text) for text in texts]
    for path, count in Counter(path for path, _ in swept).items():
        if count > 1:
            raise InputError(f"--grid {path}: is given twice; give all its values once")
    return dict(swept)


def _workers_for(plan: "Plan", given: dict[str, bool], workers: int | None, scheduler: str | None) -> "Begin":
    """Return the function that begins the workers of a study: on a GPU, on threads, on a cluster or on this machine.

    Raises:
        InputError: An option that is given has no meaning for them, or there is no GPU.
    """
    from mjsheaf.studies.workers import local_workers, workers_at

    if plan.study.device == "gpu":
        from mjsheaf.simulation.card import require_card
        from mjsheaf.studies.batches import on_card

        _refuse(given, "on device gpu, which runs all together; leave it out")
        require_card()
        return on_card
    if plan.study.batch:
        from mjsheaf.studies.batches import on_threads

        _refuse({**given, "--workers": False}, "with --batch, whose runs are on threads; leave it out")
        return partial(on_threads, workers)
    if scheduler is not None:
        return partial(workers_at, scheduler, print_note)
    return partial(local_workers, workers, processes=not given["--threads"])


def _print_study(study: "Study", out: Path) -> None:
    """Print how the runs of a study ended, and its files."""
    from mjsheaf.studies.study import not_converged

    records = study.records
    counts = Counter(record["status"] for record in records)
    before = len(records) - study.begun
    headline = f"{len(records)} runs: {', '.join(f'{count} {status}' for status, count in counts.items())}"
    print_lines(f"{headline} ({before} had ended before)" if before > 0 else headline)
    failed = [record for record in records if record["status"] != "finished"]
    for record in failed[:1]:
        print_lines(
            f"  run {record['run']}: {record['status']}: {record['message'].removeprefix(record['status'] + ': ')}"
        )
    if len(failed) > 1:
        print_lines(f"  and {len(failed) - 1} more that did not finish; see {out / 'table.csv'}")
    moving = sum(record["settled"] is False for record in records if record["status"] == "finished")
    if moving:
        print_lines(not_converged(moving, counts["finished"]))
    print_lines(*(f"  {out / name}" for name in study.files))
