"""A medium that moves, from outside: a section, a field of FlowField and a type of parts. It is a vortex.

Oracle: its formula, and the bound that no velocity exceeds.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from pydantic import Field

from mjsheaf import load_scenario
from mjsheaf.arrays import Array, IntArray
from mjsheaf.compile.jit import inline_jit
from mjsheaf.loop.system import System
from mjsheaf.media.flow import FlowField
from mjsheaf.media.medium import moving_along
from mjsheaf.media.varying import COMPILED, Bounds, Compiled, Exposure, Moving
from mjsheaf.section import Number, Positive
from tests.running import run_ideal


class Eddy(Moving):
    """Uniform rotation about the origin, which fades towards a radius."""

    rate: Number = Field(description="rate of turn, positive to port [rad/s]")
    radius: Positive = Field(description="where it ends [m]")

    def parts(self, name: str, met: Exposure, reached: IntArray) -> "Iterator[EddyArrays]":
        yield EddyArrays(met.met.astype(np.int64), np.array([self.rate, self.radius]))


@inline_jit
def eddy_velocity(eddy, state, t, v, x, y, z):
    square = (x * x + y * y) / (eddy.numbers[1] * eddy.numbers[1])
    if eddy.met[v] == 0 or square > 1.0:
        return 0.0, 0.0, 0.0
    turn = eddy.numbers[0] * (1.0 - square)
    return -turn * y, turn * x, 0.0


class EddyArrays(NamedTuple):
    met: IntArray
    numbers: Array

    def bound(self) -> Bounds:
        met: Array = (self.met > 0) * abs(self.numbers[0])
        return Bounds(met * self.numbers[1] * 2.0 * 27.0**-0.5, 0.0 * met, 2.0 * met, 0.0)


COMPILED[EddyArrays] = Compiled(eddy_velocity)


class Stirred(FlowField):
    eddy: Eddy = Field(description="the vortex")


@pytest.fixture
def system() -> System:
    own = load_scenario("steady_current", {"time.end": 0.5}).system
    stirred = Stirred(dimension=2, drift=[0.4, 0.3], eddy=Eddy(rate=0.3, radius=9.0))
    return replace(own, flows=[stirred, *own.flows[1:]])


def turned(places: Array) -> Array:
    """Return the vortex's velocity at places of shape (..., 3), m/s."""
    square = (places[..., :2] ** 2).sum(axis=-1, keepdims=True) / 81.0
    return 0.3 * np.maximum(1.0 - square, 0.0) * places[..., [1, 0]] * [-1.0, 1.0]


def test_a_medium_of_ones_own_moves_within_its_bound(system: System) -> None:
    N, V = len(system.team.agents), len(system.planar)
    points = np.random.default_rng(0).uniform(-10.0, 10.0, (50, V, 3))
    w = moving_along(system.medium, np.zeros(50), points)
    np.testing.assert_allclose(w[:, :N, :2], turned(points[:, :N]), rtol=1e-12, atol=1e-14)
    assert not w[:, N:].any()
    assert (np.linalg.norm(w, axis=2) <= system.largest_disturbance * (1.0 + 1e-12)).all()
    assert np.linalg.norm(w[:, :N], axis=2).max() > 0.9 * system.largest_disturbance[0]


@pytest.mark.parametrize("how", ["in_python", pytest.param("compiled", marks=pytest.mark.long)])
def test_a_medium_of_ones_own_carries_the_agents_that_meet_it(
    how: str, system: System, request: pytest.FixtureRequest
) -> None:
    if how == "in_python":
        request.getfixturevalue(how)
    log, N = run_ideal(system).log, len(system.team.agents)
    whirl = turned(log.positions[:, :N])
    np.testing.assert_allclose(log.medium[:, :N, :2] - [0.4, 0.3], whirl, rtol=0, atol=1e-12)
    assert np.abs(whirl).max() > 0.1
