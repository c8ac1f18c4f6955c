"""Backends and engines; those on bodies compile for a minute, and are slow."""

import pytest

BACKENDS = [
    ("ideal", "mujoco"),
    pytest.param("physics", "mujoco", marks=pytest.mark.slow),
    pytest.param("physics", "fused", marks=pytest.mark.slow),
]
