"""Predicted steady tracking error: the linear loop, driven along the targets' path.

With q and q* measured from q* at the start, s = H q* is what the targets add to eta = H q - s. The law in the
eigenvectors of H (see `linear_law`) has the inputs q, -s as an error of eta, s as what sensing edges report, and the
displacement by the medium over the period before as what an agent sees of its own motion. The vehicles have the
commands u and the velocity of the medium at q*, with its disturbance, gusts, waves and tides, as inputs. So

    z_{k+1} = M z_k + E (s_k, f_k),    z = (q, states of the vehicles, what the law remembers)

from rest. The prediction leaves out limits of speed and thrust, how the flow differs at q from q*, noise, and what
delays and losses do.
"""

from typing import NamedTuple

import numpy as np
from pydantic import Field
from scipy import linalg

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.body_loop import NEUTRAL_RATE, held_modes, linear_vehicles
from mjsheaf.checking.loop.directed import matrix_of
from mjsheaf.checking.loop.held_law import ROUNDS_OF_FITTING_EDGES
from mjsheaf.checking.loop.linear_law import LinearLaw, model_of
from mjsheaf.checking.loop.modelled import require_model
from mjsheaf.checking.theorem.certificate import FILTERED, Certificate
from mjsheaf.checking.theorem.constants import agent_drift, agent_motion
from mjsheaf.checking.theorem.targets import Carrier
from mjsheaf.control import LawArrays
from mjsheaf.errors import UndecidedError, raise_first
from mjsheaf.io.norms import PER_AGENT_RMS, Norm
from mjsheaf.io.section import Finite, Record
from mjsheaf.media.disturbance import evaluate
from mjsheaf.simulation.linear import LinearVehicle
from mjsheaf.system import System
from mjsheaf.threads import one_thread

MAX_STATES = 400
"""Largest number of states of the loop for which the error is predicted."""

_MAX_NUMBERS = 4_000_000  # samples times states
_GAUSS = 0.5 / np.sqrt(3.0)  # of a period, from its middle
_SETTLING = 12.0  # times 1 / rate before the second half from which the loop is followed


class SteadyError(Record):
    """Tracking error that the linear loop predicts along the targets' path, over the second half of the run."""

    ideal: Finite = Field(description="on ideal kinematics, m; null: see reason")
    bodies: Finite = Field(description="on the vehicles, m; null: see reason_on_bodies")
    norm: Norm = Field(PER_AGENT_RMS, description="which norm the errors are")
    exact_links: bool = Field(description="true if links are exact; if not, the prediction is as if they were")
    limited: list[str] = Field(description="agents whose predicted commands exceed their speed limits")
    reason: str = Field(description="why there is no prediction on ideal kinematics, or empty")
    reason_on_bodies: str = Field(description="why there is none on the vehicles, or empty")


class _Path(NamedTuple):
    """Inputs of the loop at the samples from which it is followed.

    Attributes:
        q_star: Harmonic extension, shape (K + 1, n_q), m.
        flow: Velocity of the medium at q* over each period, shape (K, n_q), m/s.
        counted: Number of samples at the end that count.
    """

    q_star: Array
    flow: Array
    counted: int


@one_thread
def steady_error(system: System, certificate: Certificate, rate: float | None) -> SteadyError:
    """Predict the tracking error of a run in steady state.

    Args:
        system: System of the run.
        certificate: Certificate of the system, which knows the targets' path.
        rate: Slowest decay of the loop, 1/s; None if it is not known.
    """
    limited: list[str] = []
    ideal = bodies = None
    reason = reason_on_bodies = ""
    try:
        require_model(system)
        path = _path_of(system, certificate, rate)
        ideal, limited = _follow(system, certificate, system.law, _ideal_vehicles(system), path)
    except UndecidedError as error:
        reason = reason_on_bodies = str(error)
    else:
        try:
            vehicles = linear_vehicles(system, certificate)
            bodies, limited = _follow(system, certificate, _law_on_bodies(system), vehicles, path)
        except UndecidedError as error:
            reason_on_bodies = str(error)
    return SteadyError(
        ideal=ideal,
        bodies=bodies,
        exact_links=not len(system.law.links.table),
        limited=limited,
        reason=reason,
        reason_on_bodies=reason_on_bodies,
    )


def _path_of(system: System, certificate: Certificate, rate: float | None) -> _Path:
    """Return the inputs of the loop along the targets' path.

    Raises:
        UndecidedError: The path is not known, the harmonic extension is not unique, or the run is too long.
    """
    path = certificate.constants.path
    raise_first(
        UndecidedError,
        {
            FILTERED: system.safety is not None,
            "the law is continuous": system.grid.continuous,
            "H is not symmetric, and the law has terms": not system.team.symmetric and system.law.extended,
            ROUNDS_OF_FITTING_EDGES: system.team.stressed and (system.law.terms.newton or system.law.terms.feedforward),
            "the team keeps a shape, and no target places it": system.team.free,
            "the harmonic extension is not unique": certificate.spectrum.nullity,
            f"the targets' path is not known: {path.warning}": path.cells is None,
            "there are no targets to follow": len(path.samples) < 2,
            "the run has too many samples": path.stride > 1,
        },
    )
    last = len(path.samples) - 1
    counted = max(1, last - last // 2)
    settling = int(_SETTLING / (rate * system.grid.period)) + 1 if rate and rate > 0.0 else last
    first = max(0, last - counted - settling)
    q_star = Carrier(system, certificate.spectrum).extend(path.samples[first:])
    if q_star.size > _MAX_NUMBERS:
        raise UndecidedError("the run is too long")
    flow = _mean_flow(system, q_star, first, last)
    if not np.isfinite(flow).all():
        raise UndecidedError("q* leaves the file of the flow")
    return _Path(q_star, flow, min(counted, last - first))


def _mean_flow(system: System, q_star: Array, first: int, last: int) -> Array:
    """Return the mean velocity of the medium at q* over each period between two samples of a run, (K, n_q), m/s."""
    period = system.grid.period
    times = system.grid.span(first, last) + 0.5 * period
    harmonics = system.harmonics[: len(system.team.agents)].copy()
    harmonics[..., :3] *= np.sinc(harmonics[..., 3:4] * period / (2.0 * np.pi))  # the mean of a sine over a period
    shaken = evaluate(harmonics, times).reshape(last - first, -1)
    middle = 0.5 * (q_star[1:] + q_star[:-1])
    flow = agent_drift(system, middle) + shaken[:, system.team.slots[: q_star.shape[1]]]
    for instant in times - _GAUSS * period, times + _GAUSS * period:  # the mean over a period, by Gauss and Legendre
        flow += 0.5 * agent_motion(system, instant, middle)
    return flow


def _ideal_vehicles(system: System) -> list[LinearVehicle]:
    h = system.grid.period
    sizes = [agent.dimension for agent in system.team.agents]
    return [LinearVehicle(np.zeros((0, 0)), np.zeros((0, n)), np.zeros((n, 0)), h * np.eye(n)) for n in sizes]


def _law_on_bodies(system: System) -> LawArrays:
    """Return the law on the vehicles, whose feedforward leads by their time constants.

    Raises:
        UndecidedError: It leads by unlike times, so that the loop does not fall apart into modes.
    """
    law = system.control_of_bodies.law
    if len(law.terms.lead) and np.ptp(law.terms.lead) > 0.0:
        raise UndecidedError("feedforward leads by the unlike time constants of the vehicles")
    return law


class _Physical(NamedTuple):
    """The law in coordinates of the agents, with what it remembers in eigenvectors of H, number by number.

    Attributes:
        position, targets, flow: Commands by q, s, and the displacement by the medium, shape (n, n).
        memory: Commands by what is remembered, shape (n, m L).
        learnt: What is remembered of q, s and that displacement, shapes (m L, n).
        kept: What is remembered of what was, shape (m L, m L).
    """

    position: Array
    targets: Array
    flow: Array
    memory: Array
    learnt: tuple[Array, Array, Array]
    kept: Array


def _in_coordinates(law: LinearLaw, vectors: Array) -> _Physical:
    """Transform a law in L eigenvectors of H, shape (n, L), to coordinates of the agents."""
    n, L = vectors.shape
    m = law.C.shape[1]
    rates = law.B[:, :, 0], law.B[:, :, 2] - law.B[:, :, 1], law.B[:, :, 4]
    commands = [(vectors * gain) @ vectors.T for gain in _gains(law)]
    learnt = [(rate.T[:, :, None] * vectors.T).reshape(m * L, n) for rate in rates]
    kept = np.einsum("lij,lk->iljk", law.A, np.eye(L)).reshape(m * L, m * L)
    memory = (vectors[:, None, :] * law.C.T).reshape(n, m * L)
    return _Physical(commands[0], commands[1], commands[2], memory, (learnt[0], learnt[1], learnt[2]), kept)


def _gains(law: LinearLaw) -> tuple[Array, Array, Array]:
    """Return the commands by q, by s and by the displacement of the medium in each eigenvector, shapes (L,)."""
    return law.D[:, 0], law.D[:, 2] - law.D[:, 1], law.D[:, 4]


def _of_asymmetric(law: LinearLaw, H: Array) -> _Physical:
    """Transform a law without terms, which is affine in the eigenvalues of H, from its gains at 0 and 1."""
    commands = [gain[0] * np.eye(len(H)) + (gain[1] - gain[0]) * H for gain in _gains(law)]
    empty = np.zeros((0, len(H)))
    return _Physical(commands[0], commands[1], commands[2], empty.T, (empty, empty, empty), np.zeros((0, 0)))


def _follow(
    system: System, certificate: Certificate, law_arrays: LawArrays, vehicles: list[LinearVehicle], path: _Path
) -> tuple[float, list[str]]:
    """Return the RMS error over agents and samples, m, and the agents whose commands exceed their speed limits.

    Raises:
        UndecidedError: The loop has too many states, or is unstable.
    """
    symmetric = system.team.symmetric
    H = system.team.dirichlet.H.toarray() if symmetric else matrix_of(system.team)
    values, vectors = held_modes(system, certificate.spectrum) if symmetric else (np.array([0.0, 1.0]), H)
    law = model_of(law_arrays, system.grid.period).at(system.gain, values)
    A, B, C, D = (linalg.block_diag(*blocks) for blocks in zip(*vehicles, strict=True))
    L, memory = law.C.shape
    n, states = len(H), len(A)
    size = n + states + memory * L
    if size > MAX_STATES:
        raise UndecidedError(f"the loop has {size} states, more than {MAX_STATES}")
    physical = _in_coordinates(law, vectors) if symmetric else _of_asymmetric(law, H)
    M = np.block(
        [
            [np.eye(n) + D @ physical.position, C, D @ physical.memory],
            [B @ physical.position, A, B @ physical.memory],
            [physical.learnt[0], np.zeros((memory * L, states)), physical.kept],
        ]
    )
    if not np.abs(np.linalg.eigvals(M)).max() <= 1.0 + NEUTRAL_RATE * system.grid.period:
        raise UndecidedError("the loop is unstable")
    q_star = path.q_star - path.q_star[0]
    s = q_star @ H.T
    carried = system.grid.period * path.flow
    seen = np.vstack([carried[:1], carried])  # over the period before, as an agent knows it
    by_inputs = s @ physical.targets.T + seen @ physical.flow.T
    inputs = np.hstack(
        [by_inputs @ D.T, by_inputs @ B.T, s @ physical.learnt[1].T + seen @ physical.learnt[2].T],
    )[:-1]
    inputs[:, :n] += carried
    followed = np.zeros((len(inputs) + 1, size))
    for k, driven in enumerate(inputs):
        followed[k + 1] = M @ followed[k] + driven
    error = (q_star - followed[:, :n])[-path.counted :]
    commands = np.hstack([physical.position, np.zeros((n, states)), physical.memory])
    u = (followed @ commands.T + by_inputs)[-path.counted :]
    speed = np.linalg.norm(system.team.unpack(u), axis=2).max(axis=0)
    limited = [id for id, v, limit in zip(system.team.agent_ids, speed, system.law.limit, strict=False) if v > limit]
    return float(np.sqrt((error**2).sum(axis=1).mean() / len(speed))), limited
