"""Target motions: what a target commands itself.

Oracles: the paper's formula for Lissajous motion; for paths, the points themselves and differences of positions.
A target's reference position is read by asking for the command at x = 0 with pull 1, less that with pull 0.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.law import paths as motion
from mjsheaf.law.paths import Lissajous, Motion, Waypoints


class Target:
    """One target with a motion, among others that have none."""

    def __init__(self, given_motion: Motion, initial: Array, start: float) -> None:
        positions = np.zeros((3, 3))
        positions[1, : len(initial)] = initial
        self.free, self.pulled = (
            motion.pack_motions(
                [None, given_motion.model_copy(update={"pull": pull}), None], positions, start, [2, len(initial), 3]
            )
            for pull in (0.0, 1.0)
        )

    def velocity(self, t: float) -> Array:
        command = np.zeros(3)
        motion.add_reference(self.free, 1, t, np.zeros(3), command)
        return command

    def position(self, t: float) -> Array:
        command = np.zeros(3)
        motion.add_reference(self.pulled, 1, t, np.zeros(3), command)
        return command - self.velocity(t)


@st.composite
def paths(draw: st.DrawFn, *, closed: bool | None = None) -> tuple[Waypoints, Array, float]:
    """A path through 1 to 6 random points, where it begins, and when."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    n = draw(st.sampled_from([2, 3]))
    points = rng.uniform(-20, 20, (draw(st.integers(1, 6)) + 1, n))
    goes_round = draw(st.booleans()) if closed is None else closed
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assume(legs.min() > 1.0)
    speed = draw(st.floats(0.5, 5.0))
    return Waypoints(points=points[1:].tolist(), speed=speed, closed=goes_round), points[0], draw(st.floats(0.0, 10.0))


def knots(path: Waypoints, initial: Array, start: float) -> tuple[Array, Array]:
    """Times in proportion to the distances between the points, and the points, the return included."""
    points = np.vstack([initial, path.points, *([initial] if path.closed else [])])
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return start + np.concatenate([[0.0], np.cumsum(legs)]) / path.speed, points


@given(st.integers(0, 2**31), st.sampled_from([2, 3]), st.floats(0.0, 5.0), st.floats(0.0, 100.0))
def test_lissajous_is_the_papers(seed: int, n: int, start: float, after: float) -> None:
    rng = np.random.default_rng(seed)
    A, a, phase = rng.uniform(-20, 20, n), rng.uniform(0, 3, n), rng.uniform(-4, 4, n)
    initial = rng.uniform(-50, 50, n)
    target = Target(Lissajous(amplitude=A.tolist(), rate=a.tolist(), phase=phase.tolist()), initial, start)
    t = start + after
    velocity, position = np.zeros(3), np.zeros(3)
    velocity[:n] = A * a * np.cos(a * t + phase)
    position[:n] = initial + A * (np.sin(a * t + phase) - np.sin(a * start + phase))
    np.testing.assert_allclose(target.velocity(t), velocity, atol=1e-11)
    np.testing.assert_allclose(target.position(t), position, atol=1e-10)
    np.testing.assert_allclose(target.position(start)[:n], initial, atol=1e-11)


@given(paths())
def test_paths_pass_through_their_points_at_mean_speed(case: tuple[Waypoints, Array, float]) -> None:
    target = Target(*case)
    times, points = knots(*case)
    for t, point in zip(times, points, strict=True):
        np.testing.assert_allclose(target.position(t)[: len(point)], point, atol=1e-8)
        np.testing.assert_allclose(motion.position_at(target.free, 1, t)[: len(point)], point, atol=1e-8)
    if case[1].size == 2:
        assert target.position(times.mean())[2] == target.velocity(times.mean())[2] == 0.0


@given(paths(), st.floats(0.01, 0.99))
def test_velocity_along_a_path_is_the_derivative_of_position(case: tuple[Waypoints, Array, float], s: float) -> None:
    """At the knots too, on either side: the path is C^1 there (in fact C^4 inside)."""
    target = Target(*case)
    times, _ = knots(*case)
    h = 1e-4 * np.diff(times).min()
    scale = 1.0 + max(np.abs(target.velocity(u)).max() for u in np.linspace(times[0], times[-1], 50))
    for t in (times[0] + s * (times[-1] - times[0]), *(times[1:] if case[0].closed else times[1:-1])):
        difference = (target.position(t + h) - target.position(t - h)) / (2 * h)
        for side in (t - 1e-3 * h, t, t + 1e-3 * h):
            np.testing.assert_allclose(target.velocity(side), difference, atol=1e-4 * scale)


@given(paths(closed=True), st.floats(0.0, 1.0), st.integers(1, 5))
def test_closed_paths_go_round(case: tuple[Waypoints, Array, float], s: float, rounds: int) -> None:
    target = Target(*case)
    times, _ = knots(*case)
    period = times[-1] - times[0]
    t = times[0] + s * period
    size = 1.0 + np.abs(target.velocity(t)).max()
    np.testing.assert_allclose(target.position(t + rounds * period), target.position(t), atol=1e-9 * size)
    np.testing.assert_allclose(target.velocity(t + rounds * period), target.velocity(t), atol=1e-8 * size)


@given(paths(closed=False))
def test_open_paths_begin_and_end_at_rest_and_stay(case: tuple[Waypoints, Array, float]) -> None:
    target = Target(*case)
    times, points = knots(*case)
    speed = max(np.abs(target.velocity(t)).max() for t in np.linspace(times[0], times[-1], 50))
    for t in (times[0], times[-1], times[-1] + 1e-3, times[-1] + 100.0):
        np.testing.assert_allclose(target.velocity(t), 0.0, atol=1e-9 * (1.0 + speed))
    np.testing.assert_allclose(target.position(times[-1] + 100.0)[: points.shape[1]], points[-1], atol=1e-8)
    h = 1e-3 * np.diff(times)[0]
    assert np.abs(target.velocity(times[0] + h)).max() <= 1e-4 * (1.0 + speed) + 1e-4 * speed  # v ~ t^2: no jerk off


def test_pull_brings_a_target_back() -> None:
    path = Waypoints(points=[[10.0, 0.0]], speed=1.0, pull=2.5)
    packed = motion.pack_motions([path], np.zeros((1, 3)), 0.0, [2])
    command = np.zeros(3)
    motion.add_reference(packed, 0, 50.0, np.array([9.0, 1.0, 0.0]), command)  # at rest at (10, 0) by now
    np.testing.assert_allclose(command, [2.5, -2.5, 0.0], atol=1e-9)


def test_several_targets_keep_their_own_references() -> None:
    """Packed together, each moves as it does alone, whatever the others' kinds and lengths."""
    rng = np.random.default_rng(0)
    motions: list[Motion | None] = [
        Waypoints(points=rng.uniform(-9, 9, (4, 3)).tolist(), speed=1.0),
        None,
        Lissajous(amplitude=[1, 2], rate=[3, 4], phase=[5, 6], pull=0.5),
        Waypoints(points=rng.uniform(-9, 9, (2, 2)).tolist(), speed=2.0, closed=True),
        Waypoints(points=rng.uniform(-9, 9, (1, 3)).tolist(), speed=3.0),
    ]
    sizes = [3, 3, 2, 2, 3]
    positions = rng.uniform(-9, 9, (5, 3))
    together = motion.pack_motions(motions, positions, 1.0, sizes)
    for v, (one, n) in enumerate(zip(motions, sizes, strict=True)):
        alone = motion.pack_motions([one], positions[v : v + 1], 1.0, [n])
        for t in np.linspace(1.0, 40.0, 15):
            expected, got = np.ones(3), np.ones(3)
            motion.add_reference(alone, 0, t, positions[v], expected)
            motion.add_reference(together, v, t, positions[v], got)
            np.testing.assert_array_equal(got, expected)
            assert one is not None or (got == 1.0).all()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (Lissajous(amplitude=[1, 2], rate=[1, 2, 3], phase=[0, 0, 0]), "amplitude has 2 .*dimension 3"),
        (Lissajous(amplitude=[1, 2, 3], rate=[1, 2], phase=[0, 0, 0]), "lissajous rate has 2 entries"),
        (Waypoints(points=[[1, 2, 3], [4, 5]], speed=1.0), "waypoint 1 has 2 entries; the target has dimension 3"),
        (Waypoints(points=[[0, 0, 0]], speed=1.0), "waypoint 0 is where the target already is"),
        (Waypoints(points=[[1, 0, 0], [0, 0, 0]], speed=1.0, closed=True), "waypoint 2 is where the target already is"),
    ],
)
def test_wrong_motions_are_refused(wrong: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        motion.pack_motions([wrong], np.zeros((1, 3)), 0.0, [3])
