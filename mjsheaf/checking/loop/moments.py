"""Second moments of a law over its links: the decay rate while measurements are lost, and the errors that noise makes.

A lost measurement is skipped. E[x x^T] goes to E[A x x^T A^T], a linear operator on matrices that keeps the positive
semidefinite ones, so that its spectral radius is an eigenvalue. For the paper's law without delay, where x is e, it is
self-adjoint: its largest eigenvalue, by Lanczos, is within the norm of the residual of the one that is stated. With
delay, newton or integral x is more than e, and the operator T is not self-adjoint; the eigenvalue may be multiple, and
its eigenvector badly conditioned. The verdict then rests on X - T(X) = I. T maps the cone of positive semidefinite
matrices into itself, hence:

- If a solution has X > 0, then T(X) = X - I <= (1 - 1 / lambda_max(X)) X, so that the spectral radius is below 1.
- If the spectral radius is below 1, then X = I + T(I) + T(T(I)) + ... > 0. So a solution with a negative eigenvalue
  shows that it is not.

Both hold of any right side that is positive definite, and so of the computed one, X - T(X), which is close to I.

Feedforward and drift do not depend on e, whichever samples they miss. With losses in bursts (Gilbert and Elliott)
nothing is claimed.
"""

from functools import cached_property, partial
from typing import Any

import numpy as np
from pydantic import Field
from scipy import sparse
from scipy.linalg import block_diag, schur
from scipy.sparse.linalg import ArpackError, LinearOperator, cg, eigs, eigsh, gmres

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.linked_law import MOST_STATES, MOST_WORK, LinkedLaw, team_loop
from mjsheaf.checking.loop.sampled_loop import stationary
from mjsheaf.errors import UndecidedError
from mjsheaf.section import OF_TEAM, PER_AGENT_RMS, TEAM_NORM, Finite, Norm, Record, per_agent
from mjsheaf.team import Team

_MOST_MOMENTS = 60_000  # numbers in the second moments with delay, newton or integral
_FEW = 40  # second moments whose eigenvalue is found of a dense matrix
_TOLERANCE = 1e-10  # of eigenvalues and of covariances, relative
_ROUNDING = 1e-9  # of a factor: closer to 1 nothing is decided


class LossAnswer(Record):
    """Decay rate of the mean square error under packet loss; the law skips lost measurements.

    If edges disagree at q*, or if e does not converge to zero, each loss moves agents. The resulting errors are not
    counted.
    """

    stable: bool | None = Field(None, description="E|e|^2 falls; null where undecided: see reason")
    factor: Finite = Field(None, description="by which E|e|^2 falls in a period, in the long run")
    accuracy: Finite = Field(
        None,
        description="norm of the residual of the factor's eigenvector: an error bound of the factor of the paper's law "
        "without delay, else an estimate",
    )
    bound: Finite = Field(
        None, description="of E|e|^2 in any one period, at most; null where e is not all that the loop remembers"
    )
    rate: Finite = Field(None, description="at which the root of E|e|^2 decays, 1/s; negative where it grows")
    reason: str = Field(description="why a number is missing, or empty")


def loss_answer(law: LinkedLaw) -> LossAnswer:
    """Compute the decay rate of E|e|^2."""
    found: dict[str, Any] = {}
    try:
        moments = SecondMoments(law)
        found["bound"] = moments.bound
        factor, accuracy = found["factor"], found["accuracy"] = moments.factor
        found["stable"] = factor < 1.0 if abs(factor - 1.0) > max(accuracy, _ROUNDING) else moments.stable
        found["rate"] = -np.log(factor) / (2.0 * law.loop.period) if factor > 0.0 else None
    except UndecidedError as error:
        return LossAnswer(reason=str(error), **found)
    return LossAnswer(reason="the factor is too close to 1" if found["stable"] is None else "", **found)


class SecondMoments:
    """Map of the second moments of the states x of `team_loop`, x+ = (M + L C) x, over a period, under losses.

    Where the numbers of edges arrive with probabilities r, with B = M + L r C,

        X -> B X B^T + L (r (1 - r) C X C^T) L^T, of C X C^T each edge's own block.
    """

    def __init__(self, law: LinkedLaw) -> None:
        """Prepare it.

        Raises:
            UndecidedError: Lost samples are held, losses come in bursts, or the loop is too large.
        """
        links = law.links
        if (links.held & links.lossy).any():
            raise UndecidedError("lost samples are held")
        if links.bursty:
            raise UndecidedError("undecided with bursts")
        p = 1.0 - links.delivered
        self._symmetric = law.loop.is_papers and not links.delay.any()
        M, L, C = team_loop(law, links.delay, MOST_STATES if self._symmetric else int(_MOST_MOMENTS**0.5))
        sizes = np.array([len(edge.D) for edge in law.edges])
        self._arrives = np.repeat(1.0 - p, sizes)
        self._mean = M + L * self._arrives @ C
        self._law = law
        self._L = L
        self._around = sparse.csr_array(C)
        self._back = sparse.csr_array(L)
        weights = [weight * np.ones((m, m)) for weight, m in zip(p * (1.0 - p), sizes, strict=True)]
        self._lost = sparse.csr_array(sparse.block_diag(weights))

    def _apply(self, X: Array) -> Array:
        """Return the moments a period after X, shape (n, n)."""
        lost = self._lost.multiply((self._around @ X) @ self._around.T)
        return np.asarray(self._mean @ X @ self._mean.T + (self._back @ lost @ self._back.T).toarray())

    @property
    def bound(self) -> float | None:
        """By which E|e|^2 falls in any one period, at most; None where e is not all that the loop remembers."""
        return float(np.linalg.eigvalsh(self._apply(np.eye(len(self._mean)))).max()) if self._symmetric else None

    def covariances(self) -> Array:
        """Stationary covariances of e, m^2, and of the command, m^2/s^2, shape (2, n, n), by the noise of links.

        Raises:
            UndecidedError: the loop is unstable, or the iteration did not converge.
        """
        if not self.factor[0] < 1.0:
            raise UndecidedError("the loop is unstable")
        noise = block_diag(*self._law.links.noise)
        X = self._solve(self._L * self._arrives @ noise @ self._L.T)
        command = 2.0 * (X - self._mean @ X)  # of h u = e_k - e_{k+1}
        vectors = self._law.vectors
        n = vectors.shape[1]
        error, asked = X[:n, :n], command[:n, :n]
        if n < len(vectors):  # a team that is free to move: from the coordinates of `team_loop`
            error, asked = (vectors @ x @ vectors.T for x in (error, asked))
        return np.stack([error, 0.5 * (asked + asked.T) / self._law.loop.period**2])

    def _operator(self, *, less: bool = False) -> LinearOperator:
        """X -> the moments a period later, or X less those, on flat vectors."""

        def apply(flat: Array) -> Array:
            after = self._apply(flat.reshape(self._mean.shape)).ravel()
            return flat.ravel() - after if less else after

        return LinearOperator((self._mean.size,) * 2, matvec=apply, dtype=np.float64)

    @cached_property
    def factor(self) -> tuple[float, float]:
        """By which E|e|^2 falls in the long run, and the norm of its eigenvector's residual.

        Raises:
            UndecidedError: the iteration did not converge.
        """
        operator = self._operator()
        start = np.eye(len(self._mean)).ravel()
        if len(start) <= _FEW:
            # A Schur form scales nothing: the scaling of the usual routine spoils multiple eigenvalues.
            matrix = operator @ np.eye(len(start))
            value = float(np.abs(np.diagonal(schur(matrix, output="complex")[0])).max())
            return value, float(np.linalg.svd(matrix - value * np.eye(len(start)), compute_uv=False)[-1])
        try:
            lanczos = {"A": operator, "k": 1, "v0": start, "tol": _TOLERANCE}
            values, vectors = eigsh(**lanczos, which="LA") if self._symmetric else eigs(**lanczos, which="LM")
        except ArpackError:
            raise UndecidedError("the second moments' eigenvalue did not converge") from None
        value, vector = values[0], vectors[:, 0]
        after = operator @ vector.real + 1j * (operator @ vector.imag)
        return float(abs(value)), float(np.linalg.norm(after - value * vector))

    @cached_property
    def stable(self) -> bool | None:
        """Return True if E|e|^2 falls, by the solution of X - T(X) = I (see the module); None if rounding decides.

        Raises:
            UndecidedError: the iteration did not converge.
        """
        X = self._solve(np.eye(len(self._mean)))
        smallest, size = float(np.linalg.eigvalsh(X).min()), float(np.abs(X).max())
        drop = X - self._apply(X)
        known = np.linalg.eigvalsh(drop).min() > 0.5 and abs(smallest) >= _ROUNDING * size
        return smallest > 0.0 if known else None

    def _solve(self, added: Array) -> Array:
        """Solve X - T(X) = added for symmetric matrices, shape (n, n)."""
        less, right = self._operator(less=True), added.ravel()
        solve = partial(cg, maxiter=2000) if self._symmetric else partial(gmres, restart=100, maxiter=20)
        found, failed = solve(less, right, rtol=_TOLERANCE)
        if failed:
            raise UndecidedError("the covariance under loss did not converge")
        X = found.reshape(self._mean.shape)
        return np.asarray(0.5 * (X + X.T))


# -- noise of links and of odometry ------------------------------------------------------------------------------------
#
# Noise is white in time, so that the covariance of the states P = M P M^T + G U G^T, between each pair of modes of
# `Loop.with_noise`: summed up by doubling. Where delays are unlike or measurements are lost, that of the whole team.

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
    M, G, _ = law.loop.with_noise(0)
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
    delay = int(links.delay.max(initial=0))
    M, G, command = law.loop.with_noise(delay)
    n = len(M)
    states, inputs = G.shape[1:]
    if n * n * states**3 > MOST_WORK:
        raise UndecidedError(f"{n} modes of {states} states each have too many covariances")
    if not law.loop.radius_at(delay) < 1.0:
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
