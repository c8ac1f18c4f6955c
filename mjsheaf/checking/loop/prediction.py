"""Predicted tracking error: the linear loop, driven along the targets' path from the initial positions.

With q and q* measured from q* at the start, s = H q* is what the targets add to eta = H q - s. The law in the
eigenvectors of H (see `linear_law`) has the inputs q, -s as an error of eta, s as what sensing edges report, and the
displacement by the medium over the period before as what an agent sees of its own motion. The vehicles have the
commands u and the velocity of the medium at q*, with its disturbance, gusts, waves and tides, as inputs. So

    z_{k+1} = M z_k + E (s_k, f_k),    z = (q, states of the vehicles, what the law remembers)

where the vehicles begin, at rest. Commands are shortened to the speed limits and, on the vehicles, to their speeds
ahead. The prediction leaves out how the flow differs at q from q*, noise, and what delays and losses do.
"""

from typing import NamedTuple

import numpy as np
from pydantic import Field
from scipy import linalg

from mjsheaf.arrays import Array, BoolArray
from mjsheaf.checking.loop.body_loop import NEUTRAL_RATE, held_modes
from mjsheaf.checking.loop.held_law import ROUNDS_OF_FITTING_EDGES
from mjsheaf.checking.loop.linear_law import model_of, require_model, without_memory
from mjsheaf.checking.loop.linear_team import ideal_team, linear_vehicles, medium_on_path
from mjsheaf.checking.loop.sampled_loop import driven
from mjsheaf.checking.spectrum import matrix_of
from mjsheaf.checking.theorem.certificate import FILTERED, Certificate
from mjsheaf.checking.theorem.constants import agent_flow, agent_motion
from mjsheaf.checking.theorem.targets import Carrier
from mjsheaf.errors import UndecidedError, select_true
from mjsheaf.law import LawArrays
from mjsheaf.loop.linear import LinearVehicle
from mjsheaf.loop.system import System
from mjsheaf.media.varying import evaluate
from mjsheaf.section import PER_AGENT_RMS, Finite, Norm, Record
from mjsheaf.threads import one_thread
from mjsheaf.vehicles.effects import capability_of, hold_station

MAX_STATES = 400
"""Largest number of states of the loop for which the error is predicted."""

WIND_ON_TARGETS = "the drift of targets in the wind"
"""What a prediction leaves out where wind moves q*: then it foresees no error."""

_GAUSS = 0.5 / np.sqrt(3.0)  # of a period, from its middle
_SETTLING = 12.0  # times 1 / rate before the second half from which the loop is followed, if no speed is limited
_LEAST_SPEED = 1e-300  # m/s


class SteadyError(Record):
    """Tracking error that the linear loop predicts from the initial positions, over the second half of the run.

    Of a run with events it is about the time before the first of them.
    """

    ideal: Finite = Field(description="on ideal kinematics, m; null: see reason")
    bodies: Finite = Field(description="on the vehicles, m; null: see reason_on_bodies")
    norm: Norm = Field(PER_AGENT_RMS, description="which norm the errors are")
    exact_links: bool = Field(description="true if links are exact; if not, the prediction is as if they were")
    limited: list[str] = Field(description="agents whose predicted commands exceed their speed limits in that half")
    leaves_out: list[str] = Field([], description="what acts in the run and is not in the prediction")
    reason: str = Field(description="why there is no prediction on ideal kinematics, or empty")
    reason_on_bodies: str = Field(description="why there is none on the vehicles, or empty")


class _Path(NamedTuple):
    """Inputs of the loop at the samples from which it is followed.

    Attributes:
        initial: Positions of the agents there, shape (n_q,), m: at q* unless the run starts there.
        q_star: Harmonic extension, shape (K + 1, n_q), m.
        flow: Velocity of the medium at q* over each period, shape (K, n_q), m/s.
        counted: Number of samples at the end that count.
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
        certificate: Certificate of the system, which knows the targets' path.
        rate: Slowest decay of the loop, 1/s; None if it is not known.
        notable: Fraction of the error; effects that may be larger are named.
    """
    ideal = bodies = None
    reason = reason_on_bodies = ""
    limit = system.law.limit[: len(system.team.agents)]
    sheared = unsettled = False
    turns = [False]
    limited: BoolArray = np.zeros(len(limit), dtype=np.bool_)
    saturates = limited
    slow = limited
    try:
        require_model(system)
        path = _path_of(system, certificate, rate)
        ideal, speed, places = _follow(system, certificate, system.law, ideal_team(system), limit, path)
        # The difference in steady flow between the places and q*, m/s, and what is left of the initial error, m; RMS.
        difference = agent_flow(system, places) - agent_flow(system, path.q_star[-path.counted :])
        shear = float(np.sqrt((difference**2).sum(axis=1).mean() / len(limit)))
        begins = system.grid.period * (len(path.q_star) - path.counted)
        initial = float(np.linalg.norm(path.initial - path.q_star[0])) / np.sqrt(len(limit))
        sheared = shear > notable * ideal * (rate or 0.0)
        unsettled = initial * np.exp(-(rate or 0.0) * begins) > notable * ideal
        limited = np.any((speed > limit)[-path.counted :], axis=0)
        saturates = np.any(speed > limit, axis=0)
    except UndecidedError as error:
        reason = reason_on_bodies = str(error)
    else:
        try:
            medium = medium_on_path(system, certificate.constants.path)
            vehicles = linear_vehicles(system, range(len(limit)), medium)
            able = [capability_of(vehicle) for vehicle in system.vehicles[: len(limit)]]
            fastest = np.minimum(limit, [one.forward_speed for one in able])
            law = system.control_of_bodies.law  # whose feedforward leads by the time constants
            if len(law.terms.lead) and np.ptp(law.terms.lead) > 0.0:
                raise UndecidedError("feedforward leads by the unlike time constants of the vehicles")
            drift = np.zeros((len(limit), 3))
            for i in np.flatnonzero(system.mean_wind[: len(limit)].any(axis=1)).tolist():
                heading, wind = float(system.bodies.heading[i]), system.mean_wind[i] + medium[i]
                drift[i, :2] = -medium[i, :2] - hold_station(system.vehicles[i], heading, medium[i], wind)[1]
            blown = path._replace(flow=path.flow + drift.reshape(-1)[system.team.slots[: path.flow.shape[1]]])
            bodies, speed, _ = _follow(system, certificate, law, vehicles, fastest, blown)
            strained = np.minimum(speed, limit) > [one.least_speed for one in able]
            slow = np.any(strained[0 if unsettled else -path.counted :], axis=0)
            turns = [unsettled and one.dimension == 2 and not one.steering.attitude for one in system.vehicles]
        except UndecidedError as error:
            reason_on_bodies = str(error)
    exact = not len(system.law.links.table)
    left_out = {
        "noise, delays and losses of links": not exact,
        "differences in flow between agents and their places": sheared,
        "the curvature of range and bearing edges": system.team.linearised_at is not None,
        "effects of speed limits on terms of the law": system.law.extended and saturates.any(),
        "thrust limits": slow.any(),
        "turns of boats that hold no heading": any(turns[: len(limit)]),
        WIND_ON_TARGETS: bool(system.mean_wind[len(limit) :][system.motion.pull[len(limit) :] == 0.0].any()),
    }
    return SteadyError(
        ideal=ideal,
        bodies=bodies,
        exact_links=exact,
        limited=[id for id, often in zip(system.team.agent_ids, limited, strict=True) if often],
        leaves_out=[] if ideal is None else select_true(left_out),
        reason=reason,
        reason_on_bodies=reason_on_bodies,
    )


def _path_of(
    system: System,
    certificate: Certificate,
    rate: float | None,
    *,
    most: int = 4_000_000,  # samples times states
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
    if len(path.samples) < 2:
        raise UndecidedError("there are no targets to follow")
    if path.stride > 1:
        raise UndecidedError("the run has too many samples")
    last = len(path.samples) - 1
    counted = last + 1 - (last + 1) // 2
    decays = rate and rate > 0.0 and not np.isfinite(system.law.limit[: len(system.team.agents)]).any()
    settling = int(_SETTLING / (rate * system.grid.period)) + 1 if rate and decays else last
    first = max(0, last - counted - settling)
    q_star = Carrier(system).extend(path.samples[first:])
    if q_star.size > most:
        raise UndecidedError("the run is too long")
    flow = _mean_flow(system, q_star, first, last)
    if not np.isfinite(flow).all():
        raise UndecidedError("q* leaves the file of the flow")
    start = system.initial.reshape(-1)[system.team.slots[: q_star.shape[1]]]
    return _Path(q_star[0] if first else start, q_star, flow, counted)


def _mean_flow(system: System, q_star: Array, first: int, last: int) -> Array:
    """Return the mean velocity of the medium at q* over each period between two samples of a run, (K, n_q), m/s."""
    period = system.grid.period
    times = system.grid.span(first, last) + 0.5 * period
    harmonics = system.harmonics[: len(system.team.agents)].copy()
    harmonics[..., :3] *= np.sinc(harmonics[..., 3:4] * period / (2.0 * np.pi))  # the mean of a sine over a period
    shaken = evaluate(harmonics, times).reshape(last - first, -1)
    middle = 0.5 * (q_star[1:] + q_star[:-1])
    flow = agent_flow(system, middle) + shaken[:, system.team.slots[: q_star.shape[1]]]
    for instant in times - _GAUSS * period, times + _GAUSS * period:  # the mean over a period, by Gauss and Legendre
        flow += 0.5 * agent_motion(system, instant, middle)
    return flow


def _follow(
    system: System,
    certificate: Certificate,
    law_arrays: LawArrays,
    vehicles: list[LinearVehicle],
    limit: Array,
    path: _Path,
) -> tuple[float, Array, Array]:
    """Follow the loop along a path.

    Args:
        system: The system.
        certificate: Its certificate.
        law_arrays: The law.
        vehicles: Linear vehicle of each agent.
        limit: Largest speed of each agent through the medium, shape (N,), m/s.
        path: Inputs of the loop.

    Returns:
        The RMS error over agents and the samples that count, m, the speeds that the law commands, before limits, at all
        samples but the last, shape (K, N), m/s, and the positions at the samples that count, shape (counted, n_q), m.

    Raises:
        UndecidedError: The loop has too many states, or is unstable.
    """
    H = system.team.law_problem.H.toarray() if system.team.symmetric else matrix_of(system.team)
    n = len(H)
    if system.team.symmetric:
        values, vectors = held_modes(system, certificate.spectrum)
        law = model_of(law_arrays, system.grid.period).at(system.gain, values).of_team(vectors)
    else:  # u = -k1 eta
        law = without_memory(-system.gain * np.hstack([H, np.eye(n), np.zeros((n, 3 * n))]))
    plant = LinearVehicle(*(linalg.block_diag(*blocks) for blocks in zip(*vehicles, strict=True)))
    moved = np.vstack([plant.D, plant.B])
    size = len(moved) + len(law.A)
    if size > MAX_STATES:
        raise UndecidedError(f"the loop has {size} states, more than {MAX_STATES}")
    loop = driven(plant, law)
    if not np.abs(np.linalg.eigvals(loop.A)).max() <= 1.0 + NEUTRAL_RATE * system.grid.period:
        raise UndecidedError("the loop is unstable")
    q_star = path.q_star - path.q_star[0]
    s = q_star @ H.T
    carried = system.grid.period * path.flow
    seen = np.vstack([0.0 * carried[:1], carried])  # over the period before, as an agent knows it
    inputs = np.hstack([-s, s, 0.0 * s, seen])[:-1]  # s is an error of eta, and what sensing edges report
    pushed = inputs @ loop.B.T
    pushed[:, :n] += carried
    followed = np.zeros((len(inputs) + 1, size))
    followed[0, :n] = path.initial - path.q_star[0]
    copied = ~law.A.any(axis=1)  # what the next sample compares with; before the first, nothing has moved
    followed[0, len(moved) :][copied] = law.B[copied, :n] @ followed[0, :n]
    agent = np.repeat(np.arange(len(limit)), [member.dimension for member in system.team.agents])
    speed = np.empty((len(inputs), len(limit)))
    for k, push in enumerate(pushed):
        u = loop.C @ followed[k] + loop.D @ inputs[k]
        speed[k] = np.sqrt(np.bincount(agent, u**2))
        followed[k + 1] = loop.A @ followed[k] + push
        if (speed[k] > limit).any():
            excess = np.maximum(1.0 - limit / np.maximum(speed[k], _LEAST_SPEED), 0.0)
            followed[k + 1, : len(moved)] -= moved @ (excess[agent] * u)
    error = (q_star - followed[:, :n])[-path.counted :]
    places = followed[-path.counted :, :n] + path.q_star[0]
    return float(np.sqrt((error**2).sum(axis=1).mean() / len(limit))), speed, places
