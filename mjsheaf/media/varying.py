"""Analytic flow in time: tides, a flow that sets in, and vortices that move."""

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, IntArray
from mjsheaf.io.section import NonNegative, Number, Point, Positive, Section
from mjsheaf.jit import jit
from mjsheaf.media.bounded import Bounds


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


class VaryingArrays(NamedTuple):
    """Uniform flows in time and moving vortices for compiled code.

    Attributes:
        met: 1 for vehicles that meet them, else 0, shape (V,).
        tide: Velocities at phi = 0 and a quarter of a period later (3 each), m/s, rate, rad/s, and phase, rad; (8,).
        ramp: Velocity, m/s, start and end, s; shape (5,).
        vortices: Centre at time 0 (3), m, its velocity (3), m/s, axis times gamma (3), core^2, m^2, and 1 in space or 0
            in the plane, shape (n, 11).
    """

    met: IntArray
    tide: Array
    ramp: Array
    vortices: Array


class VaryingState(NamedTuple):
    """State of a flow in time.

    Attributes:
        time: Time by vehicle, shape (V,), s.
    """

    time: Array


def new_varying_state(flow: VaryingArrays) -> VaryingState:
    """Return a state for `advance_varying` to write to."""
    return VaryingState(np.zeros(len(flow.met)))


@jit
def advance_varying(flow, t, first, last, state):
    """Bring the flow about the vehicles from first up to last to time t, s."""
    for v in range(first, last):
        state.time[v] = t


@jit
def varying_velocity(flow, state, v, x, y, z):
    """Return the velocity of the flow at a point, as three numbers, m/s."""
    if flow.met[v] == 0:
        return 0.0, 0.0, 0.0
    t, tide, ramp = state.time[v], flow.tide, flow.ramp
    c, s = np.cos(tide[6] * t + tide[7]), np.sin(tide[6] * t + tide[7])
    risen = min(max((t - ramp[3]) / (ramp[4] - ramp[3]), 0.0), 1.0)
    wx = c * tide[0] + s * tide[3] + risen * ramp[0]
    wy = c * tide[1] + s * tide[4] + risen * ramp[1]
    wz = c * tide[2] + s * tide[5] + risen * ramp[2]
    for k in range(flow.vortices.shape[0]):
        p = flow.vortices[k]
        rx, ry, rz = x - p[0] - p[3] * t, y - p[1] - p[4] * t, (z - p[2] - p[5] * t) * p[10]
        a = 1.0 / (rx * rx + ry * ry + rz * rz + p[9])
        wx += a * (p[7] * rz - p[8] * ry)
        wy += a * (p[8] * rx - p[6] * rz)
        wz += a * (p[6] * ry - p[7] * rx)
    return wx, wy, wz


def pack_varying(tide: Tide | None, ramp: Ramp | None, vortices: Array, met: IntArray) -> VaryingArrays:
    """Pack flows in time for compiled code; `vortices` as in `VaryingArrays`."""
    row = np.zeros(8)
    if tide is not None:
        along = math.radians(tide.direction)
        row[:2] = tide.amplitude * np.array([math.cos(along), math.sin(along)])
        row[3:5] = tide.minor * np.array([-math.sin(along), math.cos(along)])
        row[6:] = 2.0 * math.pi / tide.period, math.radians(tide.phase)
    rise = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    if ramp is not None:
        rise[: len(ramp.velocity)] = ramp.velocity
        rise[3:] = ramp.start, ramp.end
    return VaryingArrays(met, row, rise, vortices)


def bound_varying(flow: VaryingArrays) -> Bounds:
    """Return the sums of the largest values of all flows.

    A vortex gamma (axis x r) / (r^2 + core^2) is at most |gamma axis| / (2 core), and its Jacobian's norm at most
    |gamma axis| / core^2; at a fixed place it changes by that times the speed of its centre.
    """
    tide, ramp, rows = flow.tide, flow.ramp, flow.vortices
    turning = float(max(np.linalg.norm(tide[:3]), np.linalg.norm(tide[3:6])))
    rising = float(np.linalg.norm(ramp[:3]))
    strength = np.linalg.norm(rows[:, 6:9], axis=1)
    slopes = strength / rows[:, 9]
    speed = turning + rising + float(np.sum(strength / (2.0 * np.sqrt(rows[:, 9]))))
    carried = float(np.sum(slopes * np.linalg.norm(rows[:, 3:6], axis=1)))
    change = turning * tide[6] + rising / (ramp[4] - ramp[3]) + carried
    met = (flow.met > 0).astype(np.float64)
    return Bounds(met * speed, met * change, met * float(slopes.sum()), float(tide[6]))
