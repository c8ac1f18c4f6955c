"""Dryden gusts: air whose velocity is a stationary Gaussian process, discretised exactly.

The velocity has a component u along the mean wind, v to its left and w up. With a = V / L, a component's
autocorrelation is sigma^2 e^(-a t) for u, and sigma^2 e^(-a t) (1 - a t / 2) for v and w. The latter has two states,

    x1' = -a x1 + (2 a)^(1/2) n,   x2' = -a x2 + a x1,   v = c1 x1 + c2 x2,   c1 = sigma (3 / 2)^(1/2),
    c2 = c1 (3^(-1/2) - 1),

with the stationary covariance P = [[1, 1/2], [1/2, 1/2]]. Over a period h their transition is
e^(-a h) [[1, 0], [a h, 1]], and the covariance of what the noise adds is, with x = 2 a h and the lower incomplete gamma
function, [[gamma(1, x), gamma(2, x) / 2], [gamma(2, x) / 2, gamma(3, x) / 4]]: Van Loan's integral in closed form, to
rounding at any h. So the process is stationary from the first sample, and its statistics do not depend on h.

Scale lengths and intensities are those of MIL-F-8785C for low altitude, h in ft, with W20 the wind speed at 20 ft:
L_w = h, L_u = L_v = h / (0.177 + 0.000823 h)^1.2, sigma_w = 0.1 W20, sigma_u = sigma_v =
sigma_w / (0.177 + 0.000823 h)^0.4. MIL-HDBK-1797 halves L_v and L_w, and its filters of v and w have a = V / (2 L): at
low altitude its gusts are those of MIL-F-8785C.

Gusts change at control periods and are held between. What a vehicle meets is a function of the seed, the vehicle's id
and the number of the period alone; the state is what that function has reached, and goes back by starting over.
"""

from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator
from scipy.special import gammainc

from mjsheaf.arrays import Array, IntArray, Take
from mjsheaf.compile.jit import inline_jit, jit
from mjsheaf.errors import InputError, in_field
from mjsheaf.media.varying import COMPILED, Bounds, Compiled, Exposure, Moving, unbounded
from mjsheaf.noise import normals, stream_of
from mjsheaf.section import Number, Positive
from mjsheaf.vectors import triple

FOOT = 0.3048  # m
LOWEST = 10.0 * FOOT
"""Lowest altitude of the low-altitude model, m."""
HIGHEST = 1000.0 * FOOT
"""Highest altitude of the low-altitude model, m."""

_ROUNDING = 1e-6  # of a period


def _shape(altitude: float) -> float:
    """Return 0.177 + 0.000823 h at an altitude in m, h in ft."""
    return 0.177 + 0.000823 * altitude / FOOT


class Gusts(Moving):
    """Dryden gusts in addition to the steady flow."""

    kind: Literal["dryden"] = Field(description="spectrum")
    wind_speed: Positive = Field(description="wind speed at 20 ft (6.1 m), which sets the intensity [m/s]")
    altitude: Number | Literal["from_position"] = Field(
        "from_position",
        description="altitude, 3.048 to 304.8, or from_position: each vehicle's initial height above the surface [m]",
    )
    standard: Literal["MIL-F-8785C", "MIL-HDBK-1797"] = Field(
        "MIL-F-8785C", description="source of scale lengths and filters; at low altitude the gusts of both are the same"
    )
    frozen: bool = Field(
        False,
        description="one field for all vehicles, carried by the mean wind, instead of gusts of each vehicle's own",
    )
    airspeed: Annotated[float, Field(gt=0.0)] = Field(
        1.0, description="lowest speed at which gusts pass, where the mean wind is slower [m/s]"
    )

    @field_validator("altitude")
    @classmethod
    def _low(cls, altitude: float | str) -> float | str:
        if not isinstance(altitude, str) and not LOWEST - 1e-9 <= altitude <= HIGHEST + 1e-9:
            raise ValueError(f"{altitude:g} m; the low-altitude model holds from {LOWEST:g} to {HIGHEST:g} m")
        return altitude

    def altitude_of(self, height: float) -> float:
        """Return the altitude of a vehicle that begins at a height above the surface, m."""
        return float(np.clip(height, LOWEST, HIGHEST)) if isinstance(self.altitude, str) else self.altitude

    def intensities(self, altitude: float) -> Array:
        """Return the standard deviations of u, v and w at an altitude in m, shape (3,), m/s."""
        vertical = 0.1 * self.wind_speed
        horizontal = vertical / _shape(altitude) ** 0.4
        return np.array([horizontal, horizontal, vertical])

    def decay_lengths(self, altitude: float) -> Array:
        """Return V / a of u, v and w at an altitude in m, the same of both standards, shape (3,), m."""
        horizontal = altitude / _shape(altitude) ** 1.2
        return np.array([horizontal, horizontal, altitude])

    def wind(self, velocity: Array) -> tuple[Array, float]:
        """Return the direction (2,) of a mean wind (3,), m/s, and the speed at which gusts pass, m/s."""
        speed = float(np.hypot(velocity[0], velocity[1]))
        direction = velocity[:2] / speed if speed > 0.0 else np.array([1.0, 0.0])
        return direction, max(float(np.linalg.norm(velocity)), self.airspeed)

    def parts(self, name: str, met: Exposure, reached: IntArray) -> "Iterator[FrozenArrays | GustArrays]":
        """Yield gusts of each vehicle's own, or one frozen field."""
        if met.met.any():
            with in_field("gusts"):
                yield pack_frozen(self, met, name) if self.frozen else pack_gusts(self, met)


# -- filters -------------------------------------------------------------------------------------------------------

OUTPUT = np.sqrt(1.5) * np.array([1.0, 1.0 / np.sqrt(3.0) - 1.0])
"""c1 and c2 at sigma = 1."""

_STATIONARY = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, 0.5, 0.5, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 0.5, 0.5],
    ]
)  # factor of the covariance of the states at any time


def discretise(rate: float, period: float) -> tuple[Array, Array]:
    """Return transition (2, 2) and noise factor (2, 2), lower triangular, of the states of v or w over a period, s."""
    x = 2.0 * rate * period
    decay = np.exp(-rate * period)
    transition = decay * np.array([[1.0, 0.0], [rate * period, 1.0]])
    first = gammainc(1.0, x)
    mixed = 0.5 * gammainc(2.0, x)
    second = 0.5 * gammainc(3.0, x)
    corner = np.sqrt(first)
    factor = np.array([[corner, 0.0], [mixed / corner, np.sqrt(second - mixed**2 / first)]])
    return transition, factor


class Filter(NamedTuple):
    """Filters of G gusts over a period: x+ = transition x + noise n, (u, v, w) = output x.

    x (5,) has a state of u and two each of v and w; n (5,) are independent normal numbers.

    Attributes:
        transition, noise: Lower triangular, shape (G, 5, 5).
        output: Shape (G, 3, 5), m/s.
        direction: Direction of the mean wind, shape (G, 2).
    """

    transition: Array
    noise: Array
    output: Array
    direction: Array


def _filter(rates: Array, sigma: Array, direction: Array, period: float) -> Filter:
    """Return the filter of one gust with rates a (3,), 1/s, and standard deviations (3,), m/s."""
    f = Filter(np.zeros((1, 5, 5)), np.zeros((1, 5, 5)), np.zeros((1, 3, 5)), direction[None])
    f.transition[0, 0, 0] = np.exp(-rates[0] * period)
    f.noise[0, 0, 0] = np.sqrt(-np.expm1(-2.0 * rates[0] * period))
    f.output[0, 0, 0] = sigma[0]
    for row, states in ((1, slice(1, 3)), (2, slice(3, 5))):
        f.transition[0, states, states], f.noise[0, states, states] = discretise(rates[row], period)
        f.output[0, row, states] = sigma[row] * OUTPUT
    return f


@inline_jit
def _continue(transition, noise, seed, stream, k, state):
    """Take the states (5,) to sample k."""
    a, b, c, d = normals(seed, stream, k, 0)
    n = (a, b, c, d, normals(seed, stream, k, 1)[0])
    for i in range(4, -1, -1):  # backwards, as lower triangular matrices take what is before a state
        total = 0.0
        for j in range(i + 1):
            total += transition[i, j] * state[j]
        for j in range(i + 1):
            total += noise[i, j] * n[j]
        state[i] = total


@inline_jit
def _begin(seed, stream, state):
    """Draw the stationary states (5,) of the first sample."""
    state[:] = 0.0
    _continue(_STATIONARY, _STATIONARY, seed, stream, 0, state)


@inline_jit
def _components(output, state):
    """Return u, v and w, m/s."""
    v, w = output[1], output[2]
    return output[0, 0] * state[0], v[1] * state[1] + v[2] * state[2], w[3] * state[3] + w[4] * state[4]


@inline_jit
def _in_world(direction, along, left, up):
    """Return components along the wind, to its left and upwards in world axes."""
    c, s = direction[0], direction[1]
    return c * along - s * left, s * along + c * left, up


# -- gusts of each vehicle's own -----------------------------------------------------------------------------------


class GustState(NamedTuple):
    """State of the gusts.

    Attributes:
        sample: Number of the sample of each vehicle, -1 before the first, shape (V,).
        filters: States of the filters, shape (V, 5).
        velocity: Velocity in world axes, shape (V, 3), m/s.
    """

    sample: Array
    filters: Array
    velocity: Array


@jit
def hold_gusts(gusts, state, t, first, last):
    """Let vehicles from first up to last meet the gusts of the sample at time t, s."""
    n = sample_at(gusts.clock, t)
    for v in range(first, last):
        if gusts.met[v] == 0 or state.sample[v] == n:
            continue
        g, own, velocity = gusts.met[v] - 1, state.filters[v], state.velocity[v]
        k = int(state.sample[v])
        if k < 0 or k > n:
            _begin(gusts.seed[0], gusts.streams[g], own)
            k = 0
        while k < n:
            k += 1
            _continue(gusts.filter.transition[g], gusts.filter.noise[g], gusts.seed[0], gusts.streams[g], k, own)
        state.sample[v] = n
        along, left, up = _components(gusts.filter.output[g], own)
        velocity[0], velocity[1], velocity[2] = _in_world(gusts.filter.direction[g], along, left, up)


@inline_jit
def sample_at(clock, t):
    """Return the number of the sample whose values are held at time t, s."""
    return max(int(np.floor((t - clock[0]) / clock[1] + _ROUNDING)), 0)


@inline_jit
def gust_velocity(gusts, state, t, v, x, y, z):
    """Return the velocity of vehicle v's gusts, as three numbers, m/s."""
    return state.velocity[v, 0], state.velocity[v, 1], state.velocity[v, 2]


class GustArrays(NamedTuple):
    """Gusts of V vehicles, each with its own.

    Attributes:
        met: Number of each vehicle that meets gusts among those that do, from 1 on; 0 for the others, shape (V,).
        seed: Seed of the run, shape (1,).
        streams: Random streams of those that do, shape (G, 2).
        filter: Their filters over a period.
        clock: Time of sample 0, and the period, shape (2,), s.
    """

    met: IntArray
    seed: IntArray
    streams: IntArray
    filter: Filter
    clock: Array

    def new_state(self, take: Take = np.zeros) -> GustState:
        """Return a state for `hold_gusts` to write to."""
        V = len(self.met)
        state = GustState(take(V), take((V, 5)), take((V, 3)))
        state.sample[:] = -1.0
        return state

    def bound(self) -> Bounds:
        """Return bounds, infinite for vehicles that meet gusts: they are Gaussian."""
        return unbounded(self.met > 0)


COMPILED[GustArrays] = Compiled(gust_velocity, hold_gusts)


def pack_gusts(gusts: Gusts, met: Exposure) -> GustArrays:
    """Pack gusts of each vehicle's own for compiled code."""
    vehicles = np.flatnonzero(met.met).tolist()
    number = np.where(met.met, np.cumsum(met.met), 0)
    filters = []
    for v in vehicles:
        altitude = gusts.altitude_of(met.positions[v, 2] - met.level)
        direction, speed = gusts.wind(met.wind[v])
        sigma = gusts.intensities(altitude)
        filters.append(_filter(speed / gusts.decay_lengths(altitude), sigma, direction, met.period))
    streams = np.array([stream_of("gusts", met.ids[v]) for v in vehicles], dtype=np.int64)
    together = Filter(*map(np.concatenate, zip(*filters, strict=True)))
    return GustArrays(number, np.array([met.seed]), streams, together, np.array([met.start, met.period]))


# -- a frozen field ------------------------------------------------------------------------------------------------


@jit
def hold_frozen(gusts, state, t, first, last):
    """Let vehicles from first up to last meet the field as it is at the sample at time t, s."""
    n = sample_at(gusts.clock, t)
    for v in range(first, last):
        state[v] = gusts.clock[0] + n * gusts.clock[1]


@jit
def frozen_velocity(gusts, state, t, v, x, y, z):
    """Return the velocity of the field at a point, as three numbers, m/s."""
    if gusts.met[v] == 0:
        return 0.0, 0.0, 0.0
    wind, last = gusts.filter.direction[0], gusts.nodes.shape[0] - 1
    speed, first, spacing = triple(gusts.track)
    at = (speed * state[v] - wind[0] * x - wind[1] * y - first) / spacing
    at = abs(at) % (2.0 * last)
    if at > last:
        at = 2.0 * last - at
    k = min(int(at), last - 1)
    f = at - k
    both = (1.0 - f) * (1.0 - f) + f * f
    mixed = 2.0 * f * (1.0 - f)
    one, other = gusts.nodes[k], gusts.nodes[k + 1]
    along = ((1.0 - f) * one[0] + f * other[0]) / np.sqrt(both + mixed * gusts.correlation[0])
    left = ((1.0 - f) * one[1] + f * other[1]) / np.sqrt(both + mixed * gusts.correlation[1])
    up = ((1.0 - f) * one[2] + f * other[2]) / np.sqrt(both + mixed * gusts.correlation[2])
    return _in_world(wind, along, left, up)


class FrozenArrays(NamedTuple):
    """A field of gusts that the mean wind carries, the same for all vehicles.

    With s the distance along the wind, it is a function of xi = V t - s, given at nodes. Between two nodes with the
    correlation r it is ((1 - f) g_0 + f g_1) / ((1 - f)^2 + f^2 + 2 f (1 - f) r)^(1/2), whose variance is that at the
    nodes. Distances below that of nodes, a hundredth of the shortest scale length, are not resolved. Beyond the last
    node, far beyond where vehicles begin, it is mirrored.

    Attributes:
        met: 1 for vehicles that meet it, else 0, shape (V,).
        nodes: u, v and w at the nodes, shape (n, 3), m/s.
        filter: The filter that it is at a fixed place, over a period.
        track: V, m/s, xi of the first node, m, and the distance of nodes, m, shape (3,).
        correlation: Correlation r of each component, shape (3,).
        clock: Time of sample 0, and the period, shape (2,), s.
    """

    met: IntArray
    nodes: Array
    filter: Filter
    track: Array
    correlation: Array
    clock: Array

    def new_state(self, take: Take = np.zeros) -> Array:
        """Return the time of the sample that is held, by vehicle, shape (V,), s."""
        return take(len(self.met))

    def bound(self) -> Bounds:
        """Return bounds, infinite for vehicles that meet the field: it is Gaussian."""
        return unbounded(self.met > 0)


COMPILED[FrozenArrays] = Compiled(frozen_velocity, hold_frozen)


@jit
def _draw_nodes(filter, seed, stream, state, nodes):
    for k in range(nodes.shape[0]):
        if k == 0:
            _begin(seed, stream, state)
        else:
            _continue(filter.transition[0], filter.noise[0], seed, stream, k, state)
        nodes[k, 0], nodes[k, 1], nodes[k, 2] = _components(filter.output[0], state)


def pack_frozen(
    gusts: Gusts, met: Exposure, name: str, *, fine: float = 100.0, wide: float = 20.0, most: int = 8_000_000
) -> FrozenArrays:
    """Pack a frozen field for compiled code, at the mean altitude and in the mean wind of those who meet it.

    Args:
        gusts, met, name: Section, vehicles, and name of the flow field.
        fine: Nodes in the shortest scale length.
        wide: Scale lengths beyond what vehicles meet from where they begin.
        most: Largest number of nodes: 200 MB.

    Raises:
        InputError: The field would be too long.
    """
    own = met.met
    altitude = float(np.mean([gusts.altitude_of(z - met.level) for z in met.positions[own, 2]]))
    direction, speed = gusts.wind(met.wind[own].mean(axis=0))
    sigma = gusts.intensities(altitude)
    lengths = gusts.decay_lengths(altitude)
    spacing = float(lengths.min()) / fine
    along = met.positions[own, :2] @ direction
    margin = wide * float(lengths.max()) + float(np.ptp(along))
    first = speed * met.start - float(along.max()) - margin
    last = speed * met.end - float(along.min()) + margin
    count = int((last - first) / spacing) + 2
    if count > most:
        raise InputError(
            f"frozen: {met.end - met.start:g} s at {speed:g} m/s need {count} nodes {spacing:.3g} m apart; expected at "
            f"most {most}: a shorter run, a higher altitude, or frozen: false"
        )
    nodes = np.empty((count, 3))
    stream = np.array(stream_of("frozen gusts", name), dtype=np.int64)
    _draw_nodes(_filter(1.0 / lengths, sigma, direction, spacing), met.seed, stream, np.zeros(5), nodes)
    slip = spacing / lengths
    correlations = np.exp(-slip) * (1.0 - np.array([0.0, 0.5, 0.5]) * slip)
    return FrozenArrays(
        met=own.astype(np.int64),
        nodes=nodes,
        filter=_filter(speed / lengths, sigma, direction, met.period),
        track=np.array([speed, first, spacing]),
        correlation=correlations,
        clock=np.array([met.start, met.period]),
    )
