"""Waves: one sea for all vehicles, a sum of Airy's waves with phase k . x - omega t.

The spectrum is Pierson and Moskowitz's, S ~ omega^-5 exp(-5/4 (omega_p / omega)^4), or JONSWAP's, which is that times
gamma^exp(-(omega / omega_p - 1)^2 / (2 s^2)), s = 0.07 up to the peak and 0.09 beyond. It is scaled to
m_0 = H_s^2 / 16 by its own integral. With s = (omega_p / omega)^2,

    S d omega ~ s exp(-5/4 s^2) gamma^... ds,   omega^2 S d omega ~ omega_p^2 exp(-5/4 s^2) gamma^... ds,

both smooth but for the peak s = 1. Each of N components has the energy m_0 / N, and the frequency with which the second
moments of the components sum up to m_2: m_0 and m_2 are exact for any N. Each component has one direction.

A component of amplitude a and direction d in water of depth h has, at depth -z below the undisturbed surface,

    eta = a cos(theta),   (u, v) = a omega cosh(k (z + h)) / sinh(k h) cos(theta) d,
    w = a omega sinh(k (z + h)) / sinh(k h) sin(theta),   omega^2 = g k tanh(k h).

Vehicles in the plane meet the velocity at z = 0. Vehicles in space meet it below the undisturbed surface alone.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from mjsheaf.arrays import Array, IntArray, Take
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.media.varying import COMPILED, Bounds, Compiled, Exposure, Moving, sine
from mjsheaf.noise import generator_of
from mjsheaf.section import Number, Positive

GRAVITY = 9.81
"""m/s^2, as in MuJoCo's models."""

_PANELS = 4000  # of the quadrature on each side of the peak
_END = 7.0  # of s: exp(-1.25 * 49) is 2e-27
_GAUSS = np.polynomial.legendre.leggauss(8)
_HALF_PI = 0.5 * np.pi
_TURNS = 0.5 / np.pi  # in a radian


class Waves(Moving):
    """A sea of long-crested waves of many frequencies."""

    kind: Literal["pierson_moskowitz", "jonswap"] = Field(description="spectrum")
    significant_height: Positive = Field(description="significant wave height, 4 m_0^(1/2) [m]")
    peak_period: Positive = Field(description="period at which the spectrum has its peak [s]")
    gamma: Annotated[float, Field(ge=1.0, le=10.0)] | None = Field(
        None, description="peak enhancement of JONSWAP; 3.3 unless given [-]"
    )
    direction: Number = Field(0.0, description="where the waves travel to, from the x axis to port [deg]")
    spreading: Literal["none", "cos2"] = Field(
        "none", description="distribution of directions: all alike, or cos^2 of the angle within 90 deg of `direction`"
    )
    components: Annotated[int, Field(ge=1, le=1000)] = Field(50, description="number of waves [-]")
    depth: Positive | None = Field(None, description="depth of the water; infinite unless given [m]")
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = Field(
        None, description="seed of phases and directions; the scenario's unless given [-]"
    )

    @model_validator(mode="after")
    def _fits(self) -> "Waves":
        if self.kind == "pierson_moskowitz" and self.gamma is not None:
            raise ValueError("gamma: Pierson and Moskowitz's spectrum has none; expected kind jonswap with it")
        return self

    def parts(self, name: str, met: Exposure, reached: IntArray) -> "Iterator[WaveArrays]":
        """Yield the sea."""
        yield pack_waves(self.components_of(met.seed), reached, met.level)

    @property
    def peak_rate(self) -> float:
        """omega_p, rad/s."""
        return 2.0 * math.pi / self.peak_period

    @property
    def steepness(self) -> float:
        """Significant height over the wave length at the peak of the spectrum."""
        return float(
            self.significant_height * wave_numbers(np.array([self.peak_rate]), self.depth)[0] / (2.0 * math.pi)
        )

    def spectrum(self, rate: Array) -> Array:
        """Return S at frequencies in rad/s, m^2 s: the variance of the elevation is its integral."""
        s = (self.peak_rate / rate) ** 2
        total = _quadrature(self._enhancement)[1][-1]
        per_s = s * np.exp(-1.25 * s**2) * self._enhancement(s) / total
        return np.asarray(self.significant_height**2 / 16.0 * per_s * 2.0 * s / rate)

    def _enhancement(self, s: Array) -> Array:
        """Return gamma^... at s."""
        if self.kind == "pierson_moskowitz":
            return np.ones_like(s)
        width = np.where(s >= 1.0, 0.07, 0.09)
        gamma = 3.3 if self.gamma is None else self.gamma
        return np.asarray(gamma ** np.exp(-0.5 * ((s**-0.5 - 1.0) / width) ** 2))

    def sampled(self, seed: int, *, few: int = 20, count: int = 60, bearings: int = 13) -> "Components":
        """Return waves such that sums over smooth functions of frequency are integrals over the spectrum.

        They are at Gauss-Legendre nodes in s, and at nodes of the trapezoidal rule in the direction, which is exact for
        cos^2. If the sea has fewer than `few` waves, they are returned themselves.

        Args:
            seed: Seed of the scenario.
            few: See above.
            count: Number of nodes on each side of the peak.
            bearings: Number of directions, including both ends, which have no waves.
        """
        if self.components < few:
            return self.components_of(seed)
        nodes, weights = np.polynomial.legendre.leggauss(count)
        s = np.concatenate([0.5 * (nodes + 1.0), 1.0 + 0.5 * (_END - 1.0) * (nodes + 1.0)])
        density = np.concatenate([0.5 * weights, 0.5 * (_END - 1.0) * weights])
        density *= s * np.exp(-1.25 * s**2) * self._enhancement(s)
        angles = np.array([0.0]) if self.spreading == "none" else np.linspace(-_HALF_PI, _HALF_PI, bearings)[1:-1]
        share = np.cos(angles) ** 2 / np.sum(np.cos(angles) ** 2)
        energy = np.outer(self.significant_height**2 / 16.0 * density / density.sum(), share).ravel()
        rates = np.repeat(self.peak_rate / np.sqrt(s), len(angles))
        directions = np.tile(math.radians(self.direction) + angles, len(s))
        numbers = wave_numbers(rates, self.depth)
        return Components(np.sqrt(2.0 * energy), rates, numbers, directions, np.zeros_like(rates), self.depth)

    def components_of(self, seed: int) -> "Components":
        """Draw the waves, with the scenario's seed."""
        edges, energy, second = _quadrature(self._enhancement)
        shares = np.linspace(0.0, energy[-1], self.components + 1)
        ends = np.interp(shares, energy, edges)
        # omega^2 of each bin, times its energy; the sum of the bins is the integral, wherever they end.
        rates = self.peak_rate * np.sqrt(np.diff(np.interp(ends, edges, second)) * self.components / energy[-1])
        rng = generator_of(seed if self.seed is None else self.seed, "waves")
        phases = rng.uniform(0.0, 2.0 * np.pi, self.components)
        directions = np.full(self.components, math.radians(self.direction))
        if self.spreading == "cos2":
            # Their distribution about it is 1/2 + x / pi + sin(2 x) / (2 pi) for x within a quarter of a turn.
            angles = np.linspace(-_HALF_PI, _HALF_PI, 20_001)
            share = 0.5 + angles / np.pi + np.sin(2.0 * angles) / (2.0 * np.pi)
            directions += np.interp(rng.uniform(0.0, 1.0, self.components), share, angles)
        amplitude = np.full(self.components, self.significant_height / math.sqrt(8.0 * self.components))
        return Components(amplitude, rates, wave_numbers(rates, self.depth), directions, phases, self.depth)


class Components(NamedTuple):
    """The waves of a sea, N of them.

    Attributes:
        amplitude: m, shape (N,).
        rate: omega, rad/s, shape (N,).
        number: k, rad/m, shape (N,).
        direction: Angle from the x axis to port, rad, shape (N,).
        phase: rad, shape (N,).
        depth: Depth of the water, m; None if it is infinite.
    """

    amplitude: Array
    rate: Array
    number: Array
    direction: Array
    phase: Array
    depth: float | None

    @property
    def unit(self) -> Array:
        """Unit vectors of the directions, shape (N, 2)."""
        return np.column_stack([np.cos(self.direction), np.sin(self.direction)])

    @property
    def speed(self) -> Array:
        """Amplitudes of the horizontal velocity at the undisturbed surface, shape (N,), m/s."""
        return self.amplitude * self.rate / np.tanh(self.number * (self.depth or np.inf))

    def speeds_at(self, height: Array) -> tuple[Array, Array]:
        """Return the amplitudes of the velocity along the wave and upwards, shapes (N, V), m/s.

        Args:
            height: Heights above the undisturbed surface, 0 or below, shape (V,), m.
        """
        k = self.number[:, None]
        bottom = np.inf if self.depth is None else self.depth
        z = np.maximum(height, -bottom)
        direct, mirrored, twice = np.exp(k * z), np.exp(-k * (z + 2.0 * bottom)), np.exp(-2.0 * k * bottom)
        along = self.speed[:, None] * (direct + mirrored) / (1.0 + twice)
        up = (self.amplitude * self.rate)[:, None] * (direct - mirrored) / (1.0 - twice)
        return along, up


def _quadrature(enhancement: object) -> tuple[Array, Array, Array]:
    """Return edges of panels in s, and the integrals up to each of S and omega^2 S over m_0 and omega_p^2, all (P,)."""
    edges = np.concatenate([np.linspace(0.0, 1.0, _PANELS + 1), np.linspace(1.0, _END, _PANELS + 1)[1:]])
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    s = middle[:, None] + half[:, None] * _GAUSS[0]
    second = np.exp(-1.25 * s**2) * enhancement(s)  # type: ignore[operator]
    sums = [np.append(0.0, np.cumsum(half * (values @ _GAUSS[1]))) for values in (s * second, second)]
    return edges, sums[0], sums[1]


def wave_numbers(rate: Array, depth: float | None) -> Array:
    """Return k, rad/m, of frequencies in rad/s: omega^2 = g k tanh(k h), by Newton's method from a close start."""
    deep = rate**2 / GRAVITY
    if depth is None:
        return deep
    target = deep * depth
    x = np.where(target > 1.0, target, np.sqrt(target))
    for _ in range(30):
        tanh = np.tanh(x)
        x = x - (x * tanh - target) / (tanh + x * (1.0 - tanh**2))
    return np.asarray(x / depth)


# -- compiled ------------------------------------------------------------------------------------------------------


class WaveTable(NamedTuple):
    """N waves at the undisturbed surface, each shape (N,).

    Attributes:
        number_x, number_y: Wave number, 1/m.
        rate: omega, rad/s.
        phase: Phase at the origin at time 0, rad.
        height: Amplitude of the elevation, m.
        rise: Amplitude of its rate, m/s.
        east, north: Amplitudes of the horizontal velocity along x and y, m/s.
        decay: exp(-2 k h).
    """

    number_x: Array
    number_y: Array
    rate: Array
    phase: Array
    height: Array
    rise: Array
    east: Array
    north: Array
    decay: Array


@inline_jit
def table_of(waves):
    """Return `WaveArrays.waves` by name."""
    return WaveTable(waves[0], waves[1], waves[2], waves[3], waves[4], waves[5], waves[6], waves[7], waves[8])


class WaveState(NamedTuple):
    """State of the sea.

    Attributes:
        place: Time and place for which `met` was computed, shape (V, 4), s and m.
        met: Velocity (3), elevation, slopes along x and y, and its rate, shape (V, 7), m/s, m, 1 and m/s.
        waves: Cosine and sine of the phases, and the phases, turns, shape (V, 3, N).
    """

    place: Array
    met: Array
    waves: Array


@jit
def _meet(waves, state, t, v, x, y):
    """Compute what vehicle v meets at the undisturbed surface, unless it is known."""
    place = state.place[v]
    if place[0] == t and place[1] == x and place[2] == y and place[3] == 0.0:
        return
    w, met = table_of(waves.waves), state.met[v]
    cosine, sin, angle = state.waves[v, 0], state.waves[v, 1], state.waves[v, 2]
    for j in range(angle.shape[0]):  # each a loop of its own: only that becomes vector instructions
        angle[j] = _TURNS * (w.number_x[j] * x + w.number_y[j] * y - w.rate[j] * t + w.phase[j])
    for j in range(angle.shape[0]):
        cosine[j] = sine(angle[j] + 0.25)
    for j in range(angle.shape[0]):
        sin[j] = sine(angle[j])
    east, north, height, slope_x, slope_y, rise = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(cosine.shape[0]):
        east += w.east[j] * cosine[j]
        north += w.north[j] * cosine[j]
        height += w.height[j] * cosine[j]
        steep = w.height[j] * sin[j]
        slope_x -= w.number_x[j] * steep
        slope_y -= w.number_y[j] * steep
        rise += w.rise[j] * sin[j]
    met[0], met[1], met[2], met[3] = east, north, rise, height
    met[4], met[5], met[6] = slope_x, slope_y, rise
    place[0], place[1], place[2], place[3] = t, x, y, 0.0


@jit
def _meet_below(waves, t, x, y, z):
    """Return the velocity below the undisturbed surface, z < 0, as three numbers, m/s."""
    w, east, north, up = table_of(waves.waves), 0.0, 0.0, 0.0
    for j in range(w.rate.shape[0]):
        angle = _TURNS * (w.number_x[j] * x + w.number_y[j] * y - w.rate[j] * t + w.phase[j])
        k = np.sqrt(w.number_x[j] * w.number_x[j] + w.number_y[j] * w.number_y[j])
        direct = np.exp(k * z)
        mirrored = np.exp(-k * (z - 2.0 * waves.level[1]))
        # Velocities are those at z = 0, where cosh is (1 + e^(-2 k h)) / 2 of e^(k h).
        along = (direct + mirrored) / (1.0 + w.decay[j]) * sine(angle + 0.25)
        east += w.east[j] * along
        north += w.north[j] * along
        up += w.rise[j] * (direct - mirrored) / (1.0 - w.decay[j]) * sine(angle)
    return east, north, up


@jit
def wave_velocity(waves, state, t, v, x, y, z):
    """Return the velocity of the water that vehicle v meets at a point, as three numbers, m/s."""
    met = waves.met[v]
    if met == 1:
        _meet(waves, state, t, v, x, y)
        return state.met[v, 0], state.met[v, 1], 0.0
    if met == 2 and z < waves.level[0]:
        return _meet_below(waves, t, x, y, max(z - waves.level[0], waves.level[1]))
    return 0.0, 0.0, 0.0


@jit
def wave_surface(waves, state, t, v, x, y):
    """Return elevation, m, slopes along x and y, and rate of the elevation, m/s, of the surface where vehicle v is."""
    _meet(waves, state, t, v, x, y)
    met = state.met[v]
    return met[3], met[4], met[5], met[6]


class WaveArrays(NamedTuple):
    """A sea for compiled code, N waves.

    Attributes:
        met: 0 for vehicles that meet no water, 1 for those at its surface, 2 for those in space, shape (V,).
        waves: `WaveTable` of numbers by wave, shape (9, N).
        level: Height of the undisturbed surface, and of the bottom above it, shape (2,), m; -inf at infinite depth.
    """

    met: IntArray
    waves: Array
    level: Array

    def new_state(self, take: Take = np.zeros) -> WaveState:
        """Return a state for `wave_velocity` and `wave_surface` to write to."""
        V, N = len(self.met), self.waves.shape[1]
        state = WaveState(take((V, 4)), take((V, 7)), take((V, 3, N)))
        state.place[:] = np.nan
        return state

    def bound(self) -> Bounds:
        """Return the sums of the amplitudes of the velocity and of its derivatives, for vehicles that meet waves.

        Below the surface no amplitude is larger than at it. There the velocity along the wave and upwards are a quarter
        of a period apart, so that neither it nor its derivatives exceed their amplitudes along the wave.
        """
        w = WaveTable(*self.waves)
        along, rate, number = np.hypot(w.east, w.north), w.rate, np.hypot(w.number_x, w.number_y)
        met = self.met > 0
        return Bounds(
            speed=met * along.sum(),
            change=met * (along * rate).sum(),
            slope=met * (along * number).sum(),
            rate=float(rate.max()) if met.any() else 0.0,
        )


COMPILED[WaveArrays] = Compiled(wave_velocity, surface=wave_surface)


def pack_waves(components: Components, met: IntArray, level: float) -> WaveArrays:
    """Pack a sea for compiled code; `met` as in `WaveArrays`, the level in m."""
    c, unit = components, components.unit
    bottom = -np.inf if c.depth is None else -c.depth
    decay = np.zeros_like(c.number) if c.depth is None else np.exp(-2.0 * c.number * c.depth)
    speed = c.amplitude * c.rate
    number, velocity = c.number * unit.T, c.speed * unit.T
    rows = WaveTable(number[0], number[1], c.rate, c.phase, c.amplitude, speed, velocity[0], velocity[1], decay)
    return WaveArrays(met, np.ascontiguousarray(rows), np.array([level, bottom]))
