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
from mjsheaf.loop.session import engine_of
from mjsheaf.media import FlowField
from mjsheaf.media.medium import moving_along
from mjsheaf.media.varying import COMPILED, Bounds, Compiled, Exposure, Moving
from mjsheaf.section import Number, Positive


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


@pytest.mark.slow
def test_a_medium_of_ones_own_carries_the_agents_that_meet_it_within_its_bound() -> None:
    system = load_scenario("steady_current", {"time.end": 0.5}).system
    stirred = Stirred(dimension=2, drift=[0.4, 0.3], eddy=Eddy(rate=0.3, radius=9.0))
    changed = replace(system, flows=[stirred, *system.flows[1:]])
    N, V = len(system.team.agents), len(system.planar)
    points = np.random.default_rng(0).uniform(-10.0, 10.0, (50, V, 3))
    square = (points[:, :N, :2] ** 2).sum(axis=2, keepdims=True) / 81.0
    turned = 0.3 * np.maximum(1.0 - square, 0.0) * np.stack([-points[:, :N, 1], points[:, :N, 0]], axis=2)
    w = moving_along(changed.medium, np.zeros(50), points)
    np.testing.assert_allclose(w[:, :N, :2], turned, rtol=1e-12, atol=1e-14)
    assert not w[:, N:].any()
    assert (np.linalg.norm(w, axis=2) <= changed.largest_disturbance * (1.0 + 1e-12)).all()
    assert np.linalg.norm(w[:, :N], axis=2).max() > 0.9 * changed.largest_disturbance[0]
    with engine_of(system, "ideal") as plain, engine_of(changed, "ideal") as run:
        assert np.abs(run.run().positions[-1, :N] - plain.run().positions[-1, :N]).max() > 0.01
