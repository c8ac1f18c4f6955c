"""A thin offscreen renderer: MuJoCo's scene and GL context for frames of one size."""

from collections.abc import Callable, Sequence
from types import TracebackType

import mujoco
import numpy as np
import numpy.typing as npt

from mjsheaf.errors import MjsheafError
from mjsheaf.video.camera import View
from mjsheaf.video.gl import GLContext, open_context
from mjsheaf.video.lines import Lines, draw_lines

Frame = npt.NDArray[np.uint8]

# Software GL draws a frame about three times faster without these.
COSTLY = (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION)


class Renderer:
    """Draws a model's state, and what is added to it, into frames.

    It is a context manager; `close` frees the GL resources.

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
        self._pixels: Frame = np.zeros((height, width, 3), np.uint8)
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

    def draw(self, data: mujoco.MjData, view: View, decorate: Callable[[mujoco.MjvScene], Sequence[Lines]]) -> Frame:
        """Draw one frame.

        Args:
            data: the state, with its kinematics computed.
            view: where the camera is.
            decorate: adds geoms to the scene before it is drawn, and returns lines to draw over it.

        Returns:
            Pixels from the top row down, shape (height, width, 3); a new array.
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
        return np.ascontiguousarray(self._pixels[::-1])  # GL counts rows from the bottom

    def close(self) -> None:
        """Free the GL resources. Closing twice does nothing."""
        if self._context is None:
            return
        self._context.make_current()
        if self._mjr is not None:
            self._mjr.free()
        self._context.free()
        self._mjr = self._context = None

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
