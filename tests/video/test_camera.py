"""The camera keeps everything in the picture, moves slowly, and agrees with MuJoCo's."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjsheaf.arrays import Array
from mjsheaf.video.camera import FILL, View, camera_path
from mjsheaf.video.film import Frames, VideoOptions
from tests.builders import change_film, make_film, make_model, samples_of
from tests.strategies import examples

FPS, WIDTH, HEIGHT, FOVY = 30, 1280, 720, 45.0


def follow(
    time: Array,
    *points: Array,
    azimuth: float = -60.0,
    elevation: float = -35.0,
    width: int = WIDTH,
    distance: float | None = None,
    block: int = 37,
) -> tuple[Array, list[View]]:
    frames = np.arange(time[0], time[-1] + 1e-9, 1 / FPS)
    together = at_times(frames, time, np.concatenate(points, axis=1))
    path = camera_path(
        (together[first : first + block] for first in range(0, len(frames), block)),
        azimuth=azimuth,
        elevation=elevation,
        fovy=FOVY,
        aspect=width / HEIGHT,
        radius=1.0,
        window=75,
        distance=distance,
    )
    return frames, path


def at_times(times: Array, time: Array, points: Array) -> Array:
    flat = [np.interp(times, time, values) for values in points.reshape(len(time), -1).T]
    return np.stack(flat, axis=1).reshape(len(times), -1, 3)


def lookats(path: list[View]) -> Array:
    return np.array([view.lookat for view in path])


def distances(path: list[View]) -> Array:
    return np.array([view.distance for view in path])


def formation(time: Array) -> Array:
    """Thirteen boats that jump into a turning, travelling formation of 80 m, and four targets 35 m below."""
    angle = 0.5 * time[:, None] + np.linspace(0, 2 * np.pi, 13, endpoint=False)
    boats = np.stack([80 * np.cos(angle), 80 * np.sin(angle), 0 * angle], axis=-1)
    scattered = np.random.default_rng(0).uniform(-150, 150, (13, 3)) * [1, 1, 0]
    boats += np.exp(-10 * time)[:, None, None] * (scattered - boats[0])
    targets = np.array([[0, 0, -35], [20, 0, -25], [-20, 10, -45], [0, -20, -35.0]])
    together = np.concatenate([boats, np.broadcast_to(targets, (len(time), 4, 3))], axis=1)
    return together + np.stack([20 * np.sin(time), 20 * np.cos(2 * time), 0 * time], axis=-1)[:, None]


@examples(25)
@given(
    seed=st.integers(0, 10**6),
    azimuth=st.floats(-180, 180),
    elevation=st.floats(-90, 90),
    scale=st.floats(1e-2, 1e4),
    width=st.sampled_from([480, 720, 1280, 1920]),
)
def test_any_walk_stays_in_the_picture(seed: int, azimuth: float, elevation: float, scale: float, width: int) -> None:
    time = np.linspace(0, 3, 31)
    points = scale * np.random.default_rng(seed).normal(size=(31, 5, 3)).cumsum(axis=0)
    frames, path = follow(time, points, azimuth=azimuth, elevation=elevation, width=width)
    left, right, bottom, top = FILL
    for view, places in zip(path, at_times(frames, time, points), strict=True):
        pixels, depth = view.project(places, width, HEIGHT)
        assert (depth > 0).all()
        across = (pixels / [width, HEIGHT] - 0.5) * [2, -2]  # -1 at the left and bottom, 1 at the right and top
        assert ((across > [-left, -bottom]) & (across < [right, top])).all()


def test_the_picture_is_well_filled() -> None:
    time = np.arange(0, 12, 0.05)
    points = formation(time)
    frames, path = follow(time, points)
    pairs = zip(path, at_times(frames, time, points), strict=True)
    spans = [np.ptp(view.project(places, WIDTH, HEIGHT)[0], axis=0) / [WIDTH, HEIGHT] for view, places in pairs]
    assert np.median(spans, axis=0).max() > 0.5


def test_camera_moves_slowly_even_while_agents_jump() -> None:
    time = np.arange(0, 12, 0.05)
    _, path = follow(time, formation(time))
    moved = np.linalg.norm(np.diff(lookats(path), axis=0), axis=1) / distances(path)[1:]
    zoomed = np.abs(np.diff(np.log(distances(path))))
    assert moved.max() * FPS < 0.3  # of the distance, in a second
    assert zoomed.max() * FPS < 0.3


def test_a_vehicle_alone_and_at_rest_is_seen_from_outside() -> None:
    points = np.full((2, 1, 3), 5.0)
    _, path = follow(np.array([0.0, 1.0]), points)
    assert distances(path).min() > 1.0  # its radius
    assert np.ptp(distances(path)) < 1e-9


def test_a_distance_asked_for_is_kept() -> None:
    time = np.arange(0, 3, 0.05)
    _, path = follow(time, formation(time), distance=123.0)
    np.testing.assert_allclose(distances(path), 123.0)


def test_projection_agrees_with_mujoco() -> None:
    model = make_model()
    view = View(np.array([3.0, -2.0, 5.0]), 40.0, -60.0, -35.0, float(model.vis.global_.fovy))
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = view.lookat, view.distance
    camera.azimuth, camera.elevation = view.azimuth, view.elevation
    scene, data = mujoco.MjvScene(model, 100), mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    every = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, every, scene)

    eye = scene.camera[0]  # the left eye of two; both stand at the same place unless stereo is on
    forward, up = np.array(eye.forward), np.array(eye.up)
    points = np.random.default_rng(0).uniform(-10, 10, (20, 3))
    relative = points - (np.array(eye.pos) + np.array(scene.camera[1].pos)) / 2
    ahead = relative @ forward
    scale = eye.frustum_near / eye.frustum_top * HEIGHT / 2 / ahead
    pixels, depth = view.project(points, WIDTH, HEIGHT)
    np.testing.assert_allclose(depth, ahead, rtol=1e-5)
    np.testing.assert_allclose(pixels[:, 0], WIDTH / 2 + relative @ np.cross(forward, up) * scale, atol=0.01)
    np.testing.assert_allclose(pixels[:, 1], HEIGHT / 2 - relative @ up * scale, atol=0.01)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_camera_lets_go_of_what_blows_up(value: float) -> None:
    film = make_film(make_model(), samples=81)
    positions = samples_of(film).positions.copy()
    positions[40:, 1] += np.exp(np.linspace(0, 20, 41))[:, None]
    positions[70:, 1] = value
    wild = Frames(change_film(film, positions=positions), VideoOptions(fps=40))
    _, sane = follow(wild.times, samples_of(film).at(wild.times).positions)
    _, path = follow(wild.times, wild.extent.followed(wild.chunk(0)))
    assert np.isfinite(lookats(path)).all()
    assert distances(path).max() < 4 * distances(sane).max()
