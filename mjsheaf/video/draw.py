"""A finished run, drawn to a video."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from pathlib import Path
from types import TracebackType

import mujoco
import numpy as np
from PIL import Image

from mjsheaf.errors import InputError, MjsheafError
from mjsheaf.video.camera import SMOOTHING, CameraPath, View, camera_path
from mjsheaf.video.decorate import Decorator
from mjsheaf.video.detail import set_depth_range, set_smoothness
from mjsheaf.video.encode import write_mp4
from mjsheaf.video.enlarge import enlarge_vehicles, vehicle_radius
from mjsheaf.video.film import Film, VideoOptions
from mjsheaf.video.gl import available_backend
from mjsheaf.video.overlay import Overlay
from mjsheaf.video.renderer import Frame, Renderer
from mjsheaf.video.sampling import Moment, frame_times, moment
from mjsheaf.video.sanity import Reach


def draw_video(
    film: Film,
    model: mujoco.MjModel,
    path: str | Path,
    options: VideoOptions | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Draw a run to an MP4 file, without a display.

    Args:
        film: the run.
        model: arena and vehicles, each vehicle with a free joint; it is not changed.
        path: the file to write; it appears, or is replaced, when it is complete.
        options: size, camera, speed and so on; None for the defaults.
        progress: called after each frame with the frames done and how many there will be.

    Returns:
        How many frames were written, at least one.

    Raises:
        InputError: the film does not fit the model.
        MjsheafError: no offscreen OpenGL works here (the message says what to install), or ffmpeg failed.
    """
    options = options or VideoOptions()
    with Painter(film, model, options) as painter:
        return write_mp4(Path(path), painter.frames(progress), options.width, options.height, options.fps)


class Painter:
    """Draws a film frame by frame. It is a context manager; `close` frees the GL resources.

    Attributes:
        times: of the frames. Shape (F,), in s.
        camera: where the camera is at each of them.
        model, data: MuJoCo's, for drawing alone.
    """

    def __init__(self, film: Film, model: mujoco.MjModel, options: VideoOptions) -> None:
        """Set everything up.

        Raises:
            InputError: the film does not fit the model.
            MjsheafError: no offscreen OpenGL works here.
        """
        _check_fit(film, model)
        backend, reason = available_backend()
        if backend is None:
            raise MjsheafError(reason)
        reach = Reach.of(film)
        self._film = reach.drawable(film)
        self.model = copy(model)  # its vehicles' size and its visual settings are changed
        enlarge_vehicles(self.model, film.body_id, options.vehicle_scale)
        self.times = frame_times(film, options)
        self._radius = vehicle_radius(self.model, film.body_id)
        self.camera = self._follow_team(film, reach, options)
        set_depth_range(self.model, self.camera)
        set_smoothness(self.model, self.camera, self._radius, options)
        self._size = (options.width, options.height)
        if options.quality == "draft":
            self.model.vis.quality.offsamples = 0  # edges are not smoothed
        self.data = mujoco.MjData(self.model)
        self._decorator = Decorator(self._film, options)
        self._overlay = Overlay(self._film, options)
        self._renderer = Renderer(self.model, *options.drawn, backend, self._decorator.most_geoms)

    def _follow_team(self, film: Film, reach: Reach, options: VideoOptions) -> CameraPath:
        return camera_path(
            film.time,
            [reach.followed(film.positions), reach.followed(film.harmonic_extension)],
            self.times,
            azimuth=options.azimuth,
            elevation=options.elevation,
            fovy=float(self.model.vis.global_.fovy),
            aspect=options.width / options.height,
            radius=self._radius,
            window=round(SMOOTHING * options.fps),
            distance=options.distance,
        )

    def frames(self, progress: Callable[[int, int], None] | None = None) -> Iterator[Frame]:
        """All frames in turn, each of shape (height, width, 3); one is written on while the next is drawn."""
        count, written = len(self.times), None
        with ThreadPoolExecutor(1) as writer:
            for number in range(count + 1):
                last = written
                written = writer.submit(self._write, *self._draw(number)) if number < count else None
                if last is not None:
                    yield last.result()
                    if progress is not None:
                        progress(number, count)

    def paint(self, number: int) -> Frame:
        """One frame, shape (height, width, 3)."""
        return self._write(*self._draw(number))

    def _draw(self, number: int) -> tuple[Frame, Moment, View]:
        now, view = self.pose(number)
        return self._renderer.draw(self.data, view, lambda scene: self._decorator.add(scene, now, view)), now, view

    def _write(self, frame: Frame, now: Moment, view: View) -> Frame:
        if frame.shape[1::-1] != self._size:
            frame = np.array(Image.fromarray(frame).resize(self._size, Image.Resampling.BILINEAR))
        self._overlay.write(frame, now, view)
        return frame

    def pose(self, number: int) -> tuple[Moment, View]:
        """Put the vehicles where a frame has them: all of MuJoCo's kinematics that drawing needs, and no dynamics."""
        now = moment(self._film, float(self.times[number]))
        address = self._film.qpos_address[:, None]
        self.data.qpos[address + np.arange(3)] = now.positions
        self.data.qpos[address + np.arange(3, 7)] = now.quaternions
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        return now, self.camera.view(number)

    def close(self) -> None:
        """Free the GL resources. Closing twice does nothing."""
        self._renderer.close()

    def __enter__(self) -> "Painter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _check_fit(film: Film, model: mujoco.MjModel) -> None:
    """Raise InputError if a vehicle's body or joint is not where the film says."""
    for vehicle, (body, address) in enumerate(zip(film.body_id, film.qpos_address, strict=True)):
        joint = model.body_jntadr[body] if 0 <= body < model.nbody else -1
        free = joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE.value
        if not free or model.jnt_qposadr[joint] != address:
            name = [*film.agent_ids, *film.target_ids][vehicle]
            raise InputError(f"body {body} of {name} must have a free joint at qpos[{address}] in the model")
