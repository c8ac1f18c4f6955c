"""Videos, drawn frame by frame and written to an MP4: H.264, yuv420p, which plays everywhere."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, closing
from copy import copy
from functools import partial
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import mujoco
import numpy as np
from PIL import Image

from mjsheaf.errors import InputError, MjsheafError, PlaceError
from mjsheaf.files import naming, whole_file
from mjsheaf.show.played import number_begun
from mjsheaf.show.style import MATPLOTLIB
from mjsheaf.video.camera import SMOOTHING, View, camera_path
from mjsheaf.video.film import Film, Frames, Moment, VideoOptions
from mjsheaf.video.gl import available_backend
from mjsheaf.video.overlay import Overlay
from mjsheaf.video.scene import (
    Decorator,
    Renderer,
    enlarge_vehicles,
    mesh,
    owners_of_geoms,
    set_detail,
)

GAP = 4  # pixels between pictures side by side; must be even


def draw_video(
    films: list[tuple[Film, mujoco.MjModel]],
    path: str | Path,
    options: VideoOptions,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Draw a run to an MP4 file, without a display; or several runs side by side, in step, seen by one camera.

    Args:
        films: Runs of equal length and equal numbers of vehicles, each with its model: arena and vehicles, each
            vehicle with a free joint. Models are not changed.
        path: File to write. It appears, or is replaced, when it is complete.
        options: Size of one run's picture, camera, speed and so on.
        progress: Callback after each frame, with the numbers of frames drawn and of all frames.

    Returns:
        Number of frames written, at least one.

    Raises:
        PlaceError: The file cannot be written, or its disk is full.
        MjsheafError: No offscreen OpenGL works here (the message says what to install), or ffmpeg failed.
    """
    with ExitStack() as held:
        painters = []
        for k, (film, model) in enumerate(films):
            others = [other for other, _ in films[:k] + films[k + 1 :]]
            painters.append(held.enter_context(Painter(film, model, options, others)))
        total = len(painters[0].times)

        def frames() -> Iterator[Callable[[], np.ndarray]]:
            """Draw the scenes of all frames in turn; each is completed by a call in another thread."""
            for number in range(total):
                yield partial(_side_by_side, [painter.draw(number) for painter in painters])
                if progress is not None:
                    progress(number + 1, total)

        return write_mp4(Path(path), frames(), options.fps)


def _side_by_side(halves: Sequence[Callable[[], Image.Image]]) -> np.ndarray:
    """Complete frames of one height and lay them side by side, with white between them."""
    padded = [np.pad(np.asarray(half()), ((0, 0), (0, GAP), (0, 0)), constant_values=255) for half in halves]
    return np.hstack(padded)[:, :-GAP]


class Painter(AbstractContextManager["Painter"]):
    """Draws a video frame by frame. It is a context manager, which frees the GL resources.

    Attributes:
        times: Times of the frames, shape (F,), s.
        camera: The camera at each frame.
        model, data: MuJoCo's model and data, used for drawing only.
    """

    def __init__(self, film: Film, model: mujoco.MjModel, options: VideoOptions, others: Sequence[Film] = ()) -> None:
        """Prepare the camera, the scene and the overlay; the model is not changed.

        Args:
            film: Content of the video.
            model: Model of the arena and the vehicles.
            options: Options of the video.
            others: Other runs of the same length and number of vehicles, which the camera keeps in view too.

        Raises:
            InputError: No offscreen OpenGL works here.
        """
        backend, reason = available_backend()
        if backend is None:
            raise InputError(reason)
        self._film = film
        self._frames = Frames(film, options)
        self.times = self._frames.times
        self.model = copy(model)  # because the size of vehicles and visual settings change
        enlarge_vehicles(self.model, film.body_id, film.scales)
        if film.seas:
            self.model.geom(film.surface).group = 5  # MuJoCo does not draw this group; waves are drawn in its place
        radius = float((film.radii * film.scales).max(initial=0.1))  # of the largest vehicle as it is drawn, m
        films = [self._frames, *(Frames(other, options) for other in others)]
        self.camera = camera_path(
            (
                np.concatenate([frames.followed(chunk) for frames in films], axis=1)
                for chunk in range(-(-len(self.times) // self._frames.step))
            ),
            azimuth=options.azimuth,
            elevation=options.elevation,
            fovy=float(self.model.vis.global_.fovy),
            aspect=options.scene[0] / options.scene[1],
            radius=radius,
            window=round(SMOOTHING * options.fps),
            distance=options.distance,
        )
        set_detail(self.model, self.camera, radius, options.drawn[1])
        self._size, self._panel = options.scene, options.panel
        if options.quality == "draft":
            self.model.vis.quality.offsamples = 0  # edges are not smoothed
        self.data = mujoco.MjData(self.model)
        self._decorator = Decorator(film, options, owners_of_geoms(self.model, film.body_id))
        survey, middle = self._frames.extent.survey, self.camera[len(self.times) // 2]
        self._decorator.lay_out_arrows(middle)
        with MATPLOTLIB:  # another thread may be drawing the plots of the run
            self._overlay = Overlay(film, options, survey)
        self._renderer = Renderer(self.model, *options.drawn, backend, self._decorator.most_geoms)

    def draw(self, number: int) -> Callable[[], Image.Image]:
        """Draw one frame's scene, and return what completes the frame, which may be called in another thread."""
        now, view = self.pose(number)
        seas = self._film.seas
        surface = mesh(seas[number_begun([sea.start for sea in seas], now.time)], view, now.time) if seas else None
        scene = self._renderer.draw(self.data, view, lambda scene: self._decorator.add(scene, now, view), surface)
        return partial(self._write, scene, now, view)

    def _write(self, image: Image.Image, now: Moment, view: View) -> Image.Image:
        if image.size != self._size:
            image = image.resize(self._size, Image.Resampling.BILINEAR)
        frame = Image.new("RGB", (self._panel + image.width, image.height))
        frame.paste(image, (self._panel, 0))
        self._overlay.write(frame, now, view)
        return frame

    def pose(self, number: int) -> tuple[Moment, View]:
        """Put the vehicles where a frame has them: all of MuJoCo's kinematics that drawing needs, and no dynamics."""
        now = self._frames.moment(number)
        address = self._film.qpos_address[:, None]
        self.data.qpos[address + np.arange(3)] = now.positions
        self.data.qpos[address + np.arange(3, 7)] = now.quaternions
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        return now, self.camera[number]

    def __exit__(self, *_: object) -> None:
        self._renderer.close()


def write_mp4(path: Path, frames: Iterable[Callable[[], Any]], fps: float) -> int:
    """Encode frames as they come. The file appears under its name only when it is complete.

    Args:
        path: the file to write; one that exists is replaced.
        frames: each is called in another thread and returns a picture, RGB. All have one even width and height;
            there is at least one.
        fps: frames in a second.

    Returns:
        How many frames were written.

    Raises:
        PlaceError: The file cannot be written, or its disk is full.
        MjsheafError: ffmpeg is missing or fails.
    """
    with naming(path, kind=PlaceError), whole_file(path) as part:
        try:
            count = _encode(part, frames, fps)
            if abs(_duration(part) - count / fps) > 1 / fps + 0.01:  # ffmpeg gives hundredths of a second
                raise MjsheafError(f"ffmpeg did not finish {path} ({count} frames)")
        except MjsheafError:
            # The disk may be full, which ffmpeg does not tell: write more than it does at a time.
            with part.open("ab", buffering=0) as file:
                room = bytes(1 << 20)
                while room:
                    room = room[file.write(room) :]
            raise
    return count


def _encode(part: Path, frames: Iterable[Callable[[], Any]], fps: float) -> int:
    """Complete the frames and feed them to ffmpeg while the next ones are drawn; returns how many there were."""
    # Rendering is the expensive part, and x264 competes with it for the cores: these options take a third less work
    # than those of the preset at the same file size.
    x264 = "me=dia:subme=1:weightp=0:rc-lookahead=5:threads=2:lookahead-threads=1"
    # Otherwise it forks next to threads, where Python's own hooks can fail in the child. Ctrl-C reaches ffmpeg, too.
    os.environ.setdefault("IMAGEIO_FFMPEG_NO_PREVENT_SIGINT", "1")
    # imageio recognises videos by their extension, which a temporary file does not have.
    plugin = iio.imopen(part, "w", plugin="FFMPEG", extension=".mp4", legacy_mode=True)
    writer = plugin.legacy_get_writer(
        fps=fps,
        codec="libx264",
        quality=6,  # of imageio's 10, here x264's constant rate factor 20: 18 looks lossless, 23 is the default
        macro_block_size=2,  # keep the given size: it is even, as yuv420p needs
        output_params=["-preset", "veryfast", "-x264-params", x264, "-movflags", "+faststart", "-f", "mp4"],
    )
    count = 0
    sent: deque[Future[None]] = deque()

    def wait(most: int) -> None:
        """Wait until at most this number of frames is pending."""
        while len(sent) > most:
            try:
                sent.popleft().result()
            except (OSError, RuntimeError) as error:
                taken = count - len(sent) - 1
                reason = str(error).strip().split("\n")[0] or type(error).__name__
                what = f"ffmpeg stopped after {taken} frames" if taken else "cannot start ffmpeg"
                raise MjsheafError(f"{what}: {reason}") from error

    with closing(writer), ThreadPoolExecutor(1) as encoder:
        for frame in frames:
            sent.append(encoder.submit(lambda finish: writer.append_data(np.asarray(finish())), frame))
            count += 1
            wait(3)  # frames are drawn and not yet encoded at most
        wait(0)
    return count


def _duration(part: Path) -> float:
    """Read a video's length in s, -1 if it is none: ffmpeg's exit status is not to be had."""
    try:
        return float(iio.immeta(part, plugin="FFMPEG", extension=".mp4")["duration"])
    except (OSError, RuntimeError, IndexError, KeyError):
        return -1.0
