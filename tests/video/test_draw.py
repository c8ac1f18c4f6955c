"""Drawing a video to a file, with the OpenGL that works here."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest

from mjsheaf.video.draw import Painter, draw_video
from mjsheaf.video.film import VideoOptions
from mjsheaf.video.scene import Lines
from tests.builders import make_film, make_model, require
from tests.commands import drawing

SMALL = VideoOptions(width=160, height=120, fps=10)


@pytest.fixture
def model() -> mujoco.MjModel:
    return make_model()


@drawing
class TestVideo:
    def test_end_to_end(self, model: mujoco.MjModel, tmp_path: Path) -> None:
        film, path, done = make_film(model), tmp_path / "small.mp4", []
        count = draw_video([(film, model)], path, SMALL, lambda *step: done.append(step))
        assert count == 21
        assert done == [(number + 1, 21) for number in range(21)]
        reader: Iterator[Any] = imageio_ffmpeg.read_frames(path)
        require(next(reader), {"size": (SMALL.width, SMALL.height), "fps": SMALL.fps})
        frames = [np.frombuffer(frame, np.uint8).astype(int) for frame in reader]
        assert len(frames) == 21
        assert all(frame.std() > 10 for frame in frames)
        assert np.abs(frames[0] - frames[10]).max() > 50
        assert list(tmp_path.iterdir()) == [path]

    def test_same_film_same_pixels(self, model: mujoco.MjModel) -> None:
        film = make_film(model)
        with Painter(film, model, SMALL) as first, Painter(film, model, SMALL) as second:
            for number in (3, 7, 3):  # two at once, and out of order: no frame depends on another
                np.testing.assert_array_equal(np.array(first.draw(number)()), np.array(second.draw(number)()))

    def test_vehicle_is_where_the_camera_says(self, model: mujoco.MjModel) -> None:
        """A red box alone in the scene shows up around the pixel to which it is projected."""
        options = VideoOptions(width=320, height=240, trail=0)
        film = make_film(model, edges=[], surface="none")
        model.geom_rgba[:] = [0.0, 0.0, 0.0, 0.0]
        model.geom("box2").rgba = [1.0, 0.0, 0.0, 1.0]
        model.geom("box2").size = [0.8, 0.8, 0.8]
        with Painter(film, model, options) as painter:
            painter._overlay.write = lambda *_: None  # type: ignore[method-assign]
            painter._decorator.add = lambda *_: []  # type: ignore[method-assign]
            for number in (0, 20):
                frame = np.array(painter.draw(number)()).astype(int)
                red = np.argwhere((frame[..., 0] > 30) & (frame[..., 0] > 2 * frame[..., 1]))
                position = film.run.at(painter.times[number : number + 1]).positions[0, 2:3]
                expected, _ = painter.camera[number].project(position, *options.scene)
                expected[0, 0] += options.panel
                np.testing.assert_allclose(red.mean(axis=0)[::-1], expected[0], atol=2.5)

    @pytest.mark.parametrize("size", [(160, 120), (66, 90)])
    def test_a_draft_shows_the_same_at_the_same_size(self, size: tuple[int, int], model: mujoco.MjModel) -> None:
        film = make_film(model)
        good, draft = (VideoOptions(width=size[0], height=size[1], quality=quality) for quality in ("good", "draft"))
        with Painter(film, model, good) as one, Painter(film, model, draft) as other:
            fine, coarse = (np.array(painter.draw(5)()).astype(float) for painter in (one, other))
        assert coarse.shape == fine.shape == (size[1], size[0], 3)
        assert 0 < np.abs(fine - coarse).mean() < 12

    def test_lines_are_drawn_behind_what_is_nearer(self, model: mujoco.MjModel) -> None:
        """A thick red line through a box: the box hides the middle of it, and the ends are seen."""
        film = make_film(model, edges=[], surface="none", harmonic_extension=np.zeros((41, 3, 3)))
        sideways = VideoOptions(width=320, height=240, trail=0, elevation=0, azimuth=90)
        with Painter(film, model, sideways) as painter:
            _, view = painter.pose(0)
            box = painter.data.body("vehicle0").xpos
            across = np.array([[-4.0, 0.0, 0.0], [4.0, 0.0, 0.0]]) + box
            lines = Lines(across[None].astype(np.float32), np.array([[1, 0, 0, 1]], np.float32), 2.0)
            plain = np.asarray(painter._renderer.draw(painter.data, view, lambda _: [])).astype(int)
            lined = np.asarray(painter._renderer.draw(painter.data, view, lambda _: [lines])).astype(int)
            ends, _ = view.project(across, *sideways.scene)
        changed = np.argwhere(np.abs(plain - lined).max(axis=2) > 60)
        assert len(changed)
        np.testing.assert_allclose(changed[:, 1].min(), ends[:, 0].min(), atol=2)
        np.testing.assert_allclose(changed[:, 1].max(), ends[:, 0].max(), atol=2)
        assert np.diff(np.unique(changed[:, 1])).max() > 2  # the gap

    def test_the_model_is_not_changed(self, model: mujoco.MjModel) -> None:
        before = (model.geom_size.copy(), model.vis.map.zfar, model.vis.global_.offwidth)
        with Painter(make_film(model, scales=np.full(5, 3.0)), model, SMALL) as painter:
            np.array(painter.draw(0)())
        np.testing.assert_array_equal(model.geom_size, before[0])
        assert (model.vis.map.zfar, model.vis.global_.offwidth) == before[1:]
