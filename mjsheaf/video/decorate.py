"""What is drawn into the scene beside the vehicles: trails, edges, where each agent should be, depth.

Lines are MuJoCo's line geoms: they keep their width in pixels at any distance, and in software GL a thousand
of them cost what a few dozen capsules do. Everything else is sized to look as large at any distance.
"""

import mujoco
import numpy as np
import numpy.typing as npt

from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, FloatArray, VideoOptions
from mjsheaf.video.sampling import Moment, between

Rgba = npt.NDArray[np.float32]  # shape (..., 4), as MuJoCo's geoms have it

COMMUNICATION: Rgba = np.array([0.93, 0.96, 1.0, 0.4], np.float32)
SENSING: Rgba = np.array([1.0, 0.86, 0.25, 0.9], np.float32)

# Numbers of lines are limited, as each costs ten microseconds. The first of a pair is the least for one vehicle or
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
ORIGIN = np.zeros(3)


class Decorator:
    """Adds a run's decoration to a scene, frame by frame.

    Attributes:
        most_geoms: no frame adds more geoms than this.
    """

    def __init__(self, film: Film, options: VideoOptions) -> None:
        self._film = film
        self._colours = film.colours[film.group].astype(np.float32)  # (V, 3)
        self._unit = options.unit
        self._height = options.height
        self._trail = min(options.trail, float(film.time[-1] - film.time[0]))
        wanted = max(TRAIL_PIECES[1], int(PIECES_PER_SECOND * self._trail))
        self._pieces = max(TRAIL_PIECES[0], min(wanted, TRAIL_BUDGET // film.vehicles)) if self._trail > 0 else 0
        self._communication = _pairs(film, "communication")
        self._sensing = _pairs(film, "sensing")
        self._dashes = int(np.clip(DASH_BUDGET // max(len(self._sensing), 1), *DASHES))
        # Trails, dashes, edges; then for a vehicle at most a stem, its foot, a ball at q* and a line to it.
        self.most_geoms = (
            film.vehicles * (self._pieces + 1)
            + len(self._sensing) * self._dashes
            + len(self._communication)
            + 4 * film.vehicles
        )

    def add(self, scene: mujoco.MjvScene, moment: Moment, view: View) -> None:
        """Add everything for one frame."""
        self._add_stems(scene, moment, view)
        self._add_trails(scene, moment)
        self._add_edges(scene, moment, view)
        self._add_harmonic_extension(scene, moment, view)

    def _add_trails(self, scene: mujoco.MjvScene, moment: Moment) -> None:
        """Show where each vehicle was; older pieces fade."""
        if not self._pieces:
            return
        # The joints stand at multiples of one interval, so that a trail does not shiver as time goes on.
        interval = self._trail / self._pieces
        newest = np.ceil(moment.time / interval) - 1
        times = np.append((newest - np.arange(self._pieces, -1, -1)) * interval, moment.time)
        times = np.unique(np.clip(times, max(self._film.time[0], moment.time - self._trail), None))
        joints = between(self._film, self._film.positions, times)
        age = (moment.time - (times[:-1] + times[1:]) / 2) / self._trail
        alpha = 0.9 * (1 - age) ** 1.5
        width = 2.0 * self._unit
        for starts, ends, opacity in zip(joints[:-1], joints[1:], alpha, strict=True):
            for start, end, rgba in zip(starts, ends, self._with_alpha(opacity), strict=True):
                _line(scene, start, end, width, rgba)

    def _add_edges(self, scene: mujoco.MjvScene, moment: Moment, view: View) -> None:
        """Show who talks to whom (thin), and who sees whom (dashed)."""
        for i, j in self._communication:
            _line(scene, moment.positions[i], moment.positions[j], 1.0 * self._unit, COMMUNICATION)
        size = self._size(view)
        for i, j in self._sensing:
            start, along = moment.positions[i], moment.positions[j] - moment.positions[i]
            wanted = float(np.linalg.norm(along)) / (2 * DASH * size)
            dashes = int(np.clip(round(wanted), DASHES[0], self._dashes))
            begin = start + (np.arange(dashes)[:, None] + 0.25) / dashes * along
            for first, last in zip(begin, begin + 0.5 / dashes * along, strict=True):
                _line(scene, first, last, 1.5 * self._unit, SENSING)

    def _add_harmonic_extension(self, scene: mujoco.MjvScene, moment: Moment, view: View) -> None:
        """Add a translucent ball where each agent should be, and a line to it from where it is."""
        radius = MARKER * min(1.0, (SMALL_TEAM / max(self._film.agents, 1)) ** 0.5) * self._size(view)
        ball, link = self._with_alpha(0.55), self._with_alpha(0.8)
        for agent, goal in enumerate(moment.harmonic_extension):
            _ball(scene, goal, radius, ball[agent])
            if np.linalg.norm(goal - moment.positions[agent]) > radius:
                _line(scene, moment.positions[agent], goal, 1.5 * self._unit, link[agent])

    def _add_stems(self, scene: mujoco.MjvScene, moment: Moment, view: View) -> None:
        """Draw a line straight to the surface from what is off it: without it heights cannot be read."""
        if self._film.surface == "none":
            return
        size, level = self._size(view), self._film.surface_height
        for position, rgba in zip(moment.positions, self._with_alpha(0.5), strict=True):
            if abs(position[2] - level) > STEM * size:
                foot = np.array([position[0], position[1], level])
                _line(scene, position, foot, 1.0 * self._unit, rgba)
                _ball(scene, foot, FOOT * size, rgba)

    def _size(self, view: View) -> float:
        """Return what a size of 1 is at the team's middle, in m."""
        return self._unit * view.metres_per_pixel(self._height)

    def _with_alpha(self, alpha: float) -> Rgba:
        """Return every vehicle's colour with one opacity. Shape (V, 4)."""
        return np.column_stack([self._colours, np.full(len(self._colours), alpha, np.float32)])


def _pairs(film: Film, kind: str) -> list[tuple[int, int]]:
    """Return the edges of one kind; parallel edges are drawn once."""
    return sorted({(i, j) for i, j, edge_kind in film.edges if edge_kind == kind})


def _line(scene: mujoco.MjvScene, start: FloatArray, end: FloatArray, width: float, rgba: Rgba) -> None:
    """Add a line; width in pixels."""
    geom = _new(scene, mujoco.mjtGeom.mjGEOM_LINE.value, ORIGIN, rgba)
    if geom is not None:
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_LINE.value, width, start, end)


def _ball(scene: mujoco.MjvScene, centre: FloatArray, radius: float, rgba: Rgba) -> None:
    """Add a ball; radius in m."""
    geom = _new(scene, mujoco.mjtGeom.mjGEOM_SPHERE.value, np.full(3, radius), rgba)
    if geom is not None:
        geom.pos = centre
        geom.emission = 0.6  # to keep its group's colour in the shade


def _new(scene: mujoco.MjvScene, kind: int, size: FloatArray, rgba: Rgba) -> mujoco.MjvGeom | None:
    """Take the scene's next geom; None where it is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, size, ORIGIN, IDENTITY, rgba)
    scene.ngeom += 1
    return geom
