"""Content of a video: a team over time, the viewer's options, and the content of each frame."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt
from pydantic import Field

from mjsheaf.errors import InputError, raise_first
from mjsheaf.law.obstacles import ObstacleArrays
from mjsheaf.scenario.scenario import Scale, Video, scales_of

if TYPE_CHECKING:
    from mjsheaf.video.sea import Sea

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
UPRIGHT: FloatArray = np.array([1.0, 0.0, 0.0, 0.0])  # quaternion
EdgeKind = Literal["communication", "one-way", "sensing"]  # one-way: i senses agent j, which does not know
Edge = tuple[int, int, EdgeKind]
PANEL = 320  # width of the panel next to the scene, in pixels of a 1000x720 frame


@dataclass(frozen=True)
class Samples:
    """A team at T times: V vehicles, N agents first, then the targets.

    Attributes:
        time: Shape (T,), in s.
        positions: position of each vehicle's body frame. Shape (T, V, 3), in m.
        quaternions: attitude of each vehicle, w x y z. Shape (T, V, 4).
        harmonic_extension: where each agent should be, q*. Shape (T, N, 3), in m.
        error: RMS over the agents of the distance from where each should be. Shape (T,), in m.
    """

    time: FloatArray
    positions: FloatArray
    quaternions: FloatArray
    harmonic_extension: FloatArray
    error: FloatArray

    def at(self, times: FloatArray) -> "Samples":
        """Interpolate: linear, for attitudes linear and normalised; held before the first and after the last sample.

        Args:
            times: Shape (K,), in s. Those of the samples must increase.
        """
        after = np.searchsorted(self.time, times, side="right").clip(0, len(self.time) - 1)
        before = np.maximum(after - 1, 0)
        span = self.time[after] - self.time[before]
        share = ((times - self.time[before]) / np.where(span > 0, span, 1.0)).clip(0.0, 1.0)

        def between(first: FloatArray, second: FloatArray) -> FloatArray:
            weight = share.reshape(-1, *[1] * (first.ndim - 1))
            with np.errstate(invalid="ignore"):  # a run that blew up has infinite values
                return np.where(weight > 0, (1 - weight) * first + weight * second, first)

        first, second = self.quaternions[before], self.quaternions[after]
        opposite = (first * second).sum(axis=-1, keepdims=True) < 0  # q and -q are one attitude: go the shorter way
        turned = between(first, np.where(opposite, -second, second))
        return Samples(
            times,
            between(self.positions[before], self.positions[after]),
            turned / np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1e-12),
            between(self.harmonic_extension[before], self.harmonic_extension[after]),
            between(self.error[before], self.error[after]),
        )


class Run(Protocol):
    """A finished run, in memory (`Samples`) or read from its file when it is looked at."""

    @property
    def time(self) -> FloatArray:
        """Time of each sample, increasing. Shape (T,), in s."""

    def at(self, times: FloatArray) -> Samples:
        """Interpolate; see `Samples.at`."""


@dataclass(frozen=True)
class Stage:
    """State that holds from some time on.

    Attributes:
        start: Start time, s.
        edges: Edges, in the format of `Film.edges`.
        absent: Indices of the agents that failed or have yet to join. They are drawn in grey and not followed.
        name: Name of the event, drawn next to the time.
    """

    start: float
    edges: Sequence[Edge]
    absent: frozenset[int] = frozenset()
    name: str = ""


@dataclass(frozen=True)
class Medium:
    """Medium that moves about some of the vehicles, drawn as arrows.

    Attributes:
        name: such as 'wind'.
        velocity: Velocities at the start of the run, shape (K, 3), m/s, at points, shape (K, 3), m.
        vehicles: numbers of those that meet it. Shape (M,).
        level: True if it moves in the plane alone, at the surface.
        scale: Number of the scale of colours that shows its speed; see `flow.STOPS`.
        top: End of that scale, m/s.
        changes: Times at which events change the velocities, s, and the velocities from there on; in order.
    """

    name: str
    velocity: Callable[[FloatArray], FloatArray]
    vehicles: IntArray
    level: bool
    scale: int = 0
    top: float = 1.0
    changes: Sequence[tuple[float, Callable[[FloatArray], FloatArray]]] = ()


@dataclass(frozen=True)
class Film:
    """A finished run, ready to be drawn.

    Attributes:
        name: Name of the scenario, drawn as the title.
        subtitle: One line under the title, such as "physics, gain 10".
        run: Poses of all vehicles over time.
        agent_ids: Labels of the N agents.
        target_ids: Labels of the V - N targets.
        qpos_address: Index in qpos of each vehicle's free joint, shape (V,).
        body_id: Body of each vehicle's free joint, shape (V,).
        group: Index of each vehicle's group, which gives its colour, shape (V,).
        group_names: Names of the G groups, for the legend.
        colours: Colour of each group, RGB in 0..1, shape (G, 3).
        edges: Pairs of vehicles (i, j, kind) that exchange states or measure each other.
        error_range: Limits of the error's axis, above 0. None derives them from the error.
        surface: Plane in the model, if any. Vehicles off it are joined to it by a vertical line.
        surface_height: z of that plane, m.
        grid: Side of the squares on that plane, m. None if it has no squares.
        end: Time at which the video ends, s. None for the run's end. After that everything stands still.
        stages: States between events, in order. The first one holds at the start.
        kinds: Kind of each vehicle, for scaling by kind. Empty if the viewer cannot scale them.
        automatic: Default scale of each vehicle, shape (V,). Empty for their true size.
        media: Moving media around the vehicles.
        obstacles: What agents keep away from; None without any.
        restraints: Computes, from a time in s and the positions, shape (V, 3), m, the positions of the agents that the
            safety filter restrains then and the points that it keeps them away from, shapes (M, 3), m; None without it.
        seas: Waves of the surface, in order of their start times; empty for a level surface.
    """

    name: str
    subtitle: str
    run: Run
    agent_ids: list[str]
    target_ids: list[str]
    qpos_address: IntArray
    body_id: IntArray
    group: IntArray
    group_names: list[str]
    colours: FloatArray
    edges: Sequence[Edge]
    error_range: tuple[float, float] | None = None
    surface: Literal["water", "ground", "none"] = "none"
    surface_height: float = 0.0
    grid: float | None = None
    end: float | None = None
    stages: Sequence[Stage] = ()
    kinds: Sequence[str] = ()
    media: Sequence[Medium] = ()
    automatic: FloatArray | None = None
    obstacles: ObstacleArrays | None = None
    restraints: Callable[[float, FloatArray], tuple[FloatArray, FloatArray]] | None = None
    seas: Sequence["Sea"] = ()

    def __post_init__(self) -> None:
        """Check that everything fits together.

        Raises:
            InputError: naming the array that does not fit, and the shape expected.
        """
        time = self.run.time
        groups = len(self.group_names)
        raise_first(
            InputError,
            {
                "video has no vehicles; expected at least one agent or target": self.vehicles == 0,
                "film.run.time: expected at least one time; all finite and increasing": (
                    not len(time) or not np.isfinite(time).all() or not (np.diff(time) > 0).all()
                ),
            },
        )
        self._require_shapes(self.run if isinstance(self.run, Samples) else self.run.at(time[:1]))
        if np.any((self.group < 0) | (self.group >= groups)):
            raise InputError(f"film.group: expected indices into group_names, 0 to {groups - 1}")
        for edges in (self.edges, *(stage.edges for stage in self.stages)):
            self._require_edges(edges)

    def _require_edges(self, edges: Sequence[Edge]) -> None:
        """Refuse edges between other than two vehicles, or of an unknown kind."""
        for i, j, kind in edges:
            if not 0 <= min(i, j) <= max(i, j) < self.vehicles or kind not in get_args(EdgeKind):
                raise InputError(f"film.edges has ({i}, {j}, {kind!r}); expected two vehicles and a kind of edge")

    def _require_shapes(self, run: Samples) -> None:
        """Refuse arrays whose shapes do not fit the vehicles, the groups or the samples."""
        samples, vehicles = len(run.time), self.vehicles
        for name, value, shape in (
            ("run.positions", run.positions, (samples, vehicles, 3)),
            ("run.quaternions", run.quaternions, (samples, vehicles, 4)),
            ("run.harmonic_extension", run.harmonic_extension, (samples, self.agents, 3)),
            ("run.error", run.error, (samples,)),
            ("qpos_address", self.qpos_address, (vehicles,)),
            ("body_id", self.body_id, (vehicles,)),
            ("group", self.group, (vehicles,)),
            ("colours", self.colours, (len(self.group_names), 3)),
        ):
            if np.shape(value) != shape:
                raise InputError(f"film.{name} has shape {np.shape(value)}; expected {shape}")

    @property
    def agents(self) -> int:
        """Number of agents, N."""
        return len(self.agent_ids)

    @property
    def vehicles(self) -> int:
        """Number of vehicles, V: agents and targets."""
        return len(self.agent_ids) + len(self.target_ids)

    def scales(self, options: "VideoOptions") -> FloatArray:
        """Return the scale at which each vehicle is drawn, shape (V,).

        Raises:
            InputError: The options name an unknown vehicle or kind.
        """
        ids = [*self.agent_ids, *self.target_ids]
        automatic = np.ones(self.vehicles) if self.automatic is None else self.automatic
        return scales_of(options.vehicle_scale, options.vehicle_scales, ids, self.kinds or ids, automatic)

    def stage(self, time: float) -> int:
        """Return the index of the stage at a time in s, 0 if there are no stages."""
        return max(sum(stage.start <= time + 1e-9 for stage in self.stages) - 1, 0)

    def absent(self, time: float) -> frozenset[int]:
        """Numbers of the agents that are absent at a time in s."""
        return self.stages[self.stage(time)].absent if self.stages else frozenset()

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and the last moment, in s."""
        return float(self.run.time[0]), float(self.run.time[-1] if self.end is None else self.end)


class VideoOptions(Video):
    """Viewer's options for a run: a scenario's section `video`, and the scale of the vehicles.

    With quality 'draft' the scene is drawn with half as many pixels each way and hard edges, and enlarged; the writing
    is as sharp as ever.
    """

    vehicle_scale: Scale | None = Field(None, description="times larger than life; automatic without it")
    vehicle_scales: dict[str, Scale] = Field(default_factory=dict, description="the same, by id or kind of vehicle")

    @property
    def panel(self) -> int:
        """Width of the panel at the left of the scene, which has status and legend, in pixels."""
        return 2 * round(PANEL * self.unit / 2)

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

    @property
    def drawn_unit(self) -> float:
        """`unit` for the resolution at which the scene is drawn."""
        return self.unit * self.drawn[1] / self.height


def frame_times(film: Film, options: VideoOptions) -> FloatArray:
    """Return the frames' times, from the first sample on, speed / fps apart. Shape (F,), F >= 1, in s."""
    start, end = film.span
    # The small excess allows for rounding if the duration is a whole number of frames.
    count = int(np.floor((end - start) * options.fps / options.speed + 1e-6)) + 1
    return np.asarray(start + np.arange(count) * (options.speed / options.fps), np.float64)


DECADES = 6  # maximum range of the error's axis; smaller values are drawn at its lower end


def error_range(*errors: FloatArray) -> tuple[float, float] | None:
    """The lowest and highest value of an axis that shows all of these errors, at most DECADES apart.

    None where none of them is finite and not zero.
    """
    sizes = np.abs(np.concatenate([np.ravel(error) for error in errors]))
    shown = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    if not len(shown):
        return None
    high = float(shown.max())
    return max(float(shown.min()), high / 10.0**DECADES), high


OUTLIER_FACTOR = 100.0  # multiple of the extent beyond which a vehicle has blown up
UNFOLLOW_FACTOR = 3.0  # multiple of the extent beyond which the camera stops following a vehicle that blew up
_SURVEYED = 2000  # maximum number of frames that determine the extent
_SURVEYED_POSITIONS = 400_000  # maximum number of positions in these frames


@dataclass(frozen=True)
class Extent:
    """Region that a video shows, estimated robustly from the run, and the vehicles that leave it.

    A diverged run has positions too far apart for any picture, or non-finite ones.

    Attributes:
        survey: Samples of the run at some of the frames' times, including the first and last.
        centre: Centre of all positions at all times, shape (3,), m.
        size: Distance from the centre within which three quarters of all positions lie, at least 1, m.
        last: Last finite position of each vehicle, then of each q*, shape (V + N, 3), m.
        unfollowed: Time from which the camera no longer follows each, shape (V + N,), s. Infinite if it always does.
        left: Position of each at that time, shape (V + N, 3), m.
    """

    survey: Samples
    centre: FloatArray
    size: float
    last: FloatArray
    unfollowed: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, film: Film, times: FloatArray) -> "Extent":
        """Measure the extent of a video with frames at these times."""
        count = min(len(times), _SURVEYED, max(_SURVEYED_POSITIONS // film.vehicles, 2))
        survey = film.run.at(times[np.linspace(0, len(times) - 1, count).round().astype(np.int64)])
        points = np.concatenate([survey.positions, survey.harmonic_extension], axis=1)
        finite: BoolArray = np.isfinite(points).all(axis=-1)
        known = survey.positions[finite[:, : film.vehicles]]
        centre: FloatArray = np.median(known, axis=0) if len(known) else np.zeros(3)
        size = max(float(np.quantile(np.abs(known - centre).max(axis=-1), 0.75)), 1.0) if len(known) else 1.0
        distance = np.where(finite, np.abs(points - centre).max(axis=-1), np.inf)
        outlier = distance > OUTLIER_FACTOR * size
        near = (distance <= UNFOLLOW_FACTOR * size) & ~np.logical_or.accumulate(outlier, axis=0)

        def last(condition: BoolArray) -> tuple[FloatArray, FloatArray]:
            """When and where each point last met a condition; before all times and at the centre if it never did."""
            row, ever = len(points) - 1 - np.argmax(condition[::-1], axis=0), np.any(condition, axis=0)
            place = np.where(np.expand_dims(ever, 1), points[row, np.arange(points.shape[1])], centre)
            return np.where(ever, survey.time[row], -np.inf), place

        left_at, left = last(near)
        return cls(survey, centre, size, last(finite)[1], np.where(outlier.any(axis=0), left_at, np.inf), left)

    def drawable(self, samples: Samples) -> Samples:
        """Make every position and attitude one that can be drawn.

        A vehicle without a position stays where it was last; one that is absurdly far goes no farther; an attitude
        that is not known is upright.
        """
        limit, vehicles = OUTLIER_FACTOR * self.size, samples.positions.shape[1]

        def confined(points: FloatArray, last: FloatArray) -> FloatArray:
            known = np.where(np.isfinite(points).all(axis=-1, keepdims=True), points, last)
            return np.clip(known, self.centre - limit, self.centre + limit)

        upright = np.where(np.isfinite(samples.quaternions).all(axis=-1, keepdims=True), samples.quaternions, UPRIGHT)
        return replace(
            samples,
            positions=confined(samples.positions, self.last[:vehicles]),
            harmonic_extension=confined(samples.harmonic_extension, self.last[vehicles:]),
            quaternions=upright,
        )

    def followed(self, samples: Samples) -> FloatArray:
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
    positions: FloatArray
    quaternions: FloatArray
    harmonic_extension: FloatArray
    error: float
    trail: FloatArray
    trail_time: FloatArray


_READ = 256  # maximum number of frames read together
_READ_POSITIONS = 25_600  # maximum number of positions in these frames

# Pieces of a trail: the minimum per vehicle, whatever the budget of all vehicles, and the maximum in a short trail.
TRAIL_PIECES = (4, 48)
PIECES_PER_SECOND = 8  # in a long trail
TRAIL_BUDGET = 2000


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
        self.step = max(1, min(_READ, _READ_POSITIONS // film.vehicles))
        self.trail = min(options.trail, film.span[1] - film.span[0])
        most = max(TRAIL_PIECES[1], int(PIECES_PER_SECOND * self.trail))
        self._pieces = max(TRAIL_PIECES[0], min(most, TRAIL_BUDGET // film.vehicles)) if self.trail > 0 else 0
        self._chunk = -1

    def chunk(self, number: int) -> Samples:
        """Read `step` consecutive frames, made drawable; there are `len(times) / step` such chunks."""
        return self.extent.drawable(self.film.run.at(self.times[number * self.step : (number + 1) * self.step]))

    def followed(self, number: int) -> FloatArray:
        """Return what the camera keeps in view in a chunk, (F, V + N, 3), m; absent agents are where a target is."""
        samples, film = self.chunk(number), self.film
        points = self.extent.followed(samples)
        for row, time in enumerate(samples.time.tolist() if film.stages else []):
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

    def _joints(self, times: FloatArray) -> FloatArray:
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
