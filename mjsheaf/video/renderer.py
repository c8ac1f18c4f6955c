"""A thin offscreen renderer: MuJoCo's scene and GL context for frames of one size, and a model made ready for it."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from PIL import Image

from mjsheaf.errors import MjsheafError
from mjsheaf.video.camera import CameraPath, View
from mjsheaf.video.film import FloatArray, IntArray
from mjsheaf.video.gl import GLContext, open_context
from mjsheaf.video.scene import Lines, draw_lines

# Software GL draws a frame about three times faster without these.
COSTLY = (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION)


class Renderer:
    """Draws a model's state, and what is added to it, into frames.

    `close` frees the GL resources.

    Attributes:
        model: the model drawn. Its offscreen size is set to the frame's.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int, backend: str, extra_geoms: int) -> None:
        """Open a GL context and upload the model's meshes and textures to it.

        Args:
            model: the model to draw; its offscreen buffer is resized.
            width: of the frames, in pixels.
            height: of the frames, in pixels.
            backend: which GL, as `mjsheaf.video.gl.available_backend` returns.
            extra_geoms: how many geoms may be added to the scene in a frame.

        Raises:
            MjsheafError: the driver refuses.
        """
        self.model = model
        self._context: GLContext | None = None
        self._mjr: mujoco.MjrContext | None = None
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
        self._context = open_context(backend, width, height)
        try:
            self._mjr = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._mjr)
            if (self._mjr.offWidth, self._mjr.offHeight) != (width, height):
                raise MjsheafError(f"{backend} has no offscreen buffer of {width}x{height} pixels")
        except Exception as error:
            self.close()
            if isinstance(error, MjsheafError):
                raise
            raise MjsheafError(f"{backend} cannot draw {width}x{height} pixels: {error}") from error

    def draw(
        self, data: mujoco.MjData, view: View, decorate: Callable[[mujoco.MjvScene], Sequence[Lines]]
    ) -> Image.Image:
        """Draw one frame, RGB.

        Args:
            data: the state, with its kinematics computed.
            view: where the camera is.
            decorate: adds geoms to the scene before it is drawn, and returns lines to draw over it.
        """
        if self._context is None:
            raise MjsheafError("the renderer is closed")
        # Another renderer may have drawn since: a GL context is current for a whole thread.
        self._context.make_current()
        self._camera.lookat = view.lookat
        self._camera.distance = view.distance
        self._camera.azimuth = view.azimuth
        self._camera.elevation = view.elevation
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, data, self._options, None, self._camera, every, self._scene)
        lines = decorate(self._scene)
        mujoco.mjr_render(self._rectangle, self._scene, self._mjr)
        draw_lines(lines)
        mujoco.mjr_readPixels(self._pixels, None, self._rectangle, self._mjr)
        height, width, _ = self._pixels.shape
        # A copy. The last argument: GL counts rows from the bottom.
        return Image.frombuffer("RGB", (width, height), self._pixels, "raw", "RGB", 0, -1)

    def close(self) -> None:
        """Free the GL resources. Closing twice does nothing."""
        if self._context is None:
            return
        self._context.make_current()
        if self._mjr is not None:
            self._mjr.free()
        self._context.free()
        self._mjr = self._context = None


def enlarge_vehicles(model: mujoco.MjModel, body_id: IntArray, scale: float) -> None:
    """Scale what is drawn of each vehicle about its root body's origin; the model is then for drawing only.

    Args:
        model: changed.
        body_id: the vehicles' root bodies. Shape (V,).
        scale: 1 leaves everything as it is.
    """
    if scale == 1:
        return
    bodies = np.flatnonzero(np.isin(model.body_rootid, body_id))
    parts = bodies[~np.isin(bodies, body_id)]  # a root body's own place is in qpos
    model.body_pos[parts] *= scale
    joints = np.isin(model.jnt_bodyid, parts)
    model.jnt_pos[joints] *= scale
    geoms = _geoms(model, body_id)
    model.geom_pos[geoms] *= scale
    model.geom_size[geoms] *= scale
    model.geom_rbound[geoms] *= scale
    sites = np.isin(model.site_bodyid, bodies)
    model.site_pos[sites] *= scale
    model.site_size[sites] *= scale
    # A mesh's size is in its vertices; one that the arena has too is scaled there as well.
    meshes = geoms[model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_MESH.value]
    for mesh in np.unique(model.geom_dataid[meshes]):
        start = model.mesh_vertadr[mesh]
        model.mesh_vert[start : start + model.mesh_vertnum[mesh]] *= scale


def vehicle_radius(model: mujoco.MjModel, body_id: IntArray) -> float:
    """Return a radius about a root body's origin that holds the largest vehicle, in m; at least 0.1 m."""
    # How far a body's origin can be from its root's, whichever way its joints turn; parents come before children.
    reach = np.zeros(model.nbody)
    for body in np.flatnonzero(np.isin(model.body_rootid, body_id) & ~np.isin(np.arange(model.nbody), body_id)):
        reach[body] = reach[model.body_parentid[body]] + np.linalg.norm(model.body_pos[body])
    geoms = _geoms(model, body_id)
    offsets: FloatArray = np.linalg.norm(model.geom_pos[geoms], axis=1)
    return float((reach[model.geom_bodyid[geoms]] + offsets + model.geom_rbound[geoms]).max(initial=0.1))


def _geoms(model: mujoco.MjModel, body_id: IntArray) -> IntArray:
    return np.flatnonzero(np.isin(model.body_rootid[model.geom_bodyid], body_id))


NEAR, FAR = 0.02, 40.0  # nearest and farthest drawn, as parts of the camera's shortest and longest distance
FEWEST_SLICES = 12  # sides of a round thing
FLATNESS = 0.6  # how far a side may be from the circle, in pixels


def set_detail(model: mujoco.MjModel, camera: CameraPath, radius: float, height: int) -> None:
    """Set how far and how finely a model is drawn, given where the camera is.

    Args:
        model: changed.
        camera: decides how large vehicles look.
        radius: of the largest vehicle, in m.
        height: of the frames, in pixels.
    """
    # MuJoCo's own range comes from the model's first pose, not from this run; both are in units of the model's extent.
    model.vis.map.znear = NEAR * float(camera.distance.min()) / model.stat.extent
    model.vis.map.zfar = FAR * float(camera.distance.max()) / model.stat.extent
    # Round things get no more sides than can be seen: vehicles of small round parts cost half of a frame. The largest
    # round part is taken to be a third of its vehicle. n sides miss a circle of radius r by r (1 - cos(pi / n)).
    nearest = camera.view(int(camera.distance.argmin()) * camera.stride)
    part = max(radius / nearest.metres_per_pixel(height) / 3, 2 * FLATNESS)
    slices = max(int(np.ceil(np.pi / np.arccos(1 - FLATNESS / part))), FEWEST_SLICES)
    model.vis.quality.numslices = min(model.vis.quality.numslices, slices)
    model.vis.quality.numstacks = min(model.vis.quality.numstacks, slices * 2 // 3)
