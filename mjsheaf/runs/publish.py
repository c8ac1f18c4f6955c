"""The resolved scenario in the directory of a run: all that it takes to run it again, vehicles' files included.

One run from scenario to directory: simulate, write data and plots, draw the video, publish.
"""

import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjsheaf.errors import MjsheafError
from mjsheaf.io.section import LARGEST
from mjsheaf.io.yaml import dump_yaml
from mjsheaf.results.store import CHECKSUMS, VEHICLES, write_checksums
from mjsheaf.scenario import Scenario
from mjsheaf.simulation.run import require_simulable, stream
from mjsheaf.video import VideoOptions, available_backend

if TYPE_CHECKING:
    import xarray as xr

    from mjsheaf.checking.finished import RunBound
    from mjsheaf.system import System


def dump_scenario(scenario: Scenario) -> str:
    """The resolved scenario as YAML: every field that has a value; running it again gives the same bits.

    Vehicles that do not come with mjsheaf stand in it as they were given; `write_scenario` takes their files along.
    """
    return dump_yaml(_resolved(scenario))


def write_scenario(scenario: Scenario, directory: Path) -> Path:
    """Write scenario.yaml, and into vehicles/ the files of vehicles that do not come with mjsheaf.

    It names those by paths inside the directory, which may then be moved, and runs to the same bits even when the
    originals have changed. Their checksums tell later what else a person has put there.

    Returns:
        The path of scenario.yaml.

    Raises:
        InputError: a vehicle's files cannot be found, or lie outside its directory.
        OSError: the directory cannot be written.
    """
    raw = _resolved(scenario)
    holders = [*raw["agents"], *raw["targets"]]
    places = [(holder, "vehicle") for holder in holders] + [
        (raw.get("vehicles", {}), key) for key in ("agents", "targets")
    ]
    copies: dict[str, str] = {}
    for holder, key in places:
        name = holder.get(key)
        if name is None or Path(name).suffix not in (".yaml", ".yml"):
            continue
        if name not in copies:
            taken = {CHECKSUMS, *(Path(copy).parts[1] for copy in copies.values())}
            copies[name] = _copy(Path(name), directory, taken)
        holder[key] = copies[name]
    if copies:
        write_checksums(directory / VEHICLES)
    path = directory / "scenario.yaml"
    path.write_text(dump_yaml(raw), encoding="utf-8")
    return path


def _copy(description: Path, directory: Path, taken: set[str]) -> str:
    """Copy the files of a vehicle into a folder of its own; the path of the copied description, relative."""
    from mjsheaf.vehicles.loading import files_of, read_description

    folder, k = description.stem, 1
    while folder in taken:
        k += 1
        folder = f"{description.stem}_{k}"
    root = description.parent.resolve()
    files = files_of(description, read_description(description).mjcf)
    home = directory / VEHICLES / folder
    for file in files:
        copy = home / file.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    home.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(description, home / description.name)
    return f"{VEHICLES}/{folder}/{description.name}"


def _resolved(scenario: Scenario) -> dict[str, Any]:
    return scenario.model_dump(mode="json", exclude_none=True)


__all__ = ["Outcome", "default_directory", "dump_scenario", "execute", "video_entry"]

Progress = Callable[[str, int, int], None]


_NEVER = {"growing": "its error grows to the end", "circling": "it swings by itself, without end"}
"""What to say of endings that no longer run mends."""


@dataclass(frozen=True)
class Outcome:
    """What a run left.

    Attributes:
        directory: where.
        summary: as summary.json.
        notes: what the user should know beside that.
        replaced: what is to be told of the run whose place it took; None where there was none.
    """

    directory: Path
    summary: dict[str, Any]
    notes: list[str]
    replaced: str | None = None


def default_directory(scenario: Scenario, backend: str) -> Path:
    """Where a run goes unless told otherwise."""
    return Path("runs") / f"{scenario.name}-{backend}"


def execute(
    scenario: Scenario,
    backend: str,
    directory: Path,
    *,
    video: VideoOptions | None,
    allow_drift: bool = False,
    origin: str | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Run a scenario and publish its directory; a run that blows up is published too, with status 'unstable'.

    Args:
        scenario: the scenario.
        backend: 'physics' or 'ideal'.
        directory: where the results go.
        video: how to film it, or None for no video.
        allow_drift: run a team whose harmonic extension is not unique too, and mark the result.
        origin: where the scenario comes from, as `scenario.load.origin` has it; summary.json keeps it.
        progress: called with (what is being done, done, in all).

    Raises:
        InputError: unknown backend, or a scenario that cannot be simulated; nothing is written.
        PlaceError: the directory may not be replaced or cannot be written.
        NotUniqueError: the harmonic extension is not unique and drift is not allowed; nothing is written.
    """
    from mjsheaf.checking.finished import bound_of_run, ending_of_run
    from mjsheaf.results import check_expectation, open_dataset, staging, summarize, thinned, write_dataset
    from mjsheaf.results.store import RESULT_DIGEST, digest, replaced_run, save_summary
    from mjsheaf.team.null_modes import describe_null_modes

    system = scenario.system
    require_simulable(system, backend, allow_drift=allow_drift)

    def report(what: str) -> Callable[[int, int], None]:
        return lambda done, total: progress(what, done, total) if progress else None

    replaced = replaced_run(directory)
    notes: list[str] = []
    with staging(directory) as fresh, ExitStack() as held:
        pieces = _Timed(stream(system, backend, scenario.seed, report("simulating")))
        write_dataset(pieces, fresh / "result.nc")
        dataset = held.enter_context(open_dataset(fresh / "result.nc"))
        write_scenario(scenario, fresh)
        theorem = bound_of_run(system, dataset)
        notes += [theorem.violation()] * bool(theorem.violation())
        drawn = thinned(dataset)
        beside = held.enter_context(ThreadPoolExecutor(1))
        plots = beside.submit(_plot, system, drawn, theorem, fresh, report("plotting"))
        if video is None:
            plots.result()
        final = summarize(system.team, drawn)
        status = dataset.attrs["status"]
        simulated = float(dataset["time"][-1] - dataset["time"][0])
        periods = dataset.sizes["time"] - 1
        per_period = round(system.grid.period / system.bodies.timestep) if backend == "physics" else 1
        summary: dict[str, Any] = {
            "scenario": scenario.name,
            "origin": origin,
            "backend": backend,
            "status": status,
            "message": dataset.attrs["message"],
            "ending": ending_of_run(system, drawn) if status == "finished" else None,
            "seed": scenario.seed,
            "steps": periods * per_period,
            "wall_time_s": pieces.seconds,
            "realtime_factor": simulated / pieces.seconds,
            "expect": check_expectation(scenario.expect, backend, status, final),
            "final": final,
            "free_directions": describe_null_modes(system.team),
            "theorem": {
                "applies": theorem.applies,
                "approximate": theorem.approximate,
                "reason": theorem.reason,
                "measured_over_bound": theorem.ratio,
                "measured_over_bound_settled": theorem.settled_ratio,
                "wrong": theorem.wrong,
            },
            "video": None,
            RESULT_DIGEST: digest(fresh / "result.nc"),
        }
        if summary["ending"] in _NEVER:
            notes.append(f"the team does not settle: {_NEVER[summary['ending']]}; see mjsheaf check")
        if video is not None:
            summary["video"], note = _film(
                scenario, system, dataset, fresh / "video.mp4", video, report("drawing video")
            )
            notes += [note] * bool(note)
        plots.result()
        report("publishing")(0, 1)  # the last moment at which the user can stop it
        save_summary(summary, fresh / "summary.json")
    return Outcome(directory, summary, notes, replaced)


def _plot(
    system: "System",
    drawn: "xr.Dataset",
    theorem: "RunBound",
    folder: Path,
    progress: Callable[[int, int], None],
) -> None:
    """Draw the plots of a run; a video is drawn meanwhile, mostly outside the interpreter."""
    from mjsheaf.runs.figures import plot_configurations, plot_errors, plot_trajectories

    bound = theorem.at(drawn["time"].values)
    telling = theorem.applies and bound.max() < LARGEST  # a blow-up satisfies any larger bound
    progress(0, 3)
    plot_errors(system.team, drawn, folder / "errors.png", bound if telling else None, approximate=theorem.approximate)
    progress(1, 3)
    plot_trajectories(system.team, drawn, folder / "trajectories.png")
    progress(2, 3)
    plot_configurations(system.team, drawn, folder / "configurations.png")
    progress(3, 3)


class _Timed:
    """Hands out what an iterator does, and knows how long that took.

    Attributes:
        seconds: spent in the iterator so far.
    """

    def __init__(self, pieces: "Iterator[xr.Dataset]") -> None:
        self._pieces = pieces
        self.seconds = 0.0

    def __iter__(self) -> "Iterator[xr.Dataset]":
        return self

    def __next__(self) -> "xr.Dataset":
        begun = time.perf_counter()
        try:
            return next(self._pieces)
        finally:
            self.seconds += time.perf_counter() - begun


def video_entry(frames: int, options: VideoOptions) -> dict[str, Any]:
    """What summary.json says about a video."""
    return {"frames": frames, "width": options.width, "height": options.height, "fps": options.fps}


def _film(
    scenario: Scenario,
    system: "System",
    dataset: "xr.Dataset",
    path: Path,
    options: VideoOptions,
    progress: Callable[[int, int], None],
) -> tuple[dict[str, Any] | None, str]:
    """Draw the video, or say why there is none: a machine that cannot draw still gets its data."""
    backend, reason = available_backend()
    if backend is None:
        return None, f"no video: {reason}"
    from mjsheaf.filming import film_run
    from mjsheaf.video.encode import UnwritableError

    try:
        return video_entry(film_run(scenario, dataset, path, options, progress, system), options), ""
    except UnwritableError:
        raise
    except MjsheafError as error:
        return None, f"no video: {error}"
