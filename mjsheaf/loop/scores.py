"""Squared errors of agents where vehicles are, for loops that need them at once."""

from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import InputError
from mjsheaf.jit import inline_jit
from mjsheaf.system import System
from mjsheaf.tiers import Tiered

_MOST_NUMBERS = 12_000_000  # of what carries targets to q*


class Goal(NamedTuple):
    """Reference for the errors of N agents.

    Attributes:
        carry, rest: Coefficients of q* = carry p + rest for stacked positions p, shapes (n_q, n_p) and (n_q,).
        own: Vehicle and axis of each number of q, then of p, shape (n_q + n_p, 2).
        first: Index of each agent's first number in q, shape (N + 1,).
    """

    carry: Array
    rest: Array
    own: IntArray
    first: IntArray


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
        self._goal = goal_of(system) if _is_scorable(system) else None

    def __call__(self, x: Array) -> Array:
        """Compute them where vehicles are at x (V, 3), m, shape (N,), m^2; NaN for absent agents."""
        N = len(self.team.agents)
        squares = np.empty(N)
        if self._goal is None:
            return np.asarray(((self.team.harmonic_extension(x) - x[:N]) ** 2).sum(axis=1))
        _square_errors(self._goal, x, squares)
        return squares


_square_errors = Tiered(square_errors)


def require_scorable(system: System) -> None:
    """Refuse a team of which no errors can be computed this way.

    Raises:
        InputError: what carries its targets to q* is too large, or q* is no linear function of them.
    """
    if not system.team.plain:
        raise InputError(
            "communication: q* of a team with range, bearing or directed edges, or without targets and anchors, is no "
            "linear function of the targets, as worlds that step together require; expected separate runs"
        )
    n_q, n_p = system.team.first_state[-1], system.team.dirichlet.B.shape[1]
    if not _is_scorable(system):
        raise InputError(
            f"agents: {n_q} coordinates of theirs by {n_p} of targets are too many for worlds that step together; "
            f"expected a product of at most {_MOST_NUMBERS}, or runs one by one"
        )


def _is_scorable(system: System) -> bool:
    """Return True if q* is a linear function of the targets, of moderate size."""
    team = system.team
    return team.plain and int(team.first_state[-1]) * team.dirichlet.B.shape[1] <= _MOST_NUMBERS


def goal_of(system: System) -> Goal:
    """Return the goal of a system that passed `require_scorable`."""
    team, n_p = system.team, system.team.dirichlet.B.shape[1]
    rest = team.extend(np.zeros(n_p))
    return Goal(
        carry=np.ascontiguousarray((team.extend(np.eye(n_p)) - rest).T),
        rest=rest,
        own=np.column_stack(np.divmod(team.slots, 3)).astype(np.int64),
        first=np.asarray(team.first_state, dtype=np.int64),
    )
