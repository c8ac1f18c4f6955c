"""The stationary errors that noise of links and of odometry makes, exactly.

Noise is white in time, so that the covariance of the states P = M P M^T + G U G^T, between each pair of modes of
`delay`: summed up by doubling. Where delays are unlike or measurements are lost, that of the whole team: see `loss`.
"""

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.delay import MOST_WORK
from mjsheaf.checking.loop.linked_law import LinkedLaw
from mjsheaf.checking.loop.loss import SecondMoments
from mjsheaf.checking.loop.sampled_loop import DelayedLoop, stationary
from mjsheaf.errors import UndecidedError
from mjsheaf.section import OF_TEAM, PER_AGENT_RMS, TEAM_NORM, Finite, Norm, Record, per_agent
from mjsheaf.team import Team

_CHUNK = 4_000_000  # numbers of covariances at once


class AgentNoise(Record):
    """Effect of noise alone on an agent."""

    agent: str
    error: float = Field(description="RMS in time of |e_i| about its mean, m")
    norm: Norm = Field(PER_AGENT_RMS, description="which norm `error` is: of this agent alone")
    command: float = Field(description="RMS of the command, m/s")


class NoiseAnswer(Record):
    """The stationary errors that noise and bias of links and of odometry make, at samples.

    They add to those of targets' motion, flow and losses: means to means, and squares of the RMS to squares.
    """

    mean: Finite = Field(None, description="|mean of e| of the team, by biases, m; null: see reason")
    error: Finite = Field(None, description="RMS in time of |e| of the team about its mean, m; null: see reason")
    mean_per_agent: Finite = Field(None, description="`mean` as RMS over agents, mean / sqrt(N), m")
    error_per_agent: Finite = Field(None, description="`error` as RMS over agents, error / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    command: Finite = Field(None, description="RMS of the commands of the team, 2-norm, m/s; null: see reason")
    agents: list[AgentNoise] = Field(description="each agent, in order; empty where there is no answer")
    linearised: bool = Field(
        description="noise of range and bearing is linearised along q*; in space this makes an upper estimate, "
        "by 1 % where lines of sight are level in the bodies' frames, by a factor sqrt(2) at most"
    )
    reason: str = Field(description="why a number is missing, or empty")


def noise_answer(law: LinkedLaw, team: Team) -> NoiseAnswer:
    """Compute the effect of noise of measurements and odometry in the long run, without saturation."""
    linearised = law.links.linearised
    try:
        mean = mean_error(law)
        error, command = map(np.diagonal, noise_covariances(law))
    except UndecidedError as why:
        return NoiseAnswer(agents=[], linearised=linearised, reason=str(why))
    first = team.first_state
    error, command = np.maximum(error, 0.0), np.maximum(command, 0.0)
    each = np.sqrt(np.add.reduceat([error, command], first[:-1], axis=1))
    offset, size, agents = float(np.linalg.norm(mean)), float(np.sqrt(error.sum())), len(team.agents)
    return NoiseAnswer(
        mean=offset,
        error=size,
        mean_per_agent=per_agent(offset, agents),
        error_per_agent=per_agent(size, agents),
        command=np.sqrt(command.sum()),
        agents=[
            AgentNoise(agent=id, error=e, command=u) for id, (e, u) in zip(team.agent_ids, each.T.tolist(), strict=True)
        ],
        linearised=linearised,
        reason="",
    )


def mean_error(law: LinkedLaw) -> Array:
    """The mean of e that biases make, shape (n,), m: where neither eta nor the command has a mean.

    Raises:
        UndecidedError: measurements with a bias are lost.
    """
    vectors, links, terms = law.vectors, law.links, law.terms
    if links.lossy.any() and any(bias.any() for bias in links.bias):
        raise UndecidedError("measurements with a bias are lost")
    eta, sensed_motion = np.zeros((2, len(vectors)))
    own_motion = np.full(len(vectors), terms.bias * law.loop.period)
    for edge, bias in zip(law.edges, links.bias, strict=True):
        eta[edge.slots] += edge.pull @ bias
        sensed_motion[edge.slots] += edge.sensing * edge.H @ own_motion[edge.slots]
    M, G, _ = DelayedLoop(law.loop, 0).matrices
    inputs = np.stack([eta, 0.0 * eta, sensed_motion, own_motion], axis=1)
    q = np.linalg.solve(np.eye(M.shape[1]) - M, G @ (vectors.T @ inputs)[:, :, None])[:, 0, 0]
    return np.asarray(-vectors @ q)


def noise_covariances(law: LinkedLaw) -> Array:
    """Stationary covariances of e, m^2, and of the command, m^2/s^2, over the states of q, shape (2, n, n).

    Raises:
        UndecidedError: they are not known, and why.
    """
    links = law.links
    lossy = links.lossy.any()
    if lossy or (links.delay != links.delay[:1]).any():
        if law.terms.feedforward or law.terms.drift > 0.0:
            what = "measurements are lost" if lossy else "delays are unlike"
            raise UndecidedError(f"{what}, and the law has feedforward or drift")
        return SecondMoments(law).covariances()
    delayed = DelayedLoop(law.loop, int(links.delay.max(initial=0)))
    M, G, command = delayed.matrices
    n = len(M)
    states, inputs = G.shape[1:]
    if n * n * states**3 > MOST_WORK:
        raise UndecidedError(f"{n} modes of {states} states each have too many covariances")
    if not delayed.radius < 1.0:
        raise UndecidedError("the loop is unstable")
    U = _input_covariances(law, inputs)
    of_state = command[:, :states]
    of_input = command[:, states:]
    moments = np.zeros((2, n, n))
    step = max(1, _CHUNK // (n * states * states))
    for begin in range(0, n, step):
        rows = slice(begin, begin + step)
        P = stationary(M[rows, None], M, np.einsum("aik,abkl,bjl->abij", G[rows], U[rows], G, optimize=True))
        moments[0, rows] = P[..., 0, 0]
        moments[1, rows] = np.einsum("ai,abij,bj->ab", of_state[rows], P, of_state, optimize=True)
        moments[1, rows] += np.einsum("ai,abij,bj->ab", of_input[rows], U[rows], of_input, optimize=True)
    return np.asarray(law.vectors @ moments @ law.vectors.T)


def _input_covariances(law: LinkedLaw, inputs: int) -> Array:
    """Covariances of the noise that enters the loops of two of n modes, shape (n, n, inputs, inputs)."""
    Q = law.vectors
    n = Q.shape[1]
    variance = law.terms.noise**2
    pulled = [edge.pull @ noise @ edge.pull.T for edge, noise in zip(law.edges, law.links.noise, strict=True)]
    rate = Q.T @ law.spread([edge.sensing * part for edge, part in zip(law.edges, pulled, strict=True)]) @ Q
    S = Q.T @ law.spread([edge.sensing * edge.H for edge in law.edges]) @ Q
    U = np.zeros((n, n, inputs, inputs))
    U[..., 0, 0] = Q.T @ law.spread(pulled) @ Q
    U[..., 1, 1] = rate
    U[..., 0, 1] = U[..., 1, 0] = -rate  # a sensing agent is the tail: -F^T K in eta, F^T K in B p'
    U[..., 2, 2] = variance * S @ S
    U[..., 3, 3] = variance * np.eye(n)
    U[..., 2, 3] = U[..., 3, 2] = variance * S
    return U
