"""The scene (vehicles, trails, edges, desired positions, depth) and its rendering.

Balls are geoms of MuJoCo's scene, sized to look as large at any distance. Lines keep their width in pixels. There are a
thousand of them, each of which would take twenty microseconds as a geom: they are drawn apart, in one call of OpenGL.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from ctypes import c_void_p
from dataclasses import dataclass
from typing import Any, get_args

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import MjsheafError
from mjsheaf.law.obstacles import HALF_SPACE, ObstacleArrays
from mjsheaf.show.played import DrawnEdge, EdgeKind, Sea
from mjsheaf.show.solids import obstacle_places, obstacle_solids
from mjsheaf.show.style import OBSTACLE, speed_colours
from mjsheaf.video import camera
from mjsheaf.video.camera import View
from mjsheaf.video.film import Film, Moment, VideoOptions
from mjsheaf.video.gl import open_context

Float32Array = NDArray[np.float32]

COMMUNICATION: Float32Array = np.array([0.93, 0.96, 1.0, 0.4], np.float32)  # RGBA in 0..1, like MuJoCo's geoms
HEADS: Float32Array = np.array([0.93, 0.96, 1.0, 0.9], np.float32)
SENSING: Float32Array = np.array([1.0, 0.86, 0.25, 0.9], np.float32)

RESTRAINED: Float32Array = np.array([1.0, 0.2, 0.6, 0.6], np.float32)
FACE = 0.05  # half the thickness at which the face of a half-space is drawn, m

ABSENT: Float32Array = np.array([0.6, 0.6, 0.6, 1.0], np.float32)

HEAD_AT = 0.65  # place of the arrowhead's tip on an edge, as a fraction: vehicles may cover the end

ARROW_REACH = 9  # number of arrows from the centre of the picture to where they fade

SIZES = {
    "arrow spacing": 75.0,  # between the arrows of a flow
    "dash": 10.0,  # length of a dash and of the gap after it
    "foot": 2.5,  # radius of the ball at the foot of a vertical line
    "halo": 11.0,  # radius about an agent that the safety filter restrains
    "head": 14.0,  # largest arrowhead of an edge
    "shortest vertical": 17.0,  # shortest vertical line
}
"""Sizes in pixels of a 1000x720 frame, at the team's centre."""

WIDTHS = {
    "arrow": 2.0,
    "edge": 1.0,
    "goal": 1.5,
    "head": 2.0,
    "restraint": 4.0,
    "sensing": 1.5,
    "stem": 1.0,
    "trail": 2.0,
}
"""Widths of lines in pixels of a 1000x720 frame."""


@dataclass(frozen=True)
class Lines:
    """Straight lines of one width.

    Attributes:
        ends: where each begins and ends. Shape (n, 2, 3), in m.
        rgba: colour and opacity of each. Shape (n, 4), 0..1.
        width: Width in pixels.
        dash: Length of a dash and of the gap after it, in pixels; 0 for solid lines.
    """

    ends: Float32Array
    rgba: Float32Array
    width: float
    dash: float = 0.0

    @classmethod
    def of(cls, starts: ArrayLike, ends: ArrayLike, rgba: ArrayLike, width: float, dash: float = 0.0) -> "Lines":
        """Join starts and ends, each of shape (n, 3); one colour (4,) is for all."""
        both = np.stack([np.asarray(starts), np.asarray(ends)], axis=1, dtype=np.float32, casting="same_kind")
        return cls(both, np.broadcast_to(np.asarray(rgba, np.float32), (len(both), 4)), width, dash)


class Decorator:
    """Adds a run's decoration to a scene, frame by frame.

    Attributes:
        most_geoms: no frame adds more geoms than this.
    """

    def __init__(self, film: Film, options: VideoOptions, owners: Sequence[int] = ()) -> None:
        """Prepare the scene. `owners`: vehicle of each geom of the model, or -1, for drawing absent ones in grey."""
        self._film, self._owners = film, owners
        self._colours = film.colours[film.group].astype(np.float32)  # (V, 3)
        self._height = options.drawn[1]
        self._unit = options.unit * self._height / options.height
        self._trail = min(options.trail, film.span[1] - film.span[0])
        self._edges = [[_pairs(stage.edges, kind) for kind in get_args(EdgeKind)] for stage in film.stages]
        self.most_geoms = 3 * film.vehicles  # per vehicle: the foot of its vertical line, a ball at q* and a halo
        self.most_geoms += 0 if film.obstacles is None else len(film.obstacles.kind)
        self._spacing = 0.0

    def lay_out_arrows(self, view: View) -> None:
        """Choose the spacing of arrows for one of the camera's views."""
        self._spacing = SIZES["arrow spacing"] * self._unit * view.metres_per_pixel(self._height)

    def add(self, scene: mujoco.MjvScene, moment: Moment, view: View) -> list[Lines]:
        """Add one frame's balls to the scene and return its lines."""
        communication, one_way, sensing = self._edges[self._film.stage(moment.time)]
        absent = self._film.absent(moment.time)
        for geom in scene.geoms[: scene.ngeom] if absent else ():  # vehicles of absent agents are grey
            own = geom.objtype == mujoco.mjtObj.mjOBJ_GEOM.value and 0 <= geom.objid < len(self._owners)
            if own and self._owners[geom.objid] in absent:
                geom.matid, geom.rgba = -1, ABSENT
        size = self._unit * view.metres_per_pixel(self._height)  # of a pixel of the reference frame, in m
        # Balls of more than 50 agents shrink, so that they do not cover each other.
        radius = (6.5 if self._film.seas else 10.5) * min(1.0, (50 / max(self._film.agents, 1)) ** 0.5) * size
        there = [i for i in range(self._film.agents) if i not in absent]
        # MuJoCo's transparent geoms write no depth, so a sea, which is drawn later, would cover them.
        rgba = self._with_alpha(1.0 if self._film.seas else 0.55)[there]
        _add_balls(scene, moment.harmonic_extension[there], radius, rgba)
        if self._film.obstacles is not None:
            _add_obstacles(scene, self._film.obstacles, moment.time, view)
        stems = [] if self._film.surface == "none" else [self._stems(scene, moment, size)]
        tails, heads = (moment.positions[ends] for ends in np.concatenate([communication, one_way]).T)
        edges = Lines.of(tails, heads, COMMUNICATION, WIDTHS["edge"] * self._unit)
        media = [self._arrows(moment, view, k) for k in range(len(self._film.media))] if self._spacing else []
        links = self._links(moment, radius)
        pointers = self._pointers(scene, moment, one_way, view)
        return [*media, *stems, self._trails(moment), edges, *pointers, self._dashed(moment, sensing), links]

    def _arrows(self, moment: Moment, view: View, number: int) -> Lines:
        """Draw a medium's velocity on a fixed horizontal grid, at the surface or at the height of its vehicles.

        Colour and length show the speed. Arrows fade towards the edge of the picture.
        """
        medium = self._film.media[number]
        steps = self._spacing * np.arange(-ARROW_REACH, ARROW_REACH + 1)
        # The grids of two media are offset against each other.
        x, y = (self._spacing * (round(at / self._spacing) + 0.5 * number) + steps for at in view.lookat[:2])
        height = self._film.surface_height if medium.level else float(np.median(moment.positions[medium.vehicles, 2]))
        places = np.stack([*np.meshgrid(x, y), np.full((len(x), len(y)), height)], axis=-1).reshape(-1, 3)
        velocity = medium.at(places, moment.time)
        speed = np.linalg.norm(velocity, axis=1)
        away = np.linalg.norm(places[:, :2] - view.lookat[:2], axis=1) / (ARROW_REACH * self._spacing)
        # The slowest flow has no arrow.
        shown = np.isfinite(speed) & (speed > 0.03 * medium.top) & (away < 1.0)
        places, velocity, speed, away = places[shown], velocity[shown], speed[shown], away[shown]
        along = velocity / speed[:, None]
        fraction = np.minimum(speed / medium.top, 1.0)
        length = 0.95 * self._spacing * fraction[:, None]
        aside = np.cross(along, [0.0, 0.0, 1.0])
        tip, barb = places + along * length / 2.0, 0.35 * np.minimum(length, 0.5 * self._spacing)
        starts = np.concatenate([places - along * length / 2.0, tip, tip])
        ends = np.concatenate([tip, *(tip - barb * (along + 0.5 * side * aside) for side in (-1.0, 1.0))])
        rgba = np.tile(speed_colours(medium.scale, fraction), (3, 1))
        rgba[:, 3] *= np.tile(1.0 - away**2, 3)
        return Lines.of(starts, ends, rgba, WIDTHS["arrow"] * self._unit)

    def _trails(self, moment: Moment) -> Lines:
        """Show where each vehicle was; older pieces fade."""
        trail, times = moment.trail, moment.trail_time
        age = (moment.time - (times[:-1] + times[1:]) / 2) / max(self._trail, 1e-12)
        rgba = np.empty((len(age), self._film.vehicles, 4), np.float32)
        rgba[..., :3] = self._colours
        rgba[:, sorted(self._film.absent(moment.time)), :3] = ABSENT[:3]
        rgba[..., 3] = 0.9 * (1 - age[:, None]) ** 1.2
        return Lines.of(
            trail[:-1].reshape(-1, 3), trail[1:].reshape(-1, 3), rgba.reshape(-1, 4), WIDTHS["trail"] * self._unit
        )

    def _dashed(self, moment: Moment, sensing: IntArray) -> Lines:
        """Show who sees whom; more than 60 edges are drawn fainter."""
        rgba = SENSING * np.array([1, 1, 1, min(1.0, (60 / max(len(sensing), 1)) ** 0.5)], np.float32)
        tails, heads = moment.positions[sensing.T]
        return Lines.of(tails, heads, rgba, WIDTHS["sensing"] * self._unit, SIZES["dash"] * self._unit)

    def _pointers(self, scene: mujoco.MjvScene, moment: Moment, one_way: IntArray, view: View) -> list[Lines]:
        """Draw arrowheads of one-way edges, and a halo and a line for each agent that the filter restrains."""
        size = self._unit * view.metres_per_pixel(self._height)
        found = [self._heads(moment, one_way, view, size)] if len(one_way) else []
        if self._film.restraints is not None:
            starts, ends = self._film.restraints(moment.time, moment.positions)
            _add_balls(scene, starts, SIZES["halo"] * size, RESTRAINED)
            found.append(Lines.of(starts, starts + 0.4 * (ends - starts), RESTRAINED, WIDTHS["restraint"] * self._unit))
        return found

    def _heads(self, moment: Moment, one_way: IntArray, view: View, size: float) -> Lines:
        """Draw an arrowhead on each edge towards the agent that is sensed; it faces the camera."""
        tails, along = moment.positions[one_way[:, 0]], np.diff(moment.positions[one_way], axis=1)[:, 0]
        across = np.cross(along, camera.axes(view.azimuth, view.elevation)[2])
        length, width = (np.linalg.norm(way, axis=1, keepdims=True) + 1e-12 for way in (along, across))
        tip, barb = tails + HEAD_AT * along, np.minimum(SIZES["head"] * size, 0.3 * length)
        ends = np.concatenate([tip - barb * (along / length + 0.5 * side * across / width) for side in (-1.0, 1.0)])
        return Lines.of(np.tile(tip, (2, 1)), ends, HEADS, WIDTHS["head"] * self._unit)

    def _links(self, moment: Moment, radius: float) -> Lines:
        """Join each agent to the ball that shows where it should be, unless it is there."""
        places = moment.positions[: self._film.agents]
        away = np.linalg.norm(moment.harmonic_extension - places, axis=1) > radius
        away[sorted(self._film.absent(moment.time))] = False
        rgba = self._with_alpha(0.8)[: self._film.agents][away]
        return Lines.of(places[away], moment.harmonic_extension[away], rgba, WIDTHS["goal"] * self._unit)

    def _stems(self, scene: mujoco.MjvScene, moment: Moment, size: float) -> Lines:
        """Draw a vertical line to the surface from each vehicle off it, which shows its height."""
        level = self._film.surface_height
        off = np.abs(moment.positions[:, 2] - level) > SIZES["shortest vertical"] * size
        feet = moment.positions[off] * [1.0, 1.0, 0.0] + [0.0, 0.0, level]
        rgba = self._with_alpha(0.5)[off]
        _add_balls(scene, feet, SIZES["foot"] * size, rgba)
        return Lines.of(moment.positions[off], feet, rgba, WIDTHS["stem"] * self._unit)

    def _with_alpha(self, alpha: float) -> Float32Array:
        """Return every vehicle's colour with one opacity. Shape (V, 4)."""
        return np.column_stack([self._colours, np.full(len(self._colours), alpha, np.float32)])


def owners_of_geoms(model: mujoco.MjModel, body_id: IntArray) -> list[int]:
    """Return the vehicle of each geom of a model, -1 for none, from the root bodies of the vehicles."""
    vehicle = np.full(model.nbody, -1)
    vehicle[body_id] = np.arange(len(body_id))
    return vehicle[model.body_rootid[model.geom_bodyid]].tolist()


def _pairs(edges: Sequence[DrawnEdge], kind: str) -> IntArray:
    """Return the edges of one kind, shape (n, 2); parallel edges are drawn once."""
    pairs = sorted({(i, j) for i, j, edge_kind in edges if edge_kind == kind})
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _add_geom(
    scene: mujoco.MjvScene,
    shape: mujoco.mjtGeom,
    size: ArrayLike,
    place: Array,
    rgba: Float32Array,
    axes: Array = np.eye(3),  # noqa: B008
) -> Any:
    """Add a geom and return it. The scene has room for `Decorator.most_geoms` of them."""
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, shape.value, np.asarray(size), place, axes.ravel(), rgba)
    scene.ngeom += 1
    return geom


def _add_balls(scene: mujoco.MjvScene, centres: Array, radius: float, rgba: Float32Array) -> None:
    """Add balls about centres (n, 3) of a radius in m, in colours (n, 4) or all in one (4,)."""
    for centre, own in zip(centres, np.broadcast_to(rgba, (len(centres), 4)), strict=True):
        geom = _add_geom(scene, mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, radius), centre, own)
        geom.emission = 0.6  # keeps its group's colour in the shade


_SHAPES = {
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
}


def _add_obstacles(scene: mujoco.MjvScene, obstacles: ObstacleArrays, time: float, view: View) -> None:
    """Add every obstacle where it is at a time in s; of a half-space, its face near the middle of the picture."""
    solids = obstacle_solids(obstacles, FACE, view.distance)
    places = obstacle_places(obstacles, time, view.lookat, FACE)
    for kind, (shape, size, axes), place in zip(obstacles.kind.tolist(), solids, places, strict=True):
        rgba = np.array([*OBSTACLE, 0.35 if kind == HALF_SPACE else 1.0], np.float32)
        _add_geom(scene, _SHAPES[shape], size, place, rgba, axes)


def draw_lines(batches: Sequence[Lines], sea: tuple[Array, Array] | None = None) -> None:
    """Draw lines, and the mesh of a sea before them, over what MuJoCo drew there and behind what is nearer.

    MuJoCo leaves its camera's matrices and its depth test in place; everything that is changed is put back.
    """
    # PyOpenGL loads its library at its first import, which must happen after the context exists: see gl.
    from OpenGL import GL
    from OpenGL.raw.GL.VERSION import GL_1_1 as RAW  # the plain functions keep no reference to arrays

    gl: Any = GL
    changed = gl.GL_ENABLE_BIT | gl.GL_LINE_BIT | gl.GL_COLOR_BUFFER_BIT | gl.GL_CURRENT_BIT | gl.GL_DEPTH_BUFFER_BIT
    gl.glPushAttrib(changed)
    gl.glPushClientAttrib(gl.GL_CLIENT_VERTEX_ARRAY_BIT)
    try:
        for wanted in (gl.GL_LIGHTING, gl.GL_TEXTURE_2D, gl.GL_CULL_FACE):
            gl.glDisable(wanted)
        gl.glEnable(gl.GL_BLEND)
        gl.glEnable(gl.GL_LINE_STIPPLE)
        gl.glBlendFunc(gl.GL_SRC_ALPHA, gl.GL_ONE_MINUS_SRC_ALPHA)
        gl.glDepthMask(gl.GL_FALSE)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, 0)
        gl.glDisableClientState(gl.GL_NORMAL_ARRAY)
        gl.glDisableClientState(gl.GL_TEXTURE_COORD_ARRAY)
        gl.glEnableClientState(gl.GL_VERTEX_ARRAY)
        gl.glEnableClientState(gl.GL_COLOR_ARRAY)
        if sea is not None:  # it hides nothing that is drawn later
            vertices, shades = (np.ascontiguousarray(values, np.float32) for values in sea)
            RAW.glVertexPointer(3, gl.GL_FLOAT, 0, vertices.ctypes.data_as(c_void_p))
            RAW.glColorPointer(4, gl.GL_FLOAT, 0, shades.ctypes.data_as(c_void_p))
            gl.glBindBuffer(gl.GL_ELEMENT_ARRAY_BUFFER, 0)
            corners = TRIANGLES.ctypes.data_as(c_void_p)
            RAW.glDrawElements(gl.GL_TRIANGLES, len(TRIANGLES), gl.GL_UNSIGNED_INT, corners)
        for lines in batches:
            ends = np.ascontiguousarray(lines.ends)
            colours = np.repeat(lines.rgba, 2, axis=0)
            gl.glLineWidth(lines.width)
            # The pattern's sixteen bits are each as long as the factor, eight of them drawn.
            gl.glLineStipple(max(1, round(lines.dash / 8)), 0x00FF if lines.dash else 0xFFFF)
            RAW.glVertexPointer(3, gl.GL_FLOAT, 0, ends.ctypes.data_as(c_void_p))
            RAW.glColorPointer(4, gl.GL_FLOAT, 0, colours.ctypes.data_as(c_void_p))
            gl.glDrawArrays(gl.GL_LINES, 0, 2 * len(ends))
    finally:
        gl.glPopClientAttrib()
        gl.glPopAttrib()


# Software GL draws a frame about three times faster without these.
COSTLY = (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION)


class Renderer:
    """Draws a model's state, and what is added to it, into frames of one size; `close` frees the GL resources."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int, backend: str, extra_geoms: int) -> None:
        """Open a GL context and upload the model's meshes and textures to it; its offscreen buffer is resized.

        Args:
            model: MuJoCo model to draw.
            width, height: Size of the frames, pixels.
            backend: which GL, as `mjsheaf.video.gl.available_backend` returns.
            extra_geoms: how many geoms may be added to the scene in a frame.

        Raises:
            MjsheafError: the driver refuses.
        """
        self._model = model
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.zeros((height, width, 3), np.uint8)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FREE.value
        self._options = mujoco.MjvOption()
        # Geoms, sites, and room for the few more that MuJoCo itself adds (lights, frames, a geom's outline).
        self._scene = mujoco.MjvScene(model, model.ngeom + model.nsite + extra_geoms + 500)
        for flag in COSTLY:
            self._scene.flags[flag.value] = False

        model.vis.global_.offwidth = width
        model.vis.global_.offheight = height
        with ExitStack() as held:
            self._context = open_context(backend, width, height)
            held.callback(self._context.free)
            try:
                self._mjr = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
            except Exception as error:  # MuJoCo and the drivers raise many kinds of exceptions
                raise MjsheafError(f"{backend} cannot draw {width}x{height} pixels: {error}") from error
            held.callback(self._mjr.free)
            held.callback(self._context.make_current)  # the first to be called
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._mjr)
            if (self._mjr.offWidth, self._mjr.offHeight) != (width, height):
                raise MjsheafError(f"{backend} has no offscreen buffer of {width}x{height} pixels")
            self._held = held.pop_all()

    def draw(
        self,
        data: mujoco.MjData,
        view: View,
        decorate: Callable[[mujoco.MjvScene], Sequence[Lines]],
        sea: tuple[Array, Array] | None = None,
    ) -> Image.Image:
        """Draw one frame, RGB.

        Args:
            data: the state, with its kinematics computed.
            view: where the camera is.
            decorate: adds geoms to the scene before it is drawn, and returns lines to draw over it.
            sea: Mesh of a surface to draw between them; see `mesh`.
        """
        # Another renderer may have drawn since: a GL context is current for a whole thread.
        self._context.make_current()
        self._camera.lookat = view.lookat
        self._camera.distance = view.distance
        self._camera.azimuth = view.azimuth
        self._camera.elevation = view.elevation
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, data, self._options, None, self._camera, every, self._scene)
        lines = decorate(self._scene)
        mujoco.mjr_render(self._rectangle, self._scene, self._mjr)
        draw_lines(lines, sea)
        mujoco.mjr_readPixels(self._pixels, None, self._rectangle, self._mjr)
        height, width, _ = self._pixels.shape
        # A copy. The last argument: GL counts rows from the bottom.
        return Image.frombuffer("RGB", (width, height), self._pixels, "raw", "RGB", 0, -1)

    def close(self) -> None:
        """Free the GL resources. Closing twice does nothing."""
        self._held.close()


def enlarge_vehicles(model: mujoco.MjModel, body_id: IntArray, scales: Array | float) -> None:
    """Scale what is drawn of each vehicle about its root body's origin; the model is then for drawing only.

    Args:
        model: changed.
        body_id: root body of each vehicle. Shape (V,).
        scales: how many times larger each becomes, shape (V,), or all of them.
    """
    of_body = np.ones(model.nbody)
    of_body[body_id] = scales
    of_body = of_body[model.body_rootid]  # 1 for bodies that belong to no vehicle
    if (of_body == 1.0).all():
        return
    parts = np.flatnonzero(np.isin(model.body_rootid, body_id) & ~np.isin(np.arange(model.nbody), body_id))
    model.body_pos[parts] *= of_body[parts, None]  # a root body's own place is in qpos
    joints = np.isin(model.jnt_bodyid, parts)
    model.jnt_pos[joints] *= of_body[model.jnt_bodyid[joints], None]
    of_geom, of_site = of_body[model.geom_bodyid], of_body[model.site_bodyid]
    model.geom_pos *= of_geom[:, None]
    model.geom_size *= of_geom[:, None]
    model.geom_rbound *= of_geom
    model.site_pos *= of_site[:, None]
    model.site_size *= of_site[:, None]
    # A mesh's size is in its vertices. A mesh that vehicles share gets the scale of the first one.
    meshes = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_MESH.value) & (of_geom != 1.0))
    own, first = np.unique(model.geom_dataid[meshes], return_index=True)
    for mesh, geom in zip(own, meshes[first], strict=True):
        start = model.mesh_vertadr[mesh]
        model.mesh_vert[start : start + model.mesh_vertnum[mesh]] *= of_geom[geom]


NEAR, FAR = 0.02, 40.0  # clipping planes, as multiples of the camera's shortest and longest distance
FLATNESS = 0.6  # maximum distance of a side from the circle, pixels


def set_detail(model: mujoco.MjModel, views: Sequence[View], radius: float, height: int) -> None:
    """Set how far and how finely a model is drawn, given where the camera is.

    Args:
        model: changed.
        views: The camera at each frame; it decides how large vehicles look.
        radius: Radius of the largest vehicle, m.
        height: Height of the frames, pixels.
    """
    nearest, farthest = (choose(views, key=lambda view: view.distance) for choose in (min, max))
    # MuJoCo's default range follows from the model's first pose, not from this run. The unit is the model's extent.
    model.vis.map.znear = NEAR * nearest.distance / model.stat.extent
    model.vis.map.zfar = FAR * farthest.distance / model.stat.extent
    # Round geoms get only as many sides as are visible, because small round parts can take half the time of a frame.
    # The largest one is assumed to be a third of its vehicle. n sides miss a circle of radius r by r (1 - cos(pi / n)).
    part = max(radius / nearest.metres_per_pixel(height) / 3, 2 * FLATNESS)
    slices = max(int(np.ceil(np.pi / np.arccos(1 - FLATNESS / part))), 12)
    model.vis.quality.numslices = min(model.vis.quality.numslices, slices)
    model.vis.quality.numstacks = min(model.vis.quality.numstacks, slices * 2 // 3)


# -- the sea -----------------------------------------------------------------------------------------------------------

POINTS = 201  # of the grid along x and along y
GRADING = 6.0  # about exp(GRADING) is the ratio of the widest spacing to the finest
DEEP = np.array([0.04, 0.21, 0.33])  # colours, RGB in 0..1: of the water,
CREST = np.array([0.20, 0.50, 0.58])  # of high water, through which light falls,
HORIZON = np.array([0.80, 0.88, 0.94])  # and of the sky, low and high
ZENITH = np.array([0.32, 0.52, 0.76])
SUN = np.array([0.48, 0.36, 0.80])  # unit vector to it


def mesh(sea: Sea, view: View, time: float) -> tuple[Array, Array]:
    """Return a graded grid on the surface about the point that a camera looks at.

    Args:
        sea: The sea.
        view: The camera's view.
        time: Time, s.

    Returns:
        Points, shape (P, P, 3), m, and their colours, RGBA in 0..1, shape (P, P, 4).
    """
    # It reaches 36 distances of the camera far.
    graded = 36.0 * view.distance * np.sinh(np.linspace(-GRADING, GRADING, POINTS)) / np.sinh(GRADING)
    x = view.lookat[0] + graded
    y = view.lookat[1] + graded
    height, slope_x, slope_y = sea.surface(x, y, time)
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), sea.level + height], axis=-1)
    normal = np.stack([-slope_x, -slope_y, np.ones_like(height)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    to_eye = view.lookat - view.distance * camera.axes(view.azimuth, view.elevation)[2] - points
    away = np.linalg.norm(to_eye, axis=-1, keepdims=True)
    to_eye /= away
    # It reflects the sky by Schlick's formula, and the sun; light falls through high water.
    facing = np.clip(np.sum(normal * to_eye, axis=-1, keepdims=True), 0.0, 1.0)
    mirrored = 2.0 * facing * normal - to_eye
    sky = HORIZON + np.clip(mirrored[..., 2:], 0.0, 1.0) * (ZENITH - HORIZON)
    elevation = height / max(4.0 * np.sqrt(np.sum(sea.waves.amplitude**2) / 2.0), 1e-9)
    water = DEEP + np.clip(0.5 + elevation, 0.0, 1.0)[..., None] * (CREST - DEEP)
    water *= 0.25 + 0.9 * np.clip(normal @ SUN, 0.0, 1.0)[..., None]
    fresnel = 0.02 + 0.98 * (1.0 - facing) ** 5
    glitter = 0.5 * np.clip(mirrored @ SUN, 0.0, 1.0)[..., None] ** 60.0
    rgb = np.clip(water + fresnel * (sky - water) + glitter, 0.0, 1.0)
    # At 14 distances of the camera the water has nearly the colour of the horizon.
    haze = 1.0 - np.exp(-((away / (14.0 * view.distance)) ** 2) * 3.0)
    rgb += haze * (HORIZON - rgb)
    return points, np.concatenate([rgb, np.maximum(haze, 0.88)], axis=-1)  # what is under water shows through


_CORNER = np.arange(POINTS * POINTS).reshape(POINTS, POINTS)[:-1, :-1].ravel()
TRIANGLES = np.ravel(_CORNER[:, None] + [0, POINTS, 1, 1, POINTS, POINTS + 1]).astype(np.uint32)
"""Corners of the grid's triangles, shape (n,)."""
