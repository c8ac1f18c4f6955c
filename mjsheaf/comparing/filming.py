"""Ideal and physics side by side, in step, seen by one camera."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from mjsheaf.comparing.ladder import Run
from mjsheaf.filming import film_of, video_options
from mjsheaf.scenario import Scenario
from mjsheaf.video import Film, VideoOptions
from mjsheaf.video.camera import CameraPath
from mjsheaf.video.curve import error_range
from mjsheaf.video.draw import Painter
from mjsheaf.video.encode import write_mp4
from mjsheaf.video.renderer import Frame
from mjsheaf.video.sanity import Reach

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
    (left, left_model), (right, right_model) = both_films(scenario, ideal, physics)
    both = _together(left, right)
    with _Half(left, left_model, options, both) as one, _Half(right, right_model, options, both) as other:
        return write_mp4(path, _frames(one, other, progress), 2 * options.width + _GAP, options.height, options.fps)


def both_films(
    scenario: Scenario, ideal: Run, physics: Run
) -> tuple[tuple[Film, mujoco.MjModel], tuple[Film, mujoco.MjModel]]:
    """The films of both runs, each with its model: of one length, and with one axis for the curves of their errors."""
    (left, left_model), (right, right_model) = (
        film_of(scenario, run.dataset(backend, scenario.seed))
        for run, backend in ((ideal, "ideal"), (physics, "physics"))
    )
    left, right = left.loaded(), right.loaded()
    times = max(left.time, right.time, key=len)
    axis = error_range(left.error[:], right.error[:])
    left = replace(_lasting(left, times), name=f"{scenario.name}: ideal", error_range=axis)
    right = replace(_lasting(right, times), name=f"{scenario.name}: bodies", error_range=axis)
    return (left, left_model), (right, right_model)


class _Half(Painter):
    """Paints one film with a camera that keeps both in view."""

    def __init__(self, film: Film, model: mujoco.MjModel, options: VideoOptions, both: Film) -> None:
        self._both = both
        super().__init__(film, model, options)

    def _follow_team(self, film: Film, reach: Reach, options: VideoOptions) -> CameraPath:
        return super()._follow_team(self._both, Reach.of(self._both), options)


def _frames(one: Painter, other: Painter, progress: Callable[[int, int], None] | None) -> Iterator[Frame]:
    """Both halves' frames beside each other, each of shape (height, 2 width + gap, 3)."""
    gap: Frame | None = None
    for number in range(len(one.times)):
        left, right = one.paint(number), other.paint(number)
        gap = np.full((len(left), _GAP, 3), 255, dtype=left.dtype) if gap is None else gap
        yield np.hstack([left, gap, right])
        if progress:
            progress(number + 1, len(one.times))


def _lasting(film: Film, times: np.ndarray) -> Film:
    """The film over these sample times; one that ends early stands still from there on."""
    missing = len(times) - len(film.time)
    if missing <= 0:
        return film

    def held(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, np.repeat(values[-1:], missing, axis=0)])

    return replace(
        film,
        time=times,
        positions=held(film.positions),
        quaternions=held(film.quaternions),
        harmonic_extension=held(film.harmonic_extension),
        error=held(film.error),
    )


def _together(one: Film, other: Film) -> Film:
    """One film with the vehicles of both, for the camera alone: it is not drawn."""
    N = one.agents

    def joined(a: np.ndarray, b: np.ndarray, axis: int) -> np.ndarray:
        agents, targets = [np.split(x, [N], axis=axis) for x in (a, b)], 1
        return np.concatenate([agents[0][0], agents[1][0], agents[0][targets], agents[1][targets]], axis=axis)

    return replace(
        one,
        agent_ids=[*one.agent_ids, *other.agent_ids],
        target_ids=[*one.target_ids, *other.target_ids],
        positions=joined(one.positions, other.positions, 1),
        quaternions=joined(one.quaternions, other.quaternions, 1),
        qpos_address=joined(one.qpos_address, other.qpos_address, 0),
        body_id=joined(one.body_id, other.body_id, 0),
        harmonic_extension=np.concatenate([one.harmonic_extension, other.harmonic_extension], axis=1),
        group=joined(one.group, other.group, 0),
        edges=[],
    )
