"""One run as a directory: its data, plots, video and summary, and the resolved scenario, which reproduces it.

In Python, `plot` and `replay` show a run without writing anything.
"""

import base64
import html
import io
import shlex
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from mjsheaf.arguments import require_path, require_type
from mjsheaf.arrays import Array
from mjsheaf.compile.jit import working_time
from mjsheaf.errors import InputError, MjsheafError, PlaceError
from mjsheaf.export import require_installed, sinks_of
from mjsheaf.files import SUFFIXES, dump_yaml, naming, write_whole
from mjsheaf.loop.session import moved_by, require_simulable
from mjsheaf.results import check_expectation, open_dataset, store, summarize, thinned
from mjsheaf.results.dataset import fault_of
from mjsheaf.results.metrics import communication, delivery_of, engine_of, safety_of, summarize_phases
from mjsheaf.results.netcdf import split, write_and_open
from mjsheaf.runs.simulate import Progress, no_progress, stream
from mjsheaf.runs.timings import Timings, join_timings
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import same_law
from mjsheaf.section import LARGEST
from mjsheaf.show.style import AS_USUAL, MATPLOTLIB, VIEW, FigureOptions
from mjsheaf.video import VideoOptions, available_backend

_TERMS = "terms"  # folder of the files of registered terms, next to those of vehicles
_FLOWS = "flows"  # folder of the files of gridded flow
_HEIGHT = 640  # px of a replay in a notebook
_INSTEAD = "a Dataset as `simulate` returns it, or the directory of a run"

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mjsheaf.checking.theorem.of_run import HeldBound, RunBound
    from mjsheaf.law.in_python import Controller
    from mjsheaf.system import Phase, System


def dump_scenario(scenario: Scenario) -> str:
    """Return the resolved scenario as YAML, with every field that has a value; running it again gives the same bits.

    Custom vehicles keep their paths; `write_scenario` copies their files too.
    """
    return dump_yaml(_resolved(scenario))


def write_scenario(scenario: Scenario, directory: Path) -> Path:
    """Write scenario.yaml, and copy the files of custom vehicles, registered terms and gridded flow into vehicles/.

    scenario.yaml refers to the copies, so the directory can be moved, and repeated to the same bits even if the
    originals change. Checksums of the copies later reveal files that a user has added or changed.

    Returns:
        The path of scenario.yaml.

    Raises:
        InputError: A vehicle's files cannot be found, or lie outside its directory.
        OSError: The directory cannot be written.
    """
    raw = _resolved(scenario)
    places = [
        *((holder, "vehicle") for holder in [*raw["agents"], *raw["targets"]]),
        *((raw.get("vehicles", {}), key) for key in ("agents", "targets")),
    ]
    copies: dict[str, str] = {}
    for holder, key in places:
        name = holder.get(key)
        if name is None or Path(name).suffix not in SUFFIXES:
            continue
        if name not in copies:
            taken = {store.CHECKSUMS, _TERMS, _FLOWS, *(Path(copy).parts[1] for copy in copies.values())}
            copies[name] = _copy(Path(name), directory, taken)
        holder[key] = copies[name]
    copies |= _copy_files(raw["controller"].get("custom", {}), "file", _TERMS, directory)
    copies |= _copy_files(raw["flow"], "path", _FLOWS, directory)
    if copies:
        store.write_checksums(directory / store.VEHICLES)
    path = directory / "scenario.yaml"
    path.write_text(dump_yaml(raw), encoding="utf-8")
    return path


def _copy_files(sections: dict[str, Any], field: str, folder: str, directory: Path) -> dict[str, str]:
    """Copy the files that a field of sections refers to, make the field refer to the copies, and return them.

    The result maps the original names to the copies.
    """
    copies: dict[str, str] = {}
    for name, section in sections.items():
        file = section.get(field)
        if file is None:
            continue
        if file not in copies:
            copies[file] = f"{store.VEHICLES}/{folder}/{name}{Path(file).suffix}"
            (directory / copies[file]).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, directory / copies[file])
            if section.get("sha256", "") not in ("", store.digest(directory / copies[file])):
                raise InputError(f"flow.{name}.path: {file} has changed since the run read it; run again")
        section[field] = copies[file]
    return copies


def _copy(description: Path, directory: Path, taken: set[str]) -> str:
    """Copy the files of a vehicle into a folder of its own, and return the relative path of its description."""
    from mjsheaf.vehicles.loading import files_of, read_description

    names = chain([description.stem], (f"{description.stem}_{k}" for k in count(2)))
    folder = next(name for name in names if name not in taken)
    root = description.parent.resolve()
    files = files_of(description, read_description(description).mjcf)
    home = directory / store.VEHICLES / folder
    for file in files:
        copy = home / file.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    home.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(description, home / description.name)
    return f"{store.VEHICLES}/{folder}/{description.name}"


def _resolved(scenario: Scenario) -> dict[str, Any]:
    return scenario.model_dump(mode="json", exclude_none=True)


@dataclass(frozen=True)
class Outcome:
    """A published run.

    Attributes:
        directory: Directory of the run.
        summary: Contents of summary.json, including the notes on the run.
        notes: Further notes.
        replaced: Sentence about the earlier run that it replaced; None if there was none.
    """

    directory: Path
    summary: dict[str, Any]
    notes: list[str]
    replaced: str | None = None


class TimedIterator:
    """Iterator that measures the `seconds` spent in `next`, excluding compilation."""

    def __init__(self, pieces: Iterator[xr.Dataset]) -> None:
        self._pieces = pieces
        self.seconds = 0.0

    def __iter__(self) -> Iterator[xr.Dataset]:
        return self

    def __next__(self) -> xr.Dataset:
        begun = working_time()
        try:
            return next(self._pieces)
        finally:
            self.seconds += working_time() - begun


def execute(
    scenario: Scenario,
    backend: str,
    directory: Path,
    *,
    video: VideoOptions | None,
    engine: str = "mujoco",
    threads: int | None = None,
    allow_drift: bool = False,
    controller: "Controller | None" = None,
    origin: str | None = None,
    figures: FigureOptions = AS_USUAL,
    exports: Sequence[str] = (),
    progress: Progress = no_progress,
    timings: Timings | None = None,
) -> Outcome:
    """Run a scenario (see `simulate`) and publish its directory (see `publish`).

    A run that blows up is published too, with status 'unstable'.

    Raises:
        InputError: The backend is unknown, or the scenario cannot be simulated. Nothing is written.
        PlaceError: The directory may not be replaced or cannot be written.
        NotUniqueError: The harmonic extension is not unique and drift is not allowed. Nothing is written.
    """
    timings = timings or Timings()
    require_installed(exports)
    with timings.part("checks"):
        phases = moved_by(scenario.phases, backend, engine, threads)
        require_simulable(phases, backend, allow_drift=allow_drift)
    simulating = partial(progress, "simulating")
    pieces = TimedIterator(stream(phases, backend, scenario.seed, simulating, controller=controller))
    shown: Any = {"video": video, "figures": figures, "exports": exports, "progress": progress}
    return publish(pieces, scenario, phases, directory, origin=origin, timings=timings, **shown)


def publish(
    run: xr.Dataset | Iterable[xr.Dataset],
    scenario: Scenario,
    simulated: "System | Sequence[Phase]",
    directory: Path,
    *,
    video: VideoOptions | None = None,
    origin: str | None = None,
    figures: FigureOptions = AS_USUAL,
    exports: Sequence[str] = (),
    progress: Progress = no_progress,
    timings: Timings | None = None,
) -> Outcome:
    """Write the directory of a run atomically, and then draw its video into it.

    Data, plots and page are published first, because the video takes longest: see `add_video`.

    Args:
        run: Data of the run, whole from `simulate` or in consecutive pieces from `stream`; result.nc is the same. A
            `TimedIterator` provides the duration of the simulation, which is null in summary.json otherwise.
        scenario: Scenario that was run.
        simulated: System of the scenario, or its phases.
        directory: Directory of the results.
        video: Options of the video, or None for no video.
        origin: Origin of the scenario from `scenario.load.origin`, recorded in summary.json.
        figures: Formats and style of the plots.
        exports: Further formats of the data, keys of `mjsheaf.export.FORMATS`.
        progress: Callback, called with the name of the activity, the steps done and the number of steps.
        timings: Durations of earlier parts of the command.

    Raises:
        PlaceError: The directory may not be replaced or cannot be written.
    """
    from mjsheaf.page import page_of
    from mjsheaf.system import phases_of

    timings = timings or Timings()
    phases = phases_of(simulated)
    replaced = store.replaced_run(directory)
    with store.staging(directory) as fresh, ExitStack() as held:
        write_scenario(scenario, fresh)
        dataset, seconds = _write_data(run, scenario, phases, fresh, exports, timings)
        held.enter_context(dataset)
        progress("comparing with theory", 0, 1)
        summary, bounds, drawn = account_of(scenario, phases, dataset, timings)
        with timings.part("plots"):
            shown = shown_bound(phases, drawn["time"].values, *bounds[0])
            _plot(phases, drawn, shown, fresh, progress, figures, scenario.video.eye)
        summary |= {"origin": origin, "wall_time_s": seconds, store.RESULT_DIGEST: store.digest(fresh / "result.nc")}
        summary["realtime_factor"] = float(drawn["time"][-1] - drawn["time"][0]) / seconds if seconds else None
        progress("writing the page", 0, 1)
        with timings.part("page"):
            page = fresh / "report.html"
            page.write_bytes(page_of(scenario, phases, dataset, summary, bounds, notes=summary["notes"]))
        progress("publishing", 0, 1)  # the user can interrupt up to here
        summary["timings"] = timings.record()
        store.save_summary(summary, fresh / "summary.json")
    outcome = Outcome(directory, summary, [], replaced)
    return outcome if video is None else add_video(outcome, scenario, video, progress)


def _write_data(
    run: xr.Dataset | Iterable[xr.Dataset],
    scenario: Scenario,
    phases: "Sequence[Phase]",
    directory: Path,
    exports: Sequence[str],
    timings: Timings,
) -> tuple[xr.Dataset, float | None]:
    """Write result.nc and the exports; return the data and the duration of the simulation, s, None if unknown."""
    from mjsheaf.loop.log import samples_in_piece

    pieces = split(run, samples_in_piece(phases[0].system)) if isinstance(run, xr.Dataset) else run
    sinks = sinks_of(exports, directory, scenario, phases)
    with timings.part("data"):
        dataset = write_and_open(pieces, directory / "result.nc", *sinks)
    if not isinstance(run, TimedIterator):
        return dataset, None
    timings.add("simulation", run.seconds)
    timings.add("data", -run.seconds)
    return dataset, run.seconds


def add_video(outcome: Outcome, scenario: Scenario, options: VideoOptions, progress: Progress = no_progress) -> Outcome:
    """Draw the video of a published run into its directory.

    The video appears when it is complete, and summary.json then names it. Until then, and after an interruption,
    the directory is a complete run without a video, which `mjsheaf video DIR` draws.

    Args:
        outcome: Result of `publish` or `execute` without a video.
        scenario: Scenario that was run.
        options: Options of the video.
        progress: Callback, called with the name of the activity, the steps done and the number of steps.

    Returns:
        The outcome with the video, or with a note that explains why there is none.

    Raises:
        PlaceError: The video cannot be written.
    """
    from mjsheaf.video.draw import UnwritableError
    from mjsheaf.video.film import film_run

    directory = outcome.directory
    path = directory / "video.mp4"
    drawing = partial(progress, "drawing video")
    timings = Timings()
    with open_dataset(directory / "result.nc") as dataset, timings.part("video"):
        try:
            frames, reason = draw_video(partial(film_run, scenario, dataset, path, options, drawing))
        except UnwritableError as error:
            raise PlaceError(f"{error}; {without_video(directory)}") from error
    if reason:
        return replace(outcome, notes=[*outcome.notes, reason])
    summary = {**outcome.summary, "video": video_entry(frames, options)}
    summary["timings"] = join_timings(outcome.summary["timings"], timings.record())
    store.save_summary(summary, directory / "summary.json")
    return replace(outcome, summary=summary)


def without_video(directory: Path) -> str:
    """Return a sentence about a run without a video, and the command that draws it."""
    return f"{directory} is complete except for its video, which `mjsheaf video {shlex.quote(str(directory))}` draws"


class Account(NamedTuple):
    """Contents of a run's report.

    Attributes:
        summary: Contents of summary.json, without the fields about its directory.
        bounds: Bounds of Theorem 1 and of the held law in each phase.
        drawn: Samples for the plots in memory, at most a few thousand.
    """

    summary: dict[str, Any]
    bounds: "list[tuple[RunBound, HeldBound]]"
    drawn: xr.Dataset


def account_of(
    scenario: Scenario, phases: "Sequence[Phase]", dataset: xr.Dataset, timings: Timings | None = None
) -> Account:
    """Compute the errors, bounds and notes of a run from its data, in memory or in an open file."""
    from mjsheaf.checking.separation import too_close_in
    from mjsheaf.checking.theorem.of_run import bounds_of_phases
    from mjsheaf.runs.diagnostics import examine_terms, notes_of_run
    from mjsheaf.scenario.slips import slips_of

    timings = timings or Timings()
    own, drawn = summarize_phases(phases[0].system.team, dataset), thinned(dataset)
    with timings.part("bounds"):
        bounds = bounds_of_phases(phases, dataset)
    for phase, bound in zip(own, bounds, strict=False):
        phase |= _bounds_summary(*bound)
    with timings.part("notes"):
        summary = _summary_of(scenario, phases, dataset.sizes["time"] - 1, drawn, own, *bounds[0])
        summary["safety"] = safety = safety_of(dataset)
        if safety and (safety["smallest_separation"] or 0.0) < 0.0:
            moment = dataset.isel(time=[int(np.nanargmin(dataset["separation"].values))])
            closest = next(iter(too_close_in(phases[0].system, moment).values()), None)
            safety["closest"] = closest and closest.model_dump(mode="json", include={"pair", "time", "gap"})
        summary["expect"] = _expectation(scenario, dataset.attrs, summary["final"], own, safety)
        terms = examine_terms(phases, dataset)
        if terms is not None:
            summary["terms"] = terms.record()
        limits = [one for bound in bounds for one in bound]
        found = notes_of_run(phases, dataset, summary["ending"], limits, terms, slips_of(scenario))
    summary["notes"] = [note.record() for note in found]
    return Account(summary, bounds, drawn)


def save(
    result: xr.Dataset,
    directory: str | Path,
    *,
    video: bool = True,
    formats: Sequence[str] = ("png",),
    title: bool = True,
    progress: bool | None = True,
) -> Outcome:
    """Write the files of `mjsheaf run` from a result in memory: data, plots, page, video, summary and scenario.

    Args:
        result: Result of `simulate` on either backend, with or without a law in Python.
        directory: Directory to write atomically. A directory that mjsheaf did not write is not replaced.
        video: True to draw the video.
        formats: Formats of the plots: png, svg, pdf.
        title: True for plots with a title.
        progress: True shows a bar on a terminal or in a notebook; False and None show nothing.

    Raises:
        InputError: The result is not from `simulate`, or other functions have removed its scenario.
        PlaceError: The directory may not be replaced or cannot be written.
    """
    from mjsheaf.progress import shown
    from mjsheaf.video.film import video_options

    require_type("result", result, xr.Dataset, "a Dataset, as mjsheaf.simulate returns it")
    require_path("directory", directory)
    require_type("formats", formats, (list, tuple), "a list of formats, such as ['png', 'pdf']")
    scenario = scenario_of(result, "save")
    options = video_options(scenario) if video else None
    figures = FigureOptions(tuple(formats), title)
    with shown(progress, "saving") as bar:
        given: Any = {"video": options, "figures": figures, "progress": bar or no_progress}
        return publish(result, scenario, scenario.phases, Path(directory), **given)


def scenario_of(result: xr.Dataset, doing: str) -> Scenario:
    """Return the scenario of a result of `simulate`; `doing` names the function in errors.

    Raises:
        InputError: The result lacks its scenario, or a part of its data.
    """
    scenario = result.encoding.get("scenario")
    if not isinstance(scenario, Scenario):
        raise InputError(f"{doing}: the result has no scenario; expected a Dataset as `simulate` returns it")
    wrong = fault_of(result) or _unlike(result, scenario)
    if wrong:
        raise InputError(f"{doing}: the result {wrong}; expected a Dataset as `simulate` returns it")
    return scenario


def _unlike(result: xr.Dataset, scenario: Scenario) -> str:
    """Describe how the members of a result differ from its scenario's; empty if they do not."""
    team = scenario.system.team
    for kind, ids in (("agent", team.agent_ids), ("target", team.target_ids)):
        if result[kind].values.tolist() != ids:
            return f"has other {kind}s than its scenario"
    return ""


def _summary_of(
    scenario: Scenario,
    phases: "Sequence[Phase]",
    periods: int,
    drawn: xr.Dataset,
    own: list[dict[str, Any]],
    theorem: "RunBound",
    of_law: "HeldBound",
) -> dict[str, Any]:
    """Return the fields of summary.json in order for a run of `periods` sample periods; None where data are missing."""
    from mjsheaf.results.ending import ending_of_run

    backend, status, controller = drawn.attrs["backend"], drawn.attrs["status"], drawn.attrs.get("controller")
    system = phases[0].system
    final = summarize(system.team, drawn)
    free = dict.fromkeys(words for phase in phases for words in phase.system.free_directions)
    return {
        "scenario": scenario.name,
        "origin": None,
        "backend": backend,
        "engine": engine_of(drawn),
        "status": status,
        "message": drawn.attrs["message"],
        "ending": ending_of_run(phases, drawn) if status == "finished" else None,
        "controller": controller,
        "law": drawn.attrs.get("law"),
        "seed": scenario.seed,
        "steps": periods * (round(system.grid.period / system.bodies.timestep) if backend == "physics" else 1),
        "wall_time_s": None,
        "realtime_factor": None,
        "expect": {},
        "final": final,
        "phases": own,
        "communication": communication(drawn, periods + 1, system.grid.period),
        "delivery": delivery_of(drawn),
        "free_directions": list(free),
        **_bounds_summary(theorem, of_law),
        "safety": None,
        "terms": None,
        "notes": [],
        "video": None,
        "timings": {},
        store.RESULT_DIGEST: "",
    }


def _expectation(
    scenario: Scenario,
    attrs: dict[str, Any],
    final: dict[str, Any],
    own: list[dict[str, Any]],
    safety: dict[str, Any] | None,
) -> dict[str, Any]:
    """Compare errors with the scenario's expectations; bounds for another law are not checked."""
    expected = scenario.expect.controller
    if expected is not None and not same_law(expected, attrs.get("controller")):
        return {"met": None, "checks": [], "reason": f"the bounds are for the law {expected}"}
    return check_expectation(scenario.expect, attrs["backend"], attrs["status"], final, own, safety)


def _bounds_summary(theorem: "RunBound", of_law: "HeldBound") -> dict[str, Any]:
    """Return the fields of summary.json on the bounds of a run, or of one of its phases."""
    return {
        "theorem": {
            "applies": theorem.applies,
            "approximate": theorem.approximate,
            "reason": theorem.reason,
            "measured_over_bound": theorem.ratio,
            "measured_over_bound_settled": theorem.settled_ratio,
            "wrong": theorem.wrong,
        },
        "held_law": {
            "bounded": of_law.samples is not None,
            "reason": of_law.reason,
            "measured_over_bound": of_law.ratio,
            "measured_over_bound_settled": of_law.settled_ratio,
            "wrong": of_law.wrong,
        },
    }


def shown_bound(
    phases: "Sequence[Phase]", time: Array, theorem: "RunBound", of_law: "HeldBound"
) -> tuple[str, Array] | None:
    """Return the name and values of the bound on |e| to draw at times, s; None if there is no bound.

    It is the bound of the first phase, and NaN after the first event.
    """
    grid, end = phases[0].system.grid, phases[1].time if len(phases) > 1 else np.inf
    if theorem.applies and (bound := theorem.at(time)).max() < LARGEST:  # a blow-up satisfies any larger bound
        return "Theorem 1" + ", approximate" * theorem.approximate, np.where(time < end, bound, np.nan)
    if of_law.samples is None:
        return None
    held = np.interp(time, grid.span(0, len(of_law.samples)), of_law.samples)
    return "bound of the held law", np.where(time < end, held, np.nan)


def plot_again(
    directory: Path, folder: Path, figures: FigureOptions = AS_USUAL, progress: Progress = no_progress
) -> list[Path]:
    """Draw the plots of a finished run from its directory alone, into a folder that may be the same.

    Returns:
        Paths of the files, each written atomically.

    Raises:
        InputError: The directory holds no run, or one that does not match its scenario; or a file cannot be written.
    """
    from mjsheaf.checking.theorem.of_run import bounds_of_phases

    with store.reopen_run(directory) as (scenario, dataset, _), TemporaryDirectory() as drawing:
        phases, drawn = scenario.phases, thinned(dataset)
        bound = shown_bound(phases, drawn["time"].values, *bounds_of_phases(phases, dataset)[0])
        _plot(phases, drawn, bound, Path(drawing), progress, figures, scenario.video.eye)
        found = [folder / file.name for file in sorted(Path(drawing).iterdir())]
        with naming(folder):
            folder.mkdir(parents=True, exist_ok=True)
        for path in found:
            with naming(path):
                write_whole(path, (Path(drawing) / path.name).read_bytes())
    return found


def _plot(
    phases: "Sequence[Phase]",
    drawn: xr.Dataset,
    bound: tuple[str, Array] | None,
    folder: Path,
    progress: Progress,
    figures: FigureOptions,
    view: tuple[float, float] = VIEW,
) -> None:
    """Draw the plots of a run; `view` is the azimuth and elevation of the eye in degrees."""
    from mjsheaf.show.panels import save_figure
    from mjsheaf.show.plots import figures_of

    first, last = phases[0].system, phases[-1].system
    plots = figures_of(first.team, last.team, drawn, bound, figures, view, first.obstacles)
    for done, (name, draw) in enumerate(plots.items()):
        progress("plotting", done, len(plots))
        with MATPLOTLIB:
            save_figure(draw(), folder / name, figures)
    progress("plotting", len(plots), len(plots))


def video_entry(frames: int, options: VideoOptions) -> dict[str, Any]:
    """Return the fields of summary.json on a video."""
    return {"frames": frames, "width": options.width, "height": options.height, "fps": options.fps}


def draw_video(film: Callable[[], int]) -> tuple[int, str]:
    """Draw a video, or explain why there is none; a machine without OpenGL still writes the data.

    Returns:
        The number of frames that the callback `film` draws and returns, and ''; or 0 and the reason.

    Raises:
        UnwritableError: The file cannot be written.
    """
    backend, reason = available_backend()
    if backend is None:
        return 0, f"no video: {reason}"
    from mjsheaf.video.draw import UnwritableError

    try:
        return film(), ""
    except UnwritableError:
        raise
    except MjsheafError as error:
        return 0, f"no video: {error}"


# -- in Python and notebooks -------------------------------------------------------------------------------------------


class Figures(dict[str, "Figure"]):
    """Matplotlib figures of a run by name. A notebook shows them below one another."""

    def _repr_html_(self) -> str:
        from mjsheaf.show.panels import write_figure

        pictures = []
        for name, figure in self.items():
            file = io.BytesIO()
            write_figure(figure, file, "png")
            data = base64.b64encode(file.getvalue()).decode("ascii")
            pictures.append(f'<img alt="{html.escape(name)}" src="data:image/png;base64,{data}">')
        return "<br>".join(pictures)


@dataclass(frozen=True)
class ReplayPage:
    """The page of a run, which a notebook shows in a frame. It needs no network.

    Attributes:
        html: The page, as in report.html.
        height: Height of the frame in a notebook, px.
    """

    html: str = field(repr=False)
    height: int = _HEIGHT

    def save(self, path: str | Path) -> Path:
        """Write the page to a file, whole or not at all, and return its path.

        Raises:
            InputError: The file cannot be written.
        """
        place = Path(path)
        with naming(place):
            write_whole(place, self.html.encode("utf-8"))
        return place

    def _repr_html_(self) -> str:
        page = html.escape(self.html, quote=True)
        style = f"width: 100%; height: {self.height}px; border: 1px solid #d0d7de"
        return f'<iframe title="replay" sandbox="allow-scripts" style="{style}" srcdoc="{page}"></iframe>'


def plot(result: xr.Dataset | str | Path, *, title: bool = True) -> Figures:
    """Draw the figures that `mjsheaf run` writes: errors over time, trajectories, first and last configuration.

    The figures belong to the caller. They are not registered with pyplot, whose settings do not change.

    Args:
        result: A Dataset from `simulate`, or the directory of a finished run.
        title: True gives each figure a title; figures in a paper have captions instead.

    Returns:
        Matplotlib figures by name: `errors`, `trajectories` and `configurations`.

    Raises:
        InputError: The result is not from `simulate`, other functions have removed its scenario, or the directory holds
            no run.
    """
    from mjsheaf.checking.theorem.of_run import bounds_of_phases
    from mjsheaf.show.plots import figures_of

    with _opened(result, "plot") as (scenario, dataset, _):
        phases = scenario.phases
        drawn = thinned(dataset)
        bound = shown_bound(phases, drawn["time"].values, *bounds_of_phases(phases, dataset)[0])
    first, last = phases[0].system, phases[-1].system
    with MATPLOTLIB:
        draw = figures_of(
            first.team, last.team, drawn, bound, FigureOptions(title=title), scenario.video.eye, first.obstacles
        )
        return Figures((name, make()) for name, make in draw.items())


def replay(result: xr.Dataset | str | Path, *, height: int = _HEIGHT) -> ReplayPage:
    """Make the page that replays a run in three dimensions next to its curves, for a notebook or a file.

    Args:
        result: A Dataset from `simulate`, or the directory of a finished run.
        height: Height of the frame in a notebook, px.

    Returns:
        The page, with `save(path)` for a file that any browser opens.

    Raises:
        InputError: See `plot`; or the directory holds a run of an earlier version that recorded fewer variables.
    """
    from mjsheaf.checking.theorem.of_run import bounds_of_phases
    from mjsheaf.page import page_of, require_shown

    again = None
    with _opened(result, "replay") as (scenario, dataset, summary):
        require_shown(dataset, "replay: the result")
        phases = scenario.phases
        if summary is None:
            account = account_of(scenario, phases, dataset)
            summary = account.summary
            bounds = account.bounds
            again = f"mjsheaf.simulate(scenario, backend={dataset.attrs['backend']!r})", " in Python"
        else:
            bounds = bounds_of_phases(phases, dataset)
        page = page_of(scenario, phases, dataset, summary, bounds, notes=summary.get("notes", ()), again=again)
    return ReplayPage(page.decode("utf-8"), height)


@contextmanager
def _opened(
    result: xr.Dataset | str | Path, doing: str
) -> Iterator[tuple[Scenario, xr.Dataset, dict[str, Any] | None]]:
    """Yield the scenario and data of a run and, for a directory, its summary.json.

    Raises:
        InputError: There is no run.
    """
    if isinstance(result, xr.Dataset):
        yield scenario_of(result, doing), result, None
    elif isinstance(result, str | Path):
        with store.reopen_run(Path(result)) as (scenario, dataset, summary):
            yield scenario, dataset, summary
    else:
        raise InputError(f"{doing}: result is a {type(result).__name__}; expected {_INSTEAD}")
