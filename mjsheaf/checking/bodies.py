"""The loop of the real vehicles: whether the team is stable on bodies, and up to which gain.

Each vehicle is linearised about the equilibrium in which it holds station in the mean flow that it would meet (see
`simulation.linear`), and all are closed through u = -k1 H e. Where every agent is the same vehicle in the same
flow, the team falls apart into one small matrix for each eigenvalue of H, whatever its size; else the matrix is that of
the whole team, up to LARGEST_WHOLE states that act on one another. Beyond that, vehicles whose answers to a command
differ by 2 % at most count as the same, and of others nothing is claimed.

It is a statement about small motions: thrusters meet their limits in large ones. Nor does it know how the flow changes
along the way, or what targets do.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.integrate import trapezoid
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh

from mjsheaf.checking.cohomology import DENSE_STATES, Spectrum
from mjsheaf.checking.drift import agent_drift
from mjsheaf.errors import InputError
from mjsheaf.simulation.linear import LinearVehicle, Station, linearise
from mjsheaf.simulation.loop import vehicles_of, whole_ratio
from mjsheaf.system import System
from mjsheaf.threads import one_thread
from mjsheaf.vehicles.vehicle import Vehicle

Array = NDArray[np.float64]

LARGEST_WHOLE = 400
"""Largest number of states that act on one another for which the matrix of a team of unlike vehicles is solved."""

_MOST_STATIONS = 200  # vehicles that are linearised one by one; larger teams are represented by some of theirs
_MOST_SAMPLES = 200  # of the path, for the mean flow
_GROWTH = 1e-5  # 1/s: rates below it are the rounding of neutral directions
_OWN = 0.01  # relative: how far the loop must move a mode for it to count as the loop's
_STILL = 1e-6  # m for 1 rad or 1 m/s of a mode: positions that move less do not take part in it
_APART = 1e-3  # of a vehicle's response: what it does across axes, or differs by between axes, that is neglected
_ALIKE = 0.02  # of a vehicle's response, by which the representatives of a large team may differ
_TURNS = 3.0  # time constants l / |w| of turning into the current that a run must last for a boat to be turned by it
_RESPONSE_TIME = 10.0  # s, over which responses are compared
_GAIN_ACCURACY = 1e-3  # relative, of the largest gain
_LEAST_RATE, _LARGEST_RATE = 1e-3, 1e5  # 1/s, of k1 lambda: where the first instability is looked for
_MOST_DOUBLINGS = 40


@dataclass(frozen=True)
class Swing:
    """A mode of the loop.

    Attributes:
        damping: -Re s / |s|, s the logarithm of its factor over a period; negative where it grows.
        frequency: |s|, rad/s.
        agent: who moves most in it; None where that is not known.
    """

    damping: float
    frequency: float
    agent: str | None


@dataclass(frozen=True)
class BodyLoop:
    """The closed loop of the team's vehicles, evaluated once in each control period.

    Attributes:
        period: between evaluations of the law, s.
        spectral_radius: largest factor by which a mode that moves a position grows in a period; None where undecided.
        stable: whether every mode decays, but for what is free; None where undecided.
        largest_gain: gain at which, coming from below, the first mode begins to grow, 1/s; None where there is none or
            it is not known.
        least_damped: the mode with the smallest damping; None where undecided.
        reason: why it is undecided; empty where it is not.
    """

    period: float
    spectral_radius: float | None
    stable: bool | None
    largest_gain: float | None
    least_damped: Swing | None
    reason: str


class _Mode(NamedTuple):
    """A mode by its factor over a period, the agent that moves most in it (-1: unknown), and if positions move."""

    factor: complex
    agent: int
    moves: bool


class _Loop(Protocol):
    """The team's closed loop as a function of the gain."""

    def modes(self, gain: float) -> Iterator[_Mode]:
        """All modes, or those at the sampled eigenvalues."""
        ...

    def own_factors(self) -> Array:
        """Factors of the vehicles' own modes, under a command that does not change."""
        ...

    def largest_gain(self, gain: float, most: float) -> float | None:
        """See BodyLoop; `most` is the growth over a period that counts as none."""
        ...


class _UndecidedError(Exception):
    """The loop cannot be said; the message says why."""


@one_thread
def body_loop(system: System, spectrum: Spectrum, medium: Array) -> BodyLoop:
    """Close the loop of the team's vehicles.

    Args:
        system: the system.
        spectrum: of its H.
        medium: mean velocity of the medium that each agent meets, relative to its q*, shape (N, 3), m/s: see
            `mean_medium`.
    """
    period, steps = system.grid.period, 1
    try:
        ratio = whole_ratio(period, system.bodies.timestep)
        timestep = period / ratio
        period, steps = (timestep, 1) if system.grid.continuous else (period, ratio)
        if system.gain <= 0.0:
            raise _UndecidedError("the gain is 0")
        if not spectrum.smallest.size:
            raise _UndecidedError("nothing is held")
        loop = _close(system, spectrum, _models(system, medium, timestep, steps), period)
    except (_UndecidedError, InputError) as error:
        return BodyLoop(period, None, None, None, None, str(error))
    except np.linalg.LinAlgError as error:  # a vehicle so stiff that its step is not finite
        return BodyLoop(period, None, None, None, None, f"the vehicles cannot be linearised: {error}")
    none = _GROWTH * period
    moving = [m for m in loop.modes(system.gain) if m.moves or abs(m.factor) > np.exp(none)]
    radius = max(abs(m.factor) for m in moving)
    stable: bool | None = bool(np.log(radius) < none)
    swing = _least_damped(moving, loop.own_factors(), period, system)
    reason = ""
    if isinstance(loop, _Split) and not stable and loop.growth_at_ends(system.gain) < none:
        stable, reason = None, "only eigenvalues between the smallest and the largest would swing up, if H has them"
    return BodyLoop(period, float(radius), stable, loop.largest_gain(system.gain, none), swing, reason)


def mean_medium(system: System, time: Array, q_star: Array) -> Array:
    """Mean velocity of the medium relative to each agent's q*, along its path, shape (N, 3), m/s; no disturbance.

    Args:
        system: the system.
        time: shape (T,), s.
        q_star: harmonic extension, stacked, shape (T, n_q), m.
    """
    stride = max(1, len(q_star) // _MOST_SAMPLES)
    w = agent_drift(system, q_star[::stride])
    span = float(time[-1] - time[0])
    if span <= 0.0:
        return system.team.unpack(w)[0]
    mean = trapezoid(w, time[::stride], axis=0) / float(time[::stride][-1] - time[0])
    return system.team.unpack((mean - (q_star[-1] - q_star[0]) / span)[None])[0]


def _models(system: System, medium: Array, timestep: float, steps: int) -> list[LinearVehicle]:
    """The linear vehicle of every agent; agents that are alike share one.

    Raises:
        _UndecidedError: one has none.
    """
    agents = system.team.agents
    if not np.isfinite(medium).all():
        raise _UndecidedError("the mean flow along q* is not known")
    span = system.grid.period * system.grid.steps
    stations: dict[tuple[int, bytes], Station] = {}
    keys = []
    for i, vehicle in enumerate(vehicles_of(system)[: len(agents)]):
        speed = float(np.linalg.norm(medium[i]))
        if speed > system.law.limit[i]:
            raise _UndecidedError(
                f"{agents[i].id}: the mean flow, {speed:.3g} m/s relative to its q*, is beyond its velocity limit"
            )
        station = _station(vehicle, medium[i], float(system.bodies.heading[i]), span)
        key = id(vehicle), np.round([*station.medium, station.heading], 4).tobytes()
        stations.setdefault(key, station)
        keys.append(key)
    chosen = list(stations)
    if len(chosen) > _MOST_STATIONS:
        return _represented(system, keys, stations, timestep, steps)
    models = dict(zip(chosen, linearise(list(stations.values()), system.control, timestep, steps), strict=True))
    return [_existing(models[key], agents[i].id, stations[key]) for i, key in enumerate(keys)]


def _station(vehicle: Vehicle, medium: Array, heading: float, span: float) -> Station:
    """Where a vehicle holds station: one that holds no heading turns into the current, if the run gives it the time."""
    if vehicle.steering.attitude:
        return Station(vehicle, medium, heading)
    speed = float(np.hypot(medium[0], medium[1]))
    if speed * span < _TURNS * vehicle.hand:
        return Station(vehicle, np.zeros(3), heading)
    return Station(vehicle, medium, float(np.arctan2(-medium[1], -medium[0])))


def _existing(model: LinearVehicle | str, agent: str, station: Station) -> LinearVehicle:
    if isinstance(model, str):
        flow = f"in a mean flow of {np.linalg.norm(station.medium):.3g} m/s relative to its q*"
        raise _UndecidedError(f"{agent} cannot hold station {flow}: {model}")
    return model


def _represented(
    system: System,
    keys: list[tuple[int, bytes]],
    stations: dict[tuple[int, bytes], Station],
    timestep: float,
    steps: int,
) -> list[LinearVehicle]:
    """One model for all agents of a large team, where those that meet the extremes of the flow behave alike.

    Raises:
        _UndecidedError: they do not.
    """
    if len({key[0] for key in keys}) > 1:
        raise _UndecidedError("too many unlike vehicles")
    flows = np.array([station.medium for station in stations.values()])
    extreme = {*flows.argmin(axis=0), *flows.argmax(axis=0), *np.linspace(0, len(flows) - 1, 20).astype(int)}
    chosen = [list(stations)[k] for k in sorted(int(k) for k in extreme)]
    found = linearise([stations[key] for key in chosen], system.control, timestep, steps)
    models = [
        _existing(model, system.team.agent_ids[keys.index(key)], stations[key])
        for model, key in zip(found, chosen, strict=True)
    ]
    if not _alike(models, timestep * steps):
        raise _UndecidedError("too many vehicles that behave differently in the flows that they meet")
    return [models[0]] * len(keys)


def _response(model: LinearVehicle, period: float) -> Array:
    """Positions after a step of the command, less what an ideal vehicle makes, shape (T, n, n), m per m/s."""
    n = model.D.shape[0]
    count = int(np.clip(_RESPONSE_TIME / period, 20, 400))
    stride = max(1, round(_RESPONSE_TIME / period / count))
    s = len(model.A)
    step = np.eye(s + 2 * n)
    step[:s, :s], step[:s, s + n :], step[s : s + n, :s], step[s : s + n, s + n :] = model
    step = np.linalg.matrix_power(step, stride)
    state, found = np.vstack([np.zeros((s + n, n)), np.eye(n)]), []
    for k in range(count):
        state = step @ state
        found.append(state[s : s + n] - (k + 1) * stride * period * np.eye(n))
    return np.array(found)


def _difference(one: Array, other: Array) -> float:
    """Largest difference of two responses, as a share of the larger of them."""
    return float(np.abs(one - other).max() / max(np.abs(one).max(), np.abs(other).max()))


def _close(system: System, spectrum: Spectrum, models: list[LinearVehicle], period: float) -> _Loop:
    """The loop of the team, apart by modes of H where that is exact.

    Raises:
        _UndecidedError: it is too large.
    """
    kinds = list({id(model): model for model in models}.values())
    if len(kinds) > 1:
        try:
            return _Whole(system, spectrum, models)
        except _UndecidedError:
            if not _alike(kinds, period):
                raise
    parts = _parts(system, spectrum, kinds[0], period)
    return _Split(parts) if parts else _Whole(system, spectrum, models)


def _alike(models: list[LinearVehicle], period: float) -> bool:
    """Whether vehicles answer a command in nearly the same way."""
    first = _response(models[0], period)
    responses = (_response(model, period) for model in models[1:])
    return all(r.shape == first.shape and _difference(r, first) <= _ALIKE for r in responses)


class _Part(NamedTuple):
    """Alike vehicles whose loop falls apart into one small matrix for each eigenvalue.

    plant: of each vehicle along the axes of this part; values: eigenvalues above zero, ascending, or a sampling of the
    interval that holds them, the largest exact; who: the agent that moves most in each one's mode, -1: unknown.
    """

    plant: LinearVehicle
    values: Array
    who: NDArray[np.int64]
    exact: bool


def _parts(system: System, spectrum: Spectrum, model: LinearVehicle, period: float) -> list[_Part]:
    """The parts of a team of alike vehicles; none where they do not fall apart.

    Axes that neither the vehicle nor H couples are apart. Within one part, H is the same along all axes and does not
    couple them; or the vehicle is.
    """
    H, n = sparse.csr_array(system.team.dirichlet.H), model.D.shape[0]
    response = _response(model, period)
    scale = np.abs(response).max()
    by_vehicle = np.abs(response).max(axis=0) > _APART * scale
    blocks = [[H[a::n, b::n] for b in range(n)] for a in range(n)]
    by_sheaf = np.array([[abs(block).max() > 0.0 for block in row] for row in blocks])
    count, group = connected_components(by_vehicle | by_sheaf, directed=False)
    parts = []
    for g in range(count):
        axes = np.flatnonzero(group == g)
        inside = np.ix_(axes, axes)
        off = ~np.eye(len(axes), dtype=bool)
        first = axes[0]
        own = [response[:, a, a] for a in axes]
        if not by_sheaf[inside][off].any() and all(abs(blocks[a][a] - blocks[first][first]).max() == 0.0 for a in axes):
            plant, values, vectors, exact = _along(model, axes), *_eigenvalues(blocks[first][first], spectrum)
            who = np.abs(vectors).argmax(axis=0) if len(vectors) else None
        elif not by_vehicle[inside][off].any() and all(_difference(x, own[0]) <= _APART for x in own):
            rows = np.flatnonzero(np.isin(np.arange(H.shape[0]) % n, axes))
            plant, values, vectors, exact = _along(model, axes[:1]), *_eigenvalues(H[rows][:, rows], spectrum)
            who = rows[np.abs(vectors).argmax(axis=0)] // n if len(vectors) else None
        else:
            return []
        if len(values):
            unknown = np.full(len(values), -1)
            unknown[-1:] = -1 if who is None else who[-1]
            parts.append(_Part(plant, values, unknown if who is None or len(who) < len(values) else who, exact))
    return parts


def _along(model: LinearVehicle, axes: NDArray[np.integer]) -> LinearVehicle:
    return LinearVehicle(model.A, model.B[:, axes], model.C[axes], model.D[np.ix_(axes, axes)])


def _eigenvalues(H: sparse.csr_array, spectrum: Spectrum) -> tuple[Array, Array, bool]:
    """Eigenvalues of a part of H above zero, ascending, with their vectors; of a large part, what holds them all.

    Returns:
        Values, vectors (n, k) of the last k of them, and whether the values are exact.
    """
    least = float(spectrum.smallest[0])
    if H.shape[0] <= DENSE_STATES:
        values, vectors = np.linalg.eigh(H.toarray())
        held = values > 0.5 * least
        return values[held], vectors[:, held], True
    top, vector = eigsh(H, k=1, which="LA", v0=np.ones(H.shape[0]))
    return np.geomspace(least, max(float(top[0]), least), 200), vector, False


class _Split:
    """Alike vehicles: one small matrix for each eigenvalue of H."""

    def __init__(self, parts: list[_Part]) -> None:
        self._parts = parts

    def modes(self, gain: float) -> Iterator[_Mode]:
        for part in self._parts:
            n = part.plant.D.shape[0]
            factors, vectors = np.linalg.eig(_matrices(part.plant, gain * part.values))
            moved = np.linalg.norm(vectors[:, :n], axis=1) > _STILL * np.linalg.norm(vectors, axis=1)
            for row, who, moves in zip(factors, part.who, moved, strict=True):
                yield from (_Mode(complex(f), int(who), bool(m)) for f, m in zip(row, moves, strict=True))

    def own_factors(self) -> Array:
        return np.concatenate([np.linalg.eigvals(part.plant.A) for part in self._parts])

    def growth_at_ends(self, gain: float) -> float:
        """Growth of the modes that are known to be there."""
        return max(
            _largest_growth(part.plant, gain * (part.values if part.exact else part.values[-1:]))
            for part in self._parts
        )

    def largest_gain(self, gain: float, most: float) -> float | None:
        found = [_first_unstable(part.plant, most) for part in self._parts]
        gains = [rate / float(p.values[-1]) for rate, p in zip(found, self._parts, strict=True) if rate is not None]
        return min(gains) if gains and min(gains) > 0.0 else None


def _matrices(plant: LinearVehicle, rates: Array) -> Array:
    """The closed loop of one vehicle on (p, x) under u = -rate p, for each rate; shape (k, n + s, n + s)."""
    n, s = plant.D.shape[0], len(plant.A)
    found = np.zeros((len(rates), n + s, n + s))
    found[:, :n, :n] = np.eye(n) - rates[:, None, None] * plant.D
    found[:, n:, :n] = -rates[:, None, None] * plant.B
    found[:, :n, n:], found[:, n:, n:] = plant.C, plant.A
    return found


def _largest_growth(plant: LinearVehicle, rates: Array) -> float:
    return float(np.log(np.abs(np.linalg.eigvals(_matrices(plant, rates))).max()))


def _first_unstable(plant: LinearVehicle, most: float) -> float | None:
    """The smallest rate k1 lambda at which a mode grows, 1/s; None where none does, 0 where the smallest looked at."""
    grid = np.geomspace(_LEAST_RATE, _LARGEST_RATE, 200)
    growth = np.log(np.abs(np.linalg.eigvals(_matrices(plant, grid))).max(axis=1))
    unstable = np.flatnonzero(growth > most)
    if not unstable.size:
        return None
    if unstable[0] == 0:
        return 0.0
    low, high = grid[unstable[0] - 1], grid[unstable[0]]
    return _bisect(lambda rate: _largest_growth(plant, np.array([rate])) > most, float(low), float(high))


def _bisect(unstable: Callable[[float], bool], low: float, high: float) -> float:
    """Where a stable rate or gain becomes an unstable one."""
    while high > (1.0 + _GAIN_ACCURACY) * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return float(np.sqrt(low * high))


class _Whole:
    """Unlike vehicles: the matrix of the team on (z, x_1, ...), z the coordinates of what H holds.

    M(k1) = free - k1 pull. It is block triangular over the sets of states that act on one another, whose own blocks
    have all its eigenvalues.
    """

    def __init__(self, system: System, spectrum: Spectrum, models: list[LinearVehicle]) -> None:
        team, H = system.team, system.team.dirichlet.H
        states = sum(len(model.A) for model in models)
        if H.shape[0] + states > 10 * LARGEST_WHOLE:
            raise _UndecidedError(f"too many unlike vehicles: {H.shape[0] + states} states")
        H = H.toarray()
        Q, pulled = np.eye(len(H)), H
        if spectrum.nullity:
            values, vectors = linalg.eigh(H)
            Q = vectors[:, spectrum.nullity :]
            pulled = Q * np.maximum(values[spectrum.nullity :], spectrum.smallest[0])
        A, B, C, D = (linalg.block_diag(*(model[k] for model in models)) for k in range(4))
        m = Q.shape[1]
        self.free = np.block([[np.eye(m), Q.T @ C], [np.zeros((len(A), m)), A]])
        self.pull = np.block([[Q.T @ D @ pulled, np.zeros((m, len(A)))], [B @ pulled, np.zeros_like(A)]])
        self.Q, self.m = Q, m
        self.own = np.concatenate([np.linalg.eigvals(A) for A in {id(model): model.A for model in models}.values()])
        self.owner = np.repeat(np.arange(len(team.agents)), [a.dimension for a in team.agents])
        acts = (self.free != 0.0) | (self.pull != 0.0)
        count, which = connected_components(sparse.csr_array(acts), directed=True, connection="strong")
        self.sets = [np.flatnonzero(which == k) for k in range(count)]
        largest = max(len(s) for s in self.sets)
        if largest > LARGEST_WHOLE:
            raise _UndecidedError(f"too many unlike vehicles: {largest} states act on one another")

    def _block(self, gain: float, chosen: NDArray[np.integer]) -> Array:
        at = np.ix_(chosen, chosen)
        return np.asarray(self.free[at] - gain * self.pull[at])

    def modes(self, gain: float) -> Iterator[_Mode]:
        for chosen in self.sets:
            factors, vectors = linalg.eig(self._block(gain, chosen))
            held = chosen < self.m
            z = vectors[held]
            moved = np.linalg.norm(z, axis=0) > _STILL * np.linalg.norm(vectors, axis=0)
            far = np.abs(self.Q[:, chosen[held]] @ z)
            for k, factor in enumerate(factors):
                yield _Mode(complex(factor), int(self.owner[far[:, k].argmax()]) if moved[k] else -1, bool(moved[k]))

    def own_factors(self) -> Array:
        return self.own

    def _growth(self, gain: float) -> float:
        return max(float(np.log(np.abs(linalg.eigvals(self._block(gain, s))).max())) for s in self.sets)

    def largest_gain(self, gain: float, most: float) -> float | None:
        low = high = gain
        factor = 2.0 if self._growth(gain) < most else 0.5
        for _ in range(_MOST_DOUBLINGS):
            low, high = (high, high * factor) if factor > 1.0 else (low * factor, low)
            if (self._growth(high if factor > 1.0 else low) < most) == (factor < 1.0):
                return _bisect(lambda k: self._growth(k) > most, low, high)
        return None


def _least_damped(modes: list[_Mode], own: Array, period: float, system: System) -> Swing:
    """The mode with the smallest damping: of those that the loop moves, where none grows.

    A hull's own rolling or pitching shows in the position a little, is hardly damped, and has nothing to do with the
    law. A mode is a vehicle's own if its logarithm is within _OWN of one that the vehicle has under a steady command.
    """
    s = np.array([_logarithm(m.factor) for m in modes]) / period
    size = np.maximum(np.abs(s), 1e-300)
    damping = -s.real / size
    if damping.min() >= 0.0:
        alone = np.array([_logarithm(complex(f)) for f in own]) / period
        moved = np.abs(s[:, None] - alone).min(axis=1) > _OWN * size
        damping = np.where(moved, damping, np.inf) if moved.any() else damping
    k = int(damping.argmin())
    who = system.team.agent_ids[modes[k].agent] if modes[k].agent >= 0 else None
    return Swing(float(damping[k]), float(size[k]), who)


def _logarithm(factor: complex) -> complex:
    return complex(np.log(factor if factor != 0.0 else 1e-300))
