"""The directory that a comparison leaves, published whole."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjsheaf.comparing.climbing import Progress, Run
from mjsheaf.comparing.compare import Comparison, compare
from mjsheaf.comparing.measures import TEAM
from mjsheaf.comparing.record import CompareRecord
from mjsheaf.comparing.report import report_text
from mjsheaf.errors import MjsheafError
from mjsheaf.resolving import write_scenario
from mjsheaf.results.store import replaced_run, save_summary, staging
from mjsheaf.scenario import Scenario
from mjsheaf.video import available_backend

if TYPE_CHECKING:
    from mjsheaf.plots.compare import RungCurves


@dataclass(frozen=True)
class Published:
    """What a comparison left.

    Attributes:
        directory: where.
        record: as compare.json.
        notes: what the user should know beside that.
        replaced: what is to be told of the run whose place it took; None where there was none.
    """

    directory: Path
    record: CompareRecord
    notes: list[str]
    replaced: str | None = None


def default_directory(scenario: Scenario) -> Path:
    """Where a comparison goes unless told otherwise."""
    return Path("runs") / f"{scenario.name}-compare"


def publish(
    scenario: Scenario, directory: Path, *, video: bool, origin: str | None = None, progress: Progress | None = None
) -> Published:
    """Compare a scenario's ideal kinematics with its bodies and publish what came out, also where bodies blow up.

    Args:
        scenario: the scenario.
        directory: where the results go.
        video: whether to film ideal and physics side by side.
        origin: where the scenario comes from, as `scenario.load.origin` has it; compare.json keeps it.
        progress: called with (what is being done, done, in all).

    Raises:
        InputError: a scenario that cannot be simulated; nothing is written.
        PlaceError: the directory may not be replaced or cannot be written.
        NotUniqueError: the harmonic extension is not unique; nothing is written.
    """
    replaced = replaced_run(directory)
    notes: list[str] = []
    with staging(directory) as fresh:
        comparison = compare(scenario, progress)
        record = comparison.record.model_copy(update={"origin": origin})
        write_scenario(scenario, fresh)
        _plot(comparison, fresh, progress)
        if video:
            reason = _film(scenario, comparison, fresh / "compare.mp4", progress)
            notes += [f"no video: {reason}"] if reason else []
            record = record.model_copy(update={"video": None if reason else "compare.mp4"})
        (fresh / "report.txt").write_text(report_text(record), encoding="utf-8")
        if progress:
            progress("publishing", 0, 1)  # the last moment at which the user can stop it
        save_summary(record.model_dump(mode="json"), fresh / "compare.json")
    return Published(directory, record, notes, replaced)


def _plot(comparison: Comparison, folder: Path, progress: Progress | None) -> None:
    from mjsheaf.plots.compare import plot_budget, plot_convergence, plot_rungs

    ideal = comparison.runs["ideal"]
    plot_rungs(
        comparison.record, {key: _curves(run, ideal) for key, run in comparison.runs.items()}, folder / "errors.png"
    )
    plot_budget(comparison.record, folder / "budget.png")
    plot_convergence(comparison.record, folder / "convergence.png")
    if progress:
        progress("plotting", 1, 1)


def _curves(run: Run, ideal: Run) -> "RungCurves":
    from mjsheaf.plots.compare import RungCurves

    N, samples = len(run.system.team.agents), min(len(run.trajectory.time), len(ideal.trajectory.time))
    apart = run.trajectory.positions[:samples, :N] - ideal.trajectory.positions[:samples, :N]
    team = run.series[TEAM]
    return RungCurves(
        time=run.trajectory.time[:samples],
        tracking=team.tracking_error[:samples],
        formation=team.formation_error[:samples],
        distance=np.linalg.norm(apart, axis=2).max(axis=1),
    )


def _film(scenario: Scenario, comparison: Comparison, path: Path, progress: Progress | None) -> str:
    """Draw the video, or say why there is none: a machine that cannot draw still gets its data."""
    backend, reason = available_backend()
    if backend is None:
        return reason
    from mjsheaf.comparing.filming import film_side_by_side
    from mjsheaf.video.encode import UnwritableError

    runs = comparison.runs
    try:
        film_side_by_side(
            scenario,
            runs["ideal"],
            runs["all"],
            path,
            lambda done, total: progress("drawing video", done, total) if progress else None,
        )
    except UnwritableError:
        raise
    except MjsheafError as error:
        return str(error)
    return ""
