"""What a video is drawn from: the record of a finished run, and how the viewer wants to see it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mjsheaf.errors import InputError
from mjsheaf.video.series import FloatArray, IntArray, Series

QUALITIES = ("good", "draft")
Edge = tuple[int, int, Literal["communication", "sensing"]]


@dataclass(frozen=True)
class Film:
    """A finished run, ready to be drawn. T samples, V vehicles: N agents first, then the targets.

    Positions, attitudes, q* and the error may be arrays, or blocks that are read when they are drawn: then the video of
    a long run takes no more memory than that of a short one.

    Attributes:
        name: the scenario, drawn as the title.
        subtitle: one line under the title, such as "physics, gain 10".
        time: time of each sample, increasing. Shape (T,), in s.
        agent_ids: labels of the N agents.
        target_ids: labels of the V - N targets.
        positions: position of each vehicle's body frame. Shape (T, V, 3), in m.
        quaternions: attitude of each vehicle, w x y z. Shape (T, V, 4).
        qpos_address: where each vehicle's free joint begins in qpos. Shape (V,).
        body_id: the body that has that free joint. Shape (V,).
        harmonic_extension: where each agent should be, q*. Shape (T, N, 3), in m.
        group: index of each vehicle's group, which gives its colour. Shape (V,).
        group_names: names of the G groups, for the legend.
        colours: colour of each group, RGB in 0..1. Shape (G, 3).
        edges: pairs of vehicles (i, j, kind) that exchange states or see each other.
        error_name: the error shown beside the picture, such as "mean |eta|".
        error: that error over time. Shape (T,), in error_unit.
        error_unit: its unit, such as "m".
        error_range: lowest and highest value of the curve's axis, above 0; None takes them from the error.
        surface: the plane that the model has, if any; what is off it gets a stem to it.
        surface_height: z of that plane, in m.
    """

    name: str
    subtitle: str
    time: FloatArray
    agent_ids: list[str]
    target_ids: list[str]
    positions: Series
    quaternions: Series
    qpos_address: IntArray
    body_id: IntArray
    harmonic_extension: Series
    group: IntArray
    group_names: list[str]
    colours: FloatArray
    edges: Sequence[Edge]
    error_name: str
    error: Series
    error_unit: str
    surface: Literal["water", "ground", "none"] = "none"
    surface_height: float = 0.0
    error_range: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check that the arrays fit together.

        Raises:
            InputError: naming the array that does not, and the shape it should have.
        """
        samples, agents, vehicles, groups = len(self.time), self.agents, self.vehicles, len(self.group_names)
        expected = {
            "time": (max(samples, 1),),
            "positions": (samples, vehicles, 3),
            "quaternions": (samples, vehicles, 4),
            "qpos_address": (vehicles,),
            "body_id": (vehicles,),
            "harmonic_extension": (samples, agents, 3),
            "group": (vehicles,),
            "colours": (groups, 3),
            "error": (samples,),
        }
        for name, shape in expected.items():
            value = getattr(self, name)
            actual = tuple(value.shape) if hasattr(value, "shape") else np.shape(value)
            if actual != shape:
                raise InputError(f"film.{name} has shape {actual}; it must be {shape}")
        if vehicles == 0:
            raise InputError("film has no vehicles; there must be at least one agent or target")
        if not np.all(np.diff(self.time) > 0) or not np.all(np.isfinite(self.time)):
            raise InputError("film.time must be finite and increasing")
        if np.any((self.group < 0) | (self.group >= groups)):
            raise InputError(f"film.group must be between 0 and {groups - 1}, an index into group_names")
        for i, j, kind in self.edges:
            if not (0 <= i < vehicles and 0 <= j < vehicles) or kind not in ("communication", "sensing"):
                raise InputError(
                    f"film.edges has ({i}, {j}, {kind!r}); an edge joins two vehicles below {vehicles} "
                    "and its kind is 'communication' or 'sensing'"
                )

    def loaded(self) -> "Film":
        """The same film with all of it in memory."""
        names = ("positions", "quaternions", "harmonic_extension", "error")
        return replace(self, **{name: getattr(self, name)[:] for name in names})

    @property
    def agents(self) -> int:
        """Number of agents, N."""
        return len(self.agent_ids)

    @property
    def vehicles(self) -> int:
        """Number of vehicles, V: agents and targets."""
        return len(self.agent_ids) + len(self.target_ids)


@dataclass(frozen=True)
class VideoOptions:
    """How the viewer wants to see a run.

    Attributes:
        width: frame width, even, 64 to 7680, in pixels.
        height: frame height, even, 64 to 7680, in pixels.
        fps: frames in a second of video, 1 to 240.
        speed: simulated seconds in a second of video, 0.001 to 1000.
        azimuth: direction in which the camera looks, about the z axis from x, in degrees.
        elevation: its angle above the horizon, in degrees; negative looks down.
        distance: from the camera to the middle of the team, in m; None keeps the whole team in view.
        trail: how far back a vehicle's trail goes, in simulated s; 0 draws none.
        vehicle_scale: how many times larger than life vehicles are drawn.
        quality: 'good', or 'draft' for a quick look: the scene is drawn with half as many pixels each way and hard
            edges, and enlarged; the writing is as sharp as ever.
    """

    width: int = 1280
    height: int = 720
    fps: float = 30
    speed: float = 1.0
    azimuth: float = -60.0
    elevation: float = -35.0
    distance: float | None = None
    trail: float = 6.0
    vehicle_scale: float = 1.0
    quality: Literal["good", "draft"] = "good"

    @property
    def drawn(self) -> tuple[int, int]:
        """Width and height with which the scene is drawn, in pixels."""
        part = 2 if self.quality == "draft" else 1
        return -(-self.width // part), -(-self.height // part)

    @property
    def drawn_unit(self) -> float:
        """As `unit`, of the scene as it is drawn."""
        return self.unit * self.drawn[1] / self.height

    @property
    def unit(self) -> float:
        """Pixels of this frame in one of a 1000x720 frame, for which sizes of writing and lines are given."""
        return min(self.width / 1000, self.height / 720)

    def __post_init__(self) -> None:
        """Check every option.

        Raises:
            InputError: naming the option and what is expected.
        """
        for name in ("width", "height"):
            value = getattr(self, name)
            if not isinstance(value, int) or value % 2 or not 64 <= value <= 7680:
                raise InputError(f"video {name} is {value}; it must be an even number from 64 to 7680")
        for name, low, high in (
            ("fps", 1.0, 240.0),
            ("speed", 1e-3, 1e3),
            ("azimuth", -360.0, 360.0),
            ("elevation", -90.0, 90.0),
            ("trail", 0.0, 1e6),
            ("vehicle_scale", 1e-3, 1e4),
        ):
            _check_range(name, getattr(self, name), low, high)
        if self.quality not in QUALITIES:
            raise InputError(f"video quality is {self.quality!r}; it must be {' or '.join(QUALITIES)}")
        if self.distance is not None:
            _check_range("distance", self.distance, 1e-3, 1e6)


def _check_range(name: str, value: float, low: float, high: float) -> None:
    """Raise InputError if an option is out of its range."""
    # Written so that NaN, which compares false with everything, is refused too.
    if not low <= value <= high:
        raise InputError(f"video {name} is {value}; it must be between {low:g} and {high:g}")
