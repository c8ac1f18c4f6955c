"""Predicted errors: the tracking error along the targets' path, and the RMS error that gusts and waves leave.

The tracking error is that of the linear loop, driven along the targets' path from the initial positions.

With q and q* measured from q* at the start, s = H q* is the contribution of the targets to eta = H q - s. The law in
the eigenvectors of H (see `linear_law`) has the inputs q, -s as an error of eta, s as the measurement of sensing edges,
and the displacement by the medium over the previous period as the agent's odometry. The inputs of the vehicles are the
commands u and the velocity of the medium at q*, with its disturbance, gusts, waves and tides. So

    z_{k+1} = M z_k + E (s_k, f_k),    z = (q, states of the vehicles, state of the law)

from the initial positions, at rest. Commands are shortened to the speed limits and, on the vehicles, to their speeds
ahead. The prediction leaves out the difference of the flow between q and q*, noise, delays and losses.

Gusts and waves pass through the same loop by their spectra, on ideal kinematics and on bodies.

The loop from one sample to the next, with errors e = q - q* and its other states, is X+ = M X + N w, with w the mean
velocity of the medium over a period. Its response at a frequency is E = (z I - M)^-1 N, z = e^(i omega h), and the
variance of e is the integral of |E|^2 over the spectrum of w. Gusts are held over a period, so their spectrum is that
of their discrete filter. The mean of a wave over a period is sin(omega h / 2) / (omega h / 2) times its value in the
middle of the period. Waves and frozen gusts are the same for all vehicles up to a phase, that of q* at the start;
separate gusts are independent. Vehicles in the plane meet the waves' velocity at the surface, submerged ones that at
their depth. A target that the medium moves moves q* with it. If the law is continuous, the loop is
(i omega + k1 H)^-1 for waves.

A target of time constant tau follows the medium by 1 / (1 + i omega tau), and its pull reduces that. With
r = e^(-h / tau) and l = tau (1 - r), a command that is held over h moves it by

    G = ((h - l) + l (1 - r) / (z - r)) / (z - 1),    so that it follows by 1 / ((1 + i omega tau) (1 + pull G)).

On bodies the loop is that of the linear vehicles. A vehicle behaves in the same way in axes that move with the medium.
So with E_v the rows of its velocity, x+ = A x + B u + (E_v - A E_v) w and p+ = p + C x + D u + (h - C E_v) w. A hull
rights itself to the surface, so the same is true for a slope s, with E_s the attitude normal to it:
x+ = A x + (E_s - A E_s) s and p+ = p + C x - C E_s s. Heave is left out. A boat that holds no heading turns along the
waves within minutes, by a second-order effect that the linear vehicle does not have, so it is assumed to have turned.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydantic import Field
from scipy import linalg

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.checking.loop.body_loop import (
    NEUTRAL_RATE,
    held_modes,
    ideal_team,
    linear_vehicles,
    medium_on_path,
    period_of_law,
    whole_loop,
)
from mjsheaf.checking.loop.held_law import ROUNDS_OF_FITTING_EDGES, closed, driven
from mjsheaf.checking.loop.linear_law import model_of, require_model, without_memory
from mjsheaf.checking.spectrum import Complex, Spectrum, matrix_of
from mjsheaf.checking.theorem.certificate import FILTERED, Certificate
from mjsheaf.checking.theorem.constants import agent_flow, agent_motion, flow_over_periods
from mjsheaf.checking.theorem.targets import Carrier, follow_targets
from mjsheaf.errors import InputError, UndecidedError, select_true
from mjsheaf.law.law import LawArrays
from mjsheaf.loop.linear import LinearVehicle
from mjsheaf.loop.system import System
from mjsheaf.media.gusts import Filter, FrozenArrays, GustArrays
from mjsheaf.media.medium import of_kind
from mjsheaf.media.waves import Components
from mjsheaf.section import PER_AGENT_RMS, Finite, Norm, Record
from mjsheaf.threads import one_thread

MAX_STATES = 400
"""Largest number of states of the loop for which the error is predicted."""

WIND_ON_TARGETS = "the drift of targets in the wind"
"""Entry of `leaves_out` if wind moves q*; the prediction is then not used."""


class SteadyError(Record):
    """Tracking error that the linear loop predicts from the initial positions, over the second half of the run.

    For a run with events it covers the time before the first of them.
    """

    ideal: Finite = Field(description="on ideal kinematics, m; null: see reason")
    bodies: Finite = Field(description="on the vehicles, m; null: see reason_on_bodies")
    norm: Norm = Field(PER_AGENT_RMS, description="which norm the errors are")
    exact_links: bool = Field(description="true if links are exact; if not, the prediction is as if they were")
    limited: list[str] = Field(description="agents whose predicted commands exceed their speed limits in that half")
    leaves_out: list[str] = Field([], description="effects in the run that are not in the prediction")
    reason: str = Field(description="why there is no prediction on ideal kinematics, or empty")
    reason_on_bodies: str = Field(description="why there is none on the vehicles, or empty")


class _Path(NamedTuple):
    """Inputs of the loop at K + 1 samples of the path.

    Attributes:
        initial: Positions of the agents at the first of them, shape (n_q,), m: at q* unless the run starts there.
        q_star: Harmonic extension, shape (K + 1, n_q), m.
        flow: Velocity of the medium at q* over each period, shape (K, n_q), m/s.
        counted: Number of samples at the end over which errors are averaged.
    """

    initial: Array
    q_star: Array
    flow: Array
    counted: int


@one_thread
def steady_error(
    system: System,
    certificate: Certificate,
    rate: float | None,
    *,
    notable: float = 0.05,
) -> SteadyError:
    """Predict the tracking error of a run in steady state.

    Args:
        system: System of the run.
        certificate: Certificate of the system, with the targets' path.
        rate: Slowest decay of the loop, 1/s; None if it is not known.
        notable: Fraction of the error; effects that may be larger are named.
    """
    bodies = None
    reason_on_bodies = ""
    exact = not len(system.law.links.table)
    limit = system.law.limit[: len(system.team.agents)]
    try:
        require_model(system)
        path = _path_of(system, certificate, rate)
        ideal, speed, places = _follow(system, certificate, system.law, ideal_team(system), limit, path)
    except UndecidedError as error:
        return SteadyError(
            ideal=None, bodies=None, exact_links=exact, limited=[], reason=str(error), reason_on_bodies=str(error)
        )
    # Difference in steady flow between the positions and q*, m/s, and remaining initial error, m; both RMS.
    difference = agent_flow(system, places) - agent_flow(system, path.q_star[-path.counted :])
    shear = float(np.sqrt((difference**2).sum(axis=1).mean() / len(limit)))
    begins = system.grid.period * (len(path.q_star) - path.counted)
    initial = float(np.linalg.norm(path.initial - path.q_star[0])) / np.sqrt(len(limit))
    unsettled = initial * np.exp(-(rate or 0.0) * begins) > notable * ideal
    limited = np.any((speed > limit)[-path.counted :], axis=0)
    saturates = np.any(speed > limit)
    strained = np.zeros((1, len(limit)), dtype=np.bool_)
    turns = [False]
    try:
        medium = medium_on_path(system, certificate.constants.path)
        vehicles = linear_vehicles(system, range(len(limit)), medium)
        able = [vehicle.capability for vehicle in system.vehicles[: len(limit)]]
        fastest = np.minimum(limit, [one.top_speed for one in able])
        law = system.control_of_bodies.law  # whose feedforward leads by the time constants
        if len(law.terms.lead) and np.ptp(law.terms.lead) > 0.0:
            raise UndecidedError("feedforward leads by the unlike time constants of the vehicles")
        drift = system.drift_in_wind(medium)
        blown = path._replace(flow=path.flow + drift.reshape(-1)[system.team.slots[: path.flow.shape[1]]])
        bodies, speed, _ = _follow(system, certificate, law, vehicles, fastest, blown)
        strained = np.minimum(speed, limit) > [one.least_speed for one in able]
        turns = [unsettled and one.dimension == 2 and not one.steering.attitude for one in system.vehicles]
    except UndecidedError as error:
        reason_on_bodies = str(error)
    left_out = {
        "noise, delays and losses of links": not exact,
        "differences in flow between agents and their places": shear > notable * ideal * (rate or 0.0),
        "the curvature of range and bearing edges": system.team.linearised_at is not None,
        "effects of speed limits on terms of the law": system.law.extended and saturates,
        "thrust limits": strained[0 if unsettled else -path.counted :].any(),
        "turns of boats that hold no heading": any(turns[: len(limit)]),
        WIND_ON_TARGETS: bool(system.mean_wind[len(limit) :][system.motion.pull[len(limit) :] == 0.0].any()),
    }
    return SteadyError(
        ideal=ideal,
        bodies=bodies,
        exact_links=exact,
        limited=[id for id, often in zip(system.team.agent_ids, limited, strict=True) if often],
        leaves_out=select_true(left_out),
        reason="",
        reason_on_bodies=reason_on_bodies,
    )


def _path_of(
    system: System,
    certificate: Certificate,
    rate: float | None,
    *,
    most: int = 4_000_000,  # samples times states
    decays: float = 12.0,  # start before the second half, in units of 1 / rate, if no speed is limited
    gauss: float = 0.5 / math.sqrt(3.0),  # nodes of Gauss and Legendre, from the middle of a period, in periods
) -> _Path:
    """Return the inputs of the loop along the targets' path.

    Raises:
        UndecidedError: The path is not known, the harmonic extension is not unique, or the run is too long.
    """
    path = certificate.constants.path
    if system.safety is not None:
        raise UndecidedError(FILTERED)
    if system.grid.continuous:
        raise UndecidedError("the law is continuous")
    if system.team.ramp is not None or system.team.changing is not None:
        raise UndecidedError("formations change from the start")
    if not system.team.symmetric and system.law.extended:
        raise UndecidedError("H is not symmetric, and the law has terms")
    if system.team.stressed and (system.law.terms.newton or system.law.terms.feedforward):
        raise UndecidedError(ROUNDS_OF_FITTING_EDGES)
    if system.team.free:
        raise UndecidedError("the team keeps a shape, and no target places it")
    if certificate.spectrum.nullity:
        raise UndecidedError("the harmonic extension is not unique")
    if path.cells is None:
        raise UndecidedError(f"the targets' path is not known: {path.warning}")
    if path.stride > 1:
        raise UndecidedError("the run has too many samples")
    last = len(path.samples) - 1
    counted = last + 1 - (last + 1) // 2
    first = 0
    if rate and rate > 0.0 and not np.isfinite(system.law.limit[: len(system.team.agents)]).any():
        first = max(0, last - counted - int(decays / (rate * system.grid.period)) - 1)
    q_star = Carrier(system).extend(path.samples[first:])
    if q_star.size > most:
        raise UndecidedError("the run is too long")
    middle = 0.5 * (q_star[1:] + q_star[:-1])
    flow = flow_over_periods(system, middle, first)
    times = system.grid.span(first, last) + 0.5 * system.grid.period
    for instant in times - gauss * system.grid.period, times + gauss * system.grid.period:
        flow += 0.5 * agent_motion(system, instant, middle)
    if not np.isfinite(flow).all():
        raise UndecidedError("q* leaves the file of the flow")
    start = system.initial.reshape(-1)[system.team.slots[: q_star.shape[1]]]
    return _Path(q_star[0] if first else start, q_star, flow, counted)


def _follow(
    system: System,
    certificate: Certificate,
    law_arrays: LawArrays,
    vehicles: list[LinearVehicle],
    limit: Array,
    path: _Path,
) -> tuple[float, Array, Array]:
    """Simulate the loop along a path.

    Args:
        system: The system.
        certificate: Its certificate.
        law_arrays: The law.
        vehicles: Linear vehicle of each agent.
        limit: Largest speed of each agent through the medium, shape (N,), m/s.
        path: Inputs of the loop.

    Returns:
        The RMS error over agents and the counted samples, m; the speeds that the law commands, before limits, at all
        samples except the last, shape (K, N), m/s; and the positions at the counted samples, shape (counted, n_q), m.

    Raises:
        UndecidedError: The loop has too many states, or is unstable.
    """
    H = system.team.law_problem.H.toarray() if system.team.symmetric else matrix_of(system.team)
    n = len(H)
    if system.team.symmetric:
        values, vectors = held_modes(system, certificate.spectrum)
        modes = model_of(law_arrays, system.grid.period).at(system.gain, values)
    size = n + sum(len(vehicle.A) for vehicle in vehicles) + (modes.C.size if system.team.symmetric else 0)
    if size > MAX_STATES:
        raise UndecidedError(f"the loop has {size} states, more than {MAX_STATES}")
    if system.team.symmetric:
        law = modes.of_team(vectors)
    else:  # u = -k1 eta
        law = without_memory(-system.gain * np.hstack([H, np.eye(n), np.zeros((n, 3 * n))]))
    plant = LinearVehicle(*(linalg.block_diag(*blocks) for blocks in zip(*vehicles, strict=True)))
    moved = np.vstack([plant.D, plant.B])
    loop = driven(plant, law)
    if not np.abs(np.linalg.eigvals(loop.A)).max() <= 1.0 + NEUTRAL_RATE * system.grid.period:
        raise UndecidedError("the loop is unstable")
    q_star = path.q_star - path.q_star[0]
    s = q_star @ H.T
    carried = system.grid.period * path.flow
    seen = np.vstack([0.0 * carried[:1], carried])  # over the previous period, as odometry reports it
    inputs = np.hstack([-s, s, 0.0 * s, seen])[:-1]  # s is an error of eta, and the measurement of sensing edges
    pushed = inputs @ loop.B.T
    pushed[:, :n] += carried
    followed = np.zeros((len(inputs) + 1, size))
    followed[0, :n] = path.initial - path.q_star[0]
    copied = ~law.A.any(axis=1)  # stored measurements; before the first sample, nothing has moved
    followed[0, len(moved) :][copied] = law.B[copied, :n] @ followed[0, :n]
    agent = np.repeat(np.arange(len(limit)), [member.dimension for member in system.team.agents])
    speed = np.empty((len(inputs), len(limit)))
    for k, push in enumerate(pushed):
        u = loop.C @ followed[k] + loop.D @ inputs[k]
        speed[k] = np.sqrt(np.bincount(agent, u**2))
        followed[k + 1] = loop.A @ followed[k] + push
        if (speed[k] > limit).any():
            excess = np.maximum(1.0 - limit / np.maximum(speed[k], 1e-300), 0.0)
            followed[k + 1, : len(moved)] -= moved @ (excess[agent] * u)
    error = (q_star - followed[:, :n])[-path.counted :]
    return (
        float(np.sqrt((error**2).sum(axis=1).mean() / len(limit))),
        speed,
        followed[-path.counted :, :n] + path.q_star[0],
    )


# -- gusts and waves ---------------------------------------------------------------------------------------------------


_MOST_STATES = 300
"""Largest loop that is solved at every frequency."""


class DisturbanceRecord(Record):
    """RMS errors |q - q*| due to gusts and waves in steady state; constant errors are not included."""

    rms: Finite = Field(description="RMS over agents, on ideal kinematics, m; null: see reason")
    agents: dict[str, Finite] = Field(description="RMS of each agent on ideal kinematics, m")
    bodies: dict[str, Finite] = Field(description="RMS of each agent on its vehicle, m; empty: see bodies_reason")
    norm: Norm = Field(PER_AGENT_RMS, description="which norm `rms` is")
    carried_off: dict[str, float] = Field(
        {},
        description="agents that cannot hold station at times: excess of the medium's speed, its mean plus twice its "
        "horizontal RMS, over the vehicle's steady speed in its slowest direction, m/s",
    )
    too_fast: dict[str, float] = Field(
        {},
        description="fraction of the time that the medium is faster than the vehicle in its fastest direction, or than "
        "its velocity limit, of the same agents",
    )
    clipped: dict[str, float] = Field(
        {},
        description="vehicles that begin below or above the altitudes for which the model of the gusts holds: altitude "
        "of the gusts that they meet, m",
    )
    leaves_out: list[str] = Field([], description="effects in the run that are not in the prediction")
    reason: str = Field("", description="why it is not known, or empty")
    bodies_reason: str = Field("", description="why it is not known on bodies, or empty")

    @property
    def rms_on_bodies(self) -> float | None:
        """RMS over agents on their vehicles, m; None if it is not known."""
        known = [rms for rms in self.bodies.values() if rms is not None]
        return float(np.sqrt(np.mean(np.square(known)))) if known else None


class _Loop(NamedTuple):
    """A loop with its inputs from the medium.

    Attributes:
        M: Map of the states from one sample to the next, shape (S, S).
        inputs: Inputs of the mean velocities of the agents and of q*, and of the slopes of the surface about the agents
            along x and y, side by side, shape (S, 3 n_q), s, s and 1.
        shown: Rows that give the error, shape (n_q, S).
        period: Time between samples, s.
        continuous: Eigenvalues k1 lambda of a continuous law and their vectors; None if the law is held.
    """

    M: Array
    inputs: Array
    shown: Array
    period: float
    continuous: tuple[Array, Array] | None = None

    def response(self, rate: float, *, of_wave: bool) -> Complex:
        """Return the response E to the inputs at a frequency, rad/s, shape (n_q, 3 n_q), s and m.

        Inputs are means over a period or, with `of_wave`, the velocity of a wave at the middle of a period.
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
        rate: Frequency, rad/s.
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
        steep: Significant height over the wavelength of the peak, above which slow drift in groups adds a few percent.
    """
    ids = system.team.agent_ids
    if not any(flow.gusts is not None or flow.waves is not None for flow in system.flows):
        return DisturbanceRecord(rms=0.0, agents=dict.fromkeys(ids, 0.0), bodies=dict.fromkeys(ids, 0.0))
    bodies, bodies_reason = dict[str, float](), ""
    clipped = dict[str, float]()
    for id, field, place in zip(system.team.index, system.field, system.initial, strict=True):
        gusts, height = system.flows[field].gusts, float(place[2]) - system.bodies.surface_height
        if gusts is not None and isinstance(gusts.altitude, str) and gusts.altitude_of(height) != height:
            clipped[id] = gusts.altitude_of(height)
    carried_off, too_fast = _carried_off(system, medium)
    known = {"carried_off": carried_off, "too_fast": too_fast, "clipped": clipped}
    try:
        _require_known(system)
        _require_one_side(system)
        ideal = _rms(system, _ideal_loop(system, spectrum), np.zeros(len(system.team.targets)))
    except (UndecidedError, InputError, np.linalg.LinAlgError) as error:
        return DisturbanceRecord(
            rms=None,
            agents=dict.fromkeys(ids),
            bodies={},
            **known,
            **dict.fromkeys(("reason", "bodies_reason"), str(error)),
        )
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


def _carried_off(system: System, medium: Array, *, draws: int = 4_000) -> tuple[dict[str, float], dict[str, float]]:
    """Return the agents for which the medium is too fast at times: by how much, m/s, and for which part of the time.

    Args:
        system: The system.
        medium: Mean velocity of the medium about each agent, shape (N, 3), m/s.
        draws: Velocities that are drawn of each agent's medium, a normal variable, for the latter.
    """
    covariance = np.zeros((len(system.field), 2, 2))  # of horizontal velocities
    for number, flow in enumerate(system.flows):
        if flow.waves is not None:
            waves = flow.waves.sampled(system.seed)
            along, _ = _speeds(system, waves, number, system.initial[:, 2])
            covariance += 0.5 * np.einsum("wv,wi,wj->vij", along**2, waves.unit, waves.unit)
    for gusts in of_kind(system.moving, GustArrays):
        covariance[gusts.met > 0] += np.square(gusts.filter.output[:, 0, 0])[:, None, None] * np.eye(2)
    for frozen in of_kind(system.moving, FrozenArrays):
        covariance[frozen.met > 0] += frozen.filter.output[0, 0, 0] ** 2 * np.eye(2)
    excess, fraction = dict[str, float](), dict[str, float]()
    normal = np.random.default_rng(0).standard_normal((draws, 2))
    for i, id in enumerate(system.team.agent_ids):
        able, limit = system.vehicles[i].capability, float(system.law.limit[i])
        over = float(np.linalg.norm(medium[i]) + 2.0 * np.sqrt(np.trace(covariance[i]))) - min(able.least_speed, limit)
        if over > 0.0:
            excess[id] = over
            values, axes = np.linalg.eigh(covariance[i])
            speed = np.linalg.norm(medium[i, :2] + normal * np.sqrt(np.maximum(values, 0.0)) @ axes.T, axis=1)
            fraction[id] = float((np.hypot(speed, medium[i, 2]) > min(able.top_speed, limit)).mean())
    return excess, fraction


def _require_known(system: System) -> None:
    """Raise an UndecidedError unless the response to the medium is that of the law's loop alone."""
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
        UndecidedError: A target or an agent's q* does, or that is not known.
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
    """Return the loop of the agents' vehicles; without heading hold, they turn along the waves, the shorter way."""
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
    block = whole_loop(system, spectrum, agents)
    plant, Q = block.plant, block.places
    M = closed(plant, block.law(system.gain))
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
    E_v, E_s = linalg.block_diag(*velocities), linalg.block_diag(*tilts)
    n_q, m = Q.shape
    inputs = np.zeros((len(M), 3 * n_q))
    inputs[:m] = np.hstack([h * Q.T - plant.C @ E_v, -h * Q.T, -plant.C @ E_s])
    inputs[m : m + len(E_v)] = np.hstack([E_v - plant.A @ E_v, 0.0 * E_v, E_s - plant.A @ E_s])
    shown = np.zeros((n_q, len(M)))
    shown[:, :m] = Q
    return _Loop(M, inputs, shown, h)


def _rms(
    system: System,
    loop: _Loop,
    tau: Array,
    *,
    neutral: float = 1.0 + 1e-6,  # largest eigenvalue of a heading that nothing holds, with rounding
) -> Array:
    """Return the RMS of each agent, shape (N,), m; `tau` (M,) are the targets' time constants in the medium, s."""
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
    """Return the response of targets to the medium at a frequency, rad/s, with pull and the lag of bodies, (M,)."""
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
    """Yield the spectral lines of all moving parts of the medium, for a sample period in s."""
    agents = system.team.harmonic_extension(system.initial)
    places = np.concatenate([np.nan_to_num(agents), system.initial[len(agents) :]])
    for number, flow in enumerate(system.flows):
        if flow.waves is None:
            continue
        waves = flow.waves.sampled(system.seed)
        along, up = _speeds(system, waves, number, places[:, 2])
        steep = (waves.number * waves.amplitude)[:, None] * (system.planar & (system.field == number))
        for j, (rate, unit) in enumerate(zip(waves.rate, waves.unit, strict=True)):
            phase = np.exp(-1j * waves.number[j] * (places[:, :2] @ unit))
            velocity = phase[:, None] * np.column_stack([along[j, :, None] * unit, 1j * up[j]])
            slope = np.zeros_like(velocity)
            slope[:, :2] = -1j * (steep[j] * phase)[:, None] * unit
            yield _Line(rate, 0.5, velocity[None], slope[None])
    for gusts in of_kind(system.moving, GustArrays):  # separate for each vehicle
        met = np.flatnonzero(gusts.met)
        for angle, weight in _angles(gusts.filter):
            velocity = np.zeros((len(met), 3, len(gusts.met), 3), dtype=np.complex128)
            velocity[np.arange(len(met)), :, met] = _amplitudes(gusts.filter, angle)
            yield _Line(angle / period, weight, velocity.reshape(-1, *velocity.shape[2:]))
    for frozen in of_kind(system.moving, FrozenArrays):
        distance = places[:, :2] @ frozen.filter.direction[0]
        for angle, weight in _angles(frozen.filter):
            phase = np.exp(-1j * angle / period * distance / frozen.track[0]) * (frozen.met > 0)
            yield _Line(angle / period, weight, phase[:, None] * _amplitudes(frozen.filter, angle)[0][:, None])


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
    count: int = 240,  # number of frequencies, evenly spaced in the logarithm
    lowest: float = 1e-3,  # lowest frequency, as a fraction of the slowest rate of gusts and loop
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
