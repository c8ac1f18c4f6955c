"""Analytic flow in time: tides, a flow that sets in, and vortices that move."""

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, IntArray
from mjsheaf.jit import jit
from mjsheaf.media.disturbance import Bounds
from mjsheaf.section import NonNegative, Number, Point, Positive, Section
from mjsheaf.vehicles.vectors import triple


class Tide(Section):
    """A uniform flow that turns along an ellipse: a cos(phi) along its direction and b sin(phi) to its left."""

    amplitude: Positive = Field(description="largest speed, a [m/s]")
    minor: NonNegative = Field(0.0, description="speed across the direction a quarter of a period later, b [m/s]")
    period: Positive = Field(44_714.0, description="period; that of M2, the lunar tide, unless given [s]")
    direction: Number = Field(0.0, description="direction of the largest flow, from the x axis to port [deg]")
    phase: Number = Field(0.0, description="phi at time 0 [deg]")


class Ramp(Section):
    """A uniform flow that rises linearly from 0 between two times, and stays."""

    velocity: Point = Field(description="velocity after the end [m/s]")
    start: Number = Field(description="time at which it begins to rise [s]")
    end: Number = Field(description="time at which it has risen [s]")

    @model_validator(mode="after")
    def _rises(self) -> "Ramp":
        if not self.start < self.end:
            raise ValueError(f"end: {self.end:g} s is not after the start, {self.start:g} s")
        return self


class MovingVortices(NamedTuple):
    """Moving vortices for compiled code.

    Attributes:
        centre: Centre at time 0, shape (n, 3), m.
        velocity: Its velocity, shape (n, 3), m/s.
        strength: Axis times gamma, shape (n, 3), m^2/s.
        core2: core^2, shape (n,), m^2.
        space: 1 in space, 0 in the plane, shape (n,).
    """

    centre: Array
    velocity: Array
    strength: Array
    core2: Array
    space: Array

    def select(self, rows: slice) -> "MovingVortices":
        """Return some of them."""
        return MovingVortices(*(values[rows] for values in self))


class VaryingArrays(NamedTuple):
    """Uniform flows in time and moving vortices for compiled code.

    Attributes:
        met: 1 for vehicles that meet them, else 0, shape (V,).
        tide: Velocities at phi = 0 and a quarter of a period later, shape (2, 3), m/s.
        turning: Its rate, rad/s, and phase, rad, shape (2,).
        ramp: Velocity after a rise, shape (3,), m/s.
        rise: Its start and end, shape (2,), s.
        vortices: Vortices that move.
    """

    met: IntArray
    tide: Array
    turning: Array
    ramp: Array
    rise: Array
    vortices: MovingVortices


@jit
def varying_velocity(flow, state, t, v, x, y, z):
    """Return the velocity of the flow at a point, as three numbers, m/s."""
    if flow.met[v] == 0:
        return 0.0, 0.0, 0.0
    angle = flow.turning[0] * t + flow.turning[1]
    c, s, start, end = np.cos(angle), np.sin(angle), flow.rise[0], flow.rise[1]
    first, later, ramp = triple(flow.tide[0]), triple(flow.tide[1]), triple(flow.ramp)
    risen = min(max((t - start) / (end - start), 0.0), 1.0)
    wx = c * first[0] + s * later[0] + risen * ramp[0]
    wy = c * first[1] + s * later[1] + risen * ramp[1]
    wz = c * first[2] + s * later[2] + risen * ramp[2]
    vortices = flow.vortices
    for k in range(vortices.core2.shape[0]):
        place, carried, b = triple(vortices.centre[k]), triple(vortices.velocity[k]), triple(vortices.strength[k])
        rx, ry = x - place[0] - carried[0] * t, y - place[1] - carried[1] * t
        rz = (z - place[2] - carried[2] * t) * vortices.space[k]
        a = 1.0 / (rx * rx + ry * ry + rz * rz + vortices.core2[k])
        wx += a * (b[1] * rz - b[2] * ry)
        wy += a * (b[2] * rx - b[0] * rz)
        wz += a * (b[0] * ry - b[1] * rx)
    return wx, wy, wz


def pack_varying(tide: Tide | None, ramp: Ramp | None, vortices: MovingVortices, met: IntArray) -> VaryingArrays:
    """Pack flows in time for compiled code."""
    velocities, turning, risen, rise = np.zeros((2, 3)), np.zeros(2), np.zeros(3), np.array([0.0, 1.0])
    if tide is not None:
        along = math.radians(tide.direction)
        velocities[0, :2] = tide.amplitude * np.array([math.cos(along), math.sin(along)])
        velocities[1, :2] = tide.minor * np.array([-math.sin(along), math.cos(along)])
        turning[:] = 2.0 * math.pi / tide.period, math.radians(tide.phase)
    if ramp is not None:
        risen[: len(ramp.velocity)] = ramp.velocity
        rise[:] = ramp.start, ramp.end
    return VaryingArrays(met, velocities, turning, risen, rise, vortices)


def bound_varying(flow: VaryingArrays) -> Bounds:
    """Return the sums of the largest values of all flows.

    A vortex gamma (axis x r) / (r^2 + core^2) is at most |gamma axis| / (2 core), and its Jacobian's norm at most
    |gamma axis| / core^2; at a fixed place it changes by that times the speed of its centre.
    """
    turning = float(np.linalg.norm(flow.tide, axis=1).max())
    rising = float(np.linalg.norm(flow.ramp))
    strength = np.linalg.norm(flow.vortices.strength, axis=1)
    slopes = strength / flow.vortices.core2
    speed = turning + rising + float(np.sum(strength / (2.0 * np.sqrt(flow.vortices.core2))))
    carried = float(np.sum(slopes * np.linalg.norm(flow.vortices.velocity, axis=1)))
    rate = float(flow.turning[0])
    change = turning * rate + rising / float(flow.rise[1] - flow.rise[0]) + carried
    met = (flow.met > 0).astype(np.float64)
    return Bounds(met * speed, met * change, met * float(slopes.sum()), rate)
