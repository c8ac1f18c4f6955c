"""Errors of a run, sample by sample, for runs that keep only scores."""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, IntArray
from mjsheaf.control.law import disagree
from mjsheaf.errors import InputError
from mjsheaf.jit import inline_jit
from mjsheaf.system import System
from mjsheaf.tiers import Tiered

_MOST_NUMBERS = 12_000_000  # of what carries targets to q*


class Goal(NamedTuple):
    """Reference for the scores of worlds of N agents, over T samples.

    Attributes:
        carry, rest: Coefficients of q* = carry p + rest for stacked positions p, shapes (n_q, n_p) and (n_q,).
        own: Vehicle and axis of each number of q, then of p, shape (n_q + n_p, 2).
        first: Index of each agent's first number in q, shape (N + 1,).
        bounds: Bounds on |e| at each sample, shape (U, T), m; infinite where there is none.
        samples: Number T of samples.
        half: First sample of the second half.
    """

    carry: Array
    rest: Array
    own: IntArray
    first: IntArray
    bounds: Array
    samples: int
    half: int


class Scores(NamedTuple):
    """Scores of W worlds, written as they run.

    Attributes:
        bound: Index of each world's bound in the goal, shape (W,).
        squares: Squared errors |q*_i - q_i|^2 at the present sample, shape (W, N), m^2.
        y, eta: Measurements over exact links and their eta, shapes (W, m) and (W, V, 3), m; empty if all links are
            exact, because the law's own are then used.
        bad: Time at which each vehicle diverged, NEVER if it did not, shape (W, V); see `ThreadedLoop._work`.
        found: Scores, see the columns below, shape (W, 7).
        ended: First vehicle that diverged and the time, -1 if none has, shape (W, 2).
    """

    bound: IntArray
    squares: Array
    y: Array
    eta: Array
    bad: IntArray
    found: Array
    ended: IntArray


TRACKING, DISAGREEMENT, LATE_TRACKING, LATE_DISAGREEMENT, RATIO, SETTLED_RATIO, TAKEN = range(7)
"""Columns of `Scores.found`: RMS of |e_i| and mean |eta_i| at the last sample, m; sums of their squares over the last
half; largest |e| over its bound, after the start and over the last half; samples taken."""


@inline_jit
def square_error(goal, x, i):
    """|q*_i - q_i|^2 of agent i, m^2, where vehicles are at x (V, 3), m."""
    n, total = goal.rest.shape[0], 0.0
    for r in range(goal.first[i], goal.first[i + 1]):
        e = goal.rest[r] - x[goal.own[r, 0], goal.own[r, 1]]
        for c in range(goal.carry.shape[1]):
            e += goal.carry[r, c] * x[goal.own[n + c, 0], goal.own[n + c, 1]]
        total += e * e
    return total


@inline_jit
def square_errors(goal, x, squares):
    """Write |q*_i - q_i|^2 of all agents into squares (N,), m^2; NaN for absent agents."""
    for i in range(squares.shape[0]):
        squares[i] = square_error(goal, x, i)


class SquareErrors:
    """Squared errors |q*_i - q_i|^2 of the agents of a team, called with positions.

    Attributes:
        team: The team.
    """

    def __init__(self, system: System) -> None:
        self.team = system.team
        self._goal = goal_of(system, np.zeros((0, 0))) if _is_scorable(system) else None

    def __call__(self, x: Array) -> Array:
        """Compute them where vehicles are at x (V, 3), m, shape (N,), m^2; NaN for absent agents."""
        N = len(self.team.agents)
        squares = np.empty(N)
        if self._goal is None:
            return np.asarray(((self.team.harmonic_extension(x) - x[:N]) ** 2).sum(axis=1))
        _square_errors(self._goal, x, squares)
        return squares


_square_errors = Tiered(square_errors)


@inline_jit
def score(goal, scores, w, n, loop):
    """Take sample n of world w into its scores, from `squares` and what the law left."""
    N, found, square, size, eta = goal.first.shape[0] - 1, scores.found[w], 0.0, 0.0, loop.state.memory.residual
    if scores.eta.shape[1] > 0:
        eta = scores.eta[w]
        disagree(loop.params.control.law.edges, loop.state.x, scores.y[w], eta)
    for i in range(N):
        square += scores.squares[w, i]
        size += np.sqrt(eta[i, 0] ** 2 + eta[i, 1] ** 2 + eta[i, 2] ** 2)
    found[TRACKING], found[DISAGREEMENT], found[TAKEN] = np.sqrt(square / N), size / N, n + 1.0
    late = n >= goal.half
    if late:
        found[LATE_TRACKING] += square / N
        found[LATE_DISAGREEMENT] += (size / N) ** 2
    if n > 0:  # at the start both are |e|
        ratio = np.sqrt(square) / goal.bounds[scores.bound[w], n]
        if ratio > found[RATIO] or ratio != ratio:
            found[RATIO] = ratio
        if late and (ratio > found[SETTLED_RATIO] or ratio != ratio):
            found[SETTLED_RATIO] = ratio


def require_scorable(system: System) -> None:
    """Refuse a team of which no errors can be computed this way.

    Raises:
        InputError: what carries its targets to q* is too large, or q* is no linear function of them.
    """
    if not system.team.plain:
        raise InputError(
            "communication: q* of a team with range, bearing or directed edges, or without targets and anchors, is no "
            "linear function of the targets, as a batch requires for its scores; expected separate runs"
        )
    n_q, n_p = system.team.first_state[-1], system.team.dirichlet.B.shape[1]
    if not _is_scorable(system):
        raise InputError(
            f"agents: {n_q} coordinates of theirs by {n_p} of targets are more than a batch scores; expected a product "
            f"of at most {_MOST_NUMBERS}, or runs one by one"
        )


def _is_scorable(system: System) -> bool:
    """Return True if q* is a linear function of the targets, of moderate size."""
    team = system.team
    return team.plain and int(team.first_state[-1]) * team.dirichlet.B.shape[1] <= _MOST_NUMBERS


def goal_of(system: System, bounds: Array) -> Goal:
    """Return the goal of a system that passed `require_scorable`, with bounds (U, T) in m."""
    team, steps, n_p = system.team, system.grid.steps, system.team.dirichlet.B.shape[1]
    rest = team.extend(np.zeros(n_p))
    return Goal(
        carry=np.ascontiguousarray((team.extend(np.eye(n_p)) - rest).T),
        rest=rest,
        own=np.column_stack(np.divmod(team.slots, 3)).astype(np.int64),
        first=np.asarray(team.first_state, dtype=np.int64),
        bounds=bounds,
        samples=steps + 1,
        half=(steps + 1) // 2,
    )
