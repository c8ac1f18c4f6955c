"""A study from plan to results: what is missing is run, then everything is shown."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjsheaf.studies.directory import RESULT_FILES, StudyDirectory, open_directory
from mjsheaf.studies.engine import Engine, SchedulerError
from mjsheaf.studies.job import ForeignWorkerError
from mjsheaf.studies.plan import Plan

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Study:
    """What a study left.

    Attributes:
        directory: where.
        records: of all runs, in order; see `job.new_record`.
        begun: how many were run by this command; the others had ended before.
        files: what is to be looked at, in the directory.
    """

    directory: Path
    records: list[dict[str, Any]]
    begun: int
    files: list[str]


def run_study(
    plan: Plan,
    directory: Path,
    engine: Callable[[], AbstractContextManager[Engine]],
    *,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> Study:
    """Run what of a study has not ended, and write its table, plots and page.

    Args:
        plan: from `load_plan`.
        directory: of this study; new, or with an earlier part of it.
        engine: makes the cluster; called only where something is left to run.
        retry_failed: run again what did not finish.
        progress: called with (what is being done, done, in all).

    Raises:
        PlaceError: the directory holds something else or cannot be written. Runs that have ended are kept.
        BusyError: another command works on the directory.
        SchedulerError: the cluster cannot be reached, or went away. Runs that have ended are kept; without any, so is
            only a directory that was there before.
    """
    with open_directory(directory, plan) as place:
        records = place.ended()
        kept = {n for n, r in records.items() if not retry_failed or r["status"] == "finished"}
        missing = [point for point in plan.points if point.number not in kept]
        if missing:
            try:
                with engine() as cluster:
                    done = len(kept)
                    _report(progress, done, plan)
                    for result in cluster.run(plan.job(point) for point in missing):
                        place.save(result)
                        records[result.record["run"]] = result.record
                        done += 1
                        _report(progress, done, plan)
            except (SchedulerError, ForeignWorkerError):
                place.leave()
                raise
        ordered = [records[point.number] for point in plan.points]
        return Study(directory, ordered, len(missing), _show(place, plan, ordered))


def _report(progress: Progress | None, done: int, plan: Plan) -> None:
    if progress:
        progress("running", done, len(plan.points))


def _show(place: StudyDirectory, plan: Plan, records: list[dict[str, Any]]) -> list[str]:
    from mjsheaf.studies.figures import plot_study
    from mjsheaf.studies.page import page_of
    from mjsheaf.studies.table import csv_of, make_table, parquet_of

    table = make_table(plan, records)
    files = {"table.csv": csv_of(table), "table.parquet": parquet_of(table)}
    plots = plot_study(plan.study, plan.name, records)
    files.update(plots)
    files["index.html"] = page_of(plan, table, plots)
    place.remove(RESULT_FILES - set(files))
    for name, content in files.items():
        place.write(name, content)
    return list(files)
