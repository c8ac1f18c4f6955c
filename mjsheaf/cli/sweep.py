"""`mjsheaf sweep`."""

import json
import os
from collections import Counter
from pathlib import Path

from mjsheaf.cli.console import make_console
from mjsheaf.cli.progress import progress_bars
from mjsheaf.cli.signals import Stopped
from mjsheaf.errors import InputError
from mjsheaf.threads import ONE_THREAD


def sweep_command(
    source: str,
    grid: list[str],
    seeds: str | None,
    overrides: list[str],
    backend: str | None,
    workers: int | None,
    scheduler: str | None,
    threads: bool,
    retry_failed: bool,
    trajectories: bool,
    measure: str | None,
    out: Path,
) -> None:
    """Do a study, or what is left of it, and tell what came out."""
    if workers is not None and workers < 1:
        raise InputError(f"--workers {workers}: expected 1 or more")
    if scheduler is not None and (workers is not None or threads):
        given = "--workers" if workers is not None else "--threads"
        raise InputError(f"{given}: has no meaning beside --scheduler, whose workers exist; give either")
    # Workers side by side share the cores: each takes one, also where they are threads of this process, whose numpy is
    # not imported yet.
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    from mjsheaf.results.metrics import MEASURES
    from mjsheaf.scenario.load import parse_override
    from mjsheaf.studies.engine import engine_at, local_engine
    from mjsheaf.studies.plan import load_plan, parse_grid, parse_seeds
    from mjsheaf.studies.study import run_study

    if measure is not None and measure not in MEASURES:
        raise InputError(f"--measure {measure}: expected {', '.join(MEASURES)}")
    swept: dict[str, list[object]] = {}
    for text in grid:
        path, values = parse_grid(text)
        if path in swept:
            raise InputError(f"--grid {path}: is given twice; give all its values once")
        swept[path] = values
    plan = load_plan(
        source,
        grid=swept,
        seeds=None if seeds is None else parse_seeds(seeds),
        overrides=dict(parse_override(text) for text in overrides),
        backend=backend,
        measure=measure,
        trajectories=trajectories,
    )
    if plan.study.seeds is not None and not plan.seed_matters:
        _note(
            f"the seed changes nothing: {plan.scenario['name']} has no spread and no disturbance on backend "
            f"{plan.study.backend}"
        )
    done = 0

    with progress_bars() as bars:

        def progress(what: str, so_far: int, total: int) -> None:
            nonlocal done
            done = so_far
            bars(what, so_far, total)

        try:
            study = run_study(
                plan,
                out,
                lambda: (
                    engine_at(scheduler, _note)
                    if scheduler is not None
                    else local_engine(workers, processes=not threads)
                ),
                retry_failed=retry_failed,
                progress=progress,
            )
        except Stopped as stopped:
            kept = f"{done} of {len(plan.points)} runs have ended and are kept in {out}; the same command goes on"
            stopped.message = stopped.message.replace("nothing was written", kept)
            raise
    counts = Counter(record["status"] for record in study.records)
    console = make_console(soft_wrap=True, highlight=False)
    told = ", ".join(f"{count} {status}" for status, count in counts.items())
    before = len(study.records) - study.begun
    console.print(f"{len(study.records)} runs: {told}" + (f" ({before} had ended before)" if before else ""))
    for record in study.records:
        if record["status"] != "finished":
            status = record["status"]
            message = record["message"].removeprefix(f"{status}: ")
            console.print(f"  run {record['run']}: {status}: {message}", markup=False)
            break
    failed = len(study.records) - counts["finished"]
    if failed > 1:
        console.print(f"  and {failed - 1} more that did not finish; see {out / 'table.csv'}", markup=False)
    for name in study.files:
        console.print(f"  {out / name}", markup=False)


def _note(text: str) -> None:
    make_console(stderr=True, soft_wrap=True, highlight=False).print(f"note: {text}", markup=False)


def print_schema() -> None:
    """Print the JSON Schema of a study file."""
    from mjsheaf.studies.schema import StudyFile

    print(json.dumps(StudyFile.model_json_schema(), indent=2))
