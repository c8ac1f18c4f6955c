"""What is drawn into the scene beside the vehicles: trails, edges, where each agent should be, depth.

Balls are geoms of MuJoCo's scene, sized to look as large at any distance. Lines keep their width in pixels; there are
a thousand of them, and they are drawn apart (see lines).
"""

import mujoco
import numpy as np
import numpy.typing as npt

from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, VideoOptions
from mjsheaf.video.lines import Lines
from mjsheaf.video.sampling import Moment, between
from mjsheaf.video.series import FloatArray, IntArray

Rgba = npt.NDArray[np.float32]  # shape (..., 4), as MuJoCo's geoms have it

COMMUNICATION: Rgba = np.array([0.93, 0.96, 1.0, 0.4], np.float32)
SENSING: Rgba = np.array([1.0, 0.86, 0.25, 0.9], np.float32)

# Numbers of lines are limited, as each must be drawn. The first of a pair is the least for one vehicle or
# edge, whatever the budget for all of them together.
TRAIL_PIECES = (4, 48)  # pieces in a trail that is not long
PIECES_PER_SECOND = 8  # in a long one
TRAIL_BUDGET = 2000
DASHES = (2, 40)  # on one sensing edge
DASH_BUDGET = 800

# Sizes in pixels of a 1000x720 frame, at the team's middle.
DASH = 10.0  # length of a dash and of the gap after it
MARKER = 10.5  # radius of the ball at q*
SMALL_TEAM = 50  # agents; in a larger team the balls are smaller, not to cover each other
FOOT = 2.5  # radius of the ball at the foot of a stem
STEM = 17.0  # shortest stem worth drawing

IDENTITY = np.eye(3).ravel()


class Decorator:
    """Adds a run's decoration to a scene, frame by frame.

    Attributes:
        most_geoms: no frame adds more geoms than this.
    """

    def __init__(self, film: Film, options: VideoOptions) -> None:
        self._film = film
        self._colours = film.colours[film.group].astype(np.float32)  # (V, 3)
        self._unit = options.drawn_unit
        self._height = options.drawn[1]
        self._trail = min(options.trail, float(film.time[-1] - film.time[0]))
        wanted = max(TRAIL_PIECES[1], int(PIECES_PER_SECOND * self._trail))
        self._pieces = max(TRAIL_PIECES[0], min(wanted, TRAIL_BUDGET // film.vehicles)) if self._trail > 0 else 0
        self._known: dict[int, FloatArray] = {}  # joints of the trails of the last frame
        self._communication = _pairs(film, "communication")
        self._sensing = _pairs(film, "sensing")
        self._dashes = int(np.clip(DASH_BUDGET // max(len(self._sensing), 1), *DASHES))
        self.most_geoms = 2 * film.vehicles  # for a vehicle at most the foot of its stem and a ball at q*

    def add(self, scene: mujoco.MjvScene, moment: Moment, view: View) -> list[Lines]:
        """Add one frame's balls to the scene and return its lines."""
        size = self._size(view)
        radius = MARKER * min(1.0, (SMALL_TEAM / max(self._film.agents, 1)) ** 0.5) * size
        for goal, rgba in zip(moment.harmonic_extension, self._with_alpha(0.55), strict=False):
            _ball(scene, goal, radius, rgba)
        lines = [self._trails(moment), self._edges(moment), self._dashed(moment, size), self._links(moment, radius)]
        return [*self._stems(scene, moment, size), *lines]

    def _trails(self, moment: Moment) -> Lines:
        """Show where each vehicle was; older pieces fade."""
        if not self._pieces:
            return Lines.of(np.zeros((0, 3)), np.zeros((0, 3)), COMMUNICATION, 1.0)
        # The joints stand at multiples of one interval, so that a trail does not shiver as time goes on.
        interval = self._trail / self._pieces
        oldest = max(float(self._film.time[0]), moment.time - self._trail)
        numbers = np.arange(np.floor(oldest / interval) + 1, np.ceil(moment.time / interval)).astype(int).tolist()
        times = np.array([oldest, *(k * interval for k in numbers), moment.time])
        ends = between(self._film, self._film.positions, times[:1])
        joints = np.concatenate([ends, *self._joints(numbers, interval), moment.positions[None]])
        age = (moment.time - (times[:-1] + times[1:]) / 2) / self._trail
        rgba = np.empty((len(age), self._film.vehicles, 4), np.float32)
        rgba[..., :3] = self._colours
        rgba[..., 3] = 0.9 * (1 - age[:, None]) ** 1.2
        starts, ends = joints[:-1].reshape(-1, 3), joints[1:].reshape(-1, 3)
        return Lines.of(starts, ends, rgba.reshape(-1, 4), 2.0 * self._unit)

    def _joints(self, numbers: list[int], interval: float) -> list[FloatArray]:
        """Where vehicles were at these multiples of the interval, each of shape (1, V, 3); most were drawn before."""
        new = [k for k in numbers if k not in self._known]
        if new:
            found = between(self._film, self._film.positions, np.array(new) * interval)
            self._known.update((k, found[n : n + 1]) for n, k in enumerate(new))
        self._known = {k: self._known[k] for k in numbers}
        return list(self._known.values())

    def _edges(self, moment: Moment) -> Lines:
        """Show who talks to whom."""
        tails, heads = self._communication.T
        return Lines.of(moment.positions[tails], moment.positions[heads], COMMUNICATION, 1.0 * self._unit)

    def _dashed(self, moment: Moment, size: float) -> Lines:
        """Show who sees whom."""
        starts, along = moment.positions[self._sensing[:, 0]], np.diff(moment.positions[self._sensing], axis=1)[:, 0]
        wanted = np.linalg.norm(along, axis=1) / (2 * DASH * size)
        dashes = np.clip(np.round(wanted), DASHES[0], self._dashes).astype(int)
        edge = np.repeat(np.arange(len(dashes)), dashes)
        number = np.arange(len(edge)) - np.repeat(np.cumsum(dashes) - dashes, dashes)
        begin, count, step = (number + 0.25)[:, None], dashes[edge, None], along[edge]
        first = starts[edge] + begin / count * step
        return Lines.of(first, first + 0.5 / count * step, SENSING, 1.5 * self._unit)

    def _links(self, moment: Moment, radius: float) -> Lines:
        """Join each agent to the ball that shows where it should be, unless it is there."""
        places = moment.positions[: self._film.agents]
        away = np.linalg.norm(moment.harmonic_extension - places, axis=1) > radius
        rgba = self._with_alpha(0.8)[: self._film.agents][away]
        return Lines.of(places[away], moment.harmonic_extension[away], rgba, 1.5 * self._unit)

    def _stems(self, scene: mujoco.MjvScene, moment: Moment, size: float) -> list[Lines]:
        """Draw a line straight to the surface from what is off it: without it heights cannot be read."""
        if self._film.surface == "none":
            return []
        level = self._film.surface_height
        off = np.abs(moment.positions[:, 2] - level) > STEM * size
        feet = moment.positions[off] * [1.0, 1.0, 0.0] + [0.0, 0.0, level]
        rgba = self._with_alpha(0.5)[off]
        for foot, colour in zip(feet, rgba, strict=True):
            _ball(scene, foot, FOOT * size, colour)
        return [Lines.of(moment.positions[off], feet, rgba, 1.0 * self._unit)]

    def _size(self, view: View) -> float:
        """Return what a size of 1 is at the team's middle, in m."""
        return self._unit * view.metres_per_pixel(self._height)

    def _with_alpha(self, alpha: float) -> Rgba:
        """Return every vehicle's colour with one opacity. Shape (V, 4)."""
        return np.column_stack([self._colours, np.full(len(self._colours), alpha, np.float32)])


def _pairs(film: Film, kind: str) -> IntArray:
    """Return the edges of one kind, shape (n, 2); parallel edges are drawn once."""
    pairs = sorted({(i, j) for i, j, edge_kind in film.edges if edge_kind == kind})
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _ball(scene: mujoco.MjvScene, centre: FloatArray, radius: float, rgba: Rgba) -> None:
    """Add a ball; radius in m. Nothing is added to a scene that is full."""
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_SPHERE.value, np.full(3, radius), centre, IDENTITY, rgba)
    geom.emission = 0.6  # to keep its group's colour in the shade
    scene.ngeom += 1
