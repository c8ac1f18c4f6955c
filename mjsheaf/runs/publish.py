"""One run as a directory: its data, plots, video and summary, and the resolved scenario, which reproduces it.

In Python, `plot` and `replay` show a run without writing anything.
"""

import base64
import html
import os
import shlex
import shutil
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import chain, count
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from mjsheaf.arguments import require_type
from mjsheaf.checking.loop.body_loop import ending_of_run
from mjsheaf.checking.separation import too_close_in
from mjsheaf.checking.theorem.of_run import HeldBound, RunBound, bounds_of_phases
from mjsheaf.compile.jit import compilation_time, working_time
from mjsheaf.errors import InputError, MjsheafError, PlaceError
from mjsheaf.export import FORMATS, require_installed
from mjsheaf.files import SUFFIXES, digest, dump_yaml, naming, write_whole
from mjsheaf.law.in_python import Controller
from mjsheaf.loop.engine import samples_in_piece
from mjsheaf.loop.session import prepare_run
from mjsheaf.loop.system import Phase, System, phases_of
from mjsheaf.mujoco_import import mujoco
from mjsheaf.page.page import bound_curves, page_of
from mjsheaf.progress import Report, no_progress, shown
from mjsheaf.results import store
from mjsheaf.results.dataset import fault_of, in_pieces
from mjsheaf.results.metrics import (
    check_expectation,
    communication,
    delivery_of,
    engine_of,
    safety_of,
    summarize,
    summarize_phases,
)
from mjsheaf.runs.diagnostics import examine_terms, notes_of_run
from mjsheaf.runs.simulate import stream
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import map_vehicles, same_law
from mjsheaf.scenario.slips import slips_of
from mjsheaf.show.plots import draw_configurations, draw_errors, draw_trajectories, figure_bytes
from mjsheaf.show.style import AS_USUAL, MATPLOTLIB, FigureOptions
from mjsheaf.vehicles.loading import files_of, read_description
from mjsheaf.video.film import Film, VideoOptions, film_of, video_options

_HEIGHT = 640  # px of a replay in a notebook


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
    copies: dict[str, Path] = {}

    def copy(name: str) -> str:
        """Copy a file, with those that a vehicle's description names, and return the path of the copy."""
        source = Path(name)
        if name not in copies:
            taken = {store.CHECKSUMS, *(copied.parts[1] for copied in copies.values())}
            folder = next(f for f in chain([source.stem], (f"{source.stem}_{k}" for k in count(2))) if f not in taken)
            copies[name] = Path(store.VEHICLES, folder, source.name)
            files = files_of(source, read_description(source).mjcf) if source.suffix in SUFFIXES else []
            places = {file: file.relative_to(source.parent.resolve()) for file in files} | {source: source.name}
            for file, place in places.items():
                copied = directory / copies[name].parent / place
                copied.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, copied)
        return str(copies[name])

    raw = map_vehicles(scenario.model_dump(mode="json", exclude_none=True), copy)
    for name, section in raw["flow"].items():
        if section.get("sha256") and section["sha256"] != digest(directory / section["path"]):
            source = getattr(scenario.flow, name).path
            raise InputError(f"flow.{name}.path: {source} has changed since the run read it; run again")
    if copies:
        store.write_checksums(directory / store.VEHICLES)
    path = directory / "scenario.yaml"
    path.write_text(dump_yaml(raw), encoding="utf-8")
    return path


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


class Timings:
    """Durations of the parts of a run's publication; compilation is a separate part.

    Attributes:
        parts: Duration of each part, s.
    """

    def __init__(self) -> None:
        """Begin to measure."""
        self.parts: dict[str, float] = {}
        self._begun = perf_counter()
        self._compiled = compilation_time()

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Add the duration of the block to a part."""
        begun = working_time()
        try:
            yield
        finally:
            self.parts[name] = self.parts.get(name, 0.0) + working_time() - begun

    def simulating(self, pieces: Iterator[xr.Dataset]) -> Iterator[xr.Dataset]:
        """Yield the pieces of a run, and add the time that they take to the part `simulation`."""
        while True:
            with self.part("simulation"):
                piece = next(pieces, None)
            if piece is None:
                return
            yield piece

    def record(self, before: dict[str, float] | None = None) -> dict[str, float]:
        """Return the duration of each part, of compilation, and of everything until now, s, added to those `before`."""
        now = self.parts | {
            "compilation": compilation_time() - self._compiled,
            "total": perf_counter() - self._begun,
        }
        return {name: (before or {}).get(name, 0.0) + now.get(name, 0.0) for name in (before or {}) | now}


def show_live(pieces: Iterable[xr.Dataset], make_sink: Callable[[], store.Sink]) -> Generator[xr.Dataset]:
    """Yield the pieces of a run, each after a sink has shown it; the sink is made with the first piece."""
    with closing(make_sink()) as sink:
        for number, piece in enumerate(pieces):
            if number == 0:
                sink.open(piece.variables, piece.attrs)
            sink.write(piece)
            yield piece


def execute(
    scenario: Scenario,
    backend: str,
    directory: Path,
    *,
    video: VideoOptions | None,
    engine: str = "mujoco",
    threads: int | None = None,
    allow_drift: bool = False,
    controller: Controller | None = None,
    origin: str | None = None,
    figures: FigureOptions = AS_USUAL,
    exports: Sequence[str] = (),
    progress: Report = no_progress,
) -> Outcome:
    """Run a scenario (see `simulate`) and publish its directory (see `publish`).

    A run that blows up is published too, with status 'unstable'. With 'live' among the exports it is also shown during
    the simulation, in short pieces, so that a slow run moves smoothly.

    Raises:
        InputError: The backend is unknown, or the scenario cannot be simulated. Nothing is written.
        PlaceError: The directory may not be replaced or cannot be written.
        NotUniqueError: The harmonic extension is not unique and drift is not allowed. Nothing is written.
    """
    timings = Timings()
    kinds = dict(zip(exports, require_installed(exports), strict=True))
    with timings.part("checks"):
        phases = prepare_run(scenario, backend, engine, threads, allow_drift=allow_drift)
    # A run that is shown live comes in pieces of 0.1 s, which are joined before they are written.
    short = max(1, round(0.1 / phases[0].system.grid.period)) if "live" in exports else None
    pieces = timings.simulating(
        stream(phases, backend, scenario.seed, partial(progress, "simulating"), short, controller=controller)
    )
    with ExitStack() as held:
        if "live" in exports:
            nothing = Path(os.devnull)
            seen = show_live(pieces, partial(kinds["live"], nothing, scenario, phases, nothing))
            held.enter_context(closing(seen))  # also if files cannot be written
            pieces = in_pieces(seen, samples_in_piece(phases[0].system))
        return publish(
            pieces, scenario, phases, directory, video=video, origin=origin, figures=figures,
            exports=[name for name in exports if name != "live"], progress=progress, timings=timings,
        )  # fmt: skip


def publish(
    run: xr.Dataset | Iterable[xr.Dataset],
    scenario: Scenario,
    simulated: System | Sequence[Phase],
    directory: Path,
    *,
    video: VideoOptions | None = None,
    origin: str | None = None,
    figures: FigureOptions = AS_USUAL,
    exports: Sequence[str] = (),
    progress: Report = no_progress,
    timings: Timings | None = None,
) -> Outcome:
    """Write the directory of a run atomically, and then draw its video into it.

    Data, plots and page are published first, because the video takes longest: see `add_video`.

    Args:
        run: Data of the run, whole from `simulate` or in consecutive pieces from `stream`; result.nc is the same.
        scenario: Scenario that was run.
        simulated: System of the scenario, or its phases.
        directory: Directory of the results.
        video: Options of the video, or None for no video.
        origin: Origin of the scenario from `scenario.load.origin`, recorded in summary.json.
        figures: Formats and style of the plots.
        exports: Further formats of the data, keys of `mjsheaf.export.FORMATS`.
        progress: Callback, called with the name of the activity, the steps done and the number of steps.
        timings: Durations of earlier parts of the command, and of the simulation, which is null in summary.json
            otherwise.

    Raises:
        PlaceError: The directory may not be replaced or cannot be written.
    """
    timings = timings or Timings()
    phases = phases_of(simulated)
    replaced = store.replaced_run(directory)
    with store.staging(directory) as fresh, ExitStack() as held:
        source = write_scenario(scenario, fresh)
        pieces = store.split(run, samples_in_piece(phases[0].system)) if isinstance(run, xr.Dataset) else run
        kinds = zip(exports, require_installed(exports), strict=True)
        sinks = [kind(fresh / FORMATS[name], scenario, phases, source) for name, kind in kinds]
        with timings.part("data"):
            dataset = held.enter_context(store.write_and_open(pieces, fresh / "result.nc", *sinks))
        seconds = timings.parts.get("simulation")
        timings.parts["data"] -= seconds or 0.0
        progress("comparing with theory", 0, 1)
        summary, bounds, drawn = account_of(scenario, phases, dataset, timings)
        with timings.part("plots"):
            for name, data in _plots_of(scenario, phases, drawn, bounds, figures, progress).items():
                (fresh / name).write_bytes(data)
        summary |= {"origin": origin, "wall_time_s": seconds, store.RESULT_DIGEST: digest(fresh / "result.nc")}
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


def add_video(outcome: Outcome, scenario: Scenario, options: VideoOptions, progress: Report = no_progress) -> Outcome:
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
    directory = outcome.directory
    timings = Timings()
    with store.open_dataset(directory / "result.nc") as dataset, timings.part("video"):
        frames, reason = draw_video(
            lambda: [film_of(scenario, dataset)],
            directory / "video.mp4",
            options,
            progress,
            without_video(directory),
        )
    if reason:
        return replace(outcome, notes=[*outcome.notes, reason])
    summary = {**outcome.summary, "video": video_entry(frames, options)}
    summary["timings"] = timings.record(outcome.summary["timings"])
    store.save_summary(summary, directory / "summary.json")
    return replace(outcome, summary=summary)


def without_video(directory: Path) -> str:
    """Return a sentence about a run without a video, and the command that draws it."""
    return f"{directory} is complete except for its video, which `mjsheaf video {shlex.quote(str(directory))}` draws"


def account_of(
    scenario: Scenario, phases: Sequence[Phase], dataset: xr.Dataset, timings: Timings | None = None
) -> tuple[dict[str, Any], list[tuple[RunBound, HeldBound]], xr.Dataset]:
    """Compute the errors, bounds and notes of a run from its data, in memory or in an open file.

    Returns:
        The contents of summary.json, where fields that are not known from the data are None; the bounds of Theorem 1
        and of the held law in each phase; and the samples for the plots in memory, at most a few thousand.
    """
    timings = timings or Timings()
    system = phases[0].system
    own = summarize_phases(system.team, dataset)
    drawn = store.thinned(dataset)
    attrs = dataset.attrs
    steps = dataset.sizes["time"] - 1
    grid = system.grid
    controller = attrs.get("controller")
    bodies = attrs["backend"] == "physics"
    with timings.part("bounds"):
        bounds = bounds_of_phases(phases, dataset)
    for phase, bound in zip(own, bounds, strict=False):
        phase |= _bounds_summary(*bound)
    with timings.part("notes"):
        final = summarize(system.team, drawn)
        safety = safety_of(dataset)
        terms = examine_terms(phases, dataset)
        if safety and (safety["smallest_separation"] or 0.0) < 0.0:
            moment = dataset.isel(time=[int(np.nanargmin(dataset["separation"].values))])
            closest = next(iter(too_close_in(system, moment).values()), None)
            safety["closest"] = closest and closest.model_dump(mode="json", include={"pair", "time", "gap"})
        if scenario.expect.controller is None or same_law(scenario.expect.controller, controller):
            expected = check_expectation(scenario.expect, attrs["backend"], attrs["status"], final, own, safety)
        else:
            reason = f"the bounds are for the law {scenario.expect.controller}"
            expected = {"met": None, "checks": [], "reason": reason}
        ending = ending_of_run(phases, drawn) if attrs["status"] == "finished" else None
        limits = [one for bound in bounds for one in bound]
        notes = notes_of_run(phases, dataset, ending, limits, terms, slips_of(scenario))
    summary = {
        "scenario": scenario.name,
        "origin": None,
        "backend": attrs["backend"],
        "engine": engine_of(drawn),
        "status": attrs["status"],
        "message": attrs["message"],
        "ending": ending,
        "controller": controller,
        "law": attrs.get("law"),
        "seed": scenario.seed,
        "steps": steps * (round(grid.period / system.bodies.timestep) if bodies else 1),
        "wall_time_s": None,
        "realtime_factor": None,
        "expect": expected,
        "final": final,
        "phases": own,
        "communication": communication(drawn, steps + 1, grid.period),
        "delivery": delivery_of(drawn),
        "free_directions": list(dict.fromkeys(words for phase in phases for words in phase.system.free_directions)),
        **_bounds_summary(*bounds[0]),
        "safety": safety,
        "terms": terms,
        "notes": [asdict(note) for note in notes],
        "video": None,
        "timings": {},
        store.RESULT_DIGEST: "",
    }
    return summary, bounds, drawn


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
    require_type("result", result, xr.Dataset, "a Dataset, as mjsheaf.simulate returns it")
    require_type("directory", directory, (str, Path), "a path, as text or a Path")
    require_type("formats", formats, (list, tuple), "a list of formats, such as ['png', 'pdf']")
    scenario = scenario_of(result, "save")
    options = video_options(scenario) if video else None
    figures = FigureOptions(tuple(formats), title)
    with shown(progress, "saving") as bar:
        return publish(
            result, scenario, scenario.phases, Path(directory), video=options, figures=figures,
            progress=bar or no_progress,
        )  # fmt: skip


def scenario_of(result: xr.Dataset, doing: str) -> Scenario:
    """Return the scenario of a result of `simulate`; `doing` names the function in errors.

    Raises:
        InputError: The result lacks its scenario, or a part of its data.
    """
    scenario = result.encoding.get("scenario")
    if not isinstance(scenario, Scenario):
        raise InputError(f"{doing}: the result has no scenario; expected a Dataset as `simulate` returns it")
    wrong = fault_of(result)
    team = scenario.system.team
    for kind, ids in (("agent", team.agent_ids), ("target", team.target_ids)):
        if not wrong and result[kind].values.tolist() != ids:
            wrong = f"has other {kind}s than its scenario"
    if wrong:
        raise InputError(f"{doing}: the result {wrong}; expected a Dataset as `simulate` returns it")
    return scenario


def _bounds_summary(theorem: RunBound, of_law: HeldBound) -> dict[str, Any]:
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


def plot_again(
    directory: Path, folder: Path, figures: FigureOptions = AS_USUAL, progress: Report = no_progress
) -> list[Path]:
    """Draw the plots of a finished run from its directory alone, into a folder that may be the same.

    Returns:
        Paths of the files, each written atomically.

    Raises:
        InputError: The directory holds no run, or one that does not match its scenario; or a file cannot be written.
    """
    with store.reopen_run(directory) as (scenario, dataset, _):
        bounds = bounds_of_phases(scenario.phases, dataset)
        plots = _plots_of(scenario, scenario.phases, store.thinned(dataset), bounds, figures, progress)
    with naming(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for name, data in plots.items():
        with naming(folder / name):
            write_whole(folder / name, data)
    return sorted(folder / name for name in plots)


def _plots_of(
    scenario: Scenario,
    phases: Sequence[Phase],
    drawn: xr.Dataset,
    bounds: Sequence[tuple[RunBound, HeldBound]],
    figures: FigureOptions,
    progress: Report,
) -> dict[str, bytes]:
    """Draw the plots of a run, thinned to the visible detail; return the content of each file by its name."""
    files: dict[str, bytes] = {}
    plots = _figures_of(scenario, phases, drawn, bounds, figures)
    for done, (name, draw) in enumerate(plots.items()):
        progress("plotting", done, len(plots))
        with MATPLOTLIB:
            files |= {f"{name}.{form}": data for form, data in figure_bytes(draw(), figures).items()}
    progress("plotting", len(plots), len(plots))
    return files


def _figures_of(
    scenario: Scenario,
    phases: Sequence[Phase],
    drawn: xr.Dataset,
    bounds: Sequence[tuple[RunBound, HeldBound]],
    options: FigureOptions,
) -> dict[str, Callable[[], Figure]]:
    """Return a function that draws each figure of a run, by the figure's name."""
    first, last = phases[0].system, phases[-1].system
    bound = next(iter(bound_curves(phases, drawn, bounds).items()), None)
    return {
        "errors": lambda: draw_errors(first.team, drawn, bound, options),
        "trajectories": lambda: draw_trajectories(first.team, drawn, options, scenario.video.eye, first.obstacles),
        "configurations": lambda: draw_configurations(first.team, last.team, drawn, options),
    }


def video_entry(frames: int, options: VideoOptions) -> dict[str, Any]:
    """Return the fields of summary.json on a video."""
    return {"frames": frames, "width": options.width, "height": options.height, "fps": options.fps}


def draw_video(
    films: Callable[[], list[tuple[Film, mujoco.MjModel]]],
    path: Path,
    options: VideoOptions,
    progress: Report,
    kept: str,
) -> tuple[int, str]:
    """Draw a video, or explain why there is none; a machine without OpenGL still writes the data.

    Args:
        films: Function that returns the runs to draw side by side, each with its model.
        path: File to write.
        options: Options of the video.
        progress: Callback, called with the name of the activity, the steps done and the number of steps.
        kept: Sentence about what is complete without the video.

    Returns:
        The number of frames, and ''; or 0 and the reason.

    Raises:
        PlaceError: The file cannot be written.
    """
    from mjsheaf.video import draw  # here, because runs without videos do not need it

    try:
        return draw.draw_video(films(), path, options, partial(progress, "drawing video")), ""
    except PlaceError as error:
        raise PlaceError(f"{error}; {kept}") from error
    except MjsheafError as error:
        return 0, f"no video: {error}"


# -- in Python and notebooks -------------------------------------------------------------------------------------------


class Figures(dict[str, Figure]):
    """Matplotlib figures of a run by name. A notebook shows them below one another."""

    def _repr_html_(self) -> str:
        pictures = []
        for name, figure in self.items():
            data = base64.b64encode(figure_bytes(figure, AS_USUAL)["png"]).decode("ascii")
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
    with _opened(result, "plot") as (scenario, dataset, _), MATPLOTLIB:
        phases, drawn = scenario.phases, store.thinned(dataset)
        draw = _figures_of(scenario, phases, drawn, bounds_of_phases(phases, dataset), FigureOptions(title=title))
        return Figures((name, make()) for name, make in draw.items())


def replay(result: xr.Dataset | str | Path, *, height: int = _HEIGHT) -> ReplayPage:
    """Make the page that replays a run in three dimensions next to its curves, for a notebook or a file.

    Args:
        result: A Dataset from `simulate`, or the directory of a finished run.
        height: Height of the frame in a notebook, px.

    Returns:
        The page, with `save(path)` for a file that any browser opens.

    Raises:
        InputError: See `plot`.
    """
    again = None
    with _opened(result, "replay") as (scenario, dataset, summary):
        phases = scenario.phases
        if summary is None:
            summary, bounds, _ = account_of(scenario, phases, dataset)
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
        raise InputError(
            f"{doing}: result is a {type(result).__name__}; expected a Dataset as `simulate` "
            "returns it, or the directory of a run"
        )
