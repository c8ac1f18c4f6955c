"""Content of a video of one run, or of two side by side: runs, the viewer's options, and the content of each frame."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.loop.mujoco_engine import arena_of
from mjsheaf.mujoco_import import mujoco
from mjsheaf.results.metrics import law_in_words
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.scenario import Video
from mjsheaf.show.played import OUTLIER_FACTOR, UPRIGHT, Played, Poses, Region, played

DRAFT_FPS = 15


@dataclass(frozen=True, kw_only=True)
class Film(Played):
    """A run with everything that its video needs.

    Attributes:
        subtitle: One line under the title, such as "physics, gain 10".
        qpos_address: Index in qpos of each vehicle's free joint, shape (V,).
        body_id: Body of each vehicle's free joint, shape (V,).
        error_range: Limits of the error's axis, above 0. None derives them from the error.
        grid: Side of the squares on the surface, m. None if it has no squares.
        end: Time at which the video ends, s. None for the run's end. After that everything stands still.
    """

    subtitle: str
    qpos_address: IntArray
    body_id: IntArray
    error_range: tuple[float, float] | None = None
    grid: float | None = None
    end: float | None = None

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and the last moment, in s."""
        return float(self.run.time[0]), float(self.run.time[-1] if self.end is None else self.end)


class VideoOptions(Video):
    """Viewer's options for a run, by default those of a scenario's section `video`.

    With quality 'draft' the scene is drawn with half as many pixels each way and hard edges, and enlarged; the writing
    is as sharp as ever.
    """

    @property
    def panel(self) -> int:
        """Width of the panel at the left of the scene, which has status and legend, in pixels."""
        return 2 * round(160 * self.unit)

    @property
    def scene(self) -> tuple[int, int]:
        """Width and height of the scene in the frame, in pixels."""
        return self.width - self.panel, self.height

    @property
    def drawn(self) -> tuple[int, int]:
        """Width and height with which the scene is drawn, in pixels."""
        divisor = 2 if self.quality == "draft" else 1
        width, height = self.scene
        return -(-width // divisor), -(-height // divisor)

    @property
    def unit(self) -> float:
        """Size of one pixel of a 1000x720 frame in this frame. Text and line sizes are given for 1000x720."""
        return min(self.width / 1000, self.height / 720)


def video_options(scenario: Scenario, **changes: float | int | str | None) -> VideoOptions:
    """The scenario's video section as options; changes that are None leave it as it is.

    A draft has at most 15 frames a second, unless `fps` is among the changes.
    """
    changes = {name: value for name, value in changes.items() if value is not None}
    given = scenario.video.model_dump() | changes
    if given["quality"] == "draft" and "fps" not in changes:
        given["fps"] = min(given["fps"], DRAFT_FPS)
    return VideoOptions(**given)


def film_of(scenario: Scenario, dataset: xr.Dataset) -> tuple[Film, mujoco.MjModel]:
    """Build the content of a run's video, and the model to draw it with.

    Args:
        scenario: Scenario that was run.
        dataset: Data of the run, in memory or an open file. They are read frame by frame.
    """
    content = played(scenario, dataset, scenario.phases)
    arena = arena_of(scenario.system, content.colours[content.group])
    grid = None
    if content.surface != "none" and not content.seas:
        # texrepeat counts the repetitions of a uniform texture in two metres. The ground's texture has four squares.
        grid = 2.0 / float(arena.model.mat(content.surface).texrepeat[0]) / (2 if content.surface == "ground" else 1)
    words = ["MuJoCo bodies" if dataset.attrs["backend"] == "physics" else "ideal kinematics", law_in_words(dataset)]
    if not dataset.attrs.get("controller"):
        words += scenario.system.law.term_names
    if dataset.attrs["status"] != "finished":
        words.append("blew up")
    film = Film(**vars(content), subtitle=", ".join(words), qpos_address=arena.qpos, body_id=arena.body, grid=grid)
    return film, arena.model


def both_films(
    scenario: Scenario, ideal: xr.Dataset, physics: xr.Dataset, options: VideoOptions
) -> list[tuple[Film, mujoco.MjModel]]:
    """Return the content of both videos, each with its model, with equal lengths and a common axis for the errors.

    A run that ends early stands still until the other one ends.
    """
    films = [film_of(scenario, dataset) for dataset in (ideal, physics)]
    end = max(film.span[1] for film, _ in films)
    scales = films[0][0].scales
    axis = error_range(*(film.run.at(frame_times(film, options)).error for film, _ in films))
    return [
        (replace(film, name=f"{scenario.name}: {name}", error_range=axis, end=end, scales=scales), model)
        for name, (film, model) in zip(("ideal", "bodies"), films, strict=True)
    ]


def half_options(scenario: Scenario, quality: str | None = None) -> VideoOptions:
    """Return the options of each half: the scenario's, but no wider than 4 by 3 and at most 30 s long.

    Two pictures a frame cost twice as much, so there are fewer frames. `quality` overrides the scenario's.
    """
    video = scenario.video
    quality = quality or video.quality
    fps = min(video.fps, DRAFT_FPS if quality == "draft" else 24)
    width = min(video.width, 2 * round(video.height * 2 / 3))
    speed = max(video.speed, (scenario.time.end - scenario.time.start) / 30.0)
    return video_options(scenario, width=width, fps=fps, speed=min(float(f"{speed:.3g}"), 1e3), quality=quality)


def frame_times(film: Film, options: VideoOptions) -> Array:
    """Return the frames' times, from the first sample on, speed / fps apart. Shape (F,), F >= 1, in s."""
    start, end = film.span
    # The small excess allows for rounding if the duration is a whole number of frames.
    count = int(np.floor((end - start) * options.fps / options.speed + 1e-6)) + 1
    return np.asarray(start + np.arange(count) * (options.speed / options.fps), np.float64)


DECADES = 6  # maximum range of the error's axis; smaller values are drawn at its lower end


def error_range(*errors: Array) -> tuple[float, float] | None:
    """The lowest and highest value of an axis that shows all of these errors, at most DECADES apart.

    None where none of them is finite and not zero.
    """
    sizes = np.abs(np.concatenate([np.ravel(error) for error in errors]))
    shown = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    if not len(shown):
        return None
    high = float(shown.max())
    return max(float(shown.min()), high / 10.0**DECADES), high


@dataclass(frozen=True)
class Extent:
    """Region that a video shows, estimated robustly from the run, and the vehicles that leave it.

    A diverged run has positions too far apart for any picture, or non-finite ones.

    Attributes:
        survey: Samples of the run at some of the frames' times, including the first and last.
        region: Place of the run, where three quarters of all positions lie.
        last: Last finite position of each vehicle, then of each q*, shape (V + N, 3), m.
        unfollowed: Time from which the camera no longer follows each, shape (V + N,), s. Infinite if it always does.
        left: Position of each at that time, shape (V + N, 3), m.
    """

    survey: Poses
    region: Region
    last: Array
    unfollowed: Array
    left: Array

    @classmethod
    def of(cls, film: Film, times: Array) -> "Extent":
        """Measure the extent of a video with frames at these times."""
        count = min(len(times), 2000, max(400_000 // film.vehicles, 2))
        survey = film.run.at(times[np.linspace(0, len(times) - 1, count).round().astype(np.int64)])
        points = np.concatenate([survey.positions, survey.harmonic_extension], axis=1)
        finite: BoolArray = np.isfinite(points).all(axis=-1)
        region = Region.of(survey.positions, part=0.75)
        distance = np.where(finite, np.abs(points - region.centre).max(axis=-1), np.inf)
        outlier = distance > OUTLIER_FACTOR * region.size
        near = (distance <= 3.0 * region.size) & ~np.logical_or.accumulate(outlier, axis=0)

        def last(condition: BoolArray) -> tuple[Array, Array]:
            """When and where each point last met a condition; before all times and at the centre if it never did."""
            row, ever = len(points) - 1 - np.argmax(condition[::-1], axis=0), np.any(condition, axis=0)
            place = np.where(np.expand_dims(ever, 1), points[row, np.arange(points.shape[1])], region.centre)
            return np.where(ever, survey.time[row], -np.inf), place

        left_at, left = last(near)
        return cls(survey, region, last(finite)[1], np.where(outlier.any(axis=0), left_at, np.inf), left)

    def drawable(self, samples: Poses) -> Poses:
        """Make every position and attitude one that can be drawn.

        A vehicle without a position stays where it was last; one that is absurdly far goes no farther; an attitude
        that is not known is upright.
        """
        vehicles = samples.positions.shape[1]

        def known(values: Array, others: Array) -> Array:
            return np.where(np.isfinite(values).all(axis=-1, keepdims=True), values, others)

        return replace(
            samples,
            positions=self.region.confined(known(samples.positions, self.last[:vehicles])),
            harmonic_extension=self.region.confined(known(samples.harmonic_extension, self.last[vehicles:])),
            quaternions=known(samples.quaternions, UPRIGHT),
        )

    def followed(self, samples: Poses) -> Array:
        """Return what the camera keeps in view: vehicles and q*, but where they were left once they blow up.

        Args:
            samples: drawable ones, at F times.

        Returns:
            Shape (F, V + N, 3), in m.
        """
        points = np.concatenate([samples.positions, samples.harmonic_extension], axis=1)
        return np.where((samples.time[:, None] >= self.unfollowed)[..., None], self.left, points)


@dataclass(frozen=True)
class Moment:
    """Content of one frame.

    Attributes:
        time: Time of the frame, s.
        positions: Shape (V, 3), in m.
        quaternions: Shape (V, 4).
        harmonic_extension: Shape (N, 3), in m.
        error: NaN where the run has none.
        trail: where every vehicle was before, oldest first, and where it is. Shape (J, V, 3), in m.
        trail_time: Shape (J,), in s.
    """

    time: float
    positions: Array
    quaternions: Array
    harmonic_extension: Array
    error: float
    trail: Array
    trail_time: Array


# Pieces of a trail: the minimum per vehicle, whatever the budget of all vehicles, and the maximum in a short trail.
TRAIL_PIECES = (4, 48)


class Frames:
    """Content of each frame, read a few hundred frames at a time so that memory does not grow with the run.

    Attributes:
        film: Content of the video.
        times: Times of the frames, shape (F,), s.
        extent: Region that the video shows.
        step: Number of frames read together.
        trail: Duration of the trails, s.
    """

    def __init__(self, film: Film, options: VideoOptions) -> None:
        self.film = film
        self.times = frame_times(film, options)
        self.extent = Extent.of(film, self.times)
        self.step = max(1, min(256, 25_600 // film.vehicles))
        self.trail = min(options.trail, film.span[1] - film.span[0])
        most = max(TRAIL_PIECES[1], int(8 * self.trail))
        self._pieces = max(TRAIL_PIECES[0], min(most, 2000 // film.vehicles)) if self.trail > 0 else 0
        self._chunk = -1

    def chunk(self, number: int) -> Poses:
        """Read `step` consecutive frames, made drawable; there are `len(times) / step` such chunks."""
        return self.extent.drawable(self.film.run.at(self.times[number * self.step : (number + 1) * self.step]))

    def followed(self, number: int) -> Array:
        """Return what the camera keeps in view in a chunk, (F, V + N, 3), m; absent agents are where a target is."""
        samples, film = self.chunk(number), self.film
        points = self.extent.followed(samples)
        for row, time in enumerate(samples.time.tolist()):
            gone = np.array(sorted(film.absent(time)), dtype=np.int64)
            points[row, np.concatenate([gone, film.vehicles + gone])] = points[row, film.vehicles - 1]
        return points

    def moment(self, number: int) -> Moment:
        """Return the content of a frame; frames are read fastest in order."""
        chunk, row = divmod(number, self.step)
        if chunk != self._chunk:
            self._samples, self._chunk = self.chunk(chunk), chunk
            self._trail_times = self._joints(self._samples.time)
            # Trails of consecutive frames share most of their joints.
            times, self._trail_rows = np.unique(self._trail_times, return_inverse=True)
            self._trail_positions = self.extent.drawable(self.film.run.at(times)).positions
        time, positions, quaternions, q_star, error = (values[row] for values in vars(self._samples).values())
        trail = self._trail_positions[self._trail_rows[row]]
        return Moment(float(time), positions, quaternions, q_star, float(error), trail, self._trail_times[row])

    def _joints(self, times: Array) -> Array:
        """Return when the trails at these times have joints, from their ends to now. Shape (K, J), in s."""
        if not self._pieces:
            return times[:, None]
        # Joints are at multiples of one interval, so that a trail does not flicker over time.
        interval = self.trail / self._pieces
        oldest = np.maximum(times - self.trail, self.film.span[0])[:, None]
        multiples = np.floor(oldest / interval) + np.arange(self._pieces + 2)
        joints = np.clip(multiples * interval, oldest, times[:, None])
        joints[:, -1] = times  # rounding may put it slightly before
        return joints
