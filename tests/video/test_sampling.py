"""Frame times, and the run between its samples."""

import numpy as np
import pytest

from mjsheaf.video import VideoOptions
from mjsheaf.video.sampling import between, frame_times, moment
from tests.builders import make_film, make_model


@pytest.mark.parametrize(
    ("duration", "samples", "fps", "speed", "count"),
    [
        (10.0, 1001, 30, 1.0, 301),
        (10.0, 1001, 30, 2.0, 151),
        (10.0, 1001, 25, 0.5, 501),
        (0.1, 11, 30, 1.0, 4),
        (0.01, 2, 30, 1.0, 1),
        (49.98, 4999, 30, 1.0, 1500),
    ],
)
def test_frame_times(duration: float, samples: int, fps: float, speed: float, count: int) -> None:
    film = make_film(make_model(), duration, samples)
    times = frame_times(film, VideoOptions(fps=fps, speed=speed))
    assert len(times) == count
    assert times[0] == film.time[0]
    assert times[-1] <= film.time[-1] + 1e-9
    assert times[-1] + speed / fps > film.time[-1]
    np.testing.assert_allclose(np.diff(times), speed / fps)


def test_times_start_with_the_run() -> None:
    film = make_film(make_model())
    late = make_film(make_model(), time=film.time + 7)
    times = frame_times(late, VideoOptions())
    assert times[0] == 7.0
    np.testing.assert_array_equal(moment(late, times[0]).positions, film.positions[0])


def test_a_run_of_one_sample_has_one_frame() -> None:
    film = make_film(make_model(), 0.0, 1)
    times = frame_times(film, VideoOptions())
    assert times.tolist() == [0.0]
    np.testing.assert_array_equal(moment(film, 0.0).positions, film.positions[0])


def test_between_samples() -> None:
    film = make_film(make_model())
    halfway = (film.time[7] + film.time[8]) / 2
    now = moment(film, halfway)
    np.testing.assert_allclose(now.positions, (film.positions[7] + film.positions[8]) / 2)
    np.testing.assert_allclose(now.harmonic_extension, film.harmonic_extension[7:9].mean(axis=0))
    np.testing.assert_allclose(np.linalg.norm(now.quaternions, axis=-1), 1.0)
    assert now.error == pytest.approx(film.error[7:9].mean())


def test_samples_themselves_and_beyond() -> None:
    film = make_film(make_model())
    np.testing.assert_allclose(between(film, film.positions, film.time), film.positions)
    ends = between(film, film.positions, np.array([-1.0, 99.0]))
    np.testing.assert_array_equal(ends, film.positions[[0, -1]])


def test_attitudes_go_the_shorter_way() -> None:
    film = make_film(make_model())
    signs = np.where(np.arange(len(film.time)) % 2, -1.0, 1.0)[:, None, None]  # q and -q are one attitude
    flipped = make_film(make_model(), quaternions=film.quaternions * signs)
    halfway = (film.time[7] + film.time[8]) / 2
    same = np.abs((moment(film, halfway).quaternions * moment(flipped, halfway).quaternions).sum(axis=-1))
    np.testing.assert_allclose(same, 1.0)
