"""RMS error that gusts and waves leave: their spectra through the law's loop, on ideal kinematics and on bodies.

The loop from one sample to the next, on errors e = q - q* and all else that it remembers, is X+ = M X + N w, with w
the mean velocity of the medium over a period. Its response at a frequency is E = (z I - M)^-1 N, z = e^(i omega h),
and the variance of e is the integral of |E|^2 over the spectrum of w. Gusts are held over a period, so that their
spectrum is that of their discrete filter; a wave's mean over a period is sin(omega h / 2) / (omega h / 2) of it.
Waves and frozen gusts meet all vehicles with a phase, each at q* as it is at the start; gusts of each vehicle's own
are independent. Vehicles in the plane meet the waves' velocity at the surface, those below it that at their depth. A
target that the medium moves takes q* along. Where the law is continuous, the loop is (i omega + k1 H)^-1 for waves.

A target of time constant tau follows the medium by 1 / (1 + i omega tau), less what its pull takes back. With
r = e^(-h / tau) and l = tau (1 - r), a command that is held over h moves it by

    G = ((h - l) + l (1 - r) / (z - r)) / (z - 1),    so that it follows by 1 / ((1 + i omega tau) (1 + pull G)).

On bodies the loop is that of the linear vehicles. In axes that move with the medium a vehicle does not know that it
moves; so with E_v the rows of its velocity, x+ = A x + B u + (E_v - A E_v) w and p+ = p + C x + D u + (h - C E_v) w.
A hull rights itself to the surface, so the same holds of a slope s with the attitude E_s upright on it:
x+ = A x + (E_s - A E_s) s and p+ = p + C x - C E_s s. Heave is left out. A boat that holds no heading turns along the
waves, within minutes, by an effect of second order that the linear vehicle does not have: it is taken as turned.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import linalg

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.checking.loop.body_loop import whole_loop
from mjsheaf.checking.loop.held_law import ROUNDS_OF_FITTING_EDGES
from mjsheaf.checking.loop.linear_law import require_model
from mjsheaf.checking.loop.linear_team import ideal_team, linear_vehicles, period_of_law
from mjsheaf.checking.spectrum import Spectrum
from mjsheaf.checking.theorem.targets import Carrier, follow_targets
from mjsheaf.errors import InputError, UndecidedError, select_true
from mjsheaf.loop.linear import LinearVehicle
from mjsheaf.loop.system import System
from mjsheaf.media.gusts import Filter, FrozenArrays, GustArrays
from mjsheaf.media.medium import of_kind
from mjsheaf.media.waves import Components
from mjsheaf.section import PER_AGENT_RMS, Finite, Norm, Record
from mjsheaf.vehicles.effects import capability_of

Complex = NDArray[np.complex128]

_MOST_STATES = 300
"""Largest loop that is solved at every frequency."""


class DisturbanceRecord(Record):
    """RMS errors |q - q*| that gusts and waves leave once the loop has settled; what is steady is not in them."""

    rms: Finite = Field(description="RMS over agents, on ideal kinematics, m; null: see reason")
    agents: dict[str, Finite] = Field(description="RMS of each agent on ideal kinematics, m")
    bodies: dict[str, Finite] = Field(description="RMS of each agent on its vehicle, m; empty: see bodies_reason")
    norm: Norm = Field(PER_AGENT_RMS, description="which norm `rms` is")
    carried_off: dict[str, float] = Field(
        {},
        description="agents that cannot hold station at times: by how much the medium's speed, its mean and twice its "
        "RMS, exceeds the vehicle's steady speed in its slowest direction, m/s",
    )
    clipped: dict[str, float] = Field(
        {},
        description="vehicles that begin below or above the altitudes for which the model of the gusts holds: altitude "
        "of the gusts that they meet, m",
    )
    leaves_out: list[str] = Field([], description="what acts in the run and is not in the prediction")
    reason: str = Field("", description="why it is not known, or empty")
    bodies_reason: str = Field("", description="why it is not known on bodies, or empty")

    @property
    def rms_on_bodies(self) -> float | None:
        """RMS over agents on their vehicles, m; None if it is not known."""
        known = [rms for rms in self.bodies.values() if rms is not None]
        return float(np.sqrt(np.mean(np.square(known)))) if known else None


class _Loop(NamedTuple):
    """A loop and how the medium enters it.

    Attributes:
        M: Map of the states from one sample to the next, shape (S, S).
        inputs: Inputs of the mean velocities of the agents and of q*, and of the slopes of the surface about the agents
            along x and y, side by side, shape (S, 3 n_q), s, s and 1.
        shown: Rows that give the error, shape (n_q, S).
        period: Time between samples, s.
        continuous: Eigenvalues k1 lambda of a continuous law and their vectors; None where it is held.
    """

    M: Array
    inputs: Array
    shown: Array
    period: float
    continuous: tuple[Array, Array] | None = None

    def response(self, rate: float, *, of_wave: bool) -> Complex:
        """Return E of the inputs at a frequency, rad/s, shape (n_q, 3 n_q), s and m.

        That is by means over a period, or by the velocity of a wave at the middle of a period.
        """
        if of_wave and self.continuous is not None:
            values, vectors = self.continuous
            answer = (vectors / (1j * rate + values)) @ vectors.T
            return np.hstack([answer, -answer, 0.0 * answer])
        angle = rate * self.period
        held = np.sinc(angle / (2.0 * np.pi)) if of_wave else 1.0
        solved = np.linalg.solve(np.exp(1j * angle) * np.eye(len(self.M)) - self.M, self.inputs)
        return np.asarray(held * (self.shown @ solved), dtype=np.complex128)


class _Line(NamedTuple):
    """A frequency of a spectrum.

    Attributes:
        rate: rad/s.
        weight: Weight of the squares of the errors.
        velocity: Velocities of the medium about all vehicles by each of S random amplitudes, shape (S, V, 3), m/s.
        slope: Slopes of the surface about them, of a wave; None of a gust, which is held over a period.
    """

    rate: float
    weight: float
    velocity: Complex
    slope: Complex | None = None


def predict_rms(
    system: System,
    spectrum: Spectrum,
    medium: Array,
    *,
    steep: float = 1.0 / 60.0,
) -> DisturbanceRecord:
    """Predict the errors that gusts and waves leave.

    Args:
        system: The system.
        spectrum: Spectrum of H.
        medium: Mean velocity of the medium that the agents' vehicles meet, shape (N, 3), m/s.
        steep: Significant height over the peak's wave length, beyond which drift in groups adds some percent.
    """
    ids = system.team.agent_ids
    if not any(flow.gusts is not None or flow.waves is not None for flow in system.flows):
        return DisturbanceRecord(rms=0.0, agents=dict.fromkeys(ids, 0.0), bodies=dict.fromkeys(ids, 0.0))
    bodies, bodies_reason = dict[str, float](), ""
    known = {"carried_off": _carried_off(system, medium), "clipped": _clipped(system)}
    try:
        _require_known(system)
        _require_one_side(system)
        ideal = _rms(system, _ideal_loop(system, spectrum), np.zeros(len(system.team.targets)))
    except (UndecidedError, InputError, np.linalg.LinAlgError) as error:
        reasons = dict.fromkeys(("reason", "bodies_reason"), str(error))
        return DisturbanceRecord(rms=None, agents=dict.fromkeys(ids), bodies={}, **known, **reasons)
    try:
        tau = np.array([v.reduced_model().tau.max() for v in system.vehicles[len(ids) :]])
        bodies = dict(zip(ids, _rms(system, _body_loop(system, spectrum, medium), tau).tolist(), strict=True))
    except (UndecidedError, InputError, np.linalg.LinAlgError) as error:
        bodies_reason = str(error)
    rms = float(np.sqrt(np.mean(ideal**2)))
    agents = dict(zip(ids, ideal.tolist(), strict=True))
    left_out = {
        "slow drift in groups of steep waves": any(
            flow.waves is not None and flow.waves.steepness > steep for flow in system.flows
        ),
        "the safety filter": system.safety is not None,
        "gusts on hulls": bool(system.wind) and system.flow_named("wind").gusts is not None,
    }
    return DisturbanceRecord(
        rms=rms, agents=agents, bodies=bodies, **known, leaves_out=select_true(left_out), bodies_reason=bodies_reason
    )


def _clipped(system: System) -> dict[str, float]:
    """Return the altitude of the gusts of each vehicle that begins outside the range of their model, m."""
    found = {}
    for id, field, place in zip(system.team.index, system.field, system.initial, strict=True):
        gusts, height = system.flows[field].gusts, float(place[2]) - system.bodies.surface_height
        if gusts is not None and isinstance(gusts.altitude, str) and gusts.altitude_of(height) != height:
            found[id] = gusts.altitude_of(height)
    return found


def _carried_off(system: System, medium: Array) -> dict[str, float]:
    """Return by how much the medium is too fast at times for each agent for which it is, m/s."""
    variance = np.zeros(len(system.field))
    for number, flow in enumerate(system.flows):
        if flow.waves is not None:
            along, up = _speeds(system, flow.waves.sampled(system.seed), number, system.initial[:, 2])
            variance += 0.5 * np.sum(along**2 + up**2, axis=0)
    for gusts in of_kind(system.moving, GustArrays):
        met = gusts.met > 0
        variance[met] += 2.0 * np.square(gusts.filter.output[:, 0, 0])
    for frozen in of_kind(system.moving, FrozenArrays):
        variance += 2.0 * frozen.filter.output[0, 0, 0] ** 2 * (frozen.met > 0)
    found = {}
    for i, id in enumerate(system.team.agent_ids):
        able = min(capability_of(system.vehicles[i]).least_speed, float(system.law.limit[i]))
        excess = float(np.linalg.norm(medium[i])) + 2.0 * float(np.sqrt(variance[i])) - able
        if excess > 0.0:
            found[id] = excess
    return found


def _require_known(system: System) -> None:
    """Raise an UndecidedError unless the law's loop is all that answers to the medium."""
    require_model(system)
    terms = system.law.terms
    links = system.law.links.table
    late = links["delay"].any() or links["lossy"].any() or np.isfinite(links["range"]).any()
    if terms.drift or terms.feedforward:
        raise UndecidedError("the law observes the medium's velocity or follows the targets'")
    if not system.team.symmetric:
        raise UndecidedError("H is not symmetric")
    if late or terms.rounds.imperfect:
        raise UndecidedError("measurements are delayed or lost")
    if system.team.stressed and terms.newton:
        raise UndecidedError(ROUNDS_OF_FITTING_EDGES)
    if not system.team.dirichlet.unique:
        raise UndecidedError("the harmonic extension is not unique")
    if len(system.team.target_edges):
        raise UndecidedError("targets follow one another")
    if system.effectiveness.given.any():
        raise UndecidedError("g is the scenario's own")


def _require_one_side(system: System) -> None:
    """Refuse waves if a vehicle in space passes through their surface, where the velocity that it meets jumps.

    Raises:
        UndecidedError: A target or an agent's q* does, or it is not known whether one does.
    """
    waves = any(flow.waves is not None for flow in system.flows)
    if not waves or system.planar.all():
        return
    N = len(system.team.agents)
    path = follow_targets(system)
    if path.cells is None and np.isfinite(system.moving_bounds.speed[N:]).all():
        raise UndecidedError(f"the targets' path in the waves is not known: {path.warning}")
    height = path.positions[..., 2].copy()
    height[:, :N] = system.team.unpack(path.q_star)[..., 2]
    sides = _below(system, height)
    for v in np.flatnonzero(sides.any(axis=0) & ~sides.all(axis=0)):
        raise UndecidedError(f"{list(system.team.index)[v]} passes through the surface of the waves")


def _ideal_loop(system: System, spectrum: Spectrum) -> _Loop:
    """Return the loop of ideal agents."""
    h, n_q = system.grid.period, int(system.team.first_state[-1])
    if n_q > _MOST_STATES:
        raise UndecidedError(f"the team has {n_q} states; up to {_MOST_STATES} are solved")
    if not system.grid.continuous:
        return _closed(system, spectrum, ideal_team(system), h)
    if system.law.extended:
        raise UndecidedError("the law is continuous and has terms")
    values, vectors = np.linalg.eigh(system.team.dirichlet.H.toarray())
    rates = system.gain * values
    into = (vectors * (-np.expm1(-rates * h) / rates)) @ vectors.T
    M = (vectors * np.exp(-rates * h)) @ vectors.T
    return _Loop(M, np.hstack([into, -into, 0.0 * into]), np.eye(n_q), h, (rates, vectors))


def _body_loop(system: System, spectrum: Spectrum, medium: Array) -> _Loop:
    """Return the loop of the agents' vehicles, those that hold no heading turned along the waves, the shorter way."""
    if system.grid.continuous and of_kind(system.moving, GustArrays) + of_kind(system.moving, FrozenArrays):
        raise UndecidedError("the law is continuous, and gusts are held")
    heading = system.bodies.heading.copy()
    for v in np.flatnonzero(system.planar):
        waves = system.flows[system.field[v]].waves
        if waves is not None and not system.vehicles[v].steering.attitude:
            along = np.radians(waves.direction)
            heading[v] = along + np.pi * np.round((heading[v] - along) / np.pi)
    turned = replace(system, bodies=replace(system.bodies, heading=heading))
    return _closed(turned, spectrum, linear_vehicles(turned, range(len(medium)), medium), period_of_law(system))


def _closed(system: System, spectrum: Spectrum, agents: list[LinearVehicle], h: float) -> _Loop:
    """Close the law's loop around linear vehicles."""
    M, Q = whole_loop(system, spectrum, agents)
    if len(M) > 2 * _MOST_STATES:
        raise UndecidedError(f"the loop has {len(M)} states; up to {2 * _MOST_STATES} are solved")
    velocities = []
    tilts = []
    for one in agents:
        s, n = one.B.shape
        velocity, tilt = np.zeros((2, s, n))
        if s:
            first = 3 + (3 - n)  # after the attitude and, of a floating vehicle, the height
            velocity[first : first + n] = np.eye(n)
            tilt[:2, :2] = [[0.0, 1.0], [-1.0, 0.0]] if n == 2 else 0.0  # upright on a slope
        velocities.append(velocity)
        tilts.append(tilt)
    A, C, E_v, E_s = (linalg.block_diag(*x) for x in ([a.A for a in agents], [a.C for a in agents], velocities, tilts))
    n_q, m = Q.shape
    begin, end = m, m + len(A)
    inputs = np.zeros((len(M), 3 * n_q))
    inputs[:m] = Q.T @ np.hstack([h * np.eye(n_q) - C @ E_v, -h * np.eye(n_q), -C @ E_s])
    inputs[begin:end] = np.hstack([E_v - A @ E_v, 0.0 * E_v, E_s - A @ E_s])
    shown = np.zeros((n_q, len(M)))
    shown[:, :m] = Q
    return _Loop(M, inputs, shown, h)


def _rms(
    system: System,
    loop: _Loop,
    tau: Array,
    *,
    neutral: float = 1.0 + 1e-6,  # of a heading that nothing holds, rounded
) -> Array:
    """Return the RMS of each agent, shape (N,), m; `tau` is how slowly each target follows the medium, (M,), s."""
    if np.abs(np.linalg.eigvals(loop.M)).max() >= neutral:
        raise UndecidedError("the loop is not stable")
    carrier = Carrier(system)
    team, N, n_q = system.team, len(system.team.agents), len(loop.shown)
    variance = np.zeros(n_q)
    for rate, weight, velocity, slope in _lines(system, loop.period):
        places = carrier.carry(velocity[:, N:] * _answer_of_targets(system, loop, tau, rate)[:, None])
        tilted = np.zeros_like(velocity) if slope is None else slope
        about, tilts = (x[:, :N].reshape(len(x), -1)[:, team.slots[:n_q]] for x in (velocity, tilted))
        errors = np.hstack([about, places, tilts]) @ loop.response(rate, of_wave=slope is not None).T
        variance += weight * (np.abs(errors) ** 2).sum(axis=0)
    return np.sqrt(np.square(team.unpack(np.sqrt(variance))).sum(axis=1))


def _answer_of_targets(system: System, loop: _Loop, tau: Array, rate: float) -> Complex:
    """Return how targets follow the medium at a frequency, rad/s: their pull holds them, and bodies lag, shape (M,)."""
    pull = system.motion.pull[len(system.team.agents) :]
    lag = 1.0 + 1j * rate * tau
    if loop.continuous is not None:
        return np.asarray(1.0 / (lag + pull / (1j * rate)))
    h = loop.period
    z = np.exp(1j * rate * h)
    r = np.exp(-h / np.maximum(tau, np.finfo(float).tiny))
    way = tau * (1.0 - r)
    moved = ((h - way) + way * (1.0 - r) / (z - r)) / (z - 1.0)
    return 1.0 / (lag * (1.0 + pull * moved))


def _lines(system: System, period: float) -> Iterator[_Line]:
    """Yield the frequencies of all that moves in the medium; samples have a period, s."""
    agents = system.team.harmonic_extension(system.initial)
    places = np.concatenate([np.nan_to_num(agents), system.initial[len(agents) :]])
    for number, flow in enumerate(system.flows):
        if flow.waves is not None:
            yield from _of_waves(system, places, flow.waves.sampled(system.seed), number)
    for gusts in of_kind(system.moving, GustArrays):
        yield from _of_gusts(gusts, period)
    for frozen in of_kind(system.moving, FrozenArrays):
        yield from _of_frozen(frozen, places, period)


def _of_waves(system: System, places: Array, waves: Components, number: int) -> Iterator[_Line]:
    """Yield each of the waves of a flow field, by its number; vehicles are at places (V, 3), m."""
    along, up = _speeds(system, waves, number, places[:, 2])
    steep = (waves.number * waves.amplitude)[:, None] * (system.planar & (system.field == number))
    for j, (rate, unit) in enumerate(zip(waves.rate, waves.unit, strict=True)):
        phase = np.exp(-1j * waves.number[j] * (places[:, :2] @ unit))
        velocity = phase[:, None] * np.column_stack([along[j, :, None] * unit, 1j * up[j]])
        slope = np.zeros_like(velocity)
        slope[:, :2] = -1j * (steep[j] * phase)[:, None] * unit
        yield _Line(rate, 0.5, velocity[None], slope[None])


def _below(system: System, height: Array) -> BoolArray:
    """Return which vehicles are in space and below the undisturbed surface at heights (..., V), m."""
    return ~system.planar & (height < system.bodies.surface_height)


def _speeds(system: System, waves: Components, number: int, height: Array) -> tuple[Array, Array]:
    """Return the amplitudes, along the wave and upwards, of the velocities that vehicles meet, shapes (W, V), m/s.

    Args:
        system: The system.
        waves: The waves.
        number: Number of the flow field that has them.
        height: Height of each vehicle, shape (V,), m.
    """
    below = _below(system, height)
    along, up = waves.speeds_at(np.where(below, height - system.bodies.surface_height, 0.0))
    return along * (below | (system.planar & (system.field == number))), up * below


def _angles(
    gusts: Filter,
    *,
    count: int = 240,  # of the spectra of gusts, evenly in the logarithm
    lowest: float = 1e-3,  # of the slowest rate of gusts and loop
) -> Iterator[tuple[float, float]]:
    """Yield angles from 0 to pi and the weight of each: the integral of |E|^2 S over both signs, over 2 pi."""
    slowest = 1.0 - float(gusts.transition.diagonal(axis1=1, axis2=2).max())  # part that decays in a period
    logarithm = np.linspace(np.log(lowest * min(slowest, 1.0)), np.log(np.pi), count)
    weight = np.full(count, logarithm[1] - logarithm[0])
    weight[[0, -1]] *= 0.5
    angles = np.exp(logarithm)
    yield from zip(angles.tolist(), (weight * angles / np.pi).tolist(), strict=True)


def _amplitudes(gusts: Filter, angle: float) -> Array:
    """Return the roots of the spectra of u, v and w at an angle, along their directions, shape (G, 3, 3), m/s."""
    transfer = gusts.output @ np.linalg.solve(np.exp(1j * angle) * np.eye(5) - gusts.transition, gusts.noise)
    frame = np.zeros((len(transfer), 3, 3))
    frame[:, 0, :2] = gusts.direction
    frame[:, 1, :2] = gusts.direction[:, ::-1] * [-1.0, 1.0]
    frame[:, 2, 2] = 1.0
    return np.linalg.norm(transfer, axis=2)[..., None] * frame


def _of_gusts(gusts: GustArrays, period: float) -> Iterator[_Line]:
    """Yield the frequencies of gusts of each vehicle's own."""
    met = np.flatnonzero(gusts.met)
    for angle, weight in _angles(gusts.filter):
        velocity = np.zeros((len(met), 3, len(gusts.met), 3), dtype=np.complex128)
        velocity[np.arange(len(met)), :, met] = _amplitudes(gusts.filter, angle)
        yield _Line(angle / period, weight, velocity.reshape(-1, *velocity.shape[2:]))


def _of_frozen(frozen: FrozenArrays, places: Array, period: float) -> Iterator[_Line]:
    """Yield the frequencies of a frozen field, which meets vehicles at places (V, 3), m."""
    along = places[:, :2] @ frozen.filter.direction[0]
    for angle, weight in _angles(frozen.filter):
        phase = np.exp(-1j * angle / period * along / frozen.track[0]) * (frozen.met > 0)
        yield _Line(angle / period, weight, phase[:, None] * _amplitudes(frozen.filter, angle)[0][:, None])
