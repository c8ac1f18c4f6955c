"""Analytic flow in time: tides, a flow that sets in, vortices that move, and disturbances.

The disturbances omega_i(t) are bounded, continuous and seeded, as the paper's Assumption 3 has them:

omega(t) = bound * sum_k a_k d_k sin(2 pi nu_k t + phi_k) with unit directions d_k and weights a_k that sum to 1, so
that |omega(t)| <= bound for all t. Frequencies, phases and directions are drawn once from the seed and the vehicle's
id; the function of time is smooth, and the same whatever integrates it, wherever the vehicle stands in the team.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.errors import InputError
from mjsheaf.noise import generator_of
from mjsheaf.section import NonNegative, Number, Point, Positive, Section
from mjsheaf.vectors import add, cross, triple

LARGEST_PHASE = 1e7
"""Largest |rate t + phase| in rad for which the sine of the loops is a sine; it is bounded beyond."""

_TURN = 2.0 * math.pi  # rad
# sin r = r + r^3 P(r^2), |r| <= pi / 2: P interpolates at Chebyshev's points, and is wrong by 4e-17 at most.
_P0, _P1, _P2, _P3 = -0.16666666666666666, 0.008333333333333316, -0.00019841269841254988, 2.755731921916633e-06
_P4, _P5, _P6, _P7 = -2.5052107617354543e-08, 1.605897733376295e-10, -7.643970924523278e-13, 2.7314520351307035e-15


class HarmonicArrays(NamedTuple):
    """The disturbances of the first D vehicles for compiled code, K harmonics each.

    The vehicles after them, most often the targets, have none. amplitude (D, K, 3) m/s; rate (D K,) turns/s and phase
    (D K,) turns, in a row: see `evaluate_sines`.
    """

    amplitude: Array
    rate: Array
    phase: Array


def pack(harmonics: Array) -> HarmonicArrays:
    """Harmonics (V, K, 5) as `draw` gives them, for compiled code."""
    disturbed = np.nonzero(harmonics[..., :3])[0].max(initial=-1) + 1
    turns = harmonics[:disturbed, :, 3:] / _TURN
    amplitude = np.ascontiguousarray(harmonics[:disturbed, :, :3])
    return HarmonicArrays(amplitude, turns[..., 0].ravel(), turns[..., 1].ravel())


@inline_jit
def sine(x):
    """Return the sine of x turns, to a unit in the last place of 1, and in [-1, 1] also where x has lost its digits.

    It is arithmetic alone, without a call or a branch: a loop over it becomes vector instructions. The reduction to a
    quarter of a turn is exact.
    """
    f = x - np.rint(x)
    r = _TURN * max(min(f, 0.5 - f), -0.5 - f)  # beyond a quarter of a turn the sine is that of the rest to half a turn
    s = r * r
    q = s * s
    high = (_P4 + s * _P5) + q * (_P6 + s * _P7)  # in pairs: a shorter chain than Horner's scheme
    return r + r * s * (_P0 + (s * _P1 + q * ((_P2 + s * _P3) + q * high)))


@inline_jit
def evaluate_sines(harmonics, t, first, last, sines):
    """Write the sines of the harmonics of the vehicles from first to last at time t into sines (D K,)."""
    D, K = harmonics.amplitude.shape[:2]
    begin, end = first * K, min(last, D) * K
    rate, phase, out = harmonics.rate[begin:end], harmonics.phase[begin:end], sines[begin:end]
    for j in range(rate.shape[0]):  # vector instructions: nothing else is read, and no index is below 0
        out[j] = sine(rate[j] * t + phase[j])


@inline_jit
def disturbance_velocity(harmonics, sines, v):
    """omega_v as three numbers, m/s, at the time for which `evaluate_sines` was called."""
    amplitude, x, y, z = harmonics.amplitude, 0.0, 0.0, 0.0
    for k in range(amplitude.shape[1] if v < amplitude.shape[0] else 0):
        s = sines[v * amplitude.shape[1] + k]
        x += amplitude[v, k, 0] * s
        y += amplitude[v, k, 1] * s
        z += amplitude[v, k, 2] * s
    return x, y, z


class Disturbance(Section):
    """A bounded, smooth, seeded disturbance velocity."""

    bound: NonNegative = Field(description="largest size, at every time [m/s]")
    frequencies: Annotated[list[Positive], Field(min_length=2, max_length=2)] = Field(
        [0.05, 0.5], description="lowest and highest [Hz]"
    )
    components: Annotated[int, Field(ge=1, le=64)] = Field(6, description="number of harmonics [-]")

    @model_validator(mode="after")
    def _ordered(self) -> "Disturbance":
        if self.frequencies[0] > self.frequencies[1]:
            raise ValueError("a disturbance needs bound >= 0, 0 < lowest <= highest frequency, and a component")
        return self

    @property
    def longest_time(self) -> float:
        """The largest |t| in s up to which the phases of all frequencies stay within LARGEST_PHASE."""
        return LARGEST_PHASE / (2.0 * math.pi * self.frequencies[1]) - 1.0 / self.frequencies[1]

    def require_resolved(self, last: float) -> None:
        """Refuse frequencies whose sine the loops do not resolve up to |t| = `last`, s.

        Raises:
            InputError: naming the time and the frequency up to which they do.
        """
        high = self.frequencies[1]
        if self.bound > 0.0 and last > self.longest_time:
            raise InputError(
                f"frequencies: {high:g} Hz over {last:g} s is a phase of {2.0 * np.pi * high * last:.2g} rad, which a "
                f"sine in double precision does not resolve in the loop; expected at most {LARGEST_PHASE:.0e} rad: "
                f"time.end up to {0.99 * self.longest_time:.3g} s, or up to "
                f"{0.99 * high * self.longest_time / last:.3g} Hz"
            )


def draw(kinds: Sequence[Disturbance | None], dimensions: Sequence[int], ids: Sequence[str], seed: int) -> Array:
    """Draw the harmonics of each vehicle from a stream of its own; vehicles whose kind is None have none.

    Args:
        kinds: disturbance of each vehicle, length V.
        dimensions: Dimension of each vehicle, 2 or 3.
        ids: Ids of the vehicles; each names its stream, so that no other vehicle changes its disturbance.
        seed: Seed of the run.

    Returns:
        Amplitude (3) in m/s, rate in rad/s and phase in rad of each, shape (V, K, 5).
    """
    count = max([kind.components for kind in kinds if kind is not None and kind.bound > 0.0], default=0)
    harmonics = np.zeros((len(kinds), count, 5))
    for _, vehicles in groupby(range(len(kinds)), lambda v: id(kinds[v])):
        first, *others = vehicles
        kind = kinds[first]
        if kind is None or kind.bound == 0.0:
            continue
        own = harmonics[first : first + 1 + len(others), : kind.components]
        drawn = np.empty((3, *own.shape[:2]))
        for v, one in enumerate(own, first):
            rng = generator_of(seed, "disturbance", ids[v])
            one[:, : dimensions[v]] = rng.standard_normal((kind.components, dimensions[v]))
            drawn[:, v - first] = rng.random((3, kind.components))
        share, (low, high) = 0.5 + 0.5 * drawn[0], kind.frequencies
        amplitude = own[..., :3]  # of unit directions
        amplitude /= np.linalg.norm(amplitude, axis=2, keepdims=True)
        amplitude *= kind.bound * (share / share.sum(axis=1, keepdims=True))[..., None]
        own[..., 3] = _TURN * (low + (high - low) * drawn[1])
        own[..., 4] = _TURN * drawn[2]
    return harmonics


def evaluate(harmonics: Array, times: Array) -> Array:
    """omega of every vehicle at many times, shape (T, V, 3), m/s; within LARGEST_PHASE as in the loops, to rounding."""
    turns = times[:, None, None] * (harmonics[..., 3] / _TURN) + harmonics[..., 4] / _TURN
    s = np.sin(_TURN * (turns - np.rint(turns)))
    return np.einsum("tvk,vki->tvi", s, harmonics[..., :3])


def bounds(harmonics: Array) -> Array:
    """omega_bar of every vehicle, the sum of its amplitudes, shape (V,), m/s."""
    return np.asarray(np.linalg.norm(harmonics[..., :3], axis=2).sum(axis=1), dtype=np.float64)


class Compiled(NamedTuple):
    """Compiled functions of a part of a moving medium, a named tuple with a field `met`: 0 for vehicles outside it.

    Attributes:
        velocity: Called with (part, state, t, v, x, y, z); returns three numbers, m/s.
        hold: Called with (part, state, t, first, last) at every sample.
        surface: Called with (part, state, t, v, x, y); returns elevation, slopes along x and y, and rate.
        wind: Called as `velocity`, with a point above a hull; returns the velocity of the air there.
    """

    velocity: Any
    hold: Any = None
    surface: Any = None
    wind: Any = None


COMPILED: dict[type, Compiled] = {}
"""Functions of the parts of each type."""


class Moving(Section, ABC):
    """Base of the sections of what moves in a medium, each a field of `mjsheaf.media.flow.FlowField`.

    Subclasses must implement `parts`, which yields named tuples with arrays for compiled code. Their type has an entry
    in COMPILED, a field `met`, shape (V,), and a method `bound()`, which returns the `Bounds` of what each vehicle can
    meet. A method `new_state(take)` returns a state, if there is one; `take` returns zeros of a shape.
    """

    @abstractmethod
    def parts(self, name: str, met: "Exposure", reached: IntArray) -> Iterator[Any]:
        """Yield what vehicles meet.

        Args:
            name: Name of the flow field, for random streams.
            met: Vehicles that meet the flow field.
            reached: 1 for these vehicles, 2 for vehicles in space that another flow field carries, else 0, shape (V,).

        Raises:
            InputError: It does not fit the run.
        """


class Exposure(NamedTuple):
    """The vehicles that meet a flow field, and how the run is sampled.

    Attributes:
        met: True for those vehicles, shape (V,).
        ids: Ids of all vehicles.
        positions: Initial positions, shape (V, 3), m.
        wind: Steady flow at the initial positions, shape (V, 3), m/s.
        level: Height of the surface, m.
        start, end, period: Times of the first and last sample, and between samples, s.
        seed: Seed of the run.
    """

    met: BoolArray
    ids: Sequence[str]
    positions: Array
    wind: Array
    level: float
    start: float
    end: float
    period: float
    seed: int


class Bounds(NamedTuple):
    """Bounds of the velocity that each of V vehicles can meet of a part of the medium, wherever it is.

    Attributes:
        speed: Largest speed, shape (V,), m/s; infinite where the part is Gaussian.
        change: Largest rate of change at a fixed place, shape (V,), m/s^2.
        slope: Largest norm of the Jacobian, shape (V,), 1/s.
        rate: Highest frequency, rad/s.
    """

    speed: Array
    change: Array
    slope: Array
    rate: float


def unbounded(met: BoolArray) -> Bounds:
    """Return infinite bounds for vehicles that meet a part, shape (V,), and zeros for others."""
    infinite = np.where(met, np.inf, 0.0)
    return Bounds(infinite, infinite, infinite, 0.0)


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


@jit
def varying_velocity(flow, state, t, v, x, y, z):
    """Return the velocity of the flow at a point, as three numbers, m/s."""
    if flow.met[v] == 0:
        return 0.0, 0.0, 0.0
    angle = flow.turning[0] * t + flow.turning[1]
    c, s, start, end = np.cos(angle), np.sin(angle), flow.rise[0], flow.rise[1]
    first, later, ramp = triple(flow.tide[0]), triple(flow.tide[1]), triple(flow.ramp)
    risen = min(max((t - start) / (end - start), 0.0), 1.0)
    w = (
        c * first[0] + s * later[0] + risen * ramp[0],
        c * first[1] + s * later[1] + risen * ramp[1],
        c * first[2] + s * later[2] + risen * ramp[2],
    )
    vortices = flow.vortices
    for k in range(vortices.core2.shape[0]):
        place, carried, b = triple(vortices.centre[k]), triple(vortices.velocity[k]), triple(vortices.strength[k])
        rx, ry = x - place[0] - carried[0] * t, y - place[1] - carried[1] * t
        rz = (z - place[2] - carried[2] * t) * vortices.space[k]
        a = 1.0 / (rx * rx + ry * ry + rz * rz + vortices.core2[k])
        turn = cross(b, (rx, ry, rz))
        w = add(w, (a * turn[0], a * turn[1], a * turn[2]))
    return w


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

    def bound(self) -> Bounds:
        """Return the sums of the largest values of all flows.

        A vortex gamma (axis x r) / (r^2 + core^2) is at most |gamma axis| / (2 core), and its Jacobian's norm at most
        |gamma axis| / core^2; at a fixed place it changes by that times the speed of its centre.
        """
        turning = float(np.linalg.norm(self.tide, axis=1).max())
        rising = float(np.linalg.norm(self.ramp))
        strength = np.linalg.norm(self.vortices.strength, axis=1)
        slopes = strength / self.vortices.core2
        speed = turning + rising + float(np.sum(strength / (2.0 * np.sqrt(self.vortices.core2))))
        carried = float(np.sum(slopes * np.linalg.norm(self.vortices.velocity, axis=1)))
        rate = float(self.turning[0])
        change = turning * rate + rising / float(self.rise[1] - self.rise[0]) + carried
        met = (self.met > 0).astype(np.float64)
        return Bounds(met * speed, met * change, met * float(slopes.sum()), rate)


COMPILED[VaryingArrays] = Compiled(varying_velocity)


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
