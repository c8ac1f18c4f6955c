"""Content of a video from a run's data, or from two runs side by side."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from mjsheaf.law.obstacles import points_kept_from
from mjsheaf.law.safety import SafetyArrays
from mjsheaf.media.medium import WITHOUT_MEAN, mean_flow
from mjsheaf.plotting import groups_of
from mjsheaf.results.metrics import law_in_words, mean_known
from mjsheaf.results.netcdf import length_of_piece
from mjsheaf.scenario import Scenario
from mjsheaf.team import Team
from mjsheaf.video.film import (
    UPRIGHT,
    Edge,
    Film,
    FloatArray,
    Medium,
    Samples,
    Stage,
    VideoOptions,
    error_range,
    frame_times,
)
from mjsheaf.video.flow import largest_speed, velocities
from mjsheaf.video.sea import Sea
from mjsheaf.video.sizes import MOMENTS, automatic_scales

if TYPE_CHECKING:
    from mjsheaf.mujoco_import import mujoco
    from mjsheaf.system import Phase

DRAFT_FPS = 15
HALF_FPS = 24  # most, where two runs are drawn side by side,
LONGEST_HALF = 30.0  # and the longest such video, s: two pictures a frame cost twice as much
HEADING_OFFSETS = np.linspace(-0.25, 0.25, 9)  # s, offsets for estimating the heading of a body without attitude
_SNAPSHOTS = 24  # of a flow that changes with time, in each phase
_POSITIONS = 2**18  # positions read at once, so that memory does not grow with the length of a video


def film_run(
    scenario: Scenario,
    dataset: xr.Dataset,
    path: Path,
    options: VideoOptions,
    progress: Callable[[int, int], None] | None = None,
    phases: "Sequence[Phase] | None" = None,
) -> int:
    """Draw a run to an MP4; see `film_of` and `draw_video`. Returns the number of frames."""
    from mjsheaf.video.draw import draw_video

    return draw_video([film_of(scenario, dataset, phases)], path, options, progress)


def film_side_by_side(
    scenario: Scenario,
    ideal: xr.Dataset,
    physics: xr.Dataset,
    path: Path,
    progress: Callable[[int, int], None] | None = None,
    quality: str | None = None,
) -> int:
    """Draw ideal kinematics on the left and bodies on the right, seen by one camera; see `film_run`."""
    from mjsheaf.video.draw import draw_video

    options = half_options(scenario, quality)
    return draw_video(both_films(scenario, ideal, physics, options), path, options, progress)


def both_films(
    scenario: Scenario, ideal: xr.Dataset, physics: xr.Dataset, options: VideoOptions
) -> "list[tuple[Film, mujoco.MjModel]]":
    """Return the content of both videos, each with its model, with equal lengths and a common axis for the errors.

    A run that ends early stands still until the other one ends.
    """
    films = [film_of(scenario, dataset) for dataset in (ideal, physics)]
    end = max(film.span[1] for film, _ in films)
    automatic = films[0][0].automatic
    axis = error_range(*(film.run.at(frame_times(film, options)).error for film, _ in films))
    return [
        (replace(film, name=f"{scenario.name}: {name}", error_range=axis, end=end, automatic=automatic), model)
        for name, (film, model) in zip(("ideal", "bodies"), films, strict=True)
    ]


def half_options(scenario: Scenario, quality: str | None = None) -> VideoOptions:
    """Return the options of each half: the scenario's, but no wider than 4 by 3 and at most 30 s long.

    `quality` overrides the scenario's.
    """
    video = scenario.video
    quality = quality or video.quality
    fps = min(video.fps, DRAFT_FPS if quality == "draft" else HALF_FPS)
    width = min(video.width, 2 * round(video.height * 2 / 3))
    speed = max(video.speed, (scenario.time.end - scenario.time.start) / LONGEST_HALF)
    return video_options(scenario, width=width, fps=fps, speed=min(float(f"{speed:.3g}"), 1e3), quality=quality)


def film_of(
    scenario: Scenario, dataset: xr.Dataset, phases: "Sequence[Phase] | None" = None
) -> "tuple[Film, mujoco.MjModel]":
    """Build the content of a run's video, and the model to draw it with.

    Args:
        scenario: Scenario that was run.
        dataset: Data of the run, in memory or an open file. They are read frame by frame.
        phases: Phases of the scenario, if they were built already.
    """
    from mjsheaf.loop.mujoco_engine import arena_of

    phases = scenario.phases if phases is None else phases
    system = phases[0].system
    team = system.team
    group, names, colours = groups_of(team)
    arena = arena_of(system, colours[group])
    surface = scenario.scene.surface
    grid = None
    seas = seas_of(phases) if surface == "water" else []
    if surface != "none" and not seas:
        # texrepeat counts the repetitions of a uniform texture in two metres. The ground's texture has four squares.
        grid = 2.0 / float(arena.model.mat(surface).texrepeat[0]) / (2 if surface == "ground" else 1)
    run = RecordedRun(dataset, scenario.scene.height)
    places = places_of(run, phases)
    film = Film(
        name=scenario.name,
        subtitle=_subtitle(dataset, system.law.term_names),
        run=run,
        agent_ids=team.agent_ids,
        target_ids=team.target_ids,
        qpos_address=arena.qpos,
        body_id=arena.body,
        group=group,
        group_names=names,
        colours=colours,
        edges=_edges(team),
        surface=surface,
        surface_height=scenario.scene.height,
        grid=grid,
        kinds=system.bodies.vehicle,
        media=media_of(phases, places),
        stages=[_stage(phase) for phase in phases] if any(phase.events for phase in phases) else (),
        automatic=automatic_scales(system.bodies.vehicle, system.vehicle_radii, places),
        obstacles=system.obstacles,
        restraints=partial(restraints_of, dataset, system.control.law.safety) if "safety_cause" in dataset else None,
        seas=seas,
    )
    return film, arena.model


def restraints_of(
    dataset: xr.Dataset, safety: SafetyArrays, time: float, positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Find the agents that the filter restrains at a time in s, and what it keeps them away from: `Film.restraints`."""
    now = dataset[["safety_cause", "safety_correction"]].sel(time=[time], method="nearest")
    cause = np.where(now["safety_correction"] > 0.0, now["safety_cause"], 0).astype(np.int64)
    agents = np.flatnonzero(cause)
    ends = points_kept_from(safety.obstacles, cause, np.array([time]), positions[None])[0]
    return positions[agents], ends[agents]


def _subtitle(dataset: xr.Dataset, term_names: Sequence[str]) -> str:
    """Describe how a run was simulated: backend, law, and whether it blew up."""
    words = ["MuJoCo bodies" if dataset.attrs["backend"] == "physics" else "ideal kinematics", law_in_words(dataset)]
    if not dataset.attrs.get("controller"):
        words += term_names
    if dataset.attrs["status"] != "finished":
        words.append("blew up")
    return ", ".join(words)


def seas_of(phases: "Sequence[Phase]") -> list[Sea]:
    """List the sea of each phase of a run, level in a phase without waves; empty if no phase has waves."""
    found = []
    for phase in phases:
        waves = [flow.waves.components_of(phase.system.seed) for flow in phase.system.flows if flow.waves is not None]
        found.append(waves[0] if waves else None)
    some = next((waves for waves in found if waves is not None), None)
    if some is None:
        return []
    calm = some._replace(amplitude=np.zeros_like(some.amplitude))
    return [
        Sea(phase.time, waves or calm, phase.system.bodies.surface_height)
        for phase, waves in zip(phases, found, strict=True)
    ]


def places_of(run: "RecordedRun", phases: "Sequence[Phase]") -> FloatArray:
    """Return positions at a few moments of a run, shape (K, V, 3), m; NaN for absent agents."""
    times = np.linspace(run.time[0], run.time[-1], MOMENTS)
    positions = run.at(times).positions.copy()
    starts = [phase.time for phase in phases]
    for row, time in enumerate(times.tolist()):
        phase = phases[max(int(np.searchsorted(starts, time + 1e-9)) - 1, 0)]
        positions[row, np.flatnonzero(~phase.system.team.present)] = np.nan
    return positions


def media_of(phases: "Sequence[Phase]", places: FloatArray) -> list[Medium]:
    """List the flow fields that vehicles meet and that move in a phase of the run.

    Args:
        phases: The phases.
        places: Positions at a few moments, as `places_of` returns them.
    """
    systems = {name: phase.system for phase in phases for name in phase.system.flow_names}
    found = []
    for name, system in systems.items():
        k = system.flow_names.index(name)
        met = np.flatnonzero(system.field == k)
        if not len(met):
            continue
        (_, first), *changes = shots = _snapshots(phases, name, int(met[0]))
        level = all(system.team.members[v].dimension == 2 for v in met)
        medium = Medium(name, first, met, level, k, changes=changes)
        seen = places[:, met].reshape(-1, 3)
        tops = [largest_speed(partial(velocities, medium, time=time), seen) for time, _ in shots]
        found.append(replace(medium, top=max(tops)))
    return [medium for medium in found if medium.top > 0.0]


def _snapshots(
    phases: "Sequence[Phase]", name: str, vehicle: int
) -> list[tuple[float, Callable[[FloatArray], FloatArray]]]:
    """List velocities of a flow and the times at which they begin: several of a flow that changes with time.

    Args:
        phases: The phases.
        name: Name of the flow field.
        vehicle: Number of a vehicle that meets it.
    """
    found: list[tuple[float, Callable[[FloatArray], FloatArray]]] = []
    flow = None
    for phase in phases:
        before, flow, grid = flow, phase.system.flow_named(name), phase.system.grid
        if any(part.met[vehicle] for part in phase.system.moving if not isinstance(part, WITHOUT_MEAN)):
            times = phase.time + grid.period * grid.steps * np.arange(_SNAPSHOTS) / _SNAPSHOTS
            found += [(time, partial(mean_flow, phase.system, vehicle, time)) for time in times.tolist()]
        elif flow != before:
            found.append((phase.time, flow.velocity))
    return found


def _edges(team: Team) -> list[Edge]:
    """Return the edges of a team, in the format of `Film.edges`."""
    return [
        (team.index[e.tail], team.index[e.head], "one-way" if e.directed else "communication")
        for e in team.communication
    ] + [(team.index[e.tail], team.index[e.head], "sensing") for e in team.sensing]


def _stage(phase: "Phase") -> Stage:
    """Convert a phase of the scenario to a stage of the video."""
    team = phase.system.team
    absent = frozenset(np.flatnonzero(~team.present).tolist())
    return Stage(phase.time, _edges(team), absent, ", ".join(phase.events))


def video_options(scenario: Scenario, **changes: float | int | str | dict[str, float] | None) -> VideoOptions:
    """The scenario's video section as options; changes that are None leave it as it is.

    A draft has at most 15 frames a second, unless `fps` is among the changes.
    """
    changes = {name: value for name, value in changes.items() if value is not None}
    scales = {name: getattr(scenario.scene, name) for name in ("vehicle_scale", "vehicle_scales")}
    given = scenario.video.model_dump() | scales | changes
    if given["quality"] == "draft" and "fps" not in changes:
        given["fps"] = min(given["fps"], DRAFT_FPS)
    return VideoOptions(**given)


class RecordedRun:
    """A run's data, read piece by piece when they are looked at.

    Ideal kinematics have neither height in the plane nor attitude: vehicles lie on the surface, whose z is given in m,
    and face where they go.

    Attributes:
        time: Times of all samples, shape (T,), s.
    """

    def __init__(self, dataset: xr.Dataset, surface_height: float) -> None:
        self._dataset, self._surface = dataset, surface_height
        self._physics = dataset.attrs["backend"] == "physics"
        self.time: FloatArray = dataset["time"].values
        self._length = length_of_piece(dataset)
        self._piece = lru_cache(2)(self._read)

    def at(self, times: FloatArray) -> Samples:
        """Interpolate; see `Samples.at`."""
        found = self._interpolate(times)
        return found if self._physics else Samples(**(vars(found) | {"quaternions": self._headings(times)}))

    def _interpolate(self, times: FloatArray, *, horizontal: bool = False) -> Samples:
        """Interpolate as `at`, without headings; `horizontal` leaves out all but positions x and y."""
        # Only the two samples around each time are stored.
        after = np.searchsorted(self.time, times, side="right").clip(0, len(self.time) - 1)
        rows = np.unique([after, np.maximum(after - 1, 0)])
        pieces = [
            tuple(values[rows[rows // self._length == piece] - piece * self._length] for values in self._piece(piece))
            for piece in np.unique(rows // self._length).tolist()
        ]
        whole = Samples(*(np.concatenate(values) for values in zip(*pieces, strict=True)))
        if horizontal:
            none = {"quaternions": whole.quaternions[:, :0], "harmonic_extension": whole.harmonic_extension[:, :0]}
            whole = replace(whole, positions=whole.positions[..., :2], **none)
        return whole.at(times)

    def _read(self, number: int) -> tuple[FloatArray, ...]:
        """The fields of `Samples` over one piece of the data; attitudes that there are none of are upright."""
        data = self._dataset.isel(time=slice(number * self._length, (number + 1) * self._length))

        def joined(name: str) -> FloatArray:
            return np.concatenate([data[f"{kind}_{name}"].values for kind in ("agent", "target")], axis=1)

        positions, q_star = joined("position"), data["harmonic_extension"].values.copy()
        if self._physics:
            positions[..., 2], quaternions = joined("height"), joined("orientation")
        else:
            positions[..., 2] = np.where(np.isnan(positions[..., 2]), self._surface, positions[..., 2])
            quaternions = np.broadcast_to(UPRIGHT, (*positions.shape[:2], 4))
        q_star[..., 2] = np.where(np.isnan(q_star[..., 2]), positions[:, : q_star.shape[1], 2], q_star[..., 2])
        error = np.sqrt(mean_known(data["tracking_error"].values ** 2))
        return data["time"].values, positions, quaternions, q_star, error

    def _headings(self, times: FloatArray) -> FloatArray:
        """Level attitudes that follow the horizontal velocity, smoothed over half a second. Shape (K, V, 4)."""
        vehicles = self._dataset.sizes["agent"] + self._dataset.sizes["target"]
        count = max(1, _POSITIONS // (len(HEADING_OFFSETS) * vehicles))  # of times at once
        starts = range(0, len(times), count)
        return np.concatenate([self._headings_at(times[begin : begin + count]) for begin in starts])

    def _headings_at(self, times: FloatArray) -> FloatArray:
        """Compute `_headings` of a few times."""
        around = self._interpolate((times[:, None] + HEADING_OFFSETS).ravel(), horizontal=True).positions
        steps = np.diff(around.reshape(len(times), len(HEADING_OFFSETS), -1, 2), axis=1)
        # Each instant has an equal say, however fast it is: the first seconds are fast.
        directions = steps / np.maximum(np.linalg.norm(steps, axis=-1, keepdims=True), 1e-9)
        along = directions.sum(axis=1)
        half = np.arctan2(along[..., 1], along[..., 0]) / 2
        return np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=-1)
