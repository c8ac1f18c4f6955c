"""Frame times, and the run between its samples. Oracle: the run of small_film, known in closed form."""

import numpy as np
import pytest

from mjsheaf.show.played import Poses
from mjsheaf.video.film import Frames, VideoOptions, frame_times
from tests.builders import change_film, make_film, make_model, make_run, samples_of


def between(film: Poses, first: int) -> Poses:
    return film.at(film.time[first : first + 2].mean(keepdims=True))


@pytest.mark.parametrize(
    ("duration", "samples", "fps", "speed", "count"),
    [
        (10.0, 1001, 30, 1.0, 301),
        (10.0, 1001, 30, 2.0, 151),
        (0.1, 11, 30, 1.0, 4),
        (0.01, 2, 30, 1.0, 1),
        (49.98, 4999, 30, 1.0, 1500),
        (0.0, 1, 30, 1.0, 1),
    ],
)
def test_frame_times(duration: float, samples: int, fps: int, speed: float, count: int) -> None:
    """Of a run that begins at 7 s; the last one has a single sample."""
    film = make_film(make_model(), duration, samples)
    film = change_film(film, time=samples_of(film).time + 7.0)
    options = VideoOptions(fps=fps, speed=speed)
    times = frame_times(film, options)
    assert len(times) == count
    assert times[0] == film.span[0] == 7.0
    np.testing.assert_array_equal(Frames(film, options).moment(0).positions, samples_of(film).positions[0])
    assert times[-1] <= film.span[1] + 1e-9
    assert times[-1] + speed / fps > film.span[1]
    np.testing.assert_allclose(np.diff(times), speed / fps)


def test_a_film_that_lasts_longer_than_its_run_stands_still() -> None:
    film = make_film(make_model(), end=3.0)
    frames = Frames(film, VideoOptions())
    assert frames.times[-1] == pytest.approx(3.0)
    for number in (61, 75, 90):
        np.testing.assert_array_equal(frames.moment(number).positions, samples_of(film).positions[-1])


def test_between_samples_at_samples_and_beyond() -> None:
    run = make_run()
    now = between(run, 7)
    np.testing.assert_allclose(now.positions[0], run.positions[7:9].mean(axis=0))
    np.testing.assert_allclose(now.harmonic_extension[0], run.harmonic_extension[7:9].mean(axis=0))
    np.testing.assert_allclose(np.linalg.norm(now.quaternions, axis=-1), 1.0)
    assert now.error[0] == pytest.approx(run.error[7:9].mean())
    np.testing.assert_allclose(run.at(run.time).positions, run.positions)
    np.testing.assert_array_equal(run.at(np.array([-1.0, 99.0])).positions, run.positions[[0, -1]])


def test_attitudes_go_the_shorter_way() -> None:
    run = make_run()
    signs = np.where(np.arange(len(run.time)) % 2, -1.0, 1.0)[:, None, None]  # q and -q are one attitude
    flipped = samples_of(make_film(make_model(), quaternions=run.quaternions * signs))
    same = np.abs((between(run, 7).quaternions * between(flipped, 7).quaternions).sum(axis=-1))
    np.testing.assert_allclose(same, 1.0)


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("speed", [0.02, 0.2, 30.0])
@pytest.mark.parametrize("trail", [0.0, 0.3, 1.0, 1e6])
def test_frames_and_trails_do_not_depend_on_how_they_are_read(speed: float, trail: float) -> None:
    """Read in order, in chunks of seven frames; and one by one, each by itself. Oracle for trails: the run itself."""
    film = make_film(make_model(), 20.0, 401)
    options = VideoOptions(speed=speed, fps=10, trail=trail)
    in_order = Frames(film, options)
    in_order.step = 7
    for number in range(0, len(in_order.times), max(1, len(in_order.times) // 50)):
        one, other = in_order.moment(number), Frames(film, options).moment(number)
        np.testing.assert_allclose(one.positions, film.run.at(in_order.times[number : number + 1]).positions[0])
        np.testing.assert_allclose(one.trail, other.trail, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.trail_time, other.trail_time)
        assert one.trail_time[0] == pytest.approx(max(one.time - trail, 0.0))
        assert one.trail_time[-1] == one.time
        assert (np.diff(one.trail_time) >= 0).all()
        np.testing.assert_allclose(one.trail, film.run.at(one.trail_time).positions, atol=0.05 if trail < 9 else 2.0)


class TestRunsThatBlewUp:
    def test_everything_can_be_drawn(self) -> None:
        film = make_film(make_model())
        positions, quaternions = samples_of(film).positions.copy(), samples_of(film).quaternions.copy()
        positions[:3, 0] = np.nan
        positions[20:, 1] = 1e30
        positions[30:, 2] = np.nan
        quaternions[30:] = np.nan
        frames = Frames(change_film(film, positions=positions, quaternions=quaternions), VideoOptions(fps=20))
        tame = frames.chunk(0)
        assert np.abs(tame.positions).max() < 1e5
        np.testing.assert_array_equal(tame.positions[35, 2], positions[29, 2])
        assert np.isfinite(tame.quaternions).all()
        assert np.isfinite(frames.extent.followed(tame)).all()
