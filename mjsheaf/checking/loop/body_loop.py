"""The loop of the real vehicles, closed through the law, for small motions.

Each vehicle is linearised about the equilibrium in which it holds station in the mean flow that it would meet (see
`mjsheaf.loop.linear`), and the law closes the loop of all. If every agent is the same vehicle in the same flow, the
loop of a team of any size decouples into one small matrix for each eigenvalue of H. Otherwise the matrix is that of the
whole team, up to LARGEST_WHOLE coupled states. Beyond that, vehicles whose responses to a command differ by at most 2 %
are treated as equal; if they differ by more, the loop is undecided.

If all measurements have the same delay, it is modelled as a delay of the vehicles' positions (see `held_law.delayed`).
With unequal delays or with losses, the loop is undecided.

The model does not hold for large motions, in which thrusters saturate. It leaves out the change of the flow along the
path, and the targets. Feedforward and the observer of the medium velocity do not depend on the error, so they do not
appear in it.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field
from scipy import linalg, sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh

from mjsheaf.arrays import Array, BoolArray, IntArray
from mjsheaf.checking.loop.held_law import (
    ROUNDS_OF_FITTING_EDGES,
    UNKNOWN_ROUNDS,
    closed,
    common_delay,
    delayed,
    ideal_vehicle,
    loop_of,
)
from mjsheaf.checking.loop.linear_law import LawModel, LinearController, model_of, require_model, without_memory
from mjsheaf.checking.spectrum import DENSE_STATES, Spectrum, matrix_of, spectrum_of
from mjsheaf.checking.theorem.certificate import Certificate
from mjsheaf.checking.theorem.constants import agent_flow, agent_motion
from mjsheaf.checking.theorem.targets import TargetPath, TargetsLoop, TargetsOnBodies, stiffness, targets_loop
from mjsheaf.errors import InputError, NoModelError, OverpoweredError, UndecidedError
from mjsheaf.loop.linear import HeldPoint, LinearVehicle, linearise, power
from mjsheaf.loop.system import Phase, System, whole_ratio
from mjsheaf.media.medium import WITHOUT_MEAN
from mjsheaf.results.dataset import of_phase
from mjsheaf.results.ending import Ending, Stuck, ending_of_motion
from mjsheaf.section import Record
from mjsheaf.threads import one_thread
from mjsheaf.vehicles.effects import hold_station, is_one_sided, turning_of


def period_of_law(system: System) -> float:
    """Return the time between evaluations of the law, s: a physics step if it is continuous.

    Raises:
        InputError: The timestep does not divide the control period.
    """
    return system.timestep if system.grid.continuous else system.grid.period


def ideal_team(system: System) -> list[LinearVehicle]:
    """Return every agent on ideal kinematics."""
    return [ideal_vehicle(system.grid.period, agent.dimension) for agent in system.team.agents]


def linear_vehicles(
    system: System,
    numbers: Sequence[int],
    medium: Array,
    *,
    most_points: int = 200,
) -> list[LinearVehicle]:
    """Return the linear model of some vehicles of a system; equal vehicles share one.

    If there are many vehicles, only those at the extremes of the flow are linearised. They represent all if their
    responses are nearly equal.

    Args:
        system: The system.
        numbers: Numbers of the vehicles, length n.
        medium: Velocity of the medium relative to the place that each holds, shape (n, 3), m/s.
        most_points: Largest number of vehicles that are linearised one by one.

    Raises:
        UndecidedError: A vehicle has no linear model, the responses are too different, or a step is not finite.
    """
    if not np.isfinite(medium).all():
        raise UndecidedError("the mean flow along q* is not known")
    names = [system.team.members[v].id for v in numbers]
    # Keys identify the vehicle's model, and the medium, heading and wind in which it holds its place.
    points = dict[tuple[int, bytes], HeldPoint]()
    keys = []
    for v, name, met in zip(numbers, names, medium, strict=True):
        speed = float(np.linalg.norm(met))
        if speed > system.law.limit[v]:
            raise OverpoweredError(
                f"{name}: the mean flow, {speed:.3g} m/s relative to its place, is beyond its velocity limit"
            )
        point = _held_point(system, v, met)
        keys.append((id(point.vehicle), np.round([*point.medium, point.heading, *point.wind], 4).tobytes()))
        points.setdefault(keys[-1], point)
    many = len(points) > most_points
    chosen = list(points)
    if many:
        if len({vehicle for vehicle, _ in points}) > 1:
            raise UndecidedError("too many unlike vehicles")
        flows = np.array([point.medium for point in points.values()])  # its extremes, and some between
        extreme = {*flows.argmin(axis=0), *flows.argmax(axis=0), *np.linspace(0, len(flows) - 1, 20).astype(int)}
        chosen = [chosen[k] for k in sorted(int(k) for k in extreme)]
    try:
        period = period_of_law(system)
        steps = whole_ratio(period, system.bodies.timestep)
        found = linearise([points[key] for key in chosen], system.control, period / steps, steps)
    except (InputError, np.linalg.LinAlgError) as error:
        raise UndecidedError(f"the vehicles cannot be linearised: {error}") from error
    models = {
        key: _require_linear(names[keys.index(key)], points[key], model)
        for key, model in zip(chosen, found, strict=True)
    }
    if not many:
        return [models[key] for key in keys]
    if not are_alike(list(models.values()), period):
        raise UndecidedError("too many vehicles that behave differently in the flows that they meet")
    return [models[chosen[0]]] * len(keys)


def _require_linear(
    name: str,
    point: HeldPoint,
    model: LinearVehicle | str,
    *,
    still: float = 1e-3,  # m/s: a slower medium is at rest
    way: float = 1.5,  # over the speed above which a boat that cannot reverse turns round; above it there is a model
) -> LinearVehicle:
    """Return the linear vehicle of a member about a point.

    Raises:
        UndecidedError: There is none; `model` is then the reason.
    """
    speed = float(np.linalg.norm(point.medium))
    if isinstance(model, str):
        why = f"{model} (some push one way only)" if is_one_sided(point.vehicle) else model
        blown = " and in its wind" if point.wind.any() else ""
        # Up to its all-way speed, which is horizontal, in still air, a vehicle holds its place in any horizontal flow,
        # even if Newton's method finds no equilibrium, for instance where the angles of azimuth thrusters oscillate.
        known = not blown and abs(float(point.medium[2])) < still
        if speed >= still and not (known and speed <= point.vehicle.capability.least_speed):
            raise OverpoweredError(
                f"{name} cannot hold station in a mean flow of {speed:.3g} m/s relative to its place{blown}: {why}"
            )
        at = "at rest" if speed < still else f"at {speed:.3g} m/s through the medium"
        raise NoModelError(f"{name} has no linear model {at}{blown}: {why}")
    turning = turning_of(point.vehicle)
    if turning is not None and speed < way * turning.speed:
        raise NoModelError(
            f"{name} has no linear model at {speed:.3g} m/s through the medium: its vehicle cannot go astern, and "
            f"turns round for a target behind it unless it makes {way * turning.speed:.3g} m/s"
        )
    return model


def _held_point(
    system: System,
    number: int,
    medium: Array,
    *,
    time_constants: float = 3.0,  # length of a run that turns a boat into the current, over the time constant l / |w|
) -> HeldPoint:
    """Return the point that a vehicle holds; a boat without heading hold turns into the current if the run is long.

    In wind, it turns until there is no lateral force.
    """
    vehicle, heading, wind = system.vehicles[number], float(system.bodies.heading[number]), system.mean_wind[number]
    if wind.any():
        lies, command, _ = hold_station(vehicle, heading, medium, wind + medium)
        lies = heading if vehicle.steering.attitude else lies
        return HeldPoint(vehicle, medium, lies, wind + medium, np.append(command, 0.0))
    if vehicle.steering.attitude:
        return HeldPoint(vehicle, medium, heading)
    span = system.grid.period * system.grid.steps
    if float(np.hypot(medium[0], medium[1])) * span < time_constants * vehicle.steering.hand:
        return HeldPoint(vehicle, np.zeros(3), heading)
    return HeldPoint(vehicle, medium, float(np.arctan2(-medium[1], -medium[0])))


def response_of(
    model: LinearVehicle,
    period: float,
    *,
    span: float = 10.0,  # s, over which responses are compared
) -> Array:
    """Return positions after a step of the command, minus those of an ideal vehicle, shape (T, n, n), m per m/s."""
    s, n = model.B.shape
    count = int(np.clip(span / period, 20, 400))
    stride = max(1, round(span / period / count))
    step = power(model, stride)
    state, found = np.vstack([np.zeros((s + n, n)), np.eye(n)]), []
    for k in range(count):
        state = step @ state
        found.append(state[s : s + n] - (k + 1) * stride * period * np.eye(n))
    return np.array(found)


def difference_of(one: Array, other: Array) -> float:
    """Return the largest difference of two responses, as a fraction of the larger of them."""
    return float(np.abs(one - other).max() / max(np.abs(one).max(), np.abs(other).max()))


def are_alike(
    models: list[LinearVehicle],
    period: float,
    *,
    difference: float = 0.02,  # largest difference, as a fraction of a vehicle's response
) -> bool:
    """Return True if vehicles respond to a command in nearly the same way."""
    first = response_of(models[0], period)
    responses = (response_of(model, period) for model in models[1:])
    return all(r.shape == first.shape and difference_of(r, first) <= difference for r in responses)


def medium_on_path(system: System, path: TargetPath) -> Array:
    """Return the mean velocity of the medium along the targets' path, see `mean_medium`; NaN if it is not known.

    Under gusts the path is not known, and targets are assumed to stay at their initial positions.
    """
    gusts = not np.isfinite(system.moving_bounds.speed).all()
    known = (path.cells is not None or gusts) and targets_loop(system).stable
    return mean_medium(system, path.time, path.q_star) if known else np.full((len(system.team.agents), 3), np.nan)


def mean_medium(
    system: System,
    time: Array,
    q_star: Array,
    *,
    most_samples: int = 200,  # of the path, for the mean flow
) -> Array:
    """Return the mean velocity of the medium relative to each agent's q* along its path, shape (N, 3), m/s.

    Disturbances are left out. The path is the stacked harmonic extension (T, n_q), m, at times (T,), s.
    """
    some = slice(None, None, max(1, len(q_star) // most_samples))
    w = agent_flow(system, q_star[some]) + agent_motion(system, time[some], q_star[some], WITHOUT_MEAN)
    mean = np.trapezoid(w, time[some], axis=0) / float(time[some][-1] - time[0])
    return system.team.unpack(mean - (q_star[-1] - q_star[0]) / float(time[-1] - time[0]))


# -- the loop ----------------------------------------------------------------------------------------------------------


LARGEST_WHOLE = 400
"""Largest number of coupled states for which the matrix of a team of different vehicles is solved."""

NEUTRAL_RATE = 1e-5
"""Rate below which a direction is neutral up to rounding, 1/s."""

_SHOWN = 0.2  # fraction of a displacement that a mode must have for its damping to count

Obstacle = Literal["", "overpowered", "no model"]
"""What keeps a vehicle from having a loop: see `BodyLoop`."""


class Swing(Record):
    """A mode of the real vehicles' loop; s is the logarithm of its factor over a period."""

    damping: float = Field(description="damping ratio -Re s / |s|; negative if the mode grows")
    frequency: float = Field(description="natural frequency |s|, rad/s")
    agent: str | None = Field(description="agent that moves most in it; null if that is not known")


class BodyLoop(Record):
    """The loop of the real vehicles, for small motions: inertia, attitude, thruster lag, hold, in the mean flow."""

    stable: bool | None = Field(description="whether every mode decays, except for free motions; null: see reason")
    spectral_radius: float | None = Field(
        description="largest factor by which a mode that moves a position grows from one evaluation of the law to the "
        "next; below 1 it is stable; null if undecided"
    )
    period: float = Field(description="time between evaluations of the law, s: a physics step if the law is continuous")
    largest_gain: float | None = Field(description="gain above which a mode grows, 1/s; null: undecided, or none found")
    least_damped: Swing | None = Field(description="mode with the smallest damping ratio; null if undecided")
    reason: str = Field(description="why it is undecided, or empty")
    obstacle: Obstacle = Field(
        "",
        description="undecided because an agent cannot hold its place in the mean flow (`overpowered`) or has no "
        "linear model (`no model`); else empty",
    )
    stable_over_exact_links: bool | None = Field(
        None, description="`stable` without delays and losses; null if that makes no difference, or is undecided"
    )

    def verdict(self) -> str:
        """Describe an unstable loop in a few words."""
        mode = self.least_damped
        who = "" if mode is None or mode.agent is None else f" (about {mode.agent})"
        limit = "" if self.largest_gain is None else f": stable below a gain of {self.largest_gain:.3g} 1/s"
        return f"the vehicles' loop is unstable{who}{limit}"


def held_modes(system: System, spectrum: Spectrum) -> tuple[Array, Array]:
    """Return the eigenvalues of H other than zero, ascending, and their vectors, shape (n, m)."""
    values, vectors = system.team.dirichlet.eigenvectors
    return np.maximum(values[spectrum.nullity :], spectrum.smallest[0]), vectors[:, spectrum.nullity :]


_OF_LOOP = ("stable", "spectral_radius", "largest_gain", "least_damped")  # null if the loop is undecided
_OBSTACLES: dict[type[Exception], Obstacle] = {OverpoweredError: "overpowered", NoModelError: "no model"}


class Modes(NamedTuple):
    """Modes of the closed loop.

    Attributes:
        factor: Growth over a period, complex, shape (k,).
        agent: Number of the agent that moves most, -1 if unknown, shape (k,).
        moves: True for modes that move positions, shape (k,).
        shown: Size of the motion in the mode after a displacement of 1 m, shape (k,), m.
        sure: True for modes of an eigenvalue that H is known to have, shape (k,).
    """

    factor: NDArray[np.complex128]
    agent: IntArray
    moves: BoolArray
    shown: Array
    sure: BoolArray

    @property
    def radius(self) -> float:
        """Largest growth over a period."""
        return float(np.hypot(self.factor.real, self.factor.imag).max())

    def least_damped(self) -> tuple[int, float, float]:
        """Return the number of the mode with the smallest damping ratio, that ratio, and |s| over a period.

        If no mode grows, only modes with a sufficient part of a displacement count. The rolling of a hull is lightly
        damped but hardly moves its position, and messages in transit make modes of a few periods. Neither is visible in
        the positions of a run.
        """
        s = np.log(np.where(self.factor != 0.0, self.factor, 1e-300))
        size = np.maximum(np.abs(s), 1e-300)
        damping = -s.real / size
        if damping.min() >= 0.0 and (self.shown > _SHOWN).any():
            damping = np.where(self.shown > _SHOWN, damping, np.inf)
        k = int(damping.argmin())
        return k, float(damping[k]), float(size[k])


class Block(NamedTuple):
    """Decoupled part of a team's loop: equal vehicles at L eigenvalues of H, or different vehicles together.

    Attributes:
        plant: The vehicles, over a period.
        law: The law that closes the loop at a gain, 1/s; it has a matrix for each of the L eigenvalues, or one.
        agent: Number of the agent that moves most at each eigenvalue, -1 for a sampled value, shape (L,).
        places: Map from positions of the plant to coordinates of all agents, shape (n, k), for different vehicles.
        owner: Agent of each of these coordinates, shape (n,).
        sets: Sets of coupled states, for different vehicles. The matrix is block triangular over them, so its
            eigenvalues are those of the diagonal blocks.
    """

    plant: LinearVehicle
    law: Callable[[float], LinearController]
    agent: IntArray
    places: Array
    owner: IntArray
    sets: Sequence[IntArray | slice] = (slice(None),)

    def matrices(self, gain: float) -> Iterator[tuple[IntArray, Array]]:
        """Yield the numbers of coupled states and their matrices, shape (..., k, k), at a gain, 1/s."""
        M = closed(self.plant, self.law(gain))
        for chosen in self.sets:
            yield np.arange(M.shape[-1])[chosen], M[..., chosen, :][..., chosen]

    def modes(
        self,
        gain: float,
        *,
        least: float = 1e-6,  # m for 1 rad or 1 m/s of a mode: a smaller motion of positions is not counted
    ) -> Iterator[Modes]:
        """Yield all modes, or those at the sampled eigenvalues."""
        for chosen, M in self.matrices(gain):
            factors, vectors = np.linalg.eig(M)
            held = chosen[chosen < len(self.plant.C)]
            z = vectors[..., : len(held), :]
            moves = np.linalg.norm(z, axis=-2) > least * np.linalg.norm(vectors, axis=-2)
            rows = np.linalg.pinv(vectors)[..., : len(held)]
            shown = np.linalg.norm(z, axis=-2) * np.linalg.norm(rows, axis=-1)
            agent = self.agent[:, None]
            if len(self.owner):
                agent = np.where(moves, self.owner[np.abs(self.places[:, held] @ z).argmax(axis=-2)], -1)
            agent = np.broadcast_to(agent, factors.shape)
            sure = (agent >= 0) | bool(len(self.owner))
            yield Modes(
                factors.ravel().astype(np.complex128), agent.ravel(), moves.ravel(), shown.ravel(), sure.ravel()
            )

    def growth(self, gain: float) -> float:
        """Return the logarithm of the growth factor over a period of the fastest growing mode at a gain, 1/s."""
        return float(np.log(max(np.abs(np.linalg.eigvals(M)).max() for _, M in self.matrices(gain))))


class TeamLoop(NamedTuple):
    """The closed loop of a team.

    Attributes:
        blocks: Decoupled parts.
        period: Time between evaluations of the law, s.
    """

    blocks: list[Block]
    period: float

    @property
    def neutral(self) -> float:
        """Logarithm of the growth factor over a period up to which a mode counts as neutral."""
        return NEUTRAL_RATE * self.period

    def modes(self, gain: float) -> Modes:
        """Return the modes at a gain, 1/s, that move a position, or grow by more than `neutral`."""
        found = [modes for block in self.blocks for modes in block.modes(gain)]
        every = Modes(*(np.concatenate(x) for x in zip(*found, strict=True)))
        counts = every.moves | (np.hypot(every.factor.real, every.factor.imag) > np.exp(self.neutral))
        return Modes(*(x[counts] for x in every))

    def is_stable(self, modes: Modes) -> bool | None:
        """Return True if modes decay; None if the only growing modes belong to eigenvalues that H may not have."""
        grows = ~(np.hypot(modes.factor.real, modes.factor.imag) < np.exp(self.neutral))
        if not grows.any():
            return True
        return False if modes.sure[grows].any() else None

    def largest_gain(
        self,
        gain: float,
        least_damping: float | None = None,
        *,
        accuracy: float = 1e-3,  # relative, of the largest gain
        doublings: int = 40,
    ) -> float | None:
        """Find the gain, 1/s, at which a mode begins to grow: the next above a stable gain, or below an unstable one.

        With `least_damping`, it is the gain above which a mode has a smaller damping ratio. None if none is found.
        """

        def growth(k: float) -> float:
            return max(block.growth(k) for block in self.blocks)

        def rings(k: float) -> bool:
            return growth(k) > self.neutral or (
                least_damping is not None and self.modes(k).least_damped()[1] < least_damping
            )

        low = high = gain
        up = not rings(gain)
        for _ in range(doublings):
            low, high = (high, 2.0 * high) if up else (0.5 * low, low)
            if rings(high if up else low) == up:
                break
        else:
            return None
        # A mode that H pushes away grows at any gain, in proportion to it or to its square, until its growth counts as
        # none: halving the gain ends there.
        if not up and self.neutral < growth(high) <= 4.0 * self.neutral:
            return None
        while high > (1.0 + accuracy) * low:
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if rings(middle) else (middle, high)
        return float(np.sqrt(low * high))


@one_thread
def body_loop(
    system: System, spectrum: Spectrum, medium: Array, *, gain: bool = True, least_damping: float | None = None
) -> BodyLoop:
    """Analyse the loop of the team's vehicles.

    Args:
        system: The system.
        spectrum: Spectrum of H.
        medium: Velocity of the medium relative to each agent's place, shape (N, 3), m/s; see `mean_medium`.
        gain: True to find the largest gain.
        least_damping: Damping ratio that every mode keeps up to the largest gain; see `TeamLoop.largest_gain`.
    """
    period = system.grid.period
    lost = UNKNOWN_ROUNDS if system.law.terms.rounds.imperfect else ""
    if (
        common_delay(system) is None
        or system.law.links.table["lossy"].any()
        or np.isfinite(system.law.links.table["range"]).any()
    ):
        lost = "measurements are delayed or lost"  # the loop would need states for messages in transit
    try:
        period = period_of_law(system)
        require_model(system)
        if not system.team.symmetric and system.law.extended:
            raise UndecidedError("H is not symmetric, and the law has terms")
        if system.team.stressed and system.law.terms.newton + system.law.terms.feedforward > 0:
            raise UndecidedError(ROUNDS_OF_FITTING_EDGES)
        if not spectrum.smallest.size:
            raise UndecidedError("nothing is held")
        models = linear_vehicles(system, range(len(medium)), medium)
        loop = exact = _close(system, spectrum, models, period)
        age = 0 if lost else (common_delay(system) or 0) * whole_ratio(system.grid.period, period)
        if age:
            late = {id(model): delayed(model, age) for model in models}
            try:
                loop = _close(system, spectrum, [late[id(model)] for model in models], period)
                if sum(len(b.agent) * len(b.plant.A) ** 3 for b in loop.blocks) > LARGEST_WHOLE**3:
                    raise UndecidedError("measurements are delayed by too many periods")
            except UndecidedError as error:
                lost = str(error)
        modes = loop.modes(system.gain)
    except (UndecidedError, InputError, np.linalg.LinAlgError) as error:
        unsolved = isinstance(error, np.linalg.LinAlgError)  # a matrix that is not finite
        reason = lost or (f"the loop cannot be solved: {error}" if unsolved else str(error))
        return BodyLoop(
            **dict.fromkeys(_OF_LOOP), period=period, reason=reason, obstacle=_OBSTACLES.get(type(error), "")
        )
    stable = loop.is_stable(modes)
    if lost:
        return BodyLoop(**dict.fromkeys(_OF_LOOP), period=period, reason=lost, stable_over_exact_links=stable)
    number, damping, size = modes.least_damped()
    agent = system.team.agent_ids[modes.agent[number]] if modes.agent[number] >= 0 else None
    perhaps = "only eigenvalues between the smallest and the largest would be unstable, if H has them"
    return BodyLoop(
        stable=stable,
        spectral_radius=modes.radius,
        period=period,
        largest_gain=loop.largest_gain(system.gain, least_damping) if gain else None,
        least_damped=Swing(damping=damping, frequency=size / period, agent=agent),
        reason=perhaps if stable is None else "",
        stable_over_exact_links=exact.is_stable(exact.modes(system.gain)) if age else None,
    )


def loop_in_run(system: System, data: xr.Dataset, *, gain: bool = True, least_damping: float | None = None) -> BodyLoop:
    """Analyse the loop in the mean flow along q* in the data of a run under a system; see `body_loop`."""
    time = data["time"].values
    path = np.nan_to_num(data["harmonic_extension"].values).reshape(len(time), -1)
    return body_loop(
        system,
        spectrum_of(system.team),
        mean_medium(system, time, path[:, system.team.slots[: system.team.first_state[-1]]]),
        gain=gain,
        least_damping=least_damping,
    )


def ending_of_run(
    run: System | Sequence[Phase], dataset: xr.Dataset, stuck: Sequence[Stuck] | None = None
) -> Ending | None:
    """Judge the end of a run, as `ending_of_motion`; a team whose loop is unstable has not settled.

    The motion of a driven team alone does not distinguish forced oscillations from those of an unstable loop.
    """
    ending = ending_of_motion(run, dataset, stuck)
    if ending != "settled" or "controller" in dataset.attrs:
        return ending
    system, last = of_phase(run, dataset, -1)
    try:
        system = system.local
        if dataset.attrs["backend"] == "ideal":
            unstable = loop_of(system).radius > 1.0
        else:
            loop = loop_in_run(system, last, gain=False)
            unstable = loop.stable is False or (loop.stable is None and loop.stable_over_exact_links is False)
    except (UndecidedError, InputError):
        return ending
    return "not settled" if unstable else ending


def loop_on_path(system: System, certificate: Certificate) -> BodyLoop:
    """Analyse the loop in the mean flow along the targets' path; see `body_loop`."""
    return body_loop(system, certificate.spectrum, medium_on_path(system, certificate.constants.path))


def _close(system: System, spectrum: Spectrum, models: list[LinearVehicle], period: float) -> TeamLoop:
    """Return the loop of the team, decoupled by modes of H if that is exact.

    Raises:
        UndecidedError: It is too large.
    """
    kinds = list({id(model): model for model in models}.values())
    if len(kinds) > 1:
        try:
            return TeamLoop([whole_loop(system, spectrum, models)], period)
        except UndecidedError:
            if not are_alike(kinds, period):
                raise
    plain = system.team.symmetric and not system.team.stressed
    parts = _parts(system, spectrum, kinds[0], period) if plain else []
    return TeamLoop(parts or [whole_loop(system, spectrum, models)], period)


def _parts(
    system: System,
    spectrum: Spectrum,
    model: LinearVehicle,
    period: float,
    *,
    negligible: float = 1e-3,  # neglected fraction of a response, across axes or between them
) -> list[Block]:
    """Return the blocks of a team of equal vehicles; none if they do not decouple.

    Axes that neither the vehicle nor H couples are separate parts. In a part, either H is the same along all axes and
    does not couple them, or the vehicle's response is.
    """
    H = sparse.csr_array(system.team.dirichlet.H)
    law = model_of(system.law, system.grid.period)
    n = model.D.shape[0]
    response = response_of(model, period)
    by_vehicle = np.abs(response).max(axis=0) > negligible * np.abs(response).max()
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
            difference_of(response[:, a, a], response[:, first, first]) <= negligible for a in axes
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
            parts.append(Block(plant, _closer(law, values, len(axes)), agent, np.zeros((0, 0)), agent[:0]))
    return parts


def _closer(law: LawModel, values: Array, axes: int) -> Callable[[float], LinearController]:
    """Return the law of equal vehicles at eigenvalues of H, by gain; see `Block`."""
    return lambda gain: law.feedback(gain, values).alike(axes)


def _couples(coupling: BoolArray, axes: IntArray) -> bool:
    """Return True if some of the axes are coupled to others of them."""
    return bool(coupling[np.ix_(axes, axes)][~np.eye(len(axes), dtype=bool)].any())


def _eigenvalues(H: sparse.csr_array, agents: IntArray, least: float) -> tuple[Array, IntArray]:
    """Return eigenvalues above zero, ascending, and agents as in `Block`, for a part of H whose rows are of `agents`.

    For a large part, the values sample the interval that contains the eigenvalues, and only the largest is exact.
    `least` is the smallest eigenvalue above zero of the whole H.
    """
    if H.shape[0] <= DENSE_STATES:
        values, vectors = np.linalg.eigh(H.toarray())
        held = values > 0.5 * least
        return values[held], agents[np.abs(vectors[:, held]).argmax(axis=0)]
    top, vector = eigsh(H, k=1, which="LA", v0=np.ones(H.shape[0]))
    values = np.geomspace(least, max(float(top[0]), least), 200)
    return values, np.append(np.full(len(values) - 1, -1), agents[np.abs(vector[:, 0]).argmax()])


def whole_loop(system: System, spectrum: Spectrum, models: list[LinearVehicle]) -> Block:
    """Return the loop of a whole team of different vehicles, on the orthogonal complement of the null space of H.

    Raises:
        UndecidedError: It is too large.
    """
    team = system.team
    owner = np.repeat(np.arange(len(team.agents)), [a.dimension for a in team.agents])
    problem = team.law_problem
    _require_size(owner, models)
    H = problem.H.toarray() if team.symmetric else matrix_of(team)
    Q = np.eye(len(H)) if problem.unique else linalg.null_space(problem.null_basis.T)
    if not system.law.extended:
        return joined(models, lambda gain: without_memory(-gain * H), Q, owner)
    values, vectors = held_modes(system, spectrum)
    model = model_of(system.law, system.grid.period)
    return joined(models, lambda gain: model.feedback(gain, values).of_team(vectors), Q, owner)


def _require_size(owner: IntArray, models: Sequence[LinearVehicle]) -> None:
    """Refuse a loop that is too large to be put together; see `joined`.

    Raises:
        UndecidedError: It has more than ten times LARGEST_WHOLE states.
    """
    states = len(owner) + sum(len(model.A) for model in models)
    if states > 10 * LARGEST_WHOLE:
        raise UndecidedError(f"too many unlike vehicles: {states} states")


def joined(
    models: Sequence[LinearVehicle], law: Callable[[float], LinearController], Q: Array, owner: IntArray
) -> Block:
    """Return the loop of different vehicles together.

    Args:
        models: Linear vehicle of each.
        law: Law at a gain, from their positions to their commands.
        Q: Basis of the positions, shape (n, k).
        owner: Vehicle of each of n coordinates, shape (n,).

    Raises:
        UndecidedError: More than LARGEST_WHOLE states are coupled.
    """
    A, B, C, D = (linalg.block_diag(*matrices) for matrices in zip(*models, strict=True))
    plant = LinearVehicle(A, B, Q.T @ C, Q.T @ D)

    def in_basis(gain: float) -> LinearController:
        found = law(gain)
        return found._replace(B=found.B @ Q, D=found.D @ Q)

    count, which = connected_components(
        sparse.csr_array(closed(plant, in_basis(1.0)) != 0.0), directed=True, connection="strong"
    )
    sets = [np.flatnonzero(which == k) for k in range(count)]
    largest = max(map(len, sets))
    if largest > LARGEST_WHOLE:
        raise UndecidedError(f"too many unlike vehicles: {largest} states act on one another")
    return Block(plant, in_basis, np.zeros(1, dtype=np.int64), Q, owner, sets)


# -- the targets' own law ----------------------------------------------------------------------------------------------
#
# Each target's vehicle is linearised about the equilibrium in which it holds station in the mean flow along its path,
# and all are closed through u = -S p: see `stiffness` for S.


@one_thread
def with_bodies(loop: TargetsLoop, system: System, path: TargetPath) -> TargetsLoop:
    """Return the loop with the result for the targets' vehicles, in the mean flow along their path."""
    if not (loop.rate > 0.0 and system.team.targets):
        return loop
    S = stiffness(system).toarray()
    owner = np.repeat(np.arange(len(system.team.targets)), [target.dimension for target in system.team.targets])
    try:
        # The mean velocity of the medium relative to each target's path, shape (M, 3), m/s. If the path is unknown or
        # diverges, it is that at the target's initial position.
        N = len(system.team.agents)
        bounded = path.cells is not None and loop.stable
        positions = path.positions[:, N:] if bounded else system.initial[None, N:]
        medium = -(positions[-1] - positions[0]) / float(path.time[-1] - path.time[0])
        for k in range(len(medium)):
            medium[k] += np.mean(system.flows[int(system.field[N + k])].velocity(positions[:, k]), axis=0)
        models = linear_vehicles(system, range(N, len(system.team.members)), medium)
        _require_size(owner, models)
        team_loop = TeamLoop(
            [joined(models, lambda gain: without_memory(-gain * S), np.eye(len(S)), owner)], period_of_law(system)
        )
        modes = team_loop.modes(1.0)
        bodies = TargetsOnBodies(stable=team_loop.is_stable(modes), spectral_radius=modes.radius, reason="")
    except (UndecidedError, InputError, np.linalg.LinAlgError) as error:
        bodies = TargetsOnBodies(stable=None, spectral_radius=None, reason=str(error))
    return loop.model_copy(update={"bodies": bodies})
