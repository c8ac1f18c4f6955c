"""The loop of the real vehicles, closed through the law, for small motions.

Each vehicle is linearised about the equilibrium in which it holds station in the mean flow that it would meet (see
`simulation.linear`), and all are closed through the law. Where every agent is the same vehicle in the same flow, the
team falls apart into one small matrix for each eigenvalue of H, whatever its size; else the matrix is that of the whole
team, up to LARGEST_WHOLE states that act on one another. Beyond that, vehicles whose responses to a command differ by
2 % at most count as the same, and of others nothing is claimed.

In large motions thrusters meet their limits. The loop leaves out how the flow changes along the way, and the targets;
so feedforward and the drift's observer, which see no error, do not show in it.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import linalg, sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.checking.loop.directed import matrix_of
from mjsheaf.checking.loop.held_law import ROUNDS_OF_FITTING_EDGES, UNKNOWN_ROUNDS
from mjsheaf.checking.loop.linear_law import Feedback, LawModel, model_of
from mjsheaf.checking.loop.modelled import require_model
from mjsheaf.checking.loop.targets_loop import targets_loop
from mjsheaf.checking.theorem.certificate import Certificate
from mjsheaf.checking.theorem.constants import agent_flow, agent_motion
from mjsheaf.checking.theorem.targets import TargetPath
from mjsheaf.checking.topology.cohomology import DENSE_STATES, Spectrum, spectrum_of
from mjsheaf.errors import InputError, NoModelError, OverpoweredError, UndecidedError
from mjsheaf.io.section import Record
from mjsheaf.media.moving import WITHOUT_MEAN
from mjsheaf.simulation.linear import HeldPoint, LinearVehicle, linearise, power
from mjsheaf.system import System, whole_ratio
from mjsheaf.threads import one_thread
from mjsheaf.vehicles.effects import is_one_sided, turning_of

StationKey = tuple[int, bytes]
"""Number of a vehicle; medium and heading in which it holds station."""

LARGEST_WHOLE = 400
"""Largest number of states that act on one another for which the matrix of a team of unlike vehicles is solved."""

_MOST_STATIONS = 200  # vehicles that are linearised one by one; larger teams are represented by some of theirs
_MOST_SAMPLES = 200  # of the path, for the mean flow
_STILL = 1e-3  # m/s: a slower medium is at rest
NEUTRAL_RATE = 1e-5
"""1/s: rates below it are the rounding of neutral directions."""

_OWN_MODE = 0.01  # relative: how far the loop must move a mode for it to count as the loop's
MODE_AT_REST = 1e-6
"""m for 1 rad or 1 m/s of a mode: positions that move less do not take part in it."""

_CROSS_RESPONSE = 1e-3  # of a vehicle's response, across axes or in difference between axes, that is neglected
_RESPONSE_DIFFERENCE = 0.02  # largest difference between representatives of a large team, of a vehicle's response
_WAY = 1.5  # times the speed from which a boat that cannot go astern turns round: what it makes if it has a model
_TURNS = 3.0  # time constants l / |w| of turning into the current that a run must last for a boat to be turned by it
_RESPONSE_TIME = 10.0  # s, over which responses are compared
_GAIN_ACCURACY = 1e-3  # relative, of the largest gain
_LEAST_RATE, _LARGEST_RATE = 1e-3, 1e5  # 1/s, of k1 lambda: where the first instability is looked for
_MOST_DOUBLINGS = 40


Obstacle = Literal["", "overpowered", "no model"]
"""What keeps a vehicle from having a loop: see `BodyLoop`."""


class Swing(Record):
    """A mode of the real vehicles' loop; s is the logarithm of its factor over a period."""

    damping: float = Field(description="damping ratio -Re s / |s|; negative where the mode grows")
    frequency: float = Field(description="natural frequency |s|, rad/s")
    agent: str | None = Field(description="the agent that moves most in it; null where that is not known")


class BodyLoop(Record):
    """The loop of the real vehicles, for small motions: inertia, attitude, thruster lag, hold, in the mean flow."""

    stable: bool | None = Field(description="whether every mode decays, but for what is free; null: see reason")
    spectral_radius: float | None = Field(
        description="largest factor by which a mode that moves a position grows from one evaluation of the law to the "
        "next; below 1 it is stable; null where undecided"
    )
    period: float = Field(description="between evaluations of the law, s: the physics step where the law is continuous")
    largest_gain: float | None = Field(description="from which on a mode grows, 1/s; null: undecided, or none found")
    least_damped: Swing | None = Field(description="the mode with the smallest damping ratio; null where undecided")
    reason: str = Field(description="why it is undecided, or empty")
    obstacle: Obstacle = Field(
        "", description="undecided as an agent cannot hold its place in the mean flow, or has no linear model; or empty"
    )
    stable_over_exact_links: bool | None = Field(
        None, description="the same if nothing is delayed or lost; null where that makes no difference, or is undecided"
    )

    def verdict(self) -> str:
        """The loop in a few words."""
        if self.stable is not False:
            return "the vehicles' loop is " + ("stable" if self.stable else f"undecided: {self.reason}")
        mode = self.least_damped
        who = "" if mode is None or mode.agent is None else f" (about {mode.agent})"
        limit = "" if self.largest_gain is None else f": stable below a gain of {self.largest_gain:.3g} 1/s"
        return f"the vehicles' loop is unstable{who}{limit}"


def held_modes(system: System, spectrum: Spectrum) -> tuple[Array, Array]:
    """Eigenvalues of H other than zero, ascending, and their vectors, shape (n, m)."""
    if system.team.stressed:
        values, vectors = system.team.dirichlet.eigenvectors
        return values[spectrum.nullity :], vectors[:, spectrum.nullity :]
    values, vectors = linalg.eigh(system.team.dirichlet.H.toarray())
    return np.maximum(values[spectrum.nullity :], spectrum.smallest[0]), vectors[:, spectrum.nullity :]


_OF_LOOP = ("stable", "spectral_radius", "largest_gain", "least_damped")  # null where the loop is undecided


class _Modes(NamedTuple):
    """Modes of the closed loop.

    Attributes:
        factor: growth over a period, complex, shape (k,).
        agent: number of the agent that moves most, -1 where unknown, shape (k,).
        moves: True where positions take part, shape (k,).
    """

    factor: NDArray[np.complex128]
    agent: IntArray
    moves: BoolArray


@one_thread
def body_loop(system: System, spectrum: Spectrum, medium: Array, *, gain: bool = True) -> BodyLoop:
    """Close the loop of the team's vehicles in the medium that agents meet, shape (N, 3), m/s: see `mean_medium`.

    Unless `gain`, it does not look for the largest.
    """
    period = system.grid.period
    late = _late_or_lost(system)
    try:
        period, timestep, steps = sampling_of(system)
        require_model(system)
        if not system.team.symmetric and system.law.extended:
            raise UndecidedError("H is not symmetric, and the law has terms")
        if system.team.stressed and system.law.terms.newton + system.law.terms.feedforward > 0:
            raise UndecidedError(ROUNDS_OF_FITTING_EDGES)
        if system.gain <= 0.0:
            raise UndecidedError("the gain is 0")
        if not spectrum.smallest.size:
            raise UndecidedError("nothing is held")
        if late and not gain:
            raise UndecidedError(late)
        loop = _close(system, spectrum, _models(system, medium, timestep, steps), period)
    except (UndecidedError, InputError, np.linalg.LinAlgError) as error:
        stiff = isinstance(error, np.linalg.LinAlgError)  # a step that is not finite
        reason = f"the vehicles cannot be linearised: {error}" if stiff else str(error)
        obstacle: Obstacle = (
            "overpowered"
            if isinstance(error, OverpoweredError)
            else "no model"
            if isinstance(error, NoModelError)
            else ""
        )
        return BodyLoop(**dict.fromkeys(_OF_LOOP), period=period, reason=late or reason, obstacle=obstacle)
    none = NEUTRAL_RATE * period
    modes = _Modes(*(np.concatenate(x) for x in zip(*loop.modes(system.gain), strict=True)))
    size = np.hypot(modes.factor.real, modes.factor.imag)
    taking_part = modes.moves | (size > np.exp(none))
    modes = _Modes(*(x[taking_part] for x in modes))
    radius = float(size[taking_part].max())
    stable = bool(np.log(radius) < none)
    perhaps = isinstance(loop, _Split) and not stable and loop.growth_at_ends(system.gain) < none
    if late:
        exact = None if perhaps else stable
        return BodyLoop(**dict.fromkeys(_OF_LOOP), period=period, reason=late, stable_over_exact_links=exact)
    return BodyLoop(
        stable=None if perhaps else stable,
        spectral_radius=radius,
        period=period,
        largest_gain=loop.largest_gain(system.gain, none) if gain else None,
        least_damped=_least_damped(modes, loop.own, period, system),
        reason="only eigenvalues between the smallest and the largest would be unstable, if H has them"
        if perhaps
        else "",
    )


def sampling_of(system: System) -> tuple[float, float, int]:
    """Return the time between evaluations of the law, the physics timestep, both s, and the steps between evaluations.

    Raises:
        InputError: The timestep does not divide the period.
    """
    ratio = whole_ratio(system.grid.period, system.bodies.timestep)
    timestep = system.grid.period / ratio
    return (timestep, timestep, 1) if system.grid.continuous else (system.grid.period, timestep, ratio)


def _late_or_lost(system: System) -> str:
    """Return how links keep the loop from being closed: it would have to remember what is under way; or empty."""
    links = system.law.links.table
    if links["delay"].any() or links["lossy"].any() or np.isfinite(links["range"]).any():
        return "measurements are delayed or lost"
    return UNKNOWN_ROUNDS if system.law.terms.rounds.imperfect else ""


def loop_along(system: System, time: Array, q_star: Array, *, gain: bool = True) -> BodyLoop:
    """The loop in the mean flow along harmonic extensions, padded, shape (T, N, 3), m, at times (T,), s."""
    path = q_star.reshape(len(time), -1)[:, system.team.slots[: system.team.first_state[-1]]]
    return body_loop(system, spectrum_of(system.team), mean_medium(system, time, path), gain=gain)


def loop_on_path(system: System, certificate: Certificate) -> BodyLoop:
    """The loop in the mean flow along the targets' path."""
    return body_loop(system, certificate.spectrum, medium_on_path(system, certificate.constants.path))


def linear_vehicles(system: System, certificate: Certificate) -> list[LinearVehicle]:
    """Return the linear vehicle of every agent in the mean flow along the targets' path, over a control period.

    Raises:
        UndecidedError: A vehicle has none.
    """
    try:
        steps = whole_ratio(system.grid.period, system.bodies.timestep)
        return _models(system, medium_on_path(system, certificate.constants.path), system.grid.period / steps, steps)
    except (InputError, np.linalg.LinAlgError) as error:
        raise UndecidedError(f"the vehicles cannot be linearised: {error}") from error


def medium_on_path(system: System, path: TargetPath) -> Array:
    """Return the mean velocity of the medium along the targets' path, see `mean_medium`; NaN where none is known.

    Under gusts, which leave no certain path, it is that of targets that stay where they begin.
    """
    gusts = not np.isfinite(system.moving_bounds.speed).all()
    known = (path.cells is not None or gusts) and targets_loop(system).stable
    return mean_medium(system, path.time, path.q_star) if known else np.full((len(system.team.agents), 3), np.nan)


def mean_medium(system: System, time: Array, q_star: Array) -> Array:
    """Mean velocity of the medium relative to each agent's q*, along its path, shape (N, 3), m/s; no disturbance.

    The path is the stacked harmonic extension (T, n_q), m, at times (T,), s.
    """
    stride = max(1, len(q_star) // _MOST_SAMPLES)
    w = agent_flow(system, q_star[::stride])
    w += agent_motion(system, time[::stride], q_star[::stride], WITHOUT_MEAN)
    mean = np.trapezoid(w, time[::stride], axis=0) / float(time[::stride][-1] - time[0])
    return system.team.unpack(mean - (q_star[-1] - q_star[0]) / float(time[-1] - time[0]))


def linear_team(system: System, medium: Array) -> tuple[list[LinearVehicle], float]:
    """Return the linear vehicle of every agent in the medium that it meets, (N, 3), m/s, and the law's period, s.

    Raises:
        UndecidedError: One has none.
        InputError: The timestep does not divide the period.
    """
    _, timestep, steps = sampling_of(system)
    return _models(system, medium, timestep, steps), timestep * steps


def whole_loop(system: System, spectrum: Spectrum, models: list[LinearVehicle]) -> tuple[Array, Array]:
    """Return the matrix of the closed loop, on held positions, states and the law's memory, and the positions' basis.

    Raises:
        UndecidedError: It is too large.
    """
    whole = _Whole(system, spectrum, models, model_of(system.law, system.grid.period))
    return whole.matrix(system.gain), whole.Q


def _models(system: System, medium: Array, timestep: float, steps: int) -> list[LinearVehicle]:
    """The linear vehicle of every agent; agents that are alike share one.

    Of a large team those that meet the extremes of the flow are linearised, and stand for all where they behave alike.

    Raises:
        UndecidedError: one has none, or they do not.
    """
    keys, stations = _stations(system, medium)
    many = len(stations) > _MOST_STATIONS
    chosen = _extreme_stations(stations) if many else list(stations)
    found = linearise([stations[key] for key in chosen], system.control, timestep, steps)
    models = {}
    for key, model in zip(chosen, found, strict=True):
        if isinstance(model, str):
            kind = NoModelError if np.linalg.norm(stations[key].medium) < _STILL else OverpoweredError
            raise kind(_why_no_model(system.team.agents[keys.index(key)].id, stations[key], model))
        turning, speed = turning_of(stations[key].vehicle), float(np.linalg.norm(stations[key].medium))
        if turning is not None and speed < _WAY * turning.speed:
            name = system.team.agents[keys.index(key)].id
            raise NoModelError(
                f"{name} has no linear model at {speed:.3g} m/s through the medium: its vehicle cannot go astern, and "
                f"turns round for a target behind it unless it makes {_WAY * turning.speed:.3g} m/s"
            )
        models[key] = model
    if not many:
        return [models[key] for key in keys]
    if not _alike(list(models.values()), timestep * steps):
        raise UndecidedError("too many vehicles that behave differently in the flows that they meet")
    return [models[chosen[0]]] * len(keys)


def _stations(system: System, medium: Array) -> tuple[list[StationKey], dict[StationKey, HeldPoint]]:
    """Return the key of every agent's station, and the stations.

    Raises:
        UndecidedError: The medium is not known, or faster than an agent may be.
    """
    if not np.isfinite(medium).all():
        raise UndecidedError("the mean flow along q* is not known")
    keys = []
    stations = dict[StationKey, HeldPoint]()
    for i, agent in enumerate(system.team.agents):
        speed = float(np.linalg.norm(medium[i]))
        if speed > system.law.limit[i]:
            raise OverpoweredError(
                f"{agent.id}: the mean flow, {speed:.3g} m/s relative to its q*, is beyond its velocity limit"
            )
        station = station_in(system, i, medium[i])
        keys.append(key_of(station))
        stations.setdefault(keys[-1], station)
    return keys, stations


def key_of(station: HeldPoint) -> StationKey:
    """Return what is equal for stations that share a linear vehicle."""
    return id(station.vehicle), np.round([*station.medium, station.heading], 4).tobytes()


def _extreme_stations(stations: Mapping[StationKey, HeldPoint]) -> list[StationKey]:
    """Choose stations at the extremes of the flow, and some between.

    Raises:
        UndecidedError: They are not all of one vehicle.
    """
    if len({vehicle for vehicle, _ in stations}) > 1:
        raise UndecidedError("too many unlike vehicles")
    flows = np.array([station.medium for station in stations.values()])
    extreme = {*flows.argmin(axis=0), *flows.argmax(axis=0), *np.linspace(0, len(flows) - 1, 20).astype(int)}
    keys = list(stations)
    return [keys[k] for k in sorted(int(k) for k in extreme)]


def _why_no_model(id_: str, station: HeldPoint, failure: str) -> str:
    """Return why an agent has no linear vehicle."""
    speed = float(np.linalg.norm(station.medium))
    why = f"{failure} (some push one way only)" if is_one_sided(station.vehicle) else failure
    if speed < _STILL:
        return f"{id_} has no linear model at rest: {why}"
    return f"{id_} cannot hold station in a mean flow of {speed:.3g} m/s relative to its q*: {why}"


def station_in(system: System, number: int, medium: Array) -> HeldPoint:
    """Return where a vehicle holds station; one that holds no heading turns into the current if the run lasts."""
    vehicle, heading = system.vehicles[number], float(system.bodies.heading[number])
    if vehicle.steering.attitude:
        return HeldPoint(vehicle, medium, heading)
    span = system.grid.period * system.grid.steps
    if float(np.hypot(medium[0], medium[1])) * span < _TURNS * vehicle.steering.hand:
        return HeldPoint(vehicle, np.zeros(3), heading)
    return HeldPoint(vehicle, medium, float(np.arctan2(-medium[1], -medium[0])))


def _response(model: LinearVehicle, period: float) -> Array:
    """Positions after a step of the command, less what an ideal vehicle makes, shape (T, n, n), m per m/s."""
    s, n = model.B.shape
    count = int(np.clip(_RESPONSE_TIME / period, 20, 400))
    stride = max(1, round(_RESPONSE_TIME / period / count))
    step = power(model, stride)
    state, found = np.vstack([np.zeros((s + n, n)), np.eye(n)]), []
    for k in range(count):
        state = step @ state
        found.append(state[s : s + n] - (k + 1) * stride * period * np.eye(n))
    return np.array(found)


def _difference(one: Array, other: Array) -> float:
    """Largest difference of two responses, as a share of the larger of them."""
    return float(np.abs(one - other).max() / max(np.abs(one).max(), np.abs(other).max()))


def _alike(models: list[LinearVehicle], period: float) -> bool:
    """Return True if vehicles respond to a command in nearly the same way."""
    first = _response(models[0], period)
    responses = (_response(model, period) for model in models[1:])
    return all(r.shape == first.shape and _difference(r, first) <= _RESPONSE_DIFFERENCE for r in responses)


def _close(system: System, spectrum: Spectrum, models: list[LinearVehicle], period: float) -> "_Split | _Whole":
    """The loop of the team, apart by modes of H where that is exact.

    Raises:
        UndecidedError: it is too large.
    """
    law = model_of(system.law, system.grid.period)
    kinds = _distinct(models)
    if len(kinds) > 1:
        try:
            return _Whole(system, spectrum, models, law)
        except UndecidedError:
            if not _alike(kinds, period):
                raise
    plain = system.team.symmetric and not system.team.stressed
    parts = _parts(system, spectrum, kinds[0], period) if plain else []
    return _Split(law, parts) if parts else _Whole(system, spectrum, models, law)


def _distinct(models: list[LinearVehicle]) -> list[LinearVehicle]:
    """Return the models of which none is another one."""
    return list({id(model): model for model in models}.values())


class _Part(NamedTuple):
    """Alike vehicles whose loop falls apart into one small matrix for each eigenvalue.

    Attributes:
        plant: Dynamics of each vehicle along the axes of this part.
        values: eigenvalues above zero, ascending, or a sampling of the interval that holds them, the largest exact.
        agent: number of the agent that moves most in each one's mode; -1 where the value need not be an eigenvalue.
    """

    plant: LinearVehicle
    values: Array
    agent: IntArray


def _parts(system: System, spectrum: Spectrum, model: LinearVehicle, period: float) -> list[_Part]:
    """The parts of a team of alike vehicles; none where they do not fall apart.

    Axes that neither the vehicle nor H couples are apart. Within one part, H is the same along all axes and does not
    couple them; or the vehicle is and does not.
    """
    H = sparse.csr_array(system.team.dirichlet.H)
    n = model.D.shape[0]
    response = _response(model, period)
    by_vehicle = np.abs(response).max(axis=0) > _CROSS_RESPONSE * np.abs(response).max()
    by_sheaf = np.zeros((n, n), dtype=bool)
    rows, columns = H.nonzero()
    by_sheaf[rows % n, columns % n] = True
    blocks = [H[a::n, a::n] for a in range(n)]
    count, group = connected_components(by_vehicle | by_sheaf, directed=False)
    parts = []
    for g in range(count):
        axes = np.flatnonzero(group == g)
        first = axes[0]
        if not _couples(by_sheaf, axes) and all(abs(blocks[a] - blocks[first]).max() == 0.0 for a in axes):
            part = blocks[first]
            agents = np.arange(H.shape[0] // n)
        elif not _couples(by_vehicle, axes) and all(
            _difference(response[:, a, a], response[:, first, first]) <= _CROSS_RESPONSE for a in axes
        ):
            held = np.flatnonzero(np.isin(np.arange(H.shape[0]) % n, axes))
            part = H[held][:, held]
            agents = held // n
            axes = axes[:1]
        else:
            return []
        values, agent = _eigenvalues(part, agents, float(spectrum.smallest[0]))
        if len(values):
            plant = LinearVehicle(model.A, model.B[:, axes], model.C[axes], model.D[np.ix_(axes, axes)])
            parts.append(_Part(plant, values, agent))
    return parts


def _couples(coupling: BoolArray, axes: IntArray) -> bool:
    """Return True if some of the axes are coupled to others of them."""
    return bool(coupling[np.ix_(axes, axes)][~np.eye(len(axes), dtype=bool)].any())


def _eigenvalues(H: sparse.csr_array, agents: IntArray, least: float) -> tuple[Array, IntArray]:
    """Values and agents as in `_Part`, of a part of H whose rows belong to `agents`.

    `least` is the smallest eigenvalue of all H above zero.
    """
    if H.shape[0] <= DENSE_STATES:
        values, vectors = np.linalg.eigh(H.toarray())
        held = values > 0.5 * least
        return values[held], agents[np.abs(vectors[:, held]).argmax(axis=0)]
    top, vector = eigsh(H, k=1, which="LA", v0=np.ones(H.shape[0]))
    values = np.geomspace(least, max(float(top[0]), least), 200)
    return values, np.append(np.full(len(values) - 1, -1), agents[np.abs(vector[:, 0]).argmax()])


class _Split:
    """Alike vehicles: one small matrix for each eigenvalue of H.

    Attributes:
        own: factors of the vehicles' own modes, under a command that does not change.
    """

    def __init__(self, law: LawModel, parts: list[_Part]) -> None:
        self._law = law
        self._parts = parts
        self.own = np.concatenate([np.linalg.eigvals(part.plant.A) for part in parts])

    def modes(self, gain: float) -> Iterator[_Modes]:
        """All modes, or those at the sampled eigenvalues."""
        for part in self._parts:
            n = part.plant.D.shape[0]
            factors, vectors = np.linalg.eig(_joined(part.plant, self._law.feedback(gain, part.values)))
            moved = np.linalg.norm(vectors[:, :n], axis=1) > MODE_AT_REST * np.linalg.norm(vectors, axis=1)
            yield _Modes(factors.ravel(), np.repeat(part.agent, factors.shape[1]), moved.ravel())

    def growth_at_ends(self, gain: float) -> float:
        """Growth of the modes at eigenvalues that H surely has."""
        return max(float(self._growths(part, gain, part.values[part.agent >= 0]).max()) for part in self._parts)

    def _growth(self, gain: float) -> float:
        return max(float(self._growths(part, gain, part.values).max()) for part in self._parts)

    def _growths(self, part: _Part, gain: float, values: Array) -> Array:
        """Growth over a period of the fastest growing mode at each eigenvalue of H, shape (k,)."""
        factors = np.linalg.eigvals(_joined(part.plant, self._law.feedback(gain, values)))
        return np.asarray(np.log(np.abs(factors).max(axis=1)))

    def largest_gain(self, gain: float, most: float) -> float | None:
        """See BodyLoop; `most` is the growth over a period that counts as none."""
        if not self._law.plain:  # there is more in the loop than k1 lambda
            return _first_beyond(self._growth, gain, most)
        found = [self._first_unstable(part, most) for part in self._parts]
        gains = [rate / float(p.values[-1]) for rate, p in zip(found, self._parts, strict=True) if rate is not None]
        return min(gains) if gains and min(gains) > 0.0 else None

    def _first_unstable(self, part: _Part, most: float) -> float | None:
        """Find the smallest rate k1 lambda at which a mode grows, 1/s; None if none does, 0 if the smallest tried."""
        grid = np.geomspace(_LEAST_RATE, _LARGEST_RATE, 200)
        unstable = np.flatnonzero(self._growths(part, 1.0, grid) > most)
        if not unstable.size:
            return None
        if unstable[0] == 0:
            return 0.0
        low, high = grid[unstable[0] - 1], grid[unstable[0]]
        return _bisect(lambda rate: bool(self._growths(part, 1.0, np.array([rate]))[0] > most), float(low), float(high))


def _joined(plant: LinearVehicle, law: Feedback) -> Array:
    """Close the loop of one vehicle for each eigenvalue of H, on its position, its state and what the law remembers.

    The law acts along each of the n axes alike, so that of every number it remembers there are n.
    """
    n = plant.D.shape[0]
    L, r = law.b.shape
    at = n + len(plant.A)
    push = np.vstack([plant.D, plant.B])
    M = np.zeros((L, at + r * n, at + r * n))
    M[:, :n, :n] = np.eye(n)
    M[:, :n, n:at] = plant.C
    M[:, n:at, n:at] = plant.A
    M[:, :at, :n] += law.d[:, None, None] * push
    M[:, :at, at:] = np.kron(law.c[:, None, :], push)
    M[:, at:, :n] = np.kron(law.b[:, :, None], np.eye(n))
    M[:, at:, at:] = np.kron(law.A, np.eye(n))
    return M


def _first_beyond(growth: Callable[[float], float], gain: float, most: float) -> float | None:
    """The gain from which on a mode grows: the next above a gain that is stable, or below one that is not."""
    low = high = gain
    up = growth(gain) < most
    for _ in range(_MOST_DOUBLINGS):
        low, high = (high, 2.0 * high) if up else (0.5 * low, low)
        if (growth(high if up else low) < most) != up:
            return _bisect(lambda k: growth(k) > most, low, high)
    return None


def _bisect(unstable: Callable[[float], bool], low: float, high: float) -> float:
    """Find where a stable rate or gain becomes an unstable one."""
    while high > (1.0 + _GAIN_ACCURACY) * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return float(np.sqrt(low * high))


class _Whole:
    """Unlike vehicles: the matrix of the team on (p, x_1, ..., what the law remembers), p what H holds.

    It is block triangular over the sets of states that act on one another, whose own blocks have all its eigenvalues.
    """

    def __init__(self, system: System, spectrum: Spectrum, models: list[LinearVehicle], law: LawModel) -> None:
        team = system.team
        H = team.dirichlet.H if team.symmetric else matrix_of(team)
        states = H.shape[0] + sum(len(model.A) for model in models)
        if states > 10 * LARGEST_WHOLE:
            raise UndecidedError(f"too many unlike vehicles: {states} states")
        self._law = law
        self._held = H if isinstance(H, np.ndarray) else H.toarray()
        self.Q = np.eye(len(self._held))
        if not team.symmetric and not team.law_problem.unique:
            self.Q = linalg.null_space(team.law_problem.null_basis.T)
        elif team.symmetric and spectrum.nullity:
            values, self.Q = held_modes(system, spectrum)
            self._held = np.diag(values)
        Q = self.Q
        A, B, C, D = (linalg.block_diag(*matrices) for matrices in zip(*models, strict=True))
        self.m = Q.shape[1]
        self._free = np.block([[np.eye(self.m), Q.T @ C], [np.zeros((len(A), self.m)), A]])
        self._push = np.vstack([Q.T @ D @ Q, B @ Q])  # what a command, in these coordinates, does to (p, x)
        if not team.symmetric:  # a command of the agents, which need not be in these coordinates
            self._push = np.vstack([Q.T @ D, B])
            self._held = self._held @ Q
        self.own = np.concatenate([np.linalg.eigvals(model.A) for model in _distinct(models)])
        self.owner = np.repeat(np.arange(len(team.agents)), [a.dimension for a in team.agents])
        acts = self.matrix(1.0) != 0.0
        count, which = connected_components(sparse.csr_array(acts), directed=True, connection="strong")
        self.sets = [np.flatnonzero(which == k) for k in range(count)]
        largest = max(map(len, self.sets))
        if largest > LARGEST_WHOLE:
            raise UndecidedError(f"too many unlike vehicles: {largest} states act on one another")

    def matrix(self, gain: float) -> Array:
        """Return the matrix at a gain."""
        m = self.m
        if self._law.plain:
            M = self._free.copy()
            M[:, :m] -= gain * self._push @ self._held
            return M
        values, T = np.linalg.eigh(self._held)
        law = self._law.feedback(gain, values)
        at, r = len(self._free), law.b.shape[1]
        M = np.zeros((at + r * m, at + r * m))
        M[:at, :at] = self._free
        M[:at, :m] += self._push @ (T * law.d) @ T.T
        for i in range(r):
            rows = slice(at + i * m, at + (i + 1) * m)
            M[:at, rows] = self._push @ (T * law.c[:, i])
            M[rows, :m] = law.b[:, i, None] * T.T
            for k in range(r):
                M[rows, at + k * m : at + (k + 1) * m] = np.diag(law.A[:, i, k])
        return M

    def modes(self, gain: float) -> Iterator[_Modes]:
        """All modes."""
        M = self.matrix(gain)
        for chosen in self.sets:
            factors, vectors = linalg.eig(M[np.ix_(chosen, chosen)])
            held = chosen < self.m
            z = vectors[held]
            moved = np.linalg.norm(z, axis=0) > MODE_AT_REST * np.linalg.norm(vectors, axis=0)
            far = np.abs(self.Q[:, chosen[held]] @ z)
            yield _Modes(factors, np.where(moved, self.owner[far.argmax(axis=0)], -1), moved)

    def _growth(self, gain: float) -> float:
        M = self.matrix(gain)
        return max(float(np.log(np.abs(linalg.eigvals(M[np.ix_(s, s)])).max())) for s in self.sets)

    def largest_gain(self, gain: float, most: float) -> float | None:
        """As in `_Split`."""
        return _first_beyond(self._growth, gain, most)


def _least_damped(modes: _Modes, own: Array, period: float, system: System) -> Swing:
    """Find the mode with the smallest damping among those that the loop moves, where none grows.

    A hull's own rolling or pitching shows in the position a little, is hardly damped, and does not depend on the law.
    A mode is a vehicle's own if its logarithm is within _OWN_MODE of one that the vehicle has under a steady command.
    """
    s = _logarithms(modes.factor) / period
    size = np.maximum(np.abs(s), 1e-300)
    damping = -s.real / size
    if damping.min() >= 0.0:
        moved = np.abs(s[:, None] - _logarithms(own) / period).min(axis=1) > _OWN_MODE * size
        damping = np.where(moved, damping, np.inf) if moved.any() else damping
    k = int(damping.argmin())
    agent = system.team.agent_ids[modes.agent[k]] if modes.agent[k] >= 0 else None
    return Swing(damping=float(damping[k]), frequency=float(size[k]), agent=agent)


def _logarithms(factors: NDArray[Any]) -> NDArray[np.complex128]:
    return np.log(np.where(factors != 0.0, factors, 1e-300).astype(np.complex128))
