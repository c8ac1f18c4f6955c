"""What a non-trivial relative cohomology means for the team: who is free to drift, and along what."""

import numpy as np
from numpy.typing import NDArray

from mjsheaf.team.team import Team

Array = NDArray[np.float64]

_AXES = "xyz"


def sparse_basis(basis: Array) -> Array:
    """A basis of the same space with few entries, by reduced column echelon form.

    Args:
        basis: columns, shape (n, r).

    Returns:
        Array of shape (n, r); each column has largest entry 1 and entries below 1e-9 are zero.
    """
    rows = basis.T.copy()
    for k in range(len(rows)):
        pivot_row, pivot = divmod(int(np.argmax(np.abs(rows[k:]))), rows.shape[1])
        rows[[k, k + pivot_row]] = rows[[k + pivot_row, k]]
        rows[k] /= rows[k, pivot]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, pivot], rows[k])
    rows[np.abs(rows) < 1e-9] = 0.0
    return rows.T


def free_directions(team: Team) -> list[str]:
    """Say, one line for each basis vector of H^0(G, G_p; F), which agents are free along what."""
    return [_describe(team, vector) for vector in sparse_basis(team.dirichlet.null_basis).T]


def _describe(team: Team, vector: Array) -> str:
    motion = team.unpack(vector)
    movers = [(a.id, motion[i], a.dimension) for i, a in enumerate(team.agents) if np.any(motion[i])]
    names = [name for name, _, _ in movers]
    listed = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    if len({tuple(np.round(direction, 6)) for _, direction, _ in movers}) > 1:
        each = ", ".join(f"{name} along {_direction(d[:n])}" for name, d, n in movers[:8])
        return f"{each}{', ...' if len(movers) > 8 else ''}, moving together"
    together = " together" if len(names) > 1 else ""
    direction = movers[0][1][: max(n for _, _, n in movers)]
    return f"{listed} {'are' if len(names) > 1 else 'is'} free along {_direction(direction)}{together}"


def _direction(d: Array) -> str:
    axes = np.flatnonzero(d)
    if len(axes) == 1:
        return ("-" if d[axes[0]] < 0 else "") + _AXES[axes[0]]
    unit = d / np.linalg.norm(d)
    return "(" + ", ".join(f"{x:.2g}" for x in unit) + ")"
