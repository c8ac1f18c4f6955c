"""Restriction maps by name, and the measurements they make.

Oracles: the matrices printed in the paper (USV-UAV projection, aligned local frame, planar sensing of a target in
space), and scipy's Euler angles.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mjsheaf.errors import InputError
from mjsheaf.team import restriction_maps, rotation_to_local

angles = st.floats(-10.0, 10.0)
attitudes = st.tuples(angles, angles, angles)

P = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@pytest.mark.parametrize(
    ("name", "dimensions", "expected"),
    [
        ("shared", (2, 3), (np.eye(2), P)),  # the paper's boat and aircraft
        ("shared", (3, 2), (P, np.eye(2))),
        ("shared", (3, 3), (np.eye(3), np.eye(3))),
        ("identity", (2, 2), (np.eye(2), np.eye(2))),
        ("local_frame", (2, 3), (np.eye(2), P)),  # at attitude zero
    ],
)
def test_named_maps_are_the_papers(
    name: str, dimensions: tuple[int, int], expected: tuple[np.ndarray, np.ndarray]
) -> None:
    for given_map, wanted in zip(restriction_maps(name, *dimensions), expected, strict=True):
        np.testing.assert_array_equal(given_map, wanted)


@given(attitudes)
def test_local_frames_are_rotations_by_yaw_pitch_and_roll(attitude: tuple[float, float, float]) -> None:
    roll, pitch, yaw = attitude
    R = rotation_to_local(roll, pitch, yaw, 3)
    body_to_world = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    np.testing.assert_allclose(R, body_to_world.T, atol=1e-14)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    planar = rotation_to_local(roll, pitch, yaw, 2)
    np.testing.assert_allclose(planar @ [np.cos(yaw), np.sin(yaw)], [1.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(planar, rotation_to_local(0.0, 0.0, yaw, 3)[:2, :2], atol=0)


@given(attitudes)
def test_local_frame_maps_are_r_and_r_p(attitude: tuple[float, float, float]) -> None:
    """F_i = R_i on both ends in space; F_i = R_i, F_j = R_i P for an agent in the plane and a target in space."""
    R3, R2 = rotation_to_local(*attitude, 3), rotation_to_local(*attitude, 2)
    cases = {(3, 3): (R3, R3), (2, 2): (R2, R2), (2, 3): (R2, R2 @ P), (3, 2): (R2 @ P, R2)}
    for dimensions, expected in cases.items():
        for given_map, wanted in zip(restriction_maps("local_frame", *dimensions, attitude), expected, strict=True):
            np.testing.assert_allclose(given_map, wanted, atol=1e-15)


def test_maps_that_do_not_exist_are_refused() -> None:
    with pytest.raises(InputError, match=r"'global'.*identity, shared, local_frame"):
        restriction_maps("global", 2, 2)
    with pytest.raises(InputError, match=r"'identity'.* 2 .* 3.*'shared'"):
        restriction_maps("identity", 2, 3)
