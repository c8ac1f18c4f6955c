"""Ideal and physics side by side, in step, seen by one camera."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
from PIL import Image

from mjsheaf.comparing.ladder import Run
from mjsheaf.scenario import Scenario
from mjsheaf.video import Film, VideoOptions
from mjsheaf.video.draw import Painter, write_mp4
from mjsheaf.video.film import frame_times
from mjsheaf.video.from_run import film_of, video_options
from mjsheaf.video.overlay import error_range

_LONGEST = 30.0  # s of video: two pictures a frame cost twice as much
_FPS = 24
_GAP = 4  # pixels between the halves, even


def half_options(scenario: Scenario) -> VideoOptions:
    """How each half is drawn: as the scenario's video, no wider than 4 by 3, and fast enough to last at most 30 s."""
    video = scenario.video
    width = min(video.width, 2 * round(video.height * 2 / 3))
    speed = max(video.speed, (scenario.time.end - scenario.time.start) / _LONGEST)
    return video_options(scenario, width=width, fps=min(video.fps, _FPS), speed=min(float(f"{speed:.3g}"), 1e3))


def film_side_by_side(
    scenario: Scenario, ideal: Run, physics: Run, path: Path, progress: Callable[[int, int], None] | None = None
) -> int:
    """Draw ideal kinematics on the left and bodies on the right.

    Args:
        scenario: the scenario.
        ideal: its ideal run.
        physics: its run on bodies.
        path: the MP4.
        progress: called with (frames done, frames in all).

    Returns:
        The number of frames.

    Raises:
        MjsheafError: no offscreen OpenGL works here, or ffmpeg failed.
    """
    options = half_options(scenario)
    (left, left_model), (right, right_model) = both_films(scenario, ideal, physics, options)
    with (
        Painter(left, left_model, options, beside=[right]) as one,
        Painter(right, right_model, options, beside=[left]) as other,
    ):
        return write_mp4(path, _frames(one, other, progress), options.fps)


def both_films(
    scenario: Scenario, ideal: Run, physics: Run, options: VideoOptions
) -> tuple[tuple[Film, mujoco.MjModel], tuple[Film, mujoco.MjModel]]:
    """The films of both runs, each with its model: of one length, and with one axis for the curves of their errors.

    A run that ends early stands still from there on.
    """
    (left, left_model), (right, right_model) = (
        film_of(scenario, run.dataset(backend, scenario.seed))
        for run, backend in ((ideal, "ideal"), (physics, "physics"))
    )
    end = max(left.span[1], right.span[1])
    axis = error_range(*(film.run.at(frame_times(film, options)).error for film in (left, right)))
    left = replace(left, name=f"{scenario.name}: ideal", error_range=axis, end=end)
    right = replace(right, name=f"{scenario.name}: bodies", error_range=axis, end=end)
    return (left, left_model), (right, right_model)


def _frames(
    one: Painter, other: Painter, progress: Callable[[int, int], None] | None
) -> Iterator[Callable[[], Image.Image]]:
    """Both halves' frames beside each other; see `Painter.frames`."""
    for number in range(len(one.times)):
        yield partial(_beside, one.draw(number), other.draw(number))
        if progress:
            progress(number + 1, len(one.times))


def _beside(left: Callable[[], Image.Image], right: Callable[[], Image.Image]) -> Image.Image:
    """Complete two frames and lay them side by side on white."""
    one, other = left(), right()
    both = Image.new("RGB", (one.width + _GAP + other.width, one.height), "white")
    both.paste(one, (0, 0))
    both.paste(other, (one.width + _GAP, 0))
    return both
