"""Comparison of finished runs: their errors on one axis, a table of differences, and a page with ghosts."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field

from mjsheaf._version import __version__
from mjsheaf.arrays import Array
from mjsheaf.checking.theorem.of_run import bounds_of_phases
from mjsheaf.errors import InputError, PlaceError, listed
from mjsheaf.page.page import Ghost, page_of
from mjsheaf.progress import Report, no_progress
from mjsheaf.results.dataset import law_of
from mjsheaf.results.metrics import engine_of, phases_in
from mjsheaf.results.store import reopen_run, replaced_run, save_summary, staging, thin
from mjsheaf.scenario import Scenario
from mjsheaf.section import OF_NONE, PER_AGENT_RMS, Finite, FiniteRecord, Norm
from mjsheaf.show.plots import (
    WIDTH,
    label_axes,
    legend_below,
    log_axis,
    mark_times,
    new_figure,
    plain,
    save_figure,
)
from mjsheaf.show.style import AS_USUAL, FigureOptions, line_style

MAX_RUNS = 8
"""Maximum number of runs on one axis; more lines look alike."""

_COLOURS = ("#000000", "#7b2cbf", "#d81b60", "#6d4c41", "#827717", "#1a237e", "#00796b", "#607d8b")
"""Colours of the runs on plots and page, the first run's first; none is that of a group."""

_SLACK = 1e-9  # s, of times of samples
_TEAM_ERRORS = ["tracking_error", "formation_error"]
_LABELS = {
    "tracking_error": "tracking error (m)\nRMS over agents",
    "formation_error": "formation error (m)\nRMS over edges in groups",
}


class ErrorsRecord(FiniteRecord):
    """Errors of a team, m."""

    tracking_error: Finite = Field(description="RMS over agents")
    formation_error: Finite = Field(description="RMS over edges inside formation groups")
    norm: Norm = Field(PER_AGENT_RMS, description=OF_NONE)


class RunRecord(FiniteRecord):
    """One of several runs, and its differences from the first."""

    name: str
    directory: str = Field(description="relative to this directory")
    scenario: str
    backend: str
    engine: str | None = Field(description="physics engine; null on ideal kinematics")
    law: str
    gain: float | None = Field(description="k1, 1/s; null under a law in Python, which ignores it")
    seed: int
    status: str
    start_s: float
    end_s: float
    final: ErrorsRecord = Field(description="at the last time that all runs reach")
    late: ErrorsRecord = Field(description="RMS over the second half of the time that all runs cover")
    final_difference: ErrorsRecord = Field(description="`final` minus that of the first run")
    late_difference: ErrorsRecord = Field(description="`late` minus that of the first run")
    agents_in_common: int = Field(description="number of agents shared with the first run")
    norm: Norm = Field(PER_AGENT_RMS, description="norm of `distance_m`")
    distance_m: Finite = Field(
        description="their distance to the first run's agents, RMS over agents and the second half"
    )
    largest_distance_m: Finite = Field(description="largest of these distances at any time that all runs cover")
    farthest: str = Field(description="agent whose distance that is, or empty")


class RunsRecord(FiniteRecord):
    """Several finished runs, as recorded in runs.json."""

    mjsheaf_version: str
    start_s: float = Field(description="start of the time that all runs cover")
    end_s: float
    notes: list[str] = Field(description="differences between the runs")
    runs: list[RunRecord] = Field(description="in the order given; differences are from the first")


@dataclass(frozen=True)
class OpenRun:
    """A finished run, opened.

    Attributes:
        name: Name in tables and legends.
        directory: Directory of the run.
        scenario: Scenario of the run.
        dataset: Data of the run, read on access.
        summary: Contents of its summary.json.
    """

    name: str
    directory: Path
    scenario: Scenario
    dataset: xr.Dataset
    summary: dict[str, Any]

    @cached_property
    def time(self) -> Array:
        """Sample times, shape (T,), s."""
        return np.asarray(self.dataset["time"].values)

    @cached_property
    def agents(self) -> list[str]:
        """Ids of the agents."""
        return [str(name) for name in self.dataset["agent"].values]

    @cached_property
    def errors(self) -> xr.Dataset:
        """The team's errors over time, m."""
        tracking = (self.dataset["tracking_error"].load() ** 2).mean("agent") ** 0.5
        return xr.Dataset({"tracking_error": tracking, "formation_error": self.dataset["formation_error"].load()})

    @property
    def law(self) -> str:
        """Name of the run's law."""
        attrs = self.dataset.attrs
        return str(attrs.get("law") or attrs.get("controller") or law_of(self.scenario.system))

    @property
    def gain(self) -> float | None:
        """Gain of the run's law, 1/s; None under a law in Python."""
        attrs = self.dataset.attrs
        return None if attrs.get("controller") or "gain" not in attrs else float(attrs["gain"])


@contextmanager
def open_runs(directories: Sequence[Path]) -> Iterator[list[OpenRun]]:
    """Open finished runs that can be compared with the first of them.

    Raises:
        InputError: There are fewer than 2 or more than 8 directories, one is given twice or holds no run, or a run has
            no agent in common with the first.
    """
    if not 2 <= len(directories) <= MAX_RUNS:
        raise InputError(f"DIR: {len(directories)} given; expected 2 to {MAX_RUNS} directories of finished runs")
    twice = [path for path, count in Counter(path.resolve() for path in directories).items() if count > 1]
    if twice:
        given = next(path for path in directories if path.resolve() == twice[0])
        raise InputError(f"{given}: is given twice; expected different runs")
    paths = [path.resolve().parts for path in directories]
    with ExitStack() as held:
        opened: list[OpenRun] = []
        for directory, path in zip(directories, paths, strict=True):
            count = 1
            while sum(other[-count:] == path[-count:] for other in paths) > 1:
                count += 1
            # The name is the shortest unique end of the path.
            run = OpenRun(str(Path(*path[-count:])), directory, *held.enter_context(reopen_run(directory)))
            opened.append(run)
            first = opened[0]
            if not set(run.agents) & set(first.agents):
                raise InputError(
                    f"{directory}: has no agent in common with {first.directory} ({listed(run.agents)} against "
                    f"{listed(first.agents)}); expected runs of one team, or of teams that share agents"
                )
        yield opened


def compare_runs(runs: Sequence[OpenRun], directory: Path) -> RunsRecord:
    """Compare runs with the first of them; paths are relative to `directory`.

    Raises:
        InputError: They share no time.
    """
    first = runs[0]
    start = max(float(run.time[0]) for run in runs)
    end = min(float(run.time[-1]) for run in runs)
    if start > end:
        covered = "; ".join(f"{run.directory} covers {run.time[0]:g} to {run.time[-1]:g} s" for run in runs)
        raise InputError(f"DIR: expected runs that share some time; {covered}")
    second_half = slice(0.5 * (start + end) - _SLACK, end + _SLACK)
    measured = []
    for run in runs:
        final = run.errors[_TEAM_ERRORS].sel(time=end + _SLACK, method="pad")
        late = (run.errors[_TEAM_ERRORS].sel(time=second_half) ** 2).mean("time") ** 0.5
        measured.append((final, late))
    records = []
    for run, (final, late) in zip(runs, measured, strict=True):
        apart = _distances(run, first, start, end)
        rms = float((apart.sel(time=second_half) ** 2).mean() ** 0.5)
        largest = apart.max("time").fillna(-1.0)
        records.append(
            RunRecord(
                name=run.name,
                directory=os.path.relpath(run.directory.resolve(), directory.resolve()),
                scenario=run.scenario.name,
                backend=run.dataset.attrs["backend"],
                engine=engine_of(run.dataset),
                law=run.law,
                gain=run.gain,
                seed=run.scenario.seed,
                status=run.dataset.attrs["status"],
                start_s=run.time[0],
                end_s=run.time[-1],
                final=_record(final),
                late=_record(late),
                final_difference=_record(final - measured[0][0]),
                late_difference=_record(late - measured[0][1]),
                agents_in_common=apart.sizes["agent"],
                distance_m=rms,
                largest_distance_m=float(apart.max()),
                farthest=str(largest.idxmax("agent").item()) if largest.max() > 0.0 else "",
            )
        )
    return RunsRecord(mjsheaf_version=__version__, start_s=start, end_s=end, notes=_unlike(runs, end), runs=records)


def _record(errors: xr.Dataset) -> ErrorsRecord:
    return ErrorsRecord(**{name: float(errors[name]) for name in _TEAM_ERRORS})


def _distances(run: OpenRun, first: OpenRun, start: float, end: float) -> xr.DataArray:
    """Return the distances of a run's agents from those of the first run, over time and agent, m.

    They are NaN while an agent is absent in one of the runs. Positions of the run are interpolated to the first's
    samples, of which there are about 20,000 at most.
    """
    common = [name for name in first.agents if name in run.agents]
    here, there = (
        one.dataset["agent_position"].load().where(one.dataset["tracking_error"].notnull()).sel(agent=common)
        for one in (first, run)
    )
    here = here.sel(time=slice(start - _SLACK, end + _SLACK))
    here = here.isel(time=slice(None, None, max(1, here.sizes["time"] // 20_000)))
    if not np.array_equal(here["time"], there["time"]):
        times = np.clip(here["time"].values, run.time[0], run.time[-1])
        there = there.interp(time=times).assign_coords(time=here["time"])
    apart = here - there
    return ((apart**2).sum("axis") ** 0.5).where(apart.isel(axis=0).notnull())


def _unlike(runs: Sequence[OpenRun], end: float) -> list[str]:
    """Describe differences between the runs in time, and of each from the first in team and scenario."""
    first = runs[0]
    notes = []
    if len({float(run.time[-1]) for run in runs}) > 1:
        notes.append(f"the runs end at different times; errors are those at {end:g} s, the last that all of them reach")
    for run in runs[1:]:
        others = [name for name in run.agents if name not in first.agents]
        missing = [name for name in first.agents if name not in run.agents]
        parts = [f"lacks {listed(missing)}"] if missing else []
        if others:
            parts.append(f"has {listed(others)} in addition")
        if parts:
            notes.append(f"{run.name} {' and '.join(parts)}; its errors are those of its own team")
        if run.scenario.name != first.scenario.name:
            notes.append(f"{run.name} is of scenario {run.scenario.name}, {first.name} of {first.scenario.name}")
    return [*notes, *(f"{run.name} blew up" for run in runs if run.dataset.attrs["status"] != "finished")]


def table_of(record: RunsRecord) -> pd.DataFrame:
    """Make a table with one row per run; columns of errors and differences are named by statistic and measure, m."""
    left_out = {part: {"norm"} for part in ("final", "late", "final_difference", "late_difference")}
    return pd.json_normalize([run.model_dump(exclude=left_out) for run in record.runs], sep="_")


def plot_runs(runs: Sequence[OpenRun], path: Path, options: FigureOptions = AS_USUAL) -> None:
    """Draw the tracking errors of all runs on one axis, and the formation errors on another if some run has one."""
    drawn = [name for name in _TEAM_ERRORS if any(run.errors[name].notnull().any() for run in runs)]
    scenarios = " and ".join(dict.fromkeys(run.scenario.name for run in runs))
    figure = new_figure(WIDTH, 0.9 + 2.4 * len(drawn), f"{scenarios}: {len(runs)} runs", options)
    panels = figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
    events = [phase for phase in phases_in(runs[0].dataset) if phase["events"]]
    for panel, measure in zip(panels, drawn, strict=True):
        errors = [run.errors[measure].values for run in runs]
        for k, (run, error) in enumerate(zip(runs, errors, strict=True)):
            keep = thin(len(run.time), 1500)
            terms = run.scenario.system.law.term_names
            law = run.law if run.gain is None else ", ".join([f"gain {run.gain:g} 1/s", *terms])
            name = plain(f"{run.name} ({run.dataset.attrs['backend']}, {law})")
            panel.plot(run.time[keep], error[keep], label=name, **line_style(k) | {"color": _COLOURS[k]})
        log_axis(panel, "y", np.concatenate(errors))
        label_axes(panel, "", y=_LABELS[measure])
        mark_times(panel, [phase["time"] for phase in events])
    told = [f"{k}: {', '.join(phase['events'])} ({phase['time']:.6g} s)" for k, phase in enumerate(events, 1)]
    below = f"\nevents of {plain(runs[0].name)}:   " + "   ".join(told) if told else ""
    panels[-1].set_xlabel(f"time (s){below}")
    figure.align_ylabels(panels)
    legend_below(figure, panels[0].get_legend_handles_labels()[0], 2)
    save_figure(figure, path, options)


def page_of_runs(runs: Sequence[OpenRun], record: RunsRecord) -> bytes:
    """Make the page of the first run, with the agents of the others drawn translucent."""
    first, *others = runs
    phases = first.scenario.phases
    ghosts = [
        Ghost(run.name, colour, run.dataset, run.scenario.scene.height)
        for run, colour in zip(others, _COLOURS[1:], strict=False)
    ]
    sentences = [*record.notes]
    for run in record.runs[1:]:
        error, base = run.late.tracking_error, record.runs[0].late.tracking_error
        if error is not None and base is not None:
            sentences.append(
                f"{run.name}: tracking error {error:.3g} m RMS over agents and the second half, against {base:.3g} m "
                f"of {first.name}"
            )
    again = "mjsheaf compare-runs " + " ".join(run.directory for run in record.runs), " in this directory"
    bounds = bounds_of_phases(phases, first.dataset)
    notes = [*sentences, *first.summary.get("notes", [])]
    shown = f"run {first.name}; translucent: {', '.join(run.name for run in others)}"
    scenario = first.scenario.model_copy(update={"summary": shown})
    return page_of(scenario, phases, first.dataset, first.summary, bounds, notes=notes, ghosts=ghosts, again=again)


def publish_runs(
    directories: Sequence[Path],
    out: Path | None,
    figures: FigureOptions = AS_USUAL,
    progress: Report = no_progress,
) -> tuple[RunsRecord, Path, str | None]:
    """Compare finished runs and write runs.json, runs.csv, errors.png and report.html.

    Args:
        directories: Directories of the runs; the others are compared with the first.
        out: Directory of the results; runs/SCENARIO-runs if None.
        figures: Formats and style of the plots.
        progress: See `Report`.

    Returns:
        The contents of runs.json, the directory, and a sentence about an earlier comparison that was replaced, if any.

    Raises:
        InputError: Runs cannot be compared: see `open_runs`.
        PlaceError: The directory may not be replaced or cannot be written, or is that of one of the runs.
    """
    with open_runs(directories) as runs:
        place = Path("runs") / f"{runs[0].scenario.name}-runs" if out is None else out
        if place.resolve() in [run.directory.resolve() for run in runs]:
            raise PlaceError(f"{place}: is the directory of one of the runs; choose another with --out")
        replaced = replaced_run(place)
        with staging(place) as fresh:
            progress("comparing", 0, 1)
            record = compare_runs(runs, place)
            progress("plotting", 0, 1)
            plot_runs(runs, fresh / "errors", figures)
            table_of(record).to_csv(fresh / "runs.csv", index=False, lineterminator="\n")
            progress("writing the page", 0, 1)
            (fresh / "report.html").write_bytes(page_of_runs(runs, record))
            save_summary(record.model_dump(mode="json"), fresh / "runs.json")
            progress("writing the page", 1, 1)
    return record, place, replaced
