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

FOOT = 0.3048  # m
LOWEST = 10.0 * FOOT
"""Lowest altitude of the low-altitude model, m."""
HIGHEST = 1000.0 * FOOT
"""Highest altitude of the low-altitude model, m."""

_NODES_PER_LENGTH = 100.0  # of the shortest scale length in a frozen field
_MAX_NODES = 8_000_000  # of a frozen field: 200 MB
_MARGIN = 20.0  # scale lengths beyond what vehicles meet from where they begin
_STATES = 5  # u, and two each for v and w
_NUMBERS = 19  # of a filter
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
        "MIL-F-8785C", description="source of scale lengths and filters"
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

    def scales(self, altitude: float) -> tuple[Array, Array]:
        """Return the standard deviations (3,), m/s, and scale lengths (3,), m, of u, v and w at an altitude, m."""
        vertical = 0.1 * self.wind_speed
        horizontal = vertical / _shape(altitude) ** 0.4
        lengths = self.decay_lengths(altitude)
        if self.standard == "MIL-HDBK-1797":
            lengths = lengths * np.array([1.0, 0.5, 0.5])
        return np.array([horizontal, horizontal, vertical]), lengths

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


class First(NamedTuple):
    """Filter of u over a period: x+ = decay x + noise n, u = size x.

    Attributes:
        decay: Transition.
        noise: Factor of the noise.
        size: Standard deviation of u, m/s.
    """

    decay: float
    noise: float
    size: float


class Second(NamedTuple):
    """Filter of v or w over a period, see the module: x1+ = decay x1 + corner n1, v = one x1 + other x2.

    For the other state, x2+ = slip x1 + decay x2 + below n1 + last n2.
    """

    decay: float
    slip: float
    corner: float
    below: float
    last: float
    one: float
    other: float


class Filter(NamedTuple):
    """Filters of a vehicle's gusts.

    Attributes:
        cosine, sine: Direction of the mean wind.
        u, v, w: Filters of the components.
    """

    cosine: float
    sine: float
    u: First
    v: Second
    w: Second


@inline_jit
def _second(row, k):
    return Second(row[k], row[k + 1], row[k + 2], row[k + 3], row[k + 4], row[k + 5], row[k + 6])


@inline_jit
def filter_of(row):
    """Return the numbers of a row of `GustArrays.filters` by name."""
    return Filter(row[0], row[1], First(row[2], row[3], row[4]), _second(row, 5), _second(row, 12))


def _filter(rates: Array, sigma: Array, direction: Array, period: float) -> Array:
    """Return a row of `GustArrays.filters`."""
    u = First(np.exp(-rates[0] * period), np.sqrt(-np.expm1(-2.0 * rates[0] * period)), sigma[0])
    row = [*direction, *u]
    for rate, size in zip(rates[1:], sigma[1:], strict=True):
        transition, factor = discretise(rate, period)
        corner, below, last = factor[0, 0], factor[1, 0], factor[1, 1]
        row += Second(transition[0, 0], transition[1, 0], corner, below, last, *(size * OUTPUT))
    return np.array(row)


@inline_jit
def _begin(seed, stream, state):
    """Draw the stationary states (5,) of the first sample."""
    a, b, c, d = normals(seed, stream, 0, 0)
    e = normals(seed, stream, 0, 1)[0]
    state[0] = a
    state[1] = b
    state[2] = 0.5 * (b + c)
    state[3] = d
    state[4] = 0.5 * (d + e)


@inline_jit
def _continue_second(f, first, second, state):
    """Take the states (2,) of v or w one sample on, with two normal numbers."""
    state[1] = f.slip * state[0] + f.decay * state[1] + f.below * first + f.last * second
    state[0] = f.decay * state[0] + f.corner * first


@inline_jit
def _continue(f, seed, stream, k, state):
    """Take the states (5,) from sample k - 1 to sample k."""
    a, b, c, d = normals(seed, stream, k, 0)
    e = normals(seed, stream, k, 1)[0]
    state[0] = f.u.decay * state[0] + f.u.noise * a
    _continue_second(f.v, b, c, state[1:3])
    _continue_second(f.w, d, e, state[3:5])


@inline_jit
def _components(f, state):
    """Return u, v and w, m/s."""
    v = f.v.one * state[1] + f.v.other * state[2]
    return f.u.size * state[0], v, f.w.one * state[3] + f.w.other * state[4]


@inline_jit
def _in_world(f, along, left, up):
    """Return components along the wind, to its left and upwards in world axes."""
    return f.cosine * along - f.sine * left, f.sine * along + f.cosine * left, up


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
        stream, f = gusts.streams[gusts.met[v] - 1], filter_of(gusts.filters[gusts.met[v] - 1])
        filters, velocity = state.filters[v], state.velocity[v]
        k = int(state.sample[v])
        if k < 0 or k > n:
            _begin(gusts.seed[0], stream, filters)
            k = 0
        while k < n:
            k += 1
            _continue(f, gusts.seed[0], stream, k, filters)
        state.sample[v] = n
        along, left, up = _components(f, filters)
        velocity[0], velocity[1], velocity[2] = _in_world(f, along, left, up)


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
        filters: Numbers of their filters over a period, shape (G, 19); see `filter_of`.
        clock: Time of sample 0, and the period, shape (2,), s.
    """

    met: IntArray
    seed: IntArray
    streams: IntArray
    filters: Array
    clock: Array

    def new_state(self, take: Take = np.zeros) -> GustState:
        """Return a state for `hold_gusts` to write to."""
        V = len(self.met)
        state = GustState(take(V), take((V, _STATES)), take((V, 3)))
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
    filters = np.zeros((len(vehicles), _NUMBERS))
    for row, v in zip(filters, vehicles, strict=True):
        altitude = gusts.altitude_of(met.positions[v, 2] - met.level)
        direction, speed = gusts.wind(met.wind[v])
        sigma = gusts.scales(altitude)[0]
        row[:] = _filter(speed / gusts.decay_lengths(altitude), sigma, direction, met.period)
    streams = np.array([stream_of("gusts", met.ids[v]) for v in vehicles], dtype=np.int64)
    return GustArrays(number, np.array([met.seed]), streams, filters, np.array([met.start, met.period]))


# -- a frozen field ------------------------------------------------------------------------------------------------


class Place(NamedTuple):
    """Place of the nodes of a frozen field.

    Attributes:
        speed: V, m/s.
        first: xi of the first node, m.
        spacing: Distance of nodes, m.
        u, v, w: Correlation r of each component.
    """

    speed: float
    first: float
    spacing: float
    u: float
    v: float
    w: float


@inline_jit
def place_of(row):
    """Return the numbers of `FrozenArrays.place` by name."""
    return Place(row[0], row[1], row[2], row[3], row[4], row[5])


class FrozenState(NamedTuple):
    """State of a frozen field.

    Attributes:
        time: Time of the sample that is held, by vehicle, shape (V,), s.
    """

    time: Array


@jit
def hold_frozen(gusts, state, t, first, last):
    """Let vehicles from first up to last meet the field as it is at the sample at time t, s."""
    n = sample_at(gusts.clock, t)
    for v in range(first, last):
        state.time[v] = gusts.clock[0] + n * gusts.clock[1]


@jit
def frozen_velocity(gusts, state, t, v, x, y, z):
    """Return the velocity of the field at a point, as three numbers, m/s."""
    if gusts.met[v] == 0:
        return 0.0, 0.0, 0.0
    place, wind, last = place_of(gusts.place), filter_of(gusts.filter), gusts.nodes.shape[0] - 1
    at = (place.speed * state.time[v] - wind.cosine * x - wind.sine * y - place.first) / place.spacing
    at = abs(at) % (2.0 * last)
    if at > last:
        at = 2.0 * last - at
    k = min(int(at), last - 1)
    f = at - k
    both = (1.0 - f) * (1.0 - f) + f * f
    mixed = 2.0 * f * (1.0 - f)
    one, other = gusts.nodes[k], gusts.nodes[k + 1]
    along = ((1.0 - f) * one[0] + f * other[0]) / np.sqrt(both + mixed * place.u)
    left = ((1.0 - f) * one[1] + f * other[1]) / np.sqrt(both + mixed * place.v)
    up = ((1.0 - f) * one[2] + f * other[2]) / np.sqrt(both + mixed * place.w)
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
        filter: As a row of `GustArrays.filters`, shape (19,).
        place: Numbers of its `Place`, shape (6,).
        clock: Time of sample 0, and the period, shape (2,), s.
    """

    met: IntArray
    nodes: Array
    filter: Array
    place: Array
    clock: Array

    def new_state(self, take: Take = np.zeros) -> FrozenState:
        """Return a state for `hold_frozen` to write to."""
        return FrozenState(take(len(self.met)))

    def bound(self) -> Bounds:
        """Return bounds, infinite for vehicles that meet the field: it is Gaussian."""
        return unbounded(self.met > 0)


COMPILED[FrozenArrays] = Compiled(frozen_velocity, hold_frozen)


@jit
def _draw_nodes(row, seed, stream, state, nodes):
    f = filter_of(row)
    for k in range(nodes.shape[0]):
        if k == 0:
            _begin(seed, stream, state)
        else:
            _continue(f, seed, stream, k, state)
        nodes[k, 0], nodes[k, 1], nodes[k, 2] = _components(f, state)


def pack_frozen(gusts: Gusts, met: Exposure, name: str) -> FrozenArrays:
    """Pack a frozen field for compiled code, at the mean altitude and in the mean wind of those who meet it.

    Raises:
        InputError: The field would be too long.
    """
    own = met.met
    altitude = float(np.mean([gusts.altitude_of(z - met.level) for z in met.positions[own, 2]]))
    direction, speed = gusts.wind(met.wind[own].mean(axis=0))
    sigma = gusts.scales(altitude)[0]
    lengths = gusts.decay_lengths(altitude)
    spacing = float(lengths.min()) / _NODES_PER_LENGTH
    along = met.positions[own, :2] @ direction
    margin = _MARGIN * float(lengths.max()) + float(np.ptp(along))
    first = speed * met.start - float(along.max()) - margin
    last = speed * met.end - float(along.min()) + margin
    count = int((last - first) / spacing) + 2
    if count > _MAX_NODES:
        raise InputError(
            f"frozen: {met.end - met.start:g} s at {speed:g} m/s need {count} nodes {spacing:.3g} m apart; expected at "
            f"most {_MAX_NODES}: a shorter run, a higher altitude, or frozen: false"
        )
    nodes = np.empty((count, 3))
    row = _filter(1.0 / lengths, sigma, direction, spacing)
    stream = np.array(stream_of("frozen gusts", name), dtype=np.int64)
    _draw_nodes(row, met.seed, stream, np.zeros(_STATES), nodes)
    slip = spacing / lengths
    correlations = np.exp(-slip) * (1.0 - np.array([0.0, 0.5, 0.5]) * slip)
    place = np.array(Place(speed, first, spacing, *correlations))
    of_period = _filter(speed / lengths, sigma, direction, met.period)
    return FrozenArrays(own.astype(np.int64), nodes, of_period, place, np.array([met.start, met.period]))
